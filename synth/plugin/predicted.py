"""What tables of a string's model would be by their formulas, in arithmetic that gives the same bits on every processor.

Operations are + − × ÷, square root and floor of float64 alone, each rounded, in the order that stands here: nothing is
contracted or reordered, and no function is called that mathematical libraries round in one way or another. c/bank_predict.c
says the same in C, line by line. What a table holds differs from this by some units in the last place, mostly by none;
`packed_bank` stores the difference.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK

_KERNEL: dict[str, Any] = {"cache": True, "nogil": True, "error_model": "numpy"}
_SPLIT = 134217729.0  # 2^27 + 1
#: π/2 in three parts, of 33 bits each but for the last, as fdlibm has them, and the rest
_HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624871116645580e-21, 8.47842766036889956997e-32)
_PER_HALF_PI = 0.6366197723675814
_LN2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
_PER_LN2 = 1.4426950408889634
_H0, _H1, _H2, _H3 = _HALF_PI
_L0, _L1 = _LN2
#: 1/6 and 1/24, each with the rest
_SIXTH, _SIXTH_LOW = 1.0 / 6.0, 9.25185853854297065662e-18
_PER_24, _PER_24_LOW = 1.0 / 24.0, 2.3129646346357426e-18


@njit(**_KERNEL)
def two_sum(a: float, b: float):
    """a + b and what rounding takes off it."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@njit(**_KERNEL)
def two_product(a: float, b: float):
    """a·b and what rounding takes off it."""
    p = a * b
    t = _SPLIT * a
    ah = t - (t - a)
    al = a - ah
    t = _SPLIT * b
    bh = t - (t - b)
    bl = b - bh
    return p, ((ah * bh - p) + ah * bl + al * bh) + al * bl


@njit(**_KERNEL)
def multiplied_and_added(a: float, b: float, c: float) -> float:
    """a·b + c rounded once, nearly always."""
    p, low = two_product(a, b)
    s, rest = two_sum(p, c)
    return s + (rest + low)


@njit(**_KERNEL)
def reduced(x: float):
    """x − kπ/2, the nearest k, in two parts; and k mod 4. |x| < 1e6: of others zeros."""
    if not abs(x) < 1e6:
        return 0.0, 0.0, 0
    k = math.floor(x * _PER_HALF_PI + 0.5)
    p0 = x - k * _H0
    b, b_low = two_product(k, _H1)
    high, low = two_sum(p0, -b)
    low = low - b_low
    c = k * _H2
    sure, rest = two_sum(high, low)
    more, again = two_sum(sure, -c)
    rest = (rest + again) - k * _H3
    hi, lo = two_sum(more, rest)
    return hi, lo, int(k) & 3


@njit(**_KERNEL)
def sine_near_0(r: float, low: float) -> float:
    """Of r + low, |r| ≤ π/4."""
    z, z_low = two_product(r, r)
    cube, cube_low = two_product(z, r)
    cube_low = cube_low + z_low * r
    t, t_low = two_product(cube, _SIXTH)
    t_low = t_low + (cube_low * _SIXTH + cube * _SIXTH_LOW)
    q = -7.647163731819816e-13
    q = q * z + 1.6059043836821613e-10
    q = q * z - 2.505210838544172e-08
    q = q * z + 2.7557319223985893e-06
    q = q * z - 1.984126984126984e-04
    q = q * z + 8.333333333333333e-03
    s, rest = two_sum(r, -t)
    return s + ((rest - t_low) + (cube * z * q + low * (1.0 - 0.5 * z)))


