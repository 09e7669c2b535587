"""The body of coupled strings over a block of frames: what it moves the bridge to and radiates, as rows of K = BLOCK frames.

As a block begins, one look at the modes gives both as they are without a force, rows `free` and `radiates`. What else the
rows hold is sums of a few numbers: a force of one newton held over a frame, in each component of the bridge, does to each
row from that frame on what `moves` and `sounds` say, and so does a push of one newton by the hand, a kick at the frame's
start. A frame adds its force to `goes`, from which the next ones take their place (`push_body`). The modes themselves pass
the frames as the block ends, all at once (`drive_body`): until then nothing of the body has changed.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numba import njit

from synth.native.arrays import allocate, f8, i8
from synth.solver.block_rows import BLOCK, KQ, KV, P11, P12, P21, P22, ROWS
from synth.solver.lanes import (
    add_forced,
    add_late_of_three,
    drive_listed,
    drive_listed_kicked,
    padded,
    project_a,
    project_qqq,
)
from synth.solver.responses import make_rows, padded_rows
from synth.solver.vectors import FAST, INNER

#: components of the bridge's motion that are computed with; those that a body has none of stay zero
COMPONENTS = 3
#: place of a hand's push among the forces on a body, behind the components of the bridge's
HAND = COMPONENTS


class BodyMotion(NamedTuple):
    """Displacements and velocities of a body's modes."""

    p: Annotated[np.ndarray, f8("body")]
    speed: Annotated[np.ndarray, f8("body")]


class BodyAhead(NamedTuple):
    """Rows of the K frames of a block, and what acts in them."""

    free: Annotated[np.ndarray, f8("components, BLOCK")]  # where the body moves the bridge to without a force, …
    goes: Annotated[np.ndarray, f8("components, BLOCK")]  # … and with those that have acted in the block
    radiates: Annotated[np.ndarray, f8("channels, BLOCK")]  # change of the radiating speed over each frame
    force: Annotated[np.ndarray, f8("components + 1, BLOCK")]  # on the bridge in each frame, and of the hand on the body
    knocked: Annotated[np.ndarray, i8("1")]  # whether a hand pushes on the body in this call, …
    knock: Annotated[np.ndarray, f8("knocks")]  # … and how strongly in each of its frames [N]


class CoupledBody(NamedTuple):
    """A body behind a bridge: M modes as padded(M), those behind them at rest for good."""

    rows: Annotated[np.ndarray, f8("ROWS, body")]  # of a frame, `lanes`
    shape: Annotated[np.ndarray, f8("components, body")]  # Ψ
    parts: Annotated[np.ndarray, i8("parts")]  # numbers of the components that it moves the bridge in
    gamma: Annotated[np.ndarray, f8("components, components")]  # Γ = Ψ diag(kq) Ψᵀ
    radiation: Annotated[np.ndarray, f8("channels, body")]  # output of an acceleration
    mass: Annotated[np.ndarray, f8("body")]  # [kg]
    omega: Annotated[np.ndarray, f8("body")]
    struck: Annotated[np.ndarray, f8("body")]  # what velocities change by as a hand pushes on the body by 1 N for a frame
    moves: Annotated[np.ndarray, f8("components, components + 1, RESPONSE")]  # the bridge, by 1 N in each, and by the hand
    sounds: Annotated[np.ndarray, f8("channels, components + 1, RESPONSE")]  # change of the radiating speed over each frame
    motion: BodyMotion
    ahead: BodyAhead


def in_components(array: np.ndarray, axis: int) -> np.ndarray:
    """An array whose axis has D ≤ COMPONENTS places with zeros for the others."""
    widths = [(0, COMPONENTS - array.shape[axis] if k == axis else 0) for k in range(array.ndim)]
    return np.ascontiguousarray(np.pad(array, widths))


