"""Modes of a body that explain a measured mobility matrix of its bridge: passive by construction.

    Y(ω) = Σ_m iω a_m a_mᵀ/(Ω_m² − ω² + iωΩ_m/Q_m),   a = ψ/√m real,   Ω, Q > 0

Poles common to all components by vector fitting (`vector_fitting`), a first a of each from non-negative least squares, then
all of Ω, Q and a together by non-linear least squares of Y/(|Y| + noise): as decibels count, but not within the noise. What
modes outside the band do inside is a mass line from below and a stiffness line from above; each is a mode an axis at a
quarter of the lowest and twice the highest frequency, so that nothing that is written can gain energy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from synth.fit.mobility import Component, Mobility
from synth.fit.modal_least_squares import (
    LEAST_Q,
    MOST_Q,
    REACH,
    Modes,
    Rows,
    explained_by,
    jacobian_of,
    refined,
    residual_of,
    stacked,
    unit_mobilities,
)
from synth.fit.vector_fitting import common_poles
from synth.physics.body_modes import AXES, Body, BodyMode

#: where the modes stand that stand for those outside the band, against its ends, and their Q
BELOW, ABOVE, OUTSIDE_Q = 0.25, 2.0, 30.0
#: the widest band [Hz]: what stands for what lies outside it is then at frequencies that a preset's body may have
LOWEST_HZ, HIGHEST_HZ = 20.0, 10000.0
#: masses [kg] and components of shapes that a preset's body may have; a greater mass is written with a smaller shape
LEAST_KG, MOST_KG, LONGEST = 1e-3, 900.0, 90.0
#: numbers of modes that are tried where none is asked for
TRIED = (2, 4, 6, 8, 10, 12, 15, 18, 22, 27, 33, 40, 50, 60)
MOST_MODES = 100
#: rows that are looked at one by one; of more, neighbours within 1/RESOLUTION of their frequency are averaged
MOST_ROWS, RESOLUTION = 1500, 600.0
#: standard errors that a mode must stand out by
SIGNIFICANT = 6.0
#: least part of the weighted power that a fit must explain
EXPLAINED = 0.5
#: contributions so far below the mobility are left out [dB]
NEGLIGIBLE_DB = -60.0
#: negative real parts of driving-point mobilities that are noise, as part of all rows
NEGATIVE = 0.5


class MobilityRefused(ValueError):
    """A measurement that cannot be fitted; the message says why and what would help."""


@dataclass(frozen=True)
class Deviation:
    """Level of the fitted against the measured component, |dB| over the rows of the band."""

    median_db: float
    ninetieth_db: float
    worst_db: float


@dataclass(frozen=True)
class BodyFit:
    """The fit.

    modes      in and near the band, rising in frequency
    outside    those that stand for what lies below and above it
    band_hz    (low, high) of the rows used
    rows       how many
    errors     by component
    explained  part of the weighted power, 1 is all
    warnings   what a reader should know
    """

    modes: tuple[BodyMode, ...]
    outside: tuple[BodyMode, ...]
    band_hz: tuple[float, float]
    rows: int
    errors: dict[Component, Deviation]
    explained: float
    warnings: tuple[str, ...]

    @property
    def body(self) -> Body:
        """All modes."""
        return Body(tuple(sorted((*self.modes, *self.outside), key=lambda mode: mode.frequency_hz)))


# its matrices are small: threads of linear algebra would take five times the work, and no less time
@threadpool_limits.wrap(limits=1, user_api="blas")
def fit_body(measured: Mobility, band_hz: tuple[float, float] | None = None, modes: int | None = None) -> BodyFit:
    """Modes for a measured mobility; at most `modes` of them in and near the band, or as many as Bayes' information
    criterion finds worth their unknowns. Without a band, the rows from 20 Hz to 10 kHz. Raises MobilityRefused, and
    ValueError for a band without rows or beyond that."""
    low, high = (LOWEST_HZ, HIGHEST_HZ) if band_hz is None else band_hz
    if not LOWEST_HZ <= low < high <= HIGHEST_HZ:
        raise ValueError(
            f"band must rise from {LOWEST_HZ:g} Hz or above to at most {HIGHEST_HZ:g} Hz, got {low:g} to {high:g} Hz"
        )
    measured = measured.within(low, high)
    warnings = _checked(measured)
    data = _reduced(measured)
    if modes is not None and 4 * modes > data.omega.size:
        raise ValueError(
            f"modes must be at most a quarter of the {data.omega.size} rows, got {modes}; widen the band or measure more "
            "finely"
        )
    found = refined(data, _first_modes(data, modes))
    for _ in range(3):
        keep = _standing_out(data, found)
        if keep.all():
            break
        found = refined(data, found.chosen(keep))
    explained = explained_by(data, found)
    if not np.any(~found.outside) or explained < EXPLAINED:
        raise MobilityRefused(
            f"no modes stand out of the noise ({100 * max(0.0, explained):.0f} % of the mobility explained); "
            "check coherence, the signs (the real part is positive), that it is a mobility (velocity per force), the band "
            "and --modes"
        )
    return _told(measured, data, found, explained, warnings)


def _checked(measured: Mobility) -> list[str]:
    """Warnings. Raises MobilityRefused where the real part of a driving-point mobility is negative at large."""
    warnings = []
    for (i, j), y in measured.components.items():
        within = np.count_nonzero(np.abs(y) < 3.0 * _noise(y)) / y.size
        if within > 0.1:
            warnings.append(
                f"y{i}{j} lies within its noise in {100 * within:.0f} % of the rows, where its levels are meaningless"
            )
        if i != j:
            continue
        negative = np.count_nonzero(y.real < 0.0) / y.size
        power = float(np.sum(np.minimum(y.real, 0.0) ** 2) / max(float(np.sum(y.real**2)), 1e-300))
        if power > NEGATIVE:
            raise MobilityRefused(
                f"the real part of y{i}{j} must be positive, as no body gives energy, got negative in "
                f"{100 * negative:.0f} % of the band; reverse the sign of the force or of the velocity, or check "
                "that it is a mobility (velocity per force)"
            )
        if negative > 0.05:
            warnings.append(
                f"the real part of y{i}{j} is negative in {100 * negative:.0f} % of the band: noise, or a phase error"
            )
    return warnings


def _reduced(measured: Mobility) -> Rows:
    """Rows averaged where they lie closer than any resonance is narrow, and weights."""
    axes = measured.axes
    pairs = sorted(measured.components)
    y = np.array([measured.components[pair] for pair in pairs])
    frequency = measured.frequency_hz
    noise = np.array([_noise(each) for each in y])
    count = np.ones(frequency.size)
    if frequency.size > MOST_ROWS:
        cell = np.floor(RESOLUTION * np.log(frequency / frequency[0])).astype(np.int64)
        first = np.flatnonzero(np.diff(cell, prepend=-1))
        count = np.diff(np.append(first, frequency.size)).astype(np.float64)
        frequency = np.add.reduceat(frequency, first) / count
        y = np.add.reduceat(y, first, axis=1) / count
    floor = noise[:, None] / np.sqrt(count)
    largest = np.abs(y).max(axis=1, keepdims=True)
    # what is nothing at all, as between axes of a symmetric body, counts by the size of the others
    size = np.maximum(np.sqrt(np.abs(y) ** 2 + floor**2), np.where(largest > 0.0, 1e-6 * largest, largest.max()))
    columns = [(axes.index(i), axes.index(j)) for i, j in pairs]
    return Rows(2.0 * math.pi * frequency, y, 1.0 / size, columns, axes)


def _noise(y: NDArray[np.complex128]) -> float:
    """Standard deviation of what differs from row to row, in a robust way."""
    rough = np.abs(y[2:] - 2.0 * y[1:-1] + y[:-2])
    return float(np.median(rough) / math.sqrt(6.0 * math.log(2.0)))


# --- a first guess ----------------------------------------------------------------------------------------------------


def _first_modes(data: Rows, modes: int | None) -> Modes:
    # the poles of the matrix are those of its diagonal
    own = [row for row, (i, j) in enumerate(data.pairs) if i == j]

    def looked_for(count: int) -> Modes:
        return _from_poles(data, common_poles(data.omega, data.y[own], data.weights[own], count))

    if modes is not None:
        return looked_for(modes)
    best, least = None, math.inf
    unknowns = data.omega.size * len(data.pairs) * 2
    worse = 0
    for count in TRIED:
        if 8 * count > data.omega.size:
            break
        found = looked_for(count)
        left = max(1e-12, _left_by_poles(data, found))
        criterion = unknowns * math.log(left) + np.count_nonzero(~found.outside) * (2 + len(data.pairs)) * math.log(unknowns)
        worse = 0 if criterion < least else worse + 1
        if criterion < least:
            best, least = found, criterion
        if worse == 3:
            break
    assert best is not None
    return best


def _from_poles(data: Rows, poles: NDArray[np.complex128]) -> Modes:
    """Modes at the poles that are some, and one an axis below and above the band; a by least squares."""
    low, high = data.omega[0], data.omega[-1]
    omega, loss = np.abs(poles), -2.0 * poles.real / np.abs(poles)
    fine = (omega > low / REACH) & (omega < high * REACH) & (loss < 1.0 / LEAST_Q)
    omega, loss = omega[fine], np.maximum(loss[fine], 1.0 / MOST_Q)
    d = len(data.axes)
    outside = np.concatenate([np.zeros(omega.size, bool), np.ones(2 * d, bool)])
    free = np.vstack([np.ones((omega.size, d), bool), *[np.tri(d, dtype=bool).T] * 2])
    omega = np.concatenate([omega, np.full(d, BELOW * low), np.full(d, ABOVE * high)])
    loss = np.concatenate([loss, np.full(2 * d, 1.0 / OUTSIDE_Q)])
    modes = Modes(omega, loss, np.zeros((omega.size, d)), free, outside)
    modes.a = _amplitudes(data, modes)
    return modes


def _left_by_poles(data: Rows, modes: Modes) -> float:
    """Part of the weighted power that real residues of any sign at the modes' poles, each component's own, leave."""
    basis, left = unit_mobilities(data.omega, modes), 0.0
    for y, weight in zip(data.y, data.weights, strict=True):
        matrix, right = stacked(basis * weight), stacked((y * weight)[None])[:, 0]
        unit = 1.0 / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        left += float(np.sum((matrix * unit @ np.linalg.lstsq(matrix * unit, right, rcond=1e-12)[0] - right) ** 2))
    return left / float(np.sum(np.abs(data.y * data.weights) ** 2))


def _amplitudes(data: Rows, modes: Modes) -> NDArray[np.float64]:
    """a (M, axes): squares of the measured axes by non-negative least squares, signs by that of the components between."""
    from scipy.optimize import nnls

    basis = unit_mobilities(data.omega, modes)
    d = len(data.axes)
    squares = np.zeros((modes.omega.size, d))
    for (i, j), y, weight in zip(data.pairs, data.y, data.weights, strict=True):
        if i != j:
            continue
        mine = ~modes.outside | (np.abs(modes.a).sum(axis=1) == 0.0) & modes.free[:, i]
        # of the modes outside, the i-th of each end is axis i's
        ends = np.flatnonzero(modes.outside)
        mine[ends] = np.arange(ends.size) % d == i
        matrix, right = stacked(basis[mine] * weight), stacked((y * weight)[None])[:, 0]
        unit = 1.0 / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
        squares[mine, i] = nnls(matrix * unit, right)[0] * unit
    a = np.sqrt(squares)
    inside = np.flatnonzero(~modes.outside)
    typical = np.maximum(np.median(a[inside], axis=0), 1e-12) if inside.size else np.ones(d)
    a[inside] = np.maximum(a[inside], 1e-3 * typical)
    for (i, j), y, weight in zip(data.pairs, data.y, data.weights, strict=True):
        if i == j or i != 0 or not inside.size:
            continue
        between = np.linalg.lstsq(stacked(basis[inside] * weight), stacked((y * weight)[None])[:, 0], rcond=None)[0]
        if (j, j) in data.pairs:
            a[inside, j] *= np.where(between < 0.0, -1.0, 1.0)
        else:
            a[inside, j] = np.clip(between / a[inside, 0], -10.0 * a[inside, 0], 10.0 * a[inside, 0])
    return a


def _standing_out(data: Rows, modes: Modes) -> NDArray[np.bool_]:
    """Which modes to keep: inside those that stand out of what is not explained, outside those that are not negligible."""
    jacobian, residual = jacobian_of(data, modes), residual_of(data, modes)
    freedom = max(1, residual.size - jacobian.shape[1])
    variance = float(residual @ residual) / freedom
    inside = ~modes.outside
    k = int(np.count_nonzero(inside))
    # of each mode the strongest of its a against its error, all other a being free
    amplitudes = jacobian[:, 2 * k :]
    unit = 1.0 / np.maximum(np.linalg.norm(amplitudes, axis=0), 1e-300)
    covariance = np.linalg.pinv((amplitudes * unit).T @ (amplitudes * unit), rcond=1e-12, hermitian=True)
    error = np.full(modes.a.shape, np.inf)
    error[modes.free] = np.sqrt(np.maximum(variance * np.diag(covariance), 0.0)) * unit
    strength = np.max(np.abs(modes.a) / np.maximum(error, 1e-300), axis=1)
    bounded = inside & ((modes.loss > 0.999 / LEAST_Q) | (modes.loss < 1.001 / MOST_Q))
    spacing = np.interp(modes.omega, data.omega, np.gradient(data.omega))
    spike = inside & (modes.omega * modes.loss < spacing)  # narrower than the rows lie apart
    keep = np.where(inside, (strength > SIGNIFICANT) & ~bounded & ~spike, True)
    gains = unit_mobilities(data.omega, modes)
    share = np.zeros(modes.omega.size)
    for (i, j), weight in zip(data.pairs, data.weights, strict=True):
        if i == j:
            share = np.maximum(share, np.max(modes.a[:, i, None] ** 2 * np.abs(gains) * weight, axis=1))
    return keep & (share > 10 ** (NEGLIGIBLE_DB / 20.0))


# --- what came out ----------------------------------------------------------------------------------------------------


def _told(measured: Mobility, data: Rows, modes: Modes, explained: float, warnings: list[str]) -> BodyFit:
    width = max(data.axes)
    tables = []
    for omega, loss, a in zip(modes.omega, modes.loss, modes.a, strict=True):
        shape = np.zeros(width)
        shape[[axis - 1 for axis in data.axes]] = a
        # of unit length in the plane across the string, normal upwards: then the mass is that which moves
        length = float(np.linalg.norm(shape[:2])) or float(np.linalg.norm(shape))
        mass = min(max(1.0 / length**2, LEAST_KG), MOST_KG, (LONGEST / np.abs(shape).max()) ** 2)
        shape *= math.copysign(math.sqrt(mass), shape[np.flatnonzero(shape)[0]])
        tables.append(BodyMode(float(omega / (2.0 * math.pi)), float(1.0 / loss), float(mass), tuple(shape)))
    order = np.argsort(modes.omega)
    inside = tuple(tables[k] for k in order if not modes.outside[k])
    outside = tuple(tables[k] for k in order if modes.outside[k])
    fitted = Body((*inside, *outside)).mobility(2.0 * math.pi * measured.frequency_hz)
    errors = {}
    for (i, j), y in measured.components.items():
        own = np.abs(y).max()
        floor = 1e-12 * own if own > 0.0 else 1e-3 * max(np.abs(other).max() for other in measured.components.values())
        off = np.abs(20.0 * np.log10((np.abs(fitted[:, i - 1, j - 1]) + floor) / (np.abs(y) + floor)))
        errors[i, j] = Deviation(float(np.median(off)), float(np.quantile(off, 0.9)), float(off.max()))
    silent = [AXES[axis - 1] for axis in range(1, width) if axis not in data.axes]
    if silent:
        warnings = [*warnings, f"not measured and written as 0: {', '.join(silent)}"]
    band = (float(measured.frequency_hz[0]), float(measured.frequency_hz[-1]))
    return BodyFit(inside, outside, band, measured.frequency_hz.size, errors, explained, tuple(warnings))
