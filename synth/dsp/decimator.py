"""From the internal rate to the output rate: a linear-phase FIR of which only every M-th output is computed.

The internal rate is an integer multiple M = 1…64 of the output rate. The filter is a Kaiser-windowed sinc
whose cutoff is half the output rate. Seen from the output rate it is the same filter for every rate and every
factor (for M = 1 it shrinks to its middle tap, a pure delay), which makes its figures the same everywhere:

=====================  ==================================================================
latency                37 output frames (:data:`LATENCY_FRAMES`), exactly, for every factor
passband ripple        below 0.0001 dB up to 20/44.1 of the output rate
stopband attenuation   above 105 dB from 24.1/44.1 of the output rate on
=====================  ==================================================================

At 44.1 kHz that is flat to 20 kHz and nothing that folds lands below 20 kHz above −105 dB; at 48 kHz it is
flat to 21.7 kHz, at 96 kHz to 43.5 kHz. 37 frames is the shortest filter that keeps 105 dB at 44.1 kHz.

It is an M-th-band filter: every M-th tap but the middle one is zero. The kernels split the line into its M phases and
compute neighbouring outputs in the lanes of vectors (`polyphase`).

The streaming kernel gives bitwise the same samples however the stream is cut into blocks: neither the terms of an
output nor their order depend on where it stands.
"""

from functools import lru_cache

import numpy as np
from numba import float64, int64, njit
from numpy.typing import NDArray

from synth.dsp.polyphase import BRANCH, GROUP, add_branches
from synth.dsp.rates import MAXIMUM_FACTOR, MINIMUM_RATE_HZ
from synth.jit.entries import kernel

LATENCY_FRAMES = BRANCH // 2
"""Delay of the filter in output frames, 37 for every factor."""

PASSBAND_RIPPLE_DB = 1e-4
"""Largest deviation from 0 dB up to :data:`PASSBAND_EDGE` × output rate."""

STOPBAND_ATTENUATION_DB = 105.0
"""Smallest attenuation from :data:`STOPBAND_EDGE` × output rate up to half the internal rate."""

PASSBAND_EDGE = 20.0 / 44.1
STOPBAND_EDGE = 1.0 - PASSBAND_EDGE


# The largest shape parameter whose main lobe still fits between the two edges with 2·37·M + 1 taps: a smaller
# one gives away attenuation, a larger one lets the transition spill over the stopband edge.
_KAISER_BETA = 10.75


def design(rate_hz: float, factor: int) -> NDArray[np.float64]:
    """Taps of the decimation filter at the internal rate.

    Parameters
    ----------
    rate_hz : output sample rate [Hz], at least 44100 (below it 20 kHz would not pass).
    factor : internal rate / output rate, 1…64.

    Returns
    -------
    taps : (2·LATENCY_FRAMES·factor + 1,) symmetric, sum 1, zero at every `factor`-th but the middle one.

    Raises
    ------
    ValueError : rate or factor outside their ranges.
    """
    if not rate_hz >= MINIMUM_RATE_HZ:
        raise ValueError(
            f"rate_hz must be at least {MINIMUM_RATE_HZ:g} Hz so that 20 kHz passes, got {rate_hz:g} Hz; "
            "render at 44100 Hz or more and resample the file"
        )
    if not (factor == int(factor) and 1 <= factor <= MAXIMUM_FACTOR):
        raise ValueError(
            f"factor must be a whole number from 1 to {MAXIMUM_FACTOR} (internal rate / output rate), "
            f"got {factor}; choose an internal rate that is such a multiple of the output rate"
        )
    half = LATENCY_FRAMES * int(factor)
    n = np.arange(-half, half + 1)
    if factor == 1:
        return (n == 0).astype(np.float64)
    taps = np.sinc(n / factor) * np.kaiser(n.size, _KAISER_BETA)
    taps[n % factor == 0] = n[n % factor == 0] == 0  # sin πk is not quite zero in floating point
    return taps / taps.sum()


def response(rate_hz: float, factor: int, frequency_hz: NDArray[np.float64]) -> NDArray[np.float64]:
    """Gain of :func:`design` at frequencies (N,) [Hz] at its input, delay taken out; raises ValueError as it does."""
    taps = _kept_taps(rate_hz, factor)
    half = taps.size // 2
    angle = 2.0 * np.pi * np.asarray(frequency_hz) / (factor * rate_hz)
    return taps[half] + 2.0 * np.cos(np.outer(angle, np.arange(1, half + 1))) @ taps[half + 1 :]


@lru_cache(maxsize=16)
def _kept_taps(rate_hz: float, factor: int) -> NDArray[np.float64]:
    """:func:`design`, read-only: every string of a preset is asked for its gain."""
    taps = design(rate_hz, factor)
    taps.flags.writeable = False
    return taps


def new_history(factor: int) -> NDArray[np.float64]:
    """State of a stream before its first sample: (2·LATENCY_FRAMES·factor,) zeros, the filter's inputs."""
    return np.zeros(2 * LATENCY_FRAMES * factor)


