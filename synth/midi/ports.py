"""MIDI inputs: ports by name or number, as they come and go.

python-rtmidi is used directly, without mido: a port's messages are fetched from its bounded queue by one thread that
looks every millisecond. RtMidi would call Python as well, but from the thread of the backend, which is JACK's real-time
thread where JACK is the backend: it would wait for the interpreter there and the whole graph with it. RtMidi tells the time
from message to message, so that nothing of the looking shows in the times (see ArrivalClock).
"""

from __future__ import annotations

import os
import re
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from synth.midi.stream import ArrivalClock, MidiStream, Sink
from synth.native.patience import Worker
from synth.native.stderr import silenced

CLIENT = "jawari"
VIRTUAL = "jawari"
#: messages that a port's queue holds until they are fetched: more than a second of as many as a cable can carry
QUEUE_MESSAGES = 16384
LOOK_EVERY_S = 0.001
# Fetched from one port before the next one has its turn.
_AT_ONCE = 1024

_API_NAMES = {1: "CoreMIDI", 2: "ALSA", 3: "JACK", 4: "Windows MM"}
_JACK = 3
# ALSA adds client and port number, Windows MM the port's number, which differ when the same device is plugged in again.
_ADDRESS = re.compile(r" \d+:\d+$")
_ADDRESS_OF_WINDOWS = re.compile(r" \d+$")


class MidiPortError(ValueError):
    """A MIDI port that cannot be used as asked."""


class _NoMidiSystem(Exception):
    """No backend can be used; the message says why."""


@dataclass(frozen=True)
class PortCount:
    """What came in through a port. messages: all; ignored: those that play nothing; lost: events that found no room;
    overrun: how often so many had piled up that others may have found no room in the queue."""

    name: str
    messages: int
    ignored: int
    lost: int
    overrun: int


def port_names(backend: str | None = None) -> list[str]:
    """The MIDI inputs that there are, in the order of their numbers (from 0); none where there is no MIDI system.

    backend: "alsa", "jack", "coremidi" or "windows"; None: the first that works.
    """
    try:
        system = _System(backend)
    except _NoMidiSystem:
        return []
    try:
        return system.names()
    finally:
        system.close()


def midi_system(backend: str | None = None) -> tuple[str, str]:
    """(name of the MIDI system in use, "") or ("", why there is none)."""
    try:
        system = _System(backend)
    except _NoMidiSystem as reason:
        return "", str(reason)
    system.close()
    return system.name, ""


def check_ports(names: Sequence[str], backend: str | None = None) -> None:
    """Raises MidiPortError where one of the names (see MidiInputs) means no port that there is. Opens none."""
    if not names or means_none(names):
        return
    try:
        system = _System(backend)
    except _NoMidiSystem as reason:
        raise MidiPortError(_not_without_system(names, reason)) from None
    try:
        there = system.names()
    finally:
        system.close()
    for name in names:
        find_port(name, there)


def means_none(names: Sequence[str]) -> bool:
    """Whether names of ports (see MidiInputs) say that there is to be no MIDI at all."""
    return [name.strip().lower() for name in names] == ["none"]


def _not_without_system(names: Sequence[str], reason: Exception) -> str:
    return f"the MIDI port {names[0]!r} cannot be opened: {reason}"


def find_port(wanted: str, names: Sequence[str]) -> int:
    """Number of the port that `wanted` means: a number, the whole name, or a part of just one name, case aside.

    Raises MidiPortError, which lists the ports.
    """
    text = wanted.strip()
    if text.isdecimal():
        if int(text) < len(names):
            return int(text)
        raise MidiPortError(f"there is no MIDI port number {text}; {_listing(names)}")
    plain = [_plain(name) for name in names]
    # the first kind of likeness that finds anything counts
    for found in (
        [i for i, name in enumerate(names) if text in (name, plain[i])],
        [i for i, name in enumerate(names) if text.lower() in (name.lower(), plain[i].lower())],
        [i for i, name in enumerate(names) if text and text.lower() in name.lower()],
    ):
        if len(found) == 1:
            return found[0]
        if found:
            several = ", ".join(f"{i}: {names[i]}" for i in found)
            raise MidiPortError(f"the MIDI port {wanted!r} is ambiguous; give the number of one of {several}")
    raise MidiPortError(f"there is no MIDI port {wanted!r}; {_listing(names)}")


