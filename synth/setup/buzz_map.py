"""The buzz map: from which displacement on every note of an instrument touches and buzzes, and on what."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from synth.engine.stroke import NEAREST
from synth.instrument.compile import CompiledString, open_string, speaking_string
from synth.instrument.fields import scaled
from synth.instrument.neck import alone
from synth.instrument.preset import BoardObstacle, Preset, at_note
from synth.physics.string import String
from synth.setup.audible import AUDIBLE_DB, WINDOW_S
from synth.setup.board_note import BoardNote
from synth.setup.note import SetupNote
from synth.setup.places import Below, FretPlace, below, check_touches, compiled, opened_string, places_of
from synth.setup.plucking import VELOCITIES, moved, stroke_of, velocity_of
from synth.setup.side_by_side import computed
from synth.setup.thresholds import UNCERTAIN_DB, Threshold, threshold

#: of a map unless told otherwise: thresholds are the same as at `reference` within 3 % in more than 95 % of random cases
QUALITY = "draft"
#: the largest stroke that is tried, over the hardest of the preset
LIMIT = 2.0
#: what a player's place varies by [m], and what a string's diameter does (relative): the map says what that changes
PLACE_M, GAUGE = 0.005, 0.01


@dataclass(frozen=True)
class Spot(Threshold):
    """One note of a buzz map: its threshold, low_m and high_m with what the place of the stroke adds, and more.
    Displacements are those of the string under the finger, normal to the board [m].

    string, fret, note    where: the string's name, its fret (0: open), the MIDI note
    clearance_m           least clearance of the string at rest; inf over nothing, negative where it rests on a fret
    stroke_m              displacement of the map's stroke
    touched               what the string touches first; "": nothing up to limit_m
    buzzes_on             the contact that gives the largest impulse where a buzz is just heard
    buzz_velocity         about the MIDI velocity of that stroke; above 127 no key gives it
    place_percent, gauge_percent   change of touch_m with the place of the stroke (±5 mm), and of the plucking force there
                          with the string's diameter (+1 %)
    stroke_db             B of the map's stroke itself [dB]
    limit_m               largest displacement that was tried
    resting               the string lies on what it touches
    """

    string: str
    fret: int
    note: int
    clearance_m: float
    stroke_m: float
    touched: str
    buzzes_on: str
    buzz_velocity: float
    place_percent: float
    gauge_percent: float
    stroke_db: float
    limit_m: float
    resting: bool

    @property
    def buzzes(self) -> bool:
        """Whether the map's stroke buzzes audibly."""
        return self.buzz_m <= self.stroke_m

    @property
    def uncertain(self) -> bool:
        """Whether the map's stroke lies within the threshold's interval."""
        return self.low_m <= self.stroke_m <= self.high_m


@dataclass(frozen=True)
class BuzzMap:
    """A buzz map of a preset by strokes of one kind; `complete`: nothing stopped it."""

    preset: str
    stroke: str
    velocity: int
    place_m: float | None
    quality: str
    audible_db: float
    spots: tuple[Spot, ...]
    complete: bool = True


@dataclass(frozen=True)
class Prepared:
    """A note ready to be played: its open string, and what lies below it."""

    place: FretPlace
    string: CompiledString
    note: SetupNote
    opened: String
    below: Below


def prepare(
    preset: Preset, place: FretPlace, velocity: float, place_m: float | None, quality: str, seconds: float = WINDOW_S
) -> Prepared:
    """A place of a preset under strokes of a velocity, played for so long. Raises PresetError, ValueError."""
    string, position = compiled(preset, place, quality)
    stroke = stroke_of(preset, string, position, velocity, place_m)
    opened = opened_string(preset, place)
    under = below(preset, place, opened, position.length_m)
    if isinstance(preset.obstacle, BoardObstacle):
        note: SetupNote = BoardNote(preset, place, string, position, stroke, quality, under)
    else:
        note = SetupNote(position, stroke, speed=preset.on_rigid_ends.output.kind in ("pickup", "velocity"), seconds=seconds)
    return Prepared(place, string, note, opened, under)


