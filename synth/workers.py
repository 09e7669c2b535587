"""Processes of this machine that compute for this one, and end with it, however it ends.

A worker is given jobs and answers each, in turn; it listens to nobody but the process that began it, by a pipe. Of a pool's
workers one that dies is replaced: the job that it was at is told of as `Killed`, those behind it go to others.
"""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import count
from multiprocessing.connection import Connection, wait
from typing import Any

#: workers of a pool that may end before they have begun
MOST_STILLBORN = 3
#: interval between looks at the memory that is used [s]
_LOOK_S = 0.5
#: libraries whose threads would wait for each other, where each processor has a worker
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
_STARTING = threading.Lock()

#: what answers a job, called with its parts
Answering = Callable[..., Any]


class WorkerEnded(OSError):
    """A worker has ended before it has answered."""


@dataclass(frozen=True)
class Killed:
    """In the place of an answer: the worker died of the job, or at it. code: its exit code, where it is known."""

    code: int | None = None


class WorkerProcess:
    """A worker. `begin(*arguments)`, called there, gives what answers jobs; nice: how much it stands back behind others;
    most_bytes: it ends where it takes more memory."""

    def __init__(
        self, begin: Callable[..., Answering], *arguments: Any, name: str | None = None, nice: int = 0,
        most_bytes: float | None = None,
    ) -> None:  # fmt: skip
        context = multiprocessing.get_context("spawn")
        self.pipe, theirs = context.Pipe()
        told = (theirs, begin, arguments, nice, most_bytes)
        self.process: Any = context.Process(target=work, args=told, name=name, daemon=True)
        self.process.start()
        theirs.close()
        self.begun = False

    def ask(self, *job: Any) -> None:
        """Gives it a job; where it has ended, `take` says so."""
        with suppress(BrokenPipeError, ConnectionResetError):
            self.pipe.send(job)

    def take(self, timeout_s: float | None = None) -> list[Any]:
        """Its next answer, alone in a list; none where none comes within that time. Raises what the job raised, and
        WorkerEnded."""
        try:
            while self.pipe.poll(timeout_s):
                kind, value = self.pipe.recv()
                if kind == "raised":
                    raise value
                if kind == "made":
                    return [value]
                self.begun = True
            return []
        except (EOFError, ConnectionResetError, BrokenPipeError):
            raise WorkerEnded("the process that computes this has ended; try again") from None

    def end(self) -> None:
        """Ends it at once, whatever it is at."""
        self.pipe.close()
        self.process.kill()
        self.process.join()


def work(
    pipe: Connection, begin: Callable[..., Answering], arguments: Sequence[Any], nice: int, most_bytes: float | None
) -> None:
    """A worker's life: jobs in, answers out, until nobody asks any more."""
    for each in ("SIGINT", "SIGHUP"):  # a terminal sends them to the process that began this one as well
        if hasattr(signal, each):
            signal.signal(getattr(signal, each), signal.SIG_IGN)
    if nice and hasattr(os, "nice"):
        os.nice(nice)
    jobs: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(pipe, jobs), daemon=True).start()
    if most_bytes is not None:
        import psutil  # not by the thread: imports that run side by side may miss a module

        threading.Thread(target=_watch, args=(psutil.Process(), most_bytes), daemon=True).start()
    answering = begin(*arguments)
    _say(pipe, "begun", None)
    while True:
        job = jobs.get()
        try:
            said = ("made", answering(*job))
        except Exception as error:
            said = ("raised", error)
        _say(pipe, *said)


def _listen(pipe: Connection, jobs: queue.SimpleQueue[Any]) -> None:
    """Takes jobs as they come, so that nobody waits to be rid of one; ends the process when nobody can ask any more."""
    with suppress(EOFError, OSError):
        while True:
            jobs.put(pipe.recv())
    os._exit(1)


def _say(pipe: Connection, kind: str, value: Any) -> None:
    try:
        pipe.send((kind, value))
    except OSError:
        os._exit(1)
    except Exception as error:  # it cannot be pickled, and nothing of it was sent
        pipe.send(("raised", RuntimeError(f"{type(value).__name__} cannot be sent: {error}")))


def _watch(mine: Any, most_bytes: float) -> None:
    """Ends the process where it takes more memory."""
    while mine.memory_info().rss <= most_bytes:
        time.sleep(_LOOK_S)
    os._exit(1)


