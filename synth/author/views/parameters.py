"""Every setting of a preset as a control: what the schema of `synth.instrument.preset` allows, in the words of `words`.

describe(preset) -> list of dicts, in the order of the file, one for every setting that this preset can have now:

    path      where it stands, "string.0.length_m"; what an edit names
    group     "setup" (what shapes the instrument, of several tables), "string", "obstacle", "pluck", "damping", "output",
              "mapping" or "about"
    table     the path of its table, "string.0", "nut.1", "pluck"; "" at the top: controls of one table belong together
    label, unit, tip   words; unit "" for a bare number, a text or a choice
    kind      "number"    a number
              "anchored"  a number, or {note: number} (notes as numbers or names), interpolated between
              "choice"    one of `choices`
              "text"      a line; with `multiline` several
              "notes"     "G2" or "E1-C7"; in data [lowest, highest]
              "flag"      true or false
              "list"      of `item`: "number", "text" or "table"; the tables' own controls follow in the list
    minimum, maximum   ends of the control, both accepted; of a list the number of its items; None: no limit
    above, below       limits that are themselves refused, None where the end is accepted
    usual     [low, high] of real instruments; None: nothing usual
    travel    [low, high] of a slider, as a rule what is usual; None: there is none
    step      what exact entry counts in, None for what is not a number
    integer   whole numbers only
    scale     of the slider: "linear", or "log" where its ends lie a factor of 20 or more apart; also on both sides of zero,
              where it reaches that much further than what is usual
    default   value where the file has none, None: there is none (`required`) or it is then absent (`optional`)
    required  the file must have it
    optional  may be absent (null): the default is its absence
    suggested  for what is absent: the value that sounds like what stands in its place; None where there is none
    instead_of paths of settings that exclude this one: an edit that sets it sets them to null as well
    together_with  paths that must be set, or absent, along with this one, and those that go where it goes
    choices   [{value, label, edits}] of a choice, edits: the changes [{path, value}] that choose it, in one edit; else None
    new       of a list of tables: a valid item, which an edit of `path`.N appends, N how many there are; else None
    live      heard at the next pluck without compiling anything (`engine.parameters`)

The values are not here: they are the document's data.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen

from synth.author.views.words import CHOICES, GROUPS, OBSTACLES, SETUP, Words, words_of
from synth.instrument.articulations import Knock, Touch
from synth.instrument.compile import axial_stiffness, ideal_string, obstacle_of, string_frequency
from synth.instrument.fields import Between
from synth.instrument.preset import (
    KINDS,
    NECK_KEYS,
    BoardObstacle,
    BodyMode,
    BridgeObstacle,
    FretsObstacle,
    Layer,
    ModeOrField,
    MovingMode,
    NutMode,
    Output,
    Polarisation,
    Preset,
    Setup,
    StringTable,
    Table,
    at_note,
    fret_count,
)

#: no setting: the version of the file's form; articulations, effects and excitations, of names or fields of their own, are
#: set in the file
NOT_SETTINGS = frozenset({"format", "articulations", "effect", "excitation"})
#: texts of several lines
MULTILINE = frozenset({"description", "remarks"})
#: from which ratio of the usual range's ends on a slider is logarithmic
LOG_FROM = 20.0
#: a valid obstacle of each kind, for changing over
OBSTACLE_OF_KIND: dict[str, dict[str, Any]] = {
    "none": {"kind": "none"},
    "bridge": {"kind": "bridge", "distance_ratio": 0.007, "jiva_um": 3.0},
    "points": {"kind": "points"},
    "board": {"kind": "board", "semitones": 12, "action_12th_mm": 1.5},
    "frets": {"kind": "frets", "count": 20, "action_12th_mm": 2.2, "relief_mm": 0.2, "nut_height_mm": 0.5},
}
#: an item to begin with, of lists of tables that may be empty
NEW_ITEMS: dict[type[Table], dict[str, float]] = {
    NutMode: {"frequency_hz": 150.0, "q": 1.0, "mass_kg": 1.0},
    BodyMode: {"frequency_hz": 200.0, "q": 20.0, "gain_db": -12.0},
    MovingMode: {"frequency_hz": 200.0, "q": 25.0, "mass_kg": 0.6},
}
#: a hill by the nut to begin with
SAWARI = {"sawari_distance_mm": 12.0, "sawari_um": 5.0}
#: pairs of which one stands in place of the other, and pairs that go together
INSTEAD = (
    ("linear_density_g_m", "density_kg_m3"),
    ("youngs_modulus_gpa", "inharmonicity"),
    ("distance_mm", "distance_ratio"),
    ("action_12th_mm", "heights_mm"),
)
TOGETHER = (("core_diameter_mm", "winding_diameter_mm"), ("sawari_distance_mm", "sawari_um"), ("to_hz", "spacing_hz"))
#: pairs of which the second cannot be set without the first
NEEDED_BY = (("to_hz", "seed"), ("spacing_hz", "seed"))

Numbers = float | dict[int, float]


def describe(preset: Preset) -> list[dict[str, Any]]:
    """The controls of a preset; see the module's docstring."""
    out = []
    for entry, table in _of_table(preset, Preset, "", preset):
        name = entry["path"].rpartition(".")[2]
        if getattr(table, name) in (None, ()) and (entry["optional"] or entry["instead_of"]):
            entry["suggested"] = _suggestion(preset, table, name)
        out.append(entry)
    return out


