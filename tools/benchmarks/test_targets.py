"""The figures that were aimed at, each a ratio within one run."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from speed_error.grid import AS_DEFAULT, E0, WITHOUT_R, Run

from benchmarks import kernels, scenes
from benchmarks.conftest import Race, block_rounds, noted
from benchmarks.count import block_times, times_less
from benchmarks.kernels import HOLD, Kernel, Setting
from synth.research import methods
from synth.research.scene import Scene
from synth.research.simulation import simulate
from synth.units import midi_to_note

pytestmark = pytest.mark.page


def row(name: str, what: str, unit: str, reached: float, best: float | None, figure: dict[str, float] | None = None) -> dict:
    """One line of the table of targets; `name` says which aim it has (`aims.AIMS`), `figure` what the history keeps of it
    (`history.VALUES`), None: median and best."""
    return {"name": name, "what": what, "unit": unit, "reached": reached, "best": best, "figure": figure}


def real_time(seconds: float, spent: list[float]) -> tuple[float, float]:
    """Times faster than the sound lasts: (median, best)."""
    return seconds / float(np.median(spent)), seconds / min(spent)


@pytest.mark.parametrize("modes", [137, 1001])
@pytest.mark.parametrize(
    "kernel", [k for k in kernels.BLOCKS if k.takes(Setting(HOLD, 137, 1)) and k.looks_at_all], ids=lambda k: k.name
)
def test_block_kernel(race: Race, kernel: Kernel, modes: int, short: bool) -> None:
    setting = Setting(HOLD, modes, 1)
    plain = kernels.BY_NAME[kernel.plain]
    steps = kernels.steps_of(setting, short)
    mine, other = kernel.make(setting, steps), plain.make(setting, steps)
    race(mine.call, reset=mine.reset, against={"plain": (other.call, other.reset)})
    median, best = times_less(race.seconds, race.others["plain"])
    what = f"{kernel.name} against {plain.name}, one contact, {modes} modes"
    name = f"several-steps/{kernel.name}/{modes}"
    race.note("targets", rows=[row(name, what, "times less", median, best)])


class Runner:
    """A scene run again and again, its computation timed by the lesser of its own clock and this process's CPU time."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.spent = scene, []  # type: ignore[var-annotated]

    def __call__(self) -> None:
        started = time.process_time()
        outcome = methods.run(self.scene)
        self.spent.append(min(time.process_time() - started, outcome.seconds))

    def race(self, race: Race, rounds: int) -> tuple[float, float]:
        race(self, rounds=rounds)
        return real_time(self.scene.steps * self.scene.dt, self.spent[-rounds:])


@pytest.mark.parametrize("scheme", ["moreau-jean", "moreau-jean-filtered"])
def test_published_reference(race: Race, scheme: str, short: bool) -> None:
    runner = Runner(Run("tanpura", scheme, 48, 1001, E0).scene(0.03 if short else 0.3, 1))
    reached = runner.race(race, 3 if short else 5)
    what = f"tanpura, {scheme}, 1001 modes, 2.1168 MHz (the authors' C++: 1/217)"
    race.note("targets", rows=[row(f"published/{scheme}", what, "× real time", *reached)])


