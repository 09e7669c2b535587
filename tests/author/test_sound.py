"""What the page hears is, bit for bit, the engine's own render of the same events."""

from __future__ import annotations

import io
import json
import os
import queue
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

from synth import Engine, load_preset
from synth.author import voice
from synth.author.document import Document
from synth.author.phrases import NAMES, phrase
from synth.author.sound import PagePlayer
from synth.author.voice import BLOCK, Voice, phrase_preset, prepared_engine
from synth.instrument.preset import Preset, parse_preset, playable_notes, preset_folder
from synth.midi.events import NOTE_OFF, NOTE_ON, make_events
from tests.patience import patience_s

from .serverkit import ROOT, Doc, Page, Server

RATE_HZ = 44100


def offline(preset: Preset, events: np.ndarray, frames: int) -> np.ndarray:
    """(frames, 2) float32 of an engine with all notes, driven in blocks of another size, without its latency."""
    engine = Engine([preset])
    engine.prepare(RATE_HZ, 4096)
    skip = engine.latency_samples
    heard = []
    for begin in range(0, frames + skip, 1000):
        out = np.zeros((1000, 2))
        due = events[(events["frame"] >= begin) & (events["frame"] < begin + 1000)].copy()
        due["frame"] -= begin
        engine.process(due, out)
        heard.append(out)
    return np.concatenate(heard)[skip : skip + frames].astype(np.float32)


def listen(page: Page, frames: int) -> np.ndarray:
    """(frames, 2) from the beginning of the next stream."""
    stream = page.until("audio")
    assert stream["rate_hz"] == RATE_HZ and stream["frame"] == 0
    heard = np.zeros((0, 2), np.float32)
    while len(heard) < frames:
        message = page.receive()
        if isinstance(message, bytes):
            number, frame = np.frombuffer(message[:8], "<u4")
            if number == stream["stream"]:
                assert frame == len(heard)
                heard = np.concatenate((heard, np.frombuffer(message[8:], "<f4").reshape(-1, 2)))
        else:
            assert message["type"] in ("state", "load", "kernels"), message
    return heard[:frames]


def wav(doc: Doc, **query: object) -> np.ndarray:
    answer = doc.server.client.get(f"{doc.path}/sound.wav", params=query)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "audio/wav"
    samples, rate_hz = soundfile.read(io.BytesIO(answer.content), dtype="float32")
    assert rate_hz == RATE_HZ
    return samples


@pytest.mark.parametrize(
    ("name", "kind", "note"),
    [
        ("tanpura-light", "note", 48),
        ("tanpura-light", "drone", 36),
        ("fretted-bass", "note", 45),
        ("fretted-bass", "riff", 33),
        ("jawari-harp", "note", 96),
        ("jawari-harp", "scale", 60),
    ],
)
def test_a_phrase_is_the_engines_own_render(server: Server, name: str, kind: str, note: int) -> None:
    doc = server.open(name)
    doc.set("pluck.position", 0.23)
    preset = load_preset(name).with_setting("pluck.position", "0.23")
    expected = offline(preset, phrase(kind, preset, note, 90, RATE_HZ).events, 60000)
    assert np.abs(expected).max() > 0.05
    with doc.connect() as page:
        page.send("audition", phrase=kind, note=note, velocity=90, which="current")
        assert np.array_equal(listen(page, 60000), expected)
        page.send("stop")
        page.until("stopped")
    assert np.array_equal(wav(doc, phrase=kind, note=note, velocity=90, seconds=60000 / RATE_HZ), expected)
    doc.do("revert")


def test_the_file_is_what_synth_render_writes(server: Server, tmp_path: Path) -> None:
    """A single note as MIDI: the same samples up to where the renderer ends its tail."""
    mido = pytest.importorskip("mido")
    ticks = 22050  # a tick is a frame, at the default tempo of two quarter notes a second
    midi = mido.MidiFile(ticks_per_beat=ticks)
    midi.tracks.append(track := mido.MidiTrack())
    track.append(mido.Message("note_on", note=48, velocity=90, time=0))
    track.append(mido.Message("note_off", note=48, velocity=64, time=2 * RATE_HZ))
    midi.save(tmp_path / "note.mid")
    command = [
        "render",
        "note.mid",
        "-p",
        "tanpura-light",
        "-o",
        "note.wav",
        "--bit-depth",
        "float",
        "--tail",
        "1",
        "--quiet",
    ]
    subprocess.run(
        [sys.executable, "-m", "synth", *command], cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, check=True
    )
    rendered, _ = soundfile.read(tmp_path / "note.wav", dtype="float32")
    frames = round(2.9 * RATE_HZ)
    assert np.array_equal(
        wav(server.open("tanpura-light"), phrase="note", note=48, velocity=90, seconds=2.9), rendered[:frames]
    )


