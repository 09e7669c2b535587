"""Searches for a threshold, on levels whose threshold is known."""

import math

import pytest

from synth.setup.thresholds import threshold


def test_a_level_that_rises_is_found_where_it_reaches_three_decibels() -> None:
    found = threshold(lambda d: 100.0 * (d - 1e-3) / 1e-3, 1e-3, 4e-3, 2.5)
    assert found.touch_m == 1e-3
    assert found.buzz_m == pytest.approx(1.03e-3, rel=2e-3)
    assert found.low_m == pytest.approx(1.0075e-3, rel=6e-3)
    assert found.high_m == pytest.approx(1.055e-3, rel=6e-3)
    assert found.low_m <= found.buzz_m <= found.high_m
    assert math.isnan(found.returns_m)


def test_a_string_that_lies_on_its_bridge_is_searched_from_nothing() -> None:
    found = threshold(lambda d: 20.0 * math.log10(1.0 + d / 1e-4), 0.0, 4e-3, 0.5)
    assert found.buzz_m == pytest.approx(1e-4 * (10.0 ** (3.0 / 20.0) - 1.0), rel=3e-3)


def test_nothing_is_played_below_the_touch_or_beyond_the_limit() -> None:
    played: list[float] = []

    def level(displacement: float) -> float:
        played.append(displacement)
        return 0.0

    assert threshold(level, 5e-3, 4e-3, 2.5).buzz_m == math.inf
    assert played == []
    found = threshold(level, 1e-3, 4e-3, 2.5)
    assert found.buzz_m == math.inf
    assert found.touch_m == 1e-3
    assert 1e-3 < min(played) and max(played) == 4e-3


def test_a_buzz_that_goes_away_again_is_said() -> None:
    found = threshold(lambda d: 0.0 if 1.14e-3 < d < 1.3e-3 else 100.0 * (d - 1e-3) / 1e-3, 1e-3, 4e-3, 2.5)
    assert found.returns_m == pytest.approx(1.1 * 1.055e-3, rel=0.1)


def test_another_level_is_another_threshold() -> None:
    found = threshold(lambda d: 100.0 * (d - 1e-3) / 1e-3, 1e-3, 4e-3, 2.5, 10.0)
    assert found.buzz_m == pytest.approx(1.1e-3, rel=2e-3)
