"""Case files: one string, its obstacle, how it starts, the scheme and the run, as validated tables.

What the tables and keys mean is written in `synth.research.simulation`.
"""

from __future__ import annotations

import copy
import os
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import AfterValidator, AliasChoices, BeforeValidator, Field, ValidationError, model_validator

from synth.files.npz import read_npz
from synth.files.sources import read_bytes
from synth.files.targets import is_special
from synth.instrument.faults import value_got, wanted
from synth.instrument.table import Table
from synth.solver.contact_laws import check_scheme
from synth.solver.schemes import COMPLIANT, SCHEMES
from synth.spelling import perhaps

Kind = TypeVar("Kind", bound=Table)

#: largest case file that is read [bytes]
MOST_BYTES = 1 << 24


class CaseError(ValueError):
    """A case that cannot be run; the message has one line per fault and names file, table and key. A ValueError.

    Examples
    --------
    >>> import synth
    >>> try:
    ...     synth.simulate("tanpora")
    ... except synth.CaseError as error:
    ...     print(error)
    case 'tanpora' (perhaps tanpura?) is not one of ...
    """


def _whole(value: Any) -> Any:
    """50.0 as 50; everything else is left to be judged."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


@dataclass(frozen=True)
class Within:
    """Bounds beyond what any run has use for, and so far within floating point that nothing made of them overflows."""

    low: float
    high: float
    unit: str

    def __call__(self, value: float) -> float:
        if not self.low <= value <= self.high:
            raise ValueError(f"must lie between {self.low:g} and {self.high:g}{self.unit}, got {value!r}; check the unit")
        return value


def _within(low: float, high: float, unit: str) -> AfterValidator:
    return AfterValidator(Within(low, high, unit))


# strict: neither true nor "1.0" is a number
Number = Annotated[float, Field(strict=True)]
Positive = Annotated[float, Field(strict=True, gt=0)]
NonNegative = Annotated[float, Field(strict=True, ge=0)]
Whole = Annotated[int, Field(strict=True), BeforeValidator(_whole)]
Flag = Annotated[bool, Field(strict=True)]

#: of a mode's q [m·√m] and q̇ [m·√m/s], in a case or in its files
MOST_AMPLITUDE, MOST_SPEED = 1e4, 1e12
Place = Annotated[Number, _within(-1e4, 1e4, " m")]  # along the string: what is not on it is said with its length
Length = Annotated[Positive, _within(1e-12, 1e4, " m")]
Width = Annotated[NonNegative, _within(0.0, 1e4, " m")]
Height = Annotated[Number, _within(-1e3, 1e3, " m")]
Instant = Annotated[NonNegative, _within(0.0, 1e9, " s")]
Duration = Annotated[Positive, _within(1e-9, 1e9, " s")]
Frequency = Annotated[Positive, _within(1e-6, 1e12, " Hz")]
Rate = Annotated[Positive, _within(1e-3, 1e12, " Hz")]
Amplitude = Annotated[Number, _within(-MOST_AMPLITUDE, MOST_AMPLITUDE, " m·√m")]
Speed = Annotated[Number, _within(-MOST_SPEED, MOST_SPEED, " m·√m/s")]
Cents = Annotated[Number, _within(-36000.0, 36000.0, " cents")]


class NutTable(Table):
    frequency_hz: Positive
    q: Positive
    mass_kg: Positive = Field(validation_alias=AliasChoices("mass_kg", "modal_mass_kg"))


class MeasuredTable(Table):
    file: str
    frequencies: str = "f"
    decay_rates: str = "sig"


class StringTable(Table):
    length_m: Positive
    tension_n: Positive
    linear_density_kg_m: Positive
    diameter_m: Positive
    inharmonicity: NonNegative | None = None
    bending_stiffness_n_m2: NonNegative | None = None
    core_diameter_m: Positive | None = None
    winding_diameter_m: Positive | None = None
    viscoelastic_loss: NonNegative = 0.0
    thermoelastic_q_inverse: NonNegative = 0.0
    air_viscosity: NonNegative = 1.8e-5
    air_density: NonNegative = 1.2
    stiffness_law: Literal["sqrt", "linear"] = "sqrt"
    nut: list[NutTable] = Field(default_factory=list)
    measured: MeasuredTable | None = None

    @model_validator(mode="after")
    def _one_stiffness(self) -> StringTable:
        if self.inharmonicity is not None and self.bending_stiffness_n_m2 is not None:
            raise ValueError("inharmonicity and bending_stiffness_n_m2 say the same; give one of them")
        return self


class FretsTable(Table):
    scale_length_m: Length
    count: Annotated[Whole, Field(le=500)]
    action_12th_m: Length
    relief_m: Width = 0.0
    nut_height_m: Length = 0.0004


class RampTable(Table):
    start_s: Instant = 0.0
    duration_s: Duration
    displacement_m: Height


class SineTable(Table):
    start_s: Instant = 0.0
    frequency_hz: Frequency
    amplitude_m: Height


class MotionTable(Table):
    ramp: list[RampTable] = Field(default_factory=list)
    sine: list[SineTable] = Field(default_factory=list)


class ParabolaTable(Table):
    top_m: Place
    height_m: Height = 0.0
    radius_m: Annotated[Positive, _within(1e-6, 1e12, " m")]


class WallTable(Table):
    from_m: Width
    to_m: Length
    nodes: Annotated[Whole, Field(ge=1)] | None = None
    spacing_m: Length | None = None
    height_m: Height | None = None
    neck: Literal["bass"] | None = None
    parabola: ParabolaTable | None = None
    stiffness_n_m2: Annotated[Positive, _within(1e-6, 1e20, " N/m²")] | Literal["rigid"] = 1e8

    @model_validator(mode="after")
    def _one_height(self) -> WallTable:
        if (self.height_m is not None) + (self.neck is not None) + (self.parabola is not None) != 1:
            raise ValueError("give one of height_m, neck and parabola")
        if self.nodes is not None and self.spacing_m is not None:
            raise ValueError("give either nodes or spacing_m")
        return self


class LayerTable(Table):
    stiffness_n_m: Annotated[Positive, _within(1e-6, 1e15, " N/m")]
    resistance_n_s_m: Annotated[NonNegative, _within(0.0, 1e15, " N s/m")] = 0.0
    thickness_m: Annotated[Positive, _within(1e-9, 1.0, " m")]


class ObstacleTable(Table):
    positions_m: list[Place] | None = None
    heights_m: list[Height] | Height | None = None
    frets: FretsTable | None = None
    layer: LayerTable | None = None
    motion: MotionTable = MotionTable()
    wall: WallTable | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> ObstacleTable:
        if self.wall is not None and (self.frets, self.positions_m, self.heights_m) != (None, None, None):
            raise ValueError("give either wall, or frets, or positions_m and heights_m")
        if self.frets is not None:
            if self.positions_m is not None or self.heights_m is not None:
                raise ValueError("give either frets or positions_m and heights_m")
        elif (self.positions_m is None) != (self.heights_m is None):
            raise ValueError("positions_m and heights_m must be given together")
        if self.layer is not None and self.wall is not None:
            raise ValueError("layer is for points and frets, a wall has its stiffness_n_m2; leave one of them out")
        if self.layer is not None and self.moves:
            raise ValueError(
                "layer and motion exclude each other: a layer keeps its ledger where the obstacle stands; leave one out"
            )
        if self.layer is not None and self.frets is None and not self.positions_m:
            raise ValueError("layer needs points that have it; give positions_m and heights_m, or frets")
        if self.moves and self.wall is not None:
            raise ValueError("motion is for points and frets, a wall stands; give positions_m and heights_m instead of wall")
        if self.moves and self.frets is None and not self.positions_m:
            raise ValueError("motion needs something that moves (a wall does not); give positions_m and heights_m, or frets")
        return self

    @property
    def moves(self) -> bool:
        return bool(self.motion.ramp or self.motion.sine)


class InitialTable(Table):
    shape: Literal["triangle", "modes", "rest"]
    position_m: Length | None = None
    displacement_m: Height | None = None
    rounding_half_width_m: Width | None = None
    width_m: Width | None = None
    file: str | None = None
    q: str | list[Amplitude] | None = None
    v: str | list[Speed] | None = None

    @model_validator(mode="after")
    def _complete(self) -> InitialTable:
        given = {name for name in InitialTable.model_fields if name != "shape" and getattr(self, name) is not None}
        takes = {
            "triangle": {"position_m", "displacement_m", "rounding_half_width_m", "width_m"},
            "modes": {"file", "q", "v"},
            "rest": set(),
        }[self.shape]
        needs = {"triangle": {"position_m", "displacement_m"}, "modes": {"q"}, "rest": set()}[self.shape]
        if given - takes:
            raise ValueError(f"shape {self.shape!r} does not take {', '.join(sorted(given - takes))}")
        if needs - given:
            raise ValueError(f"shape {self.shape!r} needs {', '.join(sorted(needs - given))}")
        if self.rounding_half_width_m is not None and self.width_m is not None:
            raise ValueError("give either rounding_half_width_m or width_m")
        if self.file is None and any(isinstance(key, str) for key in (self.q, self.v)):
            raise ValueError("q and v are keys of file; name the .npz file")
        if self.file is not None and not any(isinstance(key, str) for key in (self.q, self.v)):
            raise ValueError("file is given, but neither q nor v is a key of it; leave file out, or give a key")
        return self


class FingerTable(Table):
    position_m: Length
    displacement_m: Height
    width_m: Width = 0.01
    start_s: Instant = 0.0
    draw_s: Duration
    hold_s: Instant = 0.0
    slip_s: Annotated[NonNegative, _within(0.0, 1.0, " s")] = 0.0
    stiffness_n_m: Annotated[Positive, _within(1e-9, 1e15, " N/m")] = 1e5
    resistance_n_s_m: Annotated[NonNegative, _within(0.0, 1e15, " N s/m")] = 1.0


class BendTable(Table):
    start_s: Instant = 0.0
    duration_s: Duration
    cents: Cents


#: keys of [scheme] that only some schemes take
_TAKEN_BY = {
    "stiffness": tuple(COMPLIANT),
    "exponent": tuple(COMPLIANT),
    "loss": ("compliant", "energy-quadratisation"),
    "tolerance": ("compliant",),
    "iterations": ("compliant",),
    "grid": ("compliant",),
    "drift_correction": ("scalar-auxiliary-variable",),
}


class SchemeTable(Table):
    name: str = "exact-hold"
    restitution: Annotated[Number, Field(ge=0, le=1)] = 1.0
    residual_compliance: Flag = True
    tail: Literal["lumped", "static", "none"] | None = None
    substeps: Annotated[Whole, Field(ge=1, le=64)] = 1
    start: Literal["exact", "published"] = "exact"
    stiffness: Annotated[Positive, _within(1e-6, 1e30, " N/m^α")] | None = None
    exponent: Annotated[Number, Field(ge=1, le=20)] | None = None
    loss: Annotated[NonNegative, _within(0.0, 1e9, " s/m")] | None = None
    tolerance: Annotated[Number, Field(ge=1e-16, lt=1)] | None = None
    iterations: Annotated[Whole, Field(ge=1, le=100_000)] | None = None
    grid: Literal["contacts", "full"] | None = None
    drift_correction: Annotated[Number, Field(ge=0, le=1)] | None = None

    @model_validator(mode="after")
    def _known(self) -> SchemeTable:
        check_scheme(self.name, SCHEMES)
        if self.tail not in (None, "none") and not self.residual_compliance:
            raise ValueError(f'residual_compliance = false and tail = "{self.tail}" contradict each other; leave one out')
        if self.substeps > 1 and self.name != "exact-hold":
            raise ValueError(f"only exact-hold takes substeps, got {self.substeps} for {self.name}; raise internal_rate_hz")
        for key, schemes in _TAKEN_BY.items():
            if getattr(self, key) is not None and self.name not in schemes:
                raise ValueError(f"scheme {self.name!r} does not take {key}; it belongs to {', '.join(schemes)}")
        return self

    @property
    def tail_kind(self) -> str:
        """What stands for the modes left out: "lumped", "static" or "none"."""
        return self.tail or ("lumped" if self.residual_compliance else "none")


class RatesTable(Table):
    """Rates and length of a run, and whether it keeps a ledger."""

    internal_rate_hz: Rate
    output_rate_hz: Rate | None = None
    duration_s: Duration
    ledger: Flag = False

    @model_validator(mode="after")
    def _divides(self) -> RatesTable:
        if self.output_rate_hz is not None:
            ratio = self.internal_rate_hz / self.output_rate_hz
            if ratio < 1.0 - 1e-9 or abs(ratio - round(ratio)) > 1e-9 * ratio:
                raise ValueError(
                    "internal_rate_hz must be a whole multiple of output_rate_hz, "
                    f"got {self.internal_rate_hz:g} and {self.output_rate_hz:g} Hz"
                )
        return self

    @property
    def steps_per_output(self) -> int:
        return 1 if self.output_rate_hz is None else round(self.internal_rate_hz / self.output_rate_hz)


class RunTable(RatesTable):
    modes: Annotated[Whole, Field(ge=1, le=10_000_000)]
    outputs_m: Annotated[list[Place], Field(min_length=1)]


class Case(Table):
    """A case's tables, validated: one string on rigid ends, its obstacle, its start, the scheme and the run.

    The keys of every table with unit, range and default: docs/reference/case-keys.md. Values do not change: a changed case
    is made by `load_case` or `simulate` with other values.

    Attributes
    ----------
    string : table
        Length, tension, density, diameter, stiffness, losses, resonances of the nut.
    obstacle : table
        Points, frets or a wall, a soft layer on them, how they move; left out: none.
    initial : table
        Shape at t = 0; left out: at rest.
    finger : list of tables
        Fingers that take hold of the string, draw it and let go.
    bend : list of tables
        Changes of the string's tension.
    scheme : table
        How contacts are computed, see `simulate`.
    run : table
        Rates, modes, duration, outputs, ledger.

    Raises
    ------
    pydantic.ValidationError
        For tables that are wrong; `load_case` and `simulate` raise `CaseError` in its place.

    Examples
    --------
    >>> import synth
    >>> synth.load_case("tanpura").string.length_m
    1.002
    """

    string: StringTable
    obstacle: ObstacleTable = ObstacleTable()
    initial: InitialTable = InitialTable(shape="rest")
    finger: list[FingerTable] = Field(default_factory=list)
    bend: list[BendTable] = Field(default_factory=list)
    scheme: SchemeTable = SchemeTable()
    run: RunTable

    def __repr__(self) -> str:
        """One line: the tables may be pages."""
        table, run = self.obstacle, self.run
        below = "no obstacle"
        if table.wall is not None:
            below = "a wall"
        elif table.frets is not None:
            below = f"{table.frets.count} frets"
        elif table.positions_m:
            below = f"{len(table.positions_m)} contact point{'' if len(table.positions_m) == 1 else 's'}"
        return (
            f"<Case: string of {self.string.length_m:g} m over {below}, {self.scheme.name}, {run.duration_s:g} s of "
            f"{run.modes} modes at {run.internal_rate_hz:g} Hz>"
        )

    __str__ = __repr__

    @model_validator(mode="before")
    @classmethod
    def _scheme_of_a_wall(cls, tables: Any) -> Any:
        """A wall that is not cut into points of its own is the wall scheme's, where none is named."""
        obstacle, scheme = (tables.get(name, {}) if isinstance(tables, dict) else {} for name in ("obstacle", "scheme"))
        wall = obstacle.get("wall") if isinstance(obstacle, dict) else None
        if isinstance(wall, dict) and isinstance(scheme, dict) and "name" not in scheme:
            if wall.get("nodes") is None and wall.get("spacing_m") is None:
                return {**tables, "scheme": {**scheme, "name": "wall"}}
        return tables


