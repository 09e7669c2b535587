"""A `CoupledStrings` of the physics as the kernels of `solver.frames` have it, for tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from synth.native.arrays import aligned, allocate
from synth.native.views import table
from synth.physics.coupled import CoupledStrings, Place
from synth.physics.modes import mode_shapes
from synth.solver import coupling
from synth.solver.frames import advance_frames
from synth.solver.lanes import BLOCK, padded
from synth.solver.laws import EXACT_HOLD, coefficients
from synth.solver.line_certificates import certify_line, fill_reach
from synth.solver.responses import make_rows, padded_rows
from synth.solver.stringmodel import make_scratch, make_state, make_string


class Kernel:
    """Lines, bridge and body of a system over frames of frame_s [s] in `steps` steps, contacts at `places`.

    steps_of: of each line, where they differ. engaged: whether contacts are looked at from the start, or only where they are
    not certified.
    """

    def __init__(
        self,
        system: CoupledStrings,
        frame_s: float,
        steps: int = 1,
        places: Sequence[Place] = (),
        heights_m: Sequence[float] = (),
        residual: np.ndarray | None = None,
        *,
        engaged: bool = True,
        look_at_all: bool = False,
        steps_of: Sequence[int] | None = None,
    ) -> None:
        self.system, self.engaged = system, engaged
        body = system.body
        count = len(places)
        residual = np.zeros((count, count)) if residual is None else np.asarray(residual)
        self.mine = [[c for c, place in enumerate(places) if place.line == k] for k in range(len(system.lines))]
        self.models, self.states, self.ends, self._kept = [], [], [], []
        each = [steps] * len(system.lines) if steps_of is None else steps_of
        for line, mine, own_steps in zip(system.lines, self.mine, each, strict=True):
            step = frame_s / own_steps
            n, mu, c = line.omega.size, line.linear_density_kg_m, line.ramp
            where = np.array([places[i].position_m for i in mine])
            shapes = mode_shapes(line.length_m, where, n).reshape(len(mine), n) if mine else np.zeros((0, n))
            eta = np.array([heights_m[i] for i in mine], dtype=float)
            own = residual[np.ix_(mine, mine)]
            coef = coefficients(EXACT_HOLD, line.omega, line.sigma, mu, step)
            model = make_string(
                EXACT_HOLD, step, mu, line.omega, line.sigma, coef, shapes, eta, own, (mu * c)[None, :], on_q=0
            )
            state = make_state(model, np.zeros(n), np.zeros(n))
            size = padded(n)
            leverage = aligned(len(mine))
            leverage[:] = [places[i].position_m / line.length_m - places[i].rides for i in mine]
            end = allocate(
                coupling.End,
                coupling.COUPLING_SIZES | {"modes": size, "contacts": len(mine), "path": 1},
                kick=padded_rows(-c, size),
                pull=padded_rows(mu * c, size),
                flight=make_rows(coefficients(EXACT_HOLD, line.omega, line.sigma, mu, frame_s)),
                leverage=leverage,
            )
            mass = line.length_m if line.keeps_mass else 3.0 * float(c @ c)
            end.numbers[coupling.TENSION], end.numbers[coupling.LENGTH] = line.stiffness, mass
            end.counts[coupling.APART_MODES] = n
            end.counts[coupling.ENGAGED] = int(look_at_all or (engaged and bool(mine)))
            addresses = [table(model), table(state), table(end)]
            coupling.fill_end(
                *(each.ctypes.data for each in (addresses[0], addresses[2])),
                own_steps,
                aligned(size),
                aligned(size),
                aligned((3, BLOCK)),
            )
            fill_reach(addresses[0].ctypes.data, addresses[2].ctypes.data)
            self.models.append(model)
            self.states.append(state)
            self.ends.append(end)
            self._kept.append(addresses)
        modes = len(body.modes)
        hold = coefficients(EXACT_HOLD, body.omega, body.sigma, 1.0, frame_s)
        hold[4:] /= body.mass
        shape = np.ascontiguousarray(body.shapes)
        extents = {"lines": len(self.models), "components": body.axes, "body": modes, "channels": 1, "rows": count + 1}
        self.coupling = allocate(
            coupling.Coupling,
            coupling.COUPLING_SIZES | extents,
            frame=frame_s,
            steps=np.array(each, np.int64),
            line_model=np.array([each[0].ctypes.data for each in self._kept]),
            line_state=np.array([each[1].ctypes.data for each in self._kept]),
            line_end=np.array([each[2].ctypes.data for each in self._kept]),
            direction=np.ascontiguousarray([line.direction for line in system.lines]),
            body=np.ascontiguousarray(hold),
            shape=shape,
            gamma=np.ascontiguousarray((shape * hold[4]) @ shape.T),
            radiation=np.ones((1, modes)),
            body_mass=np.ascontiguousarray(body.mass),
            body_omega=np.ascontiguousarray(body.omega),
        )
        self._table = table(self.coupling)
        most = max((len(mine) for mine in self.mine), default=0)
        self._scratch = make_scratch(most, max(line.omega.size for line in system.lines), 1, BLOCK)
        self._scratch_table = table(self._scratch)

    @property
    def address(self) -> int:
        return int(self._table.ctypes.data)

    def start(self, x: np.ndarray) -> None:
        """From x (n,) as `coupled` lays it out, with the speed of the bridge that goes with it."""
        w, rates, p, v = self.system.parts()
        body = self.coupling
        body.p[:], body.p_speed[:] = x[p], x[v]
        body.beta[:] = self.system.body.shapes @ x[p]
        body.speed[:] = 0.0
        body.rest[:] = self.system.body.shapes @ x[v]
        for state, of_w, of_rates in zip(self.states, w, rates, strict=True):
            n = of_w.stop - of_w.start
            state.q[:n], state.v[:n] = x[of_w], x[of_rates]
        coupling.gather_lines(self.address)
        if not self.engaged:
            for line, mine in enumerate(self.mine):
                if mine:
                    near = certify_line(self.address, line, self._scratch_table.ctypes.data)
                    self.ends[line].counts[coupling.ENGAGED] = int(near > 0)
            coupling.gather_lines(self.address)

    def advance(self, frames: int) -> np.ndarray:
        """(frames,) what the body radiates."""
        out = np.zeros((1, frames))
        assert advance_frames(self.address, self._scratch_table.ctypes.data, frames, out) == 0
        return out[0]

    @property
    def x(self) -> np.ndarray:
        """(n,) as `coupled` lays it out."""
        w, rates, p, v = self.system.parts()
        x = np.zeros(self.system.size)
        for line, (state, end) in enumerate(zip(self.states, self.ends, strict=True)):
            n = w[line].stop - w[line].start
            x[w[line]] = state.q[:n]
            x[rates[line]] = state.v[:n] - end.kick[:n] * (self.coupling.direction[line] @ self.coupling.speed)
        x[p], x[v] = self.coupling.p, self.coupling.p_speed
        return x

    @property
    def force(self) -> np.ndarray:
        """(C,) of the last step [N]."""
        out = np.zeros(sum(len(mine) for mine in self.mine))
        for state, mine in zip(self.states, self.mine, strict=True):
            out[mine] = state.force[: len(mine)]
        return out

    @property
    def energy(self) -> float:
        """H_total [J]."""
        return float(coupling.energy_of(self.address))

    @property
    def held_frames(self) -> int:
        return int(self.coupling.counts[coupling.HELD_FRAMES])
