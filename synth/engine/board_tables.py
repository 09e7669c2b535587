"""Boards of an engine: a table for every length of the modal grid that a string has over its board, and where the core finds
it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from synth.engine.layout import Bank, Shared
from synth.instrument.boards import BY_FORCE, StringBoard
from synth.native.arrays import allocate
from synth.native.views import opener, table, words
from synth.solver.board_table import CONSTANT, Board, BoardRoom, board_sizes, board_tables
from synth.solver.wall import spring_rate


class LaidBoard(NamedTuple):
    """What lies under a model: of the same string, models of as many intervals share a table."""

    model: int
    intervals: int
    dt: float
    mu: float
    board: StringBoard


class OpenString(NamedTuple):
    """The open string over a board and its output, for `on_board`, which says where the string is stopped [m]."""

    length: float
    nut: float
    slope: float
    relief: float
    end: float
    tension: float  # [N]
    bending_stiffness: float  # [N m²]
    linear: int  # the stiffness law
    heard_by_force: int
    heard_at: float  # from the saddle
    aperture: float
    gain_q: float
    gain_v: float
    slide_s: float


#: what stands in the table of a board, in this order; (address) → the OpenString there, in compiled code
BOARD_PARTS = (Board, BoardRoom, OpenString)
open_string = opener(OpenString, words(Board) + words(BoardRoom))


class Boards:
    """Every Board of an engine. As long as it plays, this must stay where it is.

    items    Board
    rooms    BoardRoom of each
    models   numbers of the models over each
    """

    def __init__(self, bank: Bank, laid: Sequence[LaidBoard]) -> None:
        self.items: list[Board] = []
        self.rooms: list[BoardRoom] = []
        self.tables: list[np.ndarray] = []
        self.models: list[list[int]] = []
        found: dict[tuple[int, int], int] = {}
        tables: dict[int, dict[str, np.ndarray]] = {}
        for each in laid:
            key = int(bank.models["string"][each.model]), each.intervals
            if key not in found:
                found[key] = len(self.items)
                if each.intervals not in tables:
                    tables[each.intervals] = board_tables(each.intervals)
                board, room, over = _parts(each, tables[each.intervals])
                self.items.append(board)
                self.rooms.append(room)
                self.tables.append(table(board, room, over))
                self.models.append([])
            self.models[found[key]].append(each.model)

    def point(self, shared: Shared) -> None:
        """Put the addresses where the core looks for them."""
        for mine, at in zip(self.models, self.tables, strict=True):
            shared.board_at[mine] = at.ctypes.data

    def arrays(self) -> dict[str, np.ndarray]:
        """All that changes, by name."""
        out = {}
        for number, each in enumerate(self.items):
            for name, value in each._asdict().items():
                if isinstance(value, np.ndarray) and name not in CONSTANT:
                    out[f"board.{number}.{name}"] = value
        return out


def _parts(laid: LaidBoard, tables: dict[str, np.ndarray]) -> tuple[Board, BoardRoom, OpenString]:
    board, sizes = laid.board, board_sizes(laid.intervals)
    kappa = spring_rate(board.fingerboard.stiffness_n_m2, laid.mu, laid.dt)
    over = OpenString(
        board.length_m, *board.fingerboard.profile, board.tension_n, board.bending_stiffness_n_m2, int(board.linear),
        int(board.heard == BY_FORCE), board.distance_m, board.aperture_m, *board.gains, board.slide_s,
    )  # fmt: skip
    made = allocate(Board, sizes, **tables, kappa=kappa, restitution=board.fingerboard.restitution)
    return made, allocate(BoardRoom, sizes), over
