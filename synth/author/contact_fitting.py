"""What a string of a preset touches, and where it was plucked, fitted to a recording: `synth fit --contact` on the page."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from synth.author.fitting import StringChanged
from synth.author.views.parameters import describe
from synth.fit import FitRefused, missing_for_contact
from synth.instrument.preset import Preset
from synth.units import midi_to_note

if TYPE_CHECKING:
    from synth.fit.contact_group import ContactFit

#: what is looked for of an obstacle: an edit of it leaves a fit as true as it was
_FITTED = ("jiva_um", "distance_mm", "distance_ratio", "action_12th_mm")
#: what the command line advises, in the words of the page
_WORDS = (
    (
        "choose another --string, or give a note of this string that touches nothing: --open",
        "choose another string, or tune this one",
    ),
    ("check -p and --string", "check the preset and the string"),
)


@dataclass(frozen=True)
class FittedContact:
    """What a contact fit says of string number `string` of document `doc`, of `preset`.

    settings: (path, value) of the preset.
    report: what `synth.fit.contact_report` says, `settings` as `FittedString` has them, `string`, `nearest`, `note`, and
    `contact`, one line on what the height is for.
    """

    doc: str
    string: int
    preset: Preset
    fit: ContactFit
    settings: list[tuple[str, Any]]
    report: dict[str, Any]

    def settings_of(self, preset: Preset) -> list[tuple[str, Any]]:
        """The settings of the preset as it is now: heights for the amplitude that it has now, where none was given. Raises
        StringChanged where its string or the kind of its obstacle is another."""
        if preset == self.preset:
            return self.settings
        from synth.fit.contact_group import amplitude_of
        from synth.fit.contact_report import contact_settings

        if not self.string < len(preset.string) or preset.string[self.string] != self.preset.string[self.string]:
            raise StringChanged("the string whose contact was fitted has been edited since; fit the recording again")
        if _held(preset) != _held(self.preset):
            raise StringChanged("what the string touches has been edited since; fit the recording again")
        fit = replace(self.fit, preset=preset)
        return contact_settings(fit if fit.amplitude_known else replace(fit, amplitude_m=amplitude_of(preset, self.string)))


def _held(preset: Preset) -> dict[str, Any]:
    """What a fit takes of an obstacle as it is, and of the tuning."""
    return {**preset.obstacle.model_dump(exclude=set(_FITTED)), "tuning": preset.tuning}


def fit_string_contact(
    doc: str,
    data: bytes,
    preset: Preset,
    string: int | None,
    amplitude_m: float | None = None,
    progress: Callable[[float], bool] = lambda _: True,
) -> FittedContact:
    """The contact of string number `string` in the bytes of an audio file; None: the string nearest to its note.
    amplitude_m: how far the string was drawn aside; None: unknown, what the preset's hardest pluck has stands for it. Raises
    ValueError with the reason, and FitCancelled where `progress`, told how much is done (0 … 1), returns False."""
    reason = missing_for_contact()
    if reason is not None:
        raise ValueError(reason)
    from synth.fit.contact_group import fit_contact, string_of
    from synth.fit.contact_report import contact_report, contact_settings
    from synth.fit.recording import read_recording

    samples, rate_hz = read_recording(io.BytesIO(data))
    nearest = string_of(preset, samples, rate_hz)
    string = nearest if string is None else string
    try:
        found = fit_contact([(samples, rate_hz)], preset, string, amplitude_m=amplitude_m, progress=progress)
    except FitRefused as refused:
        raise FitRefused(_words(str(refused))) from None
    values = contact_settings(found)
    controls = {control["path"]: control for control in describe(preset)}
    rows = [
        {"path": path, "label": controls[path]["label"], "unit": controls[path]["unit"], "value": value}
        for path, value in values
    ]
    report = {
        **contact_report(found),
        "contact": _amplitude_words(found),
        "settings": rows,
        "string": string,
        "nearest": nearest,
        "note": midi_to_note(preset.string[nearest].notes[0]),
    }
    return FittedContact(doc, string, preset, found, values, report)


def _words(refused: str) -> str:
    for there, here in _WORDS:
        refused = refused.replace(there, here)
    return re.sub(r"string (\d+)(?='s,)", lambda found: f"string {int(found[1]) + 1}", refused)  # the page counts from 1


def _amplitude_words(fit: ContactFit) -> str:
    """On what the height is for, in a sentence; over frets there is none."""
    if "height" not in fit.values:
        return ""
    whose = "as you entered" if fit.amplitude_known else "the preset's hardest pluck"
    amplitude = f"{1e3 * fit.amplitude_m:.3g} mm"
    return f"A recording of unknown gain gives only height over amplitude; this height is for {amplitude}, {whose}."
