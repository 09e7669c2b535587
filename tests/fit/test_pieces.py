"""The steps of the fit one by one, on numbers whose answer is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import soundfile

from synth.fit import FitCancelled, FitRefused, estimate, fit_recording, partials, recording, report, settings
from synth.fit.estimate import Fit, Partial
from synth.fit.exponential import Bands, fit_exponential, fit_level_line
from synth.fit.losses import Losses, fit_losses, fit_terms, loss_terms
from synth.fit.partials import MeasuredPartial, Stretch, fit_stretch
from synth.fit.pitch import Peaks, best_series, find_series, follow, spectral_peaks, stretched
from synth.fit.pluck import FittedPluck, fit_pluck
from synth.fit.recording import RecordedNote, cut_note, read_recording
from synth.instrument.preset import Preset, parse_preset
from synth.physics.modes import model_decay_rates
from synth.physics.string import String
from synth.units import gain_to_db

RATE = 8000.0


def damped(t, amplitude=0.7, phase=0.4, shift=1.3, decay=2.5):
    return amplitude * np.exp(1j * phase + (2j * np.pi * shift - decay) * t)


# --- one partial --------------------------------------------------------------------------------------------


def test_an_exponential_comes_back_as_it_was() -> None:
    """Amplitude and phase are those at t = 0, before the piece begins."""
    t = 0.05 + np.arange(300) / 200.0
    for decay in (0.0, 2.5, 12.0):
        found = fit_exponential(t, damped(t, decay=decay))
        assert found is not None
        got = (found.amplitude, found.phase, found.shift_hz, found.decay)
        assert got == pytest.approx((0.7, 0.4, 1.3, decay), abs=1e-6)
        assert found.misfit < 1e-6 and (found.begin_s, found.end_s) == (t[0], t[-1])


def test_errors_of_an_exponential_are_those_of_many_tries() -> None:
    """The standard errors against the scatter over 200 tries with white noise, known to 5 %; the misfit is the noise."""
    rng = np.random.default_rng(1)
    t = np.arange(200) / 100.0
    tries = []
    for _ in range(200):
        noise = 0.02 * (rng.standard_normal(t.size) + 1j * rng.standard_normal(t.size)) / math.sqrt(2.0)
        tries.append(fit_exponential(t, damped(t) + noise))
    scatter = [float(np.std([getattr(each, name) for each in tries])) for name in ("amplitude", "shift_hz", "decay")]
    told = [
        float(np.mean([getattr(each, name) for each in tries]))
        for name in ("amplitude_error", "shift_error_hz", "decay_error")
    ]
    assert told == pytest.approx(scatter, rel=0.2)
    rms = float(np.sqrt(np.mean(np.abs(damped(t)) ** 2)))
    assert np.mean([each.misfit for each in tries]) == pytest.approx(0.02 / rms, rel=0.05)
    # samples that share their noise tell less
    shared = fit_exponential(t, damped(t) + noise, 4.0)
    assert shared.decay_error == pytest.approx(2.0 * tries[-1].decay_error, rel=1e-6)


def test_where_there_is_no_exponential() -> None:
    t = np.arange(8) / 100.0
    assert fit_exponential(t, np.zeros(8, complex)) is None
    assert fit_exponential(t[:7], damped(t[:7])) is None
    assert fit_exponential(t, damped(t)) is not None


def test_a_level_line_is_read_from_3_to_33_decibels() -> None:
    t = np.arange(2000) / 1000.0
    slope = 40.0  # dB/s
    line = fit_level_line(t, damped(t, 0.5, decay=slope * math.log(10.0) / 20.0), 0.0)
    assert line is not None
    assert line.level_db == pytest.approx(20.0 * math.log10(0.5), abs=1e-6)
    assert line.decay == pytest.approx(slope * math.log(10.0) / 20.0, rel=1e-9)
    assert line.range_db == pytest.approx(30.0, abs=0.1)
    assert line.roughness_db < 1e-9 and line.decay_error < 1e-6 and line.shift_error_hz < 1e-6
    assert line.shift_hz == pytest.approx(1.3, rel=1e-9)
    # down to 6 dB above the noise where that comes first
    noisy = fit_level_line(t, damped(t, 1.0, decay=slope * math.log(10.0) / 20.0), 10.0 ** (-26.0 / 20.0))
    assert noisy is not None and noisy.range_db == pytest.approx(17.0, abs=0.1)
    # less than six samples of it tell nothing
    short = np.arange(30) / 3.0
    assert fit_level_line(short, damped(short, decay=2.0), 0.0) is None


def test_a_bent_level_has_an_error() -> None:
    """30 dB/s for 20 dB and 10 dB/s from there on: lines that end elsewhere are steeper or flatter."""
    t = np.arange(4000) / 1000.0
    level = -np.minimum(30.0 * t, 20.0) - 10.0 * np.maximum(t - 2.0 / 3.0, 0.0)
    line = fit_level_line(t, 10.0 ** (level / 20.0) * np.exp(2j * np.pi * 0.5 * t), 0.0)
    assert line is not None
    per_db = math.log(10.0) / 20.0
    slopes = []
    for begin, end in ((3.0, 33.0), (2.0, 28.0), (5.0, 38.0)):
        use = (level < -begin) & (level >= -end)
        slopes.append(-np.polyfit(t[use], level[use], 1)[0])
    assert line.decay == pytest.approx(per_db * slopes[0], rel=0.01)
    assert line.decay_error == pytest.approx(per_db * max(abs(s - slopes[0]) for s in slopes[1:]), rel=0.05)
    assert 1.0 < line.roughness_db < 3.0


def test_an_envelope_is_the_partials_amplitude() -> None:
    """An undamped amplitude comes out as it is, a damped one raised by `gain`; neighbours and beside are not in it."""
    t = np.arange(8000) / RATE
    f0, decay = 200.0, 6.0
    x = 0.3 * np.cos(2 * np.pi * 400.7 * t + 0.2) + np.cos(2 * np.pi * 200.0 * t) + np.cos(2 * np.pi * 600.0 * t)
    bands = Bands(x, RATE, f0)
    assert bands.length == 161 and bands.gain(0.0) == pytest.approx(1.0, abs=1e-12)
    at, y = bands.envelope(400.0)
    assert at[0] >= 80.5 / RATE and at[-1] <= 1.0 - 80.5 / RATE and at.size > 400
    assert np.abs(y) == pytest.approx(np.full(at.size, 0.3), rel=2e-3)
    assert np.angle(y) == pytest.approx(np.angle(np.exp(1j * (0.2 + 2 * np.pi * 0.7 * at))), abs=5e-3)
    alone = Bands(0.3 * np.exp(-decay * t) * np.cos(2 * np.pi * 400.0 * t), RATE, f0)
    at, y = alone.envelope(400.0)
    assert np.abs(y) == pytest.approx(0.3 * bands.gain(decay) * np.exp(-decay * at), rel=2e-3)
    assert bands.gain(decay) == pytest.approx(np.exp(0.5 * (decay * 161 / RATE) ** 2 * 0.0169), rel=1e-3)
    # midway the partials to both sides are not heard: the window is twice as long
    _, beside = bands.beside(500.0)
    assert np.abs(beside).max() < 2e-3


def test_noise_beside_is_as_loud_as_noise_in_an_envelope() -> None:
    x = np.random.default_rng(3).standard_normal(80_000)
    bands = Bands(x, RATE, 200.0)
    levels = [np.sqrt(np.mean(np.abs(of(800.0)[1]) ** 2)) for of in (bands.envelope, bands.beside)]
    # some 500 independent samples: 5 %
    assert levels[1] == pytest.approx(levels[0], rel=0.15)


def test_eight_periods_are_the_least() -> None:
    Bands(np.zeros(2 * 161), RATE, 200.0)
    with pytest.raises(ValueError, match="the note must hold 8 periods of 200 Hz, got 8"):
        Bands(np.zeros(2 * 161 - 1), RATE, 200.0)


# --- the laws -----------------------------------------------------------------------------------------------


def measured(number: int, hz: float = 100.0, decay: float = 1.0, **more) -> MeasuredPartial:
    plain = MeasuredPartial(number, hz, 1e-4, -20.0, 0.1, decay, 0.01 * decay, 40.0, 0.01, True, True)
    return replace(plain, **more)


def test_frequencies_give_f0_and_b() -> None:
    truth = Stretch(82.4, 3e-4, 0.0, 0.0, 0.0)
    assert truth.frequencies_hz(1) == pytest.approx(82.4 * math.sqrt(1.0003), rel=1e-14)
    assert truth.frequencies_hz(np.array([2, 10])) == pytest.approx(
        [164.8 * math.sqrt(1.0012), 824.0 * math.sqrt(1.03)], rel=1e-14
    )
    partials = [measured(n, float(truth.frequencies_hz(n))) for n in (1, 2, 3, 5, 8, 13, 20)]
    found = fit_stretch(partials)
    assert (found.f0_hz, found.inharmonicity) == pytest.approx((82.4, 3e-4), rel=1e-9)
    assert found.spread_cents < 1e-3
    # a stretching that is none is 0 and not less
    compressed = [measured(n, 82.4 * n * (1.0 - 1e-4 * n)) for n in range(1, 9)]
    assert fit_stretch(compressed).inharmonicity == 0.0


def test_a_partial_far_beside_the_law_counts_no_more_than_one_that_is_not_near() -> None:
    truth = Stretch(82.4, 3e-4, 0.0, 0.0, 0.0)
    rng = np.random.default_rng(8)
    partials = [measured(n, float(truth.frequencies_hz(n)) * 2.0 ** (rng.normal(0.0, 0.5) / 1200.0)) for n in range(1, 21)]

    def off_by(cents: float) -> float:
        moved = replace(partials[9], hz=partials[9].hz * 2.0 ** (cents / 1200.0))
        return abs(1200.0 * math.log2(fit_stretch([*partials[:9], moved, *partials[10:]]).f0_hz / 82.4))

    assert off_by(300.0) == pytest.approx(off_by(30.0), rel=0.05) and off_by(300.0) < 0.5


def test_errors_of_f0_and_b_are_those_of_many_tries() -> None:
    rng = np.random.default_rng(2)
    truth = Stretch(110.0, 2e-4, 0.0, 0.0, 0.0)
    numbers = np.arange(1, 21)
    tries = []
    for _ in range(200):
        hz = truth.frequencies_hz(numbers) * (1.0 + 1e-4 * rng.standard_normal(20))
        tries.append(fit_stretch([measured(int(n), f, hz_error=1e-4 * f) for n, f in zip(numbers, hz, strict=True)]))
    cents = [1200.0 * math.log2(each.f0_hz / 110.0) for each in tries]
    assert np.mean([each.f0_error_cents for each in tries]) == pytest.approx(np.std(cents), rel=0.25)
    b = [each.inharmonicity for each in tries]
    assert np.mean([each.inharmonicity_error for each in tries]) == pytest.approx(np.std(b), rel=0.25)
    # scatter that the errors do not explain is the spread
    rough = truth.frequencies_hz(numbers) * 2.0 ** (3.0 * rng.standard_normal(20) / 1200.0)
    found = fit_stretch([measured(int(n), f) for n, f in zip(numbers, rough, strict=True)])
    assert 1.5 < found.spread_cents < 5.0


def test_losses_are_the_models() -> None:
    """Of a string of any length and weight: 1/μ and d/μ, the two of the material as they are."""
    string = String.from_inharmonicity(
        0.65, 2e-3 * (1.3 * 110.0) ** 2, 2e-3, 1e-4, 0.5e-3, viscoelastic_loss=4e-3, thermoelastic_q_inverse=2e-4
    )
    law = Losses(1.0 / 2e-3, 0.5e-3 / 2e-3, 4e-3, 2e-4, 0.0)
    stretch = Stretch(110.0, 1e-4, 0.0, 0.0, 0.0)
    truth = model_decay_rates(string, 30)
    assert law.decay_rates(stretch, 30) == pytest.approx(truth, rel=1e-9)
    assert loss_terms(stretch, 30).shape == (30, 4)
    found = fit_losses([measured(n, decay=float(truth[n - 1])) for n in range(1, 31)], stretch)
    assert found.decay_rates(stretch, 30) == pytest.approx(truth, rel=1e-4) and found.spread < 1e-3
    assert (found.viscoelastic_loss, found.thermoelastic_q_inverse) == pytest.approx((4e-3, 2e-4), rel=0.02)


def test_losses_follow_what_is_steady_and_decays() -> None:
    stretch = Stretch(110.0, 1e-4, 0.0, 0.0, 0.0)
    law = Losses(500.0, 0.25, 4e-3, 2e-4, 0.0)
    truth = law.decay_rates(stretch, 20)
    partials = [measured(n, decay=float(truth[n - 1])) for n in range(1, 21)]
    for n in (2, 5):
        partials[n] = replace(partials[n], decay=9.0 * partials[n].decay, steady=False)
    partials[8] = replace(partials[8], decay=-1.0)
    assert fit_losses(partials, stretch).decay_rates(stretch, 20) == pytest.approx(truth, rel=1e-3)
    # with fewer than three steady ones all that decay count; with none there is nothing to say
    few = [replace(p, steady=False) for p in partials if p.number not in (3, 6, 9)]
    assert fit_losses([*few[:-2], *(replace(p, steady=True) for p in few[-2:])], stretch).decay_rates(
        stretch, 20
    ) == pytest.approx(truth, rel=1e-3)
    assert fit_losses([measured(1, decay=0.0)], stretch) == Losses(0.0, 0.0, 0.0, 0.0, math.inf)


def test_a_term_is_never_negative_and_an_outlier_counts_little() -> None:
    n = np.arange(1.0, 21.0)
    terms = np.stack([np.ones(20), n, n**2], axis=1)
    sigma = terms @ np.array([2.0, 0.0, 0.01])
    sigma[7] *= 2.0
    found, spread = fit_terms(terms, sigma, np.full(20, 1e-3))
    assert (found >= 0.0).all() and terms @ found == pytest.approx(terms @ np.array([2.0, 0.0, 0.01]), rel=0.01)
    assert spread < 0.01
    falling, _ = fit_terms(terms, 3.0 - 0.1 * n, np.full(20, 1e-3))
    assert falling[1] == 0.0 and falling[2] == 0.0


# --- the place of plucking ----------------------------------------------------------------------------------


def comb(numbers: np.ndarray, position: float) -> np.ndarray:
    """A pluck's levels with a trend: |sin(nπp)|, 6 dB an octave, and a little of n²."""
    n = numbers.astype(float)
    return 20.0 * np.log10(np.abs(np.sin(np.pi * n * position)) + 1e-3) - 10.0 - 20.0 * np.log10(n) + 0.5 * n - 0.02 * n**2


