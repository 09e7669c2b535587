"""The contact solvers against Siconos's own (libsiconos_numerics), an independent program in C.

Compared are forces z and motions G z to 1e-10 of the largest: the tolerance of the comparison, with direct methods on both
sides far below it. Its Newton and Gauss–Seidel methods stop at a residual of 1e-12 and 1e-13 and are held to their own.
"""

from __future__ import annotations

import numpy as np
import pytest

from synth.research.case import load_case
from synth.research.scene import Scene
from synth.solver import lcp
from synth.solver.lcp import SOLVED, natural_residual
from tests.oracles import lemke, siconos
from tests.oracles.record import contact_problems

pytestmark = pytest.mark.skipif(not siconos.available(), reason=siconos.MISSING)

AGREE = 1e-10


def ours(a, b):
    """z of the active-set method and of Lemke's."""
    n = b.size
    active, z = np.zeros(n, np.uint8), np.zeros(n)
    assert lcp.solve(a, b, np.ones(n, np.uint8), active, z, np.zeros((n, n)), np.zeros(n, np.int64)) == SOLVED
    pivoted = np.zeros(n)
    assert lemke.solve(a, b, np.ones(n, np.uint8), active, pivoted, *lemke.make_work(n)) == SOLVED
    return z, pivoted


def assert_same(a, b, theirs):
    for z in ours(a, b):
        np.testing.assert_allclose(theirs, z, rtol=0, atol=AGREE * np.abs(z).max(initial=0.0))
        np.testing.assert_allclose(a @ theirs, a @ z, rtol=0, atol=AGREE * np.abs(a @ z).max(initial=0.0))


@pytest.fixture(scope="module")
def bass():
    """G and the contact problems of 25 ms of the bass over its frets at 88.2 kHz."""
    from pathlib import Path

    scene = Scene(load_case("bass", internal_rate_hz=88_200.0, output_rate_hz=88_200.0, modes=231), Path())
    return scene.model.string.contacts.matrix, contact_problems(scene.model, *scene.initial(), 2205)


@pytest.mark.parametrize("solver", [name for name in siconos.SOLVERS if name != "enum"])
def test_bass_over_frets(bass, solver):
    """Every recorded step: 20 contacts, forces of newtons, penetrations of micrometres."""
    g, problems = bass
    assert len(problems) > 50
    theirs, z = siconos.Siconos(solver, g), np.zeros(20)
    loaded = 0
    for b in problems:
        assert theirs.solve(b, z) == 0
        assert_same(g, b, z)
        assert natural_residual(g, b, z) <= 20 * siconos.SOLVERS[solver][1] * np.abs(b).max()  # √n · Siconos's own norm
        loaded = max(loaded, int(np.count_nonzero(z)))
    assert loaded > 3


@pytest.mark.parametrize("solver", siconos.SOLVERS)
def test_random_definite(solver):
    """Well-conditioned Wishart matrices of 1 to 12 contacts, rows in units over two decades."""
    rng = np.random.default_rng(1)
    for _ in range(15):
        n = int(rng.integers(1, 9 if solver == "enum" else 13))
        root = rng.normal(size=(n, 4 * n)) * 10 ** rng.uniform(-1, 0, n)[:, None]
        a, b = root @ root.T * 1e-6, 1e-5 * rng.normal(size=n)
        z = np.zeros(n)
        assert siconos.Siconos(solver, a).solve(b, z) == 0
        assert_same(a, b, z)


def test_neighbouring_frets():
    """Pairs 0.1 mm apart, condition over 1e8: Lemke's method there and here, one motion (forces are not comparable)."""
    rng = np.random.default_rng(2)
    for _ in range(10):
        places = np.sort(rng.uniform(0.06, 0.8, 5))
        j = np.arange(1, 151)
        shapes = np.sin(np.pi * np.outer(np.concatenate([places, places + 1.2e-4]), j)) / j**1.5
        a = shapes @ shapes.T
        b = rng.uniform(0.1, 1.0, 10) * rng.integers(0, 2, 10) - a @ rng.uniform(0.0, 1.0, 10)
        z = np.zeros(10)
        assert siconos.Siconos("lemke", a).solve(b, z) == 0
        for mine in ours(a, b):
            np.testing.assert_allclose(a @ z, a @ mine, rtol=0, atol=AGREE * np.abs(a @ mine).max())


def test_wrong_use_is_said():
    with pytest.raises(ValueError, match="one of lemke"):
        siconos.Siconos("simplex", np.eye(2))
    with pytest.raises(ValueError, match="up to 12 contacts, got 13"):
        siconos.Siconos("enum", np.eye(13))
