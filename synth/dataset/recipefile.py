"""Recipes of data sets: what is played, how it is kept, split and labelled, as validated tables of a TOML file.

What the tables and keys mean is written in docs/dataset.md.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, model_validator

from synth.dataset.alternatives import Alternatives, alternatives
from synth.files.sources import read_bytes
from synth.instrument.faults import value_got, wanted
from synth.instrument.fields import Note
from synth.instrument.shipped import shipped_file
from synth.instrument.table import Table
from synth.spelling import perhaps
from synth.units import midi_to_note, note_to_midi

#: largest recipe that is read [bytes]
MOST_BYTES = 1 << 24
FORMAT = 1
SPLITS = ("train", "validation", "test")
#: what items can be grouped by
GROUP_KEYS = ("preset", "note", "string", "articulation", "velocity", "parameters", "phrase", "file", "table", "item")
#: keys that say something about a data set and change nothing in it
SAID = ("title", "description", "licence", "creators")
#: longest item [s]
LONGEST_S = 3600.0
#: most items of a data set
MOST_ITEMS = 10_000_000
_RANGE = re.compile(r"\s*([A-Ga-g][#b♯♭]*-?\d+|\d+)\s*-\s*([A-Ga-g][#b♯♭]*-?\d+|\d+)\s*")


class RecipeError(ValueError):
    """A recipe that cannot be used; the message names file and key, one line for each thing that is wrong."""


def _any(given: Any) -> Alternatives:
    return given if isinstance(given, Alternatives) else alternatives(given)


def _number(low: float, high: float, *, whole: bool = False) -> Any:
    """An axis whose values are numbers from low to high."""

    def check(given: Any) -> Alternatives:
        found = alternatives(given, whole=whole)
        for value in found.ends():
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"must be a number, got {value!r}")
            if not low <= value <= high:
                raise ValueError(f"must lie between {low:g} and {high:g}, got {value:g}")
        return found

    return Annotated[Alternatives, BeforeValidator(check)]


def _words(given: Any) -> Alternatives:
    found = alternatives(given)
    for value in found.values or found.one_of:
        if not isinstance(value, str):
            raise ValueError(f"must be a name or a list of names, got {value!r}")
    if found.drawn and not found.one_of:
        raise ValueError("must be a name or a list of names, got a range of numbers")
    return found


def _one_or_more(given: Any) -> Any:
    return [given] if isinstance(given, str) else given


@dataclass(frozen=True)
class NoteChoice:
    """Notes of a recipe: those that every preset must play, and ranges of which it plays what it can; without either all."""

    single: tuple[int, ...] = ()
    ranges: tuple[tuple[int, int], ...] = ()

    def of(self, playable: Iterable[int]) -> tuple[int, ...]:
        """Those that a preset plays, in order. Raises ValueError where it cannot play one that is named."""
        there = sorted(set(playable))
        if not self.single and not self.ranges:
            return tuple(there)
        gone = [note for note in self.single if note not in there]
        if gone:
            raise ValueError(
                f"plays {midi_to_note(there[0])}-{midi_to_note(there[-1])} and not {midi_to_note(gone[0])}; "
                'name other notes, or a range such as "C2-C5", of which it plays the notes it can'
            )
        ranged = {note for low, high in self.ranges for note in there if low <= note <= high}
        return tuple(sorted(ranged | set(self.single)))


def _keys(given: Any) -> NoteChoice:
    single, ranges = [], []
    for each in given if isinstance(given, list) else [given]:
        if each == "all" and each is given:
            return NoteChoice()
        found = _RANGE.fullmatch(each) if isinstance(each, str) else None
        if found:
            low, high = (_note(end) for end in found.groups())
            if low > high:
                raise ValueError(f"{each!r} must run upwards")
            ranges.append((low, high))
        else:
            single.append(_note(each))
    if not single and not ranges:
        raise ValueError('must hold at least one note, got an empty list; "all" means all notes that a preset plays')
    return NoteChoice(tuple(dict.fromkeys(single)), tuple(ranges))


def _note(value: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int | str):
        raise ValueError(f'must be notes such as "C3", 48 or "E1-C4", or "all", got {value!r}')
    number = int(value) if isinstance(value, int) or value.strip().isdecimal() else note_to_midi(value)
    if not 0 <= number <= 127:
        raise ValueError(f"a note lies between 0 and 127, got {number}")
    return number


Axis = Annotated[Alternatives, BeforeValidator(_any)]
Words = Annotated[Alternatives, BeforeValidator(_words)]
Count = Annotated[int, Field(strict=True, ge=1, le=MOST_ITEMS)]
_ONE = Alternatives((1,))


class SoundTable(Table):
    """How everything is computed and kept."""

    rate_hz: Annotated[int, Field(strict=True, ge=44100, le=192000)] = 44100
    quality: Literal["draft", "standard", "fine", "reference"] = "standard"
    bit_depth: Literal[16, 24] = 24
    channels: Literal[1, 2] = 1
    variation: float = Field(1.0, ge=0.0, le=2.0)
    flac_level: Annotated[int, Field(strict=True, ge=0, le=8)] = 2


class Level(Table):
    """One gain for all, or each item to a peak; what would then go beyond the ceiling is lowered to it."""

    gain_db: float = Field(0.0, ge=-120.0, le=60.0)
    normalize_dbfs: float | None = Field(None, ge=-80.0, le=0.0)
    ceiling_dbfs: float = Field(-0.1, ge=-20.0, le=-0.01)

    @model_validator(mode="after")
    def _one_of_both(self) -> Level:
        if self.normalize_dbfs is not None and self.gain_db != 0.0:
            raise ValueError("gain_db has no meaning beside normalize_dbfs, which sets every item's level: leave one out")
        if self.normalize_dbfs is not None and self.normalize_dbfs > self.ceiling_dbfs:
            raise ValueError(
                f"normalize_dbfs must not lie above ceiling_dbfs, got {self.normalize_dbfs:g} and {self.ceiling_dbfs:g}"
            )
        return self


class Shards(Table):
    """How items are put into files."""

    items: Annotated[int, Field(strict=True, ge=1, le=100_000)] = 500
    shuffled: bool = True


class Split(Table):
    """Shares of the splits, and what belongs together."""

    train: float = Field(0.8, ge=0.0, le=1.0)
    validation: float = Field(0.1, ge=0.0, le=1.0)
    test: float = Field(0.1, ge=0.0, le=1.0)
    group_by: Annotated[tuple[str, ...], BeforeValidator(_one_or_more)] = ("preset", "note", "phrase", "file")
    exact: bool = True

    @property
    def shares(self) -> tuple[float, ...]:
        """In the order of SPLITS."""
        return self.train, self.validation, self.test

    @model_validator(mode="after")
    def _all_of_it(self) -> Split:
        if abs(sum(self.shares) - 1.0) > 1e-9:
            raise ValueError(f"train, validation and test must add up to 1, got {sum(self.shares):g}")
        for key in self.group_by:
            if key not in GROUP_KEYS:
                near = perhaps(key, GROUP_KEYS)
                raise ValueError(f"group_by: no key {key!r}{near}; there are {', '.join(GROUP_KEYS)}")
        if not self.group_by:
            raise ValueError('group_by must name at least one key; ["item"] groups nothing')
        return self


class Labels(Table):
    """What no recording has, on demand."""

    contacts: bool = False
    forces: bool = False
    state_hz: float = Field(0.0, ge=0.0, le=1e6)
    dtype: Literal["float32", "float64"] = "float32"

    @property
    def wanted(self) -> bool:
        """Whether there are any."""
        return self.contacts or self.forces or self.state_hz > 0.0


class PlayedTable(Table):
    """What notes, phrases and MIDI files have in common."""

    preset: Words
    set: dict[str, Axis] = Field(default_factory=dict)
    repeats: Count = 1
    count: Count | None = None
    release_s: _number(0.0, 60.0) = Alternatives((0.5,))  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _one_way_to_count(self) -> PlayedTable:
        if self.count is not None and self.repeats != 1:
            raise ValueError(f"repeats has no meaning beside count, which says how many items there are, got {self.repeats}")
        return self


class Strokes(PlayedTable):
    """… and what notes and phrases have."""

    articulation: Words = Alternatives(("",))
    live: dict[str, Axis] = Field(default_factory=dict)
    controllers: dict[str, _number(0, 127, whole=True)] = Field(default_factory=dict)  # type: ignore[valid-type]


class Notes(Strokes):
    """Single notes."""

    note: Annotated[NoteChoice, BeforeValidator(lambda given: given if isinstance(given, NoteChoice) else _keys(given))]
    velocity: _number(1, 127, whole=True) = Alternatives((100,))  # type: ignore[valid-type]
    hold_s: _number(0.0, 600.0) = Alternatives((1.0,))  # type: ignore[valid-type]


class PhraseNote(Table):
    """One note of a phrase."""

    at_s: float = Field(ge=0.0, le=LONGEST_S)
    note: Note
    velocity: Annotated[int, Field(strict=True, ge=1, le=127)] = 100
    hold_s: float = Field(0.5, ge=0.0, le=600.0)


class Phrases(Strokes):
    """A few notes after and with each other, by one preset."""

    name: str = Field(pattern="^[A-Za-z0-9_-]{1,64}$")
    stroke: tuple[PhraseNote, ...] = Field(min_length=1, max_length=10_000)
    transpose: _number(-127, 127, whole=True) = Alternatives((0,))  # type: ignore[valid-type]
    stretch: _number(0.05, 20.0) = _ONE  # type: ignore[valid-type]


class Midi(PlayedTable):
    """MIDI files, by one preset or by General MIDI's programs."""

    preset: Words = Alternatives(("",))
    files: Annotated[tuple[str, ...], BeforeValidator(_one_or_more)] = Field(min_length=1)
    transpose: _number(-127, 127, whole=True) = Alternatives((0,))  # type: ignore[valid-type]
    longest_s: float = Field(LONGEST_S, gt=0.0, le=LONGEST_S)