@pytest.mark.parametrize("position", [0.07, 0.137, 0.21, 0.333, 0.482])
def test_the_place_is_that_of_the_comb(position: float) -> None:
    numbers = np.arange(1, 31)
    levels = comb(numbers, position)
    found = fit_pluck(numbers, levels, np.full(30, 0.1))
    assert found is not None and found.determined
    assert found.position == pytest.approx(position, abs=5e-4) and found.error < 0.01 and found.spread_db < 1.0
    away = np.abs(np.sin(np.pi * numbers * position)) > 0.1  # nodes are never perfect
    assert found.levels_db(numbers)[away] == pytest.approx(levels[away], abs=1.0)
    # from the other end the levels are the same, and so is the answer
    mirrored = fit_pluck(numbers, comb(numbers, 1.0 - position), np.full(30, 0.1))
    assert mirrored is not None and mirrored.position == pytest.approx(found.position, abs=1e-6)
    # a partial that something else has raised hardly moves it
    levels[4] += 15.0
    beside = fit_pluck(numbers, levels, np.full(30, 0.1))
    assert beside is not None and beside.position == pytest.approx(position, abs=2e-3)


def test_levels_that_do_not_tell_the_place() -> None:
    numbers = np.arange(1, 31)
    noise = 12.0 * np.random.default_rng(4).standard_normal(30)
    found = fit_pluck(numbers, noise, np.full(30, 0.1))
    assert found is not None and not found.determined
    flat = fit_pluck(numbers, -6.0 * np.log2(numbers), np.full(30, 0.1))  # at the very end there is no comb
    assert flat is not None and not flat.determined
    assert fit_pluck(numbers[:9], comb(numbers[:9], 0.2), np.full(9, 0.1)) is None
    ten = fit_pluck(numbers[:10], comb(numbers[:10], 0.2), np.full(10, 0.1))
    assert ten is not None and ten.trend[3] == 0.0 and ten.position == pytest.approx(0.2, abs=0.02)
    # errors of the levels widen what fits as well
    sure, unsure = (fit_pluck(numbers, comb(numbers, 0.21), np.full(30, db)) for db in (0.1, 3.0))
    assert sure is not None and unsure is not None and unsure.error > 2.0 * sure.error