#: what an override may replace: its name → table and key; the short names are the command line's
OVERRIDES = {
    "scheme": ("scheme", "name"),
    "restitution": ("scheme", "restitution"),
    "residual_compliance": ("scheme", "residual_compliance"),
    "tail": ("scheme", "tail"),
    "substeps": ("scheme", "substeps"),
    "start": ("scheme", "start"),
    "stiffness": ("scheme", "stiffness"),
    "exponent": ("scheme", "exponent"),
    "loss": ("scheme", "loss"),
    "tolerance": ("scheme", "tolerance"),
    "iterations": ("scheme", "iterations"),
    "grid": ("scheme", "grid"),
    "drift_correction": ("scheme", "drift_correction"),
    "internal_rate_hz": ("run", "internal_rate_hz"),
    "output_rate_hz": ("run", "output_rate_hz"),
    "modes": ("run", "modes"),
    "duration_s": ("run", "duration_s"),
    "outputs_m": ("run", "outputs_m"),
    "ledger": ("run", "ledger"),
    "rate": ("run", "internal_rate_hz"),
    "internal_rate": ("run", "internal_rate_hz"),
    "output_rate": ("run", "output_rate_hz"),
    "duration": ("run", "duration_s"),
}


def load_case(case: str | os.PathLike[str], **overrides: Any) -> Case:
    """Reads a case of one string and validates it, without running it.

    Parameters
    ----------
    case : str or path
        A TOML file, or the name of one of the program's own (`case_names`).
    **overrides
        Values that replace the case's by the names that `simulate` takes (modes, duration_s, scheme, … but no quality),
        or by dotted keys; None replaces nothing.

    Returns
    -------
    Case
        Its tables.

    Raises
    ------
    CaseError
        For a case that is wrong, is not there or has strings on a body (a ValueError).
    OSError
        For a file that cannot be read.

    Examples
    --------
    >>> import synth
    >>> synth.load_case("tanpura", modes=100)
    <Case: string of 1.002 m over 1 contact point, exact-hold, 3 s of 100 modes at 2.1168e+06 Hz>
    """
    return read_case(case, overrides)[0]


