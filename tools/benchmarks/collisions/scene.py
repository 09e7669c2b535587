"""Scenes as others read them: the numbers of NAME.json, and whether they are still those of the benchmark's version."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.collisions import FOLDER, VERSION, ContestError
from synth.spelling import perhaps

SCENES, OUTSIDE, REFERENCES = FOLDER / "scenes", FOLDER / "outside", FOLDER / "references"
#: hashes of scenes and references by file
MANIFEST = FOLDER / "manifest.json"


def names(folder: Path = FOLDER) -> list[str]:
    """Of the scenes that are whole in the folder, from the alphabet."""
    return sorted(path.stem for path in (folder / SCENES.name).glob("*.toml"))


def outside_names() -> list[str]:
    """Of those whose modes others publish."""
    return sorted(path.stem for path in OUTSIDE.glob("*.toml"))


def path_of(named: str | Path) -> Path:
    """The .toml of a scene of this folder, or of one outside, by its name; of a scene elsewhere its path is the name."""
    if isinstance(named, Path):
        return named
    path = SCENES / f"{named}.toml"
    return path if path.exists() else OUTSIDE / path.name


def digest(path: Path) -> str:
    """SHA-256 of a file; of text, line ends are of no account."""
    data = path.read_bytes()
    return hashlib.sha256(data if path.suffix == ".npz" else data.replace(b"\r\n", b"\n")).hexdigest()


def fixed_files(folder: Path = FOLDER) -> list[Path]:
    """What a version of the benchmark is: scenes in both forms, references and how far they stand."""
    parts = [folder / part.name for part in (SCENES, OUTSIDE, REFERENCES)]
    return sorted(path for part in parts if part.is_dir() for path in part.iterdir())


def manifest(folder: Path = FOLDER) -> dict[str, Any]:
    """{"version": …, "files": {path in the folder: hash}} of what is there now."""
    files = {path.relative_to(folder).as_posix(): digest(path) for path in fixed_files(folder)}
    return {"version": VERSION, "files": files}


@cache
def _promised(folder: Path) -> dict[str, str]:
    path = folder / MANIFEST.name
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        version, files = found["version"], dict(found["files"])
    except OSError as error:
        raise ContestError(f"{path}: {error.strerror}; name the whole folder of the scenes") from None
    except (ValueError, KeyError, TypeError):
        raise ContestError(f"{path}: is not a list of a benchmark's files; use the one that came with the scenes") from None
    if version != VERSION:
        raise ContestError(f"{path}: is of version {version!r:.20} of the benchmark, this is {VERSION}; use that one")
    return files


def check(path: Path, folder: Path = FOLDER) -> None:
    """Raises ContestError where a file is not the one that the folder's manifest names."""
    name = path.relative_to(folder).as_posix()
    if not path.is_file():
        raise ContestError(f"{path} does not exist; take the folder whole")
    if _promised(folder).get(name) != digest(path):
        of = f"that of version {VERSION} of the benchmark" if folder == FOLDER else f"the one that {MANIFEST.name} names"
        raise ContestError(f"{path} is not {of}; scores by it would say nothing")


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
def numbers_of(name: str, folder: Path = FOLDER) -> dict[str, Any]:
    """NAME.json of a scene. Raises ContestError for a name that is none and for a file that was changed."""
    known = names(folder)
    if name not in known:
        near = perhaps(name, known)
        raise ContestError(f"scene {name!r:.60}{near} is not one of {', '.join(known) or f'those in {folder}: it has none'}")
    path = folder / SCENES.name / f"{name}.json"
    check(path.with_suffix(".toml"), folder)
    check(path, folder)
    return dict(json.loads(path.read_text(encoding="utf-8")))


def scene(name: str, folder: Path = FOLDER) -> SceneFacts:
    """What a scorer needs of a scene; raises as `numbers_of`."""
    return facts_of(numbers_of(name, folder))


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
def records(folder: Path = FOLDER) -> dict[str, dict[str, Any]]:
    """references.json: how every reference was made and how far it stands."""
    path = folder / REFERENCES.name / "references.json"
    check(path, folder)
    return dict(json.loads(path.read_text(encoding="utf-8")))


@cache
def reference(name: str, folder: Path = FOLDER) -> Reference:
    """The reference of a scene; raises ContestError where it was changed."""
    path = folder / REFERENCES.name / f"{name}.npz"
    check(path, folder)
    with np.load(path, allow_pickle=False) as data:
        return reference_of(records(folder)[name], data["u"])
