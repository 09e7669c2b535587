"""Many notes at once, offline: each alone, from silence, as `render` gives it, on all processors.

Notes are shared out beforehand. A worker has an engine of its own for each preset, of the notes that it is to play, and
resets it from note to note; so that little is compiled twice, a note goes where its key has been before, unless another has
much less to do. Kernels run without the interpreter's lock. What is finished early waits, in no more memory than is granted,
until all before it has been taken.
"""

from __future__ import annotations

import os
import threading
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from synth.dsp.rates import MAXIMUM_RATE_HZ, MINIMUM_RATE_HZ
from synth.engine.engine_settings import EngineSettings
from synth.engine.numbers import a_count, a_number
from synth.host import parts
from synth.native.processors import cores
from synth.spelling import perhaps

if TYPE_CHECKING:
    from synth.engine.engine import Engine
    from synth.instrument.preset import Preset

#: longest note [s]
LONGEST_S = 600.0
#: a key is compiled by another worker, too, rather than that it has so much more to play [s]
COMPILED_S = 20.0
#: most of what varies from stroke to stroke, as a multiple of what presets say
MOST_VARIATION = 2.0
#: shortest note [s]
SHORTEST_S = 1e-3
#: longest wait of a thread before it looks whether it is to end [s]
_LOOK_S = 0.2
#: preparing holds the interpreter's lock most of the time, and kernels are compiled once
_PREPARING = threading.Lock()


@dataclass(frozen=True)
class Note:
    """One note of `render_notes`, or of a phrase that `render` is given.

    Parameters
    ----------
    note : int
        MIDI note, 0 … 127.
    velocity : int
        1 … 127.
    seconds : float
        How much of it is rendered, from its note-on; in a phrase: until the next note begins [s].
    off_s : float, optional
        When its key is let go, after its note-on [s]; None: it is held, in a phrase for `seconds`.
    preset : str, path or Preset, optional
        By name, by file or itself; None: that of all.
    articulation : str
        One of the preset's by name; "": as keys, controllers and velocities would have it.
    controllers : tuple of (number, value)
        0 … 127 each, that come before it.
    start_s : float, optional
        In a phrase: when it begins [s]; None: where the note before ends. Of no account where it sounds alone.

    Examples
    --------
    >>> import synth
    >>> phrase = [synth.Note(28, 100, 0.1), synth.Note(28, 100, 0.1, articulation="ghost")]
    >>> synth.render(phrase, "slap-bass", quality="draft", tail=0.0).duration_s
    0.2
    """

    note: int
    velocity: int = 100
    seconds: float = 3.0
    off_s: float | None = None
    preset: str | os.PathLike[str] | Preset | None = None
    articulation: str = ""
    controllers: tuple[tuple[int, int], ...] = ()
    start_s: float | None = None


@dataclass(frozen=True, eq=False)
class RenderedNote:
    """The answer of `render_notes` to a note: its samples, or in one line why there are none.

    Two are equal where all of it is, every sample too.

    Attributes
    ----------
    number : int
        Place among the notes asked for, from 0.
    note : Note
        As it was asked for.
    samples : (frames, 2) array or None
        Left and right, full scale ±1, of the dtype asked for; None where there is an error.
    rate_hz : int
        Frames a second [Hz].
    error : str
        Why it has no samples; "" where it has.

    Examples
    --------
    >>> import synth
    >>> [low] = synth.render_notes("tanpura", [(20, 90, 0.1)], quality="draft", threads=1)
    >>> low.samples is None, low.error
    (True, 'G#0 is not played: outside C2-C3')
    """

    number: int
    note: Note
    samples: np.ndarray | None = field(repr=False)
    rate_hz: int
    error: str = ""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RenderedNote):
            return NotImplemented
        mine, its = self.samples, other.samples
        same = mine is its or (
            mine is not None and its is not None and mine.dtype == its.dtype and np.array_equal(mine, its)
        )
        return same and (self.number, self.note, self.rate_hz, self.error) == (
            other.number, other.note, other.rate_hz, other.error
        )  # fmt: skip

    def __hash__(self) -> int:
        return hash((self.number, self.note.note, self.rate_hz, self.error))


