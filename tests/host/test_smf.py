"""The MIDI file reader against files made by hand and against mido."""

import io

import mido
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synth.midi.smf import MidiError, parse, read_file

from .midibytes import chunk, header, off, on, tempo, track, vlq


def messages(data: bytes) -> list[tuple[int, int, int, int]]:
    (only,) = parse(data).tracks
    return list(zip(only.ticks, only.status, only.data1, only.data2, strict=True))


def test_running_status_goes_on_across_meta_events_and_sysex() -> None:
    data = header() + track(
        (0, on(60)),
        (10, bytes((60, 0))),
        (0, b"\xff\x01\x03abc"),
        (5, bytes((62, 70))),
        (0, b"\xf0\x02\x01\xf7"),
        (7, bytes((62, 0))),
        (0, b"\xc3\x21"),
        (1, b"\x22"),
    )
    assert messages(data) == [
        (0, 0x90, 60, 64),
        (10, 0x90, 60, 0),
        (15, 0x90, 62, 70),
        (22, 0x90, 62, 0),
        (22, 0xC3, 0x21, 0),
        (23, 0xC3, 0x22, 0),
    ]


@pytest.mark.parametrize("value", [0, 127, 128, 8192, 16383, 16384, 2097151, 2097152, 0x0FFFFFFF])
def test_delta_times_of_every_length(value: int) -> None:
    assert messages(header() + track((value, on(60))))[0][0] == value


@pytest.mark.parametrize(("frames", "per_second"), [(24, 24.0), (25, 25.0), (29, 30000 / 1001), (30, 30.0)])
def test_smpte_division(frames: int, per_second: float) -> None:
    file = parse(header(division=((256 - frames) << 8) | 40) + track())
    assert file.ticks_per_quarter is None
    assert file.ticks_per_second == pytest.approx(per_second * 40, rel=1e-15)


def test_unknown_chunks_and_longer_headers_are_passed_over() -> None:
    long_header = chunk(b"MThd", bytes((0, 1, 0, 1, 1, 224, 9, 9)))
    data = long_header + chunk(b"XFIH", b"anything") + track((3, on(61)))
    assert messages(data) == [(3, 0x90, 61, 64)]


def test_a_file_wrapped_in_riff() -> None:
    inner = header() + track((3, on(61)))
    body = b"RMIDLIST\x01\x00\x00\x00x\x00data" + len(inner).to_bytes(4, "little") + inner
    assert messages(b"RIFF" + len(body).to_bytes(4, "little") + body) == [(3, 0x90, 61, 64)]


def test_system_exclusive_in_one_piece_and_in_packets() -> None:
    data = header() + track(
        (0, on(60)),
        (10, b"\xf0\x03\x7e\x01\xf7"),
        (0, b"\xf0\x02\x41\x10"),
        (5, b"\xf7\x01\x42"),
        (5, b"\xf7\x02\x43\xf7"),
        (0, b"\xf7\x03\xf3\x01\xf7"),  # an escape: a song select
        (0, off(60)),
        (0, b"\xf0\x02\x01\x02"),  # never ended
        (0, b"\xf0\x02\x05\xf7"),
    )
    (only,) = parse(data).tracks
    assert only.sysex == [(1, 10, b"\x7e\x01"), (1, 20, b"\x41\x10\x42\x43"), (2, 20, b"\x05")]
    assert only.ticks == [0, 20]


def test_system_messages_that_have_no_place_in_a_file_are_passed_over_with_their_data() -> None:
    # quarter frame, song position, song select, tune request, clock; the last stands at the track's end
    strays = [(1, bytes(each)) for each in ((0xF1, 5), (0xF2, 6, 7), (0xF3, 8), (0xF6,), (0xF8,))]
    assert messages(header() + track(*strays, (1, on(60)), *strays, end=None)) == [(6, 0x90, 60, 64)]


