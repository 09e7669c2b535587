"""From parsed MIDI files to events at frames."""

from itertools import groupby

import mido
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from synth.midi import song as songs
from synth.midi import sysex
from synth.midi.events import (
    BEND,
    CONTROL,
    KEY_PRESSURE,
    NOTE_OFF,
    NOTE_ON,
    PARAMETER,
    PRESSURE,
    PROGRAM,
    TUNING,
    decode,
)
from synth.midi.smf import MidiError, MidiFile, Track, parse
from synth.midi.song import Song, Zones, _Clock, _merge, song_from_file

from .midibytes import header, off, on, tempo, track, vlq

RATE_HZ = 48000


def song(data: bytes, rate_hz: int = RATE_HZ, until_s: float | None = None) -> Song:
    return song_from_file(parse(data), rate_hz, until_s=until_s)


def rows(result: Song) -> list[tuple[int, int, int]]:
    """(frame, kind, a) of all events."""
    return [(int(e["frame"]), int(e["kind"]), int(e["a"])) for e in result.events]


def test_tempo_changes_in_any_track_count_for_all() -> None:
    # 480 ticks at 0.5 s, then (tempo from the *second* track) at 0.25 s per quarter note.
    first = track((0, on(60)), (480, off(60)), (480, on(62)), (480, off(62)))
    second = track((480, tempo(250_000)))
    result = song(header(1, 2) + first + second)
    assert [frame for frame, _, _ in rows(result)] == [0, 24000, 36000, 48000]
    assert result.length_s == pytest.approx(1.0, abs=1e-12)


def test_smpte_time_takes_no_notice_of_tempo() -> None:
    data = header(division=(256 - 25) << 8 | 40) + track((0, tempo(10)), (500, on(60)), (1000, off(60)))
    assert [frame for frame, _, _ in rows(song(data))] == [24000, 72000]


def test_tracks_of_format_2_play_one_after_the_other_at_their_own_tempo() -> None:
    first = track((0, tempo(1_000_000)), (0, on(60)), (480, off(60)), end=480)
    second = track((0, on(62)), (480, off(62)))
    result = song(header(2, 2) + first + second)
    assert rows(result) == [
        (0, NOTE_ON, 60),
        (48000, NOTE_OFF, 60),
        (96000, NOTE_ON, 62),
        (120000, NOTE_OFF, 62),
    ]
    assert result.length_s == pytest.approx(2.5, abs=1e-12)


def test_a_note_without_an_end_ends_with_the_file() -> None:
    result = song(header() + track((0, on(60)), (480, on(64)), (0, off(64)), end=480))
    assert rows(result)[-1] == (48000, NOTE_OFF, 60)
    assert result.warnings == ("1 note has no note-off and ends with the file",)


def test_a_note_on_of_velocity_0_is_a_note_off() -> None:
    result = song(header() + track((0, on(60)), (480, on(60, 0))))
    assert rows(result) == [(0, NOTE_ON, 60), (24000, NOTE_OFF, 60)]
    assert result.notes == 1
    assert result.events["b"].tolist() == [64, 64]


def test_a_zero_length_note_stays_a_pluck() -> None:
    result = song(header() + track((480, on(60)), (0, off(60)), (480, on(61))))
    assert rows(result)[:2] == [(24000, NOTE_ON, 60), (24000, NOTE_OFF, 60)]


def test_the_end_of_the_earlier_note_goes_before_a_repeat_at_the_same_tick() -> None:
    # The note-off of the first note stands behind the note-on of the second, in another track.
    first = track((0, on(60)), (480, on(60, 99)), (480, off(60)))
    second = track((480, off(60)))
    result = song(header(1, 2) + first + second)
    assert rows(result) == [
        (0, NOTE_ON, 60),
        (24000, NOTE_OFF, 60),
        (24000, NOTE_ON, 60),
        (48000, NOTE_OFF, 60),
    ]
    assert not result.warnings


def test_a_repeat_of_no_length_keeps_both_ends_in_place() -> None:
    data = header() + track((0, on(60)), (480, on(60)), (0, off(60)), (0, off(60)))
    assert [kind for _, kind, _ in rows(song(data))] == [NOTE_ON, NOTE_OFF, NOTE_ON, NOTE_OFF]


