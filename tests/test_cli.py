"""The command line from outside: help, errors, exit codes; nothing is written where something was wrong."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from synth import cli

ROOT = Path(__file__).resolve().parents[1]
DRONE = str(ROOT / "presets" / "demos" / "drone.mid")


def synth(*arguments: str, cwd: Path, **options) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        [sys.executable, "-m", "synth", *arguments],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        **options,
    )


def test_help_loads_nothing_heavy() -> None:
    program = (
        "import sys\nfrom synth.cli import main\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit as end:\n    assert not end.code\n"
        "heavy = {'numba', 'numpy', 'scipy', 'soundfile', 'pydantic', 'mido'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    for arguments in (["--help"], ["render", "--help"], ["--version"]):
        command = [sys.executable, "-c", program, *arguments]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        assert done.stdout


@pytest.mark.parametrize("command", [[], ["render"], ["presets"], ["plan"], ["simulate"]])
def test_every_command_has_help(capsys, command: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main([*command, "--help"])
    assert end.value.code == 0
    assert "usage: synth" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (None, "no such file"),
        (b"", "the file is empty"),
        (b"This is no music at all.", "not a MIDI file"),
        (Path(DRONE).read_bytes()[:150], "cut off"),
    ],
)
def test_files_that_are_no_songs(tmp_path, content: bytes | None, problem: str) -> None:
    if content is not None:
        (tmp_path / "song.mid").write_bytes(content)
    before = os.listdir(tmp_path)
    done = synth("render", "song.mid", "-o", "out.wav", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("synth: error: song.mid: ")
    assert problem in done.stderr
    assert done.stderr.count("\n") == 1
    assert os.listdir(tmp_path) == before


WRONG = [
    ([], "COMMAND"),
    (["sing"], "invalid choice"),
    (["render"], "IN.mid"),
    (["render", DRONE], "nothing to write"),
    (["render", DRONE, "-o", "x.wav", "--volume", "3"], "unrecognized arguments: --volume"),
    (["render", DRONE, "-o", "x.wav", "-r", "22050"], "44100, 48000, 88200, 96000 Hz, got '22050'"),
    (["render", DRONE, "-o", "x.wav", "--block", "0"], "from 1 to 4096, got '0'"),
    (["render", DRONE, "-o", "x.wav", "--block", "64.5"], "whole number"),
    (["render", DRONE, "-o", "x.wav", "--quality", "good"], "invalid choice: 'good'"),
    (["render", DRONE, "-o", "x.wav", "--scheme", "euler"], "invalid choice: 'euler'"),
    (["render", DRONE, "-o", "x.wav", "--restitution", "0.5"], "belongs to the Moreau–Jean schemes"),
    (["render", DRONE, "-o", "x.wav", "--restitution", "1.5"], "from 0 to 1, got '1.5'"),
    (["render", DRONE, "-o", "x.wav", "--internal-rate", "100000"], "multiple of --rate"),
    (["render", DRONE, "-o", "x.wav", "--gain", "nan"], "got 'nan'"),
    (["render", DRONE, "-o", "x.wav", "--gain", "loud"], "got 'loud'"),
    (["render", DRONE, "-o", "x.wav", "--normalize", "3"], "got '3'"),
    (["render", DRONE, "-o", "x.wav", "--tail", "-1"], "expected one argument"),
    (["render", DRONE, "-o", "x.wav", "--tail=-1"], "got '-1'"),
    (["render", DRONE, "-o", "x.wav", "--tail", "inf"], "got 'inf'"),
    (["render", DRONE, "-o", "x.wav", "--start", "20", "--end", "10"], "later than --start"),
    (["render", DRONE, "-o", "x.wav", "--start", "99"], "within the song"),
    (["render", DRONE, "-o", "x.wav", "--polyphony", "0"], "got '0'"),
    (["render", DRONE, "-o", "x.wav", "--seed", "-1"], "expected one argument"),
    (["render", DRONE, "-o", "x.wav", "--bit-depth", "12"], "invalid choice: '12'"),
    (["render", DRONE, "-o", "x.wav", "--map", "17=tanpura"], "must be 1 to 16, got 17"),
    (["render", DRONE, "-o", "x.wav", "--set", "loud"], "KEY=VALUE"),
    (["render", DRONE, "-o", "x.mp3"], "does not say the format"),
    (["render", DRONE, "-o", "x.flac", "--bit-depth", "float"], "FLAC holds integers"),
    (["render", DRONE, "-o", "-", "--format", "flac"], "cannot be written to a stream"),
    (["render", DRONE, "-o", "nowhere/x.wav"], "there is no directory nowhere"),
    (["render", DRONE, "-o", "."], "does not say the format"),
    (["render", DRONE, "-o", "x.wav", "--stems", "nowhere/stems"], "parent directory is missing"),
    (["render", DRONE, "-o", "x.wav", "--tuning", "none.scl"], "none.scl: no such file"),
    (["simulate", "case.toml"], "-o/--output"),
]


@pytest.mark.parametrize(
    ("arguments", "problem"), WRONG, ids=lambda value: " ".join(value[2:])[:40] if type(value) is list else ""
)
def test_wrong_usage_is_one_line_and_exit_2(tmp_path, monkeypatch, capsys, arguments: list[str], problem: str) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        code = cli.main(arguments)
    except SystemExit as end:
        code = end.code
    said = capsys.readouterr()
    assert code == 2
    assert said.out == ""
    assert said.err.startswith("synth: error: ")
    assert problem in said.err
    assert said.err.count("\n") == 1
    assert os.listdir(tmp_path) == []


def test_normalize_takes_a_level_or_none() -> None:
    joined = cli._joined_normalize
    assert joined(["--normalize", "a.mid"]) == ["--normalize=-1", "a.mid"]
    assert joined(["a.mid", "--normalize"]) == ["a.mid", "--normalize=-1"]
    assert joined(["--normalize", "-3", "a.mid"]) == ["--normalize=-3", "a.mid"]
    assert joined(["--normalize=-3", "a.mid"]) == ["--normalize=-3", "a.mid"]
    assert joined(["--", "--normalize"]) == ["--", "--normalize"]


@pytest.mark.parametrize(("error", "code"), [(KeyboardInterrupt, 130), (BrokenPipeError, 1), (ValueError("bad"), 2)])
def test_how_a_command_ends(monkeypatch, capfd, error, code: int) -> None:
    def fail(_: object) -> int:
        raise error

    monkeypatch.setattr(cli, "_list_presets", fail)
    keep = os.dup(1)
    try:
        assert cli.main(["presets"]) == code
    finally:
        os.dup2(keep, 1)
        os.close(keep)
    assert "Traceback" not in capfd.readouterr().err


def test_termination_ends_with_143_and_restores_the_handler(monkeypatch) -> None:
    def stop(_: object) -> int:
        signal.raise_signal(signal.SIGTERM)
        return 0

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(cli, "_list_presets", stop)
    assert cli.main(["presets"]) == 143
    assert signal.getsignal(signal.SIGTERM) is before
