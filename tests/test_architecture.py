"""Imports go one way only: _version, signals, spelling, units, panning, files, workers → native → jit → midi → physics,
solver, dsp → instrument → engine, research → host, fit → study → live → drone, author, dataset → plugin → cli.
"""

import ast
import functools
import graphlib
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "synth"

# Floors from the ground up; a room sees the floors below it and itself.
FLOORS = (
    {"_version", "signals", "spelling", "units", "panning", "files", "workers"},
    {"extensions"},
    {"native"},
    {"jit"},
    {"midi"},
    {"physics", "solver", "dsp"},
    {"instrument"},
    {"engine", "research"},
    {"host"},
    {"fit"},
    {"study"},
    {"setup"},
    {"live"},
    {"drone", "author", "dataset"},
    {"plugin"},
    {"cli"},
    {"__main__"},
)
FLOOR_OF = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
FILES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


@functools.cache
def parsed(source: str) -> ast.Module:
    """A source's tree, made once for all tests of this module that look at it."""
    return ast.parse(source)


@pytest.fixture(scope="module", autouse=True)
def forgotten() -> Iterator[None]:
    """Trees take memory, which the files behind this one need."""
    yield
    parsed.cache_clear()


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).with_suffix("").parts[0]


def rooms_imported(source: str, path: Path) -> set[str]:
    """First names below `synth` of every import in the source, relative and function-level ones included."""
    package = ("synth", *path.relative_to(PACKAGE).parent.parts)
    found: set[str] = set()
    for node in ast.walk(parsed(source)):
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


def test_imports_go_down() -> None:
    wrong = []
    for path in FILES:
        room = room_of(path)
        assert room in FLOOR_OF, f"{room} has no floor yet: give it one in FLOORS"
        for other in rooms_imported(path.read_text(encoding="utf-8"), path):
            assert other in FLOOR_OF, f"{other} has no floor"
            if not allowed(room, other):
                wrong.append(f"{path.relative_to(PACKAGE)} must not import {other}")
    assert wrong == []


def modules_imported(path: Path) -> set[Path]:
    """Files of the package that a file of it imports, function-level imports included."""
    found: set[Path] = set()
    for node in ast.walk(parsed(path.read_text(encoding="utf-8"))):
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


#: names that two public classes have, each
SHARED_CLASSES = {
    "Body", "BodyMode", "StringTable",
}  # fmt: skip


def test_classes_are_named_apart() -> None:
    names: Counter[str] = Counter()
    for path in FILES:
        names.update(node.name for node in parsed(path.read_text(encoding="utf-8")).body if isinstance(node, ast.ClassDef))
    twice = {name: count for name, count in names.items() if count > 1 and not name.startswith("_")}
    assert twice == dict.fromkeys(SHARED_CLASSES, 2)


def test_neighbours_do_not_know_each_other() -> None:
    assert not allowed("solver", "physics")
    assert not allowed("dsp", "instrument")
    assert allowed("research", "instrument") and not allowed("research", "engine") and not allowed("engine", "research")


def test_the_files_that_come_first_are_there():
    from tests.conftest import LONGEST

    assert [name for name in LONGEST if not (PACKAGE.parent / name).is_file()] == []


#: of an engine: its tables, and what its threads share
INSIDE_AN_ENGINE = {"_core", "_voices", "_shared"}
TOOLS = sorted((PACKAGE.parent / "tools").rglob("*.py"))


