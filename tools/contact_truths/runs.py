"""The sets of tools/contact-table: their notes, one fit of each, and what is said of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from contact_truths import fretted
from contact_truths.foreign import two_points
from contact_truths.misleading import CASES
from contact_truths.notes import RATE_HZ, Truth, drawn, length_m, sound
from synth.fit.contact_dictionary import Search, contact_search
from synth.fit.contact_fit import NoContact, fit_note
from synth.fit.contact_group import amplitude_of, tuned_model
from synth.fit.contact_model import ContactModel
from synth.fit.recording import FitRefused
from synth.instrument.preset import load_preset

#: of units that are said: µm per mm, mm, share
UNITS = {"height": 1e3, "distance": 1e3, "position": 1.0}
#: within which an answer is right, and under a model that errs
AIM = {"height": 0.3, "distance": 0.3, "position": 0.01}
AIM_NUISANCE = {"height": 0.8, "distance": 0.4, "position": 0.02}


#: recordings that are no plain note of a preset, by their case; that of the set `foreign` is not one of the misleading
TWO_POINTS = "two points"
_MADE = {**CASES, TWO_POINTS: two_points}


class Job(NamedTuple):
    """One row: its key, set, and arguments."""

    key: str
    of: str
    truth: Truth | None = None
    case: str = ""
    seed: int = 0


def _main() -> list[Job]:
    return [
        Job(f"main {family} {seed}", "main", drawn(seed, family))
        for family, first in (("tanpura-light", 8000), ("sitar", 8100))
        for seed in range(first, first + 20)
    ]


def _calibration() -> list[Job]:
    return [Job(f"calibration {seed}", "calibration", drawn(seed, "tanpura-light")) for seed in range(3100, 3112)] + [
        Job(f"calibration sitar {seed}", "calibration", drawn(seed, "sitar")) for seed in range(3100, 3104)
    ]


def _nuisance() -> list[Job]:
    kinds: list[tuple[str, dict[str, Any]]] = [
        ("body", {"body": True}),
        ("output place", {"heard": 0.03}),
        ("losses × 1.3", {"losses": 1.3}),
        ("losses × 0.7", {"losses": 0.7}),
    ]
    return [
        Job(f"nuisance {name} {seed}", "nuisance", drawn(seed, "tanpura-light", **fixed), name)
        for name, fixed in kinds
        for seed in range(6000, 6002)
    ]


def _misleading() -> list[Job]:
    return [Job(f"misleading {name}", "misleading", None, name, 7000 + i) for i, name in enumerate(CASES)]


def _foreign() -> list[Job]:
    return [Job(f"foreign {seed}", "foreign", None, TWO_POINTS, seed) for seed in range(5500, 5514)]


def _frets() -> list[Job]:
    """Those that mislead first: they are the fewest."""
    cases = ["no contact", "hard", "amplitude + 10 %", "losses × 1.3", "losses × 0.7"]
    jobs = [Job(f"frets {case} {9300 + i}", "frets", None, case, 9300 + i) for i, case in enumerate(cases)]
    moderate = [Job(f"frets moderate {seed}", "frets", None, "moderate", seed) for seed in range(9200, 9212)]
    return [*moderate[:4], *jobs, *moderate[4:]]


SETS: dict[str, Callable[[], list[Job]]] = {
    "calibration": _calibration,
    "main": _main,
    "nuisance": _nuisance,
    "misleading": _misleading,
    "foreign": _foreign,
    "frets": _frets,
}


@cache
def _search(preset: str, string: int) -> Search:
    loaded = load_preset(preset)
    return contact_search(ContactModel.of_preset(loaded, string), amplitude_of(loaded, string))


def run(job: Job) -> dict[str, Any]:
    """The row of a job. A search's dictionary is shared by the notes of a string and counts where it is made."""
    if job.of == "frets":
        return fretted.run(job.seed, job.case)
    row: dict[str, Any] = {"key": job.key, "set": job.of, "case": job.case}
    if job.truth is not None:
        recording, preset, string, truth = sound(job.truth), job.truth.preset, job.truth.string, job.truth
    else:
        recording, preset, string, truth = _MADE[job.case](job.seed)
    began, wall = time.process_time(), time.perf_counter()
    try:
        # as `fit_contact`, with the dictionary kept from note to note
        tuned_model(load_preset(preset), string, [(recording, RATE_HZ)])
        found = fit_note(_search(preset, string), recording, RATE_HZ)
        row |= {"loss": found.loss, "free_loss": found.free_loss, "evaluations": found.evaluations}
        row["warnings"] = list(found.warnings)
        length = length_m(preset, string)
        scale = {name: UNITS[name] * (length if name == "distance" else 1.0) for name in UNITS}
        row["values"] = {name: scale[name] * each.value for name, each in found.values.items()}
        row["halves"] = {name: scale[name] * each.half for name, each in found.values.items()}
        row["draw_ms"], row["losses"] = 1e3 * found.stroke.draw_s, found.stroke.losses
        if truth is not None:
            row["errors"] = {n: row["values"][n] - scale[n] * value for n, value in truth.values.items()}
    except FitRefused as refused:
        row["refused"] = str(refused)
        if isinstance(refused, NoContact):
            row["bound"] = refused.bound
    return row | {"cpu_s": time.process_time() - began, "wall_s": time.perf_counter() - wall}


