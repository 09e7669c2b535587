"""Flat arrays that the native core works on: a Bank that never changes, a State that does.

Offsets: modes of a model or string begin at `off`; its contact rows at `coff`, contact matrices at `goff`, mode shapes
(C × N) at `soff`, coefficient rows (6 × N) at 6·off.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

#: an inner function of the core: without the wrappers for callers outside compiled code, which take half a second each
CORE: dict[str, Any] = {"cache": True, "nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

#: frames that are computed at a time, counted from the start of the stream; every decision that works on chunks of
#: steps is taken at their borders, so that the host's block size changes no bit
QUANTUM = 32
#: certificates, pruning, sleep and levels are looked at every so many quanta
CHECK_EVERY = 4
RING = 256

MODEL = np.dtype(
    [
        ("n", "i8"),
        ("own", "i8"),  # the string's own modes, the first; the others are lumped
        ("contacts", "i8"),
        ("off", "i8"),
        ("soff", "i8"),
        ("coff", "i8"),
        ("goff", "i8"),
        ("length", "f8"),
        ("tension", "f8"),
        ("mu", "f8"),
        ("rest_height", "f8"),  # of the fret, below the open string's line
        ("line_output", "f8"),  # output of the rest line
        ("rest_output", "f8"),  # output of the static state, line included
        ("output_bound", "f8"),  # |output| ≤ bound · √Σ(v² + ω²q²)
        ("static_response", "f8"),  # displacement of the first contact under 1 N, at rest
        ("lift_output", "f8"),  # output of the state at rest under 1 N at the first contact
    ],
    align=True,
)

STRING = np.dtype(
    [
        ("part", "i8"),
        ("bus", "i8"),
        ("factor", "i8"),
        ("cap", "i8"),
        ("off", "i8"),
        ("coff", "i8"),
        ("cmax", "i8"),
        ("goff", "i8"),
        ("positions", "i8"),  # how many; more than one: a neck
        ("open_length", "f8"),
        ("pluck_force", "f8"),
        ("impedance", "f8"),
        ("draw_s", "f8"),
        ("release_s", "f8"),
    ],
    align=True,
)

POSITION = np.dtype([("part", "i8"), ("string", "i8"), ("note", "i8"), ("fret", "i8"), ("model", "i8")], align=True)

#: live parameters of a part, in this order
GAIN, PLUCK_POSITION, PLUCK_AMOUNT, PLUCK_WIDTH, RELEASE, HEIGHT = range(6)
N_PARAMETERS = 6
#: smallest and largest value of each; events beyond are brought back inside
PARAMETER_RANGES = ((0.0, 4.0), (0.02, 0.5), (0.0, 2.0), (0.5, 50.0), (0.1, 20.0), (-200.0, 50.0))

PART = np.dtype(
    [
        ("channel", "i8"),
        ("first_position", "i8"),
        ("end_position", "i8"),
        ("first_bus", "i8"),
        ("end_bus", "i8"),
        ("ring_on", "i8"),
        ("use_q", "i8"),
        ("use_v", "i8"),
        ("pickup_distance", "f8"),
        ("velocity_exponent", "f8"),
        ("position_hard", "f8"),  # minus position at velocity 0
        ("width_hard", "f8"),  # factor on the width at velocity 127
        ("finger_stiffness", "f8"),
        ("finger_loss", "f8"),
        ("direct", "f8"),
        ("body_off", "i8"),
        ("body_n", "i8"),
    ],
    align=True,
)

BUS = np.dtype([("part", "i8"), ("factor", "i8"), ("taps", "i8"), ("n_taps", "i8"), ("off", "i8")], align=True)


class Bank(NamedTuple):
    """Constant: every playable position of every part, and the filters."""

    models: np.ndarray
    strings: np.ndarray
    positions: np.ndarray
    parts: np.ndarray
    buses: np.ndarray
    program_map: np.ndarray  # (16, 128) part or −1
    omega: np.ndarray
    sigma: np.ndarray
    coef: np.ndarray
    shapes: np.ndarray
    eta: np.ndarray
    residual: np.ndarray
    matrix: np.ndarray
    wq: np.ndarray
    wv: np.ndarray
    q_rest: np.ndarray
    taps: np.ndarray
    body: np.ndarray  # (3, resonances of all parts)


class Settings(NamedTuple):
    """Constant for one stream."""

    law: int
    restitution: float
    rate_hz: float
    limiter: int
    ceiling: float
    limiter_release: float
    gain: float
    polyphony: int
    smoothing: float  # share of the way per frame, gain and pan
    dc: float  # pole of the high-pass
    economy: int  # 0: no certificate, pruning or culling


#: finger phases
NO_FINGER, PRESS, DRAW = range(3)

SOUNDING = np.dtype(
    [
        ("awake", "i8"),
        ("model", "i8"),
        ("n", "i8"),
        ("free", "i8"),
        ("note", "i8"),
        ("channel", "i8"),
        ("held", "i8"),
        ("sustained", "i8"),
        ("stolen", "i8"),
        ("stale", "i8"),  # 1: coefficients, 2: the finger's coupling to be worked out before the next step
        ("plucked_at", "i8"),
        ("phase", "i8"),
        ("finger_step", "i8"),
        ("finger_steps", "i8"),
        ("pending_model", "i8"),
        ("hand", "f8"),  # extra σ of the damping hand
        ("bend", "f8"),  # semitones in the coefficients
        ("height", "f8"),  # obstacle raised by [m]
        ("lift", "f8"),  # force of the one contact on the string at rest [N]
        ("rest", "f8"),  # output at rest, line included
        ("base", "f8"),  # output counted as zero; follows `rest`
        ("level", "f8"),
        ("finger_from", "f8"),
        ("finger_to", "f8"),
        ("finger_own", "f8"),
        ("finger_k", "f8"),
        ("finger_r", "f8"),
        ("pending_velocity", "f8"),
    ],
    align=True,
)

CHANNEL = np.dtype(
    [
        ("program", "i8"),
        ("volume", "f8"),
        ("expression", "f8"),
        ("pan", "f8"),
        ("sustain", "i8"),
        ("legato", "i8"),
        ("rpn", "i8"),
        ("bend_raw", "f8"),  # −1 … 1
        ("bend_range", "f8"),
        ("bend", "f8"),  # smoothed, semitones
    ],
    align=True,
)

PART_STATE = np.dtype(
    [("left", "f8"), ("right", "f8"), ("dc_in", "f8"), ("dc_out", "f8"), ("hand", "f8"), ("height", "f8")],
    align=True,
)

#: places in `counters`
(
    NOW,
    PRODUCED,
    PENDING,
    N_NOTES,
    N_STOLEN,
    N_DROPPED,
    MOST_AWAKE,
    AWAKE,
    WORK,
    FAILED_LCP,
    N_TAKEN,
) = range(11)
N_COUNTERS = 11


class State(NamedTuple):
    """Everything that changes while sounding."""

    sounding: np.ndarray
    channels: np.ndarray
    part_state: np.ndarray
    parameters: np.ndarray  # (parts, N_PARAMETERS)
    q: np.ndarray
    v: np.ndarray
    coef: np.ndarray
    matrix: np.ndarray
    eta: np.ndarray
    u: np.ndarray
    vc: np.ndarray
    force: np.ndarray
    watch: np.ndarray
    finger_weights: np.ndarray
    finger_coupling: np.ndarray
    finger_state: np.ndarray  # (strings, 2)
    pending: np.ndarray  # EVENT
    unplayed: np.ndarray  # (parts + 1, 128); last row: channels without a part
    counters: np.ndarray
    meters: np.ndarray  # peak
    history: np.ndarray
    carry: np.ndarray  # (buses,) last step of a quantum, which sounds in the next
    body: np.ndarray
    ring: np.ndarray  # (RING, 2)
    stems: np.ndarray  # (parts, RING, 2)
    delay: np.ndarray
    required: np.ndarray
    released: np.ndarray
    limiter_counters: np.ndarray
    limiter_levels: np.ndarray


class Scratch(NamedTuple):
    """Work arrays of one thread; they carry nothing from call to call."""

    bus: np.ndarray  # (buses, QUANTUM · factor + 1)
    decimator: np.ndarray
    mono: np.ndarray  # (QUANTUM,)
    frame: np.ndarray  # (QUANTUM,)
    mix: np.ndarray  # (QUANTUM, 2)
    path: np.ndarray
    out_q: np.ndarray  # (steps, 1)
    out_v: np.ndarray  # (steps, 1)
    omega: np.ndarray
    sigma: np.ndarray
    amplitude: np.ndarray
    q: np.ndarray
    v: np.ndarray
    record: np.ndarray  # (0, 0)
    y: np.ndarray
    b: np.ndarray
    z: np.ndarray
    a: np.ndarray
    factor: np.ndarray
    order: np.ndarray
    enabled: np.ndarray
    active: np.ndarray
    near: np.ndarray
