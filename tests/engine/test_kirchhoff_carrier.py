"""The engine's glide beside that of the whole equation of Kirchhoff and Carrier, whose tension swings within a period."""

from __future__ import annotations

import math

import numpy as np
import pytest

from synth.engine import layout
from synth.midi.events import NOTE_ON
from synth.solver.stringmodel import StringModel

from .kit import RATE_HZ, bank_of, engine, model_of, play, state_of
from .test_tension import ALONE, STEEL_N, omega_under, turn_of

#: what is compared, from the finger's release on [frames], and steps of the whole equation in each
FRAMES, STEPS = 384 * layout.QUANTUM, 2


def shares(q: np.ndarray, v: np.ndarray, omega: np.ndarray) -> np.ndarray:
    """(N,) part of each mode in the mean stretch Σ j² a_j²."""
    stretch = np.arange(1, q.size + 1) ** 2 * (q**2 + (v / omega) ** 2)
    return stretch / stretch.sum()


def carrier_hz(model: StringModel, length: float, q: np.ndarray, v: np.ndarray) -> float:
    """Frequency of the first mode of q″ + 2σq′ + (ω² + k²ΔT/μ)q = 0, ΔT = EA/(2L) Σ k²q² at every instant: exact flights
    between kicks (Strang), counted from zero to zero."""
    n, dt = q.size, 1.0 / (STEPS * RATE_HZ)
    omega, sigma = model.omega[:n], model.sigma[:n]
    ringing = np.sqrt(omega**2 - sigma**2)
    cosine, sine = (np.exp(-sigma * dt) * part for part in (np.cos(ringing * dt), np.sin(ringing * dt) / ringing))
    squares = (np.arange(1, n + 1) * math.pi / length) ** 2
    kick = 0.5 * dt * squares / model.mu * STEEL_N / (2.0 * length)
    first = np.empty(STEPS * FRAMES)
    for step in range(first.size):
        first[step] = q[0]
        v = v - kick * q * float(squares @ q**2)
        q, v = (cosine + sigma * sine) * q + sine * v, (cosine - sigma * sine) * v - omega**2 * sine * q
        v = v - kick * q * float(squares @ q**2)
    rising = np.flatnonzero((first[:-1] < 0.0) & (first[1:] >= 0.0))
    at = rising + first[rising] / (first[rising] - first[rising + 1])
    return float((at.size - 1) / ((at[-1] - at[0]) * dt))


@pytest.mark.parametrize(("place", "part"), [(0.5, 0.68), (0.2, 0.74), (0.05, 0.90)])
def test_the_glide_is_the_whole_equations_less_half_of_the_modes_own_share(place: float, part: float) -> None:
    """1/(1 + p/2), p the first mode's share of the mean stretch: the parts that docs/tension-and-contacts.md states."""
    made = engine(ALONE.with_setting("pluck.position", str(place)).with_setting("pluck.displacement_mm", "2"))
    play(made, [(0, NOTE_ON, 0, 43, 127)], 1024)
    place_of, model = bank_of(made).models[made._sounding.hands["model"][0]], model_of(made, 0)
    length, n = float(place_of["length"]), int(place_of["own"])
    q, v = (each[:n].copy() for each in state_of(made, 0))
    begun = shares(q, v, model.omega[:n])[0]
    rest_hz = math.sqrt(model.omega[0] ** 2 - model.sigma[0] ** 2) / (2.0 * math.pi)
    whole = 1200.0 * math.log2(carrier_hz(model, length, q, v) / rest_hz)
    turned = turn_of(made, omega_under(model, 1, length, 0.0)[0], FRAMES)
    mean = 1200.0 * math.log2(turned * RATE_HZ / (2.0 * math.pi * FRAMES) / rest_hz)
    ended = shares(*(each[:n] for each in state_of(made, 0)), model.omega[:n])[0]
    assert mean / whole == pytest.approx(1.0 / (1.0 + 0.25 * (begun + ended)), rel=0.01)
    assert mean / whole == pytest.approx(part, abs=0.01)
