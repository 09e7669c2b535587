"""`python -m synth.solver.width_trial`: times of passes over modes at each width of vectors, JSON for `jit.vector_width`.

{"8": {"16": seconds, …}, "4": …}: rows of so many modes, float64 and float32, coasting and driven, best of many.
"""

from __future__ import annotations

import json
import time
from typing import Any

import numpy as np
from numba import njit

from synth.jit.vector_width import NARROW, WIDE
from synth.native.arrays import aligned
from synth.solver.block_rows import BLOCK, ROWS
from synth.solver.lanes import one_kind_of_pass

LENGTHS = (16, 32, 64, 128, 256)
#: passes in a round, and rounds of each: a tenth of a second in all
_TURNS, _ROUNDS = 64, 60


def _passes(doubles: int) -> Any:
    """A kernel that takes `_TURNS` blocks over one contact with one output."""
    coast, drive = one_kind_of_pass("coast", "qq", doubles), one_kind_of_pass("drive", "", doubles)

    @njit(nogil=True)
    def take(n, rows, q, v, shape, weight, forces, u, out):
        for _ in range(_TURNS):
            coast(n, rows, q, v, shape, weight, u, out)
            drive(n, rows, q, v, shape, forces)

    return take


def _work(modes: int, kind: Any) -> tuple[Any, ...]:
    """Arguments of that for a row of modes that swing and decay."""
    angle = np.linspace(0.05, 2.8, modes)
    rows = aligned((ROWS, modes), kind)
    rows[0], rows[1], rows[2], rows[3] = np.cos(angle), np.sin(angle), -np.sin(angle), np.cos(angle)
    rows[6], rows[7] = 2.0 * np.cos(angle), -1.0
    q, v, shape, weight = (aligned(modes, kind) for _ in range(4))
    q[:] = shape[:] = weight[:] = 1.0 / modes
    return modes, rows, q, v, shape, weight, aligned(BLOCK), aligned(BLOCK), aligned(BLOCK)


def main() -> None:
    """The trial."""
    kernels = {lanes: _passes(lanes) for lanes in (WIDE, NARROW)}
    work = {(n, kind): _work(n, kind) for n in LENGTHS for kind in (np.float64, np.float32)}
    best = {(lanes, each): np.inf for lanes in kernels for each in work}
    for _ in range(_ROUNDS):  # in turn, so that what else the machine does meets all of them
        for lanes, each in best:
            begun = time.perf_counter()
            kernels[lanes](*work[each])
            best[lanes, each] = min(best[lanes, each], time.perf_counter() - begun)
    print(
        json.dumps(
            {str(w): {str(n): sum(best[w, (n, k)] for k in (np.float64, np.float32)) for n in LENGTHS} for w in kernels}
        )
    )


if __name__ == "__main__":
    main()
