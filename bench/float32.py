"""A string whose modes are held in float32: twice the lanes, half the memory, and what that costs in accuracy.

Forces, the contact's sequence and outputs stay in float64, as do the numbers the coefficients are rounded from. The passes
are those of `synth.solver.lanes` over one contact, the blocks those of `synth.solver.blocks`: `press_blocks`, and
Moreau–Jean's in `advance_blocks`.

Rounded to float32, Φ^K keeps a mode's frequency: p12 and p21, whose product makes the angle of a slow mode, are exact to a
part ε = 2⁻²⁴. What it loses is damping: the determinant is off by some ε, the decay rate by ε/(KΔt), the more the finer the
step. `increments` holds Φ^K − 1 instead and adds what it gives to the state, in as many multiply-adds: both are right then,
but for the rounding of the state itself. A two-step form x⁺ = a x − e x⁻ would lose the frequency: its a = 2 cos θ leaves
θ² an error of ε.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic as _intrinsic

from bench.kernels import BY_NAME, Plucked, Stretch
from synth.native.arrays import aligned
from synth.solver.blocks import advance_blocks
from synth.solver.lanes import (
    ADV11,
    ADV12,
    ADV21,
    ADV22,
    BLOCK,
    KQ,
    KQ_LATE,
    KV,
    KV_LATE,
    LANES,
    MINUS_DET,
    P11,
    P12,
    P21,
    P22,
    ROWS,
    TRACE,
    add_forced,
    add_late,
    any_below,
    press_sequence,
)
from synth.solver.laws import EXACT_HOLD
from synth.solver.stringmodel import StringModel, Strung

intrinsic: Any = _intrinsic
SINGLE_LANES = 2 * LANES
_PAD = 16
_CALL = 1024  # steps
_FLOAT, _DOUBLE, _INT, _I32 = ir.FloatType(), ir.DoubleType(), ir.IntType(64), ir.IntType(32)
_VECTOR = ir.VectorType(_FLOAT, SINGLE_LANES)
_LOOSE = ("reassoc", "contract", "nsz")


class _Pass:
    """One pass over the modes; arguments n, rows (ROWS, ≥n), q, v (≥n,), then as `_emit` takes them."""

    def __init__(self, context, builder, signature, args) -> None:
        self.b, self.context, self.signature, self.args = builder, context, signature, args
        kind = ir.FunctionType(_VECTOR, [_VECTOR] * 3)
        self._fma = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{SINGLE_LANES}f32")

    def array(self, i: int):
        return self.context.make_array(self.signature.args[i])(self.context, self.b, self.args[i])

    def load(self, base, at):
        return self.b.load(self.b.bitcast(self.b.gep(base, [at]), _VECTOR.as_pointer()), align=4)

    def store(self, value, base, at) -> None:
        self.b.store(value, self.b.bitcast(self.b.gep(base, [at]), _VECTOR.as_pointer()), align=4)

    def rounded(self, base, k: int):
        """Element k of an array of doubles in all lanes."""
        value = self.b.fptrunc(self.b.load(self.b.gep(base, [ir.Constant(_INT, k)])), _FLOAT)
        one = self.b.insert_element(ir.Constant(_VECTOR, ir.Undefined), value, ir.Constant(_I32, 0))
        same = ir.Constant(ir.VectorType(_I32, SINGLE_LANES), [0] * SINGLE_LANES)
        return self.b.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), same)

    def fma(self, x, y, z):
        return self.b.call(self._fma, [x, y, z])

    def fold(self, sums):
        """LANES vectors of 2 LANES floats → one vector of their sums, doubles."""
        index = ir.VectorType(_I32, LANES)

        def taken(x, y, lanes):
            return self.b.shuffle_vector(x, y, ir.Constant(index, list(lanes)))

        sums = [
            self.b.fadd(taken(s, s, range(LANES)), taken(s, s, range(LANES, 2 * LANES)), flags=_LOOSE) for s in sums
        ]  # fmt: skip
        span = 1
        while span < LANES:
            low = [lane // (2 * span) * 2 * span + lane % span + (lane // span % 2) * LANES for lane in range(LANES)]
            sums = [
                self.b.fadd(taken(x, y, low), taken(x, y, [lane + span for lane in low]), flags=_LOOSE)
                for x, y in zip(sums[::2], sums[1::2], strict=True)
            ]
            span *= 2
        return self.b.fpext(sums[0], ir.VectorType(_DOUBLE, LANES))


def _emit(code: _Pass, motion: str, looks: str, increments: bool) -> None:
    """K steps forward ("coast", "drive" or ""), then sums over the displacements ("q") or velocities of the K steps after.

    Further arguments: for "drive" shape (≥n,) float32 and forces (K,) float64; weights (≥n,) float32, then outputs (≥K,)
    float64, of each look.
    """
    b = code.b
    rows = code.array(1)
    length = b.extract_value(rows.shape, 1)
    at = [b.gep(rows.data, [b.mul(length, ir.Constant(_INT, r))]) for r in range(ROWS)]
    at_q, at_v = code.array(2).data, code.array(3).data
    place = 6 if motion == "drive" else 4
    at_w = [code.array(place + p).data for p in range(len(looks))]
    at_out = [code.array(place + len(looks) + p).data for p in range(len(looks))]
    force = [code.rounded(code.array(5).data, k) for k in range(BLOCK)] if motion == "drive" else []
    before = b.block
    loop = b.append_basic_block("modes")
    b.branch(loop)
    b.position_at_end(loop)
    j = b.phi(_INT)
    j.add_incoming(ir.Constant(_INT, 0), before)
    sums = [[b.phi(_VECTOR) for _ in range(BLOCK)] for _ in looks]
    for s in (s for row in sums for s in row):
        s.add_incoming(ir.Constant(_VECTOR, [0.0] * SINGLE_LANES), before)

    def row(number: int):
        return code.load(at[number], j)

    x, y = code.load(at_q, j), code.load(at_v, j)
    trace, minus_det = (row(TRACE), row(MINUS_DET)) if looks or force else (None, None)
    if motion:
        pairs = ((ADV11, ADV12, x, y), (ADV22, ADV21, y, x))
        if increments:
            ahead = [code.fma(row(own), a, code.fma(row(cross), o, a)) for own, cross, a, o in pairs]
        else:
            ahead = [code.fma(row(own), a, b.fmul(row(cross), o)) for own, cross, a, o in pairs]
        if force:
            older, newer = force[0], code.fma(trace, force[0], force[1])
            for k in range(2, BLOCK):
                older, newer = newer, code.fma(trace, newer, code.fma(minus_det, older, force[k]))
            shape = code.load(code.array(4).data, j)
            older, newer = b.fmul(shape, older), b.fmul(shape, newer)
            for i, (early, late) in enumerate(((KQ, KQ_LATE), (KV, KV_LATE))):
                ahead[i] = code.fma(row(early), newer, code.fma(row(late), older, ahead[i]))
        x, y = ahead
        code.store(x, at_q, j)
        code.store(y, at_v, j)
    new: list[list] = [[] for _ in looks]
    if looks:
        w = [code.load(a, j) for a in at_w]
        first = {"q": (x, P11, P12), "v": (y, P21, P22)}
        chains = {k: [first[k][0], code.fma(row(first[k][1]), x, b.fmul(row(first[k][2]), y))] for k in set(looks)}
        for k in range(BLOCK):
            for p, kind in enumerate(looks):
                new[p].append(code.fma(w[p], chains[kind][1], sums[p][k]))
            for kind, (older, newer) in chains.items():
                chains[kind] = [newer, code.fma(trace, newer, b.fmul(minus_det, older))]
    after = b.add(j, ir.Constant(_INT, SINGLE_LANES))
    j.add_incoming(after, b.block)
    for s, r in zip((s for row in sums for s in row), (r for row in new for r in row), strict=True):
        s.add_incoming(r, b.block)
    done = b.append_basic_block("passed")
    b.cbranch(b.icmp_signed("<", after, code.args[0]), loop, done)
    b.position_at_end(done)
    for out, result in zip(at_out, new, strict=True):
        for first in range(0, BLOCK, LANES):
            total = code.fold(result[first : first + LANES])
            where = b.bitcast(b.gep(out, [ir.Constant(_INT, first)]), total.type.as_pointer())
            b.store(total, where, align=8)


def _pass(motion: str, looks: str, increments: bool = False):
    @intrinsic
    def one_pass(typingctx, n, *rest):
        given: tuple = tuple(iter(rest[0])) if len(rest) == 1 and isinstance(rest[0], types.BaseTuple) else rest

        def emit(context, builder, signature, args):
            flat = types.void(signature.args[0], *signature.args[1])
            unpacked = cgutils.unpack_tuple(builder, args[1], len(given))
            _emit(_Pass(context, builder, flat, [args[0], *unpacked]), motion, looks, increments)
            return context.get_dummy_value()

        return types.void(types.int64, types.StarArgTuple.from_types(given)), emit

    return one_pass


def _make_kernels(increments: bool):
    """(fly, press, strike): free flight, exact-hold and Moreau–Jean (printed, e = 0) over one contact, with one output."""
    project_q, project_qq, project_vq = (_pass("", looks) for looks in ("q", "qq", "vq"))
    coast_q, coast_qq, coast_vq = (_pass("coast", looks, increments) for looks in ("q", "qq", "vq"))
    drive = _pass("drive", "", increments)

    @njit(nogil=True)
    def fly(blocks, n, rows, q, v, weight, out):
        project_q(n, rows, q, v, weight, out)
        for t in range(1, blocks):
            coast_q(n, rows, q, v, weight, out[t * BLOCK :])
        coast_q(n, rows, q, v, weight, np.empty(BLOCK))

    @njit(nogil=True)
    def press(blocks, n, rows, shape, eta, lags, q, v, weight, out_lags, out, u, forces):
        flown = True
        for t in range(blocks):
            here = out[t * BLOCK :]
            if flown:
                project_qq(n, rows, q, v, shape, weight, u, here)
            else:
                coast_qq(n, rows, q, v, shape, weight, u, here)
            flown = any_below(u, eta)
            if flown:
                press_sequence(u, eta, lags, forces)
                add_forced(here, out_lags, forces)
                drive(n, rows, q, v, shape, forces)
        if not flown:
            coast_q(n, rows, q, v, weight, u)

    @njit(nogil=True)
    def strike(blocks, n, rows, shape, eta, lags, q, v, weight, out_lags, out, u, forces, dt, here):
        flown = True
        for t in range(blocks):
            of_output = out[t * BLOCK :]
            if flown:
                project_vq(n, rows, q, v, shape, weight, u, of_output)
            else:
                coast_vq(n, rows, q, v, shape, weight, u, of_output)
            flown = False
            for k in range(BLOCK):
                forces[k] = 0.0
                if here <= eta and u[k] < 0.0:
                    flown = True
                    forces[k] = -u[k] / lags[BLOCK]
                    add_late(u, lags, k, forces[k])
                here += dt * u[k]
            if flown:
                add_forced(of_output, out_lags, forces)
                drive(n, rows, q, v, shape, forces)
        if not flown:
            coast_q(n, rows, q, v, weight, u)

    return fly, press, strike


KERNELS = {"plain": _make_kernels(False), "increments": _make_kernels(True)}


def _singles(a: np.ndarray, n: int) -> np.ndarray:
    """An aligned float32 copy of (…, N), zeros up to n."""
    out = aligned(math.prod(a.shape[:-1]) * n // 2).view(np.float32).reshape(*a.shape[:-1], n)
    out[..., : a.shape[-1]] = a
    return out


class Single(NamedTuple):
    """A block of one string in float32."""

    block: StringModel
    form: str
    rows: np.ndarray  # (ROWS, n) float32
    shape: np.ndarray  # (n,) float32
    weight: np.ndarray


def single_of(plucked: Plucked, form: str) -> Single:
    """`form` names one of `KERNELS`."""
    m = plucked.model
    block = m.string
    n = (m.omega.size + _PAD - 1) // _PAD * _PAD
    rows = block.rows[:, : m.omega.size].copy()
    if form == "increments":
        rows[[ADV11, ADV22]] -= 1.0
    contact = block.shapes[0] if block.shapes.shape[0] else np.zeros(n)
    shape, weight = (_singles(a[: m.omega.size], n) for a in (contact, block.weights[0]))
    return Single(block, form, _singles(rows, n), shape, weight)


def stretch(plucked: Plucked, steps: int, form: str, flies: bool = False) -> tuple[Stretch, np.ndarray]:
    """All `steps`, a multiple of K, of a string over its contact, or flying free; with the displacements, (steps,)."""
    m, q0, v0 = plucked
    single, size = single_of(plucked, form), q0.size
    n = single.weight.size
    q, v, out = _singles(q0, n), _singles(v0, n), aligned(steps)
    u, forces, (fly, press, strike) = aligned(BLOCK), aligned(BLOCK), KERNELS[form]
    block = single.block

    def reset() -> None:
        q[:size], v[:size] = q0, v0

    def take() -> None:
        if flies:
            fly(steps // BLOCK, n, single.rows, q, v, single.weight, out)
            return
        given = (
            steps // BLOCK, n, single.rows, single.shape, m.eta[0], block.lags[0, 0], q, v, single.weight,
            block.out_lags[0, 0], out, u, forces,
        )  # fmt: skip
        if m.law == EXACT_HOLD:
            press(*given)
        else:
            strike(*given, m.dt, float(m.shapes[0] @ q0))

    return Stretch(take, reset, q, v), out


def in_double(plucked: Plucked, steps: int) -> np.ndarray:
    """What `stretch` plays over its contact, in float64: displacements (steps,)."""
    m, q0, v0 = plucked
    string = Strung(m.string._replace(certified=0), q0, v0, _CALL)
    out = np.zeros(steps)
    for first in range(0, steps, _CALL):
        here = min(_CALL, steps - first)
        advance_blocks(*string.addresses, here // BLOCK, here)
        out[first : first + here] = string.out(here)[0]
    return out


def misfit(plucked: Plucked, form: str) -> tuple[np.ndarray, np.ndarray]:
    """Φ^K rounded to float32: cents by which it detunes each mode, 1/s by which it changes its decay rate, (N,) both."""
    one = np.moveaxis(plucked.model.coef[:4].reshape(2, 2, -1), -1, 0)
    base = np.eye(2) if form == "increments" else np.zeros((2, 2))
    whole = np.linalg.matrix_power(one, BLOCK)
    rounded = (whole - base).astype(np.float32).astype(np.float64) + base
    step, angle, off = (np.abs(np.angle(np.linalg.eigvals(phi))).max(axis=-1) for phi in (one, whole, rounded))
    cents = 1200.0 * np.log2(1.0 + (off - angle) / (BLOCK * step))
    lost = np.log(np.linalg.det(whole) / np.linalg.det(rounded)) / (2.0 * BLOCK * plucked.model.dt)
    return cents, lost


def two_step_misfit(plucked: Plucked) -> np.ndarray:
    """Cents (N,) by which a mode is detuned when trace and determinant of a step are rounded; −∞: it swings no more."""
    p11, p12, p21, p22 = plucked.model.coef[:4]
    exact = (p11 + p22, p11 * p22 - p12 * p21)
    rounded = [a.astype(np.float32).astype(np.float64) for a in exact]
    angle, off = (np.arccos(np.clip(0.5 * trace / np.sqrt(det), -1.0, 1.0)) for trace, det in (exact, rounded))
    with np.errstate(divide="ignore"):
        return 1200.0 * np.log2(off / angle)


def drift(plucked: Plucked, seconds: float, form: str) -> float:
    """Cents by which free flight over so many seconds leaves any mode not yet below e⁻³⁰ from the float64 run's."""
    m = plucked.model
    steps = BLOCK * round(seconds / m.dt / BLOCK)
    single, _ = stretch(plucked, steps, form, flies=True)
    double = BY_NAME["fly_blocks"].on(plucked, steps)
    heard = np.flatnonzero(m.sigma * seconds < 30.0)
    phases = []
    for one in (single, double):
        one.call()
        phases.append(one.q[heard] + 1j * one.v[heard] / m.omega[heard])
    turned = np.angle(phases[0] / phases[1])
    return float(1200.0 / np.log(2.0) * np.abs(turned / (m.omega[heard] * steps * m.dt)).max())
