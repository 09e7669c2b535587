"""LV2: what stands beside the library is what the library does, and the sound is the engine's, rounded to float."""

from __future__ import annotations

import dataclasses
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from synth.plugin import turtle
from synth.plugin.bankfile import bank
from synth.plugin.description import describe
from tests.patience import until

from . import lv2host as host
from .songs import PRESETS, RATES_HZ, Song, random_song, truth
from .vst3host import blocks

ABOUT = describe(PRESETS)
FRAMES = 12000
#: what the ports hold as turtle.py has it; the last is the program
DEFAULTS = [*(parameter.default for parameter in (*ABOUT.parameters, *ABOUT.setup)), 0.0]
SETUP = slice(len(ABOUT.parameters), -1)


@pytest.fixture(scope="module")
def bundle(exported: Path, tmp_path_factory) -> Path:
    """A folder as hosts find it; the library's path in it is its last part."""
    folder = tmp_path_factory.mktemp("lv2") / "collection.lv2"
    folder.mkdir()
    shutil.copy(exported, folder / exported.name)
    for name, text in turtle.texts(ABOUT, exported.name).items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@pytest.fixture
def make(exported: Path):
    made: list[host.Instance] = []

    def one(rate_hz: float = 44100.0, **more) -> host.Instance:
        made.append(host.Instance(exported, rate_hz, DEFAULTS, **more))
        return made[-1]

    yield one
    for each in made:
        each.close()


def played(instance: host.Instance, song: Song, sizes, first: int = 0, end: int | None = None) -> np.ndarray:
    """A song whose changes are at the beginning of blocks."""
    parts = []
    for a, b in blocks((song.frames if end is None else end) - first, sizes):
        a, b = first + a, first + b
        for frame, k, value in song.changes:
            if a <= frame < b:
                assert frame == a
                instance.controls[k] = value
        parts.append(instance.run(b - a, [(f - a, data) for f, data in song.messages if a <= f < b]))
    return np.concatenate(parts)


