"""Rows as CSV and Markdown, the paper's table beside ours, and the ratios that are claimed."""

from __future__ import annotations

import csv
import io
import math
from typing import Any

from speed_error.grid import ALL_MODES, Run
from speed_error.session import Session
from synth.files.targets import write_text
from synth.solver.lanes import LANES

_MEASURED = (
    "e_0.1s", "e_0.4s", "e_3s", "e_band_0.1s", "e_band_0.4s", "e_band_3s",
    "spectral_distance_db", "spectral_distance_over_s", "last_contact_s", "contact_part", "penetration_m",
    "energy_rise", "energy_growth", "unsolved_steps", "mode_steps_per_s",
    "cpu_per_s", "cpu_per_s_median", "times_real_time", "times_real_time_decimated",
)  # fmt: skip
COLUMNS = ("case", "scheme", "rate_hz", "modes", "nodes", *_MEASURED)

#: Issanchou et al. 2018, table III: CPU seconds for 1 s of the two-point bridge with 1001 modes, MATLAB, 2.4 GHz, by
#: internal rate; and section IV B for 0.1 s of the bass at 1 MHz
PAPER = {
    "compliant, full grid": {1: 205.0, 2: 407.0, 4: 815.0, 24: 4326.0},
    "compliant, contact point only": {1: 108.0, 2: 208.0, 4: 372.0, 24: 1732.0},
    "nonsmooth (Moreau–Jean)": {1: 7.1, 2: 16.0, 4: 22.0, 24: 142.0},
}
PAPER_BASS = {"MATLAB": 300.0, "C++ (Siconos)": 30.0}


def csv_row(row: dict[str, Any]) -> dict[str, Any]:
    """One line of results.csv."""
    run: Run = row["run"]
    head = {"case": run.case, "scheme": run.label, "rate_hz": run.rate_hz, "modes": run.modes, "nodes": run.nodes or ""}
    return head | {name: row.get(name, "") for name in _MEASURED}


def number(value: float | None, digits: int = 2) -> str:
    """A figure of few digits without exponents where they can be avoided; – for none."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "blown up"
    if value >= 100.0:
        return f"{value:.0f}"
    if value == 0.0 or value >= 1e-4:
        return f"{float(f'{value:.{digits}g}'):.10g}"
    return f"{value:.0e}"


def rate(hz: float) -> str:
    """An internal rate with its unit."""
    return f"{hz / 1e6:.2f} MHz" if hz >= 1e6 else f"{hz / 1e3:.1f} kHz"


def table(head: list[str], lines: list[list[str]]) -> str:
    """A Markdown table."""
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n"


def case_table(session: Session, case: str) -> str:
    """Every run of a case: errors, cost."""
    rows = [row for row in session.rows if row["run"].case == case]
    with_nodes, with_long = case.startswith("fretless"), any("e_3s" in row for row in rows)
    head = ["scheme", "internal rate", "modes"] + ["points"] * with_nodes
    head += ["e, 0.1 s"] + ["e, 0.4 s"] * (not with_nodes) + ["e, 3 s"] * with_long
    head += ["audible e", "LSD", "penetration", "energy rise", "× real time", "decimated"]
    ours = {id(row) for row in session.default_rows(case)}
    lines = []
    for row in rows:
        run: Run = row["run"]
        label = f"**{run.label}**" if id(row) in ours else run.label
        line = [label, rate(run.rate_hz), str(run.modes)] + [str(run.nodes or "all")] * with_nodes
        line += [number(row.get("e_0.1s"))] + [number(row.get("e_0.4s"))] * (not with_nodes)
        line += [number(row.get("e_3s"))] * with_long
        longest = [row[f"e_band_{s}s"] for s in ("0.1", "0.4", "3") if f"e_band_{s}s" in row]
        lsd = row.get("spectral_distance_db")
        line += [number(longest[-1] if longest else None), "–" if lsd is None else f"{lsd:.1f} dB"]
        line += [f"{row['penetration_m'] * 1e6:.2g} µm" if math.isfinite(row["penetration_m"]) else "blown up"]
        line += [number(max(0.0, row.get("energy_rise", math.nan))), number(row["times_real_time"])]
        line += [number(row["times_real_time_decimated"])]
        lines.append(line)
    return table(head, lines)


def short_table(session: Session, case: str) -> str:
    """Every run of a case: the errors that are promised, and the kernel's speed."""
    rows = [row for row in session.rows if row["run"].case == case]
    with_nodes = case.startswith("fretless")
    spans = ["0.1", *(["3"] if any("e_3s" in row for row in rows) else [] if with_nodes else ["0.4"])]
    head = ["scheme", "internal rate", "modes"] + ["points"] * with_nodes + [f"e, {span} s" for span in spans]
    ours = {id(row) for row in session.default_rows(case)}
    lines = []
    for row in rows:
        run: Run = row["run"]
        lsd = row.get("spectral_distance_db")
        line = [f"**{run.label}**" if id(row) in ours else run.label, rate(run.rate_hz), str(run.modes)]
        line += [str(run.nodes or "all")] * with_nodes + [number(row.get(f"e_{span}s")) for span in spans]
        lines.append([*line, "–" if lsd is None else f"{lsd:.1f}", number(row["times_real_time"])])
    return table([*head, "LSD, dB", "× real time"], lines)


