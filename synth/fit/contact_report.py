"""A contact fit as plain data: facts in words, numbers, a preset's values, curves to draw, and a picture."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np

from synth.fit.contact_group import ContactFit
from synth.fit.contact_space import Estimate
from synth.instrument.preset import BridgeObstacle
from synth.units import midi_to_note


def contact_settings(fit: ContactFit) -> list[tuple[str, Any]]:
    """[(path, value)] of the preset that make its obstacle and pluck the fitted ones: the height for the amplitude that was
    given or that the preset has, the distance in the unit that it has, the place of plucking of the first note."""
    preset, note = fit.preset, fit.preset.string[fit.string].notes[0]
    table = preset.obstacle
    found: list[tuple[str, Any]] = []
    assert isinstance(table, BridgeObstacle)
    height = 1e6 * fit.values["height"].value * fit.amplitude_m
    found.append(("obstacle.jiva_um", _at_note(table.jiva_um, note, _rounded(height, 4))))
    share = fit.values["distance"].value
    if table.distance_mm is None:
        found.append(("obstacle.distance_ratio", _rounded(share, 5)))
    else:
        found.append(("obstacle.distance_mm", _at_note(table.distance_mm, note, _rounded(1e3 * share * fit.length_m, 5))))
    if fit.amplitude_known:
        displacement = _rounded(1e3 * fit.amplitude_m, 5)
        found.append(("pluck.displacement_mm", _at_note(preset.pluck.displacement_mm, note, displacement)))
    place = fit.notes[0].values.get("position")
    if place is not None:
        found.append(("pluck.position", _rounded(place.value, 4)))
        if preset.pluck.position_hard is not None:
            found.append(("pluck.position_hard", _rounded(place.value, 4)))
    return found


def _at_note(there: Any, note: int, value: float) -> Any:
    """A number, or where the field has numbers at notes, those with this one."""
    if not isinstance(there, dict):
        return value
    return {**{midi_to_note(each): number for each, number in there.items()}, midi_to_note(note): value}


def contact_report(fit: ContactFit) -> dict[str, Any]:
    """JSON-able: `obstacle`, `notes`, `facts` [[name, value, what it is]], `warnings`, `curves` (of the first
    note's bands as `synth.fit.report` has its curves)."""
    return {
        "string": fit.string,
        "length_m": fit.length_m,
        "first_partial_hz": _rounded(fit.model.string.fundamental_hz, 7),
        "amplitude_mm": _rounded(1e3 * fit.amplitude_m, 5),
        "amplitude_known": fit.amplitude_known,
        "obstacle": {name: _interval(each) for name, each in fit.values.items()},
        "notes": [_note(note, ratio) for note, ratio in zip(fit.notes, fit.ratios, strict=True)],
        "facts": facts(fit),
        "warnings": list(fit.warnings),
        "curves": {"bands": _bands(fit)},
    }


def facts(fit: ContactFit) -> list[list[str]]:
    """[[name, value, what it is]]"""
    found: list[list[str]] = []
    length = 1e3 * fit.length_m
    each, jiva = fit.values["height"], 1e3 * fit.amplitude_m
    tip = "thread over bridge for each mm of the pluck: a sound tells no more than this ratio"
    found.append(["Height over amplitude", _of(each, 1e3, "µm per mm", 2), tip])
    whose = "given" if fit.amplitude_known else "the preset's"
    tip = f"at an amplitude of {jiva:.3g} mm ({whose})"
    found.append([f"Height at {jiva:.3g} mm", _of(each, 1e3 * jiva, "µm", 2), tip])
    tip = f"from the end to the bridge's edge, of {length:.4g} mm of string"
    found.append(["Distance", _of(fit.values["distance"], length, "mm", 2), tip])
    for number, (note, ratio) in enumerate(zip(fit.notes, fit.ratios, strict=True), start=1):
        which = "" if len(fit.notes) == 1 else f" {number}"
        if "position" in note.values:
            found.append([f"Plucked at{which}", _of(note.values["position"], 1.0, "of L", 4), "from the end at the bridge"])
        if len(fit.notes) > 1:
            said = "unknown" if math.isnan(ratio) else f"{ratio:.3g} × the first"
            found.append([f"Amplitude{which}", said, "assuming one height for all notes"])
        found.append(
            [
                f"Residual{which}",
                f"{note.spread_db:.1f} dB rms, loss {note.loss:.3f}",
                "difference between recording and model, over all bands",
            ]
        )
    return found


def _of(each: Estimate, unit: float, name: str, digits: int) -> str:
    return f"{unit * each.value:.{digits}f} ± {max(unit * each.half, 10.0**-digits):.{digits}f} {name}"


def _interval(each: Estimate) -> dict[str, float]:
    return {"value": _rounded(each.value, 6), "low": _rounded(each.low, 6), "high": _rounded(each.high, 6)}


def _note(note: Any, ratio: float) -> dict[str, Any]:
    stroke = note.stroke
    return {
        **{name: _interval(each) for name, each in note.values.items()},
        "amplitude_ratio": None if math.isnan(ratio) else _rounded(ratio, 4),
        "draw_ms": _rounded(1e3 * stroke.draw_s, 4),
        "slip_ms": _rounded(1e3 * stroke.slip_s, 4),
        "losses": _rounded(stroke.losses, 4),
        "touching": _rounded(note.touching, 4),
        "loss": _rounded(note.loss, 4),
        "loss_without_contact": None if math.isinf(note.free_loss) else _rounded(note.free_loss, 4),
        "spread_db": _rounded(note.spread_db, 4),
        "onset_s": _rounded(note.onset_s, 5),
        "evaluations": note.evaluations,
    }


def _bands(fit: ContactFit) -> dict[str, Any]:
    """Level of each band over the note, recorded and by the model, [[Hz, dB]]."""
    note = fit.notes[0]
    used = ~np.isnan(note.offsets_db)
    hz = note.bands.centres_hz[used]
    recorded, model = (10.0 * np.log10(np.mean(10.0 ** (each[:, used] / 10.0), axis=0)) for each in (
        note.recorded_db, note.model_db
    ))  # fmt: skip
    return {
        "points": [[_rounded(float(f), 5), _rounded(float(y), 4)] for f, y in zip(hz, recorded, strict=True)],
        "line": [[_rounded(float(f), 5), _rounded(float(y), 4)] for f, y in zip(hz, model, strict=True)],
        "aside": [],
    }


def draw(fit: ContactFit, path: str | os.PathLike[str]) -> None:
    """A picture (PNG, SVG, PDF by its ending) of every note's bands over time: recorded, by the model, and the difference.
    Needs matplotlib. Raises ValueError, OSError where it cannot be written."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(len(fit.notes), 3, figsize=(12, 3.2 * len(fit.notes)), squeeze=False, sharey=True)
    for row, note in zip(axes, fit.notes, strict=True):
        used = ~np.isnan(note.offsets_db)
        shown = (note.recorded_db[:, used], note.model_db[:, used])
        top = max(float(np.nanmax(each)) for each in shown)
        extent = (0.0, shown[0].shape[0] * note.bands.hop_s, 0.5, used.sum() + 0.5)
        for axis, each, name in zip(row, (*shown, shown[0] - shown[1]), ("recorded", "model", "difference"), strict=True):
            apart = name == "difference"
            image = axis.imshow(
                each.T, aspect="auto", origin="lower", extent=extent, cmap="RdBu" if apart else "viridis",
                vmin=-12.0 if apart else top - 70.0, vmax=12.0 if apart else top,
            )  # fmt: skip
            axis.set_title(f"{name}, dB")
            axis.set_xlabel("s")
            figure.colorbar(image, ax=axis)
        row[0].set_ylabel("band")
    figure.tight_layout()
    figure.savefig(path)
    pyplot.close(figure)


def _rounded(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