def test_a_note_off_does_not_move_past_a_pedal_at_the_same_tick() -> None:
    data = header() + track((0, on(60)), (480, b"\xb0\x40\x7f"), (0, off(60)))
    assert [kind for _, kind, _ in rows(song(data))] == [NOTE_ON, CONTROL, NOTE_OFF]


def test_other_channels_and_keys_do_not_disturb_the_order() -> None:
    data = header() + track((0, on(60)), (480, on(60, channel=1)), (0, on(61)), (0, off(60)))
    assert [(kind, a) for _, kind, a in rows(song(data))][:4] == [
        (NOTE_ON, 60),
        (NOTE_ON, 60),
        (NOTE_ON, 61),
        (NOTE_OFF, 60),
    ]


def test_bend_control_and_program_values() -> None:
    data = header() + track(
        (0, b"\xe2\x00\x00"),
        (0, b"\xe2\x7f\x7f"),
        (0, b"\xe2\x00\x40"),
        (0, b"\xb2\x07\x64"),
        (0, b"\xc2\x21"),
    )
    events = song(data).events
    assert [tuple(int(e[name]) for name in ("kind", "channel", "a", "b")) for e in events] == [
        (BEND, 2, -8192, 0),
        (BEND, 2, 8191, 0),
        (BEND, 2, 0, 0),
        (CONTROL, 2, 7, 100),
        (PROGRAM, 2, 33, 0),
    ]


def test_notes_are_counted_by_channel_and_program() -> None:
    data = header() + track((0, on(60)), (0, b"\xc0\x21"), (10, on(61)), (0, on(62)), (0, on(36, channel=9)), (5, off(60)))
    result = song(data)
    assert result.channels == {(0, 0): 1, (0, 33): 2, (9, 0): 1}
    assert result.keys == {(0, 0): {60}, (0, 33): {61, 62}, (9, 0): {36}}
    assert result.notes == 4


def test_a_long_rest_at_the_end_is_left_out() -> None:
    result = song(header() + track((0, on(60)), (480, off(60)), end=0x0FFFFFFF))
    assert result.length_s == pytest.approx(0.5, abs=1e-12)
    assert "silence is left out" in result.warnings[0]


def test_a_tempo_of_zero_is_passed_over() -> None:
    result = song(header() + track((0, tempo(0)), (480, on(60)), (480, off(60))))
    assert [frame for frame, _, _ in rows(result)] == [24000, 48000]
    assert "tempo of 0" in result.warnings[0]


@pytest.mark.parametrize("data", [header(0, 0), header(1, 0), header(2, 0), header() + track(), header(2, 1) + track()])
def test_a_song_of_nothing(data: bytes) -> None:
    result = song(data)
    assert len(result.events) == 0
    assert result.length_s == 0.0
    assert "the file has no notes" in result.warnings


def test_times_are_midos(tmp_path) -> None:
    random = np.random.default_rng(5)
    written = mido.MidiFile(type=1, ticks_per_beat=96)
    for channel in range(3):
        content = mido.MidiTrack()
        for _ in range(200):
            delta = int(random.integers(0, 200))
            if random.random() < 0.2:
                content.append(mido.MetaMessage("set_tempo", tempo=int(random.integers(1e5, 1e6)), time=delta))
            note = int(random.integers(0, 128))
            content.append(mido.Message("note_on", channel=channel, note=note, velocity=50, time=delta))
        written.tracks.append(content)
    written.save(tmp_path / "song.mid")
    seconds, expected = 0.0, []
    for message in mido.MidiFile(tmp_path / "song.mid"):
        seconds += message.time
        if message.type == "note_on":
            expected.append(seconds)
    result = song((tmp_path / "song.mid").read_bytes())
    got = result.events["frame"][result.events["kind"] == NOTE_ON]
    # Rounded to whole frames: half a frame, and the rounding of mido's running sum of 600 terms.
    assert np.abs(got - np.array(expected) * RATE_HZ).max() <= 0.5 + 1e-6


