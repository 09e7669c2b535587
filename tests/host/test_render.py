"""A whole render job with a fake engine in the place of the real one."""

import json
import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import soundfile

from synth.dsp.measures import sounding_fundamental
from synth.engine.engine_settings import EngineSettings
from synth.host import render as job
from synth.host.bindings import parse_bindings
from synth.host.offline import Span
from synth.host.parts import Casting, Part
from synth.host.render import SILENT_KEY, RenderSettings, render_file
from synth.instrument.preset import preset_folder
from synth.midi import sysex
from synth.units import cents

from .fake_engine import FakeEngine
from .midibytes import header, off, on, track


class _Engine(FakeEngine):
    """The fake with the rest of an engine's face."""

    has_single = True

    def close(self) -> None:
        pass

    def prepare(self, rate_hz: int, max_block: int, progress=None) -> None:
        self.prepared = rate_hz, max_block

    def report(self) -> SimpleNamespace:
        return SimpleNamespace(
            limiter_reduction_db=0.0,
            most_strings=2,
            unsolved_contacts=0,
            stolen=0,
            taken_over=0,
            silenced=0,
        )


@pytest.fixture
def engine(monkeypatch) -> _Engine:
    fake = _Engine(decay=0.99)
    fake.note_hz = None

    def make(settings, arrangement, presets, note_hz, span):
        fake.note_hz = note_hz
        fake.limiter = job._limits(settings)
        return fake

    monkeypatch.setattr(job, "_engine", make)
    return fake


@pytest.fixture
def song(tmp_path) -> str:
    path = tmp_path / "song.mid"
    events = [(0, on(60, 100)), (0, on(62, 60, channel=1)), (0, on(36, channel=9)), (48, off(60))]
    path.write_bytes(header() + track(*events, end=48))
    return str(path)


def test_a_render_and_its_report(tmp_path, song, engine) -> None:
    out = str(tmp_path / "song.wav")
    heard: list[str] = []
    report = render_file(RenderSettings(song, out, preset="jawari-harp", tail=0.0, block=50), warn=heard.append)
    assert engine.prepared == (44100, 50)
    sound, rate_hz = soundfile.read(out)
    assert rate_hz == report.rate_hz == 44100
    assert len(sound) == round(report.length_s * 44100) == 4410
    np.testing.assert_allclose(sound[:100, 0], 100 / 127 * 0.99 ** np.arange(100), atol=2**-24)
    assert report.peak_dbfs == pytest.approx(20 * np.log10(100 / 127), abs=1e-9)
    assert report.parts == ["ch01-jawari-harp", "ch02-jawari-harp"]
    assert report.left_out == {10: 1}
    assert report.notes == 2
    assert report.unplayed == []
    assert any("channel 10 (percussion) is left out: 1 note; --map 10=PRESET" in line for line in heard)
    assert report.warnings == heard
    text = report.lines()
    assert text[0].startswith(f"{out}: 0.1 s, peak -2.1 dBFS, ")
    assert "2 strings" in text[0] and "2 notes (all played)" in text[0]
    assert text[1] == "  channel 1 (Acoustic Grand Piano) → jawari-harp: 1 note, C4"
    assert text[2] == "  channel 2 (Acoustic Grand Piano) → jawari-harp: 1 note, D4"
    json.dumps(report.as_dict(), allow_nan=False)


def test_normalizing_scales_mix_and_stems_alike(tmp_path, song, engine) -> None:
    stems = tmp_path / "stems"
    settings = RenderSettings(
        song,
        str(tmp_path / "song.wav"),
        preset="jawari-harp",
        normalize_dbfs=-6.0,
        stems=str(stems),
        bit_depth="float",
        tail=0.0,
    )
    report = render_file(settings)
    mix, _ = soundfile.read(tmp_path / "song.wav")
    assert np.abs(mix).max() == pytest.approx(10 ** (-6 / 20), rel=1e-6)
    assert report.peak_dbfs == pytest.approx(-6.0, abs=1e-9)
    assert report.normalize_gain_db == pytest.approx(-6.0 - 20 * np.log10(100 / 127), abs=1e-9)
    assert sorted(os.listdir(stems)) == ["ch01-jawari-harp.wav", "ch02-jawari-harp.wav"]
    parts = [soundfile.read(path)[0] for path in report.stems]
    np.testing.assert_allclose(sum(parts), mix, atol=1e-7)
    assert sorted(os.listdir(tmp_path)) == ["song.mid", "song.wav", "stems"]


