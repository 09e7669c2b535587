"""Features of one plucked note that an equaliser, a microphone or a room hardly moves: what the impostor test listens to.

Every note first goes through the same low-pass and gets the same noise floor, so that neither bandwidth nor hiss tells a
rendering from a recording. `FEATURES` names what is measured; a note that does not tell has nan.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import gcd

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, resample_poly, sosfiltfilt

Samples = NDArray[np.float64]

RATE_HZ = 44100
#: a note from its onset on [s]; less than the second is refused
MOST_S, LEAST_S = 3.0, 0.5
#: what all notes share: bandwidth [Hz], noise below the peak [dB]
BANDWIDTH_HZ, FLOOR_DB = 6000.0, -58.0
#: the onset is where the level comes within this of the peak, less a millisecond
ONSET = 0.05
#: name → (what it is, whether its logarithm is compared)
FEATURES: dict[str, tuple[str, bool]] = {
    "t60_1": ("T60 of partial 1 [s]", True),
    "t60_low": ("T60 below 500 Hz [s]", True),
    "t60_middle": ("T60 from 500 to 1500 Hz [s]", True),
    "t60_high": ("T60 from 1.5 to 4 kHz [s]", True),
    "scatter": ("scatter of ln T60 from partial to partial", False),
    "beating_db": ("beating [dB]", True),
    "two_stage": ("late over early T60", True),
    "between_low_db": ("between partials, 60–500 Hz [dB]", False),
    "between_middle_db": ("between partials, .5–2 kHz [dB]", False),
    "between_high_db": ("between partials, 2–6 kHz [dB]", False),
    "burst_1k_db": ("first 20 ms over .1–.2 s, 1–2 kHz [dB]", False),
    "burst_2k_db": ("the same, 2–4 kHz [dB]", False),
    "burst_4k_db": ("the same, 4–8 kHz [dB]", False),
    "off_law_cents": ("partials off the stiff-string law [cents]", True),
    "attack_ms": ("attack, 10 to 90 % [ms]", True),
    "inharmonicity": ("inharmonicity B", True),
}
#: what a feature of which the logarithm is compared is at least: what its measure can tell from nothing
FLOORS = {"attack_ms": 0.25, "off_law_cents": 0.05, "beating_db": 0.05, "inharmonicity": 2e-6}
#: partials that are looked for, that beat, that follow the law of a stiff string
_PARTIALS, _BEATING, _LAWFUL = 25, 8, 12
#: partials above are not looked at [Hz]
_HIGHEST_HZ = 9000.0
#: bands of T60 and of the first 20 ms, and those between the partials [Hz]
_T60_BANDS = {"t60_low": (0.0, 500.0), "t60_middle": (500.0, 1500.0), "t60_high": (1500.0, 4000.0)}
_BURSTS = {"burst_1k_db": (1000.0, 2000.0), "burst_2k_db": (2000.0, 4000.0), "burst_4k_db": (4000.0, 8000.0)}
_BETWEEN = {"between_low_db": (60.0, 500.0), "between_middle_db": (500.0, 2000.0), "between_high_db": (2000.0, 6000.0)}
#: slowest decay that a fitted line may have [dB/s]
_SLOWEST = 0.3


def features(samples: Samples, rate_hz: float, note: float) -> dict[str, float]:
    """`FEATURES` of a note, samples (frames,), behind the common bandwidth and floor.

    Raises ValueError for a note of less than `LEAST_S`, or silence.
    """
    x = prepared(samples, rate_hz)
    if x.size < LEAST_S * RATE_HZ:
        raise ValueError(f"a note must last {LEAST_S:g} s to be judged, got {x.size / RATE_HZ:.2f} s; leave it out")
    series = _series(x, 440.0 * 2.0 ** ((note - 69.0) / 12.0))
    decays = _decays(x, series)
    logs = np.log([decay.t60_s for decay in decays.values()])
    low = [decay for number, decay in decays.items() if number <= _BEATING]
    # a partial that does not stand out counts as one that follows the law
    lawful = [number for number in range(1, _LAWFUL + 1) if series.at(number) <= _HIGHEST_HZ]
    off = [1200.0 * np.log2(series.at(number) / series.law(number)) for number in lawful]
    out = {
        "t60_1": decays[1].t60_s if 1 in decays else np.nan,
        "scatter": float(np.std(np.diff(logs))) if logs.size > 4 else np.nan,
        "beating_db": _median([decay.beating_db for decay in low]),
        "two_stage": _median([decay.late_s / decay.early_s for decay in low if decay.range_db > 12.0]),
        "off_law_cents": float(np.std(off)) if len(off) > 3 else np.nan,
        "inharmonicity": series.stiffness,
        "attack_ms": attack_ms(x),
    }
    for name, (lowest, highest) in _T60_BANDS.items():
        out[name] = _median([d.t60_s for number, d in decays.items() if lowest <= series.at(number) < highest])
    for name, band in _BURSTS.items():
        out[name] = _band_db(x, 0.0, 0.02, *band) - _band_db(x, 0.1, 0.2, *band)
    seconds = max(0.06, 9.0 / series.f1_hz)
    for name, band in _BETWEEN.items():
        out[name] = _between_db(x, seconds, *band, series)
    return {name: float(out[name]) for name in FEATURES}


def prepared(samples: Samples, rate_hz: float) -> Samples:
    """At `RATE_HZ`, behind the common bandwidth and floor, from the onset on, of peak 1. Raises ValueError for silence."""
    x = np.asarray(samples, float)
    if not np.abs(x).max(initial=0.0) > 0.0:
        raise ValueError("a note that is silent cannot be judged; leave it out")
    x = at_common_rate(x, rate_hz)[: 5 * RATE_HZ]
    x = sosfiltfilt(butter(6, BANDWIDTH_HZ, fs=RATE_HZ, output="sos"), x)
    x = x / np.abs(x).max()
    x = x + 10.0 ** (FLOOR_DB / 20.0) * np.random.default_rng(0).standard_normal(x.size)
    x = x - np.median(x)
    begin = max(0, onset(x) - RATE_HZ // 1000)
    x = x[begin : begin + round(MOST_S * RATE_HZ)]
    return x / np.abs(x).max()


def at_common_rate(x: Samples, rate_hz: float) -> Samples:
    """A sound at `RATE_HZ`."""
    if rate_hz == RATE_HZ:
        return x
    common = gcd(round(rate_hz), RATE_HZ)
    return resample_poly(x, RATE_HZ // common, round(rate_hz) // common)


def onset(x: Samples) -> int:
    """Frame at which the level of a sound (frames,) first exceeds `ONSET` of its peak."""
    level = np.abs(x)
    return int(np.argmax(level > ONSET * level.max()))


@dataclass(frozen=True)
class _Series:
    """Partials of a note: f1 √(1 + B n²) n as fitted, and those that stand out, {number: Hz}."""

    f1_hz: float
    stiffness: float
    found: dict[int, float]

    def law(self, number: float) -> float:
        return number * self.f1_hz * float(np.sqrt(1.0 + self.stiffness * number * number))

    def at(self, number: int) -> float:
        return self.found.get(number, self.law(number))


def _series(x: Samples, expected_hz: float) -> _Series:
    """Peaks from 0.1 s on, each sought where the law that fits those before says."""
    f0 = _fundamental(x, expected_hz)
    seconds = min(1.5, x.size / RATE_HZ - 0.1)
    part = x[RATE_HZ // 10 : round((0.1 + seconds) * RATE_HZ)]
    size = _padded(8 * part.size)
    level = np.abs(np.fft.rfft(part * np.blackman(part.size), size))
    series = _Series(f0, 0.0, {})
    for number in range(1, _PARTIALS + 1):
        at = series.law(number)
        if at > 0.45 * RATE_HZ:
            break
        beside = max((0.25 if number < 4 else 0.2) * f0, 3.0 / seconds)
        first, end = (
            max(1, int((at - beside) * size / RATE_HZ)),
            min(level.size - 2, int((at + beside) * size / RATE_HZ) + 1),
        )
        if end <= first + 2:
            continue
        top = first + int(np.argmax(level[first:end]))
        if not first < top < end - 1 or level[top] < 8.0 * np.median(level[first:end]):
            continue
        left, middle, right = np.log(level[top - 1 : top + 2] + 1e-20)
        series.found[number] = (top + 0.5 * (left - right) / (left - 2.0 * middle + right)) * RATE_HZ / size
        if len(series.found) >= 3:
            series = _fitted(series)
    return series


def _fundamental(x: Samples, expected_hz: float) -> float:
    """The comb of eight harmonics within 60 cents of the expected pitch that is strongest."""
    end = min(1.0, max(0.4, x.size / RATE_HZ - 0.15))
    part = x[RATE_HZ // 10 : RATE_HZ // 10 + round(end * RATE_HZ)]
    size = _padded(8 * part.size)
    level = np.abs(np.fft.rfft(part * np.hanning(part.size), size))
    logs = np.log(level + 1e-9 * level.max())
    trials = expected_hz * 2.0 ** (np.arange(-60, 61) / 1200.0)
    combs = np.round(np.outer(trials, np.arange(1, 9)) * size / RATE_HZ).astype(int)
    return float(trials[np.argmax(logs[combs].sum(axis=1))])


def _fitted(series: _Series) -> _Series:
    """(f/n)² = f1² + f1² B n² through the partials, those that stray weighted down."""
    numbers = np.array(list(series.found), float)
    squares = (np.array(list(series.found.values())) / numbers) ** 2
    columns = np.stack([np.ones_like(numbers), numbers**2], axis=1)
    line = np.linalg.lstsq(columns, squares, rcond=None)[0]
    away = np.abs(squares - columns @ line)
    weight = (1.0 + (away / (np.median(away) + 1e-12)) ** 2) ** -0.5
    line = np.linalg.lstsq(columns * weight[:, None], squares * weight, rcond=None)[0]
    if line[0] <= 0.0:
        return series
    return _Series(float(np.sqrt(line[0])), float(np.clip(line[1] / line[0], 0.0, 5e-3)), series.found)


@dataclass(frozen=True)
class _Decay:
    """How the level of a partial falls: T60 of one line and of two joined ones, what these leave over, and the range."""

    t60_s: float
    early_s: float
    late_s: float
    beating_db: float
    range_db: float


def _decays(x: Samples, series: _Series) -> dict[int, _Decay]:
    """{number: decay} of the partials up to `_HIGHEST_HZ`."""
    size = _padded(x.size)
    spectrum = np.fft.rfft(x, size)
    out = {}
    for number in range(1, _PARTIALS + 1):
        hz = series.at(number)
        if hz > _HIGHEST_HZ:
            break
        decay = _decay(*_envelope(spectrum, size, x.size, hz, 0.45 * series.f1_hz))
        if decay is not None:
            out[number] = decay
    return out


def _envelope(
    spectrum: NDArray[np.complex128], size: int, frames: int, hz: float, beside_hz: float
) -> tuple[Samples, float]:
    """(level of the partial, seconds between its values), cut out of the note's spectrum."""
    middle, half = round(hz * size / RATE_HZ), int(beside_hz * size / RATE_HZ)
    if middle - half < 1 or middle + half >= spectrum.size:
        return np.zeros(0), 1.0
    part = np.zeros(_padded(2 * half + 1), complex)
    cut = spectrum[middle - half : middle + half + 1] * np.hanning(2 * half + 3)[1:-1]
    part[: half + 1], part[-half:] = cut[half:], cut[:half]
    step_s = size / RATE_HZ / part.size
    return 2.0 * np.abs(np.fft.ifft(part))[: int(frames / RATE_HZ / step_s)] * part.size / size, step_s


