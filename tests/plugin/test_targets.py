"""Plugins for other systems than this one: what lies where, what the files are, and that signatures hold.

Libraries of a few lines stand for the native one, and some bytes for a bank, but in the slow tests. The files of Windows and
macOS are read by the package lief, and signatures by code of this file's own, from Apple's cs_blobs.h.
"""

from __future__ import annotations

import fcntl
import hashlib
import importlib.util
import json
import plistlib
import re
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

import synth
from synth.cli import export as export_command
from synth.cli import main
from synth.instrument.preset import load_preset
from synth.jit import prebuilt
from synth.jit.kernel_cache import cache_folder
from synth.plugin import bankfile, bundle, library, macsign, shelf
from synth.plugin.description import describe
from synth.plugin.library import FOOT
from synth.plugin.platforms import PORTABLE, TARGETS, Target, host
from tests.patience import compiling_s

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from wheels.needs import platform
from wheels.pack import with_library

ZIG = pytest.mark.skipif(importlib.util.find_spec("ziglang") is None, reason="the package ziglang is not installed")
LIEF = pytest.mark.skipif(importlib.util.find_spec("lief") is None, reason="the package lief is not installed")
MACS = [name for name, target in TARGETS.items() if target.system == "macos"]
#: as the native library enters hosts, and what it says of itself
SOURCE = """
#ifdef _WIN32
#define OUT __declspec(dllexport)
#else
#define OUT __attribute__((visibility("default")))
#endif
OUT const char *jawari_kernels_version(void) { return "jawari-kernels:0123456789abcdef" + 15; }
OUT const int clap_entry[4] = {1, 2, 3, 4};
OUT void *GetPluginFactory(void) { return (void *)clap_entry; }
OUT const void *lv2_descriptor(unsigned index) { return index ? (void *)0 : clap_entry; }
"""
ENTRIES = {"clap_entry", "GetPluginFactory", "lv2_descriptor"}
BANK = b"JAWARIBK" + bytes(range(256)) * 40


