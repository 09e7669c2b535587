"""A page for every preset of the program: to be played and heard, what it is, and how it is played elsewhere."""

from __future__ import annotations

from collections.abc import Iterator

from listening.instruments import DRONE, DRONING

from synth.instrument.articulations import articulation_names
from synth.instrument.catalogue import by_family, notes_of
from synth.instrument.preset import (
    BoardObstacle,
    BridgeObstacle,
    FretsObstacle,
    PointsObstacle,
    Preset,
    StringTable,
    list_presets,
)
from synth.units import midi_to_note

from .markdown import code, fence, link_list, plain

#: the section's folder in the reference
FOLDER = "instruments"
_INTRODUCTION = """# Instruments

The presets that come with the program, by family. Each has a page on which it is played, by mouse, touch, the keys of the
computer or a MIDI keyboard, and heard.
"""
#: names that are listed one by one
_MOST_NAMED = 16


def pages() -> dict[str, str]:
    """Text of every page by its file's name in FOLDER."""
    presets = list_presets()
    return {"index.md": _index(presets), **{f"{preset.name}.md": _page(preset) for preset in presets}}


def _index(presets: list[Preset]) -> str:
    out = [_INTRODUCTION]
    for family, members in by_family(presets):
        out.append(f"## {family[:1].upper()}{family[1:] or 'Others'}\n")
        out.append(
            link_list(f"[{_title(each)}]({each.name}.md), {notes_of(each)}. {plain(each.description)}." for each in members)
        )
    return "\n".join(out)


def _title(preset: Preset) -> str:
    return plain(preset.title or preset.name)


def _page(preset: Preset) -> str:
    name = preset.name
    out = [f"# {_title(preset)}\n", f"{plain(preset.description)}.\n", f"<!-- instrument: {name} -->\n"]
    if preset.family == DRONING:
        out += ["With a drone, which plays by itself:\n", f"<!-- instrument: {name}{DRONE} -->\n"]
    out += [
        "Recorded, for those whose browser computes no strings:\n",
        f"<!-- player: {name} -->\n",
        "## What it is\n",
        _facts(preset),
        "## Elsewhere\n",
        "Live, from a file of notes, as a plugin for music programs, and as a page of one's own "
        "([how](../../how-to/in-a-web-page.md)):\n",
        fence("\n".join(_commands(preset)), "sh"),
        f"`synth presets show {name}` prints its file, with the source of every number.\n",
    ]
    return "\n".join(out)


def _facts(preset: Preset) -> str:
    rows = [
        ("preset", code(preset.name)),
        ("range", notes_of(preset)),
        ("strings", plain(_strings(preset))),
        ("what collides", plain("; ".join(_contacts(preset)))),
        ("body", _body(preset)),
        ("articulations", plain(", ".join(_articulations(preset)))),
        ("tags", plain(", ".join(preset.tags))),
    ]
    return link_list(f"**{name}**: {text}" for name, text in rows if text)


def _strings(preset: Preset) -> str:
    played = [each for each in preset.string if not each.sympathetic]
    choirs = {each.choir for each in played}
    texts = []
    if all(each.notes[0] == each.notes[1] for each in played) and len(played) <= _MOST_NAMED:
        texts.append(f"{len(played)}: {' '.join(map(_sounding, played))}")
    else:
        count = sum(each.notes[1] - each.notes[0] + 1 for each in played)
        texts.append(f"{count}, one for every note" if len(choirs) == 1 else f"{count}, in {len(choirs)} choirs")
    if ringing := sum(each.sympathetic for each in preset.string):
        texts.append(f"{ringing} sympathetic")
    return "; ".join(texts)


def _sounding(each: StringTable) -> str:
    return midi_to_note(each.notes[0] if each.sounds is None else round(each.sounds))


def _contacts(preset: Preset) -> Iterator[str]:
    shape = preset.obstacle
    action = getattr(shape, "action_12th_mm", None)
    height = f", {action:g} mm below them at the octave" if action is not None else ""
    thrown = any(each.stroke == "throw" for each in preset.articulations.values())
    match shape:
        case FretsObstacle():
            yield f"strings with {shape.count} frets{height}"
            if shape.sawari_um is not None:
                yield "an open string with a hill beside the nut (sawari)"
        case BoardObstacle():
            yield f"strings with a board without frets{height}"
        case BridgeObstacle() if shape.has_thread:
            yield "strings with a bridge in front of a thread (jiva)"
        case BridgeObstacle():
            yield "strings with the curve of a bridge (jawari)"
        case PointsObstacle():
            yield f"strings with {len(shape.positions_mm)} point{'s' if len(shape.positions_mm) > 1 else ''} below them"
        case _ if not thrown:
            yield "nothing: the strings are free"
    if thrown:
        yield "strings with what is thrown at them"


def _body(preset: Preset) -> str:
    if preset.coupled:
        return "one that the strings move together, and by which they move each other"
    return "resonances behind the strings" if preset.body.resonance else ""


def _articulations(preset: Preset) -> Iterator[str]:
    for name in articulation_names(preset.articulations) if preset.articulations else ():
        key = preset.articulations[name].key if name in preset.articulations else None
        yield name if key is None else f"{name} ({midi_to_note(key)})"


def _commands(preset: Preset) -> Iterator[str]:
    name = preset.name
    yield f"synth play -p {name}"
    if preset.family == DRONING:
        yield f"synth drone -p {name}"
    yield f"synth render song.mid -p {name} -o song.wav"
    yield f"synth export {name} --install"
    yield f"synth export {name} -f web -o {name}-page"
    if preset.family == DRONING:
        yield f"synth export {name} --drone -f web -o {name}-drone-page"