# --- the series ---------------------------------------------------------------------------------------------


def peaks_of(frequencies: np.ndarray) -> Peaks:
    return Peaks(frequencies, np.zeros(frequencies.size), np.ones(frequencies.size), 0.8)


def test_a_line_through_squares_is_f0_and_b() -> None:
    n = np.array([1, 2, 4, 7, 11])
    assert stretched(n, 98.0 * n * np.sqrt(1.0 + 2e-4 * n**2)) == pytest.approx((98.0, 2e-4), rel=1e-9)
    # three tell no stretching, nor do those that are compressed; a hundredth is the most
    assert stretched(n[:3], 98.0 * n[:3] * np.sqrt(1.0 + 2e-4 * n[:3] ** 2))[1] == 0.0
    assert stretched(n, 98.0 * n * (1.0 - 1e-3 * n))[1] == 0.0
    assert stretched(n, 98.0 * n * np.sqrt(1.0 + 0.03 * n**2))[1] == 0.01


def test_a_stretched_series_is_followed_through_gaps() -> None:
    n = np.array([1, 2, 3, 5, 6, 7, 8, 10, 11, 12, 14, 15, 18])
    hz = 110.0 * n * np.sqrt(1.0 + 4e-4 * n**2)
    found = follow(peaks_of(hz), 111.0)
    assert found is not None and found.numbers.tolist() == n.tolist()
    assert (found.f0_hz, found.inharmonicity) == pytest.approx((110.0, 4e-4), rel=1e-6)
    assert found.explained == 1.0 and found.filled == pytest.approx(10 / 12)
    assert found.score == pytest.approx(0.4 + 0.6 * 10 / 12)
    # what belongs to another sound is not explained
    other = follow(peaks_of(np.append(hz, [163.0, 401.0])), 111.0)
    assert other is not None and other.explained == pytest.approx(13 / 15)
    assert follow(peaks_of(np.array([110.0])), 110.0) is None


def test_the_best_series_is_neither_half_nor_double() -> None:
    n = np.arange(1, 13)
    hz = 110.0 * n * np.sqrt(1.0 + 1e-4 * n**2)
    for expected in (None, 80.0, 150.0):
        best = best_series(peaks_of(hz), expected)
        assert best is not None and best.f0_hz == pytest.approx(110.0, rel=1e-4)
    # a pitch that is expected is looked for within half an octave
    assert best_series(peaks_of(hz[:1]), 110.0 * 1.5) is None
    octave = best_series(peaks_of(hz), 55.0)
    assert octave is not None and 38.0 < octave.f0_hz < 78.0


def test_peaks_of_a_spectrum() -> None:
    t = np.arange(8000) / RATE
    noise = 1e-5 * np.random.default_rng(5).standard_normal(t.size)
    x = np.cos(2 * np.pi * 440.3 * t) + 0.1 * np.cos(2 * np.pi * 881.0 * t) + 1e-3 * np.cos(2 * np.pi * 1320.0 * t) + noise
    found = spectral_peaks(x, RATE)
    # strongest first; 60 dB below the highest is not looked at
    assert found.frequencies_hz == pytest.approx([440.3, 881.0], abs=0.02)
    assert found.levels_db == pytest.approx([0.0, -20.0], abs=0.1) and found.resolution_hz == 1.0
    assert found.weights == pytest.approx([1.0, 1.0 - 20.0 / 60.0], abs=2e-3)
    assert spectral_peaks(noise, RATE).frequencies_hz.size < 3


