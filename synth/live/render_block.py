"""One block of a live session in compiled code: which events belong to it, their sound, what it cost.

An event that arrives from outside bears the time of its arrival. It sounds a fixed number of frames later (`DELAY`, a
block), wherever in a block it came: early or late callbacks move nothing. The time of a frame comes from a delay-locked
loop over the callbacks' times (Adriaensen, “Using a DLL to filter time”, Linux Audio Conference 2005).
"""

from __future__ import annotations

import math

from numba import int64, njit

from synth.engine.core import state_of
from synth.engine.layout import CORE, SPARE
from synth.engine.process import process
from synth.jit.entries import kernel
from synth.live import exchange as d
from synth.live.exchange import copy_event, exchange_of, stems_of
from synth.midi.events import NOTE_ON
from synth.native.atomics import load, store
from synth.native.clocks import monotonic_ns, thread_ns

#: bandwidth of the loop that smooths the callbacks' times [Hz]
CLOCK_HZ = 0.5
#: a callback this many of its blocks away from its time begins the clock anew
STALLED = 2.0
#: with Exchange.words[ADAPTIVE]: above the one mean load the level below which strings are spared rises, below the other it
#: falls [dB/s], between these levels [dBFS]; at the lowest nothing is spared. The engine's level
#: of a string is a bound from its energy, some 20 dB above what sounds
BUSY, IDLE = 0.75, 0.5
RISE_DB, FALL_DB = 20.0, 5.0
LEAST_DB, MOST_DB = -100.0, -26.0
#: the mean load follows the loads of blocks with this time constant [s]
LOAD_S = 0.3
#: times that a reader looks at the clock before it takes what it sees, a block wrong at most: who changes the clock may
#: be a thread that this one keeps from running
PATIENCE = 1000


@njit(**CORE)
def tick(address: int, played: int, delay: int, now_ns: int) -> None:
    """The device asks for frame `played` at a time."""
    exchange = exchange_of(address)
    words, levels = exchange.words, exchange.levels
    now = float(now_ns - words[d.ORIGIN_NS])
    changes = load(words, d.CLOCK)
    frames = played - words[d.CLOCK_FRAME]
    if changes > 0 and frames <= 0:
        return
    if changes > 0:
        words[d.PERIOD] = frames
    store(words, d.CLOCK, changes + 1)
    nominal = 1e9 / exchange.rate_hz
    predicted = levels[d.CLOCK_NS] + frames * levels[d.FRAME_NS]
    error = now - predicted
    if changes == 0 or abs(error) > STALLED * frames * nominal:
        if changes > 0:
            words[d.STALLS] += 1
        levels[d.CLOCK_NS] = now
        levels[d.FRAME_NS] = nominal
    else:
        omega = min(0.5, 2.0 * math.pi * CLOCK_HZ * frames / exchange.rate_hz)
        levels[d.CLOCK_NS] = predicted + math.sqrt(2.0) * omega * error
        levels[d.FRAME_NS] += omega * omega * error / frames
    store(words, d.CLOCK_FRAME, played)
    store(words, d.CLOCK_TIME, int(levels[d.CLOCK_NS]))
    store(words, d.CLOCK_STEP, int(d.STEP * levels[d.FRAME_NS]))
    store(words, d.DELAY, delay)
    store(words, d.CLOCK, changes + 2)


@kernel(int64, int64, answer=int64)
def frame_at(address: int, time_ns: int) -> int:
    """Frame of the stream at which an event that arrives at a time sounds (the engine's latency follows)."""
    exchange = exchange_of(address)
    words = exchange.words
    frame = 0
    for _ in range(PATIENCE):
        changes = load(words, d.CLOCK)
        since = float(time_ns - words[d.ORIGIN_NS] - load(words, d.CLOCK_TIME))
        frame = load(words, d.CLOCK_FRAME) + load(words, d.DELAY) + math.floor(since * d.STEP / load(words, d.CLOCK_STEP))
        if changes % 2 == 0 and load(words, d.CLOCK) == changes:
            break
    return int(frame)


@njit(**CORE)
def render_block(address: int, given: int, frames: int) -> None:
    """The next frames (at most MOST_FRAMES) into Exchange.mix and Exchange.stems; the device brings `given` events in
    Exchange.given."""
    wall, used = monotonic_ns(), thread_ns()
    exchange = exchange_of(address)
    words = exchange.words
    start = words[d.FRAMES]
    count = _gather(address, given, start, frames)
    events = exchange.block[:count]
    mix = exchange.mix[:frames]
    process(exchange.core, exchange.thread, events, mix, stems_of(address, frames))
    for i in range(count):
        if events[i].kind == NOTE_ON and events[i].b > 0:
            words[d.NOTE], words[d.VELOCITY], words[d.CHANNEL] = events[i].a, events[i].b, events[i].channel
    if words[d.RECORDING]:
        _log(address, start, count)
        _tape(address, frames)
    _meter(address, frames)
    words[d.GIVEN] += count
    _account(address, frames, monotonic_ns() - wall, thread_ns() - used)
    store(words, d.FRAMES, start + frames)


