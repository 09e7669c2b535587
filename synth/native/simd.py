"""LLVM's vectors, as wide as the machine's registers, for intrinsics that compiled code calls like functions.

Numba's own vectoriser prefers half that width and keeps sums in registers only where it likes to. Elements are doubles, or
floats, of which a register holds twice as many.
"""

from __future__ import annotations

import os

import llvmlite.binding
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils

from synth.native.interpreted import intrinsic


def _lanes() -> tuple[int, int]:
    """Doubles in a vector register of what Numba compiles for, or JAWARI_LANES of the environment (8, 4 or 2); and up to how
    many modes a row takes half of one: none, or what stands behind it (8-64).

    Compiled kernels are kept apart by it (`kernel_cache`); a NUMBA_CACHE_DIR of your own needs a folder for each.
    """
    asked = os.environ.get("JAWARI_LANES", "")
    if asked:
        wanted, _, short = asked.partition("-")
        if wanted not in ("2", "4", "8") or (short and not short.isdecimal()):
            raise ValueError(
                f"JAWARI_LANES must be 2, 4 or 8, or of the form 8-64 (half as many for up to 64 modes), got {asked!r}; "
                "unset it for the processor's default"
            )
        return int(wanted), int(short or 0) if wanted != "2" else 0
    of_level = {"x86-64-v4": 8, "x86-64-v3": 4}.get(os.environ.get("NUMBA_CPU_NAME", ""))
    if of_level is not None:
        return of_level, 0
    features = llvmlite.binding.get_host_cpu_features()
    if features.get("avx512f"):
        return 8, 0
    return (4 if features.get("avx2") else 2), 0


LANES, NARROW_UP_TO = _lanes()

DOUBLE = ir.DoubleType()
INT = ir.IntType(64)
VECTOR = ir.VectorType(DOUBLE, LANES)
LOOSE = ("reassoc", "contract", "nsz")


