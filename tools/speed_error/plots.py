"""Pictures: error against cost, order of convergence, displacement and spectrograms as in Issanchou et al. 2018."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from speed_error.grid import BASE_HZ, ELASTIC, INELASTIC, Run
from speed_error.tables import rate
from synth.dsp.measures import stft_power

if TYPE_CHECKING:
    from speed_error.session import Session

#: Okabe and Ito's palette, which the colour-blind tell apart; the default scheme alone is vermilion
_OURS = "#D55E00"
_COLOURS = ("#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#000000", "#8C6D1F", "#6A51A3", "#999999")
_SOME_SUBSTEPS = re.compile(r", \d+ sub-steps$")
_MARKERS = ("s", "^", "D", "v", "P", "X", "<", ">", "h", "p")
_TITLES = {
    "tanpura": "Two-point bridge (tanpura), error over 3 s",
    "bass": "Bass over 20 frets, error over 0.1 s",
    "fretless": "Fretless board, elastic, error over 0.1 s",
    "fretless-inelastic": "Fretless board, inelastic, error over 0.1 s",
}
_ERRORS = {"tanpura": "e_3s", "bass": "e_0.1s", "fretless": "e_0.1s", "fretless-inelastic": "e_0.1s"}
_STYLE = {
    "figure.facecolor": "white", "axes.facecolor": "white", "savefig.facecolor": "white", "font.size": 10,
    "axes.grid": True, "grid.color": "#dddddd", "grid.linewidth": 0.6, "axes.axisbelow": True,
    "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False,
}  # fmt: skip


def draw_all(session: Session, front: Path | None) -> None:
    """Every picture into the session's folder; the front one to `front` too."""
    with plt.rc_context(_STYLE):
        pareto(session, "pareto.png", ["tanpura", "bass"], front)
        pareto(session, "pareto-fretless.png", [ELASTIC, INELASTIC], None)
        convergence(session)
        for case in ("tanpura", "bass"):
            if case in session.references:
                displacement(session, case)
                spectrograms(session, case)


def _save(figure: Any, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130, bbox_inches="tight")
    plt.close(figure)


def families(session: Session, case: str) -> dict[str, list[dict[str, Any]]]:
    """Rows by scheme and by whether all modes are kept, lowest rate first; the default's first of all."""
    ours = session.default_rows(case)
    found: dict[str, list[dict[str, Any]]] = {}
    if ours:
        found[f"{ours[0]['run'].label} (default)"] = ours
    taken = {id(row) for row in ours}
    for row in session.rows:
        run: Run = row["run"]
        if run.case == case and id(row) not in taken and "substeps" not in dict(run.table):
            kept = "all modes" if run.modes == session.references[case]["run"].modes else "modes below half the rate"
            found.setdefault(f"{run.label}; {kept}", []).append(row)
    return {name: sorted(rows, key=lambda row: row["run"].factor) for name, rows in found.items()}


def _styles(session: Session) -> dict[str, dict[str, Any]]:
    """One look per scheme over all pictures: colour by scheme, hollow markers for truncated modes."""
    schemes: list[str] = []
    for case in session.cases:
        for name in families(session, case):
            scheme = name.split(";")[0]
            if scheme not in schemes and not scheme.endswith(("(default)", "sub-steps")):
                schemes.append(scheme)
    styles = {}
    for number, scheme in enumerate(schemes):
        styles[scheme] = {"color": _COLOURS[number % len(_COLOURS)], "marker": _MARKERS[number % len(_MARKERS)]}
    return styles


def _look(name: str, styles: dict[str, dict[str, Any]]) -> dict[str, Any]:
    if name.endswith("(default)"):
        return {"color": _OURS, "marker": "o", "linewidth": 2.4, "markersize": 8, "zorder": 5}
    if name.endswith("sub-steps"):
        return {"color": _OURS, "marker": "*", "linewidth": 1.6, "linestyle": "--", "markersize": 9, "zorder": 6}
    truncated = name.endswith("below half the rate")
    look = dict(styles[name.split(";")[0]], linewidth=1.0, markersize=6, linestyle="--" if truncated else "-")
    if truncated:
        look["markerfacecolor"] = "white"
    return look


