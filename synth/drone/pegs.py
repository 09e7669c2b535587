"""The pegs of a tanpura: what pitch each of its strings has, and the preset tuned so.

A preset's strings know whole notes and cents, and its two middle strings the same note. Here each string gets a key of
its own, the free one nearest to its pitch, and the cents that are left: so that every string can be plucked and tuned
alone, while the pitch is the one asked for.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from synth.drone.swara import name_of, tempered
from synth.instrument.preset import BridgeObstacle, Preset, at_note, contact_cents, list_presets
from synth.units import cents, hz_to_midi, midi_to_hz, midi_to_note

#: the preset's strings: first, two middle Sa, kharaj
PRESET_STRINGS = 4
#: how far a string's tension may be from the preset's own, as a factor either way
TENSION_FACTOR = 3.0
#: …and the middle Sa from the preset's, semitones either way: as far as its pitch is calibrated
SA_SEMITONES = 5
#: how far a string may be tuned away from its swara [cents]
MOST_CENTS = 50.0

#: loudness of the drone of the preset `tanpura` by the first string's ratio, and without a first string: six cycles at Sa C3
#: without variation (`tools/loudness --drone`); the level makes all as loud as with Pa [LUFS]
LOUDNESS_LUFS = {
    1.0: -23.17, 16 / 15: -22.07, 9 / 8: -22.14, 6 / 5: -22.24, 5 / 4: -22.0, 4 / 3: -21.77, 45 / 32: -21.42, 3 / 2: -21.57,
    8 / 5: -21.42, 5 / 3: -21.64, 9 / 5: -21.18, 15 / 8: -20.86, 2.0: -20.87,
}  # fmt: skip
LOUDNESS_WITHOUT_LUFS = -22.74


@dataclass(frozen=True)
class Pegs:
    """How the strings are tuned, in the order in which they are plucked.

    preset: four strings of one note each: first, Sa, Sa, kharaj (an octave below), over a bridge
    sa_hz: the middle strings' Sa [Hz]
    first: the first string's ratio to the kharaj, 1 to 2; None: it is left out
    second: that of a fifth string, plucked after the first, of the middle strings' gauge; None: there is none
    equal: steps of the equal temperament in the place of the ratios
    cents: by which each string is off
    Raises ValueError for what the strings of the preset cannot be tuned to.
    """

    preset: Preset
    sa_hz: float
    first: float | None = 1.5
    second: float | None = None
    equal: bool = False
    cents: tuple[float, ...] = ()
    #: places of the strings in the preset, and their names
    templates: tuple[int, ...] = field(init=False)
    names: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        self._check_preset()
        templates, names = [1, 2, 3], ["Sa", "Sa", "kharaj"]
        for ratio, template in ((self.second, 1), (self.first, 0)):
            if ratio is not None:
                templates.insert(0, template)
                names.insert(0, name_of(ratio))
        object.__setattr__(self, "templates", tuple(templates))
        object.__setattr__(self, "names", tuple(names))
        object.__setattr__(self, "cents", tuple(self.cents) or (0.0,) * len(names))
        if len(self.cents) != len(names):
            raise ValueError(f"--cents needs one number for each of the {len(names)} strings, got {len(self.cents)}")
        for value in self.cents:
            if not abs(value) <= MOST_CENTS:
                raise ValueError(f"--cents must lie between {-MOST_CENTS:g} and {MOST_CENTS:g}, got {value:g}")
        self._check_pitches()

    def _check_preset(self) -> None:
        tables = self.preset.string
        fits = len(tables) == PRESET_STRINGS and isinstance(self.preset.obstacle, BridgeObstacle)
        fits = fits and all(table.notes[0] == table.notes[1] for table in tables)
        if not fits or not tables[1].notes == tables[2].notes or tables[3].notes[0] + 12 != tables[1].notes[0]:
            raise ValueError(
                f"--preset {self.preset.name}: a drone needs a bridge and four strings of one note each: first, Sa, Sa, "
                "and kharaj an octave below; take the preset tanpura, or one made from it"
            )

    def _check_pitches(self) -> None:
        home = self.preset.string[1].notes[0]
        low, high = self.sa_limits_hz
        if not _within(self.sa_hz, low, high):
            raise ValueError(
                f"--sa must lie between {midi_to_note(home - SA_SEMITONES)} ({low:.1f} Hz) and "
                f"{midi_to_note(home + SA_SEMITONES)} ({high:.1f} Hz), where {self.preset.name} stays in tune, "
                f"got {self.sa_hz:.1f} Hz{_others_for(self.sa_hz)}"
            )
        for option, ratio, template in (("--first", self.first, 0), ("--second", self.second, 1)):
            if ratio is None:
                continue
            tension = (self._pitch(ratio) / midi_to_hz(self.preset.string[template].notes[0], self._a4_hz)) ** 2
            if not 1.0 / TENSION_FACTOR <= tension <= TENSION_FACTOR:
                raise ValueError(
                    f"{option} {name_of(ratio)} at Sa {self.sa_hz:.1f} Hz would pull the string at {tension:.2f} times the "
                    f"preset's tension, which must lie between {1 / TENSION_FACTOR:.2f} and {TENSION_FACTOR:g}; take a "
                    f"swara nearer to {name_of(1.5 if template == 0 else 15 / 8)}"
                )

    def _pitch(self, ratio: float) -> float:
        return 0.5 * self.sa_hz * (tempered(ratio) if self.equal else ratio)

    @property
    def sa_limits_hz(self) -> tuple[float, float]:
        """Lowest and highest middle Sa [Hz]."""
        return sa_limits_hz(self.preset)

    @property
    def _a4_hz(self) -> float:
        return self.preset.tuning.a4_hz

    @property
    def pitches_hz(self) -> tuple[float, ...]:
        """What each string sounds at [Hz], its cents included."""
        ratios = [ratio for ratio in (self.first, self.second) if ratio is not None]
        exact = [*(self._pitch(ratio) for ratio in ratios), self.sa_hz, self.sa_hz, 0.5 * self.sa_hz]
        return tuple(hz * 2.0 ** (off / 1200.0) for hz, off in zip(exact, self.cents, strict=True))

    def turned(self, string: int, by_cents: float) -> Pegs:
        """One string tuned by some cents more. Raises ValueError beyond the limit."""
        moved = [value + (by_cents if i == string else 0.0) for i, value in enumerate(self.cents)]
        return replace(self, cents=tuple(moved))

    def contact_cents(self, pitch_hz: float) -> float:
        """How far the bridge raises a string of that pitch, which its own tuning lies below [cents]."""
        return contact_cents(self.preset, hz_to_midi(pitch_hz, self._a4_hz))


def sa_limits_hz(preset: Preset) -> tuple[float, float]:
    """Lowest and highest middle Sa of a tanpura [Hz]."""
    home = preset.string[1].notes[0]
    a4_hz = preset.tuning.a4_hz
    return midi_to_hz(home - SA_SEMITONES, a4_hz), midi_to_hz(home + SA_SEMITONES, a4_hz)


def _within(hz: float, low: float, high: float) -> bool:
    return low * 0.9999 <= hz <= high * 1.0001


def _others_for(sa_hz: float) -> str:
    """ "; -p NAME reaches it" of tanpuras that come with the program and can be tuned to a Sa [Hz]; "" where none can."""
    names = [each.name for each in list_presets() if each.family == "tanpura" and _within(sa_hz, *sa_limits_hz(each))]
    return f"; try -p {' or -p '.join(names)}" if names else ""


@dataclass(frozen=True)
class TunedStrings:
    """A preset tuned to pegs: `keys` are the notes that its strings are plucked by, one each."""

    preset: Preset
    keys: tuple[int, ...]
    pegs: Pegs

    def semitones(self, pegs: Pegs) -> tuple[float, ...]:
        """What each string's key must be tuned to (MIDI number with fraction) to sound as other pegs have it.

        A key's tuning is counted from the key; the cents by which its string is compiled off it come on top. The bridge
        raises different pitches by different cents; the model allows for those of the compiled one.
        """
        return tuple(
            key + 0.01 * (cents(hz, compiled) + self.pegs.contact_cents(compiled) - self.pegs.contact_cents(hz))
            for key, hz, compiled in zip(self.keys, pegs.pitches_hz, self.pegs.pitches_hz, strict=True)
        )


def free_keys(pitches: Sequence[float]) -> tuple[int, ...]:
    """For each pitch (MIDI number with fraction) the nearest key that none before it has taken."""
    taken: list[int] = []
    for pitch in pitches:
        taken.append(min((key for key in range(128) if key not in taken), key=lambda key: (abs(key - pitch), key)))
    return tuple(taken)


def level_db(first: float | None) -> float:
    """Gain that makes a drone with a first string of this ratio (None: without one) as loud as with Pa [dB]."""
    loudness = LOUDNESS_WITHOUT_LUFS
    if first is not None:
        loudness = float(
            np.interp(math.log2(first), [math.log2(each) for each in LOUDNESS_LUFS], list(LOUDNESS_LUFS.values()))
        )
    return LOUDNESS_LUFS[1.5] - loudness


def tuned(pegs: Pegs, jiva_um: float | None = None) -> TunedStrings:
    """The preset with its strings at the pitches of the pegs, and its thread at a height [µm].

    What the preset gives at anchor notes is the string's, whatever it is tuned to.
    """
    preset = pegs.preset
    a4_hz = preset.tuning.a4_hz
    keys = free_keys([hz_to_midi(hz, a4_hz) for hz in pegs.pitches_hz])
    tables, contact = [], {}
    for template, name, key, hz in zip(pegs.templates, pegs.names, keys, pegs.pitches_hz, strict=True):
        table = preset.string[template]
        home = table.notes[0]
        fixed = {name: at_note(value, home) for name, value in table if isinstance(value, dict)}
        off = cents(hz, midi_to_hz(key, a4_hz))
        tables.append(table.model_copy(update={**fixed, "name": name, "notes": (key, key), "cents": off}))
        contact[key] = pegs.contact_cents(hz)
    tuning = preset.tuning.model_copy(update={"offset_cents": 0.0, "contact_cents": dict(sorted(contact.items()))})
    output = preset.output.model_copy(update={"gain_db": preset.output.gain_db + level_db(pegs.first)})
    changes = {"string": tuple(tables), "tuning": tuning, "output": output}
    if jiva_um is not None:
        changes["obstacle"] = preset.obstacle.model_copy(update={"jiva_um": jiva_um})
    changes["mapping"] = preset.mapping.model_copy(update={"polyphony": max(preset.mapping.polyphony, len(keys))})
    return TunedStrings(preset.model_copy(update=changes), keys, pegs)


def jiva_of(preset: Preset) -> float:
    """Height of the thread under the preset's strings [µm]; of several, the middle Sa's."""
    shape = preset.obstacle
    assert isinstance(shape, BridgeObstacle)
    height = at_note(shape.jiva_um, preset.string[-2].notes[0])
    return height if math.isfinite(height) else 0.0
