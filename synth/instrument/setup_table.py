"""The setup of an instrument as a luthier measures it: actions, relief, fret heights, radii, strings by name."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from synth.instrument.fields import each_within
from synth.instrument.table import Table
from synth.instrument.wires import wire

#: fret over which the action is measured
ACTION_FRET = 12
#: frets that a neck has at most
MOST_FRETS = 36
#: height that a crown may have over the board [mm]
LOWEST_CROWN_MM, HIGHEST_CROWN_MM = 0.1, 5.0


def fault(path: str, what: str) -> PydanticCustomError:
    """What is wrong with the key at a path of the file, wherever it is found out."""
    return PydanticCustomError("elsewhere", "{what}", {"path": path, "what": what})


def _known(names: tuple[str, ...]) -> tuple[str, ...]:
    for name in names:
        wire(name)
    return names


class Setup(Table):
    """What is measured with the instrument in the hand. Clearances are those of the open string at rest."""

    #: between string and fret 12, or board half way along the string: under the lowest string and the highest
    action_bass_mm: float | None = Field(None, gt=0.0, le=20.0)
    action_treble_mm: float | None = Field(None, gt=0.0, le=20.0)
    #: hollow under a straightedge on the first and the last fret, half way; negative: a hump
    relief_mm: float = Field(0.0, ge=-2.0, le=5.0)
    #: between string and fret 1, or board at the nut
    nut_bass_mm: float = Field(0.4, gt=0.0, le=5.0)
    nut_treble_mm: float | None = Field(None, gt=0.0, le=5.0)
    #: how far the last fret has fallen below the neck's line, which the frets follow up to this one
    fall_away_mm: float = Field(0.0, ge=0.0, le=2.0)
    fall_away_fret: int = Field(12, ge=1, le=MOST_FRETS - 1)
    #: of every crown over the board
    fret_heights_mm: Annotated[tuple[float, ...], each_within(LOWEST_CROWN_MM, HIGHEST_CROWN_MM)] = Field(
        (), max_length=MOST_FRETS
    )
    #: across the strings; flat, or of the saddle like the board, where it is not given
    board_radius_mm: float | None = Field(None, ge=50.0, le=1e5)
    saddle_radius_mm: float | None = Field(None, ge=50.0, le=1e5)
    #: distance of the outer strings
    nut_spread_mm: float = Field(0.0, ge=0.0, le=100.0)
    saddle_spread_mm: float = Field(0.0, ge=0.0, le=100.0)
    #: makers' names of the strings that are played, from the lowest to the highest
    strings: Annotated[tuple[str, ...], AfterValidator(_known)] = Field((), max_length=128)

    @model_validator(mode="after")
    def _has_an_action(self) -> Setup:
        given = self.model_fields_set - {"strings"}
        if self.action_bass_mm is None and (given or not self.strings):
            beside = f" beside {sorted(given)[0]}" if given - {"action_bass_mm"} else ""
            other = "leave out all keys but strings" if self.strings else "leave [setup] out"
            raise fault(
                "setup.action_bass_mm", f"missing{beside}; give the clearance at fret 12 under the lowest string, or {other}"
            )
        return self

    @model_validator(mode="after")
    def _arches_have_a_width(self) -> Setup:
        if self.top_radius_mm != self.board_radius_mm:
            for key in ("nut_spread_mm", "saddle_spread_mm"):
                if getattr(self, key) == 0.0:
                    raise fault(
                        f"setup.{key}",
                        "must be above 0 where board_radius_mm and saddle_radius_mm differ, got 0; give the distance of the "
                        "outer strings there, or the same radius for both",
                    )
        return self

    @property
    def shapes_the_neck(self) -> bool:
        """Whether it says more than which strings there are."""
        return self.action_bass_mm is not None

    @property
    def actions_mm(self) -> tuple[float, float]:
        """Of the lowest and the highest string."""
        assert self.action_bass_mm is not None
        return self.action_bass_mm, self.action_bass_mm if self.action_treble_mm is None else self.action_treble_mm

    @property
    def nuts_mm(self) -> tuple[float, float]:
        """Clearances at fret 1 of the lowest and the highest string."""
        return self.nut_bass_mm, self.nut_bass_mm if self.nut_treble_mm is None else self.nut_treble_mm

    @property
    def top_radius_mm(self) -> float | None:
        """Of the saddle's top."""
        return self.board_radius_mm if self.saddle_radius_mm is None else self.saddle_radius_mm

    def raised(self, by_mm: float) -> Setup:
        """The same with all actions so much higher. Raises ValueError where a string would lie on a fret."""
        actions = {"action_bass_mm": self.actions_mm[0] + by_mm}
        if self.action_treble_mm is not None:
            actions["action_treble_mm"] = self.action_treble_mm + by_mm
        for key, value in actions.items():
            if not value > 0.0:
                raise ValueError(f"setup.{key} must stay above 0 mm, got {value:g}; raise the strings less far down")
        return self.model_copy(update=actions)
