"""Recording: the take renders to the samples that were recorded; files are kept whatever happens; memory does not grow."""

from __future__ import annotations

import re
import subprocess
import sys
import tracemalloc
from contextlib import suppress
from pathlib import Path

import mido
import numpy as np
import pytest
import soundfile

from synth.engine.engine import Engine
from synth.engine.layout import PLUCK_POSITION
from synth.host.audiofile import AudioWriter
from synth.host.parts import Choice, cast, cast_live
from synth.host.render import RenderSettings, render_file
from synth.instrument.preset import load_preset
from synth.instrument.ways import switch_keys
from synth.live.deck import Deck
from synth.live.recorder import Recorder
from synth.live.take import TakeFile, division_of
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
    make_events,
)
from synth.midi.smf import read_file
from synth.midi.song import read_song
from tests.patience import patience_s, until

from .deckkit import Card
from .tape import LATENCY, RATE_HZ, ToneDeck, controls

ROOT = Path(__file__).resolve().parents[2]

# What the engine must see in its order: at frame 30 000 a sounding key is struck and let go at once.
PLAYED = [
    (0, NOTE_ON, 0, 48, 100, 0.0),
    (7, NOTE_ON, 0, 55, 80, 0.0),
    (5000, CONTROL, 0, 7, 90, 0.0),
    (9001, BEND, 0, -3000, 0, 0.0),
    (12345, PARAMETER, 0, PLUCK_POSITION, 0, 0.123456789),
    (15000, PRESSURE, 0, 0, 64, 0.0),
    (15000, TUNING, 0, 48, 1, 48.123456789),
    (15001, KEY_PRESSURE, 0, 48, 30, 0.0),
    (20000, NOTE_ON, 0, 48, 90, 0.0),
    (25000, BEND, 0, 0, 0, 0.0),
    (30000, NOTE_ON, 0, 48, 60, 0.0),
    (30000, NOTE_OFF, 0, 48, 64, 0.0),
    (33333, NOTE_ON, 0, 36, 127, 0.0),
    (43900, NOTE_ON, 0, 55, 127, 0.0),
]


def test_a_take_renders_to_the_samples_that_were_recorded(tmp_path: Path) -> None:
    engine = Engine([load_preset("tanpura-light")])
    engine.prepare(RATE_HZ, 4096)
    deck = Deck(engine, record=True)
    card = Card(deck)
    events = make_events(PLAYED)
    wav, mid = tmp_path / "take.wav", tmp_path / "take.mid"
    with Recorder(deck, wav, mid, RATE_HZ, "16") as recorder:
        assert deck.schedule(events) == len(events)
        for frames in [256, 1, 1000, 64] * 33 + [407]:
            card.ask(frames)
    total = 33 * 1321 + 407
    assert recorder.frames == total - engine.latency_samples and recorder.events == len(events)

    song = read_song(mid, RATE_HZ)
    assert not song.warnings
    # The take ends by letting go, at the frame behind the last one.
    assert np.array_equal(song.events[: len(events)], events)
    assert set(song.events["frame"][len(events) :]) == {total}

    again = tmp_path / "again.wav"
    render_file(RenderSettings(str(mid), str(again), preset="tanpura-light", tail=0.0, bit_depth="16"))
    recorded, _ = soundfile.read(wav, dtype="int16")
    rendered, _ = soundfile.read(again, dtype="int16")
    assert len(rendered) == total
    assert np.abs(recorded.astype(int)).max() > 1000
    assert np.array_equal(recorded, rendered[: len(recorded)])


