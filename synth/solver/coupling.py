"""Strings that end on a bridge which moves, and the body behind it: what compiled code has of them.

A string keeps the modes φ_j = √(2/L) sin(jπx/L) that it has between rigid ends; at x = L the bridge moves by b:

    u(x, t) = Σ w_j φ_j + (x/L) b,    b = B·β,    c_j = √(2L)(−1)^(j+1)/(jπ), the moments of x/L,

β the motion of the bridge in up to three components, B the string's direction among them. Over one frame H, r
steps of the line's own, the bridge moves at a constant V = B·Δβ/H. A string knows of it by a kick −c ΔV of its modal
velocities ẇ = ẏ − c V at the start of the frame, ẏ the whole velocity, which no kick changes; and it pulls at the bridge by
its mean force over the frame,

    f = −μ Σ c_j (ẏ⁺ − ẏ)_j / H − (T/L)(b + b⁺)/2 + mean of ξ λ,    ξ = x_c/L (less 1 for what rides on the bridge),

which the body's modes are under while they pass the frame exactly. Inside a frame b̈ = 0, so that the work on a string is
−f Δb and that on the body +f Δb: nothing but the losses changes the sum of all energies. The modes left out move with the
bridge as one mass μ(L/3 − Σ c²), of a motion that forgets all but `KEPT_BY_THE_REST` of itself from frame to frame.

    coupling   the instrument       coupling_at(address)
    end        of one line of it    end_at(address)

A line is a string in one direction of its motion. Its modes, contacts and finger are those of `stringmodel`; the one output
of its model that is in use is the velocity c μ·ẇ.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numba import njit

from synth.native.arrays import f8, i8, u1
from synth.native.views import opener
from synth.solver.lanes import BLOCK, P12, P22, ROWS
from synth.solver.responses import fill_lags, fill_response
from synth.solver.stringmodel import DEPTH, MOVING, STIFFNESS, string_model, string_state
from synth.solver.vectors import FAST, INNER, dot

#: steps of a frame, at most, and only powers of two
MOST_STEPS = BLOCK
#: what the modes left out keep of their motion against the bridge from frame to frame (negative: it swings over)
KEPT_BY_THE_REST = 0.9

#: places in End.numbers: T/L [N/m]; L; ξ under the finger; of any contact, what a unit kick can move the string by there,
#: and |ξ|; by how much the bridge has lessened clearances since the line was last certified (`line_certificates`), of it by
#: kicks since End.bound, and in the last block; what it may lessen them by in this one
TENSION, LENGTH, FINGER_LEVERAGE, KICK_REACH, LARGEST_LEVERAGE, SPENT, RISEN, LATELY, SLACK = range(9)
N_NUMBERS = 9
#: places in End.counts: whether its contacts and finger count; contacts that are looked at; whether End.kept is of this
#: block; modes that move while it is apart, all or a multiple of `lanes.PAD`: what is above the output's band rests then,
#: and counts among the modes left out; contacts that need not be looked at; blocks since something pressed, −1 once
#: End.bound holds; what it is in this block
ENGAGED, NEAR, KEPT, APART_MODES, CERTIFIED, QUIET, KIND = range(7)
N_COUNTS = 7
#: what a line is in a block: apart; engaged, but clear of its contacts for the block; one contact; several, or a finger
FAR, CLEAR, SINGLE, SEVERAL = range(4)
#: rows of End.own and shares: while it is not looked at, while it is
APART, LOOKED_AT = range(2)
#: places in End.answer: what the end's speed changes by in the frame that is asked for, the contacts' and the finger's mean
#: force on the bridge then, its slope; the finger's push that End.left takes for granted
TURNED, PUSHED, STEEPNESS, FINGERS_PUSH = range(4)
N_ANSWER = 4
#: places in End.known: which contacts press in which steps of that frame, as a number; whether their answer is linear while
#: these do; sets whose tables are there, and of how many contacts (`few_contacts`); for how long at a time contacts may be
#: passed over in this block, and for how many steps End.left holds (`line_culling`); whether End.u has the finger's next
#: steps already
PATTERN, LINEAR, SETS, OF_SETS, CULLING, LASTS, AHEAD = range(7)
N_KNOWN = 7
#: that is never, for one pass, for what is left of the block; and in the place of steps: something left is used up
NEVER, SHORT, LONG = range(3)
USED_UP = -1
#: contacts, at most, of which every set has a table
FEW = 4
#: contacts from which on it pays to ask which are out of reach
CULLED_FROM = 5


class End(NamedTuple):
    """What a moving end is to one line, its responses over a block of steps or frames, and room for a block's rows."""

    numbers: Annotated[np.ndarray, f8("N_NUMBERS")]
    counts: Annotated[np.ndarray, i8("N_COUNTS")]
    kick: Annotated[np.ndarray, f8("modes")]  # −c: what a unit kick does to ẇ
    pull: Annotated[np.ndarray, f8("modes")]  # μ c
    flight: Annotated[np.ndarray, f8("ROWS, modes")]  # of a frame, `lanes`
    leverage: Annotated[np.ndarray, f8("contacts")]  # ξ
    clearance: Annotated[np.ndarray, f8("contacts")]  # [m], of each contact: > 0: it need not be looked at
    share: Annotated[np.ndarray, f8("2")]  # Σ c² of the modes that move
    own: Annotated[np.ndarray, f8("2, RESPONSE")]  # pull after a unit kick, by frames
    moved: Annotated[np.ndarray, f8("contacts, RESPONSE")]  # gaps after a unit kick, by steps, the end's way among it
    reach: Annotated[np.ndarray, f8("contacts, BLOCK")]  # mean force on the bridge of one in each step of a frame
    drawn: Annotated[np.ndarray, f8("contacts, BLOCK")]  # pull after that: by step and frame, `_fill_reach`
    finger_moved: Annotated[np.ndarray, f8("1, RESPONSE")]
    finger_reach: Annotated[np.ndarray, f8("1, BLOCK")]
    finger_drawn: Annotated[np.ndarray, f8("1, BLOCK")]
    bound: Annotated[np.ndarray, f8("contacts")]  # what free flight can move the string by there within a block [m]
    stirred: Annotated[np.ndarray, f8("contacts")]  # √ of how far a unit push there moves the string there, at most [√(m/N)]
    path: Annotated[np.ndarray, f8("path")]  # of the finger [m], at the start and after each step of a call
    pulled: Annotated[np.ndarray, f8("1, contacts + 1, RESPONSE")]  # pull after a force, by steps
    row: Annotated[np.ndarray, f8("BLOCK")]  # pull at the ends of the frames that lie ahead
    u: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]  # gaps of the contacts looked at, then height under the finger
    forces: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]
    slopes: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]  # what the forces change by with the speed of the end
    apart: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]  # gaps of the contacts that do not press, 0 of those that do
    opening: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]  # what these change by with it
    answer: Annotated[np.ndarray, f8("N_ANSWER")]
    known: Annotated[np.ndarray, i8("N_KNOWN")]
    left: Annotated[
        np.ndarray, f8("contacts")
    ]  # of the gap of each contact that is not certified, > 0: it is passed over [m]
    few: Annotated[np.ndarray, f8("SETS, FEW*FEW")]  # of each set of contacts, by columns
    sides: Annotated[np.ndarray, f8("4, FEW")]
    drew: Annotated[np.ndarray, f8("BLOCK")]  # pull after the forces of one step, at the ends of its and later frames
    kicks: Annotated[np.ndarray, f8("BLOCK")]
    pushed: Annotated[np.ndarray, f8("2")]  # Σ |p| of the finger over a block, Σ λ of the contacts
    near: Annotated[np.ndarray, i8("contacts")]
    matrix: Annotated[np.ndarray, f8("contacts*contacts")]  # of the contacts looked at, the finger taken out
    kept: Annotated[np.ndarray, f8("2, modes")]  # state of the modes …
    kept_contacts: Annotated[np.ndarray, f8("contacts + 2")]  # … of contacts and finger as a block begins


