import dataclasses
import math

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synth.physics import modes
from synth.physics.string import NutResonance, String

EPS = np.finfo(np.float64).eps
NUT = (NutResonance(100.0, 25.0, 1.2),)


def ideal(**others) -> String:
    return String(0.8, 100.0, 4e-3, 0.0, 1e-3, **others)


# Frequencies


def test_ideal_string_is_harmonic():
    assert modes.modal_frequencies(ideal(), 50) == pytest.approx(
        2 * math.pi * math.sqrt(100 / 4e-3) / 1.6 * np.arange(1, 51), rel=1e-14
    )


@pytest.mark.parametrize("law", ["sqrt", "linear"])
def test_frequencies_by_hand(guitar, law):
    nu = modes.modal_frequencies(dataclasses.replace(guitar, stiffness_law=law), 500) / (2 * math.pi)
    nu_0 = math.sqrt(180.5 / 1.17e-3) / 2.004
    # B j² at j = 500 is 4.45
    factor = math.sqrt(5.45) if law == "sqrt" else 3.225
    assert nu[499] == pytest.approx(500 * nu_0 * factor, rel=1e-13)
    assert nu[0] == pytest.approx(nu_0 * (1 + 0.89e-5), rel=1e-10)


def test_sqrt_law_is_that_of_the_stiff_string(guitar):
    # μω² = T k² + EI k⁴: what a pinned stiff string's modes satisfy
    k = np.arange(1, 2001) * math.pi / guitar.length_m
    energy = guitar.tension_n * k**2 + guitar.bending_stiffness_n_m2 * k**4
    omega = modes.model_frequencies(guitar, 2000)
    assert np.allclose(guitar.linear_density_kg_m * omega**2, energy, rtol=1e-13, atol=0)


def test_without_nut_the_model_is_the_base_law(guitar, bass):
    for string in (guitar, bass):
        assert np.array_equal(modes.model_frequencies(string, 99), modes.base_frequencies(string, 99))


def test_measured_first_then_the_model(guitar):
    measured = dataclasses.replace(guitar, measured_frequencies_hz=(195.0, 391.0, 588.0), measured_decay_rates=(0.3, 0.7))
    omega, sigma = modes.modal_frequencies(measured, 10), modes.decay_rates(measured, 10)
    assert omega[:3] == pytest.approx(2 * math.pi * np.array([195.0, 391.0, 588.0]), rel=1e-15)
    assert np.array_equal(omega[3:], modes.modal_frequencies(guitar, 10)[3:])
    assert np.array_equal(sigma[:2], [0.3, 0.7])
    assert np.array_equal(sigma[2:], modes.decay_rates(guitar, 10)[2:])
    assert np.array_equal(modes.model_frequencies(measured, 10), modes.modal_frequencies(guitar, 10))
    assert np.array_equal(modes.model_decay_rates(measured, 10), modes.decay_rates(guitar, 10))
    assert np.array_equal(modes.modal_frequencies(measured, 2), omega[:2])


def test_modes_are_the_same_however_many_are_asked_for():
    string = ideal(nut=(*NUT, NutResonance(410.0, 30.0, 0.4)), mass_scatter=0.02, seed=4, viscoelastic_loss=0.01)
    omega, sigma = modes.model_frequencies(string, 1300), modes.model_decay_rates(string, 1300)
    for n in (0, 1, 2, 15, 16, 255, 256, 257, 1024, 1299):
        assert np.array_equal(modes.model_frequencies(string, n), omega[:n])
        assert np.array_equal(modes.model_decay_rates(string, n), sigma[:n])


# Nut mobility


def test_mobility_of_one_resonance_at_its_peak_and_far_from_it():
    omega_n = 200 * math.pi
    string = ideal(nut=NUT)
    assert modes.nut_mobility(string, omega_n) == pytest.approx(25 / (1.2 * omega_n), rel=1e-13)
    # Far below a spring of stiffness m ω_n², far above a mass m
    assert modes.nut_mobility(string, 0.1).imag == pytest.approx(0.1 / (1.2 * omega_n**2), rel=1e-6)
    assert modes.nut_mobility(string, 1e7).imag == pytest.approx(-1 / (1.2 * 1e7), rel=1e-6)


