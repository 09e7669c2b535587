"""Pools of workers: answers, deaths, and what cannot be answered. Their jobs are expressions, which `eval` answers."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from typing import Any

import pytest

from synth.workers import ONE_THREAD, Here, Killed, WorkerEnded, WorkerPool, WorkerProcess

DIE = "__import__('os')._exit(7)"


def answers(pool: Here, tickets: list[int]) -> list[Any]:
    """What becomes of jobs, in their order."""
    found: dict[int, Any] = {}
    while len(found) < len(tickets):
        found.update(pool.wait())
    return [found[ticket] for ticket in tickets]


@pytest.fixture
def pool() -> Iterator[WorkerPool]:
    with closing(WorkerPool(2, partial, eval)) as made:
        yield made


def test_answers_are_those_of_this_process(pool: WorkerPool) -> None:
    asked = ["1 + 1", "'a' * 3", "[x for x in range(3)]"]
    here = Here(partial, eval)
    for crew in (pool, here):
        assert answers(crew, [crew.submit(each) for each in asked]) == [2, "aaa", [0, 1, 2]]
    (last, first) = here.submit("'last'"), here.submit("'first'", first=True)
    assert here.wait() == [(first, "first")] and here.wait() == [(last, "last")] and here.wait() == []


def test_a_death_is_of_one_job_and_those_behind_it_are_done_by_others(pool: WorkerPool) -> None:
    tickets = pool.submit_together([("1",), (DIE,), ("2",), ("3",)])
    assert answers(pool, tickets) == [1, Killed(7), 2, 3]


def test_jobs_given_together_are_done_by_one_worker_and_others_by_all(pool: WorkerPool) -> None:
    mine = "(__import__('time').sleep(0.2), __import__('os').getpid())[1]"
    assert len(set(answers(pool, pool.submit_together([(mine,)] * 3)))) == 1
    assert len(set(answers(pool, [pool.submit(mine) for _ in range(4)]))) == 2


def test_workers_have_one_thread_for_libraries_and_this_process_what_it_had(pool: WorkerPool) -> None:
    before = dict(os.environ)
    (theirs,) = answers(pool, [pool.submit("dict(__import__('os').environ)")])
    assert theirs.items() >= ONE_THREAD.items() and dict(os.environ) == before


@pytest.mark.parametrize(
    ("asked", "said"), [("int('x')", "ValueError: invalid literal"), ("lambda: 0", "RuntimeError: function cannot be sent")]
)
def test_what_raises_is_said(pool: WorkerPool, asked: str, said: str) -> None:
    ticket = pool.submit(asked)
    with pytest.raises(ChildProcessError, match=f"a worker could not do its job: {said}"):
        answers(pool, [ticket])


def test_workers_that_end_at_once_are_not_begun_for_ever() -> None:
    with closing(WorkerPool(2, os._exit, 3)) as pool:
        ticket = pool.submit("1")
        with pytest.raises(ChildProcessError, match=r"workers end at once .exit code 3.*if __name__ == '__main__'"):
            answers(pool, [ticket])


def test_one_worker_alone() -> None:
    worker = WorkerProcess(partial, eval)
    try:
        worker.ask("6 * 7")
        assert worker.take() == [42] and worker.take(0.0) == []
        worker.ask("int('x')")
        with pytest.raises(ValueError, match="invalid literal"):
            worker.take()
        worker.ask(DIE)
        with pytest.raises(WorkerEnded, match="has ended; try again"):
            worker.take()
        worker.ask("1")  # is said where the answer is taken
        with pytest.raises(WorkerEnded):
            worker.take()
    finally:
        worker.end()
