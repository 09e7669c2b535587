"""An engine that keeps a tape of an instrument whose strings share a bridge: its state after frames of the output rate.

As `string_tape` has it for a single string: an observer stands in the place of `together.work_together`, and has the
same frames made in stretches that end where the tape wants to look. A frame is computed by itself where a stretch is shorter
than a block of the kernels, which rounds otherwise; nothing else differs from what sounds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from synth.engine.core import CORE_WORDS, bank_of, hand_of, motion_of, progress_of, scratch_of, shared_of, string_of
from synth.engine.engine import Engine
from synth.engine.layout import BEGIN, FIRST_QUANTUM, NO_FINGER, QUANTUM, STRETCH, TASK, TOGETHER, UNTIL, WHOLE
from synth.engine.pressed_flight import standing_motion
from synth.host.string_tape import QUALITY, RATE_HZ
from synth.instrument.compile import CompiledString, Position, second_direction
from synth.instrument.place import NotePlace, shapes_at, speaking
from synth.instrument.preset import Preset
from synth.instrument.soundboard import Soundboard
from synth.midi.events import EVENT, NOTE_ON, make_events
from synth.native.arrays import allocate, f8, i8
from synth.native.views import call_back, opener
from synth.physics.modes import ramp_moments
from synth.solver.coupling import APART_MODES, coupling_at, end_at

#: places in FramesTape.wanted: the first frame that is looked at, how many lie between two looks, how many at most between
#: two looks at the forces, the line whose contacts are taped
FIRST, EVERY, CUT, PLAYED = range(4)
#: shots that a tape holds
SHOTS = 512


class FramesTape(NamedTuple):
    """What stands behind the engine's own arrays in its core table."""

    written: Annotated[np.ndarray, i8("1")]  # shots since it was last read
    wanted: Annotated[np.ndarray, i8("4")]
    begins: Annotated[np.ndarray, i8("lines + 1")]  # where in q and v each line begins; as long as the next: it is left out
    ends: Annotated[np.ndarray, i8("shots")]  # frames of the stream that were made
    q: Annotated[np.ndarray, f8("shots, modes")]
    v: Annotated[np.ndarray, f8("shots, modes")]
    p: Annotated[np.ndarray, f8("shots, body")]
    p_speed: Annotated[np.ndarray, f8("shots, body")]
    bridge: Annotated[np.ndarray, f8("shots, components")]  # [m]
    speed: Annotated[np.ndarray, f8("shots, components")]  # of the frame before [m/s]
    force: Annotated[np.ndarray, f8("shots, contacts")]  # largest since the shot before, of those looked at [N]
    impulse: Annotated[np.ndarray, f8("shots, contacts")]  # [N s]
    finger: Annotated[np.ndarray, f8("shots")]  # height to which it holds the string [m], nan without one
    running: Annotated[np.ndarray, f8("2, contacts")]  # force and impulse since the last shot
    together: int  # address of the engine's own function


frames_tape_of = opener(FramesTape, CORE_WORDS)


