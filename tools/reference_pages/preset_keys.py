"""The page of presets' keys, out of the schema and the words of the authoring page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, get_args, get_origin

from synth.author.views.file_words import FILE_WORDS
from synth.author.views.words import CHOICES, OBSTACLES, WORDS, Words
from synth.instrument.preset import Preset
from synth.instrument.table import Table

from .fields import default_of, inner_table, is_list, number, takes_of
from .markdown import anchor, code, plain, table

_INTRODUCTION = """# Keys of presets

A preset is a TOML file. Unknown keys are errors, and all errors are reported at once; `synth presets check FILE` looks for
more, at every note and fret. `--set TABLE.KEY=VALUE` changes one value for a run (`--set obstacle.jiva_um=10`, `--set
string.0.cents=3`).

A number with its range stands under *takes*; *usual* is what real instruments have. One that can be given *at notes* is
a number for all, or several at anchor notes, `{ E1 = 1.1, C7 = 0.12 }`: between them they are interpolated, as ratios
where all are positive, and beyond the outer ones the nearest holds. A note is a name (`C3`, `F#2`, C4 is middle C) or a
MIDI number.
"""


def words_of(kind: type[Table], key: str) -> Words:
    """The words of a key. Raises LookupError where there are none."""
    for words in (WORDS, FILE_WORDS):
        if key in words.get(kind, {}):
            return words[kind][key]
    raise LookupError(f"{kind.__name__}.{key} has no words; add them to synth/author/views/words.py")


def sections(kind: type[Table] = Preset, path: str = "") -> Iterator[tuple[str, type[Table], bool, str]]:
    """(path, class, whether it is a list of tables, what it is) of every table, the file itself first.

    A table of several kinds has its kind behind a colon, as obstacle:bridge; one of any name has NAME for it.
    """
    if not path:
        yield "", kind, False, "A whole instrument."
    for key, field in kind.model_fields.items():
        tables = inner_table(field.annotation)
        if not tables:
            continue
        place = f"{path.partition(':')[0]}.{key}" if path else key
        if get_origin(field.annotation) is dict:
            place += ".NAME"
        what = words_of(kind, key).tip
        for inner in tables:
            found = place
            if len(tables) > 1:
                name = get_args(inner.model_fields["kind"].annotation)[0]
                found, what = f"{place}:{name}", f"{OBSTACLES[name][0].upper()}{OBSTACLES[name][1:]}."
            yield found, inner, is_list(field.annotation), what
            yield from sections(inner, found)


def heading(path: str, listed: bool) -> str:
    """A table as the file has it."""
    place, _, kind = path.partition(":")
    if not place:
        return "The file"
    return code(f"[[{place}]]" if listed else f"[{place}]") + (f" with kind = {kind}" if kind else "")


def _row(path: str, kind: type[Table], key: str) -> tuple[str, ...]:
    field, words = kind.model_fields[key], words_of(kind, key)
    labels = CHOICES.get((kind, key), {}) if get_origin(field.annotation) is Literal else {}
    if path.startswith("obstacle:") and key == "kind":
        words = Words(words.label, f"What the strings touch: {OBSTACLES[path.partition(':')[2]]}.")
    tip = plain(words.tip) + "".join(f" `{value}`: {plain(label)}." for value, label in labels.items())
    usual = "" if words.usual is None else " to ".join(number(end) for end in words.usual)
    place = f"{path}.{key}" if path else key
    return anchor(place) + code(key), words.unit, takes_of(field), usual, default_of(field), tip


def page() -> str:
    """The page. Raises LookupError for a key without words."""
    out, seen = [_INTRODUCTION], set()
    for path, kind, listed, what in sections():
        if path in seen:  # a layer is the same under every kind of obstacle
            continue
        seen.add(path)
        rows = [_row(path, kind, key) for key in kind.model_fields]
        head = ("key", "unit", "takes", "usual", "default", "meaning")
        out += [f"## {heading(path, listed)}\n", plain(what) + "\n", table(head, rows)]
    return "\n".join(out)
