"""The keys of `synth play` and `synth drone`: one list for help and handler, pressed at real terminals."""

from __future__ import annotations

import json
import os
import re
import struct
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from synth.drone.cycle import Cycle, Drone
from synth.drone.pegs import Pegs, tuned
from synth.drone.tanpura_keys import TanpuraKeys
from synth.drone.tanpura_keys import keys_of as drone_keys_of
from synth.engine.engine import Unplayed
from synth.instrument.preset import load_preset
from synth.live.keyboard import PIANO
from synth.live.keylist import Binding, KeyList
from synth.live.paragraph import TIE, columns, folded
from synth.live.playkeys import PlayKeys, keys_of
from synth.live.unplayable import TOLD_S, Unplayable
from synth.midi.events import CONTROL, NOTE_ON
from synth.midi.song import read_song
from tests.forkserver import prepared
from tests.patience import COMPILING_QUIET_S, patience_s, until

from .jackkit import JackServer
from .test_play import QUIET, SONG, environment, is_beginning, synth

pty = pytest.importorskip("pty")
fcntl = pytest.importorskip("fcntl")
termios = pytest.importorskip("termios")


# --- the lists


class Transport:
    """A song that notes what is wished of it."""

    def __init__(self) -> None:
        self.wishes: list[object] = []

    def toggle(self) -> None:
        self.wishes.append("toggle")

    def move(self, seconds: float) -> None:
        self.wishes.append(seconds)

    def move_to_start(self) -> None:
        self.wishes.append("start")


def test_a_key_is_bound_once() -> None:
    with pytest.raises(ValueError, match="'q' is bound to quit and to other"):
        KeyList(Binding("quit", ("q",), "q", "end"), Binding("other", ("x", "q"), "x q", "other"))


@pytest.mark.parametrize(("instrument", "song"), [(True, True), (True, False), (False, True)])
def test_every_key_of_play_is_listed_and_acted_upon(instrument: bool, song: bool) -> None:
    keys = keys_of(instrument=instrument, song=song)
    transport, said, ended = Transport(), [], []
    acting = PlayKeys(keys, transport if song else None, said.append, lambda: ended.append(True))
    for binding in keys.bindings:
        assert f"{binding.shown} {binding.does}" in acting.help.replace(TIE, " ")
        for key in binding.keys:
            before = len(transport.wishes) + len(said) + len(ended)
            acting.press(key)
            of_the_instrument = binding.action in ("note", "octave", "velocity", "sustain", "silence")
            assert len(transport.wishes) + len(said) + len(ended) == before + (not of_the_instrument), key
    assert ended and said == [acting.help]
    assert (set(PIANO) <= {key for binding in keys.bindings for key in binding.keys}) == instrument
    if song:
        assert set(transport.wishes) == {"toggle", "start", -5.0, 5.0, -30.0, 30.0}
    acting.press("#")
    assert len(said) == 1


@pytest.mark.parametrize("strings", [4, 5])
def test_every_key_of_a_drone_is_listed_and_acted_upon(strings: int) -> None:
    pegs = Pegs(load_preset("tanpura-light"), 130.8, 1.5, 1.875 if strings == 5 else None, False, ())
    drone = Drone(tuned(pegs, None), Cycle(), 44100.0)
    said: list[str] = []
    ended: list[bool] = []
    keys = TanpuraKeys(drone, said.append, lambda: ended.append(True))
    for binding in drone_keys_of(strings).bindings:
        assert f"{binding.shown} {binding.does}" in keys.help.replace(TIE, " ")
        for key in binding.keys:
            before = len(said) + len(ended)
            keys.press(key)
            assert len(said) + len(ended) == before + 1, key
    assert f"1-{strings} choose" in keys.help.replace(TIE, " ") and len(ended) == 4
    before = len(said)
    keys.press(str(strings + 1))
    keys.press("#")
    assert len(said) == before


# --- text at a terminal


def test_words_are_not_broken_and_pairs_stay_together() -> None:
    text = keys_of(instrument=True, song=True).help
    for width in (24, 40, 60, 80, 200):
        lines = folded(text, width, first="synth: ").split("\n")
        tied = [pair.replace(TIE, " ") for pair in text.removeprefix("keys: ").split("   ") if TIE in pair]
        for pair in tied:
            assert any(pair in line for line in lines), (width, pair)
        assert all(len(line) <= width or line.strip() in tied for line in lines)
        assert lines[0].startswith("synth: ") and all(line == line.rstrip() for line in lines)
    assert folded("one\n  two words", 20) == "one\n  two words"


