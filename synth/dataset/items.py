"""The items of a recipe: each follows from the recipe and its number alone, whatever else there is and in which order.

Lists are gone through like the digits of a number, the last one fastest: preset, articulation, note, velocity, hold_s,
release_s, transpose, stretch, set, live, controllers, repeats. What is drawn, and the seed of the hand, follow from a
SeedSequence with the recipe's seed and the item's own spawn key (kind, table, number, key), so that neither the number of
workers nor a table that is added behind changes an item.
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from synth.dataset.alternatives import Alternatives
from synth.dataset.recipefile import Midi, Notes, Phrases, PlayedTable, Recipe, RecipeError, Written
from synth.instrument.preset import Preset, load_preset, playable_notes

#: kinds of items, by the letter that their keys begin with
KINDS = {"n": "note", "p": "phrase", "m": "midi"}
_NUMBERS = {letter: number for number, letter in enumerate(KINDS)}
#: digits of an item's number in its key
_DIGITS = 8


@dataclass(frozen=True)
class Beat:
    """One key of an item: when it is pressed, and let go after `off_s` [s]."""

    at_s: float
    note: int
    velocity: int
    off_s: float


@dataclass(frozen=True)
class Item:
    """One sound of a data set.

    key             n0-00000012: kind, table among those of its kind, number
    seed            of the engine's hand and of the dither
    preset          as the recipe names it; "": by General MIDI
    beats           what is played; of a MIDI file nothing
    seconds         its length [s]; of a MIDI file `release_s` after its end, at most `longest_s`
    settings        numbers of the preset by dotted key; `live`: live parameters by id; controllers: by number
    """

    key: str
    seed: int
    preset: str
    articulation: str
    beats: tuple[Beat, ...]
    seconds: float
    release_s: float
    settings: tuple[tuple[str, Any], ...] = ()
    live: tuple[tuple[str, float], ...] = ()
    controllers: tuple[tuple[int, int], ...] = ()
    phrase: str = ""
    file: str = ""
    transpose: int = 0
    stretch: float = 1.0
    repeat: int = 0

    @property
    def kind(self) -> str:
        """note, phrase or midi."""
        return KINDS[self.key[0]]

    @property
    def table(self) -> int:
        """Which table of its kind it is of, from 0."""
        return int(self.key[1:].partition("-")[0])

    @property
    def number(self) -> int:
        """Its number in that table."""
        return int(self.key.partition("-")[2])

    @property
    def note(self) -> int | None:
        """Of a single note its key, else None."""
        return self.beats[0].note if self.kind == "note" else None

    @property
    def engine(self) -> tuple[str, str, str]:
        """What tells the engine that plays it from others: preset, articulation, numbers of the preset."""
        return self.preset, self.articulation, json.dumps(self.settings)


def key_of(letter: str, table: int, number: int) -> str:
    """n0-00000012."""
    return f"{letter}{table}-{number:0{_DIGITS}d}"


def sequence(seed: int, key: str, what: str) -> np.random.SeedSequence:
    """What is random of one thing of one item."""
    table, _, number = key[1:].partition("-")
    return np.random.SeedSequence(seed, spawn_key=(_NUMBERS[key[0]], int(table), int(number), zlib.crc32(what.encode())))


def share(seed: int, key: str, what: str) -> float:
    """A number from 0 to 1 (excluded) that belongs to one thing of one item."""
    return int(sequence(seed, key, what).generate_state(1, np.uint64)[0] >> np.uint64(11)) * 2.0**-53


class Presets:
    """Presets by the names in a recipe, read once."""

    def __init__(self, written: Written) -> None:
        self._written = written
        self._loaded: dict[str, Preset] = {}

    def path(self, name: str) -> str:
        """What `load_preset` takes: a name of the program's own, or a file."""
        return str(self._written.path(name)) if name.endswith(".toml") else name

    def __call__(self, name: str) -> Preset:
        if name not in self._loaded:
            self._loaded[name] = load_preset(self.path(name))
        return self._loaded[name]


