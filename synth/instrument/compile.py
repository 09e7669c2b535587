"""From a preset and a plan to the arrays that sound: where an instrument's physics meets the solver.

Every string of the preset gets one modal model per position it can be played at (open, and each fret), tuned so that
the sounding fundamental has the note's pitch: the tension is that of the model's first mode at the note's frequency
less the preset's measured contact shift. Positions count from the nut or the fret that stops it
(x = 0; the saddle is at x = L), heights from the string's line at rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Set
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from synth.instrument.boards import StringBoard, board_plan, on_board, string_board
from synth.instrument.coupled_plan import choose_steps, measured_together
from synth.instrument.fingerprints import fingerprint, strokes
from synth.instrument.neck import linear_density, obstacle_under, strung
from synth.instrument.nut_modes import nut_resonances
from synth.instrument.plan import FREE, KEPT, ROLLING, StringPlan, measured_plan, plan_string, scene_kind
from synth.instrument.planfile import PROMISED, VERSION, Measured
from synth.instrument.preset import (
    BoardObstacle,
    BridgeObstacle,
    FretsObstacle,
    PointContacts,
    PointsObstacle,
    Polarisation,
    Preset,
    PresetError,
    StringTable,
    at_note,
    contact_cents,
    fret_count,
    in_file_words,
    playable_range,
)
from synth.instrument.soundboard import Soundboard, soundboard
from synth.physics.modes import (
    decay_rates,
    force_weights,
    modal_frequencies,
    mode_shapes,
)
from synth.physics.obstacle import Obstacle, fret_positions, frets, fretted, parabola_height
from synth.physics.string import NutResonance, String
from synth.physics.tail import lumped_tail
from synth.physics.tuning import tuned
from synth.physics.uneven_mass import scatter_of
from synth.solver.laws import EXACT_HOLD, coefficients, contact_matrix, law_of
from synth.solver.layers import static_forces
from synth.solver.lcp import SOLVED
from synth.units import db_to_gain, midi_to_hz, midi_to_note

#: a string is heard at most this far from the saddle, as a part of its speaking length
FARTHEST_OUTPUT = 0.98
_NO_LAYERS = np.zeros((3, 0))
#: height of what a direction only rubs against [m]
_OUT_OF_REACH_M = -1.0


@dataclass(frozen=True, kw_only=True)
class Contacts:
    """What a string touches at a position: C contacts, seen by N modes."""

    places_m: np.ndarray  # (C,)
    shapes: np.ndarray  # (C, N)
    eta: np.ndarray  # (C,)
    residual: np.ndarray  # (C, C)
    matrix: np.ndarray  # (C, C)
    leverage: np.ndarray  # (C,) of a contact by the motion of the saddle: x/L, less 1 for what rides on the bridge
    layers: np.ndarray  # (3, C) of the contacts (`solver.layers`), or (3, 0)
    q_rest: np.ndarray  # (N,) static state under contacts that press


@dataclass(frozen=True, kw_only=True)
class Position(Contacts):
    """A note at a place of a string, with its model. Shapes: N modes, of which the last may be lumped, C contacts."""

    note: int
    fret: int
    string: String  # as it speaks here
    plan: StringPlan
    omega: np.ndarray  # (N,)
    sigma: np.ndarray  # (N,)
    coef: np.ndarray  # (6, N)
    wq: np.ndarray  # (N,)
    wv: np.ndarray  # (N,)
    rest_height_m: float  # of the fret it is stopped at, below the open string's line
    output_rest: float  # output of that line
    across: np.ndarray  # (2, own) ω and σ in the second direction, or (2, 0)

    @property
    def length_m(self) -> float:
        """Speaking length [m]."""
        return self.string.length_m

    @property
    def tension_n(self) -> float:
        """Tension [N]."""
        return self.string.tension_n

    @property
    def mu(self) -> float:
        """Mass per length [kg/m]."""
        return self.string.linear_density_kg_m

    @property
    def own(self) -> int:
        """The string's own modes; those behind them are lumped (`physics.tail`)."""
        return self.plan.modes


@dataclass(frozen=True, kw_only=True)
class Plucking:
    """How the finger plucks a string, and how the string is let go of."""

    pluck_force_n: float  # at velocity 127
    draw_s: float
    slip_s: float  # in which the finger lets go at velocity 0 and 127
    hard_slip_s: float
    release_s: float
    pluck_shift: float  # of its pluck from that of the others, parts of its open length


