"""Cases of strings that share a bridge and a body, as validated tables.

SI units as in `research.simulation`, place_mm, angle_deg and body modes as in presets. x counts from the far end (the nut),
heights and displacements from the open string at rest, up is positive. * marks what must be there.

    [[string]]                  one for each, with all keys of `simulate`'s [string], and
    name                        default "1", "2", …
    place_mm, angle_deg         where on the bridge it ends, from its middle, and which way it moves there, default 0
    outputs_m                   points of it whose displacement is wanted
    modes                       default run.modes
    substeps                    of this string: default scheme.substeps
    [string.polarisation]       it moves at right angles to its first direction, too; nothing touches it there
    detuning_cents, loss_ratio  how much higher tuned, how much faster decaying; default 0 and 1
    [string.obstacle]           points or frets, as in `simulate`, motion included; and
    rides                       whether it stands on the bridge; default false
    [string.initial]            "rest" (default) or "triangle" as in `simulate`; "drawn": position_m*, force_n*, the state at
                                rest under a force, the body with it
    direction_deg               of the pluck, from that of the string; default 0; others move the second polarisation
    [[string.finger]]           as in `simulate`, with direction_deg; the second polarisation is held where it goes
    [[string.bend]]             as in `simulate`
    [[string.fret]]             stops the string elsewhere from start_s* on
    position_m*                 of the fret from the far end of the open string; 0: open
    height_m                    where the fret is, default 0; the stopped end goes there in ramp_s, default 0.004

    [[body.mode]]*              frequency_hz*, q*, mass_kg*, shape, radiation, pan

    [scheme]
    name                        "exact-hold" (default), or "complex-modes": exact, where nothing touches and no hand acts
    tail                        "static" (default) or "none": what stands for the modes left out at contacts
    substeps                    1 (default), 2, 4 or 8: contact forces change so many times in a step of the bridge

    [run]
    internal_rate_hz*           steps of the bridge (frames), and of strings that touch nothing
    output_rate_hz              divides the internal rate; default: the same
    modes*, duration_s*, ledger
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from synth.instrument.preset import Body as PresetBody
from synth.instrument.table import Table
from synth.research.case import (
    BendTable,
    Duration,
    FingerTable,
    Flag,
    Height,
    Instant,
    Length,
    Number,
    ObstacleTable,
    Place,
    RatesTable,
    StringTable,
    Whole,
    Width,
    read_tables,
    validated,
)
from synth.solver.coupling import MOST_STEPS


def _whole(value: Any) -> Any:
    """4.0 as 4, which a literal would not take."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


Steps = Literal[1, 2, 4, 8]
assert MOST_STEPS == 8


def _within(low: float, high: float, unit: str) -> Any:
    return Field(strict=True, ge=low, le=high, description=unit)


Angle = Annotated[float, _within(-180.0, 180.0, "°")]


class PolarisationTable(Table):
    detuning_cents: Annotated[float, _within(-100.0, 100.0, "cents")] = 0.0
    loss_ratio: Annotated[float, _within(0.01, 100.0, "")] = 1.0


class LineObstacleTable(ObstacleTable):
    rides: Flag = False

    @model_validator(mode="after")
    def _points(self) -> LineObstacleTable:
        if self.wall is not None:
            raise ValueError("a wall is for one string on rigid ends; give positions_m and heights_m, or frets")
        return self


class CoupledInitialTable(Table):
    shape: Literal["rest", "triangle", "drawn"] = "rest"
    position_m: Length | None = None
    displacement_m: Height | None = None
    width_m: Width | None = None
    force_n: Number | None = None
    direction_deg: Angle = 0.0

    @model_validator(mode="after")
    def _complete(self) -> CoupledInitialTable:
        needs = {"rest": set(), "triangle": {"position_m", "displacement_m"}, "drawn": {"position_m", "force_n"}}[self.shape]
        takes = needs | ({"width_m"} if self.shape == "triangle" else set())
        names = ("position_m", "displacement_m", "width_m", "force_n")
        given = {name for name in names if getattr(self, name) is not None}
        if given - takes:
            raise ValueError(f"shape {self.shape!r} does not take {', '.join(sorted(given - takes))}")
        if needs - given:
            raise ValueError(f"shape {self.shape!r} needs {', '.join(sorted(needs - given))}")
        return self


class DirectedFingerTable(FingerTable):
    direction_deg: Angle = 0.0


class FretTable(Table):
    start_s: Instant
    position_m: Width
    height_m: Height = 0.0
    ramp_s: Duration = 0.004


class CoupledStringTable(StringTable):
    name: str = ""
    place_mm: Annotated[float, _within(-500.0, 500.0, "mm")] = 0.0
    angle_deg: Angle = 0.0
    outputs_m: list[Place] = Field(default_factory=list)
    modes: Annotated[Whole, Field(ge=1, le=100_000)] | None = None
    substeps: Annotated[Steps, BeforeValidator(_whole)] | None = None
    polarisation: PolarisationTable | None = None
    obstacle: LineObstacleTable = LineObstacleTable()
    initial: CoupledInitialTable = CoupledInitialTable()
    finger: list[DirectedFingerTable] = Field(default_factory=list)
    bend: list[BendTable] = Field(default_factory=list)
    fret: list[FretTable] = Field(default_factory=list)

    @model_validator(mode="after")
    def _fits(self) -> CoupledStringTable:
        if self.fret and self.measured is not None:
            raise ValueError("measured modes belong to the open string; leave out fret or measured")
        if self.polarisation is None:
            slanted = [self.initial.direction_deg, *(finger.direction_deg for finger in self.finger)]
            if any(slanted):
                raise ValueError(
                    "direction_deg needs a second direction to go to; give [string.polarisation], or leave it out"
                )
        return self


class CoupledSchemeTable(Table):
    name: Literal["exact-hold", "complex-modes"] = "exact-hold"
    tail: Literal["static", "none"] = "static"
    substeps: Annotated[Steps, BeforeValidator(_whole)] = 1


class CoupledRunTable(RatesTable):
    modes: Annotated[Whole, Field(ge=1, le=100_000)]


class CoupledCase(Table):
    """The tables of a case of strings on a body; see the module's description."""

    string: list[CoupledStringTable] = Field(min_length=1, max_length=100)
    body: PresetBody
    scheme: CoupledSchemeTable = CoupledSchemeTable()
    run: CoupledRunTable

    def __repr__(self) -> str:
        """One line: the tables may be pages."""
        run = self.run
        return (
            f"<CoupledCase: {len(self.string)} strings on {len(self.body.mode)} body modes, {self.scheme.name}, "
            f"{run.duration_s:g} s at {run.internal_rate_hz:g} Hz>"
        )

    __str__ = __repr__

    @model_validator(mode="after")
    def _body_moves(self) -> CoupledCase:
        if not self.body.mode:
            raise ValueError(
                "body.mode: must have at least one mode, got none; strings on rigid ends are cases of one string"
            )
        names = [table.name or str(number) for number, table in enumerate(self.string, start=1)]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"string.name: {name!r} is the name of two strings; name them apart")
        if self.body.resonance:
            raise ValueError("body.resonance: a filter moves no string; give the body's modes as [[body.mode]]")
        return self


def read_coupled(case: Any, overrides: Mapping[str, Any] | None = None) -> tuple[CoupledCase, Path]:
    """A case of strings on a body, and the folder that its files count from. Raises CaseError."""
    tables, folder, origin = read_tables(case, overrides or {})
    return validated(CoupledCase, tables, origin), folder
