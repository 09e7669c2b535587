"""What a live session is made of that needs no sound: who plays what, the line on the terminal, how it is asked to end."""

import io
import math
import signal

import numpy as np
import pytest

from synth.cli.play import asked_by_signals
from synth.engine.events import EVENT, NOTE_ON, make_events
from synth.host import parts
from synth.host.eventsource import from_events
from synth.live.latency import Span, quickest_note
from synth.live.player import AHEAD_S, Player
from synth.live.session import Stop
from synth.live.status import Status, StatusLine, clock_text, status_text

RATE_HZ = 44100


def test_by_default_programs_choose_one_of_two_parts_on_every_channel_but_ten() -> None:
    made = parts.cast_live()
    assert [part.preset for part in made.parts] == ["jawari-harp", "fretted-bass"]
    for channel in range(16):
        if channel == 9:
            assert (made.program_map[9] == -1).all()
            continue
        assert np.flatnonzero(made.program_map[channel] == 1).tolist() == list(range(32, 40))
        assert np.count_nonzero(made.program_map[channel] == 0) == 120


def test_one_part_per_preset_shared_by_its_channels() -> None:
    made = parts.cast_live("tanpura", {2: "mine.toml", 4: "tanpura", 5: "none", 9: "mine.toml"})
    assert [part.preset for part in made.parts] == ["tanpura", "mine.toml"]
    expected = [0, 0, 1, 0, 0, -1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0]
    assert made.program_map[:, 0].tolist() == expected
    assert (made.program_map == made.program_map[:, :1]).all()


def test_one_channel_alone_and_none_at_all() -> None:
    made = parts.cast_live("tanpura", only_channel=4)
    assert np.flatnonzero((made.program_map >= 0).any(axis=1)).tolist() == [4]
    with pytest.raises(ValueError, match="no channel has a preset"):
        parts.cast_live(None, {3: "none"}, only_channel=3)


def test_a_song_keeps_its_parts_and_others_share_them() -> None:
    song = parts.cast({(0, 0): 5, (0, 33): 2, (1, 0): 3})
    assert [part.label for part in song.parts] == ["ch01-jawari-harp", "ch01-fretted-bass", "ch02-jawari-harp"]
    made = parts.cast_live(song=song)
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


def test_the_first_signal_asks_the_second_insists() -> None:
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)
    stop = Stop()
    assert not stop.wait(0.0)
    with asked_by_signals(stop):
        signal.raise_signal(signal.SIGTERM)
        assert stop.asked and not stop.at_once and stop.wait(60.0)
        signal.raise_signal(signal.SIGINT)
        assert stop.at_once and stop.wait_at_once(60.0)
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before


def test_spans_of_times() -> None:
    assert Span.of([441, 882, 4410], RATE_HZ) == Span(20.0, 100.0)


def test_the_quickest_note_draws_shortest() -> None:
    from synth.engine.engine import Engine
    from synth.preset import load_preset

    preset = load_preset("tanpura")
    engine = Engine([preset, preset.with_setting("pluck.draw_ms", "3.0")], quality="draft")
    engine.prepare(RATE_HZ, 256)
    channel, program, note, draw_s = quickest_note(engine)
    assert (channel, program, note) == (1, 0, 48)
    assert draw_s == pytest.approx(3e-3)
    engine.close()