def taped_together(core: int, thread: int, i: int, _: int) -> None:
    bank, shared, tape = bank_of(core), shared_of(core), frames_tape_of(core)
    task, wanted = shared.task, tape.wanted
    kind, until = task[TASK], task[UNTIL]
    if kind == BEGIN:
        call_back(tape.together, core, thread, i, 0)
        return
    first, begun = bank.instruments[i].first_string, task[FIRST_QUANTUM] * QUANTUM
    at, end = progress_of(core, first).reached, until
    if kind == WHOLE:  # one quantum: `Frames.play` asks for no more at a time
        task[TASK] = BEGIN
        call_back(tape.together, core, thread, i, 0)
        at, end = 0, QUANTUM
    task[TASK] = STRETCH
    coupling, s = coupling_at(shared.coupling_at[i]), first + wanted[PLAYED]
    while at < end:
        # on to the next look: at the state, or at the forces on the way there
        now = begun + at
        ahead = wanted[FIRST] - now
        if ahead <= 0:
            ahead = wanted[EVERY] - (now - wanted[FIRST]) % wanted[EVERY]
        count = min(end - at, ahead if now < wanted[FIRST] - wanted[EVERY] else min(wanted[CUT], ahead))
        fingered = hand_of(core, s).phase != NO_FINGER
        progress_of(core, first).reached = at
        task[UNTIL] = at + count
        call_back(tape.together, core, thread, i, 0)
        at += count
        played, line_end = string_of(core, s), end_at(shared.end_at[s])
        contacts = bank.models[hand_of(core, s).model].contacts
        if motion_of(core, s).flying:  # its force is not that of its last step
            standing_motion(core, s, scratch_of(thread).modes.q, scratch_of(thread).modes.v)
        for k in range(contacts):
            tape.running[0, k] = max(tape.running[0, k], played.force[k])
            tape.running[1, k] += played.force[k] * count * coupling.frame
        now += count
        shot = tape.written[0]
        if now < wanted[FIRST] or (now - wanted[FIRST]) % wanted[EVERY] != 0 or shot >= tape.ends.size:
            continue
        for line in range(tape.begins.size - 1):
            place, room = tape.begins[line], tape.begins[line + 1] - tape.begins[line]
            string, model = string_of(core, first + line), bank.models[hand_of(core, first + line).model]
            q, v = tape.q[shot, place : place + room], tape.v[shot, place : place + room]
            if room > 0 and motion_of(core, first + line).flying:
                standing_motion(core, first + line, q, v)
                continue
            for j in range(room):
                q[j] = string.q[j] if j < model.n else 0.0
                v[j] = string.v[j] if j < model.n else 0.0
        for j in range(tape.p.shape[1]):
            tape.p[shot, j] = coupling.body.motion.p[j]
            tape.p_speed[shot, j] = coupling.body.motion.speed[j]
        for j in range(tape.bridge.shape[1]):
            tape.bridge[shot, j] = coupling.bridge.beta[j]
            tape.speed[shot, j] = coupling.bridge.speed[j]
        for k in range(tape.running.shape[1]):
            tape.force[shot, k] = tape.running[0, k]
            tape.impulse[shot, k] = tape.running[1, k]
            tape.running[0, k] = tape.running[1, k] = 0.0
        tape.finger[shot] = line_end.path[count * bank.strings[s].factor] if fingered else np.nan
        tape.ends[shot] = now
        tape.written[0] = shot + 1
    for k in range(first, bank.instruments[i].end_string):
        progress_of(core, k).reached = end
    task[TASK], task[UNTIL] = kind, until


@dataclass(frozen=True)
class Shots:
    """What the tape has of some frames: S shots, modes of the lines one after the other, M of the body, D components of the
    bridge's motion that strings tell apart, C contacts; copies."""

    ends: np.ndarray  # (S,) frames since the note began
    q: np.ndarray  # (S, modes)
    v: np.ndarray  # (S, modes) ẇ
    p: np.ndarray  # (S, M) motions of the body's modes [m], by their shapes as the engine has them
    p_speed: np.ndarray  # (S, M)
    bridge: np.ndarray  # (S, D) β, in the engine's components
    speed: np.ndarray  # (S, D) [m/s]
    force: np.ndarray  # (S, C) [N]
    impulse: np.ndarray  # (S, C) [N s]
    finger: np.ndarray  # (S,) [m], nan without a finger
    out: np.ndarray  # (frames, 2) since the piece before


