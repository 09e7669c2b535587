"""Events in, blocks out: places in time, what is lost and counted, and the same samples as offline."""

from __future__ import annotations

import math
import threading
import time
import tracemalloc

import numpy as np
import pytest
from numba import njit

from synth import Engine, load_preset
from synth.live import exchange as d
from synth.live import render_block as native
from synth.live.deck import Deck, LastNote
from synth.midi.events import BEND, CONTROL, EVENT, NOTE_OFF, NOTE_ON, PARAMETER, PROGRAM, make_events
from tests.patience import until

from .deckkit import Card, offline

RATE = 44100.0


@njit
def tick(address, played, delay, now_ns):
    native.tick(address, played, delay, now_ns)


@njit
def govern(address, seconds):
    native.govern(address, seconds)


@njit
def brought_block(address, given, frames):
    native.render_block(address, given, frames)


def _engine(*names: str, **settings) -> Engine:
    engine = Engine([load_preset(name) for name in names], **settings)
    engine.prepare(RATE, 512)
    return engine


@pytest.fixture(scope="module")
def tanpura() -> Engine:
    return _engine("tanpura-light", quality="draft")


@pytest.fixture(scope="module")
def twin() -> Engine:
    """The same once more, to be played offline."""
    return _engine("tanpura-light", quality="draft")


@pytest.fixture(scope="module")
def mixed() -> Engine:
    program_map = np.tile(np.arange(128) % 2, (16, 1))
    return _engine("tanpura-light", "fretted-bass", program_map=program_map, quality="draft")


def _random_events(rng: np.random.Generator, count: int, frames: int) -> np.ndarray:
    rows = []
    for frame in np.sort(rng.integers(0, frames, count)):
        kind = rng.choice([NOTE_ON, NOTE_ON, NOTE_OFF, CONTROL, BEND, PARAMETER])
        a, b, value = int(rng.choice([36, 43, 48])), int(rng.integers(0, 128)), 0.0
        if kind == CONTROL:
            a = int(rng.choice([1, 7, 10, 11, 64, 68, 120, 121, 123]))
        elif kind == BEND:
            a, b = int(rng.integers(-8192, 8192)), 0
        elif kind == PARAMETER:
            a, value = int(rng.integers(0, 6)), float(rng.uniform(-50, 50))
        rows.append((int(frame), int(kind), 0, a, b, value))
    return make_events(rows)


