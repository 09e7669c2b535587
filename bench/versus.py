"""What two commits are compared by: scenes of `same_sound`, with the presets of the older one and the plans of this one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from bench import scenes
from synth.instrument.preset import parse_preset
from synth.midi.events import NOTE_ON, make_events
from synth.midi.song import read_song
from synth.units import midi_to_note

BASS_NOTES = [(midi, velocity) for velocity in (64, 110) for midi in (28, 38, 50)]
MANY = {f"{scenes.MANY} tanpura strings, all sounding, {n} thread{'s' * (n > 1)}": n for n in (1, 2)}
NOTES = {f"bass note {midi_to_note(midi)}, velocity {v}, whole 3 s": (midi, v) for midi, v in BASS_NOTES}
SONGS = {f"{name}.mid, {preset}, the whole song": (name, preset) for name, preset in scenes.SONGS.items()}
NAMES = (*MANY, *NOTES, *SONGS)
#: seconds of many strings that are timed
_SOUNDING_S = 1.0


def scene(name: str, presets: Path) -> dict[str, Any]:
    """One of NAMES, with presets of that folder. Raises ValueError, OSError."""
    if name in MANY:
        text, began = scenes.many_strings_text(presets), scenes.first_full()
        rows = make_events(scenes.plucks(parse_preset(text, name)))
        return _scene(text, "tanpura", rows, began + _SOUNDING_S, threads=MANY[name]) | {"timed_from": began}
    if name in NOTES:
        midi, velocity = NOTES[name]
        rows = make_events([(0, NOTE_ON, 0, midi, velocity)])
        return _scene(_text(presets, "fretted-bass"), "fretted-bass", rows, 3.0, only_notes=[[midi]])
    song, preset = SONGS[name]
    found = read_song(presets / "demos" / f"{song}.mid", scenes.RATE_HZ)
    keys = sorted(set().union(*found.keys.values()))
    return _scene(_text(presets, preset), preset, found.events, found.length_s + 2.0, only_notes=[keys])


def _text(presets: Path, preset: str) -> str:
    return (presets / f"{preset}.toml").read_text(encoding="utf-8")


def _scene(toml: str, preset: str, events: Any, seconds: float, **options: Any) -> dict[str, Any]:
    from same_sound.render import KINDS

    words = {number: word for word, number in KINDS.items()}
    rows = [
        (event["frame"] / scenes.RATE_HZ, words[int(event["kind"])], *(int(event[k]) for k in ("channel", "a", "b")),
         float(event["value"]))
        for event in events
    ]  # fmt: skip
    return {
        "kind": "engine", "presets": [{"toml": toml, "plan_of": preset}],
        "options": {"quality": "standard", **options}, "events": rows,
        "rate_hz": scenes.RATE_HZ, "seconds": seconds, "blocks": [scenes.BLOCK],
    }  # fmt: skip
