"""A stiff, lossy, simply supported string and the resonances of what holds its end.

    μ u_tt − T u_xx + EI u_xxxx = f(x, t),   0 ≤ x ≤ L

Source: Issanchou, Acary, Pérignon, Touzé, Le Carrou, "Nonsmooth contact dynamics for the numerical simulation
of collisions in musical string instruments", JASA 143(5), 2018 ("IA2018"), section II and appendix. This file
describes; frequencies, decay rates and shapes are computed in `modes`.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal, Self

StiffnessLaw = Literal["sqrt", "linear"]
STIFFNESS_LAWS: tuple[str, ...] = ("sqrt", "linear")


@dataclass(frozen=True)
class NutResonance:
    """One resonance of the structure at the string's end x = 0 (neck, headstock).

    frequency_hz   resonance frequency ω_n/2π [Hz]
    q              quality factor Q
    modal_mass_kg  modal mass m seen by the string at that end [kg]

    Raises ValueError unless all three are finite and > 0.
    """

    frequency_hz: float
    q: float
    modal_mass_kg: float

    def __post_init__(self) -> None:
        for name, unit in (("frequency_hz", " Hz"), ("q", ""), ("modal_mass_kg", " kg")):
            _require_positive(f"nut resonance {name}", getattr(self, name), unit)


@dataclass(frozen=True)
class String:
    """One string in SI units.

    length_m, tension_n, linear_density_kg_m   L [m], T [N], μ [kg/m]
    bending_stiffness_n_m2   EI [N m²]; 0 for an ideal string. Of a wound string, that of the core (IA2018 A4)
    diameter_m               outer diameter d [m]; the air damps through it
    core_diameter_m, winding_diameter_m   of a wound string, both or none: the core and the *wire* wound
                             round it [m]; d_eq (A5) then takes the place of d in the air damping
    viscoelastic_loss        δ_ve, loss angle of the core material
    thermoelastic_q_inverse  Q_te⁻¹
    air_viscosity, air_density   η_air [kg/(m s)], ρ_air [kg/m³]
    stiffness_law            "sqrt": ν_j ∝ j√(1 + Bj²), the exact law of a pinned stiff string; "linear": the
                             paper's j(1 + Bj²/2) (A1), which agrees with it only while Bj² ≪ 1
    nut                      resonances whose mobilities add up to Y_nut; empty: a rigid end
    measured_frequencies_hz  frequencies of modes 1 … m [Hz]; the model goes on behind them
    measured_decay_rates     σ of modes 1 … m [1/s], amplitude e^(−σt); m need not be the same

    Raises ValueError naming field, condition, value and remedy.
    """

    length_m: float
    tension_n: float
    linear_density_kg_m: float
    bending_stiffness_n_m2: float
    diameter_m: float
    core_diameter_m: float | None = None
    winding_diameter_m: float | None = None
    viscoelastic_loss: float = 0.0
    thermoelastic_q_inverse: float = 0.0
    air_viscosity: float = 1.8e-5
    air_density: float = 1.2
    stiffness_law: StiffnessLaw = "sqrt"
    nut: tuple[NutResonance, ...] = ()
    measured_frequencies_hz: tuple[float, ...] = ()
    measured_decay_rates: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        # Lists and arrays are welcome; what is kept is hashable and cannot change.
        object.__setattr__(self, "nut", tuple(self.nut))
        for name in ("measured_frequencies_hz", "measured_decay_rates"):
            object.__setattr__(self, name, tuple(float(value) for value in getattr(self, name)))

        for name, unit in (
            ("length_m", " m"),
            ("tension_n", " N"),
            ("linear_density_kg_m", " kg/m"),
            ("diameter_m", " m"),
        ):
            _require_positive(name, getattr(self, name), unit)
        for name, unit in (
            ("bending_stiffness_n_m2", " N m²"),
            ("viscoelastic_loss", ""),
            ("thermoelastic_q_inverse", ""),
            ("air_viscosity", " kg/(m s)"),
            ("air_density", " kg/m³"),
        ):
            _require(name, getattr(self, name), lambda v: v >= 0.0, f">= 0{unit}", "0 switches the effect off")
        if self.stiffness_law not in STIFFNESS_LAWS:
            raise ValueError(f"stiffness_law must be 'sqrt' or 'linear', got {self.stiffness_law!r}")
        self._check_winding()
        _require_measured("measured_frequencies_hz", self.measured_frequencies_hz, " Hz")
        _require_measured("measured_decay_rates", self.measured_decay_rates, " 1/s")

    def _check_winding(self) -> None:
        if (self.core_diameter_m is None) != (self.winding_diameter_m is None):
            raise ValueError(
                "core_diameter_m and winding_diameter_m must be given together, "
                f"got {self.core_diameter_m} and {self.winding_diameter_m}; leave both out for a plain string"
            )
        if self.core_diameter_m is not None and self.winding_diameter_m is not None:
            _require_positive("core_diameter_m", self.core_diameter_m, " m")
            _require_positive("winding_diameter_m", self.winding_diameter_m, " m")
            if self.core_diameter_m >= self.diameter_m:
                raise ValueError(
                    f"core_diameter_m must be less than diameter_m = {self.diameter_m:g} m, "
                    f"got {self.core_diameter_m:g} m; diameter_m is the outer one"
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
        _require("inharmonicity", inharmonicity, lambda b: b >= 0.0, ">= 0", "0 is a string without stiffness")
        _require_positive("length_m", length_m, " m")
        _require_positive("tension_n", tension_n, " N")
        stiffness = inharmonicity * tension_n * length_m**2 / math.pi**2
        return cls(length_m, tension_n, linear_density_kg_m, stiffness, diameter_m, **others)

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

    def with_length(self, length_m: float) -> Self:
        """The same string stopped to another speaking length [m]: same T, μ, EI, losses and nut resonances.

        Measured values belong to the length they were measured at: another length drops them.
        """
        if length_m == self.length_m:
            return self
        return replace(self, length_m=length_m, measured_frequencies_hz=(), measured_decay_rates=())

    def tuned(self, frequency_hz: float) -> Self:
        """The same string at the tension that puts its first mode ν_1 at frequency_hz [Hz].

        ν_1 is the model's (A1) with stiffness and nut mobility, met to 1e-12 relative. Measured values belong
        to the tension they were measured at: they are dropped. Where a strong nut resonance gives several
        tensions the same pitch, one near that with a rigid nut is taken. Raises ValueError when no tension
        gives the frequency.
        """
        _require_positive("frequency_hz", frequency_hz, " Hz")
        string = replace(self, measured_frequencies_hz=(), measured_decay_rates=())
        tension = string._rigid_nut_tension(frequency_hz)
        if string.nut:
            tension = string._mobile_nut_tension(frequency_hz, tension)
        return replace(string, tension_n=tension)

    def _rigid_nut_tension(self, frequency_hz: float) -> float:
        """Tension [N] that solves ν_1 = frequency_hz for either law without mobility."""
        ideal = 4.0 * self.length_m**2 * self.linear_density_kg_m * frequency_hz**2
        bending = math.pi**2 * self.bending_stiffness_n_m2 / self.length_m**2  # B T, the same at any T
        if self.stiffness_law == "sqrt":
            tension = ideal - bending
        else:
            # √T solves T − √(ideal)·√T + bending/2 = 0; the greater root is the string, the lesser a bar
            root = ideal - 2.0 * bending
            tension = (math.sqrt(ideal) + math.sqrt(root)) ** 2 / 4.0 if root > 0.0 else 0.0
        if not tension > 0.0:
            raise ValueError(
                f"frequency_hz must be above what bending stiffness alone gives, got {frequency_hz:g} Hz; "
                "take a lower bending_stiffness_n_m2 or a longer string"
            )
        return tension

    def _mobile_nut_tension(self, frequency_hz: float, start_n: float) -> float:
        """Bisection on log T, from a bracket that grows around start_n until it holds a root."""
        from synth.physics.modes import model_frequencies  # modes needs String; only this method needs modes

        target = 2.0 * math.pi * frequency_hz

        def is_sharp(log_ratio: float) -> bool:
            string = replace(self, tension_n=start_n * math.exp(log_ratio))
            return bool(model_frequencies(string, 1)[0] > target)

        sharp = is_sharp(0.0)
        near, far = 0.0, -1e-6 if sharp else 1e-6
        while is_sharp(far) == sharp:
            near, far = far, 2.0 * far
            if abs(far) > 1.5:
                raise ValueError(
                    f"frequency_hz must be within reach of this nut, got {frequency_hz:g} Hz, "
                    f"which no tension near {start_n:g} N gives; "
                    "raise the modal_mass_kg of the nut resonance nearest to it"
                )
        while abs(far - near) > 1e-15:
            middle = 0.5 * (near + far)
            if middle in (near, far):
                break
            near, far = (middle, far) if is_sharp(middle) == sharp else (near, middle)
        return start_n * math.exp(0.5 * (near + far))


def _require(name: str, value: float, holds: Callable[[float], bool], condition: str, remedy: str) -> None:
    try:
        fine = math.isfinite(value) and holds(value)
    except TypeError:
        fine = False
    if not fine:
        raise ValueError(f"{name} must be a number {condition}, got {value!r}; {remedy}")


def _require_positive(name: str, value: float, unit: str) -> None:
    _require(name, value, lambda v: v > 0.0, f"> 0{unit}", "check the unit")


def _require_measured(name: str, values: Iterable[float], unit: str) -> None:
    for mode, value in enumerate(values, start=1):
        _require(f"{name} of mode {mode}", value, lambda v: v > 0.0, f"> 0{unit}", "end the list before that mode")
