"""From a preset's `[[body.mode]]` to the arrays of `solver.coupling`: what strings share that end on one bridge."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from synth.instrument.preset import MovingMode, Preset, PresetError, StringTable, at_note
from synth.physics.body_modes import Body, BodyMode, BridgePlace
from synth.solver.coupling import MOST_STEPS
from synth.solver.laws import EXACT_HOLD, coefficients
from synth.units import db_to_gain

#: ΩH/2 up to which the ramp's share of a body mode is made up for
_FARTHEST = 0.45 * math.pi


@dataclass(frozen=True)
class Soundboard:
    """The modes of a body over frames of the output rate: M modes, D components of the bridge's motion, lines of strings.

    A mode is counted per unit of its motion; forces come to it, and its motion to the bridge, by its shape.
    """

    frame_s: float
    omega: np.ndarray  # (M,)
    sigma: np.ndarray  # (M,)
    mass: np.ndarray  # (M,) [kg]
    steps: np.ndarray  # (6, M) coefficients of a frame, of a force
    shape: np.ndarray  # (D, M)
    radiation: np.ndarray  # (2, M) left, right: output of an acceleration
    moves: (
        np.ndarray
    )  # (axes, M) the same of all that the bridge does, in `body_modes.AXES`, which strings may not tell apart
    direction: np.ndarray  # (lines, D); of strings that move in two directions one after the other
    hand: np.ndarray  # (M,) how each moves where a hand pushes on the body, `shape_at_hand`

    def heard(self, omega: np.ndarray, line: int) -> np.ndarray:
        """(N,) output, on the louder side, of a steady force of 1 N at these angular frequencies at a line's end."""
        w = omega[:, None]
        swing = -(w**2) / (self.mass * (self.omega**2 - w**2 + 2j * self.sigma * w)) * (self.direction[line] @ self.shape)
        return np.abs(swing @ self.radiation.T).max(axis=1)

    def felt(self, omega: np.ndarray, sigma: np.ndarray, stiffness: float, line: int) -> np.ndarray:
        """(N,) share by which modes ω, σ (N,) [1/s] of a line, T/L its stiffness [N/m], change how the bridge moves at their
        frequencies: |Y Z| of the body's mobility there and their impedance Z = T/(L σ), of which YZ/(1 + YZ) is missed
        where they are left out."""
        at = self.direction[line] @ self.shape
        w = omega[:, None]
        mobility = 1j * omega * np.sum(at**2 / (self.mass * (self.omega**2 - w**2 + 2j * self.sigma * w)), axis=1)
        return np.abs(mobility) * stiffness / sigma

    @property
    def swinging_bound(self) -> float:
        """|output| ≤ bound · √(Σ m (ṗ² + Ω²p²)) of modes that swing freely."""
        loudest = np.abs(self.radiation).max(axis=0)
        return float(np.sqrt(np.sum((loudest * self.omega) ** 2 / self.mass)))


def soundboard(preset: Preset, ends: list[tuple[StringTable, int]], rate_hz: float) -> Soundboard:
    """The body of a preset whose strings, (table, open note) each, end on its bridge.

    A mode at half the output rate or above is left out. The ramp of the bridge's motion, which takes sinc²(ΩH/2) off what a
    mode is given and gives, is made up for in the shapes.
    """
    frame = 1.0 / rate_hz
    modes = tuple(mode for mode in body_of(preset.body.mode).modes if mode.frequency_hz < 0.45 * rate_hz)
    if not modes:
        raise PresetError(f"{preset.name}: body.mode: no mode lies below {0.45 * rate_hz:g} Hz; give one, or a higher rate")
    body = Body(modes)
    omega, sigma, mass = body.omega, body.sigma, body.mass
    half = np.minimum(0.5 * omega * frame, _FARTHEST)
    shape = body.shapes / np.sinc(half / math.pi) ** 2
    steps = coefficients(EXACT_HOLD, omega, sigma, 1.0, frame)
    steps[4:] /= mass
    radiation = body.left_right(db_to_gain(preset.output.gain_db))
    direction, basis = spanned(directions_of(preset, ends, body.axes))
    distance = 0.0 if preset.hand.knock is None else 1e-3 * preset.hand.knock.distance_mm
    hand = shape_at_hand(body.shapes[0], omega, distance)
    return Soundboard(frame, omega, sigma, mass, steps, basis.T @ shape, radiation, shape, direction, hand)


