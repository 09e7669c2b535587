"""Compliant contacts on the exact modal two-step scheme: kernels shared by `compliant`, `quadratisation` and `sav`.

A mode under a contact force fⁿ centred on its step (Bilbao 2009; Issanchou et al., J. Sound Vib. 393, 2017),

    q⁺ = a q − e q⁻ + (Δt²/μ) F φ fⁿ,   F = (1 − a + e)/(ωΔt)²,

is exact in free flight. It is stepped as (q, w), w = (qⁿ − qⁿ⁻¹)/Δt, with the coefficients of the filtered Moreau–Jean
law under the impulse Δt f. With P = (1 + e)/(2F) and δq = (q⁺ − q⁻)/2 it keeps the books

    H = ½μ Σ (P w² + ω² qⁿ qⁿ⁻¹) + V,   ΔH = −μ Σ ((1 − e)/F) (δq/Δt)² − Σ Q r²/(4Δt),   H ≥ 0 for any Δt,

V the mean of the contact potential over the step, or ½ψ². The first step is taken with the exact propagator under a
held force (V(g¹) − V(g⁰))/(g¹ − g⁰), which keeps the energy too, from any start.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from synth.native.arrays import allocate
from synth.solver import quadratisation, sav
from synth.solver.compliant import newton, newton_one
from synth.solver.energy import filter_factor, stored
from synth.solver.laws import EXACT_HOLD, MOREAU_JEAN_FILTERED, coefficients
from synth.solver.penalty import force as law_force
from synth.solver.penalty import potential
from synth.solver.problem import Outcome, Problem, Results, kept_array
from synth.solver.stepwise import fly, push_modes
from synth.solver.vectors import FAST, dot

NEWTON = 0
QUADRATISED = 1
SCALAR = 2

METHODS: dict[str, int] = {
    "compliant": NEWTON,
    "energy-quadratisation": QUADRATISED,
    "scalar-auxiliary-variable": SCALAR,
}

# places in Results.sums and Results.counts
_STORED, _POTENTIAL, _VISCOUS, _CONTACT, _INITIAL, _RISE, _DEPTH, _DRIFT, _LEAST_FORCE = range(9)
_SUMS = 9
_STEPS, _ROW, _PHASE, _LAST, _TOUCHED, _UNSOLVED, _ITERATIONS, _MOST = range(8)
_COUNTS = 8


class Law(NamedTuple):
    """A compliant contact and how it is solved."""

    stiffness: float  # K [N/m^α] of a point
    exponent: float  # α ≥ 1
    loss: float = 0.0  # [s/m], Hunt–Crossley: f = K g^α (1 + loss·ġ)
    tolerance: float = 1e-12  # of a Newton step, relative to the depths
    iterations: int = 50  # at most, of Newton
    correction: float = 0.0  # κ of `sav`


class TwoStepModel(NamedTuple):
    """What does not change over a run: N modes, C contacts, P outputs, M nodes of the full grid (0: contacts only)."""

    method: int
    law: Law
    dt: float
    mu: float
    omega: np.ndarray  # (N,)
    factor: np.ndarray  # (N,) 1/P
    lossy: np.ndarray  # (N,) μ (1 − e)/F
    coef: np.ndarray  # (6, N)
    shapes: np.ndarray  # (C, N)
    compliance: np.ndarray  # (C, C) contacts' response to unit forces at the end of the step [m/N]
    eta: np.ndarray  # (C,)
    out_shapes: np.ndarray  # (P, N)
    grid: np.ndarray  # (M, N) mode shapes at every node
    nodes: np.ndarray  # (C,) int64 the contacts' nodes


class TwoStepState(NamedTuple):
    """A run at a grid time."""

    q: np.ndarray  # (N,)
    w: np.ndarray  # (N,)
    before: np.ndarray  # (C,) depths gⁿ⁻¹
    now: np.ndarray  # (C,) gⁿ
    force: np.ndarray  # (C,) of the last step
    psi: np.ndarray  # (C,) or (1,)
    totals: np.ndarray  # (C,) forces since the last row
    results: Results
    old_w: np.ndarray  # (N,)
    modal: np.ndarray  # (N,)
    work: np.ndarray  # (8, C)
    matrix: np.ndarray  # (C, C)
    spread: np.ndarray  # (2, M) displacement and force at the nodes


@njit(cache=True, nogil=True, fastmath=FAST)
def _push_spread(dt: float, coef, grid, spread, q, w, modal) -> None:
    """Forces at every node of the full grid, Sᵀf as a dense product."""
    modal[:] = 0.0
    for i in range(grid.shape[0]):
        row, strength = grid[i], spread[i]
        for j in range(q.size):
            modal[j] += row[j] * strength
    for j in range(q.size):
        q[j] += coef[4, j] * dt * modal[j]
        w[j] += coef[5, j] * dt * modal[j]


@njit(cache=True, nogil=True, fastmath=FAST)
def _viscous(lossy, old_w, w) -> float:
    total = 0.0
    for j in range(w.size):
        mean = 0.5 * (old_w[j] + w[j])
        total += lossy[j] * mean * mean
    return total


@njit(cache=True, nogil=True)
def _held(model: TwoStepModel, state: TwoStepState) -> float:
    """The energy that the contacts hold over the step that ends now [J]."""
    total = 0.0
    if model.method == NEWTON:
        for c in range(model.eta.size):
            total += 0.5 * potential(model.law.stiffness, model.law.exponent, state.before[c])
            total += 0.5 * potential(model.law.stiffness, model.law.exponent, state.now[c])
    else:
        for c in range(state.psi.size):
            total += 0.5 * state.psi[c] * state.psi[c]
    return total


@njit(cache=True, nogil=True)
def _write_row(model: TwoStepModel, state: TwoStepState) -> None:
    u, contact_u, contact_force, energy, sums, counts = state.results
    row, steps = counts[_ROW], counts[_PHASE]
    for p in range(model.out_shapes.shape[0]):
        u[row, p] = dot(model.out_shapes[p], state.q)
    for c in range(model.eta.size):
        contact_u[row, c] = model.eta[c] - state.now[c]
        contact_force[row, c] = state.totals[c] / steps if steps > 0 else state.force[c]
        state.totals[c] = 0.0
    if energy.shape[0] > 0:
        for k in range(4):  # _STORED, _POTENTIAL, _VISCOUS, _CONTACT
            energy[row, k] = sums[k]
    counts[_ROW] = row + 1
    counts[_PHASE] = 0


@njit(cache=True, nogil=True, fastmath=FAST)
def _advance_one(model: TwoStepModel, state: TwoStepState, n_steps: int, every: int) -> None:
    """`_advance` with one contact and no ledger: scalars, and the force of a step enters in the pass of the next."""
    coef, eta, matrix, dt = model.coef, model.eta[0], model.compliance, model.dt
    method = model.method
    stiffness, exponent, loss, tolerance, iterations, correction = model.law
    q, w, psi, work, sums, counts = state.q, state.w, state.psi, state.work, state.results.sums, state.results.counts
    n = q.size
    p11, p12, p21, p22, kq, kw = coef[0, :n], coef[1, :n], coef[2, :n], coef[3, :n], coef[4, :n], coef[5, :n]
    shape, factor = model.shapes[0, :n], state.matrix
    f, r, b, drags, depth, earlier = state.force, work[7], work[5], work[6], work[3], work[4]
    before, now, deepest, weakest = state.before[0], state.now[0], sums[_DEPTH], sums[_LEAST_FORCE]
    steps, phase, compliance, total, drag = counts[_STEPS], counts[_PHASE], matrix[0, 0], state.totals[0], 0.0
    strength, pending = f[0], 0.0
    for _ in range(n_steps):
        u = 0.0
        if pending != 0.0:
            for j in range(n):
                push = shape[j] * pending
                qj = q[j] + kq[j] * push
                wj = w[j] + kw[j] * push
                a = p11[j] * qj + p12[j] * wj
                c = p21[j] * qj + p22[j] * wj
                q[j] = a
                w[j] = c
                u += shape[j] * a
        else:
            for j in range(n):
                a = p11[j] * q[j] + p12[j] * w[j]
                c = p21[j] * q[j] + p22[j] * w[j]
                q[j] = a
                w[j] = c
                u += shape[j] * a
        free = eta - u
        change = free - before
        pending = 0.0
        reached = now > 0.0 or before > 0.0
        if method == NEWTON:
            reached = reached or free > 0.0
        elif method == QUADRATISED:
            reached = reached or psi[0] != 0.0
        if reached:
            if loss > 0.0:
                drag = loss * law_force(stiffness, exponent, now) / (2.0 * dt)
            if method == NEWTON:
                _, strength, done = newton_one(
                    stiffness, exponent, compliance, drag, before, change, strength, tolerance, iterations
                )
                if done < 0:
                    counts[_UNSOLVED] += 1
                    done = iterations
                counts[_ITERATIONS] += done
                counts[_MOST] = max(counts[_MOST], done)
            else:
                depth[0], earlier[0], b[0], drags[0] = now, before, change, drag
                if method == QUADRATISED:
                    drift = quadratisation.forces(stiffness, exponent, matrix, drags, depth, b, psi, f, r, work, factor)
                else:
                    drift = sav.forces(stiffness, exponent, matrix, correction, earlier, depth, b, psi, f, r, work[0])
                strength = f[0]
                sums[_DRIFT] = max(sums[_DRIFT], drift)
            free -= compliance * strength
        else:
            strength = 0.0
        before, now = now, free
        deepest = max(deepest, free)
        steps += 1
        phase += 1
        if strength != 0.0:
            pending = dt * strength
            total += strength
            weakest = min(weakest, strength)
            counts[_LAST] = steps
            counts[_TOUCHED] += 1
        if phase == every:
            if pending != 0.0:
                push_modes(q, w, kq, kw, shape, pending)
                pending = 0.0
            state.now[0], state.totals[0], counts[_PHASE] = now, total, phase
            _write_row(model, state)
            phase, total = 0, 0.0
    if pending != 0.0:
        push_modes(q, w, kq, kw, shape, pending)
    state.before[0], state.now[0], f[0], state.totals[0] = before, now, strength, total
    sums[_DEPTH], sums[_LEAST_FORCE], counts[_STEPS], counts[_PHASE] = deepest, weakest, steps, phase


@njit(cache=True, nogil=True)
def _advance(model: TwoStepModel, state: TwoStepState, n_steps: int, every: int) -> None:
    contacts, nodes = model.eta.size, model.grid.shape[0]
    coef, shapes, eta, compliance, dt = model.coef, model.shapes, model.eta, model.compliance, model.dt
    q, w, before, now, force, totals = state.q, state.w, state.before, state.now, state.force, state.totals
    sums, counts, psi, work, matrix = state.results.sums, state.results.counts, state.psi, state.work, state.matrix
    b, drag, r, gradient = work[5], work[6], work[7], work[0]
    method = model.method
    stiffness, exponent, loss, tolerance, iterations, correction = model.law
    kq, kw = coef[4, : q.size], coef[5, : q.size]
    ledger = state.results.energy.shape[0] > 0
    for _ in range(n_steps):
        if ledger:
            state.old_w[:] = w
        fly(coef, q, w)
        for i in range(nodes):
            state.spread[0, i] = dot(model.grid[i], q)
        for c in range(contacts):
            b[c] = state.spread[0, model.nodes[c]] if nodes else dot(shapes[c], q)
        reached = False
        for c in range(contacts):
            free = eta[c] - b[c]
            if (
                now[c] > 0.0
                or before[c] > 0.0
                or (method == NEWTON and free > 0.0)
                or (method == QUADRATISED and psi[c] != 0.0)
            ):
                reached = True
            b[c] = free - before[c]
        touched = False
        worked = 0.0
        if reached:
            # arguments one by one: a tuple of arrays costs a call more than the contact does
            for c in range(contacts):
                drag[c] = loss * law_force(stiffness, exponent, now[c]) / (2.0 * dt) if loss > 0.0 else 0.0
            if method == NEWTON:
                done = newton(
                    stiffness, exponent, compliance, drag, before, b, force, r, tolerance, iterations, work, matrix
                )
                if done < 0:
                    counts[_UNSOLVED] += 1
                    done = iterations
                counts[_ITERATIONS] += done
                counts[_MOST] = max(counts[_MOST], done)
            elif method == QUADRATISED:
                drift = quadratisation.forces(stiffness, exponent, compliance, drag, now, b, psi, force, r, work, matrix)
                sums[_DRIFT] = max(sums[_DRIFT], drift)
            else:
                drift = sav.forces(stiffness, exponent, compliance, correction, before, now, b, psi, force, r, gradient)
                sums[_DRIFT] = max(sums[_DRIFT], drift)
        for c in range(contacts):
            free = before[c] + b[c]
            before[c] = now[c]
            now[c] = free
        if reached:
            for c in range(contacts):
                strength = force[c]
                for d in range(contacts):
                    now[d] -= compliance[d, c] * strength
                totals[c] += strength
                if strength != 0.0:
                    touched = True
                    sums[_LEAST_FORCE] = min(sums[_LEAST_FORCE], strength)
                    if nodes == 0:
                        push_modes(q, w, kq, kw, shapes[c], dt * strength)
                worked += 0.5 * drag[c] * r[c] * r[c]
            if nodes and touched:
                state.spread[1, :] = 0.0
                for c in range(contacts):
                    state.spread[1, model.nodes[c]] = force[c]
                _push_spread(dt, coef, model.grid, state.spread[1], q, w, state.modal)
        else:
            for c in range(contacts):
                force[c] = 0.0
        for c in range(contacts):
            sums[_DEPTH] = max(sums[_DEPTH], now[c])
        counts[_STEPS] += 1
        counts[_PHASE] += 1
        if touched:
            counts[_LAST] = counts[_STEPS]
            counts[_TOUCHED] += 1
        if ledger:
            _weigh(model, state, worked)
        if counts[_PHASE] == every:
            _write_row(model, state)


@njit(cache=True, nogil=True)
def _weigh(model: TwoStepModel, state: TwoStepState, worked: float) -> None:
    """A step's place in the ledger; losses are computed from their own formulas, not from what is missing."""
    sums = state.results.sums
    now = stored(MOREAU_JEAN_FILTERED, model.omega, model.factor, model.mu, model.dt, state.q, state.w)
    held = _held(model, state)
    if sums[_INITIAL] > 0.0:
        sums[_RISE] = max(sums[_RISE], (now + held - sums[_STORED] - sums[_POTENTIAL]) / sums[_INITIAL])
    sums[_STORED], sums[_POTENTIAL] = now, held
    sums[_VISCOUS] += _viscous(model.lossy, state.old_w, state.w)
    sums[_CONTACT] += worked


