"""Every number of a case × what slips of the pen and of units make of it: refused by its name, or a run like any other."""

from __future__ import annotations

import copy
import math
import types
import typing

import numpy as np
import pytest
from pydantic import BaseModel

from synth.research.case import Case, CaseError
from synth.research.simulation import simulate

BAD = (1e308, 1e-308, 5e-324, 0.0, -1.0, -1e308, math.nan, math.inf, -math.inf)

STRING = {
    "length_m": 1.0,
    "tension_n": 100.0,
    "linear_density_kg_m": 5e-3,
    "diameter_m": 1e-3,
    "inharmonicity": 1e-4,
    "core_diameter_m": 0.5e-3,
    "winding_diameter_m": 0.25e-3,
    "viscoelastic_loss": 0.01,
    "thermoelastic_q_inverse": 1e-4,
    "air_viscosity": 1.8e-5,
    "air_density": 1.2,
    "nut": [{"frequency_hz": 80.0, "q": 20.0, "mass_kg": 2.0}],
}
RUN = {
    "internal_rate_hz": 20_000.0,
    "output_rate_hz": 10_000.0,
    "modes": 6,
    "duration_s": 0.004,
    "outputs_m": [0.3, 0.9],
    "ledger": True,
}
TRIANGLE = {"shape": "triangle", "position_m": 0.4, "displacement_m": 2e-3, "rounding_half_width_m": 0.05}
POINTS = {"positions_m": [0.3, 0.5], "heights_m": [-1e-4, -2e-4]}
MOVING = {
    "ramp": [{"start_s": 0.001, "duration_s": 0.001, "displacement_m": 1e-4}],
    "sine": [{"start_s": 0.001, "frequency_hz": 300.0, "amplitude_m": 1e-4}],
}
FINGER = {
    "position_m": 0.6,
    "displacement_m": 1e-3,
    "width_m": 0.02,
    "start_s": 0.0005,
    "draw_s": 0.001,
    "hold_s": 0.0005,
    "slip_s": 0.0005,
    "stiffness_n_m": 1e5,
    "resistance_n_s_m": 1.0,
}
BASE = {"string": STRING, "obstacle": POINTS, "initial": TRIANGLE, "run": RUN}
COMPLIANT = {"stiffness": 1e10, "exponent": 1.5}
FRETS = {"scale_length_m": 1.0, "count": 12, "action_12th_m": 2e-3, "relief_m": 1e-4, "nut_height_m": 4e-4}
LAYER = {"stiffness_n_m": 1e5, "resistance_n_s_m": 1.0, "thickness_m": 5e-5}
BRIDGE = {"top_m": 0.05, "height_m": -1e-4, "radius_m": 1.0}

CASES = {
    "finger": {**BASE, "finger": [FINGER], "scheme": {"tail": "lumped", "substeps": 2, "restitution": 0.5}},
    "moving and bent": {
        **BASE,
        "obstacle": {**POINTS, "motion": MOVING},
        "initial": {**{k: v for k, v in TRIANGLE.items() if k != "rounding_half_width_m"}, "width_m": 0.1},
        "bend": [{"start_s": 0.001, "duration_s": 0.002, "cents": 100.0}],
    },
    "modes": {
        **BASE,
        "string": {**{k: v for k, v in STRING.items() if k != "inharmonicity"}, "bending_stiffness_n_m2": 1e-3},
        "obstacle": {"positions_m": [0.3], "heights_m": -1e-4},
        "initial": {"shape": "modes", "q": [1e-3, 1e-4], "v": [0.1]},
        "scheme": {"tail": "none"},
    },
    "linear": {**BASE, "string": {**STRING, "stiffness_law": "linear"}, "scheme": {"tail": "static"}},
    "frets": {**BASE, "obstacle": {"frets": FRETS}},
    "layer": {**BASE, "obstacle": {**POINTS, "layer": LAYER}},
    "wall": {
        **BASE,
        "obstacle": {"wall": {"from_m": 0.1, "to_m": 0.9, "height_m": -1e-3, "stiffness_n_m2": 1e7}},
        "scheme": {"restitution": 0.5},
    },
    "wall of nodes": {**BASE, "obstacle": {"wall": {"from_m": 0.01, "to_m": 0.1, "parabola": BRIDGE, "nodes": 3}}},
    "wall of spacing": {**BASE, "obstacle": {"wall": {"from_m": 0.01, "to_m": 0.1, "parabola": BRIDGE, "spacing_m": 0.03}}},
    "compliant": {**BASE, "scheme": {"name": "compliant", **COMPLIANT, "loss": 1.0, "tolerance": 1e-12, "iterations": 50}},
    "auxiliary": {**BASE, "scheme": {"name": "scalar-auxiliary-variable", **COMPLIANT, "drift_correction": 0.5}},
    "energy": {**BASE, "scheme": {"name": "energy-quadratisation", **COMPLIANT, "loss": 1.0}},
    "Moreau-Jean": {**BASE, "scheme": {"name": "moreau-jean-filtered", "restitution": 0.5}},
}

#: a height of the wall and one of the string, each possible: the message names what they are, not which is wrong
BETWEEN_TWO = "the string must start above the wall, got 0.92"


