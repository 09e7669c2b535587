"""Ad-hoc code signatures for macOS: sealed, by nobody in particular, which is what its loader asks of code on arm64.

    seal = resources({"Resources/bank.jawari": bank})        # a bundle's _CodeSignature/CodeResources
    code = sign(dylib, "org.jawari.tanpura", info, seal)     # its library, with the bundle's Info.plist and that sealed

As `codesign --sign -` makes them. The formats are those of Apple's cs_blobs.h and mach-o/loader.h; numbers are big-endian in
a signature, little-endian in the file around it. A signature ends the file and covers every byte before it.
"""

from __future__ import annotations

import hashlib
import plistlib
import struct
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

#: of hashes within the code; processors with pages of 16 KiB take the same
PAGE = 4096
#: to which the memory of the last segment is rounded up
_SEGMENT_PAGE = 16384
_MAGIC_64, _SEGMENT_64, _CODE_SIGNATURE = 0xFEEDFACF, 0x19, 0x1D
_SUPERBLOB, _DIRECTORY, _REQUIREMENTS, _WRAPPER = 0xFADE0CC0, 0xFADE0C02, 0xFADE0C01, 0xFADE0B01
#: places in a signature: of the directory, of requirements, of a certificate's signature, which is empty here
_DIRECTORY_SLOT, _REQUIREMENTS_SLOT, _CERTIFIED_SLOT = 0, 2, 0x10000
_VERSION, _AD_HOC, _SHA256 = 0x20400, 0x2, 2

#: which files of a bundle are sealed and how, as `codesign` has it where there are Contents: before macOS 10.9.5, and since
_LANGUAGES: dict[str, Any] = {
    "^Resources/.*\\.lproj/": {"optional": True, "weight": 1000.0},
    "^Resources/.*\\.lproj/locversion.plist$": {"omit": True, "weight": 1100.0},
    "^Resources/Base\\.lproj/": {"weight": 1010.0},
}
_RULES: dict[str, Any] = {**_LANGUAGES, "^Resources/": True, "^version.plist$": True}
_RULES2: dict[str, Any] = {
    **_LANGUAGES,
    ".*\\.dSYM($|/)": {"weight": 11.0},
    "^(.*/)?\\.DS_Store$": {"omit": True, "weight": 2000.0},
    "^(Frameworks|SharedFrameworks|PlugIns|Plug-ins|XPCServices|Helpers|MacOS|Library/(Automator|Spotlight|LoginItems))/": {
        "nested": True,
        "weight": 10.0,
    },
    "^.*": True,
    "^Info\\.plist$": {"omit": True, "weight": 20.0},
    "^PkgInfo$": {"omit": True, "weight": 20.0},
    "^Resources/": {"weight": 20.0},
    "^[^/]+$": {"nested": True, "weight": 10.0},
    "^embedded\\.provisionprofile$": {"weight": 20.0},
    "^version\\.plist$": {"weight": 20.0},
}


class Unsignable(ValueError):
    """A file that cannot be signed."""


def resources(files: Mapping[str, bytes]) -> bytes:
    """The text of CodeResources for the files below Resources; names are relative to Contents."""
    return plistlib.dumps(
        {
            "files": {name: hashlib.sha1(data).digest() for name, data in files.items()},
            "files2": {name: {"hash2": hashlib.sha256(data).digest()} for name, data in files.items()},
            "rules": _RULES,
            "rules2": _RULES2,
        }
    )


def sign(code: bytes, identifier: str, info: bytes = b"", sealed: bytes = b"") -> bytes:
    """A Mach-O file of one processor with an ad-hoc signature, in the place of the one that it may have.

    info: of a bundle, its Info.plist; sealed: its CodeResources.  Raises Unsignable for what is none or has no room.
    """
    try:
        return _signed(code, identifier, info, sealed)
    except struct.error as error:
        raise Unsignable(f"is a damaged Mach-O file: {error}") from error


class _Command(NamedTuple):
    at: int
    kind: int
    size: int


class _Segment(NamedTuple):
    """sections: offsets in the file of those that it holds."""

    at: int
    begin: int
    size: int
    sections: tuple[int, ...]


