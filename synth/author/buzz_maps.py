"""Where the strings of a preset buzz, and the set-up that a wish asks for: `synth setup` on the page."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from synth.instrument.preset import Preset
from synth.native.processors import cores
from synth.setup import longest, missing, proposals
from synth.setup.buzz_map import buzz_map, velocity_named
from synth.setup.places import check_touches, places_of, string_names
from synth.setup.report import neck_lines, rows, summary
from synth.setup.wants import Want, parse

#: told how many notes are done, and how many there are
Told = Callable[[int, int], None]


def _silent(done: int, total: int) -> None:
    pass


def _threads() -> int:
    """Notes at a time: one processor is left to the sound."""
    return max(1, cores() - 1)


def _check(preset: Preset) -> None:
    """Raises PresetError for a preset whose strings touch nothing, ValueError where a package is missing."""
    check_touches(preset)
    if (why := missing()) is not None:
        raise ValueError(why)


def check_stroke(preset: Preset, stroke: str) -> None:
    """`_check`; raises ValueError for an unknown stroke, too."""
    _check(preset)
    velocity_named(stroke)


def mapped(preset: Preset, stroke: str, told: Told = _silent) -> dict[str, Any]:
    """The buzz map of a preset.

    stroke, velocity, lines   of the map: what is said of all notes
    notes   a row for each (synth.setup.report.rows), with `key`, its MIDI note, `table` and `opened`, its string's number
            and open note, and `uncertain`: the stroke lies within the threshold's interval

    Raises PresetError, ValueError.
    """
    found = buzz_map(preset, stroke=stroke, threads=_threads(), told=told)
    notes = [
        {**row, "key": spot.note, "table": place.index, "opened": place.opened, "uncertain": spot.uncertain}
        for row, spot, place in zip(rows(found), found.spots, places_of(preset), strict=True)
    ]
    return {
        "stroke": found.stroke,
        "velocity": found.velocity,
        "lines": [*summary(found), *neck_lines(preset)],
        "notes": notes,
    }


def wish_of(preset: Preset, text: str) -> Want:
    """A wish for a preset. Raises ValueError with what is not understood, PresetError where nothing touches or where a long
    buzz is wanted of something else than a bridge."""
    _check(preset)
    want = parse(text, string_names(preset))
    if want.longest:
        longest.bridge_of(preset)
    return want


def proposed(preset: Preset, text: str, told: Told = _silent) -> dict[str, Any]:
    """What a wish makes of a preset: `lines` that say it, and `changes`, {path, value} of each. Raises PresetError,
    ValueError."""
    want = wish_of(preset, text)
    if want.longest:
        velocity = want.rules[0].velocity or 1
        bridges = longest.longest(preset, velocity, threads=_threads(), told=told)
        changes = longest.settings(preset, bridges)
        lines = longest.lines(preset, bridges)
    else:
        answer = proposals.propose(preset, want, threads=_threads(), told=told)
        changes = list(answer.proposal.settings)
        lines = answer.lines()
    return {
        "lines": lines,
        "changes": [{"path": path, "value": value} for path, value in changes],
    }


#: what is checked before a function of this module is asked
CHECKS: dict[str, Callable[[Preset, str], object]] = {"mapped": check_stroke, "proposed": wish_of}