#: directions of waves that are averaged over
_DIRECTIONS = 256
#: of a spruce top 2.8 mm thick: its bending stiffness [N m], the geometric mean of along and across the grain, and its mass
#: per area [kg/m²]; estimates
TOP_STIFFNESS_N_M, TOP_DENSITY_KG_M2 = 6.0, 1.2


def shape_at_hand(normal: np.ndarray, omega: np.ndarray, distance_m: float) -> np.ndarray:
    """(M,) how far modes move the top at a distance from the bridge, which they move by `normal` (M,).

    In a plate whose waves run in all directions, two places at distance d go together by J₀(k d), k = √(ω √(μ/D)); what does
    not is of either sign. Here that goes round by golden angles, a different one for every mode, with the same mean square.
    """
    k = np.sqrt(omega) * (TOP_DENSITY_KG_M2 / TOP_STIFFNESS_N_M) ** 0.25
    around = math.pi / _DIRECTIONS * (np.arange(_DIRECTIONS) + 0.5)
    together = np.cos(k[:, None] * distance_m * np.sin(around)).mean(axis=1)  # J₀
    turned = math.sqrt(2.0) * np.sin(math.pi * (3.0 - math.sqrt(5.0)) * np.arange(1, omega.size + 1))
    return np.ascontiguousarray(normal * (together + np.sqrt(1.0 - together**2) * turned))


def directions_of(preset: Preset, ends: list[tuple[StringTable, int]], components: int) -> np.ndarray:
    """B (lines, components) of strings, (table, open note) each; of two directions one after the other."""
    turns = (0.0,) if preset.polarisation is None else (0.0, 90.0)
    places = [
        BridgePlace(1e-3 * at_note(table.place_mm, note), at_note(table.angle_deg, note) + turn)
        for table, note in ends
        for turn in turns
    ]
    return np.array([place.direction(components) for place in places]).reshape(len(places), components)


def spanned(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of motions of a bridge in D components no more than its strings can tell apart: their directions (lines, D) in fewer
    components, and the orthonormal basis (D, fewer) of these."""
    basis = np.eye(direction.shape[1])[:, np.any(direction != 0.0, axis=0)]
    moved = direction @ basis
    rank = np.linalg.matrix_rank(moved)
    if rank < basis.shape[1]:
        basis = basis @ np.linalg.svd(moved, full_matrices=False)[2][:rank].T
    return np.ascontiguousarray(direction @ basis), basis


def body_of(modes: Sequence[MovingMode]) -> Body:
    """A body of the modes of a file, with as many components of the bridge's motion as any of them has."""
    components = max(len(mode.shape) for mode in modes)
    return Body(tuple(single for mode in modes for single in single_modes(mode, components)))


def single_modes(mode: MovingMode, components: int) -> tuple[BodyMode, ...]:
    """A mode, or those of a field, with so many components, those that are not given being zero."""
    shape = (*mode.shape, *(0.0,) * (components - len(mode.shape)))
    field = mode.field()
    if field is None:
        return (BodyMode(mode.frequency_hz, mode.q, mode.mass_kg, shape, mode.radiation, mode.pan),)
    return tuple(
        BodyMode(
            each.frequency_hz,
            each.q,
            mode.mass_kg,
            tuple(mean * psi for mean, psi in zip(shape, each.shape, strict=False)),
            mode.radiation * each.radiation,
            mode.pan * each.pan,
        )
        for each in field
    )


def step_count(wanted: int) -> int:
    """Internal steps of a frame for a string that wants so many: a power of two, at most `MOST_STEPS`."""
    return min(MOST_STEPS, 1 << max(0, math.ceil(math.log2(wanted))))
