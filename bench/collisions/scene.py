"""Scenes as others read them: the numbers of NAME.json, and whether they are still those of the benchmark's version."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from bench.collisions import FOLDER, VERSION, ContestError
from synth.spelling import perhaps

SCENES, OUTSIDE, REFERENCES = FOLDER / "scenes", FOLDER / "outside", FOLDER / "references"
#: hashes of scenes and references by file
MANIFEST = FOLDER / "manifest.json"


def names() -> list[str]:
    """Of the scenes that are whole in this folder, from the alphabet."""
    return sorted(path.stem for path in SCENES.glob("*.toml"))


def outside_names() -> list[str]:
    """Of those whose modes others publish."""
    return sorted(path.stem for path in OUTSIDE.glob("*.toml"))


def digest(path: Path) -> str:
    """SHA-256 of a file; of text, line ends are of no account."""
    data = path.read_bytes()
    return hashlib.sha256(data if path.suffix == ".npz" else data.replace(b"\r\n", b"\n")).hexdigest()


def fixed_files() -> list[Path]:
    """What a version of the benchmark is: scenes in both forms, references and how far they stand."""
    return sorted([*SCENES.iterdir(), *OUTSIDE.iterdir(), *REFERENCES.iterdir()])


def manifest() -> dict[str, Any]:
    """{"version": …, "files": {path in this folder: hash}} of what is here now."""
    files = {path.relative_to(FOLDER).as_posix(): digest(path) for path in fixed_files()}
    return {"version": VERSION, "files": files}


@cache
def _promised() -> dict[str, str]:
    return dict(json.loads(MANIFEST.read_text(encoding="utf-8"))["files"])


def check(path: Path) -> None:
    """Raises ContestError where a file is not that of this version."""
    name = path.relative_to(FOLDER).as_posix()
    if not path.is_file():
        raise ContestError(f"{path} does not exist; take the benchmark's folder whole")
    if _promised().get(name) != digest(path):
        raise ContestError(f"{path} is not that of version {VERSION} of the benchmark; scores by it would say nothing")


@dataclass(frozen=True)
class SceneFacts:
    """What a scorer needs of a scene. SI units."""

    name: str
    title: str
    rate_hz: float
    samples: int
    windows_s: tuple[float, ...]  # the last is the whole
    horizon_window_s: float
    contact_heights_m: tuple[float, ...]  # empty: a wall
    moves: bool

    @property
    def duration_s(self) -> float:
        return (self.samples - 1) / self.rate_hz

    @property
    def t(self) -> np.ndarray:
        """(samples,) instants of the reference [s]."""
        return np.arange(self.samples) / self.rate_hz

    def count(self, window_s: float) -> int:
        """Samples of a window from the start."""
        return min(self.samples, round(window_s * self.rate_hz) + 1)


def facts_of(numbers: dict[str, Any]) -> SceneFacts:
    """What a scorer needs of the numbers of a scene."""
    contacts = numbers.get("contacts") or {}
    return SceneFacts(
        numbers["name"],
        numbers["title"],
        float(numbers["rate_hz"]),
        int(numbers["samples"]),
        tuple(numbers["windows_s"]),
        float(numbers["horizon_window_s"]),
        tuple(contacts.get("heights_m", ())),
        bool(numbers.get("obstacle_ramps")),
    )


@cache
def numbers_of(name: str) -> dict[str, Any]:
    """NAME.json of a scene. Raises ContestError for a name that is none and for a file that was changed."""
    known = names()
    if name not in known:
        near = perhaps(name, known)
        raise ContestError(f"scene {name!r:.60}{near} is not one of {', '.join(known)}")
    path = SCENES / f"{name}.json"
    check(SCENES / f"{name}.toml")
    check(path)
    return dict(json.loads(path.read_text(encoding="utf-8")))


def scene(name: str) -> SceneFacts:
    """What a scorer needs of a scene; raises as `numbers_of`."""
    return facts_of(numbers_of(name))


@dataclass(frozen=True)
class Reference:
    """A converged displacement and how far it stands; e and dB by window, in the scene's order."""

    u: np.ndarray  # (samples,) [m]
    exact: bool
    uncertainty: tuple[float, ...]  # e of the worst check of itself
    confirmed: tuple[float, ...]  # e of the best independent method, NaN where none went so far
    lsd_db: float  # of the worst check of itself, over the whole
    horizon_s: float  # until when every check of itself stays with it
    floors: dict[float, tuple[float, ...]]  # rate over the scene's → e of the same motion sampled so and interpolated
    impulse_n_s: float | None  # of all contact forces over the whole


def reference_of(record: dict[str, Any], u: np.ndarray) -> Reference:
    """A reference of its record in references.json."""
    return Reference(
        np.asarray(u, dtype=np.float64),
        bool(record["exact"]),
        tuple(record["uncertainty"]),
        tuple(float("nan") if e is None else e for e in record["confirmed"]),
        float(record["lsd_db"]),
        float(record["horizon_s"]),
        {float(ratio): tuple(floor) for ratio, floor in record["floors"].items()},
        record.get("impulse_n_s"),
    )


@cache
def records() -> dict[str, dict[str, Any]]:
    """references.json: how every reference was made and how far it stands."""
    path = REFERENCES / "references.json"
    check(path)
    return dict(json.loads(path.read_text(encoding="utf-8")))


@cache
def reference(name: str) -> Reference:
    """The reference of a scene; raises ContestError where it was changed."""
    path = REFERENCES / f"{name}.npz"
    check(path)
    with np.load(path, allow_pickle=False) as data:
        return reference_of(records()[name], data["u"])
