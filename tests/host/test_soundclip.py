"""A rendered sound: an array, a file, a picture, what a notebook shows; and phrases of notes."""

from __future__ import annotations

import base64
import io
import json
import pickle
import sys
import types
import warnings
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import mido
import numpy as np
import pytest
import soundfile

import synth
from synth import Note, Sound
from synth.files import notebook_html
from synth.host import notelist, soundclip
from synth.host.notelist import phrase_of
from synth.host.render import RenderReport, RenderSettings, render_file
from synth.host.sound_pictures import COLUMNS, STRETCHES, envelope, spectrogram
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON

RATE_HZ = 8000


def report(**more: object) -> RenderReport:
    """Of a sound that nobody rendered."""
    values: dict = {name: None for name in RenderReport.__dataclass_fields__}
    values |= {
        "notes": 1,
        "strings": 2,
        "seed": 0,
        "warnings": [],
        "prepare_s": 0.5,
        "render_s": 0.25,
        "realtime_factor": 8.0,
    }
    return RenderReport(**values | more)


def tone(seconds: float = 0.5, level: float = 0.5, **more: object) -> Sound:
    """440 Hz left, a tenth of it right."""
    wave = level * np.sin(2 * np.pi * 440.0 * np.arange(round(seconds * RATE_HZ)) / RATE_HZ)
    samples = np.stack([wave, 0.1 * wave], axis=1)
    return Sound(samples, RATE_HZ, {"ch01-a": 0.5 * samples}, report(**more))


# --- an array -------------------------------------------------------------------------------------------------------------


def test_it_is_an_array_where_one_is_wanted() -> None:
    sound = tone()
    assert np.asarray(sound) is sound.samples and np.array(sound, copy=True) is not sound.samples
    assert np.asarray(sound, dtype=np.float32).dtype == np.float32
    with pytest.raises(ValueError, match="are float64, and float32 needs a copy"):
        np.asarray(sound, dtype=np.float32, copy=False)
    assert (sound.shape, sound.ndim, sound.dtype, len(sound)) == ((4000, 2), 2, np.float64, 4000)
    assert np.array_equal(sound[10:20, 0], sound.samples[10:20, 0]) and sound[-1, 1] == sound.samples[-1, 1]
    assert len(list(sound)) == 4000 and np.array_equal(next(iter(sound)), sound.samples[0])
    for made, expected in ((2 * sound, 2 * sound.samples), (sound - sound, 0 * sound.samples), (-sound, -sound.samples)):
        assert type(made) is np.ndarray and np.array_equal(made, expected)
    assert np.abs(sound).max() == np.abs(sound.samples).max() and float(np.mean(sound)) == sound.samples.mean()
    assert np.concatenate([sound, sound]).shape == (8000, 2)
    with pytest.raises(TypeError):
        np.add(sound, 1.0, out=sound)
    with pytest.raises(AttributeError):
        sound.rate_hz = 3  # type: ignore[misc]
    again = pickle.loads(pickle.dumps(sound))
    assert np.array_equal(again.samples, sound.samples) and again.report == sound.report
    assert bool(sound) and not tone(0.0)


def test_what_it_says_of_itself() -> None:
    assert repr(tone()) == "<Sound: 0.50 s at 8000 Hz, peak -6.0 dBFS, 1 note>"
    assert repr(tone(level=0.0, notes=0)) == "<Sound: 0.50 s at 8000 Hz, silent, 0 notes>"
    assert tone(0.0).peak_dbfs == -np.inf and tone(0.25).duration_s == 0.25


