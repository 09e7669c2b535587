"""Kernels from the native library: which one is taken, why another is not, and that nobody hears the difference."""

from __future__ import annotations

import copy
import os
import pickle
import shutil
import subprocess
import sys
from pathlib import Path

import mido
import numpy as np
import pytest
import soundfile
from numba import float64, int64, njit
from numba.core.errors import TypingError
from numpy.random import mtrand

from synth.jit import prebuilt
from synth.jit.entries import Kernel, entered, entry
from synth.jit.kernel_sources import sources_id
from synth.native import processors
from synth.solver.responses import fill_rows
from tests.patience import compiling_s
from tests.plugin import conftest

ROOT = Path(__file__).resolve().parents[1]
HERE = processors.level()
pytestmark = pytest.mark.skipif(HERE is None or sys.platform != "linux", reason="no native library is for this machine")
library_file = conftest.library_file
#: what decides about the library
DECIDES = ("JAWARI_NATIVE", "JAWARI_LANES", "NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "NUMBA_DISABLE_JIT", "NUMBA_BOUNDSCHECK")


@pytest.fixture
def home(monkeypatch, tmp_path) -> Path:
    """Where a library is looked for in the user's cache, which is empty, and nothing asks for other kernels. None lies with
    the package."""
    for name in DECIDES:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    package = tmp_path / "package" / "jit" / "prebuilt.py"
    package.parent.mkdir(parents=True)
    package.touch()
    monkeypatch.setattr(prebuilt, "__file__", str(package))
    with_package, in_cache = prebuilt.places()
    assert with_package == tmp_path / "package" / "plugin" / "lib" / prebuilt.NAME
    for place in (with_package, in_cache):
        place.parent.mkdir(parents=True)
    return in_cache


def own_name(library: Path, name: str, folder: Path) -> Path:
    """A library that says it was made from sources of this id; the same file is loaded only once by a process."""
    made = folder / f"{name}.so"
    data = library.read_bytes()
    mark = b"jawari-kernels:" + sources_id().encode()
    assert data.count(mark) == 1
    made.write_bytes(data.replace(mark, b"jawari-kernels:" + name.encode().ljust(16, b"0")))
    return made


def python(program: str, native: Path) -> str:
    """What a program prints in a process of its own that is to use a library."""
    environment = {**os.environ, "JAWARI_NATIVE": str(native)}
    command = [sys.executable, "-c", program]
    return subprocess.run(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True, check=True).stdout


# --- which one ------------------------------------------------------------------------------------------------------------


def test_it_is_taken_from_the_cache_and_sooner_from_the_package(home: Path, library_file: Path) -> None:
    assert prebuilt.Found().path is None and prebuilt.Found().why == "there is none"
    shutil.copy(library_file, home)
    assert prebuilt.Found().path == home and prebuilt.Found().why == ""
    with_package = prebuilt.places()[0]
    shutil.copy(library_file, with_package)
    assert prebuilt.Found().path == with_package


def test_it_has_what_an_engine_calls_and_nothing_else(home: Path, library_file: Path) -> None:
    from synth.engine.tasks import work_on

    shutil.copy(library_file, home)
    found = prebuilt.Found()
    assert found.address(work_on) is not None
    assert found.address(own_name) is None  # of another package
    assert found.address(prebuilt.places) is None
    shutil.rmtree(home.parent)
    assert prebuilt.Found().address(work_on) is None


def test_one_may_be_named(home: Path, library_file: Path, monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("JAWARI_NATIVE", str(library_file))
    assert prebuilt.Found().path == library_file
    monkeypatch.setenv("JAWARI_NATIVE", str(tmp_path / "nowhere.so"))
    assert prebuilt.Found().path is None
    assert prebuilt.Found().why == f"{tmp_path / 'nowhere.so'}: there is no such file"
    shutil.copy(library_file, home)
    assert prebuilt.Found().path is None  # that one, or none
    monkeypatch.setenv("JAWARI_NATIVE", "0")
    assert prebuilt.Found().path is None and "JAWARI_NATIVE=0" in prebuilt.Found().why
    monkeypatch.setenv("JAWARI_NATIVE", "")  # as good as unset
    assert prebuilt.Found().path == home


@pytest.mark.parametrize(
    "name, asked",
    [
        ("JAWARI_LANES", "2"),
        ("NUMBA_DISABLE_JIT", "1"),
        ("NUMBA_BOUNDSCHECK", "1"),
        ("NUMBA_CPU_FEATURES", "-fma"),
        ("NUMBA_CPU_NAME", "x86-64-v3" if HERE == "x86-64-v4" else "x86-64-v4"),
        ("NUMBA_CPU_NAME", "skylake"),
    ],
)
def test_who_asks_for_other_kernels_gets_numbas(
    home: Path,
    library_file: Path,
    monkeypatch,
    name: str,
    asked: str,
) -> None:
    shutil.copy(library_file, home)
    monkeypatch.setenv(name, asked)
    assert prebuilt.Found().path is None
    assert prebuilt.Found().why.startswith(f"{name} asks for ")
    monkeypatch.setenv("JAWARI_NATIVE", str(library_file))
    assert prebuilt.Found().path is None


def test_the_level_of_this_processor_is_what_it_has_anyway(home: Path, library_file: Path, monkeypatch) -> None:
    shutil.copy(library_file, home)
    monkeypatch.setenv("NUMBA_CPU_NAME", str(HERE))
    for name, value in {"NUMBA_CPU_FEATURES": "", "JAWARI_LANES": "", "NUMBA_DISABLE_JIT": "0"}.items():
        monkeypatch.setenv(name, value)
    assert prebuilt.Found().path == home


def test_another_processor_has_none(home: Path, library_file: Path, monkeypatch) -> None:
    shutil.copy(library_file, home)
    monkeypatch.setattr(prebuilt, "level", lambda: None)
    assert prebuilt.Found().path is None
    assert prebuilt.Found().why == f"{home} has no code for this processor"


def test_one_of_other_sources_is_left_alone(home: Path, library_file: Path) -> None:
    shutil.move(own_name(library_file, "0123", home.parent), home)
    assert prebuilt.Found().path is None
    assert prebuilt.Found().why == f"{home} was made from other sources"


def test_what_is_wrong_with_the_packages_does_not_hide_that_of_the_cache(home: Path, library_file: Path) -> None:
    with_package = prebuilt.places()[0]
    shutil.copy(library_file, home)
    with_package.write_bytes(b"no library")
    assert prebuilt.Found().path == home and prebuilt.Found().why == ""
    shutil.move(own_name(library_file, "9", home.parent), with_package)
    assert prebuilt.Found().path == home and prebuilt.Found().why == ""
    home.unlink()
    assert prebuilt.Found().why == f"{with_package} was made from other sources"


@pytest.mark.parametrize("which", ["file", "folder"])
def test_what_anybody_can_write_is_not_run(home: Path, library_file: Path, which: str) -> None:
    shutil.copy(library_file, home)
    (home if which == "file" else home.parent).chmod(0o777)
    assert prebuilt.Found().path is None
    assert prebuilt.Found().why == f"{home} can be written by anybody"


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give files away")
def test_what_belongs_to_another_user_is_not_run(home: Path, library_file: Path, monkeypatch) -> None:
    shutil.copy(library_file, home)
    os.chown(home, 12345, -1)
    assert prebuilt.Found().path is None
    assert prebuilt.Found().why == f"{home} belongs to another user"
    os.chown(prebuilt.__file__, 12345, -1)  # whose code it is that runs
    assert prebuilt.Found().path == home
    os.chown(prebuilt.__file__, 0, -1)
    monkeypatch.setenv("JAWARI_NATIVE", str(home))  # who names it has chosen it
    assert prebuilt.Found().path == home


@pytest.mark.parametrize("kept", [0.0, 0.001, 0.1, 0.5, 0.9, 0.99])
def test_half_a_library_is_none(home: Path, library_file: Path, kept: float) -> None:
    """In a process of its own: a loader that runs into the end is killed."""
    data = library_file.read_bytes()
    home.write_bytes(data[: int(kept * len(data))])
    program = "from synth.jit import prebuilt; found = prebuilt.Found(); print(found.path, found.why)"
    assert python(program, home).startswith(f"None {home} ")


@pytest.mark.parametrize("what", ["text", "folder", "foreign", "locked"])
def test_what_is_no_library_is_none(home: Path, what: str) -> None:
    if what == "text":
        home.write_text("no library")
    elif what == "folder":
        home.mkdir()
    elif what == "foreign":
        shutil.copy(mtrand.__file__, home)
    else:
        home.symlink_to(home)
    assert prebuilt.Found().path is None
    why = prebuilt.Found().why
    assert why == "there is none" if what in ("folder", "locked") else why.startswith(f"{home} cannot be loaded: ")


def test_the_command_says_where_kernels_come_from(library_file: Path, tmp_path) -> None:
    damaged = tmp_path / "damaged.so"
    damaged.write_bytes(library_file.read_bytes()[:5000])
    uses = f"the native library {library_file}"
    not_that = f"no native library: {damaged} has lost its end"
    for named, told in ((library_file, uses), (damaged, not_that)):
        said = render(tmp_path, notes(tmp_path), "--verbose", JAWARI_NATIVE=str(named))
        assert told in said, said


# --- the same sound -------------------------------------------------------------------------------------------------------


def notes(folder: Path) -> Path:
    """Two channels with overlapping notes, bends, pressure and controllers, of an MPE zone."""
    song = mido.MidiFile(ticks_per_beat=480)
    track = mido.MidiTrack()
    song.tracks.append(track)
    rng = np.random.default_rng(4)
    for step in range(60):
        channel = int(rng.integers(1, 4))
        note = int(rng.integers(33, 50))
        track.append(mido.Message("note_on", channel=channel, note=note, velocity=int(rng.integers(20, 127)), time=10))
        track.append(mido.Message("pitchwheel", channel=channel, pitch=int(rng.integers(-3000, 3000)), time=4))
        track.append(mido.Message("aftertouch", channel=channel, value=int(rng.integers(128)), time=2))
        track.append(mido.Message("control_change", channel=channel, control=74, value=int(rng.integers(128)), time=2))
        if step % 3:
            track.append(mido.Message("note_off", channel=channel, note=note, time=3))
    path = folder / "notes.mid"
    song.save(path)
    return path


def render(folder: Path, song: Path, *options: str, **environment: str) -> str:
    """`synth render` of the song's first half second, into a folder that is made; what it says on standard error."""
    folder.mkdir(exist_ok=True)
    command = [sys.executable, "-m", "synth", "render", str(song), "-o", str(folder / "out.wav")]
    command += ["--end", "0.5", "--quality", "draft", *options]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
        timeout=compiling_s(),
    )
    assert done.returncode == 0, done.stderr
    return done.stderr


def sounds(folder: Path) -> dict[str, np.ndarray]:
    """Samples of every file."""
    return {path.name: soundfile.read(path, dtype="float64")[0] for path in folder.rglob("*.wav")}


@pytest.mark.parametrize(
    "options",
    [
        ("-p", "fretted-bass", "--threads", "1", "--mpe", "--cc", "74=pluck.position"),
        ("--map", "2=fretted-bass,3=tanpura,4=jawari-harp", "--fold", "--threads", "2", "--stems", "stems"),
    ],
    ids=["mpe", "stems"],
)  # fmt: skip
def test_the_sound_is_that_of_numbas_kernels(library_file: Path, tmp_path, options: tuple[str, ...]) -> None:
    song = notes(tmp_path)
    made = []
    for name, native in (("library", str(library_file)), ("numba", "0")):
        folder = tmp_path / name
        given = [str(folder / each) if each == "stems" else each for each in options]
        said = render(folder, song, *given, "--verbose", JAWARI_NATIVE=native)
        assert ("the native library" in said) == (native != "0")
        made.append(sounds(folder))
    assert made[0].keys() == made[1].keys() and len(made[0]) == (4 if "--stems" in options else 1)
    assert all(sound.any() and np.array_equal(sound, made[1][name]) for name, sound in made[0].items())


def test_nothing_is_compiled_where_the_library_is(library_file: Path, tmp_path) -> None:
    cache = tmp_path / "cache"
    options = ("-p", "fretted-bass", "--mpe", "--threads", "2", "--verbose")
    said = render(tmp_path, notes(tmp_path), *options, JAWARI_NATIVE=str(library_file), XDG_CACHE_HOME=str(cache))
    assert "none compiled here" in said
    assert list(cache.rglob("*.nb?")) == []


# --- calls ----------------------------------------------------------------------------------------------------------------


def add(a, b, out):
    """out: one float64."""
    out[0] = a + b


class Called:
    """In the library's place: counts calls."""

    def __init__(self) -> None:
        self.given: list[tuple] = []

    def __call__(self, *arguments) -> None:
        self.given.append(arguments)


@pytest.fixture
def kernel() -> tuple[Kernel, Called]:
    """A kernel that is in a library."""
    made = Kernel(njit(add), (int64, float64, float64[::1]), None)
    called = Called()
    made.__dict__["_native"] = called
    return made, called


def read_only(array: np.ndarray) -> np.ndarray:
    array.flags.writeable = False
    return array


def test_what_fits_goes_to_the_library(kernel: tuple[Kernel, Called]) -> None:
    made, called = kernel
    out = np.zeros(3)
    made(1, 2.5, out)
    made(np.int32(-7), np.float64(2.5), out)
    made(2**63 - 1, 4, out)
    assert called.given == [(a, b, out.ctypes.data, 3) for a, b in ((1, 2.5), (-7, 2.5), (2**63 - 1, 4.0))]
    assert [type(value) for value in called.given[1][:2]] == [int, float]
    assert out[0] == 0.0


@pytest.mark.parametrize(
    "arguments",
    [
        (1.0, 2.0, np.zeros(1)),
        (1, 2j, np.zeros(1, complex)),
        (1, 2.0, np.zeros(1, np.float32)),
        (1, 2.0, np.zeros(4)[::2]),
        (1, 2.0, np.zeros(9, np.uint8)[1:].view(np.float64)),
    ],
    ids=["float", "complex", "float32", "strided", "unaligned"],
)  # fmt: skip
def test_what_does_not_fit_is_numbas(kernel: tuple[Kernel, Called], arguments: tuple) -> None:
    made, called = kernel
    made(*arguments)
    assert called.given == [] and arguments[2][0] == arguments[0] + arguments[1]


def test_what_numba_refuses_is_refused(kernel: tuple[Kernel, Called]) -> None:
    made, called = kernel
    constant = read_only(np.zeros(1))
    for arguments in ((1, 2.0, constant), (1, 2.0, None), (2**64, 2.0, np.zeros(1)), (None, 2.0, np.zeros(1))):
        with pytest.raises(TypingError):
            made(*arguments)
    with pytest.raises(TypeError, match="argument"):
        made(1, 2.0)
    assert called.given == [] and constant[0] == 0.0


def counted(address, words):
    """Something that is called by its address."""


def test_an_entry_is_compiled_once_and_known_by_its_address() -> None:
    made = entry(counted, 2)
    assert entry(counted, 2) is made
    assert entered(made.address) is counted
    assert entered(made.address + 1) is None
    made.ctypes(0, 0)


ENTRIES = """
import ctypes, sys
import numpy as np
from synth.engine.tasks import work_on
from synth.engine.voices.policy import decide
from synth.dsp.limiter_effect import LIMITER
from synth.jit import prebuilt
from synth.jit.entries import Entry, entered, entry
for function, words, answers in ((work_on, 4, False), (decide, 1, False), (LIMITER.silent, 1, True)):
    made = entry(function, words, answers)
    assert isinstance(made, Entry) and made.address == prebuilt.found().address(function)
    assert entered(made.address) is function
    assert made.ctypes.restype is (ctypes.c_int64 if answers else None) and len(made.ctypes.argtypes) == words
"""


def test_entries_are_the_librarys(library_file: Path) -> None:
    python(ENTRIES, library_file)


def test_a_kernel_is_copied_and_pickled_by_its_name() -> None:
    assert copy.copy(fill_rows) is fill_rows and copy.deepcopy([fill_rows])[0] is fill_rows
    assert pickle.loads(pickle.dumps(fill_rows)) is fill_rows


def test_every_kernel_of_the_library_is_one_of_the_sources(library_file: Path) -> None:
    """All that Python calls is in it, so that nothing waits for Numba."""
    program = (
        "from synth.jit.entries import KERNELS; from synth.plugin import emit; from synth.jit import prebuilt\n"
        "named = [row[0] for row in emit._called_by_address()]\n"
        "import synth.engine.engine\n"
        "for function in [*named, *(each.py_func for each in KERNELS)]:\n"
        "    assert prebuilt.found().address(function) is not None, function\n"
        "print(len(named), len(KERNELS))"
    )
    assert all(int(each) > 5 for each in python(program, library_file).split())
