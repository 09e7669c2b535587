"""A wheel of the sources, and the same with the native library in it."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import subprocess
import sys
import zipfile
from pathlib import Path

#: the folder in which the program looks for the library, `synth.jit.prebuilt`
INSIDE = "synth/plugin/lib"
_DATE = (2020, 2, 2, 0, 0, 0)  # as the wheel's other files: the same sources give the same bytes


def plain(root: Path, folder: Path) -> Path:
    """The wheel of a source tree, made in an empty folder; it needs the network or pip's cache for what builds it.

    Raises CalledProcessError where pip fails, which has said why.
    """
    command = [sys.executable, "-m", "pip", "wheel", "-qq", "--disable-pip-version-check", "--no-deps"]
    subprocess.run([*command, "--wheel-dir", str(folder), str(root)], check=True)
    (made,) = folder.glob("*.whl")
    return made


def with_library(wheel: Path, name: str, library: bytes, platform: str, folder: Path) -> Path:
    """A wheel for a platform with the library besides what a wheel for any platform holds; where it is then.

    name: the library's, without folder.  Raises ValueError for a wheel that is for one platform already, OSError.
    """
    if not wheel.name.endswith("-py3-none-any.whl"):
        raise ValueError(f"{wheel.name} is not a wheel for any platform (…-py3-none-any.whl)")
    made = folder / wheel.name.replace("-any.whl", f"-{platform}.whl")
    part = made.with_suffix(".part")
    inside = f"{INSIDE}/{name}"
    with zipfile.ZipFile(wheel) as old, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as new:
        records = next(name for name in old.namelist() if name.endswith(".dist-info/RECORD"))
        about = records.replace("RECORD", "WHEEL")
        changed = {
            about: old.read(about)
            .replace(b"Tag: py3-none-any", f"Tag: py3-none-{platform}".encode())
            .replace(b"Root-Is-Purelib: true", b"Root-Is-Purelib: false"),
            inside: library,
        }
        rows = [
            row for row in csv.reader(io.StringIO(old.read(records).decode())) if row and row[0] not in (*changed, records)
        ]
        for kept in old.infolist():
            if kept.filename not in (*changed, records):
                new.writestr(kept, old.read(kept), zipfile.ZIP_DEFLATED)
        for entry, data in changed.items():
            new.writestr(_entry(entry, 0o755 if entry == inside else 0o644), data)
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
            rows.append([entry, f"sha256={digest}", str(len(data))])
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([*rows, [records, "", ""]])
        new.writestr(_entry(records, 0o644), text.getvalue())
    part.replace(made)
    return made


def _entry(name: str, mode: int) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, _DATE)
    entry.external_attr = (0o100000 | mode) << 16
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry
