"""The responder of the voice policy: what it asks for, done to the strings (`voices.voice_table`)."""

from __future__ import annotations

from numba import njit

from synth.engine.core import bank_of, progress_of, shared_of, state_of, voice_of
from synth.engine.hand_damping import CUT_S
from synth.engine.hold import begin_phase
from synth.engine.instruments import played_strings
from synth.engine.layout import (
    AWAKE,
    CORE,
    MOST_AWAKE,
    NO_FINGER,
    NOBODY,
    UNTIL,
    WORK_ON,
    Bank,
    Settings,
    Sounding,
)
from synth.engine.strings import damp, let_go, pluck
from synth.engine.voices.voice_table import CUT, GO_ON, LET_GO, PLUCK, SLUR, Voices
from synth.jit.entries import entry
from synth.native.arrays import fields
from synth.native.views import call_back


@njit(**CORE)
def perform(core: int, thread: int, action: int, place: int, velocity: int) -> None:
    """One action of `voices.voice_table`."""
    if action == GO_ON:
        _go_on(core, thread, place)
    elif action == PLUCK or action == SLUR:
        _pluck(core, thread, place, float(velocity), action == SLUR)
    elif action == CUT:
        begin_phase(core, place, NO_FINGER)
        damp(core, place, CUT_S)
    elif action == LET_GO:
        let_go(core, thread, place)


@njit(**CORE)
def _go_on(core: int, thread: int, s: int) -> None:
    """Let a string that is about to be touched go on to the frame of the event."""
    shared = shared_of(core)
    voice, progress = voice_of(core, s), progress_of(core, s)
    if voice.awake and progress.reached < shared.task[UNTIL]:
        i = bank_of(core).strings[s].instrument
        before = played_strings(core, i)
        call_back(shared.task[WORK_ON], core, thread, i, NOBODY)
        state_of(core).counters[AWAKE] -= before - played_strings(core, i)  # had blown up
    progress.reached = shared.task[UNTIL]


@njit(**CORE)
def _pluck(core: int, thread: int, k: int, velocity: float, legato: bool) -> None:
    position, state = bank_of(core).positions[k], state_of(core)
    voice = voice_of(core, position.string)
    if not voice.awake or voice.idle:
        state.counters[AWAKE] += 1
        state.counters[MOST_AWAKE] = max(state.counters[MOST_AWAKE], state.counters[AWAKE])
    pluck(core, thread, position.string, position.model, velocity, legato)


def respond(core: int, thread: int, action: int, place: int, velocity: int) -> None:
    perform(core, thread, action, place, velocity)


def voices_for(bank: Bank, sounding: Sounding, settings: Settings, core: int, thread: int) -> Voices:
    """The policy's view of an engine whose strings it moves."""
    arrays = bank._asdict() | sounding._asdict()
    seen = {name: arrays[name] for name, field in fields(Voices).items() if field.shape}
    return Voices(
        **seen,
        polyphony=settings.polyphony,
        rate_hz=settings.rate_hz,
        respond=entry(respond, 5).address,
        core=core,
        thread=thread,
    )
