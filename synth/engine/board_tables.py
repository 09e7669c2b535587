"""Boards of an engine: a table for every length of the modal grid that a string has over its board, and where the core finds
it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from synth.engine.layout import Bank, Shared
from synth.instrument.boards import BY_FORCE, StringBoard
from synth.native.arrays import allocate
from synth.native.views import table
from synth.solver.board_table import CONSTANT, ROOM, Board, board_sizes, board_tables
from synth.solver.wall import spring_rate


class LaidBoard(NamedTuple):
    """What lies under a model: of the same string, models of as many intervals share a table."""

    model: int
    intervals: int
    dt: float
    mu: float
    board: StringBoard


class Boards:
    """Every Board of an engine. As long as it plays, this must stay where it is.

    items    Board
    models   numbers of the models over each
    """

    def __init__(self, bank: Bank, laid: Sequence[LaidBoard]) -> None:
        self.items: list[Board] = []
        self.models: list[list[int]] = []
        found: dict[tuple[int, int], int] = {}
        tables: dict[int, dict[str, np.ndarray]] = {}
        for each in laid:
            key = int(bank.models["string"][each.model]), each.intervals
            if key not in found:
                found[key] = len(self.items)
                if each.intervals not in tables:
                    tables[each.intervals] = board_tables(each.intervals)
                self.items.append(_board(each, tables[each.intervals]))
                self.models.append([])
            self.models[found[key]].append(each.model)
        self.tables = [table(each) for each in self.items]

    def point(self, shared: Shared) -> None:
        """Put the addresses where the core looks for them."""
        for mine, at in zip(self.models, self.tables, strict=True):
            shared.board_at[mine] = at.ctypes.data

    def arrays(self) -> dict[str, np.ndarray]:
        """All that changes, by name."""
        out = {}
        for number, each in enumerate(self.items):
            for name, value in each._asdict().items():
                if isinstance(value, np.ndarray) and name not in CONSTANT + ROOM:
                    out[f"board.{number}.{name}"] = value
        return out


def _board(laid: LaidBoard, tables: dict[str, np.ndarray]) -> Board:
    board = laid.board
    nut, slope, relief, end = board.fingerboard.profile
    return allocate(
        Board,
        board_sizes(laid.intervals),
        **tables,
        intervals=laid.intervals,
        kappa=spring_rate(board.fingerboard.stiffness_n_m2, laid.mu, laid.dt),
        restitution=board.fingerboard.restitution,
        length=board.length_m,
        nut=nut,
        slope=slope,
        relief=relief,
        end=end,
        tension=board.tension_n,
        bending_stiffness=board.bending_stiffness_n_m2,
        linear=int(board.linear),
        heard_by_force=int(board.heard == BY_FORCE),
        heard_at=board.distance_m,
        aperture=board.aperture_m,
        gain_q=board.gains[0],
        gain_v=board.gains[1],
        slide_s=board.slide_s,
    )
