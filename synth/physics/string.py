"""A stiff, lossy, simply supported string and the resonances of what holds its end.

    μ u_tt − T u_xx + EI u_xxxx = f(x, t),   0 ≤ x ≤ L

Source: Issanchou, Acary, Pérignon, Touzé, Le Carrou, "Nonsmooth contact dynamics for the numerical simulation
of collisions in musical string instruments", JASA 143(5), 2018 ("IA2018"), section II and appendix. This file
describes; frequencies, decay rates and shapes are computed in `modes`.
"""

import copy
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np

#: how partials stretch: √(1 + Bj²), or 1 + Bj²/2
StiffnessLaw = Literal["sqrt", "linear"]
#: the same as values
STIFFNESS_LAWS: tuple[str, ...] = ("sqrt", "linear")

#: Least and greatest value of what describes a string, 0 where an effect may be absent; far beyond all that was ever
#: strung, and so far within floating point that nothing made of them overflows. What a slip of units gives lies outside.
LIMITS: dict[str, tuple[float, float, str]] = {
    "length_m": (1e-4, 1e4, " m"),
    "tension_n": (1e-9, 1e9, " N"),
    "linear_density_kg_m": (1e-12, 1e6, " kg/m"),
    "diameter_m": (1e-12, 1e2, " m"),
    "core_diameter_m": (1e-12, 1e2, " m"),
    "winding_diameter_m": (1e-12, 1e2, " m"),
    "bending_stiffness_n_m2": (0.0, 1e12, " N m²"),
    "inharmonicity": (0.0, 1e12, ""),
    "viscoelastic_loss": (0.0, 1e6, ""),
    "thermoelastic_q_inverse": (0.0, 1e6, ""),
    "air_viscosity": (0.0, 1e6, " kg/(m s)"),
    "air_density": (0.0, 1e6, " kg/m³"),
    "mass_scatter": (0.0, 1.0, ""),
    "frequency_hz": (1e-6, 1e9, " Hz"),
    "q": (1e-6, 1e12, ""),
    "mass_kg": (1e-9, 1e9, " kg"),
    "measured_frequencies_hz": (1e-6, 1e12, " Hz"),
    "measured_decay_rates": (1e-12, 1e12, " 1/s"),
}


@dataclass(frozen=True)
class NutResonance:
    """One resonance of the structure at the string's end x = 0 (neck, headstock).

    frequency_hz   resonance frequency ω_n/2π [Hz]
    q              quality factor Q
    mass_kg  modal mass m seen by the string at that end [kg]
    across_mass_kg  the same of a string that moves at right angles to its first direction [kg]; None: as `mass_kg`

    Raises ValueError unless all are within LIMITS.
    """

    frequency_hz: float
    q: float
    mass_kg: float
    across_mass_kg: float | None = None

    def __post_init__(self) -> None:
        for name in ("frequency_hz", "q", "mass_kg"):
            require_within(name, getattr(self, name), f"nut resonance {name}")
        if self.across_mass_kg is not None:
            require_within("mass_kg", self.across_mass_kg, "nut resonance across_mass_kg")


@dataclass(frozen=True, kw_only=True)
class StringLosses:
    """What damps a string apart from its ends; see `String`."""

    viscoelastic_loss: float = 0.0
    thermoelastic_q_inverse: float = 0.0
    air_viscosity: float = 1.8e-5
    air_density: float = 1.2


