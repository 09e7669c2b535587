"""From the strings' rows to the output: buses, decimators, effects of the parts, levels, effects of the mix.

A span is mixed in one go. What is skipped because it is silent is judged per bus by exact zeros, and per part and quantum
by what its filters still hold, so that the cut into spans changes nothing.
"""

from __future__ import annotations

import math

from numba import njit

from synth.dsp.decimator import decimate_line
from synth.dsp.effect import STILL_BELOW
from synth.engine.chain import chain_is_silent, reset_chain, run_chain
from synth.engine.core import bank_of, progress_of, settings_of, span_of, state_of, stream_of
from synth.engine.layout import BLOWN_UP, CORE, GAIN, N_SILENCED, QUANTUM, RING
from synth.native.simd import move_within
from synth.solver.vectors import dot


@njit(**CORE)
def mix_span(core: int, start: int, quanta: int) -> None:
    """The rows of `quanta` quanta from frame `start` of the stream become output in the rings."""
    bank, stream, span = bank_of(core), stream_of(core), span_of(core)
    frames = quanta * QUANTUM
    _gather_rows(core)
    mix = span.mix[:frames]
    mono = span.mono[:frames]
    mix[:] = 0.0
    for p in range(bank.parts.size):
        part = bank.parts[p]
        mono[:] = 0.0
        if part.stereo:
            _add_stereo_part(core, p, start, frames, mix)
            continue
        for b in range(part.first_bus, part.end_bus):
            _add_bus(core, b, frames, mono)
        _add_part(core, p, start, mono, mix)
    for begin in range(0, frames, QUANTUM):
        _finish(core, mix[begin : begin + QUANTUM].reshape(-1))
    for i in range(frames):
        at = (start + i) % RING
        stream.ring[at, 0] = mix[i, 0]
        stream.ring[at, 1] = mix[i, 1]


@njit(**CORE)
def _finish(core: int, mix) -> None:
    """A quantum of the mix through its effects; where what they give is no sound any more, they forget all."""
    parts = bank_of(core).parts.size
    run_chain(core, parts, mix, 2)
    if not dot(mix, mix) <= BLOWN_UP * BLOWN_UP:
        mix[:] = 0.0
        reset_chain(core, parts)
        state_of(core).counters[N_SILENCED] += 1


@njit(**CORE)
def _gather_rows(core: int) -> None:
    """Add what each string has in its row to its bus, in the order of the strings."""
    bank, span = bank_of(core), span_of(core)
    for s in range(bank.strings.size):
        progress = progress_of(core, s)
        fixed = bank.strings[s]
        if progress.row_to > progress.row_from:
            begin, end = fixed.row + progress.row_from, fixed.row + progress.row_to
            _add_sides(core, s, fixed.bus, progress.row_from, span.rows[begin:end])
        if progress.direct_to > progress.direct_from:
            begin, end = fixed.direct + progress.direct_from, fixed.direct + progress.direct_to
            _add_sides(core, s, fixed.direct_bus, progress.direct_from, span.direct[begin:end])
        progress.row_from = progress.row_to = 0
        progress.direct_from = progress.direct_to = 0
    for i in range(bank.instruments.size):
        instrument = bank.instruments[i]
        if instrument.body >= 0:
            there = span.radiated_frames[instrument.body]
            if there[1] > there[0]:
                for channel in range(2):
                    row = span.radiated[instrument.body, channel, there[0] : there[1]]
                    _add_row(core, instrument.bus + channel, there[0], row, 1.0)
            there[0] = there[1] = 0


@njit(**CORE)
def _add_sides(core: int, s: int, b: int, first: int, row) -> None:
    """`_add_row` of a string to its bus, or to those of both sides."""
    bank = bank_of(core)
    fixed = bank.strings[s]
    if bank.parts[fixed.part].sides == 1:
        _add_row(core, b, first, row, 1.0)
        return
    _add_row(core, b, first, row, fixed.left)
    _add_row(core, b + 1, first, row, fixed.right)


