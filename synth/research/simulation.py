"""The research door: strings, obstacles, a scheme, and everything that can be known of the run.

    result = synth.simulate("tanpura.toml", internal_rate_hz=88_200, modes=137, ledger=True)
    synth simulate tanpura.toml -o out.npz

A case is a TOML file (or the same tables as a dict; lists may then be NumPy arrays). SI units throughout; x counts from
the nut, heights and displacements from the string at rest, up is positive. Files named in a case are looked for beside
it. Several strings that share a bridge and a body ([[string]], [[body.mode]]) are described in `research.coupled`:
`coupled_case` has their tables, `coupled_result` what comes out; the rest is of one string on rigid ends.
The program's own cases (`tanpura`, `cabannes`, `hard/two-close`, …; `case.case_names()`) can be given by name. Unknown
keys are errors. * marks what must be there.

    [string]                    the model of Issanchou et al., JASA 143(5), 2018, appendix (A1–A5)
    length_m*, tension_n*, linear_density_kg_m*, diameter_m*
    inharmonicity               B; or bending_stiffness_n_m2 (EI); neither: an ideal string
    core_diameter_m, winding_diameter_m    of a wound string (the winding's is the wire's)
    viscoelastic_loss, thermoelastic_q_inverse                   δ_ve, Q_te⁻¹, default 0
    air_viscosity, air_density  default 1.8e-5 kg/(m s), 1.2 kg/m³; viscosity 0: no air
    stiffness_law               "sqrt" (default) √(1 + Bj²), or "linear" 1 + Bj²/2, the paper's
    nut = [{frequency_hz, q, mass_kg}, …]                  resonances of what holds the end x = 0
    measured = {file, frequencies = "f", decay_rates = "sig"}    keys of an .npz: Hz and 1/s of modes 1 … m; the model
                                goes on behind them

    [obstacle]                  left out: none. Either
    positions_m, heights_m      one height per point, or a single one for all
    frets = {scale_length_m, count, action_12th_m, relief_m = 0, nut_height_m = 0.0004}
    wall = {from_m, to_m, …}    contact all along a stretch, its height one of: height_m; neck = "bass" (the paper's, without
                                frets); parabola = {top_m, height_m = 0, radius_m}, a curved bridge. Points: nodes or
                                spacing_m; neither: the modal grid, for scheme "wall" (then the default).
                                stiffness_n_m2 = 1e8, of that scheme alone: [N/m per m], or "rigid"
    [obstacle.layer]            what is soft on every point or fret, whose heights are those of its surface; exact-hold's
    stiffness_n_m*, thickness_m*, resistance_n_s_m    spring and dashpot (default 0), as deep as it is thick; rigid behind
    [[obstacle.motion.ramp]]    moves all points or frets, any number; what they and the sines give adds up
    duration_s*, displacement_m*, start_s    raised cosine from 0 to displacement_m, where it stays; start_s default 0
    [[obstacle.motion.sine]]
    frequency_hz*, amplitude_m*, start_s     amplitude·sin(2πf(t − start_s)) from start_s (default 0) on

    [initial]                   left out: at rest
    shape                       "triangle", "modes" or "rest"
    position_m, displacement_m  of the triangle's corner before it is rounded
    rounding_half_width_m       parabola over position ± this; or width_m: base of a triangular kernel; or neither: sharp
    file, q, v                  "modes": keys of an .npz with q (and v = q̇) [m·√m] of modes 1 … m, zero behind; in a
                                dict q and v may be the arrays themselves

    [[finger]]                  takes hold of the string, draws it, lets go; any number, one after the other
    position_m*, displacement_m*    where to, before the string slides off
    width_m                     base of its triangular weighting, default 0.01
    start_s, draw_s*, hold_s    default start and hold 0; path: raised cosine from where the string is to displacement_m
    slip_s                      0 … 1, default 0: then the string slides off, the finger's force fading as half a cosine from
                                what it was to 0 (Chadefaux et al., JASA 133(4), 2013); 0: let go at once
    stiffness_n_m, resistance_n_s_m    spring and dashpot between finger and string, default 1e5 and 1

    [[bend]]                    changes the string's tension, any number; what they give adds up and stays
    duration_s*, cents*, start_s    raised cosine from 0 to cents of the first mode, renewed every ms, start_s 0; shapes and
                                (q, q̇) are carried over, frequencies, losses and residual compliance follow

    [scheme]
    name                        "exact-hold" (default), "moreau-jean", "moreau-jean-filtered"; with a compliant contact
                                "compliant", "energy-quadratisation", "scalar-auxiliary-variable"; along a wall "wall"; exact
                                solutions where there is one: "waveguide", "cabannes", "flat-wall", "event-driven"
    restitution                 0 … 1, default 1; exact-hold has none and ignores it
    tail                        exact-hold, what stands for the modes left out: "lumped", one or two damped modes per contact
                                (`physics.tail`), "static", their static compliance, or "none". Default: lumped; static
                                with a bend or more contacts than a fourth of the modes
    residual_compliance         default true; false: tail = "none". Event-driven takes static compliance or none
    substeps                    exact-hold, default 1: the contact force changes K times a step while the modes advance
                                once (`solver.substeps`); one contact is fastest with 2, 3 or 4; not over a moving obstacle
    start                       Moreau–Jean: "exact" (default) first step by the exact propagator, or "published", w⁰ = q̇⁰
    stiffness, exponent         compliant contacts, f = K [η − u]₊^α: K of a point in N/m^α, default 1e10, and α ≥ 1, default
                                1.5. Issanchou et al.'s K = 1e13 is per metre, at the nodes of their grid of 1 mm: 1e10
    loss                        s/m, default 0: Hunt–Crossley, f = K [g]₊^α (1 + loss·ġ); not scalar-auxiliary-variable
    tolerance, iterations       compliant: of Newton's last step, relative to the depths, default 1e-12; at most, default 50
    grid                        compliant: "contacts" (default), or "full": S over all inner nodes x_i = iL/(modes + 1), the
                                points moved to the nearest, as first published. The same motion, at many times the cost
    drift_correction            scalar-auxiliary-variable: 0 … 1, default 0: part of the drift of ψ taken back in a step

    [run]
    internal_rate_hz*, modes*, duration_s*
    output_rate_hz              divides the internal rate; default: the same. Plain sampling, nothing is filtered
    outputs_m*                  points whose displacement is wanted
    ledger                      default false: weigh every step (about three times slower)

A start pressed into the obstacle begins from the static contact solution (`solver.driver.static_contact`), at which the
contact forces of row 0 are those that hold it; `summary["lifted_m"]` says how far that moved a contact point. Compliant
contacts begin as given. They take no fingers, ignore residual_compliance, and say in the summary how many Newton
iterations they needed, or how far the auxiliary variable drifted from √(2V), in √J (`auxiliary_drift`) and relative to
√(2 · initial energy), and `largest_adhesion_n`, the strongest pull of a contact.

Scheme "wall" says in the summary how many instants were looked at (`steps_looked_at`) and from when on the string is
certain to fly free for ever (`free_from_s`; null: not within the run).

A run goes on from where another ended (`simulate(case, resume_from=…)`, `synth simulate CASE --from out.npz`): its
time counts on from that run's last row, which is its row 0, for duration_s more. String, obstacle, scheme, internal
rate and modes must be the same, and fingers, bends and motions that had begun; those to come, outputs_m, rows and
ledger may be others; [initial] is of no account. With the ledger in both its losses and work count on; what is
largest, last or counted is of its own steps. A run of 2 T and one of T with another of T from it have the same bits
where steps are taken one at a time (with the ledger, under a finger, over what moves; compliant contacts) and where T
is whole blocks of eight steps (Moreau–Jean from the exact start: and one more) or rows are; else they are the same to
rounding, as are waves and event-driven runs to their last digits and walls to 1e-11 of the largest: what contacts
make of that later is another matter. Closed forms (cabannes, flat-wall) keep nothing to go on from. Another kind of
run starts from the last shape by [initial] shape = "modes", file = "out.npz", q = "final_q", v = "final_v".

What comes out, as attributes of `Result` and under the same names in the .npz (`synth.load_result` gives the Result back); n
rows, row 0 is t = 0. A name that ends in .csv gets t, u, u_contact, contact_force and energies as a table.

    t (n,)                  [s]
    u (n, P)                displacement at outputs_m [m]
    u_contact (n, C)        displacement at the obstacle's points [m], with what residual compliance adds: S q + R λ
    contact_force (n, C)    mean force since the row before [N] (impulses over time); row 0: the static force, or that of
                            the row gone on from
                            scheme "wall": both are made when first read, by the same run once more
    with the ledger, (n,) [J]:
    energy_stored           of the modes; for Moreau–Jean the form of `solver.energy`
    energy_residual         ½ λᵀRλ, held by the modes left out, and by soft layers; in compliant contacts: their potential,
                            or ½ψ²; in a wall's springs
    energy_viscous, energy_contact    lost so far to damping, at contacts
    energy_injected         work on the string so far of the fingers (what their spring and dashpot keep left out), of the
                            moving obstacle (λ·Δη) and of whoever bends it
                            stored + residual + viscous + contact = stored(0) + residual(0) + injected
    positions               outputs_m; contact_positions, contact_heights the obstacle at t = 0
    obstacle_displacement (n,)    with motion: how far the obstacle is above contact_heights [m]
    largest_penetration_m   over every step with the ledger, over the rows without; negative: never touched. Of a soft layer:
                            beyond its thickness
    largest_energy_rise     of one step, over initial + injected energy; NaN without the ledger. Of exact-hold below 1e-12,
                            rounding, unless a finger clamps the string on a point (`schemes.clamping_warning`)
    last_contact_s          end of the last step with a contact force; NaN: none
    final_q, final_v (N,)   modes 1 … N at the last row [m·√m], [m·√m/s]; of Moreau–Jean and compliant contacts v is the
                            backward difference of q; None (not in the .npz): closed forms, waves
    state                   what the scheme goes on from, its own arrays by name (in the .npz state.NAME); None: nothing
    metadata                JSON text: version, scheme, restitution, residual_compliance, tail, substeps, start,
                            internal_rate_hz, output_rate_hz, modes, duration_s, end_step, case (all tables), summary
                            (its compute_s is of the steps alone, compile_s what compiling kernels took before)
"""

