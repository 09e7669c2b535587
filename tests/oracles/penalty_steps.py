"""Readable twins of the compliant contact kernels: the two-step form in extended precision, slow and plain.

q⁺ = a q − e q⁻ + (Δt²/μ) F Sᵀf with a, e of IA2018 eqs 22 and 23 and F as in `steps.moreau_jean_matrices`; the
potential differences are subtracted as they stand and Newton's equation is bisected, one contact after the other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.oracles.steps import held_force_propagator, moreau_jean_matrices

Long = NDArray[Any]  # of long doubles, or one of them


class Twin:
    """One string over compliant points, from q, v at t = 0; `step` gives the forces (C,) of each step in turn."""

    def __init__(self, method, omega, sigma, mu, dt, shapes, eta, q, v, stiffness, exponent, loss=0.0, correction=0.0):
        self.method, self.dt, self.loss, self.correction = method, np.longdouble(dt), loss, correction
        self.k, self.alpha = np.longdouble(stiffness), np.longdouble(exponent)
        self.shapes, self.eta = np.asarray(shapes, np.longdouble), np.asarray(eta, np.longdouble)
        w, s = np.asarray(omega, np.longdouble), np.asarray(sigma, np.longdouble)
        root = np.sqrt((s**2 - w**2).astype(np.clongdouble))
        self.a = (np.exp(-s * self.dt) * (np.exp(root * self.dt) + np.exp(-root * self.dt))).real
        self.e = np.exp(-2 * s * self.dt)
        self.gain = self.dt**2 / np.longdouble(mu) * moreau_jean_matrices(omega, sigma, dt)[2]
        self.compliance = (self.shapes * self.gain) @ self.shapes.T
        hold = np.array([held_force_propagator(x, y, mu, dt) for x, y in zip(omega, sigma, strict=True)])
        q, v = np.asarray(q, np.longdouble), np.asarray(v, np.longdouble)
        g = self.eta - self.shapes @ q
        free = hold[:, 0, 0] * q + hold[:, 0, 1] * v
        response = (self.shapes * hold[:, 0, 2]) @ self.shapes.T
        self.first = self._balance(response, g, self.eta - self.shapes @ free - g, loss * self.force(g) / self.dt)
        self.old, self.q = q, free + hold[:, 0, 2] * (self.first @ self.shapes)
        mean = (self.potential(self.depth(self.old)) + self.potential(self.depth(self.q))) / 2
        self.psi = np.sqrt(2 * mean) if method == "energy-quadratisation" else np.sqrt(2 * mean.sum())

    def depth(self, q: Long) -> Long:
        return self.eta - self.shapes @ q

    def potential(self, g: Long) -> Long:
        return self.k / (self.alpha + 1) * np.maximum(g, 0) ** (self.alpha + 1)

    def force(self, g: Long) -> Long:
        return self.k * np.maximum(g, 0) ** self.alpha

    def step(self) -> Long:
        """Moves on by one step; returns the contact forces (C,)."""
        free = self.a * self.q - self.e * self.old
        before, now = self.depth(self.old), self.depth(self.q)
        b = self.depth(free) - before
        drag = self.loss * self.force(now) / (2 * self.dt)
        force = {
            "compliant": lambda: self._balance(self.compliance, before, b, drag),
            "energy-quadratisation": lambda: self._quadratised(now, b, drag),
            "scalar-auxiliary-variable": lambda: self._scalar(before, now, b),
        }[self.method]()
        self.old, self.q = self.q, free + self.gain * (force @ self.shapes)
        return force

    def _quotient(self, before: Long, r: Long) -> Long:
        if abs(r) < 1e-9 * abs(before):
            return self.force(before + r / 2)
        return (self.potential(before + r) - self.potential(before)) / r if r != 0 else self.force(before)

    def _balance(self, compliance: Long, before: Long, b: Long, drag: Long) -> Long:
        """f with r + A f = b and f_c the difference quotient plus drag: sweeps of bisections."""
        force = np.zeros(b.size, np.longdouble)
        for _ in range(400):
            last = force.copy()
            for c in range(b.size):
                target = b[c] - compliance[c] @ force + compliance[c, c] * force[c]

                def law(r, c=c):
                    return self._quotient(before[c], r) + drag[c] * r

                high = max(target, np.longdouble(0))
                low = min(target, np.longdouble(0)) - compliance[c, c] * law(high)
                for _ in range(120):
                    middle = (low + high) / 2
                    if middle - target + compliance[c, c] * law(middle) > 0:
                        high = middle
                    else:
                        low = middle
                force[c] = law((low + high) / 2)
            if b.size == 1 or np.abs(force - last).max() <= 1e-17 * np.abs(force).max():
                break
        return force

    def _quadratised(self, now: Long, b: Long, drag: Long) -> Long:
        psi = np.abs(self.psi)
        inside = now > 0
        slope = np.zeros(b.size, np.longdouble)
        slope[inside] = self.force(now[inside]) / np.sqrt(2 * self.potential(now[inside]))  # ψ' = V'/√(2V)
        out = ~inside & (b != 0)
        slope[out] = -2 * psi[out] / b[out]
        # unknowns r: r + A (slope (ψ⁻ + slope r/4) + drag r) = b
        matrix = np.eye(b.size) + self.compliance * (slope**2 / 4 + drag)
        r = _solve(matrix, b - self.compliance @ (slope * psi))
        self.psi = psi + slope * r / 2
        return slope * (psi + self.psi) / 2 + drag * r

    def _scalar(self, before: Long, now: Long, b: Long) -> Long:
        self.psi = np.abs(self.psi)
        total = self.potential(now).sum()
        slope = self.force(now) / np.sqrt(2 * total) if total > 0 else np.zeros(b.size, np.longdouble)
        if self.correction > 0:
            d = np.where((now > 0) | (before > 0), b / 2, 0)
            if d @ d > 0:
                drift = self.psi - np.sqrt(total + self.potential(before).sum())
                slope = slope - self.correction * drift * d / (d @ d)
        matrix = np.eye(b.size) + np.outer(self.compliance @ slope, slope) / 4
        r = _solve(matrix, b - self.compliance @ slope * self.psi)
        last, self.psi = self.psi, self.psi + slope @ r / 2
        return slope * (last + self.psi) / 2


def _solve(matrix: Long, right: Long) -> Long:
    """Gauss elimination in extended precision."""
    a, x = np.asarray(matrix, np.longdouble).copy(), np.asarray(right, np.longdouble).copy()
    n = x.size
    for i in range(n):
        p = i + int(np.argmax(np.abs(a[i:, i])))
        a[[i, p]], x[[i, p]] = a[[p, i]], x[[p, i]]
        for m in range(i + 1, n):
            factor = a[m, i] / a[i, i]
            a[m] -= factor * a[i]
            x[m] -= factor * x[i]
    for i in range(n - 1, -1, -1):
        x[i] = (x[i] - a[i, i + 1 :] @ x[i + 1 :]) / a[i, i]
    return x
