"""What a run of coupled strings with rows and an energy ledger works on, for `coupled_advance` and `coupled_ledger`."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from synth.native.arrays import f8, i8
from synth.native.views import opener

#: frames of a call, at most
CHUNK = 64
#: by how much an obstacle that is not yet in its place rises in a frame, at most [m]
RISE_A_FRAME = 1e-5

#: columns of CoupledStudy.energy [J]. Stored: in the strings' modes, in strings drawn straight between their ends, in the
#: residual compliance, in the modes left out, in the body; lost so far: by strings, modes left out, body, contacts, at
#: changes of a string's length; work so far: of fingers, moving obstacles, far ends, bends
ENERGIES = (
    "strings", "springs", "residual", "left_out", "body",
    "lost_strings", "lost_left_out", "lost_body", "lost_contact", "lost_fret",
    "work_finger", "work_obstacle", "work_fret", "work_bend",
)  # fmt: skip
STRINGS, SPRINGS, RESIDUAL, LEFT_OUT, BODY = range(5)
LOST_STRINGS, LOST_LEFT_OUT, LOST_BODY, LOST_CONTACT, LOST_FRET = range(5, 10)
WORK_FINGER, WORK_OBSTACLE, WORK_FRET, WORK_BEND = range(10, 14)
N_ENERGIES = 14
N_STORED, N_LOST = 5, 5

#: places in CoupledStudy.sums: H at the start; largest rise of a frame, most negative loss of a frame by strings, by
#: contacts, by the body, each over the energy there was to have; what the ledger leaves over, likewise; deepest penetration
INITIAL, RISE, LEAST_STRINGS, LEAST_CONTACT, LEAST_BODY, BALANCE, PENETRATION, MOST_BALANCE = range(8)
N_SUMS = 8
#: places in CoupledStudy.counts: frames so far; row to write; frames since the row before; frame of the last contact; frames
#: with a contact force; frames that were not solved
STEPS, ROW, PHASE, LAST_CONTACT, CONTACT_FRAMES, UNSOLVED = range(6)
N_COUNTS = 6


class CoupledStudy(NamedTuple):
    """A run of coupled lines: what moves them from outside over a call, what is looked at, rows and sums."""

    coupling: int  # addresses
    scratch: int
    ledger: int  # whether frames are weighed
    every: int  # frames from row to row
    first: Annotated[np.ndarray, i8("lines + 1")]  # number of each line's first contact, and of all
    far_moments: Annotated[np.ndarray, f8("lines, modes")]  # d
    far: Annotated[np.ndarray, f8("lines")]  # a [m]
    far_speed: Annotated[np.ndarray, f8("lines")]  # [m/s]
    far_leverage: Annotated[np.ndarray, f8("contacts")]  # 1 − x/L
    finger_far: Annotated[np.ndarray, f8("lines")]  # the same of the finger
    eta: Annotated[np.ndarray, f8("contacts")]  # where each obstacle is for the string [m]
    rising: Annotated[np.ndarray, i8("contacts")]  # whether it is not yet in its place
    target: Annotated[np.ndarray, f8("CHUNK, contacts")]  # where it belongs at the end of each frame of the call
    far_path: Annotated[np.ndarray, f8("CHUNK, lines")]  # a at the end of each frame
    path: Annotated[np.ndarray, f8("lines, PATH")]  # of fingers [m], at the start of the call and after each step of a line
    # rows
    out_line: Annotated[np.ndarray, i8("points")]
    out_shape: Annotated[np.ndarray, f8("points, modes")]
    out_leverage: Annotated[np.ndarray, f8("points")]  # of b …
    out_far: Annotated[np.ndarray, f8("points")]  # … and of a
    u: Annotated[np.ndarray, f8("rows, points")]
    u_contact: Annotated[np.ndarray, f8("rows, contacts")]
    contact_force: Annotated[np.ndarray, f8("rows, contacts")]
    bridge: Annotated[np.ndarray, f8("rows, axes")]
    bridge_force: Annotated[np.ndarray, f8("rows, axes")]
    radiated: Annotated[np.ndarray, f8("rows, channels")]
    energy: Annotated[np.ndarray, f8("weighed, N_ENERGIES")]
    # state of ledger and rows
    now: Annotated[np.ndarray, f8("N_ENERGIES")]
    sums: Annotated[np.ndarray, f8("N_SUMS")]
    counts: Annotated[np.ndarray, i8("N_COUNTS")]
    mean_force: Annotated[np.ndarray, f8("contacts")]  # Σ over frames since the row
    mean_bridge: Annotated[np.ndarray, f8("components")]
    # room
    kept_q: Annotated[np.ndarray, f8("lines, modes")]
    kept_v: Annotated[np.ndarray, f8("lines, modes")]
    kept_force: Annotated[np.ndarray, f8("contacts")]
    kept_eta: Annotated[np.ndarray, f8("contacts")]  # heights as the kernels have them, before the frame
    kept_far: Annotated[np.ndarray, f8("lines")]
    kept_body: Annotated[np.ndarray, f8("2, body")]
    kept_speed: Annotated[np.ndarray, f8("components")]
    kept_beta: Annotated[np.ndarray, f8("components")]
    kept_rest: Annotated[np.ndarray, f8("components")]
    force: Annotated[np.ndarray, f8("contacts")]
    way: Annotated[np.ndarray, f8("contacts + 1")]
    out: Annotated[np.ndarray, f8("channels, 1")]


coupled_study = opener(CoupledStudy)


def far_moments(length_m: float, n: int) -> np.ndarray:
    """d (n,) [√m]: ∫ φ_j (1 − x/L) dx = √(2L)/(jπ)."""
    return math.sqrt(2.0 * length_m) / (math.pi * np.arange(1, n + 1))
