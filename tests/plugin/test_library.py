"""The library as others get it: what it needs and shows, where it runs, and that a block allocates and locks nothing."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from synth.jit.kernel_sources import sources_id
from synth.plugin import emit, retarget
from synth.plugin import library as native_library
from synth.plugin.library import EXPORTED, BuildError, version_of
from synth.plugin.platforms import TARGETS

ROOT = Path(__file__).resolve().parents[2]
#: of the C library and libm; who adds one looks whether a block may call it
KNOWN = set(
    """
    bcmp calloc ceil clock_gettime close cos dladdr eventfd exp exp2 expm1 floor fmax fmin fputc free fstat getenv
    llrint llround log log10 log2 lrint malloc memchr memcmp memcpy memmove memset mmap munmap nanosleep open
    posix_memalign pow pread
    pthread_attr_destroy pthread_attr_init pthread_attr_setinheritsched pthread_attr_setstacksize
    pthread_create pthread_join pthread_mutex_lock pthread_mutex_unlock
    pthread_sigmask read realloc realpath round sched_getaffinity sched_yield sigfillset sin sincos snprintf
    sqrt stderr strcmp strcpy strerror strlen strncmp strspn strtol sysconf vfprintf vsnprintf write
    """.split()
)
#: the same, of what starts Python for another setup, which no block does
KNOWN |= set(
    """
    access atoi clock_gettime dlsym fcntl geteuid kill pipe2 poll posix_spawn posix_spawn_file_actions_adddup2
    posix_spawn_file_actions_destroy posix_spawn_file_actions_init posix_spawnattr_destroy posix_spawnattr_init
    posix_spawnattr_setflags posix_spawnattr_setsigdefault posix_spawnattr_setsigmask secure_getenv sigemptyset stat
    strchr strrchr strstr waitid waitpid
    """.split()
)
#: of the compiler's own
ALLOWED = {"__gmon_start__", "_ITM_deregisterTMCloneTable", "_ITM_registerTMCloneTable", "__cxa_finalize"}


def symbols(path: Path) -> tuple[set[str], set[str]]:
    """Names that a shared object needs of others, and those that it gives."""
    elf = path.read_bytes()
    assert elf[:6] == b"\x7fELF\x02\x01"
    sections_at, size, count = int.from_bytes(elf[40:48], "little"), 64, int.from_bytes(elf[60:62], "little")
    sections = [elf[sections_at + k * size : sections_at + (k + 1) * size] for k in range(count)]

    def number(section: bytes, at: int, width: int = 8) -> int:
        return int.from_bytes(section[at : at + width], "little")

    dynamic = next(each for each in sections if number(each, 4, 4) == 11)  # SHT_DYNSYM
    strings = sections[number(dynamic, 40, 4)]
    text = elf[number(strings, 24) : number(strings, 24) + number(strings, 32)]
    needed, given = set(), set()
    for at in range(number(dynamic, 24) + 24, number(dynamic, 24) + number(dynamic, 32), 24):
        name = number(elf[at : at + 24], 0, 4)
        word = text[name : text.index(b"\0", name)].decode()
        (needed if number(elf[at : at + 24], 6, 2) == 0 else given).add(word)
    return needed, given


def test_it_needs_the_c_library_and_nothing_else(library_file):
    needed, _ = symbols(library_file)
    strange = {name for name in needed - ALLOWED if name not in KNOWN and not name.startswith("__")}
    assert strange == set()
    assert not any(name.startswith(("Py", "_Py", "NRT", "numba")) for name in needed)


def test_it_shows_its_interface_and_nothing_else(library_file):
    _, given = symbols(library_file)
    allowed = {name for name in EXPORTED if "*" not in name}
    assert {name for name in given if not name.startswith("jawari_")} <= allowed
    header = (native_library.SOURCES / "jawari.h").read_text()
    for name in given:
        assert name in allowed or f"{name}(" in header, name


def test_no_path_of_this_machine_is_in_it(library_file):
    data = library_file.read_bytes()
    assert str(ROOT).encode() not in data and b"site-packages" not in data


def test_it_knows_its_versions(library, library_file):
    assert library.kernels_version().decode() == version_of(library_file) == sources_id()
    assert library.processor(None).decode() in emit.LEVELS


def test_every_kernel_is_found_by_name(library):
    names = emit.names()
    assert "engine.process:process" in names and "engine.tasks:work_on" in names
    assert all(library.kernel(name.encode()) for name in names)
    assert not library.kernel(b"engine.process:nothing") and not library.kernel(None)
    padded = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)(library.kernel(b"solver.lanes:padded"))
    assert [padded(n) for n in (1, 8, 9)] == [8, 8, 16]


def test_plugins_that_a_host_loads_for_all_to_see_keep_their_own(library_file, bank_files, tmp_path):
    program = """
import ctypes, sys
for path in sys.argv[1:]:
    plugin = ctypes.CDLL(path, mode=ctypes.RTLD_GLOBAL)
    plugin.lv2_descriptor.restype = ctypes.c_void_p
    print(ctypes.c_char_p.from_address(plugin.lv2_descriptor(0)).value.decode())
