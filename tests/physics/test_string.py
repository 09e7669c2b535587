import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from synth.physics.modes import decay_rates, modal_frequencies, model_frequencies
from synth.physics.string import LIMITS, NutResonance, String
from synth.physics.tuning import tuned

NUT = (NutResonance(45.0, 20.0, 1.5), NutResonance(110.0, 30.0, 0.8))


def test_properties(bass):
    assert bass.wave_speed_m_s == pytest.approx(169.106, rel=1e-5)
    assert bass.fundamental_hz == pytest.approx(97.9756, rel=1e-5)
    assert bass.inharmonicity == pytest.approx(3.5e-5, rel=1e-14)
    assert bass.bending_stiffness_n_m2 == pytest.approx(5.0605e-4, rel=1e-4)
    assert bass.impedance_kg_s == pytest.approx(1.13301, rel=1e-5)


def test_equivalent_diameter_of_a_wound_string(bass):
    # (π/2)(0.355 (1 + 2/π) + 0.43) mm by hand
    assert bass.equivalent_diameter_m == pytest.approx(1.58808e-3, rel=1e-5)


def test_equivalent_diameter_of_a_plain_string(guitar):
    assert guitar.equivalent_diameter_m == 0.43e-3


def test_stiffness_of_a_round_steel_wire():
    # E π d⁴/64 with E = 203 GPa is the inharmonicity the paper found for this guitar string, to 10 %
    stiffness = 203e9 * math.pi * 0.43e-3**4 / 64
    assert String(1.002, 180.5, 1.17e-3, stiffness, 0.43e-3).inharmonicity == pytest.approx(1.9e-5, rel=0.1)


