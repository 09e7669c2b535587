"""Quality → internal rate and modes."""

from __future__ import annotations

import pytest

from synth.dsp.decimator import MAXIMUM_FACTOR
from synth.physics.modes import modal_frequencies
from synth.physics.string import String
from synth.plan import MAX_MODES, POINT, QUALITIES, SEVERAL, choose_factor, plan_string


def string(length_m: float = 0.9, tension_n: float = 40.0) -> String:
    return String(
        length_m=length_m,
        tension_n=tension_n,
        linear_density_kg_m=1e-3,
        bending_stiffness_n_m2=2.5e-4,
        diameter_m=4e-4,
        core_diameter_m=None,
        winding_diameter_m=None,
        viscoelastic_loss=4.5e-3,
        thermoelastic_q_inverse=2e-4,
    )


def test_without_contact_the_output_rate_is_enough():
    for quality in QUALITIES:
        factor, error = choose_factor(110.0, 0, quality, 44100.0)
        assert factor == 1 and error == "exact"


def test_steps_per_period_are_reached_and_not_overshot():
    for table, contacts in ((POINT, 1), (SEVERAL, 2), (SEVERAL, 20)):
        for quality in QUALITIES:
            for f0 in (41.2, 65.4, 130.8, 261.6):
                wanted = table[quality].steps_per_period
                factor, error = choose_factor(f0, contacts, quality, 48000.0)
                if wanted * f0 <= 48000.0 * MAXIMUM_FACTOR:
                    assert error == table[quality].error
                else:  # no more is promised than the steps that are left are known to give
                    reached = [c for c in table.values() if c.steps_per_period * f0 <= 48000.0 * MAXIMUM_FACTOR]
                    assert error == f"{reached[-1].error} (limited to {MAXIMUM_FACTOR} × output)"
                if factor < MAXIMUM_FACTOR:
                    assert factor * 48000.0 / f0 >= wanted * (1 - 1e-9)
                if factor > 1:
                    assert (factor - 1) * 48000.0 / f0 < wanted


def test_better_quality_never_computes_less():
    factors = [choose_factor(65.4, 1, quality, 44100.0)[0] for quality in QUALITIES]
    assert factors == sorted(factors) and factors[0] < factors[-1]


def test_internal_rate_does_not_depend_on_the_output_rate_by_more_than_its_grain():
    for rate in (44100.0, 48000.0, 88200.0, 96000.0):
        factor, _ = choose_factor(98.0, 1, "standard", rate)
        internal = factor * rate
        assert POINT["standard"].steps_per_period * 98.0 <= internal < POINT["standard"].steps_per_period * 98.0 + rate


def test_own_rate_must_be_a_multiple():
    assert choose_factor(98.0, 1, "standard", 44100.0, 176400.0)[0] == 4
    for rate in (100000.0, 44100.0 * (MAXIMUM_FACTOR + 1), 0.0, 22050.0):
        with pytest.raises(ValueError, match="internal rate must be 1 to 64 times"):
            choose_factor(98.0, 1, "standard", 44100.0, rate)


def test_unknown_quality_is_named():
    with pytest.raises(ValueError, match="quality must be one of draft, standard, fine, reference, got 'best'"):
        choose_factor(98.0, 1, "best", 44100.0)


def test_modes_are_those_below_half_the_internal_rate():
    plan = plan_string(string(), 110.0, 1, quality="standard", rate_hz=44100.0)
    limit = 3.141592653589793 * plan.rate_hz
    omega = modal_frequencies(string(), plan.modes + 1)
    assert omega[plan.modes - 1] < limit <= omega[plan.modes]
    assert plan.rate_hz == plan.factor * 44100.0
    assert f"{plan.modes} modes" in plan.reason and "1 contact:" in plan.reason


def test_there_is_a_mode_at_least_and_an_end():
    short = plan_string(string(0.02, 4000.0), 50000.0, 0, quality="draft", rate_hz=44100.0)
    assert short.modes == 1
    long = plan_string(string(5.0, 10.0), 10.0, 1, quality="standard", rate_hz=44100.0, internal_rate_hz=64 * 44100.0)
    assert long.modes <= MAX_MODES


def test_other_schemes_say_that_they_are_not_calibrated():
    plan = plan_string(string(), 110.0, 1, quality="standard", rate_hz=44100.0, scheme="moreau-jean")
    assert plan.error == "not calibrated for this scheme"
