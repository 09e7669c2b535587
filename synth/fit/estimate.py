"""A plucked string out of a recording: fundamental, inharmonicity, losses, place of plucking.

Steps: `recording` (one note of one channel), `pitch` (which series), `exponential` and `partials` (each partial's
frequency, decay and level; f0 and B), `losses`, `pluck`. What is not one plucked string is refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from synth.fit.losses import Losses, fit_losses
from synth.fit.partials import MeasuredPartial, Stretch, measure_partials
from synth.fit.pitch import find_series
from synth.fit.pluck import CLEAR_DB, FittedPluck, fit_pluck
from synth.fit.recording import FitCancelled, FitRefused, Progress, RecordedNote, cut_note
from synth.units import LN_1000, cents, gain_to_db

#: partials further from the law, in frequency [cents] and in decay time [relative], are the string's own: as measured
LAW_CENTS, LAW_T60 = 1.5, 0.1
#: how many partials the fit answers for
JUDGED = 10
# What lies further from the law than that is not the string's partial; too many of these, and it is no string.
_MOST_SPREAD_CENTS = 20.0
# Less of the note than that explained by the partials, and it is not one string.
_LEAST_EXPLAINED = 0.6
# Decay rates further (rms) beside the loss law are worth a word.
_LOSS_SPREAD = 0.25
# With fewer steady ones of the first partials than that B must at least be above its error.
_FEW = 6
# Decay times of a plucked string [s].
_LONGEST_T60_S = 120.0
# The decay of an exponential in noise is taken from the law where its error is greater than that.
_STEADY_NOISE = 0.12


@dataclass(frozen=True)
class Partial:
    """One partial of the fitted string: hz and t60_s are the fit's answer, `measured` what it was made from.

    hz_by_law, t60_s_by_law: of f0, B and the loss law.  source: "measured", or "law" where the recording does not tell.
    cents: the law against the measured frequency, None where that is missing.
    """

    number: int
    hz: float
    t60_s: float
    hz_by_law: float
    t60_s_by_law: float
    frequency_source: str
    decay_source: str
    cents: float | None
    measured: MeasuredPartial | None

    @property
    def level_db(self) -> float | None:
        """Level as measured, None where it was not."""
        return None if self.measured is None else self.measured.level_db


@dataclass(frozen=True)
class Fit:
    """A plucked string as a recording tells it, made by `fit_recording`.

    Attributes
    ----------
    f0_hz : float
        Fundamental of the string without stiffness, √(T/μ)/2L [Hz]; partial n is at n f0 √(1 + B n²).
    inharmonicity : float
        B.
    stretch, losses : Stretch, Losses
        The fits of frequencies and of decay rates with their errors (`synth.fit.partials`, `synth.fit.losses`).
    pluck : FittedPluck or None
        Where the string was plucked, as far as levels tell (`synth.fit.pluck`).
    partials : tuple of Partial
        1 … ten and more.
    onset_s, duration_s : float
        Where in the recording the note begins, and how much of it was looked at [s].
    rate_hz : float
        Of the recording [Hz].
    peak_dbfs, noise_floor_dbfs : float
        Largest sample and noise of the recording [dB].
    snr_db : float
        Of the partials against what lies between them [dB].
    explained : float
        Share of the note's energy that the partials explain, up to 1.
    warnings : tuple of str
        Where the model does not fit, in words.

    Examples
    --------
    >>> import numpy as np
    >>> import synth
    >>> t = np.arange(44100) / 22050
    >>> note = sum(np.exp(-(1 + 0.1 * n) * t) * np.sin(2 * np.pi * 110 * n * t) / n for n in range(1, 21))
    >>> fit = synth.fit_recording(0.1 * note, 22050.0)
    >>> fit.explained > 0.99, len(fit.partials) >= 10
    (True, True)
    """

    f0_hz: float
    inharmonicity: float
    stretch: Stretch
    losses: Losses
    pluck: FittedPluck | None
    partials: tuple[Partial, ...]
    onset_s: float
    duration_s: float
    rate_hz: float
    peak_dbfs: float
    noise_floor_dbfs: float
    snr_db: float
    explained: float
    warnings: tuple[str, ...]

    @property
    def first_partial_hz(self) -> float:
        """f0 √(1 + B) [Hz]: what is heard as the pitch."""
        return float(self.stretch.frequencies_hz(1))


def fit_recording(
    samples: ArrayLike, rate_hz: float, *, expected_hz: float | None = None, progress: Progress = lambda _: True
) -> Fit:
    """Finds the plucked string in a recording: pitch, inharmonicity, losses, place of plucking.

    `synth.fit` makes settings of a preset from it (`settings`, `apply_settings`) and plain data for people (`report`).

    Parameters
    ----------
    samples : (n,) or (n, channels) array
        The recording, full scale 1: a single pluck, ringing for two seconds or more.
    rate_hz : float
        Samples a second [Hz].
    expected_hz : float, optional
        Its pitch within half an octave, where it is known [Hz].
    progress : callable
        Told after every stage and partial how much is done (0 … 1); where it returns False, FitCancelled is raised.

    Returns
    -------
    Fit
        The string and how far the recording bears it out.

    Raises
    ------
    FitRefused
        With the reason (a ValueError): silence, too short, clipped, noise, two notes, no pitch, a pitch that moves, a sound
        that does not decay.
    synth.fit.FitCancelled
        Where `progress` returned False.

    Examples
    --------
    >>> import numpy as np
    >>> import synth
    >>> t = np.arange(44100) / 22050
    >>> note = sum(np.exp(-(1 + 0.1 * n) * t) * np.sin(2 * np.pi * 110 * n * t) / n for n in range(1, 21))
    >>> round(synth.fit_recording(0.1 * note, 22050.0).f0_hz, 2)
    110.0
    """
    if expected_hz is not None and not (math.isfinite(expected_hz) and expected_hz > 0.0):
        raise FitRefused(f"expected_hz must be > 0 Hz, got {expected_hz}")

    def done(share: float) -> None:
        if not progress(share):
            raise FitCancelled

    done(0.0)
    note = cut_note(samples, float(rate_hz))
    done(0.1)
    series = find_series(note, expected_hz)
    done(0.2)
    found, stretch = measure_partials(note, series, lambda share: done(0.2 + 0.6 * share))
    explained = _explained(note, found)
    _refuse_what_is_no_string(found, stretch, explained, series.f0_hz)
    found = [p for p in found if abs(_off(stretch, p)) < _MOST_SPREAD_CENTS]
    losses = fit_losses(found, stretch)
    done(0.9)
    pluck = fit_pluck(
        np.array([p.number for p in found]),
        np.array([p.level_db for p in found]),
        np.array([p.level_error_db for p in found]),
    )
    partials = _partials(found, stretch, losses)
    snr = 10.0 * math.log10(float(np.mean([10.0 ** (p.snr_db / 10.0) for p in found])))
    noise = _noise_floor_dbfs(note, found)
    return Fit(
        stretch.f0_hz,
        stretch.inharmonicity,
        stretch,
        losses,
        pluck,
        partials,
        note.onset_s,
        note.samples.size / note.rate_hz,
        note.rate_hz,
        note.peak_dbfs,
        noise,
        snr,
        explained,
        (*note.warnings, *_warnings(found, stretch, losses, pluck, explained)),
    )


def _partials(found: list[MeasuredPartial], stretch: Stretch, losses: Losses) -> tuple[Partial, ...]:
    by_number = {p.number: p for p in found}
    count = max(JUDGED, max(by_number))
    law_hz = stretch.frequencies_hz(np.arange(1, count + 1))
    law_t60 = LN_1000 / np.maximum(losses.decay_rates(stretch, count), 1e-9)
    result = []
    for n in range(1, count + 1):
        p = by_number.get(n)
        hz, t60 = float(law_hz[n - 1]), float(law_t60[n - 1])
        offset = None if p is None else _off(stretch, p)
        own_hz = p is not None and offset is not None and abs(offset) > LAW_CENTS
        own_t60 = p is not None and _beside_law(p, t60)
        result.append(
            Partial(
                n,
                p.hz if p is not None and own_hz else hz,
                p.t60_s if p is not None and own_t60 else t60,
                hz,
                t60,
                "measured" if own_hz else "law",
                "measured" if own_t60 else "law",
                offset,
                p,
            )
        )
    return tuple(result)


def _off(stretch: Stretch, p: MeasuredPartial) -> float:
    """The law's frequency above the measured one [cents]."""
    return cents(float(stretch.frequencies_hz(p.number)), p.hz)