def test_resonances_add_up():
    other = NutResonance(340.0, 10.0, 0.5)
    omega = np.linspace(10.0, 5000.0, 30)
    both = modes.nut_mobility(ideal(nut=(*NUT, other)), omega)
    apart = modes.nut_mobility(ideal(nut=NUT), omega) + modes.nut_mobility(ideal(nut=(other,)), omega)
    assert np.allclose(both, apart, rtol=1e-14, atol=0)


def test_string_sounds_lower_below_a_nut_resonance_and_higher_above():
    rigid, mobile = ideal(), ideal(nut=NUT)
    fundamental = rigid.fundamental_hz  # 98.8 Hz, just below the resonance; mode 2 above
    assert 98 < fundamental < 100
    shift = modes.model_frequencies(mobile, 3) / modes.model_frequencies(rigid, 3) - 1
    assert shift[0] < 0 < shift[2] < shift[1]


def test_soft_end_lengthens_the_string():
    # Far below the resonance the end is a spring k = m ω_n²: giving way by T u'/k makes the string longer by
    # T/k, so lower by T/(kL)
    stiff = NutResonance(1e5, 1e6, 0.01)
    shift = modes.model_frequencies(ideal(nut=(stiff,)), 1) / modes.model_frequencies(ideal(), 1) - 1
    spring = 0.01 * (2 * math.pi * 1e5) ** 2
    assert shift[0] == pytest.approx(-100.0 / (spring * 0.8), rel=1e-5)


def test_nut_damping_by_hand():
    # A purely resistive end of mobility Re Y takes σ = (T/L) Re Y: at the peak, Q/(m ω_n)
    string = ideal(air_viscosity=0.0, nut=(NutResonance(ideal().fundamental_hz, 25.0, 30.0),))
    resistive = 100.0 / 0.8 * 25.0 / (30.0 * 2 * math.pi * ideal().fundamental_hz)
    assert modes.model_decay_rates(string, 1)[0] == pytest.approx(resistive, rel=1e-4)


def test_nut_agrees_with_the_exact_string_on_a_moving_end():
    """First-order perturbation against the eigenvalue of the string that ends on mass, spring and damper."""
    resonance = NutResonance(150.0, 20.0, 40.0)  # heavy, so that first order is enough
    string = ideal(air_viscosity=0.0, nut=(resonance,))
    c, impedance = string.wave_speed_m_s, string.impedance_kg_s
    omega_n = 2 * math.pi * resonance.frequency_hz

    def condition(omega):  # u = e^{iωt} sin(ω(L−x)/c): T u'(0) = iω u(0)/Y
        mobility = 1j * omega / (40.0 * (omega_n**2 - omega**2 + 1j * omega * omega_n / 20.0))
        return mpmath.sin(omega * 0.8 / c) + impedance / 1j * mobility * mpmath.cos(omega * 0.8 / c)

    for j in (1, 2, 3):
        root = mpmath.findroot(condition, j * math.pi * c / 0.8)
        omega, sigma = modes.model_frequencies(string, j)[-1], modes.model_decay_rates(string, j)[-1]
        correction = abs(complex(root) - j * math.pi * c / 0.8)
        # Second order in the correction itself, relative to ω and to the resonance's half width
        slack = 5 * correction**2 / min(omega_n / 40.0, abs(omega - omega_n) + omega_n / 40.0)
        assert abs(omega - float(root.real)) < slack < 0.05 * correction
        assert abs(sigma - float(root.imag)) < slack


def test_too_mobile_a_nut_is_refused():
    with pytest.raises(ValueError, match="nut mobility must leave mode 1 a positive frequency"):
        modes.model_frequencies(ideal(nut=(NutResonance(105.0, 200.0, 1e-3),)), 5)


# Decay rates


def test_air_damping_by_hand():
    string = ideal(air_viscosity=1.8e-5, air_density=1.2)
    nu = string.fundamental_hz
    drag = 2 * math.pi * 1.8e-5 + 2 * math.pi * 1e-3 * math.sqrt(math.pi * 1.8e-5 * 1.2 * nu)
    # σ = πν · R/(2πμν) = R/2μ for an ideal string
    assert modes.model_decay_rates(string, 1)[0] == pytest.approx(drag / 8e-3, rel=1e-14)


