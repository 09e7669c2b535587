"""Articulations that a song has switched to stay when a note in between is played by the fallback."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from synth.engine.engine import Engine
from synth.host.compass import Arrangement, Wishes, arrange, channel_rows
from synth.host.parts import Casting, Part
from synth.midi.events import CONTROL, EVENT, NOTE_OFF, NOTE_ON, PROGRAM, make_events
from synth.midi.song import song_of
from tests.engine import kit

WAYS = """
[articulations.normal]
key = "C0"
[articulations.mute]
key = "D0"
controller = 20
touch = { place = 0.05, resistance = 2.0 }
[articulations.near]
key = "E0"
controller = { number = 21, low = 20, high = 90 }
position = 0.05
[articulations.far]
controller = { number = 20, low = 1, high = 30 }
position = 0.4
"""
OTHER_WAYS = """
[articulations.normal]
key = "C0"
[articulations.near]
key = "F0"
controller = { number = 20, low = 40, high = 90 }
position = 0.05
"""
#: C3 and D3; E3 is what the fallback plays
SWITCHED = kit.preset("switched", kit.steel("C3") + kit.steel("D3"), more=WAYS)
OTHER = kit.preset("other", kit.steel("C3") + kit.steel("D3"), more=OTHER_WAYS)
FREE = kit.FREE
PRESETS = {"switched": SWITCHED, "other": OTHER, "free": FREE}
PARTS = [Part(c, name, 0) for c in (0, 15) for name in ("switched", "other")]
MUTE, RESCUED = 14, 52


def casting() -> Casting:
    program_map = np.full((16, 128), -1, np.int64)
    program_map[:15, 0], program_map[:15, 1], program_map[15, 0], program_map[15, 1] = 0, 1, 2, 3
    return Casting(tuple(PARTS), program_map, {})


def arranged(rows: list[tuple], fallback: str | None, mpe: bool = False) -> Arrangement:
    song = song_of(make_events([(frame, *row) for frame, row in enumerate(rows)]), 44100, 1.0, mpe)
    return arrange(song, song.events, casting(), PRESETS, Wishes(fallback=fallback), mpe, {22})


def standing(engine: Engine, events: np.ndarray) -> np.ndarray:
    """(16, 2) articulation and ruling articulation of every channel after these events."""
    engine.reset()
    engine.process(np.ascontiguousarray(events, EVENT), np.zeros((4096, 2)))
    channels = engine._state.channels
    return np.stack((channels["articulation"], channels["ruled"]), axis=1)


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "mpe"])
def mpe(request: pytest.FixtureRequest) -> bool:
    return request.param


@pytest.fixture(scope="module")
def engine(mpe: bool) -> Iterator[Engine]:
    """Parts as the fallback adds them: one for channel 0, one for channel 15, wherever it is needed."""
    found = arranged([(NOTE_ON, 0, RESCUED, 90), (NOTE_ON, 15, RESCUED, 90)], "free").casting
    made = Engine([PRESETS[part.preset] for part in found.parts], _spares(), mpe=mpe, warn=lambda text: None)
    made.prepare(44100, 4096)
    yield made
    made.close()


def _spares() -> np.ndarray:
    program_map = casting().program_map
    program_map[:, 127] = 4
    return program_map


def random_rows(seed: int, leaders: tuple[int, ...]) -> list[tuple]:
    """Keys, controllers, programs (of channels that no other leads, never the same twice), resets, zones, and now and then
    a note to be rescued."""
    rng = np.random.default_rng(seed)
    programs = dict.fromkeys(range(16), 0)
    rows: list[tuple] = []
    for _ in range(300):
        c = int(rng.choice([0, 1, 2, 14, 15]))
        what = rng.choice(6, p=[0.3, 0.3, 0.05, 0.05, 0.01, 0.29])
        if what == 0:
            rows.append((NOTE_ON, c, int(rng.choice([12, 14, 16, 17])), 90))
        elif what == 1:
            rows.append((CONTROL, c, int(rng.choice([20, 20, 21, 22])), int(rng.integers(0, 128))))
        elif what == 2 and c in leaders:
            programs[c] = 1 - programs[c]
            rows.append((PROGRAM, c, programs[c]))
        elif what == 3:
            rows.append((CONTROL, c, 121, 0))
        elif what == 4 and c in (0, 15):
            rows += [(CONTROL, c, 101, 0), (CONTROL, c, 100, 6), (CONTROL, c, 6, int(rng.integers(0, 4)))]
        elif what == 5:
            rows += [(NOTE_ON, c, RESCUED, 90), (NOTE_OFF, c, RESCUED, 64)]
    return rows


@pytest.mark.parametrize("seed", range(12))
def test_wherever_notes_are_rescued_articulations_stand_as_if_there_were_none(engine: Engine, mpe: bool, seed: int) -> None:
    rows = random_rows(seed, (0,) if mpe else (0, 15))
    rescued, plain = arranged(rows, "free", mpe).events, arranged(rows, None, mpe).events
    assert np.count_nonzero(rescued["kind"] == PROGRAM) > 20 + np.count_nonzero(plain["kind"] == PROGRAM)
    asked = 0
    for end in (50, 100, 150, 200, 250, len(rows)):
        found, expected = (standing(engine, events[events["frame"] < end]) for events in (rescued, plain))
        np.testing.assert_array_equal(found, expected)
        asked += np.count_nonzero(expected > 0)
    assert asked


def test_a_rescued_note_is_followed_by_the_key_and_the_controller_that_were_in_force() -> None:
    rows = [(NOTE_ON, 0, MUTE, 90), (CONTROL, 0, 21, 50), (NOTE_ON, 0, RESCUED, 90), (NOTE_ON, 0, 48, 90)]
    found = arranged(rows, "free")
    spare = int(found.events["a"][found.events["kind"] == PROGRAM][0])
    assert [tuple(row)[1:5] for row in found.events.tolist()] == [
        (NOTE_ON, 0, MUTE, 90), (CONTROL, 0, 21, 50),
        (PROGRAM, 0, spare, 0), (NOTE_ON, 0, RESCUED, 90), (PROGRAM, 0, 0, 0), (NOTE_ON, 0, MUTE, 90), (CONTROL, 0, 21, 50),
        (NOTE_ON, 0, 48, 90),
    ]  # fmt: skip
    # keys that switch are no notes, however often they are struck
    assert [(row["preset"], row["notes"]) for row in channel_rows(found, PRESETS, slice(0, 99))] == [
        ("switched", 1), ("free", 1),
    ]  # fmt: skip


def test_what_nothing_asks_for_is_not_said_again() -> None:
    for before in (
        [],
        [(NOTE_ON, 0, MUTE, 90), (PROGRAM, 0, 1)],
        [(NOTE_ON, 0, MUTE, 90), (CONTROL, 0, 121, 0)],
        [(NOTE_ON, 1, MUTE, 90)],
        [(CONTROL, 0, 20, 100), (CONTROL, 0, 20, 40)],
        [(CONTROL, 0, 22, 100)],
    ):
        found = arranged([*before, (NOTE_ON, 0, RESCUED, 90)], "free").events.tolist()
        assert [row[1] for row in found[len(before) :]] == [PROGRAM, NOTE_ON, PROGRAM], before


def test_another_program_of_the_same_part_takes_nothing_back() -> None:
    found = arranged([(NOTE_ON, 0, MUTE, 90), (PROGRAM, 0, 0), (NOTE_ON, 0, RESCUED, 90)], "free").events
    assert found["a"].tolist()[-1] == MUTE and found["kind"].tolist()[-1] == NOTE_ON
