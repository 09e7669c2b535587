"""Notes over bridges drawn at random and rendered by the engine a quality finer than the fit computes, with noise.

What is drawn is of the preset: height of the thread between 0 and 0.7 of that at which hardly anything touches, distance,
place and amplitude of the pluck, its draw time and slip. `Truth` says what is done to the sound besides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from synth.host.batch import Note, render_notes
from synth.instrument.compile import open_string
from synth.instrument.preset import BridgeObstacle, Preset, load_preset

RATE_HZ = 44100
SECONDS, LEAD_S = 3.0, 0.15


@dataclass(frozen=True)
class Truth:
    """preset, string, height_m, distance_m, position, amplitude_m, draw_s; what is between string and recording: the
    preset's body, place [share of L] and kind of the output, factors of the material losses and of the time in which the
    string slides off the finger, snr_db."""

    preset: str
    string: int
    height_m: float
    distance_m: float
    position: float
    amplitude_m: float
    draw_s: float
    seed: int
    body: bool = False
    heard: float | None = None
    kind: str = "force"
    losses: float = 1.0
    slip: float = 1.0
    snr_db: float = 40.0
    quality: str = "fine"

    @property
    def values(self) -> dict[str, float]:
        """As a fit names them."""
        length = length_m(self.preset, self.string)
        return {
            "height": self.height_m / self.amplitude_m,
            "distance": self.distance_m / length,
            "position": self.position,
        }


def length_m(preset: str, string: int) -> float:
    """Length of a preset's string [m]."""
    table = load_preset(preset).string[string]
    return open_string(load_preset(preset), table, table.notes[0])[0].length_m


def drawn(seed: int, family: str, **fixed: Any) -> Truth:
    """A tanpura's or a sitar's note at random."""
    rng = np.random.default_rng(seed)
    tanpura = family == "tanpura-light"
    string = int(rng.choice([0, 1, 3] if tanpura else [0, 1, 2]))
    position = rng.uniform(0.1, 0.5) if tanpura else rng.uniform(0.06, 0.3)
    distance = rng.uniform(3e-3, 12e-3) if tanpura else rng.uniform(5e-3, 14e-3)
    amplitude = rng.uniform(1.5e-3, 4e-3) if tanpura else 2e-3
    height = rng.uniform(0.0, 0.7) * distance * amplitude / ((1.0 - position) * length_m(family, string))
    draw_s = rng.uniform(6e-3, 20e-3) if tanpura else rng.uniform(3e-3, 8e-3)
    # no hand is the preset's: the string slides off up to 1.4 times as fast or as slowly
    slip = 1.0 if tanpura else math.exp(rng.uniform(-0.34, 0.34))
    return replace(Truth(family, string, height, distance, position, amplitude, draw_s, seed, slip=slip), **fixed)


def preset_of(truth: Truth, obstacle: dict[str, Any] | None = None) -> Preset:
    """The preset that sounds so, on rigid ends. obstacle: other values of its bridge."""
    preset = load_preset(truth.preset)
    assert isinstance(preset.obstacle, BridgeObstacle)
    table = preset.string[truth.string]
    if truth.losses != 1.0:
        material = {name: getattr(table, name) * truth.losses for name in ("viscoelastic_loss", "thermoelastic_q_inverse")}
        table = table.model_copy(update=material)
    body = preset.body
    if preset.output.kind == "body":
        body, table = body.model_copy(update={"mode": ()}), table.model_copy(update={"place_mm": 0.0})
    elif not truth.body:
        body = body.model_copy(update={"direct_db": 0.0, "resonance": ()})
    if truth.slip != 1.0 and isinstance(preset.pluck.hardest_slip_ms, float):
        pluck = preset.pluck.model_copy(update={"slip_hard_ms": preset.pluck.hardest_slip_ms * truth.slip})
        preset = preset.model_copy(update={"pluck": pluck})
    near = 1e-4 if preset.output.kind == "body" else preset.output.position
    place = {"kind": truth.kind, "position": near if truth.heard is None else truth.heard}
    return preset.model_copy(
        update={
            "string": (table,),
            "obstacle": preset.obstacle.model_copy(
                update={"jiva_um": 1e6 * truth.height_m, "distance_mm": 1e3 * truth.distance_m, **(obstacle or {})}
            ),
            "pluck": preset.pluck.model_copy(
                update={
                    "position": truth.position,
                    "displacement_mm": 1e3 * truth.amplitude_m,
                    "draw_ms": 1e3 * truth.draw_s,
                }
            ),
            "body": body,
            "output": preset.output.model_copy(update=place),
        }
    )


def sound(truth: Truth, preset: Preset | None = None, seconds: float = SECONDS) -> np.ndarray:
    """(n,) the recording: noise alone for LEAD_S, then the note in it."""
    preset = preset_of(truth) if preset is None else preset
    note = Note(preset.string[0].notes[0], 127, seconds)
    (rendered,) = render_notes(preset, [note], rate_hz=RATE_HZ, quality=truth.quality, dtype="float64", variation=0.0)
    if rendered.samples is None:
        raise ValueError(rendered.error)
    return noisy(rendered.samples[:, 0], truth.snr_db, truth.seed)


def noisy(x: np.ndarray, snr_db: float, seed: int) -> np.ndarray:
    """At half of full scale, behind LEAD_S of nothing, in white noise so far below the note's mean power."""
    x = x / np.abs(x).max() * 0.5
    noise = math.sqrt(float(np.mean(x**2))) * 10.0 ** (-snr_db / 20.0)
    x = np.concatenate([np.zeros(round(LEAD_S * RATE_HZ)), x])
    return x + noise * np.random.default_rng(seed).standard_normal(x.size)
