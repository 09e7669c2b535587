"""From a preset's `[[body.resonance]]` to the peaks of the body's filter, single resonances and fields of them alike.

Of a field, `gain_db` is the level of its response in the root mean square over frequency. Resonances of peak gain g, quality
Q and random signs, Δ apart in the mean, have the mean square g² π f/(2 Q Δ), so that g = √(2 Q Δ/(π f)) gives a level that
neither Δ nor Q changes: where they overlap each is small, where they do not each stands out.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from synth.physics.mode_field import FieldMode


class Peak(NamedTuple):
    """One resonance of the filter: its maximum [Hz], its Q and gain, +1 or −1, and from where it is heard (−1 … 1); whether
    it is one of a field, of which those beyond a rate's reach are left out."""

    frequency_hz: float
    q: float
    gain_db: float
    sign: float
    pan: float
    of_field: bool = False


class _Resonance(Protocol):
    @property
    def frequency_hz(self) -> float: ...
    @property
    def q(self) -> float: ...
    @property
    def gain_db(self) -> float: ...
    @property
    def pan(self) -> float: ...
    @property
    def spacing_hz(self) -> float | None: ...

    def field(self) -> tuple[FieldMode, ...] | None: ...


def single_peaks(resonance: _Resonance) -> tuple[Peak, ...]:
    """A resonance, or those of a field; `pan` of a field is the farthest of them."""
    field = resonance.field()
    if field is None or resonance.spacing_hz is None:
        return (Peak(resonance.frequency_hz, resonance.q, resonance.gain_db, 1.0, resonance.pan),)
    return tuple(_of_field(resonance, mode, resonance.spacing_hz) for mode in field)


def _of_field(resonance: _Resonance, mode: FieldMode, spacing_hz: float) -> Peak:
    q = max(1.0, mode.q)
    share = 2.0 * q * spacing_hz / (math.pi * mode.frequency_hz)
    gain_db = resonance.gain_db + 10.0 * math.log10(share * mode.radiation**2)
    return Peak(mode.frequency_hz, q, gain_db, math.copysign(1.0, mode.radiation), resonance.pan * mode.pan, True)