@pytest.fixture(scope="session")
def natives() -> dict[str, Path]:
    """A small shared object for each target; kept beside the kernels."""
    folder = cache_folder().parent / f"targets-tests-{hashlib.sha256(SOURCE.encode()).hexdigest()[:16]}"
    folder.mkdir(parents=True, exist_ok=True)
    made = {}
    with open(folder / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        (folder / "small.c").write_text(SOURCE)
        for name, target in TARGETS.items():
            made[name] = folder / name / target.library
            made[name].parent.mkdir(exist_ok=True)
            if not made[name].exists():
                zig = [sys.executable, "-m", "ziglang", "cc", "-target", target.zig, "-shared", "-fPIC", "-O1", "-s"]
                part = made[name].with_name(f"new-{target.library}")
                subprocess.run([*zig, "-o", str(part), str(folder / "small.c")], check=True, timeout=compiling_s())
                part.rename(made[name])
    return made


class Here:
    """`synth export tanpura` in a folder of its own, with small libraries and a small bank."""

    def __init__(self, folder: Path, capsys) -> None:
        self.folder = folder
        self._capsys = capsys

    def __call__(self, *arguments: str, code: int = 0) -> str:
        """Standard output; with another exit code than 0 the one line on standard error."""
        try:
            ended = main(["export", "tanpura-light", *arguments])
        except SystemExit as end:
            ended = int(end.code or 0)
        said = self._capsys.readouterr()
        assert ended == code, said.err
        if code:
            assert said.err.rstrip().splitlines()[-1].startswith("synth"), said.err
        return said.err if code else said.out

    def files(self) -> dict[str, bytes]:
        return {str(p.relative_to(self.folder)): p.read_bytes() for p in sorted(self.folder.rglob("*")) if p.is_file()}


@pytest.fixture
def here(monkeypatch, tmp_path, capsys) -> Here:
    """Where libraries are some bytes."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.setenv("JAWARI_PYTHON", "0")
    monkeypatch.setattr(bankfile, "bank", lambda *a, **b: BANK)
    monkeypatch.setattr(shelf, "library_for", lambda target, bits, say: _some_bytes(tmp_path, target.library))
    return Here(folder, capsys)


def _some_bytes(folder: Path, name: str) -> Path:
    path = folder / name
    path.write_bytes(b"a library")
    return path


@pytest.fixture
def linked(here, natives, monkeypatch) -> Here:
    """Where libraries are small shared objects."""
    monkeypatch.setattr(shelf, "library_for", lambda target, bits, say: natives[target.name])
    return here


def holds(target: str) -> set[str]:
    """The files of a tanpura in all formats."""
    texts = {"tanpura-light.lv2/manifest.ttl", "tanpura-light.lv2/tanpura-light.ttl"}
    if target in MACS:
        bundled = ("Info.plist", "PkgInfo", "MacOS/tanpura-light", "Resources/bank.jawari", "_CodeSignature/CodeResources")
        beside = {"tanpura-light.lv2/tanpura-light.dylib", "tanpura-light.lv2/bank.jawari"}
        return texts | beside | {f"tanpura-light.{kind}/Contents/{each}" for kind in ("clap", "vst3") for each in bundled}
    if target == "windows-x86-64":
        return texts | {
            "tanpura-light.clap",
            "tanpura-light.vst3/Contents/x86_64-win/tanpura-light.vst3",
            "tanpura-light.lv2/tanpura-light.dll",
        }
    folder = {"linux-x86-64": "x86_64-linux", "linux-arm64": "aarch64-linux"}[target]
    return texts | {
        "tanpura-light.clap",
        f"tanpura-light.vst3/Contents/{folder}/tanpura-light.so",
        "tanpura-light.lv2/tanpura-light.so",
    }


# --- what lies where ------------------------------------------------------------------------------------------------------


@ZIG
@pytest.mark.parametrize("target", TARGETS)
def test_each_system_finds_its_files(linked: Here, target: str) -> None:
    told = json.loads(linked("-f", "all", "--target", target, "--json"))
    files = linked.files()
    assert set(files) == holds(target)
    assert told["paths"] == {target: {kind: f"tanpura-light.{kind}" for kind in bundle.FORMATS}}
    assert told["bank_bytes"] == len(BANK) and told["library_bytes"].keys() == {target}
    (named,) = re.findall(r"lv2:binary <([^>]+)>", files["tanpura-light.lv2/manifest.ttl"].decode())
    assert f"tanpura-light.lv2/{named}" in files
    for path in linked.folder.rglob("*"):
        code = path.suffix in (".so", ".dll", ".dylib", ".clap") or path.parent.name in ("MacOS", "x86_64-win")
        if path.is_file():
            assert path.stat().st_mode & 0o111 == (0o111 if code else 0), path


@ZIG
def test_the_bank_lies_behind_the_library_or_beside_it(linked: Here) -> None:
    linked("-f", "all", "--target", "all")
    for name, data in linked.files().items():
        if name.endswith((".so", ".dll")) or (name.count("/") == 1 and name.endswith(".clap")) or "-win/" in name:
            begin = int.from_bytes(data[-16:-8], "little")
            assert data[-8:] == FOOT and begin % 4096 == 0 and data[begin:-16] == BANK, name
        elif name.endswith("bank.jawari"):
            assert data == BANK, name
        else:
            assert FOOT not in data and BANK not in data, name


@ZIG
@pytest.mark.parametrize("target", TARGETS)
def test_what_is_large_is_written_once(linked: Here, target: str) -> None:
    linked("-f", "all", "--target", target)
    large = [path for path in linked.folder.rglob("*") if path.is_file() and BANK in path.read_bytes()]
    assert len(large) == 3 and len({path.stat().st_ino for path in large}) == 1


def test_several_targets_have_folders_of_their_names(here: Here) -> None:
    told = json.loads(here("-o", "mine.clap", "--target", "linux-arm64,windows-x86-64", "--target", "linux-arm64", "--json"))
    paths = {name: {"clap": f"{name}/mine.clap"} for name in ("linux-arm64", "windows-x86-64")}
    assert told["paths"] == paths and set(here.files()) == {f"{name}/mine.clap" for name in paths}
    out = here("-f", "clap", "--target", "linux-x86-64,linux-arm64", "--name", "other")
    assert "linux-x86-64/other.clap" in out and "linux-arm64/other.clap" in out


def test_another_target_takes_the_place_of_one(here: Here) -> None:
    for target in ("windows-x86-64", "linux-arm64"):
        here("-o", "t.vst3", "--target", target)
    assert set(here.files()) == {"t.vst3/Contents/aarch64-linux/t.so"}


def test_names_of_any_letters_on_macos(linked: Here) -> None:
    odd = "ṭāṇpūrā 弦"
    linked("-o", f"{odd}.vst3", "--target", "macos-arm64")
    contents = linked.folder / f"{odd}.vst3" / "Contents"
    assert plistlib.loads((contents / "Info.plist").read_bytes())["CFBundleExecutable"] == odd
    assert (contents / "MacOS" / odd).is_file()


# --- macOS ----------------------------------------------------------------------------------------------------------------


@ZIG
@pytest.mark.parametrize("kind", ["clap", "vst3"])
def test_a_bundle_says_what_it_is(linked: Here, kind: str) -> None:
    linked("-f", kind, "--target", "macos-arm64")
    contents = linked.folder / f"tanpura-light.{kind}" / "Contents"
    about = plistlib.loads((contents / "Info.plist").read_bytes())
    wanted = {
        "CFBundlePackageType": "BNDL",
        "CFBundleSignature": "????",
        "CFBundleExecutable": "tanpura-light",
        "CFBundleIdentifier": "org.jawari.tanpura-light",
        "CFBundleShortVersionString": synth.__version__,
        "CFBundleVersion": synth.__version__,
        "LSMinimumSystemVersion": "11.0",
        "NSHighResolutionCapable": True,
    }
    assert wanted.items() <= about.items()
    assert about["CFBundleName"] == load_preset("tanpura-light").title
    assert (contents / "PkgInfo").read_bytes() == b"BNDL????"
    assert (contents / "MacOS" / about["CFBundleExecutable"]).is_file()


def blobs_of(signature: bytes) -> dict[int, bytes]:
    """The parts of a signature by their slots: they follow each other, and nothing but zeros is behind."""
    magic, size, count = struct.unpack_from(">3I", signature)
    assert magic == 0xFADE0CC0 and size <= len(signature) < size + 16 and not any(signature[size:])
    found, at = {}, 12 + 8 * count
    for number in range(count):
        slot, begin = struct.unpack_from(">2I", signature, 12 + 8 * number)
        assert begin == at and slot not in found
        found[slot] = signature[begin : begin + struct.unpack_from(">I", signature, begin + 4)[0]]
        at += len(found[slot])
    assert at == size
    return found


def directory_of(blob: bytes) -> dict[str, Any]:
    """The numbers of a code directory."""
    names = "magic length version flags hashOffset identOffset nSpecialSlots nCodeSlots codeLimit".split()
    found: dict[str, Any] = dict(zip(names, struct.unpack_from(">9I", blob), strict=True))
    found |= zip(("hashSize", "hashType", "platform", "pageSize"), blob[36:40], strict=True)
    found |= zip(("spare2", "scatterOffset", "teamOffset", "spare3"), struct.unpack_from(">4I", blob, 40), strict=True)
    names = ["codeLimit64", "execSegBase", "execSegLimit", "execSegFlags"]
    return found | dict(zip(names, struct.unpack_from(">4Q", blob, 56), strict=True))


def check_signature(data: bytes, binary: Any, special: dict[int, bytes]) -> None:
    """That a file's signature holds. binary: the file as lief reads it; special: what is sealed by the slots 1, 3."""
    place = binary.code_signature
    begin, size = place.data_offset, place.data_size
    assert begin % 16 == 0 and begin + size == len(data)
    last, text = binary.get_segment("__LINKEDIT"), binary.get_segment("__TEXT")
    assert last.file_offset + last.file_size == len(data) and last.virtual_size % 16384 == 0
    assert last.file_size <= last.virtual_size and last.file_offset <= begin
    assert all(each.file_offset + each.file_size <= last.file_offset for each in binary.segments if each.name != last.name)
    commands = list(binary.commands)
    assert sum(each.command == place.command for each in commands) == 1
    assert binary.header.nb_cmds == len(commands) and binary.header.sizeof_cmds == sum(each.size for each in commands)
    assert 32 + binary.header.sizeof_cmds <= min(each.offset for each in binary.sections if each.offset)
    blobs = blobs_of(data[begin:])
    assert set(blobs) == {0, 2, 0x10000}
    assert blobs[2] == struct.pack(">3I", 0xFADE0C01, 12, 0) and blobs[0x10000] == struct.pack(">2I", 0xFADE0B01, 8)
    blob = blobs[0]
    of = directory_of(blob)
    assert (of["magic"], of["length"], of["version"], of["flags"]) == (0xFADE0C02, len(blob), 0x20400, 2)
    assert (of["hashSize"], of["hashType"], of["platform"], of["pageSize"]) == (32, 2, 0, 12)
    assert not any(of[name] for name in ("spare2", "scatterOffset", "teamOffset", "spare3", "codeLimit64", "execSegFlags"))
    assert of["codeLimit"] == begin and of["nCodeSlots"] == -(-begin // 4096)
    assert (of["execSegBase"], of["execSegLimit"]) == (text.file_offset, text.file_size)
    ident = blob[of["identOffset"] :].split(b"\0")[0]
    assert ident == b"org.jawari.tanpura-light" and of["identOffset"] == 88
    assert of["hashOffset"] == 88 + len(ident) + 1 + 32 * of["nSpecialSlots"]
    assert of["hashOffset"] + 32 * of["nCodeSlots"] == len(blob)
    sealed = special | {2: blobs[2]}
    assert of["nSpecialSlots"] == max(sealed)
    for slot in range(1, max(sealed) + 1):
        at = of["hashOffset"] - 32 * slot
        assert blob[at : at + 32] == (hashlib.sha256(sealed[slot]).digest() if slot in sealed else bytes(32)), slot
    for page in range(of["nCodeSlots"]):
        at = of["hashOffset"] + 32 * page
        assert blob[at : at + 32] == hashlib.sha256(data[4096 * page : min(4096 * (page + 1), begin)]).digest(), page


def rule_of(name: str, rules: dict[str, Any]) -> dict[str, Any]:
    """What the heaviest of the rules that a file's name fulfils says of it."""
    all_of = [({"weight": 1.0} if rule is True else rule) for pattern, rule in rules.items() if re.match(pattern, name)]
    return max(all_of, key=lambda rule: rule.get("weight", 1.0))


@ZIG
@LIEF
@pytest.mark.parametrize("target", MACS)
def test_signatures_hold(linked: Here, natives: dict[str, Path], target: str) -> None:
    import lief

    linked("-f", "all", "--target", target)
    before = lief.MachO.parse(list(natives[target].read_bytes())).at(0)
    for kind in bundle.FORMATS:
        path = (
            linked.folder
            / f"tanpura-light.{kind}"
            / ("tanpura-light.dylib" if kind == "lv2" else "Contents/MacOS/tanpura-light")
        )
        data = path.read_bytes()
        binary = lief.MachO.parse(list(data)).at(0)
        assert lief.MachO.check_layout(binary) == (True, "")
        assert read_back(path, target) == read_back(natives[target], target) and read_back(path, target)[0] >= ENTRIES
        for section in before.sections:  # all but the header is as it was
            now = binary.get_section(section.segment_name, section.name)
            assert (now.offset, bytes(now.content)) == (section.offset, bytes(section.content))
        special = {}
        if kind != "lv2":
            contents = path.parents[1]
            seal = (contents / "_CodeSignature" / "CodeResources").read_bytes()
            special = {1: (contents / "Info.plist").read_bytes(), 3: seal}
            check_seal(contents, plistlib.loads(seal))
        check_signature(data, binary, special)


def read_back(path: Path, target: str) -> tuple[set[str], set[str]]:
    """The functions of a shared object that others may call, and the libraries that it asks for, as lief reads them."""
    import lief

    data = list(path.read_bytes())
    system = TARGETS[target].system
    if system == "windows":
        dll = lief.PE.parse(data)
        assert dll.header.machine == lief.PE.Header.MACHINE_TYPES.AMD64
        assert lief.PE.Header.CHARACTERISTICS.DLL in dll.header.characteristics_list
        return {each.name for each in dll.get_export().entries}, {each.name.lower() for each in dll.imports}
    if system == "macos":
        dylib = lief.MachO.parse(data).at(0)
        wanted = lief.MachO.Header.CPU_TYPE.ARM64 if target == "macos-arm64" else lief.MachO.Header.CPU_TYPE.X86_64
        assert dylib.header.cpu_type == wanted and dylib.header.file_type == lief.MachO.Header.FILE_TYPE.DYLIB
        others = {each.name for each in dylib.libraries if each.command != lief.MachO.LoadCommand.TYPE.ID_DYLIB}
        return {each.name.removeprefix("_") for each in dylib.exported_symbols}, others
    shared = lief.ELF.parse(data)
    arm, intel = lief.ELF.ARCH.AARCH64, lief.ELF.ARCH.X86_64
    assert shared.header.machine_type == (arm if TARGETS[target].processor == "arm64" else intel)
    return {each.name for each in shared.exported_symbols}, {str(each) for each in shared.libraries}


def check_seal(contents: Path, seal: dict[str, Any]) -> None:
    """That each file of a bundle is sealed, or left out by a rule."""
    for path in contents.rglob("*"):
        name = str(path.relative_to(contents))
        if path.is_dir() or name == "_CodeSignature/CodeResources":
            continue
        rule = rule_of(name, seal["rules2"])
        if rule.get("omit") or name == "MacOS/tanpura-light":  # which bears the signature
            assert name not in seal["files2"]
            continue
        assert not rule.get("nested") and seal["files2"][name] == {"hash2": hashlib.sha256(path.read_bytes()).digest()}
        assert seal["files"][name] == hashlib.sha1(path.read_bytes()).digest()
    assert set(seal["files2"]) == set(seal["files"]) == {"Resources/bank.jawari"}


@ZIG
@pytest.mark.skipif(importlib.util.find_spec("apple_platform") is None, reason="apple-platform-py is not installed")
@pytest.mark.parametrize("target", MACS)
def test_others_sign_the_same(linked: Here, natives: dict[str, Path], target: str) -> None:
    """apple-platform-rs, which signs without Apple's tools too, seals the same files and makes the same code directory; it
    leaves more room behind, which the load commands tell."""
    from apple_platform import reading, signing

    linked("-f", "clap", "--target", target)
    bare, theirs = linked.folder / "bare.clap", linked.folder / "theirs.clap"
    shutil.copytree(linked.folder / "tanpura-light.clap", bare)
    shutil.rmtree(bare / "Contents" / "_CodeSignature")
    shutil.copy(natives[target], bare / "Contents" / "MacOS" / "tanpura-light")
    signing.sign(bare, theirs)
    read, seals = [], []
    for path in (linked.folder / "tanpura-light.clap", theirs):
        (found,) = reading.find_entities(reading.read_signature(path), "mach_o")
        about = found["signature"]["code_directory"]
        sealed = [each for each in about.pop("slot_digests") if not each.startswith("Resources")]  # of another layout
        blobs = [(each["slot"], each["magic"], each["length"]) for each in found["signature"]["blobs"]]
        read.append((about, sealed, blobs, found["macho_signature_start_offset"]))
        seals.append(plistlib.loads((path / "Contents" / "_CodeSignature" / "CodeResources").read_bytes()))
    assert read[0] == read[1] and seals[0] == seals[1]


@ZIG
@pytest.mark.parametrize("target", MACS)
def test_a_signature_takes_the_place_of_another(natives: dict[str, Path], target: str) -> None:
    data = natives[target].read_bytes()
    once = macsign.sign(data, "org.jawari.x", b"info", b"seal")
    assert macsign.sign(once, "org.jawari.x", b"info", b"seal") == once
    assert macsign.sign(macsign.sign(data, "org.jawari.a-longer-name"), "org.jawari.x", b"info", b"seal") == once


def small_macho(room: int = 64, behind: bytes = b"") -> bytes:
    """A Mach-O file of a segment with a section, and one for what links it."""
    size = 2 * 72 + 80
    first = 32 + size + room
    head = struct.pack("<8I", 0xFEEDFACF, 0x100000C, 0, 6, 2, size, 0, 0)
    text = struct.pack("<2I16s4Q4I", 0x19, 152, b"__TEXT", 0, 16384, 0, 16384, 5, 5, 1, 0)
    section = struct.pack("<16s16s2Q8I", b"__text", b"__TEXT", first, 16, first, 4, 0, 0, 0, 0, 0, 0)
    links = struct.pack("<2I16s4Q4I", 0x19, 72, b"__LINKEDIT", 16384, 16384, 16384, 32, 1, 1, 0, 0)
    return (head + text + section + links).ljust(16384, b"\0") + b"links".ljust(32, b"\0") + behind


def test_a_library_that_cannot_be_signed_is_told_and_nothing_is_written(here: Here) -> None:
    (here.folder / "t.vst3").mkdir()
    said = here("-o", "t.vst3", "--target", "macos-arm64", code=2)
    assert "libjawari.dylib is a damaged Mach-O file" in said and "delete it" in said and here.files() == {}


def test_what_has_no_place_for_a_signature_is_refused() -> None:
    assert len(macsign.sign(small_macho(16), "x")) > len(small_macho())
    for data, why in [
        (small_macho(8), "no room"),
        (small_macho(behind=b"bank"), "does not end with its __LINKEDIT segment"),
        (b"\xca\xfe\xba\xbe" + small_macho()[4:], "of one 64-bit processor"),
        (b"\xce\xfa\xed\xfe" + small_macho()[4:], "of one 64-bit processor"),
    ]:
        with pytest.raises(macsign.Unsignable, match=why):
            macsign.sign(data, "x")
    whole = small_macho()
    for length in (0, 3, 20, 31, 40, 200, 16384, len(whole) - 1):
        with pytest.raises(macsign.Unsignable):
            macsign.sign(whole[:length], "x")


# --- Windows and ARM ------------------------------------------------------------------------------------------------------


@ZIG
@LIEF
@pytest.mark.parametrize("target", [name for name in TARGETS if name not in MACS])
def test_hosts_can_enter_a_plugin(linked: Here, target: str) -> None:
    linked("-f", "all", "--target", target)
    found = [path for path in linked.folder.rglob("*") if path.is_file() and path.suffix != ".ttl"]
    assert len(found) == 3 and all(read_back(path, target)[0] >= ENTRIES for path in found)


@pytest.mark.slow
@ZIG
@LIEF
@pytest.mark.parametrize("target", TARGETS)
def test_the_native_library_is_for_every_system(fast, target: str, tmp_path) -> None:
    """That of the sources; what it asks for is there on every system of its kind."""
    check_library(fast(TARGETS[target]), TARGETS[target], tmp_path)


def check_library(native: Path, target: Target, folder: Path) -> None:
    """That a native library and the plugins made of it, in a folder, are what their system takes."""
    import lief

    system = target.system
    own = {"windows": {"InitDll", "ExitDll"}, "macos": {"bundleEntry", "bundleExit"}, "linux": {"ModuleEntry", "ModuleExit"}}
    entries, asked = read_back(native, target.name)
    assert entries >= ENTRIES | own[system]
    if system == "windows":
        assert all(each == "kernel32.dll" or each.startswith("api-ms-win-crt-") for each in asked), asked
    elif system == "macos":
        assert asked == {"/usr/lib/libSystem.B.dylib"}
    else:
        assert target == host() or platform(native.read_bytes()) == "manylinux_2_17_aarch64"
    description = describe([load_preset("tanpura-light")])
    plugins = bundle.Plugins(native, BANK, description, target)
    for kind in bundle.FORMATS:
        path = plugins.write(kind, folder / f"tanpura-light.{kind}")
        assert read_back(path, target.name) == (entries, asked)
        if system == "macos":
            contents = path.parents[1]
            special = {}
            if kind != "lv2":
                seal = (contents / "_CodeSignature" / "CodeResources").read_bytes()
                special = {1: (contents / "Info.plist").read_bytes(), 3: seal}
            check_signature(path.read_bytes(), lief.MachO.parse(list(path.read_bytes())).at(0), special)


# --- what cannot be -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["-f", "clap", "--target", "amiga"], "--target: must be linux-x86-64, linux-arm64, windows-x86-64"),
        (["-f", "clap", "--target", "linux-arm64,"], "or all, got ''"),
        (["--install", "--target", "macos-arm64"], "cannot run macos-arm64: leave --install out"),
        (["--install", "--target", "all"], "--install puts plugins where this machine's music programs look"),
        (["-o", "nowhere/x.clap", "--target", "linux-arm64,windows-x86-64"], "there is no directory nowhere"),
        (["-o", "file.clap", "--target", "macos-arm64"], "a plugin of the format clap is a folder on macOS"),
        (["-o", "folder.clap", "--target", "windows-x86-64"], "folder.clap: is a directory"),
        (["-o", "folder.clap", "--target", "macos-arm64"], "folder.clap: holds mine, which does not belong"),
        (["-f", "clap", "--bits", "some"], "--bits: invalid choice: 'some'"),
        (["--target", "windows-x86-64"], "the format of the plugin is missing"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_written(here: Here, arguments: list[str], says: str) -> None:
    if host() is None:
        pytest.skip("this machine is no target")
    (here.folder / "file.clap").write_bytes(b"a file")
    (here.folder / "folder.clap").mkdir()
    (here.folder / "folder.clap" / "mine").write_bytes(b"mine")
    before = here.files()
    assert says in here(*arguments, code=2)
    assert here.files() == before


def test_a_machine_that_is_no_target_names_one(here: Here, monkeypatch) -> None:
    monkeypatch.setattr(export_command, "host", lambda: None)
    assert "this machine is none of linux-x86-64" in here("-f", "clap", code=2)
    here("-f", "clap", "--target", "linux-x86-64")


# --- libraries that are at hand -------------------------------------------------------------------------------------------


@pytest.fixture
def cache(monkeypatch, tmp_path) -> Path:
    """The user's cache, which is empty; nothing lies with the package."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.delenv("JAWARI_NATIVE", raising=False)
    package = tmp_path / "package" / "jit" / "prebuilt.py"
    package.parent.mkdir(parents=True)
    package.touch()
    monkeypatch.setattr(prebuilt, "__file__", str(package))
    return tmp_path / "cache" / "jawari"


@pytest.fixture
def built(monkeypatch) -> list[tuple]:
    """What is built, in the place of a compiler: targets and levels."""
    asked = []

    def build(folder: Path, target, levels, kind=None, say=None) -> Path:
        asked.append((target.name, tuple(levels)))
        if say is not None:
            say("kernels")
        path = folder / target.library
        path.write_bytes(b"jawari-sources:" + library.sources_version().encode() + b"\0" + target.name.encode())
        return path

    monkeypatch.setattr(library, "build", build)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: object())
    return asked


def test_a_library_is_built_once_for_each_target_and_kind(cache: Path, built: list[tuple]) -> None:
    foreign = [target for target in TARGETS.values() if target != host()]
    told: list[str] = []
    for _ in range(2):
        for target in foreign:
            path = shelf.library_for(target, "fast", told.append)
            assert path.parts[-2:] == (target.name, target.library) and path.is_relative_to(cache)
            path = shelf.library_for(target, "portable", told.append)
            assert path.parts[-3:] == ("portable", target.name, target.library)
    assert built == [each for target in foreign for each in [(target.name, target.levels), (target.name, PORTABLE)]]
    assert told[0] == f"building the native library for {foreign[0].name}, once on this machine: kernels"
    assert told[1].startswith(f"building the portable native library for {foreign[0].name}, once")
    assert [path.name for path in cache.iterdir()] == [prebuilt.folders()[-1].name]


def test_the_portable_library_of_this_machine_is_another(cache: Path, built: list[tuple], monkeypatch) -> None:
    here = host()
    if here is None:
        pytest.skip("this machine is no target")
    monkeypatch.setenv("JAWARI_NATIVE", "/named/for/this/machine.so")
    path = shelf.library_for(here, "portable")
    assert path.parts[-3:-1] == ("portable", here.name) and built == [(here.name, PORTABLE)]


def test_one_that_came_with_the_package_is_taken(cache: Path, built: list[tuple]) -> None:
    target = TARGETS["windows-x86-64"]
    path = prebuilt.folders()[0] / target.name / target.library
    path.parent.mkdir(parents=True)
    path.write_bytes(b"jawari-sources:" + library.sources_version().encode() + b"\0")
    assert shelf.library_for(target) == path and built == []
    path.write_bytes(b"jawari-sources:others\0")
    assert shelf.library_for(target) != path and len(built) == 1


def test_without_ziglang_it_says_what_to_install(cache: Path, monkeypatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for target in TARGETS.values():
        if target != host():
            with pytest.raises(library.BuildError, match=re.escape("pip install 'jawari[targets]'")):
                shelf.library_for(target)
    assert not cache.exists()


@ZIG
@pytest.mark.parametrize("target", TARGETS)
def test_a_library_without_its_end_is_not_run(natives: dict[str, Path], target: str, tmp_path) -> None:
    data = natives[target].read_bytes()
    path = tmp_path / natives[target].name
    path.write_bytes(data)
    assert prebuilt.unfit(path) == ""
    path.write_bytes(data[:-1] if target in MACS else data[: len(data) * 9 // 10])
    assert prebuilt.unfit(path) == f"{path} has lost its end"


def test_windows_has_no_modes_that_tell_who_may_write(monkeypatch, tmp_path) -> None:
    path = tmp_path / "jawari.dll"
    path.write_bytes(b"MZ")
    path.chmod(0o666)
    monkeypatch.delenv("JAWARI_NATIVE", raising=False)
    assert prebuilt.unfit(path) == f"{path} can be written by anybody"
    monkeypatch.delattr("os.getuid")
    assert prebuilt.unfit(path) == ""


@pytest.mark.parametrize("name, system", [("linux-x86-64", "linux"), ("windows-x86-64", "win32"), ("macos-arm64", "darwin")])
def test_each_system_looks_for_its_own_library(name: str, system: str, monkeypatch) -> None:
    monkeypatch.setattr(sys, "platform", system)
    spec = importlib.util.spec_from_file_location("another_prebuilt", prebuilt.__file__)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.NAME == TARGETS[name].library


def test_arm_takes_a_library_for_arm(monkeypatch) -> None:
    from llvmlite import binding

    for triple in ("aarch64-unknown-linux-gnu", "arm64-apple-darwin23.1.0"):
        monkeypatch.setattr(binding, "get_process_triple", lambda triple=triple: triple)
        assert (prebuilt.compiled_for(),) == TARGETS["linux-arm64"].levels == TARGETS["macos-arm64"].levels
    monkeypatch.setattr(binding, "get_process_triple", lambda: "riscv64-unknown-linux-gnu")
    assert prebuilt.compiled_for() is None


# --- wheels ---------------------------------------------------------------------------------------------------------------


@ZIG
@pytest.mark.parametrize(
    "target, tag",
    [
        ("linux-x86-64", "manylinux_2_5_x86_64"),
        ("linux-arm64", "manylinux_2_17_aarch64"),
        ("windows-x86-64", "win_amd64"),
        ("macos-arm64", "macosx_11_0_arm64"),
        ("macos-x86-64", "macosx_11_0_x86_64"),
    ],
)
def test_a_wheel_is_for_the_systems_of_its_library(natives: dict[str, Path], target: str, tag: str, tmp_path) -> None:
    data = natives[target].read_bytes()
    assert (TARGETS[target].wheel or platform(data)) == tag
    bare = tmp_path / "thing-1.0-py3-none-any.whl"
    with zipfile.ZipFile(bare, "w") as archive:
        archive.writestr("thing-1.0.dist-info/WHEEL", "Root-Is-Purelib: true\nTag: py3-none-any\n")
        archive.writestr("thing-1.0.dist-info/RECORD", "")
    made = with_library(bare, TARGETS[target].library, data, tag, tmp_path)
    assert made.name == f"thing-1.0-py3-none-{tag}.whl"
    with zipfile.ZipFile(made) as archive:
        inside = f"synth/plugin/lib/{TARGETS[target].library}"
        assert archive.read(inside) == data and archive.getinfo(inside).external_attr >> 16 == 0o100755
        assert f"Tag: py3-none-{tag}" in archive.read("thing-1.0.dist-info/WHEEL").decode().splitlines()
        assert inside in archive.read("thing-1.0.dist-info/RECORD").decode()


def test_the_command_knows_what_there_is() -> None:
    assert set(TARGETS) == {
        f"{system}-{processor}"
        for system, processors in {"linux": "x86-64 arm64", "windows": "x86-64", "macos": "arm64 x86-64"}.items()
        for processor in processors.split()
    }
    assert export_command.BITS == shelf.BITS and export_command.FORMATS == bundle.FORMATS
