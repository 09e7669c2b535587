"""From a scene and a quality to internal rate and modes.

A quality is a promise, and what keeps it depends on what the string meets:

free      nothing: the modes are exact at any rate.
bridge    one point within 3 % of an end, and so near it that the string's stiffness rounds what rolls over it: the
          bending length √(EI/T) is at least 0.07 of the point's distance from the end. The string rests on it for much
          of each period and the error shrinks smoothly with the rate; promised is e over 3 s, the measure of Issanchou
          et al. 2018.
far       such a point, but the string is plucked beyond its middle, nearer to the other end. The corner comes back from
          there as a short, high pulse that throws the string on to the point, the harder the nearer to that end it began:
          a few blows a period among the rolling. Promised is what is promised of a bridge; it takes a higher rate. Neither
          the height of the point nor the size of the pluck decides: with a point raised into the string, plucked close
          to it, the rates of a bridge suffice.
curved    several points that are one curved bridge, over which the string wraps and unwraps without blows. It takes the
          rates of a bridge of one point; nothing is promised of it.
impacts   any other points: short blows, each of which magnifies what two runs differ by. After some of them the
          motion is chaotic: runs at several times the highest rate offered here differ as signals too. Promised are e
          over the first 100 ms and the log-spectral distance over the note where converged runs agree in them, and where
          they do not, levels in third octaves over the note, in which they still agree.

A promise is what 95 % of random scenes keep (`KEPT`), not a bound: the rates come from `calibration`, which
tools/calibrate-plan measures on random strings; tests/test_promise.py holds them against others, of which at most one in
twenty may miss, by no more than a factor 2. The modes are all below half the internal rate. A string of a preset that was
itself measured (`planfile`) takes what was found there instead (`measured_plan`).

A wall under a stretch of the string is planned by what an elastic wall does to it (`plan_wall`): the grid has to resolve the
length over which the string straightens on it, and the step the time of a contact (tools/wall-study).

Strings that share a body: `coupled_plan`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from synth.dsp.rates import MAXIMUM_FACTOR
from synth.instrument.calibration import STEPS
from synth.instrument.planfile import Measured
from synth.instrument.qualities import FLOAT32, FLOAT64, QUALITIES
from synth.physics.modes import count_modes_below
from synth.physics.string import String

MAX_MODES = 2000
#: how far from an end a single point is still a bridge, over the string's length, and what part of that distance the
#: bending length must be: among random strings near an end, converged runs differed where it was less
BRIDGE_REACH, BRIDGE_STIFFNESS = 0.03, 0.07
FREE, BRIDGE, CURVED, FAR, IMPACTS = "free", "bridge", "curved", "far", "impacts"
#: kinds of scenes whose promise is e over 3 s; of a curved bridge nothing is promised, and it is held to that
ROLLING = (BRIDGE, FAR, CURVED)
#: the part of random scenes that keeps a promise
KEPT = 0.95
IN_HOW_MANY = f"in {100.0 * KEPT:g} % of random scenes"
#: largest e over 3 s, of `FAR` too
BRIDGE_ERROR = {"draft": 0.3, "standard": 0.1, "fine": 0.02}
#: largest log-spectral distance over the note [dB]
IMPACT_DISTANCE_DB = {"draft": 6.0, "standard": 3.0, "fine": 1.5}
#: largest e over the first 100 ms
IMPACT_ONSET_ERROR = {"standard": 0.3, "fine": 0.1}
#: largest distance in third octaves over the note [dB]: where the motion is chaotic no rate comes nearer
IMPACT_BANDS_DB = {"draft": 4.0, "standard": 2.5, "fine": 2.5}


@dataclass(frozen=True)
class StringPlan:
    """What one string gets: its internal rate is `factor` times the output rate."""

    quality: str
    scheme: str
    factor: int
    rate_hz: float
    modes: int
    contacts: int
    error: str
    #: up to where modes were measured to be needed [Hz]; None: by the law, all below half the internal rate
    highest_hz: float | None = None

    @property
    def measured(self) -> bool:
        """Whether this very string was measured; else the law for all strings has planned it."""
        return self.highest_hz is not None

    @property
    def reason(self) -> str:
        """One sentence that explains the choice."""
        modes = "below half of it" if self.highest_hz is None else f"up to {self.highest_hz / 1e3:.3g} kHz"
        return (
            f"{self.contacts} contact{'' if self.contacts == 1 else 's'}: {self.rate_hz / 1e3:.1f} kHz "
            f"({self.factor} × output), {self.modes} modes {modes}; {self.error}"
        )


def scene_kind(string: String, positions_m: Sequence[float], plucks_m: Sequence[float] = (), *, curved: bool = False) -> str:
    """FREE, BRIDGE, CURVED, FAR or IMPACTS for points of contact at these places of a string, plucked at those; none are
    known: near the contact. `curved`: several points are those of one bridge."""
    if len(positions_m) == 0:
        return FREE
    distance = min(positions_m[0], string.length_m - positions_m[0])
    bending_length = math.sqrt(string.bending_stiffness_n_m2 / string.tension_n)
    near = distance <= BRIDGE_REACH * string.length_m and bending_length >= BRIDGE_STIFFNESS * distance
    if len(positions_m) > 1 and curved:
        return CURVED
    if len(positions_m) > 1 or not near:
        return IMPACTS
    middle = 0.5 * string.length_m
    return FAR if any((pluck > middle) != (positions_m[0] > middle) and pluck != middle for pluck in plucks_m) else BRIDGE


def promise(kind: str, quality: str) -> str:
    """What the quality promises of such a scene, in words, and of how many of them."""
    if kind == FREE:
        return "exact"
    if kind == CURVED:
        return "not calibrated on a curved bridge"
    if quality == "reference":
        return "as close as converged runs"
    return f"{limits(kind, quality)}{'' if kind in (BRIDGE, FAR) else ','} {IN_HOW_MANY}"


def limits(kind: str, quality: str) -> str:
    """The largest measures of a scene that is not free, in words; a curved bridge is held to those of one point."""
    if kind in (BRIDGE, FAR, CURVED):
        return f"e < {BRIDGE_ERROR[quality]:g} over 3 s"
    onset = f"e < {IMPACT_ONSET_ERROR[quality]:g} over 0.1 s, " if quality in IMPACT_ONSET_ERROR else ""
    return (
        f"{onset}log-spectral distance < {IMPACT_DISTANCE_DB[quality]:g} dB, "
        f"where chaotic third octaves within {IMPACT_BANDS_DB[quality]:g} dB"
    )


def wanted_rate_hz(fundamental_hz: float, kind: str, quality: str) -> float:
    """The internal rate that keeps the promise [Hz]; 0: any."""
    if kind == FREE:
        return 0.0
    return STEPS[BRIDGE if kind == CURVED else kind][quality] * fundamental_hz


def choose_factor(
    fundamental_hz: float,
    kind: str,
    quality: str,
    rate_hz: float,
    internal_rate_hz: float | None = None,
    *,
    decimated: bool = True,
) -> tuple[int, str]:
    """(factor, promise) for one string in a scene of this `kind`.

    `internal_rate_hz` overrides the choice; not `decimated`, the decimator's largest factor is no limit to it. Raises
    ValueError.
    """
    if quality not in QUALITIES:
        raise ValueError(f"quality must be one of {', '.join(QUALITIES)}, got {quality!r}")
    if internal_rate_hz is not None:
        factor = internal_rate_hz / rate_hz
        if abs(factor - round(factor)) > 1e-9 or not 1 <= round(factor) <= MAXIMUM_FACTOR:
            raise ValueError(
                f"internal rate must be 1 to {MAXIMUM_FACTOR} times the output rate of {rate_hz:g} Hz, got "
                f"{internal_rate_hz:g} Hz; take {rate_hz * max(1, min(MAXIMUM_FACTOR, round(factor))):g} Hz"
            )
        return round(factor), "not calibrated at a rate of your own"
    factor = max(1, math.ceil(wanted_rate_hz(fundamental_hz, kind, quality) / rate_hz - 1e-9))
    if factor <= MAXIMUM_FACTOR or not decimated:
        return factor, promise(kind, quality)
    # as far as the decimator goes: what is promised is what that rate is known to give
    reached = MAXIMUM_FACTOR * rate_hz
    kept = [q for q in QUALITIES if wanted_rate_hz(fundamental_hz, kind, q) <= reached]
    error = promise(kind, kept[-1]) if kept else "not calibrated"
    return MAXIMUM_FACTOR, f"{error} (limited to {MAXIMUM_FACTOR} × output)"


def planned_precision(quality: str, scheme: str = "exact-hold", internal_rate_hz: float | None = None) -> str:
    """Elements of the modes: float32 at "draft" and "standard", whose promises leave room for what rounding changes.

    e over 3 s changes by up to 1e-4 where strings touch nothing or a bridge. Over frets it changes by up to 0.035 where
    the motion is chaotic, but what is promised there, by an eighth of its limit at most (docs/quality.md,
    tests/solver/test_single.py). What nothing is promised of,
    another scheme or a rate of one's own, is float64.
    """
    return FLOAT32 if quality in ("draft", "standard") and scheme == "exact-hold" and internal_rate_hz is None else FLOAT64


def plan_string(
    string: String,
    fundamental_hz: float,
    contacts: int,
    kind: str,
    *,
    quality: str,
    rate_hz: float,
    scheme: str = "exact-hold",
    internal_rate_hz: float | None = None,
    decimated: bool = True,
) -> StringPlan:
    """The plan of one speaking string of an instrument whose open string has `fundamental_hz`.

    `kind` decides the calibration: a stopped string has fewer frets left but plays on the same string. `decimated` as for
    `choose_factor`.
    """
    factor, error = choose_factor(fundamental_hz, kind, quality, rate_hz, internal_rate_hz, decimated=decimated)
    modes = max(1, min(MAX_MODES, count_modes_below(string, 0.5 * factor * rate_hz)))
    if scheme != "exact-hold":
        error = "not calibrated for this scheme"
    return StringPlan(quality, scheme, factor, factor * rate_hz, modes, contacts, error)


#: measures of `planfile` in words, and their units
_WORDS = {
    "e": "e",
    "e_onset": "e over 0.1 s",
    "lsd_db": "log-spectral distance",
    "bands_db": "third octaves",
    "heard_db": "third octaves of the velocity",
}
_UNITS = {name: " dB" if name.endswith("_db") else "" for name in _WORDS}


def measured_plan(
    string: String, contacts: int, kind: str, found: Measured, *, quality: str, rate_hz: float
) -> StringPlan | None:
    """The plan of one speaking string by what was measured of its open string; None where the decimator does not go so
    far."""
    factor = max(1, math.ceil(found.rate_hz / rate_hz - 1e-9))
    if factor > MAXIMUM_FACTOR:
        return None
    modes = count_modes_below(string, min(found.highest_hz, 0.5 * factor * rate_hz))
    figures = ", ".join(f"{_WORDS[name]} {value:.2g}{_UNITS[name]}" for name, value in found.figures.items())
    return StringPlan(
        quality,
        "exact-hold",
        factor,
        factor * rate_hz,
        max(1, min(MAX_MODES, modes)),
        contacts,
        f"{limits(kind, quality)}; measured on this string: {figures}",
        found.highest_hz,
    )


#: of a wall: Δx over `foundation_length`, ΩΔt with Ω = √(k/μ), and what that was measured to give on the fretless bass alone
WALL: dict[str, tuple[float, float, str]] = {
    "draft": (4.5, 1.4, "log-spectral distance < 6 dB over 0.4 s on the fretless bass"),
    "standard": (2.25, 0.7, "e about 0.05 over 0.1 s, log-spectral distance < 3 dB over 0.4 s on the fretless bass"),
    "fine": (1.13, 0.18, "e about 0.01 over 0.1 s, log-spectral distance < 1.5 dB over 0.4 s on the fretless bass"),
    "reference": (0.57, 0.09, "as close as converged runs"),
}
#: up to which restitution: where a wall gives all of a blow back, late, faint contacts are chaotic
WALL_RESTITUTION = 0.7


def foundation_length(stiffness: float, string: String) -> float:
    """What a string on springs k [N/m²] straightens over [m]: the larger of √(T/k) and (EI/k)^¼."""
    return max(math.sqrt(string.tension_n / stiffness), (string.bending_stiffness_n_m2 / stiffness) ** 0.25)


def plan_wall(string: String, stiffness: float, *, quality: str, rate_hz: float) -> StringPlan:
    """Scheme `wall` for a string over an elastic wall of k = stiffness [N/m²]; modes + 1 is a power of two.

    The promises hold up to restitution `WALL_RESTITUTION`. `contacts` of the plan is 0: the wall's nodes are the inner nodes
    of the modal grid under it. Raises ValueError for other qualities and a stiffness that is not a positive number: a
    rigid wall has no loss of its own that a grid could converge to.
    """
    if quality not in WALL:
        raise ValueError(f"quality must be one of {', '.join(WALL)}, got {quality!r}")
    if not (stiffness > 0.0 and math.isfinite(stiffness)):
        raise ValueError(
            f"the stiffness of a planned wall must be finite and > 0 N/m², got {stiffness}; a rigid wall does not "
            "converge: give rate and modes"
        )
    nodes, angle, error = WALL[quality]
    intervals = string.length_m / (nodes * foundation_length(stiffness, string))
    modes = 2 ** max(1, math.ceil(math.log2(intervals))) - 1
    least_hz = math.sqrt(stiffness / string.linear_density_kg_m) / angle
    factor = max(1, math.ceil(least_hz / rate_hz - 1e-9))
    return StringPlan(quality, "wall", factor, factor * rate_hz, modes, 0, error)