def test_air_damping_of_a_stiff_wound_string_by_hand(bass):
    string = dataclasses.replace(bass, viscoelastic_loss=0.0, thermoelastic_q_inverse=0.0)
    j = 300  # B j²/2 = 1.575
    nu_0 = j * 97.97556
    drag = 2 * math.pi * (1.8e-5 + 1.58808e-3 * math.sqrt(math.pi * 1.8e-5 * 1.2 * nu_0 * 2.575))
    # σ = πν · (ν_0/ν) R/(2πμν), so R/2μ divided by ν/ν_0
    assert modes.model_decay_rates(string, j)[-1] == pytest.approx(drag / (2 * 6.7e-3) / 2.575, rel=1e-5)


def test_thermoelastic_damping_alone():
    string = ideal(air_viscosity=0.0, thermoelastic_q_inverse=1e-3)
    assert modes.model_decay_rates(string, 9) == pytest.approx(0.5e-3 * modes.model_frequencies(string, 9), rel=1e-14)


def test_viscoelastic_damping_alone(bass):
    string = dataclasses.replace(bass, air_viscosity=0.0, thermoelastic_q_inverse=0.0)
    j = 40
    nu_0 = j * string.fundamental_hz
    # σ = πν Q⁻¹ = 4π³ μ EI δ ν_0³/T²: the same for either law
    expected = 4 * math.pi**3 * 6.7e-3 * string.bending_stiffness_n_m2 * 0.01 * nu_0**3 / 191.6**2
    assert modes.model_decay_rates(string, j)[-1] == pytest.approx(expected, rel=1e-13)
    other_law = dataclasses.replace(string, stiffness_law="sqrt")
    assert modes.model_decay_rates(other_law, j)[-1] == pytest.approx(expected, rel=1e-13)


def test_overdamped_modes_are_modes():
    string = String.from_inharmonicity(1.0, 50.0, 1e-3, 1e-4, 1e-3, viscoelastic_loss=1.0)
    omega, sigma = modes.modal_frequencies(string, 3000), modes.decay_rates(string, 3000)
    assert sigma[0] < omega[0]
    assert sigma[-1] > omega[-1]
    assert np.isfinite(sigma).all()


def test_guitar_frequencies_of_the_authors(reference, guitar):
    authors = reference("authors_data.npz")["one_f"]
    ours = modes.modal_frequencies(guitar, authors.size) / (2 * math.pi)
    assert np.abs(authors[36:] / ours[36:] - 1).max() < 1e-14
    assert np.abs(authors[:36] / ours[:36] - 1).max() < 2e-3  # measured ones


def test_bass_modes_of_the_authors(reference, bass):
    data = reference("authors_data.npz")
    ours = modes.modal_frequencies(bass, 862) / (2 * math.pi)
    # Theirs holds a nut mobility up to mode 90, then A1 … A5 as printed, damping held from mode 800 on
    assert np.abs(data["bass_f"][90:] / ours[90:] - 1).max() < 1e-13
    sigma = modes.decay_rates(bass, 862)
    assert np.abs(data["bass_sig"][90:800] / sigma[90:800] - 1).max() < 1e-12
    assert np.ptp(data["bass_sig"][800:]) == 0.0


def test_measured_modes_go_in_and_the_model_joins_on(reference, guitar):
    data = reference("authors_data.npz")
    string = dataclasses.replace(
        guitar,
        measured_frequencies_hz=tuple(data["one_f"][:36]),
        measured_decay_rates=tuple(data["one_sig"][:36]),
    )
    assert modes.modal_frequencies(string, 1001) / (2 * math.pi) == pytest.approx(data["one_f"], rel=1e-14)
    assert np.array_equal(modes.decay_rates(string, 36), data["one_sig"][:36])


# Counting


@given(st.floats(0.0, 40000.0), st.sampled_from(["sqrt", "linear"]))
def test_count_modes_below(frequency, law):
    string = String.from_inharmonicity(0.863, 191.6, 6.7e-3, 3.5e-5, 1e-3, stiffness_law=law, nut=NUT)
    n = modes.count_modes_below(string, frequency)
    nu = modes.modal_frequencies(string, n + 1) / (2 * math.pi)
    assert np.all(nu[:n] < frequency * (1 + 4 * EPS))
    assert nu[n] >= frequency * (1 - 4 * EPS)