def private_names_imported(source: str, path: Path) -> list[str]:
    """Private names of other modules of the package that a source imports, or reads as attributes of an imported module."""
    package = ("synth", *path.relative_to(PACKAGE).parent.parts) if path.is_relative_to(PACKAGE) else ()
    modules: dict[str, str] = {}
    found: list[str] = []
    tree = parsed(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            modules |= {alias.asname or alias.name: alias.name for alias in node.names if alias.name.startswith("synth.")}
        elif isinstance(node, ast.ImportFrom):
            base = [*package[: len(package) - node.level + 1]] if node.level else []
            base += node.module.split(".") if node.module else []
            if base[:1] != ["synth"]:
                continue
            for alias in node.names:
                name = ".".join([*base, alias.name])
                if PACKAGE.parent.joinpath(*base, f"{alias.name}.py").is_file():
                    modules[alias.asname or alias.name] = name
                elif re.match("_[^_]", alias.name):
                    found.append(name)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and re.match("_[^_]", node.attr) and ast.unparse(node.value) in modules:
            found.append(f"{modules[ast.unparse(node.value)]}.{node.attr}")
    return found


def engine_insides_read(source: str) -> list[str]:
    """Attributes of INSIDE_AN_ENGINE in a source, but for those of an object's own whose class inherits nothing."""
    tree = parsed(source)
    own: set[ast.AST] = set()
    for kind in ast.walk(tree):
        if isinstance(kind, ast.ClassDef) and not kind.bases:
            own |= {node for node in ast.walk(kind) if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "self"}
    found = (node for node in ast.walk(tree) if isinstance(node, ast.Attribute) and node.attr in INSIDE_AN_ENGINE)
    return [ast.unparse(node) for node in found if node not in own]


def crowded(source: str, most: int = 12) -> list[str]:
    """Functions of more than so many parameters, `self` and `cls` left out."""
    found = []
    for node in ast.walk(parsed(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            names = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
            if len(names) - (names[:1] in (["self"], ["cls"])) > most:
                found.append(node.name)
    return found


def test_functions_have_at_most_twelve_parameters() -> None:
    found = {path.relative_to(PACKAGE.parent): crowded(path.read_text(encoding="utf-8")) for path in (*FILES, *TOOLS)}
    assert {path: names for path, names in found.items() if names} == {}


def test_the_check_counts_parameters() -> None:
    source = "class A:\n    def f(self, a, b, *, c): ...\ndef g(a, b, /, c, *, d): ...\nasync def h(a, b, c, d, *rest): ..."
    assert crowded(source, 3) == ["g", "h"]
    assert crowded(source, 2) == ["g", "h", "f"]


#: records that may have more than sixteen fields: those that are a table of a file's format
FILE_TABLES = {"StringTable", "Preset", "Articulation", "Pluck"}


def large_records(source: str, most: int = 16) -> list[str]:
    """Classes that declare more than so many fields; those that they inherit count where they are declared."""
    return [
        node.name
        for node in ast.walk(parsed(source))
        if isinstance(node, ast.ClassDef) and sum(isinstance(each, ast.AnnAssign) for each in node.body) > most
    ]


def test_records_have_at_most_sixteen_fields() -> None:
    assert {name for path in FILES for name in large_records(path.read_text(encoding="utf-8"))} == FILE_TABLES


def test_the_check_counts_fields() -> None:
    source = "class A(NamedTuple):\n    a: int\n    b: int = 1\n    C = 2\nclass B(A):\n    c: int\n    def f(self): ..."
    assert large_records(source, 1) == ["A"]
    assert large_records(source, 0) == ["A", "B"]


def test_private_names_stay_in_their_module() -> None:
    found = {}
    for path in (*FILES, *TOOLS):
        source = path.read_text(encoding="utf-8")
        found[path.relative_to(PACKAGE.parent)] = private_names_imported(source, path)
        if not path.is_relative_to(PACKAGE / "engine"):
            assert engine_insides_read(source) == [], f"{path}: use Engine.observe or Engine.memory"
    assert {path: names for path, names in found.items() if names} == {}


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("from synth.engine.tasks import work_on, _is_one_string", ["synth.engine.tasks._is_one_string"]),
        ("def f():\n    from .decks import _free", ["synth.live.decks._free"]),
        ("from synth.engine import team\nteam._attend(1)", ["synth.engine.team._attend"]),
        ("import synth.engine.team\nsynth.engine.team._attend(1)", ["synth.engine.team._attend"]),
        ("from synth.engine import team as other\nother.LEFT, other._attend", ["synth.engine.team._attend"]),
        ("import os\nfrom numba.core import _own\nfrom synth import _version\nos._exit(0), self._own", []),
    ],
)
def test_the_check_sees_private_names(source: str, found: list[str]) -> None:
    assert private_names_imported(source, PACKAGE / "live" / "x.py") == found


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("class Taped(Engine):\n    def prepare(self):\n        self._core = self.core", ["self._core"]),
        ("class Voices:\n    def add(self):\n        self._voices.append(1)", []),
        ("class Reader:\n    def read(self, engine):\n        return engine._shared.task", ["engine._shared"]),
        ("def read(engine):\n    return engine._core", ["engine._core"]),
    ],
)
def test_the_check_sees_the_insides_of_an_engine(source: str, found: list[str]) -> None:
    assert engine_insides_read(source) == found
