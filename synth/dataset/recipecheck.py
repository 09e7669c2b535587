"""What is wrong with a recipe beyond its tables: presets, articulations, numbers and parameters that are not there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from synth.dataset.alternatives import Alternatives
from synth.dataset.items import Items, Presets, Source
from synth.dataset.recipefile import MOST_ITEMS, Midi, Phrases, PlayedTable, Recipe, RecipeError, Strokes, Written
from synth.dataset.soloist import as_text
from synth.engine.parameters import INDEX_OF, parameters_of
from synth.instrument.preset import Preset, PresetError, playable_notes
from synth.midi.song import read_song
from synth.spelling import perhaps
from synth.units import midi_to_note


def checked_items(written: Written) -> Items:
    """The items of a recipe. Raises RecipeError with all that is wrong with it, each in a line that names file and key."""
    items, lines = None, []
    try:
        items = Items(written)
    except RecipeError as error:
        lines = str(error).splitlines()
    lines += [f"{written.origin}: {line}" for line in _faults(written, [] if items is None else items.sources)]
    if items is not None and items.size > MOST_ITEMS:
        lines.append(
            f"{written.origin}: makes {items.size} items, more than the {MOST_ITEMS} allowed: make several data sets"
        )
    if lines or items is None:
        raise RecipeError("\n".join(dict.fromkeys(lines)))
    return items


def _faults(written: Written, sources: Sequence[Source]) -> Iterator[str]:
    recipe, presets = written.recipe, Presets(written)
    for place, tables in (("notes", recipe.notes), ("phrases", recipe.phrases), ("midi", recipe.midi)):
        for number, table in enumerate(tables):
            for line in _faults_of(table, recipe, presets):
                yield f"{place}.{number}.{line}"
    for source in sources:
        for name in source.files:
            try:
                read_song(str(written.path(name)), recipe.sound.rate_hz, False, None)
            except (ValueError, OSError) as error:
                yield f"midi.{source.number}.files: {str(error).splitlines()[0]}"
    names = [table.name for table in recipe.phrases]
    for name in names:
        if names.count(name) > 1:
            yield f"phrases: two are called {name!r}; rename one of them"


def _faults_of(table: PlayedTable, recipe: Recipe, presets: Presets) -> Iterator[str]:
    for name in table.preset.values or table.preset.one_of:
        if name == "" and isinstance(table, Midi):
            continue
        try:
            preset = presets(name)
        except (ValueError, OSError):  # which has been said
            continue
        for key, axis in table.set.items():
            yield from _faults_of_setting(preset, key, axis)
        if isinstance(table, Strokes):
            yield from _faults_of_strokes(table, name, preset)
        if isinstance(table, Phrases):
            yield from _faults_of_phrase(table, name, preset)
        if recipe.labels.wanted:
            from synth.dataset.labelled_notes import refusal

            if why := refusal(preset):
                yield f"preset: labels: {why}"
    if isinstance(table, Strokes):
        for number in table.controllers:
            if not number.isdecimal() or int(number) > 127:
                yield f"controllers.{number}: a controller is a number from 0 to 127, got {number!r}"


def _faults_of_setting(preset: Preset, key: str, axis: Alternatives) -> Iterator[str]:
    for value in axis.ends():
        try:
            preset.with_setting(key, as_text(value))
        except PresetError as error:
            yield f"set.{key}: {str(error).splitlines()[0]}"
            return


def _faults_of_strokes(table: Strokes, name: str, preset: Preset) -> Iterator[str]:
    for articulation in table.articulation.values or table.articulation.one_of:
        if articulation and articulation not in preset.articulations:
            there = ", ".join(preset.articulations) or "none"
            near = perhaps(articulation, preset.articulations)
            yield f"articulation: {name} does not have {articulation!r}{near}; it has {there}"
    known = {parameter.id: parameter for parameter in parameters_of(0, preset)}
    for key, axis in table.live.items():
        if key not in known:
            near = perhaps(key, known) if key not in INDEX_OF else ""
            yield f"live.{key}: {name} has no such live parameter{near}; it has {', '.join(known)}"
            continue
        low, high = known[key].minimum, known[key].maximum
        for value in axis.ends():
            if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
                yield f"live.{key}: must lie between {low:g} and {high:g}, got {value!r}"


def _faults_of_phrase(table: Phrases, name: str, preset: Preset) -> Iterator[str]:
    there = set(playable_notes(preset))
    for shift in table.transpose.ends():
        gone = [stroke.note + int(shift) for stroke in table.stroke if stroke.note + int(shift) not in there]
        if gone:
            said = midi_to_note(gone[0]) if 0 <= gone[0] <= 127 else f"note {gone[0]}"
            yield f"transpose: {shift:+d} semitones make {said}, which {name} does not play; take notes that it plays"
