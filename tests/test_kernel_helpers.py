"""Kernels that several processes compile: all of them are there in the end, whatever becomes of the helpers, and no process
is left. Tried on kernels that are compiled at once, with a cache of their own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from synth.jit import kernel_claims, kernel_helpers
from tests.forkserver import Forked, compiler, ended
from tests.patience import compiling_s, patience_s, until

ROOT = Path(__file__).resolve().parents[1]
NAMES = ("first", "second", "third", "fourth")

KERNELS = "from numba import njit\n\n@njit(cache=True)\ndef inner(x):\n    return x + 1\n\n" + "".join(
    f"@njit(cache=True)\ndef {name}(x):\n    return {number} * inner(x)\n\n" for number, name in enumerate(NAMES, 1)
)

LISTED = """
import importlib.util, os, sys, time
from pathlib import Path
import synth
from numba import types

here = Path(__file__).parent
spec = importlib.util.spec_from_file_location("synth.kernels_to_try", here / "kernels.py")
module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(module)
helper = sys.argv[:1] == ["-c"] and len(sys.argv) == 3
if helper:
    (here / f"helper-{os.getpid()}").touch()

def kernels():
    return [(getattr(module, name), (types.int64,)) for name in ("first", "second", "third", "fourth")]

def hang(*_):
    (here / "hangs").touch()
    while True:
        time.sleep(1.0)

if helper and (here / "to-hang").exists():
    from numba.core import dispatcher
    dispatcher._FunctionCompiler.compile = hang
"""

PROGRAM = """
import json, os, signal, sys, time
from pathlib import Path
import synth
from synth.jit import compiling, kernel_cache, kernel_helpers
import listed

here, names = Path(listed.__file__).parent, ("first", "second", "third", "fourth")
may_run, kernel_helpers._may_run = kernel_helpers._may_run, lambda: 1

def until(condition):
    while not condition():
        time.sleep(0.01)

def kept():
    return all(compiling.is_kept(getattr(listed.module, name).py_func) for name in names)

def compiled():
    kernel_helpers.compile_all("listed:kernels")
    counted, made = count(), len(compiling._made)
    values = [getattr(listed.module, name)(1) for name in names]
    print(json.dumps([values, counted, made, count(), compiling.busy()]))

def count():
    now = compiling.progress()
    return now and [now.done, now.total]
"""


class Tried:
    """Runs programs on those kernels, with a cache of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.cache = folder / "cache"
        (folder / "kernels.py").write_text(KERNELS)
        (folder / "listed.py").write_text(LISTED)
        self.environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
        self.environment |= {"XDG_CACHE_HOME": str(self.cache), "TMPDIR": str(folder)}

    def start(self, text: str) -> Forked:
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        program = f"import sys\nsys.path.append({str(self.folder)!r})\n{PROGRAM}{text}"
        return compiler().start([], self.folder, module=None, before=program, env=self.environment, **pipes)

    def says(self, text: str) -> tuple[list[Any], str]:
        done = self.start(text).done(compiling_s())
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1]), done.stderr

    @property
    def helpers(self) -> list[int]:
        return [int(path.name.partition("-")[2]) for path in self.folder.glob("helper-*")]


@pytest.fixture
def tried(tmp_path: Path) -> Tried:
    return Tried(tmp_path)


def has_ended(process_id: int) -> bool:
    """…at last."""
    return until(lambda: ended(process_id), f"{process_id} runs on")


VALUES = [2, 4, 6, 8]


def test_a_helper_compiles_what_the_caller_then_finds(tried: Tried) -> None:
    found, _ = tried.says("kernel_helpers._work_off = lambda tasks: until(kept)\ncompiled()")
    assert found == [VALUES, [5, 5], 0, [5, 5], False]
    (helper,) = tried.helpers
    assert has_ended(helper)
    # the next time there is nothing to do, and no helper for it
    assert tried.says("compiled()")[0] == [VALUES, None, 0, None, False] and tried.helpers == [helper]


def test_the_count_goes_up_to_all_there_are(tried: Tried) -> None:
    """…while others compile, too, and nobody compiles what another has."""
    text = """
seen = []
def watched(tasks):
    while not kept():
        seen.append(compiling.progress().done)
        assert compiling.busy() and not compiling.finished()
        time.sleep(0.001)
kernel_helpers._work_off = watched
compiled()
assert seen == sorted(seen) and seen[0] == 0 and compiling.progress().total == 5, seen
"""
    assert tried.says(text)[0][1] == [5, 5]


def test_both_at_once_compile_everything_once(tried: Tried) -> None:
    values, counted, made, *_ = tried.says("compiled()")[0]
    assert (values, counted) == (VALUES, [5, 5]) and made <= 5
    assert len(list(tried.cache.rglob("*.nbc"))) == 5


def test_a_helper_that_is_killed_costs_nothing_but_time(tried: Tried) -> None:
    """It has claimed a kernel when it dies, and the caller compiles that too."""
    (tried.folder / "to-hang").touch()
    text = """
work_off = kernel_helpers._work_off
def after_a_death(tasks):
    until(lambda: (here / "hangs").exists())
    (helper,) = here.glob("helper-*")
    os.kill(int(helper.name.partition("-")[2]), signal.SIGKILL)
    work_off(tasks)
kernel_helpers._work_off = after_a_death
compiled()
"""
    assert tried.says(text)[0] == [VALUES, [5, 5], 5, [5, 5], False]
    assert all(map(has_ended, tried.helpers))


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL], ids=lambda number: number.name
)
def test_no_helper_is_left_of_a_program_that_ends(tried: Tried, number: signal.Signals) -> None:
    (tried.folder / "to-hang").touch()
    text = """
from synth.cli import main, presets
def wait(tasks):
    until(lambda: (here / "hangs").exists())
    print("both", flush=True)
    time.sleep(600.0)
kernel_helpers._work_off = wait
presets._list_presets = lambda options: compiled()
sys.argv[1:] = ["presets", "list"]
sys.exit(main())
"""
    with tried.start(text) as process:
        assert process.stdout is not None and process.stdout.readline() == "both\n"
        (helper,) = tried.helpers
        assert not ended(helper)
        process.send_signal(number)
        said = process.done(patience_s()).stderr
    assert process.returncode == (-9 if number == signal.SIGKILL else 128 + number) and "Traceback" not in said
    assert has_ended(helper)


