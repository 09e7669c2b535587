"""Waiting for devices, which may never answer, and for threads, whatever happens meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

#: how long one call to a device or server may take [s]
CALL_S = 3.0
#: …and all that it takes to leave it, which is to stop and to close, a call each; also, to look for it and to open it [s]
LEAVE_S = 2.0 * CALL_S + 2.0


class Worker(threading.Thread):
    """A thread that can be waited for whatever happens meanwhile.

    (`Thread.join` that is left by an exception may take the thread for ended.)
    """

    def __init__(self, work: Callable[[], object], name: str) -> None:
        super().__init__(target=work, name=name, daemon=True)
        self._done = threading.Event()

    def run(self) -> None:
        try:
            super().run()
        finally:
            self._done.set()

    def ended(self, seconds: float | None = None) -> bool:
        """Whether it ends in this time (None: it is waited for as long as it takes).

        An exception meanwhile, like a signal's, is raised only afterwards: whoever waits is about to take down what the
        thread works on.
        """
        deadline = None if seconds is None else time.monotonic() + seconds
        raised: BaseException | None = None
        while not self._done.is_set():
            left = None if deadline is None else deadline - time.monotonic()
            if left is not None and left <= 0.0:
                break
            try:
                self._done.wait(left)
            except BaseException as error:
                raised = raised or error
        if raised is not None:
            raise raised
        return self._done.is_set()


def answers(call: Callable[[], object], seconds: float) -> bool:
    """Whether a call returns in this time; if not, it is left to itself, in a thread of its own."""
    worker = Worker(call, "synth-device")
    worker.start()
    return worker.ended(seconds)
