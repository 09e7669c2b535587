"""A study's own modules and files: what a process has loaded is what the addresses of rows were made from.

A process may outlive an edit: a worker of a cluster, a session in which the same study runs again. So it remembers the
hash of each text that it loaded; where the text is another now, it forgets the study's modules and imports them anew.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.machinery
import importlib.util
import os
import sys
import sysconfig
import threading
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

#: (file, hash) of what was loaded, by a module's name or a file's full path
_LOADED: dict[str, tuple[str, str]] = {}
_LOCK = threading.RLock()
#: nobody edits these while a process runs
_SETTLED = tuple(
    os.path.join(os.path.realpath(each), "")
    for each in (*(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")), str(Path(__file__).parents[2]))
)


def text_hash(path: Path) -> str:
    """SHA-256 of a file's text, whatever its ends of lines. Raises OSError."""
    return hashlib.sha256(path.read_bytes().replace(b"\r\n", b"\n")).hexdigest()


def put_first(folders: Sequence[str]) -> None:
    """Folders to the front of Python's path, the first of them first."""
    there = [each for each in folders if Path(each).is_dir()]
    if sys.path[: len(there)] != there:
        sys.path[:] = [*there, *(each for each in sys.path if each not in there)]


def module_names(folders: Sequence[str], files: Iterable[Path]) -> dict[Path, str]:
    """What modules some files are: their places in the first of these folders that has them."""
    found: dict[Path, str] = {}
    for path in files:
        for folder in folders:
            if path.suffix == ".py" and path.is_relative_to(folder):
                parts = list(path.relative_to(folder).with_suffix("").parts)
                name = ".".join(parts[:-1] if len(parts) > 1 and parts[-1] == "__init__" else parts)
                if all(part.isidentifier() for part in name.split(".")):
                    found.setdefault(path, name)
    return found


def loaded(needed: Sequence[str], others: Sequence[str] = ()) -> dict[str, str]:
    """Imports modules as their files are now, and hashes these: by name.

    needed  modules that are imported
    others  modules that these may import, and full paths of files that they may read
    What is not read from a file, or is not there, has no hash. Raises ImportError and what a module raises.
    """
    with _LOCK:
        for _ in range(5):
            now = {name: _now(name) for name in (*needed, *others)}
            _forget_stale(now)
            _import(needed, now)
            if now == {name: _now(name) for name in now}:  # nobody edited them meanwhile
                break
        return {name: found[1] for name, found in now.items() if found is not None}


def unlike(wanted: Mapping[str, str], needed: Sequence[str]) -> str | None:
    """Sees to it that this process has loaded the texts of these hashes; None, or what stands in the way."""
    with _LOCK:
        if all(_fits(name, each) for name, each in wanted.items()):
            return None
        for name, each in wanted.items():
            found = _now(name)
            if found is None and not os.path.isabs(name):
                return f"has no module {name}; put it where workers find it, or its folder into base.path"
            if found is not None and found[1] != each:
                return f"has another {found[0]} than the study was started with; put the same there"
        try:
            found_now = loaded(needed, [name for name in wanted if name not in needed])
        except Exception as error:  # whatever a module does
            return f"cannot import {', '.join(needed)} ({type(error).__name__}: {error}); fix it there"
        changed = [name for name, each in wanted.items() if found_now.get(name, each) != each]
        return f"has another {changed[0]} than the study was started with; put the same there" if changed else None


def _fits(name: str, wanted: str) -> bool:
    if os.path.isabs(name):
        return _LOADED[name][1] == wanted if name in _LOADED else not os.path.exists(name)
    return name in sys.modules and name in _LOADED and _LOADED[name][1] == wanted


def _now(name: str) -> tuple[str, str] | None:
    """(file, hash) of what an import would read now, or of a file; None where there is no such."""
    file = name if os.path.isabs(name) else _file_of(name)
    try:
        return None if file is None else (file, text_hash(Path(file)))
    except OSError:
        return None


def _file_of(name: str) -> str | None:
    importlib.invalidate_caches()
    path, spec = None, None
    parts = name.split(".")
    for depth in range(1, len(parts) + 1):
        spec = importlib.machinery.PathFinder.find_spec(".".join(parts[:depth]), path)
        if spec is None:
            break
        path = list(spec.submodule_search_locations or ())
    if spec is None:  # finders of other kinds
        try:
            spec = importlib.util.find_spec(name)
        except (ImportError, ValueError):
            return None
    return spec.origin if spec is not None and spec.has_location else None


def _forget_stale(now: Mapping[str, tuple[str, str] | None]) -> None:
    """Where one of them is not what was loaded, none of them counts as loaded."""
    stale = False
    for name, found in now.items():
        if found is None or _LOADED.get(name) == found:
            continue
        settled = os.path.realpath(found[0]).startswith(_SETTLED)
        stale = stale or (not settled and (name in sys.modules or os.path.isabs(name)))
    if not stale:
        return
    used = []
    for name, found in now.items():
        if name not in sys.modules or found is None or os.path.realpath(found[0]).startswith(_SETTLED):
            continue
        # bytecode counts as that of a text of the same length and second
        Path(importlib.util.cache_from_source(found[0])).unlink(missing_ok=True)
        del sys.modules[name]
        used.append(name)
    for name in used:
        importlib.import_module(name)


def _import(needed: Sequence[str], now: Mapping[str, tuple[str, str] | None]) -> None:
    for name in needed:
        importlib.import_module(name)
    for name, found in now.items():
        if found is not None and (name in sys.modules or os.path.isabs(name)):
            _LOADED[name] = found
