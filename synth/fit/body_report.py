"""A fitted body as words, as plain data, and as the tables of a preset."""

from __future__ import annotations

import json
import math
from typing import Any

from synth.fit.body_fit import BodyFit
from synth.physics.body_modes import AXES, BodyMode


def body_report(fit: BodyFit) -> dict[str, Any]:
    """JSON-able: band, rows, deviations by component, what is explained, modes, those that stand for what lies outside."""
    return {
        "band_hz": [_short(hz) for hz in fit.band_hz],
        "rows": fit.rows,
        "explained": _short(fit.explained),
        "deviations_db": {
            f"y{i}{j}": {"median": _short(d.median_db), "ninetieth": _short(d.ninetieth_db), "worst": _short(d.worst_db)}
            for (i, j), d in fit.errors.items()
        },
        "modes": [_table(mode) for mode in fit.modes],
        "outside_band": [_table(mode) for mode in fit.outside],
        "warnings": list(fit.warnings),
    }


def body_words(told: dict[str, Any]) -> list[str]:
    """The report in lines."""
    low, high = told["band_hz"]
    lines = [f"{len(told['modes'])} modes from {told['rows']} rows, {low:g} to {high:g} Hz"]
    lines += [
        f"{name}: off by {d['median']:.2f} dB in the median, at most {d['ninetieth']:.2f} dB in 9 of 10 rows, "
        f"{d['worst']:.2f} dB at worst"
        for name, d in told["deviations_db"].items()
    ]
    if told["outside_band"]:
        where = ", ".join(f"{hz:g}" for hz in sorted({mode["frequency_hz"] for mode in told["outside_band"]}))
        lines.append(
            f"{len(told['outside_band'])} more, at {where} Hz, stand for what lies below and above the band "
            "(a mass, a stiffness)"
        )
    return lines + [f"note: {words}" for words in told["warnings"]]


def body_toml(told: dict[str, Any], name: str) -> str:
    """[[body.mode]] tables with the report as comments; `name` is where it comes from."""
    lines = [f"# fitted to {json.dumps(name)}", *(f"# {line}" for line in body_words(told))]
    lines.append(f"# shape: {', '.join(AXES)} (rad/m) at the reference point of the bridge")
    outside = [mode["frequency_hz"] for mode in told["outside_band"]]
    for mode in sorted((*told["modes"], *told["outside_band"]), key=lambda mode: mode["frequency_hz"]):
        note = "  # outside the band" if mode["frequency_hz"] in outside else ""
        lines += ["", f"[[body.mode]]{note}"]
        lines += [f"{key} = {json.dumps(value)}" for key, value in mode.items()]
    return "\n".join(lines) + "\n"


def _table(mode: BodyMode) -> dict[str, Any]:
    return {
        "frequency_hz": _short(mode.frequency_hz),
        "q": _short(mode.q),
        "mass_kg": _short(mode.mass_kg),
        "shape": [_short(value) for value in mode.shape],
    }


def _short(value: float) -> float:
    """Six digits; what is fitted is finite."""
    assert math.isfinite(value)
    return float(f"{value:.6g}")
