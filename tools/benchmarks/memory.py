"""Memory of a process that plays for a minute: one line of JSON [MiB].

    PYTHONPATH=tools python -m benchmarks.memory [SECONDS]

import: resident after loading engine and preset; prepared: with everything compiled, after five seconds of the song;
growth: from there to the end; peak: the most at any time.
"""

from __future__ import annotations

import json
import resource
import sys
from pathlib import Path

import numpy as np

from benchmarks import scenes


def resident_mib() -> float:
    """Resident memory now; where the system does not tell, the most so far."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * resource.getpagesize() / 2**20
    except OSError:
        return peak_mib()


def peak_mib() -> float:
    """The most resident memory so far."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / 2**20 if sys.platform == "darwin" else most / 2**10


def main() -> None:
    """The command line."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    found = {"import": resident_mib()}
    player = scenes.song("drone")
    out = np.zeros((128, 2))

    def play(length_s: float) -> None:
        """The song over and over."""
        at = 0
        for _ in range(round(length_s * scenes.RATE_HZ / 128)):
            first, behind = np.searchsorted(player.events["frame"], (at, at + 128))
            due = player.events[first:behind].copy()
            due["frame"] -= at
            player.engine.process(due, out)
            at = at + 128 if at < player.frames else 0

    play(5.0)
    found["prepared"] = resident_mib()
    play(seconds)
    found["growth"] = resident_mib() - found["prepared"]
    found["peak"] = peak_mib()
    print(json.dumps(found))


if __name__ == "__main__":
    main()