def test_a_take_made_beside_a_song_renders_to_the_samples_that_were_recorded(tmp_path: Path) -> None:
    """A key switches nothing of what a program chose: neither live nor in the take."""
    program, mute, note = 29, 26, 45
    choice = Choice()
    casting = cast_live(choice, song=cast({(0, program): 2}, choice))
    part = casting.parts[0]
    preset = load_preset(part.preset)
    assert switch_keys(preset)[mute] == "palm-mute" and not switch_keys(part.played(preset))
    program_map = np.full((16, 128), -1, np.int64)
    program_map[0, program] = 0
    engine = Engine([part.played(preset)], program_map, only_notes=[{mute, note}])
    engine.prepare(RATE_HZ, 4096)
    deck = Deck(engine, record=True)
    card = Card(deck)
    rows = [(0, PROGRAM, 0, program, 0, 0.0), (64, NOTE_ON, 0, note, 90, 0.0), (6000, NOTE_ON, 0, mute, 90, 0.0)]
    events = make_events([*rows, (6400, NOTE_OFF, 0, mute, 64, 0.0), (9000, NOTE_ON, 0, note, 100, 0.0)])
    wav, mid, again = (tmp_path / name for name in ("take.wav", "take.mid", "again.wav"))
    with Recorder(deck, wav, mid, RATE_HZ, "16", gm=True, switching=part.switching):
        assert deck.schedule(events) == len(events)
        for _ in range(20):
            card.ask(1000)
    render_file(RenderSettings(str(mid), str(again), tail=0.0, bit_depth="16"))
    recorded, rendered = (soundfile.read(path, dtype="int16")[0] for path in (wav, again))
    assert np.abs(recorded[9500:].astype(int)).max() > 1000
    assert np.array_equal(recorded, rendered[: len(recorded)])


def test_what_was_recorded_is_kept_when_the_session_fails(tmp_path: Path) -> None:
    deck = ToneDeck()
    wav, mid = tmp_path / "take.flac", tmp_path / "take.mid"
    with pytest.raises(RuntimeError, match="broken"), Recorder(deck, wav, mid, RATE_HZ):
        deck.play(5000, make_events([(10, NOTE_ON, 3, 60, 1), (4999, CONTROL, 3, 1, 2)]))
        raise RuntimeError("broken")
    samples, rate_hz = soundfile.read(wav)
    assert rate_hz == RATE_HZ and np.array_equal(samples, ToneDeck.sound(LATENCY, 5000))
    rows = read_song(mid, RATE_HZ).events[["frame", "kind", "a"]].tolist()
    assert rows == [(10, NOTE_ON, 60), (4999, CONTROL, 1), (5000, NOTE_OFF, 60), (5000, CONTROL, 123)]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["take.flac", "take.mid"]


def test_a_take_holds_every_kind_of_event_bit_for_bit(tmp_path: Path) -> None:
    rows = [
        (0, PROGRAM, 4, 17, 0, 0.0),
        (0, TUNING, 0, 60, 1, 60.123456789),
        (0, TUNING, 0, 61, 0, 61.5),
        (3, PARAMETER, 3, 2, 0, -1e-300),
        (2**28 + 5, BEND, 15, 8191, 0, 0.0),
        (2**30, BEND, 15, -8192, 0, 0.0),
        (2**30, NOTE_ON, 15, 127, 1, 0.0),
        (2**30 + 1, NOTE_OFF, 15, 127, 0, 0.0),
    ]
    take = TakeFile(tmp_path / "take.mid", 96000)
    take.open()
    for start in range(0, len(rows), 3):
        take.append(make_events(rows[start : start + 3]))
    take.append(make_events([(2**30 + 2, 99, 0, 1), (2**30 + 2, CONTROL, 0, 1, 128)]))
    take.close(2**30 + 10)
    assert (take.events, take.left_out) == (len(rows), 2)
    song = read_song(tmp_path / "take.mid", 96000)
    assert np.array_equal(song.events[: len(rows)], make_events(rows))
    assert song.events["frame"][-1] == 2**30 + 10
    # Another reader finds the same file: frames are ticks, a second is a second.
    other = mido.MidiFile(tmp_path / "take.mid")
    assert other.type == 0 and len(other.tracks) == 1
    tick = np.cumsum([message.time for message in other.tracks[0]])
    assert tick[-1] == 2**30 + 10
    assert sum(message.type == "sysex" for message in other.tracks[0]) == 3
    assert other.length == pytest.approx((2**30 + 10) / 96000, rel=1e-9)


@pytest.mark.parametrize("rate_hz", [44100, 48000, 88200, 96000, 22050, 192000])
def test_one_tick_is_one_frame(rate_hz: int) -> None:
    per_quarter, tempo_us = division_of(rate_hz)
    assert per_quarter < 1 << 15 and per_quarter * 1_000_000 == tempo_us * rate_hz