# --- one note of a recording --------------------------------------------------------------------------------


def pluck(seconds: float = 1.0, hz: float = 220.0) -> np.ndarray:
    t = np.arange(round(seconds * RATE)) / RATE
    return 0.5 * np.exp(-3.0 * t) * sum(np.sin(2 * np.pi * hz * k * t) / k for k in range(1, 6))


def test_a_note_is_cut_out_from_its_onset_on() -> None:
    rng = np.random.default_rng(6)
    noise = 1e-4 * rng.standard_normal(round(1.5 * RATE))
    x = 0.1 + noise
    x[4000:] += pluck(1.0)
    note = cut_note(x, RATE)
    assert note.onset_s == pytest.approx(0.5, abs=0.011) and note.rate_hz == RATE
    assert note.samples.size == x.size - round(note.onset_s * RATE)
    assert abs(note.samples.mean()) < 1e-12
    assert note.noise_rms == pytest.approx(1e-4, rel=0.1)
    assert note.peak_dbfs == pytest.approx(20.0 * math.log10(np.abs(x).max()), abs=1e-9)
    assert note.warnings == ()
    assert cut_note(pluck(1.0), RATE).noise_rms == 0.0  # nothing before it


def test_the_ends_of_what_is_cut() -> None:
    ringing = (
        0.3
        * np.sin(2 * np.pi * 220.0 * np.arange(round(20 * RATE)) / RATE)
        * np.exp(-0.1 * np.arange(round(20 * RATE)) / RATE)
    )
    assert cut_note(ringing, RATE).samples.size == 12 * RATE
    assert cut_note(ringing[:2000], RATE).samples.size == 2000
    with pytest.raises(FitRefused, match=r"must last at least 0\.25 s, got 0\.25 s; record one pluck"):
        cut_note(ringing[:1999], RATE)
    for rate, fine in ((8000.0, True), (7999.0, False), (400_000.0, True), (400_001.0, False)):
        x = pluck(60.0 * 8000.0 / rate)[: round(1.2 * rate)]
        if fine:
            cut_note(np.tile(ringing, 10)[: round(0.3 * rate)], rate)
        else:
            with pytest.raises(FitRefused, match=f"between 8000 and 400000 Hz, got {rate:g} Hz"):
                cut_note(x, rate)


def test_numbers_that_no_recording_has() -> None:
    with pytest.raises(FitRefused, match=r"must lie within ±1e\+06 \(full scale is 1\), got 1\.1e\+06"):
        cut_note(1.1e6 * np.sign(pluck()), RATE)
    cut_note(1e6 * pluck() / np.abs(pluck()).max(), RATE)
    with pytest.raises(FitRefused, match="holds 2 samples that are not finite"):
        cut_note(np.append(pluck(), [np.inf, np.nan]), RATE)
    with pytest.raises(FitRefused, match=r"must hold samples, got an array of shape \(2, 2, 2\)"):
        cut_note(np.zeros((2, 2, 2)), RATE)


def test_silence_is_below_minus_80_decibels() -> None:
    x = pluck() / np.abs(pluck() - pluck().mean()).max()
    cut_note(1.02e-4 * x, RATE)
    with pytest.raises(FitRefused, match="the recording is silent, its peak is at -80 dBFS"):
        cut_note(0.98e-4 * x, RATE)


def test_clipping_is_three_rows_of_four() -> None:
    quiet = 0.2 * pluck()
    for length, count, clipped in ((4, 3, True), (4, 2, False), (3, 5, False)):
        y = quiet.copy()
        for k in range(count):
            y[100 + 50 * k : 100 + 50 * k + length] = 0.8
        if clipped:
            with pytest.raises(FitRefused, match="is clipped: 3 times 4 or more samples in a row stand at its limit"):
                cut_note(y, RATE)
            with pytest.raises(FitRefused, match="is clipped"):
                cut_note(-y, RATE)
        else:
            cut_note(y, RATE)


def test_of_channels_the_mixture_with_most_energy() -> None:
    x = pluck()
    alone = cut_note(x, RATE).samples
    for weights in ((1.0, 1.0), (1.0, -1.0), (0.3, 0.9), (1.0, 0.0)):
        note = cut_note(np.outer(x, weights), RATE)
        scale = float(note.samples @ alone / (alone @ alone))
        assert note.samples == pytest.approx(scale * alone, abs=1e-9)
        # a weighted mean of the channels' sizes, so that full scale stays full scale
        sizes = np.abs(weights)
        assert abs(scale) == pytest.approx(float(sizes @ sizes / sizes.sum()), rel=1e-6)
    assert cut_note(x[:, None], RATE).samples == pytest.approx(alone, abs=0.0)


def test_where_the_next_note_begins_and_where_it_is_damped() -> None:
    two = cut_note(np.concatenate([pluck(1.0), pluck(1.0)]), RATE)
    assert 0.9 <= two.samples.size / RATE <= 1.0  # a window and what it is compared with before it
    assert len(two.warnings) == 1 and "only the first note is measured: another begins" in two.warnings[0]
    x = pluck(2.0)
    x[8000:] *= np.exp(-60.0 * np.arange(8000) / RATE)
    damped_note = cut_note(x, RATE)
    assert 0.85 <= damped_note.samples.size / RATE <= 1.0
    assert len(damped_note.warnings) == 1 and "the note is cut off or damped" in damped_note.warnings[0]


# --- what is told -------------------------------------------------------------------------------------------


def fit_of(partials: tuple[Partial, ...], **more) -> Fit:
    stretch = Stretch(110.0, 1e-4, 0.01, 2e-6, 0.3)
    losses = Losses(500.0, 0.25, 4e-3, 2e-4, 0.05)
    place = FittedPluck(0.2113, 0.0042, True, 0.8, (-10.0, 0.0, 0.0, 0.0))
    plain = Fit(110.0, 1e-4, stretch, losses, place, partials, 0.1, 2.5, RATE, -6.0, -70.0, 55.4, 0.98765, ("a word",))
    return replace(plain, **more)


def partial(number: int, **more) -> Partial:
    hz = float(Stretch(110.0, 1e-4, 0.0, 0.0, 0.0).frequencies_hz(number))
    found = measured(number, hz, decay=2.0)
    return replace(Partial(number, hz, 3.0, hz, 3.1, "law", "law", 0.0, found), **more)