class Code:
    """What emitters share: addresses and vectors as wide as `doubles` doubles, of doubles (float64) or, where `single`, of
    floats (float32), twice as many."""

    def __init__(self, context, builder, signature, args, single: bool = False, doubles: int = LANES) -> None:
        self.b = builder
        self.context = context
        self.signature = signature
        self.args = args
        self.single = single
        self.doubles = doubles
        self.lanes = 2 * doubles if single else doubles
        self.vector = ir.VectorType(ir.FloatType() if single else DOUBLE, self.lanes)
        self.align = 4 if single else 8
        fma = ir.FunctionType(self.vector, [self.vector] * 3)
        kind = "f32" if single else "f64"
        self._fma = cgutils.get_or_insert_function(builder.module, fma, f"llvm.fma.v{self.lanes}{kind}")

    @property
    def zero(self):
        """A vector of zeros."""
        return ir.Constant(self.vector, [0.0] * self.lanes)

    def data(self, i: int):
        """Address of argument i's first element."""
        return self.context.make_array(self.signature.args[i])(self.context, self.b, self.args[i]).data

    def row_length(self, i: int):
        """Length of a row of argument i, an array of two axes."""
        array = self.context.make_array(self.signature.args[i])(self.context, self.b, self.args[i])
        return self.b.extract_value(array.shape, 1)

    def load(self, base, at):
        """A vector of elements from base[at] on."""
        return self.b.load(self.b.bitcast(self.b.gep(base, [at]), self.vector.as_pointer()), align=self.align)

    def store(self, value, base, at) -> None:
        self.b.store(value, self.b.bitcast(self.b.gep(base, [at]), self.vector.as_pointer()), align=self.align)

    def scalar(self, base, at: int):
        return self.b.load(self.b.gep(base, [ir.Constant(INT, at)]))

    def splat(self, value):
        """A number, a double, in every lane."""
        if self.single:
            value = self.b.fptrunc(value, ir.FloatType())
        none = ir.Constant(self.vector, ir.Undefined)
        one = self.b.insert_element(none, value, ir.Constant(ir.IntType(32), 0))
        return self.b.shuffle_vector(one, none, ir.Constant(ir.VectorType(ir.IntType(32), self.lanes), [0] * self.lanes))

    def fma(self, x, y, z):
        return self.b.call(self._fma, [x, y, z])

    def times(self, x, y):
        return self.b.fmul(x, y)

    def rows(self, base, length, numbers):
        """Addresses of rows `numbers` of an array."""
        return [self.b.gep(base, [self.b.mul(length, ir.Constant(INT, r))]) for r in numbers]

    def strided_rows(self, i: int, count: int):
        """Addresses of the first rows of argument i, an array of two axes whose rows may lie apart."""
        array = self.context.make_array(self.signature.args[i])(self.context, self.b, self.args[i])
        stride = self.b.extract_value(array.strides, 0)
        start = self.b.ptrtoint(array.data, INT)
        places = [self.b.add(start, self.b.mul(stride, ir.Constant(INT, r))) for r in range(count)]
        return [self.b.inttoptr(place, array.data.type) for place in places]

    def lanes_below(self, count):
        """Mask of the lanes whose number is less than `count`."""
        wide = ir.VectorType(INT, LANES)
        one = self.b.insert_element(ir.Constant(wide, ir.Undefined), count, ir.Constant(ir.IntType(32), 0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
        limit = self.b.shuffle_vector(one, ir.Constant(wide, ir.Undefined), zeros)
        return self.b.icmp_signed("<", ir.Constant(wide, list(range(LANES))), limit)

    def load_masked(self, base, at, mask):
        """The elements of the mask's lanes from base[at] on, zero in the others."""
        place = self.b.bitcast(self.b.gep(base, [at]), VECTOR.as_pointer())
        kind = ir.FunctionType(VECTOR, [place.type, ir.IntType(32), mask.type, VECTOR])
        load = cgutils.get_or_insert_function(self.b.module, kind, f"llvm.masked.load.v{LANES}f64.p0")
        return self.b.call(load, [place, ir.Constant(ir.IntType(32), 8), mask, ir.Constant(VECTOR, [0.0] * LANES)])

    def store_masked(self, value, base, at, mask) -> None:
        place = self.b.bitcast(self.b.gep(base, [at]), VECTOR.as_pointer())
        kind = ir.FunctionType(ir.VoidType(), [VECTOR, place.type, ir.IntType(32), mask.type])
        store = cgutils.get_or_insert_function(self.b.module, kind, f"llvm.masked.store.v{LANES}f64.p0")
        self.b.call(store, [value, place, ir.Constant(ir.IntType(32), 8), mask])

    def fold(self, sums):
        """`doubles` vectors → one vector of their sums, doubles, by shuffles of pairs: always in the same order. The halves
        of floats are added first, as floats."""
        width = self.doubles
        if self.single:
            sums = [self._halves(each) for each in sums]
        index = ir.VectorType(ir.IntType(32), width)
        span = 1
        while span < width:
            halves = []
            for x, y in zip(sums[::2], sums[1::2], strict=True):
                low, high = [], []
                for lane in range(width):
                    source = lane // (2 * span) * 2 * span + lane % span
                    if lane // span % 2:
                        source += width
                    low.append(source)
                    high.append(source + span)
                a = self.b.shuffle_vector(x, y, ir.Constant(index, low))
                c = self.b.shuffle_vector(x, y, ir.Constant(index, high))
                halves.append(self.b.fadd(a, c))
            sums = halves
            span *= 2
        return sums[0]

    def _halves(self, x):
        """The doubles of a vector of floats whose halves are added."""
        index = ir.VectorType(ir.IntType(32), self.doubles)
        low, high = (
            self.b.shuffle_vector(x, x, ir.Constant(index, list(range(first, first + self.doubles))))
            for first in (0, self.doubles)
        )
        return self.b.fpext(self.b.fadd(low, high), ir.VectorType(DOUBLE, self.doubles))

    def store_doubles(self, value, base, at) -> None:
        """What `fold` gives to base[at] on."""
        self.b.store(value, self.b.bitcast(self.b.gep(base, [at]), value.type.as_pointer()), align=8)


def _plain_move_within(x: np.ndarray, to: int, start: int, count: int) -> None:
    x[to : to + count] = x[start : start + count].copy()


@intrinsic(plain=_plain_move_within)
def move_within(typingctx, x, to, start, count):
    """x[to : to + count] = x[start : start + count], also where the two overlap."""

    def emit(context, builder, signature, args):
        base = Code(context, builder, signature, args).data(0)
        cgutils.raw_memmove(builder, builder.gep(base, [args[1]]), builder.gep(base, [args[2]]), args[3], 8, align=8)
        return context.get_dummy_value()

    return types.void(x, types.int64, types.int64, types.int64), emit
