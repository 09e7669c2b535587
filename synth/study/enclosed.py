"""A cluster of this machine's processes that only the process which began it can speak to.

Dask's schedulers, nannies and workers take pickled functions from every connection. So all of these speak TLS with a
certificate that is made for this cluster alone: it is kept in memory, goes to workers by the pipe that starts them, and
both sides of a connection show it. None of them serves web pages, and their files lie in a folder that no other user can
enter: Dask puts it first in `sys.path`.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import dask
from distributed import Nanny, Scheduler, SpecCluster, Worker
from distributed.security import Security


class PagelessScheduler(Scheduler):
    """A scheduler without Dask's web pages, which would show its tasks and logs to every user of the machine."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Starts none."""


class PagelessWorker(Worker):
    """A worker without Dask's web pages."""

    def start_http_server(self, *_: Any, **__: Any) -> None:
        """Starts none."""


def enclosed(workers: int, folder: Path) -> SpecCluster:
    """A running cluster of so many workers, one thread each. folder: of its files, of this user alone.

    Raises OSError or RuntimeError where it cannot be started.
    """
    security = Security.temporary()
    shared = {"host": "127.0.0.1", "protocol": "tls://", "security": security}
    worker = {
        "cls": Nanny,
        "options": {
            **shared, "nthreads": 1, "memory_limit": 1.0 / workers, "worker_class": PagelessWorker,
            "silence_logs": logging.CRITICAL, "local_directory": str(folder),
        },
    }  # fmt: skip
    with dask.config.set({"temporary-directory": str(folder)}):
        return SpecCluster(
            workers=dict.fromkeys(range(workers), worker),
            scheduler={"cls": PagelessScheduler, "options": {**shared, "port": 0, "dashboard": False}},
            worker=worker,
            security=security,
            silence_logs=logging.CRITICAL,
        )
