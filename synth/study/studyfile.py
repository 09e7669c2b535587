"""A study's tables, read and checked: every fault is said at once, with the file and the key."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, ValidationError, model_validator

from synth.files.sources import read_bytes
from synth.instrument.faults import value_got, wanted
from synth.instrument.shipped import shipped_file
from synth.instrument.table import Table
from synth.research.case import OVERRIDES
from synth.spelling import perhaps
from synth.study.values import Draw, Range, Scalar
from synth.study.work.names import is_own

#: largest study file that is read [bytes]
MOST_BYTES = 1 << 26
_TAGS = {"a list", "a range"}


class StudyError(ValueError):
    """A study that cannot be run; the message has one line per fault and names file and key. A ValueError.

    Examples
    --------
    >>> import synth
    >>> try:
    ...     synth.sweep({"base": {"case": "tanpura"}, "measures": ["e"]}, "no.sweep", workers=0)
    ... except synth.StudyError as error:
    ...     print(error)
    study: ...
    """


Values = Annotated[
    Annotated[list[Any], Tag("a list"), Field(min_length=1)] | Annotated[Range, Tag("a range")],
    Discriminator(lambda value: "a range" if isinstance(value, dict | Range) else "a list"),
]


class BaseTable(Table):
    """What rows are run from: one of case, preset and call."""

    case: str | None = None
    preset: str | None = None
    call: str | None = None
    set: dict[str, Any] = Field(default_factory=dict)
    path: list[str] = Field(default_factory=list)
    sources: list[str] = Field(default_factory=list)
    rooms: list[str] = Field(default_factory=list)

    @model_validator(mode="after")
    def _one(self) -> BaseTable:
        if sum(each is not None for each in (self.case, self.preset, self.call)) > 1:
            raise ValueError("give one of case, preset and call")
        if self.rooms and self.call is None:
            raise ValueError("rooms tells which modules a function's rows depend on; leave it out, or give call")
        if self.call is not None and self.call.count(":") != 1:
            raise ValueError(f"call must be MODULE:FUNCTION, got {self.call!r}")
        return self


class BlockTable(Table):
    """Rows: every combination of a grid, with values that go together (zip) and random samples (draw)."""

    set: dict[str, Any] = Field(default_factory=dict)
    grid: dict[str, Values] = Field(default_factory=dict)
    zip: dict[str, Values] = Field(default_factory=dict)
    draw: Draw | None = None

    @model_validator(mode="after")
    def _consistent(self) -> BlockTable:
        lengths = {name: len(listed(values)) for name, values in self.zip.items()}
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"{name} {length}" for name, length in lengths.items())
            raise ValueError(f"zip needs lists of one length, got {told}")
        for name, values in self.grid.items():
            found = [repr(each) for each in listed(values)]
            if len(set(found)) < len(found):
                again = next(each for each in found if found.count(each) > 1)
                raise ValueError(f"grid.{name} has {again} twice; leave one out")
        places: dict[str, str] = {}
        drawn = self.draw.parameters if self.draw else {}
        for where, names in (("set", self.set), ("grid", self.grid), ("zip", self.zip), ("draw", drawn)):
            for name in names:
                key = canonical(name)
                if key in places:
                    raise ValueError(f"{where}.{name} and {places[key]} set the same parameter; leave one out")
                places[key] = f"{where}.{name}"
        return self

    @property
    def names(self) -> list[str]:
        """Of the parameters, in order."""
        return [*self.set, *self.grid, *self.zip, *(self.draw.parameters if self.draw else {})]


class ReferenceTable(Table):
    """What rows are compared with: the same run with other settings; check: another one that says how far it stands."""

    set: dict[str, Any] = Field(default_factory=dict)
    follows: list[str] | None = None
    check: dict[str, Any] = Field(default_factory=dict)


class MeasureTable(Table):
    """A measure with options, and what its column is called."""

    measure: str
    as_: str | None = Field(None, alias="as", pattern=r"^\w[\w.-]*$")
    options: dict[str, Any] = Field(default_factory=dict)


class PlotTable(Table):
    """A picture: curves of y over x, one for each value of colour and marker, or a Pareto front."""

    file: str | None = None
    x: str
    y: str
    colour: str | None = None
    marker: str | None = None
    kind: Literal["curves", "points", "pareto"] = "curves"
    log: list[Literal["x", "y"]] = Field(default_factory=list)
    where: dict[str, Scalar] = Field(default_factory=dict)
    title: str | None = None
    x_label: str | None = None
    y_label: str | None = None
    #: of a Pareto front: whether more of it is better
    more_is_better: list[Literal["x", "y"]] = Field(default_factory=list)


class Study(BlockTable):
    """A study's file. The tables set, grid, zip and draw at its top are a block like those of `block`."""

    name: str = "study"
    base: BaseTable
    block: list[BlockTable] = Field(default_factory=list)
    reference: ReferenceTable | None = None
    measures: list[str | MeasureTable] = Field(default_factory=list)
    arrays: list[str] = Field(default_factory=list)
    times: list[str] = Field(default_factory=list)
    plot: list[PlotTable] = Field(default_factory=list)

    @property
    def blocks(self) -> list[BlockTable]:
        """In order: that of the top, where there is one, then the others."""
        top = BlockTable.model_construct(set=self.set, grid=self.grid, zip=self.zip, draw=self.draw)
        if not self.block:
            return [top]
        return [*([top] if self.grid or self.zip or self.draw else []), *self.block]

    @property
    def parameters(self) -> list[str]:
        """Names of all parameters of rows, in order."""
        return list(dict.fromkeys([*self.base.set, *(name for block in self.blocks for name in block.names), *self.set]))

    def measured(self) -> list[dict[str, Any]]:
        """Measures as {"name", "as", "options"}."""
        found = []
        for each in self.measures:
            if isinstance(each, str):
                found.append({"name": each, "as": each.partition(":")[2] or each, "options": {}})
            else:
                column = each.as_ or each.measure.partition(":")[2] or each.measure
                found.append({"name": each.measure, "as": column, "options": dict(each.options)})
        return found


