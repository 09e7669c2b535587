"""Quality → internal rate and modes."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest

from synth.dsp.measures import relative_error
from synth.dsp.rates import MAXIMUM_FACTOR
from synth.instrument.calibration import STEPS
from synth.instrument.compile import describe_plan, open_string, string_kind
from synth.instrument.plan import (
    BRIDGE,
    BRIDGE_ERROR,
    FAR,
    FREE,
    IMPACTS,
    KEPT,
    MAX_MODES,
    QUALITIES,
    WALL,
    choose_factor,
    foundation_length,
    plan_string,
    plan_wall,
    promise,
    scene_kind,
    wanted_rate_hz,
)
from synth.instrument.planfile import MeasuredPlan
from synth.instrument.preset import BridgeObstacle, list_presets, load_preset
from synth.physics.modes import count_modes_below, modal_frequencies
from synth.physics.string import String
from synth.research.simulation import Case, Scene, simulate


def string(length_m: float = 0.9, tension_n: float = 40.0, bending_n_m2: float = 2.5e-4) -> String:
    return String(
        length_m=length_m,
        tension_n=tension_n,
        linear_density_kg_m=1e-3,
        bending_stiffness_n_m2=bending_n_m2,
        diameter_m=4e-4,
        core_diameter_m=None,
        winding_diameter_m=None,
        viscoelastic_loss=4.5e-3,
        thermoelastic_q_inverse=2e-4,
    )


def test_what_is_touched_decides_the_kind():
    stiff, soft = string(), string(bending_n_m2=1e-7)  # bending lengths 2.5 mm and 0.05 mm
    assert scene_kind(stiff, ()) == FREE
    assert scene_kind(stiff, (0.006,)) == scene_kind(stiff, (0.88,)) == BRIDGE
    assert scene_kind(stiff, (0.3,)) == scene_kind(stiff, (0.006, 0.5)) == IMPACTS
    assert scene_kind(soft, (0.006,)) == IMPACTS


def test_where_the_kinds_part():
    """A bridge: no further than 3 % of the length from an end, its distance no more than 1/0.07 bending lengths."""
    stiff = string(bending_n_m2=40.0 * 0.07**2 * 0.03**2)  # bending length 0.07 · 0.03 m
    assert [scene_kind(stiff, (x,)) for x in (0.0265, 0.02705, 0.9 - 0.0265, 0.9 - 0.02705)] == [BRIDGE, IMPACTS] * 2
    long = string(length_m=2.0, bending_n_m2=40.0 * 0.07**2 * 0.03**2)
    assert [scene_kind(long, (x,)) for x in (0.0299, 0.0301, 2.0 - 0.0299, 2.0 - 0.0301)] == [BRIDGE, IMPACTS] * 2
    # which half: that of the point, or the other
    assert [scene_kind(stiff, (0.88,), (pluck,)) for pluck in (0.449, 0.451)] == [FAR, BRIDGE]
    assert scene_kind(stiff, (0.02,), (0.1, 0.8)) == FAR


def test_without_contact_the_output_rate_is_enough():
    for quality in QUALITIES:
        factor, error = choose_factor(110.0, FREE, quality, 44100.0)
        assert factor == 1 and error == "exact"
        assert wanted_rate_hz(110.0, FREE, quality) == 0.0


def test_the_calibrated_rate_is_reached_and_not_overshot():
    for kind in (BRIDGE, FAR, IMPACTS):
        for quality in QUALITIES:
            for f0 in (41.2, 65.4, 130.8, 261.6, 1046.5):
                wanted = STEPS[kind][quality] * f0
                factor, error = choose_factor(f0, kind, quality, 48000.0)
                if wanted <= 48000.0 * MAXIMUM_FACTOR:
                    assert error == promise(kind, quality)
                    assert factor * 48000.0 >= wanted * (1 - 1e-9)
                    assert factor == 1 or (factor - 1) * 48000.0 < wanted
                else:  # no more is promised than the rate that is left is known to give
                    reached = [q for q in QUALITIES if wanted_rate_hz(f0, kind, q) <= 48000.0 * MAXIMUM_FACTOR]
                    assert factor == MAXIMUM_FACTOR
                    assert error == f"{promise(kind, reached[-1])} (limited to {MAXIMUM_FACTOR} × output)"


def test_better_quality_never_computes_less():
    for kind in (BRIDGE, FAR, IMPACTS):
        for f0 in (41.2, 200.0, 1046.5):
            rates = [wanted_rate_hz(f0, kind, quality) for quality in QUALITIES]
            assert rates == sorted(rates) and rates[0] < rates[-1]


def test_internal_rate_does_not_depend_on_the_output_rate_by_more_than_its_grain():
    wanted = wanted_rate_hz(98.0, BRIDGE, "fine")
    for rate in (44100.0, 48000.0, 88200.0, 96000.0):
        factor, _ = choose_factor(98.0, BRIDGE, "fine", rate)
        assert wanted <= factor * rate < wanted + rate


def test_the_ends_of_what_can_be_asked_for():
    assert choose_factor(98.0, BRIDGE, "standard", 44100.0, 44100.0) == (1, "not calibrated at a rate of your own")
    assert choose_factor(98.0, BRIDGE, "standard", 44100.0, MAXIMUM_FACTOR * 44100.0)[0] == MAXIMUM_FACTOR
    for rate, nearest in (
        (100000.0, 88200.0),
        (44100.0 * (MAXIMUM_FACTOR + 1), 2822400.0),
        (0.0, 44100.0),
        (66151.0, 88200.0),
    ):
        with pytest.raises(ValueError, match=re.escape(f"of 44100 Hz, got {rate:g} Hz; take {nearest:g} Hz")):
            choose_factor(98.0, BRIDGE, "standard", 44100.0, rate)
    # a rate that is wanted to the last digit is not exceeded for a rounding error, and at the limit nothing is limited
    f0 = 3.0 * 44100.0 / STEPS[BRIDGE]["fine"]
    assert [choose_factor(f0 * (1.0 + off), BRIDGE, "fine", 44100.0)[0] for off in (-1e-6, 1e-12, 1e-6)] == [3, 3, 4]
    f0 = MAXIMUM_FACTOR * 44100.0 / STEPS[IMPACTS]["fine"]
    assert choose_factor(f0, IMPACTS, "fine", 44100.0) == (MAXIMUM_FACTOR, promise(IMPACTS, "fine"))
    beyond = choose_factor(1.01 * f0, IMPACTS, "fine", 44100.0)
    assert beyond == (MAXIMUM_FACTOR, f"{promise(IMPACTS, 'standard')} (limited to {MAXIMUM_FACTOR} × output)")
    factor, kept = choose_factor(1.01 * f0, IMPACTS, "fine", 44100.0, decimated=False)
    assert (factor, kept) == (MAXIMUM_FACTOR + 1, promise(IMPACTS, "fine"))
    assert choose_factor(1e9, IMPACTS, "fine", 44100.0)[1] == f"not calibrated (limited to {MAXIMUM_FACTOR} × output)"


def test_own_rate_must_be_a_multiple():
    assert choose_factor(98.0, BRIDGE, "standard", 44100.0, 176400.0)[0] == 4
    for rate in (100000.0, 44100.0 * (MAXIMUM_FACTOR + 1), 0.0, 22050.0):
        with pytest.raises(ValueError, match="internal rate must be 1 to 64 times"):
            choose_factor(98.0, BRIDGE, "standard", 44100.0, rate)


def test_unknown_quality_is_named():
    with pytest.raises(ValueError, match="quality must be one of draft, standard, fine, reference, got 'best'"):
        choose_factor(98.0, BRIDGE, "best", 44100.0)


def test_modes_are_those_below_half_the_internal_rate():
    plan = plan_string(string(), 110.0, 1, BRIDGE, quality="standard", rate_hz=44100.0)
    limit = 3.141592653589793 * plan.rate_hz
    omega = modal_frequencies(string(), plan.modes + 1)
    assert omega[plan.modes - 1] < limit <= omega[plan.modes]
    assert plan.rate_hz == plan.factor * 44100.0
    assert f"{plan.modes} modes" in plan.reason and "1 contact:" in plan.reason


def test_a_plan_goes_as_far_as_the_decimator_unless_there_is_none():
    limited, free = (
        plan_string(string(), 1e5, 1, IMPACTS, quality="fine", rate_hz=44100.0, **more)
        for more in ({}, {"decimated": False})
    )
    assert limited.factor == MAXIMUM_FACTOR < free.factor


def test_there_is_a_mode_at_least_and_an_end():
    short = plan_string(string(0.02, 4000.0), 50000.0, 0, FREE, quality="draft", rate_hz=44100.0)
    assert short.modes == 1
    long = plan_string(
        string(5.0, 10.0), 10.0, 1, BRIDGE, quality="standard", rate_hz=44100.0, internal_rate_hz=64 * 44100.0
    )
    assert long.modes <= MAX_MODES


def test_the_most_modes():
    slack = string(5.0, 10.0, bending_n_m2=0.0)  # 10 Hz
    plans = [plan_string(slack, 10.0, 0, FREE, quality="draft", rate_hz=rate) for rate in (39_000.0, 40_100.0)]
    assert [plan.modes for plan in plans] == [1949, MAX_MODES]
    assert [plan.reason for plan in plans] == [
        "0 contacts: 39.0 kHz (1 × output), 1949 modes below half of it; exact",
        "0 contacts: 40.1 kHz (1 × output), 2000 modes below half of it; exact",
    ]


def test_a_wall_gets_the_grid_and_the_step_that_its_stiffness_asks_for():
    """Δx below 2.25 foundation lengths, ΩΔt below 0.7 at standard; modes + 1 a power of two."""
    flexible = string(bending_n_m2=0.0)
    assert foundation_length(4e5, flexible) == pytest.approx(0.01)  # √(T/k)
    assert foundation_length(4e7, string(bending_n_m2=0.4)) == pytest.approx(0.01)  # (EI/k)^¼
    for k in (1e4, 3e5, 1e7):
        for quality, (nodes, angle, error) in WALL.items():
            plan = plan_wall(flexible, k, quality=quality, rate_hz=44100.0)
            assert (plan.quality, plan.scheme, plan.contacts, plan.error) == (quality, "wall", 0, error)
            spacing, wanted = 0.9 / (plan.modes + 1), nodes * foundation_length(k, flexible)
            assert (plan.modes + 1) & plan.modes == 0
            assert spacing <= wanted and (2.0 * spacing > wanted or plan.modes == 1)
            turn = (k / 1e-3) ** 0.5
            assert plan.rate_hz == plan.factor * 44100.0 and turn / plan.rate_hz <= angle
            assert plan.factor == 1 or turn / (plan.rate_hz - 44100.0) > angle
    soft = plan_wall(flexible, 1e-15, quality="draft", rate_hz=44100.0)
    assert (soft.modes, soft.factor) == (1, 1)
    just = 1e-3 * (2.0 * 44100.0 * WALL["standard"][1]) ** 2
    assert [plan_wall(flexible, just * x, quality="standard", rate_hz=44100.0).factor for x in (1.0, 1.0 + 1e-6)] == [2, 3]


def test_a_better_quality_resolves_a_wall_at_least_twice_as_finely():
    """What tools/wall-study measured: each halves the nodes' distance, and the step at least."""
    nodes, angles = ([WALL[quality][of] for quality in QUALITIES] for of in (0, 1))
    assert [coarse / fine for coarse, fine in itertools.pairwise(nodes)] == pytest.approx([2.0, 2.0, 2.0], rel=0.01)
    assert all(coarse / fine > 1.99 for coarse, fine in itertools.pairwise(angles))
    assert (
        plan_wall(string(bending_n_m2=0.0), 1e5, quality="standard", rate_hz=44100.0).modes == 31
    )  # 0.9/(2.25 · 0.02) = 20


