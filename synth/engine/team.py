"""Threads that advance instruments beside the one that calls `process`.

Work is a list of instruments of which every thread takes the next two, towards the end the next one (a counter that runs
down): strings that only press go side by side. The caller takes part; once nothing is left to take it waits only for those
that another thread has in hand. A worker that finds nothing to do looks again for some tens of µs and then sleeps until it
gets a token. The caller sends one and does not wait for it either: who comes too late finds nothing left.

Which thread computes an instrument changes no bit: each string has a row of its own, and rows are added up in order.
"""

from __future__ import annotations

import os
import sys
import threading
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import int64, njit

from synth.engine.core import shared_of
from synth.engine.layout import CORE, NOBODY, WORK_ON
from synth.engine.uncopied import Uncopied
from synth.jit.entries import kernel
from synth.native.arrays import LINE_F8
from synth.native.atomics import add, exchange_if, give_way, load, pause, receive, send, store, tokens
from synth.native.denormals import enable_ftz
from synth.native.views import call_back

#: places in Shared.team, a cache line apart: instruments still to be taken; those not done; workers that sleep; whether all
#: are to end; and what does not change: workers, where to send tokens to
LEFT, UNFINISHED, SLEEPING, ENDING, WORKERS, WAKE = range(0, 6 * LINE_F8, LINE_F8)
N_WORDS = 6 * LINE_F8
#: how often a worker looks before it sleeps: about 50 µs on x86
LOOKS = 1000
#: mode-steps (some 0.3 ns each) below which nobody is woken or asked
WORTH_WAKING = 100_000
WORTH_SHARING = 10_000
TOKEN = (1).to_bytes(8, sys.byteorder)


@njit(**CORE)
def rouse(core: int, instruments: int, mode_steps: int) -> None:
    """Wake workers for about so many mode-steps of so many instruments, where that pays; wait for none."""
    words = shared_of(core).team
    if instruments < 2 or mode_steps < WORTH_WAKING or words[WORKERS] == 0:
        return
    wanted = min(words[WORKERS], instruments - 1)
    sleeping = load(words, SLEEPING)
    while sleeping > 0 and wanted > 0:
        if exchange_if(words, SLEEPING, sleeping, sleeping - 1):
            send(words[WAKE])
            wanted -= 1
        sleeping = load(words, SLEEPING)


@njit(**CORE)
def share_out(core: int, thread: int, count: int, mode_steps: int) -> None:
    """Work off the first `count` instruments of Shared.queue, about so many mode-steps, with whoever is there."""
    shared = shared_of(core)
    words = shared.team
    if count < 2 or mode_steps < WORTH_SHARING or words[WORKERS] == 0:
        for i in range(0, count, 2):
            other = shared.queue[i + 1] if i + 1 < count else NOBODY
            call_back(shared.task[WORK_ON], core, thread, shared.queue[i], other)
        return
    store(words, UNFINISHED, count)
    store(words, LEFT, count)
    rouse(core, count, mode_steps)
    while take_instruments(core, thread):
        pass
    looks = 0
    while load(words, UNFINISHED) > 0:
        pause()
        looks += 1
        if looks >= LOOKS:  # the thread that has it in hand may be waiting for this very processor
            give_way()
            looks = 0


@njit(**CORE)
def take_instruments(core: int, thread: int) -> bool:
    """Take an instrument and advance it, or two while there are enough for every thread; whether there was one."""
    shared = shared_of(core)
    words = shared.team
    left = load(words, LEFT)
    while left > 0:
        taken = 2 if left >= 2 * (words[WORKERS] + 1) else 1
        if exchange_if(words, LEFT, left, left - taken):
            other = shared.queue[left - 2] if taken == 2 else NOBODY
            call_back(shared.task[WORK_ON], core, thread, shared.queue[left - 1], other)
            add(words, UNFINISHED, -taken)
            return True
        left = load(words, LEFT)
    return False


@kernel(int64, int64, int64)
def _attend(core: int, thread: int, asleep: int) -> None:
    """The life of a worker; `asleep`: where it reads to sleep."""
    enable_ftz()
    words = shared_of(core).team
    looks = 0
    while load(words, ENDING) == 0:
        if take_instruments(core, thread):
            looks = 0
            continue
        looks += 1
        if looks < LOOKS:
            pause()
            continue
        looks = 0
        add(words, SLEEPING, 1)
        if load(words, LEFT) > 0 or load(words, ENDING) != 0:
            # awake after all, unless somebody has already sent for it
            sleeping = load(words, SLEEPING)
            called_off = False
            while sleeping > 0 and not called_off:
                called_off = exchange_if(words, SLEEPING, sleeping, sleeping - 1)
                sleeping = load(words, SLEEPING)
            if called_off:
                continue
        while not receive(asleep) and load(words, ENDING) == 0:
            pass


#: the function that is compiled for a team
ATTEND = getattr(_attend, "py_func", _attend)


#: every team of this process, for a child that is forked from it
_TEAMS: weakref.WeakSet[Team] = weakref.WeakSet()


class Team(Uncopied):
    """The workers of one engine, from now until `end`, the owner's collection or the interpreter's exit.

    core, scratches: tables of `views`, one thread per worker; words: Shared.team of that core. What they point to must stay
    where it is; `keep` is held on to as long as workers may look at it.
    """

    REMEDY = "an engine that is copied starts workers of its own"

    def __init__(self, owner: Any, core: np.ndarray, words: np.ndarray, scratches: Sequence[np.ndarray], keep: Any) -> None:
        _attend.ready()
        asleep, wake = tokens()
        words[:] = 0
        words[WAKE] = wake
        threads: list[threading.Thread] = []
        # made first: whatever happens to the owner from here on, the workers end
        self._end = weakref.finalize(owner, _end, os.getpid(), threads, words, (asleep, wake), (core, scratches, keep))
        for scratch in scratches:
            arguments = (core.ctypes.data, scratch.ctypes.data, asleep)
            thread = threading.Thread(target=_attend, args=arguments, name="synth-string", daemon=True)
            try:
                thread.start()
            except RuntimeError:  # no more threads to be had: then with those there are
                break
            threads.append(thread)
        words[WORKERS] = len(threads)
        self._words = words
        _TEAMS.add(self)

    def end(self) -> None:
        """Wait until all workers have ended. May be called again."""
        self._end()


def _go_on_alone() -> None:
    """In a forked child, where there are no workers and tokens would wake the parent's."""
    for team in _TEAMS:
        for word in (LEFT, UNFINISHED, SLEEPING, WORKERS):
            team._words[word] = 0


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_go_on_alone)


def _end(
    process_id: int, threads: list[threading.Thread], words: np.ndarray, descriptors: tuple[int, int], keep: Any
) -> None:
    if os.getpid() == process_id:  # threads do not survive a fork, and the tokens are the parent's
        words[WORKERS] = 0
        words[ENDING] = 1
        for _ in threads:
            os.write(descriptors[1], TOKEN)
        for thread in threads:
            thread.join()
    for descriptor in set(descriptors):
        os.close(descriptor)
