"""Contact laws of other modules: a registry that any module can join, and the laws of `schemes.LAWS` beside them.

A module adds one with `register`; one that is installed is found by its entry point in the group `jawari.laws`, whose name
is the law's (`extensions`). docs/extending/contact-law.md shows one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from synth.extensions import Extensions
from synth.solver.schemes import LAWS, SCHEMES
from synth.spelling import perhaps


@dataclass(frozen=True)
class ContactLaw:
    """How contacts answer in a step of exact-hold's free motion.

    name     as `--scheme` and `[scheme] name` say it
    line     what it is, in a line
    answer   (model, state, scratch), addresses (`stringmodel`) → 0, or 1 where no answer was found; a plain function that is
             compiled. Of C contacts it finds

                 Scratch.y (C,)      displacement at the end of the step if no contact gave a force [m]
                 StringState.u (C,)  displacement at its start [m];  StringState.force (C,) the forces of the step before [N]
                 Scratch.a (C, C)    what a held force moves them by in the step [m/N], symmetric and positive
                 StringState.eta     their heights [m];  StringModel.dt  the step [s]

             and puts into Scratch.z (C,) the forces on the string [N], upwards, held over the step. A contact that is not
             reached must give none: y ≥ eta without forces means z = 0.
    """

    name: str
    line: str
    answer: Callable[[int, int, int], int]


LAWS_ADDED: Extensions[ContactLaw] = Extensions("jawari.laws", "a contact scheme", tuple(SCHEMES))


def register(law: ContactLaw) -> ContactLaw:
    """Let `--scheme` and cases name a law. Raises ValueError for a name that is taken or none."""
    return LAWS_ADDED.join(law.name, law)


def registered(name: str) -> ContactLaw | None:
    """The law that a module has added under a name. Raises ValueError where an installed one cannot be imported."""
    return LAWS_ADDED.find(name)


def is_law(name: str) -> bool:
    """Whether the kernels of strings step by it: one of `schemes.LAWS`, or registered."""
    return name in LAWS or registered(name) is not None


def check_scheme(name: str, known: dict[str, str]) -> str:
    """The name of one of `known` or of a registered law. Raises ValueError for another."""
    if name not in known and registered(name) is None:
        names = dict.fromkeys((*known, *(each for each in LAWS_ADDED.names if each not in SCHEMES)))
        raise ValueError(f"unknown contact scheme {name!r}{perhaps(name, names)}; use one of {', '.join(names)}")
    return name


def step_of(name: str) -> int:
    """Address of a registered law's answer, compiled on first use; 0 for the laws that the kernels know."""
    law = registered(name)
    if law is None:
        return 0
    from synth.jit.entries import entry  # who only asks for names does not load Numba

    return entry(law.answer, 3, answers=True).address
