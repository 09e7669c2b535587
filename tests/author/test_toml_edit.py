"""Changes of a TOML text: comments, order and everything else stay as they are."""

from __future__ import annotations

import difflib
import tomllib

import pytest
import tomlkit
from hypothesis import given, settings
from hypothesis import strategies as st

from synth.author.toml_edit import change_in
from synth.instrument.preset import preset_folder

#: the tanpura without its gourd, which stands at the end
TEXT = (preset_folder() / "tanpura-light.toml").read_text(encoding="utf-8").split("\n[body]")[0] + "\n"
CLEARS = "# pressing a key lowers the bridge until the string hardly touches it: the buzz clears"
NAMES = ("tanpura-light", "fretted-bass", "jawari-harp")


def change(text: str, path: str, value: object) -> str:
    return tomlkit.dumps(change_in(tomlkit.parse(text), path, value))


def changed_lines(before: str, after: str) -> list[str]:
    diff = difflib.unified_diff(before.splitlines(), after.splitlines(), lineterm="", n=0)
    return [line for line in diff if line[0] in "+-" and not line.startswith(("+++", "---"))]


@pytest.mark.parametrize(
    ("path", "value", "lines"),
    [
        ("pluck.position", 0.3, ["-position = 0.42", "+position = 0.3"]),
        ("pluck.position", 0.1 + 0.2, ["-position = 0.42", "+position = 0.3"]),
        ("string.3.cents", 1, ["+cents = 1"]),
        ("string.1.gain_db", None, ["-gain_db = 1.1"]),
        ("tuning.offset_cents", -3.5, ["+offset_cents = -3.5"]),
        ("tuning.a4_hz", None, []),
        ("title", 'Tan"pura', ['-title = "Tanpura, light"', '+title = "Tan\\"pura"']),
        ("remarks", "one line", ['+remarks = "one line"']),
        ("remarks", 'two\n"""lines', ['+remarks = """', "+two", '+""\\"lines"""']),
        ("damping.ring_on", False, ["-ring_on = true", "+ring_on = false"]),
        ("string.0.length_m", {"28": 1.0, "C4": 0.5}, ["-length_m = 0.95", "+length_m = {E1 = 1.0, C4 = 0.5}"]),
        ("body.direct_db", -3.0, ["+", "+[body]", "+direct_db = -3.0"]),
        (
            "mapping.pressure_um",
            -20.0,
            [
                f"-pressure_um = -25.0 {CLEARS}",
                f"+pressure_um = -20.0 {CLEARS}",
            ],
        ),
        (
            "obstacle",
            {"kind": "bridge", "distance_ratio": 0.01, "jiva_um": 3.0},
            ["-distance_mm = 6.0 # IA2018: the tanpura's two-point bridge", "+distance_ratio = 0.01"],
        ),
    ],
)
def test_only_what_is_meant_changes(path: str, value: object, lines: list[str]) -> None:
    after = change(TEXT, path, value)
    assert sorted(changed_lines(TEXT, after)) == sorted(lines)
    tomllib.loads(after)


def test_a_new_string_and_its_end() -> None:
    string = {"notes": "C4", "length_m": 0.5}
    more = change(TEXT, "string.4", string)
    assert tomllib.loads(more)["string"][4] == string
    assert tomllib.loads(change(more, "string.4", None)) == tomllib.loads(TEXT)
    assert len(tomllib.loads(change(more, "string.0", None))["string"]) == 4


def test_tables_of_a_table_come_and_go() -> None:
    text = change(TEXT, "body.resonance.0", {"frequency_hz": 100.0, "q": 3.0, "gain_db": -6.0})
    text = change(text, "body.resonance.1", {"frequency_hz": 200.0, "q": 4.0, "gain_db": -9.0})
    text = change(text, "body.resonance.1.q", 5.0)
    assert [each["q"] for each in tomllib.loads(text)["body"]["resonance"]] == [3.0, 5.0]
    assert "nut" not in tomllib.loads(change(text, "nut.0", None))


@pytest.mark.parametrize(
    "path", ["string.7", "string.9.notes", "string.x.notes", "pluck.position.x", "title.x", "nut.1.q.z"]
)
def test_paths_that_lead_nowhere(path: str) -> None:
    with pytest.raises((KeyError, TypeError)):
        change(TEXT, path, 1.0)


def leaves(data: object, prefix: str = "") -> list[str]:
    if isinstance(data, dict):
        return [leaf for key, value in data.items() for leaf in leaves(value, f"{prefix}{key}.")]
    if isinstance(data, list) and data and isinstance(data[0], dict):
        return [leaf for index, value in enumerate(data) for leaf in leaves(value, f"{prefix}{index}.")]
    return [prefix[:-1]]


def at(data: object, path: str) -> object:
    for part in path.split("."):
        data = data[int(part)] if isinstance(data, list) else data[part]  # type: ignore[index]
    return data


@pytest.mark.parametrize("name", NAMES)
@settings(deadline=None, max_examples=10)
@given(data=st.data())
def test_any_number_anywhere(name: str, data: st.DataObject) -> None:
    """Whatever is set, in whatever order, is what is read; every comment is still there."""
    text = (preset_folder() / f"{name}.toml").read_text(encoding="utf-8")
    comments = [line for line in text.splitlines() if line.startswith("#")]
    values = {
        path: value for path in leaves(tomllib.loads(text)) if isinstance(value := at(tomllib.loads(text), path), float)
    }
    for path in data.draw(st.lists(st.sampled_from(sorted(values)), min_size=1, max_size=4)):
        value = data.draw(st.floats(-1e6, 1e6, allow_nan=False).map(lambda x: float(f"{x:.9g}")))
        text = change(text, path, value)
        assert at(tomllib.loads(text), path) == value
    assert [line for line in text.splitlines() if line.startswith("#")] == comments


@pytest.mark.parametrize(
    "text",
    [
        "a = 1\n\n[output] # c\nkind = 'x'\n",
        "a = 1\n\n[body] # c\ndirect_db = 1\n# d\n\n[output]\nkind = 'x' # e\n",
        "a = 1\n[body]\nresonance = [{q = 1}] # c\n[output]\nkind = 'x'\n",
    ],
)
def test_a_list_of_tables_within_a_table_at_the_top_has_tables_of_its_own(text: str) -> None:
    """One after the other as they are appended; comments and tables that were there stay."""
    for index in range(3):
        text = change(text, f"body.mode.{index}", {"q": float(index), "shape": [1.0, 0.5]})
    assert text.count("[[body.mode]]") == 3 and "# c" in text
    text = change(change(text, "body.mode.1", None), "body.mode.0.q", 7.0)
    data = tomllib.loads(text)
    assert data["body"]["mode"] == [{"q": 7.0, "shape": [1.0, 0.5]}, {"q": 2.0, "shape": [1.0, 0.5]}]
    assert data["output"] == {"kind": "x"} and data["a"] == 1
    text = change(change(text, "body.mode.1", None), "body.mode.0", None)
    assert "mode" not in tomllib.loads(text).get("body", {})
