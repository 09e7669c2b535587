"""What a live session is made of that needs no sound: who plays what, the line on the terminal, how it is asked to end."""

import io
import math
import os
import signal
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from synth.cli.common import asked_by_signals
from synth.host import parts
from synth.host.render import RenderSettings
from synth.live.latency import TimeSpread, quickest_note
from synth.live.player import AHEAD_S, Player
from synth.live.session import Session, SessionSettings, Stop
from synth.live.status import Status, StatusLine, clock_text, status_text
from synth.midi.events import EVENT, NOTE_ON, make_events
from synth.midi.eventsource import from_events
from synth.native import stderr
from synth.native.patience import CALL_S, LEAVE_S, Worker, answers
from tests.host.midibytes import header, off, on, track

RATE_HZ = 44100


def test_by_default_programs_choose_one_of_two_parts_on_every_channel_but_ten() -> None:
    made = parts.cast_live(parts.Choice(gm=False))
    assert [part.preset for part in made.parts] == ["jawari-harp", "fretted-bass"]
    for channel in range(16):
        if channel == 9:
            assert (made.program_map[9] == -1).all()
            continue
        assert np.flatnonzero(made.program_map[channel] == 1).tolist() == list(range(32, 40))
        assert np.count_nonzero(made.program_map[channel] == 0) == 120


def test_one_part_per_preset_shared_by_its_channels() -> None:
    made = parts.cast_live(parts.Choice("tanpura-light", {2: "mine.toml", 4: "tanpura-light", 5: "none", 9: "mine.toml"}))
    assert [part.preset for part in made.parts] == ["tanpura-light", "mine.toml"]
    expected = [0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0]
    assert made.program_map[:, 0].tolist() == expected
    assert (made.program_map == made.program_map[:, :1]).all()


def test_one_channel_alone_and_none_at_all() -> None:
    made = parts.cast_live(parts.Choice("tanpura-light"), only_channel=4)
    assert np.flatnonzero((made.program_map >= 0).any(axis=1)).tolist() == [4]
    with pytest.raises(ValueError, match="no channel has a preset"):
        parts.cast_live(parts.Choice(None, {3: "none"}), only_channel=3)


def test_a_song_keeps_its_parts_and_others_share_them() -> None:
    choice = parts.Choice(gm=False)
    song = parts.cast({(0, 0): 5, (0, 33): 2, (1, 0): 3}, choice)
    assert [part.label for part in song.parts] == ["ch01-jawari-harp", "ch01-fretted-bass", "ch02-jawari-harp"]
    made = parts.cast_live(choice, song=song)
    assert made.parts == song.parts
    kept = song.program_map >= 0
    np.testing.assert_array_equal(made.program_map[kept], song.program_map[kept])
    assert made.program_map[1, 5] == 2  # the channel's own harp, not the first
    assert made.program_map[1, 33] == 1 and made.program_map[7, 0] == 0
    assert song.program_map[7, 0] == -1


class Ring:
    """A deck's ring for a known number of events."""

    def __init__(self, room: int) -> None:
        self.frame, self.room = 0, room
        self.taken: list[int] = []

    def schedule(self, events: np.ndarray) -> int:
        count = min(self.room - len(self.taken), len(events))
        self.taken += events["frame"][:count].tolist()
        return count


def test_a_player_keeps_a_full_ring_fed_in_order_and_nothing_twice() -> None:
    ahead = round(AHEAD_S * RATE_HZ)
    frames = [0, 10, 10, ahead - 1, ahead, 3 * ahead]
    player = Player(from_events(make_events([(frame, NOTE_ON, 0, 40, 90) for frame in frames])), 4 * ahead, RATE_HZ)
    ring = Ring(room=3)
    player.feed(ring)
    assert ring.taken == frames[:3]
    player.feed(ring)
    assert ring.taken == frames[:3]
    ring.room = 100
    player.feed(ring)
    assert ring.taken == frames[:4]
    ring.frame = 1
    player.feed(ring)
    assert ring.taken == frames[:5]
    ring.frame = 3 * ahead
    assert not player.over(ring)
    player.feed(ring)
    assert ring.taken == frames and not player.over(ring)
    ring.frame = 4 * ahead
    player.feed(ring)
    assert player.over(ring)


def test_music_without_an_end_is_never_over() -> None:
    ring = Ring(room=0)
    player = Player(from_events(np.zeros(0, EVENT)), None, RATE_HZ)
    player.feed(ring)
    ring.frame = 1 << 40
    player.feed(ring)
    assert not player.over(ring)


PLAYING = Status(0.12, 0.31, 2, 3, 0.5, 48, 96, 65.0)


def test_the_line_says_all_where_there_is_room() -> None:
    text = status_text(PLAYING, 200)
    for said in ("load  12/ 31 %", "2 xruns", "3 strings", "-6.0 dB", "C3 v96", "REC 1:05"):
        assert said in text
    assert "lost" not in text and "3 lost" in status_text(replace(PLAYING, events_lost=3), 200)
    assert "sparing" not in text and "sparing below -80 dB" in status_text(PLAYING_SPARED, 200)