class Frames(Engine):
    """An engine with all strings of a coupled preset, of which one is to be played at a place.

    lines    whose modes are taped; None: all. `line` is that of the string that is played, in its first direction
    """

    def __init__(
        self,
        preset: Preset,
        place: NotePlace,
        quality: str = QUALITY,
        rate_hz: float = RATE_HZ,
        *,
        lines: tuple[int, ...] | None = None,
        economy: bool | None = None,
        internal_rate_hz: float | None = None,
    ) -> None:
        super().__init__(
            [preset],
            quality=quality,
            internal_rate_hz=internal_rate_hz,
            precision="float64",  # frame by frame, as it is taped, nothing is float32
            limiter=False,
            economy=economy,
            only_notes=[{place.note}],
            every_fret=False,
        )
        self.place = place
        self._lines = lines
        self.prepare(rate_hz, QUANTUM)

    def prepare(self, rate_hz: float, max_block: int = QUANTUM, progress: Callable[[int, int], None] | None = None) -> None:
        """As the engine's, and the tape begins."""
        super().prepare(rate_hz, max_block, progress)
        directions, bank = self.directions, self.memory.built.bank
        self.number = string_number(self.compiled[0].preset, self.place)
        self.line = directions * self.number
        lines = range(directions * len(self.strings)) if self._lines is None else self._lines
        sizes = [max(p.omega.size for p in self.strings[line // directions].positions) for line in range(bank.strings.size)]
        rooms = [size if line in lines else 0 for line, size in enumerate(sizes)]
        contacts = max(1, max(position.eta.size for position in self.strings[self.number].positions))
        extents = {"lines": len(rooms), "shots": SHOTS, "modes": sum(rooms), "contacts": contacts}
        extents |= {"body": self.body.omega.size, "components": self.body.shape.shape[0]}
        self._begins = np.concatenate([[0], np.cumsum(rooms)]).astype(np.int64)
        begins = self._begins.copy()
        self.tape = self.observe(
            TOGETHER, taped_together, lambda own: allocate(FramesTape, extents, begins=begins, together=own)
        )

    @property
    def strings(self) -> tuple[CompiledString, ...]:
        return self.compiled[0].strings

    @property
    def body(self) -> Soundboard:
        body = self.compiled[0].body
        assert body is not None
        return body

    @property
    def directions(self) -> int:
        """Lines of each string."""
        return 1 if self.compiled[0].preset.polarisation is None else 2

    def position(self, line: int) -> Position:
        """The model that a line has once the note is played."""
        string = self.strings[line // self.directions]
        if line % self.directions:
            string = second_direction(self.compiled[0].preset, string)
        fret = self.place.fret if line // self.directions == self.number else 0
        return next(position for position in string.positions if position.fret == fret)

    @property
    def moving_modes(self) -> list[int]:
        """Of each line, the modes that move while its contacts are not looked at; those above them rest."""
        return [int(end.counts[APART_MODES]) for end in self.memory.strings.bridges.ends.items]

    def modes_of(self, line: int, array: np.ndarray) -> np.ndarray:
        """The columns of a line in `Shots.q` or `Shots.v`, of the model that it has once the note is played."""
        begin = int(self._begins[line])
        return array[:, begin : begin + self.position(line).omega.size]

    def displacement(self, shots: Shots, x: np.ndarray) -> np.ndarray:
        """(S, M) of the string that is played, in its first direction, x (M,) from the nut's end of what speaks [m]: with
        its end on the bridge."""
        position = self.position(self.line)
        share = np.outer(shots.bridge @ self.body.direction[self.line], x / position.length_m)
        shapes = shapes_at(speaking(self.place), position, x)
        return np.asarray(self.modes_of(self.line, shots.q) @ shapes.T + share)

    def energy_j(self, line: int, shots: Shots) -> np.ndarray:
        """(S,) ½μ Σ (ẏ² + ω²w²) of a taped line, of its own modes, w from the state at rest [J]."""
        position, n = self.position(line), self.position(line).own
        w = self.modes_of(line, shots.q)[:, :n] - position.q_rest[:n]
        end_speed = shots.speed @ self.body.direction[line]
        y = self.modes_of(line, shots.v)[:, :n] + ramp_moments(position.length_m, n) * end_speed[:, None]
        return np.asarray(0.5 * position.mu * ((y**2).sum(axis=1) + ((position.omega[:n] * w) ** 2).sum(axis=1)))

    def play(
        self, velocity: int, first: int, every: int, count: int, cut: int = 1, *, modes: bool = True
    ) -> Iterator[Shots]:
        """The note, held, from the touch of the finger on: states after frame `first` and every so many frames more, so
        many. Forces are looked at every `cut` frames from a look before the first on; not `modes`, those of the lines are
        left out."""
        self.reset()
        self.tape.wanted[:] = first, every, cut, self.line
        self.tape.running[:] = 0.0
        self.tape.begins[:] = self._begins if modes else 0
        self.tape.written[0] = 0
        note = make_events([(0, NOTE_ON, 0, self.place.note, velocity)])
        left, room = count, np.zeros((QUANTUM, 2))
        heard: list[np.ndarray] = []
        last = first + (count - 1) * every + self.latency_samples
        for begun in range(0, last + QUANTUM, QUANTUM):
            self.process(note, room)
            note = np.zeros(0, EVENT)
            heard.append(room.copy())
            full = int(self.tape.written[0]) > SHOTS - QUANTUM
            if full or begun + QUANTUM >= last + QUANTUM:
                shots = min(left, int(self.tape.written[0]))
                self.tape.written[0] = 0
                left -= shots
                held = 0 if not modes else shots
                rows = {"q": held, "v": held}
                names = [name for name in Shots.__dataclass_fields__ if name != "out"]
                taken = [getattr(self.tape, name)[: rows.get(name, shots)].copy() for name in names]
                yield Shots(**dict(zip(names, taken, strict=True)), out=np.concatenate(heard))
                heard = []


def string_number(preset: Preset, place: NotePlace) -> int:
    """Which of the engine's strings plays a place."""
    before = sum(table.notes[1] - table.notes[0] + 1 for table in preset.string[: place.index])
    return before + place.opened - preset.string[place.index].notes[0]


def line_of(preset: Preset, place: NotePlace) -> int:
    """The engine's line of the string that plays a place, in its first direction."""
    return string_number(preset, place) * (1 if preset.polarisation is None else 2)


def joined(pieces: list[Shots]) -> Shots:
    """All shots of a note as one."""
    return Shots(*(np.concatenate([getattr(each, name) for each in pieces]) for name in Shots.__dataclass_fields__))