def test_a_rate_without_ticks_is_refused() -> None:
    with pytest.raises(ValueError, match="44101 Hz"):
        division_of(44101)


def test_a_flood_of_events_is_kept_and_does_not_grow_memory(tmp_path: Path) -> None:
    take = TakeFile(tmp_path / "take.mid", RATE_HZ)
    take.open()
    chunk = 10_000
    take.append(controls(0, chunk, 1))
    tracemalloc.start()
    try:
        for start in range(chunk, 20 * chunk, chunk):
            take.append(controls(start, start + chunk, 1))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    for start in range(20 * chunk, 50 * chunk, chunk):
        take.append(controls(start, start + chunk, 1))
    take.close(50 * chunk)
    # A chunk as rows of Python's numbers takes 1.5 MB or more; twenty of them would take 30.
    assert peak < 20_000_000
    track = read_file(tmp_path / "take.mid").tracks[0]
    assert track.ticks == [*range(50 * chunk), 50 * chunk]


def test_a_recording_of_events_alone_needs_no_sound_file(tmp_path: Path) -> None:
    deck = ToneDeck()
    with Recorder(deck, None, tmp_path / "take.mid", RATE_HZ):
        deck.play(100, make_events([(99, NOTE_ON, 0, 60, 1)]))
    assert [path.name for path in tmp_path.iterdir()] == ["take.mid"]
    assert read_song(tmp_path / "take.mid", RATE_HZ).length_s == pytest.approx(100 / RATE_HZ)


def test_events_behind_the_last_recorded_frame_are_left_out(tmp_path: Path) -> None:
    """A deck that is not stopped goes on while the recording ends."""
    deck = ToneDeck()
    with Recorder(deck, tmp_path / "take.wav", tmp_path / "take.mid", RATE_HZ) as recorder:
        deck.play(1000, controls(0, 1100, 100))
    assert recorder.frames == 1000 - LATENCY
    assert read_song(tmp_path / "take.mid", RATE_HZ).events["frame"].max() == 1000


def test_events_that_are_missing_are_said(tmp_path: Path) -> None:
    deck = ToneDeck()
    said: list[str] = []
    with Recorder(deck, tmp_path / "take.wav", None, RATE_HZ, say=said.append):
        deck.play(1000)
        deck.recording_lost = 7
    assert len(said) == 1 and said[0].endswith("take.wav: the disk was too slow and lost 7 events")


def test_where_nothing_was_played_an_earlier_take_stays(tmp_path: Path) -> None:
    wav, mid = tmp_path / "take.wav", tmp_path / "take.mid"
    wav.write_bytes(b"sound of yesterday")
    mid.write_bytes(b"take of yesterday")
    with pytest.raises(RuntimeError, match="refused"), Recorder(ToneDeck(), wav, mid, RATE_HZ) as recorder:
        raise RuntimeError("the device refused")
    assert recorder.kept == []
    assert (wav.read_bytes(), mid.read_bytes()) == (b"sound of yesterday", b"take of yesterday")
    assert len(list(tmp_path.iterdir())) == 2


def test_sound_that_is_lost_is_silence_and_what_follows_stands_in_its_place(tmp_path: Path, monkeypatch) -> None:
    # A disk that stands still: what is drained is drained when the test says so.
    monkeypatch.setattr("synth.live.recorder.DRAIN_EVERY_S", 1e6)
    deck, said = ToneDeck(tape_frames=40_000), []
    with Recorder(deck, tmp_path / "take.wav", tmp_path / "take.mid", RATE_HZ, say=said.append) as recorder:
        deck.play(10_000)
        recorder._drain_audio()
        deck.play(30_000)
        deck.play(45_000)  # 35 000 of them are lost
        recorder._drain_audio()
        deck.play(7_000, make_events([(90_000, NOTE_ON, 0, 60, 1)]))
        deck.play(50_000)  # 17 000, at the end
    sound = ToneDeck.sound(0, 142_000)
    sound[50_000:85_000] = 0.0
    sound[125_000:] = 0.0
    recorded, _ = soundfile.read(tmp_path / "take.wav")
    assert np.array_equal(recorded, sound[LATENCY:])
    assert read_song(tmp_path / "take.mid", RATE_HZ).events["frame"].tolist() == [90_000, 142_000, 142_000]
    assert len(said) == 1 and "lost 52000 frames of sound (silence in the file)" in said[0]


