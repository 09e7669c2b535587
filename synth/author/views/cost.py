"""What a note costs on this machine, what its plan promises, and how far it is from a converged run.

estimate(preset, note, velocity=100, *, quality="standard", rate_hz=44100.0) -> dict

    quality, rate_hz (internal), factor (times the output rate), modes, contacts
    scene             "nothing to touch", "bridge", "bridge plucked from afar" or "impacts": what decides the promise
    promise, reason   of the plan, in words
    real_time_factor  seconds of sound per second of one core, of this string from the pluck on, measured over `MEASURED_S`
    worst_block       largest share of its time that a block of `BLOCK_FRAMES` took
    polyphony, load   strings that the preset lets sound, and the share of one core that so many of these would take
    together          whether strings share a bridge: then all of them are in the real-time factor and in the load
    compile_s         time to prepare this note
    error             {over_s, e, e_100ms, log_spectral_db, third_octave_db} of the first `COMPARED_S`, against the quality
                      `reference`; e of the displacement, the others of the sound (over longer e grows); null of
                      strings that share a bridge
    reference_rate_hz of that run
    qualities         [{quality, rate_hz, factor, promise}] what the others would take and promise

Times are processor time of the thread that computes, so that other programs count little. Raises PresetError where no string
plays the note, ValueError for a quality that there is not.
"""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from synth.author.views.runs import differences, run
from synth.engine.engine import Engine
from synth.engine.engine_settings import SETTINGS
from synth.host.frames_tape import string_number
from synth.host.string_tape import QUALITY, RATE_HZ
from synth.instrument.boards import board_plan
from synth.instrument.compile import measured_of, note_frequency, string_kind
from synth.instrument.coupled_plan import choose_steps
from synth.instrument.place import NotePlace, Speaking, find, speaking
from synth.instrument.plan import BRIDGE, CURVED, FAR, FREE, IMPACTS, choose_factor, measured_plan
from synth.instrument.preset import BoardObstacle, Preset
from synth.instrument.qualities import QUALITIES
from synth.midi.events import EVENT, NOTE_ON, make_events
from synth.physics.string import String

MEASURED_S = 1.0
COMPARED_S = 0.4
BLOCK_FRAMES = 256
#: `runs.differences` of what was not compared
UNKNOWN: dict[str, float | None] = dict.fromkeys(("e", "e_100ms", "log_spectral_db", "third_octave_db"))
BOARD = "board"
SCENES = {
    BOARD: "board without frets",
    FREE: "nothing to touch",
    BRIDGE: "bridge",
    CURVED: "curved bridge",
    FAR: "bridge plucked from afar",
    IMPACTS: "impacts",
}


@threadpool_limits.wrap(limits=1, user_api="blas")
def estimate(
    preset: Preset, note: int, velocity: int = 100, *, quality: str = QUALITY, rate_hz: float = RATE_HZ
) -> dict[str, Any]:
    """The cost of one note; see the module's docstring."""
    quality = SETTINGS["quality"].checked("quality", quality)
    place = find(preset, note)
    begun = time.thread_time()
    whole = preset if preset.coupled else place.preset
    engine = Engine([whole], quality=quality, limiter=False, only_notes=[{note}], every_fret=False)
    engine.prepare(rate_hz, BLOCK_FRAMES)
    compiled_s = time.thread_time() - begun
    blocks = _blocks_s(engine, note, velocity)
    factor = blocks.size * BLOCK_FRAMES / rate_hz / blocks.sum()
    string = engine.compiled[0].strings[string_number(preset, place) if preset.coupled else 0]
    position = next(p for p in string.positions if p.fret == place.fret)
    scene = speaking(place)
    on_board = isinstance(preset.obstacle, BoardObstacle)
    kind = BOARD if on_board else string_kind(preset, scene.opened, scene.below)
    error, reference_hz = UNKNOWN, None
    if not preset.coupled:  # whose converged run takes ten times as long: `reference` makes it where it is asked for
        mine, reference = (run(preset, place, velocity, COMPARED_S, q, rate_hz=rate_hz) for q in (quality, "reference"))
        error, reference_hz = differences(mine, reference, rate_hz), reference.position.plan.rate_hz
    polyphony = preset.mapping.polyphony
    return {
        "quality": quality,
        "rate_hz": position.plan.rate_hz,
        "factor": position.plan.factor,
        "modes": position.plan.modes,
        "contacts": position.plan.contacts,
        "scene": SCENES[kind],
        "promise": position.plan.error,
        "reason": position.plan.reason,
        "real_time_factor": round(float(factor), 1),
        "worst_block": round(float(blocks.max()) * rate_hz / BLOCK_FRAMES, 4),
        "together": preset.coupled,
        "polyphony": polyphony,
        "load": round(float((1 if preset.coupled else polyphony) / factor), 4),
        "compile_s": round(compiled_s, 4),
        "error": {"over_s": COMPARED_S, **error},
        "reference_rate_hz": reference_hz,
        "qualities": [
            _on_board(place.preset, scene.opened, q, rate_hz)
            if on_board
            else _quality(preset, place, scene, kind, q, rate_hz)
            for q in QUALITIES
        ],
    }


def _quality(preset: Preset, place: NotePlace, scene: Speaking, kind: str, quality: str, rate_hz: float) -> dict[str, Any]:
    """What a quality takes and promises on the string of a place."""
    open_hz = note_frequency(place.preset, place.table, place.opened, None)
    found = measured_of(place.preset, place.table, place.opened, open_hz, quality, rate_hz)
    contacts = len(scene.reached)
    plan = None
    if found is not None:
        plan = measured_plan(scene.string, contacts, kind, found, quality=quality, rate_hz=rate_hz)
    if plan is not None:
        return {"quality": quality, "rate_hz": plan.rate_hz, "factor": plan.factor, "promise": plan.error}
    choose = choose_steps if preset.coupled else choose_factor
    factor, promise = choose(open_hz, kind, quality, rate_hz)
    return {"quality": quality, "rate_hz": factor * rate_hz, "factor": factor, "promise": promise}


def _on_board(preset: Preset, opened: String, quality: str, rate_hz: float) -> dict[str, Any]:
    """The same of a string over a board."""
    plan = board_plan(preset, opened, opened.length_m, quality, rate_hz, "exact-hold", None)
    return {"quality": quality, "rate_hz": plan.rate_hz, "factor": plan.factor, "promise": plan.error}


def _blocks_s(engine: Engine, note: int, velocity: int) -> np.ndarray:
    """Processor time of every block from the pluck on [s]."""
    events = make_events([(0, NOTE_ON, 0, note, velocity)])
    out = np.zeros((BLOCK_FRAMES, 2))
    engine.process(events, out)  # what a first call waits for is no cost of the note
    engine.reset()
    taken = []
    for _ in range(math.ceil(MEASURED_S * engine.rate_hz / BLOCK_FRAMES)):
        begun = time.thread_time()
        engine.process(events, out)
        taken.append(time.thread_time() - begun)
        events = np.zeros(0, EVENT)
    return np.array(taken)
