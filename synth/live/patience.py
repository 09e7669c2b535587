"""Waiting for devices, which may never answer, and for threads, whatever happens meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

#: how long one call to a device or server may take [s]
CALL_S = 3.0
#: …and all that it takes to leave it, which is to stop and to close, a call each; also, to look for it and to open it [s]
LEAVE_S = 2.0 * CALL_S + 2.0


def joined(thread: threading.Thread, seconds: float | None = None) -> bool:
    """Waits for a thread (None: as long as it takes); whether it has ended.

    An exception meanwhile, like a signal's, is raised only afterwards: whoever waits is about to take down what the thread
    works on.
    """
    deadline = None if seconds is None else time.monotonic() + seconds
    raised: BaseException | None = None
    while thread.is_alive():
        left = None if deadline is None else deadline - time.monotonic()
        if left is not None and left <= 0.0:
            break
        try:
            thread.join(left)
        except BaseException as error:
            raised = raised or error
    if raised is not None:
        raise raised
    return not thread.is_alive()


def answers(call: Callable[[], object], seconds: float) -> bool:
    """Whether a call returns in this time; if not, it is left to itself, in a thread of its own."""
    thread = threading.Thread(target=call, name="synth-device", daemon=True)
    thread.start()
    return joined(thread, seconds)
