"""VST 3: the sound is the engine's, bit for bit, whatever a host does with blocks, queues, states and instances."""

from __future__ import annotations

import numpy as np
import pytest

from synth.midi.events import BEND, CONTROL, NOTE_ON, TUNING

from . import vst3host as host
from .songs import PRESETS, RATES_HZ, Song, random_song, truth

FRAMES = 12000
BRIGHTNESS_ID, TUNING_ID = 5, 2


def split(instance: host.Instance, song: Song, first: int, end: int) -> host.Block:
    """What a host hands over for the frames `first` … `end` of a song."""
    block = host.Block()
    for frame, data in song.messages:
        if not first <= frame < end:
            continue
        kind, channel, at = data[0] >> 4, data[0] & 15, frame - first
        if kind == 9:
            block.events.append((at, host.note_on(channel, data[1], data[2] / 127)))
        elif kind == 8:
            block.events.append((at, host.note_off(channel, data[1], data[2] / 127)))
        elif kind == 10:
            block.events.append((at, host.pressure(channel, data[1], data[2] / 127)))
        elif kind == 15:
            block.events.append((at, host.exclusive(data)))
        else:
            controller = {11: data[1], 12: 130, 13: 128, 14: 129}[kind]
            id = instance.mapped(channel, controller)
            assert id is not None, (channel, controller)
            value = {11: data[-1] / 127, 12: data[1] / 127, 13: data[1] / 127, 14: (data[1] + 128 * data[-1]) / 16383}[kind]
            block.points.setdefault(id, []).append((at, float(np.float32(value))))
    ids = [each.id for each in instance.parameters()]
    for frame, k, position in song.changes:
        if first <= frame < end:
            block.points.setdefault(ids[k], []).append((frame - first, position))
    return block


def played(instance: host.Instance, song: Song, sizes, first: int = 0, end: int | None = None) -> np.ndarray:
    parts = [
        instance.process(b - a, split(instance, song, first + a, first + b))
        for a, b in host.blocks((song.frames if end is None else end) - first, sizes)
    ]
    return np.concatenate(parts)


def in_values(instance: host.Instance, song: Song) -> Song:
    """The song with values of parameters instead of positions."""
    ids = [each.id for each in instance.parameters()]
    return Song(song.frames, song.messages, [(f, k, instance.plain(ids[k], x)) for f, k, x in song.changes])


def a_song(seed: int, frames: int = FRAMES) -> Song:
    """Everything at once: messages, and changes of the first part's and the second's parameters within blocks."""
    rng = np.random.default_rng(seed)
    song = random_song(rng, frames)
    taken = {frame for frame, _ in song.messages}
    at = sorted({int(frame) for frame in rng.integers(0, frames, 30)} - taken)
    song.changes = [(frame, int(rng.integers(10)), float(rng.random())) for frame in at]
    return song


@pytest.mark.parametrize(
    ("rate_hz", "size", "sizes"),
    [
        (44100.0, host.SAMPLE_32, (256,)),
        (48000.0, host.SAMPLE_64, (1, 333, 64, 1024, 7)),
        (44100.0, host.SAMPLE_64, (4096,)),
    ],
)
def test_the_sound_is_the_engines(instance, rate_hz, size, sizes):
    song = a_song(int(rate_hz) + len(sizes))
    instance.start(rate_hz, size=size)
    sound = played(instance, song, sizes)
    expected = truth(PRESETS, rate_hz, in_values(instance, song))
    assert np.abs(expected).max() > 0.01
    np.testing.assert_array_equal(sound, expected if size == host.SAMPLE_64 else expected.astype(np.float32))


def test_instances_do_not_know_of_each_other(factory):
    songs = [a_song(seed, 4000) for seed in (1, 2)]
    both = [host.Instance(factory) for _ in songs]
    for instance, rate_hz in zip(both, RATES_HZ, strict=True):
        instance.start(rate_hz)
    parts: list[list[np.ndarray]] = [[], []]
    for first, end in host.blocks(4000, (100, 512)):
        for k, instance in enumerate(both):
            parts[k].append(instance.process(end - first, split(instance, songs[k], first, end)))
    for k, instance in enumerate(both):
        expected = truth(PRESETS, RATES_HZ[k], in_values(instance, songs[k])).astype(np.float32)
        np.testing.assert_array_equal(np.concatenate(parts[k]), expected)
        instance.close()