def a_song(seed: int, block: int, frames: int = FRAMES) -> Song:
    rng = np.random.default_rng(seed)
    song = random_song(rng, frames)
    taken = {frame for frame, _ in song.messages}
    for frame in sorted({int(k) * block for k in rng.integers(0, frames // block, 25)} - taken):
        k = int(rng.integers(len(ABOUT.parameters)))
        low, high = ABOUT.parameters[k].minimum, ABOUT.parameters[k].maximum
        song.changes.append((frame, k, float(np.float32(low + (high - low) * rng.random()))))
    return song


@pytest.mark.parametrize(("rate_hz", "size"), [(44100.0, 64), (48000.0, 333)])
def test_the_sound_is_the_engines(make, rate_hz, size):
    song = a_song(size, size)
    instance = make(rate_hz)
    instance.activate()
    sound = played(instance, song, (size,))
    expected = truth(PRESETS, rate_hz, song)
    assert np.abs(expected).max() > 0.01
    np.testing.assert_array_equal(sound, expected.astype(np.float32))


def test_instances_do_not_know_of_each_other(make):
    songs = [a_song(seed, 50, 4000) for seed in (1, 2)]
    both = [make(rate_hz) for rate_hz in RATES_HZ]
    parts: list[list[np.ndarray]] = [[], []]
    for first, end in blocks(4000, (50, 200)):
        for k, instance in enumerate(both):
            song = Song(4000, songs[k].messages)
            parts[k].append(played(instance, song, (end - first,), first, end))
    for k, rate_hz in enumerate(RATES_HZ):
        expected = truth(PRESETS, rate_hz, Song(4000, songs[k].messages)).astype(np.float32)
        np.testing.assert_array_equal(np.concatenate(parts[k]), expected)


def test_a_port_moved_back_means_the_initial_value_itself(make):
    """0.3 as a float is another number; bit for bit the preset's must come back."""
    place = [parameter.id for parameter in ABOUT.parameters].index("pluck.position")
    assert float(np.float32(DEFAULTS[place])) != DEFAULTS[place]
    instance = make()
    instance.controls[place] = 0.45
    instance.run(64)
    instance.controls[place] = DEFAULTS[place]
    sound = instance.run(2000, [(0, bytes([0x90, 50, 100]))])
    expected = truth(PRESETS, 44100.0, Song(2064, [(64, bytes([0x90, 50, 100]))]))[64:]
    np.testing.assert_array_equal(sound, expected.astype(np.float32))


def test_what_sounds_fades_where_a_state_is_restored(make):
    """Then it plays as one that begins with these values."""
    first, second, fresh = (make(48000.0) for _ in range(3))
    first.controls[0] = 0.5 * first.controls[0]
    first.run(64)
    second.run(1000, [(3, bytes([0x90, 48, 127]))])
    for each in (second, fresh):
        each.controls[:] = first.controls  # as hosts do it, which keep the ports themselves
        assert each.restore(first.save()) == 0
    after = second.run(2000)
    assert np.abs(after[:10]).max() > 1e-3 and not after[144:].any() and not fresh.run(2000).any()
    song = a_song(5, 100)
    sound = played(second, song, (100,), 0)
    assert np.abs(sound).max() > 0.01
    np.testing.assert_array_equal(sound, played(fresh, song, (100,), 0))


def test_what_is_no_state_changes_nothing(make):
    song = a_song(6, 100, 3000)
    instance = make()
    before = played(instance, song, (100,), 0, 1500)
    good = instance.save()
    flipped = bytearray(good)
    flipped[len(good) // 2] ^= 16
    for bad in (b"", b"no state", good[:-1], good[:20], bytes(flipped), np.random.default_rng(0).bytes(999)):
        assert instance.restore(bad) == 1
    assert len(instance.logged) == 6 and all("state" in each for each in instance.logged)
    assert instance.restore(good, "urn:of-another-kind") == 2
    assert instance.restore(None) == 5
    after = played(instance, song, (100,), 1500)
    expected = truth(PRESETS, 44100.0, song).astype(np.float32)
    np.testing.assert_array_equal(np.concatenate([before, after]), expected)


def test_activated_anew_nothing_is_left(make):
    instance = make()
    instance.activate()
    instance.run(2000, [(0, bytes([0x90, 50, 127]))])
    instance.activate()
    instance.run(1024)
    assert np.abs(instance.run(1024)).max() == 0.0
    assert np.abs(instance.run(1024, [(0, bytes([0x90, 50, 127]))])).max() > 0.0


def test_disabled_there_is_silence(make):
    instance = make()
    instance.run(2000, [(0, bytes([0x90, 50, 127]))])
    instance.enabled[0] = 0.0
    instance.run(2000)
    assert np.abs(instance.run(1000)).max() == 0.0
    instance.enabled[0] = 1.0
    instance.run(2000)
    assert np.abs(instance.run(1000)).max() > 0.0


def test_latency_is_told(make):
    from .songs import engine_of

    for rate_hz in RATES_HZ:
        instance = make(rate_hz)
        instance.run(0)
        assert instance.latency[0] == engine_of(PRESETS, rate_hz).latency_samples


def test_refusals_say_why(exported):
    with pytest.raises(ValueError, match=r"urn:jawari:collection: .*44100.*48000"):
        host.Instance(exported, 32000.0, DEFAULTS)
    with pytest.raises(ValueError):
        host.Instance(exported, 44100.0, DEFAULTS, mapped=False)


def test_without_a_bank_there_is_no_plugin(library_file, exported):
    assert host.descriptor(library_file) is None
    assert host.descriptor(exported, 1) is None


def test_sequences_that_lie_do_no_harm(make):
    """Events longer than what is left of the sequence, cut off, or of other kinds; and a port that holds no number."""
    instance = make()
    kind = instance.urid(host.MIDI_EVENT)
    note = np.int64([0]).tobytes() + np.uint32([3, kind]).tobytes() + bytes([0x90, 50, 127, 0, 0, 0, 0, 0])
    head = np.uint32([len(note) + 8, instance.urid(host.SEQUENCE), 0, 0]).tobytes()
    longer = np.int64([0]).tobytes() + np.uint32([10**6, kind]).tobytes() + bytes([0x90, 50, 127, 0, 0, 0, 0, 0])
    other = np.int64([0]).tobytes() + np.uint32([3, kind + 77]).tobytes() + bytes([0x90, 50, 127, 0, 0, 0, 0, 0])
    huge = np.int64([0]).tobytes() + np.uint32([2**32 - 1, kind]).tobytes() + bytes(8)
    for body in (longer, other, huge, note[:18]):
        lying = np.uint32([len(body) + 8, instance.urid(host.SEQUENCE), 0, 0]).tobytes() + body
        instance.run(512, sequence=lying)
    instance.run(512, sequence=np.uint32([0, 0, 0, 0]).tobytes())
    instance.controls[:] = [np.nan, np.inf, -np.inf, 1e30, -1e30, *[np.nan] * (instance.controls.size - 5)]
    sound = instance.run(512, [(-5, bytes([0xB0, 7])), (600, b""), (3, bytes([0xFF] * 9))])
    assert np.abs(sound).max() == 0.0
    instance.controls[:] = DEFAULTS
    assert np.abs(instance.run(1024, sequence=head + note)).max() > 0.0


def test_the_setup_is_shown(make):
    """What is played, whatever is wished of a plugin that is by itself."""
    instance = make()
    played = instance.outputs(len(DEFAULTS), len(ABOUT.setup))
    for wished in (1.0, np.nan, DEFAULTS[SETUP]):
        instance.controls[SETUP] = wished
        instance.run(64)
        np.testing.assert_array_equal(played, np.float32(DEFAULTS[SETUP]))


def test_another_setup_is_made_for_a_port_that_moves(make, tmp_path, monkeypatch):
    """A program in the place of Python, which gives the bank as it was: its bank is played, and said to be."""
    made, program = tmp_path / "made", tmp_path / "python"
    made.write_bytes(bank(PRESETS, [44100.0]))
    copied = 'mkdir -p "$(dirname "$6")"; umask 077; cp'
    program.write_text(f'#!/bin/sh\n{copied} {made} "$6"\n')
    program.chmod(0o755)
    monkeypatch.setenv("JAWARI_PYTHON", str(program))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    instance = make()
    played = instance.outputs(len(DEFAULTS), len(ABOUT.setup))
    place = len(ABOUT.parameters) + [number.id for number in ABOUT.setup].index("string.gauge")
    instance.controls[place] = 1.5
    until(lambda: instance.run(64) is not None and played[place - len(ABOUT.parameters)] == 1.5)
    program.write_text("#!/bin/sh\necho the strings are gone\n")
    instance.controls[place] = 1.25
    until(lambda: instance.run(64) is not None and instance.logged)
    assert instance.logged[0].endswith("the strings are gone")
    assert played[place - len(ABOUT.parameters)] == 1.5


def test_ports_are_as_many_as_the_library_has():
    text = turtle.texts(ABOUT, "collection.so")["collection.ttl"]
    indices = [int(each) for each in re.findall(r"lv2:index (\d+)", text)]
    assert indices == list(range(host.FIRST_PARAMETER + len(DEFAULTS) + len(ABOUT.setup)))
    symbols = re.findall(r"\]?\s*lv2:symbol \"([^\"]+)\"", text)
    assert len(set(symbols)) == len(symbols) and all(re.fullmatch(r"[a-zA-Z][a-zA-Z0-9_]*", each) for each in symbols)
    assert {"free_output_gain", "G_free"} <= set(symbols) and ABOUT.presets[0].id == "free"


def test_symbols_of_ids_that_look_alike_differ_and_do_not_depend_on_the_order():
    ids = ("a-b", "a_b", "a__b", "A-b", "p-1", "1", "g", "output-gain")
    said = []
    for order in (ids, ids[::-1]):
        presets = tuple(dataclasses.replace(ABOUT.presets[0], id=each) for each in order)
        rows = [dataclasses.replace(row, part=k) for k in range(len(order)) for row in ABOUT.parameters if row.part == 0]
        setup = [dataclasses.replace(row, part=k) for k in range(len(order)) for row in ABOUT.setup if row.part == 0]
        about = dataclasses.replace(ABOUT, presets=presets, parameters=tuple(rows), setup=tuple(setup))
        text = turtle.texts(about, "collection.so")
        symbols = re.findall(r"\]?\s*lv2:symbol \"([^\"]+)\"", text["collection.ttl"])
        assert all(re.fullmatch(r"[a-zA-Z][a-zA-Z0-9_]*", each) for each in symbols)
        assert len(set(symbols)) == len(symbols) > len(ids) * 6
        said.append(set(symbols))
    assert said[0] == said[1] and {"a_b_output_gain", "a_b_string_gauge", "G_a_b", "S_a_b"} <= said[0]


def test_names_in_the_texts_are_of_one_thing_each():
    """A preset may be called as a group begins, or as the state's key ends."""
    ids = ("x", "group-x", "state")
    presets_of = [dataclasses.replace(ABOUT.presets[0], id=each) for each in ids]
    kind = dataclasses.replace(ABOUT, presets=tuple(presets_of), parameters=())
    said = turtle.texts(kind, "collection.so")
    presets = re.findall(r"^<(.*)>\n\ta pset:Preset", said["presets.ttl"], re.MULTILINE)
    assert presets == re.findall(r"^<(.*)>\n\ta pset:Preset", said["manifest.ttl"], re.MULTILINE)
    groups = re.findall(r"^<(.*)>\n\ta pg:InputGroup", said["collection.ttl"], re.MULTILINE)
    names = [*presets, *groups, f"{turtle.uri(kind)}#state"]
    assert len(names) == 9 == len(set(names))


def run(*command: str, bundles: Path) -> subprocess.CompletedProcess:
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    environment = {"PATH": "/usr/bin:/bin", "LV2_PATH": f"{bundles}:/usr/lib/lv2", "LC_ALL": "C.UTF-8"}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)


@pytest.mark.parametrize("presets", [PRESETS, PRESETS[:1]], ids=["several", "one"])
def test_the_texts_are_valid(presets, tmp_path):
    about = describe(presets)
    for name, text in turtle.texts(about, "plugin.so").items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    said = run("lv2_validate", *map(str, tmp_path.glob("*.ttl")), bundles=tmp_path)
    assert said.returncode == 0 and "Found 0 errors" in said.stdout + said.stderr, said.stdout + said.stderr
    assert "warning" not in (said.stdout + said.stderr).lower()


def test_lilv_reads_them(bundle):
    said = run("lv2info", "urn:jawari:collection", bundles=bundle.parent)
    assert said.returncode == 0, said.stderr
    assert not said.stderr, said.stderr
    for expected in ("Has latency:       yes", "http://lv2plug.in/ns/ext/state#interface", "Instrument", "Presets:"):
        assert expected in said.stdout, said.stdout
    for parameter in ABOUT.parameters:
        assert parameter.name in said.stdout


def test_a_host_runs_it(bundle):
    """lv2bench loads and runs everything that it finds, by lilv, and prints a line of seconds and URI."""
    said = run("lv2bench", "-n", "4096", "-b", "256", "urn:jawari:collection", bundles=bundle.parent)
    assert said.returncode == 0 and "urn:jawari:collection" in said.stdout, said.stdout + said.stderr


@pytest.mark.parametrize("saved", [0.0, 1.0], ids=["saved disabled", "saved enabled"])
def test_a_state_does_not_turn_the_port_enabled(make, saved):
    """The port is the host's: what a state says of it was another host's."""
    first, second = make(), make()
    first.enabled[0] = saved
    first.run(2000)
    second.enabled[0] = 1.0 - saved
    second.run(2000)
    assert second.restore(first.save()) == 0
    second.run(2000)  # in and out of it fades
    loudest = np.abs(second.run(2000, [(0, bytes([0x90, 50, 127]))])).max()
    assert (loudest > 0.0) == (saved == 0.0)
