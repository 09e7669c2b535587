"""`simulate` of a case of strings on a body: tables to result."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

import synth
from synth.instrument.preset import counted
from synth.research.case import CaseError, validated
from synth.research.coupled.complex_modes import run_complex_modes
from synth.research.coupled.coupled_case import CoupledCase
from synth.research.coupled.coupled_result import CoupledResult
from synth.research.coupled.coupled_run import CoupledOutcome, run_exact_hold
from synth.research.coupled.coupled_scene import CoupledScene
from synth.solver import coupled_study as study
from synth.solver.schemes import PASSIVE_TO

_RUNNERS = {"exact-hold": run_exact_hold, "complex-modes": run_complex_modes}


def simulate_coupled(tables: Mapping[str, Any], folder: Path, origin: str, warn: Callable[[str], None]) -> CoupledResult:
    """Runs the tables of a case, see `coupled_case`; files count from `folder`, messages call it `origin`. warn: is told of
    steps that were not solved, of energy that was gained, and of results that are not finite. Raises CaseError."""
    case = validated(CoupledCase, tables, origin)
    scene = CoupledScene(case, folder)
    result = _result(scene, _RUNNERS[case.scheme.name](scene))
    summary = result.summary
    if summary["unsolved_steps"]:
        warn(f"{summary['unsolved_steps']} of {summary['steps']} steps were not solved; raise the internal rate")
    if result.largest_energy_rise > PASSIVE_TO:
        warn(
            f"a step held {result.largest_energy_rise:.1e} of the energy too much: forces of "
            f'{result.contact_force.max(initial=0.0):.3g} N are rounded; take tail = "static", or more modes'
        )
    if not summary["finite"]:
        warn("the results are not finite; check the units of the case, or raise the internal rate")
    return result


def _result(scene: CoupledScene, outcome: CoupledOutcome) -> CoupledResult:
    case, run, rows, sums, counts = scene.case, scene.case.run, outcome.rows, outcome.rows.sums, outcome.rows.counts
    ledger = bool(run.ledger)
    h = scene.frame_s
    last = float(counts[study.LAST_CONTACT] * h) if counts[study.LAST_CONTACT] >= 0 else math.nan
    arrays = (rows.u, rows.contact_force, rows.bridge, rows.radiated)
    summary: dict[str, Any] = {
        "scheme": case.scheme.name,
        "internal_rate_hz": run.internal_rate_hz,
        "strings": len(case.string),
        "lines": len(scene.lines),
        "body_modes": counted(case.body.mode),
        "contacts": int(rows.u_contact.shape[1]),
        "steps": int(counts[study.STEPS]),
        "rows": scene.rows,
        "finite": all(bool(np.all(np.isfinite(array))) for array in arrays),
        "largest_displacement_m": float(np.abs(rows.u).max(initial=0.0)),
        "largest_bridge_motion_m": float(np.abs(rows.bridge[:, :1]).max(initial=0.0)),
        "largest_penetration_m": float(sums[study.PENETRATION]),
        "last_contact_s": last,
        "contact_steps": int(counts[study.CONTACT_FRAMES]),
        "unsolved_steps": int(counts[study.UNSOLVED]),
        **outcome.notes,
        "compute_s": outcome.seconds,
    }
    if ledger:
        final = rows.energy[-1]
        summary |= {
            "initial_energy_j": float(sums[study.INITIAL]),
            "body_energy_j": float(final[study.BODY]),
            "body_loss_j": float(final[study.LOST_BODY]),
            "largest_energy_rise": float(sums[study.RISE]),
            "ledger_balance": float(sums[study.BALANCE]),
        }
    summary = {
        key: None if isinstance(value, float) and not math.isfinite(value) else value for key, value in summary.items()
    }
    metadata = {
        "version": synth.__version__,
        "scheme": case.scheme.name,
        "tail": case.scheme.tail,
        "internal_rate_hz": run.internal_rate_hz,
        "output_rate_hz": run.internal_rate_hz / run.steps_per_output,
        "modes": run.modes,
        "duration_s": scene.frames * h,
        "case": json.loads(json.dumps(case.model_dump())),
        "summary": summary,
    }
    points = [(number, x) for number, table in enumerate(scene.tables) for x in table.outputs_m]
    contacts = [
        (number, x, height)
        for number, obstacle in enumerate(scene.obstacles)
        for x, height in zip(obstacle.positions_m, obstacle.heights_m, strict=True)
    ]
    return CoupledResult(
        t=np.arange(scene.rows) * run.steps_per_output / run.internal_rate_hz,
        u=rows.u,
        u_contact=rows.u_contact,
        contact_force=rows.contact_force,
        bridge=rows.bridge,
        bridge_force=rows.bridge_force,
        radiated=rows.radiated,
        energy=rows.energy if ledger else None,
        output_string=np.array([number for number, _ in points], np.int64),
        positions=np.array([x for _, x in points], np.float64),
        contact_string=np.array([number for number, _, _ in contacts], np.int64),
        contact_positions=np.array([x for _, x, _ in contacts], np.float64),
        contact_heights=np.array([height for _, _, height in contacts], np.float64),
        largest_penetration_m=float(sums[study.PENETRATION]),
        largest_energy_rise=float(sums[study.RISE]) if ledger else math.nan,
        last_contact_s=last,
        final=outcome.final,
        metadata=metadata,
    )


def refuse_of_one_string(resume_from: Any, quality: Any) -> None:
    """CaseError for what `simulate` knows of cases of one string alone."""
    if resume_from is not None:
        raise CaseError("resume_from: a run of strings on a body cannot be resumed; simulate the whole time at once")
    if quality is not None:
        raise CaseError("quality: what is promised is of one string on rigid ends; give internal_rate_hz and modes")
