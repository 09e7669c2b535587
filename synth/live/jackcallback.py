"""What JACK calls for sound: compiled, without the interpreter. It reads JACK's MIDI itself.

A message at offset k of a period is played at frame k of that period: to the sample, and without further delay.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import carray, int64, njit, types, uint8
from numba.extending import intrinsic

from synth.engine.layout import CORE
from synth.jit.entries import entry, kernel
from synth.live import exchange as d
from synth.live.exchange import exchange_of, stems_of
from synth.live.render_block import render_block, tick
from synth.midi.events import decode
from synth.native.arrays import LINE_F8, allocate, i8, u1
from synth.native.atomics import add, load, send, store
from synth.native.clocks import monotonic_ns, pointer
from synth.native.views import opener, table

#: bytes of system-exclusive messages that can wait, each with LENGTH bytes that tell how many it has
EXCLUSIVE = 1 << 16
LENGTH = 4
#: JACK's frame times and offsets have 32 bits
_MASK = 0xFFFFFFFF

#: places in Jack.words, a cache line apart
(
    PLAYING,  # 1: the deck sounds; 0: silence
    PERIODS,  # that JACK has asked for
    GONE,  # 1: the server has ended, or has thrown this client out
    FIRST,  # JACK's frame time less the deck's frame, of the latest period; −1: none has been yet
    WRITTEN,  # bytes put into the ring of system-exclusive messages
    TAKEN,  # … and taken
    LOST,  # messages that did not fit there, or of which a period had too many
    SKIPPED,  # frames of JACK's time that it has not asked for
    JUMPED,  # by how many frames JACK's time has jumped in all, back too (another period)
    TOO_LATE,  # periods handed over after the next one had begun
    ENDING,  # 1: who plays system-exclusive messages is to end
) = range(0, 11 * LINE_F8, LINE_F8)
N_WORDS = 11 * LINE_F8


class Jack(NamedTuple):
    """What the callback knows, behind one address. Functions, ports and the client are addresses of the JACK library's."""

    deck: int  # the Exchange's table
    client: int
    midi_in: int
    out_left: int
    out_right: int
    port_get_buffer: int
    midi_get_event_count: int
    midi_event_get: int
    last_frame_time: int
    frames_since_cycle_start: int
    wake: int  # where to send tokens when a system-exclusive message waits
    stems: Annotated[np.ndarray, i8("stems, 2")]  # ports
    words: Annotated[np.ndarray, i8("N_WORDS")]
    message: Annotated[np.ndarray, i8("3")]  # jack_midi_event_t: offset, number of bytes, their address
    exclusive: Annotated[np.ndarray, u1("EXCLUSIVE")]


jack_of = opener(Jack)


def new_jack(stems: np.ndarray, **addresses: Any) -> tuple[Jack, np.ndarray]:
    """A Jack and its table; to be kept as long as a callback has the table's address. stems: (parts or 0, 2) ports."""
    sizes = {"stems": len(stems), "N_WORDS": N_WORDS, "EXCLUSIVE": EXCLUSIVE}
    made = allocate(Jack, sizes, stems=stems, **addresses)
    made.words[FIRST] = -1
    return made, table(made)


_I32, _I64 = ir.IntType(32), ir.IntType(64)


def _c_call(result: ir.Type, arguments: list[ir.Type]) -> Any:
    """Call a C function at an address with int64 cut to its arguments; its result as int64, unsigned."""

    def generate(context, builder, signature, values):
        kind = ir.FunctionType(result, arguments)
        given = [
            value if wanted == _I64 else builder.trunc(value, wanted)
            for wanted, value in zip(arguments, values[1:], strict=True)
        ]
        returned = builder.call(builder.inttoptr(values[0], kind.as_pointer()), given)
        return returned if result == _I64 else builder.zext(returned, _I64)

    signature = types.int64(*[types.int64] * (1 + len(arguments)))
    if len(arguments) == 1:
        return intrinsic(lambda typingctx, function, a: (signature, generate))
    if len(arguments) == 2:
        return intrinsic(lambda typingctx, function, a, b: (signature, generate))
    return intrinsic(lambda typingctx, function, a, b, c: (signature, generate))


#: void *jack_port_get_buffer(port, frames)
_get_buffer = _c_call(_I64, [_I64, _I32])
#: uint32_t jack_midi_get_event_count(buffer), jack_last_frame_time(client) and jack_frames_since_cycle_start(client)
_ask_number = _c_call(_I32, [_I64])
#: int jack_midi_event_get(event, buffer, index)
_get_event = _c_call(_I32, [_I64, _I64, _I32])

_decoded = njit(**CORE)(decode)


