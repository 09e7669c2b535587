"""Interpreted kernels (JAWARI_DEBUG) against compiled ones: whole runs in processes of their own, vector code by calls."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from synth.native import debugging
from synth.solver import lanes, plain_lanes
from synth.solver.block_rows import BLOCK, ROWS

RUNS = """
import sys
import numpy as np
import synth

made = {}
small = {"internal_rate_hz": 176400.0, "output_rate_hz": 44100.0, "modes": 40}
for case in ("tanpura", "bass", "fretless", "sitar", "hard/bend"):
    made[case] = synth.simulate(case, duration_s=0.006, **small).u
for case in ("hard/restitution", "flat-wall"):
    made[case] = synth.simulate(case, duration_s=0.0005, **small).u
for preset, note in (("jawari-harp", 60), ("fretted-bass", 40), ("tanpura", 48)):
    made[preset] = synth.render([(note, 100, 0.004)], preset, tail=0.002, quality="fine").samples
np.savez(sys.argv[1], **made)
"""


def run(folder: Path, source: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", source, "made.npz"],
        cwd=folder, env=os.environ | environment, capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_runs_and_renders_are_the_same_but_for_rounding(tmp_path: Path) -> None:
    made = []
    for name, switch in (("compiled", "0"), ("interpreted", "1")):
        (tmp_path / name).mkdir()
        done = run(tmp_path / name, RUNS, JAWARI_DEBUG=switch)
        assert (done.returncode, done.stderr) == (0, "")
        made.append(dict(np.load(tmp_path / name / "made.npz")))
    compiled, interpreted = made
    for name, expected in compiled.items():
        peak = np.abs(expected).max()
        assert peak > 0.0
        assert np.abs(interpreted[name] - expected).max() < 1e-11 * peak, name


def test_nothing_is_compiled(tmp_path: Path) -> None:
    source = (
        "import synth; from synth.solver.blocks import press_blocks; "
        "print(type(getattr(press_blocks, 'dispatcher', press_blocks)).__name__)"
    )
    assert run(tmp_path, source, JAWARI_DEBUG="1").stdout == "function\n"
    assert run(tmp_path, source, JAWARI_DEBUG="").stdout == "CPUDispatcher\n"


def test_what_needs_compiled_kernels_says_so(tmp_path: Path) -> None:
    source = "import sys; from synth.cli import main; sys.exit(main(['play', '--duration', '0.1', '--device', 'none']))"
    done = run(tmp_path, source, JAWARI_DEBUG="1")
    assert done.returncode == 2
    assert done.stderr == (
        "synth: error: a live session needs compiled kernels, and JAWARI_DEBUG interprets them: unset JAWARI_DEBUG\n"
    )


def test_this_process_compiles() -> None:
    assert not debugging.INTERPRETED


PASSES = (
    ("", "q"),
    ("", "qqq"),
    ("", "av"),
    ("coast", ""),
    ("coast", "qv"),
    ("drive", "qq"),
    ("drive", "v"),
    ("drive listed", "q"),
    ("drive listed and one", ""),
    ("coast kicked", ""),
    ("drive listed and one kicked", ""),
)


@pytest.mark.parametrize("single", [False, True], ids=["float64", "float32"])
@pytest.mark.parametrize(("motion", "kinds"), PASSES)
def test_a_pass_is_its_plain_function(motion: str, kinds: str, single: bool) -> None:
    rng = np.random.default_rng(8)
    n, contacts = 48, 5
    real = np.float32 if single else np.float64
    arrays = [stepped_rows(rng, n, single).astype(real), *(rng.normal(size=(2, n)).astype(real))]
    if motion.startswith("drive listed"):
        count, which = 3, np.array([4, 0, 2, 1, 3])
        arrays += [count, which, rng.normal(size=(contacts, n)).astype(real), rng.normal(size=(contacts, BLOCK))]
    if motion.removesuffix(" kicked") in ("drive", "drive listed and one"):
        arrays += [rng.normal(size=n).astype(real), rng.normal(size=BLOCK)]
    if motion.endswith(" kicked"):
        arrays += [rng.normal(size=n).astype(real), rng.normal(size=BLOCK)]
    arrays += [rng.normal(size=n).astype(real) for _ in kinds]
    arrays += [np.zeros(BLOCK) for _ in kinds]
    one_pass = lanes.one_kind_of_pass(motion, kinds)

    @njit
    def compiled(n, given):
        one_pass(n, *given)

    ours, plain = ([np.copy(a) if isinstance(a, np.ndarray) else a for a in arrays] for _ in range(2))
    compiled(n, tuple(ours))
    plain_lanes.one_pass(motion, kinds)(n, *plain)
    for got, expected in zip(ours, plain, strict=True):
        size = np.abs(expected).max()
        assert np.abs(got - expected).max() <= (2e-5 if single else 1e-12) * size


def stepped_rows(rng: np.random.Generator, n: int, single: bool) -> np.ndarray:
    """Rows of modes that turn and decay, as `responses.fill_rows` makes them: by matrix products, mode by mode."""
    rows = np.zeros((ROWS, n))
    for j in range(n):
        angle, decay = rng.uniform(0.01, 2.0), rng.uniform(0.9, 1.0)
        turn = decay * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        push = rng.normal(size=2)
        trace, det = np.trace(turn), np.linalg.det(turn)
        ahead = np.linalg.matrix_power(turn, BLOCK) - (np.eye(2) if single else 0.0)
        rows[:, j] = [*turn.ravel(), *push, trace, -det, ahead[0, 0], ahead[0, 1], ahead[1, 0], ahead[1, 1],
                      *((turn - trace * np.eye(2)) @ push)]  # fmt: skip
    return rows


@pytest.mark.parametrize("lifted", [-1.0, 0.0, 1.0], ids=["clear", "grazing", "pressed"])
def test_a_sequence_is_its_plain_function(lifted: float) -> None:
    rng = np.random.default_rng(5)

    def response(size: float) -> np.ndarray:
        return np.concatenate([np.zeros(BLOCK), size * (1.0 + 0.1 * rng.normal(size=BLOCK))])

    u, y, pull = rng.normal(size=(3, BLOCK))
    own, cross, mine = response(1.0), response(0.3), response(0.8)
    held = (0.7, 0.2, 0.1)

    @njit
    def compiled(u, eta, mine, forces, pull, y, own, pushes, true, cross, both):
        lanes.press_sequence(u, eta, mine, forces)
        lanes.grip_sequence(pull, held, y, own, pushes[0], true[0])
        lanes.grip_and_press_sequence(pull, held, y, own, eta, u, cross, mine, pushes[1], true[1], both)

    forces, both, pushes, true = np.zeros(BLOCK), np.zeros(BLOCK), np.zeros((2, BLOCK)), np.zeros((2, BLOCK))
    compiled(u, lifted, mine, forces, pull, y, own, pushes, true, cross, both)
    expected = [np.zeros(BLOCK) for _ in range(6)]
    plain_lanes.press_sequence(u, lifted, mine, expected[0])
    plain_lanes.grip_sequence(pull, held, y, own, expected[1], expected[2])
    plain_lanes.grip_and_press_sequence(pull, held, y, own, lifted, u, cross, mine, *expected[3:])
    for got, want in zip((forces, pushes[0], true[0], pushes[1], true[1], both), expected, strict=True):
        assert np.abs(got - want).max() < 1e-12
    assert (forces > 0.0).any() or lifted < 0.0


@pytest.mark.parametrize("late", [0, 3, BLOCK - 1])
def test_late_forces_are_added_as_by_their_plain_functions(late: int) -> None:
    rng = np.random.default_rng(6)
    responses = [np.concatenate([np.zeros(BLOCK), rng.normal(size=BLOCK)]) for _ in range(3)]

    @njit
    def compiled(one, three, first, second, third, late, x, y, z):
        lanes.add_late(one, second, late, y)
        lanes.add_late_of_three(three, first, second, third, late, (x, y, z))

    got, forces = rng.normal(size=(2, BLOCK)), tuple(rng.normal(size=3).tolist())
    want = got.copy()
    compiled(*got, *responses, late, *forces)
    plain_lanes.add_late(want[0], responses[1], late, forces[1])
    plain_lanes.add_late_of_three(want[1], *responses, late, forces)
    np.testing.assert_allclose(got, want, atol=1e-14)
    assert (got[:, :late] == want[:, :late]).all()
