"""Strings on a body by the complex modes of the whole instrument: exact where nothing touches and no hand acts."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np

from synth.physics.coupled import CoupledStrings, Place
from synth.research.case import CaseError
from synth.research.coupled.coupled_run import CoupledOutcome
from synth.research.coupled.coupled_scene import CoupledScene
from synth.solver import coupled_study as study

#: coupled modes of a larger system take minutes
_MOST_UNKNOWNS = 6000
_USE = 'take scheme "exact-hold"'


def run_complex_modes(scene: CoupledScene) -> CoupledOutcome:
    """The scene by `physics.coupled.CoupledStrings.modes`. Contacts are looked at in every step of the case's internal rate;
    CaseError where a string reaches one, and where a hand acts, an obstacle moves or a ledger of losses is wanted."""
    _refuse_what_acts(scene)
    began = time.perf_counter()
    system, x = scene.system, scene.initial()
    modes = system.modes()
    run, h = scene.case.run, scene.frame_s
    every = run.steps_per_output
    places = [
        Place(scene.line_of[number], position, scene.tables[number].obstacle.rides)
        for number, obstacle in enumerate(scene.obstacles)
        for position in obstacle.positions_m
    ]
    heights = np.array([height for obstacle in scene.obstacles for height in obstacle.heights_m])
    contacts = system.displacement_rows(places)
    points = [Place(scene.line_of[number], at) for number, each in enumerate(scene.tables) for at in each.outputs_m]
    rows = system.displacement_rows(points)
    # mean since the row before of the force, and over the last step of the accelerations: what of the state changes by them
    given = np.linalg.solve(system.matrix.T, bridge_force_rows(system).T).T / (every * h)
    heard = np.zeros((2, system.size))
    heard[:, system.parts()[3]] = scene.body_arrays.radiation / h
    everything = np.vstack([rows, contacts, system.bridge_rows(), given, heard])
    at = np.cumsum([0, len(points), len(places), scene.body.axes, scene.body.axes, 2])
    times = np.arange(scene.rows) * every * h
    out = modes.free_response(x, times, everything)
    out[1:, at[3] : at[4]] = np.diff(out[:, at[3] : at[4]], axis=0)
    out[1:, at[4] :] -= modes.free_response(x, times[1:] - h, heard)
    out[0, at[3] :] = 0.0
    deepest = -np.inf if places else 0.0
    if places:
        last = (scene.rows - 1) * every
        for first in range(0, last + 1, 4096):
            steps = np.arange(first, min(first + 4096, last + 1))
            depth = heights - modes.free_response(x, steps * h, contacts)
            deepest = max(deepest, float(depth.max()))
            if deepest > 0.0:
                step, which = np.unravel_index(int(np.argmax(depth > 0.0)), depth.shape)
                place = places[which]
                raise CaseError(
                    f"scheme 'complex-modes': {scene.place(scene.lines[place.line].string)} reaches its obstacle at "
                    f"{place.position_m:g} m after {float(steps[step] * h):.6g} s, and complex modes know no contact; {_USE}"
                )
    final = modes.free_response(x, [(scene.rows - 1) * every * h], np.eye(system.size))[0]
    pieces = [out[:, a:b] for a, b in pairwise(at.tolist())]
    counts = np.zeros(study.N_COUNTS, np.int64)
    counts[study.STEPS], counts[study.LAST_CONTACT] = (scene.rows - 1) * every, -1
    sums = np.zeros(study.N_SUMS)
    sums[study.RISE], sums[study.PENETRATION] = np.nan, deepest
    sums[study.INITIAL] = float(system.energy(x))
    notes = {"eigenvector_condition": modes.condition}
    u, u_contact, bridge, on_bridge, heard = pieces
    none = np.zeros((0, study.N_ENERGIES))
    results = study.StudyRows(u, u_contact, np.zeros_like(u_contact), bridge, on_bridge, heard, none, sums, counts)
    return CoupledOutcome(results, final, notes, time.perf_counter() - began)


def bridge_force_rows(system: CoupledStrings) -> np.ndarray:
    """(D, n): the force of all strings on the bridge by the state, Σ B (−μ Σ c ÿ − μ c_r² b̈ − (T/L) b)."""
    _, rates, p, v = system.parts()
    a, rows = system.matrix, np.zeros((system.body.axes, system.size))
    for number, (line, end) in enumerate(zip(system.lines, system.ends, strict=True)):
        mu = line.linear_density_kg_m
        force = -mu * (line.ramp @ a[rates[number]]) - mu * line.ramp_left_out**2 * (end @ a[v])
        force[p] -= line.stiffness * end
        rows += np.outer(line.direction, force)
    return rows


def _refuse_what_acts(scene: CoupledScene) -> None:
    for number, each in enumerate(scene.tables):
        for what, given in (("finger", each.finger), ("bend", each.bend), ("fret", each.fret)):
            if given:
                raise CaseError(
                    f"scheme 'complex-modes': {scene.place(number)}.{what}: no hand may act, the string begins as "
                    f"[string.initial] says; leave {what} out, or {_USE}"
                )
        if each.obstacle.moves:
            raise CaseError(f"scheme 'complex-modes': {scene.place(number)}.obstacle.motion: nothing may move; {_USE}")
    if scene.case.run.ledger:
        raise CaseError(f"run.ledger: complex modes have no losses of their own to enter; leave ledger out, or {_USE}")
    if scene.system.size > _MOST_UNKNOWNS:
        raise CaseError(
            f"run.modes: complex modes of {scene.system.size} unknowns would take many minutes, the limit is "
            f"{_MOST_UNKNOWNS}; lower modes, or {_USE}"
        )
