"""What a quality's promise is measured by: how far two runs of a note differ, and which of that a reference can judge."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from synth.dsp.measures import log_spectral_distance, relative_error, third_octave_distance
from synth.instrument.plan import BRIDGE_ERROR, IMPACT_BANDS_DB, IMPACT_DISTANCE_DB, IMPACT_ONSET_ERROR, ROLLING

#: of the start, where promises about single blows hold [s]
ONSET_S = 0.1
#: two runs that differ by less than this part of a promise can judge it
STANDS = 1.0 / 3.0


def distances(u: np.ndarray, reference: np.ndarray, rate_hz: float) -> dict[str, float]:
    """e over the first 100 ms and over all, log-spectral distance and that in third octaves of displacements (n,)."""
    onset = round(ONSET_S * rate_hz) + 1
    return {
        "e_onset": relative_error(u[:onset], reference[:onset]),
        "e": relative_error(u, reference),
        "lsd_db": log_spectral_distance(u, reference, rate_hz),
        "bands_db": third_octave_distance(u, reference, rate_hz),
    }


def distances_measured(u: np.ndarray, reference: np.ndarray, rate_hz: float) -> dict[str, float]:
    """`distances`, and `heard_db`: third octaves of the velocities, where highs count as they do in the brightest output."""
    return {
        **distances(u, reference, rate_hz),
        "heard_db": third_octave_distance(np.diff(u), np.diff(reference), rate_hz),
    }


def judged(kind: str, quality: str, stands: Mapping[str, float]) -> list[tuple[str, float]]:
    """What is promised of a scene and can be judged, by how far its reference stands: (measure, limit), maybe none."""

    def can(measure: str, limit: float) -> bool:
        return stands[measure] < STANDS * limit

    signal = ("lsd_db", IMPACT_DISTANCE_DB[quality])
    found = []
    if kind in ROLLING:
        choices = [("e", BRIDGE_ERROR[quality]), signal]
    else:
        choices = [signal, ("bands_db", IMPACT_BANDS_DB[quality])]
        onset = ("e_onset", IMPACT_ONSET_ERROR.get(quality, 0.0))
        found += [onset] if can(*onset) else []
    return found + [choice for choice in choices if can(*choice)][:1]


def judged_of_one(kind: str, quality: str, stands: Mapping[str, float]) -> list[tuple[str, float]]:
    """`judged`, and the levels that are heard, whatever the kind: highs are not given up where e allows it; nothing where
    nothing that is promised can be judged."""
    found, heard = judged(kind, quality, stands), ("heard_db", IMPACT_BANDS_DB[quality])
    return [*found, heard] if found and stands["heard_db"] < STANDS * heard[1] else found
