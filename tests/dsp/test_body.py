"""The modal body: every peak where it was measured, as high and as narrow."""

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from synth.dsp.body import body_coefficients, body_filter, body_state


def run(coefficients, x, blocks=None):
    state = body_state(coefficients)
    out = np.zeros(len(x))
    done = 0
    for count in blocks or [len(x)]:
        body_filter(coefficients, state, x[done : done + count], out[done : done + count])
        done += count
    return out


def gain_at(coefficients, rate_hz, frequencies_hz):
    """|H| from the kernel's impulse response, long enough that its tail is below 1e-13."""
    h = run(coefficients, np.eye(1, 2**17)[0])
    assert np.max(np.abs(h[-100:])) < 1e-13 * np.max(np.abs(h))
    n = np.arange(h.size)
    return np.array([abs(h @ np.exp(-2j * np.pi * f / rate_hz * n)) for f in frequencies_hz])


@pytest.mark.parametrize("rate_hz", [44100.0, 96000.0])
@pytest.mark.parametrize(
    ("f", "q", "gain_db"), [(101.3, 12.0, 6.0), (440.0, 60.0, -14.0), (3000.0, 1.0, 0.0), (15000.0, 5.0, 3.0)]
)
def test_peak_frequency_gain_and_width_are_exact(rate_hz, f, q, gain_db):
    c = body_coefficients([f], [q], [gain_db], rate_hz)
    step = 1e-3
    around = gain_at(c, rate_hz, [f * (1 - step), f, f * (1 + step)])
    assert around[1] == pytest.approx(10 ** (gain_db / 20), rel=1e-9)
    # A true maximum: the vertex of the parabola through three points lies at the middle, but for its cubic
    # term.
    a, b, d = around
    vertex = 0.5 * (a - d) / (a - 2 * b + d)
    assert a < b > d
    assert abs(vertex) < 0.01


def test_ring_decays_at_the_rate_that_q_says():
    rate_hz, f, q = 48000.0, 200.0, 20.0
    h = run(body_coefficients([f], [q], [0.0], rate_hz), np.eye(1, 24000)[0])
    # Prony's method on every 50th sample: the poles of a damped oscillation from its samples alone.
    h = h[1::50][:60]
    (a, b), *_ = np.linalg.lstsq(np.stack([h[1:-1], h[:-2]], axis=1), h[2:], rcond=None)
    pole = np.roots([1, -a, -b])[0]
    assert np.log(abs(pole)) == pytest.approx(-np.pi * f / q * 50 / rate_hz, rel=1e-8)


def test_narrow_resonance_has_the_mobility_shape_of_the_continuous_one():
    rate_hz, f, q = 96000.0, 500.0, 25.0
    c = body_coefficients([f], [q], [0.0], rate_hz)
    at = np.array([250.0, 400.0, 490.0, 510.0, 650.0, 1000.0])
    mobility = 1 / np.abs(1 + 1j * q * (at / f - f / at))
    # The sampled form differs by O((ωT)²), at 1 kHz and 96 kHz 0.4 %.
    assert gain_at(c, rate_hz, at) == pytest.approx(mobility, rel=0.005)


def test_nothing_comes_out_at_rest_under_a_static_force():
    c = body_coefficients([80.0, 900.0], [5.0, 30.0], [0.0, 0.0], 44100.0)
    y = run(c, np.ones(44100 * 3))
    assert np.max(np.abs(y[-1000:])) < 1e-12


def test_bank_matches_scipy():
    rng = np.random.default_rng(4)
    f, q, g = rng.uniform(60, 5000, 12), rng.uniform(2, 60, 12), rng.uniform(-20, 10, 12)
    c = body_coefficients(f, q, g, 44100.0)
    x = rng.standard_normal(4000)
    expected = sum(scipy.signal.lfilter([k, -k], [1, -a, -b], x) for k, a, b in c.T)
    # Rounding is multiplied by the ring's length, about Q/(π f T) ≈ 1e4 samples.
    assert np.max(np.abs(run(c, x) - expected)) < 1e-11 * np.max(np.abs(expected))


@settings(max_examples=40)
@given(
    blocks=st.lists(st.integers(0, 300), min_size=1, max_size=8),
    modes=st.integers(0, 19),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_split_gives_bitwise_the_same_samples(blocks, modes, seed):
    rng = np.random.default_rng(seed)
    c = body_coefficients(rng.uniform(60, 5000, modes), rng.uniform(2, 60, modes), rng.uniform(-20, 10, modes), 48000.0)
    x = rng.standard_normal(sum(blocks))
    assert np.array_equal(run(c, x), run(c, x, blocks))


def test_response_is_added_to_what_is_there():
    c = body_coefficients([300.0], [10.0], [0.0], 44100.0)
    x = np.random.default_rng(0).standard_normal(100)
    out = x.copy()
    body_filter(c, body_state(c), x, out)
    assert np.array_equal(out, x + run(c, x))


def test_empty_bank_adds_nothing():
    c = body_coefficients([], [], [], 44100.0)
    assert c.shape == (3, 0)
    assert not np.any(run(c, np.ones(100)))


@pytest.mark.parametrize(
    ("f", "q", "g", "words"),
    [
        ([100.0, 200.0], [5.0], [0.0], "same length, got 2, 1 and 1"),
        (
            [23000.0],
            [5.0],
            [0.0],
            r"frequencies_hz\[0\] must lie between 0 and half the sample rate, 22050 Hz",
        ),
        ([100.0, -3.0], [5.0, 5.0], [0.0, 0.0], r"frequencies_hz\[1\].*got -3 Hz"),
        ([100.0], [0.5], [0.0], r"q\[0\] must be at least 1"),
        ([100.0], [5.0], [np.nan], r"gains_db\[0\] must be finite"),
    ],
)
def test_bad_resonances_are_refused(f, q, g, words):
    with pytest.raises(ValueError, match=words):
        body_coefficients(f, q, g, 44100.0)
