"""The body of an instrument as a bank of measured resonances: frequency, Q and gain of each.

A resonance is a damped oscillation A·e^(−at)·cos(bt + φ) with a = ω₀/(2Q), sampled exactly (impulse
invariance):

    H(z) = K (1 − z⁻¹) / (1 − 2 r cosθ z⁻¹ + r² z⁻²),   r = e^(−aT)

The zero at z = 1 keeps a static force out of the sound, as in a mobility, ω₀s/Q / (s² + ω₀s/Q + ω₀²). |H| of
this form has its maximum where cos ωT = cosθ − (cosh aT − 1). Choosing θ by that equation and K by |H| there
puts the peak exactly on the measured frequency with exactly the measured gain, at any rate and Q.
"""

from itertools import pairwise

import numpy as np
from llvmlite import ir
from numba import njit, types
from numpy.typing import NDArray

from synth.native.interpreted import intrinsic
from synth.native.simd import INT, LANES, VECTOR, Code


def body_coefficients(frequencies_hz, q, gains_db, rate_hz: float) -> NDArray[np.float64]:
    """Coefficients of a bank of resonances.

    Parameters
    ----------
    frequencies_hz : (m,) frequencies of the peaks [Hz], between 0 and rate_hz/2.
    q : (m,) quality factors, at least 1; the ring decays by 60 dB in 2.2·Q/f seconds.
    gains_db : (m,) gains at the peaks [dB].
    rate_hz : sample rate [Hz].

    Returns
    -------
    (3, m) rows K, 2 r cosθ, −r².

    Raises
    ------
    ValueError : lists of different lengths, or a value out of range.
    """
    f, quality, gain = (np.atleast_1d(np.asarray(a, dtype=np.float64)) for a in (frequencies_hz, q, gains_db))
    if not (f.ndim == 1 and f.shape == quality.shape == gain.shape):
        raise ValueError(
            "frequencies_hz, q and gains_db must have the same length, got "
            f"{f.size}, {quality.size} and {gain.size}; give one of each per resonance"
        )
    if not rate_hz > 0:
        raise ValueError(f"rate_hz must be positive, got {rate_hz:g} Hz; give the output rate")
    for i in range(f.size):
        if not 0 < f[i] < rate_hz / 2:
            raise ValueError(
                f"frequencies_hz[{i}] must lie between 0 and half the sample rate, {rate_hz / 2:g} Hz, "
                f"got {f[i]:g} Hz; remove that resonance or use a higher rate"
            )
        if not (quality[i] >= 1 and np.isfinite(quality[i])):
            raise ValueError(f"q[{i}] must be at least 1, got {quality[i]:g}; a broader hump is no resonance")
        if not np.isfinite(gain[i]):
            raise ValueError(f"gains_db[{i}] must be finite, got {gain[i]:g} dB; remove a resonance to silence it")
    peak = 2 * np.pi * f / rate_hz
    decay = peak / (2 * quality)
    r = np.exp(-decay)
    cos_theta = np.cos(peak) + np.cosh(decay) - 1
    z = np.exp(-1j * peak)
    unscaled = np.abs((1 - z) / (1 - 2 * r * cos_theta * z + (r * z) ** 2))
    return np.array([10 ** (gain / 20) / unscaled, 2 * r * cos_theta, -(r**2)])


def body_state(coefficients) -> NDArray[np.float64]:
    """State of a bank at rest: (3, m) last two outputs of every resonance, and in [2, 0] the last input."""
    m = coefficients.shape[1]
    return np.zeros((3, max(1, m)))


def _steps(count: int):
    """The intrinsic that takes `count` samples, x[at : at + count], through the bank: resonances in the lanes."""

    def plain(coefficients, state, previous, x, at, out) -> None:
        scale, first, second = coefficients[:3]
        for i in range(at, at + count):
            newer = first * state[0] + second * state[1] + scale * (x[i] - previous)
            state[1], state[0] = state[0], newer
            previous = x[i]
            out[i] += newer.sum()

    @intrinsic(plain)
    def step(typingctx, coefficients, state, previous, x, at, out):
        def emit(context, builder, signature, args):
            code, b = Code(context, builder, signature, args), builder
            zero = ir.Constant(VECTOR, [0.0] * LANES)
            scale, first, second = code.strided_rows(0, 3)
            at_y1, at_y2 = code.strided_rows(1, 2)
            at_x = b.gep(code.data(3), [args[4]])
            samples = [args[2], *(code.scalar(at_x, k) for k in range(count))]
            differences = [code.splat(b.fsub(new, old)) for old, new in pairwise(samples)]
            before = b.block
            loop, done = b.append_basic_block("resonances"), b.append_basic_block("rung")
            b.branch(loop)
            b.position_at_end(loop)
            j = b.phi(INT)
            j.add_incoming(ir.Constant(INT, 0), before)
            carried = [b.phi(VECTOR) for _ in range(count)]
            mask = code.lanes_below(b.sub(code.row_length(0), j))
            k1, k2, k3 = (code.load_masked(row, j, mask) for row in (scale, first, second))
            newer, older = (code.load_masked(row, j, mask) for row in (at_y1, at_y2))
            sums = []
            for difference, total in zip(differences, carried, strict=True):
                total.add_incoming(zero, before)
                driven = code.fma(k3, older, code.times(k1, difference))
                newer, older = code.fma(k2, newer, driven), newer
                sums.append(b.fadd(total, newer))
                total.add_incoming(sums[-1], loop)
            code.store_masked(newer, at_y1, j, mask)
            code.store_masked(older, at_y2, j, mask)
            following = b.add(j, ir.Constant(INT, LANES))
            j.add_incoming(following, loop)
            b.cbranch(b.icmp_signed("<", following, code.row_length(0)), loop, done)
            b.position_at_end(done)
            at_out = b.gep(code.data(5), [args[4]])
            for start in range(0, count, LANES):
                mine = sums[start : start + LANES]
                totals = code.fold(mine + [zero] * (LANES - len(mine)))
                place = ir.Constant(INT, start)
                if len(mine) == LANES:
                    code.store(b.fadd(code.load(at_out, place), totals), at_out, place)
                else:
                    target = b.gep(at_out, [place])
                    b.store(b.fadd(b.load(target), b.extract_element(totals, ir.Constant(ir.IntType(32), 0))), target)
            return context.get_dummy_value()

        return types.void(coefficients, state, types.float64, x, types.int64, out), emit

    return step


_TOGETHER = 8
_eight_samples = _steps(_TOGETHER)
_one_sample = _steps(1)


@njit(cache=True, nogil=True)
def body_filter(coefficients, state, x, out):
    """Add the response of the bank to ``out``.

    Allocates nothing; bitwise the same for any split of the stream.

    Parameters
    ----------
    coefficients : (3, m) from :func:`body_coefficients`.
    state : from :func:`body_state`, updated.
    x : (n,) input.
    out : (n,) the response is added here; may not be ``x``.
    """
    if coefficients.shape[1] == 0:
        return
    previous = state[2, 0]
    n = 0
    while n + _TOGETHER <= x.size:
        _eight_samples(coefficients, state, previous, x, n, out)
        n += _TOGETHER
        previous = x[n - 1]
    while n < x.size:
        _one_sample(coefficients, state, previous, x, n, out)
        previous = x[n]
        n += 1
    state[2, 0] = previous
