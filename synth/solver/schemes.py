"""The schemes by name, a line on each, and where they are safe; plain, so that the command line can offer them at once."""

from __future__ import annotations

import math

#: contact laws of the block kernels: what `render` and the engine can play
LAWS: dict[str, str] = {
    "exact-hold": "contact force held over the step, Signorini condition on positions at its end",
    "moreau-jean": "Moreau–Jean with Newton's impact law, as printed by Issanchou et al. 2018",
    "moreau-jean-filtered": "the same with filtered impulses and predicted gap, as the authors' program runs it",
}
#: exact solutions, each for the cases that have one
EXACT: dict[str, str] = {
    "waveguide": "ideal string over points: travelling waves, Δt = Δx/c",
    "cabannes": "ideal string, centred triangle over a point at mid-string: closed form",
    "flat-wall": "ideal string, triangle over an elastic flat wall: closed form",
    "event-driven": "any string over one point: every landing and release found exactly",
}
#: compliant contacts, f = K [η − u]₊^α, on the exact modal two-step scheme
COMPLIANT: dict[str, str] = {
    "compliant": "power-law penalty by Newton–Raphson, energy kept (Issanchou et al. 2017)",
    "energy-quadratisation": "power-law penalty, one linear system a step (Ducceschi et al. 2021)",
    "scalar-auxiliary-variable": "power-law penalty, explicit (Bilbao, Ducceschi, Zama 2023)",
}
#: schemes of `simulate`
SCHEMES: dict[str, str] = {
    **LAWS,
    **EXACT,
    **COMPLIANT,
    "wall": "impulses at every node of the modal grid from an elastic, or rigid, wall along the string",
}
#: schemes of `simulate` for strings that share a body, beside exact-hold
ON_A_BODY: dict[str, str] = {
    "complex-modes": "strings on a body that touch nothing: complex modes of the whole instrument, exact at any time",
}

#: From these rates on no Moreau–Jean run of the project's cases held more energy than it began with: with restitution 0,
#: and with any. In both every mode has to lie below half the rate.
SAFE_MOREAU_JEAN_HZ = 1e6
SAFE_WITH_RESTITUTION_HZ = 4e6


def safe_rate_hz(scheme: str, restitution: float, highest_mode_hz: float = 0.0) -> float:
    """The internal rate [Hz] from which on a scheme is known not to gain energy; 0 for those that never do."""
    if not scheme.startswith("moreau-jean"):
        return 0.0
    return max(SAFE_MOREAU_JEAN_HZ if restitution == 0.0 else SAFE_WITH_RESTITUTION_HZ, 2.0 * highest_mode_hz)


def energy_warning(
    scheme: str, restitution: float, rate_hz: float, option: str, multiple_hz: float, highest_mode_hz: float = 0.0
) -> str | None:
    """What may happen at a rate below the safe one, and the remedy: `option` with a safe multiple of multiple_hz [Hz]."""
    safe = safe_rate_hz(scheme, restitution, highest_mode_hz)
    if rate_hz >= safe:
        return None
    return (
        f"{scheme} with restitution {restitution:g} can gain energy below about {safe / 1e6:.3g} MHz; "
        f"{option} {multiple_hz * math.ceil(safe / multiple_hz):.10g} is safer but slow"
    )


def rise_warning(scheme: str, rise: float) -> str | None:
    """What a step of a Moreau–Jean run gained, as a share of the energy, at a rate that `energy_warning` accepts.

    None for other schemes, and where `rise` is rounding or was not measured (NaN).
    """
    if not scheme.startswith("moreau-jean") or not rise > PASSIVE_TO:
        return None
    return (
        f"one step of {scheme} raised the energy by {rise:.1e} of itself: at this rate the string never exceeds its initial "
        "energy, but single steps may gain; exact-hold never gains"
    )


#: A step of exact-hold is passive to this share of the energy, unless a finger and a point clamp the string between them
PASSIVE_TO = 1e-12


def clamping_warning(rise: float, force_n: float) -> str | None:
    """Why exact-hold gained energy under a finger, and the remedy; None where a step's `rise` is rounding of the energy.

    Exact-hold's proof of passivity is one of exact numbers. Forces are found to 2e-16 of themselves, and what a step makes
    of that is G λ² · 2e-16, G what a contact gives way in a step [m/N]. A string that is free to move keeps G λ² below its
    energy. A finger that presses it on to a point which the modes leave no way round (fewer modes than contacts and
    finger, the finger upon the point) is met with its own spring's force instead, however great that is.
    """
    if not rise > PASSIVE_TO:
        return None
    return (
        f"one step raised the energy by {rise:.1e} of itself: a finger clamps the string on a point, and forces of "
        f'{force_n:.3g} N are rounded; set tail = "static", or use more modes or a lower stiffness_n_m'
    )
