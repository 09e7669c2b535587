"""The reference has every command, option, key, parameter, controller and public name, each with a meaning.

What there is to be is found here by other ways than the pages' own: the parser's actions, the JSON schemas, `synth.__all__`,
the imports on the pages, the source of what obeys controllers.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import posixpath
import re
import shlex
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import synth
from synth.author.views import words as page_words
from synth.cli import command_parser
from synth.drone import tanpura_keys
from synth.engine.parameters import INDEX_OF
from synth.engine.voices import control_changes
from synth.host import control_words
from synth.instrument.preset import Damping, Preset, list_presets
from synth.live import playkeys
from synth.physics.string import String
from synth.research.case import Case
from synth.research.coupled.coupled_case import CoupledCase
from synth.solver.schemes import SCHEMES

ROOT = Path(__file__).resolve().parents[2]
sys.path.append(str(ROOT / "tools"))

import reference_pages  # noqa: E402
from reference_pages import case_keys, command_line, preset_keys, python_api  # noqa: E402
from reference_pages.fields import number  # noqa: E402
from reference_pages.markdown import docstring, plain  # noqa: E402

#: keys that only a body's filter has, which no case takes
NO_KEYS_OF_CASES = re.compile(r"body\.body\.(resonance|direct_db).*")


@pytest.fixture(scope="module")
def pages() -> dict[str, str]:
    return reference_pages.pages()


def section(page: str, title: str) -> str:
    """What stands under a heading; "" where there is none."""
    found = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)
    return found[1] if found else ""


def rows(text: str) -> dict[str, str]:
    """First cell → last cell of every row of the tables in a text; a first cell with an anchor by that."""
    out = {}
    for line in text.splitlines():
        cells = re.split(r"(?<!\\)\|", line)[1:-1]
        if len(cells) > 1 and not set(cells[0]) <= set(" -"):
            place = re.search(r'<a id="([^"]+)">', cells[0])
            out[place[1] if place else cells[0].strip(" `")] = cells[-1].strip()
    return out


def faults(text: str, expected: set[str]) -> list[str]:
    """What is expected of the tables in a text, and is not there or has no meaning."""
    found = rows(text)
    return sorted(name for name in expected if len(found.get(name, "")) < 5 or " " not in found[name])


def options_of(parser: argparse.ArgumentParser, name: str) -> Iterator[tuple[str, set[str]]]:
    """(command, names of its options and arguments) of a parser and all below it."""
    own = set()
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word, inner in action.choices.items():
                yield from options_of(inner, f"{name} {word}")
        elif not isinstance(action, argparse._HelpAction):
            own.add(", ".join(action.option_strings) or str(action.metavar or action.dest))
    yield name, own


def test_every_command_and_option(pages: dict[str, str]) -> None:
    commands = dict(options_of(command_parser(), "synth"))
    assert {"synth render", "synth presets check", "synth body fit"} < set(commands)
    for name, options in commands.items():
        text = section(pages["command-line.md"], name)
        assert len(text.partition("```")[0].strip()) > 8, f"{name} is not described"
        assert faults(text, options) == [], name


def paths(schema: dict[str, Any], at: dict[str, Any], place: str) -> Iterator[str]:
    """Paths of all keys in a JSON schema."""
    for key, inner in at.get("properties", {}).items():
        path = f"{place.partition(':')[0]}.{key}" if place else key
        yield f"{place}.{key}" if place else key
        kinds = inner.get("discriminator", {}).get("mapping")
        if kinds:
            for kind, where in kinds.items():
                yield from paths(schema, schema["$defs"][where.rpartition("/")[2]], f"{path}:{kind}")
            continue
        for where in dict.fromkeys(re.findall(r"#/\$defs/(\w+)", str(inner))):
            named = ".NAME" if "additionalProperties" in inner or "patternProperties" in inner else ""
            yield from paths(schema, schema["$defs"][where], path + named)


def keys_of(kind: type[Any]) -> set[str]:
    schema = kind.model_json_schema()
    return set(paths(schema, schema, ""))


def test_every_key_of_a_preset(pages: dict[str, str]) -> None:
    keys = keys_of(Preset)
    assert {"obstacle:bridge.jiva_um", "articulations.NAME.touch.lift_ms", "body.mode.shape", "effect.kind"} < keys
    assert faults(pages["preset-keys.md"], keys) == []


@pytest.mark.parametrize(("kind", "root"), [(Case, "one"), (CoupledCase, "body")])
def test_every_key_of_a_case(pages: dict[str, str], kind: type[Any], root: str) -> None:
    keys = {f"{root}.{key}" for key in keys_of(kind)}
    assert {f"{root}.{key}" for key in ("string.nut.q", "run.ledger", "scheme.tail")} < keys
    expected = {key for key in keys if not NO_KEYS_OF_CASES.fullmatch(key)}
    assert faults(pages["case-keys.md"], expected) == []


def test_every_scheme(pages: dict[str, str]) -> None:
    assert faults(section(pages["case-keys.md"], "Schemes"), set(SCHEMES)) == []


def test_every_live_parameter_and_controller(pages: dict[str, str]) -> None:
    assert faults(pages["controls.md"], set(INDEX_OF)) == []
    obeyed = set()
    for node in ast.walk(ast.parse(inspect.getsource(control_changes.control.py_func))):
        if isinstance(node, ast.Compare) and getattr(node.left, "id", "") == "controller":
            obeyed |= {each.value for each in node.comparators if isinstance(each, ast.Constant)}
    assert {1, 64, 123} < obeyed
    assert faults(section(pages["controls.md"], "Controllers"), {f"cc-{number}" for number in obeyed - {128}}) == []


def test_every_key_of_a_terminal(pages: dict[str, str]) -> None:
    """What `?` shows, its spaces being those of a terminal's line."""
    shown = " ".join(section(pages["controls.md"], "Keys of a terminal").split())
    for keys in (playkeys.keys_of(instrument=True, song=True), tanpura_keys.keys_of(4)):
        assert len(keys.bindings) > 8
        for each in keys.bindings:
            assert f"| `{each.shown}` | {plain(each.does)} |" in shown, each.action


