"""The steps of an engine some of whose strings lie over boards: what stands in `layout.STEP` then."""

from __future__ import annotations

from synth.engine.advance import step_along_path
from synth.engine.core import hand_of, is_held, model_address, shared_of, string_of, tally_of
from synth.engine.layout import NO_FINGER, OFF_BOARD
from synth.native.views import call_back
from synth.solver.board import advance_on_board
from synth.solver.stringmodel import MOVING


def make_steps_on_boards(core: int, thread: int, s: int, steps: int) -> None:
    """`advance.make_steps`, of a string over a board by `board.advance_on_board`."""
    shared = shared_of(core)
    hand, tally, string = hand_of(core, s), tally_of(core, s), string_of(core, s)
    board = shared.board_at[hand.model]
    if board == 0:
        call_back(shared.task[OFF_BOARD], core, thread, s, steps)
        return
    moved = string.counts[MOVING]
    string.finger[0].on = 1 if is_held(hand) else 0
    if hand.phase != NO_FINGER:
        step_along_path(core, thread, s, steps)
    advance_on_board(model_address(core, s), shared.string_at[s], thread, board, steps)
    tally.mode_steps += max(moved, string.counts[MOVING]) * steps
