"""The energy ledger of coupled strings, frame by frame, compiled. Letters as in `coupled_advance`.

The ledger weighs a frame after it was taken. Losses of strings are those of their modes as oscillators in the frame that
moves with both ends, E_before − E_after + force·way for each line, and know nothing of the bridge; those of the body the
same under the force that it was given; the modes left out lose ½(1 − ρ²) μ c_r² (y_r − V)². Contacts lose
λ·Δη − λ·Δu − Δ(½λᵀRλ) ≥ 0. That all of them and the work together are the change of

    H = Σ ½μ(ẏ² + ω²w²) + ½(T/L)(b − a)² + ½λᵀRλ  of lines, + ½ y_rᵀ M y_r + Σ ½m(ṗ² + Ω²p²)

is not used: `BALANCE` is what is left over, and shows whether the coupling keeps what it should.
"""

from __future__ import annotations

from numba import njit

from synth.solver.block_rows import P11, P12, P21, P22
from synth.solver.coupled_body import COMPONENTS
from synth.solver.coupled_study import (
    BALANCE,
    BODY,
    INITIAL,
    LEAST_BODY,
    LEAST_CONTACT,
    LEAST_STRINGS,
    LEFT_OUT,
    LOST_BODY,
    LOST_CONTACT,
    LOST_LEFT_OUT,
    LOST_STRINGS,
    MOST_BALANCE,
    N_ENERGIES,
    N_LOST,
    N_STORED,
    PENETRATION,
    RESIDUAL,
    RISE,
    SPRINGS,
    STRINGS,
    WORK_FINGER,
    WORK_FRET,
    WORK_OBSTACLE,
    coupled_study,
    far_ends,
    frame_before,
    study_rows,
)
from synth.solver.coupling import (
    FINGER_LEVERAGE,
    KEPT_BY_THE_REST,
    KIND,
    NEAR,
    SINGLE,
    TENSION,
    along,
    coupling_at,
    end_at,
)
from synth.solver.stringmodel import string_model, string_state


@njit(cache=True, nogil=True)
def weigh_now(study: int) -> float:
    """What is stored, into CoupledStudy.now; its sum [J]."""
    t, f = coupled_study(study), far_ends(study)
    c = coupling_at(t.coupling)
    now = t.now
    for k in range(N_STORED):
        now[k] = 0.0
    for line in range(c.lines.end.size):
        e, s, m = end_at(c.lines.end[line]), string_state(c.lines.state[line]), string_model(c.lines.model[line])
        speed, far_speed = along(c, line, c.bridge.speed), f.speed[line]
        total = 0.0
        for j in range(m.modes):
            y = s.v[j] - e.kick[j] * speed + f.moments[line, j] * far_speed
            w = m.omega[j] * s.q[j]
            total += y * y + w * w
        now[STRINGS] += 0.5 * m.mu * total
        drawn = along(c, line, c.bridge.beta) - f.height[line]
        now[SPRINGS] += 0.5 * e.numbers[TENSION] * drawn * drawn
        for k in range(m.contacts.size):
            for i in range(m.contacts.size):
                now[RESIDUAL] += 0.5 * s.force[k] * m.contacts.residual[k, i] * s.force[i]
    for i in range(c.bridge.rest.size):
        for k in range(c.bridge.rest.size):
            now[LEFT_OUT] += 0.5 * c.bridge.rest[i] * c.load.rest_mass[i, k] * c.bridge.rest[k]
    for k in range(c.body.motion.p.size):
        w = c.body.omega[k] * c.body.motion.p[k]
        now[BODY] += 0.5 * c.body.mass[k] * (c.body.motion.speed[k] * c.body.motion.speed[k] + w * w)
    return now[STRINGS] + now[SPRINGS] + now[RESIDUAL] + now[LEFT_OUT] + now[BODY]


