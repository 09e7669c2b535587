"""Files of scores, entries/NAME.json: read, judged, merged and written."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from benchmarks.collisions import FOLDER, VERSION, ContestError
from benchmarks.collisions.scene import names, outside_names
from synth.files.targets import write_text

ENTRIES = FOLDER / "entries"
#: of a file of scores
_HEAD = {"benchmark": int, "name": str, "made_by": str, "source": str, "machine": str, "scores": list}
#: where scores come from, said once for the whole file; a score that comes from elsewhere says both itself
ORIGIN = ("machine", "source")
_FIGURES = ("e", "uncertainty", "windows_s")


def checked(path: Path, found: Any) -> dict[str, Any]:
    """A file of scores. Raises ContestError in one line that names file, field and remedy."""
    if not isinstance(found, dict):
        raise ContestError(f"{path}: must be an object with {', '.join(_HEAD)}, got {type(found).__name__}")
    for key, kind in _HEAD.items():
        if not isinstance(found.get(key), kind):
            raise ContestError(f"{path}: {key!r} must be {kind.__name__}, got {found.get(key)!r:.40}")
    if found["benchmark"] != VERSION:
        raise ContestError(
            f"{path}: is of version {found['benchmark']} of the benchmark, this is {VERSION}; score the runs again"
        )
    known = {*names(), *outside_names()}
    for number, record in enumerate(found["scores"], 1):
        where = f"{path}: score {number}"
        if not isinstance(record, dict) or record.get("scene") not in known:
            scene = record.get("scene") if isinstance(record, dict) else record
            raise ContestError(f"{where}: 'scene' must be one of {', '.join(sorted(known))}, got {scene!r:.40}")
        if not isinstance(record.get("scheme"), str):
            raise ContestError(f"{where}: 'scheme' must name the scheme, got {record.get('scheme')!r:.40}")
        for key in ORIGIN:
            if not isinstance(record.get(key, ""), str):
                raise ContestError(f"{where}: {key!r} must be str, got {record[key]!r:.40}; leave it out or name it")
        if "does_not_apply" in record or record.get("blown_up"):
            continue
        for key in _FIGURES:
            values = record.get(key)
            fits = isinstance(values, list) and len(values) > 0 and all(_figure(value) for value in values)
            if not fits:
                raise ContestError(
                    f"{where}: {key!r} must be a list of numbers, got {values!r:.40}; let `score --entry` write it"
                )
        if len({len(record[key]) for key in _FIGURES}) > 1:
            raise ContestError(f"{where}: {', '.join(_FIGURES)} must be of one length; let `score --entry` write them")
        if record.get("cost_s") is not None and not (_figure(record["cost_s"]) and record["cost_s"] >= 0):
            raise ContestError(f"{where}: 'cost_s' must be CPU seconds, got {record['cost_s']!r:.40}")
    return found


def _figure(value: Any) -> bool:
    return value is None or (isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value))


def read(path: Path) -> dict[str, Any]:
    """A file of scores; raises as `checked`."""
    try:
        return checked(path, json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise ContestError(f"{path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        if isinstance(error, ContestError):
            raise
        raise ContestError(f"{path}: not valid JSON: {error}") from None


def all_entries(folder: Path = ENTRIES) -> list[dict[str, Any]]:
    """Every file of scores, from the alphabet."""
    return [read(path) for path in sorted(folder.glob("*.json"))]


def _rounded(value: Any) -> Any:
    """Numbers to five digits: more no benchmark has."""
    if isinstance(value, float):
        return float(f"{value:.5g}") if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    return [_rounded(each) for each in value] if isinstance(value, list | tuple) else value


def write(path: Path, head: dict[str, Any], scores: list[dict[str, Any]]) -> None:
    """A file of scores, one a line. Raises ContestError for what `checked` would not take, and then writes nothing."""
    found = checked(path, _rounded({"benchmark": VERSION, **head, "scores": scores}))
    lines = [json.dumps(record, ensure_ascii=False) for record in found.pop("scores")]
    text = json.dumps(found, indent=1, ensure_ascii=False).removesuffix("\n}")
    write_text(path, text + ',\n "scores": [\n  ' + ",\n  ".join(lines) + "\n ]\n}\n")


def merge(path: Path, head: dict[str, Any], records: list[dict[str, Any]]) -> None:
    """Replaces the scores of some scenes in a file by `records`, which come from where `head` says. The file keeps its own
    origin as long as scores of that origin are left in it; until then the new scores carry theirs."""
    anew = {record["scene"] for record in records}
    kept: list[dict[str, Any]] = []
    if path.is_file():
        before = read(path)
        kept = [record for record in before["scores"] if record["scene"] not in anew]
        if any(not record.keys() & set(ORIGIN) for record in kept):
            if any(head[key] != before[key] for key in ORIGIN):
                records = [record | {key: head[key] for key in ORIGIN} for record in records]
            head = head | {key: before[key] for key in ORIGIN}
        else:
            kept = [_of_here(record, head) for record in kept]
    write(path, head, sorted(kept + records, key=lambda record: record["scene"]))


def _of_here(record: dict[str, Any], head: dict[str, Any]) -> dict[str, Any]:
    """A score without its own origin where that is the head's."""
    same = all(record.get(key) == head[key] for key in ORIGIN)
    return {key: value for key, value in record.items() if not (same and key in ORIGIN)}
