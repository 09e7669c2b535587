"""Measures against signals whose answer is known."""

import numpy as np
import pytest

from synth.dsp import measures as ms


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
    with pytest.raises(ValueError, match=r"u must last at least 0\.049 s, got 0\.01 s"):
        ms.third_octave_distance(t[:441] + 1.0, t[:441] + 1.0, 44100)


def test_log_spectral_distance_sees_the_last_samples():
    ref = np.random.default_rng(1).standard_normal(10001)
    u = ref.copy()
    # Whole frames end at 9728; a measure that left the rest out would say exactly 0.
    u[-270:] = 0
    assert ms.log_spectral_distance(u, ref, 44100) > 0.1


def test_the_window_is_blackmans_and_harriss():
    """0.35875 − 0.48829 cos + 0.14128 cos 2 − 0.01168 cos 3: 6e-5 at its ends, 1 in its middle, 0.217470 half way."""
    window = ms.blackman_harris(9)
    assert window == pytest.approx(window[::-1], abs=1e-15)
    assert window[[0, 4]] == pytest.approx([6e-5, 1.0], abs=1e-12)
    assert window[2] == pytest.approx(0.35875 - 0.14128, abs=1e-12)
    assert ms.blackman_harris(1) == pytest.approx([6e-5], abs=1e-12)


def test_power_of_frames():
    # of a constant 1 a Hann window of 8 samples has 4 at DC and 2 beside it; 19 samples are frames at 0, 4, 8 and 12
    power = ms.stft_power(np.ones(19), 8, 4)
    assert power.shape == (4, 5)
    for frame in power[:3]:
        assert frame == pytest.approx([16.0, 4.0, 0.0, 0.0, 0.0], abs=1e-12)
    # the last is filled up with zeros: its sum is that of seven samples of the window
    assert power[3, 0] == pytest.approx((4.0 - 0.5 * (1.0 - np.cos(2 * np.pi * 7 / 8))) ** 2)
    assert ms.stft_power(np.ones(16), 8, 4).shape == (3, 5) and ms.stft_power(np.ones(3), 8, 4).shape == (1, 5)


def test_log_spectral_distance_counts_bins_from_the_first_to_the_highest():
    """A frame of white noise with one bin raised: nothing of it at DC, and nothing above the highest."""
    rng = np.random.default_rng(2)
    ref = rng.standard_normal(4096)
    tone = 50.0 * np.cos(2 * np.pi * np.arange(4096) / 64 * 8)  # bin 8 of 64 and its two neighbours

    def distance(hz):
        return ms.log_spectral_distance(ref + tone, ref, 64.0, size=64, hop=64, highest_hz=hz)

    assert distance(6.0) < 1e-9
    # 7, 8, 9, then bins that are as they were: the mean falls as their number rises
    of_bins = [distance(hz) ** 2 * hz for hz in (9.0, 10.0, 32.0)]
    assert of_bins == pytest.approx([of_bins[0]] * 3, rel=1e-6) and distance(8.0) ** 2 * 8.0 < 0.9 * of_bins[0]
    assert distance(1000.0) == distance(32.0)  # half the rate is the last
    assert ms.log_spectral_distance(ref + 5.0, ref, 64.0, size=64, hop=64, highest_hz=0.5 + 1.0) > 1.0


def test_signals_that_are_none():
    for x in (np.zeros(0), 1.0, np.ones((3, 1))):
        with pytest.raises(ValueError, match="x must be a signal with one dimension, got shape"):
            ms.dc(x)
    with pytest.raises(ValueError, match="x must be finite, got 2 NaN or infinite samples"):
        ms.dc([1.0, np.nan, np.inf])
    with pytest.raises(ValueError, match="f0_hz must be positive and n at least 1, got 0 Hz and 1"):
        ms.partials(np.ones(100), 100.0, 0.0, 1)
    with pytest.raises(ValueError, match="got 10 Hz and 0"):
        ms.partials(np.ones(100), 100.0, 10.0, 0)


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


def test_the_grid_of_a_spectrum():
    """Padded to the next power of two at least; a constant of 1 shows as 2 at 0 Hz: an amplitude is that of a sine."""
    frequencies, amplitude = ms.spectrum(np.ones(1000), 1000.0)
    assert frequencies[1] == 1000.0 / 4096 and frequencies[-1] == 500.0 and amplitude[0] == pytest.approx(2.0)
    assert ms.spectrum(np.ones(1024), 1000.0, padding=1)[0][1] == 1000.0 / 1024
    assert ms.spectrum(np.ones(1025), 1000.0, padding=1)[0][1] == 1000.0 / 2048


def test_band_edges_belong_to_the_band_above():
    rate = 1000
    x = np.sin(2 * np.pi * 100 * np.arange(1000) / rate)
    assert ms.band_levels_db(x, rate, [50, 100, 150])[1] == pytest.approx(10 * np.log10(0.5), abs=1e-9)
    assert ms.band_levels_db(x, rate, [50, 100, 150])[0] < -250
    # half the rate is there once: no negative frequency doubles it
    nyquist = (-1.0) ** np.arange(1000)
    assert ms.band_levels_db(nyquist, rate, [400, 501]) == pytest.approx([0.0], abs=1e-9)
    assert np.isneginf(ms.band_levels_db(np.zeros(10), rate, [0, 500])[0])