def workspace(factor: int, frames: int = 128) -> NDArray[np.float64]:
    """Scratch memory for :func:`decimate`; one may serve many streams. Its size never changes the samples.

    frames : output frames worked on at a time; longer blocks are cut into pieces of about that length.
    """
    frames = -(-max(1, frames) // GROUP) * GROUP
    line = (2 * LATENCY_FRAMES + frames) * factor
    return np.empty(2 * LATENCY_FRAMES * factor + 1 + line + phase_space(factor, frames))


@kernel(int64, int64, answer=int64)
def phase_space(factor, frames):
    """Elements of scratch that :func:`decimate_line` needs for so many outputs."""
    return (factor - 1) * ((frames + GROUP - 1) // GROUP * GROUP + BRANCH) + GROUP


@kernel(float64[::1], int64, float64[::1])
def split_taps(taps, factor, branches):
    """Order taps by phase: branches[p·BRANCH + m] = taps[m·factor + p], p < factor; both of the same length."""
    for p in range(factor):
        for m in range(BRANCH):
            branches[p * BRANCH + m] = taps[m * factor + p]
    branches[factor * BRANCH] = taps[factor * BRANCH]


@njit(cache=True, nogil=True)
def _every(step, x, out):
    """out[j] = x[j·step]; unsigned, as numba tests a signed index for wrapping around."""
    stride, end = np.uint64(step), np.uint64(out.size)
    j = at = np.uint64(0)
    while j < end:
        out[j] = x[at]
        j += np.uint64(1)
        at += stride


@njit(cache=True, nogil=True)
def decimate_line(branches, factor, line, work, out):
    """Outputs of a stream that lies in one piece: out[i] = Σ_k taps[k]·line[i·factor + k].

    branches : taps as :func:`split_taps` orders them.
    line : (at least (n − 1)·factor + len(taps),) inputs, the first len(taps) − 1 of them from before.
    work : (at least phase_space(factor, n),) scratch.
    out : (n,) outputs, overwritten.
    """
    middle = branches[LATENCY_FRAMES]  # of the branch in which all others are zero
    if factor == 1:
        for i in range(out.size):
            out[i] = middle * line[LATENCY_FRAMES + i]
        return
    centre = line[LATENCY_FRAMES * factor :]
    needed = out.size + BRANCH - 1
    stride = (out.size + GROUP - 1) // GROUP * GROUP + BRANCH
    for p in range(1, factor):
        _every(factor, line[p:], work[(p - 1) * stride : (p - 1) * stride + needed])
        for j in range((p - 1) * stride + needed, p * stride):
            work[j] = 0.0
    rest = work[(factor - 1) * stride :]
    for first in range(0, out.size, GROUP):
        count = min(GROUP, out.size - first)
        group = out[first:] if count == GROUP else rest
        _every(factor, centre[first * factor :], group[:count])
        for i in range(count):
            group[i] *= middle
        add_branches(branches, factor, work, stride, first, group)
        if count < GROUP:
            for i in range(count):
                out[first + i] = rest[i]


@njit(cache=True, nogil=True)
def decimate(taps, factor, history, x, work, out):
    """Filter the next block of a stream and keep every ``factor``-th sample.

    Allocates nothing. Output i is Σ_k taps[k]·stream[i·factor + k − (len(taps) − 1)]: the taps are symmetric,
    so the convolution is a dot product.

    Parameters
    ----------
    taps : (2·LATENCY_FRAMES·factor + 1,) from :func:`design`.
    factor : internal rate / output rate.
    history : (len(taps) − 1,) the stream's last inputs, from :func:`new_history`; updated.
    x : (n·factor,) next inputs, contiguous.
    work : scratch from :func:`workspace`.
    out : (n,) outputs, overwritten.

    Returns
    -------
    n, the number of frames written; −1 if an array has the wrong length (nothing is touched then).
    """
    past = taps.size - 1
    spare = work.size - taps.size - past - phase_space(factor, 0)
    capacity = spare // (2 * factor - 1) // GROUP * GROUP
    frames = out.size
    if history.size != past or x.size != frames * factor or capacity < GROUP:
        return -1
    branches, scratch = work[: taps.size], work[taps.size + past + capacity * factor :]
    split_taps(taps, factor, branches)
    done = 0
    while done < frames:
        count = min(capacity, frames - done)
        fresh = count * factor
        start = done * factor
        line = work[taps.size : taps.size + past + fresh]
        for i in range(past):
            line[i] = history[i]
        for i in range(fresh):
            line[past + i] = x[start + i]
        decimate_line(branches, factor, line, scratch, out[done : done + count])
        for i in range(past):
            history[i] = line[fresh + i]
        done += count
    return frames


def decimate_reference(taps, factor, x):
    """Readable twin of :func:`decimate`: plain convolution of the whole stream, then every M-th sample.

    x : (n·factor,) stream from its first sample on. Returns (n,).
    """
    return np.convolve(x, taps)[: len(x) : factor]


def decimate_signal(x, rate_hz: float, factor: int) -> NDArray[np.float64]:
    """A whole signal at the output rate, latency compensated: output i belongs to input i·factor.

    Parameters
    ----------
    x : (n,) signal at ``rate_hz``·``factor``. What is missing to a multiple of ``factor`` is taken as zero.
    rate_hz, factor : as in :func:`design`.

    Returns
    -------
    (⌈n/factor⌉,) signal at ``rate_hz``.
    """
    taps = design(rate_hz, factor)
    x = np.asarray(x, dtype=np.float64)
    if x.ndim != 1:
        raise ValueError(f"x must have one dimension, got {x.ndim}; decimate channel by channel")
    frames = -(-x.size // factor)
    padded = np.zeros((frames + LATENCY_FRAMES) * factor)
    padded[: x.size] = x
    out = np.empty(frames + LATENCY_FRAMES)
    decimate(taps, factor, new_history(factor), padded, workspace(factor), out)
    return out[LATENCY_FRAMES:]