class Coupling(NamedTuple):
    """An instrument's bridge and body, constants and state, and what follows from its lines as they now are."""

    frame: float  # H [s]
    culled_from: int  # contacts of a line from which on some are passed over where they are out of reach (`line_culling`)
    steps: Annotated[np.ndarray, i8("lines")]  # r of each
    line_model: Annotated[np.ndarray, i8("lines")]  # addresses of each line's StringModel, …
    line_state: Annotated[np.ndarray, i8("lines")]  # … StringState …
    line_end: Annotated[np.ndarray, i8("lines")]  # … and End
    direction: Annotated[np.ndarray, f8("lines, components")]  # B
    body: Annotated[np.ndarray, f8("6, body")]  # p11, p12, p21, p22, kq, kv over a frame, of a force
    shape: Annotated[np.ndarray, f8("components, body")]  # Ψ
    gamma: Annotated[np.ndarray, f8("components, components")]  # Γ = Ψ diag(kq) Ψᵀ
    radiation: Annotated[np.ndarray, f8("channels, body")]  # output of an acceleration
    body_mass: Annotated[np.ndarray, f8("body")]  # [kg]
    body_omega: Annotated[np.ndarray, f8("body")]
    friction: Annotated[np.ndarray, f8("lines")]  # of a line at the contacts of the line before, 0: there is none
    # state
    p: Annotated[np.ndarray, f8("body")]  # displacements …
    p_speed: Annotated[np.ndarray, f8("body")]  # … and velocities of the body's modes
    beta: Annotated[np.ndarray, f8("components")]  # [m]
    speed: Annotated[np.ndarray, f8("components")]  # V of the frame before [m/s]
    rest: Annotated[np.ndarray, f8("components")]  # motion of the modes left out, in units of √REST [m/s]
    held: Annotated[np.ndarray, f8("components")]  # force that what is at rest puts on the bridge, which it is counted from
    counts: Annotated[np.ndarray, i8("N_COUPLING_COUNTS")]
    # of the lines as they are: `gather_lines`
    momentum: Annotated[np.ndarray, f8("components")]  # Σ B μ Σ c ẏ
    share: Annotated[np.ndarray, f8("components, components")]  # Σ B Bᵀ μ Σ c²
    rest_mass: Annotated[np.ndarray, f8("components, components")]  # Σ B Bᵀ μ (L/3 − Σ c²)
    tension: Annotated[np.ndarray, f8("components, components")]  # Σ B Bᵀ T/L
    own: Annotated[np.ndarray, f8("2, components, components, RESPONSE")]  # Σ B Bᵀ of End.own; lines apart, lines looked at
    drag: Annotated[np.ndarray, f8("components, components")]  # A
    inverse: Annotated[np.ndarray, f8("components, components")]  # (I + Γ A/H)⁻¹
    answer: Annotated[np.ndarray, f8("components, components")]  # (I + Γ A/H)⁻¹ Γ
    # room for a block
    touching: Annotated[np.ndarray, i8("lines + 1")]  # how many lines are not `FAR`, and which
    pull: Annotated[np.ndarray, f8("components, BLOCK")]  # of the lines apart, at the ends of the block's frames
    kicks: Annotated[np.ndarray, f8("components, BLOCK")]
    small: Annotated[np.ndarray, f8("8, components")]
    jacobian: Annotated[np.ndarray, f8("components, components")]
    newton: Annotated[np.ndarray, f8("components, components")]
    body_free: Annotated[np.ndarray, f8("3, body")]
    kept_body: Annotated[np.ndarray, f8("2, body")]
    kept: Annotated[np.ndarray, f8("4, components")]
    big: Annotated[np.ndarray, f8("rows*rows")]  # the problem of all contacts and fingers, where forces are held
    big_compact: Annotated[np.ndarray, f8("rows*rows")]
    big_factor: Annotated[np.ndarray, f8("rows*rows")]
    big_rows: Annotated[np.ndarray, f8("3, rows")]
    big_index: Annotated[np.ndarray, i8("3, rows")]
    big_marks: Annotated[np.ndarray, u1("2, rows")]


