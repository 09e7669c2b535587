"""What threads and events ask of an instrument: whole quanta, the start of one, a stretch within it."""

from __future__ import annotations

import numpy as np

from synth.engine.advance import advance_string, begin_quantum, make_steps
from synth.engine.core import bank_of, shared_of, state_of
from synth.engine.layout import BEGIN, QUANTA, QUANTUM, STRETCH, TASK, TOGETHER, UNTIL
from synth.jit.entries import entry
from synth.native.views import call_back


def _work_on(core: int, thread: int, i: int, _: int) -> None:
    """Let instrument i do what Shared.task asks."""
    task, sounding, strings = shared_of(core).task, state_of(core).sounding, bank_of(core).strings
    instrument = bank_of(core).instruments[i]
    first, end, kind = instrument.first_string, instrument.end_string, task[TASK]
    if instrument.body >= 0:
        call_back(task[TOGETHER], core, thread, i, 0)
    elif kind == BEGIN:
        for s in range(first, end):
            if sounding[s].awake:
                begin_quantum(core, thread, s, int(np.int64(0)))  # a literal would compile it once more
    elif kind == STRETCH:
        for s in range(first, end):
            me = sounding[s]
            if me.awake and me.reached < task[UNTIL] and not strings[s].of_first:
                advance_string(core, thread, s, me.reached, task[UNTIL] - me.reached)
            me.reached = task[UNTIL]
    else:
        for k in range(task[QUANTA]):
            for s in range(first, end):
                if sounding[s].awake:
                    begin_quantum(core, thread, s, k)
            for s in range(first, end):
                if sounding[s].awake and not strings[s].of_first:
                    advance_string(core, thread, s, k * QUANTUM, int(np.int64(QUANTUM)))


def entries(coupled: bool, boards: bool = False) -> tuple[int, int, int, int]:
    """Addresses of `_work_on` (core, thread, i, –), of what makes steps (core, thread, s, steps), where strings share a
    bridge of `together.work_together` (core, thread, i, –), else 0, and of what makes the steps of strings without a board;
    compiled on first use.

    Called by address: every function that contains the kernels takes seconds to compile, so none but the last two do, and
    neither `process` nor the loop of a worker contains `_work_on`.
    """
    together = 0
    if coupled:
        from synth.engine.together import work_together

        together = entry(work_together, 4).address
    step = off_board = entry(make_steps, 4).address
    if boards:
        from synth.engine.board_steps import make_steps_on_boards

        step = entry(make_steps_on_boards, 4).address
    return entry(_work_on, 4).address, step, together, off_board
