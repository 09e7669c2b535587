"""Music from mido, and for it: `mido.MidiFile` objects and mido's messages wherever this program takes a file or events."""

from __future__ import annotations

import io
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from synth.midi import smf, sysex
from synth.midi.events import EVENT, decode
from synth.midi.song import Song, read_song, song_from_file, song_of

if TYPE_CHECKING:
    import mido

LATEST_S = 24 * 3600.0


def events_from_mido(
    messages: Iterable[mido.Message | mido.MetaMessage], rate_hz: float, *, absolute: bool = False
) -> np.ndarray:
    """EVENT array of mido's messages, for `Engine.process`; frames count from the first message's start.

    Parameters
    ----------
    messages : iterable of mido.Message
        With `time` in seconds since the message before, as iterating over a `mido.MidiFile` gives them and ports do not
        (theirs is 0: all are at frame 0 then). What is not played (meta messages, clocks) counts for its time only; system
        exclusive tunings and this program's own are read.
    rate_hz : float
        Frames a second [Hz].
    absolute : bool
        Whether `time` counts since the beginning.

    Returns
    -------
    (n,) array of EVENT
        Sorted by frame.

    Raises
    ------
    TypeError
        For what is no message.
    ValueError
        For times that are not finite, negative or descend, and a rate that is not above 0 Hz.

    Examples
    --------
    >>> import mido
    >>> import synth
    >>> messages = [mido.Message("note_on", note=48), mido.Message("note_off", note=48, time=0.5)]
    >>> synth.events_from_mido(messages, 44100.0)["frame"]
    array([    0, 22050])
    """
    if not (rate_hz > 0.0 and np.isfinite(rate_hz)):
        raise ValueError(f"rate_hz must be > 0 Hz, got {rate_hz}")
    rows: list[tuple] = []
    now = 0.0
    for number, message in enumerate(messages):
        if not (hasattr(message, "type") and hasattr(message, "bytes") and hasattr(message, "time")):
            raise TypeError(f"message {number} must be one of mido's, got {type(message).__name__}")
        later = float(message.time) if absolute else now + float(message.time)
        if not now <= later <= LATEST_S:
            raise ValueError(
                f"the time of message {number} must lie between that of the previous one ({now:g} s) and {LATEST_S:g} s, "
                f"got {later:g} s"
            )
        now = later
        frame = round(now * rate_hz)
        if getattr(message, "is_meta", False):
            continue
        if message.type == "sysex":
            rows += [(frame, *row) for row in sysex.events_of(bytes(message.data))]
            continue
        data = [*message.bytes(), 0, 0][:3]
        kind, channel, a, b = decode(*data)
        if kind:
            rows.append((frame, kind, channel, a, b, 0.0))
    return np.array(rows, EVENT)


def song_from(source: Any, rate_hz: int, mpe: bool = False) -> tuple[str, Song]:
    """(what to call it, the song) of a file's path, a `mido.MidiFile`, an EVENT array with frames of `rate_hz`, or mido's
    messages with times as in `events_from_mido`. Raises MidiError, TypeError, ValueError.
    """
    if isinstance(source, str) or hasattr(source, "__fspath__"):
        return str(source), read_song(source, rate_hz, mpe)
    if hasattr(source, "tracks") and hasattr(source, "save"):
        name = str(getattr(source, "filename", None) or "the song")
        return name, song_from_file(smf.parse(bytes_of(source)), rate_hz, mpe)
    if isinstance(source, np.ndarray):
        if source.dtype != EVENT or source.ndim != 1:
            raise TypeError(f"events must be a one-dimensional EVENT array, got shape {source.shape} of {source.dtype}")
        if source.size and (source["frame"][0] < 0 or (np.diff(source["frame"]) < 0).any()):
            raise ValueError("events must be sorted by frame, from 0 on; sort them or correct their frames")
        events, length_s = source, (int(source["frame"][-1]) / rate_hz if source.size else 0.0)
    elif isinstance(source, Iterable) and not isinstance(source, bytes | bytearray):
        messages = list(source)
        events = events_from_mido(messages, rate_hz)
        length_s = sum(float(message.time) for message in messages)
    else:
        raise TypeError(f"a song must be a file's name, a mido.MidiFile, messages or events, got {type(source).__name__}")
    return "the song", song_of(events, rate_hz, length_s, mpe)


def bytes_of(file: mido.MidiFile) -> bytes:
    """A `mido.MidiFile` as a Standard MIDI File. Raises MidiError for one that none can hold."""
    out = io.BytesIO()
    try:
        file.save(file=out)
    except (ValueError, TypeError, AttributeError, OverflowError, KeyError) as error:
        raise smf.MidiError(f"this MidiFile cannot be saved ({error}); check its times and messages") from None
    except Exception as error:  # struct.error, for one
        raise smf.MidiError(f"this MidiFile cannot be saved ({error}); check its header") from None
    return out.getvalue()
