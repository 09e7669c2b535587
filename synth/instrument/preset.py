"""Presets: one TOML file per instrument, in luthiers' and musicians' units, validated with all errors at once.

Numbers that change over the compass (a harp's lengths, a tanpura's gauges) may be given as anchors instead of one
value, ``length_m = { E1 = 1.1, C4 = 0.6, C7 = 0.12 }``: between anchors they are interpolated over the note, as ratios
where all are positive, else linearly; beyond the outer anchors the nearest holds.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    PrivateAttr,
    SerializeAsAny,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_validator,
)

from synth.files.sources import read_bytes
from synth.instrument import effects, excitations
from synth.instrument.articulations import Articulation, Hand, switching_problems
from synth.instrument.effects import EffectTable, as_effect
from synth.instrument.excitations import ExcitationTable, as_excitation
from synth.instrument.faults import value_got, wanted
from synth.instrument.fields import Note, NoteRange, Scaled, anchors, each_within, within
from synth.instrument.fields import at_note as at_note
from synth.instrument.planfile import MeasuredPlan, PlanError, read_beside
from synth.instrument.resonances import Peak, single_peaks
from synth.instrument.setup_table import ACTION_FRET, Setup, fault
from synth.instrument.table import Table, written_value
from synth.physics.mode_field import FieldMode, field_modes
from synth.spelling import perhaps
from synth.units import midi_to_note

FORMAT = 2
#: points of a curved bridge
MOST_BRIDGE_POINTS = 32
#: largest preset that is read [bytes]
MOST_BYTES = 1 << 20


#: names that the physics has, and the keys of the file that stand for them
_FILE_KEYS = {
    "core_diameter_m": "core_diameter_mm",
    "winding_diameter_m": "winding_diameter_mm",
    "diameter_m": "diameter_mm",
}


class PresetError(ValueError):
    """A preset that cannot be used; the message names the file and every wrong field. A ValueError.

    Parameters
    ----------
    message : str
        What is wrong, a line for each field.
    problems : sequence of (str, str)
        Path such as "pluck.position" and what is wrong with it, of each; empty where no field is to blame. An attribute,
        too.

    Examples
    --------
    >>> import synth
    >>> try:
    ...     synth.load_preset("tanpura").with_setting("pluck.position", "2")
    ... except synth.PresetError as error:
    ...     print(error.problems[0][0])
    pluck.position
    """

    def __init__(self, message: str, problems: Sequence[tuple[str, str]] = ()) -> None:
        super().__init__(message)
        self.problems = tuple(problems)


class Tuning(Table):
    """What pitch a note has."""

    a4_hz: float = Field(440.0, ge=300.0, le=600.0)
    offset_cents: float = Field(0.0, ge=-1200.0, le=1200.0)
    #: how far the contact raises the sounding fundamental [cents], by note; subtracted from the string's own pitch
    contact_cents: Annotated[dict[int, float], BeforeValidator(anchors), within(-1200.0, 1200.0)] | None = None
    #: the same of strings that nobody plays
    sympathetic_cents: Annotated[dict[int, float], BeforeValidator(anchors), within(-1200.0, 1200.0)] | None = None


#: most modes of a body, and of a nut
MOST_MODES = 1000


class ModeOrField(Table):
    """A mode, or with `to_hz` and `spacing_hz` a field of modes from its frequency on (`physics.mode_field`)."""

    frequency_hz: float = Field(gt=0.0, le=20000.0)
    q: float = Field(gt=0.0, le=10000.0)
    #: a field reaches up to here, its modes this far apart in the mean; which ones, the seed says
    to_hz: float | None = Field(None, gt=0.0, le=20000.0)
    spacing_hz: float | None = Field(None, gt=0.0, le=20000.0)
    seed: int = Field(0, ge=0, le=2**31 - 1)

    @model_validator(mode="after")
    def _whole_field(self) -> ModeOrField:
        if (self.to_hz is None) != (self.spacing_hz is None):
            raise ValueError("to_hz and spacing_hz make a field of modes together: give both or neither")
        if self.seed and self.to_hz is None:
            raise ValueError(
                f"seed chooses the modes of a field, got {self.seed} without to_hz and spacing_hz: leave it out"
            )
        self.field()
        return self

    def field(self) -> tuple[FieldMode, ...] | None:
        """Its modes; None where it is a single one. Raises ValueError."""
        if self.to_hz is None or self.spacing_hz is None:
            return None
        return field_modes(self.frequency_hz, self.to_hz, self.spacing_hz, self.q, self.seed)


def counted(entries: Sequence[ModeOrField]) -> int:
    """How many modes these are, those of fields one by one."""
    return sum(1 if (field := each.field()) is None else len(field) for each in entries)


def _require_few(key: str, entries: Sequence[ModeOrField]) -> None:
    """Raises ValueError where these are more than `MOST_MODES`."""
    if (count := counted(entries)) > MOST_MODES:
        raise ValueError(
            f"{key}: there may be {MOST_MODES} modes, those of fields counted one by one, got {count}; "
            "take a wider spacing_hz"
        )


class NutMode(ModeOrField):
    """One resonance of the nut end's mobility, or a field of them."""

    mass_kg: float = Field(gt=0.0, le=1000.0)


