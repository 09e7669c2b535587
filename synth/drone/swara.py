"""Swaras: the notes of Indian music as ratios to Sa, and what the strings of a tanpura are tuned to.

The ratios are those of just intonation with small numbers; the equal temperament takes the nearest of twelve steps.
"""

from __future__ import annotations

import math
import re
from fractions import Fraction

from synth.spelling import perhaps
from synth.units import midi_to_hz, note_to_midi, read_ratio

#: Sa up to the Sa above; komal is flat, tivra sharp, shuddh neither
RATIOS = {
    "sa": Fraction(1),
    "komal re": Fraction(16, 15),
    "re": Fraction(9, 8),
    "komal ga": Fraction(6, 5),
    "ga": Fraction(5, 4),
    "ma": Fraction(4, 3),
    "tivra ma": Fraction(45, 32),
    "pa": Fraction(3, 2),
    "komal dha": Fraction(8, 5),
    "dha": Fraction(5, 3),
    "komal ni": Fraction(9, 5),
    "ni": Fraction(15, 8),
}
#: full names of the swaras, as Hindustani and Carnatic musicians write them, by the beginning that tells them apart
_FULL_NAMES = {
    r"shadja?m?|shadaj|षड्ज|सा": "sa",
    r"r[ie]shabh?(a|am)?|ri|ऋषभ|रे": "re",
    r"gandh?ar(a|am)?|गांधार|ग": "ga",
    r"madh?yam(a|am)?|मध्यम|म": "ma",
    r"pancham(a|am)?|पंचम|प": "pa",
    r"dh?aivat?h?(a|am)?|da|धैवत|ध": "dha",
    r"nish(a|aa)dh?(a|am)?|निषाद|नि": "ni",
}
#: letters of written sargam, whose case tells the two forms of a swara apart
_LETTERS = {
    "S": "sa", "r": "komal re", "R": "re", "g": "komal ga", "G": "ga", "m": "ma", "M": "tivra ma", "P": "pa",
    "d": "komal dha", "D": "dha", "n": "komal ni", "N": "ni",
}  # fmt: skip
#: spellings of what alters a swara: the Carnatic names of a Ma and a Ni among them
_ALTERED = {
    r"teevra|tivr|prati": "tivra",
    r"kom[ao]l|kai[sk]h?iki|kaisiki": "komal",
    r"shuddha?|suddha?|kakali|shudh": "",
}
#: where a frequency may be given instead of a note [Hz]
LOWEST_HZ, HIGHEST_HZ = 20.0, 2000.0


def ratio_of(text: str) -> float:
    """Ratio to the Sa below, 1 to 2, of a swara (Pa, komal-Ni, tivra Ma, shuddh Ga, Nishad, N) or a ratio (3/2, 1.5).

    Raises ValueError.
    """
    words = _plain(text)
    if words in RATIOS:
        return float(RATIOS[words])
    try:
        ratio = read_ratio(words)
    except ValueError:
        ratio = math.nan
    if not 1.0 <= ratio <= 2.0:
        raise ValueError(
            f"must be a swara such as Pa, Ma, Ni, komal-Ni, or a ratio from 1 to 2 such as 3/2, got {text!r}"
            f"{perhaps(words, RATIOS)}"
        )
    return ratio


def _plain(text: str) -> str:
    """A swara's name as `RATIOS` has it, of whatever a musician writes; other text in small letters."""
    if text.strip() in _LETTERS:
        return _LETTERS[text.strip()]
    words = re.split(r"[\s_-]+", text.strip().lower())
    for at, word in enumerate(words):
        for names in (_ALTERED, _FULL_NAMES):
            words[at] = next((name for spelled, name in names.items() if re.fullmatch(spelled, word)), words[at])
    return " ".join(filter(None, words))


def name_of(ratio: float) -> str:
    """Swara of a ratio where it is one ("Pa", "komal Ni"), else its number."""
    for name, swara in RATIOS.items():
        if math.isclose(ratio, swara, rel_tol=1e-9):
            return " ".join(word if word in ("komal", "tivra") else word.capitalize() for word in name.split())
    return f"{ratio:.5g}"


def tempered(ratio: float) -> float:
    """The ratio of the nearest step of the equal temperament."""
    return 2.0 ** (round(12.0 * math.log2(ratio)) / 12.0)


def frequency_of(text: str, a4_hz: float = 440.0, near: int = 48) -> float:
    """Frequency [Hz] of a note (C3, F#3; C# alone: the C# nearest to the MIDI note `near`) or of hertz (138.6).

    Raises ValueError.
    """
    try:
        frequency = float(text)
    except ValueError:
        try:
            return midi_to_hz(_note(text, near), a4_hz)
        except ValueError:
            frequency = math.nan
    if not LOWEST_HZ <= frequency <= HIGHEST_HZ:
        raise ValueError(
            f"must be a note such as C# or C#3, or hertz from {LOWEST_HZ:g} to {HIGHEST_HZ:g} such as 138.6, got {text!r}"
        )
    return frequency


def _note(text: str, near: int) -> int:
    """MIDI number of a note with or without an octave. Raises ValueError."""
    if text.strip()[-1:].isdigit():
        return note_to_midi(text)
    octaves = (note_to_midi(f"{text.strip()}{octave}") for octave in range(9))
    return min(octaves, key=lambda number: (abs(number - near), number))
