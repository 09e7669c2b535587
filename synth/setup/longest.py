"""The bridge that lets a string buzz longest: height of the thread (jiva), its place, or the curve of the bridge.

A buzz lasts for all moments together in which some third octave of the note is louder by `audible_db` than of the same
stroke over nothing, what is 40 dB below the loudest moment of that stroke being lost in the room (`audible`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from synth.instrument.preset import BridgeObstacle, Preset, PresetError, Scaled, at_note
from synth.setup.audible import AUDIBLE_DB
from synth.setup.buzz_map import prepare
from synth.setup.places import FretPlace, places_of
from synth.setup.side_by_side import all_computed
from synth.units import midi_to_note

#: of the computation unless told otherwise
QUALITY = "standard"
#: seconds of a note that are played
SECONDS = 12.0
#: heights of a thread [µm], and factors of its distance or of a radius, that are tried first
JIVA_UM = (-5.0, 0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 13.0, 17.0, 22.0, 30.0, 40.0, 60.0)
PARTS = (0.8, 0.9, 1.0, 1.1, 1.25)
#: factor by which another place or curve must be better than the present one
_WORTH = 1.05
#: of a thread's distance to the string's length, at most (the preset's key)
MOST_RATIO = 0.2
#: rounds in which the best height is narrowed down
_ROUNDS = 2


@dataclass(frozen=True)
class TriedBridge:
    """A bridge that was tried under a string, and how long a stroke buzzes on it [s].

    jiva_um   height of the thread [µm]
    part      place of the thread, or radius of a curved bridge, in parts of the preset's
    """

    jiva_um: float
    part: float
    seconds: float


@dataclass(frozen=True)
class Longest:
    """The bridges that were tried under the open strings of one note, which share a thread; seconds are their mean.

    places  these strings
    now     as it is
    best    the best one of the proposed place or curve: how long a buzz lasts differs by a tenth or so from height to
            height, so that each counts with its neighbours
    near    heights of the thread [µm] about the best between which a buzz is at most a tenth shorter, neighbours counted
    """

    places: tuple[FretPlace, ...]
    now: TriedBridge
    best: TriedBridge
    near: tuple[float, float]

    @property
    def names(self) -> str:
        """Of its strings."""
        return ", ".join(each.string for each in self.places)


def with_neighbours(tried: Sequence[TriedBridge]) -> list[float]:
    """Seconds of bridges that differ in height, in its order: each the mean of itself and of those beside it."""
    return [
        sum(each.seconds for each in beside) / len(beside)
        for beside in (tried[max(0, k - 1) : k + 2] for k in range(len(tried)))
    ]


def _best(tried: Sequence[TriedBridge]) -> tuple[TriedBridge, tuple[float, float], float]:
    """The best of bridges that differ in height, the heights near it, and its seconds with its neighbours."""
    seconds = with_neighbours(tried)
    k = max(range(len(tried)), key=lambda each: seconds[each])
    low = high = k
    while low > 0 and seconds[low - 1] >= 0.9 * seconds[k]:
        low -= 1
    while high + 1 < len(tried) and seconds[high + 1] >= 0.9 * seconds[k]:
        high += 1
    return tried[k], (tried[low].jiva_um, tried[high].jiva_um), seconds[k]


def bridge_of(preset: Preset) -> BridgeObstacle:
    """The bridge of a preset. Raises PresetError for one without."""
    shape = preset.obstacle
    if not isinstance(shape, BridgeObstacle):
        raise PresetError(
            f'{preset.name}: obstacle.kind must be bridge for a long buzz, got {shape.kind}; ask for "no buzz at medium"'
        )
    return shape


def longest(
    preset: Preset,
    velocity: int,
    *,
    place_m: float | None = None,
    quality: str = QUALITY,
    audible_db: float = AUDIBLE_DB,
    strings: Sequence[str] | None = None,
    threads: int = 1,
    told: Callable[[int, int], None] | None = None,
) -> list[Longest]:
    """The bridge that lets each open string buzz longest, by strokes of a velocity. Raises PresetError, ValueError;
    KeyboardInterrupt."""
    shape = bridge_of(preset)
    groups: dict[int, tuple[FretPlace, ...]] = {}
    for place in places_of(preset, strings, {0}):
        groups[place.opened] = (*groups.get(place.opened, ()), place)
    parts = [part for part in PARTS if shape.distance_ratio is None or part * shape.distance_ratio <= MOST_RATIO]
    jobs = [(note, part) for note in groups for part in parts]

    def one(job: tuple[int, float]) -> list[TriedBridge]:
        note, part = job
        tried: dict[float, float] = {}

        def play(jiva: float) -> None:
            if jiva not in tried:
                other = with_bridge(preset, note, jiva, part)
                seconds = [_seconds(other, place, velocity, place_m, quality, audible_db) for place in groups[note]]
                tried[jiva] = sum(seconds) / len(seconds)

        for jiva in sorted({*JIVA_UM, at_note(shape.jiva_um, note)}):
            play(jiva)
        for _ in range(_ROUNDS):
            heights = sorted(tried)
            k = heights.index(max(heights, key=lambda each: tried[each]))
            for other in (k - 1, k + 1):
                if 0 <= other < len(heights):
                    play(round(0.5 * (heights[k] + heights[other]), 2))
        return [TriedBridge(jiva, part, tried[jiva]) for jiva in sorted(tried)]

    tried = dict(zip(jobs, all_computed(one, jobs, threads, told), strict=True))
    best = {job: _best(some) for job, some in tried.items()}
    # one bridge lies under all strings: its place or curve is what is best for all together
    together = {part: sum(len(groups[note]) * best[note, part][2] for note in groups) for part in parts}
    common = max(parts, key=lambda part: together[part])
    if together[common] < _WORTH * together[1.0]:
        common = 1.0
    found = []
    for note, places in groups.items():
        jiva = at_note(shape.jiva_um, note)
        now = next(each for each in tried[note, 1.0] if each.jiva_um == jiva)
        bridge, near, _ = best[note, common]
        found.append(Longest(places, now, bridge, near))
    return found


def with_bridge(preset: Preset, note: int, jiva_um: float, part: float) -> Preset:
    """The preset with another thread under every string; `part` scales its place under the string of an open note, or the
    radius of a curved bridge."""
    shape = bridge_of(preset)
    changed: dict[str, Any] = {"jiva_um": jiva_um}
    if not shape.has_thread:
        changed["radius_mm"] = part * shape.radius_mm
    elif shape.distance_ratio is not None:
        changed["distance_ratio"] = part * shape.distance_ratio
    else:
        assert shape.distance_mm is not None
        changed["distance_mm"] = part * at_note(shape.distance_mm, note)
    return preset.model_copy(update={"obstacle": shape.model_copy(update=changed)})


def settings(preset: Preset, found: Sequence[Longest]) -> list[tuple[str, Any]]:
    """[(path, value)] of the preset that give each string its best thread, and all of them the proposed place or curve.
    Strings that were not asked for keep their threads."""
    shape = bridge_of(preset)
    jiva = {midi_to_note(each.opened): at_note(shape.jiva_um, each.opened) for each in places_of(preset, None, {0})}
    jiva |= {midi_to_note(each.places[0].opened): round(each.best.jiva_um, 2) for each in found}
    values: Any = next(iter(jiva.values())) if len(set(jiva.values())) == 1 else jiva
    edits: list[tuple[str, Any]] = [("obstacle.jiva_um", values)]
    part = found[0].best.part
    if part != 1.0:
        if not shape.has_thread:
            edits.append(("obstacle.radius_mm", round(part * shape.radius_mm, 1)))
        elif shape.distance_ratio is not None:
            edits.append(("obstacle.distance_ratio", round(part * shape.distance_ratio, 5)))
        else:
            assert shape.distance_mm is not None
            edits.append(("obstacle.distance_mm", _times(shape.distance_mm, part)))
    return edits


def _times(value: Scaled, part: float) -> Any:
    if isinstance(value, dict):
        return {midi_to_note(note): round(part * each, 3) for note, each in value.items()}
    return round(part * value, 3)


def _seconds(
    preset: Preset, place: FretPlace, velocity: int, place_m: float | None, quality: str, audible_db: float
) -> float:
    ready = prepare(preset, place, velocity, place_m, quality, SECONDS)
    return ready.note.buzz_seconds(ready.note.stroke.displacement_m, ready.below, audible_db)


def lines(preset: Preset, found: Sequence[Longest]) -> list[str]:
    """The proposal as text."""
    shape = bridge_of(preset)
    part = found[0].best.part
    what, gap = ("place of the thread", "thread") if shape.has_thread else ("radius of the bridge", "gap")
    text = [f"{preset.name}: longest buzz of each open string, of at most {SECONDS:g} s that are played"]
    for each in found:
        low, high = each.near
        text.append(
            f"  {each.names}: {gap} {each.now.jiva_um:g} → {each.best.jiva_um:g} µm, buzz {each.now.seconds:.2f} → "
            f"{each.best.seconds:.2f} s; at most a tenth shorter from {low:g} to {high:g} µm"
        )
    text.append(f"  {what}: {'as it is' if part == 1.0 else f'{part:g} times as large'}")
    text.append(f"  tried: {gap} from {JIVA_UM[0]:g} to {JIVA_UM[-1]:g} µm, {what} times {PARTS[0]:g} to {PARTS[-1]:g}")
    return text


def about(found: Sequence[Longest], edits: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """The proposal as plain values."""
    return {
        "place_or_radius": found[0].best.part,
        "strings": [
            {
                "strings": [place.string for place in each.places],
                "now_um": each.now.jiva_um,
                "now_s": round(each.now.seconds, 3),
                "um": each.best.jiva_um,
                "s": round(each.best.seconds, 3),
                "near_um": list(each.near),
            }
            for each in found
        ],
        "settings": dict(edits),
    }
