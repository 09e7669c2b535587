"""Portable sound is the same to the bit everywhere: takes of one bank on several processors and as WebAssembly in several
machines, and `synth render --bits portable`."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import mido
import numpy as np
import pytest
import soundfile

from synth.cli import bits
from synth.plugin import shelf
from synth.plugin.platforms import TARGETS
from tests.patience import compiling_s

from . import takes
from .emulated import started
from .native import Library

ROOT = Path(__file__).resolve().parents[2]
X86 = TARGETS["linux-x86-64"]


@pytest.fixture(scope="module")
def bank_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("takes") / "bank.jawari"
    path.write_bytes(takes.bank())
    return path


@pytest.fixture(scope="module")
def expected(portable_library: Path, bank_file: Path) -> Mapping[str, str]:
    """The takes as this processor plays them."""
    found = takes.here(Library(portable_library), bank_file)
    assert len(set(found.values())) == len(takes.PRESETS)
    return found


def test_wasmtime_plays_the_same_bits(web_library: Path, bank_file: Path, expected: Mapping[str, str]) -> None:
    pytest.importorskip("wasmtime", reason="runs WebAssembly (pip install wasmtime)")
    assert takes.in_wasmtime(web_library.read_bytes(), bank_file.read_bytes()) == expected


def test_v8_plays_the_same_bits(web_library: Path, bank_file: Path, expected: Mapping[str, str], tmp_path: Path) -> None:
    assert takes.in_node(web_library, bank_file, tmp_path) == expected


@pytest.mark.slow
def test_spidermonkey_plays_the_same_bits(
    web_library: Path, bank_file: Path, expected: Mapping[str, str], tmp_path: Path
) -> None:
    assert takes.in_firefox(web_library, bank_file, tmp_path) == expected


@pytest.mark.slow
@pytest.mark.parametrize("processor", takes.PROCESSORS)
def test_other_x86_processors_play_the_same_bits(
    portable_library: Path, bank_file: Path, expected: Mapping[str, str], tmp_path: Path, processor: str
) -> None:
    assert takes.elsewhere(X86, portable_library, bank_file, tmp_path, processor) == expected


@pytest.mark.slow
@pytest.mark.parametrize("name", ["linux-arm64", "windows-x86-64"])
def test_other_systems_play_the_same_bits(
    portable, bank_file: Path, expected: Mapping[str, str], tmp_path: Path, name: str
) -> None:
    target = TARGETS[name]
    started(target)  # skips before anything is built
    assert takes.elsewhere(target, portable(target), bank_file, tmp_path) == expected


# --- synth render ---

PRESET, RATE = "fretted-bass", 48000
TICKS_PER_BEAT, FRAMES_PER_TICK = 480, 48
#: tick, key, velocity; 0: the key comes up
SONG = ((0, 33, 100), (120, 40, 90), (400, 33, 0), (480, 28, 127), (800, 40, 0), (960, 28, 0))
#: the level is the engine's, and so is the length
OPTIONS = ("-p", PRESET, "-r", str(RATE), "--quality", "draft", "--bit-depth", "float", "--tail", "0", "--bits", "portable")
_BANK = f"""
import sys
from pathlib import Path
from synth.instrument.preset import load_preset
from synth.plugin.bankfile import bank
Path(sys.argv[1]).write_bytes(bank([load_preset("{PRESET}")], [{RATE}.0], quality="draft"))
"""


@pytest.fixture(scope="module")
def song(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path, before = tmp_path_factory.mktemp("song") / "song.mid", 0
    beat_us = round(1e6 * TICKS_PER_BEAT * FRAMES_PER_TICK / RATE)
    track = mido.MidiTrack([mido.MetaMessage("set_tempo", tempo=beat_us)])
    for tick, key, velocity in SONG:
        track.append(mido.Message("note_on", note=key, velocity=velocity, time=tick - before))
        before = tick
    mido.MidiFile(ticks_per_beat=TICKS_PER_BEAT, tracks=[track]).save(path)
    return path


@pytest.fixture(scope="module")
def environment(portable_library: Path) -> dict[str, str]:
    """That of a process whose bits are portable."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(shelf, "library_for", lambda *_: portable_library)
        return bits._environment(None) | {"PYTHONPATH": str(ROOT)}


def rendered(start: list[str], song: Path, out: Path, environment: Mapping[str, str]) -> bytes:
    command = [*start, sys.executable, "-m", "synth", "render", str(song), *OPTIONS, "-o", str(out)]
    done = subprocess.run(command, env=dict(environment), capture_output=True, text=True, check=False, timeout=compiling_s())
    assert done.returncode == 0, done.stderr
    return out.read_bytes()


@pytest.fixture(scope="module")
def wave(song: Path, environment: Mapping[str, str]) -> Path:
    path = song.with_name("song.wav")
    rendered([], song, path, environment)
    return path


def test_a_render_is_what_the_library_plays(
    portable_library: Path, environment: Mapping[str, str], wave: Path, tmp_path: Path
) -> None:
    """The bank prepared with portable bits too."""
    bank = tmp_path / "bank.jawari"
    subprocess.run([sys.executable, "-c", _BANK, str(bank)], env=dict(environment), check=True, timeout=compiling_s())
    loaded = Library(portable_library)
    engine = loaded.open_bank(bank).engine(RATE)
    late = loaded.latency(engine.address)  # which a render leaves out
    sound, rate_hz = soundfile.read(wave, dtype="float32")
    rows = [(FRAMES_PER_TICK * tick, 1 if velocity else 2, 0, key, velocity or 64) for tick, key, velocity in SONG]
    played = engine.play(rows, late + len(sound), dtype=np.float32)[late:]
    assert rate_hz == RATE and np.abs(sound).max() > 0.1
    np.testing.assert_array_equal(sound, played)


def test_a_render_gives_the_same_file_again(song: Path, environment: Mapping[str, str], wave: Path, tmp_path: Path) -> None:
    assert rendered([], song, tmp_path / "again.wav", environment) == wave.read_bytes()


@pytest.mark.slow
def test_a_render_gives_the_same_file_on_another_processor(
    song: Path, environment: Mapping[str, str], wave: Path, tmp_path: Path
) -> None:
    start = started(X86, takes.PROCESSORS[0])
    assert rendered(start, song, tmp_path / "there.wav", environment) == wave.read_bytes()
