"""Between whoever plays and whoever asks for sound: one engine, its events in, its sound, meters and log out.

    deck = Deck(engine)
    output = open_output(deck, device=None, rate_hz=44100, block=256)
    output.start()
    deck.send(NOTE_ON, 0, 48, 100)

Python puts events in from any thread. Sound is rendered by compiled code that the device's callback runs.
"""

from __future__ import annotations

import math
import os
import threading
import time
from dataclasses import dataclass

import numpy as np

from synth.engine.engine import Engine
from synth.engine.uncopied import Uncopied
from synth.live import exchange as d
from synth.live.callback import render_ahead
from synth.live.render_block import LEAST_DB, frame_at
from synth.midi.controllers import ALL_NOTES_OFF, ALL_SOUND_OFF, RESET_CONTROLLERS, SUSTAIN
from synth.midi.events import CONTROL, EVENT, NOTE_ON, make_events

#: priority of the thread that renders ahead, where it may have one
PRIORITY = 60


@dataclass(frozen=True)
class Load:
    """Parts of a block's time since the last look: by the wall clock, and `cpu` by the processor time of the thread."""

    median: float
    worst: float
    cpu_median: float
    cpu_worst: float


@dataclass(frozen=True)
class LastNote:
    """The last note; velocity 0: it has ended."""

    note: int
    velocity: int
    channel: int


@dataclass(frozen=True)
class Meters:
    """What happens. `peak` is linear, since the last look; counts are since the start.

    xruns: blocks that the device missed.  late: blocks that took longer than they last, because of us / because the
    system ran something else.  stalls: calls that came at a wrong time.  spare_db: the level below which strings that
    nobody holds are damped away, −inf: none are.
    """

    frames: int
    blocks: int
    load: Load
    last: LastNote
    xruns: int
    late_ours: int
    late_others: int
    stalls: int
    strings: int
    peak: float
    events: int
    events_lost: int
    recording_lost: int
    device_latency_s: float
    spare_db: float


