"""The measure of a buzz: how much louder contact makes a third octave of a note.

A fret takes energy from the low partials of a note and gives it to the high ones. The measure compares the note with the
same stroke over no frets, in third octaves (IEC 61260-1), over the time in which the ear adds up loudness:

    B = max_b 10 log₁₀ (E_b + m) / (E⁰_b + m),    b: bands from 5 f₁ to 10 kHz,    m = 10⁻⁴ E⁰,

E_b and E⁰_b the A-weighted energies of the note with and without contact, E⁰ that of the whole note without, also below
those bands. Bands begin at the fifth partial, below which a third octave may hold none, but not from above 8 kHz; what lies
40 dB below the whole note is taken as lost in the noise of a quiet room: 30 dB(A) under a note of 70 dB(A).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

#: seconds after the string is free over which energy is added up; their second half fades away
WINDOW_S = 0.25
#: a band that is so much louder than without contact is heard [dB]
AUDIBLE_DB = 3.0
#: bands: from this partial on, but not from a higher frequency than that, up to the last [Hz]
FROM_PARTIAL, HIGHEST_LOWEST_HZ, HIGHEST_HZ = 5.0, 8000.0, 10000.0
#: what is so far below the whole note is lost in the noise of a room [dB]
MASKED_DB = -40.0


@lru_cache(64)
def _weights(count: int, rate_hz: float, lowest_hz: float, speed: bool) -> tuple[np.ndarray, np.ndarray]:
    """(bins,) A-weighted power of each bin of a spectrum, (bands,) the first bin of each band and the end."""
    f = np.fft.rfftfreq(count, 1.0 / rate_hz)
    squared = f**2
    a = 12194.0**2 * squared**2 / (
        (squared + 20.6**2) * np.sqrt((squared + 107.7**2) * (squared + 737.9**2)) * (squared + 12194.0**2)
    )  # fmt: skip
    weights = a**2 * (squared if speed else 1.0)
    numbers = np.arange(-20, 14)
    edges = 1000.0 * 10.0 ** ((numbers - 0.5) / 10.0)
    edges = edges[(edges <= HIGHEST_HZ * 10.0**0.05 + 1e-6)]
    bands = edges[edges >= lowest_hz * 10.0**-0.05]
    return weights, np.searchsorted(f, bands)


def fade(count: int, free: int) -> np.ndarray:
    """(count,) window: 1 until half way between step `free` and the end, from there on half a cosine to 0."""
    window = np.ones(count)
    first = free + (count - free) // 2
    window[first:] = 0.5 * (1.0 + np.cos(np.pi * np.linspace(0.0, 1.0, count - first)))
    return window


def band_energies(y: np.ndarray, rate_hz: float, pitch_hz: float, *, speed: bool) -> tuple[np.ndarray, float]:
    """A-weighted energy of each band from the fifth partial on, and of the whole signal.

    y (n,) from the touch of the finger on, windowed; `speed`: its derivative is heard.
    """
    weights, edges = _weights(y.size, rate_hz, min(FROM_PARTIAL * pitch_hz, HIGHEST_LOWEST_HZ), speed)
    power = np.abs(np.fft.rfft(y)) ** 2 * weights
    sums = np.concatenate([[0.0], np.cumsum(power)])
    return np.diff(sums[edges]), float(sums[-1])


def buzz_db(contact: np.ndarray, free: np.ndarray, whole: float) -> float:
    """B [dB] of the energies of a note with contact and without, `whole` the whole energy without."""
    masked = 10.0 ** (0.1 * MASKED_DB) * whole
    if not free.size or whole <= 0.0:
        return 0.0
    return float(10.0 * np.log10(((contact + masked) / (free + masked)).max()))


#: frames in which a buzz is heard or not [s]
FRAME_S = 0.05


def buzz_seconds(
    y: np.ndarray, free: np.ndarray, rate_hz: float, begin: int, pitch_hz: float, audible_db: float, *, speed: bool
) -> float:
    """How long a buzz is heard from sample `begin` on, all frames together in which B reaches `audible_db` [s].

    y, free (n,): the note with contact and without. In each frame B is that of `buzz_db`, with the masked level 40 dB below
    the loudest frame of the note without contact.
    """
    size = round(FRAME_S * rate_hz)
    window = np.hanning(size)
    starts = range(begin, y.size - size + 1, size // 2)
    without = [band_energies(free[at : at + size] * window, rate_hz, pitch_hz, speed=speed) for at in starts]
    loudest = max((whole for _, whole in without), default=0.0)
    heard = 0
    for at, (energies, _) in zip(starts, without, strict=True):
        contact, _ = band_energies(y[at : at + size] * window, rate_hz, pitch_hz, speed=speed)
        if buzz_db(contact, energies, loudest) >= audible_db:
            heard += 1
    return heard * (size // 2) / rate_hz
