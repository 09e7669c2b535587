"""How cost grows: one picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullFormatter, NullLocator
from speed_error.plots import _STYLE, _save

from benchmarks.kernels import BY_NAME, HOLD, Setting
from benchmarks.report import of

_MARKERS = ("o", "s", "^", "D", "v", "P", "X")
_GREYS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#7a7a7a", "#CC79A7", "#E69F00")
_IN_PROPORTION = "in proportion"
_LINES = ("-", "--", "-.", ":")


def growth(found: list[dict[str, Any]], path: Path) -> bool:
    """Cost against voices, modes and contacts, log-log; False where there is nothing to draw."""
    kernels = [info for info in of(found, "kernels") if info["scheme"] == HOLD]
    one_step = {
        "modes": [info for info in kernels if info["sweep"] == "grid" and not _left_out(info)],
        "contacts": [info for info in kernels if info["sweep"] == "contacts"],
    }
    strings = sorted((info["strings"], 1e3 * info["cpu_per_s"]) for info in of(found, "strings"))
    if not strings and not any(one_step.values()):
        return False
    with plt.rc_context(_STYLE):
        figure, axes = plt.subplots(1, 3, figsize=(13.0, 6.4))
        if strings:
            axes[0].loglog(*zip(*strings, strict=True), color=_GREYS[0], marker=_MARKERS[0], label="engine, standard")
            _proportional(axes[0], strings)
        voices = [info for info in kernels if info["sweep"] == "voices" and info["modes"] == 137]
        for number, (label, points) in enumerate(_lines(voices, "voices", 44.1 / 1e6).items(), start=1):
            _line(axes[0], points, number, label)
        _panel(axes[0], "Strings (kernels: 137 modes at 44.1 kHz)", "strings", "CPU time for one second of sound [ms]")
        for axis, what in zip(axes[1:], ("modes", "contacts"), strict=True):
            lines = _lines(one_step[what], what, 1.0)
            for number, (label, points) in enumerate(lines.items()):
                _line(axis, points, number, label)
            if lines:
                _proportional(axis, max(lines.values(), key=len))
        _panel(axes[1], "Modes, one string", "modes", "CPU time of one step [ns]")
        _panel(axes[2], "Contacts, one string of 137 modes", "contacts", "CPU time of one step [ns]")
        figure.tight_layout(w_pad=2.0)
        _save(figure, path)
    return True


def _left_out(info: dict[str, Any]) -> bool:
    """Of so few contacts the kernels made for more of them; the naive loop in free flight."""
    general = BY_NAME[info["kernel"]].takes(Setting(HOLD, info["modes"], 20))
    return (info["contacts"] <= 1 and general) or (info["contacts"] == 0 and info["kernel"] == "naive loop")


def _lines(rows: list[dict[str, Any]], against: str, scale: float) -> dict[str, list[tuple[float, float]]]:
    """Label → points (x, scale × ns of one step of all strings)."""
    lines: dict[str, list[tuple[float, float]]] = {}
    for info in rows:
        label = info["kernel"]
        if against == "modes" and info["contacts"] != 0:
            label += f", {info['contacts']} contact" + "s" * (info["contacts"] > 1)
        elif against == "modes":
            label += ", free"
        step_ns = 1e9 * info["modes"] * info["voices"] / info["mode_steps_per_s"]
        lines.setdefault(label, []).append((info[against], 1e3 * scale * step_ns if against == "voices" else step_ns))
    return {label: sorted(points) for label, points in lines.items()}


def _line(axis: Any, points: list[tuple[float, float]], number: int, label: str) -> None:
    axis.loglog(
        *zip(*points, strict=True), color=_GREYS[number % len(_GREYS)], marker=_MARKERS[number % len(_MARKERS)],
        linestyle=_LINES[number % len(_LINES)], markersize=5, linewidth=1.4, label=label,
    )  # fmt: skip


def _proportional(axis: Any, points: list[tuple[float, float]]) -> None:
    """A thin line of slope one through the last point."""
    (first, _), (x, y) = points[0], points[-1]
    axis.loglog([first, x], [y * first / x, y], color="#999999", linewidth=0.8, zorder=0, label=_IN_PROPORTION)


def _panel(axis: Any, title: str, x: str, y: str) -> None:
    axis.set_title(title)
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    axis.grid(which="minor", visible=False)
    measured = [line for line in axis.get_lines() if line.get_label() != _IN_PROPORTION]
    if not measured:
        return
    taken = sorted({x for line in measured for x in line.get_xdata()})
    axis.xaxis.set_major_locator(FixedLocator(taken))
    axis.xaxis.set_minor_locator(NullLocator())
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    for scale in (axis.xaxis, axis.yaxis):
        scale.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        scale.set_minor_formatter(NullFormatter())
    heights = [v for line in measured for v in line.get_ydata()]
    axis.set_ylim(min(heights) / 1.5, max(heights) * 1.5)
    axis.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncol=1)
