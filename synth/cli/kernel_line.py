"""What compiles is said: on a terminal a line that overwrites itself, elsewhere a line at the start and one at the end.

Nothing is said where nothing is compiled. Everything goes to standard error.
"""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator

from synth.jit import compiling, kernel_cache, prebuilt

#: how often the line is drawn anew; what is over sooner than this is not worth a line of a log [s]
TICK_S, BRIEF_S = 0.2, 3.0


@contextlib.contextmanager
def compiling_shown(*, quiet: bool = False, verbose: bool = False) -> Iterator[None]:
    """Show what is compiled meanwhile, and let the main thread hear signals while it compiles. verbose: say at the end where
    kernels came from."""
    line = _Line(quiet)
    before, kernel_cache.interruptible = kernel_cache.interruptible, True
    try:
        with compiling.listening(line.look):
            yield
    finally:
        kernel_cache.interruptible = before
        line.end()
        if verbose and "numba" in sys.modules:
            line.tell(_where_from())


def _where_from() -> str:
    """Where this process had its kernels from."""
    found = prebuilt.found()
    made = compiling.progress()
    own = f"{made.done} compiled here" if made is not None and made.done else "none compiled here"
    if found.path is not None:
        return f"kernels: the native library {found.path}; beside it {own}"
    return f"kernels: Numba's, {own}; no native library: {found.why}"


def leave_compiling(code: int) -> None:
    """End the process at once if a thread that was left behind is still compiling: the interpreter would take the compiler
    away from under it."""
    if compiling.busy():
        kernel_cache.leave(code)


class _Line:
    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._terminal = sys.stderr is not None and sys.stderr.isatty()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._ended = threading.Event()
        self._shown = ""
        self._announced = self._complained = False

    def look(self) -> None:
        """A kernel begins or has ended; in any thread."""
        if self._quiet:
            return
        with self._lock:
            if self._thread is None:
                self._thread = threading.Thread(target=self._tick, name="kernel-line", daemon=True)
                self._thread.start()
            self._show()

    def _tick(self) -> None:
        while not self._ended.wait(TICK_S):
            with self._lock:
                self._show()

    def _show(self) -> None:
        now = compiling.progress()
        if now is None or self._ended.is_set():
            return
        self._complain()
        if self._terminal:
            self._draw(f"kernels, once on this machine: {now.done} of {now.total}, {now.seconds:.0f} s")
        elif compiling.busy() and not self._announced and (now.long or now.seconds >= BRIEF_S):
            self._announced = True
            self._write(f"synth: compiling kernels, once on this machine{'; takes ½ to 2 minutes' if now.long else ''}\n")
        elif self._announced and compiling.finished():
            self._done(now)

    def _complain(self) -> None:
        """Say once that they are not kept."""
        if not self._complained and (trouble := kernel_cache.trouble()) is not None:
            self._complained = True
            self._draw("")
            self._write(f"synth: {trouble}\n")

    def _done(self, now: compiling.Progress) -> None:
        self._announced = False
        rest = "" if now.done >= now.total else f" of {now.total}"
        self._write(f"synth: {now.done}{rest} kernels compiled in {now.seconds:.0f} s\n")

    def _draw(self, text: str) -> None:
        """Draw the terminal's line, while something is compiled; otherwise it is empty."""
        text = text if compiling.busy() else ""
        if text != self._shown:
            self._write("\r" + text.ljust(len(self._shown)) + ("" if text else "\r"))
        self._shown = text

    def _write(self, text: str) -> None:
        with contextlib.suppress(OSError, ValueError):  # whoever read it has gone
            sys.stderr.write(text)
            sys.stderr.flush()

    def tell(self, text: str) -> None:
        """A line of its own."""
        self._write(f"synth: {text}\n")

    def end(self) -> None:
        with self._lock:
            self._ended.set()
            now = compiling.progress()
            if now is None or self._quiet:
                return
            if self._shown:
                self._write("\r" + " " * len(self._shown) + "\r")
                self._shown = ""
            self._complain()
            if self._announced:
                self._done(now)