def test_a_fallback_where_nothing_is_played(tmp_path, song) -> None:
    everything_out = {0: "none", 1: "none"}
    settings = RenderSettings(
        song, str(tmp_path / "x.wav"), channel_presets=everything_out, fallback="jawari-harp", fold=True, tail=0.0
    )
    report = render_file(settings)
    assert (report.notes, report.channels, report.left_out) == (0, [], {1: 1, 2: 1, 10: 1})


def test_stems_alone(tmp_path, song, engine) -> None:
    report = render_file(
        RenderSettings(song, None, preset="jawari-harp", stems=str(tmp_path / "s"), container="flac", tail=0.0)
    )
    assert sorted(os.listdir(tmp_path / "s")) == ["ch01-jawari-harp.flac", "ch02-jawari-harp.flac"]
    assert report.output is None


def test_a_failure_while_rendering_leaves_nothing(tmp_path, song, engine) -> None:
    def fail(*_: object) -> None:
        raise KeyboardInterrupt

    engine.process = fail
    settings = RenderSettings(song, str(tmp_path / "song.wav"), stems=str(tmp_path / "stems"), normalize_dbfs=-1.0)
    with pytest.raises(KeyboardInterrupt):
        render_file(settings)
    assert os.listdir(tmp_path) == ["song.mid"]


def test_keys_that_a_tuning_leaves_silent_are_reported(tmp_path, song, engine) -> None:
    kbm = tmp_path / "c-only.kbm"
    kbm.write_text("12\n0\n127\n60\n60\n256\n12\n0\n")
    report = render_file(RenderSettings(song, str(tmp_path / "x.wav"), keyboard=str(kbm), tail=0.0))
    assert engine.note_hz[60] == pytest.approx(256.0)
    assert np.isfinite(engine.note_hz).all()
    assert report.unplayed[0] == {
        "part": "ch02",
        "note": "D4",
        "count": 1,
        "reason": "the keyboard mapping leaves this key silent",
    }
    assert not soundfile.read(tmp_path / "x.wav")[0][:, 1].any()


def test_a_song_beyond_all_measure_is_refused(tmp_path, engine) -> None:
    path = tmp_path / "long.mid"
    path.write_bytes(header(division=1) + track((0, on(60)), (0x0FFFFFF, off(60))))
    with pytest.raises(ValueError, match=r"long\.mid: the song exceeds 24 h in track 1 .* up to an earlier --end"):
        render_file(RenderSettings(str(path), str(tmp_path / "x.wav")))
    assert not (tmp_path / "x.wav").exists()
    report = render_file(RenderSettings(str(path), str(tmp_path / "x.wav"), end_s=0.25))
    assert report.length_s == 0.25


def test_silence_has_no_peak_and_needs_no_engine(tmp_path) -> None:
    path = tmp_path / "drums.mid"
    path.write_bytes(header() + track((0, on(36, channel=9)), (480, off(36, channel=9))))
    report = render_file(RenderSettings(str(path), str(tmp_path / "x.wav"), normalize_dbfs=-1.0))
    assert report.peak_dbfs is None
    assert "silent" in report.lines()[0]
    json.dumps(report.as_dict(), allow_nan=False)
    # Quiet at its end, so there is no tail.
    assert len(soundfile.read(tmp_path / "x.wav")[0]) == round(0.5 * 44100)


@pytest.fixture
def loud(tmp_path) -> str:
    """Two notes at once on channel 1, which the fake engine adds up to 2.0 (below 1.0 after 69 frames), one on channel 2."""
    path = tmp_path / "loud.mid"
    path.write_bytes(header() + track((0, on(60, 127)), (0, on(61, 127)), (0, on(62, 1, channel=1)), (48, off(60))))
    return str(path)