class StringTable(Table):
    """One string, or one string for every note of a range."""

    name: str = ""
    notes: NoteRange
    length_m: Annotated[Scaled, within(0.02, 5.0)]
    diameter_mm: Annotated[Scaled, within(0.05, 6.0)]
    linear_density_g_m: Annotated[Scaled, within(0.01, 200.0)] | None = None
    density_kg_m3: Annotated[Scaled, within(500.0, 20000.0)] | None = None
    core_diameter_mm: Annotated[Scaled, within(0.02, 5.0)] | None = None
    winding_diameter_mm: Annotated[Scaled, within(0.01, 3.0)] | None = None
    youngs_modulus_gpa: Annotated[Scaled, within(0.0, 1000.0)] | None = None
    inharmonicity: Annotated[Scaled, within(0.0, 0.1)] | None = None
    viscoelastic_loss: Annotated[Scaled, within(0.0, 0.5)] = 0.0
    thermoelastic_q_inverse: Annotated[Scaled, within(0.0, 0.1)] = 0.0
    stiffness_law: Literal["sqrt", "linear"] = "sqrt"
    #: how far partials above the first lie off that law, as its mass is uneven: root mean square, open
    unevenness_cents: Annotated[Scaled, within(0.0, 10.0)] = 0.0
    #: whether its own motion raises its tension, and by how many newtons doubling its length would (EA), where that is not
    #: its modulus times its (core's) section: less where it stretches behind nut and saddle, too
    tension_modulation: bool = False
    axial_stiffness_n: Annotated[Scaled, within(1.0, 1e6)] | None = None
    cents: float = Field(0.0, ge=-2400.0, le=2400.0)
    #: a key sounds one string of every choir that has its note
    choir: int = Field(1, ge=1, le=4)
    #: where it is plucked, as a share of its open length, where that is not the pluck's position
    pluck_position: Annotated[Scaled, within(0.02, 0.5)] | None = None
    #: what it sounds, where `notes` is another key that plays it
    sounds: Note | None = None
    #: it rings with the others and no key plays it
    sympathetic: bool = False
    #: how many of the neck's frets, and of the bridge's points from the saddle on, are under it; all where not given
    frets: int | None = Field(None, ge=0, le=36)
    bridge_points: int | None = Field(None, ge=0, le=MOST_BRIDGE_POINTS)
    gain_db: Annotated[Scaled, within(-60.0, 24.0)] = 0.0
    #: from where it is heard, where strings share no body (−1 left … 1 right)
    pan: Annotated[Scaled, within(-1.0, 1.0)] = 0.0
    #: where on the bridge it ends, from its middle; which way it moves when it is plucked, from the normal of the body
    place_mm: Annotated[Scaled, within(-500.0, 500.0)] = 0.0
    angle_deg: Annotated[Scaled, within(-90.0, 90.0)] = 0.0
    measured_frequencies_hz: Annotated[tuple[float, ...], each_within(0.1, 1e6)] = ()
    measured_decay_rates: Annotated[tuple[float, ...], each_within(1e-9, 1e7)] = ()

    @model_validator(mode="after")
    def _consistent(self) -> StringTable:
        if self.notes[1] < self.notes[0]:
            raise ValueError(
                f"notes must go from low to high, got {midi_to_note(self.notes[0])}-{midi_to_note(self.notes[1])}"
            )
        for key, given in (("sympathetic", self.sympathetic), ("sounds", self.sounds is not None)):
            if given and self.notes[0] != self.notes[1]:
                low, high = (midi_to_note(note) for note in self.notes)
                raise ValueError(f"{key} applies to a single string, got notes {low}-{high}; give one note")
        for key in ("sounds", "frets"):
            if self.sympathetic and getattr(self, key) is not None:
                raise ValueError(f"{key} has no meaning for a sympathetic string, which no key plays: leave it out")
        if (self.linear_density_g_m is None) == (self.density_kg_m3 is None):
            raise ValueError("give either linear_density_g_m or density_kg_m3 (of a plain string)")
        if (self.youngs_modulus_gpa is None) == (self.inharmonicity is None):
            raise ValueError("give either youngs_modulus_gpa or inharmonicity")
        if (self.core_diameter_mm is None) != (self.winding_diameter_mm is None):
            raise ValueError("a wound string has both core_diameter_mm and winding_diameter_mm")
        if self.axial_stiffness_n is not None and not self.tension_modulation:
            raise ValueError("axial_stiffness_n has an effect only with tension_modulation = true; give both or neither")
        if self.tension_modulation and self.axial_stiffness_n is None:
            if self.youngs_modulus_gpa is None:
                raise ValueError(
                    "tension_modulation needs the string's resistance to stretching: give axial_stiffness_n, or "
                    "youngs_modulus_gpa in place of inharmonicity"
                )
            moduli = self.youngs_modulus_gpa
            if min(moduli.values() if isinstance(moduli, dict) else (moduli,)) <= 0.0:
                raise ValueError("tension_modulation needs a youngs_modulus_gpa above 0, got 0; or give axial_stiffness_n")
        return self


class Layer(Table):
    """What is soft on every contact of an obstacle: a spring and a dashpot, as deep as it is thick; then it is rigid."""

    stiffness_n_mm: Annotated[Scaled, within(1e-3, 1e6)]
    resistance_n_s_m: Annotated[Scaled, within(0.0, 1e4)] = 0.0
    #: the heights are those of its surface
    thickness_um: Annotated[Scaled, within(0.1, 10000.0)]


class NoObstacle(Table):
    kind: Literal["none"] = "none"


class BridgeObstacle(Table):
    """A bridge that the string may touch before its end: at an edge before the thread (jiva), or along a curve."""

    kind: Literal["bridge"]
    #: from the saddle end to the point of contact, as mm or as a share of the open length
    distance_mm: Annotated[Scaled, within(0.2, 100.0)] | None = None
    distance_ratio: float | None = Field(None, gt=0.0, le=0.2)
    #: gap between the string at rest and the contact, by a thread its height; negative presses the string
    jiva_um: Annotated[Scaled, within(-100.0, 1000.0)] = 0.0
    #: a curved bridge: so many points, evenly from the saddle to `distance`, on an arc that falls away from the string there
    points: int = Field(1, ge=1, le=MOST_BRIDGE_POINTS)
    radius_mm: float = Field(900.0, ge=1.0, le=1e5)
    #: semitones at which a neck stops strings, which are clear of its frets else
    frets: int = Field(0, ge=0, le=36)
    #: thread, felt, skin: soft, in front of what is rigid
    layer: Layer | None = None
    #: of a string that moves in two directions: the share of the force that presses it which holds it back along the contact
    friction: float = Field(0.0, ge=0.0, le=5.0)

    @model_validator(mode="after")
    def _one_distance(self) -> BridgeObstacle:
        if (self.distance_mm is None) == (self.distance_ratio is None):
            raise ValueError("give either distance_mm or distance_ratio")
        return self

    @property
    def has_thread(self) -> bool:
        """Whether the string ends on a thread before an edge; else its end lies on the bridge's curve."""
        return self.points == 1


class PointsObstacle(Table):
    """Any set of points below the string; positions counted from the nut of the open string."""

    kind: Literal["points"]
    positions_mm: Annotated[tuple[float, ...], each_within(1e-6, 5000.0)] = Field(min_length=1, max_length=64)
    heights_mm: Annotated[tuple[float, ...], each_within(-200.0, 50.0)]
    #: thread, felt, skin: soft, in front of what is rigid
    layer: Layer | None = None
    #: of a string that moves in two directions: the share of the force that presses it which holds it back along the contact
    friction: float = Field(0.0, ge=0.0, le=5.0)

    @model_validator(mode="after")
    def _same_length(self) -> PointsObstacle:
        if len(self.positions_mm) != len(self.heights_mm):
            raise ValueError(
                "positions_mm and heights_mm must have the same length, got "
                f"{len(self.positions_mm)} and {len(self.heights_mm)}"
            )
        for point, (before, after) in enumerate(pairwise(self.positions_mm), start=2):
            if after <= before:
                raise ValueError(f"positions_mm must rise, got {before:g} and {after:g} at point {point}; sort the points")
        return self