def test_a_partial_is_looked_for_within_its_share_of_the_fundamental():
    rate = 44100
    t = np.arange(rate) / rate
    x = np.sin(2 * np.pi * 100 * t) + 0.1 * np.sin(2 * np.pi * 235 * t)
    assert np.isneginf(ms.partials(x, rate, 100.0, 2)[1][1])
    found, levels = ms.partials(x, rate, 100.0, 2, search=0.4)
    assert found[1] == pytest.approx(235.0, abs=0.01) and levels == pytest.approx([0.0, -20.0], abs=0.01)
    # 85 dB below the loudest is the end: what is fainter may be a sidelobe of the window
    for db, there in ((-80.0, True), (-90.0, False)):
        y = np.sin(2 * np.pi * 100 * t) + 10 ** (db / 20) * np.sin(2 * np.pi * 200 * t)
        assert np.isfinite(ms.partials(y, rate, 100.0, 2)[1][1]) == there


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


def test_the_flank_of_a_partial_outside_the_range_is_none():
    rate = 44100
    t = np.arange(2 * rate) / rate
    for hz in (104.0, 96.0):  # ±60 cents of 100 Hz are 96.6 and 103.5 Hz
        with pytest.raises(ValueError, match="no partial found"):
            ms.sounding_fundamental(np.sin(2 * np.pi * hz * t), rate, 100.0)


def test_a_string_beside_does_not_move_the_pitch():
    """20 Hz off and half as loud, in less than a second."""
    rate = 44100
    t = np.arange(int(0.9 * rate)) / rate
    x = np.sin(2 * np.pi * 220.0 * t) + 0.5 * np.sin(2 * np.pi * 243.0 * t + 1.0)
    assert abs(cents(ms.sounding_fundamental(x, rate, 220.0), 220.0)) < 0.01


def test_what_lies_40_decibels_down_does_not_count():
    rate = 44100
    t = np.arange(6 * rate) / rate
    # from the maximum of the envelope, which the window, 0.13 s long, has 1.3 dB below the beginning
    for plateau_db, heard in ((-42.0, False), (-40.0, True)):
        level = np.maximum(-20.0 * t, plateau_db)
        hz = np.where(level > plateau_db, 300.0, 301.0)
        x = 10 ** (level / 20) * np.sin(2 * np.pi * np.cumsum(hz) / rate)
        assert (cents(ms.sounding_fundamental(x, rate, 300.0), 300.0) > 1.0) == heard


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


def test_the_line_runs_between_the_levels_asked_for():
    """10 dB/s down to −20 dB, 40 dB/s from there on: which of them is measured is the caller's to say."""
    rate, f1 = 44100, 400.0
    t = np.arange(3 * rate) / rate
    level = -np.minimum(10.0 * t, 20.0) - 40.0 * np.maximum(t - 2.0, 0.0)
    x = 10 ** (level / 20) * np.sin(2 * np.pi * f1 * t)
    for fit_db, t60 in (((-2.0, -18.0), 6.0), ((-25.0, -50.0), 1.5)):
        assert ms.decay_time_s(x, rate, f1, fit_db=fit_db) == pytest.approx(t60, rel=0.01)
        assert ms.decay_times_s(x, rate, [f1], bandwidth_hz=0.8 * f1, fit_db=fit_db) == pytest.approx([t60], rel=0.01)
        assert ms.decay_time_s(x, rate, fit_db=fit_db) == pytest.approx(t60, rel=0.05)


def test_a_decay_time_is_that_from_3_to_33_decibels():
    """10 dB/s before and after, 40 dB/s between: a decibel more or less of the others is seen."""
    rate, f1 = 44100, 400.0
    t = np.arange(2 * rate) / rate
    level = -np.interp(t, [0.0, 0.3, 1.05, 2.0], [0.0, 3.0, 33.0, 42.5])
    x = 10 ** (level / 20) * np.sin(2 * np.pi * f1 * t)
    assert ms.decay_time_s(x, rate, f1) == pytest.approx(1.5, rel=0.01)
    assert ms.decay_times_s(x, rate, [f1], bandwidth_hz=0.8 * f1) == pytest.approx([1.5], rel=0.01)


def test_a_rise_has_no_decay_time():
    rate = 44100
    t = np.arange(rate) / rate
    for frequency in (100.0, None):
        with pytest.raises(ValueError, match="got 0 pieces; measure a longer signal"):
            ms.decay_time_s(np.exp(3 * t) * np.sin(2 * np.pi * 100 * t), rate, frequency)
    for bad in (0.0, rate / 2):
        with pytest.raises(ValueError, match="frequency_hz must lie between 0 and 22050 Hz"):
            ms.decay_time_s(t, rate, bad)
        with pytest.raises(ValueError, match="frequencies_hz must lie between 0 and 22050 Hz"):
            ms.decay_times_s(t, rate, [bad], bandwidth_hz=80.0)
    # four windows of 20 pieces a second: 5 ms each would do, 50 ms do not
    with pytest.raises(ValueError, match="got silence or less than 50 ms"):
        ms.decay_time_s(np.ones(2204), rate)


