"""Instruments: what is one task, and when its strings may sleep or fly."""

from functools import partial

import numpy as np
import pytest

from synth.engine import engine as module
from synth.engine.bank import build_bank
from synth.midi.events import BEND, NOTE_OFF, NOTE_ON
from synth.solver.stringmodel import FREE

from .kit import BRIDGE, NECK, awake, bank_of, engine, play, string_of
from .kit import FREE as OPEN

ROWS = [
    (0, NOTE_ON, 0, 43, 110), (64, NOTE_ON, 0, 48, 90), (704, NOTE_ON, 1, 50, 100), (1312, BEND, 0, 3000),
    (2016, NOTE_ON, 1, 48, 120), (2496, NOTE_ON, 0, 43, 60), (3008, NOTE_OFF, 0, 48),
]  # fmt: skip


@pytest.fixture
def together(monkeypatch):
    """Engines whose parts are one instrument each, from here on."""
    monkeypatch.setattr(module, "build_bank", partial(build_bank, together=(0, 1, 2)))


def test_a_string_that_shares_nothing_is_an_instrument():
    bank = bank_of(engine(BRIDGE, OPEN))
    assert bank.instruments.size == bank.strings.size > 2
    assert bank.strings["instrument"].tolist() == list(range(bank.strings.size))
    assert (bank.instruments["end_string"] - bank.instruments["first_string"] == 1).all()


def test_strings_that_are_together_but_not_coupled_sound_as_they_do_alone(request):
    """At `fine`, where nothing flies, as long as nothing sleeps, and events are where quanta begin: together, all strings
    go on to an event's frame, and what is left of a block is stepped one by one."""
    alone = play(engine(BRIDGE, OPEN, quality="fine"), ROWS, 6000)
    request.getfixturevalue("together")
    made = engine(BRIDGE, OPEN, quality="fine")
    bank = bank_of(made)
    assert bank.instruments["together"].tolist() == [1, 1]
    assert bank.instruments["end_string"][-1] == bank.strings.size
    assert np.array_equal(play(made, ROWS, 6000), alone)


def test_neither_blocks_nor_threads_matter_to_strings_that_are_together(together):
    rows = [(row[0] + 5 * number, *row[1:]) for number, row in enumerate(ROWS)]
    runs = []
    for threads, block in ((1, 4096), (1, 97), (2, 4096), (2, 1)):
        made = engine(BRIDGE, OPEN, NECK, threads=threads)
        runs.append(play(made, rows, 6000, block))
        made.close()
    assert runs[0].any() and all(np.array_equal(run, runs[0]) for run in runs[1:])


def test_none_sleeps_before_all_are_quiet(request):
    """A string that is damped and one that rings: alone the first sleeps, together it waits."""
    rows = [(0, NOTE_ON, 0, 48, 100), (0, NOTE_ON, 0, 50, 127), (3000, NOTE_OFF, 0, 48)]
    made = engine(OPEN)
    play(made, rows, 44100)
    assert len(awake(made)) == 1
    request.getfixturevalue("together")
    made = engine(OPEN)
    play(made, rows, 44100)
    assert len(awake(made)) == 2
    play(made, [(0, NOTE_OFF, 0, 50)], 88200)
    assert made.silent


def test_none_flies_before_all_are_free(request):
    """A string over a fret that it touches no more, and one that still does."""
    rows = [(0, NOTE_ON, 0, 50, 5), (4000, NOTE_ON, 0, 28, 127)]
    flying = []
    for _ in range(2):
        made = engine(NECK)
        play(made, rows, 5500)
        loud, soft = awake(made)
        assert not string_of(made, loud).counts[FREE]
        flying.append(bool(made._sounding.motions["flying"][soft]))
        request.getfixturevalue("together")
    assert flying == [True, False]
