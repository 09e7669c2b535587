"""The strings of a preset as plans are measured of them: their displacement near the saddle, and converged runs of it.

one = OneString(alone)                      # by itself, its ends at rest
one = StringTogether(one, preset)           # among the others, where they share a body
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from synth.dsp.rates import MAXIMUM_FACTOR
from synth.engine.engine import Engine
from synth.fit.plan_measures import distances_measured, judged_of_one
from synth.host.frames_tape import Frames, line_of
from synth.instrument.articulations import NORMAL, Articulation, Hand
from synth.instrument.compile import note_frequency, open_string, string_kind, string_notes
from synth.instrument.coupled_plan import choose_steps
from synth.instrument.fingerprints import UNSTEADY, WAYS, fingerprint, strokes
from synth.instrument.neck import alone
from synth.instrument.place import NotePlace
from synth.instrument.plan import FAR, ROLLING, choose_factor
from synth.instrument.planfile import PROMISED, Measured, MeasuredPlan, MeasuredString
from synth.instrument.preset import Preset, fret_count
from synth.instrument.soundboard import step_count
from synth.midi.events import NOTE_ON, make_events
from synth.physics.modes import modal_frequencies
from synth.physics.string import String
from synth.units import midi_to_note

RATE_HZ = 44100
#: seconds of a note: what is promised of a bridge is promised over 3 s
ROLLING_S, IMPACTS_S = 3.0, 0.5
#: internal steps per period of the reference, where the string rolls, is plucked from afar, takes blows; its most modes
ROLLING_STEPS, FAR_STEPS, IMPACT_STEPS, MOST_MODES = 9000.0, 18000.0, 30000.0, 1000
#: what the half run has of the reference's modes
FEWER = 0.7
#: where strings share a body: frames of the reference in one at `RATE_HZ`, and the string's steps in each; of the half run
FINEST, HALF = (4, 8), (4, 4)
#: internal rates tried, as multiples of `RATE_HZ`
FACTORS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48)
#: output's place from the saddle, as a share of the open length: that of the calibration's scenes
SEEN_AT = 0.01
#: gain of that output [dB]: 10 µm are full scale, as loud as a preset; strings sleep and modes rest by their level in
#: the output, so that without the gain a soft note of a few µm would end within the seconds that are compared
SEEN_GAIN_DB = 100.0

#: measure → error
Figures = dict[str, float]


@dataclass(frozen=True)
class PlanStroke:
    """How a note is begun: which velocity, how much farther from the saddle, by which articulation (None: the normal
    one)."""

    velocity: int
    farther: float = 1.0
    articulation: Articulation | None = None


@dataclass(frozen=True)
class Judged:
    """One note begun in one way: the reference's displacement (n,) and what it can judge, quality → (measure, limit)."""

    u: np.ndarray
    limits: Mapping[str, list[tuple[str, float]]]


