"""Any number of threads gives the same samples, and none outlives its engine."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import threading

import numpy as np
import pytest

from synth.engine import layout, team
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON
from tests.patience import compiling_s

from .kit import (
    BRIDGE,
    BRIDGE_OBSTACLE,
    FORCE,
    FREE,
    NECK,
    RATE_HZ,
    engine,
    go_on_from,
    play,
    preset,
    random_events,
    steel,
    what_sounds,
)

FRAMES = 16000


def many() -> tuple:
    """Parts with 6 + 3 + 4 strings, more than may sound."""
    return FREE, BRIDGE, NECK


def dense(rng: np.random.Generator) -> list[tuple]:
    """Chords at odd frames over a held pedal, bends and pedal changes among them, more notes than strings are allowed."""
    rows: list[tuple] = [(3, CONTROL, 0, 64, 127), (5, CONTROL, 2, 64, 127)]
    for frame in range(1, FRAMES - 4000, 997):
        for channel, low, high in ((0, 48, 55), (1, 43, 48), (2, 28, 55)):
            note = int(rng.integers(low, high + 1))
            rows.append((frame + 2 * channel, NOTE_ON, channel, note, int(rng.integers(30, 128))))
            rows.append((frame + 711, NOTE_OFF, channel, note))
        rows.append((frame + 333, BEND, int(rng.integers(3)), int(rng.integers(-8192, 8192))))
        rows.append((frame + 501, CONTROL, 0, 64, int(rng.integers(2)) * 127))
    return rows


def band(threads: int):
    return engine(*many(), quality="standard", limiter=True, max_polyphony=7, threads=threads)


def workers() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "synth-string"]


def test_threads_change_no_bit():
    engines = {threads: band(threads) for threads in (1, 2, 3)}
    assert {threads: made._shared.team[team.WORKERS] for threads, made in engines.items()} == {1: 0, 2: 1, 3: 2}
    rng = np.random.default_rng(17)
    for events in (dense(rng), random_events(rng, 200, FRAMES - 2000, 3, (26, 56))):
        for blocks in (4096, 128):
            runs = {}
            for threads, made in engines.items():
                made.reset()
                stems = np.zeros((3, FRAMES, 2))
                runs[threads] = play(made, events, FRAMES, blocks, stems), stems, made.report()
            assert runs[1][0].any()
            for threads in (2, 3):
                assert np.array_equal(runs[threads][0], runs[1][0])
                assert np.array_equal(runs[threads][1], runs[1][1])
                assert runs[threads][2] == runs[1][2]
    for made in engines.values():
        made.close()


def test_strings_side_by_side_change_no_bit():
    """Two strings that only press are advanced in one kernel where they may be: the samples are those of each by itself."""
    notes = [("G2", "a"), ("C3", "b"), ("C3", "c"), ("G2", "d"), ("E3", "e")]
    five = preset(
        "five", "".join(steel(*each) for each in notes), obstacle=BRIDGE_OBSTACLE, output=FORCE, damping="ring_on = true"
    )
    rng, went = np.random.default_rng(5), {True: False, False: False}
    for quality in ("standard", "fine"):
        made = engine(five, quality=quality, limiter=True)
        for events in (random_events(rng, 80, FRAMES - 2000, 1, (43, 53)), [(0, NOTE_ON, 0, n, 90) for n in (43, 48, 48)]):
            runs = []
            for beside in (True, False):
                made.reset()
                steps = int(made._shared.task[layout.OFF_BOARD])
                if not beside:  # as where others make the steps
                    made._shared.task[layout.OFF_BOARD] = 0
                made._scratch[1].out[:] = np.nan  # of the string that goes beside another
                runs.append((play(made, events, FRAMES, 256), made.report()))
                made._shared.task[layout.OFF_BOARD] = steps
                went[beside] |= bool(np.isfinite(made._scratch[1].out).any())
            assert runs[0][0].any() and np.array_equal(runs[0][0], runs[1][0]) and runs[0][1] == runs[1][1]
    assert went == {True: True, False: False}


def test_workers_take_part():
    """Of many strings at work for a while at least one is advanced by the other thread, which sets its own work arrays."""
    eight = preset("eight", "".join(steel("G2", str(k)) for k in range(8)), polyphony=8)
    made = engine(eight, threads=2)
    made._worker_scratch[0][0].out[:] = np.nan
    for _ in range(50):
        play(made, [(k, NOTE_ON, 0, 43, 100) for k in range(8)], 44100, 4096)
        if np.isfinite(made._worker_scratch[0][0].out).any():
            break
    assert np.isfinite(made._worker_scratch[0][0].out).any()
    made.close()


def test_state_reaches_the_workers():
    made, alone = band(2), band(1)
    events = dense(np.random.default_rng(2))
    play(made, events, 5000)
    kept = what_sounds(made)
    rest = play(made, [], 6000)
    made.reset()
    go_on_from(made, kept)
    assert np.array_equal(play(made, [], 6000), rest)
    go_on_from(alone, kept)
    assert np.array_equal(play(alone, [], 6000), rest)
    made.close()


@pytest.mark.slow
def test_no_thread_outlives_its_engine():
    gc.collect()
    before = len(workers())
    closed = engine(FREE, threads=3)
    assert len(workers()) == before + 2
    assert closed._shared.team[team.WORKERS] == 2
    closed.close()
    closed.close()
    assert len(workers()) == before
    assert play(closed, [(0, NOTE_ON, 0, 50, 100)], 2000).any()
    again = engine(FREE, threads=2)
    again.prepare(RATE_HZ)
    assert len(workers()) == before + 1
    del again
    gc.collect()
    assert len(workers()) == before
    descriptors = len(os.listdir("/dev/fd"))
    for _ in range(10):
        made = engine(FREE, threads=2)
        play(made, [(0, NOTE_ON, 0, 50, 100)], 500)
        del made
        gc.collect()
    assert len(workers()) == before
    assert len(os.listdir("/dev/fd")) == descriptors


def test_no_more_threads_than_strings():
    made = engine(BRIDGE, threads=50)
    assert made._shared.team[team.WORKERS] == 2
    made.close()
    made = engine(preset("one", steel("G2")), threads="auto")
    assert made._team is None


@pytest.mark.parametrize("threads", [0, -1, 1.5, "many", None])
def test_a_number_of_threads_that_is_none(threads):
    with pytest.raises(ValueError, match="threads must be"):
        engine(FREE, threads=threads)


def test_engines_in_several_threads():
    """Two engines with workers, each played by a thread of its own, sound as they do one after the other."""
    events = dense(np.random.default_rng(4))
    wanted = play(band(1), events, FRAMES, 256)
    engines = [band(2), band(2)]
    heard: dict[int, np.ndarray] = {}
    players = [
        threading.Thread(target=lambda k=k, made=made: heard.update({k: play(made, events, FRAMES, 256)}))
        for k, made in enumerate(engines)
    ]
    for player in players:
        player.start()
    for player in players:
        player.join()
    for k, made in enumerate(engines):
        assert np.array_equal(heard[k], wanted)
        made.close()


def test_idling_leaves_everything_as_it_is():
    """Nothing sounds: no work is done and nothing changes but the clock, however long it lasts."""
    made = engine(*many(), threads=2)
    play(made, [(0, NOTE_ON, 0, 50, 90), (4000, CONTROL, 0, 120, 0)], 60000)
    assert made.silent
    play(made, [], 3 * 44100)
    work = made.mode_steps
    before = what_sounds(made)
    assert not play(made, [], 10 * layout.RING * layout.QUANTUM).any()
    assert made.mode_steps == work
    for name, array in made.memory.changing.items():
        if name not in ("counters", "effect_counts"):
            assert np.array_equal(array, before[name]), name
    made.close()


@pytest.mark.parametrize("ending", ["", "raise SystemExit(3)", "raise ValueError", "threading.Thread(target=work).start()"])
def test_the_interpreter_ends_with_workers_awake(ending):
    """In a process of its own, which also loads the compiled code from the cache."""
    program = f"""
import sys, threading
import numpy as np
from synth.engine.engine import Engine
from synth.midi.events import make_events
from synth.instrument.preset import load_preset
made = Engine([load_preset("tanpura-light")], threads=3, quality="draft", only_notes=[{{43, 48}}])
made.prepare(44100.0)
def work():
    made.process(make_events([(0, 1, 0, 43, 100), (9, 1, 0, 48, 100)]), np.zeros((4096, 2)))
work()
print("played", flush=True)
{ending}
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=compiling_s())
    assert done.stdout == "played\n", done.stderr
    assert done.returncode == {"raise SystemExit(3)": 3, "raise ValueError": 1}.get(ending, 0)
