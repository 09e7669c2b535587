"""What a scheme is given and what it gives back, whatever it does in between."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, NamedTuple

import numpy as np

from synth.native.arrays import f8, i8


class Problem(NamedTuple):
    """One string and its obstacle as arrays: N modes, C contacts, P outputs. SI units."""

    dt: float  # internal step [s]
    steps: int
    every: int  # steps per output row: rows 0, every, 2·every … are kept
    mu: float  # [kg/m]
    omega: np.ndarray  # (N,) [rad/s]
    sigma: np.ndarray  # (N,) [1/s]
    shapes: np.ndarray  # (C, N) φ_j(x_c) [1/√m]
    eta: np.ndarray  # (C,) [m]
    out_shapes: np.ndarray  # (P, N)
    q: np.ndarray  # (N,) at t = 0 [m·√m]
    v: np.ndarray  # (N,) q̇ at t = 0


class Results(NamedTuple):
    """What a run gives of P outputs and C contacts in n rows, and sums and counts in places of the scheme's own."""

    u: Annotated[np.ndarray, f8("rows, points")]  # (n, P) [m]
    contact_u: Annotated[np.ndarray, f8("contact_rows, contacts")]  # (n, C) [m], or (0, C)
    contact_force: Annotated[np.ndarray, f8("contact_rows, contacts")]  # (n, C) mean since the row before [N], or (0, C)
    energy: Annotated[np.ndarray, f8("weighed, 5")]  # (n, 5) [J], or (0, 5)
    sums: Annotated[np.ndarray, f8("sums")]
    counts: Annotated[np.ndarray, i8("counts")]


def kept_array(kept: Mapping[str, np.ndarray], name: str, shape: tuple[int, ...]) -> np.ndarray:
    """An array of an Outcome's state; ValueError where it is missing or another problem's."""
    if name not in kept:
        raise ValueError(f"state.{name} is missing")
    if kept[name].shape != shape:
        raise ValueError(f"state.{name} must have the shape {shape}, got {kept[name].shape}")
    return kept[name]


@dataclass
class Outcome:
    """What a run gave; n = steps // every + 1 rows, row 0 is t = 0. What costs much may be given as what makes it."""

    u: np.ndarray  # (n, P) [m]
    contact_u: np.ndarray | Callable[[], np.ndarray]  # (n, C) [m]
    contact_force: np.ndarray | Callable[[], np.ndarray]  # (n, C) mean since the row before [N]
    #: (n, 5) [J] stored, residual, viscous, contact, injected; None: no ledger was kept
    energy: np.ndarray | None = None
    #: max over steps (or rows) of η − u [m]; negative: never touched; 0 without contacts
    largest_penetration_m: float = 0.0
    #: of one step, over the energy at the start and injected since; NaN: not weighed. Exact-hold: rounding, of the energy
    #: or of G λ² (`schemes.clamping_warning`), whichever is greater
    largest_energy_rise: float = float("nan")
    last_contact_step: int = -1  # end of the last step with a contact force; −1: none
    contact_steps: int = 0
    unsolved_steps: int = 0
    seconds: float = 0.0  # of the computation alone, kernels compiled
    #: where it ended, at the last row, and all that the scheme needs to go on from there; None: it cannot go on
    state: dict[str, np.ndarray] | None = None
    notes: dict[str, Any] = field(default_factory=dict)  # more for the summary, by the scheme's own names
