"""The string in slow motion: the engine's own steps, looked at every few of them, with the forces of contact.

film(preset, note, velocity=100, seconds=0.05, frames=150, *, start_s=0.0, quality="standard", rate_hz=44100.0) -> dict.

The note is held; time counts from the moment the finger touches the string, which is when the key goes down. x [m] and
heights [mm] are those of `instrument.draw`; force in N, upwards on the string.

    rate_hz        internal rate; `step_s` its step
    start_s        time of the first frame: `start_s` as asked for, to the next state that the engine keeps (8 steps)
    dt_s           between frames, a whole number of such states, so no frame is an interpolation
    release_s      when the finger lets go
    length_s       how long the note can be looked at (`LONGEST_S`)
    slow_motion    how many times slower a film of 25 frames a second shows it
    x              [M] places: evenly along the speaking string, more of them near a bridge, and every point of contact
    rest           [M] the string's line at rest [mm]
    frames         [[M heights, mm] per frame]
    points         [{index (in the obstacle from the nut), label, x, height, at (place in `x`)}] what the note can touch
    force          [[N per point] per frame] the largest since the frame before it: a contact shorter than a frame shows
    impulse        [[N s per point] per frame] the sum of the same time
    finger         [height (mm) to which the finger draws the string, null without it] per frame; `finger_x` its place
    output         [the instrument's sound at the frame's time, before any limiter] per frame
    height_mm      [lowest, highest] of all frames
    largest_n      of `force`

Of strings that share a bridge there is more, and the string moves with its end: `coupled_motion`.

Raises PresetError where no string plays the note, ValueError for a time or a number of frames out of range.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from synth.author.views.coupled_motion import film_together
from synth.author.views.film_shapes import line_at_finger, mostly_zero, places_along, rounded
from synth.author.views.instrument import draw
from synth.host.string_tape import QUALITY, RATE_HZ, Taped
from synth.instrument.place import find, shapes_at, speaking
from synth.instrument.preset import Preset
from synth.solver.block_rows import BLOCK

LONGEST_S = 10.0
MOST_FRAMES = 300


@threadpool_limits.wrap(limits=1, user_api="blas")
def film(
    preset: Preset,
    note: int,
    velocity: int = 100,
    seconds: float = 0.05,
    frames: int = 150,
    *,
    start_s: float = 0.0,
    quality: str = QUALITY,
    rate_hz: float = RATE_HZ,
) -> dict[str, Any]:
    """The film of one note; see the module's docstring."""
    if not 2 <= frames <= MOST_FRAMES:
        raise ValueError(f"frames must lie between 2 and {MOST_FRAMES}, got {frames}")
    if not (start_s >= 0.0 and seconds > 0.0 and start_s + seconds <= LONGEST_S):
        raise ValueError(f"the film must lie within 0 and {LONGEST_S:g} s, got {start_s:g} s and {seconds:g} s more")
    if preset.coupled:
        return film_together(preset, note, velocity, seconds, frames, start_s, LONGEST_S, quality, rate_hz)
    place = find(preset, note)
    drawing = draw(preset, note, velocity)
    engine = Taped(place, quality, rate_hz)
    position = engine.position
    step_s = engine.step_s
    stride = max(1, round(seconds / ((frames - 1) * BLOCK * step_s))) * BLOCK
    first = round(start_s / (BLOCK * step_s)) * BLOCK
    wanted = first + stride * np.arange(frames)
    shots = _shots(engine, velocity, wanted, stride)
    scene = speaking(place)
    x = places_along(scene)
    shapes = shapes_at(scene, position, x)
    heights = shots.q @ shapes.T
    nut = drawing["open_length_m"] - position.length_m
    rest = (
        position.rest_height_m * (1.0 - x / position.length_m) + 1e-3 * drawing["saddle"]["height"] * x / position.length_m
    )
    output = _sound_at(shots.out, wanted * step_s, engine)
    in_play = [point for point in drawing["points"] if point["in_play"]]
    points = [
        {**{name: point[name] for name in ("index", "label", "x", "height")}, "at": int(np.argmin(np.abs(x - contact)))}
        for point, contact in zip(in_play, scene.reached.positions_m, strict=True)
    ]
    all_mm = 1e3 * (heights + rest)
    return {
        "rate_hz": position.plan.rate_hz,
        "step_s": step_s,
        "start_s": round(first * step_s, 9),
        "dt_s": stride * step_s,
        "release_s": round(engine.compiled[0].strings[0].draw_s * rate_hz) / rate_hz,
        "length_s": LONGEST_S,
        "slow_motion": round(1.0 / (25.0 * stride * step_s), 1),
        "x": [round(float(place_m), 6) for place_m in nut + x],
        "rest": rounded(1e3 * rest, 5),
        "frames": rounded(all_mm, 4),
        "points": points,
        "force": mostly_zero(shots.force, 4),
        "impulse": mostly_zero(shots.impulse, 8),
        "finger": [
            None if math.isnan(h) else round(1e3 * h + line_at_finger(rest, x, drawing, nut), 4) for h in shots.finger
        ],
        "finger_x": drawing["pluck"]["x"],
        "output": rounded(output, 6),
        "height_mm": [round(float(all_mm.min()), 4), round(float(all_mm.max()), 4)],
        "largest_n": round(float(shots.force.max(initial=0.0)), 4),
    }


