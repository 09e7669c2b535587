"""The computer's keyboard as an instrument, in a terminal: for whoever has no other at hand.

A terminal says which key went down, not that it went up: there a note ends `hold_s` after it was struck, and while a key
repeats itself it is held. (Strings that ring on are none the worse for it.) Terminals with kitty's keyboard protocol
(kitty, foot, WezTerm, Ghostty, recent Konsole and iTerm2) tell both, and a note lasts as long as its key is down.
"""

from __future__ import annotations

import atexit
import codecs
import os
import re
import select
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Self

from synth.engine.events import CONTROL, NOTE_OFF, NOTE_ON
from synth.live.midistream import Sink

#: the keys of a piano from C on, two rows of letters
PIANO = "awsedftgyhujkolp;'"
HELP = (
    "a w s e d f t g y h u j k o l p ; '  play from C on",
    "z x  octave    c v  velocity    space  sustain    backspace or !  silence    q  quit",
)
QUIT = "quit"
SUSTAIN, ALL_SOUND_OFF, RESET_CONTROLLERS, ALL_NOTES_OFF = 64, 120, 121, 123
VELOCITY_STEP = 12
HIGHEST_OCTAVE = 9
# The same key again within this time is the keyboard's own repetition.
REPEAT_S = 0.1
# Escape alone is a key; followed by something within this time, the beginning of a sequence.
ESCAPE_S = 0.05
_LOOK_EVERY_S = 0.05
_PANIC_KEYS = ("!", "\x7f", "\x08")
_ARROWS = {"A": "up", "B": "down", "C": "right", "D": "left"}
_SEQUENCE = re.compile(r"\x1b(?:\[(?P<digits>[0-9:;<=>?]*)[ -/]*(?P<end>[@-~])|O(?P<ss3>.))")
_INCOMPLETE = re.compile(r"\x1b(?:\[[0-9:;<=>?]*[ -/]*|O)?\Z")
# Kitty's protocol: tell keys apart (1), say what happens to them (2), all of them (8).
_ASK_FOR_KEY_UP, _NO_MORE_KEY_UP = b"\x1b[>11u", b"\x1b[<u"
_REPEAT, _RELEASE = 2, 3
_CONTROL_MODIFIER = 4


