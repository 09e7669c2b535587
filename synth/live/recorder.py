"""Records what is played: the sound as it goes out, and the events as a take that renders to the same samples.

A thread drains the deck ten times a second. The sound begins with what an event at the stream's first frame says: the
engine's latency is cut off, as `synth render` cuts it. So of `synth render take.mid` (same presets, settings, rate, bit
depth) the first frames, as many as were recorded, are the same samples; the take itself is longer by that latency.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, Self

import numpy as np

from synth.engine.uncopied import Uncopied
from synth.files.targets import Named, check_apart, is_special
from synth.host.audiofile import AudioWriter, container_of
from synth.live.take import TakeFile
from synth.native.patience import Worker

DRAIN_EVERY_S = 0.1
_BUFFER_FRAMES = 16384


def files_written(record: str) -> list[Named]:
    """The files of a recording called `record`: the sound and the take."""
    return [Named("--record", record), Named("take", Path(record).with_suffix(".mid"))]


class RecordedEngine(Protocol):
    """What a recorder needs of an engine."""

    @property
    def latency_samples(self) -> int: ...


class Lost(Protocol):
    """What a recorder needs of a deck's meters."""

    @property
    def recording_lost(self) -> int: ...


class Drained(Protocol):
    """What a recorder needs of a deck."""

    @property
    def engine(self) -> RecordedEngine: ...

    @property
    def tape_frames(self) -> int: ...

    @property
    def tape_lost(self) -> int: ...

    def meters(self) -> Lost: ...

    def drain_events(self) -> np.ndarray: ...

    def drain_audio(self, buffer: np.ndarray) -> int: ...


