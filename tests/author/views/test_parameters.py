"""The controls: none is forgotten, and what they say of range and default is what the schema accepts."""

import json
import tomllib
from collections.abc import Iterator
from typing import Any

import pytest

from synth.author.changes import apply
from synth.author.views.instrument import draw
from synth.author.views.parameters import NOT_SETTINGS, describe, ranges
from synth.author.views.words import GROUPS, WORDS
from synth.instrument.preset import NECK_KEYS, Preset, PresetError, migrate, validate_preset

from .kit import TEXTS, preset

NAMES = sorted(TEXTS)
#: given by note only, never as one number
BY_NOTE = ("tuning.contact_cents", "tuning.sympathetic_cents")


def controls(name: str) -> dict[str, dict[str, Any]]:
    return {entry["path"]: entry for entry in describe(preset(name))}


def leaves(value: Any, path: str = "") -> Iterator[str]:
    """Paths of a dumped preset that hold no table."""
    if isinstance(value, dict) and not all(isinstance(key, int) for key in value):
        for key, item in value.items():
            yield from leaves(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
        for index, item in enumerate(value):
            yield from leaves(item, f"{path}.{index}")
    else:
        yield path


def put(name: str, entry: dict[str, Any], value: Any) -> Preset:
    """The preset with one control set, and those that exclude it or go along with it as they must be."""
    data = tomllib.loads(TEXTS[name])
    migrate(data, name)
    for path, new in [
        *((path, None) for path in entry["instead_of"]),
        *((path, 1 if path.endswith(".seed") else 0.1) for path in entry["together_with"]),
        (entry["path"], value),
    ]:
        *way, key = path.split(".")
        place: Any = data
        for part in way:
            place = place[int(part)] if part.isdecimal() else place.setdefault(part, {})
        if new is None:
            place.pop(key, None)
        else:
            place[key] = new
    return validate_preset(data, name)


def of_another_string(path: str) -> bool:
    """Of a string behind the first: the same controls once more."""
    return path.startswith("string.") and not path.startswith("string.0.")


def value_at(of: Any, path: str) -> Any:
    for part in path.split("."):
        of = of[int(part)] if part.isdecimal() else getattr(of, part)
    return of


def test_the_schema_has_words_for_every_field_and_no_others() -> None:
    schema = Preset.model_json_schema()
    tables = {"Preset": schema, **schema["$defs"]}
    spoken = {kind.__name__: set(fields) for kind, fields in WORDS.items()}
    written = {name: set(table["properties"]) for name, table in tables.items()}
    for table in ("EffectTable", "ExcitationTable", "Articulation", "Controller"):  # these are set in the file
        del written[table]
    written["Preset"] -= {
        "format",
        "effect",
        "excitation",
        "tuning",
        "setup",
        "obstacle",
        "pluck",
        "damping",
        "output",
        "body",
        "mapping",
        "hand",
        "articulations",
    }
    assert spoken == written
    for fields in WORDS.values():
        for words in fields.values():
            assert words.label and words.tip.endswith(".") and len(words.tip) < 240
    assert set(GROUPS) == set(schema["properties"]) - NOT_SETTINGS


@pytest.mark.parametrize("name", NAMES)
def test_every_leaf_of_a_preset_has_one_control(name: str) -> None:
    entries = describe(preset(name))
    json.dumps(entries, allow_nan=False)
    paths = [entry["path"] for entry in entries]
    assert len(set(paths)) == len(paths)
    tables = {entry["path"] for entry in entries if entry["item"] == "table"}
    hidden = {"body.resonance"} if preset(name).coupled else {"body.mode", "polarisation"}
    if preset(name).setup is None:
        hidden |= {"setup"}
    else:
        hidden |= {f"obstacle.{key}" for key in NECK_KEYS}
    hidden |= {"obstacle.layer", "hand.release"} | (set() if preset(name).polarisation else {"obstacle.friction"})
    written = {path for path in leaves(preset(name).model_dump()) if path.split(".")[0] not in NOT_SETTINGS}
    hidden -= {"hand.release"} if preset(name).hand.release else set()
    hidden |= set() if preset(name).hand.knock else {"hand.knock"}
    hidden |= set() if preset(name).coupled else {"damping.others_s"}
    assert written - hidden == set(paths) - {path for path in tables if value_at(preset(name), path)}
    assert ranges(preset(name)) == {entry["path"]: (entry["minimum"], entry["maximum"]) for entry in entries}


@pytest.mark.parametrize("name", NAMES)
def test_numbers_are_accepted_to_the_ends_of_their_range_and_refused_beyond(name: str) -> None:
    seen = 0
    for path, entry in controls(name).items():
        if entry["kind"] not in ("number", "anchored") or of_another_string(path):
            continue
        low, high = entry["minimum"], entry["maximum"]
        assert low is not None and high is not None and low < high, path
        assert entry["step"] > 0.0 and low <= entry["usual"][0] < entry["usual"][1] <= high, path
        beyond_low = low - 1 if entry["integer"] else low - 1e-6 * max(1.0, abs(low))
        beyond_high = high + 1 if entry["integer"] else high + 1e-6 * max(1.0, abs(high))
        beyond = [
            beyond_low if entry["above"] is None else entry["above"],
            beyond_high if entry["below"] is None else entry["below"],
        ]
        for end in (low, high):
            value = {60: end} if path in BY_NOTE else end
            if possible(name, entry, value):
                assert value_at(put(name, entry, value), path) == value, (path, value)
        for end in beyond:
            value = {60: end} if path in BY_NOTE else end
            with pytest.raises(PresetError, match=path.split(".")[-1]):
                put(name, entry, value)
        seen += 1
    assert seen > 15


def possible(name: str, entry: dict[str, Any], value: float | dict[int, float]) -> bool:
    """Whether a value at an end of its range also agrees with the rest of the preset; what does not is refused for that."""
    try:
        put(name, entry, value)
    except PresetError as error:
        own = [message for path, message in error.problems if path == entry["path"]]
        assert not own, (entry["path"], value, own)
        return False
    return True


@pytest.mark.parametrize("name", NAMES)
def test_defaults_are_what_a_file_without_the_key_gets(name: str) -> None:
    for path, entry in controls(name).items():
        if entry["required"] or entry["instead_of"] or entry["together_with"] or path == "obstacle.kind":
            continue
        if of_another_string(path):
            continue
        if preset(name).coupled and path in ("output.kind", "body.mode"):
            with pytest.raises(PresetError, match=r"need each other|knock needs a body"):
                put(name, entry, None)
            continue
        first = preset(name).string[0]
        if path == "string.0.axial_stiffness_n" and first.tension_modulation and first.youngs_modulus_gpa is None:
            with pytest.raises(PresetError, match="resistance to stretching"):
                put(name, entry, None)
            continue
        value = value_at(apply(TEXTS[name], [(path, None)], name)[1], path)
        assert (list(value) if isinstance(value, tuple) else value) == entry["default"], path


def test_a_mode_becomes_a_field_and_a_field_a_mode_in_one_edit() -> None:
    found = controls("fretted-bass")
    suggested = [(f"nut.0.{key}", found[f"nut.0.{key}"]["suggested"]) for key in ("to_hz", "spacing_hz")]
    one, both = preset("fretted-bass"), apply(TEXTS["fretted-bass"], suggested, "fretted-bass")[1]
    assert one.nut[0].field() is None and 4 <= len(both.nut[0].field()) <= 16 and both.nut[1:] == one.nut[1:]
    entry = found["nut.2.to_hz"]
    gone = [(path, None) for path in (entry["path"], *entry["together_with"])]
    assert len(gone) == 3 and one.nut[2].field()
    assert apply(TEXTS["fretted-bass"], gone, "fretted-bass")[1].nut[2].field() is None
    assert found["nut.2.seed"]["together_with"] == []  # a seed's default keeps the field


@pytest.mark.parametrize("name", NAMES)
def test_what_is_required_cannot_be_left_out(name: str) -> None:
    required = [path for path, entry in controls(name).items() if entry["required"]]
    assert {"name", "string", "string.0.notes", "string.0.length_m", "pluck.displacement_mm"} <= set(required)
    for path in required:
        with pytest.raises(PresetError):
            apply(TEXTS[name], [(path, None)], name)


@pytest.mark.parametrize("name", NAMES)
def test_every_choice_can_be_chosen(name: str) -> None:
    chosen = 0
    for path, entry in controls(name).items():
        for choice in entry["choices"] or []:
            changes = [(edit["path"], edit["value"]) for edit in choice["edits"]]
            assert value_at(apply(TEXTS[name], changes, name)[1], path) == choice["value"], (path, choice)
            chosen += 1
    assert chosen >= 10


@pytest.mark.parametrize("name", NAMES)
def test_lists_of_tables_take_a_new_item(name: str) -> None:
    for path, entry in controls(name).items():
        if entry["item"] != "table":
            continue
        present = len(value_at(preset(name), path))
        grown = apply(TEXTS[name], [(f"{path}.{present}", json.loads(json.dumps(entry["new"])))], name)[1]
        assert len(value_at(grown, path)) == present + 1


def described_string(of: Preset) -> tuple[float, ...]:
    drawing = draw(of, of.string[0].notes[0])
    return drawing["tension_n"], drawing["linear_density_kg_m"], drawing["inharmonicity"], drawing["length_m"]


@pytest.mark.parametrize("name", NAMES)
def test_what_stands_in_for_another_value_is_the_same_string(name: str) -> None:
    before = preset(name)
    tried = 0
    for path, entry in controls(name).items():
        if not entry["instead_of"] or entry["suggested"] is None:
            continue
        after = put(name, entry, entry["suggested"])
        note = before.string[0].notes[0]
        if path.startswith("string.0."):
            assert described_string(after) == pytest.approx(described_string(before), rel=2e-3), path
            tried += 1
        elif path.startswith("obstacle.") and path != "obstacle.action_12th_mm":
            points, were = draw(after, note)["points"], draw(before, note)["points"]
            assert [(p["x"], p["height"]) for p in points] == [
                (pytest.approx(p["x"], abs=1e-6), pytest.approx(p["height"], rel=5e-4, abs=1e-3))
                for p in were  # four digits
            ], path
            tried += 1
    assert tried >= 2


def test_a_moved_bridge_has_no_pressure_left_to_move_it_when_it_goes() -> None:
    kind = controls("tanpura-light")["obstacle.kind"]
    edits = next(choice["edits"] for choice in kind["choices"] if choice["value"] == "frets")
    assert [edit["path"] for edit in edits] == ["obstacle", "mapping.pressure_um"]


def test_live_controls_are_the_engines_live_parameters() -> None:
    live = {path for path, entry in controls("tanpura-light").items() if entry["live"]}
    assert live == {
        "pluck.position",
        "pluck.displacement_mm",
        "pluck.width_mm",
        "damping.release_s",
        "output.gain_db",
        "obstacle.jiva_um",
    }


def test_setup_is_what_the_string_touches_where_it_is_plucked_and_heard() -> None:
    setup = {name: {path for path, entry in controls(name).items() if entry["group"] == "setup"} for name in NAMES}
    assert setup["tanpura-light"] == {
        "obstacle.kind",
        "obstacle.distance_mm",
        "obstacle.distance_ratio",
        "obstacle.frets",
        "obstacle.jiva_um",
        "obstacle.points",
        "obstacle.radius_mm",
        "pluck.position",
        "pluck.displacement_mm",
        "pluck.width_mm",
        "output.kind",
        "output.position",
        "output.distance_mm",
    }
    assert {"obstacle.action_12th_mm", "obstacle.relief_mm", "obstacle.heights_mm"} <= setup["fretted-bass"]


@pytest.mark.parametrize("name", NAMES)
def test_sliders_reach_what_is_usual_and_go_no_further_than_what_is_allowed(name: str) -> None:
    for path, entry in controls(name).items():
        if entry["travel"] is None or entry["minimum"] is None:
            continue
        (low, high), usual = entry["travel"], entry["usual"]
        assert entry["minimum"] <= low <= usual[0] < usual[1] <= high <= entry["maximum"], path
    if "obstacle.jiva_um" in controls(name):
        jiva = controls(name)["obstacle.jiva_um"]
        assert jiva["travel"] == [jiva["minimum"], jiva["maximum"]] and jiva["scale"] == "log"
