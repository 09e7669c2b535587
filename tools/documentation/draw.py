#!/usr/bin/env python3
"""Draws the pictures of docs/architecture.md into docs/assets: boxes, rows and arrows, nothing measured.

python tools/documentation/draw.py [FOLDER]      # default: docs/assets
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from html import escape
from itertools import pairwise
from pathlib import Path

ASSETS = Path(__file__).resolve().parents[2] / "docs" / "assets"
WIDTH, ROW, GAP = 960, 58, 22
#: colours that stand on a light ground and on a dark one
BOX, EDGE, TEXT, SOFT, ARROW = "#f7ecdd", "#8a4b16", "#2b1a0c", "#6b4a2c", "#b07a45"

#: the rooms of the package, from the top: what each floor is, and the rooms on it with what is in them
FLOORS: tuple[tuple[str, tuple[tuple[str, str], ...]], ...] = (
    ("what is typed", (("cli", "the commands"),)),
    ("what is made of it", (("plugin", "CLAP, VST3, LV2, libjawari"),)),
    (
        "what is played, and sound by the thousand",
        (("drone", "a tanpura by itself"), ("author", "the page"), ("dataset", "labelled sound")),
    ),
    ("live", (("live", "PortAudio, JACK, MIDI, takes"),)),
    ("set-up", (("setup", "where it buzzes"),)),
    ("studies", (("study", "many runs, each once"),)),
    ("measured", (("fit", "from recordings; plans"),)),
    ("uses", (("host", "songs to files"),)),
    ("two families", (("engine", "instruments that are played"), ("research", "one case at a time"))),
    ("presets", (("instrument", "preset, plan, compile, check"),)),
    ("strings", (("physics", "no sample rate"), ("solver", "one string through time"), ("dsp", "decimator, effects"))),
    ("events", (("midi", "events, files, ports, SysEx"),)),
    ("kernels", (("jit", "compiled, kept, found"),)),
    ("memory", (("native", "addresses, vectors, threads"),)),
    ("added", (("extensions", "what other modules add"),)),
    ("ground", (("files", ""), ("workers", ""), ("signals", ""), ("units", ""), ("panning", ""), ("spelling", ""))),
)


@dataclass
class Picture:
    """Shapes of an SVG, added one by one."""

    title: str
    height: int
    shapes: list[str] = field(default_factory=list)

    def box(self, x: float, y: float, width: float, height: float, name: str, about: str = "", code: bool = False) -> None:
        """A box with a name and, below it, a line about it."""
        middle = x + width / 2
        self.shapes.append(
            f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}" rx="7" fill="{BOX}" stroke="{EDGE}"/>'
        )
        self.text(middle, y + height / 2 + (5 if not about else -3), name, 15, TEXT, "700", code)
        if about:
            self.text(middle, y + height / 2 + 16, about, 12.5, SOFT)

    def text(self, x: float, y: float, text: str, size: float, colour: str, weight: str = "400", code: bool = False,
             anchor: str = "middle") -> None:  # fmt: skip
        """A line of text, its middle (or start) at x, its foot at y."""
        font = ' font-family="ui-monospace, DejaVu Sans Mono, monospace"' if code else ""
        self.shapes.append(
            f'<text x="{x:g}" y="{y:g}" font-size="{size:g}" font-weight="{weight}" fill="{colour}" '
            f'text-anchor="{anchor}"{font}>{escape(text)}</text>'
        )

    def arrow(self, points: Sequence[tuple[float, float]], label: str = "", at: tuple[float, float] | None = None) -> None:
        """A line with a head at its end; a label at `at`."""
        path = "M" + " L".join(f"{x:g} {y:g}" for x, y in points)
        self.shapes.append(f'<path d="{path}" fill="none" stroke="{ARROW}" stroke-width="2" marker-end="url(#head)"/>')
        if label and at is not None:
            self.text(*at, label, 12.5, ARROW)

    def svg(self) -> str:
        """The whole file."""
        return "\n".join(
            (
                f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {self.height}" role="img" '
                f'aria-label="{escape(self.title)}" font-family="system-ui, Noto Sans, DejaVu Sans, sans-serif">',
                f"<title>{escape(self.title)}</title>",
                '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto" '
                f'markerUnits="userSpaceOnUse"><path d="M0 0L8 4L0 8z" fill="{ARROW}"/></marker></defs>',
                *self.shapes,
                "</svg>\n",
            )
        )


def rooms() -> str:
    """The floors of the package: each uses those below it."""
    step = ROW + 10
    picture = Picture(
        "The rooms of the package, floor upon floor: each uses only what lies below it", step * len(FLOORS) + 10
    )
    for number, (floor, inside) in enumerate(FLOORS):
        y = 5 + number * step
        picture.text(10, y + ROW / 2 + 5, floor, 14, ARROW, anchor="start")
        width = (WIDTH - 150 - GAP * (len(inside) - 1)) / len(inside)
        for place, (name, about) in enumerate(inside):
            picture.box(145 + place * (width + GAP), y, width, ROW, name, about, code=True)
    return picture.svg()


def sound() -> str:
    """What becomes of a note in the engine."""
    picture = Picture("A note through the engine: policy, hand, string with its contact problem, decimator, mix", 452)
    wide, high = 200, 62
    columns = [10, 256, 502, 748]
    for x, name, about in zip(columns, ("events", "voices", "hands", "string"),
                              ("MIDI with their frames", "which string, who yields", "finger, plectrum, left hand",
                               "a few hundred modes"), strict=True):  # fmt: skip
        picture.box(x, 10, wide, high, name, about)
    for left, right in pairwise(columns):
        picture.arrow([(left + wide, 41), (right - 2, 41)])
    x = columns[3]
    picture.box(x, 140, wide, high, "free flight", "eight steps in one pass")
    picture.box(x, 252, wide, high, "contact problem", "frets, bridge, finger, at once")
    picture.box(x, 364, wide, high, "second pass", "forces into the modes")
    picture.arrow([(x + 100, 72), (x + 100, 138)])
    picture.arrow([(x + 100, 202), (x + 100, 250)], "a few numbers", (x + 152, 231))
    picture.arrow([(x + 100, 314), (x + 100, 362)], "forces", (x + 130, 343))
    picture.arrow([(x + wide, 395), (x + wide + 8, 395), (x + wide + 8, 171), (x + wide + 2, 171)])
    picture.text(x - 12, 231, "at the internal rate, exact-hold", 12.5, ARROW, anchor="end")
    picture.box(columns[2], 364, wide, high, "decimator", "to the output rate")
    picture.box(columns[1], 364, wide, high, "body, effects", "of each part")
    picture.box(columns[0], 364, wide, high, "mix, limiter", "level, pan, 0 dBFS")
    for right, left in zip(columns[:0:-1], columns[-2::-1], strict=True):
        picture.arrow([(right, 395), (left + wide + 2, 395)])
    picture.arrow([(columns[0] + 100, 364), (columns[0] + 100, 300)], "samples", (columns[0] + 100, 290))
    picture.arrow([(x, 171), (columns[1] + 100, 171), (columns[1] + 100, 362)])
    picture.text(columns[1] + 112, 160, "certain to touch nothing: straight at the output rate", 12.5, ARROW, anchor="start")
    return picture.svg()


def live() -> str:
    """Who does what while it is played."""
    picture = Picture(
        "Live: Python threads put events into a ring, the compiled callback plays, others read what it gave", 300
    )
    sources = (("MIDI ports, keys", "Python threads, each event its time"), ("songs", "each event its frame"),
               ("drone, page", "plucks, edits, parameters"))  # fmt: skip
    for y, (name, about) in zip((10, 110, 210), sources, strict=True):
        picture.box(10, y, 250, 66, name, about)
        picture.arrow([(260, y + 33), (330, y + 33), (330, 143), (368, 143)])
    picture.box(370, 90, 110, 106, "ring", "of events")
    picture.box(550, 60, 190, 166, "audio callback", "compiled: no interpreter,")
    picture.text(645, 175, "lock or allocation", 12.5, SOFT)
    picture.arrow([(480, 143), (548, 143)])
    picture.box(800, 10, 150, 66, "sound card", "PortAudio, JACK")
    picture.box(800, 110, 150, 66, "log", "events, frames")
    picture.box(800, 210, 150, 66, "ring of 24 s", "what sounded")
    for y in (43, 143, 243):
        picture.arrow([(740, 143), (770, 143), (770, y), (798, y)])
    picture.text(950, 294, "read by recorder, meters, page", 12.5, ARROW, anchor="end")
    return picture.svg()


PICTURES = {"rooms.svg": rooms, "sound.svg": sound, "live.svg": live}


def main() -> int:
    """Write all pictures."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else ASSETS
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in PICTURES.items():
        (folder / name).write_text(draw(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