from __future__ import annotations

import inspect
import json
import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypedDict, Unpack

import numpy as np
from numba.core.event import install_timer
from threadpoolctl import threadpool_limits

import synth
from synth.files.targets import Named, check_apart, check_target
from synth.instrument.plan import WALL_RESTITUTION, plan_string, plan_wall, scene_kind
from synth.research import methods
from synth.research.case import (
    OVERRIDES,
    Case,
    CaseError,
    case_folder,
    files_of,
    is_coupled,
    load_case,
    read_case,
    read_tables,
    validated,
)
from synth.research.coupled.coupled_result import CoupledResult
from synth.research.coupled.coupled_simulation import refuse_of_one_string, simulate_coupled
from synth.research.result import Result, ResultError, check_name, load_result
from synth.research.scene import Scene
from synth.solver import study
from synth.solver.problem import Outcome
from synth.solver.schemes import SCHEMES, clamping_warning, energy_warning, rise_warning

DEFAULT_RATE_HZ = 44100.0


class SchemeOverrides(TypedDict, total=False):
    """Keys of a case's [scheme] by name, but for `name`, which is `scheme`; None replaces nothing."""

    scheme: str | None
    restitution: float | None
    residual_compliance: bool | None
    tail: str | None
    substeps: int | None
    start: str | None
    stiffness: float | None
    exponent: float | None
    loss: float | None
    tolerance: float | None
    iterations: int | None
    grid: str | None
    drift_correction: float | None


