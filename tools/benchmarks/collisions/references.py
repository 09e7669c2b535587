"""References made again, by their recipes; what is finished stays in out/collisions and is not made twice."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import REPOSITORY
from benchmarks.collisions import FOLDER, recipes, scene, ways
from benchmarks.collisions.examples import kicks
from benchmarks.collisions.neutral import numbers, text_of
from benchmarks.collisions.resample import interpolated
from benchmarks.collisions.score import ROUNDING_DB, errors, horizon
from synth.dsp.measures import log_spectral_distance
from synth.files.code_version import RESEARCH, code_version
from synth.files.npz import read_npz
from synth.files.targets import write_text, write_whole

OUT = REPOSITORY / "out" / "collisions"
#: the reference itself is kept at so many times the scene's rate, to say what interpolation may make
_KEPT = 16
#: sampling rates over the scene's at which that is measured: 48, 96, 192, 384 kHz over 44.1 kHz and between
_RATIOS = (48 / 44.1, 1.5, 96 / 44.1, 192 / 44.1, 384 / 44.1)


def _computed(
    named: str | Path, chosen: ways.Way | recipes.Kicks, keep: int, out: Path, say: Callable[[str], None]
) -> dict[str, Any]:
    """{"u": (n,), "impulse": …} of a scene in a way; from `out` where it has been made by the same sources."""
    path = scene.path_of(named)
    name = path.stem
    spec = {
        "scene": scene.digest(path),
        "way": type(chosen).__name__,
        **(chosen._asdict() if isinstance(chosen, tuple) else asdict(chosen)),
    }
    solver = scene.digest(Path(kicks.__file__)) if isinstance(chosen, recipes.Kicks) else code_version(RESEARCH)
    spec |= {"keep": keep, "code": solver}
    key = hashlib.sha256(json.dumps(spec, sort_keys=True).encode()).hexdigest()[:24]
    file = out / "runs" / f"{name}-{key}.npz"
    if file.is_file():
        try:
            return read_npz(file)
        except ValueError:
            file.unlink()  # half a file of a machine that stopped
    if isinstance(chosen, recipes.Kicks):
        say(f"{name}: examples/kicks.py, {chosen.factor} steps a sample, {chosen.modes} modes")
        found: dict[str, Any] = {"u": kicks.solve(numbers(named), chosen.factor, chosen.modes)[0]}
    else:
        say(f"{name}: {chosen.label}, {chosen.factor} steps a sample, {chosen.modes} modes")
        result = ways.run(named, chosen, keep)
        found = {"u": result.u[:, 0]}
        if chosen.scheme != "wall":  # whose rows of forces would be the same run once more
            found["impulse"] = np.array(result.contact_force[1:].sum() * (result.t[1] - result.t[0]))
    if not np.all(np.isfinite(found["u"])):
        raise ValueError(f"{name}: {chosen} blew up")
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, lambda handle: np.savez(handle, **found))
    return found


def _compared(u: np.ndarray, ref: np.ndarray, facts: scene.SceneFacts) -> dict[str, Any]:
    whole = u.size >= facts.samples
    lsd = log_spectral_distance(u, ref, facts.rate_hz) if whole else None
    return {
        "e": errors(u, ref, facts),
        "lsd_db": lsd,
        "horizon_s": horizon(u, ref[: u.size], facts.rate_hz, facts.horizon_window_s),
    }


def made(
    named: str | Path, recipe: recipes.Recipe, out: Path, say: Callable[[str], None]
) -> tuple[dict[str, Any], np.ndarray]:
    """(record, u (samples,) float32) of the reference of a scene (`path_of`)."""
    facts = scene.facts_of(numbers(named))
    rate = facts.rate_hz
    found = _computed(named, recipe.reference, _KEPT, out, say)
    fine = found["u"]
    exact = fine[::_KEPT]
    u = exact.astype(np.float32)

    def all_of(which: dict[str, Any]) -> list[dict[str, Any]]:
        rows = []
        for words, chosen in which.items():
            compared = _compared(_computed(named, chosen, 1, out, say)["u"], exact, facts)
            rows.append({"what": words, "internal_rate_hz": rate * chosen.factor, "modes": chosen.modes, **compared})
        return rows

    checks, independent = all_of(recipe.checks), all_of(recipe.independent)
    windows = range(len(facts.windows_s))
    floors = {}
    for ratio in _RATIOS:
        t = np.arange(int((fine.size - 1) / _KEPT * ratio) + 1) / (rate * ratio)
        back = interpolated(interpolated(fine, rate * _KEPT, t), rate * ratio, facts.t)
        floors[f"{ratio:.6f}"] = errors(back, exact, facts)
    best = [min((row["e"][k] for row in independent if row["e"][k] is not None), default=None) for k in windows]
    record = {
        "scheme": recipe.reference.label,
        "internal_rate_hz": rate * recipe.reference.factor,
        "modes": recipe.reference.modes,
        "exact": recipe.exact,
        "uncertainty": [max((row["e"][k] for row in checks), default=0.0) for k in windows],
        "confirmed": best,
        "lsd_db": max((row["lsd_db"] for row in checks), default=ROUNDING_DB),
        "horizon_s": min((row["horizon_s"] for row in checks), default=facts.duration_s),
        "impulse_n_s": float(found["impulse"]) if "impulse" in found else None,
        "checks": checks,
        "independent": independent,
        "floors": floors,
    }
    return record, u


def write(name: str, record: dict[str, Any], u: np.ndarray, folder: Path) -> None:
    """A scene as numbers and its reference, written into the folder; the files of all other scenes stay as they are."""
    write_text(folder / "scenes" / f"{name}.json", text_of(numbers(folder / "scenes" / f"{name}.toml")))
    path = folder / "references" / "references.json"
    path.parent.mkdir(exist_ok=True)
    records = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    records[name] = record
    write_whole(path.with_name(f"{name}.npz"), lambda file: np.savez_compressed(file, u=u))
    known = [each for each in recipes.RECIPES if each in records]
    ordered = {each: records[each] for each in [*known, *(records.keys() - recipes.RECIPES.keys())]}
    write_text(path, json.dumps(ordered, indent=1, ensure_ascii=False) + "\n")


def seal(folder: Path) -> None:
    """The manifest of a folder of scenes and references, of its files as they are now."""
    write_text(folder / scene.MANIFEST.name, json.dumps(scene.manifest(folder), indent=1) + "\n")


def make(names: list[str], out: Path, say: Callable[[str], None], folder: Path = FOLDER) -> None:
    """The scenes of these names as numbers, their references, and the manifest, written into the folder."""
    for name in names:
        record, u = made(folder / "scenes" / f"{name}.toml", recipes.RECIPES[name], out, say)
        say(f"{name}: uncertainty {record['uncertainty']}, confirmed to {record['confirmed']}")
        write(name, record, u, folder)
    seal(folder)


def outside(name: str, out: Path, say: Callable[[str], None]) -> tuple[scene.SceneFacts, scene.Reference, dict[str, Any]]:
    """A scene on others' modes, its reference made here and its record; ContestError without their files."""
    record, u = made(name, recipes.OUTSIDE_RECIPES[name], out, say)
    return scene.facts_of(numbers(name)), scene.reference_of(record, u), record
