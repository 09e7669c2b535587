import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synth.physics.obstacle import (
    BASS_FRETS,
    Obstacle,
    bass_neck_height,
    fret_positions,
    frets,
    fretted,
    parabola_height,
    wall_positions,
)

NECK = {"action_12th_m": 0.0020, "relief_m": 0.0003, "nut_height_m": 0.0005}


def test_twelfth_fret_is_half_way_and_each_step_a_semitone():
    x = fret_positions(0.863, 24)
    assert x[11] == pytest.approx(0.4315, rel=1e-15)
    assert x[23] == pytest.approx(0.863 * 0.75, rel=1e-15)
    speaking = 0.863 - np.concatenate([[0.0], x])
    assert np.allclose(speaking[:-1] / speaking[1:], 2 ** (1 / 12), rtol=1e-14, atol=0)


def test_paper_frets_follow_equal_temperament():
    assert np.abs(np.array(BASS_FRETS.positions_m) - fret_positions(0.863, 20)).max() < 1.0e-3


def test_paper_frets_follow_the_smooth_neck():
    off = np.array(BASS_FRETS.heights_m) - bass_neck_height(BASS_FRETS.positions_m)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(29e-6, abs=0.5e-6)


def test_the_smooth_neck_by_hand():
    # −(0.203 + 0.0036 x + 0.649 · 4s(1 − s)) mm: no bow at the nut and at the last fret, all of it half way
    expected = [-0.203e-3, -(0.203 + 0.0036 * 295.5 + 0.649) * 1e-3, -(0.203 + 0.0036 * 591.0) * 1e-3]
    assert bass_neck_height([0.0, 0.2955, 0.591]) == pytest.approx(expected, rel=1e-12)


def test_paper_frets_table():
    assert len(BASS_FRETS) == 20
    assert (BASS_FRETS.positions_m[0], BASS_FRETS.heights_m[0]) == (0.048, -0.00063)
    assert (BASS_FRETS.positions_m[8], BASS_FRETS.heights_m[8]) == (0.350, -0.00213)
    assert (BASS_FRETS.positions_m[19], BASS_FRETS.heights_m[19]) == (0.591, -0.002335)


def test_paper_frets_in_the_authors_profile(reference):
    # Their fretboard profile at the nodes iL/863: i mm from the nut; the frets are its local peaks
    profile = reference("authors_data.npz")["bass_h"]
    index = np.rint(1e3 * np.array(BASS_FRETS.positions_m)).astype(int) - 1
    assert np.allclose(profile[index], BASS_FRETS.heights_m, rtol=0, atol=1e-9)


def test_frets_show_the_clearances_a_luthier_set():
    heights = np.array(frets(0.863, 20, **NECK).heights_m)
    assert -heights[0] == pytest.approx(0.0005, rel=1e-13)
    assert -heights[11] == pytest.approx(0.0020, rel=1e-13)


def test_relief_is_the_gap_under_a_straightedge():
    neck = frets(0.863, 20, **NECK)
    x, eta = np.array(neck.positions_m), np.array(neck.heights_m)
    edge = eta[0] + (eta[-1] - eta[0]) * (x - x[0]) / (x[-1] - x[0])
    gap = edge - eta
    assert gap[0] == 0.0
    assert abs(gap[-1]) < 1e-18
    assert np.all(gap[1:-1] > 0.0)
    # The parabola through the frets peaks at half way with 0.3 mm
    s = (x - x[0]) / (x[-1] - x[0])
    assert np.interp(0.5, s, gap) == pytest.approx(0.0003, rel=5e-3)
    assert np.allclose(gap, 0.0003 * 4 * s * (1 - s), rtol=0, atol=1e-17)


def test_a_neck_without_relief_is_straight():
    neck = frets(0.65, 22, 0.0018, nut_height_m=0.0004)
    assert (
        np.abs(np.diff(neck.heights_m) / np.diff(neck.positions_m) + 0.0014 / (0.325 - fret_positions(0.65, 1)[0])).max()
        < 1e-13
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": 11}, "fret count must be >= 12"),
        ({"count": 0}, "fret count must be a whole number >= 1"),
        ({"scale_length_m": 0.0}, "scale_length_m must be > 0 m"),
        ({"action_12th_m": -0.001}, r"action_12th_m must be > 0 m, got -0\.001"),
        ({"nut_height_m": 0.0}, "nut_height_m must be > 0 m"),
        ({"relief_m": -0.0001}, "relief_m must be >= 0 m"),
        ({"relief_m": math.nan}, "relief_m must be >= 0 m"),
    ],
)
def test_bad_necks(change, message):
    with pytest.raises(ValueError, match=message):
        frets(**({"scale_length_m": 0.863, "count": 20} | NECK | change))


