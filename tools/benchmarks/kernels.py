"""The kernels that are measured, one line each in `KERNELS`, and the string they work on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import njit
from speed_error.grid import BASE_HZ, E0, WITHOUT_R, Run

from benchmarks.count import fma_per_mode_step
from synth.native.arrays import aligned
from synth.physics.modes import modal_frequencies
from synth.solver.block_rows import BLOCK
from synth.solver.blocks import advance_blocks, fly_blocks, press_blocks
from synth.solver.certificates import forget
from synth.solver.driver import Model
from synth.solver.stepwise import advance_free, one_by_one
from synth.solver.stringmodel import Strung, place_contacts
from tests.oracles.plain import advance_one

MODES = (25, 50, 137, 300, 1001)
CONTACTS = (0, 1, 20)
HOLD = "exact-hold"
SCHEMES = (HOLD, "moreau-jean", "moreau-jean-filtered")


class Setting(NamedTuple):
    """What a kernel is measured on."""

    scheme: str
    modes: int
    contacts: int


class Stretch(NamedTuple):
    """Some steps of one string: `reset` puts its state back to the pluck, `call` takes all the steps.

    q, v (≥N,) is the state itself; what lies behind the N-th mode is the kernel's own.
    """

    call: Callable[[], object]
    reset: Callable[[], None]
    q: np.ndarray
    v: np.ndarray


class Plucked(NamedTuple):
    """A string with one output, and its state when it is let go."""

    model: Model
    q: np.ndarray
    v: np.ndarray


@cache
def string(setting: Setting) -> Plucked:
    """The tanpura over one point, the bass over more of its frets.

    The internal rate is the least multiple of 44.1 kHz at which all modes lie below half of it.
    """
    case = "tanpura" if setting.contacts <= 1 else "bass"
    table = WITHOUT_R if setting.scheme == HOLD else E0
    low = Run(case, setting.scheme, 1, 1, table).scene(0.01, 1).string
    factor = math.ceil(float(modal_frequencies(low, setting.modes)[-1]) / math.pi / BASE_HZ)
    scene = Run(case, setting.scheme, factor, setting.modes, table).scene(0.01, 1)
    m = scene.model
    shapes, eta, *_ = m.under
    some = np.unique(np.linspace(0, eta.size - 1, setting.contacts).round().astype(int))
    if some.size != setting.contacts:
        raise ValueError(f"the case {case} has {eta.size} contacts, {setting.contacts} are wanted")
    fewer = m.but(shapes=shapes[some], eta=eta[some], residual=np.zeros((some.size, some.size)), layers=None)
    return Plucked(fewer, *scene.initial())


def steps_of(setting: Setting, short: bool) -> int:
    """Steps of one round, a multiple of 64: some milliseconds' worth, and over contacts two periods (short: one)."""
    plucked = string(setting)
    work = (8e6 if short else 24e6) / (setting.modes * fma_per_mode_step(setting.contacts + 1))
    periods = (1 if short else 2) * 2.0 * math.pi / plucked.model.modes.omega[0] / plucked.model.string.dt
    return 64 * math.ceil(max(work, periods if setting.contacts else 0.0) / 64.0)


def _with_state(plucked: Plucked, take: Callable[[Model, np.ndarray, np.ndarray], object], modes: int = 0) -> Stretch:
    """The state's arrays are as long as `modes`, aligned, where that is more than there are."""
    model, q0, v0 = plucked
    n = q0.size
    q, v = aligned(max(n, modes)), aligned(max(n, modes))

    def reset() -> None:
        q[:n], v[:n] = q0, v0

    reset()
    return Stretch(lambda: take(model, q, v), reset, q, v)


def coefficients_of(model: Model) -> np.ndarray:
    """(6, N)"""
    return np.ascontiguousarray(model.string.rows[:6, : model.string.modes])


def _free(plucked: Plucked, steps: int) -> Stretch:
    out, none, coef = np.zeros(steps), np.zeros(0), coefficients_of(plucked.model)

    def take(m: Model, q: np.ndarray, v: np.ndarray) -> None:
        advance_free(steps, coef, q, v, m.out_shapes[0], m.out_shapes[0], 1, 0, out, none)

    return _with_state(plucked, take)


def _one(plucked: Plucked, steps: int) -> Stretch:
    out, none, coef = np.zeros(steps), np.zeros(0), coefficients_of(plucked.model)

    def take(m: Model, q: np.ndarray, v: np.ndarray) -> None:
        shape, eta, g = m.under.shapes[0], m.under.eta[0], m.string.contacts.matrix[0, 0]
        advance_one(steps, coef, shape, eta, g, q, v, m.out_shapes[0], m.out_shapes[0], 1, 0, out, none)

    return _with_state(plucked, take)


def _strung(plucked: Plucked, steps: int, certified: bool = False) -> tuple[Strung, Callable[[], None]]:
    """The string with its one output, and what puts it back to the pluck."""
    model, q0, v0 = plucked
    string = Strung(model.string._replace(certified=int(certified)), q0, v0, steps)

    def reset() -> None:
        string.q[:], string.v[:] = q0, v0

    return string, reset