def _decay(level: Samples, step_s: float) -> _Decay | None:
    """From 60 ms after the peak to 50 dB below it or 8 dB above what is left at the end."""
    if level.size < 12:
        return None
    peak = int(np.argmax(level[: max(2, int(0.25 / step_s))]))
    db = 20.0 * np.log10(level[peak:] + 1e-12)
    floor = 20.0 * np.log10(np.median(level[int(0.85 * level.size) :]) + 1e-12)
    below = np.flatnonzero(db < max(db[0] - 50.0, floor + 8.0))
    end = min(int(below[0]) if below.size else db.size, int(4.0 / step_s))
    t = np.arange(end) * step_s
    used = t >= 0.06
    if used.sum() < 8 or t[-1] < 0.15:
        return None
    t, db = t[used], db[:end][used]
    slope = np.polyfit(t, db, 1)[0]
    fits = []
    for knee in np.linspace(t[0] + 0.1 * (t[-1] - t[0]), t[0] + 0.7 * (t[-1] - t[0]), 12):
        columns = np.stack([np.ones_like(t), t, np.maximum(t - knee, 0.0)], axis=1)
        lines = np.linalg.lstsq(columns, db, rcond=None)[0]
        left = db - columns @ lines
        fits.append((float(left @ left), lines, left))
    _, lines, left = min(fits, key=lambda fit: fit[0])
    low, high = np.percentile(left, [2.5, 97.5])
    return _Decay(_t60(slope), _t60(lines[1]), _t60(lines[1] + lines[2]), float(high - low), float(db[0] - db.min()))