@given(
    st.lists(
        st.tuples(st.sampled_from((0, 0, 1, 10)), st.booleans(), st.integers(60, 62), st.integers(0, 1)),
        max_size=40,
    )
)
def test_every_note_has_an_end_and_no_pluck_is_lost(moves) -> None:
    data = header() + track(
        *((delta, on(note, 80, channel) if starts else off(note, 80, channel)) for delta, starts, note, channel in moves)
    )
    result = song(data)
    events = result.events
    assert (np.diff(events["frame"]) >= 0).all()
    assert result.notes == sum(starts for _, starts, _, _ in moves) == (events["kind"] == NOTE_ON).sum()
    sounding: dict[tuple[int, int], int] = {}
    for event in events:
        key = int(event["channel"]), int(event["a"])
        sounding[key] = max(0, sounding.get(key, 0) + (1 if event["kind"] == NOTE_ON else -1))
    assert not any(sounding.values())


def test_three_hundred_thousand_events() -> None:
    one = b"".join(bytes((10, 0x90, 40 + n % 50, 64, 5, 40 + n % 50, 0)) for n in range(1000))
    data = header() + track((0, b"\xc0\x00" + one * 150))
    result = song(data)
    assert result.notes == 150_000
    assert len(result.events) == 300_001
    assert result.length_s == pytest.approx(150_000 * 15 / 960, rel=1e-12)


def test_every_message_is_read_as_decode_reads_it() -> None:
    data = [0, 1, 64, 127]
    messages = [
        (status, first, second if not 0xC0 <= status < 0xE0 else 0)
        for status in range(0x80, 0xF0)
        for first in data
        for second in data
    ]
    ticks = list(range(len(messages)))
    whole = Track(ticks, *(list(column) for column in zip(*messages, strict=True)), end_tick=ticks[-1])
    _, events = _merge([whole], _Clock(MidiFile(0, 480, None, [whole], []), [whole], []), 44100)
    assert [tuple(int(e[name]) for name in ("kind", "channel", "a", "b")) for e in events] == [
        decode(*message) for message in messages
    ]
    assert {decode(status, 1, 1)[0] for status in range(0x80)} | {
        decode(status, 1, 1)[0] for status in range(0xF0, 256)
    } == {0}


def test_decode_compiles_as_it_is() -> None:
    compiled = njit(decode)
    for status in range(0x70, 0x100):
        for data in ((0, 0), (5, 0), (127, 127)):
            assert compiled(status, *data) == decode(status, *data)


def test_pressure_and_exclusive_messages_come_in_their_order() -> None:
    half = sysex.of_tuning(60, 60.5, True) + b"\xf7"
    quarter = sysex.of_parameter(1, 3, 0.1) + b"\xf7"
    first = track((0, on(60)), (0, b"\xf0" + bytes((len(half),)) + half), (0, b"\xd0\x40"), (480, off(60)))
    second = track((0, on(61)), (0, b"\xf0" + bytes((len(quarter),)) + quarter), (0, b"\xa0\x3d\x20"), (480, off(61)))
    events = song(header(1, 2) + first + second).events
    rows = [tuple(e[name].item() for name in ("frame", "kind", "channel", "a", "b", "value")) for e in events]
    assert rows == [
        (0, NOTE_ON, 0, 60, 64, 0.0),
        (0, TUNING, 0, 60, 1, 60.5),
        (0, PRESSURE, 0, 0, 64, 0.0),
        (0, NOTE_ON, 0, 61, 64, 0.0),
        (0, PARAMETER, 1, 3, 0, 0.1),
        (0, KEY_PRESSURE, 0, 61, 32, 0.0),
        (24000, NOTE_OFF, 0, 60, 64, 0.0),
        (24000, NOTE_OFF, 0, 61, 64, 0.0),
    ]


def control(channel: int, controller: int, value: int) -> tuple[int, bytes]:
    return 0, bytes((0xB0 | channel, controller, value))


