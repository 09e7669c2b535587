"""An engine that keeps a tape of its one string: the modes every few steps and the force at every point in every step.
A second direction, which touches nothing, is heard and not taped.

The engine calls its strings' steps by address (`engine.tasks.entries`). An observer in that place (`Engine.observe`) has the
same steps made `BLOCK` at a time and looks at the string in between. Blocks are cut where the engine's kernels
cut them, so what sounds is what sounds without a tape (rests of less than a block, where a finger lets go, go step by step).
Strings do not fly and modes do not rest here, as at the quality `fine`: on the tape there is one string at one rate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from synth.engine.core import CORE_WORDS, bank_of, expression_of, hand_of, scratch_of, string_of
from synth.engine.engine import Engine
from synth.engine.layout import NO_FINGER, QUANTUM, SPAN, STEP
from synth.instrument.compile import Position
from synth.instrument.place import NotePlace
from synth.midi.events import NOTE_ON, make_events
from synth.midi.eventsource import from_events
from synth.native.arrays import allocate, f8, i8
from synth.native.views import call_back, opener
from synth.solver.block_rows import BLOCK

#: what a tape is of unless told otherwise, as `synth render` and a live stream are [Hz]
QUALITY = "standard"
RATE_HZ = 44100.0
#: frames that are computed between two looks at the tape
PIECE = 4096
#: places in `Tape.written`: steps and shots since it was last read
STEPS, SHOTS = range(2)
#: shots beside those of whole blocks that a piece may have, for rests of blocks
MORE_SHOTS = 256


class Tape(NamedTuple):
    """What stands behind the engine's own arrays in its core table."""

    written: Annotated[np.ndarray, i8("2")]
    force: Annotated[np.ndarray, f8("steps, contacts")]  # [N]
    ends: Annotated[np.ndarray, i8("shots")]  # steps made before each shot, since the tape was last read
    q: Annotated[np.ndarray, f8("shots, cap")]  # coordinates of the modes
    v: Annotated[np.ndarray, f8("shots, cap")]  # …and their speeds
    finger: Annotated[np.ndarray, f8("shots")]  # height to which the finger holds the string [m], nan without one
    bend: Annotated[np.ndarray, f8("shots")]  # semitones in the coefficients of the steps before each shot
    hand: Annotated[np.ndarray, f8("shots")]  # …and the damping hand's σ [1/s]
    out: Annotated[np.ndarray, f8("2*span_steps")]  # outputs of the steps that are being made
    step: int  # address of the engine's own function


tape_of = opener(Tape, CORE_WORDS)


def taped_steps(core: int, thread: int, s: int, steps: int) -> None:
    bank, scratch, tape = bank_of(core), scratch_of(thread), tape_of(core)
    hand, expression = hand_of(core, s), expression_of(core, s)
    fixed = bank.strings[s]
    if fixed.of_first:
        call_back(tape.step, core, thread, s, steps)
        return
    points = bank.parts[fixed.part].use_q + bank.parts[fixed.part].use_v
    model = bank.models[hand.model]
    contacts = model.contacts
    string = string_of(core, s)
    at = 0
    while at < steps:
        count = BLOCK if steps - at >= BLOCK else 1
        fingered = hand.phase != NO_FINGER
        call_back(tape.step, core, thread, s, count)
        for p in range(points):
            for t in range(count):
                tape.out[p * steps + at + t] = scratch.out[p * count + t]
        at += count
        made, shot = tape.written[STEPS], tape.written[SHOTS]
        if made + count > tape.force.shape[0] or shot >= tape.ends.size:
            continue
        for t in range(count):
            for k in range(contacts):
                tape.force[made + t, k] = scratch.record[t * contacts + k]
        for j in range(model.n):
            tape.q[shot, j] = string.q[j]
            tape.v[shot, j] = string.v[j]
        tape.finger[shot] = scratch.path[count] if fingered else np.nan
        tape.bend[shot] = expression.bend
        tape.hand[shot] = expression.hand
        tape.ends[shot] = made + count
        tape.written[STEPS] = made + count
        tape.written[SHOTS] = shot + 1
    for i in range(points * steps):
        scratch.out[i] = tape.out[i]


