"""Lines, bridge and body as the kernels of `frames` have them, made from plain arrays: where Python advances them itself.

The engine keeps pools of such arrays of its own (`engine.bridges`). Here a line may become another (a bend, another fret)
at any frame, and its state goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from synth.native.arrays import aligned, allocate
from synth.native.views import table
from synth.solver import coupling
from synth.solver.block_rows import BLOCK
from synth.solver.coupled_body import coupled_body, in_components
from synth.solver.fingers import fill_grip
from synth.solver.lanes import padded
from synth.solver.laws import EXACT_HOLD, coefficients
from synth.solver.line_tables import fill_apart, fill_finger_end, fill_looked_at
from synth.solver.responses import make_rows, padded_rows
from synth.solver.stepwise import LEAST_STIFFNESS
from synth.solver.stringmodel import (
    MOVING,
    StringContacts,
    StringModes,
    StringOutputs,
    StringState,
    make_scratch,
    make_string,
    state_sizes,
)


class LineArrays(NamedTuple):
    """A line of N modes over C contacts as it now is."""

    length_m: float
    stiffness: float  # T/L [N/m]
    mu: float  # [kg/m]
    omega: np.ndarray  # (N,)
    sigma: np.ndarray  # (N,)
    ramp: np.ndarray  # c (N,)
    direction: np.ndarray  # B (D,)
    shapes: np.ndarray  # S (C, N)
    leverage: np.ndarray  # ξ (C,)
    eta: np.ndarray  # (C,) [m]
    residual: np.ndarray  # R (C, C)
    keeps_mass: bool = True  # whether the modes left out move with the bridge as a mass
    layers: np.ndarray | None = None  # (3, C) in front of its contacts, `layers`


class BodyArrays(NamedTuple):
    """M modes of a body that move the bridge in D components."""

    omega: np.ndarray  # (M,)
    sigma: np.ndarray  # (M,)
    mass: np.ndarray  # (M,)
    shapes: np.ndarray  # Ψ (D, M)
    radiation: np.ndarray  # (channels, M), output of an acceleration
    struck: np.ndarray | None = None  # (M,) what 1 N of a hand for a frame changes their velocities by; none: 0


class CoupledLines:
    """Lines on a body over frames of frame_s [s], line k in steps[k] steps a frame; at rest at first.

    coupling, models, states, ends   the kernels' arrays; `address` and `scratch` are what kernels take
    """

    def __init__(
        self,
        lines: Sequence[LineArrays],
        body: BodyArrays,
        frame_s: float,
        steps: Sequence[int],
        *,
        most_modes: Sequence[int] | None = None,
        path: int = 1,
        culled_from: int = coupling.CULLED_FROM,
        knocks: int = 1,
    ) -> None:
        """most_modes: of each line at any time, those it has now unless said; path: numbers that End.path takes;
        culled_from: contacts of a line from which on some may be passed over; knocks: frames in which a hand may push."""
        self._path = path
        self.steps = [int(count) for count in steps]
        self._frame_s = frame_s
        modes = [max(1, line.omega.size) for line in lines] if most_modes is None else [int(n) for n in most_modes]
        contacts = [line.eta.size for line in lines]
        rows = [line.eta.size * (1 if line.layers is None else 2) for line in lines]  # a layer and what is behind it
        self.states = [allocate(StringState, state_sizes(n, count, 1)) for n, count in zip(modes, contacts, strict=True)]
        self._modes = modes
        hold = coefficients(EXACT_HOLD, body.omega, body.sigma, 1.0, frame_s)
        hold[4:] /= body.mass
        struck = np.zeros_like(body.omega) if body.struck is None else body.struck
        sizes = coupling.COUPLING_SIZES | {"lines": len(lines), "rows": sum(rows) + len(lines), "stretches": 1}
        directions = in_components(np.array([line.direction for line in lines]), 1)
        self.coupling = allocate(
            coupling.Coupling,
            sizes,
            frame=frame_s,
            single=0,
            culled_from=culled_from,
            lines=allocate(coupling.BridgeLines, sizes, steps=np.array(self.steps, np.int64), direction=directions),
            body=coupled_body(hold, body.shapes, body.radiation, body.mass, body.omega, struck, knocks),
        )
        self._scratch = make_scratch(max(rows, default=0), max(modes), 1, BLOCK)
        self._kept = [table(state) for state in self.states]
        self._table, self._scratch_table = table(self.coupling), table(self._scratch)
        self.models: list = [None] * len(lines)
        self.ends: list = [None] * len(lines)
        self._tables: list = [None] * len(lines)
        for k, line in enumerate(lines):
            self.coupling.lines.state[k] = self._kept[k].ctypes.data
            self.states[k].certificates.looked[:] = 1
            self.states[k].certificates.renewed[:] = -1
            self.set_line(k, line, gather=False)
            self.states[k].counts[MOVING] = line.omega.size
        coupling.gather_lines(self.address)

    @property
    def address(self) -> int:
        return int(self._table.ctypes.data)

    @property
    def scratch(self) -> int:
        return int(self._scratch_table.ctypes.data)

    def set_line(self, k: int, line: LineArrays, gather: bool = True) -> None:
        """Line k is this from now on; heights, q, v and forces of its state are the caller's. With contacts it is looked at.

        gather: whether the bridge is told at once; else `coupling.gather_lines` once all is as it is to be.
        """
        n, c, mu = line.omega.size, line.ramp, line.mu
        step = self._frame_s / self.steps[k]
        coef = coefficients(EXACT_HOLD, line.omega, line.sigma, mu, step)
        pull = mu * c
        model = make_string(
            EXACT_HOLD,
            step,
            StringModes(mu, line.omega, line.sigma),
            coef,
            StringContacts(line.shapes, line.eta, line.residual, line.layers),
            StringOutputs(pull[None, :], on_q=0),
        )
        size, contacts = padded(n), line.eta.size
        leverage = aligned(contacts)
        leverage[:] = line.leverage
        end = allocate(
            coupling.End,
            coupling.COUPLING_SIZES | {"modes": size, "singles": 0, "contacts": contacts, "path": self._path},
            kick=padded_rows(-c, size),
            pull=padded_rows(pull, size),
            flight=make_rows(coefficients(EXACT_HOLD, line.omega, line.sigma, mu, self._frame_s)),
            leverage=leverage,
        )
        # the mass of the modes left out is μ (LENGTH/3 − Σc²)
        end.numbers[coupling.TENSION] = line.stiffness
        end.numbers[coupling.LENGTH] = line.length_m if line.keeps_mass else 3.0 * float(c @ c)
        most = coupling.most_of_contacts(line.omega, c, line.shapes, line.leverage)
        end.numbers[[coupling.KICK_REACH, coupling.LARGEST_LEVERAGE, coupling.LARGEST_SHAPE]] = most
        end.counts[coupling.APART_MODES] = n
        end.counts[coupling.ENGAGED] = int(contacts > 0 or self.states[k].finger[0]["on"] != 0)
        if self.ends[k] is not None:
            end.path[:] = self.ends[k].path
            end.numbers[coupling.FINGER_LEVERAGE] = self.ends[k].numbers[coupling.FINGER_LEVERAGE]
        tables = (table(model), table(end))
        model_at, end_at = (int(each.ctypes.data) for each in tables)
        room = (aligned(size), aligned(size), aligned((3, BLOCK)))
        fill_apart(end_at, *room)
        fill_looked_at(model_at, end_at, *room)
        self.models[k], self.ends[k], self._tables[k] = model, end, tables
        self.coupling.lines.model[k], self.coupling.lines.end[k] = model_at, end_at
        self.states[k].eta[:] = line.eta
        self.states[k].counts[MOVING] = n
        if self.states[k].finger[0]["on"]:
            self._fill_finger(k)
        if gather:
            self.gather()

    def gather(self) -> None:
        """What the bridge sees of its lines, after any of them has become another."""
        coupling.gather_lines(self.address)

    def hold(self, k: int, weights: np.ndarray, leverage: float, stiffness: float, resistance: float) -> float:
        """A finger takes hold of line k by weights (N,) where it now is; returns its displacement there, ξ b with it [m]."""
        state, n = self.states[k], weights.size
        state.grip.weights[:] = 0.0
        state.grip.weights[:n] = weights
        self.ends[k].numbers[coupling.FINGER_LEVERAGE] = leverage
        here = float(weights @ state.q[:n]) + leverage * float(self.coupling.lines.direction[k] @ self.coupling.bridge.beta)
        finger = state.finger[0]
        finger["on"], finger["stiffness"], finger["resistance"] = 1, stiffness, resistance
        finger["here"], finger["push"] = here, 0.0
        self._fill_finger(k)
        self.ends[k].counts[coupling.ENGAGED] = 1
        self.gather()
        return here

    def soften(self, k: int) -> float:
        """The finger on line k holds it by `LEAST_STIFFNESS` alone from now on; returns its force in the last step [N]."""
        finger = self.states[k].finger[0]
        finger["stiffness"], finger["resistance"] = LEAST_STIFFNESS, 0.0
        return float(finger["push"])

    def _fill_finger(self, k: int) -> None:
        model_at, end_at = (int(each.ctypes.data) for each in self._tables[k])
        state_at, size = int(self._kept[k].ctypes.data), padded(self._modes[k])
        fill_grip(model_at, state_at, self.scratch, 0)
        fill_finger_end(model_at, state_at, end_at, self.steps[k], aligned(size), aligned(size), aligned((3, BLOCK)))

    def let_go(self, k: int) -> None:
        """The finger leaves line k."""
        self.states[k].finger[0]["on"] = 0
        self.ends[k].counts[coupling.ENGAGED] = int(self.models[k].contacts.size > 0)
        self.gather()

    def place(self, p: np.ndarray, p_speed: np.ndarray) -> None:
        """The body's modes are so, and the bridge with them, its mean motion as fast as they are."""
        body = self.coupling
        modes = p.size
        body.body.motion.p[:modes], body.body.motion.speed[:modes] = p, p_speed
        body.bridge.beta[:] = body.body.shape @ body.body.motion.p
        body.bridge.speed[:] = 0.0
        body.bridge.rest[:] = body.body.shape @ body.body.motion.speed
        self.gather()