def test_a_take_is_known_by_its_mark() -> None:
    """A sequencer-specific meta event, 7D 4A 57 03; others', and other events of these bytes, are none."""
    mark, others = b"\xff\x7f\x04\x7d\x4a\x57\x03", (b"\xff\x7f\x04\x7d\x4a\x57\x04", b"\xff\x01\x04\x7d\x4a\x57\x03")
    assert [parse(header() + track((0, each), (0, on(60)))).tracks[0].take for each in (mark, *others)] == [
        True,
        False,
        False,
    ]


def test_of_a_tempo_the_first_three_bytes_count() -> None:
    longer, shorter = b"\xff\x51\x04\x07\xa1\x20\x55", b"\xff\x51\x02\x07\xa1"
    (only,) = parse(header() + track((0, shorter), (5, longer), (5, tempo(250_000)))).tracks
    assert only.tempos == [(5, 500_000), (10, 250_000)]


def test_a_track_without_end_of_track_ends_with_its_bytes() -> None:
    assert messages(header() + track((3, on(61)), end=None)) == [(3, 0x90, 61, 64)]


def test_more_tracks_than_promised_are_left_out_and_said_so() -> None:
    file = parse(header(form=1, tracks=1) + track((0, on(60))) + track((0, on(62))))
    assert len(file.tracks) == 1
    assert "more follow" in file.warnings[0]


@pytest.mark.parametrize(
    ("data", "problem"),
    [
        (b"", "empty"),
        (b"RIFF\x00\x00\x00\x00WAVEfmt ", "RIFF file without MIDI"),
        (b"RIFF\x00\x00\x00\x00RMIDLIST\x01\x00\x00\x00x\x00", r"cut off before its MIDI data \(after 22 bytes\)"),
        (b"MThd\x00\x00\x00\x05\x00\x00\x00\x01\x01" + track(), "length 5, at least 6 is needed"),
        (b"\x00\x01garbage" * 50, "not a MIDI file"),
        (b"MT", "cut off"),
        (header()[:10], "cut off"),
        (header(), "cut off before track 1 of 1"),
        (header(form=3) + track(), "format 3"),
        (header(division=0) + track(), "0 ticks per quarter"),
        (header(division=(256 - 26) << 8 | 40) + track(), "26 frames per second"),
        (header(division=(256 - 25) << 8) + track(), "0 ticks per frame"),
        (header(form=1, tracks=2) + track(), "cut off before track 2 of 2"),
        (header() + track((0, b"\x40\x40")), "without a status"),
        (header() + track((0, b"\x90\x40\x80")), "above 127"),
        (header() + track((0, b"\x90\x80\x40")), "above 127"),
        (header() + track((0, b"\xc0\x80")), "above 127"),
        (header() + chunk(b"MTrk", b"\xff\xff\xff\xff\x01\x90\x40\x40"), "more than four bytes"),
        (header() + chunk(b"MTrk", b"\x00\x90\x40"), "runs over the track's end"),
        (header() + chunk(b"MTrk", b"\x00\xff\x01\x7fabc"), "runs over the track's end"),
        (header() + chunk(b"MTrk", b"\x00\xf0\x7fabc"), "runs over the track's end"),
        (header() + chunk(b"MTrk", b"\x00\xf2\x01"), "runs over the track's end"),
        (header() + b"\xff\xfe\x00\x00\x00\x00\x00\x00", "no chunk begins there"),
    ],
)
def test_what_is_refused_and_why(data: bytes, problem: str) -> None:
    with pytest.raises(MidiError, match=problem) as caught:
        parse(data)
    assert "\n" not in str(caught.value)
    assert ";" in str(caught.value), "a remedy follows the problem"