def ranges(preset: Preset) -> dict[str, tuple[float | None, float | None]]:
    """(minimum, maximum) of every setting, by its path."""
    return {entry["path"]: (entry["minimum"], entry["maximum"]) for entry, _ in _of_table(preset, Preset, "", preset)}


def steppable(preset: Preset) -> dict[str, tuple[float | None, float | None]]:
    """(minimum, maximum) of every number that may take any value between them, by its path; of lists (None, None)."""
    found: dict[str, tuple[float | None, float | None]] = {}
    for entry, _ in _of_table(preset, Preset, "", preset):
        if entry["kind"] == "list" and entry["item"] == "number":
            found[entry["path"]] = (None, None)
        elif entry["kind"] in ("number", "anchored") and not entry["integer"]:
            found[entry["path"]] = (entry["minimum"], entry["maximum"])
    return found


def _of_table(preset: Preset, kind: type[Table], prefix: str, table: Table) -> Iterator[tuple[dict[str, Any], Table]]:
    """Every control of a table and of those within it, with the table that it stands in."""
    for name, field in kind.model_fields.items():
        if not prefix and name in NOT_SETTINGS:
            continue
        if prefix == "obstacle" and name == "friction" and preset.polarisation is None:  # of strings with two directions
            continue
        if prefix == "damping" and name == "others_s" and not preset.coupled:  # strings that a hand can cover share a bridge
            continue
        if _is_of_the_other_neck(preset, prefix, name):
            continue
        path = f"{prefix}.{name}" if prefix else name
        value = getattr(table, name)
        inner, metadata = _unwrapped(field.annotation, field.metadata)
        if _is_of_the_other_kind(preset, value, inner):
            continue
        if isinstance(value, Table) and get_origin(inner) is not tuple:
            yield from _of_table(preset, type(value), path, value)
            continue
        yield _control(preset, kind, table, name, path, inner, metadata), table
        if isinstance(value, tuple) and value and isinstance(value[0], Table):
            for index, item in enumerate(value):
                yield from _of_table(preset, type(item), f"{path}.{index}", item)


