"""Vector code that numba's own loops do not become: K steps of every mode in registers.

Numba's vectoriser keeps a loop's reductions in registers only at the width that it prefers, and a loop over steps
inside one over modes not at all. The intrinsics here write LLVM's vectors out: `LANES` modes at a time, K = `BLOCK`
steps each, every sum in a register of its own, summed across lanes at the end by pairwise folding. They are called from
compiled code like functions; arrays must be C-contiguous and hold a whole number of vectors, `padded(N)` modes, what
lies behind the N-th being zero.

A mode's free motion x_k obeys x_{k+1} = a x_k − e x_{k−1} with a = tr Φ, e = det Φ, both for displacement and for
velocity. What forces f_k during the steps 0 … K − 1 add to the state at the end is, by Cayley–Hamilton,

    Σ_k Φ^{K−1−k} κ f_k = κ b_{K−1} + (Φ − a)κ b_{K−2},    b_k = f_k + a b_{k−1} − e b_{k−2},

κ the response of (q, v) to a unit force: two multiplications for a step, and no table. A kick, what the velocities change by
at the start of a step, is a force whose response is Φ(0, 1): its κ is (p12, p22), its (Φ − a)κ is (0, −e).

What each of them does stands in `plain_lanes` in Python. Rows of a block's coefficient array: `block_rows`.
"""

from __future__ import annotations

from llvmlite import ir
from numba import types
from numba.core import cgutils

from synth.jit.entries import kernel
from synth.native.interpreted import intrinsic
from synth.native.simd import DOUBLE, INT, LANES, LOOSE, NARROW_UP_TO, VECTOR, Code
from synth.solver import plain_lanes
from synth.solver.block_rows import (
    ADV11,
    ADV12,
    ADV21,
    ADV22,
    BLOCK,
    KQ,
    KQ_LATE,
    KV,
    KV_LATE,
    MINUS_DET,
    P11,
    P12,
    P21,
    P22,
    ROWS,
    TRACE,
)

#: modes are padded to a multiple of this, on every machine; those of float32 to a multiple of the other
PAD = 8
SINGLE_PAD = 16


@kernel(types.int64, answer=types.int64)
def padded(modes: int) -> int:
    """The smallest multiple of `PAD` that holds so many modes."""
    return (modes + PAD - 1) // PAD * PAD


@kernel(types.int64, answer=types.int64)
def padded_single(modes: int) -> int:
    """The smallest multiple of `SINGLE_PAD` that holds so many modes."""
    return (modes + SINGLE_PAD - 1) // SINGLE_PAD * SINGLE_PAD


def _emit_listed_forces(code: Code, j, count, which, shapes, forces, more):
    """f_k = more_k + Σ_d φ_c λ_dk over d < count, c = which[d], as K vectors, in a loop over the contacts."""
    b = code.b
    at_shapes, length, at_f, at_which = code.data(shapes), code.row_length(shapes), code.data(forces), code.data(which)
    before = b.block
    contacts, summed = b.append_basic_block("contacts"), b.append_basic_block("forces")
    b.branch(contacts)
    b.position_at_end(contacts)
    d = b.phi(INT)
    d.add_incoming(ir.Constant(INT, 0), before)
    sums = [b.phi(code.vector) for _ in range(BLOCK)]
    contact = b.load(b.gep(at_which, [d]))
    shape = code.load(b.gep(at_shapes, [b.mul(contact, length)]), j)
    mine = b.gep(at_f, [b.mul(d, ir.Constant(INT, BLOCK))])
    force = []
    for k in range(BLOCK):
        sums[k].add_incoming(more[k], before)
        force.append(code.fma(shape, code.splat(code.scalar(mine, k)), sums[k]))
        sums[k].add_incoming(force[k], contacts)
    following = b.add(d, ir.Constant(INT, 1))
    d.add_incoming(following, contacts)
    b.cbranch(b.icmp_signed("<", following, code.args[count]), contacts, summed)
    b.position_at_end(summed)
    return force


def _emit_horner(code: Code, trace, minus_det, inputs):
    """b_{K−2}, b_{K−1} of b_k = f_k + a b_{k−1} − e b_{k−2}, f the K inputs."""
    older, newer = inputs[0], code.fma(trace, inputs[0], inputs[1])
    for k in range(2, BLOCK):
        older, newer = newer, code.fma(trace, newer, code.fma(minus_det, older, inputs[k]))
    return older, newer


