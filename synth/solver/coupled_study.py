"""What a run of coupled strings with rows and an energy ledger works on, for `coupled_advance` and `coupled_ledger`."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np

from synth.native.arrays import f8, i8
from synth.native.views import opener, words

#: frames of a call, at most
CHUNK = 64
#: by how much an obstacle that is not yet in its place rises in a frame, at most [m]
RISE_A_FRAME = 1e-5

#: columns of StudyRows.energy [J]. Stored: in the strings' modes, in strings drawn straight between their ends, in the
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

#: places in StudyRows.sums: H at the start; largest rise of a frame, most negative loss of a frame by strings, by
#: contacts, by the body, each over the energy there was to have; what the ledger leaves over, likewise; deepest penetration
INITIAL, RISE, LEAST_STRINGS, LEAST_CONTACT, LEAST_BODY, BALANCE, PENETRATION, MOST_BALANCE = range(8)
N_SUMS = 8
#: places in StudyRows.counts: frames so far; row to write; frames since the row before; frame of the last contact; frames
#: with a contact force; frames that were not solved
STEPS, ROW, PHASE, LAST_CONTACT, CONTACT_FRAMES, UNSOLVED = range(6)
N_COUNTS = 6


class CoupledStudy(NamedTuple):
    """A run of coupled lines: obstacles and fingers over a call, what is looked at, what is stored and summed."""

    coupling: int  # addresses
    scratch: int
    every: int  # frames from row to row
    first: Annotated[np.ndarray, i8("lines + 1")]  # number of each line's first contact, and of all
    eta: Annotated[np.ndarray, f8("contacts")]  # where each obstacle is for the string [m]
    rising: Annotated[np.ndarray, i8("contacts")]  # whether it is not yet in its place
    target: Annotated[np.ndarray, f8("CHUNK, contacts")]  # where it belongs at the end of each frame of the call
    path: Annotated[np.ndarray, f8("lines, PATH")]  # of fingers [m], at the start of the call and after each step of a line
    out_line: Annotated[np.ndarray, i8("points")]
    out_shape: Annotated[np.ndarray, f8("points, modes")]
    out_leverage: Annotated[np.ndarray, f8("points")]  # of b …
    out_far: Annotated[np.ndarray, f8("points")]  # … and of a
    now: Annotated[np.ndarray, f8("N_ENERGIES")]
    mean_force: Annotated[np.ndarray, f8("contacts")]  # Σ over frames since the row
    mean_bridge: Annotated[np.ndarray, f8("components")]
    out: Annotated[np.ndarray, f8("channels, 1")]


class FarEnds(NamedTuple):
    """The ends of lines at x = 0."""

    moments: Annotated[np.ndarray, f8("lines, modes")]  # d
    height: Annotated[np.ndarray, f8("lines")]  # a [m]
    speed: Annotated[np.ndarray, f8("lines")]  # [m/s]
    path: Annotated[np.ndarray, f8("CHUNK, lines")]  # a at the end of each frame of a call
    leverage: Annotated[np.ndarray, f8("contacts")]  # 1 − x/L
    finger: Annotated[np.ndarray, f8("lines")]  # the same of the finger


class StudyRows(NamedTuple):
    """What a run gives: rows, sums and counts."""

    u: Annotated[np.ndarray, f8("rows, points")]
    u_contact: Annotated[np.ndarray, f8("rows, contacts")]
    contact_force: Annotated[np.ndarray, f8("rows, contacts")]
    bridge: Annotated[np.ndarray, f8("rows, axes")]
    bridge_force: Annotated[np.ndarray, f8("rows, axes")]
    radiated: Annotated[np.ndarray, f8("rows, channels")]
    energy: Annotated[np.ndarray, f8("weighed, N_ENERGIES")]  # of no rows: frames are not weighed
    sums: Annotated[np.ndarray, f8("N_SUMS")]
    counts: Annotated[np.ndarray, i8("N_COUNTS")]


class FrameBefore(NamedTuple):
    """What a frame began from, and the forces of a step and the displacements before it."""

    q: Annotated[np.ndarray, f8("lines, modes")]
    v: Annotated[np.ndarray, f8("lines, modes")]
    force: Annotated[np.ndarray, f8("contacts")]
    eta: Annotated[np.ndarray, f8("contacts")]  # heights as the kernels have them
    far: Annotated[np.ndarray, f8("lines")]
    body: Annotated[np.ndarray, f8("2, body")]
    speed: Annotated[np.ndarray, f8("components")]
    beta: Annotated[np.ndarray, f8("components")]
    rest: Annotated[np.ndarray, f8("components")]
    acting: Annotated[np.ndarray, f8("contacts")]
    way: Annotated[np.ndarray, f8("contacts")]


#: what stands in the table of a study, in this order; (address) → the one that is there, in compiled code
STUDY_PARTS: tuple[Any, ...] = (CoupledStudy, FarEnds, StudyRows, FrameBefore)
coupled_study, far_ends, study_rows, frame_before = (
    opener(kind, sum(map(words, STUDY_PARTS[:before]))) for before, kind in enumerate(STUDY_PARTS)
)


def far_moments(length_m: float, n: int) -> np.ndarray:
    """d (n,) [√m]: ∫ φ_j (1 − x/L) dx = √(2L)/(jπ)."""
    return math.sqrt(2.0 * length_m) / (math.pi * np.arange(1, n + 1))
