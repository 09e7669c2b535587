"""An end that comes, whatever a request is waiting for.

A thread that reads from a disk that does not answer, or compiles, cannot be ended, and the interpreter would wait for it.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable

from synth.jit import kernel_cache

LOG = logging.getLogger(__name__)
#: how long everything may take to be put in order, and what is under way to end after that [s]
ORDER_S, LEAVE_S = 4.0, 3.0


class Ending:
    """Once begun, the process ends: by itself, or by force when its time is over."""

    def __init__(self, put_in_order: Callable[[], None]) -> None:
        self._put_in_order = put_in_order
        self._begun = False
        self._in_order = threading.Event()

    def put_in_order(self) -> None:
        """Write what is edited. May be called again."""
        self._put_in_order()
        self._in_order.set()

    def begin(self) -> None:
        """The end was asked for; also within a signal's handler."""
        if not self._begun:
            self._begun = True
            threading.Thread(target=self._force, name="author-ending", daemon=True).start()

    def _force(self) -> None:
        if self._in_order.wait(ORDER_S):
            time.sleep(LEAVE_S)
        else:  # perhaps the event loop does not come to it
            work = threading.Thread(target=self.put_in_order, daemon=True)
            work.start()
            self._in_order.wait(LEAVE_S)
        code = 0 if self._in_order.is_set() else 1
        if code:
            LOG.error("ended by force: the disk does not answer, and the last edits may not be autosaved")
        kernel_cache.leave(code)