def test_the_width_is_that_of_the_terminal_written_to(monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "77")
    master, slave = pty.openpty()
    try:
        with open(slave, "w", closefd=False) as terminal:
            assert columns(terminal) == 77  # it does not say
            fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 53, 0, 0))
            assert columns(terminal) == 53
    finally:
        os.close(master)
        os.close(slave)


# --- notes that no string plays


def test_a_note_without_a_string_says_why_until_another_is_played() -> None:
    harp, tanpura = load_preset("jawari-harp"), load_preset("tanpura-light")
    seen = Unplayable([harp, tanpura], frozenset({60}))
    assert seen.look(None, 40, 0.0) == ""
    counts = [Unplayed(0, 20, 1, "")]
    assert seen.look(counts, 20, 1.0) == "G#0 silent: below E1"
    assert seen.look(None, 20, 1.0 + TOLD_S / 2) == "G#0 silent: below E1"
    assert seen.look(None, 20, 1.1 + TOLD_S) == ""
    counts = [Unplayed(0, 20, 1, ""), Unplayed(0, 120, 2, "")]
    assert seen.look(counts, 120, 9.0) == "C9 silent: above C7"
    assert seen.look(None, 60, 9.1) == ""  # another one, which sounds
    assert seen.look([*counts, Unplayed(0, 60, 1, "")], 60, 9.2) == "C4 silent: not in the scale"
    assert seen.look([*counts, Unplayed(1, 44, 1, "")], 44, 9.3) == "G#2 silent: no string has it"
    assert seen.look([*counts, Unplayed(-1, 44, 1, "")], 44, 9.4) == "G#2 silent: no preset (--map)"


# --- at a terminal


class AtTerminal:
    """A command that runs at a terminal of its own, of so many columns."""

    def __init__(self, server: JackServer, folder: Path, arguments: tuple[str, ...], wide: int) -> None:
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, wide, 0, 0))
        env = {name: value for name, value in environment(server).items() if name != "COLUMNS"} | {"TERM": "xterm"}
        self.process = prepared().start(
            list(arguments), folder, env=env, stdin=slave, stdout=slave, stderr=slave, terminal=True
        )
        os.close(slave)
        self._shown = b""
        self._from = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self._master, 4096)
            except OSError:  # its other end has gone
                return
            self._shown += data

    @property
    def shown(self) -> str:
        """All of it, without the ends of lines as terminals have them."""
        return self._shown.decode(errors="replace").replace("\r\n", "\n")

    def wait_for(self, *texts: str) -> None:
        """Until all of them have been shown since the last key."""
        until(
            lambda: all(text in self.shown[self._from :] for text in texts) or self.process.poll() is not None,
            texts,
            COMPILING_QUIET_S,
        )
        assert all(text in self.shown[self._from :] for text in texts), self.shown[-2000:]

    @property
    def position(self) -> int:
        """Where the song was when it was shown last, below a minute [s]."""
        return int(re.findall(r"0:(\d\d) / ", self.shown)[-1])

    def press(self, keys: bytes) -> None:
        self._from = len(self.shown)
        os.write(self._master, keys)

    def ended(self) -> int:
        code = self.process.wait(patience_s())
        self._reader.join(patience_s())
        return code

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self._reader.join(patience_s())
        os.close(self._master)


Begin = Callable[..., AtTerminal]


@pytest.fixture
def at_terminal(jack_server, tmp_path) -> Iterator[Begin]:
    """at_terminal(…, wide=80): `synth …` at a terminal, in tmp_path."""
    begun: list[AtTerminal] = []

    def begin(*arguments: str, wide: int = 80) -> AtTerminal:
        begun.append(AtTerminal(jack_server(), tmp_path, arguments, wide))
        return begun[-1]

    yield begin
    for each in begun:
        each.close()