def test_clipped_samples_of_the_mix_are_counted(tmp_path, loud, engine) -> None:
    clipped = render_file(RenderSettings(loud, str(tmp_path / "x.wav"), tail=0.0))
    assert clipped.clipped_samples == sum(2.0 * 0.99**n > 1.0 for n in range(200))
    assert "exceeded full scale and clipped; lower --gain" in clipped.lines()[-1]
    loose = render_file(RenderSettings(loud, str(tmp_path / "x.wav"), bit_depth="float", tail=0.0))
    assert loose.clipped_samples == 0


@pytest.mark.parametrize(("bits", "container"), [("16", "wav"), ("24", "wav"), ("24", "flac"), ("float", "wav")])
def test_no_stem_clips_and_they_still_add_up(tmp_path, loud, engine, bits: str, container: str) -> None:
    """Formats with a full scale: all stems are lowered alike. Floats have none and keep their level."""
    settings = RenderSettings(loud, None, stems=str(tmp_path / "s"), bit_depth=bits, container=container, tail=0.0)
    report = render_file(settings)
    loudest, quiet = (soundfile.read(path)[0] for path in report.stems)
    n = np.arange(len(loudest))
    ideal = np.stack((2.0 * 0.99**n, 0.99**n / 127), axis=1)
    lowered_db = 0.0 if bits == "float" else 6.1
    assert report.stems_lowered_db == pytest.approx(lowered_db)
    steps = {"16": 2.0 * 2.0**-15, "24": 2.0**-23, "float": 2.0**-24}[bits]  # of each: dither and rounding
    np.testing.assert_allclose(loudest + quiet, ideal * 10 ** (-lowered_db / 20), atol=2 * steps)
    told = "  all stems are lowered by 6.1 dB so that none clips; --bit-depth float keeps their level"
    assert (told in report.lines()) == (bits != "float")


def test_stems_of_a_normalized_mix_do_not_clip_either(tmp_path, engine) -> None:
    """Two parts that take away from each other: the mix is quieter than they are."""
    path = tmp_path / "song.mid"
    path.write_bytes(header() + track((0, on(60, 127)), (0, on(62, 127, channel=1)), (48, off(60))))
    plain = engine.process

    def opposed(events: np.ndarray, out: np.ndarray, stems: np.ndarray | None) -> None:
        plain(events, out, stems)
        out[:] = 0.1 * (out[:, :1] + out[:, 1:])

    engine.process = opposed
    report = render_file(
        RenderSettings(str(path), str(tmp_path / "x.wav"), normalize_dbfs=0.0, stems=str(tmp_path / "s"), tail=0.0)
    )
    parts = [soundfile.read(each)[0] for each in report.stems]
    assert report.stems_lowered_db == pytest.approx(14.0)  # 5 is 13.98 dB above full scale
    assert [np.abs(part).max() for part in parts] == pytest.approx([5 * 10**-0.7] * 2, abs=1e-6)
    engine.process = plain


@pytest.mark.parametrize("bits", ["24", "float"])
def test_silent_parts_have_no_stem(tmp_path, song, engine, bits: str) -> None:
    plain = engine.process

    def one(events: np.ndarray, out: np.ndarray, stems: np.ndarray | None) -> None:
        plain(events, out, stems)
        if stems is not None:
            stems[1] = 1e-9

    engine.process = one
    folder = tmp_path / "s"
    settings = RenderSettings(song, None, preset="jawari-harp", stems=str(folder), bit_depth=bits, tail=0.0)
    report = render_file(settings)
    assert os.listdir(folder) == ["ch01-jawari-harp.wav"] and report.stems == [str(folder / "ch01-jawari-harp.wav")]
    assert report.silent_stems == ["ch02-jawari-harp"]
    assert report.lines()[-1] == "  no stem for ch02-jawari-harp, which is silent"
    assert report.lines()[0].startswith(f"{folder / 'ch01-jawari-harp.wav'}: ")
    engine.process = lambda events, out, stems: (out.fill(0.0), stems.fill(0.0))
    nothing = render_file(replace(settings, stems=str(tmp_path / "none")))
    assert nothing.lines()[0].startswith("no stems: ") and not (tmp_path / "none").exists()
    assert nothing.lines()[-1] == "  no stem for ch01-jawari-harp, ch02-jawari-harp, which are silent"
    assert sorted(os.listdir(tmp_path)) == ["s", "song.mid"]


