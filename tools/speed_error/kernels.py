"""The kernels whose cost is measured: those by which the program runs a scene of one of its laws."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from synth.native.arrays import aligned
from synth.scene import Scene
from synth.solver import driver
from synth.solver.blocks import BLOCK, CERTIFY_FROM, advance_blocks, forget, press_blocks
from synth.solver.kernels import advance, no_finger
from synth.solver.laws import EXACT_HOLD
from synth.solver.substeps import advance_substepped

#: of one call: as many as a large block of an engine has
STEPS = 1024


def kernel_of(scene: Scene) -> Callable[[], np.ndarray]:
    """What takes the next `STEPS` steps of a scene and returns its first output after each, (STEPS,), valid until then.

    Blocks of K steps: `press_blocks` over one point under exact-hold, else `advance_blocks`, with certificates where the
    driver has them; over more points than there is a table of responses for, `advance`. Sub-steps over one point are
    blocks of parts Δt/K with an output after every part, over several `advance_substepped`. The scene has no finger, its
    obstacle and its tension stay.
    """
    m = scene.model
    q, v = scene.initial()
    q, force, _ = driver.static_contact(m, q)
    state = driver.start_run(m, q, v, force, STEPS, 1, False, scene.case.scheme.start == "published")
    if m.eta.size == 1 and m.law == EXACT_HOLD:
        return _pressing(m, state)
    if m.sub.parts > 1:
        return _substepped(m, state)
    return _in_blocks(m, state) if m.block.rows.size else _one_by_one(m, state)


def _pressing(m: driver.Model, state: driver.Run) -> Callable[[], np.ndarray]:
    block, parts, n = m.block, m.sub.parts, state.whole_q.size
    out, spare = aligned((1, STEPS * parts)), aligned((2, BLOCK))

    def take() -> np.ndarray:
        press_blocks(
            STEPS * parts // BLOCK, n, block.rows, block.shapes[0], m.eta[0], block.lags[0, 0], state.whole_q,
            state.whole_v, block.weights[:1], 1, block.out_lags[:1], out, spare[0], spare[1],
            out[0, :0], out[0, :0],
        )  # fmt: skip
        return out[0, parts - 1 :: parts]

    return take


def _in_blocks(m: driver.Model, state: driver.Run) -> Callable[[], np.ndarray]:
    block, contacts = m.block, m.eta.size
    out, forces, no_record = aligned((1, STEPS)), np.zeros((STEPS, contacts)), np.zeros((0, contacts))
    certified = int(contacts >= CERTIFY_FROM)
    forget(state.block_work)

    def take() -> np.ndarray:
        advance_blocks(
            STEPS // BLOCK, m.law, state.whole_q.size, m.dt, m.restitution, block.rows, m.omega, block.shapes, m.eta,
            block.lags, certified, state.whole_q, state.whole_v, state.u_contact, state.v_contact, block.weights[:1], 1,
            block.out_lags[:1], out, forces, no_record, state.block_work,
        )  # fmt: skip
        return out[0]

    return take


def _substepped(m: driver.Model, state: driver.Run) -> Callable[[], np.ndarray]:
    none, out, no_out = np.zeros((0, state.q.size)), np.zeros((STEPS, 1)), np.zeros((STEPS, 0))
    finger = no_finger(state.q.size, m.eta.size)

    def take() -> np.ndarray:
        driver.certify_watch(m, state)
        advance_substepped(
            STEPS, m.dt, m.sub, m.coef, m.shapes, m.eta, state.q, state.v, state.u_contact, state.force, finger, state.watch,
            state.counts[driver.DIVIDE :], m.out_shapes[:1], none, out, no_out, state.records, state.scratch,
            state.v_contact, state.parts, none, state.work,
        )  # fmt: skip
        return out[:, 0]

    return take


def _one_by_one(m: driver.Model, state: driver.Run) -> Callable[[], np.ndarray]:
    none, out, no_out = np.zeros((0, state.q.size)), np.zeros((STEPS, 1)), np.zeros((STEPS, 0))
    finger, no_record = no_finger(state.q.size, m.eta.size), np.zeros((0, 0))

    def take() -> np.ndarray:
        driver.certify_watch(m, state)
        advance(
            m.law, STEPS, m.dt, m.restitution, m.coef, m.shapes, m.eta, m.g, state.q, state.v, state.u_contact,
            state.v_contact, state.force, finger, state.watch, m.out_shapes[:1], none, out, no_out, state.records,
            no_record, state.work,
        )  # fmt: skip
        return out[:, 0]

    return take