def test_a_song_obeys_the_keys_and_the_take_has_it_all(at_terminal: Begin, tmp_path: Path) -> None:
    at = at_terminal("play", "--play", SONG, *QUIET, "--record", "take.wav", "--json")
    at.wait_for("keys: space pause", "0:00 / 0:19")
    at.wait_for("0:01 / 0:19")
    at.press(b" ")
    at.wait_for("paused 0:")
    stood = at.position
    at.press(b"\x1b[C\x1b[C")
    at.wait_for(f"paused 0:{min(19, stood + 10):02} / 0:19")
    at.press(b"\x1b[A")
    at.wait_for("paused 0:19 / 0:19")
    at.press(b"\x1b[B")
    at.wait_for("paused 0:00 / 0:19")
    at.press(b"\x1b[C")
    at.wait_for("paused 0:05 / 0:19")
    at.press(b" ")
    for key, least in ((b"\x1b[D", 6), (b"\x1b[H", 3)):  # some seconds back, in which it must be shown
        until(lambda least=least: at.position >= least)  # type: ignore[misc]
        at.press(key)
        until(lambda least=least: at.position < least, key)  # type: ignore[misc]
    at.press(b"?")
    at.wait_for("30 s back/on", "q Esc Ctrl-D end")
    at.press(b"q")
    assert at.ended() == 0
    # Numba's messages have colorama, where that is installed, put the terminal's colours back at the end
    report = json.loads(at.shown[at.shown.rindex("{\n") :].removesuffix("\x1b[0m"))
    assert report["ended"] == "stopped" and report["events_lost"] == 0
    done = synth(None, tmp_path, "render", "take.mid", "-o", "again.wav", "--quiet", "--tail", "1")
    assert done.returncode == 0, done.stderr
    assert is_beginning(tmp_path / "take.wav", tmp_path / "again.wav")
    # The song began twice: its first note is there at least as often.
    song, take = (read_song(path, 44100).events for path in (SONG, tmp_path / "take.mid"))
    first = song[song["kind"] == NOTE_ON][0]
    assert np.count_nonzero((take["kind"] == NOTE_ON) & (take["a"] == first["a"]) & (take["b"] == first["b"])) >= 2


@pytest.mark.parametrize("end", [b"q", b"\x1b", b"\x04", b"\x03"], ids=["q", "Esc", "Ctrl-D", "Ctrl-C"])
def test_every_key_that_ends_a_song_ends_it(at_terminal: Begin, end: bytes) -> None:
    at = at_terminal("play", "--play", SONG, *QUIET)
    at.wait_for("0:00 / 0:19")
    at.press(end)
    assert at.ended() == 0 and "played 0:0" in at.shown


def test_the_computer_keyboard_plays_along_and_has_its_help(at_terminal: Begin, tmp_path: Path) -> None:
    at = at_terminal("play", "--play", SONG, *QUIET, "-p", "jawari-harp", "--keys", "--record", "take.wav")
    at.wait_for("play from C on", "0:00 / 0:19")
    at.press(b"\r")
    at.wait_for("paused")
    at.press(b"zz" + b"a x")  # C1, which the harp has no string for
    at.wait_for("C1 silent: below E1")
    at.press(b"0?")
    at.wait_for("paused 0:00 / 0:19", "space sustain", "enter pause")
    at.press(b"q")
    assert at.ended() == 0 and "not played: 1 × C1" in at.shown
    events = read_song(tmp_path / "take.mid", 44100).events
    assert np.any((events["kind"] == CONTROL) & (events["a"] == 64) & (events["b"] == 127))


@pytest.mark.parametrize("wide", [40, 61])
def test_nothing_is_wider_than_the_terminal(at_terminal: Begin, wide: int) -> None:
    at = at_terminal("play", "-p", "tanpura-light", *QUIET, wide=wide)
    at.wait_for("synth: keys:", "load")
    at.press(b"?")
    at.wait_for("c v velocity")
    at.press(b"xxxxa")
    at.wait_for("C7 silent")
    at.press(b"q")
    assert at.ended() == 0
    begun = at.shown.index("synth: playing")
    for line in at.shown[begun:].split("\n"):
        for shown in line.split("\r"):
            assert len(shown) < wide, shown


def test_a_drone_lists_its_keys_and_ends_by_all_that_end(at_terminal: Begin) -> None:
    at = at_terminal("drone", "--quality", "draft", wide=70)
    at.wait_for("1-4 choose a string", "load")
    at.press(b"5")
    at.press(b"4")
    at.wait_for("[kharaj]")
    at.press(b"?")
    at.wait_for("left right less/more human")
    at.press(b"\x1b")
    assert at.ended() == 0
    assert all(len(line) < 70 for text in at.shown.split("\n") for line in text.split("\r"))
