"""One obstacle out of one or several recordings of a string: the contact fit from sound to numbers.

Each recording has an amplitude, a place and a draw of its own; the distance of the bridge's edge is one. The
answers of the notes are brought together by their covariances (generalised least squares); notes that contradict each
other are refused. One obstacle has one height, so that heights over amplitudes say how the amplitudes are to each other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from synth.fit.contact_dictionary import Search, contact_search
from synth.fit.contact_fit import LEAST_HALF, NoContact, NoteFit, fit_note
from synth.fit.contact_model import ContactModel
from synth.fit.contact_search import NOTES
from synth.fit.contact_space import Estimate, estimates
from synth.fit.estimate import fit_recording
from synth.fit.pitch import find_series
from synth.fit.recording import FitRefused, Progress, RecordedNote, cut_note
from synth.fit.settings import apply_settings, nearest_string, settings
from synth.instrument.compile import note_frequency, string_frequency
from synth.instrument.preset import Preset, at_note
from synth.units import cents

#: a note beside the string's pitch by less is taken as it is, by less than the other retunes the string [cents]
IN_TUNE, RETUNED = 4.0, 60.0
#: a bridge moves partials by up to so much: that is no second note [cents]
MOVED = 30.0
#: the string's own series counts with so many odd partials among the first ones
LEAST_ODD, ODD_AMONG = 3, 12
#: notes of one obstacle may differ by so many halves of their intervals
CONTRADICTION = 2.0
Recording = tuple[ArrayLike, float]


@dataclass(frozen=True)
class ContactFit:
    """What one obstacle is.

    preset, string   the preset with the linear string that was taken, and which of its strings
    model            its notes
    notes            what each recording says, in order
    values           of the obstacle: `height` over the amplitude of the first note and `distance` over length
    amplitude_m      by which the first note was drawn aside, or what was taken for it
    amplitude_known  whether it was given
    warnings         what a reader should know
    """

    preset: Preset
    string: int
    model: ContactModel
    notes: tuple[NoteFit, ...]
    values: dict[str, Estimate]
    amplitude_m: float
    amplitude_known: bool
    warnings: tuple[str, ...]

    @property
    def length_m(self) -> float:
        return self.model.string.length_m

    @property
    def ratios(self) -> list[float]:
        """Amplitude of each note over that of the first, as one height of the bridge has it."""
        first = self.notes[0].values
        return [
            first["height"].value / note.values["height"].value if note.values["height"].value > 0.0 else math.nan
            for note in self.notes
        ]


def linear_string(preset: Preset, index: int, samples: ArrayLike, rate_hz: float) -> Preset:
    """The preset with string `index` as a recorded note that touches nothing has it (`fit_recording`). Raises ValueError."""
    return apply_settings(preset, [
        (path, value) for path, value in settings(fit_recording(samples, rate_hz), preset, index)
        if path.startswith("string.")
    ])  # fmt: skip


def string_of(preset: Preset, samples: ArrayLike, rate_hz: float) -> int:
    """The number of the string whose own note lies nearest to a recorded one. Raises FitRefused where several strings could
    be meant and no pitch is found."""
    if len(preset.string) == 1:
        return 0
    return nearest_string(preset, find_series(cut_note(samples, float(rate_hz)), moved_cents=MOVED).first_partial_hz)


def tuned_model(preset: Preset, index: int, recordings: Sequence[Recording]) -> tuple[ContactModel, list[str]]:
    """The model of a string at the pitch of its recordings, and warnings. Raises FitRefused for another pitch."""
    table = preset.string[index]
    note = table.notes[0]
    wanted = note_frequency(preset, table, note, None)
    found = []
    for samples, rate_hz in recordings:
        found.append(_pitch(cut_note(samples, float(rate_hz)), wanted))
    for number, hz in enumerate(found, start=1):
        beside = cents(hz, wanted)
        if abs(beside) > RETUNED:
            which = "the note" if len(found) == 1 else f"note {number}"
            raise FitRefused(
                f"{which} must be string {index}'s, {wanted:.4g} Hz within {RETUNED:g} cents, got {hz:.4g} Hz; choose "
                "another --string, or give a note of this string that touches nothing: --open"
            )
    beside = float(np.median([cents(hz, wanted) for hz in found]))
    if abs(beside) <= IN_TUNE:
        return ContactModel.of_preset(preset, index), []
    hz = string_frequency(preset, table, note) * 2.0 ** (beside / 1200.0)
    return ContactModel.of_preset(preset, index, frequency_hz=hz), [
        f"the string is tuned by {beside:+.0f} cents, as recorded"
    ]


def _pitch(note: RecordedNote, wanted_hz: float) -> float:
    """First partial of a note [Hz]: of the series that explains it best, or, where that is another than the string's or
    none, of the string's own if that is there with odd partials too, so that it is not an octave's. Raises FitRefused."""

    refused, found = None, math.nan
    try:
        found = find_series(note, moved_cents=MOVED).first_partial_hz
        if abs(cents(found, wanted_hz)) <= RETUNED:
            return found
    except FitRefused as error:
        refused = error
    try:
        own = find_series(note, wanted_hz, moved_cents=MOVED)
        odd = np.count_nonzero(own.numbers[own.numbers <= ODD_AMONG] % 2)
        if abs(cents(own.first_partial_hz, wanted_hz)) <= RETUNED and odd >= LEAST_ODD:
            return own.first_partial_hz
    except FitRefused:
        pass
    if refused is not None:
        raise refused
    return found


def amplitude_of(preset: Preset, index: int) -> float:
    """How far a preset's hardest pluck draws a string [m]."""
    return 1e-3 * at_note(preset.pluck.displacement_mm, preset.string[index].notes[0])


