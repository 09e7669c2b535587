"""Measures of one plucked note, the same code for a recording and for a rendering.

Pitch, partials and their decays are `synth.fit`'s. What is not to be measured in a note (too short, too few partials) is
absent from the dict.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from synth.dsp.measures import spectrum
from synth.fit.exponential import Bands
from synth.fit.partials import MeasuredPartial, fit_stretch, measure_partials
from synth.fit.pitch import BEGIN_S, SPAN_S, best_series, spectral_peaks
from synth.fit.recording import FitRefused, RecordedNote, cut_note

#: of a note that is looked at [s]: what most recordings have
MOST_S = 6.0
#: partials that are measured
MOST_PARTIALS = 20
#: partials of the groups whose decay is measured
GROUPS = {"t60_1": (1, 1), "t60_2_5": (2, 5), "t60_6_12": (6, 12), "t60_13_20": (13, 20)}
#: a partial must fall by 6 dB in that time to have a decay of its own: longer ones count as this [s]
LONGEST_T60_S = 60.0
#: partials that may beat, and how far below the strongest of them they are still looked at [dB]
_BEATING, _BEATING_DB = 6, 30.0
_AFTER_ATTACK_S = 0.1
#: level and tilt are those of the first 0.3 s
EARLY_S = 0.3
_TAKE_PARTIALS = 12


def cut(samples: NDArray[np.float64], rate_hz: float) -> RecordedNote:
    """The note from its onset on, at most `MOST_S`. Raises FitRefused."""
    note = cut_note(samples, rate_hz)
    most = round(MOST_S * rate_hz)
    return RecordedNote(note.samples[:most], rate_hz, note.onset_s, note.peak_dbfs, note.noise_rms, note.warnings)


def ring(note: RecordedNote, expected_hz: float) -> dict[str, float]:
    """Decay by partial [s], `decay_ratio`, `beating_db`, `inharmonicity`, `glide_cents` and `f0_hz` of a note that rings.

    expected_hz: its pitch within half an octave. Raises FitRefused where there is no series of partials.
    """
    found = partials(note, expected_hz)
    stretch = fit_stretch(found)
    out = {"f0_hz": stretch.f0_hz, "inharmonicity": stretch.inharmonicity}
    for name, (low, high) in GROUPS.items():
        decays = [t for number, t in decays_s(found).items() if low <= number <= high]
        if decays:
            out[name] = float(np.median(decays))
    if {"t60_13_20", "t60_2_5"} <= out.keys():
        out["decay_ratio"] = out["t60_13_20"] / out["t60_2_5"]
    numbers = np.arange(1, _BEATING + 1)
    envelopes = _envelopes(note, stretch.f0_hz, stretch.frequencies_hz(numbers))
    if beats := [b for b in (_beating_db(t, np.abs(y), noise) for t, y, noise in _strong(envelopes)) if b is not None]:
        out["beating_db"] = float(np.median(beats))
    pairs = zip(stretch.frequencies_hz(numbers[:4]), envelopes[:4], strict=True)
    if glides := [g for g in (_glide_cents(float(f), t, y) for f, (t, y, _) in pairs) if g is not None]:
        out["glide_cents"] = float(np.median(glides))
    return out


def partials(note: RecordedNote, expected_hz: float) -> list[MeasuredPartial]:
    """The first twenty partials, as far as they stand out. Raises FitRefused where there is no series of them."""
    begin = round(BEGIN_S * note.rate_hz)
    peaks = spectral_peaks(note.samples[begin : begin + round(SPAN_S * note.rate_hz)], note.rate_hz)
    series = best_series(peaks, expected_hz)
    if series is None:
        raise FitRefused(f"no series of partials near {expected_hz:.4g} Hz")
    return measure_partials(note, series, most=MOST_PARTIALS)[0]


def decays_s(found: Sequence[MeasuredPartial]) -> dict[int, float]:
    """{number: T60} of the partials that decay."""
    return {p.number: min(float(p.t60_s), LONGEST_T60_S) for p in found if p.decay > 0.0}


Envelope = tuple[NDArray[np.float64], NDArray[np.complex128], float]


def _envelopes(note: RecordedNote, f0_hz: float, frequencies_hz: NDArray[np.float64]) -> list[Envelope]:
    """(times [s], envelope, noise beside it) of partials, in half the spacing of the partials to each side."""
    bands = Bands(note.samples, note.rate_hz, 0.5 * f0_hz)
    out = []
    for f in frequencies_hz:
        t, y = bands.envelope(float(f))
        _, beside = bands.envelope(float(f) + 0.5 * f0_hz)
        out.append((t, y, float(np.median(np.abs(beside[-max(1, beside.size // 5) :])))))
    return out


def _strong(envelopes: Sequence[Envelope]) -> list[Envelope]:
    tops = [np.abs(y).max() for _, y, _ in envelopes]
    return [e for e, top in zip(envelopes, tops, strict=True) if top > max(tops) * 10.0 ** (-_BEATING_DB / 20.0)]


def _beating_db(t: NDArray[np.float64], magnitude: NDArray[np.float64], noise: float) -> float | None:
    """What two straight lines leave of a partial's level: the range that holds 95 % of it [dB].

    From 0.1 s after its maximum until 12 dB above the noise; None where that is less than a quarter of a second or falls
    by less than 6 dB.
    """
    top = int(np.argmax(magnitude * (t < t[0] + 0.3)))
    level = 20.0 * np.log10(np.maximum(magnitude[top:], 1e-15))
    t = t[top:] - t[top]
    quiet = np.flatnonzero(level < 20.0 * np.log10(max(noise, 1e-15)) + 12.0)
    end = int(quiet[0]) if quiet.size else level.size
    used = (t >= _AFTER_ATTACK_S) & (np.arange(t.size) < end)
    t, level = t[used], level[used]
    if t.size < 20 or t[-1] - t[0] < 0.25 or level[0] - level.min() < 6.0:
        return None
    best, left = np.inf, level
    for bend in np.linspace(t[0] + 0.1 * (t[-1] - t[0]), t[0] + 0.7 * (t[-1] - t[0]), 25):
        lines = np.stack([np.ones_like(t), t, np.maximum(t - bend, 0.0)], axis=1)
        rest = level - lines @ np.linalg.lstsq(lines, level, rcond=None)[0]
        if rest @ rest < best:
            best, left = float(rest @ rest), rest
    return float(np.percentile(left, 97.5) - np.percentile(left, 2.5))


def _glide_cents(hz: float, t: NDArray[np.float64], y: NDArray[np.complex128]) -> float | None:
    """How far a partial at 0.1–0.22 s (six periods where that is longer) lies above its pitch at 1.8–2.3 s."""
    width = max(0.12, 6.0 / hz)
    begin = max(0.1, t[0]) if t.size else 0.1
    spans = [(t >= begin) & (t <= begin + width), (t >= 1.8) & (t <= 2.3)]
    if min(used.sum() for used in spans) < 3:
        return None
    first, last = (hz + np.polyfit(t[used], np.unwrap(np.angle(y[used])), 1)[0] / (2.0 * np.pi) for used in spans)
    return float(1200.0 * np.log2(first / last))


def early(note: RecordedNote, f0_hz: float) -> dict[str, float]:
    """`level_db` and `tilt_db_octave` of the first 0.3 s."""
    x = note.samples[: round(EARLY_S * note.rate_hz)]
    levels = partial_levels_db(note, f0_hz, MOST_PARTIALS)
    octaves = np.log2(np.arange(1, levels.size + 1))
    return {
        "level_db": float(10.0 * np.log10(np.mean(x**2) + 1e-20)),
        "tilt_db_octave": float(np.polyfit(octaves, levels, 1)[0]),
    }


def partial_levels_db(note: RecordedNote, f0_hz: float, count: int) -> NDArray[np.float64]:
    """Largest level within half a spacing of each of the first partials, over 0.3 s; fewer near half the rate."""
    frequencies, amplitude = spectrum(note.samples[: round(EARLY_S * note.rate_hz)], note.rate_hz, 8)
    count = min(count, int(0.45 * note.rate_hz / f0_hz - 0.5))
    edges = np.searchsorted(frequencies, (np.arange(count + 1) + 0.5) * f0_hz)
    return np.array([20.0 * np.log10(amplitude[a:b].max() + 1e-12) for a, b in pairwise(edges)])


def takes_apart_db(a: RecordedNote, b: RecordedNote, f0_hz: float) -> float:
    """Distance of two takes of a note: rms difference of the first twelve partials' levels, their loudness apart."""
    difference = partial_levels_db(a, f0_hz, _TAKE_PARTIALS) - partial_levels_db(b, f0_hz, _TAKE_PARTIALS)
    return float(np.sqrt(np.mean((difference - difference[:8].mean()) ** 2)))


