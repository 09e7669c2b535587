"""An engine without strings: every note-on is one impulse that decays, delayed by a latency."""

from __future__ import annotations

import numpy as np

from synth.midi.events import CONTROL, NOTE_ON


class FakeEngine:
    """out[n] = state; the state decays by `decay` per frame and a note-on adds velocity/127 to it.

    The left channel gets channel 0's notes, the right channel all others; stems are the two channels. CC 123
    silences.
    """

    def __init__(self, latency: int = 47, decay: float = 0.999) -> None:
        self.latency_samples = latency
        self.decay = decay
        self.level = np.zeros(2)
        self.delayed = np.zeros((latency, 2))
        self.blocks: list[int] = []

    def process(self, events: np.ndarray, out: np.ndarray, stems: np.ndarray | None) -> None:
        frames = len(out)
        self.blocks.append(frames)
        assert (np.diff(events["frame"]) >= 0).all()
        assert ((0 <= events["frame"]) & (events["frame"] < frames)).all()
        now = np.zeros((frames, 2))
        position = 0
        for n in range(frames):
            while position < len(events) and events[position]["frame"] == n:
                event = events[position]
                side = min(int(event["channel"]), 1)
                if event["kind"] == NOTE_ON:
                    self.level[side] += event["b"] / 127.0
                elif event["kind"] == CONTROL and event["a"] == 123:
                    self.level[side] = 0.0
                position += 1
            now[n] = self.level
            self.level = self.level * self.decay
        line = np.concatenate((self.delayed, now))
        out[:] = line[:frames]
        self.delayed = line[frames:]
        if stems is not None:
            stems[:] = 0.0
            stems[0, :, 0] = out[:, 0]
            stems[1, :, 1] = out[:, 1]
