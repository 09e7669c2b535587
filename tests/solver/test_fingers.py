"""Blocks under a finger against the one-step kernel, from random scenes; responses, outputs, certificates, energy."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from synth.physics.excitation import pluck_weights
from synth.solver.block_rows import BLOCK
from synth.solver.certificates import forget
from synth.solver.fingers import advance_under_finger, fill_grip
from synth.solver.laws import EXACT_HOLD
from synth.solver.stepwise import finger_row, one_by_one
from tests.patience import compiling_s
from tests.solver.test_blocks import LAWS, Scene, same


class Touch:
    """A finger on a scene's string: drawing it up, holding it, or pressing it down on its contacts."""

    def __init__(self, scene, seed, steps, how):
        rng = np.random.default_rng(seed)
        modes = scene.omega.size
        x = rng.uniform(0.1, 0.9)
        self.weights = pluck_weights(1.0, x, min(0.02, x, 1.0 - x), modes)
        self.stiffness, self.resistance = 10.0 ** rng.uniform(3, 6), 10.0 ** rng.uniform(-2, 1)
        self.here = float(self.weights @ scene.q)
        bend = 0.5 - 0.5 * np.cos(np.pi * np.arange(steps + 1) / steps)
        amount = {"draw": 2e-3, "hold": 0.0, "press": -4e-3}[how]
        self.path = self.here + amount * bend

    def hold(self, string):
        """Take hold of a `Strung`."""
        state, modes = string.state, self.weights.size
        state.grip.weights[:modes] = self.weights
        row = state.finger[0]
        row["on"], row["stiffness"], row["resistance"] = 1, self.stiffness, self.resistance
        row["here"], row["push"] = self.here, 0.0
        return string


def finger_of(string):
    return np.array([string.state.finger[0]["here"], string.state.finger[0]["push"]])


def plain(scene, touch, steps, restitution):
    """(q, v, forces, finger state, outputs) of the one-step kernel: displacement at one point, velocity at another."""
    string = touch.hold(scene.strung(steps, restitution, 2, path=touch.path))
    coupling = string.state.grip.coupling
    string.state.finger[0]["own"] = finger_row(scene.law, scene.coef, scene.shapes, touch.weights, coupling)
    assert one_by_one(*string.addresses, 0, 0, steps) == 0
    return string.q, string.v, string.forces(steps), finger_of(string), string.out(steps)


