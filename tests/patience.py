"""How long tests wait: for what will come, as long as it takes where the machine is busy."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

#: how long a quiet machine may take for anything that is waited for [s]
QUIET_S = 60.0
#: … for what may have to compile kernels first, on two cores
COMPILING_QUIET_S = 600.0


def patience_s(quiet_s: float = QUIET_S) -> float:
    """How long to wait for what a quiet machine has within `quiet_s` [s]: on a busy one as many times longer as there is
    more to do than cores.

    Every wait ends with what it waits for; only what never comes takes so long."""
    return quiet_s * max(1.0, os.getloadavg()[0] / (os.cpu_count() or 1))


def compiling_s() -> float:
    """The same for what may have to compile kernels before."""
    return patience_s(COMPILING_QUIET_S)


def until(
    holds: Callable[[], Any],
    what: object = "waited in vain",
    quiet_s: float = QUIET_S,
    meanwhile: Callable[[], None] = lambda: None,
) -> Any:
    """Wait for something to be true, doing something meanwhile, `patience_s(quiet_s)` at most, however busy the machine
    gets; what it is then. Raises AssertionError with `what`."""
    begun = time.monotonic()
    while not (found := holds()):
        assert time.monotonic() - begun < patience_s(quiet_s), what
        meanwhile()
        time.sleep(0.01)
    return found