def _listing(names: Sequence[str]) -> str:
    return "there are " + ", ".join(f"{i}: {name}" for i, name in enumerate(names)) if names else "there are none"


class _System:
    """One backend, with the client that lists its ports. Raises _NoMidiSystem."""

    def __init__(self, backend: str | None) -> None:
        try:
            import rtmidi
        except ImportError:
            raise _NoMidiSystem("python-rtmidi is not installed; pip install 'jawari[live]'") from None
        self._rtmidi = rtmidi
        wanted = {name.split()[0].lower(): api for api, name in _API_NAMES.items()}
        if backend is not None and backend.lower() not in wanted:
            raise MidiPortError(f"there is no MIDI backend {backend!r}; use one of {', '.join(wanted)}")
        apis = [api for api in rtmidi.get_compiled_api() if api in _API_NAMES]
        if backend is not None:
            apis = [api for api in apis if api == wanted[backend.lower()]]
        for api in apis:
            # Both ALSA and JACK say on standard error, in many lines, that they are not there.
            with silenced(), suppress(rtmidi.RtMidiError):
                self.api = api
                self.name = _API_NAMES[api]
                self._lister = self._client()
                self._pulse = _jack_socket() if api == _JACK else None
                return
        raise _NoMidiSystem(_why_none(apis))

    def _client(self) -> Any:
        return self._rtmidi.MidiIn(self.api, CLIENT, QUEUE_MESSAGES)

    @property
    def errors(self) -> type[Exception]:
        return self._rtmidi.RtMidiError

    @property
    def alive(self) -> bool:
        """Whether the backend's server answers: a JACK client goes on listing the ports of one that is dead."""
        return self._pulse is None or _answers(self._pulse)

    def names(self) -> list[str]:
        return list(self._lister.get_ports())

    def open(self, name: str, number: int) -> Any:
        """A client that listens to the port. Raises `errors`, or MidiPortError where the port has just gone."""
        client = self._client()
        try:
            client.ignore_types(sysex=False, timing=False, active_sense=False)
            if self._lister.get_port_name(number) != name:
                raise MidiPortError(f"the MIDI port {name!r} has gone")
            client.open_port(number, "in")
        except BaseException:
            client.delete()
            raise
        return client

    def open_virtual(self, name: str) -> Any | None:
        """A client with a port that others can connect to; None where the system has none."""
        if self.name == "Windows MM":
            return None
        client = self._client()
        client.ignore_types(sysex=False, timing=False, active_sense=False)
        client.open_virtual_port(name)
        return client

    def close(self) -> None:
        with silenced():
            self._lister.delete()


def _why_none(apis: Sequence[int]) -> str:
    reasons = {
        1: "CoreMIDI does not answer",
        2: "ALSA has no sequencer (/dev/snd/seq; try modprobe snd-seq)",
        _JACK: "no JACK server answers python-rtmidi",
        4: "Windows MM does not answer",
    }
    return " and ".join(reasons[api] for api in apis) or "python-rtmidi was built without this MIDI system"


def _jack_socket() -> str | None:
    """Where the JACK server in use listens, if it does where JACK 2 does by default."""
    if not hasattr(os, "getuid") or not hasattr(socket, "AF_UNIX"):
        return None
    server = os.environ.get("JACK_DEFAULT_SERVER") or "default"
    for folder in ("/dev/shm", "/tmp"):
        path = f"{folder}/jack_{server}_{os.getuid()}_0"
        if _answers(path):
            return path
    return None


def _answers(path: str) -> bool:
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(path)
        except OSError:
            return False
    return True


