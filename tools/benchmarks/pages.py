"""Tables of the documentation's pages, made from the history alone: of one version on one machine."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from documentation import page
from speed_error.tables import number, table

from benchmarks import REPOSITORY, report
from benchmarks.aims import aim_of
from benchmarks.history import Run

SPEED, README = page.DOCS / "speed.md", REPOSITORY / "README.md"
#: presets whose notes the history keeps, lowest, middle and highest
NOTES = {"tanpura-light": ("C2", "G2", "C3"), "fretted-bass": ("E1", "G2", "D#4"), "jawari-harp": ("E1", "D4", "C7")}
QUALITIES = ("draft", "standard", "fine")
FRAMES = (64, 128, 256)
#: scenes of blocks, by what the page calls them
SCENES = {
    "drone": "`presets/demos/drone.mid`, tanpura-light, 64, 128 and 256 frames, share of its time",
    "bassline": "`presets/demos/bassline.mid`, fretted-bass, likewise",
}


class Line(NamedTuple):
    """A row: what it is of, the figures that stand in its cells one after the other, and their unit.

    spread: instead of each figure, the least and the most of all whose names begin with one of `names`; worst: instead of
    each, the largest of these, and the end of its name.
    """

    what: str
    names: tuple[str, ...]
    unit: str = ""
    spread: bool = False
    worst: bool = False

    @property
    def aim(self) -> str:
        """What was aimed at, with its unit; where figures of the row have different aims, one after the other."""
        aims = list(dict.fromkeys(aim for aim in map(aim_of, self.names) if aim is not None))
        if not aims:
            return "–"
        values = "; ".join(number(aim.value, 3) for aim in aims)
        return f"{'≤' if aims[0].at_most else '≥'} {values} {self.unit}".strip()

    def cell(self, run: Run) -> str:
        """What a run reached; bold where it misses its aim."""
        found = run.figures
        if self.spread or self.worst:
            some = [(name, figure) for name, figure in found.items() if name.startswith(self.names)]
            if not some:
                return "–"
            if self.worst:
                value, name = max((_value(figure, "worst"), name) for name, figure in some)
                return f"{_marked(value, name)} {self.unit} ({name.rpartition('/')[2]})".replace("  ", " ")
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
_SONGS = tuple(Line(f"worst block of {what}", tuple(f"block/{scene}/{f}" for f in FRAMES)) for scene, what in SCENES.items())
_COUPLED = tuple(
    Line(f"{', '.join(names)}: twelve notes from low to high", tuple(f"twelve/{name}" for name in names), "×")
    for names in (("sitar",), ("veena",), ("steel-guitar", "nylon-guitar"), ("double-bass", "banjo"))
)
_STRUMMED = Line(
    "steel-guitar, nylon-guitar: six-string chords strummed without end",
    ("strummed/steel-guitar", "strummed/nylon-guitar"),
    "×",
)
_SIXTY = Line(
    "60 coupled strings on nine bridges (a sitar with its tarafs, a veena, two guitars, a banjo, four tanpuras), blocks of "
    "64 frames: median; worst, share of its time",
    ("sixty/median", "sixty/worst"),
)
_SIXTY_BY_TWO = Line("the same, 2 cores, by the wall clock", ("sixty/2/median", "sixty/2/worst"))
TARGETS = (
    *_COUPLED,
    _STRUMMED,
    _SIXTY,
    _SIXTY_BY_TWO,
    Line("vibrato, cost over that of the plain note, the worst of all presets", ("gesture/vibrato/",), "×", worst=True),
    Line("a bend wheel that moves all the time, likewise", ("gesture/bend/",), "×", worst=True),
    _TANPURA,
    Line(
        "speed-up of the block kernel over the one-step kernel, one contact, 137 modes; 1001 modes",
        ("several-steps/press_blocks/137", "several-steps/press_blocks/1001"),
    ),
    Line(
        "free flight with output, share of the machine's peak multiply-add rate, 137 modes; 1001 modes",
        ("free-flight/137", "free-flight/1001"),
    ),
    Line("the paper's tanpura reference, Moreau–Jean, 1001 modes, 2.12 MHz", ("published/moreau-jean",), "×"),
    Line("the paper's bass, 20 frets, all 863 modes, 1.06 MHz, the 0.1 s with contacts", ("paper-bass",), "×"),
    _BASS,
    Line("a fretless note of 3 s (`simulate` at `standard`)", ("fretless-note",), "×"),
    _MANY,
    Line("the same, 2 cores", ("many-strings/2",), "×"),
    Line(
        "worst block of these strings, 128 frames, share of its time, 1 core; 2 cores",
        ("many-strings/1/block-128", "many-strings/2/block-128"),
    ),
    *_SONGS,
    Line(
        "many notes at once, share of cores × the bare engine, jawari-harp on 1 core, 2 cores; fretted-bass likewise",
        tuple(f"batch/{preset}/{threads}" for preset in ("jawari-harp", "fretted-bass") for threads in (1, 2)),
    ),
    Line(
        "last second of a 60 s decay, mode-steps, share of the first second's",
        ("decay/tanpura-light/C2/standard/mode-steps",),
    ),
)  # fmt: skip
_NAIVE = Line("the same model in a plain Numba loop, mode after mode", ("tanpura-kernel/by the naive loop",), "×")
SHORT = (
    _TANPURA,
    _NAIVE,
    _BASS,
    _MANY,
    Line("sitar; steel guitar with its body: twelve notes", ("twelve/sitar", "twelve/steel-guitar"), "×"),
    _STRUMMED,
)


class Beside(NamedTuple):
    """A row of what a user might run instead: what is played, the names of our figures, what is known of our error, and what
    else plays it, each with the name of its figure or its speed as it was published."""

    what: str
    ours: tuple[str, ...]
    error: str
    others: tuple[tuple[str, str], ...]

    def cells(self, run: Run) -> list[str]:
        """The row of a run; empty where it has none of our figures, or none of the others'."""
        ours, others = Line("", self.ours).cell(run), []
        for words, of in self.others:
            if of.startswith(_PUBLISHED):
                others.append((words, of.removeprefix(_PUBLISHED)))
            elif of in run.figures:
                others.append((words, Line("", (of,)).cell(run)))
        if ours == "–" or not others:
            return []
        return [self.what, ours, self.error, *("; ".join(each) for each in zip(*others, strict=True))]


