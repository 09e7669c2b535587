"""Look-ahead limiter: all channels share one gain, and no sample leaves above the ceiling.

For each frame of the input the reduction d = 1 − ceiling/peak that would just fit it (0 if it fits) is known
:data:`LOOKAHEAD` frames before that frame leaves. Then

1. hold: h[n] = max d[n−D … n], the strongest reduction any frame still inside needs (D = LOOKAHEAD);
2. release: r[n] = h[n] if it rises, else r[n−1] falls exponentially towards it, so r ≥ h;
3. smooth: s[n] = Σ_k w_k r[n−k], k = 0…D, with a raised-cosine window of sum 1.

Each of the D + 1 values averaged is at least d[n−D], so the frame that leaves, x[n−D]·(1 − s[n]), fits; and
because of the window the gain is a smooth curve without steps. While nothing exceeds the ceiling every
reduction is exactly zero and the limiter is bitwise a pure delay. All of it counts single frames, so the cut
of the stream into blocks does not change a bit. The ceiling is for samples; the curve between them may pass
it slightly (see ``measures.true_peak``).
"""

from typing import Annotated, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from synth.native.arrays import f8, i8

LOOKAHEAD = 64
"""Delay in frames at every rate (1.45 ms at 44.1 kHz)."""

RELEASE_S = 0.15
"""Default time constant of the release."""

WINDOW = LOOKAHEAD + 1
_WEIGHTS = np.hanning(WINDOW + 2)[1:-1] / np.hanning(WINDOW + 2)[1:-1].sum()

# A remaining reduction of −140 dB counts as none, so that the limiter returns to a bitwise delay.
_RELEASED = 1e-7


class LimiterState(NamedTuple):
    """What a limiter remembers. Pass it to :func:`limit` as ``*state``."""

    delay: Annotated[np.ndarray, f8("LOOKAHEAD, channels")]
    """Ring of the input."""
    required: Annotated[np.ndarray, f8("2*WINDOW")]
    """Ring of d, written twice so that the last LOOKAHEAD+1 values lie side by side."""
    released: Annotated[np.ndarray, f8("2*WINDOW")]
    """The same of r."""
    counters: Annotated[np.ndarray, i8("3")]
    """Place in the delay, place in the rings, frames until the last reduction has left the rings."""
    levels: Annotated[np.ndarray, f8("2")]
    """r of the last frame; largest reduction 1 − gain so far (set it to 0 to measure anew)."""


def limiter_state(channels: int) -> LimiterState:
    """A limiter that has heard silence. Raises ValueError unless ``channels`` ≥ 1."""
    if channels < 1:
        raise ValueError(f"channels must be at least 1, got {channels}; give the width of the signal")
    return LimiterState(
        np.zeros((LOOKAHEAD, channels)),
        np.zeros(2 * WINDOW),
        np.zeros(2 * WINDOW),
        np.zeros(3, np.int64),
        np.zeros(2),
    )


def release_coefficient(rate_hz: float, release_s: float = RELEASE_S) -> float:
    """Share of the distance that the release covers per frame, 1 − exp(−1/(release_s·rate_hz))."""
    if not (rate_hz > 0 and release_s > 0):
        raise ValueError(
            f"rate_hz and release_s must be positive, got {rate_hz:g} Hz and {release_s:g} s; "
            "give the output rate and a time constant such as 0.15 s"
        )
    return float(-np.expm1(-1.0 / (release_s * rate_hz)))


def largest_reduction_db(state: LimiterState) -> float:
    """The strongest reduction applied so far, as a positive number of dB; 0 if there was none."""
    return float(20.0 * np.log10(1.0 / (1.0 - state.levels[1])))


# Reassociated so that the sum over the window goes through vector registers; the window lies side by side, so that
# the order is the same for every frame.
@njit(cache=True, nogil=True, fastmath={"reassoc", "nsz", "contract"})
def _smooth(released):
    total = 0.0
    for k in range(WINDOW):
        total += _WEIGHTS[k] * released[k]
    return total


@njit(cache=True, nogil=True)
def _largest(required):
    """The largest of a window, in lanes: a chain of maxima takes as long as it has members."""
    a = b = c = d = e = f = g = h = required[WINDOW - 1]
    for k in range(0, WINDOW - 1, 8):
        a = max(a, required[k])
        b = max(b, required[k + 1])
        c = max(c, required[k + 2])
        d = max(d, required[k + 3])
        e = max(e, required[k + 4])
        f = max(f, required[k + 5])
        g = max(g, required[k + 6])
        h = max(h, required[k + 7])
    return max(max(max(a, b), max(c, d)), max(max(e, f), max(g, h)))


