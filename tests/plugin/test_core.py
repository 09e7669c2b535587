"""The native core plays what the engine in Python plays, bit for bit."""

from __future__ import annotations

import os
import threading
import time
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from synth.engine import layout
from synth.engine.engine import Engine
from synth.instrument.preset import load_preset
from synth.jit import prebuilt
from synth.midi.events import (
    BEND,
    CONTROL,
    EVENT,
    KEY_PRESSURE,
    NOTE_OFF,
    NOTE_ON,
    PARAMETER,
    PRESSURE,
    PROGRAM,
    TUNING,
    make_events,
)
from synth.native.processors import cores
from synth.plugin.bankfile import bank
from tests.engine.handed import ACROSS, BUSY, HANDED, PULLED, PULLS
from tests.engine.kit import CURVE, FREE, SHARED, SITAR, play, random_events
from tests.patience import until

from .conftest import PRESETS
from .native import Refused

RATE_HZ = 44100.0
FRAMES = int(1.0 * RATE_HZ)
SIZES = (1, 7, 64, 333, 1024, 4096)


@cache
def reference(*names: str, rate_hz: float = RATE_HZ, **options) -> Engine:
    """The engine that a bank of these presets is made of, with Numba's kernels."""
    assert prebuilt.found().path is None
    program_map = None
    if len(names) > 1:
        program_map = np.full((16, 128), -1, np.int64)
        program_map[:, : len(names)] = np.arange(len(names))
    engine = Engine([load_preset(name) for name in names], program_map, **options)
    engine.prepare(rate_hz, 4096)
    return engine


def played(engine: Engine, events, frames: int = FRAMES, blocks=512) -> np.ndarray:
    """What an engine plays from the start."""
    engine.reset()
    return play(engine, events, frames, blocks)


def sizes_of(rng: np.random.Generator) -> list[int]:
    """Blocks of all kinds, longer than any piece played here."""
    return [*rng.choice(SIZES, 100).tolist(), *[4096] * 40]


def same(x: np.ndarray, y: np.ndarray) -> bool:
    """Bit for bit, and not silence."""
    return x.shape == y.shape and np.abs(x).max() > 1e-3 and np.array_equal(x.view(np.int64), y.view(np.int64))