def test_controllers_zones_and_exclusive_messages_reach_the_engine(tmp_path) -> None:
    """What --cc and --mpe ask for and what the file says in system exclusive messages changes the sound as it should."""

    def rendered(name: str, *events: tuple[int, bytes], **more) -> np.ndarray:
        path = tmp_path / f"{name}.mid"
        notes = [(96, on(43, 100, channel=3)), (480, off(43, channel=3))]
        path.write_bytes(header() + track(*events, *notes))
        out = str(tmp_path / f"{name}.wav")
        settings = RenderSettings(
            str(path), out, preset="tanpura-light", quality="draft", tail=0.0, bit_depth="float", **more
        )
        report = render_file(settings)
        assert report.notes == 1 and not report.unplayed
        return soundfile.read(out)[0]

    def exclusive(message: bytes) -> tuple[int, bytes]:
        return 0, b"\xf0" + bytes((len(message) + 1,)) + message + b"\xf7"

    def change(channel: int, controller: int, value: int) -> tuple[int, bytes]:
        return 0, bytes((0xB0 | channel, controller, value))

    plain = rendered("plain")
    assert plain.any()
    # by a bound controller, and by the parameter message of a take: of part 0, though it stands on no channel
    quiet = rendered("bound", change(3, 20, 0), bindings=parse_bindings(["20=output.gain:0.5:1"]))
    said = rendered("said", exclusive(sysex.of_parameter(0, 0, 0.5)))
    settled = slice(12000, None)  # 18 time constants of the level
    np.testing.assert_allclose(quiet[settled], 0.5 * plain[settled], atol=1e-6)
    np.testing.assert_array_equal(said, quiet)
    # the master's level is the zone's
    zone = rendered("zone", change(0, 7, 50), mpe=True)
    np.testing.assert_allclose(zone[settled], 0.25 * plain[settled], atol=1e-6)
    np.testing.assert_allclose(rendered("no-zone", change(0, 7, 50)), plain)
    # a tuning
    tuned = rendered("tuned", exclusive(sysex.of_tuning(43, 44.0, True)))
    pitches = [sounding_fundamental(x[8000:, 0], 44100, hz) for x, hz in ((plain, 98.0), (tuned, 103.8))]
    assert abs(cents(pitches[1], pitches[0]) - 100.0) < 2.0


def test_a_binding_that_no_part_has_is_refused(tmp_path, song) -> None:
    settings = RenderSettings(
        song, str(tmp_path / "o.wav"), preset="fretted-bass", bindings=parse_bindings(["1=obstacle.height"])
    )
    with pytest.raises(ValueError, match=r"--cc: controller 1 is bound to obstacle\.height"):
        render_file(settings)


def test_normalizing_takes_the_limiters_place(tmp_path, engine) -> None:
    """What the strings give is scaled, not what the limiter has left of it: it is a multiple of the unlimited sound."""
    path = tmp_path / "loud.mid"
    path.write_bytes(header() + track((0, on(60, 127)), (0, on(61, 127)), (48, off(60))))
    plain = RenderSettings(str(path), str(tmp_path / "plain.wav"), bit_depth="float", tail=0.0, limiter=False)
    render_file(plain)
    assert engine.limiter is False
    report = render_file(replace(plain, output=str(tmp_path / "scaled.wav"), limiter=True, normalize_dbfs=-1.0))
    assert engine.limiter is False and report.limiter_reduction_db is None
    loud, scaled = (soundfile.read(tmp_path / name)[0] for name in ("plain.wav", "scaled.wav"))
    np.testing.assert_allclose(scaled, loud * 10 ** (-1 / 20) / np.abs(loud).max(), atol=1e-7)
    assert report.normalize_gain_db == pytest.approx(-1.0 - 20 * np.log10(2.0), abs=1e-6)
    assert "normalized by -7.0 dB" in report.lines()[0]
    render_file(replace(plain, limiter=True))
    assert engine.limiter is True


