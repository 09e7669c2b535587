"""Which systems a shared object runs on, from what its dynamic section asks the loader for."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass

#: parts of glibc, the only libraries of a system that such a wheel may ask for
SYSTEM = frozenset(
    {
        "libc.so.6",
        "libm.so.6",
        "libpthread.so.0",
        "libdl.so.2",
        "librt.so.1",
        "ld-linux-x86-64.so.2",
        "ld-linux-aarch64.so.1",
    }
)
#: number of a processor in a shared object: what wheels call it, and the oldest systems that they name for it
_PROCESSORS = {62: ("x86_64", (2, 5)), 183: ("aarch64", (2, 17))}
_DYNAMIC, _VERSIONS_NEEDED, _NEEDED = 6, 0x6FFFFFFE, 1


class Unfit(ValueError):
    """A file that no manylinux wheel can carry."""


@dataclass(frozen=True)
class Needs:
    """libraries: files that the loader looks for; versions: names of symbol versions in them ("GLIBC_2.17"); machine: number
    of the processor."""

    libraries: tuple[str, ...]
    versions: tuple[str, ...]
    machine: int


@dataclass(frozen=True)
class _Section:
    kind: int
    data: bytes
    link: int
    info: int


def needs(data: bytes) -> Needs:
    """What a shared object asks for. Raises Unfit for what is none of Linux on x86-64 or arm64."""
    try:
        if data[:6] != b"\x7fELF\x02\x01" or (machine := struct.unpack_from("<H", data, 18)[0]) not in _PROCESSORS:
            raise Unfit("is no shared object for Linux on x86-64 or arm64")
        sections = list(_sections(data))
        libraries, versions = [], []
        for section in sections:
            if section.kind == _DYNAMIC:
                names = sections[section.link].data
                libraries += [
                    _text(names, value) for tag, value in struct.iter_unpack("<QQ", section.data) if tag == _NEEDED
                ]
            elif section.kind == _VERSIONS_NEEDED:
                versions += _versions(section, sections[section.link].data)
    except (struct.error, IndexError, ValueError) as error:
        raise error if isinstance(error, Unfit) else Unfit(f"is a damaged shared object: {error}") from error
    return Needs(tuple(libraries), tuple(sorted(set(versions))), machine)


def platform(data: bytes) -> str:
    """The tag of the oldest systems that a shared object runs on: manylinux_2_17_x86_64.

    Raises Unfit for one that needs more than a C library, or what no release of that has.
    """
    asked = needs(data)
    if others := sorted(set(asked.libraries) - SYSTEM):
        raise Unfit(f"needs {', '.join(others)}, which some systems lack")
    processor, newest = _PROCESSORS[asked.machine]
    for name in asked.versions:
        found = re.fullmatch(r"GLIBC_(\d+)\.(\d+)(\.\d+)?", name)
        if found is None:
            raise Unfit(f"needs symbols of the version {name}, which no release of glibc promises")
        newest = max(newest, (int(found[1]), int(found[2])))
    return f"manylinux_{newest[0]}_{newest[1]}_{processor}"


def _sections(data: bytes) -> Iterator[_Section]:
    (begin,) = struct.unpack_from("<Q", data, 0x28)
    size, count = struct.unpack_from("<HH", data, 0x3A)
    for number in range(count):
        _, kind, _, _, offset, length, link, info = struct.unpack_from("<IIQQQQII", data, begin + number * size)
        yield _Section(
            kind, b"" if kind == 8 else data[offset : offset + length], link, info
        )  # 8: takes no place in the file


def _versions(section: _Section, names: bytes) -> Iterator[str]:
    at = 0
    for _ in range(section.info):
        _, count, _, first, after = struct.unpack_from("<HHIII", section.data, at)
        inner = at + first
        for _ in range(count):
            _, _, _, name, step = struct.unpack_from("<IHHII", section.data, inner)
            yield _text(names, name)
            inner += step
        at += after


def _text(names: bytes, at: int) -> str:
    return names[at : names.index(b"\0", at)].decode("ascii")
