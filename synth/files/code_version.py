"""Which code made a number: a hash of the sources that it can depend on.

Who computes the same from the same inputs with sources of the same hash gets the same; so a hash of both names a result.
"""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
#: rooms of what is heard and simulated: solver, instruments, engine, offline rendering
SOUNDING = ("native", "jit", "midi", "physics", "solver", "dsp", "instrument", "engine", "research", "host")
#: rooms of one string over one obstacle as a question to the solver
RESEARCH = ("native", "jit", "physics", "solver", "dsp", "instrument", "research")


@cache
def code_version(rooms: tuple[str, ...] = SOUNDING) -> str:
    """64 hexadecimal digits of all sources in these rooms of the package, by their names and contents.

    Line ends are of no account. Raises ValueError for a room that is not there.
    """
    digest = hashlib.sha256()
    for room in sorted(rooms):
        files = sorted((_PACKAGE / room).rglob("*.py"))
        if not files:
            raise ValueError(f"synth has no room {room!r}")
        for path in files:
            for part in (path.relative_to(_PACKAGE).as_posix().encode(), path.read_bytes().replace(b"\r\n", b"\n")):
                digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()