@njit(cache=True, nogil=True)
def weigh_frame(study: int) -> bool:
    """The frame that was taken: contact forces, how deep contacts are, and with the ledger its place there. Whether any
    contact gave a force."""
    t, f, r, was = coupled_study(study), far_ends(study), study_rows(study), frame_before(study)
    c = coupling_at(t.coupling)
    frame, now, sums, ledger = c.frame, t.now, r.sums, r.energy.shape[0] > 0
    before = 0.0
    for k in range(N_STORED):
        before += now[k]
    touched = False
    strings, contact, finger_work, obstacle_work, far_work = 0.0, 0.0, 0.0, 0.0, 0.0
    for line in range(c.lines.end.size):
        e, s, m = end_at(c.lines.end[line]), string_state(c.lines.state[line]), string_model(c.lines.model[line])
        contacts, n, steps = m.contacts.size, m.modes, c.lines.steps[line]
        fingered = s.finger[0].on != 0
        if not ledger and contacts == 0:
            continue
        old, new = along(c, line, was.speed), along(c, line, c.bridge.speed)
        b, far = along(c, line, was.beta), was.far[line]
        turn = new - old
        q, v = was.q[line], was.v[line]
        at_start, at_end, impulse = 0.0, 0.0, 0.0
        for j in range(n):
            v[j] += e.kick[j] * turn
            w = m.omega[j] * q[j]
            at_start += v[j] * v[j] + w * w
            w = m.omega[j] * s.q[j]
            at_end += s.v[j] * s.v[j] + w * w
            impulse += f.moments[line, j] * (s.v[j] - v[j])
        strings += 0.5 * m.mu * (at_start - at_end)
        pushed = 0.0  # mean of (1 − x/L) λ
        if e.counts[KIND] < SINGLE:
            for k in range(contacts):
                deep = s.eta[k] - e.leverage[k] * (b + new * frame)
                for j in range(n):
                    deep -= m.contacts.shapes[k, j] * s.q[j]
                sums[PENETRATION] = max(sums[PENETRATION], deep)
        else:
            held = 0.0
            if fingered:
                for j in range(n):
                    held += s.grip.weights[j] * q[j]
            for k in range(contacts):
                total = 0.0
                for j in range(n):
                    total += m.contacts.shapes[k, j] * q[j]
                was.way[k] = total
            rise = (f.height[line] - far) / steps
            climb = new * frame / steps
            for i in range(steps):
                _step(t, was, c, line, i, q, v)
                for k in range(contacts):
                    at = t.first[line] + k
                    force = was.acting[at]
                    total = 0.0
                    for j in range(n):
                        total += m.contacts.shapes[k, j] * q[j]
                    moved = total - was.way[k]
                    was.way[k] = total
                    raised = s.eta[k] - was.eta[at] if i == 0 else 0.0
                    strings += force * moved
                    contact += force * (raised - moved - e.leverage[k] * climb)
                    obstacle_work += force * (raised + f.leverage[at] * rise)
                    pushed += f.leverage[at] * force / steps
                    given, missing = 0.0, 0.0
                    for o in range(contacts):
                        given += m.contacts.residual[k, o] * was.acting[t.first[line] + o]
                        missing += m.contacts.residual[k, o] * was.force[t.first[line] + o]
                    contact -= 0.5 * (force * given - was.force[at] * missing)
                    deep = s.eta[k] - total - e.leverage[k] * (b + climb * (i + 1)) - given
                    sums[PENETRATION] = max(sums[PENETRATION], deep)
                    if force != 0.0:
                        touched = True
                    t.mean_force[at] += force / steps
                for k in range(contacts):
                    was.force[t.first[line] + k] = was.acting[t.first[line] + k]
                if fingered:
                    push, total = e.block.forces[contacts, i], 0.0
                    for j in range(n):
                        total += s.grip.weights[j] * q[j]
                    moved = total - held
                    held = total
                    strings += push * moved
                    moved += e.numbers[FINGER_LEVERAGE] * climb + f.finger[line] * rise
                    finger_work += push * moved
                    pushed += f.finger[line] * push / steps
        if f.height[line] != far:
            drawn = 0.5 * (far + f.height[line]) - b - 0.5 * new * frame
            held_by = m.mu * impulse / frame - pushed + e.numbers[TENSION] * drawn
            far_work += held_by * (f.height[line] - far)
    if not ledger:
        return touched
    body = 0.0
    for k in range(c.body.motion.p.size):
        force = 0.0
        for i in range(COMPONENTS):
            force += c.body.shape[i, k] * c.body.ahead.force[i, 0]
        w_old, w_new = c.body.omega[k] * was.body[0, k], c.body.omega[k] * c.body.motion.p[k]
        v_old, v_new = was.body[1, k], c.body.motion.speed[k]
        body += 0.5 * c.body.mass[k] * (v_old * v_old - v_new * v_new + w_old * w_old - w_new * w_new)
        body += force * (c.body.motion.p[k] - was.body[0, k])
    rest = 0.0
    for i in range(c.bridge.rest.size):
        for k in range(c.bridge.rest.size):
            one, other = was.rest[i] - c.bridge.speed[i], was.rest[k] - c.bridge.speed[k]
            rest += 0.5 * (1.0 - KEPT_BY_THE_REST * KEPT_BY_THE_REST) * one * c.load.rest_mass[i, k] * other
    after = weigh_now(study)
    now[LOST_STRINGS] += strings
    now[LOST_CONTACT] += contact
    now[LOST_BODY] += body
    now[LOST_LEFT_OUT] += rest
    now[WORK_FINGER] += finger_work
    now[WORK_OBSTACLE] += obstacle_work
    now[WORK_FRET] += far_work
    work = finger_work + obstacle_work + far_work
    scale = _scale(now, sums)
    if scale > 0.0:
        sums[RISE] = max(sums[RISE], (after - before - work) / scale)
        sums[LEAST_STRINGS] = min(sums[LEAST_STRINGS], strings / scale)
        sums[LEAST_CONTACT] = min(sums[LEAST_CONTACT], contact / scale)
        sums[LEAST_BODY] = min(sums[LEAST_BODY], body / scale)
        left = (after - before - work + strings + contact + body + rest) / scale
        sums[MOST_BALANCE] = max(sums[MOST_BALANCE], abs(left))
        sums[BALANCE] = _balance(now, sums) / scale
    return touched


