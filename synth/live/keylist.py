"""Which keys do what: one list, which the help shows and whoever acts on keys goes by."""

from __future__ import annotations

from dataclasses import dataclass

from synth.live.keycodes import ESCAPE
from synth.live.paragraph import TIE

#: a key and what it does stay on one line where they are no longer than this
_TIED = 30


@dataclass(frozen=True)
class Binding:
    """action: what the program calls it.  keys: names as keycodes.Key has them.  shown, does: how the help says it."""

    action: str
    keys: tuple[str, ...]
    shown: str
    does: str


#: what every list ends with: `help` and `quit`
ALWAYS = (
    Binding("help", ("?",), "?", "help"),
    Binding("quit", ("q", "Q", ESCAPE, "\x04"), "q Esc Ctrl-D", "end"),
)


class KeyList:
    """Bindings, of which no two have a key in common (ValueError)."""

    def __init__(self, *bindings: Binding) -> None:
        self.bindings = bindings
        self._actions: dict[str, str] = {}
        for binding in bindings:
            for key in binding.keys:
                if key in self._actions:
                    raise ValueError(f"the key {key!r} is bound to {self._actions[key]} and to {binding.action}")
                self._actions[key] = binding.action

    def action(self, key: str) -> str | None:
        """What a key does; None: nothing."""
        return self._actions.get(key)

    @property
    def help(self) -> str:
        """All of them, in one line that may be folded between them."""
        pairs = [f"{binding.shown} {binding.does}" for binding in self.bindings]
        pairs = [pair.replace(" ", TIE) if len(pair) <= _TIED else pair for pair in pairs]
        return f"keys: {'   '.join(pairs)}"
