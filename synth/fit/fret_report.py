"""A fit of frets as plain data: facts in words, numbers, and a preset's values."""

from __future__ import annotations

from typing import Any

from synth.fit.fret_fit import AMPLITUDE_KNOWN, FretFit
from synth.fit.fret_model import action_settings


def fret_settings(fit: FretFit) -> list[tuple[str, Any]]:
    """[(path, value)] of the preset that give its frets the fitted action."""
    return action_settings(fit.preset, fit.action_mm, fit.string)


def fret_report(fit: FretFit) -> dict[str, Any]:
    """JSON-able: `action_mm`, `bracket_mm`, `strokes`, `facts` [[name, value, what it is]], `warnings`."""
    return {
        "string": fit.string,
        "fret": fit.fret,
        "action_mm": {"value": _rounded(fit.action_mm), "low": _rounded(fit.action_mm - fit.half_mm),
                      "high": _rounded(fit.action_mm + fit.half_mm), "counted_at_fret": fit.counted_at},
        "bracket_mm": [_rounded(fit.low_mm), _rounded(fit.high_mm)],
        "mm_for_each_percent_of_amplitude": _rounded(fit.valley_mm),
        "position": _rounded(fit.position),
        "strokes": [
            {
                "amplitude_mm": each.amplitude_mm,
                "touches": each.touches,
                "loss_without_contact": _rounded(each.free_loss),
                "action_mm": None if each.minimum is None else _rounded(each.minimum.action_mm),
                "loss": None if each.minimum is None else _rounded(each.minimum.loss),
            }
            for each in fit.strokes
        ],
        "facts": facts(fit),
        "warnings": ["frets are experimental: the answer holds for the amplitudes that were given", *fit.warnings],
    }  # fmt: skip


def facts(fit: FretFit) -> list[list[str]]:
    """[[name, value, what it is]]"""
    percent = 100.0 * AMPLITUDE_KNOWN
    found = [
        ["Action", f"{fit.action_mm:.3f} ± {fit.half_mm:.3f} mm", f"open string over fret {fit.counted_at}"],
        ["Interval of the fit", f"± {fit.fit_half_mm:.3f} mm", "without the uncertainty of the amplitudes"],
        [
            "Change per percent",
            f"{fit.valley_mm:.3f} mm",
            f"of all amplitudes; ± {percent:g} % are included in the interval",
        ],
        ["Bracket", f"{fit.low_mm:.2f} to {fit.high_mm:.2f} mm", "judging only by which strokes touch"],
        ["Plucked at", f"{fit.position:.4f} of L", "as given" if fit.position_known else "from the softest stroke"],
    ]
    for number, each in enumerate(fit.strokes, start=1):
        words = {True: "touches", False: "touches nothing", None: "unclear"}[each.touches]
        if each.minimum is not None:
            words += f", action {each.minimum.action_mm:.3f} mm, loss {each.minimum.loss:.3f}"
        found.append([f"Stroke {number}", f"{each.amplitude_mm:.4g} mm: {words}", "amplitude as given"])
    return found


def _rounded(value: float, digits: int = 5) -> float:
    return float(f"{value:.{digits}g}")