def reference_line(found: dict[str, Any]) -> str:
    """What a case's runs are compared with, and how far that is from itself."""
    run = found["run"]
    points = f", {run.nodes} points" if run.nodes else ""
    line = f"Reference: {run.label}, {run.modes} modes{points}, {rate(run.rate_hz)}. "
    for what, stands in found["stands"].items():
        shown = [f"{number(stands[k])} over {k[2:-1]} s" for k in ("e_0.1s", "e_0.4s", "e_3s") if k in stands]
        line += f"A run at {what} differs by e = {', '.join(shown)}, {stands['spectral_distance_db']:.1f} dB. "
    return line + f"Last contact: {number(found['values']['last_contact_s'])} s."


def parts(session: Session) -> dict[str, str]:
    """What docs/speed-error.md says of a whole run, by the names of its places there (`documentation.page`)."""
    found = {"machine": f"One core of: {session.machine}, vectors of {LANES} float64."}
    for case in ("tanpura", "bass", "fretless"):
        reference = session.references[case]
        found[case] = f"{reference_line(reference)}\n\n{short_table(session, case)}"
    found["ratios"] = "\n".join(f"- {line.split('; at least ')[0]}" for line in ratios(session))
    found["paper"] = paper_table(session)
    return found


def paper_table(session: Session) -> str:
    """The paper's table III with what the same schemes take here."""
    ours = {
        "compliant, full grid": lambda run: run.scheme == "compliant" and dict(run.table).get("grid") == "full",
        "compliant, contact point only": lambda run: run.scheme == "compliant" and dict(run.table).get("grid") != "full",
        "nonsmooth (Moreau–Jean)": lambda run: run.scheme == "moreau-jean" and dict(run.table).get("restitution") == 0.0,
    }
    lines = []
    for what, paper in PAPER.items():
        for factor, seconds in paper.items():
            cost = [
                row["cpu_per_s"]
                for row in session.rows + session.timed
                if row["run"].case == "tanpura"
                and ours[what](row["run"])
                and row["run"].factor == factor
                and row["run"].modes == ALL_MODES["tanpura"]
            ]
            here = f"{number(cost[0])} s" if cost else "–"
            ratio = number(seconds / cost[0]) if cost else "–"
            lines.append([f"tanpura, 1 s: {what}", rate(factor * 44100), f"{number(seconds, 4)} s", here, ratio])
    bass = [
        row["cpu_per_s"] * 0.1
        for row in session.rows
        if (row["run"].case, row["run"].scheme, row["run"].factor) == ("bass", "moreau-jean", 24)
        and row["run"].modes == ALL_MODES["bass"]
        and dict(row["run"].table).get("restitution") == 0.0
    ]
    for language, seconds in PAPER_BASS.items():
        here = f"{number(bass[0])} s" if bass else "–"
        ratio = number(seconds / bass[0]) if bass else "–"
        lines.append([f"bass, 0.1 s: nonsmooth, {language}", rate(24 * 44100), f"{seconds:g} s", here, ratio])
    for case, span in (("tanpura", 1.0), ("bass", 0.1)):
        kept = [row for row in session.default_rows(case) if row.get(f"e_{'3' if case == 'tanpura' else '0.1'}s", 9.0) < 0.1]
        if kept:
            row = min(kept, key=lambda row: row["cpu_per_s"])
            run = row["run"]
            where = f"{rate(run.rate_hz)}, {run.modes} modes"
            what = f"{case}, {span:g} s: **{run.label}**, cheapest run with e < 0.1"
            lines.append([what, where, "–", f"{number(row['cpu_per_s'] * span)} s", "–"])
    return table(["what", "internal rate", "paper", "here", "ratio"], lines)


