"""The largest kernels of a string, with the types of the arguments that all callers give them: what `kernel_helpers`
takes apart."""

from __future__ import annotations

from numba import types

from synth.solver.blocks import Blocks, BlockWork, advance_blocks
from synth.solver.driver import Model, Run, _divided_step, _weighed_step
from synth.solver.fingers import Grip, advance_under_finger
from synth.solver.kernels import Finger, Work, advance
from synth.solver.substeps import Substeps, advance_substepped

INT, DOUBLE, BYTE = types.int64, types.float64, types.uint8


_1, _2, _3 = (types.Array(DOUBLE, dimensions, "C") for dimensions in (1, 2, 3))
_INTS, _BYTES = types.Array(INT, 1, "C"), types.Array(BYTE, 1, "C")
FINGER = types.NamedTuple((INT, _1, _1, DOUBLE, DOUBLE, DOUBLE, _1, _1), Finger)
GRIP = types.NamedTuple((_2, _2, _2, _1), Grip)
WORK = types.NamedTuple((_1, _1, _1, _2, _2, _INTS, _BYTES, _BYTES), Work)
BLOCK_WORK = types.NamedTuple(
    (_2, _2, _2, _INTS, _BYTES, _INTS, _1, _2, _INTS, _INTS, _INTS, _1, _1, _1, _2, _INTS, _BYTES, _BYTES, _2), BlockWork
)
SUBSTEPS = types.NamedTuple((INT, _2, _2), Substeps)
BLOCKS = types.NamedTuple((DOUBLE, _2, _2, _3, _2, _3), Blocks)
MODEL = types.NamedTuple((INT, DOUBLE, DOUBLE, DOUBLE, _1, _1, _2, _1, _2, _1, _2, _2, _2, SUBSTEPS, BLOCKS), Model)
RUN = types.NamedTuple((*[_1] * 8, _INTS, *[_2] * 4, _BYTES, _2, _2, _2, WORK, BLOCK_WORK, _2, _2, _2, _1, _1), Run)
_STEPS = (INT, INT, INT, DOUBLE, DOUBLE, _2, _1, _2, _1, _3, INT, _1, _1, _1, _1)
_OUTPUTS = (_2, INT, _3, _2, _2)

ADVANCE_BLOCKS = (advance_blocks, (*_STEPS, *_OUTPUTS, _2, BLOCK_WORK))
ADVANCE_UNDER_FINGER = (advance_under_finger, (*_STEPS, FINGER, GRIP, *_OUTPUTS, BLOCK_WORK))
ADVANCE = (
    advance,
    (INT, INT, DOUBLE, DOUBLE, _2, _2, _1, _2, _1, _1, _1, _1, _1, FINGER, _BYTES, _2, _2, _2, _2, _2, _2, WORK),
)
ADVANCE_SUBSTEPPED = (
    advance_substepped,
    (INT, DOUBLE, SUBSTEPS, _2, _2, _1, _1, _1, _1, _1, FINGER, _BYTES, _INTS, _2, _2, _2, _2, _2, _2, _1, _2, _2, WORK),
)
DIVIDED_STEP = (_divided_step, (MODEL, RUN, FINGER, _1, types.boolean, _2, _2))
WEIGHED_STEP = (_weighed_step, (MODEL, RUN, FINGER, _1, _2, _2, _2))
