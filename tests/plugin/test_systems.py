"""The C part on every system: that it compiles and links there, asks for no system outside of the files for them, and plays
banks that are no files."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from synth.engine.engine import Engine
from synth.instrument.preset import load_preset
from synth.midi.events import EVENT, NOTE_ON
from synth.plugin import bankfile
from synth.plugin import library as native_library
from synth.plugin.c_sources import SOURCES, sources
from synth.plugin.emit import table_symbol
from synth.plugin.links import compiling
from synth.plugin.platforms import TARGETS, WEB, Target
from synth.plugin.wasmbank import with_own_bank
from tests.engine.kit import play

from .emulated import compiled, run, started
from .native import Bank, Library, Refused

EVERY = [*TARGETS.values(), WEB]
#: files that may ask for the system: those of systems, the declaration of what is exported, VST 3's own numbers
ASKING = {"jawari.h": {"_WIN32"}, "vst3_api.h": {"_WIN32"}, "system_linux.c": {"POSIX_SPAWN_SETSID"}}
#: what is asked for everywhere: the language, and whether formats can be checked
LANGUAGE = {"__cplusplus", "__GNUC__"}
#: what a DLL may need
OF_WINDOWS = re.compile(r"KERNEL32\.dll|api-ms-win-crt-.*\.dll|ucrtbase\.dll|msvcrt\.dll", re.IGNORECASE)
NOTES = [(0, 1, 0, 48, 100), (99, 1, 0, 43, 100)]


def _name(target: Target) -> str:
    return target.name


def _zig(target: Target) -> list[str]:
    command = native_library.zig(target)
    if command is None:
        pytest.skip("there is no compiler for other systems (pip install ziglang)")
    return command


def test_every_source_belongs_somewhere():
    used = {path for target in EVERY for path in sources(target) if target is not WEB}
    used |= set(sources(WEB, "clap"))
    assert used == set(SOURCES.glob("*.c"))


def test_a_page_has_no_more_than_the_engine():
    assert set(sources(WEB, "engine")) < set(sources(WEB, "clap"))
    assert not any(path.name.startswith(("clap", "plugin", "vst3", "lv2")) for path in sources(WEB, "engine"))


@pytest.mark.parametrize("path", sorted(SOURCES.glob("*.[ch]")), ids=lambda path: path.name)
def test_nothing_else_asks_for_the_system(path):
    asked = set()
    for condition in re.findall(r"^\s*#\s*(?:if|ifdef|ifndef|elif)\b(.*)$", path.read_text(encoding="utf-8"), re.MULTILINE):
        asked |= {word for word in re.findall(r"[A-Za-z_]\w*", condition) if word != "defined"}
    guard = f"JAWARI_{path.stem.removeprefix('jawari').upper()}_H".replace("__", "_")
    assert asked - LANGUAGE - {guard} <= ASKING.get(path.name, set())


@pytest.mark.slow
@pytest.mark.parametrize("target", EVERY, ids=_name)
def test_it_compiles_without_a_warning(target, tmp_path):
    command = [*_zig(target), *compiling(target), "-Werror", "-c", "-o", str(tmp_path / "x.o")]
    for source in sources(target, "clap" if target is WEB else "plugin"):
        done = subprocess.run([*command, str(source)], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, ""), source.name


def test_it_compiles_here_without_a_warning(tmp_path):
    target = TARGETS["linux-x86-64"]
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("gcc is not installed")
    command = [gcc, *compiling(target), "-Werror", "-fsyntax-only", *map(str, sources(target))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def _no_kernels(level: str, path: Path, target: Target) -> None:
    """An object with an empty table in the place of a level's."""
    source, symbol = path.with_suffix(".empty.c"), table_symbol(level)
    source.write_text(f'#include "core.h"\nextern const struct kernels {symbol};\nconst struct kernels {symbol} = {{0}};\n')
    command = [*_zig(target), "-fvisibility=hidden", f"-I{SOURCES}", "-c", "-o", str(path), str(source)]
    subprocess.run(command, check=True)


def _linked(target: Target, folder: Path, **more) -> Path:
    """A library without kernels."""
    _zig(target)
    return native_library.build(folder, target=target, command=_zig(target), kernels=_no_kernels, **more)


@pytest.mark.slow
def test_a_dll_needs_nothing_but_windows(tmp_path):
    lief = pytest.importorskip("lief", reason="reads DLLs (pip install lief)")
    library = lief.parse(str(_linked(TARGETS["windows-x86-64"], tmp_path)))
    assert [each.name for each in library.imports if not OF_WINDOWS.fullmatch(each.name)] == []
    given = {each.name for each in library.get_export().entries}
    assert {"clap_entry", "GetPluginFactory", "InitDll", "ExitDll", "lv2_descriptor", "jawari_open_bytes"} <= given
    assert not any(name.startswith(("jawari_system", "jawari_kernels_x86")) for name in given)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, target in TARGETS.items() if target.system == "macos"])
