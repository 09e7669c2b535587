"""Sums of the projection of a string's modes on those of another speaking length: see `strings._change_model`.

With a_i = iπ/ℓ the wave numbers of the new length ℓ, b_j = jπ/L those of the old one, the integral of two of the sines over
the length they share is numerator_i · factor_j / (a_i² − b_j²), and where a_i is b_j it is ± half of that length. What a
processor takes longest for is the division: four old modes share one,

    Σ_k Q_k/g_k = (g₃g₄ (g₂Q₁ + g₁Q₂) + g₁g₂ (g₄Q₃ + g₃Q₄)) / (g₁g₂g₃g₄).
"""

from __future__ import annotations

import math

from numba import njit

from synth.solver.vectors import INNER

#: two wave numbers are the same one where their squares differ by less than this share
SAME = 1e-9


@njit(**INNER)
def add_projections(a, numerators, factors, signs, new_length: float, old_length: float, q, v, q_sum, v_sum) -> None:
    """All old modes' q and v (n_old,), times their integrals with each new mode, added to q_sum and v_sum (n_new,).

    a, numerators, signs: of the new modes, signs (−1)^(i+1); factors: of the old ones. Lengths in m.
    """
    j = 0
    while j < q.size:
        if j + 4 <= q.size and not _meets_any(j, new_length / old_length):
            b = (
                (j + 1) * math.pi / old_length,
                (j + 2) * math.pi / old_length,
                (j + 3) * math.pi / old_length,
                (j + 4) * math.pi / old_length,
            )
            first, second, third, fourth = factors[j], factors[j + 1], factors[j + 2], factors[j + 3]
            _add_four(
                a,
                numerators,
                b,
                (first * q[j], second * q[j + 1], third * q[j + 2], fourth * q[j + 3]),
                (first * v[j], second * v[j + 1], third * v[j + 2], fourth * v[j + 3]),
                q_sum,
                v_sum,
            )
            j += 4
        else:
            equal = 0.5 * min(new_length, old_length) * (1.0 if j % 2 == 0 else -1.0)
            _add_one(a, numerators, factors[j], (j + 1) * math.pi / old_length, signs, equal, q[j], v[j], q_sum, v_sum)
            j += 1


@njit(inline="always")
def _meets_any(j: int, ratio: float) -> bool:
    """Whether one of four old modes, number j + 1 the first, has the wave number of a new one, of lengths new / old."""
    for k in range(j + 1, j + 5):
        number = k * ratio
        if abs(number - math.floor(number + 0.5)) <= SAME * number:
            return True
    return False


@njit(error_model="numpy", fastmath={"contract"}, **INNER)
def _add_four(a, numerators, b, of_q, of_v, q_sum, v_sum) -> None:
    """Four old modes of wave numbers b, none of which is a new one's; of_q, of_v: their q and v times their factors."""
    b1, b2, b3, b4 = b
    q1, q2, q3, q4 = of_q
    v1, v2, v3, v4 = of_v
    for i in range(a.size):
        x = a[i]
        g1, g2, g3, g4 = (x - b1) * (x + b1), (x - b2) * (x + b2), (x - b3) * (x + b3), (x - b4) * (x + b4)
        g12, g34 = g1 * g2, g3 * g4
        weight = numerators[i] / (g12 * g34)
        q_sum[i] += weight * (g34 * (g2 * q1 + g1 * q2) + g12 * (g4 * q3 + g3 * q4))
        v_sum[i] += weight * (g34 * (g2 * v1 + g1 * v2) + g12 * (g4 * v3 + g3 * v4))


@njit(error_model="numpy", **INNER)
def _add_one(a, numerators, factor: float, b: float, signs, equal: float, q: float, v: float, q_sum, v_sum) -> None:
    """One old mode of wave number b, whose integral with a new mode of the same one is `equal` with that one's sign."""
    for i in range(a.size):
        gap = (a[i] - b) * (a[i] + b)
        weight = numerators[i] * factor / gap
        if not abs(gap) > SAME * a[i] * a[i]:
            weight = signs[i] * equal
        q_sum[i] += weight * q
        v_sum[i] += weight * v
