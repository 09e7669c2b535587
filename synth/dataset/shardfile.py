"""Shards: tar files by WebDataset's convention, KEY.flac and KEY.json of each item next to each other, as bytes that depend
on the items alone (no times, no owners)."""

from __future__ import annotations

import io
import os
import tarfile
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO, NamedTuple

from synth.files.targets import write_whole


class ByteRange(NamedTuple):
    """Where a file's bytes are in its shard."""

    offset: int
    size: int


def shard_name(split: str, number: int) -> str:
    """train/shard-000000.tar, from the data set's folder."""
    return f"{split}/shard-{number:06d}.tar"


def write_shard(path: Path, members: Iterable[tuple[str, bytes]]) -> dict[str, ByteRange]:
    """Writes files by name into a shard, which is whole or not there; where each is. Raises OSError that names `path`."""
    places: dict[str, ByteRange] = {}

    def write(file: BinaryIO) -> None:
        with tarfile.open(fileobj=file, mode="w", format=tarfile.USTAR_FORMAT) as tar:
            for name, data in members:
                head = tarfile.TarInfo(name)
                head.size, head.mode = len(data), 0o644
                places[name] = ByteRange(tar.offset + tarfile.BLOCKSIZE, len(data))
                tar.addfile(head, io.BytesIO(data))

    write_whole(path, write)
    return places


def read_member(path: str | os.PathLike[str], offset: int, size: int) -> bytes:
    """The bytes at a place. Raises OSError, ValueError where the shard is shorter."""
    with open(path, "rb") as file:
        file.seek(offset)
        data = file.read(size)
    if len(data) != size:
        raise ValueError(f"{os.fspath(path)}: ends before byte {offset + size}; the shard was cut off")
    return data
