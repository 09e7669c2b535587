"""The machine's own peak: multiply-adds in independent chains of explicit vectors, and nothing else."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

#: of each chain between two tests of the loop
_UNROLLED = 4
_DOUBLE, _INT = ir.DoubleType(), ir.IntType(64)


def chains() -> int:
    """Independent sums: more than latency × units of any machine, and no more than stay in its registers."""
    features = llvmlite.binding.get_host_cpu_features()
    few_registers = features.get("sse2") and not features.get("avx512f")  # 16, of which two hold the factors
    return 12 if few_registers else 16


def _make_loop(lanes: int):
    vector = ir.VectorType(_DOUBLE, lanes)

    @intrinsic
    def spin(typingctx, turns, state):
        """`turns` × unrolled steps s ← x s + y of every chain; state = x, y, then lanes × chains of s, by address."""

        def emit(context, b, signature, args):
            turns, base = args
            fma = cgutils.get_or_insert_function(b.module, ir.FunctionType(vector, [vector] * 3), f"llvm.fma.v{lanes}f64")

            def at(place: int):
                return b.bitcast(b.gep(base, [ir.Constant(_INT, place * lanes)]), vector.as_pointer())

            x, y = b.load(at(0), align=8), b.load(at(1), align=8)
            start = [b.load(at(2 + k), align=8) for k in range(chains())]
            before = b.block
            loop, done = b.append_basic_block("turns"), b.append_basic_block("spun")
            b.branch(loop)
            b.position_at_end(loop)
            turn = b.phi(_INT)
            turn.add_incoming(ir.Constant(_INT, 0), before)
            old = []
            for s in start:
                phi = b.phi(vector)
                phi.add_incoming(s, before)
                old.append(phi)
            new = list(old)
            for _ in range(_UNROLLED):
                new = [b.call(fma, [x, s, y]) for s in new]
            following = b.add(turn, ir.Constant(_INT, 1))
            turn.add_incoming(following, loop)
            for phi, s in zip(old, new, strict=True):
                phi.add_incoming(s, loop)
            b.cbranch(b.icmp_signed("<", following, turns), loop, done)
            b.position_at_end(done)
            for k, s in enumerate(new):
                b.store(s, at(2 + k), align=8)
            return context.get_dummy_value()

        return types.void(types.int64, types.CPointer(types.float64)), emit

    @njit(nogil=True)
    def loop(turns, state):
        spin(turns, state.ctypes)

    return loop


@cache
def peak_loop(lanes: int) -> Callable[[int], None]:
    """A compiled function of a number of turns, each worth `fma_of_turn(lanes)`; checked against plain arithmetic."""
    run = _make_loop(lanes)
    state = np.full((2 + chains()) * lanes, 0.5)
    state[2 * lanes :] = np.arange(chains() * lanes)
    expected = state[2 * lanes :].copy()
    run(3, state)
    for _ in range(3 * _UNROLLED):
        expected = 0.5 * expected + 0.5
    if not np.array_equal(state[2 * lanes :], expected):
        raise RuntimeError("the peak loop does not compute what it counts")
    return lambda turns: run(turns, state)


def fma_of_turn(lanes: int) -> int:
    """Multiply-adds of doubles in one turn of `peak_loop(lanes)`."""
    return _UNROLLED * chains() * lanes