class Recipe(Table):
    """A whole recipe."""

    format: Literal[1]
    title: str = ""
    description: str = ""
    licence: str = ""
    creators: tuple[str, ...] = ()
    seed: Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)] = 0
    sound: SoundTable = SoundTable()
    level: Level = Level()
    shards: Shards = Shards()
    split: Split = Split()
    labels: Labels = Labels()
    notes: tuple[Notes, ...] = ()
    phrases: tuple[Phrases, ...] = ()
    midi: tuple[Midi, ...] = ()

    @model_validator(mode="after")
    def _something(self) -> Recipe:
        if not (self.notes or self.phrases or self.midi):
            raise ValueError("there is nothing to play: give at least one [[notes]], [[phrases]] or [[midi]]")
        if self.labels.wanted and (self.phrases or self.midi):
            raise ValueError(
                "labels: the motion of strings is recorded for single notes, got [[phrases]] or [[midi]] beside; "
                "put those into a data set of their own"
            )
        return self


@dataclass(frozen=True)
class Written:
    """A recipe as it was read: the tables, the bytes, the file's name and the folder that names in it count from;
    copies: of files that have another name there; found: of patterns the names that they stood for."""

    recipe: Recipe
    text: bytes
    origin: str
    folder: Path
    copies: Mapping[str, str] = field(default_factory=dict)
    found: Mapping[str, Sequence[str]] = field(default_factory=dict)

    def path(self, name: str) -> Path:
        """The file that a name in the recipe means: itself, or the copy of it in a data set."""
        return self.folder / self.copies.get(name, name)

    @property
    def fingerprint(self) -> str:
        """Of all that changes items: not of order, comments or what is only said."""
        data = {key: value for key, value in tomllib.loads(self.text.decode("utf-8-sig")).items() if key not in SAID}
        return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()