def numbers_in(schema: Any) -> set[float]:
    """Default and limits of a key in a JSON schema, zero left out; of a choice of kinds those of all."""
    found: set[float] = set()
    if isinstance(schema, dict):
        for name, value in schema.items():
            if name in ("default", "minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum") and value:
                found |= {float(value)} if isinstance(value, int | float) and value is not True else set()
            elif name in ("anyOf", "oneOf", "items"):
                found |= numbers_in(value)
    for each in schema if isinstance(schema, list) else ():
        found |= numbers_in(each)
    return found


UNITS = {
    "_mm": "mm", "_um": "µm", "_hz": "Hz", "_cents": "cents", "_db": "dB", "_s": "s", "_ms": "ms", "_m": "m", "_kg": "kg",
    "_n": "N", "_kg_m": "kg/m", "_n_m2": "N", "_g_m": "g/m", "_kg_m3": "kg/m³", "_gpa": "GPa", "_g": "g", "_m_s": "m/s",
    "_n_mm": "N/mm", "_n_mm2": "N/mm²", "_n_s_m": "N s/m", "_percent": "%", "_deg": "°", "_n_m": "N/m",
}  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "page"), [(Preset, "preset-keys.md"), (Case, "case-keys.md"), (CoupledCase, "case-keys.md")]
)
def test_rows_have_default_range_and_unit(pages: dict[str, str], kind: type[Any], page: str) -> None:
    schema = kind.model_json_schema()
    lines = [line for line in pages[page].splitlines() if line.startswith("| <a id=")]
    looked_at = 0
    tables = [each for name, each in schema["$defs"].items() if name not in ("Body", "BodyMode") or kind is Preset]
    for table in (schema, *tables):
        for key, inner in table.get("properties", {}).items():
            own = [line for line in lines if f"`{key}` |" in line]
            wanted = {number(value) for value in numbers_in(inner)}
            assert any(wanted <= set(re.findall(r"[^\s`|,]+", line)) for line in own), (key, wanted)
            suffix = max((each for each in UNITS if key.endswith(each)), key=len, default="")
            if suffix and inner.get("type") != "array":
                assert all(re.search(rf"\| {re.escape(UNITS[suffix])}[^|]*\|", line) for line in own), key
            looked_at += bool(wanted)
    assert looked_at > 10