def test_parts_and_stems() -> None:
    sound = tone()
    part = sound.part(0.1, 0.2)
    assert np.array_equal(part.samples, sound.samples[800:1600]) and part.report is sound.report
    assert np.array_equal(part.stems["ch01-a"], sound.stems["ch01-a"][800:1600])
    assert len(sound.part(0.4)) == 800 and len(sound.part(0.4, 9.0)) == 800
    for start, end in ((-0.1, None), (0.5, None), (0.3, 0.3), (float("nan"), None)):
        with pytest.raises(ValueError, match="a part must begin at 0 s or later and before its end"):
            sound.part(start, end)
    stem = sound.stem("ch01-a")
    assert np.array_equal(stem.samples, sound.stems["ch01-a"]) and stem.stems == {}
    with pytest.raises(KeyError, match="no stem 'b'; there are ch01-a"):
        sound.stem("b")
    with pytest.raises(KeyError, match="there are none: render with stems=True"):
        stem.stem("ch01-a")


# --- files ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "bits"), [("a.wav", "16"), ("a.wav", "24"), ("a.wav", "float"), ("a.flac", "24"), ("a.flac", "16")]
)
def test_the_file_is_the_commands(tmp_path: Path, name: str, bits: str) -> None:
    file = mido.MidiFile()
    file.tracks.append(mido.MidiTrack([mido.Message("note_on", note=48, velocity=90, time=0)]))
    file.save(tmp_path / "song.mid")
    settings: dict = {"quality": "draft", "tail": 0.05, "seed": 7}
    render_file(
        RenderSettings(
            str(tmp_path / "song.mid"), str(tmp_path / f"command-{name}"), preset="tanpura-light", bit_depth=bits, **settings
        )
    )
    synth.render(file, "tanpura-light", **settings).save(tmp_path / name, bit_depth=bits)
    assert (tmp_path / name).read_bytes() == (tmp_path / f"command-{name}").read_bytes()


def test_a_file_is_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "a.wav"
    target.write_bytes(b"before")
    monkeypatch.setattr(soundclip.audiofile.AudioWriter, "write", lambda self, block: (_ for _ in ()).throw(OSError("full")))
    with pytest.raises(OSError, match="full"):
        tone().save(target)
    assert target.read_bytes() == b"before" and sorted(path.name for path in tmp_path.iterdir()) == ["a.wav"]
    for name, words in (("a.mp3", "does not say the format"), ("a", "does not say the format")):
        with pytest.raises(ValueError, match=words):
            tone().save(tmp_path / name)
    with pytest.raises(OSError, match="no directory"):
        tone().save(tmp_path / "none" / "a.wav")


def test_what_is_clipped_is_said(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match=r"a\.wav: \d+ samples? exceeded full scale and clipped"):
        tone(level=1.5).save(tmp_path / "a.wav")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tone(level=1.5).save(tmp_path / "b.wav", bit_depth="float")
        tone(0.0).save(tmp_path / "empty.wav")
    assert np.abs(soundfile.read(tmp_path / "b.wav")[0]).max() == pytest.approx(1.5, abs=1e-3)
    assert soundfile.info(tmp_path / "empty.wav").frames == 0


# --- a sound card ---------------------------------------------------------------------------------------------------------


class Card(types.ModuleType):
    """sounddevice, with a card that keeps what it is given, or refuses."""

    class PortAudioError(Exception):
        pass

    def __init__(self, trouble: Exception | None = None) -> None:
        super().__init__("sounddevice")
        self.trouble, self.calls = trouble, []

    def play(self, samples: np.ndarray, rate_hz: int, device: object) -> None:
        if self.trouble is not None:
            raise self.trouble
        self.calls.append(("play", samples.dtype, samples.shape, rate_hz, device))

    def wait(self) -> None:
        self.calls.append("wait")
        if self.trouble is not None:
            raise self.trouble

    def stop(self) -> None:
        self.calls.append("stop")