def _signed(code: bytes, identifier: str, info: bytes, sealed: bytes) -> bytes:
    magic, _, _, _, count, size = struct.unpack_from("<6I", code)
    if magic != _MAGIC_64:
        raise Unsignable("is no Mach-O file of one 64-bit processor")
    commands = list(_commands(code, count))
    segments = dict(_segment(code, each.at) for each in commands if each.kind == _SEGMENT_64)
    text, last = segments.get(b"__TEXT"), segments.get(b"__LINKEDIT")
    if text is None or last is None or last.begin + last.size != len(code):
        raise Unsignable("is a Mach-O file that does not end with its __LINKEDIT segment")
    own = next((each for each in commands if each.kind == _CODE_SIGNATURE), None)
    end = len(code) if own is None else struct.unpack_from("<I", code, own.at + 8)[0]
    if not last.begin <= end <= len(code):
        raise Unsignable("is a Mach-O file whose signature lies outside its __LINKEDIT segment")
    out = bytearray(code[:end].ljust(-(-end // 16) * 16, b"\0"))
    limit = len(out)
    if own is None:
        own = _Command(32 + size, _CODE_SIGNATURE, 16)
        first = min((at for segment in segments.values() for at in segment.sections), default=0)
        if own.at + own.size > first or any(code[own.at : own.at + own.size]):
            raise Unsignable("is a Mach-O file whose header has no room for a signature's load command")
        struct.pack_into("<2I", out, 16, count + 1, size + own.size)
    requirements = struct.pack(">3I", _REQUIREMENTS, 12, 0)
    special = [sealed, requirements, info] if sealed else [requirements, info]
    room = -(-(12 + 3 * 8 + _directory_size(identifier, len(special), limit) + len(requirements) + 8) // 16) * 16
    struct.pack_into("<4I", out, own.at, _CODE_SIGNATURE, 16, limit, room)
    struct.pack_into("<Q", out, last.at + 32, -(-(limit + room - last.begin) // _SEGMENT_PAGE) * _SEGMENT_PAGE)
    struct.pack_into("<Q", out, last.at + 48, limit + room - last.begin)
    directory = _directory(out, identifier, special, text)
    blobs = [
        (_DIRECTORY_SLOT, directory),
        (_REQUIREMENTS_SLOT, requirements),
        (_CERTIFIED_SLOT, struct.pack(">2I", _WRAPPER, 8)),
    ]
    return bytes(out + _superblob(blobs).ljust(room, b"\0"))


def _commands(code: bytes, count: int) -> Iterator[_Command]:
    at = 32
    for _ in range(count):
        kind, size = struct.unpack_from("<2I", code, at)
        if size < 8:
            raise Unsignable("is a damaged Mach-O file: a load command without a size")
        yield _Command(at, kind, size)
        at += size


def _segment(code: bytes, at: int) -> tuple[bytes, _Segment]:
    name, _, _, begin, size, _, _, sections, _ = struct.unpack_from("<16s4Q4I", code, at + 8)
    offsets = [struct.unpack_from("<I", code, at + 72 + 80 * number + 48)[0] for number in range(sections)]
    return name.rstrip(b"\0"), _Segment(at, begin, size, tuple(each for each in offsets if each))


def _directory_size(identifier: str, special: int, limit: int) -> int:
    return 88 + len(identifier.encode()) + 1 + 32 * (special + -(-limit // PAGE))


def _directory(code: bytearray, identifier: str, special: list[bytes], text: _Segment) -> bytes:
    """The hashes of what is sealed: what lies elsewhere, the highest slot first, then the code's pages.

    special: of slots n … 1, empty: nothing. text: the segment that holds the code proper.
    """
    pages = [code[at : at + PAGE] for at in range(0, len(code), PAGE)]
    names = identifier.encode() + b"\0"
    size = _directory_size(identifier, len(special), len(code))
    begin = 88 + len(names) + 32 * len(special)
    head = struct.pack(
        ">9I4B4I4Q",
        _DIRECTORY,
        size,
        _VERSION,
        _AD_HOC,
        begin,  # of the pages' hashes
        88,  # of the identifier
        len(special),
        len(pages),
        len(code),
        32,
        _SHA256,
        0,  # of no platform of Apple's
        PAGE.bit_length() - 1,
        0,
        0,  # not scattered
        0,  # of no team
        0,
        0,  # the code's size, where 32 bits do not hold it
        text.begin,
        text.size,
        0,  # no program's main part
    )
    hashes = [hashlib.sha256(each).digest() if each else bytes(32) for each in special]
    return head + names + b"".join(hashes) + b"".join(hashlib.sha256(each).digest() for each in pages)


def _superblob(blobs: list[tuple[int, bytes]]) -> bytes:
    at = 12 + 8 * len(blobs)
    index, size = b"", at + sum(len(blob) for _, blob in blobs)
    for slot, blob in blobs:
        index += struct.pack(">2I", slot, at)
        at += len(blob)
    return struct.pack(">3I", _SUPERBLOB, size, len(blobs)) + index + b"".join(blob for _, blob in blobs)