def test_limits_of_a_string_are_those_that_judge_it(pages: dict[str, str]) -> None:
    """A string of a case a little within the range that the page gives is taken, and one beyond it refused."""
    row = next(line for line in pages["case-keys.md"].splitlines() if '<a id="one.string.tension_n">' in line)
    low, high = (float(end.replace("−", "-")) for end in re.search(r"\| (\S+) to (\S+) \|", row).groups())  # type: ignore[union-attr]
    other = {"length_m": 1.0, "linear_density_kg_m": 1e-3, "diameter_m": 1e-3, "bending_stiffness_n_m2": 0.0}
    for within in (0.9 * high, 1.1 * low):
        assert String(tension_n=within, **other).tension_n == within
    for beyond in (1.1 * high, 0.9 * low):
        with pytest.raises(ValueError, match="tension_n"):
            String(tension_n=beyond, **other)


def entries(page: str) -> dict[str, str]:
    """Anchor → what is said of every name on the page of Python, without its signature."""
    out = {}
    for found in re.finditer(r'^###+ <a id="([^"]+)"></a>`[^`]+`\n(.*?)(?=^##|\Z)', page, re.MULTILINE | re.DOTALL):
        text = re.sub(r"```python\n.*?```", "", found[2], flags=re.DOTALL)
        out[found[1]] = re.sub(r"^From `.*$", "", text, flags=re.MULTILINE).strip()
    return out


def imported() -> set[tuple[str, str]]:
    """(module, name) of everything of this package that Python on a page imports."""
    found = set()
    for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]:
        for block in re.findall(r"^```python[^\n]*\n(.*?)^```", path.read_text("utf-8"), re.MULTILINE | re.DOTALL):
            for node in ast.walk(ast.parse(block)):
                if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] == "synth":
                    found |= {(node.module or "", each.name) for each in node.names}
    return found


def test_every_public_name(pages: dict[str, str]) -> None:
    said = entries(pages["python.md"])
    for name in synth.__all__:
        assert len(said.get(f"synth.{name}", "")) > 8, name
    engine = {name for name, thing in vars(synth.Engine).items() if not name.startswith("_") and callable(thing)}
    assert {"prepare", "process", "report"} < engine
    for name in engine:
        assert len(said.get(f"synth.Engine.{name}", "")) > 8, name


def test_every_name_that_a_page_imports(pages: dict[str, str]) -> None:
    said = entries(pages["python.md"])
    names = imported()
    assert ("synth.solver.lcp", "pivot") in names
    for module, name in names:
        assert said.get(f"{module}.{name}") or (name in synth.__all__ and said.get(f"synth.{name}")), f"{module}.{name}"


def test_nothing_is_listed_twice() -> None:
    """Not by two paths, either: what `synth` has stands there alone."""
    listed = [(each, getattr(import_module(module), each)) for _, module, names in python_api.public() for each in names]
    things = Counter(id(thing) for _, thing in listed if inspect.isclass(thing) or inspect.isroutine(thing))
    assert len(things) > 60
    assert [name for name, thing in listed if things[id(thing)] > 1] == []


def test_sections_of_a_docstring_are_lists_and_examples() -> None:
    text = """Halves.

    Parameters
    ----------
    a, b : float
        What is halved,
        and what is not.
    **more
        Ignored.

    Returns
    -------
    (n,) array
        Of halves [m].

    Examples
    --------
    >>> 1 / 2
    0.5
    """
    assert docstring(text).split("\n\n") == [
        "Halves.",
        "**Parameters**",
        "- `a`, `b` (float): What is halved, and what is not.\n- `**more`: Ignored.",
        "**Returns**",
        "- *(n,) array*: Of halves \\[m\\].",
        "**Examples**",
        "```pycon\n>>> 1 / 2\n0.5\n```\n",
    ]


