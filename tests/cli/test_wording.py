"""What the command line says of wrong words, of long ones, and where memory or a reader is missing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest

from synth import cli
from synth.cli import render
from synth.cli.common import shortened
from synth.files.sources import read_bytes
from synth.files.targets import write_whole
from tests.patience import until


@pytest.mark.parametrize(
    ("words", "suggested"),
    [
        (["rendr", "a.mid"], "'rendr' (perhaps render?)"),
        (["render", "a.mid", "--quailty", "fine"], "--quailty (perhaps --quality?)"),
        (["render", "a.mid", "--quality", "standart"], "'standart' (perhaps standard?)"),
        (["presets", "chek", "a.toml"], "'chek' (perhaps check?)"),
    ],
)
def test_a_word_that_is_nearly_one_is_suggested(
    words: list[str], suggested: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(words)
    said = capsys.readouterr().err
    assert end.value.code == 2 and suggested in said and said.count("\n") == 1


def test_long_values_are_shown_by_their_beginning() -> None:
    assert shortened("--first: got 'x'") == "--first: got 'x'"
    assert shortened(f"got {'x' * 9000!r}; remedy") == f"got '{'x' * 59}… (9002 characters); remedy"
    assert len(shortened(f"no {'a' * 500}, no {'b' * 500}")) < 200
    path = "/tmp/" + "/".join(["folder" * 5] * 20) + "/a.mid"
    assert shortened(f"{path}: is a directory") == f"{path}: is a directory"


@pytest.mark.parametrize(
    "words", [["drone", "-o", "x.wav", "--first", "x" * 9000], ["render", "a.mid", "--quality", "y" * 9000]]
)
def test_no_message_echoes_a_page(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    try:
        assert cli.main(words) == 2
    except SystemExit as end:
        assert end.code == 2
    said = capsys.readouterr().err
    assert len(said) < 600 and "(900" in said


def test_too_little_memory_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def none_left(*_: object) -> str:
        raise MemoryError

    monkeypatch.setattr(render, "_default_output", none_left)
    monkeypatch.chdir(Path(__file__).parent)
    assert cli.main(["render", "a.mid"]) == 2
    said = capsys.readouterr().err
    assert "not enough memory" in said and said.count("\n") == 1


def test_a_small_file_asks_for_little_memory(tmp_path: Path) -> None:
    path = tmp_path / "small.mid"
    path.write_bytes(b"MThd")
    tracemalloc.start()
    try:
        assert read_bytes(path, 1 << 28, "song") == b"MThd"
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()
    with pytest.raises(ValueError, match="larger than"):
        read_bytes(path, 3, "song")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names on this system")
def test_a_pipe_without_a_reader_is_waited_for_aloud(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    text = "import sys; from synth.files import targets; targets.write_whole(sys.argv[1], lambda file: file.write(b'sound'))"
    said = tmp_path / "said"
    with open(said, "wb") as errors:
        program = subprocess.Popen(
            [sys.executable, "-c", text, str(pipe)], stderr=errors, cwd=Path(__file__).parents[2]
        )  # fmt: skip
        assert until(lambda: b"waiting for a program to read this pipe" in said.read_bytes(), "nothing is said")
        assert pipe.read_bytes() == b"sound"
        assert program.wait() == 0


def test_a_pipe_with_a_reader_is_written_to_without_a_word(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    write_whole(pipe, lambda file: file.write(b"sound"))
    assert os.read(reader, 100) == b"sound" and capsys.readouterr().err == ""
    os.close(reader)


@pytest.mark.skipif(shutil.which("cat") is None or not hasattr(os, "mkfifo"), reason="no cat, or no pipes with names")
def test_a_reader_that_waits_gets_everything(tmp_path: Path) -> None:
    """…and sees no end before the beginning."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for _ in range(20):
        with subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE) as reader:
            write_whole(pipe, lambda file: file.write(b"sound"))
            assert reader.stdout is not None and reader.stdout.read() == b"sound"