@dataclass(frozen=True, kw_only=True)
class CompiledString(Plucking):
    """One physical string and its positions, lowest note first: all of its `places`, or those that were asked for."""

    name: str
    open_note: int
    places: int
    open_length_m: float
    positions: tuple[Position, ...]
    impedance_kg_s: float
    axial_stiffness_n: float  # where its motion raises its tension; else 0
    friction: float  # of its second direction at the contacts of its first
    board: StringBoard | None  # what lies under it, where that is a board
    choir: int
    sympathetic: bool  # no key plays it
    elsewhere: bool  # the key that plays it is not what it sounds
    pan: float  # from where it is heard
    flux_bend: float  # how much of its output as a flux goes as its square: 1/(gain · distance); else 0

    @property
    def factor(self) -> int:
        """Its steps in a frame."""
        return self.positions[0].plan.factor


@dataclass(frozen=True)
class CompiledPart:
    """A preset ready to sound at one output rate. body: what its strings share, if they do."""

    preset: Preset
    strings: tuple[CompiledString, ...]
    body: Soundboard | None = None


def string_notes(table: StringTable) -> range:
    """The open notes of a string table: one physical string each."""
    return range(table.notes[0], table.notes[1] + 1)


def note_frequency(preset: Preset, table: StringTable, note: int, note_hz: np.ndarray | None) -> float:
    """Pitch that a note must sound at [Hz]."""
    if table.sounds is not None:
        note += table.sounds - table.notes[0]
    if note_hz is not None:
        base = float(note_hz[min(note, 127)])
    else:
        base = midi_to_hz(note, preset.tuning.a4_hz)
    return base * 2.0 ** ((preset.tuning.offset_cents + table.cents) / 1200.0)


def string_frequency(preset: Preset, table: StringTable, note: int, note_hz: np.ndarray | None = None) -> float:
    """First mode that a string is tuned to for a note [Hz]: the note's pitch less the contact's calibrated shift."""
    return note_frequency(preset, table, note, note_hz) * 2.0 ** (
        -contact_cents(preset, note, sympathetic=table.sympathetic) / 1200.0
    )


def string_seed(preset: Preset, table: StringTable, note: int) -> int:
    """What the chances of one string follow from: where its table stands among the preset's, and its open note."""
    places = [k for k, each in enumerate(preset.string) if each is table] or [
        k for k, each in enumerate(preset.string) if each == table
    ]
    return 128 * (places[0] if places else 0) + note


def ideal_string(preset: Preset, table: StringTable, note: int, frequency_hz: float) -> String:
    """The open string of a table at one of its notes, at the tension that a string without stiffness has at `frequency_hz`.

    Its `inharmonicity` is what the table calls so.
    """

    seed = string_seed(preset, table, note)  # of the table as it stands in the preset, before it is restrung
    table = strung(preset, table, note)

    def mm(value):
        return None if value is None else 1e-3 * at_note(value, note)

    length = at_note(table.length_m, note)
    diameter = 1e-3 * at_note(table.diameter_mm, note)
    core = mm(table.core_diameter_mm)
    mu = linear_density(table, note)
    ideal_tension = mu * (2.0 * length * frequency_hz) ** 2
    if table.youngs_modulus_gpa is not None:
        stiffness = 1e9 * at_note(table.youngs_modulus_gpa, note) * math.pi * (core or diameter) ** 4 / 64.0
    else:
        assert table.inharmonicity is not None
        stiffness = at_note(table.inharmonicity, note) * ideal_tension * length**2 / math.pi**2
    uneven = at_note(table.unevenness_cents, note)
    return String(
        length_m=length,
        tension_n=ideal_tension,
        linear_density_kg_m=mu,
        bending_stiffness_n_m2=stiffness,
        diameter_m=diameter,
        core_diameter_m=core,
        winding_diameter_m=mm(table.winding_diameter_mm),
        viscoelastic_loss=at_note(table.viscoelastic_loss, note),
        thermoelastic_q_inverse=at_note(table.thermoelastic_q_inverse, note),
        stiffness_law=table.stiffness_law,
        mass_scatter=scatter_of(uneven, length),
        seed=seed if uneven else 0,
        nut=nut_resonances(preset.nut),
    )


def make_string(preset: Preset, table: StringTable, note: int, frequency_hz: float) -> String:
    """The open string of a table at one of its notes, tuned to `frequency_hz`."""
    string = tuned(ideal_string(preset, table, note, frequency_hz), frequency_hz)
    if table.measured_frequencies_hz:
        ratio = frequency_hz / table.measured_frequencies_hz[0]
        string = replace(string, measured_frequencies_hz=tuple(f * ratio for f in table.measured_frequencies_hz))
    return replace(string, measured_decay_rates=table.measured_decay_rates)