class Recorder(Uncopied):
    """A context manager: records from the stream's first frame until it is left, and keeps what it has whatever ends it.
    Leave it when the stream has stopped.

    wav: file to write the sound to (.wav or .flac); mid: the take; None: not; gm, headroom_db, switching: see
    `TakeFile`.
    bit_depth: '16', '24', 'float'.
    say: takes a line for the player, from the recorder's thread: a disk that is full ends the recording, not the playing.

    While it records, both files lie beside their place under names of their own (`.take.wav.PID.part`) and can be read as
    they are: after a crash they hold all but the last DRAIN_EVERY_S seconds or so. (Not so a FLAC file, whose length is
    written at its end: `flac -dF` reads what there is.) Memory does not grow with the recording.

    frames, events: what is recorded so far.  kept: the files that have got their names; nothing played, none.
    Sound that the deck could not keep while the disk stood still is silence in the file: both files share the stream's time.
    Raises OSError and ValueError, before anything is recorded, where a file cannot be written.
    """

    def __init__(
        self,
        deck: Drained,
        wav: str | Path | None = None,
        mid: str | Path | None = None,
        rate_hz: int = 44100,
        bit_depth: str = "24",
        *,
        gm: bool = False,
        headroom_db: float = 0.0,
        switching: bool = True,
        say: Callable[[str], None] = lambda _: None,
    ) -> None:
        self.frames = 0
        self.events = 0
        self.kept: list[str] = []
        self._deck = deck
        self._say = say
        self._rate_hz = rate_hz
        self._to_cut = deck.engine.latency_samples
        self._taken = 0  # frames off the deck's tape
        self._drained = 0  # frames of the stream that they, and the silence for what the tape lost, amount to
        self._lost = 0
        self._failed = False  # the sound cannot be written any more
        self._gaps: deque[tuple[int, int]] = deque()  # (frame of the tape before which frames are missing, how many)
        self._sound: AudioWriter | None = None
        if wav is not None:
            if str(wav) == "-" or is_special(wav):
                raise ValueError(f"a recording cannot go to a stream, got {str(wav)!r}; name a file")
            container = container_of(str(wav))
            self._sound = AudioWriter(wav, rate_hz, container=container, bit_depth=bit_depth, growing=True)
        self._take = TakeFile(mid, rate_hz, gm, headroom_db, switching) if mid is not None else None
        check_apart([], [Named(what, path) for what, path in (("sound", wav), ("take", mid)) if path is not None])
        self._buffer = np.zeros((_BUFFER_FRAMES, 2))
        self._end = threading.Event()
        self._thread: Worker | None = None

    @property
    def seconds(self) -> float:
        """Length of the recorded sound."""
        return self.frames / self._rate_hz

    def __enter__(self) -> Self:
        if self._take is not None:
            self._take.open()
        if self._sound is not None:
            try:
                self._sound.__enter__()
            except BaseException:
                if self._take is not None:
                    self._take.discard()
                raise
        self._thread = Worker(self._run, "recorder")
        self._thread.start()
        return self

    def _run(self) -> None:
        while not self._end.wait(DRAIN_EVERY_S):
            self._drain_audio()
            self._keep_events(self._deck.drain_events())

    def _drain_audio(self) -> None:
        """All the sound there is; what cannot be written is drained as well, for the deck counts what stays behind."""
        frames = -1
        while frames:
            frames = self._deck.drain_audio(self._buffer)
            lost = self._deck.tape_lost
            if lost > self._lost:
                # The tape was full until now, so what is missing would have followed what it held.
                self._gaps.append((self._taken + self._deck.tape_frames, lost - self._lost))
                self._lost = lost
            begin = 0
            while self._gaps and self._gaps[0][0] <= self._taken + frames:
                place, missing = self._gaps.popleft()
                self._keep_sound(self._buffer[begin : place - self._taken])
                begin = place - self._taken
                self._keep_silence(missing)
            self._keep_sound(self._buffer[begin:frames])
            self._taken += frames

    def _keep_silence(self, frames: int) -> None:
        """Silence for frames that are missing: what follows stands where the take's events say."""
        nothing = np.zeros((min(frames, _BUFFER_FRAMES), 2))
        for begin in range(0, frames, _BUFFER_FRAMES):
            self._keep_sound(nothing[: frames - begin])

    def _keep_sound(self, sound: np.ndarray) -> None:
        """The stream's next frames."""
        frames = len(sound)
        cut = min(max(self._to_cut - self._drained, 0), frames)
        self._drained += frames
        if self._sound is None or cut == frames:
            return
        try:
            self._sound.write(sound[cut:])
            self.frames += frames - cut
        except (OSError, ValueError) as problem:
            self._failed = True
            self._complain(self._sound.path, problem)
            self._close_sound()

    def _keep_events(self, events: np.ndarray) -> None:
        if self._take is None:
            return
        try:
            self._take.append(events)
            self.events = self._take.events
        except OSError as problem:
            self._complain(self._take.path, problem)
            self._close_take()

    def _complain(self, path: str, problem: Exception) -> None:
        reason = getattr(problem, "strerror", None) or str(problem) or "the disk is full?"
        self._say(f"{path}: recording stopped, playing continues ({reason})")

    def _close_sound(self) -> None:
        sound, self._sound = self._sound, None
        if sound is None:
            return
        if not self.frames and self._failed:  # a file of that name, from before, is worth more
            sound.__exit__(ValueError, None, None)
            return
        try:
            reason = sound.keep()
            self.kept.append(sound.path)
            if reason:
                self._say(f"{sound.path}: its end may be missing ({reason})")
        except OSError as problem:
            self._say(f"{sound.path}: the recording could not be kept ({problem.strerror or problem})")

    def _close_take(self) -> None:
        take, self._take = self._take, None
        if take is None:
            return
        try:
            take.close(self._drained)
            self.kept.append(take.path)
        except OSError as problem:
            self._say(f"{take.path}: the take could not be kept ({problem.strerror or problem})")
        if take.left_out:
            self._say(
                f"{take.path}: {take.left_out} event{'' if take.left_out == 1 else 's'} left out that MIDI cannot express"
            )

    def _discard(self) -> None:
        """Nothing has been played: a file of that name, from before, stays what it is."""
        sound, self._sound = self._sound, None
        take, self._take = self._take, None
        try:
            if sound is not None:
                sound.__exit__(ValueError, None, None)  # what is not whole is removed
        finally:
            if take is not None:
                take.discard()

    def close(self) -> None:
        """Takes what is left in the deck and gives the files their names. May be called again."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._end.set()
        try:
            thread.ended()
        finally:
            try:
                self._drain_audio()
                events = self._deck.drain_events()
                # A deck that still plays has got further meanwhile.
                self._keep_events(events[events["frame"] < self._drained])
                self._say_what_is_missing()
            finally:
                if self._drained:
                    try:
                        self._close_sound()
                    finally:
                        self._close_take()
                else:
                    self._discard()

    def _say_what_is_missing(self) -> None:
        """A disk that stood still for longer than the deck's tape lasts leaves a gap."""
        lost = self._deck.meters().recording_lost
        if not lost:
            return
        name = self._sound.path if self._sound is not None else self._take.path if self._take is not None else "recording"
        missing = [f"{self._lost} frames of sound (silence in the file)"] if self._lost else []
        missing += [f"{lost - self._lost} event{'' if lost - self._lost == 1 else 's'}"] if lost > self._lost else []
        self._say(f"{name}: the disk was too slow and lost {' and '.join(missing)}")

    def __exit__(self, *_: object) -> None:
        self.close()
