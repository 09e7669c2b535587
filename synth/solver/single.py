"""Modes in float32: twice as many in a vector, half as much to read.

Only a mode's displacement and velocity, and what they are multiplied with in a block of steps, are float32; forces, the
contact problem and outputs stay float64, as does the state between calls, which then holds numbers of float32. A call for
some blocks takes the modes over, and gives them back.

Rounded to float32, Φ^K keeps a mode's frequency (p12 and p21 are exact to a part ε = 2⁻²⁴) but not its losses: the
determinant is off by some ε, the decay rate by ε/(KΔt). Rows therefore hold Φ^K − 1, which is added to the state: frequency
and loss are right to a part ε, and what is left is the rounding of the state itself, once a block.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numba import float32, float64, int64, njit

from synth.jit.entries import kernel
from synth.native.arrays import f4, f8
from synth.solver.block_rows import ADV11, ADV22, BLOCK, ROWS
from synth.solver.lanes import padded_single
from synth.solver.vectors import INNER

#: half the distance from 1 to the next number of float32
ROUNDING = 2.0**-24
#: what a mode loses in a block of steps, σ K Δt, is at least so much: beside it what rounding may give is nothing
_LEAST_LOSS = 16.0 * ROUNDING


class SingleTables(NamedTuple):
    """Rows, shapes of contacts and weights of outputs of a string's model in float32; singles: padded_single(N), or 0 where
    none are. Rows of none are made in each call."""

    on: int  # whether blocks of steps hold the modes in float32
    rows: Annotated[np.ndarray, f4("ROWS, singles")]
    shapes: Annotated[np.ndarray, f4("contacts, singles")]
    weights: Annotated[np.ndarray, f4("outputs, singles")]


class SingleRoom(NamedTuple):
    """Modes of a string during a call; rows, where its model has none of its own."""

    rows: Annotated[np.ndarray, f4("ROWS*singles")]
    q: Annotated[np.ndarray, f4("singles")]
    v: Annotated[np.ndarray, f4("singles")]


class SingleLine(NamedTuple):
    """Modes of a line on a moving bridge, and how they fly and meet its end."""

    of: Annotated[np.ndarray, f8("5")]  # numbers of the flight that the others are of
    flight: Annotated[np.ndarray, f4("ROWS, singles")]
    kick: Annotated[np.ndarray, f4("singles")]
    pull: Annotated[np.ndarray, f4("singles")]
    q: Annotated[np.ndarray, f4("singles")]
    v: Annotated[np.ndarray, f4("singles")]


def keeps_losses(sigma: np.ndarray, dt: float) -> bool:
    """Whether modes that decay with σ (N,) [1/s] may be float32 in steps of dt [s]: none would gain what it is to lose."""
    return bool(np.all(sigma * BLOCK * dt >= _LEAST_LOSS))


@kernel(float64[:, ::1], int64, int64, float32[:, ::1])
def fill_single_rows(rows, first: int, modes: int, singles) -> None:
    """singles (ROWS, ≥padded_single(modes)) float32 of columns first … modes of rows (ROWS, ≥modes): as `lanes` takes them,
    zero behind those."""
    for r in range(ROWS):
        less = 1.0 if r == ADV11 or r == ADV22 else 0.0
        row, single = rows[r, first:modes], singles[r, first:modes]
        for j in range(row.size):
            single[j] = row[j] - less
        singles[r, modes : padded_single(modes)] = 0.0


@njit(**INNER)
def round_into(x, count: int, out) -> None:
    """out (m,) float32: the first `count` numbers of x (≥ count,), zero behind them."""
    for j in range(count):
        out[j] = x[j]
    for j in range(count, out.size):
        out[j] = 0.0


@njit(**INNER)
def take(q, v, count: int, single_q, single_v) -> None:
    """The first `count` modes (N,) as float32, zero behind them."""
    round_into(q, count, single_q)
    round_into(v, count, single_v)


@njit(**INNER)
def give_back(single_q, single_v, count: int, q, v) -> None:
    """The state as it is now."""
    for j in range(count):
        q[j] = single_q[j]
        v[j] = single_v[j]
