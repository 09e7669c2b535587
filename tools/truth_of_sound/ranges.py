"""Which measures are fit to judge by, and the ranges of recordings.

A measure counts where each real set lies between the 5th and 95th percentile of the *other* sets often enough: in four
notes of five, averaged over the sets. Else recordings would not pass for recordings.
"""

from __future__ import annotations

import tomllib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import tomlkit

from synth.files.targets import write_text

#: share of its notes in which a real set must lie in the others' range, averaged over the sets
ADMITTED_FROM = 0.8
#: share of our notes that must lie within the range
WANTED = 0.7
_PERCENTILES = (5.0, 95.0)
_LEAST_NOTES = 4

#: values of one measure by set: {set: [values]}
BySet = Mapping[str, list[float]]


@dataclass(frozen=True)
class Range:
    """A measure's range over all sets, and how far the sets pass among each other.

    inside_mean, inside_worst: share of a set's notes in the range of the other sets, over the sets.  worst: that set.
    medians: of each set.
    """

    low: float
    high: float
    inside_mean: float
    inside_worst: float
    worst: str
    medians: dict[str, float]

    @property
    def admitted(self) -> bool:
        return self.inside_mean >= ADMITTED_FROM

    def inside(self, values: Iterable[float]) -> float:
        """Share of the values within the range; NaN of none."""
        return inside(values, self.low, self.high)


def inside(values: Iterable[float], low: float, high: float) -> float:
    """Share of the values within bounds; NaN of none."""
    array = np.array(list(values))
    return float(np.mean((array >= low) & (array <= high))) if array.size else float("nan")


def range_of(sets: BySet) -> Range:
    """Raises ValueError with fewer than two sets of three notes."""
    large = {name: values for name, values in sets.items() if len(values) >= _LEAST_NOTES}
    if len(large) < 2:
        raise ValueError(f"needs two sets of {_LEAST_NOTES} notes at least, got {len(large)}")
    shares = {}
    for name, values in large.items():
        others = [v for other, more in sets.items() if other != name for v in more]
        low, high = np.percentile(others, _PERCENTILES)
        shares[name] = inside(values, low, high)
    low, high = np.percentile([v for values in sets.values() for v in values], _PERCENTILES)
    worst = min(shares, key=lambda name: shares[name])
    medians = {name: float(np.median(values)) for name, values in sets.items()}
    return Range(float(low), float(high), float(np.mean(list(shares.values()))), shares[worst], worst, medians)


def ranges(notes: Iterable[tuple[str, Mapping[str, float]]], names: Iterable[str]) -> dict[str, Range]:
    """Of (set, measures) of many notes: the range of every named measure."""
    values: dict[str, dict[str, list[float]]] = {name: defaultdict(list) for name in names}
    for group, measures in notes:
        for name in values:
            if name in measures:
                values[name][group].append(measures[name])
    return {name: range_of(sets) for name, sets in values.items()}


#: what is judged of a bass if it is admitted
CANDIDATES = (
    "decay_ratio", "t60_1", "t60_2_5", "t60_6_12", "t60_13_20", "beating_db", "inharmonicity", "tilt_db_octave",
    "glide_cents",
)  # fmt: skip
#: notes compared: D1 to D3
BASS = (26, 50)
_HEAD = """Written by tools/truth --ranges: what recordings of basses measure, by the code that measures ours.
A measure's range is that between the 5th and 95th percentile of all sets' notes from D1 to D3; it is admitted where each
set lies in the range of the other sets in at least four notes of five, averaged over the sets of four notes and more.
[hand]: single values by note or recording, of few recordings, for comparison."""


def write(
    path: Path, bass: Mapping[str, Range], counts: Mapping[str, tuple[int, str]], hand: Mapping[str, Mapping[str, float]]
) -> None:
    """The file of ranges. counts: notes and source of every set."""
    document = tomlkit.document()
    for line in _HEAD.splitlines():
        document.add(tomlkit.comment(line))
    sets = tomlkit.table()
    for name, (count, source) in sorted(counts.items()):
        sets[name] = {"notes": count, "source": source}
    measures = tomlkit.table()
    for name, found in bass.items():
        rounded = {key: _short(value) for key, value in asdict(found).items() if key != "medians"}
        measures[name] = tomlkit.item(rounded | {"admitted": found.admitted})
        measures[name]["medians"] = tomlkit.item({key: _short(value) for key, value in sorted(found.medians.items())})
    document["set"] = sets
    document["bass"] = measures
    document["hand"] = {key: {n: _short(v) for n, v in sorted(values.items())} for key, values in sorted(hand.items())}
    write_text(path, tomlkit.dumps(document))


def _short(value: float | str) -> float | str:
    return value if isinstance(value, str) else float(f"{value:.4g}")


def read(path: Path) -> tuple[dict[str, Range], dict[str, dict[str, float]]]:
    """(ranges of the bass, values of the hand) of a file written by `write`."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    bass = {name: Range(**{k: v for k, v in values.items() if k != "admitted"}) for name, values in data["bass"].items()}
    return bass, data["hand"]
