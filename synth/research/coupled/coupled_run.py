"""A case of strings on a body by the kernels of `solver.frames`: hands and motions at their times, rows, ledger."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from synth.native.arrays import allocate
from synth.native.denormals import flushed
from synth.native.views import table
from synth.physics.modes import mode_shapes
from synth.research.coupled.coupled_case import DirectedFingerTable, FretTable
from synth.research.coupled.coupled_scene import CoupledScene
from synth.research.finger_paths import Way, last_steps, sliding_off
from synth.solver import coupled_study as study
from synth.solver import coupling
from synth.solver.coupled_advance import advance_study, write_row
from synth.solver.coupled_body import COMPONENTS
from synth.solver.coupled_ledger import weigh_now
from synth.solver.coupled_lines import CoupledLines
from synth.solver.coupled_study import CHUNK, CoupledStudy, FarEnds, FrameBefore, StudyRows, far_moments
from synth.solver.coupling import COUPLING_SIZES, MOST_STEPS
from synth.solver.fret_change import drawn_behind, eased, release, stop

#: a bend renews the tension this often [s]
_BEND_INTERVAL_S = 1e-3


@dataclass
class CoupledOutcome:
    """What a run gave."""

    rows: StudyRows
    final: np.ndarray  # (n,) as `physics.coupled` lays out the open strings; zeros: some are stopped
    notes: dict[str, Any]
    seconds: float


@dataclass
class _Ramp:
    """The far end of a line on its way from `here` to `there` [m] since frame `begin`."""

    fret: FretTable
    begin: int
    here: float
    there: float


class CoupledPlayer:
    """A scene through time; `run` takes it to its end.

    lines    the kernels' arrays
    t, far   what moves and is looked at, and the far ends
    rows     what it gives, written as it goes on
    """

    def __init__(self, scene: CoupledScene) -> None:
        self.scene = scene
        count = len(scene.lines)
        self.stopped, self.bent = [0.0] * count, [0.0] * count
        self.grips: list[Way | None] = [None] * count
        self.ramps: list[_Ramp | None] = [None] * count
        arrays = [scene.arrays(k) for k in range(count)]
        path = MOST_STEPS + 1
        self.lines = CoupledLines(
            arrays, scene.body_arrays, scene.frame_s, scene.substeps, most_modes=scene.modes, path=path
        )
        self.heights = [line.eta.copy() for line in arrays]
        self.t, self.far, self.rows, self._before = parts = self._study()
        self._table = table(*parts)
        self.frame = 0
        self.begun_inside_m = 0.0
        self._start()

    @property
    def address(self) -> int:
        return int(self._table.ctypes.data)

    def _study(self) -> tuple[CoupledStudy, FarEnds, StudyRows, FrameBefore]:
        scene, run = self.scene, self.scene.case.run
        first = np.concatenate([[0], np.cumsum([len(eta) for eta in self.heights])]).astype(np.int64)
        points = [(scene.line_of[number], x) for number, each in enumerate(scene.tables) for x in each.outputs_m]
        self.points = points
        sizes = COUPLING_SIZES | {
            "lines": len(self.heights), "contacts": int(first[-1]), "modes": max(scene.modes), "points": len(points),
            "CHUNK": CHUNK, "PATH": CHUNK * MOST_STEPS + 1, "rows": scene.rows, "axes": scene.body.axes,
            "components": COMPONENTS,
            "channels": 2, "body": self.lines.coupling.body.mass.size, "N_ENERGIES": study.N_ENERGIES,
            "N_SUMS": study.N_SUMS, "N_COUNTS": study.N_COUNTS, "weighed": scene.rows if run.ledger else 0,
        }  # fmt: skip
        out_line = np.array([line for line, _ in points], np.int64)
        given = {"coupling": self.lines.address, "scratch": self.lines.scratch, "every": run.steps_per_output}
        t = allocate(CoupledStudy, sizes, first=first, out_line=out_line, **given)
        return t, allocate(FarEnds, sizes), allocate(StudyRows, sizes), allocate(FrameBefore, sizes)

    def _start(self) -> None:
        scene, lines, t = self.scene, self.lines, self.t
        x = scene.initial()
        w, rates, p, v = scene.system.parts()
        for k, state in enumerate(lines.states):
            n = w[k].stop - w[k].start
            state.q[:n], state.v[:n] = x[w[k]], x[rates[k]]
        lines.place(x[p], x[v])
        for k in range(len(lines.states)):
            self._look_at_line(k)
            self._lay_obstacle(k)
        self.rows.counts[study.LAST_CONTACT] = -1
        self.rows.sums[study.PENETRATION] = -math.inf if t.eta.size else 0.0
        self.rows.sums[study.INITIAL] = weigh_now(self.address)
        write_row(self.address)

    def _look_at_line(self, k: int) -> None:
        """What of a line's length the study has."""
        scene, t = self.scene, self.t
        stopped = self.stopped[k]
        length = scene.strings[scene.lines[k].string].length_m - stopped
        n = scene.modes_at(k, stopped)
        self.far.moments[k] = 0.0
        self.far.moments[k, :n] = far_moments(length, n)
        self.far.leverage[t.first[k] : t.first[k + 1]] = scene.far_leverage(k, stopped)
        for point, (line, x) in enumerate(self.points):
            if line == k:
                t.out_shape[point] = 0.0
                if x > stopped:
                    t.out_shape[point, :n] = mode_shapes(length, min(x - stopped, length), n)[0]
                    t.out_leverage[point] = (x - stopped) / length
                    t.out_far[point] = 1.0 - (x - stopped) / length
                else:  # straight behind the stop
                    t.out_leverage[point] = 0.0
                    t.out_far[point] = x / stopped if stopped else 0.0

    def _lay_obstacle(self, k: int) -> None:
        """The obstacle of a line that is pressed by nothing: where it belongs, or where the string is below that."""
        lines, t = self.lines, self.t
        state, end, model = lines.states[k], lines.ends[k], lines.models[k]
        b = float(lines.coupling.lines.direction[k] @ lines.coupling.bridge.beta)
        up = float(
            self.scene.obstacle_displacement(self.scene.lines[k].string, np.array([self.frame * self.scene.frame_s]))[0]
        )
        for c in range(model.contacts.size):
            at = t.first[k] + c
            u = float(model.contacts.shapes[c] @ state.q[: model.contacts.shapes.shape[1]]) + end.leverage[c] * b
            u += self.far.leverage[at] * self.far.height[k]
            height = self.heights[k][c] + up
            t.eta[at] = min(height, u)
            t.rising[at] = int(u < height)
            if self.frame == 0:
                self.begun_inside_m = max(self.begun_inside_m, height - u)
            state.force[c] = 0.0
            state.eta[c] = t.eta[at] - self.far.leverage[at] * self.far.height[k]

    # --- hands ---

    def _weighed(self, place: int, sign: float, change: Callable[[], None]) -> float:
        """A change between frames with what it does to the stored energy, in the ledger at `place`; how much that grew."""
        before = weigh_now(self.address)
        change()
        after = weigh_now(self.address)
        self.t.now[place] += sign * (after - before)
        return after - before

    def bend(self, number: int, cents: float) -> None:
        """String `number` at another tension; what the string was compressed by at contacts stays."""

        def change() -> None:
            for k, of in enumerate(self.scene.lines):
                if of.string != number:
                    continue
                state, old = self.lines.states[k], self.lines.models[k]
                held, eta = old.contacts.residual @ state.force, state.eta.copy()
                self.bent[k] = cents
                line = self.scene.arrays(k, cents, self.stopped[k])
                self.lines.set_line(k, line, gather=False)
                if held.any():
                    state.force[:] = np.linalg.lstsq(line.residual, held, rcond=None)[0]
                state.eta[:] = eta
            self.lines.gather()

        self._weighed(study.WORK_BEND, 1.0, change)

    def fret(self, number: int, fret: FretTable) -> None:
        """String `number` is stopped at another place, or let go to it."""

        def change() -> None:
            c = self.lines.coupling
            left_out = float(c.bridge.rest @ c.load.rest_mass @ c.bridge.rest)
            for k, of in enumerate(self.scene.lines):
                if of.string == number:
                    self._stop_line(k, fret, 0.0 if of.second else fret.height_m)
            self.lines.gather()
            now = float(c.bridge.rest @ c.load.rest_mass @ c.bridge.rest)
            if now > left_out:
                c.bridge.rest[:] *= math.sqrt(left_out / now)

        given = float(self.t.now[study.WORK_FRET])
        grown = self._weighed(study.LOST_FRET, -1.0, change)
        grown -= float(self.t.now[study.WORK_FRET]) - given
        scale = self.rows.sums[study.INITIAL] + max(0.0, float(self.t.now[study.N_STORED + study.N_LOST :].sum()))
        if scale > 0.0:
            self.rows.sums[study.RISE] = max(self.rows.sums[study.RISE], grown / scale)

    def _stop_line(self, k: int, fret: FretTable, height: float) -> None:
        scene, lines, t = self.scene, self.lines, self.t
        state, end, body = lines.states[k], lines.ends[k], lines.coupling
        whole = scene.strings[scene.lines[k].string].length_m
        before, after = whole - self.stopped[k], whole - fret.position_m
        speed = float(body.lines.direction[k] @ body.bridge.speed)
        b = float(body.lines.direction[k] @ body.bridge.beta)
        n_old, n = scene.modes_at(k, self.stopped[k]), scene.modes_at(k, fret.position_m)
        w = state.q[:n_old].copy()
        y = state.v[:n_old] - end.kick[:n_old] * speed + self.far.moments[k, :n_old] * self.far.speed[k]
        self.ramps[k] = None
        far = float(self.far.height[k])
        old, tension = lines.models[k], scene.bent(scene.lines[k].string, self.bent[k], 0.0).tension_n
        most = 0.5 * old.mu * float(y @ y + np.sum((old.omega[:n_old] * w) ** 2)) + 0.5 * tension / before * (b - far) ** 2
        if after < before:
            w, y, far = stop(w, y, far, b, before, after, n)
            self.ramps[k] = _Ramp(fret, self.frame, far, height)
        elif after > before:
            w, y = release(w, y, far, b, before, after, height, n)
            given = drawn_behind(far, height, tension, before, after)
            t.now[study.WORK_FRET] += given
            t.now[study.LOST_FRET] += given  # what of it the string keeps is taken off below
            most += given
            far = height
        else:
            self.ramps[k] = _Ramp(fret, self.frame, far, height)
        self.stopped[k] = fret.position_m
        line = scene.arrays(k, self.bent[k], fret.position_m)
        lines.set_line(k, line, gather=False)
        most -= 0.5 * line.mu * float(y @ y) + 0.5 * line.stiffness * (b - far) ** 2
        w = eased(w, line.omega, line.mu, max(0.0, most))
        state.q[:] = state.v[:] = 0.0
        state.q[:n] = w
        state.v[:n] = y + lines.ends[k].kick[:n] * speed
        self.far.height[k], self.far.speed[k] = far, 0.0
        self.heights[k] = line.eta.copy()
        self._look_at_line(k)
        self._lay_obstacle(k)

    def take_hold(self, number: int, finger: DirectedFingerTable) -> None:
        """A finger takes hold of a string where it is."""
        turn = math.radians(finger.direction_deg)
        for k, of in enumerate(self.scene.lines):
            if of.string == number:
                share = math.sin(turn) if of.second else math.cos(turn)
                weights, leverage = self.scene.finger_weights(finger, k, self.stopped[k])
                here = self.lines.hold(k, weights, leverage, finger.stiffness_n_m, finger.resistance_n_s_m)
                self.far.finger[k] = 1.0 - leverage
                here += (1.0 - leverage) * float(self.far.height[k])
                self.grips[k] = Way(self.frame, here, share * finger.displacement_m, finger.draw_s)

    def slide_off(self, number: int, end: int) -> None:
        """A string slides off the finger that holds it, until frame `end`."""
        for k, of in enumerate(self.scene.lines):
            if of.string == number and self.grips[k] is not None:
                self.grips[k] = sliding_off(self.frame, end, self.lines.soften(k), self.scene.frame_s)

    def let_go(self, number: int) -> None:
        """The finger on a string leaves it."""
        for k, of in enumerate(self.scene.lines):
            if of.string == number and self.grips[k] is not None:
                self.grips[k] = None
                self.lines.let_go(k)

    # --- time ---

    def advance(self, frames: int) -> None:
        """So many frames with what moves in them."""
        while frames > 0:
            count = min(frames, CHUNK)
            self._fill(count)
            with flushed():
                advance_study(self.address, count)
            self.frame += count
            frames -= count

    def _fill(self, count: int) -> None:
        """Where fingers, far ends and obstacles are over the next frames."""
        scene, t, h = self.scene, self.t, self.scene.frame_s
        ends = self.frame + 1 + np.arange(count)
        for k, of in enumerate(scene.lines):
            mine = slice(int(t.first[k]), int(t.first[k + 1]))
            if mine.start < mine.stop:
                up = scene.obstacle_displacement(of.string, ends * h)
                t.target[:count, mine] = self.heights[k] + up[:, None]
            ramp = self.ramps[k]
            self.far.path[:count, k] = self.far.height[k]
            if ramp is not None:
                share = np.clip((ends - ramp.begin) * h / ramp.fret.ramp_s, 0.0, 1.0)
                self.far.path[:count, k] = ramp.here + (ramp.there - ramp.here) * 0.5 * (1.0 - np.cos(np.pi * share))
            way = self.grips[k]
            if way is not None:
                steps = scene.substeps[k]
                t.path[k, : count * steps + 1] = way.path(self.frame, count, h, steps)

    def run(self) -> CoupledOutcome:
        """To the end of the case."""
        advance_study(self.address, 0)
        began = time.perf_counter()
        last = (self.scene.rows - 1) * self.scene.case.run.steps_per_output
        for frame, action in self._events():
            if frame >= last:
                break
            self.advance(frame - self.frame)
            action()
        self.advance(last - self.frame)
        return self._outcome(time.perf_counter() - began)

    def _events(self) -> list[tuple[int, Callable[[], None]]]:
        """What hands do between frames, in time."""
        scene, h = self.scene, self.scene.frame_s
        found: list[tuple[int, int, Callable[[], None]]] = []
        for number, each in enumerate(scene.tables):
            for fret in each.fret:
                found.append((round(fret.start_s / h), 1, partial(self.fret, number, fret)))
            end = 0
            for finger in sorted(each.finger, key=lambda finger: finger.start_s):
                start = max(end, round(finger.start_s / h))
                slips, end = last_steps(finger, start, h)
                found.append((start, 3, partial(self.take_hold, number, finger)))
                if slips < end:
                    found.append((slips, 0, partial(self.slide_off, number, end)))
                found.append((end, 0, partial(self.let_go, number)))
            if each.bend:
                tread = max(1, round(_BEND_INTERVAL_S / h))
                begin = np.arange(0, scene.frames, tread)
                cents = scene.cents(number, (begin + 0.5 * tread) * h)
                for at in np.flatnonzero(np.diff(cents, prepend=0.0)):
                    found.append((int(begin[at]), 2, partial(self.bend, number, float(cents[at]))))
        return [(frame, action) for frame, _, action in sorted(found, key=lambda event: event[:2])]

    @property
    def x(self) -> np.ndarray:
        """(n,) the state as `physics.coupled.CoupledStrings` lays it out; zeros while a string is stopped."""
        system, body = self.scene.system, self.lines.coupling
        x = np.zeros(system.size)
        if any(self.stopped):
            return x
        w, rates, p, v = system.parts()
        for k, state in enumerate(self.lines.states):
            n = w[k].stop - w[k].start
            x[w[k]] = state.q[:n]
            x[rates[k]] = state.v[:n] - self.lines.ends[k].kick[:n] * (body.lines.direction[k] @ body.bridge.speed)
        modes = len(self.scene.body.modes)
        x[p], x[v] = body.body.motion.p[:modes], body.body.motion.speed[:modes]
        return x

    def _outcome(self, seconds: float) -> CoupledOutcome:
        counts = self.lines.coupling.counts
        touched = int(counts[coupling.TOUCHED])
        notes: dict[str, Any] = {
            "held_frames": int(counts[coupling.HELD_FRAMES]),
            "bridge_iterations": float(counts[coupling.ITERATIONS] / touched) if touched else 0.0,
        }
        if self.begun_inside_m > 0.0:
            notes["begun_inside_m"] = self.begun_inside_m
        return CoupledOutcome(self.rows, self.x, notes, seconds)


def run_exact_hold(scene: CoupledScene) -> CoupledOutcome:
    """The scene by the kernels of the engine."""
    return CoupledPlayer(scene).run()
