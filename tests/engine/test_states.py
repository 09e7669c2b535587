"""States and copies: what was kept is gone on from, to the bit; what is not a state is refused, and changes nothing."""

from __future__ import annotations

import copy
import json
import pickle
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from synth.engine import layout, snapshot
from synth.engine.engine import Engine
from synth.live.deck import Deck
from synth.midi.events import BEND, NOTE_ON
from synth.solver.stringmodel import CLOCK, MOVING
from tests.patience import compiling_s

from .kit import BRIDGE, FREE, NECK, SHARED, engine, play, preset, steel

NOTES = [(0, NOTE_ON, 0, 43, 100), (50, BEND, 0, 3000), (300, NOTE_ON, 0, 48, 90)]


def sealed(state: bytes, at: int, new: bytes) -> bytes:
    """The state with other bytes from `at` on, and a checksum that is right."""
    body = state[:at] + new + state[at + len(new) : -snapshot._DIGEST]
    return body + snapshot._digest(body)


def place(made: Engine, name: str, index: tuple[int, ...] = (0,), field: str | None = None) -> int:
    """Where a number of the state lies in its bytes; no event waits."""
    at = snapshot._HEAD
    for other, array in made.memory.changing.items():
        if other == name:
            at += int(np.ravel_multi_index(index, array.shape)) * array.dtype.itemsize
            return at if field is None else at + array.dtype.fields[field][1]
        at += 0 if other == "pending" else array.nbytes
    raise KeyError(name)


def refuses(made: Engine, name: str, index: tuple[int, ...], field: str | None, value: float, said: str) -> None:
    """Its own state with another number in it, and stays as it was."""
    mine = made.get_state()
    kind = made.memory.changing[name].dtype
    new = np.array(value).astype(kind if field is None else kind[field]).tobytes()
    with pytest.raises(ValueError, match=said):
        made.set_state(sealed(mine, place(made, name, index, field), new))
    assert made.get_state() == mine


def test_foreign_and_broken_states_are_refused():
    made = engine(FREE)
    play(made, [(0, NOTE_ON, 0, 50, 100)], 1000)
    mine = made.get_state()
    before = play(made, [], 500)
    made.set_state(mine)
    like = preset("free", steel("C3-E3") + steel("G3"), output='kind = "displacement"\nposition = 0.2\ngain_db = 50')
    for other in (engine(BRIDGE), engine(like), engine(FREE, limiter=True)):
        with pytest.raises(ValueError, match="other presets, rate or quality"):
            made.set_state(other.get_state())
    for junk in (b"", b"nonsense", mine[:1000], mine[:-30], mine + b"0", mine[:2000] + b"\xff" * 50 + mine[2050:]):
        with pytest.raises(ValueError, match="not a state"):
            made.set_state(junk)
    with pytest.raises(ValueError, match="an earlier version"):
        made.set_state(b"PK\x03\x04" + bytes(1000))
    with pytest.raises(ValueError, match=f"version 7, this program reads {snapshot.VERSION}"):
        made.set_state(sealed(mine, len(snapshot.MAGIC), (7).to_bytes(4, "little")))
    with pytest.raises(ValueError, match="pending events, and at most"):
        made.set_state(sealed(mine, snapshot._HEAD - 8, b"\xff" * 8))
    for wrong in ("a state", None, 5, np.zeros(3)):
        with pytest.raises(TypeError, match="a state is the bytes that get_state gives"):
            made.set_state(wrong)
    with pytest.raises(ValueError, match="call prepare"):
        Engine([FREE]).set_state(mine)
    assert np.array_equal(play(made, [], 500), before)


