"""The inner loop of the decimator: the branches of a polyphase FIR, several outputs in the lanes of a vector.

With taps h_p[m] = taps[m·M + p] and inputs x_p[j] = line[j·M + p], output i is Σ_p Σ_m h_p[m]·x_p[i + m]:
neighbouring outputs read neighbouring inputs with the same taps. GROUP outputs stay in registers, and each vector of inputs
serves every output vector it overlaps at a distance of whole vectors. Every output is the same sum in the same order
wherever it stands. (Crochiere & Rabiner 1983, ch. 3.)
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types

from synth.native.interpreted import intrinsic
from synth.native.simd import INT, LANES, VECTOR, Code

#: taps of a branch
BRANCH = 74
_VECTORS = 4
#: outputs that are computed at a time
GROUP = _VECTORS * LANES


def _number(value: int):
    return ir.Constant(INT, value)


def _plain_add_branches(taps, branches, phases, stride, at, out) -> None:
    for p in range(1, branches):
        first = (p - 1) * stride + at
        out[:GROUP] += np.correlate(phases[first : first + GROUP + BRANCH - 1], taps[p * BRANCH : (p + 1) * BRANCH])


@intrinsic(plain=_plain_add_branches)
def add_branches(typingctx, taps, branches, phases, stride, at, out):
    """out[i] += Σ_{p=1…branches−1} Σ_m taps[p·BRANCH + m]·phases[(p−1)·stride + at + i + m] for i < GROUP; branches ≥ 2."""

    def emit(context, builder, signature, args):
        code, b = Code(context, builder, signature, args), builder
        at_out = code.data(5)
        zero = ir.Constant(VECTOR, [0.0] * LANES)
        places = [_number(a * LANES) for a in range(_VECTORS)]
        start = [[code.load(at_out, place), zero] for place in places]
        first = b.gep(code.data(2), [args[4]])
        before = b.block
        loop, done = b.append_basic_block("branches"), b.append_basic_block("summed")
        b.branch(loop)
        b.position_at_end(loop)
        p = b.phi(INT)
        p.add_incoming(_number(1), before)
        # two chains each, for even and odd blocks of taps: an FMA takes as long as eight are started
        carried = [[b.phi(VECTOR) for _ in range(2)] for _ in range(_VECTORS)]
        for row, values in zip(carried, start, strict=True):
            for phi, value in zip(row, values, strict=True):
                phi.add_incoming(value, before)
        sums = [list(row) for row in carried]
        h = b.gep(code.data(0), [b.mul(p, _number(BRANCH))])
        x = b.gep(first, [b.mul(b.sub(p, _number(1)), args[3])])
        for r in range(LANES):
            factors: list = []
            blocks = len(range(r, BRANCH, LANES))
            for c in range(blocks + _VECTORS - 1):
                if c < blocks:
                    factors.append(code.splat(code.scalar(h, r + LANES * c)))
                inputs = code.load(x, _number(r + LANES * c))
                for a in range(_VECTORS):
                    if 0 <= c - a < blocks:
                        chain = (c - a) % 2
                        sums[a][chain] = code.fma(factors[c - a], inputs, sums[a][chain])
        following = b.add(p, _number(1))
        p.add_incoming(following, loop)
        for row, values in zip(carried, sums, strict=True):
            for phi, value in zip(row, values, strict=True):
                phi.add_incoming(value, loop)
        b.cbranch(b.icmp_signed("<", following, args[1]), loop, done)
        b.position_at_end(done)
        for place, (even, odd) in zip(places, sums, strict=True):
            code.store(b.fadd(even, odd), at_out, place)
        return context.get_dummy_value()

    return types.void(taps, types.int64, phases, types.int64, types.int64, out), emit
