"""A sound as it goes into a data set: its level, its measures, its integers, FLAC."""

from __future__ import annotations

import hashlib
import io
import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from synth.dataset.recipefile import Level, SoundTable
from synth.dsp.k_weighting import loudness_lufs
from synth.host.audiofile import Quantizer
from synth.units import db_to_gain, gain_to_db

#: a sound begins where it first reaches this share of its peak (−40 dB)
ONSET_SHARE = 0.01
_LEVELS = 8


@dataclass(frozen=True)
class Packed:
    """FLAC of an item, and what the index says of it.

    pcm             (frames, channels) int16, or int32 with 24 bits in the upper bytes, as `soundfile` reads them
    gain_db         what was added to the engine's level; `lowered`: more than asked for was taken off
    peak_dbfs, loudness_lufs, onset_s   None of silence
    """

    flac: bytes
    pcm: np.ndarray
    gain_db: float
    lowered: bool
    peak_dbfs: float | None
    loudness_lufs: float | None
    onset_s: float | None
    sha256: str


def pack(samples: np.ndarray, sound: SoundTable, level: Level, seed: int) -> Packed:
    """Of (frames, 2) float64, full scale ±1. seed: of the dither of 16 bits. Raises ValueError for what is not finite."""
    samples = np.ascontiguousarray(samples, np.float64)
    heard = np.empty((len(samples), sound.channels))
    loudest = _heard(samples, heard)
    if not np.isfinite(loudest):
        raise ValueError("the sound contains NaN or infinite numbers")
    gain = db_to_gain(level.gain_db)
    if level.normalize_dbfs is not None and loudest > 0.0:
        gain = db_to_gain(level.normalize_dbfs) / loudest
    lowered = loudest * gain > db_to_gain(level.ceiling_dbfs)
    if lowered:
        gain = db_to_gain(level.ceiling_dbfs) / loudest
    pcm = _integers(heard, gain, sound, seed)
    return Packed(
        encode(pcm, sound),
        pcm,
        gain_to_db(gain),
        lowered,
        gain_to_db(loudest * gain) if loudest > 0.0 else None,
        loudness_lufs(heard, sound.rate_hz, gain),
        _onset(heard, ONSET_SHARE * loudest) / sound.rate_hz if loudest > 0.0 else None,
        digest(pcm),
    )


def _integers(heard: np.ndarray, gain: float, sound: SoundTable, seed: int) -> np.ndarray:
    """As `Quantizer` rounds; what has no dither in one pass. Nothing lies above full scale: the ceiling is below."""
    if sound.bit_depth != 24:
        quantize = Quantizer(str(sound.bit_depth), seed)
        return quantize(heard * gain)
    pcm = np.empty(heard.shape, np.int32)
    _rounded(heard.reshape(-1), gain, pcm.reshape(-1))
    return pcm


@njit(cache=True, nogil=True)
def _heard(samples, out):
    """out (frames, 1 or 2): the mean of both channels, or both; the largest magnitude, nan where one is not finite."""
    largest = total = 0.0
    if out.shape[1] == 1:
        for n in range(samples.shape[0]):
            x = 0.5 * (samples[n, 0] + samples[n, 1])
            out[n, 0] = x
            largest = max(largest, abs(x))
            total += abs(x)
    else:
        for n in range(samples.shape[0]):
            for channel in range(2):
                x = samples[n, channel]
                out[n, channel] = x
                largest = max(largest, abs(x))
                total += abs(x)
    return largest if math.isfinite(total) else math.nan


@njit(cache=True, nogil=True)
def _rounded(samples, gain, out):
    """24 bits in the upper bytes of 32."""
    for n in range(samples.size):
        out[n] = np.int32(np.rint(samples[n] * gain * 8388608.0)) << 8


@njit(cache=True, nogil=True)
def _onset(samples, least):
    """The first frame with a magnitude of at least this."""
    for n in range(samples.shape[0]):
        for channel in range(samples.shape[1]):
            if abs(samples[n, channel]) >= least:
                return n
    return samples.shape[0]


def encode(pcm: np.ndarray, sound: SoundTable) -> bytes:
    """FLAC of (frames, channels) integers."""
    import soundfile

    out = io.BytesIO()
    with soundfile.SoundFile(
        out, "w", sound.rate_hz, sound.channels, f"PCM_{sound.bit_depth}", format="FLAC",
        compression_level=sound.flac_level / _LEVELS,
    ) as file:  # fmt: skip
        file.write(pcm)
    return out.getvalue()


def decode(flac: bytes) -> tuple[np.ndarray, int]:
    """((frames, channels) integers as `Packed.pcm` has them, rate in Hz). Raises ValueError for what is no FLAC."""
    import soundfile

    try:
        with soundfile.SoundFile(io.BytesIO(flac)) as file:
            kind = "int16" if file.subtype == "PCM_16" else "int32"
            return file.read(dtype=kind, always_2d=True), file.samplerate
    except soundfile.LibsndfileError as error:
        raise ValueError(f"cannot be read as a FLAC file: {error}") from None


def digest(pcm: np.ndarray) -> str:
    """SHA-256 of integers, little-endian, channel after channel in each frame."""
    return hashlib.sha256(np.ascontiguousarray(pcm, pcm.dtype.newbyteorder("<")).tobytes()).hexdigest()
