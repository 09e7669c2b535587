"""Which runs are made: case, scheme, rate and modes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from synth.physics.modes import count_modes_below
from synth.physics.obstacle import bass_neck_height
from synth.research.case import SchemeTable, load_case
from synth.research.scene import Scene
from synth.solver.schemes import SCHEMES

BASE_HZ = 44_100
#: the board twice: the elastic wall of the project's case, and a rigid one that takes all of what hits it. On a board,
#: unlike on points, the two sound differently, and a scheme can only be measured against the one that it means
ELASTIC, INELASTIC = "fretless", "fretless-inelastic"
CASES = ("tanpura", "bass", ELASTIC, INELASTIC)
#: modes of a converged run: of the paper
ALL_MODES = {"tanpura": 1001, "bass": 863, ELASTIC: 863, INELASTIC: 863}
LONGEST_S = {"tanpura": 3.0, "bass": 0.4, ELASTIC: 0.1, INELASTIC: 0.1}
#: end of the fretless board [m]: where the paper's last fret is
BOARD_END_M = 0.591
DEFAULT = SchemeTable().name
DEFAULT_TAIL = SchemeTable().tail_kind


@dataclass(frozen=True)
class Run:
    """One choice of everything; `table` holds what the scheme's table in the case has besides its name."""

    case: str
    scheme: str
    factor: int  # internal rate over 44.1 kHz
    modes: int
    table: tuple[tuple[str, Any], ...] = field(default=())
    nodes: int = 0  # of the fretless board

    @property
    def rate_hz(self) -> int:
        return self.factor * BASE_HZ

    @property
    def spec(self) -> dict[str, Any]:
        return {**asdict(self), "table": dict(self.table)}

    @property
    def label(self) -> str:
        """The scheme as tables and legends name it."""
        options = dict(self.table)
        label = self.scheme
        shown = {key: value for key, value in options.items() if key not in ("restitution", "residual_compliance", "tail")}
        if self.scheme == "exact-hold":
            default = DEFAULT_TAIL if 4 * self.nodes <= self.modes else "static"  # as `Scene.tail` has it
            tail = options.get("tail", default if options.get("residual_compliance", True) else "none")
            label += {"static": " + R", "lumped": " + lumped tail", "none": ", no R"}[tail]
            if shown.pop("substeps", 1) > 1:
                label += f", {options['substeps']} sub-steps"
        if self.scheme.startswith("moreau-jean"):
            label = {"moreau-jean": "Moreau–Jean, printed", "moreau-jean-filtered": "Moreau–Jean, filtered"}[self.scheme]
            label += f", e = {options.get('restitution', 1.0):g}"
        if "grid" in shown:
            label += {"contacts": ", at the contacts", "full": ", full grid"}[shown.pop("grid")]
        return ", ".join([label, *(f"{key} {value}" for key, value in shown.items())])

    def scene(self, duration_s: float, output_factor: int, ledger: bool = False) -> Scene:
        """The arrays of this run with displacements kept at output_factor × 44.1 kHz."""
        tables = tables_of(self.case, self.nodes)
        tables["scheme"] = {"name": self.scheme, **dict(self.table)}
        case = load_case(
            tables,  # type: ignore[arg-type]
            internal_rate_hz=self.rate_hz,
            output_rate_hz=output_factor * BASE_HZ,
            modes=self.modes,
            duration_s=duration_s,
            ledger=ledger,
        )
        return Scene(case, Path())


def tables_of(case: str, nodes: int = 0) -> dict[str, Any]:
    """Tables of a case; fretless: the bass over `nodes` points of a board that goes through its frets' tops.

    No nodes: the board as a wall, at every node of the modal grid.
    """
    board = case in (ELASTIC, INELASTIC)
    tables = load_case("bass" if board else case).model_dump(exclude_none=True)
    if board and nodes == 0:
        stiffness = {"stiffness_n_m2": "rigid"} if case == INELASTIC else {}
        tables["obstacle"] = {"wall": {"from_m": 0.0, "to_m": BOARD_END_M, "neck": "bass", **stiffness}}
    elif board:
        length = tables["string"]["length_m"]
        # on the grid of a whole number of equal parts of the string, as modal collocation would have it
        parts = max(2, round(nodes * length / BOARD_END_M))
        x = np.arange(1, parts) * (length / parts)
        x = x[x <= BOARD_END_M]
        tables["obstacle"] = {"positions_m": x.tolist(), "heights_m": bass_neck_height(x).tolist()}
    return tables


@cache
def modes_below_half(case: str, factor: int) -> int:
    """Modes below half the internal rate, no more than a converged run has."""
    string = Run(case, "exact-hold", 1, 1, nodes=2).scene(0.01, 1).string
    return min(ALL_MODES[case], count_modes_below(string, factor * BASE_HZ / 2))


def _table(**values: Any) -> tuple[tuple[str, Any], ...]:
    return tuple(sorted(values.items()))


#: the default's own table, then what stands for the modes left out: nothing, or their static compliance
AS_DEFAULT, WITHOUT_R = (), _table(residual_compliance=False)
WITH_R = _table(tail="static")
#: sub-steps of the contact, multiples of 44.1 kHz, modes
SUBSTEPPED = {
    "tanpura": ((2, 1, 103), (2, 1, 118), (3, 1, 118), (3, 1, 130), (4, 1, 179), (4, 2, 286), (4, 4, 432)),
    "bass": ((4, 1, 231), (8, 1, 427), (16, 1, 557), (16, 2, 557)),
}
FULL_GRID = _table(grid="full")
E0, E1 = _table(restitution=0.0), _table(restitution=1.0)
LAWS = ("exact-hold", "moreau-jean", "moreau-jean-filtered")
#: closed forms for ideal strings: none of the cases is one
_IDEAL = ("waveguide", "cabannes", "flat-wall")
#: contact all along a stretch
WALL = "wall"
RIVALS = tuple(scheme for scheme in SCHEMES if scheme not in (*LAWS, *_IDEAL, WALL))