def axial_stiffness(preset: Preset, table: StringTable, note: int) -> float:
    """EA of a table's string at one of its notes [N]: as given, or of what bears its tension, core or plain string."""
    table = strung(preset, table, note)
    if table.axial_stiffness_n is not None:
        return at_note(table.axial_stiffness_n, note)
    assert table.youngs_modulus_gpa is not None
    diameter = table.diameter_mm if table.core_diameter_mm is None else table.core_diameter_mm
    return 1e9 * at_note(table.youngs_modulus_gpa, note) * math.pi * (1e-3 * at_note(diameter, note)) ** 2 / 4.0


def obstacle_of(preset: Preset, table: StringTable, note: int, length_m: float) -> Obstacle:
    """The obstacle under an open string of a table, of `length_m`, in metres from the nut."""
    shape = obstacle_under(preset, table, note)
    if isinstance(shape, BridgeObstacle):
        if shape.distance_mm is not None:
            distance = 1e-3 * at_note(shape.distance_mm, note)
        else:
            assert shape.distance_ratio is not None
            distance = shape.distance_ratio * length_m
        met = shape.points if table.bridge_points is None else table.bridge_points
        places = [distance * k / shape.points for k in range(met, 0, -1)]
        fallen = (0.0,) * met
        if shape.points > 1:
            fallen = tuple(parabola_height(np.array(places), 0.0, 0.0, 1e-3 * shape.radius_mm).tolist())
        jiva = 1e-6 * at_note(shape.jiva_um, note)
        return Obstacle(tuple(length_m - each for each in places), tuple(each - jiva for each in fallen))
    if isinstance(shape, PointsObstacle):
        return Obstacle(tuple(1e-3 * x for x in shape.positions_mm), tuple(1e-3 * h for h in shape.heights_mm))
    if isinstance(shape, FretsObstacle):
        if shape.heights_mm:
            return Obstacle(tuple(fret_positions(length_m, shape.count)), tuple(1e-3 * h for h in shape.heights_mm))
        assert shape.action_12th_mm is not None
        return frets(
            length_m,
            shape.count,
            1e-3 * shape.action_12th_mm,
            relief_m=1e-3 * shape.relief_mm,
            nut_height_m=1e-3 * shape.nut_height_mm,
        )
    return Obstacle((), ())


def layers_of(preset: Preset, note: int, contacts: int) -> np.ndarray:
    """(3, C) spring [N/m], dashpot [N s/m] and depth [m] of so many contacts' layers, or (3, 0) where they have none."""
    layer = preset.obstacle.layer if isinstance(preset.obstacle, PointContacts) else None
    if layer is None or contacts == 0:
        return np.zeros((3, 0))
    spring, dashpot = 1e3 * at_note(layer.stiffness_n_mm, note), at_note(layer.resistance_n_s_m, note)
    return np.repeat([[spring], [dashpot], [1e-6 * at_note(layer.thickness_um, note)]], contacts, axis=1)


def _refuse_wider_than_string(preset: Preset, length_m: float) -> None:
    """A finger or a pickup as wide as the string averages all of it away; near an end the engine takes less of a finger."""
    widths = {"pluck.width_mm": preset.pluck.width_mm, "pluck.width_hard_mm": preset.pluck.width_hard_mm}
    if preset.output.magnetic:
        widths["output.aperture_mm"] = preset.output.aperture_mm
    for field, width_mm in widths.items():
        if width_mm is not None and width_mm > 1e3 * length_m:
            raise ValueError(
                f"{field} must be at most {1e3 * length_m:g} mm, the string's length, got {width_mm:g}; reduce it"
            )


def open_string(preset: Preset, table: StringTable, note: int, note_hz: np.ndarray | None = None) -> tuple[String, Obstacle]:
    """The open string of a table at one of its notes and what lies below it. Raises ValueError where it cannot be tuned."""
    opened = make_string(preset, table, note, string_frequency(preset, table, note, note_hz))
    _refuse_wider_than_string(preset, opened.length_m)
    below = obstacle_of(preset, table, note, opened.length_m)
    below.check(opened.length_m)
    return opened, below


def string_places(preset: Preset, table: StringTable, note: int) -> int:
    """At how many places a string of this open note is played: open, and at every fret."""
    return min(fret_count(preset, table), 127 - note) + 1


def stopped(preset: Preset, fret: int, opened: String, below: Obstacle) -> tuple[float, Obstacle, float]:
    """Speaking length [m] of a string over frets or a bridge, stopped at a fret (0: open), what is left below it, and the
    height of its fret [m]. Over a bridge it lies as the open string does: the hand presses it down to no fret of its own
    height. Raises ValueError for a fret in its way, and where a bridge's points begin before the fret."""
    if isinstance(preset.obstacle, FretsObstacle):
        length, left = fretted(below, fret, opened.length_m)
        return length, left, below.heights_m[fret - 1] if fret else 0.0
    if not fret:
        return opened.length_m, below, 0.0
    behind = float(fret_positions(opened.length_m, fret)[-1])
    left = Obstacle(tuple(x - behind for x in below.positions_m), below.heights_m)
    left.check(opened.length_m - behind)
    return opened.length_m - behind, left, 0.0


