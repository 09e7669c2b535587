"""What lies between strokes and recordings, learned of several dynamics at once, and how far a prediction is off.

Every band has an offset and a slope over time that are the same in all recordings: body, pickup, microphone, losses of the
instrument at hand. Every recording has a gain and a shift of its onset. Whatever is predicted gets the same of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.fit.contact_features import HUBER_DB, OFFSET_DB, OFFSET_WEIGHT, huber
from synth.fit.fret_features import LEAST_WINDOWS, SECONDS, SLOPE_WINDOWS, Heard, db, first_seen, smooth

Real = NDArray[np.float64]
#: most that a band's decay may differ from the model's [dB/s]: another instrument's strings have other losses
_MOST_SLOPE = 150.0
_ROUNDS = 4


@dataclass(frozen=True)
class Learned:
    """offset_db and slope_db_s (B,), NaN where no recording tells; gains_db and loss (1: about 3 dB) of the recordings."""

    offset_db: Real
    slope_db_s: Real
    gains_db: Real
    loss: float

    def applied(self, power: Real, hop_s: float) -> Real:
        """(W, B) level of a model's powers as this instrument would be heard, but for a gain."""
        t = np.arange(power.shape[0])[:, None] * hop_s
        return np.asarray(db(power) + self.offset_db + self.slope_db_s * t)


def learn(heard: Sequence[Heard], powers: Sequence[Real]) -> Learned:
    """Of recordings and a model's powers (W, B) of each."""
    shifts = [first_seen(one, power)[0].shift for one, power in zip(heard, powers, strict=True)]
    apart = np.array([one.clean_db[s] - db(p) for one, p, s in zip(heard, powers, shifts, strict=True)])  # (R, W, B)
    counts = np.array([one.counts[s] for one, s in zip(heard, shifts, strict=True)]).astype(np.float64)
    known = (counts.sum(axis=1) >= LEAST_WINDOWS).any(axis=0)
    t = np.arange(apart.shape[1])[None, :, None] * heard[0].bands.hop_s
    gains, slope = np.zeros(len(heard)), np.zeros(apart.shape[2])
    offset = np.zeros(apart.shape[2])
    weight = counts
    for _ in range(_ROUNDS):
        rest = apart - gains[:, None, None]
        total = np.maximum(weight.sum(axis=(0, 1)), 1e-9)
        middle, mean = (weight * t).sum(axis=(0, 1)) / total, (weight * rest).sum(axis=(0, 1)) / total
        spread = (weight * (t - middle) ** 2).sum(axis=(0, 1)) + SLOPE_WINDOWS * SECONDS**2 / 12.0
        slope = np.clip((weight * (t - middle) * (rest - mean)).sum(axis=(0, 1)) / spread, -_MOST_SLOPE, _MOST_SLOPE)
        offset = mean - slope * middle
        rest = apart - offset - slope * t
        gains = (weight * rest).sum(axis=(1, 2)) / np.maximum(weight.sum(axis=(1, 2)), 1e-9)
        gains -= gains.mean()
        weight = counts / np.sqrt(1.0 + ((rest - gains[:, None, None]) / HUBER_DB) ** 2)
    learned = Learned(np.where(known, offset, np.nan), np.where(known, slope, np.nan), gains, 0.0)
    total_loss, cells = 0.0, 0
    for one, power, shift, gain in zip(heard, powers, shifts, gains, strict=True):
        left = _left(one, shift, learned.applied(power, one.bands.hop_s) + gain)[:, known]
        total_loss += float(huber(left / HUBER_DB).sum())
        cells += left.size
    beside = (offset - smooth(offset, known))[known]
    total_loss += OFFSET_WEIGHT * float(huber(beside / OFFSET_DB).sum())
    return Learned(learned.offset_db, learned.slope_db_s, gains, total_loss / max(1, cells))


def _left(heard: Heard, shift: int, level_db: Real) -> Real:
    return np.asarray(heard.level_db[shift] - db(10.0 ** (level_db / 10.0) + heard.noise))


@dataclass(frozen=True)
class Off:
    """How far a prediction is off [dB], rms: spectrum over bands (its mean over time in each), windows over every window
    of every band. gain_db: what the recording is louder by than predicted."""

    spectrum_db: float
    windows_db: float
    gain_db: float


def off(heard: Heard, level_db: Real) -> Off:
    """A predicted level (W, B) beside a recording, at the gain and the onset that suit it best. What the recording has
    above its noise counts, where the prediction says anything."""
    said = ~np.isnan(level_db).any(axis=0)
    best: tuple[float, Off] | None = None
    for shift in range(len(heard.level_db)):
        counts = heard.counts[shift] & said
        if not counts.any():
            continue
        apart = heard.clean_db[shift] - np.where(said, level_db, 0.0)
        gain, weight = 0.0, counts.astype(np.float64)
        for _ in range(_ROUNDS):
            gain = float((weight * apart).sum() / weight.sum())
            weight = counts / np.sqrt(1.0 + ((apart - gain) / HUBER_DB) ** 2)
        left = _left(heard, shift, np.where(said, level_db, 0.0) + gain)
        loss = float(huber(left[counts] / HUBER_DB).mean())
        if best is None or loss < best[0]:
            some = counts.sum(axis=0) >= LEAST_WINDOWS
            mean = (left * counts).sum(axis=0)[some] / counts.sum(axis=0)[some]
            best = loss, Off(_rms(mean), _rms(left[counts]), gain)
    if best is None:
        raise ValueError("a recording must stand out of its noise somewhere, got none that does")
    return best[1]


def _rms(x: Real) -> float:
    return float(np.sqrt(np.mean(x**2))) if x.size else float("nan")