def make_model(
    problem: Problem, method: str, law: Law, grid: np.ndarray | None = None, nodes: np.ndarray | None = None
) -> TwoStepModel:
    """The model of a problem; grid (M, N) and nodes (C,) where S spans the full grid, the contacts at its nodes.

    The shapes of the contacts are then those of their nodes, whatever the problem says.
    """
    n, contacts = problem.omega.size, problem.eta.size
    omega, sigma, eta, out_shapes = (
        np.ascontiguousarray(a, dtype=np.float64) for a in (problem.omega, problem.sigma, problem.eta, problem.out_shapes)
    )
    coef = coefficients(MOREAU_JEAN_FILTERED, omega, sigma, problem.mu, problem.dt)
    filter_ = filter_factor(MOREAU_JEAN_FILTERED, omega, coef, problem.dt)
    e = coef[3]
    if grid is None or nodes is None:
        grid, nodes = np.zeros((0, n)), np.zeros(contacts, np.int64)
        shapes = np.ascontiguousarray(problem.shapes, dtype=np.float64)
    else:
        grid = np.ascontiguousarray(grid, dtype=np.float64)
        shapes = np.ascontiguousarray(grid[nodes])
    return TwoStepModel(
        METHODS[method], law, problem.dt, problem.mu, omega, 2.0 * filter_ / (1.0 + e),
        -problem.mu * np.expm1(-2.0 * sigma * problem.dt) / filter_, coef, shapes,
        problem.dt * (shapes * coef[4]) @ shapes.T, eta, out_shapes, grid, np.asarray(nodes, dtype=np.int64),
    )  # fmt: skip


