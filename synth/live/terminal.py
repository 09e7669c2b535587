"""The terminal a program runs in, as a source of keys: one by one as they are pressed, and not shown.

What the system and the shell do to a program is borne: Ctrl-Z and `fg`, `bg`, a terminal that goes away, signals that end
the program. The terminal is as it was whenever somebody else has it, and it is never touched from the background, where
the system stops a program that does.
"""

from __future__ import annotations

import atexit
import os
import select
import signal
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, Self

from synth.live.keycodes import RELEASED, KeyDecoder

if sys.platform != "win32":
    import termios

# Kitty's protocol: tell keys apart (1), say what happens to them (2), all of them (8).
_ASK_FOR_KEY_UP, _NO_MORE_KEY_UP = b"\x1b[>11u", b"\x1b[<u"
_NO_PROTOCOL = ("", "dumb", "linux")
_MOST_BYTES = 4096


def available(input: int = 0) -> bool:
    """Whether there is a terminal, and this program is in its foreground."""
    try:
        return os.isatty(input) and (sys.platform == "win32" or in_front(input))
    except OSError:
        return False


def in_front(input: int) -> bool:
    """Whether the terminal may be touched: a program in the background that does is stopped by the system."""
    try:
        return os.tcgetpgrp(input) == os.getpgrp()
    except OSError:
        return True  # not the terminal that controls us, or gone


class KeySource(ABC):
    """A context; while it lasts `read` and `keys` give what has been pressed."""

    #: how often the terminal has become ours; more than before: what happened to keys in between is not known
    times_taken = 0

    def __init__(self) -> None:
        self._decoder = KeyDecoder()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @abstractmethod
    def open(self) -> None:
        """Takes the terminal, where there is one and as soon as it may be touched."""

    @abstractmethod
    def close(self) -> None:
        """Gives it back as it was. May be called again."""

    @property
    @abstractmethod
    def is_one(self) -> bool:
        """Whether keys can be pressed now."""

    @abstractmethod
    def read(self, timeout_s: float) -> bytes | None:
        """What was pressed, b"" if nothing was for `timeout_s`; None: nothing ever will be, there is no terminal."""

    def keys(self) -> list[str]:
        """Names of the keys (see keycodes.Key) pressed since the last call."""
        return [key.name for key in self._decoder.feed(self.read(0.0) or b"", time.monotonic()) if key.happens != RELEASED]