def test_arrays_become_tuples():
    string = String(1, 100, 1e-3, 0, 1e-3, nut=list(NUT), measured_frequencies_hz=np.array([100.0, 201.0]))
    assert string.nut == NUT
    assert string.measured_frequencies_hz == (100.0, 201.0)
    assert hash(string) == hash(dataclasses.replace(string))


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("length_m", 0.0, r"length_m must be a number > 0 m, got 0\.0; check the unit"),
        ("tension_n", -3.0, "tension_n must be a number > 0 N, got -3"),
        ("linear_density_kg_m", math.nan, "linear_density_kg_m must be a number > 0 kg/m, got nan"),
        ("diameter_m", math.inf, "diameter_m must be a number > 0 m, got inf"),
        ("diameter_m", "1 mm", "diameter_m must be a number > 0 m, got '1 mm'"),
        ("bending_stiffness_n_m2", -1e-9, "bending_stiffness_n_m2 must be a number >= 0 N m², got -1e-09"),
        ("viscoelastic_loss", -0.1, "viscoelastic_loss must be a number >= 0"),
        ("thermoelastic_q_inverse", None, "thermoelastic_q_inverse must be a number >= 0"),
        ("air_density", -1.0, "air_density must be"),
        ("air_viscosity", -1.0, "air_viscosity must be"),
        ("stiffness_law", "cubic", "stiffness_law must be 'sqrt' or 'linear', got 'cubic'"),
        ("core_diameter_m", 1e-4, "must be given together"),
        (
            "measured_frequencies_hz",
            (100.0, 0.0),
            "measured_frequencies_hz of mode 2 must be a number > 0 Hz",
        ),
        ("measured_decay_rates", (-1.0,), "measured_decay_rates of mode 1 must be a number > 0 1/s"),
    ],
)
def test_validation_names_field_and_value(guitar, field, value, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(guitar, **{field: value})


def test_core_must_fit_into_the_string(bass):
    with pytest.raises(ValueError, match=r"core_diameter_m must be less than diameter_m = 0\.00114 m"):
        dataclasses.replace(bass, core_diameter_m=2e-3)


@pytest.mark.parametrize("field", ["frequency_hz", "q", "mass_kg"])
def test_nut_validation(field):
    with pytest.raises(ValueError, match=f"nut resonance {field} must be a number > 0"):
        dataclasses.replace(NUT[0], **{field: 0.0})


def test_inharmonicity_validation():
    with pytest.raises(ValueError, match="inharmonicity must be a number >= 0, got -1e-05"):
        String.from_inharmonicity(1.0, 100.0, 1e-3, -1e-5, 1e-3)


def test_another_tension_is_that_of_a_string_made_so(bass):
    held = dataclasses.replace(bass, nut=(NutResonance(90.0, 20.0, 1.5),))
    made = dataclasses.replace(held, tension_n=150.0)
    assert held.with_tension(150.0) == made
    assert np.array_equal(model_frequencies(held.with_tension(150.0), 5), model_frequencies(made, 5))
    with pytest.raises(ValueError, match=r"tension_n must be a number > 0 N, got -1\.0"):
        held.with_tension(-1.0)
    heavy = dataclasses.replace(held, length_m=1e3, linear_density_kg_m=1e5)
    with pytest.raises(ValueError, match="between 1e-06 and 1e"):
        heavy.with_tension(1e-9)


def test_with_length_keeps_the_wire_and_drops_what_was_measured(guitar):
    measured = dataclasses.replace(guitar, measured_frequencies_hz=(195.7,), measured_decay_rates=(0.3,), nut=NUT)
    half = measured.with_length(0.501)
    assert half == dataclasses.replace(guitar, length_m=0.501, nut=NUT)
    assert half.inharmonicity == pytest.approx(4 * guitar.inharmonicity, rel=1e-14)
    assert measured.with_length(1.002) is measured


@given(
    law=st.sampled_from(["sqrt", "linear"]),
    inharmonicity=st.floats(0.0, 1e-2),
    frequency=st.floats(25.0, 2000.0),
    nut=st.lists(
        st.builds(NutResonance, st.floats(20.0, 2000.0), st.floats(2.0, 60.0), st.floats(0.3, 10.0)),
        max_size=3,
    ),
)
def test_tuned_meets_the_first_mode(law, inharmonicity, frequency, nut):
    string = String.from_inharmonicity(
        0.8, 150.0, 5e-3, inharmonicity, 1e-3, stiffness_law=law, nut=nut, measured_frequencies_hz=(50.0,)
    )
    taut = tuned(string, frequency)
    assert taut.measured_frequencies_hz == ()
    assert modal_frequencies(taut, 1)[0] / (2 * math.pi) == pytest.approx(frequency, rel=1e-12)
    assert dataclasses.replace(taut, tension_n=string.tension_n, measured_frequencies_hz=(50.0,)) == string


def test_tuned_ideal_string_by_hand():
    # T = 4 L² μ f²
    assert tuned(String(0.5, 1.0, 1e-3, 0.0, 1e-3), 400.0).tension_n == pytest.approx(160.0, rel=1e-15)


@given(st.sampled_from(["sqrt", "linear"]), st.floats(20.0, 400.0), st.floats(1e-9, 1e-5))
def test_tuned_returns_to_where_it_was(law, tension, stiffness):
    string = String(0.7, tension, 2e-3, stiffness, 1e-3, stiffness_law=law)
    assume(string.inharmonicity < 0.1)
    first = model_frequencies(string, 1)[0] / (2 * math.pi)
    assert tuned(string, first).tension_n == pytest.approx(tension, rel=1e-12)


@pytest.mark.parametrize("law", ["sqrt", "linear"])
def test_a_bar_cannot_be_tuned_below_its_own_pitch(law):
    bar = String(0.1, 10.0, 1e-2, 1.0, 2e-3, stiffness_law=law)
    with pytest.raises(ValueError, match="frequency_hz must be above what bending stiffness alone gives, got 20 Hz"):
        tuned(bar, 20.0)


@pytest.mark.parametrize("bad", [0.0, -5.0, math.nan])
def test_tuned_needs_a_frequency(guitar, bad):
    with pytest.raises(ValueError, match="frequency_hz must be a number > 0 Hz"):
        tuned(guitar, bad)


@pytest.mark.parametrize("field", [name for name in LIMITS if name != "inharmonicity"])
def test_no_field_takes_what_no_string_has(bass, field):
    """Refused by its own name, whatever is made of it later; zero where an effect may be absent."""
    measured = dataclasses.replace(bass, nut=NUT, measured_frequencies_hz=(50.0,), measured_decay_rates=(1.0,))
    low, high, _ = LIMITS[field]

    def made(value):
        if field in ("frequency_hz", "q", "mass_kg"):
            return dataclasses.replace(measured, nut=(dataclasses.replace(NUT[0], **{field: value}),))
        return dataclasses.replace(measured, **{field: (value,) if field.startswith("measured") else value})

    for bad in (1e308, 2.0 * high, -1.0, math.nan, math.inf, -math.inf, *([0.0, 1e-308, 0.5 * low] if low > 0.0 else [])):
        with pytest.raises(ValueError, match=f"{field}.* must be a number .*, got .*; "):
            made(bad)
    if low == 0.0:
        for little in (0.0, 5e-324, 1e-308):
            assert np.all(np.isfinite(modal_frequencies(made(little), 50)))
            assert np.all(decay_rates(made(little), 50) > 0.0)


def test_fields_that_describe_no_string_together():
    with pytest.raises(ValueError, match=r"tension_n and linear_density_kg_m must .* got 1e\+09 N and 1e-12 kg/m on 0\.001"):
        String(1e-3, 1e9, 1e-12, 0.0, 1e-3)
    with pytest.raises(ValueError, match=r"bending_stiffness_n_m2 must keep the inharmonicity .* below 1e\+12, got 1e\+09"):
        String(1e-2, 1e-3, 1e-3, 1e9, 1e-3)
    for bad in (1e308, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match=r"^inharmonicity must be a number"):
            String.from_inharmonicity(1.0, 100.0, 1e-3, bad, 1e-3)
    with pytest.raises(ValueError, match=r"^length_m must be a number from"):
        String.from_inharmonicity(1e308, 100.0, 1e-3, 1e-4, 1e-3)
    with pytest.raises(ValueError, match=r"^frequency_hz must be a number from"):
        tuned(String(1.0, 100.0, 1e-3, 0.0, 1e-3), 1e200)
