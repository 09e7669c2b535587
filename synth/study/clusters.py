"""Where a study's rows are computed: in processes of this machine, on a cluster of Dask's, or in this process.

A crew takes batches (`submit`), and gives what has become of them (`wait`): a result, `Killed` where workers died of one, or
LOST where it has to be given anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import pickle
import queue
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, Protocol

from synth.study.remote import Remote
from synth.study.work import running
from synth.workers import Here, Killed, WorkerPool

#: what has become of a batch, in the place of a result
LOST = object()
#: share of its part of the machine's memory that a worker may take
_MEMORY = 0.95
#: references that stay on the cluster, or with a worker, though no batch needs them just now
_REFERENCES = 8

#: a reference's address, and what reads it
Reference = tuple[str, Callable[[], Any]]


class Crew(Protocol):
    """Who computes."""

    def workers(self) -> int:
        """How many there are just now."""
        ...

    def submit(self, reference: Reference | None, jobs: Any, /, *, first: bool = False) -> Any:
        """Takes a batch of rows, or, as a dict, a reference; a ticket for it."""
        ...

    def wait(self, timeout_s: float) -> list[tuple[Any, Any]]:
        """(ticket, result) of what is finished; none where nothing is within that time."""
        ...

    def close(self) -> None:
        """Ends what was begun for the study."""
        ...


def _given(data: bytes) -> Any:
    """Something that many batches need: a task, so that a worker that dies takes nothing with it."""
    return pickle.loads(data)


class RowMaker:
    """What computes batches in a process, with the references that it has read last."""

    def __init__(self, head: dict[str, Any]) -> None:
        self._head = head
        self._references: OrderedDict[str, Any] = OrderedDict()

    def __call__(self, reference: Reference | None, jobs: Any) -> Any:
        if isinstance(jobs, dict):
            return running.run_reference(self._head, jobs["settings"], jobs["source"])
        return running.run_batch(self._head, None if reference is None else self._read(*reference), jobs)

    def _read(self, key: str, read: Callable[[], Any]) -> Any:
        if key not in self._references:
            self._references[key] = read()
        self._references.move_to_end(key)
        while len(self._references) > _REFERENCES:
            self._references.popitem(last=False)
        return self._references[key]


class Dask:
    """Workers of the scheduler of Dask's `distributed` at an address.

    Raises OSError where no scheduler answers there, and while waiting where it has gone.
    """

    def __init__(self, head: dict[str, Any], scheduler: Remote, wait_s: float = 20.0) -> None:
        import dask
        from distributed import Client

        self._scheduler = scheduler.address
        self._config = dask.config.set({"distributed.admin.large-graph-warning-threshold": "1GB"})
        self._levels = {name: logging.getLogger(name).level for name in ("distributed", "asyncio", "tornado")}
        for name in self._levels:
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            self._client = Client(scheduler.address, timeout=wait_s, set_as_default=False, security=scheduler.security)
        except (OSError, ValueError, RuntimeError) as error:
            self.close()
            what = "the address, the certificates" if scheduler.address.startswith("tls") else "the address"
            raise OSError(
                f"--scheduler: nothing answers at {scheduler.address} ({error}); check {what}, and `dask scheduler`"
            ) from None
        self._done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._batches: dict[Any, Any] = {}  # key → future
        self._needs: dict[Any, str | None] = {}  # key → reference
        self._references: OrderedDict[str, Any] = OrderedDict()
        self._numbers = 0
        self._prefix = hashlib.sha256(f"{time.time_ns()}".encode()).hexdigest()[:12]
        self._counted = (0.0, 0)
        self._head = self._give("head", head)

    def _give(self, name: str, what: Any) -> Any:
        data = pickle.dumps(what, protocol=5)
        return self._client.submit(_given, data, key=f"given-{self._prefix}-{name}", pure=False)

    def workers(self) -> int:
        """Threads of all workers, counted anew every few seconds."""
        when, count = self._counted
        if time.monotonic() - when > (1.0 if count == 0 else 5.0):
            try:
                count = sum(self._client.nthreads().values())
            except (OSError, RuntimeError, TimeoutError):
                self._check()
            self._counted = (time.monotonic(), count)
        return count

    def _check(self) -> None:
        if self._client.status not in ("running", "newly-created"):
            raise OSError(
                f"the scheduler {self._scheduler} has gone; finished rows are kept: start it again, "
                "and the same command continues"
            )

    def submit(self, reference: Reference | None, jobs: Any, /, *, first: bool = False) -> Any:
        self._numbers += 1
        kind = "reference" if isinstance(jobs, dict) else "rows"
        key = f"{kind}-{self._prefix}-{self._numbers}"
        given = self._reference_given(*reference) if reference is not None else None
        more: dict[str, Any] = {"key": key, "pure": False, "priority": 10 if first else 0}
        if kind == "reference":
            future = self._client.submit(running.run_reference, self._head, jobs["settings"], jobs["source"], **more)
        else:
            future = self._client.submit(running.run_batch, self._head, given, jobs, **more)
        self._batches[key] = future
        self._needs[key] = reference[0] if reference is not None else None
        future.add_done_callback(self._done.put)
        return key

    def _reference_given(self, key: str, read: Any) -> Any:
        if key not in self._references:
            self._references[key] = self._give(key, read())
        self._references.move_to_end(key)
        needed = set(self._needs.values()) | {key}
        idle = [each for each in self._references if each not in needed]
        for each in idle[: max(0, len(self._references) - _REFERENCES)]:
            del self._references[each]
        return self._references[key]

    def wait(self, timeout_s: float) -> list[tuple[Any, Any]]:
        ready = []
        with contextlib.suppress(queue.Empty):
            ready.append(self._done.get(timeout=timeout_s))
            while len(ready) < 256:
                ready.append(self._done.get_nowait())
        if not ready:
            self._check()
            return []
        good = [future for future in ready if future.status == "finished"]
        results: dict[Any, Any] = {}
        try:
            results = dict(zip([future.key for future in good], self._client.gather(good), strict=True))
        except Exception:  # one of them was lost on the way: each by itself
            results = {}
        found = []
        for future in ready:
            ticket = future.key
            if ticket not in self._batches:
                continue
            outcome = results[ticket] if ticket in results else self._result(future)
            del self._batches[ticket], self._needs[ticket]
            found.append((ticket, outcome))
        return found

    def _result(self, future: Any) -> Any:
        from distributed.scheduler import KilledWorker

        try:
            return future.result()
        except KilledWorker:
            return Killed()
        except Exception as error:
            self._check()
            if type(error).__name__ in (
                "CancelledError",
                "FutureCancelledError",
                "FuturesCancelledError",
                "CommClosedError",
            ):
                return LOST
            raise OSError(f"a worker could not take a batch: {type(error).__name__}: {error}") from error

    def close(self) -> None:
        for what in ("_head", "_batches", "_references"):
            self.__dict__.pop(what, None)
        with contextlib.suppress(Exception):
            self._client.close(timeout=10)
        for name, level in self._levels.items():
            logging.getLogger(name).setLevel(level)
        self._config.__exit__(None, None, None)


def crew_of(head: dict[str, Any], workers: int, scheduler: Remote | None) -> Crew:
    """Who computes: `workers` processes here (0: this one), or those of a scheduler."""
    if scheduler is not None:
        return Dask(head, scheduler)
    if workers == 0:
        return Here(RowMaker, head)
    from distributed.system import MEMORY_LIMIT

    return WorkerPool(workers, RowMaker, head, most_bytes=_MEMORY * MEMORY_LIMIT / workers)