def test_a_library_of_macos_has_room_for_a_signature(tmp_path, name):
    lief = pytest.importorskip("lief", reason="reads Mach-O (pip install lief)")
    library = lief.parse(str(_linked(TARGETS[name], tmp_path)))
    assert {each.name for each in library.libraries} == {"@rpath/libjawari.dylib", "/usr/lib/libSystem.B.dylib"}
    begins = min(section.offset for section in library.sections if section.offset)
    assert begins - 32 - library.header.sizeof_cmds >= 0x400 - 32
    given = {each.name for each in library.exported_symbols}
    assert {"_clap_entry", "_GetPluginFactory", "_bundleEntry", "_bundleExit", "_lv2_descriptor", "_jawari_open"} <= given
    assert not any(each.startswith("_jawari_system") for each in given)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["engine", "clap"])
def test_a_module_for_the_web_asks_nothing_of_who_runs_it(tmp_path, kind):
    wasmtime = pytest.importorskip("wasmtime", reason="runs WebAssembly (pip install wasmtime)")
    module = wasmtime.Module.from_file(wasmtime.Engine(), str(_linked(WEB, tmp_path, kind=kind)))
    assert [(each.module, each.name) for each in module.imports] == []
    given = {each.name for each in module.exports}
    assert {"memory", "_initialize", "jawari_alloc", "jawari_free", "jawari_open_bytes", "jawari_process"} <= given
    assert ({"clap_entry", "malloc", "free", "__indirect_function_table"} <= given) == (kind == "clap")


@pytest.mark.slow
@pytest.mark.parametrize("source", ["clapplay.c", "playtake.c"])
@pytest.mark.parametrize("target", TARGETS.values(), ids=_name)
def test_players_for_other_systems_are_c_without_a_warning(tmp_path, source, target):
    assert compiled(source, target, tmp_path).exists()


@pytest.mark.slow
def test_a_module_for_the_web_holds_its_bank_in_memory(tmp_path):
    wasmtime = pytest.importorskip("wasmtime", reason="runs WebAssembly (pip install wasmtime)")
    plain = _linked(WEB, tmp_path).read_bytes()
    bank = bytes(range(256)) * 1000
    for module, told in ((plain, "there is no bank in this module"), (with_own_bank(plain, bank), "this library was built")):
        store = wasmtime.Store()
        exports = wasmtime.Instance(store, wasmtime.Module(store.engine, module), []).exports(store)
        exports["_initialize"](store)
        why, memory = exports["jawari_alloc"](store, 512), exports["memory"]
        assert exports["jawari_open_own"](store, why) == 0
        assert bytes(memory.read(store, why, why + 512)).decode().startswith(told)
    place = module.index(b"jawari-own-bank\0") + 16
    begin, size = (int.from_bytes(module[at : at + 4], "little") for at in (place, place + 4))
    assert begin % 64 == 0 and exports["jawari_alloc"](store, 10_000_000) > begin + size
    assert bytes(memory.read(store, begin, begin + size)) == bank
    with pytest.raises(ValueError, match="has one already"):
        with_own_bank(module, bank)


# --- the own bank, where nothing may stand behind the end of a library ---


@pytest.fixture(scope="module")
def own_bank(tmp_path_factory) -> Path:
    """A program that looks for its bank as libraries do on macOS."""
    folder = tmp_path_factory.mktemp("ownbank")
    text = (SOURCES / "system_macos.c").read_text(encoding="utf-8")
    found = re.search(r"^bool system_bank_beside\(.*?^}$", text, re.MULTILINE | re.DOTALL)
    assert found is not None
    beside = folder / "beside.c"
    beside.write_text(f'#include <stdio.h>\n#include <string.h>\n#include "system.h"\n{found[0]}\n', encoding="utf-8")
    command = [*native_library.compiler(), "-std=gnu11", f"-I{SOURCES}"]
    linux = folder / "linux.o"
    renamed = "-Dsystem_bank_beside=beside_on_linux"
    subprocess.run([*command, renamed, "-c", "-o", str(linux), str(SOURCES / "system_linux.c")], check=True)
    used = [Path(__file__).with_name("ownbank.c"), beside, linux, SOURCES / "bank_file.c", SOURCES / "system_posix.c"]
    subprocess.run([*command, "-o", str(folder / "program"), *map(str, used), "-lpthread", "-ldl"], check=True)
    return folder / "program"


def _said(program: Path) -> list[str]:
    return subprocess.run([str(program)], capture_output=True, text=True, check=True).stdout.split()