def case_folder() -> Path:
    """Where the cases that come with the program are."""
    from synth.instrument.preset import preset_folder

    return preset_folder() / "cases"


def case_names() -> list[str]:
    """Names of the cases that come with the program, those of subfolders last; `simulate` and `load_case` take them.

    Returns
    -------
    list of str
        Names such as "tanpura" or "hard/two-close".

    Examples
    --------
    >>> import synth
    >>> [name for name in synth.case_names() if name.startswith("tan")]
    ['tanpura']
    """
    folder = case_folder()
    names = [path.relative_to(folder).with_suffix("").as_posix() for path in folder.rglob("*.toml")]
    return sorted(names, key=lambda name: (name.count("/"), name))


def case_path(case: str | os.PathLike[str]) -> Path:
    """The file of a case by name (of those that come with the program), or that file. Raises CaseError."""
    path = Path(case)
    if path.suffix == ".toml" or (path.exists() and not path.is_dir()):  # a pipe too
        return path
    if str(case) not in case_names():
        raise CaseError(_not_a_case(str(case)))
    return case_folder() / f"{case}.toml"


def files_of(case: str | os.PathLike[str]) -> list[Path]:
    """The file of a case and those that it names, as far as it can be read. Raises CaseError where there is none."""
    path = case_path(case)
    if is_special(path):  # a pipe is read once
        return [path]
    try:
        tables = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return [path]
    outer = [each for value in tables.values() for each in (value if isinstance(value, list) else [value])]
    inner = [table for each in outer if isinstance(each, Mapping) for table in (each, *each.values())]
    named = [table["file"] for table in inner if isinstance(table, Mapping) and isinstance(table.get("file"), str)]
    return [path, *(path.parent / name for name in named if "\0" not in name)]


