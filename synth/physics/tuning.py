"""The tension that gives a string its pitch."""

import math
from dataclasses import replace
from functools import lru_cache

from synth.physics.modes import model_frequencies
from synth.physics.string import String, require_within

#: parts of a pitch or tension that are nothing but rounding
_ROUNDING = 1e-15


def tuned(string: String, frequency_hz: float) -> String:
    """The same string at the tension that puts its first mode ν_1 at frequency_hz [Hz].

    ν_1 is the model's (A1) with stiffness and nut mobility, met to 1e-12 relative. Measured values belong
    to the tension they were measured at: they are dropped. Where a strong nut resonance gives several
    tensions the same pitch, one near that with a rigid nut is taken. Raises ValueError when no tension
    gives the frequency.
    """
    require_within("frequency_hz", frequency_hz)
    string = replace(string, measured_frequencies_hz=(), measured_decay_rates=())
    tension = _rigid_nut_tension(string, frequency_hz)
    if string.nut:
        tension = _mobile_nut_tension(string, frequency_hz, tension)
    return string.with_tension(tension)


def _rigid_nut_tension(string: String, frequency_hz: float) -> float:
    """Tension [N] that solves ν_1 = frequency_hz for either law without mobility."""
    ideal = 4.0 * string.length_m**2 * string.linear_density_kg_m * frequency_hz**2
    bending = math.pi**2 * string.bending_stiffness_n_m2 / string.length_m**2  # B T, the same at any T
    if string.stiffness_law == "sqrt":
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


# kept, as a preset's strings are tuned when it is checked and again when it is compiled; a String is small
@lru_cache(maxsize=4096)
def _mobile_nut_tension(string: String, frequency_hz: float, start_n: float) -> float:
    """Regula falsi on log T (Illinois), in a bracket that grows around start_n until it holds a root."""
    target = 2.0 * math.pi * frequency_hz

    def sharp_by(log_ratio: float) -> float:
        tighter = string.with_tension(start_n * math.exp(log_ratio))
        return math.log(model_frequencies(tighter, 1)[0] / target)

    near, sharp_near = 0.0, sharp_by(0.0)
    far = math.copysign(1e-6, -sharp_near)
    while (sharp_far := sharp_by(far)) * sharp_near > 0.0:
        near, sharp_near, far = far, sharp_far, 2.0 * far
        if abs(far) > 1.5:
            raise ValueError(
                f"frequency_hz must be within reach of this nut, got {frequency_hz:g} Hz, "
                f"which no tension near {start_n:g} N gives; "
                "raise the mass_kg of the nut resonance nearest to it"
            )
    while abs(sharp_far) > _ROUNDING and abs(far - near) > _ROUNDING:
        root = far - sharp_far * (far - near) / (sharp_far - sharp_near)
        sharp_root = sharp_by(root)
        near, sharp_near = (far, sharp_far) if sharp_root * sharp_far < 0.0 else (near, 0.5 * sharp_near)
        far, sharp_far = root, sharp_root
    return start_n * math.exp(far)
