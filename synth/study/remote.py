"""A scheduler at an address, and what a study asks of it before anything is sent there.

Dask's schedulers run what they are given. With TLS, only those who hold a certificate of the cluster are heard; without it,
everybody who reaches the scheduler, its workers or the way between them can run code there and here.
"""

from __future__ import annotations

import ipaddress
import os
import socket
import ssl
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import urlsplit

#: schemes of Dask's whose traffic is encrypted, and one that never leaves its process
_ENCRYPTED, _INSIDE = ("tls", "wss"), "inproc"


class Remote(NamedTuple):
    """Where a scheduler is, and Dask's `Security` for it; None: that of Dask's configuration."""

    address: str
    security: Any = None


def remote(address: str, security: Any = None, insecure: bool = False) -> Remote:
    """A scheduler that may be spoken to.

    security  Dask's `Security` (`certificates` makes one); None: that of Dask's configuration
    insecure  take an address without encryption that is not on this machine
    Raises ValueError for an address that is none, that is not encrypted and not of this machine, or whose certificates
    are missing.
    """
    scheme, host = _parts(address)
    if scheme in _ENCRYPTED:
        if _context(security) is None:
            raise ValueError(
                f"--scheduler: {address} needs certificates; give --tls-ca, --tls-cert and --tls-key, or "
                "distributed.comm.tls of Dask's configuration"
            )
    elif security is not None and security.require_encryption:
        raise ValueError(f"--scheduler: certificates need an address that begins with tls://, got {address}")
    elif scheme != _INSIDE and not insecure and not _is_here(host):
        raise ValueError(
            f"--scheduler: {address} is not encrypted and not on this machine: anybody on the network in between can run "
            "code as you; start scheduler and workers with certificates and give tls://…, or use --insecure on a network "
            "that you trust"
        )
    return Remote(address, security)


def certificates(ca: str | os.PathLike[str], cert: str | os.PathLike[str], key: str | os.PathLike[str] | None = None) -> Any:
    """Dask's `Security` from files in PEM format: of the authority, of this side's certificate, of its key (None: it stands
    in the file of the certificate). Raises ValueError or OSError that names the option."""
    from distributed.security import Security

    for option, path in (("--tls-ca", ca), ("--tls-cert", cert), ("--tls-key", key)):
        if path is not None and not Path(path).is_file():
            raise FileNotFoundError(f"{option}: {os.fspath(path)} is not a file; give one in PEM format")
    context = ssl.create_default_context()
    try:
        context.load_verify_locations(cafile=ca)
    except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
        raise ValueError(f"--tls-ca: {os.fspath(ca)} has no certificate in PEM format ({_why(error)})") from None
    try:
        context.load_cert_chain(cert, key, password=_no_password)
    except (OSError, ValueError) as error:
        files = os.fspath(cert) if key is None else f"{os.fspath(cert)} and {os.fspath(key)}"
        which = "--tls-cert" if key is None else "--tls-cert, --tls-key"
        raise ValueError(
            f"{which}: {files} have no certificate and its key in PEM format without a password ({_why(error)})"
        ) from None
    return Security(
        require_encryption=True, tls_ca_file=os.fspath(ca), tls_client_cert=os.fspath(cert),
        tls_client_key=os.fspath(cert if key is None else key),
    )  # fmt: skip


def _parts(address: str) -> tuple[str, str]:
    """(scheme, host) of an address; Dask's own scheme where it names none."""
    import dask

    scheme, separator, rest = str(address).partition("://")
    if not separator:
        scheme, rest = dask.config.get("distributed.comm.default-scheme", "tcp"), scheme
    try:
        host = urlsplit(f"{scheme}://{rest}").hostname or ""
    except ValueError:
        host = ""
    if not host:
        raise ValueError(f"--scheduler: must be an address such as tls://HOST:8786, got {address!r}")
    return scheme.lower(), host


def _is_here(host: str) -> bool:
    """Whether all that a name stands for are loopback addresses."""
    try:
        found = {str(each[4][0]) for each in socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)}
    except OSError:
        return False
    return bool(found) and all(ipaddress.ip_address(each).is_loopback for each in found)


def _context(security: Any) -> Any:
    """The TLS context of a client; None where no certificates are given. Raises ValueError where they cannot be read."""
    from distributed.security import Security

    try:
        return (security or Security()).get_connection_args("client")["ssl_context"]
    except (OSError, ValueError) as error:
        raise ValueError(f"--scheduler: distributed.comm.tls of Dask's configuration: {_why(error)}") from None


def _no_password() -> str:
    raise ValueError("it asks for a password")


def _why(error: Exception) -> str:
    return getattr(error, "reason", None) or getattr(error, "strerror", None) or str(error)