@dataclass(frozen=True)
class String(StringLosses):
    """One string in SI units; frequencies, decay rates and shapes of its modes: `synth.physics.modes`.

    Parameters
    ----------
    length_m, tension_n, linear_density_kg_m : float
        L [m], T [N], μ [kg/m].
    bending_stiffness_n_m2 : float
        EI [N m²]; 0 for an ideal string. Of a wound string, that of the core (IA2018 A4).
    diameter_m : float
        Outer diameter d [m]; the air damps through it.
    core_diameter_m, winding_diameter_m : float, optional
        Of a wound string, both or none: the core and the *wire* wound round it [m]; d_eq (A5) then takes the place of d in
        the air damping.
    viscoelastic_loss, thermoelastic_q_inverse : float
        δ_ve, loss angle of the core material, and Q_te⁻¹.
    air_viscosity, air_density : float
        η_air [kg/(m s)], ρ_air [kg/m³].
    stiffness_law : str
        "sqrt": ν_j ∝ j√(1 + Bj²), the exact law of a pinned stiff string; "linear": the paper's j(1 + Bj²/2) (A1), which
        agrees with it only while Bj² ≪ 1.
    mass_scatter, seed : float, int
        Standard deviation of the relative mass of pieces of the string, and which string of those it is (`uneven_mass`); 0
        for an even one.
    nut : sequence of NutResonance
        Resonances whose mobilities add up to Y_nut; empty: a rigid end.
    measured_frequencies_hz, measured_decay_rates : sequence of float
        Frequencies [Hz] and σ [1/s], amplitude e^(−σt), of modes 1 … m, which need not be equally many; the model goes on
        behind them.

    Raises
    ------
    ValueError
        Naming field, condition, value and remedy; what is possible says `synth.physics.string.LIMITS`.

    References
    ----------
    Issanchou, Acary, Pérignon, Touzé, Le Carrou, JASA 143(5), 2018 (IA2018), section II and appendix.

    Examples
    --------
    >>> import synth
    >>> string = synth.String.from_inharmonicity(0.65, 70.0, 1e-3, 2e-5, 4e-4)
    >>> round(string.fundamental_hz, 2), round(string.wave_speed_m_s, 2)
    (203.52, 264.58)
    """

    length_m: float
    tension_n: float
    linear_density_kg_m: float
    bending_stiffness_n_m2: float
    diameter_m: float
    core_diameter_m: float | None = None
    winding_diameter_m: float | None = None
    stiffness_law: StiffnessLaw = "sqrt"
    mass_scatter: float = 0.0
    seed: int = 0
    nut: tuple[NutResonance, ...] = field(default=(), hash=False)  # dozens; strings that differ in nothing else are few
    measured_frequencies_hz: tuple[float, ...] = ()
    measured_decay_rates: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        # Lists and arrays are welcome; what is kept is hashable and cannot change.
        object.__setattr__(self, "nut", tuple(self.nut))
        for name in ("measured_frequencies_hz", "measured_decay_rates"):
            object.__setattr__(self, name, tuple(float(value) for value in getattr(self, name)))

        for name in ("length_m", "tension_n", "linear_density_kg_m", "diameter_m", "bending_stiffness_n_m2"):
            require_within(name, getattr(self, name))
        for name in (*StringLosses.__dataclass_fields__, "mass_scatter"):
            require_within(name, getattr(self, name))
        if self.stiffness_law not in STIFFNESS_LAWS:
            raise ValueError(f"stiffness_law must be 'sqrt' or 'linear', got {self.stiffness_law!r}")
        self._check_winding()
        for name in ("measured_frequencies_hz", "measured_decay_rates"):
            for mode, value in enumerate(getattr(self, name), start=1):
                require_within(name, value, f"{name} of mode {mode}", "end the list before that mode")
        self._check_derived()

    def _check_winding(self) -> None:
        if (self.core_diameter_m is None) != (self.winding_diameter_m is None):
            raise ValueError(
                "core_diameter_m and winding_diameter_m must be given together, "
                f"got {self.core_diameter_m} and {self.winding_diameter_m}; leave both out for a plain string"
            )
        if self.core_diameter_m is not None and self.winding_diameter_m is not None:
            require_within("core_diameter_m", self.core_diameter_m)
            require_within("winding_diameter_m", self.winding_diameter_m)
            if self.core_diameter_m >= self.diameter_m:
                raise ValueError(
                    f"core_diameter_m must be less than diameter_m = {self.diameter_m:g} m, "
                    f"got {self.core_diameter_m:g} m; diameter_m is the outer one"
                )

    def _check_derived(self) -> None:
        """Numbers that are possible each by itself may describe no string together."""
        low, high, _ = LIMITS["frequency_hz"]
        if not low <= self.fundamental_hz <= high:
            raise ValueError(
                f"tension_n and linear_density_kg_m must put √(T/μ)/2L between {low:g} and {high:g} Hz, got "
                f"{self.tension_n:g} N and {self.linear_density_kg_m:g} kg/m on {self.length_m:g} m, "
                f"{self.fundamental_hz:.3g} Hz; check the units"
            )
        if self.inharmonicity > LIMITS["inharmonicity"][1]:
            raise ValueError(
                "bending_stiffness_n_m2 must keep the inharmonicity π²EI/(TL²) below "
                f"{LIMITS['inharmonicity'][1]:g}, got {self.bending_stiffness_n_m2:g} N m², {self.inharmonicity:.3g}; "
                "check the unit"
            )

    @classmethod
    def from_inharmonicity(
        cls,
        length_m: float,
        tension_n: float,
        linear_density_kg_m: float,
        inharmonicity: float,
        diameter_m: float,
        **others: Any,
    ) -> Self:
        """The string whose bending stiffness is EI = B T L²/π² [IA2018 A1], B the inharmonicity.

        others: String's remaining fields, by name.
        """
        require_within("inharmonicity", inharmonicity, remedy="0 is a string without stiffness")
        string = cls(length_m, tension_n, linear_density_kg_m, 0.0, diameter_m, **others)
        return replace(string, bending_stiffness_n_m2=inharmonicity * tension_n * length_m**2 / math.pi**2)

    @property
    def wave_speed_m_s(self) -> float:
        """c = √(T/μ) [m/s]."""
        return math.sqrt(self.tension_n / self.linear_density_kg_m)

    @property
    def fundamental_hz(self) -> float:
        """c/2L [Hz]: the ideal string's, without stiffness, mobility or measured values."""
        return self.wave_speed_m_s / (2.0 * self.length_m)

    @property
    def inharmonicity(self) -> float:
        """B = π²EI/(TL²) [IA2018 A1]."""
        return math.pi**2 * self.bending_stiffness_n_m2 / (self.tension_n * self.length_m**2)

    @property
    def impedance_kg_s(self) -> float:
        """Characteristic impedance √(Tμ) [kg/s]."""
        return math.sqrt(self.tension_n * self.linear_density_kg_m)

    @property
    def equivalent_diameter_m(self) -> float:
        """What the air sees [m]: d; if wound, d_eq = (π/2)[(1 + 2/π) 2r_winding + 2r_core] [IA2018 A5]."""
        if self.core_diameter_m is None or self.winding_diameter_m is None:
            return self.diameter_m
        return math.pi / 2 * ((1 + 2 / math.pi) * self.winding_diameter_m + self.core_diameter_m)

    @cached_property
    def nut_rows(self) -> np.ndarray:
        """(3, R) angular frequencies [rad/s], modal masses [kg] and quality factors of the nut's resonances."""
        return np.array([(2.0 * math.pi * mode.frequency_hz, mode.mass_kg, mode.q) for mode in self.nut]).T

    def with_tension(self, tension_n: float) -> Self:
        """The same string at another tension [N]; only what depends on it is checked."""
        require_within("tension_n", tension_n)
        if self.nut:
            _ = self.nut_rows  # which the copy has, too
        other = copy.copy(self)
        object.__setattr__(other, "tension_n", tension_n)
        other._check_derived()
        return other

    def with_length(self, length_m: float) -> Self:
        """The same string stopped to another speaking length [m]: same T, μ, EI, losses and nut resonances.

        Measured values belong to the length they were measured at: another length drops them.
        """
        if length_m == self.length_m:
            return self
        return replace(self, length_m=length_m, measured_frequencies_hz=(), measured_decay_rates=())


def _require(name: str, value: float, holds: Callable[[float], bool], condition: str, remedy: str) -> None:
    try:
        fine = math.isfinite(value) and holds(value)
    except TypeError:
        fine = False
    if not fine:
        raise ValueError(f"{name} must be a number {condition}, got {value!r}; {remedy}")


def require_within(field: str, value: float, name: str | None = None, remedy: str | None = None) -> None:
    """Refuses what is not within LIMITS[field]; `name` is what the message calls it."""
    low, high, unit = LIMITS[field]
    if type(value) is float and low <= value <= high:
        return
    least = f"> 0{unit}" if low > 0.0 else f">= 0{unit}"
    remedy = remedy or ("check the unit" if low > 0.0 else "0 switches the effect off")
    _require(name or field, value, lambda v: v > 0.0 or v == low, least, remedy)
    _require(name or field, value, lambda v: low <= v <= high, f"from {low:g} to {high:g}{unit}", "check the unit")
