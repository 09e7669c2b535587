"""Notes, hertz, decibels and cents. Middle C is C4, MIDI 60; A4 is MIDI 69."""

import math
import re

#: a decay rate [1/s] times the time in which the level falls by 60 dB [s]
LN_1000 = math.log(1000.0)
_SEMITONES = {"C": 0, "D": 2, "E": 4, "F": 5, "G": 7, "A": 9, "B": 11}
_ACCIDENTALS = {"": 0, "#": 1, "♯": 1, "##": 2, "x": 2, "b": -1, "♭": -1, "bb": -2}
_NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")
_NOTE = re.compile(r"([A-Ga-g])(##|bb|[#♯b♭x]?)(-?\d+)")


def note_to_midi(name: str) -> int:
    """MIDI number of a note name such as "C4", "c#3", "Bb-1" ("Cb4" is B3; "x" or "##" a double sharp).

    Raises ValueError for anything else, and outside MIDI's 0 … 127 (C-1 … G9).
    """
    match = _NOTE.fullmatch(name.strip()) if isinstance(name, str) else None
    if match is None:
        raise ValueError(f"note must be a letter A to G, an accidental and an octave like C#3, got {name!r}")
    letter, accidental, octave = match.groups()
    number = 12 * (int(octave) + 1) + _SEMITONES[letter.upper()] + _ACCIDENTALS[accidental]
    if not 0 <= number <= 127:
        raise ValueError(f"note must lie between C-1 and G9 (MIDI 0 to 127), got {name!r} (MIDI {number})")
    return number


def midi_to_note(number: int) -> str:
    """Name of a MIDI note number, with sharps: 61 → "C#4". Raises ValueError outside 0 … 127."""
    if number != int(number) or not 0 <= number <= 127:
        raise ValueError(f"MIDI note must be a whole number from 0 to 127, got {number}")
    octave, semitone = divmod(int(number), 12)
    return f"{_NAMES[semitone]}{octave - 1}"


def read_ratio(text: str) -> float:
    """A ratio of whole numbers ("3/2") or a number ("1.5"), which may be infinite or NaN. Raises ValueError.

    In no more time than the text is long, whatever it says.
    """
    numerator, slash, denominator = text.partition("/")
    try:
        return int(numerator) / int(denominator) if slash else float(text)
    except (ValueError, ZeroDivisionError, OverflowError):
        raise ValueError(f"must be a ratio such as 3/2 or a number such as 1.5, got {text!r}") from None


def midi_to_hz(note: float, a4_hz: float = 440.0) -> float:
    """Equal-tempered frequency [Hz] of a MIDI note number, fractional ones too (60.5: a quarter tone up)."""
    return _positive("a4_hz", a4_hz) * 2.0 ** ((note - 69.0) / 12.0)


def hz_to_midi(frequency_hz: float, a4_hz: float = 440.0) -> float:
    """Fractional MIDI note number of a frequency [Hz]. Raises ValueError unless both are > 0 Hz."""
    return 69.0 + 12.0 * math.log2(_positive("frequency_hz", frequency_hz) / _positive("a4_hz", a4_hz))


def cents(frequency_hz: float, reference_hz: float) -> float:
    """Interval from reference_hz up to frequency_hz in cents. Raises ValueError unless both are > 0 Hz."""
    ratio = _positive("frequency_hz", frequency_hz) / _positive("reference_hz", reference_hz)
    return 1200.0 * math.log2(ratio)


def db_to_gain(level_db: float) -> float:
    """Amplitude ratio of a level [dB]; −inf dB is 0."""
    return 10.0 ** (level_db / 20.0)


def gain_to_db(gain: float) -> float:
    """Level [dB] of an amplitude ratio; 0 is −inf dB. Raises ValueError below 0."""
    if not gain >= 0.0:
        raise ValueError(f"gain must be >= 0, got {gain}; give the magnitude, the sign has no level")
    return 20.0 * math.log10(gain) if gain > 0.0 else -math.inf


def duration(seconds: float) -> str:
    """ "45 s", "12 min", "3 h 20 min", "2 d 4 h"; "?" of what is not finite."""
    if not math.isfinite(seconds):
        return "?"
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    if minutes < 90:
        return f"{minutes} min"
    if minutes < 48 * 60:
        return f"{minutes // 60} h {minutes % 60} min"
    return f"{minutes // 1440} d {minutes % 1440 // 60} h"


def _positive(name: str, value: float) -> float:
    if not (value > 0.0 and math.isfinite(value)):
        raise ValueError(f"{name} must be > 0 Hz and finite, got {value}")
    return value