def _process(count: int, address: int) -> int:
    """JackProcessCallback; `address` of a Jack is its argument. `count` has 32 bits, behind which C leaves what it likes."""
    now = monotonic_ns()
    jack = jack_of(address)
    frames = count & _MASK
    add(jack.words, PERIODS, 1)
    left = _samples(address, jack.out_left, frames)
    right = _samples(address, jack.out_right, frames)
    if load(jack.words, PLAYING) == 0:
        _silence(left)
        _silence(right)
        for p in range(jack.stems.shape[0]):
            for side in range(2):
                _silence(_samples(address, jack.stems[p, side], frames))
        return 0
    words = exchange_of(jack.deck).words
    nominal = 1e9 / exchange_of(jack.deck).rate_hz
    begun = now - _ask_number(jack.frames_since_cycle_start, jack.client) * nominal
    first = (_ask_number(jack.last_frame_time, jack.client) - words[d.FRAMES]) & _MASK
    if first != jack.words[FIRST]:
        skipped = (first - jack.words[FIRST]) & _MASK
        if jack.words[FIRST] >= 0:
            forward = skipped <= _MASK // 2
            jack.words[JUMPED] += skipped if forward else skipped - _MASK - 1
            if forward:
                jack.words[SKIPPED] += skipped
        jack.words[FIRST] = first
    played = words[d.PLAYED]
    tick(jack.deck, played, frames, now)
    notes = _get_buffer(jack.port_get_buffer, jack.midi_in, frames)
    messages = _ask_number(jack.midi_get_event_count, notes)
    taken = 0
    done = 0
    while done < frames:
        until = min(frames, done + d.MOST_FRAMES)
        taken, given = _give(address, notes, messages, taken, done, until)
        render_block(jack.deck, given, until - done)
        mix, stems = exchange_of(jack.deck).mix, stems_of(jack.deck, until - done)
        for i in range(until - done):
            left[done + i] = np.float32(mix[i, 0])
            right[done + i] = np.float32(mix[i, 1])
        for p in range(jack.stems.shape[0]):
            for side in range(2):
                out = _samples(address, jack.stems[p, side], frames)
                for i in range(until - done):
                    out[done + i] = np.float32(stems[p, i, side])
        done = until
    words[d.PLAYED] = played + frames
    # PipeWire drops such a period, and tells nobody.
    if monotonic_ns() - begun > frames * nominal:
        jack.words[TOO_LATE] += 1
    return 0


@njit(**CORE)
def _samples(address: int, port: int, frames: int):
    """The samples of an output port in this period."""
    return carray(pointer(_get_buffer(jack_of(address).port_get_buffer, port, frames)), frames, np.float32)


@njit(**CORE)
def _silence(out) -> None:
    for i in range(out.size):
        out[i] = np.float32(0.0)


@njit(**CORE)
def _give(address: int, notes: int, messages: int, taken: int, begin: int, end: int) -> tuple[int, int]:
    """Messages of frames `begin` to `end` of the period, the first number `taken`, into Exchange.given: the first that is
    left, and how many events there are."""
    jack = jack_of(address)
    given = exchange_of(jack.deck).given
    count = 0
    while taken < messages:
        if _get_event(jack.midi_event_get, jack.message.ctypes.data, notes, taken) != 0:
            taken += 1
            continue
        offset = jack.message[0] & _MASK
        if offset >= end:
            break
        taken += 1
        size = jack.message[1]
        data = carray(pointer(jack.message[2]), size, np.uint8)
        if size == 0:
            continue
        status = int(data[0])
        if status == 0xF0:
            _keep(address, data)
            continue
        if size > 3 or status < 0x80 or status >= 0xF0 or size != (2 if status >> 4 in (0xC, 0xD) else 3):
            continue
        kind, channel, a, b = _decoded(status, int(data[1]), int(data[2]) if size == 3 else 0)
        if kind == 0:
            continue
        if count >= given.size:
            jack.words[LOST] += 1
            continue
        event = given[count]
        event.frame = offset - begin
        event.kind, event.channel, event.a, event.b, event.value = kind, channel, a, b, 0.0
        count += 1
    return taken, count


@njit(**CORE)
def _keep(address: int, data) -> None:
    """Put a system-exclusive message into the ring and wake who plays it."""
    jack = jack_of(address)
    at = jack.words[WRITTEN]
    if at + LENGTH + data.size - load(jack.words, TAKEN) > EXCLUSIVE:
        jack.words[LOST] += 1
        return
    for i in range(LENGTH):
        jack.exclusive[(at + i) % EXCLUSIVE] = (data.size >> (8 * i)) & 0xFF
    for i in range(data.size):
        jack.exclusive[(at + LENGTH + i) % EXCLUSIVE] = data[i]
    store(jack.words, WRITTEN, at + LENGTH + data.size)
    send(jack.wake)


@kernel(int64, uint8[::1], answer=int64)
def pop_exclusive(address: int, out) -> int:
    """The next system-exclusive message, from its F0 to its F7, into an array of EXCLUSIVE bytes: how many it has; 0:
    there is none. For one thread only."""
    jack = jack_of(address)
    at = jack.words[TAKEN]
    if at == load(jack.words, WRITTEN):
        return 0
    size = 0
    for i in range(LENGTH):
        size |= int(jack.exclusive[(at + i) % EXCLUSIVE]) << (8 * i)
    for i in range(size):
        out[i] = jack.exclusive[(at + LENGTH + i) % EXCLUSIVE]
    store(jack.words, TAKEN, at + LENGTH + size)
    return size


def _xrun(address: int) -> int:
    """JackXRunCallback."""
    jack = jack_of(address)
    if load(jack.words, PLAYING):
        add(exchange_of(jack.deck).words, d.XRUNS, 1)
    return 0


def _shutdown(_status: int, _reason: int, address: int) -> None:
    """JackInfoShutdownCallback."""
    store(jack_of(address).words, GONE, 1)


def _hush(_text: int) -> None:
    """What the library would print."""


class Callbacks(NamedTuple):
    """Compiled; each has its `.address`."""

    process: Any
    xrun: Any
    shutdown: Any
    hush: Any


#: (function, words that it takes, whether it answers) of each
CALLED = ((_process, 2, True), (_xrun, 1, True), (_shutdown, 3, False), (_hush, 1, False))


def callbacks() -> Callbacks:
    """From the native library, or compiled on first use."""
    return Callbacks(*(entry(*each) for each in CALLED))
