"""A fit as plain data: facts in words, numbers, and curves to draw."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from synth.fit.estimate import JUDGED, Fit
from synth.units import cents, hz_to_midi, midi_to_hz, midi_to_note

#: partials in the lists and curves
_MOST = 60


def report(fit: Fit) -> dict[str, Any]:
    """JSON-able: numbers, `facts` [[name, value, what it is]], `warnings`, `partials`, `curves` {frequency, decay, level}.

    Every curve has `points` (measured), `line` (the fit) and `aside` (measured, but not followed by the fit), as [[x, y]]:
    frequency over the partial's number in cents from f0·n; T60 [s] over frequency [Hz]; level [dB] over the number.
    """
    note = round(hz_to_midi(fit.first_partial_hz))
    beside = cents(fit.first_partial_hz, midi_to_hz(note))
    pluck = fit.pluck
    return {
        "f0_hz": _short(fit.f0_hz),
        "first_partial_hz": _short(fit.first_partial_hz),
        "note": midi_to_note(note) if 0 <= note <= 127 else None,
        "note_cents": _short(beside, 4),
        "inharmonicity": _short(fit.inharmonicity),
        "inharmonicity_error": _short(fit.stretch.inharmonicity_error, 3),
        "losses": {
            "air_drag_m_kg": _short(fit.losses.air_drag_m_kg),
            "air_boundary_m2_kg": _short(fit.losses.air_boundary_m2_kg),
            "viscoelastic_loss": _short(fit.losses.viscoelastic_loss),
            "thermoelastic_q_inverse": _short(fit.losses.thermoelastic_q_inverse),
            "spread": _short(fit.losses.spread, 3),
        },
        "pluck": None
        if pluck is None
        else {
            "position": _short(pluck.position, 4),
            "error": _short(pluck.error, 3),
            "determined": pluck.determined,
            "spread_db": _short(pluck.spread_db, 3),
        },
        "onset_s": _short(fit.onset_s, 4),
        "duration_s": _short(fit.duration_s, 4),
        "rate_hz": fit.rate_hz,
        "peak_dbfs": _short(fit.peak_dbfs, 4),
        "noise_floor_dbfs": _short(fit.noise_floor_dbfs, 4),
        "snr_db": _short(fit.snr_db, 3),
        "explained": _short(fit.explained, 4),
        "facts": _facts(fit, midi_to_note(note) if 0 <= note <= 127 else "", beside),
        "warnings": list(fit.warnings),
        "partials": [_partial(p) for p in fit.partials[:_MOST]],
        "curves": {"frequency": _frequency(fit), "decay": _decay(fit), "level": _level(fit)},
    }


def _facts(fit: Fit, note: str, beside: float) -> list[list[str]]:
    pluck = fit.pluck
    where = "not clear from the levels"
    if pluck is not None and pluck.determined:
        where = f"{pluck.position:.3f} ± {pluck.error:.3f} of L"
    low, high = fit.partials[0], fit.partials[:JUDGED][-1]
    return [
        ["Pitch", f"{fit.first_partial_hz:.2f} Hz, {note} {beside:+.1f} cents", "frequency of the first partial"],
        [
            "Inharmonicity B",
            f"{fit.inharmonicity:.3g} ± {fit.stretch.inharmonicity_error:.1g}",
            "partial n sounds at n·f0·√(1 + B·n²)",
        ],
        [f"T60 of partial {low.number}", f"{low.t60_s:.2f} s", f"time to −60 dB at {low.hz:.0f} Hz"],
        [
            f"T60 of partial {high.number}",
            f"{high.t60_s:.2f} s",
            f"time to −60 dB at {high.hz:.0f} Hz: how long it stays bright",
        ],
        [
            "Viscoelastic loss",
            f"{fit.losses.viscoelastic_loss:.3g}",
            "loss angle of the material; shortens high partials",
        ],
        ["Thermoelastic 1/Q", f"{fit.losses.thermoelastic_q_inverse:.3g}", "loss in proportion to frequency"],
        ["Plucked at", where, "distance from the nearer end; the levels do not show which end that is"],
        ["Signal over noise", f"{fit.snr_db:.0f} dB", "level of the partials above the noise between them"],
    ]


def _partial(p: Any) -> dict[str, Any]:
    m = p.measured
    return {
        "number": p.number,
        "hz": _short(p.hz),
        "t60_s": _short(p.t60_s),
        "level_db": None if m is None else _short(m.level_db, 4),
        "cents": None if p.cents is None else _short(p.cents, 3),
        "measured_hz": None if m is None else _short(m.hz),
        "measured_t60_s": None if m is None or m.decay <= 0.0 else _short(m.t60_s),
        "frequency_source": p.frequency_source,
        "decay_source": p.decay_source,
        "single": None if m is None else bool(m.single),
        "steady": None if m is None else bool(m.steady),
    }


def _frequency(fit: Fit) -> dict[str, Any]:
    measured = [p.measured for p in fit.partials[:_MOST] if p.measured is not None]
    numbers = np.arange(1, 1 + max(m.number for m in measured))
    law = 600.0 * np.log2(1.0 + fit.inharmonicity * numbers**2)
    points: list[Any] = []
    aside: list[Any] = []
    for m in measured:
        point = [m.number, _short(cents(m.hz, m.number * fit.f0_hz), 5)]
        far = abs(cents(m.hz, float(fit.stretch.frequencies_hz(m.number)))) > max(5.0, 4.0 * fit.stretch.spread_cents)
        (aside if far else points).append(point)
    return {"points": points, "line": _pairs(numbers, law), "aside": aside}


def _decay(fit: Fit) -> dict[str, Any]:
    shown = fit.partials[:_MOST]
    line = [[_short(p.hz_by_law), _short(p.t60_s_by_law)] for p in shown]
    points: list[Any] = []
    aside: list[Any] = []
    for p in shown:
        if p.measured is not None and p.measured.decay > 0.0:
            (points if p.measured.steady else aside).append([_short(p.measured.hz), _short(p.measured.t60_s)])
    return {"points": points, "line": line, "aside": aside}


def _level(fit: Fit) -> dict[str, Any]:
    measured = [p.measured for p in fit.partials[:_MOST] if p.measured is not None]
    points = [[m.number, _short(m.level_db, 4)] for m in measured]
    line: list[list[float | None]] = []
    if fit.pluck is not None:
        numbers = np.arange(1, 1 + max(m.number for m in measured))
        line = _pairs(numbers, fit.pluck.levels_db(numbers))
    return {"points": points, "line": line, "aside": []}


def _pairs(x: Any, y: Any) -> list[list[float | None]]:
    return [[_short(float(a)), _short(float(b), 5)] for a, b in zip(x, y, strict=True)]


def _short(value: float, digits: int = 6) -> float | None:
    return float(f"{value:.{digits}g}") if math.isfinite(value) else None
