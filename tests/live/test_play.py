"""`synth play` and `synth devices` as processes of their own, on a real sound server without a sound card.

What is recorded counts the stream's frames, which go on without a gap whatever the machine does: no test depends on whether
a period was missed.
"""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

from synth import cli
from synth.engine.layout import GAIN
from synth.midi.events import CONTROL, PARAMETER
from synth.midi.song import read_song
from tests.forkserver import Forked, prepared
from tests.host.midibytes import header, track
from tests.patience import COMPILING_QUIET_S, compiling_s, patience_s, until

from .jackkit import JackServer

ROOT = Path(__file__).resolve().parents[2]
SONG = str(ROOT / "presets" / "demos" / "bassline.mid")
EXPRESSION = 11
QUIET = ["--no-virtual-port", "--midi-in", "none"]


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "synth", *arguments]


def environment(server: JackServer | None) -> dict[str, str]:
    base = (
        server.env if server is not None else dict(os.environ, JACK_DEFAULT_SERVER="jawari-nobody", JACK_NO_START_SERVER="1")
    )
    return dict(base, PYTHONPATH=str(ROOT))


def start(server: JackServer | None, folder: Path, *arguments: str, **how: Any) -> Forked:
    """`synth` with these arguments, which has its imports behind it."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return prepared().start(list(arguments), folder, **({"env": environment(server)} | pipes | how))


def synth(server: JackServer | None, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    with start(server, folder, *arguments) as running:
        out, err = running.communicate(timeout=compiling_s())
    return subprocess.CompletedProcess(arguments, running.returncode or 0, out, err)


def anew(server: JackServer | None, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The same in a new interpreter."""
    return subprocess.run(
        command(*arguments),
        cwd=folder,
        env=environment(server),
        capture_output=True,
        text=True,
        timeout=compiling_s(),
    )


def samples(path: Path) -> np.ndarray:
    return soundfile.read(path, dtype="int32", always_2d=True)[0]


def is_beginning(path: Path, whole: Path) -> bool:
    """Whether the sound of one file is, sample by sample, what the other begins with, and not silent."""
    short, long = samples(path), samples(whole)
    return 0 < len(short) <= len(long) and bool(short.any()) and np.array_equal(short, long[: len(short)])


def recorded(folder: Path) -> bool:
    """Whether a second of a take that goes on lies there."""
    return any(path.stat().st_size > 6 * 44100 for path in folder.glob(".take.wav.*"))


@pytest.fixture
def playing(jack_server) -> Iterator[Callable[..., Forked]]:
    """playing(folder, …, server=None, patch=""): `synth play …` that has recorded its first second to take.wav; a patch
    changes something in the program before."""
    begun: list[Forked] = []

    def begin(folder: Path, *arguments: str, server: JackServer | None = None, patch: str = "") -> Forked:
        running = start(server or jack_server(), folder, "play", *arguments, "--record", "take.wav", "--json", before=patch)
        begun.append(running)
        until(lambda: running.poll() is not None or recorded(folder), "a second", COMPILING_QUIET_S)
        assert running.poll() is None, running.communicate()
        return running

    yield begin
    for running in begun:
        if running.poll() is None:
            running.kill()
            running.communicate()


def test_a_song_live_is_the_song_rendered(jack_server, tmp_path) -> None:
    live = anew(jack_server(), tmp_path, "play", "--play", SONG, "--record", "take.wav", "--duration", "3", "--json")
    assert live.returncode == 0, live.stderr
    report = json.loads(live.stdout)
    assert report["ended"] == "duration" and report["notes"] > 5 and report["events_lost"] == 0
    assert report["parts"] == ["ch01-fretted-bass"] and report["files"] == ["take.wav", "take.mid"]
    assert report["played_s"] >= 3.0 and report["recording_lost"] == 0
    assert synth(None, tmp_path, "render", SONG, "-o", "song.wav", "--end", "2.9", "--quiet").returncode == 0
    # The sound is there before the fade begins, which changes it.
    song = samples(tmp_path / "song.wav")
    np.testing.assert_array_equal(samples(tmp_path / "take.wav")[: len(song) - 4410], song[:-4410])
    # The take has the fade, too.
    assert synth(None, tmp_path, "render", "take.mid", "-o", "again.wav", "--quiet", "--tail", "1").returncode == 0
    assert is_beginning(tmp_path / "take.wav", tmp_path / "again.wav")


