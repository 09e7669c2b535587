"""The table of the board under a string, and what other kernels ask of it: `board` is the kernel that plays on it."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numba import njit

from synth.native.arrays import aligned, f8, i8, u1
from synth.native.views import opener, words
from synth.solver.block_rows import BLOCK
from synth.solver.certificates import MARGIN
from synth.solver.lanes import padded
from synth.solver.sine import make_sine

#: nodes that are followed through a block; of more, all are looked at in every step
MOST_FOLLOWED = 16
#: of fewer nodes that are struck at once each moves the modes by itself; more do by a transform
MOST_STRUCK = 16
#: height of nodes beyond the end of the board [m]
NO_BOARD_M = -1e3
#: places in Board.numbers: speaking length [m]
SPEAKING = 0
N_NUMBERS = 1
#: places in Board.counts: nodes under the surface; steps with an impulse and blocks that went step by step, since the start
HOLDING, STRUCK, STEPPED = range(3)
N_COUNTS = 3
#: rows of Board.slack
BY_Q, BY_V, BY_PUSH = range(3)
N_SLACK = 3


class Board(NamedTuple):
    """What a string has of the board under it. N = intervals − 1 modes and nodes, n = padded(N)."""

    kappa: float  # stiffness of a node's spring over its mass, softened for the step (`wall.spring_rate`) [1/s²]
    restitution: float
    # the same for all strings of so many modes
    half: Annotated[np.ndarray, f8("intervals")]  # of `sine.Sine`, this and the next
    twiddles: Annotated[np.ndarray, f8("6, quarter")]
    matrix: Annotated[np.ndarray, f8("dense, dense")]
    shapes: Annotated[np.ndarray, f8("modes, padded")]  # sin(πij/n) of node i, zeros behind
    # what follows from where the string is stopped, bent and damped
    numbers: Annotated[np.ndarray, f8("N_NUMBERS")]
    eta: Annotated[np.ndarray, f8("modes")]  # height of each node below the line at rest, negative [m]
    weights: Annotated[np.ndarray, f8("2, padded")]  # of the outputs, on q and on v
    slack: Annotated[np.ndarray, f8("N_SLACK, padded")]  # factors of |q|, |v| and Σ|p − p̄| |w| in d_j
    # what goes on from step to step
    touching: Annotated[np.ndarray, u1("modes")]
    account: Annotated[np.ndarray, f8("modes")]  # energy taken from the string, over μΔx [m²/s²]
    counts: Annotated[np.ndarray, i8("N_COUNTS")]


class BoardRoom(NamedTuple):
    """What the kernels of a Board work with: nothing of it goes from call to call."""

    nodes: Annotated[np.ndarray, f8("5, modes")]
    work: Annotated[np.ndarray, f8("4, intervals")]
    before: Annotated[np.ndarray, f8("2, padded")]
    pushed: Annotated[np.ndarray, f8("2, padded")]  # state after a step in which a finger has pushed with 1 N
    response: Annotated[np.ndarray, f8("2*BLOCK + 1")]  # displacement of a node by it, at K + l l steps later
    followed: Annotated[np.ndarray, i8("MOST_FOLLOWED")]
    struck: Annotated[np.ndarray, i8("MOST_STRUCK")]
    row: Annotated[np.ndarray, f8("BLOCK")]


#: (address) → the Board that is there, the BoardRoom behind it, in compiled code
board_at, room_of = opener(Board), opener(BoardRoom, words(Board))

#: what is constant; the other arrays are state
CONSTANT = ("half", "twiddles", "matrix", "shapes")


def board_sizes(intervals: int) -> dict[str, int]:
    """Extents of a Board. Raises ValueError for fewer than 2 intervals."""
    tables = make_sine(intervals)
    return {
        "intervals": intervals,
        "modes": intervals - 1,
        "padded": padded(intervals - 1),
        "quarter": tables.twiddles.shape[1],
        "dense": tables.matrix.shape[0],
        "N_NUMBERS": N_NUMBERS,
        "N_SLACK": N_SLACK,
        "N_COUNTS": N_COUNTS,
        "MOST_FOLLOWED": MOST_FOLLOWED,
        "MOST_STRUCK": MOST_STRUCK,
        "BLOCK": BLOCK,
    }


def board_tables(intervals: int) -> dict[str, np.ndarray]:
    """The constant arrays of a Board."""
    tables = make_sine(intervals)
    inner = np.arange(1, intervals)
    shapes = aligned((intervals - 1, padded(intervals - 1)))
    shapes[:, : intervals - 1] = np.sin(np.pi / intervals * (np.outer(inner, inner) % (2 * intervals)))
    given = {"half": tables.half, "twiddles": tables.twiddles, "matrix": tables.matrix}
    return {name: _copy(array) for name, array in given.items()} | {"shapes": shapes}


def _copy(array: np.ndarray) -> np.ndarray:
    out = aligned(array.shape)
    out[...] = array
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def fill_slack(board: int, omega, sigma, mu: float, dt: float) -> None:
    """Board.slack for modes ω, σ (N,)."""
    b = board_at(board)
    tau = BLOCK * dt
    for j in range(omega.size):
        turn = omega[j] * tau
        bent = min(2.0, (1.0 + 2.0 * sigma[j] / omega[j]) * turn * turn / 8.0)
        b.slack[BY_Q, j] = bent
        b.slack[BY_V, j] = bent / omega[j]
        b.slack[BY_PUSH, j] = 2.0 * dt / mu * min(tau, 1.0 / omega[j])


@njit(cache=True, nogil=True)
def clear_of_board(board: int, amplitude) -> bool:
    """Whether modes whose amplitudes stay below `amplitude` (≤ N,) never reach the board."""
    b = board_at(board)
    everywhere, slope = 0.0, 0.0
    for j in range(amplitude.size):
        everywhere += amplitude[j]
        slope += (j + 1.0) * amplitude[j]
    scale = MARGIN * math.sqrt(2.0 / b.numbers[SPEAKING])
    for c in range(b.eta.size):
        if scale * min(everywhere, b.half[c + 1] * slope) >= -b.eta[c]:
            return False
    return True


@njit(cache=True, nogil=True)
def clear_by_energy(board: int, energy: float) -> bool:
    """Whether a string of so much energy never reaches the board; energy: twice that over the tension [m]."""
    b = board_at(board)
    for c in range(b.eta.size):
        share = (c + 1.0) / b.half.size
        if b.eta[c] >= 0.0 or energy * b.numbers[SPEAKING] * share * (1.0 - share) >= 0.99 * b.eta[c] ** 2:
            return False
    return True


@njit(cache=True, nogil=True)
def leave_board(board: int) -> None:
    """Nothing touches: what the nodes had taken is lost."""
    b = board_at(board)
    b.touching[:] = 0
    b.account[:] = 0.0
    b.counts[HOLDING] = 0
