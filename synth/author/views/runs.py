"""A note played at a quality, heard and seen: its sound, and the displacement that the project's promises are about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from synth.dsp.measures import log_spectral_distance, relative_error, third_octave_distance
from synth.engine.engine import Engine
from synth.fit.plan_measures import ONSET_S
from synth.fit.plan_strings import as_displacement, in_metres
from synth.host.frames_tape import Frames, line_of
from synth.host.string_tape import RATE_HZ
from synth.instrument.compile import Position
from synth.instrument.place import NotePlace
from synth.instrument.preset import BridgeObstacle, Preset
from synth.midi.events import EVENT, NOTE_ON, make_events

#: where the displacement is looked at, from the saddle, as a share of the open string: at a bridge just behind its edge
SEEN_AT, SEEN_AT_A_BRIDGE = 0.05, 0.009
#: frames between two looks at whether to go on
BLOCK_FRAMES = 2048
#: frames of the reference in one of the output, of strings that share a bridge
FINER = 4


@dataclass(frozen=True)
class NoteRun:
    """One note from the touch of the finger on, without the engine's latency: (frames,) each."""

    sound: np.ndarray
    displacement: np.ndarray
    position: Position
    release_s: float


def run(
    preset: Preset,
    place: NotePlace,
    velocity: int,
    seconds: float,
    quality: str,
    *,
    rate_hz: float = RATE_HZ,
    internal_rate_hz: float | None = None,
    go_on: Callable[[float], None] | None = None,
) -> NoteRun:
    """The note of a preset at a place of it, held, as the engine plays it at a quality, without a limiter. Of strings that
    share a bridge all are there, and the displacement of the one that is played stands for the sound.

    go_on: called with the share done, 0 … 1, between blocks; what it raises ends the run.
    """
    if preset.coupled:
        return _run_together(preset, place, velocity, seconds, quality, rate_hz, internal_rate_hz, go_on)
    engine = Engine(
        [place.preset, as_displacement(place.preset, _seen_at(place.preset))],
        quality=quality,
        internal_rate_hz=internal_rate_hz,
        limiter=False,
        only_notes=[{place.note}, {place.note}],
        every_fret=False,
    )
    if go_on is not None:
        go_on(0.0)
    engine.prepare(rate_hz, BLOCK_FRAMES)
    frames = round(seconds * rate_hz) + engine.latency_samples
    stems = np.zeros((2, frames, 2))
    events = make_events([(0, NOTE_ON, channel, place.note, velocity) for channel in (0, 1)])
    for start in range(0, frames, BLOCK_FRAMES):
        if go_on is not None:
            go_on(start / frames)
        block = np.zeros((2, min(BLOCK_FRAMES, frames - start), 2))
        engine.process(events, np.zeros(block.shape[1:]), block)
        stems[:, start : start + BLOCK_FRAMES] = block
        events = np.zeros(0, EVENT)
    late = engine.latency_samples
    string = engine.compiled[0].strings[0]
    position = next(p for p in string.positions if p.fret == place.fret)
    return NoteRun(stems[0, late:, 0], in_metres(stems[1, late:, 0]), position, string.draw_s)


def _run_together(
    preset: Preset,
    place: NotePlace,
    velocity: int,
    seconds: float,
    quality: str,
    rate_hz: float,
    internal_rate_hz: float | None,
    go_on: Callable[[float], None] | None,
) -> NoteRun:
    """`run` of strings that share a bridge; internal_rate_hz: steps of a frame times rate_hz. `reference` takes as many
    steps of `FINER` times as many frames."""
    finer = FINER if quality == "reference" else 1
    if go_on is not None:
        go_on(0.0)
    steps_hz = None if internal_rate_hz is None else finer * internal_rate_hz
    lines = (line_of(preset, place),)
    made = Frames(preset, place, quality, finer * rate_hz, lines=lines, internal_rate_hz=steps_hz)
    position = made.position(made.line)
    x = np.array([(1.0 - _seen_at(preset)) * position.length_m])
    frames, seen = round(seconds * rate_hz), []
    done = 0
    for shots in made.play(velocity, finer, finer, frames, finer):
        seen.append(made.displacement(shots, x)[:, 0])
        done += len(shots.ends)
        if go_on is not None:
            go_on(done / frames)
    u = np.concatenate(seen)
    return NoteRun(u, u, position, made.strings[made.number].draw_s)


def _seen_at(preset: Preset) -> float:
    return SEEN_AT_A_BRIDGE if isinstance(preset.obstacle, BridgeObstacle) else SEEN_AT


def differences(mine: NoteRun, reference: NoteRun, rate_hz: float = RATE_HZ) -> dict[str, float | None]:
    """{e, e_100ms, log_spectral_db, third_octave_db} of two runs of equal length: e of the displacements, the others of the
    sounds; None where a string that does not move has no error."""
    onset = round(ONSET_S * rate_hz)
    if not (reference.displacement.any() and reference.sound.any()):
        return {"e": None, "e_100ms": None, "log_spectral_db": None, "third_octave_db": None}
    return {
        "e": float(f"{relative_error(mine.displacement, reference.displacement):.3g}"),
        "e_100ms": float(f"{relative_error(mine.displacement[:onset], reference.displacement[:onset]):.3g}"),
        "log_spectral_db": float(f"{log_spectral_distance(mine.sound, reference.sound, rate_hz):.3g}"),
        "third_octave_db": float(f"{third_octave_distance(mine.sound, reference.sound, rate_hz):.3g}"),
    }