def burst(note: RecordedNote) -> dict[str, float]:
    """What a thumb or fret adds above 2 kHz: `burst_peak_ms` after the onset, and `burst_20db_ms` from there to −20 dB.

    rms of 10 ms in 2–8 kHz over half a second; a burst that does not fall so far within it has no second value but 500.
    """
    step = round(0.01 * note.rate_hz)
    x = note.samples[: 50 * step]
    band = butter(4, [2000.0, min(8000.0, 0.45 * note.rate_hz)], "bandpass", fs=note.rate_hz, output="sos")
    high = sosfiltfilt(band, x)[: x.size // step * step].reshape(-1, step)
    level = 10.0 * np.log10(np.mean(high**2, axis=1) + 1e-18)
    top = int(np.argmax(level))
    low = np.flatnonzero(level[top:] < level[top] - 20.0)
    return {"burst_peak_ms": 10.0 * top, "burst_20db_ms": 10.0 * float(low[0]) if low.size else 500.0}


#: bands of a release [Hz]
RELEASE_HZ = {"low": (30.0, 250.0), "middle": (250.0, 1000.0), "high": (1000.0, 4000.0)}


def _band_power(samples: NDArray[np.float64], rate_hz: float, edges: tuple[float, float]) -> NDArray[np.float64]:
    """Power in a band, smoothed over 20 ms."""
    band = butter(2, [edges[0], min(edges[1], 0.45 * rate_hz)], "bandpass", fs=rate_hz, output="sos")
    window = np.hanning(round(0.02 * rate_hz))
    return np.convolve(sosfiltfilt(band, samples) ** 2, window / window.sum(), "same")


def release(samples: NDArray[np.float64], rate_hz: float, at_s: float) -> dict[str, float]:
    """`release_ms`, and `release_low_ms` …, from a release at `at_s` to 20 dB below the level of the 50 ms before.

    Levels are those of a filter's output smoothed over 20 ms; a band that does not fall so far in what is there, or that
    holds nothing, is absent.
    """
    out = {}
    for name, edges in {"": (30.0, 8000.0), **{f"_{key}": value for key, value in RELEASE_HZ.items()}}.items():
        smooth = _band_power(samples, rate_hz, edges)
        at = round(at_s * rate_hz)
        before = smooth[max(0, at - round(0.05 * rate_hz)) : at].mean()
        low = np.flatnonzero(smooth[at:] < 0.01 * before)
        if before > 0.0 and low.size:
            out[f"release{name}_ms"] = 1e3 * float(low[0]) / rate_hz
    return out


def released_s(samples: NDArray[np.float64], rate_hz: float) -> float:
    """When a recorded note is let go: the last instant at which its lows are within 4 dB of their maximum [s]."""
    level = _band_power(samples, rate_hz, RELEASE_HZ["low"])
    return float(np.flatnonzero(level > level.max() * 10.0**-0.4)[-1] / rate_hz)


def touched(note: RecordedNote, fundamental_hz: float) -> dict[str, float]:
    """`fundamental_db`: a touched harmonic's fundamental of the whole string against the strongest partial."""
    begin = round(0.1 * note.rate_hz)
    frequencies, amplitude = spectrum(note.samples[begin : begin + round(1.2 * note.rate_hz)], note.rate_hz)
    low, high = np.searchsorted(frequencies, np.array([0.97, 1.03]) * fundamental_hz)
    low_all = np.searchsorted(frequencies, 0.9 * fundamental_hz)
    return {"fundamental_db": float(20.0 * np.log10(amplitude[low:high].max() / amplitude[low_all:].max()))}
