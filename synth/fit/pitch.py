"""The pitch of a note: the stretched harmonic series that explains the peaks of its spectrum.

Candidates are the strong peaks divided by small numbers. Each is followed upwards through its stretching, and judged by
how much of the peaks it explains and how many of its own low partials are there, so that neither half nor double the
pitch wins. What the best series leaves unexplained, if it makes a series of its own, is a second note.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from synth.dsp.measures import spectrum
from synth.fit.recording import HIGHEST_HZ, LOWEST_HZ, FitRefused, RecordedNote, refuse_slow

#: the part of the note whose spectrum is looked at, from a little after its onset
BEGIN_S, SPAN_S = 0.02, 1.2
_MOST_PEAKS = 90
_DEPTH_DB = 55.0
_ABOVE_FLOOR_DB = 14.0
_MOST_PARTIALS = 60
_MOST_INHARMONICITY = 0.01
# Peaks above that re the highest that are none of the series' are another sound's.
_STRANGE_DB = -15.0


@dataclass(frozen=True)
class Series:
    """A stretched series: numbers (m,) of the partials found, their frequencies (m,) [Hz], and how good it is.

    explained: share of the weight of all peaks.  filled: share of the first partials found.
    """

    f0_hz: float
    inharmonicity: float
    numbers: NDArray[np.int64]
    frequencies_hz: NDArray[np.float64]
    explained: float
    filled: float

    @property
    def first_partial_hz(self) -> float:
        """f0·√(1 + B), the pitch that is heard [Hz]."""
        return self.f0_hz * math.sqrt(1.0 + self.inharmonicity)

    @property
    def score(self) -> float:
        return self.explained * (0.4 + 0.6 * self.filled)


@dataclass(frozen=True)
class Peaks:
    """Peaks of a spectrum: frequencies (m,) [Hz], levels (m,) [dB re the highest], weights (m,), and one bin [Hz]."""

    frequencies_hz: NDArray[np.float64]
    levels_db: NDArray[np.float64]
    weights: NDArray[np.float64]
    resolution_hz: float


def find_series(note: RecordedNote, expected_hz: float | None = None, *, moved_cents: float = 0.0) -> Series:
    """The series of a note. expected_hz: its pitch within half an octave, if it is known. moved_cents: by so much a contact
    may move a partial beside the series, and what lies within is no second note's. Raises FitRefused."""
    begin = round(BEGIN_S * note.rate_hz)
    x = note.samples[begin : begin + round(SPAN_S * note.rate_hz)]
    peaks = spectral_peaks(x, note.rate_hz)
    if peaks.frequencies_hz.size == 0:
        refuse_slow(note.samples, note.rate_hz)
        raise FitRefused("no partials stand out of the noise; record a single plucked string, louder")
    best = best_series(peaks, expected_hz)
    if best is None:
        refuse_slow(note.samples, note.rate_hz)
        hint = "" if expected_hz is None else f" near {expected_hz:.4g} Hz"
        raise FitRefused(f"no pitch was found{hint}: the spectrum has no series of partials; record a single plucked string")
    _refuse_second_note(peaks, best, moved_cents)
    return best


