"""Notes of a preset, rendered by the engine as `synth render` does, without its limiter."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from synth.engine.engine import Engine
from synth.instrument.preset import Preset, playable_notes
from synth.midi.events import NOTE_OFF, NOTE_ON, make_events
from synth.units import midi_to_hz, midi_to_note
from truth_of_sound import measure
from truth_of_sound.note_features import features

RATE_HZ = 44100.0
#: what is judged: six notes from D1 (our basses' lowest is E1) to D3, soft to loud
BASS_NOTES = (28, 33, 36, 38, 43, 48)
VELOCITIES = (32, 80, 127)
#: what stands for pp and ff
SOFT, LOUD = 32, 127


#: velocities and length of the notes that the impostor test judges [s]
JUDGED_VELOCITIES, JUDGED_S = (48, 80, 110), 3.3


class Player:
    """One preset, ready to play. `play` begins from silence, but the hand goes on: two equal calls are two takes."""

    def __init__(self, preset: Preset) -> None:
        self.preset = preset
        self.engine = Engine([preset], limiter=False)
        self.engine.prepare(RATE_HZ)

    def play(self, events: Iterable[tuple[int, ...]], seconds: float) -> NDArray[np.float64]:
        """(frames, 2) of events (frame, kind, channel, number, value)."""
        self.engine.reset()
        out = np.zeros((round(seconds * RATE_HZ), 2))
        self.engine.process(make_events(list(events)), out)
        return out

    def note(self, note: int, velocity: int, seconds: float = 6.2, *, key: int | None = None, off_s: float | None = None,
             before: int = 0) -> NDArray[np.float64]:  # fmt: skip
        """(frames,) of one note, after a key that switches articulations; `before` equal notes go ahead, let go, unheard."""
        gap = round(1.5 * RATE_HZ)
        events: list[tuple[int, ...]] = []
        if key is not None:
            events += [(0, NOTE_ON, 0, key, 64), (1, NOTE_OFF, 0, key, 0)]
        for i in range(before):
            events += [(100 + i * gap, NOTE_ON, 0, note, velocity), (100 + i * gap + gap // 3, NOTE_OFF, 0, note, 0)]
        begin = 100 + before * gap
        events.append((begin, NOTE_ON, 0, note, velocity))
        if off_s is not None:
            events.append((begin + round(off_s * RATE_HZ), NOTE_OFF, 0, note, 0))
        return self.play(events, seconds + begin / RATE_HZ)[begin:].mean(axis=1)


def measured(player: Player, note: int, velocity: int, **how: int) -> dict[str, float]:
    """`measure.ring` and `measure.early` of a note."""
    found = measure.cut(player.note(note, velocity, **how), RATE_HZ)
    out = measure.ring(found, float(midi_to_hz(note)))
    return out | measure.early(found, out["f0_hz"])


def judged(player: Player, notes: Iterable[int]) -> list[dict[str, float]]:
    """`note_features.features` of notes at `JUDGED_VELOCITIES`.

    Raises ValueError for a note that the preset does not play.
    """
    if missing := sorted(set(notes) - set(playable_notes(player.preset))):
        named = ", ".join(midi_to_note(note) for note in missing)
        raise ValueError(f"{player.preset.name} does not play {named}, by which its family is judged; leave it out")
    return [
        features(player.note(note, velocity, JUDGED_S), RATE_HZ, note) for note in notes for velocity in JUDGED_VELOCITIES
    ]
