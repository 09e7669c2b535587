"""mido's files and messages where a song or events are asked for, and where mido itself reads a file wrongly."""

import io
from types import SimpleNamespace

import mido
import numpy as np
import pytest

import synth
from synth.midi import sysex
from synth.midi.events import BEND, CONTROL, EVENT, KEY_PRESSURE, NOTE_OFF, NOTE_ON, PRESSURE, PROGRAM, TUNING, make_events
from synth.midi.messages import bytes_of, events_from_mido, song_from
from synth.midi.smf import MidiError, parse
from synth.midi.song import read_song
from tests.host.midibytes import chunk, header, off, on, tempo, track


def song_file(**more: object) -> mido.MidiFile:
    file = mido.MidiFile(type=1, ticks_per_beat=96, **more)
    for channel in range(2):
        content = mido.MidiTrack()
        content.append(mido.MetaMessage("set_tempo", tempo=400_000 + 100_000 * channel, time=48 * channel))
        content.append(mido.Message("program_change", channel=channel, program=33))
        content.append(mido.Message("note_on", channel=channel, note=36, velocity=90, time=10))
        content.append(mido.Message("note_off", channel=channel, note=36, velocity=64, time=50))
        file.tracks.append(content)
    return file


def test_a_midifile_is_the_song_of_its_file(tmp_path) -> None:
    file = song_file()
    file.save(tmp_path / "song.mid")
    theirs, ours = song_from(file, 48000)[1], read_song(tmp_path / "song.mid", 48000)
    assert np.array_equal(theirs.events, ours.events)
    assert (theirs.length_s, theirs.keys, theirs.notes) == (ours.length_s, ours.keys, ours.notes) != (0.0, {}, 0)
    assert song_from(str(tmp_path / "song.mid"), 48000)[0] == str(tmp_path / "song.mid")


def test_the_messages_of_a_midifile_are_its_events_too() -> None:
    """Iterating over a MidiFile gives messages with times in seconds, tempo changes worked in."""
    events = events_from_mido(song_file(), 48000)
    song = song_from(song_file(), 48000)[1]
    assert events[["kind", "channel", "a", "b"]].tolist() == song.events[["kind", "channel", "a", "b"]].tolist()
    assert np.abs(events["frame"] - song.events["frame"]).max() <= 1


def test_every_kind_of_message() -> None:
    messages = [
        mido.Message("note_on", channel=3, note=60, velocity=90, time=0.5),
        mido.Message("note_on", channel=3, note=60, velocity=0, time=0.25),
        mido.Message("note_off", note=61, velocity=12),
        mido.Message("control_change", control=7, value=99),
        mido.Message("program_change", channel=15, program=33),
        mido.Message("pitchwheel", pitch=-8192, time=0.25),
        mido.Message("aftertouch", value=12),
        mido.Message("polytouch", note=60, value=13),
        mido.MetaMessage("lyrics", text="la", time=1.0),
        mido.Message("clock"),
        mido.Message("sysex", data=sysex.of_tuning(43, 44.5, True)),
        mido.Message("reset"),
    ]
    expected = make_events(
        [
            (500, NOTE_ON, 3, 60, 90),
            (750, NOTE_OFF, 3, 60, 64),
            (750, NOTE_OFF, 0, 61, 12),
            (750, CONTROL, 0, 7, 99),
            (750, PROGRAM, 15, 33, 0),
            (1000, BEND, 0, -8192, 0),
            (1000, PRESSURE, 0, 0, 12),
            (1000, KEY_PRESSURE, 0, 60, 13),
        ]
    )
    found = events_from_mido(messages, 1000)
    assert np.array_equal(found[:-1], expected)
    assert found[-1].tolist()[:4] == (2000, TUNING, 0, 43) and found[-1]["value"] == pytest.approx(44.5, abs=1e-4)
    late = [mido.Message("note_on", time=0.5), mido.Message("note_off", time=0.75)]
    assert events_from_mido(late, 1000, absolute=True)["frame"].tolist() == [500, 750]
    assert events_from_mido(late, 0.5, absolute=True)["frame"].tolist() == [0, 0]
    assert events_from_mido([], 1000).dtype == EVENT


@pytest.mark.parametrize(
    ("messages", "rate_hz", "error", "words"),
    [
        ([b"\x90\x3c\x40"], 44100, TypeError, "message 0 must be one of mido's, got bytes"),
        ([mido.Message("clock", time=-1)], 44100, ValueError, "the time of message 0 must lie between"),
        ([mido.Message("clock", time=float("nan"))], 44100, ValueError, "the time of message 0 must lie"),
        ([mido.Message("clock", time=1e12)], 44100, ValueError, "and 86400 s, got"),
        ([], 0, ValueError, "rate_hz must be > 0"),
    ],
)
def test_what_is_no_message(messages: list, rate_hz: float, error: type, words: str) -> None:
    with pytest.raises(error, match=words):
        events_from_mido(messages, rate_hz)