PLAYING_SPARED = Status(0.9, 1.2, 1, 1, 0.0, -1, 0, None, -80.0)


@pytest.mark.parametrize("status", [PLAYING, PLAYING_SPARED, Status(0.0, 0.0, 0, 0, math.nan, 127, 127, 1e6)])
def test_the_line_fits_every_width(status: Status) -> None:
    widths = [len(status_text(status, width)) for width in range(120)]
    assert all(length <= width for width, length in enumerate(widths))
    assert status_text(status, 60).startswith("load")


def test_what_is_louder_shows_a_longer_bar() -> None:
    bars = [status_text(Status(0, 0, 0, 0, peak, -1, 0, None), 200).count("=") for peak in (0.0, 1e-4, 0.01, 0.1, 1.0, 3.0)]
    assert bars == sorted(bars) and bars[0] == 0 and bars[-1] == bars[-2] == 12


def test_clock_text() -> None:
    assert [clock_text(s) for s in (0, 59.9, 60, 3599, 3600, 36061)] == [
        "0:00",
        "0:59",
        "1:00",
        "59:59",
        "1:00:00",
        "10:01:01",
    ]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_on_a_terminal_the_line_gives_way_to_what_is_said() -> None:
    terminal = Terminal()
    line = StatusLine(stream=terminal)
    line.show(PLAYING)
    line.show(PLAYING)  # too soon after the other
    shown = terminal.getvalue()
    assert shown.startswith("\rload") and shown.count("load") == 1 and "\n" not in shown
    line.say("a port has come")
    assert terminal.getvalue()[len(shown) :].strip(" \r") == "synth: a port has come\n"


def test_without_a_terminal_there_is_no_line_and_quiet_says_nothing() -> None:
    file = io.StringIO()
    line = StatusLine(stream=file)
    line.show(PLAYING)
    assert file.getvalue() == ""
    line.say("said")
    assert file.getvalue() == "synth: said\n"
    quiet = Terminal()
    line = StatusLine(stream=quiet, quiet=True)
    line.show(PLAYING)
    line.say("not said")
    assert quiet.getvalue() == ""


def test_a_terminal_that_goes_away_ends_nothing() -> None:
    class Gone(Terminal):
        def write(self, text: str) -> int:
            raise OSError("gone")

    line = StatusLine(stream=Gone())
    line.show(PLAYING)
    line.say("still here")
    line.clear()


@pytest.fixture
def handlers() -> Iterator[None]:
    numbers = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
    before = [signal.getsignal(number) for number in numbers]
    yield
    now = [signal.signal(number, handler) for number, handler in zip(numbers, before, strict=True)]
    assert now == before


def test_the_first_signal_asks_the_second_insists(handlers) -> None:
    stop = Stop()
    assert not stop.wait(0.0)
    with asked_by_signals(stop) as begin:
        begin()
        for _ in range(2):
            signal.raise_signal(signal.SIGHUP)  # the terminal is closed
            assert stop.asked and not stop.at_once and stop.wait(60.0)
        signal.raise_signal(signal.SIGINT)
        assert stop.at_once and stop.wait_at_once(60.0)
        signal.raise_signal(signal.SIGTERM)


def test_before_the_session_is_open_a_signal_interrupts(handlers) -> None:
    stop = Stop()
    with pytest.raises(KeyboardInterrupt), asked_by_signals(stop):
        signal.raise_signal(signal.SIGINT)
    assert not stop.asked


def test_nohup_is_obeyed() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        stop = Stop()
        with asked_by_signals(stop) as begin:
            begin()
            signal.raise_signal(signal.SIGHUP)
            assert not stop.asked
    finally:
        signal.signal(signal.SIGHUP, before)


def test_an_exception_does_not_cut_the_waiting_for_a_thread_short() -> None:
    waiting, interrupted, go_on = threading.Event(), threading.Event(), threading.Event()
    done: list[str] = []

    def interrupt(*_: object) -> None:
        interrupted.set()
        raise InterruptedError("told once the thread has ended")

    def work() -> None:
        waiting.wait()
        while not interrupted.wait(0.05):
            os.kill(os.getpid(), signal.SIGUSR1)
        go_on.wait(0.3)
        done.append("work")

    worker = Worker(work, "work")
    wait = worker._done.wait

    def wait_and_tell(seconds: float | None) -> bool:
        waiting.set()
        return wait(seconds)

    worker._done.wait = wait_and_tell
    before = signal.signal(signal.SIGUSR1, interrupt)
    try:
        worker.start()
        with pytest.raises(InterruptedError):
            worker.ended()
        assert done == ["work"]
    finally:
        signal.signal(signal.SIGUSR1, before)


def test_who_does_not_answer_is_left_to_himself() -> None:
    end = threading.Event()
    assert not answers(end.wait, 0.05)
    end.set()
    assert answers(end.wait, 60.0)
    # Who waits for an output to be left allows for its stopping and its closing.
    assert LEAVE_S > 2 * CALL_S


def where_errors_go() -> tuple[int, int]:
    found = os.fstat(2)
    return found.st_dev, found.st_ino


