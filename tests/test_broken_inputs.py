"""Broken files of every kind are taken or refused: tools/break-inputs with fewer of them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import IO

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from break_inputs import trial
from break_inputs.watch import TOOLS, tried

from tests.forkserver import Forked, prepared

ENOUGH = 15


@pytest.fixture
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers have their imports behind them."""

    def start(arguments: list[str], errors: IO[str]) -> Forked:
        find = f"import sys\nsys.path.insert(0, {str(TOOLS)!r})"
        pipes = {"stdout": subprocess.PIPE, "stderr": errors.fileno()}
        return prepared().start(arguments, TOOLS, module="break_inputs.worker", before=find, **pipes)

    monkeypatch.setattr("break_inputs.watch.start", start)


@pytest.mark.parametrize("kind", trial.KINDS)
@pytest.mark.usefixtures("forked")
def test_a_broken_input_is_taken_or_refused(kind: str) -> None:
    tally = tried(kind, 0, ENOUGH, seed=2)
    assert not tally.broke, tally.broke
    assert tally.taken + tally.refused == ENOUGH


def test_the_trial_sees_what_must_not_happen(monkeypatch: pytest.MonkeyPatch) -> None:
    def changes_its_input(arguments: list[str]) -> int:
        Path(arguments[1]).write_bytes(b"gone")
        return 2

    monkeypatch.setattr(trial, "main", changes_its_input)
    with pytest.raises(trial.Broke, match="without a reason"):
        trial.attempt("midi", b"MThd")

    def leaves_a_file(arguments: list[str]) -> int:
        Path(arguments[1]).with_name(".part").write_bytes(b"half")
        sys.stderr.write("synth: error: no\n")
        return 2

    monkeypatch.setattr(trial, "main", leaves_a_file)
    with pytest.raises(trial.Broke, match=r"left behind: \.part"):
        trial.attempt("midi", b"MThd")

    def loses_its_input(arguments: list[str]) -> int:
        Path(arguments[1]).unlink()
        sys.stderr.write("synth: error: no\n")
        return 2

    monkeypatch.setattr(trial, "main", loses_its_input)
    with pytest.raises(trial.Broke, match="lost or changed"):
        trial.attempt("midi", b"MThd")


def test_a_crash_and_a_hang_are_seen(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The watch goes on behind the input that ended its worker."""
    package = tmp_path / "break_inputs"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "worker.py").write_text(
        "import json, os, signal, sys\n"
        "for n in range(int(sys.argv[2]), int(sys.argv[3])):\n"
        "    print(json.dumps({'at': n}), flush=True)\n"
        "    if n in (1, 2):\n"
        "        os.kill(os.getpid(), signal.SIGSEGV if n == 1 else signal.SIGPROF)\n"
        "    print(json.dumps({'of': n, 'came': 'taken', 'took': 0.1}), flush=True)\n"
    )
    monkeypatch.setattr("break_inputs.watch.TOOLS", tmp_path)
    tally = tried("midi", 0, 4, seed=1)
    assert tally.taken == 2
    assert [number for number, _ in tally.broke] == [1, 2]
    assert "SIGSEGV" in tally.broke[0][1] and "hung" in tally.broke[1][1]
