"""Long computations: begun, followed by their progress, and ended before they are done."""

from __future__ import annotations

import json
import logging
import secrets
import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from synth.author.errors import one_line

LOG = logging.getLogger(__name__)
#: jobs at a time, and how many are remembered
AT_ONCE, KEPT = 2, 50

#: told how much is done (0 … 1); False: it is to end
Progress = Callable[[float], bool]


class Job:
    """One computation. `made`: what it returned, for the program; `result`: that as JSON can say it."""

    def __init__(self, about: str) -> None:
        self.id = secrets.token_hex(8)
        self.about = about
        self.state = "running"
        self.made: Any = None
        self._result: Any = None
        self._error: str | None = None
        self._progress = 0.0
        self._cancelled = threading.Event()

    def progress(self, done: float) -> bool:
        self._progress = min(1.0, max(self._progress, float(done)))
        return not self._cancelled.is_set()

    def cancel(self) -> None:
        self._cancelled.set()

    def as_dict(self) -> dict[str, Any]:
        out: dict[str, Any] = {"state": self.state, "progress": self._progress}
        if self.state == "done":
            out["result"] = self._result
        if self.state == "failed":
            out["error"] = self._error
        return out

    def run(self, work: Callable[[Progress], Any], tell: Callable[[Any], Any]) -> None:
        """Do the work; `tell` makes of what it returns what JSON can say."""
        try:
            if self._cancelled.is_set():
                self.state = "cancelled"
                return
            self.made = work(self.progress)
            self._result = tell(self.made)
            json.dumps(self._result, allow_nan=False)
        except Exception as error:
            if self._cancelled.is_set():
                self.state = "cancelled"
                return
            if not isinstance(error, ValueError | OSError):
                LOG.exception("%s failed", self.about)
            self._error = one_line(error)
            self.state = "failed"
            return
        self._progress = 1.0
        self.state = "cancelled" if self._cancelled.is_set() else "done"


class Jobs:
    """The jobs of a server. `about`: the document that they are about; a newer one of the same kind ends the older."""

    def __init__(self) -> None:
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._workers = ThreadPoolExecutor(AT_ONCE, thread_name_prefix="author-job")

    def start(self, about: str, work: Callable[[Progress], Any], tell: Callable[[Any], Any] = lambda made: made) -> Job:
        for other in self._jobs.values():
            if other.about == about:
                other.cancel()
        job = Job(about)
        self._jobs[job.id] = job
        while len(self._jobs) > KEPT:
            self._jobs.popitem(last=False)[1].cancel()
        self._workers.submit(job.run, work, tell)
        return job

    def __getitem__(self, key: str) -> Job:
        """Raises KeyError."""
        return self._jobs[key]

    def close(self) -> None:
        for job in self._jobs.values():
            job.cancel()
        self._workers.shutdown(wait=False, cancel_futures=True)
