"""The limiter: its guarantee, its silence below the ceiling, its smoothness, its independence of blocks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from synth.dsp import limiter as lim

RATE_HZ = 44100.0


def run(x, ceiling=1.0, blocks=None, release_s=0.05):
    """(output, state) for a whole stream from silence, cut into the given block lengths."""
    x = np.array(x, dtype=np.float64)
    state = lim.limiter_state(x.shape[1])
    release = lim.release_coefficient(RATE_HZ, release_s)
    done = 0
    for count in blocks or [len(x)]:
        lim.limit(*state, ceiling, release, x[done : done + count])
        done += count
    assert done == len(x)
    return x, state


def bursts(seed, frames=3000, channels=2, loudness=4.0):
    """Noise whose loudness jumps at random between far below and far above the ceiling."""
    rng = np.random.default_rng(seed)
    steps = np.repeat(loudness * 10 ** rng.uniform(-2, 0.5, frames // 100 + 1), 100)[:frames]
    return rng.standard_normal((frames, channels)) * steps[:, None]


def delayed(x):
    return np.concatenate([np.zeros((lim.LOOKAHEAD, x.shape[1])), x])[: len(x)]


@settings(max_examples=50)
@given(
    seed=st.integers(0, 2**32 - 1),
    ceiling=st.sampled_from([1.0, 0.3, 0.891, 10.0]),
    channels=st.integers(1, 3),
)
def test_no_sample_leaves_above_the_ceiling(seed, ceiling, channels):
    y, _ = run(bursts(seed, channels=channels), ceiling)
    assert np.max(np.abs(y)) <= ceiling


@pytest.mark.parametrize("shape", ["impulse", "step", "square"])
def test_the_guarantee_holds_for_hard_shapes(shape):
    x = np.zeros((1000, 2))
    if shape == "impulse":
        x[300] = 1e6, -3.0
    elif shape == "step":
        x[300:] = 7.3
    else:
        x[300:, 0] = 5.7 * np.sign(np.sin(np.arange(700)))
    y, _ = run(x)
    assert np.max(np.abs(y)) <= 1.0
    # Not by silencing everything: the loudest frame leaves at the ceiling, but for rounding.
    assert np.max(np.abs(y)) > 1.0 - 1e-9


def test_below_the_ceiling_it_is_bitwise_a_delay():
    x = np.random.default_rng(0).uniform(-1, 1, (5000, 2))
    x[100, 0], x[200, 1] = 1.0, -1.0
    y, state = run(x)
    assert np.array_equal(y, delayed(x))
    assert lim.largest_reduction_db(state) == 0.0


def test_it_returns_to_a_bitwise_delay_after_the_release():
    x = np.random.default_rng(0).uniform(-1, 1, (60000, 2))
    x[500] = 3.0
    y, _ = run(x, release_s=0.02)
    # ln(0.67/1e-7) = 16 time constants until the rest counts as none, then the two windows empty.
    settled = 500 + int(17 * 0.02 * RATE_HZ) + 3 * lim.LOOKAHEAD
    assert np.array_equal(y[settled:], delayed(x)[settled:])
    untouched = 500
    assert np.array_equal(y[:untouched], delayed(x)[:untouched])
    assert not np.array_equal(y, delayed(x))


@settings(max_examples=40)
@given(blocks=st.lists(st.integers(0, 700), min_size=1, max_size=12), seed=st.integers(0, 2**32 - 1))
def test_any_split_gives_bitwise_the_same_samples_and_state(blocks, seed):
    x = bursts(seed, frames=sum(blocks))
    whole, whole_state = run(x)
    split, split_state = run(x, blocks=blocks)
    assert np.array_equal(whole, split)
    for a, b in zip(whole_state, split_state, strict=True):
        assert np.array_equal(a, b)


@pytest.mark.parametrize("seed", range(5))
def test_kernel_matches_the_twin(seed):
    x = bursts(seed, frames=6000)
    y, _ = run(x, release_s=0.01)
    expected = lim.limit_reference(x, 1.0, lim.release_coefficient(RATE_HZ, 0.01))
    # The twin does not drop the last −140 dB of the release.
    assert np.max(np.abs(y - expected)) <= 1e-7 * np.max(np.abs(x))


def test_the_gain_has_no_steps():
    x = np.full((4000, 1), 0.5)
    x[1000:2000] = 20.0
    x[2000] = 400.0
    y, _ = run(x)
    ok = delayed(x)[:, 0] > 0
    gain = y[ok, 0] / delayed(x)[ok, 0]
    # The gain is an average of r with weights below 2/(LOOKAHEAD+2), and r rises by less than 1 in a window.
    assert np.max(np.abs(np.diff(gain))) <= 2.0 / (lim.LOOKAHEAD + 2)
    # Its slope bends smoothly too: the raised cosine's slope changes it by less than π·2/(D+2)².
    assert np.max(np.abs(np.diff(gain, 2))) <= 2 * np.pi / (lim.LOOKAHEAD + 2) ** 2 * 2


def test_the_release_is_exponential_with_the_given_time_constant():
    release_s = 0.05
    x = np.full((20000, 1), 0.5)
    x[1000] = 2.0
    y, _ = run(x, release_s=release_s)
    reduction = 1.0 - y[:, 0] / np.maximum(delayed(x)[:, 0], 0.5)
    start = 1000 + 4 * lim.LOOKAHEAD
    frames = int(release_s * RATE_HZ)
    ratio = reduction[start + frames] / reduction[start]
    assert ratio == pytest.approx(np.exp(-frames / (release_s * RATE_HZ)), rel=1e-9)


def test_channels_share_one_gain():
    x = bursts(3)
    x[:, 1] = 0.25 * x[:, 0]
    y, _ = run(x)
    # Equal up to rounding and the last-ulp clamp.
    assert np.allclose(y[:, 1], 0.25 * y[:, 0], rtol=1e-14, atol=0)


def test_largest_reduction_is_reported():
    x = np.full((1000, 2), 0.1)
    x[500] = 4.0, 0.0
    _, state = run(x, ceiling=0.5)
    assert lim.largest_reduction_db(state) == pytest.approx(20 * np.log10(8.0), abs=1e-9)


def test_not_a_number_passes_and_does_not_stay():
    x = np.full((1000, 2), 0.5)
    x[400, 0] = np.nan
    y, _ = run(x)
    bad = np.argwhere(np.isnan(y))
    assert bad.tolist() == [[400 + lim.LOOKAHEAD, 0]]


def test_bad_arguments_are_refused():
    with pytest.raises(ValueError, match="channels must be at least 1"):
        lim.limiter_state(0)
    with pytest.raises(ValueError, match="must be positive"):
        lim.release_coefficient(44100, 0.0)
