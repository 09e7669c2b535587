"""MIDI inputs: bytes as they come, names, ports that come and go, through a real JACK server."""

from __future__ import annotations

import json
import random
import signal
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import mido
import pytest

from synth.midi.events import BEND, CONTROL, KEY_PRESSURE, NOTE_OFF, NOTE_ON, PARAMETER, PRESSURE, PROGRAM, TUNING
from synth.midi.ports import MidiInputs, MidiPortError, find_port, midi_system, port_names
from synth.midi.stream import MOST_SYSEX_BYTES, ArrivalClock, MidiStream
from synth.midi.sysex import of_parameter, of_tuning
from tests.patience import patience_s, until

from .jackkit import expect

HERE = Path(__file__).parent


class Kept(list):
    """A sink that keeps rows; `room` of them."""

    room: float = float("inf")

    def __call__(self, *row) -> bool:
        if len(self) >= self.room:
            return False
        self.append(row)
        return True

    def plain(self) -> list[tuple]:
        return [row[:4] for row in self]


def rows_of(data: bytes | list[int], pieces: int = 0, **settings) -> tuple[list[tuple], MidiStream]:
    kept = Kept()
    stream = MidiStream(kept, **settings)
    size = pieces or len(data)
    for at in range(0, len(data), size):
        stream.feed(list(data[at : at + size]), at)
    return kept.plain(), stream


@pytest.mark.parametrize(
    ("message", "row"),
    [
        ([0x93, 60, 100], (NOTE_ON, 3, 60, 100)),
        ([0x93, 60, 0], (NOTE_OFF, 3, 60, 64)),
        ([0x8F, 60, 12], (NOTE_OFF, 15, 60, 12)),
        ([0xB0, 64, 127], (CONTROL, 0, 64, 127)),
        ([0xE1, 0, 0], (BEND, 1, -8192, 0)),
        ([0xE1, 127, 127], (BEND, 1, 8191, 0)),
        ([0xC2, 5], (PROGRAM, 2, 5, 0)),
        ([0xD2, 5], (PRESSURE, 2, 0, 5)),
        ([0xA2, 60, 5], (KEY_PRESSURE, 2, 60, 5)),
    ],
)
def test_every_channel_message_is_its_event(message: list[int], row: tuple) -> None:
    assert rows_of(message)[0] == [row]
    assert rows_of(message, pieces=1)[0] == [row]


def test_running_status_with_clocks_between_all_bytes() -> None:
    data = [0x90, 0xF8, 60, 0xFE, 100, 0xF8, 61, 0xFA, 0xFF, 0, 0xF8, 62, 7]
    rows, stream = rows_of(data)
    assert rows == [(NOTE_ON, 0, 60, 100), (NOTE_OFF, 0, 61, 64), (NOTE_ON, 0, 62, 7)]
    assert rows_of(data, pieces=1)[0] == rows
    assert stream.messages == 3 + 6 and stream.ignored == 6


def test_system_common_ends_running_status_and_what_is_cut_off_is_no_note() -> None:
    rows, stream = rows_of([0x90, 60, 0xF2, 1, 2, 61, 62, 0xF6, 0xF1, 3, 0x91, 5, 6, 0x92, 1, 0x80, 5, 0])
    assert rows == [(NOTE_ON, 1, 5, 6), (NOTE_OFF, 0, 5, 0)]
    assert stream.ignored == 1 + 1 + 2 + 1 + 1 + 1


def test_system_exclusive_messages_are_parameters_and_tunings() -> None:
    kept = Kept()
    stream = MidiStream(kept)
    message = [0xF0, *of_parameter(1, 2, 0.1), 0xF7]
    message.insert(5, 0xF8)
    for at in range(0, len(message), 4):
        stream.feed(message[at : at + 4], 7)
    stream.feed([0xF0, *of_tuning(60, 60.5, True), 0xF7, 0x90, 1, 2], 8)
    assert kept == [(PARAMETER, 1, 2, 0, 0.1, 7), (TUNING, 0, 60, 1, 60.5, 8), (NOTE_ON, 0, 1, 2, 0.0, 8)]


