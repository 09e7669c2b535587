"""What threads and events ask of an instrument: whole quanta, the start of one, a stretch within it."""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.engine.advance import (
    advance_string,
    advance_two_strings,
    begin_quantum,
    make_steps,
    make_steps_of_two,
    unchanged_quanta,
)
from synth.engine.core import bank_of, progress_of, shared_of, voice_of
from synth.engine.layout import BEGIN, CORE, QUANTA, QUANTUM, STRETCH, TASK, TOGETHER, UNTIL
from synth.jit.entries import entry
from synth.native.views import call_back


def work_on(core: int, thread: int, i: int, other: int) -> None:
    """Let instrument i do what Shared.task asks, and with it, where there is one (≥ 0), the other."""
    task = shared_of(core).task
    if other < 0 or task[TASK] == BEGIN or not (_is_one_string(core, i) and _is_one_string(core, other)):
        _work_on_one(core, thread, i)
        if other >= 0:
            _work_on_one(core, thread, other)
        return
    instruments = bank_of(core).instruments
    s, beside = instruments[i].first_string, instruments[other].first_string
    if task[TASK] == STRETCH:
        begun = progress_of(core, s).reached
        if not (voice_of(core, s).awake and voice_of(core, beside).awake and progress_of(core, beside).reached == begun):
            _work_on_one(core, thread, i)
            _work_on_one(core, thread, other)
            return
        if begun < task[UNTIL]:
            advance_two_strings(core, thread, s, beside, begun, task[UNTIL] - begun)
        progress_of(core, s).reached = progress_of(core, beside).reached = task[UNTIL]
        return
    k = int(np.int64(0))
    while k < task[QUANTA]:
        count = task[QUANTA] - k
        for line in (s, beside):
            if voice_of(core, line).awake:
                begin_quantum(core, thread, line, k)
            if voice_of(core, line).awake:
                count = min(count, unchanged_quanta(core, thread, line, k))
        if voice_of(core, s).awake and voice_of(core, beside).awake:
            advance_two_strings(core, thread, s, beside, k * QUANTUM, count * QUANTUM)
        elif voice_of(core, s).awake:
            advance_string(core, thread, s, k * QUANTUM, count * QUANTUM)
        elif voice_of(core, beside).awake:
            advance_string(core, thread, beside, k * QUANTUM, count * QUANTUM)
        k += count


@njit(**CORE)
def _is_one_string(core: int, i: int) -> bool:
    """Whether an instrument is a string that shares nothing with another, in one direction."""
    instrument = bank_of(core).instruments[i]
    return instrument.body < 0 and instrument.end_string == instrument.first_string + 1


@njit(**CORE)
def _work_on_one(core: int, thread: int, i: int) -> None:
    """Let instrument i do what Shared.task asks."""
    task, strings = shared_of(core).task, bank_of(core).strings
    instrument = bank_of(core).instruments[i]
    first, end, kind = instrument.first_string, instrument.end_string, task[TASK]
    if instrument.body >= 0:
        call_back(task[TOGETHER], core, thread, i, 0)
    elif kind == BEGIN:
        for s in range(first, end):
            if voice_of(core, s).awake:
                begin_quantum(core, thread, s, int(np.int64(0)))  # a literal would compile it once more
    elif kind == STRETCH:
        for s in range(first, end):
            voice, progress = voice_of(core, s), progress_of(core, s)
            if voice.awake and progress.reached < task[UNTIL] and not strings[s].of_first:
                advance_string(core, thread, s, progress.reached, task[UNTIL] - progress.reached)
            progress.reached = task[UNTIL]
    else:
        k = int(np.int64(0))
        while k < task[QUANTA]:
            for s in range(first, end):
                if voice_of(core, s).awake:
                    begin_quantum(core, thread, s, k)
            alone = end == first + 1 and voice_of(core, first).awake
            count = unchanged_quanta(core, thread, first, k) if alone else int(np.int64(1))
            for s in range(first, end):
                if voice_of(core, s).awake and not strings[s].of_first:
                    advance_string(core, thread, s, k * QUANTUM, count * QUANTUM)
            k += count


def entries(coupled: bool, boards: bool = False) -> tuple[int, int, int, int, int]:
    """Addresses of `work_on` (core, thread, i, other), of what makes steps (core, thread, s, steps), where strings share a
    bridge of `together.work_together` (core, thread, i, –), else 0, of what makes the steps of strings without a board, and
    of two of them at a time (core, thread, s, other, steps); compiled on first use.

    Called by address: a function that contains the kernels takes seconds to compile. `work_on` contains none, and neither
    `process` nor the loop of a worker contains it.
    """
    together = 0
    if coupled:
        from synth.engine.together import work_together

        together = entry(work_together, 4).address
    step = off_board = entry(make_steps, 4).address
    if boards:
        from synth.engine.board_steps import make_steps_on_boards

        step = entry(make_steps_on_boards, 4).address
    return entry(work_on, 4).address, step, together, off_board, entry(make_steps_of_two, 5).address
