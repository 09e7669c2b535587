"""What a player asks of a set-up, in words: "no buzz at medium, except open strings hard"."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from synth.setup.places import FretPlace
from synth.setup.plucking import VELOCITIES
from synth.units import midi_to_note

#: what a want may look like, for messages
EXAMPLES = (
    '"no buzz at medium", "no buzz at hard, except frets 13-20 medium, except string E soft", '
    '"no buzz at medium, except open strings hard, except fret 1 may buzz", "longest buzz at medium"'
)
_STROKE = rf"(?P<stroke>{'|'.join(VELOCITIES)}|velocity +\d+)"
_NO_BUZZ = re.compile(rf"no +buzz +at +{_STROKE}$")
_LONGEST = re.compile(rf"longest +buzz +at +{_STROKE}$")
_EXCEPT = re.compile(rf"(?:except +)?(?P<who>.+?) +(?:at +)?(?:{_STROKE}|(?P<free>may +buzz))$")
_FRETS = re.compile(r"frets? +(\d+)(?: *(?:-|–|to) *(\d+))?$")
_STRINGS = re.compile(r"strings? +(.+?)(?: +(open|frets? +.+))?$")


@dataclass(frozen=True)
class Rule:
    """Notes of a wish, and the velocity at which they must not buzz; None: they may.

    open   open strings alone; frets   (low, high); strings   names
    """

    velocity: int | None
    open: bool = False
    frets: tuple[int, int] | None = None
    strings: tuple[str, ...] = ()

    def concerns(self, place: FretPlace) -> bool:
        """Whether a note is one of those."""
        if self.open and place.fret != 0:
            return False
        if self.frets is not None and not self.frets[0] <= place.fret <= self.frets[1]:
            return False
        return not self.strings or place.string in self.strings or midi_to_note(place.opened) in self.strings


@dataclass(frozen=True)
class Want:
    """longest: a long buzz is wanted at the velocity of the first rule; else no buzz, the last rule that concerns a note
    counts."""

    longest: bool
    rules: tuple[Rule, ...]

    def velocity(self, place: FretPlace) -> int | None:
        """At which nothing may buzz at a note; None: it may."""
        return [rule for rule in self.rules if rule.concerns(place)][-1].velocity


def parse(text: str, strings: Sequence[str]) -> Want:
    """A wish of a text; `strings`: names of the instrument's. Raises ValueError that names what it does not understand."""
    first, *rest = [part.strip() for part in text.strip().split(",")]
    longest = _LONGEST.fullmatch(first)
    if longest is not None:
        if rest:
            raise ValueError(f'the wish: "longest buzz" has no exceptions, got {rest[0]!r}; leave it out')
        return Want(True, (Rule(_velocity(longest["stroke"])),))
    found = _NO_BUZZ.fullmatch(first)
    if found is None:
        raise ValueError(f"the wish: must begin with a wish such as {EXAMPLES}, got {first!r:.80}")
    rules = [Rule(_velocity(found["stroke"]))]
    for part in rest:
        other = _EXCEPT.fullmatch(part)
        if other is None:
            raise ValueError(
                f'the wish: {part!r:.80} is not understood; say which notes and which stroke, such as "except open strings '
                'hard" or "except string E frets 1-5 may buzz"'
            )
        velocity = None if other["free"] else _velocity(other["stroke"])
        rules.append(_rule(other["who"].strip(), velocity, strings))
    return Want(False, tuple(rules))


def _rule(who: str, velocity: int | None, strings: Sequence[str]) -> Rule:
    if re.fullmatch(r"(the +)?open +strings?", who):
        return Rule(velocity, open=True)
    frets = _FRETS.fullmatch(who)
    if frets is not None:
        return Rule(velocity, frets=_range(frets))
    named = _STRINGS.fullmatch(who)
    if named is None:
        raise ValueError(
            f'the wish: {who!r:.60} is not known; say "open strings", "fret 5", "frets 1-5", "string E" or '
            '"string E frets 1-5"'
        )
    names = tuple(re.split(r" +and +| *\+ *", named[1]))
    for name in names:
        if name not in strings:
            raise ValueError(f"the wish: no string is called {name!r:.40}; the strings are {', '.join(strings)}")
    if named[2] is None:
        return Rule(velocity, strings=names)
    if named[2] == "open":
        return Rule(velocity, open=True, strings=names)
    frets = _FRETS.fullmatch(named[2])
    if frets is None:
        raise ValueError(f'the wish: {named[2]!r:.60} is not understood; say "fret 5" or "frets 1-5"')
    return Rule(velocity, frets=_range(frets), strings=names)


def _range(found: re.Match[str]) -> tuple[int, int]:
    low = int(found[1])
    high = low if found[2] is None else int(found[2])
    if high < low:
        raise ValueError(f"the wish: frets must go from low to high, got {low}-{high}")
    return low, high


def _velocity(stroke: str) -> int:
    if stroke in VELOCITIES:
        return VELOCITIES[stroke]
    velocity = int(stroke.split()[1])
    if not 1 <= velocity <= 127:
        raise ValueError(f"the wish: velocity must lie between 1 and 127, got {velocity}")
    return velocity