def test_saved_and_current(server: Server) -> None:
    doc = server.open("tanpura-light")
    before = wav(doc, phrase="note", note=48, velocity=90, seconds=0.2)
    doc.set("obstacle.jiva_um", 40)
    assert np.array_equal(wav(doc, phrase="note", note=48, velocity=90, which="saved", seconds=0.2), before)
    after = wav(doc, phrase="note", note=48, velocity=90, which="current", seconds=0.2)
    assert not np.array_equal(after, before)
    with doc.connect() as page:
        for which, expected in (("saved", before), ("current", after)):
            page.send("audition", phrase="note", note=48, velocity=90, which=which)
            assert np.array_equal(listen(page, len(expected)), expected)
    doc.do("revert")


def test_keys_of_the_saved_version(server: Server) -> None:
    doc = server.open("tanpura-light")
    doc.set("pluck.position", 0.31)
    note = make_events([(0, NOTE_ON, 0, 48, 100)])
    saved = load_preset("tanpura-light")
    versions = {
        which: offline(preset, note, 2048)
        for which, preset in (("saved", saved), ("current", saved.with_setting("pluck.position", "0.31")))
    }
    assert not np.array_equal(versions["saved"], versions["current"])
    with doc.connect() as page:
        for which, expected in versions.items():
            page.send("note_on", key=48, velocity=100, which=which)
            assert np.array_equal(listen(page, 2048), expected)
            page.send("stop")
            page.until("stopped")
    doc.do("revert")


SWITCHED = """
format = 2
name = "switched"
[[string]]
notes = "C3"
length_m = 0.9
diameter_mm = 0.4
density_kg_m3 = 7850
youngs_modulus_gpa = 200
viscoelastic_loss = 4.5e-3
[pluck]
displacement_mm = 2.0
[articulations.normal]
key = "C0"
[articulations.mute]
key = "D0"
touch = { place = 0.05, resistance = 2.0 }
"""


def test_keys_that_switch_articulations(server: Server) -> None:
    doc = server.open("tanpura-light")
    doc.do("text", text=SWITCHED)
    assert doc.state["switches"] == [{"key": 12, "name": "normal"}, {"key": 14, "name": "mute"}]
    preset, note = parse_preset(SWITCHED, "switched"), (0, NOTE_ON, 0, 48, 100)
    muted = offline(preset, make_events([(0, NOTE_ON, 0, 14, 64), note]), 4096)
    assert not np.array_equal(muted, offline(preset, make_events([note]), 4096))
    with doc.connect() as page:
        page.send("note_on", key=14, velocity=100)
        page.send("note_off", key=14)
        page.send("note_on", key=48, velocity=100)
        assert np.array_equal(listen(page, 4096), muted)
        page.send("stop")
        page.until("stopped")
    doc.do("revert")


def test_streams_have_numbers_of_their_own(server: Server) -> None:
    """Whatever connection they come by: what a page knows of one says nothing of another."""
    doc = server.open("tanpura-light")
    numbers = []
    for _ in range(2):
        with doc.connect() as page:
            page.send("note_on", key=48, velocity=100)
            numbers.append(page.until("audio")["stream"])
            page.send("stop")
            page.until("stopped")
    assert numbers[1] > numbers[0]


class Listener:
    """A player of a preset of the program, in this process; `sent` is what it sends."""

    def __init__(self, folder: Path) -> None:
        self.sent: queue.SimpleQueue[dict[str, Any] | bytes] = queue.SimpleQueue()
        text = (preset_folder() / "jawari-harp.toml").read_text(encoding="utf-8")
        document = Document("jawari-harp", text, folder / "autosave", embedded=True)
        self.player = PagePlayer(document, self.sent.put, rate_hz=RATE_HZ, quality="draft")

    def next(self, kind: str) -> Any:
        """The next message of a type; of blocks of sound: the next that is not silence."""
        while True:
            message = self.sent.get(timeout=patience_s())
            if isinstance(message, dict):
                if message["type"] == kind:
                    return message
            elif kind == "sound" and np.frombuffer(message[8:], "<f4").any():
                return np.frombuffer(message[8:], "<f4").reshape(-1, 2)


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[Listener]:
    made = Listener(tmp_path)
    yield made
    made.player.close()


