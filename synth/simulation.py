"""The research door: one string, one obstacle, one scheme, and everything that can be known of the run.

    result = synth.simulate("tanpura.toml", internal_rate_hz=88_200, modes=137, ledger=True)
    synth simulate tanpura.toml -o out.npz

A case is a TOML file (or the same tables as a dict; lists may then be NumPy arrays). SI units throughout; x counts from
the nut, heights and displacements from the string at rest, up is positive. Files named in a case are looked for beside
it. The program's own cases (`tanpura`, `bass`) can be given by name. Unknown keys are errors. * marks what must be there.

    [string]                    the model of Issanchou et al., JASA 143(5), 2018, appendix (A1–A5)
    length_m*, tension_n*, linear_density_kg_m*, diameter_m*
    inharmonicity               B; or bending_stiffness_n_m2 (EI); neither: an ideal string
    core_diameter_m, winding_diameter_m    of a wound string (the winding's is the wire's)
    viscoelastic_loss, thermoelastic_q_inverse                   δ_ve, Q_te⁻¹, default 0
    air_viscosity, air_density  default 1.8e-5 kg/(m s), 1.2 kg/m³; viscosity 0: no air
    stiffness_law               "sqrt" (default) √(1 + Bj²), or "linear" 1 + Bj²/2, the paper's
    nut = [{frequency_hz, q, modal_mass_kg}, …]                  resonances of what holds the end x = 0
    measured = {file, frequencies = "f", decay_rates = "sig"}    keys of an .npz: Hz and 1/s of modes 1 … m; the model
                                goes on behind them

    [obstacle]                  left out: none. Either
    positions_m, heights_m      one height per point, or a single one for all
    frets = {scale_length_m, count, action_12th_m, relief_m = 0, nut_height_m = 0.0004}

    [initial]                   left out: at rest
    shape                       "triangle", "modes" or "rest"
    position_m, displacement_m  of the triangle's corner before it is rounded
    rounding_half_width_m       parabola over position ± this; or width_m: base of a triangular kernel; or neither: sharp
    file, q, v                  "modes": keys of an .npz with q (and v = q̇) [m·√m] of modes 1 … m, zero behind; in a
                                dict q and v may be the arrays themselves

    [[finger]]                  takes hold of the string, draws it, lets go; any number, one after the other
    position_m*, displacement_m*    where to, at release
    width_m                     base of its triangular weighting, default 0.01
    start_s, draw_s*, hold_s    default start and hold 0; path: raised cosine from where the string is to displacement_m
    stiffness_n_m, resistance_n_s_m    spring and dashpot between finger and string, default 1e5 and 1

    [scheme]
    name                        "exact-hold" (default), "moreau-jean", "moreau-jean-filtered"
    restitution                 0 … 1, default 1; exact-hold has none and ignores it
    residual_compliance         default true: exact-hold adds the static compliance of the modes left out
    start                       Moreau–Jean: "exact" (default) first step by the exact propagator, or "published", w⁰ = q̇⁰

    [run]
    internal_rate_hz*, modes*, duration_s*
    output_rate_hz              divides the internal rate; default: the same. Plain sampling, nothing is filtered
    outputs_m*                  points whose displacement is wanted
    ledger                      default false: weigh every step (about three times slower)

A start pressed into the obstacle begins from the static contact solution (`solver.driver.static_contact`), at which the
contact forces of row 0 are those that hold it; `summary["lifted_m"]` says how far that moved a contact point.

What comes out, as attributes of `Result` and under the same names in the .npz; n rows, row 0 is t = 0:

    t (n,)                  [s]
    u (n, P)                displacement at outputs_m [m]
    u_contact (n, C)        displacement at the obstacle's points [m], with what residual compliance adds: S q + R λ
    contact_force (n, C)    mean force since the row before [N] (impulses over time); row 0: the static force
    with the ledger, (n,) [J]:
    energy_stored           of the modes; for Moreau–Jean the form of `solver.energy`
    energy_residual         ½ λᵀRλ, held by the modes left out
    energy_viscous, energy_contact    lost so far to damping, at contacts
    energy_injected         work of the fingers on the string so far, what their spring and dashpot keep left out
                            stored + residual + viscous + contact = stored(0) + residual(0) + injected
    positions               outputs_m; contact_positions, contact_heights the obstacle
    largest_penetration_m   over every step with the ledger, over the rows without; negative: never touched
    largest_energy_rise     of one step, over initial + injected energy; NaN without the ledger
    last_contact_s          end of the last step with a contact force; NaN: none
    metadata                JSON text: version, scheme, restitution, residual_compliance, start, internal_rate_hz,
                            output_rate_hz, modes, duration_s, case (all tables), summary
"""