def ratios(session: Session) -> list[str]:
    """The two ratios on the tanpura case, over 3 s, with what they are made of."""
    rows = [row for row in session.rows if row["run"].case == "tanpura" and "e_3s" in row]
    ours = [row for row in session.default_rows("tanpura") if "e_3s" in row]

    def cheapest(among: list[dict[str, Any]], limit: float) -> dict[str, Any] | None:
        return min((row for row in among if row["e_3s"] < limit), key=lambda row: row["cpu_per_s"], default=None)

    def versus(mine: dict[str, Any] | None, other: dict[str, Any] | None, limit: float, wanted: tuple[int, int]) -> str:
        if mine is None or other is None:
            return f"e < {limit:g} over 3 s: not reached by both in these runs"
        steps = other["mode_steps_per_s"] / mine["mode_steps_per_s"]
        cpu = other["cpu_per_s"] / mine["cpu_per_s"]
        median = other["cpu_per_s_median"] / mine["cpu_per_s_median"]
        one, two = mine["run"], other["run"]
        kept = "kept" if steps >= wanted[0] and cpu >= wanted[1] else "MISSED"
        return (
            f"e < {limit:g} over 3 s: {one.label}, {rate(one.rate_hz)}, {one.modes} modes, e = {number(mine['e_3s'])}; "
            f"against {two.label}, {rate(two.rate_hz)}, {two.modes} modes, e = {number(other['e_3s'])}: "
            f"{steps:.0f} times fewer mode-steps, {cpu:.0f} times less CPU time (medians: {median:.0f}); "
            f"at least {wanted[0]} and {wanted[1]} are claimed: {kept}"
        )

    full = ALL_MODES["tanpura"]
    printed = [r for r in rows if r["run"].scheme == "moreau-jean" and r["run"].factor == 48 and r["run"].modes == full]
    printed = [r for r in printed if dict(r["run"].table).get("restitution") == 0.0]
    filtered = [r for r in rows if r["run"].scheme == "moreau-jean-filtered" and r["run"].modes == full]
    filtered = [r for r in filtered if dict(r["run"].table).get("restitution") == 0.0]
    return [
        versus(cheapest(ours, 0.1), printed[0] if printed else None, 0.1, (400, 300)),
        versus(cheapest(ours, 0.01), cheapest(filtered, 0.01), 0.01, (50, 50)),
    ]


def markdown(session: Session) -> str:
    """tables.md."""
    parts = [f"# Speed against error\n\nOne core of: {session.machine}, vectors of {LANES} float64. "]
    parts.append(
        "e = √(Σ(u_ref − u)²/Σu_ref²), plain samples at 44.1 kHz; “audible e”: over the longest span, after the "
        "decimator; LSD: log-spectral distance; energy rise: largest of a step, relative, first 20 ms; × real time: "
        "kernel alone, and with decimation to 44.1 kHz; CPU time, best of the rounds. Bold: the default.\n"
    )
    for case, found in session.references.items():
        parts.append(reference_line(found) + "\n")
        parts.append(case_table(session, case))
    if "tanpura" in session.references:
        parts.append("\n## Ratios\n")
        parts += [f"- {line}" for line in ratios(session)]
        parts.append("\n## The paper's table III beside ours (CPU seconds)\n")
        parts.append(paper_table(session))
    if session.skipped:
        parts.append("\n## Left out\n")
        parts += [
            f"- {run.label}, {rate(run.rate_hz)}, {run.modes} modes ({run.case}): {why}" for run, why in session.skipped
        ]
    return "\n".join(parts) + "\n"


def write_tables(session: Session) -> None:
    """results.csv and tables.md."""
    file = io.StringIO(newline="")
    writer = csv.DictWriter(file, COLUMNS)
    writer.writeheader()
    writer.writerows(csv_row(row) for row in session.rows + session.timed)
    write_text(session.out / "results.csv", file.getvalue())
    text = markdown(session)
    write_text(session.out / "tables.md", text)
    print(text)
