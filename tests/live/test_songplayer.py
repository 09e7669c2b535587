"""A song that is paused and gone through: what the engine is given, and how its controls stand afterwards."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from synth import Engine
from synth.engine.layout import GAIN, PLUCK_POSITION
from synth.live.chase import PowerUp, at_frame, controls_at, let_go_rows, power_up_rows
from synth.live.deck import Deck
from synth.live.songplayer import LEAD_S, SongPlayer, power_up_of
from synth.midi.events import (
    BEND,
    CONTROL,
    EVENT,
    NOTE_OFF,
    NOTE_ON,
    PARAMETER,
    PRESSURE,
    PROGRAM,
    TUNING,
    make_events,
)
from tests.engine import kit

from .deckkit import Card, offline

RATE = 44100
BLOCK = 512


# --- how the controls stand at a place


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "mpe"])
def engines(request) -> Iterator[tuple[Engine, Engine]]:
    """Two alike, with a bound controller, two parts on some channels."""
    made = [Engine([kit.FREE], mpe=request.param, bindings={1: [(None, "pluck.position", None, None)]}) for _ in range(2)]
    for each in made:
        each.prepare(RATE, 4096)
    yield made[0], made[1]
    for each in made:
        each.close()


def standing(engine: Engine) -> dict[str, np.ndarray]:
    """All that events other than notes set, as it is."""
    state = engine._state
    channels = {f"channel {name}": state.channels[name].copy() for name in state.channels.dtype.names if name != "bend"}
    return channels | {"parameters": state.parameters.copy(), "tuning": state.tuning.copy(), "zones": state.zones.copy()}


def differing(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> list[str]:
    # volume is a square of a fraction
    return [name for name in one if not np.allclose(one[name], other[name], rtol=0.0, atol=1e-12)]


def random_controls(seed: int, count: int) -> list[tuple]:
    """Rows of all kinds, with the sequences by which registered parameters are set, broken off at times."""
    rng = np.random.default_rng(seed)
    rows: list[tuple] = []
    for _ in range(count):
        c, value = int(rng.choice([0, 1, 2, 15])), int(rng.integers(0, 128))
        kinds = [
            [(CONTROL, c, int(rng.choice([1, 7, 10, 11, 64, 68, 74, 66, 20])), value)],
            [(BEND, c, int(rng.integers(-8192, 8192)))],
            [(PROGRAM, c, value), (PRESSURE, c, 0, value)],
            [(CONTROL, c, 101, 0), (CONTROL, c, 100, 0), (CONTROL, c, 6, value % 97), (CONTROL, c, 38, value % 100)],
            [(CONTROL, c, int(rng.choice([6, 38, 96, 98, 99, 100, 101])), int(rng.choice([0, 6, 127, value])))],
            [(CONTROL, c, 101, 0), (CONTROL, c, 100, 6), (CONTROL, c, 6, value % 16)],
            [(CONTROL, c, int(rng.choice([121, 121, 123, 120])), 0)],
            [(TUNING, 0, value, value % 2, float(value) + float(rng.uniform(-2, 2)))],
            [(PARAMETER, 0, int(rng.choice([GAIN, PLUCK_POSITION])), 0, float(rng.uniform(0.1, 0.4)))],
        ]
        rows += kinds[int(rng.choice(9, p=[0.3, 0.15, 0.1, 0.12, 0.1, 0.03, 0.05, 0.1, 0.05]))]
    return [(frame, *row) for frame, row in enumerate(rows)]


def give(engine: Engine, events: np.ndarray) -> None:
    """All at once, in their order."""
    events = events.copy()
    events["frame"] = 0
    engine.process(np.ascontiguousarray(events, EVENT), np.zeros((256, 2)))


@pytest.mark.parametrize("seed", range(20))
def test_wherever_one_jumps_controls_stand_as_if_all_before_had_been_played(
    engines: tuple[Engine, Engine], seed: int
) -> None:
    jumped, played = engines
    song = make_events(random_controls(seed, 120))
    power_up = power_up_of(played, {1: [(None, "pluck.position", None, None)]})
    for place in np.random.default_rng(seed).integers(0, len(song), 3):
        for engine in engines:
            engine.reset()
        give(played, song[:place])
        give(jumped, song)  # wherever it comes from
        give(jumped, at_frame(power_up_rows(song, power_up) + controls_at(song, int(place), mpe=played.settings.mpe), 0))
        assert differing(standing(jumped), standing(played)) == []


def test_what_is_told_of_a_long_song_is_short() -> None:
    rows = [(CONTROL, 0, 101, 0), (CONTROL, 0, 100, 0)]
    for k in range(5000):
        rows += [(CONTROL, k % 3, 11, k % 128), (BEND, k % 3, k), (CONTROL, 0, 6, k % 12)]
    rows = controls_at(make_events([(frame, *row) for frame, row in enumerate(rows)]))
    assert len(rows) == 3 + 3 + 3 + 2


def test_what_is_held_is_let_go_of_and_nothing_else() -> None:
    rows = [
        (0, NOTE_ON, 0, 40, 90),
        (1, NOTE_ON, 1, 40, 90),
        (2, NOTE_ON, 0, 43, 90),
        (3, NOTE_OFF, 0, 40, 64),
        (4, NOTE_ON, 1, 50, 90),
        (5, NOTE_ON, 1, 50, 0),
        (6, CONTROL, 0, 64, 127),
        (7, CONTROL, 1, 64, 127),
        (8, CONTROL, 1, 64, 0),
    ]
    expected = [(NOTE_OFF, 0, 43, 64, 0.0), (NOTE_OFF, 1, 40, 64, 0.0), (CONTROL, 0, 64, 0, 0.0)]
    assert let_go_rows(make_events(rows), 0, 9) == expected
    assert let_go_rows(make_events(rows), 3, 6) == []


# --- on a deck


@pytest.fixture(scope="module")
def engine() -> Iterator[Engine]:
    made = kit.engine(kit.FREE)
    yield made
    made.close()


class Stage:
    """A song on a deck that a card asks; the player is fed between blocks, as a session does."""

    def __init__(self, engine: Engine, rows: list[tuple], seconds: float, *, every: int = 1) -> None:
        engine.reset()
        self.deck = Deck(engine, record=True)
        self.card = Card(self.deck)
        self.song = make_events(rows)
        self.length = round(seconds * RATE)
        power_up = power_up_of(engine, {})
        self.player = SongPlayer(self.song, self.length, engine.latency_samples, RATE, power_up)
        self.blocks: list[np.ndarray] = []
        self.given = np.zeros(0, EVENT)
        self._every = every

    def play(self, seconds: float) -> None:
        for k in range(round(seconds * RATE / BLOCK)):
            if k % self._every == 0:
                self.player.feed(self.deck)
            self.blocks.append(self.card.ask(BLOCK))
        self.given = np.concatenate((self.given, self.deck.drain_events()))

    @property
    def sound(self) -> np.ndarray:
        return np.concatenate(self.blocks)

    def notes(self, *, after: int = 0) -> list[tuple[int, int]]:
        """(frame, key) of the notes given from a frame of the stream on."""
        on = self.given[(self.given["kind"] == NOTE_ON) & (self.given["frame"] >= after)]
        return list(zip(on["frame"].tolist(), on["a"].tolist(), strict=True))


#: C3, which the preset has a string for
KEY = 48


def scale(count: int = 20, every_s: float = 0.25) -> list[tuple]:
    """A note on its own channel's key every so often; it is held until the next."""
    rows: list[tuple] = []
    for k in range(count):
        at = round(k * every_s * RATE)
        if k:
            rows.append((at, NOTE_OFF, 0, KEY, 64))
        rows += [(at, CONTROL, 0, 11, 60 + k), (at, NOTE_ON, 0, KEY, 40 + k)]
    return rows


