"""Strings that end on a bridge which moves, and the body behind it: what compiled code has of them.

A string keeps the modes φ_j = √(2/L) sin(jπx/L) that it has between rigid ends; at x = L the bridge moves by b:

    u(x, t) = Σ w_j φ_j + (x/L) b,    b = B·β,    c_j = √(2L)(−1)^(j+1)/(jπ), the moments of x/L,

β the motion of the bridge in up to three components, B the string's direction among them. Over one frame H, r
steps of the line's own, the bridge moves at a constant V = B·Δβ/H. A string knows of it by a kick −c ΔV of its modal
velocities ẇ = ẏ − c V at the start of the frame, ẏ the whole velocity, which no kick changes; and it pulls at the bridge by
its mean force over the frame,

    f = −μ Σ c_j (ẏ⁺ − ẏ)_j / H − (T/L)(b + b⁺)/2 + mean of ξ λ,    ξ = x_c/L (less 1 for what rides on the bridge),

which the body's modes are under while they pass the frame exactly (`coupled_body`). Inside a frame b̈ = 0, so that the work
on a string is −f Δb and that on the body +f Δb: nothing but the losses changes the sum of all energies. The modes left out
move with the bridge as one mass μ(L/3 − Σ c²), of a motion that forgets all but `KEPT_BY_THE_REST` of itself from frame to
frame.

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
from synth.solver.block_rows import BLOCK, ROWS
from synth.solver.certificates import MARGIN
from synth.solver.coupled_body import COMPONENTS, CoupledBody
from synth.solver.single import SingleLine
from synth.solver.stringmodel import DEPTH, MOVING, STIFFNESS, string_model, string_state
from synth.solver.vectors import FAST, INNER, dot

#: steps of a frame, at most, and only powers of two
MOST_STEPS = BLOCK
#: what the modes left out keep of their motion against the bridge from frame to frame (negative: it swings over)
KEPT_BY_THE_REST = 0.9

#: places in End.numbers
(
    TENSION,  # T/L [N/m]
    LENGTH,  # L [m]
    FINGER_LEVERAGE,  # ξ under the finger
    KICK_REACH,  # how far a unit kick can move any contact, at most [s]
    LARGEST_LEVERAGE,  # |ξ| of any contact, at most
    SPENT,  # what bridge and bends have taken off the clearances since the line was certified [m]
    RISEN,  # the kicks' part of it since End.certificate.bound was taken [m]
    LATELY,  # what the bridge took off them in the last block [m]
    SLACK,  # what it may take off them in this block [m]
    RELIEF,  # share of the contacts' residual compliance that a bend has added to it
    LEAST,  # least clearance of a contact that is certified [m]
    EVER,  # furthest that free flight could move a contact when the line was certified [m]
    RATIO,  # frequency ratio of the bend when the line was last refreshed
    RAISED,  # height that its obstacle was raised by then [m]
    LATELY_RISEN,  # the kicks' part of LATELY [m]
    LARGEST_SHAPE,  # |φ| of any mode at any contact, at most [1/√m]
    HELD_REACH,  # how far a unit push of the finger holds the modes that rest by frames at a contact, at most [m/N]
) = range(17)
N_NUMBERS = 17
#: places in End.counts
(
    ENGAGED,  # whether contacts and finger count
    NEAR,  # contacts that are looked at
    KEPT,  # whether End.kept.modes is of this block
    APART_MODES,  # modes that move while the line is apart, all or a multiple of `lanes.PAD`; others rest, as left out
    CERTIFIED,  # contacts that need not be looked at
    QUIET,  # blocks since something pressed, −1 once End.certificate.bound holds
    KIND,  # state of the line in this block, see below
    DUE,  # tables that wait until the line is looked at (`line_tables`)
    REACH_OF,  # number of the model, from 1 on, that kick, pull, leverage and what any contact has at most are of
    RESTING,  # whether modes rest that would not be missed
    FELT_MODES,  # APART_MODES while they do
    HEARD_MODES,  # APART_MODES while they do not
    BY_FRAMES,  # whether it is looked at a frame at a time, in the modes that are heard: something lies on it, which keeps
    # it clear of all contacts
) = range(13)
N_COUNTS = 13
#: what a line is in a block: apart; engaged, but clear of its contacts for the block; one contact; several, or a finger
FAR, CLEAR, SINGLE, SEVERAL = range(4)
#: rows of End.responses.own and shares: while it is not looked at, while it is
APART, LOOKED_AT = range(2)
#: places in End.block.answer
(
    TURNED,  # what the end's speed changes by in the frame that is asked for [m/s]
    PUSHED,  # mean force of contacts and finger on the bridge then [N]
    STEEPNESS,  # slope of that by the speed
    FINGERS_PUSH,  # push of the finger that End.block.left takes for granted [N]
) = range(4)
N_ANSWER = 4
#: places in End.block.known
(
    PATTERN,  # contacts that press in the steps of that frame, as a number
    LINEAR,  # whether the answer is linear while the same ones press
    SETS,  # sets of contacts whose tables are there (`few_contacts`)
    OF_SETS,  # contacts that these are of
    CULLING,  # how long at a time contacts may be passed over in this block: NEVER, SHORT (AGAIN) or LONG
    LASTS,  # steps for which End.block.left holds (`line_culling`), or USED_UP
    AHEAD,  # whether End.block.u has the finger's next steps already
) = range(7)
N_KNOWN = 7
#: contacts are not passed over; for one pass, which is tried for the last time, or the first; for what is left of the block
NEVER, AGAIN, SHORT, LONG = range(4)
#: in the place of steps: nothing is left of a contact's gap
USED_UP = -1
#: in the place of what is left of a gap: it was used up in this call, and the contact is looked at until the call ends
FOLLOWED = -1.0
#: contacts, at most, of which every set has a table
FEW = 4
#: contacts from which on it pays to ask which are out of reach
CULLED_FROM = 5


class EndResponses(NamedTuple):
    """What a line answers to its end, its contacts and its finger, over a block."""

    share: Annotated[np.ndarray, f8("2")]  # Σ c² of the modes that move
    own: Annotated[np.ndarray, f8("2, RESPONSE")]  # pull after a unit kick, by frames
    waits: Annotated[np.ndarray, u1("contacts")]  # contacts whose moved, reach and drawn are filled when they are looked at
    moved: Annotated[np.ndarray, f8("contacts, RESPONSE")]  # gaps after a unit kick, by steps, the end's way among it
    reach: Annotated[np.ndarray, f8("contacts, BLOCK")]  # mean force on the bridge of one in each step of a frame
    drawn: Annotated[np.ndarray, f8("contacts, BLOCK")]  # pull after that: by step and frame, `_fill_reach`
    finger_moved: Annotated[np.ndarray, f8("1, RESPONSE")]
    finger_reach: Annotated[np.ndarray, f8("1, BLOCK")]
    finger_drawn: Annotated[np.ndarray, f8("1, BLOCK")]


class LineCertificate(NamedTuple):
    """Which contacts a line is certain not to touch (`line_certificates`)."""

    clearance: Annotated[np.ndarray, f8("contacts")]  # [m], of each contact: > 0: it need not be looked at
    bound: Annotated[np.ndarray, f8("contacts")]  # what free flight can move the string by there within a block [m]
    stirred: Annotated[np.ndarray, f8("contacts")]  # √ of how far a unit push there moves the string there, at most [√(m/N)]
    pushed: Annotated[np.ndarray, f8("2")]  # Σ |p| of the finger over a block, Σ λ of the contacts


class LineBlock(NamedTuple):
    """Room for a block of a line: rows of its contacts looked at, then of its finger, by steps; what a frame asked of it."""

    pulled: Annotated[np.ndarray, f8("1, RESPONSE")]  # pull after a force, by steps
    row: Annotated[np.ndarray, f8("BLOCK")]  # pull at the ends of the frames that lie ahead
    u: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]  # gaps of the contacts looked at, then height under the finger
    forces: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]
    slopes: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]  # what the forces change by with the speed of the end
    apart: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]  # gaps of the contacts that do not press, 0 of those that do
    opening: Annotated[np.ndarray, f8("contacts + 1, BLOCK")]  # what these change by with it
    answer: Annotated[np.ndarray, f8("N_ANSWER")]
    known: Annotated[np.ndarray, i8("N_KNOWN")]
    # of the gap of each contact that is not certified, what is left: > 0: it is passed over [m], or FOLLOWED
    left: Annotated[np.ndarray, f8("contacts")]
    drew: Annotated[np.ndarray, f8("BLOCK")]  # pull after the forces of one step, at the ends of its and later frames
    kicks: Annotated[np.ndarray, f8("BLOCK")]  # of the end, by steps while it is looked at; once a block is over, by frames
    near: Annotated[np.ndarray, i8("contacts")]
    matrix: Annotated[np.ndarray, f8("contacts*contacts")]  # of the contacts looked at, the finger taken out


class FewContacts(NamedTuple):
    """Tables of `few_contacts`."""

    tables: Annotated[np.ndarray, f8("SETS, FEW*FEW")]  # of each set of contacts, by columns
    sides: Annotated[np.ndarray, f8("4, FEW")]


class KeptLine(NamedTuple):
    """State of a line as a block begins."""

    modes: Annotated[np.ndarray, f8("2, modes")]
    contacts: Annotated[np.ndarray, f8("contacts + 2")]  # and finger


class End(NamedTuple):
    """What a moving end is to one line."""

    numbers: Annotated[np.ndarray, f8("N_NUMBERS")]
    counts: Annotated[np.ndarray, i8("N_COUNTS")]
    kick: Annotated[np.ndarray, f8("modes")]  # −c: what a unit kick does to ẇ
    pull: Annotated[np.ndarray, f8("modes")]  # μ c
    sigma: Annotated[np.ndarray, f8("modes")]  # of its modes as a hand now damps them [1/s]
    flight: Annotated[np.ndarray, f8("ROWS, modes")]  # of a frame, `lanes`
    leverage: Annotated[np.ndarray, f8("contacts")]  # ξ
    path: Annotated[np.ndarray, f8("path")]  # of the finger [m], at the start and after each step of a call
    responses: EndResponses
    certificate: LineCertificate
    block: LineBlock
    few: FewContacts
    kept: KeptLine
    single: SingleLine  # while it is apart; none where Coupling.single is not set


class BridgeLines(NamedTuple):
    """Lines of an instrument, and how each meets the bridge."""

    steps: Annotated[np.ndarray, i8("lines")]  # r of each
    model: Annotated[np.ndarray, i8("lines")]  # addresses of each line's StringModel, …
    state: Annotated[np.ndarray, i8("lines")]  # … StringState …
    end: Annotated[np.ndarray, i8("lines")]  # … and End
    direction: Annotated[np.ndarray, f8("lines, components")]  # B
    friction: Annotated[np.ndarray, f8("lines")]  # of a line at the contacts of the line before, 0: there is none


class BridgeMotion(NamedTuple):
    """How the bridge moves, and what holds it."""

    beta: Annotated[np.ndarray, f8("components")]  # [m]
    speed: Annotated[np.ndarray, f8("components")]  # V of the frame before [m/s]
    rest: Annotated[np.ndarray, f8("components")]  # motion of the modes left out, in units of √REST [m/s]
    momentum: Annotated[np.ndarray, f8("components")]  # Σ B μ Σ c ẏ
    # force that what is at rest puts on the bridge, which it is counted from: now, and in further stretches of a call
    held: Annotated[np.ndarray, f8("stretches, components")]


class BridgeLoad(NamedTuple):
    """What the lines as they are mean to the bridge: `gather_lines`."""

    share: Annotated[np.ndarray, f8("components, components")]  # Σ B Bᵀ μ Σ c²
    rest_mass: Annotated[np.ndarray, f8("components, components")]  # Σ B Bᵀ μ (L/3 − Σ c²)
    tension: Annotated[np.ndarray, f8("components, components")]  # Σ B Bᵀ T/L
    # Σ B Bᵀ of EndResponses.own; lines apart, lines looked at
    own: Annotated[np.ndarray, f8("2, components, components, RESPONSE")]
    moving: Annotated[np.ndarray, f8("components, components")]  # of all lines, at the end of the kick's own frame
    drag: Annotated[np.ndarray, f8("components, components")]  # A
    inverse: Annotated[np.ndarray, f8("components, components")]  # (I + Γ A/H)⁻¹
    answer: Annotated[np.ndarray, f8("components, components")]  # (I + Γ A/H)⁻¹ Γ


class BridgeBlock(NamedTuple):
    """Room for a block of the bridge."""

    touching: Annotated[np.ndarray, i8("lines + 1")]  # how many lines are not `FAR`, and which
    pull: Annotated[np.ndarray, f8("components, BLOCK")]  # of the lines apart, at the ends of the block's frames
    kicks: Annotated[np.ndarray, f8("components, BLOCK")]
    small: Annotated[np.ndarray, f8("6, components")]
    jacobian: Annotated[np.ndarray, f8("components, components")]
    newton: Annotated[np.ndarray, f8("components, components")]
    kept: Annotated[np.ndarray, f8("4, components")]


class HeldProblem(NamedTuple):
    """The problem of all contacts and fingers, where forces are held (`held_forces`)."""

    matrix: Annotated[np.ndarray, f8("rows*rows")]
    compact: Annotated[np.ndarray, f8("rows*rows")]
    factor: Annotated[np.ndarray, f8("rows*rows")]
    rows: Annotated[np.ndarray, f8("3, rows")]
    places: Annotated[np.ndarray, i8("3, rows")]
    marks: Annotated[np.ndarray, u1("2, rows")]


class Coupling(NamedTuple):
    """An instrument's bridge and body, constants and state, and what follows from its lines as they now are."""

    frame: float  # H [s]
    single: int  # whether lines that are not looked at hold their modes in float32 over a call
    culled_from: int  # contacts of a line from which on some are passed over where they are out of reach (`line_culling`)
    lines: BridgeLines
    body: CoupledBody
    bridge: BridgeMotion
    counts: Annotated[np.ndarray, i8("N_COUPLING_COUNTS")]
    load: BridgeLoad
    block: BridgeBlock
    problem: HeldProblem


