"""Lists, ranges, draws: what they give, and what is no such thing."""

from __future__ import annotations

import math
from statistics import NormalDist

import pytest
from hypothesis import given
from hypothesis import strategies as st

from synth.dataset.alternatives import alternatives

SHARES = st.floats(0.0, 1.0, exclude_max=True)


@pytest.mark.parametrize(
    ("given_", "values"),
    [
        (3, (3,)),
        ("C3", ("C3",)),
        ([1, 2.5], (1, 2.5)),
        ({"from": 1, "to": 2, "steps": 3}, (1.0, 1.5, 2.0)),
        ({"from": 1, "to": 100, "steps": 3, "scale": "log"}, (1.0, 10.0, 100.0)),
        ({"from": 1, "to": 4, "steps": 7, "whole": True}, (1, 2, 3, 4)),
        ({"from": 5, "to": 5, "steps": 1}, (5.0,)),
    ],
)
def test_lists_hold_their_values(given_: object, values: tuple) -> None:
    found = alternatives(given_)
    assert not found.drawn and found.values == pytest.approx(values) if values[0] != "C3" else found.values == values


@given(SHARES)
def test_what_is_drawn_lies_in_its_range(share: float) -> None:
    even = alternatives({"from": 0.1, "to": 0.3}).draw(share)
    assert even == pytest.approx(0.1 + 0.2 * share) and 0.1 <= even <= 0.3
    assert alternatives({"from": 1, "to": 100, "scale": "log"}).draw(share) == pytest.approx(100.0**share)
    assert alternatives({"from": 1, "to": 6, "whole": True}).draw(share) == 1 + int(6 * share)
    assert alternatives({"one_of": ["a", "b"]}).draw(share) == "ab"[int(2 * share)]
    assert 0.15 <= alternatives({"mean": 0.2, "spread": 5.0, "low": 0.15, "high": 0.22}).draw(share) <= 0.22
    assert isinstance(alternatives({"mean": 64, "spread": 20, "low": 1, "high": 127, "whole": True}).draw(share), int)


def test_a_normal_distribution_is_cut_and_not_heaped_at_its_ends() -> None:
    axis = alternatives({"mean": 0.0, "spread": 1.0, "low": -1.0, "high": 2.0})
    n = 20_000
    found = sorted(axis.draw((k + 0.5) / n) for k in range(n))
    normal = NormalDist()
    begin, end = normal.cdf(-1.0), normal.cdf(2.0)
    for x in (-0.9, 0.0, 1.0, 1.9):
        share = (normal.cdf(x) - begin) / (end - begin)
        assert sum(value <= x for value in found) / n == pytest.approx(share, abs=1e-3)
    assert len(set(found)) == n


@pytest.mark.parametrize(
    ("given_", "said"),
    [
        ([], "at least one value"),
        ({}, "from and to"),
        ({"from": 1}, "from and to"),
        ({"from": 2, "to": 1}, "must not lie above to"),
        ({"from": 0, "to": 1, "scale": "log"}, "above 0"),
        ({"from": 0, "to": 1, "scale": "cube"}, "scale must be one of"),
        ({"from": 0, "to": 1, "steps": 0}, "steps must be"),
        ({"from": 0, "to": 1, "mean": 1}, "no key 'mean'"),
        ({"from": 0.5, "to": 2, "whole": True}, "whole numbers"),
        ({"from": math.nan, "to": 1}, "finite"),
        ({"from": "a", "to": 1}, "finite"),
        ({"mean": 0, "spread": -1}, "spread must not"),
        ({"mean": 3, "spread": 1, "high": 2}, "mean must lie"),
        ({"one_of": []}, "one_of must be a list"),
        ([{"from": 1, "to": 2}], "a range stands alone"),
        (math.inf, "finite"),
    ],
)
def test_what_is_none_says_why(given_: object, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        alternatives(given_)


def test_whole_numbers_are_asked_for_where_only_they_can_be() -> None:
    with pytest.raises(ValueError, match=r"whole number, got 1.5"):
        alternatives([1, 1.5], whole=True)
    assert alternatives({"from": 1, "to": 3}, whole=True).draw(0.99) == 3