def test_undisturbed_it_is_the_song_to_the_frame(engine: Engine) -> None:
    stage = Stage(engine, scale(), 5.0)
    stage.play(5.0)
    for name in EVENT.names:
        np.testing.assert_array_equal(stage.given[name], stage.song[name][: len(stage.given)])
    assert len(stage.given) == len(stage.song)


def test_a_pause_lets_go_at_once_and_goes_on_where_it_was(engine: Engine) -> None:
    stage = Stage(engine, scale(), 5.0)
    stage.play(1.1)
    stage.player.toggle()
    assert not stage.player.paused
    stage.play(1.5)
    assert stage.player.paused and stage.player.end is None and not stage.player.over(stage.deck)
    here = stage.player.position(stage.deck.frame)
    assert abs(here - 1.1 * RATE) < 3 * BLOCK
    paused = stage.given[stage.given["frame"] >= here]
    assert [(int(row["kind"]), int(row["a"])) for row in paused] == [(NOTE_OFF, KEY)]
    assert paused["frame"][0] - here <= 2 * BLOCK
    before = stage.deck.frame
    stage.player.toggle()
    stage.play(4.5)
    # From there on every note of the song, once, at its distance to where it went on.
    begun = before + round(LEAD_S * RATE) - here
    wanted = [
        (int(row["frame"]) + begun, int(row["a"])) for row in stage.song if row["kind"] == NOTE_ON and row["frame"] >= here
    ]
    got = stage.notes(after=before)
    assert len(wanted) == 15 and [key for _, key in got] == [key for _, key in wanted]
    shifts = {a - b for (a, _), (b, _) in zip(got, wanted, strict=True)}
    assert len(shifts) == 1 and 0 <= shifts.pop() <= BLOCK
    assert stage.player.over(stage.deck)


