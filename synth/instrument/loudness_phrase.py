"""The phrase by which instruments are made equally loud.

Presets are set so that it has −18 LUFS (EBU R 128, integrated) at velocity 80 and volume 100: `tools/loudness` measures that
and writes `output.gain_db`.
"""

from __future__ import annotations

import numpy as np

from synth.instrument.preset import Preset, fret_count, playable_notes
from synth.midi.events import NOTE_OFF, NOTE_ON, make_events

#: [LUFS], and how far a preset may be from it [LU]
TARGET_LUFS, TOLERANCE_LU = -18.0, 1.0
VELOCITY = 80
RATE_HZ = 44100
#: where the phrase's notes lie among those that are mostly played, 0 the lowest … 7 the highest; played twice
PLACES = (1, 3, 2, 4, 3, 5, 4, 6)
#: from note to note [s]: eighths at 120 beats a minute; where strings ring on, the strokes of a drone. Each is held for
#: HELD of it.
STEP_S, DRONE_STEP_S, HELD = 0.25, 1.0, 0.95
#: on a neck, most is played up to this fret of the highest string
FRET = 5
#: what is heard behind the last note [s]
TAIL_S = 0.5


def loudness_phrase(preset: Preset, velocity: int = VELOCITY) -> tuple[np.ndarray, int]:
    """(EVENT array at RATE_HZ, frames) of the phrase: eight notes over the compass, each twice; on a neck over its first
    positions."""
    notes = playable_notes(preset)
    if fret_count(preset):
        highest = max(table.notes[1] for table in preset.string) + min(FRET, fret_count(preset))
        notes = [note for note in notes if note <= highest]
    step_s = DRONE_STEP_S if preset.damping.ring_on else STEP_S
    keys = [notes[round(place / 7.0 * (len(notes) - 1))] for place in 2 * PLACES]
    rows = []
    for number, key in enumerate(keys):
        rows.append((round(number * step_s * RATE_HZ), NOTE_ON, 0, key, velocity))
        rows.append((round((number + HELD) * step_s * RATE_HZ), NOTE_OFF, 0, key, 64))
    return make_events(rows), round((len(keys) * step_s + TAIL_S) * RATE_HZ)
