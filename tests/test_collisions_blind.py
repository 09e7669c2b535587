"""Blind scenes of the collision benchmark: the same for the same seed; references fixed before runs are scored."""

from __future__ import annotations

import json
import shutil
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from benchmarks.collisions import blind, commands, recipes, scene
from benchmarks.collisions.examples import kicks
from benchmarks.collisions.ways import way

SEED = 7
#: agrees with itself, in a moment
QUICK = way("exact-hold", 16, 60, residual_compliance=False)


def main(monkeypatch, *words) -> int:
    monkeypatch.setattr(sys, "argv", ["collisions", *map(str, words)])
    return commands.main()


@pytest.fixture
def quick(monkeypatch, tmp_path):
    monkeypatch.setattr(recipes, "BLIND", recipes.Recipe(QUICK, {"itself": QUICK}, {"itself": QUICK}))
    monkeypatch.setattr(commands, "OUT", tmp_path / "out")
    monkeypatch.setattr(blind, "DURATION_S", 0.05)
    monkeypatch.setattr(blind, "WINDOWS_S", [0.02, 0.05])


def test_draws_are_those_of_their_seed():
    first, again = blind.drawn(SEED, 0), blind.drawn(SEED, 0)
    assert first == again and blind.drawn(SEED, 1) != first and blind.drawn(SEED + 1, 0) != first
    points = {len(blind.drawn(SEED, number)["obstacle"]["positions_m"]) for number in range(20)}
    assert 1 in points and max(points) > 4  # bridges and frets


def test_scenes_are_handed_out_and_references_kept(tmp_path, monkeypatch, capsys, quick):
    """As docs/collisions.md says: a solver sees the scenes alone, the evaluator scores; a changed reference is refused."""
    folder, run, found = tmp_path / "kept", tmp_path / "run.npz", tmp_path / "found.json"
    assert main(monkeypatch, "blind", folder, "--seed", SEED, "--scenes", 2) == 0
    names = capsys.readouterr().out.split()
    assert len(names) == 2 and sorted(path.name for path in folder.iterdir()) == ["manifest.json", "references", "scenes"]
    assert json.loads((folder / "manifest.json").read_text(encoding="utf-8")) == scene.manifest(folder)

    handed = tmp_path / "handed"
    shutil.copytree(folder / "scenes", handed / "scenes")
    shutil.copy(folder / "manifest.json", handed)
    numbers = json.loads((handed / "scenes" / f"{names[0]}.json").read_text(encoding="utf-8"))
    u, _ = kicks.solve(numbers, 4, 60)
    np.savez(run, scene=names[0], rate_hz=numbers["rate_hz"], u=u)
    assert main(monkeypatch, "score", run) == 2  # not one of the benchmark's
    assert f"scene '{names[0]}'" in capsys.readouterr().err
    assert main(monkeypatch, "score", "--blind", handed, run) == 2
    assert f"{names[0]}.npz does not exist" in capsys.readouterr().err
    assert main(monkeypatch, "score", "--blind", folder, run, "--json", found) == 0
    told = json.loads(found.read_text(encoding="utf-8"))
    assert told["manifest"] == scene.digest(folder / "manifest.json") and 0.0 < told["scores"][0]["e"][0] < 0.5
    assert main(monkeypatch, "score", "--blind", folder, run, "--entry", tmp_path / "e.json") == 2
    assert "no blind scenes" in capsys.readouterr().err

    changed = tmp_path / "changed"
    shutil.copytree(folder, changed)
    np.savez_compressed(changed / "references" / f"{names[0]}.npz", u=u.astype(np.float32))
    assert main(monkeypatch, "score", "--blind", changed, run) == 2
    assert "is not the one that manifest.json names" in capsys.readouterr().err


def test_the_same_seed_makes_the_same_scenes_anywhere(tmp_path, quick):
    for part in ("a", "b"):
        blind.draw(tmp_path / part, SEED, 1, tmp_path / "out", lambda words: None)
    (name,) = scene.names(tmp_path / "a")
    texts = [(tmp_path / part / "scenes" / f"{name}.toml").read_text(encoding="utf-8") for part in ("a", "b")]
    assert texts[0] == texts[1] and tomllib.loads(texts[0])["string"] == blind.drawn(SEED, 0)["string"]


def test_scenes_whose_references_do_not_stand_are_left_out(tmp_path, monkeypatch, capsys, quick):
    """No folder where none stands; a folder that exists is left as it is."""
    coarse = way("exact-hold", 1, 2, residual_compliance=False)
    monkeypatch.setattr(recipes, "BLIND", recipes.Recipe(QUICK, {"coarse": coarse}, {"itself": QUICK}))
    assert main(monkeypatch, "blind", tmp_path / "none", "--seed", SEED, "--scenes", 1) == 2
    assert "only 0 of 5 draws have a reliable reference" in capsys.readouterr().err
    assert not (tmp_path / "none").exists() and [path.name for path in tmp_path.iterdir()] == ["out"]
    assert main(monkeypatch, "blind", tmp_path, "--seed", SEED) == 2
    assert "exists; name a new folder" in capsys.readouterr().err
    assert main(monkeypatch, "blind", tmp_path / "x" / "y", "--seed", SEED) == 2
    assert "parent folder does not exist" in capsys.readouterr().err
    assert main(monkeypatch, "blind", tmp_path / "x", "--seed", -1) == 2
    assert "--seed must be 0 or more" in capsys.readouterr().err
