"""A string of a preset fitted to a recording."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from synth.author.views.parameters import describe
from synth.fit import Fit, fit_recording, missing, report, settings
from synth.fit.recording import read_recording
from synth.fit.settings import nearest_string
from synth.instrument.preset import Preset, StringTable


class StringChanged(ValueError):
    """The string that was fitted is no longer there."""


@dataclass(frozen=True)
class FittedString:
    """What a fit says of string number `string` of document `doc`, which was `table` (of `preset`) then.

    settings: (path, value) of the preset.
    report: what `synth.fit.report` says, `settings`, {path, label, unit, value} of each, as its control has them, `string`,
    and `nearest`, the number of the string whose own note lies nearest to the one that was found.
    """

    doc: str
    string: int
    preset: Preset
    fit: Fit
    settings: list[tuple[str, Any]]
    report: dict[str, Any]

    def settings_of(self, preset: Preset) -> list[tuple[str, Any]]:
        """The settings of the preset as it is now: those that were shown, or, where it has been changed since, those that
        follow from it. Raises StringChanged where the string there is another one, ValueError where it cannot be fitted."""
        if preset == self.preset:
            return self.settings
        if not self.string < len(preset.string) or not _same(preset.string[self.string], self.preset.string[self.string]):
            raise StringChanged("the string that was fitted has been replaced or moved since; fit the recording again")
        return settings(self.fit, preset, self.string)


def _same(one: StringTable, other: StringTable) -> bool:
    """Whether two tables are the same string of the instrument, whatever of its values has been edited."""
    return (one.name, one.notes) == (other.name, other.notes)


def fit_string(
    doc: str, data: bytes, preset: Preset, string: int | None, progress: Callable[[float], bool] = lambda _: True
) -> FittedString:
    """Fit string number `string` to the bytes of an audio file; None: the string nearest to its note. Raises ValueError with
    the reason, and FitCancelled where `progress`, told how much is done (0 … 1), returns False."""
    reason = missing()
    if reason is not None:
        raise ValueError(reason)
    found = fit_recording(*read_recording(io.BytesIO(data)), progress=progress)
    nearest = nearest_string(preset, found.first_partial_hz)
    string = nearest if string is None else string
    values = settings(found, preset, string)
    controls = {control["path"]: control for control in describe(preset)}
    rows = [
        {"path": path, "label": controls[path]["label"], "unit": controls[path]["unit"], "value": value}
        for path, value in values
    ]
    return FittedString(
        doc, string, preset, found, values, {**report(found), "settings": rows, "string": string, "nearest": nearest}
    )
