"""What of a recording is one plucked note: one channel, without offset, from its onset to its end.

What cannot be measured is refused with the reason: silence, clipping, too short a note.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from synth.units import gain_to_db

#: pitches that are looked for [Hz]
LOWEST_HZ, HIGHEST_HZ = 27.0, 1600.0
#: seconds of a file that are looked at, and of a note that are measured
MOST_S = 60.0
MOST_NOTE_S = 12.0
#: a note must last that long [s]
LEAST_S = 0.25
#: a peak below that is silence [dBFS]
SILENCE_DB = -80.0
LEAST_RATE_HZ, MOST_RATE_HZ = 8000.0, 400000.0
#: numbers of a file that are read, samples times channels
MOST_NUMBERS = 30_000_000
#: no recording has samples beyond that, full scale 1: they would overflow when they are squared
LARGEST = 1e6
# Samples in a row at the largest value, and how many such rows, make clipping.
_CLIPPED_ROW, _CLIPPED_ROWS = 4, 3


#: told how much is done (0 … 1); False: it is to end
Progress = Callable[[float], bool]


class FitCancelled(Exception):
    """The caller's `progress` has ended the fit."""


class FitRefused(ValueError):
    """A recording that cannot be fitted; the message says why and what would help. A ValueError.

    Examples
    --------
    >>> import numpy as np
    >>> import synth
    >>> try:
    ...     synth.fit_recording(np.zeros(44100), 44100.0)
    ... except synth.FitRefused as error:
    ...     print(error)
    the recording is silent, its peak is at ... dBFS; record it louder
    """


@dataclass(frozen=True)
class RecordedNote:
    """One note cut out of a recording.

    samples    (n,) from the onset on, mean removed
    rate_hz    samples a second
    onset_s    where in the recording it begins
    peak_dbfs  largest sample of the recording
    noise_rms  rms before the onset, 0 where there is nothing before it
    warnings   what was left out
    before     (m,) what stands before the onset, its mean removed; nothing where the recording begins with it
    """

    samples: NDArray[np.float64]
    rate_hz: float
    onset_s: float
    peak_dbfs: float
    noise_rms: float
    warnings: tuple[str, ...]
    before: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))


def read_recording(file: str | BinaryIO) -> tuple[NDArray[np.float64], int]:
    """(frames, channels) and rate of an audio file, as much of it as is looked at. Raises ValueError, OSError."""
    import soundfile

    name = "the recording"
    if isinstance(file, str):
        name = file
        path = Path(file)
        if not path.exists():
            raise FileNotFoundError(f"{file}: there is no such file")
        if path.is_dir():
            raise IsADirectoryError(f"{file}: is a directory; give a recording in it")
        if not path.is_file():
            raise ValueError(f"{file}: is a device or a pipe, in which the fit cannot seek; give a WAV or FLAC file")
    try:
        with soundfile.SoundFile(os.fsencode(file) if isinstance(file, str) and os.name != "nt" else file) as sound:
            _check_rate(sound.samplerate)
            frames = min(sound.frames, round((MOST_S + 1.0) * sound.samplerate))
            if frames * sound.channels > MOST_NUMBERS:
                raise FitRefused(
                    f"the recording must hold at most {MOST_NUMBERS} numbers, got {frames} samples of {sound.channels} "
                    "channels; give one channel, or a shorter piece"
                )
            return sound.read(frames, dtype="float64", always_2d=True), sound.samplerate
    except FitRefused as error:
        raise FitRefused(f"{name}: {error}") from None
    except soundfile.LibsndfileError as error:
        raise ValueError(f"{name}: cannot be read ({error.error_string.rstrip('.')}); give a WAV or FLAC file") from None


def _check_rate(rate_hz: float) -> None:
    if not LEAST_RATE_HZ <= rate_hz <= MOST_RATE_HZ:
        raise FitRefused(
            f"the sample rate must lie between {LEAST_RATE_HZ:g} and {MOST_RATE_HZ:g} Hz, got {rate_hz:g} Hz; "
            "resample the recording"
        )


def cut_note(samples: ArrayLike, rate_hz: float) -> RecordedNote:
    """The first note of a recording, (n,) or (n, channels), full scale 1. Raises FitRefused."""
    _check_rate(rate_hz)
    x, warnings = _one_channel(samples, rate_hz)
    peak = float(np.abs(x).max())
    peak_db = gain_to_db(peak)
    offset = float(x.mean())
    x = x - offset
    if gain_to_db(float(np.abs(x).max())) < SILENCE_DB:
        if peak_db < SILENCE_DB:
            raise FitRefused(f"the recording is silent, its peak is at {peak_db:.0f} dBFS; record it louder")
        raise FitRefused(
            f"the recording is constant, at {offset:.3g} of full scale: an offset without sound; check input and cable"
        )
    _refuse_clipping(x, rate_hz)
    begin, end, more = _first_note(x, rate_hz)
    warnings += more
    if (end - begin) / rate_hz > MOST_NOTE_S:
        end = begin + round(MOST_NOTE_S * rate_hz)
    if (end - begin) / rate_hz < LEAST_S:
        raise FitRefused(
            f"the note must last at least {LEAST_S:g} s, got {(end - begin) / rate_hz:.2g} s; "
            "record one pluck and let it ring"
        )
    before = x[: max(0, begin - round(0.02 * rate_hz))]
    noise = float(np.std(before)) if before.size > 0.05 * rate_hz else 0.0
    note = x[begin:end]
    return RecordedNote(note - note.mean(), rate_hz, begin / rate_hz, peak_db, noise, tuple(warnings), before)


