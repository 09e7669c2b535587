"""One run's displacement and what it says against the reference; one run's cost."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

from speed_error.grid import BASE_HZ, LONGEST_S, Run
from speed_error.kernels import STEPS, kernel_of
from synth.dsp.decimator import decimate, decimate_signal, design, new_history, workspace
from synth.dsp.measures import log_spectral_distance, relative_error
from synth.dsp.rates import MAXIMUM_FACTOR
from synth.native.denormals import enable_ftz, restore
from synth.research import methods
from synth.research.case import CaseError
from synth.solver.schemes import LAWS

#: displacements are kept at this multiple of 44.1 kHz at most before they are decimated: what lies above half of it,
#: 350 kHz, is sampled plainly
MOST_KEPT = 16
#: an error is taken over the first of these [s]
SPANS_S = (0.1, 0.4, 3.0)


def kept_factor(factor: int) -> int:
    """Largest divisor of the factor that is no more than `MOST_KEPT`."""
    return max(k for k in range(1, MOST_KEPT + 1) if factor % k == 0)


def displacement(run: Run, duration_s: float) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Values and the signals `raw` (plain samples) and `band` (decimated), both at 44.1 kHz.

    A scheme that does not take the case gives values["refused"] and no signals.
    """
    kept = kept_factor(run.factor)
    try:
        scene = run.scene(duration_s, kept)
        outcome = methods.run(scene)
    except CaseError as error:
        return {"refused": str(error)}, {}
    u = outcome.u[:, 0]
    finite = bool(np.all(np.isfinite(u))) and float(np.abs(u).max()) < 1e3
    values = {
        "finite": finite,
        "last_contact_s": outcome.last_contact_step * scene.dt if outcome.last_contact_step >= 0 else None,
        "contact_part": outcome.contact_steps / max(1, scene.steps),
        "penetration_m": max(0.0, float(outcome.largest_penetration_m)) if finite else math.inf,
        "unsolved_steps": int(outcome.unsolved_steps),
    }
    signals = {"raw": u[::kept].copy(), "band": decimate_signal(u, BASE_HZ, kept)} if finite else {}
    return values, signals


def ledger(run: Run, duration_s: float) -> dict[str, Any]:
    """Largest energy rise of one step, relative, and largest stored energy over that at the start; NaN: no ledger."""
    try:
        outcome = methods.run(run.scene(duration_s, kept_factor(run.factor), ledger=True))
    except CaseError as error:
        return {"refused": str(error)}
    growth = math.nan
    if outcome.energy is not None:
        held = outcome.energy[:, 0] + outcome.energy[:, 1]
        growth = float(np.max(held) / held[0]) if np.all(np.isfinite(held)) else math.inf
    return {
        "energy_rise": float(outcome.largest_energy_rise),
        "energy_growth": growth,
        "penetration_m": max(0.0, float(outcome.largest_penetration_m)),
    }


def errors(signals: dict[str, np.ndarray], reference: dict[str, np.ndarray]) -> dict[str, float]:
    """e raw and in the audible band over each span both cover, and the log-spectral distance over the longest."""
    found: dict[str, float] = {}
    length = min(signals["raw"].size, reference["raw"].size)
    for span in SPANS_S:
        n = round(span * BASE_HZ) + 1
        if n <= length + 1:
            for kind, name in (("raw", "e"), ("band", "e_band")):
                here = slice(0, min(n, length))
                found[f"{name}_{span:g}s"] = relative_error(signals[kind][here], reference[kind][here])
    found["spectral_distance_db"] = log_spectral_distance(signals["band"][:length], reference["band"][:length], BASE_HZ)
    found["spectral_distance_over_s"] = (length - 1) / BASE_HZ
    return found


def _kernel_cpu_s(run: Run, sound_s: float) -> float:
    """CPU seconds of the kernel for `sound_s` of sound, `STEPS` steps at a time."""
    scene = run.scene(max(sound_s, 2 * STEPS / run.rate_hz), 1)
    calls = max(1, round(sound_s / scene.dt / STEPS))
    kernel = kernel_of(scene)
    flush = enable_ftz()
    try:
        started = time.process_time()
        for _ in range(calls):
            kernel()
        spent = time.process_time() - started
    finally:
        restore(flush)
    return spent * sound_s / (calls * STEPS * scene.dt)


def cpu_s(run: Run, sound_s: float) -> float:
    """CPU seconds that `sound_s` of sound take, without setting up: the law's kernel, or the scheme's own runner.

    Exact-hold and both Moreau–Jean forms have kernels that take a block of steps at a time, sub-steps over one point
    too. The compliant, quadratisation, auxiliary-variable and event-driven schemes have none: their forces are no linear
    response over the steps of a block. They are timed as they are, compiled and one step (or event) after the other; the
    lesser of the runner's own clock and this process's CPU time counts, so that other programs do not.
    """
    if run.scheme in LAWS:
        return _kernel_cpu_s(run, sound_s)
    scene = run.scene(sound_s, 1)
    started = time.process_time()
    outcome = methods.run(scene)
    spent = time.process_time() - started
    return min(spent, outcome.seconds) * sound_s / (scene.steps * scene.dt)


def decimation_cpu_s(factor: int, sound_s: float = 0.5) -> float:
    """CPU seconds for `sound_s` of sound through the decimator; NaN beyond the factors it has."""
    if factor > MAXIMUM_FACTOR:
        return math.nan
    taps, history, work = design(BASE_HZ, factor), new_history(factor), workspace(factor)
    frames = round(sound_s * BASE_HZ)
    x, out = np.zeros(frames * factor), np.zeros(frames)
    started = time.process_time()
    decimate(taps, factor, history, x, work, out)
    return time.process_time() - started


def longest(run: Run, cpu_per_s: float, budget_s: float) -> float | None:
    """The longest span of the case that the budget allows; None: not even the shortest."""
    spans = [s for s in SPANS_S if s <= LONGEST_S[run.case]]
    allowed = [s for s in spans if s * cpu_per_s <= budget_s]
    return max(allowed) if allowed else None
