"""What is read is bounded, comes through pipes where that makes sense, and is a file where it must be."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from synth.cli import main
from synth.files.sources import read_bytes, read_file
from synth.instrument.preset import preset_folder
from tests.patience import compiling_s

TANPURA = preset_folder() / "tanpura-light.toml"


def test_a_file(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_bytes(b"abc")
    assert read_bytes(path, 3, "thing") == read_file(path, 3, "thing") == b"abc"
    for read in (read_bytes, read_file):
        with pytest.raises(ValueError, match="x: larger than 0 MB, the limit for a thing"):
            read(path, 2, "thing")
        with pytest.raises(FileNotFoundError):
            read(tmp_path / "y", 2, "thing")


def test_a_pipe_is_read_to_its_end_or_refused(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=pipe.write_bytes, args=(b"abc",))
    writer.start()
    assert read_bytes(pipe, 3, "thing") == b"abc"
    writer.join()
    with pytest.raises(ValueError, match="pipe: is a pipe, not a regular file"):  # and nobody writes to it now
        read_file(pipe, 3, "thing")


def test_a_link(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"abc")
    (tmp_path / "link").symlink_to(tmp_path / "x")
    assert read_file(tmp_path / "link", 3, "thing") == b"abc"
    with pytest.raises(ValueError, match="link: is a link, not a regular file"):
        read_file(tmp_path / "link", 3, "thing", follow=False)


def test_what_changes_between_two_looks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was a file when it was looked at, and is a pipe when it is opened."""
    path, pipe = tmp_path / "x", tmp_path / "pipe"
    path.write_bytes(b"abc")
    os.mkfifo(pipe)
    opened = os.open

    def replaced(name: Path, flags: int) -> int:
        os.replace(pipe, path)
        return opened(name, flags)

    monkeypatch.setattr(os, "open", replaced)
    with pytest.raises(ValueError, match="x: is a pipe, not a regular file"):
        read_file(path, 3, "thing")


@pytest.mark.parametrize("arguments", [["presets", "show"], ["presets", "check"], ["plan"]])
def test_presets_come_through_pipes(arguments: list[str]) -> None:
    """As a shell's <(…) has it."""
    reading, writing = os.pipe()
    try:
        feeder = subprocess.Popen(["cat", str(TANPURA)], stdout=writing)
        os.close(writing)
        done = subprocess.run(
            [sys.executable, "-m", "synth", *arguments, f"/dev/fd/{reading}"],
            cwd=Path(__file__).resolve().parents[1],
            pass_fds=[reading],
            capture_output=True,
            text=True,
            timeout=compiling_s(),
        )
        feeder.wait()
    finally:
        os.close(reading)
    assert done.returncode == 0 and done.stderr == "" and "tanpura-light" in done.stdout.lower()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["presets", "show", "/dev/zero"], "/dev/zero: larger than 1 MB, the limit for a preset"),
        (["presets", "check", "/dev/zero"], "/dev/zero: larger than 1 MB, the limit for a preset"),
        (["render", "/dev/zero", "-o", "x.wav"], "/dev/zero: larger than 256 MB, the limit for a MIDI file"),
        (["presets", "show", "."], "'.' is not one of"),
        (["presets", "show", "nothing.toml"], "nothing.toml does not exist"),
    ],
)
def test_what_has_no_end(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert words in said and said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