_ONE_OF_TWO = "give either action_12th_mm (with relief_mm, nut_height_mm) or heights_mm"


class FretsObstacle(Table):
    """A neck: frets by luthiers' numbers, or the heights of every fret below the open string at rest; neither where [setup]
    has the numbers."""

    kind: Literal["frets"]
    count: int = Field(ge=1, le=36)
    action_12th_mm: float | None = Field(None, gt=0.0, le=20.0)
    relief_mm: float = Field(0.0, ge=0.0, le=5.0)
    nut_height_mm: float = Field(0.4, gt=0.0, le=5.0)
    heights_mm: Annotated[tuple[float, ...], each_within(-200.0, 50.0)] = ()
    #: a hill beside the nut that open strings buzz on (sawari): from the nut, and the gap below the string at rest
    sawari_distance_mm: float | None = Field(None, gt=0.0, le=200.0)
    sawari_um: Annotated[Scaled, within(-100.0, 1000.0)] | None = None
    #: thread, felt, skin: soft, in front of what is rigid
    layer: Layer | None = None
    #: of a string that moves in two directions: the share of the force that presses it which holds it back along the contact
    friction: float = Field(0.0, ge=0.0, le=5.0)

    @model_validator(mode="after")
    def _one_way(self) -> FretsObstacle:
        if self.action_12th_mm is not None and self.heights_mm:
            raise ValueError(_ONE_OF_TWO)
        if self.heights_mm and len(self.heights_mm) != self.count:
            raise ValueError(f"heights_mm needs one height per fret, got {len(self.heights_mm)} for {self.count}")
        if (self.sawari_distance_mm is None) != (self.sawari_um is None):
            raise ValueError("a sawari has both sawari_distance_mm and sawari_um")
        if self.action_12th_mm is not None and self.count < ACTION_FRET:
            raise ValueError(
                f"count must be at least 12 for an action at fret 12, got {self.count}; give heights_mm instead"
            )
        return self


class BoardObstacle(Table):
    """A fingerboard without frets: an elastic surface along the string, on which a finger stops it anywhere."""

    kind: Literal["board"]
    #: how many semitones above the open string notes are stopped
    semitones: int = Field(24, ge=1, le=36)
    #: where the board ends, from the nut; fingers go no further
    length_mm: float = Field(gt=0.0, le=5000.0)
    #: clearance under the open string half way along it, and at the nut; hollow half way along the board. [setup] may have
    #: these numbers, else the action is needed
    action_12th_mm: float | None = Field(None, gt=0.0, le=20.0)
    nut_height_mm: float = Field(0.3, gt=0.0, le=5.0)
    relief_mm: float = Field(0.0, ge=0.0, le=5.0)
    #: force per millimetre of string for each millimetre that it is pressed in, and what a blow keeps of its speed
    stiffness_n_mm2: float = Field(100.0, ge=1.0, le=10000.0)
    rebound: float = Field(0.7, ge=0.0, le=1.0)
    #: time constant with which a finger slides to the next note while the legato pedal is down; 0: it is put down there
    slide_ms: float = Field(25.0, ge=0.0, le=1000.0)
    #: what a fingertip takes from the string that it stops: a spring and a dashpot at the end of the speaking length
    tip_stiffness_n_mm: float = Field(100.0, ge=1.0, le=10000.0)
    tip_loss_n_s_m: float = Field(0.5, ge=0.01, le=100.0)


#: what touches at points
PointContacts = BridgeObstacle | PointsObstacle | FretsObstacle
Obstacle = Annotated[NoObstacle | PointContacts | BoardObstacle, Field(discriminator="kind")]
#: keys of a neck or board that [setup] has in their place
NECK_KEYS = ("action_12th_mm", "heights_mm", "relief_mm", "nut_height_mm")


def _refuse_without_setup(shape: Obstacle) -> None:
    """Raises ValueError for a neck or board that nothing gives an action."""
    if isinstance(shape, FretsObstacle) and shape.action_12th_mm is None and not shape.heights_mm:
        raise ValueError(_ONE_OF_TWO)
    if isinstance(shape, BoardObstacle) and shape.action_12th_mm is None:
        raise fault("obstacle.action_12th_mm", "missing")


def _refuse_beside_setup(shape: Obstacle, setup: Setup) -> None:
    """Raises ValueError for an obstacle that does not go with a setup of the neck."""
    if not isinstance(shape, FretsObstacle | BoardObstacle):
        raise fault(
            "setup.action_bass_mm",
            f'needs obstacle.kind = "frets" or "board", which have an action, got {shape.kind!r}; take one of these, or '
            "leave out all of [setup] but strings",
        )
    for key in NECK_KEYS:
        if key in shape.model_fields_set and getattr(shape, key) not in (None, ()):
            raise fault(
                f"obstacle.{key}",
                f"does not go with setup.action_bass_mm, which sets the same neck; leave {key} or [setup] out",
            )
    if isinstance(shape, BoardObstacle):
        for key, given in (("fall_away_mm", setup.fall_away_mm > 0.0), ("fret_heights_mm", bool(setup.fret_heights_mm))):
            if given:
                raise fault(f"setup.{key}", f'has no meaning with obstacle.kind = "board"; leave {key} out')
        return
    if shape.count < ACTION_FRET:
        raise ValueError(
            f"count must be at least {ACTION_FRET} for an action at fret {ACTION_FRET}, got {shape.count}; give heights_mm "
            "in place of [setup]"
        )
    if setup.fret_heights_mm and len(setup.fret_heights_mm) != shape.count:
        raise fault(
            "setup.fret_heights_mm",
            f"needs one height per fret, got {len(setup.fret_heights_mm)} for obstacle.count = {shape.count}; measure "
            "every fret",
        )
    if setup.fall_away_mm > 0.0 and setup.fall_away_fret >= shape.count:
        raise fault(
            "setup.fall_away_fret",
            f"must be less than obstacle.count, which is {shape.count}, got {setup.fall_away_fret}; take a lower fret",
        )


