"""Plans that were measured of a preset's own strings, and the file beside the preset that keeps them.

The law of `plan` is made for the worst of random strings. What was measured of a very string (`synth plan --measure-plan`)
names the least internal rate and the modes that keep the promise there with a margin. It lies beside the preset, NAME.plan:

    format = 1
    measured = 1                       # VERSION of what was measured, and by what
    velocities = [25, 40, 120]         # of every note; for readers
    strokes = ["3f1c…"]                # ways to begin a note that were measured

    [[string]]
    name = "Pa"
    note = "G2"                        # the open string
    pitch_hz = 98.0
    fingerprint = "9d0e…"              # what its motion depends on (`fingerprints`)

    [string.standard]                  # and draft, fine
    rate_hz = 44100
    highest_hz = 10000                 # modes up to there
    modes = 97                         # of the open string; for readers
    e = 0.011                          # what was measured, the worst of all notes and strokes

A string whose fingerprint is not in the file is planned by the law.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from synth.files.sources import read_bytes

FORMAT = 1
#: of the measuring and of the solver that was measured: plans of another version do not count
VERSION = 1
SUFFIX = ".plan"
#: largest plan that is read [bytes]
MOST_BYTES = 1 << 20
#: qualities that promise something
PROMISED = ("draft", "standard", "fine")
#: a string may be tuned so far down and up from the pitch that it was measured at [semitones]: a tanpura keeps its promises
DOWN_SEMITONES, UP_SEMITONES = 12.5, 7.0
#: … and so far up takes what was measured as it is: tuning and temperament are within the margin
WITHIN_SEMITONES = 0.5
#: measures: those of `plan`, and third octaves of the velocities [dB]
FIGURES = ("e", "e_onset", "lsd_db", "bands_db", "heard_db")
_HEAD = """\
# What keeps the promise of each quality on the strings of this very preset: at the velocities named, within half of its
# limits at 95 % of the notes, three quarters at the others. Between those velocities, and nearer to the saddle and farther
# from it, the lowest, middle and highest note of each string keep the limits themselves. Written by `synth plan
# --measure-plan`; a string that has changed since is planned by the law for all strings.
"""


class PlanError(ValueError):
    """A plan's file that cannot be used; the message names file and field."""


@dataclass(frozen=True)
class Measured:
    """What one quality takes on one string: the least internal rate, modes up to a frequency [Hz]. modes: of the open
    string. figures: measure (`FIGURES`) → the worst that was measured."""

    rate_hz: float
    highest_hz: float
    modes: int
    figures: Mapping[str, float]


@dataclass(frozen=True)
class MeasuredString:
    """One open string: name and note for readers, its pitch [Hz], quality → what it takes."""

    name: str
    note: str
    pitch_hz: float
    fingerprint: str
    qualities: Mapping[str, Measured]

    def at(self, pitch_hz: float, quality: str) -> Measured | None:
        """What a quality takes at a pitch [Hz]: tuned higher everything is quicker in proportion. None: not known."""
        ratio = pitch_hz / self.pitch_hz
        found, semitones = self.qualities.get(quality), 12.0 * math.log2(ratio)
        if found is None or not -DOWN_SEMITONES <= semitones <= UP_SEMITONES:
            return None
        ratio = ratio if semitones > WITHIN_SEMITONES else 1.0
        return Measured(found.rate_hz * ratio, found.highest_hz * ratio, found.modes, found.figures)


@dataclass(frozen=True, eq=False)
class MeasuredPlan:
    """The strings of a preset that were measured, the strokes (`fingerprints.strokes`) and the velocities of every note. It
    goes along with a preset and is no part of what makes two presets equal: all are equal to each other."""

    strings: tuple[MeasuredString, ...] = ()
    strokes: frozenset[str] = frozenset()
    velocities: tuple[int, ...] = ()
    version: int = VERSION
    _by_fingerprint: dict[str, MeasuredString] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_by_fingerprint", {each.fingerprint: each for each in self.strings})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MeasuredPlan)

    def __hash__(self) -> int:
        return hash(MeasuredPlan)

    def string(self, fingerprint: str) -> MeasuredString | None:
        """What was measured of the string with this fingerprint; None: nothing, or by another version."""
        return self._by_fingerprint.get(fingerprint) if self.version == VERSION else None


def path_of(preset_file: Path) -> Path:
    """The plan's file beside a preset's."""
    return preset_file.with_suffix(SUFFIX)


def read_beside(preset_file: Path) -> MeasuredPlan:
    """The plan beside a preset's file; an empty one where none is there. Raises PlanError or OSError."""
    path = path_of(preset_file)
    if not path.is_file():
        return MeasuredPlan()
    try:
        text = read_bytes(path, MOST_BYTES, "plan").decode("utf-8")
    except UnicodeDecodeError:
        raise PlanError(f"{path}: not a text file in UTF-8; {_REMEDY}") from None
    except ValueError as error:
        raise PlanError(f"{error}; {_REMEDY}") from None
    return parse(text, str(path))


