"""`synth play` through a real PipeWire, by ALSA and by JACK: what comes to its sink is, bit for bit, the offline render.

PipeWire's own recorder drops blocks where its machine is busy (two at once drop different ones, while PipeWire counts every
period as done), and a busy machine leaves periods out: so what is recorded is compared in the pieces in which it came.
"""

from __future__ import annotations

import json
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import soundfile

from synth.live.report import LiveReport
from tests.patience import compiling_s
from tests.pipewirekit import SINK, PipeWire, Record, why_not

from .test_play import ROOT, SONG, command, start

#: of one piece, to be told from chance [frames]
LEAST = 64
START = Callable[..., PipeWire]


@pytest.fixture
def pipewire() -> Iterator[START]:
    """pipewire(quantum=…, rate_hz=…) -> PipeWire that runs until the end of the test."""
    reason = why_not()
    if reason:
        pytest.skip(reason)
    started: list[PipeWire] = []

    def start(**how: int) -> PipeWire:
        started.append(PipeWire(**how))
        return started[-1]

    try:
        yield start
    finally:
        for server in started:
            server.end()


def environment(server: PipeWire) -> dict[str, str]:
    return dict(server.env, PYTHONPATH=str(ROOT), PYTHONWARNINGS="ignore")


def synth(server: PipeWire, folder: Path, *arguments: str, jack: bool = False) -> subprocess.CompletedProcess[str]:
    if not jack:
        with start(None, folder, *arguments, env=environment(server)) as running:
            out, err = running.communicate(timeout=compiling_s())
        return subprocess.CompletedProcess(arguments, running.returncode or 0, out, err)
    wanted = server.jack(*command(*arguments))
    return subprocess.run(
        wanted,
        cwd=folder,
        env=environment(server),
        capture_output=True,
        text=True,
        timeout=compiling_s(),
        check=False,
    )