def test_walls_that_cannot_be_planned():
    with pytest.raises(ValueError, match="quality must be one of draft, standard, fine, reference, got 'best'"):
        plan_wall(string(), 1e6, quality="best", rate_hz=44100.0)
    for stiffness in (0.0, -1.0, float("inf"), float("nan")):
        with pytest.raises(ValueError, match="the stiffness of a planned wall must be finite and > 0"):
            plan_wall(string(), stiffness, quality="fine", rate_hz=44100.0)


def test_other_schemes_say_that_they_are_not_calibrated():
    plan = plan_string(string(), 110.0, 1, BRIDGE, quality="standard", rate_hz=44100.0, scheme="moreau-jean")
    assert plan.error == "not calibrated for this scheme"


def far_bridge():
    """A bridge plucked beyond mid-string, of which the rate of a bridge at `fine` makes e = 0.03."""
    length, speed, tension = 0.799, 2.0 * 55.0 * 0.799, 60.0
    return {
        "string": {
            "length_m": length,
            "tension_n": tension,
            "linear_density_kg_m": tension / speed**2,
            "diameter_m": 1e-3,
            "inharmonicity": 1e-4,
            "viscoelastic_loss": 7.3e-3,
            "thermoelastic_q_inverse": 3.5e-4,
        },
        "obstacle": {"positions_m": [0.0095], "heights_m": [5e-6]},
        "initial": {
            "shape": "triangle",
            "position_m": 0.97 * length,
            "displacement_m": 0.0024 * length,
            "width_m": 0.026 * length,
        },
        "run": {"internal_rate_hz": 44100.0, "modes": 1, "duration_s": 3.0, "outputs_m": [0.99 * length]},
    }