def in_blocks(scene, touch, steps, restitution, certified, pieces=None):
    """The same of the block kernel, and the state."""
    outs, forces = [], []
    string = touch.hold(scene.strung(steps, restitution, 2, certified=certified, path=touch.path))
    fill_grip(*string.addresses, 1)
    forget(string.addresses[1])
    at = 0
    for some in pieces or [steps]:
        string.scratch.path[: some + 1] = touch.path[at : at + some + 1]
        assert under_finger(*string.addresses, some // BLOCK, some) == 0
        outs.append(string.out(some).copy())
        forces.append(string.forces(some).copy())
        at += some
    n = scene.omega.size
    assert not string.state.q[n:].any() and not string.state.v[n:].any()
    whole = np.concatenate(outs, axis=1)
    return (string.q, string.v, np.concatenate(forces), finger_of(string), whole), string.state


@njit
def under_finger(*arguments):
    """It has no wrapper for Python."""
    return advance_under_finger(*arguments)


NAMES = ("q", "v", "forces", "finger", "outputs")


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("contacts", [0, 1, 2, 5, 20])
@pytest.mark.parametrize("how", ["draw", "hold", "press"])
def test_any_law_is_the_one_step_kernel(law, contacts, how):
    """State, forces of every step, outputs and the finger itself, contacts struck and pressed at the same time."""
    touched = 0
    for seed in range(6):
        scene = Scene(seed, law, contacts, modes=[7, 8, 9, 40, 61, 130][seed])
        steps, restitution = 240, 0.6 * (seed % 2)
        touch = Touch(scene, seed, steps, how)
        expected = plain(scene, touch, steps, restitution)
        for certified in (False, True):
            got, _ = in_blocks(scene, touch, steps, restitution, certified)
            for name, a, b in zip(NAMES, got, expected, strict=True):
                if b.size:
                    whole = b if name != "v" else np.append(b, scene.v)  # the finger may take nearly all of it
                    np.testing.assert_allclose(
                        a, b, rtol=0, atol=1e-10 * np.abs(whole).max(), err_msg=f"{name}, seed {seed}, certified {certified}"
                    )
        touched += int((expected[2] > 0).any(axis=1).sum())
    assert contacts == 0 or touched > (0 if how == "draw" else 30), touched  # drawn, it leaves them


def test_the_run_may_be_cut_between_blocks():
    for seed in range(4):
        scene = Scene(seed, EXACT_HOLD, 5, modes=40)
        touch = Touch(scene, seed, 240, "press")
        whole, _ = in_blocks(scene, touch, 240, 0.0, True)
        pieces, _ = in_blocks(scene, touch, 240, 0.0, True, [8, 72, 16, 144])
        for a, b in zip(pieces, whole, strict=True):
            np.testing.assert_array_equal(a, b)


def test_a_contact_passed_over_is_never_inside():
    """Certificates under a finger are not guesses: the same contacts touch in the same steps, looked at or not."""
    passed_over, touched = 0, 0
    for seed in range(30):
        scene = Scene(seed, EXACT_HOLD, 12, modes=60, gap_m=2e-3, lossless=seed % 2 == 0)
        touch = Touch(scene, seed, 480, ("draw", "press")[seed % 2])
        _, _, forces, _, _ = plain(scene, touch, 480, 0.0)
        looks = []
        for certified in (False, True):
            got, state = in_blocks(scene, touch, 480, 0.0, certified)
            np.testing.assert_array_equal(got[2] > 0.0, forces > 0.0)
            same(got[2], forces, 1e-8, "forces") if forces.any() else None
            looks.append(int(state.certificates.looked.sum()))
        assert looks[0] == 12
        passed_over += 12 - looks[1]
        touched += int((forces > 0.0).any(axis=0).sum())
    assert passed_over > 60 and touched > 60, (passed_over, touched)


def test_a_string_at_rest_is_pressed_onto_contacts_that_were_certain_to_be_clear():
    """Free flight would never reach them: nothing but what is taken off the margins for the pushes brings them back."""
    for seed in range(6):
        scene = Scene(seed, EXACT_HOLD, 5, modes=40)
        scene.q, scene.v, scene.eta = 0.0 * scene.q, 0.0 * scene.v, np.full(5, -1e-4)
        touch = Touch(scene, seed, 120, "press")
        expected = plain(scene, touch, 120, 0.0)
        got, _ = in_blocks(scene, touch, 120, 0.0, True)
        assert expected[2].any()
        np.testing.assert_array_equal(got[2] > 0.0, expected[2] > 0.0)
        for name, a, b in zip(NAMES, got, expected, strict=True):
            same(a, b, 1e-10, f"{name}, seed {seed}")


@pytest.mark.parametrize("law", LAWS)
def test_responses_of_a_unit_push(law):
    """Against the steps themselves; a contact stays within its bound for as long as one cares to look."""
    scene = Scene(4, law, 3, modes=45)
    touch = Touch(scene, 4, BLOCK, "draw")
    string = touch.hold(scene.strung(BLOCK, outputs=2))
    fill_grip(*string.addresses, 1)
    grip = string.state.grip
    p11, p12, p21, p22, kq, kv = scene.coef
    q, v = kq * touch.weights, kv * touch.weights
    largest = np.zeros(3)
    for k in range(2000):
        x = q if law == EXACT_HOLD else v
        if k < BLOCK:
            at = BLOCK + k
            same(grip.own[0, at], touch.weights @ x, 1e-9, "own")
            same(grip.contacts[:, at], scene.shapes @ x, 1e-9, "contacts")
            same(grip.outputs[:, at], [scene.weights[0] @ q, scene.weights[1] @ v], 1e-9, "outputs")
        largest = np.maximum(largest, np.abs(scene.shapes @ q))
        q, v = p11 * q + p12 * v, p21 * q + p22 * v
    assert string.state.finger[0]["own"] == grip.own[0, BLOCK]
    for responses in (grip.own, grip.contacts, grip.outputs):
        assert not responses[:, :BLOCK].any()
    if law == EXACT_HOLD:
        assert (largest <= grip.far).all() and (largest > 0.1 * grip.far).all()


_LANES = """
import json
from synth.solver.lanes import LANES
from tests.solver.test_blocks import Scene
from tests.solver.test_fingers import Touch, in_blocks
out = []
for law in range(3):
    for contacts in (0, 1, 4):
        scene = Scene(2, law, contacts, 45)
        q, v, forces, finger, signal = in_blocks(scene, Touch(scene, 2, 160, "press"), 160, 0.5, law == 0)[0]
        out.append([*q, *v / scene.omega, *forces.ravel() / max([1e-300, *forces.ravel()]), finger[0], *signal[0]])
print(json.dumps([LANES, out]))
"""


@pytest.mark.slow
def test_every_vector_width_gives_the_same():
    """Two and four lanes, as other processors have them, against eight."""
    results = {}
    for lanes in ("2", "4", "8"):
        environment = {**os.environ, "JAWARI_LANES": lanes}
        top = Path(__file__).parents[2]
        done = subprocess.run(
            [sys.executable, "-c", _LANES], env=environment, cwd=top, capture_output=True, text=True, timeout=compiling_s()
        )
        assert done.returncode == 0, done.stderr
        width, results[lanes] = json.loads(done.stdout)
        assert width == int(lanes)
    for lanes in ("2", "4"):
        for got, expected in zip(results[lanes], results["8"], strict=True):
            same(np.array(got), np.array(expected), 1e-10, f"{lanes} lanes")
