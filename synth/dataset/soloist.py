"""Who plays items: an engine for each preset with its numbers and articulation, reset from item to item."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Iterable
from typing import Any

import numpy as np

from synth.dataset.items import Item, Presets
from synth.dataset.recipefile import Recipe, Written
from synth.dataset.sung import Sung, events_of_item
from synth.engine.engine import Engine
from synth.host import parts
from synth.host.alone import BLOCK, sound_alone
from synth.instrument.compile import CompiledPart, note_frequency
from synth.instrument.preset import Preset
from synth.midi.song import read_song

#: frames that an engine computes in one go
PIECE = 1 << 20
#: engines that are kept at a time; one with the notes of a neck takes some 20 MB
MOST_ENGINES = 24


def as_text(value: Any) -> str:
    """A number, text or list of a recipe as `Preset.with_setting` reads it."""
    return value if isinstance(value, str) else json.dumps(value)


def with_settings(preset: Preset, settings: Iterable[tuple[str, Any]]) -> Preset:
    """A preset with numbers by dotted key. Raises PresetError."""
    for key, value in settings:
        preset = preset.with_setting(key, as_text(value))
    return preset


def played_preset(item: Item, recipe: Recipe, presets: Presets) -> Preset:
    """The preset of an item as it is played: with its numbers, its articulation and its share of variation. Raises
    PresetError or ValueError."""
    preset = with_settings(presets(item.preset), item.settings)
    preset = parts.varied({"": preset}, recipe.sound.variation)[""]
    if item.articulation:
        if item.articulation not in preset.articulations:
            there = ", ".join(preset.articulations) or "none"
            raise ValueError(f"{preset.name} does not have the articulation {item.articulation!r}; it has {there}")
        preset = parts.Part(0, preset.name, articulations=(item.articulation,), notes=0).played(preset)
    return preset


def keys_of(item: Item) -> set[int]:
    """Notes that an item asks for. Raises ValueError for one that is none."""
    keys = {beat.note for beat in item.beats}
    if not all(0 <= key <= 127 for key in keys):
        raise ValueError(f"transposed by {item.transpose} a note of the phrase lies outside of 0 to 127")
    return keys


class Soloist:
    """Plays the items of a recipe, one after the other, on engines of its own; the same bits in whatever order."""

    def __init__(self, written: Written, presets: Presets) -> None:
        self._written, self._recipe, self._presets = written, written.recipe, presets
        self._engines: OrderedDict[Any, Engine] = OrderedDict()
        self._alone: set[Any] = set()  # whose keys cannot be prepared together

    def play(self, item: Item, with_it: Iterable[int] = ()) -> Sung:
        """The sound of an item, with its labels where the recipe asks for some.

        with_it: keys that the same engine will be asked for soon. Raises what is wrong with the item: ValueError
        (PresetError among them), TypeError, RuntimeError, OSError.
        """
        if item.kind == "midi":
            return self._song(item)
        if self._recipe.labels.wanted:
            from synth.dataset.labelled_notes import labelled

            return labelled(item, self._recipe, played_preset(item, self._recipe, self._presets))
        engine = self._engine(item, keys_of(item) | set(with_it))
        engine.reset(item.seed)
        rate_hz = self._recipe.sound.rate_hz
        samples = sound_alone(
            engine, events_of_item(item, rate_hz), item.seconds, rate_hz, np.dtype(np.float64), block=PIECE
        )
        struck = engine.struck
        return Sung(samples, *_names(engine, struck), _pitch(engine, struck) if item.kind == "note" else None)

    def _engine(self, item: Item, keys: set[int]) -> Engine:
        """One that is prepared for at least the item's keys."""
        mine = self._engines.get(item.engine)
        if mine is not None and keys_of(item) <= mine.keys:  # type: ignore[attr-defined]
            self._engines.move_to_end(item.engine)
            return mine
        if mine is not None:
            keys = keys | mine.keys  # type: ignore[attr-defined]
            self._engines.pop(item.engine).close()
        while len(self._engines) >= MOST_ENGINES:
            self._engines.popitem(last=False)[1].close()
        if item.engine in self._alone:
            keys = keys_of(item)
        try:
            made = self._prepared(item, keys)
        except ValueError:
            if keys == keys_of(item):
                raise
            self._alone.add(item.engine)
            made = self._prepared(item, keys_of(item))
        self._engines[item.engine] = made
        return made

    def _prepared(self, item: Item, keys: set[int]) -> Engine:
        preset = played_preset(item, self._recipe, self._presets)
        engine = _Prepared(
            [preset], quality=self._recipe.sound.quality, limiter=False, only_notes=[keys], every_fret=False,
            warn=lambda text: None,
        )  # fmt: skip
        engine.keys = frozenset(keys)
        engine.prepare(self._recipe.sound.rate_hz, BLOCK)
        return engine

    def _song(self, item: Item) -> Sung:
        """Of a MIDI file what `synth render` gives without a limiter."""
        from synth.host.memory import render

        sound, path = self._recipe.sound, str(self._written.path(item.file))
        longest = read_song(path, sound.rate_hz, False, None).length_s > item.seconds
        found = render(
            path,
            self._presets(item.preset) if item.preset else None,
            rate_hz=sound.rate_hz,
            quality=sound.quality,
            variation=sound.variation,
            settings=[(None, key, as_text(value)) for key, value in item.settings],
            transpose={None: item.transpose} if item.transpose else {},
            end_s=item.seconds if longest else None,
            tail=item.release_s,
            limiter=False,
            seed=item.seed,
            threads=1,
            warn=lambda text: None,  # the index counts what is not played
        )
        if found.report.silenced:
            raise RuntimeError("the motion of a string blew up and was silenced")
        return Sung(np.asarray(found.samples), unplayed=sum(row["count"] for row in found.report.unplayed))

    def close(self) -> None:
        """Ends the engines."""
        while self._engines:
            self._engines.popitem()[1].close()


class _Prepared(Engine):
    """An engine that knows which keys it is for."""

    keys: frozenset[int] = frozenset()


def _names(engine: Engine, struck: list[tuple[int, int]]) -> tuple[str, str]:
    """Strings that were struck, and their frets."""
    part: CompiledPart = engine.compiled[0]
    names = "+".join(part.strings[number].name for number, _ in struck)
    return names, "+".join(str(fret) for _, fret in struck)


def _pitch(engine: Engine, struck: list[tuple[int, int]]) -> float | None:
    """Pitch of the first string that was struck, at its fret [Hz]."""
    for number, fret in struck:
        opened = engine.compiled[0].strings[number].open_note
        preset = engine.parts[0]
        for table in preset.string:
            if table.notes[0] <= opened <= table.notes[1] and not table.sympathetic:
                return note_frequency(preset, table, opened + fret, None)
    return None