@pytest.mark.parametrize(
    ("name", "index", "field", "value", "said"),
    [
        ("sounding", (0,), "model", 10**6, r"sounding.model\[0\] must lie between 0 and"),
        ("sounding", (0,), "model", 1, r"sounding.model\[0\] is 1, which belongs to another string"),
        ("sounding", (0,), "channel", 16, r"sounding.channel\[0\] must lie between 0 and 15, got 16"),
        ("sounding", (0,), "phase", 7, r"sounding.phase\[0\] must lie between 0 and 6"),
        ("sounding", (0,), "row_to", 64, r"sounding.row_to\[0\] must lie between 0 and 0"),
        ("sounding", (0,), "hand", np.nan, r"sounding.hand\[0\] must lie between"),
        ("sounding", (1,), "finger_steps", 2**60, r"sounding.finger_steps\[1\] must lie between 1 and"),
        ("channels", (3,), "master", 4, "channels.master does not match the MPE zones"),
        ("counters", (layout.NOW,), None, 10**15, "frames computed"),
        ("counters", (layout.PENDING,), None, 1, "1 pending events are announced, 0 are stored"),
        ("string.q", (0,), None, np.nan, r"string.q\[0\] must lie between"),
        ("string.counts", (MOVING,), None, 0, r"string.counts\[0\] must lie between 1 and"),
        ("string.counts", (MOVING,), None, 10**6, r"string.counts\[0\] must lie between 0 and"),
        ("string.counts", (CLOCK,), None, -1, r"string.counts\[1\] must lie between 0 and"),
        ("string.finger", (0,), "on", 2, r"string.finger.on\[0\] must lie between 0 and 1, got 2"),
        ("string.looked", (0,), None, 2, r"string.looked\[0\] must lie between 0 and 1, got 2"),
        ("effect_counts", (0,), None, 64, "limiter: the place in the delay must lie between 0 and 63, got 64"),
        # delay, required, released in whole cache lines, then the levels
        ("effect_numbers", (128 + 2 * 136,), None, 1.0, "limiter: reductions must lie between 0 and 1"),
        ("effect_numbers", (3,), None, np.nan, r"effect_numbers\[3\] must lie between"),
        ("lines", (5,), None, np.inf, r"lines\[5\] must lie between"),
    ],
)
def test_each_number_of_a_state_is_looked_at(name, index, field, value, said):
    made = engine(BRIDGE, limiter=True)
    play(made, NOTES, 401)
    refuses(made, name, index, field, value, said)


@pytest.mark.parametrize(
    ("name", "index", "field", "value", "said"),
    [
        ("sounding", (2,), "awake", 0, "sounding.awake differs between strings that share a bridge"),
        ("sounding", (0,), "idle", 2, r"sounding.idle\[0\] must lie between 0 and 1, got 2"),
        ("sounding", (5,), "idle", 1, r"sounding.idle\[5\] is 1, but the string shares no bridge"),
        ("sounding", (1,), "model", 0, r"sounding.model\[1\] is 0, which belongs to another string"),
        ("sounding", (0,), "pending_model", 3, r"sounding.pending_model\[0\] is 3, which belongs to another string"),
        ("sounding", (0,), "finger_step", 1, r"sounding.finger_step\[0\] is 1, which is not a whole number of frames"),
        ("end.counts", (0,), None, 2, r"end.counts\[0\] must lie between 0 and 1, got 2"),
        ("end.counts", (1,), None, 1000, r"end.counts\[1\] must lie between 0 and \d\d?, got 1000"),
        ("end.counts", (2,), None, -1, r"end.counts\[2\] must lie between 0 and 1, got -1"),
        ("end.counts", (3,), None, 10**4, r"end.counts\[3\] must lie between 0 and \d+, got 10000"),
        ("end.kick", (0,), None, np.nan, r"end.kick\[0\] must lie between"),
        ("body.0.counts", (1,), None, -1, r"body.0.counts\[1\] must lie between 0 and"),
        ("body.0.p", (0,), None, np.inf, r"body.0.p\[0\] must lie between"),
    ],
)
def test_each_number_of_strings_that_share_a_bridge_is_looked_at(name, index, field, value, said):
    made = engine(SHARED, FREE)
    play(made, [(0, NOTE_ON, 0, 43, 100), (3000, NOTE_ON, 0, 44, 100)], 3041)
    assert made._state.sounding["phase"][0] == layout.PRESS
    refuses(made, name, index, field, value, said)


def test_an_idle_string_is_awake():
    refuses(engine(SHARED), "sounding", (0,), "idle", 1, r"sounding\.idle\[0\] is 1, but the string is not awake")


