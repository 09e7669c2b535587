"""An item with the motion that made its sound: the same engine's own steps, kept on a tape (`host.string_tape`).

The note's string is played by itself, with its modes in float64 and no economy (at every step, in every mode), so that the
sound *is* that motion heard: forces of every step, and the modes as they were. What strings that share a bridge, or several
to a key, do is not on a tape of one string, nor what a fingerboard does: such presets are refused.

Arrays, along the first axis; times count from the sound's first sample, steps are of the internal rate:

    contact_point     (K,) which point, counted from the nut            contact_start_s, contact_end_s, contact_peak_n,
                      contact_impulse_ns (K,): each touch of each point, in order of time
    change_step, change_bend, change_hand   (B,) from which step on the string is bent by so many semitones, by its own
                      motion or by a player, and how much faster it decays under the damping hand [1/s]
    force_step, force_point, force_n   (F,) every step at which a point was pressed, exactly as the solver had it [N]
    state_step, state_s   (S,) steps made when the state was taken, and the time [s]
    finger_m          (S,) height to which a finger holds the string [m], nan without one
    state_q, state_v  (S·N,) coordinates and speeds of the modes, state after state
    mode_number       (N,) of the string's own modes, from 1; 0 of a lumped mode, which stands for those left out
    mode_omega, mode_sigma, mode_wq, mode_wv   (N,) angular frequencies [rad/s], decays [1/s], output weights of the modes
                      of a string that is neither bent nor damped
    point_x_m, point_height_m   (C,) place from the speaking string's end at nut or fret, height over its line at rest [m]
    point_shape       (C·N,) shapes of the modes at the points, point after point [1/√m]
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from threadpoolctl import threadpool_limits

from synth.dataset.items import Item
from synth.dataset.recipefile import Labels, Recipe
from synth.dataset.sung import Sung, events_of_item
from synth.host.alone import check_played
from synth.host.contacts import Forces, contacts_of, gather, touches
from synth.host.string_tape import Taped
from synth.instrument.place import find, speaking
from synth.instrument.preset import BoardObstacle, Preset, PresetError

#: prepared tapes that are kept
_KEPT = 24


def refusal(preset: Preset) -> str:
    """Why the motion of a preset's strings cannot be labelled; "" where it can."""
    if preset.coupled:
        return f"{preset.name} has strings that share a bridge; take presets whose strings stand alone"
    if isinstance(preset.obstacle, BoardObstacle):
        return f"{preset.name} has a fingerboard, whose contact forces are not recorded; take presets with frets or bridges"
    if any(table.choir != 1 for table in preset.string):
        return f"{preset.name} sounds several strings at a key; take presets that sound one"
    return ""


@threadpool_limits.wrap(limits=1, user_api="blas")
def labelled(item: Item, recipe: Recipe, preset: Preset) -> Sung:
    """The sound of a note and its labels. Raises PresetError, ValueError or RuntimeError for what is wrong with it."""
    why = refusal(preset)
    if why:
        raise PresetError(f"labels: {why}")
    assert item.note is not None
    engine = _taped(preset, item.note, recipe.sound.quality, recipe.sound.rate_hz)
    engine.reset(item.seed)
    rate_hz = recipe.sound.rate_hz
    wanted, due = recipe.labels, events_of_item(item, rate_hz)
    frames = round(item.seconds * rate_hz)
    heard, pressed, states, changes = [], [], _States(wanted, engine), _Changes()
    for piece in engine.pieces(due, frames):
        heard.append(piece.both.copy())
        pressed.append(touches(piece.first, piece.force))
        states.look(piece.ends, piece.q, piece.v, piece.finger)
        changes.look(piece.first, piece.ends, piece.bend, piece.hand)
    check_played(engine, due)
    samples = np.concatenate(heard)[engine.latency_samples :]
    last = frames * engine.compiled[0].strings[0].factor
    forces = _until(gather(pressed, engine.step_s), last)
    position, place = engine.position, engine.place
    arrays = _of_forces(forces, wanted, place.sounding_hz) | states.arrays(last) | changes.arrays(last)
    arrays |= {
        "mode_number": np.where(
            np.arange(position.omega.size) < position.own, np.arange(1, position.omega.size + 1), 0
        ).astype(np.int32),
        "mode_omega": position.omega,
        "mode_sigma": position.sigma,
        "mode_wq": position.wq,
        "mode_wv": position.wv,
        "point_x_m": np.asarray(speaking(place).reached.positions_m, np.float64),
        "point_height_m": position.eta,
        "point_shape": position.shapes.ravel(),
    }
    facts = {
        "label_rate_hz": float(position.plan.rate_hz),
        "length_m": position.length_m,
        "tension_n": position.tension_n,
        "linear_density_kg_m": position.mu,
    }
    return Sung(samples, place.label, str(place.fret), place.sounding_hz, labels=arrays, facts=facts)


