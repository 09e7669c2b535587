"""The two studies of coupled strings that touch: what `tools/coupled-study` prints at length and tests do in small."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

import synth
from synth.physics.coupled import Place
from synth.research.coupled.coupled_case import read_coupled
from synth.research.coupled.coupled_result import CoupledResult
from synth.research.coupled.coupled_scene import CoupledScene
from synth.solver.coupled_study import N_LOST, N_STORED
from tests.oracles import three_strings
from tests.oracles.mode_steps import contact_run

REFERENCE_HZ, ROWS_HZ = 1_536_000, 24_000
#: what rounding may make of a step's energy, of the energy there was to have
PASSIVE, BALANCED = 1e-12, 1e-10


#: where the first two strings touch: points 6 and 5 mm before the bridge, on which they ride; or the second over a fret
ON_THE_BRIDGE = (Place(0, 0.644, True), Place(1, 0.645, True))
ON_A_FRET = (Place(0, 0.644, True), Place(1, 0.15))
_HEIGHTS = {True: 0.0, False: -4e-4}


def touching_case(
    places: tuple[Place, ...], rate_hz: float, substeps: int, seconds: float, modes: int = 80, heavy: float = 1.0
) -> dict[str, Any]:
    """Three strings, plucked all, over points; the body's masses are `heavy` times those of a guitar."""
    strings = []
    for number, (hz, diameter, place) in enumerate(three_strings.STRINGS):
        string = three_strings.steel(hz, diameter)
        start = {"shape": "triangle", "position_m": 0.25 + 0.1 * number, "displacement_m": 1.5e-3, "width_m": 0.012}
        strings.append(
            {
                "length_m": string.length_m, "tension_n": string.tension_n, "diameter_m": diameter,
                "linear_density_kg_m": string.linear_density_kg_m, "viscoelastic_loss": 4.5e-3,
                "bending_stiffness_n_m2": string.bending_stiffness_n_m2, "thermoelastic_q_inverse": 2.03e-4,
                "place_mm": 1e3 * place, "outputs_m": [0.1], "initial": start,
            }
        )  # fmt: skip
    for at in places:
        strings[at.line]["obstacle"] = {
            "positions_m": [at.position_m], "heights_m": [_HEIGHTS[at.rides]], "rides": at.rides,
        }  # fmt: skip
    modes_of_body = [
        {"frequency_hz": mode.frequency_hz, "q": mode.q, "mass_kg": heavy * mode.mass_kg, "shape": list(mode.shape)}
        for mode in three_strings.body(3).modes
    ]
    run = {"internal_rate_hz": rate_hz, "output_rate_hz": ROWS_HZ, "modes": modes, "duration_s": seconds}
    return {"string": strings, "body": {"mode": modes_of_body}, "scheme": {"substeps": substeps}, "run": run}


def accuracy(
    places: tuple[Place, ...], seconds: float, rates: tuple[float, ...], substeps: tuple[int, ...], heavy: float = 1.0
) -> Iterator[tuple[float, int, list[float]]]:
    """(rate, substeps, e of the three strings and of the bridge), e = √(Σ (u_ref − u)²/Σ u_ref²) over all rows."""
    scene = CoupledScene(*read_coupled(touching_case(places, ROWS_HZ, 1, seconds, heavy=heavy)))
    residual = np.diag([float(scene.arrays(place.line).residual[0, 0]) for place in places])
    rows = np.vstack([scene.system.displacement_rows([Place(k, 0.1) for k in range(3)]), scene.system.bridge_rows()[:1]])
    heights = np.array([_HEIGHTS[place.rides] for place in places])
    reference, _ = contact_run(
        scene.system, scene.initial(), places, heights, residual, rows, REFERENCE_HZ, REFERENCE_HZ // ROWS_HZ, scene.rows
    )
    for rate in rates:
        for count in substeps:
            result = synth.simulate(touching_case(places, rate, count, seconds, heavy=heavy))
            assert isinstance(result, CoupledResult)
            found = np.hstack([result.u, result.bridge[:, :1]])
            error = np.sqrt(((found - reference) ** 2).sum(axis=0) / (reference**2).sum(axis=0))
            yield rate, count, [float(e) for e in error]


@dataclass(frozen=True)
class Judged:
    """Of the energy there was to have: largest rise of a step, what the ledger is off by, the most negative loss."""

    rise: float
    balance: float
    least_loss: float
    faults: tuple[str, ...]


def judged(result: CoupledResult) -> Judged:
    """A run with a ledger: whether a step gained energy, the ledger does not close, a loss is negative, or a contact is
    deeper than 1e-12 m. Steps that hold their forces keep string and obstacle apart at their end alone: not judged."""
    assert result.energy is not None
    summary, energy = result.summary, result.energy
    worked = np.abs(energy[:, N_STORED + N_LOST :]).sum(axis=1).max()
    scale = summary["initial_energy_j"] + worked
    loss = float(np.diff(energy[:, N_STORED : N_STORED + N_LOST], axis=0).min() / scale) if scale > 0.0 else 0.0
    balance = abs(summary["ledger_balance"])
    faults = []
    if not result.largest_energy_rise <= PASSIVE:
        faults.append(f"a step gained {result.largest_energy_rise:.1e} of the energy")
    if not balance <= BALANCED:
        faults.append(f"the ledger is off by {balance:.1e} of the energy")
    if not loss >= -PASSIVE:
        faults.append(f"a loss of {loss:.1e} of the energy is negative")
    if not summary["held_frames"] and not result.largest_penetration_m <= 1e-12:
        faults.append(f"a contact was {result.largest_penetration_m:.1e} m deep")
    if summary["unsolved_steps"] or not summary["finite"]:
        faults.append("steps were not solved")
    return Judged(result.largest_energy_rise, balance, loss, tuple(faults))
