"""The offline loop against a fake engine whose output is known in closed form."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synth.host.offline import FADE_S, QUIET_FOR_S, Rendering, Span, render, span_of
from synth.midi.events import EVENT, NOTE_ON
from synth.midi.eventsource import from_events

from .fake_engine import FakeEngine

# Low, so that seconds are few frames: the fake engine works in Python.
RATE_HZ = 1000
QUIET_FRAMES = round(QUIET_FOR_S * RATE_HZ)


class Sink:
    def __init__(self) -> None:
        self.blocks: list[np.ndarray] = []

    def write(self, block: np.ndarray) -> None:
        self.blocks.append(block.copy())

    @property
    def sound(self) -> np.ndarray:
        return np.concatenate([np.zeros((0, 2)), *self.blocks])


def notes(*frames: int, channel: int = 0, velocity: int = 127) -> np.ndarray:
    events = np.zeros(len(frames), EVENT)
    events["frame"], events["kind"], events["channel"] = frames, NOTE_ON, channel
    events["a"], events["b"] = 60, velocity
    return events


def play(events: np.ndarray, span: Span, block: int = 64, **engine: float) -> tuple[np.ndarray, Rendering]:
    sink = Sink()
    done = render(FakeEngine(**engine), events, span, RATE_HZ, sink, block=block)
    assert done.frames == len(sink.sound)
    return sink.sound, done


@pytest.mark.parametrize("latency", [0, 1, 47, 300])
def test_the_latency_is_taken_out(latency: int) -> None:
    sound, done = play(notes(10), Span(0, 100, 0, False), latency=latency)
    assert len(sound) == 100
    assert sound[9, 0] == 0.0
    np.testing.assert_allclose(sound[10:, 0], 0.999 ** np.arange(90), rtol=1e-12)
    assert done.peak == 1.0


def test_an_automatic_tail_ends_half_a_second_after_the_last_loud_frame() -> None:
    # decay^n falls below 10^(-80/20) first at n = ceil(ln 1e-4 / ln decay).
    decay = 0.98
    quiet_at = 10 + math.ceil(math.log(1e-4) / math.log(decay))
    sound, _ = play(notes(10), Span(0, 50, 60 * RATE_HZ, True), decay=decay)
    assert len(sound) == quiet_at + QUIET_FRAMES


def test_a_song_that_is_quiet_at_its_end_has_no_tail() -> None:
    sound, _ = play(notes(10), Span(0, 5000, 60 * RATE_HZ, True), decay=0.9)
    assert len(sound) == 5000


def test_a_song_of_nothing_ends_at_once() -> None:
    sound, done = play(notes(), Span(0, 0, 60 * RATE_HZ, True))
    assert len(sound) == 0
    assert done.peak == 0.0


def test_an_endless_sound_is_faded_at_the_limit() -> None:
    limit = 3 * RATE_HZ
    sound, _ = play(notes(10), Span(0, 50, limit, True), decay=1.0)
    assert len(sound) == 50 + limit
    # One second of half cosine: unchanged before, half in its middle, silent at the end, falling throughout.
    np.testing.assert_array_equal(sound[10 : 50 + limit - RATE_HZ, 0], 1.0)
    np.testing.assert_allclose(sound[50 + limit - RATE_HZ // 2 - 1, 0], 0.5, atol=1e-12)
    assert (np.diff(sound[50 + limit - RATE_HZ :, 0]) < 0).all()
    assert abs(sound[-1, 0]) < 1e-12


def test_a_tail_in_seconds_is_kept_and_ends_softly() -> None:
    sound, _ = play(notes(10), Span(0, 50, 200, False), decay=1.0)
    fade = round(FADE_S * RATE_HZ)
    assert len(sound) == 250
    np.testing.assert_array_equal(sound[10 : 250 - fade, 0], 1.0)
    assert abs(sound[-1, 0]) < 1e-12


@given(
    st.lists(st.integers(0, 400), max_size=8).map(sorted),
    st.integers(1, 700),
    st.booleans(),
    st.integers(0, 60),
)
def test_the_block_size_does_not_show(frames: list[int], block: int, automatic: bool, latency: int) -> None:
    span = Span(30, 400, 900 if automatic else 55, automatic)
    expected, _ = play(notes(*frames), span, block=128, decay=0.97, latency=latency)
    got, _ = play(notes(*frames), span, block=block, decay=0.97, latency=latency)
    np.testing.assert_array_equal(got, expected)


def test_a_part_of_a_song_is_a_slice_of_the_whole() -> None:
    events = notes(10, 120, 250, 390)
    whole, _ = play(events, Span(0, 500, 0, False))
    part, _ = play(events, Span(100, 300, 0, False), block=37)
    np.testing.assert_array_equal(part, whole[100:300])


def test_notes_after_the_end_do_not_sound_in_the_tail_and_held_ones_are_let_go() -> None:
    sound, _ = play(notes(10, 100, 150), Span(0, 100, 50, False), decay=1.0)
    assert sound[99, 0] == 1.0
    assert (sound[100:] == 0.0).all()


def test_an_event_at_the_very_end_of_the_song_is_played() -> None:
    sound, _ = play(notes(100), Span(0, 100, 50, False), decay=1.0)
    assert sound[100, 0] == 1.0


def test_stems_go_to_their_sinks_and_add_up_to_the_mix() -> None:
    events = np.sort(np.concatenate((notes(10), notes(40, channel=3))), order="frame")
    mix, left, right = Sink(), Sink(), Sink()
    render(FakeEngine(), events, Span(5, 100, 80, False), RATE_HZ, mix, [left, right], block=16)
    assert left.sound[:, 0].any() and right.sound[:, 1].any()
    np.testing.assert_array_equal(left.sound + right.sound, mix.sound)


def test_progress_rises_to_the_end() -> None:
    seen: list[tuple[float, float]] = []
    sink = Sink()
    span = Span(0, 1000, 0, False)
    render(FakeEngine(), notes(1), span, RATE_HZ, sink, block=100, progress=lambda *now: seen.append(now))
    done = [now for now, _ in seen]
    assert done == sorted(done)
    assert seen[-1] == (1.0, 1.0)


def test_no_more_is_asked_of_the_engine_than_the_span_and_its_latency() -> None:
    engine = FakeEngine(latency=10)
    render(engine, notes(1), Span(0, 130, 0, False), RATE_HZ, Sink(), block=64)
    assert sum(engine.blocks) == 140


def test_a_number_that_is_not_finite_stops_the_render() -> None:
    class Broken(FakeEngine):
        def process(self, events, out, stems) -> None:
            out[:] = 0.0
            out[3, 1] = np.nan

    with pytest.raises(RuntimeError, match="not finite"):
        render(Broken(latency=0), notes(), Span(0, 100, 0, False), RATE_HZ, Sink())


def test_a_source_of_events_is_asked_block_by_block() -> None:
    asked: list[int] = []
    given = from_events(notes(10, 64, 129))

    def source(until: int) -> np.ndarray:
        asked.append(until)
        return given(until)

    sink = Sink()
    render(FakeEngine(latency=5, decay=0.9), source, Span(0, 190, 0, False), RATE_HZ, sink, block=64)
    assert asked == [64, 128, 192, 195]
    expected, _ = play(notes(10, 64, 129), Span(0, 190, 0, False), decay=0.9, latency=5)
    np.testing.assert_array_equal(sink.sound, expected)


def test_events_at_a_frame_belong_to_what_follows_it() -> None:
    given = from_events(notes(3, 5, 5, 9))
    assert [given(until)["frame"].tolist() for until in (3, 5, 6, 6, 100)] == [[], [3], [5, 5], [], [9]]
    events = notes(3)
    from_events(events)(4)["frame"] -= 3  # the array is the asker's
    assert events["frame"].tolist() == [3]


class Drawn(FakeEngine):
    """A pluck is silent for 90 ms, and then for one frame as loud as it was struck."""

    def __init__(self) -> None:
        super().__init__(latency=90, decay=0.0)
        self.latency_samples = 0


def test_a_pluck_at_the_end_is_waited_for_until_its_finger_lets_go() -> None:
    """Also where an earlier note has rung out before it begins."""
    for before in ((), (10,)):
        sink = Sink()
        render(Drawn(), notes(*before, 1000), Span(0, 1000, 5 * RATE_HZ, True), RATE_HZ, sink, block=64)
        assert np.flatnonzero(sink.sound[:, 0]).tolist() == [each + 90 for each in (*before, 1000)]
        assert len(sink.sound) == 1000 + round(0.1 * RATE_HZ) + 1 + QUIET_FRAMES


def test_an_end_of_a_note_is_nobodys_pluck() -> None:
    sound, _ = play(notes(50, velocity=0), Span(0, 60, 5 * RATE_HZ, True), decay=0.0, latency=0)
    assert len(sound) == 60


def test_quiet_is_below_minus_80_decibels() -> None:
    def length(level: float) -> int:
        class Steady(FakeEngine):
            def process(self, events, out, stems) -> None:
                out[:] = (0.0, -level)

        sink = Sink()
        return render(Steady(latency=0), notes(), Span(0, 100, 2000, True), RATE_HZ, sink).frames

    assert (length(0.99e-4), length(1.01e-4)) == (100, 2100)


def test_a_tail_shorter_than_its_fade_is_all_fade() -> None:
    """A half cosine over what there is, stems alike: nothing before the end of the song is touched."""
    mix, left, right = Sink(), Sink(), Sink()
    render(FakeEngine(decay=1.0), notes(10), Span(0, 50, 4, False), RATE_HZ, mix, [left, right])
    expected = 0.5 + 0.5 * np.cos(np.pi * np.arange(1, 5) / 4)
    np.testing.assert_allclose(mix.sound[50:, 0], expected, atol=1e-15)
    np.testing.assert_allclose(left.sound[50:, 0], expected, atol=1e-15)
    assert (mix.sound[10:50, 0] == 1.0).all() and not right.sound.any()


def test_what_is_before_the_start_is_neither_written_nor_counted() -> None:
    sound, done = play(notes(10), Span(100, 200, 0, False), latency=0, decay=0.99)
    assert done.peak == sound[0, 0] == pytest.approx(0.99**90)
    seen: list[tuple[float, float]] = []
    render(
        FakeEngine(latency=30),
        notes(),
        Span(100, 200, 0, False),
        RATE_HZ,
        Sink(),
        block=50,
        progress=lambda *n: seen.append(n),
    )
    assert seen == [(0.02, 0.2), (0.07, 0.2), (0.12, 0.2), (0.17, 0.2), (0.2, 0.2)]


def test_the_place_of_a_number_that_is_not_finite() -> None:
    class Broken(FakeEngine):
        def process(self, events, out, stems) -> None:
            out[:] = np.inf if self.blocks else 0.0
            self.blocks.append(len(out))

    with pytest.raises(RuntimeError, match=r"a sample that is not finite at 0\.25 s"):
        render(Broken(latency=50), notes(), Span(0, 900, 0, False), RATE_HZ, Sink(), block=300)


def test_the_time_a_render_took(monkeypatch) -> None:
    clock = iter((10.0, 12.5))
    monkeypatch.setattr("synth.host.offline.time", SimpleNamespace(perf_counter=lambda: next(clock)))
    assert play(notes(1), Span(0, 100, 0, False))[1].wall_s == 2.5


def test_spans() -> None:
    assert span_of(2.0004, 1000, start_s=0.0006, end_s=1.9996, tail_s=0.0) == Span(1, 2000, 0, False)
    assert span_of(2.0, 1000, start_s=0.5, tail_s=0.1).most_frames == 1600
    assert span_of(0.0, 1000).end == 0  # a song of nothing has a start
    with pytest.raises(ValueError, match=r"later than --start \(1 s\), got 0\.5 s"):
        span_of(2.0, 1000, start_s=1.0, end_s=0.5)
    assert span_of(2.0, 1000) == Span(0, 2000, 60_000, True)
    assert span_of(2.0, 1000, start_s=0.5, end_s=1.5, tail_s=0.25) == Span(500, 1500, 250, False)
    assert span_of(2.0, 1000, end_s=3.0, tail_s=0.0) == Span(0, 3000, 0, False)
    assert span_of(0.0, 1000, tail_s=0.0).most_frames == 0
    with pytest.raises(ValueError, match="--end must be later than --start"):
        span_of(2.0, 1000, start_s=1.0, end_s=1.0)
    with pytest.raises(ValueError, match="within the song"):
        span_of(2.0, 1000, start_s=2.0)
