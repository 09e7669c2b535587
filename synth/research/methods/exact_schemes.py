"""Exact solutions as schemes of `simulate`: what each asks of a case, and its answer in the form of every other scheme.

waveguide      ideal string, no finger; internal_rate_hz makes the grid, Δx = c/rate: a whole number of cells, points and
               outputs on nodes. Takes every start that is clear of the obstacle
cabannes       the same string, a sharp triangle at mid-string over one point there, −1 < height/displacement < 1
flat-wall      the same string, a sharp triangle over at least 20 points of one height ≤ 0 along the whole string, standing
               for a wall; restitution 1. At height 0 the triangle may have its corner anywhere, below it at mid-string
event-driven   one point, no finger. The modes left out are static compliance, or with tail = "none" nothing: restitution is
               then 0

`modes` is of no account to the first three but for a start in modes, the internal rate to the last three but for the rows.
Only waveguide and event-driven can go on from where another run ended: the others are a formula for every time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from synth.physics.modes import mode_shapes
from synth.research.case import CaseError
from synth.research.exact import event_driven, triangle, waveguide
from synth.research.exact.shapes import triangle as plucked
from synth.research.scene import Scene
from synth.solver import driver
from synth.solver.laws import EXACT_HOLD
from synth.solver.lcp import SOLVED
from synth.solver.problem import Outcome, kept_array
from synth.solver.stringmodel import StringContacts, StringModes

#: schemes that are a formula for every time
CLOSED = ("cabannes", "flat-wall")
_FEWEST_WALL_POINTS = 20
_WIDEST_WALL_GAP = 0.1  # of the string's length
_MOST_CELL_STEPS = 1e14  # a day of one core


def _no_finger(scene: Scene) -> None:
    if scene.fingers:
        raise CaseError(f"{scene.case.scheme.name}: takes no [[finger]]; give the start as [initial]")


def _ideal(scene: Scene) -> None:
    """CaseError unless the string is ideal and lossless."""
    _no_finger(scene)
    string, name = scene.string, scene.case.scheme.name
    faults = []
    if string.bending_stiffness_n_m2 > 0.0:
        faults.append(f"bending stiffness {string.bending_stiffness_n_m2:.3g} N m² (leave out inharmonicity)")
    if string.measured_frequencies_hz or string.measured_decay_rates:
        faults.append("measured modes (leave them out)")
    if string.nut:
        faults.append("resonances of the nut (leave them out)")
    elif np.any(scene.sigma > 0.0):
        faults.append(
            f"decay rates up to {scene.sigma.max():.3g} 1/s "
            "(set air_viscosity, viscoelastic_loss and thermoelastic_q_inverse to 0)"
        )
    if faults:
        raise CaseError(f"{name}: needs an ideal string (no stiffness, no loss), got {'; '.join(faults)}")


def _sharp_triangle(scene: Scene) -> tuple[float, float]:
    """(position, displacement) of the pluck; CaseError where it is none."""
    table, name = scene.case.initial, scene.case.scheme.name
    if table.shape != "triangle" or table.rounding_half_width_m or table.width_m:
        raise CaseError(f"{name}: initial must be a sharp triangle, got {table.shape!r}, rounded or not; or use waveguide")
    assert table.position_m is not None and table.displacement_m is not None
    return table.position_m, table.displacement_m


def _times(scene: Scene) -> np.ndarray:
    return np.arange(scene.outputs) * (scene.case.run.steps_per_output * scene.dt)


def _largest_rise(energy: np.ndarray) -> float:
    """Largest rise from row to row over the energy at the start; NaN where there was none."""
    return max(0.0, float(np.diff(energy).max(initial=0.0) / energy[0])) if energy[0] > 0.0 else math.nan


def _outcome(scene: Scene, u: np.ndarray, contact_u: np.ndarray, force: np.ndarray, stored: np.ndarray) -> Outcome:
    """What the three ideal strings share; nothing is lost but at contacts."""
    energy = None
    if scene.case.run.ledger:
        zero = np.zeros_like(stored)
        energy = np.column_stack([stored, zero, zero, stored[0] - stored, zero])
    every = scene.case.run.steps_per_output
    touched = np.flatnonzero(np.any(force > 0.0, axis=1))
    return Outcome(
        u=u,
        contact_u=contact_u,
        contact_force=force,
        energy=energy,
        largest_penetration_m=float((scene.eta - contact_u).max()) if scene.eta.size else 0.0,
        largest_energy_rise=_largest_rise(stored) if energy is not None else math.nan,
        last_contact_step=int(touched[-1]) * every if touched.size else -1,
        contact_steps=touched.size * every,
    )


def run_waveguide(scene: Scene) -> Outcome:
    """`synth.research.exact.waveguide` on the grid that the internal rate makes."""
    _ideal(scene)
    string, run = scene.string, scene.case.run
    length, speed = string.length_m, string.wave_speed_m_s
    try:
        n = waveguide.cells(length, speed, run.internal_rate_hz)
    except ValueError as error:
        raise CaseError(f"waveguide: run.internal_rate_hz: {error}") from None
    if float(n) * scene.steps > _MOST_CELL_STEPS:
        raise CaseError(
            f"waveguide: {float(n) * scene.steps:.1e} steps of cells would take days, the limit is {_MOST_CELL_STEPS:.0e}; "
            "lower internal_rate_hz or duration_s"
        )
    try:
        points = waveguide.nodes("obstacle.positions_m", scene.positions, length, n)
        outputs = waveguide.nodes("run.outputs_m", np.array(run.outputs_m), length, n)
        kept = scene.kept
        if kept is None:
            right, left = waveguide.travelling(*_start(scene, np.arange(n + 1) * (length / n)), speed)
            pushed = np.zeros(n + 1)
        else:
            right, left, pushed = (kept_array(kept, name, (n + 1,)) for name in ("right", "left", "pushed"))
        every, steps = run.steps_per_output, scene.last - scene.first
        what = (string.tension_n, length, pushed)
        waveguide.run(right, left, points, scene.eta, outputs, 0, every, *what)  # compiles
        started = time.perf_counter()
        waves = waveguide.run(right, left, points, scene.eta, outputs, steps, every, *what)
        seconds = time.perf_counter() - started
    except ValueError as error:
        raise CaseError(f"waveguide: {error}") from None
    outcome = _outcome(scene, waves.u, waves.contact_u, waves.contact_force, waves.energy)
    outcome.contact_steps, last = waves.contact_steps, waves.last_contact_step
    outcome.last_contact_step = scene.first + last if last >= 0 else -1
    outcome.seconds = seconds
    outcome.notes = {"cells": n}
    outcome.state = {"right": waves.right, "left": waves.left, "pushed": waves.pushed}
    if kept is not None:
        waves.contact_force[0] = kept_array(kept, "row_force", points.shape)
        if outcome.energy is not None and "sums" in kept:
            outcome.energy[:, 3] += kept_array(kept, "sums", (1,))[0]
    outcome.state["row_force"] = waves.contact_force[-1].copy()
    if outcome.energy is not None:
        outcome.state["sums"] = outcome.energy[-1, 3:4].copy()
    return outcome


def _start(scene: Scene, x: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """u(x) and ∫₀ˣ u_t dx, None at rest: the plucked shape itself, of other starts the sum over modes."""
    table, length = scene.case.initial, scene.string.length_m
    if table.shape == "triangle":
        assert table.position_m is not None and table.displacement_m is not None
        half, width = table.rounding_half_width_m or 0.0, table.width_m or 0.0
        return plucked(length, table.position_m, table.displacement_m, x, half, width), None
    q, v = scene.initial()
    u = np.zeros_like(x)
    moving = np.zeros_like(x)
    k = np.arange(1, q.size + 1) * (math.pi / length)
    for some in np.array_split(np.arange(x.size), max(1, x.size * q.size // 2**22)):
        u[some] = mode_shapes(length, x[some], q.size) @ q
        moving[some] = math.sqrt(2.0 / length) * (2.0 * np.sin(0.5 * np.outer(x[some], k)) ** 2) @ (v / k)
    return u, moving if np.any(v) else None


def run_cabannes(scene: Scene) -> Outcome:
    """`synth.research.exact.triangle.cabannes`."""
    _ideal(scene)
    position, displacement = _sharp_triangle(scene)
    string = scene.string
    length, middle = string.length_m, 0.5 * string.length_m
    if scene.positions.size != 1 or max(abs(position - middle), abs(scene.positions[0] - middle)) > 1e-9 * length:
        raise CaseError(
            f"cabannes: needs the pluck and one point at mid-string, {middle:g} m, got {position:g} m and points at "
            f"{[round(float(p), 12) for p in scene.positions]}; waveguide takes other places"
        )
    started = time.perf_counter()
    what = (length, string.wave_speed_m_s, displacement, float(scene.eta[0] / displacement))
    t = _times(scene)
    try:
        u = triangle.cabannes(np.array(scene.case.run.outputs_m), t[:, None], *what)
        contact_u = triangle.cabannes(scene.positions, t[:, None], *what)
        pushed = triangle.cabannes_impulse(t, length, string.tension_n, *what[1:])
    except ValueError as error:
        raise CaseError(f"cabannes: {error}") from None
    force = np.zeros((t.size, 1))
    force[1:, 0] = np.diff(pushed) / t[1] if t.size > 1 else 0.0
    outcome = _outcome(scene, u, contact_u, force, _triangle_energy(scene, position, displacement))
    outcome.seconds = time.perf_counter() - started
    outcome.notes = {"period_s": triangle.cabannes_period(length, string.wave_speed_m_s, what[-1])}
    return outcome


def _triangle_energy(scene: Scene, position: float, displacement: float) -> np.ndarray:
    """½TA²(1/p + 1/(L − p)) in every row."""
    slopes = 1.0 / position + 1.0 / (scene.string.length_m - position)
    return np.full(scene.outputs, 0.5 * scene.string.tension_n * displacement**2 * slopes)


def run_flat_wall(scene: Scene) -> Outcome:
    """`synth.research.exact.triangle.wall`, each point taking the impulses of its half-way to the next ones."""
    _ideal(scene)
    position, displacement = _sharp_triangle(scene)
    string, x = scene.string, scene.positions
    length = string.length_m
    gap = np.diff(np.concatenate([[0.0], x, [length]])).max()
    if x.size < _FEWEST_WALL_POINTS or gap > _WIDEST_WALL_GAP * length or np.ptp(scene.eta) > 0.0:
        heights = f"heights that differ by {np.ptp(scene.eta):.3g} m" if x.size else "no heights"
        raise CaseError(
            f"flat-wall: needs at least {_FEWEST_WALL_POINTS} points of one height, none further than "
            f"{_WIDEST_WALL_GAP * length:g} m from the next or an end, got {x.size} points, {gap:.3g} m apart, {heights}"
        )
    if scene.case.scheme.restitution != 1.0:
        raise CaseError(f"flat-wall: is elastic, got restitution {scene.case.scheme.restitution:g}; set it to 1")
    started = time.perf_counter()
    speed, height = string.wave_speed_m_s, float(scene.eta[0])
    t = _times(scene)
    what = (position, displacement, height)
    try:
        u = triangle.wall(np.array(scene.case.run.outputs_m), t[:, None], length, speed, *what)
        contact_u = triangle.wall(x, t[:, None], length, speed, *what)
    except ValueError as error:
        raise CaseError(f"flat-wall: {error}") from None
    between = 0.5 * (x[1:] + x[:-1])
    widths = np.diff(np.concatenate([[0.0], between, [length]]))
    force = np.zeros((t.size, x.size))
    for row in range(1, t.size):
        impulses = triangle.wall_impulses(x, t[row - 1], t[row], length, string.tension_n, speed, *what)
        force[row] = impulses * widths / t[1]
    outcome = _outcome(scene, u, contact_u, force, _triangle_energy(scene, position, displacement))
    outcome.seconds = time.perf_counter() - started
    return outcome


def run_event_driven(scene: Scene) -> Outcome:
    """`synth.research.exact.event_driven`, from the static contact solution if the start is pressed in."""
    _no_finger(scene)
    if scene.positions.size != 1:
        raise CaseError(f"event-driven: needs one contact point, got {scene.positions.size}; leave one in [obstacle]")
    run, mu = scene.case.run, scene.string.linear_density_kg_m
    q, v = scene.initial()
    residual, kept, lifted = scene.residual, scene.kept, 0.0
    model = driver.make_model(
        EXACT_HOLD,
        StringModes(mu, scene.omega, scene.sigma),
        scene.dt,
        StringContacts(scene.shapes, scene.eta, residual),
        scene.out_shapes,
        0.0,
    )
    if kept is None:
        q0 = q
        q, static, status = driver.static_contact(model, q0)
        if status != SOLVED:
            raise CaseError("obstacle: no static shape of the string lies over it; lower heights_m or take more modes")
        lifted = float(abs(scene.shapes[0] @ (q - q0)))
        row_force = static[0]
    else:
        q, v = (kept_array(kept, name, scene.omega.shape) for name in ("q", "v"))
        row_force = kept_array(kept, "row_force", (1,))[0]
    row_s = run.steps_per_output * scene.dt

    def found(rows: int) -> event_driven.Events:
        return event_driven.run(
            scene.omega, scene.sigma, mu, scene.shapes[0], float(scene.eta[0]), q, v, row_s, rows,
            scene.out_shapes, float(residual[0, 0]),
        )  # fmt: skip

    try:
        found(1)  # compiles
        started = time.perf_counter()
        events = found(scene.outputs)
    except ValueError as error:
        raise CaseError(f"event-driven: {error}") from None
    seconds = time.perf_counter() - started
    last_s = events.last_contact_s
    events.contact_force[0] = row_force
    energy = None
    if run.ledger:
        viscous, lost = kept_array(kept, "sums", (2,)) if kept is not None and "sums" in kept else (0.0, 0.0)
        held = events.energy + events.spring_energy
        viscous = viscous + held[0] + events.contact_energy[0] - held - events.contact_energy
        energy = np.column_stack(
            [events.energy, events.spring_energy, viscous, lost + events.contact_energy, np.zeros(scene.outputs)]
        )
    return Outcome(
        u=events.u,
        contact_u=events.contact_u[:, None],
        contact_force=events.contact_force[:, None],
        energy=energy,
        largest_penetration_m=float((scene.eta[0] - events.contact_u).max()),
        largest_energy_rise=_largest_rise(held) if energy is not None else math.nan,
        last_contact_step=-1 if last_s < 0.0 else scene.first + math.ceil(last_s / scene.dt - 1e-9),
        contact_steps=round(events.contact_time[-1] / scene.dt),
        unsolved_steps=events.unsolved,
        seconds=seconds,
        notes={
            "started_from_static_contact": lifted > 0.0,
            "lifted_m": lifted,
            "landings": events.landings,
            "releases": events.releases,
            "contact_time_s": float(events.contact_time[-1]),
            "piece_s": events.piece_s,
        },
        state={"q": events.q, "v": events.v, "row_force": events.contact_force[-1:].copy()}
        | ({} if energy is None else {"sums": energy[-1, 2:4].copy()}),
    )


EXACT_RUNNERS: dict[str, Callable[[Scene], Outcome]] = {
    "waveguide": run_waveguide,
    "cabannes": run_cabannes,
    "flat-wall": run_flat_wall,
    "event-driven": run_event_driven,
}
