"""Tables of a run: what pytest-benchmark's JSON says, as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from statistics import median
from typing import Any

from speed_error.tables import number, rate, table

from benchmarks.aims import aim_of
from benchmarks.count import times_less, verdict

#: in the order of the report
SECTIONS = (
    "against",
    "targets",
    "batch",
    "gestures",
    "peak",
    "kernels",
    "strings",
    "notes",
    "blocks",
    "start",
    "cold",
    "memory",
    "float32",
)
#: their tables say by which vectors their figures were reached
OF_VECTORS = ("against", "batch", "targets", "kernels", "strings", "notes", "blocks", "float32")
#: what else a section's table is made of
ALSO = {"targets": ("kernels",)}
#: free flight is held against the machine's multiply-adds with so many modes
_FREE_MODES = (137, 1001)
#: aimed at, and named as not measured where a whole run has no row whose name begins so: what, unit
WANTED = {
    "several-steps/press_blocks/": ("a kernel of several steps against the plain loop, one contact", "times less"),
    "many-strings/2": ("64 tanpura strings at standard, all touching, 2 threads", "× real time"),
}


def figures(recorded: dict[str, Any]) -> list[dict[str, Any]]:
    """The figures of every benchmark in a JSON document of pytest-benchmark."""
    return [bench["extra_info"] for bench in recorded["benchmarks"] if "section" in bench["extra_info"]]


def of(found: Iterable[dict[str, Any]], section: str) -> list[dict[str, Any]]:
    """Those of one section."""
    return [info for info in found if info["section"] == section]


def by_vectors(found: Iterable[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Figures that were measured in one precision with one width of vectors, together, in the order in which these came."""
    groups: dict[tuple[str, int], list[dict[str, Any]]] = {}
    for info in found:
        groups.setdefault((info["precision"], info["lanes"]), []).append(info)
    return list(groups.values())


def target_rows(found: list[dict[str, Any]], whole: bool) -> list[dict[str, Any]]:
    """Rows of the table of targets; `whole`: what a whole run should have and has not is a row too."""
    rows = []
    for modes in _FREE_MODES:
        free = [
            info
            for info in of(found, "kernels")
            if (info["sweep"], info["modes"], info["contacts"]) == ("grid", modes, 0) and info["kernel"] != "naive loop"
        ]
        if free:
            best = max(free, key=lambda info: info["part"])
            what = f"{best['kernel']} in free flight with output, {modes} modes: part of the peak of multiply-adds"
            rows.append({
                "name": f"free-flight/{modes}", "what": what, "unit": "", "reached": best["part"],
                "best": best["best_part"], "figure": None,
            })  # fmt: skip
    given = [row for info in of(found, "targets") for row in info["rows"]]
    if whole:
        for name, (what, unit) in WANTED.items():
            if not any(row["name"].startswith(name) for row in given):
                rows.append({"name": name, "what": what, "unit": unit, "reached": None, "best": None, "figure": None})
    return rows + given


def _targets(found: list[dict[str, Any]], whole: bool) -> str:
    lines = []
    for row in target_rows(found, whole):
        unit, aim = row["unit"], aim_of(row["name"])
        target = "–" if aim is None else f"{'≤' if aim.at_most else '≥'} {aim.value:g} {unit}".strip()
        reached = "–" if row["reached"] is None else f"{number(row['reached'], 3)} {unit}".strip()
        lines.append([row["what"], target, reached, number(row["best"], 3), verdict(row["reached"], aim)])
    return table(["what", "target", "reached (median)", "best", ""], lines)


def _peak(found: list[dict[str, Any]]) -> str:
    lines = [
        [
            f"{info['lanes']} × {info['precision']}",
            number(info["fma_per_s"] / 1e9, 3),
            number(info["best_fma_per_s"] / 1e9, 3),
        ]
        for info in sorted(of(found, "peak"), key=lambda info: -info["lanes"])
    ]
    return table(["vectors of", "10⁹ multiply-adds a second", "best"], lines)


def _kernels(found: list[dict[str, Any]], sweep: str) -> str:
    lines = []
    for info in of(found, "kernels"):
        if info["sweep"] == sweep:
            lines.append([info["kernel"], info["scheme"], *(str(info[what]) for what in ("contacts", "modes", "voices"))])
            lines[-1] += [number(info[what] / 1e9) for what in ("mode_steps_per_s", "best_mode_steps_per_s")]
            counted = [str(info["fma"]), *(number(info[what]) for what in ("part", "best_part", "part_of_narrow"))]
            lines[-1] += counted if info["looks_at_all"] else ["–"] * len(counted)
    head = ["kernel", "scheme", "contacts", "modes", "strings", "10⁹ mode-steps a second", "best", "multiply-adds each"]
    return table([*head, "part of peak", "best", "of the peak of 4"], lines) if lines else ""