class Pluck(Table):
    """Finger or plectrum. `soft` is velocity 1, `hard` velocity 127."""

    #: distance from the saddle as a share of the open length
    position: float = Field(0.25, gt=0.0, lt=1.0)
    position_hard: float | None = Field(None, gt=0.0, lt=1.0)
    #: displacement of the open string at velocity 127; stopped notes are plucked with the same force
    displacement_mm: Annotated[Scaled, within(0.0, 20.0)]
    #: displacement ∝ (velocity/127)^exponent
    velocity_exponent: float = Field(1.2, ge=0.0, le=4.0)
    width_mm: float = Field(10.0, gt=0.0, le=100.0)
    width_hard_mm: float | None = Field(None, gt=0.0, le=100.0)
    #: time from touching the string to letting it go
    draw_ms: Annotated[Scaled, within(0.5, 100.0)] = 6.0
    finger_stiffness_n_mm: float = Field(50.0, gt=0.0, le=10000.0)
    #: loss of the finger, in units of the string's impedance
    finger_loss: float = Field(0.5, ge=0.0, le=100.0)
    #: time in which the string slides off the finger, softly and hard plucked: its force fades away
    slip_ms: Annotated[Scaled, within(0.0, 20.0)] = 0.0
    slip_hard_ms: Annotated[Scaled, within(0.0, 20.0)] | None = None
    #: how far the finger jumps while it rubs along the string that it draws
    roughness_um: float = Field(0.0, ge=0.0, le=100.0)
    #: rubbing: standard deviation of the finger's force where the string slides off, in parts of that force, for which it
    #: passes over so much of the finger's edge, and how far apart what is rough about it stands
    rub_percent: float = Field(0.0, ge=0.0, le=100.0)
    edge_mm: float = Field(1.0, ge=0.02, le=20.0)
    grain_mm: float = Field(0.1, ge=0.005, le=5.0)
    #: how fast the finger meets the string, in parts of the mean speed with which it draws it; 0: it begins at rest
    arrival: float = Field(0.0, ge=0.0, le=3.0)
    #: how the width goes from soft to hard with the velocity: by equal steps, or by equal ratios, as the slip does
    width_course: Literal["steps", "ratios"] = "steps"

    @property
    def hardest_slip_ms(self) -> float | dict[int, float]:
        """Time of letting go at velocity 127."""
        return self.slip_ms if self.slip_hard_ms is None else self.slip_hard_ms

    @property
    def hardest_position(self) -> float:
        """Share of the open length at velocity 127."""
        return self.position if self.position_hard is None else self.position_hard

    @property
    def hardest_width_mm(self) -> float:
        """Width at velocity 127."""
        return self.width_mm if self.width_hard_mm is None else self.width_hard_mm


class Polarisation(Table):
    """The second direction in which strings move, at right angles to the first."""

    #: how much higher it is tuned, and how much faster it decays
    detuning_cents: float = Field(0.0, ge=-50.0, le=50.0)
    loss_ratio: float = Field(1.0, ge=0.1, le=10.0)
    #: direction of the pluck from that of the string
    pluck_deg: float = Field(30.0, ge=-90.0, le=90.0)
    #: how far the nut's resonances give way in it, in parts of what they do in the first
    nut_share: float = Field(1.0, ge=0.0, le=10.0)
    #: of strings on rigid ends: how much of it the output hears, in parts of what it hears of the first
    heard: float | None = Field(None, ge=-1.0, le=1.0)

    @property
    def share_heard(self) -> float:
        """`heard`, or what it is without."""
        return 0.3 if self.heard is None else self.heard


class Damping(Table):
    """The hand on the string after a note ends."""

    ring_on: bool = False
    #: time to −60 dB after note-off
    release_s: Annotated[Scaled, within(0.01, 60.0)] = 0.15
    #: the same of the other strings on a shared bridge, which a hand covers when the last note ends; without it they ring on
    others_s: float | None = Field(None, ge=0.01, le=60.0)


class Output(Table):
    """What is heard."""

    kind: Literal["force", "displacement", "velocity", "pickup", "flux", "body"] = "force"
    #: from the saddle, as a share of the open length; 0 is the saddle itself
    position: float = Field(0.0, ge=0.0, lt=1.0)
    #: pickup and flux: distance of the magnet from the string at rest, and length of string it sees
    distance_mm: float = Field(3.0, gt=0.1, le=50.0)
    aperture_mm: float = Field(10.0, gt=0.0, le=100.0)
    #: level; presets are set so that all are equally loud (`tools/loudness`)
    gain_db: float = Field(0.0, ge=-200.0, le=200.0)

    @property
    def magnetic(self) -> bool:
        """Whether it is a magnet that hears: the voltage of its coil, or the flux through it."""
        return self.kind in ("pickup", "flux")


class BodyMode(ModeOrField):
    """One resonance of the filter behind the strings, or a field of them (`instrument.resonances`)."""

    frequency_hz: float = Field(gt=10.0, le=20000.0)
    q: float = Field(ge=1.0, le=1000.0)
    #: at the peak; of a field the root mean square of its response
    gain_db: float = Field(ge=-120.0, le=60.0)
    #: from where it is heard (−1 left … 1 right); of a field the farthest of them
    pan: float = Field(0.0, ge=-1.0, le=1.0)


class MovingMode(ModeOrField):
    """One mode of the body that the strings share by their bridge, or a field of them.

    Of a field, shape and radiation are what the single modes have in the root mean square, and pan is the farthest of them.
    """

    frequency_hz: float = Field(ge=5.0, le=20000.0)
    q: float = Field(gt=0.5, le=10000.0)
    #: at the point of the bridge from which `place_mm` of the strings is counted
    mass_kg: float = Field(ge=1e-4, le=1000.0)
    #: how the bridge moves with it: normal to the body, along it across the strings, and rocking per metre of place
    shape: Annotated[tuple[float, ...], each_within(-100.0, 100.0)] = Field((1.0,), min_length=1, max_length=3)
    #: how much of its acceleration is heard, of either sign, and from where (−1 left … 1 right)
    radiation: float = Field(1.0, ge=-1000.0, le=1000.0)
    pan: float = Field(0.0, ge=-1.0, le=1.0)

    @model_validator(mode="after")
    def _moves_the_bridge(self) -> MovingMode:
        if not any(self.shape):
            raise ValueError(f"shape must move the bridge, got {list(self.shape)}; leave out a mode that does not")
        return self