def _finite(rows: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    return [row for row in rows if math.isfinite(row.get(key, math.inf)) and row[key] > 0.0]


def nothing_better(rows: list[dict[str, Any]], key: str) -> list[dict[str, Any]]:
    """Those rows that no other one beats in error and in cost, cheapest first."""
    found: list[dict[str, Any]] = []
    for row in sorted(rows, key=lambda row: (row["cpu_per_s"], row[key])):
        if not found or row[key] < found[-1][key]:
            found.append(row)
    return found


def pareto(session: Session, name: str, cases: list[str], front: Path | None) -> None:
    """Error against CPU time: of every scheme its best choices of rate and modes, and the front over all of them."""
    cases = [case for case in cases if any(_finite([r], _ERRORS[case]) for r in session.rows if r["run"].case == case)]
    if not cases:
        return
    styles = _styles(session)
    figure, axes = plt.subplots(1, len(cases), figsize=(5.4 * len(cases), 4.8), squeeze=False)
    handles: dict[str, Any] = {}
    for axis, case in zip(axes[0], cases, strict=True):
        key = _ERRORS[case]
        everything = _finite([row for row in session.rows if row["run"].case == case], key)
        ours = {id(row) for row in session.default_rows(case)}
        schemes: dict[str, list[dict[str, Any]]] = {}
        for row in everything:
            label = _SOME_SUBSTEPS.sub(", sub-steps", row["run"].label) + (" (default)" if id(row) in ours else "")
            schemes.setdefault(label, []).append(row)
        for label, rows in sorted(schemes.items(), key=lambda item: not item[0].endswith("(default)")):
            best = nothing_better(rows, key)
            look = _look(label, styles)
            axis.plot([r["cpu_per_s"] for r in rows], [r[key] for r in rows], color=look["color"], marker=".",
                      markersize=4, linestyle="", alpha=0.35, zorder=1)  # fmt: skip
            (line,) = axis.plot([r["cpu_per_s"] for r in best], [r[key] for r in best], **look)
            handles.setdefault(label, line)
        x, y = np.array([(row["cpu_per_s"], row[key]) for row in nothing_better(everything, key)]).T
        (line,) = axis.step(x, y, where="post", color="#555555", linewidth=6.0, alpha=0.22, zorder=0.5)
        handles.setdefault("Pareto front of all", line)
        _floor(axis, session, case, key)
        axis.set(xscale="log", yscale="log", title=_TITLES[case])
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set_xlabel("CPU seconds per second of sound (one core)")
        axis.set_ylabel("relative error e against the converged run")
        axis.axvline(1.0, color="#555555", linewidth=1.0, linestyle=":")
        axis.annotate("real time", (1.0, 0.985), xycoords=("data", "axes fraction"), rotation=90, ha="left", va="top",
                      xytext=(2, 0), textcoords="offset points", fontsize=8, color="#555555")  # fmt: skip
        if case == "tanpura":
            axis.axhline(0.1, color="#555555", linewidth=1.0, linestyle=":")
            axis.annotate("criterion: e < 0.1", (0.99, 0.1), xycoords=("axes fraction", "data"), ha="right", va="top",
                          xytext=(0, -2), textcoords="offset points", fontsize=8, color="#555555")  # fmt: skip
        best = nothing_better(_finite(session.default_rows(case), key), key)
        for row in best[:2] + best[-1:] * (len(best) > 2):
            axis.annotate(rate(row["run"].rate_hz), (row["cpu_per_s"], row[key]), xytext=(-6, -6), ha="right", va="top",
                          textcoords="offset points", fontsize=8, color=_OURS)  # fmt: skip
        axis.margins(x=0.12)
    figure.legend(handles.values(), handles.keys(), loc="upper center", bbox_to_anchor=(0.5, 0.01), ncols=3, fontsize=8)
    what = "lines: each scheme's best choices of rate and modes; dots: its other runs"
    figure.suptitle(f"Error against cost ({what}). CPU: {session.machine}", fontsize=9)
    figure.tight_layout()
    for path in filter(None, (session.out / name, front)):
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=100, bbox_inches="tight")
    plt.close(figure)


def _floor(axis: Axes, session: Session, case: str, key: str) -> None:
    """Below what two converged runs differ by, an error says nothing."""
    stands = max(found.get(key, 0.0) for found in session.references[case]["stands"].values())
    low = axis.get_ylim()[0]
    if stands and stands > low / 10.0:
        axis.axhspan(min(low, stands / 2.0), stands, color="#eeeeee", zorder=0)
        axis.annotate("two converged runs differ by this", (0.985, stands), xycoords=("axes fraction", "data"), ha="right",
                      va="top", fontsize=8, color="#555555", xytext=(0, -2), textcoords="offset points")  # fmt: skip


def convergence(session: Session) -> None:
    """Error against internal rate, with lines of first and second order."""
    cases = [case for case in session.cases if case not in (ELASTIC, INELASTIC)]
    if not cases:
        return
    styles = _styles(session)
    figure, axes = plt.subplots(1, len(cases), figsize=(5.4 * len(cases), 5.2), squeeze=False)
    handles: dict[str, Any] = {}
    for axis, case in zip(axes[0], cases, strict=True):
        key = _ERRORS[case]
        for name, rows in families(session, case).items():
            rows = _finite(rows, key)
            if rows:
                (line,) = axis.plot([r["run"].rate_hz for r in rows], [r[key] for r in rows], **_look(name, styles))
                handles.setdefault(name, line)
        _floor(axis, session, case, key)
        anchor = _finite(session.default_rows(case), key)
        if anchor:
            x = np.array([BASE_HZ, BASE_HZ * 16.0])
            for order, style in ((1, ":"), (2, "-.")):
                y = 0.5 * anchor[0][key] * (x / x[0]) ** -order
                (line,) = axis.plot(x, y, color="#777777", linestyle=style, linewidth=1.2)
                handles.setdefault(f"order {order}", line)
        axis.set(xscale="log", yscale="log", title=_TITLES[case])
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set_xlabel("internal rate [Hz]")
        axis.set_ylabel("relative error e against the converged run")
    figure.legend(handles.values(), handles.keys(), loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2, fontsize=8)
    figure.tight_layout()
    _save(figure, session.out / "convergence.png")