@dataclass(frozen=True)
class TapePiece:
    """What the tape holds of some steps. K steps, M shots, C contacts, N modes; views that the next piece overwrites."""

    first: int  # steps before it since the note began
    force: np.ndarray  # (K, C) [N]
    ends: np.ndarray  # (M,) steps since the note began
    q: np.ndarray  # (M, N)
    v: np.ndarray  # (M, N)
    finger: np.ndarray  # (M,) [m], nan without a finger
    bend: np.ndarray  # (M,) semitones by which the string was bent in the steps since the shot before
    hand: np.ndarray  # (M,) σ that the damping hand added in them [1/s]
    both: np.ndarray  # (frames, 2), late by the engine's latency

    @property
    def out(self) -> np.ndarray:
        """(frames,) left channel."""
        return self.both[:, 0]


class Taped(Engine):
    """An engine with the one string of a place, its ends at rest."""

    def __init__(
        self, place: NotePlace, quality: str = QUALITY, rate_hz: float = RATE_HZ, *, precision: str | None = None
    ) -> None:
        super().__init__(
            [place.preset.on_rigid_ends],
            quality=quality,
            limiter=False,
            economy=False,
            precision=precision,
            only_notes=[{place.note}],
            every_fret=False,
        )
        self.place = place
        self.prepare(rate_hz, PIECE)

    def prepare(self, rate_hz: float, max_block: int = PIECE, progress: Callable[[int, int], None] | None = None) -> None:
        """As the engine's, and the tape begins."""
        super().prepare(rate_hz, max_block, progress)
        string = self.compiled[0].strings[0]
        steps = (max_block + SPAN * QUANTUM) * string.factor
        shots = steps // BLOCK + MORE_SHOTS
        contacts = max(position.eta.size for position in string.positions)
        modes = max(position.omega.size for position in string.positions)
        sizes = {"steps": steps, "contacts": max(1, contacts), "shots": shots, "cap": modes}
        sizes |= {"span_steps": SPAN * QUANTUM * string.factor}
        self.tape = self.observe(STEP, taped_steps, lambda step: allocate(Tape, sizes, step=step))

    @property
    def position(self) -> Position:
        """The model of the note's place."""
        return next(p for p in self.compiled[0].strings[0].positions if p.fret == self.place.fret)

    @property
    def step_s(self) -> float:
        return 1.0 / self.position.plan.rate_hz

    def play(self, velocity: int, seconds: float) -> Iterator[TapePiece]:
        """The note, held, from the touch of the finger until `seconds` later, in pieces."""
        self.reset()
        yield from self.pieces(make_events([(0, NOTE_ON, 0, self.place.note, velocity)]), round(seconds * self.rate_hz))

    def pieces(self, events: np.ndarray, frames: int) -> Iterator[TapePiece]:
        """So many frames of sound from the first event on, of an engine that has been reset. events: EVENT array; the first
        wakes the string."""
        position = self.position
        modes, contacts = position.omega.size, position.eta.size
        source = from_events(events)
        made = at = 0
        left = frames + self.latency_samples
        while left > 0:
            out = np.zeros((min(left, PIECE), 2))
            self.tape.written[:] = 0
            due = source(at + len(out))
            due["frame"] -= at
            self.process(due, out)
            steps, shots = (int(count) for count in self.tape.written)
            tape = self.tape
            yield TapePiece(
                made,
                tape.force[:steps, :contacts],
                made + tape.ends[:shots],
                tape.q[:shots, :modes],
                tape.v[:shots, :modes],
                tape.finger[:shots],
                tape.bend[:shots],
                tape.hand[:shots],
                out,
            )
            made += steps
            at += len(out)
            left -= len(out)