def line(row: dict[str, Any]) -> str:
    """A row in words."""
    if row["set"] == "frets":
        return fretted.line(row)
    said = row["key"]
    if "refused" in row:
        return f"{said}: refused: {row['refused'][:110]} ({row['cpu_s']:.0f} s)"
    what = "errors" if "errors" in row else "values"
    numbers = ", ".join(f"{name} {value:+.4f} ± {row['halves'][name]:.4f}" for name, value in row[what].items())
    return f"{said}: {'' if what == 'errors' else 'ANSWERED '}{numbers}; loss {row['loss']:.3f} ({row['cpu_s']:.0f} s)"


def _right(row: dict[str, Any], aim: dict[str, float]) -> bool:
    return "errors" in row and all(abs(row["errors"][name]) <= aim[name] for name in aim)


def show(rows: list[dict[str, Any]]) -> None:
    """All sets that there are."""
    for name in SETS:
        mine = [row for row in rows if row["set"] == name]
        if not mine:
            continue
        print(f"\n{name}: {len(mine)} notes")
        if name == "frets":
            fretted.show(mine)
        elif name in ("main", "calibration"):
            for family in ("tanpura-light", "sitar"):
                some = [row for row in mine if (family == "sitar") == ("sitar" in row["key"])]
                if some:
                    _summary(family, some, AIM)
        elif name == "foreign":
            _foreign_summary(mine)
        elif name == "nuisance":
            for case in dict.fromkeys(row["case"] for row in mine):
                _summary(case, [row for row in mine if row["case"] == case], AIM_NUISANCE)
        else:
            for row in mine:
                good = "refused" in row or _right(row, AIM_NUISANCE)
                print(f"  {'right   ' if good else 'NONSENSE'} {line(row)}")
            nonsense = sum(not ("refused" in row or _right(row, AIM_NUISANCE)) for row in mine)
            print(f"  nonsense: {nonsense} of {len(mine)}")


def _foreign_summary(rows: list[dict[str, Any]]) -> None:
    """How many are refused, within their intervals, and beside them with a warning and without."""
    said = {"refused": 0, "within": 0, "beside, warned": 0, "beside, NOT WARNED": 0}
    for row in rows:
        if "refused" in row:
            what = "refused"
        elif all(abs(row["errors"][name]) <= row["halves"][name] for name in AIM):
            what = "within"
        else:
            what = "beside, warned" if row["warnings"] else "beside, NOT WARNED"
        said[what] += 1
        print(f"  {what:19} {line(row)}")
    print("  " + ", ".join(f"{what}: {count}" for what, count in said.items()))


def _summary(title: str, rows: list[dict[str, Any]], aim: dict[str, float]) -> None:
    answered = [row for row in rows if "errors" in row]
    right = sum(_right(row, aim) for row in rows)
    seconds = np.array([row["cpu_s"] for row in rows])
    print(f"  {title}: {len(rows)} notes, {len(rows) - len(answered)} refused, {right} within {aim}; ", end="")
    print(f"{np.median(seconds):.0f} s of one core (median), {seconds.max():.0f} s (most)")
    for name in aim:
        if not answered:
            break
        errors = np.abs([row["errors"][name] for row in answered])
        covered = sum(abs(row["errors"][name]) <= row["halves"][name] for row in answered)
        halves = np.median([row["halves"][name] for row in answered])
        ratio = np.quantile([abs(row["errors"][name]) / row["halves"][name] for row in answered], 0.95)
        print(
            f"    {name:9} error median {np.median(errors):.4f}, worst {errors.max():.4f}; interval covers {covered} of "
            f"{len(answered)}, half of it {halves:.4f} (median), 95 % of errors within {ratio:.2f} of it"
        )
