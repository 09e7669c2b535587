"""A plugin's own drone: what `synth drone` plays, in every format; in beats, through all that a host's transport does."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from synth.drone.cycle import Drone
from synth.engine import layout
from synth.engine.engine import Engine
from synth.midi.events import EVENT, NOTE_OFF, NOTE_ON, PARAMETER, TUNING, make_events
from synth.plugin import bankfile
from synth.plugin.description import describe
from synth.plugin.droning import CYCLES, OWN, SCORE, STROKE
from tests.plugin import clapabi as abi
from tests.plugin import clapkit as kit
from tests.plugin import lv2host, vst3host
from tests.plugin.claphost import Host, Instance
from tests.plugin.dronekit import (
    BEATS,
    DRONE,
    KEYS,
    MODE,
    OFF,
    ON,
    PACE,
    RATE,
    SECONDS,
    SETTINGS,
    TONIC,
    VELOCITY,
    Song,
    beat_of,
    of_drone,
    played,
    plugin_file,
    strokes,
    truth,
)
from tests.plugin.native import Library, Refused

SIZES = (1, 37, 256, 4096, 33, 1000)


@pytest.fixture(scope="module")
def exported(library_file, tmp_path_factory):
    """The plugin, as a file that all formats share."""
    return plugin_file(library_file, tmp_path_factory.mktemp("drone"), (RATE, 48000.0))


@pytest.fixture
def plugin(exported):
    with Host(exported) as host, host.instance() as instance:
        assert instance.activate(RATE)
        instance.start()
        yield instance


@pytest.fixture(scope="module")
def engine():
    made = Engine([DRONE.strings.preset])
    made.prepare(RATE, 4096)
    made.reserve(1 << 12)
    return made


def ids(instance: Instance) -> list[int]:
    """What the host knows the drone's parameters by."""
    named = {info.name.decode(): info.id for info in instance.params}
    return [named[each.name] for each in DRONE.parameters()]


def hear(
    plugin: Instance, given: list[tuple], frames: int, sizes=SIZES, values: dict[int, float] | None = None
) -> np.ndarray:
    """(frames, 2) of a plugin that is given events (frame, event), with values of its drone at first."""
    known = ids(plugin)
    given = [*((0, abi.param(0, known[k], value)) for k, value in (values or {}).items()), *given]
    out = []
    for begin, size, _ in kit.blocks_of(np.zeros(0, EVENT), frames, sizes):
        here = [(frame, event) for frame, event in given if begin <= frame < begin + size]
        for frame, event in here:
            event.header.time = frame - begin
        out.append(plugin.process([event for _, event in here], size))
    return np.concatenate(out)


def play_song(song: Song, plugin: Instance, frames: int, sizes=SIZES, values: dict[int, float] | None = None) -> np.ndarray:
    """What the plugin makes of it: told at the start of blocks, and within them where a part begins."""
    known = ids(plugin)
    first = [abi.param(0, known[k], value) for k, value in (values or {}).items()]
    out = []
    for begin, size, _ in kit.blocks_of(np.zeros(0, EVENT), frames, sizes):
        plugin.transport = abi.transport(0, *song.at(begin))
        within = [part for part in song.parts if begin < part[0] < begin + size]
        events = [abi.transport(part[0] - begin, *song.at(part[0])) for part in within]
        out.append(plugin.process([*first, *events], size))
        first = []
    return np.concatenate(out)


def test_it_has_a_page_of_knobs_and_a_group(exported):
    with Host(exported) as host, host.instance() as made:
        pages, page, known = made.ext["clap.remote-controls/2"], abi.RemotePage(), ids(made)
        assert pages.count(made.address) == 2 and not pages.get(made.address, 2, abi.c.addressof(page))
        assert pages.get(made.address, 1, abi.c.addressof(page)) and page.name == b"Drone"
        assert list(page.params) == [*known, *[abi.INVALID_ID] * (8 - len(known))]
        assert {info.module for info in made.params if info.id in known} == {b"Drone"}
        assert {info.id for info in made.params if info.flags & abi.ENUM} == {known[MODE], known[PACE]}