def speaking_string(
    preset: Preset,
    table: StringTable,
    note: int,
    fret: int,
    opened: String,
    below: Obstacle,
    note_hz: np.ndarray | None = None,
) -> tuple[String, Obstacle, float]:
    """Of `open_string` stopped at a fret (0: open): the string, what lies below it, and the height of its fret [m].

    Raises ValueError where it cannot sound: a fret in its way, a pitch that no tension gives.
    """
    shape = obstacle_under(preset, table, note) if isinstance(preset.obstacle, BoardObstacle) else None
    if isinstance(shape, BoardObstacle):
        wanted_hz = string_frequency(preset, table, note + fret, note_hz)
        return on_board(shape, opened, fret, wanted_hz)
    length, left, height = stopped(preset, fret, opened, below)
    if not fret:
        return opened, with_sawari(preset, note, left), 0.0
    return tuned(opened.with_length(length), string_frequency(preset, table, note + fret, note_hz)), left, height


def with_sawari(preset: Preset, note: int, frets: Obstacle) -> Obstacle:
    """What lies below an open string: its frets, and before them the hill that it buzzes on, if there is one."""
    shape = preset.obstacle
    if not isinstance(shape, FretsObstacle) or shape.sawari_distance_mm is None or shape.sawari_um is None:
        return frets
    x, first = 1e-3 * shape.sawari_distance_mm, frets.positions_m[0]
    if x >= first:
        raise ValueError(
            f"obstacle.sawari_distance_mm must be less than {1e3 * first:.4g} mm, from nut to first fret, got "
            f"{1e3 * x:g}; reduce it"
        )
    return Obstacle((x, *frets.positions_m), (-1e-6 * at_note(shape.sawari_um, note), *frets.heights_m))


def string_kind(preset: Preset, opened: String, below: Obstacle) -> str:
    """What kind of scene (`plan.scene_kind`) an open string over its obstacle is, plucked softly and hard."""
    pluck = preset.pluck
    shares = (pluck.position, pluck.hardest_position)
    curved = isinstance(preset.obstacle, BridgeObstacle)
    return scene_kind(opened, below.positions_m, [opened.length_m * (1.0 - share) for share in shares], curved=curved)


def plannable(preset: Preset) -> bool:
    """Whether plans are measured of a preset's strings: over rigid points, and where they share a body, over a bridge."""
    shape = preset.obstacle
    return isinstance(shape, BridgeObstacle if preset.coupled else PointContacts) and shape.layer is None


def has_plan(preset: Preset, table: StringTable, note: int) -> bool:
    """Whether a plan is measured of an open string: one that is struck and meets something; where it shares a body, one that
    rolls on a bridge."""
    if table.sympathetic or not plannable(preset):
        return False
    kind = string_kind(preset, *open_string(preset, table, note))
    return kind in ROLLING or not (preset.coupled or kind == FREE)


def measured_of(
    preset: Preset, table: StringTable, note: int, pitch_hz: float, quality: str, rate_hz: float
) -> Measured | None:
    """What was measured of an open string at this quality, for this output rate; None: nothing that still holds."""
    known = preset.measured
    if not known.strings or not plannable(preset) or not known.strokes.issuperset(strokes(preset)):
        return None
    found = known.string(fingerprint(preset, table, note))
    taken = None if found is None else found.at(pitch_hz, quality)
    return taken if taken is None or not preset.coupled else measured_together(taken, rate_hz)


def output_distance(preset: Preset, string: String, open_length_m: float) -> float:
    """Where a speaking string is heard, from the saddle [m]: not behind a high fret, however near the neck the pickup is."""
    return min(preset.output.position * open_length_m, FARTHEST_OUTPUT * string.length_m)


def pluck_shift(preset: Preset, table: StringTable, note: int) -> float:
    """How much farther from the saddle than `pluck.position` a table's string is plucked, as a share of its open length."""
    return 0.0 if table.pluck_position is None else at_note(table.pluck_position, note) - preset.pluck.position


def full_pluck_force(preset: Preset, table: StringTable, opened: String, note: int) -> float:
    """Force [N] that draws a table's open string at the pluck's place by its displacement: that of velocity 127."""
    length = opened.length_m
    x = (preset.pluck.position + pluck_shift(preset, table, note)) * length
    return 1e-3 * at_note(preset.pluck.displacement_mm, note) * opened.tension_n * length / (x * (length - x))


