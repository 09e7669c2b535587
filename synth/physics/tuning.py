"""The tension that gives a string its pitch."""

import math
from dataclasses import replace
from functools import lru_cache

from synth.physics.modes import model_frequencies
from synth.physics.string import String, require_within


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
    """Bisection on log T, from a bracket that grows around start_n until it holds a root."""
    target = 2.0 * math.pi * frequency_hz

    def is_sharp(log_ratio: float) -> bool:
        tighter = string.with_tension(start_n * math.exp(log_ratio))
        return bool(model_frequencies(tighter, 1)[0] > target)

    sharp = is_sharp(0.0)
    near, far = 0.0, -1e-6 if sharp else 1e-6
    while is_sharp(far) == sharp:
        near, far = far, 2.0 * far
        if abs(far) > 1.5:
            raise ValueError(
                f"frequency_hz must be within reach of this nut, got {frequency_hz:g} Hz, "
                f"which no tension near {start_n:g} N gives; "
                "raise the mass_kg of the nut resonance nearest to it"
            )
    while abs(far - near) > 1e-15:
        middle = 0.5 * (near + far)
        if middle in (near, far):
            break
        near, far = (middle, far) if is_sharp(middle) == sharp else (near, middle)
    return start_n * math.exp(0.5 * (near + far))
