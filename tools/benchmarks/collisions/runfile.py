"""Runs that others hand in: a plain .npz, read, judged, and brought to the instants of its scene's reference."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.collisions import ContestError
from benchmarks.collisions.resample import interpolated
from benchmarks.collisions.scene import Reference, SceneFacts
from synth.files.npz import read_npz

#: instants that are so near to the reference's are the same [s]
SAME_S = 1e-9
#: words that a run may carry, and numbers
WORDS = ("solver", "scheme", "parameters", "machine")
NUMBERS = ("cost_s", "internal_rate_hz", "modes")
_LONGEST_WORD = 500


@dataclass(frozen=True)
class Run:
    """A run at its reference's instants, the first `u.size` of them; how it came to be there; what else it holds."""

    path: Path
    scene: str
    u: np.ndarray  # [m]
    rate_hz: float
    picked: bool  # else interpolated
    floor: tuple[float, ...]  # e by window that the interpolation alone may make
    words: dict[str, str] = field(default_factory=dict)
    numbers: dict[str, float] = field(default_factory=dict)
    contacts: dict[str, np.ndarray] = field(
        default_factory=dict
    )  # u_contact, contact_force (rows, C), energy (rows,), as they came


def scene_of(path: Path, data: dict[str, np.ndarray], given: str | None) -> str:
    """The name of the scene that a run says it is of, or the one given."""
    if "scene" not in data:
        if given is None:
            raise ContestError(f"{path}: has no 'scene', the name of one; write it, or give --scene NAME")
        return given
    name = _word(path, "scene", data["scene"])
    if given not in (None, name):
        raise ContestError(f"{path}: is a run of scene {name!r}, got --scene {given}; leave one of them out")
    return name


