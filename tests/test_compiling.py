"""What is compiled is said, and how much is to come; compiled kernels are kept whatever the disk does.

Most of it is tried on kernels that are compiled at once, as a module of the package, in processes of their own that have
Numba loaded before.
"""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.forkserver import Forked, compiler
from tests.patience import compiling_s, patience_s

ROOT = Path(__file__).resolve().parents[1]

KERNELS = """
from numba import cfunc, njit

@njit(cache=True)
def inner(x):
    return x + 1

@njit(inline="always")
def between(x):
    return inner(x)

@njit(cache=True)
def outer(x):
    return 2 * between(x)

@njit(cache=True)
def apart(x):
    return x - 1

def entry(x):
    return outer(x)
"""

PROGRAM = """
import importlib.util, json, os, sys, time
import synth
from synth.jit import compiling, kernel_cache

def made(name, path):
    spec = importlib.util.spec_from_file_location("synth." + name, path)
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module

kernels = made("kernels_to_try", {kernels!r})
"""


class Tried:
    """Runs programs on those kernels, with a cache of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.cache = folder / "cache"
        (folder / "kernels.py").write_text(KERNELS)
        self.environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
        self.environment |= {"XDG_CACHE_HOME": str(self.cache), "PYTHONPATH": str(ROOT), "TMPDIR": str(folder)}

    def start(self, text: str, **options: Any) -> Forked:
        program = PROGRAM.format(kernels=str(self.folder / "kernels.py")) + text
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        return compiler().start([], self.folder, module=None, before=program, env=self.environment, **pipes | options)

    def says(self, text: str) -> tuple[str, str]:
        done = self.start(text).done(compiling_s())
        assert done.returncode == 0, done.stderr
        return done.stdout, done.stderr

    @property
    def files(self) -> list[Path]:
        return sorted(path for path in self.cache.rglob("*.nb[ic]") if "kernels" in path.name)


@pytest.fixture
def tried(tmp_path: Path) -> Tried:
    return Tried(tmp_path)


COUNTED = """
seen = []
with compiling.listening(lambda: seen.append((compiling.progress().done, compiling.progress().total))):
    print({call})
now = compiling.progress()
print(json.dumps([seen, now and [now.done, now.total, now.share], compiling.busy()]))
"""


def test_how_much_is_to_come_is_known_from_the_start(tried: Tried) -> None:
    value, told = tried.says(COUNTED.format(call="kernels.outer(1)"))[0].splitlines()
    assert value == "4"
    # begun, begun, done, done; `between` is no kernel of its own, and `apart` is not called
    assert json.loads(told) == [[[0, 2], [0, 2], [1, 2], [2, 2]], [2, 2, 1.0], False]
    value, told = tried.says(COUNTED.format(call="kernels.outer(1)"))[0].splitlines()
    assert value == "4" and json.loads(told) == [[], None, False]
    # what is kept is not counted again
    (kept,) = (path for path in tried.files if "outer" in path.name and path.suffix == ".nbi")
    kept.unlink()
    _, told = tried.says(COUNTED.format(call="kernels.outer(1)"))[0].splitlines()
    assert json.loads(told)[1][:2] == [1, 1]


def test_functions_for_c_are_counted_too(tried: Tried) -> None:
    call = "kernels.cfunc('int64(int64)', cache=True)(kernels.entry).ctypes(1)"
    value, told = tried.says(COUNTED.format(call=call))[0].splitlines()
    assert value == "4" and json.loads(told)[1] == [3, 3, 1.0]


def test_what_is_not_needed_after_all_is_not_waited_for(tried: Tried) -> None:
    text = """
with compiling.expecting([kernels.outer.py_func, kernels.apart.py_func]):
    kernels.outer(1)
    before = compiling.progress()
    compiling.spares(kernels.apart.py_func)
now = compiling.progress()
print(before[:2], now[:2], compiling.busy())
"""
    assert tried.says(text)[0].splitlines() == ["(2, 3) (2, 2) False"]


def test_what_cannot_be_compiled_is_not_waited_for(tried: Tried) -> None:
    text = """
try:
    kernels.outer("x")
except Exception as error:
    print(type(error).__name__, compiling.busy())
