"""Pictures of a study's table: families of curves, points, Pareto fronts; to PNG, SVG or PDF by the name's ending."""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from io import BytesIO
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

from synth.files.targets import check_target, write_whole
from synth.spelling import perhaps
from synth.study.plotcheck import MOST_CURVES, ending_fault, too_many
from synth.study.studyfile import PlotTable, Study, StudyError
from synth.study.sweeping import read_table
from synth.study.work.measuring import MEASURES

if TYPE_CHECKING:
    import pandas

_MARKERS = "osD^v<>Pp*hX8"
_STYLES = ("-", "--", ":", "-.")
#: colours that are told apart also by those who see few (Okabe and Ito), then matplotlib's own
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442")
_COST = ("cpu_per_s", "cpu_s", "mode_steps", "row_cpu_s")
_ERROR = ("e", "lsd_db", "bands_db")
#: the scale of a colour that has more values than are told apart
_SCALE = "viridis"


def draw_all(study: Study, folder: Path) -> list[Path]:
    """Draws a study's pictures into its folder; without any in the study, those that `default_plots` finds.

    Returns their files. Raises StudyError where a picture asks for what the table has not, OSError.
    """
    table = read_table(folder)
    plots = study.plot or default_plots(study, table)
    if not plots:
        raise StudyError("plot: nothing to draw, as fewer than two columns hold numbers; describe a plot in [[plot]]")
    made = []
    for number, plot in enumerate(plots):
        name = plot.file or f"{study.name}-{number + 1}.png"
        path = Path(name) if os.path.isabs(name) else folder / name
        if (fault := ending_fault(name)) is not None:
            raise StudyError(f"plot.{number}.{fault}")
        check_target(path)
        figure = draw(plot, table, f"plot.{number}")
        file = BytesIO()
        figure.savefig(
            file, format=path.suffix[1:].lower(), dpi=150, metadata={"Date": None} if path.suffix == ".svg" else None
        )
        write_whole(path, partial(_copy, file.getvalue()))
        made.append(path)
    return made


def _copy(data: bytes, out: BinaryIO) -> None:
    out.write(data)


def default_plots(study: Study, table: pandas.DataFrame) -> list[PlotTable]:
    """The first measures over the parameter with most numbers, and error over cost where both were measured."""
    numbers = [name for name in table if _is_number(table[name])]
    varied = [name for name in study.parameters if name in numbers and table[name].nunique() > 1]
    words = [name for name in study.parameters if name in table and name not in numbers and table[name].nunique() > 1]
    measures = [each["as"] for each in study.measured() if each["as"] in numbers]
    inside = {*study.parameters, *_COST, "began", "row_wall_s"}
    measures = measures or [name for name in numbers if name not in inside]
    found = []
    if varied and measures:
        x = max(varied, key=lambda name: table[name].nunique())
        colour: str | None = next(iter([*words, *(name for name in varied if name != x)]), None)
        for y in [name for name in measures if name not in _COST][:4] or measures[:1]:
            log = [axis for axis, name in (("x", x), ("y", y)) if _is_wide(table[name])]
            kind = "curves" if table[x].nunique() < len(table) or len(table) < 50 else "points"
            found.append(PlotTable(x=x, y=y, colour=colour, log=log, kind=kind, file=f"{_plain(y)}.png"))
    cost = next((name for name in _COST if name in measures), None)
    error = next((name for name in _ERROR if name in measures), None)
    if cost and error:
        log = [axis for axis, name in (("x", cost), ("y", error)) if _is_wide(table[name])]
        chosen = words[0] if words else None
        found.append(PlotTable(x=cost, y=error, kind="pareto", colour=chosen, log=log, file="pareto.png"))
    return found


