"""Runs one string for a while, writes what it does at the output rate, and keeps the energy ledger if asked.

A run is `start_run`, then `run` as often as the finger changes, `run_moving` where the obstacle moves, and
`change_model` wherever the string's tension does. Steps are taken in `blocks`; one at a time (`kernels`) with the ledger
on, under a finger, over a moving obstacle, over more than `_MOST_IN_BLOCKS` contacts, where several contacts divide their
steps, and for what is left over of a block. Steps may be divided where the string touches (`substeps`), but not over a
moving obstacle.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numba import njit

from synth.solver.blocks import (
    CERTIFY_FROM,
    Blocks,
    BlockWork,
    advance_blocks,
    forget,
    make_block_work,
    make_blocks,
    padded_rows,
    press_blocks,
)
from synth.solver.energy import filter_factor, impulse_work, spring, stored
from synth.solver.kernels import Finger, Work, advance, amplitudes, make_work, reach
from synth.solver.lanes import BLOCK, padded
from synth.solver.laws import EXACT_HOLD, MOREAU_JEAN_FILTERED, coefficients, contact_matrix
from synth.solver.lcp import NOT_SOLVED, SOLVED, natural_residual, solve
from synth.solver.problem import kept_array
from synth.solver.substeps import (
    Substeps,
    advance_substepped,
    arriving,
    clear_step,
    make_substeps,
)
from synth.solver.vectors import INNER, dot, put

# places in Run.sums
STORED, SPRING, VISCOUS, CONTACT, INJECTED, INITIAL = 0, 1, 2, 3, 4, 5
PENETRATION, RISE, LEAST_VISCOUS, LEAST_CONTACT = 6, 7, 8, 9
_SUMS = 10
# places in Run.counts
STEPS, PHASE, ROW, LAST_CONTACT, BAD_STEPS, CONTACT_STEPS, DIVIDE = 0, 1, 2, 3, 4, 5, 6
_COUNTS = 7
#: where rows are few steps apart, contacts out of reach are looked for that often; they stay so until one is touched
_CERTIFY_STEPS = 32
#: blocks of one call of the block kernel, at most
_BLOCKS = 64
#: more contacts have no table of their responses to each other (C² · 2K numbers), and one step at a time is taken
_MOST_IN_BLOCKS = 256
#: columns of Run.energy
ENERGY_COLUMNS = ("stored", "residual", "viscous", "contact", "injected")


class Model(NamedTuple):
    """What does not change while the tension does not. N modes, C contacts, P output points."""

    law: int
    dt: float
    restitution: float
    mu: float
    omega: np.ndarray  # (N,)
    sigma: np.ndarray  # (N,)
    coef: np.ndarray  # (6, N)
    factor: np.ndarray  # (N,) F of the Moreau–Jean energy
    shapes: np.ndarray  # (C, N)
    eta: np.ndarray  # (C,) heights at t = 0
    g: np.ndarray  # (C, C)
    residual: np.ndarray  # (C, C); zero for Moreau–Jean
    out_shapes: np.ndarray  # (P, N)
    sub: Substeps  # parts of a step; one of them: none
    block: Blocks  # of a step, or of a part of it where there is one contact; no rows: too many contacts


class Run(NamedTuple):
    """State, results and scratch of one run; n outputs, every M steps."""

    q: np.ndarray  # (N,), the first of whole_q
    v: np.ndarray  # (N,)
    whole_q: np.ndarray  # (padded(N),)
    whole_v: np.ndarray  # (padded(N),)
    u_contact: np.ndarray  # (C,)
    v_contact: np.ndarray  # (C,)
    force: np.ndarray  # (C,) contact unknown of the last step
    sums: np.ndarray  # float64
    counts: np.ndarray  # int64
    u: np.ndarray  # (n, P) out
    contact_u: np.ndarray  # (n, C) out: S q + R λ
    contact_force: np.ndarray  # (n, C) out: mean since the output before
    energy: np.ndarray  # (n, 5) out, or (0, 5)
    watch: np.ndarray  # (C,) uint8
    records: np.ndarray  # (M, C)
    parts: np.ndarray  # (K, C) forces of a step's parts
    scratch: np.ndarray  # (3, N)
    work: Work
    block_work: BlockWork
    block_out: np.ndarray  # (P, steps) of one call of the block kernel
    block_force: np.ndarray  # (steps, C)
    block_u: np.ndarray  # (steps, C)
    eta: np.ndarray  # (C,) heights now
    risen: np.ndarray  # (1,) how far the obstacle rose in the last step [m]


def make_model(
    law: int, omega, sigma, mu: float, dt: float, shapes, eta, residual, out_shapes, restitution: float, substeps: int = 1
) -> Model:  # fmt: skip
    """Coefficients and contact matrix for modes ω, σ (N,), contacts S (C, N) at η (C,) and outputs (P, N).

    `substeps` > 1 divides a step where the string touches (`solver.substeps`); exact-hold only, ValueError otherwise.
    """
    if substeps > 1 and law != EXACT_HOLD:
        raise ValueError(f"substeps are exact-hold's, got {substeps} for a Moreau–Jean law; raise its rate instead")
    omega, sigma, shapes, eta, out_shapes = (
        np.ascontiguousarray(a, dtype=np.float64) for a in (omega, sigma, shapes, eta, out_shapes)
    )
    coef = coefficients(law, omega, sigma, mu, dt)
    contacts = eta.size
    residual = np.ascontiguousarray(residual if law == EXACT_HOLD else np.zeros((contacts, contacts)))
    g = np.empty((contacts, contacts))
    contact_matrix(law, coef, shapes, residual, g)
    factor = filter_factor(law, omega, coef, dt)
    sub = make_substeps(substeps, omega, sigma, mu, dt, shapes, residual)
    if contacts > _MOST_IN_BLOCKS:
        none = np.zeros((0, 0))
        block = Blocks(dt, none, none, none[:, :, None], none, none[:, :, None])
    elif contacts == 1 and substeps > 1:
        block = make_blocks(law, dt / substeps, sub.coef, shapes, sub.g, out_shapes)
    else:
        block = make_blocks(law, dt, coef, shapes, g, out_shapes)
    return Model(law, dt, restitution, mu, omega, sigma, coef, factor, shapes, eta, g, residual, out_shapes, sub, block)


def static_contact(model: Model, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """The shape q (N,) lifted on to the obstacle by the least static forces: (q, λ (C,) [N], status of `lcp`).

    0 ≤ S q − η + (S diag(1/μω²) Sᵀ + R) λ ⊥ λ ≥ 0. Whatever force made the given shape goes on unchanged; among all
    shapes clear of the obstacle this is the one whose difference from q costs the least elastic energy.
    """
    compliance = 1.0 / (model.mu * model.omega**2)
    a = (model.shapes * compliance) @ model.shapes.T + model.residual
    b = model.shapes @ q - model.eta
    contacts = b.size
    z = np.zeros(contacts)
    if not np.any(b < 0.0):
        return q.copy(), z, SOLVED
    work = make_work(contacts)
    status = solve(a, b, np.ones(contacts, np.uint8), work.active, z, work.factor, work.order)
    if natural_residual(a, b, z) > 1e-9 * np.abs(b).max():
        status = NOT_SOLVED
    return q + compliance * (z @ model.shapes), z, status


def start_run(model: Model, q, v, force, steps_per_output: int, outputs: int, ledger: bool, published_start: bool) -> Run:
    """A run at t = 0 from q, v = q̇ (N,) and contact forces λ (C,); output row 0 is written.

    Moreau–Jean needs a backward-difference velocity. The exact start takes the first step with the exact propagator,
    w¹ = (q¹ − q⁰)/Δt; the published one sets w⁰ = q̇, which is q(−Δt) = q(0) for a string at rest.
    """
    n, contacts = model.omega.size, model.eta.size
    whole_q, whole_v = padded_rows(np.asarray(q, dtype=np.float64), padded(n)), padded_rows(np.asarray(v), padded(n))
    run = Run(
        q=whole_q[:n],
        v=whole_v[:n],
        whole_q=whole_q,
        whole_v=whole_v,
        u_contact=model.shapes @ q,
        v_contact=model.shapes @ v,
        force=np.array(force, dtype=np.float64),
        sums=np.zeros(_SUMS),
        counts=np.zeros(_COUNTS, np.int64),
        u=np.zeros((outputs, model.out_shapes.shape[0])),
        contact_u=np.zeros((outputs, contacts)),
        contact_force=np.zeros((outputs, contacts)),
        energy=np.zeros((outputs if ledger else 0, len(ENERGY_COLUMNS))),
        watch=np.ones(contacts, np.uint8),
        records=np.zeros((steps_per_output, contacts)),
        parts=np.zeros((model.sub.parts, contacts)),
        scratch=np.zeros((3, n)),
        work=make_work(contacts),
        block_work=make_block_work(contacts, n),
        block_out=np.zeros((model.out_shapes.shape[0], _BLOCKS * BLOCK)),
        block_force=np.zeros((_BLOCKS * BLOCK, contacts)),
        block_u=np.zeros((_BLOCKS * BLOCK, contacts)),
        eta=model.eta.copy(),
        risen=np.zeros(1),
    )
    run.counts[LAST_CONTACT] = 0 if np.any(run.force > 0.0) else -1
    run.sums[PENETRATION] = -np.inf if contacts else 0.0
    run.sums[RISE] = run.sums[LEAST_VISCOUS] = run.sums[LEAST_CONTACT] = 0.0
    run.sums[STORED] = stored(model.law, model.omega, model.factor, model.mu, model.dt, run.q, run.v)
    run.sums[SPRING] = spring(model.residual, run.force)
    run.sums[INITIAL] = run.sums[STORED] + run.sums[SPRING]
    _write_output(model, run)
    if model.law != EXACT_HOLD and not published_start:
        exact = coefficients(EXACT_HOLD, model.omega, model.sigma, model.mu, model.dt)
        moved = exact[0] * run.q + exact[1] * run.v
        run.v[:] = (moved - run.q) / model.dt
        run.q[:] = moved
        run.u_contact[:] = model.shapes @ run.q
        run.v_contact[:] = model.shapes @ run.v
        run.counts[STEPS] = run.counts[PHASE] = 1
        # the ledger of this scheme's energy begins with its first state
        run.sums[STORED] = stored(model.law, model.omega, model.factor, model.mu, model.dt, run.q, run.v)
        run.sums[INITIAL] = run.sums[STORED]
        if run.energy.size:
            run.energy[0, 0] = run.sums[STORED]
        if run.counts[PHASE] == steps_per_output:
            _write_output(model, run)
    return run


#: arrays of a run that another goes on from
_CARRIED = ("q", "v", "u_contact", "v_contact", "force", "eta", "risen")


def kept_of(run: Run) -> dict[str, np.ndarray]:
    """What `resume_run` goes on from: the run as it is at a row, forces of that row and, with the ledger, its sums."""
    kept = {name: np.array(getattr(run, name)) for name in _CARRIED}
    kept["divide"] = np.array(run.counts[DIVIDE])
    kept["row_force"] = run.contact_force[run.counts[ROW] - 1].copy()
    if run.energy.size:
        kept["sums"] = run.sums.copy()
    return kept


def resume_run(
    model: Model, kept: Mapping[str, np.ndarray], first: int, steps_per_output: int, outputs: int, ledger: bool
) -> Run:
    """A run from where another was at step `first`; its row 0 is that row. What is largest or last is so since then.

    Raises ValueError for what is kept of another problem. Steps that are taken one at a time, or in blocks that begin where
    those of an undivided run would, give the same bits.
    """
    n, contacts = (model.omega.size,), (model.eta.size,)
    q, v = kept_array(kept, "q", n), kept_array(kept, "v", n)
    run = start_run(model, q, v, kept_array(kept, "force", contacts), steps_per_output, outputs, ledger, True)
    for name in _CARRIED:
        array = getattr(run, name)
        array[:] = kept_array(kept, name, array.shape)
    run.counts[STEPS], run.counts[DIVIDE], run.counts[ROW] = first, kept_array(kept, "divide", ()) != 0, 0
    run.counts[LAST_CONTACT] = first if np.any(run.force > 0.0) else -1
    if ledger and "sums" in kept:
        run.sums[:] = kept_array(kept, "sums", (_SUMS,))
    run.sums[PENETRATION] = -np.inf if run.eta.size else 0.0
    run.sums[RISE] = run.sums[LEAST_VISCOUS] = run.sums[LEAST_CONTACT] = 0.0
    _write_output(model, run)
    run.contact_force[0] = kept_array(kept, "row_force", contacts)
    return run


def change_model(old: Model, new: Model, run: Run) -> None:
    """Go on under `new`, which has other ω, σ and R: same shapes, law and step. For a change of tension.

    q and v are carried over, and so is R λ, the displacement of the modes left out; the forces that go with it follow,
    so that the contacts stay where they are and the scheme stays passive. What the stored energy gains counts as injected.
    """
    if np.any(old.residual @ run.force):
        run.force[:] = np.linalg.lstsq(new.residual, old.residual @ run.force, rcond=None)[0]
    if run.energy.size:
        after_stored = stored(new.law, new.omega, new.factor, new.mu, new.dt, run.q, run.v)
        after_spring = spring(new.residual, run.force)
        run.sums[INJECTED] += after_stored + after_spring - run.sums[STORED] - run.sums[SPRING]
        run.sums[STORED] = after_stored
        run.sums[SPRING] = after_spring


@njit(cache=True, nogil=True)
def _write_output(model: Model, run: Run) -> None:
    """One row of every result, from the state as it is and the contact forces recorded since the row before."""
    row = run.counts[ROW]
    for p in range(model.out_shapes.shape[0]):
        run.u[row, p] = dot(model.out_shapes[p], run.q)
    for c in range(model.eta.size):
        u = dot(model.shapes[c], run.q)
        for d in range(model.eta.size):
            u += model.residual[c, d] * run.force[d]
        run.contact_u[row, c] = u
    _close_row(model, run)


@njit(inline="always")
def _close_row(model: Model, run: Run) -> None:
    """What a row has besides displacements: forces, penetration, energies."""
    row = run.counts[ROW]
    scale = 1.0 if model.law == EXACT_HOLD else 1.0 / model.dt
    steps = run.counts[PHASE]
    for c in range(model.eta.size):
        run.sums[PENETRATION] = max(run.sums[PENETRATION], run.eta[c] - run.contact_u[row, c])
        total = 0.0
        for t in range(steps):
            total += run.records[t, c]
        run.contact_force[row, c] = total / steps * scale if steps > 0 else run.force[c]
    if run.energy.shape[0] > 0:
        for k in range(5):
            run.energy[row, k] = run.sums[k]
    run.counts[ROW] = row + 1
    run.counts[PHASE] = 0


@njit(cache=True, nogil=True)
def certify_watch(model: Model, run: Run) -> None:
    """Clear `watch` of contacts that free motion cannot reach from here; exact-hold only."""
    contacts = model.eta.size
    for c in range(contacts):
        run.watch[c] = 1
    if model.law == EXACT_HOLD and contacts > 1:
        amplitude = run.scratch[0]
        amplitudes(model.omega, model.sigma, run.q, run.v, amplitude)
        for c in range(contacts):
            # the bound is a sum of N roundings too: leave it a margin
            if reach(model.shapes[c], amplitude) * (1.0 + 1e-9) < -model.eta[c]:
                run.watch[c] = 0
            elif model.sub.parts > 1:
                run.u_contact[c] = dot(model.shapes[c], run.q)


@njit(cache=True, nogil=True)
def run(model: Model, run: Run, n_steps: int, finger: Finger) -> None:
    """n steps; finger.path (nK + 1,) at every part of a step where finger.on. Stops early when the results are full."""
    run_moving(model, run, n_steps, finger, np.zeros(0))


@njit(cache=True, nogil=True)
def run_moving(model: Model, run: Run, n_steps: int, finger: Finger, path) -> None:
    """`run` while the obstacle moves up and down as a whole.

    path (n + 1,) its displacement [m] from the heights of the model, at the start and after each step; (0,): it stands.
    Where it moves, steps are whole whatever the model says.
    """
    every = run.records.shape[0]
    ledger = run.energy.shape[0] > 0
    moves = path.size > 0
    none = np.zeros((0, model.omega.size))
    no_out = np.zeros((every, 0))
    no_record = np.zeros((0, 0))
    count = 1 if moves else model.sub.parts
    run.watch[:] = 1  # model and finger may be others than in the call before
    in_blocks = not (ledger or moves or finger.on != 0) and model.block.rows.size > 0 and (count == 1 or model.eta.size == 1)
    forget(run.block_work)
    done = 0
    while done < n_steps and run.counts[ROW] < run.u.shape[0]:
        if in_blocks:
            m = _run_blocks(model, run, n_steps - done, count)
            if m > 0:
                done += m
                continue
            forget(run.block_work)
            run.watch[:] = 1  # blocks before may have touched what was out of reach
        phase = run.counts[PHASE]
        here = Finger(
            finger.on,
            finger.weights,
            finger.coupling,
            finger.own,
            finger.stiffness,
            finger.resistance,
            finger.path[done * count :] if finger.on else finger.path,
            finger.state,
        )
        m = 1
        if count > 1 and (ledger or finger.on != 0 or model.eta.size == 1):
            _divided_step(model, run, here, path, ledger, none, no_out)
        elif ledger:
            run.watch[:] = 1
            _weighed_step(model, run, here, path[done : done + 2], run.records[phase : phase + 1], none, no_out)
        elif count > 1:
            m = min(n_steps - done, every - phase)
            if m > 8 or run.counts[STEPS] % _CERTIFY_STEPS == 0:
                certify_watch(model, run)
            status = advance_substepped(
                m, model.dt, model.sub, model.coef, model.shapes, run.eta, run.q, run.v, run.u_contact, run.force,
                here, run.watch, run.counts[DIVIDE : DIVIDE + 1], none, none, no_out, no_out,
                run.records[phase : phase + m], run.scratch, run.v_contact, run.parts, none, run.work,
            )  # fmt: skip
            if status != SOLVED:
                run.counts[BAD_STEPS] += 1
        else:
            m = min(n_steps - done, every - phase)
            restitution = model.restitution
            if moves:
                m = 1
                restitution = _rise(model, run, path[done], path[done + 1])
            if moves or finger.on != 0:
                run.watch[:] = 1
            elif m > 8 or run.counts[STEPS] % _CERTIFY_STEPS == 0:
                certify_watch(model, run)
            status = advance(
                model.law, m, model.dt, restitution, model.coef, model.shapes, run.eta, model.g,
                run.q, run.v, run.u_contact, run.v_contact, run.force, here, run.watch,
                none, none, no_out, no_out, run.records[phase : phase + m], no_record, run.work,
            )  # fmt: skip
            if moves:
                _risen(model, run, path[done], path[done + 1])
            if status != SOLVED:
                run.counts[BAD_STEPS] += 1
        for t in range(m):
            touched = False
            for c in range(model.eta.size):
                if run.records[phase + t, c] > 0.0:
                    touched = True
            if touched:
                run.counts[LAST_CONTACT] = run.counts[STEPS] + t + 1
                run.counts[CONTACT_STEPS] += 1
        done += m
        run.counts[STEPS] += m
        run.counts[PHASE] += m
        if run.counts[PHASE] == every:
            _write_output(model, run)


@njit(inline="always")
def _run_blocks(model: Model, run: Run, n_steps: int, parts: int) -> int:
    """As many of the next n steps, each of `parts` parts, as one call of the block kernel can do; how many these are.

    Where rows are whole blocks apart, each call ends at a row at the latest and row and block must begin together; where
    they are not, the kernel gives what belongs into a row at every step.
    """
    every, contacts, points = run.records.shape[0], model.eta.size, model.out_shapes.shape[0]
    phase = run.counts[PHASE]
    apart = every * parts % BLOCK == 0
    if apart and phase * parts % BLOCK != 0:
        return 0
    most = min(n_steps, (run.u.shape[0] - run.counts[ROW]) * every - phase)
    if apart:
        most = min(most, every - phase)
    blocks = min(_BLOCKS, most * parts // BLOCK)
    while blocks * BLOCK % parts != 0:
        blocks -= 1
    if blocks <= 0:
        return 0
    block, steps = model.block, blocks * BLOCK
    force, u = run.block_force[:steps], run.block_u[:steps]
    none = run.block_u[:0]
    watched = 0 if apart else points
    status = SOLVED
    if contacts == 1 and model.law == EXACT_HOLD and watched <= 1:
        press_blocks(
            blocks, run.whole_q.size, block.rows, block.shapes[0], run.eta[0], block.lags[0, 0], run.whole_q, run.whole_v,
            block.weights[:watched], watched, block.out_lags[:watched], run.block_out, run.block_work.spare[0],
            run.block_work.forces[0], u[:, 0], force[:, 0],
        )  # fmt: skip
    else:
        status = advance_blocks(
            blocks, model.law, run.whole_q.size, block.dt, model.restitution, block.rows, model.omega, block.shapes,
            run.eta, block.lags, 1 if apart and contacts >= CERTIFY_FROM else 0, run.whole_q, run.whole_v, run.u_contact,
            run.v_contact, block.weights[:watched], watched, block.out_lags[:watched], run.block_out, force,
            none if apart else u, run.block_work,
        )  # fmt: skip
    if status != SOLVED:
        run.counts[BAD_STEPS] += 1
    put(run.force, force[steps - 1])
    for t in range(steps // parts):
        last = (t + 1) * parts - 1
        touched = False
        for c in range(contacts):
            total = 0.0
            for k in range(t * parts, last + 1):
                total += force[k, c]
            run.records[run.counts[PHASE], c] = total / parts
            touched = touched or total > 0.0
        run.counts[STEPS] += 1
        run.counts[PHASE] += 1
        if touched:
            run.counts[LAST_CONTACT] = run.counts[STEPS]
            run.counts[CONTACT_STEPS] += 1
        if run.counts[PHASE] == every:
            if apart:
                _write_output(model, run)
            else:
                row = run.counts[ROW]
                for p in range(points):
                    run.u[row, p] = run.block_out[p, last]
                for c in range(contacts):
                    run.contact_u[row, c] = u[last, c]
                _close_row(model, run)
    return steps // parts


@njit(**INNER)
def _divided_step(model: Model, run: Run, finger: Finger, path, ledger: bool, none, no_out) -> None:
    """One step, in parts where `solver.substeps` says so or a finger is on; weighed if asked for. path (0,): no motion."""
    phase, count, contacts = run.counts[PHASE], model.sub.parts, model.eta.size
    run.watch[:] = 1
    whole = finger.on == 0 and contacts > 1 and run.counts[DIVIDE] == 0
    after = run.v_contact
    if whole and clear_step(model.coef, model.shapes, run.eta, run.q, run.v, run.watch, run.u_contact, run.scratch, after):
        _weighed_step(model, run, finger, path, run.records[phase : phase + 1], none, no_out)
    else:
        fine = Model(
            model.law, model.dt / count, model.restitution, model.mu, model.omega, model.sigma, model.sub.coef,
            model.factor, model.shapes, model.eta, model.sub.g, model.residual, model.out_shapes, model.sub, model.block,
        )  # fmt: skip
        for k in range(count):
            here = Finger(
                finger.on, finger.weights, finger.coupling, finger.own, finger.stiffness, finger.resistance,
                finger.path[k:] if finger.on else finger.path, finger.state,
            )  # fmt: skip
            if ledger:
                _weighed_step(fine, run, here, path, run.parts[k : k + 1], none, no_out)
            else:
                status = advance(
                    fine.law, int(np.int64(1)), fine.dt, fine.restitution, fine.coef, fine.shapes, run.eta, fine.g,
                    run.q, run.v, run.u_contact, run.v_contact, run.force, here, run.watch,
                    none, none, no_out[:1], no_out[:1], run.parts[k : k + 1], run.parts[0:0], run.work,
                )  # fmt: skip
                if status != SOLVED:
                    run.counts[BAD_STEPS] += 1
        for c in range(contacts):
            run.records[phase, c] = 0.0
            for k in range(count):
                run.records[phase, c] += run.parts[k, c] / count
            after[c] = dot(model.shapes[c], run.q)
    touched = False
    for c in range(contacts):
        touched = touched or run.records[phase, c] > 0.0
    run.counts[DIVIDE] = 1 if touched or arriving(run.eta, run.u_contact, after) else 0
    put(run.u_contact, after)


@njit(inline="always")
def _raise(model: Model, run: Run, displacement: float) -> None:
    for c in range(run.eta.size):
        run.eta[c] = model.eta[c] + displacement


@njit(**INNER)
def _rise(model: Model, run: Run, before: float, after: float) -> float:
    """Heights for a step in which the obstacle goes from `before` to `after` [m]; returns the restitution to step with.

    Exact-hold takes the heights at the end of the step. Moreau–Jean's law is one of velocities relative to the obstacle,
    whose own is w⁻ over the step before and w⁺ over this one:

        0 ≤ (S v⁺ − w⁺) + e (S v − w⁻)  ⊥  p ≥ 0,   active where the gap now, or predicted with S v − w⁻, is closed.

    For the kernel that is restitution 1 after the velocity e (S v − w⁻) − w⁺, over heights that leave the gap the same.
    `_risen` belongs behind the step.
    """
    if model.law == EXACT_HOLD:
        _raise(model, run, after)
        return model.restitution
    old, new = run.risen[0] / model.dt, (after - before) / model.dt
    for c in range(model.eta.size):
        relative = run.v_contact[c] - old
        run.v_contact[c] = model.restitution * relative - new
        run.eta[c] = model.eta[c] + before
        if model.law == MOREAU_JEAN_FILTERED:
            run.eta[c] += 0.5 * model.dt * (run.v_contact[c] - relative)
    return 1.0


@njit(**INNER)
def _risen(model: Model, run: Run, before: float, after: float) -> None:
    """The obstacle as it is after the step that `_rise` prepared."""
    _raise(model, run, after)
    run.risen[0] = after - before


@njit(**INNER)
def _weighed_step(model: Model, run: Run, finger: Finger, path, record, none, no_out) -> None:
    """One step with its place in the energy ledger; path (2,) as in `run_moving`, or (0,); forces go to record (1, C)."""
    n, contacts = model.omega.size, model.eta.size
    hold = model.law == EXACT_HOLD
    before_q, before_v, w_free = run.scratch[0], run.scratch[1], run.scratch[2]
    put(before_q, run.q)
    put(before_v, run.v)
    finger_u = dot(finger.weights, run.q) if finger.on else 0.0
    moves = path.size > 0
    restitution = _rise(model, run, path[0], path[1]) if moves else model.restitution
    status = advance(
        model.law, int(np.int64(1)), model.dt, restitution, model.coef, model.shapes, run.eta, model.g,
        run.q, run.v, run.u_contact, run.v_contact, run.force, finger, run.watch,
        none, none, no_out[:1], no_out[:1], record, none, run.work,
    )  # fmt: skip
    if moves:
        _risen(model, run, path[0], path[1])
    if status != SOLVED:
        run.counts[BAD_STEPS] += 1
    worked = 0.0
    injected = 0.0  # by the finger
    lifted = 0.0  # by the obstacle
    if not hold:
        for j in range(n):
            w_free[j] = model.coef[2, j] * before_q[j] + model.coef[3, j] * before_v[j]
    gain = model.coef[5]
    for c in range(contacts):
        after = dot(model.shapes[c], run.q)
        depth = run.eta[c] - after
        for d in range(contacts):
            depth -= model.residual[c, d] * run.force[d]
        run.sums[PENETRATION] = max(run.sums[PENETRATION], depth)
        strength = run.force[c]
        if strength > 0.0:
            if moves:
                mean = strength if hold else strength / model.dt
                lifted += mean * (run.eta[c] - (model.eta[c] + path[0]))
            if hold:
                worked += strength * (after - dot(model.shapes[c], before_q))
            else:
                worked += impulse_work(
                    model.shapes[c], gain, model.omega, model.factor, model.mu, model.dt,
                    before_q, w_free, run.v, strength,
                )  # fmt: skip
    if finger.on:
        push = finger.state[1]
        if hold:
            injected = push * (dot(finger.weights, run.q) - finger_u)
        else:
            injected = impulse_work(
                finger.weights, gain, model.omega, model.factor, model.mu, model.dt,
                before_q, w_free, run.v, push,
            )  # fmt: skip
    after_stored = stored(model.law, model.omega, model.factor, model.mu, model.dt, run.q, run.v)
    after_spring = spring(model.residual, run.force)
    sums = run.sums
    rise = after_stored + after_spring - sums[STORED] - sums[SPRING] - injected - lifted
    viscous = sums[STORED] - after_stored + worked + injected
    contact = lifted - worked - (after_spring - sums[SPRING])
    sums[STORED] = after_stored
    sums[SPRING] = after_spring
    sums[VISCOUS] += viscous
    sums[CONTACT] += contact
    sums[INJECTED] += injected + lifted
    # a finger or obstacle that brings energy raises the scale only as far as it did
    scale = sums[INITIAL] + max(0.0, sums[INJECTED])
    if scale > 0.0:
        sums[RISE] = max(sums[RISE], rise / scale)
        sums[LEAST_VISCOUS] = min(sums[LEAST_VISCOUS], viscous / scale)
        sums[LEAST_CONTACT] = min(sums[LEAST_CONTACT], contact / scale)
