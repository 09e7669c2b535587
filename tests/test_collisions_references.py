"""References of the collision benchmark against other methods, quickly; the example's solver, run as its page says."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from benchmarks.collisions import contest, neutral, recipes, references, scene, ways
from benchmarks.collisions.examples import kicks
from benchmarks.collisions.recipes import Kicks, Recipe
from benchmarks.collisions.ways import way

from synth.dsp.measures import relative_error

ROOT = Path(__file__).resolve().parents[1]


@pytest.mark.parametrize("name", scene.names())
def test_the_numbers_of_a_scene_are_those_of_its_terms(name):
    made, kept = neutral.numbers(name), scene.numbers_of(name)
    assert made.keys() == kept.keys()
    for key, value in made.items():
        if key in ("frequencies_hz", "decay_rates_1_s"):
            np.testing.assert_allclose(value, kept[key], rtol=1e-12)
        elif key == "q0_m_sqrt_m":
            np.testing.assert_allclose(value, kept[key], rtol=0, atol=1e-12 * np.abs(value).max())
        elif key != "wall":
            assert value == kept[key], key


#: what a quick run of another method than the reference's must reach over the first window, from a rate where it does
QUICK = {
    "no-contact": (Kicks(1, 1001), 1e-6),
    "tanpura": (way("moreau-jean-filtered", 48, 1001, restitution=0.0, duration_s=0.1), 0.01),
    "two-close": (way("moreau-jean-filtered", 48, 1001, restitution=0.0, duration_s=0.1), 0.01),
    "moving": (way("moreau-jean-filtered", 48, 1001, restitution=0.0, duration_s=0.05), 0.05),
    "pressed": (way("moreau-jean-filtered", 48, 863, restitution=0.0, duration_s=0.05), 0.05),
    "sitar": (way("moreau-jean-filtered", 24, 1001, restitution=0.0, duration_s=0.1), 0.05),
    "bass": (way("moreau-jean-filtered", 96, 863, restitution=0.0, duration_s=0.05), 0.1),
    "bass-hard": (way("moreau-jean-filtered", 96, 863, restitution=0.0, duration_s=0.02), 0.1),
    "thirds": (way("moreau-jean-filtered", 96, 1001, restitution=0.0, duration_s=0.03), 0.1),
    "forty-modes": (way("moreau-jean-filtered", 384, 40, restitution=0.0, duration_s=0.1), 0.01),
    "cabannes": (way("waveguide", 1, 10), 1e-7),
    "ideal-bridge": (way("exact-hold", 24, 1500, duration_s=0.02), 0.03),
    "flat-wall": (way("wall", 1, 255, restitution=1.0), 0.003),
}


@pytest.mark.parametrize("name", QUICK)
def test_another_method_says_the_same(name):
    """Velocity-level impacts against position-level contact, waves against modes: at rates that take a second at most."""
    chosen, most = QUICK[name]
    if isinstance(chosen, Kicks):
        u, _ = kicks.solve(scene.numbers_of(name) | {"samples": 4411}, chosen.factor, chosen.modes)
    else:
        u = ways.run(name, chosen).u[:, 0]
    assert relative_error(u, scene.reference(name).u[: u.size]) < most


def test_penalty_springs_say_the_same_of_the_board():
    """The example's solver, which shares no code with this program, over 50 ms of the fretless board: e < 0.05."""
    numbers = scene.numbers_of("fretless") | {"samples": 2206}
    u, _ = kicks.solve(numbers, 4, 255)
    assert relative_error(u, scene.reference("fretless").u[:2206]) < 0.05


@pytest.mark.parametrize("name", scene.names())
def test_references_are_confirmed(name):
    """Where a reference is sure to e < 0.02, another method has said so to 0.02 at least; its record is its recipe's."""
    record, recipe = scene.records()[name], recipes.RECIPES[name]
    rate = scene.scene(name).rate_hz
    assert (record["scheme"], record["internal_rate_hz"]) == (recipe.reference.label, rate * recipe.reference.factor)
    assert [each["what"] for each in record["checks"]] == list(recipe.checks)
    assert [each["what"] for each in record["independent"]] == list(recipe.independent)
    for own, other in zip(record["uncertainty"], record["confirmed"], strict=True):
        assert other is not None and other < max(0.02, own)


def test_the_scene_without_collision_is_the_tanpura_without_its_point():
    """The same string and pluck, so that its errors can be taken off those of `tanpura`; the loss law is in its terms."""
    alone, over = ways.tables_of("no-contact"), ways.tables_of("tanpura")
    for key in ("string", "initial", "run"):
        assert alone[key] == over[key], key
    assert alone["obstacle"]["positions_m"] == []
    assert alone["string"]["viscoelastic_loss"] > 0 and alone["string"]["thermoelastic_q_inverse"] > 0