class Source:
    """The items of one table. Raises RecipeError where a preset or a file is not there, or does not play what is asked."""

    def __init__(
        self, recipe: Recipe, letter: str, number: int, table: PlayedTable, presets: Presets, written: Written
    ) -> None:
        self.letter, self.number, self.table = letter, number, table
        self._seed = recipe.seed
        self._axes: dict[str, Alternatives] = {"preset": table.preset}
        self._notes: dict[str, tuple[int, ...]] = {}
        self.files: tuple[str, ...] = ()
        self.patterns: dict[str, tuple[str, ...]] = {}
        names = table.preset.values or table.preset.one_of
        if isinstance(table, Notes | Phrases):
            self._axes["articulation"] = table.articulation
        if isinstance(table, Notes):
            for name in names:
                playable = playable_notes(presets(name))
                try:
                    self._notes[name] = table.note.of(playable)
                except ValueError as error:
                    said = str(error) if str(error).startswith(name) else f"{name} {error}"
                    raise RecipeError(f"note: {said}") from None
                if not self._notes[name]:
                    raise RecipeError(f"note: {name} plays none of these notes; name others, or leave the preset out")
            self._axes |= {"note": Alternatives((None,)), "velocity": table.velocity, "hold_s": table.hold_s}
        if isinstance(table, Midi):
            self.patterns = {pattern: _files(pattern, written) for pattern in table.files}
            self.files = tuple(dict.fromkeys(name for names in self.patterns.values() for name in names))
            self._axes["file"] = Alternatives(self.files)
        self._axes["release_s"] = table.release_s
        if isinstance(table, Phrases | Midi):
            self._axes["transpose"] = table.transpose
        if isinstance(table, Phrases):
            self._axes["stretch"] = table.stretch
        self._axes |= {f"set.{key}": axis for key, axis in table.set.items()}
        if isinstance(table, Notes | Phrases):
            self._axes |= {f"live.{key}": axis for key, axis in table.live.items()}
            self._axes |= {f"controllers.{key}": axis for key, axis in table.controllers.items()}
        self._per_preset = [self._combinations(name) for name in names]
        if table.count is not None:
            self.size = table.count
        elif table.preset.drawn:
            self.size = sum(self._per_preset) // len(names) * table.repeats
        else:
            self.size = sum(self._per_preset) * table.repeats

    def _combinations(self, preset: str) -> int:
        """How many items of a preset the lists make."""
        return math.prod(self._length(name, axis, preset) for name, axis in self._axes.items() if name != "preset")

    def _length(self, name: str, axis: Alternatives, preset: str) -> int:
        return len(self._notes[preset]) if name == "note" else max(1, len(axis.values))

    def item(self, number: int) -> Item:
        """One of them. Raises IndexError."""
        if not 0 <= number < self.size:
            raise IndexError(number)
        key = key_of(self.letter, self.number, number)
        values = self._drawn(key) if self.table.count is not None else self._listed(key, number)
        return self._made(key, values)

    def _drawn(self, key: str) -> dict[str, Any]:
        """Where a count is given everything is drawn."""
        found: dict[str, Any] = {}
        for name, axis in self._axes.items():
            if name == "note":
                axis = Alternatives(self._notes[found["preset"]])
            found[name] = axis.draw(share(self._seed, key, name)) if len(axis.values) != 1 else axis.values[0]
        return found

    def _listed(self, key: str, number: int) -> dict[str, Any]:
        axis = self._axes["preset"]
        names = axis.values or axis.one_of
        repeat, left = divmod(number, self.size // self.table.repeats)
        if axis.drawn:
            preset = axis.draw(share(self._seed, key, "preset"))
        else:
            place = 0
            while left >= self._per_preset[place]:
                left -= self._per_preset[place]
                place += 1
            preset = names[place]
        found: dict[str, Any] = {"preset": preset, "repeat": repeat}
        for name, axis in reversed(self._axes.items()):
            if name == "preset":
                continue
            listed: Sequence[Any] = self._notes[preset] if name == "note" else axis.values
            if axis.drawn and name != "note":
                found[name] = axis.draw(share(self._seed, key, name))
            else:
                left, digit = divmod(left, len(listed))
                found[name] = listed[digit]
        return found

    def _made(self, key: str, values: dict[str, Any]) -> Item:
        table, release_s = self.table, float(values["release_s"])
        common = Item(
            key,
            int(sequence(self._seed, key, "hand").generate_state(1, np.uint32)[0] >> np.uint32(1)),
            values["preset"],
            values.get("articulation", ""),
            (),
            release_s,
            release_s,
            tuple((name, values[f"set.{name}"]) for name in table.set),
            repeat=values.get("repeat", 0),
        )
        if isinstance(table, Notes | Phrases):
            live = tuple((name, float(values[f"live.{name}"])) for name in table.live)
            controllers = tuple((int(name), int(values[f"controllers.{name}"])) for name in table.controllers)
            common = replace(common, live=live, controllers=controllers)
        if isinstance(table, Notes):
            hold_s = float(values["hold_s"])
            beat = Beat(0.0, int(values["note"]), int(values["velocity"]), hold_s)
            return replace(common, beats=(beat,), seconds=hold_s + release_s)
        transpose = int(values["transpose"])
        if isinstance(table, Phrases):
            by = float(values["stretch"])
            beats = tuple(Beat(by * s.at_s, s.note + transpose, s.velocity, by * s.hold_s) for s in table.stroke)
            seconds = max(beat.at_s + beat.off_s for beat in beats) + release_s
            return replace(common, beats=beats, seconds=seconds, phrase=table.name, transpose=transpose, stretch=by)
        assert isinstance(table, Midi)
        return replace(common, seconds=table.longest_s, file=values["file"], transpose=transpose)


def _files(pattern: str, written: Written) -> tuple[str, ...]:
    """Names of files, from the recipe's folder, that there are. Raises RecipeError."""
    if pattern in written.found:
        return tuple(written.found[pattern])
    folder = written.folder
    if any(letter in pattern for letter in "*?["):
        if Path(pattern).is_absolute():
            raise RecipeError(f"files: {pattern!r} must be relative to the recipe's folder, to be searched")
        found = sorted(path.relative_to(folder).as_posix() for path in folder.glob(pattern) if path.is_file())
    else:
        found = [pattern] if written.path(pattern).is_file() else []
    if not found:
        raise RecipeError(
            f"files: there is no file {pattern!r} in {folder}; correct the name, which is relative to that folder"
        )
    return tuple(found)


class Items:
    """All items of a recipe, by key and one after the other."""

    def __init__(self, written: Written) -> None:
        recipe = written.recipe
        self.presets = Presets(written)
        self.sources: list[Source] = []
        wrong = []
        for letter, tables in (("n", recipe.notes), ("p", recipe.phrases), ("m", recipe.midi)):
            for number, table in enumerate(tables):
                try:
                    self.sources.append(Source(recipe, letter, number, table, self.presets, written))
                except (ValueError, OSError) as error:
                    place = {"n": "notes", "p": "phrases", "m": "midi"}[letter]
                    wrong += [f"{written.origin}: {place}.{number}: {line}" for line in str(error).splitlines()]
        if wrong:
            raise RecipeError("\n".join(wrong))
        self._by_table = {(source.letter, source.number): source for source in self.sources}
        self.size = sum(source.size for source in self.sources)

    def __iter__(self) -> Iterator[Item]:
        for source in self.sources:
            for number in range(source.size):
                yield source.item(number)

    def by_key(self, key: str) -> Item:
        """The item of a key. Raises ValueError where there is none."""
        table, _, number = key[1:].partition("-")
        source = self._by_table.get((key[:1], int(table))) if table.isdecimal() else None
        if source is None or not number.isdecimal() or int(number) >= source.size or key != key_of(
            key[0], int(table), int(number)
        ):  # fmt: skip
            last = self.sources[-1]
            raise ValueError(
                f"there is no item {key!r}; keys run from {key_of(self.sources[0].letter, self.sources[0].number, 0)} "
                f"to {key_of(last.letter, last.number, last.size - 1)}"
            )
        return source.item(int(number))