def test_count_uses_measured_modes():
    assert modes.count_modes_below(ideal(), 150.0) == 1
    assert modes.count_modes_below(ideal(measured_frequencies_hz=(99.0, 140.0)), 150.0) == 2


def test_count_needs_a_frequency():
    with pytest.raises(ValueError, match="frequency_hz must be >= 0 Hz and finite, got inf"):
        modes.count_modes_below(ideal(), math.inf)


# Shapes


def test_shapes_are_orthonormal():
    # The midpoint rule is exact for products of modes below half its points
    x = 0.8 * (np.arange(400) + 0.5) / 400
    phi = modes.mode_shapes(0.8, x, 150)
    assert phi.shape == (400, 150)
    assert np.allclose(phi.T @ phi * 0.8 / 400, np.eye(150), rtol=0, atol=1e-12)


def test_shapes_at_one_place():
    phi = modes.mode_shapes(2.0, 0.5, 4)
    assert phi == pytest.approx(np.array([[math.sqrt(0.5), 1.0, math.sqrt(0.5), 0.0]]), abs=1e-15)
    assert modes.mode_shapes(2.0, [], 4).shape == (0, 4)
    assert modes.mode_shapes(2.0, [0.1], 0).shape == (1, 0)


@pytest.mark.parametrize("x", [-1e-9, 0.81, math.nan])
def test_shapes_outside_the_string(x):
    with pytest.raises(ValueError, match=r"positions must lie between 0 and 0\.8 m, got"):
        modes.mode_shapes(0.8, [0.1, x], 3)


@pytest.mark.parametrize("n", [-1, 2.5])
def test_number_of_modes_must_be_whole(n):
    with pytest.raises(ValueError, match="number of modes must be a whole number >= 0"):
        modes.modal_frequencies(ideal(), n)


def test_bridge_force_weights(guitar):
    j = np.arange(1, 31)
    k = j * math.pi / 1.002
    expected = (-1.0) ** j * math.sqrt(2 / 1.002) * (180.5 * k + guitar.bending_stiffness_n_m2 * k**3)
    assert np.allclose(modes.force_weights(guitar, 1.002, 30), expected, rtol=1e-13, atol=0)


@pytest.mark.parametrize("x", [0.0, 0.123, 0.9])
def test_force_weights_are_derivatives_of_the_shape(guitar, x):
    # T u' − EI u''' of each mode, derivatives by mpmath
    weights = modes.force_weights(guitar, x, 5)
    for j in range(1, 6):

        def phi(y, j=j):
            return mpmath.sqrt(mpmath.mpf(2) / 1.002) * mpmath.sin(j * mpmath.pi * y / 1.002)

        with mpmath.workdps(40):
            force = 180.5 * mpmath.diff(phi, x) - guitar.bending_stiffness_n_m2 * mpmath.diff(phi, x, 3)
        assert weights[j - 1] == pytest.approx(float(force), rel=1e-12, abs=1e-10)


# Static compliance and what the modes left out hold of it

STRINGS = {
    "ideal": String(1.002, 180.5, 1.17e-3, 0.0, 0.43e-3),
    "guitar": String.from_inharmonicity(1.002, 180.5, 1.17e-3, 1.78e-5, 0.43e-3),
    "guitar-linear": String.from_inharmonicity(1.002, 180.5, 1.17e-3, 1.78e-5, 0.43e-3, stiffness_law="linear"),
    "bass-linear": String.from_inharmonicity(0.863, 191.6, 6.7e-3, 3.5e-5, 1e-3, stiffness_law="linear"),
    "rod": String.from_inharmonicity(0.3, 60.0, 5e-3, 0.02, 2e-3),
    "rod-linear": String.from_inharmonicity(0.3, 60.0, 5e-3, 0.02, 2e-3, stiffness_law="linear"),
}
strings = st.sampled_from(sorted(STRINGS)).map(STRINGS.__getitem__)


def modal_sum(string: String, x: np.ndarray, first: int, last: int) -> np.ndarray:
    """Σ φφᵀ/(μω̂²) over modes first … last, term by term."""
    scaled = modes.mode_shapes(string.length_m, x, last) / modes.base_frequencies(string, last)
    scaled = scaled[:, first - 1 :]
    return scaled @ scaled.T / string.linear_density_kg_m