def render_notes(
    preset: str | os.PathLike[str] | Preset | None,
    notes: Iterable[Note | tuple[int, ...] | tuple[int, int, float]],
    *,
    rate_hz: int = 44100,
    quality: str = "standard",
    limiter: bool = False,
    seed: int = 0,
    variation: float = 1.0,
    dtype: str = "float32",
    threads: int | str = "auto",
    ahead_mib: float = 256.0,
) -> Iterator[RenderedNote]:
    """Renders notes, each alone and from silence, and gives them in order: to the bit what `synth.render` gives of a song of
    that one note, however many threads there are and whatever else is asked for.

    Parameters
    ----------
    preset : str, path, Preset or None
        By name, by file or itself, for notes that name none.
    notes : iterable of Note or tuple
        `Note`, or (note, velocity) or (note, velocity, seconds). A preset is compiled for those of its notes that occur,
        once; notes of one preset should follow each other, for its engines are kept until its last note.
    rate_hz : int
        Frames a second [Hz].
    quality, limiter, seed : str, bool, int
        As `EngineSettings` has them; the limiter is off unless asked for.
    variation : float
        0 … 2, multiplies what presets vary from stroke to stroke.
    dtype : str
        "float32" or "float64" of the samples.
    threads : int or str
        How many notes are computed at a time, or "auto": one per processor.
    ahead_mib : float
        Sound that may wait for its turn to be taken [MiB].

    Returns
    -------
    iterator of RenderedNote
        A note that cannot be rendered has an `error`, and the others are not touched by it. Left early (`break`, `close`,
        Ctrl-C) it ends its threads.

    Raises
    ------
    ValueError, TypeError
        Before anything is computed, for arguments that cannot be.

    Examples
    --------
    >>> import synth
    >>> for each in synth.render_notes("tanpura", [(48, 90, 0.1), (48, 40, 0.1)], quality="draft", threads=1):
    ...     print(each.number, each.samples.shape, each.samples.dtype)
    0 (4410, 2) float32
    1 (4410, 2) float32
    """
    if dtype not in ("float32", "float64"):
        raise ValueError(f"dtype must be 'float32' or 'float64', got {dtype!r}")
    settings = EngineSettings(quality=quality, limiter=limiter, seed=seed, threads=threads)
    if isinstance(ahead_mib, bool) or not isinstance(ahead_mib, int | float) or not ahead_mib > 0.0:
        raise ValueError(f"ahead_mib must be more than 0, got {ahead_mib!r}")
    rate_hz = a_count("rate_hz", rate_hz, int(MINIMUM_RATE_HZ), int(MAXIMUM_RATE_HZ))
    variation = a_number("variation", variation, 0.0, MOST_VARIATION)
    made = _Making(rate_hz, settings.of_engine(threads=1), variation, np.dtype(dtype))
    wanted = [_as_note(number, each) for number, each in enumerate(notes)]
    jobs = made.jobs(preset, wanted)
    workers = cores() if threads == "auto" else int(threads)
    return _Batch(made, jobs, max(1, min(workers, len(jobs))), ahead_mib * 2**20).results()


def _as_note(number: int, given: Any) -> Note:
    if isinstance(given, Note):
        return given
    if isinstance(given, tuple | list) and 2 <= len(given) <= 3:
        return Note(*given)
    raise TypeError(f"notes[{number}] must be a Note, (note, velocity) or (note, velocity, seconds), got {given!r}")


@dataclass
class _Job:
    """A note, the preset that plays it, and which of the engines that make one sound it needs; or what is wrong."""

    number: int
    note: Note
    preset: Preset | None = None
    kind: int = -1
    error: str = ""
    worker: int = 0


