"""Responses that are filled when a contact first presses: the same numbers as those that are filled at once."""

import numpy as np
import pytest

from synth.solver.block_rows import BLOCK
from synth.solver.blocks import advance_blocks
from synth.solver.due_responses import ROW_DUE, fill_all_rows, fill_contact_matrix, fill_due, fill_row, put_off
from synth.solver.fingers import fill_grip
from synth.solver.laws import EXACT_HOLD
from synth.solver.step import advance
from synth.solver.stringmodel import Strung, with_outputs
from tests.solver.test_blocks import Scene
from tests.solver.test_fingers import Touch, under_finger

WRONG = 1e30


def made(scene: Scene, outputs: int, steps: int = 240, certified: bool = False, **more) -> Strung:
    return scene.strung(steps, 0.0, outputs, certified=certified, **more)


def wait(string: Strung, relief: float = 0.0) -> Strung:
    """The matrix and all responses are wrong until they are filled."""
    string.model.contacts.matrix[:] = WRONG
    string.model.contacts.lags[:] = WRONG
    string.model.outputs.lags[:] = WRONG
    model, state, _ = string.addresses
    put_off(model, state, relief)
    return string


@pytest.mark.parametrize(("contacts", "modes"), [(2, 7), (5, 40), (6, 131)])
def test_rows_of_the_matrix_are_those_filled_at_once(contacts: int, modes: int) -> None:
    scene = Scene(contacts, EXACT_HOLD, contacts, modes)
    at_once = made(scene, 2)
    assert at_once.model.contacts.residual.any()
    fill_contact_matrix(at_once.addresses[0], 0.25)
    wanted = at_once.model.contacts.matrix
    for order in range(4):
        string = wait(made(scene, 2), 0.25)
        model, state, _ = string.addresses
        np.testing.assert_allclose(string.model.contacts.matrix.diagonal(), wanted.diagonal(), rtol=1e-13)
        for number, c in enumerate(np.random.default_rng(order).permutation(contacts)[:-1]):
            assert np.count_nonzero(string.state.due == ROW_DUE) == contacts - number
            fill_row(model, state, c)
            for table in (string.model.contacts.matrix, string.model.contacts.lags[:, :, BLOCK]):
                np.testing.assert_allclose(table[c], wanted[c], rtol=1e-13)
                np.testing.assert_array_equal(table[c], table[:, c])
        fill_all_rows(model, state)
        np.testing.assert_allclose(string.model.contacts.matrix, wanted, rtol=1e-13)
        assert not (string.state.due == ROW_DUE).any()


@pytest.mark.parametrize("steps", [5, 29])
def test_steps_that_are_no_whole_block_have_the_whole_matrix(steps: int) -> None:
    pressed = 0
    for seed in range(4):
        scene = Scene(seed, EXACT_HOLD, 5, 40)
        at_once, string = made(scene, 2, steps), made(scene, 2, steps)
        for _ in range(240 // steps):
            wait(string)
            for each in (at_once, string):
                assert advance(*each.addresses, steps, 0) == 0
            pressed += int(np.count_nonzero(at_once.forces(steps)))
            np.testing.assert_array_equal(string.forces(steps) > 0.0, at_once.forces(steps) > 0.0)
            np.testing.assert_allclose(string.out(steps), at_once.out(steps), atol=1e-10 * np.abs(at_once.out(steps)).max())
    assert pressed > 30


@pytest.mark.parametrize(("contacts", "modes"), [(2, 7), (5, 40), (6, 131)])
def test_in_any_order_they_are_those_filled_at_once(contacts, modes):
    scene = Scene(contacts, EXACT_HOLD, contacts, modes)
    for order in range(4):
        at_once, string = made(scene, 2), wait(made(scene, 2))
        left = set(range(contacts))
        for c in np.random.default_rng(order).permutation(contacts):
            assert np.array_equal(np.flatnonzero(string.state.due), sorted(left))
            fill_due(*string.addresses, c)
            left.remove(c)
            mine, theirs = string.model.contacts.lags, at_once.model.contacts.lags
            np.testing.assert_array_equal(string.model.outputs.lags[:, c], at_once.model.outputs.lags[:, c])
            np.testing.assert_array_equal(mine[:, c, BLOCK + 1 :], theirs[:, c, BLOCK + 1 :])
            np.testing.assert_allclose(mine[:, c, BLOCK], theirs[:, c, BLOCK], rtol=1e-13)
            np.testing.assert_array_equal(mine[c], mine[:, c])
        assert not string.state.due.any()


def test_only_outputs_in_use_are_filled():
    string = wait(made(Scene(1, EXACT_HOLD, 3, 40), 2))
    only_v = with_outputs(string.model, 1, 1, 0)
    other = Strung(only_v, string.q, string.v, 8)
    other.state.due[:] = 1
    fill_due(*other.addresses, 1)
    assert (string.model.outputs.lags[0, 1] == WRONG).all()
    assert (string.model.outputs.lags[1, 1] != WRONG).all()


@pytest.mark.parametrize("fingered", [False, True])
@pytest.mark.parametrize("certified", [False, True])
@pytest.mark.parametrize("contacts", [2, 5, 20])
def test_a_string_moves_as_with_all_of_them(contacts, certified, fingered):
    steps, left, pressed = 240, 0, 0
    for seed in range(4):
        scene = Scene(seed, EXACT_HOLD, contacts, 40)
        touch = Touch(scene, seed, steps, "press")
        sides = []
        for late in (None, wait):
            string = made(scene, 2, steps, certified, path=touch.path)
            if late:
                late(string)
            model, state, scratch = string.addresses
            if fingered:
                touch.hold(string)
                fill_grip(model, state, scratch, 1)
                assert under_finger(model, state, scratch, steps // 8, steps) == 0
            else:
                assert advance_blocks(model, state, scratch, steps // 8, steps) == 0
            sides.append((string.q.copy(), string.v.copy(), string.forces(steps).copy(), string.out(steps).copy()))
        left += int(string.state.due.sum())
        pressed += int((string.forces(steps) > 0.0).any(axis=0).sum())
        for mine, all_at_once in zip(sides[1], sides[0], strict=True):
            np.testing.assert_allclose(mine, all_at_once, atol=1e-9 * np.abs(all_at_once).max())
    assert pressed > 0
    assert contacts < 20 or left > 0, "all contacts have pressed: nothing was left to be filled later"