@pytest.mark.parametrize("every", [1, 4])
def test_jumps_forwards_backwards_and_to_the_start(engine: Engine, every: int) -> None:
    stage = Stage(engine, scale(), 5.0, every=every)
    stage.play(1.1)
    stage.player.move(2.0)
    stage.play(0.5)
    position = stage.player.position(stage.deck.frame)
    assert 3.1 * RATE < position < 3.6 * RATE
    velocities = stage.given["b"][stage.given["kind"] == NOTE_ON].tolist()
    assert velocities[:5] == [40, 41, 42, 43, 44] and velocities[5:] == [53]
    stage.player.move(-1.0)
    stage.player.move(-1.0)
    stage.play(0.5)
    assert stage.given["b"][stage.given["kind"] == NOTE_ON].tolist()[6:] in ([47], [46, 47], [46])
    stage.player.move_to_start()
    stage.play(0.4)
    on = stage.given[stage.given["kind"] == NOTE_ON]
    assert on["b"].tolist()[-1] in (40, 41) and 40 in on["b"].tolist()[-2:]
    # The expression stands as the song has it there, and every note was let go of before the next jump's.
    expression = stage.given[(stage.given["kind"] == CONTROL) & (stage.given["a"] == 11)]["b"]
    assert expression[-1] == on["b"][-1] + 20
    held = False
    for row in stage.given[np.isin(stage.given["kind"], (NOTE_ON, NOTE_OFF))]:
        assert not (held and row["kind"] == NOTE_ON)
        held = row["kind"] == NOTE_ON


def test_beyond_its_ends_it_stays_at_them_and_ends(engine: Engine) -> None:
    stage = Stage(engine, scale(4), 1.0)
    stage.play(0.1)
    stage.player.move(-100.0)
    stage.play(0.3)
    assert 0 <= stage.player.position(stage.deck.frame) < 0.3 * RATE
    stage.player.move(1e9)
    stage.play(0.5)
    assert stage.player.position(stage.deck.frame) == stage.length and stage.player.over(stage.deck)
    stage.player.move_to_start()  # and it can begin anew
    stage.play(0.5)
    assert not stage.player.over(stage.deck)


def test_moved_while_it_is_paused_it_stays_silent_until_it_goes_on(engine: Engine) -> None:
    stage = Stage(engine, scale(), 5.0)
    stage.play(0.6)
    stage.player.toggle()
    stage.play(0.5)
    stage.player.move(2.0)
    stage.player.move(0.5)
    count = len(stage.notes())
    stage.play(0.5)
    assert stage.player.paused and len(stage.notes()) == count
    assert abs(stage.player.position(stage.deck.frame) - 3.1 * RATE) < 3 * BLOCK
    stage.player.toggle()
    stage.play(0.4)
    assert stage.given["b"][stage.given["kind"] == NOTE_ON].tolist()[count:][0] == 53