def test_a_deck_whose_sound_is_not_taken_in_time(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("synth.live.recorder.DRAIN_EVERY_S", 1e6)
    engine = Engine([load_preset("tanpura-light")], quality="draft", only_notes=[{48}])
    engine.prepare(RATE_HZ, 4096)
    deck = Deck(engine, record=True)
    card = Card(deck)
    behind = deck.tape_frames + 20_000
    again = behind + 30_000
    events = make_events([(0, NOTE_ON, 0, 48, 100), (9000, CONTROL, 0, 120, 0), (again, NOTE_ON, 0, 48, 90)])
    with Recorder(deck, tmp_path / "take.wav", tmp_path / "take.mid", RATE_HZ, "16") as recorder:
        assert deck.schedule(events) == len(events)
        while deck.frame < behind:
            card.ask(min(4096, behind - deck.frame))
        assert deck.tape_lost == 20_000
        recorder._drain_audio()
        while deck.frame < again + 20_000:
            card.ask(256)
        total = deck.frame
    recorded, _ = soundfile.read(tmp_path / "take.wav", dtype="int16")
    assert len(recorded) == total - engine.latency_samples
    sounding = np.flatnonzero(np.abs(recorded).max(axis=1) > 50)
    second = sounding[sounding > 100_000]
    # The take says when; the string answers while the finger draws it.
    assert len(sounding) > len(second) > 0 and again <= second[0] < again + 2000


def _recording(tmp_path: Path, **more) -> subprocess.Popen:
    command = [sys.executable, "-m", "tests.live.tape", str(tmp_path / "take.wav"), str(tmp_path / "take.mid")]
    return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, **more)


def _has_a_second(mid: Path, wav: Path) -> bool:
    """Whether what was played of the first second lies in the files of a recording that goes on."""
    with suppress(RuntimeError, ValueError):  # read while it is written
        return len(soundfile.read(wav)[0]) >= RATE_HZ - LATENCY and len(read_song(mid, RATE_HZ).events) >= 900
    return False


def test_a_killed_session_leaves_files_that_can_be_read(tmp_path: Path) -> None:
    process = _recording(tmp_path)
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "going\n"
        parts = until(lambda: len(found := sorted(tmp_path.glob(".take.*.part"))) == 2 and found)
        until(lambda: _has_a_second(*parts))  # it drains ten times a second
    finally:
        process.kill()
        process.communicate()
    mid, wav = parts
    samples, _ = soundfile.read(wav)
    assert len(samples) >= RATE_HZ - LATENCY
    assert np.array_equal(samples, ToneDeck.sound(LATENCY, LATENCY + len(samples)))
    events = read_song(mid, RATE_HZ).events
    assert len(events) >= 900 and np.array_equal(events, controls(0, events["frame"][-1] + 1, 49))


@pytest.mark.skipif(sys.platform == "win32", reason="no limits of file size")
def test_a_full_disk_ends_the_recording_and_nothing_else(tmp_path: Path) -> None:
    import resource

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, resource.RLIM_INFINITY))

    process = _recording(tmp_path, preexec_fn=limit)
    assert process.stdout is not None
    try:
        said = [process.stdout.readline() for _ in range(2)]
    finally:
        alive = process.poll() is None
        process.kill()
        process.communicate()
    assert alive
    assert any(re.match(r".*take\.wav: recording stopped, playing continues", line) for line in said), said
    assert "going\n" in said
    samples, _ = soundfile.read(tmp_path / "take.wav")
    assert 16_000 < len(samples) < 17_000
    assert np.array_equal(samples, ToneDeck.sound(LATENCY, LATENCY + len(samples)))