def test_system_exclusive_messages_that_do_not_end_are_dropped_without_being_kept() -> None:
    kept = Kept()
    stream = MidiStream(kept)
    stream.feed([0xF0, *of_parameter(0, 0, 1.0)], 0)
    piece = [1] * 1000
    tracemalloc.start()
    try:
        for _ in range(1000):
            stream.feed(piece, 0)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 10 * MOST_SYSEX_BYTES
    stream.feed([0x90, 60, 1], 0)
    stream.feed([0xF0, *of_parameter(0, 0, 1.0)], 0)
    stream.feed([0x90, 61, 1, 0xF7], 0)
    assert kept.plain() == [(NOTE_ON, 0, 60, 1), (NOTE_ON, 0, 61, 1)]
    stream.feed([0xF0, *of_parameter(0, 0, 1.0), *[0] * MOST_SYSEX_BYTES, 0xF7], 0)
    assert len(kept) == 2


def test_messages_are_found_under_running_status_however_the_bytes_are_cut() -> None:
    rng = random.Random(3)
    kinds = ("note_on", "note_off", "control_change", "pitchwheel", "program_change", "aftertouch", "polytouch", "songpos")
    for _ in range(100):
        data: list[int] = []
        expected: list[tuple] = []
        running = 0
        for _ in range(40):
            kind = rng.choice(kinds)
            message = mido.Message(kind, **({} if kind == "songpos" else {"channel": rng.randrange(2)}))
            values = [rng.randrange(128) for _ in message.bytes()[1:]]
            status = message.bytes()[0]
            wire = values if status == running and rng.random() < 0.9 else [status, *values]
            running = status if status < 0xF0 else 0
            for byte in wire:
                data += [0xF8] * (rng.random() < 0.2) + [byte]
            expected += rows_of([status, *values])[0]
        assert rows_of(data)[0] == expected
        assert rows_of(data, pieces=rng.randrange(1, 7))[0] == expected


def test_garbage_breaks_nothing_and_the_next_message_is_heard() -> None:
    rng = random.Random(4)
    for _ in range(200):
        kept = Kept()
        stream = MidiStream(kept)
        stream.feed([rng.randrange(256) for _ in range(300)], 0)
        kept.clear()
        stream.feed([0x95, 60, 100], 1)
        assert kept[-1] == (NOTE_ON, 5, 60, 100, 0.0, 1)


def test_one_channel_can_be_chosen() -> None:
    rows, stream = rows_of([0x90, 60, 1, 0x91, 61, 1, 0xC1, 2], channel=2)
    assert rows == [(NOTE_ON, 1, 61, 1), (PROGRAM, 1, 2, 0)]
    assert stream.ignored == 1
    with pytest.raises(ValueError, match="17"):
        MidiStream(Kept(), channel=17)


def test_what_is_held_is_let_go_and_nothing_else() -> None:
    kept = Kept()
    stream = MidiStream(kept)
    for message in (
        [0x90, 60, 1],
        [0x91, 61, 1],
        [0x90, 62, 1],
        [0x90, 62, 0],
        [0xB1, 64, 127],
        [0xB0, 64, 127],
        [0xB0, 64, 0],
    ):
        stream.feed(message, 0)
    assert stream.held == 3
    kept.clear()
    stream.release(9)
    assert kept == [(NOTE_OFF, 0, 60, 64, 0.0, 9), (NOTE_OFF, 1, 61, 64, 0.0, 9), (CONTROL, 1, 64, 0, 0.0, 9)]
    stream.release(10)
    assert len(kept) == 3


def test_events_that_find_no_room_are_counted() -> None:
    kept = Kept()
    kept.room = 1
    stream = MidiStream(kept)
    for key in range(5):
        stream.feed([0x90, key, 1], 0)
    assert (stream.messages, stream.lost, stream.held) == (5, 4, 1)