def test_what_was_recorded_renders_to_the_same_samples(engine: Engine) -> None:
    """Pauses and jumps without pattern: the events given are what sounded, to the bit."""
    rng = np.random.default_rng(5)
    stage = Stage(engine, scale(), 5.0, every=3)
    for _ in range(25):
        stage.play(float(rng.uniform(0.02, 0.4)))
        [stage.player.toggle, stage.player.move_to_start, lambda: stage.player.move(float(rng.uniform(-3, 3)))][
            int(rng.choice(3, p=[0.3, 0.1, 0.6]))
        ]()
    stage.play(0.3)
    sound = stage.sound
    assert np.abs(sound).max() > 1e-3
    np.testing.assert_array_equal(sound, offline(engine, stage.given, len(sound)).astype(np.float32))


def test_power_up_knows_what_the_engine_begins_with(engine: Engine) -> None:
    power_up = power_up_of(engine, {})
    assert isinstance(power_up, PowerUp) and len(power_up.programs) == 16
    engine.reset()
    np.testing.assert_array_equal(power_up.programs, engine._state.channels["program"])
    np.testing.assert_array_equal(power_up.parameters, engine._state.parameters)


def test_the_key_that_switched_last_is_told_until_a_program_or_a_reset_takes_it_back() -> None:
    engine = PowerUp([0] * 16, np.zeros((1, 1)), switches={(0, 0): {12, 14}, (0, 1): {13}})
    rows = [(NOTE_ON, 0, 12, 90), (NOTE_ON, 0, 14, 90), (NOTE_ON, 0, 13, 90), (NOTE_ON, 0, 40, 90), (NOTE_ON, 1, 12, 90)]
    song = make_events([(frame, *row) for frame, row in enumerate(rows)])
    assert controls_at(song, engine=engine) == [(NOTE_ON, 0, 14, 90, 0.0)]
    assert controls_at(song, 1, engine=engine) == [(NOTE_ON, 0, 12, 90, 0.0)]
    assert controls_at(song) == []
    assert (CONTROL, 0, 121, 0, 0.0) in power_up_rows(song, engine)
    for kind, a, b in ((PROGRAM, 1, 0), (CONTROL, 121, 0)):
        later = make_events(
            [*((frame, *row) for frame, row in enumerate(rows)), (9, kind, 0, a, b), (10, NOTE_ON, 0, 13, 90)]
        )
        told = controls_at(later, engine=engine)
        assert [row for row in told if row[0] == NOTE_ON] == ([(NOTE_ON, 0, 13, 90, 0.0)] if kind == PROGRAM else [])


def test_in_a_zone_a_key_of_any_member_switches_for_its_master() -> None:
    engine = PowerUp([0] * 16, np.zeros((1, 1)), mpe=True, switches={(0, 0): {12, 14}, (0, 1): {13}})

    def told(*rows: tuple) -> list[tuple]:
        song = make_events([(frame, *row) for frame, row in enumerate(rows)])
        assert (CONTROL, 0, 121, 0, 0.0) in power_up_rows(song, engine)
        return [row for row in controls_at(song, mpe=True, engine=engine) if row[0] == NOTE_ON]

    mute, normal = [(NOTE_ON, 0, 14, 90, 0.0)], [(NOTE_ON, 0, 12, 80, 0.0)]
    first, second = (NOTE_ON, 3, 14, 90), (NOTE_ON, 7, 12, 80)
    assert told(first) == mute and told(first, second) == normal
    assert told(first, (CONTROL, 5, 121, 0)) == told(first, (PROGRAM, 3, 1)) == mute
    assert told(first, (CONTROL, 0, 121, 0)) == told(first, (PROGRAM, 0, 1)) == []
    zone = [(CONTROL, 0, 101, 0), (CONTROL, 0, 100, 6), (CONTROL, 0, 6, 5)]
    assert told(first, *zone) == [] and told(*zone, first) == mute
    assert told(*zone, second, (NOTE_ON, 0, 14, 70)) == [(NOTE_ON, 0, 14, 70, 0.0)]  # channel 7 is in the zone no more