def test_slow_signals():
    """What lies below 1 Hz is measured as all else is: 0.5 Hz at 100 samples a second, down by 20 dB in 30 s."""
    rate = 100.0
    t = np.arange(3000) / rate
    x = np.exp(-np.log(10.0) / 30.0 * t) * np.sin(2 * np.pi * 0.5 * t)
    assert ms.sounding_fundamental(x, rate, 0.5) == pytest.approx(0.5, rel=1e-4)
    assert ms.decay_time_s(x, rate, 0.5, fit_db=(-2.0, -12.0)) == pytest.approx(90.0, rel=0.01)
    assert ms.decay_times_s(x, rate, [0.5], bandwidth_hz=0.4, fit_db=(-2.0, -12.0)) == pytest.approx([90.0], rel=0.01)


def test_the_shortest_signals_that_can_be_measured():
    """12 periods for a pitch; for a decay the window, 4 bins to each side of its middle."""
    rate, f1 = 44100, 441.0
    x = np.sin(2 * np.pi * f1 * np.arange(rate) / rate) * np.exp(-3.0 * np.arange(rate) / rate)
    assert abs(cents(ms.sounding_fundamental(x[:1200], rate, f1), f1)) < 5.0
    with pytest.raises(ValueError, match="at least 12 periods of 441 Hz, got 12;"):
        ms.sounding_fundamental(x[:1199], rate, f1)
    # 4 / (0.8 · 441 Hz) are 500 samples, and one to make it odd
    with pytest.raises(ValueError, match=r"at least 0\.0114 s to resolve 441 Hz, got 0\.0113 s"):
        ms.decay_time_s(x[:500], rate, f1)
    with pytest.raises(ValueError, match="to be fitted, got 0 pieces"):
        ms.decay_time_s(x[:501], rate, f1)
    with pytest.raises(ValueError, match=r"at least 0\.0114 s for partials 352\.8 Hz wide, got 0\.0113 s"):
        ms.decay_times_s(x[:500], rate, [f1], bandwidth_hz=352.8)


def test_a_fundamental_is_followed_as_deep_as_was_asked_for():
    """20 dB down the pitch jumps: 40 dB hear both, 10 dB the beginning alone."""
    rate = 44100
    t = np.arange(4 * rate) / rate
    hz = np.where(t < 2.0, 300.0, 301.0)
    x = 10 ** (-0.5 * t) * np.sin(2 * np.pi * np.cumsum(hz) / rate)
    assert abs(cents(ms.sounding_fundamental(x, rate, 300.0, depth_db=10.0), 300.0)) < 0.05
    assert 1.0 < cents(ms.sounding_fundamental(x, rate, 300.0), 300.0) < 5.0
    # and it is looked for as far away as was asked for
    for away, within in ((30.0, 40.0), (90.0, 100.0)):
        expected = 300.0 * 2 ** (away / 1200)
        assert abs(cents(ms.sounding_fundamental(x[: 2 * rate], rate, expected, search_cents=within), 300.0)) < 0.05
        with pytest.raises(ValueError, match="no partial found within"):
            ms.sounding_fundamental(x[: 2 * rate], rate, expected, search_cents=away - 10.0)


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


def test_what_a_click_is_measured_against():
    """Impulses have third differences of 1, 3, 3, 1: here, and in so many samples on one side behind the guard."""
    x = np.zeros(1000)
    x[500] = 1.0
    x[400] = 0.1
    # from 239 to 494 lie four of the small one's: an rms of 0.1 √(20/256)
    expected = 3.0 / (0.1 * np.sqrt(20 / 256))
    assert ms.click_ratios(x, [500])[0] == pytest.approx(expected, rel=1e-12)
    assert ms.click_ratios(x, [500], neighbourhood=128)[0] == pytest.approx(expected / np.sqrt(2.0), rel=1e-12)
    # as far as ±within, and no farther
    assert ms.click_ratios(x, [504])[0] == pytest.approx(expected, rel=1e-12)
    assert ms.click_ratios(x, [497])[0] == pytest.approx(expected, rel=1e-12)
    assert np.all(ms.click_ratios(x, [496, 505]) < 0.5 * expected)
    x[600] = 0.2  # the louder side counts
    assert ms.click_ratios(x, [500])[0] == pytest.approx(0.5 * expected, rel=1e-12)


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
    with pytest.raises(ValueError, match=r"positions must lie in 0…999, got -1…5"):
        ms.click_ratios(x, [-1, 5])
    assert ms.click_ratios(np.zeros(20), [0, 19]).tolist() == [0.0, 0.0]
    with pytest.raises(ValueError, match="x must hold at least 20 samples, got 19"):
        ms.click_ratios(np.zeros(19), [0])
    with pytest.raises(ValueError, match="x must hold at least 28 samples, got 27"):
        ms.click_ratios(np.zeros(27), [0], within=5)
    with pytest.raises(ValueError, match=r"positions must lie in 0…999, got 5…1000"):
        ms.click_ratios(x, [5, 1000])