#: places in Coupling.counts: frames gone through; of these, those in which something touched or was held, iterations of
#: these, and frames that held the forces because no iteration ended
FRAMES, TOUCHED, ITERATIONS, HELD_FRAMES = range(4)
N_COUPLING_COUNTS = 4

coupling_at, end_at = opener(Coupling), opener(End)


@njit(inline="always")
def along(c, line: int, of_bridge) -> float:
    """What a motion of the bridge (D,) is at a line's end: B·β, of Coupling c."""
    total = 0.0
    for i in range(c.beta.size):
        total += c.direction[line, i] * of_bridge[i]
    return total


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_end(model: int, end: int, steps: int, scratch_q, scratch_v, spare) -> None:
    """The responses of a line that takes so many steps a frame to its end, from its model's rows and End.kick, pull, flight,
    leverage, and its shares. Work space (≥n,) and (2, K)."""
    m, e = string_model(model), end_at(end)
    rows, n, kick, all_modes = m.rows, m.rows.shape[1], e.kick, e.flight.shape[1]
    zero, one = int(np.int64(0)), int(np.int64(1))
    q, v = scratch_q[:all_modes], scratch_v[:all_modes]
    for kind in (APART, LOOKED_AT):
        moving = m.modes if kind == LOOKED_AT else e.counts[APART_MODES]
        e.share[kind] = 0.0
        for j in range(all_modes):
            q[j] = e.flight[P12, j] * kick[j] if j < moving else 0.0
            v[j] = e.flight[P22, j] * kick[j] if j < moving else 0.0
            e.share[kind] += kick[j] * kick[j] if j < moving else 0.0
        fill_response(one, e.flight, q, v, e.pull.reshape(1, all_modes), zero, spare, e.own[kind : kind + 1])
    q, v, pull = scratch_q[:n], scratch_v[:n], e.pull[:n].reshape(1, n)
    contacts = m.shapes.shape[0]
    if contacts:
        for j in range(n):
            q[j] = rows[P12, j] * kick[j]
            v[j] = rows[P22, j] * kick[j]
        fill_response(zero, rows, q, v, m.shapes, zero, spare, e.moved)
        none = m.matrix.reshape(-1)[:0].reshape(0, 0)
        fill_lags(one, rows, m.shapes, pull, none, q, v, spare, e.pulled)
        for c in range(contacts):
            _fill_reach(steps, m.dt, e.leverage[c], e.pulled[0, c], e.moved[c], e.reach[c], e.drawn[c])


