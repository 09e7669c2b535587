"""Plucked strings drawn at random and rendered exactly, mode by mode, for the tests of the fit."""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from synth.physics.excitation import triangle_pluck
from synth.physics.modes import count_modes_below, decay_rates, force_weights, modal_frequencies
from synth.physics.string import String


@dataclass(frozen=True)
class Plucked:
    """position: of the pluck, from the end whose force is heard, as a share of L."""

    string: String
    position: float
    width_m: float
    peak: float


def draw(rng: np.random.Generator) -> Plucked:
    """f0 over 40–700 Hz and B over 1e-5 – 1e-3, evenly in their logarithms; nylon to steel, many losses."""
    f0 = 40.0 * (700.0 / 40.0) ** rng.random()
    inharmonicity = 10.0 ** rng.uniform(-5.0, -3.0)
    length = float(np.clip(rng.uniform(0.6, 1.4) * 65.0 / f0 if f0 > 150.0 else rng.uniform(0.6, 1.2), 0.12, 1.3))
    diameter = 10.0 ** rng.uniform(math.log10(0.25e-3), math.log10(1.2e-3))
    mu = rng.uniform(2000.0, 8000.0) * math.pi * diameter**2 / 4.0
    string = String.from_inharmonicity(
        length,
        mu * (2.0 * length * f0) ** 2,
        mu,
        inharmonicity,
        diameter,
        viscoelastic_loss=10.0 ** rng.uniform(-3.0, -1.5),
        thermoelastic_q_inverse=10.0 ** rng.uniform(-5.0, -3.3),
    )
    width = rng.uniform(2e-3, 15e-3) * length / 0.65
    return Plucked(string, rng.uniform(0.04, 0.5), width, rng.uniform(0.05, 0.9))


def steel(f0_hz: float, inharmonicity: float = 1e-4, position: float = 0.21) -> Plucked:
    """A string of 0.65 m and 2 g/m."""
    string = String.from_inharmonicity(
        0.65,
        2e-3 * (1.3 * f0_hz) ** 2,
        2e-3,
        inharmonicity,
        0.5e-3,
        viscoelastic_loss=4e-3,
        thermoelastic_q_inverse=2e-4,
    )
    return Plucked(string, position, 0.01, 0.5)


def render(
    plucked: Plucked,
    rng: np.random.Generator,
    *,
    seconds: float = 3.0,
    rate_hz: float = 44100.0,
    snr_db: float = 40.0,
    lead_s: float = 0.1,
) -> np.ndarray:
    """(n,) force at the bridge, every mode below half the rate, and white noise: snr_db below the note's mean power."""
    x = _without_noise(plucked, seconds, rate_hz)
    noise = math.sqrt(float(np.mean(x**2))) * 10.0 ** (-snr_db / 20.0)
    x = np.concatenate([np.zeros(round(lead_s * rate_hz)), x])
    return x + noise * rng.standard_normal(x.size)


@lru_cache(maxsize=4)  # some tests hear one string in many noises
def _without_noise(plucked: Plucked, seconds: float, rate_hz: float) -> np.ndarray:
    string = plucked.string
    n = min(count_modes_below(string, 0.499 * rate_hz), 600)
    omega, sigma = modal_frequencies(string, n), decay_rates(string, n)
    place = (1.0 - plucked.position) * string.length_m
    amplitude = triangle_pluck(string.length_m, place, 1e-3, plucked.width_m, n) * force_weights(string, string.length_m, n)
    t = np.arange(round(seconds * rate_hz)) / rate_hz
    x = np.zeros(t.size)
    for a, w, s in zip(amplitude, omega, sigma, strict=True):
        heard = t[: math.ceil(30.0 / s * rate_hz)]  # e⁻³⁰ is far below the noise
        x[: heard.size] += a * np.exp(-s * heard) * np.cos(math.sqrt(max(w * w - s * s, 0.0)) * heard)
    x *= plucked.peak / np.abs(x).max()
    x.flags.writeable = False
    return x