print(kernels.outer(1), compiling.busy())
"""
    assert tried.says(text)[0].splitlines() == ["TypingError False", "4 False"]


SHOWN = """
from synth.cli import kernel_line
kernel_line.BRIEF_S = 0.0
with kernel_line.compiling_shown(quiet={quiet}):
    print(kernels.outer(1))
"""


def test_said_on_no_terminal(tried: Tried) -> None:
    assert tried.says(SHOWN.format(quiet=True)) == ("4\n", "")
    for path in tried.files:
        path.unlink()
    out, said = tried.says(SHOWN.format(quiet=False))
    begun, ended = said.splitlines()
    assert out == "4\n" and begun == "synth: compiling kernels, once on this machine"
    assert ended.startswith("synth: 2 kernels compiled in ")
    assert tried.says(SHOWN.format(quiet=False)) == ("4\n", "")  # the next time there is nothing to say


def on_a_terminal(tried: Tried, text: str) -> tuple[str, bytes]:
    """What a program writes on standard output, and on a terminal that is its standard error."""
    ours, theirs = pty.openpty()
    with tried.start(text, stderr=theirs) as process:
        os.close(theirs)
        shown = b""
        while True:
            try:
                piece = os.read(ours, 4096)
            except OSError:  # the other end has gone
                break
            if not piece:
                break
            shown += piece
        assert process.stdout is not None
        out = process.stdout.read()
    os.close(ours)
    return out, shown


def test_said_on_a_terminal(tried: Tried) -> None:
    out, shown = on_a_terminal(tried, SHOWN.format(quiet=False))
    lines = shown.decode().split("\r")
    assert out == "4\n" and lines[1].startswith("kernels, once on this machine: 0 of 2, ") and "\n" not in shown.decode()
    assert any(line.startswith("kernels, once on this machine: 1 of 2, ") for line in lines)
    assert lines[-2].strip() == "" and lines[-1] == ""  # nothing of it is left
    out, shown = on_a_terminal(tried, SHOWN.format(quiet=False))
    assert (out, shown) == ("4\n", b"")


@pytest.mark.parametrize("trouble", ["no folder", "full"])
def test_a_cache_that_cannot_be_written(tried: Tried, trouble: str) -> None:
    """It is said in a line, and everything goes on."""
    text = SHOWN.format(quiet=False) + "print(os.environ['NUMBA_CACHE_DIR'])"
    if trouble == "no folder":
        tried.cache.write_text("a file")
    else:  # no file may hold a byte
        text = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\n" + text
    for _ in range(2):
        out, said = tried.says(text)
        value, folder = out.splitlines()
        assert value == "4"
        assert said.count("cannot be kept and are compiled again at every start") == 1 and str(tried.cache) in said
        assert len(said.splitlines()) == 3 and "2 kernels compiled" in said
        # a folder for this process only goes with it
        assert Path(folder).exists() == (trouble == "full")
    assert not list(tried.cache.rglob("*.tmp.*"))


@pytest.mark.parametrize("length", [0, 1, 40, -1])
def test_files_that_were_cut_short(tried: Tried, length: int) -> None:
    tried.says(COUNTED.format(call="kernels.outer(1)"))
    for ending in (".nbi", ".nbc"):
        for path in tried.files:
            if path.suffix == ending:
                path.write_bytes(path.read_bytes()[:length])
        value, told = tried.says(COUNTED.format(call="kernels.outer(1)"))[0].splitlines()
        assert value == "4" and json.loads(told)[1] is not None  # compiled anew
        value, told = tried.says(COUNTED.format(call="kernels.outer(1)"))[0].splitlines()
        assert value == "4" and json.loads(told)[1] is None  # and kept


def test_two_processes_that_keep_different_signatures_at_once(tried: Tried) -> None:
    """Without a lock both would number theirs 1, and one would find the other's machine code under its signature. Claims are
    left out here: with them the second would wait for what the first compiles."""
    text = """
from pathlib import Path
import numba
from numba.core.caching import IndexDataCacheFile

writing, load = kernel_cache._writing, IndexDataCacheFile._load_index

