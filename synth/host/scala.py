"""Scala tunings: .scl (a scale) and .kbm (which key plays which degree) → a frequency for every MIDI note.

Source: the file formats as Scala (Manuel Op de Coul) documents them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from synth.files.sources import read_bytes
from synth.units import midi_to_hz, read_ratio

#: largest file that is read [bytes]
MOST_BYTES = 1 << 20
MIDDLE_C = 60
#: a pitch lies within so many octaves of degree 0, and a key sounds between these [Hz]: far beyond what can be heard
MOST_OCTAVES = 64
LOWEST_HZ, HIGHEST_HZ = 1e-3, 1e6
MIDDLE_C_HZ = 440.0 * 2.0 ** (-9.0 / 12.0)


class ScalaError(ValueError):
    """A .scl or .kbm file that cannot be used; the message names file, line, what is wrong, a remedy."""


@dataclass(frozen=True)
class Scale:
    """cents: pitches of degrees 1…n above degree 0; the last is the interval at which the scale repeats."""

    description: str
    cents: tuple[float, ...]


@dataclass(frozen=True)
class KeyboardMapping:
    """Which key plays which degree.

    first, last: the keys that sound.  middle: the key of the mapping's first entry.  reference: the key that
    has `reference_hz`.  octave_degree: degree that lies one repetition of `mapping` higher (0: the scale's
    length).
    mapping: degree per key or None for a key that is silent; empty for key after key.
    """

    first: int = 0
    last: int = 127
    middle: int = MIDDLE_C
    reference: int = MIDDLE_C
    reference_hz: float = MIDDLE_C_HZ
    octave_degree: int = 0
    mapping: tuple[int | None, ...] = ()


def note_frequencies(scale_path: str | Path | None, keyboard_path: str | Path | None = None) -> np.ndarray:
    """(128,) Hz of every MIDI note, NaN for keys that the keyboard mapping leaves silent.

    Without a keyboard, degree 0 is middle C at 261.63 Hz. Without a scale, 12 equal steps. Raises ScalaError.
    """
    scale = read_scale(scale_path) if scale_path is not None else Scale("12 equal", tuple(map(float, range(100, 1300, 100))))
    keyboard = read_keyboard(keyboard_path) if keyboard_path is not None else KeyboardMapping()
    reference = _key_cents(scale, keyboard, keyboard.reference)
    if reference is None:
        raise ScalaError(f"{keyboard_path}: the reference key {keyboard.reference} is not mapped; choose another")
    note_hz = np.full(128, np.nan)
    for key in range(keyboard.first, keyboard.last + 1):
        cents = _key_cents(scale, keyboard, key)
        if cents is not None:
            note_hz[key] = _hz(keyboard.reference_hz, (cents - reference) / 1200.0)
    return note_hz


def _hz(reference_hz: float, octaves: float) -> float:
    """Beyond all hearing it is the same how far: no string plays such a key."""
    octaves = min(max(octaves, -MOST_OCTAVES), MOST_OCTAVES)
    return min(max(reference_hz * 2.0**octaves, LOWEST_HZ), HIGHEST_HZ)


def playable_frequencies(
    scale_path: str | Path | None, keyboard_path: str | Path | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """(128,) Hz of every MIDI note, all of them finite, and (128,) bool: the keys that are to be silent.

    Those have their ordinary frequency: an engine never sees a NaN. Raises ScalaError.
    """
    note_hz = note_frequencies(scale_path, keyboard_path)
    silent = np.isnan(note_hz)
    note_hz[silent] = [midi_to_hz(float(key)) for key in np.flatnonzero(silent)]
    return note_hz, silent


def _key_cents(scale: Scale, keyboard: KeyboardMapping, key: int) -> float | None:
    """Cents of a key above degree 0 at the middle key."""
    steps = key - keyboard.middle
    if not keyboard.mapping:
        return _degree_cents(scale, steps)
    turns, place = divmod(steps, len(keyboard.mapping))
    degree = keyboard.mapping[place]
    if degree is None:
        return None
    repeat = _degree_cents(scale, keyboard.octave_degree or len(scale.cents))
    return turns * repeat + _degree_cents(scale, degree)


def _degree_cents(scale: Scale, degree: int) -> float:
    turns, place = divmod(degree, len(scale.cents))
    return turns * scale.cents[-1] + (scale.cents[place - 1] if place else 0.0)


def read_scale(path: str | Path) -> Scale:
    """Reads a .scl file. Raises ScalaError."""
    lines = _lines(path)
    if len(lines) < 2:
        raise ScalaError(f"{path}: a scale has a description line and a line with the number of notes; give a .scl file")
    (_, description), (number, count_text) = lines[0], lines[1]
    count = _integer(path, number, count_text, "the number of notes", 1, 4096)
    pitches = [line for line in lines[2:] if line[1]]
    if len(pitches) < count:
        raise ScalaError(f"{path}: {count} notes are declared, {len(pitches)} found; correct line {number}")
    cents = tuple(_pitch_cents(path, number, text) for number, text in pitches[:count])
    if cents[-1] <= 0.0:
        raise ScalaError(f"{path}: the last pitch, where the scale repeats, must be above 1/1, got {cents[-1]:g} cents")
    return Scale(description, cents)


def read_keyboard(path: str | Path) -> KeyboardMapping:
    """Reads a .kbm file. Raises ScalaError."""
    lines = [line for line in _lines(path) if line[1]]
    if len(lines) < 7:
        raise ScalaError(f"{path}: a keyboard mapping begins with seven numbers, got {len(lines)}; give a .kbm file")
    names = ("the map's size", "the first key", "the last key", "the middle key", "the reference key")
    ranges = ((0, 128), (0, 127), (0, 127), (0, 127), (0, 127))
    size, first, last, middle, reference = (
        _integer(path, *line, name, low, high) for line, name, (low, high) in zip(lines[:5], names, ranges, strict=True)
    )
    number, text = lines[5]
    try:
        reference_hz = float(text.split()[0])
    except ValueError:
        reference_hz = math.nan
    if not 1.0 <= reference_hz <= 20_000.0:
        raise ScalaError(f"{path}, line {number}: the reference frequency must be 1 to 20000 Hz, got {text!r}")
    octave_degree = _integer(path, *lines[6], "the octave's degree", 0, 4096)
    if last < first:
        raise ScalaError(f"{path}: the last key ({last}) is below the first ({first}); swap them")
    mapping: list[int | None] = []
    for number, text in lines[7 : 7 + size]:
        silent = text.split()[0].lower() == "x"
        mapping.append(None if silent else _integer(path, number, text, "a degree", 0, 4096))
    # Scala lets trailing silent keys be left out.
    mapping += [None] * (size - len(mapping))
    return KeyboardMapping(first, last, middle, reference, reference_hz, octave_degree, tuple(mapping))


def _lines(path: str | Path) -> list[tuple[int, str]]:
    """(number, stripped text) of the lines that are no comments; the first may be empty (a description)."""
    try:
        text = read_bytes(path, MOST_BYTES, "Scala file").decode("latin-1")
    except FileNotFoundError:
        raise ScalaError(f"{path}: no such file; check the name") from None
    except OSError as error:
        raise ScalaError(f"{path}: cannot be read ({error.strerror})") from None
    numbered = enumerate(text.splitlines(), start=1)
    return [(number, line.strip()) for number, line in numbered if not line.startswith("!")]


def _integer(path: str | Path, number: int, text: str, name: str, low: int, high: int) -> int:
    try:
        value = int(text.split()[0])
    except (ValueError, IndexError):
        raise ScalaError(f"{path}, line {number}: {name} must be a whole number, got {text!r}") from None
    if not low <= value <= high:
        raise ScalaError(f"{path}, line {number}: {name} must be {low} to {high}, got {value}")
    return value


def _pitch_cents(path: str | Path, number: int, text: str) -> float:
    """A pitch line: cents if it has a point, else a ratio or a whole number; what follows is a comment."""
    word = text.split()[0]
    try:
        if "." in word:
            cents = float(word)
        else:
            ratio = read_ratio(text.split("!")[0].replace(" /", "/").replace("/ ", "/").split()[0])
            cents = 1200.0 * math.log2(ratio) if 0.0 < ratio < math.inf else math.nan
    except (ValueError, IndexError):
        cents = math.nan
    if abs(cents) <= 1200.0 * MOST_OCTAVES:
        return cents
    if abs(cents) < math.inf:
        raise ScalaError(
            f"{path}, line {number}: a pitch must lie within {MOST_OCTAVES} octaves of 1/1 (±{1200 * MOST_OCTAVES} cents), "
            f"got {text!r}"
        )
    raise ScalaError(f"{path}, line {number}: {text!r} is not a pitch; write cents with a point (701.955) or a ratio (3/2)")