class OneString:
    """One open string of a preset as it is measured: by itself, its displacement near the saddle, each stroke the same.

    alone: a preset of that string only. Raises PresetError where it cannot be played. number: of its table in the preset
    that it is of; index: in the preset that is played. coupled: whether it shares a body, which is at rest here.
    """

    def __init__(self, alone: Preset, number: int = 0) -> None:
        self.number = number
        self.index = 0
        self.alone = alone
        self.table = alone.string[0]
        self.note = self.table.notes[0]
        self.label = self.table.name or midi_to_note(self.note)
        self.coupled = alone.coupled
        self._preset = _seen(alone)
        self._normal = alone.articulations.get(NORMAL)
        opened, below = open_string(alone, self.table, self.note)
        self.opened = opened
        self.kind = string_kind(alone, opened, below)
        self.pitch_hz = note_frequency(alone, self.table, self.note, None)
        self.fingerprint = fingerprint(alone, self.table, self.note)
        self.notes = [self.note + fret for fret in range(min(fret_count(alone, self.table), 127 - self.note) + 1)]
        self.seconds = ROLLING_S if self.kind in ROLLING else IMPACTS_S
        self._known: dict[tuple[int, PlanStroke], Judged] = {}
        self._law: dict[tuple[str, tuple[int, ...], PlanStroke], dict[int, Figures]] = {}

    def modes(self, highest_hz: float) -> int:
        """Modes of the open string up to a frequency."""
        return int(np.searchsorted(_modal_hz(self.opened), highest_hz, side="left"))

    def law(self, quality: str) -> int:
        """The factor that the law takes at 44.1 kHz."""
        choose = choose_steps if self.coupled else choose_factor
        return choose(self.pitch_hz, self.kind, quality, float(RATE_HZ))[0]

    def law_plan(self, quality: str) -> Measured:
        """What the law takes of the open string: its rate, and all modes below half of it."""
        rate = float(self.law(quality) * RATE_HZ)
        return Measured(rate, 0.5 * rate, self.modes(0.5 * rate), {})

    @property
    def factors(self) -> tuple[int, ...]:
        """Internal rates that are tried, as multiples of `RATE_HZ`."""
        return tuple(each for each in FACTORS if step_count(each) == each) if self.coupled else FACTORS

    def runs(self, notes: list[int], stroke: PlanStroke, factor: int, highest_hz: float) -> Iterator[tuple[int, np.ndarray]]:
        """(note, displacement (n,) from the finger's release on) of notes at a rate with modes up to a frequency."""
        preset = self.planned(self.stroked(stroke), Measured(float(factor * RATE_HZ), highest_hz, 1, {}))
        yield from self.displacements(preset, notes, stroke.velocity)

    def planned(self, preset: Preset, found: Measured) -> Preset:
        """The preset that is measured, with this plan of the string."""
        mark = fingerprint(preset, preset.string[self.index], self.note)
        row = MeasuredString("", "", self.pitch_hz, mark, {"standard": found})
        return preset.with_measured(MeasuredPlan((row, *self.others(preset)), frozenset(strokes(preset))))

    def stroked(self, stroke: PlanStroke) -> Preset:
        """The preset that is measured, with this stroke as its plain one."""
        pluck, way = self._preset.pluck, stroke.articulation or self._normal
        if stroke.farther != 1.0:
            places = {key: value for key in ("position", "position_hard") if (value := getattr(pluck, key)) is not None}
            pluck = pluck.model_copy(update={key: _nearer(value * stroke.farther) for key, value in places.items()})
        tables = list(self._preset.string)
        place = tables[self.index].pluck_position
        if isinstance(place, float):
            tables[self.index] = tables[self.index].model_copy(update={"pluck_position": _nearer(place * stroke.farther)})
        changes: dict[str, object] = {"pluck": pluck, "string": tuple(tables)}
        if way is not None:
            gone = {key: type(way).model_fields[key].default for key in WAYS | UNSTEADY}
            changes["articulations"] = {NORMAL: way.model_copy(update=gone | _shifted(way, stroke.farther))}
        return self._preset.model_copy(update=changes)

    def others(self, preset: Preset) -> tuple[MeasuredString, ...]:
        """What is known of other strings of the preset that is measured."""
        return ()

    def displacements(self, preset: Preset, notes: list[int], velocity: int) -> Iterator[tuple[int, np.ndarray]]:
        """(note, displacement (n,) from the finger's release on) of the preset that is measured, as its plans say."""
        engine = Engine(
            [preset],
            quality="standard",
            limiter=False,
            economy=False,
            only_notes=[set(notes)],
            every_fret=False,
            threads=1,
        )
        engine.prepare(float(RATE_HZ))
        string = engine.compiled[0].strings[0]
        begin = engine.latency_samples + math.ceil(string.draw_s * RATE_HZ)
        for note in notes:
            engine.reset()
            out = np.zeros((begin + round(self.seconds * RATE_HZ), 2))
            engine.process(make_events([(0, NOTE_ON, 0, note, velocity)]), out)
            yield note, in_metres(out[begin:, 0])

    def converged(self, notes: list[int], stroke: PlanStroke) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """(note, displacement (n,) of a converged run, of one that is half as fine)."""
        steps = FAR_STEPS if self.kind == FAR else ROLLING_STEPS if self.kind in ROLLING else IMPACT_STEPS
        factor = int(min(MAXIMUM_FACTOR, max(16, math.ceil(steps * self.pitch_hz / RATE_HZ))))
        modes = _modal_hz(self.opened)
        most = min(MOST_MODES, self.modes(0.5 * factor * RATE_HZ))
        highest, fewer = float(modes[most - 1]) + 1.0, float(modes[int(FEWER * most)])
        finest = dict(self.runs(notes, stroke, factor, highest))
        for note, half in self.runs(notes, stroke, factor // 2, fewer):
            yield note, finest[note], half

    def references(self, notes: list[int], stroke: PlanStroke) -> dict[int, Judged]:
        """Converged runs of notes, made once."""
        missing = [note for note in notes if (note, stroke) not in self._known]
        if missing:
            for note, u, half in self.converged(missing, stroke):
                stands = distances_measured(half, u, RATE_HZ)
                limits = {quality: judged_of_one(self.kind, quality, stands) for quality in PROMISED}
                self._known[note, stroke] = Judged(u, limits)
        return {note: self._known[note, stroke] for note in notes}

    def can_judge(self, quality: str, strokes_played: list[PlanStroke]) -> bool:
        """Whether references of all notes in strokes are near enough to the truth to judge a quality."""
        return all(
            judged.limits[quality] for stroke in strokes_played for judged in self.references(self.notes, stroke).values()
        )

    def figures(
        self, quality: str, notes: list[int], stroke: PlanStroke, found: Measured
    ) -> Iterator[tuple[int, Figures, Figures]]:
        """(note, measure → error over limit, measure → error), the former infinite where nothing can be judged."""
        known = self.references(notes, stroke)
        if not all(known[note].limits[quality] for note in notes):
            yield notes[0], {"e": math.inf}, {}
            return
        for note, u in self.runs(notes, stroke, math.ceil(found.rate_hz / RATE_HZ - 1e-9), found.highest_hz):
            here = distances_measured(u, known[note].u, RATE_HZ)
            limits = known[note].limits[quality]
            yield note, {name: here[name] / limit for name, limit in limits}, {name: here[name] for name, _ in limits}

    def by_law(self, quality: str, notes: list[int], stroke: PlanStroke) -> dict[int, Figures]:
        """For each note measure → error over limit with the rate and modes of the law, played once."""
        key = quality, tuple(notes), stroke
        if key not in self._law:
            played = self.figures(quality, notes, stroke, self.law_plan(quality))
            self._law[key] = {note: ratios for note, ratios, _ in played}
        return self._law[key]


class StringTogether(OneString):
    """One open string of a preset whose strings share a body, as it is measured: among the others, which are planned as
    preset.measured says, else by the law.

    Its reference has several times as many frames, in which it takes eight steps (`FINEST`), and the others so many as the
    law gives them; modes of the body and the other strings go farther up there, too.
    """

    def __init__(self, one: OneString, preset: Preset) -> None:
        super().__init__(one.alone, one.number)
        self.index = one.number
        self._whole = preset
        self._preset = _steady(preset)

    def others(self, preset: Preset) -> tuple[MeasuredString, ...]:
        """What is known of the other strings, as they are in a preset with another stroke."""
        found = []
        mine = fingerprint(preset, preset.string[self.index], self.note)
        for before, now in zip(self._whole.string, preset.string, strict=True):
            for note in string_notes(before):
                known = self._whole.measured.string(fingerprint(self._whole, before, note))
                mark = fingerprint(preset, now, note)
                if known is not None and mark != mine:
                    found.append(replace(known, fingerprint=mark))
        return tuple(found)

    def displacements(self, preset: Preset, notes: list[int], velocity: int) -> Iterator[tuple[int, np.ndarray]]:
        """(note, displacement (n,) from the finger's release on) of the preset that is measured, as its plans say."""
        for note in notes:
            yield note, self._played(preset, note, velocity, 1)

    def converged(self, notes: list[int], stroke: PlanStroke) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """(note, displacement (n,) of a converged run, of one that is half as fine)."""
        preset = self.stroked(stroke)
        rates = [frames * steps * RATE_HZ for frames, steps in (FINEST, HALF)]
        finest, half = (self.planned(preset, Measured(float(rate), 0.5 * rate, 1, {})) for rate in rates)
        for note in notes:
            yield (
                note,
                self._played(finest, note, stroke.velocity, FINEST[0]),
                self._played(half, note, stroke.velocity, HALF[0]),
            )

    def _played(self, preset: Preset, note: int, velocity: int, frames: int) -> np.ndarray:
        """(n,) of a note, with `frames` frames in one at `RATE_HZ`."""
        place = NotePlace(alone(preset, preset.string[self.index], self.note), self.index, self.note, note - self.note)
        lines = (line_of(preset, place),)
        made = Frames(preset, place, "standard", float(frames * RATE_HZ), lines=lines, economy=False)
        x = np.array([made.position(made.line).length_m - SEEN_AT * self.opened.length_m])
        begin = max(1, math.ceil(made.strings[made.number].draw_s * RATE_HZ)) * frames
        shots = made.play(velocity, begin, frames, round(self.seconds * RATE_HZ), frames)
        return np.concatenate([made.displacement(each, x)[:, 0] for each in shots])


def _modal_hz(string: String) -> np.ndarray:
    """(n,) modes of a string [Hz], as many as any run may have and one more."""
    return modal_frequencies(string, MOST_MODES + 1) / (2.0 * math.pi)


def _nearer(share: float) -> float:
    return min(0.95, max(0.02, share))


def _shifted(way: Articulation, farther: float) -> dict[str, float]:
    """The places of an articulation that has its own, farther from the saddle."""
    places = {key: getattr(way, key) for key in ("position", "position_hard")}
    return {key: _nearer(value * farther) for key, value in places.items() if value is not None}


def _steady(preset: Preset) -> Preset:
    """The preset with nothing left to chance, and its plain stroke alone."""
    pluck = preset.pluck.model_copy(update={"roughness_um": 0.0, "rub_percent": 0.0})
    return preset.model_copy(update={"hand": Hand(), "articulations": {}, "pluck": pluck})


def _seen(alone: Preset) -> Preset:
    """The preset with its string's displacement in the first direction as its output, and nothing left to chance."""
    changed: dict[str, object] = {"string": (alone.string[0].model_copy(update={"gain_db": 0.0}),)}
    if alone.polarisation is not None:
        changed["polarisation"] = alone.polarisation.model_copy(update={"heard": 0.0})
    return as_displacement(_steady(alone)).model_copy(update=changed)


def as_displacement(preset: Preset, at: float = SEEN_AT) -> Preset:
    """A preset whose output is the displacement at a share of the length from the saddle, without body and effects, in units
    that `in_metres` turns into metres."""
    output = preset.output.model_copy(update={"kind": "displacement", "position": at, "gain_db": SEEN_GAIN_DB})
    return preset.model_copy(update={"output": output, "body": type(preset.body)(), "effect": ()})


def in_metres(out: np.ndarray) -> np.ndarray:
    """The displacement [m] that an output of `as_displacement` stands for; any shape."""
    return out / 10 ** (SEEN_GAIN_DB / 20.0)
