"""The engine's own threshold of touch beside the map's: notes of `fretted-bass`, the forces of every step on a tape."""

from __future__ import annotations

import numpy as np

from synth.engine.parameters import INDEX_OF
from synth.host.string_tape import Taped
from synth.instrument.place import NotePlace as Played
from synth.instrument.preset import Preset, load_preset, preset_folder
from synth.midi.events import NOTE_ON, PARAMETER, make_events
from synth.setup.buzz_map import spot
from synth.setup.places import FretPlace, places_of

PRESET, VELOCITY, SECONDS = "fretted-bass", 80, 0.25
#: frets of each string that are played
FRETS = (0, 5, 12)
#: relative width of the last bracket, and the largest amount that is tried
WITHIN, MOST = 2e-3, 8.0


def varied(preset: Preset, *, modulation: bool = True, across: bool = True) -> Preset:
    """The preset with every stroke the same, and without what is not wanted."""
    strings = preset.string
    if not modulation:
        strings = tuple(each.model_copy(update={"tension_modulation": False}) for each in strings)
    changed = {
        "string": strings, "hand": preset.hand.varied(0.0), "articulations": {},
        "pluck": preset.pluck.model_copy(update={"roughness_um": 0.0}),
    }  # fmt: skip
    if not across and preset.polarisation is not None:  # the stroke towards the frets stays what it was
        changed["polarisation"] = None
    return preset.model_copy(update=changed)


def touch_amount(preset: Preset, place: FretPlace) -> float:
    """The least amount of a pluck of `VELOCITY` at which a contact force appears; inf: none up to `MOST`."""
    table = place.table(preset).model_copy(update={"notes": (place.opened, place.opened)})
    alone = preset.model_copy(update={"string": (table,)})
    engine = Taped(Played(alone, place.index, place.opened, place.fret), "standard", precision="float64")

    def touches(amount: float) -> bool:
        engine.reset()
        events = make_events([
            (0, PARAMETER, 0, INDEX_OF["pluck.amount"], 0, amount),
            (0, NOTE_ON, 0, place.note, VELOCITY),
        ])  # fmt: skip
        pieces = engine.pieces(events, round(SECONDS * engine.rate_hz))
        return any([bool(np.any(piece.force > 0.0)) for piece in pieces])  # all of them: the next note begins at rest

    below, above = 0.0, MOST
    if not touches(above):
        return float("inf")
    while above > below * (1.0 + WITHIN):
        middle = 0.5 * (below + above)
        below, above = (below, middle) if touches(middle) else (middle, above)
    return 0.5 * (below + above)


def show() -> None:
    """Prints a row for each note: the map's touch, and how far from it the engine's lies."""
    preset = load_preset(str(preset_folder() / f"{PRESET}.toml"))
    assert preset.polarisation is not None
    normal = float(np.cos(np.radians(preset.polarisation.pluck_deg)))
    ways = {
        "all": varied(preset),
        "without modulation": varied(preset, modulation=False),
        "without second direction": varied(preset, across=False),
        "without both": varied(preset, modulation=False, across=False),
    }
    print(f"| string | fret | touch by the map, mm | {' | '.join(f'{way}, %' for way in ways)} |")
    print(f"|---|---|---|{'---|' * len(ways)}")
    found = []
    for place in places_of(preset, frets=FRETS):
        mapped = spot(preset, place, velocity=VELOCITY, place_m=None, quality="standard")
        row = []
        for version in ways.values():
            drawn = mapped.stroke_m * touch_amount(version, place)
            if version.polarisation is None:
                drawn /= normal
            row.append(100.0 * (drawn / mapped.touch_m - 1.0))
        found.append(row)
        cells = " | ".join(f"{each:+.2f}" for each in row)
        print(f"| {place.string} | {place.fret} | {1e3 * mapped.touch_m:.3f} | {cells} |", flush=True)
    off = np.array(found)
    for way, column in zip(ways, off.T, strict=True):
        print(f"{way}: median {np.median(column):+.2f} %, from {column.min():+.2f} to {column.max():+.2f} %")