def listed(values: list[Any] | Range) -> list[Any]:
    """The values of a list or a range."""
    return values.values() if isinstance(values, Range) else values


def canonical(name: str) -> str:
    """A parameter's key: "modes" and "run.modes" are one."""
    return ".".join(OVERRIDES[name]) if name in OVERRIDES else name


def study_path(name_or_path: str | os.PathLike[str]) -> Path:
    """The file of a study, or of one that comes with the program by name. Raises StudyError where there is none."""
    return shipped_file(name_or_path, "study", "studies", StudyError)


def read_study(study: str | os.PathLike[str] | Mapping[str, Any] | Study) -> tuple[Study, Path, str]:
    """A study, by its tables, file or name, the folder that its files count from, and what messages call it.

    Raises StudyError or OSError.
    """
    if isinstance(study, Study):
        return study, Path(), "study"
    if isinstance(study, Mapping):
        return _validated(dict(study), "study"), Path(), "study"
    origin, path = os.fspath(study), study_path(study)
    data = read_bytes(path, MOST_BYTES, "study")
    try:
        tables = tomllib.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise StudyError(f"{origin}: not valid TOML: {error}") from None
    tables.setdefault("name", path.stem)
    return _validated(tables, origin), path.parent, origin


def _validated(tables: Mapping[str, Any], origin: str) -> Study:
    try:
        study = Study.model_validate(tables)
    except ValidationError as error:
        lines = []
        for item in error.errors():
            place = ".".join(str(part) for part in item["loc"] if part not in _TAGS)
            message = wanted(item)
            if item["type"] == "union_tag_invalid":
                message = "must be a list, or a range { from, to, count }"
            lines.append(f"{origin}: {place or 'file'}: {message}{value_got(item, message)}")
        raise StudyError("\n".join(dict.fromkeys(lines))) from None
    faults = [f"{origin}: {fault}" for fault in _faults(study)]
    if faults:
        raise StudyError("\n".join(faults))
    return study


def _faults(study: Study) -> list[str]:
    """What the tables' own shapes do not say."""
    from synth.study.work.measuring import MEASURES

    found = []
    base = study.base
    if base.case is None and base.preset is None and base.call is None:
        if not any("case" in each.names or "preset" in each.names for each in study.blocks):
            found.append("base: missing; give base.case, base.preset or base.call")
    for number, each in enumerate(study.measured()):
        name = each["name"]
        if ":" in name:
            continue
        if name not in MEASURES:
            found.append(f"measures.{number}: no measure {name!r}{perhaps(name, MEASURES)}; there are {', '.join(MEASURES)}")
            continue
        if MEASURES[name].reference and study.reference is None:
            found.append(f"measures.{number}: {name} compares with a reference; give [reference]")
        for option in each["options"]:
            if option not in MEASURES[name].options:
                there = ", ".join(MEASURES[name].options) or "none"
                found.append(f"measures.{number}: {name} has no option {option!r}; it has {there}")
    columns = [each["as"] for each in study.measured()]
    for what, names in (("parameter", study.parameters), ("measures", columns)):
        found += [
            f"{what} {name!r}: rows already have a column of this name; give another" for name in names if is_own(name)
        ]
    for column in dict.fromkeys(columns):
        if columns.count(column) > 1:
            found.append(f'measures: two are called {column!r}; name one with as = "…"')
        elif column in study.parameters:
            found.append(f'measures: {column!r} is a parameter; name the measure with as = "…"')
    if base.call is None and not study.measures and not study.arrays:
        found.append("measures: missing; name at least one, or arrays")
    if base.call is not None and study.measures:
        found.append("measures: a function returns its own measures; leave them out")
    if study.reference is not None and base.call is None and "ledger" in study.reference.set:
        found.append("reference.set.ledger: has no meaning; leave it out")
    return found