class Overrides(SchemeOverrides, total=False):
    """What `simulate` may be given by name instead of in the case, and `quality`; None replaces nothing."""

    quality: str | None
    internal_rate_hz: float | None
    output_rate_hz: float | None
    modes: int | None
    duration_s: float | None
    outputs_m: Sequence[float] | np.ndarray | None
    ledger: bool | None
    rate: float | None
    internal_rate: float | None
    output_rate: float | None
    duration: float | None


def simulate(
    case: Case | Mapping[str, Any] | str | os.PathLike[str],
    *,
    resume_from: Result | str | os.PathLike[str] | None = None,
    warn: Callable[[str], None] | None = None,
    settings: Mapping[str, Any] | None = None,
    **overrides: Unpack[Overrides],
) -> Result | CoupledResult:
    """Runs a case: strings, an obstacle, a start and a scheme, from t = 0 or from where another run ended.

    Parameters
    ----------
    case : Case, dict, str or path
        A TOML file, the name of one of the program's own (`case_names`), its tables as a dict, or a `Case`.
    resume_from : Result, str or path, optional
        A result, or the .npz of one: the run goes on from where that one ended, for the case's duration more. See
        help(synth.research.simulation) for what must be the same.
    warn : callable, optional
        Called with a line of text: before the run when the scheme may gain energy at this rate (`schemes.energy_warning`) or
        takes no account of something that is given; after it, of steps that were not solved, of energy that a string gained
        by rounding between finger and point (`schemes.clamping_warning`), of a step of Moreau–Jean that gained energy
        although the rate is one of the safe ones (`schemes.rise_warning`, with the ledger), and of results that are not
        finite.
    settings : dict, optional
        Any keys of the case by their dotted names, {"string.tension_n": 60.0, "obstacle.heights_m": [0.0]}, as
        `synth simulate --set` takes them; a number counts in a list of tables ("string.0.length_m"); None takes a key away.
    quality : str, optional
        "draft", "standard", "fine" or "reference": internal rate and modes as `plan` gives them to a string of the engine
        (exact-hold; here without the decimator's limit) or to an elastic wall; the output rate is the case's, 44.1 kHz if it
        names none. Nothing is promised with another tail or with sub-steps. This and what follows replaces the case's
        values; None replaces nothing.
    scheme : str, optional
        How contacts are computed: "exact-hold" and the others of docs/simulate.md.
    restitution : float, optional
        Of the Moreau–Jean schemes and of walls, 0 … 1: what a contact keeps of a blow's speed.
    residual_compliance : bool, optional
        False: tail "none".
    tail : str, optional
        Of exact-hold, what stands for the modes left out: "lumped", "static" or "none".
    substeps : int, optional
        Of exact-hold, the contact force changes so many times in a step.
    start : str, optional
        Of Moreau–Jean, the first step by the exact propagator ("exact") or as printed ("published").
    stiffness, exponent : float, optional
        Of compliant contacts, K [N/m^α] and α of f = K [η − u]₊^α at a point.
    loss : float, optional
        Of compliant contacts, Hunt–Crossley's [s/m].
    tolerance, iterations : float and int, optional
        Of compliant, Newton's last step relative to the depths, and how many there are at most.
    grid : str, optional
        Of compliant contacts, "contacts" alone, or "full": all inner nodes.
    drift_correction : float, optional
        Of the scalar auxiliary variable, part of the drift taken back in a step, 0 … 1.
    internal_rate_hz, internal_rate, rate : float, optional
        Steps of the model per second [Hz]; three names of one value.
    output_rate_hz, output_rate : float, optional
        Rows of the result per second, which divides the internal rate [Hz].
    modes : int, optional
        How many modes of the string are computed.
    duration_s, duration : float, optional
        How long the run is [s].
    outputs_m : sequence of float, optional
        Points whose displacement is wanted, from the nut [m].
    ledger : bool, optional
        Whether every step is weighed: where the energy is and goes; about three times slower.

    Returns
    -------
    Result or CoupledResult
        Arrays over time; a CoupledResult for strings on a body.

    Raises
    ------
    CaseError
        For a case that is wrong (a ValueError).
    ValueError
        For a case that describes no possible string.
    ResultError
        For a file of `resume_from` that is no result (a ValueError).
    TypeError
        For arguments of another kind.

    Notes
    -----
    Every key of a case with its unit, range and default: docs/reference/case-keys.md, or help(synth.research.simulation).

    References
    ----------
    Issanchou, Acary, Pérignon, Touzé, Le Carrou, JASA 143(5), 2018: the string (A1–A5) and Moreau–Jean's contact. The other
    schemes' sources stand in docs/simulate.md; `Result.citation` gives those of a run.

    Examples
    --------
    >>> import synth
    >>> run = synth.simulate("tanpura", quality="draft", duration_s=0.01)
    >>> run.u.shape, bool(run.contact_force.any())
    ((442, 1), True)
    """
    if warn is not None and not callable(warn):
        raise TypeError(f"warn is a function that is told a line, got {type(warn).__name__} {warn!r:.60}")
    if not isinstance(resume_from, Result | str | os.PathLike | None):
        raise TypeError(
            f"resume_from is a Result or the path of its .npz, got {type(resume_from).__name__} {resume_from!r:.60}"
        )
    with threadpool_limits(limits=1, user_api="blas"), install_timer("numba:compile", lambda duration: None) as compiling:
        result = _simulate(case, resume_from, warn or (lambda text: None), _with_settings({**overrides}, settings))
    result.summary["compile_s"] = compiling.duration if compiling.done else 0.0
    return result


