"""Runs one string for a while, writes what it does at the output rate, and keeps the energy ledger if asked.

A run is `start_run`, then `run` as often as the finger or the obstacle's motion changes, and `change_model` wherever the
string's tension does. Steps are taken in blocks (`step`); one at a time (`stepwise`) with the ledger on, under a finger,
over a moving obstacle, over more than `MOST_IN_BLOCKS` contacts, where several contacts divide their steps, and for what is
left over of a block. Steps may be divided where the string touches (`substeps`), but not over a moving obstacle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from synth.native.arrays import allocate
from synth.native.views import table
from synth.solver.block_rows import BLOCK
from synth.solver.certificates import CERTIFY_FROM
from synth.solver.energy import filter_factor, spring, stored
from synth.solver.laws import EXACT_HOLD, coefficients
from synth.solver.layers import held_by_layers, static_forces
from synth.solver.lcp import NOT_SOLVED, SOLVED, natural_residual, solve
from synth.solver.problem import Results, kept_array
from synth.solver.stepwise import finger_row
from synth.solver.stringmodel import (
    Scratch,
    StringContacts,
    StringModel,
    StringModes,
    StringOutputs,
    StringState,
    make_scratch,
    make_state,
    make_string,
    with_outputs,
)
from synth.solver.study import (
    BLOCKS,
    COUNTS,
    DIVIDE,
    INITIAL,
    INJECTED,
    LAST_CONTACT,
    LEAST_CONTACT,
    LEAST_VISCOUS,
    PENETRATION,
    PHASE,
    RISE,
    ROW,
    SPRING,
    STEPS,
    STORED,
    SUMS,
    RunTables,
    advance_study,
    write_output,
)


class Finger(NamedTuple):
    """A finger over some steps. Shapes: N modes, C contacts."""

    weights: np.ndarray  # (N,) mode shapes averaged over its width
    coupling: np.ndarray  # (C,) S diag(k) weightsᵀ, contact responses to a unit finger unknown
    own: float  # weights diag(k) weightsᵀ
    stiffness: float  # [N/m]
    resistance: float  # [N s/m]
    path: np.ndarray  # (n + 1,) prescribed position [m] at the start and after each step, or each part of a step
    state: np.ndarray  # (2,) displacement under the finger [m], its unknown in the last step; in and out


@dataclass(frozen=True)
class Model:
    """What does not change while the tension does not. N modes, C contacts, P output points."""

    modes: StringModes
    under: StringContacts  # heights at t = 0; R is zero for Moreau–Jean
    out_shapes: np.ndarray  # (P, N)
    factor: np.ndarray  # (N,) F of the Moreau–Jean energy
    parts: int  # K of a step that touches
    part: StringModel  # of one of them, of the whole step where K = 1
    string: StringModel  # of a whole step

    @cached_property
    def tables(self) -> dict[str, np.ndarray]:
        """What kernels open: steps with every output, without any, parts of them, and those over an obstacle that moves."""
        contacts = self.under.eta.size
        certified = int(self.string.law == EXACT_HOLD and contacts >= CERTIFY_FROM)
        string, part = (with_outputs(each, 0, 0, 0) for each in (self.string, self.part))
        whole = table(string)
        return {
            "watched": table(self.part if contacts == 1 else self.string),
            "apart": table((part if contacts == 1 else string)._replace(certified=certified)),
            "whole": whole,
            "part": whole if self.part is self.string else table(part),
            "lifted": table(string._replace(restitution=1.0)),
        }

    def but(self, **changed: Any) -> Model:
        """The same with other contacts (fields of StringContacts) or another argument of `make_model`."""
        contacts = {name: changed.pop(name) for name in StringContacts._fields if name in changed}
        given: dict[str, Any] = {
            "law": self.string.law,
            "modes": self.modes,
            "dt": self.string.dt,
            "under": self.under._replace(**contacts),
            "out_shapes": self.out_shapes,
            "restitution": self.string.restitution,
            "substeps": self.parts,
            "step": self.string.step,
        }
        return make_model(**given | changed)

    def stored(self, q: np.ndarray, v: np.ndarray) -> float:
        """Energy of the modes [J], without what the contacts hold."""
        return stored(self.string.law, self.modes.omega, self.factor, self.modes.mu, self.string.dt, q, v)

    def finger_row(self, weights: np.ndarray) -> tuple[np.ndarray, float]:
        """(Coupling, own) of a Finger with these weights, in a part of a step."""
        coupling, coef = np.zeros(self.under.eta.size), np.ascontiguousarray(self.part.rows[:6, : self.part.modes])
        return coupling, finger_row(self.string.law, coef, self.under.shapes, weights, coupling)


@dataclass
class Run:
    """State, results and scratch of one run, outputs every M steps."""

    state: StringState
    q: np.ndarray  # (N,)
    v: np.ndarray  # (N,)
    u_contact: np.ndarray  # (C,)
    v_contact: np.ndarray  # (C,)
    force: np.ndarray  # (C,) contact unknown of the last step
    eta: np.ndarray  # (C,) heights now
    results: Results
    records: np.ndarray  # (M, C)
    part_records: np.ndarray  # (K, C) forces of a step's parts
    before: np.ndarray  # (3, N)
    risen: np.ndarray  # (1,) how far the obstacle rose in the last step [m]
    stepping: Scratch
    blocks: Scratch
    watching: Scratch

    @cached_property
    def tables(self) -> dict[str, np.ndarray]:
        """What kernels open besides the model's, whatever the finger's path."""
        return {name: table(getattr(self, name)) for name in ("state", "blocks", "watching")}

    def study(self, model: Model, path: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, Any]:
        """The table of RunTables and Results, and what must be kept as long as it is in use."""
        stepping = self.stepping._replace(path=path)
        parting = stepping._replace(record=self.part_records.reshape(-1))
        kept = self.tables | {"stepping": table(stepping), "parting": table(parting)}
        addresses: dict[str, Any] = {name: each.ctypes.data for name, each in (kept | model.tables).items()}
        study = RunTables(
            **addresses,
            factor=model.factor,
            heights=heights,
            **{name: getattr(self, name) for name in ("records", "part_records", "before", "risen")},
        )
        return table(study, self.results), (model, kept, study, stepping)


def make_model(
    law: int,
    modes: StringModes,
    dt: float,
    under: StringContacts,
    out_shapes,
    restitution: float,
    substeps: int = 1,
    step: int = 0,
) -> Model:
    """Coefficients and contact matrix for modes, the contacts under them and outputs (P, N); all arrays may be lists.

    step: address of a law of its own (`contact_laws.step_of`). Layers of contacts are exact-hold's, in steps not divided.

    `substeps` > 1 divides a step where the string touches (`solver.substeps`); exact-hold only, ValueError otherwise.
    """
    if substeps != int(substeps) or substeps < 1:
        raise ValueError(f"substeps must be a whole number >= 1, got {substeps}; 1 leaves the step whole")
    if substeps > 1 and law != EXACT_HOLD:
        raise ValueError(f"substeps need exact-hold, got {substeps} for a Moreau–Jean law; raise the rate instead")
    layers = np.zeros((3, 0)) if under.layers is None else np.ascontiguousarray(under.layers, dtype=np.float64)
    if layers.shape[1] and (substeps > 1 or law != EXACT_HOLD or step):
        raise ValueError(
            "contacts with a soft layer need exact-hold with substeps 1; raise the rate instead of the substeps"
        )
    omega, sigma, shapes, eta, out_shapes = (
        np.ascontiguousarray(a, dtype=np.float64) for a in (modes.omega, modes.sigma, under.shapes, under.eta, out_shapes)
    )
    residual = np.ascontiguousarray(under.residual if law == EXACT_HOLD else np.zeros((eta.size, eta.size)))
    modes, under = modes._replace(omega=omega, sigma=sigma), StringContacts(shapes, eta, residual, layers)
    outputs = StringOutputs(out_shapes)
    in_parts = eta.size == 1 and substeps > 1

    def string_of(dt: float, coef: np.ndarray, in_blocks: bool) -> StringModel:
        return make_string(law, dt, modes, coef, under, outputs, restitution=restitution, in_blocks=in_blocks, step=step)

    coef = coefficients(law, omega, sigma, modes.mu, dt)
    string = part = string_of(dt, coef, not in_parts)
    if substeps > 1:
        part = string_of(dt / substeps, coefficients(law, omega, sigma, modes.mu, dt / substeps), in_parts)
    return Model(modes, under, out_shapes, filter_factor(law, omega, coef, dt), substeps, part, string)


def static_contact(model: Model, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
    """The shape q (N,) lifted on to the obstacle by the least static forces: (q, λ (C,) [N], status of `lcp`).

    0 ≤ S q − η + (S diag(1/μω²) Sᵀ + R) λ ⊥ λ ≥ 0. Whatever force made the given shape goes on unchanged; among all
    shapes clear of the obstacle this is the one whose difference from q costs the least elastic energy.
    """
    (mu, omega, _), (shapes, eta, residual, *_) = model.modes, model.under
    compliance = 1.0 / (mu * omega**2)
    a = (shapes * compliance) @ shapes.T + residual
    b = shapes @ q - eta
    contacts = b.size
    z = np.zeros(contacts)
    if not np.any(b < 0.0):
        return q.copy(), z, SOLVED
    if model.string.contacts.layers.shape[1]:
        z, status = static_forces(a, b, model.string.contacts.layers)
        return q + compliance * (z @ shapes), z, status
    active, factor, order = np.zeros(contacts, np.uint8), np.zeros((contacts, contacts)), np.zeros(contacts, np.int64)
    status = solve(a, b, np.ones(contacts, np.uint8), active, z, factor, order)
    if natural_residual(a, b, z) > 1e-9 * np.abs(b).max():
        status = NOT_SOLVED
    return q + compliance * (z @ shapes), z, status


def start_run(model: Model, q, v, force, steps_per_output: int, outputs: int, ledger: bool, published_start: bool) -> Run:
    """A run at t = 0 from q, v = q̇ (N,) and contact forces λ (C,); output row 0 is written.

    Moreau–Jean needs a backward-difference velocity. The exact start takes the first step with the exact propagator,
    w¹ = (q¹ − q⁰)/Δt; the published one sets w⁰ = q̇, which is q(−Δt) = q(0) for a string at rest.
    """
    string, shapes = model.string, model.under.shapes
    n, contacts, points = string.modes, model.under.eta.size, model.out_shapes.shape[0]
    state = make_state(string, np.asarray(q, dtype=np.float64), np.asarray(v, dtype=np.float64))
    state.u[:] = shapes @ q
    state.v_contact[:] = shapes @ v
    state.force[:] = force
    records = np.zeros((steps_per_output, contacts))
    room = contacts * (2 if string.contacts.layers.shape[1] else 1)
    stepping = make_scratch(room, n, 0, 1)._replace(record=records.reshape(-1))
    watching = make_scratch(room, n, points, BLOCKS * BLOCK, watched=BLOCKS * BLOCK)
    sizes = {"rows": outputs, "contact_rows": outputs, "points": points, "contacts": contacts}
    run = Run(
        state=state,
        q=state.q[:n],
        v=state.v[:n],
        u_contact=state.u,
        v_contact=state.v_contact,
        force=state.force,
        eta=state.eta,
        results=allocate(Results, sizes | {"weighed": outputs if ledger else 0, "sums": SUMS, "counts": COUNTS}),
        records=records,
        part_records=np.zeros((model.parts, contacts)),
        before=np.zeros((3, n)),
        risen=np.zeros(1),
        stepping=stepping,
        blocks=watching._replace(contact_u=np.zeros(0)),
        watching=watching,
    )
    sums, counts = run.results.sums, run.results.counts
    counts[LAST_CONTACT] = 0 if np.any(run.force > 0.0) else -1
    sums[PENETRATION] = -np.inf if contacts else 0.0
    sums[RISE] = sums[LEAST_VISCOUS] = sums[LEAST_CONTACT] = 0.0
    sums[STORED] = model.stored(run.q, run.v)
    sums[SPRING] = _held(model, run)
    sums[INITIAL] = sums[STORED] + sums[SPRING]
    write_row(model, run)
    if string.law != EXACT_HOLD and not published_start:
        exact = coefficients(EXACT_HOLD, model.modes.omega, model.modes.sigma, model.modes.mu, string.dt)
        moved = exact[0] * run.q + exact[1] * run.v
        run.v[:] = (moved - run.q) / string.dt
        run.q[:] = moved
        run.u_contact[:] = shapes @ run.q
        run.v_contact[:] = shapes @ run.v
        counts[STEPS] = counts[PHASE] = 1
        # the ledger of this scheme's energy begins with its first state
        sums[STORED] = model.stored(run.q, run.v)
        sums[INITIAL] = sums[STORED]
        if run.results.energy.size:
            run.results.energy[0, 0] = sums[STORED]
        if counts[PHASE] == steps_per_output:
            write_row(model, run)
    return run


def _held(model: Model, run: Run) -> float:
    """What the contacts hold, R and layers [J]."""
    tables = model.tables["whole"], run.tables["state"]
    return spring(model.under.residual, run.force) + held_by_layers(*(each.ctypes.data for each in tables))


def write_row(model: Model, run: Run) -> None:
    """One row of every result, from the state as it is and the contact forces recorded since the row before."""
    study, kept = run.study(model, np.zeros(1), np.zeros(0))
    write_output(study.ctypes.data)
    del kept


#: arrays of a run that another goes on from
_CARRIED = ("q", "v", "u_contact", "v_contact", "force", "eta", "risen")


def kept_of(run: Run) -> dict[str, np.ndarray]:
    """What `resume_run` goes on from: the run as it is at a row, forces of that row and, with the ledger, its sums."""
    kept = {name: np.array(getattr(run, name)) for name in _CARRIED}
    kept["divide"] = np.array(run.results.counts[DIVIDE])
    kept["row_force"] = run.results.contact_force[run.results.counts[ROW] - 1].copy()
    if run.results.energy.size:
        kept["sums"] = run.results.sums.copy()
    return kept


def resume_run(
    model: Model, kept: Mapping[str, np.ndarray], first: int, steps_per_output: int, outputs: int, ledger: bool
) -> Run:
    """A run from where another was at step `first`; its row 0 is that row. What is largest or last is so since then.

    Raises ValueError for what is kept of another problem. Steps that are taken one at a time, or in blocks that begin where
    those of an undivided run would, give the same bits.
    """
    n, contacts = model.modes.omega.shape, model.under.eta.shape
    q, v = kept_array(kept, "q", n), kept_array(kept, "v", n)
    run = start_run(model, q, v, kept_array(kept, "force", contacts), steps_per_output, outputs, ledger, True)
    sums, counts = run.results.sums, run.results.counts
    for name in _CARRIED:
        array = getattr(run, name)
        array[:] = kept_array(kept, name, array.shape)
    counts[STEPS], counts[DIVIDE], counts[ROW] = first, kept_array(kept, "divide", ()) != 0, 0
    counts[LAST_CONTACT] = first if np.any(run.force > 0.0) else -1
    if ledger and "sums" in kept:
        sums[:] = kept_array(kept, "sums", (SUMS,))
    sums[PENETRATION] = -np.inf if run.eta.size else 0.0
    sums[RISE] = sums[LEAST_VISCOUS] = sums[LEAST_CONTACT] = 0.0
    write_row(model, run)
    run.results.contact_force[0] = kept_array(kept, "row_force", contacts)
    return run


def change_model(old: Model, new: Model, run: Run) -> None:
    """Go on under `new`, which has other ω, σ and R: same shapes, law and step. For a change of tension.

    q and v are carried over, and so is R λ, the displacement of the modes left out; the forces that go with it follow,
    so that the contacts stay where they are and the scheme stays passive. What the stored energy gains counts as injected.
    """
    if np.any(old.under.residual @ run.force):
        run.force[:] = np.linalg.lstsq(new.under.residual, old.under.residual @ run.force, rcond=None)[0]
    if run.results.energy.size:
        sums = run.results.sums
        after_stored = new.stored(run.q, run.v)
        after_spring = _held(new, run)
        sums[INJECTED] += after_stored + after_spring - sums[STORED] - sums[SPRING]
        sums[STORED] = after_stored
        sums[SPRING] = after_spring


def run(model: Model, run: Run, n_steps: int, finger: Finger | None = None, heights: np.ndarray | None = None) -> None:
    """n steps. Stops early when the results are full.

    finger.path (nK + 1,) at every part of a step. heights (n + 1,): displacement of the whole obstacle [m] from where the
    model has it, at the start and after each step; None: it stands. Where it moves, steps are whole whatever the model says.
    """
    held = run.state.finger[0]
    held["on"] = int(finger is not None)
    if finger is not None:
        run.state.grip.weights[: finger.weights.size] = finger.weights
        run.state.grip.coupling[: finger.coupling.size] = finger.coupling
        held["own"], held["stiffness"], held["resistance"] = finger.own, finger.stiffness, finger.resistance
        held["here"], held["push"] = finger.state
    path = np.zeros(1) if finger is None else np.ascontiguousarray(finger.path, np.float64)
    moved = np.zeros(0) if heights is None else np.ascontiguousarray(heights, np.float64)
    study, kept = run.study(model, path, moved)
    advance_study(study.ctypes.data, n_steps)
    del kept
    if finger is not None:
        finger.state[:] = held["here"], held["push"]
        held["on"] = 0