def start(problem: Problem, model: TwoStepModel, ledger: bool) -> TwoStepState:
    """A run after its first step, rows 0 (and 1) written; f⁰ of row 0 is K [g⁰]₊^α."""
    n, contacts = model.omega.size, model.eta.size
    k, alpha, loss, tolerance, iterations, _ = model.law
    q0, v0 = (np.array(a, dtype=np.float64) for a in (problem.q, problem.v))
    rows = problem.steps // problem.every + 1
    sizes = {"rows": rows, "contact_rows": rows, "points": model.out_shapes.shape[0], "contacts": contacts}
    state = TwoStepState(
        q=q0.copy(),
        w=np.zeros(n),
        before=model.eta - model.shapes @ q0,
        now=model.eta - model.shapes @ q0,
        force=np.zeros(contacts),
        psi=np.zeros(0 if model.method == NEWTON else contacts if model.method == QUADRATISED else 1),
        totals=np.zeros(contacts),
        results=allocate(Results, sizes | {"weighed": rows if ledger else 0, "sums": _SUMS, "counts": _COUNTS}),
        old_w=np.zeros(n),
        modal=np.zeros(n),
        work=np.zeros((8, contacts)),
        matrix=np.zeros((contacts, contacts)),
        spread=np.zeros((2, model.grid.shape[0])),
    )
    state.force[:] = [law_force(k, alpha, g) for g in state.now]
    hold = coefficients(EXACT_HOLD, model.omega, np.ascontiguousarray(problem.sigma), model.mu, model.dt)
    free = hold[0] * q0 + hold[1] * v0
    b = model.eta - model.shapes @ free - state.before
    compliance = (model.shapes * hold[4]) @ model.shapes.T
    drag = loss * state.force / model.dt
    held, r, sums, counts = np.zeros(contacts), np.zeros(contacts), state.results.sums, state.results.counts
    counts[_LAST] = -1
    if contacts:
        done = newton(k, alpha, compliance, drag, state.before, b, held, r, tolerance, iterations, state.work, state.matrix)
        counts[_UNSOLVED] += done < 0
        state.now[:] = state.before + b - compliance @ held
    state.q[:] = free + hold[4] * (held @ model.shapes)
    state.w[:] = (state.q - q0) / model.dt
    mean = [potential(k, alpha, x) + potential(k, alpha, y) for x, y in zip(state.before, state.now, strict=True)]
    if model.method == QUADRATISED:
        state.psi[:] = np.sqrt(mean)
    elif model.method == SCALAR:
        state.psi[0] = math.sqrt(math.fsum(mean))
    sums[_STORED] = stored(MOREAU_JEAN_FILTERED, model.omega, model.factor, model.mu, model.dt, state.q, state.w)
    sums[_POTENTIAL] = _held(model, state)
    sums[_INITIAL] = sums[_STORED] + sums[_POTENTIAL]
    sums[_DEPTH] = max((*state.before, *state.now), default=0.0)
    if np.any(held != 0.0):
        counts[_LAST] = counts[_TOUCHED] = 1
    # row 0 shows the start itself, the ledger the first half step
    later = state.q.copy(), state.now.copy()
    state.q[:], state.now[:] = q0, state.before
    _write_row(model, state)
    state.q[:], state.now[:] = later
    state.force[:] = held
    state.totals[:] = held
    counts[_STEPS] = counts[_PHASE] = 1
    if problem.every == 1:
        _write_row(model, state)
    return state


