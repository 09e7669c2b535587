"""Presets by family and tag: what lists and browsers show of them, and how they are found."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Any

from synth.instrument.articulations import articulation_names
from synth.instrument.preset import Preset, PresetError, playable_range
from synth.spelling import perhaps
from synth.units import midi_to_note


def by_family(presets: Iterable[Preset]) -> list[tuple[str, list[Preset]]]:
    """(family, its presets) in the order of names; those without a family ("") come last."""
    ordered = sorted(presets, key=lambda preset: (not preset.family, preset.family, preset.name))
    return [(family, list(members)) for family, members in groupby(ordered, key=lambda preset: preset.family)]


def find(presets: Sequence[Preset], tags: Iterable[str] = (), family: str | None = None) -> list[Preset]:
    """Presets of a family that have all the tags, grouped as by `by_family`. Upper case does not matter, and a family's name
    counts as a tag. Raises PresetError for a tag or a family that no preset has, with the nearest that there is, and for
    tags that no preset has together."""
    families = sorted({preset.family for preset in presets if preset.family})
    tags = [tag.strip().lower() for tag in tags]
    if family is not None:
        family = family.strip().lower()
        _check("family", family, families)
    known = sorted({tag for preset in presets for tag in preset.tags} | set(families))
    for tag in tags:
        _check("tag", tag, known)
    ordered = [preset for _, members in by_family(presets) for preset in members]
    chosen = [preset for preset in ordered if family in (None, preset.family) and set(tags) <= {*preset.tags, preset.family}]
    if not chosen and presets:
        what = [f"family {family}"] if family is not None else []
        raise PresetError(f"no preset has {' and '.join(what + [f'tag {tag}' for tag in tags])} together; leave one out")
    return chosen


def _check(what: str, word: str, known: Sequence[str]) -> None:
    if word not in known:
        raise PresetError(f"no preset has the {what} {word!r}{perhaps(word, known)}; there are {', '.join(known)}")


def notes_of(preset: Preset) -> str:
    """Lowest and highest note, "E1–C7"."""
    low, high = (midi_to_note(note) for note in playable_range(preset))
    return low if low == high else f"{low}–{high}"


def row(preset: Preset) -> dict[str, Any]:
    """What is listed of a preset, as plain data: name, title, description, family, tags, range (names of the lowest and
    highest note), articulations (names, the normal one first)."""
    low, high = playable_range(preset)
    return {
        "name": preset.name,
        "title": preset.title,
        "description": preset.description,
        "family": preset.family,
        "tags": list(preset.tags),
        "range": [midi_to_note(low), midi_to_note(high)],
        "articulations": articulation_names(preset.articulations),
    }
