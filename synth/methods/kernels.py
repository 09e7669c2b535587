"""What `kernel_helpers` compiles for `simulate` by one of the laws of the block kernels."""

from __future__ import annotations

from typing import Any

from synth.solver.signatures import ADVANCE, ADVANCE_BLOCKS, ADVANCE_SUBSTEPPED, DIVIDED_STEP, WEIGHED_STEP


def kernels() -> list[tuple[Any, tuple[Any, ...]]]:
    """(kernel, types of its arguments) in an order in which nobody has to wait for long."""
    return [ADVANCE_BLOCKS, ADVANCE, WEIGHED_STEP, DIVIDED_STEP, ADVANCE_SUBSTEPPED]