@njit(**_KERNEL)
def cosine_near_0(r: float, low: float) -> float:
    """Of r + low, |r| ≤ π/4."""
    z, z_low = two_product(r, r)
    q = 4.779477332387385e-14
    q = q * z - 1.1470745597729725e-11
    q = q * z + 2.08767569878681e-09
    q = q * z - 2.755731922398589e-07
    q = q * z + 2.48015873015873e-05
    q = q * z - 1.388888888888889e-03
    fourth, fourth_low = two_product(z, z)
    fourth_low = fourth_low + 2.0 * z * z_low
    t, t_low = two_product(fourth, _PER_24)
    t_low = t_low + (fourth_low * _PER_24 + fourth * _PER_24_LOW)
    s, rest = two_sum(1.0, -0.5 * z)
    s, more = two_sum(s, t)
    return s + ((rest + more) + (t_low - 0.5 * z_low + fourth * z * q - r * low))


@njit(**_KERNEL)
def sine(x: float) -> float:
    r, low, k = reduced(x)
    y = cosine_near_0(r, low) if k & 1 else sine_near_0(r, low)
    return -y if k & 2 else y


@njit(**_KERNEL)
def cosine(x: float) -> float:
    r, low, k = reduced(x)
    y = sine_near_0(r, low) if k & 1 else cosine_near_0(r, low)
    return -y if (k + 1) & 2 else y


@njit(**_KERNEL)
def exponential_less_1(x: float):
    """e^x − 1 in two parts for −700 ≤ x ≤ 0; of others −1."""
    if not -700.0 <= x <= 0.0:
        return -1.0, 0.0
    k = math.floor(x * _PER_LN2 + 0.5)
    a, b = x - k * _L0, k * _L1
    r, low = two_sum(a, -b)
    z, z_low = two_product(r, r)
    q = 1.6059043836821613e-10
    q = q * r + 2.08767569878681e-09
    q = q * r + 2.505210838544172e-08
    q = q * r + 2.755731922398589e-07
    q = q * r + 2.7557319223985893e-06
    q = q * r + 2.48015873015873e-05
    q = q * r + 1.984126984126984e-04
    q = q * r + 1.388888888888889e-03
    q = q * r + 8.333333333333333e-03
    q = q * r + 4.1666666666666664e-02
    cube, cube_low = two_product(z, r)
    cube_low = cube_low + z_low * r
    t, t_low = two_product(cube, _SIXTH)
    t_low = t_low + (cube_low * _SIXTH + cube * _SIXTH_LOW)
    s, rest = two_sum(r, 0.5 * z)
    s, more = two_sum(s, t)
    rest = (rest + more) + (t_low + 0.5 * z_low + cube * r * q + low * (1.0 + r))
    if k == 0.0:
        return s, rest
    scale = 1.0
    for _ in range(int(-k)):
        scale = scale * 0.5
    e, e_low = two_sum(1.0, s)
    e, e_low = e * scale, (e_low + rest) * scale
    hi, lo = two_sum(e, -1.0)
    return hi, lo + e_low


@njit(**_KERNEL)
def hold(omega: float, sigma: float, dt: float):
    """`laws.hold_responses`."""
    if (omega + 2.0 * sigma) * dt < 0.25:
        y, yp = 0.5 * dt * dt, dt
        t0, t1 = 0.0, 0.5 * dt * dt
        for k in range(1, 16):
            t2 = -(2.0 * sigma * dt * (k + 1.0) * t1 + omega * omega * dt * dt * t0) / ((k + 1.0) * (k + 2.0))
            y = y + t2
            yp = yp + (k + 2.0) * t2 / dt
            t0, t1 = t1, t2
        p11 = 1.0 - omega * omega * y
        return y, yp, p11, p11 - 2.0 * sigma * yp
    d2 = (omega - sigma) * (omega + sigma)
    if d2 * dt * dt < 1e-4:  # overdamped, or near it: what is said here need not be near
        return 0.0, 0.0, 0.0, 0.0
    less, less_low = exponential_less_1(-sigma * dt)
    one, one_low = two_sum(1.0, less)
    decay = one + (one_low + less_low)
    less = less + less_low
    wd = math.sqrt(d2)
    s = decay * sine(wd * dt) / wd
    c = decay * cosine(wd * dt)
    half = sine(0.5 * wd * dt)
    y = (-less + 2.0 * decay * half * half - sigma * s) / (omega * omega)
    return y, s, c + sigma * s, c - sigma * s


