"""Imports go one way only: _version, signals, spelling, units, panning, files → native → jit → midi → physics, solver, dsp →
instrument → engine, research → host, fit → study → live → drone, author → plugin, dataset → cli.
"""

import ast
import graphlib
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "synth"

# Floors from the ground up; a room sees the floors below it and itself.
FLOORS = (
    {"_version", "signals", "spelling", "units", "panning", "files"},
    {"extensions"},
    {"native"},
    {"jit"},
    {"midi"},
    {"physics", "solver", "dsp"},
    {"instrument"},
    {"engine", "research"},
    {"host", "fit"},
    {"study"},
    {"setup"},
    {"live"},
    {"drone", "author"},
    {"plugin", "dataset"},
    {"cli"},
    {"__main__"},
)
FLOOR_OF = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
FILES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def rooms_imported(source: str, path: Path) -> set[str]:
    """First names below `synth` of every import in the source, relative and function-level ones included."""
    package = ("synth", *path.relative_to(PACKAGE).parent.parts)
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = list(package[: len(package) - node.level + 1]) if node.level else []
            base += node.module.split(".") if node.module else []
            names = [".".join([*base, alias.name]) for alias in node.names]
        else:
            continue
        found |= {name.split(".")[1] for name in names if name.startswith("synth.")}
    return found


def allowed(room: str, other: str) -> bool:
    if other == room:
        return True
    mine, theirs = FLOOR_OF[room], FLOOR_OF[other]
    return theirs < mine


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_down(path: Path) -> None:
    room = room_of(path)
    assert room in FLOOR_OF, f"{room} has no floor yet: give it one in FLOORS"
    for other in rooms_imported(path.read_text(encoding="utf-8"), path):
        assert other in FLOOR_OF, f"{other} has no floor"
        assert allowed(room, other), f"{room} must not import {other}"


def modules_imported(path: Path) -> set[Path]:
    """Files of the package that a file of it imports, function-level imports included."""
    found: set[Path] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            continue
        found |= {PACKAGE.parent.joinpath(*name.split(".")).with_suffix(".py") for name in names}
    return found & set(FILES)


def test_no_module_imports_itself_through_others() -> None:
    graph = {path: modules_imported(path) for path in FILES}
    physics = PACKAGE / "physics"
    assert graph[physics / "modes.py"] == {physics / "string.py", physics / "uneven_mass.py"}
    assert len(list(graphlib.TopologicalSorter(graph).static_order())) == len(FILES)


def test_the_voice_policy_knows_of_no_string() -> None:
    """Of the engine it imports the layout of what it sees, and of the solver nothing: so it runs without a string."""
    for path in (PACKAGE / "engine" / "voices").glob("*.py"):
        outside = {other for other in modules_imported(path) if other.parent != path.parent}
        rooms = {room_of(other) for other in outside if other != PACKAGE / "engine" / "layout.py"}
        assert rooms <= {"midi", "native", "jit"}, path.name


def test_no_module_of_the_page_imports_itself_through_others() -> None:
    named = re.compile(r'^(?:import|export)\b[^;]*?from "\./([\w-]+\.js)";', re.MULTILINE)
    files = sorted((PACKAGE / "author" / "page").glob("*.js"))
    graph = {path.name: set(named.findall(path.read_text(encoding="utf-8"))) for path in files}
    assert "field.js" in graph["controls.js"] and "entry.js" in graph["field.js"]
    assert set(graphlib.TopologicalSorter(graph).static_order()) == {path.name for path in files}


def test_the_package_itself_loads_nothing_heavy() -> None:
    """synth/__init__.py may offer names, but not load what they stand for."""
    program = "import sys, synth; print(*{'numba', 'numpy', 'scipy', 'pydantic'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], cwd=PACKAGE.parent, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_reading_presets_does_not_load_numba() -> None:
    """Most commands only read them, and numba takes longer than all the rest."""
    program = "import sys, synth.instrument.preset; print('numba' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], cwd=PACKAGE.parent, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


@pytest.mark.parametrize(
    ("path", "source", "found"),
    [
        ("solver/x.py", "from ..physics import string", {"physics"}),
        ("solver/x.py", "from synth import physics", {"physics"}),
        ("solver/x.py", "from .laws import EXACT_HOLD", {"solver"}),
        ("units.py", "def f():\n    import synth.midi.song", {"midi"}),
        ("host/x.py", "from . import midi\nimport numpy", {"host"}),
    ],
)
def test_the_check_sees_every_form_of_import(path: str, source: str, found: set[str]) -> None:
    assert rooms_imported(source, PACKAGE / path) == found


#: names that several rooms have for the same thing of their own: commands and what does their work, errors, reports …
SHARED_NAMES = {"__init__", "errors", "parameters", "plan", "render", "report", "warmup"}


def test_modules_are_named_apart() -> None:
    names = Counter(path.stem for path in FILES)
    assert {name for name, count in names.items() if count > 1} == SHARED_NAMES


def test_neighbours_do_not_know_each_other() -> None:
    assert not allowed("solver", "physics")
    assert not allowed("dsp", "instrument")
    assert allowed("research", "instrument") and not allowed("research", "engine") and not allowed("engine", "research")


def test_the_files_that_come_first_are_there():
    from tests.conftest import LONGEST

    assert [name for name in LONGEST if not (PACKAGE.parent / name).is_file()] == []
