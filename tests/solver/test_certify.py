"""The bound of certificates: a contact that is passed over is not touched before its time, whatever the motion."""

from __future__ import annotations

import math

import numpy as np

from synth.solver.certificates import HORIZONS, certify
from synth.solver.laws import EXACT_HOLD, coefficients
from synth.solver.stringmodel import CLOCK, StringContacts, StringModes, StringOutputs, Strung, make_string

N, C = 60, 12
DT = 1.0 / 88_200.0
LENGTH, MU = 0.86, 6.7e-3


def scene(rng: np.random.Generator):
    j = np.arange(1, N + 1)
    omega = 2 * np.pi * 98.0 * j * np.sqrt(1 + 3.5e-5 * j**2)
    sigma = rng.uniform(0.1, 200.0, N)
    x = np.sort(rng.uniform(0.05, 0.6, C))
    shapes = math.sqrt(2 / LENGTH) * np.sin(np.outer(x, j) * np.pi / LENGTH)
    eta = -rng.uniform(0.3e-3, 4e-3, C)
    q = rng.normal(size=N) * 2e-3 / j**1.5
    v = omega * rng.normal(size=N) * 2e-3 / j**1.5
    return omega, sigma, shapes, eta, q, v


def strung(omega, sigma, shapes, eta, q, v, now: int) -> Strung:
    coef, none = coefficients(EXACT_HOLD, omega, sigma, MU, DT), np.zeros((0, N))
    modes, under = StringModes(MU, omega, sigma), StringContacts(shapes, eta, np.zeros((C, C)))
    string = Strung(make_string(EXACT_HOLD, DT, modes, coef, under, StringOutputs(none)), q, v, 1)
    string.state.counts[CLOCK] = now
    return string


def test_what_is_passed_over_stays_clear() -> None:
    rng = np.random.default_rng(3)
    passed_over = long = kept = 0
    for _ in range(300):
        omega, sigma, shapes, eta, q, v = scene(rng)
        scale = 10 ** rng.uniform(-1.5, 0.5)
        q, v = scale * q, scale * v
        string = strung(omega, sigma, shapes, eta, q, v, 800)
        looked, until, margin, *_ = string.state.certificates
        until[:] = 800
        certify(*string.addresses, string.state.q[:N], string.state.v[:N])
        assert np.all(until >= 800 + HORIZONS[1])
        coef = coefficients(EXACT_HOLD, omega, sigma, MU, DT)
        for step in range(1, HORIZONS[0] + 1):
            q, v = coef[0] * q + coef[1] * v, coef[2] * q + coef[3] * v
            sure = (looked == 0) & (800 + step <= until)
            assert np.all((shapes @ q)[sure] >= (eta + margin)[sure])
        passed_over += int((looked == 0).sum())
        long += int(((looked == 0) & (until > 800 + HORIZONS[1])).sum())
        kept += int(looked.sum())
    assert passed_over > 300 and long > 100 and kept > 300  # the bound is neither blind nor idle


def test_certificates_hold_until_their_time() -> None:
    omega, sigma, shapes, eta, q, v = scene(np.random.default_rng(4))
    string = strung(omega, sigma, shapes, eta + 1.0, q, v, 8)
    looked, until, margin, *_ = string.state.certificates
    looked[:], until[:], margin[:] = 0, 9, 0.5
    certify(*string.addresses, string.state.q[:N], string.state.v[:N])
    assert looked.sum() == 0 and np.all(until == 9) and np.all(margin == 0.5)
    string.state.counts[CLOCK] = 9
    certify(*string.addresses, string.state.q[:N], string.state.v[:N])
    assert looked.sum() == C
