"""What of a note is compared in the contact fit: levels of bands over time, without phases.

A band around each of the first partials, then eighths of an octave; windows of some 93 ms, half over each other. What
lies between string and recording (body, room, place and kind of the output) changes a band's level by the same at all times,
so that every band has an offset of its own. Offsets beside a smooth trend count, softly: a body is no comb. The power of the
noise is added to the model's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.physics.modes import modal_frequencies
from synth.physics.string import String

Real = NDArray[np.float64]
#: seconds that are compared, of each window, and the least number of periods in one
SECONDS, WINDOW_S, PERIODS = 2.3, 0.0929, 6.0
#: partials with a band of their own, bands in an octave above, and the highest edge [Hz]
PARTIALS, OCTAVE, HIGHEST_HZ = 24, 8, 10000.0
#: where the pseudo-Huber loss turns from square to straight [dB]
HUBER_DB = 3.0
#: a window counts for a band's offset where it stands so far above the noise [dB]
ABOVE_DB = 6.0
#: a band counts if so many windows do
LEAST_WINDOWS = 4
#: offsets beside the trend: turn [dB], and how many windows one weighs
OFFSET_DB, OFFSET_WEIGHT = 6.0, 3.0
#: shifts of the onset that are tried [s]: the finger is heard before it lets go
SHIFTS_S = np.arange(-0.009, 0.0451, 0.003)
_LOWEST = 1e-30


@dataclass(frozen=True)
class ContactBands:
    """edges_hz (B + 1,) rising; window_s and hop_s."""

    edges_hz: Real
    window_s: float

    @property
    def hop_s(self) -> float:
        return 0.5 * self.window_s

    @property
    def centres_hz(self) -> Real:
        return np.asarray(np.sqrt(self.edges_hz[1:] * self.edges_hz[:-1]))

    def powers(self, x: Real, rate_hz: float, seconds: float = SECONDS) -> Real:
        """(windows, B) mean power of a sound (n,) that begins at its onset, in each band."""
        size = round(self.window_s * rate_hz)
        starts = np.round(np.arange(self.windows(seconds)) * self.hop_s * rate_hz).astype(np.int64)
        taper = np.hanning(size + 1)[:size]
        frames = np.lib.stride_tricks.sliding_window_view(x, size)[starts] * taper
        padded = 2 ** math.ceil(math.log2(size))
        power = 2.0 * np.abs(np.fft.rfft(frames, padded)) ** 2 / np.sum(taper**2) / rate_hz
        first = np.ceil(self.edges_hz * padded / rate_hz).astype(np.int64)
        sums = np.concatenate([np.zeros((len(power), 1)), np.cumsum(power, axis=1)], axis=1)
        first = np.minimum(first, sums.shape[1] - 1)
        return np.asarray(np.diff(sums[:, first], axis=1) / padded * rate_hz)

    def windows(self, seconds: float = SECONDS) -> int:
        return max(1, int((seconds - self.window_s) / self.hop_s) + 1)


def bands_of(string: String, rate_hz: float) -> ContactBands:
    """Those of a string, up to what a recording at rate_hz holds."""
    highest = min(HIGHEST_HZ, 0.45 * rate_hz)
    hz = modal_frequencies(string, PARTIALS + 1) / (2.0 * math.pi)
    between = np.concatenate([[0.5 * hz[0]], 0.5 * (hz[1:] + hz[:-1])])
    edges = list(between[between < highest])
    while edges[-1] * 2.0 ** (1.0 / OCTAVE) < highest:
        edges.append(edges[-1] * 2.0 ** (1.0 / OCTAVE))
    return ContactBands(np.array(edges), max(WINDOW_S, PERIODS / float(hz[0])))


@dataclass(frozen=True)
class Observed:
    """Features of a recording.

    level_db   (shifts, windows, B) at each shift of the onset
    noise      (B,) power of the noise
    counts     (shifts, windows, B) whether a window stands out
    used       (B,) whether a band does
    """

    bands: ContactBands
    shifts_s: Real
    level_db: Real
    clean_db: Real
    noise: Real
    counts: NDArray[np.bool_]
    used: NDArray[np.bool_]
    trend: Real

    def first(self, windows: int) -> Observed:
        """The first windows only."""
        return Observed(
            self.bands, self.shifts_s, self.level_db[:, :windows], self.clean_db[:, :windows], self.noise,
            self.counts[:, :windows], self.used, self.trend,
        )  # fmt: skip

    @property
    def points(self) -> int:
        return int(self.used.sum()) * self.level_db.shape[1]

    def at(self, shifts: NDArray[np.int64]) -> Observed:
        """With some of the shifts only."""
        return Observed(
            self.bands, self.shifts_s[shifts], self.level_db[shifts], self.clean_db[shifts], self.noise,
            self.counts[shifts], self.used, self.trend,
        )  # fmt: skip


def observe(x: Real, rate_hz: float, onset: int, bands: ContactBands, noise: Real, seconds: float = SECONDS) -> Observed:
    """Features of a recording (n,) whose note begins about sample `onset`. noise: (B,), its power in the bands."""
    levels = []
    first = onset + np.round(SHIFTS_S * rate_hz).astype(np.int64)
    shifts = SHIFTS_S[first >= 0]
    first = first[first >= 0]
    need = math.ceil(seconds * rate_hz) + 2
    short = int(first.max(initial=0)) + need - x.size
    if short > 0:
        x = np.concatenate([x, np.zeros(short)])
    for begin in first:
        levels.append(bands.powers(x[begin : begin + need], rate_hz, seconds))
    power = np.array(levels)
    over = power > noise * 10.0 ** (ABOVE_DB / 10.0)
    used = over[0].sum(axis=0) >= LEAST_WINDOWS
    log_f = np.log(bands.centres_hz / bands.centres_hz[0])
    log_f = log_f / log_f[-1] - 0.5
    trend = np.stack([np.ones_like(log_f), log_f, log_f**2], axis=1)
    return Observed(
        bands, shifts, _db(power), _db(np.maximum(power - noise, 0.1 * noise)), noise, over, used, trend
    )  # fmt: skip


def _db(power: Real) -> Real:
    return np.asarray(10.0 * np.log10(np.maximum(power, _LOWEST)))


def huber(x: Real) -> Real:
    """Pseudo-Huber loss of what is in units of the turn: x² where small, 2|x| where large."""
    return np.asarray(2.0 * (np.sqrt(1.0 + x * x) - 1.0))


@dataclass(frozen=True)
class ContactComparison:
    """loss of the best shift, which that is, each band's offset [dB] (B,) and what is left [dB] (windows, B)."""

    loss: float
    shift: int
    offsets_db: Real
    left_db: Real


