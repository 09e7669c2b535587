"""Frames of coupled strings with their rows and their place in an energy ledger, compiled.

Beside `frames` a line has a far end here, at x = 0, whose height a may move: u = Σ w φ + (x/L) b + (1 − x/L) a. As the
bridge it goes at a constant speed over a frame. With d_j = √(2L)/(jπ), the moments of 1 − x/L,

    ẇ = ẏ − c V − d ȧ,    (T/L)(b − a) in place of (T/L) b,    (1 − x_c/L) a in every gap,

so that a is a kick −d Δȧ of the modal velocities before the frame, a force (T/L)(a + a⁺)/2 that is held on the bridge, and
contact heights and a finger's path counted from it. Whoever moves it works f_a Δa,

    f_a = μ Σ d Δẏ/H − mean of (1 − x_c/L) λ + (T/L) mean of (a − b).

An obstacle that begins above the string, as after a change of fret, is taken to be where the string is, and rises from
there by no more than RISE_A_FRAME until it is where it belongs; whoever raises it works λ Δη. Heights change at the start
of a frame.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.coupled_body import COMPONENTS
from synth.solver.coupled_ledger import weigh_frame
from synth.solver.coupled_study import (
    CONTACT_FRAMES,
    LAST_CONTACT,
    N_ENERGIES,
    PHASE,
    RISE_A_FRAME,
    ROW,
    STEPS,
    UNSOLVED,
    coupled_study,
    far_ends,
    frame_before,
    study_rows,
)
from synth.solver.coupling import TENSION, along, coupling_at, end_at, gather_lines
from synth.solver.frames import FORCE, FROM_CONTACTS, V, advance_frames
from synth.solver.line_certificates import look_everywhere
from synth.solver.stringmodel import string_model, string_state


@njit(cache=True, nogil=True)
def advance_study(study: int, frames: int) -> None:
    """So many frames, at most CHUNK, with their rows."""
    for k in range(frames):
        _frame(study, k)


@njit(cache=True, nogil=True)
def _frame(study: int, number: int) -> None:
    t, r, was = coupled_study(study), study_rows(study), frame_before(study)
    c = coupling_at(t.coupling)
    lines = c.lines.end.size
    _move(study, number)
    for line in range(lines):
        s, m = string_state(c.lines.state[line]), string_model(c.lines.model[line])
        for j in range(m.modes):
            was.q[line, j] = s.q[j]
            was.v[line, j] = s.v[j]
        for k in range(m.contacts.size):
            was.force[t.first[line] + k] = s.force[k]
    for k in range(c.body.motion.p.size):
        was.body[0, k], was.body[1, k] = c.body.motion.p[k], c.body.motion.speed[k]
    for i in range(COMPONENTS):
        was.speed[i], was.beta[i], was.rest[i] = c.bridge.speed[i], c.bridge.beta[i], c.bridge.rest[i]
    if advance_frames(t.coupling, t.scratch, int(np.int64(1)), int(np.int64(1)), t.out) != 0:
        r.counts[UNSOLVED] += 1
    touched = weigh_frame(study)
    r.counts[STEPS] += 1
    r.counts[PHASE] += 1
    if touched:
        r.counts[CONTACT_FRAMES] += 1
        r.counts[LAST_CONTACT] = r.counts[STEPS]
    for i in range(COMPONENTS):
        force = c.block.small[FORCE, i] + c.block.small[FROM_CONTACTS, i]
        for k in range(COMPONENTS):
            force -= c.load.drag[i, k] * c.block.small[V, k]
        t.mean_bridge[i] += force
    if r.counts[PHASE] == t.every:
        write_row(study)


@njit(cache=True, nogil=True)
def _move(study: int, number: int) -> None:
    """Far ends, obstacles and fingers' paths for a frame of the call."""
    t, f, was = coupled_study(study), far_ends(study), frame_before(study)
    c = coupling_at(t.coupling)
    frame, turned = c.frame, False
    for i in range(COMPONENTS):
        c.bridge.held[0, i] = 0.0
    for line in range(c.lines.end.size):
        e, s, m = end_at(c.lines.end[line]), string_state(c.lines.state[line]), string_model(c.lines.model[line])
        before, after = f.height[line], f.path[number, line]
        was.far[line] = before
        speed = (after - before) / frame
        turn = speed - f.speed[line]
        stirred = turn != 0.0 or after != before
        if turn != 0.0:
            turned = True
            for j in range(m.modes):
                s.v[j] -= f.moments[line, j] * turn
            f.speed[line] = speed
        f.height[line] = after
        pull = 0.5 * e.numbers[TENSION] * (before + after)
        for i in range(COMPONENTS):
            c.bridge.held[0, i] -= c.lines.direction[line, i] * pull
        for k in range(m.contacts.size):
            at = t.first[line] + k
            was.eta[at] = s.eta[k]
            wanted = t.target[number, at]
            if t.rising[at] and wanted > t.eta[at] + RISE_A_FRAME:
                wanted = t.eta[at] + RISE_A_FRAME
            else:
                t.rising[at] = 0
            t.eta[at] = wanted
            s.eta[k] = wanted - f.leverage[at] * after
            stirred = stirred or s.eta[k] != was.eta[at]
        if stirred:  # what was certain of contacts is not any more
            look_everywhere(c.lines.end[line])
        if s.finger[0].on:
            steps = c.lines.steps[line]
            for i in range(steps + 1):
                height = before + (after - before) * i / steps
                e.path[i] = t.path[line, number * steps + i] - f.finger[line] * height
    if turned:
        gather_lines(t.coupling)


@njit(cache=True, nogil=True)
def write_row(study: int) -> None:
    """One row of every result from the state as it is, and the means since the row before."""
    t, f, r = coupled_study(study), far_ends(study), study_rows(study)
    c = coupling_at(t.coupling)
    row = r.counts[ROW]
    if row >= r.u.shape[0]:
        return
    for p in range(t.out_line.size):
        line = t.out_line[p]
        s, m = string_state(c.lines.state[line]), string_model(c.lines.model[line])
        total = t.out_leverage[p] * along(c, line, c.bridge.beta) + t.out_far[p] * f.height[line]
        for j in range(m.modes):
            total += t.out_shape[p, j] * s.q[j]
        r.u[row, p] = total
    share = 1.0 / r.counts[PHASE] if r.counts[PHASE] else 1.0
    for line in range(c.lines.end.size):
        e, s, m = end_at(c.lines.end[line]), string_state(c.lines.state[line]), string_model(c.lines.model[line])
        for k in range(m.contacts.size):
            at = t.first[line] + k
            total = e.leverage[k] * along(c, line, c.bridge.beta) + f.leverage[at] * f.height[line]
            for j in range(m.modes):
                total += m.contacts.shapes[k, j] * s.q[j]
            for o in range(m.contacts.size):
                total += m.contacts.residual[k, o] * s.force[o]
            r.u_contact[row, at] = total
            r.contact_force[row, at] = t.mean_force[at] * share
            t.mean_force[at] = 0.0
    for i in range(r.bridge.shape[1]):
        r.bridge[row, i] = c.bridge.beta[i]
        r.bridge_force[row, i] = t.mean_bridge[i] * share
    t.mean_bridge[:] = 0.0
    for channel in range(t.out.shape[0]):
        r.radiated[row, channel] = t.out[channel, 0]
    if r.energy.shape[0] > 0:
        for k in range(N_ENERGIES):
            r.energy[row, k] = t.now[k]
    r.counts[ROW] += 1
    r.counts[PHASE] = 0