def test_each_channel_has_a_bend_range_of_its_own(instance):
    """As MPE hosts set it, on member channels; and the upper zone by its master."""
    instance.start(44100.0)
    rows, points = [], {}
    for channel, (parameter, value) in {3: (0, 24), 9: (0, 7), 15: (6, 4)}.items():
        for k, (controller, position) in enumerate(((101, 0), (100, parameter), (6, value))):
            points[instance.mapped(channel, controller)] = [(10 + k, position / 127)]
            rows.append((10 + k, CONTROL, channel, controller, position))
    for channel in (3, 9, 13):
        points[instance.mapped(channel, 129)] = [(20, 1.0)]
        rows.append((20, BEND, channel, 8191, 0))
    keys = {3: 50, 9: 52, 13: 55}
    notes = [(30, host.note_on(channel, key, 100 / 127)) for channel, key in keys.items()]
    sound = instance.process(2000, host.Block(notes, points))
    rows += [(30, NOTE_ON, channel, key, 100) for channel, key in keys.items()]
    expected = truth(PRESETS, 44100.0, Song(2000), more=rows)
    assert np.abs(expected).max() > 0.01
    np.testing.assert_array_equal(sound, expected.astype(np.float32))


def test_registered_parameters_are_chosen_before_they_are_set(instance):
    """Queues have no order within a frame; here the value's comes first, and what was chosen is let go at the same frame."""
    instance.start(44100.0)
    six, thirtyeight, hundred, hundredone, bend = (instance.mapped(0, k) for k in (6, 38, 100, 101, 129))
    points = {
        bend: [(20, 1.0)],
        six: [(10, 12 / 127)],
        thirtyeight: [(10, 50 / 127)],
        hundred: [(10, 0.0), (10, 1.0)],
        hundredone: [(10, 0.0), (10, 1.0), (15, 1.0)],
    }
    sound = instance.process(2000, host.Block([(30, host.note_on(0, 50, 100 / 127))], points))
    rows = [(10, CONTROL, 0, a, b) for a, b in ((101, 0), (100, 0), (6, 12), (38, 50), (101, 127), (100, 127))]
    rows += [(20, BEND, 0, 8191, 0), (30, NOTE_ON, 0, 50, 100)]
    expected = truth(PRESETS, 44100.0, Song(2000), more=rows)
    np.testing.assert_array_equal(sound, expected.astype(np.float32))


def test_notes_are_tuned_one_by_one(instance):
    instance.start(44100.0, size=host.SAMPLE_64)
    events = [
        (0, host.note_on(0, 50, 1.0, note=77)),
        (0, host.note_on(0, 52, 1.0, note=78)),
        (500, host.expression(TUNING_ID, 77, 0.5 + 1 / 256)),
        (600, host.expression(TUNING_ID, 99, 0.5 + 7 / 240)),  # of no note
        (700, host.expression(BRIGHTNESS_ID, 78, 1.0)),
        (900, host.note_on(0, 55, 1.0, note=79, tuning=-25.0)),
    ]
    sound = instance.process(2000, host.Block(events))
    rows = [
        (0, NOTE_ON, 0, 50, 127),
        (0, NOTE_ON, 0, 52, 127),
        (500, TUNING, 0, 50, 1, 50 + 240 / 256),
        (700, CONTROL, 0, 74, 127),
    ]
    rows += [(900, NOTE_ON, 0, 55, 127), (900, TUNING, 0, 55, 1, 54.75)]
    np.testing.assert_array_equal(sound, truth(PRESETS, 44100.0, Song(2000), more=rows))


def test_what_sounds_fades_where_a_state_is_loaded(factory):
    song = a_song(5)
    first, second = host.Instance(factory), host.Instance(factory)
    for each in (first, second):
        each.start(48000.0)
    played(first, song, (200,))
    second.process(1000, host.Block([(3, host.note_on(0, 48, 1.0))]))
    assert second.load(first.save()) == host.OK
    for info in first.parameters()[:10]:
        assert second.position(info.id) == pytest.approx(first.position(info.id), abs=1e-12)
    after = second.process(2000, host.Block([]))
    assert np.abs(after[:10]).max() > 1e-3 and not after[144:].any()
    first.close()
    second.close()


