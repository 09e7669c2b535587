"""A note's dynamics: some are fitted, the others predicted, by the preset, by the fit, and by what needs no model."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from fit_recordings.between import Learned, Off, learn, off
from fit_recordings.strokes import TOP, Player, Sounded
from fit_recordings.takes import File, Take
from synth.fit.contact_features import ContactBands, bands_of
from synth.fit.contact_search import evolve, sobol, starts_of
from synth.fit.fret_features import SECONDS, Heard
from synth.fit.fret_model import RATE_HZ
from synth.instrument.preset import PresetError

Real = NDArray[np.float64]
#: what is fitted and what is predicted: inner dynamics from what is around them, and loud ones from soft ones
SPLITS = {"between": (("pp", "mf", "ff"), ("p", "f")), "beyond": (("pp", "p", "mf"), ("f", "ff"))}
#: levels of the hardest stroke that are tried for the preset as it is
_TOPS = 13
#: a loss that stands for what cannot be played
_UNPLAYABLE = 1e3
#: most that a strength is corrected by at once [dB]
_STEP_DB = 8.0
T = TypeVar("T")


@dataclass(frozen=True)
class Effort:
    """Notes of the dictionary, starts of the evolution, notes of each."""

    notes: int = 32
    starts: int = 2
    most: int = 120


def predict(takes: list[Take], sounded: Sounded, fitted: tuple[str, ...], effort: Effort) -> dict[str, Any]:
    """A row: what the take 1 of each dynamic in `fitted` says, and how far off every other dynamic's takes are.

    Raises FitRefused, ValueError where recordings are too short or too few.
    """
    began = time.process_time()
    bands = bands_of(sounded.model.string, min(RATE_HZ, min(take.note.rate_hz for take in takes)))
    heard = {(take.dynamic, take.take): take.heard(bands) for take in takes}
    train = [min((k for k in heard if k[0] == dynamic), key=lambda k: k[1]) for dynamic in fitted]
    levels = {key: _level_db(one) for key, one in heard.items()}
    loud = int(np.argmax([levels[key] for key in train]))
    levels = {key: level - levels[train[loud]] for key, level in levels.items()}

    def learned(player: Player, top_db: float) -> Learned:
        return _learned(player, [heard[k] for k in train], np.array([levels[k] - top_db for k in train]))

    preset = Player(sounded, None)
    tried = [(float(top), learned(preset, TOP.at(float(top)))) for top in np.linspace(0.0, 1.0, _TOPS)]
    top, by_preset = min(tried, key=lambda each: each[1].loss)
    unknowns = (TOP, *sounded.unknowns)

    def values_at(point: Real) -> tuple[float, dict[str, float]]:
        own = {u.name: u.at(float(x)) for u, x in zip(unknowns, np.clip(point, 0.0, 1.0), strict=True)}
        return own.pop(TOP.name), own

    def loss(point: Real) -> float:
        top_db, own = values_at(point)
        try:
            return learned(Player(sounded, own), top_db).loss
        except (PresetError, ValueError):
            return _UNPLAYABLE

    own = sounded.values()
    start = np.array([top, *(min(1.0, max(0.0, u.share(max(own[u.name], 1e-3)))) for u in sounded.unknowns)])
    points = np.concatenate([start[None], sobol(start.size, effort.notes)])
    losses = np.array([loss(point) for point in points])
    begins = [start, *(s for s in starts_of(points, losses, effort.starts) if not np.array_equal(s, start))][: effort.starts]
    trails = [evolve(loss, each, step=0.1, most=effort.most, seed=i + 1) for i, each in enumerate(begins)]
    best, least = min((trail.best for trail in trails), key=lambda each: each[1])
    if losses[0] < least:
        best, least = start, float(losses[0])
    top_db, found = values_at(best)

    fit = Player(sounded, found)
    by_fit = learned(fit, top_db)
    rows = []
    for key, one in heard.items():
        if key[0] in fitted:
            continue
        row: dict[str, Any] = {"dynamic": key[0], "take": key[1], "level_db": levels[key]}
        for name, player, what, at in (("preset", preset, by_preset, TOP.at(top)), ("fit", fit, by_fit, top_db)):
            row[name] = _said(_predicted(player, one, what, float(what.gains_db[loud]), levels[key] - at))
        nearest = min(train, key=lambda k: abs(levels[k] - levels[key]))
        row["nearest recording"] = _said(off(one, _recorded(heard[nearest])))
        if others := [k for k in heard if k[0] == key[0] and k[1] != key[1]]:
            row["another take"] = _said(off(one, _recorded(heard[others[0]])))
        rows.append(row)
    return {
        "fitted": list(fitted), "predicted": rows, "values": found | {TOP.name: top_db},
        "loss": {"preset": by_preset.loss, "fit": least}, "cpu_s": time.process_time() - began,
    }  # fmt: skip


def has(dynamics: Iterable[str], split: str) -> bool:
    """Whether there are all dynamics that a split fits and one that it predicts."""
    there = set(dynamics)
    fitted, others = SPLITS[split]
    return there >= set(fitted) and bool(there & set(others))


def of_split(files: list[File], split: str) -> list[File]:
    """The files that a split is about."""
    return [file for file in files if any(file[0] in dynamics for dynamics in SPLITS[split])]


def _powers(player: Player, bands: ContactBands, level_db: float) -> Real:
    return bands.powers(player.stroke(level_db), RATE_HZ, SECONDS)


def _learned(player: Player, heard: list[Heard], levels_db: Real) -> Learned:
    """With the strengths at which the strokes are as loud beside the loudest as the recordings are: strings that hit frets
    get louder by less than they are struck harder. Its strength stays. levels_db: first guess, beside the hardest stroke."""
    loudest = int(np.argmax(levels_db))

    def at(levels: Real) -> tuple[Learned, Real]:
        found = learn(heard, [_powers(player, heard[0].bands, float(level)) for level in levels])
        return found, found.gains_db - found.gains_db[loudest]

    return _sought(at, levels_db)


def _predicted(player: Player, heard: Heard, learned: Learned, gain_db: float, level_db: float) -> Off:
    """A stroke that is as loud as the recording, beside what was learned at the loudest one's gain."""

    def at(level: Real) -> tuple[Off, Real]:
        found = off(heard, learned.applied(_powers(player, heard.bands, float(level[0])), heard.bands.hop_s))
        return found, np.array([found.gain_db - gain_db])

    return _sought(at, np.array([level_db]))


def _sought(at: Callable[[Real], tuple[T, Real]], levels_db: Real) -> T:
    """What `at` gives at the levels where what it lacks [dB] is nothing, by two steps of the secant."""
    _, lacking = at(levels_db)
    second = levels_db + np.clip(lacking, -_STEP_DB, _STEP_DB)
    _, left = at(second)
    slope = np.where(second == levels_db, -1.0, (left - lacking) / np.where(second == levels_db, 1.0, second - levels_db))
    return at(second - np.clip(left / np.clip(slope, -2.0, -0.3), -_STEP_DB, _STEP_DB))[0]


def _level_db(heard: Heard) -> float:
    """Of a whole recording, without its noise."""
    return float(10.0 * np.log10((10.0 ** (heard.clean_db[0] / 10.0)).sum(axis=1).mean()))


def _recorded(heard: Heard) -> Real:
    """(W, B) level of a recording, NaN in bands that do not stand out."""
    used = heard.counts[0].sum(axis=0) > 0
    return np.asarray(np.where(used, heard.clean_db[0], np.nan))


def _said(found: Off) -> dict[str, float]:
    return {"spectrum_db": found.spectrum_db, "windows_db": found.windows_db}