def _is_of_the_other_neck(preset: Preset, prefix: str, name: str) -> bool:
    """Whether a key is of a neck that [setup] has in the obstacle's place or does not have; that is begun in the file."""
    by_setup = preset.setup is not None and preset.setup.shapes_the_neck
    if prefix == "obstacle":
        return by_setup and name in NECK_KEYS
    if prefix == "setup":
        of_frets = name in ("fall_away_mm", "fall_away_fret", "fret_heights_mm")
        return name != "strings" and (not by_setup or (of_frets and isinstance(preset.obstacle, BoardObstacle)))
    return False


def _is_of_the_other_kind(preset: Preset, value: Any, inner: Any) -> bool:
    """Whether a table that is not there can only be where strings share a body, or only where they do not, or several of its
    keys need each other: that is begun in the file."""
    absent = value is None or value == ()
    if absent and inner in (Layer, Setup, Touch, Knock):
        return True
    of_bodies = inner is Polarisation or get_args(inner)[:1] == (MovingMode,)
    of_others = get_args(inner)[:1] == (BodyMode,)
    return absent and ((of_bodies and not preset.coupled) or (of_others and preset.coupled))


def _unwrapped(annotation: Any, metadata: list[Any]) -> tuple[Any, list[Any]]:
    """A field's type without None and without Annotated, and all its metadata."""
    found = list(metadata)
    while True:
        if get_origin(annotation) is Annotated:
            annotation, *more = get_args(annotation)
            found += more
            continue
        if get_origin(annotation) in (Union, UnionType):
            kinds = [kind for kind in get_args(annotation) if kind is not NoneType]
            if len(kinds) == 1:
                annotation = kinds[0]
                continue
        return annotation, found


def _control(
    preset: Preset, kind: type[Table], table: Table, name: str, path: str, inner: Any, metadata: list[Any]
) -> dict[str, Any]:
    words = words_of(kind, table, name)
    travel = words.travel or words.usual
    field = kind.model_fields[name]
    # of [setup] and a board one has the action, which cannot be absent
    required = field.is_required() or (kind, name) in ((BoardObstacle, "action_12th_mm"), (Setup, "action_bass_mm"))
    default = None if required else _plain(field.get_default(call_default_factory=True))
    entry: dict[str, Any] = {
        "path": path,
        "group": SETUP if words.setup else GROUPS[path.split(".")[0]],
        "table": path.rpartition(".")[0],
        "label": words.label,
        "unit": words.unit,
        "tip": words.tip,
        "kind": "",
        "multiline": name in MULTILINE,
        "item": None,
        **_limits(metadata, words),
        "usual": list(words.usual) if words.usual else None,
        "travel": list(travel) if travel else None,
        "step": words.step,
        "integer": inner is int,
        "scale": "log" if _spreads(words.usual, travel) else "linear",
        "default": default,
        "required": required,
        "optional": not required and default is None,
        "suggested": None,
        "instead_of": [_beside(path, other) for other in _partners(INSTEAD, name) if other in kind.model_fields],
        "together_with": [
            _beside(path, other)
            for other in (*_partners(TOGETHER, name), *(b for a, b in NEEDED_BY if a == name))
            if other in kind.model_fields
        ],
        "choices": None,
        "new": None,
        "live": words.live,
    }
    if path == "obstacle.kind":
        entry.update(kind="choice", default="none", required=False, choices=_obstacles(preset))
    elif get_origin(inner) is Literal:
        labels = CHOICES[kind, name]
        entry.update(kind="choice")
        entry["choices"] = [
            {"value": value, "label": labels[value], "edits": [{"path": path, "value": value}]}
            for value in get_args(inner)
            if kind is not Output or (value == "body") == preset.coupled
        ]
    elif inner is bool:
        entry.update(kind="flag")
    elif inner is str:
        entry.update(kind="text")
    elif inner == tuple[int, int]:
        entry.update(kind="notes")
    elif inner in (int, float):
        entry.update(kind="number")
    elif get_origin(inner) is tuple:
        entry.update(kind="list", **_list_item(_unwrapped(get_args(inner)[0], [])[0], table, name))
    else:
        entry.update(kind="anchored")
    return entry