def test_tanpura_kernel(race: Race) -> None:
    """The cheapest run of tools/speed-error with e < 0.1 over 3 s: its first second by three kernels."""
    scene = Run("tanpura", HOLD, 1, 103, AS_DEFAULT).scene(1.0, 1)
    plucked = kernels.Plucked(scene.model, *scene.initial())
    steps = 64 * (scene.steps // 64)
    ours, *others = (kernels.BY_NAME[name].on(plucked, steps) for name in ("press_blocks", "advance_one", "naive loop"))
    names = ("by the plain loop", "by the naive loop")
    race(ours.call, reset=ours.reset, against={n: (s.call, s.reset) for n, s in zip(names, others, strict=True)})
    sound = steps * scene.dt
    what = "tanpura string, 44.1 kHz, 103 modes (e < 0.1 over 3 s), kernel with output"
    rows = [row("tanpura-kernel", what, "× real time", *real_time(sound, race.seconds))]
    rows += [row(f"tanpura-kernel/{n}", f"the same {n}", "× real time", *real_time(sound, race.others[n])) for n in names]
    race.note("targets", rows=rows)


def test_tanpura_simulated(race: Race, short: bool) -> None:
    runner = Runner(Run("tanpura", HOLD, 1, 103, AS_DEFAULT).scene(1.0 if short else 3.0, 1))
    reached = runner.race(race, 5)
    what = "the same through simulate, with the contact force of every row"
    race.note("targets", rows=[row("tanpura-simulated", what, "× real time", *reached)])


def test_paper_bass(race: Race, short: bool) -> None:
    runner = Runner(Run("bass", HOLD, 24, 863, WITHOUT_R).scene(0.1, 1))
    reached = runner.race(race, 2 if short else 5)
    what = "bass, 20 frets, all 863 modes, exact-hold, 1.0584 MHz, first 0.1 s (the paper's C++: 1/300)"
    race.note("targets", rows=[row("paper-bass", what, "× real time", *reached)])


@pytest.mark.parametrize("velocity", [64, 110])
@pytest.mark.parametrize("midi", [28, 38, 50])
def test_bass_note(race: Race, midi: int, velocity: int, short: bool) -> None:
    player = scenes.note("fretted-bass", midi, velocity, "standard", 3.0)
    race(player.play, rounds=3 if short else 9)
    reached = real_time(player.seconds, race.seconds)
    what = f"bass note at standard, {midi_to_note(midi)}, velocity {velocity}, whole 3 s"
    name = f"bass-note/{midi_to_note(midi)}/{velocity}"
    race.note("targets", rows=[row(name, what, "× real time", *reached)], **scenes.vectors_of(player.engine))


def test_fretless_note(race: Race, short: bool) -> None:
    found: list[dict[str, Any]] = []
    rounds = 1 if short else 3
    race(lambda: found.append(simulate("fretless", quality="standard", duration_s=3.0).summary), rounds=rounds)
    reached = real_time(3.0, [summary["compute_s"] for summary in found[-rounds:]])
    chosen = f"{found[0]['internal_rate_hz'] / 1e3:.1f} kHz, {found[0]['modes']} modes"
    what = f"fretless case at standard ({chosen}), whole 3 s"
    race.note("targets", rows=[row("fretless-note", what, "× real time", *reached)])


@pytest.mark.parametrize("threads", [1, 2] if scenes.HAS_THREADS else [1])
def test_many_strings(benchmark: Any, threads: int, short: bool, all_cores: Any) -> None:
    """Blocks of 128 frames: speed while all sound, the worst block from the first pluck on. Processor time of one thread,
    wall-clock time of two."""
    block = 128
    seconds = scenes.first_full() + (1.0 if short else 3.0)
    if threads > 1:  # before there is any other thread, which would stay where this one is
        all_cores()
    player = scenes.crowd(scenes.MANY, seconds, threads=threads)
    own = block / scenes.RATE_HZ
    rounds = block_rounds(benchmark, player, block, short, time.perf_counter if threads > 1 else time.thread_time)
    began = round(scenes.first_full() / own)
    reached = real_time((len(rounds[0]) - began) * own, [sum(times[began:]) for times in rounds])
    found = block_times(rounds, own)
    cores = f"{threads} thread" + "s" * (threads > 1)
    name, blocks = f"many-strings/{threads}", {"median": found["median"], "worst": found["worst"]}
    rows = [
        row(name, f"64 tanpura strings at standard, all touching, {cores}", "× real time", *reached),
        row(f"{name}/block-128", f"their worst block at 128 frames, {cores}", "of its time", found["worst"], None, blocks),
    ]
    noted(benchmark, "targets", rows=rows, touched=_touched(player), **found, **scenes.vectors_of(player.engine))


def _touched(player: scenes.Player) -> int:
    """How many of the strings are seen on their obstacle in the second after the last pluck; all, or no such scene."""
    on = np.zeros(scenes.MANY, bool)
    player.engine.reset()
    for number, _ in enumerate(player.blocks(32)):
        if number * 32 / scenes.RATE_HZ > scenes.first_full():
            found = scenes.touching(player.engine)
            on |= found
            if on.all() or number * 32 / scenes.RATE_HZ > scenes.first_full() + 1.0:
                break
    assert on.all(), f"only {on.sum()} of {on.size} strings touch"
    return int(on.sum())


@pytest.mark.parametrize(
    ("preset", "midi", "quality"),
    [("tanpura-light", 36, "standard"), ("tanpura-light", 36, "fine"), ("fretted-bass", 28, "standard")],
)
def test_decay(race: Race, preset: str, midi: int, quality: str) -> None:
    """A note held for a minute, second by second: mode-steps and CPU time of the last against those of the first."""
    player = scenes.note(preset, midi, 100, quality, 60.0)
    work = np.zeros(60)
    spent: list[np.ndarray] = []

    def play() -> None:
        player.engine.reset()
        out = np.zeros((scenes.RATE_HZ // 50, 2))
        events, times = player.events, np.zeros(60)
        done = 0
        for second in range(60):
            started = time.process_time()
            for _ in range(50):
                player.engine.process(events, out)
                events = events[:0]
            times[second] = time.process_time() - started
            work[second] = player.engine.mode_steps - done
            done += int(work[second])
        spent.append(times)

    rounds = 3
    race(play, rounds=rounds)
    seconds = np.array(spent[-rounds:])
    ratios = seconds[:, -1] / seconds[:, 0]
    label = f"last second of 60 against the first, {preset} {midi_to_note(midi)} at {quality}"
    name = f"decay/{preset}/{midi_to_note(midi)}/{quality}"
    rows = [
        row(f"{name}/mode-steps", f"{label}, mode-steps", "of the first", work[-1] / work[0], None),
        row(f"{name}/cpu", f"{label}, CPU time", "of the first", float(np.median(ratios)), float(ratios.min())),
        row(f"{name}/slowest", "its slowest second, mode-steps", "of the first", work.max() / work[0], None),
    ]
    vectors = scenes.vectors_of(player.engine)
    race.note("targets", rows=rows, mode_steps=work.tolist(), cpu_s=np.median(seconds, axis=0).tolist(), **vectors)
