"""Events: what a player does, with the frame it happens at."""

from __future__ import annotations

import numpy as np

#: one event; `frame` counts from the start of the block, or of the song
EVENT = np.dtype(
    [("frame", "i8"), ("kind", "i4"), ("channel", "i4"), ("a", "i4"), ("b", "i4"), ("value", "f8")],
    align=True,
)

NOTE_ON = 1  # a = note, b = velocity (0: note off)
NOTE_OFF = 2  # a = note
CONTROL = 3  # a = controller, b = value
BEND = 4  # a = -8192 … 8191
PROGRAM = 5  # a = program
PARAMETER = 6  # channel = part, a = index in PARAMETERS, value


def make_events(rows) -> np.ndarray:
    """EVENT array from rows (frame, kind, channel, a[, b[, value]])."""
    out = np.zeros(len(rows), EVENT)
    for i, row in enumerate(rows):
        padded = (*row, 0, 0.0)[:6] if len(row) == 4 else (*row, 0.0)[:6]
        out[i] = padded
    return out