def output_weights(preset: Preset, string: String, open_length_m: float, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights (N,), (N,) on q and on v of the preset's output for one speaking string."""
    output = preset.output
    x = string.length_m - output_distance(preset, string, open_length_m)
    zero = np.zeros(n)
    if output.kind == "body":
        return zero, zero
    if output.kind == "force":
        return force_weights(string, x, n), zero
    shape = mode_shapes(string.length_m, np.array([x]), n)[0]
    if output.kind == "displacement":
        return shape, zero
    if output.kind == "velocity":
        return zero, shape
    k = np.arange(1, n + 1) / string.length_m  # k_j/π
    seen = shape * np.sinc(k * 0.5e-3 * output.aperture_mm)
    return seen, zero if output.kind == "flux" else seen


def _output_of_rest_line(preset: Preset, string: String, open_length_m: float, height_m: float) -> float:
    """Output that the straight line from a fret at `height_m` to the saddle has, against the open string's; of a pickup the
    displacement there [m], of a body the force with which it pulls the bridge up [N]."""
    slope = height_m / string.length_m
    if preset.output.kind == "force":
        return -string.tension_n * slope
    if preset.output.kind == "body":
        return string.tension_n * slope
    if preset.output.kind == "velocity":
        return 0.0
    return slope * output_distance(preset, string, open_length_m)


def static_compliance(omega: np.ndarray, mu: float, shapes: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """(C, C) displacements of the contacts of a string under 1 N at each, at rest [m/N]."""
    return (shapes / (mu * omega**2)) @ shapes.T + residual


def static_state(
    omega: np.ndarray,
    mu: float,
    shapes: np.ndarray,
    eta: np.ndarray,
    residual: np.ndarray,
    layers: np.ndarray | None = None,
) -> np.ndarray:
    """q (N,) at rest over contacts that press: 0 ≤ S q + R λ − η ⊥ λ ≥ 0 with q = Sᵀλ/(μω²), or as their layers have it."""
    contacts = eta.size
    q = np.zeros(omega.size)
    if contacts == 0 or eta.max() <= 0.0:
        return q
    force, status = static_forces(
        static_compliance(omega, mu, shapes, residual), -eta, _NO_LAYERS if layers is None else layers
    )
    if status != SOLVED:
        raise ValueError("the static contact problem of the string at rest has no solution")
    return (force @ shapes) / (mu * omega**2)


def compile_position(
    preset: Preset,
    string: String,
    obstacle: Obstacle,
    plan: StringPlan,
    *,
    note: int,
    fret: int,
    open_length_m: float,
    rest_height_m: float,
    gain: float = 1.0,
) -> Position:
    """The model of one speaking string over its obstacle, as planned."""
    law = law_of(plan.scheme)
    n = plan.modes
    omega = modal_frequencies(string, n)
    sigma = decay_rates(string, n)
    positions = np.asarray(obstacle.positions_m, dtype=float)
    eta = np.asarray(obstacle.heights_m, dtype=float)
    shapes = mode_shapes(string.length_m, positions, n) if positions.size else np.zeros((0, n))
    residual = np.zeros((eta.size, eta.size))
    layers = layers_of(preset, note - fret, eta.size)
    wq, wv = output_weights(preset, string, open_length_m, n)
    if positions.size and law == EXACT_HOLD:
        tail = lumped_tail(string, positions, n, plan.rate_hz)
        omega, sigma = np.append(omega, tail.omega), np.append(sigma, tail.sigma)
        shapes, residual = np.hstack([shapes, tail.shapes]), tail.residual
        outputs = np.array(output_weights(preset, string, open_length_m, tail.modes))
        wq, wv = np.hstack([[wq, wv], tail.weights(outputs)])
    mu = string.linear_density_kg_m
    coef = coefficients(law, omega, sigma, mu, 1.0 / plan.rate_hz)
    matrix = np.zeros((eta.size, eta.size))
    contact_matrix(law, coef, shapes, residual, matrix)
    gained = preset.output.kind not in ("pickup", "body")  # a pickup's gain is on its velocity
    return Position(
        note=note,
        fret=fret,
        string=string,
        plan=plan,
        omega=omega,
        sigma=sigma,
        coef=coef,
        wq=gain * wq if gained else wq,
        wv=gain * wv,
        rest_height_m=rest_height_m,
        output_rest=(gain if gained else 1.0) * _output_of_rest_line(preset, string, open_length_m, rest_height_m),
        across=_modes_across(preset.polarisation, string, n),
        places_m=positions,
        shapes=shapes,
        eta=eta,
        residual=residual,
        matrix=matrix,
        leverage=positions / string.length_m - (1.0 if isinstance(preset.obstacle, BridgeObstacle) else 0.0),
        layers=layers,
        q_rest=static_state(omega, mu, shapes, eta, residual, layers),
    )


def string_across(across: Polarisation, string: String) -> String:
    """The string as its second direction has it: with a share of the nut's mobility there."""
    nut = [
        NutResonance(each.frequency_hz, each.q, (each.across_mass_kg or each.mass_kg) / across.nut_share)
        for each in string.nut
        if across.nut_share > 0.0
    ]
    return replace(string, nut=tuple(nut))


def _modes_across(across: Polarisation | None, string: String, n: int) -> np.ndarray:
    """`Position.across`: detuned and damped."""
    if across is None:
        return np.zeros((2, 0))
    string = string_across(across, string)
    omega = 2.0 ** (across.detuning_cents / 1200.0) * modal_frequencies(string, n)
    return np.array([omega, across.loss_ratio * decay_rates(string, n)])


def compile_string(
    preset: Preset,
    table: StringTable,
    note: int,
    *,
    quality: str,
    rate_hz: float,
    scheme: str = "exact-hold",
    internal_rate_hz: float | None = None,
    note_hz: np.ndarray | None = None,
    only_notes: Set[int] | None = None,
) -> CompiledString:
    """One physical string of a preset with all its positions, or those of `only_notes`. Raises PresetError naming the
    string."""
    label = table.name or midi_to_note(note)
    try:
        gain = db_to_gain(preset.output.gain_db) * db_to_gain(at_note(table.gain_db, note))
        frequency = note_frequency(preset, table, note, note_hz)
        opened, whole = open_string(preset, table, note, note_hz)
        length, kind = opened.length_m, string_kind(preset, opened, whole)
        soft = isinstance(preset.obstacle, PointContacts) and preset.obstacle.layer is not None
        if soft and scheme != "exact-hold":
            raise PresetError(
                f"{preset.name}: obstacle.layer: soft contacts need exact-hold, got {scheme}; leave out one of the two"
            )
        if preset.coupled:  # in steps that divide a block of frames evenly
            if scheme != "exact-hold":
                raise PresetError(
                    f"{preset.name}: strings that share a body need exact-hold, got {scheme}; leave out one of the two"
                )
        board = measured = None
        under = obstacle_under(preset, table, note)
        if isinstance(under, BoardObstacle):
            board = string_board(preset, under, opened, gain)
        elif scheme == "exact-hold" and internal_rate_hz is None:
            measured = measured_of(preset, table, note, frequency, quality, rate_hz)
        error = ""
        if preset.coupled and measured is None:
            steps, error = choose_steps(frequency, kind, quality, rate_hz, internal_rate_hz)
            internal_rate_hz = steps * rate_hz
        positions = []
        places = string_places(preset, table, note)
        for fret in range(places):
            if only_notes is not None and note + fret not in only_notes:
                continue
            string, obstacle, height = speaking_string(preset, table, note, fret, opened, whole, note_hz)
            plan = None
            if measured is not None:
                plan = measured_plan(string, len(obstacle), kind, measured, quality=quality, rate_hz=rate_hz)
            elif board is not None:
                plan = board_plan(preset, opened, string.length_m, quality, rate_hz, scheme, internal_rate_hz)
            if plan is None:
                plan = plan_string(
                    string,
                    frequency,
                    len(obstacle),
                    kind,
                    quality=quality,
                    rate_hz=rate_hz,
                    scheme=scheme,
                    internal_rate_hz=internal_rate_hz,
                )
            positions.append(
                compile_position(
                    preset,
                    string,
                    obstacle,
                    plan,
                    note=note + fret,
                    fret=fret,
                    open_length_m=length,
                    rest_height_m=height,
                    gain=gain,
                )
            )
        if error:
            positions = [replace(each, plan=replace(each.plan, error=error)) for each in positions]
    except PresetError:
        raise
    except ValueError as error:
        raise PresetError(f"{preset.name}: string {label}: {in_file_words(str(error), table)}") from None
    pluck = preset.pluck
    return CompiledString(
        name=label,
        open_note=note,
        places=places,
        open_length_m=length,
        positions=tuple(positions),
        pluck_force_n=full_pluck_force(preset, table, opened, note),
        draw_s=1e-3 * at_note(pluck.draw_ms, note),
        slip_s=1e-3 * at_note(pluck.slip_ms, note),
        hard_slip_s=1e-3 * at_note(pluck.hardest_slip_ms, note),
        release_s=at_note(preset.damping.release_s, note),
        pluck_shift=pluck_shift(preset, table, note),
        impedance_kg_s=opened.impedance_kg_s,
        axial_stiffness_n=axial_stiffness(preset, table, note) if table.tension_modulation else 0.0,
        friction=preset.obstacle.friction if isinstance(preset.obstacle, PointContacts) else 0.0,
        board=board,
        choir=table.choir,
        sympathetic=table.sympathetic,
        elsewhere=table.sounds is not None,
        pan=at_note(table.pan, note),
        flux_bend=1e3 / (gain * preset.output.distance_mm) if preset.output.kind == "flux" else 0.0,
    )


# its matrices are small: BLAS's threads would only wait for each other, for seconds where the machine is busy
@threadpool_limits.wrap(limits=1, user_api="blas")
def compile_preset(
    preset: Preset,
    *,
    quality: str = "standard",
    rate_hz: float = 44100.0,
    scheme: str = "exact-hold",
    internal_rate_hz: float | None = None,
    note_hz: np.ndarray | None = None,
    only_notes: Set[int] | None = None,
    every_fret: bool = True,
    made: dict[tuple, CompiledString] | None = None,
    progress: Callable[[int], None] | None = None,
) -> CompiledPart:
    """All strings of a preset; `only_notes` leaves out strings none of whose notes is wanted, and, unless `every_fret`,
    positions too; of one whose articulations go through others, none.

    made: strings of earlier calls that differ in `only_notes` at most, which are not made again; new ones are added.
    progress: called with the number of strings after each of them.
    """
    made = {} if made is None else made
    strings = []
    ends = wanted_notes(preset, only_notes)
    every_fret = every_fret or roams(preset)
    for number, note in ends:
        wanted = None if every_fret or only_notes is None else frozenset(only_notes)
        if preset.coupled and wanted is not None:
            wanted |= {note}  # open, it sounds with the others
        key = id(preset), number, note, wanted
        if key not in made:
            made[key] = compile_string(
                preset,
                preset.string[number],
                note,
                quality=quality,
                rate_hz=rate_hz,
                scheme=scheme,
                internal_rate_hz=internal_rate_hz,
                note_hz=note_hz,
                only_notes=wanted,
            )
        strings.append(made[key])
        if progress is not None:
            progress(len(strings))
    body = None
    if preset.coupled and ends:
        body = soundboard(preset, [(preset.string[number], note) for number, note in ends], rate_hz)
    return CompiledPart(preset, tuple(strings), body)


def second_direction(preset: Preset, string: CompiledString) -> CompiledString:
    """A string's motion at right angles to its first: its modes, detuned and damped, which touch nothing, or rub.

    On rigid ends its output is that of the first, times `Polarisation.share_heard`; a pickup hears its velocity alone.
    """
    across = preset.polarisation
    assert across is not None
    if string.friction > 0.0:
        return _rubbing_direction(across, string)
    pickup, heard = preset.output.kind == "pickup", 1.0 if preset.coupled else across.share_heard
    positions = []
    for each in string.positions:
        n, law = each.own, law_of(each.plan.scheme)
        (omega, sigma), none = each.across, np.zeros((0, 0))
        positions.append(
            replace(
                each,
                omega=omega,
                sigma=sigma,
                coef=coefficients(law, omega, sigma, each.mu, 1.0 / each.plan.rate_hz),
                shapes=np.zeros((0, n)),
                eta=np.zeros(0),
                residual=none,
                matrix=none,
                wq=(0.0 if pickup else heard) * each.wq[:n],
                wv=heard * each.wv[:n],
                q_rest=np.zeros(n),
                rest_height_m=0.0,
                output_rest=0.0,
                leverage=np.zeros(0),
                layers=np.zeros((3, 0)),
            )
        )
    return replace(string, positions=tuple(positions))


def _rubbing_direction(across: Polarisation, string: CompiledString) -> CompiledString:
    """`second_direction` of a string with friction: at the contacts of the first, which only that one presses."""
    ratio, positions = 2.0 ** (across.detuning_cents / 1200.0), []
    for each in string.positions:
        law = law_of(each.plan.scheme)
        omega = np.append(each.across[0], ratio * each.omega[each.own :])
        sigma = np.append(each.across[1], across.loss_ratio * each.sigma[each.own :])
        coef, matrix = coefficients(law, omega, sigma, each.mu, 1.0 / each.plan.rate_hz), np.empty_like(each.matrix)
        contact_matrix(law, coef, each.shapes, each.residual, matrix)
        changed: dict[str, Any] = {"omega": omega, "sigma": sigma, "coef": coef, "matrix": matrix}
        changed |= {"eta": np.full(each.eta.size, _OUT_OF_REACH_M), "q_rest": np.zeros(omega.size)}
        changed |= {"rest_height_m": 0.0, "output_rest": 0.0}
        positions.append(replace(each, **changed, layers=np.zeros((3, 0))))
    return replace(string, positions=tuple(positions))


def roams(preset: Preset) -> bool:
    """Whether some of a preset's articulations need the whole of its strings."""
    return any(each.roams for each in preset.articulations.values())


def wanted_notes(preset: Preset, only_notes: Set[int] | None) -> list[tuple[int, int]]:
    """(number of its table, open note) of every string that one of the notes is played on; None: of all. Where strings share
    a body, or a note may need others than its own, all of them as soon as one is played."""
    every = [(number, note) for number, table in enumerate(preset.string) for note in string_notes(table)]
    if only_notes is None:
        return every
    played = [
        (number, note)
        for number, note in every
        if not preset.string[number].sympathetic
        and any(n in only_notes for n in range(note, note + fret_count(preset, preset.string[number]) + 1))
    ]
    return every if played and (preset.coupled or roams(preset)) else played


def describe_plan(
    preset: Preset,
    note: int | None = None,
    *,
    quality: str = "standard",
    rate_hz: float = 44100.0,
    scheme: str = "exact-hold",
    internal_rate_hz: float | None = None,
) -> dict[str, Any]:
    """What `quality` means for a preset, as plain values and as `text`.

    note: a MIDI note, or None for the lowest, middle and highest open string of every string table. Raises PresetError.
    """
    rows: list[dict[str, Any]] = []
    for table in preset.string:
        opens = string_notes(table)
        neck = fret_count(preset, table)
        if note is None:
            wanted = sorted({opens[0], opens[len(opens) // 2], opens[-1]})
        elif table.sympathetic:
            wanted = []
        else:
            wanted = [opened for opened in opens if opened <= note <= opened + neck]
        for opened in wanted:
            string = compile_string(
                preset,
                table,
                opened,
                quality=quality,
                rate_hz=rate_hz,
                scheme=scheme,
                internal_rate_hz=internal_rate_hz,
            )
            for position in string.positions:
                if position.note != (opened if note is None else note):
                    continue
                plan = position.plan
                rows.append(
                    {
                        "string": string.name,
                        "note": midi_to_note(position.note),
                        "sympathetic": string.sympathetic,
                        "fret": position.fret,
                        "frequency_hz": float(position.omega[0]) / (2.0 * math.pi),
                        "tension_n": position.tension_n,
                        "length_m": position.length_m,
                        "internal_rate_hz": plan.rate_hz,
                        "factor": plan.factor,
                        "modes": plan.modes,
                        "contacts": plan.contacts,
                        "plan": "measured" if plan.measured else "law",
                        "error": plan.error,
                        "kept_in": KEPT,
                        "reason": plan.reason,
                    }
                )
    if not rows:
        assert note is not None
        low, high = playable_range(preset)
        raise PresetError(
            f"{preset.name}: no string plays {midi_to_note(note)}; its notes lie in {midi_to_note(low)}-{midi_to_note(high)}"
        )
    head = f"{preset.name} at {quality}, {scheme}, {rate_hz:g} Hz out"
    lines = [
        f"  {row['string']} {row['note']}"
        + (f" fret {row['fret']}" if row["fret"] else "")
        + (" (sympathetic)" if row["sympathetic"] else "")
        + f": {row['reason']}"
        for row in rows
    ]
    by_law = [row for row in rows if row["plan"] == "law" and row["contacts"]]
    if by_law and plannable(preset) and quality in PROMISED and scheme == "exact-hold" and internal_rate_hz is None:
        lines.append(f"  {_why_by_law(preset)}")
    return {
        "preset": preset.name,
        "quality": quality,
        "scheme": scheme,
        "rate_hz": rate_hz,
        "strings": rows,
        "text": "\n".join([head, *lines]),
    }


def _why_by_law(preset: Preset) -> str:
    """Why strings of a preset that could be measured are planned by the law."""
    known, law = preset.measured, "by the law for all strings"
    if not known.strings:
        return f"{law}; --measure-plan measures these, and keeps the plan beside the preset"
    strings = ((table, note) for table in preset.string for note in string_notes(table))
    now = {fingerprint(preset, table, note) for table, note in strings if has_plan(preset, table, note)}
    if known.version != VERSION or not now <= {each.fingerprint for each in known.strings}:
        return f"{law}: the plan beside the preset was measured for another version of it; --measure-plan makes a new one"
    if not known.strokes.issuperset(strokes(preset)):
        return f"{law}: the plan beside the preset does not cover all of its strokes; --measure-plan makes a new one"
    return f"{law}: no cheaper plan keeps the promise with a margin"
