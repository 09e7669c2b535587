"""What tools/speed-error keeps and says, without its runs."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from documentation import page
from speed_error import grid, kernels, measure, session, tables

from synth.research import methods
from synth.solver.lanes import LANES


def test_a_session_is_kept_and_gone_on_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two runs against a low reference: their errors are those of the runs themselves; again, nothing is computed."""
    finest = grid.Run("bass", "exact-hold", 4, 60, grid.WITHOUT_R)
    wanted = [grid.Run("bass", "exact-hold", 1, 60), grid.Run("bass", "moreau-jean", 2, 60, grid.E0)]
    monkeypatch.setattr(session, "runs", lambda case, short: wanted)
    monkeypatch.setattr(session, "reference", lambda case, short: [("", finest), ("half its rate", grid.half_rate(finest))])
    monkeypatch.setattr(session, "LONGEST_S", {"bass": 0.1})
    monkeypatch.setattr(measure, "LONGEST_S", {"bass": 0.1})
    monkeypatch.setattr(session, "_TIMED_CPU_S", 0.01)

    def taken() -> session.Session:
        found = session.Session(tmp_path / "out", ["bass"], ["exact-hold", "moreau-jean"], True, 6.0, 2, 0)
        found.run()
        return found

    first = taken()
    assert [each["run"] for each in first.rows] == wanted and not first.skipped
    exact = measure.displacement(finest, 0.1)[1]
    for run, each in zip(wanted, first.rows, strict=True):
        values, signals = measure.displacement(run, 0.1)
        expected = values | measure.errors(signals, exact) | {"energy_rise": measure.ledger(run, 0.02)["energy_rise"]}
        expected["penetration_m"] = each["penetration_m"]  # of the ledger's run, too
        assert {key: each[key] for key in expected} == expected
        assert all(np.array_equal(first.signals[run][kind], signals[kind]) for kind in ("raw", "band"))
        assert each["cpu_per_s"] <= each["cpu_per_s_median"]
    monkeypatch.setattr("speed_error.jobs.displacement", None)
    monkeypatch.setattr("speed_error.jobs.cpu_s", None)
    for one, other in zip(first.rows, taken().rows, strict=True):
        assert {**one, "times_real_time_decimated": 0} == {**other, "times_real_time_decimated": 0}


def row(scheme: str, factor: int, modes: int, e: float, cpu: float, **table: object) -> dict:
    run = grid.Run("tanpura", scheme, factor, modes, tuple(sorted(table.items())))
    return {"run": run, "e_3s": e, "cpu_per_s": cpu, "cpu_per_s_median": cpu, "mode_steps_per_s": run.rate_hz * modes}


def test_ratios_are_taken_between_the_cheapest_that_reach_an_error() -> None:
    ours = [row("exact-hold", 1, 100, 0.07, 0.002), row("exact-hold", 4, 300, 0.008, 0.02)]
    rivals = [
        row("moreau-jean", 48, 1001, 0.06, 1.8, restitution=0.0),
        row("moreau-jean-filtered", 96, 1001, 0.02, 4.0, restitution=0.0),
        row("moreau-jean-filtered", 192, 1001, 0.009, 8.0, restitution=0.0),
        row("moreau-jean-filtered", 96, 1001, 0.001, 4.0, restitution=1.0),
    ]
    known = SimpleNamespace(rows=ours + rivals, default_rows=lambda case: ours)
    first, second = tables.ratios(known)
    assert "480 times fewer mode-steps, 900 times less CPU time" in first and first.endswith("kept")
    assert "160 times fewer mode-steps, 400 times less CPU time" in second and "8.47 MHz" in second
    known.rows = [*ours, {**rivals[0], "cpu_per_s": 0.4}]
    first, second = tables.ratios(known)
    assert first.endswith("MISSED") and "not reached" in second