def _cannot(**_: object) -> None:
    raise RuntimeError("no room")


@pytest.mark.parametrize(
    ("source", "error", "words"),
    [
        (3, TypeError, "a song must be a file's name"),
        (b"MThd", TypeError, "a song must be a file's name"),
        (np.zeros(3), TypeError, "EVENT array"),
        (make_events([(5, NOTE_ON, 0, 60, 1), (3, NOTE_OFF, 0, 60, 1)]), ValueError, "must be sorted by frame"),
        (make_events([(-1, NOTE_ON, 0, 60, 1)]), ValueError, "must be sorted by frame, from 0 on"),
        (make_events([(0, NOTE_ON, 0, 60, 1)])[None], TypeError, r"one-dimensional EVENT array, got shape \(1, 1\)"),
        (SimpleNamespace(tracks=[], save=_cannot), MidiError, r"cannot be saved \(no room\); check its header"),
        (mido.MidiFile(ticks_per_beat=0), MidiError, "0 ticks per quarter"),
        (mido.MidiFile(ticks_per_beat=10**6), MidiError, "cannot be saved"),
    ],
)
def test_what_is_no_song(source: object, error: type, words: str) -> None:
    with pytest.raises(error, match=words):
        song_from(source, 44100)


def test_messages_and_events_are_songs_too() -> None:
    said = [mido.Message("note_on", note=60, velocity=90, time=0.5), mido.Message("note_off", note=60, time=0.25)]
    events = make_events([(500, NOTE_ON, 0, 60, 90), (500, NOTE_ON, 0, 62, 90), (750, NOTE_OFF, 0, 60, 64)])
    for source, notes in ((said, {60}), (iter(said), {60}), (events, {60, 62})):
        title, song = song_from(source, 1000)
        assert (title, song.length_s, song.rate_hz, song.keys) == ("the song", 0.75, 1000, {(0, 0): notes})
    assert song_from(events[:0], 1000)[1].length_s == 0.0
    # with a zone of all channels the notes are the master's
    moved = make_events([(0, NOTE_ON, 5, 60, 90)])
    assert [song_from(moved, 1000, mpe)[1].channels for mpe in (False, True)] == [{(5, 0): 1}, {(0, 0): 1}]


def test_smpte_time_survives_mido() -> None:
    """mido takes the division for a negative number, but hands it on."""
    file = mido.MidiFile(file=io.BytesIO(header(division=0xE728) + track((0, on(60)), (1000, off(60)))))
    assert parse(bytes_of(file)).ticks_per_second == 1000.0


def test_rendering_to_an_array_is_what_the_command_writes(tmp_path) -> None:
    import soundfile

    from synth.host.render import RenderSettings, render_file

    file = song_file()
    file.save(tmp_path / "song.mid")
    more = {"quality": "draft", "tail": 0.1}
    out = str(tmp_path / "out.wav")
    render_file(RenderSettings(str(tmp_path / "song.mid"), out, preset="tanpura-light", bit_depth="float", **more))
    written = soundfile.read(out, dtype="float32")[0]
    assert written.any()
    done = synth.render(file, "tanpura-light", stems=True, **more)
    assert np.array_equal(done.samples.astype(np.float32), written)
    assert list(done.stems) == ["ch01-tanpura-light", "ch02-tanpura-light"] and done.report.notes == 2
    assert repr(done).startswith(f"<Sound: {len(written) / 44100:.2f} s at 44100 Hz, peak ")
    assert (done.report.clipped_samples, done.report.stems_lowered_db, done.report.output) == (0, 0.0, None)
    by_object = synth.render(str(tmp_path / "song.mid"), channels={1: synth.load_preset("tanpura-light"), 2: "none"}, **more)
    assert by_object.report.left_out == {2: 1} and by_object.report.notes == 1
    louder = synth.render(file, "tanpura-light", normalize_dbfs=-1.0, stems=True, **more)
    assert np.abs(louder.samples).max() == pytest.approx(10 ** (-1 / 20), rel=1e-12)
    with pytest.raises(TypeError, match="no setting 'qualty'"):
        synth.render(file, qualty="draft")
    for channel in (0, 17):
        with pytest.raises(ValueError, match=f"channels must be 1 to 16, got {channel}"):
            synth.render(file, channels={channel: "tanpura-light"})
    with pytest.raises(TypeError, match="no setting 'output'"):
        synth.render(file, output="x.wav")
    assert synth.render(file, channels={16: "tanpura-light"}, preset="none", end_s=0.01, **more).samples.any() is np.False_