@njit(**CORE)
def _add_row(core: int, b: int, first: int, row, share: float) -> None:
    """Add steps from number `first` of the span on to the line of bus b."""
    stream = stream_of(core)
    bus = bank_of(core).buses[b]
    # what a step ends with belongs to the instant after it: the last one of a span to the next span
    place = bus.off + bus.n_taps + first
    line = stream.lines[place : place + row.size]
    for t in range(row.size):
        line[t] += share * row[t]
    stream.quiet[b] = -1


@njit(**CORE)
def _add_bus(core: int, b: int, frames: int, mono) -> None:
    """Bring bus b down to the output rate, add it to `mono` and move its line on."""
    bank, stream, span = bank_of(core), stream_of(core), span_of(core)
    bus = bank.buses[b]
    fresh = frames * bus.factor
    if stream.quiet[b] >= bus.n_taps:
        return
    line = stream.lines[bus.off : bus.off + bus.n_taps + fresh]
    frame = span.frame[:frames]
    decimate_line(bank.taps[bus.taps : bus.taps + bus.n_taps], bus.factor, line, span.phases, frame)
    for i in range(frames):
        mono[i] += frame[i]
    move_within(line, 0, fresh, bus.n_taps)
    line[bus.n_taps :] = 0.0
    stream.quiet[b] = 0 if stream.quiet[b] < 0 else stream.quiet[b] + fresh


@njit(**CORE)
def _levels(core: int, p: int) -> tuple[float, float]:
    """Where the levels of a part go, left and right."""
    state, settings = state_of(core), settings_of(core)
    channel = state.channels[state.part_state[p].channel]
    level = channel.volume * channel.expression * state.parameters[p, GAIN] * settings.gain
    angle = 0.25 * math.pi * (1.0 + channel.pan)  # as `synth.panning.shares`
    return level * math.sqrt(2.0) * math.cos(angle), level * math.sqrt(2.0) * math.sin(angle)


@njit(**CORE)
def _add_stereo_part(core: int, p: int, start: int, frames: int, mix) -> None:
    """The same of a part that has left and right, from its buses or from its body on; panning is balance."""
    bank, state, settings, span = bank_of(core), state_of(core), settings_of(core), span_of(core)
    me = state.part_state[p]
    to_left, to_right = _levels(core, p)
    share, pole = settings.smoothing, settings.dc
    pair, mono = span.pair[:frames], span.mono[:frames]
    part = bank.parts[p]
    if part.sides == 2:
        for channel in range(2):
            mono[:] = 0.0
            for b in range(part.first_bus + channel, part.end_bus, 2):
                _add_bus(core, b, frames, mono)
            for i in range(frames):
                pair[i, channel] = mono[i]
    else:
        for b in range(part.first_bus, part.end_bus):
            _add_bus(core, b, frames, mono)
        for i in range(frames):
            pair[i, 0] = pair[i, 1] = mono[i]
    for begin in range(0, frames, QUANTUM):
        x = pair[begin : begin + QUANTUM]
        flat = x.reshape(-1)
        at = (start + begin) % RING
        stem = stream_of(core).stems[p, at : at + QUANTUM]
        silent = _is_silent(flat)
        if me.still and silent and _settled(me.left, to_left, share) and _settled(me.right, to_right, share):
            stem[:] = 0.0
            continue
        run_chain(core, p, flat, 2)
        for i in range(QUANTUM):
            left = x[i, 0] - me.dc_in + pole * me.dc_out
            right = x[i, 1] - me.dc_in_right + pole * me.dc_out_right
            me.dc_in, me.dc_in_right = x[i, 0], x[i, 1]
            me.dc_out, me.dc_out_right = left, right
            me.left += share * (to_left - me.left)
            me.right += share * (to_right - me.right)
            stem[i, 0] = me.left * left
            stem[i, 1] = me.right * right
        loud = stem.reshape(-1)
        if not dot(loud, loud) <= BLOWN_UP * BLOWN_UP:
            _silence_part(core, p, pair[begin:].reshape(-1), stem)
            continue
        for i in range(QUANTUM):
            mix[begin + i, 0] += stem[i, 0]
            mix[begin + i, 1] += stem[i, 1]
        me.still = 0
        high = max(abs(me.dc_out), abs(me.dc_out_right), abs(me.dc_in), abs(me.dc_in_right))
        if silent and high < STILL_BELOW and chain_is_silent(core, p):
            reset_chain(core, p)
            me.dc_in = me.dc_out = me.dc_in_right = me.dc_out_right = 0.0
            me.still = 1


