"""How far a study is, by what its folder says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from synth.units import duration


def standing(folder: Path) -> dict[str, Any]:
    """What a study's folder says of it. Raises OSError or ValueError where it is none."""
    from synth.study.keeping import Folder, is_locked, journalled, said

    about = said(folder)
    running = is_locked(folder)
    state = about.get("state", "stopped")
    if state == "running" and not running:
        state = "killed"
    stored = 0
    for each in Folder(folder).tables(["key"]):
        stored += each.num_rows
    return {
        **{name: about.get(name) for name in ("name", "rows", "done", "failed", "computed", "workers", "seconds", "at")},
        "state": state, "stored": stored + journalled(folder), "parts": len(Folder(folder).parts),
        "table": (folder / "table.parquet").is_file(),
    }  # fmt: skip


def standing_text(found: dict[str, Any]) -> str:
    """`standing` in words."""
    left, rate = (found["rows"] or 0) - (found["done"] or 0), (found["computed"] or 0) / max(found["seconds"] or 0.0, 1e-9)
    text = f"{found['name']}: {found['state']}, {found['done']} of {found['rows']} rows, {found['failed']} failed"
    if found["state"] == "running":
        text += f", {rate:.3g} rows/s, {duration(left / rate) if rate else '?'} left, {found['workers']} workers"
    elif found["state"] in ("stopped", "killed"):
        text += "; the same command goes on"
    more = "finished table" if found["table"] and found["state"] == "finished" else "no finished table"
    return f"{text}\n{found['stored']} rows stored in {found['parts']} parts, {more}; as of {found['at']}"