@contextmanager
def playing(
    server: PipeWire, folder: Path, *arguments: str, jack: bool
) -> Iterator[tuple[subprocess.Popen[str], list[str]]]:
    """`synth play` with a tanpura that plays by now, and the lines that it has said; it is killed at the end."""
    wanted = command("play", "-p", "tanpura-light", "--midi-in", "none", *(["--jack"] if jack else []), *arguments)
    with subprocess.Popen(
        server.jack(*wanted) if jack else wanted,
        cwd=folder,
        env=environment(server),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as running:
        try:
            assert running.stderr is not None
            said = []
            for line in running.stderr:
                said.append(line)
                if line.startswith("synth: playing"):
                    break
            yield running, said
        finally:
            running.kill()


def pieces(recorded: np.ndarray, played: np.ndarray) -> list[tuple[int, int, int]]:
    """(place recorded, place played, length) of the pieces of a recording (2, n) that are what was played, bit for bit,
    found by samples that occur but once."""
    of = [np.ascontiguousarray(x.T).view(np.int64).ravel() for x in (recorded, played)]
    values, places, counts = np.unique(of[1], return_index=True, return_counts=True)
    anchors = {int(v): int(p) for v, p in zip(values[counts == 1], places[counts == 1], strict=True)}
    found = []
    at = 0
    while at < len(of[0]):
        there = anchors.get(int(of[0][at]))
        if there is None:
            at += 1
            continue
        most = min(len(of[0]) - at, len(of[1]) - there)
        other = np.flatnonzero(of[0][at : at + most] != of[1][there : there + most])
        length = int(other[0]) if other.size else most
        if length >= LEAST:
            found.append((at, there, length))
        at += length
    return found


def check(recorded: np.ndarray, played: np.ndarray) -> None:
    """What was recorded is what was played, in its order, in pieces of which one is a second long; and nothing else."""
    found = pieces(recorded, played)
    assert found and max(length for *_, length in found) >= 44100, found
    places = [there for _, there, _ in found]
    assert places == sorted(places)
    explained = np.zeros(recorded.shape[1], bool)
    for at, _, length in found:
        explained[at : at + length] = True
    loud = np.any(recorded != 0.0, axis=0)
    # Before the first sample that occurs but once a piece may go on for a moment.
    unexplained = np.flatnonzero(loud & ~explained)
    assert len(unexplained) < LEAST * (len(found) + 1), f"{len(unexplained)} samples are none of those that were played"


WAYS = pytest.mark.parametrize("jack", [False, True], ids=["ALSA", "JACK"])


@WAYS
def test_what_comes_to_the_sink_is_what_is_rendered_offline(pipewire: START, tmp_path: Path, jack: bool) -> None:
    server = pipewire(quantum=4096)
    record = Record(server, tmp_path)
    try:
        how = ["--jack"] if jack else ["--block", "4096", "--latency", "0.4"]
        out = ["--record", "take.wav", "--bit-depth", "float", "--duration", "6", "--json", "--midi-in", "none"]
        done = synth(server, tmp_path, "play", "--play", SONG, *how, *out, jack=jack)
    finally:
        recorded = record.samples()
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["ended"] == "duration" and report["recording_lost"] == 0
    render = ["render", "take.mid", "-o", "again.wav", "--bit-depth", "float", "--quiet", "--tail", "1"]
    assert synth(server, tmp_path, *render).returncode == 0
    take, again = (
        soundfile.read(tmp_path / name, dtype="float32", always_2d=True)[0].T for name in ("take.wav", "again.wav")
    )
    np.testing.assert_array_equal(take, again[:, : take.shape[1]])
    check(recorded, again)


def test_pieces_are_found_and_what_is_none_is_seen() -> None:
    rng = np.random.default_rng(1)
    played = rng.standard_normal((2, 200_000)).astype(np.float32)
    gap = np.zeros((2, 512), np.float32)
    recorded = np.concatenate((gap, played[:, 1000:60_000], gap, played[:, 60_256:150_000]), axis=1)
    assert pieces(recorded, played) == [(512, 1000, 59_000), (60_024, 60_256, 89_744)]
    check(recorded, played)
    for wrong in (
        recorded * np.float32(0.5),  # another level
        np.concatenate((recorded, rng.standard_normal((2, 1000)).astype(np.float32)), axis=1),  # something else
        np.concatenate((played[:, 100_000:150_000], played[:, :60_000]), axis=1),  # another order
        recorded[:, ::2],  # another rate
    ):
        with pytest.raises(AssertionError):
            check(np.ascontiguousarray(wrong), played)


@WAYS
def test_the_report_has_the_frames_that_the_server_asks_for(pipewire: START, tmp_path: Path, jack: bool) -> None:
    server = pipewire(quantum=1024)
    how = ["--jack"] if jack else ["--block", "512"]
    arguments = ["play", "-p", "tanpura-light", "--midi-in", "none", "--no-virtual-port", "--duration", "1"]
    done = synth(server, tmp_path, *arguments, *how, "--json", jack=jack)
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert (report["block"], report["block_asked"]) == ((1024, 256) if jack else (512, 512))
    told = "\n".join(LiveReport(**report).lines())
    assert ("the server asked for blocks of 1024 frames, not 256" in told) == jack


def test_devices_do_not_contradict_themselves(pipewire: START, tmp_path: Path) -> None:
    server = pipewire()
    plain = synth(server, tmp_path, "devices")
    assert plain.returncode == 0 and plain.stderr == "" and "default  [ALSA]" in plain.stdout
    done = synth(server, tmp_path, "devices", jack=True)
    assert done.returncode == 0 and done.stderr == ""
    assert f"{SINK}  [JACK Audio Connection Kit]" in done.stdout
    assert "JACK server (--jack): runs at 44100 Hz" in done.stdout and "no JACK server runs" not in done.stdout
    if "no JACK server answers python-rtmidi" in done.stdout:
        assert "synth play --jack hears the MIDI ports of the JACK server below" in done.stdout


@WAYS
def test_a_server_that_dies_is_one_line_and_not_the_libraries(pipewire: START, tmp_path: Path, jack: bool) -> None:
    server = pipewire()
    with playing(server, tmp_path, jack=jack) as (running, said):
        time.sleep(1.0)
        server.kill()
        out, err = running.communicate(timeout=compiling_s())
    said += err.splitlines(keepends=True)
    assert running.returncode == 1 and all(line.startswith("synth: ") for line in said), said
    assert sum("the audio output has gone" in line for line in said) == 1
    assert "Expression" not in out


def test_periods_that_pipewire_goes_without_are_counted(pipewire: START, tmp_path: Path) -> None:
    server = pipewire(quantum=1024)
    with playing(server, tmp_path, "--json", jack=True) as (running, _):
        time.sleep(1.0)
        running.send_signal(signal.SIGSTOP)
        time.sleep(0.5)
        running.send_signal(signal.SIGCONT)
        time.sleep(1.0)
        running.send_signal(signal.SIGINT)
        out, err = running.communicate(timeout=compiling_s())
    assert running.returncode == 0, err
    # Half a second of periods went by; PipeWire's libjack tells of none.
    assert json.loads(out)["xruns"] >= 15


@WAYS
def test_latency_is_recorded_at_the_sink(pipewire: START, tmp_path: Path, jack: bool) -> None:
    server = pipewire(quantum=1024, rate_hz=48000)
    how = ["--jack"] if jack else ["-r", "48000"]
    done = synth(server, tmp_path, "play", "-p", "tanpura-light", "--measure-latency", "--json", *how, jack=True)
    assert done.returncode == 0, done.stderr
    assert all(line.startswith("synth: ") for line in done.stderr.splitlines())
    told = json.loads(done.stdout)
    recorded, computed = told["recorded"], told["first_movement"]
    assert 10 < told["heard"] <= 20 and recorded is not None  # on a busy machine some come after it has stopped listening
    assert told["heard_ms"]["median_ms"] == pytest.approx(recorded["median_ms"] + told["card_ms"])
    # It cannot be recorded before it is computed, within the server's quantum, nor after the session has stopped listening.
    assert computed["median_ms"] - 1e3 * 1024 / 48000 < recorded["median_ms"] < 300.0
