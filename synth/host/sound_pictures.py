"""Pictures of sounds: the waveform, and below it the spectrogram of both channels together. They need matplotlib."""

from __future__ import annotations

from typing import Any

import numpy as np

from synth.dsp.measures import stft_power
from synth.files import notebook_html

#: frames of a spectrum, and at most so many spectra in a picture
SIZE, COLUMNS = 2048, 1200
#: a waveform is drawn as the least and largest of so many stretches
STRETCHES = 1500
_COLOURS = ("#8a4b16", "#1c6e8c")


def two_axes(width: float = 9.0, height: float = 5.0) -> Any:
    """Two Axes of a new figure of pyplot's, one above the other. Raises ImportError without matplotlib."""
    notebook_html.need("matplotlib", "plot")
    import matplotlib.pyplot as plt

    return plt.subplots(2, 1, sharex=True, figsize=(width, height), height_ratios=(1, 2), layout="constrained")[1]


def small_png(samples: np.ndarray, rate_hz: int) -> bytes:
    """The picture as a notebook shows it."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 3.2), dpi=80, layout="constrained")
    draw(samples, rate_hz, figure.subplots(2, 1, sharex=True, height_ratios=(1, 2)), 10_000.0, 70.0)
    return notebook_html.png_of(figure)


def draw(samples: np.ndarray, rate_hz: int, axes: Any, highest_hz: float, range_db: float) -> None:
    """Waveform and spectrogram of (frames, channels) samples into two Axes."""
    if not (highest_hz > 0.0 and range_db > 0.0):
        raise ValueError(f"highest_hz and range_db must be > 0, got {highest_hz!r} and {range_db!r}")
    above, below = axes
    for channel, colour in zip(range(samples.shape[1]), _COLOURS, strict=False):
        seconds, least, largest = envelope(samples[:, channel], rate_hz)
        above.fill_between(seconds, least, largest, color=colour, alpha=0.7, linewidth=0.5)
    above.set_ylabel("full scale")
    seconds, hertz, levels = spectrogram(samples, rate_hz, highest_hz)
    loudest = float(levels.max(initial=-np.inf))
    if np.isfinite(loudest):
        below.pcolormesh(seconds, hertz / 1e3, levels, vmin=loudest - range_db, vmax=loudest, cmap="magma", rasterized=True)
    below.set_ylim(0.0, min(highest_hz, 0.5 * rate_hz) / 1e3)
    below.set_facecolor("black")
    below.set_ylabel("kHz")
    below.set_xlabel("s")
    below.set_xlim(0.0, max(len(samples), 1) / rate_hz)


def envelope(x: np.ndarray, rate_hz: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(seconds, least, largest) of stretches of a signal (n,), STRETCHES at most; none of an empty one."""
    if not x.size:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    starts = np.unique(np.linspace(0, x.size, min(x.size, STRETCHES), endpoint=False).astype(int))
    return starts / rate_hz, np.minimum.reduceat(x, starts), np.maximum.reduceat(x, starts)


def spectrogram(samples: np.ndarray, rate_hz: int, highest_hz: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(seconds (m,), hertz (b,), levels (b, m) [dB, of any zero]) of the channels together: m spectra, COLUMNS at most."""
    hop = max(SIZE // 8, -(-len(samples) // COLUMNS))
    bins = 1 + int(min(highest_hz, 0.5 * rate_hz) * SIZE / rate_hz)
    power = sum(stft_power(channel, SIZE, hop)[:, :bins] for channel in samples.T)
    with np.errstate(divide="ignore"):
        levels = 10.0 * np.log10(np.asarray(power).T)
    seconds = (np.arange(levels.shape[1]) * hop + 0.5 * SIZE) / rate_hz
    return seconds, np.arange(bins) * rate_hz / SIZE, levels