@dataclass(frozen=True)
class _Making:
    """What all notes have in common."""

    rate_hz: int
    settings: EngineSettings
    variation: float
    dtype: np.dtype

    def jobs(self, preset: str | os.PathLike[str] | Preset | None, notes: Sequence[Note]) -> list[_Job]:
        """A job for each note; presets are read once."""
        loaded: dict[Any, Preset | str] = {}
        playing: dict[tuple[Any, str], tuple[int, Preset] | str] = {}
        jobs = []
        for number, note in enumerate(notes):
            job = _Job(number, note)
            jobs.append(job)
            job.error = what_is_wrong(note)
            if job.error:
                continue
            chosen = preset if note.preset is None else note.preset
            if isinstance(chosen, os.PathLike):
                chosen = os.fspath(chosen)
            key = chosen if isinstance(chosen, str) else id(chosen)
            if (key, note.articulation) not in playing:
                if key not in loaded:
                    loaded[key] = self._loaded(chosen)
                playing[key, note.articulation] = played_as(loaded[key], note.articulation, len(playing))
            found = playing[key, note.articulation]
            if isinstance(found, str):
                job.error = found
            else:
                job.kind, job.preset = found
        return jobs

    def _loaded(self, chosen: str | Preset | None) -> Preset | str:
        """The preset, or why there is none."""
        if chosen is None:
            return "preset is missing: give one for the note, or one for all notes"
        name = chosen if isinstance(chosen, str) else getattr(chosen, "name", repr(chosen))
        try:
            found = parts.load_presets([name], (), None if isinstance(chosen, str) else {name: chosen})
            return parts.varied(found, self.variation)[name]
        except (ValueError, TypeError, AttributeError, OSError) as error:
            return _line(error)

    def engine(self, preset: Preset, keys: set[int], going: threading.Event) -> Engine:
        """Prepared for some keys. Raises _Stopped once nobody waits any more, and what the engine raises."""
        from synth.engine.engine import Engine
        from synth.host.alone import BLOCK

        engine = Engine([preset], settings=self.settings, only_notes=[keys], every_fret=False, warn=lambda text: None)

        def progress(done: int, total: int) -> None:
            if not going.is_set():
                raise _Stopped

        engine.prepare(self.rate_hz, BLOCK, progress)
        return engine

    def sound(self, engine: Engine, job: _Job, going: threading.Event) -> np.ndarray:
        """(frames, 2) of a note. Raises ValueError for one that no string plays, RuntimeError for what is no sound."""
        from synth.host.alone import events_of, sound_alone

        def look() -> None:
            if not going.is_set():
                raise _Stopped

        note = job.note
        events = events_of([(0.0, note)], note.controllers, self.rate_hz)
        engine.reset()
        return sound_alone(engine, events, note.seconds, self.rate_hz, self.dtype, look)


def what_is_wrong(note: Note) -> str:
    """What is wrong with a note's numbers, "" where nothing is."""
    from synth.instrument.preset import Preset

    try:
        if not isinstance(note.articulation, str):
            raise TypeError(f"articulation must be a name, or empty, got {note.articulation!r}")
        if not (note.preset is None or isinstance(note.preset, str | os.PathLike | Preset)):
            raise TypeError(f"preset must be a name, a file or a Preset, got {note.preset!r}")
        a_count("note", note.note, 0, 127)
        a_count("velocity", note.velocity, 1, 127)
        a_number("seconds", note.seconds, SHORTEST_S, LONGEST_S, " s")
        if note.off_s is not None:
            a_number("off_s", note.off_s, 0.0, LONGEST_S, " s")
        for number, value in note.controllers:
            a_count("a controller's number", number, 0, 127)
            a_count(f"controller {number}", value, 0, 127)
    except (TypeError, ValueError) as error:
        return _line(error)
    return ""


def played_as(preset: Preset | str, articulation: str, kind: int) -> tuple[int, Preset] | str:
    """What plays an articulation of a preset, with a number of its own; or why there is none."""
    if isinstance(preset, str) or not articulation:
        return preset if isinstance(preset, str) else (kind, preset)
    if articulation not in preset.articulations:
        there = ", ".join(preset.articulations) or "none"
        known = perhaps(articulation, preset.articulations)
        return f"{preset.name} has no articulation {articulation!r}{known}; its articulations: {there}"
    return kind, parts.Part(0, preset.name, articulations=(articulation,), notes=0).played(preset)


def _line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__


class _Stopped(Exception):
    """Nobody waits for sounds any more."""


def share_out(keys: Sequence[tuple[int, int]], seconds: Sequence[float], workers: int) -> list[int]:
    """The worker of each note, in turn: that with the least to play [s], where a key (engine, MIDI note) that it has not had
    yet counts as COMPILED_S."""
    load, had = [0.0] * workers, [set[tuple[int, int]]() for _ in range(workers)]
    found = []
    for key, length in zip(keys, seconds, strict=True):
        chosen = min(range(workers), key=lambda w: load[w] + (0.0 if key in had[w] else COMPILED_S))
        load[chosen] += length
        had[chosen].add(key)
        found.append(chosen)
    return found