def _shown(session: Session, case: str) -> list[tuple[str, np.ndarray, dict[str, Any]]]:
    """(name, displacement [m] at 44.1 kHz, look) of the reference, the default's cheapest run and the cheapest rivals."""
    found = [
        ("converged run", session.references[case]["signals"]["raw"], {"color": "black", "linewidth": 2.2, "alpha": 0.35})
    ]
    ours = [row for row in session.default_rows(case) if row["run"] in session.signals]
    limit = 0.1 if case == "tanpura" else 0.25
    good = [row for row in ours if row.get(_ERRORS[case], 9.0) < limit] or ours[-1:]
    if good:
        run = good[0]["run"]
        name = f"{run.label} (default), {rate(run.rate_hz)}, {run.modes} modes"
        found.append((name, session.signals[run]["raw"], {"color": _OURS, "linewidth": 1.3}))
    for scheme, colour in (("moreau-jean-filtered", "#0072B2"), ("compliant", "#009E73")):
        rivals = [row for row in session.rows if row["run"].case == case and row["run"].scheme == scheme and row["finite"]]
        rivals = [row for row in rivals if row["run"] in session.signals]
        if good and rivals:
            factor = good[0]["run"].factor
            run = min(rivals, key=lambda row: (abs(math.log(row["run"].factor / factor)), row["cpu_per_s"]))["run"]
            name = f"{run.label}, {rate(run.rate_hz)}, {run.modes} modes"
            found.append((name, session.signals[run]["raw"], {"color": colour, "linewidth": 1.0, "linestyle": "--"}))
    return found


def displacement(session: Session, case: str) -> None:
    """Displacement near the end x = L: the onset, and pieces early and late (figures 2 and 7)."""
    spans = {"tanpura": ((0.0, 0.05), (0.004, 0.012), (0.5, 0.508), (2.0, 2.008)),
             "bass": ((0.0, 0.12), (0.01, 0.03), (0.06, 0.08), (0.3, 0.32))}[case]  # fmt: skip
    lines = _shown(session, case)
    figure = plt.figure(figsize=(10.0, 5.8))
    grid = figure.add_gridspec(2, 3)
    axes = [figure.add_subplot(grid[0, :])] + [figure.add_subplot(grid[1, k]) for k in range(3)]
    for axis, (begin, end) in zip(axes, spans, strict=True):
        for name, u, look in lines:
            here = slice(round(begin * BASE_HZ), round(end * BASE_HZ) + 1)
            t = np.arange(here.start, min(here.stop, u.size)) / BASE_HZ
            axis.plot(1e3 * t, 1e3 * u[here], label=name, **look)
        axis.set_xlim(1e3 * begin, 1e3 * end)
        axis.set_xlabel("time [ms]")
    axes[0].set_ylabel("displacement [mm]")
    axes[1].set_ylabel("displacement [mm]")
    where = "1 cm" if case == "tanpura" else "9 mm"
    axes[0].set_title(f"{_TITLES[case].split(',')[0]}: displacement {where} from the end x = L")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=2, fontsize=8)
    figure.tight_layout()
    _save(figure, session.out / f"displacement-{case}.png")


def spectrograms(session: Session, case: str) -> None:
    """Spectrograms over 70 dB (figures 3 and 8): the converged run's and the default's beside the rivals'."""
    lines = _shown(session, case)
    longest, highest = (3.0, 12e3) if case == "tanpura" else (0.4, 8e3)
    size, hop = (2048, 256) if case == "tanpura" else (1024, 64)
    figure, axes = plt.subplots(1, len(lines), figsize=(3.6 * len(lines), 3.6), sharey=True, squeeze=False)
    top = None
    for axis, (name, u, _) in zip(axes[0], lines, strict=True):
        level = 10.0 * np.log10(np.maximum(stft_power(u, size, hop).T, 1e-300))
        top = float(level.max()) if top is None else top
        extent = (size / 2 / BASE_HZ, (level.shape[1] * hop + size / 2) / BASE_HZ, 0.0, BASE_HZ / 2e3)
        image = axis.imshow(level - top, origin="lower", aspect="auto", extent=extent, cmap="viridis", vmin=-70.0, vmax=0.0)
        axis.set(xlim=(0.0, longest), ylim=(0.0, highest / 1e3), xlabel="time [s]")
        axis.set_title(name.replace(", ", "\n", 1), fontsize=8)
        axis.grid(False)
    axes[0][0].set_ylabel("frequency [kHz]")
    figure.colorbar(image, ax=axes[0].tolist(), label="dB", fraction=0.03, pad=0.02)
    _save(figure, session.out / f"spectrograms-{case}.png")
