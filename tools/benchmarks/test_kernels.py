"""Kernels against the machine's peak: schemes, modes, contacts, voices."""

from __future__ import annotations

import pytest

from benchmarks import kernels, peak
from benchmarks.conftest import Race
from benchmarks.count import part_of_peak, rate
from benchmarks.kernels import GRID, HOLD, Kernel, Setting, Stretch
from synth.solver.lanes import LANES

#: steps of a string before the next one's, where there are several
_CHUNK = 1024
_IN_SHORT = (137, 1001)


def _label(value: object) -> str:
    if isinstance(value, Kernel):
        return value.name.replace(" ", "-")
    return "-".join(map(str, value)) if isinstance(value, Setting) else str(value)


def _marks(setting: Setting) -> tuple:
    if setting.modes not in _IN_SHORT:
        return (pytest.mark.full,)
    return (pytest.mark.page,) if (setting.scheme, setting.contacts) == (HOLD, 0) else ()


def _grid() -> list:
    return [pytest.param(kernel, setting, marks=_marks(setting)) for kernel, setting in GRID]


@pytest.mark.parametrize("lanes", sorted({2, min(4, LANES), LANES}))
def test_peak(race: Race, lanes: int) -> None:
    loop, turns = peak.peak_loop(lanes), 50_000
    race(lambda: loop(turns), rounds=4 * race.rounds)
    median, best = rate(turns * peak.fma_of_turn(lanes), race.seconds)
    race.note("peak", lanes=lanes, chains=peak.chains(), fma_per_s=median, best_fma_per_s=best)


def _against_peak(
    race: Race, turns: dict[int, int], kernel: Kernel, setting: Setting, strings: list[Stretch], steps: int, sweep: str
) -> None:
    def reset() -> None:
        for one in strings:
            one.reset()

    def call() -> None:
        for one in strings:
            one.call()

    loops = {
        f"peak {lanes}": (lambda lanes=lanes, count=count: peak.peak_loop(lanes)(count), lambda: None)
        for lanes, count in turns.items()
    }
    race(call, reset=reset, against=loops)
    mode_steps = len(strings) * steps * setting.modes
    median, best = rate(mode_steps, race.seconds)
    parts = {
        lanes: part_of_peak(
            mode_steps * kernel.fma(setting), race.seconds, count * peak.fma_of_turn(lanes), race.others[f"peak {lanes}"]
        )
        for lanes, count in turns.items()
    }
    race.note(
        "kernels", sweep=sweep, kernel=kernel.name, **setting._asdict(), voices=len(strings), steps=steps,
        fma=kernel.fma(setting), looks_at_all=kernel.looks_at_all, mode_steps_per_s=median, best_mode_steps_per_s=best,
        part=parts[max(parts)][0], best_part=parts[max(parts)][1], part_of_narrow=parts[min(parts)][0],
    )  # fmt: skip


def _one_string(race: Race, turns: dict[int, int], kernel: Kernel, setting: Setting, short: bool, sweep: str) -> None:
    steps = kernels.steps_of(setting, short)
    _against_peak(race, turns, kernel, setting, [kernel.make(setting, steps)], steps, sweep)


@pytest.mark.parametrize(("kernel", "setting"), _grid(), ids=_label)
def test_kernel(race: Race, peak_turns: dict[int, int], kernel: Kernel, setting: Setting, short: bool) -> None:
    _one_string(race, peak_turns, kernel, setting, short, "grid")


@pytest.mark.parametrize("contacts", [1, 2, 5, 10, 20])
@pytest.mark.parametrize("kernel", [k for k in kernels.KERNELS if k.takes(Setting(HOLD, 137, 5))], ids=_label)
def test_contacts(race: Race, peak_turns: dict[int, int], kernel: Kernel, contacts: int, short: bool) -> None:
    """137 modes over more and more of the bass's frets, or the tanpura's one point."""
    _one_string(race, peak_turns, kernel, Setting(HOLD, 137, contacts), short, "contacts")


@pytest.mark.parametrize("voices", [1, *(pytest.param(n, marks=pytest.mark.full) for n in (4, 16)), 64])
@pytest.mark.parametrize("modes", [137, 1001])
@pytest.mark.parametrize(
    "kernel", [k for k in kernels.KERNELS if k.takes(Setting(HOLD, 137, 1)) and k.name != "naive loop"], ids=_label
)
def test_voices(race: Race, peak_turns: dict[int, int], kernel: Kernel, modes: int, voices: int) -> None:
    """Strings in turn, each some steps at a time."""
    setting = Setting(HOLD, modes, 1)
    strings = [kernel.make(setting, _CHUNK) for _ in range(voices)]
    _against_peak(race, peak_turns, kernel, setting, strings, _CHUNK, "voices")