def numbers(table, path=()):
    """Paths of the numbers in nested tables and lists."""
    if isinstance(table, dict):
        for key, value in table.items():
            yield from numbers(value, (*path, key))
    elif isinstance(table, list):
        for place, value in enumerate(table):
            yield from numbers(value, (*path, place))
    elif isinstance(table, int | float) and not isinstance(table, bool):
        yield path


def fields(model, path=()):
    """Names of the fields of a table and those below it that take a number, without places in lists."""
    for name, field in model.model_fields.items():
        yield from of_type(field.annotation, (*path, name))


def of_type(kind, path):
    if typing.get_origin(kind) in (list, typing.Union, types.UnionType, typing.Annotated):
        for part in typing.get_args(kind):
            yield from of_type(part, path)
    elif isinstance(kind, type) and issubclass(kind, BaseModel):
        yield from fields(kind, path)
    elif kind in (int, float):
        yield path


def names(path):
    return tuple(part for part in path if isinstance(part, str))


def test_no_number_of_a_case_is_left_out():
    covered = {names(path) for tables in CASES.values() for path in numbers(tables)}
    assert set(fields(Case)) == covered


@pytest.mark.parametrize("name", list(CASES))
def test_every_number_is_refused_by_its_name_or_runs(name):
    """Without a warning of NumPy's (an error here), and with results that are finite."""
    refused = 0
    assert simulate(CASES[name], warn=None).summary["finite"]
    for path in numbers(CASES[name]):
        for bad in BAD:
            tables = copy.deepcopy(CASES[name])
            table = tables
            for part in path[:-1]:
                table = table[part]
            table[path[-1]] = bad
            try:
                result = simulate(tables)
            except ValueError as error:
                refused += 1
                said = str(error)
                assert names(path)[-1] in said or BETWEEN_TWO in said, (path, bad, said)
                assert "\n" not in said, (path, bad, said)
            else:
                assert result.summary["finite"], (path, bad)
                assert abs(bad) <= 1.0 and math.isfinite(bad), (path, bad)
    assert refused > 50


@pytest.mark.parametrize(
    ("table", "field", "value", "message"),
    [
        (
            "initial",
            "rounding_half_width_m",
            10.0,
            r"initial\.rounding_half_width_m: must be at most 0\.4 m at 0\.4 m of",
        ),
        (
            "initial",
            "rounding_half_width_m",
            0.41,
            "reaches an end, got 0.41 m; take less, or a place further from it",
        ),
        ("initial", "width_m", 10.0, r"initial\.width_m: must be at most 0\.8 m at 0\.4 m"),
        ("initial", "width_m", 0.81, "initial.width_m"),
        ("initial", "position_m", 1.0, r"initial\.position_m: must lie between 0 and the string's 1 m, got 1; count it"),
        ("finger", "width_m", 10.0, r"finger\.width_m: must be at most 0\.8 m at 0\.6 m"),
        ("finger", "position_m", 0.999, r"finger\.width_m: must be at most 0\.002 m at 0\.999 m"),
        ("finger", "position_m", 1.5, r"finger\.position_m: must lie between 0 and the string's 1 m, got 1\.5"),
    ],
)
def test_a_width_ends_on_the_string(table, field, value, message):
    """Smoothed over more than there is, a pluck would be averaged away without a word."""
    tables = {**BASE, "finger": [{**FINGER, field: value}]} if table == "finger" else copy.deepcopy(BASE)
    if table == "initial":
        smooth = {} if field == "width_m" else {"rounding_half_width_m": 0.05}
        tables["initial"] = {"shape": "triangle", "position_m": 0.4, "displacement_m": 2e-3, **smooth, field: value}
    with pytest.raises(CaseError, match=message):
        simulate(tables)


def test_a_width_may_reach_to_the_end():
    for width in ({"width_m": 0.8}, {"rounding_half_width_m": 0.4}):
        initial = {"shape": "triangle", "position_m": 0.4, "displacement_m": 2e-3, **width}
        assert simulate({**BASE, "initial": initial}).summary["largest_displacement_m"] > 1e-3
    assert simulate({**BASE, "finger": [{**FINGER, "position_m": 0.01}]}).summary["finite"]


def test_numbers_in_a_file_have_the_bounds_of_those_in_the_case(tmp_path):
    np.savez(tmp_path / "start.npz", q=[1e-3, 1e300], v=[0.0, 1e300], f=[80.0, 1e300], sig=[1.0, 1e-300])
    file = str(tmp_path / "start.npz")
    with pytest.raises(CaseError, match=r"initial\.q: must lie within ±10000, got 1e\+300"):
        simulate({**BASE, "initial": {"shape": "modes", "file": file, "q": "q"}})
    with pytest.raises(CaseError, match=r"initial\.v: must lie within ±1e\+12, got 1e\+300"):
        simulate({**BASE, "initial": {"shape": "modes", "file": file, "q": [1e-3], "v": "v"}})
    with pytest.raises(CaseError, match=r"string: measured_frequencies_hz of mode 2 must be a number from 1e-06 to 1e\+12"):
        simulate({**BASE, "string": {**STRING, "measured": {"file": file}}})