def test_a_report_in_numbers() -> None:
    steady = [partial(n) for n in range(1, 13)]
    steady[2] = partial(3, measured=replace(steady[2].measured, hz=steady[2].hz * 2.0 ** (6.0 / 1200.0), steady=False))
    steady[4] = partial(5, measured=None, cents=None)
    steady[5] = partial(6, measured=replace(steady[5].measured, decay=-1.0))
    told = report(fit_of(tuple(steady)))
    assert (told["note"], told["f0_hz"], told["first_partial_hz"]) == ("A2", 110.0, pytest.approx(110.005, abs=1e-3))
    assert told["note_cents"] == pytest.approx(600.0 * math.log2(1.0001), rel=1e-3)
    assert told["pluck"] == {"position": 0.2113, "error": 0.0042, "determined": True, "spread_db": 0.8}
    assert (told["duration_s"], told["onset_s"], told["snr_db"], told["explained"]) == (2.5, 0.1, 55.4, 0.9877)
    assert told["losses"]["viscoelastic_loss"] == 4e-3 and told["warnings"] == ["a word"]
    facts = {name: value for name, value, _ in told["facts"]}
    assert facts["Pitch"] == "110.01 Hz, A2 +0.1 cents" and facts["Plucked at"] == "0.211 ± 0.004 of L"
    assert facts["T60 of partial 1"] == facts["T60 of partial 10"] == "3.00 s" and "T60 of partial 12" not in facts
    assert facts["Signal over noise"] == "55 dB" and facts["Inharmonicity B"] == "0.0001 ± 2e-06"
    rows = told["partials"]
    assert [rows[4][name] for name in ("level_db", "measured_hz", "measured_t60_s", "single")] == [None] * 4
    assert rows[5]["measured_t60_s"] is None and rows[0]["measured_t60_s"] == pytest.approx(math.log(1000.0) / 2.0, rel=1e-5)
    assert (rows[2]["steady"], rows[0]["steady"], rows[0]["level_db"]) == (False, True, -20.0)
    frequency, decay, level = (told["curves"][name] for name in ("frequency", "decay", "level"))
    assert [n for n, _ in frequency["points"]] == [1, 2, 4, 6, 7, 8, 9, 10, 11, 12] and frequency["aside"][0][0] == 3
    assert frequency["aside"][0][1] == pytest.approx(6.0 + 600.0 * math.log2(1.0 + 9e-4), abs=1e-3)
    assert frequency["line"][9] == [10.0, pytest.approx(600.0 * math.log2(1.01), rel=1e-4)] and len(frequency["line"]) == 12
    assert (
        len(decay["points"]) == 9
        and len(decay["aside"]) == 1
        and decay["line"][0] == [pytest.approx(110.005, abs=1e-3), 3.1]
    )
    assert [n for n, _ in level["points"]] == [1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 12]
    at = 10.0 * math.log10(math.sin(math.pi * 0.2113) ** 2 + 1e-4) - 10.0
    assert level["line"][0] == [1.0, pytest.approx(at, abs=1e-3)]


def test_a_report_of_what_is_not_told() -> None:
    many = tuple(partial(n) for n in range(1, 71))
    told = report(fit_of(many, pluck=None))
    assert told["pluck"] is None and told["curves"]["level"]["line"] == [] and len(told["partials"]) == 60
    assert dict((name, value) for name, value, _ in told["facts"])["Plucked at"] == "not clear from the levels"
    unsure = FittedPluck(0.2, 0.1, False, 9.0, (0.0, 0.0, 0.0, 0.0))
    assert ["Plucked at", "not clear from the levels"] in [fact[:2] for fact in report(fit_of(many, pluck=unsure))["facts"]]
    endless = report(fit_of(many, losses=Losses(0.0, 0.0, 0.0, 0.0, math.inf)))
    assert endless["losses"]["spread"] is None
    # a pitch that no key has
    beyond = fit_of(many, stretch=Stretch(14000.0, 0.0, 0.0, 0.0, 0.0))
    assert report(beyond)["note"] is None and report(beyond)["facts"][0][1].startswith("14000.00 Hz,  ")


def test_the_words_of_a_fit() -> None:
    """What is told of partials that are missing, do not fall, beat or lie beside the law: of the first ten."""
    stretch = Stretch(110.0, 1e-4, 0.01, 2e-6, 0.3)
    losses = Losses(500.0, 0.25, 4e-3, 2e-4, 0.25)
    place = FittedPluck(0.2, 0.004, True, 3.0, (0.0, 0.0, 0.0, 0.0))
    plain = [partial(n).measured for n in range(1, 21)]
    assert estimate._warnings(plain, stretch, losses, place, 0.8) == []
    odd = [p for p in plain if p.number not in (4, 12)]
    odd[0] = replace(odd[0], steady=False)
    odd[1] = replace(odd[1], single=False)
    odd[4] = replace(odd[4], hz=odd[4].hz * 2.0 ** (1.6 / 1200.0))
    odd[5] = replace(odd[5], hz=odd[5].hz * 2.0 ** (-1.4 / 1200.0))
    words = estimate._warnings(odd, stretch, replace(losses, spread=0.26), replace(place, spread_db=3.2), 0.79)
    assert [each.split(":")[0] for each in words] == [
        "partial 4 is too weak to be measured, or masked by another sound",
        "partial 1 is without a single decay time",
        "partial 2 is not a single exponential (beating, or decay in stages)",
        "partial 6 is more than 1.5 cents off f0·n·√(1 + Bn²)",
        "decay rates lie 26 % (rms) off the loss law",
        "levels lie 3 dB (rms) off those of a pluck",
        "the partials explain 79 % of the sound just after the onset",
    ]
    for pluck_ in (None, replace(place, determined=False)):
        assert estimate._warnings(plain, replace(stretch, inharmonicity_error=3.4e-5), losses, pluck_, 1.0) == [
            "inharmonicity is hardly above its error of 3e-05",
            "the levels of the partials do not show where the string was plucked",
        ]