def _emit_advance(code: Code, at, j, x, y):
    """Displacements and velocities K steps on."""
    if code.single:  # what is added is small where a mode moves little in a block: nothing of it is lost to rounding
        return [
            code.fma(code.load(at[own], j), a, code.fma(code.load(at[cross], j), other, a))
            for own, cross, a, other in ((ADV11, ADV12, x, y), (ADV22, ADV21, y, x))
        ]
    return [
        code.fma(code.load(at[own], j), x, code.times(code.load(at[cross], j), y))
        for own, cross in ((ADV11, ADV12), (ADV21, ADV22))
    ]


#: doubles in a vector up to which there are 16 registers, and a loop goes along one chain of steps
_ONE_CHAIN_UP_TO = 4
#: how many arguments say what forces a pass has
_FORCES = {"": 0, "coast": 0, "drive": 2, "drive listed": 4, "drive listed and one": 6}


def _emit_pass(code: Code, motion: str, kinds: str) -> None:
    """One pass over the modes: K steps forward ("coast", "drive …" or ""), then a look at the K steps after.

    Arguments, in order: n, rows (ROWS, ≥n), q, v (≥n,) in place; for "drive" shape (≥n,), forces (K,); for "drive listed"
    count ≥ 1, which (≥count,) int64, shapes (C, ≥n), forces (≥count, K); for "drive listed and one" these and then those of
    "drive"; for each of these and "coast", where "kicked", too, kick shape (≥n,), kicks (K,); weights (≥n,) for each of
    `kinds`; an output (≥K,) for each of them: weights · x_{k+1}, x the displacements ("q") or velocities ("v") after each of
    K free steps, or what the velocities change by in it ("a").

    Modes and what they are multiplied with may be float32; forces, kicks and outputs are float64. Rows of float32 hold
    Φ^K − 1 where those of float64 hold Φ^K (`single.fill_single_rows`).
    """
    b = code.b
    kicked = motion.endswith(" kicked")
    motion = motion.removesuffix(" kicked")
    base, length = code.data(1), code.row_length(1)
    at = code.rows(base, length, range(ROWS))
    at_q, at_v = code.data(2), code.data(3)
    kicks_at = 4 + _FORCES[motion]
    place = kicks_at + (2 if kicked else 0)
    at_w = [code.data(place + p) for p in range(len(kinds))]
    at_out = [code.data(place + len(kinds) + p) for p in range(len(kinds))]

    def splats(i: int) -> list:
        """The K numbers of argument i, in every lane."""
        return [code.splat(code.scalar(code.data(i), k)) for k in range(BLOCK)]

    forces_at = {"drive": 5, "drive listed and one": 9}.get(motion)
    # a double is made a float, and that one spread, once; a double is read in the loop: from memory it costs no register
    rounded = {i: splats(i) for i in (forces_at, kicks_at + 1 if kicked else None) if code.single and i is not None}
    before = b.block
    loop = b.append_basic_block("modes")
    b.branch(loop)
    b.position_at_end(loop)
    j = b.phi(INT)
    j.add_incoming(ir.Constant(INT, 0), before)
    sums = [[b.phi(code.vector) for _ in range(BLOCK)] for _ in kinds]
    for row in sums:
        for s in row:
            s.add_incoming(code.zero, before)
    force = []
    if motion == "drive listed":
        force = _emit_listed_forces(code, j, 4, 5, 6, 7, [code.zero] * BLOCK)
    elif motion == "drive listed and one":
        shape = code.load(code.data(8), j)
        one = [code.times(shape, x) for x in rounded.get(9) or splats(9)]
        force = _emit_listed_forces(code, j, 4, 5, 6, 7, one)
    elif motion == "drive":
        force = rounded.get(5) or splats(5)
    x, y = code.load(at_q, j), code.load(at_v, j)
    trace = minus_det = None
    if kinds or force or kicked:
        trace, minus_det = code.load(at[TRACE], j), code.load(at[MINUS_DET], j)
    if motion:
        ahead = _emit_advance(code, at, j, x, y)
        if force:
            older, newer = _emit_horner(code, trace, minus_det, force)
            if motion == "drive":
                shape = code.load(code.data(4), j)
                older, newer = code.times(shape, older), code.times(shape, newer)
            for i, (early, late) in enumerate(((KQ, KQ_LATE), (KV, KV_LATE))):
                ahead[i] = code.fma(code.load(at[early], j), newer, code.fma(code.load(at[late], j), older, ahead[i]))
        if kicked:
            kicks = rounded.get(kicks_at + 1) or splats(kicks_at + 1)
            shape = code.load(code.data(kicks_at), j)
            older, newer = (code.times(shape, x) for x in _emit_horner(code, trace, minus_det, kicks))
            ahead[0] = code.fma(code.load(at[P12], j), newer, ahead[0])
            ahead[1] = code.fma(code.load(at[P22], j), newer, code.fma(minus_det, older, ahead[1]))
        x, y = ahead
        code.store(x, at_q, j)
        code.store(y, at_v, j)
    chains = {}  # of each kind what two steps one after the other give; the second is this one's, or the first of "a"
    if "q" in kinds:
        chains["q"] = [x, code.fma(code.load(at[P11], j), x, code.times(code.load(at[P12], j), y))]
    if "v" in kinds:
        chains["v"] = [y, code.fma(code.load(at[P21], j), x, code.times(code.load(at[P22], j), y))]
    if "a" in kinds:
        first = code.fma(code.load(at[P21], j), x, code.times(code.load(at[P22], j), y))
        second = code.fma(trace, first, code.times(minus_det, y))
        chains["a"] = [b.fsub(first, y), b.fsub(second, first)]
    w = [code.load(a, j) for a in at_w]
    new: list[list] = [[] for _ in kinds]
    for k in range(BLOCK):
        for p, kind in enumerate(kinds):
            new[p].append(code.fma(w[p], chains[kind][kind != "a"], sums[p][k]))
        if k + 1 < BLOCK:
            for kind, (older, newer) in chains.items():
                chains[kind] = [newer, code.fma(trace, newer, code.times(minus_det, older))]
    after = b.add(j, ir.Constant(INT, code.lanes))
    j.add_incoming(after, b.block)
    for row, result in zip(sums, new, strict=True):
        for s, r in zip(row, result, strict=True):
            s.add_incoming(r, b.block)
    done = b.append_basic_block("passed")
    b.cbranch(b.icmp_signed("<", after, code.args[0]), loop, done)
    b.position_at_end(done)
    for out, result in zip(at_out, new, strict=True):
        for first in range(0, BLOCK, code.doubles):
            code.store_doubles(code.fold(result[first : first + code.doubles]), out, ir.Constant(INT, first))