def compare(seen: Observed, power: Real, *, offset_weight: float = OFFSET_WEIGHT) -> ContactComparison:
    """A model's powers (windows, B) with a recording's; the loss is the mean over windows and bands."""
    used = seen.used
    model = _db(power[:, used])
    noise = seen.noise[used]
    clean, level, counts = seen.clean_db[:, :, used], seen.level_db[:, :, used], seen.counts[:, :, used]
    apart = clean - model
    weight = counts.astype(np.float64)
    total = np.maximum(weight.sum(axis=1), 1.0)
    offset = (weight * apart).sum(axis=1) / total
    for _ in range(3):  # a robust mean
        robust = weight / np.sqrt(1.0 + ((apart - offset[:, None]) / HUBER_DB) ** 2)
        offset = (robust * apart).sum(axis=1) / np.maximum(robust.sum(axis=1), 1e-9)
    heard = 10.0 ** ((model + offset[:, None]) / 10.0) + noise
    left = level - 10.0 * np.log10(np.maximum(heard, _LOWEST))
    loss = huber(left / HUBER_DB).sum(axis=(1, 2))
    terms = seen.trend[used]
    beside = offset - _trend(terms, offset)
    loss += offset_weight * huber(beside / OFFSET_DB).sum(axis=1)
    best = int(np.argmin(loss))
    offsets = np.full(used.size, np.nan)
    offsets[used] = offset[best]
    whole = np.full((level.shape[1], used.size), np.nan)
    whole[:, used] = left[best]
    return ContactComparison(float(loss[best]) / max(1, seen.points), best, offsets, whole)


def _trend(terms: Real, offset: Real) -> Real:
    """(shifts, B): robust smooth part of offsets (shifts, B)."""
    weight = np.ones_like(offset)
    smooth = offset
    for _ in range(3):
        normal = np.einsum("sb,bi,bj->sij", weight, terms, terms) + 1e-9 * np.eye(terms.shape[1])
        right = np.einsum("sb,bi->si", weight * offset, terms)
        smooth = np.linalg.solve(normal, right[..., None])[..., 0] @ terms.T
        weight = 1.0 / np.sqrt(1.0 + ((offset - smooth) / OFFSET_DB) ** 2)
    return smooth