@pytest.mark.slow
def test_broken_states_are_refused_or_no_harm():
    """In a process of its own, which would end with a signal otherwise; `broken_states.py` alone does more of them."""
    program = Path(__file__).with_name("broken_states.py")
    root = Path(__file__).parents[2]
    done = subprocess.run(
        [sys.executable, str(program), "400", "20"],
        capture_output=True,
        text=True,
        timeout=compiling_s(),
        cwd=root,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    counts = json.loads(done.stdout)
    silenced = counts.pop("silenced", 0)
    assert sum(counts.values()) == 400 and silenced > 0
    assert counts["numbers refused"] > 50 and counts["numbers harmless"] > 20
    assert not {"bytes harmless", "length harmless", "head harmless"} & set(counts)


@pytest.mark.parametrize("way", ["copy", "deepcopy", "pickle"])
def test_a_copy_is_an_engine_of_its_own(way):
    copied = {"copy": copy.copy, "deepcopy": copy.deepcopy, "pickle": lambda each: pickle.loads(pickle.dumps(each))}[way]
    bindings = {20: "damping.release"}
    made = engine(BRIDGE, NECK, quality="draft", limiter=True, threads=2, max_polyphony=3, bindings=bindings, gain_db=-3.0)
    play(made, NOTES, 2001)
    other = copied(made)
    assert not set(other.addresses) & set(made.addresses)
    assert other._team is not None and other._team is not made._team
    later = [(700, NOTE_ON, 1, 40, 90)]
    assert np.array_equal(play(other, later, 3000), play(made, later, 3000))
    assert other.report() == made.report() and repr(other) == repr(made)
    made.close()
    assert play(other, NOTES, 500).any()
    other.close()


def test_a_copy_of_an_engine_that_is_not_prepared_is_none_either():
    other = pickle.loads(pickle.dumps(Engine([FREE], quality="draft", threads=2)))
    assert repr(other) == "<Engine free: draft, exact-hold, not prepared>"
    with pytest.raises(ValueError, match="call prepare"):
        other.get_state()


def test_what_holds_addresses_is_not_copied():
    made = engine(FREE, quality="draft", threads=2)
    for held in (made._team, Deck(made)):
        for copied in (copy.copy, copy.deepcopy, pickle.dumps):
            with pytest.raises(TypeError, match=f"{type(held).__name__} cannot be copied or pickled"):
                copied(held)
    made.close()


def test_a_pickled_engine_sounds_in_another_process(tmp_path):
    made = engine(BRIDGE, quality="draft", limiter=True)
    play(made, NOTES, 1000)
    kept = tmp_path / "engine"
    kept.write_bytes(pickle.dumps(made))
    program = f"""
        import pickle, sys
        import numpy as np
        from synth.midi.events import EVENT
        with open({str(kept)!r}, "rb") as file:
            made = pickle.load(file)
        out = np.zeros((700, 2))
        made.process(np.zeros(0, EVENT), out)
        sys.stdout.buffer.write(out.tobytes())
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, timeout=compiling_s(), check=False
    )
    assert done.returncode == 0, done.stderr
    assert np.array_equal(np.frombuffer(done.stdout).reshape(700, 2), play(made, [], 700))


def test_a_forked_child_goes_on_alone():
    """It has no workers; in its parent they work on."""
    program = """
        import os, sys, warnings
        import numpy as np
        from synth.engine.engine import Engine
        from synth.engine import team
        from synth.midi.events import make_events
        from synth.instrument.preset import load_preset
        warnings.simplefilter("ignore")  # that threads and fork do not go together
        made = Engine([load_preset("tanpura-light")], threads=3, quality="draft", only_notes=[{43, 48}])
        made.prepare(44100.0)
        notes = make_events([(0, 1, 0, 43, 100), (9, 1, 0, 48, 100)])
        made.process(notes, np.zeros((2000, 2)))
        here, there = os.pipe()
        child = os.fork()
        out = np.zeros((2000, 2))
        if child == 0:
            made.process(notes, out)
            os.write(there, bytes([made._shared.team[team.WORKERS]]) + out.tobytes())
            os._exit(0)
        os.close(there)
        made.process(notes, out)
        with os.fdopen(here, "rb") as file:
            workers, heard = file.read(1)[0], np.frombuffer(file.read()).reshape(-1, 2)
        assert os.waitpid(child, 0)[1] == 0
        assert workers == 0 and made._shared.team[team.WORKERS] > 0
        assert out.any() and np.array_equal(heard, out)
        made.close()
        print("done")
    """
    program = textwrap.dedent(program)
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=compiling_s(), check=False
    )
    assert done.stdout == "done\n", done.stderr