class Body(Table):
    """What the strings are fixed to: a filter on their sound (`resonance`), or modes that move with them (`mode`)."""

    #: level of the direct sound beside the filter's resonances
    direct_db: float = Field(0.0, ge=-120.0, le=24.0)
    resonance: tuple[BodyMode, ...] = ()
    #: modes of the body that the strings drive by the bridge, and that drive them
    mode: tuple[MovingMode, ...] = Field((), max_length=256)

    @model_validator(mode="after")
    def _not_too_many(self) -> Body:
        _require_few("mode", self.mode)
        _require_few("resonance", self.resonance)
        return self

    @property
    def wide(self) -> bool:
        """Whether any resonance is heard from a side."""
        return any(peak.pan != 0.0 for peak in self.resonance)

    @property
    def peaks(self) -> tuple[Peak, ...]:
        """All of its resonances, those of fields one by one."""
        return tuple(peak for resonance in self.resonance for peak in single_peaks(resonance))


class Mapping_(Table):
    """How many strings may sound at once, and what pressure on the keys does."""

    polyphony: int = Field(24, ge=1, le=256)
    #: how far the bridge is raised (negative: lowered) under a string at full channel or key pressure
    pressure_um: Annotated[Scaled, within(-200.0, 50.0)] = 0.0
    #: how far the tension of a string rises at full pressure
    pressure_cents: float = Field(0.0, ge=-1200.0, le=1200.0)


#: what presets may be called
NAME_PATTERN = re.compile("[a-z0-9][a-z0-9-]{0,63}")
#: letters of a family or a tag at most, tags at most
WORD_LETTERS = 24
MOST_TAGS = 16
_WORD = re.compile("[a-z0-9]+(-[a-z0-9]+)*")


def _word(value: Any) -> str:
    """A lower-case word by which presets are found. Raises ValueError."""
    if not isinstance(value, str) or len(value) > WORD_LETTERS or not _WORD.fullmatch(value):
        raise ValueError(
            f"must be a word of lower-case letters, digits and hyphens, up to {WORD_LETTERS}, such as bass, got {value!r}"
        )
    return value


def _word_or_none(value: Any) -> str:
    return "" if value == "" else _word(value)


def _tags(values: tuple[str, ...]) -> tuple[str, ...]:
    for number, tag in enumerate(values):
        if tag in values[:number]:
            raise ValueError(f"has {tag!r} twice; leave one out")
    return values


#: a lower-case word
Word = Annotated[str, BeforeValidator(_word)]