def _beside_law(p: MeasuredPartial, t60_s: float) -> bool:
    """Whether a partial's decay is told by the recording, and is not the law's."""
    if p.decay <= 0.0 or p.decay_error > (_STEADY_NOISE if p.single else 1.0) * p.decay:
        return False
    # A clean exponential errs as its noise says; what beats is what it is.
    slack = max(LAW_T60, 2.0 * p.decay_error / p.decay) if p.single else LAW_T60
    return abs(t60_s / p.t60_s - 1.0) > slack


def _model(found: list[MeasuredPartial], t: NDArray[np.float64], x: NDArray[np.float64]) -> float:
    """Share of x explained by the best combination of the measured damped sinusoids."""
    columns = []
    for p in found:
        e = np.exp((2j * np.pi * p.hz - max(p.decay, 0.0)) * t)
        columns += [e.real, e.imag]
    design = np.stack(columns, axis=1)
    coefficients = np.linalg.lstsq(design.T @ design, design.T @ x, rcond=1e-9)[0]
    left = x - design @ coefficients
    return 1.0 - float(left @ left) / max(float(x @ x), 1e-300)


def _explained(note: RecordedNote, found: list[MeasuredPartial]) -> float:
    """Of a quarter of a second a little behind the onset."""
    begin, count = round(0.05 * note.rate_hz), round(0.25 * note.rate_hz)
    x = note.samples[begin : begin + count]
    x = x[:12000]
    t = (begin + np.arange(x.size)) / note.rate_hz
    return _model(found, t, x)