@pytest.mark.parametrize(
    ("positions", "heights", "message"),
    [
        ([0.1, 0.2], [0.0], "equally long, got 2 and 1"),
        ([0.2, 0.1], [0.0, 0.0], "position of point 2 must be more than 0.2 m, got 0.1 m; sort"),
        ([0.1, 0.1], [0.0, 0.0], "position of point 2"),
        ([0.0], [0.0], "position of point 1 must be more than 0 m"),
        ([0.1, math.nan], [0.0, 0.0], "positions_m of point 2 must be finite, got nan"),
        ([0.1], [-math.inf], "heights_m of point 1 must be finite"),
    ],
)
def test_bad_obstacles(positions, heights, message):
    with pytest.raises(ValueError, match=message):
        Obstacle(positions, heights)


def test_points_must_lie_on_the_string():
    Obstacle([0.5], [0.0]).check(0.500001)
    with pytest.raises(ValueError, match=r"position of point 1 must be less than the string's length 0\.5 m"):
        Obstacle([0.5], [0.0]).check(0.5)


def test_open_string_keeps_its_frets():
    assert fretted(BASS_FRETS, 0, 0.863) == (0.863, BASS_FRETS)


@pytest.mark.parametrize("n", range(1, 21))
def test_fretted_heights_measured_from_the_new_line(n):
    length, obstacle = fretted(BASS_FRETS, n, 0.863)
    x_n, eta_n = BASS_FRETS.positions_m[n - 1], BASS_FRETS.heights_m[n - 1]
    assert length == pytest.approx(0.863 - x_n, rel=1e-15)
    assert len(obstacle) == 20 - n
    # In the open string's coordinates the string is the line through fret n's top and the saddle
    for k, (x, height) in enumerate(zip(obstacle.positions_m, obstacle.heights_m, strict=True), start=n):
        line = np.interp(x + x_n, [x_n, 0.863], [eta_n, 0.0])
        assert x + x_n == pytest.approx(BASS_FRETS.positions_m[k], rel=1e-14)
        assert line + height == pytest.approx(BASS_FRETS.heights_m[k], abs=1e-17)
        assert height < 0.0


def test_fretted_by_hand():
    # Stopped at 0.2 m under 1 mm: half way to the saddle the line is 0.5 mm down, the fret there 0.9 mm
    length, rest = fretted(Obstacle([0.2, 0.6], [-1e-3, -0.9e-3]), 1, 1.0)
    assert length == pytest.approx(0.8)
    assert rest.positions_m == pytest.approx((0.4,))
    assert rest.heights_m == pytest.approx((-0.4e-3,))


@given(st.integers(0, 20), st.integers(0, 20))
def test_stopping_twice_is_stopping_once(first, second):
    n, k = sorted((first, second))
    length, rest = fretted(BASS_FRETS, n, 0.863)
    length_twice, rest_twice = fretted(rest, k - n, length)
    length_once, rest_once = fretted(BASS_FRETS, k, 0.863)
    assert length_twice == pytest.approx(length_once, rel=1e-14)
    assert rest_twice.positions_m == pytest.approx(rest_once.positions_m, rel=1e-13)
    assert rest_twice.heights_m == pytest.approx(rest_once.heights_m, abs=1e-17)


def test_a_fret_above_the_open_string():
    with pytest.raises(ValueError) as error:
        fretted(Obstacle([0.1, 0.2], [-1e-3, 0.21e-3]), 0, 1.0)
    assert str(error.value) == (
        "fret 2 must lie below the string at rest, open, got +0.21 mm; lower the fret or raise the nut"
    )


def test_a_fret_above_the_stopped_string():
    # At fret 1 the string runs 1 mm down at 0.2 m to 0.5 mm at 0.6 m, where fret 2 stands 0.3 mm down
    with pytest.raises(ValueError) as error:
        fretted(Obstacle([0.2, 0.6], [-1e-3, -0.3e-3]), 1, 1.0)
    assert str(error.value) == (
        "fret 2 must lie below the string at rest, stopped at fret 1, got +0.20 mm; lower fret 2 or raise fret 1"
    )