@pytest.mark.parametrize("trouble", ["no folder", "full"])
def test_a_cache_that_cannot_be_written(tried: Tried, trouble: str) -> None:
    if trouble == "no folder":
        tried.cache.write_text("a file")
        text = "compiled()"
    else:  # no file may hold a byte
        text = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))\ncompiled()"
    values, _, _, counted, busy = tried.says(text)[0]
    assert (values, counted, busy) == (VALUES, [5, 5], False)
    assert all(map(has_ended, tried.helpers))
    assert not list(tried.folder.glob("jawari-kernels-*")) and not list(tried.folder.rglob("*.tmp.*"))


def test_no_helper_where_there_is_no_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_helpers, "free_memory", lambda: 64e9)
    monkeypatch.setattr(kernel_helpers.os, "sched_getaffinity", lambda process: {3, 5, 6}, raising=False)
    monkeypatch.setattr(sys, "executable", "/usr/bin/python3")
    assert kernel_helpers._may_run() == 2
    with monkeypatch.context() as here:
        here.setattr(kernel_helpers.os, "sched_getaffinity", lambda process: {3}, raising=False)
        assert kernel_helpers._may_run() == 0
    with monkeypatch.context() as here:
        here.setattr(kernel_helpers, "free_memory", lambda: 1e9)
        assert kernel_helpers._may_run() == 0
    with monkeypatch.context() as here:  # what is started by these names is no interpreter
        here.setattr(sys, "frozen", True, raising=False)
        assert kernel_helpers._may_run() == 0
    for name in ("/opt/host/daw", "", None):
        with monkeypatch.context() as here:
            here.setattr(sys, "executable", name)
            assert kernel_helpers._may_run() == 0


def test_with_one_processor_everything_is_compiled_here(tried: Tried) -> None:
    """By whom it is called, one after the other."""
    text = """
kernel_helpers._may_run = may_run
os.sched_getaffinity = lambda process: {0}
compiled()
"""
    assert tried.says(text)[0] == [VALUES, None, 0, [5, 5], False] and tried.helpers == []


def test_claims_are_those_of_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """…that keep their kernels in one folder."""
    text = "from synth.jit import kernel_claims as c; print(c.take('a'), c.take('b'))"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert kernel_claims.take("a") and kernel_claims.take("a")
    for answer in ("False True", "True True"):
        told = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True, cwd=ROOT)
        assert told.stdout.strip() == answer
        kernel_claims.leave("a")
    assert kernel_claims.take("a")


def test_two_programs_that_start_cold_compile_each_kernel_once(tried: Tried) -> None:
    text = """
kernel_helpers._may_run = lambda: 0
(here / f"ready-{os.getpid()}").touch()
until(lambda: len(list(here.glob("ready-*"))) == 2)
compiled()
"""
    programs = [tried.start(text) for _ in range(2)]
    results = [program.done(compiling_s()) for program in programs]
    assert [result.returncode for result in results] == [0, 0], [result.stderr for result in results]
    made = [json.loads(result.stdout.splitlines()[-1])[3] for result in results]
    assert sum(count[0] for count in made if count) == 5


ASKED = """
import json, os, sys, contextlib, io
import synth
from synth.jit import kernel_helpers, kernel_linking
from numba.core.caching import Cache

kernel_helpers._may_run = lambda: 0
asked, load = {}, Cache.load_overload
def named(self, signature, context):
    asked.setdefault(kernel_linking.name_of(self._py_func), set()).add(signature)
    return load(self, signature, context)
Cache.load_overload = named
from synth.cli import main
with contextlib.redirect_stdout(io.StringIO()):
    assert main(sys.argv[2:]) == 0
found = {}
for task in kernel_helpers._tasks(sys.argv[1]):
    signatures = asked.get(kernel_linking.name_of(task.kernel.py_func), set())
    found[task.kernel.py_func.__name__] = [task.arguments in signatures, len(signatures)]
print(json.dumps(found))
"""


@pytest.mark.parametrize(
    ("listed", "arguments"),
    [
        ("synth.engine.warmup:kernels", ["render", str(ROOT / "presets" / "demos" / "bassline.mid"), "-p", "fretted-bass",
                                          "--end", "0.2", "--quiet", "-o", "out.wav"]),
        ("synth.research.methods.warmup:kernels", ["simulate", "tanpura", "--duration", "0.001", "--modes", "20",
                                           "--quiet", "-o", "out.npz"]),
    ],
    ids=["engine", "simulate"],
)  # fmt: skip
def test_what_helpers_compile_is_what_is_called(tmp_path: Path, listed: str, arguments: list[str]) -> None:
    """The types in the lists are those that callers give: other ones would be compiled for nothing."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    done = compiler().start([listed, *arguments], tmp_path, module=None, before=ASKED, **pipes).done(compiling_s())
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found) > 2 and all(count == 0 or there for there, count in found.values()), found
    assert all(found[name][1] for name in ("advance_under_finger", "one_by_one")), found