from __future__ import annotations

import json
import math
import os
import time
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from synth.dsp.denormals import enable_ftz, restore
from synth.physics.excitation import pluck_weights, rounded_triangle, triangle_pluck
from synth.physics.modes import decay_rates, modal_frequencies, mode_shapes, residual_compliance
from synth.physics.obstacle import Obstacle, frets
from synth.physics.string import NutResonance, String
from synth.solver import driver
from synth.solver.kernels import Finger, finger_row, no_finger
from synth.solver.laws import EXACT_HOLD, SCHEMES, law_of
from synth.solver.lcp import SOLVED

_MOST_BYTES = 4 * 2**30
_MOST_MODE_STEPS = 1e14  # a day of one core


class CaseError(ValueError):
    """A case that cannot be run; the message has one line per fault and names file, table and key."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


class NutTable(_Table):
    frequency_hz: Positive
    q: Positive
    modal_mass_kg: Positive


class MeasuredTable(_Table):
    file: str
    frequencies: str = "f"
    decay_rates: str = "sig"


class StringTable(_Table):
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
    nut: list[NutTable] = []
    measured: MeasuredTable | None = None

    @model_validator(mode="after")
    def _one_stiffness(self) -> StringTable:
        if self.inharmonicity is not None and self.bending_stiffness_n_m2 is not None:
            raise ValueError("inharmonicity and bending_stiffness_n_m2 say the same; give one of them")
        return self


class FretsTable(_Table):
    scale_length_m: Positive
    count: int
    action_12th_m: Positive
    relief_m: NonNegative = 0.0
    nut_height_m: Positive = 0.0004


class ObstacleTable(_Table):
    positions_m: list[float] | None = None
    heights_m: list[float] | float | None = None
    frets: FretsTable | None = None

    @model_validator(mode="after")
    def _one_kind(self) -> ObstacleTable:
        if self.frets is not None:
            if self.positions_m is not None or self.heights_m is not None:
                raise ValueError("give either frets or positions_m and heights_m")
        elif (self.positions_m is None) != (self.heights_m is None):
            raise ValueError("positions_m and heights_m must be given together")
        return self


class InitialTable(_Table):
    shape: Literal["triangle", "modes", "rest"]
    position_m: Positive | None = None
    displacement_m: float | None = None
    rounding_half_width_m: NonNegative | None = None
    width_m: NonNegative | None = None
    file: str | None = None
    q: str | list[float] | None = None
    v: str | list[float] | None = None

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
        return self


class FingerTable(_Table):
    position_m: Positive
    displacement_m: float
    width_m: NonNegative = 0.01
    start_s: NonNegative = 0.0
    draw_s: Positive
    hold_s: NonNegative = 0.0
    stiffness_n_m: Positive = 1e5
    resistance_n_s_m: NonNegative = 1.0


class SchemeTable(_Table):
    name: str = "exact-hold"
    restitution: Annotated[float, Field(ge=0, le=1)] = 1.0
    residual_compliance: bool = True
    start: Literal["exact", "published"] = "exact"

    @model_validator(mode="after")
    def _known(self) -> SchemeTable:
        law_of(self.name)
        return self


class RunTable(_Table):
    internal_rate_hz: Positive
    output_rate_hz: Positive | None = None
    modes: Annotated[int, Field(ge=1)]
    duration_s: Positive
    outputs_m: Annotated[list[float], Field(min_length=1)]
    ledger: bool = False

    @model_validator(mode="after")
    def _divides(self) -> RunTable:
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


class Case(_Table):
    """A case file's tables; see the module's description."""

    string: StringTable
    obstacle: ObstacleTable = ObstacleTable()
    initial: InitialTable = InitialTable(shape="rest")
    finger: list[FingerTable] = []
    scheme: SchemeTable = SchemeTable()
    run: RunTable


#: what an override may replace: its name → table and key; the short names are the command line's
OVERRIDES = {
    "scheme": ("scheme", "name"),
    "restitution": ("scheme", "restitution"),
    "residual_compliance": ("scheme", "residual_compliance"),
    "start": ("scheme", "start"),
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


@dataclass(frozen=True)
class Result:
    """What a run gave; fields as in the module's description, `summary` and `metadata` as dicts."""

    t: np.ndarray
    u: np.ndarray
    u_contact: np.ndarray
    contact_force: np.ndarray
    energy_stored: np.ndarray | None
    energy_residual: np.ndarray | None
    energy_viscous: np.ndarray | None
    energy_contact: np.ndarray | None
    energy_injected: np.ndarray | None
    positions: np.ndarray
    contact_positions: np.ndarray
    contact_heights: np.ndarray
    largest_penetration_m: float
    largest_energy_rise: float
    last_contact_s: float
    metadata: dict[str, Any]

    @property
    def summary(self) -> dict[str, Any]:
        """The few numbers that `synth simulate` prints."""
        return self.metadata["summary"]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the .npz, first beside `path` under another name, then renamed: never half a file."""
        path = Path(path)
        arrays: dict[str, Any] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name == "metadata":
                value = json.dumps(value)
            if value is not None:
                arrays[field.name] = value
        beside = path.with_name(f".{path.name}.{os.getpid()}.partial")
        try:
            with open(beside, "wb") as file:
                np.savez(file, **arrays)
            os.replace(beside, path)
        finally:
            beside.unlink(missing_ok=True)


def simulate(case: Case | Mapping[str, Any] | str | os.PathLike[str], **overrides: Any) -> Result:
    """Runs a case: a file (or the name of one of the program's own), tables as a dict, or a `Case`.

    overrides : values that replace the case's, by the names in `OVERRIDES`; None replaces nothing.
    Raises CaseError (a ValueError) for a case that is wrong, ValueError for one that describes no possible string.
    """
    loaded, folder = _load(case, overrides)
    return Scene(loaded, folder).run()


def simulate_file(
    case: str | os.PathLike[str], out: str | os.PathLike[str], overrides: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """`simulate` to an .npz file; returns the summary."""
    folder = Path(out).resolve().parent
    if not folder.is_dir():
        raise FileNotFoundError(f"folder {folder} for the result does not exist")
    result = simulate(case, **dict(overrides or {}))
    result.save(out)
    return result.summary


def load_case(case: str | os.PathLike[str], **overrides: Any) -> Case:
    """The validated tables of a case file, or of one of the program's own cases by name."""
    return _load(case, overrides)[0]


def case_folder() -> Path:
    """Where the cases that come with the program are."""
    from synth.preset import preset_folder

    return preset_folder() / "cases"


def _load(case: Any, overrides: Mapping[str, Any]) -> tuple[Case, Path]:
    folder, origin = Path(), "case"
    if isinstance(case, Case):
        tables = case.model_dump()
    elif isinstance(case, Mapping):
        tables = _plain(case)
    else:
        path = Path(case)
        if path.suffix != ".toml" and not path.exists():
            path = case_folder() / f"{case}.toml"
            if not path.exists():
                known = ", ".join(sorted(p.stem for p in case_folder().glob("*.toml")))
                raise CaseError(f"case {str(case)!r} is not one of {known}; a file of your own ends in .toml")
        folder, origin = path.parent, str(path)
        try:
            tables = tomllib.loads(path.read_text(encoding="utf-8"))
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise CaseError(f"{origin}: not valid TOML: {error}") from None
    for name, value in overrides.items():
        if name not in OVERRIDES:
            raise CaseError(f"no override {name!r}; there are {', '.join(OVERRIDES)}")
        if value is not None:
            table, key = OVERRIDES[name]
            tables[table] = {**tables.get(table, {}), key: _plain(value)}
    try:
        return Case.model_validate(tables), folder
    except ValidationError as error:
        lines = []
        for item in error.errors():
            place = ".".join(str(part) for part in item["loc"]) or "file"
            got = item.get("input")
            shown = f", got {got!r}" if isinstance(got, int | float | str) else ""
            message = item["msg"].removeprefix("Value error, ")
            lines.append(f"{origin}: {place}: {message}{'' if 'got' in message else shown}")
        raise CaseError("\n".join(lines)) from None


def _plain(value: Any) -> Any:
    """Arrays and their scalars as lists and numbers, all the way down."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def _arrays(folder: Path, file: str, keys: dict[str, str]) -> dict[str, np.ndarray]:
    """The arrays of an .npz by what they are for; CaseError names file and key."""
    path = folder / file
    if not path.is_file():
        raise CaseError(f"file {path} does not exist; paths count from the case's folder")
    found = {}
    try:
        with np.load(path) as data:
            for what, key in keys.items():
                if key not in data.files:
                    raise CaseError(f"{path} has no array {key!r}; it has {', '.join(data.files)}")
                found[what] = np.asarray(data[key], dtype=np.float64)
                if found[what].ndim != 1 or not np.all(np.isfinite(found[what])):
                    raise CaseError(f"{path}: {key!r} must be one row of finite numbers, got {found[what].shape}")
    except CaseError:
        raise
    except (OSError, ValueError) as error:
        raise CaseError(f"{path} cannot be read as .npz: {error}") from None
    return found


class Scene:
    """A case turned into arrays (`model`, `string`, `obstacle`), and its run; files count from `folder`."""

    def __init__(self, case: Case, folder: Path) -> None:
        self.case, self.folder = case, folder
        self.law = law_of(case.scheme.name)
        self.dt = 1.0 / case.run.internal_rate_hz
        self.steps = max(1, round(case.run.duration_s * case.run.internal_rate_hz))
        every = case.run.steps_per_output
        self.outputs = self.steps // every + 1
        self.string = self._string()
        self.obstacle = self._obstacle()
        self._refuse_the_absurd()

        length, n = self.string.length_m, case.run.modes
        self.fingers = sorted(case.finger, key=lambda f: f.start_s)
        for number, finger in enumerate(self.fingers):
            pluck_weights(length, finger.position_m, finger.width_m, 1)
            if number and finger.start_s < self._end(self.fingers[number - 1]):
                raise CaseError("finger: one must let go before the next takes hold")
        contacts = np.array(self.obstacle.positions_m)
        compliant = self.law == EXACT_HOLD and case.scheme.residual_compliance and contacts.size > 0
        self.model = driver.make_model(
            self.law,
            modal_frequencies(self.string, n),
            decay_rates(self.string, n),
            self.string.linear_density_kg_m,
            self.dt,
            mode_shapes(length, contacts, n),
            np.array(self.obstacle.heights_m),
            residual_compliance(self.string, contacts, n) if compliant else np.zeros((contacts.size,) * 2),
            mode_shapes(length, np.array(case.run.outputs_m), n),
            case.scheme.restitution,
        )

    def _string(self) -> String:
        table = self.case.string
        values = table.model_dump(exclude={"inharmonicity", "bending_stiffness_n_m2", "nut", "measured"})
        values["nut"] = tuple(NutResonance(**nut.model_dump()) for nut in table.nut)
        if table.measured is not None:
            found = _arrays(
                self.folder,
                table.measured.file,
                {"frequencies": table.measured.frequencies, "rates": table.measured.decay_rates},
            )
            values["measured_frequencies_hz"] = tuple(found["frequencies"])
            values["measured_decay_rates"] = tuple(found["rates"])
        if table.inharmonicity is not None:
            return String.from_inharmonicity(inharmonicity=table.inharmonicity, **values)
        return String(bending_stiffness_n_m2=table.bending_stiffness_n_m2 or 0.0, **values)

    def _obstacle(self) -> Obstacle:
        table = self.case.obstacle
        if table.frets is not None:
            obstacle = frets(**table.frets.model_dump())
        elif table.positions_m is not None:
            heights = table.heights_m
            if not isinstance(heights, list):
                heights = [heights] * len(table.positions_m)  # type: ignore[list-item]
            obstacle = Obstacle(tuple(table.positions_m), tuple(heights))  # type: ignore[arg-type]
        else:
            obstacle = Obstacle()
        obstacle.check(self.string.length_m)
        return obstacle

    def _refuse_the_absurd(self) -> None:
        run = self.case.run
        contacts, points = len(self.obstacle), len(run.outputs_m)
        columns = 1 + points + 2 * contacts + (5 if run.ledger else 0)
        n_bytes = 8.0 * (self.outputs * columns + run.modes * (contacts + points + 12) + run.steps_per_output * contacts)
        if n_bytes > _MOST_BYTES:
            raise CaseError(
                f"run: the results would take {n_bytes / 2**30:.1f} GiB, the limit is {_MOST_BYTES / 2**30:.0f}; "
                "lower output_rate_hz, duration_s or the number of points"
            )
        work = float(self.steps) * run.modes * (1 + contacts)
        if work > _MOST_MODE_STEPS:
            raise CaseError(
                f"run: {work:.1e} mode-steps would take days, the limit is {_MOST_MODE_STEPS:.0e}; "
                "lower internal_rate_hz, modes or duration_s"
            )

    def initial(self) -> tuple[np.ndarray, np.ndarray]:
        """q, v (N,) as the case gives them, whatever the obstacle says to that."""
        table, n, length = self.case.initial, self.case.run.modes, self.string.length_m
        q, v = np.zeros(n), np.zeros(n)
        if table.shape == "triangle":
            assert table.position_m is not None and table.displacement_m is not None
            where = (length, table.position_m, table.displacement_m)
            if table.rounding_half_width_m is not None:
                q = rounded_triangle(*where, table.rounding_half_width_m, n)
            else:
                q = triangle_pluck(*where, table.width_m or 0.0, n)
        elif table.shape == "modes":
            keys = {name: key for name in ("q", "v") if isinstance(key := getattr(table, name), str)}
            found = _arrays(self.folder, table.file, keys) if table.file is not None and keys else {}
            for name, target in (("q", q), ("v", v)):
                given = found.get(name, getattr(table, name))
                if given is not None:
                    given = np.asarray(given, dtype=np.float64)[:n]
                    target[: given.size] = given
        return q, v

    def _end(self, finger: FingerTable) -> float:
        return finger.start_s + finger.draw_s + finger.hold_s

    def run(self) -> Result:
        """From t = 0 to the end."""
        case, model = self.case, self.model
        q0, v0 = self.initial()
        q, force, status = driver.static_contact(model, q0)
        if status != SOLVED:
            raise CaseError("obstacle: no static shape of the string lies over it; lower heights_m or take more modes")
        lifted = model.shapes @ (q - q0)
        every, ledger = case.run.steps_per_output, case.run.ledger
        published = case.scheme.start == "published"
        started = time.perf_counter()
        state = driver.start_run(model, q, v0, force, every, self.outputs, ledger, published)
        flush = enable_ftz()
        try:
            for finger in self.fingers:
                begin = max(round(finger.start_s / self.dt), int(state.counts[driver.STEPS]))
                self._advance(state, begin, None)
                end = max(begin + 1, round(self._end(finger) / self.dt))
                self._advance(state, min(end, self.steps), finger)
            self._advance(state, self.steps, None)
        finally:
            restore(flush)
        seconds = time.perf_counter() - started
        return self._result(state, float(np.abs(lifted).max(initial=0.0)), seconds)

    def _advance(self, state: driver.Run, until: int, finger: FingerTable | None) -> None:
        steps = until - int(state.counts[driver.STEPS])
        if steps <= 0:
            return
        model = self.model
        if finger is None:
            driver.run(model, state, steps, no_finger(model.omega.size, model.eta.size))
            return
        weights = pluck_weights(self.string.length_m, finger.position_m, finger.width_m, model.omega.size)
        coupling = np.zeros(model.eta.size)
        own = finger_row(model.law, model.coef, model.shapes, weights, coupling)
        here = float(weights @ state.q)
        ramp = np.clip(np.arange(steps + 1) * self.dt / finger.draw_s, 0.0, 1.0)
        path = here + (finger.displacement_m - here) * 0.5 * (1.0 - np.cos(np.pi * ramp))
        row = Finger(1, weights, coupling, own, finger.stiffness_n_m, finger.resistance_n_s_m, path, np.array([here, 0.0]))
        driver.run(model, state, steps, row)

    def _result(self, state: driver.Run, lifted: float, seconds: float) -> Result:
        case, sums, counts = self.case, state.sums, state.counts
        ledger = case.run.ledger
        energy = dict(zip(driver.ENERGY_COLUMNS, state.energy.T, strict=True)) if ledger else {}
        last = int(counts[driver.LAST_CONTACT])
        penetration = float(sums[driver.PENETRATION])
        compliant = bool(np.any(self.model.residual))
        summary: dict[str, Any] = {
            "scheme": case.scheme.name,
            "internal_rate_hz": case.run.internal_rate_hz,
            "modes": case.run.modes,
            "contacts": len(self.obstacle),
            "steps": self.steps,
            "rows": self.outputs,
            "finite": bool(np.all(np.isfinite(state.u))),
            "largest_displacement_m": float(np.abs(state.u).max()),
            "largest_penetration_m": penetration,
            "last_contact_s": last * self.dt if last >= 0 else None,
            "contact_steps": int(counts[driver.CONTACT_STEPS]),
            "unsolved_steps": int(counts[driver.BAD_STEPS]),
            "started_from_static_contact": lifted > 0.0,
            "lifted_m": lifted,
            "compute_s": seconds,
        }
        if ledger:
            summary["largest_energy_rise"] = float(sums[driver.RISE])
            summary["initial_energy_j"] = float(sums[driver.INITIAL])
        metadata = {
            "version": _version(),
            "scheme": case.scheme.name,
            "restitution": None if self.law == EXACT_HOLD else case.scheme.restitution,
            "residual_compliance": compliant,
            "start": "static contact" if lifted > 0.0 else "as given",
            "internal_rate_hz": case.run.internal_rate_hz,
            "output_rate_hz": case.run.internal_rate_hz / case.run.steps_per_output,
            "modes": case.run.modes,
            "duration_s": self.steps * self.dt,
            "case": case.model_dump(),
            "summary": summary,
        }
        if self.law != EXACT_HOLD:
            metadata["first_step"] = case.scheme.start
        return Result(
            t=np.arange(self.outputs) * case.run.steps_per_output / case.run.internal_rate_hz,
            u=state.u,
            u_contact=state.contact_u,
            contact_force=state.contact_force,
            energy_stored=energy.get("stored"),
            energy_residual=energy.get("residual"),
            energy_viscous=energy.get("viscous"),
            energy_contact=energy.get("contact"),
            energy_injected=energy.get("injected"),
            positions=np.array(case.run.outputs_m),
            contact_positions=np.array(self.obstacle.positions_m),
            contact_heights=np.array(self.obstacle.heights_m),
            largest_penetration_m=penetration,
            largest_energy_rise=float(sums[driver.RISE]) if ledger else math.nan,
            last_contact_s=last * self.dt if last >= 0 else math.nan,
            metadata=metadata,
        )


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("jawari")
    except PackageNotFoundError:
        return "unknown"


__all__ = ["OVERRIDES", "SCHEMES", "Case", "CaseError", "Result", "load_case", "simulate", "simulate_file"]
