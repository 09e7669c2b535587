"""How wide the vectors of compiled kernels are: as a register, or as a trial on this processor found faster.

Registers of eight doubles are not faster everywhere: some processors slow down for them, and short rows are summed sooner in
half of one. A trial of a tenth of a second takes the kernels' own passes over rows of several lengths at each width; what it
found is kept in the user's cache, by processor, and asked for when kernels are first compiled (`settle`). It is a choice of
JAWARI_LANES: 8; 8-64, which takes half as many lanes for rows of up to 64 modes; 4; 2.

Only where there is something to choose (registers of eight doubles), nobody has chosen (JAWARI_LANES, or JAWARI_TRIAL=0,
which leaves the trial out), and kernels come from no native library.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from synth.files.targets import write_text
from synth.jit.kernel_sources import users_cache
from synth.native.processors import level, model

#: what a trial may take, compiling included, on a machine that does much else; then there is no choice [s]
_PATIENCE_S = 20.0
#: another width than the register's must be faster by this to be chosen: timings are no better
_WORTH = 1.1
#: choices that there are to make
WIDE, NARROW = 8, 4
_CHOICES = {"8", "4", *(f"8-{n}" for n in (16, 32, 64, 128, 256))}


def processor() -> str:
    """The processor's name, as the system has it."""
    return model() or platform.processor() or platform.machine()


def kept() -> dict[str, Any] | None:
    """What a trial on this processor found: {"lanes": "8", "seconds": {"4": {"16": …}, "8": …}}; None: there was none."""
    try:
        known = json.loads(_file().read_text(encoding="utf-8"))
        found = known[processor()]
        if found["seconds"]:
            choose(found["seconds"])
        return found if found["lanes"] in _CHOICES else None
    except (OSError, RuntimeError, ValueError, KeyError, TypeError):  # no home; no file, or not ours
        return None


def use_kept() -> None:
    """Have kernels compiled as a trial found, where one was made, nobody has chosen and no native library is there, whose
    kernels are as wide as the registers."""
    found = kept()
    if found is None or found["lanes"] == str(WIDE) or not _is_open():
        return
    from synth.jit import prebuilt

    if os.environ.get("JAWARI_NATIVE") == "0" or not any(place.is_file() for place in prebuilt.places()):
        os.environ["JAWARI_LANES"] = found["lanes"]


def settle() -> str | None:
    """Make the trial, if there is one to make and none was made, and go by it. The choice, None: there was nothing to
    choose, or no time for it."""
    from synth.jit import prebuilt

    if os.environ.get("JAWARI_TRIAL") == "0" or kept() is not None or not _is_open() or prebuilt.found().path is not None:
        return None
    try:
        done = subprocess.run(
            [sys.executable, "-m", "synth.solver.width_trial"],
            env={**os.environ, "JAWARI_LANES": str(WIDE), "JAWARI_NATIVE": "0"},
            capture_output=True,
            timeout=_PATIENCE_S,
            check=True,
        )
        seconds = json.loads(done.stdout)
        found = {"lanes": choose(seconds), "seconds": seconds}
    except subprocess.TimeoutExpired:  # the machine does much else: another time
        return None
    except (OSError, ValueError, KeyError, subprocess.SubprocessError):  # the register's, and no second trial
        found = {"lanes": str(WIDE), "seconds": {}}
    with suppress(OSError, RuntimeError, ValueError):
        known: Any = {}
        with suppress(OSError, ValueError):
            known = json.loads(_file().read_text(encoding="utf-8"))
        known = known if isinstance(known, dict) else {}
        _file().parent.mkdir(parents=True, exist_ok=True)
        write_text(_file(), json.dumps({**known, processor(): found}, indent=1) + "\n")
    if found["lanes"] != str(WIDE):
        os.environ["JAWARI_LANES"] = found["lanes"]
    return found["lanes"]


def choose(seconds: dict[str, dict[str, float]]) -> str:
    """JAWARI_LANES from the times of rows by their length [s], of each width. Raises KeyError, ValueError."""
    wide, narrow = ({int(n): float(s) for n, s in seconds[str(lanes)].items()} for lanes in (WIDE, NARROW))
    faster = [n for n in sorted(wide) if wide[n] > _WORTH * narrow[n]]
    if len(faster) == len(wide):
        return str(NARROW)
    short = 0
    for n in sorted(wide):  # the rows up to the first that is better off in whole registers
        if n not in faster:
            break
        short = n
    return f"{WIDE}-{short}" if short else str(WIDE)


def described() -> str:
    """What kernels that are compiled here take, and why, for a person to read; empty: the processor's level says it all."""
    asked = os.environ.get("JAWARI_LANES", "")
    found = kept()
    if found is not None and asked in ("", found["lanes"]) and found["seconds"]:
        wide, narrow = (found["seconds"][str(lanes)] for lanes in (WIDE, NARROW))
        ratios = [float(narrow[n]) / float(wide[n]) for n in wide]
        by = f"half as wide takes {min(ratios):.2g} to {max(ratios):.2g} times as long"
        return f"vectors of {_in_words(found['lanes'])} by a trial ({by})"
    return f"vectors of {_in_words(asked)}, as JAWARI_LANES says" if asked else ""


def _in_words(lanes: str) -> str:
    wide, _, short = lanes.partition("-")
    return f"{wide} doubles" + (f", {int(wide) // 2} up to {short} modes" if short else "")


def _is_open() -> bool:
    return "JAWARI_LANES" not in os.environ and level() == "x86-64-v4"


def _file() -> Path:
    return users_cache() / "vectors.json"
