"""Flat arrays that the native core works on: a Bank that never changes, a State that does.

Modes are padded with zeros to whole vectors (`lanes`): a model of n modes takes `cap`. Offsets: modes of a model or string
begin at `off`, the two rows of output weights at 2·off, coefficient rows (`lanes.ROWS`) at ROWS·off; contact rows at `coff`,
contact matrices at `goff`, responses over a block's steps at RESPONSE·goff (contacts) and 2·RESPONSE·coff (outputs); mode
shapes (C × cap) at `soff`.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple, get_type_hints

import numpy as np

from synth.engine.events import EVENT
from synth.engine.events import N_PARAMETERS as N_PARAMETERS
from synth.solver.lanes import BLOCK

#: an inner function of the core: without the wrappers for callers outside compiled code, which take half a second each
CORE: dict[str, Any] = {"cache": True, "nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True}

#: frames that are computed at a time, counted from the start of the stream; every decision that works on chunks of
#: steps is taken at their borders, so that the host's block size changes no bit
QUANTUM = 32
#: certificates, pruning, sleep and levels are looked at every so many quanta
CHECK_EVERY = 4
#: quanta without an event inside that are worked off in one go, at most; a power of two
SPAN = 8
#: …and internal steps, so that the outputs of a string stay in the cache
SPAN_STEPS = 2048
#: frames of output kept: a span, what is left of the quantum before it, the limiter's look-ahead
RING = 512
#: arrays are laid out on cache lines of so many bytes, so many f8
LINE = 64
LINE_F8 = 8
#: length of a response to a force during a block
RESPONSE = 2 * BLOCK
#: frames over which a string changes between its internal rate and free flight at the output rate; a multiple of QUANTUM
FADE = 64

#: linear output of a string or a part from which on it is no sound any more but a computation that has blown up (240 dB
#: above full scale; presets may ask for 200 dB)
BLOWN_UP = 1e12

#: kinds of arrays: element type and number of dimensions
F8 = Annotated[np.ndarray, np.dtype(np.float64), 1]
F8x2 = Annotated[np.ndarray, np.dtype(np.float64), 2]
F8x3 = Annotated[np.ndarray, np.dtype(np.float64), 3]
I8 = Annotated[np.ndarray, np.dtype(np.int64), 1]
I8x2 = Annotated[np.ndarray, np.dtype(np.int64), 2]
U1 = Annotated[np.ndarray, np.dtype(np.uint8), 1]

MODEL = np.dtype(
    [
        ("n", "i8"),
        ("own", "i8"),  # the string's own modes, the first; the others are lumped
        ("contacts", "i8"),
        ("audible", "i8"),  # its own modes that the decimator does not stop
        ("cap", "i8"),
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
        ("row", "i8"),  # where its outputs of a span begin
        ("direct_bus", "i8"),  # of the output rate; −1: that is its own rate
        ("direct", "i8"),  # where its outputs of a span at the output rate begin
        ("fade", "i8"),  # where what still fades begins
        ("pressure_height", "f8"),  # obstacle raised by full pressure [m]
    ],
    align=True,
)

POSITION = np.dtype([("part", "i8"), ("string", "i8"), ("note", "i8"), ("fret", "i8"), ("model", "i8")], align=True)

#: live parameters of a part, in this order (N_PARAMETERS)
GAIN, PLUCK_POSITION, PLUCK_AMOUNT, PLUCK_WIDTH, RELEASE, HEIGHT = range(6)
#: smallest and largest value of each; events beyond are brought back inside
PARAMETER_RANGES = ((0.0, 4.0), (0.02, 0.5), (0.0, 2.0), (0.5, 50.0), (0.1, 20.0), (-200.0, 50.0))
#: how a controller runs through a range: evenly, evenly in ratios, or as its square (a level: the middle near unity)
LINEAR, RATIO, SQUARE = range(3)
PARAMETER_CURVES = (SQUARE, LINEAR, LINEAR, RATIO, RATIO, LINEAR)

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
        ("pressure_bend", "f8"),  # tension at full pressure [semitones]
    ],
    align=True,
)

#: a bus: the internal rate of some strings of a part. Its line of n_taps + a span's steps begins at `off`
BUS = np.dtype([("part", "i8"), ("factor", "i8"), ("taps", "i8"), ("n_taps", "i8"), ("off", "i8")], align=True)


#: a controller that sets a live parameter of a part, at 0 to `low`, at 127 to `high`
BINDING = np.dtype(
    [("part", "i8"), ("index", "i8"), ("curve", "i8"), ("low", "f8"), ("high", "f8")],
    align=True,
)


class Bank(NamedTuple):
    """Constant: every playable position of every part, and the filters."""

    models: Annotated[np.ndarray, MODEL, 1]
    strings: Annotated[np.ndarray, STRING, 1]
    positions: Annotated[np.ndarray, POSITION, 1]
    parts: Annotated[np.ndarray, PART, 1]
    buses: Annotated[np.ndarray, BUS, 1]
    program_map: I8x2  # (16, 128) part or −1
    plays: I8x2  # (16, parts) whether a channel plays a part under any program
    pitch: F8  # (128,) of every key as compiled, in semitones
    bindings: Annotated[np.ndarray, BINDING, 1]  # by controller
    bound: I8  # (129,) where each controller's bindings begin
    omega: F8
    sigma: F8
    rows: F8
    flight: F8  # like rows, over a whole frame
    shapes: F8
    eta: F8
    residual: F8
    matrix: F8
    lags: F8
    out_lags: F8
    weights: F8  # of the outputs on q and on v
    direct_weights: F8  # the same behind the decimator
    q_rest: F8
    taps: F8  # ordered by phase
    body: F8x2  # (3, resonances of all parts)


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
    economy: int  # 0: modes do not rest, strings do not fly
    span: int  # quanta worked off in one go, at most


#: finger phases
NO_FINGER, PRESS, DRAW = range(3)

SOUNDING = np.dtype(
    [
        ("awake", "i8"),
        ("model", "i8"),
        ("n", "i8"),
        ("free", "i8"),  # nothing can be touched before new input
        ("certain", "i8"),  # the certificates hold
        ("altered", "i8"),  # hand or bend: coefficients of its own, not the model's
        ("note", "i8"),
        ("channel", "i8"),
        ("held", "i8"),  # by a key
        ("sustained", "i8"),
        ("stolen", "i8"),
        ("flying", "i8"),  # at the output rate
        ("fade_at", "i8"),  # frames that have faded, of so many
        ("fade_to", "i8"),
        ("direct_from", "i8"),  # like row_from and row_to, of its row at the output rate
        ("direct_to", "i8"),
        ("row_from", "i8"),  # steps of the span that its row holds: of a string that woke or fell asleep not all
        ("row_to", "i8"),
        ("reached", "i8"),  # frames of a quantum with events that it has gone through
        ("mode_steps", "i8"),  # work done
        ("unsolved", "i8"),  # calls in which a contact problem was not solved
        ("silenced", "i8"),  # times that its motion had blown up
        ("stale", "i8"),  # 1: coefficients, 2: the finger's coupling to be worked out before the next step
        ("plucked_at", "i8"),
        ("phase", "i8"),
        ("finger_step", "i8"),
        ("finger_steps", "i8"),
        ("pending_model", "i8"),
        ("hand", "f8"),  # extra σ of the damping hand
        ("bend", "f8"),  # semitones in the coefficients
        ("height", "f8"),  # obstacle raised by [m]
        ("retuned", "f8"),  # semitones of these by the tuning, smoothed, and where they go
        ("retune_to", "f8"),
        ("pressure", "f8"),  # 0 … 1, smoothed
        ("key_pressure", "f8"),  # of its key alone
        ("timbre", "f8"),  # of its note: −1 plucked in the middle … 1 by the bridge
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
        ("pressure", "f8"),  # 0 … 1
        ("timbre", "i8"),  # controller 74
        ("master", "i8"),  # of its MPE zone; itself outside of zones
    ],
    align=True,
)

PART_STATE = np.dtype(
    [
        ("left", "f8"),
        ("right", "f8"),
        ("dc_in", "f8"),
        ("dc_out", "f8"),
        ("hand", "f8"),
        ("height", "f8"),
        ("still", "i8"),  # nothing rings in its filters any more
        ("channel", "i8"),  # whose volume, expression and pan count: the last one to play it or to set them
        ("silenced", "i8"),  # times that its filters held what is no sound
    ],
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
    N_TAKEN,
) = range(9)
N_COUNTERS = 9

#: places in `meters`: largest output since reset; output level below which a string that no key holds is damped, 0: none is
PEAK, SPARE = range(2)
N_METERS = 2


class State(NamedTuple):
    """Everything that changes while sounding."""

    sounding: Annotated[np.ndarray, SOUNDING, 1]
    channels: Annotated[np.ndarray, CHANNEL, 1]
    part_state: Annotated[np.ndarray, PART_STATE, 1]
    parameters: F8x2  # (parts, N_PARAMETERS)
    tuning: F8  # (128,) semitones of every key above Bank.pitch
    zones: I8  # (2,) members of each MPE zone (`zones`), 0: there is none
    q: F8
    v: F8
    omega: F8  # of bent strings
    rows: F8
    matrix: F8
    lags: F8
    out_lags: F8
    eta: F8
    u: F8
    vc: F8
    force: F8
    looked: U1  # certificates of the block kernels, see `blocks.BlockWork`
    until: I8
    margin: F8
    bounds: F8x2  # (contacts, 3)
    renewed: I8
    clock: I8  # (strings,)
    moving: I8  # (strings,)
    fade: F8  # what still fades, at the internal rate
    direct_fade: F8x2  # (strings, FADE)
    finger_weights: F8
    finger_coupling: F8
    grip_contacts: F8  # responses to the finger, see `fingers.Grip`
    grip_points: F8x3  # (strings, 3, 2K) those of its own row, of the outputs on q and on v
    grip_far: F8
    finger_state: F8x2  # (strings, 2)
    pending: Annotated[np.ndarray, EVENT, 1]
    unplayed: I8x2  # (parts + 1, 128); last row: channels without a part
    counters: I8
    meters: F8
    lines: F8  # of every bus: the steps its decimator still needs, then those of a span
    quiet: I8  # (buses,) steps of nothing that the bus has seen last
    body: F8x2
    ring: F8x2  # (RING, 2)
    stems: F8x3  # (parts, RING, 2)
    delay: F8x2
    required: F8
    released: F8
    limiter_counters: I8
    limiter_levels: F8


#: what strings can be asked: to go through whole quanta; what is decided at the start of the first; a stretch within it
WHOLE, BEGIN, STRETCH = range(3)
#: places in Shared.task: one of these; number of the span's first quantum; quanta; frame of the quantum up to which a
#: stretch goes; addresses of what does it, `advance.entries`
TASK, FIRST_QUANTUM, QUANTA, UNTIL, WORK_ON, STEP = range(6)
N_TASK = 6


class Shared(NamedTuple):
    """Work arrays of one span that all threads see; they carry no sound from span to span."""

    task: I8  # what is asked of the strings, see above
    queue: I8  # (strings,) those at work
    team: I8  # control words of the workers, see `team`
    rows: F8  # outputs of every string, from STRING.row
    direct: F8  # its outputs in flight, from STRING.direct
    bends: F8x2  # (SPAN, channels) smoothed, per quantum
    heights: F8x2  # (SPAN, parts)
    mono: F8  # (frames of a span,)
    frame: F8
    phases: F8  # a line split by the decimator
    mix: F8x2  # (frames of a span, 2)


class Scratch(NamedTuple):
    """Work arrays of one thread; they carry nothing from call to call."""

    path: F8
    out: F8  # (2 · steps of a quantum,)
    sigma: F8
    amplitude: F8
    q: F8
    v: F8
    record: F8x2  # (steps of a quantum, contacts)
    y: F8
    b: F8
    z: F8
    a: F8x2
    factor: F8x2
    order: I8
    enabled: U1
    active: U1
    watch: U1
    block: F8x2  # (3, K)
    forces: F8  # ((contacts + 1) · K,)
    block_u: F8
    block_matrix: F8
    moved: F8  # (3 · modes,)
    near: I8


def fields(kind: Any) -> dict[str, tuple[np.dtype, int]]:
    """Element type and dimensions of each field; numbers have 0."""
    out: dict[str, tuple[np.dtype, int]] = {}
    for name, hint in get_type_hints(kind, include_extras=True).items():
        metadata = getattr(hint, "__metadata__", None)
        out[name] = (np.dtype(hint), 0) if metadata is None else metadata
    return out


#: what the arrays of each kind are
FIELDS: dict[Any, dict[str, tuple[np.dtype, int]]] = {
    kind: fields(kind) for kind in (Bank, Settings, State, Shared, Scratch)
}
