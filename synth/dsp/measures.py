"""What is measured on signals: errors against a reference, pitch, decay, levels, clicks.

Signals are (n,) arrays at ``rate_hz``; a signal with a wrong shape or content that cannot be measured raises
ValueError and says why. Only NumPy is needed, except by :func:`audible_band_error`, which runs the decimator.

Pitch and decay look at one partial at a time: the signal is shifted by that partial's frequency to 0 Hz and
smoothed by a four-term Blackman–Harris window (sidelobes below −92 dB, Harris 1978, Proc. IEEE 66(1)), so
that its neighbours, DC and most of the noise fall away. What remains is the partial's complex envelope: its
phase tells the frequency, its logarithm the decay.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

_BLACKMAN_HARRIS = (0.35875, 0.48829, 0.14128, 0.01168)
# A local maximum that far below the highest of its spectrum may be one of the window's sidelobes.
_PEAK_FLOOR_DB = -85.0
# The main lobe of that window ends 4 bins from its middle.
_MAIN_LOBE_BINS = 4.0


def _signal(name: str, x: ArrayLike) -> NDArray[np.float64]:
    x = np.asarray(x, dtype=np.float64)
    if x.ndim != 1 or x.size == 0:
        raise ValueError(f"{name} must be a signal with one dimension, got shape {x.shape}; choose one channel")
    if not np.all(np.isfinite(x)):
        raise ValueError(f"{name} must be finite, got {np.count_nonzero(~np.isfinite(x))} NaN or infinite samples")
    return x


def _pair(u: ArrayLike, ref: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    u, ref = np.asarray(u, dtype=np.float64), np.asarray(ref, dtype=np.float64)
    if u.shape != ref.shape:
        raise ValueError(f"u and ref must have the same shape, got {u.shape} and {ref.shape}; compare at common times")
    if not np.any(ref):
        raise ValueError("ref must not be silent, got zeros only; an error relative to silence has no meaning")
    return u, ref


def blackman_harris(n: int) -> NDArray[np.float64]:
    """Symmetric four-term Blackman–Harris window of n samples (Harris 1978), whose ends are nearly zero."""
    phase = 2 * np.pi * np.arange(n) / max(1, n - 1)
    window = np.zeros(n)
    for k, a in enumerate(_BLACKMAN_HARRIS):
        window += (-1) ** k * a * np.cos(k * phase)
    return window


# --- errors against a reference -----------------------------------------------------------------------------


def relative_error(u: ArrayLike, ref: ArrayLike) -> float:
    """e = √(Σ(ref − u)²/Σref²) over all samples, the measure of Issanchou et al. 2017.

    u, ref : signals of the same shape at common times. A NaN in u gives NaN.
    """
    u, ref = _pair(u, ref)
    return float(np.sqrt(np.sum((ref - u) ** 2) / np.sum(ref**2)))


def audible_band_error(u: ArrayLike, ref: ArrayLike, rate_hz: float, factor: int, ref_factor: int | None = None) -> float:
    """:func:`relative_error` of what is left below 20 kHz: both signals go through the decimator first.

    Parameters
    ----------
    u : (n·factor,) signal at factor·rate_hz.
    ref : (n·ref_factor,) reference at ref_factor·rate_hz.
    rate_hz : the output rate at which they are compared [Hz].
    ref_factor : as ``factor`` unless given.
    """
    from synth.dsp.decimator import decimate_signal

    ref_factor = factor if ref_factor is None else ref_factor
    return relative_error(decimate_signal(u, rate_hz, factor), decimate_signal(ref, rate_hz, ref_factor))


def stft_power(x: NDArray[np.float64], size: int, hop: int) -> NDArray[np.float64]:
    """(frames, size//2 + 1) power spectra of Hann-windowed frames of `size` every `hop`, the last filled up with zeros."""
    frames = max(1, 1 + -(-(x.size - size) // hop))
    padded = np.zeros((frames - 1) * hop + size)
    padded[: x.size] = x
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(size) / size)
    segments = np.lib.stride_tricks.sliding_window_view(padded, size)[::hop]
    return np.abs(np.fft.rfft(segments * window, axis=1)) ** 2


def log_spectral_distance(
    u: ArrayLike,
    ref: ArrayLike,
    rate_hz: float,
    *,
    size: int = 2048,
    hop: int = 512,
    floor_db: float = -70.0,
    highest_hz: float = 20000.0,
) -> float:
    """Root mean square over time and frequency of the difference of two spectrograms in dB.

    u, ref : (n,) signals at ``rate_hz``. Both spectrograms (Hann frames of ``size`` every ``hop``) are raised
    to ``floor_db`` below the largest value of the reference's, so that what nobody hears does not count. Bins
    up to ``highest_hz``, without DC.
    """
    u, ref = _pair(_signal("u", u), _signal("ref", ref))
    power_u, power_ref = stft_power(u, size, hop), stft_power(ref, size, hop)
    bins = slice(1, 1 + int(min(highest_hz, rate_hz / 2) * size / rate_hz))
    power_u, power_ref = power_u[:, bins], power_ref[:, bins]
    floor = power_ref.max() * 10 ** (floor_db / 10)
    difference = 10 * np.log10(np.maximum(power_u, floor) / np.maximum(power_ref, floor))
    return float(np.sqrt(np.mean(difference**2)))


def third_octave_distance(u: ArrayLike, ref: ArrayLike, rate_hz: float, *, floor_db: float = -70.0) -> float:
    """Root mean square over 24 third-octave bands, 78 Hz to 20 kHz, of the difference in level over the whole signal [dB].

    u, ref : (n,) signals at ``rate_hz``, long enough for the lowest band. Levels are raised to ``floor_db`` below the
    reference's loudest band. Two runs of a chaotic string agree in this where they do not as signals.
    """
    u, ref = _pair(_signal("u", u), _signal("ref", ref))
    edges = min(20000.0, 0.5 * rate_hz) * 2.0 ** (np.arange(-24, 1) / 3.0)
    if u.size < rate_hz / (edges[1] - edges[0]):
        raise ValueError(
            f"u must last at least {1.0 / (edges[1] - edges[0]):.2g} s, got {u.size / rate_hz:.2g} s; compare longer signals"
        )
    level_u, level_ref = band_levels_db(u, rate_hz, edges), band_levels_db(ref, rate_hz, edges)
    floor = level_ref.max() + floor_db
    return float(np.sqrt(np.mean((np.maximum(level_u, floor) - np.maximum(level_ref, floor)) ** 2)))


# --- spectra ------------------------------------------------------------------------------------------------


def spectrum(x: ArrayLike, rate_hz: float, padding: int = 4) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Amplitude spectrum of the whole signal in a Blackman–Harris window.

    Returns
    -------
    (frequencies_hz, amplitude) : (m,) each. A sine of amplitude A peaks at A. ``padding`` ≥ 1 is how many
    times finer than 1/duration the frequencies lie, at least.
    """
    x = _signal("x", x)
    window = blackman_harris(x.size)
    size = 1 << int(np.ceil(np.log2(x.size * padding)))
    amplitude = np.abs(np.fft.rfft(x * window, size)) * (2 / window.sum())
    return np.arange(amplitude.size) * (rate_hz / size), amplitude


def band_levels_db(x: ArrayLike, rate_hz: float, edges_hz: ArrayLike) -> NDArray[np.float64]:
    """Level of the signal in each band [dB re 1 rms], by Parseval over the whole signal without a window.

    edges_hz : (k + 1,) rising band edges. Returns (k,); an empty band gives −inf.
    """
    x = _signal("x", x)
    power = np.abs(np.fft.rfft(x)) ** 2 / x.size**2
    power[1 : (x.size + 1) // 2] *= 2
    total = np.concatenate([[0.0], np.cumsum(power)])
    edges = np.searchsorted(np.arange(power.size) * (rate_hz / x.size), np.asarray(edges_hz, dtype=np.float64))
    with np.errstate(divide="ignore"):
        return 10 * np.log10(np.maximum(total[edges[1:]] - total[edges[:-1]], 0.0))


def _strongest_peak(frequencies, amplitude, low_hz, high_hz):
    """(frequency, amplitude) of the highest local maximum between two frequencies, or None.

    By the parabola through the logarithms, which is exact for a Gaussian window and nearly so for this one.
    """
    first, last = np.searchsorted(frequencies, [low_hz, high_hz])
    first, last = max(first, 1), min(last, amplitude.size - 1)
    if first >= last:
        return None
    here = amplitude[first:last]
    is_peak = (here >= amplitude[first - 1 : last - 1]) & (here > amplitude[first + 1 : last + 1])
    is_peak &= here > amplitude.max() * 10 ** (_PEAK_FLOOR_DB / 20)
    if not np.any(is_peak):
        return None
    i = first + int(np.argmax(np.where(is_peak, here, -1.0)))
    a, b, c = np.log(np.maximum(amplitude[i - 1 : i + 2], 1e-300))
    curvature = a - 2 * b + c
    shift = 0.5 * (a - c) / curvature if curvature < 0 else 0.0
    frequency = frequencies[i] + shift * (frequencies[1] - frequencies[0])
    return float(frequency), float(np.exp(b - 0.25 * (a - c) * shift))


def partials(
    x: ArrayLike, rate_hz: float, f0_hz: float, n: int, search: float = 0.3
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies and levels of the first n partials, followed upwards through their stretching by stiffness.

    Parameters
    ----------
    f0_hz : frequency of the first partial, within ``search``·f0_hz.
    n : number of partials.
    search : each partial is the strongest peak within ±search·f0_hz of where the last spacing predicts it.

    Returns
    -------
    (frequencies_hz, levels_db) : (n,) each, the level as amplitude re 1, averaged over the window. Where
    there is no peak within 85 dB of the highest one: the predicted frequency and −inf.
    """
    if not f0_hz > 0 or n < 1:
        raise ValueError(f"f0_hz must be positive and n at least 1, got {f0_hz:g} Hz and {n}")
    frequencies, amplitude = spectrum(x, rate_hz)
    found = np.empty(n)
    levels = np.full(n, -np.inf)
    before, spacing = 0.0, f0_hz
    for k in range(n):
        expected = before + spacing
        peak = _strongest_peak(frequencies, amplitude, expected - search * f0_hz, expected + search * f0_hz)
        if peak is None:
            found[k] = expected
        else:
            found[k], levels[k] = peak[0], 20 * np.log10(peak[1])
            spacing = found[k] - before
        before = found[k]
    return found, levels


# --- pitch and decay ----------------------------------------------------------------------------------------


def _envelope(x, rate_hz, frequency_hz, length_s, points):
    """Complex envelope of the partial near a frequency.

    Returns (times, envelope) at up to about ``points`` places where the smoothing window of ``length_s`` lies
    wholly inside the signal.
    """
    length = max(3, round(length_s * rate_hz)) | 1
    if x.size < length:
        raise ValueError(
            f"the signal must last at least {length / rate_hz:.3g} s to resolve {frequency_hz:.4g} Hz, "
            f"got {x.size / rate_hz:.3g} s; measure a longer piece"
        )
    n = np.arange(x.size)
    shifted = x * np.exp(-2j * np.pi * frequency_hz / rate_hz * n)
    window = blackman_harris(length)
    window /= window.sum()
    size = 1 << int(np.ceil(np.log2(x.size + length)))
    smooth = np.fft.ifft(np.fft.fft(shifted, size) * np.fft.fft(window, size))[length - 1 : x.size]
    step = max(1, smooth.size // points)
    # The factor 2 makes it the amplitude: half of a real partial lies at the negative frequency.
    return (n[: smooth.size] + length // 2)[::step] / rate_hz, 2 * smooth[::step]


def sounding_fundamental(
    x: ArrayLike,
    rate_hz: float,
    expected_hz: float,
    *,
    search_cents: float = 60.0,
    depth_db: float = 40.0,
) -> float:
    """Frequency of the first partial, averaged over the time in which it sounds.

    The strongest spectral peak within ±search_cents of ``expected_hz`` is the start; the answer is the slope
    of the line of least squares through the unwrapped phase of its envelope while it sounds. That slope does
    not depend on how the amplitude goes, so a gliding partial gives the average of its frequency over time
    (weighted by a parabola, the same for every signal of that length), not that of its loud part.

    Parameters
    ----------
    x : (n,) signal, at least 12 periods long, without a hard onset: begin after the pluck.
    search_cents : how far from there it may be.
    depth_db : it is followed around its maximum as far as it is within that of it.
    expected_hz : where the partial should be [Hz].

    Returns
    -------
    frequency [Hz], exact to about 0.01 cent in a signal of a second that is not noisy.

    Raises
    ------
    ValueError : no partial in the range searched, or a signal too short.
    """
    x = _signal("x", x)
    if not 0 < expected_hz < rate_hz / 2:
        raise ValueError(f"expected_hz must lie between 0 and {rate_hz / 2:g} Hz, got {expected_hz:g} Hz")
    periods = x.size / rate_hz * expected_hz
    if periods < 12:
        raise ValueError(
            f"x must hold at least 12 periods of {expected_hz:.4g} Hz, got {periods:.3g}; measure a longer piece"
        )
    frequencies, amplitude = spectrum(x - x.mean(), rate_hz)
    width = 2 ** (search_cents / 1200)
    peak = _strongest_peak(frequencies, amplitude, expected_hz / width, expected_hz * width)
    if peak is None:
        raise ValueError(
            f"no partial found within ±{search_cents:g} cents of {expected_hz:.4g} Hz; check the note or search wider"
        )
    start = float(peak[0])
    # Main lobe of the smoothing window: never wider than 0.8 of the way to DC and to the second partial,
    # never so narrow (0.1) that a glide leaves it; in between a quarter of the signal, against other strings.
    length_s = x.size / rate_hz / 4
    length_s = min(max(length_s, _MAIN_LOBE_BINS / (0.8 * start)), _MAIN_LOBE_BINS / (0.1 * start))
    t, envelope = _envelope(x, rate_hz, start, length_s, 4000)
    magnitude = np.abs(envelope)
    # Around the maximum, as far as the partial stands out: silence before and noise after have no phase.
    loudest = int(np.argmax(magnitude))
    weak = np.flatnonzero(magnitude < magnitude[loudest] * 10 ** (-depth_db / 20))
    begin = int(weak[weak < loudest].max(initial=-1)) + 1
    end = int(weak[weak > loudest].min(initial=t.size))
    if end - begin < 3:
        raise ValueError(
            f"the partial near {start:.4g} Hz must last longer than {length_s:.3g} s to be measured; "
            "give only the piece in which it sounds"
        )
    phase = np.unwrap(np.angle(envelope[begin:end]))
    centred = t[begin:end] - t[begin:end].mean()
    return float(start + (centred @ phase) / (centred @ centred) / (2 * np.pi))


def decay_time_s(
    x: ArrayLike,
    rate_hz: float,
    frequency_hz: float | None = None,
    *,
    bandwidth_hz: float | None = None,
    fit_db: tuple[float, float] = (-3.0, -33.0),
) -> float:
    """T60: seconds in which the level falls by 60 dB, from the line of least squares through the level in dB.

    Parameters
    ----------
    frequency_hz : measure the partial there. None: the whole signal, as the rms of pieces of 50 ms.
    bandwidth_hz : the partial's envelope is taken in ±bandwidth_hz, by default ±0.8·frequency_hz, which suits
        a first partial; for a higher one give less than the spacing of the partials.
    fit_db : the line runs over the time from the first fall below fit_db[0] re the maximum to the first below
        fit_db[1], or to the end of the signal if that comes first.

    Raises
    ------
    ValueError : the level does not fall, or too short a piece of it is there to fit.
    """
    x = _signal("x", x)
    if frequency_hz is None:
        step = max(1, round(0.05 * rate_hz))
        pieces = x[: x.size // step * step].reshape(-1, step)
        t = (np.arange(len(pieces)) + 0.5) * step / rate_hz
        magnitude = np.sqrt(np.mean(pieces**2, axis=1))
    else:
        if not 0 < frequency_hz < rate_hz / 2:
            raise ValueError(f"frequency_hz must lie between 0 and {rate_hz / 2:g} Hz, got {frequency_hz:g} Hz")
        length_s = _MAIN_LOBE_BINS / (0.8 * frequency_hz if bandwidth_hz is None else bandwidth_hz)
        t, envelope = _envelope(x, rate_hz, frequency_hz, length_s, 2000)
        magnitude = np.abs(envelope)
    return _fitted_decay_s(t, magnitude, fit_db)


def decay_times_s(
    x: ArrayLike,
    rate_hz: float,
    frequencies_hz: ArrayLike,
    *,
    bandwidth_hz: float,
    fit_db: tuple[float, float] = (-3.0, -33.0),
) -> NDArray[np.float64]:
    """:func:`decay_time_s` of many partials at once: one transform of the signal, a short one for each.

    frequencies_hz : (k,) partials between 0 and rate_hz/2. bandwidth_hz, fit_db : as there, the same for all.

    Returns (k,) T60 [s]; NaN where :func:`decay_time_s` would refuse. Raises ValueError for a signal shorter than the
    window, 4/bandwidth_hz.
    """
    x = _signal("x", x)
    frequencies = np.atleast_1d(np.asarray(frequencies_hz, dtype=np.float64))
    length = max(3, round(_MAIN_LOBE_BINS / bandwidth_hz * rate_hz)) | 1
    if x.size < length:
        raise ValueError(
            f"the signal must last at least {length / rate_hz:.3g} s for partials {bandwidth_hz:.4g} Hz wide, "
            f"got {x.size / rate_hz:.3g} s; measure a longer piece"
        )
    window = blackman_harris(length)
    size = 1 << int(np.ceil(np.log2(x.size + length)))
    # beyond twice the main lobe the window's transform is below −92 dB: the envelope is in that many bins
    band = int(np.ceil(2.0 * bandwidth_hz * size / rate_hz))
    short = min(size, 1 << int(np.ceil(np.log2(2 * band + 1))))
    near = np.arange(-(short // 2), short // 2)
    spectrum_x, spectrum_w = np.fft.fft(x, size), np.fft.fft(window / window.sum(), size)[near]
    at = np.arange(short) * (size // short)
    inside = (at >= length - 1) & (at < x.size)
    t = (at[inside] - length // 2) / rate_hz
    out = np.full(frequencies.size, np.nan)
    for k, frequency in enumerate(frequencies):
        if not 0 < frequency < rate_hz / 2:
            raise ValueError(f"frequencies_hz must lie between 0 and {rate_hz / 2:g} Hz, got {frequency:g} Hz")
        piece = spectrum_x[(near + round(frequency * size / rate_hz)) % size] * spectrum_w
        magnitude = np.abs(np.fft.ifft(np.fft.ifftshift(piece)))[inside]
        try:
            out[k] = _fitted_decay_s(t, magnitude, fit_db)
        except ValueError:
            continue  # it does not decay, or is not there
    return out


def _fitted_decay_s(t: NDArray[np.floating], magnitude: NDArray[np.floating], fit_db: tuple[float, float]) -> float:
    """T60 from magnitudes (n,) at times t (n,); see :func:`decay_time_s`."""
    if magnitude.size == 0 or not magnitude.max() > 0:
        raise ValueError("x must sound to have a decay time, got silence or less than 50 ms")
    loudest = int(np.argmax(magnitude))
    level = 20 * np.log10(np.maximum(magnitude[loudest:] / magnitude[loudest], 1e-15))
    t = t[loudest:]
    begin, end = (int(np.argmax(level < db)) if np.any(level < db) else level.size for db in fit_db)
    if end - begin < 4:
        raise ValueError(
            f"the level must fall by more than {-fit_db[0]:g} dB over at least four pieces to be fitted, "
            f"got {end - begin} pieces; measure a longer signal"
        )
    centred = t[begin:end] - t[begin:end].mean()
    slope = (centred @ level[begin:end]) / (centred @ centred)
    if not slope < 0:
        raise ValueError(f"the level must fall to have a decay time, got {slope:+.3g} dB/s")
    return float(-60.0 / slope)


# --- levels and clicks --------------------------------------------------------------------------------------


def peak(x: ArrayLike) -> float:
    """Largest magnitude of a sample; x of any shape. NaN if there is one."""
    return float(np.max(np.abs(np.asarray(x, dtype=np.float64)), initial=0.0))


def true_peak(x: ArrayLike, oversampling: int = 4, half_length: int = 24) -> float:
    """Largest magnitude of the curve through the samples (as in ITU-R BS.1770, annex 2), at least their peak.

    x : (n,). Kaiser-windowed sinc interpolation at ``oversampling`` times the rate; a sine of any frequency
    up to 0.4 of the sample rate is found to within 0.7 dB for 4 (its own samples may miss 3 dB and more).
    """
    x = _signal("x", x)
    highest = peak(x)
    for k in range(1, oversampling):
        n = np.arange(-half_length, half_length + 1) - k / oversampling
        inside = np.sqrt(np.maximum(0.0, 1 - (n / (half_length + 1)) ** 2))
        taps = np.sinc(n) * np.i0(7.0 * inside) / np.i0(7.0)
        highest = max(highest, float(np.max(np.abs(np.convolve(x, taps)))))
    return highest


def dc(x: ArrayLike) -> float:
    """Mean of the samples."""
    return float(np.mean(_signal("x", x)))


def click_ratios(x: ArrayLike, positions: ArrayLike, *, within: int = 3, neighbourhood: int = 256) -> NDArray[np.float64]:
    """How much each given place stands out from its surroundings as a discontinuity.

    The third difference hides smooth motion (it falls with the cube of the frequency) and shows a jump of the
    value, the slope or the curvature. Its largest magnitude within ±``within`` samples of the place is
    divided by its rms in the ``neighbourhood`` samples before and after. That rms is the larger of the two
    sides, so that the start of a louder sound is not called a click for its loudness alone; samples near the
    place itself are left out.

    Parameters
    ----------
    x : (n,) signal.
    positions : (k,) sample indices, where the first sample after a change stands.

    Returns
    -------
    (k,) ratios. Stationary noise gives about 2 (the largest of seven of unit rms), a steady buzz its crest
    factor, a click tens to thousands; a place in silence gives 0, a jump out of perfect silence into silence
    inf.

    Raises
    ------
    ValueError : a place outside the signal, or a signal shorter than 4·(within + 2) samples.
    """
    x = _signal("x", x)
    at = np.atleast_1d(np.asarray(positions, dtype=np.int64))
    if x.size < 4 * (within + 2):
        raise ValueError(f"x must hold at least {4 * (within + 2)} samples, got {x.size}; measure a longer piece")
    if at.size and not (at.min() >= 0 and at.max() < x.size):
        raise ValueError(f"positions must lie in 0…{x.size - 1}, got {at.min()}…{at.max()}; give sample indices of x")
    # Centred: third[i] involves x[i − 2 … i + 1], so a jump between p − 1 and p shows at p ± 1.
    third = np.zeros(x.size)
    third[2:-1] = np.abs(np.diff(x, 3))
    ratios = np.empty(at.size)
    for k, p in enumerate(at):
        here = third[max(0, p - within) : p + within + 1].max()
        guard = within + 2
        before = third[max(0, p - guard - neighbourhood) : max(0, p - guard)]
        after = third[p + guard + 1 : p + guard + 1 + neighbourhood]
        around = max(float(np.sqrt(np.mean(side**2))) if side.size else 0.0 for side in (before, after))
        ratios[k] = here / around if around > 0 else (np.inf if here > 0 else 0.0)
    return ratios
