"""What a right hand may do to a string when a note begins: the pluck that every preset has, and what modules add.

A preset names one with `[excitation] kind = "…"`; without, it plucks. A module adds one with `register`; one that is
installed is found by its entry point in the group `jawari.excitations`, whose name is the kind (`extensions`).
docs/extending/excitation.md shows one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from synth.extensions import Extensions
from synth.instrument.table import Table, kind_of

#: longest that a hand may hold a string [s]
MOST_HOLD_S = 10.0


class ExcitationTable(Table):
    """The table [excitation]: its kind, and in a class of its own what that kind needs."""

    kind: str


@dataclass(frozen=True)
class Excitation:
    """A hand that holds the string for a while: a spring and a dashpot between the string and a path of its own.

    kind      the name that presets have for it
    settings  class of its table in a preset
    made      (settings) → constants: a NamedTuple of numbers
    begin     (core, thread, s, velocity): takes hold of string s with `engine.strings.take_hold`; velocity 1 … 127
    follow    (core, thread, s, steps): Scratch.path[0] … [steps], where the hand is before the next `steps` internal steps
              and after each of them [m]; STROKE.finger_step of .finger_steps have been taken. It follows from these and
              from what `begin` left, not from where calls are cut

    `begin` and `follow` are plain functions that are compiled and called by address, on the thread of the sound card.
    """

    kind: str
    settings: type[ExcitationTable]
    made: Callable[[Any], Any]
    begin: Callable[[int, int, int, int], None]
    follow: Callable[[int, int, int, int], None]


EXCITATIONS: Extensions[Excitation] = Extensions("jawari.excitations", "an excitation", ("pluck",))


def register(excitation: Excitation) -> Excitation:
    """Let presets name an excitation. Raises ValueError for a kind that is taken or no name, TypeError for settings that are
    no ExcitationTable."""
    settings: Any = excitation.settings
    if not (isinstance(settings, type) and issubclass(settings, ExcitationTable)):
        raise TypeError(f"settings of the excitation {excitation.kind} must be an ExcitationTable's class, got {settings!r}")
    return EXCITATIONS.join(excitation.kind, excitation)


def settings_of(table: Any) -> type[Table]:
    """The class of what stands in [excitation] of the file. Raises ValueError where its kind is missing or unknown."""
    kind = kind_of(table, "excitation")
    return ExcitationTable if kind == "pluck" else EXCITATIONS.get(kind).settings


def as_excitation(value: Any) -> Any:
    """The [excitation] of the file as its kind's class; what is no table stays as it is."""
    return settings_of(value).model_validate(value) if isinstance(value, dict) else value
