"""Phrases: the same notes one after the other, ours and as they were recorded. Spectrograms, and how even the notes are."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from synth.dsp.measures import stft_power
from synth.fit.recording import read_recording
from synth.instrument.preset import load_preset
from synth.midi.events import NOTE_OFF, NOTE_ON
from synth.units import midi_to_note
from truth_of_sound.families import folder_of, note_of, rings
from truth_of_sound.note_features import RATE_HZ, at_common_rate, onset
from truth_of_sound.ours import Player
from truth_of_sound.pictures import FOLDER, kept_small
from truth_of_sound.playing import loudness_lufs

#: notes of a phrase, and how long each lasts [s]
NOTES, NOTE_S = 5, 0.8
#: velocity of ours
VELOCITY = 85
_DEPTH_DB, _HIGHEST_HZ = 75.0, 8000.0
_WINDOW_S, _COLUMNS = 0.04, 420


@dataclass(frozen=True)
class Phrase:
    """A preset beside a set of recordings, from a lowest note on."""

    preset: str
    recordings: str
    lowest: int


PHRASES = (
    Phrase("fretted-bass", "growlybass", 28),
    Phrase("flatwound-bass", "swagbass", 28),
    Phrase("picked-bass", "pastabass-spaghetti", 28),
    Phrase("electric-guitar", "nyanshell-strat", 45),
    Phrase("jazz-guitar", "emilyguitar", 40),
    Phrase("steel-guitar", "martin-hd28", 45),
    Phrase("nylon-guitar", "spanishguitar", 45),
    Phrase("double-bass", "meatbass", 28),
    Phrase("pizzicato-strings", "bigcat-cello-pizzicato", 40),
    Phrase("harp", "tarane-celtic-harp", 48),
    Phrase("harpsichord", "pjcohen-harpsichord", 45),
    Phrase("sitar", "sitar", 54),
)


def draw(roots: list[Path], only: list[str]) -> None:
    """One picture per phrase, or those of the presets named, into `FOLDER`; prints how far notes are apart in loudness.

    Raises ValueError, OSError.
    """
    FOLDER.mkdir(parents=True, exist_ok=True)
    for phrase in PHRASES:
        if only and phrase.preset not in only:
            continue
        files = chosen(folder_of(phrase.recordings, roots), phrase.lowest)
        figure, axes = plt.subplots(2, 1, figsize=(8.4, 4.6), layout="constrained", sharex=True)
        named = ", ".join(midi_to_note(note) for note in files)
        played, notes = ours(phrase.preset, list(files)), [_beginning(path) for path in files.values()]
        _spectrogram(axes[0], played, f"{phrase.preset}: {named}")
        _spectrogram(axes[1], recorded(notes), f"recordings ({phrase.recordings})")
        axes[1].set_xlabel("time [s]")
        path = FOLDER / f"phrase-{phrase.preset}.png"
        figure.savefig(path, dpi=90)
        plt.close(figure)
        kept_small(path)
        apart = [np.ptp([loudness_lufs(note) for note in each]) for each in (np.split(played, NOTES), notes)]
        print(f"{path}: notes {apart[0]:.1f} LU apart, as recorded {apart[1]:.1f} LU", flush=True)


def chosen(folder: Path, lowest: int) -> dict[int, Path]:
    """{note: file}: from `lowest` on, notes at least two semitones apart, of each the middle one of its layers."""
    by_note: dict[int, list[Path]] = {}
    for path in sorted(folder.iterdir()):
        note = note_of(path.name)
        if note is not None and note >= lowest and rings(path):
            by_note.setdefault(note, []).append(path)
    out: dict[int, Path] = {}
    for note, paths in sorted(by_note.items()):
        if len(out) < NOTES and (not out or note >= max(out) + 2):
            out[note] = paths[len(paths) // 2]
    if len(out) < NOTES:
        raise ValueError(f"{folder}: a phrase needs {NOTES} notes from {midi_to_note(lowest)} on, got {len(out)}")
    return out


def ours(preset: str, notes: list[int]) -> NDArray[np.float64]:
    """(frames,) of a phrase."""
    step, events = round(NOTE_S * RATE_HZ), []
    for k, note in enumerate(notes):
        events += [(k * step, NOTE_ON, 0, note, VELOCITY), ((k + 1) * step - 1, NOTE_OFF, 0, note, 0)]
    return Player(load_preset(preset)).play(events, NOTE_S * len(notes)).mean(axis=1)


def recorded(notes: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """(frames,) of the beginnings of recordings one after the other, each as loud as the others."""
    fade, parts = np.linspace(1.0, 0.0, RATE_HZ // 50), []
    for note in notes:
        part = note / np.abs(note).max()
        part[-fade.size :] *= fade
        parts.append(part)
    return np.concatenate(parts)


def _beginning(path: Path) -> NDArray[np.float64]:
    """(frames,) of a recording, `NOTE_S` long, from just before its onset."""
    samples, rate_hz = read_recording(str(path))
    x = at_common_rate(samples[: 2 * rate_hz].mean(axis=1), rate_hz)
    begin, part = max(0, onset(x) - RATE_HZ // 100), np.zeros(round(NOTE_S * RATE_HZ))
    cut = x[begin : begin + part.size]
    part[: cut.size] = cut
    return part


def _spectrogram(axes: Axes, x: NDArray[np.float64], title: str) -> None:
    hop = max(1, x.size // _COLUMNS)
    power = stft_power(x, round(_WINDOW_S * RATE_HZ), hop)
    level = 10.0 * np.log10(power / power.max() + 1e-12)
    extent = (0.0, level.shape[0] * hop / RATE_HZ, 0.0, 1e-3 * RATE_HZ / 2)
    axes.imshow(level.T, origin="lower", aspect="auto", extent=extent, vmin=-_DEPTH_DB, vmax=0.0, cmap="magma")
    axes.set(ylim=(0.0, 1e-3 * _HIGHEST_HZ), xlim=(0.0, x.size / RATE_HZ), ylabel="kHz", title=title)
