"""The memory that a live session's threads share: rings of events and of sound, a clock, meters. No locks.

Every ring has one writer and one reader. Places count up for ever; element i lies at i modulo the ring's size, a power of
two; the writer stores its place after the element, the reader its own after it has read.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numba import boolean, float64, from_dtype, int64, njit

from synth.engine.layout import CORE
from synth.jit.entries import kernel
from synth.midi.events import EVENT
from synth.midi.events import copy_event as _copy_event
from synth.native.arrays import LINE_F8, allocate, f8, i8, struct
from synth.native.atomics import load, store
from synth.native.views import opener, table

#: events that can wait at a time, in each ring
EVENTS = 16384
#: events that one block takes; the rest waits for the next
BLOCK_EVENTS = 4096
#: frames that are rendered at a time
MOST_FRAMES = 4096
#: frames of output kept for whoever records: 24 s at 44.1 kHz
TAPE = 1 << 20
#: blocks whose load is kept
LOADS = 8192
#: parts of a nanosecond in which the time of a frame is told to other threads
STEP = 2.0**32

#: places in Exchange.words, a cache line apart: what was written to and read from the rings …
(
    ARRIVED,
    ARRIVALS_TAKEN,
    SCORED,
    SCORE_TAKEN,
    LOGGED,
    LOG_TAKEN,
    TAPED,
    TAPE_TAKEN,
    AHEAD,
    AHEAD_TAKEN,
    # … frames and blocks rendered, frames handed to the device, events given to the engine
    FRAMES,
    BLOCKS,
    PLAYED,
    GIVEN,
    # what was lost: blocks that the device missed; blocks late because of us, because of others; late calls; events of the
    # log, frames of the tape; events that the device brought beyond what a block takes
    XRUNS,
    LATE_OURS,
    LATE_OTHERS,
    STALLS,
    LOG_LOST,
    TAPE_LOST,
    GIVEN_LOST,
    # switches: 1 records; 1 spares under load; 1 asks for the peak to begin anew; 1 ends the thread that renders ahead
    RECORDING,
    ADAPTIVE,
    PEAK_SEEN,
    ENDING,
    # the clock's number of changes, odd while it changes; its frame, the time of that frame [ns since origin_ns] and of a
    # frame [2^−32 ns]; frames between an event and its place
    CLOCK,
    CLOCK_FRAME,
    CLOCK_TIME,
    CLOCK_STEP,
    DELAY,
    # note, velocity, channel of the last note
    NOTE,
    VELOCITY,
    CHANNEL,
    # how often it was asked to drop what is scheduled, how often that has been done, and before which frame last
    DROPS_ASKED,
    DROPS,
    DROPPED_AT,
    # frames that the device asked for in its latest call but one
    PERIOD,
    # as it was set up: channels of the device; parts whose stems are wanted, or 0; where the clock begins [ns]; frames of
    # sound that a thread keeps ready, 0: there is none; frames that it renders at a time
    CHANNELS,
    PARTS,
    ORIGIN_NS,
    AHEAD_FRAMES,
    AHEAD_BLOCK,
) = range(0, 42 * LINE_F8, LINE_F8)
N_WORDS = 42 * LINE_F8

#: places in Exchange.levels: the clock's own time of its frame [ns since origin_ns] and ns per frame; peak since it was
#: seen; mean load; the device's own latency [s]; the level below which strings are spared [dBFS]
CLOCK_NS, FRAME_NS, PEAK, MEAN_LOAD, DEVICE_S, SPARE_DB = range(6)
N_LEVELS = 6


class Exchange(NamedTuple):
    """A session's shared memory behind one address."""

    core: int  # the engine's tables
    thread: int
    rate_hz: float
    words: Annotated[np.ndarray, i8("N_WORDS")]
    levels: Annotated[np.ndarray, f8("N_LEVELS")]
    loads: Annotated[np.ndarray, f8("LOADS, 2")]  # part of a block's time: by the wall clock, by the processor's
    arrivals: Annotated[np.ndarray, struct(EVENT, "EVENTS")]  # `frame` is the time of arrival [ns]
    score: Annotated[np.ndarray, struct(EVENT, "EVENTS")]  # `frame` counts from the start of the stream
    log: Annotated[np.ndarray, struct(EVENT, "logged")]
    given: Annotated[np.ndarray, struct(EVENT, "BLOCK_EVENTS")]  # the device's own, `frame` from the block's start
    block: Annotated[np.ndarray, struct(EVENT, "BLOCK_EVENTS")]
    mix: Annotated[np.ndarray, f8("MOST_FRAMES, 2")]
    stems: Annotated[np.ndarray, f8("stems*MOST_FRAMES*2")]  # see `stems_of`
    tape: Annotated[np.ndarray, f8("taped, 2")]
    ready: Annotated[np.ndarray, f8("ready, 2")]  # sound rendered ahead


