"""What a recording has lost for good: a codec's holes in the spectrum.

A codec of few bits leaves out what it takes for inaudible: a third of an octave falls silent for a hundredth of a second and
comes back. A string, a room and a noise do not: their levels change slowly, or all at once.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from synth.fit.recording import FitRefused, RecordedNote

#: seconds that are looked at, of each frame (half over each other)
SECONDS, FRAME_S = 2.3, 0.0232
#: bands: three an octave from there, at most so many; frames around one whose median is its usual level
LOWEST_HZ, OCTAVE, BANDS, AROUND = 1000.0, 3, 12, 9
#: bands within so much of the loudest count; a hole is that deep [dB]
WITHIN_DB, DEEP_DB = 70.0, 20.0
#: share of holes that recordings of strings do not have: of some 145 of basses, guitars and a sitar one, of a slapped bass,
#: has more. Of eight notes MP3 of up to 40 kbit/s leaves 0.0087 to 0.047, of 48 and 56 less than this in three of sixteen,
#: of 64 at most 0.0017
MOST_HOLES = 0.003


def holes(note: RecordedNote) -> float:
    """Share of the short pieces of bands that are holes."""
    x = note.samples[: round(SECONDS * note.rate_hz)]
    size = round(FRAME_S * note.rate_hz)
    frames = np.lib.stride_tricks.sliding_window_view(x, size)[:: size // 2] * np.hanning(size)
    power = np.abs(np.fft.rfft(frames)) ** 2
    edges = LOWEST_HZ * 2.0 ** (np.arange(BANDS + 1) / OCTAVE)
    first = np.ceil(edges[edges < 0.45 * note.rate_hz] * size / note.rate_hz).astype(np.int64)
    sums = np.concatenate([np.zeros((len(power), 1)), np.cumsum(power, axis=1)], axis=1)
    level: NDArray[np.float64] = 10.0 * np.log10(np.maximum(np.diff(sums[:, first], axis=1), 1e-30))
    usual = median_filter(level, size=(AROUND, 1))
    heard = usual > level.max() - WITHIN_DB
    deep = (usual - level > DEEP_DB) & heard
    # where most bands fall silent at once the note ends, or was cut
    deep &= 2 * deep.sum(axis=1, keepdims=True) <= heard.sum(axis=1, keepdims=True)
    return float(deep.sum() / max(1, heard.sum()))


def refuse_holes(note: RecordedNote) -> None:
    """Raises FitRefused for a recording that a codec has damaged."""
    share = holes(note)
    if share > MOST_HOLES:
        raise FitRefused(
            f"the recording has holes in its spectrum ({100.0 * share:.1f} % of it falls silent for moments, at most "
            f"{100.0 * MOST_HOLES:g} %), as a codec at a low bit rate leaves them; give the uncompressed recording "
            "(WAV or FLAC)"
        )
