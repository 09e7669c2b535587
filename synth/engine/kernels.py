"""What `kernel_helpers` compiles for an engine."""

from __future__ import annotations

from typing import Any

from numba import types

from synth.engine.advance import _advance_string, _begin_quantum, _in_blocks, _one_by_one
from synth.engine.coefficients import refresh
from synth.engine.mix import mix_span
from synth.engine.process import _quantum_with_events
from synth.solver.signatures import ADVANCE, ADVANCE_BLOCKS, ADVANCE_UNDER_FINGER


def kernels() -> list[tuple[Any, tuple[Any, ...]]]:
    """(kernel, types of its arguments) in an order in which nobody has to wait for long."""
    words = [(types.int64,) * count for count in range(6)]
    return [
        ADVANCE_BLOCKS,
        (_quantum_with_events, words[3]),
        ADVANCE_UNDER_FINGER,
        (mix_span, words[3]),
        ADVANCE,
        (refresh, words[3]),
        (_begin_quantum, words[4]),
        (_one_by_one, words[5]),
        (_in_blocks, words[5]),
        (_advance_string, words[5]),
    ]
