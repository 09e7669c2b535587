"""A note of strings that share a bridge, for its analysis: sound, contacts, and which strings ring with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from synth.author.views.coupled_motion import FLOOR_DB
from synth.author.views.decays import stages
from synth.fit.exponential import Bands
from synth.host.contacts import Forces, gather, touches
from synth.host.frames_tape import Frames, joined
from synth.instrument.compile import Position
from synth.instrument.place import NotePlace
from synth.instrument.preset import Preset

#: how often the strings' levels are looked at in a note, and how many partials' decays
LOOKS, DECAYS = 240, 12


@dataclass(frozen=True)
class HeardTogether:
    """x (n,) both channels' mean from the touch of the finger on; forces of each frame's last step on the string played."""

    x: np.ndarray
    forces: Forces
    position: Position
    release_s: float
    waking: dict[str, Any]


def hear_together(
    preset: Preset, place: NotePlace, velocity: int, seconds: float, quality: str, rate_hz: float
) -> HeardTogether:
    """The note, held. waking: {bin_s, strings: [{string, opened, played, level_db (per bin, re the loudest, −`FLOOR_DB` or
    above)}]}."""
    frames = round(seconds * rate_hz)
    made = Frames(preset, place, quality, rate_hz)
    out, touched = [], []
    for shots in made.play(velocity, 1, 1, frames, modes=False):
        out.append(shots.out.mean(axis=1))
        if len(shots.ends):
            touched.append(touches(int(shots.ends[0]), shots.force))
    x = np.concatenate(out)[made.latency_samples :][:frames]
    release_s = made.strings[made.number].draw_s
    waking = _waking(made, velocity, frames)
    return HeardTogether(x, gather(touched, 1.0 / rate_hz), made.position(made.line), release_s, waking)


def _waking(made: Frames, velocity: int, frames: int) -> dict[str, Any]:
    every = max(1, frames // LOOKS)
    shots = joined(list(made.play(velocity, every, every, frames // every, every)))
    energy = np.array(
        [
            sum(made.energy_j(made.directions * string + turn, shots) for turn in range(made.directions))
            for string in range(len(made.strings))
        ]
    )
    level = 10.0 * np.log10(np.maximum(energy / max(float(energy.max()), 1e-300), 10.0 ** (-FLOOR_DB / 10.0)))
    strings = [
        {"string": string.name, "opened": string.open_note, "played": number == made.number, "level_db": db}
        for number, (string, db) in enumerate(zip(made.strings, np.round(level, 1).tolist(), strict=True))
    ]
    return {"bin_s": every / made.rate_hz, "strings": strings}


def decays_of(ring: np.ndarray, begun_s: float, rate_hz: float, partials: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """[{number, early_t60_s, late_t60_s, beat_hz, beat_db, t_s, level_db, fitted_db}] of the first `DECAYS` partials that
    were measured and can be told; ring begins at begun_s."""
    heard = [partial for partial in partials if partial["measured_hz"] is not None][:DECAYS]
    if not heard:
        return []
    spacing = heard[0]["measured_hz"] / heard[0]["number"]
    try:
        bands = Bands(ring, rate_hz, spacing)
    except ValueError:
        return []
    out = []
    for partial in heard:
        found = stages(bands, partial["measured_hz"])
        if found is None:
            continue
        out.append(
            {
                "number": partial["number"],
                "early_t60_s": float(f"{found.early_t60_s:.4g}"),
                "late_t60_s": float(f"{found.late_t60_s:.4g}"),
                "beat_hz": None if found.beat_hz is None else float(f"{found.beat_hz:.4g}"),
                "beat_db": None if found.beat_db is None else round(found.beat_db, 2),
                "t_s": np.round(begun_s + found.t_s, 4).tolist(),
                "level_db": np.round(found.level_db, 2).tolist(),
                "fitted_db": np.round(found.fitted_db, 2).tolist(),
            }
        )
    return out
