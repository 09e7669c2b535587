"""The body that strings share: its modes as the bridge sees them, and where on the bridge a string stands.

The bridge moves by β (D,), D ≤ 3: normal to the top [m], lateral [m], rocking about the strings' direction [rad]. Mode m
moves it by ψ_m p_m and obeys

    m_m (p̈ + 2Σ_m ṗ + Ω_m² p) = ψ_m · F,    Ω = 2π·frequency_hz,    Σ = Ω/(2Q)

under the forces F (N, N, N m) at the reference point of the bridge. The mobility Σ_m iω ψψᵀ/(m(Ω² + 2iωΣ − ω²)) of positive
masses is passive whatever the numbers are. The resonances of `dsp.body` are a filter of the sound behind strings with rigid
ends; these move, and take from the strings what they give to the air.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from synth import panning
from synth.physics.string import require_within

#: what the components of β and of a mode's shape are
AXES = ("normal", "lateral", "rocking")


@dataclass(frozen=True)
class BodyMode:
    """One mode of the body.

    frequency_hz  Ω/2π [Hz]
    q             quality factor
    mass_kg       modal mass of the shape as it is given [kg]
    shape         ψ (D,): normal, lateral [1], rocking [rad/m] at the reference point; strings feel ψψᵀ/mass_kg alone
    radiation     weight of the mode's acceleration in the sound
    pan           −1 left … 1 right

    Raises ValueError naming field, condition, value and remedy; frequency_hz, q and mass_kg as `string.LIMITS` has them.
    """

    frequency_hz: float
    q: float
    mass_kg: float
    shape: tuple[float, ...] = (1.0,)
    radiation: float = 1.0
    pan: float = 0.0

    def __post_init__(self) -> None:
        for name in ("frequency_hz", "q", "mass_kg"):
            require_within(name, getattr(self, name), f"body mode {name}")
        object.__setattr__(self, "shape", tuple(float(value) for value in self.shape))
        if not 1 <= len(self.shape) <= len(AXES):
            raise ValueError(
                f"body mode shape must have 1 to {len(AXES)} components ({', '.join(AXES)}), got {len(self.shape)}"
            )
        if not all(math.isfinite(value) for value in self.shape) or not any(self.shape):
            raise ValueError(
                f"body mode shape must be finite and move the bridge, got {list(self.shape)}; leave out a mode that does not"
            )
        if not math.isfinite(self.radiation):
            raise ValueError(f"body mode radiation must be finite, got {self.radiation}; 0 is a mode that is not heard")
        if not -1.0 <= self.pan <= 1.0:
            raise ValueError(f"body mode pan must be from -1 (left) to 1 (right), got {self.pan}")


@dataclass(frozen=True)
class Body:
    """Modes (M,), at least one, whose shapes have equally many components. Raises ValueError otherwise."""

    modes: tuple[BodyMode, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "modes", tuple(self.modes))
        if not self.modes:
            raise ValueError("body must have at least one mode, got none; a string without a body has rigid ends")
        for number, mode in enumerate(self.modes, start=1):
            if len(mode.shape) != self.axes:
                raise ValueError(
                    f"shape of body mode {number} must have {self.axes} components as that of mode 1, "
                    f"got {len(mode.shape)}; give 0 where a mode does not move"
                )

    @property
    def axes(self) -> int:
        """D, components of β."""
        return len(self.modes[0].shape)

    @property
    def omega(self) -> NDArray[np.float64]:
        """Ω (M,) [rad/s]."""
        return 2.0 * math.pi * np.array([mode.frequency_hz for mode in self.modes])

    @property
    def sigma(self) -> NDArray[np.float64]:
        """Σ (M,) [1/s]."""
        return self.omega / (2.0 * np.array([mode.q for mode in self.modes]))

    @property
    def mass(self) -> NDArray[np.float64]:
        """m (M,) [kg]."""
        return np.array([mode.mass_kg for mode in self.modes])

    def left_right(self, gain: float = 1.0) -> NDArray[np.float64]:
        """(2, M) what the modes' accelerations give on the left and on the right, the same power wherever they are heard."""
        heard = gain * np.array([mode.radiation for mode in self.modes])
        return math.sqrt(2.0) * heard * panning.shares([mode.pan for mode in self.modes])

    @property
    def shapes(self) -> NDArray[np.float64]:
        """Ψ (D, M)."""
        return np.array([mode.shape for mode in self.modes]).T

    def compliance(self, s: ArrayLike) -> NDArray[np.complex128]:
        """β per force at the complex frequency s [1/s], any shape → (…, D, D): Σ_m ψψᵀ/(m(s² + 2Σs + Ω²))."""
        s = np.asarray(s, dtype=np.complex128)[..., None]
        gains = 1.0 / (self.mass * (s**2 + 2.0 * self.sigma * s + self.omega**2))
        return np.einsum("im,...m,jm->...ij", self.shapes, gains, self.shapes)

    def mobility(self, omega: ArrayLike) -> NDArray[np.complex128]:
        """β̇ per force at ω [rad/s], any shape → (…, D, D), for e^(+iωt); m/(N s), rocking rad/(N s) and rad/(N m s)."""
        s = 1j * np.asarray(omega, dtype=np.float64)
        return s[..., None, None] * self.compliance(s)


@dataclass(frozen=True)
class BridgePlace:
    """Where on the bridge a string stands, and in which direction a polarisation of it moves.

    offset_m   distance across the strings from the reference point [m]: rocking by 1 rad lifts the string by so much
    angle_deg  of the polarisation, 0 normal to the top, 90 lateral

    Raises ValueError for numbers that are not finite.
    """

    offset_m: float = 0.0
    angle_deg: float = 0.0

    def __post_init__(self) -> None:
        for name, unit in (("offset_m", " m"), ("angle_deg", "°")):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"bridge place {name} must be finite, got {getattr(self, name)}{unit}")

    def direction(self, axes: int) -> NDArray[np.float64]:
        """B (D,): b = B·β is the bridge's motion along the polarisation [m], and a force f along it gives F = B f."""
        normal, lateral = math.cos(math.radians(self.angle_deg)), math.sin(math.radians(self.angle_deg))
        return np.array([normal, lateral, self.offset_m * normal])[:axes]