def test_another_program_of_the_same_part_takes_no_articulation_back() -> None:
    same = {(0, 0): 0, (0, 1): 0, (0, 2): 1}
    engine = PowerUp([0] * 16, np.zeros((2, 1)), switches={(0, 0): {14}, (0, 1): {14}, (0, 2): {15}}, parts=same)
    rows = [
        (CONTROL, 0, 20, 90),
        (PROGRAM, 0, 2),
        (CONTROL, 0, 20, 99),
        (PROGRAM, 0, 1),
        (NOTE_ON, 0, 14, 90),
        (PROGRAM, 0, 0),
    ]
    song = make_events([(frame, *row) for frame, row in enumerate(rows)])
    back = [(CONTROL, 0, 20, 99, 0.0), (PROGRAM, 0, 2, 0, 0.0), (PROGRAM, 0, 0, 0, 0.0), (NOTE_ON, 0, 14, 90, 0.0)]
    assert controls_at(song, engine=engine) == back
    assert controls_at(song, 4, engine=engine)[-2:] == [(PROGRAM, 0, 2, 0, 0.0), (PROGRAM, 0, 1, 0, 0.0)]
    assert controls_at(song, 2, engine=engine)[-2:] == [(PROGRAM, 0, 0, 0, 0.0), (PROGRAM, 0, 2, 0, 0.0)]


WAYS = """
[articulations.normal]
key = "C0"
[articulations.mute]
key = "{key}"
controller = {{ number = 20, low = {low}, high = 90 }}
touch = {{ place = 0.05, resistance = 2.0 }}
"""
ARTICULATED = [
    kit.preset(f"from-{low}", kit.steel("C3"), more=WAYS.format(key=key, low=low)) for key, low in (("D0", 20), ("E0", 60))
]


@pytest.fixture(scope="module", params=[False, True], ids=["plain", "mpe"])
def articulated(request) -> Iterator[tuple[Engine, Engine]]:
    """Two alike, with a part for odd programs and one for even ones."""
    program_map = np.tile(np.arange(128) % 2, (16, 1))
    made = [Engine(ARTICULATED, program_map, mpe=request.param) for _ in range(2)]
    for each in made:
        each.prepare(RATE, 4096)
    yield made[0], made[1]
    for each in made:
        each.close()


@pytest.mark.parametrize("seed", range(12))
def test_wherever_one_jumps_articulations_stand_as_if_all_before_had_been_played(
    articulated: tuple[Engine, Engine], seed: int
) -> None:
    jumped, played = articulated
    rng = np.random.default_rng(seed)
    zoned = seed % 2 == 0
    programs = dict.fromkeys(range(16), 0)
    rows: list[tuple] = []
    for _ in range(150):
        c, what = int(rng.choice([0, 1, 2, 15])), rng.choice(5, p=[0.5, 0.3, 0.1, 0.07, 0.03])
        if what == 0:
            rows.append((NOTE_ON, c, int(rng.choice([12, 14, 16])), 90))
        elif what == 1:
            rows.append((CONTROL, c, 20, int(rng.integers(0, 128))))
        elif what == 2 and c in ((0,) if played.settings.mpe else (0, 15)):
            programs[c] += 1  # the other part
            rows.append((PROGRAM, c, programs[c]))
        elif what == 3:
            rows.append((CONTROL, c, 121, 0))
        elif what == 4 and c == 0 and zoned:
            rows += [(CONTROL, c, 101, 0), (CONTROL, c, 100, 6), (CONTROL, c, 6, int(rng.integers(0, 4)))]
    song = make_events([(frame, *row) for frame, row in enumerate(rows)])
    power_up = power_up_of(played, {})
    asked = 0
    for place in [*range(5, len(song), 20), len(song)]:
        for engine in articulated:
            engine.reset()
        give(played, song[:place])
        asked += np.count_nonzero(played._state.channels["articulation"]) + (played._state.channels["ruled"] > 0).sum()
        give(jumped, song)
        give(
            jumped,
            at_frame(power_up_rows(song, power_up) + controls_at(song, place, mpe=played.settings.mpe, engine=power_up), 0),
        )
        assert differing(standing(jumped), standing(played)) == []
        if not zoned:  # as after a pause
            give(jumped, at_frame(controls_at(song, place, mpe=played.settings.mpe, engine=power_up), 0))
            assert differing(standing(jumped), standing(played)) == []
    assert asked
