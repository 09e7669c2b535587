"""What is played to hear an instrument: a few seconds that suit its kind."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from synth.author.phrases import NAMES, phrase
from synth.instrument.preset import Preset, playable_notes
from synth.midi.events import NOTE_OFF, NOTE_ON, make_events

Note = tuple[float, float, int]  # begin [s], held for [s], semitones above the tune's first note

#: arpeggios over four chords, i VI III VII, and the first again as a chord [semitones above the key]
_CHORDS = ((0, 7, 12, 15), (-4, 3, 8, 12), (3, 10, 15, 19), (-2, 5, 10, 14))
_STEP_S, _LAST_S = 0.2, 2.2
ARPEGGIO: tuple[Note, ...] = (
    *(
        ((bar * 6 + place) * _STEP_S, (6 - place) * _STEP_S, chord[note])
        for bar, chord in enumerate(_CHORDS)
        for place, note in enumerate((0, 1, 2, 3, 2, 1))
    ),
    *((24 * _STEP_S + 0.03 * number, _LAST_S, step) for number, step in enumerate(_CHORDS[0])),
)


def _melody(steps: Sequence[tuple[float, int]], beat_s: float) -> tuple[Note, ...]:
    """A tune of (beats, semitones): each held until the next, the last for two beats more."""
    begins = np.concatenate([[0.0], np.cumsum([beats for beats, _ in steps])]) * beat_s
    return tuple(
        (float(begins[n]), 0.95 * beats * beat_s + (2 * beat_s if n == len(steps) - 1 else 0.0), step)
        for n, (beats, step) in enumerate(steps)
    )


#: up and down Bhupali (Sa Re Ga Pa Dha), and the scale of the koto's hirajoshi tuning
BHUPALI = _melody(
    [
        (1, 0),
        (0.5, 2),
        (0.5, 4),
        (1, 7),
        (0.5, 9),
        (0.5, 12),
        (1, 9),
        (0.5, 7),
        (0.5, 4),
        (0.5, 7),
        (0.5, 4),
        (1, 2),
        (2, 0),
    ],
    0.5,
)
HIRAJOSHI = _melody(
    [(1, 12), (0.5, 8), (0.5, 7), (1, 3), (0.5, 2), (0.5, 0), (0.5, 2), (0.5, 3), (1, 7), (0.5, 8), (0.5, 7), (2, 0)], 0.5
)
#: families of presets whose tune is not the arpeggio
TUNES = {"sitar": BHUPALI, "veena": BHUPALI}
OF_PRESETS = {name: HIRAJOSHI for name in ("koto", "koto-hirajoshi", "shamisen", "shamisen-clear")}
#: the key that a tune is in, where it is not the A (of a melody, the C) that suits the compass best
KEYS = {"sitar": 61, "sitar-closed": 61, "sitar-gandhar": 62, "veena": 52, "veena-soft": 52}


def events(preset: Preset, name: str, velocity: int, rate_hz: int) -> np.ndarray:
    """EVENT array of `name`: one of `synth.author.phrases` from the preset's lowest note on, or "tune", which suits its
    family. Raises ValueError for another."""
    there = playable_notes(preset)
    if name == "tune" and preset.family in ("bass", "tanpura"):
        name = "riff" if preset.family == "bass" else "drone"
    if name in NAMES:
        return phrase(name, preset, there[0], velocity, rate_hz).events
    if name != "tune":
        raise ValueError(f"phrase: must be tune, {', '.join(NAMES)}, got {name!r}")
    tune = OF_PRESETS.get(preset.name) or TUNES.get(preset.family, ARPEGGIO)
    key = KEYS.get(preset.name) or _key(there, tune, 9 if tune is ARPEGGIO else 0)
    rows: list[tuple[int, int, int, int, int]] = []
    ends: dict[int, int] = {}
    for begin_s, held_s, step in tune:
        note = min(there, key=lambda each: (abs(each - key - step), each))
        begin = round(begin_s * rate_hz)
        if ends.get(note, 0) > begin:  # the same key again: it is let go first
            rows = [(begin - 1, *row[1:]) if row[:4:3] == (ends[note], note) and row[1] == NOTE_OFF else row for row in rows]
        ends[note] = begin + round(held_s * rate_hz)
        rows += [(begin, NOTE_ON, 0, note, velocity), (ends[note], NOTE_OFF, 0, note, 64)]
    rows.sort(key=lambda row: (row[0], row[1] == NOTE_ON))
    return make_events(rows)


def _key(there: Sequence[int], tune: Sequence[Note], pitch_class: int) -> int:
    """The key of that pitch class, near the A or C below middle C, from which most of a tune can be played as it is."""
    known = set(there)
    keys = [key for key in range(128) if key % 12 == pitch_class]
    return max(keys, key=lambda key: (sum(key + step in known for *_, step in tune), -abs(key - 51)))