def _loops(motion: str, kinds: str, doubles: int) -> list[tuple[str, str, list[int]]]:
    """The loops over the modes that a pass is made of: motion, kinds, and which of its arguments, of each.

    With vectors of 512 bits it is one loop. Else forces act in a loop of their own, and displacements and velocities are
    looked at in one each: 16 registers hold the sums of one chain of steps, and a processor looks ahead over the chains of
    several modes only where they are short. All loops together do the same as one to the bit.
    """
    steps = motion.removesuffix(" kicked")
    first = 4 + _FORCES[steps] + (2 if steps != motion else 0)
    own, behind = list(range(first)), first + len(kinds)
    if doubles > _ONE_CHAIN_UP_TO or not kinds:
        return [(motion, kinds, list(range(behind + len(kinds))))]
    made = [(motion, "", own)] if first > 4 else []
    for kind in dict.fromkeys(kinds):
        places = [p for p in range(len(kinds)) if kinds[p] == kind]
        looks = [first + p for p in places] + [behind + p for p in places]
        made.append(("" if made else motion, kind * len(places), [0, 1, 2, 3, *looks]))
    return made


def one_kind_of_pass(motion: str, kinds: str, doubles: int = LANES, narrow_up_to: int = NARROW_UP_TO):
    """The intrinsic of one kind of pass; see `_emit_pass`. n is a multiple of `PAD`, at least that; where modes are float32,
    of `SINGLE_PAD`. doubles: in a vector; half as many where n is at most `narrow_up_to`."""

    @intrinsic(plain=plain_lanes.one_pass(motion, kinds))
    def one_pass(typingctx, n, *rest):
        given: tuple = rest
        if len(rest) == 1 and isinstance(rest[0], types.BaseTuple):
            given = tuple(iter(rest[0]))  # type: ignore[call-overload]

        def emit(context, builder, signature, args):
            packed = [args[0], *cgutils.unpack_tuple(builder, args[1], len(given))]
            single = given[1].dtype == types.float32

            def emit_all(width: int) -> None:
                for its_motion, its_kinds, places in _loops(motion, kinds, width):
                    its_types = types.void(*((signature.args[0], *signature.args[1])[i] for i in places))
                    code = Code(context, builder, its_types, [packed[i] for i in places], single, width)
                    _emit_pass(code, its_motion, its_kinds)

            if narrow_up_to:
                short = builder.icmp_signed("<=", args[0], ir.Constant(INT, narrow_up_to))
                with builder.if_else(short) as (then, otherwise):
                    with then:
                        emit_all(doubles // 2)
                    with otherwise:
                        emit_all(doubles)
            else:
                emit_all(doubles)
            return context.get_dummy_value()

        return types.void(types.int64, types.StarArgTuple.from_types(given)), emit

    return one_pass


#: of a finger: how it gives way, how it follows, and where it is
_HELD = types.UniTuple(types.float64, 3)
project_q = one_kind_of_pass("", "q")
project_v = one_kind_of_pass("", "v")
project_a = one_kind_of_pass("", "a")
project_qq = one_kind_of_pass("", "qq")
project_qv = one_kind_of_pass("", "qv")
project_qqq = one_kind_of_pass("", "qqq")
project_vv = one_kind_of_pass("", "vv")
coast = one_kind_of_pass("coast", "")
coast_q = one_kind_of_pass("coast", "q")
coast_v = one_kind_of_pass("coast", "v")
coast_qq = one_kind_of_pass("coast", "qq")
coast_qv = one_kind_of_pass("coast", "qv")
drive = one_kind_of_pass("drive", "")
drive_q = one_kind_of_pass("drive", "q")
drive_qq = one_kind_of_pass("drive", "qq")
drive_qv = one_kind_of_pass("drive", "qv")
drive_listed = one_kind_of_pass("drive listed", "")
drive_listed_and_one = one_kind_of_pass("drive listed and one", "")
kick = one_kind_of_pass("coast kicked", "")
kick_v = one_kind_of_pass("coast kicked", "v")
drive_kicked = one_kind_of_pass("drive kicked", "")
drive_listed_kicked = one_kind_of_pass("drive listed kicked", "")
drive_listed_and_one_kicked = one_kind_of_pass("drive listed and one kicked", "")


@intrinsic(plain=plain_lanes.press_sequence)
def press_sequence(typingctx, u, eta, response, forces):
    """Exact-hold over K steps at one contact: forces (K,) from free displacements u (K,), height and response (2K,).

    The response holds K zeros before h.
    λ_k = max(0, (η − u_k − Σ_{i<k} h_{k−i} λ_i)/h_0); written out so that only an FMA and a maximum lie between
    one step and the next.
    """

    def emit(context, builder, signature, args):
        code = Code(context, builder, signature, args)
        b = builder
        at_u, at_h, at_f = code.data(0), code.data(2), code.data(3)
        scalar_fma = cgutils.get_or_insert_function(b.module, ir.FunctionType(DOUBLE, [DOUBLE] * 3), "llvm.fma.f64")
        h = [code.scalar(at_h, BLOCK + k) for k in range(BLOCK)]
        stiffness = b.fdiv(ir.Constant(DOUBLE, 1.0), h[0])
        ratio = [b.fneg(b.fmul(x, stiffness)) for x in h]
        zero = ir.Constant(DOUBLE, 0.0)
        wanted = [b.fmul(b.fsub(args[1], code.scalar(at_u, k)), stiffness) for k in range(BLOCK)]
        for k in range(BLOCK):
            force = b.select(b.fcmp_ordered(">", wanted[k], zero), wanted[k], zero)
            b.store(force, b.gep(at_f, [ir.Constant(INT, k)]))
            for i in range(k + 1, BLOCK):
                wanted[i] = b.call(scalar_fma, [ratio[i - k], force, wanted[i]])
        return context.get_dummy_value()

    return types.void(u, types.float64, response, forces), emit


@intrinsic(plain=plain_lanes.grip_sequence)
def grip_sequence(typingctx, pull, held, y, own, pushes, true):
    """A finger alone on the string over K steps: pushes (K,), and its row `true` (K,) with them, from the free one, y (K,).

    p_k = a_k − stiff·y_k + follow·y⁺_{k−1}, y_k with the pushes before it, y⁺_k with its own too, y⁺_{−1} = here; a is
    `pull` (K,), `held` (stiff, follow, here); own (2K,) is the response of the row to itself, with K zeros before it.
    """

    def emit(context, builder, signature, args):
        code = Code(context, builder, signature, args)
        _emit_grip(code, 4, 5, None)
        return context.get_dummy_value()

    return types.void(pull, _HELD, y, own, pushes, true), emit


@intrinsic(plain=plain_lanes.grip_and_press_sequence)
def grip_and_press_sequence(typingctx, pull, held, y, own, eta, u, cross, response, pushes, true, forces):
    """`grip_sequence` over one contact, exact-hold: u (K,) its free row, eta its height, its responses to the finger
    (cross, 2K) and to itself; forces (K,) are what it gives. Its own pushes are those that leave 0 ≤ λ ⊥ u − η ≥ 0."""

    def emit(context, builder, signature, args):
        code = Code(context, builder, signature, args)
        _emit_grip(code, 8, 9, 4)
        return context.get_dummy_value()

    return types.void(pull, _HELD, y, own, types.float64, u, cross, response, pushes, true, forces), emit


def _emit_grip(code: Code, pushes: int, true: int, eta: int | None) -> None:
    """The two above, in scalars that stay in registers; numbers of the arguments of these names."""
    b = code.b
    stiff, follow, here = cgutils.unpack_tuple(b, code.args[1], 3)
    at_pull, at_y, at_own, at_pushes, at_true = (code.data(i) for i in (0, 2, 3, pushes, true))
    contact = eta is not None
    scalar_fma = cgutils.get_or_insert_function(b.module, ir.FunctionType(DOUBLE, [DOUBLE] * 3), "llvm.fma.f64")
    zero = ir.Constant(DOUBLE, 0.0)

    def fma(x, y, z):
        return b.call(scalar_fma, [x, y, z])

    def put(value, base, k: int) -> None:
        b.store(value, b.gep(base, [ir.Constant(INT, k)]))

    own = [code.scalar(at_own, BLOCK + k) for k in range(BLOCK)]
    y = [code.scalar(at_y, k) for k in range(BLOCK)]
    slack, against = b.fneg(stiff), None
    if eta is not None:
        at_u, at_cross, at_response, at_forces = (code.data(i) for i in (eta + 1, eta + 2, eta + 3, 10))
        cross = [code.scalar(at_cross, BLOCK + k) for k in range(BLOCK)]
        response = [code.scalar(at_response, BLOCK + k) for k in range(BLOCK)]
        depth = [b.fsub(code.args[eta], code.scalar(at_u, k)) for k in range(BLOCK)]
        against = b.fmul(b.fneg(cross[0]), stiff)  # what the finger gives way for one newton at the contact
        per_matrix = b.fdiv(ir.Constant(DOUBLE, 1.0), fma(against, cross[0], response[0]))
        minus_cross = [b.fneg(x) for x in cross]
        minus_response = [b.fneg(x) for x in response]
    for k in range(BLOCK):
        push = fma(follow, here, fma(slack, y[k], code.scalar(at_pull, k)))
        force = None
        if contact:
            wanted = b.fmul(fma(minus_cross[0], push, depth[k]), per_matrix)
            force = b.select(b.fcmp_ordered(">", wanted, zero), wanted, zero)
            put(force, at_forces, k)
            push = fma(against, force, push)
        put(push, at_pushes, k)
        for i in range(k, BLOCK):
            y[i] = fma(own[i - k], push, y[i])
            if contact:
                y[i] = fma(cross[i - k], force, y[i])
                depth[i] = fma(minus_response[i - k], force, fma(minus_cross[i - k], push, depth[i]))
        here = y[k]
        put(here, at_true, k)


@intrinsic(plain=plain_lanes.any_forced_below)
def any_forced_below(typingctx, y, response, forces, level):
    """Whether any of y (K,), with `add_forced`'s sum over the forces, is below `level`."""

    def emit(context, builder, signature, args):
        code = Code(context, builder, signature, args)
        limit = code.splat(args[3])
        found = ir.Constant(ir.IntType(LANES), 0)
        for first in range(0, BLOCK, LANES):
            total = _emit_forced(code, first, *(code.data(i) for i in range(3)))
            below = builder.fcmp_ordered("<", total, limit)
            found = builder.or_(found, builder.bitcast(below, ir.IntType(LANES)))
        return builder.icmp_unsigned("!=", found, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(y, response, forces, types.float64), emit


def _emit_forced(code: Code, first: int, at_y, at_h, at_f):
    """The LANES sums of `add_forced` from number `first` on."""
    chains = [code.load(at_y, ir.Constant(INT, first)), ir.Constant(VECTOR, [0.0] * LANES)]
    for i in range(min(BLOCK, first + LANES)):
        column = code.load(at_h, ir.Constant(INT, BLOCK + first - i))
        chains[i % 2] = code.fma(column, code.splat(code.scalar(at_f, i)), chains[i % 2])
    return code.b.fadd(chains[0], chains[1], flags=LOOSE)


@intrinsic(plain=plain_lanes.any_below)
def any_below(typingctx, u, level):
    """Whether any of u (K,) is below `level`."""

    def emit(context, builder, signature, args):
        code = Code(context, builder, signature, args)
        limit = code.splat(args[1])
        at = code.data(0)
        found = ir.Constant(ir.IntType(LANES), 0)
        for first in range(0, BLOCK, LANES):
            below = builder.fcmp_ordered("<", code.load(at, ir.Constant(INT, first)), limit)
            found = builder.or_(found, builder.bitcast(below, ir.IntType(LANES)))
        return builder.icmp_unsigned("!=", found, ir.Constant(ir.IntType(LANES), 0))

    return types.boolean(u, types.float64), emit


@intrinsic(plain=plain_lanes.add_forced)
def add_forced(typingctx, y, response, forces):
    """y_k += Σ_{i ≤ k} h_{k−i} λ_i for y, forces (K,) and a response (2K,) that holds K zeros before h."""

    def emit(context, builder, signature, args):
        code = Code(context, builder, signature, args)
        at_y, at_h, at_f = code.data(0), code.data(1), code.data(2)
        for first in range(0, BLOCK, LANES):
            code.store(_emit_forced(code, first, at_y, at_h, at_f), at_y, ir.Constant(INT, first))
        return context.get_dummy_value()

    return types.void(y, response, forces), emit


@intrinsic(plain=plain_lanes.add_late)
def add_late(typingctx, y, response, late, force):
    """y_k += h_{k−late} λ for k ≥ late, y (K,) and response (2K,) as for `add_forced`: one force, that of step `late`."""

    def emit(context, builder, signature, args):
        _emit_late(Code(context, builder, signature, args), [1], args[2], [args[3]])
        return context.get_dummy_value()

    return types.void(y, response, types.int64, types.float64), emit


@intrinsic(plain=plain_lanes.add_late_of_three)
def add_late_of_three(typingctx, y, first, second, third, late, forces):
    """`add_late` of three forces at once, a tuple, each with a response of its own."""

    def emit(context, builder, signature, args):
        _emit_late(Code(context, builder, signature, args), [1, 2, 3], args[4], cgutils.unpack_tuple(builder, args[5], 3))
        return context.get_dummy_value()

    return types.void(y, first, second, third, types.int64, types.UniTuple(types.float64, 3)), emit


def _emit_late(code: Code, responses: list[int], late, forces) -> None:
    """Argument 0 plus what forces of step `late` do by the responses of these arguments."""
    b = code.b
    columns = [b.gep(code.data(i), [b.sub(ir.Constant(INT, BLOCK), late)]) for i in responses]
    factors = [code.splat(force) for force in forces]
    for first in range(0, BLOCK, LANES):
        at = ir.Constant(INT, first)
        total = code.load(code.data(0), at)
        for column, factor in zip(columns, factors, strict=True):
            total = code.fma(code.load(column, at), factor, total)
        code.store(total, code.data(0), at)
