"""The culling bound: a contact that is passed over is not touched within the horizon, whatever the motion."""

from __future__ import annotations

import math

import numpy as np

from synth.solver.kernels import advance, cull, make_work, no_finger
from synth.solver.laws import EXACT_HOLD, coefficients, contact_matrix

N, C, STEPS = 60, 12, 32
DT = 1.0 / 88_200.0
LENGTH, MU = 0.86, 6.7e-3


def scene(rng: np.random.Generator):
    j = np.arange(1, N + 1)
    omega = 2 * np.pi * 98.0 * j * np.sqrt(1 + 3.5e-5 * j**2)
    sigma = rng.uniform(0.1, 200.0, N)
    x = np.sort(rng.uniform(0.05, 0.6, C))
    shapes = math.sqrt(2 / LENGTH) * np.sin(np.outer(x, j) * np.pi / LENGTH)
    eta = -rng.uniform(0.3e-3, 4e-3, C)
    q = rng.normal(size=N) * 2e-3 / j**1.5
    v = omega * rng.normal(size=N) * 2e-3 / j**1.5
    return omega, sigma, shapes, eta, q, v


def test_what_is_passed_over_stays_clear() -> None:
    rng = np.random.default_rng(3)
    passed_over = kept = 0
    for _ in range(300):
        omega, sigma, shapes, eta, q, v = scene(rng)
        scale = 10 ** rng.uniform(-1.5, 0.5)
        q, v = scale * q, scale * v
        near = np.ones(C, np.uint8)
        count = cull(shapes, eta, omega, q, v, STEPS * DT, np.ones(C, np.uint8), np.zeros(N), near)
        assert count == near.sum()
        coef = coefficients(EXACT_HOLD, omega, sigma, MU, DT)
        lowest = np.full(C, np.inf)
        for _ in range(STEPS):
            q, v = coef[0] * q + coef[1] * v, coef[2] * q + coef[3] * v
            lowest = np.minimum(lowest, shapes @ q)
        assert np.all(lowest[near == 0] > eta[near == 0])
        passed_over += int((near == 0).sum())
        kept += int(near.sum())
    assert passed_over > 300 and kept > 300  # the bound is neither blind nor idle


def test_contacts_already_out_of_reach_are_not_looked_at() -> None:
    omega, _, shapes, eta, q, v = scene(np.random.default_rng(4))
    watch, near = np.zeros(C, np.uint8), np.ones(C, np.uint8)
    assert cull(shapes, eta + 1.0, omega, q, v, STEPS * DT, watch, np.zeros(N), near) == 0
    assert near.sum() == 0


def test_culling_changes_no_bit_of_the_motion() -> None:
    rng = np.random.default_rng(5)
    touched = 0
    for _ in range(40):
        omega, sigma, shapes, eta, q, v = scene(rng)
        coef = coefficients(EXACT_HOLD, omega, sigma, MU, DT)
        matrix = np.zeros((C, C))
        contact_matrix(EXACT_HOLD, coef, shapes, np.zeros((C, C)), matrix)
        ends = []
        for culling in (False, True):
            state = q.copy(), v.copy()
            near = np.ones(C, np.uint8)
            if culling:
                cull(shapes, eta, omega, *state, STEPS * DT, np.ones(C, np.uint8), np.zeros(N), near)
            force = np.zeros((STEPS, C))
            out = np.zeros((STEPS, 0))
            advance(
                EXACT_HOLD, STEPS, DT, 0.0, coef, shapes, eta, matrix, *state, np.zeros(C), np.zeros(C), np.zeros(C),
                no_finger(N, C), near, np.zeros((0, N)), np.zeros((0, N)), out, out, force, np.zeros((0, 0)), make_work(C),
            )  # fmt: skip
            ends.append((*state, force))
        for plain, culled in zip(*ends, strict=True):
            np.testing.assert_array_equal(plain, culled)
        touched += bool(ends[0][2].any())
    assert touched > 5