def test_the_closing_lines(tmp_path, song, engine) -> None:
    report = render_file(RenderSettings(song, str(tmp_path / "x.wav"), tail=0.0))

    def line(**changed: object) -> str:
        return replace(report, **{"output": "x.wav", "realtime_factor": None, "channels": []} | changed).lines()[0]

    assert line() == "x.wav: 0.1 s, peak -2.1 dBFS, 2 strings, 2 notes (all played), limiter not needed"
    assert line(strings=1, notes=1, realtime_factor=3.26).startswith(
        "x.wav: 0.1 s, peak -2.1 dBFS, 3.3× real time, 1 string, 1 note (all played), "
    )
    assert line(notes=0, peak_dbfs=None) == "x.wav: 0.1 s, silent, 2 strings, 0 notes, limiter not needed"
    assert line(limiter_reduction_db=0.04).endswith(", limiter not needed")
    assert line(limiter_reduction_db=0.05).endswith(", limiter reduced peaks by up to 0.1 dB")
    assert line(limiter_reduction_db=None).endswith(", limiter off")
    assert line(output="-").startswith("standard output: ") and line(output=None, stems=["a", "b"]).startswith("a, b: ")
    lost = [{"count": 2, "reason": SILENT_KEY}, {"count": 1, "reason": "another"}]
    assert "2 notes (3 not played)" in line(unplayed=lost)
    told = replace(
        report, channels=[], headroom_db=0.0, unplayed=lost, stolen=4, taken_over=5, silenced=3, clipped_samples=6
    )
    assert told.lines()[1:] == [
        "  2 of the notes not played are on keys that the keyboard mapping leaves silent",
        "  4 sounding strings were cut short for new notes (see --polyphony)",
        "  5 notes took over a string still held by another note, cutting it off",
        "  the motion of a string blew up and was silenced 3 times; use --scheme exact-hold or a higher --internal-rate",
        "  6 samples exceeded full scale and clipped; lower --gain or leave the limiter on",
    ]
    alone = [{"count": 1, "reason": SILENT_KEY}]
    assert replace(told, unplayed=alone, stolen=1, taken_over=1, silenced=1, clipped_samples=1).lines()[1:] == [
        "  1 of the notes not played is on a key that the keyboard mapping leaves silent",
        "  1 sounding string was cut short for a new note (see --polyphony)",
        "  1 note took over a string still held by another note, cutting it off",
        "  the motion of a string blew up and was silenced once; use --scheme exact-hold or a higher --internal-rate",
        "  1 sample exceeded full scale and clipped; lower --gain or leave the limiter on",
    ]
    lowered = ["  lowered by 3.0 dB, as several channels play; --gain raises it"]
    assert replace(report, channels=[]).lines()[1:] == lowered
    assert replace(report, channels=[], normalize_gain_db=1.0).lines()[1:] == []
    assert replace(report, channels=[], headroom_db=0.0).lines()[1:] == []


def test_what_is_told_of_the_time_it_took(tmp_path, song, engine) -> None:
    report = render_file(RenderSettings(song, str(tmp_path / "x.wav"), tail=0.0))
    assert report.realtime_factor == pytest.approx(report.length_s / report.render_s)
    assert report.length_s == 0.1 and 0.0 < report.prepare_s and 0.0 < report.render_s
    nothing = tmp_path / "nothing.mid"
    nothing.write_bytes(header() + track())
    assert render_file(RenderSettings(str(nothing), str(tmp_path / "y.wav"))).realtime_factor is None