def test_notes_of_a_zone_are_its_masters() -> None:
    notes = [(0, on(60, channel=3)), (480, off(60, channel=3)), (0, on(62, channel=9)), (480, off(62, channel=9))]
    data = header() + track((0, b"\xc0\x05"), (0, b"\xc3\x07"), *notes)
    assert song(data).channels == {(3, 7): 1, (9, 0): 1}
    by_option = song_from_file(parse(data), RATE_HZ, mpe=True)
    assert by_option.channels == {(0, 5): 2}
    assert by_option.keys == {(0, 5): {60, 62}}
    zone = [control(0, 101, 0), control(0, 100, 6), control(0, 6, 4)]
    by_message = song(header() + track(*zone, (0, b"\xc0\x05"), (0, b"\xc3\x07"), *notes))
    assert by_message.channels == {(0, 5): 1, (9, 0): 1}
    assert {int(e["channel"]) for e in by_message.events if e["kind"] == NOTE_ON} == {3, 9}


def test_zones_are_the_engines() -> None:
    from synth.engine.engine import Engine
    from synth.instrument.preset import load_preset
    from synth.midi.events import make_events

    engine = Engine([load_preset("tanpura-light")], quality="draft", only_notes=[{43}])
    engine.prepare(44100.0, 64)
    zones = Zones(False)
    rng = np.random.default_rng(4)
    seen = set()
    for _ in range(300):
        channel = int(rng.choice([0, 15, 3]))
        number, value = int(rng.choice([98, 121])), int(rng.integers(17))
        messages = [(101, 0), (100, int(rng.choice([0, 6, 6]))), (6, value)]
        if rng.integers(4) == 0:
            messages.insert(int(rng.integers(3)), (number, 0))
        for a, b in messages:
            zones.control(channel, a, b)
        engine.process(make_events([(0, CONTROL, channel, a, b) for a, b in messages]), np.zeros((64, 2)))
        masters = [zones.master(c) for c in range(16)]
        assert engine._state.channels["master"].tolist() == masters
        seen.add(tuple(masters))
    assert len(seen) > 20


@pytest.mark.parametrize("division", [1, 480, 32767])
def test_a_song_of_more_than_a_day_is_refused_where_it_gets_too_long(division: int) -> None:
    slow, day = tempo(0xFFFFFF), 24 * 3600
    last = int(day / 16.777215 * division)  # the last tick within the day
    inside = track((0, slow), (0, on(60)), *_far(last, off(60)))
    assert song(header(division=division) + inside).events["frame"][-1] == pytest.approx(day * 48000, rel=3e-4)
    beyond = header(1, 2, division) + track((0, slow)) + track((0, on(60)), (1, off(60)), *_far(2 * last, on(62)))
    with pytest.raises(MidiError, match=rf"exceeds 24 h in track 2 at tick {2 * last + 1}, (48|47\.99) h after"):
        song(beyond)
    with pytest.raises(MidiError, match="exceeds 24 h"):
        song(beyond, until_s=day + 1.0)
    begun = song(beyond, until_s=5.0)
    assert rows(begun)[:2] == [(0, NOTE_ON, 60), (round(16.777215 / division * 48000), NOTE_OFF, 60)]
    assert (begun.events["frame"][2:] == day * 48000).all()


def test_a_day_that_ends_in_a_rest() -> None:
    """The events lie within it, the end of track does not: no message is to blame."""
    data = header(division=1) + track((0, tempo(1_000_000)), (0, on(60)), *_far(24 * 3600 - 5, off(60)), end=10)
    with pytest.raises(MidiError, match="the song is longer than 24 h; shorten it, or render it up to an earlier --end"):
        song(data)
    assert song(data, until_s=24 * 3600.0).length_s == pytest.approx(24 * 3600.0 + 5.0)


def test_a_minute_of_rest_at_the_end_is_meant() -> None:
    second = 960  # ticks
    assert song(header() + track((0, on(60)), (480, off(60)), end=60 * second)).length_s == pytest.approx(60.5, abs=1e-9)
    cut = song(header() + track((0, on(60)), (480, off(60)), end=60 * second + 1))
    assert cut.length_s == pytest.approx(0.5, abs=1e-12)
    assert cut.warnings == ("it ends 60 s after its last event: that silence is left out",)


