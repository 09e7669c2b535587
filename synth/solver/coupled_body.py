"""The body of coupled strings over a block of frames: what it moves the bridge to and radiates, as rows of K = BLOCK frames.

As a block begins, one look at the modes gives both as they are without a force, rows `free` and `radiates`. What else the
rows hold is sums of a few numbers: a force of one newton held over a frame, in each component of the bridge, does to each
row from that frame on what `moves` and `sounds` say, and so does a push of one newton by the hand, a kick at the frame's
start. A frame adds its force to `goes`, from which the next ones take their place (`push_body`). The modes themselves pass
the frames as the block ends, all at once (`drive_body`): until then nothing of the body has changed.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from synth.solver.block_rows import BLOCK, KQ, KV, P11, P12, P21, P22
from synth.solver.coupling import COMPONENTS, HAND, coupling_at, in_components
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


def body_fields(
    steps: np.ndarray, shape: np.ndarray, radiation: np.ndarray, mass: np.ndarray, omega: np.ndarray, struck: np.ndarray
) -> dict[str, np.ndarray]:
    """Fields of Coupling that are the body's: M modes as padded(M), those behind them at rest for good.

    steps (6, M) coefficients of a frame, shape (D, M), radiation (channels, M), mass and omega (M,); struck (M,) what the
    hand's push of one newton for a frame changes their velocities by.
    """
    modes = padded(mass.size)
    given = {
        "body": make_rows(steps),
        "shape": padded_rows(in_components(shape, 0), modes),
        "radiation": padded_rows(radiation, modes),
        "body_mass": padded_rows(mass, modes),
        "body_omega": padded_rows(omega, modes),
        "struck": padded_rows(struck, modes),
    }
    rows, shapes = given["body"], given["shape"]
    moves = np.zeros((COMPONENTS, COMPONENTS + 1, 2 * BLOCK))
    sounds = np.zeros((radiation.shape[0], COMPONENTS + 1, 2 * BLOCK))
    x = np.vstack([rows[KQ] * shapes, rows[P12] * given["struck"]])
    v = np.vstack([rows[KV] * shapes, rows[P22] * given["struck"]])
    before = np.zeros_like(v)
    for k in range(BLOCK, 2 * BLOCK):
        moves[:, :, k] = shapes @ x.T
        sounds[:, :, k] = given["radiation"] @ (v - before).T
        before = v
        x, v = rows[P11] * x + rows[P12] * v, rows[P21] * x + rows[P22] * v
    gamma = np.ascontiguousarray(moves[:, :COMPONENTS, BLOCK])
    parts = np.arange(max(1, shape.shape[0]))
    return given | {"gamma": gamma, "moves": moves, "sounds": sounds, "parts": parts}


def body_sizes(fields: dict[str, np.ndarray]) -> dict[str, int]:
    """Extents of Coupling that go with them."""
    return {"body": fields["struck"].size, "parts": fields["parts"].size, "channels": fields["radiation"].shape[0]}


@njit(**INNER)
def look_at_body(coupling: int) -> None:
    """Coupling.free and radiates, of the K frames ahead."""
    c = coupling_at(coupling)
    n, shape, free = c.p.size, c.shape, c.free
    project_qqq(n, c.body, c.p, c.p_speed, shape[0], shape[1], shape[2], free[0], free[1], free[2])
    for channel in range(c.radiation.shape[0]):
        project_a(n, c.body, c.p, c.p_speed, c.radiation[channel], c.radiates[channel])


@njit(**INNER)
def begin_body(coupling: int, frames: int, at: int) -> None:
    """Coupling.goes as a block of so many frames begins, frame `at` of the call on: no force yet but the hand's."""
    c = coupling_at(coupling)
    for i in range(COMPONENTS):
        for k in range(BLOCK):
            c.goes[i, k] = c.free[i, k]
    for s in range(COMPONENTS + 1):
        for k in range(BLOCK):
            c.force[s, k] = 0.0
    if c.knocked[0]:
        for k in range(frames):
            c.force[HAND, k] = c.knock[at + k]
        for i in range(COMPONENTS):
            add_forced(c.goes[i], c.moves[i, HAND], c.force[HAND])


@njit(inline="always")
def push_body(c, number: int, force) -> None:
    """A force of the bridge (D,) held over frame `number` of the block acts on where the body moves the bridge to."""
    for k in range(COMPONENTS):
        c.force[k, number] = force[k]
    for i in range(COMPONENTS):
        moves = c.moves[i]
        add_late_of_three(c.goes[i], moves[0], moves[1], moves[2], number, force)


@njit(**INNER)
def drive_body(coupling: int, frames: int, at: int, out) -> None:
    """The modes pass the frames of a block, K or one, under its forces; out[:, at …] gets what they radiate."""
    c = coupling_at(coupling)
    knocked, per_frame = c.knocked[0] != 0, 1.0 / c.frame
    for channel in range(out.shape[0]):
        row = c.radiates[channel]
        for s in range(COMPONENTS + 1 if knocked else COMPONENTS):
            add_forced(row, c.sounds[channel, s], c.force[s])
        for k in range(frames):
            out[channel, at + k] = row[k] * per_frame
    if frames < BLOCK:
        _step_body(coupling)
    elif knocked:
        drive_listed_kicked(
            c.p.size, c.body, c.p, c.p_speed, c.parts.size, c.parts, c.shape, c.force, c.struck, c.force[HAND]
        )
    else:
        drive_listed(c.p.size, c.body, c.p, c.p_speed, c.parts.size, c.parts, c.shape, c.force)


@njit(fastmath=FAST, **INNER)
def _step_body(coupling: int) -> None:
    """The modes pass one frame."""
    c = coupling_at(coupling)
    body, p, p_speed, shape, struck = c.body, c.p, c.p_speed, c.shape, c.struck
    x, y, z, hand = c.force[0, 0], c.force[1, 0], c.force[2, 0], c.force[HAND, 0]
    for j in range(p.size):
        push = x * shape[0, j] + y * shape[1, j] + z * shape[2, j]
        before, speed = p[j], p_speed[j] + hand * struck[j]
        p[j] = body[P11, j] * before + body[P12, j] * speed + body[KQ, j] * push
        p_speed[j] = body[P21, j] * before + body[P22, j] * speed + body[KV, j] * push
