"""The JACK client against a real server: MIDI comes from one process, sound goes to another, samples must be the offline
engine's, bit for bit, and every event at its frame."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from synth.live import jackclient, jackserver
from synth.live.deck import Deck
from synth.live.errors import DeviceError
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, TUNING, decode
from synth.midi.sysex import of_tuning
from tests.engine import kit
from tests.forkserver import Forked, prepared
from tests.patience import patience_s, until

from .conftest import StartServer
from .jackkit import HERE, Capture, JackServer, Recorded, Sender

pytest.importorskip("jack")

MASK = 0xFFFFFFFF
Rows = list[tuple[int, bytes]]


@dataclass
class Run:
    """What was sent, what the engine was given, and what was heard.

    frames   of the stream at which each message was sent
    first    where in `heard` the stream begins
    """

    frames: list[int]
    events: np.ndarray
    first: int
    heard: Recorded


def begin(output: jackclient.JackOutput) -> int:
    """JACK's frame time at which the stream began."""
    while True:
        jumped, latest = output.frames_jumped, output.first_frame_time
        if jumped == output.frames_jumped:
            return (latest - jumped) & MASK


def ran(deck: Deck, output: jackclient.JackOutput, capture: Capture, times: list[int], events: int = 0) -> Run:
    """What has been played once the recorder stops; `times`: JACK's frame time of every message; `events`: how many the
    engine is given at least, for those that a thread hands over whenever it gets its turn."""
    given = [deck.drain_events()]

    def arrived() -> bool:
        given.append(deck.drain_events())
        return sum(some.size for some in given) >= events

    until(arrived, f"fewer than {events} events")
    began = begin(output)
    heard = capture.stop()
    meters = deck.meters()
    assert meters.events_lost == output.messages_lost == meters.recording_lost == 0
    first = heard.place(began)
    return Run([heard.place(time) - first for time in times], np.concatenate(given), first, heard)


def run(
    server: JackServer,
    folder: Path,
    parts: tuple,
    rows: Rows,
    *,
    stems: bool = False,
    more_frames: int = 8192,
    events: int = 0,
) -> Run:
    """Play rows (frame, bytes) through JACK and record every output."""
    deck = Deck(kit.engine(*parts), record=True, stems=stems)
    output = jackclient.open_output(deck, server=server.name)
    try:
        capture = Capture(server, output.ports[1:], folder)
        capture.connected()
        output.start()
        times = Sender(server, output.ports[0], rows, folder).done()
        last = deck.frame
        until(lambda: deck.frame > last + more_frames)
        return ran(deck, output, capture, times, events)
    finally:
        output.close()
        deck.close()


def check(found: Run, expected: np.ndarray) -> None:
    """What was heard is silence before the stream and then `expected` (ports, frames), to the last bit."""
    before, samples = found.first, found.heard.samples
    frames = min(samples.shape[1] - before, expected.shape[1])
    assert 0 < before < samples.shape[1] and frames > 8192
    assert not samples[:, :before].any()
    wanted = expected[:, :frames].astype(np.float32)
    assert np.abs(wanted).max(axis=1).min() > 1e-3
    differing = np.flatnonzero((samples[:, before : before + frames].view(np.uint32) != wanted.view(np.uint32)).any(axis=0))
    assert differing.size == 0, f"{differing.size} frames differ, the first is {differing[0]}"


def played(found: Run) -> list[tuple]:
    return [tuple(event)[:5] for event in found.events.tolist()]


def phrase(seed: int, channels: int, notes: tuple[int, int]) -> Rows:
    """Half a second of everything, some of it at one frame and some a frame apart."""
    rng = np.random.default_rng(seed)
    rows: Rows = []
    for channel in range(channels):
        rows.append((0, bytes((0x90 | channel, notes[0], 100))))
    frames = np.sort(rng.integers(1, 22050, 60))
    frames[10:14] = frames[10]
    frames[20:24] = frames[20] + np.arange(4)
    for frame in np.sort(frames):
        channel, note, value = (
            int(rng.integers(low, high)) for low, high in ((0, channels), (notes[0], notes[1] + 1), (0, 128))
        )
        messages = (
            (0x90, note, max(1, value)), (0x90, note, max(1, value)), (0x80, note, value), (0x90, note, 0),
            (0xB0, 10, value), (0xB0, 64, value), (0xE0, value, int(rng.integers(48, 80))),
        )  # fmt: skip
        status, *data = messages[rng.integers(len(messages))]
        rows.append((int(frame), bytes((status | channel, *data))))
    return rows


@pytest.mark.parametrize("frames", [64, 128, 256, 512])
def test_what_is_played_through_jack_is_what_is_rendered_offline(
    jack_server: StartServer, tmp_path: Path, frames: int
) -> None:
    with jack_server(frames, sync=True) as server:
        rows = phrase(frames, 1, (48, 55))
        found = run(server, tmp_path, (kit.FREE,), rows)
        # each message at its frame, and in its period: none is later than it was sent
        assert played(found) == [(frame, *decode(*message)) for frame, (_, message) in zip(found.frames, rows, strict=True)]
        assert {NOTE_ON, NOTE_OFF, CONTROL, BEND} <= set(found.events["kind"].tolist())
        check(found, kit.play(kit.engine(kit.FREE), found.events, int(found.events["frame"][-1]) + 8192).T)


