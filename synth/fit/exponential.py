"""One damped partial at a time: its complex envelope out of the note's spectrum, and the exponential in it.

The note is shifted by the partial's frequency to 0 Hz and smoothed by a Blackman–Harris window four periods of the
fundamental long, whose main lobe ends where the neighbouring partials lie. A damped sinusoid stays one under any such
filter from the moment the window lies wholly behind the onset, so that

    y(t) = a e^(−σt + iδt) + noise

can be fitted by least squares, which for white noise is maximum likelihood: frequency, decay and amplitude with their
standard errors from the curvature.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synth.dsp.measures import blackman_harris

#: length of the smoothing window in periods of the fundamental; its main lobe is 4 bins to each side
WINDOW_PERIODS = 4.0
# The part of the spectrum kept to each side, in units of the fundamental: the main lobe and what lies behind it.
_KEPT = 1.25


class Bands:
    """The envelopes of a note's partials, all out of one transform.

    samples: (n,) from the onset on.  spacing_hz: fundamental, the distance of the partials.
    """

    def __init__(self, samples: NDArray[np.float64], rate_hz: float, spacing_hz: float) -> None:
        self.rate_hz = rate_hz
        self.spacing_hz = spacing_hz
        self.length = max(5, round(WINDOW_PERIODS * rate_hz / spacing_hz)) | 1
        if samples.size < 2 * self.length:
            raise ValueError(
                f"the note must hold {2 * WINDOW_PERIODS:g} periods of {spacing_hz:.4g} Hz, "
                f"got {samples.size / rate_hz * spacing_hz:.2g}"
            )
        self._samples = samples.size
        self._size = 1 << int(np.ceil(np.log2(samples.size + self.length)))
        self._spectrum = np.fft.rfft(samples, self._size)
        self._half = int(np.ceil(_KEPT * spacing_hz * self._size / rate_hz))
        self._window = blackman_harris(self.length)
        self._window /= self._window.sum()
        self._response = _zero_phase_response(self._window, self._half, self._size)
        # Between two partials only a window of twice the length sees neither. Its noise is made comparable.
        narrow = blackman_harris(2 * self.length + 1)
        narrow /= narrow.sum()
        raised = np.sqrt((self._window @ self._window) / (narrow @ narrow))
        self._narrow_response = raised * _zero_phase_response(narrow, self._half, self._size)

    def envelope(self, frequency_hz: float) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """(times from the onset [s], envelope) where the window lies inside the note; an amplitude A gives |y| = A."""
        return self._filtered(frequency_hz, self._response, self.length)

    def beside(self, frequency_hz: float) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """The same midway between partials: an envelope with the noise that theirs have; may be empty in a short note."""
        return self._filtered(frequency_hz, self._narrow_response, 2 * self.length)

    def _filtered(
        self, frequency_hz: float, response: NDArray[np.float64], length: int
    ) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        centre = round(frequency_hz / self.rate_hz * self._size)
        low, high = centre - self._half, centre + self._half + 1
        piece = np.zeros(high - low, dtype=np.complex128)
        inside = slice(max(low, 0), min(high, self._spectrum.size))
        piece[inside.start - low : inside.stop - low] = self._spectrum[inside]
        piece *= response
        # Back to time at the rate that the kept band needs: the bin of the partial comes to 0 Hz.
        size = 1 << int(np.ceil(np.log2(piece.size)))
        padded = np.zeros(size, dtype=np.complex128)
        padded[: self._half + 1] = piece[self._half :]
        padded[-self._half :] = piece[: self._half]
        y = np.fft.ifft(padded) * (2.0 * size / self._size)
        t = np.arange(size, dtype=np.float64) * (self._size / size / self.rate_hz)
        edge = length / 2 / self.rate_hz
        keep = (t >= edge) & (t <= self._samples / self.rate_hz - edge)
        t, y = t[keep], y[keep]
        # What the centre bin lies beside the frequency asked for is turned back, so that phases refer to it.
        beside = centre * self.rate_hz / self._size - frequency_hz
        return t, y * np.exp(2j * np.pi * beside * t)

    def gain(self, decay: float) -> float:
        """By how much the window raises an amplitude that falls by e^(−decay·t)."""
        middle = (np.arange(self.length) - self.length // 2) / self.rate_hz
        return float(self._window @ np.exp(np.clip(-decay * middle, -50.0, 50.0)))


def _zero_phase_response(window: NDArray[np.float64], half: int, size: int) -> NDArray[np.float64]:
    """Transform of a symmetric window around its middle at −half … half bins of `size` samples; real, (2·half + 1,)."""
    middle = window.size // 2
    around = np.zeros(size)
    around[: window.size - middle] = window[middle:]
    around[-middle:] = window[:middle]
    response = np.fft.rfft(around)[: half + 1].real
    return np.concatenate([response[:0:-1], response])


@dataclass(frozen=True)
class Exponential:
    """y(t) = amplitude·e^(i·phase − decay·t + 2πi·shift_hz·t), fitted over [begin_s, end_s], with standard errors.

    misfit: rms of what is left over the rms of the envelope, over the piece fitted.
    """

    amplitude: float
    phase: float
    shift_hz: float
    decay: float
    shift_error_hz: float
    decay_error: float
    amplitude_error: float
    misfit: float
    begin_s: float
    end_s: float


def fit_exponential(t: NDArray[np.float64], y: NDArray[np.complex128], correlated: float = 1.0) -> Exponential | None:
    """The damped exponential of least squares through an envelope; None where there is none.

    correlated: how many neighbouring samples share their noise, for the standard errors.
    """
    from scipy.optimize import least_squares

    if t.size < 8:
        return None
    scale = float(np.abs(y).max())
    if not scale > 0.0:
        return None
    z = y / scale
    start = t[0]
    s = t - start
    span = s[-1]
    shift, decay = _first_guess(s, z)

    def basis(p: NDArray[np.float64]) -> NDArray[np.complex128]:
        return np.exp((2j * np.pi * p[0] - p[1]) * s)

    def amplitude_of(e: NDArray[np.complex128]) -> complex:
        return complex(np.vdot(e, z) / np.vdot(e, e).real)

    def residual(p: NDArray[np.float64]) -> NDArray[np.float64]:
        e = basis(p)
        r = amplitude_of(e) * e - z
        return np.concatenate([r.real, r.imag])

    limit = 20.0 / span
    try:
        found = least_squares(residual, [shift, max(decay, -limit)], x_scale=[0.1 / span, 0.3 / span], max_nfev=60)
    except (ValueError, np.linalg.LinAlgError):
        return None
    shift, decay = (float(v) for v in found.x)
    e = basis(found.x)
    if not np.all(np.isfinite(e)):
        return None
    a = amplitude_of(e)
    left = a * e - z
    noise = float(np.sqrt(np.mean(np.abs(left) ** 2)))
    # Curvature of the full problem (log amplitude, phase, shift, decay).
    columns = a * e[:, None] * np.stack([np.ones_like(s), 1j * np.ones_like(s), 2j * np.pi * s, -s], axis=1)
    jacobian = np.concatenate([columns.real, columns.imag])
    normal = jacobian.T @ jacobian
    try:
        covariance = np.linalg.inv(normal) * (noise**2 / 2.0) * correlated
    except np.linalg.LinAlgError:
        return None
    error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    amplitude = abs(a) * float(np.exp(min(decay * start, 50.0)))
    rms = float(np.sqrt(np.mean(np.abs(z) ** 2)))
    return Exponential(
        amplitude * scale,
        float(np.angle(a) - 2.0 * np.pi * shift * start),
        shift,
        decay,
        float(error[2]),
        float(error[3]),
        amplitude * scale * float(error[0]),
        noise / rms,
        float(t[0]),
        float(t[-1]),
    )


@dataclass(frozen=True)
class LevelLine:
    """The line of least squares through the level over time, as T60 is commonly read off, and the pitch meanwhile.

    level_db: at the onset.  decay: σ [1/s].  roughness_db: rms of the level beside the line.  range_db: how far it falls.
    decay_error: how far σ moves when the line begins and ends elsewhere.  shift_hz, shift_error_hz: slope of the phase
    over that time, so that a pitch that glides gives its average over time, not that of the loud beginning.
    """

    level_db: float
    decay: float
    decay_error: float
    roughness_db: float
    range_db: float
    shift_hz: float
    shift_error_hz: float


#: the line runs from there to there below the maximum [dB]; the others tell how much that choice matters
LINE_DB = (-3.0, -33.0)
_OTHER_LINES_DB = ((-2.0, -28.0), (-5.0, -38.0))


def fit_level_line(t: NDArray[np.float64], y: NDArray[np.complex128], noise: float) -> LevelLine | None:
    """The line between −3 dB and −33 dB below the maximum, or 6 dB above the noise; None where that is too little."""
    level = 20.0 * np.log10(np.maximum(np.abs(y), 1e-15))
    loudest = int(np.argmax(level))
    top = float(level[loudest])
    quiet = 20.0 * np.log10(max(noise, 1e-15)) + 6.0
    phase = np.unwrap(np.angle(y[loudest:]))
    t, level = t[loudest:], level[loudest:]

    def piece(bounds: tuple[float, float]) -> slice:
        return slice(_first_below(level, top + bounds[0]), _first_below(level, max(top + bounds[1], quiet)))

    used = piece(LINE_DB)
    if used.stop - used.start < 6:
        return None
    slope, at_onset, roughness = _line(t[used], level[used])
    others = [_line(t[p], level[p])[0] for p in map(piece, _OTHER_LINES_DB) if p.stop - p.start >= 6]
    turn, _, jitter = _line(t[used], phase[used])
    span = float(t[used][-1] - t[used][0])
    per_db = -np.log(10.0) / 20.0
    return LevelLine(
        at_onset,
        per_db * slope,
        -per_db * max((abs(other - slope) for other in others), default=abs(slope)),
        roughness,
        float(level[used.start] - level[used.stop - 1]),
        turn / (2.0 * np.pi),
        np.sqrt(3.0) * jitter / (2.0 * np.pi * span),  # as if four of its samples were independent
    )


def _first_below(level: NDArray[np.float64], db: float) -> int:
    below = level < db
    return int(np.argmax(below)) if below.any() else level.size


def _line(t: NDArray[np.float64], level: NDArray[np.float64]) -> tuple[float, float, float]:
    """Slope [dB/s], value at t = 0 and rms beside the line."""
    centred = t - t.mean()
    slope = float(centred @ level / (centred @ centred))
    left = level - level.mean() - slope * centred
    return slope, float(level.mean() - slope * t.mean()), float(np.sqrt(np.mean(left**2)))


def _first_guess(s: NDArray[np.float64], z: NDArray[np.complex128]) -> tuple[float, float]:
    """Frequency [Hz] from the highest bin of the padded spectrum, decay from the levels of two halves."""
    step = s[1] - s[0]
    size = 1 << int(np.ceil(np.log2(4 * s.size)))
    spectrum = np.abs(np.fft.fft(z, size))
    shift = float(np.fft.fftfreq(size, step)[int(np.argmax(spectrum))])
    power = np.abs(z) ** 2
    # Centre of gravity of the power: 1/(2σ) of a decay that is over within the piece.
    total = float(power.sum())
    centre = float(s @ power) / total
    span = s[-1]
    if centre >= 0.49 * span:
        return shift, 0.0
    low, high = 0.0, 200.0 / span
    for _ in range(40):
        middle = 0.5 * (low + high)
        twice = 2.0 * middle * span
        of_middle = span * (1.0 / twice - 1.0 / np.expm1(twice)) if twice > 1e-6 else 0.5 * span
        low, high = (middle, high) if of_middle > centre else (low, middle)
    return shift, 0.5 * (low + high)