def _any(plucked: Plucked, steps: int) -> Stretch:
    string, reset = _strung(plucked, steps)
    model, state, scratch = string.addresses

    def take() -> None:
        place_contacts(model, state, string.model.modes)
        string.state.force[:] = 0.0
        one_by_one(model, state, scratch, 0, 0, steps)

    return Stretch(take, reset, string.q, string.v)


@njit(nogil=True)
def _naive_loop(steps, coef, shape, eta, g, touches, q, v, weights, out):
    """Exact-hold as one writes it down: mode after mode, no licence to reorder sums."""
    for t in range(steps):
        u = 0.0
        for j in range(q.size):
            a = coef[0, j] * q[j] + coef[1, j] * v[j]
            b = coef[2, j] * q[j] + coef[3, j] * v[j]
            q[j] = a
            v[j] = b
            if touches:
                u += shape[j] * a
        if touches and u < eta:
            force = (eta - u) / g
            for j in range(q.size):
                q[j] += coef[4, j] * shape[j] * force
                v[j] += coef[5, j] * shape[j] * force
        y = 0.0
        for j in range(q.size):
            y += weights[j] * q[j]
        out[t] = y


def _naive(plucked: Plucked, steps: int) -> Stretch:
    out, coef = np.zeros(steps), coefficients_of(plucked.model)
    touches = plucked.model.under.eta.size == 1

    def take(m: Model, q: np.ndarray, v: np.ndarray) -> None:
        shape, eta, g = m.out_shapes[0], 0.0, 1.0
        if touches:
            shape, eta, g = m.under.shapes[0], m.under.eta[0], m.string.contacts.matrix[0, 0]
        _naive_loop(steps, coef, shape, eta, g, touches, q, v, m.out_shapes[0], out)

    return _with_state(plucked, take)


def _fly_blocks(plucked: Plucked, steps: int) -> Stretch:
    string, reset = _strung(plucked, steps)
    model, state, out = string.model, string.state, string.out(steps)

    def take() -> None:
        fly_blocks(steps // BLOCK, model.rows.shape[1], model.rows, state.q, state.v, model.outputs.weights, 1, out)

    return Stretch(take, reset, string.q, string.v)


def _press_blocks(plucked: Plucked, steps: int) -> Stretch:
    string, reset = _strung(plucked, steps)
    addresses = string.addresses
    return Stretch(lambda: press_blocks(*addresses, steps // BLOCK, steps), reset, string.q, string.v)


def _advance_blocks(certified: bool) -> Callable[[Plucked, int], Stretch]:
    def make(plucked: Plucked, steps: int) -> Stretch:
        string, reset = _strung(plucked, steps, certified)
        model, state, scratch = string.addresses

        def take() -> None:
            place_contacts(model, state, string.model.rows.shape[1])
            forget(state)
            advance_blocks(model, state, scratch, steps // BLOCK, steps)

        return Stretch(take, reset, string.q, string.v)

    return make


@dataclass(frozen=True)
class Kernel:
    """A kernel of the table.

    on         (string, steps, a multiple of 64) → Stretch
    takes      whether it can do a setting
    plain      name of the one-step loop that it is compared with; empty for those that are one
    looks_at_all    False: passes contacts over that a certificate says are out of reach, so that its work is not counted
    Projections are the contacts, all of them looked at in every step, and one output. A new kernel is one line of `KERNELS`;
    `tests/test_bench.py` holds that those of a setting do the same.
    """

    name: str
    on: Callable[[Plucked, int], Stretch]
    takes: Callable[[Setting], bool]
    plain: str = ""
    looks_at_all: bool = True

    def make(self, setting: Setting, steps: int) -> Stretch:
        """`on` the string of a setting."""
        return self.on(string(setting), steps)

    def fma(self, setting: Setting) -> int:
        """Multiply-adds of one mode-step."""
        return fma_per_mode_step(setting.contacts + 1)


def _hold_over(*contacts: int) -> Callable[[Setting], bool]:
    return lambda setting: setting.scheme == HOLD and setting.contacts in contacts


def _any_contacts(setting: Setting) -> bool:
    return setting.contacts > 0 or setting.scheme == HOLD


KERNELS = (
    Kernel("naive loop", _naive, _hold_over(0, 1)),
    Kernel("advance_free", _free, _hold_over(0)),
    Kernel("advance_one", _one, _hold_over(1)),
    Kernel("advance", _any, _any_contacts),
    Kernel("fly_blocks", _fly_blocks, _hold_over(0), "advance_free"),
    Kernel("press_blocks", _press_blocks, _hold_over(1), "advance_one"),
    Kernel("advance_blocks", _advance_blocks(False), _any_contacts, "advance"),
    Kernel("advance_blocks, certified", _advance_blocks(True), _hold_over(20), "advance", looks_at_all=False),
)
BY_NAME = {kernel.name: kernel for kernel in KERNELS}
#: kernels that take several steps at once
BLOCKS = tuple(kernel for kernel in KERNELS if kernel.plain)
#: kernel, string: what is measured against the peak
GRID = tuple(
    (kernel, Setting(scheme, modes, contacts))
    for kernel in KERNELS
    for scheme in SCHEMES
    for contacts in CONTACTS
    for modes in MODES
    if kernel.takes(Setting(scheme, modes, contacts))
)
