"""The door that the browser is sent to: what stands on its command line, where every user of the machine can read it.

It is not the token. It opens once, soon after it was made, and only for a process of the user whose program this is: whose
the other end of a connection is, Linux says in /proc/net/tcp. Elsewhere nobody says; then whoever comes first is let in,
and when a second one comes, the first is put out and the terminal is told.

(A file that redirects, which others cannot read, would do without that, but browsers in a sandbox, those of most desktops,
cannot read it either.)
"""

from __future__ import annotations

import hmac
import logging
import os
import secrets
import socket
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path

LOG = logging.getLogger(__name__)
#: how long it can be opened [s]; a browser may have to be started first
OPEN_S = 120.0
TABLES = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
_ESTABLISHED = "01"

Address = tuple[str, int]


class Door:
    """One door; `opens` is asked at every request that shows a code."""

    def __init__(self) -> None:
        self.code = secrets.token_urlsafe(16)
        self.used = False
        self._made = time.monotonic()
        #: let in without anybody having said whose process it was
        self.unsure = False

    def opens(self, code: str, client: Address | None, server: Address | None) -> str | None:
        """None, and it is used; or why it stays closed for this request."""
        if not self.knows(code):
            return "wrong door"
        if self.used or time.monotonic() - self._made > OPEN_S:
            return "this address works once, soon after the start"
        owner = None if client is None or server is None else owner_of(client, server)
        if owner is None and TABLES[0].exists():
            return "the user who sends this request is unknown"
        if owner is not None and owner != os.getuid():
            LOG.warning("user %d of this machine tried to open the page and was refused", owner)
            return "this page belongs to another user"
        self.used, self.unsure = True, owner is None
        return None

    def knows(self, code: str) -> bool:
        return hmac.compare_digest(code.encode("utf-8", "surrogateescape"), self.code.encode())


def owner_of(client: Address, server: Address) -> int | None:
    """The user whose process holds the client's end of a connection on this machine; None where that cannot be told."""
    for table in TABLES:
        try:
            text = table.read_text(encoding="ascii")
        except OSError:
            continue
        for local, remote, state, uid, inode in _rows(text):
            # only while both ends are open: of a socket that its process has left, root is said to be the owner
            if state == _ESTABLISHED and inode != "0" and _same(local, client) and _same(remote, server):
                return int(uid)
    return None


def _rows(text: str) -> Iterator[tuple[str, str, str, str, str]]:
    for line in text.splitlines()[1:]:
        columns = line.split()
        if len(columns) > 9:
            yield columns[1], columns[2], columns[3], columns[7], columns[9]


def _same(entry: str, address: Address) -> bool:
    """Whether an entry of the table, hexadecimal numbers of the machine's byte order, is an IPv4 address."""
    words, port = entry.split(":")
    number = struct.unpack(">I", socket.inet_aton(address[0]))[0]
    if sys.byteorder == "little":
        number = int.from_bytes(number.to_bytes(4, "big"), "little")
    mapped = f"{0:016X}{socket.htonl(0xFFFF):08X}"  # ::ffff:…, of a socket for both
    return int(port, 16) == address[1] and words in (f"{number:08X}", f"{mapped}{number:08X}")