def test_a_song_ends_when_it_has_rung_out(jack_server, tmp_path) -> None:
    events = [(0, b"\xc0\x21"), (0, b"\x90\x28\x64"), (240, b"\x80\x28\x40")]
    (tmp_path / "song.mid").write_bytes(header() + track(*events))
    done = synth(jack_server(), tmp_path, "play", "--play", "song.mid", "--record", "take.wav", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["ended"] == "song" and report["notes"] == 1
    heard = np.abs(samples(tmp_path / "take.wav")).max(axis=1)
    # Half a second of silence at the end, and no fade before it.
    assert heard.max() > 0.01 * 2**31 and heard[-20000:].max() < 1e-4 * 2**31


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_fades_and_keeps_the_take(playing, tmp_path, how: signal.Signals) -> None:
    running = playing(tmp_path, "--play", SONG)
    running.send_signal(how)
    out, err = running.communicate(timeout=compiling_s())
    assert running.returncode == 0, err
    assert "Traceback" not in err
    assert json.loads(out)["ended"] == "stopped"
    assert sorted(os.listdir(tmp_path)) == ["take.mid", "take.wav"]
    taken = np.abs(samples(tmp_path / "take.wav")).max(axis=1)
    # It comes to its end by a fade: the last moment is silent, none of the steps to it is a jump.
    assert taken.max() > 0.01 * 2**31 and taken[-256:].max() < 1e-4 * 2**31
    done = synth(None, tmp_path, "render", "take.mid", "-o", "again.wav", "--quiet", "--tail", "1")
    assert done.returncode == 0, done.stderr
    assert is_beginning(tmp_path / "take.wav", tmp_path / "again.wav")


def controls_of(path: Path, controller: int) -> np.ndarray:
    events = read_song(path, 44100).events
    return events[(events["kind"] == CONTROL) & (events["a"] == controller)]


def test_a_second_signal_ends_at_once_with_a_valid_take(playing, tmp_path) -> None:
    # A fade that nobody waits for to the end.
    running = playing(tmp_path, "--play", SONG, *QUIET, patch="from synth.live import session\nsession.FADE_S = 1e6")
    running.send_signal(signal.SIGINT)
    running.send_signal(signal.SIGTERM)
    out, err = running.communicate(timeout=compiling_s())
    assert running.returncode == 0 and "Traceback" not in err
    report = json.loads(out)
    recorded = samples(tmp_path / "take.wav")
    assert sorted(os.listdir(tmp_path)) == ["take.mid", "take.wav"]
    assert len(recorded) <= round(report["played_s"] * 44100)
    assert not len(controls_of(tmp_path / "take.mid", EXPRESSION))
    assert synth(None, tmp_path, "render", "take.mid", "-o", "again.wav", "--quiet", "--tail", "1").returncode == 0
    assert is_beginning(tmp_path / "take.wav", tmp_path / "again.wav")


def test_a_signal_while_the_recording_is_closed_loses_nothing(playing, tmp_path) -> None:
    patch = """
import signal
from synth.live.recorder import Recorder
close = Recorder.close
def interrupted(recorder):
    signal.raise_signal(signal.SIGINT)
    signal.raise_signal(signal.SIGTERM)
    close(recorder)
    signal.raise_signal(signal.SIGINT)
Recorder.close = interrupted
"""
    running = playing(tmp_path, "--play", SONG, *QUIET, patch=patch)
    running.send_signal(signal.SIGTERM)
    out, err = running.communicate(timeout=compiling_s())
    assert running.returncode == 0 and "Traceback" not in err, err
    assert json.loads(out)["files"] == ["take.wav", "take.mid"]
    assert sorted(os.listdir(tmp_path)) == ["take.mid", "take.wav"]


def test_the_fade_leaves_a_bound_expression_alone(playing, tmp_path) -> None:
    running = playing(tmp_path, "--play", SONG, "--cc", "11=pluck.position", *QUIET)
    running.send_signal(signal.SIGINT)
    err = running.communicate(timeout=compiling_s())[1]
    assert running.returncode == 0, err
    assert not len(controls_of(tmp_path / "take.mid", EXPRESSION))
    events = read_song(tmp_path / "take.mid", 44100).events
    gains = events["value"][(events["kind"] == PARAMETER) & (events["a"] == GAIN)]
    assert len(gains) > 1 and (np.diff(gains) < 0.0).all()
    taken = np.abs(samples(tmp_path / "take.wav")).max(axis=1)
    assert taken.max() > 0.01 * 2**31 and taken[-256:].max() < 1e-4 * 2**31
    arguments = ["--cc", "11=pluck.position", "-o", "again.wav", "--quiet", "--tail", "1"]
    assert synth(None, tmp_path, "render", "take.mid", *arguments).returncode == 0
    assert is_beginning(tmp_path / "take.wav", tmp_path / "again.wav")


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_a_terminal_that_is_closed_ends_it_and_leaves_the_take(jack_server, tmp_path) -> None:
    import fcntl
    import pty
    import termios

    master, slave = pty.openpty()

    def own_the_terminal() -> None:
        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
        signal.signal(signal.SIGHUP, signal.SIG_DFL)

    running = subprocess.Popen(
        command("play", "--play", SONG, "--record", "take.wav", "--keys", *QUIET),
        cwd=tmp_path,
        env=environment(jack_server()),
        stdin=slave,
        stdout=slave,
        stderr=slave,
        preexec_fn=own_the_terminal,
    )
    os.close(slave)
    said = b""
    try:
        begun = time.monotonic()
        while not recorded(tmp_path):
            assert running.poll() is None and time.monotonic() - begun < compiling_s(), said
            if select.select([master], [], [], 0.05)[0]:
                said += os.read(master, 4096)
        os.close(master)  # the kernel sends SIGHUP, and nothing can be written to the terminal any more
        assert running.wait(patience_s()) == 0
    finally:
        running.kill()
        running.wait()
    assert b"REC 0:0" in said
    assert sorted(os.listdir(tmp_path)) == ["take.mid", "take.wav"]
    taken = np.abs(samples(tmp_path / "take.wav")).max(axis=1)
    assert taken.max() > 0.01 * 2**31 and taken[-256:].max() < 1e-4 * 2**31


@pytest.mark.parametrize("how", [[], ["--jack", "instrument"]], ids=["portaudio", "jack"])
def test_a_server_that_dies_leaves_the_take_and_exit_1(playing, jack_server, tmp_path, how: list[str]) -> None:
    server = jack_server()
    running = playing(tmp_path, "--play", SONG, *how, server=server)
    server.kill()
    out, err = running.communicate(timeout=compiling_s())
    assert running.returncode == 1, err
    assert "has gone; the recording is kept" in err and "has not come back" in err
    assert "Traceback" not in err
    assert json.loads(out)["ended"] == "device"
    assert sorted(os.listdir(tmp_path)) == ["take.mid", "take.wav"]
    assert synth(None, tmp_path, "render", "take.mid", "-o", "again.wav", "--quiet", "--tail", "1").returncode == 0
    assert is_beginning(tmp_path / "take.wav", tmp_path / "again.wav")


def test_jack_itself_as_output(jack_server, tmp_path) -> None:
    arguments = ["--play", SONG, "--jack", "instrument", "--record", "take.wav", "--duration", "2", "--json"]
    done = anew(jack_server(), tmp_path, "play", *arguments)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["output"].startswith("instrument") and report["ended"] == "duration"
    assert synth(None, tmp_path, "render", "take.mid", "-o", "again.wav", "--quiet", "--tail", "1").returncode == 0
    assert is_beginning(tmp_path / "take.wav", tmp_path / "again.wav")


@pytest.mark.parametrize("how", [[], ["--jack"]], ids=["portaudio", "jack"])
def test_latency_is_measured_through_a_midi_port(jack_server, tmp_path, how: list[str]) -> None:
    done = synth(jack_server(), tmp_path, "play", "-p", "tanpura-light", "--measure-latency", "--json", *how)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["path"] == "JACK MIDI port" and told["note"] == "C3" and told["plucks"] == 20
    assert 10 <= told["heard"] <= 20  # on a busy machine one may come later than it is listened for
    # What must be so on any machine: the string is felt after the engine has looked ahead, the peak comes after the finger
    # has let go, and all of a note's way is longer than a part of it.
    for which in ("median_ms", "worst_ms"):
        assert 0.0 < told["placed"][which]
        assert told["placed"][which] + told["engine_ms"] < told["first_movement"][which] < told["peak"][which]
        assert told["total"][which] == pytest.approx(told["first_movement"][which] + told["device_ms"])
    assert told["peak"]["median_ms"] > told["placed"]["median_ms"] + told["engine_ms"] + told["draw_ms"]


@pytest.mark.parametrize("how", [[], ["--jack"]], ids=["portaudio", "jack"])
def test_a_measurement_can_be_broken_off(jack_server, tmp_path, how: list[str]) -> None:
    server = jack_server()
    running = start(server, tmp_path, "play", "-p", "tanpura-light", "--measure-latency", *how)
    try:
        assert running.stderr is not None
        assert any(line.startswith("synth: measuring") for line in running.stderr)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=compiling_s())
    finally:
        running.kill()
    assert (running.returncode, out, err) == (130, "", "synth: interrupted\n")


