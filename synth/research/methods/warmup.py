"""What `kernel_helpers` compiles for `simulate` by one of the laws of the block kernels."""

from __future__ import annotations

from typing import Any

from numba import types

from synth.solver.blocks import advance_blocks
from synth.solver.fingers import advance_under_finger
from synth.solver.stepwise import one_by_one
from synth.solver.study import divided_step, weighed_step
from synth.solver.substeps import advance_substepped


def kernels() -> list[tuple[Any, tuple[Any, ...]]]:
    """(kernel, types of its arguments) in an order in which nobody has to wait for long."""
    words = [(types.int64,) * count for count in range(7)]
    divide, record = types.Array(types.int64, 1, "C"), types.Array(types.float64, 2, "C")
    return [
        (advance_blocks, words[5]),
        (one_by_one, words[6]),
        (advance_under_finger, words[5]),
        (weighed_step, words[5]),
        (divided_step, words[2]),
        (advance_substepped, (*words[5], divide, record)),
    ]
