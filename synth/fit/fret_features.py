"""What of notes over frets is compared: levels of bands over time, as the contact fit has them, but of several strokes.

A stroke that touches nothing tells what lies between string and recording in every band in which it sounds; the others are
held to that, but for a gain of each recording. Where no such stroke sounds (buzz is brighter than all of them) a band has
an offset of its own, softly tied to a smooth trend.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.fit.contact_features import ABOVE_DB, HUBER_DB, OFFSET_DB, OFFSET_WEIGHT, ContactBands, huber
from synth.fit.contact_observed import quiet_power
from synth.fit.recording import FitRefused, RecordedNote

Real = NDArray[np.float64]
#: seconds that are compared: contact is over after a tenth of one
SECONDS = 0.75
#: a note must last that long [s]
LEAST_S = 0.9
#: shifts of the onset that are tried [s]
SHIFTS_S = np.arange(-0.009, 0.0451, 0.0015)
#: windows by which a band's offset is known
LEAST_WINDOWS = 4
#: most that a band's decay may differ from the model's [dB/s], and the windows' worth by which it is held to none
MOST_SLOPE, SLOPE_WINDOWS = 25.0, 2.0
_LOWEST = 1e-30


@dataclass(frozen=True)
class Heard:
    """Features of a recording: level_db (S, W, B) at each shift of the onset, clean_db without the noise, noise (B,) its
    power, counts (S, W, B) whether a window stands out of it."""

    bands: ContactBands
    level_db: Real
    clean_db: Real
    noise: Real
    counts: NDArray[np.bool_]

    def thinned(self) -> Heard:
        """With every other shift only."""
        chosen = slice(None, None, 2)
        return Heard(self.bands, self.level_db[chosen], self.clean_db[chosen], self.noise, self.counts[chosen])


def hear(note: RecordedNote, bands: ContactBands) -> Heard:
    """Features of a note. Raises FitRefused where it is too short."""
    seconds = note.samples.size / note.rate_hz
    if seconds < LEAST_S:
        raise FitRefused(f"the note must last at least {LEAST_S:g} s, got {seconds:.2g} s; let it ring longer")
    rate = note.rate_hz
    if note.before.size > 0.15 * rate:
        noise = bands.powers(note.before, rate, note.before.size / rate).mean(axis=0)
    else:
        noise = quiet_power(note.samples, rate, bands)
    noise = np.maximum(noise, 1e-9 * float(bands.powers(note.samples, rate, 0.2).max()))
    # `cut_note` leaves a little out before the onset
    gap = round(note.onset_s * rate) - note.before.size if note.before.size else 0
    x = np.concatenate([note.before, np.zeros(max(0, gap)), note.samples])
    onset = x.size - note.samples.size
    first = onset + np.round(SHIFTS_S * rate).astype(np.int64)
    first = first[first >= 0]
    need = math.ceil(SECONDS * rate) + 2
    power = np.array([bands.powers(x[begin : begin + need], rate, SECONDS) for begin in first])
    over = power > noise * 10.0 ** (ABOVE_DB / 10.0)
    return Heard(bands, db(power), db(np.maximum(power - noise, 0.1 * noise)), noise, over)


def db(power: Real) -> Real:
    """Level of a power."""
    return np.asarray(10.0 * np.log10(np.maximum(power, _LOWEST)))


@dataclass(frozen=True)
class BandTransfer:
    """What lies between string and recording, of bands: offset_db and slope_db_s (B,), NaN where no stroke that touches
    nothing tells; trend_db (B,) smooth, and everywhere."""

    offset_db: Real
    slope_db_s: Real
    trend_db: Real

    @property
    def known(self) -> NDArray[np.bool_]:
        return ~np.isnan(self.offset_db)


@dataclass(frozen=True)
class FretComparison:
    """loss (1: about 3 dB), shift, gain_db beside the softest stroke's, left_db (W, B) and offset_db (B,), NaN where not
    compared."""

    loss: float
    shift: int
    gain_db: float
    left_db: Real
    offset_db: Real


def first_seen(heard: Heard, power: Real) -> tuple[FretComparison, BandTransfer]:
    """A stroke that touches nothing with its model's powers (W, B): what they differ in is what lies between."""
    model = db(power)
    weight = heard.counts.astype(np.float64)
    used = heard.counts.sum(axis=1) >= LEAST_WINDOWS  # (S, B)
    offset = _mean(weight, heard.clean_db - model)
    left = _left(heard, model + offset[:, None])
    trend = np.stack([smooth(o, u) for o, u in zip(offset, used, strict=True)])
    beside = np.where(used, offset - trend, 0.0)
    rows = huber(left / HUBER_DB) * used[:, None]
    windows = model.shape[0]
    loss = rows.sum(axis=(1, 2)) + OFFSET_WEIGHT * huber(beside / OFFSET_DB).sum(axis=1)
    loss = loss / np.maximum(1, used.sum(axis=1) * windows)
    best = int(np.argmin(loss))
    found = np.where(used[best], offset[best], np.nan)
    whole = np.where(used[best], left[best], np.nan)
    slope, begun = _slopes(heard, best, model)
    between = BandTransfer(np.where(used[best], begun, np.nan), np.where(used[best], slope, np.nan), trend[best])
    return FretComparison(float(loss[best]), best, 0.0, whole, found), between