def test_a_bundle_has_its_bank_among_its_resources(own_bank, tmp_path):
    contents = tmp_path / "x.clap" / "Contents"
    for name in ("MacOS", "Resources"):
        (contents / name).mkdir(parents=True)
    program = Path(shutil.copy(own_bank, contents / "MacOS" / "x"))
    assert _said(program) == ["refused"]
    bank = contents / "Resources" / "bank.jawari"
    bank.write_bytes(b"JAWARIBK one")
    (contents / "MacOS" / "bank.jawari").write_bytes(b"JAWARIBK not")
    assert _said(program) == [str(bank), "JAWARIBK", "one"]


def test_a_bare_library_has_its_bank_beside_it(own_bank, tmp_path):
    program = Path(shutil.copy(own_bank, tmp_path / "x.dylib"))
    assert _said(program) == ["refused"]
    (tmp_path / "bank.jawari").write_bytes(b"JAWARIBK two")
    assert _said(program) == [str(tmp_path / "bank.jawari"), "JAWARIBK", "two"]


def test_what_stands_behind_its_end_counts_before_what_lies_beside(own_bank, tmp_path):
    (tmp_path / "bank.jawari").write_bytes(b"JAWARIBK two")
    program = tmp_path / "x.dylib"
    program.write_bytes(native_library.with_bank(own_bank, b"JAWARIBK own"))
    program.chmod(0o755)
    assert _said(program) == [str(program), "JAWARIBK", "own"]


# --- sound on other systems ---

FRAMES, RATE_HZ = 20000, 44100.0


@pytest.fixture(scope="module")
def two_notes(portable, bank_files) -> tuple[Path, np.ndarray]:
    """A bank, and two notes of it as portable kernels play them here."""
    loaded = Library(portable(TARGETS["linux-x86-64"]))
    played = loaded.open_bank(bank_files["fretted-bass"]).engine(threads=2).play(NOTES, FRAMES, FRAMES)
    assert loaded.processor(None) == b"portable" and np.abs(played).max() > 0.1
    return bank_files["fretted-bass"], played


@pytest.mark.slow
@pytest.mark.parametrize("name", ["windows-x86-64", "linux-arm64"])
@pytest.mark.parametrize("threads", ["1", "2"])
def test_a_plugin_sounds_on_another_system_bit_for_bit(portable, two_notes, tmp_path, name, threads):
    target = TARGETS[name]
    start = started(target)
    bank, expected = two_notes
    program = compiled("clapplay.c", target, tmp_path)
    (tmp_path / "bass.clap").write_bytes(native_library.with_bank(portable(target), bank.read_bytes()))
    (tmp_path / "events").write_text(f"0 on 0 48 {100 / 127}\n99 on 0 43 {100 / 127}\n", encoding="utf-8")
    settings = {"JAWARI_THREADS": threads, "WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all", "JAWARI_PYTHON": "0"}
    given = ["./bass.clap", str(RATE_HZ), str(FRAMES), "256", "events", "sound"]
    said = run([*start, str(program), *given], cwd=tmp_path, env=os.environ | settings)
    assert said.split()[0] == "org.jawari.fretted-bass"
    played = np.fromfile(tmp_path / "sound", np.float32).reshape(-1, 2)
    np.testing.assert_array_equal(played, expected.astype(np.float32))


def _there(
    target: Target, native: Path, bank: Path, notes: np.ndarray, frames: int, folder: Path, threads: int = 1
) -> np.ndarray:
    """(frames, 2) as a library of another system plays notes with a bank."""
    start, program = started(target), compiled("playtake.c", target, folder)
    notes.tofile(folder / "events")
    place, data = shutil.copy(native, folder), shutil.copy(bank, folder / "played.jawari")
    given = [f"./{Path(place).name}", Path(data).name, str(RATE_HZ), str(frames), "256", "events", "sound", str(threads)]
    settings = {"WINEPREFIX": str(folder / "wine"), "WINEDEBUG": "-all"}
    run([*start, str(program), *given], cwd=folder, env=os.environ | settings)
    return np.fromfile(folder / "sound").reshape(-1, 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["windows-x86-64", "linux-arm64"])
def test_without_contacts_fast_kernels_differ_by_rounding_alone(fast, library, tmp_path, name):
    """Three seconds of a harp's string: what no contact enlarges stays below 1e-6 of full scale."""
    target, frames = TARGETS[name], 3 * 44100
    started(target)  # skips before anything is built
    (tmp_path / "harp.jawari").write_bytes(bankfile.bank([load_preset("harp")], [RATE_HZ]))
    note = np.array([(0, NOTE_ON, 0, 48, 100, 0.0)], EVENT)
    there = _there(target, fast(target), tmp_path / "harp.jawari", note, frames, tmp_path)
    here = library.open_bank(tmp_path / "harp.jawari").engine().play(note, frames, 256)
    assert np.abs(here).max() > 0.05
    difference = np.abs(here - there).max()
    print(f"{name}: {difference:.2g}")
    assert difference < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["tanpura-light", "fretted-bass", "jawari-harp"])
