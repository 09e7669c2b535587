"""The offline loop against a fake engine whose output is known in closed form."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synth.engine.events import EVENT, NOTE_ON
from synth.host.offline import FADE_S, QUIET_FOR_S, Rendering, Span, render, span_of

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


def test_spans() -> None:
    assert span_of(2.0, 1000) == Span(0, 2000, 60_000, True)
    assert span_of(2.0, 1000, start_s=0.5, end_s=1.5, tail_s=0.25) == Span(500, 1500, 250, False)
    assert span_of(2.0, 1000, end_s=3.0, tail_s=0.0) == Span(0, 3000, 0, False)
    assert span_of(0.0, 1000, tail_s=0.0).most_frames == 0
    with pytest.raises(ValueError, match="--end must be later than --start"):
        span_of(2.0, 1000, start_s=1.0, end_s=1.0)
    with pytest.raises(ValueError, match="within the song"):
        span_of(2.0, 1000, start_s=2.0)
