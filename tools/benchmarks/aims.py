"""What was aimed at, by the names of figures."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import NamedTuple


class Aim(NamedTuple):
    """A figure is to be at least this, or at most."""

    value: float
    at_most: bool = False

    def met(self, reached: float) -> bool:
        """Whether a figure reaches it."""
        return reached <= self.value if self.at_most else reached >= self.value


#: names, with * and ? as in a shell, the first that fits
AIMS = {
    "tanpura-kernel": Aim(400.0),
    "several-steps/press_blocks/*": Aim(3.0),
    "free-flight/*": Aim(0.5),
    "published/*": Aim(1.5),
    "paper-bass": Aim(1.0),
    "bass-note/*": Aim(150.0),
    "fretless-note": Aim(20.0),
    "twelve/sitar": Aim(15.0),
    "twelve/veena": Aim(20.0),
    "twelve/*-guitar": Aim(60.0),
    "twelve/*": Aim(50.0),
    "strummed/*": Aim(10.0),
    "gesture/*": Aim(1.5, at_most=True),
    "sixty/*median": Aim(0.5, at_most=True),
    "sixty/*worst": Aim(0.5, at_most=True),
    "many-strings/?": Aim(24.0),
    "many-strings/?/block-128": Aim(0.5, at_most=True),
    "batch/*": Aim(0.9),
    "decay/*/mode-steps": Aim(1.0, at_most=True),
    "decay/*/cpu": Aim(1.0, at_most=True),
}


def aim_of(name: str) -> Aim | None:
    """What a figure is to be; None for one that nothing was aimed at."""
    return next((aim for pattern, aim in AIMS.items() if fnmatchcase(name, pattern)), None)