class Terminal(KeySource):
    """A POSIX terminal.

    input: its file descriptor.  key_up: whether to ask it for kitty's protocol, which tells of keys going up.
    """

    def __init__(self, input: int = 0, *, key_up: bool = False) -> None:
        super().__init__()
        self._input = input
        self._ask = key_up and os.environ.get("TERM", "") not in _NO_PROTOCOL
        self._before: Any = None  # its attributes when it was last not ours
        self._taken = False
        self._asked = False
        self._open = False
        self._lock = threading.RLock()

    def open(self) -> None:
        with suppress(OSError):
            self._open = os.isatty(self._input)
        if self._open:
            _look_after(self)
            self._take()

    def close(self) -> None:
        with self._lock:
            self._open = False
            # What was typed last is not for the shell.
            self.give_back(flush=True)
        _forget(self)

    @property
    def is_one(self) -> bool:
        return self._taken

    def read(self, timeout_s: float) -> bytes | None:
        if not self._open:
            return None
        if not self._take():
            time.sleep(timeout_s)
            return b""
        try:
            if not select.select([self._input], [], [], timeout_s)[0]:
                return b""
            with _never_stopped():
                data = os.read(self._input, _MOST_BYTES)
        except InterruptedError:
            return b""
        except (OSError, ValueError):
            if not in_front(self._input):
                return b""  # it has been put into the background in this moment
            data = b""
        if not data:
            self.close()  # it is gone
            return None
        return data

    def _take(self) -> bool:
        """Makes the terminal ours, also when somebody else had it; whether it is."""
        with self._lock, _never_stopped(), suppress(termios.error):
            if not self._open or _leaving or not in_front(self._input):
                return False
            mode = termios.tcgetattr(self._input)
            shows = termios.ECHO | termios.ICANON
            if self._before is None or mode[3] & shows:
                self._before = termios.tcgetattr(self._input)
                mode[3] &= ~shows
                mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
                termios.tcsetattr(self._input, termios.TCSANOW, mode)
                self.times_taken += 1
            self._taken = True
            if self._ask and not self._asked:
                self._asked = True
                self._write(_ASK_FOR_KEY_UP)
        return self._taken

    def give_back(self, *, flush: bool = False) -> None:
        """The terminal as it was, if it is ours and we are in its foreground; else somebody else has seen to that.

        flush: drop what has been pressed and not read.
        """
        with self._lock, _never_stopped(), suppress(termios.error):
            taken, self._taken = self._taken, False
            asked, self._asked = self._asked, False
            if not taken or not in_front(self._input):
                return
            if asked:
                self._write(_NO_MORE_KEY_UP)
            if flush:
                termios.tcflush(self._input, termios.TCIFLUSH)
            # At once: not after output that Ctrl-S has halted.
            termios.tcsetattr(self._input, termios.TCSANOW, self._before)

    def _write(self, data: bytes) -> None:
        # Not through standard output, which may be a file.
        with suppress(OSError):
            output = os.open(os.ttyname(self._input), os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                os.write(output, data)
            finally:
                os.close(output)


class Console(KeySource):
    """A Windows console, which gives keys one by one and unseen to who asks so."""

    def __init__(self, input: int = 0) -> None:
        super().__init__()
        self._input = input
        self._open = False

    def open(self) -> None:
        self._open = available(self._input)

    def close(self) -> None:
        self._open = False

    @property
    def is_one(self) -> bool:
        return self._open

    def read(self, timeout_s: float) -> bytes | None:
        if not self._open:
            return None
        import msvcrt

        console: Any = msvcrt  # its functions exist on Windows only
        until = time.monotonic() + timeout_s
        while not console.kbhit():
            if time.monotonic() >= until:
                return b""
            time.sleep(0.002)
        key = console.getwch()
        if key in ("\x00", "\xe0"):
            arrow = {"H": "A", "P": "B", "M": "C", "K": "D"}.get(console.getwch())
            return f"\x1b[{arrow}".encode() if arrow else b""
        if key == "\x03":
            signal.raise_signal(signal.SIGINT)  # os.kill would end the process at once
            return b""
        return key.encode("utf-8", "ignore")


def terminal_at(input: int = 0, *, key_up: bool = False) -> KeySource:
    """The system's kind of terminal; not yet open. See Terminal."""
    return Console(input) if sys.platform == "win32" else Terminal(input, key_up=key_up)


def signal_as_typed(character: str) -> bool:
    """Does what a terminal does for Ctrl-C, Ctrl-Z and Ctrl-backslash, where it leaves that to us; whether it was one."""
    name = {"\x03": "SIGINT", "\x1a": "SIGTSTP", "\x1c": "SIGQUIT"}.get(character)
    if name is None or not hasattr(signal, name):
        return False
    if hasattr(os, "killpg"):
        os.killpg(os.getpgrp(), getattr(signal, name))
    else:
        signal.raise_signal(getattr(signal, name))
    return True


# --- what signals do to terminals that are ours

_ours: list[Terminal] = []
#: set while we are being stopped or ended
_leaving = False
_SIGNALS = ("SIGTSTP", "SIGQUIT", "SIGHUP", "SIGTERM")


def _look_after(terminal: Terminal) -> None:
    """From now on the terminal is given back before a signal stops or ends the program, and at its end."""
    if terminal not in _ours:
        _ours.append(terminal)
    atexit.register(terminal.close)
    if threading.current_thread() is threading.main_thread():
        for name in _SIGNALS:
            number = getattr(signal, name)
            # Where the program has ideas of its own, it sees to an orderly end.
            if signal.getsignal(number) == signal.SIG_DFL:
                signal.signal(number, _give_back_all)


def _forget(terminal: Terminal) -> None:
    if terminal in _ours:
        _ours.remove(terminal)
    atexit.unregister(terminal.close)
    if not _ours and threading.current_thread() is threading.main_thread():
        for name in _SIGNALS:
            number = getattr(signal, name)
            if signal.getsignal(number) is _give_back_all:
                signal.signal(number, signal.SIG_DFL)


def _give_back_all(number: int, _: object) -> None:
    """A signal's handler: what the signal does by default, without our terminals. They are taken again when they are next
    read, so whoever continues us need not say it.
    """
    global _leaving
    _leaving = True
    for terminal in list(_ours):
        terminal.give_back()
    signal.signal(number, signal.SIG_DFL)
    signal.raise_signal(number)  # to this thread: here we stop, or end
    signal.signal(number, _give_back_all)
    _leaving = False


@contextmanager
def _never_stopped() -> Iterator[None]:
    """Where a background program would be stopped for touching the terminal, it fails or succeeds instead."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTIN, signal.SIGTTOU})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
