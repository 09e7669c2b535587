"""Linear complementarity: textbook problems, random ones, degenerate ones; every answer judged by its residual.

Multipliers are never compared where they are not unique: z is, where A is definite; A z is, always.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from synth.solver.lcp import NOT_SOLVED, SOLVED, natural_residual, solve
from tests.oracles.steps import lemke


def run(a, b, enabled=None, guess=None):
    """`solve` with fresh work space."""
    n = b.size
    z = np.full(n, np.nan)
    active = np.zeros(n, np.uint8) if guess is None else guess.copy()
    enabled = np.ones(n, np.uint8) if enabled is None else enabled
    status = solve(np.ascontiguousarray(a), b, enabled, active, z, np.zeros((n, n)), np.zeros(n, np.int64))
    return status, z, active


def compliant(rng, n, modes):
    """A Gram matrix as contacts make it: S diag(k) Sᵀ with falling k, semidefinite where n > modes."""
    j = np.arange(1, modes + 1)
    shapes = np.sin(np.pi * np.outer(np.sort(rng.uniform(0.02, 0.98, n)), j))
    return (shapes / j**1.5) @ shapes.T


def assert_solves(a, b, z, relative=1e-10):
    assert np.all(z >= 0.0)
    assert natural_residual(a, b, z) <= relative * max(np.abs(b).max(), 1e-300)


# --- textbook -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("n", [2, 3, 5, 8, 12])
def test_murty(n):
    """Murty's exponential example for pivoting methods, made symmetric, with the solution e_1.

    M = 1 on the diagonal, 2 below it (Murty 1978); its symmetric product M Mᵀ is what a contact problem can hold.
    """
    m = np.eye(n) + 2.0 * np.tri(n, k=-1)
    a = m @ m.T
    z_expected = np.zeros(n)
    z_expected[0] = 1.0
    b = -a @ z_expected
    b[1:] += np.arange(1, n)  # w is strictly positive where z is 0
    status, z, active = run(a, b)
    assert status == SOLVED
    np.testing.assert_allclose(z, z_expected, atol=1e-12)
    np.testing.assert_array_equal(active, z_expected > 0)


def test_chandrasekaran():
    """A Z-matrix (second differences, b < 0 in the middle): one principal pivot after the other, all upwards."""
    n = 15
    a = 2.0 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)
    b = np.ones(n)
    b[5:9] = -3.0
    status, z, _ = run(a, b)
    assert status == SOLVED
    assert_solves(a, b, z)
    # the string pressed by a constant load over a flat floor: the least element of the feasible set
    np.testing.assert_allclose(z, lemke(a, b), atol=1e-12)


def test_cycle_of_block_pivoting_is_left():
    """A 3 × 3 P-matrix-like definite problem on which changing all infeasible indices at once cycles (Kostreva 1978)."""
    found = 0
    rng = np.random.default_rng(0)
    for _ in range(4000):
        root = rng.normal(size=(4, 4))
        a = root @ root.T + 1e-3 * np.eye(4)
        b = rng.normal(size=4)
        active = np.zeros(4, bool)
        seen = set()
        while tuple(active) not in seen:  # the plain rule, to find problems that it fails on
            seen.add(tuple(active))
            z = np.zeros(4)
            z[active] = np.linalg.solve(a[np.ix_(active, active)], -b[active]) if active.any() else 0.0
            w = a @ z + b
            wrong = np.where(active, z < 0, w < -1e-12)
            if not wrong.any():
                break
            active = active ^ wrong
        else:
            found += 1
            status, z, _ = run(a, b)
            assert status == SOLVED
            assert_solves(a, b, z)
    assert found > 0, "no problem cycled: the test shows nothing"


def test_nothing_to_do():
    for b in (np.array([0.0, 1.0]), np.array([1e-300, 2.0])):
        status, z, active = run(np.eye(2), b)
        assert status == SOLVED
        np.testing.assert_array_equal(z, 0.0)
        np.testing.assert_array_equal(active, 0)


# --- random -------------------------------------------------------------------------------------------------------------


def test_random_definite():
    """200 contact-like definite problems of up to 20 contacts: unique z, the same as Lemke's, from any first guess."""
    rng = np.random.default_rng(1)
    for _ in range(200):
        n = int(rng.integers(1, 21))
        a = compliant(rng, n, 120) + 1e-3 * np.eye(n)
        b = rng.normal(size=n)
        status, z, _ = run(a, b, guess=rng.integers(0, 2, n).astype(np.uint8))
        assert status == SOLVED
        assert_solves(a, b, z, 1e-12)
        expected = lemke(a, b)
        np.testing.assert_allclose(z, expected, atol=1e-9 * np.abs(expected).max(initial=1e-30))


