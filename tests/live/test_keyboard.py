"""The computer's keyboard, through real pseudo terminals."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from synth.live.keyboard import PIANO, QUIT, Keyboard
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON
from tests.patience import patience_s, until

pty = pytest.importorskip("pty")
termios = pytest.importorskip("termios")

ROOT = Path(__file__).resolve().parents[2]


def nothing() -> None:
    pass


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    master, slave = pty.openpty()
    yield master, slave
    for end in (master, slave):
        os.close(end)


class Board:
    """A keyboard whose keys are fed with their times, and what came of it."""

    def __init__(self, **settings) -> None:
        self.rows: list[tuple] = []
        self.keys: list[str] = []
        self.panics = 0
        self.keyboard = Keyboard(self._sink, self._panic, self.keys.append, **settings)

    def _sink(self, kind, channel, a, b, value, time_ns) -> bool:
        self.rows.append((kind, channel, a, b))
        return True

    def _panic(self) -> None:
        self.panics += 1

    def at(self, now: float, data: str = "") -> list[tuple]:
        self.rows.clear()
        self.keyboard.feed(data.encode(), now)
        self.keyboard.expire(now)
        return list(self.rows)


def test_two_rows_of_letters_are_a_piano() -> None:
    board = Board(octave=3, velocity=96)
    rows = board.at(1.0, PIANO)
    assert rows == [(NOTE_ON, 0, 48 + step, 96) for step in range(len(PIANO))]
    # black keys lie where the white ones leave room
    white = [PIANO.index(key) % 12 for key in "asdfghjkl;'"]
    assert white == [0, 2, 4, 5, 7, 9, 11, 0, 2, 4, 5]


def test_a_note_lasts_its_time_or_while_its_key_repeats() -> None:
    board = Board(hold_s=1.0)
    assert board.at(0.0, "a") == [(NOTE_ON, 0, 48, 96)]
    assert board.at(0.9) == []
    assert board.at(1.0) == [(NOTE_OFF, 0, 48, 64)]
    assert board.at(2.0, "aa") == [(NOTE_ON, 0, 48, 96)]
    for k in range(40):
        assert board.at(2.03 + 0.03 * k, "a") == []
    # struck again, not repeated by the keyboard
    assert board.at(3.5, "a") == [(NOTE_OFF, 0, 48, 64), (NOTE_ON, 0, 48, 96)]


def test_chords_and_octaves_and_velocities() -> None:
    board = Board()
    assert board.at(0.0, "adx") == [(NOTE_ON, 0, 48, 96), (NOTE_ON, 0, 52, 96)]
    assert board.at(0.01, "vg") == [(NOTE_ON, 0, 67, 108)]
    # the same key an octave higher ends the note that it began
    assert board.at(0.5, "ccA") == [(NOTE_OFF, 0, 48, 64), (NOTE_ON, 0, 60, 84)]
    assert {row[2] for row in board.at(5.0)} == {52, 67, 60}
    board.at(6.0, "z" * 20 + "c" * 20)
    assert (board.keyboard.octave, board.keyboard.velocity) == (-1, 1)
    board.at(6.0, "x" * 20 + "v" * 20)
    assert (board.keyboard.octave, board.keyboard.velocity) == (9, 127)
    assert board.at(7.0, "ag;") == [(NOTE_ON, 0, 120, 127), (NOTE_ON, 0, 127, 127)]


def test_sustain_silence_and_other_keys() -> None:
    board = Board(channel=5)
    assert board.at(0.0, " ") == [(CONTROL, 5, 64, 127)] and board.keyboard.sustained
    assert board.at(0.03, " ") == []
    assert board.at(1.0, " ") == [(CONTROL, 5, 64, 0)] and not board.keyboard.sustained
    board.at(1.0, "a")
    for key in ("!", "\x7f"):
        board.at(1.5, key)
    assert board.panics == 2 and board.at(9.0) == []
    board.at(9.0, "é7\x1b[A\x1bOB\x1b[1;5C\x1b[15~?\x1b[D")
    assert board.keys == ["é", "7", "up", "down", "right", "?", "left"]


def test_escape_is_a_key_and_a_beginning() -> None:
    board = Board()
    board.at(1.0, "\x1b")
    assert board.keys == []
    board.at(1.02, "[")
    board.at(1.03, "A")
    assert board.keys == ["up"]
    board.at(2.0, "\x1b")
    board.at(2.06)
    assert board.keys == ["up", QUIT]
    board.at(3.0, "q")
    assert board.keys == ["up", QUIT, QUIT]
    board.at(3.0, "\x1ba")
    assert board.keys == ["up", QUIT, QUIT, QUIT] and board.keyboard.velocity == 96


@pytest.mark.parametrize(
    "sequence",
    [
        "[1<2;3u",
        "[<u",
        "[;;u",
        "[:u",
        "[1=2A",
        "[97;1:?u",
        "[55296u",
        "[1114112u",
        "[-1u",
        "[1\x1b[<A",
        "[" + "9" * 5000 + "u",
        "[1;" + "9" * 5000 + "A",
        "O~",
    ],
)
def test_sequences_that_mean_nothing_are_left_out(sequence: str) -> None:
    board = Board()
    assert board.at(1.0, f"\x1b{sequence}") == [] and board.keys == [] and board.panics == 0
    assert board.at(1.5, "a") == [(NOTE_ON, 0, 48, 96)]


def test_a_sequence_without_an_end_is_not_kept_for_ever() -> None:
    board = Board()
    for k in range(100):
        board.at(1.0 + 0.01 * k, "\x1b[" if k == 0 else "1" * 100)
    # its beginning has been dropped, and what follows are keys
    assert set(board.keys) <= {"1"} and board.keys


def test_half_a_character_waits_for_the_other_half() -> None:
    board = Board()
    board.keyboard.feed("é".encode()[:1], 0.0)
    assert board.keys == []
    board.keyboard.feed("é".encode()[1:], 0.0)
    assert board.keys == ["é"]


def test_terminals_that_tell_of_keys_going_up_are_believed() -> None:
    board = Board(hold_s=1.0)
    assert board.at(0.0, "\x1b[97u") == [(NOTE_ON, 0, 48, 96)] and board.keyboard.tells_key_up
    assert board.at(0.1, "\x1b[100;1:1u") == [(NOTE_ON, 0, 52, 96)]
    assert board.at(0.5, "\x1b[97;1:2u") == []
    assert board.at(9.0) == []
    assert board.at(9.1, "\x1b[97;1:3u") == [(NOTE_OFF, 0, 48, 64)]
    # with Caps Lock on, and with Shift; a Shift key by itself is nothing
    assert board.at(9.2, "\x1b[100;65:3u") == [(NOTE_OFF, 0, 52, 64)]
    assert board.at(9.3, "\x1b[57441;2:1u\x1b[97:65;2:1u") == [(NOTE_ON, 0, 48, 96)]
    assert board.at(9.4, "\x1b[97:65;2:3u") == [(NOTE_OFF, 0, 48, 64)]
    board.at(9.5, "\x1b[97u")
    for number, key in enumerate(("49:33", "49"), 1):
        assert board.at(9.6, f"\x1b[{key};2:1u\x1b[{key};2:3u") == [] and board.panics == number
    assert board.at(9.7, "\x1b[32u\x1b[32;1:3u") == [(CONTROL, 0, 64, 127)]
    board.at(9.8, "\x1b[1;1:1A\x1b[1;1:3A\x1b[27u\x1b[27;1:3u\x1b[113u\x1b[113;1:3u")
    assert board.keys == ["up", QUIT, QUIT]


def test_a_terminal_is_played_and_given_back_as_it_was(terminal) -> None:
    master, slave = terminal
    before = termios.tcgetattr(slave)
    rows: list[tuple] = []
    keys: list[str] = []

    def sink(*row) -> bool:
        rows.append(row)
        return True

    began = time.monotonic_ns()
    keyboard = Keyboard(sink, nothing, keys.append, input=slave, hold_s=60.0, key_up=False)
    with keyboard:
        assert not termios.tcgetattr(slave)[3] & (termios.ECHO | termios.ICANON)
        os.write(master, b"as ?\x1b")
        until(lambda: len(keys) == 2)
    assert keys == ["?", QUIT]
    assert [row[:4] for row in rows] == [
        (NOTE_ON, 0, 48, 96),
        (NOTE_ON, 0, 50, 96),
        (CONTROL, 0, 64, 127),
        (NOTE_OFF, 0, 48, 64),
        (NOTE_OFF, 0, 50, 64),
        (CONTROL, 0, 64, 0),
    ]
    assert all(began <= row[5] <= time.monotonic_ns() for row in rows)
    assert termios.tcgetattr(slave) == before
    keyboard.close()
    os.set_blocking(master, False)
    with pytest.raises(BlockingIOError):
        os.read(master, 100)  # nothing was shown


def test_who_gets_the_terminal_back_has_let_go_of_the_keys(terminal) -> None:
    master, slave = terminal
    before = termios.tcgetattr(slave)
    rows: list[tuple] = []
    with Keyboard(lambda *row: rows.append(row[:3]) is None, nothing, input=slave, hold_s=600.0, key_up=False):
        os.write(master, b"a")
        until(lambda: rows == [(NOTE_ON, 0, 48)])
        termios.tcsetattr(slave, termios.TCSANOW, before)  # somebody else has it
        until(lambda: rows[1:] == [(NOTE_OFF, 0, 48)])
        assert not termios.tcgetattr(slave)[3] & (termios.ECHO | termios.ICANON)


def test_key_up_is_asked_for_and_taken_back(terminal, monkeypatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    master, slave = terminal
    rows: list[tuple] = []
    with Keyboard(lambda *row: rows.append(row) is None, nothing, input=slave) as keyboard:
        assert os.read(master, 100) == b"\x1b[>11u"
        os.write(master, b"\x1b[97;1:1u\x1b[97;1:3u")
        until(lambda: len(rows) == 2)
        assert keyboard.tells_key_up
    assert os.read(master, 100) == b"\x1b[<u"


def test_a_terminal_that_hangs_up_is_an_end() -> None:
    master, slave = pty.openpty()
    keys: list[str] = []
    keyboard = Keyboard(lambda *_: True, nothing, keys.append, input=slave)
    keyboard.open()
    os.close(master)
    until(lambda: keys == [QUIT])
    keyboard.close()
    os.close(slave)


def test_without_a_terminal_it_says_so() -> None:
    read, write = os.pipe()
    try:
        assert not Keyboard.available(read)
        with pytest.raises(ValueError, match="in a terminal"):
            Keyboard(lambda *_: True, nothing, input=read).open()
    finally:
        os.close(read)
        os.close(write)


PROGRAM = """
import sys, time
from synth.live.keyboard import Keyboard
keyboard = Keyboard(lambda *_: True, lambda: None)
keyboard.open()
print("open", flush=True)
{then}
"""


@pytest.mark.parametrize(
    ("then", "types", "ends"),
    [
        ("raise RuntimeError", b"", 1),
        ("while True: time.sleep(0.05)", b"\x03", -signal.SIGINT),
        ("while True: time.sleep(0.05)", b"\x1b[99;5u", -signal.SIGINT),
        ("sys.exit(3)", b"", 3),
    ],
)
def test_whatever_ends_the_program_the_terminal_is_as_it_was(terminal, then: str, types: bytes, ends: int) -> None:
    master, slave = terminal
    before = termios.tcgetattr(slave)

    def own_the_terminal() -> None:
        import fcntl

        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
        signal.signal(signal.SIGINT, signal.default_int_handler)

    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(then=then)],
        cwd=ROOT,
        stdin=slave,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        preexec_fn=own_the_terminal,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == b"open\n"
        os.write(master, types)
        assert process.wait(patience_s()) == ends
    finally:
        process.kill()
        process.communicate()
    assert termios.tcgetattr(slave) == before
