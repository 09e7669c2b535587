"""What tanpuras and sitars are held to, in measures that no filter of the sound can meet by itself.

off_grid_db      energy of a drone between the multiples of its common fundamental, against all of it
grid_db          the same of a spectrum
filter_share     share of the variance of partial levels that one fixed filter explains
Waking           how partials come and go, each against its own best: the formant that falls, when each is strongest
wide_db          left and right
opens, attack_ms, apart_db    of a stroke; of two strokes
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from scipy.stats import spearmanr
from truth_of_sound.note_features import attack_ms as attack_ms
from truth_of_sound.note_features import onset

from synth.dsp.measures import blackman_harris
from synth.engine.engine import Engine
from synth.instrument.preset import Preset
from synth.midi.events import NOTE_OFF, NOTE_ON, make_events
from synth.units import midi_to_hz

RATE = 44100
#: the window of the noise between partials, after a stroke [s]
AFTER_S = (0.3, 1.3)
#: what lies in the middle of the gap between two partials, as parts of the gap
GAP = (0.35, 0.65)
BAND_HZ = (100.0, 8000.0)
FLOOR_DB = 45.0


def play(engine: Engine, rows: Sequence[tuple], seconds: float) -> np.ndarray:
    """(frames, 2) of an engine from rest, without its delay."""
    engine.reset()
    out = np.zeros((round(seconds * RATE) + engine.latency_samples, 2))
    engine.process(make_events(sorted(rows, key=lambda row: row[0])), out)
    if not np.isfinite(out).all() or engine.report().unsolved_contacts:
        raise ValueError("the engine met a state or a contact that it could not solve; render at another quality")
    return out[engine.latency_samples :]


def engine_of(preset: Preset, notes: Sequence[int]) -> Engine:
    """A prepared engine of some notes of a preset, without the limiter."""
    engine = Engine([preset], limiter=False, only_notes=[set(notes)], every_fret=False)
    engine.prepare(RATE, 512)
    return engine


def open_notes(preset: Preset) -> list[int]:
    """Notes of the strings that are played, in the order of the file, which is that of a tanpura's cycle."""
    return [table.notes[0] for table in preset.string if not table.sympathetic]


def drone(preset: Preset, *, cycles: int = 2, gap_s: float = 1.3, velocity: int = 64) -> np.ndarray:
    """(frames, 2) cycles of a tanpura, strings evenly one after the other."""
    notes = open_notes(preset)
    rows = [(round(i * gap_s * RATE), NOTE_ON, 0, note, velocity) for i, note in enumerate(cycles * notes)]
    return play(engine_of(preset, notes), rows, gap_s * (len(rows) + 0.5))


def strokes_of(preset: Preset, seconds: float, velocity: int = 64) -> Iterator[tuple[int, np.ndarray]]:
    """(note, (frames, 2)) of every open note alone, from rest."""
    notes = open_notes(preset)
    engine = engine_of(preset, notes)
    for note in sorted(set(notes)):
        yield note, play(engine, [(0, NOTE_ON, 0, note, velocity)], seconds)


def power_of(x: np.ndarray, begin_s: float, end_s: float) -> tuple[np.ndarray, np.ndarray]:
    """(hz, power) of a stretch of (frames,) in a window whose lobes leave nothing between partials."""
    piece = x[round(begin_s * RATE) : round(end_s * RATE)]
    size = 1 << int(np.ceil(np.log2(2 * piece.size)))
    return np.fft.rfftfreq(size, 1.0 / RATE), np.abs(np.fft.rfft(piece * blackman_harris(piece.size), size)) ** 2


def _between(hz: np.ndarray, power: np.ndarray, partials_hz: np.ndarray) -> float:
    """Power in the middle of every gap, counted as if the whole gap were so, against all power in the band [dB]."""
    low, high = BAND_HZ
    left = 0.0
    for a, b in pairwise(partials_hz):
        if low <= a and b <= high:
            left += power[(hz > a + GAP[0] * (b - a)) & (hz < a + GAP[1] * (b - a))].sum()
    return float(10.0 * np.log10(left / (GAP[1] - GAP[0]) / power[(hz > low) & (hz < high)].sum() + 1e-12))


def off_grid_db(x: np.ndarray, common_hz: float, begins_s: Sequence[float]) -> float:
    """Between the multiples of a drone's common fundamental (half its kharaj, where Pa is a fifth above that), mean of the
    windows `AFTER_S` after each stroke."""
    hz, power = power_of(x, *(begins_s[0] + s for s in AFTER_S))
    for begin in begins_s[1:]:
        power = power + power_of(x, *(begin + s for s in AFTER_S))[1]
    return grid_db(hz, power, common_hz)