"""
    names = ("tanpura-light", "jawari-harp")
    for name in names:
        whole = native_library.with_bank(library_file, bank_files[name].read_bytes())
        (tmp_path / name).write_bytes(whole)
    command = [sys.executable, "-c", program, *(str(tmp_path / name) for name in names)]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert told == [f"urn:jawari:{name}" for name in names]


def test_a_level_that_there_is_not():
    with pytest.raises(ValueError, match="no level 'x86-64-v9'"):
        emit.emit("x86-64-v9", Path("never"))


def test_what_is_of_x86_alone_is_written_anew_for_aarch64():
    """That it plays there `test_systems.py` shows."""
    head = 'target datalayout = "e-m:e-i64:64-n8:16:32:64-S128"\ntarget triple = "x86_64-unknown-linux-gnu"\n'
    waits = "declare void @llvm.x86.sse2.pause()\ndefine void @wait() {\n  call void @llvm.x86.sse2.pause()\n  ret void\n}\n"
    arm = TARGETS["linux-arm64"]
    assert retarget.object_of(head + waits, "aarch64", arm)[18:20] == (183).to_bytes(2, "little")  # EM_AARCH64
    with pytest.raises(ValueError, match=r"use llvm\.x86\.rdtsc\b"):
        retarget.object_of(head + waits.replace("sse2.pause", "rdtsc"), "aarch64", arm)
    with pytest.raises(ValueError, match="linux-arm64 has no level x86-64-v3; use aarch64 or portable"):
        retarget.object_of(head + waits, "x86-64-v3", arm)


def test_without_a_compiler_it_says_what_helps(monkeypatch):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(native_library.shutil, "which", lambda name: None)
    monkeypatch.setattr(native_library.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(BuildError, match="pip install ziglang"):
        native_library.compiler()


_PLAY = """
    import sys
    from pathlib import Path
    import numpy as np
    from tests.plugin.native import Library
    library = Library(Path(sys.argv[1]))
    engine = library.open_bank(Path(sys.argv[2])).engine()
    np.save(sys.argv[3], engine.play([(0, 1, 0, 48, 100), (99, 1, 0, 43, 100)], 20000))
    print(library.processor(None).decode())
"""


@pytest.mark.parametrize("level", emit.LEVELS)
def test_both_levels_sound_the_same_but_for_rounding(library, library_file, bank_files, tmp_path, level):
    """The kernels are those of the level that is asked for, and play what the others play, modes being float32: e stays a
    hundredth of what the quality promises."""
    script = [
        sys.executable,
        "-c",
        textwrap.dedent(_PLAY),
        str(library_file),
        str(bank_files["tanpura-light"]),
        str(tmp_path / "x.npy"),
    ]
    done = subprocess.run(
        script, cwd=ROOT, env=os.environ | {"JAWARI_LEVEL": level}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == min(level, library.processor(None).decode())
    here = library.open_bank(bank_files["tanpura-light"]).engine().play([(0, 1, 0, 48, 100), (99, 1, 0, 43, 100)], 20000)
    assert np.linalg.norm(np.load(tmp_path / "x.npy") - here) < 1e-3 * np.linalg.norm(here)
    assert np.abs(here).max() > 0.01


def test_an_older_processor_is_refused_in_a_sentence(library_file, bank_files, tmp_path):
    script = [
        sys.executable,
        "-c",
        textwrap.dedent(_PLAY),
        *map(str, (library_file, bank_files["tanpura-light"], tmp_path / "x.npy")),
    ]
    done = subprocess.run(script, cwd=ROOT, env=os.environ | {"JAWARI_LEVEL": "x86-64-v2"}, capture_output=True, text=True)
    assert done.returncode == 1
    assert "Refused: this processor lacks what the sound is computed with (AVX2 and FMA" in done.stderr


# --- what a block does ---


def test_a_block_allocates_locks_and_opens_nothing(library_file, bank_files, tmp_path):
    """Counted by functions in the place of the C library's, in a program that has no Python."""
    source, program = Path(__file__).with_name("blockcalls.c"), tmp_path / "blockcalls"
    linked = [str(library_file), f"-Wl,-rpath,{library_file.parent}", "-ldl", "-lpthread", "-lm"]
    include = f"-I{native_library.SOURCES}"
    made = [
        *native_library.compiler(),
        "-std=gnu11",
        "-O1",
        "-fno-builtin",
        include,
        "-o",
        str(program),
        str(source),
        *linked,
    ]
    built = subprocess.run(made, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    done = subprocess.run([str(program), str(bank_files["all"])], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "0 2 1\n"), (done.stdout, done.stderr)


def test_the_header_is_c_and_c_plus_plus(tmp_path):
    source = tmp_path / "x.c"
    source.write_text('#include "jawari.h"\nint main(void) { return (int)sizeof(jawari_event) - 32; }\n')
    languages = ["c11"] if shutil.which("g++") is None else ["c11", "c++11"]
    for standard in languages:
        kind = "c++" if "+" in standard else "c"
        flags = ["-x", kind, f"-std={standard}", "-Wall", "-Wextra", "-pedantic", "-Werror", f"-I{native_library.SOURCES}"]
        done = subprocess.run(
            [*native_library.compiler(), *flags, "-fsyntax-only", str(source)], capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
