"""The least internal rate and fewest modes that keep a quality's promise on a preset's own strings, found by playing them.

    plan = measure_plan(load_preset("tanpura-light"))  # a MeasuredPlan, as `planfile` keeps it beside the preset
    list(misses(preset, strokes))                    # how near strokes come to what is promised, of a preset with a plan

Every note of every string is played at the velocities of `VELOCITIES`, at many rates, with modes up to many frequencies, and
held against a run at several times the rate of the quality `reference`, which is itself held against one of half that rate
with fewer modes: as tools/calibrate-plan does it for random strings. A plan must keep `MARGIN` of each limit in the strokes
measured, and the limits themselves in `OTHERS`: between, harder, nearer to the saddle and farther from it, and in the other
strokes of the preset. What is heard of the highs counts beside the promise. A plan costs less than the law's, unless the law
itself misses the promise on that string: then it may have up to `DEARER` times the law's rate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from synth.dsp.rates import MAXIMUM_FACTOR
from synth.engine.engine import Engine
from synth.fit.plan_measures import ROLLING, distances_measured, judged_of_one
from synth.instrument.articulations import NORMAL, Articulation, Hand
from synth.instrument.compile import note_frequency, open_string, plannable, string_kind
from synth.instrument.fingerprints import PLAIN, UNSTEADY, WAYS, fingerprint, stroke_of, strokes
from synth.instrument.neck import single_strings
from synth.instrument.plan import FAR, FREE, KEPT, choose_factor
from synth.instrument.planfile import PROMISED, Measured, MeasuredPlan, MeasuredString
from synth.instrument.preset import Preset, PresetError, fret_count
from synth.midi.events import NOTE_ON, make_events
from synth.physics.modes import modal_frequencies
from synth.physics.string import String
from synth.units import midi_to_note

RATE_HZ = 44100
#: part of every limit that `KEPT` of a string's notes must keep in the strokes measured, and the others: among blows there
#: are notes at which no rate comes nearer
MARGIN, FARTHEST = 0.5, 0.75
#: velocities that are measured; the file of a plan names them
VELOCITIES = (25, 40, 120)
#: seconds of a note: what is promised of a bridge is promised over 3 s
ROLLING_S, IMPACTS_S = 3.0, 0.5
#: internal steps per period of the reference, where the string rolls, is plucked from afar, takes blows; its most modes
ROLLING_STEPS, FAR_STEPS, IMPACT_STEPS, MOST_MODES = 9000.0, 18000.0, 30000.0, 1000
#: what the half run has of the reference's modes
FEWER = 0.7
#: internal rates tried, as multiples of `RATE_HZ`, and how far modes go [Hz]; none of them beyond half the rate
FACTORS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48)
HIGHEST_HZ = (6000.0, 7000.0, 8000.0, 9000.0, 10000.0, 12000.0, 14000.0, 16000.0, 18000.0, 20000.0)
#: of the law's rate times modes, what is worth a plan
CHEAPER = 0.97
#: times the law's rate that a plan may have on a string where the law misses the promise
DEARER = 3.0
#: modes go so far at least, whatever the figures say [Hz]
LEAST_HZ = {"draft": 6000.0, "standard": 8000.0, "fine": 14000.0}
#: strokes that a plan is held to beside those measured: (velocity, times the place)
OTHERS = ((75, 1.0), (127, 1.0), (100, 0.6), (100, 1.4))
#: velocities that a string which rolls on its bridge is held to besides: its last, grazing contacts come and go with them
ROLLING_VELOCITIES = (15, 20, 30, 35, 50, 64, 90, 105)
#: output's place from the saddle, as a share of the open length: that of the calibration's scenes
SEEN_AT = 0.01
#: gain of that output [dB]: 10 µm are full scale, as loud as a preset; strings sleep and modes rest by their level in
#: the output, so that without the gain a soft note of a few µm would end within the seconds that are compared
SEEN_GAIN_DB = 100.0

#: measure → error
Figures = dict[str, float]

#: told how much is done (0 … 1); False: it is to end
Progress = Callable[[float], bool]


class Ended(Exception):
    """Whoever is told of the progress wants no more of it."""


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

    alone: a preset of that string only. Raises PresetError where it cannot be played.
    """

    def __init__(self, alone: Preset) -> None:
        self.table = alone.string[0]
        self.note = self.table.notes[0]
        self.label = self.table.name or midi_to_note(self.note)
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

    def modes(self, highest_hz: float) -> int:
        """Modes of the open string up to a frequency."""
        return int(np.searchsorted(_modal_hz(self.opened), highest_hz, side="left"))

    def law(self, quality: str) -> int:
        """The factor that the law takes at 44.1 kHz."""
        return choose_factor(self.pitch_hz, self.kind, quality, float(RATE_HZ))[0]

    def runs(self, notes: list[int], stroke: PlanStroke, factor: int, highest_hz: float) -> Iterator[tuple[int, np.ndarray]]:
        """(note, displacement (n,) from the finger's release on) of notes at a rate with modes up to a frequency."""
        pluck, way = self._preset.pluck, stroke.articulation or self._normal
        if stroke.farther != 1.0:
            places = {key: value for key in ("position", "position_hard") if (value := getattr(pluck, key)) is not None}
            pluck = pluck.model_copy(update={key: _nearer(value * stroke.farther) for key, value in places.items()})
        changes: dict[str, object] = {"pluck": pluck}
        table = self.table
        if table.pluck_position is not None and isinstance(table.pluck_position, float):
            table = table.model_copy(update={"pluck_position": _nearer(table.pluck_position * stroke.farther)})
            changes["string"] = (table,)
        if way is not None:
            gone = {key: type(way).model_fields[key].default for key in WAYS | UNSTEADY}
            changes["articulations"] = {NORMAL: way.model_copy(update=gone | _shifted(way, stroke.farther))}
        preset = self._preset.model_copy(update=changes)
        found = Measured(float(factor * RATE_HZ), highest_hz, 1, {})
        row = MeasuredString("", "", self.pitch_hz, fingerprint(preset, table, self.note), {"standard": found})
        engine = Engine(
            [preset.with_measured(MeasuredPlan((row,), frozenset(strokes(preset))))],
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
            engine.process(make_events([(0, NOTE_ON, 0, note, stroke.velocity)]), out)
            yield note, in_metres(out[begin:, 0])

    def references(self, notes: list[int], stroke: PlanStroke) -> dict[int, Judged]:
        """Converged runs of notes, made once."""
        missing = [note for note in notes if (note, stroke) not in self._known]
        if missing:
            steps = FAR_STEPS if self.kind == FAR else ROLLING_STEPS if self.kind in ROLLING else IMPACT_STEPS
            factor = int(min(MAXIMUM_FACTOR, max(16, math.ceil(steps * self.pitch_hz / RATE_HZ))))
            modes = _modal_hz(self.opened)
            most = min(MOST_MODES, self.modes(0.5 * factor * RATE_HZ))
            highest, fewer = float(modes[most - 1]) + 1.0, float(modes[int(FEWER * most)])
            finest = dict(self.runs(missing, stroke, factor, highest))
            for note, half in self.runs(missing, stroke, factor // 2, fewer):
                u = finest[note]
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
    ) -> Iterator[tuple[float, Figures]]:
        """For each note (the worst of error over limit, measure → error); infinite where nothing can be judged."""
        known = self.references(notes, stroke)
        if not all(known[note].limits[quality] for note in notes):
            yield math.inf, {}
            return
        for note, u in self.runs(notes, stroke, round(found.rate_hz / RATE_HZ), found.highest_hz):
            here = distances_measured(u, known[note].u, RATE_HZ)
            limits = known[note].limits[quality]
            yield max(here[measure] / limit for measure, limit in limits), {measure: here[measure] for measure, _ in limits}


def measure_string(one: OneString, others: list[PlanStroke], progress: Progress) -> MeasuredString:
    """What each quality takes on one string; a quality is left out where nothing tried keeps it, or only what costs as much
    as the law's, which keeps it too. Raises Ended."""
    done = 0.0

    def step(part: float) -> None:
        nonlocal done
        done += part
        if not progress(min(1.0, done)):
            raise Ended

    measured = [PlanStroke(velocity) for velocity in reversed(VELOCITIES)]
    for stroke in measured:
        one.references(one.notes, stroke)
        step(0.5 / len(measured))
    qualities: dict[str, Measured] = {}
    if one.kind in ROLLING:
        others = [*others, *(PlanStroke(velocity) for velocity in ROLLING_VELOCITIES)]
    for quality in PROMISED:
        law = one.law(quality)
        stands: bool | None = None
        for factor in (each for each in FACTORS if each <= DEARER * law):
            if factor > law and stands is None:
                stands = _law_stands(one, quality, measured, others)
            if stands:
                break
            found = _fewest(one, quality, factor, measured, others)
            step(0.0)
            if found is not None:
                qualities[quality] = found
                break
        step(0.5 / len(PROMISED))
    return MeasuredString(one.label, midi_to_note(one.note), round(one.pitch_hz, 3), one.fingerprint, qualities)


def _fewest(
    one: OneString, quality: str, factor: int, measured: list[PlanStroke], others: list[PlanStroke]
) -> Measured | None:
    """The fewest modes at an internal rate that keep `MARGIN` of a promise, as any more do, and all of it in other strokes.

    None where none do, or they cost what the law's cost at a rate that is not above the law's."""
    law = one.law(quality)
    most = law * one.modes(0.5 * law * RATE_HZ)
    half = 0.5 * factor * RATE_HZ
    kept: list[Measured] = []
    for highest in (half, *(hz for hz in reversed(HIGHEST_HZ) if LEAST_HZ[quality] <= hz < half)):
        found = Measured(float(factor * RATE_HZ), highest, one.modes(highest), {})
        figures = _kept(one, quality, measured, found) if found.modes else None
        if figures is None:
            break
        kept.append(replace(found, figures={name: float(f"{value:.2g}") for name, value in figures.items()}))
    for found in reversed(kept):
        cheaper = factor > law or factor * found.modes < CHEAPER * most
        if cheaper and _holds(one, quality, others, found):
            return found
    return None


def _law_stands(one: OneString, quality: str, measured: list[PlanStroke], others: list[PlanStroke]) -> bool:
    """Whether the law's rate and modes keep a promise in all strokes; also where nothing can be judged."""
    law = one.law(quality)
    highest = 0.5 * law * RATE_HZ
    found = Measured(float(law * RATE_HZ), highest, one.modes(highest), {})
    return not one.can_judge(quality, measured) or _holds(one, quality, [*measured, *others], found)


def _holds(one: OneString, quality: str, strokes_played: list[PlanStroke], found: Measured) -> bool:
    """Whether a rate and modes keep a promise in strokes of the lowest, middle and highest note."""
    few = sorted({one.notes[0], one.notes[len(one.notes) // 2], one.notes[-1]})
    return all(ratio <= 1.0 for stroke in strokes_played for ratio, _ in one.figures(quality, few, stroke, found))


def _kept(one: OneString, quality: str, measured: list[PlanStroke], found: Measured) -> Figures | None:
    """The worst of each measure, where `KEPT` of the notes are within `MARGIN` of limits and none beyond `FARTHEST`."""
    worst: Figures = {}
    over, allowed = 0, int((1.0 - KEPT) * len(one.notes) * len(measured))
    for stroke in measured:
        for ratio, here in one.figures(quality, one.notes, stroke, found):
            over += not ratio <= MARGIN
            if over > allowed or not ratio <= FARTHEST:
                return None
            worst = {name: max(here.get(name, 0.0), worst.get(name, 0.0)) for name in here | worst}
    return worst


def other_strokes(preset: Preset) -> list[PlanStroke]:
    """What a plan of a preset is held to beside what is measured: `OTHERS`, and strokes that no finger damps."""
    ways = {stroke_of(each): each for each in preset.articulations.values() if each.touch is None}
    ways.pop(PLAIN, None)
    if NORMAL in preset.articulations:
        ways.pop(stroke_of(preset.articulations[NORMAL]), None)
    return [PlanStroke(*each) for each in OTHERS] + [PlanStroke(VELOCITIES[-1], articulation=each) for each in ways.values()]


def measured_strings(preset: Preset) -> list[OneString]:
    """The strings of a preset that meet something, each kind once. Raises PresetError where plans are not measured."""
    if not plannable(preset):
        raise PresetError(
            f"{preset.name}: a plan can be measured only for strings with rigid ends over rigid points, "
            "which this preset does not have; the law plans it"
        )
    found: dict[str, OneString] = {}
    for _, _, alone in single_strings(preset):
        one = OneString(alone)
        if one.kind != FREE:
            found.setdefault(one.fingerprint, one)
    return list(found.values())


def measure_plan(
    preset: Preset, progress: Progress | None = None, known: Mapping[str, MeasuredString] | None = None
) -> MeasuredPlan:
    """What each quality takes on every string of a preset, at all of its frets.

    progress: told how much is done, 0 … 1; where it answers False nothing more is measured and Ended raised.
    known: strings of earlier calls with the same strokes, by fingerprint, which are not measured again.
    Raises PresetError for a preset whose strings share a body, slide on a board, or lie over what is soft.
    """
    strings = measured_strings(preset)
    others = other_strokes(preset)
    done = []
    for number, one in enumerate(strings):

        def part(share: float, before: int = number) -> bool:
            return progress is None or progress((before + share) / len(strings))

        earlier = (known or {}).get(one.fingerprint)
        done.append(measure_string(one, others, part) if earlier is None else replace(earlier, name=one.label))
    return MeasuredPlan(tuple(done), frozenset(strokes(preset)), VELOCITIES)


@dataclass(frozen=True)
class Held:
    """How a measured plan stands in one stroke of some notes: the worst of error over limit, None: nothing can be judged."""

    string: str
    quality: str
    stroke: PlanStroke
    worst: float | None


def misses(preset: Preset, strokes_played: list[PlanStroke], notes: set[int] | None = None) -> Iterator[Held]:
    """How the plan of a preset (`Preset.measured`) stands against what is promised, string by string; notes: only these."""
    for one in measured_strings(preset):
        row = preset.measured.string(one.fingerprint)
        played = [note for note in one.notes if notes is None or note in notes]
        for quality in {} if row is None or not played else row.qualities:
            found = row.at(one.pitch_hz, quality) if row is not None else None
            if found is None:
                continue
            for stroke in strokes_played:
                exact = one.references(played, stroke)
                ratios = []
                for note, u in one.runs(played, stroke, math.ceil(found.rate_hz / RATE_HZ - 1e-9), found.highest_hz):
                    here = distances_measured(u, exact[note].u, RATE_HZ)
                    ratios += [here[measure] / limit for measure, limit in exact[note].limits[quality]]
                yield Held(one.label, quality, stroke, max(ratios) if ratios else None)


def _modal_hz(string: String) -> np.ndarray:
    """(n,) modes of a string [Hz], as many as any run may have and one more."""
    return modal_frequencies(string, MOST_MODES + 1) / (2.0 * math.pi)


def _nearer(share: float) -> float:
    return min(0.95, max(0.02, share))


def _shifted(way: Articulation, farther: float) -> dict[str, float]:
    """The places of an articulation that has its own, farther from the saddle."""
    places = {key: getattr(way, key) for key in ("position", "position_hard")}
    return {key: _nearer(value * farther) for key, value in places.items() if value is not None}


def _seen(alone: Preset) -> Preset:
    """The preset with its string's displacement in the first direction as its output, and nothing left to chance."""
    changed: dict[str, object] = {"hand": Hand(), "articulations": {}}
    changed["pluck"] = alone.pluck.model_copy(update={"roughness_um": 0.0, "rub_percent": 0.0})
    if alone.polarisation is not None:
        changed["polarisation"] = alone.polarisation.model_copy(update={"heard": 0.0})
    table = alone.string[0].model_copy(update={"gain_db": 0.0})
    return as_displacement(alone).model_copy(update={**changed, "string": (table,)})


def as_displacement(preset: Preset, at: float = SEEN_AT) -> Preset:
    """A preset whose output is the displacement at a share of the length from the saddle, without body and effects, in units
    that `in_metres` turns into metres."""
    output = preset.output.model_copy(update={"kind": "displacement", "position": at, "gain_db": SEEN_GAIN_DB})
    return preset.model_copy(update={"output": output, "body": type(preset.body)(), "effect": ()})


def in_metres(out: np.ndarray) -> np.ndarray:
    """The displacement [m] that an output of `as_displacement` stands for; any shape."""
    return out / 10 ** (SEEN_GAIN_DB / 20.0)
