"""This program's schemes on every scene, at several rates: scores, what one core takes, or why a scheme does not apply."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.collisions import ContestError
from benchmarks.collisions.examples import kicks
from benchmarks.collisions.neutral import numbers
from benchmarks.collisions.recipes import Kicks
from benchmarks.collisions.runfile import brought
from benchmarks.collisions.scene import Reference, SceneFacts, outside_names
from benchmarks.collisions.score import score
from benchmarks.collisions.ways import Way, case_of, way
from synth.research.case import CaseError

#: a number beyond which a displacement is no string's [m]
_BLOWN_UP_M = 1e3
_FACTORS = (1, 2, 4, 8, 16)
_ALL_MODES_AT = 48
_KICKS_AT = (1, 4)
#: points of a wall, where a scheme knows points only
_MOST_POINTS = 255
_POWER_LAWS = ("compliant", "energy-quadratisation", "scalar-auxiliary-variable")
NO_R = {"residual_compliance": False}


def _modes_below_half(found: dict[str, Any], factor: int) -> int:
    f = np.array(found["frequencies_hz"])
    return max(1, int(np.count_nonzero(f < 0.5 * factor * found["rate_hz"])))


def ways_of(found: dict[str, Any]) -> list[Way | Kicks | tuple[str, str]]:
    """Every run of a scene (its numbers), cheapest first of each scheme; (scheme, reason) where one does not apply."""
    total = len(found["frequencies_hz"])
    wall, finite = "wall" in found, found["modes_are_the_string"]
    elastic = wall and found["wall"]["stiffness_n_m2"] is not None
    chosen: list[Way | Kicks | tuple[str, str]] = []

    def add(scheme: str, factors: tuple[int, ...] = _FACTORS, whole: tuple[int, ...] = (), **table: Any) -> None:
        for factor, every in [(factor, finite) for factor in factors] + [(factor, True) for factor in whole]:
            modes = total if every else _modes_below_half(found, factor)
            if wall and scheme != "wall":
                modes = min(modes, _MOST_POINTS)
            one = Way(scheme, factor, modes, tuple(sorted(table.items())))
            if one not in chosen:
                chosen.append(one)

    few: tuple[int, ...] = (1, 4, 16)
    whole: tuple[int, ...] = () if wall else (_ALL_MODES_AT,)
    # where others' runs have all modes at low rates, the same work here
    impacts = (1, 2, 4, _ALL_MODES_AT) if found["name"] in outside_names() else whole
    if elastic:
        reason = "holds the string on rigid points; the board is elastic"
        chosen += [(name, reason) for name in ("exact-hold", "Moreau–Jean, printed", "Moreau–Jean, filtered")]
    elif finite:
        reason = "represents modes left out of the computation; here there are none"
        chosen += [("exact-hold + lumped tail", reason), ("exact-hold + R", reason)]
    else:
        add("exact-hold", few if wall else _FACTORS)
        add("exact-hold", few, tail="static")
        if not wall:
            add("exact-hold", (1, 4), substeps=2)
    if not elastic:
        add("exact-hold", few, whole, residual_compliance=False)
        for scheme in ("moreau-jean", "moreau-jean-filtered"):
            for restitution in (0.0, 1.0):
                add(scheme, few, impacts, restitution=restitution)
    for scheme in _POWER_LAWS:
        add(scheme, few, whole)
    add("event-driven", (1,), **(NO_R if finite else {}))
    if wall:
        pairs = ((2, 127), (4, 255), (8, 511), (16, 511), (32, 1023)) if elastic else ((1, 255), (2, 511), (4, 1023))
        chosen += [way("wall", factor, modes, restitution=1.0) for factor, modes in pairs]
    else:
        chosen.append(("wall", "computes strings over a wall, not over points"))
    ideal = found["bending_stiffness_n_m2"] == 0.0 and not wall
    chosen += [way("waveguide", 4, 10)] if ideal else [("waveguide", "computes only ideal strings over points")]
    for closed in ("cabannes", "flat-wall"):
        chosen.append((closed, "is the reference" if found["name"] == closed else "is the closed form of another scene"))
    chosen += [Kicks(factor, 255 if wall else _modes_below_half(found, factor)) for factor in _KICKS_AT]
    return chosen


def _label(one: Way | Kicks) -> str:
    return "penalty springs, NumPy (examples/kicks.py)" if isinstance(one, Kicks) else one.label


def _once(found: dict[str, Any], one: Way | Kicks) -> tuple[dict[str, np.ndarray], float]:
    """The arrays of a run, and its CPU seconds, those of setting up and compiling left out. Raises CaseError."""
    if isinstance(one, Kicks):
        u, cost = kicks.solve(found, one.factor, one.modes)
        return {"u": u}, cost
    import synth

    started = time.process_time()
    result = synth.simulate(case_of(found["name"], one))
    spent = time.process_time() - started - result.summary["compile_s"]
    arrays = {"u": result.u[:, 0]}
    if "wall" not in found:
        arrays |= {"u_contact": result.u_contact, "contact_force": result.contact_force}
    # the lesser of both clocks: other programs do not count, nor does setting up
    return arrays, min(result.summary["compute_s"], spent) if spent > 0.0 else result.summary["compute_s"]


def entered(
    name: str, facts: SceneFacts, reference: Reference, rounds: int, budget_s: float, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Records of every run of a scene, best cost of the rounds, all in turn; of what does not apply with its reason."""
    found = numbers(name)
    records: list[dict[str, Any]] = []
    kept: list[tuple[Way | Kicks, dict[str, Any]]] = []
    refused: dict[str, str] = {}
    last: dict[str, tuple[float, int]] = {}
    for one in ways_of(found):
        if isinstance(one, tuple) and not isinstance(one, Kicks):
            refused[one[0]] = one[1]
            continue
        label = _label(one)
        steps = one.factor * one.modes
        if label in refused:
            continue
        if label in last and last[label][0] * steps / last[label][1] > budget_s:
            say(f"{name}: {label}, {one.factor} steps a sample: left out, over the budget of {budget_s:g} s")
            continue
        about = {
            "solver": "NumPy" if isinstance(one, Kicks) else "jawari",
            "scheme": label,
            "internal_rate_hz": found["rate_hz"] * one.factor,
            "modes": one.modes,
        }
        try:
            arrays, cost = _once(found, one)
        except CaseError as error:
            refused[label] = str(error).splitlines()[0]
            continue
        last[label] = (cost, steps)
        say(f"{name}: {label}, {one.factor} steps a sample, {one.modes} modes: {cost:.3g} s")
        u = arrays["u"]
        if not np.all(np.isfinite(u)) or np.abs(u).max() > _BLOWN_UP_M:
            records.append({"scene": name, **about, "cost_s": cost, "blown_up": True})
            continue
        data = {**arrays, **about, "scene": name, "rate_hz": found["rate_hz"], "cost_s": cost}
        data = {key: np.asarray(value) for key, value in data.items()}
        try:
            record = score(brought(Path(label), data, facts, reference), facts, reference).record
        except ContestError:  # contact rows that overflowed
            data = {key: value for key, value in data.items() if key not in ("u_contact", "contact_force")}
            record = score(brought(Path(label), data, facts, reference), facts, reference).record
        records.append(record)
        kept.append((one, record))
    for _ in range(rounds):
        for one, record in kept:
            record["cost_s"] = min(record["cost_s"], _once(found, one)[1])
    return records + [{"scene": name, "scheme": scheme, "does_not_apply": why} for scheme, why in refused.items()]
