"""What PortAudio calls for sound, and the thread that renders ahead of it: compiled, without the interpreter."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import carray, int64, njit

from synth.engine.layout import CORE
from synth.jit.entries import entry, kernel
from synth.live import exchange as d
from synth.live.exchange import exchange_of
from synth.live.render_block import render_block, tick
from synth.native.atomics import load, store
from synth.native.clocks import monotonic_ns, nap, pointer

#: paOutputUnderflow
_UNDERFLOW = 4
#: paContinue
_CONTINUE = 0


def serve_portaudio(_input: int, output: int, count: int, times: int, flags: int, address: int) -> int:
    """PaStreamCallback, its arguments as words; `address` of the Exchange is its userData."""
    now = monotonic_ns()
    exchange = exchange_of(address)
    words = exchange.words
    frames = int(count)
    if flags & _UNDERFLOW:
        words[d.XRUNS] += 1
    # PaStreamCallbackTimeInfo: inputBufferAdcTime, currentTime, outputBufferDacTime [s]
    when = carray(pointer(times), 3, np.float64)
    exchange.levels[d.DEVICE_S] = when[2] - when[1]
    out = carray(pointer(output), (frames, words[d.CHANNELS]), np.float32)
    played = words[d.PLAYED]
    ahead = words[d.AHEAD_FRAMES]
    delay = ahead + words[d.AHEAD_BLOCK] if ahead > 0 else frames
    tick(address, played, delay, now)
    done = 0
    while done < frames:
        part = min(frames - done, d.MOST_FRAMES)
        if ahead > 0:
            _copy_ready(address, out[done : done + part])
        else:
            render_block(address, 0, part)
            _convert(exchange.mix[:part], out[done : done + part])
        done += part
    words[d.PLAYED] = played + frames
    return _CONTINUE


@njit(**CORE)
def _convert(mix, out) -> None:
    """float64 (frames, 2) to what the device takes: float32 (frames, channels), mono or the first two."""
    if out.shape[1] == 1:
        for i in range(out.shape[0]):
            out[i, 0] = np.float32(0.5 * (mix[i, 0] + mix[i, 1]))
        return
    for i in range(out.shape[0]):
        out[i, 0] = np.float32(mix[i, 0])
        out[i, 1] = np.float32(mix[i, 1])
        for k in range(2, out.shape[1]):
            out[i, k] = np.float32(0.0)


@njit(**CORE)
def _copy_ready(address: int, out) -> None:
    """Sound that was rendered ahead; silence and an xrun where it is not there."""
    exchange = exchange_of(address)
    words = exchange.words
    size = exchange.ready.shape[0]
    at = words[d.AHEAD_TAKEN]
    there = min(out.shape[0], load(words, d.AHEAD) - at)
    first = min(there, size - at % size)
    _convert(exchange.ready[at % size : at % size + first], out[:first])
    _convert(exchange.ready[: there - first], out[first:there])
    if there < out.shape[0]:
        for i in range(there, out.shape[0]):
            for k in range(out.shape[1]):
                out[i, k] = np.float32(0.0)
        words[d.XRUNS] += 1
        words[d.LATE_OURS] += 1
    store(words, d.AHEAD_TAKEN, at + there)


@kernel(int64)
def render_ahead(address: int) -> None:
    """Keep Exchange.words[AHEAD_FRAMES] of sound ready until Exchange.words[ENDING]."""
    exchange = exchange_of(address)
    words = exchange.words
    size = exchange.ready.shape[0]
    block = words[d.AHEAD_BLOCK]
    pause_ns = int(0.25e9 * block / exchange.rate_hz)
    while load(words, d.ENDING) == 0:
        at = words[d.AHEAD]
        if at - load(words, d.AHEAD_TAKEN) + block > words[d.AHEAD_FRAMES]:
            nap(pause_ns)
            continue
        render_block(address, 0, block)
        for i in range(block):
            exchange.ready[(at + i) % size, 0] = exchange.mix[i, 0]
            exchange.ready[(at + i) % size, 1] = exchange.mix[i, 1]
        store(words, d.AHEAD, at + block)


def portaudio_callback() -> Any:
    """The compiled callback, by its `.address`."""
    return entry(serve_portaudio, 6, answers=True)