@njit(**INNER)
def _fill_reach(steps: int, dt: float, leverage: float, pulled, moved, reach, drawn) -> None:
    """From pulled, the pull after a force by steps: its mean over a frame, reach, and what is left at the ends of this and
    later frames, drawn: number t·K/r + i after a force in step t of the i-th frame before. moved: with the end's own way."""
    frames = BLOCK // steps
    for k in range(BLOCK):
        moved[BLOCK + k] += leverage * dt * (k + 1)
        reach[k] = 0.0
    for t in range(steps):
        reach[t] = leverage / steps - pulled[BLOCK + steps - 1 - t] / (steps * dt)
        for i in range(frames):
            drawn[t * frames + i] = pulled[BLOCK + (i + 1) * steps - 1 - t]


@njit(cache=True, nogil=True, fastmath=FAST)
def fill_finger_end(model: int, state: int, end: int, steps: int, scratch_q, scratch_v, spare) -> None:
    """The same of the finger whose weights the state has; `fingers.fill_grip` fills its other responses."""
    m, s, e = string_model(model), string_state(state), end_at(end)
    rows, n = m.rows, m.rows.shape[1]
    q, v = scratch_q[:n], scratch_v[:n]
    finger, zero, one = s.finger_weights[:n].reshape(1, n), int(np.int64(0)), int(np.int64(1))
    for j in range(n):
        q[j] = rows[P12, j] * e.kick[j]
        v[j] = rows[P22, j] * e.kick[j]
    fill_response(zero, rows, q, v, finger, zero, spare, e.finger_moved)
    for j in range(n):
        q[j] = rows[4, j] * finger[0, j]
        v[j] = rows[5, j] * finger[0, j]
    contacts = m.shapes.shape[0]
    pulled = e.pulled[0, contacts:]
    fill_response(one, rows, q, v, e.pull[:n].reshape(1, n), zero, spare, pulled)
    lever = e.numbers[FINGER_LEVERAGE]
    _fill_reach(steps, m.dt, lever, pulled[0], e.finger_moved[0], e.finger_reach[0], e.finger_drawn[0])


