"""Notes computed on several threads: the kernels run side by side, and Ctrl-C keeps what was done."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from typing import TypeVar

from threadpoolctl import threadpool_limits

Item = TypeVar("Item")
Made = TypeVar("Made")


def computed(
    one: Callable[[Item], Made],
    items: Sequence[Item],
    threads: int,
    told: Callable[[int, int], None] | None = None,
) -> tuple[tuple[Made, ...], bool]:
    """What `one` makes of each item, in their order, `threads` at a time; of those that were done where a KeyboardInterrupt
    came, and whether none did. What `one` raises is raised."""
    futures: list[Future[Made]] = []
    pool = ThreadPoolExecutor(max(1, threads))
    complete = True
    with threadpool_limits(1, user_api="blas"):  # small matrices: BLAS's threads would only wait for each other
        try:
            futures = [pool.submit(one, item) for item in items]
            pending = set(futures)
            while pending:
                done, pending = wait(pending, timeout=0.2, return_when=FIRST_COMPLETED)
                for each in done:
                    each.result()
                if told is not None:
                    told(len(futures) - len(pending), len(futures))
        except KeyboardInterrupt:
            complete = False
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
    made = [each.result() for each in futures if each.done() and not each.cancelled() and each.exception() is None]
    return tuple(made), complete and len(made) == len(items)


def all_computed(
    one: Callable[[Item], Made],
    items: Sequence[Item],
    threads: int,
    told: Callable[[int, int], None] | None = None,
) -> tuple[Made, ...]:
    """`computed` of all items, for what is nothing in parts. Raises KeyboardInterrupt where one came."""
    made, complete = computed(one, items, threads, told)
    if not complete:
        raise KeyboardInterrupt
    return made
