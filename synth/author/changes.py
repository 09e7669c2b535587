"""Changes of a preset as an author means them, as those of its file, and steps at random."""

from __future__ import annotations

import math
import random
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any

import tomlkit
from tomlkit import TOMLDocument
from tomlkit.exceptions import TOMLKitError

from synth.author.toml_edit import change_in
from synth.author.views.parameters import INSTEAD, steppable
from synth.author.workspace import MOST_BYTES
from synth.instrument.check import check
from synth.instrument.preset import Preset, PresetError, validate_preset

#: a step at random: largest ratio of a number that is above 0, and what may be stepped
RATIO = 1.25
GROUPS = ("string", "obstacle", "pluck", "damping", "output")
LEFT = ("notes", "gain_db", "cents", "count", "name", "length_m", "measured_frequencies_hz", "measured_decay_rates")
TRIES = 12
MOST_FRETS = 36
#: most changes of one edit, and most values that they set
MOST_CHANGES, MOST_VALUES = 1000, 5000


def check_text(text: str, origin: str) -> None:
    """Raises PresetError for a text that no file could hold, or that would not be read again."""
    try:
        size = len(text.encode())
    except UnicodeEncodeError as error:
        letter = f"U+{ord(text[error.start]):04X}"
        raise PresetError(f"{origin}: {letter} is half of a surrogate pair, which a file cannot hold; remove it") from None
    if size > MOST_BYTES:
        raise PresetError(f"{origin}: {size} bytes; a preset has at most {MOST_BYTES}: shorten its lists or remarks")


def check_size(changes: Sequence[tuple[str, Any]], origin: str) -> None:
    """Raises PresetError for more changes, or longer values, than a preset has room for."""
    if len(changes) > MOST_CHANGES:
        raise PresetError(f"{origin}: {len(changes)} changes at once; at most {MOST_CHANGES}")
    found = 0
    for path, value in changes:
        found += _values(value, MOST_VALUES)
        if found > MOST_VALUES:
            problem = f"longer than {MOST_VALUES} values"
            raise PresetError(f"{origin}: {path[:80]}: {problem}", [(path, problem)])


def _values(value: Any, most: int) -> int:
    """How many values there are in plain data; counted no further than `most`."""
    waiting, found = [value], 0
    while waiting and found <= most:
        each = waiting.pop()
        found += 1
        if isinstance(each, Mapping | list | tuple):
            if len(each) > most:
                return len(each)
            waiting.extend(each.values() if isinstance(each, Mapping) else each)
    return found + len(waiting)


def apply(text: str, changes: Sequence[tuple[str, Any]], origin: str) -> tuple[str, Preset]:
    """The text with every (path, value) changed (None: taken out of the file), and its preset. Raises PresetError."""
    named = {path for path, _ in changes}
    for path, value in changes:
        check_text(path, origin)
        check_text(value if isinstance(value, str) else "", origin)
    document = tomlkit.parse(text)
    for path, value in changes:
        for extra, extra_value in _consequences(document, path, value, named):
            document = _changed(document, extra, extra_value, origin)
        document = _changed(document, path, value, origin)
    text = tomlkit.dumps(document)
    return text, checked(text, origin)


def checked(text: str, origin: str) -> Preset:
    """The preset of a text of today's format. Raises PresetError, also where its strings cannot be made."""
    check_text(text, origin)
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise PresetError(f"{origin}: not valid TOML: {error}") from None
    # every fret of a neck takes longer than a knob may wait: its ends are looked at here, all of it where it is loaded
    return check(validate_preset(data, origin), origin, everywhere=False)


def _changed(document: TOMLDocument, path: str, value: Any, origin: str) -> TOMLDocument:
    try:
        return change_in(document, path, value)
    except (KeyError, ValueError, TypeError, RecursionError, TOMLKitError):
        raise PresetError(f"{origin}: {path}: there is no such place", [(path, "there is no such place")]) from None


def _at(data: Any, parts: Sequence[str]) -> Any:
    for part in parts:
        if isinstance(data, list):
            data = data[int(part)] if part.isdecimal() and int(part) < len(data) else None
        else:
            data = data.get(part) if isinstance(data, Mapping) else None
    return data


def _consequences(data: Mapping[str, Any], path: str, value: Any, named: set[str]) -> list[tuple[str, Any]]:
    """What else changes with `path`, unless `named` says it itself: one of a pair takes the other's place, a fret more has a
    height, and a string whose tension stays has no axial stiffness."""
    *table, key = path.split(".")
    wanted: list[tuple[str, Any]] = []
    if value is not None:
        wanted += [(".".join([*table, pair[1 - pair.index(key)]]), None) for pair in INSTEAD if key in pair]
    for listed in ("obstacle.heights_mm", "setup.fret_heights_mm") if path == "obstacle.count" else ():
        heights = _at(data, listed.split("."))
        if isinstance(heights, list) and heights and isinstance(value, int) and 1 <= value <= MOST_FRETS:
            heights = list(heights)
            wanted.append((listed, (heights + [heights[-1]] * value)[:value]))
    if key == "tension_modulation" and not value:
        wanted.append((".".join([*table, "axial_stiffness_n"]), None))
    return [(each, new) for each, new in wanted if each not in named]


def randomised(text: str, origin: str, seed: int | None = None, groups: Sequence[str] | None = None) -> tuple[str, Preset]:
    """A text whose numbers are each stepped at random, no further than by RATIO, and its preset: still an instrument of the
    same notes, with as many strings, frets and points. Equal keys of several strings take the same step. Raises PresetError,
    ValueError."""
    chosen = GROUPS if groups is None else tuple(groups)
    unknown = [group for group in chosen if group not in GROUPS]
    if unknown:
        raise ValueError(f"groups: {unknown[0]!r} is not one of {', '.join(GROUPS)}")
    random_ = random.Random(seed)
    data = tomllib.loads(text)
    numbers = []
    for path, limits in steppable(validate_preset(data, origin)).items():
        parts = path.split(".")
        value = _at(data, parts)
        if parts[0] in chosen and parts[-1] not in LEFT and value is not None:
            numbers.append((path, f"{parts[0]}.{parts[-1]}", value, limits))
    reach = 1.0
    for _ in range(TRIES):
        steps: dict[str, float] = {}
        changes = []
        for path, same, value, limits in numbers:
            step = steps.setdefault(same, reach * random_.uniform(-1.0, 1.0))
            changes.append((path, _stepped(value, step, *limits)))
        try:
            return apply(text, changes, origin)
        except PresetError:
            reach *= 0.7
    raise PresetError(f"{origin}: none of {TRIES} random changes left the preset playable; change a value by hand")


def _stepped(value: Any, step: float, low: float | None, high: float | None) -> Any:
    """A number, or numbers at notes or in a list, `step` (−1 … 1) of the way to the furthest, within `low` and `high`."""
    if isinstance(value, Mapping):
        return {key: _stepped(each, step, low, high) for key, each in value.items()}
    if isinstance(value, list):
        return [_stepped(each, step, low, high) for each in value]
    if value == 0:
        return 0.0
    stepped = float(f"{value * math.exp(step * math.log(RATIO)):.4g}")
    if low is not None and stepped < low:
        return low
    return high if high is not None and stepped > high else stepped
