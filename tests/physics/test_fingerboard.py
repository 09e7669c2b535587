"""A board without frets: its surface from a luthier's measures, and under a finger."""

import pytest

from synth.physics.fingerboard import NEAR_NUT_M, Fingerboard, board_height, fingerboard, over_line, pressed_share

LENGTH, END = 0.8, 0.6


def board(relief: float = 4e-4) -> Fingerboard:
    return fingerboard(LENGTH, END, 2.5e-3, relief, 4e-4, 1e8, 0.7)


@pytest.mark.parametrize("relief", [0.0, 4e-4])
def test_what_a_luthier_measures_is_there(relief: float) -> None:
    made = board(relief)
    assert board_height(0.0, *made.profile) == pytest.approx(-4e-4)
    assert board_height(0.5 * LENGTH, *made.profile) == pytest.approx(-2.5e-3)
    straightedge = 0.5 * (board_height(0.0, *made.profile) + board_height(END, *made.profile))
    assert straightedge - board_height(0.5 * END, *made.profile) == pytest.approx(relief)
    assert (made.end_m, made.stiffness_n_m2, made.restitution) == (END, 1e8, 0.7)


def test_a_finger_gets_all_the_way_down_but_by_the_nut() -> None:
    made = board()
    assert made.stop(0.0) == 0.0
    assert made.stop(0.5 * NEAR_NUT_M) == pytest.approx(0.5 * board_height(0.5 * NEAR_NUT_M, *made.profile))
    assert made.stop(0.3) == board_height(0.3, *made.profile)
    assert pressed_share(NEAR_NUT_M) == pressed_share(0.5) == 1.0


def test_heights_are_over_the_line_from_the_finger_to_the_saddle() -> None:
    made, speaking = board(), 0.5
    found = made.heights(LENGTH, speaking, 49)
    stop = made.stop(LENGTH - speaking)
    for x, height in found:
        line = stop * (LENGTH - x) / speaking
        assert height == pytest.approx(board_height(x, *made.profile) - line)
    assert found[0][0] == pytest.approx(LENGTH - speaking + speaking / 50)
    assert found[-1][0] <= END < found[-1][0] + speaking / 50
    assert over_line(0.0, speaking, stop, stop) == 0.0


def test_a_board_that_touches_the_string_at_rest_is_refused() -> None:
    board().check(LENGTH, LENGTH)
    board().check(LENGTH, 0.5)
    high = fingerboard(LENGTH, END, 1e-4, 0.0, 5e-3, 1e8, 0.7)  # it rises towards the saddle
    with pytest.raises(ValueError, match=r"below the string at rest, open, got \+"):
        high.check(LENGTH, LENGTH)
    with pytest.raises(ValueError, match="stopped 300 mm from the nut"):
        high.check(LENGTH, 0.5)
    hump = Fingerboard(END, 4e-4, 5e-3, -5e-3, 1e8, 0.7)
    with pytest.raises(ValueError, match="raise the string or take less relief"):
        hump.check(LENGTH, LENGTH)


@pytest.mark.parametrize("end", [0.4, 0.8, 0.9])
def test_a_board_ends_between_half_way_and_the_saddle(end: float) -> None:
    with pytest.raises(
        ValueError, match=rf"between half way and the saddle, 400 and 800 mm from the nut, got {1e3 * end:g} mm"
    ):
        fingerboard(LENGTH, end, 2.5e-3, 0.0, 4e-4, 1e8, 0.7)
