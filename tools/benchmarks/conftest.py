"""How a benchmark takes its rounds: each beside one of everything that it is compared with."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pytest

from benchmarks import peak
from benchmarks.count import block_times
from benchmarks.scenes import RATE_HZ, Player, stalls, vectors_of
from synth.native.denormals import enable_ftz, restore
from synth.solver.lanes import LANES

#: CPU seconds of one round of the peak loop
_PEAK_S = 1e-3


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--short", action="store_true", help="fewer rounds, settings and notes")
    parser.addoption("--against", metavar="COMMIT", help="a commit that is measured in turn with this tree")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "full: left out by --short")
    config.addinivalue_line("markers", "versus: left out without --against")
    config.addinivalue_line("markers", "page: gives a figure that docs/speed.md or README.md shows, so `--only page` has it")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    marks = ["full"] * bool(config.getoption("--short")) + ["versus"] * (not config.getoption("--against"))
    left = [item for item in items if any(item.get_closest_marker(mark) for mark in marks)]
    if left:
        items[:] = [item for item in items if item not in left]
        config.hook.pytest_deselected(items=left)


@pytest.fixture
def short(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--short"))


def nothing() -> None:
    """No state to put back."""


def noted(benchmark: Any, section: str, *, precision: str = "float64", lanes: int = LANES, **values: Any) -> None:
    """What the report gets to know of a benchmark: a section and its figures, measured with vectors of so many numbers."""
    benchmark.extra_info.update(section=section, precision=precision, lanes=lanes, **values)


class Race:
    """Rounds of one callable by pytest-benchmark, those of its opponents interleaved, all in CPU seconds.

    After a call `seconds` holds its rounds, `others` those of the opponents, in the same order.
    """

    def __init__(self, benchmark: Any, rounds: int) -> None:
        self.benchmark, self.rounds = benchmark, rounds
        self.seconds: list[float] = []
        self.others: dict[str, list[float]] = {}

    def __call__(
        self,
        call: Callable[[], object],
        *,
        reset: Callable[[], None] = nothing,
        against: Mapping[str, tuple[Callable[[], object], Callable[[], None]]] | None = None,
        rounds: int | None = None,
    ) -> Race:
        """Runs everything once unmeasured, then the rounds. `against`: name → (callable, reset)."""
        opponents = dict(against or {})
        self.others = {name: [] for name in opponents}
        flush = enable_ftz()
        try:
            for once, back in [(call, reset), *opponents.values()]:
                back()
                once()

            def before_a_round() -> None:
                for name, (other, back) in opponents.items():
                    back()
                    started = time.process_time()
                    other()
                    self.others[name].append(time.process_time() - started)
                reset()

            self.benchmark.pedantic(call, setup=before_a_round, rounds=rounds or self.rounds, iterations=1)
        finally:
            restore(flush)
        self.seconds = list(self.benchmark.stats.stats.data)
        return self

    def note(self, section: str, **values: Any) -> None:
        """`noted`, with the rounds."""
        noted(self.benchmark, section, seconds=self.seconds, others=self.others, **values)


@pytest.fixture
def race(benchmark: Any, short: bool) -> Race:
    return Race(benchmark, 5 if short else 15)


def block_rounds(
    benchmark: Any, player: Player, block: int, short: bool, clock: Callable[[], float] = time.perf_counter
) -> list[list[float]]:
    """Seconds of every block, wall-clock unless said, played five times (short: three) after once unmeasured."""
    rounds: list[list[float]] = []

    def play() -> None:
        player.engine.reset()
        rounds.append(list(player.blocks(block, clock)))

    play()
    rounds.clear()
    benchmark.pedantic(play, rounds=3 if short else 5, iterations=1)
    return rounds


def note_blocks(benchmark: Any, scene: str, player: Player, block: int, short: bool) -> None:
    """A scene's blocks of so many frames, and as many turns of a loop that does nothing, as long as a median block."""
    rounds = block_rounds(benchmark, player, block, short)
    own = block / RATE_HZ
    found = block_times(rounds, own)
    empty = stalls(found["median"] * own, len(rounds[0])) / own
    noted(
        benchmark, "blocks", scene=scene, block=block, blocks=len(rounds[0]), **found,
        stall=float(empty.max() - np.median(empty)), **vectors_of(player.engine),
    )  # fmt: skip


@pytest.fixture
def all_cores() -> Any:
    """A function that lets this process run on every core it may; afterwards it is where it was."""
    before = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else None

    def open_up() -> None:
        if before is not None:
            os.sched_setaffinity(0, range(os.cpu_count() or 1))

    yield open_up
    if before is not None:
        os.sched_setaffinity(0, before)


@pytest.fixture(scope="session")
def peak_turns() -> dict[int, int]:
    """Vector width → turns of its peak loop that take about a millisecond."""
    turns = {}
    for lanes in sorted({LANES, min(4, LANES)}):
        loop, count = peak.peak_loop(lanes), 1000
        for _ in range(30):
            started = time.process_time()
            loop(count)
            spent = time.process_time() - started
            if spent > _PEAK_S:
                break
            count *= 2
        turns[lanes] = count
    return turns
