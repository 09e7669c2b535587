"""Which preset answers each program of General MIDI, and why: the table of `synth render` and `synth play --gm`.

An answer is the nearest plucked or struck string. Names are in the order of preference: the first that comes with the
program is taken. What is no plucked or struck string (bowed, blown, sung, electronic) has a stand-in, which reports name
as such.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from synth.instrument.preset import preset_folder

#: played by every string for itself, over five and a half octaves
HARP = "jawari-harp"
BASS = "fretted-bass"


@dataclass(frozen=True)
class Answer:
    """presets: names, the nearest first.  why: what makes them near.  string: whether the program is a plucked or struck
    string, which a preset can be; False: it stands in.  articulations: how it is played, the best first; a preset that has
    none of them plays as it does by itself.  gain_db: what makes it as loud in that articulation as presets are by
    themselves (`tools/loudness --check` measures it)."""

    presets: tuple[str, ...]
    why: str
    string: bool = True
    articulations: tuple[str, ...] = ()
    gain_db: float = 0.0

    @property
    def preset(self) -> str:
        """The nearest one that there is."""
        return next(name for name in self.presets if name in _there())


@cache
def _there() -> frozenset[str]:
    return frozenset(path.stem for path in preset_folder().glob("*.toml"))


def answer(program: int) -> Answer:
    """The answer to a program, 0…127."""
    return ANSWERS[program]


_ELECTRIC = ("clavinet", "clavichord", "harpsichord", HARP)
_SOFT_ELECTRIC = ("clavinet-neck", *_ELECTRIC)
_PLUCKED_KEYS = ("harpsichord", "clavichord", "clavinet", HARP)
_CHOIRS = ("harpsichord-full", *_PLUCKED_KEYS)
_DULCIMER = ("dulcimer", "harpsichord", HARP)
_NYLON = ("nylon-guitar", "steel-guitar", HARP)
_STEEL = ("steel-guitar", "nylon-guitar", HARP)
_GUITAR = ("electric-guitar-middle", "electric-guitar", "steel-guitar", HARP)
_JAZZ = ("jazz-guitar", "electric-guitar-neck", *_GUITAR)
_BRIDGE = ("electric-guitar", "steel-guitar", HARP)
_CONCERT = ("harp", HARP)
_PIZZICATO = ("pizzicato-strings", "harp", HARP)
_FINGER = (BASS,)
_PICK = ("picked-bass", BASS)
_FRETLESS = ("fretless-bass", BASS)
_UPRIGHT = ("double-bass", "fretless-bass", BASS)
_SLAP = ("slap-bass", BASS)
_SITAR = ("sitar", "veena", HARP)
_BANJO = ("banjo", "shamisen", "steel-guitar", HARP)
_SHAMISEN = ("shamisen", "banjo", "nylon-guitar", HARP)
_KOTO = ("koto", "harp", HARP)

_BARS = "bars, plates or bells that are struck: the dulcimer's strings are struck, too, and ring as freely"
_ORGAN = "pipes or reeds that sound as long as the key is down: the harp rings longest, over the widest compass"
_BOWED = "a bow holds the string in motion, which no preset does: the harp plays its notes, plucked"
_MANY = "many players with bows, or an imitation of them: the harp plays their notes, plucked"
_VOICES = "voices, or an imitation of them: the harp plays their notes"
_BRASS = "lips and a tube: the jawari harp plays its notes, with the buzz of its bridge for the brightness of brass"
_REED = "a reed and a tube: the jawari harp plays its notes, with the buzz of its bridge for the reed's"
_FLUTE = "an air jet: the harp plays its notes"
_LEAD = "an oscillator: the jawari harp's buzz is nearest to its many partials"
_PAD = "electronic sound that swells: the harp plays its notes, which die away"
_EFFECT = "an electronic effect: the harp plays its notes"
_DRUM = "a drum with some pitch: the lowest bass string plays its notes"
_NOISE = "a noise without pitch: a bass string plays its notes, which is a thump at most"

#: of programs 0…127
ANSWERS: tuple[Answer, ...] = (
    Answer(_PLUCKED_KEYS, "metal strings under keys, of nearly as wide a compass: the harpsichord's, which are plucked"),
    Answer(_PLUCKED_KEYS, "metal strings under keys, of nearly as wide a compass: the harpsichord's, which are plucked"),
    Answer(_ELECTRIC, "struck strings with pickups under keys, as the clavinet's"),
    Answer(_CHOIRS, "strings in choirs that beat: all the harpsichord's choirs"),
    Answer(_SOFT_ELECTRIC, "tines with pickups under keys: the clavinet has strings there", string=False),
    Answer(_SOFT_ELECTRIC, "an electronic imitation of tines: the clavinet has keys and pickups", string=False),
    Answer(_PLUCKED_KEYS, "the harpsichord itself"),
    Answer(_ELECTRIC, "the clavinet itself"),
    *(Answer(_DULCIMER, _BARS, string=False) for _ in range(8, 15)),
    Answer(_DULCIMER, "the hammered dulcimer itself, else metal strings in courses"),
    *(Answer(_CONCERT, _ORGAN, string=False) for _ in range(16, 24)),
    Answer(_NYLON, "the nylon-string guitar itself, else one with steel strings"),
    Answer(_STEEL, "the steel-string guitar itself"),
    Answer(_JAZZ, "an electric guitar, the pickup at the neck"),
    Answer(_GUITAR, "an electric guitar"),
    Answer(_GUITAR, "an electric guitar under the palm", articulations=("palm-mute",), gain_db=9.8),
    Answer(_BRIDGE, "an electric guitar, without what overdrives its amplifier"),
    Answer(_BRIDGE, "an electric guitar, without what distorts it"),
    Answer(_GUITAR, "an electric guitar, touched at a node", articulations=("harmonic",), gain_db=2.3),
    Answer(_UPRIGHT, "a double bass plucked with a finger, stopped on a bare board: the fretless bass"),
    Answer(_FINGER, "the fretted bass, played with a finger"),
    Answer(_PICK, "the bass played with a plectrum, else the fretted bass"),
    Answer(_FRETLESS, "the fretless bass itself"),
    Answer(_SLAP, "the bass that is slapped: the thumb is its normal stroke"),
    Answer(_SLAP, "the bass that is slapped, with a pop where there is one", articulations=("pop",), gain_db=3.5),
    Answer(_FINGER, "an oscillator in the bass: the fretted bass plays its notes", string=False),
    Answer(_FRETLESS, "an oscillator in the bass: the fretless bass plays its notes", string=False),
    *(Answer(_CONCERT, _BOWED, string=False) for _ in range(40, 43)),
    Answer(
        _UPRIGHT, "a bow holds the string in motion, which no preset does: a bass plays its notes, plucked", string=False
    ),
    Answer(_CONCERT, _MANY, string=False),
    Answer(_PIZZICATO, "strings of an orchestra plucked with a finger"),
    Answer(_CONCERT, "a harp"),
    Answer(_FINGER, _DRUM, string=False),
    *(Answer(_CONCERT, _MANY, string=False) for _ in range(48, 52)),
    *(Answer(_CONCERT, _VOICES, string=False) for _ in range(52, 55)),
    Answer(_CONCERT, "a whole orchestra at once: the harp plays its notes", string=False),
    *(Answer((HARP,), _BRASS, string=False) for _ in range(56, 64)),
    *(Answer((HARP,), _REED, string=False) for _ in range(64, 72)),
    *(Answer(_CONCERT, _FLUTE, string=False) for _ in range(72, 80)),
    *(Answer((HARP,), _LEAD, string=False) for _ in range(80, 84)),
    Answer(_BRIDGE, "an imitation of a distorted charango or guitar: an electric guitar", string=False),
    *(Answer((HARP,), _LEAD, string=False) for _ in range(85, 88)),
    *(Answer(_CONCERT, _PAD, string=False) for _ in range(88, 96)),
    *(Answer(_CONCERT, _EFFECT, string=False) for _ in range(96, 104)),
    Answer(_SITAR, "the sitar itself, else a string on a curved bridge"),
    Answer(_BANJO, "the banjo itself, else short plucked notes with a bright attack"),
    Answer(_SHAMISEN, "the shamisen itself"),
    Answer(_KOTO, "the koto itself, else open strings, one for a note"),
    Answer(_CONCERT, "tongues that are plucked: a harp", string=False),
    Answer((HARP,), "reeds over a drone: the jawari harp plays their notes, with its buzz", string=False),
    Answer(_CONCERT, _BOWED, string=False),
    Answer((HARP,), _REED, string=False),
    *(Answer(_DULCIMER, _BARS, string=False) for _ in range(112, 115)),
    *(Answer(_FINGER, _DRUM, string=False) for _ in range(115, 119)),
    *(Answer(_FINGER, _NOISE, string=False) for _ in range(119, 128)),
)
