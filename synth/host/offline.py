"""The offline render loop: events and an engine in, samples into sinks.

The engine is driven as a live host drives it, block by block. What a block is does not show in the result:
the engine promises the same samples for any block size, and start, end and tail are found to the frame here.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from synth.host.audiofile import AudioSink
from synth.midi.controllers import ALL_NOTES_OFF
from synth.midi.events import CONTROL, EVENT, NOTE_ON
from synth.midi.eventsource import EventSource, from_events
from synth.units import db_to_gain

# An automatic tail ends when the output has stayed this quiet for this long, or at the limit.
QUIET_DBFS = -80.0
QUIET_FOR_S = 0.5
# The longest draw of a finger that a preset may ask for.
LONGEST_DRAW_S = 0.1
LONGEST_AUTO_TAIL_S = 60.0
# Where a tail is cut while strings still ring, it is faded: over this time, or (at the automatic limit) this.
FADE_S = 0.02
LIMIT_FADE_S = 1.0

Progress = Callable[[float, float], None]


class EngineLike(Protocol):
    """What the loop needs of an engine that has been prepared for the rate and a block of at least
    `block`.
    """

    @property
    def latency_samples(self) -> int: ...

    def process(self, events: np.ndarray, out: np.ndarray, stems: np.ndarray | None) -> Any: ...


@dataclass(frozen=True)
class Span:
    """Which frames of a song to render.

    begin, end: frames of the song; before `begin` the engine plays unheard, so that what rings there is
    right.
    most_tail: frames that may follow `end`.  automatic: whether the tail ends earlier once it is quiet.
    """

    begin: int
    end: int
    most_tail: int
    automatic: bool

    @property
    def most_frames(self) -> int:
        return self.end - self.begin + self.most_tail


def span_of(
    length_s: float,
    rate_hz: int,
    *,
    start_s: float = 0.0,
    end_s: float | None = None,
    tail_s: float | None = None,
) -> Span:
    """The frames of a song of `length_s` seconds from `start_s` to `end_s` (None: its end) and its tail.

    tail_s: seconds after the end; None: until it is quiet, at most LONGEST_AUTO_TAIL_S. Raises ValueError.
    """
    if end_s is not None and end_s <= start_s:
        raise ValueError(f"--end must be later than --start ({start_s:g} s), got {end_s:g} s")
    if start_s and start_s >= length_s:
        raise ValueError(f"--start must lie within the song, which is {length_s:.2f} s long; got {start_s:g} s")
    end = length_s if end_s is None else end_s
    tail = LONGEST_AUTO_TAIL_S if tail_s is None else tail_s
    return Span(round(start_s * rate_hz), round(end * rate_hz), round(tail * rate_hz), tail_s is None)


@dataclass(frozen=True)
class Rendering:
    """frames written, their peak (linear, of the mix), and the wall-clock seconds the loop took."""

    frames: int
    peak: float
    wall_s: float


def render(
    engine: EngineLike,
    events: np.ndarray | EventSource,
    span: Span,
    rate_hz: int,
    sink: AudioSink,
    stem_sinks: Sequence[AudioSink] = (),
    *,
    block: int = 1024,
    progress: Progress | None = None,
) -> Rendering:
    """Plays `events` (EVENT array, absolute frames, ascending) and writes the frames of `span`.

    The engine's latency is taken out. stem_sinks: one per part of the engine, or none.
    events: or a source of them, which is asked block by block, for a span that ends at a given frame.
    progress: called with (seconds done, most seconds) after every block.

    Raises RuntimeError if the engine gives a number that is not finite.
    """
    began = time.perf_counter()
    latency = engine.latency_samples
    last_release = None
    if callable(events):
        source = events
    else:
        events = until_end(events, span)
        last_release = _last_release(events, rate_hz)
        source = from_events(events)
    out = np.zeros((block, 2))
    stems = np.zeros((len(stem_sinks), block, 2)) if stem_sinks else None
    hard_stop = span.end + span.most_tail
    stop = hard_stop
    fade = _fade_out(span, rate_hz)
    tail = _TailEnd(span.end, round(QUIET_FOR_S * rate_hz), last_release) if span.automatic else None
    peak = 0.0
    written = 0
    at = 0
    while at - latency < stop:
        frames = min(block, stop + latency - at)
        due = source(at + frames)
        due["frame"] -= at
        heard = out[:frames]
        if stems is not None and frames != stems.shape[1]:
            # A slice would not be contiguous, which is another type to a compiled engine.
            stems = np.zeros((len(stem_sinks), frames, 2))
        engine.process(due, heard, stems)

        song_at = at - latency
        if tail is not None:
            found = tail.stop_after(heard, song_at)
            stop = stop if found is None else min(stop, found)
        low = max(0, span.begin - song_at)
        high = min(frames, stop - song_at)
        if high > low:
            piece = heard[low:high]
            gain = _gain(fade, hard_stop, song_at + low, song_at + high)
            if gain is not None:
                piece = piece * gain
            loudest = float(np.abs(piece).max())
            if not np.isfinite(loudest):
                raise RuntimeError(f"the engine produced a sample that is not finite at {song_at / rate_hz:.2f} s")
            peak = max(peak, loudest)
            sink.write(piece)
            written += high - low
            if stems is not None:
                for stem_sink, stem in zip(stem_sinks, stems, strict=True):
                    stem_sink.write(stem[low:high] if gain is None else stem[low:high] * gain)
        at += frames
        if progress is not None:
            progress(max(0, at - latency) / rate_hz, stop / rate_hz)
    return Rendering(written, peak, time.perf_counter() - began)


def until_end(events: np.ndarray, span: Span) -> np.ndarray:
    """The events before the span's end; if any follow, all notes are let go there.

    Without a tail nothing changes: what happens at the end shows a little before it, through filters that look ahead,
    and the span is to be a slice of the whole.
    """
    if span.most_tail == 0:
        return events
    kept = int(np.searchsorted(events["frame"], span.end + 1))
    if kept == len(events):
        return events
    release = np.zeros(16, EVENT)
    release["frame"], release["kind"], release["a"] = span.end, CONTROL, ALL_NOTES_OFF
    release["channel"] = np.arange(16)
    kept = int(np.searchsorted(events["frame"], span.end))
    return np.concatenate((events[:kept], release))


def _last_release(events: np.ndarray, rate_hz: int) -> int | None:
    """Frame by which the finger of the last note has let go of its string; None without notes."""
    notes = events["frame"][(events["kind"] == NOTE_ON) & (events["b"] > 0)]
    return int(notes[-1]) + round(LONGEST_DRAW_S * rate_hz) if len(notes) else None


class _TailEnd:
    """Finds the first frame at or after `end` before which the output was quiet for `quiet_frames`."""

    def __init__(self, end: int, quiet_frames: int, last_release: int | None = None) -> None:
        self._end, self._quiet_frames = end, quiet_frames
        self._threshold = db_to_gain(QUIET_DBFS)
        # Before the song there was silence for as long as one likes; a pluck is quiet until the finger lets go.
        self._last_loud = -quiet_frames - 1
        self._last_release = self._last_loud if last_release is None else last_release

    def stop_after(self, heard: np.ndarray, at: int) -> int | None:
        """The frame to stop at, if it is among those heard ((frames, 2), the first is frame `at`)."""
        loud = at + np.flatnonzero(np.abs(heard).max(axis=1) >= self._threshold)
        before = np.maximum(np.concatenate(([self._last_loud], loud)), self._last_release)
        quiet_until = np.concatenate((loud, [at + len(heard)]))
        if len(loud):
            self._last_loud = int(loud[-1])
        possible = np.maximum(self._end, before + 1 + self._quiet_frames)
        found = np.flatnonzero(possible <= quiet_until)
        return int(possible[found[0]]) if len(found) else None


def _fade_out(span: Span, rate_hz: int) -> np.ndarray:
    """(frames, 1) falling half cosine for the end of the longest tail; empty where there is no tail."""
    frames = min(round((LIMIT_FADE_S if span.automatic else FADE_S) * rate_hz), span.most_tail)
    return 0.5 + 0.5 * np.cos(np.pi * (np.arange(frames) + 1.0) / max(frames, 1))[:, None]


def _gain(fade: np.ndarray, stop: int, low: int, high: int) -> np.ndarray | None:
    """Gains of the song's frames low…high if the fade, which ends at `stop`, touches them."""
    fade_at = stop - len(fade)
    if high <= fade_at or not len(fade):
        return None
    gain = np.ones((high - low, 1))
    inside = max(low, fade_at)
    gain[inside - low :] = fade[inside - fade_at : high - fade_at]
    return gain