def grid_db(hz: np.ndarray, power: np.ndarray, f1_hz: float) -> float:
    """Between the multiples of a fundamental in a spectrum."""
    return _between(hz, power, f1_hz * np.arange(1, 1 + int(BAND_HZ[1] / f1_hz)))


def stretched(x: np.ndarray, f1_hz: float, begin_s: float = 0.3, end_s: float = 1.3) -> np.ndarray:
    """Where the partials of a stiff string lie [Hz]: n f1 √(1 + B n²), B of the best fit to the peaks."""
    hz, power = power_of(x, begin_s, end_s)
    n = np.arange(1, 1 + int(BAND_HZ[1] / f1_hz))
    best, log = (-np.inf, 0.0), np.log(power + 1e-12 * power.max())
    for b in np.concatenate([[0.0], np.geomspace(1e-6, 1e-3, 121)]):
        at = n * f1_hz * np.sqrt((1.0 + b * n**2) / (1.0 + b))
        at = at[at < 4000.0]
        found = float(log[np.rint(at / hz[1]).astype(int)].mean())
        best = max(best, (found, float(b)))
    return n * f1_hz * np.sqrt((1.0 + best[1] * n**2) / (1.0 + best[1]))


def levels_db(x: np.ndarray, partials_hz: np.ndarray, begin_s: float, end_s: float) -> np.ndarray:
    """Levels of partials in a stretch [dB]."""
    hz, power = power_of(x, begin_s, end_s)
    half = 0.4 * partials_hz[0]
    return np.array([10.0 * np.log10(power[np.abs(hz - f) < half].max() + 1e-20) for f in partials_hz])


def filter_share(spectra: Sequence[tuple[np.ndarray, np.ndarray]], per_octave: int = 6) -> float:
    """R² of one filter, steps of 1/`per_octave` octave from 200 Hz to 5 kHz, in spectra (hz (n,), level_db (n,)).

    Each spectrum has a level and a slope of its own; adjusted for the number of what is fitted.
    """
    rows, values, owner, bands = [], [], [], []
    for number, (hz, level) in enumerate(spectra):
        keep = (hz > 200.0) & (hz < 5000.0)
        octave = np.log2(hz[keep] / 1000.0)
        own = np.c_[np.ones(octave.size), octave]
        rows.append(own)
        values.append(level[keep])
        owner += [number] * int(keep.sum())
        bands += np.floor(per_octave * octave).astype(int).tolist()
    y = np.concatenate(values)
    names = sorted(set(bands))
    steps = np.array([[band == name for name in names] for band in bands], float)
    alone = np.zeros((y.size, 2 * len(spectra)))
    for i, number in enumerate(owner):
        alone[i, 2 * number : 2 * number + 2] = np.concatenate(rows)[i]

    def left(a: np.ndarray) -> float:
        return float(np.sum((y - a @ np.linalg.lstsq(a, y, rcond=None)[0]) ** 2) / (y.size - np.linalg.matrix_rank(a)))

    return 1.0 - left(np.hstack([alone, steps])) / left(alone)


