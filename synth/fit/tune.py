"""Calibration of a preset's pitch: what the contact does to the sounding fundamental, measured and taken back.

Where a string touches a bridge for a part of every period it speaks shorter, and sounds some cents sharp, the more the
harder it is plucked. `measure` renders every playable position of a preset alone at a medium velocity and compares the
sounding fundamental with the pitch of the note; `calibrate` turns that into the `tuning.contact_cents` table that brings
it back, iterated because the shift depends on the string's tension.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from synth.dsp.measures import sounding_fundamental
from synth.engine.engine import Engine
from synth.instrument.compile import note_frequency
from synth.instrument.neck import single_strings
from synth.instrument.preset import Preset, StringTable, at_note, contact_cents, fret_count
from synth.midi.events import NOTE_ON, make_events
from synth.units import cents, midi_to_note

#: the reference pluck, and the part of the sound that has a pitch, counted from the moment the string is let go
VELOCITY = 64
#: strings that nobody plucks move little
SYMPATHETIC_VELOCITY = 16
WINDOW_S = (0.2, 2.0)
#: a correction moves by at least and at most so much for an error of 1 cent
_FLATTEST, _STEEPEST = 0.25, 2.5
#: how far an instrument of few strings is tuned up and down [semitones]
TUNING_RANGE = 5


@dataclass(frozen=True)
class Pitch:
    """What one position of one string sounds like, `cents` above the pitch of its note."""

    table: int
    string: str
    note: int
    fret: int
    target_hz: float
    cents: float
    sympathetic: bool = False


def tunings(preset: Preset) -> tuple[int, ...]:
    """Semitones by which the strings of a preset are tuned away from its notes, to be measured as well.

    Only where every string has one note of its own and no neck (a tanpura): a fourth down, none, a fourth up.
    """
    alone = all(table.notes[0] == table.notes[1] for table in preset.string)
    if not alone or fret_count(preset):
        return (0,)
    return (-TUNING_RANGE, 0, TUNING_RANGE)


def retuned(preset: Preset, semitones: int) -> Preset:
    """The preset with every string's notes moved by `semitones`; the strings stay the same."""
    if semitones == 0:
        return preset
    strings = []
    for table in preset.string:
        # numbers at anchor notes are the string's, whose notes were those of the preset
        fixed = {
            field: at_note(value, table.notes[0])
            for field, value in table
            if isinstance(value, dict) and table.notes[0] == table.notes[1]
        }
        moved = (table.notes[0] + semitones, table.notes[1] + semitones)
        strings.append(table.model_copy(update={**fixed, "notes": moved}))
    return preset.model_copy(update={"string": tuple(strings)})


def sympathetic_played(preset: Preset) -> Preset | None:
    """The strings that no key plays as a preset in which each has one, with their corrections; None: there are none."""
    strings = [table.model_copy(update={"sympathetic": False, "frets": 0}) for table in preset.string if table.sympathetic]
    if not strings:
        return None
    tuning = preset.tuning.model_copy(update={"contact_cents": preset.tuning.sympathetic_cents})
    changed: dict[str, object] = {"string": tuple(strings), "tuning": tuning}
    if preset.setup is not None:  # whose names are those of the strings that are played
        changed["setup"] = preset.setup.model_copy(update={"strings": ()})
    return preset.model_copy(update=changed)


def _sound(engine: Engine, note: int, velocity: int, seconds: float) -> np.ndarray:
    """(frames,) left channel from the moment the note's string is let go."""
    engine.reset()
    string = engine.compiled[0].strings[0]
    begin = engine.latency_samples + math.ceil(string.draw_s * engine.rate_hz)
    out = np.zeros((begin + math.ceil(seconds * engine.rate_hz), 2))
    engine.process(make_events([(0, NOTE_ON, 0, note, velocity)]), out)
    return out[begin:, 0]