class Here:
    """A pool that is this process: jobs one after the other, in a plain loop, as they are waited for."""

    def __init__(self, begin: Callable[..., Answering], *arguments: Any) -> None:
        self._begin = (begin, *arguments)
        self._tickets = count()
        self._waiting: deque[list[tuple[int, Any]]] = deque()
        self._answering: Answering | None = None

    def workers(self) -> int:
        """How many there are."""
        return 1

    def submit(self, *job: Any, first: bool = False) -> int:
        """Takes a job, before all that wait if it is to come first; a ticket for it."""
        (ticket,) = self.submit_together([job], first)
        return ticket

    def submit_together(self, jobs: Sequence[Any], first: bool = False) -> list[int]:
        """Takes jobs that one worker is to do one after the other; tickets for them."""
        numbered = [(next(self._tickets), job) for job in jobs]
        (self._waiting.appendleft if first else self._waiting.append)(numbered)
        return [ticket for ticket, _ in numbered]

    def wait(self, timeout_s: float | None = None) -> list[tuple[int, Any]]:
        """(ticket, answer) of what is done; perhaps none, though the time is not over."""
        if not self._waiting:
            return []
        if self._answering is None:
            begin, *arguments = self._begin
            self._answering = begin(*arguments)
        ticket, job = self._waiting[0].pop(0)
        if not self._waiting[0]:
            self._waiting.popleft()
        return [(ticket, self._answering(*job))]

    def close(self) -> None:
        """Forgets what waits; ends workers, and what answers, where it has `close`."""
        self._waiting.clear()
        close = getattr(self._answering, "close", None)
        if close is not None:
            close()
        self._answering = None


class WorkerPool(Here):
    """So many workers, one thread for libraries each. Raises ChildProcessError where they end at once, or where answering
    raises; most_bytes: memory that each may take."""

    def __init__(
        self, workers: int, begin: Callable[..., Answering], *arguments: Any, most_bytes: float | None = None
    ) -> None:
        super().__init__(begin, *arguments)
        self._most_bytes = most_bytes
        self._workers: list[WorkerProcess | None] = [None] * workers
        self._given: list[deque[tuple[int, Any]]] = [deque() for _ in range(workers)]
        self._stillborn = 0

    def workers(self) -> int:
        return len(self._workers)

    def wait(self, timeout_s: float | None = None) -> list[tuple[int, Any]]:
        self._share_out()
        there: dict[Any, int] = {each.pipe: number for number, each in enumerate(self._workers) if each is not None}
        found: list[tuple[int, Any]] = []
        for ready in wait(list(there), timeout_s):
            worker = self._workers[number := there[ready]]
            assert worker is not None
            try:
                for answer in worker.take(0.0):
                    found.append((self._given[number].popleft()[0], answer))
            except WorkerEnded:
                found += self._bury(number)
            except Exception as error:
                raise ChildProcessError(f"a worker could not do its job: {type(error).__name__}: {error}") from error
        return found

    def _share_out(self) -> None:
        """Jobs to workers that have at most one left, so that none waits for the next, or has many when all others are
        done."""
        for most in (0, 1):  # first to those that have none
            for number, given in enumerate(self._given):
                if self._waiting and len(given) <= most:
                    self._give(number, self._waiting.popleft())

    def _give(self, number: int, jobs: list[tuple[int, Any]]) -> None:
        worker = self._workers[number]
        if worker is None:
            begin, *arguments = self._begin
            with _one_thread():
                worker = WorkerProcess(begin, *arguments, most_bytes=self._most_bytes)
            self._workers[number] = worker
        self._given[number] += jobs
        for _, job in jobs:
            worker.ask(*job)

    def _bury(self, number: int) -> list[tuple[int, Any]]:
        """A worker has died: what it was at, if it had begun; others do what it had beside."""
        dead, given = self._workers[number], self._given[number]
        assert dead is not None
        self._workers[number], self._given[number] = None, deque()
        dead.end()
        code = dead.process.exitcode
        if not dead.begun:
            self._stillborn += 1
            if self._stillborn > MOST_STILLBORN:
                raise ChildProcessError(
                    f"workers end at once (exit code {code}); a program of your own needs if __name__ == '__main__'"
                )
        killed = [(given.popleft()[0], Killed(code))] if dead.begun and given else []
        if given:
            self._waiting.appendleft(list(given))
        return killed

    def close(self) -> None:
        super().close()
        for worker in self._workers:
            if worker is not None:
                worker.end()
        self._workers = [None] * len(self._workers)


@contextmanager
def _one_thread() -> Iterator[None]:
    """What is begun within has ONE_THREAD in its environment."""
    with _STARTING:
        before = {name: os.environ.get(name) for name in ONE_THREAD}
        os.environ.update(ONE_THREAD)
        try:
            yield
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
