"""Sounds that are not what the contact fit takes them for: of each a recording, and what it is fitted as.

An answer is right where it is refused, or where height, distance and place are right all the same; None for the truth:
anything but a refusal is nonsense.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import soundfile
from scipy.signal import fftconvolve

from contact_truths.notes import LEAD_S, RATE_HZ, Truth, drawn, noisy, preset_of, sound
from synth.host.batch import Note, render_notes
from synth.instrument.preset import FretsObstacle, Layer, Preset, load_preset

#: (recording, preset and string it is fitted as, the truth or None)
Misleading = tuple[np.ndarray, str, int, Truth | None]


def _plain(seed: int, **fixed: object) -> Truth:
    return drawn(seed, "tanpura-light", string=0, **fixed)


def _of(preset: Preset, truth: Truth, velocity: int = 127) -> np.ndarray:
    (made,) = render_notes(preset, [Note(preset.string[0].notes[0], velocity, 3.0)], quality="fine", dtype="float64")
    assert made.samples is not None, made.error
    return noisy(made.samples[:, 0], truth.snr_db, truth.seed)


def _two_notes(seed: int) -> Misleading:
    one, other = sound(_plain(seed)), sound(replace(_plain(seed + 1), string=1))
    return one + other, "tanpura-light", 0, None


def _octave(seed: int) -> Misleading:
    return sound(replace(_plain(seed), string=3)), "tanpura-light", 1, None


def _other_string(seed: int) -> Misleading:
    return sound(replace(_plain(seed), string=1)), "tanpura-light", 0, None


def _other_length(seed: int) -> Misleading:
    """The same pitch on a string half as long and as thick as another."""
    truth = _plain(seed)
    preset = preset_of(truth)
    table = preset.string[0].model_copy(update={"length_m": 0.5, "diameter_mm": 0.5})
    return _of(preset.model_copy(update={"string": (table,)}), truth), "tanpura-light", 0, None


def _kind(kind: str) -> Callable[[int], Misleading]:
    def made(seed: int) -> Misleading:
        truth = _plain(seed, kind=kind, heard=0.009)
        return sound(truth), "tanpura-light", 0, truth

    return made


def _room(seconds: float) -> Callable[[int], Misleading]:
    def made(seed: int) -> Misleading:
        truth = _plain(seed)
        rng = np.random.default_rng(seed)
        t = np.arange(round(1.2 * seconds * RATE_HZ)) / RATE_HZ
        answer = rng.standard_normal(t.size) * 10.0 ** (-3.0 * t / seconds)
        answer[0] = 3.0 * np.sqrt(float(np.sum(answer**2))) * 0.2
        wet = fftconvolve(sound(truth), answer)[: round((3.0 + LEAD_S) * RATE_HZ)]
        return wet / np.abs(wet).max() * 0.5, "tanpura-light", 0, truth

    return made


def _soft(seed: int) -> Misleading:
    truth = _plain(seed)
    layer = Layer(stiffness_n_mm=5.0, thickness_um=300.0, resistance_n_s_m=2.0)
    return _of(preset_of(truth, {"layer": layer}), truth), "tanpura-light", 0, None


def _curved(seed: int) -> Misleading:
    """The string rests on its edge alone, which has fallen by d²/2R: that is the point which is heard."""
    truth, radius_m = _plain(seed), 3.0
    edge = replace(truth, height_m=truth.height_m + 0.5 * truth.distance_m**2 / radius_m)
    return _of(preset_of(truth, {"points": 5, "radius_mm": 1e3 * radius_m}), truth), "tanpura-light", 0, edge


def _frets(seed: int) -> Misleading:
    truth = _plain(seed)
    low = FretsObstacle(kind="frets", count=20, action_12th_mm=0.6, relief_mm=0.1, nut_height_mm=0.2)
    return _of(preset_of(truth).model_copy(update={"obstacle": low}), truth), "tanpura-light", 0, None


def _single(seed: int) -> Misleading:
    truth = drawn(seed, "sitar", string=0)
    return _of(preset_of(truth, {"points": 1}), truth), "sitar", 0, None


def _free(height: float) -> Callable[[int], Misleading]:
    def made(seed: int) -> Misleading:
        return sound(_plain(seed, height_m=height)), "tanpura-light", 0, None

    return made


def _far(seed: int) -> Misleading:
    """Plucked beyond the middle, by a preset on which the nut is the bridge's end: a longer way round."""
    truth = _plain(seed, position=0.02)
    return sound(truth), "tanpura-light", 0, truth


