"""Strings over a board, in blocks: against the wall's own kernel and the same step by step; energy, what is certified."""

from __future__ import annotations

import math

import numpy as np
import pytest

from synth.native.arrays import allocate
from synth.native.views import table
from synth.physics.excitation import pluck_weights
from synth.solver import wall
from synth.solver.block_rows import BLOCK
from synth.solver.board import advance_on_board
from synth.solver.board_table import (
    HOLDING,
    SPEAKING,
    STEPPED,
    STRUCK,
    Board,
    BoardRoom,
    board_sizes,
    board_tables,
    clear_of_board,
    fill_slack,
    leave_board,
)
from synth.solver.fingers import fill_grip
from synth.solver.laws import EXACT_HOLD, coefficients
from synth.solver.problem import Problem
from synth.solver.stringmodel import FREE, StringModes, StringOutputs, Strung, make_string, no_contacts

MU = 6.7e-3


class Scene:
    """A bass string over a board of N nodes, thrown at it."""

    def __init__(self, seed: int, modes: int = 63, restitution: float = 0.7, lossy: bool = True) -> None:
        rng = np.random.default_rng(seed)
        self.rng, self.modes, self.restitution = rng, modes, restitution
        self.length = float(rng.uniform(0.3, 0.9))
        j = np.arange(1, modes + 1)
        self.omega = 2.0 * math.pi * rng.uniform(60.0, 200.0) * j * np.sqrt(1.0 + 5e-5 * j**2)
        self.sigma = (rng.uniform(10.0, 30.0) + 1e-3 * self.omega) if lossy else np.zeros(modes)
        self.dt = float(rng.uniform(0.3, 2.5) / self.omega[-1])
        self.stiffness = MU * (rng.uniform(0.2, 1.5) / self.dt) ** 2
        x = np.arange(1, modes + 1) * self.length / (modes + 1)
        self.eta = -(2e-5 + 2e-3 * x + 3e-4 * rng.random())
        self.beyond = x > 0.75 * self.length
        self.eta[self.beyond] = -1e3
        self.q = rng.normal(size=modes) * 4e-4 / j**1.7
        self.v = rng.normal(size=modes) * self.omega * 3e-4 / j**1.8
        self.v[0] = -(2e-3 + abs(self.v[0] / self.omega[0])) * self.omega[0]  # down
        while (self.shapes @ self.q < self.eta).any():
            self.q *= 0.8

    @property
    def shapes(self) -> np.ndarray:
        i = np.arange(1, self.modes + 1)
        return math.sqrt(2.0 / self.length) * np.sin(np.pi * np.outer(i, i) / (self.modes + 1))

    @property
    def period(self) -> int:
        """Steps of about three quarters of a period of the lowest mode, whole blocks: down on to the board and up again."""
        return math.ceil(1.5 * math.pi / self.omega[0] / self.dt / BLOCK) * BLOCK

    def board(self) -> Board:
        made = allocate(
            Board, board_sizes(self.modes + 1), **board_tables(self.modes + 1),
            kappa=wall.spring_rate(self.stiffness, MU, self.dt), restitution=self.restitution,
        )  # fmt: skip
        made.eta[:] = self.eta
        made.numbers[SPEAKING] = self.length
        return made

    def string(self, steps: int, path: np.ndarray | None = None) -> Strung:
        weights = np.array([self.shapes[self.modes // 3], self.shapes[self.modes // 5]])
        coef = coefficients(EXACT_HOLD, self.omega, self.sigma, MU, self.dt)
        model = make_string(
            EXACT_HOLD,
            self.dt,
            StringModes(MU, self.omega, self.sigma),
            coef,
            no_contacts(self.modes),
            StringOutputs(weights, on_q=1),
        )
        return Strung(model, self.q, self.v, steps, path=path)


class Run:
    """A string and its board, advanced in calls of so many steps."""

    def __init__(self, scene: Scene, steps: int, touch: dict | None = None) -> None:
        self.scene, self.board = scene, scene.board()
        self.room = allocate(BoardRoom, board_sizes(scene.modes + 1))
        self.table = table(self.board, self.room)
        self.string = scene.string(steps, None if touch is None else np.zeros(steps + 1))
        self.touch, self.made = touch, 0
        weights = self.string.model.outputs.weights
        self.board.weights[:] = weights
        fill_slack(self.table.ctypes.data, scene.omega, scene.sigma, MU, scene.dt)
        if touch is not None:
            state = self.string.state
            state.grip.weights[: scene.modes] = touch["weights"]
            row = state.finger[0]
            row["on"], row["stiffness"], row["resistance"] = 1, touch["stiffness"], touch["resistance"]
            row["here"] = touch["weights"] @ scene.q
            fill_grip(*self.string.addresses, 1)

    def advance(self, steps: int) -> np.ndarray:
        """(2, steps) outputs."""
        if self.touch is not None:
            self.string.scratch.path[: steps + 1] = self.touch["path"][self.made : self.made + steps + 1]
        assert advance_on_board(*self.string.addresses, self.table.ctypes.data, steps) == 0
        self.made += steps
        return self.string.out(steps).copy()

    @property
    def energy(self) -> float:
        """Of the string, its nodes' accounts and the finger's spring [J]."""
        scene = self.scene
        string = 0.5 * MU * float(np.sum(self.string.v**2 + (scene.omega * self.string.q) ** 2))
        held = MU * scene.length / (scene.modes + 1) * float(self.board.account.sum())
        spring = 0.0
        if self.touch is not None:
            row = self.string.state.finger[0]
            spring = 0.5 * float(row["stiffness"]) * float(row["here"] - self.touch["path"][self.made]) ** 2
        return string + held + spring


def finger(scene: Scene, steps: int, amount: float) -> dict:
    """A finger that takes hold of a scene's string and draws it by `amount` [m]."""
    place = float(scene.rng.uniform(0.2, 0.8)) * scene.length
    weights = pluck_weights(scene.length, place, 0.02, scene.modes)
    way = 0.5 - 0.5 * np.cos(np.pi * np.arange(steps + 1) / steps)
    return {
        "weights": weights,
        "stiffness": 10.0 ** scene.rng.uniform(3.5, 5.0),
        "resistance": 10.0 ** scene.rng.uniform(-1.0, 0.5),
        "path": float(weights @ scene.q) + amount * way,
    }


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("modes", [31, 63, 127])
def test_it_is_the_wall_of_simulate(seed: int, modes: int) -> None:
    scene = Scene(seed, modes)
    steps = scene.period
    run = Run(scene, steps)
    mine = run.advance(steps)[0]
    on = ~scene.beyond
    x = np.arange(1, modes + 1) * scene.length / (modes + 1)
    heard = scene.shapes[modes // 3 : modes // 3 + 1]
    model = wall.make_wall(
        scene.omega, scene.sigma, MU, scene.dt, scene.length, x[on], scene.eta[on], heard, scene.stiffness, scene.restitution
    )
    problem = Problem(
        scene.dt, steps, 1, MU, scene.omega, scene.sigma, scene.shapes[on], scene.eta[on], heard, scene.q, scene.v
    )
    other = wall.start_run(problem, model, ledger=False, contact_rows=False)
    wall.advance(model, other, steps, 1)
    assert run.board.counts[STRUCK] == other.results.counts[wall.TOUCHED] > 0
    assert np.abs(mine - other.results.u[1:, 0]).max() < 1e-9 * np.abs(mine).max()
    assert np.abs(run.board.account[on] - other.account).max() < 1e-9 * max(1e-12, other.account.max())


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("amount", [None, 2e-3, -2e-3])
def test_blocks_are_steps(seed: int, amount: float | None) -> None:
    """Calls of fewer steps than a block has go step by step, looked at everywhere."""
    scene = Scene(seed)
    steps = scene.period
    touch = None if amount is None else finger(scene, steps, amount)
    whole, single = Run(scene, steps, touch), Run(scene, steps, touch)
    out = whole.advance(steps)
    one = np.concatenate([single.advance(1) for _ in range(steps)], axis=1)
    assert np.abs(out - one).max(axis=1) == pytest.approx(0.0, abs=1e-9 * np.abs(one).max())
    assert whole.board.counts[STRUCK] == single.board.counts[STRUCK]
    assert touch is not None or whole.board.counts[STEPPED] < steps // BLOCK  # some blocks were flown through
    if touch is not None:
        rows = [run.string.state.finger[0] for run in (whole, single)]
        assert float(rows[0]["push"]) == pytest.approx(float(rows[1]["push"]), rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_a_finger_that_draws_a_string_at_rest_goes_in_blocks(seed: int) -> None:
    scene = Scene(seed)
    scene.q[:], scene.v[:] = 0.0, 0.0
    steps = 4 * scene.period
    touch = finger(scene, steps, 2e-3)
    whole, single = Run(scene, steps, touch), Run(scene, steps, touch)
    out = whole.advance(steps)
    one = np.concatenate([single.advance(1) for _ in range(steps)], axis=1)
    assert np.abs(out - one).max() < 1e-9 * np.abs(one).max()
    assert whole.board.counts[STEPPED] < 0.3 * steps // BLOCK


def test_a_block_under_a_finger_is_stepped_for_what_touches_alone() -> None:
    """Nodes near the board are followed through the block, and the whole string is not looked at for them."""
    stepped = blocks = 0
    for seed in range(8):
        scene = Scene(seed)
        steps = scene.period
        run = Run(scene, steps, finger(scene, steps, 2e-3))
        run.advance(steps)
        stepped += int(run.board.counts[STEPPED])
        blocks += steps // BLOCK
    assert stepped < 0.25 * blocks


def test_the_scenes_touch() -> None:
    """What the comparisons above compare: most scenes strike, under a finger too."""
    struck = {amount: 0 for amount in (None, 2e-3, -2e-3)}
    for amount in struck:
        for seed in range(8):
            scene = Scene(seed)
            steps = scene.period
            run = Run(scene, steps, None if amount is None else finger(scene, steps, amount))
            run.advance(steps)
            struck[amount] += int(run.board.counts[STRUCK] > 0)
    assert min(struck.values()) >= 6


@pytest.mark.parametrize("cuts", [[8, 72, 240], [13, 1, 6, 300], [319, 1]])
def test_calls_may_be_of_any_length(cuts: list[int]) -> None:
    scene = Scene(3)
    whole, parts = Run(scene, 320), Run(scene, 320)
    out = whole.advance(320)
    pieces = np.concatenate([parts.advance(count) for count in cuts], axis=1)
    assert np.abs(out - pieces).max() < 1e-9 * np.abs(out).max()


@pytest.mark.parametrize("restitution", [0.0, 0.7, 1.0])
@pytest.mark.parametrize("seed", range(20))
def test_no_step_gains_energy(seed: int, restitution: float) -> None:
    scene = Scene(seed, restitution=restitution, lossy=seed % 2 == 0)
    run = Run(scene, 8)
    before, start = run.energy, run.energy
    for _ in range(2 * scene.period):
        run.advance(1)
        after = run.energy
        assert after <= before + 1e-12 * start
        before = after
    assert run.board.counts[STRUCK] > 0


@pytest.mark.parametrize("amount", [2e-3, -3e-3, 0.0])
@pytest.mark.parametrize("seed", range(10))
def test_a_finger_brings_no_more_than_its_work(seed: int, amount: float) -> None:
    """Its spring's end moves on by Δpath against the force at the step's end."""
    scene, steps = Scene(seed), 400
    touch = finger(scene, steps, amount)
    run = Run(scene, steps, touch)
    before = run.energy
    scale = before
    for step in range(steps):
        was = run.string.state.finger[0]["here"]
        run.advance(1)
        row = run.string.state.finger[0]
        after, moved = run.energy, touch["path"][step + 1] - touch["path"][step]
        work = float(row["push"]) * moved
        scale = max(scale, after)
        assert after <= before + work + 1e-11 * scale, (step, was)
        before = after


@pytest.mark.parametrize("seed", range(20))
def test_a_string_that_is_free_touches_nothing(seed: int) -> None:
    """The certificate for ever holds, and the string soon has it."""
    scene = Scene(seed)
    run = Run(scene, 8 * BLOCK)
    amplitude = np.zeros(scene.modes)
    for _ in range(4000):
        s = run.string
        d = np.sqrt(np.maximum(scene.omega**2 - scene.sigma**2, 1e-3))
        amplitude[:] = np.sqrt(s.q**2 + ((s.v + scene.sigma * s.q) / d) ** 2)
        if clear_of_board(run.table.ctypes.data, amplitude):
            break
        run.advance(8 * BLOCK)
    else:
        pytest.fail("never free")
    struck = int(run.board.counts[STRUCK])
    assert run.board.counts[HOLDING] == 0
    free, looked = Run(scene, 8 * BLOCK), run
    free.string.q[:], free.string.v[:] = run.string.q, run.string.v
    free.string.state.counts[FREE] = 1
    for _ in range(50):
        a, b = free.advance(8 * BLOCK), looked.advance(8 * BLOCK)
        assert np.abs(a - b).max() < 1e-12 * max(1e-6, np.abs(a).max())
    assert int(looked.board.counts[STRUCK]) == struck


def test_a_board_is_left() -> None:
    scene = Scene(1)
    run = Run(scene, 8)
    while run.board.counts[HOLDING] == 0:
        run.advance(1)
    assert run.board.account.max() > 0.0
    leave_board(run.table.ctypes.data)
    assert run.board.counts[HOLDING] == 0 and run.board.account.max() == 0.0 and run.board.touching.max() == 0
