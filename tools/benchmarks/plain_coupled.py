"""Strings on one bridge as one writes them down: a loop over frames, lines, steps, modes and contacts, and nothing else.

It is the physics and the scheme of `solver.coupling`: over a frame the bridge moves at a constant speed V and the mean force
of the lines is held on the body; a line takes its own r steps a frame, and in each of them a contact holds one force. It has
no blocks of steps, no certificates, no float32 and no layout of vectors. What a frame's contacts and V are to each other is
one matrix, made once; a frame that touches something is solved by projected Gauss–Seidel.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from synth.solver.coupled_lines import LineArrays
from synth.solver.coupling import KEPT_BY_THE_REST

#: sweeps after which a frame is left as it is, and the change of a force, of the largest, that ends them
SWEEPS, CLOSE = 20_000, 1e-14


def exact_step(omega: np.ndarray, sigma: np.ndarray, mass: float | np.ndarray, step_s: float) -> np.ndarray:
    """(6, N) of q̈ + 2σq̇ + ω²q = f/m over one step: q⁺ = a q + b q̇ + e f, q̇⁺ = c q + d q̇ + g f as rows a, b, c, d, e, g."""
    swing = np.sqrt((omega**2 - sigma**2).astype(complex))
    decay, sine = np.exp(-sigma * step_s), np.sin(swing * step_s) / swing
    a, b = decay * (np.cos(swing * step_s) + sigma * sine).real, (decay * sine).real
    c, d = -(omega**2) * b, a - 2.0 * sigma * b
    return np.array([a, b, c, d, (1.0 - a) / omega**2 / mass, -c / omega**2 / mass])


class PlainInstrument:
    """Lines on a body over frames of frame_s [s], line k in steps[k] steps a frame; at rest at first.

    q, v       (lines, N) modal displacements and their velocities against the bridge
    p, p_speed (M,) of the body; V (D,) speed of the bridge in the frame before; rest (D,) motion of the modes left out
    unsolved   frames in which the sweeps did not come to an end
    """

    def __init__(
        self,
        lines: Sequence[LineArrays],
        body_step: np.ndarray,
        body_shape: np.ndarray,
        radiation: np.ndarray,
        frame_s: float,
        steps: Sequence[int],
    ) -> None:
        """body_step (6, M) of `exact_step`, body_shape Ψ (D, M), radiation (channels, M) of an acceleration."""
        count, widest, d = len(lines), max(line.omega.size for line in lines), body_shape.shape[0]
        self.frame_s = frame_s
        self.steps = np.array(steps, np.int64)
        self.modes = np.array([line.omega.size for line in lines], np.int64)
        self.first = np.concatenate([[0], np.cumsum([line.eta.size for line in lines])]).astype(np.int64)
        self.rows = np.concatenate([[0], np.cumsum(self.steps * np.diff(self.first))]).astype(np.int64)
        self.coef, self.ramp = np.zeros((count, 6, widest)), np.zeros((count, widest))
        self.kicked = np.zeros((count, 2, widest))  # a frame after a unit change of V
        self.shapes = np.zeros((self.first[-1], widest))
        self.leverage, self.eta = (np.concatenate([each[i] for each in lines]) for i in (8, 9))
        self.direction = np.array([line.direction for line in lines], float).reshape(count, d)
        self.mu, self.stiffness = np.array([line.mu for line in lines]), np.array([line.stiffness for line in lines])
        self.body_step, self.body_shape, self.radiation = body_step, body_shape, radiation
        self.rest_mass, self.held = np.zeros((d, d)), np.zeros(d)
        for k, line in enumerate(lines):
            n = line.omega.size
            self.coef[k, :, :n] = exact_step(line.omega, line.sigma, line.mu, frame_s / self.steps[k])
            self.ramp[k, :n] = line.ramp
            self.shapes[self.first[k] : self.first[k + 1], :n] = line.shapes
            if line.keeps_mass:
                left_out = line.mu * max(0.0, line.length_m / 3.0 - float(line.ramp @ line.ramp))
                self.rest_mass += left_out * np.outer(line.direction, line.direction)
        self._probe([line.residual for line in lines])
        self.q, self.v = np.zeros((count, widest)), np.zeros((count, widest))
        self.p, self.p_speed = np.zeros(body_shape.shape[1]), np.zeros(body_shape.shape[1])
        self.speed, self.rest = np.zeros(d), np.zeros(d)
        self.unsolved = 0

    def _probe(self, residuals: Sequence[np.ndarray]) -> None:
        """What every unit force and every unit change of V gives, line by line, and the matrix of a frame's contacts."""
        d, total, frame = self.body_shape.shape[0], self.rows[-1], self.frame_s
        gaps, self.gap_v, self.force_f = np.zeros((total, total)), np.zeros((total, d)), np.zeros((total, d))
        force_v = -(1.0 + KEPT_BY_THE_REST) / frame * self.rest_mass
        for k, residual in enumerate(residuals):
            r, n, mine = self.steps[k], self.modes[k], slice(self.first[k], self.first[k + 1])
            a, b, c, e, on_q, on_v = self.coef[k, :, :n]
            shapes, ramp, along = self.shapes[mine, :n], self.ramp[k, :n], self.direction[k]
            lever, contacts, at = self.leverage[mine], mine.stop - mine.start, self.rows[k]
            q, v = np.zeros(n), -ramp
            for t in range(r):
                q, v = a * q + b * v, c * q + e * v
                moved = shapes @ q + lever * (frame / r) * (t + 1)
                self.gap_v[at + t * contacts : at + (t + 1) * contacts] = np.outer(moved, along)
            self.kicked[k, :, :n] = q, v
            pull = -self.mu[k] * (ramp @ (v + ramp)) / frame - 0.5 * frame * self.stiffness[k]
            force_v += pull * np.outer(along, along)
            for i in range(contacts):
                q, v = on_q * shapes[i], on_v * shapes[i]
                for lag in range(r):
                    after = shapes @ q + (residual[:, i] if lag == 0 else 0.0)
                    for t in range(r - lag):  # a force in step t is felt in step t + lag
                        gaps[at + (t + lag) * contacts : at + (t + lag + 1) * contacts, at + t * contacts + i] = after
                    reach = lever[i] / r - self.mu[k] * (ramp @ v) / frame
                    self.force_f[at + (r - 1 - lag) * contacts + i] = reach * along
                    q, v = a * q + b * v, c * q + e * v
        gamma = (self.body_shape * self.body_step[4]) @ self.body_shape.T
        self.solved = np.linalg.inv(frame * np.eye(d) - gamma @ force_v)  # V H = drift + Γ F
        self.gamma, self.force_v = gamma, force_v
        self.change = self.force_f @ (self.solved @ gamma).T  # of V by each force
        self.columns = np.ascontiguousarray((gaps + self.gap_v @ self.change.T).T)

    def advance(self, frames: int) -> np.ndarray:
        """(channels, frames) what the body radiates."""
        out = np.zeros((self.radiation.shape[0], frames))
        lines = (self.steps, self.modes, self.first, self.rows, self.coef, self.ramp, self.kicked)
        under = (self.shapes, self.leverage, self.eta, self.direction, self.mu, self.stiffness)
        body = (self.body_step, self.body_shape, self.radiation, self.rest_mass)
        work = (self.held, self.gap_v, self.force_f, self.force_v, self.gamma, self.solved, self.change, self.columns)
        state = (self.q, self.v, self.p, self.p_speed, self.speed, self.rest)
        self.unsolved += _advance(frames, self.frame_s, lines, under, body, work, state, out)
        return out


