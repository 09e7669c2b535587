"""A picture per instrument: spectrogram of ours and of a recording, decay by partial, level and tilt by velocity."""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from PIL import Image

from synth.dsp.measures import stft_power
from synth.fit.recording import FitRefused
from synth.instrument.preset import PresetError, load_preset
from synth.units import midi_to_hz, midi_to_note
from truth_of_sound import measure
from truth_of_sound.ours import RATE_HZ, Player
from truth_of_sound.session import gather
from truth_of_sound.sources import Recorded

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "sound"
_VELOCITIES = (16, 32, 64, 96, 127)
_DYNAMICS = {"pp": 16, "p": 40, "mf": 72, "f": 100, "ff": 127}
_OURS, _REAL = "#D55E00", "#0072B2"
_COLOURS = 48
_DEPTH_DB = 80.0


@dataclass(frozen=True)
class Pair:
    """What is drawn beside what: a preset, notes of a group of recordings, and up to where [Hz, s]."""

    preset: str
    group: str
    note: int
    highest_hz: float = 5000.0
    seconds: float = 4.0


PAIRS = (
    Pair("fretted-bass", "pbf", 28),
    Pair("fretless-bass", "flbass", 36),
    Pair("slap-bass", "FluidR3 slap", 36),
    Pair("steel-guitar", "FluidR3 steel guitar", 45, 8000.0, 3.0),
    Pair("nylon-guitar", "FluidR3 nylon guitar", 45, 8000.0, 3.0),
    Pair("sitar", "FluidR3 sitar", 55, 8000.0, 0.7),
    Pair("harpsichord", "FluidR3 harpsichord", 48, 10000.0, 2.0),
    Pair("clavinet", "FluidR3 clavinet", 48, 8000.0, 0.2),
    Pair("shamisen", "FluidR3 shamisen", 54, 8000.0, 0.3),
    Pair("koto", "FluidR3 koto", 66, 8000.0, 0.35),
)


def draw_all(recordings: Path, soundfont: Path | None, only: Iterable[str] = ()) -> None:
    """Every pair whose preset and recording are there, or those of the presets named, into `FOLDER`."""
    wanted = set(only)
    by_group: dict[str, list[Recorded]] = defaultdict(list)
    for each in gather(recordings, soundfont):
        by_group[each.group if each.group.startswith("FluidR3") else each.group.split()[0]].append(each)
    FOLDER.mkdir(parents=True, exist_ok=True)
    for pair in PAIRS:
        if wanted and pair.preset not in wanted:
            continue
        rings = [each for each in by_group[pair.group] if each.kind == "ring"]
        try:
            player = Player(load_preset(pair.preset))
        except PresetError:
            print(f"{pair.preset}: there is no such preset", file=sys.stderr)
            continue
        if not rings:
            print(f"{pair.group}: no recording; give --soundfont", file=sys.stderr)
            continue
        real = min(rings, key=lambda each: abs(each.note - pair.note))
        layers = by_group["fashionbass"] if pair.preset == "fretted-bass" else []
        try:
            _draw(pair, player, real, layers)
        except FitRefused as error:
            print(f"{pair.preset}, {real.name}: {error}", file=sys.stderr)


def _draw(pair: Pair, player: Player, real: Recorded, layers: list[Recorded]) -> None:
    hz = float(midi_to_hz(real.note))
    ours = measure.cut(player.note(real.note, 90), RATE_HZ)
    theirs = measure.cut(real.samples, real.rate_hz)
    figure, axes = plt.subplots(2, 2, figsize=(8.4, 5.6), layout="constrained")
    label = midi_to_note(real.note)
    _spectrogram(axes[0, 0], ours, pair, f"{pair.preset}, {label}")
    _spectrogram(axes[0, 1], theirs, pair, f"recording ({real.group}), {label}")
    for note, colour, name in ((ours, _OURS, "ours"), (theirs, _REAL, "recording")):
        try:
            decays = measure.decays_s(measure.partials(note, hz))
        except FitRefused:
            continue
        axes[1, 0].semilogy(list(decays), list(decays.values()), "o-", color=colour, label=name, markersize=3.5, linewidth=1)
    axes[1, 0].set(xlabel="partial", ylabel="T60 [s]", title="decay by partial")
    axes[1, 0].legend()
    _by_velocity(axes[1, 1], player, real.note, layers)
    path = FOLDER / f"{pair.preset}.png"
    figure.savefig(path, dpi=100)
    plt.close(figure)
    kept_small(path)
    print(path)


def kept_small(path: Path) -> None:
    """Reduce a picture to a few colours, in place."""
    with Image.open(path) as image:
        image.convert("RGB").quantize(_COLOURS).save(path, optimize=True)


def _spectrogram(axes: Axes, note: measure.RecordedNote, pair: Pair, title: str) -> None:
    rate = note.rate_hz
    size = round(0.06 * rate)
    x = note.samples[: round(pair.seconds * rate)]
    hop = max(1, x.size // 300)
    power = stft_power(x, size, hop)
    level = 10.0 * np.log10(power / power.max() + 1e-12)
    extent = (0.0, level.shape[0] * hop / rate, 0.0, 1e-3 * rate / 2)
    axes.imshow(level.T, origin="lower", aspect="auto", extent=extent, vmin=-_DEPTH_DB, vmax=0.0, cmap="magma")
    axes.set(ylim=(0.0, 1e-3 * pair.highest_hz), xlim=(0.0, pair.seconds), xlabel="time [s]", ylabel="kHz", title=title)


def _by_velocity(axes: Axes, player: Player, number: int, layers: list[Recorded]) -> None:
    """Level re the loudest (lines) and tilt (dashed); recordings' layers as the mean over all notes."""
    hz = float(midi_to_hz(number))
    found = [measure.early(measure.cut(player.note(number, velocity, 0.6), RATE_HZ), hz) for velocity in _VELOCITIES]
    _curves(axes, list(_VELOCITIES), found, _OURS, "ours")
    by_layer: dict[int, list[dict[str, float]]] = defaultdict(list)
    for each in layers:
        if each.dynamic:
            note = measure.cut(each.samples, each.rate_hz)
            by_layer[_DYNAMICS[each.dynamic]].append(measure.early(note, float(midi_to_hz(each.note))))
    if by_layer:
        means = [{key: float(np.mean([e[key] for e in by_layer[v]])) for key in found[0]} for v in sorted(by_layer)]
        _curves(axes, sorted(by_layer), means, _REAL, "fashionbass, pp … ff")
    axes.set(xlabel="velocity", ylabel="level [dB] –, tilt [dB/oct] - -", title="level and tilt, soft to loud")
    axes.legend()


def _curves(axes: Axes, velocities: list[int], found: list[dict[str, float]], colour: str, name: str) -> None:
    top = found[-1]["level_db"]
    axes.plot(velocities, [e["level_db"] - top for e in found], "o-", color=colour, label=name, markersize=3.5, linewidth=1)
    axes.plot(velocities, [e["tilt_db_octave"] for e in found], "s--", color=colour, markersize=3.5, linewidth=1)