#: arrays of a state that a run goes on from
_CARRIED = ("q", "w", "before", "now", "force", "psi")


def resume(problem: Problem, model: TwoStepModel, ledger: bool, kept: Mapping[str, np.ndarray], first: int) -> TwoStepState:
    """A run from where another was at step `first`, of which `kept` is what `solve` gave; its row 0 is that row."""
    none = np.zeros(model.omega.size)
    state = start(problem._replace(q=none, v=none), model, ledger)
    for name in _CARRIED:
        array = getattr(state, name)
        array[:] = kept_array(kept, name, array.shape)
    sums, counts = state.results.sums, state.results.counts
    sums[:], counts[:] = 0.0, 0
    if ledger and "sums" in kept:
        for place in (_STORED, _POTENTIAL, _VISCOUS, _CONTACT, _INITIAL):
            sums[place] = kept_array(kept, "sums", sums.shape)[place]
    else:
        sums[_STORED] = stored(MOREAU_JEAN_FILTERED, model.omega, model.factor, model.mu, model.dt, state.q, state.w)
        sums[_POTENTIAL] = _held(model, state)
        sums[_INITIAL] = sums[_STORED] + sums[_POTENTIAL]
    sums[_DEPTH] = max((*state.before, *state.now), default=0.0)
    counts[_STEPS], counts[_LAST] = first, first if np.any(state.force != 0.0) else -1
    state.totals[:] = 0.0
    _write_row(model, state)
    state.results.contact_force[0] = kept_array(kept, "row_force", state.force.shape)
    return state