def test_parts_have_ports_of_their_own(jack_server: StartServer, tmp_path: Path) -> None:
    with jack_server(256, sync=True) as server:
        parts = (kit.FREE, kit.BRIDGE, kit.FREE)
        rows = [
            (0, b"\x90\x30\x64"),
            (100, b"\x91\x2b\x50"),
            (300, b"\x92\x37\x50"),
            (5000, b"\x90\x34\x20"),
            (9000, b"\x81\x2b\x40"),
        ]
        found = run(server, tmp_path, parts, rows, stems=True)
        assert found.heard.samples.shape[0] == 8
        frames = int(found.events["frame"][-1]) + 8192
        stems = np.zeros((3, frames, 2))
        mix = kit.play(kit.engine(*parts), found.events, frames, stems=stems)
        check(found, np.concatenate([mix.T, *(stem.T for stem in stems)]))


def test_ports_are_named_after_the_parts() -> None:
    assert jackclient.port_labels(["Slap bass", "slap-bass", "Jawari (C#)", "…", "out", "out"]) == [
        "slap_bass", "slap_bass_2", "jawari_c", "part", "out_2", "out_3",
    ]  # fmt: skip


def test_exclusive_messages_retune_and_what_is_not_for_us_is_left(jack_server: StartServer, tmp_path: Path) -> None:
    """Messages longer than a note's go another way, through Python, and still come in their order."""
    rows = [
        (0, b"\xf8"),
        (3, b"\xfe"),
        (10, b"\xf0" + of_tuning(48, 48.25, True) + b"\xf7"),
        (11, b"\xf0\x43\x10\x4c\x00\x00\x7e\x00\xf7"),
        (20, b"\xf2\x01\x02"),
        (30, b"\xf0" + of_tuning(50, 1.0 / 3.0, False) + b"\xf7"),
        (31, b"\xc0\x05"),
    ]
    with jack_server(256, sync=True) as server:
        found = run(server, tmp_path, (kit.FREE,), rows, events=3)
        tunings = [(row["a"], row["b"], row["value"]) for row in found.events if row["kind"] == TUNING]
        assert tunings == [(48, 1, 48.25), (50, 0, 1.0 / 3.0)]
        assert len(found.events) == 3


def test_the_period_may_change_while_it_plays(jack_server: StartServer, tmp_path: Path) -> None:
    """From 64 to 8192 frames, twice as many as are rendered at a time: neither the stream nor an event is lost."""
    with jack_server(256, sync=True) as server:
        deck = Deck(kit.engine(kit.FREE), record=True)
        output = jackclient.open_output(deck, server=server.name)
        try:
            capture = Capture(server, output.ports[1:], tmp_path)
            capture.connected()
            output.start()
            times: list[int] = []
            periods = 0
            for frames in (1024, 8192, 64, 256):
                done = subprocess.run(["jack_bufsize", str(frames)], env=server.env, capture_output=True, text=True)
                assert done.returncode == 0, done.stderr
                before = deck.frame
                until(lambda before=before: deck.frame > before)  # type: ignore[misc]
                rows = [(at, bytes((0x90, 48 + at % 5, 90))) for at in range(0, 16384, 1021)]
                times += Sender(server, output.ports[0], rows, tmp_path).done()
                last = deck.frame
                until(lambda last=last: deck.frame > last)  # type: ignore[misc]
                periods = max(periods, deck.delay_frames)
            assert periods == 8192
            last = deck.frame
            until(lambda: deck.frame > last + 8192)
            found = ran(deck, output, capture, times)
        finally:
            output.close()
            deck.close()
        assert found.events["frame"].tolist() == found.frames
        check(found, kit.play(kit.engine(kit.FREE), found.events, int(found.events["frame"][-1]) + 8192).T)


def playing(server: JackServer, how: str) -> Forked:
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = prepared().start([server.name, how], HERE.parents[1], module="tests.live.jack_player", **pipes)
    assert process.stdout is not None
    line = process.stdout.readline()
    if line != "playing\n":
        process.kill()
        pytest.fail(f"{line}{process.communicate()[1]}")
    return process


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGKILL])
def test_a_server_that_ends_is_noticed_and_closing_does_not_hang(jack_server: StartServer, how: signal.Signals) -> None:
    with jack_server(256) as server:
        process = playing(server, "stay")
        try:
            server.kill(how)
            said, complaint = process.communicate(timeout=patience_s())
        finally:
            process.kill()
        assert said.splitlines() == ["jawari: the JACK server has stopped; start it and try again", "closed"]
        assert process.returncode == 0 and complaint == ""


def test_a_process_that_does_not_close_ends_all_the_same(jack_server: StartServer) -> None:
    with jack_server(256) as server:
        process = playing(server, "leave")
        try:
            said, complaint = process.communicate(timeout=patience_s())
        finally:
            process.kill()
    assert (said, complaint, process.returncode) == ("", "", 0)


