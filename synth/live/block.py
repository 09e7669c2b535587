"""One block of a live session in compiled code: which events belong to it, their sound, what it cost.

An event that arrives from outside bears the time of its arrival. It sounds a fixed number of frames later (`DELAY`, a
block), wherever in a block it came: early or late callbacks move nothing. The time of a frame comes from a delay-locked
loop over the callbacks' times (Adriaensen, “Using a DLL to filter time”, Linux Audio Conference 2005).
"""

from __future__ import annotations

import math

from numba import njit

from synth.engine.atomics import load, store
from synth.engine.core import state_of
from synth.engine.events import NOTE_ON
from synth.engine.layout import CORE, SPARE
from synth.engine.process import process
from synth.live import desk as d
from synth.live.desk import copy_event, desk_of, stems_of
from synth.live.native import monotonic_ns, thread_ns

#: bandwidth of the loop that smooths the callbacks' times [Hz]
CLOCK_HZ = 0.5
#: a callback this many of its blocks away from its time begins the clock anew
STALLED = 2.0
#: with Desk.words[ADAPTIVE]: above the one mean load the level below which strings are spared rises, below the other it
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
    desk = desk_of(address)
    words, levels = desk.words, desk.levels
    now = float(now_ns - desk.origin_ns)
    changes = load(words, d.CLOCK)
    frames = played - words[d.CLOCK_FRAME]
    if changes > 0 and frames <= 0:
        return
    if changes > 0:
        words[d.PERIOD] = frames
    store(words, d.CLOCK, changes + 1)
    nominal = 1e9 / desk.rate_hz
    predicted = levels[d.CLOCK_NS] + frames * levels[d.FRAME_NS]
    error = now - predicted
    if changes == 0 or abs(error) > STALLED * frames * nominal:
        if changes > 0:
            words[d.STALLS] += 1
        levels[d.CLOCK_NS] = now
        levels[d.FRAME_NS] = nominal
    else:
        omega = min(0.5, 2.0 * math.pi * CLOCK_HZ * frames / desk.rate_hz)
        levels[d.CLOCK_NS] = predicted + math.sqrt(2.0) * omega * error
        levels[d.FRAME_NS] += omega * omega * error / frames
    store(words, d.CLOCK_FRAME, played)
    store(words, d.CLOCK_TIME, int(levels[d.CLOCK_NS]))
    store(words, d.CLOCK_STEP, int(d.STEP * levels[d.FRAME_NS]))
    store(words, d.DELAY, delay)
    store(words, d.CLOCK, changes + 2)


@njit("int64(int64, int64)", cache=True, nogil=True)
def frame_at(address: int, time_ns: int) -> int:
    """Frame of the stream at which an event that arrives at a time sounds (the engine's latency follows)."""
    desk = desk_of(address)
    words = desk.words
    frame = 0
    for _ in range(PATIENCE):
        changes = load(words, d.CLOCK)
        since = float(time_ns - desk.origin_ns - load(words, d.CLOCK_TIME))
        frame = load(words, d.CLOCK_FRAME) + load(words, d.DELAY) + math.floor(since * d.STEP / load(words, d.CLOCK_STEP))
        if changes % 2 == 0 and load(words, d.CLOCK) == changes:
            break
    return int(frame)