def read_case(case: Any, overrides: Mapping[str, Any]) -> tuple[Case, Path]:
    tables, folder, origin = read_tables(case, overrides)
    if is_coupled(tables):
        raise CaseError(
            f"{origin}: has strings on a body ([[string]], [[body.mode]]); `simulate` runs it, "
            "`synth.research.coupled.coupled_case.read_coupled` reads it"
        )
    return validated(Case, tables, origin), folder


def is_coupled(tables: Mapping[str, Any]) -> bool:
    """Whether a case is of strings that share a bridge: those of `research.coupled`."""
    return isinstance(tables.get("string"), list) or "body" in tables


def read_tables(case: Any, overrides: Mapping[str, Any]) -> tuple[dict[str, Any], Path, str]:
    """A case's tables with what replaces them, not yet judged; the folder that its files count from, and its name.

    overrides: values by the names in `OVERRIDES`, or by dotted keys (`string.tension_n`, `string.0.length_m`)."""
    folder, origin = Path(), "case"
    if isinstance(case, Table):
        tables = case.model_dump(exclude_unset=True)
    elif isinstance(case, Mapping):
        tables = _plain(case)
    elif not isinstance(case, str | os.PathLike):
        raise TypeError(
            "a case is the path of a .toml file, the name of one of the program's cases, its tables as a dict, or a Case; "
            f"got {type(case).__name__} {case!r:.60}"
        )
    else:
        path = case_path(case)
        folder, origin = path.parent, str(path)
        try:
            tables = tomllib.loads(read_bytes(path, MOST_BYTES, "case").decode("utf-8-sig"))
        except (ValueError, RecursionError) as error:
            raise CaseError(f"{origin}: not valid TOML: {error}") from None
    given: dict[tuple[str, str], str] = {}
    if any("." in name for name in overrides):
        tables = copy.deepcopy(tables)
    for name, value in overrides.items():
        if "." in name:
            put(tables, name.split("."), _plain(value), name)
            origin += f" with {name}={value!r:.40}"
            continue
        if name not in OVERRIDES:
            raise CaseError(f"no override {name!r}{perhaps(name, OVERRIDES)}; there are {', '.join(OVERRIDES)}")
        if value is not None:
            table, key = OVERRIDES[name]
            if given.setdefault((table, key), name) != name:
                raise CaseError(f"overrides {given[table, key]} and {name} are the same; give one of them")
            if isinstance(before := tables.get(table, {}), Mapping):  # what else it is, validation says
                tables[table] = {**before, key: _plain(value)}
    return tables, folder, origin


