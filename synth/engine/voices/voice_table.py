"""What the policy sees, behind one address, and what it may ask of its responder.

    me, state = voices_of(voices), state_seen(voices)   # in compiled code: me.voices, me.polyphony, state.channels
    pluck(voices, k, velocity, legato)

The responder is a C function void(core, thread, action, place, velocity) of five int64, of which the table holds the
address. An action takes place at the frame of the event at hand; it may change the voice's record as the string itself does.

    action  place       what is asked
    GO_ON   string s    its motion up to the event's frame, before anything changes that it reads
    PLUCK   position k  the string of that position is plucked there with a velocity of 1 … 127
    SLUR    position k  …is stopped there while it sounds, without a pluck: hammered on, pulled off
    CUT     string s    it is silent as soon as it can be without a click, and no finger touches it any more
    LET_GO  string s    its key and pedal may have let go: damp it if nothing holds it

Who asks has brought the record up to date before: whose note it is, whether it is held. `hands` is the engine's responder.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numba import njit

from synth.engine.layout import ARTICULATION, BINDING, CORE, HAND, PART, POSITION, STRING, VOICE, State
from synth.native.arrays import f8, i8, struct
from synth.native.views import ask, opener, words

#: actions
GO_ON, PLUCK, SLUR, CUT, LET_GO = range(5)


class Voices(NamedTuple):
    """Strings and what may be played on them, of which the policy decides who plays. Arrays of the core's."""

    voices: Annotated[np.ndarray, struct(VOICE, "strings")]  # one for each string
    hands: Annotated[np.ndarray, struct(HAND, "strings")]  # read, but for what is pending and how long
    strings: Annotated[np.ndarray, struct(STRING, "strings")]  # read: part, positions, choir
    positions: Annotated[np.ndarray, struct(POSITION, "positions")]
    parts: Annotated[np.ndarray, struct(PART, "parts")]  # read: positions, choirs, articulations, meend
    articulations: Annotated[np.ndarray, struct(ARTICULATION, "articulations")]  # read: keys, controllers, velocities; times
    program_map: Annotated[np.ndarray, i8("16, 128")]
    plays: Annotated[np.ndarray, i8("16, parts")]
    pitch: Annotated[np.ndarray, f8("128")]
    bindings: Annotated[np.ndarray, struct(BINDING, "bindings")]
    bound: Annotated[np.ndarray, i8("129")]
    polyphony: int
    rate_hz: float
    respond: int  # address of the responder, and what it is called with
    core: int
    thread: int


#: what stands in the policy's table, in this order; of the State it changes part_state.hand, .channel and .strum_…, of the
#: counters N_NOTES, N_STOLEN, N_TAKEN, and not the meters
VOICE_PARTS = (Voices, State)
#: (address) → the Voices, the State that are there, in compiled code
voices_of, state_seen = opener(Voices), opener(State, words(Voices))


@njit(**CORE)
def go_on(voices: int, s: int) -> None:
    """String s is to move on to the frame of the event: before anything changes that its motion reads."""
    me = voices_of(voices)
    ask(me.respond, me.core, me.thread, GO_ON, s, 0)


@njit(**CORE)
def pluck(voices: int, k: int, velocity: int, legato: bool) -> None:
    me = voices_of(voices)
    ask(me.respond, me.core, me.thread, SLUR if legato else PLUCK, k, velocity)


@njit(**CORE)
def cut(voices: int, s: int) -> None:
    """String s is to be silent within 30 ms, without a click."""
    me = voices_of(voices)
    ask(me.respond, me.core, me.thread, CUT, s, 0)


@njit(**CORE)
def let_go(voices: int, s: int) -> None:
    me = voices_of(voices)
    ask(me.respond, me.core, me.thread, LET_GO, s, 0)
