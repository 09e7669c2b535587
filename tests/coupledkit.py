"""A `CoupledStrings` of the physics as the kernels of `solver.frames` have it, for tests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from synth.physics.coupled import CoupledStrings, Place
from synth.physics.modes import mode_shapes
from synth.solver import coupling
from synth.solver.coupled_lines import BodyArrays, CoupledLines, LineArrays
from synth.solver.frames import advance_frames
from synth.solver.line_certificates import certify_line


class Kernel:
    """Lines, bridge and body of a system over frames of frame_s [s] in `steps` steps, contacts at `places`.

    radiation (channels, M) of the body, all that its modes do unless said; struck, knocks: as `CoupledLines` has them.
    steps_of: of each line, where they differ. layers (3, C) of the contacts. engaged: whether contacts are looked at from
    the start, or only where they are not certified.
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
        layers: np.ndarray | None = None,
        path: int = 1,
        culled_from: int = coupling.CULLED_FROM,
        radiation: np.ndarray | None = None,
        struck: np.ndarray | None = None,
        knocks: int = 1,
    ) -> None:
        self.system, self.engaged = system, engaged
        body = system.body
        count = len(places)
        residual = np.zeros((count, count)) if residual is None else np.asarray(residual)
        self.mine = [[c for c, place in enumerate(places) if place.line == k] for k in range(len(system.lines))]
        lines = []
        for line, mine in zip(system.lines, self.mine, strict=True):
            where, n = np.array([places[i].position_m for i in mine]), line.omega.size
            lines.append(
                LineArrays(
                    line.length_m,
                    line.stiffness,
                    line.linear_density_kg_m,
                    line.omega,
                    line.sigma,
                    line.ramp,
                    line.direction,
                    mode_shapes(line.length_m, where, n).reshape(len(mine), n) if mine else np.zeros((0, n)),
                    np.array([places[i].position_m / line.length_m - places[i].rides for i in mine]),
                    np.array([heights_m[i] for i in mine], dtype=float),
                    residual[np.ix_(mine, mine)],
                    line.keeps_mass,
                    None if layers is None or not mine else np.ascontiguousarray(layers[:, mine]),
                )
            )
        radiation = np.ones((1, len(body.modes))) if radiation is None else radiation
        each = [steps] * len(lines) if steps_of is None else steps_of
        there = BodyArrays(body.omega, body.sigma, body.mass, body.shapes, radiation, struck)
        self.lines = CoupledLines(lines, there, frame_s, each, path=path, culled_from=culled_from, knocks=knocks)
        self.models, self.states, self.ends = self.lines.models, self.lines.states, self.lines.ends
        self.coupling = self.lines.coupling
        for end, mine in zip(self.ends, self.mine, strict=True):
            end.counts[coupling.ENGAGED] = int(look_at_all or (engaged and bool(mine)))

    @property
    def address(self) -> int:
        return self.lines.address

    def start(self, x: np.ndarray) -> None:
        """From x (n,) as `coupled` lays it out, with the speed of the bridge that goes with it."""
        w, rates, p, v = self.system.parts()
        for state, of_w, of_rates in zip(self.states, w, rates, strict=True):
            n = of_w.stop - of_w.start
            state.q[:n], state.v[:n] = x[of_w], x[of_rates]
        self.lines.place(x[p], x[v])
        if not self.engaged:
            for line, mine in enumerate(self.mine):
                if mine:
                    near = certify_line(self.address, line, self.lines.scratch)
                    self.ends[line].counts[coupling.ENGAGED] = int(near > 0)
            coupling.gather_lines(self.address)

    def advance(self, frames: int) -> np.ndarray:
        """(frames,) what the body radiates."""
        out = np.zeros((1, frames))
        assert advance_frames(self.address, self.lines.scratch, frames, frames, out) == 0
        return out[0]

    @property
    def x(self) -> np.ndarray:
        """(n,) as `coupled` lays it out."""
        w, rates, p, v = self.system.parts()
        x = np.zeros(self.system.size)
        for line, (state, end) in enumerate(zip(self.states, self.ends, strict=True)):
            n = w[line].stop - w[line].start
            x[w[line]] = state.q[:n]
            x[rates[line]] = state.v[:n] - end.kick[:n] * (self.coupling.lines.direction[line] @ self.coupling.bridge.speed)
        modes = len(self.system.body.modes)
        x[p], x[v] = self.coupling.body.motion.p[:modes], self.coupling.body.motion.speed[:modes]
        return x

    @property
    def force(self) -> np.ndarray:
        """(C,) of the last step [N]."""
        out = np.zeros(sum(len(mine) for mine in self.mine))
        for state, mine in zip(self.states, self.mine, strict=True):
            out[mine] = state.force[: len(mine)]
        return out

    def frame_forces(self, steps: int) -> np.ndarray:
        """(steps, C) of the last frame, which was advanced by itself, all lines taking so many steps [N]."""
        out = np.zeros((steps, sum(len(mine) for mine in self.mine)))
        for end, mine in zip(self.ends, self.mine, strict=True):
            if end.counts[coupling.KIND] >= coupling.SINGLE:
                for i in range(end.counts[coupling.NEAR]):
                    out[:, mine[end.block.near[i]]] = end.block.forces[i, :steps]
        return out

    @property
    def energy(self) -> float:
        """H_total [J]."""
        return float(coupling.energy_of(self.address))

    @property
    def held_frames(self) -> int:
        return int(self.coupling.counts[coupling.HELD_FRAMES])


def gains_nothing(kernel: Kernel, scene: object, frames: int = 200) -> None:
    """No frame of these gains more than 1e-12 of the energy that there is now."""
    before = first = kernel.energy
    for frame in range(frames):
        kernel.advance(1)
        now = kernel.energy
        assert now - before <= 1e-12 * first, (scene, frame)
        before = now
