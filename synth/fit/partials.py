"""The partials of a note, followed upwards through their stretching, and the f0 and B that their frequencies share.

f_n = n f0 √(1 + B n²), n = 1 … (`physics.string`'s exact law of a pinned stiff string). (f_n/n)² is linear in n², so
that f0² and f0²B follow from weighted least squares; weights come from the standard errors of the frequencies and from
how far real partials lie beside the law (the end's mobility moves them), which is estimated from the residuals. Partials
that lie far beside it lose their weight (Huber).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from synth.fit.exponential import Bands, fit_exponential, fit_level_line
from synth.fit.pitch import Series
from synth.fit.recording import FitRefused, RecordedNote
from synth.units import LN_1000, gain_to_db

MOST_PARTIALS = 60
#: a partial must stand that far out of what surrounds it [dB]
LEAST_SNR_DB = 10.0
#: partials needed for a fit
LEAST_PARTIALS = 4
# Envelope samples beyond that are thinned out, for speed.
_MOST_SAMPLES = 3000
# Level below the partial's beginning at which it is over.
_OVER_DB = 45.0
_MISSES_IN_A_ROW = 10
# One exponential may leave that share of the envelope and still be called single.
_SINGLE_MISFIT = 0.1
# A decay whose error is a greater share of it is none: of an exponential in noise, of a line through the level; nor is
# that of a level that falls less than that.
_STEADY, _STEADY_LINE = 0.12, 0.25
# A partial of which an exponential leaves more than that has beats deeper than its decay.
_MOST_MISFIT = 0.6
_LEAST_RANGE_DB = 10.0


@dataclass(frozen=True)
class MeasuredPartial:
    """One partial as measured.

    hz, hz_error            frequency and its standard error: the exponential's, or the average over the time of that line
    level_db                amplitude at the onset [dB re full scale], and its error [dB]
    decay, decay_error      σ [1/s], amplitude e^(−σt): of the exponential of maximum likelihood where it leaves no more
                            than noise, else of the line through the level from −3 to −33 dB
    snr_db                  of its envelope against what surrounds it
    misfit                  share of the envelope (rms) that one exponential leaves: beating, a decay in stages, noise
    single                  whether that is no more than the noise explains
    steady                  whether it has one decay time at all: its level falls along a line that depends little on
                            where it begins and ends
    """

    number: int
    hz: float
    hz_error: float
    level_db: float
    level_error_db: float
    decay: float
    decay_error: float
    snr_db: float
    misfit: float
    single: bool
    steady: bool

    @property
    def t60_s(self) -> float:
        """ln(1000)/σ [s]."""
        return LN_1000 / self.decay


@dataclass(frozen=True)
class Stretch:
    """f0 [Hz] and B with standard errors; spread_cents: how far (rms) partials lie beside their law beyond their errors."""

    f0_hz: float
    inharmonicity: float
    f0_error_cents: float
    inharmonicity_error: float
    spread_cents: float

    def frequencies_hz(self, numbers: NDArray[np.int64] | int) -> NDArray[np.float64]:
        n = np.asarray(numbers, dtype=np.float64)
        return n * self.f0_hz * np.sqrt(1.0 + self.inharmonicity * n * n)


def measure_partials(
    note: RecordedNote, series: Series, done: Callable[[float], None] = lambda _: None, most: int = MOST_PARTIALS
) -> tuple[list[MeasuredPartial], Stretch]:
    """The partials that stand out, up to number `most`, and what their frequencies say.

    done(0 … 1) is called before each of them.  Raises FitRefused with fewer than four."""
    try:
        bands = Bands(note.samples, note.rate_hz, series.f0_hz)
    except ValueError as error:
        raise FitRefused(f"{error}; record one pluck and let it ring") from None
    stretch = Stretch(series.f0_hz, series.inharmonicity, 0.0, 0.0, 0.0)
    found: list[MeasuredPartial] = []
    missed = 0
    for n in range(1, most + 1):
        done((n - 1) / most)
        if len(found) >= 3:
            stretch = _quick_stretch(found, stretch)
        expected = float(stretch.frequencies_hz(n))
        if expected + series.f0_hz > 0.47 * note.rate_hz:
            break
        partial = _measure(bands, note, n, expected)
        if partial is None:
            missed += 1
            if missed >= _MISSES_IN_A_ROW and n > 12:
                break
            continue
        missed = 0
        found.append(partial)
    if len(found) < LEAST_PARTIALS:
        raise FitRefused(
            f"only {len(found)} partial{'' if len(found) == 1 else 's'} of {series.f0_hz:.4g} Hz stand out of the noise, "
            f"a string's inharmonicity needs {LEAST_PARTIALS}; is it a plucked string?"
        )
    return found, fit_stretch(found)


def _measure(bands: Bands, note: RecordedNote, number: int, expected_hz: float) -> MeasuredPartial | None:
    t, y = bands.envelope(expected_hz)
    noise = _noise_beside(bands, expected_hz)
    over = _end(t, y, noise)
    t, y = t[:over], y[:over]
    thin = max(1, t.size // _MOST_SAMPLES)
    step = (t[1] - t[0]) * thin if t.size > 1 else 1.0
    # The window makes neighbours alike: about half its length apart they are independent.
    correlated = max(1.0, 0.5 * bands.length / bands.rate_hz / step)
    fit = fit_exponential(t[::thin], y[::thin], correlated)
    if fit is None or abs(fit.shift_hz) > 0.3 * bands.spacing_hz:
        return None
    rms = float(np.sqrt(np.mean(np.abs(y) ** 2)))
    snr = gain_to_db(max(rms, 1e-30) / max(noise, 1e-12 * rms, 1e-30))
    if snr < LEAST_SNR_DB or fit.misfit > 0.9:
        return None
    single = fit.misfit < max(_SINGLE_MISFIT, 2.5 * min(1.0, 10.0 ** (-snr / 20.0)))
    line = fit_level_line(t, y, noise)
    if single or line is None:
        shift, shift_error = fit.shift_hz, fit.shift_error_hz
        level = gain_to_db(fit.amplitude / bands.gain(fit.decay))
        level_error = gain_to_db(1.0 + fit.amplitude_error / fit.amplitude)
        # What the noise does not explain may be a slow change that looks like decay over a short piece.
        wobble = max(0.0, fit.misfit - 1.5 * min(1.0, 10.0 ** (-snr / 20.0)))
        decay, decay_error = fit.decay, fit.decay_error + 3.0 * wobble / (fit.end_s - fit.begin_s)
        steady = single
    else:
        shift, shift_error = line.shift_hz, line.shift_error_hz
        level, level_error = line.level_db - gain_to_db(bands.gain(line.decay)), line.roughness_db
        decay, decay_error = line.decay, line.decay_error
        decay_error = decay_error if line.range_db > _LEAST_RANGE_DB else math.inf
        steady = fit.misfit < _MOST_MISFIT
    steady = steady and decay > 0.0 and decay_error < (_STEADY if single else _STEADY_LINE) * decay
    return MeasuredPartial(
        number, expected_hz + shift, shift_error, level, level_error, decay, decay_error, snr, fit.misfit, single, steady
    )


def _noise_beside(bands: Bands, expected_hz: float) -> float:
    """rms of the envelope of what lies between this partial and its neighbours, late in the note."""
    levels = []
    for side in (-0.5, 0.5):
        t, y = bands.beside(expected_hz + side * bands.spacing_hz)
        late = np.abs(y[t.size // 2 :])
        if late.size:
            levels.append(float(np.median(late)) / math.sqrt(math.log(2.0)))
    return min(levels) if levels else 0.0


def _end(t: NDArray[np.float64], y: NDArray[np.complex128], noise: float) -> int:
    """How many samples of an envelope to use: until it is over or has gone down into the noise for good."""
    if t.size < 8:
        return t.size
    magnitude = np.abs(y)
    top = magnitude[: max(8, t.size // 3)].max()
    floor = max(top * 10.0 ** (-_OVER_DB / 20.0), 1.5 * noise)
    # Noise alone rises above now and then, beating falls below: over is where most of the next tenth of a second is below.
    ahead = min(t.size, max(10, round(0.1 / (t[1] - t[0]))))
    below = np.concatenate([[0], np.cumsum(magnitude <= floor)])
    over = np.flatnonzero(below[ahead:] - below[:-ahead] > 0.8 * ahead)
    return max(8, int(over[0]) + ahead // 10 if over.size else t.size)


def _quick_stretch(found: list[MeasuredPartial], before: Stretch) -> Stretch:
    """The law so far, to look for the next partial; B is left alone until enough of them are there."""
    if len(found) < 6:
        f = float(np.median([p.hz / float(before.frequencies_hz(p.number)) for p in found]))
        return replace(before, f0_hz=before.f0_hz * f)
    return fit_stretch(found)


def fit_stretch(found: list[MeasuredPartial], rounds: int = 12) -> Stretch:
    """f0 and B ≥ 0 of measured partials by iterated weighted least squares."""
    n = np.array([p.number for p in found], dtype=np.float64)
    f = np.array([p.hz for p in found])
    error = np.maximum(np.array([p.hz_error for p in found]) / f, 1e-7)  # relative
    spread = 0.0
    robust = np.ones(n.size)
    f0, b = float(f[0] / n[0]), 0.0
    design_covariance = np.eye(2)
    for _ in range(rounds):
        variance = error**2 + spread**2
        # ln f = ln f0 + ln n + ½ ln(1 + Bn²): Gauss–Newton in (ln f0, B)
        design = np.stack([np.ones_like(n), 0.5 * n**2 / (1.0 + b * n**2)], axis=1)
        left = np.log(f / n / f0) - 0.5 * np.log1p(b * n**2)
        weight = robust / variance
        normal = design.T @ (weight[:, None] * design)
        design_covariance = np.linalg.inv(normal)
        step = design_covariance @ (design.T @ (weight * left))
        if b + step[1] < 0.0:
            step = np.array([float(weight @ (np.log(f / n / f0))) / float(weight.sum()), -b])
        f0, b = f0 * math.exp(step[0]), b + float(step[1])
        left = np.log(f / n / f0) - 0.5 * np.log1p(b * n**2)
        size = 1.4826 * float(np.median(np.abs(left))) * math.sqrt(n.size / max(1.0, n.size - 2.0))
        spread = math.sqrt(max(0.0, size**2 - float(np.median(error)) ** 2))
        scale = np.sqrt(error**2 + spread**2)
        robust = np.minimum(1.0, 2.0 * scale / np.maximum(np.abs(left), 1e-15))
    to_cents = 1200.0 / math.log(2.0)
    return Stretch(
        f0,
        b,
        to_cents * math.sqrt(design_covariance[0, 0]),
        math.sqrt(design_covariance[1, 1]),
        to_cents * spread,
    )
