"""From a scene and a quality to internal rate, modes and contacts.

The contact error of exact-hold with residual compliance depends, for one kind of scene, on the internal rate counted in
periods of the string: a string an octave higher with the same number of modes is the same problem at twice the
speed. So a quality is a number of internal steps per period of the open string, and the modes are those below half the
internal rate. The numbers come from `tools/error-table` (README, "Speed against error").
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from synth.dsp.decimator import MAXIMUM_FACTOR
from synth.physics.modes import count_modes_below
from synth.physics.string import String

QUALITIES = ("draft", "standard", "fine", "reference")
MAX_MODES = 2000


@dataclass(frozen=True)
class Calibration:
    """Internal steps per period of the open string, and the error measured there."""

    steps_per_period: float
    error: str


#: one point of contact (two-point bridge): e over 3 s of the tanpura case, 196 Hz; measured 0.065 at 225 steps per
#: period, 0.026 at 450, 0.014 at 675, 0.007 at 900; 0.17 with the modes of 130
POINT = {
    "draft": Calibration(150.0, "e < 0.3"),
    "standard": Calibration(300.0, "e < 0.1"),
    "fine": Calibration(900.0, "e < 0.02"),
    "reference": Calibration(5400.0, "converged, e 0.005"),
}
#: several points (frets): the bass case, 98 Hz, over 0.4 s. Its contacts are chaotic: two converged runs differ by
#: e 0.02 to 0.06, so the log-spectral distance is the promise. Measured 3.4 dB at 450 steps per period, 2.6 at 900, 2.9
#: at 1800, 1.3 at 3600, 0.6 at 7200
SEVERAL = {
    "draft": Calibration(450.0, "log-spectral distance < 6 dB, e about 0.4"),
    "standard": Calibration(1350.0, "log-spectral distance < 3 dB, e about 0.3"),
    "fine": Calibration(5400.0, "log-spectral distance < 1.5 dB, e about 0.1"),
    "reference": Calibration(10800.0, "as close as two converged runs, e about 0.05"),
}
#: nothing to touch: every rate is exact
FREE = dict.fromkeys(QUALITIES, Calibration(0.0, "exact"))


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

    @property
    def reason(self) -> str:
        """One sentence that explains the choice."""
        return (
            f"{self.contacts} contact{'' if self.contacts == 1 else 's'}: {self.rate_hz / 1e3:.1f} kHz "
            f"({self.factor} × output), {self.modes} modes below half of it; {self.error}"
        )


def choose_factor(
    fundamental_hz: float, contacts: int, quality: str, rate_hz: float, internal_rate_hz: float | None = None
) -> tuple[int, str]:
    """(factor, measured error) for one string; `internal_rate_hz` overrides the choice. Raises ValueError."""
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
    table = FREE if contacts == 0 else POINT if contacts == 1 else SEVERAL
    calibration = table[quality]
    factor = max(1, math.ceil(calibration.steps_per_period * fundamental_hz / rate_hz - 1e-9))
    if factor <= MAXIMUM_FACTOR:
        return factor, calibration.error
    # as far as the decimator goes: what is promised is what that many steps are known to give
    reached = MAXIMUM_FACTOR * rate_hz / fundamental_hz
    kept = [c for c in table.values() if c.steps_per_period <= reached]
    error = kept[-1].error if kept else "not calibrated"
    return MAXIMUM_FACTOR, f"{error} (limited to {MAXIMUM_FACTOR} × output)"


def plan_string(
    string: String,
    fundamental_hz: float,
    contacts: int,
    *,
    quality: str,
    rate_hz: float,
    scheme: str = "exact-hold",
    internal_rate_hz: float | None = None,
) -> StringPlan:
    """The plan of one speaking string of an instrument whose open string has `fundamental_hz`.

    `contacts` decides the calibration: a stopped string has fewer frets left but plays on the same string.
    """
    factor, error = choose_factor(fundamental_hz, contacts, quality, rate_hz, internal_rate_hz)
    modes = max(1, min(MAX_MODES, count_modes_below(string, 0.5 * factor * rate_hz)))
    if scheme != "exact-hold":
        error = "not calibrated for this scheme"
    return StringPlan(quality, scheme, factor, factor * rate_hz, modes, contacts, error)