def test_ideal_string_gives_way_like_a_triangle():
    assert modes.static_compliance(STRINGS["ideal"], 0.2, 0.5) == pytest.approx(0.2 * 0.502 / (180.5 * 1.002), rel=1e-14)


@pytest.mark.parametrize("name", sorted(STRINGS))
def test_static_compliance_is_the_sum_of_all_modes(name):
    string = STRINGS[name]
    x = np.array([0.006, 0.1, 0.3, 0.5, 0.97]) * string.length_m
    last = 40000
    # Largest remainder: the ideal string's, (2L/(π²T))/last
    remainder = 2 * string.length_m / (math.pi**2 * string.tension_n) / last
    whole = modes.static_compliance(string, x[:, None], x[None, :])
    assert np.abs(whole - modal_sum(string, x, 1, last)).max() < remainder


@pytest.mark.parametrize("x", ["0.006", "0.0001", "0.4"])
@pytest.mark.parametrize("y", ["0.00601", "0.5", "0.99"])
def test_static_compliance_against_mpmath(guitar, x, y):
    with mpmath.workdps(40):
        length, tension = mpmath.mpf(guitar.length_m), mpmath.mpf(guitar.tension_n)
        k = mpmath.sqrt(tension / mpmath.mpf(guitar.bending_stiffness_n_m2))
        a, b = sorted((mpmath.mpf(float(x)), mpmath.mpf(float(y))))
        bending = mpmath.sinh(k * a) * mpmath.sinh(k * (length - b)) / (k * mpmath.sinh(k * length))
        line = a * (length - b) / length
        exact = (line - bending) / tension
    error = abs(modes.static_compliance(guitar, float(x), float(y)) - float(exact))
    assert error < 4 * EPS * float(line / tension)


@pytest.mark.parametrize("law", ["sqrt", "linear"])
def test_no_stiffness_is_the_limit_of_little(law):
    x = np.linspace(0.05, 0.95, 7)
    # κ = √(T/EI) = 3e6/m and more: what bending takes is below 1/κ of a triangle's height
    barely = String.from_inharmonicity(1.002, 180.5, 1.17e-3, 1e-12, 1e-3, stiffness_law=law)
    a = modes.static_compliance(barely, x[:, None], x[None, :])
    b = modes.static_compliance(STRINGS["ideal"], x[:, None], x[None, :])
    assert 0 < np.abs(a - b).max() < 1.0 / 1e6 / 180.5


@given(strings, st.floats(0, 1), st.floats(0, 1))
def test_reciprocity_mirror_and_ends(string, a, b):
    length = string.length_m
    x, y = a * length, b * length
    there = modes.static_compliance(string, x, y)
    # What rounding x, or L − x, by one unit does
    slack = 16 * EPS * length / string.tension_n
    assert modes.static_compliance(string, y, x) == there
    assert abs(modes.static_compliance(string, length - x, length - y) - there) < slack
    assert -slack < there < length / string.tension_n
    assert abs(modes.static_compliance(string, 0.0, y)) < slack
    assert abs(modes.static_compliance(string, length, y)) < slack


@pytest.mark.parametrize("inharmonicity", [1e-14, 1e-9, 1e-4, 1.0, 100.0])
@pytest.mark.parametrize("law", ["sqrt", "linear"])
def test_no_overflow_at_any_stiffness(inharmonicity, law):
    string = String.from_inharmonicity(1.0, 100.0, 1e-3, inharmonicity, 1e-3, stiffness_law=law)
    x = np.array([1e-9, 1e-3, 0.5, 1.0 - 1e-9])
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        whole = modes.static_compliance(string, x[:, None], x[None, :])
        modes.residual_compliance(string, x, 3)
    # One-term check: with B ≫ 1 the first mode is nearly all of it
    assert np.isfinite(whole).all()
    if inharmonicity == 100.0:
        assert whole[2, 2] == pytest.approx(modal_sum(string, x, 1, 2000)[2, 2], rel=1e-9)


