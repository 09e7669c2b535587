"""What plays and how, in a render and in a session alike."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from synth.engine.engine_settings import EngineOptions, EngineSettings
from synth.host import parts, scala

if TYPE_CHECKING:
    from synth.engine.parameters import Binding
    from synth.instrument.preset import Preset


@dataclass(frozen=True, kw_only=True)
class PlayingSettings(EngineSettings):
    """Which presets play, what is changed of them, and the settings of the engine.

    preset: for all channels but percussion (None: the programs choose).
    channel_presets: channel 0…15 → preset or 'none', before `preset`.
    made: presets that the program has made, by the names that stand for them in `preset` and `channel_presets`.
    settings: [(preset or None for all, dotted key, value)] changed in the presets before they are used.
    variation: how much strokes of a preset with a human hand vary, as a share of what it says.
    tuning, keyboard: Scala files.
    bindings: controller → live parameters it sets, see `bindings.parse_bindings`.
    gm: whether programs choose by the whole table of General MIDI also in a take of a session where they did not.
    only_strings: programs that are no plucked or struck strings are left out.
    bit_depth: of files that are written.
    """

    preset: str | None = None
    channel_presets: dict[int, str] = field(default_factory=dict)
    made: Mapping[str, Preset] = field(default_factory=dict)
    settings: Sequence[tuple[str | None, str, str]] = ()
    variation: float = 1.0
    tuning: str | None = None
    keyboard: str | None = None
    bindings: dict[int, list[Binding]] = field(default_factory=dict)
    gm: bool = False
    only_strings: bool = False
    bit_depth: str = "24"

    def choosing(self, *, gm: bool, switching: bool, of_rest: frozenset[int] = frozenset()) -> parts.Choice:
        """Which presets channels are to have, see `parts.Choice`."""
        return parts.Choice(self.preset, self.channel_presets, gm, self.only_strings, switching, of_rest)

    def presets(self, names: Iterable[str]) -> dict[str, Preset]:
        """The presets of these names, changed and varied. Raises ValueError."""
        return parts.varied(parts.load_presets(list(names), self.settings, self.made), self.variation)

    def frequencies(self) -> tuple[np.ndarray | None, np.ndarray | None]:
        """(128,) frequencies of the keys, and whether each is silent; None, None: no tuning is given. Raises ScalaError."""
        if self.tuning is None and self.keyboard is None:
            return None, None
        return scala.playable_frequencies(self.tuning, self.keyboard)


class PlayingOptions(EngineOptions, total=False):
    """Fields of PlayingSettings as arguments by name, for type checkers."""

    settings: Sequence[tuple[str | None, str, str]]
    variation: float
    tuning: str | None
    keyboard: str | None
    bindings: dict[int, list[Binding]]
    gm: bool
    only_strings: bool
    bit_depth: str
