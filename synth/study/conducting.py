"""A study's rows to a crew and back. Rows are made as the crew can take them: neither this process nor a scheduler ever
holds more than a few batches for each worker, however many rows there are.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from synth.study.addressing import Addresses
from synth.study.clusters import LOST, Crew
from synth.study.design import Design
from synth.study.keeping import AddressSet, Folder
from synth.study.work.running import Stale
from synth.workers import Killed

#: what a batch takes: long beside what it costs to hand it out, short beside what is lost with a worker [s]
BATCH_S = 0.5
#: what it costs the process that conducts to hand one out and take it back, with room to spare [s]
_HANDLING_S = 0.004
#: rows of a batch, and bytes of arrays that come back with it, at most
_MOST_ROWS, _MOST_BYTES = 512, 32e6
#: batches in flight for each worker: one at work, two behind it
_AHEAD = 3
#: a batch that was lost with its scheduler's memory is given again so often
_MOST_LOST = 20
_LOST_AGAIN = "batches are lost again and again; check the scheduler and its workers, and start again"


class RowJob(NamedTuple):
    """A row to be computed."""

    key: str
    settings: dict[str, Any]
    source: dict[str, Any]
    reference: str | None


@dataclass
class Counts:
    """Rows: all that are asked for, those that are there (`kept` before this run, `failed` of all), computed in this run;
    retried: batches that had to be given again."""

    total: int
    kept: int = 0
    computed: int = 0
    failed: int = 0
    retried: int = 0
    workers: int = 0
    began: float = field(default_factory=time.monotonic)

    @property
    def done(self) -> int:
        return self.kept + self.computed


@dataclass
class _Batch:
    jobs: list[RowJob]
    alone: bool = False  # the only one of those that workers died of
    lost: int = 0


class Conductor:
    """One run of a study."""

    def __init__(
        self, design: Design, addresses: Addresses, folder: Folder, crew: Crew, done: AddressSet, failed: AddressSet,
        told: Callable[[Counts], None],
    ) -> None:  # fmt: skip
        self._addresses, self._folder, self._crew = addresses, folder, crew
        self._done, self._failed = done, failed
        self._told = told
        self.counts = Counts(len(design))
        self._coming = self._jobs(design)
        self._asked = AddressSet()
        self._waiting: dict[str | None, deque[RowJob]] = {}  # by reference
        self._held = 0
        self._again: deque[_Batch] = deque()
        self._suspects: deque[RowJob] = deque()
        self._flying: dict[Any, _Batch] = {}
        self._references: dict[str, Any] = {}  # ticket of what is being computed
        self._broken: dict[str, dict[str, Any]] = {}  # failure of those that cannot be computed
        self._readable = AddressSet()
        self._computing: dict[Any, tuple[str, dict[str, Any], int]] = {}
        self._row_s, self._row_bytes = 0.0, 0.0
        self._exhausted = False

    def _jobs(self, design: Design) -> Iterator[RowJob]:
        """Rows that are not there yet, each once."""
        for settings in design:
            key, reference = address(self._addresses, design, settings)
            if key in self._asked:
                self.counts.kept += 1  # two rows that ask the same
                continue
            self._asked.add(key)
            if key in self._done:
                self.counts.kept += 1
                self.counts.failed += key in self._failed
                continue
            if reference is not None:
                self._need(reference, design.reference(settings) or {})
            yield RowJob(key, settings, self._addresses.source(settings), reference)

    def _need(self, key: str, settings: dict[str, Any]) -> None:
        if key in self._references or key in self._readable or key in self._broken:
            return
        if self._folder.has_reference(key):
            self._readable.add(key)
            return
        job = {"settings": settings, "source": self._addresses.source(settings)}
        ticket = self._crew.submit(None, job, first=True)
        self._computing[ticket] = (key, job, 0)
        self._references[key] = ticket

    def run(self) -> Counts:
        """Until every row is there. Raises OSError, ValueError where workers have another program."""
        while True:
            self._fill()
            if not self._flying and not self._computing:
                if self._exhausted and not self._held and not self._again and not self._suspects:
                    break
            for ticket, outcome in self._crew.wait(0.25):
                if ticket in self._computing:
                    self._take_reference(ticket, outcome)
                else:
                    self._take(self._flying.pop(ticket), outcome)
            self._folder.tick()
            self._told(self.counts)
        return self.counts

    def _fill(self) -> None:
        self.counts.workers = self._crew.workers()
        workers = max(1, self.counts.workers)
        while len(self._flying) < _AHEAD * workers:
            batch = self._next(workers)
            if batch is None:
                return
            reference = batch.jobs[0].reference
            given = None if reference is None else (reference, partial(_read_reference, self._folder.path, reference))
            jobs = [(job.key, job.settings, job.source) for job in batch.jobs]
            self._flying[self._crew.submit(given, jobs)] = batch

    def _next(self, workers: int) -> _Batch | None:
        if self._again:
            return self._again.popleft()
        size = self._size(workers)
        while not self._exhausted and self._held < 2 * size * workers + 16:
            job = next(self._coming, None)
            if job is None:
                self._exhausted = True
            elif job.reference in self._broken:
                self._fail(job)
            else:
                self._waiting.setdefault(job.reference, deque()).append(job)
                self._held += 1
        if self._exhausted:  # so that all workers end at one time
            size = max(1, min(size, self._held // (2 * workers)))
        for reference, jobs in self._waiting.items():
            if reference is not None and self._references.get(reference) in self._computing:
                continue
            taken = [jobs.popleft() for _ in range(min(size, len(jobs)))]
            if not jobs:
                del self._waiting[reference]
            else:  # the next in turn
                self._waiting[reference] = self._waiting.pop(reference)
            self._held -= len(taken)
            return _Batch(taken)
        if self._suspects and not self._flying:  # whoever waits on a worker dies with what it is at
            return _Batch([self._suspects.popleft()], alone=True)
        return None

    def _fail(self, job: RowJob) -> None:
        """A row whose reference has failed is not computed: it fails with the same reason."""
        failure = self._broken[job.reference or ""]
        said = {"failure": f"its reference failed: {failure['failure']}", "failed_at": failure.get("failed_at", "")}
        self._keep(job, said, {}, {})
        self._folder.tick()

    def _size(self, workers: int) -> int:
        """Rows of a batch."""
        if not self._row_s:
            return 1
        wanted = max(BATCH_S, _HANDLING_S * workers) / max(self._row_s, 1e-6)
        if self._row_bytes:
            wanted = min(wanted, _MOST_BYTES / self._row_bytes)
        return int(max(1, min(wanted, _MOST_ROWS)))

    def _take_reference(self, ticket: Any, outcome: Any) -> None:
        key, job, times = self._computing.pop(ticket)
        if isinstance(outcome, str):
            raise _unlike(outcome)
        if outcome is LOST and times >= _MOST_LOST:
            raise OSError(_LOST_AGAIN)
        if outcome is LOST or (isinstance(outcome, Killed) and times < 2):
            ticket = self._crew.submit(None, job, first=True)
            self._computing[ticket] = (key, job, times + 1)
            self._references[key] = ticket
            return
        if isinstance(outcome, Killed):
            outcome = {"failure": "workers died of it again and again"}
        del self._references[key]
        if "failure" in outcome:
            self._broken[key] = outcome
            for waiting in self._waiting.pop(key, ()):
                self._held -= 1
                self._fail(waiting)
            return
        self._folder.keep_reference(key, outcome)
        self._readable.add(key)

    def _take(self, batch: _Batch, outcome: Any) -> None:
        if isinstance(outcome, str):
            raise _unlike(outcome)
        if outcome is LOST:
            batch.lost += 1
            if batch.lost > _MOST_LOST:
                raise OSError(_LOST_AGAIN)
            self.counts.retried += 1
            self._again.append(batch)
        elif isinstance(outcome, Killed):
            self.counts.retried += 1
            if len(batch.jobs) > 1:
                self._again += [_Batch([job]) for job in batch.jobs]
            elif not batch.alone:
                self._suspects.append(batch.jobs[0])
            else:
                reason = {"failure": "workers died of it again and again (out of memory?)", "failed_at": ""}
                self._keep(batch.jobs[0], reason, {}, {})
        else:
            for job, (_, values, arrays, spent) in zip(batch.jobs, outcome, strict=True):
                self._keep(job, values, arrays, spent)

    def _keep(self, job: RowJob, values: dict[str, Any], arrays: Any, spent: dict[str, Any]) -> None:
        self._folder.add(job.key, self._addresses.code, job.settings, values, arrays, spent)
        self.counts.computed += 1
        self.counts.failed += "failure" in values
        seconds = spent.get("row_wall_s", self._row_s)
        weight = 0.1 if self._row_s else 1.0
        self._row_s += weight * (seconds - self._row_s)
        self._row_bytes += weight * (sum(each.nbytes for each in arrays.values()) - self._row_bytes)


def _read_reference(folder: Path, key: str) -> Any:
    """What rows are compared with, for whoever computes them. Raises OSError."""
    found = Folder(folder).reference(key)
    if found is None:
        raise OSError(f"{folder}: reference {key} is no longer readable; start again to compute it again")
    return found


def address(addresses: Addresses, design: Design, settings: dict[str, Any]) -> tuple[str, str | None]:
    """(address of a row, its reference's or None)."""
    asked = design.reference(settings)
    reference = None if asked is None else addresses.reference(asked, addresses.source(asked))
    return addresses.row(settings, addresses.source(settings), reference), reference


def _unlike(told: str) -> Exception:
    if isinstance(told, Stale):
        return OSError(f"a worker {told}, and start again")
    return ValueError(f"a worker runs other versions: {told}; install the same versions there, and start again")
