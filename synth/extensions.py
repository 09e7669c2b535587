"""What other modules may add, by name: effects, excitations, contact laws.

A module joins by itself when it is imported. One of another distribution is found by its entry point in the group, and
imported when a name is asked for that nobody knows yet.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Sequence
from importlib.metadata import entry_points
from typing import Generic, TypeVar

from synth.spelling import perhaps

#: what extensions of a sort are
Thing = TypeVar("Thing")


class Extensions(Generic[Thing]):
    """Those of one sort: `group` of the entry points, `noun` with its article ("an effect"), names that are `taken`."""

    def __init__(self, group: str, noun: str, taken: Sequence[str] = ()) -> None:
        self.group, self.noun, self._taken = group, noun, tuple(taken)
        self.known: dict[str, Thing] = {}
        self._looked: set[str] = set()
        self._lock = threading.RLock()

    def join(self, name: str, thing: Thing) -> Thing:
        """Add one. Raises ValueError for a name that is taken or none."""
        if not re.fullmatch(r"[a-z][a-z0-9-]{0,63}", name):
            raise ValueError(f"the name of {self.noun} must be lower-case letters, digits and hyphens, got {name!r}")
        if name in self._taken or self.known.setdefault(name, thing) != thing:
            raise ValueError(f"there is {self.noun} {name!r} already; choose another name")
        return thing

    def find(self, name: str) -> Thing | None:
        """The one of that name. Raises ValueError where the installed one cannot be imported."""
        with self._lock:
            if name not in self.known and name not in self._taken and name not in self._looked:
                for entry in entry_points(group=self.group, name=name):
                    try:
                        entry.load()
                    except Exception as error:
                        raise ValueError(
                            f"{self.noun} that is installed, {entry.name} of {entry.value}, cannot be imported: {error}"
                        ) from error
                self._looked.add(name)
            return self.known.get(name)

    @property
    def names(self) -> list[str]:
        """Of all there are: the program's own, those that are here, those that are installed."""
        installed = {entry.name for entry in entry_points(group=self.group)}
        return [*self._taken, *sorted(installed | set(self.known))]

    def get(self, name: str) -> Thing:
        """The one of that name. Raises ValueError, which names those there are, for another."""
        found = self.find(name)
        if found is None:
            names = self.names
            known = ", ".join(names) or "none is installed"
            raise ValueError(f"{self.noun} named {name!r} is not known{perhaps(name, names)}; known: {known}")
        return found