def refused(done: subprocess.CompletedProcess[str], folder: Path, *said: str) -> None:
    assert done.returncode == 2 and done.stdout == ""
    last = done.stderr.splitlines()[-1]
    assert last.startswith("synth: error: ") and "Traceback" not in done.stderr
    for text in said:
        assert text in last
    assert os.listdir(folder) == []


def test_devices_that_are_not_there_or_refuse(jack_server, tmp_path) -> None:
    server = jack_server()
    record = ["--record", "take.wav"]
    refused(synth(server, tmp_path, "play", "--device", "organ", *record), tmp_path, "--device 'organ'", "0 system")
    refused(synth(server, tmp_path, "play", "--device", "77", *record), tmp_path, "--device '77'")
    refused(synth(server, tmp_path, "play", "-r", "96000", *record), tmp_path, "does not support 96000 Hz", "--rate 44100")
    refused(synth(server, tmp_path, "play", "-r", "96000", "--jack", *record), tmp_path, "44100 Hz", "--rate")
    none = synth(None, tmp_path, "play", "--jack", *record)
    refused(none, tmp_path, "no JACK server answers", "start one, like jackd -d", "without --jack")


def test_files_and_ports_are_judged_before_the_device(jack_server, tmp_path) -> None:
    """The device does not exist either."""
    organ = ["--device", "organ"]
    for arguments, problem in [
        (["play", "-p", "nothing.toml"], "nothing.toml"),
        (["play", "--tuning", "nothing.scl"], "nothing.scl"),
        (["play", "--play", "nothing.mid"], "nothing.mid"),
        (["play", "--record", "nowhere/take.wav"], "nowhere/take.wav: there is no directory nowhere"),
        (["play", "--midi-in", "harmonium"], "--midi-in: the"),
        (["drone", "--record", "nowhere/take.wav"], "nowhere/take.wav: there is no directory nowhere"),
        (["drone", "-p", "nothing.toml"], "nothing.toml"),
    ]:
        refused(synth(None, tmp_path, *arguments, *organ), tmp_path, problem)