class _Port:
    """An open port."""

    def __init__(self, name: str, client: Any, stream: MidiStream) -> None:
        self.name = name
        self.client = client
        self.stream = stream
        self.clock = ArrivalClock()
        self.overrun = 0
        self._piled_up = 0

    def fetch(self) -> bool:
        """Plays what has come, at most _AT_ONCE messages; returns whether there may be more."""
        for _ in range(_AT_ONCE):
            message = self.client.get_message()
            if message is None:
                self._piled_up = 0
                return False
            data, gap_s = message
            self.stream.feed(data, self.clock.time_ns(gap_s, time.monotonic_ns()))
        self._piled_up += _AT_ONCE
        if self._piled_up >= QUEUE_MESSAGES - _AT_ONCE:
            self._piled_up = 0
            self.overrun += 1
        return True

    def close(self) -> None:
        self.stream.release(time.monotonic_ns())
        with silenced():
            self.client.delete()


class MidiInputs:
    """Listens to MIDI ports and gives their events to `sink`.

    names    ports by number, name or part of a name; none: every port there is or will be, but "Midi Through";
             ["none"]: no MIDI at all
    sink     sink(kind, channel, a, b, value, time_ns) -> bool, like Deck.send; called from one thread
    say      takes a line for the player
    virtual  name of a port of one's own that other programs can connect to; None: none
    backend  as for `port_names`
    channel  listen to this MIDI channel (1…16) only

    Raises MidiPortError for ports that are not there and, where ports are named, without a MIDI system.
    """

    def __init__(
        self,
        names: Sequence[str],
        sink: Sink,
        say: Callable[[str], None] = lambda _: None,
        virtual: str | None = VIRTUAL,
        backend: str | None = None,
        channel: int | None = None,
    ) -> None:
        if channel is not None and not 1 <= channel <= 16:
            raise MidiPortError(f"the MIDI channel must lie between 1 and 16, got {channel}")
        self._off = means_none(names)
        self._names = list(names)
        self._sink, self._say = sink, say
        self._virtual_name = virtual
        self._backend = backend
        self._channel = channel
        self._system: _System | None = None
        self._virtual: _Port | None = None
        self._ports: list[_Port] = []
        self._wanted: Counter[str] | None = None  # plain names, if ports were named
        self._known: set[str] = set()  # plain names of ports that were open once
        self._refused: set[str] = set()
        self._before: dict[str, PortCount] = {}
        self._lock = threading.Lock()
        self._end = threading.Event()
        self._thread: Worker | None = None

    @property
    def system(self) -> str:
        """Name of the MIDI system; empty without one."""
        return self._system.name if self._system is not None else ""

    @property
    def connected(self) -> list[str]:
        """Names of the ports that are open now, without one's own."""
        return [port.name for port in self._ports]

    def counts(self) -> list[PortCount]:
        """What came in through every port that is or was open, one's own first."""
        with self._lock:
            counts = dict(self._before)
            for port in self._all():
                counts[_plain(port.name)] = self._count(port)
            return list(counts.values())

    def _count(self, port: _Port) -> PortCount:
        stream = port.stream
        before = self._before.get(_plain(port.name), PortCount(port.name, 0, 0, 0, 0))
        return PortCount(
            port.name,
            before.messages + stream.messages,
            before.ignored + stream.ignored,
            before.lost + stream.lost,
            before.overrun + port.overrun,
        )

    def _all(self) -> list[_Port]:
        return ([self._virtual] if self._virtual is not None else []) + self._ports

    def open(self) -> None:
        """Opens the ports and begins to listen; says which."""
        if self._off or self._thread is not None:
            return
        try:
            self._system = _System(self._backend)
        except _NoMidiSystem as reason:
            if self._names:
                raise MidiPortError(_not_without_system(self._names, reason)) from None
            self._say(f"no MIDI system: {reason}")
            return
        try:
            if self._names:
                listed = self._system.names()
                chosen = dict.fromkeys(find_port(name, listed) for name in self._names)
                self._wanted = Counter(_plain(listed[number]) for number in chosen)
                # Of two of one name, the one that was meant.
                for number in chosen:
                    self._open_port(listed[number], number, must=True)
            self._open_virtual()
            self._look()
        except BaseException:
            self.close()
            raise
        self._end.clear()
        self._thread = Worker(self._listen, "midi in")
        self._thread.start()

    def poll(self) -> None:
        """Looks which ports have gone or come; about twice a second, from one thread."""
        if self._thread is None:
            return
        if self._system is None:
            with suppress(_NoMidiSystem):
                self._system = _System(self._backend)
                self._say(f"{self._system.name} is back")
                self._open_virtual()
        elif not self._system.alive:
            self._say(f"the {self._system.name} server has stopped; MIDI resumes when it is back")
            for port in self._all():
                self._drop(port)
            self._system.close()
            self._system = None
        if self._system is not None:
            self._look()

    def _look(self) -> None:
        assert self._system is not None
        names = self._system.names()
        left = list(enumerate(names))
        for port in list(self._ports):
            found = next((entry for entry in left if entry[1] == port.name), None)
            if found is not None:
                left.remove(found)
                continue
            held = port.stream.held
            self._drop(port)
            self._say(f"MIDI port gone: {_plain(port.name)}" + (", its notes were released" if held else ""))
        for number, name in left:
            if self._wants(name):
                self._open_port(name, number)

    def _wants(self, name: str) -> bool:
        plain = _plain(name)
        if self._wanted is not None:
            return self._wanted[plain] > sum(_plain(port.name) == plain for port in self._ports)
        # No loops: neither through ALSA's own nor from a port of this program.
        own = plain.partition(":")[0]
        return "midi through" not in plain.lower() and not re.fullmatch(rf"{re.escape(CLIENT)}(-\d+)?", own)

    def _open_port(self, name: str, number: int, must: bool = False) -> None:
        assert self._system is not None
        plain = _plain(name)
        try:
            with silenced():
                client = self._system.open(name, number)
        except (MidiPortError, self._system.errors) as problem:
            if must:
                raise MidiPortError(f"the MIDI port {name!r} cannot be opened: {problem}") from None
            if name not in self._refused:
                self._refused.add(name)
                self._say(f"MIDI port {plain} cannot be opened: {problem}")
            return
        self._refused.discard(name)
        port = _Port(name, client, MidiStream(self._sink, self._channel))
        with self._lock:
            self._ports.append(port)
        self._say(f"MIDI port {'back' if plain in self._known else 'connected'}: {plain}")
        self._known.add(plain)

    def _open_virtual(self) -> None:
        if self._virtual_name is None or self._system is None:
            return
        try:
            with silenced():
                client = self._system.open_virtual(self._virtual_name)
        except self._system.errors as problem:
            self._say(f"no MIDI port offered to other programs: {problem}")
            return
        if client is not None:
            port = _Port(f"{self._virtual_name} (virtual)", client, MidiStream(self._sink, self._channel))
            with self._lock:
                self._virtual = port

    def _drop(self, port: _Port) -> None:
        with self._lock:
            if port is self._virtual:
                self._virtual = None
            else:
                self._ports.remove(port)
            # What came before it went, notes that end among it.
            while port.fetch():
                pass
            port.close()
            self._before[_plain(port.name)] = self._count(port)

    def _listen(self) -> None:
        while not self._end.is_set():
            with self._lock:
                more = [port.fetch() for port in self._all()]
            if not any(more):
                time.sleep(LOOK_EVERY_S)

    def close(self) -> None:
        """Lets go of what is held, closes all ports. May be called again."""
        self._end.set()
        thread, self._thread = self._thread, None
        try:
            if thread is not None:
                thread.ended()
        finally:
            for port in self._all():
                self._drop(port)
            if self._system is not None:
                self._system.close()
                self._system = None


def _plain(name: str) -> str:
    return (_ADDRESS_OF_WINDOWS if sys.platform == "win32" else _ADDRESS).sub("", name)