class Deck(Uncopied):
    """A prepared engine in a live session.

    record    keep events and sound for `drain_events` and `drain_audio`, which must then be called
    stems     render every part by itself as well (for a device that has ports for them)
    channels  of the device: 1, or 2 and more, of which the first two sound
    adaptive  under load let the quietest strings that nobody holds end earlier
    ahead     blocks of `ahead_block` frames that a thread keeps ready; 0: the device's thread renders
    """

    def __init__(
        self,
        engine: Engine,
        *,
        record: bool = False,
        stems: bool = False,
        channels: int = 2,
        ahead: int = 0,
        ahead_block: int = 256,
        adaptive: bool = False,
    ) -> None:
        if not 1 <= ahead_block <= d.MOST_FRAMES:
            raise ValueError(f"a block must have 1 to {d.MOST_FRAMES} frames, got {ahead_block}")
        self.engine = engine
        self.rate_hz = engine.rate_hz
        self._recording = record
        self._send_lock = threading.Lock()
        self._score_lock = threading.Lock()
        self._events_lost = 0
        self._blocks_seen = 0
        self._thread: threading.Thread | None = None
        if ahead:
            render_ahead.ready()
        self._warm_up()
        self._exchange, self._table = d.new_exchange(
            *engine.addresses,
            engine.rate_hz,
            channels=channels,
            origin_ns=time.monotonic_ns(),
            parts=len(engine.parts) if stems else 0,
            recording=record,
            ahead_frames=ahead * ahead_block,
            ahead_block=ahead_block,
        )
        self._exchange.words[d.ADAPTIVE] = int(adaptive)
        self._exchange.levels[d.SPARE_DB] = LEAST_DB
        self.address = self._table.ctypes.data

    def _warm_up(self) -> None:
        """Let every string sound once, so that no page and no branch is met for the first time while playing."""
        engine = self.engine
        engine.reserve(2 * d.BLOCK_EVENTS)
        out = np.zeros((256, 2))
        notes = [
            (0, NOTE_ON, channel, note, 100)
            for channel in range(16)
            for note in range(128)
            if engine.program_map[channel].max() >= 0
        ]
        for start in range(0, len(notes), d.BLOCK_EVENTS):
            engine.process(make_events(notes[start : start + d.BLOCK_EVENTS]), out)
        for _ in range(8):
            engine.process(np.zeros(0, EVENT), out)
        engine.reset()

    @property
    def ahead_frames(self) -> int:
        """Frames that a thread keeps ready; 0: the device's thread renders."""
        return int(self._exchange.words[d.AHEAD_FRAMES])

    @property
    def stems(self) -> bool:
        """Whether every part is rendered by itself as well."""
        return bool(self._exchange.words[d.PARTS])

    def set_device_latency(self, seconds: float) -> None:
        """What a device says of its own latency, for `meters`, where its callback does not."""
        self._exchange.levels[d.DEVICE_S] = seconds

    def set_channels(self, channels: int) -> None:
        """What the device turned out to have; before it starts."""
        self._exchange.words[d.CHANNELS] = channels

    def start_ahead(self) -> None:
        """Start the thread that renders ahead, if there is to be one, and wait for its first sound."""
        if not self.ahead_frames or self._thread is not None:
            return
        self._exchange.words[d.ENDING] = 0
        self._thread = threading.Thread(target=self._run_ahead, name="synth-ahead", daemon=True)
        self._thread.start()
        while self._exchange.words[d.AHEAD] < self.ahead_frames and self._thread.is_alive():
            time.sleep(0.001)

    def _run_ahead(self) -> None:
        if hasattr(os, "sched_setscheduler"):
            try:
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
            except OSError:
                pass  # not permitted: an ordinary thread
        render_ahead(self.address)

    def close(self) -> None:
        """End the thread that renders ahead. The device must have stopped."""
        thread, self._thread = self._thread, None
        if thread is not None:
            self._exchange.words[d.ENDING] = 1
            thread.join()

    def now_ns(self) -> int:
        """The time that events are stamped with [ns]."""
        return time.monotonic_ns()

    def at(self, time_ns: int) -> int:
        """Frame of the stream at which an event that arrives at a time is given to the engine."""
        return int(frame_at(self.address, time_ns))

    @property
    def frame(self) -> int:
        """Frames rendered so far."""
        return int(self._exchange.words[d.FRAMES])

    @property
    def period(self) -> int:
        """Frames that the device asks for at a time; 0: not known yet."""
        return int(self._exchange.words[d.PERIOD])

    @property
    def delay_frames(self) -> int:
        """Frames between an event's arrival and its place in the stream."""
        return int(self._exchange.words[d.DELAY])

    def send(self, kind: int, channel: int, a: int = 0, b: int = 0, value: float = 0.0, time_ns: int | None = None) -> bool:
        """An event (see `engine.events`) that arrived at `time_ns` (None: now). False: lost, because too many wait."""
        with self._send_lock:
            now = time.monotonic_ns()
            stamp = now if time_ns is None else min(time_ns, now)
            if d.push_arrival(self.address, stamp, kind, channel, a, b, float(value)):
                return True
            self._events_lost += 1
            return False

    def schedule(self, events: np.ndarray) -> int:
        """Events (EVENT, `frame` counted from the start of the stream, ascending); how many there was room for. Those
        whose frame is past are played at once."""
        with self._score_lock:
            return int(d.push_score(self.address, np.ascontiguousarray(events)))

    def drop_scheduled(self) -> int:
        """Ask that nothing more of what has been scheduled is played. The number of the asking, for `dropped_at`; until that
        tells, schedule nothing."""
        with self._score_lock:
            self._exchange.words[d.DROPS_ASKED] += 1
            return int(self._exchange.words[d.DROPS_ASKED])

    def dropped_at(self, asking: int) -> int | None:
        """Frame of the stream before which everything scheduled was played, and from which on nothing; None: not yet."""
        if self._exchange.words[d.DROPS] < asking:
            return None
        return int(self._exchange.words[d.DROPPED_AT])

    def panic(self) -> None:
        """Silence on all channels, controllers at their power-up values."""
        for channel in range(16):
            for controller in (ALL_SOUND_OFF, ALL_NOTES_OFF, RESET_CONTROLLERS):
                self.send(CONTROL, channel, controller)

    def release(self) -> None:
        """Let go of everything that is held."""
        for channel in range(16):
            self.send(CONTROL, channel, SUSTAIN, 0)
            self.send(CONTROL, channel, ALL_NOTES_OFF)

    def meters(self) -> Meters:
        """What has happened; loads and peak since the last call."""
        words, levels = self._exchange.words, self._exchange.levels
        blocks = int(words[d.BLOCKS])
        count = min(blocks - self._blocks_seen, d.LOADS)
        places = np.arange(blocks - count, blocks) % d.LOADS
        self._blocks_seen = blocks
        loads = self._exchange.loads[places] if count else np.zeros((1, 2))
        median, worst = np.median(loads, axis=0), loads.max(axis=0)
        peak = float(levels[d.PEAK])
        words[d.PEAK_SEEN] = 1
        return Meters(
            frames=int(words[d.FRAMES]),
            blocks=blocks,
            load=Load(float(median[0]), float(worst[0]), float(median[1]), float(worst[1])),
            last=LastNote(int(words[d.NOTE]), int(words[d.VELOCITY]), int(words[d.CHANNEL])),
            xruns=int(words[d.XRUNS]),
            late_ours=int(words[d.LATE_OURS]),
            late_others=int(words[d.LATE_OTHERS]),
            stalls=int(words[d.STALLS]),
            strings=self.engine.strings_sounding,
            peak=peak,
            events=int(words[d.GIVEN]),
            events_lost=self._events_lost + int(words[d.GIVEN_LOST]) + self.engine.events_dropped,
            recording_lost=int(words[d.TAPE_LOST]) + int(words[d.LOG_LOST]),
            device_latency_s=float(levels[d.DEVICE_S]),
            spare_db=float(levels[d.SPARE_DB]) if levels[d.SPARE_DB] > LEAST_DB else -math.inf,
        )

    @property
    def tape_frames(self) -> int:
        """Frames of sound that wait for `drain_audio` at most."""
        return self._exchange.tape.shape[0]

    @property
    def tape_lost(self) -> int:
        """Frames of sound for which there was no room there: they are missing where it was full."""
        return int(self._exchange.words[d.TAPE_LOST])

    def drain_events(self) -> np.ndarray:
        """What the engine was given since the last call: EVENT, `frame` counted from the start of the stream."""
        self._check_recording()
        out = np.zeros(d.EVENTS, EVENT)
        return out[: d.pop_log(self.address, out)].copy()

    def drain_audio(self, buffer: np.ndarray) -> int:
        """Frames of sound since the last call into a buffer (n, 2) float64; how many."""
        self._check_recording()
        if buffer.ndim != 2 or buffer.shape[1] != 2 or buffer.dtype != np.float64 or not buffer.flags.c_contiguous:
            raise ValueError(f"the buffer must be a contiguous (n, 2) float64 array, got {buffer.shape} {buffer.dtype}")
        return int(d.pop_tape(self.address, buffer))

    def _check_recording(self) -> None:
        if not self._recording:
            raise ValueError("this deck does not record: make it with record=True")
