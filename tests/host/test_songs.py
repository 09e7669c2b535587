"""Whole songs through the real engine and the shipped presets, into a file and back."""

from __future__ import annotations

from pathlib import Path

import mido
import numpy as np
import pytest
import soundfile

from synth.dsp.measures import click_ratios
from synth.host.render import RenderSettings, render_file
from synth.instrument.preset import preset_folder


def general_midi_song(path: Path, seconds: float = 12.0) -> int:
    """A dense song on seven channels with all that such files hold; returns its notes outside percussion."""
    rng = np.random.default_rng(11)
    song = mido.MidiFile(type=1, ticks_per_beat=480)
    conductor = mido.MidiTrack()
    conductor.append(mido.MetaMessage("set_tempo", tempo=500_000))
    conductor.append(mido.MetaMessage("set_tempo", tempo=400_000, time=960))
    song.tracks.append(conductor)
    notes = 0
    for channel, program in ((0, 0), (1, 33), (2, 48), (3, 25), (4, 73), (5, 105), (9, 0)):
        track = mido.MidiTrack()
        track.append(mido.Message("program_change", channel=channel, program=program))
        track.append(mido.Message("control_change", channel=channel, control=10, value=int(rng.integers(0, 128))))
        track.append(mido.Message("control_change", channel=channel, control=91, value=60))
        low, high = (28, 60) if program == 33 else (36, 90)
        end = int(seconds * 2.5 * 480)
        events = []
        for _ in range(int(seconds * 6)):
            start = int(rng.integers(0, end))
            pitch = int(rng.integers(low, high))
            events.append((start, mido.Message("note_on", channel=channel, note=pitch, velocity=int(rng.integers(1, 128)))))
            events.append(
                (start + int(rng.integers(1, 960)), mido.Message("note_on", channel=channel, note=pitch, velocity=0))
            )
            notes += channel != 9
        for _ in range(20):
            at = int(rng.integers(0, end))
            events.append((at, mido.Message("pitchwheel", channel=channel, pitch=int(rng.integers(-8192, 8192)))))
            events.append((at, mido.Message("control_change", channel=channel, control=64, value=int(rng.integers(0, 128)))))
            events.append(
                (at, mido.Message("control_change", channel=channel, control=11, value=int(rng.integers(60, 128))))
            )
            events.append((at, mido.Message("aftertouch", channel=channel, value=40)))
        events.sort(key=lambda event: event[0])
        now = 0
        for at, message in events:
            track.append(message.copy(time=at - now))
            now = at
        song.tracks.append(track)
    song.save(path)
    return notes


@pytest.mark.slow
def test_a_general_midi_song_plays_whole(tmp_path: Path) -> None:
    notes = general_midi_song(tmp_path / "song.mid")
    report = render_file(
        RenderSettings(str(tmp_path / "song.mid"), str(tmp_path / "song.wav"), quality="draft", tail=2.0, gain_db=-6.0)
    )
    sound, rate_hz = soundfile.read(tmp_path / "song.wav")
    assert rate_hz == 44100
    assert np.isfinite(sound).all()
    assert 0.1 < np.abs(sound).max() < 1.0
    assert report.clipped_samples == 0
    assert report.notes == notes
    assert list(report.left_out) == [10]
    assert sum(entry["count"] for entry in report.unplayed) == 0
    assert report.strings > 10


@pytest.mark.parametrize(("song", "preset"), [("drone", "tanpura-light"), ("bassline", "fretted-bass")])
def test_the_demos_sound_as_they_should(song: str, preset: str, tmp_path: Path) -> None:
    report = render_file(
        RenderSettings(str(preset_folder() / "demos" / f"{song}.mid"), str(tmp_path / "demo.wav"), preset=preset, end_s=8.0)
    )
    sound, _ = soundfile.read(tmp_path / "demo.wav")
    assert report.unplayed == []
    # the hardest strokes alone may go as far beyond full scale as those of presets may (test_presets.py): presets are level
    # at velocity 80
    assert report.limiter_reduction_db < 6.0
    assert -12.0 < report.peak_dbfs <= 0.0
    assert abs(sound.mean()) < 1e-4
    borders = np.arange(32, len(sound) - 300, 32)[::7]
    # sound itself gives a few; a step at a border of the engine's quanta would give tens and more at most of them
    assert np.median(click_ratios(sound[:, 0], borders, within=1)) < 3.0


@pytest.mark.parametrize("silence_s", [0.0, 2.0])
def test_a_last_note_without_length_is_heard(silence_s: float, tmp_path: Path) -> None:
    song, track = mido.MidiFile(ticks_per_beat=480), mido.MidiTrack()
    track.append(mido.Message("note_on", note=60, velocity=90, time=int(silence_s * 960)))
    track.append(mido.Message("note_off", note=60, time=0))
    song.tracks.append(track)
    song.save(tmp_path / "one.mid")
    report = render_file(RenderSettings(str(tmp_path / "one.mid"), str(tmp_path / "one.wav"), quality="draft"))
    assert report.length_s > silence_s + 0.4
    assert report.peak_dbfs is not None and report.peak_dbfs > -30.0
