"""Tables of the impostor test: AUC of ours and of every real set, medians of the features, distances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from truth_of_sound.controls import sine_notes
from truth_of_sound.families import Family, Notes
from truth_of_sound.impostor import DISTANT, distances, mean, real_ones, told
from truth_of_sound.note_features import FEATURES
from truth_of_sound.page import marked

#: what a preset may have at most, and the presets of a family in the mean
MOST, MOST_MEAN = 0.90, 0.85
#: what the forty sines must have at least, and how far an equaliser may move a real set
LEAST_OF_SINES, MOST_MOVED = 0.97, 0.10
#: mean distance that a family may have, in robust standard deviations
MOST_DISTANCE = 1.5


@dataclass(frozen=True)
class Verdict:
    """What the test says of a family.

    ours: {preset: notes}; recordings: {set: notes}; against: {preset: {set left out: AUC}}; real: {set: AUC as an impostor};
    sines: AUC of the control; moved: {set: (AUC, AUC behind an equaliser)}.
    """

    family: Family
    ours: Mapping[str, Notes]
    recordings: Mapping[str, Notes]
    against: Mapping[str, Mapping[str, float]]
    real: Mapping[str, float]
    sines: float
    moved: Mapping[str, tuple[float, float]]

    @property
    def tuning(self) -> dict[str, Notes]:
        """The recordings on which presets may be tuned."""
        return {name: notes for name, notes in self.recordings.items() if name in self.family.tuning}

    def distance(self, preset: str) -> float:
        """In the mean over the features."""
        return float(np.mean(list(distances(self.ours[preset], self.recordings).values())))


def verdict(
    family: Family, ours: Mapping[str, Notes], recordings: Mapping[str, Notes], turned: Mapping[str, Notes]
) -> Verdict:
    """All that the test says of a family. Raises ValueError where there are no two sets of recordings."""
    if len(recordings) < 2:
        raise ValueError(
            f"{family.name}: the test needs two sets of recordings, got {len(recordings)}; measure more of them"
        )
    real = real_ones(recordings)
    moved = {}
    for name, notes in turned.items():
        if name in real:
            moved[name] = (real[name], mean(told(notes, {k: v for k, v in recordings.items() if k != name})))
    against = {preset: told(notes, recordings) for preset, notes in ours.items()}
    return Verdict(family, ours, recordings, against, real, mean(told(sine_notes(family.notes), recordings)), moved)


def auc_table(found: Verdict) -> str:
    """Real sets, ours and the controls; what misses an aim is bold."""
    family = found.family
    rows: list[tuple[object, ...]] = [(name, len(found.recordings[name]), value) for name, value in found.real.items()]
    if found.real:
        rows.append(("real sets, mean", "", float(np.mean(list(found.real.values())))))
    for preset, against in found.against.items():
        parts = (mean(against), mean(against, family.tuning), mean(against, family.judging))
        far = found.distance(preset)
        cells = (marked(f"{parts[0]:.2f}", parts[0] > MOST), *parts[1:], marked(f"{far:.1f}", far > MOST_DISTANCE))
        rows.append((f"*{preset}*", len(found.ours[preset]), *cells))
    if len(found.against) > 1:
        middle = float(np.mean([mean(each) for each in found.against.values()]))
        rows.append(("*ours, mean*", "", marked(f"{middle:.2f}", middle > MOST_MEAN)))
    rows.append((f"control: forty sines (at least {LEAST_OF_SINES:g})", "", found.sines))
    for name, (before, after) in found.moved.items():
        said = f"control: {name} behind an equaliser (moves less than {MOST_MOVED:g})"
        rows.append((said, "", f"{before:.2f} → {after:.2f}"))
    columns = ("impostor", "notes", "AUC", "on sets for tuning", "on sets for judging", "distance")
    lines = [f"| {' | '.join(columns)} |", f"| {' | '.join('---' for _ in columns)} |"]
    for row in rows:
        cells = [f"{cell:.2f}" if isinstance(cell, float) else str(cell) for cell in row]
        lines.append(f"| {' | '.join(cells + [''] * (len(columns) - len(cells)))} |")
    return "\n".join(lines) + "\n"


def feature_table(found: Verdict) -> str:
    """Medians of every feature: of the sets for tuning from least to most, of ours; those outside are bold."""
    lines = [f"| feature | sets for tuning | {' | '.join(found.ours)} |", f"| --- | --- |{' --- |' * len(found.ours)}"]
    for key, (said, _) in FEATURES.items():
        medians = [value for notes in found.tuning.values() if np.isfinite(value := _median(notes, key))]
        if not medians:
            continue
        low, high = min(medians), max(medians)
        cells = []
        for notes in found.ours.values():
            value = _median(notes, key)
            cells.append(f"{value:.3g}" if low <= value <= high else f"**{value:.3g}**")
        lines.append(f"| {said} | {low:.3g} – {high:.3g} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def distance_table(found: Verdict) -> str:
    """The distance of every preset from the sets for tuning, by feature."""
    parts = {preset: distances(notes, found.tuning) for preset, notes in found.ours.items()}
    lines = [f"| feature | {' | '.join(parts)} |", f"| --- |{' --- |' * len(parts)}"]
    for key in DISTANT:
        cells = [f"{each[key]:.1f}" if key in each else "–" for each in parts.values()]
        lines.append(f"| {FEATURES[key][0]} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _median(notes: Notes, key: str) -> float:
    values = [note[key] for note in notes if np.isfinite(note[key])]
    return float(np.median(values)) if values else float("nan")
