"""A CLAP as WebAssembly, as `synth export -f wclap` writes it, in a host of the tests: the plugin that it is elsewhere."""

from __future__ import annotations

import gzip
import io
import tarfile
from pathlib import Path

import numpy as np
import pytest

from synth.cli import main
from synth.instrument.preset import load_preset
from synth.plugin import bankfile, library, shelf, wclap

from . import clapabi as abi
from .claphost import Host, Instance
from .clapkit import MIXED, PARTS, RATES, hear, plugin_file, wild
from .native import Library

pytest.importorskip("wasmtime", reason="runs WebAssembly (pip install wasmtime)")

from .wclaphost import WclapHost, WclapInstance

RATE_HZ, FRAMES = 48000.0, 12_000
#: frame, key, velocity as MIDI has it; 0: the key comes up
NOTES = ((0, 48, 100), (99, 43, 90), (3000, 55, 127), (5000, 48, 0), (7000, 48, 64))
BLOCKS = (256, 1, 33, 512, 1000, 64)


@pytest.fixture(scope="module")
def bank() -> bytes:
    """As the command makes it."""
    return bankfile.bank([load_preset("tanpura-light")], [RATE_HZ], quality="draft", note_hz=None)


@pytest.fixture(scope="module")
def archive(wclap_library: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """As the command writes it."""
    folder = tmp_path_factory.mktemp("wclap")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shelf, "web_library", lambda kind, say: wclap_library)
        patch.chdir(folder)
        assert main(["export", "tanpura-light", "-f", "wclap", "--rates", "48000", "--quality", "draft"]) == 0
    (path,) = folder.iterdir()
    assert path.name == "tanpura-light.wclap.tar.gz"
    return path


@pytest.fixture(scope="module")
def host(archive: Path) -> WclapHost:
    return WclapHost(archive)