def test_times_of_arrival_do_not_show_when_messages_are_fetched() -> None:
    rng = random.Random(5)
    clock = ArrivalClock()
    errors = []
    arrived = before = 0.0
    for _ in range(500):
        arrived += rng.uniform(0.0, 0.01)
        fetched = arrived + rng.uniform(0.0, 0.005)
        told = clock.time_ns(arrived - before, round(1e9 * fetched))
        assert told <= round(1e9 * fetched)
        errors.append(told / 1e9 - arrived)
        before = arrived
    # It keeps the shortest delay that it has seen: hundreds of tries come far below the 5 ms of the looking.
    assert all(late >= later - 1e-9 for late, later in pairwise(errors))
    assert 0.0 <= errors[-1] + 1e-8 < 0.0005


def test_a_gap_that_was_lost_does_not_put_events_into_the_past_for_ever() -> None:
    clock = ArrivalClock()
    clock.time_ns(0.0, 10**9)
    assert clock.time_ns(0.0, 3 * 10**9) == 3 * 10**9


NAMES = [
    "Midi Through:Midi Through Port-0 14:0",
    "Keystation:Keystation MIDI 1 20:0",
    "Keystation:Keystation MIDI 2 20:1",
    "a 2:x",
]


@pytest.mark.parametrize(
    ("wanted", "number"),
    [("1", 1), ("keystation midi 2", 2), ("Keystation:Keystation MIDI 1", 1), ("through", 0), ("A 2", 3), (NAMES[2], 2)],
)
def test_ports_are_found_by_number_and_name(wanted: str, number: int) -> None:
    assert find_port(wanted, NAMES) == number


@pytest.mark.parametrize(
    ("wanted", "names", "says"),
    [
        ("4", NAMES, "no MIDI port number 4; there are 0: Midi Through"),
        ("Roland", NAMES, "no MIDI port 'Roland'; there are 0: Midi Through"),
        ("Keystation", NAMES, "'Keystation' is ambiguous; give the number of one of 1: Keystation.* 2: "),
        ("", NAMES, "no MIDI port ''"),
        ("x", [], "there are none"),
    ],
)
def test_ports_that_are_not_there_are_refused_with_those_that_are(wanted: str, names: list[str], says: str) -> None:
    with pytest.raises(MidiPortError, match=says) as refusal:
        find_port(wanted, names)
    assert "\n" not in str(refusal.value)


def test_without_a_midi_system_one_plays_on_and_hears_why(monkeypatch, capfd) -> None:
    monkeypatch.setenv("JACK_DEFAULT_SERVER", "jawari-there-is-none")
    monkeypatch.setenv("JACK_NO_START_SERVER", "1")
    said: list[str] = []
    inputs = MidiInputs([], Kept(), said.append, backend="jack")
    inputs.open()
    assert said == ["no MIDI system: no JACK server answers python-rtmidi"]
    inputs.poll()
    inputs.close()
    assert port_names("jack") == [] and midi_system("jack") == ("", "no JACK server answers python-rtmidi")
    with pytest.raises(MidiPortError, match="'keys' cannot be opened: no JACK server answers python-rtmidi"):
        MidiInputs(["keys"], Kept(), backend="jack").open()
    # The libraries' own complaints are kept from the screen.
    assert capfd.readouterr().err == ""


def test_none_is_no_midi_at_all() -> None:
    said: list[str] = []
    inputs = MidiInputs(["none"], Kept(), said.append)
    inputs.open()
    inputs.poll()
    inputs.close()
    assert not said and not inputs.system


def test_backends_and_channels_that_do_not_exist_are_refused() -> None:
    with pytest.raises(MidiPortError, match="backend 'oss'"):
        MidiInputs([], Kept(), backend="oss").open()
    with pytest.raises(MidiPortError, match="between 1 and 16, got 0"):
        MidiInputs([], Kept(), channel=0)


