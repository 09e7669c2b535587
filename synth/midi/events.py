"""Events: what a player does, with the frame it happens at."""

from __future__ import annotations

import numpy as np

#: one event; `frame` counts from the start of the block, or of the song; `kind` says what the others are
EVENT = np.dtype(
    [("frame", "i8"), ("kind", "i4"), ("channel", "i4"), ("a", "i4"), ("b", "i4"), ("value", "f8")],
    align=True,
)

NOTE_ON = 1  # kind of an event: a = note, b = velocity (0: note off)
NOTE_OFF = 2  # kind of an event: a = note
CONTROL = 3  # a = controller, b = value
BEND = 4  # a = -8192 … 8191
PROGRAM = 5  # a = program
PARAMETER = 6  # channel = part, a = `layout.GAIN` or another of N_PARAMETERS, value
N_PARAMETERS = 7  # how many live parameters a part may have
PRESSURE = 7  # of the channel: b = 0 … 127
KEY_PRESSURE = 8  # a = note, b = 0 … 127
#: a = key, value = its pitch in semitones (a MIDI number with a fraction; NaN: as compiled); b = 1: what sounds follows
#: at once, 0: from the next pluck on. The channel does not matter
TUNING = 9


def decode(status: int, data1: int, data2: int) -> tuple[int, int, int, int]:
    """(kind, channel, a, b) of a MIDI channel message; kind 0: nothing to play.

    Plain Python that numba compiles as it stands. A note-on of velocity 0 is a note-off of release velocity 64.
    """
    message, channel = status >> 4, status & 0x0F
    if message == 0x8 or (message == 0x9 and data2 == 0):
        return NOTE_OFF, channel, data1, data2 if message == 0x8 else 64
    if message == 0x9:
        return NOTE_ON, channel, data1, data2
    if message == 0xA:
        return KEY_PRESSURE, channel, data1, data2
    if message == 0xB:
        return CONTROL, channel, data1, data2
    if message == 0xC:
        return PROGRAM, channel, data1, 0
    if message == 0xD:
        return PRESSURE, channel, 0, data1
    if message == 0xE:
        return BEND, channel, data1 + 128 * data2 - 8192, 0
    return 0, 0, 0, 0


def copy_event(event, to) -> None:
    """An element of an EVENT array into another. Plain Python that numba compiles as it stands."""
    to.frame = event.frame
    to.kind = event.kind
    to.channel = event.channel
    to.a = event.a
    to.b = event.b
    to.value = event.value


def make_events(rows) -> np.ndarray:
    """EVENT array of rows, for `Engine.process`.

    Parameters
    ----------
    rows : sequence of tuple
        (frame, kind, channel, a[, b[, value]]), in the order of their frames; kinds are NOTE_ON, NOTE_OFF and the others of
        `synth.midi.events`, channels count from 0. What is left out is 0.

    Returns
    -------
    (n,) array of EVENT
        A row for each, as they are given.

    Examples
    --------
    >>> import synth
    >>> events = synth.make_events([(0, synth.NOTE_ON, 0, 48, 100), (441, synth.NOTE_OFF, 0, 48)])
    >>> events["a"].tolist(), events["b"].tolist()
    ([48, 48], [100, 0])
    """
    out = np.zeros(len(rows), EVENT)
    for i, row in enumerate(rows):
        padded = (*row, 0, 0.0)[:6] if len(row) == 4 else (*row, 0.0)[:6]
        out[i] = padded
    return out
