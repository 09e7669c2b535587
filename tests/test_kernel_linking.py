"""A large kernel is called and not copied, and found again when its caller is loaded from disk."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.forkserver import compiler
from tests.patience import compiling_s

ROOT = Path(__file__).resolve().parents[1]

TERMS = 100
SUM = " + ".join(f"x[{k}] * x[{(7 * k + 3) % TERMS}]" for k in range(TERMS))
KERNELS = f"""
from numba import njit

@njit(cache=True)
def small(x):
    return x[0] + 1.0

@njit(cache=True)
def large(x):
    return {SUM}

@njit(cache=True)
def between(x):
    return 2.0 * large(x)

@njit(cache=True)
def caller(x):
    return between(x) + small(x)
"""

PROGRAM = """
import importlib.util, sys
import numpy as np
import synth
from synth.jit import compiling, kernel_linking
spec = importlib.util.spec_from_file_location("synth.kernels_to_try", {kernels!r})
kernels = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
spec.loader.exec_module(kernels)
x = np.arange(100.0)
print(float(kernels.caller(x)), sorted(function.__name__ for function in compiling._made))
"""
X = [float(k) for k in range(TERMS)]
VALUE = 2.0 * sum(X[k] * X[(7 * k + 3) % TERMS] for k in range(TERMS)) + 1.0
ALL = ["between", "caller", "large", "small"]


class Tried:
    def __init__(self, folder: Path) -> None:
        self.cache = folder / "cache"
        (folder / "kernels.py").write_text(KERNELS)
        self.program = PROGRAM.format(kernels=str(folder / "kernels.py"))
        self.environment = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
        self.environment |= {"XDG_CACHE_HOME": str(self.cache), "PYTHONPATH": str(ROOT)}

    def compiled(self, text: str = "") -> list[str]:
        """The kernels that a process compiles; the value that it gets is right."""
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        running = compiler().start(
            [], self.cache.parent, module=None, before=self.program + text, env=self.environment, **pipes
        )
        done = running.done(compiling_s())
        assert done.returncode == 0, done.stderr
        value, _, made = done.stdout.splitlines()[0].partition(" ")
        assert float(value) == VALUE
        self.more = done.stdout.splitlines()[1:]
        return [name.strip("'") for name in made[1:-1].split(", ") if name]

    def files(self, name: str, suffix: str = "nb[ic]") -> list[Path]:
        return sorted(self.cache.rglob(f"kernels.{name}-*.{suffix}"))


@pytest.fixture
def tried(tmp_path: Path) -> Tried:
    return Tried(tmp_path)


def test_a_large_kernel_lies_in_one_library(tried: Tried) -> None:
    text = """
for name in ("between", "caller"):
    library = next(iter(getattr(kernels, name).overloads.values())).library
    print(*sorted({f.name.split("_to_try")[1][1:].lstrip("0123456789").split("B")[0]
                  for f in library._final_module.functions if "kernels_to_try" in f.name and f.name.startswith("_ZN")
                  and not f.is_declaration}))
"""
    assert tried.compiled(text) == ALL
    assert [line.split() for line in tried.more] == [["between"], ["caller"]]
    assert tried.compiled() == []


@pytest.mark.parametrize("suffix", ["nbi", "nbc"])
def test_one_that_is_missing_on_disk_is_compiled_again_with_those_that_call_it(tried: Tried, suffix: str) -> None:
    """LLVM ends the process where a name is not found."""
    assert tried.compiled() == ALL
    (lost,) = tried.files("large", suffix)
    lost.unlink()
    assert "large" in tried.compiled()
    assert tried.compiled() == []


FOREIGN = """
import sys
from numba import njit

large = sys.modules["synth.kernels_to_try"].large

@njit(cache=True)
def theirs(x):
    return 3.0 * large(x)

@njit(cache=True)
def outer(x):
    return theirs(x) + 1.0
"""


def test_one_of_another_package_finds_what_it_calls(tried: Tried, tmp_path: Path) -> None:
    """An extension's kernel, loaded from disk in a process that has not used the large one yet."""
    (tmp_path / "foreign.py").write_text(FOREIGN)
    before = "x = np.arange(100.0)\n"
    assert before in tried.program
    call = f"sys.path.insert(0, {str(tmp_path)!r})\nimport foreign\nmade = float(foreign.outer(x))\n"
    first = f"print({VALUE!r}, sorted(function.__name__ for function in compiling._made))\nprint(made)\n"
    tried.program = tried.program.split(before)[0] + before + call + first
    expected = 3.0 * (VALUE - 1.0) / 2.0 + 1.0
    assert tried.compiled() == ["large", "outer", "theirs"]
    assert tried.compiled() == [] and tried.more == [repr(expected)]


def test_one_that_another_process_has_compiled_anew_goes_by_another_name(tried: Tried) -> None:
    assert tried.compiled() == ALL
    for path in tried.files("large"):
        path.unlink()
    first = "kernels.apart = __import__('numba').njit(lambda x: x)\nkernels.apart(1)\n"  # names are numbered
    alone = tried.program.replace("kernels.caller(x)", "0 * kernels.large(x) + VALUE").replace("VALUE", repr(VALUE))
    tried.program, whole = alone.replace("x = np", first + "x = np"), tried.program
    assert tried.compiled() == ["large"]
    tried.program = whole
    assert set(tried.compiled()) <= {"between", "caller"}
    assert tried.compiled() == []


def test_asked_for_twice_in_a_process_a_kernel_still_knows_what_it_calls(tried: Tried) -> None:
    tried.program, once = (
        tried.program.replace("import synth\n", "import synth\nsynth.kernel_cache.use()\n", 1),
        tried.program,
    )
    assert tried.compiled() == ALL
    tried.program = once
    assert tried.compiled() == []