def test_stems_of_one_name_are_numbered(tmp_path, engine) -> None:
    """Two preset files of one name on one channel, in different folders."""
    for folder in "ab":
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "own.toml").write_bytes((preset_folder() / "tanpura-light.toml").read_bytes())
    own = [str(tmp_path / folder / "own.toml") for folder in "ab"]
    casting = Casting((Part(0, own[0], 1), Part(0, own[1], 1)), np.full((16, 128), -1), {})
    settings = RenderSettings("song.mid", None, stems=str(tmp_path / "s"))
    labels = [part.label for part in casting.parts]
    outputs = job._Outputs(settings, labels, Span(0, 10, 0, False))
    assert [os.path.basename(path) for path in outputs.stem_paths] == ["01-ch01-own.wav", "02-ch01-own.wav"]


def test_where_stems_cannot_be_written(tmp_path, song, engine) -> None:
    (tmp_path / "file").touch()
    for folder, error, words in (
        ("file", NotADirectoryError, "is a file; --stems needs a directory"),
        ("nowhere/s", FileNotFoundError, "its parent directory is missing"),
    ):
        with pytest.raises(error, match=words):
            render_file(RenderSettings(song, None, stems=str(tmp_path / folder), tail=0.0))
    with pytest.raises(ValueError, match="nothing to write; give -o"):
        render_file(RenderSettings(song, None))
    assert sorted(os.listdir(tmp_path)) == ["file", "song.mid"]


def test_a_folder_of_stems_that_cannot_be_completed_is_taken_away(tmp_path, song, engine, monkeypatch) -> None:
    """The folder is made last of all; where a file cannot get its name in it, both go again. One that was there stays."""
    committed = job.audiofile.AudioWriter.__exit__

    def fails(writer, kind, *more) -> None:
        if kind is None and writer.path.endswith("ch01-jawari-harp.wav"):
            raise OSError("no")
        committed(writer, kind, *more)

    monkeypatch.setattr(job.audiofile.AudioWriter, "__exit__", fails)
    settings = RenderSettings(song, None, preset="jawari-harp", stems=str(tmp_path / "s"), tail=0.0)
    with pytest.raises(OSError, match="no"):
        render_file(settings)
    assert not (tmp_path / "s").exists()


def test_a_render_of_more_than_a_day_is_refused(tmp_path, song, engine) -> None:
    with pytest.raises(ValueError, match=r"song\.mid: the render would end at 24\.5 h, beyond the limit of 24 h"):
        render_file(RenderSettings(song, str(tmp_path / "x.wav"), end_s=24.5 * 3600.0))
    assert job._span(RenderSettings(song, None, end_s=24 * 3600.0), SimpleNamespace(length_s=1.0)).end == 24 * 3600 * 44100


def test_a_tail_is_as_long_as_was_asked_for(song) -> None:
    music = SimpleNamespace(length_s=2.0)

    def span(**more: object) -> Span:
        return job._span(RenderSettings(song, None, rate_hz=1000, **more), music)

    assert span() == span(tail="auto") == Span(0, 2000, 60_000, True)
    assert span(end_s=1.0) == Span(0, 1000, 0, False)
    assert span(end_s=1.0, tail="auto") == Span(0, 1000, 60_000, True)
    assert span(tail=1.5, start_s=0.5) == Span(500, 2000, 1500, False)


def test_the_engine_is_made_for_the_notes_up_to_a_second_behind_the_end(tmp_path, monkeypatch) -> None:
    asked: list[dict] = []

    class Asked(_Engine):
        def __init__(self, presets, program_map, **options) -> None:
            super().__init__(decay=0.99)
            asked.append(options)

    monkeypatch.setattr("synth.engine.engine.Engine", Asked)
    path = tmp_path / "song.mid"
    path.write_bytes(header() + track((0, on(60)), (960 + 959, on(62)), (2, on(64))))  # at 0 s, 1.999 s, 2.001 s
    settings = RenderSettings(
        str(path), str(tmp_path / "x.wav"), end_s=1.0, seed=3, polyphony=7, gain_db=-3.0, quality="fine"
    )
    render_file(settings)
    assert asked[0]["only_notes"] == [{60, 62}]
    assert asked[0]["settings"] == EngineSettings(polyphony=7, gain_db=-3.0, quality="fine", seed=3, threads="auto")