def test_a_midi_port_that_is_not_there_leaves_an_earlier_take(jack_server, tmp_path) -> None:
    server = jack_server()
    (tmp_path / "take.wav").write_bytes(b"of yesterday")
    for how in ([], ["--jack"]):
        done = synth(server, tmp_path, "play", "--midi-in", "harmonium", "--record", "take.wav", *how)
        assert done.returncode == 2
        (said,) = done.stderr.splitlines()  # nothing has been prepared, let alone opened
        assert said.startswith("synth: error: --midi-in: there is no MIDI port 'harmonium'; there are ")
        assert os.listdir(tmp_path) == ["take.wav"] and (tmp_path / "take.wav").read_bytes() == b"of yesterday"


def test_no_device_at_all(tmp_path) -> None:
    listed = synth(None, tmp_path, "devices", "--json")
    assert listed.returncode == 0
    if json.loads(listed.stdout)["outputs"]:
        pytest.skip("this machine has a sound card")
    refused(synth(None, tmp_path, "play"), tmp_path, "there is no audio output", "synth render")
    told = synth(None, tmp_path, "devices")
    assert told.returncode == 0 and "synth render" in told.stdout and told.stderr == ""


def test_a_song_that_is_none(jack_server, tmp_path_factory) -> None:
    songs, folder = tmp_path_factory.mktemp("songs"), tmp_path_factory.mktemp("folder")
    (songs / "broken.mid").write_bytes(Path(SONG).read_bytes()[:90])
    refused(synth(jack_server(), folder, "play", "--play", str(songs / "broken.mid")), folder, "broken.mid: ", "cut off")
    (songs / "empty.mid").write_bytes(header() + track())
    refused(synth(jack_server(), folder, "play", "--play", str(songs / "empty.mid")), folder, "nothing to play")