def together(folder):  # all come to the writing at one time…
    Path({place!r}, repr({value})).touch()
    while len(list(Path({place!r}).iterdir())) < 3:
        time.sleep(0.01)
    IndexDataCacheFile._load_index = slowly
    return writing(folder)

def slowly(self):  # …and take their time between reading the index and writing it
    found = load(self)
    time.sleep(1.0)
    return found

kernel_cache.kernel_claims.wait_for = lambda name: False
kernel_cache._writing = together
kernel_cache.PATIENCE_S = 600.0  # however slow the machine, each waits for its turn
print(kernels.apart({value}))
"""
    place = tried.folder / "place"
    place.mkdir()
    running = [tried.start(text.format(value=value, place=str(place))) for value in ("1", "1.5", "1j")]
    assert [process.done(compiling_s()).stdout.strip() for process in running] == ["0", "0.5", "(-1+1j)"]
    found, told = tried.says(COUNTED.format(call="(kernels.apart(1), kernels.apart(1.5), kernels.apart(1j))"))[
        0
    ].splitlines()
    assert found == "(0, 0.5, (-1+1j))" and json.loads(told)[1] is None
    assert sum("apart" in path.name and path.suffix == ".nbc" for path in tried.files) == 3


INTERRUPTED = """
import ctypes
from numba.core import dispatcher
from synth.cli import main, presets

def for_ever(*_):
    lock = ctypes.create_string_buffer(64)  # a mutex of the C library, locked twice: no signal is heard in there
    print("compiling", flush=True)
    for _ in range(2):
        ctypes.CDLL(None).pthread_mutex_lock(lock)

dispatcher._FunctionCompiler.compile = for_ever
presets._list_presets = lambda options: kernels.outer(1)
sys.argv[1:] = ["presets", "list"]
sys.exit(main())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="made of a mutex of Linux's C library")
@pytest.mark.parametrize(("sign", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted_while_the_compiler_hears_nothing(tried: Tried, sign: signal.Signals, code: int) -> None:
    with tried.start(INTERRUPTED) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "compiling\n"
        process.send_signal(sign)
        try:
            _, said = process.communicate(timeout=patience_s())
        except subprocess.TimeoutExpired:
            process.kill()
            raise
    assert process.returncode == code and "Traceback" not in said


ENTRIES = """
import contextlib, io, json, sys
import synth
from synth.jit import compiling
from numba.core.caching import Cache

names, load = set(), Cache.load_overload
def named(self, *arguments):
    names.add(self._py_func)
    return load(self, *arguments)
Cache.load_overload = named
from synth.cli import main
with contextlib.redirect_stdout(io.StringIO()):
    assert main({arguments!r}) == 0
begun = next(each for each in names if each.__name__ == "step_coefficients")
kept, compiling.is_kept = compiling.is_kept, lambda function: False
entries = compiling._expected(begun)
for entry in entries:
    compiling._want(entry)
said = lambda functions: sorted(each.__module__ + ":" + each.__qualname__ for each in functions)
print(json.dumps([said(set(entries) - names), said(names - set(compiling._wanted)), len(compiling._wanted)]))
"""


@pytest.mark.parametrize(
    "arguments",
    [
        ["render", str(ROOT / "presets" / "demos" / "drone.mid"), "-p", "jawari-harp", "--end", "1.5", "--quiet", "-o"],
        ["render", str(ROOT / "presets" / "demos" / "bassline.mid"), "-p", "fretted-bass", "--end", "0.2", "--quiet", "-o"],
        ["simulate", "tanpura", "--duration", "0.001", "--modes", "20", "--quiet", "-o"],
    ],
)
def test_the_kernels_that_python_calls_are_those_it_is_known_of(tmp_path: Path, arguments: list[str]) -> None:
    output = str(tmp_path / ("out.npz" if arguments[0] == "simulate" else "out.wav"))
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    program = ENTRIES.format(arguments=[*arguments, output])
    for _ in range(2):  # what the first has to compile it does not load
        done = compiler().start([], tmp_path, module=None, before=program, **pipes).done(compiling_s())
        assert done.returncode == 0, done.stderr
    unused, unknown, total = json.loads(done.stdout)
    assert (unused, unknown) == ([], []) and total > 30