class Preset(Table):
    """A whole instrument as its file describes it, validated; made by `load_preset`.

    The keys of every table with unit, range and default: docs/reference/preset-keys.md. Values do not change: `with_setting`
    makes another preset.

    Attributes
    ----------
    format : int
        Of the file, 2.
    name, title, description, family : str
        Name by which it is found, and words on it.
    tags, sources : tuple of str
        Other words by which it is found; where its numbers come from.
    remarks : str
        The author's notes.
    tuning : table
        Concert pitch and what contact does to the pitch.
    string : tuple of tables
        Strings, each with the notes it is tuned to.
    nut, setup, obstacle : tables or None
        Resonances of the neck; what a luthier measures; what the strings touch.
    pluck, hand, excitation, polarisation, damping : tables or None
        How a note begins, varies, moves in two directions and ends.
    articulations : dict
        Other ways to begin a note, by name.
    output, body, effect : tables
        What is heard, through which resonances or modes of a shared body, and effects.
    mapping : table
        How MIDI is played on it.

    Raises
    ------
    pydantic.ValidationError
        For tables that are wrong; `load_preset` and `with_setting` raise `PresetError` in its place.

    Examples
    --------
    >>> import synth
    >>> preset = synth.load_preset("tanpura")
    >>> preset, preset.coupled
    (<Preset tanpura: 4 strings, C2–C3, obstacle bridge>, True)
    >>> preset.with_setting("pluck.position", "0.3").pluck.position
    0.3
    """

    format: Literal[2]
    name: str = Field(pattern=f"^{NAME_PATTERN.pattern}$")
    title: str = ""
    description: str = ""
    #: what sort of instrument it is (bass, guitar, tanpura), "" where that is not given; other words by which it is found
    family: Annotated[str, BeforeValidator(_word_or_none)] = ""
    tags: Annotated[tuple[Word, ...], AfterValidator(_tags)] = Field((), max_length=MOST_TAGS)
    #: the author's notes, of any number of lines
    remarks: str = ""
    sources: tuple[str, ...] = ()
    tuning: Tuning = Tuning()
    string: tuple[StringTable, ...] = Field(min_length=1, max_length=128)
    nut: tuple[NutMode, ...] = ()
    #: what a luthier measures of neck and strings, where the obstacle and the strings do not say it; before the obstacle,
    #: which is judged by it
    setup: Setup | None = None
    obstacle: Obstacle = Field(NoObstacle(), validate_default=True)
    pluck: Pluck
    hand: Hand = Hand()
    #: other ways to begin a note, by name
    articulations: dict[Annotated[str, Field(pattern=f"^{NAME_PATTERN.pattern}$")], Articulation] = Field(
        default_factory=dict
    )
    #: what the hand does at the start of a note, where it does not pluck
    excitation: Annotated[SerializeAsAny[ExcitationTable], BeforeValidator(as_excitation)] | None = None
    #: strings move in two directions
    polarisation: Polarisation | None = None
    damping: Damping = Damping()
    output: Output = Output()
    body: Body = Body()
    #: what the sound goes through behind the body, in this order
    effect: tuple[Annotated[SerializeAsAny[EffectTable], BeforeValidator(as_effect)], ...] = Field((), max_length=16)
    mapping: Mapping_ = Mapping_()

    #: what was measured of its strings; whether that is still so, their fingerprints tell
    _measured: MeasuredPlan = PrivateAttr(default_factory=MeasuredPlan)

    @property
    def measured(self) -> MeasuredPlan:
        """What was measured of strings of this preset, as they are or as they were."""
        return self._measured

    def with_measured(self, plan: MeasuredPlan) -> Preset:
        """The same preset, with a plan that was measured."""
        other = self.model_copy()
        other._measured = plan
        return other

    def __repr__(self) -> str:
        """One line: the tables may be pages."""
        notes = f"{midi_to_note(playable_range(self)[0])}–{midi_to_note(playable_range(self)[1])}"
        count = sum(high - low + 1 for low, high in (table.notes for table in self.string))
        return f"<Preset {self.name}: {count} string{'' if count == 1 else 's'}, {notes}, obstacle {self.obstacle.kind}>"

    __str__ = __repr__

    @field_validator("obstacle")
    @classmethod
    def _one_action(cls, shape: Obstacle, others: ValidationInfo) -> Obstacle:
        if "setup" in others.data:  # else it is wrong itself, which is said
            setup = others.data["setup"]
            if setup is not None and setup.shapes_the_neck:
                _refuse_beside_setup(shape, setup)
            else:
                _refuse_without_setup(shape)
        return shape

    @model_validator(mode="after")
    def _a_name_for_every_string(self) -> Preset:
        if self.setup is not None and self.setup.strings:
            played = sum(high - low + 1 for low, high in (table.notes for table in self.string if not table.sympathetic))
            if len(self.setup.strings) != played:
                raise fault(
                    "setup.strings",
                    f"must name {played} string{'' if played == 1 else 's'}, one for each that is played, from the lowest "
                    f"to the highest, got {len(self.setup.strings)}",
                )
        return self

    @model_validator(mode="after")
    def _articulations_are_reached(self) -> Preset:
        problems = switching_problems(self.articulations, playable_notes(self))
        if problems:
            raise ValueError("; ".join(f"{place}: {what}" for place, what in problems))
        return self

    @model_validator(mode="after")
    def _pressure_moves_a_bridge(self) -> Preset:
        if self.mapping.pressure_um != 0.0 and not isinstance(self.obstacle, BridgeObstacle):
            raise ValueError(
                'mapping.pressure_um needs obstacle.kind = "bridge", as it moves the bridge; leave it out otherwise'
            )
        return self

    @model_validator(mode="after")
    def _hands_reach_a_body_that_moves(self) -> Preset:
        for key, given in (("hand.knock", self.hand.knock), ("damping.others_s", self.damping.others_s)):
            if given is not None and not self.body.mode:
                raise ValueError(f"{key} needs a body that strings share; give [[body.mode]], or leave {key} out")
        return self

    @model_validator(mode="after")
    def _a_nut_has_not_too_many_modes(self) -> Preset:
        _require_few("nut", self.nut)
        return self

    @model_validator(mode="after")
    def _sympathetic_strings_ring_by_a_bridge(self) -> Preset:
        along = [number for number, table in enumerate(self.string) if table.sympathetic]
        if along and not self.body.mode:
            raise ValueError(
                f"string.{along[0]}.sympathetic: a sympathetic string needs a bridge shared with others; "
                "give [[body.mode]], or leave sympathetic out"
            )
        if len(along) == len(self.string):
            raise ValueError("string: all strings are sympathetic, and no key plays one; leave sympathetic out for some")
        return self

    @model_validator(mode="after")
    def _strings_have_what_the_neck_and_the_bridge_have(self) -> Preset:
        points = self.obstacle.points if isinstance(self.obstacle, BridgeObstacle) else 0
        for number, table in enumerate(self.string):
            for key, most, whose in (("frets", fret_count(self), "the neck"), ("bridge_points", points, "the bridge")):
                given = getattr(table, key)
                if given is not None and given > most:
                    raise ValueError(
                        f"string.{number}.{key} must be at most {most}, the number that {whose} has, got {given}; take fewer"
                    )
        return self

    @model_validator(mode="after")
    def _body_that_moves_is_heard(self) -> Preset:
        if bool(self.body.mode) != (self.output.kind == "body"):
            raise ValueError(
                'output.kind = "body" and [[body.mode]] need each other: strings that share a body are heard through it'
            )
        if self.body.mode and self.body.resonance:
            raise ValueError("body.resonance is for strings with fixed ends: leave it out beside [[body.mode]]")
        return self

    @model_validator(mode="after")
    def _a_board_is_under_strings_of_their_own(self) -> Preset:
        if isinstance(self.obstacle, BoardObstacle) and self.body.mode:
            raise ValueError(
                'obstacle.kind = "board" needs strings with fixed ends, got [[body.mode]]; leave out one of the two'
            )
        for number, table in enumerate(self.string):
            if isinstance(self.obstacle, BoardObstacle) and table.tension_modulation:
                raise ValueError(
                    f'string.{number}.tension_modulation does not go with obstacle.kind = "board", where a finger follows '
                    "every bend: leave one of them out"
                )
        return self

    @model_validator(mode="after")
    def _a_body_has_one_level(self) -> Preset:
        for number, table in enumerate(self.string):
            for key in ("gain_db", "pan"):
                if self.body.mode and getattr(table, key) != 0.0:
                    raise ValueError(
                        f"string.{number}.{key} has no meaning where strings share a body, which alone is heard: "
                        "leave it out"
                    )
        return self

    @model_validator(mode="after")
    def _friction_needs_two_directions(self) -> Preset:
        if isinstance(self.obstacle, PointContacts) and self.obstacle.friction > 0.0 and self.polarisation is None:
            raise ValueError(
                f"obstacle.friction needs a string that moves in two directions, got {self.obstacle.friction:g} without "
                "[polarisation]: give that table, or leave friction out"
            )
        return self

    @model_validator(mode="after")
    def _two_directions(self) -> Preset:
        if self.polarisation is None:
            return self
        if self.excitation is not None and self.excitation.kind != "pluck":
            raise ValueError('polarisation: only a pluck has a direction; leave it out, or take excitation.kind = "pluck"')
        if self.coupled and self.polarisation.heard is not None:
            raise ValueError(
                f"polarisation.heard has no meaning where strings share a body, which alone is heard, got "
                f"{self.polarisation.heard:g}: leave it out"
            )
        if not self.coupled and isinstance(self.obstacle, BoardObstacle):
            raise ValueError(
                'polarisation: strings over obstacle.kind = "board" move in one direction; leave one of the two out'
            )
        if not self.coupled and isinstance(self.obstacle, PointContacts) and self.obstacle.friction > 0.0:
            raise ValueError(
                f"obstacle.friction needs strings that share a body, got {self.obstacle.friction:g}; "
                "give [[body.mode]], or leave it out"
            )
        return self

    @property
    def coupled(self) -> bool:
        """Whether its strings share a bridge and a body that move."""
        return bool(self.body.mode)

    @property
    def stereo(self) -> bool:
        """Whether left and right are heard apart: of a body that moves, or strings or resonances to the sides."""
        return self.coupled or self.body.wide or self.spread

    @property
    def spread(self) -> bool:
        """Whether any string is heard from a side."""
        return any(table.pan != 0.0 for table in self.string)

    @property
    def on_rigid_ends(self) -> Preset:
        """The same strings, each by itself: what is heard of coupled ones is then their force on the saddle."""
        if not self.coupled:
            return self
        output = self.output.model_copy(update={"kind": "force"})
        changed: dict[str, Any] = {
            "output": output,
            "body": Body(),
            "polarisation": None,
            "hand": self.hand.model_copy(update={"knock": None}),
            "damping": self.damping.model_copy(update={"others_s": None}),
        }
        if isinstance(self.obstacle, PointContacts):
            changed["obstacle"] = self.obstacle.model_copy(update={"friction": 0.0})
        return self.model_copy(update=changed)

    def with_setting(self, key: str, value: str) -> Preset:
        """The preset with one value replaced: `key` is a path such as ``pluck.position`` or ``string.0.notes``.

        `value` is read as TOML where it is TOML, else as text. Raises PresetError.
        """
        data = self.model_dump(exclude_unset=True)
        new = written_value(value)
        place: Any = data
        parts = key.split(".")
        for depth, part in enumerate(parts):
            try:
                if isinstance(place, tuple):
                    place = list(place)
                index: Any = int(part) if isinstance(place, list) else part
                if isinstance(index, int) and index < 0:
                    raise IndexError
                if depth == len(parts) - 1:
                    place[index] = new
                else:
                    child = place.setdefault(index, {}) if isinstance(place, dict) else place[index]
                    if isinstance(child, tuple):
                        child = list(child)
                    place[index] = child
                    place = child
            except (ValueError, IndexError, TypeError, AttributeError):
                raise PresetError(f"{self.name}: no setting {key!r} ({part!r} does not exist)") from None
        return validate_preset(data, f"{self.name} with {key}={value}").with_measured(self.measured)