def put(tables: dict[str, Any], parts: list[str], value: Any, key: str) -> None:
    """Puts a value at a path of tables and lists; None takes it away. Raises CaseError, which calls it `key`."""
    place: Any = tables
    for depth, part in enumerate(parts):
        last = depth == len(parts) - 1
        try:
            if isinstance(place, list):
                index: Any = int(part)
                if not 0 <= index < len(place):
                    raise IndexError
            elif isinstance(place, dict):
                index = part
            else:
                raise TypeError
            if last and value is None and isinstance(place, dict):
                place.pop(index, None)
            elif last:
                place[index] = value
            else:
                place = place.setdefault(index, {}) if isinstance(place, dict) else place[index]
        except (ValueError, IndexError, TypeError):
            raise CaseError(f"no setting {key!r} ({part!r} does not exist)") from None


def validated(kind: type[Kind], tables: Mapping[str, Any], origin: str) -> Kind:
    """The tables as a `kind`; CaseError with a line for each fault."""
    try:
        return kind.model_validate(tables)
    except ValidationError as error:
        raise CaseError("\n".join(f"{origin}: {line}" for line in _faults(error))) from None


#: what pydantic adds to a place to say which of several types it tried
_ALTERNATIVE = re.compile(r"(list|literal|constrained|function)[-\[].*|str|float|int")