#: what mido 1.3 makes of files that our own reader reads, or refuses with the place: an error, or what is wrong
WHERE_MIDO_ERRS = {
    "SMPTE time runs backwards": (
        header(division=0xE728) + track((0, on(60)), (1000, off(60))),
        lambda file: file.length < 0.0,
        lambda file: file.ticks_per_second == 1000.0,
    ),
    "an unknown chunk before the track": (
        header() + chunk(b"XFIH", b"abcd") + track((0, on(60))), OSError, lambda file: file.tracks[0].data1 == [60],
    ),
    "an unknown chunk between tracks": (
        header(1, 2) + track((0, on(60))) + chunk(b"XFKM", b"abcd") + track((0, on(62))),
        OSError, lambda file: [each.data1 for each in file.tracks] == [[60], [62]],
    ),
    "running status across system exclusive": (
        header() + track((0, on(60)), (0, b"\xf0\x02\x01\xf7"), (10, bytes((62, 64)))),
        EOFError, lambda file: file.tracks[0].data1 == [60, 62],
    ),
    "system exclusive in packets": (
        header() + track((0, b"\xf0\x03\x7e\x01\x02"), (5, b"\xf7\x02\x03\xf7")),
        lambda file: len([each for each in file.tracks[0] if each.type == "sysex"]) == 2,
        lambda file: [body for _, _, body in file.tracks[0].sysex] == [b"\x7e\x01\x02\x03"],
    ),
    "what follows the end of track": (
        header() + track((0, on(60)), (0, b"\xff\x2f\0"), (0, on(62))),
        lambda file: [each.note for each in file.tracks[0] if each.type == "note_on"] == [60, 62],
        lambda file: file.tracks[0].data1 == [60],
    ),
    "a file in RIFF": (
        b"RIFF" + bytes(4) + b"RMIDdata" + (60).to_bytes(4, "little") + header() + track((0, on(60))),
        OSError, lambda file: file.tracks[0].data1 == [60],
    ),
    "a tempo of two bytes": (
        header() + track((0, b"\xff\x51\x02\x01\x02"), (0, on(60))), IndexError, lambda file: file.tracks[0].data1 == [60],
    ),
    "a key signature that there is not": (
        header() + track((0, b"\xff\x59\x02\x10\x00"), (0, on(60))), Exception, lambda file: file.tracks[0].data1 == [60],
    ),
    "a length of more than four bytes": (
        header() + chunk(b"MTrk", b"\x81\x80\x80\x80\x80\x80\x00" + on(60) + b"\0\xff\x2f\0"),
        lambda file: file.length > 1e9, "a length of more than four bytes in the message at byte 22",
    ),
    "no ticks": (header(division=0) + track((0, on(60)), (9, off(60))), "length", "0 ticks per quarter note"),
    "a format that there is not": (header(7) + track((0, on(60))), lambda file: file.type == 7, "format 7 is not supported"),
    "a file that is cut off": (
        (header() + track((0, on(60)), (48, off(60))))[:-6], EOFError, r"cut off inside track 1 of 1 \(after 28 bytes\)",
    ),
    "an empty file": (b"", EOFError, "the file is empty"),
    "a data byte above 127": (
        header() + track((0, bytes((0x90, 200, 64)))), OSError, "a data byte above 127 in the message at byte 22",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WHERE_MIDO_ERRS)
def test_where_mido_reads_wrongly_our_reader_does_not(name: str) -> None:
    """The reason for a reader of our own. A case that fails at mido's side is one that mido has mended."""
    data, theirs, ours = WHERE_MIDO_ERRS[name]
    if isinstance(theirs, type):
        with pytest.raises(theirs):
            mido.MidiFile(file=io.BytesIO(data))
    elif theirs == "length":
        with pytest.raises(ZeroDivisionError):
            _ = mido.MidiFile(file=io.BytesIO(data)).length
    else:
        assert theirs(mido.MidiFile(file=io.BytesIO(data)))
    if isinstance(ours, str):
        with pytest.raises(MidiError, match=ours):
            parse(data)
    else:
        assert ours(parse(data))


def test_where_they_agree_they_agree() -> None:
    """Running status across meta events, tempo in any track: mido is right there, and so are we."""
    data = (
        header(1, 2)
        + track((0, on(60)), (0, b"\xff\x01\x01a"), (10, bytes((62, 64))))
        + track((0, tempo(10**6)), (480, on(61)))
    )
    theirs = mido.MidiFile(file=io.BytesIO(data))
    assert [each.note for each in theirs.tracks[0] if not each.is_meta] == parse(data).tracks[0].data1 == [60, 62]
    assert theirs.length == song_from(theirs, 44100)[1].length_s == 1.0
