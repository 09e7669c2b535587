"""What a hand does, in recordings and in ours: how soft and loud differ, takes, releases, slaps, mutes, harmonics."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping

import numpy as np

from synth.fit.recording import FitRefused
from synth.units import midi_to_hz, midi_to_note
from truth_of_sound import measure
from truth_of_sound.sources import Recorded

#: softest and loudest layer
_LAYERS = ("pp", "ff")


def of_recordings(recorded: Iterable[Recorded]) -> dict[str, dict[str, float]]:
    """{measure: {note or file: value}} of what the basses' recordings say of the hand."""
    found: dict[str, dict[str, float]] = defaultdict(dict)
    layers: dict[tuple[str, int], dict[str, list[measure.RecordedNote]]] = defaultdict(lambda: defaultdict(list))
    for each in recorded:
        name = each.name.rsplit("/", 1)[-1].rsplit(".", 1)[0]
        hz = float(midi_to_hz(each.note))
        if each.kind == "short":
            x = each.samples.mean(axis=1)
            for key, value in measure.release(x, each.rate_hz, measure.released_s(x, each.rate_hz)).items():
                found[key][name] = value
            continue
        note = measure.cut(each.samples, each.rate_hz)
        if each.kind == "harmonic":
            # the string's whole length sounds an octave below
            found["fundamental_db"][name] = measure.touched(note, 0.5 * hz)["fundamental_db"]
        elif each.kind == "palm-mute":
            decays = measure.decays_s(measure.partials(note, hz))
            found[f"palm_mute_{midi_to_note(each.note).lower()}_t60"] = {str(number): t for number, t in decays.items()}
        elif "slap" in each.group:
            for key, value in measure.burst(note).items():
                found[key][name] = value
        elif each.dynamic:
            layers[each.group.split()[0], each.note][each.dynamic].append(note)
    for (_, number), by_dynamic in layers.items():
        for key, value in dynamics(by_dynamic, number).items():
            found[key][str(number)] = value
    return dict(found)


def rise(soft: Mapping[str, float], loud: Mapping[str, float]) -> dict[str, float]:
    """How far level and tilt of a loud note (`measure.early`) lie above those of a soft one."""
    pairs = (("level_rise_db", "level_db"), ("tilt_rise_db_octave", "tilt_db_octave"))
    return {name: loud[key] - soft[key] for name, key in pairs}


def dynamics(notes: Mapping[str, list[measure.RecordedNote]], number: int) -> dict[str, float]:
    """Of a note played pp and ff, several times: `rise`, `glide_cents` of ff, `takes_apart_db`."""
    hz = float(midi_to_hz(number))
    out = {}
    soft, loud = ([measure.early(note, hz) for note in notes.get(layer, [])] for layer in _LAYERS)
    if soft and loud:
        out |= rise(*({key: float(np.mean([e[key] for e in each])) for key in each[0]} for each in (soft, loud)))
    glides = []
    for note in notes.get("ff", []):
        try:
            glides.append(measure.ring(note, hz)["glide_cents"])
        except (FitRefused, KeyError):
            continue
    if glides:
        out["glide_cents"] = float(np.median(glides))
    apart = [measure.takes_apart_db(takes[0], other, hz) for takes in notes.values() for other in takes[1:]]
    if apart:
        out["takes_apart_db"] = float(np.median(apart))
    return out
