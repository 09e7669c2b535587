"""The native core: everything between an event and a sample, without the interpreter, locks or allocation.

Time counts from the start of the stream in frames of the output. Strings advance in quanta of QUANTUM frames, each cut
at the frames of the events that touch it and nowhere else, so that the host's block size changes nothing. A quantum is
computed when all of its events are known, which costs QUANTUM frames of latency. Quanta without an event inside are worked
off several at a time, as a span: string by string, each through the whole span, and then the mix. What is decided once per
quantum is decided at the same quanta whatever the span.
"""

from __future__ import annotations

from numba import float64, from_dtype, int64, njit

from synth.engine.core import bank_of, progress_of, settings_of, shared_of, span_of, state_of, stream_of, voice_of
from synth.engine.expression import approach, control_share
from synth.engine.instruments import cost, is_awake
from synth.engine.layout import (
    AWAKE,
    BEGIN,
    CORE,
    FIRST_QUANTUM,
    HANDLE,
    HEIGHT,
    N_DROPPED,
    NOW,
    PEAK,
    PENDING,
    PRODUCED,
    QUANTA,
    QUANTUM,
    RING,
    STRETCH,
    TASK,
    UNTIL,
    VOICES,
    WHOLE,
)
from synth.engine.mix import mix_span
from synth.engine.team import rouse, share_out
from synth.jit.entries import kernel
from synth.midi.events import EVENT, copy_event
from synth.native.denormals import enable_ftz, restore
from synth.native.views import tell

_copy_event = njit(**CORE)(copy_event)


@kernel(int64, int64, from_dtype(EVENT)[::1], float64[:, ::1], float64[:, :, ::1])
def process(core: int, thread: int, events, out, stems) -> None:
    """One block: `events` (EVENT, frames from the block's start, in order), `out` (frames, 2), `stems` (parts or 0,
    frames, 2). Output is late by QUANTUM + the latencies of the decimator and the effects."""
    saved = enable_ftz()
    state, stream, settings = state_of(core), stream_of(core), settings_of(core)
    now = state.counters[NOW]
    _queue_events(core, now, events)
    frames = out.shape[0]
    count, mode_steps = _list_awake(core, frames)
    rouse(core, count, mode_steps)
    done = 0
    while done < frames:
        until = min(frames, state.counters[PRODUCED] + QUANTUM - now)
        if until <= done:
            _produce(core, thread, now + frames - QUANTUM)
            continue
        first = now + done - QUANTUM
        state.meters[PEAK] = max(state.meters[PEAK], _copy_out(stream.ring, first, out[done:until]))
        late = first - settings.mix_latency
        for p in range(stems.shape[0]):
            _copy_out(stream.stems[p], late, stems[p, done:until])
        done = until
    state.counters[NOW] = now + frames
    restore(saved)


@njit(**CORE)
def _queue_events(core: int, now: int, events) -> None:
    state, stream = state_of(core), stream_of(core)
    for i in range(events.size):
        at = state.counters[PENDING]
        if at >= stream.pending.size:
            state.counters[N_DROPPED] += events.size - i
            break
        _copy_event(events[i], stream.pending[at])
        stream.pending[at].frame += now
        state.counters[PENDING] = at + 1


@njit(**CORE)
def _copy_out(ring, first: int, out) -> float:
    """Frames of a ring (RING, 2) from `first` on; the largest magnitude among them. What has not been is zero there."""
    peak = 0.0
    done = 0
    while done < out.shape[0]:
        at = (first + done) % RING
        count = min(out.shape[0] - done, RING - at)
        for i in range(count):
            left, right = ring[at + i, 0], ring[at + i, 1]
            out[done + i, 0] = left
            out[done + i, 1] = right
            peak = max(peak, abs(left), abs(right))
        done += count
    return peak


@njit(**CORE)
def _produce(core: int, thread: int, end: int) -> None:
    """The next span; frame `end` of the stream need not be reached by more than the rest of a quantum."""
    state, stream, settings, shared = state_of(core), stream_of(core), settings_of(core), shared_of(core)
    start = state.counters[PRODUCED]
    quanta = min(settings.span, (end - start + QUANTUM - 1) // QUANTUM)
    free = quanta
    if state.counters[PENDING] > 0:
        free = max(0, min(free, (stream.pending[0].frame - start) // QUANTUM))
    shared.task[FIRST_QUANTUM] = start // QUANTUM
    if free > 0:
        quanta = free
        for k in range(quanta):
            _smooth_controls(core, k)
        shared.task[TASK], shared.task[QUANTA] = WHOLE, quanta
        _run_instruments(core, thread, quanta * QUANTUM)
    else:
        quanta = 1
        _smooth_controls(core, 0)
        quantum_with_events(core, thread, start)
    mix_span(core, start, quanta)
    state.counters[PRODUCED] = start + quanta * QUANTUM


@njit(**CORE)
def _list_awake(core: int, frames: int) -> tuple[int, int]:
    """Put the awake instruments into Shared.queue; how many, and about how many mode-steps over so many frames."""
    bank, shared = bank_of(core), shared_of(core)
    count = 0
    mode_steps = 0
    for i in range(bank.instruments.size):
        if is_awake(core, i):
            shared.queue[count] = i
            count += 1
            mode_steps += cost(core, i, frames)
    return count, mode_steps


@njit(**CORE)
def _run_instruments(core: int, thread: int, frames: int) -> None:
    """Let all awake instruments do what Shared.task asks, over so many frames."""
    count, mode_steps = _list_awake(core, frames)
    share_out(core, thread, count, mode_steps)


@njit(**CORE)
def quantum_with_events(core: int, thread: int, start: int) -> None:
    """One quantum with its events. A string goes on to an event's frame if the event touches it (`hands`), and
    at last all go to the quantum's end."""
    state, stream, shared = state_of(core), stream_of(core), shared_of(core)
    shared.task[TASK] = BEGIN
    _run_instruments(core, thread, 1)
    awake = 0
    for s in range(bank_of(core).strings.size):
        awake += voice_of(core, s).awake - voice_of(core, s).idle
        progress_of(core, s).reached = 0
    state.counters[AWAKE] = awake
    shared.task[TASK], shared.task[UNTIL] = STRETCH, 0
    taken = 0
    while taken < state.counters[PENDING] and stream.pending[taken].frame < start + QUANTUM:
        shared.task[UNTIL] = max(shared.task[UNTIL], stream.pending[taken].frame - start)
        _copy_event(stream.pending[taken], state.event[0])
        tell(shared.task[HANDLE], shared.task[VOICES])
        taken += 1
    shared.task[UNTIL] = QUANTUM
    _run_instruments(core, thread, QUANTUM)
    left = state.counters[PENDING] - taken
    for i in range(left):
        _copy_event(stream.pending[i + taken], stream.pending[i])
    state.counters[PENDING] = left


@njit(**CORE)
def _smooth_controls(core: int, k: int) -> None:
    """Bends, vibrato and heights of quantum k of the span."""
    bank, state, span = bank_of(core), state_of(core), span_of(core)
    share = control_share(core)
    for c in range(state.channels.size):
        channel = state.channels[c]
        channel.bend = approach(channel.bend, channel.bend_raw * channel.bend_range, share, 1e-4)
        span.bends[k, c] = channel.bend
        channel.shaking = approach(channel.shaking, channel.wheel, share, 1e-4)
        span.shakes[k, c] = channel.shaking
    for p in range(bank.parts.size):
        part = state.part_state[p]
        part.height = approach(part.height, 1e-6 * state.parameters[p, HEIGHT], share, 1e-10)
        span.heights[k, p] = part.height
