"""Ours against the ranges, and the tables of it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping

import numpy as np

from truth_of_sound import hand, measure
from truth_of_sound.ours import BASS_NOTES, LOUD, RATE_HZ, SOFT, VELOCITIES, Player, measured
from truth_of_sound.ranges import WANTED, Range

LABELS = {
    "decay_ratio": "T60(13–20) / T60(2–5)",
    "t60_1": "T60, partial 1 [s]",
    "t60_2_5": "T60, partials 2–5 [s]",
    "t60_6_12": "T60, partials 6–12 [s]",
    "t60_13_20": "T60, partials 13–20 [s]",
    "beating_db": "beating of strong partials ≤ 6 [dB]",
    "inharmonicity": "B",
    "tilt_db_octave": "tilt [dB/oct]",
    "glide_cents": "glide at 0.1 s [cents]",
    "level_rise_db": "level, soft to loud [dB]",
    "tilt_rise_db_octave": "tilt, soft to loud [dB/oct]",
    "takes_apart_db": "the same note twice, apart [dB]",
    "release_ms": "release to −20 dB [ms]",
    "release_low_ms": "release, 30–250 Hz [ms]",
    "release_middle_ms": "release, 250–1000 Hz [ms]",
    "release_high_ms": "release, 1–4 kHz [ms]",
    "burst_peak_ms": "slap: burst's peak after the onset [ms]",
    "burst_20db_ms": "slap: burst to −20 dB [ms]",
    "fundamental_db": "touched harmonic: fundamental against the strongest [dB]",
}

#: measures by velocity: {velocity: [of each note]}
ByVelocity = dict[int, list[dict[str, float]]]


def bass(player: Player) -> ByVelocity:
    """Six notes, soft to loud."""
    return {velocity: [measured(player, note, velocity) for note in BASS_NOTES] for velocity in VELOCITIES}


def values(found: ByVelocity, name: str) -> list[float]:
    """One measure of all notes that have it."""
    return [each[name] for notes in found.values() for each in notes if name in each]


def share(found: ByVelocity, name: str, reference: Range) -> float:
    """How many of the notes lie within the range; a note that has no such measure does not."""
    inside = reference.inside(values(found, name)) if values(found, name) else 0.0
    return inside * len(values(found, name)) / sum(len(notes) for notes in found.values())


def hands(player: Player, found: ByVelocity) -> dict[str, list[float]]:
    """{measure: values by note} of what the normal stroke and the release do; found: what `bass` gave."""
    out: dict[str, list[float]] = defaultdict(list)
    for number, soft, loud in zip(BASS_NOTES, found[SOFT], found[LOUD], strict=True):
        for key, value in hand.rise(soft, loud).items():
            out[key].append(value)
        if "glide_cents" in loud:
            out["glide_cents"].append(loud["glide_cents"])
        takes = [measure.cut(player.note(number, 80, 0.5, before=k), RATE_HZ) for k in range(2)]
        out["takes_apart_db"].append(measure.takes_apart_db(*takes, loud["f0_hz"]))
        for key, value in measure.release(player.note(number, 80, 1.2, off_s=0.5), RATE_HZ, 0.5).items():
            out[key].append(value)
    return dict(out)


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _number(value: float) -> str:
    return f"{value:.1e}" if 0.0 < abs(value) < 1e-3 else f"{value:.3g}"


def _table(head: list[str], rows: list[list[str]]) -> str:
    return "\n".join([_row(head), _row(["---"] * len(head)), *map(_row, rows)]) + "\n"


def admission_table(of_bass: Mapping[str, Range]) -> str:
    """Each measure's range and how far real sets pass among each other."""
    rows = [
        [LABELS[name], f"{_number(r.low)} – {_number(r.high)}", f"{r.inside_mean:.2f}", f"{r.inside_worst:.2f} ({r.worst})",
         "yes" if r.admitted else "no"]
        for name, r in of_bass.items()
    ]  # fmt: skip
    return _table(["measure", "range of recordings", "real sets within the others'", "worst", "counts"], rows)


def table(found: ByVelocity, of_bass: Mapping[str, Range]) -> str:
    """Ours beside the ranges."""
    rows = []
    for name, reference in of_bass.items():
        part = share(found, name, reference)
        medians = ["–" if not (v := values({k: found[k]}, name)) else _number(float(np.median(v))) for k in found]
        verdict = ("inside" if part >= WANTED else "OUTSIDE") if reference.admitted else "for comparison"
        span = f"{_number(reference.low)} – {_number(reference.high)}"
        rows.append([LABELS[name], " / ".join(medians), span, f"{part:.2f}", verdict])
    return _table(["measure", f"ours, velocity {' / '.join(map(str, found))}", "real", "notes inside", ""], rows)


def hand_table(found: Mapping[str, list[float]], of_hand: Mapping[str, Mapping[str, float]]) -> str:
    """Ours beside single values of recordings: median and extremes."""

    def span(numbers: list[float]) -> str:
        if not numbers:
            return "–"
        return f"{_number(float(np.median(numbers)))} ({_number(min(numbers))} – {_number(max(numbers))})"

    names = [name for name in LABELS if name in found or name in of_hand]
    rows = [[LABELS[name], span(found.get(name, [])), span(list(of_hand.get(name, {}).values()))] for name in names]
    return _table(["", "ours", "real"], rows)