def test_only_the_scene_asked_for_is_written(tmp_path, monkeypatch):
    """The numbers and references of all others keep every byte, also those that this machine would round differently."""
    for part in ("scenes", "references"):
        (tmp_path / part).mkdir()
    for name in ("cabannes", "forty-modes"):
        text = (scene.SCENES / f"{name}.toml").read_text(encoding="utf-8")
        (tmp_path / "scenes" / f"{name}.toml").write_text(text, encoding="utf-8")
        (tmp_path / "scenes" / f"{name}.json").write_text("kept", encoding="utf-8")
        (tmp_path / "references" / f"{name}.npz").write_bytes(b"kept")
    (tmp_path / "references" / "references.json").write_text('{"forty-modes": {"kept": 1}}', encoding="utf-8")
    quick = Recipe(way("exact-hold", 16, 40, residual_compliance=False), {"fewer": way("exact-hold", 1, 20)}, {})
    monkeypatch.setitem(recipes.RECIPES, "cabannes", quick)
    references.make(["cabannes"], tmp_path / "out", lambda words: None, tmp_path)
    assert (tmp_path / "scenes" / "forty-modes.json").read_text(encoding="utf-8") == "kept"
    assert (tmp_path / "references" / "forty-modes.npz").read_bytes() == b"kept"
    found = scene.records(tmp_path)
    assert found["forty-modes"] == {"kept": 1} and found["cabannes"]["modes"] == 40
    assert scene.numbers_of("cabannes", tmp_path)["name"] == "cabannes"
    assert scene.reference("cabannes", tmp_path).u.size == scene.scene("cabannes").samples


def test_free_flight_of_the_example_is_exact():
    """No contact: its propagator against the closed form of a damped mode."""
    numbers = dict(scene.numbers_of("forty-modes")) | {"samples": 200}
    numbers["contacts"] = {"positions_m": [0.3], "heights_m": [-1.0]}
    u, _ = kicks.solve(numbers, 3)
    f, sigma, q = (np.array(numbers[key]) for key in ("frequencies_hz", "decay_rates_1_s", "q0_m_sqrt_m"))
    keep = f < 1.5 * numbers["rate_hz"]
    f, sigma, q = f[keep], sigma[keep], q[keep]
    t = np.arange(200)[:, None] / numbers["rate_hz"]
    wd = np.sqrt((2 * np.pi * f) ** 2 - sigma**2)
    modes = np.exp(-sigma * t) * (np.cos(wd * t) + sigma / wd * np.sin(wd * t)) * q
    j = np.arange(1, f.size + 1)
    wanted = modes @ (np.sqrt(2 / numbers["length_m"]) * np.sin(j * np.pi * numbers["output_m"] / numbers["length_m"]))
    np.testing.assert_allclose(u, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


def test_the_example_runs_and_is_scored(tmp_path):
    """As docs/collisions.md says, in processes of their own, NumPy alone."""
    example = ROOT / "tools" / "benchmarks" / "collisions" / "examples" / "kicks.py"
    runs, found = [tmp_path / "4.npz", tmp_path / "8.npz"], tmp_path / "found.json"
    for run in runs:
        solver = [sys.executable, "-I", str(example), str(scene.SCENES / "cabannes.json"), str(run), "--factor", run.stem]
        subprocess.run(solver, cwd=tmp_path, check=True)
    scoring = [sys.executable, str(ROOT / "tools" / "collisions"), "score", *map(str, runs), "--json", str(found)]
    done = subprocess.run(scoring, cwd=ROOT, capture_output=True, text=True, check=True)
    assert "| 4.npz | " in done.stdout and "| 8.npz | " in done.stdout and done.stderr == ""
    coarse, fine = json.loads(found.read_text(encoding="utf-8"))["scores"]
    assert coarse["scene"] == fine["scene"] == "cabannes" and fine["cost_s"] > coarse["cost_s"] > 0.0
    # its spring is as stiff as the step allows, so that the whole is of first order
    assert coarse["e"][-1] < 0.1 and 0.4 < fine["e"][-1] / coarse["e"][-1] < 0.6
    assert len(example.read_text(encoding="utf-8").splitlines()) < 90


def test_a_scheme_that_does_not_apply_says_why(monkeypatch):
    """Of a moving point: the schemes that know none refuse, in a line, and the others have a score and a cost."""
    name = "moving"
    few = [way("exact-hold", 1, 90), way("compliant", 1, 90), way("waveguide", 4, 10)]
    monkeypatch.setattr(contest, "ways_of", lambda numbers: few)
    records = contest.entered(name, scene.scene(name), scene.reference(name), 1, 10.0, lambda words: None)
    ran = [record for record in records if "does_not_apply" not in record]
    assert [record["scheme"] for record in ran] == ["exact-hold + lumped tail"] and ran[0]["cost_s"] > 0.0
    assert ran[0]["e"][0] < 0.2 and ran[0]["penetration_m"] is None
    reasons = {record["scheme"]: record["does_not_apply"] for record in records if record not in ran}
    assert "moving obstacle" in reasons["compliant (penalty), Newton"] and len(reasons) == 2


def test_a_run_that_blows_up_is_an_entry_that_says_so(monkeypatch):
    name = "cabannes"
    monkeypatch.setattr(contest, "ways_of", lambda numbers: [way("exact-hold", 1, 20)])
    monkeypatch.setattr(contest, "_once", lambda found, one: ({"u": np.full(2241, np.inf)}, 0.1))
    records = contest.entered(name, scene.scene(name), scene.reference(name), 0, 10.0, lambda words: None)
    assert len(records) == 1 and records[0]["blown_up"] and "e" not in records[0]
