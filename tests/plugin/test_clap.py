"""The plugin in a strict CLAP host: every sample is the engine's, and no rule is broken."""

from __future__ import annotations

import ctypes as c
import math
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from synth.instrument.preset import load_preset
from synth.midi.events import BEND, CONTROL, KEY_PRESSURE, NOTE_OFF, NOTE_ON, PARAMETER, PROGRAM, TUNING, make_events
from synth.native.processors import cores
from synth.plugin.description import describe
from synth.plugin.library import compiler, with_bank
from tests.engine.kit import FREE
from tests.plugin import clapabi as abi
from tests.plugin import claphost
from tests.plugin.clapabi import CONTINUE, SLEEP
from tests.plugin.claphost import Host, Instance
from tests.plugin.clapkit import (
    GAIN,
    HEIGHT,
    MIXED,
    PARTS,
    POSITION,
    blocks_of,
    hear,
    loudest,
    parameter_id,
    plugin_file,
    reference,
    to_host,
    truth,
    wild,
)

CHORD = [(10, NOTE_ON, 0, 48, 100), (700, NOTE_ON, 0, 50, 60), (800, NOTE_ON, 0, 55, 127)]


@pytest.fixture(scope="module")
def clap(library_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plugin_file(library_file, tmp_path_factory.mktemp("clap"))


@pytest.fixture(scope="module")
def realtime(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("realtime") / "realtime.so"
    source = Path(__file__).parent / "realtime.c"
    subprocess.run([*compiler(), "-O2", "-shared", "-fPIC", str(source), "-o", str(made)], check=True)
    return made


@pytest.fixture
def host(clap: Path) -> Iterator[Host]:
    made = Host(clap)
    yield made
    made.close()


@pytest.fixture
def playing(host: Host) -> Instance:
    return started(host)


def started(host: Host, rate_hz: float = 44100.0) -> Instance:
    made = host.instance()
    assert made.activate(rate_hz)
    made.start()
    return made


# ---- what it says of itself ---------------------------------------------------------------------------------------


def test_description(host: Host) -> None:
    (descriptor,) = host.descriptors
    assert descriptor.id == b"org.jawari.collection"
    assert claphost.features_of(descriptor) == [b"instrument", b"synthesizer", b"stereo"]


def test_opened_by_two_hosts_at_once(clap: Path) -> None:
    first, second = Host(clap), Host(clap)
    first.close()
    made = started(second)
    assert loudest(hear(made, CHORD, 4000)) > 0.001
    second.close()
    with Host(clap) as again:
        again.instance()


def test_a_library_without_presets_is_refused(library_file: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(OSError, match="refused"):
        Host(library_file)
    assert len(capfd.readouterr().err.split()) > 5


def test_every_extension_is_there(host: Host) -> None:
    with host.instance() as made:
        assert [name for name, each in made.ext.items() if each is None] == []
        ports, notes = made.ext["clap.audio-ports"], made.ext["clap.note-ports"]
        assert [ports.count(made.address, side) for side in (True, False)] == [0, 1]
        assert [notes.count(made.address, side) for side in (True, False)] == [1, 0]
        info = abi.AudioPortInfo()
        assert ports.get(made.address, 0, False, c.addressof(info))
        assert (info.channel_count, info.port_type, info.flags) == (2, b"stereo", 3)
        assert not ports.get(made.address, 1, False, c.addressof(info))
        note = abi.NotePortInfo()
        assert notes.get(made.address, 0, True, c.addressof(note))
        assert (note.supported, note.preferred) == (7, 1)
        voices = abi.VoiceInfo()
        assert made.ext["clap.voice-info"].get(made.address, c.addressof(voices))
        assert voices.count == voices.capacity == 13
        render = made.ext["clap.render"]
        assert not render.realtime(made.address) and render.set(made.address, 1) and render.set(made.address, 0)


def test_a_page_of_knobs_for_each_preset(host: Host) -> None:
    with host.instance() as made:
        pages, known = made.ext["clap.remote-controls/2"], {info.id for info in made.params}
        assert pages.count(made.address) == 3
        page = abi.RemotePage()
        for k, preset in enumerate(PARTS):
            assert pages.get(made.address, k, c.addressof(page))
            assert page.name == preset.name.encode()
            shown = [each for each in page.params if each != abi.INVALID_ID]
            assert len(shown) in (5, 6) and set(shown) <= known
        assert not pages.get(made.address, 3, c.addressof(page))


def test_parameters_are_the_presets_and_the_plugins_own(host: Host) -> None:
    with host.instance() as made:
        assert [info.name for info in made.params[-2:]] == [b"Program", b"Bypass"]
        modules = {preset.name.encode() + behind for preset in PARTS for behind in (b"", b"/Setup")}
        assert {info.module for info in made.params[:-2]} == modules
        assert all(bool(info.flags & abi.AUTOMATABLE) != info.module.endswith(b"/Setup") for info in made.params)
        assert made.values() == {info.id: info.initial for info in made.params}
        with host.instance() as other:
            assert [info.id for info in other.params] == [info.id for info in made.params]


def test_texts_and_back(host: Host) -> None:
    rng = np.random.default_rng(1)
    with host.instance() as made:
        for info in made.params:
            low, high = info.minimum, info.maximum
            for value in (low, high, info.initial, *rng.uniform(low, high, 50)):
                text = made.text(info.id, value)
                back = made.number(info.id, text)
                if info.flags & abi.STEPPED:
                    assert back == np.floor(value + 0.5)
                else:
                    assert back == pytest.approx(value, rel=1e-5, abs=1e-9)
                assert low <= back <= high and made.text(info.id, back) == text
        gain = parameter_id(made, 0, GAIN)
        assert [made.number(gain, text) for text in ("1.5", " 1,5 x ", "15e-1 ×", "99")] == [1.5, 1.5, 1.5, 4.0]
        height = parameter_id(made, 1, HEIGHT)
        assert made.text(height, -12.5) == "-12.5 µm" and made.number(height, "-12.5 um") == -12.5
        program, bypass = (info.id for info in made.params[-2:])
        assert made.text(program, 1.0) == "bridge" and made.number(program, "NECK") == 2.0
        assert made.text(bypass, 1.0) == "on" and made.number(bypass, "off") == 0.0
        for text in ("", "-", "loud", "1 mm", "nan", "inf", "1.5.2", "x" * 500):
            with pytest.raises(ValueError, match="no value"):
                made.number(gain, text)
        assert made.text(height, -12.5, room=9) == "-12.5 µ"  # whole characters
        assert made.text(height, -12.5, room=8) == "-12.5 "
        assert made.text(height, 1e300) == made.text(height, 50.0)


def test_latency_and_tail_are_the_engines(host: Host) -> None:
    truth_ = reference()
    with host.instance() as made:
        assert made.latency == truth_.latency_samples
        assert made.activate(44100.0)
        assert made.latency == truth_.latency_samples
        tail = made.ext["clap.tail"].get(made.address)
        assert tail == pytest.approx(truth_.tail_seconds * 44100.0 + truth_.latency_samples, abs=2)


# ---- the same samples ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("notes_as", ["clap", "midi"])
def test_bitwise_the_engine(playing: Instance, notes_as: str) -> None:
    rows = wild(3, 400, 60_000)
    expected = truth(reference(), rows, 66_000)
    assert loudest(expected) > 0.01
    np.testing.assert_array_equal(hear(playing, rows, 66_000, MIXED, notes_as=notes_as), expected)


def test_float_is_the_same_rounded(playing: Instance) -> None:
    rows = wild(4, 200, 30_000)
    expected = truth(reference(), rows, 33_000).astype(np.float32)
    np.testing.assert_array_equal(hear(playing, rows, 33_000, (256, 77), np.float32), expected)


def test_every_rate_and_none_that_there_is_not(host: Host) -> None:
    made = host.instance()
    for rate in (48000.0, 44100.0, 48000.0):
        assert made.activate(rate)
        made.start()
        np.testing.assert_array_equal(hear(made, CHORD, 9000), truth(reference(rate), CHORD, 9000))
        made.stop()
        made.deactivate()
    for rate in (22050.0, 0.0, -1.0, float("nan"), float("inf"), 1e300):
        assert not made.activate(rate)
    assert "44100" in made.logged[0] and "48000" in made.logged[0]
    assert made.activate(44100.0)


def test_automation_is_sample_accurate(playing: Instance) -> None:
    rows = [*CHORD, *((1000 + 37 * k, PARAMETER, 0, GAIN, 0, 0.5 + 0.01 * k) for k in range(100))]
    rows += [(2000, PARAMETER, 0, POSITION, 0, 0.11), (2001, NOTE_ON, 0, 51, 90)]
    np.testing.assert_array_equal(hear(playing, rows, 9000, (64, 1000)), truth(reference(), rows, 9000))
    assert playing.value(parameter_id(playing, 0, GAIN)) == 0.5 + 0.01 * 99


def test_events_in_any_order(playing: Instance) -> None:
    """Those of one frame in the order in which they come."""
    rows = [*CHORD, (1500, PARAMETER, 0, GAIN, 0, 0.5), (1500, PARAMETER, 0, GAIN, 0, 0.25), (2000, NOTE_ON, 0, 51, 90)]
    playing.ordered = False
    given = [to_host(row, playing, "midi") for row in make_events([rows[k] for k in (5, 2, 3, 0, 4, 1)])]
    np.testing.assert_array_equal(playing.process(given, 4000), truth(reference(), rows, 4000))


def test_events_handed_over_parameter_by_parameter(playing: Instance) -> None:
    """Each in order, one behind the other, and those of one frame heard as they came."""
    of = [(0, GAIN), (0, POSITION), (1, GAIN), (2, GAIN)]
    rows = [(0, NOTE_ON, 0, 48, 100)]
    for part, index in of:
        rows += [(frame, PARAMETER, part, index, 0, 0.1 + 0.0005 * (frame % 100)) for frame in range(0, 500, 1 + index)]
    rows += [(frame, PARAMETER, 0, GAIN, 0, 0.5) for frame in range(499, -1, -3)]
    events = make_events(rows)
    playing.ordered = False
    ours = playing.process([to_host(row, playing, "midi") for row in events], 512)
    playing.ordered = True
    ours = np.concatenate([ours, hear(playing, [], 2000)])
    np.testing.assert_array_equal(ours, truth(reference(), events, 2512, 512))
    assert loudest(ours) > 0.001


def test_what_is_said_of_a_note(playing: Instance) -> None:
    """Tuning is of the key and gone with its next note; pressure; brightness is controller 74."""
    said = [
        abi.note_on(0, 48, 1.0, note_id=7),
        abi.expression(300, abi.TUNING, 0.5, key=48, note_id=7),
        abi.expression(301, abi.TUNING, 0.75, key=-1, channel=-1, note_id=7),
        abi.expression(400, abi.PRESSURE, 0.5, key=48),
        abi.expression(500, abi.BRIGHTNESS, 1.0, key=48),
        abi.expression(501, abi.TUNING, 9.0, key=48, note_id=8),  # another note
        abi.note_on(600, 50, 0.5),
        abi.note_on(900, 48, 0.9, note_id=9),
    ]
    expected = [
        (0, NOTE_ON, 0, 48, 127),
        (300, TUNING, 0, 48, 1, 48.5),
        (301, TUNING, 0, 48, 1, 48.75),
        (400, KEY_PRESSURE, 0, 48, 64),
        (500, CONTROL, 0, 74, 127),
        (600, NOTE_ON, 0, 50, 64),
        (900, TUNING, 0, 48, 0, float("nan")),
        (900, NOTE_ON, 0, 48, 114),
    ]
    ours = np.concatenate([playing.process(said, 1000), hear(playing, [], 4000)])
    np.testing.assert_array_equal(ours, truth(reference(), expected, 5000))
    assert playing.ended == [(900, 7, 0, 48)]


def test_tuning_of_a_note_is_off_the_tuning_of_its_key(playing: Instance) -> None:
    retuned = abi.sysex(0, bytes((0xF0, 0x7F, 0x7F, 8, 2, 0, 1, 48, 48, 64, 0, 0xF7)))  # 48.5
    bent = abi.expression(600, abi.TUNING, 1.0, key=48)
    ours = playing.process([retuned, abi.note_on(1, 48, 1.0), bent, abi.note_on(900, 48, 1.0)], 4000)
    expected = [
        (0, TUNING, 0, 48, 1, 48.5),
        (1, NOTE_ON, 0, 48, 127),
        (600, TUNING, 0, 48, 1, 49.5),
        (900, TUNING, 0, 48, 0, 48.5),
        (900, NOTE_ON, 0, 48, 127),
    ]
    np.testing.assert_array_equal(ours, truth(reference(), expected, 4000))


def test_ends_of_many_notes_at_once(playing: Instance) -> None:
    notes = [abi.note_on(k, key, 0.8, channel=channel) for k, (channel, key) in enumerate([(0, 48), (0, 50), (1, 52)])]
    off = [abi.note_off(300, -1, channel=0), abi.note_off(400, -1, channel=-1)]
    expected = [(0, NOTE_ON, 0, 48, 102), (1, NOTE_ON, 0, 50, 102), (2, NOTE_ON, 1, 52, 102)]
    expected += [(300, NOTE_OFF, 0, 48, 0), (300, NOTE_OFF, 0, 50, 0), (400, NOTE_OFF, 1, 52, 0)]
    np.testing.assert_array_equal(playing.process([*notes, *off], 4000), truth(reference(), expected, 4000))


def test_choke(playing: Instance) -> None:
    """Alone on its channel a note is silenced, beside others it is let go."""
    events = [abi.note_on(0, 48, 0.8), abi.note_on(1, 50, 0.8), abi.choke(300, 48), abi.choke(900)]
    expected = [(0, NOTE_ON, 0, 48, 102), (1, NOTE_ON, 0, 50, 102), (300, NOTE_OFF, 0, 48, 127)]
    expected += [(900, NOTE_OFF, 0, 48, 127), (900, NOTE_OFF, 0, 50, 127), (900, CONTROL, 0, 120, 0)]
    np.testing.assert_array_equal(playing.process(events, 4000), truth(reference(), expected, 4000))


def test_the_program_is_of_all_channels(playing: Instance) -> None:
    program = playing.params[-2].id
    rows = [(0, PROGRAM, channel, 1, 0) for channel in range(16)] + [(5, NOTE_ON, 3, 43, 100), (9, BEND, 3, 4000)]
    ours = playing.process(
        [abi.param(0, program, 1.0), abi.note_on(5, 43, 100 / 127, 3), abi.midi(9, 0xE3, 0x20, 0x5F)], 4000
    )
    np.testing.assert_array_equal(ours, truth(reference(), rows, 4000))
    assert loudest(ours) > 0.001


@pytest.mark.parametrize("pool", ["threads", "forward", "backward", "refuses"])
def test_threads_of_the_host(clap: Path, pool: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAWARI_THREADS", "3")
    rows = wild(6, 200, 20_000)
    with Host(clap, pool=pool) as host:
        made = started(host)
        np.testing.assert_array_equal(hear(made, rows, 22_000), truth(reference(), rows, 22_000))
        assert (made.lent_tasks > 0) == (pool != "refuses" and cores() > 1)


def test_threads_of_its_own(host: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAWARI_THREADS", "3")
    rows = wild(7, 200, 20_000)
    made = host.instance()
    there = set(os.listdir("/proc/self/task"))
    assert made.activate(44100.0)
    assert len(set(os.listdir("/proc/self/task")) - there) == min(3, cores()) - 1
    made.start()
    np.testing.assert_array_equal(hear(made, rows, 22_000), truth(reference(), rows, 22_000))


def test_two_instances_on_two_threads(host: Host) -> None:
    rows = [wild(seed, 100, 15_000) for seed in (8, 9)]
    both = [started(host), started(host)]
    expected = [truth(reference(), each, 15_000) for each in rows]
    heard: list[list[np.ndarray]] = [[], []]
    for blocks in zip(*(blocks_of(each, 15_000, (128,)) for each in rows), strict=True):
        later = [
            made.process_later([to_host(row, made, "clap") for row in here], size)
            for made, (_, size, here) in zip(both, blocks, strict=True)
        ]
        for out, each in zip(heard, later, strict=True):
            out.append(each.result())
    for out, right in zip(heard, expected, strict=True):
        np.testing.assert_array_equal(np.concatenate(out), right)


# ---- states of a performance --------------------------------------------------------------------------------------


def test_it_sleeps_when_nothing_sounds(playing: Instance) -> None:
    assert loudest(playing.process([], 256)) == 0.0 and playing.status == SLEEP
    playing.process([abi.note_on(255, 48, 1.0)], 256)
    assert playing.status == CONTINUE
    assert loudest(hear(playing, [], 2000)) > 0.01 and playing.status == CONTINUE
    playing.process([abi.note_off(0, 48), abi.midi(1, 0xB0, 120, 0)], 256)
    for _ in range(2000):
        last = playing.process([], 512)
        if playing.status == SLEEP:
            break
    assert playing.status == SLEEP and loudest(last) <= 1e-6
    assert loudest(playing.process([], 4096)) <= 1e-6


def test_the_host_is_told_when_a_note_has_ended(playing: Instance) -> None:
    playing.process([abi.note_on(3, 48, 1.0, note_id=1), abi.note_on(4, 50, 1.0, note_id=2)], 512)
    playing.process([abi.note_off(7, 48, note_id=1)], 512)
    for _ in range(3000):
        playing.process([], 512)
        if playing.ended:
            break
    assert [each[1:] for each in playing.ended] == [(1, 0, 48)]  # 50 is held
    playing.process([abi.note_on(9, 50, 1.0, note_id=3)], 512)
    assert playing.ended[1:] == [(9, 2, 0, 50)]
    playing.process([abi.note_off(0, 50, note_id=2)], 512)  # comes too late: the string is another note's
    hear(playing, [], 60_000)
    assert len(playing.ended) == 2
    playing.process([abi.note_on(0, 127, 1.0, note_id=4), abi.note_off(100, 127, note_id=4)], 512)  # has no string
    assert playing.ended[2][1:] == (4, 0, 127)


def test_a_note_at_the_end_of_a_block_has_not_ended_before_it_sounds(playing: Instance) -> None:
    playing.process([abi.note_on(500, 48, 1.0, note_id=7), abi.note_off(505, 48, note_id=7)], 512)
    assert playing.ended == []
    for _ in range(3000):
        playing.process([], 512)
        if playing.ended:
            break
    assert playing.ended


def test_reset_while_it_sounds(playing: Instance) -> None:
    gain = parameter_id(playing, 0, GAIN)
    before = playing.process([abi.note_on(0, 48, 1.0), abi.param(0, gain, 0.5)], 4000)
    playing.reset()
    faded = playing.process([], 256)
    assert (
        np.abs(np.diff(np.concatenate([before[-200:], faded])[:, 0])).max() < 1.5 * np.abs(np.diff(before[-2000:, 0])).max()
    )
    assert loudest(faded[140:]) == 0.0
    made = reference()
    truth(made, [(0, PARAMETER, 0, GAIN, 0, 0.5)], 256)
    np.testing.assert_array_equal(hear(playing, CHORD, 4000), truth(made, CHORD, 4000))
    assert playing.value(gain) == 0.5


def test_bypassed_it_is_silent_and_plays_nothing_new(playing: Instance) -> None:
    bypass = playing.params[-1].id
    hear(playing, CHORD, 4000)
    playing.process([abi.param(100, bypass, 1.0), abi.note_on(300, 52, 1.0)], 512)
    assert loudest(playing.process([abi.note_off(0, 48)], 4096)) == 0.0
    back = playing.process([abi.param(0, bypass, 0.0)], 512)
    assert 0.0 < np.abs(back[:5]).max() < 0.05 * np.abs(back[300:]).max()
    made = reference()
    truth(made, CHORD, 4000 + 512)
    truth(made, [(0, NOTE_OFF, 0, 48)], 4096)
    expected = truth(made, [], 512)
    np.testing.assert_array_equal(back[230:], expected[230:])


def test_values_outside_of_blocks(host: Host) -> None:
    """Flushed before it is active and while it is, they are heard from the next block on."""
    made = host.instance()
    gain, position = (parameter_id(made, 0, each) for each in (GAIN, POSITION))
    made.flush([abi.param(0, gain, 0.25), abi.param(0, 12345, 1.0), abi.note_on(0, 48, 1.0)])
    assert made.value(gain) == 0.25
    made.activate(44100.0)
    made.start()
    first = hear(made, CHORD, 2000)
    made.flush([abi.param(0, position, 0.1), abi.param(0, gain, float("nan"))])
    assert (made.value(position), made.value(gain)) == (0.1, 0.25)
    second = hear(made, [(5, NOTE_ON, 0, 52, 100)], 4000)
    engine = reference()
    np.testing.assert_array_equal(first, truth(engine, [(0, PARAMETER, 0, GAIN, 0, 0.25), *CHORD], 2000))
    expected = truth(engine, [(0, PARAMETER, 0, POSITION, 0, 0.1), (5, NOTE_ON, 0, 52, 100)], 4000)
    np.testing.assert_array_equal(second, expected)
    made.flush([abi.param(0, gain, 99.0)])
    assert made.value(gain) == 4.0


def test_values_by_messages_are_told_to_the_host(playing: Instance) -> None:
    from synth.midi.sysex import of_parameter

    gain = parameter_id(playing, 0, GAIN)
    playing.process([abi.sysex(3, b"\xf0" + of_parameter(0, GAIN, 0.75) + b"\xf7")], 64)
    assert playing.value(gain) == 0.75 and playing.told == [(gain, 0.75)]


def test_more_events_than_there_is_room_for(playing: Instance) -> None:
    """None hangs: what was lost may have been ends of notes."""
    playing.process([abi.note_on(0, 48, 1.0)], 64)
    playing.process([abi.midi(0, 0xB0, 1, k % 128) for k in range(9000)] + [abi.note_off(63, 48)], 64)
    for _ in range(3000):
        playing.process([], 512)
        if playing.status == SLEEP:
            break
    assert playing.status == SLEEP


def test_more_events_over_short_blocks_than_the_engine_holds(playing: Instance) -> None:
    """They wait for the latency to be over, longer than these blocks are: none hangs, nor one held by the pedal."""
    playing.process([abi.note_on(0, 48, 1.0), abi.midi(0, 0xB0, 64, 127)], 64)
    for _ in range(3):
        playing.process([abi.midi(0, 0xB0, 1, k % 128) for k in range(8000)], 1)
    playing.process([abi.note_off(0, 48), abi.midi(0, 0xB0, 64, 0)], 1)
    for _ in range(3000):
        playing.process([], 512)
        if playing.status == SLEEP:
            break
    assert playing.status == SLEEP
    rows = [(0, NOTE_ON, 0, 48, 100)]
    assert loudest(hear(playing, rows, 2000)) > 0.001


def test_values_that_find_no_room_are_told_with_the_next_block(playing: Instance) -> None:
    """And no note ends because of them."""
    gain = parameter_id(playing, 0, GAIN)
    changes = [abi.param(0, gain, 0.25 + 0.5 * (k % 2)) for k in range(9000)] + [abi.param(0, gain, 0.125)]
    ours = np.concatenate(
        [
            playing.process([abi.note_on(0, 48, 100 / 127.0), *changes], 64),
            hear(playing, [], 4000),
        ]
    )
    engine = reference()
    told = [(0, NOTE_ON, 0, 48, 100)] + [(0, PARAMETER, 0, GAIN, 0, 0.25 + 0.5 * (k % 2)) for k in range(8191)]
    right = np.concatenate([truth(engine, told, 64), truth(engine, [(0, PARAMETER, 0, GAIN, 0, 0.125)], 4000)])
    np.testing.assert_array_equal(ours, right)
    assert loudest(ours) > 0.0


@pytest.mark.parametrize("velocity", [0.003, 0.0])
def test_the_softest_note_is_played(playing: Instance, velocity: float) -> None:
    """A velocity that rounds to 0 is no end of a note."""
    ours = np.concatenate([playing.process([abi.note_on(0, 48, velocity)], 256), hear(playing, [], 2000)])
    np.testing.assert_array_equal(ours, truth(reference(), [(0, NOTE_ON, 0, 48, 1)], 2256))
    assert loudest(ours) > 0.0


def test_it_survives_what_no_host_should_say(playing: Instance) -> None:
    nan, inf = float("nan"), float("inf")
    events = [
        abi.note_on(0, 48, nan),
        abi.note_on(0, 49, -5.0),
        abi.note_on(0, 50, inf),
        abi.note_on(0, -1, 1.0),
        abi.note_on(0, 200, 1.0),
        abi.note_on(0, 50, 1.0, channel=99),
        abi.note_on(0, 50, 1.0, port=3),
        abi.note_off(0, 51, velocity=nan),
        abi.choke(0, key=-1000),
        abi.param(0, 99, 1.0),
        abi.param(0, parameter_id(playing, 0, GAIN), nan),
        abi.midi(0, 0x10, 0xFF, 0xFF),
        abi.midi(0, 0x90, 0xFF, 0xFF),
        abi.midi(0, 0xF8, 0, 0),
        abi.sysex(0, b""),
        abi.sysex(0, b"\xf0"),
        abi.sysex(0, b"\xf0" + bytes(range(256)) * 40 + b"\xf7"),
    ]
    events += [
        abi.expression(0, what, value, key)
        for what in range(-1, 9)
        for value in (nan, inf, -inf, 1e300, 0.5)
        for key in (-1, 48, 500)
    ]
    for event in events[:3]:
        short = type(event).from_buffer_copy(event)
        short.header.size = 17
        events.append(short)
    foreign = abi.note_on(0, 53, 1.0)
    foreign.header.space = 77
    events.append(foreign)
    assert loudest(playing.process(events, 512)) < 10.0
    assert loudest(hear(playing, CHORD, 4000)) > 0.001


# ---- states -------------------------------------------------------------------------------------------------------


def test_what_sounds_fades_where_a_state_is_loaded(host: Host) -> None:
    """Within 3 ms and without a click; then the instance plays as one that begins with these values."""
    made, fresh = started(host), host.instance()
    with host.instance() as saved:
        saved.flush([abi.param(0, parameter_id(saved, 0, GAIN), 0.5)])
        data = saved.save()
    before = hear(made, [(0, NOTE_ON, 0, 48, 127), (10, BEND, 0, 3000)], 5000)
    assert made.load(data) and made.process_requests == 1
    after, fade = hear(made, [], 2000), math.ceil(0.003 * 44100)
    assert loudest(after[:10]) > 0.01 and not after[fade:].any()
    steps = np.abs(np.diff(np.concatenate([before[-2000:], after[: fade + 50]]), axis=0))
    assert steps[1999:].max() <= 1.5 * steps[:1999].max()
    assert fresh.load(data)
    fresh.activate(44100.0)
    fresh.start()
    assert not hear(fresh, [], 2000).any()
    np.testing.assert_array_equal(hear(made, CHORD, 4000), hear(fresh, CHORD, 4000))
    assert made.values() == fresh.values()


def test_what_is_saved_while_it_plays_is_what_was_set(host: Host) -> None:
    made, silent = started(host), host.instance()
    hear(made, CHORD, 3000)
    assert made.save() == silent.save()


def test_what_sounds_fades_into_the_bypass_of_a_state(host: Host) -> None:
    made = started(host)
    with host.instance() as saved:
        bypass = next(info.id for info in saved.params if info.flags & abi.BYPASS)
        saved.flush([abi.param(0, bypass, 1.0)])
        data = saved.save()
    before = hear(made, [(0, NOTE_ON, 0, 48, 127)], 5000)
    assert made.load(data)
    after = hear(made, CHORD, 2000)
    assert loudest(after[:10]) > 0.01 and not after[441:].any()
    steps = np.abs(np.diff(np.concatenate([before[-2000:], after]), axis=0))
    assert steps[1999:].max() <= 1.5 * steps[:1999].max()


def test_random_hosts(clap: Path) -> None:
    """A thousand actions of a host that follows the rules and of a player who follows none."""
    tool = Path(__file__).resolve().parents[2] / "tools" / "plugin-fuzz"
    command = [sys.executable, tool, "--actions", "1000", "--plugin", clap]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "violations: 0" in done.stdout, done.stdout + done.stderr
    if "libasan" not in os.environ.get("LD_PRELOAD", ""):  # which has an allocator of its own
        assert "allocated 0, freed 0, locked 0, opened 0" in done.stdout


def test_latency_that_changes_with_the_rate_is_told(host: Host) -> None:
    made = host.instance()
    known = made.latency
    changes = 0
    for rate in (48000.0, 44100.0, 44100.0):
        made.activate(rate)
        changes += reference(rate).latency_samples != known
        assert made.latency_changes == changes
        known = made.latency
        made.deactivate()


def test_hosts_keep_automation_by_the_same_numbers_for_ever(
    library_file: Path, bank_files: dict[str, Path], tmp_path: Path
) -> None:
    path = tmp_path / "tanpura-light.clap"
    path.write_bytes(with_bank(library_file, bank_files["tanpura-light"].read_bytes()))
    with Host(path) as host:
        ids = {bytes(info.name).decode(): info.id for info in host.instance().params}
    rows = {row.id: ids[row.name] for row in describe([load_preset("tanpura-light")]).parameters}
    assert (rows["output.gain"], ids["Bypass"]) == (1748011410, 1573592237)


def test_presets_of_one_title_are_read_back(library_file: Path, tmp_path: Path) -> None:
    twins = [FREE.model_copy(update={"name": name, "title": "Free"}) for name in ("a", "b")]
    with Host(plugin_file(library_file, tmp_path, twins, (44100.0,))) as host:
        made = host.instance()
        program = made.params[-2].id
        assert [made.number(program, made.text(program, value)) for value in (0.0, 1.0)] == [0.0, 1.0]
