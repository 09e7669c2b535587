"""Sound and MIDI through a JACK server (or PipeWire in its place), by the package JACK-Client, with a compiled callback.

    output = open_output(deck)          # "jawari:midi_in", "jawari:out_left", "jawari:out_right" are there, and silent
    output.start()

The server says the rate: `jackserver.server_rate` before the engine is prepared. MIDI that comes to `midi_in` is played at
its frame.
"""

from __future__ import annotations

import os
import re
import threading
import weakref
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from synth.engine.team import TOKEN
from synth.engine.uncopied import Uncopied
from synth.live import jackcallback as jc
from synth.live.deck import Deck
from synth.live.errors import DeviceError
from synth.live.jackserver import NAME, library, open_client, playback
from synth.midi.sysex import events_of
from synth.native.atomics import tokens
from synth.native.patience import CALL_S, Worker

#: what JACK-Client leaves out
_LATENCY = """
typedef struct { uint32_t min; uint32_t max; } range_t;
void jack_port_get_latency_range(void *port, int mode, range_t *range);
"""
_PLAYBACK_LATENCY = 1
#: what the callback calls of JACK
_CALLED = ("port_get_buffer", "midi_get_event_count", "midi_event_get", "last_frame_time", "frames_since_cycle_start")
#: what a callback may still work on because its client could not be closed; it stays where it is
_abandoned: list[Any] = []


