"""What strings do not play: a SoundFont beside a fake engine of strings."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import numpy as np
import pyloudnorm
import pytest
import soundfile

from synth.host import render as job
from synth.host import rest
from synth.host.parts import PERCUSSION, Choice, cast
from synth.host.render import RenderSettings, render_file
from synth.host.soundfont import BLOCK, SoundFont
from synth.instrument.loudness_phrase import TARGET_LUFS, loudness_phrase
from synth.instrument.preset import load_preset
from synth.midi.events import CONTROL, EVENT, NOTE_OFF, NOTE_ON, PROGRAM, make_events
from synth.midi.song import read_song
from synth.units import db_to_gain

from .midibytes import header, off, on, track
from .soundfontkit import CLICK_AT, KEY, write_soundfont
from .test_render import _Engine

pytest.importorskip("fluidsynth", reason="FluidSynth's library is not installed", exc_type=ImportError)

RATE_HZ = 44100
DEBIAN = Path("/usr/share/sounds/sf2/FluidR3_GM.sf2")
NYLON, FLUTE, OBOE = 24, 73, 68


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Drums, a flute and a guitar, all of which click; no oboe."""
    path = tmp_path_factory.mktemp("font") / "click.sf2"
    return str(write_soundfont(path, [(0, NYLON), (0, FLUTE), (128, 0)], RATE_HZ))


@pytest.fixture
def font(made: str) -> Iterator[SoundFont]:
    with closing(SoundFont(made, RATE_HZ)) as opened:
        yield opened


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> _Engine:
    fake = _Engine(decay=0.99)
    fake.events = []  # type: ignore[attr-defined]
    plain = fake.process

    def process(events: np.ndarray, out: np.ndarray, stems: np.ndarray | None) -> None:
        fake.events += events.tolist()  # type: ignore[attr-defined]
        plain(events, out, stems)

    def make(settings: RenderSettings, *_: object) -> _Engine:
        fake.limiter = job._limits(settings)  # type: ignore[attr-defined]
        return fake

    fake.process = process  # type: ignore[method-assign]
    monkeypatch.setattr(job, "_engine", make)
    return fake


def program(channel: int, number: int) -> bytes:
    return bytes((0xC0 | channel, number))


@pytest.fixture
def band(tmp_path: Path) -> str:
    """Two guitars at once, a drum 0.5 s later, a flute 0.5 s later still."""
    path = tmp_path / "band.mid"
    events = [
        (0, program(0, NYLON)), (0, program(1, NYLON)), (0, program(2, FLUTE)),
        (0, on(60, 100)), (0, on(62, 60, channel=1)),
        (480, on(KEY, 100, channel=9)), (480, on(KEY, 100, channel=2)), (480, off(60)),
    ]  # fmt: skip
    path.write_bytes(header() + track(*events, end=0))
    return str(path)


def peaks(sound: np.ndarray) -> list[int]:
    """Frames of the clicks."""
    level = np.abs(sound).max(axis=1)
    inner = np.flatnonzero((level[1:-1] > level[:-2]) & (level[1:-1] >= level[2:]) & (level[1:-1] > 0.3 * level.max()))
    return (inner + 1).tolist()


def clicks(*frames: int, key: int = KEY, channel: int = 2) -> np.ndarray:
    return make_events([(0, PROGRAM, channel, FLUTE), *((frame, NOTE_ON, channel, key, 100) for frame in frames)])


def test_notes_begin_at_the_nearest_block_however_the_stream_is_cut(font: SoundFont) -> None:
    at = [0, 10 * BLOCK, 20 * BLOCK + 31, 30 * BLOCK + 32, 40 * BLOCK + 63]
    nearest = [0, 10 * BLOCK, 20 * BLOCK, 31 * BLOCK, 41 * BLOCK]
    whole = rest.SoundFontPlayer(font, clicks(*at)).frames(8192)
    assert peaks(whole) == [frame + CLICK_AT for frame in nearest]
    assert np.array_equal(whole[:, 0], whole[:, 1])
    font.reset()
    player = rest.SoundFontPlayer(font, clicks(*at))
    sizes = np.diff([0, 1, 64, 101, 1000, 1003, 5000, 8192])
    assert np.array_equal(np.concatenate([player.frames(int(size)) for size in sizes]), whole)


