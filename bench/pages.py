"""Tables of the documentation's pages, made from the history alone: a row a figure, a column a machine."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from documentation import page
from documentation.machine import Machine
from speed_error.tables import number, table

from bench import REPOSITORY, report
from bench.aims import aim_of
from bench.history import BITS, Run
from synth import __version__

SPEED, README = page.DOCS / "speed.md", REPOSITORY / "README.md"
#: presets whose notes the page shows, lowest, middle and highest
NOTES = {"tanpura": ("C2", "G2", "C3"), "fretted-bass": ("E1", "G2", "D#4"), "jawari-harp": ("E1", "D4", "C7")}
QUALITIES = ("draft", "standard", "fine")
FRAMES = (64, 128, 256)
#: scenes of blocks, by what the page calls them
SCENES = {
    "drone": "`presets/demos/drone.mid`, tanpura", "bassline": "`presets/demos/bassline.mid`, fretted-bass",
    "64-strings": "64 tanpura strings",
}  # fmt: skip


class Line(NamedTuple):
    """A row: what it is of, the figures that stand in its cells one after the other, and their unit.

    spread: instead of each figure, the least and the most of all whose names begin with one of `names`.
    """

    what: str
    names: tuple[str, ...]
    unit: str = ""
    spread: bool = False

    @property
    def aim(self) -> str:
        """What was aimed at, with its unit."""
        aim = aim_of(self.names[0])
        if aim is None:
            return "–"
        return f"{'≤' if aim.at_most else '≥'} {number(aim.value, 3)} {self.unit}".strip()

    def cell(self, run: Run) -> str:
        """What a run reached; bold where it misses its aim."""
        found = run.figures
        if self.spread:
            some = [(name, figure) for name, figure in found.items() if name.startswith(self.names)]
            if not some:
                return "–"
            least = min((_value(figure, "least"), name) for name, figure in some)
            most = max((_value(figure, "most"), name) for name, figure in some)
            return f"{_marked(*least)} to {_marked(*most)} {self.unit}".strip()
        if not any(name in found for name in self.names):
            return "–"
        values = [_marked(_value(found[name], "worst"), name) if name in found else "–" for name in self.names]
        return f"{'; '.join(values)} {self.unit}".strip()


def _value(figure: Any, kind: str) -> float:
    return float(figure.get(kind, figure.get("median", figure.get("least"))))


def _marked(value: float, name: str) -> str:
    aim = aim_of(name)
    return number(value, 3) if aim is None or aim.met(value) else f"**{number(value, 3)}**"


_TANPURA = Line(
    "tanpura string, 44.1 kHz, 103 modes, touching, e < 0.1 over 3 s: kernel with output", ("tanpura-kernel",), "×"
)
_BASS = Line(
    "bass notes of 3 s through the engine at `standard`: E1, D2, D3 at velocities 64 and 110",
    ("bass-note/",),
    "×",
    spread=True,
)
_MANY = Line("64 tanpura strings at `standard`, all sounding and touching, 1 core", ("many-strings/1",), "×")
_BASSLINE = Line(
    "worst block of a bass line, 64, 128 and 256 frames, share of its time", tuple(f"block/bassline/{f}" for f in FRAMES)
)
TARGETS = (
    _TANPURA,
    Line(
        "the same by the one-step kernel; by a naive loop",
        ("tanpura-kernel/by the plain loop", "tanpura-kernel/by the naive loop"), "×",
    ),
    Line(
        "speed-up of the block kernel over the one-step kernel, one contact, 137 modes; 1001 modes",
        ("several-steps/press_blocks/137", "several-steps/press_blocks/1001"),
    ),
    Line(
        "free flight with output, share of the machine's peak multiply-add rate, 137 modes; 1001 modes",
        ("free-flight/137", "free-flight/1001"),
    ),
    Line(
        "the paper's tanpura reference, Moreau–Jean, 1001 modes, 2.12 MHz (the authors' C++: 1/217)",
        ("published/moreau-jean",), "×",
    ),
    Line(
        "the paper's bass, 20 frets, all 863 modes, 1.06 MHz, the 0.1 s with contacts (the paper's C++: 1/300)",
        ("paper-bass",), "×",
    ),
    _BASS,
    Line("a fretless note of 3 s (`simulate` at `standard`)", ("fretless-note",), "×"),
    _MANY,
    Line("the same, 2 cores", ("many-strings/2",), "×"),
    Line(
        "worst block of these strings, 128 frames, share of its time, 1 core; 2 cores",
        ("many-strings/1/block-128", "many-strings/2/block-128"),
    ),
    Line(
        "many notes at once, share of cores × the bare engine, jawari-harp on 1 core, 2 cores; fretted-bass likewise",
        tuple(f"batch/{preset}/{threads}" for preset in ("jawari-harp", "fretted-bass") for threads in (1, 2)),
    ),
    Line("last second of a 60 s decay, mode-steps, share of the first second's", ("decay/tanpura/C2/standard/mode-steps",)),
)  # fmt: skip
BLOCKS = tuple(Line(what, tuple(f"block/{scene}/{frames}" for frames in FRAMES)) for scene, what in SCENES.items())
OF_NOTES = tuple(
    Line(f"{preset} {', '.join(notes)}, {quality}", tuple(f"note/{preset}/{note}/{quality}" for note in notes))
    for preset, notes in NOTES.items()
    for quality in QUALITIES
)
_NAIVE = Line("the same model in a plain Numba loop, mode after mode", ("tanpura-kernel/by the naive loop",), "×")
SHORT = (_TANPURA, _NAIVE, _BASS, _MANY, _BASSLINE)
#: every figure that a page shows by its name
SHOWN = frozenset(name for line in (*TARGETS, *BLOCKS, *OF_NOTES) for name in line.names if not line.spread)


def figures_of(found: Iterable[dict[str, Any]]) -> dict[tuple[str, int], dict[str, dict[str, float]]]:
    """What the history keeps of a run's figures: (precision, lanes) → name → figure."""
    kept: dict[tuple[str, int], dict[str, dict[str, float]]] = {}
    for infos in report.by_vectors(found):
        precision, lanes = infos[0]["precision"], infos[0]["lanes"]
        here: dict[str, dict[str, float]] = {}
        for row in report.target_rows(infos, whole=False):
            here[row["name"]] = row["figure"] or {"median": row["reached"]} | (
                {} if row["best"] is None else {"best": row["best"]}
            )
        for info in report.of(infos, "blocks"):
            name = f"block/{info['scene'].replace(' ', '-')}/{info['block']}"
            here[name] = {"median": info["median"], "worst": info["worst"]}
        for info in report.of(infos, "notes"):
            if info["preset"] in NOTES:
                name = f"note/{info['preset']}/{info['note']}/{info['quality']}"
                here[name] = {"median": info["times_real_time"], "best": info["best"]}
        for info in report.of(infos, "batch"):
            here[f"batch/{info['preset']}/{info['threads']}"] = {"median": report.of_bare(info)}
        for info in report.of(infos, "peak"):
            here["peak"] = {"median": info["fma_per_s"], "best": info["best_fma_per_s"]}
        if set(here) - {"peak"}:
            rounded = {name: {k: float(f"{v:.4g}") for k, v in figure.items()} for name, figure in here.items()}
            kept[precision, lanes] = rounded
    return kept


