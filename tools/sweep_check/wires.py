"""Bytes that went between client, scheduler and workers, as the kernel counted them: `ss` of iproute2."""

from __future__ import annotations

import re
import shutil
import subprocess
from typing import NamedTuple


class Socket(NamedTuple):
    """An open TCP connection's end: whose it is, from where to where, and its payload in bytes."""

    pid: int
    local: str
    peer: str
    sent: int
    received: int


def sockets() -> list[Socket]:
    """All of this machine that have a process; none where there is no `ss`."""
    if shutil.which("ss") is None:
        return []
    told = subprocess.run(["ss", "-tniHp", "state", "established"], capture_output=True, text=True, check=True).stdout
    found = []
    for first, more in re.findall(r"^(\S.*)\n(\s+.*)$", told, re.MULTILINE):
        pid = re.search(r"pid=(\d+)", first)
        if pid is None:
            continue
        local, peer = (each for each in first.split() if re.fullmatch(r"\S+:\d+", each))
        sent, received = (re.search(rf"\b{name}:(\d+)", more) for name in ("bytes_sent", "bytes_received"))
        found.append(Socket(int(pid[1]), local, peer, int(sent[1]) if sent else 0, int(received[1]) if received else 0))
    return found


def moved(scheduler: int, client: int) -> dict[str, int]:
    """Bytes so far of open connections of a scheduler's process with that of the client, and with all others (workers)."""
    ends = sockets()
    owner = {end.local: end.pid for end in ends}
    found = dict.fromkeys(("client to scheduler", "scheduler to workers", "workers to scheduler", "scheduler to client"), 0)
    for end in ends:
        if end.pid == scheduler:
            whom = "client" if owner.get(end.peer) == client else "workers"
            found[f"scheduler to {whom}"] += end.sent
            found[f"{whom} to scheduler"] += end.received
    return found