def test_events_do_what_they_do(font: SoundFont) -> None:
    def heard(*events: tuple) -> np.ndarray:
        font.reset()
        return rest.SoundFontPlayer(font, np.concatenate([make_events(list(events)), clicks(BLOCK)])).frames(1024)

    plain = heard((0, CONTROL, 2, 7, 100))
    assert np.array_equal(heard((0, CONTROL, 2, 10, 64)), plain) and plain.any()
    quiet = heard((0, CONTROL, 2, 7, 50))  # 40·log10(1/2)
    assert np.abs(quiet).max() / np.abs(plain).max() == pytest.approx(0.25, rel=0.01)
    left = heard((0, CONTROL, 2, 10, 0))
    assert np.abs(left[:, 1]).max() < 0.01 * np.abs(left[:, 0]).max()
    assert peaks(heard((0, 4, 2, 8191, 0))) == pytest.approx([BLOCK + CLICK_AT / 2 ** (2 / 12)], abs=1.0)  # BEND, a tone up


def test_a_tuning_is_the_strings(font: SoundFont) -> None:
    equal = 440.0 * 2.0 ** ((np.arange(128) - 69.0) / 12.0)
    font.tune(np.where(np.arange(128) == KEY, 2.0 * equal, equal))
    assert peaks(rest.SoundFontPlayer(font, clicks(0)).frames(1024)) == [CLICK_AT // 2]
    font.reset()
    assert peaks(rest.SoundFontPlayer(font, clicks(0)).frames(1024)) == [CLICK_AT]


def test_what_is_left_to_the_soundfont(font: SoundFont, band: str) -> None:
    there = font.programs()
    assert there == {NYLON, FLUTE, PERCUSSION}
    channels = {(0, NYLON): 4, (1, FLUTE): 3, (2, OBOE): 2, (9, 0): 1}

    def left(**more: object) -> set[tuple[int, int]]:
        return set(cast(channels, Choice(rest=there, **more)).rest)  # type: ignore[arg-type]

    assert left() == {(1, FLUTE), (9, 0)}  # no string, and no oboe, which has its stand-in
    assert cast(channels, Choice(rest=there)).parts[1].channel == 2
    assert left(preset="harp") == {(9, 0)}
    assert left(by_channel={1: "harp", 9: "harp"}) == set() and left(by_channel={1: "none", 9: "none"}) == set()
    assert cast(channels, Choice(rest=there, by_channel={9: "none"})).left_out == {9: 1}
    assert cast(channels, Choice()).rest == {}


def test_its_events_are_transposed_and_stay_on_the_keys(band: str) -> None:
    song = read_song(band, RATE_HZ)
    chosen = {(2, FLUTE): 1, (9, 0): 1}

    def keys(semitones: int, silent: np.ndarray | None = None) -> dict[int, list[int]]:
        events = rest.events_of(song, chosen, lambda channel: semitones, silent)
        found: dict[int, list[int]] = {}
        for event in events[(events["kind"] == NOTE_ON) & (events["b"] > 0)]:
            found.setdefault(int(event["channel"]), []).append(int(event["a"]))
        return found

    assert keys(0) == {9: [60], 2: [60]} and keys(-12) == {9: [60], 2: [48]}
    assert keys(96) == {9: [60], 2: [120]} and keys(-96) == {9: [60], 2: [0]}
    assert keys(0, np.arange(128) == 60) == {9: [60]}
    events = rest.events_of(song, chosen, lambda channel: 0)
    assert set(events["channel"].tolist()) == {2, 9} and events.dtype == EVENT
    assert (events["kind"] == NOTE_OFF).sum() == 2


@pytest.mark.parametrize("limiter", [True, False])
def test_a_mix_and_its_stems(tmp_path: Path, band: str, made: str, engine: _Engine, limiter: bool) -> None:
    settings = RenderSettings(
        band, str(tmp_path / "x.wav"), rest=made, stems=str(tmp_path / "s"), bit_depth="float", tail=0.2, limiter=limiter,
        block=100, gain_db=-20.0,
    )  # fmt: skip
    report = render_file(settings)
    assert not engine.limiter  # type: ignore[attr-defined]
    assert sorted(os.listdir(tmp_path / "s")) == ["ch01-nylon-guitar.wav", "ch02-nylon-guitar.wav", "rest.wav"]
    mix, *stems = (soundfile.read(path)[0] for path in [str(tmp_path / "x.wav"), *report.stems])
    np.testing.assert_allclose(sum(stems), mix, atol=1e-6)
    half = round(0.5 * RATE_HZ)
    begins = [(frame + BLOCK // 2) // BLOCK * BLOCK for frame in (half, 2 * half)]
    assert peaks(stems[2]) == [begin + CLICK_AT for begin in begins]
    assert np.abs(stems[0]).argmax() == 0 and np.abs(stems[0]).max() == pytest.approx(100 / 127)
    assert {row[2] for row in engine.events if row[1] == NOTE_ON} == {0, 1}  # type: ignore[attr-defined]
    assert report.notes == 2 and report.left_out == {} and report.stand_ins == [] and report.headroom_db == 6.0
    assert report.limiter_reduction_db == (0.0 if limiter else None)
    gain_db = report.rest["gain_db"]  # type: ignore[index]
    assert report.lines()[-1] == (
        "  click.sf2 plays channel 3 (Flute, 1 note), channel 10 (percussion, 1 note); its level is set by "
        f"{gain_db:+.1f} dB to match the strings"
    )
    json.dumps(report.as_dict(), allow_nan=False)
    only = render_file(RenderSettings(band, str(tmp_path / "y.wav"), rest=made, start_s=0.75, end_s=1.25))
    assert [row["name"] for row in only.rest["channels"]] == ["Flute"]  # type: ignore[index]


def test_the_limiter_works_on_all_that_sounds(tmp_path: Path, band: str, made: str, engine: _Engine) -> None:
    out = str(tmp_path / "x.wav")
    report = render_file(RenderSettings(band, out, rest=made, gain_db=40.0, bit_depth="float", tail=0.2))
    assert report.limiter_reduction_db is not None and report.limiter_reduction_db > 1.0
    assert np.abs(soundfile.read(out)[0]).max() == pytest.approx(db_to_gain(-0.1), abs=1e-6)
    louder = render_file(
        RenderSettings(band, out, rest=made, gain_db=40.0, bit_depth="float", tail=0.2, normalize_dbfs=-3.0)
    )
    assert louder.limiter_reduction_db is None
    assert np.abs(soundfile.read(out)[0]).max() == pytest.approx(db_to_gain(-3.0), abs=1e-6)


def test_drums_alone_need_no_engine(tmp_path: Path, made: str) -> None:
    path = tmp_path / "drums.mid"
    path.write_bytes(header() + track((0, on(KEY, 100, channel=9)), (48, off(KEY, channel=9))))
    report = render_file(RenderSettings(str(path), str(tmp_path / "x.wav"), rest=made, stems=str(tmp_path / "s")))
    assert peaks(soundfile.read(tmp_path / "x.wav")[0]) == [CLICK_AT]
    assert os.listdir(tmp_path / "s") == ["rest.wav"] and report.peak_dbfs is not None and report.warnings == []


def test_nothing_to_play_is_said_and_changes_nothing(tmp_path: Path, made: str, engine: _Engine) -> None:
    path = tmp_path / "strings.mid"
    path.write_bytes(header() + track((0, program(0, NYLON)), (0, on(60, 100)), (48, off(60))))
    report = render_file(RenderSettings(str(path), str(tmp_path / "x.wav"), rest=made, tail=0.0))
    assert engine.limiter  # type: ignore[attr-defined]
    assert report.lines()[-1] == "  click.sf2 has nothing to play: strings play every channel"
    render_file(RenderSettings(str(path), str(tmp_path / "y.wav"), tail=0.0))
    assert len((tmp_path / "x.wav").read_bytes()) == len((tmp_path / "y.wav").read_bytes())


def test_its_strings_are_as_loud_as_presets(tmp_path: Path, font: SoundFont) -> None:
    gain_db = rest.gain_db(font, RATE_HZ)
    events, frames = loudness_phrase(load_preset("nylon-guitar"))
    font.send(PROGRAM, 0, NYLON, 0)
    sound = db_to_gain(gain_db) * rest.SoundFontPlayer(font, events).frames(frames)
    assert pyloudnorm.Meter(RATE_HZ).integrated_loudness(sound) == pytest.approx(TARGET_LUFS, abs=0.1)
    softer = write_soundfont(tmp_path / "soft.sf2", [(0, NYLON), (128, 0)], RATE_HZ, level=0.25)
    with closing(SoundFont(str(softer), RATE_HZ)) as opened:
        assert rest.gain_db(opened, RATE_HZ) == pytest.approx(gain_db + 6.0, abs=0.11)
    drums = write_soundfont(tmp_path / "drums.sf2", [(128, 0)], RATE_HZ)
    with closing(SoundFont(str(drums), RATE_HZ)) as opened:
        assert rest.gain_db(opened, RATE_HZ) == 0.0


def test_what_is_no_soundfont(tmp_path: Path, band: str, made: str, capfd: pytest.CaptureFixture[str]) -> None:
    whole = Path(made).read_bytes()
    (tmp_path / "cut.sf2").write_bytes(whole[:3000])
    (tmp_path / "bad.sf2").write_bytes(whole.replace(b"phdr", b"xxxx"))
    before = sorted(os.listdir(tmp_path))
    for name, error, words in (
        ("none.sf2", FileNotFoundError, r"none\.sf2"),
        (".", IsADirectoryError, "is a directory; --rest needs a SoundFont"),
        (band, ValueError, r"band\.mid: not a SoundFont; give a \.sf2 or \.sf3 file"),
        (
            "cut.sf2",
            ValueError,
            rf"cut\.sf2: the SoundFont is cut off \(3000 of {len(whole)} bytes\); get a complete copy",
        ),
        ("bad.sf2", ValueError, r"bad\.sf2: FluidSynth cannot read this SoundFont; give another"),
    ):
        with pytest.raises(error, match=words):
            render_file(RenderSettings(band, str(tmp_path / "x.wav"), rest=str(tmp_path / name)))
    with pytest.raises(ValueError, match="--only-strings leaves out what --rest plays; give one of them"):
        render_file(RenderSettings(band, str(tmp_path / "x.wav"), rest=made, only_strings=True))
    assert sorted(os.listdir(tmp_path)) == before
    assert capfd.readouterr().err == ""


def test_a_library_that_is_missing(made: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "fluidsynth", None)
    with pytest.raises(ValueError, match=r"--rest needs pyfluidsynth: pip install 'jawari\[rest\]'"):
        SoundFont(made, RATE_HZ)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "fluidsynth.py").write_text('raise ImportError("Couldn\'t find the FluidSynth library.")')
    monkeypatch.delitem(sys.modules, "fluidsynth")
    with pytest.raises(
        ValueError, match=r"--rest needs FluidSynth's library \(Couldn't find the FluidSynth library\): install it"
    ):
        SoundFont(made, RATE_HZ)
    (tmp_path / "fluidsynth.py").write_text("version = 0.2")
    monkeypatch.delitem(sys.modules, "fluidsynth", raising=False)
    with pytest.raises(ValueError, match=r"fluidsynth\.py is another package"):
        SoundFont(made, RATE_HZ)


@pytest.mark.skipif(not DEBIAN.is_file(), reason="Debian's package fluid-soundfont-gm is not installed")
def test_a_real_soundfont_is_matched_and_repeats(tmp_path: Path, band: str, engine: _Engine) -> None:
    with closing(SoundFont(str(DEBIAN), RATE_HZ)) as opened:
        assert opened.programs() == set(range(129))
    files = []
    for name in ("x.wav", "y.wav"):
        engine.__init__(decay=0.99)  # type: ignore[misc]
        report = render_file(RenderSettings(band, str(tmp_path / name), rest=str(DEBIAN), tail=0.5, bit_depth="float"))
        files.append((tmp_path / name).read_bytes())
    assert files[0] == files[1]
    assert [row["name"] for row in report.rest["channels"]] == ["Flute", "percussion"]  # type: ignore[index]