def wild(seed: int, parts: int, frames: int = FRAMES, count: int = 250) -> np.ndarray:
    """A stream of everything that a player can do."""
    rng = np.random.default_rng(seed)
    events = random_events(rng, count, frames, 5, (28, 84))
    programs = events["kind"] == PROGRAM
    events["a"][programs] = rng.integers(0, parts + 1, programs.sum())
    of_parts = events["kind"] == PARAMETER
    events["channel"][of_parts] %= parts
    for i in rng.choice(count, count // 6, replace=False):
        kind = int(rng.choice([PRESSURE, KEY_PRESSURE, TUNING]))
        key = int(rng.integers(28, 85))
        pitch = float(rng.choice([np.nan, key + rng.uniform(-1.0, 1.0)]))
        frame = int(events["frame"][i])
        if kind == TUNING:
            events[i] = (frame, TUNING, 0, key, int(rng.integers(2)), pitch)
        else:
            events[i] = (frame, kind, int(rng.integers(5)), key if kind == KEY_PRESSURE else 0, int(rng.integers(128)), 0.0)
    return events


def test_a_rate_and_its_octave_keep_what_they_share_once_and_sound_as_in_python(library, tmp_path):
    rates, events = (44100.0, 48000.0, 88200.0), wild(3, 1, 20000, 120)
    whole, alone = bank([SHARED], rates), [bank([SHARED], [rate]) for rate in rates]
    path = tmp_path / "rates.jawari"
    path.write_bytes(whole)
    opened, tables = library.open_bank(path), []
    for rate_hz in rates:
        engine = Engine([SHARED])
        engine.prepare(rate_hz, 4096)
        models = (*engine.memory.strings.models, *engine.memory.built.flights)
        tables.append({model.rows.tobytes() for model in models})
        native = opened.engine(rate_hz)
        assert same(play(engine, events, 20000, 512), native.play(events, 20000, 700))
    shared = tables[0] & tables[2]
    assert shared and all(whole.count(each) == 1 for table in tables for each in table)
    assert len(whole) < sum(map(len, alone)) - sum(map(len, shared))
    at = whole.index(next(iter(shared)))
    path.write_bytes(whole[: at + 9] + bytes([whole[at + 9] ^ 1]) + whole[at + 10 :])
    damaged = library.open_bank(path)
    assert damaged.engine(48000.0)
    for rate_hz in (44100.0, 88200.0):
        with pytest.raises(Refused, match="checksum"):
            damaged.engine(rate_hz)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_sounds_as_in_python(library, bank_files, name):
    events, sizes = wild(3, 1), sizes_of(np.random.default_rng(4))
    native = library.open_bank(bank_files[name]).engine()
    python = reference(name)
    assert same(played(python, events, blocks=sizes), native.play(events, FRAMES, sizes))
    assert native.voices == python.strings_sounding


def sounds_as_in_python(opened, name, events, sizes):
    """By one thread and by two."""
    python = reference(name)
    wanted, alone = played(python, events, 20000, sizes), opened.engine()
    assert same(wanted, alone.play(events, 20000, sizes)) and alone.voices == python.strings_sounding > 0
    assert same(wanted, opened.engine(threads=2).play(events, 20000, 512))


def test_strings_that_share_a_body_sound_as_in_python(library, guitar_file):
    events, sizes = wild(3, 1, 20000, 120), sizes_of(np.random.default_rng(4))
    sounds_as_in_python(library.open_bank(guitar_file), "steel-guitar", events, sizes)


def test_strings_over_a_board_sound_as_in_python(library, fretless_file):
    events, sizes = wild(3, 1, 20000, 120), sizes_of(np.random.default_rng(4))
    notes = [(5, NOTE_ON, 0, 28, 127), (900, NOTE_ON, 0, 41, 127), (2000, NOTE_ON, 0, 50, 90), (2500, NOTE_ON, 0, 45, 127)]
    events = np.concatenate([make_events(notes), events[events["frame"] >= 3000]])
    sounds_as_in_python(library.open_bank(fretless_file), "fretless-bass", events, sizes)


def test_a_body_beside_another_part_sounds_as_in_python(library, tmp_path):
    parts, programs = (FREE, SHARED), np.full((16, 128), -1, np.int64)
    programs[:, :2] = np.arange(2)
    (tmp_path / "both.jawari").write_bytes(bank(parts, [RATE_HZ]))
    engine = Engine(parts, programs)
    engine.prepare(RATE_HZ, 4096)
    events = wild(9, 2)
    notes = [(5, NOTE_ON, 1, 43, 120), (900, NOTE_ON, 1, 50, 127), (2000, NOTE_ON, 1, 44, 90)]
    events = np.concatenate([make_events([(0, PROGRAM, 1, 1), *notes]), events[events["frame"] >= 3000]])
    for threads in (1, 2):
        native = library.open_bank(tmp_path / "both.jawari").engine(threads=threads)
        assert same(played(engine, events), native.play(events, FRAMES, 333))


@pytest.mark.parametrize(
    ("preset", "events"), [(HANDED, BUSY), (ACROSS, BUSY), (PULLED, PULLS)], ids=["handed", "across", "pulled"]
)
def test_articulations_sound_as_in_python(library, tmp_path, preset, events):
    (tmp_path / "handed.jawari").write_bytes(bank((preset,), [RATE_HZ]))
    engine, rows, frames = Engine([preset]), make_events(events), 36_000
    engine.prepare(RATE_HZ, 4096)
    wanted = played(engine, rows, frames)
    opened = library.open_bank(tmp_path / "handed.jawari")
    assert same(wanted, opened.engine(threads=2).play(rows, frames, 333))
    assert same(wanted, opened.engine().play(rows, frames, 700))


def test_presets_together_sound_as_in_python(library, bank_files):
    engine = reference(*PRESETS)
    native = library.open_bank(bank_files["all"]).engine()
    for seed in (5, 6):
        native.reset()
        events, sizes = wild(seed, 3), sizes_of(np.random.default_rng(seed))
        wanted = played(engine, events, blocks=sizes)
        got = native.play(events, FRAMES, sizes)
        if seed == 6:  # what sounded before fades for 3 ms into it
            wanted, got = wanted[200:], got[200:]
        assert same(wanted, got)
        report = native.report
        assert (report.notes, report.stolen) == (engine.report().notes, engine.report().stolen)
        assert report.unplayed == sum(each.times for each in engine.report().unplayed)


def test_mpe_and_another_rate(library, tmp_path):
    """An MPE zone, at two rates of one bank."""
    rates = (48000.0, 96000.0)
    path = tmp_path / "mpe.jawari"
    path.write_bytes(bank([load_preset("jawari-harp")], rates, mpe=True))
    opened = library.open_bank(path)
    rows = [(100, NOTE_ON, 1, 48, 90), (120, NOTE_ON, 2, 55, 100), (5000, BEND, 1, 3000), (7000, BEND, 2, -8192)]
    rows += [
        (9000, PRESSURE, 2, 0, 100),
        (9500, CONTROL, 3, 74, 20),
        (9600, NOTE_ON, 3, 62, 80),
        (12000, NOTE_OFF, 1, 48, 64),
    ]
    for rate in rates:
        engine = reference("jawari-harp", rate_hz=rate, mpe=True)
        native = opened.engine(rate)
        assert same(played(engine, rows, 20000), native.play(rows, 20000))
        assert library.rate(native.address) == rate
        assert library.latency(native.address) == engine.latency_samples
        assert library.tail(native.address) == round(engine.tail_seconds * rate)


def test_blocks_change_no_sample(library, bank_files):
    opened = library.open_bank(bank_files["fretted-bass"])
    events = wild(8, 1, 20000, 80)
    whole = opened.engine().play(events, 20000, 20000)
    for size in (*SIZES, 31, 32, 33):
        assert same(whole, opened.engine().play(events, 20000, size)), size


def test_float_is_the_same_rounded(library, bank_files):
    opened = library.open_bank(bank_files["tanpura-light"])
    events = make_events([(0, NOTE_ON, 0, 48, 100), (50, NOTE_ON, 0, 43, 90)])
    wide = opened.engine().play(events, 8000, 333)
    narrow = opened.engine().play(events, 8000, 512, dtype=np.float32)
    assert narrow.dtype == np.float32 and np.array_equal(narrow, wide.astype(np.float32)) and np.abs(narrow).max() > 1e-3


def test_a_reset_engine_begins_anew_and_what_sounded_fades(library, bank_files):
    engine = library.open_bank(bank_files["fretted-bass"]).engine()
    events = make_events(
        [(0, NOTE_ON, 0, 40, 127), (9, CONTROL, 0, 7, 30), (9, CONTROL, 0, 10, 0), (9, PARAMETER, 0, 2, 0, 2.0)]
    )
    before = engine.play(events, 6000)
    assert not engine.silent
    engine.reset()
    assert library.value(engine.address, 0, 2) == 1.0 and engine.voices == 0 and engine.report.notes == 0
    after = engine.play([], 2000)
    length = int(np.ceil(0.003 * RATE_HZ))
    assert 1e-4 < np.abs(after[:20]).max() and not after[length:].any()
    joined = np.concatenate([before[-300:], after[:300]])
    assert np.abs(np.diff(joined, axis=0)).max() <= 1.5 * np.abs(np.diff(before[-2000:], axis=0)).max()
    assert engine.silent
    fresh = library.open_bank(bank_files["fretted-bass"]).engine()
    fresh.play([], 2000)
    assert same(fresh.play(events, 6000), engine.play(events, 6000))


def test_silence_is_said_when_all_has_come_out(library, bank_files):
    engine = library.open_bank(bank_files["fretted-bass"]).engine()
    assert engine.silent
    engine.play([(0, NOTE_ON, 0, 40, 100), (4000, CONTROL, 0, 120, 0)], 4100)
    assert not engine.silent
    last = np.ones((1, 2))
    for _ in range(4000):
        if engine.silent:
            break
        last = engine.process(np.zeros(0, EVENT), 64)
    assert engine.silent and not engine.process(np.zeros(0, EVENT), 4096).any()
    assert not last[-1].any()


def workers() -> set[str]:
    """Threads of this process."""
    return set(os.listdir("/proc/self/task"))


def computed(thread: str) -> int:
    """(ns) how long a thread has had a processor."""
    return int(Path(f"/proc/self/task/{thread}/schedstat").read_text().split()[0])


@pytest.mark.parametrize("threads", [2, 3, 64])
def test_threads_change_no_sample(library, bank_files, threads):
    opened = library.open_bank(bank_files["jawari-harp"])
    events = make_events([(i * 10, NOTE_ON, 0, note, 100) for i, note in enumerate(range(30, 80))])
    alone = opened.engine().play(events, 15000, 512)
    there = workers()
    engine = opened.engine(threads=threads)
    mine = workers() - there
    assert len(mine) + 1 == library.threads(engine.address) == min(threads, library.strings(opened.address), cores())
    assert same(alone, engine.play(events, 15000, 512))
    worked = {worker: computed(worker) for worker in mine}
    if mine:
        until(
            lambda: any(computed(worker) - worked[worker] > 5_000_000 for worker in mine),
            "no worker works",
            meanwhile=lambda: engine.process(events[:8], 512),
        )
    engine.close()
    assert not workers() & mine


def test_no_more_threads_than_processors_that_may_be_used(library, bank_files):
    opened = library.open_bank(bank_files["jawari-harp"])
    may = os.sched_getaffinity(0)
    there = workers()
    os.sched_setaffinity(0, {min(may)})
    try:
        engine = opened.engine(threads=4)
        assert library.threads(engine.address) == 1 and workers() == there
    finally:
        os.sched_setaffinity(0, may)
    assert library.threads(opened.engine(threads=4).address) == min(4, len(may))


def test_engines_know_nothing_of_each_other(library, bank_files):
    """Two in turns, and two in threads of their own."""
    opened = library.open_bank(bank_files["fretted-bass"])
    streams = [wild(seed, 1, 12000, 60) for seed in (20, 21)]
    wanted = [opened.engine().play(stream, 12000, 512) for stream in streams]
    pair = [opened.engine(), opened.engine(threads=2)]
    got: list[list[np.ndarray]] = [[], []]
    for begin in range(0, 12000, 500):
        for engine, stream, pieces in zip(pair, streams, got, strict=True):
            here = stream[(stream["frame"] >= begin) & (stream["frame"] < begin + 500)].copy()
            here["frame"] -= begin
            pieces.append(engine.process(here, 500))
    assert all(same(x, np.concatenate(pieces)) for x, pieces in zip(wanted, got, strict=True))
    again: list[np.ndarray] = [np.zeros(0)] * 2

    def play_one(k: int) -> None:
        again[k] = opened.engine().play(streams[k], 12000, 512)

    workers = [threading.Thread(target=play_one, args=(k,)) for k in range(2)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert all(same(x, y) for x, y in zip(wanted, again, strict=True))


def test_lent_threads_change_no_sample(library, bank_files):
    """Helpers beside the block, more than there is room for; helpers one after the other in the block's own thread."""
    opened = library.open_bank(bank_files["jawari-harp"])
    events = make_events([(i * 10, NOTE_ON, 0, note, 100) for i, note in enumerate(range(30, 80))])
    alone = opened.engine().play(events, 15000, 500)
    engine = opened.engine(threads=3)
    library.lend(engine.address)
    for k in (0, 1, 2, 3, -1):  # nothing is being computed: each returns
        library.help(engine.address, k)
    ended = threading.Event()

    helped_s: list[float] = []

    def help_on(k: int) -> None:
        longest = 0.0
        while not ended.is_set():
            before = time.thread_time()
            library.help(engine.address, k)
            longest = max(longest, time.thread_time() - before)
        helped_s.append(longest)

    helpers = [threading.Thread(target=help_on, args=(k,)) for k in (1, 2, 2)]
    for helper in helpers:
        helper.start()
    try:
        got = engine.play(events, 15000, 500)
    finally:
        ended.set()
        for helper in helpers:
            helper.join()
    assert same(alone, got)
    # a call that has nothing to do takes microseconds
    assert max(helped_s) > 1e-4 or library.threads(engine.address) == 1
    serial = opened.engine(threads=4)
    library.lend(serial.address)
    pieces = []
    for begin in range(0, 15000, 500):
        library.help(serial.address, 1)
        here = events[(events["frame"] >= begin) & (events["frame"] < begin + 500)].copy()
        here["frame"] -= begin
        pieces.append(serial.process(here, 500))
        library.help(serial.address, 2)
    assert same(alone, np.concatenate(pieces))


def test_any_event_is_survived(library, bank_files):
    """Numbers that no host should send, frames in disorder and outside; and it plays on as if they had not been."""
    opened = library.open_bank(bank_files["all"])
    engine = opened.engine()
    rng = np.random.default_rng(9)
    for _ in range(60):
        events = np.zeros(200, EVENT)
        for field in ("kind", "channel", "a", "b"):
            near = rng.integers(-3, 20, 200)
            far = rng.integers(-(1 << 31), 1 << 31, 200)
            events[field] = np.where(rng.random(200) < 0.7, near, far)
        events["value"] = rng.choice([np.nan, np.inf, -np.inf, 1e308, -1e-320, 0.5], 200)
        events["frame"] = rng.integers(-(1 << 62), 1 << 62, 200)
        events["frame"][::2] = rng.integers(-10, 600, 100)
        out = engine.process(events, int(rng.integers(0, 700)))
        assert np.isfinite(out).all()
    engine.reset()
    engine.process(np.zeros(0, EVENT), 200)
    rows = [(0, NOTE_ON, 0, 48, 100)]
    fresh = opened.engine()
    fresh.process(np.zeros(0, EVENT), 200)
    assert same(fresh.play(rows, 3000), engine.play(rows, 3000))


def test_a_flood_is_counted_and_survived(library, bank_files):
    engine = library.open_bank(bank_files["tanpura-light"]).engine()
    flood = np.zeros(50_000, EVENT)
    flood["kind"], flood["a"], flood["b"] = NOTE_ON, 48, 100
    flood["frame"] = 255
    assert np.isfinite(engine.process(flood, 256)).all()
    assert 0 < engine.report.dropped < 50_000
    assert np.isfinite(engine.play([], 4096)).all()
    assert engine.report.dropped + engine.report.notes == 50_000


def test_frames_outside_of_the_block_are_moved_to_its_ends(library, bank_files):
    opened = library.open_bank(bank_files["tanpura-light"])
    outside = make_events([(-500, NOTE_ON, 0, 48, 100), (9000, NOTE_ON, 0, 43, 100)])
    inside = make_events([(0, NOTE_ON, 0, 48, 100), (999, NOTE_ON, 0, 43, 100)])
    first, second = opened.engine(), opened.engine()
    assert same(first.process(inside, 1000), second.process(outside, 1000))
    assert same(first.play([], 2000), second.play([], 2000))


def test_values_and_programs_can_be_asked_for(library, bank_files):
    opened = library.open_bank(bank_files["all"])
    engine, model = opened.engine(), reference(*PRESETS)
    for parameter in model.parameters:
        assert library.value(engine.address, parameter.part, parameter.index) == parameter.default
    assert np.isnan(library.value(engine.address, 3, 0)) and np.isnan(library.value(engine.address, 0, 7))
    engine.play([(0, PROGRAM, 4, 2), (0, PARAMETER, 1, 2, 0, 7.0), (0, NOTE_ON, 4, 60, 90)], 200)
    assert [library.program(engine.address, c) for c in (0, 4, 16, -1)] == [0, 2, -1, -1]
    assert library.value(engine.address, 1, 2) == 2.0  # its range ends there
    assert library.sounding(engine.address, 4, 60) == 1 and library.sounding(engine.address, 4, 61) == 0
    assert [library.pitch(engine.address, key) for key in (0, 69, 127)] == [0.0, 69.0, 127.0]
    assert np.isnan(library.pitch(engine.address, 128))


@pytest.mark.parametrize("preset", [CURVE, SITAR], ids=lambda each: each.name)
def test_a_bridge_that_is_raised_sounds_as_in_python(library, tmp_path, preset):
    """Automation of its height, at any frame, from full contact to none."""
    (tmp_path / "bridge.jawari").write_bytes(bank((preset,), [RATE_HZ]))
    engine = Engine([preset])
    engine.prepare(RATE_HZ, 4096)
    rng = np.random.default_rng(6)
    rows = [(5, NOTE_ON, 0, 43, 120), (900, NOTE_ON, 0, 48, 127), (7000, NOTE_ON, 0, 50, 90), (9000, BEND, 0, 4000)]
    rows += [(int(f), PARAMETER, 0, layout.HEIGHT, 0, float(rng.uniform(-200.0, 50.0))) for f in range(1000, 14000, 731)]
    rows += [(15000 + 64 * k, PARAMETER, 0, layout.HEIGHT, 0, 0.5 * k) for k in range(60)]
    events, sizes = make_events(rows), sizes_of(rng)
    wanted = played(engine, events, 22000, sizes)
    assert not np.array_equal(wanted, played(engine, events[events["kind"] != PARAMETER], 22000, sizes))
    assert same(wanted, library.open_bank(tmp_path / "bridge.jawari").engine().play(events, 22000, sizes))
