"""Modal frequencies, decay rates, shapes and static compliance of a string [IA2018 A1–A5].

Modes j = 1 … n of a simply supported string, φ_j(x) = √(2/L) sin(jπx/L), u = Σ_j q_j φ_j(x), so that q_j has
the unit m·√m and μ(q̈_j + 2σ_j q̇_j + ω_j² q_j) = F_j. A mode may be overdamped (σ_j > ω_j): high
ones often are.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from synth.physics.string import String
from synth.physics.uneven_mass import frequency_factors

#: N·(distance to an end)·π/L from which on a difference of two cosine sums gives R without loss
_DIFFERENCE_FROM = 1.0
#: furthest s of a contour: z = e^s/2, and z⁶ is still a number
_FARTHEST = 100.0
#: products of pairs and nodes that are made at once
_AT_ONCE = 1 << 21
#: modes whose frequencies are computed in one go: a multiple of these
_MODES_AT_ONCE = 256


def base_frequencies(string: String, n: int) -> np.ndarray:
    """ω̂_j (n,) [rad/s]: the stiffness law alone, without nut mobility and never measured values."""
    return 2.0 * math.pi * string.fundamental_hz * _mode_numbers(n) * _stiffness_factor(string, n)


def nut_mobility(string: String, omega: np.ndarray | float) -> np.ndarray:
    """Y_nut(ω) = Σ iω/(m(ω_n² − ω² + iωω_n/Q)) [m/(N s)], complex, for e^(+iωt); ω in rad/s, any shape."""
    omega = np.asarray(omega, dtype=np.float64)
    if not string.nut:
        return np.zeros(omega.shape, dtype=np.complex128)
    omega_n, mass, q = string.nut_rows
    omega = omega[..., None]  # sums along the last axis are the same, whatever the shape
    elastic, lossy = omega_n**2 - omega**2, omega * (omega_n / q)
    share = omega / (mass * (elastic * elastic + lossy * lossy))
    mobility = np.empty(omega.shape[:-1], dtype=np.complex128)
    mobility.real, mobility.imag = (share * lossy).sum(axis=-1), (share * elastic).sum(axis=-1)
    return mobility


def model_frequencies(string: String, n: int) -> np.ndarray:
    """ω_j (n,) [rad/s] of the model, stiffness, nut mobility and uneven mass [IA2018 A1]; never measured values.

    ν_j = ν_0j (s_j − (μc/(jπ)) Im Y_nut(jπc/L)) with s_j = √(1 + Bj²) or 1 + Bj²/2, times `frequency_factors`. The sign
    is that of e^(+iωt): below a nut resonance the string sounds lower (the end gives way like a spring), above it
    higher. Raises ValueError where the mobility is so great that a frequency would not be positive.
    """
    j = _mode_numbers(n)
    if n <= 1:  # asked for at tension after tension, as a string is tuned
        factors = _frequency_factors(string, int(n))
    else:
        factors = _kept_factors(string, _MODES_AT_ONCE * -(-int(n) // _MODES_AT_ONCE))[: int(n)]
    if not np.all(factors > 0.0):
        mode = int(np.argmin(factors)) + 1
        raise ValueError(
            f"nut mobility must leave mode {mode} a positive frequency, got a factor {factors[mode - 1]:.3g}; "
            "raise mass_kg of the nut resonances"
        )
    return 2.0 * math.pi * string.fundamental_hz * j * factors


def _frequency_factors(string: String, n: int) -> np.ndarray:
    """(n,) frequencies over those of an ideal string on rigid ends, the same whatever n: `model_frequencies`."""
    j = _mode_numbers(n)
    mobility = nut_mobility(string, 2.0 * math.pi * string.fundamental_hz * j)
    end_correction = -string.impedance_kg_s / (math.pi * j) * mobility.imag  # μc = √(Tμ)
    factors = _stiffness_factor(string, n) + end_correction
    if string.mass_scatter > 0.0 and n > 1:
        factors = factors * frequency_factors(string.length_m, string.mass_scatter, string.seed, n)
    factors.flags.writeable = False
    return factors


# a string that is planned and compiled is asked for several numbers of modes
_kept_factors = lru_cache(maxsize=4)(_frequency_factors)


def model_decay_rates(string: String, n: int) -> np.ndarray:
    """σ_j = πν_j/Q_j (n,) [1/s] of the model [IA2018 A2–A5]: air, material and nut; never measured values.

    Nothing bounds σ_j by ω_j: an overdamped mode is a mode like the others.
    """
    omega = model_frequencies(string, n)
    nu = omega / (2.0 * math.pi)
    nu_0 = string.fundamental_hz * _mode_numbers(n)
    mu, tension = string.linear_density_kg_m, string.tension_n

    eta, rho = string.air_viscosity, string.air_density
    drag = 2.0 * math.pi * (eta + string.equivalent_diameter_m * np.sqrt(math.pi * eta * rho * nu))
    q_air_inverse = nu_0 / nu * drag / (2.0 * math.pi * mu * nu)
    bending_loss = string.bending_stiffness_n_m2 * string.viscoelastic_loss
    q_ve_inverse = 4.0 * math.pi**2 * mu * bending_loss / tension**2 * nu_0**3 / nu
    q_nut_inverse = tension / (math.pi * string.length_m * nu) * nut_mobility(string, omega).real  # μc² = T
    return math.pi * nu * (q_air_inverse + q_ve_inverse + string.thermoelastic_q_inverse + q_nut_inverse)


def modal_frequencies(string: String, n: int) -> np.ndarray:
    """ω_j (n,) [rad/s]: measured where the string has measured values, the model behind them."""
    measured_hz = np.array(string.measured_frequencies_hz, dtype=np.float64)
    return _measured_first(2.0 * math.pi * measured_hz, model_frequencies(string, n))


def decay_rates(string: String, n: int) -> np.ndarray:
    """σ_j (n,) [1/s]: measured where the string has measured values, the model behind them."""
    measured = np.array(string.measured_decay_rates, dtype=np.float64)
    return _measured_first(measured, model_decay_rates(string, n))


def count_modes_below(string: String, frequency_hz: float) -> int:
    """How many modes, counted from the first, lie below frequency_hz [Hz] before one does not."""
    if not (frequency_hz >= 0.0 and math.isfinite(frequency_hz)):
        raise ValueError(f"frequency_hz must be >= 0 Hz and finite, got {frequency_hz}")
    limit = 2.0 * math.pi * frequency_hz
    n = 16
    while True:
        reached = modal_frequencies(string, n) >= limit
        if reached.any():
            return int(np.argmax(reached))
        n *= 2


def mode_shapes(length_m: float, positions_m: np.ndarray | Sequence[float] | float, n: int) -> np.ndarray:
    """φ_j(x_p) = √(2/L) sin(jπx_p/L) → (P, n) [1/√m] for positions (P,) [m]; outside [0, L]: ValueError."""
    x = _positions(positions_m, length_m)
    return math.sqrt(2.0 / length_m) * np.sin(np.outer(x, _mode_numbers(n) * (math.pi / length_m)))


def force_weights(string: String, position_m: float, n: int) -> np.ndarray:
    """(n,) weights w of the transverse force T u_x − EI u_xxx = Σ w_j q_j at position_m [N/(m·√m)].

    At x = L it is the bridge force Σ_j (−1)^j √(2/L) (T k_j + EI k_j³) q_j with k_j = jπ/L. No stiffness law
    enters: the force is that of the shape.
    """
    x = _positions(position_m, string.length_m)[0]
    k = _mode_numbers(n) * (math.pi / string.length_m)
    transverse = string.tension_n * k + string.bending_stiffness_n_m2 * k**3
    return math.sqrt(2.0 / string.length_m) * transverse * np.cos(k * x)


def static_compliance(string: String, position_m: np.ndarray | float, force_position_m: np.ndarray | float) -> np.ndarray:
    """G(x, y) = Σ_j φ_j(x) φ_j(y)/(μω̂_j²) over *all* modes [m/N]: displacement at x per static force at y.

    Arrays broadcast. In closed form for either law; with P = sinh κx sinh κ(L−y)/sinh κL for x ≤ y

        EI = 0   T G = x(L−y)/L
        sqrt     T G = x(L−y)/L − P/κ,                κ = √(T/EI): the pinned stiff string's Green function
        linear   T G = x(L−y)/L − 3P/(2κ) + P'/2,     κ = √(2T/EI), P' = dP/dκ,

    the last by partial fractions of 1/(k²(1 + k²/κ²)²), what ω̂_j = jπc/L (1 + Bj²/2) makes of each mode.
    Rounding error is some 1e-16 of x(L−y)/(TL). Raises ValueError for positions outside [0, L].
    """
    length, tension = string.length_m, string.tension_n
    a, b = np.broadcast_arrays(_inside(position_m, length), _inside(force_position_m, length))
    x, y = np.minimum(a, b), length - np.maximum(a, b)  # each point's distance from the end on its side
    compliance = x * y / length
    if string.bending_stiffness_n_m2 > 0.0:
        linear = string.stiffness_law == "linear"
        kappa = math.sqrt((2.0 if linear else 1.0) * tension / string.bending_stiffness_n_m2)
        gap = np.abs(a - b)
        p = (
            -0.5
            * np.exp(-kappa * gap)
            * np.expm1(-2.0 * kappa * x)
            * np.expm1(-2.0 * kappa * y)
            / math.expm1(-2.0 * kappa * length)
        )
        if linear:
            # dP/dκ = P (x coth κx + y coth κy − L coth κL); the ones in coth z = 1 + excess add up to −gap
            excess = _coth_excess(kappa * x) + _coth_excess(kappa * y) - _coth_excess(kappa * length)
            compliance = compliance - 1.5 * p / kappa + 0.5 * p * (excess / kappa - gap)
        else:
            compliance = compliance - p / kappa
    return compliance / tension


def residual_compliance(string: String, positions_m: np.ndarray | Sequence[float], n_modes: int) -> np.ndarray:
    """R = Σ_{j>N} φ_j φ_jᵀ/(μω̂_j²) (C, C) [m/N]: static compliance of the modes left out above N = n_modes.

    ω̂ is the model's stiffness law alone: never measured values, no mobility, whatever the modes kept use.
    With φ_j(x) φ_j(y) = (cos jα₋ − cos jα₊)/L, α± = π(x ± y)/L, R needs only tails of cosine sums
    (`_cosine_tail`), and of products of sines where a contact is so close to an end that the cosines cancel
    (`_sine_tail`). R_ab is good to 1e-15·(N + 10) of √(R_aa R_bb) (of the greater one, where a is close to one end
    and b to the other), the rounding of phases up to 2πN, however close contacts are to an end and to each other.
    The difference static_compliance − Σ_{j≤N} is the same in exact
    arithmetic, but loses 7 to 10 digits at 1000 modes.

    R is symmetric and positive semidefinite; negative eigenvalues at rounding level (points that all but coincide)
    are set to zero, anything beyond raises ArithmeticError. ValueError for positions outside [0, L].
    """
    x = _positions(positions_m, string.length_m)
    if x.size == 0:
        return np.zeros((0, 0))
    length = string.length_m
    row, column = np.triu_indices(x.size)
    angle = math.pi / length
    apart = angle * np.abs(x[row] - x[column])
    contour = _tail_contour(string, n_modes)
    minus = _cosine_tail(contour, apart)
    pairs = minus - _cosine_tail(contour, angle * (x[row] + x[column]))

    # sin ja sin jb from the end that is nearer to a pair; L − x is exact where it matters
    far = x[row] + x[column] > length
    inward = angle * np.where(far, length - np.maximum(x[row], x[column]), np.minimum(x[row], x[column]))
    cancels = inward * (n_modes + 1) < _DIFFERENCE_FROM
    if cancels.any():
        pairs[cancels] = _sine_tail(string, apart[cancels], inward[cancels], n_modes)
    residual = np.empty((x.size, x.size))
    residual[row, column] = residual[column, row] = pairs / length

    eigenvalues, vectors = np.linalg.eigh(residual)
    if eigenvalues[0] < 0.0:
        # 600 nodes, a rounding each, and that of phases up to 2πN
        rounding = (1e-13 + 4e-15 * n_modes) * x.size * minus.max() / length
        if eigenvalues[0] < -rounding:
            raise ArithmeticError(
                "residual compliance must be positive semidefinite, "
                f"got an eigenvalue of {eigenvalues[0]:.3g} m/N where rounding explains {-rounding:.3g} m/N"
            )
        # in units of each contact's own compliance, so that one near an end keeps its digits beside one that is not
        own = np.sqrt(np.maximum(residual.diagonal(), 0.0))
        per_own = np.divide(1.0, own, out=np.zeros_like(own), where=own > 0.0)
        eigenvalues, vectors = np.linalg.eigh(per_own[:, None] * residual * per_own)
        residual = own[:, None] * ((vectors * np.maximum(eigenvalues, 0.0)) @ vectors.T) * own
        residual = 0.5 * (residual + residual.T)
    return residual


class _Contour(NamedTuple):
    """Where a sum over the modes j > N is an integral: nodes z (n,), their Im z, and weights of e^{iαz}."""

    z: np.ndarray
    height: np.ndarray
    weights: np.ndarray


def _tail_contour(string: String, n_modes: int, reach: float = 0.0) -> _Contour:
    """Σ_{j>N} cos(jα)/(μω̂_j²) = Re Σ_k weights_k e^{iαz_k} for angles α in [0, π] [m²/N].

    By residues it is Re ∮ e^{iαz} g(z)/(e^{2πiz} − 1) dz, g(j) = 1/(μω̂_j²), round the integers beyond N. The
    contour z(s) = N + ½ + (cosh s − 1) + i sinh s bends away from g's poles at 0 and ±i/√B. Along it the
    integrand falls doubly exponentially or as g times e^{−α Im z}, and is analytic within |Im s| < 0.42, so
    that the trapezoidal rule with step 0.07 errs by e^{−2π·0.42/0.07} = 4e-17. `reach`: how far s must go at least.
    """
    _mode_numbers(n_modes)
    s = np.arange(-3.5, max(42.0 + math.log1p(n_modes), reach), 0.07)  # up to where even 1/z² has fallen to rounding
    sinh, cosh = np.sinh(s), np.cosh(s)
    z = n_modes + 0.5 + (cosh - 1.0) + 1j * sinh
    stiffening = string.inharmonicity * z**2
    law = (1.0 + 0.5 * stiffening) ** 2 if string.stiffness_law == "linear" else 1.0 + stiffening
    g = string.length_m**2 / (math.pi**2 * string.tension_n) / (z**2 * law)
    # e^{±2πiz}, the sign that decays; e^{2πi(N+½)} = −1 is taken out exactly
    upper = sinh > 0.0
    sign = np.where(upper, 1.0, -1.0)
    decaying = -np.exp(2.0 * math.pi * (-np.abs(sinh) + 1j * sign * (cosh - 1.0)))
    kernel = np.where(upper, 1.0 / (decaying - 1.0), decaying / (1.0 - decaying))
    return _Contour(z, sinh, -0.07 * (sinh + 1j * cosh) * g * kernel)


def _cosine_tail(contour: _Contour, angles: np.ndarray) -> np.ndarray:
    """Σ_{j>N} cos(jα)/(μω̂_j²) for angles α in [0, 2π], one per angle [m²/N]."""
    z, height, weights = contour
    # The same cosines with α ≤ π, so that e^{iαz} never outgrows the kernel; every diagonal of R asks for α = 0
    alpha, where = np.unique(np.minimum(angles, 2.0 * math.pi - angles), return_inverse=True)
    tail = np.full(alpha.size, weights.real.sum())
    positive = alpha > 0.0
    if positive.any():
        heard = height * alpha[positive][0] < 40.0  # e^{−α Im z} ends the integral long before g does
        tail[positive] = (np.exp(1j * np.outer(alpha[positive], z[heard])) @ weights[heard]).real
    return tail[where]


def _sine_tail(string: String, apart: np.ndarray, inward: np.ndarray, n_modes: int) -> np.ndarray:
    """2 Σ_{j>N} sin(jβ) sin(j(β + α))/(μω̂_j²), one per pair (P,) of α = apart ≥ 0 and β = inward ≥ 0, α + 2β ≤ π [m²/N].

    The sum of −e^{iαz}(e^{2iβz} − 1), real part, and so good relative to itself however small β is, with α near 0. Of its
    series in α and β the first term, −2iβz, has a sum that is imaginary: where the angles are small to the modes, z ~ N, it
    is left out, cut off by 1/(1 + (z/M)²) beyond M = 1/(α + 2β) so that it converges; stiff strings have R ∝ β(α + β).
    """
    tail = np.zeros(apart.size)
    off_end = np.flatnonzero(inward > 0.0)
    if off_end.size == 0:
        return tail
    # where the sine is seen to be one: 1/β further than 1/z² needs by itself
    z, _, weights = _tail_contour(string, n_modes, min(40.0 - math.log(inward[off_end].min()), _FARTHEST))
    for some in np.array_split(off_end, 1 + off_end.size * z.size // _AT_ONCE):
        alpha, beta = apart[some, None], 2.0 * inward[some, None]
        whole, step = np.expm1(1j * alpha * z), 1j * beta * z
        moved = np.expm1(step)
        cut = (z * (alpha + beta)) ** 2
        without_first = whole * moved + _expm2(step, moved) + step * cut / (1.0 + cut)
        small = (alpha + beta) * (n_modes + 1) < 1.0
        tail[some] = -(np.where(small, without_first, (1.0 + whole) * moved) @ weights).real
    return tail


def _expm2(x: np.ndarray, expm1: np.ndarray) -> np.ndarray:
    """e^x − 1 − x without cancellation, given e^x − 1."""
    series = np.zeros_like(x)
    near = np.where(np.abs(x) < 0.3, x, 0.0)
    for k in range(14, 1, -1):
        series = (series + 1.0) * near / k
    return np.where(np.abs(x) < 0.3, series * near, expm1 - x)


def _stiffness_factor(string: String, n: int) -> np.ndarray:
    stiffening = string.inharmonicity * _mode_numbers(n) ** 2
    return 1.0 + 0.5 * stiffening if string.stiffness_law == "linear" else np.sqrt(1.0 + stiffening)


def _coth_excess(z: np.ndarray | float) -> np.ndarray:
    """z (coth z − 1), 1 at z = 0, without overflow."""
    z = np.asarray(z, dtype=np.float64)
    safe = np.where(z > 0.0, z, 1.0)
    return np.where(z > 0.0, -2.0 * safe * np.exp(-2.0 * safe) / np.expm1(-2.0 * safe), 1.0)


def _measured_first(measured: np.ndarray, model: np.ndarray) -> np.ndarray:
    return np.concatenate([measured[: model.size], model[measured.size :]])


def _mode_numbers(n: int) -> np.ndarray:
    if n != int(n) or n < 0:
        raise ValueError(f"number of modes must be a whole number >= 0, got {n}")
    return np.arange(1, int(n) + 1, dtype=np.float64)


def _positions(positions_m: np.ndarray | Sequence[float] | float, length_m: float) -> np.ndarray:
    return np.atleast_1d(_inside(positions_m, length_m))


def _inside(positions_m: np.ndarray | Sequence[float] | float, length_m: float) -> np.ndarray:
    x = np.asarray(positions_m, dtype=np.float64)
    outside = ~((x >= 0.0) & (x <= length_m))
    if outside.any():
        raise ValueError(f"positions must lie between 0 and {length_m:g} m, got {x[outside].flat[0]:g} m")
    return x


def ramp_moments(length_m: float, n: int) -> np.ndarray:
    """c (n,) [√m]: ∫ φ_j x/L dx of the first n mode shapes, each one's share in the straight line from (0, 0) to (L, 1)."""
    j = np.arange(1, n + 1)
    return math.sqrt(2.0 * length_m) * np.where(j % 2, 1.0, -1.0) / (j * math.pi)
