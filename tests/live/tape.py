"""A deck that plays tones without an engine, as fast as it is asked: for what a recorder does with its files.

Run as a program: records into the two files named, says "going" after a second and goes on until it is killed.
"""

from __future__ import annotations

import sys
import threading
import time
from types import SimpleNamespace

import numpy as np

from synth.midi.events import CONTROL, EVENT

RATE_HZ = 44100
LATENCY = 150


class ToneDeck:
    """`play(frames, events)` puts sound and events where a recorder drains them: a ramp that names its frame. Of sound, no
    more than tape_frames wait."""

    def __init__(self, tape_frames: int = 1 << 20) -> None:
        self.engine = SimpleNamespace(latency_samples=LATENCY)
        self.frame = 0
        self.recording_lost = 0
        self.tape_frames = tape_frames
        self.tape_lost = 0
        self._lock = threading.Lock()
        self._tape = np.zeros((0, 2))
        self._events: list[np.ndarray] = []

    @staticmethod
    def sound(first: int, behind: int) -> np.ndarray:
        frames = np.arange(first, behind)
        return np.stack((frames % 8192, frames // 8192), axis=1) / 8192.0

    def meters(self) -> SimpleNamespace:
        return SimpleNamespace(recording_lost=self.recording_lost)

    def play(self, frames: int, events: np.ndarray | None = None) -> None:
        with self._lock:
            if events is not None:
                self._events.append(events)
            kept = min(frames, self.tape_frames - len(self._tape))
            self._tape = np.concatenate((self._tape, self.sound(self.frame, self.frame + kept)))
            self.tape_lost += frames - kept
            self.recording_lost += frames - kept
            self.frame += frames

    def drain_audio(self, buffer: np.ndarray) -> int:
        with self._lock:
            count = min(len(buffer), len(self._tape))
            buffer[:count] = self._tape[:count]
            self._tape = self._tape[count:]
            return count

    def drain_events(self) -> np.ndarray:
        with self._lock:
            events, self._events = self._events, []
        return np.concatenate(events) if events else np.zeros(0, EVENT)


def controls(first: int, behind: int, every: int) -> np.ndarray:
    """A controller that moves every `every` frames."""
    frames = np.arange(first, behind, every)
    events = np.zeros(len(frames), EVENT)
    events["frame"], events["kind"], events["a"], events["b"] = frames, CONTROL, 1, frames // every % 128
    return events


def main(wav: str, mid: str) -> None:
    from synth.live.recorder import Recorder

    deck = ToneDeck()
    with Recorder(deck, wav, mid, RATE_HZ, say=lambda line: print(line, flush=True)):
        while True:
            deck.play(441, controls(deck.frame, deck.frame + 441, 49))
            time.sleep(0.01)
            if deck.frame == RATE_HZ:
                print("going", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