def _notes(found: list[dict[str, Any]]) -> str:
    qualities = list(dict.fromkeys(info["quality"] for info in of(found, "notes")))
    cells: dict[tuple[str, str], dict[str, str]] = {}
    for info in of(found, "notes"):
        here = cells.setdefault((info["preset"], info["note"]), {})
        here[info["quality"]] = f"{number(info['times_real_time'])} ({info['rate_hz'] / 1e3:.1f} kHz, {info['modes']} modes)"
    lines = [[preset, note, *(row.get(q, "–") for q in qualities)] for (preset, note), row in cells.items()]
    return table(["preset", "note", *qualities], lines)


def _strings(found: list[dict[str, Any]]) -> str:
    lines = [
        [str(info["strings"]), str(info["sounding"]), number(1e3 * info["cpu_per_s"]), number(1.0 / info["cpu_per_s"]),
         number(1.0 / info["best_cpu_per_s"])]
        for info in of(found, "strings")
    ]  # fmt: skip
    return table(["strings", "sounding", "CPU ms for a second", "× real time", "best"], lines)


def _blocks(found: list[dict[str, Any]]) -> str:
    lines = [
        [info["scene"], str(info["block"]), str(info["blocks"]), number(info["median"]), number(info["percentile_999"]),
         number(info["worst"]), number(info["worst_once"]), number(info["stall"])]
        for info in of(found, "blocks")
    ]  # fmt: skip
    head = ["scene", "frames", "blocks", "median", "99.9 %", "worst", "worst with stalls", "worst stall of an empty loop"]
    return table(head, lines)


def _start(found: list[dict[str, Any]]) -> str:
    lines = []
    for info in of(found, "start"):
        lines.append([info["what"], f"{number(info['median'])} s", f"{number(info['best'])} s"])
    return table(["what", "median", "best"], lines)


def _cold(found: list[dict[str, Any]]) -> str:
    lines = []
    for info in of(found, "cold"):
        for tree, starts in info["trees"].items():
            cpu, wall, kernels = (median(values) for values in zip(*starts, strict=True))
            lines.append([info["what"], tree, f"{number(cpu)} s", f"{number(wall)} s", f"{kernels:.0f}"])
            lines[-1].append(f"{len(starts)} of {info['processors']} processors")
    return table(["with nothing compiled", "of", "CPU", "wall clock", "kernels", "runs"], lines)


def _against(found: list[dict[str, Any]]) -> str:
    lines = []
    for info in of(found, "against"):
        ratio, best = times_less(info["seconds"], info["theirs"])
        lines.append(
            [info["what"], info["commit"], *(f"{number(1e3 * median(s), 3)} ms" for s in (info["theirs"], info["seconds"]))]
        )
        lines[-1] += [f"{number(ratio, 3)} ×", f"{number(best, 3)} ×", f"{number(info['work'], 3)} ×"]
        lines[-1].append(f"{len(info['seconds'])}, {info['clock']}")
    return table(["what", "commit", "then", "now", "times faster (median)", "best", "mode-steps then", "rounds"], lines)


def of_bare(info: dict[str, Any]) -> float:
    """Notes a second of a batch, as part of as many bare engines as it has threads."""
    return times_less(info["seconds"], info["bare"])[0] / float(info["threads"])


def _batch(found: list[dict[str, Any]]) -> str:
    lines = []
    for info in of(found, "batch"):
        rates = (info["notes"] / median(info[name]) for name in ("bare", "seconds", "whole"))
        share = of_bare(info)
        lines.append([info["preset"], str(info["threads"]), str(info["notes"]), *(number(one, 3) for one in rates)])
        lines[-1] += [number(share), verdict(share, aim_of("batch/"))]
    head = ["preset", "threads", "notes of 3 s", "bare, one thread", "batch", "with preparing", "part of threads × bare"]
    return table([*head, ""], lines)


def _gestures(found: list[dict[str, Any]]) -> str:
    lines = []
    for info in sorted(of(found, "gestures"), key=lambda info: -max(info["vibrato"], info["bend"])):
        lines.append([info["preset"], "yes" if info["coupled"] else "no", number(info["times_real_time"], 3)])
        lines[-1] += [number(info[name], 3) for name in ("vibrato", "bend")]
        lines[-1].append(verdict(max(info["vibrato"], info["bend"]), aim_of("gesture/")))
    head = ["preset", "coupled", "the plain note, × real time", "under vibrato, of its cost", "under a bend that moves"]
    return table([*head, ""], lines)


