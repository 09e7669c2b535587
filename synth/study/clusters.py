"""Where a study's rows are computed: in processes of this machine, on a cluster of Dask's, or in this process.

A crew takes batches (`submit`), and gives what has become of them (`wait`): a result, KILLED where workers died of one again
and again, or LOST where it has to be given anew.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import pickle
import queue
import shutil
import tempfile
import time
from collections import OrderedDict
from pathlib import Path
from typing import Any, Protocol

from synth.study.remote import Remote
from synth.study.work import running

#: what has become of a batch, in the place of a result
KILLED, LOST = object(), object()
#: workers that die under a task before it is given back: Dask's own 3 is for clusters whose machines come and go
_ALLOWED_FAILURES = 1
#: Dask watches itself many times a second in every process; a study's rows tell by themselves how far they are
_CALM = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.system-monitor.gil.enabled": False,
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.admin.tick.interval": "500ms",
    "distributed.worker.memory.monitor-interval": "500ms",
}
#: references that stay on the cluster though no batch needs them just now
_REFERENCES = 8
_ONE_THREAD = {
    name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
}  # fmt: skip


class Crew(Protocol):
    """Who computes."""

    def workers(self) -> int:
        """How many there are just now."""
        ...

    def submit(self, reference: tuple[str, Any] | None, jobs: Any, first: bool = False) -> Any:
        """Takes a batch of rows, or, as a dict, a reference; a ticket for it. reference: its address and what reads it."""
        ...

    def wait(self, timeout_s: float) -> list[tuple[Any, Any]]:
        """(ticket, result) of what is finished; none where nothing is within that time."""
        ...

    def close(self) -> None:
        """Ends what was begun for the study."""
        ...


def _environ(given: dict[str, Any]) -> dict[str, Any]:
    """Of workers that are begun here: one thread for libraries, and memory as in any other process. Dask's own setting of
    malloc gives every array of more than 64 kB back to the system at once, and NumPy's loops take several times as long."""
    return {name: value for name, value in given.items() if name != "MALLOC_TRIM_THRESHOLD_"} | _ONE_THREAD


def _given(data: bytes) -> Any:
    """Something that many batches need: a task, so that a worker that dies takes nothing with it."""
    return pickle.loads(data)


def _batch(head: Any, reference: Any, jobs: Any) -> Any:
    return running.run_batch(head, reference, jobs)


def _reference(head: Any, job: Any) -> Any:
    return running.run_reference(head, job["settings"], job["source"])


class Here:
    """This process, one batch after the other: a plain loop."""

    def __init__(self, head: dict[str, Any]) -> None:
        self._head = head
        self._waiting: list[tuple[int, Any, Any]] = []
        self._tickets = 0
        self._reference: tuple[str, Any] = ("", None)

    def workers(self) -> int:
        return 1

    def submit(self, reference: tuple[str, Any] | None, jobs: Any, first: bool = False) -> Any:
        self._tickets += 1
        self._waiting.append((self._tickets, reference, jobs))
        return self._tickets

    def wait(self, timeout_s: float) -> list[tuple[Any, Any]]:
        if not self._waiting:
            return []
        ticket, reference, jobs = self._waiting.pop(0)
        if isinstance(jobs, dict):
            return [(ticket, _reference(self._head, jobs))]
        if reference is not None and self._reference[0] != reference[0]:
            self._reference = (reference[0], reference[1]())
        return [(ticket, _batch(self._head, self._reference[1] if reference else None, jobs))]

    def close(self) -> None:
        self._waiting.clear()


class Dask:
    """Workers of Dask's `distributed`: so many processes of this machine (`enclosed`), or those of the scheduler at an
    address.

    Raises OSError where no scheduler answers at the address, and while waiting where it has gone.
    """

    def __init__(self, head: dict[str, Any], workers: int, scheduler: Remote | None, wait_s: float = 20.0) -> None:
        import dask
        from distributed import Client

        self._cluster: Any = None
        self._folder: Path | None = None
        self._scheduler = None if scheduler is None else scheduler.address
        self._config = dask.config.set(
            {
                "distributed.scheduler.allowed-failures": _ALLOWED_FAILURES,
                "distributed.scheduler.worker-ttl": None,
                "distributed.nanny.pre-spawn-environ": _environ(dask.config.get("distributed.nanny.pre-spawn-environ", {})),
                "distributed.admin.large-graph-warning-threshold": "1GB",
                **_CALM,
            }
        )
        self._levels = {name: logging.getLogger(name).level for name in ("distributed", "asyncio", "tornado")}
        for name in self._levels:
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            if scheduler is None:
                from synth.study.enclosed import enclosed

                self._folder = Path(tempfile.mkdtemp(prefix="jawari-workers-"))  # of this user alone
                self._cluster = enclosed(workers, self._folder)
                self._client = Client(self._cluster, timeout=wait_s, set_as_default=False)
            else:
                self._client = Client(scheduler.address, timeout=wait_s, set_as_default=False, security=scheduler.security)
        except (OSError, ValueError, RuntimeError) as error:
            self.close()
            if scheduler is None:
                raise OSError(f"workers could not be started: {error}") from None
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
                f"the scheduler {self._scheduler or 'of this process'} has gone; finished rows are kept: start it again, "
                "and the same command continues"
            )

    def submit(self, reference: tuple[str, Any] | None, jobs: Any, first: bool = False) -> Any:
        self._numbers += 1
        kind = "reference" if isinstance(jobs, dict) else "rows"
        key = f"{kind}-{self._prefix}-{self._numbers}"
        given = self._reference_given(*reference) if reference is not None else None
        more: dict[str, Any] = {"key": key, "pure": False, "priority": 10 if first else 0}
        if kind == "reference":
            future = self._client.submit(_reference, self._head, jobs, **more)
        else:
            future = self._client.submit(_batch, self._head, given, jobs, **more)
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
            return KILLED
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
        for each in (getattr(self, "_client", None), self._cluster):
            if each is not None:
                with contextlib.suppress(Exception):
                    each.close(timeout=10)
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
        for name, level in self._levels.items():
            logging.getLogger(name).setLevel(level)
        self._config.__exit__(None, None, None)


def crew_of(head: dict[str, Any], workers: int, scheduler: Remote | None) -> Crew:
    """Who computes: `workers` processes here (0: this one), or those of a scheduler."""
    return Here(head) if scheduler is None and workers == 0 else Dask(head, workers, scheduler)