def test_what_nobody_foresaw_does_not_silence_it_for_ever(
    listener: Listener, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(Voice, "next", lambda _: 1 / 0)
        listener.player.ask({"type": "note_on", "key": 60, "velocity": 100})
        assert "the sound has failed (ZeroDivisionError)" in listener.next("error")["message"]
        listener.next("stopped")
    assert "ZeroDivisionError" in caplog.text
    listener.player.ask({"type": "note_on", "key": 60, "velocity": 100})
    assert len(listener.next("sound")) == BLOCK


def test_playing_goes_on_while_there_are_events(listener: Listener, monkeypatch: pytest.MonkeyPatch) -> None:
    """What sounds on without any fades; nothing is cut off."""
    longest_s = 0.5
    monkeypatch.setattr(voice, "LONGEST_S", longest_s)
    player = listener.player
    player.ask({"type": "note_on", "key": 60, "velocity": 100})
    stream, heard = listener.next("audio")["stream"], []
    for _ in range(round(4 * longest_s * RATE_HZ / BLOCK)):
        player.ask({"type": "bend", "value": 0})
        heard.append(listener.next("sound"))
    end = listener.next("stopped")
    assert end["stream"] == stream and end["frame"] > (len(heard) + 0.9 * longest_s * RATE_HZ / BLOCK) * BLOCK


def test_what_sounds_too_long_fades(listener: Listener, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(voice, "LONGEST_S", 0.2)
    listener.player.ask({"type": "note_on", "key": 60, "velocity": 100})
    listener.next("audio")
    blocks = []
    while not isinstance(message := listener.sent.get(timeout=patience_s()), dict) or message["type"] != "stopped":
        if isinstance(message, bytes):
            blocks.append(np.frombuffer(message[8:], "<f4").reshape(-1, 2))
    assert np.abs(blocks[-2]).max() > 0.01
    assert np.abs(blocks[-1][:64]).max() > 0.001 and np.abs(blocks[-1][-1]).max() == 0.0


def test_a_phrase_again_begins_from_silence(server: Server) -> None:
    doc = server.open("tanpura-light")
    expected = wav(doc, phrase="note", note=48, velocity=100, seconds=0.3)
    with doc.connect() as page:
        for _ in range(3):
            page.send("audition", phrase="note", note=48, velocity=100)
            assert np.array_equal(listen(page, len(expected)), expected)


def test_keys(server: Server) -> None:
    """A key sounds as the engine renders it; what is played while it rings joins it."""
    doc = server.open("jawari-harp")
    preset = load_preset("jawari-harp")
    alone = offline(preset, make_events([(0, NOTE_ON, 0, 60, 100)]), 2048)
    with doc.connect() as page:
        page.send("note_on", key=60, velocity=100)
        assert np.array_equal(listen(page, 2048), alone)
        page.send("note_on", key=67, velocity=100)
        page.send("pedal", down=True)
        page.send("bend", value=100)
        page.send("control", controller=11, value=100)
        page.send("note_off", key=60)
        page.send("note_off", key=67)
        page.send("pedal", down=False)
        loudest = 0.0
        while isinstance(message := page.receive(), bytes) or message["type"] != "stopped":
            if isinstance(message, bytes):
                loudest = max(loudest, float(np.abs(np.frombuffer(message[8:], "<f4")).max()))
    assert loudest > np.abs(alone).max()


def test_a_new_string_while_the_old_one_rings(server: Server) -> None:
    """A change does not cut what sounds, and what is struck after it sounds like it."""
    doc = server.open("jawari-harp")
    with doc.connect() as page:
        page.send("note_on", key=60, velocity=100)
        listen(page, 2048)
        doc.set("pluck.position", 0.11)
        page.send("note_on", key=64, velocity=100)
        page.send("note_off", key=60)
        page.send("note_off", key=64)
        page.until("stopped")
        page.send("note_on", key=64, velocity=100)
        changed = load_preset("jawari-harp").with_setting("pluck.position", "0.11")
        assert np.array_equal(listen(page, 2048), offline(changed, make_events([(0, NOTE_ON, 0, 64, 100)]), 2048))
    doc.do("revert")


def test_only_the_last_that_played_sounds(server: Server) -> None:
    doc = server.open("tanpura-light")
    with doc.connect() as one, doc.connect() as two:
        one.send("audition", phrase="note", note=48, velocity=100)
        listen(one, 4096)
        two.send("audition", phrase="note", note=43, velocity=100)
        listen(two, 4096)
        assert one.until("stopped")


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"type": "audition", "phrase": "song", "note": 48, "velocity": 90}, "phrase: must be one of"),
        ({"type": "audition", "phrase": "note", "note": 49, "velocity": 90}, "no string of tanpura-light plays C#3"),
        ({"type": "audition", "phrase": "note", "note": 200, "velocity": 90}, "note: must be a whole number from 0 to 127"),
        ({"type": "audition", "phrase": "note", "note": 48, "velocity": 0}, "velocity: must be a whole number from 1"),
        ({"type": "audition", "phrase": "note", "note": 48, "velocity": 9, "which": "other"}, "current or saved"),
        ({"type": "note_on", "key": 48}, "velocity: "),
        ({"type": "note_on", "key": None, "velocity": 3}, "key: "),
        ({"type": "note_on", "key": True, "velocity": 3}, "key: "),
        ({"type": "note_on", "key": 48, "velocity": 3, "which": "other"}, "current or saved"),
        ({"type": "note_on", "key": float("inf"), "velocity": 3}, "key: must be a whole number from 0 to 127, got inf"),
        ({"type": "note_on", "key": float("nan"), "velocity": 3}, "key: must be a whole number from 0 to 127, got nan"),
        ({"type": "note_on", "key": 10**400, "velocity": 3}, "key: must be a whole number from 0 to 127, got 1000"),
        ({"type": "bend", "value": 9000}, "value: must be a whole number from -8192 to 8191"),
        ({"type": "output", "id": "radio"}, "id: must be browser or server"),
        ({"type": "dance"}, "there is no message 'dance'"),
        ([1], "must be a JSON object"),
    ],
)
def test_messages_that_make_no_sense(server: Server, fields: object, words: str) -> None:
    with server.open("tanpura-light").connect() as page:
        page.socket.send(json.dumps(fields))
        assert words in page.until("error")["message"]
        page.socket.send("{")
        assert "JSON" in page.until("error")["message"]


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("note=48", "velocity: missing"),
        ("note=x&velocity=90", "note: must be a whole number from 0 to 127, got 'x'"),
        ("note=49&velocity=90", "no string"),
        ("note=48&velocity=90&seconds=61", "seconds: must be a number from 0 to 60"),
        ("note=48&velocity=90&seconds=nan", "seconds: "),
        ("note=48&velocity=90&phrase=x", "phrase: "),
        ("note=48&velocity=90&which=x", "which: "),
    ],
)
def test_files_that_cannot_be_made(server: Server, query: str, words: str) -> None:
    doc = server.open("tanpura-light")
    assert words in server.get(f"{doc.path}/sound.wav?{query}", 400)["error"]