def compare(heard: Heard, power: Real, between: BandTransfer) -> FretComparison:
    """A recording with a model's powers (W, B), given what lies between."""
    known = between.known
    windows = np.arange(power.shape[0]) * heard.bands.hop_s
    model = db(power) + np.where(known, np.nan_to_num(between.slope_db_s), 0.0) * windows[:, None]
    weight = heard.counts.astype(np.float64)
    apart = heard.clean_db - model
    known_apart = (apart - np.nan_to_num(between.offset_db)).reshape(len(apart), -1, 1)
    gain = _mean((weight * known).reshape(len(apart), -1, 1), known_apart)[:, 0]
    mine = heard.counts.sum(axis=1) >= LEAST_WINDOWS  # (S, B)
    own = np.where(mine, _mean(weight, apart), between.trend_db + gain[:, None])
    offset = np.where(known, np.nan_to_num(between.offset_db) + gain[:, None], own)
    left = _left(heard, model + offset[:, None])
    used = known | mine
    beside = np.where(~known & mine, offset - between.trend_db - gain[:, None], 0.0)
    loss = (huber(left / HUBER_DB) * used[:, None]).sum(axis=(1, 2))
    loss = loss + OFFSET_WEIGHT * huber(beside / OFFSET_DB).sum(axis=1)
    loss = loss / np.maximum(1, used.sum(axis=1) * power.shape[0])
    best = int(np.argmin(loss))
    return FretComparison(
        float(loss[best]), best, float(gain[best]), np.where(used[best], left[best], np.nan),
        np.where(used[best], offset[best], np.nan),
    )  # fmt: skip


def _mean(weight: Real, apart: Real) -> Real:
    """(S, B): robust mean of (S, W, B) over windows."""
    total = np.maximum(weight.sum(axis=1), 1e-9)
    found = (weight * apart).sum(axis=1) / total
    for _ in range(3):
        robust = weight / np.sqrt(1.0 + ((apart - found[:, None]) / HUBER_DB) ** 2)
        found = (robust * apart).sum(axis=1) / np.maximum(robust.sum(axis=1), 1e-9)
    return np.asarray(found)


def _left(heard: Heard, model: Real) -> Real:
    return heard.level_db - db(10.0 ** (model / 10.0) + heard.noise)


def smooth(offset: Real, used: NDArray[np.bool_]) -> Real:
    """(B,): robust smooth part of the offsets that are used."""
    x = np.linspace(-0.5, 0.5, offset.size)
    terms = np.stack([np.ones_like(x), x, x**2], axis=1)
    some, y = terms[used], offset[used]
    if y.size < 3:
        return np.full(offset.size, float(y.mean()) if y.size else 0.0)
    weight = np.ones_like(y)
    for _ in range(4):
        scaled = some * weight[:, None]
        solved = np.linalg.solve(some.T @ scaled + 1e-9 * np.eye(3), scaled.T @ y)
        weight = 1.0 / np.sqrt(1.0 + ((some @ solved - y) / OFFSET_DB) ** 2)
    # beyond what is used a parabola leads astray: there the last value stays
    inside = np.flatnonzero(used)
    return np.asarray((terms @ solved)[np.clip(np.arange(offset.size), inside[0], inside[-1])])


def _slopes(heard: Heard, shift: int, model: Real) -> tuple[Real, Real]:
    """(B,), (B,): how much slower than the model each band decays [dB/s], and what it differs by at the onset [dB]."""
    weight = heard.counts[shift].astype(np.float64)
    t = (np.arange(model.shape[0]) * heard.bands.hop_s)[:, None]
    apart = heard.clean_db[shift] - model
    total = np.maximum(weight.sum(axis=0), 1e-9)
    middle, mean = (weight * t).sum(axis=0) / total, (weight * apart).sum(axis=0) / total
    spread = (weight * (t - middle) ** 2).sum(axis=0)
    held = SLOPE_WINDOWS * SECONDS**2 / 12.0
    slope = np.clip((weight * (t - middle) * (apart - mean)).sum(axis=0) / (spread + held), -MOST_SLOPE, MOST_SLOPE)
    return slope, mean - slope * middle