@njit(**CORE)
def render_block(address: int, given: int, frames: int) -> None:
    """The next frames (at most MOST_FRAMES) into Desk.mix and Desk.stems; the device brings `given` events in Desk.given."""
    wall, used = monotonic_ns(), thread_ns()
    desk = desk_of(address)
    words = desk.words
    start = words[d.FRAMES]
    count = _gather(address, given, start, frames)
    events = desk.block[:count]
    mix = desk.mix[:frames]
    process(desk.core, desk.desk, events, mix, stems_of(address, frames))
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
    """The block's events from all sources into Desk.block, by frame; how many. Frames count from the block's start."""
    desk = desk_of(address)
    words = desk.words
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
            at = max(desk.score[scored % d.EVENTS].frame - start, last)
            if at < frame:
                frame, source = at, 0
        if brought < given:
            at = min(max(desk.given[brought].frame, last), frames - 1)
            if at < frame:
                frame, source = at, 1
        if arrived < arrivals_end:
            at = max(frame_at(address, desk.arrivals[arrived % d.EVENTS].frame) - start, last)
            if at < frame:
                frame, source = at, 2
        if source < 0:
            break
        event = desk.block[count]
        if source == 0:
            copy_event(desk.score[scored % d.EVENTS], event)
            scored += 1
        elif source == 1:
            copy_event(desk.given[brought], event)
            brought += 1
        else:
            copy_event(desk.arrivals[arrived % d.EVENTS], event)
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
    desk = desk_of(address)
    words = desk.words
    at = words[d.LOGGED]
    room = d.EVENTS - (at - load(words, d.LOG_TAKEN))
    kept = min(room, count)
    for i in range(kept):
        event = desk.log[(at + i) % d.EVENTS]
        copy_event(desk.block[i], event)
        event.frame += start
    words[d.LOG_LOST] += count - kept
    store(words, d.LOGGED, at + kept)


@njit(**CORE)
def _tape(address: int, frames: int) -> None:
    desk = desk_of(address)
    words = desk.words
    at = words[d.TAPED]
    room = d.TAPE - (at - load(words, d.TAPE_TAKEN))
    kept = min(room, frames)
    for i in range(kept):
        desk.tape[(at + i) % d.TAPE, 0] = desk.mix[i, 0]
        desk.tape[(at + i) % d.TAPE, 1] = desk.mix[i, 1]
    words[d.TAPE_LOST] += frames - kept
    store(words, d.TAPED, at + kept)


@njit(**CORE)
def _meter(address: int, frames: int) -> None:
    desk = desk_of(address)
    peak = desk.levels[d.PEAK]
    if desk.words[d.PEAK_SEEN]:
        desk.words[d.PEAK_SEEN] = 0
        peak = 0.0
    for i in range(frames):
        peak = max(peak, abs(desk.mix[i, 0]), abs(desk.mix[i, 1]))
    desk.levels[d.PEAK] = peak


@njit(**CORE)
def _account(address: int, frames: int, wall_ns: int, used_ns: int) -> None:
    """Keep what a block has cost."""
    desk = desk_of(address)
    words = desk.words
    time_ns = frames * 1e9 / desk.rate_hz
    blocks = words[d.BLOCKS]
    wall, used = wall_ns / time_ns, used_ns / time_ns
    desk.loads[blocks % d.LOADS, 0] = wall
    desk.loads[blocks % d.LOADS, 1] = used
    if used > 1.0:
        words[d.LATE_OURS] += 1
    elif wall > 1.0:
        words[d.LATE_OTHERS] += 1
    share = 1.0 - math.exp(-time_ns / (1e9 * LOAD_S))
    desk.levels[d.MEAN_LOAD] += share * (wall - desk.levels[d.MEAN_LOAD])
    if words[d.ADAPTIVE]:
        govern(address, 1e-9 * time_ns)
    store(words, d.BLOCKS, blocks + 1)


@njit(**CORE)
def govern(address: int, seconds: float) -> None:
    """Under load let strings that nobody holds end the earlier, the quietest first: the engine damps them, none is cut."""
    desk = desk_of(address)
    load_now, level = desk.levels[d.MEAN_LOAD], desk.levels[d.SPARE_DB]
    if load_now > BUSY:
        level = min(MOST_DB, level + RISE_DB * seconds)
    elif load_now < IDLE:
        level = max(LEAST_DB, level - FALL_DB * seconds)
    desk.levels[d.SPARE_DB] = level
    state_of(desk.core).meters[SPARE] = 10.0 ** (level / 20.0) if level > LEAST_DB else 0.0