@pytest.mark.parametrize("factor", [1, 2, 24, 48, 192, 384])
def test_signals_are_kept_at_a_divisor_of_the_rate(factor: int) -> None:
    kept = measure.kept_factor(factor)
    assert factor % kept == 0 and kept <= measure.MOST_KEPT and (kept == factor or kept > measure.MOST_KEPT // 2)


def test_every_run_of_the_short_form_is_a_scene() -> None:
    for case in grid.CASES:
        for run in grid.runs(case, short=True) + [run for _, run in grid.reference(case, short=True)]:
            scene = run.scene(0.001, measure.kept_factor(run.factor))
            assert scene.case.run.modes == run.modes and scene.case.scheme.name == run.scheme


@pytest.mark.parametrize(
    ("case", "scheme", "factor", "table", "nodes"),
    [
        ("tanpura", "exact-hold", 1, {}, 0),
        ("tanpura", "exact-hold", 1, {"substeps": 3}, 0),
        ("tanpura", "moreau-jean-filtered", 2, {"restitution": 0.0}, 0),
        ("bass", "exact-hold", 2, {}, 0),
        ("bass", "exact-hold", 1, {"substeps": 8}, 0),
        ("bass", "moreau-jean", 2, {"restitution": 0.0}, 0),
        ("fretless-inelastic", "exact-hold", 1, {"tail": "static"}, 300),
    ],
)
def test_what_is_timed_is_the_run(case: str, scheme: str, factor: int, table: dict, nodes: int) -> None:
    """The kernels against the program's own runs, over the first steps with contacts."""
    run = grid.Run(case, scheme, factor, 60, tuple(sorted(table.items())), nodes)
    calls = 1 if nodes else 3
    scene = run.scene((calls * kernels.STEPS + 8) / run.rate_hz, factor)
    expected = methods.run(scene)
    assert expected.contact_steps > 20
    kernel = kernels.kernel_of(scene)
    u = np.concatenate([kernel().copy() for _ in range(calls)])
    begin = 1 if scheme == "exact-hold" else 2  # Moreau–Jean takes the first step to have a velocity
    there = expected.u[begin : begin + u.size, 0]
    np.testing.assert_allclose(u, there, rtol=0.0, atol=1e-9 * np.abs(there).max())


def test_a_page_takes_what_a_run_says(tmp_path: Path) -> None:
    """Every part has its place on the page of the documentation; what stands around it stays."""
    rows = []
    for case, more in (("tanpura", {"e_3s": 0.05}), ("bass", {"e_0.4s": 0.02}), ("fretless", {})):
        run = grid.Run(case, "exact-hold", 1, 100, ())
        rows.append({"run": run, "e_0.1s": 0.0123, "spectral_distance_db": 1.26, "times_real_time": 1147.0, **more})
        rows[-1] |= {"cpu_per_s": 0.1, "cpu_per_s_median": 0.1, "mode_steps_per_s": 1.0}
    stands = {"half its rate": {"e_0.1s": 2e-5, "spectral_distance_db": 0.0}}
    references = {row["run"].case: {"run": row["run"], "stands": stands, "values": {"last_contact_s": 3.0}} for row in rows}
    known = SimpleNamespace(
        rows=rows, timed=[], references=references, machine="a machine", default_rows=lambda case: rows[:1]
    )
    said = tables.parts(known)
    page_there = page.DOCS / "speed-error.md"
    copy = tmp_path / "page.md"
    copy.write_text(page_there.read_text(encoding="utf-8"), encoding="utf-8")
    page.put(said, copy)
    text = copy.read_text(encoding="utf-8")
    assert f"One core of: a machine, vectors of {LANES} float64." in text and "## Order of convergence" in text
    label = rows[0]["run"].label
    assert f"| **{label}** | 44.1 kHz | 100 | 0.012 | 0.05 | 1.3 | 1147 |" in text
    assert f"| {label} | 44.1 kHz | 100 | 0.012 | 0.02 | 1.3 | 1147 |" in text
    assert "| points | e, 0.1 s | LSD, dB |" in text and "differs by e = 2e-05 over 0.1 s, 0.0 dB" in text
    with pytest.raises(ValueError, match="has no <!-- nothing -->"):
        page.put({"nothing": "x", "machine": "y"}, copy)
    assert copy.read_text(encoding="utf-8") == text