def _memory(found: list[dict[str, Any]]) -> str:
    lines = []
    for info in of(found, "memory"):
        lines += [
            ["engine and its libraries loaded", f"{info['import']:.0f} MiB"],
            ["prepared and played 5 s (drone)", f"{info['prepared']:.0f} MiB"],
            [f"growth over {info['seconds_played']} s more", f"{info['growth']:.2f} MiB"],
            ["most at any time", f"{info['peak']:.0f} MiB"],
        ]
    return table(["resident memory", ""], lines)


def _float32(found: list[dict[str, Any]]) -> str:
    here = of(found, "float32")
    speed = [
        [str(info["modes"]), info["scene"], *map(number, info["faster"])]
        for info in sorted((i for i in here if i["what"] == "speed"), key=lambda info: info["modes"])
    ]
    errors = []
    for info in here:
        if info["what"] == "error":
            two_step = "stands still" if info["two_step"] is None else number(abs(info["two_step"]))
            errs = info["errors"]
            against = [number(errs["against_double"]), number(errs["last_second"])]
            against += [number(errs[name], 3) for name in ("own", "against_reference")]
            cells = [*against, number(errs["drift_cents"]), number(errs["decay"])]
            errors.append([info["label"], rate(info["rate_hz"]), str(info["modes"]), *cells, two_step])
    parts = []
    if speed:
        parts.append(table(["modes", "string", "times faster", "best"], speed))
    if errors:
        head = ["tanpura", "rate", "modes", "e against float64, 3 s", "second 60", "e of float64", "e of float32"]
        parts.append(table([*head, "drift, cents", "decay off by, 1/s", "two-step form, cents"], errors))
    return "\n".join(parts)


def markdown(found: list[dict[str, Any]], machine: str, whole: bool = True) -> str:
    """tables.md; sections without figures are left out. Figures of different vectors have tables of their own."""
    present = {info["section"] for info in found}
    parts = [
        f"# Speed\n\nOne core of: {machine}. Everything compared was measured in one run, its rounds interleaved; medians, "
        "and best beside them.\n"
    ]
    texts: dict[str, tuple[str, str, Callable[[list[dict[str, Any]]], str]]] = {
        "against": (
            "Against another commit",
            "The same events and presets, those of the commit; kernels compiled before, round by round in turn.",
            _against,
        ),
        "targets": ("What was aimed at", "", partial(_targets, whole=whole)),
        "batch": (
            "Many notes at once",
            "Notes a second, by the wall clock: of the engine alone with all notes prepared, of `render_notes` with what "
            "prepared its engines taken off, and of the whole call.",
            _batch,
        ),
        "gestures": (
            "Bends and vibrato",
            "Processor time of a note of the middle, 1.5 s in blocks of 64, under a modulation wheel that is up and under a "
            "bend wheel that moves all the time, over that of the same note without. Each block counts with the least of "
            "its times.",
            _gestures,
        ),
        "peak": ("The machine's peak", "Independent chains of fused multiply-adds, one core.", _peak),
        "kernels": (
            "Kernels",
            "A mode's free step counts as two multiply-adds, each projection, on a contact or the output, as one; what "
            "forces add is not counted. The peak is measured in the same rounds.",
            lambda infos: "\n".join(text for sweep in ("grid", "contacts", "voices") if (text := _kernels(infos, sweep))),
        ),
        "strings": ("Strings at once", "Tanpura strings at `standard`, all plucked, through the engine.", _strings),
        "notes": ("Notes", "× real time of one string through the engine, from the pluck on, 1.5 s.", _notes),
        "blocks": (
            "Blocks",
            "Wall-clock time of a block, as part of what it lasts. Median to worst: each block's least of several runs, "
            "which is what repeats. The empty loop takes as long as a median block and does nothing.",
            _blocks,
        ),
        "start": ("Start-up", "Whole processes, wall-clock time.", _start),
        "cold": ("First start", "Whole processes with an empty cache, their children's time counted in.", _cold),
        "memory": ("Memory", "", _memory),
        "float32": (
            "Modes in float32",
            "Block kernels over one contact with one output; forces and contact in float64. e of float64 and of float32: "
            "3 s against the case's reference. Drift: of the worst mode in free flight, 60 s (at 2 MHz 3 s). Decay: of the "
            "worst of 20 modes. Two-step form: by what rounded coefficients of x⁺ = a x − e x⁻ would detune mode 1.",
            _float32,
        ),
    }
    for section in SECTIONS:
        if section not in present and not (section == "targets" and "kernels" in present):
            continue
        title, words, write = texts[section]
        parts.append(f"\n## {title}\n")
        if words:
            parts.append(words + "\n")
        if section not in OF_VECTORS:
            parts.append(write(of(found, section)))
            continue
        for infos in by_vectors(info for info in found if info["section"] in (section, *ALSO.get(section, ()))):
            if text := write(infos):
                parts.append(f"Vectors of {infos[0]['lanes']} numbers in {infos[0]['precision']}:\n\n{text}")
    return "\n".join(parts)