# what a notebook completes and help() shows; a type checker reads Unpack
simulate.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
    [
        *(p for p in inspect.signature(simulate).parameters.values() if p.kind is not p.VAR_KEYWORD),
        *(
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=annotation)
            for name, annotation in Overrides.__annotations__.items()
        ),
    ],
    return_annotation=Result | CoupledResult,
)


def _with_settings(overrides: dict[str, Any], settings: Mapping[str, Any] | None) -> dict[str, Any]:
    """The overrides with settings by dotted keys, those that overrides name too by the overrides' names. Raises CaseError
    for a key that is none or given twice, TypeError for what is no mapping."""
    if settings is None:
        return overrides
    if not isinstance(settings, Mapping) or not all(isinstance(key, str) for key in settings):
        raise TypeError(f'settings are a dict of dotted keys, such as {{"string.tension_n": 60.0}}, got {settings!r:.60}')
    found = dict(overrides)
    for key, value in settings.items():
        place = tuple(key.split("."))
        if len(place) < 2 or not all(place):
            whole = ".".join(OVERRIDES[key]) if key in OVERRIDES else "string.tension_n"
            raise CaseError(f"no setting {key!r:.60}; its tables go before it with dots, such as {whole}")
        same = [name for name, there in OVERRIDES.items() if there == place]
        twice = [name for name in same if overrides.get(name) is not None]
        if twice:
            raise CaseError(f"setting {key} and {twice[0]} are the same; give one of them")
        found[same[0] if same and value is not None else key] = value
    return found


