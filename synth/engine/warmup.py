"""What `kernel_helpers` compiles for an engine."""

from __future__ import annotations

from typing import Any

from numba import types

from synth.engine.advance import advance_string, advance_two_strings, begin_quantum
from synth.engine.coefficients import refresh
from synth.engine.hands import perform
from synth.engine.mix import mix_span
from synth.engine.process import quantum_with_events
from synth.engine.voices.policy import handle
from synth.solver.blocks import advance_blocks
from synth.solver.fingers import advance_under_finger
from synth.solver.step import advance
from synth.solver.stepwise import one_by_one


def kernels() -> list[tuple[Any, tuple[Any, ...]]]:
    """(kernel, types of its arguments) in an order in which nobody has to wait for long."""
    words = [(types.int64,) * count for count in range(7)]
    return [
        (advance_blocks, words[5]),
        (perform, words[5]),
        (advance_under_finger, words[5]),
        (handle, words[1]),
        (mix_span, words[3]),
        (one_by_one, words[6]),
        (refresh, words[3]),
        (quantum_with_events, words[3]),
        (begin_quantum, words[4]),
        (advance, words[5]),
        (advance_string, words[5]),
        (advance_two_strings, words[6]),
    ]


def coupled_kernels() -> list[tuple[Any, tuple[Any, ...]]]:
    """The same for one whose strings share a bridge."""
    from synth.solver.frames import advance_frames

    return [(advance_frames, (*(types.int64,) * 4, types.Array(types.float64, 2, "A"))), *kernels()]
