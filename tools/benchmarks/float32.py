"""A string whose modes are held in float32 (`synth.solver.single`), beside the same one in float64: time, error, drift.

Rounded to float32, Φ^K keeps a mode's frequency: p12 and p21, whose product makes the angle of a slow mode, are exact to a
part ε = 2⁻²⁴. What it would lose is damping: the determinant is off by some ε, the decay rate by ε/(KΔt), the more the finer
the step. The engine's rows hold Φ^K − 1 instead: both are right then, but for the rounding of the state itself. A two-step
form x⁺ = a x − e x⁻ would lose the frequency: its a = 2 cos θ leaves θ² an error of ε.
"""

from __future__ import annotations

import numpy as np

from benchmarks.kernels import Plucked, Stretch, coefficients_of
from synth.native.simd import LANES
from synth.solver.block_rows import BLOCK
from synth.solver.blocks import advance_blocks, fly_modes, press_blocks
from synth.solver.laws import EXACT_HOLD
from synth.solver.stringmodel import Strung, in_single, place_contacts

SINGLE_LANES = 2 * LANES
_CALL = 1024  # steps


def stretch(plucked: Plucked, steps: int, flies: bool = False, *, single: bool = True) -> tuple[Stretch, np.ndarray]:
    """All `steps`, a multiple of K, of a string over its contact, or flying free; with the displacements, (steps,)."""
    m, q0, v0 = plucked
    model = m.string._replace(certified=0)
    string = Strung(in_single(model) if single else model, q0, v0, min(steps, _CALL))
    at, state, scratch = string.addresses
    out = np.zeros(steps)

    def reset() -> None:
        string.q[:], string.v[:] = q0, v0

    def take() -> None:
        if not flies and model.law != EXACT_HOLD:
            place_contacts(at, state, string.model.modes)
        for first in range(0, steps, _CALL):
            here = min(_CALL, steps - first)
            if flies:
                fly_modes(at, scratch, string.state.q, string.state.v, string.model.modes, here // BLOCK, string.out(here))
            elif model.law == EXACT_HOLD:
                press_blocks(at, state, scratch, here // BLOCK, here)
            else:
                advance_blocks(at, state, scratch, here // BLOCK, here)
            out[first : first + here] = string.out(here)[0]

    return Stretch(take, reset, string.q, string.v), out


def misfit(plucked: Plucked) -> tuple[np.ndarray, np.ndarray]:
    """Φ^K − 1 rounded to float32: cents by which it detunes each mode, 1/s by which it changes its decay rate, (N,) both."""
    one = np.moveaxis(coefficients_of(plucked.model)[:4].reshape(2, 2, -1), -1, 0)
    whole = np.linalg.matrix_power(one, BLOCK)
    rounded = (whole - np.eye(2)).astype(np.float32).astype(np.float64) + np.eye(2)
    step, angle, off = (np.abs(np.angle(np.linalg.eigvals(phi))).max(axis=-1) for phi in (one, whole, rounded))
    cents = 1200.0 * np.log2(1.0 + (off - angle) / (BLOCK * step))
    lost = np.log(np.linalg.det(whole) / np.linalg.det(rounded)) / (2.0 * BLOCK * plucked.model.string.dt)
    return cents, lost


def two_step_misfit(plucked: Plucked) -> np.ndarray:
    """Cents (N,) by which a mode is detuned when trace and determinant of a step are rounded; −∞: it swings no more."""
    p11, p12, p21, p22 = coefficients_of(plucked.model)[:4]
    exact = (p11 + p22, p11 * p22 - p12 * p21)
    rounded = [a.astype(np.float32).astype(np.float64) for a in exact]
    angle, off = (np.arccos(np.clip(0.5 * trace / np.sqrt(det), -1.0, 1.0)) for trace, det in (exact, rounded))
    with np.errstate(divide="ignore"):
        return 1200.0 * np.log2(off / angle)


def drift(plucked: Plucked, seconds: float) -> float:
    """Cents by which free flight over so many seconds leaves any mode not yet below e⁻³⁰ from the float64 run's."""
    m = plucked.model
    steps = BLOCK * round(seconds / m.string.dt / BLOCK)
    heard = np.flatnonzero(m.modes.sigma * seconds < 30.0)
    phases = []
    for single in (True, False):
        one, _ = stretch(plucked, steps, flies=True, single=single)
        one.call()
        phases.append(one.q[heard] + 1j * one.v[heard] / m.modes.omega[heard])
    turned = np.angle(phases[0] / phases[1])
    return float(1200.0 / np.log(2.0) * np.abs(turned / (m.modes.omega[heard] * steps * m.string.dt)).max())
