"""The least internal rate and fewest modes that keep a quality's promise on a preset's own strings, found by playing them.

    plan = measure_plan(load_preset("tanpura-light"))  # a MeasuredPlan, as `planfile` keeps it beside the preset
    list(misses(preset, strokes))                    # how near strokes come to what is promised, of a preset with a plan

Every note of every string is played at the velocities of `VELOCITIES`, at many rates, with modes up to many frequencies, and
held against a run at several times the rate of the quality `reference`, which is itself held against one of half that rate
with fewer modes: as tools/calibrate-plan does it for random strings. A plan must keep `MARGIN` of each limit in the strokes
measured, and the limits themselves in `OTHERS`: between, harder, nearer to the saddle and farther from it, and in the other
strokes of the preset. What is heard of the highs counts beside the promise. A plan costs less than the law's, unless the law
itself misses the promise on that string: then it may have up to `DEARER` times the law's rate. Where nothing keeps the
margin, neither does the law; then a cheaper plan is taken that keeps the limits and comes as near to the truth (`NEAR`).

A string that shares a body with others is measured so with its end at rest, and what is found there is held against a
converged run of the whole instrument as well, in the strokes `TOGETHER` of its lowest, middle and highest note.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

from synth.fit.plan_strings import RATE_HZ, Figures, OneString, PlanStroke, StringTogether
from synth.instrument.articulations import NORMAL
from synth.instrument.compile import has_plan, plannable
from synth.instrument.fingerprints import PLAIN, stroke_of, strokes
from synth.instrument.neck import single_strings
from synth.instrument.plan import KEPT, ROLLING
from synth.instrument.planfile import PROMISED, Measured, MeasuredPlan, MeasuredString
from synth.instrument.preset import Preset, PresetError
from synth.units import midi_to_note

#: part of every limit that `KEPT` of a string's notes must keep in the strokes measured, and the others: among blows there
#: are notes at which no rate comes nearer
MARGIN, FARTHEST = 0.5, 0.75
#: velocities that are measured; the file of a plan names them
VELOCITIES = (25, 40, 120)
#: how far modes go that are tried [Hz]; none of them beyond half the rate
HIGHEST_HZ = (
    6000.0, 7000.0, 8000.0, 9000.0, 10000.0, 12000.0, 14000.0, 16000.0, 18000.0, 20000.0, 28000.0, 40000.0, 56000.0, 80000.0,
)  # fmt: skip
#: of the law's rate times modes, what is worth a plan
CHEAPER = 0.97
#: times the law's rate that a plan may have on a string where the law misses the promise
DEARER = 3.0
#: where no plan keeps the margin: how much farther from the truth than with the law's rate and modes a cheaper one may be,
#: as a share of each limit
NEAR = 0.05
#: modes go so far at least, whatever the figures say [Hz]
LEAST_HZ = {"draft": 6000.0, "standard": 8000.0, "fine": 14000.0}
#: strokes that a plan is held to beside those measured: (velocity, times the place)
OTHERS = ((75, 1.0), (127, 1.0), (100, 0.6), (100, 1.4))
#: velocities that a string which rolls on its bridge is held to besides: its last, grazing contacts come and go with them
ROLLING_VELOCITIES = (15, 20, 30, 35, 50, 64, 90, 105)
#: strokes that a plan is held to in the whole instrument, where strings share a body
TOGETHER = (PlanStroke(120),)

#: (quality, what it would take) → whether that keeps the promise
Holds = Callable[[str, Measured], bool]

#: told how much is done (0 … 1); False: it is to end
Progress = Callable[[float], bool]


class Ended(Exception):
    """Whoever is told of the progress wants no more of it."""


def measure_string(one: OneString, others: list[PlanStroke], progress: Progress, holds: Holds) -> MeasuredString:
    """What each quality takes on one string; a quality is left out where nothing tried keeps it, or only what costs as much
    as the law's, which keeps it too. holds: what else a plan has to pass. Raises Ended."""
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
        for factor in (each for each in one.factors if each <= DEARER * law):
            if factor > law and stands is None:
                stands = _law_stands(one, quality, measured, others)
            if stands:
                break
            found = _fewest(one, quality, factor, measured, others, holds)
            step(0.0)
            if found is not None:
                qualities[quality] = found
                break
        for factor in (each for each in one.factors if quality not in qualities and each <= law):
            found = _fewest(one, quality, factor, measured, others, holds, NEAR)
            if found is not None:
                qualities[quality] = found
                break
        step(0.5 / len(PROMISED))
    return MeasuredString(one.label, midi_to_note(one.note), round(one.pitch_hz, 3), one.fingerprint, qualities)


def _fewest(
    one: OneString,
    quality: str,
    factor: int,
    measured: list[PlanStroke],
    others: list[PlanStroke],
    holds: Holds,
    near: float | None = None,
) -> Measured | None:
    """The fewest modes at an internal rate that keep `MARGIN` of a promise, as any more do, and all of it in other strokes.

    near: less than the margin will do where it is as near to the truth as the law's rate and modes come, within so much of
    each limit. None where none do, or they cost what the law's cost at a rate that is not above the law's."""
    law = one.law(quality)
    most = law * one.law_plan(quality).modes
    half = 0.5 * factor * RATE_HZ
    kept: list[Measured] = []
    for highest in (half, *(hz for hz in reversed(HIGHEST_HZ) if LEAST_HZ[quality] <= hz < half)):
        found = Measured(float(factor * RATE_HZ), highest, one.modes(highest), {})
        figures = _kept(one, quality, measured, found, near) if found.modes else None
        if figures is None:
            break
        kept.append(replace(found, figures={name: float(f"{value:.2g}") for name, value in figures.items()}))
    for found in reversed(kept):
        cheaper = factor > law or factor * found.modes < CHEAPER * most
        if cheaper and holds_in(one, quality, others, found) and holds(quality, found):
            return found
    return None


