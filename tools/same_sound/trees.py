"""The two packages that are compared: BASE as it was at a commit, and the working tree; and what is kept of BASE.

BASE's files lie in the user's cache, by their content (commits that differ elsewhere share them), and stay as they are, for
kernels are kept by place and time of their sources; beside them its kernels, and its answers by scene and by all that they
depend on. The working tree uses the ordinary kernels.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import platform
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

TOOLS = Path(__file__).resolve().parents[1]
ROOT = TOOLS.parent
#: what of a commit is needed to sound
NEEDED = ("synth", "presets")
#: bases that are kept
KEEP = 4
#: what answers are made with, besides the package
MADE_WITH = ("numba", "llvmlite", "numpy", "scipy", "soundfile", "mido")


class WrongUse(Exception):
    """What the user has to put right."""


@dataclass(frozen=True)
class Side:
    """A package that sounds. `tree`: where it lies; `cache`: its XDG_CACHE_HOME, None for the user's own."""

    name: str
    tree: Path
    cache: Path | None = None


@dataclass(frozen=True)
class Base:
    """BASE: its commit, its package, and the folder in which its answers are kept."""

    commit: str
    side: Side
    answers: Path

    def kept(self, scene: dict[str, Any]) -> Path:
        """Where the answer to a scene is kept, or will be."""
        return self.answers / f"{scene['name']}-{digest_of(scene)}.npz"


def digest_of(scene: Any) -> str:
    """Of the scene's data."""
    return hashlib.blake2b(json.dumps(scene, sort_keys=True).encode(), digest_size=6).hexdigest()


def git(*words: str) -> bytes:
    """What git says. Raises WrongUse with its complaint."""
    done = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True)
    if done.returncode:
        raise WrongUse(" ".join(done.stderr.decode(errors="replace").split()) or f"git {words[0]} failed")
    return done.stdout


def commit_of(name: str) -> str:
    """The whole name of a commit. Raises WrongUse."""
    try:
        return git("rev-parse", "--verify", "--quiet", "--end-of-options", f"{name}^{{commit}}").decode().strip()
    except WrongUse:
        raise WrongUse(f"BASE must be a commit of {ROOT}, got {name!r}; see git log") from None


def changes() -> int:
    """Files of the working tree that differ from HEAD."""
    return len(git("status", "--porcelain", "--", *NEEDED).splitlines())


def base_at(name: str, cache: Path) -> Base:
    """BASE, its files laid out. Raises WrongUse."""
    commit = commit_of(name)
    try:
        content = git("rev-parse", *(f"{commit}:{part}" for part in NEEDED))
    except WrongUse:
        raise WrongUse(f"{name} ({commit[:7]}) has no package to compare with: no {' or '.join(NEEDED)}") from None
    folder = cache / hashlib.blake2b(content, digest_size=8).hexdigest()
    tree = folder / "tree"
    if not tree.is_dir():
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder) as made:
            packed = git("archive", commit, "--", *NEEDED)
            with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
                archive.extractall(made, filter="data")
            try:
                os.rename(made, tree)
                os.mkdir(made)  # for the context to take away
            except OSError:
                if not tree.is_dir():  # else another run was faster
                    raise
    os.utime(folder)
    kept = sorted((path for path in cache.iterdir() if path.is_dir()), key=lambda path: path.stat().st_mtime)
    for old in kept[:-KEEP]:
        shutil.rmtree(old, ignore_errors=True)
    answers = folder / f"answers-{_surroundings()}"
    for stale in set(folder.glob("answers-*")) - {answers}:
        shutil.rmtree(stale, ignore_errors=True)
    answers.mkdir(exist_ok=True)
    return Base(commit, Side("BASE", tree, folder / "cache"), answers)


def other_dependencies(base: Base) -> list[str]:
    """Dependencies of BASE that the working tree states otherwise or not at all."""
    try:
        then = tomllib.loads(git("show", f"{base.commit}:pyproject.toml").decode())
        now = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    except (WrongUse, OSError, tomllib.TOMLDecodeError):
        return []
    stated = [project.get("project", {}).get("dependencies", []) for project in (then, now)]
    return sorted(set(stated[0]) - set(stated[1]))


def _surroundings() -> str:
    """A digest of what an answer depends on besides package and scene: what renders it, libraries, processor."""
    digest = hashlib.blake2b(digest_size=6)
    for module in ("render.py", "worker.py"):
        digest.update((Path(__file__).parent / module).read_bytes())
    from llvmlite import binding

    processor = binding.get_host_cpu_name(), binding.get_host_cpu_features().flatten()
    libraries = [(name, version(name)) for name in MADE_WITH]
    switches = sorted(pair for pair in os.environ.items() if pair[0].startswith(("NUMBA_", "JAWARI_LANES")))
    digest.update(repr((libraries, sys.version, platform.platform(), processor, switches)).encode())
    return digest.hexdigest()
