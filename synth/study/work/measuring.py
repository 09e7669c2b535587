"""Measures of a run by name. What they compute is `dsp.measures`' and the runs' own; here they get their names.

A measure is a function of a `Taken` and of options from the study; it returns a number, text, or None for what there is not.
Raises ValueError where it cannot say: the row then has none, and the column `not_measured` the reason.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from synth.dsp import measures as dsp
from synth.study.work.taken import Taken


@dataclass(frozen=True)
class Measure:
    """compute(taken, **options); options: name → default; meaning with unit. reference: it compares; ledger: it needs the
    energy of every step; timed: what it says differs from one time to the next."""

    compute: Callable[..., Any]
    meaning: str
    options: Mapping[str, Any]
    reference: bool = False
    ledger: bool = False
    timed: bool = False


def _pair(taken: Taken, until_s: float | None, output: int | None) -> tuple[np.ndarray, np.ndarray, float]:
    """Signal and reference over the time that both have, up to `until_s`."""
    reference = taken.reference
    assert reference is not None
    if not math.isclose(taken.rate_hz, reference.rate_hz, rel_tol=1e-9):
        raise ValueError(
            f"rows must come at the reference's {reference.rate_hz:g} Hz, got {taken.rate_hz:g} Hz; set output_rate_hz"
        )
    u, ref = taken.signal(output), reference.signal(output)
    n = min(u.size, ref.size)
    if until_s is not None:
        n = min(n, round(until_s * taken.rate_hz) + 1)
    return u[:n], ref[:n], taken.rate_hz


def _blown_up(u: np.ndarray) -> bool:
    return not bool(np.all(np.isfinite(u)))


def _e(taken: Taken, until_s: float | None = None, output: int | None = None) -> float:
    u, ref, _ = _pair(taken, until_s, output)
    return math.inf if _blown_up(u) else dsp.relative_error(u, ref)


def _lsd_db(taken: Taken, until_s: float | None = None, output: int | None = None) -> float:
    u, ref, rate_hz = _pair(taken, until_s, output)
    return math.inf if _blown_up(u) else dsp.log_spectral_distance(u, ref, rate_hz)


def _bands_db(taken: Taken, until_s: float | None = None, output: int | None = None) -> float:
    u, ref, rate_hz = _pair(taken, until_s, output)
    return math.inf if _blown_up(u) else dsp.third_octave_distance(u, ref, rate_hz)


def _expected(taken: Taken, expected_hz: float | None) -> float:
    if expected_hz is None and taken.expected_hz is None:
        raise ValueError("the pitch is not known beforehand; give expected_hz")
    return float(taken.expected_hz if expected_hz is None else expected_hz)  # type: ignore[arg-type]


def _after(taken: Taken, from_s: float, output: int | None) -> np.ndarray:
    return taken.signal(output)[round(from_s * taken.rate_hz) :]


def _pitch_hz(
    taken: Taken, expected_hz: float | None = None, from_s: float = 0.0, search_cents: float = 60.0,
    output: int | None = None,
) -> float:  # fmt: skip
    x = _after(taken, from_s, output)
    return dsp.sounding_fundamental(x, taken.rate_hz, _expected(taken, expected_hz), search_cents=search_cents)


def _pitch_cents(
    taken: Taken, expected_hz: float | None = None, from_s: float = 0.0, search_cents: float = 60.0,
    output: int | None = None,
) -> float:  # fmt: skip
    from synth.units import cents

    expected = _expected(taken, expected_hz)
    return cents(_pitch_hz(taken, expected, from_s, search_cents, output), expected)


def _t60_s(taken: Taken, partial: int | None = None, from_s: float = 0.0, output: int | None = None) -> float:
    x = _after(taken, from_s, output)
    if partial is None:
        return dsp.decay_time_s(x, taken.rate_hz)
    f0 = _expected(taken, None)
    found, _ = dsp.partials(x, taken.rate_hz, f0, partial)
    return dsp.decay_time_s(x, taken.rate_hz, float(found[-1]), bandwidth_hz=0.8 * f0 / (1 if partial == 1 else 2))


def _partial_db(taken: Taken, partial: int = 1, from_s: float = 0.0, output: int | None = None) -> float:
    _, levels = dsp.partials(_after(taken, from_s, output), taken.rate_hz, _expected(taken, None), partial)
    return float(levels[-1])


def _rms(taken: Taken, output: int | None = None) -> float:
    return float(np.sqrt(np.mean(taken.signal(output) ** 2)))


def _band_db(taken: Taken, low_hz: float = 20.0, high_hz: float = 20000.0, output: int | None = None) -> float:
    return float(dsp.band_levels_db(taken.signal(output), taken.rate_hz, [low_hz, min(high_hz, taken.rate_hz / 2)])[0])


def _of_result(name: str) -> Callable[[Taken], Any]:
    def compute(taken: Taken) -> Any:
        found = getattr(taken.result, name, None)
        if found is None:
            raise ValueError(f"a run of this kind has no {name}")
        return float(found)

    return compute


def _of_summary(name: str) -> Callable[[Taken], Any]:
    def compute(taken: Taken) -> Any:
        summary = getattr(taken.result, "summary", {})
        if name not in summary:
            raise ValueError(f"a run of this kind has no {name}")
        return summary[name]

    return compute


def _contact_part(taken: Taken) -> float:
    return _of_summary("contact_steps")(taken) / max(1, _of_summary("steps")(taken))


def _first_contact_s(taken: Taken) -> float | None:
    forces = _of_array(taken, "contact_force")
    touched = np.flatnonzero(np.any(forces > 0.0, axis=1))
    return float(touched[0] / taken.rate_hz) if touched.size else None


def _largest_force_n(taken: Taken) -> float:
    return float(np.max(_of_array(taken, "contact_force"), initial=0.0))


def _impulse_n_s(taken: Taken) -> float:
    return float(np.sum(_of_array(taken, "contact_force")[1:]) / taken.rate_hz)


def _of_array(taken: Taken, name: str) -> np.ndarray:
    found = getattr(taken.result, name, None)
    if found is None:
        raise ValueError(f"a run of this kind has no {name}")
    return np.asarray(found)


def _held(taken: Taken) -> np.ndarray:
    return _of_array(taken, "energy_stored") + _of_array(taken, "energy_residual")


def _balance(taken: Taken) -> float:
    """Largest |stored + residual + lost − injected − held at the start|, over what was held or put in."""
    spent = _of_array(taken, "energy_viscous") + _of_array(taken, "energy_contact") - _of_array(taken, "energy_injected")
    total, held = _held(taken) + spent, _held(taken)
    scale = max(float(held.max()), float(np.max(np.abs(_of_array(taken, "energy_injected")))), 1e-300)
    return float(np.max(np.abs(total - total[0])) / scale)


def _finite(taken: Taken) -> bool:
    return not _blown_up(taken.signals)


def _mode_steps(taken: Taken) -> float:
    return float(_of_summary("steps")(taken)) * float(_of_summary("modes")(taken))


_SPAN = {"until_s": None, "output": None}
_TONE = {"expected_hz": None, "from_s": 0.0, "search_cents": 60.0, "output": None}
_ONE = {"output": None}

MEASURES: dict[str, Measure] = {
    "e": Measure(_e, "√(Σ(u_ref − u)²/Σu_ref²)", _SPAN, reference=True),
    "lsd_db": Measure(_lsd_db, "log-spectral distance [dB]", _SPAN, reference=True),
    "bands_db": Measure(_bands_db, "distance of levels in third octaves [dB]", _SPAN, reference=True),
    "pitch_hz": Measure(_pitch_hz, "first partial, averaged over the time in which it sounds [Hz]", _TONE),
    "pitch_cents": Measure(_pitch_cents, "the same, relative to the expected pitch [cents]", _TONE),
    "t60_s": Measure(_t60_s, "decay by 60 dB, of a partial or of all [s]", {"partial": None, "from_s": 0.0, **_ONE}),
    "partial_db": Measure(_partial_db, "level of a partial [dB re 1]", {"partial": 1, "from_s": 0.0, **_ONE}),
    "band_db": Measure(_band_db, "level of a band [dB]", {"low_hz": 20.0, "high_hz": 20000.0, **_ONE}),
    "peak": Measure(lambda t, output=None: dsp.peak(t.signal(output)), "largest magnitude [m; full scale]", _ONE),
    "rms": Measure(_rms, "root mean square [m; full scale]", _ONE),
    "finite": Measure(_finite, "whether all samples are finite", {}),
    "energy_start_j": Measure(lambda t: float(_held(t)[0]), "energy held at the start [J]", {}, ledger=True),
    "energy_end_j": Measure(lambda t: float(_held(t)[-1]), "energy held at the end [J]", {}, ledger=True),
    "energy_rise": Measure(_of_result("largest_energy_rise"), "largest rise of energy in a step, relative", {}, ledger=True),
    "energy_balance": Measure(_balance, "largest error of the ledger's balance, relative", {}, ledger=True),
    "last_contact_s": Measure(_of_result("last_contact_s"), "end of the last step with a contact force [s]", {}),
    "first_contact_s": Measure(_first_contact_s, "first row with a contact force [s]", {}),
    "contact_steps": Measure(_of_summary("contact_steps"), "steps with a contact force", {}),
    "contact_part": Measure(_contact_part, "share of the steps with a contact force", {}),
    "penetration_m": Measure(_of_result("largest_penetration_m"), "largest penetration; negative: never touched [m]", {}),
    "largest_force_n": Measure(_largest_force_n, "largest mean force of a contact over a row [N]", {}),
    "impulse_n_s": Measure(_impulse_n_s, "impulse of all contacts [N s]", {}),
    "unsolved_steps": Measure(_of_summary("unsolved_steps"), "steps not solved to tolerance", {}),
    "steps": Measure(_of_summary("steps"), "steps of the model", {}),
    "modes_used": Measure(_of_summary("modes"), "modes of the run", {}),
    "mode_steps": Measure(_mode_steps, "steps × modes", {}),
    "cpu_s": Measure(lambda t: t.cpu_s, "CPU time of a case's steps, or of a note with its engine [s]", {}, timed=True),
    "cpu_per_s": Measure(lambda t: t.cpu_s / t.duration_s, "CPU time per second of sound [s/s]", {}, timed=True),
    "times_real_time": Measure(
        lambda t: t.duration_s / max(t.cpu_s, 1e-9), "seconds of sound per CPU second", {}, timed=True
    ),
}  # fmt: skip