class _Batch:
    """Workers at their jobs, and what they have made until it is taken."""

    def __init__(self, made: _Making, jobs: list[_Job], workers: int, ahead_bytes: float) -> None:
        self._made, self._jobs, self._workers, self._ahead = made, jobs, workers, ahead_bytes
        playable = [job for job in jobs if not job.error]
        places = share_out([(job.kind, job.note.note) for job in playable], [job.note.seconds for job in playable], workers)
        for job, worker in zip(playable, places, strict=True):
            job.worker = worker
        self._changed = threading.Condition()
        self._going = threading.Event()
        self._done: dict[int, RenderedNote | BaseException] = {}
        self._held = 0.0  # bytes of what is computed or waits
        self._next = 0

    def results(self) -> Iterator[RenderedNote]:
        """In order; ends the threads however it is left."""
        self._going.set()
        threads = [threading.Thread(target=self._work, args=(w,), name=f"notes {w}") for w in range(self._workers)]
        try:
            for thread in threads:
                thread.start()
            for job in self._jobs:
                yield self._take(job)
        finally:
            self._going.clear()
            with self._changed:
                self._changed.notify_all()
            for thread in threads:
                if thread.ident is not None:
                    thread.join()

    def _take(self, job: _Job) -> RenderedNote:
        if job.error:
            found: RenderedNote | BaseException = RenderedNote(job.number, job.note, None, self._made.rate_hz, job.error)
        else:
            with self._changed:
                while job.number not in self._done:
                    self._changed.wait(_LOOK_S)
                found = self._done.pop(job.number)
        with self._changed:
            self._held -= self._size(job)
            self._next = job.number + 1
            self._changed.notify_all()
        if isinstance(found, BaseException):
            raise found
        return found

    def _size(self, job: _Job) -> float:
        return 0.0 if job.error else 2.0 * self._made.dtype.itemsize * job.note.seconds * self._made.rate_hz

    def _work(self, worker: int) -> None:
        mine = [job for job in self._jobs if not job.error and job.worker == worker]
        engines = _Engines(self._made, mine, self._going)
        try:
            for job in mine:
                if not self._begin(job):
                    return
                self._finish(job, engines.sound(job))
        except _Stopped:
            return
        except BaseException as error:  # not the note's: whoever takes it is told
            self._finish(job, error)
        finally:
            engines.close()

    def _begin(self, job: _Job) -> bool:
        """Waits until there is room for a job's sound, which there is for the one that is taken next; whether it goes on."""
        size = self._size(job)
        with self._changed:
            while self._going.is_set() and job.number > self._first_open() and self._held + size > self._ahead:
                self._changed.wait(_LOOK_S)
            self._held += size
        return self._going.is_set()

    def _first_open(self) -> int:
        """The next note to be taken that is none of those with an error."""
        number = self._next
        while number < len(self._jobs) and self._jobs[number].error:
            number += 1
        return number

    def _finish(self, job: _Job, found: RenderedNote | BaseException) -> None:
        with self._changed:
            self._done[job.number] = found
            self._changed.notify_all()


class _Engines:
    """A worker's engines: each from its first note to its last."""

    def __init__(self, made: _Making, jobs: Sequence[_Job], going: threading.Event) -> None:
        self._made, self._going = made, going
        self._keys: dict[int, set[int]] = {}
        for job in jobs:
            self._keys.setdefault(job.kind, set()).add(job.note.note)
        self._left = Counter(job.kind for job in jobs)
        self._engines: dict[int, Engine | None] = {}

    def sound(self, job: _Job) -> RenderedNote:
        """The answer to a job. Raises _Stopped."""
        samples, error = None, ""
        try:
            samples = self._made.sound(self._engine(job), job, self._going)
        except (ValueError, TypeError, RuntimeError, ArithmeticError, MemoryError) as raised:
            error = _line(raised)
        self._left[job.kind] -= 1
        if not self._left[job.kind]:
            self._close(job.kind)
        return RenderedNote(job.number, job.note, samples, self._made.rate_hz, error)

    def _engine(self, job: _Job) -> Engine:
        """That of all of the worker's notes of a preset; of this one alone where they cannot be prepared together."""
        assert job.preset is not None
        if job.kind not in self._engines:
            try:
                self._engines[job.kind] = self._prepared(job.preset, self._keys[job.kind])
            except ValueError:
                self._engines[job.kind] = None
        engine = self._engines[job.kind]
        return self._prepared(job.preset, {job.note.note}) if engine is None else engine

    def _prepared(self, preset: Preset, keys: set[int]) -> Engine:
        with _PREPARING:
            return self._made.engine(preset, keys, self._going)

    def _close(self, kind: int) -> None:
        engine = self._engines.pop(kind, None)
        if engine is not None:
            engine.close()

    def close(self) -> None:
        for kind in list(self._engines):
            self._close(kind)
