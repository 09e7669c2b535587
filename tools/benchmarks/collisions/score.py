"""What a run is worth: its errors against the reference, each with what the reference itself leaves open.

e = √(Σ(u_ref − u)²/Σu_ref²) over windows from the start. The true error lies within e ± u, where u is how far the reference
stands from its own checks, and what interpolation to its instants may make: a score below u says no more than "≤ u".
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.collisions.runfile import Run
from benchmarks.collisions.scene import Reference, SceneFacts
from benchmarks.collisions.suspicion import suspicions
from synth.dsp.measures import log_spectral_distance, relative_error

#: a run has diverged where e of a short window is above this
DIVERGED = 0.1
#: a short window's e is taken of no less than this part of the whole reference's rms
_QUIET = 1e-2
#: what float32 of a reference may make of e, and of a spectrum with a floor 70 dB down [dB]
ROUNDING, ROUNDING_DB = 6e-8, 1e-3


def horizon(u: np.ndarray, ref: np.ndarray, rate_hz: float, window_s: float) -> float:
    """Until when u (n,) goes with ref [s]: the start of the first window of window_s whose e is above `DIVERGED`; the
    whole duration where there is none. Windows begin every quarter of one."""
    size = min(ref.size, max(4, round(window_s * rate_hz)))
    hop = max(1, size // 4)
    begin = np.unique(np.append(np.arange(0, ref.size - size + 1, hop), ref.size - size))
    sums = [np.concatenate([[0.0], np.cumsum(x)]) for x in ((u - ref) ** 2, ref**2)]
    off, held = (each[begin + size] - each[begin] for each in sums)
    quiet = _QUIET**2 * size * float(np.mean(ref**2))
    apart = np.flatnonzero(off > DIVERGED**2 * np.maximum(held, quiet))
    return float(begin[apart[0]] / rate_hz) if apart.size else (ref.size - 1) / rate_hz


def errors(u: np.ndarray, ref: np.ndarray, scene: SceneFacts) -> list[float | None]:
    """e by window of the scene, None where u (n,) ends before."""
    counts = [scene.count(window) for window in scene.windows_s]
    # a run may leave out the last instant, as ranges do
    return [relative_error(u[:n], ref[: min(n, u.size)]) if n <= u.size + 1 else None for n in counts]


@dataclass(frozen=True)
class Score:
    """The figures of one run; lists go by window of the scene."""

    run: Run
    scene: SceneFacts
    e: list[float | None]
    uncertainty: list[float]
    confirmed: list[float]
    lsd_db: float | None
    lsd_uncertainty_db: float
    horizon_s: float
    horizon_open: bool  # the reference itself is sure no longer
    penetration_m: float | None
    energy_rise: float | None
    impulse: float | None  # of all forces, over the reference's
    pull_n: float | None  # strongest force that holds the string down
    suspicions: list[str]

    @property
    def record(self) -> dict[str, Any]:
        """As JSON: what the run says of itself and every figure."""
        run, scene = self.run, self.scene
        return {
            "scene": scene.name,
            **run.words,
            **run.numbers,
            "rate_hz": run.rate_hz,
            "interpolated": not run.picked,
            "windows_s": list(scene.windows_s),
            "e": self.e,
            "uncertainty": self.uncertainty,
            "lsd_db": self.lsd_db,
            "lsd_uncertainty_db": self.lsd_uncertainty_db,
            "horizon_s": self.horizon_s,
            "horizon_open": self.horizon_open,
            "penetration_m": self.penetration_m,
            "energy_rise": self.energy_rise,
            "impulse": self.impulse,
            "pull_n": self.pull_n,
            "suspicions": self.suspicions,
        }


def score(run: Run, scene: SceneFacts, reference: Reference) -> Score:
    """Every figure of a run that `runfile.brought` gave. Raises nothing for a run that is merely bad."""
    ref = reference.u[: run.u.size]
    e = errors(run.u, reference.u, scene)
    rounding = ROUNDING
    uncertainty = [own + floor + rounding for own, floor in zip(reference.uncertainty, run.floor, strict=True)]
    whole = run.u.size >= scene.samples - 1
    apart = horizon(run.u, ref, scene.rate_hz, scene.horizon_window_s)
    force, pull = run.contacts.get("contact_force"), None
    impulse = None
    if force is not None:
        pull = max(0.0, float(-force.min(initial=0.0)))
        if whole and reference.impulse_n_s:
            impulse = float(force[1:].sum() / run.rate_hz / reference.impulse_n_s)
    return Score(
        run,
        scene,
        e,
        uncertainty,
        list(reference.confirmed),
        log_spectral_distance(run.u, ref, scene.rate_hz) if whole else None,
        max(reference.lsd_db, ROUNDING_DB),
        apart,
        apart >= min(reference.horizon_s, (ref.size - 1) / scene.rate_hz),
        _penetration(run, scene),
        _rise(run),
        impulse,
        pull,
        suspicions(run.u, ref),
    )


def _penetration(run: Run, scene: SceneFacts) -> float | None:
    """How far a contact point was below its height at the run's own samples [m]; 0 where it never was."""
    found = run.contacts.get("u_contact")
    if found is None or not scene.contact_heights_m or scene.moves:
        return None
    return max(0.0, float((np.array(scene.contact_heights_m) - found).max(initial=0.0)))


def _rise(run: Run) -> float | None:
    """Largest rise of the energy from a row to the next, over that of the start."""
    energy = run.contacts.get("energy")
    if energy is None or energy.size < 2 or not energy[0] > 0.0:
        return None
    return max(0.0, float(np.diff(energy).max() / energy[0]))


def number(value: float | None, digits: int = 2) -> str:
    """A figure of few digits; – for none."""
    if value is None or math.isnan(value):
        return "–"
    if value == 0.0 or 1e-4 <= abs(value) < 1e5:
        return f"{float(f'{value:.{digits}g}'):.10g}"
    mantissa, _, exponent = f"{value:.{max(0, digits - 1)}e}".partition("e")
    return f"{mantissa}e{int(exponent)}"


def shown(e: float | None, uncertainty: float) -> str:
    """e as tables have it: ≤ the uncertainty where it is below that."""
    if e is None:
        return "–"
    return f"≤ {number(uncertainty)}" if e <= uncertainty else number(e)