def test_with_contacts_fast_kernels_play_on_arm_as_in_python(fast, bank_files, tmp_path, preset):
    """As far from here as rounding brings strings that touch and modes that are float32; by two threads."""
    target = TARGETS["linux-arm64"]
    started(target)  # skips before anything is built
    notes = np.array([(*note, 0.0) for note in NOTES], EVENT)
    there = _there(target, fast(target), bank_files[preset], notes, FRAMES, tmp_path, threads=2)
    engine = Engine([load_preset(preset)])
    engine.prepare(RATE_HZ)
    here = play(engine, NOTES, FRAMES)
    assert np.abs(here).max() > 0.01
    assert np.linalg.norm(here - there) < 1e-3 * np.linalg.norm(here)


@pytest.mark.slow
def test_a_module_for_the_web_sounds_bit_for_bit(portable, two_notes):
    wasmtime = pytest.importorskip("wasmtime", reason="runs WebAssembly (pip install wasmtime)")
    bank, expected = two_notes
    whole = with_own_bank(portable(WEB).read_bytes(), bank.read_bytes())
    store = wasmtime.Store()
    exports = wasmtime.Instance(store, wasmtime.Module(store.engine, whole), []).exports(store)
    exports["_initialize"](store)
    memory = exports["memory"]
    engine = exports["jawari_create"](store, exports["jawari_open_own"](store, 0), RATE_HZ, 2, 0)
    assert engine and exports["jawari_threads"](store, engine) == 1
    events = np.array([(*note, 0.0) for note in NOTES], EVENT).tobytes()
    sides = [exports["jawari_alloc"](store, 8 * FRAMES) for _ in range(2)]
    at = exports["jawari_alloc"](store, len(events))
    memory.write(store, events, at)
    exports["jawari_process"](store, engine, at, len(NOTES), FRAMES, *sides)
    for k, side in enumerate(sides):
        played = np.frombuffer(bytes(memory.read(store, side, side + 8 * FRAMES)))
        np.testing.assert_array_equal(played, expected[:, k])


# --- banks that are no files ---


class Bytes:
    """A copy of bytes on a border of 64, or beside one."""

    def __init__(self, data: bytes, beside: int = 0) -> None:
        self._room = np.zeros(len(data) + 128, np.uint8)
        begin = -self._room.ctypes.data % 64 + beside
        self._room[begin : begin + len(data)] = np.frombuffer(data, np.uint8)
        self.address, self.size = self._room.ctypes.data + begin, len(data)

    def open(self, library) -> Bank:
        """Raises Refused."""
        return Bank(library, library.told(library.open_bytes, ctypes.c_void_p(self.address), self.size))


def test_a_bank_of_bytes_plays_as_one_of_a_file(library, bank_files):
    kept = Bytes(bank_files["all"].read_bytes())
    one, other = library.open_bank(bank_files["all"]), kept.open(library)
    sounds = [each.engine(threads=2).play(NOTES, 6000) for each in (one, other)]
    assert np.abs(sounds[0]).max() > 0.01
    np.testing.assert_array_equal(*sounds)
    one.close()
    other.close()


@pytest.mark.parametrize(
    ("damage", "why"),
    [
        (lambda data: data[:100], "it was cut off"),
        (lambda data: data[: len(data) // 2], "it was cut off"),
        (lambda data: b"", "it was cut off"),
        (lambda data: b"x" + data[1:], "it does not begin like one"),
        (lambda data: data[:400] + bytes([data[400] ^ 1]) + data[401:], "its checksum is wrong"),
    ],
    ids=["no head", "half", "nothing", "begin", "a bit"],
)
def test_damaged_bytes_are_refused_with_a_reason(library, bank_files, damage, why):
    with pytest.raises(Refused, match=f"memory holds no bank that can be played: .*{why}"):
        Bytes(damage(bank_files["tanpura-light"].read_bytes())).open(library)


def test_damaged_sound_in_bytes_is_refused_where_it_is_to_be_played(library, bank_files):
    data = bytearray(bank_files["tanpura-light"].read_bytes())
    data[-1] ^= 1
    kept = Bytes(bytes(data))
    bank = kept.open(library)
    with pytest.raises(Refused, match="the checksum for 44100 Hz is wrong"):
        bank.engine()
    bank.close()


def test_bytes_beside_a_border_are_refused(library, bank_files):
    with pytest.raises(Refused, match="no bytes on a border of 64 were given"):
        Bytes(bank_files["tanpura-light"].read_bytes(), beside=8).open(library)
    with pytest.raises(Refused, match="no bytes on a border of 64 were given"):
        library.told(library.open_bytes, None, 0)