def chosen(runs: Sequence[Run]) -> list[Run]:
    """One run of each machine, precision and width, in the order in which these came: of those with the most figures
    that are shown the newest, so that a run of a few pieces does not empty a column."""
    best: dict[tuple[Any, ...], tuple[tuple[int, str, int], Run]] = {}
    for place, run in enumerate(runs):
        column = run.machine.same, run.precision, run.lanes
        rank = len(SHOWN & set(run.figures)), run.date, place
        if column not in best or rank > best[column][0]:
            best[column] = rank, run
    return [run for _, run in best.values()]


def newest_whole(runs: Sequence[Run]) -> Run:
    """The figures of one version on one machine, of all precisions: of those with the most rows of `SHORT` the newest."""
    versions: dict[tuple[Any, ...], Run] = {}
    for run in runs:
        key = run.machine.same, run.commit or run.version
        before = versions.pop(key, run)
        versions[key] = replace(run, figures={**before.figures, **run.figures})
    return max(enumerate(versions.values()), key=lambda each: (_complete(each[1]), each[1].date, each[0]))[1]


def _complete(run: Run) -> int:
    return sum(line.cell(run) != "–" for line in SHORT)


def _short(run: Run) -> str:
    rows = [[line.what, line.aim, line.cell(run)] for line in SHORT]
    column = f"{run.machine.short}, version {run.version}"
    return table(["× real time, one core (bold: misses its aim)", "aim", column], rows)


def _rows(lines: Sequence[Line], runs: Sequence[Run], head: str, aims: bool) -> str:
    rows = [[line.what, *([line.aim] if aims else []), *(line.cell(run) for run in runs)] for line in lines]
    return table([head, *(["aim"] if aims else []), *(run.column for run in runs)], rows)


def _machines(runs: Sequence[Run]) -> str:
    rows = []
    for run in runs:
        machine, peak = run.machine, run.figures.get("peak")
        caches = ", ".join(
            f"{level} {size // 1024} MiB" if size >= 1024 else f"{level} {size} KiB"
            for level, size in machine.caches.items()
        )
        when = ", ".join(part for part in (run.version, run.commit, run.date) if part)
        rows.append([
            run.column, machine.words, str(machine.cores or "–"), caches or "–",
            f"{run.lanes} × {run.precision} ({run.lanes * BITS[run.precision]} bit)",
            f"{number(peak['median'] / 1e9, 3)}" if peak else "–", f"{when}; {run.note}" if run.note else when,
        ])  # fmt: skip
    head = ["column", "processor", "cores", "caches of a core", "vectors", "10⁹ multiply-adds a second", "measured"]
    return table(head, rows)


def parts(runs: Sequence[Run]) -> dict[Path, dict[str, str]]:
    """What the pages say of the history: page → name of a place there → text (`documentation.page`). Raises ValueError
    for a history without runs."""
    some = chosen(runs)
    if not some:
        raise ValueError("bench/history.jsonl has no runs, so there is nothing to publish; record one with --record")
    return {
        SPEED: {
            "machine": _machines(some),
            "targets": _rows(TARGETS, some, "what (×: times real time)", True),
            "blocks": _rows(BLOCKS, some, "worst block, share of its time, one core; 64, 128 and 256 frames", False),
            "notes": _rows(OF_NOTES, some, "× real time of one string, from the pluck on", False),
        },
        README: {"speed": _short(newest_whole(runs))},
    }


def of_picture(machine: Machine) -> str:
    """What stands above the picture, which is of a whole run and not of the history."""
    return f"One core of: {machine.words}, version {__version__}."


def publish(runs: Sequence[Run]) -> None:
    """Write the pages' tables. Raises ValueError, and OSError."""
    for path, texts in parts(runs).items():
        page.put(texts, path)