@pytest.mark.parametrize("block", [64, 128, 256, 512, 700, 5000])
def test_scheduled_events_sound_as_offline(tanpura: Engine, twin: Engine, block: int) -> None:
    rng = np.random.default_rng(block)
    events = _random_events(rng, 120, 30000)
    deck = Deck(tanpura, record=True)
    card = Card(deck)
    assert deck.schedule(events) == len(events)
    played = np.concatenate([card.ask(block) for _ in range(-(-32000 // block))])
    expected = offline(twin, events, len(played))
    assert np.abs(expected).max() > 0.01
    assert np.array_equal(played, expected.astype(np.float32))
    kept = np.zeros_like(expected)
    assert deck.drain_audio(kept) == len(kept)
    assert np.array_equal(kept, expected)
    assert np.array_equal(deck.drain_events(), events)


def test_what_is_sent_sounds_where_the_log_says(tanpura: Engine, twin: Engine) -> None:
    deck = Deck(tanpura, record=True)
    card = Card(deck)
    stop = threading.Event()

    def perform() -> None:
        rng = np.random.default_rng(1)
        while not stop.is_set():
            deck.send(NOTE_ON, 0, int(rng.choice([36, 43, 48])), 90)
            time.sleep(0.01)

    player = threading.Thread(target=perform)
    player.start()
    played = card.play(0.6, 128)
    stop.set()
    player.join()
    events = deck.drain_events()
    assert len(events) > 10
    assert np.all(np.diff(events["frame"]) >= 0)
    assert np.array_equal(played, offline(twin, events, len(played)).astype(np.float32))


def test_every_event_is_late_by_the_same_time(tanpura: Engine) -> None:
    """Callbacks come up to a third of a block early or late; events are placed as if they came in time."""
    deck = Deck(tanpura)
    rng = np.random.default_rng(3)
    block, rate = 256, 44103.0  # the card's own idea of the rate
    begin = time.monotonic_ns()
    wrong = []
    for k in range(4000):
        due = begin + 1e9 * k * block / rate
        tick(deck.address, k * block, block, int(due + rng.uniform(-0.33, 0.33) * 1e9 * block / rate))
        if k > 2000:
            wanted = (k + rng.uniform(0.0, 1.0)) * block
            wrong.append(deck.at(int(begin + 1e9 * wanted / rate)) - (wanted + block))
    wrong = np.array(wrong)
    assert abs(wrong.mean()) < 2.0
    assert np.abs(wrong).max() < 0.1 * block  # of the 0.33 that the callbacks are wrong by
    # in any two blocks time goes forward
    assert deck.at(begin + 10**9) <= deck.at(begin + 10**9 + 30_000)


def test_a_stall_begins_the_clock_anew(tanpura: Engine) -> None:
    deck = Deck(tanpura)
    begin = time.monotonic_ns()
    period = int(1e9 * 256 / RATE)
    for k in range(100):
        tick(deck.address, k * 256, 256, begin + k * period)
    late = begin + 100 * period + 2 * 10**9
    tick(deck.address, 100 * 256, 256, late)
    assert deck.at(late) == 101 * 256
    assert deck.meters().stalls == 1


def test_more_than_the_rings_hold_is_refused_and_counted(tanpura: Engine) -> None:
    deck = Deck(tanpura)
    taken = sum(deck.send(CONTROL, 0, 1, 1) for _ in range(d.EVENTS + 10))
    assert taken == d.EVENTS
    assert deck.meters().events_lost == 10
    assert deck.schedule(np.zeros(d.EVENTS + 10, EVENT)) == d.EVENTS
    card = Card(deck)
    for _ in range(2 * d.EVENTS // d.BLOCK_EVENTS):
        card.ask(64)
    card.ask(64)
    assert deck.meters().events == 2 * d.EVENTS
    assert deck.send(NOTE_ON, 0, 48, 100)


def test_a_flood_of_notes_is_played_whole(tanpura: Engine) -> None:
    deck = Deck(tanpura)
    card = Card(deck)
    count = 0
    for i in range(200):
        for _ in range(29):  # 10 000 a second
            count += deck.send((NOTE_ON, BEND, CONTROL)[count % 3], 0, (36, 100, 64)[count % 3], 1 + count % 127)
        assert np.isfinite(card.ask(128)).all(), i
    card.ask(4096)
    card.ask(4096)
    meters = deck.meters()
    assert count == 200 * 29 and meters.events_lost == 0
    assert tanpura.report().events_dropped == 0


def test_a_recording_nobody_takes_is_counted_as_lost(tanpura: Engine) -> None:
    deck = Deck(tanpura, record=True)
    card = Card(deck)
    asked = 0
    while asked < d.TAPE + 8192:
        card.ask(4096)
        asked += 4096
    assert deck.meters().recording_lost == asked - d.TAPE
    assert deck.drain_audio(np.zeros((asked, 2))) == d.TAPE


def test_a_deck_that_does_not_record_says_so(tanpura: Engine) -> None:
    with pytest.raises(ValueError, match="record=True"):
        Deck(tanpura).drain_events()


@pytest.mark.parametrize("channels", [1, 2, 6])
def test_devices_with_other_channels(tanpura: Engine, channels: int) -> None:
    deck = Deck(tanpura, record=True, channels=channels)
    deck.schedule(make_events([(5, CONTROL, 0, 10, 20), (10, NOTE_ON, 0, 48, 100)]))
    out = Card(deck, channels).ask(4000)
    mix = np.zeros((4000, 2))
    assert deck.drain_audio(mix) == 4000
    assert np.abs(mix).max() > 0.01
    if channels == 1:
        assert np.array_equal(out[:, 0], (0.5 * (mix[:, 0] + mix[:, 1])).astype(np.float32))
    else:
        assert np.array_equal(out[:, :2], mix.astype(np.float32))
        assert not out[:, 2:].any()


def test_rendered_ahead_it_sounds_the_same(tanpura: Engine, twin: Engine) -> None:
    """What is scheduled and what is sent meanwhile sound where the log says, and never in what is ready already."""
    events = _random_events(np.random.default_rng(9), 60, 20000)
    deck = Deck(tanpura, record=True, ahead=4, ahead_block=128)
    deck.schedule(events)
    card = Card(deck)
    pieces: list[np.ndarray] = []

    def play(blocks: int) -> None:
        for _ in range(blocks):
            until(lambda: deck._exchange.words[d.AHEAD] >= (len(pieces) + 1) * 256)
            pieces.append(card.ask(256))

    deck.start_ahead()
    try:
        play(100)
        until(lambda: deck.frame > 100 * 256)
        before = deck.frame
        deck.send(NOTE_ON, 0, 48, 100)
        until(lambda: deck.meters().events > len(events), meanwhile=lambda: play(1))
        play(40)
    finally:
        deck.close()
    log = deck.drain_events()
    assert np.array_equal(log[:-1], events) and log["a"][-1] == 48
    assert log["frame"][-1] >= before
    played = np.concatenate(pieces)
    assert log["frame"][-1] < len(played)
    assert np.array_equal(played, offline(twin, log, len(played)).astype(np.float32))


@pytest.mark.parametrize("lag_blocks", [0.25, 0.5, 2.0, 3.75])
def test_an_event_sent_while_sound_is_ahead_lies_where_it_belongs(tanpura: Engine, lag_blocks: float) -> None:
    """Blocks and calls of the device come at times of the test's choosing. An event is placed as late behind its arrival as
    the sound is ahead; one that arrives too late for its place begins the first block that is not ready."""
    ahead, block = 4, 128
    deck = Deck(tanpura, record=True, ahead=ahead, ahead_block=block)
    delay = deck.ahead_frames + block
    begin = time.monotonic_ns() - 60 * 10**9
    period_ns = 1e9 * block / RATE
    calls = 200
    for k in range(calls):
        tick(deck.address, k * block, delay, int(begin + k * period_ns))
    ready = (calls - 1 + ahead) * block
    while deck.frame < ready:
        brought_block(deck.address, 0, block)
    arrived = int(begin + (calls - 1 + 1.0 - lag_blocks) * period_ns)
    place = deck.at(arrived)
    assert abs(place - (calls * block - lag_blocks * block + delay)) <= 2
    deck.send(NOTE_ON, 0, 48, 100, time_ns=arrived)
    for _ in range(3):
        brought_block(deck.address, 0, block)
    (event,) = deck.drain_events()
    assert event["frame"] == max(place, ready)


def test_silence_where_the_sound_ahead_is_missing(tanpura: Engine) -> None:
    deck = Deck(tanpura, ahead=2, ahead_block=128)  # its thread is not started
    assert not Card(deck).ask(256).any()
    assert deck.meters().xruns == 1


def test_underruns_that_the_device_reports_are_counted(tanpura: Engine) -> None:
    deck = Deck(tanpura)
    card = Card(deck)
    for flags in (4, 0, 4, 8):
        card.ask(64, flags)
    assert deck.meters().xruns == 2


def test_meters_say_what_was_played(tanpura: Engine) -> None:
    deck = Deck(tanpura)
    card = Card(deck)
    deck.schedule(make_events([(0, NOTE_ON, 0, 48, 100), (9, NOTE_ON, 3, 43, 77), (10, NOTE_OFF, 3, 43)]))
    heard = card.ask(4096)
    meters = deck.meters()
    assert meters.last == LastNote(43, 77, 3)
    assert meters.peak == pytest.approx(np.abs(heard).max(), rel=1e-6)
    assert meters.strings == 2 and meters.blocks == 1 and meters.frames == 4096 and meters.events == 3
    assert 0.0 < meters.load.cpu_worst and 0.0 < meters.load.median == meters.load.worst
    deck.panic()
    for _ in range(20):
        card.ask(4096)
    assert deck.meters().peak > 0.0
    card.ask(64)
    assert deck.meters().peak < 1e-4
    assert deck.meters().strings == 0


def test_a_thousand_program_changes_and_panics(mixed: Engine) -> None:
    """No number that is not finite, nothing that stays on, no memory that grows."""
    deck = Deck(mixed)
    card = Card(deck)
    rng = np.random.default_rng(5)

    def rounds(count: int) -> None:
        for _ in range(count):
            channel = int(rng.integers(16))
            deck.send(PROGRAM, channel, int(rng.integers(128)))
            for _ in range(3):
                deck.send(NOTE_ON, channel, int(rng.integers(128)), int(rng.integers(1, 128)))
            if rng.random() < 0.3:
                deck.panic()
            assert np.isfinite(card.ask(int(rng.choice([64, 128, 256])))).all()

    rounds(200)
    tracemalloc.start()
    rounds(100)
    before = tracemalloc.get_traced_memory()[0]
    rounds(700)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 50_000
    deck.panic()
    for _ in range(40):
        last = card.ask(4096)
    assert np.abs(last).max() < 1e-4 and deck.meters().strings == 0


def test_under_load_quiet_strings_are_spared(tanpura: Engine) -> None:
    deck = Deck(tanpura)  # not adaptive: what this machine is busy with does not matter
    card = Card(deck)
    deck.schedule(make_events([(i, NOTE_ON, 0, note, 15) for i, note in enumerate((36, 43, 48, 48))]))
    deck.schedule(make_events([(100, NOTE_OFF, 0, note) for note in (36, 43, 48)]))
    for _ in range(25):
        card.ask(4096)
    before = card.ask(4096)
    ringing = deck.meters()
    assert ringing.strings == 4 and ringing.spare_db == -math.inf

    def pretend(load: float, seconds: float) -> None:
        deck._exchange.levels[d.MEAN_LOAD] = load
        govern(deck.address, seconds)

    pretend(0.9, 2.0)
    assert deck.meters().spare_db == pytest.approx(-60.0)
    assert tanpura.spare == pytest.approx(1e-3)
    pretend(0.6, 2.0)
    assert deck.meters().spare_db == pytest.approx(-60.0)
    pretend(2.0, 100.0)
    assert deck.meters().spare_db == pytest.approx(native.MOST_DB)
    after = np.concatenate([card.ask(64) for _ in range(64)])
    assert np.abs(np.diff(after[:, 0], n=2)).max() < 1.5 * np.abs(np.diff(before[:, 0], n=2)).max()  # damped, not cut
    for _ in range(80):
        pretend(2.0, 1.0)
        card.ask(4096)
    assert deck.meters().strings < 4
    pretend(0.1, 100.0)
    assert deck.meters().spare_db == -math.inf and tanpura.spare == 0.0


def test_an_adaptive_deck_looks_at_its_load(tanpura: Engine) -> None:
    for adaptive in (False, True):
        deck = Deck(tanpura, adaptive=adaptive)
        deck._exchange.levels[d.MEAN_LOAD] = 1e6
        Card(deck).ask(256)
        assert (deck.meters().spare_db > -math.inf) == adaptive


def test_what_a_device_brings_beyond_a_block_is_counted(tanpura: Engine) -> None:
    deck = Deck(tanpura)
    for _ in range(d.BLOCK_EVENTS - 2):
        assert deck.send(CONTROL, 0, 1, 1, time_ns=time.monotonic_ns() - 10**9)
    tick(deck.address, 0, 256, time.monotonic_ns())
    for event in deck._exchange.given[:5]:
        event["frame"], event["kind"], event["a"] = 255, CONTROL, 1
    brought_block(deck.address, 5, 256)
    assert deck.meters().events == d.BLOCK_EVENTS
    assert deck.meters().events_lost == 3


def test_a_clock_that_is_caught_changing_keeps_nobody_waiting(tanpura: Engine) -> None:
    deck = Deck(tanpura)
    begin = time.monotonic_ns()
    tick(deck.address, 0, 256, begin)
    deck._exchange.words[d.CLOCK] += 1
    assert deck.at(begin) == 256
