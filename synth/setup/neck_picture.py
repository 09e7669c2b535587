"""The picture of a buzz map: the neck from above, each note coloured by how hard it may be plucked."""

from __future__ import annotations

import math
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from synth.files.targets import write_whole
from synth.setup.buzz_map import BuzzMap, Spot

#: colours from a threshold at half of the stroke to one at twice the stroke
_SCALE, _LEAST, _MOST = "RdYlBu", 0.5, 2.0
#: notes that do not buzz up to the limit, and strings that rest on a fret
_CLEAR, _RESTING = "#e8eef4", "#7a1f1f"
_OPEN_WIDTH = 0.05


def draw(found: BuzzMap, path: str | Path) -> None:
    """Writes the picture of a map to a .png, .svg or .pdf file. Raises OSError; needs matplotlib."""
    from matplotlib.figure import Figure

    strings = list(dict.fromkeys(each.string for each in found.spots))
    frets = max((each.fret for each in found.spots), default=0)
    lefts, widths = _cells(frets)
    figure = Figure(figsize=(1.6 + 0.55 * (frets + 2), 1.4 + 0.42 * max(2, len(strings))), layout="constrained")
    axes = figure.add_subplot()
    scale, norm = _colours()
    for each in found.spots:
        row = len(strings) - 1 - strings.index(each.string)
        colour = _colour(each, scale, norm)
        axes.barh(row, widths[each.fret], left=lefts[each.fret], height=0.82, color=colour, edgecolor="white", linewidth=0.6)
        axes.text(
            lefts[each.fret] + 0.5 * widths[each.fret],
            row,
            _label(each),
            ha="center",
            va="center",
            fontsize=6.5,
            color="white" if _dark(colour) else "black",
        )
    axes.set_yticks(range(len(strings)), strings[::-1])
    axes.set_xticks(lefts + 0.5 * widths, ["open", *(str(n) for n in range(1, frets + 1))])
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_xlabel("fret at which the string is stopped; in the cells: what it buzzes on")
    axes.set_title(f"{found.preset}: how hard each note may be plucked before it buzzes", fontsize=10)
    from matplotlib.cm import ScalarMappable

    bar = figure.colorbar(ScalarMappable(norm, scale), ax=axes, pad=0.01, aspect=12)
    bar.set_ticks([0.5, 0.7, 1.0, 1.4, 2.0], labels=["50 %", "70 %", "100 %", "140 %", "200 %"])
    bar.minorticks_off()
    bar.set_label(f"threshold, of the {found.stroke} stroke", fontsize=8)
    file = BytesIO()
    ending = Path(path).suffix.lower()
    figure.savefig(file, format=ending[1:], dpi=150, metadata={"Date": None} if ending == ".svg" else None)
    write_whole(path, partial(_copy, file.getvalue()))


def _copy(data: bytes, out: BinaryIO) -> None:
    out.write(data)


def _cells(frets: int) -> tuple[np.ndarray, np.ndarray]:
    """Left edges and widths (frets + 1,) of where a finger stops, narrowing as on a neck; the open string first."""
    ends = 1.0 - 2.0 ** (-np.arange(frets + 1) / 12.0)
    lefts = np.concatenate([[-_OPEN_WIDTH - 0.01], ends[:-1]])
    widths = np.concatenate([[_OPEN_WIDTH], np.diff(ends)])
    return lefts, widths


def _colours() -> tuple[Any, Any]:
    from matplotlib import colormaps
    from matplotlib.colors import LogNorm

    return colormaps[_SCALE], LogNorm(_LEAST, _MOST, clip=True)


def _colour(spot: Spot, scale: Any, norm: Any) -> Any:
    if spot.resting:
        return _RESTING
    if not math.isfinite(spot.buzz_m):
        return _CLEAR
    return scale(norm(spot.buzz_m / spot.stroke_m))


def _dark(colour: Any) -> bool:
    from matplotlib.colors import to_rgb

    red, green, blue = to_rgb(colour)
    return 0.299 * red + 0.587 * green + 0.114 * blue < 0.5


def _label(spot: Spot) -> str:
    name = spot.touched if spot.resting else spot.buzzes_on
    return name.removeprefix("fret ").replace("bridge point ", "b").replace("board at ", "")
