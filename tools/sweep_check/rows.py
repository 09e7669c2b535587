"""Rows whose numbers are known and whose time is chosen."""

from __future__ import annotations

import hashlib
import resource
import time
from functools import cache
from typing import Any

import numpy as np


def nap(settings: dict[str, Any]) -> dict[str, Any]:
    """Sleeps `seconds`; numbers of every kind that depend on x alone."""
    time.sleep(settings["seconds"])
    x = int(settings["x"])
    if x % 97 == 96:
        raise ValueError(f"x = {x} is one of those that fail")
    generator = np.random.default_rng(x)
    return {
        "whole": x * x, "real": float(generator.normal()), "text": hashlib.sha256(str(x).encode()).hexdigest()[:8],
        "none": None if x % 3 else 1.0 / (x + 1), "nested": [x, {"half": x / 2}],
    }  # fmt: skip


def work(settings: dict[str, Any]) -> dict[str, Any]:
    """Computes as long as it is asked to, the same number of operations every time, in arrays that it has: what temporary
    arrays cost depends on the process (glibc gives the top of a small heap back to the system at every free)."""
    a = np.arange(20000.0) + settings["x"]
    b = np.empty_like(a)
    for _ in range(int(settings["times"])):
        np.multiply(a, a, out=b)
        np.add(b, 1.0, out=b)
        np.sqrt(b, out=a)
    return {"sum": float(a.sum())}


def page_faults() -> int:
    """Of this process, so far, that needed no disk."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


def counted(settings: dict[str, Any]) -> dict[str, Any]:
    """`work`, and the page faults of its process so far."""
    return work(settings) | {"faults": page_faults()}


def faults(taken: Any) -> int:
    """The same as a measure."""
    return page_faults()


def simulated(settings: dict[str, Any], duration_s: float) -> dict[str, Any]:
    """A run of the tanpura's case as one would write it in a loop."""
    from synth.research.simulation import simulate

    tables = _tanpura()
    tables["initial"]["displacement_m"] = settings["initial.displacement_m"]
    result = simulate(tables, duration_s=duration_s, output_rate_hz=44100)
    return {"peak": float(np.abs(result.u[:, 0]).max())}


@cache
def _tanpura() -> dict[str, Any]:
    from synth.research.case import read_tables

    return read_tables("tanpura", {})[0]