def _simulate(
    case: Any, resume_from: Result | str | os.PathLike[str] | None, warn: Callable[[str], None], overrides: dict[str, Any]
) -> Result | CoupledResult:
    quality = overrides.pop("quality", None)
    try:
        tables, folder, origin = read_tables(case, overrides)
        if is_coupled(tables):
            refuse_of_one_string(resume_from, quality)
            return simulate_coupled(tables, folder, origin, warn)
        if quality is None:
            loaded = validated(Case, tables, origin)
        else:
            loaded, folder = read_case(case, _planned(case, overrides, quality, warn))
        if resume_from is None:
            scene = Scene(loaded, folder)
        else:
            ended = resume_from if isinstance(resume_from, Result) else load_result(resume_from)
            first, kept = _ended(ended, loaded)
            scene = Scene(loaded, folder, first, kept)
            _refuse_another(scene, ended)
        for text in _warnings(scene, overrides):
            warn(text)
        result = _result(scene, methods.run(scene))
    except (ArithmeticError, MemoryError) as error:
        reason = error.args[-1] if error.args else type(error).__name__
        raise CaseError(
            f"case: its numbers are too large or too small to compute with ({reason}); check the units"
        ) from None
    summary = result.summary
    if summary["unsolved_steps"]:
        warn(
            f"{summary['unsolved_steps']} of {summary['steps']} steps were not solved to tolerance; raise the internal rate"
        )
    if scene.fingers and scene.case.scheme.name == "exact-hold":
        clamped = clamping_warning(result.largest_energy_rise, float(result.contact_force.max(initial=0.0)))
        if clamped is not None:
            warn(clamped)
    rate_hz, highest_hz = scene.case.run.internal_rate_hz, float(scene.omega.max()) / (2.0 * math.pi)
    scheme = scene.case.scheme
    if energy_warning(scheme.name, scheme.restitution, rate_hz, "", 1.0, highest_hz) is None:
        gained = rise_warning(scheme.name, result.largest_energy_rise)
        if gained is not None:
            warn(gained)
    if not summary["finite"]:
        warn("the results are not finite; check the units of the case, or raise the internal rate")
    return result


