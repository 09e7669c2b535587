"""What tools/bench counts and says, without its measurements."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from benchmarks import count, float32, kernels, peak, report, scenes
from benchmarks.aims import Aim, aim_of
from benchmarks.kernels import HOLD, Setting

from synth.solver.lanes import LANES


def test_a_mode_step_is_two_multiply_adds_and_one_for_each_projection() -> None:
    assert count.fma_per_mode_step(0) == 2
    one_contact, free = Setting(HOLD, 137, 1), Setting(HOLD, 137, 0)
    assert kernels.BY_NAME["advance_one"].fma(one_contact) == 4  # the contact and the output
    assert kernels.BY_NAME["advance_free"].fma(free) == 3
    assert kernels.BY_NAME["advance"].fma(Setting(HOLD, 137, 20)) == 23


def test_ratios_are_taken_round_by_round() -> None:
    """A machine that is three times slower in one round of both changes nothing; the best times need not pair."""
    median, best = count.times_less([1.0, 3.0, 1.25], [2.0, 6.0, 2.25])
    assert median == 2.0 and best == 2.0
    assert count.times_less([1.0, 2.0, 4.0], [4.0, 2.0, 1.0]) == (1.0, 1.0)
    with pytest.raises(ValueError, match="do not pair"):
        count.times_less([1.0, 2.0], [1.0])
    with pytest.raises(ValueError, match="do not pair"):
        count.times_less([], [])


def test_part_of_the_peak_is_a_ratio_of_rates() -> None:
    """30 in a second and 60 in a second against 120 in half a second."""
    median, best = count.part_of_peak(30.0, [1.0, 1.0, 0.5], 120.0, [0.5, 0.5, 0.5])
    assert median == pytest.approx(30.0 / 240.0) and best == pytest.approx(60.0 / 240.0)
    assert count.rate(30.0, [1.0, 2.0, 4.0]) == (15.0, 30.0)


def test_a_percentile_is_one_of_the_values() -> None:
    values = np.arange(1.0, 1001.0)[::-1]
    assert count.percentile(values, 99.9) == 999.0
    assert count.percentile(values, 100.0) == 1000.0
    assert count.percentile(values, 50.0) == 500.0
    assert count.percentile([7.0], 99.9) == 7.0


def test_what_repeats_is_told_from_what_the_machine_adds() -> None:
    runs = np.full((3, 2000), 1e-4)
    runs[:, 100] = 3e-4  # the program's own
    runs[1, 500] = 1e-2  # a stall
    found = count.block_times(runs.tolist(), 1e-3)
    assert found["median"] == pytest.approx(0.1) and found["percentile_999"] == pytest.approx(0.1)
    assert found["worst"] == pytest.approx(0.3) and found["worst_once"] == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("reached", "aim", "said"),
    [
        (3.0, Aim(3.0), "met"),
        (1.5, Aim(3.0), "missed by 50 %"),
        (0.5, Aim(0.5, at_most=True), "met"),
        (0.75, Aim(0.5, at_most=True), "missed by 50 %"),
        (None, Aim(3.0), "not measured"),
        (float("nan"), Aim(3.0), "not measured"),
        (3.0, None, ""),
    ],
)
def test_verdicts(reached: float | None, aim: Aim | None, said: str) -> None:
    assert count.verdict(reached, aim) == said


def test_an_aim_is_found_by_the_name_of_a_figure() -> None:
    assert aim_of("bass-note/E1/64") == Aim(150.0) and aim_of("bass-notes") is None
    assert aim_of("many-strings/2") == Aim(24.0) and aim_of("many-strings/2/block-128") == Aim(0.5, at_most=True)
    assert aim_of("several-steps/advance_blocks/137") is None


def kernel_figure(kernel: str, modes: int, part: float, contacts: int = 0) -> dict:
    return {
        "section": "kernels", "precision": "float64", "lanes": 8, "sweep": "grid", "kernel": kernel,
        "scheme": HOLD, "modes": modes, "contacts": contacts,
        "voices": 1, "fma": 3 + contacts, "looks_at_all": True, "mode_steps_per_s": 1e9, "best_mode_steps_per_s": 2e9,
        "part": part, "best_part": part, "part_of_narrow": 2.0 * part,
    }  # fmt: skip


def test_the_best_kernel_in_free_flight_is_held_against_half_the_peak() -> None:
    found = [kernel_figure("slow", 137, 0.3), kernel_figure("fast", 137, 0.6), kernel_figure("contact", 137, 0.9, 1)]
    found += [kernel_figure("fast", 1001, 0.4)]
    first, second = report.target_rows(found, whole=False)
    assert first["what"].startswith("fast") and first["reached"] == 0.6 and second["reached"] == 0.4
    text = report.markdown(found, "a machine", whole=False)
    assert "One core of: a machine." in text and text.count("Vectors of 8 numbers in float64:") == 2
    assert "| ≥ 0.5 | 0.6 | 0.6 | met |" in text and "missed by 20 %" in text and "not measured" not in text


def test_a_whole_run_names_what_it_did_not_measure() -> None:
    rows = report.target_rows([kernel_figure("fast", 137, 0.6)], whole=True)
    assert [row["what"] for row in rows if row["reached"] is None] == [what for what, *_ in report.WANTED.values()]
    name = "several-steps/press_blocks/137"
    given = {"name": name, "what": "blocks", "unit": "times less", "reached": 4.0, "best": 4.0, "figure": None}
    measured = {"section": "targets", "precision": "float64", "lanes": 8, "rows": [given]}
    rows = report.target_rows([measured], whole=True)
    assert sum(row["reached"] is None for row in rows) == len(report.WANTED) - 1


def test_only_benchmarks_that_noted_something_are_reported() -> None:
    recorded = {"benchmarks": [{"extra_info": {}}, {"extra_info": {"section": "peak", "lanes": 8}}]}
    assert report.figures(recorded) == [{"section": "peak", "lanes": 8}]


def test_the_peak_loop_does_what_it_counts() -> None:
    """Its own check against plain arithmetic, in every width that is reported."""
    for lanes in {2, min(4, LANES), LANES}:
        peak.peak_loop(lanes)(2)
        assert peak.fma_of_turn(lanes) == peak.fma_of_turn(1) * lanes


SETTINGS = [Setting(HOLD, 25, 0), *(Setting(scheme, 25, contacts) for scheme in kernels.SCHEMES for contacts in (1, 20))]


@pytest.mark.parametrize("setting", SETTINGS)
def test_kernels_that_are_compared_do_the_same(setting: Setting) -> None:
    """The same state after some steps, with contact where there is something to touch: none leaves out what others do."""
    ends = [state_after(kernel, setting) for kernel in kernels.KERNELS if kernel.takes(setting)]
    assert len(ends) >= 2
    _, q, _ = kernels.string(setting)
    for end in ends:
        assert np.abs(end - ends[0]).max() < 1e-9 * np.abs(ends[0]).max()
        assert np.abs(end[: q.size] - q).max() > 0.1 * np.abs(q).max()
    if setting.contacts == 1 and setting.scheme == HOLD:
        free = state_after(kernels.BY_NAME["advance_free"], setting._replace(contacts=0))
        assert np.abs(free - ends[0]).max() > 1e-6 * np.abs(free).max(), "nothing was touched"


def state_after(kernel: kernels.Kernel, setting: Setting) -> np.ndarray:
    """q and v after 200 steps, taken twice so that `reset` has its part in it."""
    stretch = kernel.make(setting, 200)
    for _ in range(2):
        stretch.reset()
        stretch.call()
    return np.concatenate([stretch.q[: setting.modes], stretch.v[: setting.modes]])


def test_strings_that_touch_are_told_from_those_that_sleep() -> None:
    player = scenes.crowd(2, 0.3)
    assert not scenes.touching(player.engine).any()
    touched = np.zeros(2, bool)
    for _ in player.blocks(128):
        touched |= scenes.touching(player.engine)
    assert touched.all()


def test_the_scene_of_many_strings_has_as_many_pitches() -> None:
    preset = scenes.many_strings(64)
    pitches = {table.notes[0] + table.cents / 100.0 for table in preset.string}
    assert len(preset.string) == len(pitches) == 64 and preset.mapping.polyphony == 64
    assert min(pitches) == scenes.LOWEST and max(pitches) == scenes.HIGHEST
    assert preset.obstacle == scenes.load_preset("tanpura-light").obstacle


@pytest.mark.parametrize("scheme", [HOLD, "moreau-jean"])
def test_float32_is_the_same_run_but_for_rounding(scheme: str) -> None:
    """Apart by a twentieth of what `fine` promises at most; without the contact it is another run."""
    plucked, steps = kernels.string(Setting(scheme, 50, 1)), 2048
    double, expected = float32.stretch(plucked, steps, single=False)
    double.call()
    apart = {}
    for flies in (False, True):
        stretch, out = float32.stretch(plucked, steps, flies)
        stretch.call()
        apart[flies] = np.linalg.norm(out - expected) / np.linalg.norm(expected)
    assert 0.0 < apart[False] < 0.001 and apart[True] > 0.1


def test_float32_drift_is_what_its_coefficients_say() -> None:
    """Less than a thousandth of a cent, where a two-step form is off by more than a hundredth."""
    plucked = kernels.string(Setting(HOLD, 50, 1))
    cents, decay = float32.misfit(plucked)
    assert np.abs(cents[:20]).max() < 1e-3 and float32.drift(plucked, 3.0) < 1e-3
    assert np.abs(decay).max() < 2.0**-22 / (8 * plucked.model.string.dt)
    assert np.abs(float32.two_step_misfit(plucked)[0]) > 0.01


def test_figures_of_other_vectors_have_a_table_of_their_own() -> None:
    single = kernel_figure("fast", 137, 0.4) | {"precision": "float32", "lanes": 16}
    text = report.markdown([kernel_figure("fast", 137, 0.6), single], "a machine", whole=False)
    wide, narrow = text.index("Vectors of 8 numbers in float64:"), text.index("Vectors of 16 numbers in float32:")
    assert wide < text.index("| 0.6 | 0.6 | met |") < narrow < text.index("missed by 20 %")