def solve(
    problem: Problem, model: TwoStepModel, ledger: bool, kept: Mapping[str, np.ndarray] | None = None, first: int = 0
) -> Outcome:
    """Runs the problem to its last row, from its start or from what an Outcome's state kept at step `first`."""
    state = start(problem, model, ledger) if kept is None else resume(problem, model, ledger, kept, first)
    advance = _advance_one if model.eta.size == 1 and model.grid.shape[0] == 0 and not ledger else _advance
    advance(model, state, 0, problem.every)  # compiles
    last = first + problem.steps // problem.every * problem.every
    started = time.perf_counter()
    advance(model, state, max(0, last - int(state.results.counts[_STEPS])), problem.every)
    seconds = time.perf_counter() - started
    sums, counts = state.results.sums, state.results.counts
    notes: dict[str, Any] = {
        "stiffness": model.law.stiffness,
        "exponent": model.law.exponent,
        "loss": model.law.loss,
        "largest_adhesion_n": max(0.0, -float(sums[_LEAST_FORCE])),
    }
    if model.method == NEWTON:
        notes["newton_iterations"] = int(counts[_ITERATIONS])
        notes["newton_iterations_per_contact_step"] = float(counts[_ITERATIONS]) / max(1, int(counts[_TOUCHED]))
        notes["most_newton_iterations"] = int(counts[_MOST])
    else:
        notes["auxiliary_drift"] = float(sums[_DRIFT])
        scale = math.sqrt(2.0 * sums[_INITIAL])
        notes["auxiliary_drift_relative"] = float(sums[_DRIFT] / scale) if scale > 0.0 else 0.0
    if ledger:
        notes["initial_energy_j"] = float(sums[_INITIAL])
    return Outcome(
        u=state.results.u,
        contact_u=state.results.contact_u,
        contact_force=state.results.contact_force,
        energy=state.results.energy if ledger else None,
        largest_penetration_m=float(sums[_DEPTH]),
        largest_energy_rise=float(sums[_RISE]) if ledger else float("nan"),
        last_contact_step=int(counts[_LAST]),
        contact_steps=int(counts[_TOUCHED]),
        unsolved_steps=int(counts[_UNSOLVED]),
        seconds=seconds,
        notes=notes,
        state={name: np.array(getattr(state, name)) for name in _CARRIED}
        | {"row_force": state.results.contact_force[-1].copy()}
        | ({"sums": sums.copy()} if ledger else {}),
    )
