"""What tools compute as studies: rows of a function, kept under `out/`, so that a run that was stopped goes on."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[1]
#: of the package: what runs of strings in scenes depend on, without the plan and what is written by these tools
ROOMS = ("native", "jit", "physics", "solver", "dsp", "research")
_SAID_S = 5.0


def files(*patterns: str) -> list[str]:
    """Files of the repository by patterns, as a study's `base.sources` names them."""
    found = sorted({str(path) for pattern in patterns for path in REPOSITORY.glob(pattern)})
    assert found, patterns
    return found


def study_of(
    call: str, blocks: Sequence[Mapping[str, Any]], sources: Sequence[str], rooms: Sequence[str] = ROOMS, **more: Any
) -> dict[str, Any]:
    """A study's tables.

    call     "module:function" below `tools`, which gets a row's parameters
    blocks   of rows: `set`, `grid`, `zip`
    sources  files that the rows depend on, beside that module and these rooms of the package; cases are always among them
    more     other tables of a study: `times`, `reference`
    """
    base = {
        "call": call, "path": [str(REPOSITORY / "tools")], "rooms": list(rooms),
        "sources": [*sources, *files("presets/cases/*.toml")],
    }  # fmt: skip
    return {"name": call.partition(":")[2], "base": base, "block": [dict(block) for block in blocks], **more}


def rows_of(study: Mapping[str, Any], folder: Path, workers: int | None) -> list[dict[str, Any]]:
    """Every row of the study in its order, computed where the folder does not have it: parameters, values, times, `key`.

    workers: processes; None: one for each processor; 0: a loop in this process. Nothing is None: what a row does not have
    is not there. Raises RuntimeError with the rows that failed and why; KeyboardInterrupt keeps what is finished.
    """
    from synth.study.conducting import Counts
    from synth.study.sweeping import read_results, sweep

    said, done, began = 0.0, 0, time.monotonic()

    def told(counts: Counts) -> None:
        nonlocal said, done
        last = counts.done == counts.total and counts.done > done
        if counts.computed and (time.monotonic() - said > _SAID_S or last):
            said, done = time.monotonic(), counts.done
            print(f"{folder.name}: {counts.done} of {counts.total}, {said - began:.0f} s", file=sys.stderr, flush=True)

    folder.parent.mkdir(parents=True, exist_ok=True)
    sweep(study, folder, workers=workers, told=told, retry_failed=True)
    found = [{name: value for name, value in row.items() if value is not None} for row in read_results(folder)]
    names = list(dict.fromkeys(name for block in study["block"] for part in block.values() for name in part))
    bad = [row for row in found if "failure" in row]
    if bad:
        lines = [f"{', '.join(f'{name} {row.get(name)}' for name in names)}: {row['failure']}" for row in bad[:10]]
        raise RuntimeError(f"{len(bad)} of {len(found)} rows of {folder} failed:\n" + "\n".join(lines))
    return found
