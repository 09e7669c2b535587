"""Blind scenes: random strings over random points. The evaluator keeps the references and hands out scenes and hashes.

The manifest commits to the references before a run is seen: the scorer refuses a reference that was changed afterwards.
"""

from __future__ import annotations

import hashlib
import math
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from promise.scenes import KINDS
from promise.scenes import scene as random_tables

from benchmarks.collisions import ContestError, recipes, references
from synth.files.targets import write_text

WORDS = "Blind scene: a random string over random rigid points. Drawn, not chosen."
RATE_HZ, DURATION_S = 44100, 0.2
WINDOWS_S = [0.05, 0.1, DURATION_S]
#: modes listed in a scene's numbers, as in the scenes of the benchmark
MODES = 1001
#: a scene is kept where its reference stands to this over the shortest window, and another method says so
STANDS = 0.02
#: draws for each scene wanted, before the drawing is given up
_DRAWS = 5
_PERIODS_OF_HORIZON = 2.0


def drawn(seed: int, number: int) -> dict[str, Any]:
    """The tables of a scene's file: draw `number` of a seed."""
    rng = np.random.default_rng([seed, number])
    tables = random_tables(rng, str(rng.choice(KINDS)), DURATION_S)
    string = tables["string"]
    period_s = 2.0 * string["length_m"] * math.sqrt(string["linear_density_kg_m"] / string["tension_n"])
    points = len(tables["obstacle"]["positions_m"])
    mark = {
        "title": f"Blind: {points} point{'s' if points > 1 else ''}, {1.0 / period_s:.0f} Hz",
        "rate_hz": RATE_HZ,
        "windows_s": WINDOWS_S,
        "horizon_window_s": round(_PERIODS_OF_HORIZON * period_s, 4),
    }
    tables["run"]["modes"] = MODES
    return {"benchmark": mark, **tables}


def draw(folder: Path, seed: int, count: int, out: Path, say: Callable[[str], None]) -> None:
    """A new folder of `count` blind scenes with references and manifest. Raises ContestError, and then leaves no folder."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ContestError(f"{folder}: exists; name a new folder for the blind scenes")
    if not folder.absolute().parent.is_dir():
        raise ContestError(f"{folder}: its parent folder does not exist; make it first")
    tag = hashlib.sha256(str(seed).encode()).hexdigest()[:6]  # scenes of two drawings never share a name
    with tempfile.TemporaryDirectory(dir=folder.absolute().parent, prefix=".blind-") as made_in:
        made = Path(made_in) / "blind"
        (made / "scenes").mkdir(parents=True)
        kept = 0
        for number in range(_DRAWS * count):
            name = f"blind-{tag}-{kept + 1}"
            path = made / "scenes" / f"{name}.toml"
            write_text(path, f"# {WORDS}\n\n" + tomlkit.dumps(drawn(seed, number)))
            record, u = references.made(path, recipes.BLIND, out, say)
            fault = _fault(record)
            if fault:
                say(f"draw {number + 1} is left out: {fault}")
                path.unlink()
                continue
            references.write(name, record, u, made)
            kept += 1
            say(f"{name}: uncertainty {record['uncertainty']}, confirmed to {record['confirmed']}")
            if kept == count:
                break
        if kept < count:
            raise ContestError(
                f"{folder}: only {kept} of {_DRAWS * count} draws have a reliable reference; try another --seed"
            )
        references.seal(made)
        if folder.is_dir():
            folder.rmdir()
        os.replace(made, folder)


def _fault(record: dict[str, Any]) -> str:
    """Why a scene cannot be judged by its reference; empty where it can."""
    own, other = record["uncertainty"][0], record["confirmed"][0]
    if own > STANDS:
        return f"the uncertainty of its reference is {own:.2g}"
    if other is None or other > STANDS:
        return f"another method differs from its reference by {'NaN' if other is None else format(other, '.2g')}"
    return "" if record["impulse_n_s"] else "the string touches nothing"