#: places in Coupling.counts: frames gone through; of these, those in which something touched or was held, iterations of
#: these, and frames that held the forces because no iteration ended
FRAMES, TOUCHED, ITERATIONS, HELD_FRAMES = range(4)
N_COUPLING_COUNTS = 4

coupling_at, end_at = opener(Coupling), opener(End)


@njit(inline="always")
def steps_of(c, e, line: int) -> int:
    """Steps that a line of Coupling c, whose End is e, now takes in a frame."""
    return 1 if e.counts[BY_FRAMES] else c.lines.steps[line]


@njit(inline="always")
def moving_modes(m, e) -> int:
    """Modes of a line that is looked at, of StringModel m and End e, which move: all, or those that are heard."""
    return e.counts[APART_MODES] if e.counts[BY_FRAMES] else m.modes


@njit(inline="always")
def along(c, line: int, of_bridge) -> float:
    """What a motion of the bridge (D,) is at a line's end: B·β, of Coupling c."""
    total = 0.0
    for i in range(COMPONENTS):
        total += c.lines.direction[line, i] * of_bridge[i]
    return total


@njit(**INNER)
def invert(a, out) -> None:
    """out = a⁻¹ (D, D), D = COMPONENTS, by Gauss–Jordan with row pivots; `a` is lost."""
    for i in range(COMPONENTS):
        for k in range(COMPONENTS):
            out[i, k] = 1.0 if i == k else 0.0
    for i in range(COMPONENTS):
        best = i
        for k in range(i + 1, COMPONENTS):
            if abs(a[k, i]) > abs(a[best, i]):
                best = k
        if best != i:
            for k in range(COMPONENTS):
                a[i, k], a[best, k] = a[best, k], a[i, k]
                out[i, k], out[best, k] = out[best, k], out[i, k]
        factor = 1.0 / a[i, i]
        for k in range(COMPONENTS):
            a[i, k] *= factor
            out[i, k] *= factor
        for r in range(COMPONENTS):
            if r != i:
                factor = a[r, i]
                for k in range(COMPONENTS):
                    a[r, k] -= factor * a[i, k]
                    out[r, k] -= factor * out[i, k]


