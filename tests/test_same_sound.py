"""tools/same-sound: how answers are compared, what the scenes cover, and a small run that finds what was altered."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from synth.engine.parameters import INDEX_OF
from synth.instrument.qualities import QUALITIES
from synth.midi import events
from synth.research.case import case_names
from synth.solver.schemes import LAWS, SCHEMES

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from same_sound import render
from same_sound.compare import DIFFERS, EQUAL, MISSING, NEW, compare, compared
from same_sound.run import judged, verdict_of
from same_sound.scenes import COUPLED, PRESETS, scenes
from same_sound.session import COMPILED, DONE, FAILED, UNKNOWN, Answer, Worker
from same_sound.trees import Side

ROOT = Path(__file__).parents[1]
OUT = np.linspace(-0.9, 0.9, 20).reshape(10, 2)


def test_the_same_bits_are_equal() -> None:
    found = compare("out", OUT, OUT.copy())
    assert found.verdict == EQUAL and found.count == 0 and found.size == 20


def test_one_ulp_is_told_with_its_place() -> None:
    other = OUT.copy()
    other[7, 1] = np.nextafter(other[7, 1], 2.0)
    other[8, 0] = np.nextafter(np.nextafter(other[8, 0], 2.0), 2.0)
    found = compare("out", OUT, other)
    assert (found.verdict, found.ulps, found.first, found.count) == (DIFFERS, 2, (7, 1), 2)
    assert found.largest == abs(other[8, 0] - OUT[8, 0])
    assert found.written == (0, 0)
    assert "first at frame 7, channel 1" in found.line() and "2 of 20" in found.line() and "as float32 equal" in found.line()


def test_samples_that_differ_once_they_are_written_are_counted() -> None:
    other = OUT.copy()
    other[3, 0] = np.float64(np.nextafter(np.float32(other[3, 0]), np.float32(2.0)))
    found = compare("out", OUT, other)
    assert found.written == (1, 1)
    assert found.ulps is not None and found.ulps > 1000


def test_float32_is_measured_in_its_own_ulp() -> None:
    base = OUT.astype(np.float32)
    other = base.copy()
    other[0, 0] = np.nextafter(np.nextafter(base[0, 0], np.float32(0.0)), np.float32(0.0))
    found = compare("out", base, other)
    assert (found.ulps, found.written) == (2, None)


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_steps_are_counted_across_zero(kind: type) -> None:
    smallest = np.nextafter(kind(0.0), kind(1.0))
    found = compare("u", np.array([-smallest, smallest], kind), np.array([smallest, smallest], kind))
    assert found.ulps == 2
    widest = compare("u", np.array([-np.inf], kind), np.array([np.inf], kind))
    assert widest.largest == math.inf and widest.ulps == 2 * int(np.array([np.inf], kind).view(f"i{kind(0).itemsize}")[0])


def test_the_sign_of_zero_is_a_difference() -> None:
    found = compare("u", np.array([0.0, 1.0]), np.array([-0.0, 1.0]))
    assert (found.verdict, found.ulps, found.count, found.first) == (DIFFERS, 0, 1, (0,))
    assert "signs of zeros" in found.line()


def test_nan_equals_nan_at_the_same_place_and_is_said() -> None:
    base = np.array([1.0, np.nan, 2.0])
    negative = np.array([1.0, -np.nan, 2.0])
    found = compare("u", base, negative)
    assert (found.verdict, found.nans) == (EQUAL, 1)
    assert "NaN" in found.line() and verdict_of([found]) == (EQUAL, "NaN at the same places: u (1)", ())
    moved = compare("u", base, np.array([np.nan, 1.0, 2.0]))
    assert (moved.verdict, moved.count, moved.first, moved.largest) == (DIFFERS, 2, (0,), math.inf)


def test_another_length_is_told_with_the_common_beginning() -> None:
    found = compare("out", OUT, np.vstack([OUT, OUT]))
    assert found.verdict == DIFFERS and found.count == 0
    assert "(10, 2), is (20, 2)" in found.line() and "equal as far as both go" in found.line()
    other = OUT[:5] + 1.0
    assert compare("out", OUT, other).first == (0, 0)
    assert compare("out", OUT, OUT[:, :1]).verdict == DIFFERS
    assert compare("out", OUT, OUT.ravel()).verdict == DIFFERS
    assert compare("out", OUT[:0], OUT[:0]).verdict == EQUAL


def test_another_type_and_whole_numbers() -> None:
    assert compare("out", OUT, OUT.astype(np.float32)).verdict == DIFFERS
    assert compare("out", np.array([3], "i4"), np.array([3], "i8")).verdict == DIFFERS
    found = compare("out", np.array([[3], [4]], "i2"), np.array([[3], [-4]], "i2"))
    assert (found.largest, found.first, found.ulps) == (8.0, (1, 0), None)
    scalar = compare("report.notes", np.array(3), np.array(4))
    assert (scalar.verdict, scalar.largest, scalar.first) == (DIFFERS, 1.0, ())
    assert compare("last_contact_s", np.array(0.5), np.array(0.5)).verdict == EQUAL


def test_arrays_of_one_side_only() -> None:
    found = {each.array: each.verdict for each in compared({"out": OUT, "lost": OUT}, {"out": OUT, "won": OUT})}
    assert found == {"out": EQUAL, "lost": MISSING, "won": NEW}
    assert verdict_of(compared({"out": OUT}, {"out": OUT, "won": OUT})) == (EQUAL, "", ("won",))
    assert verdict_of(compared({"out": OUT, "lost": OUT}, {"out": OUT}))[0] == DIFFERS
    assert verdict_of([])[0] == DIFFERS
    assert verdict_of(compared({}, {"out": OUT}))[0] == DIFFERS


def test_what_fails_is_different_and_what_base_does_not_know_is_new(tmp_path: Path) -> None:
    path = tmp_path / "answer.npz"
    np.savez(path, out=OUT)

    def answer(came: str, words: str = "") -> Answer:
        return Answer({"name": "scene"}, came, words, 0.0, path)

    assert judged(answer(DONE), answer(DONE)) == (EQUAL, "", ())
    assert judged(answer(UNKNOWN, "no preset 'lute'"), answer(DONE)) == (NEW, "BASE does not have it: no preset 'lute'", ())
    for then, now in ((DONE, FAILED), (FAILED, DONE), (DONE, UNKNOWN), (UNKNOWN, UNKNOWN), (FAILED, FAILED)):
        verdict, words, _ = judged(answer(then, "why"), answer(now, "why"))
        assert verdict == DIFFERS and "why" in words


def test_what_a_process_that_compiles_gives_is_asked_again_of_another(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    worker, asked = Worker(Side("here", tmp_path)), []

    def fake(scene: dict[str, str], path: Path, last: bool) -> Answer:
        asked.append(last)
        return Answer(scene, DONE if last else COMPILED, "", 0.0, path)

    monkeypatch.setattr(worker, "_ask", fake)
    monkeypatch.setattr(worker, "_stop", lambda: asked.append("another"))
    assert worker.ask({"name": "scene"}, tmp_path / "answer.npz").came == DONE
    assert asked == [False, "another", True]
    worker.end()


def test_scenes_have_names_of_their_own_and_are_plain_data() -> None:
    names = [scene["name"] for scene in scenes()]
    assert len(names) >= 40 and len(set(names)) == len(names)
    assert not any(set(name) & set("/ *?[") for name in names)
    assert json.dumps(scenes()) == json.dumps(scenes())


def test_every_preset_is_played_at_every_quality_by_every_law() -> None:
    played = {
        (preset, scene.get("options", {}).get("quality"), scene.get("options", {}).get("scheme"))
        for scene in scenes()
        if scene["kind"] == "engine"
        for preset in scene["presets"]
        if isinstance(preset, str)
    }
    laws = {preset: ("exact-hold",) if preset in COUPLED else tuple(LAWS) for preset in PRESETS}
    wanted = {(preset, quality, law) for preset in PRESETS for quality in QUALITIES for law in laws[preset]}
    assert wanted <= played


def test_every_case_scheme_and_quality_of_simulate_is_run() -> None:
    simulated = [scene for scene in scenes() if scene["kind"] == "simulate"]
    runs = [run for scene in simulated for run in scene["runs"]]
    assert set(case_names()) <= {scene["case"] for scene in simulated if isinstance(scene["case"], str)}
    assert set(SCHEMES) <= {run.get("scheme") for run in runs}
    assert set(QUALITIES) <= {run.get("quality") for run in runs}
    assert {"lumped", "static", "none"} <= {run.get("tail") for run in runs}


def test_every_kind_of_event_and_every_live_parameter_is_sent() -> None:
    rows = [row for scene in scenes() if scene["kind"] == "engine" for row in scene["events"]]
    assert {row[1] for row in rows} == set(render.KINDS)
    assert {row[3] for row in rows if row[1] == "parameter"} == set(INDEX_OF)
    numbers = {
        "on": events.NOTE_ON, "off": events.NOTE_OFF, "control": events.CONTROL, "bend": events.BEND,
        "program": events.PROGRAM, "parameter": events.PARAMETER, "pressure": events.PRESSURE,
        "key-pressure": events.KEY_PRESSURE, "tuning": events.TUNING,
    }  # fmt: skip
    assert numbers == render.KINDS


def git(root: Path, *words: str) -> str:
    who = ("-c", "user.name=nobody", "-c", "user.email=nobody@localhost", "-c", "commit.gpgsign=false")
    command = ["git", "-C", str(root), *who, *words]
    return subprocess.run(command, check=True, stdin=subprocess.DEVNULL, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    """This package and the tool with one commit, in a place of their own."""
    root = tmp_path / "repository"
    leave = shutil.ignore_patterns("__pycache__", "page", "node_modules")
    for folder in ("synth", "presets", "tools/same_sound"):
        shutil.copytree(ROOT / folder, root / folder, ignore=leave)
    shutil.copy2(ROOT / "tools/same-sound", root / "tools")
    shutil.copy2(ROOT / ".gitignore", root)
    for words in (("init", "-q"), ("add", "."), ("commit", "-q", "-m", "all")):
        git(root, *words)
    return root


def same_sound(root: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The tool of that repository, with a cache of its own."""
    environment = os.environ | {"XDG_CACHE_HOME": str(root.parent / "cache"), "PYTHONPATH": ""}
    command = [sys.executable, str(root / "tools/same-sound"), *words]
    return subprocess.run(command, capture_output=True, text=True, env=environment)


