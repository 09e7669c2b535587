"""The computer's keyboard as an instrument, in a terminal: for whoever has no other at hand.

A terminal says which key went down, not that it went up: there a note ends `hold_s` after it was struck, and while a key
repeats itself it is held. (Strings that ring on are none the worse for it.) Terminals with kitty's keyboard protocol
(kitty, foot, WezTerm, Ghostty, recent Konsole and iTerm2) tell both, and a note lasts as long as its key is down.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Self

from synth.live import terminal
from synth.live.keycodes import ESCAPE_S, PRESSED, RELEASED, REPEATED, Key, KeyDecoder
from synth.live.keylist import ALWAYS, Binding, KeyList
from synth.midi.controllers import SUSTAIN
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON
from synth.midi.stream import Sink

#: the keys of a piano from C on, two rows of letters
PIANO = "awsedftgyhujkolp;'"
QUIT = "quit"
VELOCITY_STEP = 12
HIGHEST_OCTAVE = 9
# The same key again within this time is the keyboard's own repetition.
REPEAT_S = 0.1
_LOOK_EVERY_S = 0.05
#: what the keys do; those that no note needs go to `on_key`
BINDINGS = (
    Binding("note", tuple(PIANO), " ".join(PIANO), "play from C on"),
    Binding("octave", ("z", "x"), "z x", "octave"),
    Binding("velocity", ("c", "v"), "c v", "velocity"),
    Binding("sustain", (" ",), "space", "sustain"),
    Binding("silence", ("\x7f", "\x08", "!"), "backspace !", "silence"),
)
_KEYS = KeyList(*BINDINGS, *ALWAYS)
_NAMED = ("up", "down", "left", "right", "home")


class Keyboard:
    """A context manager. Gives events to `sink` from a thread of its own.

    sink     sink(kind, channel, a, b, value, time_ns) -> bool, like Deck.send
    panic    silences everything, like Deck.panic
    on_key   takes other keys: a character, "up", "down", "left", "right", "home", or QUIT (q, Esc, Ctrl-D, or there is no
             terminal any more)
    channel  of the notes, 0…15.  octave: of the first C (3: the C of 130.8 Hz).  velocity: 1…127
    hold_s   how long a note lasts where nobody says when its key goes up
    input    file descriptor of the terminal
    key_up   whether to ask the terminal for the protocol that tells it

    octave, velocity, sustained say how it stands; `tells_key_up` whether the terminal has told of a key by that protocol.
    """

    def __init__(
        self,
        sink: Sink,
        panic: Callable[[], None],
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
        self._sink, self._panic, self._on_key = sink, panic, on_key
        self._channel, self._hold_s = channel, hold_s
        self._input = input
        self._ask = key_up
        self._down: dict[str, tuple[int, float]] = {}  # key → note, time at which it ends
        self._last: dict[str, float] = {}
        self._decoder = KeyDecoder()
        self._ended = False
        self._terminal: terminal.KeySource | None = None
        self._end = threading.Event()
        self._thread: threading.Thread | None = None

    @staticmethod
    def available(input: int = 0) -> bool:
        """Whether there is a terminal to play on, and this program is in its foreground."""
        return terminal.available(input)

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def open(self) -> None:
        """Takes the terminal and begins to listen. Raises ValueError where there is none."""
        if self._thread is not None:
            return
        source = terminal.terminal_at(self._input, key_up=self._ask)
        source.open()
        if not source.is_one:
            source.close()
            raise ValueError("the computer keyboard plays in a terminal, in the foreground; run it there or connect MIDI")
        self._terminal = source
        self._ended = False
        self._end.clear()
        self._thread = threading.Thread(target=self._listen, args=(source,), name="keyboard", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Lets go of the notes and gives the terminal back as it was. May be called again, also by `on_key`."""
        self._end.set()
        thread, self._thread = self._thread, None
        if thread is not None and thread is not threading.current_thread():
            thread.join()
        source, self._terminal = self._terminal, None
        if source is not None:
            source.close()
        self._let_go()

    def _listen(self, source: terminal.KeySource) -> None:
        try:
            times = source.times_taken
            while not self._end.is_set() and not self._ended:
                data = source.read(_LOOK_EVERY_S if not self._decoder.waits else ESCAPE_S / 2)
                now = time.monotonic()
                if data is None:
                    self._ended = True
                    self._tell(QUIT)
                    continue
                if source.times_taken != times:  # another had the terminal: nobody has told of keys that went up
                    times = source.times_taken
                    self._release_all()
                self.feed(data, now)
                self.expire(now)
        except BaseException:
            source.close()
            raise

    def feed(self, data: bytes, now: float) -> None:
        """Plays what the terminal sent at a time [s]."""
        for key in self._decoder.feed(data, now):
            self.tells_key_up |= key.told
            self._key(key, now)

    def _key(self, key: Key, now: float) -> None:
        if key.name in _NAMED:
            if key.happens != RELEASED:
                self._tell(key.name)
        elif key.happens == RELEASED:
            self._release(key.name.lower())
        elif not key.name or (key.told and key.happens == PRESSED and terminal.signal_as_typed(key.name)):
            pass
        elif key.happens != REPEATED:
            self._press(key.name, now)

    def _press(self, key: str, now: float) -> None:
        key = key.lower()
        repeats = not self.tells_key_up and now - self._last.get(key, -1.0) < REPEAT_S
        match _KEYS.action(key):
            case "note":
                self._last[key] = now
                if repeats and key in self._down:
                    self._down[key] = (self._down[key][0], now + self._hold_s)
                else:
                    self._strike(key, now)
            case "octave":
                self.octave = min(max(self.octave + (1 if key == "x" else -1), -1), HIGHEST_OCTAVE)
            case "velocity":
                self.velocity = min(max(self.velocity + (VELOCITY_STEP if key == "v" else -VELOCITY_STEP), 1), 127)
            case "sustain":
                self._last[key] = now
                if not repeats:
                    self.sustained = not self.sustained
                    self._send(CONTROL, SUSTAIN, 127 * self.sustained)
            case "silence":
                self.panic()
            case "quit":
                self._tell(QUIT)
            case _:
                self._tell(key)

    def _strike(self, key: str, now: float) -> None:
        self._release(key)
        note = 12 * (self.octave + 1) + PIANO.index(key)
        if 0 <= note < 128:
            self._send(NOTE_ON, note, self.velocity)
            self._down[key] = (note, now + self._hold_s)

    def _release(self, key: str) -> None:
        if key in self._down:
            note, _ = self._down.pop(key)
            self._send(NOTE_OFF, note, 64)

    def expire(self, now: float) -> None:
        """Ends the notes whose time is over, where keys do not say it, and takes an Escape for what it is."""
        if self._decoder.waits:
            self.feed(b"", now)
        if not self.tells_key_up:
            for key in [key for key, (_, until) in self._down.items() if now >= until]:
                self._release(key)

    def panic(self) -> None:
        """Silence on all channels."""
        self._down.clear()
        self.sustained = False
        self._panic()

    def _release_all(self) -> None:
        for key in list(self._down):
            self._release(key)

    def _let_go(self) -> None:
        self._release_all()
        if self.sustained:
            self.sustained = False
            self._send(CONTROL, SUSTAIN, 0)

    def _send(self, kind: int, a: int, b: int) -> None:
        self._sink(kind, self._channel, a, b, 0.0, time.monotonic_ns())

    def _tell(self, key: str) -> None:
        if self._on_key is not None:
            self._on_key(key)