# ---- at its own pace ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sizes", [SIZES, (512,)])
def test_at_its_own_pace_it_plays_what_synth_drone_plays(plugin, engine, sizes):
    frames = 12 * 44100
    heard = hear(plugin, [], frames, sizes, {MODE: ON})
    expected = truth(engine, of_drone(frames), frames)
    assert kit.loudest(expected) > 0.01
    assert np.array_equal(heard, expected)


def test_without_the_host_nothing_sounds_and_nothing_sleeps(plugin):
    assert kit.loudest(hear(plugin, [], 44100)) == 0.0
    assert plugin.status == abi.CONTINUE  # the host may begin to play


def test_switched_off_it_sleeps(plugin):
    hear(plugin, [], 8192, values={MODE: OFF})
    assert plugin.status == abi.SLEEP


def test_it_begins_with_the_host_and_lets_go_with_it(plugin, engine):
    begun, ended, again, frames = 1111, 150_000, 260_007, 400_000
    parts = [(0, False, 0.0, 120.0), (begun, True, 3.3, 120.0), (ended, False, 0.0, 120.0), (again, True, 9.0, 70.0)]
    heard = play_song(Song(*parts), plugin, frames)
    first, second = of_drone(ended - begun), of_drone(frames - again)
    first["frame"] += begun
    second["frame"] += again
    held = first[first["kind"] == NOTE_ON]["a"][-1]
    letting_go = make_events([(ended, NOTE_OFF, 0, int(held), 64, 0.0)])
    expected = truth(engine, np.concatenate([first, letting_go, second]), frames)
    assert np.array_equal(heard, expected)
    assert kit.loudest(expected[ended + 1000 : ended + 5000]) > 1e-4  # it rings out


def test_its_pace_changes_from_the_next_stroke_on(plugin, engine):
    """As a key of `synth drone` changes it."""
    changes = [(50_001, 2.0), (120_000, 1.0), (200_500, 3.7)]
    frames, drone, events = 400_000, Drone(DRONE.strings, SETTINGS.cycle, RATE), []
    for frame, seconds in changes:
        events.append(drone.events(frame))
        drone.set_cycle(replace(drone.cycle, cycle_s=seconds))
    events.append(drone.events(frames))
    seconds_id = ids(plugin)[SECONDS]
    given = [(frame, abi.param(0, seconds_id, value)) for frame, value in changes]
    heard = hear(plugin, given, frames, values={MODE: ON})
    assert np.array_equal(heard, truth(engine, np.concatenate(events), frames))


def test_velocity_is_the_mean_of_the_strokes(plugin, engine):
    frames = 200_000
    heard = hear(plugin, [], frames, values={MODE: ON, VELOCITY: 100.5})
    assert np.array_equal(heard, truth(engine, of_drone(frames, replace(SETTINGS.cycle, velocity=100.5)), frames))


def test_the_finger_strays_from_where_the_player_has_it_and_other_notes_are_plucked_there(plugin, engine):
    place = kit.parameter_id(plugin, 0, layout.PLUCK_POSITION, [DRONE.strings.preset])
    frames = 200_000
    rows_on_top = [(70_000, NOTE_ON, 0, KEYS[1], 90, 0.0), (90_000, NOTE_OFF, 0, KEYS[1], 0, 0.0)]
    given = [(0, abi.param(0, place, 0.31)), (70_000, abi.note_on(0, KEYS[1], 90 / 127)), (90_000, abi.note_off(0, KEYS[1]))]
    heard = hear(plugin, given, frames, values={MODE: ON})
    expected = of_drone(frames)
    pluck = DRONE.strings.preset.pluck
    moved = (expected["kind"] == PARAMETER) & (expected["a"] == layout.PLUCK_POSITION)
    strokes_on = expected["kind"] == NOTE_ON
    varied = [SETTINGS.cycle.variation(k, 0.0, min(DRONE.gaps)) for k in range(int(strokes_on.sum()))]
    expected["value"][moved] = [0.31 + each.farther for each in varied]
    back = []
    for frame in expected["frame"][strokes_on]:
        back += [(int(frame), PARAMETER, 0, layout.PLUCK_POSITION, 0, 0.31)]
        back += [(int(frame), PARAMETER, 0, layout.PLUCK_WIDTH, 0, pluck.width_mm)]
    rows_all = np.concatenate([make_events(rows_on_top), expected, make_events(back)])
    rows_all = rows_all[np.argsort(rows_all["frame"], kind="stable")]
    assert np.array_equal(heard, truth(engine, rows_all, frames))