@pytest.mark.parametrize("name", ["tanpura-light", "fretted-bass", "jawari-harp"])
@pytest.mark.parametrize("kind", NAMES)
def test_phrases_can_be_played_everywhere(name: str, kind: str) -> None:
    preset = load_preset(name)
    there = playable_notes(preset)
    for note in there:
        made = phrase(kind, preset, note, 100, RATE_HZ)
        assert made.notes <= set(there)
        begins = made.events[made.events["kind"] == NOTE_ON]
        assert len(begins) == np.count_nonzero(made.events["kind"] == NOTE_OFF) > 0
        assert begins["frame"][0] == 0 and (np.diff(made.events["frame"]) >= 0).all()
        assert made.length_s > made.events["frame"][-1] / RATE_HZ
        assert np.array_equal(made.events, phrase(kind, preset, note, 100, RATE_HZ).events)


def test_a_voice_ends_when_it_is_silent() -> None:
    preset = load_preset("jawari-harp")
    one = Voice(prepared_engine(preset, {60}, RATE_HZ, "draft"), phrase("note", preset, 60, 100, RATE_HZ))
    blocks = []
    while not one.ended:
        blocks.append(one.next().copy())
    heard = np.concatenate(blocks)
    assert 2.0 < len(heard) / RATE_HZ < 20.0
    assert np.abs(heard[-BLOCK:]).max() < 1e-5


@pytest.mark.parametrize("name", ["tanpura-light", "fretted-bass", "jawari-harp"])
def test_a_single_note_needs_one_string(name: str) -> None:
    """Wherever a preset plays a note, one string alone sounds as it does among all of them."""
    preset = load_preset(name)
    whole = prepared_engine(preset, None, RATE_HZ, "draft")
    for note in playable_notes(preset)[::5]:
        wanted = phrase("note", preset, note, 100, RATE_HZ)
        alone = prepared_engine(phrase_preset(preset, wanted), wanted.notes, RATE_HZ, "draft")
        assert [len(string.positions) for string in alone.compiled[0].strings] == [1]
        heard = [
            np.concatenate([voice.next().copy() for _ in range(20)])
            for voice in (Voice(whole, wanted), Voice(alone, wanted))
        ]
        assert np.array_equal(*heard) and np.abs(heard[0]).max() > 0.02