def _law_stands(one: OneString, quality: str, measured: list[PlanStroke], others: list[PlanStroke]) -> bool:
    """Whether the law's rate and modes keep a promise in all strokes; also where nothing can be judged."""
    return not one.can_judge(quality, measured) or holds_in(one, quality, [*measured, *others], one.law_plan(quality))


def holds_in(one: OneString, quality: str, strokes_played: list[PlanStroke], found: Measured) -> bool:
    """Whether a rate and modes keep a promise in strokes of the lowest, middle and highest note."""
    few = sorted({one.notes[0], one.notes[len(one.notes) // 2], one.notes[-1]})
    return all(ratio <= 1.0 for stroke in strokes_played for ratio in ratios_of(one, quality, few, stroke, found))


def ratios_of(one: OneString, quality: str, notes: list[int], stroke: PlanStroke, found: Measured) -> Iterator[float]:
    """For each note the worst of error over limit. Among other strings the frames of the bridge are part of the error, of
    which no plan of one string makes less: there the limit is at least what the law's rate and modes make, and `NEAR`."""
    law = one.by_law(quality, notes, stroke) if isinstance(one, StringTogether) else {}
    for note, ratios, _ in one.figures(quality, notes, stroke, found):
        of_law = law.get(note, {})
        yield max((ratio / max(1.0, of_law.get(name, 0.0) + NEAR) for name, ratio in ratios.items()), default=math.inf)


def _within(most: float, ratios: Figures, law: Figures, near: float | None) -> bool:
    """Whether errors over their limits are at most so much, or within the limits so near to those of the law."""
    return all(
        ratio <= most or (near is not None and ratio <= min(1.0, law.get(name, 0.0) + near))
        for name, ratio in ratios.items()
    )


def _kept(one: OneString, quality: str, measured: list[PlanStroke], found: Measured, near: float | None) -> Figures | None:
    """The worst of each measure, where `KEPT` of the notes are within `MARGIN` of limits and none beyond `FARTHEST`, or near
    to what the law makes of them."""
    worst: Figures = {}
    over, allowed = 0, int((1.0 - KEPT) * len(one.notes) * len(measured))
    for stroke in measured:
        law = {} if near is None else one.by_law(quality, one.notes, stroke)
        for note, ratios, here in one.figures(quality, one.notes, stroke, found):
            of_law = law.get(note, {})
            over += not _within(MARGIN, ratios, of_law, near)
            if over > allowed or not _within(FARTHEST, ratios, of_law, near):
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
    """The strings of a preset that meet something, each kind once, with their ends at rest. Where strings share a body only
    those that roll on a bridge: blows take more steps than a frame has. Raises PresetError where plans are not measured."""
    if not plannable(preset):
        raise PresetError(
            f"{preset.name}: a plan can be measured only for strings over rigid points, and of strings that share a body "
            f"only over a bridge, got obstacle.kind {preset.obstacle.kind!r}; the law plans it"
        )
    found: dict[str, OneString] = {}
    for index, opened, alone in single_strings(preset):
        if has_plan(preset, preset.string[index], opened):
            one = OneString(alone, index)
            found.setdefault(one.fingerprint, one)
    return list(found.values())


def measure_plan(
    preset: Preset, progress: Progress | None = None, known: Mapping[str, MeasuredString] | None = None
) -> MeasuredPlan:
    """What each quality takes on every string of a preset, at all of its frets.

    progress: told how much is done, 0 … 1; where it answers False nothing more is measured and Ended raised.
    known: strings of earlier calls with the same strokes, by fingerprint, which are not measured again.
    Raises PresetError for a preset whose strings slide on a board, or lie over what is soft.
    """
    strings = measured_strings(preset)
    others = other_strokes(preset)
    done = []
    for number, one in enumerate(strings):

        def part(share: float, before: int = number) -> bool:
            return progress is None or progress((before + share) / len(strings))

        earlier = (known or {}).get(one.fingerprint)
        together = StringTogether(one, preset) if preset.coupled else None

        def holds(quality: str, found: Measured, among: StringTogether | None = together) -> bool:
            return among is None or holds_in(among, quality, list(TOGETHER), found)

        done.append(measure_string(one, others, part, holds) if earlier is None else replace(earlier, name=one.label))
    return MeasuredPlan(tuple(done), frozenset(strokes(preset)), VELOCITIES)


@dataclass(frozen=True)
class Held:
    """How a measured plan stands in one stroke of some notes: the worst of error over limit, None: nothing can be judged."""

    string: str
    quality: str
    stroke: PlanStroke
    worst: float | None


def misses(preset: Preset, strokes_played: list[PlanStroke], notes: set[int] | None = None) -> Iterator[Held]:
    """How the plan of a preset (`Preset.measured`) stands against what is promised, string by string; notes: only these.
    Strings that share a body are played among the others."""
    for alone in measured_strings(preset):
        one = StringTogether(alone, preset) if preset.coupled else alone
        row = preset.measured.string(one.fingerprint)
        played = [note for note in one.notes if notes is None or note in notes]
        for quality in {} if row is None or not played else row.qualities:
            found = row.at(one.pitch_hz, quality) if row is not None else None
            if found is None:
                continue
            for stroke in strokes_played:
                known = one.references(played, stroke)
                can = [note for note in played if known[note].limits[quality]]
                yield Held(one.label, quality, stroke, max(ratios_of(one, quality, can, stroke, found), default=None))
