"""A deck driven as a sound card would: its compiled callback, called through C, with buffers of ours."""

from __future__ import annotations

import ctypes
import time

import numpy as np

from synth import EVENT, Engine
from synth.live.callback import portaudio_callback
from synth.live.deck import Deck

CALLBACK = ctypes.CFUNCTYPE(
    ctypes.c_int32,
    ctypes.c_void_p,
    ctypes.c_void_p,
    ctypes.c_uint64,
    ctypes.POINTER(ctypes.c_double),
    ctypes.c_uint64,
    ctypes.c_void_p,
)


class Card:
    """Asks a deck for blocks, in real time or as fast as it gets them."""

    def __init__(self, deck: Deck, channels: int = 2) -> None:
        self._deck, self._channels = deck, channels
        self._compiled = portaudio_callback()
        self._call = CALLBACK(self._compiled.address)
        self._times = (ctypes.c_double * 3)(0.0, 1.0, 1.01)

    def ask(self, frames: int, flags: int = 0) -> np.ndarray:
        """One callback; (frames, channels) float32, filled with NaN before."""
        out = np.full((frames, self._channels), np.nan, np.float32)
        again = self._call(None, out.ctypes.data, frames, self._times, flags, self._deck.address)
        assert again == 0
        return out

    def play(self, seconds: float, block: int) -> np.ndarray:
        """Blocks at their times."""
        count = int(seconds * self._deck.rate_hz / block)
        blocks = []
        begin = time.monotonic()
        for i in range(count):
            time.sleep(max(0.0, begin + i * block / self._deck.rate_hz - time.monotonic()))
            blocks.append(self.ask(block))
        return np.concatenate(blocks)


def offline(engine: Engine, events: np.ndarray, frames: int, block: int = 512) -> np.ndarray:
    """What an engine, reset, gives for events at frames of the stream."""
    engine.reset()
    out = np.zeros((frames, 2))
    for at in range(0, frames, block):
        piece = out[at : at + block]
        mine = events[(events["frame"] >= at) & (events["frame"] < at + len(piece))].copy()
        mine["frame"] -= at
        engine.process(np.ascontiguousarray(mine, EVENT), piece)
    return out