def coupled_body(
    steps: np.ndarray, shape: np.ndarray, radiation: np.ndarray, mass: np.ndarray, omega: np.ndarray, struck: np.ndarray,
    knocks: int,
) -> CoupledBody:  # fmt: skip
    """A body at rest.

    steps (6, M) coefficients of a frame, shape (D, M), radiation (channels, M), mass and omega (M,); struck (M,) what the
    hand's push of one newton for a frame changes their velocities by; knocks: frames of a call in which it may push.
    """
    modes, channels = padded(mass.size), radiation.shape[0]
    rows, shapes, heard = make_rows(steps), padded_rows(in_components(shape, 0), modes), padded_rows(radiation, modes)
    kicked = padded_rows(struck, modes)
    moves = np.zeros((COMPONENTS, COMPONENTS + 1, 2 * BLOCK))
    sounds = np.zeros((channels, COMPONENTS + 1, 2 * BLOCK))
    x = np.vstack([rows[KQ] * shapes, rows[P12] * kicked])
    v = np.vstack([rows[KV] * shapes, rows[P22] * kicked])
    before = np.zeros_like(v)
    for k in range(BLOCK, 2 * BLOCK):
        moves[:, :, k] = shapes @ x.T
        sounds[:, :, k] = heard @ (v - before).T
        before = v
        x, v = rows[P11] * x + rows[P12] * v, rows[P21] * x + rows[P22] * v
    parts = np.arange(max(1, shape.shape[0]))
    sizes = {"ROWS": ROWS, "BLOCK": BLOCK, "RESPONSE": 2 * BLOCK, "components": COMPONENTS, "knocks": knocks}
    return allocate(
        CoupledBody, sizes | {"body": modes, "parts": parts.size, "channels": channels},
        rows=rows, shape=shapes, parts=parts, gamma=np.ascontiguousarray(moves[:, :COMPONENTS, BLOCK]), radiation=heard,
        mass=padded_rows(mass, modes), omega=padded_rows(omega, modes), struck=kicked, moves=moves, sounds=sounds,
    )  # fmt: skip


@njit(**INNER)
def look_at_body(body) -> None:
    """BodyAhead.free and radiates, of the K frames ahead."""
    n, shape, free = body.motion.p.size, body.shape, body.ahead.free
    project_qqq(n, body.rows, body.motion.p, body.motion.speed, shape[0], shape[1], shape[2], free[0], free[1], free[2])
    for channel in range(body.radiation.shape[0]):
        project_a(n, body.rows, body.motion.p, body.motion.speed, body.radiation[channel], body.ahead.radiates[channel])


@njit(**INNER)
def begin_body(body, frames: int, at: int) -> None:
    """BodyAhead.goes as a block of so many frames begins, frame `at` of the call on: no force yet but the hand's."""
    ahead = body.ahead
    for i in range(COMPONENTS):
        for k in range(BLOCK):
            ahead.goes[i, k] = ahead.free[i, k]
    for s in range(COMPONENTS + 1):
        for k in range(BLOCK):
            ahead.force[s, k] = 0.0
    if ahead.knocked[0]:
        for k in range(frames):
            ahead.force[HAND, k] = ahead.knock[at + k]
        for i in range(COMPONENTS):
            add_forced(ahead.goes[i], body.moves[i, HAND], ahead.force[HAND])


@njit(inline="always")
def push_body(body, number: int, force) -> None:
    """A force of the bridge (D,) held over frame `number` of the block acts on where the body moves the bridge to."""
    for k in range(COMPONENTS):
        body.ahead.force[k, number] = force[k]
    for i in range(COMPONENTS):
        moves = body.moves[i]
        add_late_of_three(body.ahead.goes[i], moves[0], moves[1], moves[2], number, force)


@njit(**INNER)
def drive_body(body, frame: float, frames: int, at: int, out) -> None:
    """The modes pass the frames of a block, K at most, under its forces; out[:, at …] gets what they radiate."""
    knocked, per_frame = body.ahead.knocked[0] != 0, 1.0 / frame
    for channel in range(out.shape[0]):
        row = body.ahead.radiates[channel]
        for s in range(COMPONENTS + 1 if knocked else COMPONENTS):
            add_forced(row, body.sounds[channel, s], body.ahead.force[s])
        for k in range(frames):
            out[channel, at + k] = row[k] * per_frame
    n, rows, p, speed, parts = body.motion.p.size, body.rows, body.motion.p, body.motion.speed, body.parts
    force = body.ahead.force
    if frames < BLOCK:
        _step_body(body, frames)
    elif knocked:
        drive_listed_kicked(n, rows, p, speed, parts.size, parts, body.shape, force, body.struck, force[HAND])
    else:
        drive_listed(n, rows, p, speed, parts.size, parts, body.shape, force)


@njit(fastmath=FAST, **INNER)
def _step_body(body, frames: int) -> None:
    """The modes pass so many frames, one after the other."""
    rows, p, p_speed, shape, struck = body.rows, body.motion.p, body.motion.speed, body.shape, body.struck
    force = body.ahead.force
    for frame in range(frames):
        x, y, z, hand = force[0, frame], force[1, frame], force[2, frame], force[HAND, frame]
        for j in range(p.size):
            push = x * shape[0, j] + y * shape[1, j] + z * shape[2, j]
            before, speed = p[j], p_speed[j] + hand * struck[j]
            p[j] = rows[P11, j] * before + rows[P12, j] * speed + rows[KQ, j] * push
            p_speed[j] = rows[P21, j] * before + rows[P22, j] * speed + rows[KV, j] * push
