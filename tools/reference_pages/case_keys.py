"""The page of cases' keys, out of the schemas and their words; with the schemes that there are."""

from __future__ import annotations

from collections.abc import Iterator

from synth.instrument.preset import Body, MovingMode
from synth.instrument.table import Table
from synth.physics.string import LIMITS
from synth.research.case import OVERRIDES, Case, NutTable, StringTable, case_names
from synth.research.case_words import MEANINGS, Meaning
from synth.research.coupled.coupled_case import CoupledCase
from synth.solver.schemes import ON_A_BODY, SCHEMES

from .fields import Range, aliases, default_of, inner_table, is_list, takes_of
from .markdown import anchor, code, plain, table
from .preset_keys import words_of

_INTRODUCTION = """# Keys of cases

A case is a TOML file for `synth simulate`, or the same tables as a dict for `synth.simulate`. SI units throughout;
places count from the nut, heights and displacements from the string at rest, up is positive. Files that a case names
are looked for beside it. Unknown keys are errors.
"""


def meaning_of(kind: type[Table], key: str) -> Meaning:
    """The words of a key. Raises LookupError where there are none."""
    if kind in (Body, MovingMode):  # as in presets
        words = words_of(kind, key)
        return Meaning(words.tip, words.unit)
    try:
        return MEANINGS[kind][key]
    except KeyError:
        raise LookupError(f"{kind.__name__}.{key} has no words; add them to synth.research.case_words.py") from None


def _tables(kind: type[Table], key: str) -> list[type[Table]]:
    if kind is Body and key == "resonance":  # cases take the body's modes only
        return []
    return inner_table(kind.model_fields[key].annotation)


def keys_of(kind: type[Table]) -> list[str]:
    """The keys of a table that a case may have."""
    return ["mode"] if kind is Body else list(kind.model_fields)


def sections(kind: type[Table], path: str = "") -> Iterator[tuple[str, type[Table], bool, str]]:
    """(path, class, whether it is a list of tables, what it is) of every table, the file itself first."""
    if not path:
        yield "", kind, False, ""
    for key in keys_of(kind):
        for inner in _tables(kind, key):
            place = f"{path}.{key}" if path else key
            yield place, inner, is_list(kind.model_fields[key].annotation), meaning_of(kind, key).text
            yield from sections(inner, place)


def _takes(kind: type[Table], key: str) -> str:
    """What a key takes; of what describes a string the limits of the physics, which judge it after the schema."""
    if issubclass(kind, StringTable | NutTable) and key in LIMITS:
        low, high, _ = LIMITS[key]
        return str(Range(low, high))
    return takes_of(kind.model_fields[key])


def _of(kind: type[Table], root: str) -> Iterator[str]:
    for path, inner, listed, what in sections(kind):
        rows = []
        for key in keys_of(inner):
            field, words = inner.model_fields[key], meaning_of(inner, key)
            other = "".join(f" Also `{each}`." for each in aliases(field, key))
            name = anchor(".".join(filter(None, (root, path, key)))) + code(key)
            rows.append((name, words.unit, _takes(inner, key), default_of(field), plain(words.text) + other))
        title = code(f"[[{path}]]" if listed else f"[{path}]") if path else "The file"
        yield f"### {title}\n"
        if what:
            yield plain(what) + "\n"
        yield table(("key", "unit", "takes", "default", "meaning"), rows)


def page() -> str:
    """The page. Raises LookupError for a key without words."""
    names = ", ".join(code(name) for name in case_names())
    replaced: dict[tuple[str, str], list[str]] = {}
    for name, place in OVERRIDES.items():
        replaced.setdefault(place, []).append(name)
    overrides = [(" or ".join(code(name) for name in given), code(".".join(place))) for place, given in replaced.items()]
    schemes = [(code(name), plain(what)) for name, what in (SCHEMES | ON_A_BODY).items()]
    return "\n".join(
        [
            _INTRODUCTION,
            f"Cases that come with the program: {names}.\n",
            "## One string\n",
            *_of(Case, "one"),
            "## Strings on a body\n",
            "Several strings that share a bridge and a body. Keys of a string and of what lies under it are those of one "
            "string, and these beside.\n",
            *_of(CoupledCase, "body"),
            "## Schemes\n",
            "Values of `scheme.name`; an installed contact law adds its own.\n",
            table(("scheme", "what it is"), schemes),
            "## What `simulate` may be given by name\n",
            "`synth.simulate(case, NAME=value)` replaces a value of the case; `quality` chooses rate and modes as the "
            "engine would.\n",
            table(("name", "replaces"), overrides),
        ]
    )
