"""Finished pieces of work, each a file named by what it depends on, so that a run that was stopped goes on."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from synth.files.targets import write_text, write_whole

REPOSITORY = Path(__file__).resolve().parents[2]
_SOURCES = (
    "solver/*.py", "physics/*.py", "research/*.py", "research/*/*.py", "dsp/measures.py", "dsp/decimator.py",
    "native/denormals.py",
)  # fmt: skip


def sources_hash() -> str:
    """Of every file that a run's numbers can depend on."""
    digest = hashlib.sha256()
    for pattern in _SOURCES:
        for path in sorted((REPOSITORY / "synth").glob(pattern)):
            digest.update(path.name.encode())
            digest.update(path.read_bytes())
    tools = [REPOSITORY / "tools" / name for name in ("promise/runs.py", "promise/scenes.py", "speed_error/kernels.py")]
    for path in [*sorted((REPOSITORY / "presets" / "cases").glob("*.toml")), *tools]:
        digest.update(path.read_bytes())
    return digest.hexdigest()


class Store:
    """`folder`/<key>.json, and .npz where a piece has arrays."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.sources = sources_hash()
        folder.mkdir(parents=True, exist_ok=True)

    def key(self, spec: dict[str, Any]) -> str:
        text = json.dumps(spec, sort_keys=True) + self.sources
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def load(self, spec: dict[str, Any]) -> tuple[dict[str, Any], dict[str, np.ndarray]] | None:
        """What was kept for `spec`, or None."""
        path = self.folder / f"{self.key(spec)}.json"
        if not path.exists():
            return None
        values = json.loads(path.read_text(encoding="utf-8"))["values"]
        arrays = path.with_suffix(".npz")
        if not arrays.exists():
            return values, {}
        with np.load(arrays) as data:
            return values, {name: data[name] for name in data.files}

    def save(self, spec: dict[str, Any], values: dict[str, Any], arrays: dict[str, np.ndarray] | None = None) -> None:
        """Arrays first: a piece whose .json is there is whole."""
        path = self.folder / f"{self.key(spec)}.json"
        if arrays:
            write_whole(path.with_suffix(".npz"), lambda file: np.savez(file, **arrays))
        write_text(path, json.dumps({"spec": spec, "values": values}, indent=1))
