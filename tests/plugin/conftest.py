"""The native library, built once for all tests of this folder, by one of the processes that test; and banks."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from synth.instrument.preset import load_preset
from synth.jit.kernel_cache import cache_folder
from synth.plugin import library as native_library
from synth.plugin import packed_bank, webfolder
from synth.plugin.bankfile import bank, laid_out
from synth.plugin.description import describe
from synth.plugin.droning import DroneSettings
from synth.plugin.platforms import PORTABLE, TARGETS, WEB, WEB_RELAXED, Target, host

from . import songs, vst3host
from .native import Library

PRESETS = ("tanpura-light", "fretted-bass", "jawari-harp")


@pytest.fixture(scope="session", autouse=True)
def no_python():
    """Plugins are by themselves: where they may start Python to change a setup, the test says so."""
    before = os.environ.get("JAWARI_PYTHON")
    os.environ["JAWARI_PYTHON"] = "0"
    yield
    os.environ.pop("JAWARI_PYTHON")
    if before is not None:
        os.environ["JAWARI_PYTHON"] = before


@pytest.fixture(scope="session")
def library_file(tmp_path_factory) -> Path:
    """libjawari.so of the sources as they are now. It is kept beside the kernels: another run finds it there. Another one is
    taken where JAWARI_TEST_LIBRARY says so (tools/native)."""
    if "JAWARI_TEST_LIBRARY" in os.environ:
        return Path(os.environ["JAWARI_TEST_LIBRARY"])
    if os.uname().machine != "x86_64" or os.uname().sysname != "Linux":
        pytest.skip("the native library is made for Linux on x86-64")
    try:
        native_library.compiler()
    except native_library.BuildError as error:
        pytest.skip(str(error))
    return _built(TARGETS["linux-x86-64"])


def _built(target: Target, name: str = "", **more: Any) -> Path:
    """The library of a target, kept beside the kernels, under a name where it is another than all have; one process builds,
    the others wait."""
    kept = cache_folder().parent / f"native-tests-{native_library.sources_version()}"
    folder = kept / "-".join(filter(None, (target.name, name)))
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        made = folder / target.library
        return made if made.exists() else native_library.build(folder, target=target, **more)


def _built_for(target: Target, name: str = "", **more: Any) -> Path:
    """`_built`, where there is a compiler for the target."""
    if target != host() and native_library.zig(target) is None:
        pytest.skip("ziglang, which builds libraries for other systems, is missing: pip install ziglang")
    return _built(target, name, **more)


@pytest.fixture(scope="session")
def library(library_file) -> Library:
    """The library without a bank."""
    return Library(library_file)


@pytest.fixture(scope="session")
def bank_files(tmp_path_factory) -> dict[str, Path]:
    """A bank at 44.1 kHz of every preset alone, and "all" of them together."""
    folder = tmp_path_factory.mktemp("banks")
    presets = {name: load_preset(name) for name in PRESETS}
    files = {name: [preset] for name, preset in presets.items()} | {"all": list(presets.values())}
    for name, of in files.items():
        (folder / f"{name}.jawari").write_bytes(bank(of, [44100.0]))
    return {name: folder / f"{name}.jawari" for name in files}


@pytest.fixture(scope="session")
def guitar_file(tmp_path_factory) -> Path:
    """A bank at 44.1 kHz of the guitar, whose strings share a body. It takes 20 MB and some seconds: for few tests."""
    path = tmp_path_factory.mktemp("guitar") / "steel-guitar.jawari"
    path.write_bytes(bank([load_preset("steel-guitar")], [44100.0]))
    return path


@pytest.fixture(scope="session")
def fretless_file(tmp_path_factory) -> Path:
    """A bank at 44.1 kHz of the bass over a board."""
    path = tmp_path_factory.mktemp("fretless") / "fretless-bass.jawari"
    path.write_bytes(bank([load_preset("fretless-bass")], [44100.0]))
    return path


@pytest.fixture(scope="session")
def exported(library_file, tmp_path_factory) -> Path:
    """A plugin of two small presets at 44.1 and 48 kHz, as `songs` plays it."""
    path = tmp_path_factory.mktemp("exported") / "collection.so"
    path.write_bytes(native_library.with_bank(library_file, bank(songs.PRESETS, songs.RATES_HZ)))
    return path


@pytest.fixture(scope="module")
def factory(exported: Path):
    """What a VST3 host finds in that plugin."""
    made = vst3host.Factory(exported)
    yield made
    assert made.release() == 0


@pytest.fixture
def instance(factory: vst3host.Factory):
    """A VST3 instance."""
    made = vst3host.Instance(factory)
    yield made
    made.close()


@pytest.fixture(scope="session")
def portable() -> Callable[[Target], Path]:
    """A function of a target: its library with portable kernels alone, kept like the native library."""

    def of(target: Target) -> Path:
        if target in (WEB, WEB_RELAXED):
            return _built_for(target)
        return _built_for(target, "portable", levels=PORTABLE)

    return of


@pytest.fixture(scope="session")
def fast() -> Callable[[Target], Path]:
    """A function of a target: its library with kernels for its processors' own instructions."""

    return _built_for


@pytest.fixture(scope="session")
def portable_library(portable) -> Path:
    """That of this machine."""
    return portable(TARGETS["linux-x86-64"])


@pytest.fixture(scope="session")
def web_library(portable) -> Path:
    """The engine as WebAssembly."""
    return portable(WEB)


@pytest.fixture(scope="session")
def relaxed_library(portable) -> Path:
    """The same for browsers with relaxed SIMD."""
    return portable(WEB_RELAXED)


@pytest.fixture(scope="session")
def wclap_library(web_library) -> Path:
    """The same with a CLAP."""
    return _built(WEB, "clap", kind="clap")


@pytest.fixture(scope="session")
def web_folders(web_library: Path, relaxed_library: Path, tmp_path_factory) -> dict[str, Path]:
    """Instruments for web pages: a tanpura, one with a drone, a tanpura with a bass as two programs, and "relaxed": one with
    both engines."""
    folder = tmp_path_factory.mktemp("web")
    tanpura, bass = load_preset("tanpura-light"), load_preset("fretted-bass")
    drone = DroneSettings(sa_hz=130.8).on(tanpura)
    banks = {
        "tanpura-light": ([tanpura], None),
        "tanpura-light-drone": ([drone.strings.preset], drone),
        "two": ([tanpura, bass], None),
        "relaxed": ([tanpura], None),
    }
    for name, (presets, played) in banks.items():
        data = packed_bank.for_pages(*laid_out(presets, [webfolder.RATE_HZ], name=name, drone=played, quality="draft"))
        about = describe(presets, name, played.parameters() if played else ())
        relaxed = relaxed_library.read_bytes() if name == "relaxed" else None
        webfolder.write(folder / name, web_library.read_bytes(), data, about, relaxed)
    return {name: folder / name for name in banks}