class Keyboard:
    """A context manager. Gives events to `sink` from a thread of its own.

    sink     sink(kind, channel, a, b, value, time_ns) -> bool, like Deck.send
    on_key   takes other keys: a character, "up", "down", "left", "right", or QUIT (q, Esc, the terminal's end)
    channel  of the notes, 0…15.  octave: of the first C (3: the C of 130.8 Hz).  velocity: 1…127
    hold_s   how long a note lasts where nobody says when its key goes up
    input    file descriptor of the terminal
    key_up   whether to ask the terminal for the protocol that tells it

    octave, velocity, sustained say how it stands; `tells_key_up` whether the terminal has told of a key by that protocol.
    """

    def __init__(
        self,
        sink: Sink,
        on_key: Callable[[str], None] | None = None,
        *,
        channel: int = 0,
        octave: int = 3,
        velocity: int = 96,
        hold_s: float = 1.0,
        input: int = 0,
        key_up: bool = True,
    ) -> None:
        self.octave = octave
        self.velocity = velocity
        self.sustained = False
        self.tells_key_up = False
        self._sink, self._on_key = sink, on_key
        self._channel, self._hold_s = channel, hold_s
        self._input = input
        self._ask = key_up
        self._down: dict[str, tuple[int, float]] = {}  # key → note, time at which it ends
        self._last: dict[str, float] = {}
        self._text = ""
        self._text_at = 0.0
        self._decoder = codecs.getincrementaldecoder("utf-8")("ignore")
        self._ended = False
        self._terminal: Any = None
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    @staticmethod
    def available(input: int = 0) -> bool:
        """Whether there is a terminal to play on, and this program is in its foreground."""
        try:
            if not os.isatty(input):
                return False
        except OSError:
            return False
        if sys.platform == "win32":
            return True
        try:
            return os.tcgetpgrp(input) == os.getpgrp()
        except OSError:
            return True  # a terminal, but not the one that controls this program

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def open(self) -> None:
        """Takes the terminal and begins to listen. Raises ValueError where there is none."""
        if self._thread is not None:
            return
        if not self.available(self._input):
            raise ValueError("the computer keyboard plays in a terminal, in the foreground; run it there or connect MIDI")
        self._terminal = _Console() if sys.platform == "win32" else _Terminal(self._input, self._ask)
        # Whatever ends the program, the terminal is to be as it was.
        atexit.register(self.close)
        self._ended = False
        self._end.clear()
        self._thread = threading.Thread(target=self._listen, name="keyboard", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Lets go of the notes and gives the terminal back as it was. May be called again, also by `on_key`."""
        self._end.set()
        thread, self._thread = self._thread, None
        if thread is not None and thread is not threading.current_thread():
            thread.join()
        terminal, self._terminal = self._terminal, None
        if terminal is not None:
            terminal.restore()
            atexit.unregister(self.close)
        self._let_go()

    def _listen(self) -> None:
        terminal = self._terminal
        try:
            while not self._end.is_set() and not self._ended:
                data = terminal.read(_LOOK_EVERY_S if not self._text else ESCAPE_S / 2)
                now = time.monotonic()
                if data is None:
                    self._ended = True
                    self._tell(QUIT)
                else:
                    self.feed(data, now)
                    self.expire(now)
        except BaseException:
            terminal.restore()
            raise

    def feed(self, data: bytes, now: float) -> None:
        """Plays what the terminal sent at a time [s]."""
        text = self._decoder.decode(data)
        if text:
            self._text += text
            self._text_at = now
        while self._text:
            if self._text[0] != "\x1b":
                key, self._text = self._text[0], self._text[1:]
                self._press(key, now)
                continue
            found = _SEQUENCE.match(self._text)
            if found is not None:
                self._text = self._text[found.end() :]
                self._sequence(found, now)
            elif _INCOMPLETE.match(self._text) and now - self._text_at < ESCAPE_S:
                return  # more may follow
            else:
                self._text = self._text[1:]
                self._press("\x1b", now)

    def _sequence(self, found: re.Match[str], now: float) -> None:
        end = found["end"] or found["ss3"]
        fields = [[int(number or 0) for number in field.split(":")] for field in _fields(found["digits"])]
        modifiers, happens = (*fields[1], 0, 0)[:2] if len(fields) > 1 else (0, 0)
        # Counted from 1; Caps Lock and Num Lock (64, 128) change no key.
        modifiers = max(modifiers - 1, 0) & 63
        if end in _ARROWS:
            if happens != _RELEASE:
                self._tell(_ARROWS[end])
        elif end == "u" and fields:
            self.tells_key_up = True
            key = _character(fields[0][1] if modifiers & 1 and len(fields[0]) > 1 and fields[0][1] else fields[0][0])
            if modifiers & _CONTROL_MODIFIER:
                # The terminal makes no signals of these any more.
                if key == "c" and happens != _RELEASE:
                    os.kill(os.getpid(), signal.SIGINT)
            elif modifiers & 1 and key == "1":
                if happens != _RELEASE:
                    self._press("!", now)
            elif happens == _RELEASE:
                self._release(key.lower(), now)
            elif happens != _REPEAT and key:
                self._press(key, now)

    def _press(self, key: str, now: float) -> None:
        key = key.lower()
        repeats = not self.tells_key_up and now - self._last.get(key, -1.0) < REPEAT_S
        if key in PIANO:
            self._last[key] = now
            if repeats and key in self._down:
                self._down[key] = (self._down[key][0], now + self._hold_s)
            else:
                self._strike(key, now)
        elif key in "zx":
            self.octave = min(max(self.octave + (1 if key == "x" else -1), -1), HIGHEST_OCTAVE)
        elif key in "cv":
            self.velocity = min(max(self.velocity + (VELOCITY_STEP if key == "v" else -VELOCITY_STEP), 1), 127)
        elif key == " ":
            self._last[key] = now
            if not repeats:
                self.sustained = not self.sustained
                self._send(CONTROL, SUSTAIN, 127 * self.sustained)
        elif key in _PANIC_KEYS:
            self.panic()
        elif key in ("q", "\x1b", "\x04"):
            self._tell(QUIT)
        else:
            self._tell(key)

    def _strike(self, key: str, now: float) -> None:
        self._release(key, now)
        note = 12 * (self.octave + 1) + PIANO.index(key)
        if 0 <= note < 128:
            self._send(NOTE_ON, note, self.velocity)
            self._down[key] = (note, now + self._hold_s)

    def _release(self, key: str, now: float) -> None:
        if key in self._down:
            note, _ = self._down.pop(key)
            self._send(NOTE_OFF, note, 64)

    def expire(self, now: float) -> None:
        """Ends the notes whose time is over, where keys do not say it, and takes an Escape for what it is."""
        if self._text:
            self.feed(b"", now)
        if not self.tells_key_up:
            for key in [key for key, (_, until) in self._down.items() if now >= until]:
                self._release(key, now)

    def panic(self) -> None:
        """Silence on all channels."""
        self._down.clear()
        self.sustained = False
        for channel in range(16):
            for controller in (ALL_SOUND_OFF, ALL_NOTES_OFF, RESET_CONTROLLERS):
                self._sink(CONTROL, channel, controller, 0, 0.0, time.monotonic_ns())

    def _let_go(self) -> None:
        for key in list(self._down):
            self._release(key, 0.0)
        if self.sustained:
            self.sustained = False
            self._send(CONTROL, SUSTAIN, 0)

    def _send(self, kind: int, a: int, b: int) -> None:
        self._sink(kind, self._channel, a, b, 0.0, time.monotonic_ns())

    def _tell(self, key: str) -> None:
        if self._on_key is not None:
            self._on_key(key)


def _fields(digits: str | None) -> list[str]:
    return digits.split(";") if digits and digits[0].isdigit() else []


def _character(code: int) -> str:
    """A key's character; none for the keys that kitty has numbers of its own for (0xE000…0xF8FF: modifiers and the like)."""
    return chr(code) if 0 < code < 0xD800 or 0xF900 <= code < 0x110000 else ""


class _Terminal:
    """A terminal that gives keys one by one and does not show them, until it is restored."""

    def __init__(self, input: int, ask_for_key_up: bool) -> None:
        import termios

        self._termios = termios
        self._input = input
        self._before = termios.tcgetattr(input)
        self._asked = ask_for_key_up and os.environ.get("TERM", "") not in ("", "dumb", "linux")
        mode = termios.tcgetattr(input)
        mode[3] &= ~(termios.ECHO | termios.ICANON)
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
        termios.tcsetattr(input, termios.TCSADRAIN, mode)
        if self._asked:
            self._write(_ASK_FOR_KEY_UP)

    def _write(self, data: bytes) -> None:
        # Not through standard output, which may be a file.
        with suppress(OSError):
            output = os.open(os.ttyname(self._input), os.O_WRONLY | os.O_NOCTTY)
            try:
                os.write(output, data)
            finally:
                os.close(output)

    def read(self, timeout_s: float) -> bytes | None:
        """What was typed, nothing after `timeout_s`; None if the terminal is gone."""
        try:
            if not select.select([self._input], [], [], timeout_s)[0]:
                return b""
            return os.read(self._input, 4096) or None
        except InterruptedError:
            return b""
        except (OSError, ValueError):
            return None

    def restore(self) -> None:
        if self._asked:
            self._write(_NO_MORE_KEY_UP)
            self._asked = False
        # What was typed last is not for the shell.
        with suppress(OSError, self._termios.error):
            self._termios.tcsetattr(self._input, self._termios.TCSAFLUSH, self._before)


class _Console:
    """Keys of a Windows console, which gives them one by one and unseen to who asks so."""

    def read(self, timeout_s: float) -> bytes | None:
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
            os.kill(os.getpid(), signal.SIGINT)
            return b""
        return key.encode("utf-8", "ignore")

    def restore(self) -> None:
        pass