#: what to do where a run cannot go on as it was
_ANEW = (
    'a run goes on only as it was; to start another from its last shape take [initial] shape = "modes", file = the .npz, '
    'q = "final_q", v = "final_v"'
)


def _ended(ended: Result, case: Case) -> tuple[int, dict[str, np.ndarray]]:
    """The step at which a run ended and its state; CaseError where this case cannot go on from there."""
    name = ended.metadata["scheme"]
    if ended.state is None:
        raise CaseError(
            f"resume_from: that run of scheme {name!r} has kept nothing to go on from; run it for the whole time"
        )
    then, now = ended.metadata["case"], json.loads(json.dumps(case.model_dump()))
    end_s = float(ended.t[-1])
    changed = []
    for place in (*(("string", key) for key in now["string"]), *(("scheme", key) for key in now["scheme"]),
                  ("run", "internal_rate_hz"), ("run", "modes"), *(("obstacle", key) for key in now["obstacle"]),
                  ("obstacle", "motion", "ramp"), ("obstacle", "motion", "sine"), ("finger",), ("bend",)):  # fmt: skip
        if place == ("obstacle", "motion"):
            continue
        before, here = _at(then, place), _at(now, place)
        if place == ("finger",) and _timed(before):  # of a version that knew no slip
            before = [{"slip_s": 0.0} | one for one in before]
        if place[-1] in ("ramp", "sine", "finger", "bend"):  # those to come may be others
            before, here = (
                [one for one in tables if one["start_s"] < end_s] if _timed(tables) else tables for tables in (before, here)
            )
        if before != here:
            changed.append(f"{'.'.join(place)} was {before!r:.60} there, is {here!r:.60} here")
    if changed:
        raise CaseError(f"resume_from: {'; '.join(changed)}; {_ANEW}")
    if not all(np.all(np.isfinite(array)) for array in ended.state.values()):
        raise CaseError("resume_from: that run ended in numbers that are not finite; nothing goes on from there")
    return ended.metadata["end_step"], ended.state


def _timed(tables: Any) -> bool:
    return isinstance(tables, list) and all(
        isinstance(one, dict) and isinstance(one.get("start_s"), float | int) for one in tables
    )


def _at(tables: Any, place: Sequence[str]) -> Any:
    for key in place:
        tables = tables.get(key) if isinstance(tables, dict) else None
    return tables


def _refuse_another(scene: Scene, ended: Result) -> None:
    """CaseError where the case's tables are the same, but not what is made of them."""
    state, tail = ended.state or {}, _tail(scene)
    if ended.metadata.get("tail") != tail:
        raise CaseError(f"resume_from: scheme.tail was {ended.metadata.get('tail')!r} there, is {tail!r} here; {_ANEW}")
    for name in ("omega", "sigma"):
        before, here = state.get(name, np.zeros(0)), getattr(scene, name)
        if before.shape != here.shape or not np.allclose(before, here, rtol=1e-9, atol=0.0):
            raise CaseError(
                f"resume_from: the string's modes were others there: its measured ones, or this program; {_ANEW}"
            )