def test_a_bridge_plucked_beyond_mid_string_gets_a_rate_that_keeps_its_promise():
    """L 0.799 m, 55 Hz, B 1e-4, a point 9.5 mm from the nut raised by 5 µm, plucked at 0.97 L; against 24 × 44.1 kHz."""
    case = far_bridge()
    shape = Scene(Case.model_validate(case), Path()).string

    def run(rate_hz):
        modes = count_modes_below(shape, rate_hz / 2.0)
        return simulate(case, internal_rate_hz=rate_hz, modes=modes, output_rate_hz=44100.0).u

    exact = run(24 * 44100.0)
    fine = simulate(case, quality="fine")
    assert fine.metadata["internal_rate_hz"] >= STEPS[FAR]["fine"] * 55.0
    assert relative_error(fine.u, exact) < BRIDGE_ERROR["fine"]
    # the rate of a bridge misses it: without a kind of its own the scene would be planned wrongly
    assert (
        relative_error(run(2 * 44100.0), exact) > 1.2 * BRIDGE_ERROR["fine"]
        and wanted_rate_hz(55.0, BRIDGE, "fine") < 88200.0
    )


def test_where_it_is_plucked_decides_between_near_and_far():
    stiff = string()
    assert scene_kind(stiff, (0.006,), (0.2, 0.45)) == BRIDGE  # up to the middle the calibration of bridges holds
    assert scene_kind(stiff, (0.006,), (0.2, 0.46)) == scene_kind(stiff, (0.88,), (0.44,)) == FAR
    assert scene_kind(stiff, (0.3,), (0.8,)) == IMPACTS and scene_kind(stiff, (), (0.8,)) == FREE
    for quality in QUALITIES:
        assert wanted_rate_hz(55.0, FAR, quality) > wanted_rate_hz(55.0, BRIDGE, quality)


