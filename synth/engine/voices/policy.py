"""From an event to who decides about it; a policy is a plain function of `voices` that Numba compiles for C."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit

from synth.engine.layout import CORE
from synth.engine.voices.control_changes import control
from synth.engine.voices.notes import note_off, note_on, press_key
from synth.engine.voices.retuning import set_parameter, tune
from synth.engine.voices.switching import choose_program
from synth.engine.voices.voice_table import state_seen
from synth.jit import entries
from synth.midi.events import (
    BEND,
    CONTROL,
    KEY_PRESSURE,
    NOTE_OFF,
    NOTE_ON,
    PARAMETER,
    PRESSURE,
    PROGRAM,
    TUNING,
)


@njit(**CORE)
def handle(voices: int) -> None:
    """What the event at hand, `State.event`, means. What means nothing changes nothing."""
    state = state_seen(voices)
    event = state.event[0]
    kind, value = event.kind, event.value
    # of one type from here on: what is called from several places would be compiled once for each
    c, a, b = int(np.int64(event.channel)), int(np.int64(event.a)), int(np.int64(event.b))
    if kind == PARAMETER:
        if 0 <= c < state.parameters.shape[0] and 0 <= a < state.parameters.shape[1]:
            if math.isfinite(value):
                set_parameter(voices, c, a, value)
        return
    if kind == TUNING:
        tune(voices, a, value, b)
        return
    if not 0 <= c < state.channels.size:
        return
    if kind == NOTE_ON and b > 0:
        note_on(voices, c, a, b)
    elif kind == NOTE_OFF or kind == NOTE_ON:
        note_off(voices, c, a)
    elif kind == CONTROL:
        control(voices, c, a, b)
    elif kind == BEND:
        state.channels[c].bend_raw = max(-1.0, min(1.0, a / 8192.0))
    elif kind == PROGRAM:
        choose_program(voices, c, a & 127)
    elif kind == PRESSURE:
        state.channels[c].pressure = min(max(b, 0), 127) / 127.0
    elif kind == KEY_PRESSURE:
        press_key(voices, c, a, b)


def decide(voices: int) -> None:
    """The policy of an engine that is given no other."""
    handle(voices)


def entry(policy: Callable[[int], None]) -> Any:
    """A policy as the C function void(voices) of one int64: `.address` and, for who calls it from Python, `.ctypes`."""
    return entries.entry(policy, 1)