def envelope_db(x: np.ndarray, hz: float, width_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """(t_s, level [dB]) of what lies around a frequency."""
    size = 1 << int(np.ceil(np.log2(x.size)))
    f = np.fft.fftfreq(size, 1.0 / RATE)
    window = np.where(np.abs(f - hz) < width_hz, 0.5 + 0.5 * np.cos(np.pi * (f - hz) / width_hz), 0.0)
    z = np.abs(np.fft.ifft(np.fft.fft(x, size) * window))[: x.size : 64]
    return np.arange(z.size) * 64 / RATE, 20.0 * np.log10(z + 1e-12)


class Waking:
    """How the partials of a stroke come and go, each relative to its own greatest level: no filter changes that.

    t_s (frames,); hz (partials,) from the third on, up to 5 kHz; level_db (partials, frames), 0 at the greatest
    """

    def __init__(self, x: np.ndarray, f1_hz: float, seconds: float = 2.5) -> None:
        hz = stretched(x, f1_hz)
        self.hz = hz[2 : int(np.searchsorted(hz, 5000.0))]
        both = [envelope_db(x[: round((seconds + 0.5) * RATE)], float(each), 0.5 * f1_hz) for each in self.hz]
        kept = (both[0][0] > 0.03) & (both[0][0] < seconds)
        self.t_s = both[0][0][kept]
        level = np.array([level[kept] for _, level in both])
        self.level_db = level - level.max(axis=1, keepdims=True)

    def formant_hz(self, at_s: Sequence[float]) -> list[float]:
        """Middle in octaves of the partials around each of these times, weighted by their power against their own best."""
        found = []
        for at in at_s:
            weight = (10.0 ** (self.level_db[:, np.abs(self.t_s - at) < 0.06] / 10.0)).mean(axis=1)
            found.append(float(2.0 ** (np.sum(np.log2(self.hz) * weight) / weight.sum())))
        return found

    def strongest_s(self) -> np.ndarray:
        """When each partial is strongest."""
        return self.t_s[self.level_db.argmax(axis=1)]

    def order(self, count: int = 22) -> float:
        """Rank correlation of the numbers of the first partials and when they are strongest; below 0: from above."""
        times = self.strongest_s()[:count]
        return float(spearmanr(np.arange(times.size), times)[0])


def wide_db(x: np.ndarray, low_hz: float, high_hz: float) -> float:
    """Half the difference of left and right against half their sum in a band of (frames, 2) [dB]."""
    hz, middle = power_of(x.mean(axis=1), 0.1, len(x) / RATE - 0.1)
    side = power_of(0.5 * (x[:, 0] - x[:, 1]), 0.1, len(x) / RATE - 0.1)[1]
    band = (hz > low_hz) & (hz < high_hz)
    return float(10.0 * np.log10((side[band].sum() + 1e-30) / middle[band].sum()))


def centroid_hz(x: np.ndarray, at_s: float, width_s: float = 0.06, high_hz: float = 10000.0) -> float:
    """Centre of power in a stretch that begins at a time, counted from where the sound begins."""
    piece = x[round(at_s * RATE) : round((at_s + width_s) * RATE)]
    size = max(8192, 1 << int(np.ceil(np.log2(piece.size))))
    hz, power = np.fft.rfftfreq(size, 1.0 / RATE), np.abs(np.fft.rfft(piece * np.hanning(piece.size), size)) ** 2
    heard = (hz > 20.0) & (hz < high_hz)
    return float((hz[heard] * power[heard]).sum() / power[heard].sum())


def onset_s(x: np.ndarray) -> float:
    """Where a sound begins [s]."""
    return onset(x) / RATE


def apart_db(x: np.ndarray, y: np.ndarray, f1_hz: float) -> float:
    """Root mean square difference in level of the first twelve partials of two strokes in 0.3 s, made equally loud [dB].

    What lies `FLOOR_DB` below the strongest, where a recording has its noise, counts as lying there.
    """
    both = []
    for each in (x, y):
        hz, power = power_of(each[round(onset_s(each) * RATE) :], 0.0, 0.3)
        level = [10.0 * np.log10(power[np.abs(hz - k * f1_hz) < 0.5 * f1_hz].max() + 1e-20) for k in range(1, 13)]
        both.append(np.maximum(level, max(level) - FLOOR_DB))
    difference = np.subtract(*both)
    return float(np.sqrt(np.mean((difference - difference[:8].mean()) ** 2)))


def melody(preset: Preset, notes: Sequence[int], seconds: float, velocity: int = 80) -> Iterator[tuple[int, np.ndarray]]:
    """(note, (frames,)) of notes, each from rest."""
    engine = engine_of(preset, notes)
    for note in notes:
        yield note, play(engine, [(0, NOTE_ON, 0, note, velocity)], seconds).mean(axis=1)


def strokes(preset: Preset, note: int, count: int = 2, velocity: int = 80) -> list[np.ndarray]:
    """(frames,) each: strokes of one note one after the other, each after the hand has damped the one before."""
    rows = []
    for i in range(count):
        rows += [(round(2.0 * i * RATE), NOTE_ON, 0, note, velocity), (round((2.0 * i + 1.0) * RATE), NOTE_OFF, 0, note, 64)]
    x = play(engine_of(preset, [note]), rows, 2.0 * count).mean(axis=1)
    return [x[max(0, round((2.0 * i - 0.01) * RATE)) : round((2.0 * i + 0.95) * RATE)] for i in range(count)]


def brightness_hz(preset: Preset, note: int, count: int = 3) -> float:
    """Centroid of the first 0.85 s, mean in octaves of some strokes of a note."""
    found = [centroid_hz(x, onset_s(x) + 0.02, 0.83) for x in strokes(preset, note, count)]
    return float(np.exp(np.mean(np.log(found))))


def opens(x: np.ndarray) -> tuple[float, float]:
    """Centroid 0.05 and 0.5 s after the beginning."""
    begin = onset_s(x)
    return centroid_hz(x, begin + 0.05), centroid_hz(x, begin + 0.5)


def common_hz(preset: Preset) -> float:
    """Half the kharaj of a tanpura, of which Sa and Pa, a fifth above the kharaj, have multiples [Hz]."""
    return 0.5 * float(midi_to_hz(min(open_notes(preset)), preset.tuning.a4_hz))
