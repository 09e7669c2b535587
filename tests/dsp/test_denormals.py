"""Subnormal numbers become zero between enable_ftz and restore, and nowhere else."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from synth.native import denormals

pytestmark = pytest.mark.skipif(not denormals.SUPPORTED, reason="no flush-to-zero switch on this processor")

TINY = np.finfo(np.float64).tiny


@njit(cache=True, nogil=True)
def _halve(x, out):
    for i in range(x.size):
        out[i] = x[i] * 0.5


@njit(cache=True, nogil=True)
def _double(x, out):
    for i in range(x.size):
        out[i] = x[i] * 2.0


@njit(cache=True, nogil=True)
def _flushed(x, results, operands):
    previous = denormals.enable_ftz()
    _halve(x, results)
    _double(0.5 * x, operands)
    denormals.restore(previous)


def python_flushes():
    return np.float64(TINY) * np.float64(0.5) == 0.0


def test_subnormal_results_become_zero_and_the_state_comes_back():
    x = np.full(7, TINY)
    out = np.ones(7)
    _halve(x, out)
    assert np.all(out > 0)
    results, operands = np.ones(7), np.ones(7)
    _flushed(x, results, operands)
    assert np.array_equal(results, np.zeros(7))
    _halve(x, out)
    assert np.all(out > 0)
    assert not python_flushes()


def test_subnormal_operands_count_as_zero():
    subnormal, out = np.full(5, TINY / 8), np.ones(5)
    previous = denormals.enable_ftz()
    try:
        # Sixteen times this would be an ordinary number: only reading it as zero gives zero.
        _double(subnormal, out)
        doubled = out.copy()
        out[:] = subnormal
        for _ in range(4):
            _double(out, out)
    finally:
        denormals.restore(previous)
    assert np.array_equal(doubled, np.zeros(5))
    assert np.array_equal(out, np.zeros(5))


def test_ordinary_numbers_are_not_changed():
    x = np.concatenate([np.random.default_rng(0).standard_normal(50), [2 * TINY, -4 * TINY, 0.0]])
    plain, flushed = np.empty_like(x), np.empty_like(x)
    _halve(x, plain)
    _flushed(x, flushed, np.empty_like(x))
    assert np.array_equal(plain, flushed)


def test_restore_puts_back_a_flush_that_was_there_before():
    outer = denormals.enable_ftz()
    try:
        inner = denormals.enable_ftz()
        denormals.restore(inner)
        still = python_flushes()
    finally:
        denormals.restore(outer)
    assert still
    assert not python_flushes()


def test_each_thread_has_its_own_switch():
    """One thread flushes while another, at the same time, does not."""
    seen = {}
    both = threading.Barrier(2)

    def work(name, flush):
        x, out = np.full(100, TINY), np.empty(100)
        previous = denormals.enable_ftz() if flush else 0
        both.wait()
        _halve(x, out)
        seen[name] = out.copy()
        both.wait()
        if flush:
            denormals.restore(previous)
            _halve(x, out)
            seen["restored"] = out.copy()

    threads = [threading.Thread(target=work, args=args) for args in (("flushed", True), ("plain", False))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert np.all(seen["flushed"] == 0)
    assert np.all(seen["plain"] > 0)
    assert np.all(seen["restored"] > 0)


@pytest.mark.slow
def test_it_works_from_the_cache(tmp_path):
    """A second process takes the compiled code from disk, and that code flushes too."""
    program = tmp_path / "flushing.py"
    program.write_text(
        "import numpy as np\n"
        "from numba import njit\n"
        "from synth.native.denormals import enable_ftz, restore\n"
        "@njit(cache=True, nogil=True)\n"
        "def half(x, out):\n"
        "    previous = enable_ftz()\n"
        "    for i in range(x.size):\n"
        "        out[i] = 0.5 * x[i]\n"
        "    restore(previous)\n"
        "out = np.ones(3)\n"
        f"half(np.full(3, {TINY!r}), out)\n"
        "print(sum(half.stats.cache_hits.values()), np.count_nonzero(out), np.float64(5e-324) > 0)\n"
    )
    root = str(Path(denormals.__file__).parents[2])
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": root}
    outputs = [
        subprocess.run(
            [sys.executable, str(program)], env=environment, capture_output=True, text=True, check=True
        ).stdout.split()
        for _ in range(2)
    ]
    assert outputs == [["0", "0", "True"], ["1", "0", "True"]]