@njit(cache=True, nogil=True, fastmath=FAST)
def gather_responses(coupling: int) -> None:
    """Coupling.load.own, share and rest_mass, and what follows from them, as the lines are looked at or not."""
    c = coupling_at(coupling)
    d, frame = COMPONENTS, c.frame
    c.load.own[:] = 0.0
    c.load.share[:] = 0.0
    c.load.rest_mass[:] = 0.0
    for line in range(c.lines.end.size):
        e, direction, mu = end_at(c.lines.end[line]), c.lines.direction[line], string_model(c.lines.model[line]).mu
        kind = LOOKED_AT if e.counts[ENGAGED] else APART
        of_line, moving = e.responses.own[kind], mu * e.responses.share[kind]
        left_out = mu * max(0.0, e.numbers[LENGTH] / 3.0 - e.responses.share[kind])
        for i in range(d):
            for k in range(i + 1):
                both, own = direction[i] * direction[k], c.load.own[kind, i, k]
                c.load.share[i, k] += both * moving
                c.load.rest_mass[i, k] += both * left_out
                for t in range(BLOCK, 2 * BLOCK):
                    own[t] += both * of_line[t]
    for i in range(d):
        for k in range(i):
            c.load.share[k, i], c.load.rest_mass[k, i] = c.load.share[i, k], c.load.rest_mass[i, k]
            for kind in range(2):
                for t in range(BLOCK, 2 * BLOCK):
                    c.load.own[kind, k, i, t] = c.load.own[kind, i, k, t]
    for i in range(d):
        for k in range(d):
            c.load.moving[i, k] = c.load.own[0, i, k, BLOCK] + c.load.own[1, i, k, BLOCK]
            moving = c.load.moving[i, k] + c.load.share[i, k]
            moving += (1.0 + KEPT_BY_THE_REST) * c.load.rest_mass[i, k]
            c.load.drag[i, k] = moving / frame + 0.5 * frame * c.load.tension[i, k]
    for i in range(d):
        for k in range(d):
            total = 1.0 if i == k else 0.0
            for r in range(d):
                total += c.body.gamma[i, r] * c.load.drag[r, k] / frame
            c.block.jacobian[i, k] = total
    invert(c.block.jacobian, c.load.inverse)
    for i in range(d):
        for k in range(d):
            c.load.answer[i, k] = 0.0
            for r in range(d):
                c.load.answer[i, k] += c.load.inverse[i, r] * c.body.gamma[r, k]