@pytest.mark.parametrize("n", [0, 1, 10, 137, 1001])
@pytest.mark.parametrize("name", sorted(STRINGS))
def test_residual_is_compliance_less_the_modes_kept(name, n):
    string = STRINGS[name]
    x = np.array([0.006, 0.0065, 0.2, 0.5, 0.9]) * string.length_m
    whole = modes.static_compliance(string, x[:, None], x[None, :])
    residual = modes.residual_compliance(string, x, n)
    assert np.array_equal(residual, residual.T)
    # The difference is only good to rounding of the whole
    assert np.abs(residual - (whole - modal_sum(string, x, 1, n))).max() < 30 * EPS * whole.max()


def exact_residual(string: String, x, n: int) -> np.ndarray:
    """R of either law in 60 digits, as mpmath numbers: closed form of all modes less the first n, term by term."""
    length, tension = mpmath.mpf(string.length_m), mpmath.mpf(string.tension_n)
    b, angle = mpmath.mpf(string.inharmonicity), mpmath.pi / length
    linear = string.stiffness_law == "linear"
    places = [mpmath.mpf(float(place)) for place in x]
    compliance = [1 / ((j * angle) ** 2 * ((1 + b * j * j / 2) ** 2 if linear else 1 + b * j * j)) for j in range(1, n + 1)]
    sines = [[mpmath.sin(j * angle * place) for j in range(1, n + 1)] for place in places]
    exact = np.empty((len(places), len(places)), dtype=object)
    for i, m in zip(*np.triu_indices(len(places)), strict=True):
        near, far = sorted((places[i], places[m]))
        far = length - far
        whole = near * far / length
        if b:
            k = angle / mpmath.sqrt(b) * (mpmath.sqrt(2) if linear else 1)
            p = mpmath.sinh(k * near) * mpmath.sinh(k * far) / mpmath.sinh(k * length)
            if linear:
                slope = near * mpmath.coth(k * near) + far * mpmath.coth(k * far) - length * mpmath.coth(k * length)
                whole += p * slope / 2 - 3 * p / (2 * k)
            else:
                whole -= p / k
        part = mpmath.fsum(u * v * c for u, v, c in zip(sines[i], sines[m], compliance, strict=True))
        exact[i, m] = exact[m, i] = (whole - 2 / length * part) / tension
    return exact


@pytest.mark.parametrize("name", ["guitar", "guitar-linear", "rod", "rod-linear", "ideal"])
@pytest.mark.parametrize("n", [0, 1, 75, 600])
def test_residual_against_mpmath(name, n):
    """R is good to phases of up to 2πN, relative to itself: in the open, at the ends, and where contacts are close."""
    string = STRINGS[name]
    for shares in (
        [0.006, 0.31],
        [1e-9, 3e-9, 0.4],
        [6e-4, 6e-4 + 5.8e-11],
        [3e-5, 0.2, 1 - 2e-4, 1 - 2e-4 + 1e-10, 1 - 3e-8],
    ):
        x = np.array(shares) * string.length_m
        with mpmath.workdps(60):
            exact = exact_residual(string, x, n)
            residual = modes.residual_compliance(string, x, n)
            own = exact.diagonal()
            worst = 0.0
            for i, m in zip(*np.triu_indices(x.size), strict=True):
                opposite = shares[i] < 1e-3 and shares[m] > 1 - 1e-3
                scale = max(own[i], own[m]) if opposite else mpmath.sqrt(own[i] * own[m])
                worst = max(worst, abs(float((mpmath.mpf(float(residual[i, m])) - exact[i, m]) / scale)))
        assert worst < 1e-15 * (n + 10), (shares, worst)


def test_contacts_that_all_but_coincide_near_an_end_are_no_error():
    """Pairs 1e-13 to 1e-7 m apart, 1e-9 to 0.5 m from either end of a metre: none is refused, R stays semidefinite."""
    rng = np.random.default_rng(17)
    clipped = 0
    for _ in range(400):
        law, inharmonicity = str(rng.choice(["sqrt", "linear"])), float(rng.choice([0.0, 1e-5, 1e-3, 1e-2]))
        string = String.from_inharmonicity(1.0, 100.0, 1e-3, inharmonicity, 1e-3, stiffness_law=law)
        x = 10 ** rng.uniform(-9.0, -0.31) + np.array([0.0, 10 ** rng.uniform(-13.0, -7.0)])
        if rng.random() < 0.5:
            x = 1.0 - x[::-1]
        residual = modes.residual_compliance(string, x, int(rng.choice([10, 100, 1000, 10_000])))
        own = np.sqrt(residual.diagonal())
        assert np.all(own[x > 0.0] > 0.0)
        assert np.abs(residual).max() <= residual.diagonal().max() * (1.0 + 8 * EPS)
        least = np.linalg.eigvalsh(residual / np.outer(own, own))[0]
        assert least > -16 * EPS
        clipped += least < 16 * EPS
    assert clipped > 20, "contacts must come so close that rounding decides"