def spot(
    preset: Preset, place: FretPlace, *, velocity: int, place_m: float | None, quality: str, audible_db: float = AUDIBLE_DB
) -> Spot:
    """One note of a map. Raises PresetError, ValueError."""
    ready = prepare(preset, place, velocity, place_m, quality)
    note, under, stroke = ready.note, ready.below, ready.note.stroke
    hardest = stroke_of(preset, ready.string, note.position, 127.0, place_m)
    limit = LIMIT * hardest.displacement_m
    reach = note.reach_m(under)
    touch = float(reach.min(initial=math.inf))
    pressed = under.heights_m >= 0.0
    resting = bool(pressed.any()) and not _lies_on_a_bridge(preset)

    def level(displacement: float) -> float:
        return note.play(displacement, under).buzz_db

    if resting:
        found = Threshold(0.0, 0.0, 0.0, 0.0, math.nan)
    else:
        found = threshold(level, touch, limit, UNCERTAIN_DB[quality], audible_db)
    on = ""
    if resting:
        on = under.names[int(under.heights_m.argmax())]
    elif math.isfinite(found.buzz_m):
        impulse = note.play(found.buzz_m, under).impulse_ns
        on = under.names[int(impulse.argmax())] if impulse.any() else under.names[int(reach.argmin())]
    by_place = by_gauge = math.nan
    if 0.0 < touch <= limit:
        by_place = max(abs(_moved_touch(note, under, by) / touch - 1.0) for by in (-PLACE_M, PLACE_M))
        by_gauge = _force_by_gauge(preset, ready)
    low, high = _interval(found, by_place)
    touched = 0.0 if resting else touch
    return Spot(
        touch_m=touched if touched <= limit else math.inf,
        buzz_m=found.buzz_m,
        low_m=low,
        high_m=high,
        returns_m=found.returns_m,
        string=place.string,
        fret=place.fret,
        note=place.note,
        clearance_m=float(under.clearance_m(note.position.length_m).min(initial=math.inf)),
        stroke_m=stroke.displacement_m,
        touched="" if touched > limit else on if resting else under.names[int(reach.argmin())],
        buzzes_on=on,
        buzz_velocity=velocity_of(stroke, velocity, preset.pluck.velocity_exponent, found.buzz_m),
        place_percent=100.0 * by_place,
        gauge_percent=100.0 * by_gauge,
        stroke_db=math.inf if resting else level(stroke.displacement_m) if touch < stroke.displacement_m else 0.0,
        limit_m=limit,
        resting=resting,
    )


def _lies_on_a_bridge(preset: Preset) -> bool:
    """Whether contact at rest is how the instrument is meant."""
    return preset.obstacle.kind in ("bridge", "points")


def _interval(found: Threshold, share: float) -> tuple[float, float]:
    """The interval of a threshold, with another share of it added in quadrature on both sides."""
    buzz = found.buzz_m
    if not math.isfinite(buzz):
        return found.low_m, found.high_m
    other = 0.0 if math.isnan(share) else share * buzz
    return max(0.0, buzz - math.hypot(buzz - found.low_m, other)), buzz + math.hypot(found.high_m - buzz, other)


def _moved_touch(note: SetupNote, under: Below, by_m: float) -> float:
    """Displacement at which the string touches where it is plucked so much further from the saddle; the same where that is
    not on the string."""
    stroke = moved(note.stroke, by_m)
    if not 0.5 * stroke.width_m < stroke.distance_m < note.position.length_m - 0.5 * stroke.width_m:
        stroke = note.stroke
    return float(note.with_stroke(stroke).reach_m(under).min())