def test_devices_are_listed(jack_server, tmp_path) -> None:
    done = synth(jack_server(), tmp_path, "devices", "--json")
    assert done.returncode == 0 and done.stderr == ""
    found = json.loads(done.stdout)
    (output,) = [each for each in found["outputs"] if each["host_api"] == "JACK Audio Connection Kit"]
    assert output["name"] == "system" and output["channels"] == 2 and output["default_rate_hz"] == 44100.0
    assert found["jack"] == {"rate_hz": 44100}
    told = synth(jack_server(), tmp_path, "devices")
    assert told.returncode == 0
    assert "system  [JACK Audio Connection Kit]  2 channels, 44100 Hz" in told.stdout
    assert "JACK server (--jack): runs at 44100 Hz" in told.stdout


WRONG = [
    (["--device", "0", "--jack"], "give one of them"),
    (["--measure-latency", "--record", "x.wav"], "--measure-latency plays its own notes"),
    (["--record", "x.mp3"], "must be a .wav file, got 'x.mp3'"),
    (["--block", "8"], "from 16 to 4096, got '8'"),
    (["--latency", "tiny"], "(or low or high), got 'tiny'"),
    (["--midi-channel", "17"], "from 1 to 16, got '17'"),
    (["--ahead", "-1"], "from 0 to 64, got '-1'"),
    (["--cc", "74"], "is not CONTROLLER=PARAMETER"),
    (["--cc", "74=pluck.colour"], "pluck.colour"),
    (["--map", "1"], "not CHANNEL=PRESET"),
    (["--duration", "0"], "got '0'"),
    (["--keys"], "--keys: standard input is not a terminal"),
]


@pytest.mark.parametrize(("arguments", "problem"), WRONG, ids=lambda value: " ".join(value) if type(value) is list else "")
def test_wrong_usage_is_one_line_and_exit_2(tmp_path, monkeypatch, capsys, arguments: list[str], problem: str) -> None:
    monkeypatch.chdir(tmp_path)
    with open(os.devnull) as nothing:
        kept = os.dup(0)
        os.dup2(nothing.fileno(), 0)
        try:
            code = cli.main(["play", *arguments])
        except SystemExit as end:
            code = end.code
        finally:
            os.dup2(kept, 0)
            os.close(kept)
    said = capsys.readouterr()
    assert code == 2 and said.out == ""
    assert said.err.startswith("synth: error: ") and problem in said.err and said.err.count("\n") == 1
    assert os.listdir(tmp_path) == []


def test_help_loads_nothing_heavy() -> None:
    program = (
        "import sys\nfrom synth.cli import main\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit as end:\n    assert not end.code\n"
        "heavy = {'numba', 'numpy', 'sounddevice', 'rtmidi', 'jack'} & set(sys.modules)\nassert not heavy, heavy"
    )
    for arguments in (["play", "--help"], ["devices", "--help"]):
        done = subprocess.run(
            [sys.executable, "-c", program, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=patience_s()
        )
        assert done.returncode == 0, done.stderr
