"""What the modes left out do at the contacts, as a few lumped modes.

Of a string whose first N modes are kept, the modes j > N act on the contacts through C(s) = Σ φ_j φ_jᵀ/(μ(s² + ω̂_j²)).
Here they are restricted to the shapes that static and slowly growing contact forces give them, Ω̂⁻²Sᵀ and Ω̂⁻⁴Sᵀ (a
block Krylov space about s = 0; Ritz values). That is a string which can move in fewer ways, hence passive, and C(s) is
matched in its first four moments in s²: static compliance, inertia, and two more.

Two things are added to it:

- Ritz modes have to give back what the many modes behind each of them carry away along the string, and do so too early.
  They are damped by a share of their distance to the band of the kept modes, σ = σ̂ + 0.2 (ω − ω̂_N): a wave that leaves
  the contact does not come back in phase. What they take is lost, on a string without losses too.
- A mode that turns by nearly half a period or more in one step of the contact force is not resolved by it. All of these
  become modes at the fastest frequency that is, with the same static compliance and seven radians to the e-fold.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from synth.physics.modes import base_frequencies, mode_shapes, model_decay_rates, residual_compliance
from synth.physics.string import String

#: damping of a lumped mode per distance of its frequency to the kept modes
RADIATION = 0.2
#: radians per step of the contact force up to which a mode is resolved, and σ/ω of those brought down to it
RESOLVED = 2.8
DAMPING_RATIO = 1.0 / 7.0
#: modes summed: this many times those kept and no fewer than the least; what is behind them stays static
_SUMMED, _LEAST_SUMMED = 8, 1000
#: directions of the unit shapes that are smaller are dropped (contacts that coincide, or lie on an end)
_NEGLIGIBLE = 1e-7
#: and contacts whose shapes are that much smaller than shapes can be
_AT_REST = 1e-10


class Tail(NamedTuple):
    """K lumped modes for C contacts, K ≤ 2C, of T modes behind the first N."""

    omega: np.ndarray  # (K,) [rad/s]
    sigma: np.ndarray  # (K,) [1/s]
    shapes: np.ndarray  # (C, K), what φ_j(x_c) is for a mode [1/√m]
    residual: np.ndarray  # (C, C) static compliance of what is behind mode N + T [m/N]
    first: int  # N
    mix: np.ndarray  # (T, K) lumped modes in terms of modes N + 1 … N + T
    base_omega: np.ndarray  # (T,) ω̂ of those

    @property
    def modes(self) -> int:
        """N + T: how many modes `weights` and `state` must be told of."""
        return self.first + self.base_omega.size

    def weights(self, weights: np.ndarray) -> np.ndarray:
        """(…, K) weights on the lumped modes of a functional with weights (…, N + T) on the string's."""
        return weights[..., self.first :] @ self.mix

    def state(self, q: np.ndarray) -> np.ndarray:
        """(K,) coordinates of the shape q (N + T,) or its rate: of those possible the nearest in elastic energy."""
        return (self.base_omega**2 * q[self.first :]) @ self.mix / self.omega**2


def lumped_tail(string: String, positions_m: np.ndarray | Sequence[float], n_modes: int, contact_rate_hz: float) -> Tail:
    """The modes above N = n_modes at contacts (C,) whose forces may change contact_rate_hz times a second.

    Σ ψψᵀ/(μω²) + residual is `modes.residual_compliance`, exactly but for rounding. Frequencies are the model's
    stiffness law alone, as there. Raises ValueError for positions outside [0, L] and a rate that is not positive.
    """
    if not (contact_rate_hz > 0.0 and math.isfinite(contact_rate_hz)):
        raise ValueError(f"contact_rate_hz must be > 0 Hz and finite, got {contact_rate_hz}")
    total = max(_LEAST_SUMMED, _SUMMED * n_modes)
    base, rates = _summed(string, total)
    band = base[n_modes - 1] if n_modes > 0 else 0.0
    base = base[n_modes:]
    shapes = mode_shapes(string.length_m, positions_m, total)[:, n_modes:]

    static = (shapes / base**2).T
    # an end gives way to nothing but rounding
    moved = np.linalg.norm(static, axis=0) > _AT_REST * math.sqrt(2.0 / string.length_m) * np.linalg.norm(base**-2.0)
    basis = _orthonormal(static[:, moved], np.zeros((base.size, 0)))
    basis = np.hstack([basis, _orthonormal(basis / (base**2)[:, None], basis)])
    squares, vectors = np.linalg.eigh(basis.T @ (base[:, None] ** 2 * basis))
    omega, mix = np.sqrt(squares), basis @ vectors
    own = (rates[n_modes:, None] * mix**2).sum(axis=0)
    sigma = own + RADIATION * (omega - band)

    fastest = RESOLVED * contact_rate_hz
    slow = omega <= fastest
    if not slow.all():
        # one frequency for all of them: rotated among each other so that no more couple than there are contacts
        fast = mix[:, ~slow] * (fastest / omega[~slow])
        _, strength, rows = np.linalg.svd(shapes @ fast, full_matrices=False)
        fast = fast @ rows[strength > _NEGLIGIBLE * strength[0]].T
        mix = np.hstack([mix[:, slow], fast])
        omega = np.append(omega[slow], np.full(fast.shape[1], fastest))
        sigma = np.append(sigma[slow], np.full(fast.shape[1], DAMPING_RATIO * fastest))
    residual = residual_compliance(string, positions_m, total)
    return Tail(omega, sigma, shapes @ mix, residual, n_modes, mix, base)


@lru_cache(maxsize=8)
def _summed(string: String, total: int) -> tuple[np.ndarray, np.ndarray]:
    """ω̂ and σ (total,) of the first modes: many notes are made of one string."""
    base, rates = base_frequencies(string, total), model_decay_rates(string, total)
    base.flags.writeable = rates.flags.writeable = False
    return base, rates


def _orthonormal(block: np.ndarray, against: np.ndarray) -> np.ndarray:
    """An orthonormal basis (T, ≤C) of what the columns of block (T, C) add to the orthonormal columns of `against`."""
    if block.shape[1] == 0:
        return block
    block = block / np.linalg.norm(block, axis=0)
    for _ in range(2):  # twice is enough
        block = block - against @ (against.T @ block)
    basis, small = np.linalg.qr(block)
    left, strength, _ = np.linalg.svd(small)
    return basis @ left[:, strength > _NEGLIGIBLE]