@njit(**INNER)
def invert(a, out) -> None:
    """out = a⁻¹ (D, D), D ≤ 3, by Gauss–Jordan with row pivots; `a` is lost."""
    d = a.shape[0]
    for i in range(d):
        for k in range(d):
            out[i, k] = 1.0 if i == k else 0.0
    for i in range(d):
        best = i
        for k in range(i + 1, d):
            if abs(a[k, i]) > abs(a[best, i]):
                best = k
        for k in range(d):
            a[i, k], a[best, k] = a[best, k], a[i, k]
            out[i, k], out[best, k] = out[best, k], out[i, k]
        factor = 1.0 / a[i, i]
        for k in range(d):
            a[i, k] *= factor
            out[i, k] *= factor
        for r in range(d):
            if r != i:
                factor = a[r, i]
                for k in range(d):
                    a[r, k] -= factor * a[i, k]
                    out[r, k] -= factor * out[i, k]


@njit(cache=True, nogil=True, fastmath=FAST)
def gather_responses(coupling: int) -> None:
    """Coupling.own, share and rest_mass, and what follows from them, as the lines are looked at or not."""
    c = coupling_at(coupling)
    d, frame = c.beta.size, c.frame
    c.own[:] = 0.0
    c.share[:] = 0.0
    c.rest_mass[:] = 0.0
    for line in range(c.line_end.size):
        e, direction, mu = end_at(c.line_end[line]), c.direction[line], string_model(c.line_model[line]).mu
        kind = LOOKED_AT if e.counts[ENGAGED] else APART
        for i in range(d):
            for k in range(d):
                both = direction[i] * direction[k]
                c.share[i, k] += both * mu * e.share[kind]
                c.rest_mass[i, k] += both * mu * max(0.0, e.numbers[LENGTH] / 3.0 - e.share[kind])
                for t in range(BLOCK):
                    c.own[kind, i, k, BLOCK + t] += both * e.own[kind, BLOCK + t]
    for i in range(d):
        for k in range(d):
            moving = c.own[0, i, k, BLOCK] + c.own[1, i, k, BLOCK] + c.share[i, k]
            moving += (1.0 + KEPT_BY_THE_REST) * c.rest_mass[i, k]
            c.drag[i, k] = moving / frame + 0.5 * frame * c.tension[i, k]
    for i in range(d):
        for k in range(d):
            total = 1.0 if i == k else 0.0
            for r in range(d):
                total += c.gamma[i, r] * c.drag[r, k] / frame
            c.jacobian[i, k] = total
    invert(c.jacobian, c.inverse)
    for i in range(d):
        for k in range(d):
            c.answer[i, k] = 0.0
            for r in range(d):
                c.answer[i, k] += c.inverse[i, r] * c.gamma[r, k]


