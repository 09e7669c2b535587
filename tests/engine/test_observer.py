"""An observer in the place of what the engine calls: what it sees, what sounds, and when there can be none."""

from typing import Annotated, NamedTuple

import numpy as np
import pytest

from synth.engine.core import CORE_WORDS
from synth.engine.engine import Engine
from synth.engine.layout import QUANTUM, STEP, TOGETHER, UNTIL
from synth.instrument.preset import load_preset
from synth.midi.events import EVENT, NOTE_ON, make_events
from synth.native.arrays import allocate, i8
from synth.native.views import call_back, opener


class Steps(NamedTuple):
    """Steps that each string made."""

    made: Annotated[np.ndarray, i8("strings")]
    own: int


steps_of = opener(Steps, CORE_WORDS)


def counted_steps(core: int, thread: int, s: int, steps: int) -> None:
    watched = steps_of(core)
    watched.made[s] += steps
    call_back(watched.own, core, thread, s, steps)


def prepared(**options) -> Engine:
    engine = Engine([load_preset("tanpura-light")], quality="draft", only_notes=[{48, 55}], **options)
    engine.prepare(44100.0, 512)
    return engine


def played(engine: Engine) -> np.ndarray:
    """(frames, 2) of a note; more events than the queue of an engine holds, so that it gets another."""
    engine.reserve(5000)
    out = np.zeros((4096, 2))
    engine.process(make_events([(0, NOTE_ON, 0, 48, 100)]), out[:512])
    for at in range(512, len(out), 512):
        engine.process(np.zeros(0, EVENT), out[at : at + 512])
    return out


def observed(engine: Engine) -> Steps:
    strings = engine.memory.built.bank.strings.size
    return engine.observe(STEP, counted_steps, lambda own: allocate(Steps, {"strings": strings}, own=own))


def test_an_observer_sees_every_step_and_changes_no_sound() -> None:
    engine = prepared(economy=False)
    steps = observed(engine)
    heard = played(engine)
    assert np.array_equal(heard, played(prepared(economy=False)))
    awake = np.flatnonzero(steps.made)
    assert awake.size == 1 and steps.made[awake[0]] >= len(heard) - QUANTUM


def test_prepared_anew_it_is_observed_by_nobody_and_can_be_again() -> None:
    engine = prepared()
    first = observed(engine)
    with pytest.raises(ValueError, match="an engine must have one observer, got a second; prepare it anew"):
        observed(engine)
    engine.prepare(44100.0, 512)
    played(engine)
    assert not first.made.any()
    second = observed(engine)
    engine.reset()
    played(engine)
    assert second.made.any()


def test_only_an_engine_that_is_prepared_and_has_one_thread_is_observed() -> None:
    engine = Engine([load_preset("tanpura-light")])
    with pytest.raises(ValueError, match="not prepared"):
        engine.observe(STEP, counted_steps, lambda own: allocate(Steps, {"strings": 1}, own=own))
    engine = prepared(threads=2)
    with pytest.raises(ValueError, match="must have one thread, got threads 2; make it with threads=1"):
        observed(engine)
    engine.close()


def test_only_what_the_engine_calls_is_observed() -> None:
    with pytest.raises(ValueError, match=r"place must be layout\.STEP"):
        prepared().observe(UNTIL, counted_steps, lambda own: allocate(Steps, {"strings": 1}, own=own))
    with pytest.raises(ValueError, match="must have strings that share a bridge, got none"):
        prepared().observe(TOGETHER, counted_steps, lambda own: allocate(Steps, {"strings": 1}, own=own))
