"""The sound of a few notes on an engine that has just been reset, and what is wrong with them: of one that `render_notes`
plays, of an item of a data set."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

import numpy as np

from synth.engine.engine import Engine
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, make_events
from synth.midi.eventsource import from_events
from synth.units import midi_to_note

#: frames that an engine computes at a time; between two such blocks it can be stopped
BLOCK = 16384
OFF_VELOCITY = 64
#: among events of one frame: what is set, what ends, what begins, and what has begun there and ends at once
_SET, _ENDS, _BEGINS, _AT_ONCE = range(4)


class PressedKey(Protocol):
    """A key that is pressed, and let go after `off_s` [s], or never."""

    @property
    def note(self) -> int: ...

    @property
    def velocity(self) -> int: ...

    @property
    def off_s(self) -> float | None: ...


def events_of(
    strokes: Iterable[tuple[float, PressedKey]],
    controllers: Iterable[tuple[int, int]],
    rate_hz: int,
    parameters: Iterable[tuple[int, float]] = (),
) -> np.ndarray:
    """EVENT array of strokes, each with the time [s] it begins at, on channel 1.

    controllers   (number, value) that come before them; parameters   (index, value) of part 0, set before them
    """
    rows: list[tuple[int, tuple[float, ...]]] = [(_SET, (0, CONTROL, 0, number, value)) for number, value in controllers]
    rows += [(_SET, (0, PARAMETER, 0, index, 0, value)) for index, value in parameters]
    for at_s, stroke in strokes:
        begin = round(at_s * rate_hz)
        rows.append((_BEGINS, (begin, NOTE_ON, 0, stroke.note, stroke.velocity)))
        if stroke.off_s is not None:
            end = begin + round(stroke.off_s * rate_hz)
            rows.append((_ENDS if end > begin else _AT_ONCE, (end, NOTE_OFF, 0, stroke.note, OFF_VELOCITY)))
    rows.sort(key=lambda row: (row[1][0], row[0]))
    return make_events([row for _, row in rows])


def sound_alone(
    engine: Engine,
    events: np.ndarray,
    seconds: float,
    rate_hz: int,
    dtype: np.dtype,
    look: Callable[[], None] = lambda: None,
    block: int = BLOCK,
) -> np.ndarray:
    """(frames, 2) of the events on an engine that is prepared and reset; `look` is called at every block, and may raise.

    Raises ValueError for what no string plays, RuntimeError for what is no sound.
    """
    latency, frames = engine.latency_samples, round(seconds * rate_hz)
    samples = np.empty((frames, 2), dtype)
    # a piece stays in the cache: to write the whole sound as float64 and read it again took a twentieth of a harp's note
    out = np.empty((min(block, frames + latency), 2))
    finite = True
    source = from_events(events)
    for at in range(-latency, frames, block):
        piece = out[: frames - at]
        due = source(at + latency + len(piece))
        due["frame"] -= at + latency
        engine.process(due, piece)
        look()
        finite = finite and bool(np.isfinite(piece.max()) and np.isfinite(piece.min()))  # nan is the largest there is
        samples[max(0, at) : max(0, at + len(piece))] = piece[max(0, -at) :]
    check_played(engine, events)
    if not finite:
        raise RuntimeError("the engine produced a sample that is not finite; please report this")
    return samples


def check_played(engine: Engine, events: np.ndarray) -> None:
    """Raises ValueError where a note was played by no string, RuntimeError where a string's motion blew up."""
    told = engine.report()
    if told.unplayed:
        raise ValueError(f"{midi_to_note(told.unplayed[0].note)} is not played: {told.unplayed[0].reason}")
    if not told.notes and (events["kind"] == NOTE_ON).any():
        key = int(events["a"][events["kind"] == NOTE_ON][0])
        raise ValueError(f"{midi_to_note(key)} is an articulation key and makes no sound; give a note of the strings")
    if told.silenced:
        raise RuntimeError("the motion of a string blew up and was silenced")