def reference(case: str, short: bool) -> list[tuple[str, Run]]:
    """The finest run first, then what shows how far it stands: half its rate, and on the board half its points."""
    board = case in (ELASTIC, INELASTIC)
    if board:
        finest = Run(case, WALL, 16 if short else 48, 511 if short else 1023, E1 if case == ELASTIC else E0)
        half_points = replace(finest, modes=finest.modes // 2)
        return [("the finest", finest), ("half its rate", half_rate(finest)), ("half its points", half_points)]
    finest = Run(case, "exact-hold", 192 // (4 if short else 1), ALL_MODES[case], WITHOUT_R)
    return [("the finest", finest), ("half its rate", half_rate(finest))]


def half_rate(run: Run) -> Run:
    """The same at half the internal rate."""
    return replace(run, factor=run.factor // 2)


def runs(case: str, short: bool) -> list[Run]:
    """Every run of a case but the reference."""
    if case in (ELASTIC, INELASTIC):
        return _fretless(case, short)
    full = ALL_MODES[case]
    one_point = case == "tanpura"
    found: list[Run] = []

    def add(scheme: str, table: tuple[tuple[str, Any], ...], factors: tuple[int, ...], modes: int | None = None) -> None:
        for factor in factors:
            run = Run(case, scheme, factor, modes or modes_below_half(case, factor), table)
            if run not in found:
                found.append(run)

    if short:
        add("exact-hold", AS_DEFAULT, (1, 2, 4, 8) if one_point else (1, 2, 4))
        add("exact-hold", WITH_R, (1, 4))
        substeps, factor, modes = SUBSTEPPED[case][1]
        add("exact-hold", _table(substeps=substeps), (factor,), modes)
        add("exact-hold", WITHOUT_R, (1, 4), full)
        add("moreau-jean", E0, (1, 4), full)
        add("moreau-jean-filtered", E0, (1, 4), full)
        add("moreau-jean-filtered", E0, (2,))
        if one_point:
            add("moreau-jean", E0, (48,), full)
    else:
        add("exact-hold", AS_DEFAULT, (1, 2, 3, 4, 6, 8, 12, 16, 24))
        add("exact-hold", WITH_R, (1, 2, 3, 4, 6, 8, 12, 16, 24))
        for substeps, factor, modes in SUBSTEPPED[case]:
            add("exact-hold", _table(substeps=substeps), (factor,), modes)
        add("exact-hold", WITHOUT_R, (1, 2, 4, 8))
        add("exact-hold", WITHOUT_R, (1, 2, 4, 8, 24, 48), full)
        for scheme in ("moreau-jean", "moreau-jean-filtered"):
            add(scheme, E0, (1, 2, 4, 8))
            add(scheme, E0, (1, 2, 4, 8, 24, 48), full)
            add(scheme, E1, (2, 8, 24, 48), full)
        if one_point:
            add("moreau-jean-filtered", E0, (96, 192, 384), full)
    for scheme in RIVALS:
        if scheme == "event-driven" and not one_point:
            continue
        for table in variants(scheme):
            if table == FULL_GRID:
                add(scheme, table, (1,) if short else (1, 2, 4, 24), full)
            elif scheme == "event-driven":  # exact at any rate, which is only that of its rows
                add(scheme, table, (1,) if short else (1, 2, 4))
            elif short:
                add(scheme, table, (1, 4))
            else:
                add(scheme, table, (1, 2, 4, 8, 16))
                add(scheme, table, (1, 2, 4, 24, 48), full)
    return found


def variants(scheme: str) -> list[tuple[tuple[str, Any], ...]]:
    """The forms of a scheme that is no law of the block kernels, by its own options in the case's table."""
    if scheme == "compliant":
        return [_table(grid="contacts"), FULL_GRID]
    return [()]


def _fretless(case: str, short: bool) -> list[Run]:
    """Points at one rate, then rates at the most points, by every scheme that takes them."""
    found = []
    grid = [(nodes, 2) for nodes in (20, 40, 80)] if short else [(nodes, 8) for nodes in (20, 40, 80, 160, 320)]
    grid += [(160, factor) for factor in (1, 4)] if short else [(160, factor) for factor in (1, 2, 4, 16)]
    walls = [(2, 255), (4, 255)] if short else [(2, 127), (2, 255), (4, 255), (8, 255), (4, 511), (8, 511), (16, 511)]
    found += [Run(case, WALL, factor, modes, E1 if case == ELASTIC else E0) for factor, modes in walls]
    if case == INELASTIC:
        forms = [("exact-hold", AS_DEFAULT), ("moreau-jean-filtered", E0)]
    else:
        forms = [("moreau-jean-filtered", E1)]
        forms += [(scheme, table) for scheme in RIVALS if scheme != "event-driven" for table in variants(scheme)[:1]]
    for scheme, table in forms:
        for nodes, factor in grid:
            found.append(Run(case, scheme, factor, modes_below_half(case, factor), table, nodes))
    return found