def spectral_peaks(x: NDArray[np.float64], rate_hz: float) -> Peaks:
    """Peaks that stand out of their surroundings, strongest first."""
    frequencies, amplitude = spectrum(x, rate_hz)
    top = np.searchsorted(frequencies, min(0.45 * rate_hz, 12000.0))
    frequencies, amplitude = frequencies[:top], amplitude[:top]
    level = 20.0 * np.log10(np.maximum(amplitude, 1e-12))
    resolution = rate_hz / x.size
    floor = _floor_db(level, max(3, round(100.0 / frequencies[1])))
    here = np.arange(1, level.size - 1)
    is_peak = (level[here] >= level[here - 1]) & (level[here] > level[here + 1])
    is_peak &= (frequencies[here] > 0.8 * LOWEST_HZ) & (frequencies[here] > 3.0 * resolution)
    is_peak &= level[here] > floor[here] + _ABOVE_FLOOR_DB
    chosen = here[is_peak]
    if chosen.size == 0:
        return Peaks(np.zeros(0), np.zeros(0), np.zeros(0), resolution)
    chosen = chosen[level[chosen] > level[chosen].max() - _DEPTH_DB]
    # A peak within the main lobe of a higher one (4 bins to each side) is a sidelobe or noise on its flank.
    order = chosen[np.argsort(-level[chosen], kind="stable")]
    kept: list[int] = []
    for i in order:
        if all(abs(frequencies[i] - frequencies[j]) > 5.0 * resolution for j in kept):
            kept.append(int(i))
        if len(kept) == _MOST_PEAKS:
            break
    at = np.array(kept)
    a, b, c = level[at - 1], level[at], level[at + 1]
    curvature = np.minimum(a - 2.0 * b + c, -1e-9)
    shift = np.clip(0.5 * (a - c) / curvature, -0.5, 0.5)
    found = frequencies[at] + shift * (frequencies[1] - frequencies[0])
    relative = level[at] - level[at].max()
    return Peaks(found, relative, 1.0 + relative / (_DEPTH_DB + 5.0), resolution)