@pytest.mark.slow
def test_an_altered_rounding_and_a_failure_are_found(repository: Path) -> None:
    """Scenes of closed forms, which compile nothing."""
    wanted = ("HEAD", "--only", "scheme-cabannes", "--only", "scheme-flat-wall")
    done = same_sound(repository, *wanted)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "2 equal, 0 different" in done.stdout and "BASE: 0 of 2" in done.stderr
    git(repository, "commit", "-q", "--allow-empty", "-m", "another with the same package: what is kept serves it too")

    forms = repository / "synth/research/exact/triangle.py"
    before = forms.read_text()
    ordered = "displacement_m * (free(z, now, 1.0, 1.0, 0.5, 1.0) + sent(now - d) - sent(now - (1.0 - d)))"
    assert before.count(ordered) == 1
    opened = ordered.replace("(free", "free").replace("+ sent", "+ displacement_m * (sent")
    forms.write_text(before.replace(ordered, opened))
    done = same_sound(repository, *wanted, "--keep", str(repository.parent / "kept"))
    assert done.returncode == 1, done.stdout + done.stderr
    line = next(line for line in done.stdout.splitlines() if "scheme-cabannes" in line)
    assert line.startswith(DIFFERS) and "0.u: largest difference" in line and " ulp" in line and "first at row" in line
    assert "1 equal, 1 different" in done.stdout and "1 changed file" in done.stdout
    assert "BASE: " not in done.stderr
    with np.load(repository.parent / "kept/scheme-cabannes.base.npz") as base:
        with np.load(repository.parent / "kept/scheme-cabannes.here.npz") as here:
            assert np.abs(here["0.u"] - base["0.u"]).max() < 1e-15 and not np.array_equal(here["0.u"], base["0.u"])

    forms.write_text(before.replace("def wall(", "def another("))
    done = same_sound(repository, *wanted)
    assert done.returncode == 1
    line = next(line for line in done.stdout.splitlines() if "scheme-flat-wall" in line)
    assert line.startswith(DIFFERS) and "working tree: failed: AttributeError" in line
    assert "1 equal, 1 different" in done.stdout


