"""Changes of a preset as an author means them, as those of its file, and steps at random."""

from __future__ import annotations

import math
import random
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

from tomlkit.exceptions import TOMLKitError

from synth.author.toml_edit import change
from synth.author.views.parameters import INSTEAD
from synth.compile import make_string, note_frequency, obstacle_of, string_notes
from synth.preset import Preset, PresetError, validate_preset

#: a step at random: largest ratio of a number that is above 0, and what may be stepped
RATIO = 1.25
GROUPS = ("string", "obstacle", "pluck", "damping", "output")
LEFT = ("notes", "gain_db", "cents", "count", "name", "length_m", "measured_frequencies_hz", "measured_decay_rates")
TRIES = 12
MOST_FRETS = 36


def apply(text: str, changes: Sequence[tuple[str, Any]], origin: str) -> tuple[str, Preset]:
    """The text with every (path, value) changed (None: taken out of the file), and its preset. Raises PresetError."""
    named = {path for path, _ in changes}
    for path, value in changes:
        data = tomllib.loads(text)
        for extra, extra_value in _consequences(data, path, value, named):
            text = _changed(text, extra, extra_value, origin)
        text = _changed(text, path, value, origin)
    return text, checked(text, origin)


def checked(text: str, origin: str) -> Preset:
    """The preset of a text of today's format. Raises PresetError, also where its strings cannot be made."""
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise PresetError(f"{origin}: not valid TOML: {error}") from None
    preset = validate_preset(data, origin)
    problems = []
    for number, table in enumerate(preset.string):
        for note in sorted({string_notes(table)[0], string_notes(table)[-1]}):
            place = f"string.{number}"
            try:
                string = make_string(preset, table, note, note_frequency(preset, table, note, None))
                place = "obstacle"
                obstacle_of(preset, note, string.length_m).check(string.length_m)
            except ValueError as error:
                problems.append((place, str(error)))
    if problems:
        problems = list(dict.fromkeys(problems))
        raise PresetError("\n".join(f"{origin}: {place}: {what}" for place, what in problems), problems)
    return preset


def _changed(text: str, path: str, value: Any, origin: str) -> str:
    try:
        return change(text, path, value)
    except (KeyError, ValueError, TypeError, RecursionError, TOMLKitError):
        raise PresetError(f"{origin}: {path}: there is no such place", [(path, "there is no such place")]) from None


def _at(data: Any, parts: Sequence[str]) -> Any:
    for part in parts:
        if isinstance(data, list):
            data = data[int(part)] if part.isdecimal() and int(part) < len(data) else None
        else:
            data = data.get(part) if isinstance(data, Mapping) else None
    return data


def _consequences(data: dict[str, Any], path: str, value: Any, named: set[str]) -> list[tuple[str, Any]]:
    """What else changes with `path`, unless `named` says it itself: one of a pair takes the other's place, and a fret more
    has a height."""
    *table, key = path.split(".")
    wanted: list[tuple[str, Any]] = []
    if value is not None:
        wanted += [(".".join([*table, pair[1 - pair.index(key)]]), None) for pair in INSTEAD if key in pair]
    heights = _at(data, ["obstacle", "heights_mm"])
    if path == "obstacle.count" and heights and isinstance(value, int) and 1 <= value <= MOST_FRETS:
        wanted.append(("obstacle.heights_mm", (heights + [heights[-1]] * value)[:value]))
    return [(each, new) for each, new in wanted if each not in named]


def randomised(text: str, origin: str, seed: int | None = None, groups: Sequence[str] | None = None) -> tuple[str, Preset]:
    """A text whose numbers are each stepped at random, no further than by RATIO, and its preset: still an instrument of the
    same notes. Equal keys of several strings take the same step. Raises PresetError, ValueError."""
    chosen = GROUPS if groups is None else tuple(groups)
    unknown = [group for group in chosen if group not in GROUPS]
    if unknown:
        raise ValueError(f"groups: {unknown[0]!r} is not one of {', '.join(GROUPS)}")
    random_ = random.Random(seed)
    data = tomllib.loads(text)
    reach = 1.0
    for _ in range(TRIES):
        steps: dict[str, float] = {}
        changes = []
        for group in chosen:
            tables = data.get(group, {})
            for index, table in enumerate(tables) if isinstance(tables, list) else [(None, tables)]:
                for key, value in table.items():
                    if key in LEFT:
                        continue
                    step = steps.setdefault(f"{group}.{key}", reach * random_.uniform(-1.0, 1.0))
                    stepped = _stepped(value, step)
                    if stepped is not None:
                        changes.append((".".join([group, *([] if index is None else [str(index)]), key]), stepped))
        try:
            return apply(text, changes, origin)
        except PresetError:
            reach *= 0.7
    raise PresetError(f"{origin}: {TRIES} steps at random all left what can be played; change a value by hand")


def _stepped(value: Any, step: float) -> Any:
    """A number, or numbers at notes or in a list, `step` (−1 … 1) of the way to the furthest; None for what is none."""
    if isinstance(value, Mapping):
        stepped = {key: _stepped(each, step) for key, each in value.items()}
        return None if None in stepped.values() else stepped
    if isinstance(value, list):
        stepped_list = [_stepped(each, step) for each in value]
        return None if None in stepped_list else stepped_list
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    if value == 0:
        return 0.0
    return float(f"{value * math.exp(step * math.log(RATIO)):.4g}")