def test_pegs_turn_to_another_tonic(plugin, engine):
    """At once while nothing has sounded, then as fast as a player turns them, and to what `synth drone` tunes them."""
    frames, turned = 200_000, 100_000
    heard = hear(plugin, [(turned, abi.param(0, ids(plugin)[TONIC], 4.0))], frames, values={MODE: ON, TONIC: 3.0})
    pitches = dict(DRONE.steps)
    begun = [(0, TUNING, 0, key, 1, pitch) for key, pitch in zip(KEYS, pitches[3.0], strict=True)]
    step, count = 441, 30  # 10 ms, a semitone in 0.3 s
    tonic, turning = 3.0, []
    for k in range(count + 1):
        if tonic == 4.0:
            break
        tonic = min(tonic + 0.01 / 0.3, 4.0)
        share = tonic - math.floor(tonic)
        low = pitches[math.floor(tonic)]
        high = pitches[math.ceil(tonic)]
        between = [a + (b - a) * share for a, b in zip(low, high, strict=True)]
        turning += [(turned + k * step, TUNING, 0, key, 1, pitch) for key, pitch in zip(KEYS, between, strict=True)]
    rows_all = np.concatenate([make_events([*begun, *turning]), of_drone(frames)])
    rows_all = rows_all[np.argsort(rows_all["frame"], kind="stable")]
    assert tonic == 4.0 and count <= len(turning) // len(KEYS) <= count + 1
    assert np.array_equal(heard, truth(engine, rows_all, frames))


# ---- in beats of the host ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("beat", [0.0, 1.0, 6.5, -5.25, -4.0, 40_000.75])
def test_it_stands_where_the_song_does(plugin, engine, beat):
    frames, tempo = 300_000, 137.5
    heard = play_song(Song((0, True, beat, tempo)), plugin, frames, values={PACE: 1.0})
    expected = played(strokes((0, beat, tempo), frames))
    assert sum(row[1] == NOTE_ON for row in expected) > 10
    assert np.array_equal(heard, truth(engine, make_events(expected), frames))


@pytest.mark.parametrize("sizes", [SIZES, (256,), (4096,)])
def test_a_tempo_that_changes_in_a_block_is_followed_from_that_frame(plugin, engine, sizes):
    frames, change = 300_000, 100_100
    first, second = 120.0, 93.0
    there = change * first / (60.0 * RATE)
    heard = play_song(Song((0, True, 0.0, first), (change, True, there, second)), plugin, frames, sizes, {PACE: 1.0})
    before = strokes((0, 0.0, first), change)
    after = strokes((change, there, second), frames, number=before[-1][0] + 1)
    assert np.array_equal(heard, truth(engine, make_events(played(before, after)), frames))


@pytest.mark.parametrize(("cycles", "early"), [(2, False), (4, True)])
def test_a_loop_lands_right_each_time(plugin, engine, cycles, early):
    """Some cycles again and again, the end in the midst of a block; a stroke that the hand was early with, before the end,
    is not doubled at the beginning."""
    tempo, length, last = 150.0, cycles * SETTINGS.beats, cycles * len(KEYS)
    period = round(length * 60.0 / tempo * RATE)
    frames = 4 * period
    song = Song(*((k * period, True, 0.0, tempo) for k in range(4)))
    heard = play_song(song, plugin, frames, values={PACE: 1.0})
    parts = []
    for k in range(4):
        here = strokes((k * period, 0.0, tempo), (k + 1) * period)
        assert [n for n, _ in here] == list(range(last + early))  # the one after the end is that of the beginning
        parts.append(here[1:] if k and early else here)
    assert np.array_equal(heard, truth(engine, make_events(played(*parts)), frames))