def test_it_plays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notebook_html, "need", lambda *_: None)
    card = Card()
    monkeypatch.setitem(sys.modules, "sounddevice", card)
    tone().play()
    tone().play("speaker", wait=False)
    played = ("play", np.float32, (4000, 2), RATE_HZ)
    assert card.calls == [(*played, None), "wait", (*played, "speaker")]
    card.play = lambda *_, **__: None  # type: ignore[method-assign]
    card.trouble = KeyboardInterrupt()  # type: ignore[assignment]
    with pytest.raises(KeyboardInterrupt):
        tone().play()
    assert card.calls[-2:] == ["wait", "stop"]
    monkeypatch.setitem(sys.modules, "sounddevice", Card(Card.PortAudioError("Invalid\nsample rate")))
    with pytest.raises(OSError, match="cannot play at 8000 Hz: Invalid sample rate; `synth devices` lists"):
        tone().play()


def test_what_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notebook_html, "find_spec", lambda name: None)
    for work, words in (
        (tone().play, r"play needs sounddevice: pip install 'jawari\[live\]'"),
        (tone().plot, r"plot needs matplotlib: pip install 'jawari\[notebook\]'"),
        (tone().to_xarray, r"to_xarray needs xarray: pip install 'jawari\[notebook\]'"),
    ):
        with pytest.raises(ImportError, match=words):
            work()
    shown = tone()._repr_html_()
    assert "<audio" in shown and "<img" not in shown and "A picture needs matplotlib" in shown


# --- notebooks and pictures -----------------------------------------------------------------------------------------------