def test_what_is_no_state_changes_nothing(instance):
    song = a_song(6, 3000)
    instance.start(44100.0)
    before = played(instance, song, (500,), 0, 1500)
    good = instance.save()
    flipped = bytearray(good)
    flipped[len(good) // 2] ^= 16
    for bad in (b"", b"no state", good[:-1], good[:20], bytes(flipped), np.random.default_rng(0).bytes(999)):
        assert instance.load(bad) == host.FALSE
    after = played(instance, song, (500,), 1500)
    expected = truth(PRESETS, 44100.0, in_values(instance, song)).astype(np.float32)
    np.testing.assert_array_equal(np.concatenate([before, after]), expected)


def test_processing_begins_anew(instance):
    instance.start(44100.0)
    instance.process(2000, host.Block([(0, host.note_on(0, 50, 1.0))]))
    assert instance.processing(False) == host.OK
    assert instance.processing(True) == host.OK
    fading = instance.process(1024)  # whole quanta
    assert np.abs(fading[140:]).max() == 0.0 < np.abs(fading[:10]).max()
    song = a_song(7, 3000)
    expected = truth(PRESETS, 44100.0, in_values(instance, song)).astype(np.float32)
    np.testing.assert_array_equal(played(instance, song, (256,)), expected)


def test_knobs_turned_in_the_editor(instance):
    """Before there is sound they hold from its start on; while there is, only the queues of blocks are heard."""
    gain = instance.parameters()[0].id
    assert instance.turn(gain, 0.25) == host.OK
    instance.start(44100.0)
    assert instance.turn(gain, 0.75) == host.OK
    assert instance.position(gain) == 0.75
    block = host.Block([(0, host.note_on(0, 50, 1.0))])
    expected = truth(PRESETS, 44100.0, Song(1000, [(0, bytes([0x90, 50, 127]))], [(0, 0, instance.plain(gain, 0.25))]))
    np.testing.assert_array_equal(instance.process(1000, block), expected.astype(np.float32))


def test_blocks_of_no_frames_and_without_buffers(instance):
    """A host may hand over parameters without frames, and take no sound: both are played all the same."""
    instance.start(44100.0, most=512)
    gain = instance.parameters()[0].id
    assert instance.process(0, host.Block(points={gain: [(0, 0.25)]}), heard=False).size == 0
    instance.process(300, host.Block([(7, host.note_on(0, 50, 1.0))]), heard=False)
    instance.process(513, heard=False, expected=host.INVALID)
    sound = instance.process(500)
    song = Song(800, [(7, bytes([0x90, 50, 127]))], [(0, 0, instance.plain(gain, 0.25))])
    np.testing.assert_array_equal(sound, truth(PRESETS, 44100.0, song)[300:].astype(np.float32))


def test_silence_is_told(instance):
    instance.start(44100.0)
    instance.process(256)
    assert np.abs(instance.process(256)).max() == 0.0 and instance.silence == 3
    instance.process(256, host.Block([(200, host.note_on(0, 50, 1.0))]))
    assert instance.silence == 0
    for _ in range(4):
        instance.process(256)
        assert instance.silence == 0


def test_bypassed_there_is_silence_and_notes_end(instance):
    """A key that was let go while bypassed does not sound when it is over."""
    instance.start(44100.0)
    bypass = next(each.id for each in instance.parameters() if each.flags & 1 << 16)
    instance.process(1000, host.Block([(0, host.note_on(0, 50, 1.0))]))
    instance.process(2000, host.Block([(10, host.note_off(0, 50, 0.5))], {bypass: [(0, 1.0)]}))
    for _ in range(60):  # longer than the released string rings
        assert np.abs(instance.process(1000)).max() == 0.0
    instance.process(1000, host.Block(points={bypass: [(0, 0.0)]}))
    assert np.abs(instance.process(1000)).max() < 1e-4


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1.0, 2.0, 1e30])
def test_wild_values_do_no_harm(instance, value):
    instance.start(44100.0)
    ids = [each.id for each in instance.parameters()]
    events = [
        (0, host.note_on(0, 50, 1.0, note=1)),
        (3, host.note_on(0, 52, value)),
        (4, host.pressure(0, 50, value)),
        (5, host.expression(TUNING_ID, 1, value)),
        (5, host.expression(BRIGHTNESS_ID, 1, value)),
        (-7, host.note_off(0, 50, value)),
        (10**9, host.note_on(0, 48, 1.0)),
        (20, host.note_on(16, 50, 1.0)),
        (20, host.note_on(0, 128, 1.0)),
        (20, host.note_on(-1, -1, 1.0)),
    ]
    sound = instance.process(
        512, host.Block(events, {**{id: [(1, value), (600, value)] for id in ids}, 12345: [(0, value)]})
    )
    assert np.isfinite(sound).all()
    assert np.isfinite(instance.process(512)).all()


@pytest.mark.parametrize("velocity", [0.0, 0.001, 0.003, float("nan")])
def test_the_softest_note_is_a_note(instance, velocity):
    """VST 3 ends notes by an event of its own; MIDI's velocity 0 would be an end."""
    instance.start(44100.0)
    sound = instance.process(2000, host.Block(events=[(0, host.note_on(0, 50, velocity))]))
    expected = truth(PRESETS, 44100.0, Song(2000, [(0, bytes([0x90, 50, 1]))]))
    assert np.abs(expected).max() > 0.0
    np.testing.assert_array_equal(sound, expected.astype(np.float32))
