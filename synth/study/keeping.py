"""A study's folder. One process writes it, the one that conducts the study; workers need not see it.

    lock                     of the process at work there
    study.json               which study it was last, and how far it is (`progress`)
    journal-N.jsonl          rows as they arrived, a line each: what is here outlives the process (kill -9)
    parts/NNNNNNNN.parquet   the same, some thousand rows each, written beside their place and renamed
    references/KEY.npz       what rows are compared with
    arrays.zarr/KEY/NAME     arrays asked for, a group for each row's address
    table.parquet            the finished table: inputs and measures, in the order of the study
    times.parquet            in the same order what is not the same again: CPU times, the machine, when

A row that is there twice, because its process was killed between two files, counts once.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import socket
import time
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from synth.files.locks import taken
from synth.files.targets import check_folder, naming, write_text, write_whole
from synth.study import columns
from synth.study.work.names import TIME

#: rows that a part has at most, and seconds after which what has arrived becomes one
PART_ROWS, PART_S = 2_000, 20.0
#: parts with fewer rows than PART_ROWS / 2 that are made one
_MANY = 32
FORMAT = 1
#: in a folder that was begun and killed before it said of which study it is
_BEGUN = {"lock", "parts", "references", "arrays.zarr"}


def _begun(path: Path) -> bool:
    """Whether a file is one of those that a study writes before study.json; also half a study.json."""
    return path.name in _BEGUN or path.match("journal-*.jsonl") or path.name.startswith(".study.json")


class AddressSet:
    """A growing set of addresses (hexadecimal), 16 bytes each."""

    def __init__(self) -> None:
        self._recent: set[bytes] = set()
        self._sorted = np.empty(0, "S16")

    def add(self, key: str) -> None:
        self._recent.add(bytes.fromhex(key[:32]))
        if len(self._recent) >= 65536:
            self._merge()

    def _merge(self) -> None:
        recent = np.array(list(self._recent), "S16")
        self._sorted = np.sort(np.concatenate([self._sorted, recent]))
        self._recent = set()

    def __contains__(self, key: str) -> bool:
        found = bytes.fromhex(key[:32])
        if found in self._recent:
            return True
        sought = np.array(found, "S16")
        place = int(np.searchsorted(self._sorted, sought))
        return place < self._sorted.size and bool(self._sorted[place] == sought)

    def __len__(self) -> int:
        return len(self._recent) + self._sorted.size


class Folder:
    """A study's folder, locked from `open` to `close`; also a context. Methods raise OSError that names a file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = -1
        self._journal: Any = None
        self._rows: list[dict[str, Any]] = []
        self._since = time.monotonic()
        self._next = 0

    def __enter__(self) -> Folder:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def parts(self) -> list[Path]:
        """Files of parts, in the order in which they were begun."""
        return sorted((self.path / "parts").glob("[0-9]*.parquet"))

    def open(self) -> None:
        """Makes and locks the folder; what a killed process left becomes a part. Raises OSError."""
        if not self.path.exists():
            check_folder(self.path, self.path.parent)
        elif not self.path.is_dir():
            raise NotADirectoryError(f"{self.path}: is a file; give a folder")
        elif not (self.path / "study.json").exists() and not all(map(_begun, self.path.iterdir())):
            raise FileExistsError(f"{self.path}: is not a study's folder, and not empty; give another")
        with naming(self.path):
            (self.path / "parts").mkdir(parents=True, exist_ok=True)
            self._take_lock()
        for path in self.parts:
            self._next = max(self._next, int(path.stem) + 1)
        self._take_over()

    def _take_lock(self) -> None:
        handle = os.open(self.path / "lock", os.O_RDWR | os.O_CREAT, 0o666)
        ours = taken(handle)
        for _ in range(10):  # somebody who asks whether it is taken has it for an instant
            if ours:
                break
            time.sleep(0.02)
            ours = taken(handle)
        if not ours:
            with os.fdopen(handle, encoding="utf-8", errors="replace") as file:
                who = file.read(200).strip() or "another process"
            raise BlockingIOError(f"{self.path}: {who} is working there; wait for it, or give another folder")
        self._lock = handle
        os.ftruncate(handle, 0)
        os.write(handle, f"process {os.getpid()} on {socket.gethostname()} (since {time.strftime('%F %T')})".encode())

    def _take_over(self) -> None:
        """Journals that were left behind become a part; a line that was cut off is none."""
        for path in sorted(self.path.glob("journal-*.jsonl")):
            self._rows += list(_lines(path))
            self._write_part()
            path.unlink()
        for path in (self.path / "arrays.zarr").glob(".*"):
            shutil.rmtree(path, ignore_errors=True)

    def close(self) -> None:
        """What has arrived becomes a part; the lock is given back."""
        try:
            self.flush()
        finally:
            if self._lock >= 0:
                os.close(self._lock)
                self._lock = -1

    def known(self, retry_failed: bool) -> tuple[AddressSet, AddressSet, dict[str, int]]:
        """Addresses that need not be computed, those of them that failed, and rows by the code that made them."""
        done, failed, codes = AddressSet(), AddressSet(), dict[str, int]()
        good, bad = AddressSet(), []
        for found in self.tables(["key", "code", "failure"]):
            reasons = found.column("failure").to_pylist() if "failure" in found.column_names else [None] * found.num_rows
            for key, code, reason in zip(
                found.column("key").to_pylist(), found.column("code").to_pylist(), reasons, strict=True
            ):
                codes[code] = codes.get(code, 0) + 1
                if reason is None:
                    good.add(key)
                    done.add(key)
                else:
                    bad.append(key)
        for key in bad:
            if key not in good:
                failed.add(key)
                if not retry_failed:
                    done.add(key)
        return done, failed, codes

    def tables(self, names: list[str] | None = None) -> Iterator[pa.Table]:
        """The parts, of these columns as far as they have them; whole also while the process at work makes several one.

        A part that went meanwhile has its rows in a later one, perhaps already read in its older form: the later ones are
        then read again, so that a row may come twice, and none is missed.
        """
        read: dict[str, tuple[int, int]] = {}
        again = True
        while again:
            again = False
            for path in self.parts:
                try:
                    with naming(path), open(path, "rb") as opened, pq.ParquetFile(opened) as file:
                        about = os.fstat(opened.fileno())
                        if read.get(path.name) == (about.st_ino, about.st_mtime_ns):
                            continue
                        names_there = file.schema_arrow.names
                        found = file.read(None if names is None else [name for name in names if name in names_there])
                        read[path.name] = (about.st_ino, about.st_mtime_ns)
                except FileNotFoundError:
                    again = True
                    continue
                except pa.ArrowInvalid as error:
                    raise OSError(
                        f"{path}: is no longer a Parquet file ({error}); remove it, and its rows are computed again"
                    ) from None
                yield found

    def add(
        self, key: str, code: str, settings: Mapping[str, Any], values: Mapping[str, Any], arrays: Any, spent: Any
    ) -> None:
        """A row that has arrived. It outlives this process from the next `tick` on."""
        if arrays:
            self._write_arrays(key, arrays)
        row = {"key": key, "code": code, **settings, **values, **{TIME + name: value for name, value in spent.items()}}
        with naming(self.path):
            if self._journal is None:
                self._journal = open(self.path / f"journal-{self._next:08d}.jsonl", "a", encoding="utf-8")
            self._journal.write(json.dumps(row, ensure_ascii=False) + "\n")
        self._rows.append(row)

    def tick(self) -> None:
        """Hands lines over to the system; makes a part where it is time."""
        if self._journal is not None:
            with naming(self.path):
                self._journal.flush()
        if self._rows and (len(self._rows) >= PART_ROWS or time.monotonic() - self._since > PART_S):
            self.flush()

    def flush(self) -> None:
        """What has arrived becomes a part, and its journal goes."""
        journal, self._journal = self._journal, None
        if journal is not None:
            with naming(self.path):
                journal.close()
        if self._rows:
            self._write_part()
        if journal is not None:
            Path(journal.name).unlink(missing_ok=True)
        self._since = time.monotonic()
        small = (
            [path for path in self.parts if pq.read_metadata(path).num_rows < PART_ROWS / 2] if self._next % 8 == 0 else []
        )
        if len(small) >= _MANY:
            self._merge(small)

    def _write_part(self) -> None:
        rows, self._rows = self._rows, []
        if rows:
            self._put(columns.table(rows))

    def _put(self, part: pa.Table) -> None:
        path = self.path / "parts" / f"{self._next:08d}.parquet"
        write_table(part, path)
        self._next += 1

    def _merge(self, paths: list[Path]) -> None:
        """Small parts as one, which takes the place of the first: later rows stay later."""
        found = []
        for path in paths:
            with pq.ParquetFile(path) as file:
                found.append(file.read())
        write_table(columns.put_together(found), paths[-1])
        for path in paths[:-1]:
            path.unlink()

    def replace(self, kept: pa.Table) -> None:
        """These rows in the place of all parts."""
        before = self.parts
        if kept.num_rows:
            self._put(kept)
        for path in before:
            path.unlink()

    def _write_arrays(self, key: str, arrays: Mapping[str, np.ndarray]) -> None:
        import zarr

        root, beside = self.path / "arrays.zarr", self.path / "arrays.zarr" / f".{key}"
        with naming(root):
            if not (root / "zarr.json").exists():
                zarr.open_group(root, mode="a")
            shutil.rmtree(beside, ignore_errors=True)
            group = zarr.open_group(beside, mode="w")
            for name, values in arrays.items():
                group.create_array(name, data=np.ascontiguousarray(values))
            if (root / key).exists():
                shutil.rmtree(root / key)
            os.rename(beside, root / key)

    def reference(self, key: str) -> dict[str, Any] | None:
        """What was kept of a reference, None where it has to be computed."""
        path = self.path / "references" / f"{key}.npz"
        try:
            with open(path, "rb") as file, np.load(file) as data:
                about = json.loads(str(data["about"]))
                arrays = {name.removeprefix("a."): data[name] for name in data.files if name != "about"}
        except FileNotFoundError:
            return None
        except (ValueError, OSError, KeyError, EOFError, TypeError, zipfile.BadZipFile, zlib.error):  # it lost its end
            return None
        return about | {"arrays": arrays}

    def has_reference(self, key: str) -> bool:
        """Whether it is there and can be read."""
        return (self.path / "references" / f"{key}.npz").is_file() and self.reference(key) is not None

    def keep_reference(self, key: str, found: Mapping[str, Any]) -> None:
        about = json.dumps({name: value for name, value in found.items() if name != "arrays"})
        file = BytesIO()
        np.savez(file, about=np.array(about), **{f"a.{name}": value for name, value in found["arrays"].items()})
        with naming(self.path):
            (self.path / "references").mkdir(exist_ok=True)
        write_whole(self.path / "references" / f"{key}.npz", lambda out: out.write(file.getvalue()))

    def say(self, about: Mapping[str, Any]) -> None:
        """study.json."""
        write_text(self.path / "study.json", json.dumps({"format": FORMAT, **about}, indent=1) + "\n")


