"""Compiled kernels are kept apart by the sources they come from."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import synth

PACKAGE = Path(synth.__file__).parent


def folder(root: Path, cache: Path) -> Path:
    """The cache folder that a copy of the package under `root` chooses."""
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    told = subprocess.run(
        [sys.executable, "-c", "import os, synth; print(os.environ['NUMBA_CACHE_DIR'])"],
        cwd=root,
        env={**environment, "XDG_CACHE_HOME": str(cache), "PYTHONPATH": str(root), "HOME": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    return Path(told.stdout.strip())


@pytest.mark.parametrize(
    "changed",
    [
        "solver/lcp.py", "engine/voices/voice_table.py", "native/arrays.py", "midi/events.py", "dsp/effect.py",
        "instrument/excitations.py", "units.py",
    ],
)  # fmt: skip
def test_a_changed_kernel_or_constant_has_another_folder(tmp_path: Path, changed: str) -> None:
    shutil.copytree(PACKAGE, tmp_path / "synth", ignore=shutil.ignore_patterns("__pycache__"))
    first = folder(tmp_path, tmp_path / "cache")
    assert folder(tmp_path, tmp_path / "cache") == first
    with open(tmp_path / "synth" / "cli" / "render.py", "a") as file:
        file.write("\n# no kernel\n")
    assert folder(tmp_path, tmp_path / "cache") == first
    with open(tmp_path / "synth" / changed, "a") as file:
        file.write("\n# another kernel\n")
    assert folder(tmp_path, tmp_path / "cache") != first


def test_old_folders_go(tmp_path: Path) -> None:
    shutil.copytree(PACKAGE, tmp_path / "synth", ignore=shutil.ignore_patterns("__pycache__"))
    base = folder(tmp_path, tmp_path / "cache").parent
    for i in range(20):
        (base / f"kernels-{i:04d}").mkdir()
    with open(tmp_path / "synth" / "solver" / "lcp.py", "a") as file:
        file.write("\n# another kernel\n")
    folder(tmp_path, tmp_path / "cache")
    assert len(list(base.glob("kernels-*"))) == 8


def test_a_folder_that_another_process_makes_at_the_same_moment_will_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, looks, is_dir = tmp_path / "jawari" / "kernels-0", [], Path.is_dir

    def not_there_yet(path: Path) -> bool:
        if not looks:
            looks.append(path)
            folder.mkdir(parents=True)
            return False
        return is_dir(path)

    monkeypatch.setattr(Path, "is_dir", not_there_yet)
    from synth.jit.kernel_cache import _make

    _make(folder)
    assert looks == [folder] and is_dir(folder)


def test_two_checkouts_of_the_same_sources_share_what_was_compiled(tmp_path: Path) -> None:
    text = "from synth.solver.lcp import single; print(single(2.0, -1.0), *single.stats.cache_hits.values())"
    environment = {k: v for k, v in os.environ.items() if k != "NUMBA_CACHE_DIR"}
    environment |= {"XDG_CACHE_HOME": str(tmp_path / "cache")}
    hits = []
    for name in ("first", "second"):
        shutil.copytree(PACKAGE, tmp_path / name / "synth", ignore=shutil.ignore_patterns("__pycache__"))
        told = subprocess.run(
            [sys.executable, "-c", text],
            cwd=tmp_path / name,
            env={**environment, "PYTHONPATH": str(tmp_path / name)},
            capture_output=True,
            text=True,
            check=True,
        )
        hits.append(told.stdout.split())
    assert hits == [["0.5"], ["0.5", "1"]]