@lru_cache(_KEPT)
def _kept(key: str, note: int, quality: str, rate_hz: int) -> list[Taped]:
    return []


def _taped(preset: Preset, note: int, quality: str, rate_hz: int) -> Taped:
    kept = _kept(preset.model_dump_json(), note, quality, rate_hz)
    if not kept:
        kept.append(Taped(find(preset, note), quality, rate_hz, precision="float64"))
    return kept[0]


def _until(forces: Forces, step: int) -> Forces:
    """Without what follows the sound's end: the engine is as much ahead as it is late."""
    early = forces.step < step
    return Forces(forces.step[early], forces.point[early], forces.force[early], forces.step_s)


def _of_forces(forces: Forces, wanted: Labels, pitch_hz: float) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = {}
    if wanted.contacts:
        contacts = contacts_of(forces, 1.0 / pitch_hz)
        found["contact_point"] = np.array([each.point for each in contacts], np.int32)
        for name in ("start_s", "end_s", "peak_n", "impulse_ns"):
            found[f"contact_{name}"] = np.array([getattr(each, name) for each in contacts], np.float64)
    if wanted.forces:
        found["force_step"] = forces.step.astype(np.int64)
        found["force_point"] = forces.point.astype(np.int32)
        found["force_n"] = forces.force.astype(wanted.dtype)
    return found


class _States:
    """The states nearest behind each multiple of 1/state_hz, as they were; none is interpolated."""

    def __init__(self, wanted: Labels, engine: Taped) -> None:
        self._wanted = wanted
        self._step_s = engine.step_s
        self._every = 1.0 / (wanted.state_hz * engine.step_s) if wanted.state_hz else np.inf
        self._next = 0.0
        self._parts: list[tuple[np.ndarray, ...]] = []
        self._modes = engine.position.omega.size

    def look(self, ends: np.ndarray, q: np.ndarray, v: np.ndarray, finger: np.ndarray) -> None:
        """Takes copies of those states of a piece that are wanted."""
        if not self._wanted.state_hz:
            return
        taken = []
        for shot, end in enumerate(ends):
            if end >= self._next:
                taken.append(shot)
                self._next = (np.floor(end / self._every) + 1.0) * self._every
        self._parts.append((ends[taken].copy(), finger[taken].copy(), q[taken].copy(), v[taken].copy()))

    def arrays(self, last: int) -> dict[str, np.ndarray]:
        """Those up to the last step."""
        if not self._wanted.state_hz:
            return {}
        ends, finger, q, v = (np.concatenate(each) for each in zip(*self._parts, strict=True))
        early = ends <= last
        kind = self._wanted.dtype
        return {
            "state_step": ends[early].astype(np.int64),
            "state_s": ends[early] * self._step_s,
            "finger_m": finger[early].astype(kind),
            "state_q": q[early].astype(kind).ravel(),
            "state_v": v[early].astype(kind).ravel(),
        }


class _Changes:
    """From which step on the string's frequencies and decays are others: bent, or under the damping hand."""

    def __init__(self) -> None:
        self._rows: list[tuple[int, float, float]] = [(0, 0.0, 0.0)]

    def look(self, first: int, ends: np.ndarray, bend: np.ndarray, hand: np.ndarray) -> None:
        """Takes those of a piece; `first` steps were made before it."""
        begins = np.concatenate([[first], ends[:-1]])
        for begin, semitones, sigma in zip(begins, bend, hand, strict=True):
            if (semitones, sigma) != self._rows[-1][1:]:
                self._rows.append((int(begin), float(semitones), float(sigma)))

    def arrays(self, last: int) -> dict[str, np.ndarray]:
        """Those before the last step."""
        steps, bends, hands = (np.array(column) for column in zip(*self._rows, strict=True))
        early = steps < last
        return {
            "change_step": steps[early].astype(np.int64),
            "change_bend": bends[early].astype(np.float64),
            "change_hand": hands[early].astype(np.float64),
        }
