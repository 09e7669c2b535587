"""What the native core works on beside the strings themselves (`solver.stringmodel`): a constant Bank, Sounding,
State and Stream that change.

Extents are named by what is counted; `bank` says how many there are.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from synth.midi.events import EVENT
from synth.midi.events import N_PARAMETERS as N_PARAMETERS
from synth.native.arrays import f8, i8, struct

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
#: frames over which a string changes between its internal rate and free flight at the output rate; a multiple of QUANTUM
FADE = 64

#: linear output of a string or a part from which on it is no sound any more but a computation that has blown up (240 dB
#: above full scale; presets may ask for 200 dB)
BLOWN_UP = 1e12

#: a string sleeps when its output is certain to stay below this (−100 dBFS; typically −120)
SLEEP_BELOW = 1e-5

MODEL = np.dtype(
    [
        ("string", "i8"),
        ("n", "i8"),
        ("own", "i8"),  # the string's own modes, the first; the others are lumped
        ("contacts", "i8"),
        ("layered", "i8"),  # whether these have soft layers
        ("audible", "i8"),  # its own modes that the decimator does not stop
        ("driven", "i8"),  # of these, how many move where the string rings by its bridge alone; others would not be heard
        ("length", "f8"),
        ("tension", "f8"),
        ("mu", "f8"),
        ("rest_height", "f8"),  # of the fret, below the open string's line
        ("line_output", "f8"),  # output of the rest line
        ("rest_output", "f8"),  # output of the static state, line included
        ("output_bound", "f8"),  # |output| ≤ bound · √Σ(v² + ω²q²)
        ("static_response", "f8"),  # displacement of the first contact under 1 N, at rest
        ("lift_output", "f8"),  # output of the state at rest under 1 N at the first contact; 0: not counted
        ("leverage", "i8"),  # where those of its contacts begin in Bank.leverage
        ("kick_reach", "f8"),  # of any of its contacts, at most, where its end moves: `coupling.most_of_contacts`
        ("largest_leverage", "f8"),
        ("largest_shape", "f8"),
        ("settled", "i8"),  # where its rows begin in Bank.settled, …
        ("settling", "i8"),  # … and how many there are; 0: no bridge of several points
        ("pressed", "i8"),  # where its numbers begin in Bank.settled (`pressed_flight`), …
        ("pressed_modes", "i8"),  # … and its modes while it presses on one point without a break; 0: it does not fly so
    ],
    align=True,
)

STRING = np.dtype(
    [
        ("part", "i8"),
        ("dice", "i8"),  # what tells it from the others of its preset, where strokes vary
        ("instrument", "i8"),
        ("bus", "i8"),  # where its part has sides, of the left one; the right one is the next
        ("factor", "i8"),
        ("left", "f8"),  # how loud it is on either side, where its part has them
        ("right", "f8"),
        ("positions", "i8"),  # how many; more than one: a neck; none: no key plays it
        ("open_length", "f8"),
        ("pluck_force", "f8"),
        ("impedance", "f8"),
        ("draw_s", "f8"),
        ("slip_s", "f8"),  # at velocity 0 and 127
        ("hard_slip_s", "f8"),
        ("release_s", "f8"),
        ("row", "i8"),  # where its outputs of a span begin
        ("direct_bus", "i8"),  # of the output rate; −1: that is its own rate
        ("direct", "i8"),  # where its outputs of a span at the output rate begin
        ("fade", "i8"),  # where what still fades begins
        ("pressure_height", "f8"),  # obstacle raised by full pressure [m]
        ("open_model", "i8"),  # of its first position
        ("second", "i8"),  # the line that is its other direction; −1: there is none
        ("of_first", "i8"),  # 1: it is another's second; nobody plays it but with that one
        ("second_models", "i8"),  # how many models later those of the second are
        ("friction", "f8"),  # of a second at the contacts of its first, else 0
        ("axial_stiffness", "f8"),  # EA [N], where its motion raises its tension; else 0
        ("choir", "i8"),  # a key sounds one string of every choir of its part, 1 …
        ("pluck_shift", "f8"),  # of its pluck from the part's position, parts of the open length
        ("flux_bend", "f8"),  # how its displacement bends into a flux: 1/(gain · distance), 0 where it does not
    ],
    align=True,
)

#: what is one task for threads: strings from `first_string` on, which share something where they are `together`
INSTRUMENT = np.dtype(
    [
        ("first_string", "i8"),
        ("end_string", "i8"),
        ("together", "i8"),
        ("body", "i8"),  # number of its body; −1: its strings do not move each other
        ("bus", "i8"),  # of what that radiates: left, and the next one right
        ("output_bound", "f8"),  # |output| ≤ bound · √(2 energy)
    ],
    align=True,
)

POSITION = np.dtype(
    [
        ("part", "i8"),
        ("string", "i8"),
        ("note", "i8"),
        ("fret", "i8"),
        ("model", "i8"),
        ("elsewhere", "i8"),  # the key is not what the string sounds
    ],
    align=True,
)

#: live parameters of a part, in this order (N_PARAMETERS)
GAIN, PLUCK_POSITION, PLUCK_AMOUNT, PLUCK_WIDTH, RELEASE, HEIGHT, VARIATION = range(7)
#: smallest and largest value of each; events beyond are brought back inside
PARAMETER_RANGES = ((0.0, 4.0), (0.02, 0.5), (0.0, 2.0), (0.5, 50.0), (0.1, 20.0), (-200.0, 50.0), (0.0, 2.0))
#: how a controller runs through a range: evenly, evenly in ratios, or as its square (a level: the middle near unity)
LINEAR, RATIO, SQUARE = range(3)
PARAMETER_CURVES = (SQUARE, LINEAR, LINEAR, RATIO, RATIO, LINEAR, LINEAR)

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
        ("excited", "i8"),  # by another excitation than the pluck
        ("velocity_exponent", "f8"),
        ("finger_stiffness", "f8"),
        ("finger_loss", "f8"),
        ("pressure_bend", "f8"),  # tension at full pressure [semitones]
        ("stereo", "i8"),  # its chain has left and right
        ("sides", "i8"),  # buses of each internal rate: one, or left and right
        ("pluck_first", "f8"),  # share of a pluck in the first direction of strings that have two, …
        ("pluck_second", "f8"),  # … and in the second
        ("choirs", "i8"),
        ("first_articulation", "i8"),
        ("end_articulation", "i8"),
        ("others_s", "f8"),  # T60 of other strings on the bridge once no note is held; 0: they ring on
        ("lifts", "i8"),  # a finger that leaves its fret lets the string rise
        ("release_touch", "i8"),  # what is laid on a string when its note ends; −1: nothing
        # standard deviations from stroke to stroke: of the place [m], and of the logarithms of level, width and times
        ("place_spread", "f8"),
        ("level_spread", "f8"),
        ("width_spread", "f8"),
        ("time_spread", "f8"),
        ("vibrato_hz", "f8"),
        ("vibrato", "f8"),  # by a full modulation wheel [semitones]
        ("vibrato_up", "i8"),  # it only pulls
        ("meend", "f8"),  # furthest that legato pulls a string aside [semitones]; 0: not at all
        ("meend_s", "f8"),  # …its time constant
        # the hand's push on the body at velocity 127 [N], 0: there is none; how long it takes, and how long after the stroke
        # it begins; what is unsteady about it, as a share, and how long that lasts; share of it as a note ends
        ("knock", "f8"),
        ("knock_s", "f8"),
        ("knock_delay_s", "f8"),
        ("knock_noise", "f8"),
        ("knock_grain_s", "f8"),
        ("knock_release", "f8"),
    ],
    align=True,
)

#: how a stroke moves the string
PLUCKED, THROWN = range(2)

#: one way to begin a note; the first of a part is its [pluck]. Ratios count from that
ARTICULATION = np.dtype(
    [
        ("key", "i8"),  # that switches to it; −1: none does
        ("controller", "i8"),  # while which lies between low and high; −1: none
        ("low", "i8"),
        ("high", "i8"),
        ("soft", "i8"),  # velocities that play it; above 127: none do
        ("hard", "i8"),
        ("stroke", "i8"),
        ("place_ratio", "f8"),
        ("place_shift", "f8"),  # from velocity 0 to 127, parts of the open length
        ("width_ratio", "f8"),
        ("hard_width_ratio", "f8"),  # of the finger at velocity 127 to velocity 0
        ("amount", "f8"),
        ("draw_s", "f8"),  # 0: the string's own
        ("slip_s", "f8"),  # below 0: the string's own
        ("hard_slip_s", "f8"),
        ("roughness", "f8"),
        ("rub", "f8"),  # standard deviation of the force of a finger that slides off, a share of it
        ("grains", "f8"),  # that it passes over meanwhile
        ("arrival", "f8"),  # speed with which it meets the string, in parts of the mean one
        ("by_ratios", "i8"),  # the width goes from soft to hard by equal ratios
        ("knock", "f8"),  # share of the hand's knock on the body
        ("mass", "f8"),
        ("speed", "f8"),  # at velocity 127
        ("stiffness", "f8"),  # of what is thrown
        ("touch", "i8"),  # what is laid on as the string is let go; −1: nothing
        ("harmonic", "i8"),
        ("strum_s", "f8"),
        ("slide_s", "f8"),
    ],
    align=True,
)

#: a finger that lies on a string
TOUCH = np.dtype(
    [
        ("place", "f8"),  # from the saddle, as a share of the speaking length
        ("width", "f8"),
        ("resistance", "f8"),  # in units of the string's impedance
        ("stiffness", "f8"),
        ("lift_s", "f8"),  # after which it is lifted; 0: by the next stroke
        ("speed", "f8"),  # with which it comes down [m/s]
        ("roughness", "f8"),  # [m]
        ("settle_s", "f8"),  # after which both have come to rest
        ("grain_s", "f8"),
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

    models: Annotated[np.ndarray, struct(MODEL, "models")]
    strings: Annotated[np.ndarray, struct(STRING, "strings")]
    instruments: Annotated[np.ndarray, struct(INSTRUMENT, "instruments")]
    positions: Annotated[np.ndarray, struct(POSITION, "positions")]
    parts: Annotated[np.ndarray, struct(PART, "parts")]
    buses: Annotated[np.ndarray, struct(BUS, "buses")]
    program_map: Annotated[np.ndarray, i8("16, 128")]  # part or −1
    plays: Annotated[np.ndarray, i8("16, parts")]  # whether a channel plays a part under any program
    pitch: Annotated[np.ndarray, f8("128")]  # of every key as compiled, in semitones
    bindings: Annotated[np.ndarray, struct(BINDING, "bindings")]  # by controller
    bound: Annotated[np.ndarray, i8("129")]  # where each controller's bindings begin
    articulations: Annotated[np.ndarray, struct(ARTICULATION, "articulations")]
    touches: Annotated[np.ndarray, struct(TOUCH, "touches")]
    taps: Annotated[np.ndarray, f8("taps")]  # ordered by phase
    leverage: Annotated[np.ndarray, f8("leverage")]  # of every model's contacts by the motion of the saddle
    # `layers.static_matrix` of every model over several points of a bridge; of every one that flies while it presses, what
    # `pressed_flight` has of it
    settled: Annotated[np.ndarray, f8("settled")]


class Settings(NamedTuple):
    """Constant for one stream."""

    rate_hz: float
    ceiling: float  # the limiter's; infinite without one
    mix_latency: int  # frames by which the mix is later than the stems
    gain: float
    polyphony: int
    smoothing: float  # share of the way per frame, gain and pan
    dc: float  # pole of the high-pass
    economy: int  # 0: modes do not rest, strings do not fly
    span: int  # quanta worked off in one go, at most
    seed: int  # of what varies from stroke to stroke


#: what a hand does to a string: nothing; is about to pluck it; stops it at a higher fret, draws it aside, lets it slip off,
#: hits it; lies on it
NO_FINGER, WAIT, PRESS, DRAW, SLIP, HIT, TOUCHED = range(7)
#: MOTION.flying: at its internal rate; at the output rate, of a string on a moving bridge: in the modes that it has while it
#: presses on one point (`pressed_flight`); so, and its steps' coefficients wait until it lands
LANDED, FLYING, STEPS_DUE = range(3)

#: who plays a string, and what its note asks for: the voice policy's
VOICE = np.dtype(
    [
        ("awake", "i8"),
        ("idle", "i8"),  # awake only because it shares a bridge with what is played
        ("note", "i8"),
        ("channel", "i8"),
        ("held", "i8"),  # by a key
        ("sustained", "i8"),
        ("stolen", "i8"),
        ("plucked_at", "i8"),
        ("level", "f8"),
        ("articulation", "i8"),  # number in the Bank
        ("node", "f8"),  # where it is touched for a harmonic, from the saddle as a share of its length; 0: for none
        ("timbre", "f8"),  # of its note: −1 plucked in the middle … 1 by the bridge
        ("key_pressure", "f8"),  # of its key alone
        ("retune_to", "f8"),  # where EXPRESSION.retuned and .pull go
        ("pull_to", "f8"),
    ],
    align=True,
)

#: where hands have a string, and what they are at and about to do
HAND = np.dtype(
    [
        ("phase", "i8"),
        ("model", "i8"),  # that it is stopped at
        ("glide_to", "i8"),  # model that it slides to along the frets
        ("wait", "i8"),  # frames until the stroke that is to come
        ("pending_model", "i8"),
        ("pending_velocity", "f8"),
        ("pending_legato", "i8"),
    ],
    align=True,
)

#: what touches a string, and the way that it goes
STROKE = np.dtype(
    [
        ("strokes", "i8"),  # that it has had: what varies from one to the next follows from it
        ("finger_step", "i8"),
        ("finger_steps", "i8"),
        ("finger_from", "f8"),
        ("finger_to", "f8"),
        ("slip_s", "f8"),  # of the stroke at hand
        ("roughness", "f8"),
        ("yielding", "f8"),  # stiffness of the string under the finger, in parts of the finger's own
        ("thrown", "f8"),  # speed of what flies at it or lies on it [m/s]
        ("touch", "i8"),  # number of what lies on it, where that is TOUCHED
        ("target", "f8"),  # resistance of what touches it, which grows to it
    ],
    align=True,
)

#: the push on the body of the hand that plays a string
KNOCK = np.dtype(
    [
        ("force", "f8"),  # largest, of the last stroke's push [N]
        ("push", "f8"),  # the same of the push that began last, …
        ("step", "i8"),  # … how many frames of it are over …
        ("steps", "i8"),  # … of how many; 0: there is none
    ],
    align=True,
)

#: what a player does to a sounding string beside plucking it, and what its own motion adds
EXPRESSION = np.dtype(
    [
        ("hand", "f8"),  # extra σ of the damping hand
        ("bend", "f8"),  # semitones in the coefficients
        ("rise", "f8"),  # of these by its own motion, as a share of the model's tension
        ("height", "f8"),  # obstacle raised by [m]
        ("retuned", "f8"),  # semitones of these by the tuning, smoothed
        ("slide", "f8"),  # semitones that the finger on a board has still to go
        ("pull", "f8"),  # semitones that legato has pulled it aside by
        ("pressure", "f8"),  # 0 … 1, smoothed
    ],
    align=True,
)

#: how a string is advanced
MOTION = np.dtype(
    [
        ("altered", "i8"),  # hand or bend: coefficients of its own, not the model's
        ("stale", "i8"),  # 1: coefficients, 2: the finger's coupling to be worked out before the next step
        ("flying", "i8"),  # at the output rate: LANDED, FLYING or STEPS_DUE
        ("fade_at", "i8"),  # frames that have faded, of so many
        ("fade_to", "i8"),
        ("lift", "f8"),  # force on the string at rest: of the contacts, as one at the first would pull at the bridge [N]
        ("rest", "f8"),  # output at rest, line included
        ("base", "f8"),  # output counted as zero; follows `rest`
    ],
    align=True,
)

#: how far a string has come in the span
PROGRESS = np.dtype(
    [
        ("reached", "i8"),  # frames of a quantum with events that it has gone through
        ("row_from", "i8"),  # steps of the span that its row holds: of a string that woke or fell asleep not all
        ("row_to", "i8"),
        ("direct_from", "i8"),  # the same of its row at the output rate
        ("direct_to", "i8"),
    ],
    align=True,
)

#: what is counted of a string
TALLY = np.dtype(
    [
        ("mode_steps", "i8"),  # work done
        ("unsolved", "i8"),  # calls in which a contact problem was not solved
        ("silenced", "i8"),  # times that its motion had blown up
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
        ("wheel", "f8"),  # modulation, controller 1: 0 … 1
        ("shaking", "f8"),  # the same, smoothed
        ("articulation", "i8"),  # of its part, as keys have switched it; 0: the normal one
        ("ruled", "i8"),  # the one that a controller asks for; −1: none does
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
        ("dc_in_right", "f8"),
        ("dc_out_right", "f8"),
        ("hand", "f8"),
        ("height", "f8"),
        ("still", "i8"),  # nothing rings in its filters any more
        ("channel", "i8"),  # whose volume, expression and pan count: the last one to play it or to set them
        ("silenced", "i8"),  # times that its filters held what is no sound
        ("strum_at", "i8"),  # frame at which a chord began, …
        ("strum_first", "i8"),  # …the string that began it, …
        ("strum_down", "i8"),  # …and whether the last one of several notes went from the lowest string on
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
    N_SILENCED,
) = range(10)
N_COUNTERS = 10

#: places in `meters`: largest output since reset; output level below which a string that no key holds is damped, 0: none is
PEAK, SPARE = range(2)
N_METERS = 2


class Sounding(NamedTuple):
    """What changes of every string while it sounds, beside its modes and contacts."""

    voices: Annotated[np.ndarray, struct(VOICE, "strings")]
    hands: Annotated[np.ndarray, struct(HAND, "strings")]
    strokes: Annotated[np.ndarray, struct(STROKE, "strings")]
    knocks: Annotated[np.ndarray, struct(KNOCK, "strings")]
    expressions: Annotated[np.ndarray, struct(EXPRESSION, "strings")]
    motions: Annotated[np.ndarray, struct(MOTION, "strings")]
    progress: Annotated[np.ndarray, struct(PROGRESS, "strings")]
    tallies: Annotated[np.ndarray, struct(TALLY, "strings")]


class State(NamedTuple):
    """What events have set, and what is counted."""

    channels: Annotated[np.ndarray, struct(CHANNEL, "16")]
    part_state: Annotated[np.ndarray, struct(PART_STATE, "parts")]
    parameters: Annotated[np.ndarray, f8("parts, N_PARAMETERS")]
    tuning: Annotated[np.ndarray, f8("128")]  # semitones of every key above Bank.pitch
    zones: Annotated[np.ndarray, i8("2")]  # members of each MPE zone (`zones`), 0: there is none
    keys: Annotated[np.ndarray, i8("16, 128")]  # number of the note that each key holds; 0: it is up
    unplayed: Annotated[np.ndarray, i8("parts + 1, 128")]  # last row: channels without a part
    counters: Annotated[np.ndarray, i8("N_COUNTERS")]
    meters: Annotated[np.ndarray, f8("N_METERS")]
    event: Annotated[np.ndarray, struct(EVENT, "1")]  # at hand


class Stream(NamedTuple):
    """Events that wait, and sound on its way from the strings out."""

    pending: Annotated[np.ndarray, struct(EVENT, "PENDING_EVENTS")]
    fade: Annotated[np.ndarray, f8("fades")]  # what still fades, at the internal rate
    direct_fade: Annotated[np.ndarray, f8("strings, FADE")]
    lines: Annotated[np.ndarray, f8("lines")]  # of every bus: the steps its decimator still needs, then those of a span
    quiet: Annotated[np.ndarray, i8("buses")]  # steps of nothing that the bus has seen last
    effect_numbers: Annotated[np.ndarray, f8("effect_numbers")]  # what the effects of all chains remember, see `Effects`
    effect_counts: Annotated[np.ndarray, i8("effect_counts")]
    ring: Annotated[np.ndarray, f8("RING, 2")]
    stems: Annotated[np.ndarray, f8("parts, RING, 2")]


#: an effect in its place: addresses of its table and of what is called with that; which numbers and counts are its own
PLACED = np.dtype(
    [
        ("table", "i8"),
        ("process", "i8"),
        ("silent", "i8"),
        ("number", "i8"),
        ("end_number", "i8"),
        ("count", "i8"),
        ("end_count", "i8"),
    ],
    align=True,
)


class Effects(NamedTuple):
    """Constant: the chains of effects, of every part and at last of the mix."""

    chains: Annotated[np.ndarray, i8("parts + 1, 2")]  # first of each chain among `placed`, and behind the last
    placed: Annotated[np.ndarray, struct(PLACED, "placed")]
    numbers: Annotated[np.ndarray, f8("effect_numbers")]  # of the Stream, at rest
    counts: Annotated[np.ndarray, i8("effect_counts")]


#: what an instrument can be asked: to go through whole quanta, what is decided at the start of one, a stretch within it
WHOLE, BEGIN, STRETCH = range(3)
#: places in Shared.task: one of these; number of the span's first quantum; quanta; frame of the quantum up to which a
#: stretch goes; addresses of what does it, `tasks.entries`; of what decides about an event, and of the table it sees
TASK, FIRST_QUANTUM, QUANTA, UNTIL, WORK_ON, STEP, TOGETHER, OFF_BOARD, STEP_TWO, HANDLE, VOICES = range(11)
N_TASK = 11
#: the second instrument of a call of WORK_ON where there is none
NOBODY = -1


#: addresses of what begins an excitation, of what its hand follows, of its constants (`instrument.excitations`)
BEGIN_HOLD, FOLLOW, CONSTANTS = range(3)
#: a model comes as compiled, with coefficients of the string's own (MOTION.altered), and over whole frames
PLAIN, ALTERED, FLIGHT, ALTERED_FLIGHT = range(4)


class Shared(NamedTuple):
    """What threads share: what is asked of them, and where everything is found."""

    task: Annotated[np.ndarray, i8("N_TASK")]  # what is asked of the strings, see above
    queue: Annotated[np.ndarray, i8("strings")]  # instruments at work
    model_at: Annotated[np.ndarray, i8("models, 4")]  # addresses of every StringModel, see below
    string_at: Annotated[np.ndarray, i8("strings")]  # addresses of every StringState
    coupling_at: Annotated[np.ndarray, i8("instruments")]  # addresses of every Coupling; 0: it has none
    end_at: Annotated[np.ndarray, i8("strings")]  # addresses of the End of every string of those; else 0
    board_at: Annotated[np.ndarray, i8("models")]  # addresses of the Board under every model; 0: there is none
    excitation: Annotated[np.ndarray, i8("parts, 3")]  # of every part whose hand does not pluck, see below; else 0
    team: Annotated[np.ndarray, i8("N_WORDS")]  # control words of the workers, see `team`


class SpanWork(NamedTuple):
    """Work arrays of one span that all threads see; they carry no sound from span to span."""

    rows: Annotated[np.ndarray, f8("string_rows")]  # outputs of every string, from STRING.row
    direct: Annotated[np.ndarray, f8("strings*frames")]  # its outputs in flight, from STRING.direct
    radiated: Annotated[np.ndarray, f8("bodies, 2, frames")]  # of every body, left and right
    radiated_frames: Annotated[np.ndarray, i8("bodies, 2")]  # from where to where of the span they are there
    bends: Annotated[np.ndarray, f8("span, 16")]  # smoothed, per quantum
    shakes: Annotated[np.ndarray, f8("span, 16")]  # CHANNEL.shaking
    heights: Annotated[np.ndarray, f8("span, parts")]
    mono: Annotated[np.ndarray, f8("frames")]
    pair: Annotated[np.ndarray, f8("frames, 2")]
    frame: Annotated[np.ndarray, f8("frames")]
    phases: Annotated[np.ndarray, f8("phases")]  # a line split by the decimator
    mix: Annotated[np.ndarray, f8("frames, 2")]


#: what stands in the table of a core, in this order
CORE_PARTS: tuple[Any, ...] = (Bank, State, Stream, Sounding, Shared, SpanWork, Settings, Effects)
