"""`synth` alone, and colours."""

import io

import pytest

from synth import __version__, cli
from synth.cli import colours, greeting


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_synth_alone_greets_with_three_things_to_try(capsys) -> None:
    assert cli.main([]) == 0
    said = capsys.readouterr()
    assert said.err == "" and __version__ in said.out
    assert [word for _, word, *_ in (line.split() for line in said.out.splitlines() if line.startswith("  synth"))] == [
        "render",
        "play",
        "author",
    ]
    assert "synth doctor" in said.out and "synth --help" in said.out
    assert len(said.out.splitlines()) <= 12 and max(map(len, said.out.splitlines())) <= 80


def test_what_the_greeting_says_is_understood() -> None:
    typed = [line for line, _ in greeting.TRY] + ["synth drone -o drone.wav --duration 30"]
    assert typed[-1] in greeting.REST
    for line in typed:
        cli.command_parser().parse_args(line.split()[1:])


@pytest.mark.parametrize("arguments", [["--loud"], ["sing"]])
def test_what_is_no_command_is_no_greeting(capsys, arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(arguments)
    said = capsys.readouterr()
    assert end.value.code == 2 and said.out == "" and said.err.startswith("synth: error: ")


@pytest.mark.parametrize(
    ("environment", "stream", "coloured"),
    [
        ({}, Terminal(), True),
        ({"NO_COLOR": ""}, Terminal(), True),  # no-color.org: only one that is not empty counts
        ({"NO_COLOR": "1"}, Terminal(), False),
        ({"TERM": "dumb"}, Terminal(), False),
        ({}, io.StringIO(), False),
        ({}, None, False),
        ({}, object(), False),
    ],
)
def test_colours_are_for_terminals_that_want_them(monkeypatch, environment, stream, coloured: bool) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm-256color")
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert colours.wanted(stream) == coloured
    assert colours.shown("error:", colours.FAULT, stream) == ("\x1b[1;31merror:\x1b[0m" if coloured else "error:")


def test_a_stream_that_is_closed_has_no_colours(tmp_path) -> None:
    with open(tmp_path / "file", "w", encoding="utf-8") as stream:
        pass
    assert not colours.wanted(stream)


def test_a_windows_console_must_say_that_it_knows_colours(monkeypatch) -> None:
    for name in ("NO_COLOR", *colours._KNOWS_COLOURS):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(colours.sys, "platform", "win32")
    assert not colours.wanted(Terminal())
    monkeypatch.setenv("WT_SESSION", "0000")
    assert colours.wanted(Terminal())


@pytest.mark.parametrize("arguments", [["sing"], ["presets", "show", "tampura"]])
def test_errors_are_coloured_on_terminals_only(monkeypatch, arguments: list[str]) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for kind, begins in ((Terminal, "synth: \x1b[1;31merror:\x1b[0m "), (io.StringIO, "synth: error: ")):
        monkeypatch.setattr("sys.stderr", stream := kind())
        try:
            assert cli.main(arguments) == 2
        except SystemExit as end:
            assert end.code == 2
        assert stream.getvalue().startswith(begins)
        assert stream.getvalue().count("\x1b") == 2 * (kind is Terminal)
