"""How tools/bench plays the same music with two packages in turn."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from benchmarks import coupled_scenes, report, scenes, versus
from in_turn.session import Failed, in_turn
from same_sound.trees import ROOT, TOOLS, Side

from synth.midi.song import read_song

HERE = Side("this tree", ROOT)


def test_a_song_keeps_its_frames() -> None:
    scene = versus.scene("bassline.mid, fretted-bass, the whole song", ROOT / "presets")
    song = read_song(ROOT / "presets" / "demos" / "bassline.mid", scenes.RATE_HZ)
    frames = [round(row[0] * scene["rate_hz"]) for row in scene["events"]]
    assert np.array_equal(frames, song.events["frame"]) and len(frames) > 50
    assert scene["seconds"] == song.length_s + 2.0


def test_many_strings_are_timed_once_all_have_been_plucked() -> None:
    one, two = (versus.scene(name, ROOT / "presets") for name in versus.MANY)
    assert len(one["events"]) == scenes.MANY and one["events"][-1][0] < one["timed_from"] < one["seconds"]
    assert (one["options"]["threads"], two["options"]["threads"]) == (1, 2)


def test_coupled_scenes_are_those_of_the_benchmarks() -> None:
    """Events, length and blocks of a scene are what its player here plays."""
    found = {name: versus.scene(name, ROOT / "presets") for name in versus.COUPLED}
    assert all(scene["options"]["quality"] == "standard" and scene["events"] for scene in found.values())
    twelve, chords = found["sitar, twelve notes"], found["steel-guitar, chords without end"]
    assert (twelve["blocks"], chords["blocks"]) == ([128], [64])
    for scene, player in ((twelve, coupled_scenes.twelve("sitar")), (chords, coupled_scenes.strummed("steel-guitar"))):
        frames = [round(row[0] * scene["rate_hz"]) for row in scene["events"]]
        assert np.array_equal(frames, player.events["frame"]) and scene["seconds"] == player.seconds
    sixty = found[versus.SIXTY]
    assert [each["plan_of"] for each in sixty["presets"]] == list(coupled_scenes.SIXTY)
    assert {row[2] for row in sixty["events"]} == set(range(len(coupled_scenes.SIXTY)))


def test_both_sides_play_every_round() -> None:
    scene = versus.scene("bass note E1, velocity 64, whole 3 s", ROOT / "presets")
    scene |= {"seconds": 0.1, "timed_from": 0.05}
    ours, theirs = in_turn([HERE, HERE], scene, rounds=2)
    assert len(ours) == len(theirs) == 2
    for took in (*ours, *theirs):
        assert took["cpu_s"] > 0.0 and took["wall_s"] > 0.0 and took["compiled"] == 0
        assert took["mode_steps"] == ours[0]["mode_steps"] > 0


def test_what_a_side_cannot_play_is_said() -> None:
    scene = versus.scene("bass note E1, velocity 64, whole 3 s", ROOT / "presets")
    with pytest.raises(Failed, match=r"this tree: Unknown: .*no_such_option"):
        in_turn([HERE], scene | {"options": {"no_such_option": 1}}, rounds=1)


def test_a_package_that_is_not_the_sides_is_refused(tmp_path: Path) -> None:
    scene = versus.scene("bass note E1, velocity 64, whole 3 s", ROOT / "presets")
    with pytest.raises(Failed, match=r"elsewhere: (RuntimeError: .* was imported|ModuleNotFoundError)"):
        in_turn([Side("elsewhere", tmp_path)], scene, rounds=1)


def test_the_ratio_is_of_the_other_commit_to_this_tree() -> None:
    figure = {
        "section": "against", "precision": "float64", "lanes": 8, "what": "a note", "commit": "abc", "clock": "CPU",
        "theirs": [0.025, 0.05, 0.025], "seconds": [0.01, 0.02, 0.01], "work": 1.25,
    }  # fmt: skip
    text = report.markdown([figure], "a machine", whole=False)
    assert "| a note | abc | 25 ms | 10 ms | 2.5 × | 2.5 × | 1.25 × | 3, CPU |" in text


def test_without_another_commit_nothing_is_compared() -> None:
    words = [sys.executable, "-m", "pytest", "tools/benchmarks/test_against.py", "--collect-only", "-q"]
    assert f"{len(versus.NAMES)} deselected" in subprocess.run(words, cwd=ROOT, capture_output=True, text=True).stdout
    done = subprocess.run([*words, "--against=HEAD"], cwd=ROOT, capture_output=True, text=True)
    assert f"{len(versus.NAMES)} tests collected" in done.stdout


def test_a_commit_that_is_none_is_refused_before_anything_is_measured() -> None:
    words = [sys.executable, "-m", "benchmarks", "--only", "against", "--against", "no-such-commit"]
    environment = os.environ | {"PYTHONPATH": str(TOOLS)}
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.startswith("tools/bench: error: BASE must be a commit of")