def _force_by_gauge(preset: Preset, ready: Prepared) -> float:
    """Relative change of the plucking force at the touch where the string is 1 % thicker, tuned to the same pitch."""
    place, note = ready.place, ready.note
    single = alone(preset.on_rigid_ends, place.table(preset.on_rigid_ends), place.opened)
    forces = []
    for factor in (1.0, 1.0 + GAUGE):
        other = with_gauge(single, factor)
        (table,) = other.string
        opened, under = open_string(other, table, place.opened)
        string, _, _ = speaking_string(other, table, place.opened, place.fret, opened, under)
        forces.append(string.tension_n * float(note.with_string(string).reach_m(ready.below).min()))
    return forces[1] / forces[0] - 1.0


def with_gauge(preset: Preset, factor: float) -> Preset:
    """A preset of one string, its diameter scaled by `factor`, of the same material."""
    (table,) = preset.string

    powers = {"diameter_mm": 1, "core_diameter_mm": 1, "winding_diameter_mm": 1, "linear_density_g_m": 2, "inharmonicity": 2}
    changed = {
        key: scaled(value, factor**power) for key, power in powers.items() if (value := getattr(table, key)) is not None
    }
    return preset.model_copy(update={"string": (table.model_copy(update=changed),)})


def buzz_map(
    preset: Preset,
    *,
    stroke: str | int = "medium",
    place_m: float | None = None,
    quality: str = QUALITY,
    audible_db: float = AUDIBLE_DB,
    strings: Sequence[str] | None = None,
    frets: Collection[int] | None = None,
    threads: int = 1,
    told: Callable[[int, int], None] | None = None,
) -> BuzzMap:
    """Where an instrument buzzes: every note, or those of some strings and frets.

    stroke      "soft", "medium", "hard", or a MIDI velocity: place, width and speed of the finger are that stroke's
    place_m     of the finger from the saddle [m], in the preset's place
    quality     of the computation: "draft", "standard", "fine", "reference"
    audible_db  B from which a buzz is heard [dB] (`audible`)
    threads     notes computed at a time
    told        called with the number of notes done and of all

    A KeyboardInterrupt ends the map early; it then has what was done, and `complete` is False. Raises PresetError for a
    preset whose strings touch nothing or that has no such string or fret, ValueError for a stroke or a place that cannot be.
    """
    check_touches(preset)
    velocity = velocity_named(stroke)
    if quality not in UNCERTAIN_DB:
        raise ValueError(f"quality must be one of {', '.join(UNCERTAIN_DB)}, got {quality!r}")
    wanted = places_of(preset, strings, frets)
    if place_m is not None:
        _check_place(preset, wanted, place_m)

    def one(place: FretPlace) -> Spot:
        return spot(preset, place, velocity=velocity, place_m=place_m, quality=quality, audible_db=audible_db)

    spots, complete = computed(one, wanted, threads, told)
    name = stroke if isinstance(stroke, str) else f"velocity {stroke}"
    return BuzzMap(preset.name, name, velocity, place_m, quality, audible_db, spots, complete)


def _check_place(preset: Preset, wanted: Sequence[FretPlace], place_m: float) -> None:
    """Raises ValueError for a place of plucking that is not on every string that is wanted."""
    for place in wanted:
        length = at_note(place.table(preset).length_m, place.opened) * 2.0 ** (-place.fret / 12.0)
        if place_m > (1.0 - NEAREST) * length:
            raise ValueError(
                f"place must lie on every string, got {1e3 * place_m:g} mm from the saddle, where string {place.string} at "
                f"fret {place.fret} speaks over {1e3 * length:.0f} mm; take a place nearer to it, or lower frets"
            )


def velocity_named(stroke: str | int) -> int:
    """The MIDI velocity of a stroke. Raises ValueError."""
    if isinstance(stroke, str):
        if stroke not in VELOCITIES:
            raise ValueError(f"stroke must be {', '.join(VELOCITIES)} or a velocity of 1 to 127, got {stroke!r}")
        return VELOCITIES[stroke]
    if not 1 <= stroke <= 127:
        raise ValueError(f"stroke must be {', '.join(VELOCITIES)} or a velocity of 1 to 127, got {stroke}")
    return int(stroke)