def recipe_path(name_or_path: str | os.PathLike[str]) -> Path:
    """The file of a recipe, or of one that comes with the program by name. Raises RecipeError where there is none."""
    if Path(name_or_path).is_dir():
        return Path(name_or_path)
    return shipped_file(name_or_path, "recipe", "recipes", RecipeError, "the folder of a data set, ")


def read_recipe(
    path: str | os.PathLike[str], copies: Mapping[str, str] | None = None, found: Mapping[str, Sequence[str]] | None = None
) -> Written:
    """The recipe in a file, or by name; names of files in it count from its folder. copies, found: see `Written`.

    Raises RecipeError with all that is wrong, each in a line that names file and key; OSError.
    """
    origin = os.fspath(path)
    path = recipe_path(path)
    text = read_bytes(path, MOST_BYTES, "recipe")
    try:
        data = tomllib.loads(text.decode("utf-8-sig"))
    except UnicodeDecodeError:
        raise RecipeError(f"{origin}: not a text file in UTF-8") from None
    except (ValueError, RecursionError) as error:
        raise RecipeError(f"{origin}: not valid TOML: {error}") from None
    version = data.get("format")
    if isinstance(version, int) and not isinstance(version, bool) and version > FORMAT:
        raise RecipeError(
            f"{origin}: format: {version} is newer than what this program reads: install a newer version of it"
        )
    try:
        recipe = Recipe.model_validate(data)
    except ValidationError as error:
        raise RecipeError("\n".join(_lines(error, origin))) from None
    return Written(recipe, text, origin, path.resolve().parent, copies or {}, found or {})


def _lines(error: ValidationError, origin: str) -> list[str]:
    """What pydantic has found, a line each."""
    lines = []
    for item in error.errors():
        place = ".".join(str(part) for part in item["loc"]) or "file"
        if item["type"] == "missing" and place == "format":
            lines.append(f"{origin}: format: missing; a recipe begins with format = {FORMAT}")
            continue
        message = wanted(item)
        if item["type"] == "extra_forbidden":
            message = (
                f"no such key{perhaps(str(item['loc'][-1]), _keys_there(item['loc']))}; docs/dataset.md has all of them"
            )
        lines.append(f"{origin}: {place}: {message}{value_got(item, message)}")
    return lines


def _keys_there(loc: tuple[int | str, ...]) -> list[str]:
    """The keys that the table at a path may have."""
    table: Any = Recipe
    inner = {"sound": SoundTable, "level": Level, "shards": Shards, "split": Split, "labels": Labels, "notes": Notes,
             "phrases": Phrases, "midi": Midi, "stroke": PhraseNote}  # fmt: skip
    for part in loc[:-1]:
        table = inner.get(str(part), table)
    return list(table.model_fields)