def test_what_is_missing_is_noticed(pages: dict[str, str]) -> None:
    render = section(pages["command-line.md"], "synth render")
    without = "\n".join(line for line in render.splitlines() if "`--stems`" not in line)
    assert faults(without, {"--stems", "--tail"}) == ["--stems"]
    emptied = re.sub(r"(\| `--tail` .*\| )[^|]+\|$", r"\1 |", render, flags=re.MULTILINE)
    assert emptied != render and faults(emptied, {"--stems", "--tail"}) == ["--tail"]


def test_a_key_without_words_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(page_words.WORDS[Damping], "release_s")
    with pytest.raises(LookupError, match=r"Damping\.release_s"):
        preset_keys.page()


def test_a_key_of_a_case_without_words_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(case_keys.MEANINGS[Case], "bend")
    with pytest.raises(LookupError, match=r"Case\.bend"):
        case_keys.page()


def test_an_option_without_help_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    parser = command_parser()
    parser.add_argument("--silly")
    monkeypatch.setattr(command_line, "command_parser", lambda: parser)
    with pytest.raises(LookupError, match="--silly"):
        command_line.page()


def test_a_parameter_without_words_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(control_words.PARAMETERS, "pluck.width")
    with pytest.raises(LookupError, match=r"pluck\.width"):
        reference_pages.controls.page()


def test_a_name_without_a_docstring_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(synth.render, "__doc__", None)
    with pytest.raises(LookupError, match=r"synth\.render"):
        python_api.page()


def test_links_of_the_pages_lead_somewhere(pages: dict[str, str]) -> None:
    for name, text in pages.items():
        for target, place in re.findall(r"\]\(([\w./-]*)#?([\w./:-]*)\)", text):
            other = pages.get(posixpath.normpath(posixpath.join(posixpath.dirname(name), target))) if target else text
            if other is None:
                assert (ROOT / "docs" / "reference" / name).parent.joinpath(target).resolve().is_file(), (name, target)
                continue
            slugs = {line.lstrip("# ").replace(" ", "-") for line in other.splitlines() if line.startswith("## ")}
            assert not place or f'<a id="{place}">' in other or place in slugs, (name, target, place)


@pytest.mark.slow
def test_the_tool_writes_the_pages_and_leaves_what_has_not_changed(tmp_path: Path, pages: dict[str, str]) -> None:
    folder = tmp_path / "made" / "reference"
    tool = [sys.executable, str(ROOT / "tools" / "reference"), str(folder)]
    assert subprocess.run(tool, capture_output=True, check=True).stdout.count(b"\n") == len(pages)
    made = {path.relative_to(folder).as_posix(): path.read_text("utf-8") for path in folder.rglob("*.md")}
    assert made == pages
    (folder / "instruments" / "gone.md").write_text("of a preset that there is no more")
    assert subprocess.run(tool, capture_output=True, check=True).stdout == b"\n"
    assert not (folder / "instruments" / "gone.md").exists()


def test_every_preset_has_a_page_that_asks_for_it_and_for_its_sound(pages: dict[str, str]) -> None:
    for preset in list_presets():
        page = pages[f"instruments/{preset.name}.md"]
        assert f"<!-- instrument: {preset.name} -->" in page and f"<!-- player: {preset.name} -->" in page
        assert (f"<!-- instrument: {preset.name}-drone -->" in page) == (preset.family == "tanpura")
        for what in ("range", "strings", "what collides"):
            assert f"- **{what}**: " in page, (preset.name, what)
        assert f"({preset.name}.md)" in pages["instruments/index.md"]


def test_the_commands_of_a_preset_s_page_are_commands(pages: dict[str, str]) -> None:
    for command in re.findall(r"^synth .*$", pages["instruments/tanpura.md"], re.MULTILINE):
        command_parser().parse_args(shlex.split(command)[1:])