def _noise_floor_dbfs(note: RecordedNote, found: list[MeasuredPartial]) -> float:
    """Before the onset where there is something, else from between the partials."""
    if note.noise_rms > 0.0:
        return gain_to_db(note.noise_rms)
    first = max(found, key=lambda p: p.snr_db)
    return first.level_db - first.snr_db


def _refuse_what_is_no_string(found: list[MeasuredPartial], stretch: Stretch, explained: float, f0_hz: float) -> None:
    strong = sorted(found, key=lambda p: -p.level_db)[:8]
    if explained < _LEAST_EXPLAINED:
        raise FitRefused(
            f"steady partials of {f0_hz:.4g} Hz explain only {100.0 * max(0.0, explained):.0f} % of the sound; "
            "noise, a voice, several notes or a sound that glides cannot be fitted: record one plucked string"
        )
    low = [p for p in found if p.number <= JUDGED]
    if stretch.spread_cents > _MOST_SPREAD_CENTS or len(low) < 4:
        raise FitRefused(
            f"the partials of {f0_hz:.4g} Hz are not those of a string: they lie {stretch.spread_cents:.0f} cents (rms) "
            f"off f0·n·√(1 + Bn²), {len(low)} of the first {JUDGED} stand out; record one plucked string"
        )
    far = [p.number for p in low if abs(_off(stretch, p)) > _MOST_SPREAD_CENTS]
    if len(far) > 2:
        raise FitRefused(
            f"{_listed(far)} more than {_MOST_SPREAD_CENTS:g} cents off the series of {f0_hz:.4g} Hz: "
            "they do not come from one string; record one plucked string, the others damped"
        )
    lasting = [p for p in strong if p.decay <= LN_1000 / _LONGEST_T60_S]
    if len(lasting) > len(strong) // 2:
        raise FitRefused("the sound does not decay as a plucked string does; record one pluck and let it ring")
    good = [p for p in low if p.steady]
    if len(good) < _FEW and stretch.inharmonicity < 3.0 * stretch.inharmonicity_error:
        raise FitRefused(
            f"only {len(good)} of the first {JUDGED} partials of {f0_hz:.4g} Hz decay steadily, and their frequencies "
            "do not show a string's inharmonicity; record one plucked string, louder"
        )


def _warnings(
    found: list[MeasuredPartial], stretch: Stretch, losses: Losses, pluck: FittedPluck | None, explained: float
) -> list[str]:
    words = []
    low = [p for p in found if p.number <= JUDGED]
    missing = sorted(set(range(1, JUDGED + 1)) - {p.number for p in low})
    if missing:
        words.append(
            f"{_listed(missing)} too weak to be measured, or masked by another sound: pitch and decay follow the laws"
        )
    unsteady = [p.number for p in low if not p.steady]
    if unsteady:
        words.append(f"{_listed(unsteady)} without a single decay time: the value given depends on where it is read")
    beating = [p.number for p in low if p.steady and not p.single]
    if beating:
        words.append(f"{_listed(beating)} not a single exponential (beating, or decay in stages): the average is used")
    beside = [p.number for p in low if abs(_off(stretch, p)) > LAW_CENTS]
    if beside:
        words.append(
            f"{_listed(beside)} more than {LAW_CENTS:g} cents off f0·n·√(1 + Bn²): the ends or the body shift the pitch"
        )
    if losses.spread > _LOSS_SPREAD:
        words.append(f"decay rates lie {100.0 * losses.spread:.0f} % (rms) off the loss law: the body absorbs energy, too")
    if stretch.inharmonicity < 3.0 * stretch.inharmonicity_error:
        words.append(f"inharmonicity is hardly above its error of {stretch.inharmonicity_error:.1g}")
    if pluck is None or not pluck.determined:
        words.append("the levels of the partials do not show where the string was plucked")
    elif pluck.spread_db > CLEAR_DB:
        words.append(
            f"levels lie {pluck.spread_db:.0f} dB (rms) off those of a pluck: with an electric pickup, the position found "
            "may be the pickup's"
        )
    if explained < 0.8:
        words.append(f"the partials explain {100.0 * explained:.0f} % of the sound just after the onset")
    return words


def _listed(numbers: list[int]) -> str:
    verb = "partial {} is" if len(numbers) == 1 else "partials {} are"
    return verb.format(", ".join(map(str, numbers)))
