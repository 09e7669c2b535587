"""The largest kernels of a string, with the types of the arguments that all callers give them: what `kernel_helpers`
takes apart."""

from __future__ import annotations

from typing import Any

from numba import types

from synth.solver.blocks import BlockWork, advance_blocks
from synth.solver.fingers import Grip, advance_under_finger
from synth.solver.kernels import Finger, Work, advance

INT, DOUBLE, BYTE = types.int64, types.float64, types.uint8


def array(dimensions: int, kind: Any = DOUBLE) -> Any:
    """Type of a contiguous array."""
    return types.Array(kind, dimensions, "C")


_1, _2, _3 = array(1), array(2), array(3)
_INTS, _BYTES = array(1, INT), array(1, BYTE)
FINGER = types.NamedTuple((INT, _1, _1, DOUBLE, DOUBLE, DOUBLE, _1, _1), Finger)
GRIP = types.NamedTuple((_2, _2, _2, _1), Grip)
WORK = types.NamedTuple((_1, _1, _1, _2, _2, _INTS, _BYTES, _BYTES), Work)
BLOCK_WORK = types.NamedTuple(
    (_2, _2, _2, _INTS, _BYTES, _INTS, _1, _2, _INTS, _INTS, _INTS, _1, _1, _1, _2, _INTS, _BYTES, _BYTES, _2), BlockWork
)
_STEPS = (INT, INT, INT, DOUBLE, DOUBLE, _2, _1, _2, _1, _3, INT, _1, _1, _1, _1)
_OUTPUTS = (_2, INT, _3, _2, _2)

ADVANCE_BLOCKS = (advance_blocks, (*_STEPS, *_OUTPUTS, _2, BLOCK_WORK))
ADVANCE_UNDER_FINGER = (advance_under_finger, (*_STEPS, FINGER, GRIP, *_OUTPUTS, BLOCK_WORK))
ADVANCE = (
    advance,
    (INT, INT, DOUBLE, DOUBLE, _2, _2, _1, _2, _1, _1, _1, _1, _1, FINGER, _BYTES, _2, _2, _2, _2, _2, _2, WORK),
)
