"""A row's address: SHA-256 of all that its numbers depend on, so that none is computed twice.

In it: the content of the base (tables and arrays of a case, text and measured plan of a preset, the function's name), every
setting, the measures with their options, the arrays asked for, the reference's settings and check, the sources of the
program (`code_version` of `work.running.ROOMS`, or of the rooms that the study names for its function), Python's version
(3.x), those of NumPy, Numba, llvmlite and SciPy, and the text of the files that the study names as its sources. Not in it:
names of files and folders, the processor (whose vectors change last bits; the table of times names the machine of every
row), order, plots, how many workers there were.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from synth.study.design import Design
from synth.study.studyfile import Study, StudyError, canonical
from synth.study.work import bases, modules
from synth.study.work.measuring import MEASURES
from synth.study.work.running import versions


def plain_json(value: Any) -> str:
    """One text for what is the same: sorted keys, whole numbers without a point."""
    return json.dumps(_whole(value), sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def _whole(value: Any) -> Any:
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    if isinstance(value, Mapping):
        return {str(key): _whole(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_whole(each) for each in value]
    return value


class Addresses:
    """Addresses of a study's rows and references, and the head that workers need."""

    def __init__(self, study: Study, folder: Path) -> None:
        self.study, self._folder = study, folder
        self._contents: dict[str, str] = {}
        path = [str((folder / each).resolve()) for each in study.base.path]
        if study.base.call is not None or any(":" in each["name"] for each in study.measured()):
            path.append(str(folder.resolve()))
        rooms = ((*study.base.rooms, "study/work"),) if study.base.rooms else ()
        try:
            found = versions(*rooms)
        except ValueError as error:
            raise StudyError(f"base.rooms: {error}") from None
        timed = {each["as"] for each in study.measured() if each["name"] in MEASURES and MEASURES[each["name"]].timed}
        self.times = [*study.times, *sorted(timed - set(study.times))]
        self.head: dict[str, Any] = {
            "measures": study.measured(), "arrays": list(study.arrays), "path": path, "versions": found, "rooms": rooms,
            "check": dict(study.reference.check) if study.reference else {}, "times": self.times,
        }  # fmt: skip
        modules.put_first(path)
        self.code = hashlib.sha256(plain_json([found, self._sources()]).encode()).hexdigest()
        said = [self.code, self.head["measures"], self.head["arrays"], study.times]
        self._prefix = hashlib.sha256(plain_json(said).encode())
        said = [self.code, self.head["check"], "reference"]
        self._reference_prefix = hashlib.sha256(plain_json(said).encode())

    def _sources(self) -> list[str]:
        """Of the study's own modules and of what it names beside, as this process has loaded them."""
        files: set[Path] = set()
        for pattern in self.study.base.sources:
            found = sorted(self._folder.glob(pattern)) if not Path(pattern).is_absolute() else [Path(pattern)]
            files |= {each.resolve() for each in found if each.is_file()}
            if not found:
                raise StudyError(f"base.sources: {pattern!r} matches no file below {self._folder.resolve()}")
        names = [each["name"] for each in self.study.measured() if ":" in each["name"]]
        names += [self.study.base.call] if self.study.base.call else []
        named = modules.module_names(self.head["path"], files)
        others = [named.get(each, str(each)) for each in sorted(files)]
        needed = list(dict.fromkeys(name.partition(":")[0] for name in names))
        for name in names:
            try:
                modules.loaded(needed, others)
                origin = bases.function_of(name).__module__  # perhaps not where it was named
            except (ValueError, ImportError) as error:
                told = error if isinstance(error, ValueError) else f"{name}: {error}; is its folder in the study's path?"
                raise StudyError(f"{'base.call' if name == self.study.base.call else 'measures'}: {told}") from None
            if origin not in needed and getattr(sys.modules.get(origin), "__file__", None):
                needed.append(origin)
        self.head["modules"] = needed
        self.head["own"] = own = modules.loaded(needed, [each for each in others if each not in needed])
        missing = [modules.text_hash(path) for path in files if named.get(path, str(path)) not in own]
        return sorted([*set(own.values()), *missing])

    def source(self, settings: Mapping[str, Any]) -> dict[str, Any]:
        """What a row is run from. Raises ValueError or OSError."""
        return bases.source_of(self.study.base.model_dump(exclude_none=True), settings, self._folder)

    def row(self, settings: Mapping[str, Any], source: Mapping[str, Any], reference: str | None) -> str:
        """64 hexadecimal digits."""
        return self._of(self._prefix, settings, source, reference)

    def reference(self, settings: Mapping[str, Any], source: Mapping[str, Any]) -> str:
        """64 hexadecimal digits."""
        return self._of(self._reference_prefix, settings, source, None)

    def _of(self, prefix: Any, settings: Mapping[str, Any], source: Mapping[str, Any], reference: str | None) -> str:
        digest = prefix.copy()
        named = {canonical(key): value for key, value in settings.items() if key != source["kind"]}  # whose content counts
        digest.update(plain_json([self._content(source), named, reference]).encode())
        return digest.hexdigest()

    def _content(self, source: Mapping[str, Any]) -> str:
        key = source.get("name") or source["call"]
        if key not in self._contents:
            self._contents[key] = hashlib.sha256(plain_json(bases.content_of(source)).encode()).hexdigest()
        return self._contents[key]


def check_rows(addresses: Addresses, design: Design, origin: str, numbers: list[int]) -> None:
    """StudyError where some of these rows describe no run: one line for each fault."""
    faults: dict[str, None] = {}
    for number in numbers:
        settings = design.row(number)
        for what, each in (("row", settings), ("reference of row", design.reference(settings))):
            if each is None:
                continue
            try:
                bases.check_settings(addresses.source(each), each)
            except (ValueError, OSError) as error:
                for line in str(error).splitlines():
                    faults.setdefault(f"{origin}: {line}" if len(faults) else f"{origin}: {what} {number}: {line}")
        if len(faults) > 20:
            break
    if faults:
        raise StudyError("\n".join(faults))