_PUBLISHED = "published "


def _qualities(what: str, name: str, error: str) -> Beside:
    ours = tuple(f"beside/{name}/{quality}" for quality in QUALITIES)
    others = ("Karplus–Strong", "Karplus–Strong loop"), ("FluidSynth", "FluidSynth")
    return Beside(
        f"{what}, `{'`; `'.join(QUALITIES)}`", ours, error, tuple((words, f"beside/{name}/{each}") for words, each in others)
    )


_RINGING = {"steel-guitar": "six open strings, frets, body", "sitar": "four struck strings, 13 tarafs, bridge, body"}
_ON_BRIDGE = "e < 0.3; 0.1; 0.02 over 3 s"
BESIDE = (
    *(
        Beside(
            f"{name} ringing: {what}; engine, `standard`", (f"ringing/{name}",), "that of the loop",
            (("the same physics in a plain Numba loop", f"ringing/{name}/plain loop"),),
        )
        for name, what in _RINGING.items()
    ),
    Beside(
        "tanpura string over its bridge, 44.1 kHz, 103 modes, kernel with output", ("tanpura-kernel",), "e = 0.05 over 3 s",
        (
            ("the same physics in a plain Numba loop", "tanpura-kernel/by the naive loop"),
            ("the paper's MATLAB, Moreau–Jean, 1.06 MHz, e = 0.17", f"{_PUBLISHED}1/142"),
        ),
    ),
    Beside(
        "the paper's bass, 20 frets, 863 modes, 1.06 MHz, its first 0.1 s", ("paper-bass",), "e = 0.035 over 0.1 s",
        (("the paper's C++ (Siconos)", f"{_PUBLISHED}1/300"), ("its MATLAB", f"{_PUBLISHED}1/3000")),
    ),
    _qualities("tanpura, a note", "tanpura-light", _ON_BRIDGE),
    _qualities("fretted bass, a note", "fretted-bass", "spectrum within 6; 3; 1.5 dB"),
    _qualities("steel guitar with its body, strummed chords", "steel-guitar", "spectrum within 6 dB"),
    _qualities("sitar with its tarafs, twelve notes", "sitar", _ON_BRIDGE),
)  # fmt: skip
#: every figure that a page shows by its name
SHOWN = frozenset(name for line in (*TARGETS, *SHORT) for name in line.names if not line.spread and not line.worst) | {
    name for line in BESIDE for name in (*line.ours, *(of for _, of in line.others if not of.startswith(_PUBLISHED)))
}


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
        for info in report.of(infos, "gestures"):
            for gesture in ("vibrato", "bend"):
                here[f"gesture/{gesture}/{info['preset']}"] = {"median": info[gesture]}
        for info in report.of(infos, "batch"):
            here[f"batch/{info['preset']}/{info['threads']}"] = {"median": report.of_bare(info)}
        for info in report.of(infos, "peak"):
            here["peak"] = {"median": info["fma_per_s"], "best": info["best_fma_per_s"]}
        if set(here) - {"peak"}:
            rounded = {name: {k: float(f"{v:.4g}") for k, v in figure.items()} for name, figure in here.items()}
            kept[precision, lanes] = rounded
    return kept