@pytest.mark.parametrize("n", [100, 1500])
def test_residual_of_the_linear_law_against_its_tail(n):
    string = STRINGS["bass-linear"]
    x = np.array([0.048, 0.0481, 0.3, 0.591])
    # Beyond mode 40000 the terms are below (2L/(π²T)) · 4/(B² j⁶): what the tail cut there lacks
    lacking = 2 * 0.863 / (math.pi**2 * 191.6) * 4 / (3.5e-5**2 * 5 * 40000.0**5)
    tail = modal_sum(string, x, n + 1, 40000)
    residual = modes.residual_compliance(string, x, n)
    assert np.abs(residual - tail).max() < lacking + 2e-13 * tail.max()


@pytest.mark.parametrize("n", [20, 700])
def test_residual_close_to_an_end(n):
    # N x ≪ L: the modes kept hold next to nothing, R is nearly all of G
    string = STRINGS["guitar"]
    x = 1e-5
    expected = modes.static_compliance(string, x, x) - modal_sum(string, np.array([x]), 1, n)[0, 0]
    allowed = 1e-15 * string.length_m / (string.tension_n * n) + 4 * EPS * x / string.tension_n
    assert abs(modes.residual_compliance(string, [x], n)[0, 0] - expected) < 4 * allowed


@given(strings, st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12), st.integers(0, 2000))
def test_residual_is_positive_semidefinite_wherever_the_contacts_are(string, shares, n):
    # Coinciding points, ends, neighbours at any distance
    x = np.sort(np.array(shares)) * string.length_m
    residual = modes.residual_compliance(string, x, n)
    assert np.array_equal(residual, residual.T)
    assert np.all(np.isfinite(residual))
    eigenvalues = np.linalg.eigvalsh(residual)
    assert eigenvalues[0] >= -16 * len(x) * EPS * eigenvalues[-1]


@given(strings, st.integers(0, 300), st.integers(1, 300))
def test_modes_that_join_leave_the_residual(string, n, more):
    x = np.array([0.05, 0.4, 0.77]) * string.length_m
    before = modes.residual_compliance(string, x, n)
    joined = modal_sum(string, x, n + 1, n + more)
    step = before - modes.residual_compliance(string, x, n + more)
    # Phases up to (n + more) π, each good to EPS of that
    assert np.abs(step - joined).max() < 20 * (n + more + 10) * EPS * before.max()


def test_residual_knows_neither_measured_values_nor_the_nut(guitar):
    other = dataclasses.replace(guitar, nut=NUT, measured_frequencies_hz=(150.0, 444.0), measured_decay_rates=(1.0,))
    x = [0.006, 0.3]
    assert np.array_equal(modes.residual_compliance(other, x, 75), modes.residual_compliance(guitar, x, 75))
    assert modes.static_compliance(other, 0.1, 0.3) == modes.static_compliance(guitar, 0.1, 0.3)


def test_residual_without_contacts(guitar):
    assert modes.residual_compliance(guitar, [], 10).shape == (0, 0)


def test_residual_outside_the_string(guitar):
    with pytest.raises(ValueError, match="positions must lie between"):
        modes.residual_compliance(guitar, [0.1, 1.1], 10)


def test_an_indefinite_residual_is_never_handed_on(guitar, monkeypatch):
    # cos jα₋ and cos jα₊ confused: the matrix turns negative and must not get out
    monkeypatch.setattr(modes, "_cosine_tail", lambda contour, angles: -np.cos(angles))
    with pytest.raises(ArithmeticError, match="residual compliance must be positive semidefinite, got"):
        modes.residual_compliance(guitar, [0.1, 0.3], 10)
