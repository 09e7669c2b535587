"""What is emitted for Windows, on this system: functions of the same types stand in the place of Windows' own, and say how
they were called. That they are called so on Windows itself is not shown by this."""

import ctypes
import os
import sys
import time

import llvmlite.binding
import pytest
from numba import njit
from numba.extending import intrinsic

from synth.native import atomics, clocks, windows

I32, I64, POINTER = ctypes.c_int32, ctypes.c_int64, ctypes.POINTER(ctypes.c_int64)
SECOND = 10**9


@pytest.fixture
def system(monkeypatch):
    """Symbols as `define` makes them, to functions that note their arguments."""
    calls: list[tuple] = []
    kept = []

    def give_way():
        calls.append(("yield",))
        return 1

    def sleep(milliseconds):
        calls.append(("sleep", milliseconds))

    def counter(place):
        place[0] = 70 * 10_000_000 + 1_234_567  # 70.1234567 s of a counter of 10 MHz
        return 1

    def frequency(place):
        place[0] = 10_000_000
        return 1

    def times(thread, made, ended, kernel, user):
        calls.append(("times", thread))
        made[0], ended[0], kernel[0], user[0] = -1, -1, 30, 12
        return 1

    def transfer(name, at):
        def run(descriptor, place, count):
            calls.append((name, descriptor, count, ctypes.cast(place, POINTER)[0]))
            return at

        return run

    kinds = {
        "jawari_yield": (give_way, I32),
        "jawari_sleep": (sleep, None, ctypes.c_uint32),
        "jawari_counter": (counter, I32, POINTER),
        "jawari_frequency": (frequency, I32, POINTER),
        "jawari_ticks": (lambda: 5_000_000_000, ctypes.c_uint64),
        "jawari_thread_times": (times, I32, I64, POINTER, POINTER, POINTER, POINTER),
        "jawari_read": (transfer("read", 8), I32, I32, ctypes.c_void_p, ctypes.c_uint32),
        "jawari_write": (transfer("write", -1), I32, I32, ctypes.c_void_p, ctypes.c_uint32),
    }
    assert set(kinds) == set(windows.FUNCTIONS)
    for name, (function, *kind) in kinds.items():
        kept.append(ctypes.CFUNCTYPE(*kind)(function))
        llvmlite.binding.add_symbol(name, ctypes.cast(kept[-1], ctypes.c_void_p).value)
    monkeypatch.setattr(sys, "platform", "win32")
    yield calls


def test_clocks(system, monkeypatch) -> None:
    now, used, nap = (
        clocks._clock(clocks.MONOTONIC, time.monotonic_ns),
        clocks._clock(clocks.THREAD, time.thread_time_ns),
        intrinsic(clocks._nap),
    )
    monkeypatch.setattr(windows, "COUNTS", True)
    assert njit(lambda: now())() == 70 * SECOND + 123_456_700
    assert njit(lambda: used())() == 4200
    assert system == [("times", -2)]
    njit(lambda: nap(1))()
    njit(lambda: nap(2_000_001))()
    assert system[1:] == [("sleep", 1), ("sleep", 3)]


def test_the_clock_before_python_3_13_has_ticks(system, monkeypatch) -> None:
    monkeypatch.setattr(windows, "COUNTS", False)
    now = clocks._clock(clocks.MONOTONIC, time.monotonic_ns)
    assert njit(lambda: now())() == 5_000_000_000 * 10**6


def test_tokens_and_giving_way(system) -> None:
    receive, send = atomics._transfer("read", atomics._plain_receive), atomics._transfer("write", atomics._plain_send)
    give_way = intrinsic(atomics._yield)
    assert njit(lambda: receive(7))()
    assert not njit(lambda: send(9))()
    njit(lambda: give_way())()
    assert system == [("read", 7, 8, 1), ("write", 9, 8, 1), ("yield",)]


def test_here_the_system_is_asked_as_ever() -> None:
    """No symbol of Windows is in what is emitted on this system."""
    assert sys.platform != "win32"
    for clock in (clocks.monotonic_ns, clocks.thread_ns):
        kernel = njit(lambda: clock())  # noqa: B023 - called at once
        kernel()
        assert "clock_gettime" in "".join(kernel.inspect_llvm().values())
        assert "jawari_" not in "".join(kernel.inspect_llvm().values())


def test_tokens_work_by_a_pipe_too(monkeypatch) -> None:
    """As on systems without eventfd."""
    monkeypatch.delattr(os, "eventfd", raising=False)
    asleep, wake = atomics.tokens()
    try:
        assert asleep != wake
        assert njit(lambda at: atomics.send(at))(wake)
        assert njit(lambda at: atomics.receive(at))(asleep)
    finally:
        os.close(asleep)
        os.close(wake)


def test_without_windows_there_is_nothing_to_define(monkeypatch) -> None:
    monkeypatch.delattr(ctypes, "WinDLL", raising=False)
    with pytest.raises(AttributeError):
        windows.define()