@njit(nogil=True, fastmath=True, cache=True)
def _fly(n, coef, q, v):
    """A step of n modes without a force."""
    for j in range(n):
        a, b = q[j], v[j]
        q[j] = coef[0, j] * a + coef[1, j] * b
        v[j] = coef[2, j] * a + coef[3, j] * b


@njit(nogil=True, fastmath=True, cache=True)
def _advance(frames, frame, lined, under, body, work, state, out):
    """Frames of a `PlainInstrument`; in how many of them the contacts were not solved."""
    steps, modes, first, rows, coef, ramp, kicked = lined
    shapes, leverage, eta, direction, mu, stiffness = under
    body_step, body_shape, radiation, rest_mass = body
    held, gap_v, force_f, force_v, gamma, solved, change, columns = work
    q, v, p, p_speed, speed, rest = state
    d, lines, bodies, total = speed.size, steps.size, p.size, rows[-1]
    gap, force = np.zeros(total), np.zeros(total)
    bridge, pull, drift, new = np.zeros(d), np.zeros(d), np.zeros(d), np.zeros(d)
    kept_q, kept_v = np.zeros_like(q), np.zeros_like(v)
    p_free, p_speed_free = np.zeros(bodies), np.zeros(bodies)
    unsolved = 0
    for number in range(frames):
        for m in range(bodies):
            p_free[m] = body_step[0, m] * p[m] + body_step[1, m] * p_speed[m]
            p_speed_free[m] = body_step[2, m] * p[m] + body_step[3, m] * p_speed[m]
        for i in range(d):
            bridge[i] = drift[i] = 0.0
            for m in range(bodies):
                bridge[i] += body_shape[i, m] * p[m]
                drift[i] += body_shape[i, m] * (p_free[m] - p[m])
        # the lines without forces, the bridge as fast as before
        for i in range(d):
            pull[i] = -held[i]
            for j in range(d):
                pull[i] -= rest_mass[i, j] * (1.0 + KEPT_BY_THE_REST) * (speed[j] - rest[j]) / frame
        for k in range(lines):
            n, r, contacts = modes[k], steps[k], first[k + 1] - first[k]
            height = along = 0.0
            for i in range(d):
                height += direction[k, i] * bridge[i]
                along += direction[k, i] * speed[i]
            before = 0.0
            for j in range(n):
                kept_q[k, j], kept_v[k, j] = q[k, j], v[k, j]
                before += ramp[k, j] * v[k, j]
            for t in range(r):
                _fly(n, coef[k], q[k], v[k])
                for c in range(contacts):
                    u = leverage[first[k] + c] * (height + along * frame * (t + 1) / r) - eta[first[k] + c]
                    for j in range(n):
                        u += shapes[first[k] + c, j] * q[k, j]
                    gap[rows[k] + t * contacts + c] = u
            after = 0.0
            for j in range(n):
                after += ramp[k, j] * v[k, j]
            own = -mu[k] * (after - before) / frame - stiffness[k] * (height + 0.5 * frame * along)
            for i in range(d):
                pull[i] += direction[k, i] * own
        # the bridge without forces: V H = drift + Γ (F + F_V (V − V before))
        for i in range(d):
            for j in range(d):
                pull[i] -= force_v[i, j] * speed[j]
        for i in range(d):
            new[i] = 0.0
            for j in range(d):
                whole = drift[j]
                for m in range(d):
                    whole += gamma[j, m] * pull[m]
                new[i] += solved[i, j] * whole
        touched = False
        for row in range(total):
            force[row] = 0.0
            for i in range(d):
                gap[row] += gap_v[row, i] * (new[i] - speed[i])
            touched = touched or gap[row] < 0.0
        if touched:
            unsolved += _sweep(columns, gap, force)
            for row in range(total):
                if force[row] > 0.0:
                    for i in range(d):
                        new[i] += change[row, i] * force[row]
                        pull[i] += force_f[row, i] * force[row]
        # the body under the mean force
        for i in range(d):
            for j in range(d):
                pull[i] += force_v[i, j] * new[j]
        for m in range(bodies):
            on_mode = 0.0
            for i in range(d):
                on_mode += body_shape[i, m] * pull[i]
            p[m] = p_free[m] + body_step[4, m] * on_mode
            speed_now = p_speed_free[m] + body_step[5, m] * on_mode
            for channel in range(out.shape[0]):
                out[channel, number] += radiation[channel, m] * (speed_now - p_speed[m]) / frame
            p_speed[m] = speed_now
        # the lines under the kick, and again from the frame's start where a force acts
        for k in range(lines):
            n, r, contacts = modes[k], steps[k], first[k + 1] - first[k]
            along = 0.0
            for i in range(d):
                along += direction[k, i] * (new[i] - speed[i])
            pressed = False
            for row in range(rows[k], rows[k + 1]):
                pressed = pressed or force[row] > 0.0
            if not pressed:
                for j in range(n):
                    q[k, j] += kicked[k, 0, j] * along
                    v[k, j] += kicked[k, 1, j] * along
                continue
            for j in range(n):
                q[k, j], v[k, j] = kept_q[k, j], kept_v[k, j] - ramp[k, j] * along
            for t in range(r):
                _fly(n, coef[k], q[k], v[k])
                for c in range(contacts):
                    f = force[rows[k] + t * contacts + c]
                    if f > 0.0:
                        for j in range(n):
                            q[k, j] += coef[k, 4, j] * shapes[first[k] + c, j] * f
                            v[k, j] += coef[k, 5, j] * shapes[first[k] + c, j] * f
        for i in range(d):
            rest[i] = new[i] - KEPT_BY_THE_REST * (rest[i] - new[i])
            speed[i] = new[i]
    return unsolved


@njit(nogil=True, fastmath=True, cache=True)
def _sweep(columns, gap, force):
    """0 ≤ A λ + b ⊥ λ ≥ 0 by projected Gauss–Seidel, gap b at first and what is left at last: 1 where it does not end."""
    for _ in range(SWEEPS):
        most, largest = 0.0, 0.0
        for i in range(gap.size):
            if gap[i] < 0.0 or force[i] > 0.0:
                change = max(-force[i], -gap[i] / columns[i, i])
                if change != 0.0:
                    force[i] += change
                    for j in range(gap.size):
                        gap[j] += change * columns[i, j]
                most, largest = max(most, abs(change)), max(largest, force[i])
        if most <= CLOSE * largest:
            return 0
    return 1