@njit(**CORE)
def _gather(address: int, given: int, start: int, frames: int) -> int:
    """The block's events from all sources into Exchange.block, by frame; how many. Frames count from the block's start."""
    exchange = exchange_of(address)
    words = exchange.words
    drops = load(words, d.DROPS_ASKED)
    scored, score_end = load(words, d.SCORE_TAKEN), load(words, d.SCORED)
    if drops != words[d.DROPS]:
        # Nothing more of it from this block on; whoever asked adds nothing until he reads that it is done.
        scored = score_end
        words[d.DROPPED_AT] = start
        store(words, d.SCORE_TAKEN, scored)
        store(words, d.DROPS, drops)
    arrived, arrivals_end = load(words, d.ARRIVALS_TAKEN), load(words, d.ARRIVED)
    brought = 0
    last = 0
    count = 0
    while count < d.BLOCK_EVENTS:
        frame = frames
        source = -1
        if scored < score_end:
            at = max(exchange.score[scored % d.EVENTS].frame - start, last)
            if at < frame:
                frame, source = at, 0
        if brought < given:
            at = min(max(exchange.given[brought].frame, last), frames - 1)
            if at < frame:
                frame, source = at, 1
        if arrived < arrivals_end:
            at = max(frame_at(address, exchange.arrivals[arrived % d.EVENTS].frame) - start, last)
            if at < frame:
                frame, source = at, 2
        if source < 0:
            break
        event = exchange.block[count]
        if source == 0:
            copy_event(exchange.score[scored % d.EVENTS], event)
            scored += 1
        elif source == 1:
            copy_event(exchange.given[brought], event)
            brought += 1
        else:
            copy_event(exchange.arrivals[arrived % d.EVENTS], event)
            arrived += 1
        event.frame = frame
        last = frame
        count += 1
    words[d.GIVEN_LOST] += given - brought
    store(words, d.SCORE_TAKEN, scored)
    store(words, d.ARRIVALS_TAKEN, arrived)
    return count


@njit(**CORE)
def _log(address: int, start: int, count: int) -> None:
    exchange = exchange_of(address)
    words = exchange.words
    at = words[d.LOGGED]
    room = d.EVENTS - (at - load(words, d.LOG_TAKEN))
    kept = min(room, count)
    for i in range(kept):
        event = exchange.log[(at + i) % d.EVENTS]
        copy_event(exchange.block[i], event)
        event.frame += start
    words[d.LOG_LOST] += count - kept
    store(words, d.LOGGED, at + kept)


@njit(**CORE)
def _tape(address: int, frames: int) -> None:
    exchange = exchange_of(address)
    words = exchange.words
    at = words[d.TAPED]
    room = d.TAPE - (at - load(words, d.TAPE_TAKEN))
    kept = min(room, frames)
    for i in range(kept):
        exchange.tape[(at + i) % d.TAPE, 0] = exchange.mix[i, 0]
        exchange.tape[(at + i) % d.TAPE, 1] = exchange.mix[i, 1]
    words[d.TAPE_LOST] += frames - kept
    store(words, d.TAPED, at + kept)


@njit(**CORE)
def _meter(address: int, frames: int) -> None:
    exchange = exchange_of(address)
    peak = exchange.levels[d.PEAK]
    if exchange.words[d.PEAK_SEEN]:
        exchange.words[d.PEAK_SEEN] = 0
        peak = 0.0
    for i in range(frames):
        peak = max(peak, abs(exchange.mix[i, 0]), abs(exchange.mix[i, 1]))
    exchange.levels[d.PEAK] = peak


@njit(**CORE)
def _account(address: int, frames: int, wall_ns: int, used_ns: int) -> None:
    """Keep what a block has cost."""
    exchange = exchange_of(address)
    words = exchange.words
    time_ns = frames * 1e9 / exchange.rate_hz
    blocks = words[d.BLOCKS]
    wall, used = wall_ns / time_ns, used_ns / time_ns
    exchange.loads[blocks % d.LOADS, 0] = wall
    exchange.loads[blocks % d.LOADS, 1] = used
    if used > 1.0:
        words[d.LATE_OURS] += 1
    elif wall > 1.0:
        words[d.LATE_OTHERS] += 1
    share = 1.0 - math.exp(-time_ns / (1e9 * LOAD_S))
    exchange.levels[d.MEAN_LOAD] += share * (wall - exchange.levels[d.MEAN_LOAD])
    if words[d.ADAPTIVE]:
        govern(address, 1e-9 * time_ns)
    store(words, d.BLOCKS, blocks + 1)


@njit(**CORE)
def govern(address: int, seconds: float) -> None:
    """Under load let strings that nobody holds end the earlier, the quietest first: the engine damps them, none is cut."""
    exchange = exchange_of(address)
    load_now, level = exchange.levels[d.MEAN_LOAD], exchange.levels[d.SPARE_DB]
    if load_now > BUSY:
        level = min(MOST_DB, level + RISE_DB * seconds)
    elif load_now < IDLE:
        level = max(LEAST_DB, level - FALL_DB * seconds)
    exchange.levels[d.SPARE_DB] = level
    state_of(exchange.core).meters[SPARE] = 10.0 ** (level / 20.0) if level > LEAST_DB else 0.0