def read(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a run. Raises ContestError that names the file."""
    try:
        return read_npz(path)
    except OSError as error:
        raise ContestError(f"{path}: {error.strerror}; name the .npz of a run") from None
    except ValueError as error:
        raise ContestError(str(error)) from None


def brought(path: Path, data: dict[str, np.ndarray], scene: SceneFacts, reference: Reference) -> Run:
    """A run at the instants of its reference. Raises ContestError in one line for what cannot be scored."""
    u = _row(path, "u", data)
    rate = _rate(path, data, u.size)
    if u.size < 2:
        raise ContestError(f"{path}: u has {u.size} samples; give the whole run from t = 0")
    covered = (u.size - 1) / rate
    count = min(scene.samples, int(np.floor(covered * scene.rate_hz + scene.rate_hz * SAME_S)) + 1)
    if count < scene.count(scene.windows_s[0]) - 1:
        raise ContestError(
            f"{path}: lasts {covered:.4g} s, but the shortest window of scene {scene.name!r} is {scene.windows_s[0]:g} s "
            f"of {scene.duration_s:g} s; give the whole run"
        )
    t = scene.t[:count]
    index = np.rint(t * rate).astype(np.int64)
    index = np.minimum(index, u.size - 1)
    picked = bool(np.abs(index / rate - t).max() <= SAME_S)
    floor = (0.0,) * len(scene.windows_s)
    if picked:
        values = u[index]
    else:
        floor = _floor(path, rate, scene, reference)
        values = interpolated(u, rate, t)
    words = {name: _word(path, name, data[name]) for name in WORDS if name in data}
    numbers = {name: _number(path, name, data[name]) for name in NUMBERS if name in data}
    contacts: dict[str, np.ndarray] = {}
    for name in ("u_contact", "contact_force", "energy"):
        if name in data:
            contacts[name] = _rows(
                path, name, data[name], u.size, None if name == "energy" else len(scene.contact_heights_m)
            )
    return Run(path, scene.name, values, rate, picked, floor, words, numbers, contacts)


def _floor(path: Path, rate: float, scene: SceneFacts, reference: Reference) -> tuple[float, ...]:
    ratio = rate / scene.rate_hz
    measured = [known for known in sorted(reference.floors) if known <= ratio * (1 + 1e-9)]
    if not measured:
        least = min(reference.floors) * scene.rate_hz
        raise ContestError(
            f"{path}: {rate:g} Hz does not have the instants of the reference, {scene.rate_hz:g} Hz, and is too low to "
            f"interpolate; sample at a multiple of {scene.rate_hz:g} Hz, or at {least:.0f} Hz at least"
        )
    return reference.floors[measured[-1]]


def _real(path: Path, name: str, value: np.ndarray) -> np.ndarray:
    if value.dtype.kind not in "iuf":
        raise ContestError(f"{path}: {name!r} must hold real numbers, got {value.dtype}; write float64")
    return value.astype(np.float64)


def _row(path: Path, name: str, data: dict[str, np.ndarray]) -> np.ndarray:
    if name not in data:
        raise ContestError(f"{path}: has no array {name!r}; it has {', '.join(data) or 'nothing'}")
    value = _real(path, name, data[name])
    if value.ndim == 2 and value.shape[1] == 1:
        value = value[:, 0]
    if value.ndim != 1 or value.size == 0:
        raise ContestError(
            f"{path}: {name!r} must be one row of samples (n,), got shape {value.shape}; choose the output point"
        )
    wrong = np.flatnonzero(~np.isfinite(value))
    if wrong.size:
        raise ContestError(
            f"{path}: {name!r} must be finite, got {wrong.size} NaN or infinite of {value.size}, the first at {wrong[0]}; "
            "a run that blew up has no score"
        )
    return value


def _rate(path: Path, data: dict[str, np.ndarray], count: int) -> float:
    given = _number(path, "rate_hz", data["rate_hz"]) if "rate_hz" in data else None
    if given is not None and not 1.0 <= given <= 1e12:
        raise ContestError(f"{path}: 'rate_hz' must be the rate of u in Hz, got {given:g}; it counts samples in a second")
    if "t" not in data:
        if given is None:
            raise ContestError(f"{path}: has neither 't' nor 'rate_hz'; say when the samples of u are")
        return given
    t = _row(path, "t", data)
    if t.size != count:
        raise ContestError(f"{path}: 't' must have the {count} samples of u, got {t.size}")
    if count < 2:
        return given or 1.0
    if abs(t[0]) > SAME_S:
        raise ContestError(
            f"{path}: 't' must begin at 0 s, where the string is let go, got {t[0]:g} s; keep the first samples"
        )
    rate = (count - 1) / t[-1] if t[-1] > 0.0 else 0.0
    if not 1.0 <= rate <= 1e12:
        raise ContestError(f"{path}: 't' must rise from 0 in seconds, got {t[-1]:g} s at its end")
    nearest = round(rate)
    rate = float(nearest) if abs(t[-1] - (count - 1) / nearest) <= SAME_S else rate
    off = float(np.abs(t - np.arange(count) / rate).max())
    if off > SAME_S:
        raise ContestError(f"{path}: 't' must be evenly spaced within {SAME_S:g} s, got {off:.2g} s; write even samples")
    if given is not None and abs(given - rate) > 1e-6 * rate:
        raise ContestError(f"{path}: 'rate_hz' is {given:g} Hz, but 't' has {rate:g} Hz; leave one of them out")
    return rate


def _rows(path: Path, name: str, value: np.ndarray, rows: int, columns: int | None) -> np.ndarray:
    value = _real(path, name, value)
    if columns and value.ndim == 1 and columns == 1:
        value = value[:, None]
    wanted = f"({rows},)" if columns is None else f"({rows}, {columns or 'nodes'})"
    fits = value.ndim == (1 if columns is None else 2) and value.shape[0] == rows
    if not fits or (columns and value.shape[1] != columns):
        raise ContestError(f"{path}: {name!r} must have the shape {wanted}, a row for each sample of u, got {value.shape}")
    if not np.all(np.isfinite(value)):
        raise ContestError(f"{path}: {name!r} must be finite; leave it out where it is not known")
    return value


def _word(path: Path, name: str, value: Any) -> str:
    value = np.asarray(value)
    if value.dtype.kind not in "US" or value.size != 1:
        raise ContestError(f"{path}: {name!r} must be one text, got {value.dtype} of shape {value.shape}")
    text = value.reshape(-1)[0]
    text = text.decode("utf-8", "replace") if isinstance(text, bytes) else str(text)
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:_LONGEST_WORD]


def _number(path: Path, name: str, value: Any) -> float:
    value = np.asarray(value)
    if value.dtype.kind not in "iuf" or value.size != 1 or not np.all(np.isfinite(value)) or not value.reshape(-1)[0] >= 0:
        raise ContestError(f"{path}: {name!r} must be one number of at least 0, got {np.array2string(value, threshold=4)}")
    return float(value.reshape(-1)[0])
