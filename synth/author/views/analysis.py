"""What a note is made of: wave, spectrogram, partials against the string's model, contacts, the formant of the buzz.

analyse(preset, note, velocity=100, seconds=2.0, *, quality="standard", rate_hz=44100.0) -> dict. The note is held; times [s]
count from the moment the finger touches the string, in the sound too (its delay through the engine is taken off): a contact
stands under what it does.

    rate_hz, seconds, release_s (when the finger lets go), peak_dbfs (before any limiter; null in silence)
    waveform      {bin_s, low: [...], high: [...]} smallest and largest sample of every bin
    spectrogram   {start_s, step_s (between columns), hz: [... of the rows, rising, evenly in octaves], floor_db, top_db,
                  rows: [[0 … 255 per column] per row]}: 0 is floor_db, 255 top_db = 0 dB re the loudest
    pitch_cents   the sounding fundamental above the note's pitch, from 0.2 s after the release on (as `tune` measures);
                  null where the note is too short to have one
    partials      [{number, model_hz, measured_hz, cents, model_t60_s, measured_t60_s, level_db}]
                  model: the stiff string tuned for the note, its end's resonances, raised by the contact's calibrated shift;
                  measured in the first second after the release, null where there is no peak within 60 dB of the strongest;
                  cents: measured above model; T60 over all that was asked for; level as amplitude re full scale, averaged
    contacts      [{point (index in the obstacle from the nut), label, start_s, end_s, peak_n, impulse_ns}] in order of time,
                  of the `MOST_CONTACTS` strongest where there are more; `contacts_found`: how many there are
    timeline      {bin_s, points: [{point, label, contacts, first_s, last_s, peak_n, impulse_ns}] those touched,
                  impulse_ns: [[per bin] per such point], peak_n: [[per bin] per such point]}
    formant       [{t_s, hz}] of the descending formant, null where there is none
    decays        of strings that share a bridge, [] of others: of each partial its envelope, how it decays early and late
                  and how it beats (`coupled_analysis.decays_of`)
    waking        of these, the level of every string over the note (`coupled_analysis.hear_together`); null of others

Of strings that share a bridge all are there; the sound is the mean of both channels, forces are those of each frame's end.

Raises PresetError where no string plays the note, ValueError for a length out of range.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from synth.author.views.coupled_analysis import decays_of, hear_together
from synth.author.views.formant import descending_formant
from synth.author.views.instrument import draw
from synth.author.views.pictures import rows_of_power, waveform
from synth.dsp.measures import decay_times_s, partials, peak, sounding_fundamental, stft_power
from synth.fit.tune import WINDOW_S
from synth.host.contacts import Forces, before, binned, contacts_of, gather, touches
from synth.host.string_tape import QUALITY, RATE_HZ, Taped
from synth.instrument.compile import Position
from synth.instrument.place import find
from synth.instrument.preset import Preset, contact_cents
from synth.units import LN_1000, cents, gain_to_db

SHORTEST_S, LONGEST_S = 0.2, 10.0
#: columns of the spectrogram at most, and what is black in it
COLUMNS = 360
FLOOR_DB = -90.0
#: of a frame; twice as long below this fundamental, to tell its partials apart
FRAME, LONG_BELOW_HZ = 2048, 100.0
PARTIALS, PARTIALS_TO_HZ, PARTIALS_WITHIN_DB = 20, 12000.0, 60.0
#: partials are measured from so long after the release on, for so long
SETTLED_S, PARTIALS_S = 0.05, 1.0
MOST_CONTACTS = 400
TIME_BINS = 240


@threadpool_limits.wrap(limits=1, user_api="blas")
def analyse(
    preset: Preset,
    note: int,
    velocity: int = 100,
    seconds: float = 2.0,
    *,
    quality: str = QUALITY,
    rate_hz: float = RATE_HZ,
) -> dict[str, Any]:
    """The analysis of one note; see the module's docstring."""
    if not SHORTEST_S <= seconds <= LONGEST_S:
        raise ValueError(f"seconds must lie between {SHORTEST_S:g} and {LONGEST_S:g}, got {seconds:g}")
    place = find(preset, note)
    if preset.coupled:
        heard = hear_together(preset, place, velocity, seconds, quality, rate_hz)
        x, forces, position, release_s = heard.x, heard.forces, heard.position, heard.release_s
    else:
        x, forces, position, release_s = _hear(Taped(place, quality, rate_hz), velocity, seconds)
    hop = max(256, -(-x.size // COLUMNS))
    size = FRAME if place.sounding_hz >= LONG_BELOW_HZ else 2 * FRAME
    power = stft_power(np.concatenate([np.zeros(size // 2), x]), size, hop)
    in_play = [point for point in draw(preset, note, velocity)["points"] if point["in_play"]]
    settled = math.ceil((release_s + SETTLED_S) * rate_hz)
    found = _partials(x[settled:], rate_hz, position, contact_cents(place.preset, note))
    ring = x[math.ceil((release_s + WINDOW_S[0]) * rate_hz) :]
    return {
        "rate_hz": rate_hz,
        "seconds": seconds,
        "release_s": round(release_s, 6),
        "peak_dbfs": round(gain_to_db(peak(x)), 2) if peak(x) > 0.0 else None,
        "waveform": waveform(x, rate_hz),
        "spectrogram": _spectrogram(power, rate_hz / size, hop / rate_hz),
        "pitch_cents": _pitch_cents(ring, rate_hz, place.sounding_hz),
        "partials": found,
        **_contacts(forces, in_play, seconds, 1.0 / place.sounding_hz),
        "formant": _formant(power, rate_hz / size, hop / rate_hz, place.sounding_hz, forces),
        "decays": decays_of(x[settled:], settled / rate_hz, rate_hz, found) if preset.coupled else [],
        "waking": heard.waking if preset.coupled else None,
    }


def _hear(engine: Taped, velocity: int, seconds: float) -> tuple[np.ndarray, Forces, Position, float]:
    """(sound (n,), forces, the model, when the finger lets go) of a string by itself."""
    out, touched = [], []
    for piece in engine.play(velocity, seconds):
        out.append(piece.out.copy())
        touched.append(touches(piece.first, piece.force))
    x = np.concatenate(out)[engine.latency_samples :]
    return x, gather(touched, engine.step_s), engine.position, engine.compiled[0].strings[0].draw_s


def _spectrogram(power: np.ndarray, bin_hz: float, step_s: float) -> dict[str, Any]:
    hz, rows = rows_of_power(power, bin_hz)
    shade = np.clip(np.round(255.0 * (1.0 - (rows - rows.max()) / FLOOR_DB)), 0, 255).astype(int)
    return {
        "start_s": 0.0,
        "step_s": step_s,
        "hz": hz,
        "floor_db": FLOOR_DB,
        "top_db": 0.0,
        "rows": shade.tolist(),
    }


def _pitch_cents(ring: np.ndarray, rate_hz: float, note_hz: float) -> float | None:
    try:
        return round(float(cents(sounding_fundamental(ring, rate_hz, note_hz), note_hz)), 3)
    except ValueError:
        return None  # too short, or gone


def _partials(ring: np.ndarray, rate_hz: float, position: Position, shift_cents: float) -> list[dict[str, Any]]:
    """The partials of what rings after the release against the modes of the string's model."""
    model_hz = position.omega[: position.own] / (2.0 * math.pi) * 2.0 ** (shift_cents / 1200.0)
    model_hz = model_hz[: int(np.searchsorted(model_hz, min(PARTIALS_TO_HZ, 0.45 * rate_hz)))][:PARTIALS]
    t60_s = LN_1000 / position.sigma[: model_hz.size]
    measured = np.full(model_hz.size, np.nan)
    level_db = np.full(model_hz.size, -np.inf)
    decay_s = np.full(model_hz.size, np.nan)
    piece = ring[: round(PARTIALS_S * rate_hz)]
    if model_hz.size and piece.size * model_hz[0] > 12.0 * rate_hz and peak(piece) > 0.0:
        measured, level_db = partials(piece, rate_hz, float(model_hz[0]), model_hz.size)
        heard = level_db > level_db.max() - PARTIALS_WITHIN_DB
        measured[~heard] = np.nan
        if heard.any():
            decay_s[heard] = decay_times_s(ring, rate_hz, measured[heard], bandwidth_hz=0.4 * float(model_hz[0]))
    return [
        {
            "number": j + 1,
            "model_hz": round(float(model_hz[j]), 3),
            "measured_hz": _or_none(measured[j], 3),
            "cents": round(cents(measured[j], model_hz[j]), 2) if math.isfinite(measured[j]) else None,
            "model_t60_s": round(float(t60_s[j]), 3),
            "measured_t60_s": _or_none(decay_s[j], 3),
            "level_db": _or_none(level_db[j], 2) if math.isfinite(measured[j]) else None,
        }
        for j in range(model_hz.size)
    ]


def _or_none(value: float, digits: int) -> float | None:
    return round(float(value), digits) if math.isfinite(value) else None


def _contacts(forces: Forces, points: list[dict[str, Any]], seconds: float, period_s: float) -> dict[str, Any]:
    forces = before(forces, seconds)
    found = contacts_of(forces, period_s)
    weakest = sorted((contact.impulse_ns for contact in found), reverse=True)[:MOST_CONTACTS][-1:] or [0.0]
    shown = [contact for contact in found if contact.impulse_ns >= weakest[0]][:MOST_CONTACTS]
    impulse, largest = binned(forces, len(points), seconds / TIME_BINS, TIME_BINS)
    touched = [k for k in range(len(points)) if impulse[k].any()]
    summary = []
    for k in touched:
        mine = [contact for contact in found if contact.point == k]
        summary.append(
            {
                "point": points[k]["index"],
                "label": points[k]["label"],
                "contacts": len(mine),
                "first_s": round(min(contact.start_s for contact in mine), 6),
                "last_s": round(max(contact.end_s for contact in mine), 6),
                "peak_n": _significant(max(contact.peak_n for contact in mine)),
                "impulse_ns": _significant(sum(contact.impulse_ns for contact in mine)),
            }
        )
    return {
        "contacts": [
            {
                "point": points[contact.point]["index"],
                "label": points[contact.point]["label"],
                "start_s": round(contact.start_s, 6),
                "end_s": round(contact.end_s, 6),
                "peak_n": _significant(contact.peak_n),
                "impulse_ns": _significant(contact.impulse_ns),
            }
            for contact in shown
        ],
        "contacts_found": len(found),
        "timeline": {
            "bin_s": seconds / TIME_BINS,
            "points": summary,
            "impulse_ns": [[_significant(value) for value in impulse[k]] for k in touched],
            "peak_n": [[_significant(value) for value in largest[k]] for k in touched],
        },
    }


def _significant(value: float) -> float:
    return float(f"{value:.4g}")


def _formant(
    power: np.ndarray, bin_hz: float, step_s: float, note_hz: float, forces: Forces
) -> list[dict[str, float]] | None:
    times_s = np.arange(len(power)) * step_s
    half_s = 0.5 / bin_hz
    moments = np.sort(forces.step) * forces.step_s
    touched = np.searchsorted(moments, times_s + half_s) > np.searchsorted(moments, times_s - half_s)
    found = descending_formant(power, np.arange(power.shape[1]) * bin_hz, times_s, note_hz, touched)
    if found is None:
        return None
    return [{"t_s": round(float(t), 4), "hz": round(float(hz), 1)} for t, hz in zip(*found, strict=True)]