def test_a_fret_that_just_touches_presses():
    with pytest.raises(ValueError, match=r"fret 1 must lie below the string at rest, open, got \+0\.00 mm"):
        fretted(Obstacle([0.1], [0.0]), 0, 1.0)


@pytest.mark.parametrize("bad", [-1, 21, 2.5])
def test_frets_that_do_not_exist(bad):
    with pytest.raises(ValueError, match=r"fret must be a whole number from 0 \(open\) to 20"):
        fretted(BASS_FRETS, bad, 0.863)


def test_wall_positions_on_the_modal_grid():
    # 9 modes of 1 m: every 0.1 m, and what lies on the ends of the stretch is on it
    assert wall_positions(1.0, 0.2, 0.5, intervals=10) == pytest.approx([0.2, 0.3, 0.4, 0.5], rel=1e-14)
    assert wall_positions(1.0, 0.0, 1.0, intervals=4) == pytest.approx([0.25, 0.5, 0.75], rel=1e-14)
    assert wall_positions(2.0, 0.21, 1.39, intervals=10) == pytest.approx([0.4, 0.6, 0.8, 1.0, 1.2], rel=1e-14)


def test_wall_positions_by_number_and_by_spacing():
    assert wall_positions(1.0, 0.2, 0.5, nodes=4) == pytest.approx([0.2, 0.3, 0.4, 0.5], rel=1e-14)
    assert wall_positions(1.0, 0.2, 0.5, nodes=1).tolist() == [0.5]
    # the string's ends are never among them: of a wall that begins there the first is one step off
    assert wall_positions(1.0, 0.0, 0.5, nodes=5) == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5], rel=1e-14)
    assert wall_positions(1.0, 0.5, 1.0, nodes=3) == pytest.approx([0.5, 0.75], rel=1e-14)
    assert wall_positions(1.0, 0.2, 0.5, spacing_m=0.1) == pytest.approx([0.2, 0.3, 0.4, 0.5], rel=1e-13)
    assert wall_positions(1.0, 0.25, 0.5, spacing_m=0.1) == pytest.approx([0.3, 0.4, 0.5], rel=1e-13)


@pytest.mark.parametrize(
    ("stretch", "how", "message"),
    [
        ((-0.1, 0.5), {"nodes": 3}, "a wall must have 0 <= from_m < to_m <= 1 m, got -0.1 and 0.5 m"),
        ((0.5, 0.5), {"nodes": 3}, "a wall must have 0 <= from_m < to_m"),
        ((0.5, 1.1), {"nodes": 3}, "a wall must have 0 <= from_m < to_m"),
        ((0.2, 0.5), {}, "give intervals, nodes or spacing_m"),
        ((0.26, 0.49), {"intervals": 4}, r"no node lies on the wall from 0\.26 to 0\.49 m"),
    ],
)
def test_walls_that_are_none(stretch, how, message):
    with pytest.raises(ValueError, match=message):
        wall_positions(1.0, *stretch, **how)


def test_a_parabola_has_its_radius_at_its_top():
    # 2 mm off the top of a radius of 0.5 m: 4e-6/(2 · 0.5) = 4 µm below it
    heights = parabola_height(np.array([0.008, 0.010, 0.012, 0.014]), 0.010, -1e-4, 0.5)
    assert heights == pytest.approx([-1.04e-4, -1e-4, -1.04e-4, -1.16e-4], rel=1e-12)


@pytest.mark.parametrize("bad", [-1.0, 0.0, math.inf, math.nan])
def test_scales_of_no_length(bad):
    with pytest.raises(ValueError, match="scale_length_m must be > 0 m"):
        fret_positions(bad, 12)


def test_the_shortest_neck_and_the_defaults():
    assert len(frets(0.65, 12, 0.0018)) == 12
    assert fret_positions(0.65, 1) == pytest.approx([0.65 * (1.0 - 2.0 ** (-1.0 / 12.0))], rel=1e-14)
    heights = frets(0.65, 20, 0.0018).heights_m
    assert -heights[0] == pytest.approx(0.0004, rel=1e-12)
    # without relief they lie on a line
    slope = np.diff(heights) / np.diff(fret_positions(0.65, 20))
    assert slope == pytest.approx(np.full(19, slope[0]), rel=1e-10)


def test_every_note_of_a_usual_neck_can_be_played():
    for count, scale in ((20, 0.863), (24, 0.864), (22, 0.648)):
        neck = frets(scale, count, **NECK)
        for n in range(count + 1):
            fretted(neck, n, scale)