def test_random_semidefinite():
    """More contacts than modes, feasible: some motion satisfies all. A z, the motion, is unique; z need not be."""
    rng = np.random.default_rng(2)
    for _ in range(200):
        n, modes = int(rng.integers(2, 21)), int(rng.integers(1, 8))
        shapes = rng.normal(size=(n, modes))
        a = shapes @ shapes.T
        b = -shapes @ rng.normal(size=modes) + np.maximum(0.0, rng.normal(size=n))  # feasible by construction
        status, z, _ = run(a, b)
        assert status == SOLVED
        assert_solves(a, b, z, 1e-9)
        # the motion x = Sᵀz is the shortest with S x ≥ −b: least-distance programming (Lawson and Hanson 1974, ch. 23)
        residual = (
            np.append(np.zeros(modes), -1.0)
            + np.vstack([shapes.T, -b]) @ nnls(np.vstack([shapes.T, -b]), np.append(np.zeros(modes), 1.0))[0]
        )
        np.testing.assert_allclose(shapes.T @ z, -residual[:-1] / residual[-1], atol=1e-8 * np.abs(b).max())


def test_many_contacts_on_few_modes():
    """20 frets on 3 to 9 modes, gaps and depths over six decades: still solved, to rounding, from any first guess."""
    rng = np.random.default_rng(12)
    for _ in range(300):
        modes = int(rng.integers(3, 10))
        shapes = np.sin(np.pi * np.outer(np.sort(rng.uniform(0.02, 0.98, 20)), np.arange(1, modes + 1)))
        shapes = shapes / np.arange(1, modes + 1)
        a = shapes @ shapes.T
        b = -shapes @ rng.normal(size=modes) + 10 ** rng.uniform(-6, 0, 20) * rng.integers(0, 2, 20)
        status, z, _ = run(a, b, guess=rng.integers(0, 2, 20).astype(np.uint8))
        assert status == SOLVED
        assert_solves(a, b, z, 1e-11)


def test_no_solution_is_said():
    """A contact that no mode can move, inside the obstacle: NOT_SOLVED, finite numbers, and it ends."""
    a = np.array([[1.0, 0.0], [0.0, 0.0]])
    status, z, _ = run(a, np.array([-1.0, -1.0]))
    assert status == NOT_SOLVED
    assert np.all(np.isfinite(z))
    # two coincident points, one of which is also pulled down by the other's row
    a = np.array([[1.0, -1.0], [-1.0, 1.0]])
    assert run(a, np.array([-1.0, -1.0]))[0] == NOT_SOLVED


def test_coincident_contacts():
    """The same point twice, or three times: the forces share as they like, the motion is that of one."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        a1 = compliant(rng, 4, 60)
        copy = np.array([0, 1, 1, 2, 3, 3, 3])
        a, b1 = a1[np.ix_(copy, copy)], rng.normal(size=4)
        status, z, _ = run(a, b1[copy])
        assert status == SOLVED
        assert_solves(a, b1[copy], z, 1e-9)
        _, z1, _ = run(a1, b1)
        np.testing.assert_allclose((a @ z)[[0, 1, 3, 4]], a1 @ z1, atol=1e-9 * np.abs(b1).max())


def test_disabled_contacts_stay_out():
    """A contact that is not enabled has no force, whatever its b; the rest is the smaller problem."""
    rng = np.random.default_rng(4)
    for _ in range(50):
        a, b = compliant(rng, 8, 80) + 1e-3 * np.eye(8), rng.normal(size=8)
        enabled = rng.integers(0, 2, 8).astype(np.uint8)
        status, z, active = run(a, b, enabled, np.ones(8, np.uint8))
        on = np.flatnonzero(enabled)
        assert status == SOLVED
        assert np.all(z[enabled == 0] == 0.0) and not np.any(active[enabled == 0])
        if on.size:
            _, small, _ = run(np.ascontiguousarray(a[np.ix_(on, on)]), b[on])
            np.testing.assert_allclose(z[on], small, rtol=0, atol=1e-12 * np.abs(small).max(initial=1.0))


def test_scale_does_not_matter():
    """Compliances of 1e-7 m/N and gaps of micrometres are as well solved as numbers near one."""
    rng = np.random.default_rng(5)
    for _ in range(30):
        a, b = compliant(rng, 6, 80), rng.normal(size=6)
        _, z, _ = run(a, b)
        _, small, _ = run(a * 2.0**-24, b * 2.0**-20)
        np.testing.assert_array_equal(small, z * 2.0**4)


def test_residual_finds_what_is_wrong():
    """The judge itself: it sees a force too small, too great, pulling, and one where there is a gap."""
    a, b = np.array([[2.0, 1.0], [1.0, 3.0]]), np.array([-2.0, 5.0])
    right = np.array([1.0, 0.0])
    assert natural_residual(a, b, right) == 0.0
    for wrong in ([0.9, 0.0], [1.1, 0.0], [1.0, -0.1], [1.0, 0.1]):
        assert natural_residual(a, b, np.array(wrong)) > 0.05