def test_what_is_no_string_by_its_partials() -> None:
    stretch = Stretch(110.0, 1e-4, 0.01, 2e-6, 20.0)
    plain = [partial(n).measured for n in range(1, 21)]

    def refused(found, stretch=stretch, explained=0.6) -> str:
        with pytest.raises(FitRefused) as told:
            estimate._refuse_what_is_no_string(found, stretch, explained, 110.0)
        return str(told.value)

    estimate._refuse_what_is_no_string(plain, stretch, 0.6, 110.0)
    estimate._refuse_what_is_no_string(plain[6:], stretch, 0.6, 110.0)
    assert "explain only 59 % of the sound" in refused(plain, explained=0.59) and "only 0 %" in refused(
        plain, explained=-1.0
    )
    assert "they lie 21 cents (rms)" in refused(plain, replace(stretch, spread_cents=21.0))
    assert "3 of the first 10 stand out" in refused(plain[7:])
    far = [replace(p, hz=p.hz * 2.0 ** (21.0 / 1200.0)) if p.number in (2, 5, 9) else p for p in plain]
    assert refused(far).startswith("partials 2, 5, 9 are more than 20 cents off the series of 110 Hz")
    estimate._refuse_what_is_no_string([*far[:8], plain[8], *far[9:]], stretch, 0.6, 110.0)
    # of the eight strongest more than half last two minutes
    lasting = [replace(p, level_db=0.0, decay=math.log(1000.0) / 121.0) if p.number <= 5 else p for p in plain]
    assert "does not decay as a plucked string does" in refused(lasting)
    estimate._refuse_what_is_no_string([*lasting[:4], *plain[4:]], stretch, 0.6, 110.0)
    unsteady = [replace(p, steady=p.number in (1, 2, 3, 4, 5, 12)) for p in plain]
    estimate._refuse_what_is_no_string(unsteady, stretch, 0.6, 110.0)
    assert "only 5 of the first 10 partials of 110 Hz decay steadily" in refused(
        unsteady, replace(stretch, inharmonicity=5e-6)
    )
    estimate._refuse_what_is_no_string(plain, replace(stretch, inharmonicity=5e-6), 0.6, 110.0)


def test_a_partial_is_its_own_where_the_law_misses_it() -> None:
    """1.5 cents in frequency; a tenth in decay time, or twice its error where that is more."""
    stretch = Stretch(110.0, 1e-4, 0.01, 2e-6, 0.3)
    losses = Losses(500.0, 0.25, 4e-3, 2e-4, 0.05)
    sigma = losses.decay_rates(stretch, 12)
    found = [measured(n, float(stretch.frequencies_hz(n)), decay=float(sigma[n - 1])) for n in range(1, 13)]
    found[0] = replace(found[0], hz=found[0].hz * 2.0 ** (1.6 / 1200.0))
    found[1] = replace(found[1], hz=found[1].hz * 2.0 ** (-1.4 / 1200.0))
    for n, share, error, single in (
        (3, 1.12, 0.01, True), (4, 1.08, 0.01, True), (5, 1.12, 0.07, True), (6, 1.12, 0.07, False),
        (7, 1.50, 0.13, True), (8, 1.50, 0.90, False), (9, 1.50, 1.10, False),
    ):  # fmt: skip
        decay = float(sigma[n - 1]) / share
        found[n - 1] = replace(found[n - 1], decay=decay, decay_error=decay * error, single=single)
    found[9] = replace(found[9], decay=-1.0)
    del found[10]
    partials = estimate._partials(found, stretch, losses)
    assert [p.number for p in partials] == list(range(1, 13))
    assert [p.number for p in partials if p.frequency_source == "measured"] == [1]
    assert [p.number for p in partials if p.decay_source == "measured"] == [3, 6, 8]
    assert partials[0].hz == found[0].hz and partials[1].hz == partials[1].hz_by_law
    assert partials[2].t60_s == pytest.approx(1.12 * math.log(1000.0) / sigma[2])
    assert partials[3].t60_s == pytest.approx(math.log(1000.0) / sigma[3])
    assert partials[0].cents == pytest.approx(-1.6) and partials[10].cents is None and partials[10].level_db is None
    assert len(estimate._partials(found[:5], stretch, losses)) == 10


def test_what_the_partials_explain() -> None:
    """Of a quarter of a second from 50 ms behind the onset."""
    t = np.arange(round(0.5 * RATE)) / RATE
    partials = [measured(n, 200.0 * n, decay=3.0 * n) for n in (1, 2)]
    x = sum(np.exp(-3.0 * n * t) * np.sin(2 * np.pi * 200.0 * n * t + n) for n in (1, 2))
    x[: round(0.05 * RATE)] = 9.0
    x[round(0.3 * RATE) :] = 9.0
    note = RecordedNote(x, RATE, 0.0, 0.0, 0.0, ())
    assert estimate._explained(note, partials) == pytest.approx(1.0, abs=1e-9)
    strange = replace(note, samples=x + 0.5 * np.sin(2 * np.pi * 317.0 * t))
    assert 0.6 < estimate._explained(strange, partials) < 0.95
    # the noise is that before the onset, or what lies between the partials
    loud = [replace(partials[0], level_db=-10.0, snr_db=50.0), replace(partials[1], snr_db=20.0)]
    assert estimate._noise_floor_dbfs(note, loud) == -60.0
    assert estimate._noise_floor_dbfs(replace(note, noise_rms=1e-4), loud) == pytest.approx(-80.0)


# --- values of a preset -------------------------------------------------------------------------------------

ONE = """format = 2
name = "one"
[[string]]
notes = "A2"
length_m = 0.65
diameter_mm = { A2 = 0.5, C4 = 0.4 }
linear_density_g_m = 2.0
%s
[pluck]
displacement_mm = 1.0
"""


def plain_fit(**more) -> Fit:
    """Partials of a string of 2 g/m and 0.65 m, a little above A2, by the laws alone."""
    string = String.from_inharmonicity(
        0.65, 2e-3 * (1.3 * 110.0) ** 2, 2e-3, 1e-4, 0.5e-3, viscoelastic_loss=4e-3, thermoelastic_q_inverse=2e-4
    )
    t60 = math.log(1000.0) / model_decay_rates(string, 12)
    return fit_of(tuple(partial(n, t60_s=float(t60[n - 1])) for n in range(1, 13)), **more)


def one(material: str = "inharmonicity = 1e-5") -> Preset:
    return parse_preset(ONE % material, "one")


def test_a_string_of_one_note_gets_pitch_stiffness_losses_and_place() -> None:
    found = dict(settings(plain_fit(), one(), 0))
    assert list(found) == [
        "string.0.cents",
        "string.0.inharmonicity",
        "string.0.viscoelastic_loss",
        "string.0.thermoelastic_q_inverse",
        "pluck.position",
    ]
    assert found["string.0.cents"] == pytest.approx(600.0 * math.log2(1.0001), abs=6e-4)
    # the model's tension is what stiffness leaves of the pitch, and B is in terms of it
    assert found["string.0.inharmonicity"] == pytest.approx(1e-4 / 1.0001, rel=1e-5)
    assert found["string.0.viscoelastic_loss"] == pytest.approx(4e-3, rel=1e-3)
    assert found["string.0.thermoelastic_q_inverse"] == pytest.approx(2e-4, rel=1e-2)
    assert found["pluck.position"] == 0.2113
    tuned_away = parse_preset(ONE % "inharmonicity = 1e-5" + "[tuning]\na4_hz = 432.0\noffset_cents = 10\n", "one")
    assert dict(settings(plain_fit(), tuned_away, 0))["string.0.cents"] == pytest.approx(
        0.087 + 1200.0 * math.log2(440.0 / 432.0) - 10.0, abs=1e-3
    )