def _faults(error: ValidationError) -> list[str]:
    """A line per place: place, what is wanted of it ("… or …" where several types are taken), value got."""
    asked: dict[tuple[str, ...], list[str]] = {}
    got: dict[tuple[str, ...], str] = {}
    for item in error.errors():
        parts = [str(part) for part in item["loc"]]
        unknown = item["type"] == "extra_forbidden"
        place = tuple(part for part in parts if unknown or not _ALTERNATIVE.fullmatch(part))
        message = wanted(item)
        asked.setdefault(place, []).append(message)
        got[place] = value_got(item, message)
    # a list that is wrong in one number is not wrong for being none
    deepest = [place for place in asked if not any(other != place and other[: len(place)] == place for other in asked)]
    lines = []
    for place in deepest:
        first, *others = dict.fromkeys(asked[place])
        message = " or ".join([first, *(other.removeprefix("must be ") for other in others)])
        lines.append(f"{'.'.join(place) or 'file'}: {message}{got[place]}")
    return lines


def _not_a_case(name: str) -> str:
    if Path(name).is_dir():
        return f"case {name!r} is a folder; give a .toml file in it"
    names = case_names()
    below = [known for known in names if known.rpartition("/")[2] == name]
    near = f" (perhaps {below[0]}?)" if below else perhaps(name, names)
    return f"case {name!r}{near} is not one of {', '.join(names)}; a file of your own ends in .toml"


def _plain(value: Any) -> Any:
    """Arrays and their scalars as lists and numbers, all the way down."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def arrays_of(folder: Path, file: str, keys: dict[str, str]) -> dict[str, np.ndarray]:
    """The arrays of an .npz by what they are for; CaseError names file and key."""
    path = folder / file
    if not path.is_file():
        raise CaseError(f"file {path} does not exist; paths count from the case's folder")
    found = {}
    try:
        data = read_npz(path)
    except ValueError as error:
        raise CaseError(str(error)) from None
    for what, key in keys.items():
        if key not in data:
            raise CaseError(f"{path} has no array {key!r}; it has {', '.join(data)}")
        values = data[key]
        if values.dtype.kind not in "iuf" or values.ndim != 1 or not np.all(np.isfinite(values)):
            few = np.array2string(values, threshold=4).replace("\n", "")
            raise CaseError(f"{path}: {key!r} must be one row of finite real numbers, got shape {values.shape}: {few}")
        found[what] = values.astype(np.float64)
    return found
