"""Steps of a string, by the kernel that does them fastest: the same for the engine and for `simulate`."""

from __future__ import annotations

from numba import njit

from synth.solver.block_rows import BLOCK
from synth.solver.blocks import advance_blocks, fly_modes, press_blocks, press_two
from synth.solver.certificates import forget
from synth.solver.due_responses import fill_all_rows
from synth.solver.fingers import advance_under_finger
from synth.solver.laws import EXACT_HOLD
from synth.solver.lcp import SOLVED
from synth.solver.stepwise import has_answer, one_by_one
from synth.solver.stringmodel import CERTAIN, FREE, MOVING, place_contacts, scratch_of, string_model, string_state
from synth.solver.vectors import INNER


@njit(cache=True, nogil=True)
def advance(model: int, state: int, scratch: int, steps: int, placed: int) -> int:
    """`steps` steps of a string. A status of `lcp`.

    Scratch.out gets the outputs in use, a row of `steps` for each; Scratch.record the contact unknowns, (steps, C). A finger
    that is on goes along Scratch.path. placed: whether laws of velocities read the contacts' places off the modes before
    they step (where strings are changed from outside); else these are carried along, as the laws are printed.
    """
    m = string_model(model)
    blocks = steps // BLOCK
    if not _flies(model, state) and (has_answer(m) or m.contacts.lags.shape[0] != m.contacts.size):
        blocks = 0
    status = SOLVED
    if blocks > 0:
        status = _whole_blocks(model, state, scratch, blocks, steps, placed)
    if blocks * BLOCK < steps:
        bad = _remainder(model, state, scratch, blocks * BLOCK, steps - blocks * BLOCK, placed)
        if bad != SOLVED:
            status = bad
    return status


@njit(cache=True, nogil=True)
def _remainder(model: int, state: int, scratch: int, done: int, steps: int, placed: int) -> int:
    """So many steps, one by one, behind those that are done in blocks."""
    m, s, w = string_model(model), string_state(state), scratch_of(scratch)
    if not s.counts[FREE]:
        s.counts[MOVING] = m.modes
        fill_all_rows(model, state)
    for c in range(m.contacts.size):
        w.watch[c] = 0 if s.counts[FREE] else 1
        w.pivot.active[c] = 1 if s.force[c] > 0.0 else 0
    if placed:
        place_contacts(model, state, s.counts[MOVING])
    status = one_by_one(model, state, scratch, done, done, steps)
    s.counts[CERTAIN] = 0
    return status


@njit(cache=True, nogil=True)
def advance_two(
    model: int, state: int, scratch: int, other_model: int, other_state: int, other_scratch: int, blocks: int
) -> None:
    """So many blocks of steps of two strings that both `press`, to the bit what `advance` makes of each."""
    press_two(model, state, scratch, other_model, other_state, other_scratch, blocks, blocks * BLOCK)


@njit(**INNER)
def presses(model: int, state: int) -> bool:
    """Whether `advance` takes whole blocks by `press_blocks`: exact-hold over one contact that may be touched, no finger."""
    m, s = string_model(model), string_state(state)
    known = m.law == EXACT_HOLD and not has_answer(m)
    alone = m.contacts.size == 1 and m.contacts.lags.shape[0] == 1 and s.finger[0].on == 0 and s.counts[FREE] == 0
    return known and alone and m.outputs.on_q <= 1 and m.outputs.points - m.outputs.on_q <= 1


@njit(**INNER)
def _flies(model: int, state: int) -> bool:
    """Whether nothing can be touched, and `fly_blocks` knows the outputs."""
    m, s = string_model(model), string_state(state)
    one_of_each = m.outputs.on_q <= 1 and m.outputs.points - m.outputs.on_q <= 1
    return one_of_each and s.finger[0].on == 0 and (m.contacts.size == 0 or s.counts[FREE] != 0)


@njit(cache=True, nogil=True)
def _whole_blocks(model: int, state: int, scratch: int, blocks: int, stride: int, placed: int) -> int:
    """The first blocks of rows of `stride` steps."""
    m, s = string_model(model), string_state(state)
    hold, fingered = m.law == EXACT_HOLD, s.finger[0].on != 0
    if _flies(model, state):
        out = scratch_of(scratch).out[: m.outputs.points * stride].reshape(m.outputs.points, stride)
        fly_modes(model, scratch, s.q, s.v, s.counts[MOVING], blocks, out)
        return SOLVED
    if presses(model, state):
        press_blocks(model, state, scratch, blocks, stride)
        return SOLVED
    if placed and not hold:
        place_contacts(model, state, m.rows.shape[1])
    if not s.counts[CERTAIN]:
        forget(state)
        s.counts[CERTAIN] = 1
    if fingered:
        return advance_under_finger(model, state, scratch, blocks, stride)
    return advance_blocks(model, state, scratch, blocks, stride)
