"""What a plugin says of itself: who it is, its presets, their live parameters and their setup.

The same for the tables of a bank (`bankfile`) and for what stands beside a plugin (`turtle`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from synth.engine import layout
from synth.engine.parameters import Parameter, parameters_of
from synth.instrument.preset import NAME_PATTERN, Preset, playable_range
from synth.plugin.setup import SetupNumber, setup_of

#: of a preset's title, as many as a bank holds
TITLE_BYTES = 95


@dataclass(frozen=True)
class DescribedPreset:
    """A preset: id for machines, name and description (one line) for people, and the MIDI notes that it plays."""

    id: str
    name: str
    description: str
    lowest_note: int
    highest_note: int


@dataclass(frozen=True)
class OwnParameter:
    """A parameter that is no preset's. curve: as of `layout.PARAMETER_CURVES`; texts: what its values 0, 1, … are called;
    whole: whole numbers, as those with texts are anyway."""

    id: str
    name: str
    unit: str
    minimum: float
    maximum: float
    default: float
    curve: int
    texts: tuple[str, ...] = ()
    whole: bool = False

    @property
    def stepped(self) -> bool:
        return self.whole or bool(self.texts)


@dataclass(frozen=True)
class Description:
    """id, name: of all together, of one preset alone its own.  parameters: live ones, those of the first preset first;
    setup: numbers that are compiled in, likewise; own: parameters that are no preset's (of a drone)."""

    id: str
    name: str
    presets: tuple[DescribedPreset, ...]
    parameters: tuple[Parameter, ...]
    setup: tuple[SetupNumber, ...]
    own: tuple[OwnParameter, ...] = ()


def describe(presets: Sequence[Preset], name: str | None = None, own: Sequence[OwnParameter] = ()) -> Description:
    """Presets in one plugin, called `name` (as presets are: small letters, digits, hyphens); one alone has its own name.
    own: parameters of the drone that plays on the only one, and tunes it.

    Raises ValueError for no preset, more than 128 (MIDI programs), two of one name, and names that cannot be.
    """
    if not 1 <= len(presets) <= 128:
        raise ValueError(f"a plugin holds 1 to 128 presets, got {len(presets)}")
    names = [preset.name for preset in presets]
    if twice := sorted({each for each in names if names.count(each) > 1}):
        raise ValueError(f"two of the presets are called {twice[0]!r}; give each a name of its own in its file")
    if name is None:
        name = names[0] if len(names) == 1 else "collection"
    if not NAME_PATTERN.fullmatch(name):
        raise ValueError(
            f"a plugin's name must consist of lower-case letters, digits and hyphens (at most 64), got {name!r}"
        )
    described = tuple(
        DescribedPreset(preset.name, title, _one_line(preset.description), *playable_range(preset))
        for preset, title in zip(presets, _titles(presets), strict=True)
    )
    title = described[0].name if len(described) == 1 and name == names[0] else name
    parameters = tuple(parameter for part, preset in enumerate(presets) for parameter in parameters_of(part, preset))
    setup = tuple(number for part, preset in enumerate(presets) for number in setup_of(part, preset, bool(own)))
    return Description(name, title, described, parameters, setup, tuple(own))


def curve_of(parameter: Parameter | SetupNumber) -> int:
    """How a knob best runs through its range: LINEAR, RATIO or SQUARE of `engine.layout`."""
    return parameter.curve if isinstance(parameter, SetupNumber) else layout.PARAMETER_CURVES[parameter.index]


def _titles(presets: Sequence[Preset]) -> list[str]:
    """Titles by which people and hosts tell presets apart: a copy of a preset has its title, to which its name is added."""
    titles: list[str] = []
    for preset in presets:
        own = title = _cut(preset.title or preset.name, TITLE_BYTES)
        added = 0
        while title.lower() in (each.lower() for each in titles):
            added += 1
            behind = f" ({preset.name})" if added == 1 else f" ({preset.name} {added})"
            title = _cut(own, TITLE_BYTES - len(behind)) + behind
        titles.append(title)
    return titles


def _cut(text: str, room: int) -> str:
    return text.encode()[:room].decode(errors="ignore")


def _one_line(text: str) -> str:
    return " ".join(text.split())