def _floor_db(level: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Median level in blocks of `width` bins, interpolated."""
    blocks = max(1, level.size // width)
    edges = np.linspace(0, level.size, blocks + 1).astype(int)
    middle = 0.5 * (edges[1:] + edges[:-1])
    median = np.array([np.median(level[a:b]) for a, b in pairwise(edges)])
    return np.interp(np.arange(level.size), middle, median)


def best_series(peaks: Peaks, expected_hz: float | None = None) -> Series | None:
    """The series with the highest score, refined; of several nearly as good the highest in pitch."""
    low, high = LOWEST_HZ, HIGHEST_HZ
    if expected_hz is not None:
        low, high = max(low, expected_hz / 2**0.5), min(high, expected_hz * 2**0.5)
    candidates = {
        round(float(f) / k, 3)
        for f in peaks.frequencies_hz[:14]
        for k in range(1, 13)
        if low <= f / k <= high and f / k > 2.5 * peaks.resolution_hz
    }
    series = [s for s in (follow(peaks, f0) for f0 in sorted(candidates)) if s is not None]
    if not series:
        return None
    top = max(s.score for s in series)
    return max((s for s in series if s.score >= 0.93 * top), key=lambda s: (round(np.log2(s.f0_hz), 1), s.score))


def follow(peaks: Peaks, f0_hz: float) -> Series | None:
    """The series that starts from a guess of its fundamental, followed upwards; None with fewer than two partials."""
    order = np.argsort(peaks.frequencies_hz)
    frequencies, weights = peaks.frequencies_hz[order], peaks.weights[order]
    # Levels fade upwards: what is no longer to be expected is not missing.
    strongest = frequencies[-1]
    numbers: list[int] = []
    found: list[float] = []
    taken = np.zeros(frequencies.size, dtype=bool)
    f0, b = f0_hz, 0.0
    n = 0
    while n < _MOST_PARTIALS:
        n += 1
        expected = n * f0 * np.sqrt(1.0 + b * n * n)
        if expected > strongest + 0.5 * f0:
            break
        slack = max(1.5 * peaks.resolution_hz, 0.03 * f0 if n > 2 else 0.02 * n * f0)
        slack = min(slack, 0.2 * f0)
        if not found:
            slack = min(slack, max(1.5 * peaks.resolution_hz, 0.01 * expected))
        near = np.flatnonzero(np.abs(frequencies - expected) < slack)
        if near.size == 0:
            continue
        at = int(near[np.argmax(weights[near])])
        taken[at] = True
        numbers.append(n)
        found.append(float(frequencies[at]))
        if len(found) >= 2:
            f0, b = stretched(np.array(numbers), np.array(found))
    if len(found) < 2:
        return None
    # Peaks right beside a partial belong to it: pairs by beating, noise on its flanks.
    numbers_array, found_array = np.array(numbers), np.array(found)
    every = np.arange(1, int(strongest / f0) + 2)
    places = every * f0 * np.sqrt(1.0 + b * every**2)
    beside = np.abs(frequencies[:, None] - places[None, :]).min(axis=1) < np.minimum(3.0 * peaks.resolution_hz, 0.12 * f0)
    explained = float(weights[taken | beside].sum() / weights.sum())
    reach = min(12, max(3, int(numbers_array.max())))
    filled = float(np.count_nonzero(numbers_array <= reach) / reach)
    return Series(f0, b, numbers_array, found_array, explained, filled)


def stretched(numbers: NDArray[np.int64], frequencies_hz: NDArray[np.float64]) -> tuple[float, float]:
    """(f0, B) of (f/n)² = f0²(1 + Bn²) by least squares; partials count by their number, 0 ≤ B ≤ a hundredth."""
    x = numbers.astype(float) ** 2
    y = (frequencies_hz / numbers) ** 2
    w = numbers.astype(float) ** 2 / y  # an error of the frequency moves y by 2/n
    mean_x, mean_y = float(w @ x / w.sum()), float(w @ y / w.sum())
    spread = float(w @ (x - mean_x) ** 2)
    slope = float(w @ ((x - mean_x) * (y - mean_y))) / spread if spread > 0.0 else 0.0
    base = mean_y - slope * mean_x
    if slope <= 0.0 or base <= 0.0 or len(numbers) < 4:
        return float(np.sqrt(mean_y)), 0.0
    if slope / base > _MOST_INHARMONICITY:
        return float(np.sqrt(mean_y / (1.0 + _MOST_INHARMONICITY * mean_x))), _MOST_INHARMONICITY
    return float(np.sqrt(base)), slope / base


def _refuse_second_note(peaks: Peaks, best: Series, moved_cents: float = 0.0) -> None:
    """Refuses what holds two notes: a second series in what is left, or two that share a lower one."""
    numbers = set(best.numbers.tolist())
    strong = {
        int(n)
        for n, f in zip(best.numbers, best.frequencies_hz, strict=True)
        if n <= 12 and peaks.levels_db[np.argmin(np.abs(peaks.frequencies_hz - f))] > -35.0
    }
    if 1 not in numbers and len(strong) >= 3:
        for a in range(2, 7):
            for b in range(a + 1, 8):
                if (
                    all(n % a == 0 or n % b == 0 for n in strong)
                    and any(n % b for n in strong)
                    and any(n % a for n in strong)
                ):
                    raise FitRefused(
                        f"two notes sound, near {a * best.f0_hz:.4g} and {b * best.f0_hz:.4g} Hz; record one string alone"
                    )
    every = np.arange(1, _MOST_PARTIALS + 1)
    places = every * best.f0_hz * np.sqrt(1.0 + best.inharmonicity * every**2)
    apart = np.abs(peaks.frequencies_hz[:, None] - places[None, :])
    distance, place = apart.min(axis=1), places[apart.argmin(axis=1)]
    slack = np.maximum(max(3.0 * peaks.resolution_hz, 0.03 * best.f0_hz), place * (2.0 ** (moved_cents / 1200.0) - 1.0))
    left = distance > np.minimum(slack, 0.2 * best.f0_hz)
    rest = Peaks(peaks.frequencies_hz[left], peaks.levels_db[left], peaks.weights[left], peaks.resolution_hz)
    other = best_series(rest) if np.count_nonzero(left) >= 3 else None
    share = 0.0 if other is None else float(rest.weights.sum() / peaks.weights.sum()) * other.explained
    series = other is not None and other.numbers.size >= 4 and other.filled >= 0.5
    if other is not None and series and share > 0.2 and rest.levels_db.max() > -25.0:
        raise FitRefused(
            f"two notes sound, near {best.f0_hz:.4g} and {other.f0_hz:.4g} Hz; record one string alone, the others damped"
        )
    strange = sorted(rest.frequencies_hz[rest.levels_db > _STRANGE_DB])
    if len(strange) > 1:
        raise FitRefused(
            f"{len(strange)} strong partials, such as {strange[0]:.4g} and {strange[1]:.4g} Hz, do not belong to a string "
            f"of {best.f0_hz:.4g} Hz; record one plucked string alone"
        )
