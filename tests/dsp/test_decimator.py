"""The decimator's declared figures, measured on the running kernel."""

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from synth.dsp import decimator as dec

RATES_HZ = (44100, 48000, 88200, 96000)
FACTORS = (1, 2, 3, 4, 5, 8, 24)


def run(x, rate_hz, factor, blocks=None, work_frames=128):
    """The kernel's output for a whole stream, cut into the given block lengths (output frames)."""
    taps = dec.design(rate_hz, factor)
    history = dec.new_history(factor)
    work = dec.workspace(factor, work_frames)
    frames = len(x) // factor
    out = np.full(frames, np.nan)
    done = 0
    for count in blocks or [frames]:
        written = dec.decimate(
            taps, factor, history, x[done * factor : (done + count) * factor], work, out[done : done + count]
        )
        assert written == count
        done += count
    assert done == frames
    return out


def measured_impulse_response(rate_hz, factor):
    """The filter at the internal rate, assembled from the kernel's answers to an impulse in every phase."""
    frames = 2 * dec.LATENCY_FRAMES + 2
    response = np.zeros(frames * factor)
    for phase in range(factor):
        x = np.zeros(frames * factor)
        x[phase] = 1.0
        y = run(x, rate_hz, factor)
        # Output n stands at input index n·factor, that is n·factor − phase after the impulse.
        delays = np.arange(frames) * factor - phase
        response[delays[delays >= 0]] = y[delays >= 0]
    return response


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("rate_hz", RATES_HZ)
def test_response_keeps_the_declared_figures(rate_hz, factor):
    h = measured_impulse_response(rate_hz, factor)
    size = 1 << int(np.ceil(np.log2(64 * h.size)))
    magnitude = np.abs(np.fft.rfft(h, size))
    f = np.arange(magnitude.size) * (rate_hz * factor / size)
    passband_db = 20 * np.log10(magnitude[f <= dec.PASSBAND_EDGE * rate_hz])
    assert dec.PASSBAND_EDGE * rate_hz >= 20000 - 1e-9
    assert np.max(np.abs(passband_db)) <= dec.PASSBAND_RIPPLE_DB <= 0.01
    if factor > 1:
        assert dec.STOPBAND_EDGE * rate_hz <= rate_hz - 20000 + 1e-9
        stopband = magnitude[f >= dec.STOPBAND_EDGE * rate_hz]
        assert -20 * np.log10(stopband.max()) >= dec.STOPBAND_ATTENUATION_DB >= 100


@pytest.mark.parametrize("factor", [16, 31, 64])
def test_design_keeps_the_declared_figures_at_large_factors(factor):
    h = dec.design(44100, factor)
    size = 1 << int(np.ceil(np.log2(64 * h.size)))
    magnitude = np.abs(np.fft.rfft(h, size))
    f = np.arange(magnitude.size) * (44100 * factor / size)
    assert np.max(np.abs(20 * np.log10(magnitude[f <= 20000]))) <= dec.PASSBAND_RIPPLE_DB
    assert -20 * np.log10(magnitude[f >= 24100].max()) >= dec.STOPBAND_ATTENUATION_DB


@pytest.mark.parametrize("factor", FACTORS)
def test_latency_is_as_declared_and_phase_is_linear(factor):
    h = measured_impulse_response(48000, factor)
    centre = dec.LATENCY_FRAMES * factor
    assert np.argmax(h) == centre
    # Symmetric about the declared delay to the last bit: that is linear phase, and the group delay is the
    # centre.
    assert np.array_equal(h[: 2 * centre + 1], h[: 2 * centre + 1][::-1])
    assert not np.any(h[2 * centre + 1 :])


