"""Workers at their scenes: each a process of one of the two packages; one that dies or hangs costs the scene it was at."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from same_sound.trees import TOOLS, Side

#: longest silence of a worker, which may have to compile all kernels [s]
MOST_SILENCE_S = 1800.0
DONE, UNKNOWN, FAILED = "done", "unknown", "failed"
#: a worker's word for an answer that its package has compiled a kernel for
COMPILED = "compiled"


@dataclass(frozen=True)
class Answer:
    """What a package made of a scene. `came`: DONE (the arrays are in `path`), UNKNOWN (it has no such thing; `words` say
    what), or FAILED (`words` are the error's line)."""

    scene: dict[str, Any]
    came: str
    words: str
    took_s: float
    path: Path


def answers(side: Side, wanted: Sequence[tuple[dict[str, Any], Path]], jobs: int) -> Iterator[Answer]:
    """The side's answers to scenes, as they come; each scene with the file that its arrays go to."""
    waiting: queue.SimpleQueue[tuple[dict[str, Any], Path]] = queue.SimpleQueue()
    for each in wanted:
        waiting.put(each)
    given: queue.SimpleQueue[Answer | BaseException] = queue.SimpleQueue()
    workers = [Worker(side) for _ in range(min(jobs, len(wanted)))]

    def work(worker: Worker) -> None:
        try:
            while True:
                try:
                    scene, path = waiting.get_nowait()
                except queue.Empty:
                    return
                given.put(worker.ask(scene, path))
        except BaseException as error:
            given.put(error)

    try:
        for worker in workers:
            threading.Thread(target=work, args=(worker,), daemon=True).start()
        for _ in wanted:
            answer = given.get()
            if isinstance(answer, BaseException):
                raise answer
            yield answer
    finally:
        for worker in workers:
            worker.end()


def environment_of(side: Side) -> dict[str, str]:
    """The environment of a process with the side's package, tools beside it, and one thread for each library."""
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    environment = os.environ | one | {"PYTHONPATH": os.pathsep.join([str(side.tree), str(TOOLS)])}
    environment.pop("NUMBA_CACHE_DIR", None)  # there one package's kernels would stand for the other's
    if side.cache is not None:
        side.cache.mkdir(exist_ok=True)
        environment["XDG_CACHE_HOME"] = str(side.cache)
    return environment


class Worker:
    """A process that renders scenes with one package, started when first asked and again after it has died."""

    def __init__(self, side: Side) -> None:
        self._side = side
        self._process: subprocess.Popen[str] | None = None
        self._errors = tempfile.TemporaryFile("w+", errors="replace")

    def ask(self, scene: dict[str, Any], path: Path) -> Answer:
        """The answer to a scene, of a process that has compiled nothing unless that cannot be had."""
        for last in (False, True):
            answer = self._ask(scene, path, last)
            if answer.came != COMPILED:
                break
            self._stop()
        return answer

    def _ask(self, scene: dict[str, Any], path: Path, last: bool) -> Answer:
        process = self._process = self._process or self._start()
        assert process.stdin is not None and process.stdout is not None
        watch = threading.Timer(MOST_SILENCE_S, process.kill)
        watch.daemon = True
        watch.start()
        try:
            process.stdin.write(json.dumps({"scene": scene, "path": str(path), "last": last}) + "\n")
            process.stdin.flush()
            line = process.stdout.readline()
        except BrokenPipeError:
            line = ""
        finally:
            watch.cancel()
        if line:
            said = json.loads(line)
            return Answer(scene, said["came"], said["words"], said["took_s"], path)
        return Answer(scene, FAILED, self._epitaph(), 0.0, path)

    def end(self) -> None:
        """End the process, for good."""
        self._stop()
        self._errors.close()

    def _stop(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                with suppress(OSError):
                    stream.close()  # type: ignore[union-attr]

    def _start(self) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-P", "-m", "same_sound.worker", str(self._side.tree)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors, text=True, env=environment_of(self._side),
        )  # fmt: skip

    def _epitaph(self) -> str:
        """Of what the process has died."""
        process, self._process = self._process, None
        assert process is not None
        code = process.wait()
        self._errors.seek(0)
        words = self._errors.read().strip().splitlines()
        self._errors.seek(0)
        self._errors.truncate()
        name = signal.Signals(-code).name if code < 0 else f"exit code {code}"
        return f"the worker died of {name}{': ' + words[-1] if words else ''}"