def _warnings(scene: Scene, overrides: Mapping[str, Any]) -> list[str]:
    """Before a run: a scheme that may gain energy, and what is given and of no account to it."""
    case = scene.case
    run, scheme, wall = case.run, case.scheme, case.obstacle.wall
    told = []
    highest_hz, multiple = float(scene.omega.max()) / (2.0 * math.pi), run.output_rate_hz or 1.0
    risk = energy_warning(scheme.name, scheme.restitution, run.internal_rate_hz, "--rate", multiple, highest_hz)
    if risk is not None:
        told.append(risk)
    idle = []
    if overrides.get("restitution") is not None and not scheme.name.startswith(("moreau-jean", "wall", "flat-wall")):
        idle.append("restitution")
    if scheme.tail in {"exact-hold": (), "event-driven": ("lumped",)}.get(scheme.name, ("lumped", "static")):
        idle.append(f'tail = "{scheme.tail}"')
    if scheme.start == "published" and not scheme.name.startswith("moreau-jean"):
        idle.append('start = "published"')
    if wall is not None and "stiffness_n_m2" in wall.model_fields_set and scheme.name != "wall":
        idle.append("the wall's stiffness_n_m2")
    told += [f"{what} is of no account to scheme {scheme.name}" for what in idle]
    return told


def _planned(case: Any, overrides: Mapping[str, Any], quality: str, warn: Callable[[str], None]) -> dict[str, Any]:
    """The overrides with the rates and modes that `plan` chooses."""
    for name in ("rate", "internal_rate", "internal_rate_hz", "modes"):
        if overrides.get(name) is not None:
            raise CaseError(f"quality chooses rate and modes; leave out {name}, or quality")
    # at the lowest rate, so that nothing of the case's own can be in the way
    output_hz = overrides.get("output_rate_hz") or overrides.get("output_rate") or load_case(case).run.output_rate_hz
    found: dict[str, Any] = {**overrides, "output_rate_hz": output_hz or DEFAULT_RATE_HZ}
    found.pop("output_rate", None)
    lowest, folder = read_case(case, {**found, "internal_rate_hz": found["output_rate_hz"]})
    scene, wall = Scene(lowest, folder), lowest.obstacle.wall
    rate_hz = found["output_rate_hz"]
    if lowest.scheme.name == "wall" and wall is not None:
        stiffness = math.inf if wall.stiffness_n_m2 == "rigid" else wall.stiffness_n_m2
        plan = plan_wall(scene.string, stiffness, quality=quality, rate_hz=rate_hz)
    elif lowest.scheme.name == "exact-hold":
        kind = scene_kind(scene.string, scene.obstacle.positions_m, _plucks(lowest))
        fundamental_hz = scene.string.fundamental_hz
        contacts = len(scene.obstacle)
        plan = plan_string(scene.string, fundamental_hz, contacts, kind, quality=quality, rate_hz=rate_hz, decimated=False)
    else:
        raise CaseError(f"quality is known for exact-hold and wall, got scheme {lowest.scheme.name!r}; give rate and modes")
    if plan.scheme == "wall" and lowest.scheme.restitution > WALL_RESTITUTION:
        warn(
            f"what {quality} promises of a wall holds up to restitution {WALL_RESTITUTION:g}, got "
            f"{lowest.scheme.restitution:g}: late contacts are chaotic there"
        )
    return {**found, "internal_rate_hz": plan.rate_hz, "modes": plan.modes}


def _plucks(case: Case) -> list[float]:
    """Where the case plucks its string [m], as far as it says."""
    start = [case.initial.position_m] if case.initial.position_m is not None else []
    return [*start, *(finger.position_m for finger in case.finger)]


def simulate_file(
    case: str | os.PathLike[str],
    out: str | os.PathLike[str],
    overrides: Mapping[str, Any] | None = None,
    warn: Callable[[str], None] | None = None,
) -> dict[str, Any]:
    """`simulate` to an .npz file, or to a table if its name ends in .csv; returns the summary."""
    check_name(out)
    check_apart([Named("case", path) for path in files_of(case)], [Named("output", out)])
    check_target(out)
    result = simulate(case, warn=warn, **dict(overrides or {}))
    result.save(out)
    return result.summary