def test_steps_whose_contacts_were_not_solved_are_told(tmp_path, song, engine, monkeypatch) -> None:
    told = engine.report()
    monkeypatch.setattr(engine, "report", lambda: told)
    for count, steps in ((1, "1 step"), (2, "2 steps")):
        told.unsolved_contacts = count
        report = render_file(RenderSettings(song, str(tmp_path / "x.wav"), tail=0.0))
        assert f"in {steps} the contact forces were not solved exactly; please report this" in report.warnings


def test_normalizing_to_standard_output(tmp_path, engine, song, capfdbinary) -> None:
    report = render_file(RenderSettings(song, "-", normalize_dbfs=-6.0, bit_depth="float", container="raw", tail=0.0))
    sound = np.frombuffer(capfdbinary.readouterr().out, "<f4")
    assert np.abs(sound).max() == pytest.approx(10 ** (-6 / 20), rel=1e-6)
    assert report.peak_dbfs == pytest.approx(-6.0, abs=1e-9)


def test_only_what_is_rendered_is_reported(tmp_path, engine) -> None:
    path = tmp_path / "song.mid"

    def beats(*notes: bytes) -> bytes:
        return track(*((480 if number else 0, note) for number, note in enumerate(notes)))

    late = [on(60 + beat) for beat in range(8)]
    far = [on(10 + beat, channel=1) for beat in range(8)]  # below the harp's strings
    drums = [on(36, channel=9) for _ in range(8)]
    path.write_bytes(header(1, tracks=3) + beats(*late) + beats(*far) + beats(*drums))
    whole = render_file(RenderSettings(str(path), str(tmp_path / "x.wav"), preset="jawari-harp", tail=0.0))
    part = render_file(RenderSettings(str(path), str(tmp_path / "x.wav"), preset="jawari-harp", start_s=1.0, end_s=2.0))
    assert (whole.notes, len(whole.unplayed), whole.left_out) == (16, 8, {10: 8})
    assert (part.notes, [entry["note"] for entry in part.unplayed], part.left_out) == (4, ["C0", "C#0"], {10: 2})
    assert [(row["channel"], row["notes"], row["low"], row["high"]) for row in part.channels] == [
        (1, 2, "D4", "D#4"),
        (2, 2, "C0", "C#0"),
    ]
    assert any("channel 10 (percussion) is left out: 2 notes" in line for line in part.warnings)
    # one line a channel, however many kinds of note, with what helps
    assert [line.split(":")[0] for line in whole.lines()[1:]] == [
        "  channel 1 (Acoustic Grand Piano) → jawari-harp",
        "  channel 2 (Acoustic Grand Piano) → jawari-harp",
        "  lowered by 3.0 dB, as several channels play; --gain raises it",
    ]
    assert "8 of 8 notes not played, A#-1 to F0: --transpose 2=24 plays them all; --fold plays them all" in whole.lines()[2]


def test_preparing_is_told(tmp_path, song) -> None:
    told: list[tuple[int, int]] = []
    settings = RenderSettings(
        song, str(tmp_path / "x.wav"), preset="tanpura-light", quality="draft", tail=0.0, transpose={None: -12}
    )
    report = render_file(settings, preparing=lambda done, total: told.append((done, total)))
    assert report.notes == 2 and [row["unplayed"] for row in report.channels] == [0, 1]
    # C3 is on two strings; D3 on none
    assert told == [(1, 2), (2, 2)]


def test_strings_that_blew_up_are_in_the_closing_lines(tmp_path, song, engine, monkeypatch) -> None:
    told = engine.report()
    told.silenced = 3
    monkeypatch.setattr(engine, "report", lambda: told)
    report = render_file(RenderSettings(song, str(tmp_path / "song.wav"), tail=0.0))
    assert report.silenced == 3
    assert any(
        "the motion of a string blew up and was silenced 3 times; use --scheme exact-hold" in x for x in report.lines()
    )