class _Shots:
    """What the tape had at the wanted steps. F frames, C contacts, N modes."""

    def __init__(self, frames: int, contacts: int, modes: int) -> None:
        self.q = np.zeros((frames, modes))
        self.finger = np.full(frames, np.nan)
        self.force = np.zeros((frames, contacts))
        self.impulse = np.zeros((frames, contacts))
        self.out = np.zeros(0)


def _shots(engine: Taped, velocity: int, wanted: np.ndarray, stride: int) -> _Shots:
    position = engine.position
    shots = _Shots(wanted.size, position.eta.size, position.omega.size)
    out = []
    best = np.full(wanted.size, np.iinfo(np.int64).max)
    for piece in engine.play(velocity, (int(wanted[-1]) + BLOCK) * engine.step_s):
        out.append(piece.out.copy())
        if piece.ends.size:
            # the state nearest to each wanted step: at it, but for the rests of blocks around a release
            nearest = np.searchsorted(piece.ends, wanted)
            for candidate in (nearest - 1, nearest):
                inside = (candidate >= 0) & (candidate < piece.ends.size)
                at = np.where(inside, candidate, 0)
                off = np.where(inside, np.abs(piece.ends[at] - wanted), np.iinfo(np.int64).max)
                better = off < best
                shots.q[better] = piece.q[at[better]]
                shots.finger[better] = piece.finger[at[better]]
                best[better] = off[better]
        _add_forces(shots, piece.force, piece.first, wanted, stride, engine.step_s)
    shots.out = np.concatenate(out)
    shots.q[wanted == 0] = position.q_rest
    return shots


def _add_forces(shots: _Shots, force: np.ndarray, first: int, wanted: np.ndarray, stride: int, step_s: float) -> None:
    """Forces of steps first, first + 1, … to the frames in whose time they act: after the one before, up to it."""
    steps, points = np.nonzero(force > 0.0)
    frame = (first + steps - int(wanted[0])) // stride + 1
    keep = (frame >= 0) & (frame < wanted.size)
    values = force[steps[keep], points[keep]]
    np.maximum.at(shots.force, (frame[keep], points[keep]), values)
    np.add.at(shots.impulse, (frame[keep], points[keep]), values * step_s)


def _sound_at(out: np.ndarray, times_s: np.ndarray, engine: Taped) -> np.ndarray:
    """(F,) the sound that leaves the string at these times."""
    at = np.round(times_s * engine.rate_hz).astype(int) + engine.latency_samples
    return out[np.minimum(at, out.size - 1)]