@njit(cache=True, nogil=True, fastmath=FAST)
def gather_lines(coupling: int) -> None:
    """What the bridge sees of its lines, after any of them, its end, or whether it is looked at, has become another."""
    c = coupling_at(coupling)
    d = COMPONENTS
    c.bridge.momentum[:] = 0.0
    c.load.tension[:] = 0.0
    for line in range(c.lines.end.size):
        e, s = end_at(c.lines.end[line]), string_state(c.lines.state[line])
        direction = c.lines.direction[line]
        moving = s.counts[MOVING]
        momentum = dot(e.pull[:moving], s.v[:moving])
        for i in range(d):
            c.bridge.momentum[i] += direction[i] * momentum
            for k in range(d):
                both = direction[i] * direction[k]
                c.load.tension[i, k] += both * e.numbers[TENSION]
    gather_responses(coupling)
    for i in range(d):
        for k in range(d):
            c.bridge.momentum[i] += c.load.share[i, k] * c.bridge.speed[k]


@njit(cache=True, nogil=True, fastmath=FAST)
def energy_of(coupling: int) -> float:
    """Energy of all strings, their contacts' compliance, fingers' springs excluded, the modes left out and the body [J]."""
    c = coupling_at(coupling)
    d = COMPONENTS
    total = 0.0
    for line in range(c.lines.end.size):
        e, s, m = end_at(c.lines.end[line]), string_state(c.lines.state[line]), string_model(c.lines.model[line])
        speed, b = along(c, line, c.bridge.speed), along(c, line, c.bridge.beta)
        for j in range(m.modes if e.counts[ENGAGED] else e.counts[APART_MODES]):
            y = s.v[j] - e.kick[j] * speed
            w = m.omega[j] * s.q[j]
            total += 0.5 * m.mu * (y * y + w * w)
        total += 0.5 * e.numbers[TENSION] * b * b
        for k in range(m.contacts.size):
            for i in range(m.contacts.size):
                total += 0.5 * s.force[k] * m.contacts.residual[k, i] * s.force[i]
        for k in range(m.contacts.layers.shape[1]):
            sunk = s.eta[k] - e.leverage[k] * b - dot(m.contacts.shapes[k, : m.modes], s.q[: m.modes])
            for i in range(m.contacts.size):
                sunk -= m.contacts.residual[k, i] * s.force[i]
            sunk = min(m.contacts.layers[DEPTH, k], max(0.0, sunk))
            total += 0.5 * m.contacts.layers[STIFFNESS, k] * sunk * sunk
    for i in range(d):
        total -= c.bridge.held[0, i] * c.bridge.beta[i]
        for k in range(d):
            total += 0.5 * c.bridge.rest[i] * c.load.rest_mass[i, k] * c.bridge.rest[k]
    for k in range(c.body.motion.p.size):
        w = c.body.omega[k] * c.body.motion.p[k]
        total += 0.5 * c.body.mass[k] * (c.body.motion.speed[k] * c.body.motion.speed[k] + w * w)
    return total


#: sizes that do not depend on an instrument
COUPLING_SIZES = {
    "components": COMPONENTS,
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


def most_of_contacts(
    omega: np.ndarray, ramp: np.ndarray, shapes: np.ndarray, leverage: np.ndarray
) -> tuple[float, float, float]:
    """KICK_REACH [s], LARGEST_LEVERAGE, LARGEST_SHAPE [1/√m] of a line of modes ω, c (N,) over contacts S (C, N), ξ (C,)."""
    if leverage.size == 0:
        return 0.0, 0.0, 0.0
    sizes = np.abs(shapes)
    return MARGIN * float((sizes @ np.abs(ramp / omega)).max()), float(np.abs(leverage).max()), float(sizes.max())