@njit(**_KERNEL)
def cubed(x: float) -> float:
    z, z_low = two_product(x, x)
    cube, cube_low = two_product(z, x)
    return cube + (cube_low + z_low * x)


@njit(**_KERNEL)
def quotient(omega: float, own: float, mass: float, q: float):
    """Real and imaginary part of iω/(m(ω_n² − ω² + iωω_n/Q)), ω_n = own; the greater part of what divides divides first."""
    real, imaginary = mass * (own * own - omega * omega), mass * (omega * own / q)
    if abs(real) >= abs(imaginary):
        ratio = imaginary / real
        scale = 1.0 / (real + imaginary * ratio)
        return omega * ratio * scale, omega * scale
    ratio = real / imaginary
    scale = 1.0 / (imaginary + real * ratio)
    return omega * scale, omega * ratio * scale


@njit(**_KERNEL)
def modes(string, linear: int, nut, ratio: float, loss: float, own: int, omega, sigma) -> None:
    """ω, σ of the first `own` modes: `physics.modes.model_frequencies` times `ratio`, `model_decay_rates` times `loss`.

    string (9,) as `packed_models.STRING` has it; nut (M, 3): Hz, Q, kg.
    """
    length, tension, mu, bending, viscoelastic = string[0], string[1], string[2], string[3], string[4]
    thermoelastic, viscosity, density, diameter = string[5], string[6], string[7], string[8]
    pi = math.pi
    lowest, stiffening = math.sqrt(tension / mu) / (2.0 * length), pi * pi * bending / (tension * (length * length))
    impedance = math.sqrt(tension * mu)
    for i in range(own):
        j = i + 1.0
        more = stiffening * (j * j)
        stiff = 1.0 + 0.5 * more if linear else math.sqrt(1.0 + more)
        omega_0 = 2.0 * pi * lowest * j
        real, imaginary = 0.0, 0.0
        for k in range(nut.shape[0]):
            _, part = quotient(omega_0, 2.0 * pi * nut[k, 0], nut[k, 2], nut[k, 1])
            imaginary = imaginary + part
        w = omega_0 * (stiff + -impedance / (pi * j) * imaginary)
        for k in range(nut.shape[0]):
            part, _ = quotient(w, 2.0 * pi * nut[k, 0], nut[k, 2], nut[k, 1])
            real = real + part
        nu, nu_0 = w / (2.0 * pi), lowest * j
        drag = 2.0 * pi * (viscosity + diameter * math.sqrt(pi * viscosity * density * nu))
        air = nu_0 / nu * drag / (2.0 * pi * mu * nu)
        inner = 4.0 * (pi * pi) * mu * (bending * viscoelastic) / (tension * tension) * cubed(nu_0) / nu
        at_nut = tension / (pi * length * nu) * real
        omega[i] = ratio * w
        sigma[i] = loss * (pi * nu * (air + inner + thermoelastic + at_nut))


@njit(**_KERNEL)
def shape(x: float, length: float, own: int, out) -> None:
    """`physics.modes.mode_shapes` at x, the first `own`."""
    scale, per = math.sqrt(2.0 / length), math.pi / length
    for i in range(own):
        out[i] = scale * sine(x * ((i + 1.0) * per))


@njit(**_KERNEL)
def heard(x: float, length: float, half: float, gain: float, own: int, out) -> None:
    """gain times `shape`, seen through an aperture of twice `half` [m]."""
    shape(x, length, own, out)
    for i in range(own):
        seen = out[i]
        if half > 0.0:
            angle = math.pi * ((i + 1.0) / length * half)
            seen = seen * (sine(angle) / angle)
        out[i] = gain * seen