def test_of_a_take_the_order_stays() -> None:
    """A take is played as it was recorded: an end that follows the note's repeat at the same tick ends the repeat."""
    notes = [(0, on(60)), (480, on(60)), (0, off(60)), (0, off(60))]
    mark = (0, b"\xff\x7f\x04\x7d\x4a\x57\x03")
    kinds = [[kind for _, kind, _ in rows(song(header() + track(*events)))] for events in ([mark, *notes], notes)]
    assert kinds == [[NOTE_ON, NOTE_ON, NOTE_OFF, NOTE_OFF], [NOTE_ON, NOTE_OFF, NOTE_ON, NOTE_OFF]]


def _far(ticks: int, message: bytes) -> list[tuple[int, bytes]]:
    """A message after so many ticks, over texts that say nothing."""
    most = (1 << 28) - 1
    return [(most, b"\xff\x01\x00")] * (ticks // most) + [(ticks % most, message)]


def test_the_longest_times_that_a_file_can_hold() -> None:
    """Without a word of NumPy, and what can be played of it is at its frames."""
    data = header(division=1) + track((0, tempo(0xFFFFFF)), (0, on(60)), *[((1 << 28) - 1, on(61))] * 3000)
    with pytest.raises(MidiError, match=r"in track 1 at tick 268435455, 1\.251e\+06 h"):
        song(data)
    assert song(data, until_s=1.0).events["frame"].min() == 0


RETUNED = st.tuples(
    st.sampled_from([b"\x7e", b"\x7f"]),
    st.sampled_from(["octave", "key", "note", "parameter"]),
    st.integers(0, 3),
    st.integers(0, 127),
)


@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 2), RETUNED), max_size=40))
def test_tunings_that_come_together_are_those_that_make_a_difference(messages) -> None:
    """What every note is plucked at, and what sounds at the end of each frame, is as if all were played."""
    tracks: list[list[tuple[int, bytes]]] = [[(0, b"\xff\x01\x00")], [(0, b"\xff\x01\x00")]]
    for number, delta, (time, what, key, value) in messages:
        if what == "octave":
            body = time + bytes((0x7F, 8, 8, 3, 0x7F, 0x7F, *[value] * 12))
        elif what == "key":
            body = time + bytes((0x7F, 8, 7, 0, 0, 1, key, value % 127, 0, 0))
        else:
            body = sysex.of_parameter(key, 1, float(value))
        tracks[number].append(
            (delta, on(key, 1 + value % 127) if what == "note" else b"\xf0" + vlq(len(body) + 1) + body + b"\xf7")
        )
    # two ticks and a half a frame
    file = parse(header(1, 2, 24000) + b"".join(track(*each) for each in tracks))
    shorter = song_from_file(file, 19200).events
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(songs, "_at_once", lambda one, *_: [[each] for each in one.sysex])
        whole = song_from_file(file, 19200).events
    assert len(shorter) <= len(whole)
    assert _heard(shorter) == _heard(whole)


def _heard(events: np.ndarray) -> list[tuple]:
    """What the notes are plucked at, the parameters, and what sounds when a frame is over."""
    tuning: dict[int, float] = {}
    sounding: dict[int, float] = {}
    told: list[tuple] = []
    for frame, of_frame in groupby(events.tolist(), key=lambda event: event[0]):
        for _, kind, channel, a, b, value in of_frame:
            if kind == TUNING:
                tuning[a] = value
                if b:
                    sounding[a] = value
            elif kind == NOTE_ON:
                sounding[a] = tuning.get(a, float(a))
                told.append((frame, a, b, sounding[a]))
            elif kind == PARAMETER:
                told.append((frame, channel, a, value))
        told.append((frame, sorted(sounding.items()), sorted(tuning.items())))
    return told


def test_a_flood_of_tunings_is_as_many_events_as_frames_can_hear() -> None:
    body = b"\x7f\x7f\x08\x08\x03\x7f\x7f"
    flood = [(0, b"\xf0\x14" + body + bytes([k % 128] * 12) + b"\xf7") for k in range(2000)]
    result = song(header() + track((0, on(60)), *flood, (480, off(60))))
    assert len(result.events) == 128 + 2
    assert set(result.events["value"][result.events["kind"] == TUNING]) == {
        key + (1999 % 128 - 64) / 100.0 for key in range(128)
    }