def test_stopping_stops_the_stream_and_starting_goes_on(jack_server: StartServer) -> None:
    with jack_server(256) as server:
        deck = Deck(kit.engine(kit.FREE))
        output = jackclient.open_output(deck, server=server.name)
        try:
            assert output.alive and output.name == "jawari" and deck.frame == 0
            assert output.ports == ("jawari:midi_in", "jawari:out_left", "jawari:out_right")
            other = jackclient.open_output(Deck(deck.engine), server=server.name, connect=False)
            assert other.name == "jawari-01" and other.ports[1] == "jawari-01:out_left"
            other.close()
            assert not other.alive
            output.start()
            until(lambda: deck.frame > 1000)
            output.stop()
            stood = deck.frame
            time.sleep(0.05)
            assert deck.frame == stood
            output.start()
            until(lambda: deck.frame > stood)
            assert output.frames_skipped == 0 or deck.meters().xruns  # a pause is none
        finally:
            output.close()
        assert not output.alive and output.latency_s == 0.0
        output.stop()
        with pytest.raises(DeviceError, match="has stopped"):
            output.start()


def test_a_server_that_is_late_is_counted(jack_server: StartServer) -> None:
    with jack_server(256) as server:
        deck = Deck(kit.engine(kit.FREE))
        output = jackclient.open_output(deck, server=server.name)
        try:
            output.start()
            until(lambda: deck.frame > 1000)
            server.pause(0.3)
            until(lambda: deck.meters().xruns > 0)
            after = deck.frame
            until(lambda: deck.frame > after + 1000)
            assert output.alive
        finally:
            output.close()


def test_periods_that_we_miss_are_counted_and_the_stream_goes_on(jack_server: StartServer) -> None:
    with jack_server(256) as server:
        process = playing(server, "stall")
        try:
            process.send_signal(signal.SIGSTOP)
            time.sleep(0.3)
            process.send_signal(signal.SIGCONT)
            said, complaint = process.communicate(timeout=patience_s())
        finally:
            process.kill()
    assert (said, complaint, process.returncode) == ("skipped\ngoes on\n", "", 0)


def connections(server: JackServer, port: str) -> list[str]:
    listed = subprocess.run(["jack_lsp", "-c", port], env=server.env, capture_output=True, text=True, check=True).stdout
    return [line.strip() for line in listed.splitlines() if line.startswith(" ")]


def test_connections(jack_server: StartServer) -> None:
    with jack_server(256) as server:
        deck = Deck(kit.engine(kit.FREE))
        output = jackclient.open_output(deck, server=server.name)
        try:
            assert connections(server, "jawari:out_left") == ["system:playback_1"]
            assert connections(server, "jawari:out_right") == ["system:playback_2"]
            assert output.latency_s == pytest.approx(512 / 44100)  # what the dummy driver claims: two periods
            assert deck.meters().device_latency_s == output.latency_s
        finally:
            output.close()
        output = jackclient.open_output(deck, server=server.name, connect=["system:playback_2", "system:playback_2"])
        try:
            assert connections(server, "jawari:out_left") == connections(server, "jawari:out_right") == ["system:playback_2"]
        finally:
            output.close()
        with pytest.raises(DeviceError, match=r"jawari:out_left to nowhere:in.*ports: .*system:playback_1"):
            jackclient.open_output(deck, server=server.name, connect=["nowhere:in", "nowhere:in"])
        with pytest.raises(DeviceError, match=r"keys:out to jawari:midi_in"):
            jackclient.open_output(deck, server=server.name, midi=["keys:out"])


def test_the_server_says_the_rate(jack_server: StartServer) -> None:
    with jack_server(128, 48000) as server:
        assert jackserver.server_rate(server.name) == 48000
        assert jackserver.server_of(server.name) == (48000, 128, ("system:playback_1", "system:playback_2"))
        deck = Deck(kit.engine(kit.FREE))
        with pytest.raises(DeviceError, match="48000 Hz, the engine at 44100 Hz: give --rate 48000"):
            jackclient.open_output(deck, server=server.name)
        server.kill()
        with pytest.raises(DeviceError, match=f"no JACK server answers .*{server.name}"):
            jackserver.server_rate(server.name)


def test_looking_for_a_server_loads_nothing_heavy() -> None:
    program = "import sys, synth.live.jackserver; print(*{'numba', 'numpy', 'scipy', 'jack', 'cffi'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], cwd=HERE.parents[1], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("JACK_DEFAULT_SERVER", "jawari-is-not-there")
    with pytest.raises(DeviceError, match="jawari-is-not-there"):
        jackserver.server_of()
    assert capfd.readouterr().err == ""
    with pytest.raises(DeviceError, match="rendered ahead"):
        jackclient.open_output(Deck(kit.engine(kit.FREE), ahead=2))
    jackserver.library.cache_clear()
    monkeypatch.setitem(sys.modules, "jack", None)
    with pytest.raises(DeviceError, match=r"pip install 'jawari\[jack\]'"):
        jackserver.server_of()
