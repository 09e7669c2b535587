"""What modes in float32 change of a note: its string's displacement beside the same note in float64, at the same plan."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from synth.engine.engine import Engine
from synth.fit.plan_measures import distances
from synth.fit.plan_strings import as_displacement, in_metres
from synth.host.batch import played_as
from synth.instrument.articulations import NORMAL
from synth.instrument.preset import Preset, list_presets, playable_notes
from synth.instrument.qualities import PRECISIONS
from synth.midi.events import NOTE_ON, make_events

RATE_HZ, SECONDS = 44100, 3.0
#: notes of a preset, from its lowest to its highest, and velocities
NOTES, VELOCITIES = 4, (40, 64, 110)
#: those with modes in float32
QUALITIES = ("draft", "standard")
#: columns of the table: "" is the median of e, the others are the worst of a measure
WORDS = {
    "": "e over 3 s, median", "e": "worst", "e_onset": "e over 0.1 s, worst", "lsd_db": "log-spectral distance, worst, dB",
    "bands_db": "third octaves, worst, dB",
}  # fmt: skip


class Rounded(NamedTuple):
    """A note of a preset, and how it was begun: measures (`plan_measures.distances`) of float32 against float64."""

    preset: str
    quality: str
    articulation: str  # "": the normal stroke
    note: int
    velocity: int
    figures: dict[str, float]


def single_presets() -> list[Preset]:
    """The presets whose strings have their modes in float32 at `standard`, by name."""
    found = []
    for preset in list_presets():
        notes = playable_notes(preset)
        engine = Engine([preset], only_notes=[{notes[0]}], every_fret=False, warn=lambda text: None)
        engine.prepare(float(RATE_HZ))
        if engine.has_single:
            found.append(preset)
    return found


def chosen_notes(preset: Preset, count: int = NOTES) -> list[int]:
    """So many of its notes, evenly from the lowest to the highest."""
    notes = playable_notes(preset)
    return sorted({notes[round(place)] for place in np.linspace(0, len(notes) - 1, count)})


def measured(
    preset: Preset, notes: Sequence[int], velocities: Sequence[int] = VELOCITIES, *, quality: str = "standard",
    articulation: str = "", seconds: float = SECONDS,
) -> Iterator[Rounded]:  # fmt: skip
    """Each note at each velocity, begun once and left to ring, seen 0.01 of the length from the saddle. Raises ValueError
    for an articulation that the preset does not have."""
    played = played_as(preset, articulation, 0)
    if isinstance(played, str):
        raise ValueError(played)
    seen = as_displacement(played[1])
    double, single = (_engine(seen, quality, precision, notes) for precision in PRECISIONS)
    for note in notes:
        for velocity in velocities:
            one, other = (_displacement(engine, note, velocity, seconds) for engine in (single, double))
            yield Rounded(preset.name, quality, articulation, note, velocity, distances(one, other, RATE_HZ))


def _engine(preset: Preset, quality: str, precision: str, notes: Sequence[int]) -> Engine:
    engine = Engine(
        [preset], quality=quality, precision=precision, only_notes=[set(notes)], every_fret=False, limiter=False,
        warn=lambda text: None,
    )  # fmt: skip
    engine.prepare(float(RATE_HZ))
    return engine


def _displacement(engine: Engine, note: int, velocity: int, seconds: float) -> np.ndarray:
    """(frames,) [m] of a note that begins at once and is not let go."""
    engine.reset()
    out = np.zeros((round(seconds * RATE_HZ), 2))
    engine.process(make_events([(0, NOTE_ON, 0, note, velocity)]), out)
    return in_metres(out[:, 0])


def everything(preset: Preset) -> Iterator[Rounded]:
    """Its notes at all velocities at `draft` and `standard`; at `standard`, in every articulation at the hardest."""
    notes = chosen_notes(preset)
    for quality in QUALITIES:
        yield from measured(preset, notes, quality=quality)
    for articulation in preset.articulations:
        if articulation != NORMAL:
            yield from measured(preset, notes, VELOCITIES[-1:], articulation=articulation)


def table(found: Mapping[str, list[Rounded]], obstacles: Mapping[str, str]) -> str:
    """Markdown: a row for each preset, those with the largest e first; `obstacles`: what the strings of a preset touch."""
    lines = [
        "| preset | its strings touch | notes | " + " | ".join(WORDS.values()) + " |",
        "|---|---|---" + "|---" * len(WORDS) + "|",
    ]

    def worst(name: str, measure: str) -> float:
        return max(each.figures[measure] for each in found[name])

    for name in sorted(found, key=lambda name: -worst(name, "e")):
        middle = float(np.median([each.figures["e"] for each in found[name]]))
        cells = [f"{middle:.1g}", *(f"{worst(name, measure):.2g}" for measure in list(WORDS)[1:])]
        lines.append(f"| `{name}` | {obstacles[name]} | {len(found[name])} | {' | '.join(cells)} |")
    return "\n".join(lines)
