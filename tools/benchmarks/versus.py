"""What two commits are compared by: scenes of `same_sound`, with the presets of the older one.

Each side has the plan that it ships for a preset of that name, as far as it was measured of these very strings: where a
preset has become another since, the newer side plans it by the law. The mode-steps of both sides say so.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks import coupled_scenes, scenes
from synth.instrument.preset import Preset, parse_preset
from synth.midi.events import NOTE_ON, make_events
from synth.midi.song import read_song
from synth.units import midi_to_note

BASS_NOTES = [(midi, velocity) for velocity in (64, 110) for midi in (28, 38, 50)]
MANY = {f"{scenes.MANY} tanpura strings, all sounding, {n} thread{'s' * (n > 1)}": n for n in (1, 2)}
NOTES = {f"bass note {midi_to_note(midi)}, velocity {v}, whole 3 s": (midi, v) for midi, v in BASS_NOTES}
SONGS = {f"{name}.mid, {preset}, the whole song": (name, preset) for name, preset in scenes.SONGS.items()}
TWELVE = {f"{preset}, twelve notes": preset for preset in coupled_scenes.TWELVE}
STRUMMED = {f"{preset}, chords without end": preset for preset in coupled_scenes.STRUMMED}
GESTURES = {
    f"{preset}, a note under {gesture}": (preset, gesture)
    for preset in ("steel-guitar", "nylon-guitar", "banjo", "sitar")
    for gesture in ("vibrato", "bend")
}
SIXTY = f"{coupled_scenes.SIXTY_STRINGS} coupled strings on {len(coupled_scenes.SIXTY)} bridges"
COUPLED = (*TWELVE, *STRUMMED, *GESTURES, SIXTY)
NAMES = (*MANY, *NOTES, *SONGS, *COUPLED)
#: seconds of many strings that are timed
_SOUNDING_S = 1.0


def scene(name: str, presets: Path) -> dict[str, Any]:
    """One of NAMES, with presets of that folder. Raises ValueError, OSError."""
    if name in MANY:
        text, began = scenes.many_strings_text(presets), scenes.first_full()
        rows = make_events(scenes.plucks(parse_preset(text, name)))
        return _scene(text, "tanpura-light", rows, began + _SOUNDING_S, threads=MANY[name]) | {"timed_from": began}
    if name in NOTES:
        midi, velocity = NOTES[name]
        rows = make_events([(0, NOTE_ON, 0, midi, velocity)])
        return _scene(_text(presets, "fretted-bass"), "fretted-bass", rows, 3.0, only_notes=[[midi]])
    if name in COUPLED:
        return _coupled(name, presets)
    song, preset = SONGS[name]
    found = read_song(presets / "demos" / f"{song}.mid", scenes.RATE_HZ)
    keys = sorted(set().union(*found.keys.values()))
    return _scene(_text(presets, preset), preset, found.events, found.length_s + 2.0, only_notes=[keys])


def _coupled(name: str, presets: Path) -> dict[str, Any]:
    """Of `coupled_scenes`, with presets of that folder."""

    def read(preset: str) -> Preset:
        return parse_preset(_text(presets, preset), preset)

    block = coupled_scenes.LIVE_BLOCK
    if name in TWELVE:
        names, block = (TWELVE[name],), coupled_scenes.BLOCK
        rows, seconds = coupled_scenes.rows_of_twelve(read(*names)), coupled_scenes.TWELVE_S
    elif name in STRUMMED:
        names, seconds = (STRUMMED[name],), coupled_scenes.STRUMMED_S
        rows = coupled_scenes.rows_of_chords(seconds)
    elif name in GESTURES:
        preset, gesture = GESTURES[name]
        names, seconds = (preset,), coupled_scenes.GESTURE_S
        rows = coupled_scenes.rows_of_gesture(read(preset), gesture)
    else:
        names = coupled_scenes.SIXTY
        rows = coupled_scenes.rows_of_sixty([read(each) for each in names])
        seconds = rows[-1][0] / scenes.RATE_HZ + coupled_scenes.SIXTY_S
    struck: list[list[int]] = [sorted(each) for each in coupled_scenes.struck(rows, len(names))]
    options = {"quality": "standard", "only_notes": struck, "every_fret": False, "limiter": False}
    return _scene_of([(_text(presets, each), each) for each in names], make_events(rows), seconds, block, **options)


def _text(presets: Path, preset: str) -> str:
    return (presets / f"{preset}.toml").read_text(encoding="utf-8")


def _scene(toml: str, preset: str, events: Any, seconds: float, **options: Any) -> dict[str, Any]:
    return _scene_of([(toml, preset)], events, seconds, scenes.BLOCK, **({"quality": "standard"} | options))


def _scene_of(presets: list[tuple[str, str]], events: Any, seconds: float, block: int, **options: Any) -> dict[str, Any]:
    """Presets as text, each with the plan of the preset of a name."""
    from same_sound.render import KINDS

    words = {number: word for word, number in KINDS.items()}
    rows = [
        (event["frame"] / scenes.RATE_HZ, words[int(event["kind"])], *(int(event[k]) for k in ("channel", "a", "b")),
         float(event["value"]))
        for event in events
    ]  # fmt: skip
    return {
        "kind": "engine", "presets": [{"toml": toml, "plan_of": preset} for toml, preset in presets],
        "options": options, "events": rows, "rate_hz": scenes.RATE_HZ, "seconds": seconds, "blocks": [block],
    }  # fmt: skip
