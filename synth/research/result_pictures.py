"""Pictures of results: displacement, forces, energies over time; and what a notebook shows of one. They need matplotlib."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from synth.files import notebook_html

PANELS = ("u", "contact_force", "energy")
#: more columns than this are drawn in one colour each without a legend
_NAMED_COLUMNS = 14
#: rows that a line is drawn with; of more, the least and largest of each stretch
_POINTS = 4000
_LABELS = {"u": "displacement, mm", "contact_force": "contact force, N", "energy": "energy, mJ"}
_SCALES = {"u": 1e3, "contact_force": 1.0, "energy": 1e3}
_ENERGIES = {"stored": "stored", "residual": "held by the rest", "viscous": "lost to damping", "contact": "lost at contacts",
             "injected": "put in"}  # fmt: skip


class Drawn:
    """What results of every kind have in common for the eye."""

    def plot(
        self,
        panels: Sequence[str] | None = None,
        *,
        start_s: float | None = None,
        end_s: float | None = None,
        axes: Any = None,
    ) -> Any:
        """Draws displacement at the outputs, contact forces and, with the ledger, energies over time; returns an array of
        matplotlib Axes, one a panel.

        panels      of "u", "contact_force" and "energy"; None: those that there is something for
        start_s, end_s   which rows; None: from the first, to the last
        axes        Axes to draw into, as many as panels; None: a new figure of pyplot's
        Raises ValueError for panels or times that there are not, ImportError without matplotlib.
        """
        return draw(self, panels, start_s, end_s, axes)

    def _repr_html_(self) -> str:
        return html_of(self)


def draw(
    result: Any,
    panels: Sequence[str] | None = None,
    start_s: float | None = None,
    end_s: float | None = None,
    axes: Any = None,
) -> Any:
    """What `Result.plot` draws; returns an array of matplotlib Axes, one a panel.

    panels      of `PANELS`; None: those that there is something for
    start_s, end_s   which rows; None: from the first, to the last
    axes        Axes to draw into, as many as panels; None: a new figure of pyplot's
    Raises ValueError for panels or times that are none, ImportError without matplotlib.
    """
    wanted = _wanted(result, panels)
    rows = _rows(result, start_s, end_s)
    if axes is None:
        notebook_html.need("matplotlib", "plot")
        import matplotlib.pyplot as plt

        axes = plt.subplots(len(wanted), 1, sharex=True, squeeze=False, figsize=(9.0, 0.6 + 2.2 * len(wanted)),
                            layout="constrained")[1]  # fmt: skip
    found = np.atleast_1d(np.asarray(axes, dtype=object)).ravel()
    if found.size != len(wanted):
        raise ValueError(f"axes must be {len(wanted)}, one for each of {', '.join(wanted)}, got {found.size}")
    t, unit = result.t[rows], 1.0
    name = "s"
    if t.size > 1 and t[-1] - t[0] < 0.05:
        unit, name = 1e3, "ms"
    for axis, panel in zip(found, wanted, strict=True):
        columns = columns_of(result, panel)
        for label, column in columns.items():
            axis.plot(*thinned(unit * t, _SCALES[panel] * column[rows]), lw=0.8, label=label)
        axis.set_ylabel(_LABELS[panel])
        axis.margins(x=0.0)
        if 1 < len(columns) <= _NAMED_COLUMNS:
            axis.legend(fontsize="small" if len(columns) < 5 else "xx-small", loc="upper right", ncols=1 + len(columns) // 5)
    found[-1].set_xlabel(name)
    return found


def _wanted(result: Any, panels: Sequence[str] | None) -> list[str]:
    there = [panel for panel in PANELS if columns_of(result, panel)]
    if panels is None:
        return there
    wanted = [panels] if isinstance(panels, str) else list(panels)
    for panel in wanted:
        if panel not in PANELS:
            raise ValueError(f"panels are of {', '.join(PANELS)}, got {panel!r}")
        if panel not in there:
            raise ValueError(f"there is nothing to draw of {panel}: the run has none{_REMEDIES.get(panel, '')}")
    if not wanted:
        raise ValueError(f"panels must name at least one of {', '.join(PANELS)}")
    return wanted


_REMEDIES = {"energy": "; simulate with ledger=True", "contact_force": ", as its string meets nothing"}


def _rows(result: Any, start_s: float | None, end_s: float | None) -> slice:
    low = 0 if start_s is None else int(np.searchsorted(result.t, start_s))
    high = result.t.size if end_s is None else int(np.searchsorted(result.t, end_s, side="right"))
    if high <= low:
        raise ValueError(
            f"there are no rows from {start_s} to {end_s} s: they go from {result.t[0]:g} to {result.t[-1]:g} s"
        )
    return slice(low, high)


def columns_of(result: Any, panel: str) -> dict[str, np.ndarray]:
    """Label → column (n,) of what a panel shows."""
    if panel == "energy":
        return _energies(result)
    places = result.positions if panel == "u" else result.contact_positions
    strings = getattr(result, "output_string" if panel == "u" else "contact_string", None)
    if not places.size:
        return {}
    values = getattr(result, panel)
    # numbered, as two may have one place
    labels = [
        f"{1e3 * x:g} mm" if strings is None else f"string {strings[k] + 1}, {1e3 * x:g} mm" for k, x in enumerate(places)
    ]
    return {label if labels.count(label) == 1 else f"{label} ({k + 1})": values[:, k] for k, label in enumerate(labels)}


def _energies(result: Any) -> dict[str, np.ndarray]:
    energy = getattr(result, "energy", None)
    if energy is not None:
        from synth.solver.coupled_study import ENERGIES

        return {name.replace("_", " "): energy[:, k] for k, name in enumerate(ENERGIES) if np.any(energy[:, k])}
    there = {words: getattr(result, f"energy_{name}", None) for name, words in _ENERGIES.items()}
    return {words: column for words, column in there.items() if column is not None and (words == "stored" or np.any(column))}


def thinned(t: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(t, x) with no more than about _POINTS points: of each stretch the least and the largest, in their order."""
    if x.size <= _POINTS:
        return t, x
    starts = np.linspace(0, x.size, _POINTS // 2, endpoint=False).astype(int)
    ends = np.append(starts[1:], x.size)
    low = np.array([a + int(np.argmin(x[a:b])) for a, b in zip(starts, ends, strict=True)])
    high = np.array([a + int(np.argmax(x[a:b])) for a, b in zip(starts, ends, strict=True)])
    kept = np.sort(np.concatenate([low, high]))
    return t[kept], x[kept]


def html_of(result: Any) -> str:
    """A table of the few numbers and a small picture, as a notebook shows a result."""
    rows = [("run", repr(result).strip("<>"))]
    rows += [(name, _shown(value)) for name, value in result.summary.items() if name not in _SAID]
    pieces = [notebook_html.table(rows)]
    if not columns_of_any(result):
        return pieces[0]
    if not notebook_html.there_is("matplotlib"):
        return pieces[0] + notebook_html.paragraph("A picture needs matplotlib: pip install 'jawari[notebook]'")
    from matplotlib.figure import Figure

    panels = _wanted(result, None)
    figure = Figure(figsize=(7.0, 0.4 + 1.5 * len(panels)), dpi=80, layout="constrained")
    draw(result, panels, axes=figure.subplots(len(panels), 1, sharex=True, squeeze=False))
    pieces.append(notebook_html.picture(notebook_html.png_of(figure), ", ".join(_LABELS[panel] for panel in panels)))
    return "".join(pieces)


#: of the summary, what the first line has said
_SAID = {"scheme", "internal_rate_hz", "modes", "contacts", "rows"}


def columns_of_any(result: Any) -> bool:
    """Whether there is anything to draw."""
    return any(columns_of(result, panel) for panel in PANELS)


def _shown(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.6g}" if math.isfinite(value) else str(value)
    return str(value)