def fit_contact(
    recordings: Sequence[Recording],
    preset: Preset,
    index: int,
    *,
    amplitude_m: float | None = None,
    position: float | None = None,
    notes: int = NOTES,
    progress: Progress = lambda _: True,
) -> ContactFit:
    """The obstacle that string `index` of a preset sounds over in one or several recordings, [(samples, rate)].

    amplitude_m  how far the string was drawn aside in the first one, if it is known: else what the preset's hardest pluck
                 has stands for it
    position     of the pluck as a share of the length, if it is known
    notes        of the dictionary
    progress     told how much is done (0 … 1); where it returns False, FitCancelled is raised
    Raises FitRefused (a ValueError) with the reason, of several recordings with the number of the one that it is about;
    ValueError where the preset has no such obstacle.
    """
    if not recordings:
        raise ValueError("recordings must be one or more, got none")
    if amplitude_m is not None and not (math.isfinite(amplitude_m) and 0.0 < amplitude_m < 0.05):
        raise ValueError(f"amplitude_m must lie between 0 and 0.05 m, got {amplitude_m:g}")
    if position is not None and not 0.02 <= position <= 0.5:
        raise ValueError(f"position must lie between 0.02 and 0.5 of the length, got {position:g}")
    ContactModel.of_preset(preset, index)  # that there is an obstacle to look for
    model, warnings = tuned_model(preset, index, recordings)
    amplitude = amplitude_of(preset, index) if amplitude_m is None else amplitude_m
    search = contact_search(model, amplitude, position=position, notes=notes)
    found = []
    count = len(recordings)
    for number, (samples, rate_hz) in enumerate(recordings):

        def done(share: float, begun: int = number) -> bool:
            return progress((begun + share) / count)

        try:
            found.append(fit_note(search, samples, rate_hz, progress=done))
        except NoContact as none:
            raise NoContact(f"{_numbered(number, count)}{none}", none.bound) from None
        except FitRefused as error:
            raise FitRefused(f"{_numbered(number, count)}{error}") from None
    joined = _together(search, found) if count > 1 else found
    for number, each in enumerate(joined):
        warnings += [f"{_numbered(number, count)}{words}" for words in each.warnings]
    if model.shape.points > 1:
        warnings.append("on curved bridges the search often misses: confirm this answer with a second note")
    values = {name: each for name, each in joined[0].values.items() if name in ("height", "distance")}
    return ContactFit(preset, index, model, tuple(joined), values, amplitude, amplitude_m is not None, tuple(warnings))


def _numbered(number: int, count: int) -> str:
    return "" if count == 1 else f"recording {number + 1}: "


def _together(search: Search, found: list[NoteFit]) -> list[NoteFit]:
    """The notes with one distance. Raises FitRefused where they contradict each other."""
    space = search.space
    name = "distance"
    at = space.index(name)
    variance = np.array([each.covariance[at, at] + 1e-8 for each in found])
    where = np.array([each.point[at] for each in found])
    weight = 1.0 / variance
    shared = float((weight * where).sum() / weight.sum())
    for number, each in enumerate(found):
        middle = float(np.median([other.values[name].value for other in found]))
        mine = each.values[name]
        if abs(mine.value - middle) > CONTRADICTION * mine.half + 0.05 * abs(middle):
            raise FitRefused(
                f"the recordings must be of one obstacle, got {name} {_told(mine.value)} in recording {number + 1} "
                f"and {_told(middle)} in the others; fit them one by one, or leave that one out"
            )
    joined = []
    for each in found:
        column = each.covariance[:, at]
        gain = column / (column[at] + 1e-8)
        point = np.clip(each.point + gain * (shared - each.point[at]), 0.0, 1.0)
        covariance = each.covariance - np.outer(gain, column) + np.outer(gain, gain) / float(weight.sum())
        values = estimates(space, point, covariance, LEAST_HALF)
        joined.append(replace(each, point=point, covariance=covariance, values=values, stroke=space.stroke(point)))
    return joined


def _told(value: float) -> str:
    return f"{1e3 * value:.2f} mm per m of length"