class JackOutput(Uncopied):
    """An open client of a server, a deck's only reader; `start` lets it sound. Made by `open_output`.

    name    as the server has it: "jawari", or "jawari-01" where there is one already
    ports   full names of its ports: midi_in, out_left, out_right, stems
    """

    def __init__(self, deck: Deck, client: Any, parts: Sequence[str]) -> None:
        jack = library()
        self._deck = deck
        self.name: str = client.name
        self._rate_hz = client.samplerate
        midi_in = client.midi_inports.register("midi_in")
        outs = [client.outports.register(f"out_{side}") for side in ("left", "right")]
        stems = [[client.outports.register(f"{part}_{side}") for side in ("left", "right")] for part in parts]
        self.ports = tuple(port.name for port in (midi_in, *outs, *(port for pair in stems for port in pair)))
        asleep, wake = tokens()
        self._state, table = jc.new_jack(
            deck=deck.address,
            client=_address(client._ptr),
            midi_in=_address(midi_in._ptr),
            out_left=_address(outs[0]._ptr),
            out_right=_address(outs[1]._ptr),
            stems=np.array([[_address(port._ptr) for port in pair] for pair in stems], np.int64).reshape(-1, 2),
            wake=wake,
            **{name: _address(jack._ffi.addressof(jack._lib, f"jack_{name}")) for name in _CALLED},
        )
        address = table.ctypes.data
        compiled = jc.callbacks()
        reader = threading.Thread(
            target=_play_exclusive, args=(deck, self._state, table, asleep), name="synth-sysex", daemon=True
        )
        keep = (deck, client, self._state, table, compiled, outs, stems, midi_in)
        # made first: whatever happens to the owner from here on, JACK ends calling
        self._end = weakref.finalize(self, _end, os.getpid(), client, self._state.words, reader, (asleep, wake), keep)
        reader.start()
        argument = jack._ffi.cast("void *", address)
        hush = jack._ffi.cast("void (*)(char *)", compiled.hush.address)  # JACK's threads must not wait for the interpreter
        jack._lib.jack_set_error_function(hush)
        jack._lib.jack_set_info_function(hush)
        _set(jack, "process_callback", client, "JackProcessCallback", compiled.process, argument)
        _set(jack, "xrun_callback", client, "JackXRunCallback", compiled.xrun, argument)
        jack._lib.jack_on_info_shutdown(
            client._ptr, jack._ffi.cast("JackInfoShutdownCallback", compiled.shutdown.address), argument
        )
        self._client = client
        self._out = outs[0]
        client.activate()

    @property
    def alive(self) -> bool:
        """Whether the server is there and asks for sound."""
        return self._end.alive and not self._state.words[jc.GONE]

    @property
    def latency_s(self) -> float:
        """From the end of a period to the air, as the server reports it for what the left output is connected to [s]."""
        if not self.alive:
            return 0.0
        seconds = port_latency(self._out) / self._rate_hz
        self._deck.set_device_latency(seconds)
        return seconds

    @property
    def frames_skipped(self) -> int:
        """Frames of JACK's time that went by without this client being asked for sound since it plays."""
        return int(self._state.words[jc.SKIPPED])

    @property
    def frames_jumped(self) -> int:
        """By how many frames JACK's time has jumped since it plays, jumps back taken off: a server jumps back where its
        period is changed."""
        return int(self._state.words[jc.JUMPED])

    @property
    def periods_missed(self) -> int:
        """Periods that the server did without: it did not ask for them, or got them after the next one had begun. JACK tells
        of most of them as xruns, PipeWire of none. (A server that waits for its clients loses none of the second kind.)"""
        words = self._state.words
        period = max(1, self._deck.period)
        return -(-int(words[jc.SKIPPED]) // period) + int(words[jc.TOO_LATE])

    @property
    def messages_lost(self) -> int:
        """MIDI messages of which there were too many at a time."""
        return int(self._state.words[jc.LOST])

    @property
    def first_frame_time(self) -> int:
        """JACK's frame time (32 bits) less the stream's frame, in the latest period; −1: not known yet."""
        return int(self._state.words[jc.FIRST])

    def start(self) -> None:
        """Sound from the next period on. Raises DeviceError where the server has gone."""
        if not self.alive:
            raise DeviceError(f"{self.name}: the JACK server has stopped; start it and try again")
        self._state.words[jc.FIRST] = -1
        self._state.words[jc.PLAYING] = 1
        _ = self.latency_s

    def stop(self) -> None:
        """Silence; no period works on the deck any more afterwards. May be called again."""
        words = self._state.words
        words[jc.PLAYING] = 0
        begun = int(words[jc.PERIODS])
        waited = threading.Event()
        for _ in range(int(CALL_S / 0.002)):
            if not self.alive or words[jc.PERIODS] >= begun + 2:
                return
            waited.wait(0.002)

    def close(self) -> None:
        """Take the client off the server; within seconds also from a server that has died. May be called again."""
        try:
            if self.alive:
                self.stop()
        finally:
            self._end()


def open_output(
    deck: Deck,
    name: str = NAME,
    server: str | None = None,
    *,
    connect: bool | Sequence[str] = True,
    midi: Sequence[str] = (),
) -> JackOutput:
    """A client of a server, with its ports, and a pair of ports for each part if the deck has stems.

    name      of the client; if it is taken, the server adds a number
    server    its name; None: JACK_DEFAULT_SERVER of the environment, or "default"
    connect   True: the two outputs to the sound card's first two; or to one port or two; False: to nothing
    midi      ports to play from, like "system:midi_capture_1"
    Raises DeviceError for a server or port that is not there, another rate than the engine's, and what is not installed.
    """
    if deck.ahead_frames:
        raise DeviceError("JACK cannot play blocks rendered ahead: leave --ahead out")
    client = open_client(name, server)
    if client.samplerate != deck.rate_hz:
        rate = client.samplerate
        client.close()
        raise DeviceError(f"the JACK server runs at {rate} Hz, the engine at {deck.rate_hz:g} Hz: give --rate {rate}")
    client_name = client.name
    parts = port_labels([preset.name for preset in deck.engine.parts]) if deck.stems else []
    try:
        output = JackOutput(deck, client, parts)
    except library().JackError as error:
        client.close()
        raise DeviceError(f"the JACK server refuses the ports of {client_name}: {error}") from None
    try:
        wanted = list(playback(client)[:2]) if connect is True else list(connect or ())
        if len(wanted) == 1:
            wanted *= 2
        pairs = [*zip(output.ports[1:3], wanted, strict=False), *((source, output.ports[0]) for source in midi)]
        for source, destination in pairs:
            _connect(client, source, destination)
    except DeviceError:
        output.close()
        raise
    return output


def port_labels(names: Sequence[str]) -> list[str]:
    """Names for ports out of any names: lower case, digits, underscores; each once."""
    labels: list[str] = []
    for name in names:
        base = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")[:64] or "part"
        label, number = base, 2
        while label in labels or label == "out":
            label, number = f"{base}_{number}", number + 1
        labels.append(label)
    return labels


def _play_exclusive(deck: Deck, state: jc.Jack, table: np.ndarray, asleep: int) -> None:
    """The life of the thread that plays system-exclusive messages: it sleeps until the callback has one."""
    data = np.zeros(jc.EXCLUSIVE, np.uint8)
    while os.read(asleep, len(TOKEN)):
        if state.words[jc.ENDING]:
            return
        while size := jc.pop_exclusive(table.ctypes.data, data):
            if size >= 2 and data[size - 1] == 0xF7:
                for kind, channel, a, b, value in events_of(data[1 : size - 1].tobytes()):
                    deck.send(kind, channel, a, b, value)


def _end(
    process_id: int, client: Any, words: np.ndarray, reader: threading.Thread, descriptors: tuple[int, int], keep: Any
) -> None:
    """Close the client, end the thread. A client whose server died without a word may wait for it for ever: then it is
    left to itself, and so is everything it may touch."""
    if os.getpid() != process_id:  # the client is the parent's
        client._ptr = library()._ffi.NULL
        return
    words[jc.PLAYING] = 0
    closing = Worker(client.close, "synth-jack-close")
    closed = True
    try:
        closing.start()
        closed = closing.ended(CALL_S)
    except RuntimeError:  # the interpreter is ending, and starts no threads any more
        if words[jc.GONE]:
            client._ptr = library()._ffi.NULL
        else:
            client.close()
    if not closed:
        _abandoned.append(keep)
        return
    words[jc.ENDING] = 1
    if reader.ident is not None:
        os.write(descriptors[1], TOKEN)
        reader.join()
    for descriptor in set(descriptors):
        os.close(descriptor)


def _connect(client: Any, source: str, destination: str) -> None:
    jack = library()
    try:
        client.connect(source, destination)
    except jack.JackError as error:
        there = ", ".join(port.name for port in client.get_ports()) or "none"
        raise DeviceError(f"JACK cannot connect {source} to {destination}: {error}; its ports: {there}") from None


def _address(pointer: Any) -> int:
    return int(library()._ffi.cast("intptr_t", pointer))


def _set(jack: Any, what: str, client: Any, kind: str, compiled: Any, argument: Any) -> None:
    set_callback = getattr(jack._lib, f"jack_set_{what}")
    if set_callback(client._ptr, jack._ffi.cast(kind, compiled.address), argument) != 0:
        raise DeviceError(f"{client.name}: the JACK server refuses the {what.replace('_', ' ')}; restart it")


@cache
def _latency_library() -> tuple[Any, Any]:
    import cffi

    ffi = cffi.FFI()
    ffi.cdef(_LATENCY)
    return ffi, ffi.dlopen(library()._libname)


def port_latency(port: Any) -> int:
    """Frames from a port to the air, as the server reports them."""
    ffi, library = _latency_library()
    found = ffi.new("range_t *")
    library.jack_port_get_latency_range(ffi.cast("void *", _address(port._ptr)), _PLAYBACK_LATENCY, found)
    return int(found.max)