@pytest.mark.skipif(sys.platform == "win32", reason="no limits of file size")
@pytest.mark.parametrize("size", [20, 60])
def test_a_recording_that_cannot_begin_spares_what_was_there(tmp_path: Path, size: int) -> None:
    """There is room for half a head of the take, or of the sound."""
    import resource

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))

    before = {"take.wav": b"from before", "take.mid": b"from before"}
    for name, content in before.items():
        (tmp_path / name).write_bytes(content)
    with _recording(tmp_path, preexec_fn=limit, stderr=subprocess.PIPE) as process:
        said, why = process.communicate(timeout=patience_s())
    assert process.returncode == 1 and said == ""
    assert re.search(r"File too large; .*: '.*take\.(mid|wav)'$", why), why
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.skipif(sys.platform == "win32", reason="no limits of file size")
def test_sound_of_which_nothing_can_be_written_spares_what_was_there(tmp_path: Path) -> None:
    """The take, which there is room for, is kept."""
    program = """
import resource, sys
from synth.live.recorder import Recorder
from tests.live.tape import RATE_HZ, ToneDeck, controls
deck = ToneDeck()
with Recorder(deck, sys.argv[1] + "/take.wav", sys.argv[1] + "/take.mid", RATE_HZ, say=print) as recorder:
    resource.setrlimit(resource.RLIMIT_FSIZE, (60, resource.RLIM_INFINITY))
    deck.play(8000, controls(0, 0, 49))
print(recorder.kept)
"""
    (tmp_path / "take.wav").write_bytes(b"from before")
    done = subprocess.run(
        [sys.executable, "-c", program, str(tmp_path)], cwd=ROOT, capture_output=True, text=True, timeout=patience_s()
    )
    assert (tmp_path / "take.wav").read_bytes() == b"from before"
    assert {path.name for path in tmp_path.iterdir()} == {"take.wav", "take.mid"}
    lines = done.stdout.splitlines()
    assert "take.wav: recording stopped, playing continues (File too large" in lines[0] and "take.wav" not in lines[-1], done


def test_a_take_whose_disk_is_full_ends_at_an_event(tmp_path: Path) -> None:
    program = """
import resource, sys
from synth.live.take import TakeFile
from tests.live.tape import controls
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, resource.RLIM_INFINITY))
take = TakeFile(sys.argv[1], 44100)
take.open()
for start in range(0, 100_000, 1000):
    try:
        take.append(controls(start, start + 1000, 1))
    except OSError:
        print(take.events)
        break
take.close(start)
"""
    pytest.importorskip("resource")
    mid = tmp_path / "take.mid"
    done = subprocess.run([sys.executable, "-c", program, str(mid)], cwd=ROOT, capture_output=True, text=True)
    events = read_song(mid, RATE_HZ).events
    kept = int(done.stdout)
    assert kept >= 10_000
    # all notes off is the end of every take
    assert np.array_equal(events[:-1], controls(0, kept, 1)) and events[-1]["a"] == 123


@pytest.mark.parametrize(
    ("wav", "mid", "error"),
    [
        ("missing/take.wav", None, FileNotFoundError),
        ("take.wav", "missing/take.mid", FileNotFoundError),
        ("take.aiff", None, ValueError),
        ("-", None, ValueError),
        ("/dev/null", None, ValueError),
        ("take.wav", "take.wav", ValueError),
    ],
)
def test_files_that_cannot_be_written_are_refused_at_once(tmp_path, monkeypatch, wav, mid, error) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error):
        Recorder(ToneDeck(), wav, mid, RATE_HZ)
    assert not list(tmp_path.iterdir())


def test_a_growing_file_is_a_wav_file_at_any_time(tmp_path: Path) -> None:
    with AudioWriter(tmp_path / "out.wav", RATE_HZ, growing=True) as writer:
        for k in range(3):
            writer.write(ToneDeck.sound(1000 * k, 1000 * k + 1000))
            (partial,) = tmp_path.glob(".out.wav.*")
            samples, _ = soundfile.read(partial)
            assert np.array_equal(samples, ToneDeck.sound(0, 1000 * k + 1000))
    assert soundfile.info(tmp_path / "out.wav").format in ("WAV", "WAVEX")
