"""Measures against signals whose answer is known."""

import numpy as np
import pytest

from synth import measures as ms


def cents(f, f_ref):
    return 1200 * np.log2(f / f_ref)


def stiff_string(rate_hz, f1, seconds, inharmonicity=1e-4, decay_per_s=1.0, seed=0, amplitude=1.0):
    """(signal, frequencies, amplitudes) of a decaying stiff string; its first partial is not its loudest."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate_hz)) / rate_hz
    k = np.arange(1, 40)
    f = f1 * k * np.sqrt((1 + inharmonicity * k**2) / (1 + inharmonicity))
    f = f[f < 0.45 * rate_hz]
    a = amplitude * np.where(np.arange(f.size) == 0, 1.0, 3.0) / np.sqrt(np.arange(1, f.size + 1))
    x = np.zeros(t.size)
    for i in range(f.size):
        envelope = a[i] * np.exp(-decay_per_s * (1 + 0.3 * i) * t)
        x += envelope * np.sin(2 * np.pi * f[i] * t + rng.uniform(0, 2 * np.pi))
    return x, f, a


# --- errors -------------------------------------------------------------------------------------------------


def test_relative_error_of_known_disturbances():
    ref = np.random.default_rng(0).standard_normal(1000)
    assert ms.relative_error(ref, ref) == 0.0
    assert ms.relative_error(1.1 * ref, ref) == pytest.approx(0.1, rel=1e-12)
    assert ms.relative_error(np.zeros(1000), ref) == pytest.approx(1.0, rel=1e-12)
    # It is relative to the reference, not to the mean of both.
    assert ms.relative_error([3.0, 4.0], [0.0, 4.0]) == pytest.approx(0.75)
    assert ms.relative_error(np.stack([ref, ref]), np.stack([ref, -ref])) == pytest.approx(np.sqrt(2))
    assert np.isnan(ms.relative_error([np.nan, 1.0], [1.0, 1.0]))


def test_relative_error_refuses_what_has_none():
    with pytest.raises(ValueError, match="same shape"):
        ms.relative_error(np.zeros(3), np.ones(4))
    with pytest.raises(ValueError, match="silent"):
        ms.relative_error(np.ones(3), np.zeros(3))


def test_audible_band_error_does_not_see_what_nobody_hears():
    rate, factor = 44100.0, 4
    n = np.arange(4000 * factor)
    window = np.hanning(n.size)
    ref = window * np.sin(2 * np.pi * 1000 / (rate * factor) * n)
    above = window * np.sin(2 * np.pi * 30000 / (rate * factor) * n)
    below = window * np.sin(2 * np.pi * 5000 / (rate * factor) * n)
    assert ms.relative_error(ref + 0.5 * above, ref) == pytest.approx(0.5, rel=1e-3)
    # 0.5 · 10^(−105/20)
    assert ms.audible_band_error(ref + 0.5 * above, ref, rate, factor) < 3e-6
    assert ms.audible_band_error(ref + 0.5 * below, ref, rate, factor) == pytest.approx(0.5, rel=1e-3)


def test_audible_band_error_compares_different_internal_rates():
    rate = 44100.0
    signals = []
    for factor in (2, 7):
        n = np.arange(4000 * factor)
        signals.append(np.hanning(n.size + 1)[:-1] * np.sin(2 * np.pi * 1000 / (rate * factor) * n))
    error = ms.audible_band_error(signals[0], signals[1], rate, 2, 7)
    # The windows differ by half a sample in length: that, and the ripple, is all.
    assert error < 1e-3
    with pytest.raises(ValueError, match="same shape"):
        ms.audible_band_error(signals[0], signals[1], rate, 2, 8)


def test_log_spectral_distance_is_the_gain_for_a_change_of_gain():
    ref = np.random.default_rng(1).standard_normal(30000)
    assert ms.log_spectral_distance(ref, ref, 44100) == 0.0
    # Of white noise nothing reaches the floor.
    assert ms.log_spectral_distance(ref * 10 ** (3 / 20), ref, 44100) == pytest.approx(3.0, abs=1e-9)
    assert ms.log_spectral_distance(-ref, ref, 44100) == pytest.approx(0.0, abs=1e-9)


def test_log_spectral_distance_stops_at_the_floor_and_at_20_khz():
    rate = 48000
    n = np.arange(2048 * 10)
    # Frequencies at the middle of a bin, so that the window's sidelobes vanish.
    bin_hz = rate / 2048
    ref = np.sin(2 * np.pi * 40 * bin_hz / rate * n)[: 2048 * 10]
    quiet = 10 ** (-75 / 20) * np.sin(2 * np.pi * 400 * bin_hz / rate * n)
    inaudible = 0.5 * np.sin(2 * np.pi * 900 * bin_hz / rate * n)
    heard = 10 ** (-50 / 20) * np.sin(2 * np.pi * 400 * bin_hz / rate * n)
    assert ms.log_spectral_distance(ref + quiet, ref, rate) < 1e-6
    assert ms.log_spectral_distance(ref + inaudible, ref, rate) < 1e-3
    # 20 dB over the floor in the middle bin, 14 in its two neighbours, out of 853 bins.
    bins = int(20000 / bin_hz)
    middle, beside = 20.0, 20.0 + 20 * np.log10(0.5)
    expected = np.sqrt((middle**2 + 2 * beside**2) / bins)
    assert ms.log_spectral_distance(ref + heard, ref, rate) == pytest.approx(expected, rel=1e-3)


def test_third_octave_distance_hears_levels_and_not_phases():
    rng = np.random.default_rng(3)
    spectrum = rng.standard_normal(11026) + 1j * rng.standard_normal(11026)
    x = np.fft.irfft(spectrum)
    assert ms.third_octave_distance(x, x, 44100) == 0.0
    assert ms.third_octave_distance(2 * x, x, 44100) == pytest.approx(20 * np.log10(2.0), rel=1e-9)
    turned = np.fft.irfft(spectrum * np.exp(2j * np.pi * rng.random(11026)))
    # but for the bins at DC and half the rate, which have no phase to turn and lie in no band that matters
    assert ms.third_octave_distance(turned, x, 44100) < 0.01
    assert ms.relative_error(turned, x) > 1.0


def test_third_octave_distance_is_one_band_of_24_or_the_floor():
    t = np.arange(22050) / 44100
    low, high = np.sin(2 * np.pi * 100 * t), np.sin(2 * np.pi * 3000 * t)
    # one band down by 10 dB; one gone, which counts as far as the floor
    assert ms.third_octave_distance(low + high * 10**-0.5, low + high, 44100) == pytest.approx(10 / np.sqrt(24), rel=1e-6)
    assert ms.third_octave_distance(low, low + high, 44100) == pytest.approx(70 / np.sqrt(24), rel=1e-6)
    with pytest.raises(ValueError, match=r"u must last 0\.049 s at least, got 0\.01 s"):
        ms.third_octave_distance(t[:441] + 1.0, t[:441] + 1.0, 44100)


def test_log_spectral_distance_sees_the_last_samples():
    ref = np.random.default_rng(1).standard_normal(10001)
    u = ref.copy()
    # Whole frames end at 9728; a measure that left the rest out would say exactly 0.
    u[-270:] = 0
    assert ms.log_spectral_distance(u, ref, 44100) > 0.1


# --- spectra ------------------------------------------------------------------------------------------------


def test_spectrum_of_a_sine_peaks_at_its_amplitude():
    rate, f = 44100, 1234.5
    x = 0.3 * np.sin(2 * np.pi * f / rate * np.arange(8192))
    frequencies, amplitude = ms.spectrum(x, rate, padding=8)
    i = np.argmax(amplitude)
    # On a grid eight times finer than a bin the peak is missed by 1/16 bin at most: 0.9933 ≥ 1 − (π/16)²·0.3.
    assert abs(frequencies[i] - f) <= rate / 8192 / 16 * 1.01
    assert amplitude[i] == pytest.approx(0.3, rel=0.02)


def test_band_levels():
    rate = 48000
    n = np.arange(48000)
    x = 0.25 + np.sin(2 * np.pi * 100 / rate * n) + 0.1 * np.sin(2 * np.pi * 5000 / rate * n)
    levels = ms.band_levels_db(x, rate, [0, 50, 1000, 8000, 24001])
    assert levels[:3] == pytest.approx([20 * np.log10(0.25), 10 * np.log10(0.5), 10 * np.log10(0.005)], abs=1e-6)
    assert levels[3] < -250
    # Parseval: all bands together are the mean square, for an odd length too.
    y = np.random.default_rng(0).standard_normal(1001)
    assert 10 ** (ms.band_levels_db(y, rate, [0, rate])[0] / 10) == pytest.approx(np.mean(y**2), rel=1e-12)


@pytest.mark.parametrize("f1", [41.3, 110.2, 523.0])
def test_partials_follow_a_stiff_string(f1):
    rate = 44100
    k = np.arange(1, 31)
    f = f1 * k * np.sqrt((1 + 5e-4 * k**2) / (1 + 5e-4))
    a = 0.5 / k
    t = np.arange(2 * rate) / rate
    x = sum(ai * np.cos(2 * np.pi * fi * t + i) for i, (fi, ai) in enumerate(zip(f, a, strict=True)))
    # At the thirtieth the string is 17 % sharp: five whole partials away from the harmonic.
    assert f[-1] > 35 * f1
    found, levels = ms.partials(x, rate, f1, 30)
    # A parabola through the logarithm of this window is off by up to 0.004 bins of the padded transform here.
    assert np.max(np.abs(found - f)) < 0.01 / 2
    assert np.max(np.abs(levels - 20 * np.log10(a))) < 0.01


def test_partials_that_are_missing():
    rate = 44100
    t = np.arange(rate) / rate
    x = np.sin(2 * np.pi * 200 * t) + np.sin(2 * np.pi * 600 * t)
    found, levels = ms.partials(x, rate, 200.0, 3)
    assert found[[0, 2]] == pytest.approx([200.0, 600.0], abs=0.01)
    assert np.isneginf(levels[1]) and found[1] == pytest.approx(400.0, abs=0.02)
    found, levels = ms.partials(x, rate, 9000.0, 4)
    assert np.all(np.isneginf(levels[2:]))


# --- pitch --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [44100, 96000])
@pytest.mark.parametrize("note_hz", [27.5, 41.203, 65.4, 146.83, 440.0, 2093.0])
def test_fundamental_of_a_decaying_stiff_string_among_louder_partials_dc_and_noise(note_hz, rate_hz):
    rng = np.random.default_rng(int(note_hz))
    for detune in (-55.0, 1.7, 40.0):
        f1 = note_hz * 2 ** (detune / 1200)
        x, _, _ = stiff_string(rate_hz, f1, 1.8, seed=int(note_hz))
        x += 0.5 + 1e-3 * rng.standard_normal(x.size)
        assert abs(cents(ms.sounding_fundamental(x, rate_hz, note_hz), f1)) < 0.05


def test_fundamental_is_found_ten_times_better_without_noise():
    for note_hz in (41.203, 110.0, 880.0):
        x, _, _ = stiff_string(44100, note_hz, 1.8)
        assert abs(cents(ms.sounding_fundamental(x, 44100, note_hz * 1.01), note_hz)) < 0.005


@pytest.mark.parametrize("note_hz", [41.203, 110.0, 440.0])
def test_fundamental_of_a_slow_glide_is_its_average_over_time(note_hz):
    """A linear glide by 10 cents while the amplitude falls 20 dB: the loud beginning must not weigh more."""
    rate, seconds = 44100, 1.8
    t = np.arange(int(rate * seconds)) / rate
    glide = note_hz * (2 ** (10 / 1200) - 1)
    phase = 2 * np.pi * (note_hz * t + glide * (t - t**2 / (2 * seconds)))
    decay = np.log(10) / seconds
    x = np.exp(-decay * t) * np.sin(phase) + 2 * np.exp(-1.2 * decay * t) * np.sin(2 * phase + 1)
    assert abs(cents(ms.sounding_fundamental(x, rate, note_hz), note_hz + glide / 2)) < 0.05


def test_fundamental_is_not_drawn_away_by_noise_after_the_note():
    rate, f1 = 44100, 196.0
    x, _, _ = stiff_string(rate, f1, 4.0, decay_per_s=12.0)
    x += 1e-4 * np.random.default_rng(5).standard_normal(x.size)
    assert abs(cents(ms.sounding_fundamental(x, rate, 200.0), f1)) < 0.05


def test_fundamental_is_not_drawn_away_by_noise_before_it_swells():
    rate, f1 = 44100, 196.0
    t = np.arange(3 * rate) / rate
    swell = np.sin(np.pi / 2 * np.clip((t - 1.0) / 0.5, 0, 1)) ** 4
    x = swell * np.sin(2 * np.pi * f1 * t) + 1e-3 * np.random.default_rng(6).standard_normal(t.size)
    assert abs(cents(ms.sounding_fundamental(x, rate, 200.0), f1)) < 0.05


def test_fundamental_prefers_nothing_outside_the_range_searched():
    rate = 44100
    t = np.arange(2 * rate) / rate
    x = 1e-2 * np.sin(2 * np.pi * 100 * t) + np.sin(2 * np.pi * 112 * t)
    # Two semitones above, 40 dB louder.
    assert abs(cents(ms.sounding_fundamental(x, rate, 100.0), 100.0)) < 0.05
    with pytest.raises(ValueError, match=r"no partial found within ±60 cents of 106 Hz"):
        ms.sounding_fundamental(np.sin(2 * np.pi * 112 * t), rate, 106.0)


@pytest.mark.parametrize(
    ("x", "expected_hz", "words"),
    [
        (np.zeros(44100), 100.0, "no partial found"),
        (np.ones(4000), 100.0, "at least 12 periods of 100 Hz, got 9.07"),
        (np.ones(44100), 30000.0, "expected_hz must lie between 0 and 22050"),
        (np.full(44100, np.nan), 100.0, "x must be finite, got 44100 NaN"),
        (np.ones((44100, 2)), 100.0, "choose one channel"),
    ],
)
def test_fundamental_says_why_it_cannot_be_measured(x, expected_hz, words):
    with pytest.raises(ValueError, match=words):
        ms.sounding_fundamental(x, 44100, expected_hz)


# --- decay --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("t60", [0.5, 3.0, 20.0])
def test_decay_time_of_one_partial_among_others(t60):
    rate, f1 = 44100, 110.0
    t = np.arange(3 * rate) / rate
    rate_of = np.log(1000) / t60
    x = np.exp(-rate_of * t) * np.sin(2 * np.pi * f1 * t)
    x += 2 * np.exp(-2 * rate_of * t) * np.sin(2 * np.pi * 2.003 * f1 * t) + 0.1
    assert ms.decay_time_s(x, rate, f1) == pytest.approx(t60, rel=1e-3)
    assert ms.decay_time_s(x - 0.1, rate, 2.003 * f1, bandwidth_hz=0.8 * f1) == pytest.approx(t60 / 2, rel=1e-3)


def test_decay_time_of_the_whole_signal():
    rate, t60 = 44100, 1.5
    t = np.arange(2 * rate) / rate
    noise = np.random.default_rng(0).standard_normal(t.size) * np.exp(-np.log(1000) / t60 * t)
    # An attack before it does not count.
    x = np.concatenate([np.linspace(0, 0.1, rate // 5), noise])
    # 2205 samples a piece: each level is known to 0.13 dB rms, 16 of them over 30 dB.
    assert ms.decay_time_s(x, rate) == pytest.approx(t60, rel=0.03)


def test_decay_time_ignores_what_lies_under_the_fit():
    rate, f1, t60 = 44100, 220.0, 1.0
    t = np.arange(4 * rate) / rate
    x = np.exp(-np.log(1000) / t60 * t) * np.sin(2 * np.pi * f1 * t)
    x += 1e-3 * np.random.default_rng(0).standard_normal(t.size)
    assert ms.decay_time_s(x, rate, f1) == pytest.approx(t60, rel=0.01)


def test_decay_times_of_many_partials_are_those_of_each():
    rate, f1 = 44100, 131.0
    x, f, _ = stiff_string(rate, f1, 2.0, decay_per_s=1.5)
    together = ms.decay_times_s(x, rate, f[:20], bandwidth_hz=0.4 * f1)
    each = [ms.decay_time_s(x, rate, frequency, bandwidth_hz=0.4 * f1) for frequency in f[:20]]
    np.testing.assert_allclose(together, each, rtol=2e-3)
    np.testing.assert_allclose(together, np.log(1000) / (1.5 * (1 + 0.3 * np.arange(20))), rtol=5e-3)


def test_decay_times_leave_out_what_does_not_decay():
    rate = 44100
    t = np.arange(rate) / rate
    x = np.sin(2 * np.pi * 500 * t) + np.exp(-3 * t) * np.sin(2 * np.pi * 900 * t)
    times = ms.decay_times_s(x, rate, [500.0, 900.0], bandwidth_hz=80.0)
    assert np.isnan(times[0]) and times[1] == pytest.approx(np.log(1000) / 3, rel=5e-3)
    with pytest.raises(ValueError, match="the signal must last at least"):
        ms.decay_times_s(x[:1000], rate, [900.0], bandwidth_hz=80.0)
    with pytest.raises(ValueError, match="frequencies_hz must lie between"):
        ms.decay_times_s(x, rate, [23000.0], bandwidth_hz=80.0)


def test_decay_time_says_why_it_cannot_be_measured():
    rate = 44100
    steady = np.sin(2 * np.pi * 100 * np.arange(rate) / rate)
    with pytest.raises(ValueError, match="must fall by more than 3 dB"):
        ms.decay_time_s(steady, rate, 100.0)
    with pytest.raises(ValueError, match="silence"):
        ms.decay_time_s(np.zeros(rate), rate)
    with pytest.raises(ValueError, match="must last at least"):
        ms.decay_time_s(steady[:200], rate, 100.0)


# --- levels and clicks --------------------------------------------------------------------------------------


def test_peak_and_dc():
    assert ms.peak([[0.5, -2.0], [1.0, 0.0]]) == 2.0
    assert ms.peak([]) == 0.0
    assert np.isnan(ms.peak([0.0, np.nan]))
    assert ms.dc([1.0, 2.0, 6.0]) == 3.0


def test_true_peak_finds_what_lies_between_the_samples():
    # A quarter of the rate, sampled 45° off its maxima: the samples reach only 0.707.
    x = np.sin(np.pi / 2 * np.arange(400) + np.pi / 4)
    window = np.hanning(400)
    assert ms.peak(window * x) < 0.7072
    assert ms.true_peak(window * x) == pytest.approx(1.0, abs=0.01)
    y = np.random.default_rng(0).uniform(-1, 1, 500)
    assert ms.true_peak(y) >= ms.peak(y)
    # Frequencies up to 0.4 of the rate at any phase, within the bound stated.
    for f in (0.01, 0.13, 0.31, 0.4):
        for phase in np.linspace(0, np.pi, 7):
            x = np.hanning(2000) * np.sin(2 * np.pi * f * (np.arange(2000) - 1000) + phase)
            assert 10 ** (-0.7 / 20) <= ms.true_peak(x) <= 1.005


def test_clicks_stand_out_and_smooth_changes_do_not():
    rate = 44100
    t = np.arange(rate) / rate
    x = sum(np.exp(-k * t) * np.sin(2 * np.pi * 110 * k * t) / k for k in range(1, 6))
    places = [5000, 12000, 20000]
    # Of a sine the third difference is a sine: √2 times its rms, for a few of them in phase √10.
    assert np.all(ms.click_ratios(x, places) < np.sqrt(10))
    for kind in ("value", "slope"):
        clicked = x.copy()
        for p in places:
            if kind == "value":
                clicked[p:] += 0.01
            else:
                clicked[p:] += 0.01 * np.arange(x.size - p)
        # The five partials' third differences, Σ k²·(2π·110/rate)³, add up to 2e-4 at most.
        assert np.all(ms.click_ratios(clicked, places) > 0.01 / 2e-4)
        # Places beside them are innocent.
        assert np.all(ms.click_ratios(clicked, np.array(places) + 1000) < np.sqrt(10))


def test_click_ratio_finds_a_jump_of_known_size():
    """A jump by A in unit noise: its third difference is 2A at most, the noise's rms √20 (1 + 9 + 9 + 1)."""
    x = np.random.default_rng(0).standard_normal(4000)
    x[2000:] += 1000.0
    assert ms.click_ratios(x, [2000])[0] == pytest.approx(2000 / np.sqrt(20), rel=0.1)
    # Where the place is known only to a few samples, it is found as well; farther away it is not.
    for place in (1998, 2002):
        assert ms.click_ratios(x, [place])[0] == pytest.approx(ms.click_ratios(x, [2000])[0], rel=0.02)
    assert ms.click_ratios(x, [1000])[0] < 4


def test_a_louder_start_without_a_jump_is_no_click():
    rate = 44100
    t = np.arange(4000) / rate
    soft = 1e-3 * np.sin(2 * np.pi * 500 * t)
    # It starts like t⁴: no jump in any difference up to the third.
    onset = np.where(t > 2000 / rate, np.sin(2 * np.pi * 500 * (t - 2000 / rate)) ** 4, 0.0)
    assert ms.click_ratios(soft + onset, [2000])[0] < 1.5
    jump = np.where(t > 2000 / rate, np.cos(2 * np.pi * 500 * (t - 2000 / rate)), 0.0)
    assert ms.click_ratios(soft + jump, [2000])[0] > 50


def test_click_ratios_at_the_edges_and_in_silence():
    assert np.array_equal(ms.click_ratios(np.zeros(1000), [0, 500, 999]), np.zeros(3))
    x = np.zeros(1000)
    x[500] = 1.0
    assert np.isinf(ms.click_ratios(x, [500])[0])
    assert ms.click_ratios(x, []).shape == (0,)
    with pytest.raises(ValueError, match=r"positions must lie in 0…999, got 5…1000"):
        ms.click_ratios(x, [5, 1000])