_REMEDY = "delete it, or make it again with `synth plan PRESET --measure-plan`"


def parse(text: str, origin: str) -> MeasuredPlan:
    """A plan from its file's text; `origin` names it in messages. Raises PlanError."""
    try:
        data = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise PlanError(f"{origin}: not valid TOML: {error}; {_REMEDY}") from None
    top = _Table(data, origin, "")
    if top.whole("format") != FORMAT:
        raise PlanError(f"{origin}: format: must be {FORMAT}, got {data['format']!r}; {_REMEDY}")
    strokes = top.get("strokes", list)
    if not all(isinstance(each, str) for each in strokes):
        raise PlanError(f"{origin}: strokes: must be a list of text, got {strokes!r}; {_REMEDY}")
    velocities = top.get("velocities", list) if "velocities" in data else []
    if not all(type(each) is int and 1 <= each <= 127 for each in velocities):
        raise PlanError(
            f"{origin}: velocities: must be a list of whole numbers from 1 to 127, got {velocities!r}; {_REMEDY}"
        )
    strings = []
    for number, each in enumerate(data.get("string", []) if isinstance(data.get("string", []), list) else [None]):
        table = _Table(each, origin, f"string.{number}.")
        qualities = {}
        for quality in PROMISED:
            if quality in table.data:
                inner = _Table(table.data[quality], origin, f"string.{number}.{quality}.")
                figures = {name: inner.number(name) for name in FIGURES if name in inner.data}
                numbers = inner.number("rate_hz"), inner.number("highest_hz")
                qualities[quality] = Measured(*numbers, inner.whole("modes"), figures)
        words = [str(table.get(name, str)) for name in ("name", "note", "fingerprint")]
        strings.append(MeasuredString(words[0], words[1], table.number("pitch_hz"), words[2], qualities))
    return MeasuredPlan(tuple(strings), frozenset(strokes), tuple(velocities), top.whole("measured"))


class _Table:
    """A table of the file, whose values are what they must be or an error that names their place."""

    def __init__(self, data: Any, origin: str, place: str) -> None:
        if not isinstance(data, dict):
            raise PlanError(f"{origin}: {place.rstrip('.')}: must be a table, got {data!r}; {_REMEDY}")
        self.data = data
        self._origin, self._place = origin, place

    def get(self, key: str, kind: type) -> Any:
        value = self.data.get(key)
        if not isinstance(value, kind) or isinstance(value, bool):
            what = {str: "text", list: "a list", int: "a whole number"}[kind]
            got = "nothing" if key not in self.data else repr(value)
            raise PlanError(f"{self._origin}: {self._place}{key}: must be {what}, got {got}; {_REMEDY}")
        return value

    def whole(self, key: str) -> int:
        value = int(self.get(key, int))
        if value < 1:
            raise PlanError(f"{self._origin}: {self._place}{key}: must be at least 1, got {value}; {_REMEDY}")
        return value

    def number(self, key: str) -> float:
        value = self.data.get(key)
        least = 0.0 if key in FIGURES else 1.0
        if isinstance(value, bool) or not isinstance(value, int | float) or not least <= value < 1e9:
            got = "nothing" if key not in self.data else repr(value)
            raise PlanError(
                f"{self._origin}: {self._place}{key}: must be a number from {least:g} to 1e9, got {got}; {_REMEDY}"
            )
        return float(value)


def text_of(plan: MeasuredPlan) -> str:
    """The file's text; `parse` reads the same from it."""

    def plain(value: float) -> str:
        return f"{value:.0f}" if value == round(value) and abs(value) < 1e15 else f"{value!r}"

    strokes = ", ".join(f'"{each}"' for each in sorted(plan.strokes))
    lines = [_HEAD, f"format = {FORMAT}", f"measured = {plan.version}"]
    if plan.velocities:
        lines.append(f"velocities = {list(plan.velocities)}")
    lines.append(f"strokes = [{strokes}]")
    for each in plan.strings:
        name = json.dumps(each.name, ensure_ascii=False).replace(
            "\x7f", "\\u007f"
        )  # TOML escapes as JSON does, and that one
        lines += ["", "[[string]]", f"name = {name}", f'note = "{each.note}"', f"pitch_hz = {plain(each.pitch_hz)}"]
        lines.append(f'fingerprint = "{each.fingerprint}"')
        for quality, found in each.qualities.items():
            figures = {name: found.figures[name] for name in FIGURES if name in found.figures}
            values = {"rate_hz": found.rate_hz, "highest_hz": found.highest_hz, "modes": found.modes, **figures}
            inner = ", ".join(f"{key} = {plain(value)}" for key, value in values.items())
            lines.append(f"{quality} = {{ {inner} }}")
    return "\n".join(lines) + "\n"