@njit(cache=True, nogil=True)
def _fits(x, ceiling):
    """Whether none of the samples x (n,) exceeds the ceiling; NaN does not."""
    over = 0
    for i in range(x.size):
        over |= 1 if abs(x[i]) > ceiling else 0
    return over == 0


@njit(cache=True, nogil=True)
def _exchange(x, y):
    for i in range(x.size):
        x[i], y[i] = y[i], x[i]


@njit(cache=True, nogil=True)
def limit(delay, required, released, counters, levels, ceiling, release, x):
    """Limit the next block in place; the output lags by LOOKAHEAD frames. Allocates nothing.

    Parameters
    ----------
    delay, required, released, counters, levels : the :class:`LimiterState`, updated.
    ceiling : largest magnitude that may leave, > 0; constant while the state lives.
    release : from :func:`release_coefficient`.
    x : (n, channels) block, contiguous, overwritten.
    """
    channels = x.shape[1]
    place, ring, active = counters[0], counters[1], counters[2]
    last, largest = levels[0], levels[1]
    flat, inside = x.reshape(x.size), delay.reshape(delay.size)
    n = 0
    while n < x.shape[0]:
        if active == 0:  # nothing but zeros in the rings: frames that fit leave them so
            count = min(x.shape[0] - n, LOOKAHEAD - place)
            entering = flat[n * channels : (n + count) * channels]
            if _fits(entering, ceiling):
                _exchange(entering, inside[place * channels : (place + count) * channels])
                n += count
                place = (place + count) % LOOKAHEAD
                ring = (ring + count) % WINDOW
                continue
        peak = 0.0
        for c in range(channels):
            # A comparison, not max(): a NaN passes through with the delay and does not stay in the gain.
            if abs(x[n, c]) > peak:
                peak = abs(x[n, c])
        need = 0.0
        if peak > ceiling:
            need = 1.0 - ceiling / peak
            active = 2 * WINDOW
        required[ring] = need
        required[ring + WINDOW] = need
        ring_next = ring + 1 if ring + 1 < WINDOW else 0

        reduction = 0.0
        if active > 0:
            held = _largest(required[ring_next : ring_next + WINDOW])
            if held >= last:
                last = held
            else:
                last = max(held, last + release * (held - last))
                if last < _RELEASED:
                    last = 0.0
            released[ring] = last
            released[ring + WINDOW] = last
            smooth = _smooth(released[ring_next : ring_next + WINDOW])
            # The frame that leaves now is the oldest in the window; rounding must not cost it its guarantee.
            reduction = max(smooth, required[ring_next])
            if last > 0.0:
                active = 2 * WINDOW
            else:
                active -= 1
        ring = ring_next

        gain = 1.0 - reduction
        largest = max(largest, reduction)
        for c in range(channels):
            leaving = delay[place, c]
            delay[place, c] = x[n, c]
            if reduction > 0.0:
                leaving = leaving * gain
                if leaving > ceiling:
                    leaving = ceiling
                elif leaving < -ceiling:
                    leaving = -ceiling
            x[n, c] = leaving
        place = place + 1 if place + 1 < LOOKAHEAD else 0
        n += 1
    counters[0], counters[1], counters[2] = place, ring, active
    levels[0], levels[1] = last, largest


def limit_reference(x, ceiling: float, release: float) -> NDArray[np.float64]:
    """Readable twin of :func:`limit` for a whole signal from silence; x and the result are (n, channels)."""
    x = np.asarray(x, dtype=np.float64)
    n = len(x)
    peak = np.abs(x).max(axis=1)
    needed = np.concatenate([np.zeros(LOOKAHEAD), 1.0 - ceiling / np.maximum(peak, ceiling)])
    held = np.lib.stride_tricks.sliding_window_view(needed, WINDOW).max(axis=1)
    released = np.empty(n)
    last = 0.0
    for i in range(n):
        last = held[i] if held[i] >= last else last + release * (held[i] - last)
        released[i] = last
    gain = 1.0 - np.convolve(released, _WEIGHTS)[:n]
    delayed = np.concatenate([np.zeros((LOOKAHEAD, x.shape[1])), x])[:n]
    return delayed * gain[:, None]