@njit(**CORE)
def _settled(now: float, target: float, share: float) -> bool:
    return now + share * (target - now) == now


@njit(**CORE)
def _add_part(core: int, p: int, start: int, mono, mix) -> None:
    """Effects, high-pass, level and panning of one part."""
    state, settings = state_of(core), settings_of(core)
    me = state.part_state[p]
    to_left, to_right = _levels(core, p)
    share, pole = settings.smoothing, settings.dc
    for begin in range(0, mono.size, QUANTUM):
        x = mono[begin : begin + QUANTUM]
        y = mix[begin : begin + QUANTUM]
        at = (start + begin) % RING
        stem = stream_of(core).stems[p, at : at + QUANTUM]
        silent = _is_silent(x)
        left, right, before, high = me.left, me.right, me.dc_in, me.dc_out
        settled = _settled(left, to_left, share) and _settled(right, to_right, share)
        if me.still and silent and settled:
            stem[:] = 0.0
            continue
        run_chain(core, p, x, 1)
        before, high = _high_pass(x, pole, before, high)
        if settled:
            for i in range(QUANTUM):
                stem[i, 0] = left * x[i]
                stem[i, 1] = right * x[i]
        else:
            for i in range(QUANTUM):
                left += share * (to_left - left)
                right += share * (to_right - right)
                stem[i, 0] = left * x[i]
                stem[i, 1] = right * x[i]
        loud = stem.reshape(-1)
        if not dot(loud, loud) <= BLOWN_UP * BLOWN_UP:
            _silence_part(core, p, mono[begin:], stem)
            continue
        for i in range(QUANTUM):
            y[i, 0] += stem[i, 0]
            y[i, 1] += stem[i, 1]
        me.left, me.right, me.dc_in, me.dc_out = left, right, before, high
        me.still = 0
        if silent and abs(high) < STILL_BELOW and abs(before) < STILL_BELOW and chain_is_silent(core, p):
            reset_chain(core, p)
            me.dc_in = me.dc_out = 0.0
            me.still = 1


@njit(**CORE)
def _silence_part(core: int, p: int, mono, stem) -> None:
    """What part p gives is no number, or no sound any more: its filters forget all, and it is silent to the span's end."""
    bank, stream = bank_of(core), stream_of(core)
    part = bank.parts[p]
    me = state_of(core).part_state[p]
    stem[:] = 0.0
    mono[:] = 0.0
    for b in range(part.first_bus, part.end_bus):
        bus = bank.buses[b]
        stream.lines[bus.off : bus.off + bus.n_taps] = 0.0
        stream.quiet[b] = bus.n_taps
    reset_chain(core, p)
    me.left = me.right = settings_of(core).gain
    me.dc_in = me.dc_out = me.dc_in_right = me.dc_out_right = 0.0
    me.still = 1
    me.silenced += 1


@njit(**CORE, fastmath={"contract"})
def _high_pass(x, pole: float, before: float, high: float):
    """The quantum x through y_i = x_i − x_{i−1} + pole·y_{i−1}, in place; the last input and output."""
    last = x[x.size - 1]
    for i in range(x.size - 1, 0, -1):
        x[i] -= x[i - 1]
    x[0] -= before
    for i in range(x.size):
        high = pole * high + x[i]
        x[i] = high
    return last, high


@njit(**CORE)
def _is_silent(x) -> bool:
    loud = 0
    for i in range(x.size):
        loud |= 1 if x[i] != 0.0 else 0
    return loud == 0
