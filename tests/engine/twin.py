"""A string, at most one point of contact and one finger, step by step in plain NumPy: the engine's note, worked out anew.

Propagators come from the complex roots of each mode, the finger and the contact from a 2 × 2 system.
"""

from __future__ import annotations

import math

import numpy as np

from synth.instrument.compile import CompiledString, Position
from synth.physics.excitation import pluck_weights


class Twin:
    """One position of a compiled string. q, v (N,) begin at rest."""

    def __init__(self, position: Position) -> None:
        self.position = position
        self.dt = 1.0 / position.plan.rate_hz
        self.q = np.zeros(position.omega.size)
        self.v = np.zeros(position.omega.size)
        self.damp(0.0)

    def damp(self, extra: float) -> None:
        """Another decay rate on top of every mode's own [1/s]."""
        p = self.position
        sigma = p.sigma + extra
        root = np.sqrt((sigma**2 - p.omega**2).astype(complex))
        fast, slow = -sigma - root, -sigma + root
        a, b = np.exp(fast * self.dt), np.exp(slow * self.dt)
        self.p11 = ((slow * a - fast * b) / (slow - fast)).real
        self.p12 = ((b - a) / (slow - fast)).real
        self.p21 = -(p.omega**2) * self.p12
        self.p22 = ((slow * b - fast * a) / (slow - fast)).real
        self.kq = (1.0 - self.p11) / (p.mu * p.omega**2)
        self.kv = self.p12 / p.mu

    def energy(self) -> float:
        """½ μ Σ (v² + ω² q²) [J]."""
        return 0.5 * self.position.mu * float(np.sum(self.v**2 + (self.position.omega * self.q) ** 2))

    def run(self, steps: int, finger=None) -> tuple[np.ndarray, float, np.ndarray]:
        """Advance; finger = (weights (N,), stiffness, resistance, path (steps + 1,)).

        Returns output wq·q (steps,), the finger's work on the string [J] and contact forces (steps,).
        """
        p, dt = self.position, self.dt
        contact = p.eta.size == 1
        shape = p.shapes[0] if contact else np.zeros(p.omega.size)
        g = float(shape @ (self.kq * shape)) + (float(p.residual[0, 0]) if contact else 0.0)
        out, forces = np.empty(steps), np.zeros(steps)
        work = 0.0
        for t in range(steps):
            before = self.q
            q = self.p11 * self.q + self.p12 * self.v
            v = self.p21 * self.q + self.p22 * self.v
            push = force = 0.0
            gap = float(shape @ q) - p.eta[0] if contact else 1.0
            if finger is None:
                if gap < 0.0:
                    force = -gap / g
            else:
                w, k, r, path = finger
                slope = k + r / dt
                wanted = k * path[t + 1] + r / dt * (path[t + 1] - path[t] + float(w @ before))
                own, cross = float(w @ (self.kq * w)), float(shape @ (self.kq * w))
                push = (wanted - slope * float(w @ q)) / (1.0 + slope * own)
                if gap + cross * push < 0.0:
                    matrix = np.array([[1.0 + slope * own, slope * cross], [cross, g]])
                    push, force = np.linalg.solve(matrix, [wanted - slope * float(w @ q), -gap])
                    assert force > 0.0
            modal = shape * force + (finger[0] * push if finger is not None else 0.0)
            self.q, self.v = q + self.kq * modal, v + self.kv * modal
            if finger is not None:
                work += push * float(finger[0] @ (self.q - before))
            out[t], forces[t] = p.wq @ self.q, force
        return out, work, forces

    def finger(self, string: CompiledString, preset, velocity: int):
        """The plucking finger as the engine lays it on: weights, stiffness, resistance, path."""
        p, pluck = self.position, preset.pluck
        strength = velocity / 127.0
        x = pluck.position * string.open_length_m
        weights = np.zeros(p.omega.size)
        weights[: p.own] = pluck_weights(p.length_m, p.length_m - x, 1e-3 * pluck.width_mm, p.own)
        displacement = 1e-3 * pluck.displacement_mm * strength**pluck.velocity_exponent
        steps = round(string.draw_s * p.plan.rate_hz / string.factor) * string.factor  # whole output frames
        here = float(weights @ self.q)
        path = here + (displacement - here) * (0.5 - 0.5 * np.cos(math.pi * np.arange(steps + 1) / steps))
        return weights, 1e3 * pluck.finger_stiffness_n_mm, pluck.finger_loss * string.impedance_kg_s, path