def parse_preset(text: str, origin: str) -> Preset:
    """A preset from TOML text; `origin` names it in messages. Raises PresetError."""
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise PresetError(f"{origin}: not valid TOML: {error}") from None
    migrate(data, origin)
    return validate_preset(data, origin)


def _to_2(data: dict[str, Any]) -> None:
    data["format"] = 2


#: from each older format to the next: what changes, in words, and what does it in place (to data or a tomlkit document)
MIGRATIONS: dict[int, tuple[str, Callable[[dict[str, Any]], None]]] = {
    1: ("format 2 has remarks, the author's notes", _to_2),
}


def format_of(data: Mapping[str, Any], origin: str) -> int:
    """The format of a preset's data. Raises PresetError for one that is missing or that this program does not read."""
    version = data.get("format")
    if version is None:
        problem = f"missing; a preset begins with format = {FORMAT}"
    elif isinstance(version, bool) or not isinstance(version, int) or version < 1:
        problem = f"must be a whole number from 1 to {FORMAT}, got {version!r}"
    elif version > FORMAT:
        problem = (
            f"{int(version)} is newer than what this program reads, which is 1 to {FORMAT}: install a newer version of it"
        )
    else:
        return int(version)
    raise PresetError(f"{origin}: format: {problem}", [("format", problem)])


def migrate(data: dict[str, Any], origin: str) -> list[str]:
    """Bring the data of an older format to today's, in place; what has changed, in words. Raises PresetError."""
    version = format_of(data, origin)
    words = []
    while version < FORMAT:
        word, step = MIGRATIONS[version]
        step(data)
        words.append(word)
        version += 1
    return words


#: of obstacle
KINDS = ("none", "bridge", "points", "frets", "board")


def validate_preset(data: dict[str, Any], origin: str) -> Preset:
    """A preset from data of today's format. Raises PresetError with all that is wrong."""
    problems: list[tuple[str, str]] = []
    if isinstance(tables := data.get("effect"), list | tuple):
        checked = [_of_its_kind(f"effect.{i}", table, effects.settings_of, problems) for i, table in enumerate(tables)]
        data = {**data, "effect": [table for table in checked if table is not None]}
    if "excitation" in data:
        data = {**data, "excitation": _of_its_kind("excitation", data["excitation"], excitations.settings_of, problems)}
    try:
        preset = Preset.model_validate(data)
    except ValidationError as error:
        problems = _in_words(error, lambda loc: _keys_beside(loc, data)) + problems
    if problems:
        raise PresetError("\n".join(f"{origin}: {place}: {what}" for place, what in problems), problems)
    return preset


def _of_its_kind(place: str, table: Any, settings_of: Callable[[Any], type[Table]], problems: list[tuple[str, str]]) -> Any:
    """A table as its kind's class; None where it cannot be, with what is wrong put to `problems`; no table: as it is."""
    if not isinstance(table, dict):
        return table
    try:
        kind = settings_of(table)
    except ValueError as error:
        problems.append((f"{place}.kind", str(error)))
        return None
    try:
        return kind.model_validate(table)
    except ValidationError as error:
        problems += [(f"{place}.{inner}", what) for inner, what in _in_words(error, _keys_of(kind))]
        return None


def _keys_of(kind: type[Table]) -> Callable[[Sequence[Any]], list[str]]:
    return lambda _: list(kind.model_fields)


def _in_words(error: ValidationError, keys_beside: Callable[[Sequence[Any]], list[str]]) -> list[tuple[str, str]]:
    """(path, what is wrong) of what pydantic has found; `keys_beside`: what there may be where a path leads to."""
    problems = []
    wrong = error.errors()
    for item in wrong:
        # pydantic puts the kind of a table that has several into the path; the file does not
        loc = [part for i, part in enumerate(item["loc"]) if not (i == 1 and item["loc"][0] == "obstacle" and part in KINDS)]
        place = item.get("ctx", {}).get("path") or ".".join(str(part) for part in loc) or "file"
        if item["type"] == "too_short" and any(len(i["loc"]) > 1 and i["loc"][0] == item["loc"][0] for i in wrong):
            continue  # the items are missing because each of them is wrong, which is said already
        message = wanted(item)
        if item["type"] == "extra_forbidden":
            message = message.replace(";", f"{perhaps(str(loc[-1]), keys_beside(loc))};", 1)
        problems.append((place, message + value_got(item, message)))
    return problems