def test_a_string_of_another_note_keeps_its_make() -> None:
    """What was a number at notes is written as it was at the string's own."""
    stretch = Stretch(138.0, 1e-4, 0.01, 2e-6, 0.3)
    partials = tuple(replace(partial(n), hz=float(stretch.frequencies_hz(n))) for n in range(1, 13))
    found = dict(settings(fit_of(partials, stretch=stretch), one(), 0))
    assert found["string.0.notes"] == "C#3" and found["string.0.diameter_mm"] == 0.5
    assert "string.0.length_m" not in found
    assert found["string.0.cents"] == pytest.approx(1200.0 * math.log2(138.0 / 138.59132) + 0.087, abs=2e-3)
    beyond = fit_of(partials, stretch=Stretch(14000.0, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"the recording's note must be one of MIDI's, got 1\.4e\+04 Hz"):
        settings(beyond, one(), 0)


def test_stiffness_is_youngs_modulus_where_the_string_has_one() -> None:
    """E = 64 EI/(π d⁴), EI = B/(1 + B) · μ (2 L f)² L²/π²; beyond all materials it is B again."""
    found = dict(settings(plain_fit(), one("youngs_modulus_gpa = 200"), 0))
    stiffness = 1e-4 / 1.0001 * 2e-3 * (1.3 * 110.0055) ** 2 * 0.65**2 / math.pi**2
    assert found["string.0.youngs_modulus_gpa"] == pytest.approx(64.0 * stiffness / (math.pi * 0.5e-3**4) / 1e9, rel=1e-4)
    thin = parse_preset((ONE % "youngs_modulus_gpa = 200").replace("A2 = 0.5", "A2 = 0.1"), "one")
    found = dict(settings(plain_fit(), thin, 0))
    assert found["string.0.youngs_modulus_gpa"] is None
    assert found["string.0.inharmonicity"] == pytest.approx(1e-4 / 1.0001, rel=1e-5)
    linear = dict(settings(plain_fit(), one('inharmonicity = 1e-5\nstiffness_law = "linear"'), 0))
    assert linear["string.0.stiffness_law"] == "sqrt"


def test_what_the_laws_miss_is_written_as_measured() -> None:
    fit = plain_fit()
    partials = list(fit.partials)
    partials[3] = replace(partials[3], hz=partials[3].hz * 2.0 ** (1.4 / 1200.0), t60_s=1.09 * partials[3].t60_s)
    paths = [path for path, _ in settings(replace(fit, partials=tuple(partials)), one(), 0)]
    assert not any("measured" in path for path in paths)
    partials[3] = replace(partials[3], hz=partials[3].hz * 2.0 ** (0.3 / 1200.0), t60_s=1.2 * partials[3].t60_s)
    found = dict(settings(replace(fit, partials=tuple(partials)), one(), 0))
    assert found["string.0.measured_frequencies_hz"] == pytest.approx([p.hz for p in partials], rel=1e-6)
    assert found["string.0.measured_decay_rates"] == pytest.approx([math.log(1000.0) / p.t60_s for p in partials], rel=1e-4)
    # of many the first, and what was written before is taken out
    many = replace(fit, partials=tuple(partials) + tuple(partial(n) for n in range(13, 41)))
    before = one("inharmonicity = 1e-5\nmeasured_decay_rates = [1.0, 2.0]")
    found = settings(many, before, 0)
    assert ("string.0.measured_decay_rates", None) in found
    assert len(dict(found)["string.0.measured_decay_rates"]) == 24


def test_a_place_is_written_where_the_levels_tell_it() -> None:
    clear = FittedPluck(0.2, 0.004, True, 3.0, (0.0, 0.0, 0.0, 0.0))
    for pluck_, written in (
        (clear, True), (replace(clear, spread_db=3.1), False), (replace(clear, determined=False), False), (None, False),
    ):  # fmt: skip
        assert ("pluck.position" in dict(settings(plain_fit(pluck=pluck_), one(), 0))) == written
    hard = parse_preset(ONE % "inharmonicity = 1e-5" + "position = 0.3\nposition_hard = 0.4\n", "one")
    assert dict(settings(plain_fit(pluck=clear), hard, 0))["pluck.position_hard"] == 0.2
    assert "pluck.position_hard" not in dict(settings(plain_fit(pluck=clear), one(), 0))


# --- a file, and the steps in turn --------------------------------------------------------------------------


def test_files_that_are_no_recording(tmp_path, monkeypatch) -> None:
    with pytest.raises(FileNotFoundError, match=r"x\.wav: there is no such file"):
        read_recording(str(tmp_path / "x.wav"))
    with pytest.raises(IsADirectoryError, match="is a directory; give a recording in it"):
        read_recording(str(tmp_path))
    with pytest.raises(ValueError, match="/dev/null: is a device or a pipe"):
        read_recording("/dev/null")
    (tmp_path / "text.wav").write_text("no sound")
    with pytest.raises(ValueError, match=r"text\.wav: cannot be read \(.*[^.]\); give a WAV or FLAC file"):
        read_recording(str(tmp_path / "text.wav"))
    soundfile.write(tmp_path / "slow.wav", np.zeros(100), 7999)
    with pytest.raises(FitRefused, match=r"slow\.wav: the sample rate must lie between"):
        read_recording(str(tmp_path / "slow.wav"))
    # a second more than is looked at, so that it can be said that there is more
    long = np.zeros((62 * 8000, 2), np.float32)
    long[0, 1] = 0.5
    soundfile.write(tmp_path / "long.wav", long, 8000)
    samples, rate_hz = read_recording(str(tmp_path / "long.wav"))
    assert samples.shape == (61 * 8000, 2) and rate_hz == 8000 and samples[0].tolist() == [0.0, 0.5]
    with open(tmp_path / "long.wav", "rb") as file:
        assert read_recording(file)[0].shape == (61 * 8000, 2)
    for most, fine in ((2 * 61 * 8000, True), (2 * 61 * 8000 - 1, False)):
        monkeypatch.setattr(recording, "MOST_NUMBERS", most)
        if fine:
            read_recording(str(tmp_path / "long.wav"))
        else:
            with pytest.raises(FitRefused, match=f"at most {most} numbers, got 488000 samples of 2 channels"):
                read_recording(str(tmp_path / "long.wav"))


def test_levels_of_frames() -> None:
    x = np.concatenate([np.ones(400), np.zeros(400)])
    # 80 samples every 40: 19 frames, one of which lies half in the silence
    levels = recording._levels_db(x, 8000.0, 0.01, 0.005)
    assert levels == pytest.approx([0.0] * 9 + [10.0 * math.log10(0.5)] + [-200.0] * 9, abs=1e-9)
    assert recording._levels_db(x[:30], 8000.0, 0.01, 0.005) == pytest.approx([10.0 * math.log10(30 / 80)])


def test_an_envelope_is_over_45_decibels_down_or_in_the_noise() -> None:
    t = np.arange(3000) / 1000.0
    falling = 10.0 ** (-20.0 * t / 20.0).astype(complex)  # 20 dB/s
    # most of a tenth of a second lies below from 2.25 s on
    assert partials._end(t, falling, 0.0) == pytest.approx(2250, abs=15)
    assert partials._end(t, falling, 10.0 ** (-30.0 / 20.0)) == pytest.approx(1500 - 176, abs=15)  # 1.5 times the noise
    assert partials._end(t, np.ones(3000, complex), 0.0) == 3000
    assert partials._end(t[:7], falling[:7], 1.0) == 7 and partials._end(t[:9], falling[:9], 9.0) >= 8
    # a gap that is shorter, as beating makes, is no end
    gap = np.ones(3000, complex)
    gap[1000:1070] = 1e-4
    assert partials._end(t, gap, 0.0) == 3000


def ringing(numbers, f0: float = 200.0, seconds: float = 1.5, noise: float = 1e-4) -> np.ndarray:
    """Partials n of 0.2/n that fall by e^(−(1 + n/2)t), stretched by B = 2e-4, and white noise."""
    t = np.arange(round(seconds * RATE)) / RATE
    hz = Stretch(f0, 2e-4, 0.0, 0.0, 0.0).frequencies_hz
    x = sum(0.2 / n * np.exp(-(1.0 + 0.5 * n) * t) * np.cos(2 * np.pi * float(hz(n)) * t + n) for n in numbers)
    return x + noise * np.random.default_rng(9).standard_normal(t.size)


def test_partials_as_they_are() -> None:
    numbers = [1, 2, 3, 5, 6, 7, 8, 9, 10]
    note = RecordedNote(ringing(numbers), RATE, 0.0, 0.0, 0.0, ())
    shares: list[float] = []
    found, stretch = partials.measure_partials(note, find_series(note), shares.append)
    assert [p.number for p in found] == numbers
    assert shares[:3] == [0.0, 1 / 60, 2 / 60] and shares == sorted(shares)
    assert (stretch.f0_hz, stretch.inharmonicity) == (pytest.approx(200.0, rel=1e-5), pytest.approx(2e-4, rel=0.01))
    hz = Stretch(200.0, 2e-4, 0.0, 0.0, 0.0).frequencies_hz
    for p in found:
        assert p.hz == pytest.approx(float(hz(p.number)), abs=0.02) and p.single and p.steady
        assert p.level_db == pytest.approx(20.0 * math.log10(0.2 / p.number), abs=0.2)
        assert p.decay == pytest.approx(1.0 + 0.5 * p.number, rel=0.03)
        assert p.decay_error < 0.03 * p.decay and p.hz_error < 0.02 and p.level_error_db < 0.3 and p.misfit < 0.05
    # the noise in a window of 161 samples: √(2 Σw²) of its own, 20 to 25 dB below it
    assert found[0].snr_db == pytest.approx(20.0 * math.log10(0.2 * 0.5 / (1e-4 * math.sqrt(2 * 2.0 / 161))), abs=3.0)


def test_behind_ten_partials_that_are_not_there_none_is_looked_for() -> None:
    """Below the twelfth they are: a pluck in the middle has half of them only."""
    for numbers, heard in (((*range(1, 13), 30), list(range(1, 13))), ((*range(1, 13), 20), [*range(1, 13), 20])):
        note = RecordedNote(ringing(numbers, 100.0), RATE, 0.0, 0.0, 0.0, ())
        found, _ = partials.measure_partials(note, find_series(note))
        assert [p.number for p in found] == heard


def test_a_string_has_four_partials_at_least() -> None:
    note = RecordedNote(ringing((1, 2, 3)), RATE, 0.0, 0.0, 0.0, ())
    with pytest.raises(
        FitRefused, match=r"only 3 partials of 200\.\d Hz stand out of the noise, a string's inharmonicity needs 4"
    ):
        partials.measure_partials(note, find_series(note))
    short = replace(note, samples=note.samples[:321])
    with pytest.raises(FitRefused, match=r"the note must hold 8 periods .*; record one pluck and let it ring"):
        partials.measure_partials(short, find_series(note))


def test_a_note_alone_and_two_at_once() -> None:
    alone = RecordedNote(ringing(range(1, 11)), RATE, 0.0, 0.0, 0.0, ())
    series = find_series(alone)
    assert series.f0_hz == pytest.approx(200.0, rel=1e-3) and series.numbers.tolist() == list(range(1, 11))
    assert find_series(alone, 230.0).f0_hz == pytest.approx(200.0, rel=1e-3)
    with pytest.raises(FitRefused, match="no pitch was found near 3000 Hz"):
        find_series(alone, 3000.0)
    both = replace(alone, samples=alone.samples + ringing(range(1, 9), 337.0))
    with pytest.raises(FitRefused, match=r"two notes sound, near (200|337)"):
        find_series(both)


def test_partials_that_a_contact_moves_are_no_second_note() -> None:
    moved = ringing(range(1, 11)) + ringing(range(1, 11), 200.0 * 2.0 ** (26.0 / 1200.0))
    for beside, cents in ((moved, 0.0), (ringing(range(1, 11)) + ringing(range(1, 9), 212.0), 30.0)):
        with pytest.raises(FitRefused, match=r"two notes sound|strong partials"):
            find_series(RecordedNote(beside, RATE, 0.0, 0.0, 0.0, ()), moved_cents=cents)
    found = find_series(RecordedNote(moved, RATE, 0.0, 0.0, 0.0, ()), 200.0, moved_cents=30.0)
    assert found.f0_hz == pytest.approx(200.0, rel=0.016)


def test_a_fit_says_how_far_it_is_and_can_be_ended() -> None:
    x = ringing(range(1, 13))
    shares: list[float] = []
    fit = fit_recording(x, RATE, progress=lambda share: shares.append(share) or True)
    assert fit.f0_hz == pytest.approx(200.0, rel=1e-5) and fit.first_partial_hz == pytest.approx(200.02, rel=1e-5)
    assert shares[:3] == [0.0, 0.1, 0.2] and shares[-1] == 0.9 and shares == sorted(shares)
    for last in (0.0, 0.15, 0.85):
        with pytest.raises(FitCancelled):
            fit_recording(x, RATE, progress=lambda share, last=last: share <= last)
    for bad in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(FitRefused, match="expected_hz must be > 0 Hz"):
            fit_recording(x, RATE, expected_hz=bad)
    assert fit.duration_s == pytest.approx(1.5, abs=0.02) and fit.rate_hz == RATE and fit.explained > 0.99
    assert fit.snr_db > 40.0 and fit.noise_floor_dbfs < -60.0 and fit.peak_dbfs == pytest.approx(gain_to_db(np.abs(x).max()))