class Sources(HTMLParser):
    """What a piece of HTML would load."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, str]] = []
        self.open: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [(tag, value or "") for name, value in attrs if name in ("src", "href", "srcset", "data", "poster")]
        self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def decoded(uri: str) -> bytes:
    return base64.b64decode(uri.partition("base64,")[2])


def test_a_notebook_shows_it_without_asking_anybody() -> None:
    sound = tone(warnings=["<b>odd</b>"])
    page = Sources(sound._repr_html_())
    assert page.open == [] and [tag for tag, _ in page.found] == ["img", "audio"]
    assert all(source.startswith("data:") for _, source in page.found)
    assert decoded(page.found[0][1]).startswith(b"\x89PNG")
    heard, rate_hz = soundfile.read(io.BytesIO(decoded(page.found[1][1])))
    assert rate_hz == RATE_HZ and np.abs(heard - sound.samples).max() < 3 / 32768
    text = sound._repr_html_()
    assert "&lt;b&gt;odd" in text and "8.0 × real time" in text and "first" not in text
    assert "clips what is above full scale (peak 6.0 dBFS)" in tone(level=2.0)._repr_html_()
    assert Sources(tone(0.0)._repr_html_()).found == []
    fast = replace(sound, rate_hz=352_800)
    assert "Browsers play up to" in fast._repr_html_() and "<audio" not in fast._repr_html_()


def test_of_a_long_sound_a_part_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soundclip, "EMBEDDED_S", 2.0)
    text = tone(5.0)._repr_html_()
    assert "The first 2 of 5 s; save() writes all of it." in text
    monkeypatch.setattr(soundclip, "EMBEDDED_BYTES", 10_000)
    noise = replace(tone(), samples=np.random.default_rng(1).uniform(-0.5, 0.5, (RATE_HZ * 5, 2)))
    frames, data = noise._embedded()
    assert len(data) <= 10_000 and soundfile.info(io.BytesIO(data)).frames == frames < 2 * RATE_HZ


def test_pictures_show_the_sound(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MPLBACKEND", "Agg")
    sound = tone(2.0)
    seconds, hertz, levels = spectrogram(sound.samples, RATE_HZ, 2000.0)
    assert levels.shape == (hertz.size, seconds.size) and seconds.size <= COLUMNS and hertz.max() <= 2000.0
    assert hertz[levels[:, seconds.size // 2].argmax()] == pytest.approx(440.0, abs=4.0)
    seconds, least, largest = envelope(sound.samples[:, 0], RATE_HZ)
    assert (
        seconds.size == STRETCHES and largest.max() == sound.samples[:, 0].max() and least.min() == sound.samples[:, 0].min()
    )
    axes = sound.plot(highest_hz=1000.0)
    assert len(axes) == 2 and axes[1].get_ylim() == (0.0, 1.0) and axes[1].get_xlim() == (0.0, 2.0)
    assert sound.plot(axes=axes) is axes
    tone(0.0).plot(axes=axes)
    with pytest.raises(ValueError, match="must be > 0"):
        sound.plot(highest_hz=0.0, axes=axes)
    import matplotlib.pyplot as plt

    plt.close("all")


def test_xarray() -> None:
    sound = tone()
    found = sound.to_xarray()
    assert found.dims == ("time", "channel") and found.attrs["rate_hz"] == RATE_HZ and found.time.attrs["units"] == "s"
    assert np.shares_memory(found.values, sound.samples) and float(found.time[-1]) == 3999 / RATE_HZ
    assert np.array_equal(found.sel(channel="right"), sound[:, 1])
    assert json.loads(found.attrs["report"])["notes"] == 1


# --- phrases --------------------------------------------------------------------------------------------------------------


def rows(notes: object) -> list[tuple[int, ...]]:
    return [
        tuple(int(each[name]) for name in ("frame", "kind", "channel", "a", "b")) for each in phrase_of(notes, 100).events
    ]


def test_notes_follow_each_other_unless_they_say_when() -> None:
    assert rows([(60, 90, 0.5), (62, 80, 1.0), (64, 70, 0.25, 0.1), (65, 60, 0.1)]) == [
        (0, NOTE_ON, 0, 60, 90), (10, NOTE_ON, 0, 64, 70), (35, NOTE_OFF, 0, 64, 64), (35, NOTE_ON, 0, 65, 60),
        (45, NOTE_OFF, 0, 65, 64), (50, NOTE_OFF, 0, 60, 64), (50, NOTE_ON, 0, 62, 80), (150, NOTE_OFF, 0, 62, 64),
    ]  # fmt: skip
    assert phrase_of([(60, 90, 0.5), (62, 80, 1.0)], 100).length_s == 1.5
    assert rows(Note(60, seconds=1.0, off_s=2.0)) == [(0, NOTE_ON, 0, 60, 100), (200, NOTE_OFF, 0, 60, 64)]


def test_a_key_that_is_struck_again_is_let_go_first() -> None:
    assert rows([(60, 90, 2.0, 0.0), (60, 80, 2.0, 1.0)]) == [
        (0, NOTE_ON, 0, 60, 90), (100, NOTE_OFF, 0, 60, 64), (100, NOTE_ON, 0, 60, 80), (300, NOTE_OFF, 0, 60, 64),
    ]  # fmt: skip
    assert rows([Note(60, off_s=0.0, seconds=1.0)])[1][0] == 1


def test_presets_and_articulations_are_parts_of_their_own() -> None:
    notes = [
        Note(60, preset="a"),
        Note(61),
        Note(62, preset="a", articulation="x", controllers=((1, 5), (2, 6))),
        Note(63, preset="a"),
    ]
    phrase = phrase_of(notes, 100)
    assert phrase.voices == {0: ("a", ""), 1: (None, ""), 2: ("a", "x")}
    found = [each for each in rows(notes) if each[1] != NOTE_OFF]
    assert [(each[2], each[3]) for each in found] == [(0, 60), (1, 61), (2, 1), (2, 2), (2, 62), (0, 63)]
    assert [each[1] for each in found] == [NOTE_ON, NOTE_ON, CONTROL, CONTROL, NOTE_ON, NOTE_ON]
    many = phrase_of([Note(60, preset=str(k)) for k in range(15)], 100)
    assert sorted(many.voices) == [*range(9), *range(10, 16)]
    with pytest.raises(ValueError, match=r"notes\[15\]: a phrase has at most 15 presets"):
        phrase_of([Note(60, preset=str(k)) for k in range(16)], 100)


@pytest.mark.parametrize(
    ("notes", "error", "words"),
    [
        ([(60,)], TypeError, r"notes\[0\] must be a Note, \(note, velocity\)"),
        ([(60, 90), 3], TypeError, r"notes\[1\] must be a Note"),
        ((48, 100, 2.0), TypeError, r"notes\[0\] must be a Note, .*got 48"),
        ([(60, 0)], ValueError, r"notes\[0\]: velocity must be at least 1"),
        ([(128, 1)], ValueError, r"notes\[0\]: note must be at most 127"),
        ([("C3", 1)], ValueError, r"notes\[0\]: note must be"),
        ([(60, 1, -1.0)], ValueError, r"notes\[0\]: seconds must lie"),
        ([(60, 1, 1.0), (60, 1, 1.0, -1.0)], ValueError, r"notes\[1\]: start_s must lie"),
        ([(60, 1, 1.0, float("nan"))], ValueError, r"notes\[0\]: start_s must lie"),
        ([(60, 1, 600.0, 86400.0), (60, 1)], ValueError, r"notes\[1\] begins after 24 h"),
    ],
)
def test_what_is_no_phrase(notes: object, error: type, words: str) -> None:
    with pytest.raises(error, match=words):
        phrase_of(notes, 44100)
    with pytest.raises(error, match=words):
        synth.render(notes, "tanpura-light")


def test_a_phrase_sounds_as_its_song() -> None:
    settings: dict = {"quality": "draft", "tail": 0.1}
    song = [
        mido.Message("note_on", note=48, velocity=90), mido.Message("note_off", note=48, time=0.2),
        mido.Message("note_on", note=43, velocity=70), mido.Message("note_off", note=43, time=0.1),
    ]  # fmt: skip
    phrase = synth.render((each for each in [Note(48, 90, 0.2), Note(43, 70, 0.1)]), "tanpura-light", **settings)
    assert np.array_equal(phrase, synth.render(iter(song), "tanpura-light", **settings)) and np.abs(phrase).max() > 1e-3
    assert synth.render([], "tanpura-light", **settings).report.notes == 0


def test_a_note_alone_is_the_one_of_render_notes() -> None:
    note = Note(48, 90, 0.25)
    alone = next(iter(synth.render_notes("tanpura-light", [note], quality="draft", dtype="float64"))).samples
    settings: dict = {"quality": "draft", "limiter": False}
    assert np.array_equal(synth.render(note, "tanpura-light", end_s=0.25, **settings), alone)


def test_articulations_are_heard_and_named() -> None:
    settings: dict = {"quality": "draft", "end_s": 0.2, "stems": True}
    both = synth.render([Note(28, 90, 0.1), Note(28, 90, 0.1, articulation="ghost")], "slap-bass", **settings)
    assert list(both.stems) == ["ch01-slap-bass", "ch02-slap-bass"]
    plain = synth.render([Note(28, 90, 0.1), Note(28, 90, 0.1)], "slap-bass", **settings)
    assert np.abs(np.asarray(both)[4410:8820] - np.asarray(plain)[4410:8820]).max() > 1e-3
    with pytest.raises(ValueError, match=r"slap-bass has no articulation 'gost'.*ghost"):
        synth.render([Note(28, articulation="gost")], "slap-bass")
    with pytest.raises(ValueError, match="articulation 'ghost' needs a preset: give one"):
        synth.render([Note(28, articulation="ghost")])
    with pytest.raises(ValueError, match="channels apply to a song only"):
        synth.render([Note(28)], channels={1: "tanpura-light"})


def test_settings_are_those_of_the_command() -> None:
    from synth.host.memory import RenderOptions

    own = {"midi", "output", "preset", "channel_presets", "made", "rate_hz", "stems"}
    assert set(RenderOptions.__annotations__) == set(RenderSettings.__dataclass_fields__) - own
    assert notelist.is_phrase([Note(60)]) and not notelist.is_phrase("song.mid") and not notelist.is_phrase([])