def test_standard_error_comes_back_however_two_silences_overlap(capfd) -> None:
    here = where_errors_go()
    first, second = stderr.silenced(), stderr.silenced()
    first.__enter__()
    second.__enter__()
    assert where_errors_go() != here
    first.__exit__(None, None, None)
    assert where_errors_go() != here
    second.__exit__(None, None, None)
    assert where_errors_go() == here


def test_standard_error_is_taken_back_from_who_does_not_return(capfd) -> None:
    here = where_errors_go()
    with stderr.silenced():
        stderr.give_back()
        assert where_errors_go() == here
        with stderr.silenced():
            assert where_errors_go() != here
        assert where_errors_go() == here
    assert where_errors_go() == here


class Output:
    """An output that notes what is done to it."""

    name, alive, latency_s = "fake", True, 0.0

    def __init__(self, fails: Exception | None = None, messages_lost: int = 0) -> None:
        self.done: list[str] = []
        self.messages_lost = messages_lost
        self._fails = fails

    def start(self) -> None:
        self.done.append("start")
        if self._fails is not None:
            raise self._fails

    def close(self) -> None:
        self.done.append("close")


def beside(path: Path, *events: tuple[int, bytes], **settings: object) -> Session:
    """A session in which others play beside a song of these events."""
    path.write_bytes(header() + track(*events))
    session = Session(SessionSettings(song=str(path), keys=True, **settings), StatusLine(quiet=True))
    session.rate_hz = RATE_HZ
    return session


def test_a_song_is_as_loud_whether_others_play_beside_it_or_not(tmp_path: Path) -> None:
    for channels, lowered in (((3,), 0.0), ((3, 5), 3.0)):
        notes = [(0, on(48, channel=c)) for c in channels] + [(99, off(48, channel=c)) for c in channels]
        casting, song, headroom_db = beside(tmp_path / "song.mid", *notes)._cast()
        assert len({part.channel for part in casting.parts}) > len(channels)
        assert song is not None and headroom_db == lowered
        offline = parts.cast(song.channels, RenderSettings("song.mid", None).choice(song))
        assert parts.headroom_db(song, offline) == headroom_db
    assert Session(SessionSettings(), StatusLine(quiet=True))._cast()[1:] == (None, 0.0)


def test_beside_a_song_keys_switch_what_programs_chose_as_little_as_in_it(tmp_path: Path) -> None:
    path = tmp_path / "song.mid"
    session = beside(path, (0, bytes((0xC0, 27))), (0, on(48)), (99, off(48)))
    casting, _, _ = session._cast()
    assert not any(part.switching for part in casting.parts) and not session._switching
    mapped = beside(path, (0, on(48)), (99, off(48)), preset="electric-guitar")
    assert all(part.switching for part in mapped._cast()[0].parts) and not mapped._switching
    alone = Session(SessionSettings(), StatusLine(quiet=True))
    assert all(part.switching for part in alone._cast()[0].parts) and alone._switching


def reopened(output: Output, *, late: bool = False) -> tuple[Session, list[str]]:
    session = Session(SessionSettings(), StatusLine(quiet=True))
    session._output = None
    session._open_output = lambda: output
    session._left_behind = late
    refused: list[str] = []
    session._reopen(refused)
    return session, refused


def test_an_output_that_comes_back_sounds() -> None:
    output = Output()
    session, refused = reopened(output)
    assert session._output is output and output.done == ["start"] and not refused


def test_an_output_that_comes_back_too_late_makes_no_sound() -> None:
    output = Output()
    session, refused = reopened(output, late=True)
    assert session._output is None and output.done == ["close"] and not refused


def test_an_output_that_does_not_start_is_closed_whatever_the_library_raises() -> None:
    output = Output(fails=RuntimeError("PortAudio not initialized"))
    _, refused = reopened(output)
    assert output.done == ["start", "close"] and refused == ["PortAudio not initialized"]


def test_what_outputs_lose_is_counted_with_what_the_deck_loses() -> None:
    session, _ = reopened(Output(messages_lost=3))
    session._open_output = lambda: Output(messages_lost=4)
    session._reopen([])
    assert session._events_lost(SimpleNamespace(events_lost=10)) == 17
    without = Output()
    del without.messages_lost
    session._open_output = lambda: without
    session._reopen([])
    assert session._events_lost(SimpleNamespace(events_lost=10)) == 17


def test_spans_of_times() -> None:
    assert TimeSpread.of([441, 882, 4410], RATE_HZ) == TimeSpread(20.0, 100.0)


def test_the_quickest_note_draws_shortest() -> None:
    from synth.engine.engine import Engine
    from synth.instrument.preset import load_preset

    preset = load_preset("tanpura-light")
    engine = Engine([preset, preset.with_setting("pluck.draw_ms", "3.0")], quality="draft")
    engine.prepare(RATE_HZ, 256)
    channel, program, note, draw_s = quickest_note(engine)
    assert (channel, program, note) == (1, 0, 48)
    assert draw_s == pytest.approx(3e-3)
    engine.close()
