"""Signals, heard in spite of machine code."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any


def hearing_signals(work: Callable[[], Any]) -> Any:
    """What `work` returns or raises. Meanwhile the main thread hears signals, which no compiled kernel does; one that ends
    the program leaves the work behind.
    """
    returned: list[Any] = []
    raised: list[BaseException] = []

    def run() -> None:
        try:
            returned.append(work())
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join()
    if raised:
        raise raised[0]
    return returned[0]