@pytest.mark.parametrize("rate_hz", RATES_HZ)
@pytest.mark.parametrize("factor", [2, 5, 8])
def test_sines_that_would_fold_into_the_audible_band_vanish(rate_hz, factor):
    internal = rate_hz * factor
    t = np.arange(1024 * factor) / internal
    for image in range(1, factor // 2 + 1):
        for audible in (-19990.0, -3000.0, 1000.0, 19990.0):
            f = image * rate_hz + audible
            if f >= internal / 2:
                continue
            y = run(np.sin(2 * np.pi * f * t + 0.3), rate_hz, factor)[2 * dec.LATENCY_FRAMES :]
            assert np.max(np.abs(y)) <= 10 ** (-dec.STOPBAND_ATTENUATION_DB / 20)


@pytest.mark.parametrize("factor", [1, 2, 3, 8, 24])
def test_audible_sines_pass_with_the_declared_delay(factor):
    rate_hz = 44100
    n = np.arange(400 * factor)
    for f in (50.0, 997.0, 19990.0):
        y = run(np.sin(2 * np.pi * f / (rate_hz * factor) * n), rate_hz, factor)
        expected = np.sin(2 * np.pi * f / rate_hz * (np.arange(400) - dec.LATENCY_FRAMES))
        steady = slice(2 * dec.LATENCY_FRAMES, None)
        ripple = 10 ** (dec.PASSBAND_RIPPLE_DB / 20) - 1
        assert np.max(np.abs(y[steady] - expected[steady])) <= ripple + 1e-12


@pytest.mark.parametrize("factor", [2, 5, 8])
def test_agrees_with_an_ideal_resampler(factor):
    """Periodic noise with nothing between 20 and 24.1 kHz: there an FFT brick wall is the exact answer."""
    rng = np.random.default_rng(factor)
    rate_hz, frames = 44100, 512
    spectrum = rng.standard_normal(frames * factor // 2 + 1) * np.exp(2j * np.pi * rng.random(frames * factor // 2 + 1))
    f = np.arange(spectrum.size) * rate_hz / frames
    spectrum[(f > 20000) & (f < 24100)] = 0
    spectrum[[0, -1]] = 0
    period = np.fft.irfft(spectrum)
    period /= np.max(np.abs(period))
    ideal = scipy.signal.resample(period, frames)
    y = run(np.tile(period, 2), rate_hz, factor)[frames:]
    # At worst the ripple and all of the stopband's leak add up in phase.
    amplitudes = 2 * np.abs(np.fft.rfft(period)) / period.size
    bound = (10 ** (dec.PASSBAND_RIPPLE_DB / 20) - 1) * amplitudes[f <= 20000].sum()
    bound += 10 ** (-dec.STOPBAND_ATTENUATION_DB / 20) * amplitudes[f >= 24100].sum()
    assert np.max(np.abs(np.roll(ideal, dec.LATENCY_FRAMES) - y)) <= bound
    assert bound < 0.01 * np.max(np.abs(ideal))


@pytest.mark.parametrize("factor", FACTORS)
def test_kernel_matches_plain_convolution(factor):
    x = np.random.default_rng(factor).standard_normal(300 * factor)
    taps = dec.design(96000, factor)
    expected = dec.decimate_reference(taps, factor, x)
    # Both sums round in their own order: at worst one ulp of the sum of magnitudes per term.
    bound = taps.size * np.finfo(float).eps * np.max(np.convolve(np.abs(x), np.abs(taps)))
    assert np.max(np.abs(run(x, 96000, factor) - expected)) <= bound


@settings(max_examples=40)
@given(
    factor=st.sampled_from([1, 2, 3, 8, 24]),
    blocks=st.lists(st.integers(0, 300), min_size=1, max_size=8),
    work_frames=st.sampled_from([1, 2, 7, 128, 4096]),
    seed=st.integers(0, 2**32 - 1),
)
def test_any_split_gives_bitwise_the_same_samples(factor, blocks, work_frames, seed):
    x = np.random.default_rng(seed).standard_normal(sum(blocks) * factor)
    whole = run(x, 44100, factor)
    split = run(x, 44100, factor, blocks, work_frames)
    assert np.array_equal(whole.view(np.int64), split.view(np.int64))


def test_factor_one_is_a_pure_delay():
    x = np.random.default_rng(1).standard_normal(500)
    y = run(x, 44100, 1)
    assert np.array_equal(y[dec.LATENCY_FRAMES :], x[: -dec.LATENCY_FRAMES])
    assert not np.any(y[: dec.LATENCY_FRAMES])


@pytest.mark.parametrize("factor", [1, 4])
def test_silence_stays_silence(factor):
    assert not np.any(run(np.zeros(200 * factor), 44100, factor))


@pytest.mark.parametrize("factor", [1, 3, 8])
@pytest.mark.parametrize("extra", [0, 1])
def test_whole_signals_come_out_without_delay(factor, extra):
    n = 600 * factor + extra
    envelope = np.hanning(n)
    x = envelope * np.sin(2 * np.pi * 1000 / (48000 * factor) * np.arange(n))
    y = dec.decimate_signal(x, 48000, factor)
    assert y.shape == (-(-n // factor),)
    assert np.max(np.abs(y - x[::factor])) < 1e-4


def test_wrong_lengths_are_refused_and_nothing_is_touched():
    factor = 4
    taps, work = dec.design(44100, factor), dec.workspace(factor)
    history, out = np.full(taps.size - 1, 7.0), np.full(10, 7.0)
    assert dec.decimate(taps, factor, history, np.ones(41), work, out) == -1
    assert dec.decimate(taps, factor, history[1:], np.ones(40), work, out) == -1
    assert dec.decimate(taps, factor, history, np.ones(40), work[: taps.size], out) == -1
    assert np.all(history == 7.0) and np.all(out == 7.0)


@pytest.mark.parametrize(
    ("rate_hz", "factor", "words"),
    [
        (32000, 2, "rate_hz must be at least 44100 Hz"),
        (np.nan, 2, "rate_hz"),
        (44100, 0, "factor must be a whole number from 1 to 64"),
        (44100, 65, "got 65"),
        (44100, 2.5, "got 2.5"),
    ],
)
def test_design_refuses_what_it_cannot_do(rate_hz, factor, words):
    with pytest.raises(ValueError, match=words):
        dec.design(rate_hz, factor)


def test_whole_signals_must_be_one_channel():
    with pytest.raises(ValueError, match="one dimension"):
        dec.decimate_signal(np.zeros((10, 2)), 44100, 2)


@pytest.mark.parametrize("factor", [2, 3, 9, 64])
def test_every_mth_tap_but_the_middle_one_is_zero(factor):
    """What the kernel leaves out for its outputs to be the whole dot product."""
    taps = dec.design(44100, factor)
    taps[dec.LATENCY_FRAMES * factor] = 0.0
    assert not np.any(taps[::factor])