@njit(**_KERNEL)
def filtered(omega, weights, taps, rate: float, out) -> None:
    """Weights (2, ≥n) times the gain at ω (n,) of a filter of these taps, from the middle on, at `rate` samples a second."""
    for i in range(omega.size):
        c = cosine(2.0 * math.pi * (omega[i] / (2.0 * math.pi)) / rate)
        later, after = 0.0, 0.0
        for k in range(taps.size - 1, 0, -1):
            later, after = taps[k] + 2.0 * c * later - after, later
        gain = taps[0] + 2.0 * (c * later - after)
        out[0, i], out[1, i] = weights[0, i] * gain, weights[1, i] * gain


@njit(**_KERNEL)
def hold_rows(omega, sigma, mu: float, dt: float, rows) -> None:
    """The first six of rows (ROWS, n) of exact-hold, p21 and kv of the impulse response that stands in row 1."""
    for j in range(omega.size):
        y, impulse, p11, p22 = hold(omega[j], sigma[j], dt)
        rows[0, j], rows[1, j], rows[3, j], rows[4, j] = p11, impulse, p22, y / mu


@njit(**_KERNEL)
def impulse_rows(omega, mu: float, impulse, rows) -> None:
    """Rows 2 and 5 from the second, (n,)."""
    for j in range(omega.size):
        rows[2, j], rows[5, j] = -omega[j] * omega[j] * impulse[j], impulse[j] / mu


@njit(**_KERNEL)
def later_rows(first, rows) -> None:
    """Rows 6 … 13 from the first six, (6, n): `responses.fill_rows` with the operations that compilers contract."""
    for j in range(rows.shape[1]):
        a, b, c, d, kq, kv = first[0, j], first[1, j], first[2, j], first[3, j], first[4, j], first[5, j]
        rows[6, j] = a + d
        rows[7, j] = multiplied_and_added(-a, d, b * c)
        rows[12, j] = multiplied_and_added(b, kv, -(d * kq))
        rows[13, j] = multiplied_and_added(c, kq, -(a * kv))
        for _ in range(3):
            cross, trace = b * c, a + d
            a, d = multiplied_and_added(a, a, cross), multiplied_and_added(d, d, cross)
            b, c = b * trace, c * trace
        rows[8, j], rows[9, j], rows[10, j], rows[11, j] = a, b, c, d


@njit(**_KERNEL)
def contact_matrix(gain, shapes, residual, out) -> None:
    """`laws.contact_matrix` below and on the diagonal; gain (n,) is the row that it takes."""
    for a in range(shapes.shape[0]):
        for b in range(a + 1):
            total = 0.0
            for j in range(gain.size):
                total = total + shapes[a, j] * gain[j] * shapes[b, j]
            out[a, b] = total + residual[a, b]


@njit(**_KERNEL)
def lags(velocity: int, rows, shapes, weights, mutual: int, out) -> None:
    """`responses.fill_lags` (P, C, 2K): of mutual ones p ≥ c."""
    n = rows.shape[1]
    x = np.zeros((n, BLOCK))
    for c in range(shapes.shape[0]):
        for j in range(n):
            q, v = rows[4, j] * shapes[c, j], rows[5, j] * shapes[c, j]
            if velocity:
                x[j, 0], x[j, 1] = v, rows[2, j] * q + rows[3, j] * v
            else:
                x[j, 0], x[j, 1] = q, rows[0, j] * q + rows[1, j] * v
            for k in range(2, BLOCK):
                x[j, k] = rows[6, j] * x[j, k - 1] + rows[7, j] * x[j, k - 2]
        for p in range(c if mutual else 0, weights.shape[0]):
            for k in range(2 * BLOCK):
                out[p, c, k] = 0.0
            for j in range(n):
                for k in range(BLOCK):
                    out[p, c, BLOCK + k] = out[p, c, BLOCK + k] + weights[p, j] * x[j, k]
