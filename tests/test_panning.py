"""Shares of left and right: the same power wherever a sound stands, the same numbers wherever they are needed."""

import ast
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from synth import panning
from synth.dsp.body import body_coefficients
from synth.dsp.body_effect import BODY
from synth.instrument.resonances import Peak
from synth.physics.body_modes import Body, BodyMode

PACKAGE = Path(panning.__file__).parent
PANS = np.random.default_rng(5).uniform(-1.0, 1.0, 17)


def test_power_is_the_same_everywhere() -> None:
    left, right = panning.shares(np.array([-1.0, 0.0, 1.0]))
    np.testing.assert_allclose(left, [1.0, math.sqrt(0.5), 0.0], atol=1e-15)
    np.testing.assert_allclose(right, left[::-1], atol=1e-15)
    np.testing.assert_allclose((panning.shares(PANS) ** 2).sum(axis=0), 1.0)
    assert panning.shares(0.3).shape == (2,) and panning.shares([]).shape == (2, 0)


def test_modes_and_resonances_of_bodies_have_these_shares_to_the_bit() -> None:
    angle = 0.25 * math.pi * (1.0 + PANS)
    sides = np.array([np.cos(angle), np.sin(angle)])
    body = Body(tuple(BodyMode(100.0 + k, 30.0, 0.1, (1.0,), 0.3 + k, pan) for k, pan in enumerate(PANS)))
    heard = 0.7 * np.array([mode.radiation for mode in body.modes])
    assert np.array_equal(body.left_right(0.7), math.sqrt(2.0) * heard * sides)
    peaks = [Peak(100.0 + k, 20.0, 0.5 * k, 1.0, pan) for k, pan in enumerate(PANS)]
    made = BODY.made(SimpleNamespace(peaks=peaks, wide=True, direct_db=0.0), 44100.0)
    plain = body_coefficients([peak.frequency_hz for peak in peaks], [20.0] * 17, [peak.gain_db for peak in peaks], 44100.0)
    for side in range(2):
        assert np.array_equal(made.coefficients[side, 0], plain[0] * (np.sqrt(2.0) * sides[side]))
        assert np.array_equal(made.coefficients[side, 1:], plain[1:])


def test_the_formula_stands_here_and_in_the_kernel_that_mixes_alone() -> None:
    def quarter_turns(path: Path) -> bool:
        text = ast.unparse(ast.parse(path.read_text(encoding="utf-8")))
        return "0.25 * math.pi * (1.0 +" in text or "0.25 * np.pi * (1.0 +" in text

    found = {path.relative_to(PACKAGE).as_posix() for path in PACKAGE.rglob("*.py") if quarter_turns(path)}
    assert found == {"panning.py", "engine/mix.py"}