def measure(
    preset: Preset,
    notes: set[int] | None = None,
    *,
    rate_hz: float = 44100.0,
    quality: str = "standard",
    velocity: int = VELOCITY,
    window_s: tuple[float, float] = WINDOW_S,
) -> list[Pitch]:
    """The pitch of every playable position [cents above its note], each string alone, the note held.

    notes: only these notes; None: all. window_s: the part of the sound measured, from the release of the string on.
    Where a note is gone before the window ends, the part in which it sounds (40 dB below its maximum) counts. Raises
    ValueError where no fundamental is found within ±60 cents, PresetError for a preset that does not compile.
    """
    found = []
    for index, opened, alone in single_strings(preset, notes):
        engine = Engine([alone], quality=quality, limiter=False)
        engine.prepare(rate_hz)
        table = alone.string[0]
        for position in engine.compiled[0].strings[0].positions:
            if notes is not None and position.note not in notes:
                continue
            x = _sound(engine, position.note, velocity, window_s[1])[round(window_s[0] * rate_hz) :]
            target = note_frequency(alone, table, position.note, None)
            try:
                heard = sounding_fundamental(x, rate_hz, target)
            except ValueError as error:
                raise ValueError(
                    f"{preset.name}: string {_label(table, opened)}, note {midi_to_note(position.note)}: {error}"
                ) from None
            found.append(
                Pitch(index, _label(table, opened), position.note, position.fret, target, float(cents(heard, target)))
            )
    return found


def measure_all(preset: Preset, *, rate_hz: float = 44100.0, quality: str = "standard") -> list[Pitch]:
    """`measure` of every position in every one of the preset's `tunings`, and of its sympathetic strings as if played."""
    pitches = [
        pitch
        for semitones in tunings(preset)
        for pitch in measure(retuned(preset, semitones), rate_hz=rate_hz, quality=quality)
    ]
    along = sympathetic_played(preset)
    if along is not None:
        found = measure(along, rate_hz=rate_hz, quality=quality, velocity=SYMPATHETIC_VELOCITY)
        pitches += [replace(pitch, sympathetic=True) for pitch in found]
    return pitches


def worst(pitches: list[Pitch]) -> Pitch:
    """The position that is farthest from its pitch."""
    return max(pitches, key=lambda pitch: abs(pitch.cents))


def calibrate(
    preset: Preset,
    *,
    rate_hz: float = 44100.0,
    quality: str = "standard",
    residual_cents: float = 0.5,
    rounds: int = 12,
) -> tuple[Preset, list[Pitch]]:
    """The preset with the `tuning.contact_cents` that bring every position to its pitch, and what was measured last.

    Positions of several strings with one note share an entry: it corrects the middle between the sharpest and the
    flattest, by secants, because close to a mode of the body a string's pitch does not follow its tension. Stops when no
    entry would move by more than `residual_cents`. Raises ValueError when that is not reached in `rounds` rounds, or as
    `measure` does.
    """
    before: dict[tuple[bool, int], tuple[float, float]] = {}
    for _ in range(rounds):
        pitches = measure_all(preset, rate_hz=rate_hz, quality=quality)
        errors: dict[tuple[bool, int], list[float]] = {}
        for pitch in pitches:
            errors.setdefault((pitch.sympathetic, pitch.note), []).append(pitch.cents)
        middle = {key: 0.5 * (min(values) + max(values)) for key, values in errors.items()}
        if max(abs(value) for value in middle.values()) <= residual_cents:
            return preset, pitches
        tables: dict[bool, dict[int, float]] = {}
        for (along, note), value in sorted(middle.items()):
            at = contact_cents(preset, note, sympathetic=along)
            step = value * _slope(at, value, before.get((along, note)))
            before[along, note] = (at, value)
            tables.setdefault(along, {})[note] = round(at + step, 2)
        kept = {("contact_cents", "sympathetic_cents")[along]: table for along, table in tables.items()}
        preset = preset.model_copy(update={"tuning": preset.tuning.model_copy(update=kept)})
    key = max(middle, key=lambda each: abs(middle[each]))
    note = key[1]
    raise ValueError(
        f"{preset.name}: pitch must settle within {residual_cents:g} cents, got {middle[key]:+.2f} cents at "
        f"{midi_to_note(note)} after {rounds} rounds; the pitch is not steady there, lower the pluck or the buzz"
    )


def _slope(at: float, error: float, before: tuple[float, float] | None) -> float:
    """How far a correction must move for an error of 1 cent, by this one and the one before; 1 where they say nothing."""
    if before is None or abs(before[1] - error) < 0.05:
        return 1.0
    return min(max((at - before[0]) / (before[1] - error), _FLATTEST), _STEEPEST)


def _label(table: StringTable, opened: int) -> str:
    return table.name or midi_to_note(opened)