def _noise(seed: int) -> Misleading:
    truth = _plain(seed, snr_db=3.0)
    return sound(truth), "tanpura-light", 0, truth


def _slid(seed: int) -> Misleading:
    truth = _plain(seed)
    preset = preset_of(truth)
    return (
        _of(preset.model_copy(update={"pluck": preset.pluck.model_copy(update={"slip_ms": 3.0})}), truth),
        "tanpura-light",
        0,
        truth,
    )


def _wide(seed: int) -> Misleading:
    truth = _plain(seed)
    preset = preset_of(truth)
    return (
        _of(preset.model_copy(update={"pluck": preset.pluck.model_copy(update={"width_mm": 45.0})}), truth),
        "tanpura-light",
        0,
        truth,
    )


def _compressed(seed: int) -> Misleading:
    """A compressor evens the level out over time."""
    truth = _plain(seed)
    x = sound(truth)
    level = np.sqrt(fftconvolve(x**2, np.ones(2205) / 2205.0)[: x.size]) + 1e-3
    y = x * level**-0.7
    return y / np.abs(y).max() * 0.5, "tanpura-light", 0, truth


def _clipped(seed: int) -> Misleading:
    x = sound(_plain(seed))
    return np.clip(x, -0.15, 0.15), "tanpura-light", 0, None


def _overdriven(drive: float) -> Callable[[int], Misleading]:
    def made(seed: int) -> Misleading:
        truth = _plain(seed)
        x = sound(truth)
        return 0.6 * np.tanh(drive * x / np.abs(x).max()), "tanpura-light", 0, truth

    return made


def _coded(kbits: float) -> Callable[[int], Misleading]:
    """Through an MP3 of a constant rate."""

    def made(seed: int) -> Misleading:
        truth = _plain(seed)
        level = (320.0 - kbits) / (320.0 - 32.0)
        kind = {"format": "MP3", "subtype": "MPEG_LAYER_III", "bitrate_mode": "CONSTANT", "compression_level": level}
        file = io.BytesIO()
        soundfile.write(file, sound(truth), RATE_HZ, **kind)
        file.seek(0)
        return soundfile.read(file)[0], "tanpura-light", 0, truth

    return made


def _two_points(seed: int) -> Misleading:
    """A second point, as high, half as far as the edge."""
    truth = _plain(seed, height_m=6e-6, amplitude_m=3e-3, distance_m=14e-3)
    return _of(preset_of(truth, {"points": 2, "radius_mm": 1e5}), truth), "tanpura-light", 0, truth


def _bass(seed: int) -> Misleading:
    preset = load_preset("fretted-bass")
    (made,) = render_notes(preset, [Note(43, 100, 3.0)], quality="standard", dtype="float64")
    assert made.samples is not None
    return noisy(made.samples[:, 0], 40.0, seed), "tanpura-light", 0, None


#: by name
CASES: dict[str, Callable[[int], Misleading]] = {
    "two notes": _two_notes,
    "an octave beside": _octave,
    "another string": _other_string,
    "another length and gauge": _other_length,
    "velocity heard": _kind("velocity"),
    "displacement heard": _kind("displacement"),
    "room of 0.5 s": _room(0.5),
    "room of 2 s": _room(2.0),
    "thread of soft cotton": _soft,
    "curved bridge taken for a point": _curved,
    "low frets taken for a bridge": _frets,
    "a point taken for a curved bridge": _single,
    "no contact": _free(2e-4),
    "hardly any contact": _free(4e-5),
    "plucked at the very end": _far,
    "noise at 3 dB": _noise,
    "slid off in 3 ms": _slid,
    "a thumb 45 mm wide": _wide,
    "compressed": _compressed,
    "a fretted bass": _bass,
    "clipped": _clipped,
    "overdriven, tanh × 3": _overdriven(3.0),
    "overdriven, tanh × 1.5": _overdriven(1.5),
    "MP3 of 35 kbit/s": _coded(35.0),
    "MP3 of 64 kbit/s": _coded(64.0),
    "two points taken for one": _two_points,
}