def test_a_late_stroke_is_not_lost_at_a_jump(plugin, engine):
    """The hand is late with a stroke that stands before the jump: it comes with it."""
    tempo = 60.0
    late = next(n for n in range(40, 200) if beat_of(n) / SETTINGS.beats > n // 4 + sum(DRONE.gaps[: n % 4]) + 0.003)
    place = (late // 4 + sum(DRONE.gaps[: late % 4])) * SETTINGS.beats
    begin, jump = place - 3.0, round((3.0 + 0.001 * SETTINGS.beats) * RATE)
    heard = play_song(Song((0, True, begin, tempo), (jump, True, 1000.1, tempo)), plugin, 200_000, values={PACE: 1.0})
    before = strokes((0, begin, tempo), jump)
    assert before[-1][0] == late - 1
    expected = played(before, [(late, jump)], strokes((jump, 1000.1, tempo), 200_000))
    assert np.array_equal(heard, truth(engine, make_events(expected), 200_000))


def test_beats_in_a_cycle_are_a_parameter(plugin, engine):
    frames, tempo = 200_000, 120.0
    heard = play_song(Song((0, True, 2.0, tempo)), plugin, frames, values={PACE: 1.0, BEATS: 3.0})
    assert np.array_equal(heard, truth(engine, make_events(played(strokes((0, 2.0, tempo), frames, 3.0))), frames))


@pytest.mark.parametrize("tempo", [0.0, math.nan, math.inf, -120.0, None])
def test_without_a_tempo_it_has_its_own_pace(plugin, engine, tempo):
    frames = 150_000
    heard = play_song(Song((0, True, 7.0, tempo)), plugin, frames, values={PACE: 1.0})
    assert np.array_equal(heard, truth(engine, of_drone(frames), frames))


def test_without_a_place_it_goes_at_the_hosts_tempo(plugin, engine):
    frames, tempo = 150_000, 160.0
    heard = play_song(Song((0, True, None, tempo)), plugin, frames, values={PACE: 1.0})
    cycle = replace(SETTINGS.cycle, cycle_s=SETTINGS.beats * 60.0 / tempo)
    assert np.array_equal(heard, truth(engine, of_drone(frames, cycle), frames))


def test_with_no_transport_at_all_it_can_be_switched_on(plugin, engine):
    frames = 150_000
    heard = hear(plugin, [], frames, values={MODE: ON, PACE: 1.0})
    assert np.array_equal(heard, truth(engine, of_drone(frames), frames))


def test_on_it_goes_on_at_the_tempo_where_the_host_stops_and_meets_it_again(plugin):
    """Sounding all the while: as many strokes as cycles have passed."""
    tempo, frames = 150.0, 600_000
    cycle = round(SETTINGS.beats * 60.0 / tempo * RATE)
    song = Song((0, True, 0.0, tempo), (150_000, False, 3.0, tempo), (350_000, True, 64.0, tempo))
    heard = play_song(song, plugin, frames, values={MODE: ON, PACE: 1.0})
    windows = [kit.loudest(heard[k : k + cycle]) for k in range(0, frames - cycle, cycle)]
    assert min(windows) > 0.3 * max(windows)


# ---- states, reset, bypass --------------------------------------------------------------------------------------------


def test_a_state_begins_anew_with_its_values(exported, engine):
    with Host(exported) as host, host.instance() as first, host.instance() as second:
        first.flush([abi.param(0, ids(first)[name], value) for name, value in {MODE: ON, SECONDS: 1.1}.items()])
        assert second.activate(RATE)
        second.start()
        hear(second, [], 77_777, values={MODE: ON, SECONDS: 2.3})
        assert second.load(first.save())
        frames, fade = 100_000, 200
        heard = hear(second, [], frames)
    expected = truth(engine, of_drone(frames, replace(SETTINGS.cycle, cycle_s=1.1)), frames)
    assert np.array_equal(heard[fade:], expected[fade:])


def test_a_reset_begins_anew(plugin, engine):
    hear(plugin, [], 77_777, values={MODE: ON, SECONDS: 1.1})
    plugin.reset()
    frames = 100_000
    fade = 200  # of what sounded
    heard = hear(plugin, [], frames)
    expected = truth(engine, of_drone(frames, replace(SETTINGS.cycle, cycle_s=1.1)), frames)
    assert np.array_equal(heard[fade:], expected[fade:])


def test_bypassed_it_is_silent_and_goes_on_where_it_would_be(plugin):
    bypass = next(info.id for info in plugin.params if info.flags & abi.BYPASS)
    begun, ended, frames = 60_000, 260_000, 400_000
    given = [(begun, abi.param(0, bypass, 1.0)), (ended, abi.param(0, bypass, 0.0))]
    heard = hear(plugin, given, frames, values={MODE: ON})
    assert kit.loudest(heard[begun + 1000 : ended]) == 0.0
    strokes_on = of_drone(frames)
    strokes_on = strokes_on[strokes_on["kind"] == NOTE_ON]["frame"]
    assert strokes_on[strokes_on > ended][0] < frames - 20_000
    assert kit.loudest(heard[:begun]) > 0.01 and kit.loudest(heard[-20_000:]) > 0.01


# ---- other formats ----------------------------------------------------------------------------------------------------


def defaults() -> list[float]:
    """What LV2's control ports hold at first."""
    about = describe([DRONE.strings.preset], "tanpura-light-drone", DRONE.parameters())
    return [each.default for each in (*about.parameters, *about.setup, *about.own)]


def test_vst3_plays_the_same(exported, engine):
    frames, tempo = 200_000, 120.0
    factory = vst3host.Factory(exported)
    instance = vst3host.Instance(factory)
    named = {info.title: info for info in instance.parameters()}
    mode, pace = (named[DRONE.parameters()[k].name] for k in (MODE, PACE))
    assert instance.text(mode.id, 1.0) == "while the host plays" and mode.steps == 2
    needs = instance.component.query(vst3host.REQUIREMENTS)
    assert needs is not None and needs.call(3, lv2host.c.c_uint32) == 1 << 2 | 1 << 6 | 1 << 10
    needs.release()
    instance.start(RATE)
    out = []
    song = Song((0, True, 5.0, tempo), (100_000, False, None, None))
    for begin, end in vst3host.blocks(frames, (100, 4096, 1, 1000)):
        block = vst3host.Block(context=vst3host.context(*song.at(begin)))
        if begin == 0:
            block.points = {pace.id: [(0, 1.0)]}
        out.append(instance.process(end - begin, block))
    stop = next(begin for begin, _ in vst3host.blocks(frames, (100, 4096, 1, 1000)) if begin >= 100_000)
    instance.close()
    assert factory.release() == 0
    on = strokes((0, 5.0, tempo), stop)
    expected = [*played(on), (stop, NOTE_OFF, 0, KEYS[on[-1][0] % len(KEYS)], 64, 0.0)]
    assert np.array_equal(np.concatenate(out), truth(engine, make_events(expected), frames).astype(np.float32))


def test_vst3_at_its_own_pace(exported, engine):
    factory = vst3host.Factory(exported)
    instance = vst3host.Instance(factory)
    mode = next(info.id for info in instance.parameters() if info.title == "Drone")
    instance.start(RATE, size=vst3host.SAMPLE_64)
    frames = 150_000
    out = [
        instance.process(end - begin, vst3host.Block(points={mode: [(0, 0.5)]} if begin == 0 else {}))
        for begin, end in vst3host.blocks(frames, (333, 4096))
    ]
    instance.close()
    assert factory.release() == 0
    assert np.array_equal(np.concatenate(out), truth(engine, of_drone(frames), frames))


@pytest.mark.parametrize("unit", [4, 8])
def test_lv2_plays_the_same(exported, engine, unit):
    """Its host speaks when something changes, in beats of the measure."""
    instance = lv2host.Instance(exported, RATE, defaults())
    instance.controls[len(defaults()) - len(DRONE.parameters()) + PACE] = 1.0
    instance.activate()
    frames, told, tempo, beat = 200_000, 5_000, 100.0, 4.5
    quarters = unit / 4
    where = {"speed": 1.0, "beatsPerMinute": tempo * quarters, "beatUnit": unit, "beatsPerBar": 2.0 * quarters}
    where |= {"bar": 2, "barBeat": 0.5 * quarters}
    out = []
    for begin, end in vst3host.blocks(frames, (1000, 31, 4096)):
        messages = [instance.position(told - begin, **where)] if begin <= told < end else []
        out.append(instance.run(end - begin, messages))
    instance.close()
    expected = played(strokes((told, beat, tempo), frames))
    assert np.array_equal(np.concatenate(out), truth(engine, make_events(expected), frames).astype(np.float32))


def test_lv2_switched_off_and_on_it_begins_anew_where_the_host_plays_on(exported, engine):
    """What the host said before still holds."""
    instance = lv2host.Instance(exported, RATE, defaults())
    instance.activate()
    instance.run(50_000, [instance.position(0, speed=1.0, beatsPerMinute=120.0, bar=0, barBeat=0.0, beatsPerBar=4.0)])
    instance.activate()
    heard = instance.run(80_000)
    instance.close()
    assert np.array_equal(heard, truth(engine, of_drone(80_000), 80_000).astype(np.float32))


def test_lv2_at_its_own_pace(exported, engine):
    instance = lv2host.Instance(exported, RATE, defaults())
    instance.controls[len(defaults()) - len(DRONE.parameters()) + MODE] = 1.0
    instance.activate()
    frames = 150_000
    out = [instance.run(end - begin) for begin, end in vst3host.blocks(frames, (999, 4096))]
    instance.close()
    assert np.array_equal(np.concatenate(out), truth(engine, of_drone(frames), frames).astype(np.float32))


def test_lv2_positions_that_are_none_are_passed_over(exported):
    instance = lv2host.Instance(exported, RATE, defaults())
    instance.controls[len(defaults()) - len(DRONE.parameters()) + MODE] = OFF
    instance.activate()
    good = instance.position(0, speed=1.0, beatsPerMinute=120.0, bar=1, barBeat=0.0, beatsPerBar=4.0)
    for size in range(0, len(good[2]), 3):
        assert kit.loudest(instance.run(64, [(0, good[1], good[2][:size])])) == 0.0
    instance.close()


def test_random_hosts(exported):
    """A thousand actions of hosts whose transport knows no rules."""
    tool = Path(__file__).resolve().parents[2] / "tools" / "plugin-fuzz"
    command = [sys.executable, tool, "--actions", "1000", "--plugin", exported]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "violations: 0" in done.stdout, done.stdout + done.stderr
    if "libasan" not in os.environ.get("LD_PRELOAD", ""):  # which has an allocator of its own
        assert "allocated 0, freed 0, locked 0, opened 0" in done.stdout


# ---- the table ----------------------------------------------------------------------------------------------------------


def test_a_drone_that_cannot_be_is_refused(library_file, tmp_path):
    """Every number of the score set to what is none, the checksum made to fit: refused, or played without harm."""
    whole = bankfile.bank([DRONE.strings.preset], [RATE], drone=DRONE)
    header = np.frombuffer(whole[: bankfile.HEADER.itemsize], bankfile.HEADER)[0]
    end, at = int(header["tables_end"]), int(header["drone_at"])
    path, refused, tried = tmp_path / "changed.jawari", 0, 0
    native = Library(library_file)
    keys = SCORE.fields["keys"][1]
    offsets = [*range(0, keys + 4 * len(KEYS), 8), *(SCORE.fields["places"][1] + 8 * k for k in range(len(KEYS)))]
    offsets += [SCORE.itemsize + OWN.itemsize * k + 8 * row for k in range(6) for row in range(4)]
    first = SCORE.itemsize + 6 * OWN.itemsize
    offsets += [*range(first, first + 64, 8), *range(int(header["drone"]) - 40, int(header["drone"]), 8)]
    for offset in offsets:
        for value in (1 << 63, (1 << 64) - 1, 0x7FF8 << 48, 0x4340 << 48):
            data = bytearray(whole)
            data[at + offset : at + offset + 8] = value.to_bytes(8, "little")
            place = bankfile.HEADER.fields["checksum"][1]
            data[place : place + 4] = bytes(4)
            data[place : place + 4] = zlib.crc32(data[:end]).to_bytes(4, "little")
            path.write_bytes(data)
            tried += 1
            try:
                native.open_bank(path).close()
            except Refused as error:
                assert "the drone in it cannot be" in str(error)
                refused += 1
    assert refused > 0.7 * tried  # −0 may be for 0


def test_the_score_is_the_cycles(library_file):
    """Strokes far on in the table are those that `synth drone` plays then."""
    table = np.frombuffer(DRONE.table()[-40 * CYCLES * len(KEYS) :], STROKE)
    for number in (0, 1, 5, 4000, 8191):
        place = number // len(KEYS) + sum(DRONE.gaps[: number % len(KEYS)])
        assert tuple(table[number]) == pytest.approx(SETTINGS.cycle.variation(number, place, min(DRONE.gaps)), abs=1e-15)
    assert len({row["sway"] for row in table}) > 0.99 * len(table)


def test_the_command_makes_one(library_file, tmp_path):
    environment = {**os.environ, "JAWARI_NATIVE": str(library_file), "HOME": str(tmp_path)}

    def export(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "synth", "export", *arguments]
        root = Path(__file__).resolve().parents[2]
        env = {**environment, "PYTHONPATH": str(root)}
        return subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, check=False)

    strings = ("--equal", "--sa", "D3", "--first", "Ma")
    made = export("--drone", "tanpura-light", *strings, "--beats", "16", "--rates", "44100", "-f", "all")
    assert made.returncode == 0, made.stderr
    there = sorted(path.name for path in tmp_path.iterdir() if path.name.startswith("tanpura-light"))
    assert there == ["tanpura-light-drone.clap", "tanpura-light-drone.lv2", "tanpura-light-drone.vst3"]
    with Host(tmp_path / "tanpura-light-drone.clap") as host, host.instance() as instance:
        assert instance.value(ids(instance)[BEATS]) == 16.0
        assert instance.text(ids(instance)[MODE], 2.0) == "while the host plays"
    assert shutil.which("lv2_validate") is None or "Found 0 errors" in validated(tmp_path / "tanpura-light-drone.lv2")
    for wrong, told in (
        (["fretted-bass", "--drone"], "a drone needs a bridge and four strings"),
        (["tanpura-light", "fretted-bass", "--drone"], "makes a plugin of one preset, got 2"),
        (["tanpura-light", "--equal"], "--equal belongs to a drone"),
        (["tanpura-light", "--sa", "D3"], "--sa belongs to a drone; add --drone"),
        (["tanpura-light", "--drone", "--sa", "C7"], "--sa must lie between G2"),
        (["tanpura-light", "--drone", "--spacing", "1,2"], "--spacing needs one number for each of the 4 strings"),
        (["tanpura-light", "--drone", "--tuning", "x.scl"], "leave --tuning and --kbm out"),
    ):
        said = export(*wrong, "-f", "clap", "-o", str(tmp_path / "wrong.clap"))
        assert said.returncode == 2 and told in said.stderr and "Traceback" not in said.stderr
        assert not (tmp_path / "wrong.clap").exists()


def validated(bundle: Path) -> str:
    done = subprocess.run(
        ["lv2_validate", *sorted(map(str, bundle.glob("*.ttl")))], capture_output=True, text=True, check=False
    )
    return done.stdout + done.stderr
