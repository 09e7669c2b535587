"""Another setup for a plugin that plays: shown, made by Python where that is there, and never at the cost of the sound."""

from __future__ import annotations

import contextlib
import os
import signal
import stat
import subprocess
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from synth.engine.engine import Engine
from synth.instrument.preset import Preset, load_preset
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, TUNING
from synth.plugin import bankfile
from synth.plugin.setup import set_up, setup_of
from tests import patience
from tests.engine.kit import BRIDGE, FREE, NECK
from tests.plugin import clapabi as abi
from tests.plugin import dronekit
from tests.plugin.claphost import Host, Instance
from tests.plugin.clapkit import GAIN, PARTS, hear, parameter_id, plugin_file, reference, truth

RATE, SIZE = 44100.0, 256
CHORD = [(10, NOTE_ON, 0, 48, 100), (700, NOTE_ON, 0, 50, 60), (3000, NOTE_OFF, 0, 48, 0)]
GAUGE = "free/string.gauge"
ACTION = "neck/obstacle.action"
FIXED = "1 × (fixed: needs Python with jawari to change; export again)"


@pytest.fixture(scope="module")
def clap(library_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plugin_file(library_file, tmp_path_factory.mktemp("clap"))


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's cache, with the kernels that there are."""
    folder = tmp_path / "cache"
    (folder / "jawari").mkdir(parents=True)
    before = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "jawari"
    for each in before.glob("kernels-*"):
        (folder / "jawari" / each.name).symlink_to(each)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    monkeypatch.setenv("PYTHONPATH", str(Path(bankfile.__file__).parents[2]))
    return folder / "jawari"


@pytest.fixture
def with_python(cache: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("JAWARI_PYTHON", sys.executable)
    return cache


@pytest.fixture
def host(clap: Path) -> Iterator[Host]:
    with Host(clap) as made:
        yield made


def pretend(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> Path:
    """A program in the place of Python: $6 is where the bank is to go."""
    path = folder / "python"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    monkeypatch.setenv("JAWARI_PYTHON", str(path))
    return path


def number(instance: Instance, identity: str = GAUGE) -> Any:
    """What a host knows of a number of the setup."""
    rows = [(part, each.id) for part, preset in enumerate(PARTS) for each in setup_of(0, preset)]
    shown = [info for info in instance.params if info.module.endswith(b"/Setup")]
    preset, _, name = identity.partition("/")
    part = next(part for part, each in enumerate(PARTS) if each.name == preset)
    return shown[rows.index((part, name))]


def says(instance: Instance, identity: str = GAUGE) -> str:
    info = number(instance, identity)
    return instance.text(info.id, instance.value(info.id))


def turn(instance: Instance, **values: float) -> None:
    """free__string_gauge=1.3"""
    given = {number(instance, name.replace("__", "/").replace("_", ".")).id: value for name, value in values.items()}
    instance.flush([abi.param(0, identity, value) for identity, value in given.items()])


def playing(host: Host) -> Instance:
    made = host.instance()
    assert made.activate(RATE)
    made.start()
    return made


def settle(made: Instance, identity: str = GAUGE, frames: int = SIZE) -> np.ndarray:
    """Blocks until a number is played, or is said why not; (frames, 2)."""
    heard = []
    patience.until(
        lambda: "being made" not in says(made, identity),
        "the bank has not come",
        meanwhile=lambda: heard.append(made.process([], frames)),
    )
    return np.concatenate([*heard, hear(made, [], 8 * SIZE)])  # what fades has faded


def with_gauge(factor: float) -> tuple[Preset, ...]:
    return set_up(FREE, {"string.gauge": factor}), BRIDGE, NECK


# --- without Python -------------------------------------------------------------------------------------------------------


def test_it_is_shown_and_cannot_be_turned(host: Host) -> None:
    made = playing(host)
    for info in made.params:
        fixed = info.module.endswith(b"/Setup")
        assert bool(info.flags & abi.READONLY) == fixed and bool(info.flags & abi.AUTOMATABLE) != fixed
        if fixed:
            text = made.text(info.id, info.initial)
            assert "(fixed: needs Python" in text and made.number(info.id, text) == pytest.approx(info.initial, rel=1e-5)
    shown = [(info.name.decode(), info.initial) for info in made.params if info.module.endswith(b"/Setup")]
    assert shown == [(each.name, each.default) for preset in PARTS for each in setup_of(0, preset)]
    assert says(made) == FIXED
    made.process([abi.param(5, number(made).id, 1.5)], SIZE)
    turn(made, free__string_gauge=1.7)
    assert says(made) == FIXED and made.value(number(made).id) == 1.0


def test_a_song_of_another_setup_plays_as_compiled_and_says_so(host: Host, clap: Path) -> None:
    made = playing(host)
    data = other_setup(made.save(), {"free/string.gauge": 1.5})
    assert made.load(data)
    assert "saved with another setup (free/string.gauge=1.5)" in made.logged[-1]
    assert says(made) == "1.5 × (not played, but 1: needs Python with jawari; install it and export again)"
    np.testing.assert_array_equal(hear(made, CHORD, 4096), truth(reference(), CHORD, 4096))
    with Host(clap) as second:  # and is kept for where it can be played
        again = second.instance()
        assert again.load(made.save()) and again.value(number(again).id) == 1.5


def other_setup(state: bytes, values: dict[str, float]) -> bytes:
    """A state with other values, and its checksum."""
    data = bytearray(state)
    for name, value in values.items():
        at = data.index(name.encode()) + len(name)
        data[at : at + 8] = np.float64(value).tobytes()
    data[-4:] = zlib.crc32(data[:-4]).to_bytes(4, "little")
    return bytes(data)


@pytest.mark.parametrize("kind", ["anybody may write it", "in a folder for anybody", "another's", "no program", "no path"])
def test_what_is_not_to_be_trusted_is_not_run(kind: str, host: Host, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran = cache / "ran"
    program = pretend(cache, monkeypatch, f"touch {ran}")
    assert not number(host.instance()).flags & abi.READONLY
    if kind == "anybody may write it":
        program.chmod(0o757)
    elif kind.startswith("in a folder"):
        cache.chmod(0o777)
    elif kind == "another's":
        if os.geteuid() != 0:
            pytest.skip("only root gives files away")
        os.chown(program, 65534, 65534)
    elif kind == "no program":
        program.chmod(0o644)
    else:
        monkeypatch.chdir(cache)
        monkeypatch.setenv("JAWARI_PYTHON", "./python")
    made = playing(host)
    assert number(made).flags & abi.READONLY
    turn(made, free__string_gauge=1.5)
    assert not ran.exists()


# --- with Python ----------------------------------------------------------------------------------------------------------


def test_a_number_is_turned_while_it_plays(host: Host, with_python: Path) -> None:
    made = playing(host)
    assert not number(made).flags & (abi.READONLY | abi.AUTOMATABLE)
    before = truth(engine := reference(), CHORD[:2], 4096)
    np.testing.assert_array_equal(hear(made, CHORD[:2], 4096), before)
    turn(made, free__string_gauge=1.5)
    assert says(made) == "1.5 × (1 plays, this is being made)"
    callbacks = made.callbacks
    heard = settle(made)
    assert says(made) == "1.5 ×" and made.callbacks > callbacks and not made.logged
    made.on_main_thread()
    # until it goes over, bit for bit what it was; then that fades within 20 ms and is gone
    still = truth(engine, [], len(heard))
    same = int(np.argmax(np.any(heard != still, axis=1)))
    assert same % SIZE == 0
    gone = same + int(np.ceil(0.02 * RATE))
    assert np.abs(heard[gone:]).max() < 1e-9 < np.abs(still[gone:]).max()
    share = heard[same:gone, 0] / still[same:gone, 0]
    ramp = 1.0 - np.arange(1, gone - same + 1) / np.ceil(0.02 * RATE)
    loud = np.abs(still[same:gone, 0]) > 1e-3
    np.testing.assert_allclose(share[loud], ramp[loud], rtol=0, atol=1e-6)
    # what is played from now on is the other instrument, bit for bit
    np.testing.assert_array_equal(hear(made, CHORD, 8192), truth(reference(parts=with_gauge(1.5)), CHORD, 8192))
    (kept,) = with_python.glob("banks/*")
    assert stat.S_IMODE(kept.stat().st_mode) == 0o600 and stat.S_IMODE(kept.parent.stat().st_mode) == 0o700


def test_what_was_set_goes_over_with_it(host: Host, with_python: Path) -> None:
    """Controllers, programs, tunings and live parameters."""
    settings = [
        (0, CONTROL, 0, 7, 90, 0.0),
        (0, CONTROL, 0, 10, 20, 0.0),
        (0, TUNING, 0, 50, 1, 50.37),
        (0, PARAMETER, 0, GAIN, 0, 0.6),
    ]
    made = playing(host)
    hear(made, settings, 1 << 16)
    turn(made, free__tuning_a4=430.0)
    settle(made, "free/tuning.a4")
    parts = (set_up(FREE, {"tuning.a4": 430.0}), BRIDGE, NECK)
    engine = reference(parts=parts)
    truth(engine, settings, 1 << 16)  # smoothed values are where they go
    expected = truth(engine, CHORD, 8192)
    heard = hear(made, CHORD, 8192)
    np.testing.assert_allclose(heard, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    assert made.value(parameter_id(made, 0, GAIN)) == 0.6


def test_the_same_again_comes_from_the_cache(host: Host, with_python: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = playing(host)
    turn(first, free__string_gauge=1.25)
    settle(first)
    expected = truth(reference(parts=with_gauge(1.25)), CHORD, 4096)
    pretend(with_python, monkeypatch, f"touch {with_python / 'ran'}")
    second = host.instance()
    turn(second, free__string_gauge=1.25)
    second.activate(RATE)  # at once: it begins with it
    second.start()
    assert says(second) == "1.25 ×"
    np.testing.assert_array_equal(hear(second, CHORD, 4096), expected)
    turn(second, free__string_gauge=1.0)  # the plugin's own
    settle(second)
    np.testing.assert_array_equal(hear(second, CHORD, 4096), truth(reference(), CHORD, 4096))
    assert not (with_python / "ran").exists()


def test_a_state_gets_its_bank(host: Host, with_python: Path) -> None:
    made = playing(host)
    turn(made, free__string_gauge=0.8)
    settle(made)
    data = made.save()
    for other in (playing(host), host.instance()):
        if other.stage != "inactive":
            hear(other, CHORD[:2], 4096)
        assert other.load(data)
        if other.stage == "inactive":
            other.activate(RATE)
            other.start()
        assert not hear(other, [], 4096)[1000:].any()
        assert says(other) == "0.8 ×" and not other.logged
        made.reset()
        hear(made, [], 4096)
        np.testing.assert_array_equal(hear(other, CHORD, 4096), hear(made, CHORD, 4096))


def test_a_state_gets_a_bank_that_is_not_in_the_cache(host: Host, with_python: Path) -> None:
    made = playing(host)
    assert made.load(other_setup(made.save(), {"bridge/obstacle.jiva": 1.5, "neck/string.losses": 2.0}))
    settle(made, "bridge/obstacle.jiva")
    parts = (FREE, set_up(BRIDGE, {"obstacle.jiva": 1.5}), set_up(NECK, {"string.losses": 2.0}))
    engine = reference(parts=parts)
    rows = [(0, 5, c, 1, 0, 0.0) for c in range(16)]
    hear(made, rows, SIZE)
    truth(engine, rows, SIZE)
    np.testing.assert_array_equal(hear(made, CHORD, 4096), truth(engine, CHORD, 4096))


def test_many_wishes_are_one(host: Host, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = cache / "asked"
    pretend(cache, monkeypatch, f'echo "$7" >> {asked}; echo no such thing; exit 2')
    made = playing(host)
    for k in range(100):
        turn(made, free__string_gauge=1.0 + 0.005 * (k + 1))
    settle(made)
    lines = asked.read_text().splitlines()
    assert lines[-1] == f"{GAUGE}=1.5" and len(lines) < 100


# --- what goes wrong ------------------------------------------------------------------------------------------------------

WRONG = {
    "echo warming up; echo the strings are gone 1>&2; exit 2": "the strings are gone",
    "kill -9 $$": "there is no bank of it in the cache, or it is not the user's alone",
    "exit 0": "there is no bank of it in the cache, or it is not the user's alone",
    'umask 077; mkdir -p "$(dirname "$6")"; echo nonsense > "$6"': "there is no bank in",
    'umask 077; mkdir -p "$(dirname "$6")"; cp "$3" "$6"; chmod 666 "$6"': "it is not the user's alone",
    'umask 077; mkdir -p "$(dirname "$6")"; cp "$3" "$6"; chmod 620 "$6"': "it is not the user's alone",
    'umask 077; mkdir -p "$(dirname "$6")"; cp "$3" "$6"; chmod 770 "$(dirname "$6")"': "it is not the user's alone",
    "exec sleep 1000": "Python took longer than 1 s and was ended",
    "exec /nowhere/python": "not found",
}


def children() -> set[str]:
    """Process numbers of this process's children, those that have ended and were not waited for among them."""
    return {child for listed in Path("/proc/self/task").glob("*/children") for child in listed.read_text().split()}


@pytest.mark.parametrize("script", WRONG)
def test_it_plays_on_where_that_fails(script: str, host: Host, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAWARI_PYTHON_TIMEOUT", "1")
    pretend(cache, monkeypatch, script)
    made, engine, before = playing(host), reference(), children()
    np.testing.assert_array_equal(hear(made, CHORD, 4096), truth(engine, CHORD, 4096))
    turn(made, free__string_gauge=1.5)
    heard = settle(made)
    np.testing.assert_array_equal(heard, truth(engine, [], len(heard)))
    assert says(made).startswith("1.5 × (1 plays: ") and WRONG[script] in says(made)
    made.on_main_thread()
    assert len(made.logged) == 1 and WRONG[script] in made.logged[0]
    turn(made, free__string_gauge=1.0)
    settle(made)
    assert says(made) == "1 ×"
    made.close()
    assert children() <= before, "none is left behind"


def test_what_cannot_be_is_told_in_words(host: Host, with_python: Path) -> None:
    made = playing(host)
    made.flush([abi.param(0, number(made, ACTION).id, 0.5)])
    settle(made, ACTION)
    assert "plays: neck: obstacle.action_12th_mm: string E1" in says(made, ACTION)


def test_a_full_disk(host: Host, with_python: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a limit on the size of files, which writes fail at likewise."""
    pretend(with_python, monkeypatch, f'ulimit -f 8; exec "{sys.executable}" "$@"')
    made = playing(host)
    turn(made, free__string_gauge=1.5)
    settle(made)
    assert "plays: " in says(made) and "limit of the file system" in says(made)
    assert not list(with_python.glob("banks/.*")) and not list(with_python.glob("banks/*"))


def test_a_host_that_waits_for_no_child(host: Host, with_python: Path) -> None:
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    try:
        made = playing(host)
        turn(made, free__string_gauge=1.1)
        settle(made)
        assert says(made) == "1.1 ×"
    finally:
        signal.signal(signal.SIGCHLD, before)


def test_a_process_gets_nothing_of_the_hosts(host: Host, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No file, no signal that is ignored or blocked, no library that is put before others."""
    told = cache / "told"
    monkeypatch.setenv("PYTHONHOME", "/nowhere")
    monkeypatch.setenv("LD_LIBRARY_PATH", "/nowhere")
    looks = "ls /proc/self/fd; env; grep -E 'SigBlk|SigIgn' /proc/self/status"
    pretend(cache, monkeypatch, f"({looks}) > {told}")
    with open(cache / "held", "w") as held:
        os.set_inheritable(held.fileno(), True)
        before = signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        made = playing(host)
        turn(made, free__string_gauge=1.5)
        settle(made)
        signal.signal(signal.SIGPIPE, before)
    text = told.read_text()
    files = [int(line) for line in text.splitlines() if line.isdecimal()]
    assert set(files) <= {0, 1, 2, 3}, "ls has its own"
    assert "/nowhere" not in text
    masks = [int(line.split()[1], 16) for line in text.splitlines() if line.startswith("Sig")]
    own = 1 << signal.SIGRTMIN - 1  # those below are the C library's, for itself
    assert len(masks) == 2 and not any(mask % (own >> 2) for mask in masks)


def test_it_ends_with_its_host(clap: Path, cache: Path) -> None:
    command = [sys.executable, "-m", "synth.plugin.rebuild", clap, "0", "44100", cache / "out", "free/string.gauge=1.5"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdin is not None
        child.stdin.close()
        assert child.wait(patience.patience_s()) == 2
    assert not (cache / "out").exists()


def test_closed_while_it_is_being_made(clap: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun = cache / "begun"
    pretend(cache, monkeypatch, f"echo $$ > {begun}; exec sleep 1000")
    with Host(clap) as host:
        made = playing(host)
        turn(made, free__string_gauge=1.5)
        patience.until(lambda: begun.exists() and begun.read_text().endswith("\n"))
        made.close()
        with pytest.raises(ProcessLookupError):
            os.kill(int(begun.read_text()), 0)


def test_random_hosts_that_turn_it(clap: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Banks come at any time; the audio thread still takes no lock and allocates nothing."""
    banks = cache / "made"
    banks.mkdir()
    for rate in (44100, 48000):
        (banks / f"{rate}").write_bytes(bankfile.bank(PARTS, [float(rate)]))
    copied = f'cp {banks}/$5 "$6.part"; chmod 600 "$6.part"; mv "$6.part" "$6"'
    pretend(cache, monkeypatch, f'mkdir -p "$(dirname "$6")"; {copied}')
    tool = Path(__file__).resolve().parents[2] / "tools" / "plugin-fuzz"
    command = [sys.executable, tool, "--actions", "1000", "--plugin", clap]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "violations: 0" in done.stdout, done.stdout + done.stderr
    assert list((cache / "banks").glob("*.jawari"))
    if "libasan" not in os.environ.get("LD_PRELOAD", ""):  # which has an allocator of its own
        assert "allocated 0, freed 0, locked 0, opened 0" in done.stdout


def test_banks_that_are_too_many_go(tmp_path: Path) -> None:
    from synth.plugin.rebuild import clear

    for k in range(6):
        path = tmp_path / f"{k}.jawari"
        path.write_bytes(bytes(100))
        os.utime(path, (k, k))
    (tmp_path / "else").write_bytes(bytes(1000))
    clear(tmp_path, tmp_path / "0.jawari", 300)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["0.jawari", "4.jawari", "5.jawari", "else"]


def test_where_the_export_says_python_is(clap: Path, cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file that exports write, and not for a plugin of other kernels."""
    from synth.plugin import python_record

    monkeypatch.delenv("JAWARI_PYTHON")
    with Host(clap) as host:
        assert number(host.instance()).flags & abi.READONLY
    python_record.write()
    with Host(clap) as host:
        made = playing(host)
        assert not number(made).flags & abi.READONLY
        turn(made, free__string_gauge=1.2)
        settle(made)
        assert says(made) == "1.2 ×"
    python_record.path().rename(cache / "python-0000000000000000")
    with Host(clap) as host:
        assert number(host.instance()).flags & abi.READONLY


def test_presets_of_the_program(library_file: Path, tmp_path: Path, with_python: Path) -> None:
    tanpura = load_preset("tanpura-light")
    clap = plugin_file(library_file, tmp_path, [tanpura], (RATE,))
    with Host(clap) as host:
        made = playing(host)
        info = next(info for info in made.params if info.name == b"Thread (jiva)")
        made.flush([abi.param(0, info.id, 15.0)])
        with contextlib.suppress(ValueError):
            patience.until(lambda: made.text(info.id, 15.0) == "15 µm", meanwhile=lambda: made.process([], SIZE))
        hear(made, [], 4096, parts=[tanpura])
        rows = [(0, NOTE_ON, 0, 43, 110)]
        engine = reference(parts=(set_up(tanpura, {"obstacle.jiva": 15.0}),))
        np.testing.assert_array_equal(hear(made, rows, 8192, parts=[tanpura]), truth(engine, rows, 8192))


def test_a_drone_plays_on_with_another_setup(library_file: Path, tmp_path: Path, with_python: Path) -> None:
    """Its score stays the plugin's own, and so does the concert pitch: it tunes its keys by itself."""
    strings, frames = dronekit.DRONE.strings, 150_000
    path = dronekit.plugin_file(library_file, tmp_path, [RATE])
    with Host(path) as host:
        first, second = host.instance(), host.instance()
        shown = [info.name.decode() for info in first.params if info.module.endswith(b"/Setup")]
        assert shown == [each.name for each in setup_of(0, strings.preset, tuned=True)] and "Concert pitch" not in shown
        number = next(info for info in first.params if info.name == b"String gauge")
        mode = next(info for info in first.params if info.name == b"Drone")
        for made in (first, second):  # the second begins with what the first has made
            made.flush([abi.param(0, number.id, 1.2), abi.param(0, mode.id, float(dronekit.ON))])
            assert made.activate(RATE)
            made.start()
            patience.until(
                lambda made=made: made.text(number.id, 1.2) == "1.2 ×",
                "the bank has not come",
                meanwhile=lambda made=made: made.process([], SIZE),
            )
        second.reset()
        heard = hear(second, [], frames)
    engine = Engine([set_up(strings.preset, {"string.gauge": 1.2})], warn=lambda text: None)
    engine.prepare(RATE, 4096)
    assert np.array_equal(heard, dronekit.truth(engine, dronekit.of_drone(frames), frames))