exchange_of = opener(Exchange)
copy_event = njit(**CORE)(_copy_event)


def new_exchange(
    core: int,
    thread: int,
    rate_hz: float,
    *,
    channels: int,
    origin_ns: int,
    parts: int,
    recording: bool,
    ahead_frames: int,
    ahead_block: int,
) -> tuple[Exchange, np.ndarray]:
    """An Exchange and its table; both are to be kept as long as anybody has the table's address."""
    ready = 1
    while ready < 2 * ahead_frames:
        ready *= 2
    sizes = {
        "N_WORDS": N_WORDS,
        "N_LEVELS": N_LEVELS,
        "LOADS": LOADS,
        "EVENTS": EVENTS,
        "BLOCK_EVENTS": BLOCK_EVENTS,
        "MOST_FRAMES": MOST_FRAMES,
        "logged": EVENTS if recording else 1,
        "stems": parts,
        "taped": TAPE if recording else 1,
        "ready": ready,
    }
    made = allocate(Exchange, sizes, core=core, thread=thread, rate_hz=rate_hz)
    made.words[[CHANNELS, PARTS, ORIGIN_NS]] = channels, parts, origin_ns
    made.words[[AHEAD_FRAMES, AHEAD_BLOCK]] = ahead_frames, ahead_block
    made.words[RECORDING] = int(recording)
    made.words[CLOCK_STEP] = int(STEP * 1e9 / rate_hz)
    made.levels[FRAME_NS] = 1e9 / rate_hz
    return made, table(made)


@njit(**CORE)
def stems_of(address: int, frames: int):
    """(parts or 0, frames, 2): every part by itself in a block of so many frames."""
    exchange = exchange_of(address)
    parts = exchange.words[PARTS]
    return exchange.stems[: parts * frames * 2].reshape((parts, frames, 2))


@kernel(*[int64] * 6, float64, answer=boolean)
def push_arrival(address: int, time_ns: int, kind: int, channel: int, a: int, b: int, value: float) -> bool:
    """Put an event that came at a time into the ring; False: it is full."""
    exchange = exchange_of(address)
    at = load(exchange.words, ARRIVED)
    if at - load(exchange.words, ARRIVALS_TAKEN) >= EVENTS:
        return False
    event = exchange.arrivals[at % EVENTS]
    event.frame, event.kind, event.channel, event.a, event.b, event.value = time_ns, kind, channel, a, b, value
    store(exchange.words, ARRIVED, at + 1)
    return True


@kernel(int64, from_dtype(EVENT)[::1], answer=int64)
def push_score(address: int, events) -> int:
    """Put as many of these events (absolute frames, ascending) into the ring as there is room for; how many."""
    exchange = exchange_of(address)
    at = load(exchange.words, SCORED)
    count = min(events.size, EVENTS - (at - load(exchange.words, SCORE_TAKEN)))
    for i in range(count):
        copy_event(events[i], exchange.score[(at + i) % EVENTS])
    store(exchange.words, SCORED, at + count)
    return count


@kernel(int64, from_dtype(EVENT)[::1], answer=int64)
def pop_log(address: int, events) -> int:
    """Take events out of the log into an array; how many."""
    exchange = exchange_of(address)
    at = load(exchange.words, LOG_TAKEN)
    count = min(events.size, load(exchange.words, LOGGED) - at)
    for i in range(count):
        copy_event(exchange.log[(at + i) % EVENTS], events[i])
    store(exchange.words, LOG_TAKEN, at + count)
    return count


@kernel(int64, float64[:, ::1], answer=int64)
def pop_tape(address: int, out) -> int:
    """Take frames off the tape into an array (n, 2); how many."""
    exchange = exchange_of(address)
    at = load(exchange.words, TAPE_TAKEN)
    count = min(out.shape[0], load(exchange.words, TAPED) - at)
    for i in range(count):
        out[i, 0] = exchange.tape[(at + i) % TAPE, 0]
        out[i, 1] = exchange.tape[(at + i) % TAPE, 1]
    store(exchange.words, TAPE_TAKEN, at + count)
    return count
