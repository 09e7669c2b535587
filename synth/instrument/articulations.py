"""Hands in a preset's file: how they vary from note to note, damp and shake strings, and what articulations there are.

A preset's [pluck] is its articulation "normal", the first one. [articulations.NAME] adds others: strokes of their own,
fingers that touch the string after the stroke, what strums and slides; each with the ways to it: a key switch, a
controller, a layer of velocities.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from synth.instrument.fields import Note
from synth.instrument.table import Table
from synth.units import midi_to_note

#: name of the articulation that is [pluck] itself
NORMAL = "normal"
#: most articulations of a preset, with the normal one
MOST_ARTICULATIONS = 32


class Touch(Table):
    """A finger, palm or felt that lies on the string: a dashpot, and a spring if it is given one, over a width."""

    #: from the saddle, as a share of the speaking length
    place: float = Field(gt=0.0, lt=1.0)
    width_mm: float = Field(10.0, gt=0.0, le=200.0)
    #: in units of the string's impedance
    resistance: float = Field(ge=0.0, le=1000.0)
    stiffness_n_mm: float = Field(0.0, ge=0.0, le=1000.0)
    #: how long it lies there; until the next stroke where it is not given
    lift_ms: float | None = Field(None, ge=1.0, le=10000.0)
    #: how fast it comes down on the string, how far it jumps as it rubs along it, how long both take to come to rest, and
    #: after how long it jumps anew; it rubs as long before it leaves
    speed_m_s: float = Field(0.0, ge=0.0, le=5.0)
    roughness_um: float = Field(0.0, ge=0.0, le=1000.0)
    settle_ms: float = Field(8.0, ge=1.0, le=200.0)
    grain_ms: float = Field(0.05, ge=0.02, le=5.0)


class Knock(Table):
    """What a stroke does to the body beside the string: a push of the hand on its top, and what is unsteady about that."""

    #: largest force at velocity 127, how long it takes, and how much later than the finger meets the string it begins
    force_n: float = Field(gt=0.0, le=100.0)
    time_ms: float = Field(5.0, ge=0.1, le=100.0)
    delay_ms: float = Field(0.0, ge=0.0, le=200.0)
    #: standard deviation of what is unsteady about it, in parts of the force, and how long that takes to change
    noise_percent: float = Field(0.0, ge=0.0, le=200.0)
    grain_ms: float = Field(0.1, ge=0.02, le=5.0)
    #: from the bridge to where the hand is
    distance_mm: float = Field(60.0, ge=0.0, le=1000.0)
    #: as a note ends, the hand pushes again, with so much of the force of the stroke
    release_ratio: float = Field(0.0, ge=0.0, le=4.0)


class Hand(Table):
    """What is human about the hands: no two strokes are the same, vibrato, the finger that ends a note."""

    #: standard deviations from stroke to stroke: of the place, the level, the width, and of the times that drawing and
    #: letting go take
    place_mm: float = Field(0.0, ge=0.0, le=50.0)
    level_db: float = Field(0.0, ge=0.0, le=6.0)
    width_percent: float = Field(0.0, ge=0.0, le=50.0)
    time_percent: float = Field(0.0, ge=0.0, le=50.0)
    #: what the modulation wheel (controller 1) does to the pitch; "up" where a string can only be pulled
    vibrato_hz: float = Field(5.5, ge=0.1, le=20.0)
    vibrato_cents: float = Field(0.0, ge=0.0, le=200.0)
    vibrato: Literal["both", "up"] = "both"
    #: legato to a higher note of the same string pulls it aside by at most so much, without a change of fret
    meend_semitones: float = Field(0.0, ge=0.0, le=12.0)
    meend_ms: float = Field(60.0, ge=1.0, le=2000.0)
    #: the finger that is laid on the string when a note ends, beside damping.release_s
    release: Touch | None = None
    #: what a stroke does to a body that strings share
    knock: Knock | None = None

    def varied(self, share: float) -> Hand:
        """So much of the variation."""
        spreads = ("place_mm", "level_db", "width_percent", "time_percent")
        return self.model_copy(update={name: share * getattr(self, name) for name in spreads})

    @property
    def varies(self) -> bool:
        """Whether no two strokes are the same."""
        return max(self.place_mm, self.level_db, self.width_percent, self.time_percent) > 0.0


def _controller(value: Any) -> Any:
    return {"number": value} if isinstance(value, int) and not isinstance(value, bool) else value


class Controller(Table):
    """While a controller stands in a range, an articulation is the one that plays."""

    number: int = Field(ge=1, le=119)
    low: int = Field(64, ge=0, le=127)
    high: int = Field(127, ge=0, le=127)

    @model_validator(mode="after")
    def _rises(self) -> Controller:
        if self.high < self.low:
            raise ValueError(f"high must not be below low, got {self.low} to {self.high}")
        return self


def _rising(value: tuple[int, int] | None) -> tuple[int, int] | None:
    if value is None:
        return None
    low, high = value
    if not 1 <= low <= high <= 127:
        raise ValueError(f"must be two velocities from 1 to 127, the lower first, got {list(value)}")
    return value


class Articulation(Table):
    """One way to begin a note. What is not given of a stroke is as in [pluck]."""

    #: the key that switches to it, until another does; below the notes that the strings play
    key: Note | None = None
    #: number, or { number, low, high }: it plays while the controller is there
    controller: Annotated[Controller | None, BeforeValidator(_controller)] = None
    #: velocities that play it, where no key or controller has chosen another than the normal one
    velocity: Annotated[tuple[int, int] | None, AfterValidator(_rising)] = None
    #: drawn aside and let go, or hit by a mass that flies at it
    stroke: Literal["pluck", "throw"] = "pluck"
    position: float | None = Field(None, gt=0.0, lt=1.0)
    position_hard: float | None = Field(None, gt=0.0, lt=1.0)
    #: how much further it is drawn than by the normal pluck
    displacement_ratio: float = Field(1.0, ge=0.0, le=10.0)
    width_mm: float | None = Field(None, gt=0.0, le=100.0)
    width_hard_mm: float | None = Field(None, gt=0.0, le=100.0)
    draw_ms: float | None = Field(None, ge=0.5, le=100.0)
    slip_ms: float | None = Field(None, ge=0.0, le=20.0)
    slip_hard_ms: float | None = Field(None, ge=0.0, le=20.0)
    roughness_um: float | None = Field(None, ge=0.0, le=100.0)
    rub_percent: float | None = Field(None, ge=0.0, le=100.0)
    edge_mm: float | None = Field(None, ge=0.02, le=20.0)
    grain_mm: float | None = Field(None, ge=0.005, le=5.0)
    arrival: float | None = Field(None, ge=0.0, le=3.0)
    #: how much of the hand's knock on the body it gives
    knock_ratio: float = Field(1.0, ge=0.0, le=10.0)
    #: of what is thrown, its speed at velocity 127, and whether it comes from the side where frets and bridge are not
    mass_g: float = Field(20.0, gt=0.01, le=1000.0)
    speed_m_s: float = Field(1.0, gt=0.0, le=20.0)
    stiffness_n_mm: float | None = Field(None, gt=0.0, le=10000.0)
    #: a finger that is laid on as the string is let go
    touch: Touch | None = None
    #: keys are harmonics: the open or stopped string an octave, a twelfth … below is touched where that harmonic rests
    harmonic: bool = False
    #: strings of a chord follow each other by so much, in turn from the lowest and from the highest
    strum_ms: float = Field(0.0, ge=0.0, le=200.0)
    #: legato goes from fret to fret, each taking so long
    slide_ms: float = Field(0.0, ge=0.0, le=500.0)

    @property
    def roams(self) -> bool:
        """Whether notes need more of the instrument than the strings and frets that they sound on."""
        return self.harmonic or self.slide_ms > 0.0 or self.strum_ms > 0.0

    @model_validator(mode="after")
    def _consistent(self) -> Articulation:
        if self.stroke != "throw":
            for field in ("mass_g", "speed_m_s", "stiffness_n_mm"):
                if getattr(self, field) != type(self).model_fields[field].default:
                    raise ValueError(f'{field} needs stroke = "throw"; set that, or leave it out')
        if self.harmonic and self.touch is None:
            raise ValueError(
                "harmonic needs a touch, whose place the note decides; give touch = { place, resistance, lift_ms }"
            )
        return self


def articulation_names(articulations: Mapping[str, Articulation]) -> list[str]:
    """Names by number: the normal one first, then as in the file."""
    return [NORMAL, *(name for name in articulations if name != NORMAL)]


def switching_problems(articulations: Mapping[str, Articulation], notes: list[int]) -> list[tuple[str, str]]:
    """(path, what is wrong) of keys and controllers that choose articulations of an instrument which plays these notes."""
    problems: list[tuple[str, str]] = []
    if not notes:  # no key plays a string, which is said elsewhere
        return problems
    if len(articulation_names(articulations)) > MOST_ARTICULATIONS:
        problems.append(
            ("articulations", f"must be at most {MOST_ARTICULATIONS - 1} beside the normal one, got {len(articulations)}")
        )
    of_key: dict[int, str] = {}
    for name, each in articulations.items():
        place = f"articulations.{name}"
        if each.key is not None:
            if each.key >= notes[0]:
                what = f"must lie below the lowest note, {midi_to_note(notes[0])}, got {midi_to_note(each.key)}"
                problems.append((f"{place}.key", what))
            if each.key in of_key:
                what = (
                    f"{midi_to_note(each.key)} already switches to {of_key[each.key]}; give every articulation its own key"
                )
                problems.append((f"{place}.key", what))
            of_key[each.key] = name
    if of_key and (NORMAL not in articulations or articulations[NORMAL].key is None):
        first = next(iter(of_key.values()))
        what = f"there must be a way back from {first}: give [articulations.{NORMAL}] a key, too"
        problems.append((f"articulations.{NORMAL}", what))
    taken: list[tuple[str, Controller]] = []
    for name, each in articulations.items():
        if each.controller is not None:
            for other, before in taken:
                if before.number == each.controller.number and (
                    before.low <= each.controller.high and each.controller.low <= before.high
                ):
                    what = f"overlaps with that of {other} (controller {before.number}, {before.low} to {before.high})"
                    problems.append((f"articulations.{name}.controller", what))
            taken.append((name, each.controller))
    return problems