def write_table(found: pa.Table, path: Path) -> None:
    """A table to a Parquet file, whole or not at all."""
    file = BytesIO()
    pq.write_table(found, file, compression="zstd")
    write_whole(path, lambda out: out.write(file.getbuffer()))


def _lines(path: Path) -> Iterator[dict[str, Any]]:
    with open(path, encoding="utf-8", errors="replace") as file:
        for line in file:
            with contextlib.suppress(ValueError):
                row = json.loads(line)
                if line.endswith("\n") and isinstance(row, dict) and len(str(row.get("key", ""))) == 64:
                    yield row


def said(path: Path) -> dict[str, Any]:
    """study.json of a folder. Raises OSError or ValueError where it is no study's."""
    try:
        found = json.loads((path / "study.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: is not a study's folder: it has no study.json; check the name") from None
    except ValueError:
        raise ValueError(f"{path}: its study.json is not valid JSON; start the study again") from None
    if not isinstance(found, dict) or not isinstance(found.get("format", 0), int):
        raise ValueError(f"{path}: its study.json is not one of this program's; start the study again")
    if found.get("format", 0) > FORMAT:
        raise ValueError(f"{path}: was written by a newer version of this program; install that")
    return found


def is_locked(path: Path) -> bool:
    """Whether somebody is at work in the folder."""
    try:
        handle = os.open(path / "lock", os.O_RDWR)
    except OSError:
        return False
    try:
        return not taken(handle)
    finally:
        os.close(handle)


def journalled(path: Path) -> int:
    """Rows that have arrived and are in no part yet."""
    return sum(1 for each in path.glob("journal-*.jsonl") for _ in _lines(each))
