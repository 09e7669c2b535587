"""The voice policy with strings that are a table, and a responder that writes down what it is asked."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from synth.engine import layout
from synth.engine.voices import policy
from synth.engine.voices.channels import power_up
from synth.engine.voices.voice_table import CUT, GO_ON, LET_GO, PLUCK, SLUR, Voices
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON
from synth.native.arrays import allocate
from synth.native.views import table

NAMES = {GO_ON: "go on", PLUCK: "pluck", SLUR: "slur", CUT: "cut", LET_GO: "let go"}
_RESPONDER = ctypes.CFUNCTYPE(None, *[ctypes.c_int64] * 5)


class Fake:
    """Parts of strings; a string is the notes of its positions, from the open one on. Part p plays on channel p, a single
    one on all. Every part has the articulations, fields of ARTICULATION, and `meend`; there are 1000 frames in a second.

    asked: (action, string or position, velocity) of everything but GO_ON.  went_on: the strings of these.
    """

    def __init__(
        self,
        *parts: Sequence[Sequence[int]],
        polyphony: int = 24,
        bindings: Sequence[tuple[int, int, int, float, float]] = (),
        articulations: Sequence[Mapping[str, float]] = ({},),
        meend: float = 0.0,
        decide: Callable[[int], None] = policy.decide,
    ) -> None:
        positions = [
            (p, s, note, fret)
            for s, (p, string) in enumerate((p, string) for p, part in enumerate(parts) for string in part)
            for fret, note in enumerate(string)
        ]
        sizes = {
            "strings": sum(map(len, parts)),
            "positions": len(positions),
            "parts": len(parts),
            "bindings": len(bindings),
            "articulations": sum(len(articulations) for _ in parts),
            "N_PARAMETERS": layout.N_PARAMETERS,
            "N_COUNTERS": layout.N_COUNTERS,
            "N_METERS": layout.N_METERS,
        }
        self._respond = _RESPONDER(self._do)  # kept: the table holds its address
        address = ctypes.cast(self._respond, ctypes.c_void_p).value
        me = self.me = allocate(Voices, sizes, polyphony=polyphony, rate_hz=1000.0, respond=address, core=0, thread=0)
        self.state = allocate(layout.State, sizes)
        for k, (p, s, note, fret) in enumerate(positions):
            me.positions[k] = (p, s, note, fret, k, 0)
            me.strings["part"][s] = p
            me.strings["positions"][s] += 1
        me.parts["first_position"] = np.searchsorted(me.positions["part"], np.arange(len(parts)))
        me.parts["end_position"] = np.searchsorted(me.positions["part"], np.arange(len(parts)), "right")
        me.parts["first_articulation"] = np.arange(len(parts)) * len(articulations)
        me.parts["end_articulation"] = me.parts["first_articulation"] + len(articulations)
        me.parts["meend"] = meend
        me.parts["choirs"] = 1
        me.strings["choir"] = 1
        for number, way in enumerate(me.articulations):
            mine = number % len(articulations)
            given = {"key": -1, "controller": -1, "soft": 1 if mine == 0 else 128, "hard": 127 if mine == 0 else 128}
            for field, value in {**given, **articulations[mine]}.items():
                way[field] = value
        me.voices["articulation"] = me.parts["first_articulation"][me.strings["part"]]
        me.hands["glide_to"] = -1
        me.program_map[:] = 0 if len(parts) == 1 else np.minimum(np.arange(16), len(parts))[:, None]
        me.program_map[me.program_map == len(parts)] = -1
        me.plays[:] = [[(row == p).any() for p in range(len(parts))] for row in me.program_map]
        me.pitch[:] = np.arange(128)
        rows = sorted(bindings)
        for i, (_, p, index, low, high) in enumerate(rows):
            me.bindings[i] = (p, index, layout.PARAMETER_CURVES[index], low, high)
        me.bound[:] = np.searchsorted([row[0] for row in rows], np.arange(129))
        power_up(self.state.channels)
        self._table = table(me, self.state)
        self._policy = policy.entry(decide)
        self.asked: list[tuple[str, int, int]] = []
        self.went_on: list[int] = []

    def _do(self, core: int, thread: int, action: int, place: int, velocity: int) -> None:
        if action == GO_ON:
            self.went_on.append(place)
            return
        self.asked.append((NAMES[action], place, velocity))
        if action in (PLUCK, SLUR):
            s = self.me.positions["string"][place]
            self.me.voices["awake"][s], self.me.voices["level"][s] = 1, 1.0
            self.me.hands["model"][s] = place

    @property
    def address(self) -> int:
        """What the policy takes as `voices`."""
        return self._table.ctypes.data

    def send(self, kind: int, channel: int, a: int, b: int = 0, value: float = 0.0) -> list[tuple[str, int, int]]:
        """Let the policy decide about an event; what was asked, but for GO_ON."""
        before = len(self.asked)
        self.state.event[0] = (0, kind, channel, a, b, value)
        self._policy.ctypes(self.address)
        return self.asked[before:]

    def on(self, note: int, channel: int = 0, velocity: int = 100) -> list[tuple[str, int, int]]:
        return self.send(NOTE_ON, channel, note, velocity)

    def off(self, note: int, channel: int = 0) -> list[tuple[str, int, int]]:
        return self.send(NOTE_OFF, channel, note)

    def control(self, controller: int, value: int, channel: int = 0) -> list[tuple[str, int, int]]:
        return self.send(CONTROL, channel, controller, value)

    def place(self, k: int) -> tuple[int, int]:
        """String and fret of a position."""
        return int(self.me.positions["string"][k]), int(self.me.positions["fret"][k])

    def plucked(self, note: int, channel: int = 0) -> tuple[int, int]:
        """Send a note-on: string and fret of the one pluck that it asks for."""
        (where,) = [place for action, place, _ in self.on(note, channel) if action == "pluck"]
        return self.place(where)

    def strings(self, field: str) -> list[float]:
        return self.me.voices[field].tolist()

    def count(self, counter: int) -> int:
        return int(self.state.counters[counter])