def test_promises_in_words():
    kept = "in 95 % of random scenes"
    for quality, error in (("draft", "0.3"), ("standard", "0.1"), ("fine", "0.02")):
        assert promise(BRIDGE, quality) == promise(FAR, quality) == f"e < {error} over 3 s {kept}"
    assert promise(IMPACTS, "draft") == (f"log-spectral distance < 6 dB, where chaotic third octaves within 4 dB, {kept}")
    assert promise(IMPACTS, "standard") == (
        f"e < 0.3 over 0.1 s, log-spectral distance < 3 dB, where chaotic third octaves within 2.5 dB, {kept}"
    )
    assert promise(IMPACTS, "fine") == (
        f"e < 0.1 over 0.1 s, log-spectral distance < 1.5 dB, where chaotic third octaves within 2.5 dB, {kept}"
    )
    assert {promise(kind, "reference") for kind in (BRIDGE, FAR, IMPACTS)} == {"as close as converged runs"}


def test_a_promise_says_in_how_many_scenes_it_is_kept():
    for kind in (BRIDGE, FAR, IMPACTS):
        for quality in QUALITIES[:-1]:
            assert promise(kind, quality).endswith("in 95 % of random scenes")
    assert promise(FREE, "fine") == "exact"
    by_law = load_preset("tanpura-light").with_measured(MeasuredPlan())
    plan = describe_plan(by_law, 48, quality="fine")
    assert "e < 0.02 over 3 s in 95 % of random scenes" in plan["text"]
    assert all(row["kept_in"] == KEPT == 0.95 for row in plan["strings"])
    measured = describe_plan(load_preset("tanpura-light"), 48, quality="fine")
    assert "; e < 0.02 over 3 s; measured on this string: e 0.0" in measured["text"]
    assert all(row["kept_in"] == KEPT for row in measured["strings"])


def test_no_note_of_the_presets_is_plucked_from_afar():
    for preset in list_presets():
        for table in preset.string:
            for note in (table.notes[0], table.notes[1]):
                opened, below = open_string(preset, table, note)
                curved = isinstance(preset.obstacle, BridgeObstacle)
                assert string_kind(preset, opened, below) == scene_kind(opened, below.positions_m, curved=curved)
    preset = load_preset("tanpura-light").with_setting("pluck.position", "0.6")
    opened, below = open_string(preset, preset.string[0], 43)
    assert string_kind(preset, opened, below) == FAR