def _keys_beside(loc: Sequence[Any], data: Mapping[str, Any]) -> list[str]:
    """The keys that the table at a path may have."""
    table: Any = Preset
    for part in loc[:-1]:
        if part == "obstacle":
            shape = data.get("obstacle")
            kind = shape.get("kind", "none") if isinstance(shape, Mapping) else "none"
            tables = (NoObstacle, BridgeObstacle, PointsObstacle, FretsObstacle, BoardObstacle)
            table = dict(zip(KINDS, tables, strict=True)).get(kind)
        elif isinstance(part, str) and table is not None and part in table.model_fields:
            inner = table.model_fields[part].annotation
            inner = next(iter(get_args(inner)), inner)  # of a list of tables the table
            table = inner if isinstance(inner, type) and issubclass(inner, Table) else None
    return list(table.model_fields) if table is not None else []


def preset_folder() -> Path:
    """Where the presets that come with the program are: in the installed package, or beside it in a checkout."""
    installed = Path(str(resources.files("synth"))) / "_presets"
    return installed if installed.is_dir() else Path(__file__).resolve().parents[2] / "presets"


def list_presets() -> list[Preset]:
    """The presets that come with the program, each read from its file.

    Returns
    -------
    list of Preset
        In the order of their files' names.

    Raises
    ------
    PresetError
        For a file of the program's that was changed and is wrong.

    Examples
    --------
    >>> import synth
    >>> [preset.name for preset in synth.list_presets() if preset.family == "zither"]
    ['dulcimer', 'koto-hirajoshi', 'koto']
    """
    return [load_preset(str(path)) for path in sorted(preset_folder().glob("*.toml"))]


def preset_path(name_or_path: str | os.PathLike[str]) -> Path:
    """The file of a preset by name (of those that come with the program), or that file; it may be a pipe. Raises PresetError
    where there is none."""
    name_or_path = os.fspath(name_or_path)
    path = Path(name_or_path)
    if path.suffix != ".toml" and (path.is_dir() or not path.exists()):
        path = preset_folder() / f"{name_or_path}.toml"
        if not path.is_file():
            names = [p.stem for p in sorted(preset_folder().glob("*.toml"))]
            near = perhaps(name_or_path, names)
            known = f"the program's own{near}, which `synth presets` lists" if near else ", ".join(names)
            raise PresetError(
                f"preset {name_or_path!r} is not one of {known}; for a file of your own give a path ending in .toml"
            )
    elif not path.exists():
        beside = [p.name for p in path.parent.glob("*.toml")]
        raise PresetError(f"preset file {name_or_path} does not exist{perhaps(path.name, beside)}")
    return path


def read_preset_bytes(name_or_path: str | os.PathLike[str]) -> bytes:
    """A preset as it stands in the file that `preset_path` finds; of a pipe once. Raises PresetError or OSError."""
    return read_bytes(preset_path(name_or_path), MOST_BYTES, "preset")


def preset_text(data: bytes, origin: str) -> str:
    """The text of a preset's file. Raises PresetError."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise PresetError(f"{origin}: not a text file in UTF-8") from None


def read_preset(name_or_path: str | os.PathLike[str]) -> str:
    """The text of a preset as `preset_path` finds it; of a pipe once. Raises PresetError or OSError."""
    return preset_text(read_preset_bytes(name_or_path), os.fspath(name_or_path))


def load_preset(name_or_path: str | os.PathLike[str]) -> Preset:
    """Reads a preset, with the measured plan that lies beside its file.

    Parameters
    ----------
    name_or_path : str or path
        A name among those that come with the program, or a file, whose name ends in .toml; files of an older format are
        brought to today's as they are read.

    Returns
    -------
    Preset
        Validated.

    Raises
    ------
    PresetError
        For a preset that is not there or has faults, all of which it names (a ValueError).
    OSError
        For a file that cannot be read.

    Examples
    --------
    >>> import synth
    >>> synth.load_preset("fretted-bass")
    <Preset fretted-bass: 4 strings, E1–..., obstacle frets>
    """
    return with_plan_beside(parse_preset(read_preset(name_or_path), str(name_or_path)), preset_path(name_or_path))


def with_plan_beside(preset: Preset, path: Path) -> Preset:
    """The preset with the plan that lies beside its file. Raises PresetError where that cannot be read, or OSError."""
    try:
        return preset.with_measured(read_beside(path))
    except PlanError as error:
        raise PresetError(str(error)) from None


def in_file_words(text: str, table: StringTable) -> str:
    """What the physics says of a string, with the keys that the preset's file has for the same things."""
    stiffness = "youngs_modulus_gpa" if table.inharmonicity is None else "inharmonicity"
    density = "density_kg_m3" if table.linear_density_g_m is None else "linear_density_g_m"
    keys = {**_FILE_KEYS, "bending_stiffness_n_m2": stiffness, "linear_density_kg_m": density, "frequency_hz": "its pitch"}
    return re.sub(r"\b(" + "|".join(keys) + r")\b", lambda found: keys[found[0]], text)


def fret_count(preset: Preset, table: StringTable | None = None) -> int:
    """How many frets the neck has, or semitones are stopped on a board; of a string, those under it. 0 without a neck."""
    if table is not None and (table.sympathetic or table.frets is not None):
        return table.frets or 0
    match preset.obstacle:
        case FretsObstacle(count=count) | BoardObstacle(semitones=count) | BridgeObstacle(frets=count):
            return count
        case _:
            return 0


def playable_range(preset: Preset) -> tuple[int, int]:
    """Lowest and highest MIDI note that the preset's strings can be asked for."""
    played = [table for table in preset.string if not table.sympathetic]
    return min(table.notes[0] for table in played), max(table.notes[1] + fret_count(preset, table) for table in played)


def playable_notes(preset: Preset) -> list[int]:
    """The MIDI notes that the preset's strings and frets give, in order."""
    played = [table for table in preset.string if not table.sympathetic]
    notes = {note for s in played for note in range(s.notes[0], s.notes[1] + fret_count(preset, s) + 1)}
    return sorted(note for note in notes if note <= 127)


def why_unplayed(preset: Preset, note: int) -> str:
    """Why no string of the preset plays a note."""
    low, high = playable_range(preset)
    return "no string is tuned to it" if low <= note <= high else f"outside {midi_to_note(low)}-{midi_to_note(high)}"


def contact_cents(preset: Preset, note: float, *, sympathetic: bool = False) -> float:
    """The preset's calibrated contact shift at a note [cents], of strings that are played or of the others; 0 where none is
    given."""
    table = preset.tuning.sympathetic_cents if sympathetic else preset.tuning.contact_cents
    return at_note(table, note) if table else 0.0