@pytest.mark.slow
def test_wrong_use_is_told_in_a_line(repository: Path) -> None:
    nothing = git(repository, "commit-tree", "-m", "nothing", git(repository, "mktree"))
    for words, reason in (
        ((nothing,), "has no package to compare with"),
        (("HEAD~7",), "BASE must be a commit"),
        (("--", "--upload-pack=x"), "BASE must be a commit"),
        ((), "BASE is missing"),
        (("HEAD", "--only", "no-such-*"), "matches no scene"),
        (("HEAD", "--jobs", "0"), "--jobs must be at least 1"),
    ):
        done = same_sound(repository, *words)
        assert done.returncode == 2 and reason in done.stderr and "Traceback" not in done.stderr, done.stderr
    listed = same_sound(repository, "--list", "--only", "drone*")
    assert listed.returncode == 0 and "drone" in listed.stdout.split()


@pytest.mark.slow
def test_a_worker_that_dies_costs_one_scene(repository: Path) -> None:
    cases = repository / "synth/research/exact/triangle.py"
    cases.write_text(
        cases.read_text().replace("def wall(", "def wall(*_, **__):\n    import os\n    os.abort()\n\n\ndef old(")
    )
    done = same_sound(
        repository, "HEAD", "--only", "scheme-flat-wall", "--only", "scheme-cabannes", "--only", "scheme-flat-*"
    )
    assert done.returncode == 1
    assert "died of SIGABRT" in done.stdout and "1 equal, 1 different" in done.stdout
