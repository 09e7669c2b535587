"""Contact forces on the exact complex modes of a whole instrument, held over very short steps: what kernels are measured by.

Between steps nothing is approximated: every complex mode goes its exact way under the forces, s its eigenvalue,

    z ← e^{sh} z + (e^{sh} − 1)/s · (left g) λ,        0 ≤ Re(r right z) + R λ − η  ⊥  λ ≥ 0 at the end of each step,

so that the only error is of the step with which contact forces change. The problem of a step is solved by Gauss–Seidel.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray

from synth.physics.coupled import CoupledStrings, Place

Array = NDArray[np.float64]
MOST_SWEEPS = 500


def contact_run(
    system: CoupledStrings,
    x: Array,
    places: Sequence[Place],
    heights_m: Array,
    residual: Array,
    rows: Array,
    rate_hz: float,
    every: int,
    count: int,
) -> tuple[Array, Array]:
    """rows (P, n) @ x and the contact forces (C,) at `count` instants, `every` steps of 1/rate_hz apart, from x (n,):
    (count, P), (count, C)."""  # fmt: skip
    modes, h = system.modes(), 1.0 / rate_hz
    s = modes.eigenvalues
    kept = s.imag >= 0.0
    share = np.where(s.imag > 0.0, 2.0, 1.0)[kept]
    s, right, left = s[kept], modes.right[:, kept], modes.left[kept]
    turn = np.exp(s * h)
    gain = ((turn - 1.0) / s)[:, None] * (left @ system.force_columns(places))
    seen = (system.displacement_rows(places) @ right) * share
    out = (rows @ right) * share
    yields = (seen @ gain).real + residual
    z = left @ x.astype(complex)
    return _run(z, turn, gain, seen, out, yields, residual, np.asarray(heights_m, float), every, count)


@njit
def _run(z, turn, gain, seen, out, yields, residual, heights, every, count):
    contacts, modes = seen.shape
    rows, forces = np.zeros((count, out.shape[0])), np.zeros((count, contacts))
    force, gap = np.zeros(contacts), np.zeros(contacts)
    for row in range(count):
        for _ in range(every if row else 0):
            for c in range(contacts):
                gap[c] = -heights[c]
            for k in range(modes):
                z[k] *= turn[k]
                for c in range(contacts):
                    gap[c] += seen[c, k].real * z[k].real - seen[c, k].imag * z[k].imag
            for _ in range(MOST_SWEEPS):
                changed, largest = 0.0, 0.0
                for c in range(contacts):
                    total = gap[c]
                    for o in range(contacts):
                        if o != c:
                            total += yields[c, o] * force[o]
                    new = max(0.0, -total / yields[c, c])
                    changed = max(changed, abs(new - force[c]))
                    largest = max(largest, new)
                    force[c] = new
                if changed <= 1e-14 * largest:
                    break
            for c in range(contacts):
                if force[c] != 0.0:
                    for k in range(modes):
                        z[k] += gain[k, c] * force[c]
        for p in range(out.shape[0]):
            for k in range(modes):
                rows[row, p] += out[p, k].real * z[k].real - out[p, k].imag * z[k].imag
        forces[row] = force
    return rows, forces