def test_messages_name_the_file(tmp_path) -> None:
    for name in ("missing.mid", "."):
        with pytest.raises(MidiError, match=str(tmp_path / name)):
            read_file(tmp_path / name)
    with pytest.raises(MidiError, match=r"cannot be read \(File name too long\); check its permissions"):
        read_file(tmp_path / ("x" * 300 + ".mid"))
    (tmp_path / "empty.mid").touch()
    with pytest.raises(MidiError, match=r"empty\.mid: the file is empty"):
        read_file(tmp_path / "empty.mid")


def whole_file() -> bytes:
    first = track((0, tempo(400_000)), (960, tempo(600_000)), end=480)
    second = track((0, b"\xc0\x21"), (0, on(40)), (480, bytes((40, 0))), (0, b"\xf0\x03\x7e\x7f\xf7"), end=480)
    return header(form=1, tracks=2) + first + second


def test_every_truncation_is_refused() -> None:
    data = whole_file()
    assert len(parse(data).tracks) == 2
    for length in range(len(data)):
        with pytest.raises(MidiError):
            parse(data[:length])


@given(st.data())
def test_any_damage_is_refused_or_read_but_never_crashes(draw: st.DataObject) -> None:
    data = bytearray(whole_file())
    places = st.integers(0, len(data) - 1)
    for at, byte in draw.draw(st.lists(st.tuples(places, st.integers(0, 255)), min_size=1, max_size=6)):
        data[at] = byte
    try:
        parse(bytes(data))
    except MidiError:
        pass


channel_messages = st.one_of(
    st.builds(
        lambda kind, channel, a, b: mido.Message.from_bytes([kind << 4 | channel, a, b]),
        st.sampled_from((0x8, 0x9, 0xA, 0xB, 0xE)),
        st.integers(0, 15),
        st.integers(0, 127),
        st.integers(0, 127),
    ),
    st.builds(
        lambda kind, channel, a: mido.Message.from_bytes([kind << 4 | channel, a]),
        st.sampled_from((0xC, 0xD)),
        st.integers(0, 15),
        st.integers(0, 127),
    ),
    st.builds(lambda us: mido.MetaMessage("set_tempo", tempo=us), st.integers(1, 0xFFFFFF)),
    st.builds(lambda data: mido.Message("sysex", data=data), st.lists(st.integers(0, 127), max_size=9)),
    st.builds(lambda text: mido.MetaMessage("text", text=text), st.text("abc", max_size=200)),
)


@given(st.lists(st.lists(st.tuples(st.integers(0, 0x0FFFFFFF), channel_messages), max_size=20), min_size=1, max_size=3))
def test_reads_what_mido_writes(tracks) -> None:
    song = mido.MidiFile(type=1)
    for content in tracks:
        song.tracks.append(mido.MidiTrack(message.copy(time=delta) for delta, message in content))
    buffer = io.BytesIO()
    song.save(file=buffer)
    read = parse(buffer.getvalue())
    assert read.ticks_per_quarter == song.ticks_per_beat
    assert len(read.tracks) == len(tracks)
    for ours, content in zip(read.tracks, tracks, strict=True):
        at = np.cumsum([delta for delta, _ in content])
        timed = list(zip(at, (message for _, message in content), strict=True))
        plain = [(tick, m.bytes()) for tick, m in timed if not m.is_meta and m.type != "sysex"]
        got = zip(ours.ticks, ours.status, ours.data1, ours.data2, strict=True)
        assert [(tick, data[:size]) for (tick, *data), size in zip(got, (len(b) for _, b in plain), strict=True)] == plain
        assert ours.tempos == [(tick, m.tempo) for tick, m in timed if m.type == "set_tempo"]
        assert ours.end_tick == (at[-1] if len(at) else 0)


def test_vlq_of_the_test_files_is_the_standards() -> None:
    # The examples of the specification.
    assert [vlq(n).hex() for n in (0x40, 0x80, 0x3FFF, 0x100000, 0xFFFFFFF)] == [
        "40",
        "8100",
        "ff7f",
        "c08000",
        "ffffff7f",
    ]
    assert off(60) == b"\x80\x3c\x40"