def newest_whole(runs: Sequence[Run], lines: Sequence[Line]) -> Run:
    """The figures of one version on one machine, of all precisions: of those with the most of these rows the newest, so that
    a run of a few pieces does not empty a table. Raises ValueError where there are no runs."""
    if not runs:
        raise ValueError(
            "tools/benchmarks/history.jsonl has no runs, so there is nothing to publish: record one with --record"
        )
    versions: dict[tuple[Any, ...], Run] = {}
    for run in runs:
        key = run.machine.same, run.commit or run.version
        before = versions.pop(key, run)
        versions[key] = replace(run, figures={**before.figures, **run.figures})
    rank = {key: sum(line.cell(run) != "–" for line in lines) for key, run in versions.items()}
    return max(enumerate(versions.items()), key=lambda each: (rank[each[1][0]], each[1][1].date, each[0]))[1][1]


def _machine(run: Run) -> str:
    """A line about what a table was measured on."""
    machine = run.machine
    size = {level: f"{size // 1024} MiB" if size >= 1024 else f"{size} KiB" for level, size in machine.caches.items()}
    about = [f"{machine.cores} cores"] * bool(machine.cores) + [f"{level} {text}" for level, text in size.items()]
    when = [f"version {run.version}"] + [run.commit] * bool(run.commit) + [run.date] * bool(run.date)
    note = f" ({run.note})" if run.note else ""
    return f"{machine.words}{''.join(f', {each}' for each in about)}; {', '.join(when)}{note}."


def _short(run: Run) -> str:
    rows = [[line.what, line.aim, line.cell(run)] for line in SHORT]
    column = f"{run.machine.short}, version {run.version}"
    return table(["× real time, one core (bold: misses its aim)", "aim", column], rows)


def _targets(run: Run) -> str:
    rows = [[line.what, line.aim, cell] for line in TARGETS if (cell := line.cell(run)) != "–"]
    return f"{_machine(run)}\n\n{table(['what (×: times real time)', 'aim', 'reached'], rows)}"


def _beside(run: Run) -> str:
    rows = [cells for line in BESIDE if (cells := line.cells(run))]
    head = ["what is played", "ours, × real time", "our error", "instead", "its × real time"]
    return f"{_machine(run)}\n\n{table(head, rows)}"


def parts(runs: Sequence[Run]) -> dict[Path, dict[str, str]]:
    """What the pages say of the history: page → name of a place there → text (`documentation.page`). Raises ValueError
    for a history without runs."""
    ours = [Line("", line.ours) for line in BESIDE]
    return {
        SPEED: {"beside": _beside(newest_whole(runs, ours)), "targets": _targets(newest_whole(runs, TARGETS))},
        README: {"speed": _short(newest_whole(runs, SHORT))},
    }


def publish(runs: Sequence[Run]) -> None:
    """Write the pages' tables. Raises ValueError, and OSError."""
    for path, texts in parts(runs).items():
        page.put(texts, path)