@njit(cache=True, nogil=True, fastmath=FAST)
def gather_lines(coupling: int) -> None:
    """What the bridge sees of its lines, after any of them, its end, or whether it is looked at, has become another."""
    c = coupling_at(coupling)
    d = c.beta.size
    c.momentum[:] = 0.0
    c.tension[:] = 0.0
    for line in range(c.line_end.size):
        e, s, m = end_at(c.line_end[line]), string_state(c.line_state[line]), string_model(c.line_model[line])
        direction = c.direction[line]
        momentum = dot(e.pull[: m.modes], s.v[: m.modes])
        for i in range(d):
            c.momentum[i] += direction[i] * momentum
            for k in range(d):
                both = direction[i] * direction[k]
                c.tension[i, k] += both * e.numbers[TENSION]
    gather_responses(coupling)
    for i in range(d):
        for k in range(d):
            c.momentum[i] += c.share[i, k] * c.speed[k]


@njit(cache=True, nogil=True, fastmath=FAST)
def energy_of(coupling: int) -> float:
    """Energy of all strings, their contacts' compliance, fingers' springs excluded, the modes left out and the body [J]."""
    c = coupling_at(coupling)
    d = c.beta.size
    total = 0.0
    for line in range(c.line_end.size):
        e, s, m = end_at(c.line_end[line]), string_state(c.line_state[line]), string_model(c.line_model[line])
        speed, b = along(c, line, c.speed), along(c, line, c.beta)
        for j in range(m.modes if e.counts[ENGAGED] else e.counts[APART_MODES]):
            y = s.v[j] - e.kick[j] * speed
            w = m.omega[j] * s.q[j]
            total += 0.5 * m.mu * (y * y + w * w)
        total += 0.5 * e.numbers[TENSION] * b * b
        for k in range(m.shapes.shape[0]):
            for i in range(m.shapes.shape[0]):
                total += 0.5 * s.force[k] * m.residual[k, i] * s.force[i]
        for k in range(m.layers.shape[1]):
            sunk = s.eta[k] - e.leverage[k] * b - dot(m.shapes[k, : m.modes], s.q[: m.modes])
            for i in range(m.shapes.shape[0]):
                sunk -= m.residual[k, i] * s.force[i]
            sunk = min(m.layers[DEPTH, k], max(0.0, sunk))
            total += 0.5 * m.layers[STIFFNESS, k] * sunk * sunk
    for i in range(d):
        total -= c.held[i] * c.beta[i]
        for k in range(d):
            total += 0.5 * c.rest[i] * c.rest_mass[i, k] * c.rest[k]
    for k in range(c.p.size):
        w = c.body_omega[k] * c.p[k]
        total += 0.5 * c.body_mass[k] * (c.p_speed[k] * c.p_speed[k] + w * w)
    return total


#: sizes that do not depend on an instrument
COUPLING_SIZES = {
    "N_NUMBERS": N_NUMBERS,
    "N_COUNTS": N_COUNTS,
    "N_COUPLING_COUNTS": N_COUPLING_COUNTS,
    "ROWS": ROWS,
    "BLOCK": BLOCK,
    "RESPONSE": 2 * BLOCK,
    "N_ANSWER": N_ANSWER,
    "N_KNOWN": N_KNOWN,
    "FEW": FEW,
    "SETS": 1 << FEW,
}


@njit(cache=True, nogil=True)
def look_at(coupling: int, line: int, engaged: int) -> None:
    """Begin to look at the contacts of a line, or leave off; `gather_lines` once all are so. What is above the band of one
    that is not looked at comes to rest."""
    c = coupling_at(coupling)
    e, s = end_at(c.line_end[line]), string_state(c.line_state[line])
    e.counts[ENGAGED] = engaged
    if engaged:
        s.counts[MOVING] = string_model(c.line_model[line]).modes
        return
    for j in range(e.counts[APART_MODES], s.counts[MOVING]):
        s.q[j] = 0.0
        s.v[j] = 0.0
    s.counts[MOVING] = e.counts[APART_MODES]