def _spreads(usual: tuple[float, float] | None, travel: tuple[float, float] | None) -> bool:
    """Whether a slider from end to end needs a scale that is finer where its values are small."""
    if usual is None or travel is None:
        return False
    if travel[0] > 0.0:
        return travel[1] >= LOG_FROM * travel[0]
    return travel[1] - travel[0] >= LOG_FROM * (usual[1] - usual[0])


def _list_item(item: Any, table: Table, name: str) -> dict[str, Any]:
    if item is float:
        return {"item": "number"}
    if item is str:
        return {"item": "text"}
    if item is StringTable:
        new = _plain(getattr(table, name)[-1].model_dump(exclude_unset=True))
    else:
        new = NEW_ITEMS[item]
    return {"item": "table", "new": new}


def _limits(metadata: list[Any], words: Words) -> dict[str, Any]:
    """minimum, maximum, above, below of a field's metadata. An end that is refused is moved inside by a step."""
    out: dict[str, Any] = {"minimum": None, "maximum": None, "above": None, "below": None}
    step = words.step or 0.0
    for item in _flat(metadata):
        match item:
            case Between(low=low, high=high):
                out.update(minimum=low, maximum=high)
            case Ge(ge=low):
                out["minimum"] = low
            case Le(le=high):
                out["maximum"] = high
            case Gt(gt=low):
                out.update(above=low, minimum=round(low + step, 12))  # type: ignore[operator, call-overload]
            case Lt(lt=high):
                out.update(below=high, maximum=round(high - step, 12))  # type: ignore[operator, call-overload]
            case MinLen(min_length=low):
                out["minimum"] = low
            case MaxLen(max_length=high):
                out["maximum"] = high
    return out


def _flat(metadata: list[Any]) -> Iterator[Any]:
    for item in metadata:
        func = getattr(item, "func", None)
        yield func if isinstance(func, Between) else item