@pytest.fixture(scope="module")
def native(portable_library: Path, bank: bytes, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same plugin for this machine."""
    path = tmp_path_factory.mktemp("clap") / "tanpura-light.clap"
    path.write_bytes(library.with_bank(portable_library, bank))
    return path


def events() -> list:
    return [
        abi.note_on(frame, key, velocity / 127) if velocity else abi.note_off(frame, key) for frame, key, velocity in NOTES
    ]


def played(plugin: WclapInstance | Instance, frames: int, kind: type = np.float64) -> np.ndarray:
    """The notes, in blocks of many lengths."""
    waiting, pieces, begin, k = events(), [], 0, 0
    while begin < frames:
        end = min(frames, begin + BLOCKS[k % len(BLOCKS)])
        here = [each for each in waiting if begin <= each.header.time < end]
        for each in here:
            each.header.time -= begin
        waiting = waiting[len(here) :]
        pieces.append(plugin.process(here, end - begin, kind))
        begin, k = end, k + 1
    return np.concatenate(pieces)


def test_the_archive_holds_one_module_with_its_bank(archive: Path, wclap_library: Path, bank: bytes) -> None:
    with tarfile.open(fileobj=io.BytesIO(gzip.decompress(archive.read_bytes()))) as files:
        (member,) = files.getmembers()
        assert (member.name, member.mode, member.mtime) == ("module.wasm", 0o644, 0)
        module = files.extractfile(member)
        assert module is not None and module.read().count(bank) == 1
    again = archive.with_name("again.wclap.tar.gz")
    wclap.write(again, wclap_library.read_bytes(), bank)
    assert again.read_bytes() == archive.read_bytes()
    again.unlink()


@pytest.mark.parametrize("kind", [np.float64, np.float32])
def test_it_plays_what_the_native_plugin_plays(host: WclapHost, native: Path, kind: type) -> None:
    made = host.instance()
    assert made.activate(RATE_HZ)
    heard = played(made, FRAMES, kind)
    made.deactivate()
    made.close()
    with Host(native) as here, here.instance() as other:
        assert other.activate(RATE_HZ)
        other.start()
        np.testing.assert_array_equal(heard, played(other, FRAMES, kind))
    assert np.abs(heard).max() > 0.01


def test_it_plays_what_the_engine_plays(host: WclapHost, native: Path) -> None:
    made = host.instance()
    assert made.activate(RATE_HZ)
    engine = Library(native).open_own_bank().engine(RATE_HZ)
    rows = [(frame, 1 if velocity else 2, 0, key, velocity) for frame, key, velocity in NOTES]
    np.testing.assert_array_equal(played(made, FRAMES), engine.play(rows, FRAMES))
    made.deactivate()
    made.close()


def test_it_plays_whatever_the_native_plugin_plays(wclap_library: Path, portable_library: Path, tmp_path: Path) -> None:
    """All kinds of events on several channels and programs, tunings and zones among them."""
    rows = wild(7, 400, 20_000)
    native = plugin_file(portable_library, tmp_path)
    archive = tmp_path / "wild.wclap.tar.gz"
    wclap.write(archive, wclap_library.read_bytes(), bankfile.bank(PARTS, RATES))
    with Host(native) as here, here.instance() as other:
        made = WclapHost(archive).instance()
        for each in (made, other):
            assert each.activate(RATES[0])
        other.start()
        sounds = [hear(each, rows, 20_000, MIXED) for each in (made, other)]
        assert [made.value(info.id) for info in made.params] == list(other.values().values())
    assert np.abs(sounds[0]).max() > 0.01
    np.testing.assert_array_equal(*sounds)


def test_two_instances_know_nothing_of_each_other(host: WclapHost) -> None:
    first, second = host.instance(), host.instance()
    for each in (first, second):
        assert each.activate(RATE_HZ)
    expected = played(first, FRAMES)
    first.process([abi.note_on(0, 50, 1.0)], 512)
    np.testing.assert_array_equal(played(second, FRAMES), expected)
    first.close()
    second.reset()
    second.process([], 512)  # in which what sounded fades
    np.testing.assert_array_equal(played(second, FRAMES), expected)
    second.deactivate()
    assert second.activate(RATE_HZ) and not second.process([], 512).any()
    second.deactivate()
    second.close()


def test_parameters_are_those_of_the_native_plugin(host: WclapHost, native: Path) -> None:
    made = host.instance()
    with Host(native) as here, here.instance() as other:
        infos = made.params
        assert len(infos) == len(other.params) > 5
        for mine, theirs in zip(infos, other.params, strict=True):
            for name in ("id", "flags", "name", "module", "minimum", "maximum", "initial"):
                assert getattr(mine, name) == getattr(theirs, name)
            value = made.value(mine.id)
            assert value == other.value(mine.id)
            assert made.text(mine.id, value) == other.text(mine.id, value)
    made.close()


def test_values_come_as_events_and_are_kept_in_the_state(host: WclapHost) -> None:
    made, other = host.instance(), host.instance()
    turned = next(info for info in made.params if info.flags & abi.AUTOMATABLE and not info.flags & abi.STEPPED)
    assert made.activate(RATE_HZ) and other.activate(RATE_HZ)
    made.process([abi.param(0, turned.id, turned.maximum), abi.note_on(5, 48, 0.9)], 512)
    assert made.value(turned.id) == turned.maximum != other.value(turned.id)
    kept = made.save()
    assert other.load(kept) and "rescan" in other.requests
    assert other.value(turned.id) == turned.maximum
    for each in (made, other):
        each.deactivate()
        each.close()


def test_a_state_goes_from_one_system_to_the_other(host: WclapHost, native: Path) -> None:
    made = host.instance()
    assert made.activate(RATE_HZ)
    turned = next(info for info in made.params if info.flags & abi.AUTOMATABLE and not info.flags & abi.STEPPED)
    made.process([abi.param(0, turned.id, turned.maximum)], 512)
    with Host(native) as here, here.instance() as other:
        assert other.activate(RATE_HZ)
        other.start()
        data = made.save()
        assert other.load(data) and made.load(data) and other.save() == data
        heard = [np.concatenate([each.process(events()[:2], 512), each.process([], 4096)]) for each in (made, other)]
        assert np.abs(heard[0]).max() > 0.01
        np.testing.assert_array_equal(*heard)
    made.deactivate()
    made.close()


@pytest.mark.parametrize("damage", [lambda data: data[:-1], lambda data: b"", lambda data: data[:99] + b"\xff" + data[100:]])
def test_a_damaged_state_is_refused_and_told(host: WclapHost, damage) -> None:
    made = host.instance()
    assert not made.load(damage(made.save()))
    assert made.requests[-1].startswith("log 3: ") and len(made.requests[-1].split()) > 5
    made.close()


def test_a_rate_that_the_bank_does_not_have_is_refused_and_told(host: WclapHost) -> None:
    made = host.instance()
    assert not made.activate(44100.0)
    assert "48000" in made.requests[-1]
    made.close()


def test_it_can_be_entered_again(archive: Path) -> None:
    host = WclapHost(archive)
    host.close()
    with pytest.raises(AssertionError):
        host.instance()


def test_a_module_without_a_bank_is_no_plugin(wclap_library: Path, tmp_path: Path) -> None:
    path = tmp_path / "none.wclap.tar.gz"
    with tarfile.open(path, "w:gz") as files:
        about = tarfile.TarInfo("module.wasm")
        about.size = wclap_library.stat().st_size
        files.addfile(about, io.BytesIO(wclap_library.read_bytes()))
    with pytest.raises(AssertionError, match="refused"):
        WclapHost(path)