def _plain(name: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_" else "-" for letter in name)


def _is_number(values: Any) -> bool:
    from pandas.api.types import is_bool_dtype, is_numeric_dtype

    return bool(is_numeric_dtype(values) and not is_bool_dtype(values))


def _is_wide(values: Any) -> bool:
    """Whether a logarithmic axis suits: all above 0, over more than a factor 20."""
    kept = values[(values > 0) & (values < float("inf"))]
    return len(kept) > 0 and (values.dropna() > 0).all() and kept.max() > 20 * kept.min()


def draw(plot: PlotTable, table: pandas.DataFrame, place: str) -> Any:
    """A matplotlib figure. Raises StudyError that names `place`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    for key in ("x", "y", "colour", "marker"):
        name = getattr(plot, key)
        if name is not None and name not in table:
            raise StudyError(
                f"{place}.{key}: the table has no {name!r}{perhaps(name, list(table))}; it has {', '.join(table)}"
            )
        if key in ("x", "y") and not _is_number(table[name]):
            raise StudyError(f"{place}.{key}: {name!r} does not hold numbers; choose another column")
    for name, value in plot.where.items():
        if name not in table:
            raise StudyError(f"{place}.where.{name}: the table has no such column")
        table = table[table[name].isna() if value is None else table[name] == value]
    names = [*dict.fromkeys(name for name in (plot.x, plot.y, plot.colour, plot.marker) if name is not None)]
    table = table[names]
    table = table[table[[plot.x, plot.y]].abs().lt(float("inf")).all(axis=1)]
    for axis, name in (("x", plot.x), ("y", plot.y)):
        if axis in plot.log:
            table = table[table[name] > 0]
    figure = Figure(figsize=(7.5, 5.0), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    handles = 0
    if _has_scale(plot, table):
        handles = _draw_on_a_scale(figure, axes, plot, table, place)
        families: Any = ()
    else:
        families = _families(plot, table, place)
    for label, rows, look in families:
        rows = _line(plot, rows)
        line = look.pop("linestyle") if plot.kind == "curves" else look.pop("linestyle") and "none"
        axes.plot(rows[plot.x], rows[plot.y], linestyle=line, markersize=5, linewidth=1.4, label=label, **look)
        handles += label is not None
    if plot.kind == "pareto" and len(table):
        front = pareto(table[plot.x].to_numpy(), table[plot.y].to_numpy(), plot.more_is_better)
        ends = table.iloc[front]
        axes.plot(ends[plot.x], ends[plot.y], drawstyle="default", color="0.35", linewidth=1.0, zorder=0, label="front")
    axes.set_xscale("log" if "x" in plot.log else "linear")
    axes.set_yscale("log" if "y" in plot.log else "linear")
    axes.set_xlabel(plot.x_label or _label(plot.x))
    axes.set_ylabel(plot.y_label or _label(plot.y))
    axes.grid(True, which="major", alpha=0.3)
    if plot.title:
        axes.set_title(plot.title)
    if handles or plot.kind == "pareto":
        axes.legend(fontsize="small", framealpha=0.7)
    if not len(table):
        axes.text(0.5, 0.5, "no finite values", ha="center", transform=axes.transAxes)
    return figure


def _line(plot: PlotTable, rows: pandas.DataFrame) -> pandas.DataFrame:
    """Rows from left to right; of a curve one at each x, the median."""
    rows = rows.sort_values(plot.x, kind="stable")
    if plot.kind == "curves" and rows[plot.x].duplicated().any():
        return rows.groupby(plot.x, as_index=False)[plot.y].median()
    return rows


def _has_scale(plot: PlotTable, table: pandas.DataFrame) -> bool:
    """Whether its colour is of numbers, more than are told apart one by one."""
    if plot.colour is None or not _is_number(table[plot.colour]):
        return False
    keys = [name for name in dict.fromkeys((plot.colour, plot.marker)) if name is not None]
    return len(table.drop_duplicates(keys)) > MOST_CURVES


def _draw_on_a_scale(figure: Any, axes: Any, plot: PlotTable, table: pandas.DataFrame, place: str) -> int:
    """Points, and curves, whose colour is a number, with the scale beside; how many labels there are."""
    import pandas
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LogNorm, Normalize

    colour_of = str(plot.colour)
    table = table[table[colour_of].abs().lt(float("inf"))]
    values = table[colour_of]
    norm = (LogNorm if _is_wide(values) else Normalize)(float(values.min()), float(values.max()))
    look: dict[str, Any] = {"cmap": _SCALE, "norm": norm}
    marked = plot.marker if plot.marker != plot.colour else None
    groups = [(None, table)] if marked is None else list(table.groupby(marked, dropna=False, sort=False))
    if len(groups) > MOST_CURVES:
        raise StudyError(f"{place}.{too_many(len(groups), 'marker')}")
    for (value, rows), marker, style in zip(groups, cycle(_MARKERS), cycle(_STYLES), strict=False):
        if plot.kind == "curves":
            curves = [(colour, _line(plot, each)) for colour, each in rows.groupby(colour_of, sort=True)]
            lines = [each[[plot.x, plot.y]].to_numpy() for _, each in curves]
            axes.add_collection(
                LineCollection(lines, array=[colour for colour, _ in curves], linewidths=1.0, linestyles=style, **look)
            )
            rows = pandas.concat([each.assign(**{colour_of: colour}) for colour, each in curves])
        label = None if marked is None else "none" if _none(value) else _value(value)
        axes.scatter(rows[plot.x], rows[plot.y], c=rows[colour_of], s=20, marker=marker, label=label, **look)
    figure.colorbar(ScalarMappable(norm, _SCALE), ax=axes, label=_label(colour_of))
    return 0 if marked is None else len(groups)


def _label(name: str) -> str:
    """A measure with what it means, else the column's name."""
    return f"{name}: {MEASURES[name].meaning}" if name in MEASURES else name


def _families(plot: PlotTable, table: pandas.DataFrame, place: str) -> Iterator[tuple[str | None, Any, dict[str, Any]]]:
    """(label, rows, look) of each curve."""
    if plot.colour is None and plot.marker is None:
        yield None, table, {"color": _COLOURS[0], "marker": "o", "linestyle": "-"}
        return
    keys = [name for name in dict.fromkeys((plot.colour, plot.marker)) if name is not None]
    groups = list(table.groupby(keys, dropna=False, sort=False))
    if len(groups) > MOST_CURVES:
        raise StudyError(f"{place}.{too_many(len(groups), 'colour' if plot.colour is not None else 'marker')}")
    colours = dict(zip(_values(table, plot.colour), cycle(_COLOURS), strict=False))
    markers = dict(zip(_values(table, plot.marker), cycle(_MARKERS), strict=False))
    styles = dict(zip(_values(table, plot.marker), cycle(_STYLES), strict=False))
    for values, rows in groups:
        chosen = dict(zip(keys, values, strict=True))
        colour, marker = (str(chosen.get(name or "")) for name in (plot.colour, plot.marker))
        label = ", ".join(_value(value) if len(keys) == 1 or isinstance(value, str) else f"{name} {_value(value)}"
                          for name, value in chosen.items() if not _none(value))  # fmt: skip
        look = {"marker": markers.get(marker, "o"), "linestyle": styles.get(marker, "-")}
        yield label or "none", rows, {"color": colours.get(colour, _COLOURS[0]), **look}


def _values(table: pandas.DataFrame, name: str | None) -> list[str]:
    return [] if name is None else [str(value) for value in table[name].unique()]


def _none(value: Any) -> bool:
    return value is None or value != value


def _value(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def pareto(x: Any, y: Any, more_is_better: list[Any] | None = None) -> list[int]:
    """Places of the points that no other is better than in both, from the least x on; less is better unless said.

    x, y : (n,) finite numbers. more_is_better : of "x" and "y" those of which more is.
    """
    better = more_is_better or []
    signs = [-1.0 if axis in better else 1.0 for axis in "xy"]
    order = sorted(range(len(x)), key=lambda k: (signs[0] * x[k], signs[1] * y[k]))
    found, best = [], float("inf")
    for k in order:
        if signs[1] * y[k] < best:
            best = signs[1] * y[k]
            found.append(k)
    return found if signs[0] > 0 else found[::-1]