def _result(scene: Scene, outcome: Outcome) -> Result:
    case, run = scene.case, scene.case.run
    last = outcome.last_contact_step * scene.dt if outcome.last_contact_step >= 0 else None
    energy = dict(zip(study.ENERGY_COLUMNS, outcome.energy.T, strict=True)) if outcome.energy is not None else {}
    summary: dict[str, Any] = {
        "scheme": case.scheme.name,
        "internal_rate_hz": run.internal_rate_hz,
        "modes": run.modes,
        "contacts": len(scene.obstacle),
        "steps": scene.steps,
        "rows": scene.outputs,
        "finite": all(
            np.all(np.isfinite(a))
            for a in (outcome.u, outcome.contact_u, outcome.contact_force)
            if isinstance(a, np.ndarray)  # what is yet to be made is made of the same modes as u
        ),
        "largest_displacement_m": float(np.abs(outcome.u).max()),
        "largest_penetration_m": outcome.largest_penetration_m,
        "last_contact_s": last,
        "contact_steps": outcome.contact_steps,
        "unsolved_steps": outcome.unsolved_steps,
        **outcome.notes,
        **({} if scene.kept is None else {"resumed_at_s": scene.first / run.internal_rate_hz}),
        "compute_s": outcome.seconds,
    }
    if outcome.energy is not None:
        summary["largest_energy_rise"] = outcome.largest_energy_rise
    # JSON knows no NaN and no infinity
    summary = {
        key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in summary.items()
    }
    law = case.scheme.name
    start = "static contact" if outcome.notes.get("started_from_static_contact") else "as given"
    if scene.kept is not None:
        start = "resumed"
    metadata = {
        "version": synth.__version__,
        "scheme": law,
        "restitution": case.scheme.restitution if law.startswith(("moreau-jean", "wall")) else None,
        "residual_compliance": law in ("exact-hold", "event-driven") and bool(np.any(scene.residual)),
        "tail": _tail(scene),
        "substeps": case.scheme.substeps,
        "start": start,
        "internal_rate_hz": run.internal_rate_hz,
        "output_rate_hz": run.internal_rate_hz / run.steps_per_output,
        "modes": run.modes,
        "duration_s": scene.steps * scene.dt,
        "end_step": scene.last,
        "case": case.model_dump(),
        "summary": summary,
    }
    if law.startswith("moreau-jean"):
        metadata["first_step"] = case.scheme.start
    t = (scene.first + np.arange(scene.outputs) * run.steps_per_output) / run.internal_rate_hz
    state = outcome.state
    q, v = _final(state, run.modes)
    if state is not None:
        state = state | {"omega": scene.omega, "sigma": scene.sigma}
    return Result(
        t=t,
        u=outcome.u,
        u_contact=outcome.contact_u,
        contact_force=outcome.contact_force,
        energy_stored=energy.get("stored"),
        energy_residual=energy.get("residual"),
        energy_viscous=energy.get("viscous"),
        energy_contact=energy.get("contact"),
        energy_injected=energy.get("injected"),
        positions=np.array(run.outputs_m),
        contact_positions=scene.positions,
        contact_heights=scene.eta,
        obstacle_displacement=scene.obstacle_displacement(t) if case.obstacle.moves else None,
        largest_penetration_m=outcome.largest_penetration_m,
        largest_energy_rise=outcome.largest_energy_rise,
        last_contact_s=math.nan if last is None else last,
        final_q=q,
        final_v=v,
        state=state,
        metadata=metadata,
    )


def _final(state: dict[str, np.ndarray] | None, modes: int) -> tuple[np.ndarray | None, np.ndarray | None]:
    """q and v (N,) of the string's own modes; None where the scheme has none."""
    if state is None or "q" not in state:
        return None, None
    return state["q"][:modes].copy(), state["v" if "v" in state else "w"][:modes].copy()


def _tail(scene: Scene) -> str:
    """What stood for the modes left out."""
    if scene.tail is not None:
        return "lumped"
    return "static" if scene.case.scheme.name in ("exact-hold", "event-driven") and np.any(scene.residual) else "none"


__all__ = [
    "OVERRIDES",
    "SCHEMES",
    "Case",
    "CaseError",
    "Overrides",
    "Result",
    "ResultError",
    "Scene",
    "case_folder",
    "load_case",
    "load_result",
    "simulate",
    "simulate_file",
]