def _t60(slope: float) -> float:
    return 60.0 / max(-slope, _SLOWEST)


def _band_db(x: Samples, begin_s: float, end_s: float, low_hz: float, high_hz: float) -> float:
    """Level of a band over a time."""
    part = x[round(begin_s * RATE_HZ) : round(end_s * RATE_HZ)]
    if part.size < 64:
        return np.nan
    power, hz = np.abs(np.fft.rfft(part * np.hanning(part.size))) ** 2, np.fft.rfftfreq(part.size, 1.0 / RATE_HZ)
    return float(10.0 * np.log10(power[(hz >= low_hz) & (hz < high_hz)].sum() / part.size**2 + 1e-20))


def _between_db(x: Samples, seconds: float, low_hz: float, high_hz: float, series: _Series) -> float:
    """Energy between the partials, as if it filled the band, over all energy of the band, from the onset on."""
    part, size = x[: round(seconds * RATE_HZ)], 1 << 16
    power, hz = np.abs(np.fft.rfft(part * np.blackman(part.size), size)) ** 2, np.fft.rfftfreq(size, 1.0 / RATE_HZ)
    band = (hz > low_hz) & (hz < high_hz)
    free = band.copy()
    for number in range(1, 200):
        if low_hz - series.f1_hz < (at := series.law(number)) < high_hz + series.f1_hz:
            free &= np.abs(hz - at) > min(3.0 / seconds, 0.42 * series.f1_hz)
    share = free.sum() / max(1, band.sum())
    return float(10.0 * np.log10(power[free].sum() / share / power[band].sum() + 1e-12)) if share > 0.05 else np.nan


def attack_ms(x: Samples) -> float:
    """From 10 to 90 % of the peak within 0.3 s, by peaks of milliseconds half overlapping."""
    level, width = np.abs(x[: round(0.3 * RATE_HZ)]), RATE_HZ // 1000
    peaks = np.maximum.accumulate([level[i : i + width].max() for i in range(0, level.size - width, width // 2)])
    steps = int(np.argmax(peaks >= 0.9 * peaks[-1])) - int(np.argmax(peaks >= 0.1 * peaks[-1]))
    return steps * (width // 2) / RATE_HZ * 1e3


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if len(values) else np.nan


def _padded(size: int) -> int:
    return 1 << int(np.ceil(np.log2(size)))
