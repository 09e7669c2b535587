"""tools/wheel: what a wheel with the native library says of itself, where it runs, and that pip installs it.

`tools/wheel --check` tries one, in an environment of its own."""

from __future__ import annotations

import base64
import csv
import hashlib
import io
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from synth.jit import prebuilt
from synth.plugin import library as native_library
from tests.plugin import conftest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from wheels.needs import Needs, Unfit, needs, platform
from wheels.pack import INSIDE, with_library

library_file = conftest.library_file
NAME = "thing-1.0-py3-none-any.whl"
NATIVE = "libjawari.so"
PLACE = f"{INSIDE}/{NATIVE}"
RECORD = "thing-1.0.dist-info/RECORD"
FILES = {
    "thing/__init__.py": b"WHAT = 'a thing, with \xc3\xa4'\n",
    "thing-1.0.dist-info/METADATA": b"Metadata-Version: 2.1\nName: thing\nVersion: 1.0\n",
    "thing-1.0.dist-info/WHEEL": b"Wheel-Version: 1.0\nGenerator: us\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
}


def digest(data: bytes) -> str:
    return "sha256=" + base64.urlsafe_b64encode(hashlib.sha256(data).digest()).decode().rstrip("=")


@pytest.fixture
def wheel(tmp_path) -> Path:
    """A small one for any platform."""
    path = tmp_path / NAME
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in FILES.items():
            archive.writestr(name, data)
        rows = [f"{name},{digest(data)},{len(data)}\n" for name, data in FILES.items()]
        archive.writestr(RECORD, "".join(rows) + f"{RECORD},,\n")
    return path


# --- what is needed -------------------------------------------------------------------------------------------------------


def compiled(source: str, folder: Path, *flags: str) -> bytes:
    """A shared object of C's."""
    try:
        command = native_library.compiler()
    except native_library.BuildError as error:
        pytest.skip(str(error))
    code, made = folder / "code.c", folder / "made.so"
    code.write_text(source)
    subprocess.run([*command, "-shared", "-fPIC", "-o", str(made), str(code), *flags], check=True)
    return made.read_bytes()


def test_the_library_runs_with_c_libraries_of_some_age(library_file: Path) -> None:
    data = library_file.read_bytes()
    found = needs(data)
    assert "libc.so.6" in found.libraries
    assert {"GLIBC_2.2.5"} <= set(found.versions) and all(each.startswith("GLIBC_") for each in found.versions)
    _, major, minor, rest = platform(data).split("_", 3)
    assert rest == "x86_64" and major == "2" and f"GLIBC_2.{minor}" in found.versions
    assert not any(int(each.split(".")[1]) > int(minor) for each in found.versions)
    with_bank = native_library.with_bank(library_file, b"bank")
    assert platform(with_bank) == platform(data)


def test_the_newest_symbol_decides(tmp_path) -> None:
    old = '__asm__(".symver memcpy, memcpy@GLIBC_2.2.5");\n'
    use = "#include <string.h>\nvoid *volatile used; void use(void) { used = (void *)memcpy; }\n"
    assert platform(compiled(old + use, tmp_path)) == "manylinux_2_5_x86_64"
    assert platform(compiled(use, tmp_path)) == "manylinux_2_14_x86_64"


def test_another_library_is_too_much(tmp_path) -> None:
    with pytest.raises(Unfit, match=r"^needs libother\.so\.3, which some systems lack$"):
        compiled("int other(void) { return 3; }", tmp_path, "-Wl,-soname,libother.so.3")
        (tmp_path / "made.so").rename(tmp_path / "libother.so")
        flags = (f"-L{tmp_path}", "-Wl,--no-as-needed", "-lother")
        platform(compiled("int other(void); int use(void) { return other(); }", tmp_path, *flags))


def test_what_is_no_library_for_linux_is_refused(library_file: Path) -> None:
    data = library_file.read_bytes()
    for other in (b"", b"MZ", b"\x7fELF\x01\x01" + bytes(100), data[:18] + b"\x28\x00" + data[20:]):
        with pytest.raises(Unfit, match="is no shared object for Linux on x86-64 or arm64"):
            needs(other)


def test_a_damaged_one_is_refused_or_read(library_file: Path) -> None:
    data = library_file.read_bytes()
    for size in (20, 63, 64, 1000, len(data) // 2, len(data) - 100):
        with pytest.raises(Unfit, match="is a damaged shared object"):
            needs(data[:size])
    for at in range(0x10, 0x40):
        with_other = bytearray(data)
        with_other[at] ^= 0x55
        try:
            assert isinstance(needs(bytes(with_other)), Needs)
        except Unfit:
            continue


# --- what is packed -------------------------------------------------------------------------------------------------------


def test_all_is_in_it_and_recorded(wheel: Path, tmp_path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    before = wheel.read_bytes()
    made = with_library(wheel, NATIVE, b"the library", "manylinux_2_17_x86_64", out)
    assert made == out / "thing-1.0-py3-none-manylinux_2_17_x86_64.whl"
    assert list(out.iterdir()) == [made] and wheel.read_bytes() == before
    with zipfile.ZipFile(made) as archive:
        assert archive.testzip() is None
        names = archive.namelist()
        assert sorted(names) == sorted([*FILES, PLACE, RECORD]) and names[-1] == RECORD
        about = archive.read("thing-1.0.dist-info/WHEEL").decode().splitlines()
        assert {"Tag: py3-none-manylinux_2_17_x86_64", "Root-Is-Purelib: false"} < set(about)
        assert "Tag: py3-none-any" not in about and "Root-Is-Purelib: true" not in about
        rows = {name: tuple(rest) for name, *rest in csv.reader(io.StringIO(archive.read(RECORD).decode()))}
        assert rows.pop(RECORD) == ("", "")
        assert rows == {n: (digest(archive.read(n)), str(len(archive.read(n)))) for n in names if n != RECORD}
        assert archive.getinfo(PLACE).external_attr >> 16 == 0o100755


def test_the_same_gives_the_same_bytes(wheel: Path, tmp_path) -> None:
    made = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        made.append(with_library(wheel, NATIVE, b"the library", "manylinux_2_17_x86_64", tmp_path / name).read_bytes())
    assert made[0] == made[1]


def test_a_wheel_for_one_platform_is_refused(wheel: Path, tmp_path) -> None:
    made = with_library(wheel, NATIVE, b"the library", "manylinux_2_17_x86_64", tmp_path)
    with pytest.raises(ValueError, match="is not a wheel for any platform"):
        with_library(made, NATIVE, b"the library", "manylinux_2_17_x86_64", tmp_path)


@pytest.mark.skipif(sys.platform != "linux" or os.uname().machine != "x86_64", reason="it is for Linux on x86-64")
def test_pip_installs_it_where_the_program_looks_for_the_library(wheel: Path, library_file: Path, tmp_path) -> None:
    data = library_file.read_bytes()
    made = with_library(wheel, NATIVE, data, platform(data), tmp_path)
    pip = [sys.executable, "-m", "pip", "install", "-q", "--disable-pip-version-check", "--no-index", "--no-deps"]
    subprocess.run([*pip, "--target", str(tmp_path / "site"), str(made)], check=True)
    assert (tmp_path / "site" / PLACE).read_bytes() == data
    assert (tmp_path / "site" / "thing" / "__init__.py").read_bytes() == FILES["thing/__init__.py"]
    assert prebuilt.places()[0] == Path(prebuilt.__file__).parents[2] / PLACE
