"""Common poles of several measured responses, by relaxed vector fitting.

Gustavsen and Semlyen, IEEE Trans. Power Delivery 14 (1999) 1052: with poles a_n as a first guess, σ(s) Y_c(s) ≈
Σ r_cn/(s − a_n) + out of band terms and σ(s) = d + Σ r_n/(s − a_n) are a linear least-squares problem, and the zeros of σ
are better poles. Relaxed (Gustavsen, ibid. 21 (2006) 1587): d is an unknown too, and the mean of Re σ over the data is held
at 1. Fast (Deschrijver et al., IEEE Microw. Wireless Compon. Lett. 18 (2008) 383): each response's own residues are
eliminated by a QR factorisation.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]
#: rounds that move the poles
ROUNDS = 8
#: relative change of all poles that is none
SETTLED = 1e-4


def common_poles(omega: Real, responses: Complex, weights: Real, count: int, rounds: int = ROUNDS) -> Complex:
    """Poles a (K,) [1/s] of positive frequency, K ≤ count, Re a < 0, rising in frequency; real ones are left out.

    omega      (n,) [rad/s], rising, > 0
    responses  (c, n) complex, which besides the poles may have a part like 1/s, one constant and one like s
    weights    (c, n) ≥ 0
    count      how many pairs of poles are looked for
    """
    scale = float(np.sqrt(omega[0] * omega[-1]))  # frequencies near 1
    s: Complex = np.asarray(1j * omega / scale, dtype=np.complex128)
    start = np.geomspace(omega[0], omega[-1], count) / scale
    poles: Complex = np.array([part for w in start for part in (complex(-0.01 * w, w), complex(-0.01 * w, -w))])
    for _ in range(rounds):
        moved = _relocated(s, responses, weights, poles)
        done = moved.size == poles.size and np.allclose(
            np.sort_complex(moved), np.sort_complex(poles), rtol=SETTLED, atol=0.0
        )
        poles = moved
        if done:
            break
    found: Complex = poles[poles.imag > 0.0] * scale
    return found[np.argsort(found.imag)]


def _relocated(s: Complex, responses: Complex, weights: Real, poles: Complex) -> Complex:
    """The zeros of σ, all of them with a negative real part."""
    basis = _basis(s, poles)
    n = poles.size
    own = np.hstack([basis, np.stack([1.0 / s, np.ones_like(s), s], axis=1)])
    blocks, right = [], []
    for response, weight in zip(responses, weights, strict=True):
        shared = -response[:, None] * np.hstack([basis, np.ones((s.size, 1))])
        matrix = np.hstack([own, shared]) * weight[:, None]
        matrix = np.vstack([matrix.real, matrix.imag])
        lower = np.asarray(np.linalg.qr(matrix, mode="r"))[own.shape[1] :, own.shape[1] :]
        blocks.append(lower)
        right.append(np.zeros(len(lower)))
    # mean Re σ = 1, as heavy as the data
    size = float(np.sqrt(np.mean([np.linalg.norm(w * np.abs(r)) ** 2 for w, r in zip(weights, responses, strict=True)])))
    blocks.append(size * np.concatenate([basis.real.mean(axis=0), [1.0]])[None])
    right.append(np.array([size]))
    matrix = np.vstack(blocks)
    unit = 1.0 / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    solution = np.linalg.lstsq(matrix * unit, np.concatenate(right), rcond=None)[0] * unit
    residues, constant = solution[:n], solution[n]
    if abs(constant) < 1e-8:
        constant = 1e-8 if constant >= 0.0 else -1e-8
    zeros = np.linalg.eigvals(_state_matrix(poles) - np.outer(_input(poles), residues) / constant)
    zeros = np.where(zeros.real > 0.0, -zeros.conj(), zeros)
    # what is real has no partner, so two of them make room for a pair
    pairs = zeros[zeros.imag > 1e-9 * np.abs(zeros)]
    real = np.sort(-zeros[np.abs(zeros.imag) <= 1e-9 * np.abs(zeros)].real)
    spare = [complex(-0.3 * w, w) for w in real[::2]]
    pairs = np.concatenate([pairs, np.array(spare, dtype=np.complex128)])
    pairs = np.where(pairs.real == 0.0, pairs - 1e-6 * np.abs(pairs), pairs)
    return np.stack([pairs, pairs.conj()], axis=1).ravel().astype(np.complex128)


def _basis(s: Complex, poles: Complex) -> Complex:
    """(n, 2K): of each conjugate pair the two combinations whose weights are real."""
    upper = 1.0 / (s[:, None] - poles[::2])
    lower = 1.0 / (s[:, None] - poles[1::2])
    return np.stack([upper + lower, 1j * (upper - lower)], axis=2).reshape(s.size, -1)


def _state_matrix(poles: Complex) -> Real:
    """Real and block diagonal, with these eigenvalues, for the basis' weights."""
    matrix = np.zeros((poles.size, poles.size))
    for k in range(0, poles.size, 2):
        a = poles[k]
        matrix[k : k + 2, k : k + 2] = [[a.real, a.imag], [-a.imag, a.real]]
    return matrix


def _input(poles: Complex) -> Real:
    return np.tile([2.0, 0.0], poles.size // 2)
