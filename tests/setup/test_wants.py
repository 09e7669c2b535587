"""Wishes in words."""

import pytest

from synth.setup.places import FretPlace
from synth.setup.wants import parse

NAMES = ["E", "A", "D", "G", "Sa 1"]


def place(string: str, fret: int) -> FretPlace:
    return FretPlace(0, 40, fret, string)


def test_the_last_rule_that_concerns_a_note_counts() -> None:
    want = parse(
        "no buzz at medium, except open strings hard, except string E frets 1-5 soft, except fret 3 may buzz", NAMES
    )
    assert not want.longest
    assert want.velocity(place("A", 7)) == 80
    assert want.velocity(place("A", 0)) == 120
    assert want.velocity(place("E", 2)) == 40
    assert want.velocity(place("E", 3)) is None
    assert want.velocity(place("E", 6)) == 80


def test_velocities_and_several_strings() -> None:
    want = parse("no buzz at velocity 100, except strings D and G may buzz, string Sa 1 open velocity 127", NAMES)
    assert want.velocity(place("E", 1)) == 100
    assert want.velocity(place("G", 1)) is None
    assert want.velocity(place("Sa 1", 0)) == 127
    assert want.velocity(place("Sa 1", 2)) == 100


def test_longest() -> None:
    want = parse("longest buzz at medium", NAMES)
    assert want.longest
    assert want.rules[0].velocity == 80


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "must begin with a wish"),
        ("no rattle at all", "must begin with a wish"),
        ("no buzz at loud", "must begin with a wish"),
        ("no buzz at velocity 0", "between 1 and 127, got 0"),
        ("no buzz at medium, except the bass side hard", "is not known"),
        ("no buzz at medium, except string B hard", "no string is called 'B'"),
        ("no buzz at medium, except frets 9-5 hard", "from low to high, got 9-5"),
        ("no buzz at medium, except open strings", "is not understood"),
        ("longest buzz at medium, except open strings hard", "has no exceptions"),
    ],
)
def test_what_is_not_understood_is_said(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        parse(text, NAMES)