@njit(inline="always")
def _scale(now, sums) -> float:
    """What energy there was to have so far [J]."""
    worked = 0.0
    for k in range(N_STORED + N_LOST, N_ENERGIES):
        worked += now[k]
    return sums[INITIAL] + max(0.0, worked)


@njit(inline="always")
def _balance(now, sums) -> float:
    total = -sums[INITIAL]
    for k in range(N_STORED + N_LOST):
        total += now[k]
    for k in range(N_STORED + N_LOST, N_ENERGIES):
        total -= now[k]
    return total


@njit(inline="always")
def _step(t, was, c, line: int, i: int, q, v) -> None:
    """Step i of the frame over the modes of a line that was looked at, with its forces; FrameBefore.acting has them."""
    e, s, m = end_at(c.lines.end[line]), string_state(c.lines.state[line]), string_model(c.lines.model[line])
    rows, contacts = m.rows, m.contacts.size
    first = t.first[line]
    for k in range(contacts):
        was.acting[first + k] = 0.0
    for row in range(e.counts[NEAR]):
        was.acting[first + e.block.near[row]] = e.block.forces[row, i]
    fingered = s.finger[0].on != 0
    for j in range(m.modes):
        f = 0.0
        for k in range(contacts):
            f += m.contacts.shapes[k, j] * was.acting[first + k]
        if fingered:
            f += s.grip.weights[j] * e.block.forces[contacts, i]
        a = rows[P11, j] * q[j] + rows[P12, j] * v[j] + rows[4, j] * f
        v[j] = rows[P21, j] * q[j] + rows[P22, j] * v[j] + rows[5, j] * f
        q[j] = a