def _one_channel(samples: ArrayLike, rate_hz: float) -> tuple[NDArray[np.float64], list[str]]:
    """(n,) and warnings. Of several channels the mixture with most energy (the first principal component).

    A mere sum would cancel what the channels have in opposite phase.
    """
    array = np.asarray(samples)
    if array.ndim not in (1, 2) or array.size == 0:
        raise FitRefused(f"the recording must hold samples, got an array of shape {array.shape}")
    warnings = []
    most = round(MOST_S * rate_hz)
    if len(array) > most:
        warnings.append(f"only the first {MOST_S:g} s of {len(array) / rate_hz:.3g} s are used")
        array = array[:most]
    x = np.asarray(array, dtype=np.float64)
    if not np.all(np.isfinite(x)):
        raise FitRefused(f"the recording holds {np.count_nonzero(~np.isfinite(x))} samples that are not finite")
    largest = float(np.abs(x).max())
    if largest > LARGEST:
        raise FitRefused(f"the recording's samples must lie within ±{LARGEST:g} (full scale is 1), got {largest:.3g}")
    if x.ndim == 1:
        return x, warnings
    for channel in range(x.shape[1]):
        if np.abs(x[:, channel]).max() > 0.0:
            _refuse_clipping(x[:, channel] - x[:, channel].mean(), rate_hz)
    if x.shape[1] == 1:
        return x[:, 0], warnings
    centred = x - x.mean(axis=0)
    weights = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    weights = weights / weights[np.argmax(np.abs(weights))]
    return x @ weights / np.abs(weights).sum(), warnings


def refuse_slow(x: NDArray[np.float64], rate_hz: float) -> None:
    """Raises FitRefused for a single oscillation below all pitches, whose flat tops look like clipping."""
    power = np.abs(np.fft.rfft(x * np.hanning(x.size), 2 * x.size)) ** 2
    top = int(np.argmax(power))
    width = 4  # of the window's main lobe to each side
    tone = power[max(0, top - width) : top + width + 1].sum()
    hz = top * rate_hz / (2 * x.size)
    if hz < 0.75 * LOWEST_HZ and tone > 0.8 * power.sum() and top >= width:
        raise FitRefused(
            f"the sound lies at {hz:.3g} Hz, below the pitches that can be fitted, {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz; "
            "check the sample rate, or record a plucked string"
        )


def _refuse_clipping(x: NDArray[np.float64], rate_hz: float) -> None:
    """Many rows of equal samples at the largest or smallest value are a clipped recording."""
    for side in (x, -x):
        at_limit = side >= side.max() * (1.0 - 1e-6)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], at_limit.view(np.int8), [0]])))
        rows = edges[1::2] - edges[::2]
        clipped = rows[rows >= _CLIPPED_ROW]
        if clipped.size >= _CLIPPED_ROWS and side.max() > 0.0:
            refuse_slow(x, rate_hz)
            raise FitRefused(
                f"the recording is clipped: {clipped.size} times {_CLIPPED_ROW} or more samples in a row "
                "stand at its limit; record it at a lower level"
            )


def _levels_db(x: NDArray[np.float64], rate_hz: float, window_s: float, hop_s: float) -> NDArray[np.float64]:
    """Level of frames of window_s every hop_s [dB]; −200 is digital silence."""
    hop = max(1, round(hop_s * rate_hz))
    size = max(hop, round(window_s * rate_hz))
    total = np.concatenate([[0.0], np.cumsum(x**2)])
    first = np.arange(0, max(1, x.size - size + 1), hop)
    power = (total[np.minimum(first + size, x.size)] - total[first]) / size
    return 10.0 * np.log10(np.maximum(power, 1e-20))


def _first_note(x: NDArray[np.float64], rate_hz: float) -> tuple[int, int, list[str]]:
    """(first, past the last) sample of the first note that comes within 20 dB of the loudest, and warnings."""
    hop_s = 0.005
    level = _levels_db(x, rate_hz, 0.01, hop_s)
    loud = int(np.argmax(level > level.max() - 20.0))
    top = level[loud : loud + round(0.1 / hop_s)].max()
    quiet = max(top - 40.0, float(np.median(level[:loud])) + 6.0) if loud else top - 40.0
    begin = loud
    while begin > 0 and level[begin - 1] > quiet and level[begin - 1] < level[begin] + 1.0:
        begin -= 1
    start = round((begin + 1) * hop_s * rate_hz) if begin else 0
    end, warnings = x.size, []

    # Fast changes show best with the high frequencies raised, which a pluck has and a ringing string has lost.
    hop_s = 0.01
    bright = _levels_db(np.diff(x[start:], append=x[-1]), rate_hz, 0.05, hop_s)
    plain = _levels_db(x[start:], rate_hz, 0.05, hop_s)
    lag = 7
    rise = (bright[lag:] - bright[:-lag] > 9.0) & (plain[lag:] > plain.max() - 40.0) & (plain[lag:] - plain[:-lag] > 1.5)
    rise[: round(0.12 / hop_s)] = False
    if rise.any():
        at = int(np.argmax(rise)) + lag // 2
        end = start + round(at * hop_s * rate_hz)
        warnings.append(f"only the first note is measured: another begins {at * hop_s:.2f} s after it")
    plain = plain[: max(1, round((end - start) / rate_hz / hop_s))]
    lag = 10
    if plain.size > 3 * lag:
        fall = plain[2 * lag :] - plain[lag:-lag]
        before = plain[lag:-lag] - plain[: -2 * lag]
        stop = (fall < -15.0) & (before > -5.0) & (plain[lag:-lag] > plain.max() - 60.0)
        stop[: round(0.1 / hop_s)] = False
        if stop.any():
            at = int(np.argmax(stop)) + lag - 2
            end = start + round(at * hop_s * rate_hz)
            warnings.append(f"the note is cut off or damped {at * hop_s:.2f} s after its onset; it is measured up to there")
    return start, end, warnings