def _plain(value: Any) -> Any:
    """The JSON of a default or an item."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def _beside(path: str, name: str) -> str:
    return f"{path.rpartition('.')[0]}.{name}"


def _partners(pairs: tuple[tuple[str, str], ...], name: str) -> list[str]:
    return [b if name == a else a for a, b in pairs if name in (a, b)]


def _obstacles(preset: Preset) -> list[dict[str, Any]]:
    """The kinds of obstacle, each with the edits that change over; the present one keeps its numbers."""
    lengths = [at_note(table.length_m, note) for table in preset.string for note in table.notes]
    shortest, longest = min(lengths), max(lengths)
    out = []
    for kind in KINDS:
        value = dict(OBSTACLE_OF_KIND[kind])
        if kind == "board":  # an octave under every string
            value["length_mm"] = round(560.0 * longest, 1)
            fits = 0.56 * longest < 0.9 * shortest and not preset.coupled
            if not fits and preset.obstacle.kind != kind:
                continue
        if kind == "points":
            value["positions_mm"], value["heights_mm"] = [round(500.0 * shortest, 1)], [-1.0]
        if kind == preset.obstacle.kind:
            value = {"kind": kind, **_plain(preset.obstacle.model_dump(exclude_unset=True))}
        edits: list[dict[str, Any]] = [{"path": "obstacle", "value": value}]
        if kind != preset.obstacle.kind and preset.setup is not None and preset.setup.shapes_the_neck:
            strings = list(preset.setup.strings)
            edits.append({"path": "setup", "value": {"strings": strings} if strings else None})
        if kind != "bridge" and preset.mapping.pressure_um != 0.0:  # there would be no bridge to move
            edits.append({"path": "mapping.pressure_um", "value": None})
        if kind == "board":  # where a finger follows every bend
            edits += [
                {"path": f"string.{number}.{key}", "value": None}
                for number, table in enumerate(preset.string)
                if table.tension_modulation
                for key in ("axial_stiffness_n", "tension_modulation")
            ]
            if preset.polarisation is not None and not preset.coupled:
                edits.append({"path": "polarisation", "value": None})
        out.append({"value": kind, "label": OBSTACLES[kind], "edits": edits})
    return out


def _suggestion(preset: Preset, table: Table, name: str) -> Any:
    """The value of an absent setting that sounds like what stands in its place."""
    if isinstance(table, StringTable):
        return _of_string(preset, table, name)
    if isinstance(table, BridgeObstacle):
        if name not in ("distance_mm", "distance_ratio"):
            return None
        first = preset.string[0]
        length = at_note(first.length_m, first.notes[0])
        if name == "distance_mm" and table.distance_ratio is not None:
            return _rounded(1e3 * table.distance_ratio * length)
        return (
            _rounded(at_note(table.distance_mm, first.notes[0]) * 1e-3 / length) if table.distance_mm is not None else None
        )
    if isinstance(table, FretsObstacle):
        if name in SAWARI:
            return SAWARI[name]
        if name == "action_12th_mm":
            return _rounded(-table.heights_mm[11]) if table.count >= 12 else None
        first = preset.string[0]
        try:
            heights = obstacle_of(preset, first, first.notes[0], at_note(first.length_m, first.notes[0])).heights_m
        except ValueError:
            return None
        return [_rounded(1e3 * height) for height in heights]
    if isinstance(table, ModeOrField):
        to_hz = table.to_hz or min(2.0 * table.frequency_hz, 20000.0)  # an octave, with eight modes in it
        return {"to_hz": to_hz, "spacing_hz": _rounded((to_hz - table.frequency_hz) / 8.0)}.get(name)
    if isinstance(table, Setup):
        beside = {"action_treble_mm": table.action_bass_mm, "nut_treble_mm": table.nut_bass_mm}
        return {**beside, "saddle_radius_mm": table.board_radius_mm}.get(name)
    pluck = preset.pluck
    return {"position_hard": pluck.position, "width_hard_mm": pluck.width_mm, "slip_hard_ms": pluck.slip_ms}.get(name)


def _of_string(preset: Preset, table: StringTable, name: str) -> Any:
    notes = sorted({note for _, value in table if isinstance(value, dict) for note in value} & set(range(*table.notes)))
    if name == "core_diameter_mm":
        return _mapped(table.diameter_mm, 0.35)
    if name == "winding_diameter_mm":
        return _mapped(table.diameter_mm, 0.3)
    if name == "pluck_position":
        return preset.pluck.position
    if name == "sounds":
        return table.notes[0]
    if name == "frets":
        return fret_count(preset) or None
    if name == "bridge_points":
        return preset.obstacle.points if isinstance(preset.obstacle, BridgeObstacle) else None
    if name == "axial_stiffness_n":
        return _rounded(axial_stiffness(preset, table, table.notes[0])) if table.tension_modulation else None
    values = {}
    for note in [table.notes[0], *notes, table.notes[1]]:
        try:
            string = ideal_string(preset, table, note, string_frequency(preset, table, note))
        except ValueError:
            return None
        bent = string.core_diameter_m or string.diameter_m
        values[note] = _rounded(
            {
                "linear_density_g_m": 1e3 * string.linear_density_kg_m,
                "density_kg_m3": string.linear_density_kg_m / (math.pi * string.diameter_m**2 / 4.0),
                "youngs_modulus_gpa": 1e-9 * string.bending_stiffness_n_m2 / (math.pi * bent**4 / 64.0),
                "inharmonicity": string.inharmonicity,
            }[name]
        )
    same = set(values.values())
    return same.pop() if len(same) == 1 else _plain(values)


def _mapped(value: Numbers, factor: float) -> Any:
    if isinstance(value, dict):
        return {str(note): _rounded(factor * number) for note, number in value.items()}
    return _rounded(factor * value)


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")
