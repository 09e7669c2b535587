"""Strings of the paper's two cases, and reference data that may lie beside the checkout."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from synth.physics.string import String

REFERENCE = Path(__file__).parents[3] / "shared" / "reference"


@pytest.fixture
def guitar() -> String:
    """The paper's two-point-bridge case: a guitar string of 1.002 m [IA2018 table II]."""
    return String.from_inharmonicity(
        1.002, 180.5, 1.17e-3, 1.78e-5, 0.43e-3, viscoelastic_loss=4.5e-3, thermoelastic_q_inverse=2.03e-4
    )


@pytest.fixture
def bass() -> String:
    """The paper's bass G string [IA2018 tables IV, V], wound, linear law; μ as in the authors' data."""
    return String.from_inharmonicity(
        0.863,
        191.6,
        6.7e-3,
        3.5e-5,
        1.14e-3,
        core_diameter_m=0.43e-3,
        winding_diameter_m=0.355e-3,
        viscoelastic_loss=0.01,
        thermoelastic_q_inverse=6e-6,
        stiffness_law="linear",
    )


@pytest.fixture
def reference() -> Callable[[str], dict[str, np.ndarray]]:
    """Loads a file of the authors' data; skips the test where there is none."""

    def load(name: str) -> dict[str, np.ndarray]:
        path = REFERENCE / name
        if not path.exists():
            pytest.skip(f"no reference data {name}")
        with np.load(path) as data:
            return dict(data)

    return load