class Keys:
    """The program in midi_sender.py."""

    def __init__(self, server) -> None:
        self._process = subprocess.Popen(
            [sys.executable, str(HERE / "midi_sender.py")],
            env=server.env,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        expect(self._process, "ready")

    def tell(self, *words) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(" ".join(map(str, words)) + "\n")
        self._process.stdin.flush()

    def __call__(self, *words) -> None:
        self.tell(*words)
        self.done()

    def done(self) -> None:
        expect(self._process, "done")

    def send(self, name: str, *messages: list[int]) -> None:
        self("send", name, json.dumps(messages))

    def end(self) -> None:
        """Let it close its ports: a server waits for a client that goes without a word."""
        try:
            self._process.communicate(timeout=patience_s(5.0))
        except subprocess.TimeoutExpired:  # its server has gone before it
            self._process.kill()
            self._process.communicate()


@pytest.fixture
def server(jack_server, monkeypatch):
    running = jack_server(sync=True)  # else a client that is late loses what was sent to it
    monkeypatch.setenv("JACK_DEFAULT_SERVER", running.name)
    monkeypatch.setenv("JACK_NO_START_SERVER", "1")
    return running


@pytest.fixture
def keys(server) -> Iterator[Keys]:
    sender = Keys(server)
    yield sender
    sender.end()


@pytest.fixture
def listen() -> Iterator[Callable[..., tuple[MidiInputs, Kept, list[str]]]]:
    opened = []

    def start(names=(), **settings):
        kept, said = Kept(), []
        inputs = MidiInputs(list(names), kept, said.append, backend="jack", **settings)
        opened.append(inputs)
        inputs.open()
        return inputs, kept, said

    yield start
    for inputs in opened:
        inputs.close()


def test_a_keyboard_that_is_plugged_in_just_works(keys: Keys, listen) -> None:
    keys("open", "first")
    inputs, kept, said = listen()
    assert inputs.system == "JACK" and inputs.connected == ["first:first"]
    assert port_names("jack") == ["first:first"]
    keys("open", "second")
    until(lambda: len(inputs.connected) == 2, meanwhile=inputs.poll)
    assert said == ["MIDI port connected: first:first", "MIDI port connected: second:second"]
    before = time.monotonic_ns()
    keys.send("first", [0x90, 60, 100], [0xF8], [0xC0, 3])
    until(lambda: len(kept) == 2)
    keys.send("second", [0xF0, *of_parameter(0, 1, 0.25), 0xF7], [0x91, 61, 100], [0xF0, *[1] * 5000, 0xF7], [0xE1, 0, 64])
    until(lambda: len(kept) == 5)
    after = time.monotonic_ns()
    assert [row[:5] for row in kept] == [
        (NOTE_ON, 0, 60, 100, 0.0),
        (PROGRAM, 0, 3, 0, 0.0),
        (PARAMETER, 0, 1, 0, 0.25),
        (NOTE_ON, 1, 61, 100, 0.0),
        (BEND, 1, 0, 0, 0.0),
    ]
    times = [row[5] for row in kept]
    assert before <= times[0] and times[-1] <= after and sorted(times) == times
    counts = {count.name: (count.messages, count.ignored, count.lost) for count in inputs.counts()}
    assert counts == {"jawari (virtual)": (0, 0, 0), "first:first": (3, 1, 0), "second:second": (4, 1, 0)}


def test_only_ports_that_are_named_are_heard(keys: Keys, listen) -> None:
    for name in ("piano", "organ", "other"):
        keys("open", name)
    until(lambda: {"piano:piano", "organ:organ", "other:other"} <= set(port_names("jack")))
    number = port_names("jack").index("other:other")
    inputs, kept, _ = listen(["PIANO", str(number)])
    inputs.poll()
    assert inputs.connected == ["piano:piano", "other:other"]
    keys.send("organ", [0x90, 60, 1])
    keys.send("other", [0x90, 61, 1])
    until(lambda: len(kept) > 0)
    assert kept.plain() == [(NOTE_ON, 0, 61, 1)]
    with pytest.raises(MidiPortError, match="no MIDI port 'harp'; there are 0: "):
        listen(["harp"])
    with pytest.raises(MidiPortError, match="'o' is ambiguous"):
        listen(["o"])


def test_a_port_that_vanishes_lets_go_and_is_heard_again_when_it_is_back(keys: Keys, listen) -> None:
    keys("open", "keys")
    inputs, kept, said = listen(["keys"])
    keys.send("keys", [0x90, 60, 100], [0xB0, 64, 127], [0x90, 61, 100], [0x80, 61, 0])
    until(lambda: len(kept) == 4)
    keys("close", "keys")
    until(lambda: not inputs.connected, meanwhile=inputs.poll)
    assert kept.plain()[4:] == [(NOTE_OFF, 0, 60, 64), (CONTROL, 0, 64, 0)]
    assert said[-1] == "MIDI port gone: keys:keys, its notes were released"
    keys("open", "other")
    inputs.poll()
    assert inputs.connected == []
    keys("open", "keys")
    until(lambda: inputs.connected == ["keys:keys"], meanwhile=inputs.poll)
    assert said[-1] == "MIDI port back: keys:keys"
    keys.send("keys", [0x90, 62, 1])
    until(lambda: len(kept) == 7)
    assert kept.plain()[-1] == (NOTE_ON, 0, 62, 1)
    (count,) = [count for count in inputs.counts() if count.name == "keys:keys"]
    assert count.messages == 5


def test_other_programs_can_connect_to_the_port_of_its_own(server, listen) -> None:
    jack = pytest.importorskip("jack")
    _, kept, _ = listen(virtual="jawari")
    client = jack.Client("sequencer", no_start_server=True, servername=server.name)
    try:
        (port,) = [port for port in client.get_ports(is_midi=True, is_input=True) if port.shortname == "jawari"]
        out = client.midi_outports.register("out")
        todo = [b"\x90\x3c\x01", b"\x90\x3c\x00"]

        @client.set_process_callback
        def process(_: int) -> None:
            out.clear_buffer()
            while todo and out.connections:
                out.write_midi_event(0, todo.pop(0))

        client.activate()
        client.connect(out, port)
        until(lambda: len(kept) == 2)
        client.deactivate()
    finally:
        client.close()
    assert kept.plain() == [(NOTE_ON, 0, 60, 1), (NOTE_OFF, 0, 60, 64)]


def test_none_of_a_flood_is_lost_and_memory_does_not_grow(keys: Keys, listen) -> None:
    keys("open", "keys")
    count = 0
    wrong: list[tuple] = []
    kept_at = 0

    def sink(kind, channel, a, b, value, time_ns) -> bool:
        nonlocal count, kept_at
        if (kind, a, b) != (NOTE_ON, count % 128, 1 + count // 128 % 127) or time_ns < kept_at:
            wrong.append((count, kind, a, b))
        count, kept_at = count + 1, time_ns
        return True

    inputs = MidiInputs(["keys"], sink, backend="jack")
    inputs.open()
    tracemalloc.start()
    try:
        keys("flood", "keys", 30_000, 10_000)
        until(lambda: count == 30_000)
        _, peak = tracemalloc.get_traced_memory()
        (told,) = [each for each in inputs.counts() if each.name == "keys:keys"]
        assert not wrong
    finally:
        tracemalloc.stop()
        inputs.close()
    assert (told.messages, told.ignored, told.lost, told.overrun) == (30_000, 0, 0, 0)
    assert peak < 2_000_000


def test_a_server_that_ends_is_noticed_and_heard_again_when_it_is_back(jack_server, monkeypatch) -> None:
    first = jack_server(sync=True)  # see `server`
    monkeypatch.setenv("JACK_DEFAULT_SERVER", first.name)
    monkeypatch.setenv("JACK_NO_START_SERVER", "1")
    sender = Keys(first)
    kept, said = Kept(), []
    inputs = MidiInputs([], kept, said.append, backend="jack")
    try:
        sender("open", "keys")
        inputs.open()
        sender.send("keys", [0x90, 60, 100])
        until(lambda: len(kept) == 1)
        first.kill(signal.SIGKILL)
        sender.end()
        inputs.poll()
        assert said[-1] == "the JACK server has stopped; MIDI resumes when it is back"
        assert kept.plain()[1:] == [(NOTE_OFF, 0, 60, 64)]
        inputs.poll()
        second = jack_server(sync=True)
        monkeypatch.setenv("JACK_DEFAULT_SERVER", second.name)
        sender = Keys(second)
        sender("open", "keys")
        until(lambda: inputs.connected == ["keys:keys"], meanwhile=inputs.poll)
        assert said[-2:] == ["JACK is back", "MIDI port back: keys:keys"]
        sender.send("keys", [0x90, 62, 100])
        until(lambda: len(kept) == 3)
    finally:
        inputs.close()
        sender.end()
