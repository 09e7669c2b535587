"""A fitted string as values of a preset: which fields make the preset's string sound with the fit's partials.

Length, weight and diameter stay the preset's: a recording does not tell them. Tension follows from the pitch, bending
stiffness from B, the two material losses from the decay rates less what air and nut take already. Where the preset's law
still misses the first partials (a nut that moves them, a body that takes its share), the partials are written as measured.
The place of plucking is written only where nothing else can have made the comb of levels.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from synth.fit.estimate import JUDGED, LAW_CENTS, LAW_T60, Fit
from synth.fit.pluck import CLEAR_DB
from synth.instrument.compile import make_string, string_frequency
from synth.instrument.preset import Preset, StringTable, at_note, validate_preset
from synth.physics.modes import decay_rates, modal_frequencies, model_decay_rates
from synth.physics.string import String
from synth.units import LN_1000, cents, hz_to_midi, midi_to_note

#: how many partials are written as measured, where they are
MOST_MEASURED = 24
# Fields whose value at the string's note is written out when that note changes, so that the string stays the same.
_ANCHORED = (
    "length_m",
    "diameter_mm",
    "linear_density_g_m",
    "density_kg_m3",
    "core_diameter_mm",
    "winding_diameter_mm",
    "youngs_modulus_gpa",
    "inharmonicity",
    "viscoelastic_loss",
    "thermoelastic_q_inverse",
    "gain_db",
)


def nearest_string(preset: Preset, frequency_hz: float) -> int:
    """The number of the string whose open note, or one of whose notes, lies nearest; among equals the first."""
    note = hz_to_midi(frequency_hz, preset.tuning.a4_hz) - preset.tuning.offset_cents / 100.0
    distances = [max(table.notes[0] - note, note - table.notes[1], 0.0) for table in preset.string]
    return distances.index(min(distances))


def settings(fit: Fit, preset: Preset, string_index: int) -> list[tuple[str, Any]]:
    """[(path, value)], in order, that make string `string_index` (of the file, from 0) the fitted one.

    value None takes the field out. A string of one note is retuned to the recording; one table for many notes keeps its
    notes and gets B and losses only. Raises ValueError for a string that is not there, or where the preset would not be
    valid.
    """
    if not 0 <= string_index < len(preset.string):
        raise ValueError(f"string must lie between 0 and {len(preset.string) - 1}, got {string_index}")
    return _Filling(fit, preset, string_index).found


def apply_settings(preset: Preset, found: list[tuple[str, Any]]) -> Preset:
    """The preset with all of them at once. Raises PresetError."""
    data = preset.model_dump(exclude_unset=True)
    for path, value in found:
        *way, last = path.split(".")
        place: Any = data
        for part in way:
            if part.isdecimal():
                place = place[int(part)]
            else:
                child = place.get(part, {})
                place[part] = [dict(item) for item in child] if isinstance(child, list | tuple) else dict(child)
                place = place[part]
        if value is None:
            place.pop(last, None)
        else:
            place[last] = value
    return validate_preset(data, f"{preset.name} with the fit").with_measured(preset.measured)


class _Filling:
    def __init__(self, fit: Fit, preset: Preset, index: int) -> None:
        self.fit, self.preset, self.index = fit, preset, index
        self.found: list[tuple[str, Any]] = []
        table = preset.string[index]
        self.one_note = table.notes[0] == table.notes[1]
        self.note = self._retune(table)
        self._stiffen(self._string())
        self._lose(self._string())
        self._write_measured(self._string())
        self._pluck()

    def _set(self, field: str, value: Any) -> None:
        self.found.append((f"string.{self.index}.{field}", value))

    def _string(self) -> String:
        """The string as it is with what has been found so far."""
        preset = apply_settings(self.preset, self.found)
        table = preset.string[self.index]
        return make_string(preset, table, self.note, string_frequency(preset, table, self.note))

    def _retune(self, table: StringTable) -> int:
        """The MIDI note of the recording; a string of one note gets it, and the cents that are left."""
        tuning = self.preset.tuning
        pitch = hz_to_midi(self.fit.first_partial_hz, tuning.a4_hz) - tuning.offset_cents / 100.0
        if not self.one_note:
            note = round(pitch - table.cents / 100.0)
            if not table.notes[0] <= note <= table.notes[1]:
                low, high = (midi_to_note(n) for n in table.notes)
                raise ValueError(
                    f"the recording's note must lie in the string's {low}-{high}, got {self.fit.first_partial_hz:.4g} Hz; "
                    "choose another string"
                )
            return note
        note = round(pitch)
        if not 0 <= note <= 127:
            raise ValueError(f"the recording's note must be one of MIDI's, got {self.fit.first_partial_hz:.4g} Hz")
        if note != table.notes[0]:
            self._set("notes", midi_to_note(note))
            for field in _ANCHORED:
                value = getattr(table, field)
                if isinstance(value, dict):
                    self._set(field, at_note(value, table.notes[0]))
        self._set("cents", round(100.0 * (pitch - note), 3))
        for field in ("measured_frequencies_hz", "measured_decay_rates"):
            if getattr(table, field):
                self._set(field, None)
        return note

    def _number(self, field: str, value: float) -> None:
        """A number, or where the field has numbers at notes and the table many notes, the one at the recording's note."""
        value = float(f"{value:.6g}")
        there = getattr(self.preset.string[self.index], field)
        if isinstance(there, dict) and not self.one_note:
            anchors = {midi_to_note(note): number for note, number in there.items()}
            self._set(field, {**anchors, midi_to_note(self.note): value})
        else:
            self._set(field, value)

    def _stiffen(self, string: String) -> None:
        b = self.fit.inharmonicity
        if string.stiffness_law != "sqrt":
            self._set("stiffness_law", "sqrt")
        # The model's tension is what is left of 4L²μf² when the stiffness has had its share.
        ideal = string.linear_density_kg_m * (2.0 * string.length_m * self.fit.first_partial_hz) ** 2
        stiffness = b / (1.0 + b) * ideal * string.length_m**2 / math.pi**2
        modulus = 64.0 * stiffness / (math.pi * (string.core_diameter_m or string.diameter_m) ** 4) * 1e-9
        if self.preset.string[self.index].youngs_modulus_gpa is None:
            self._number("inharmonicity", b / (1.0 + b))
        elif modulus <= 1000.0:
            self._number("youngs_modulus_gpa", modulus)
        else:
            self._set("youngs_modulus_gpa", None)
            self._set("inharmonicity", float(f"{b / (1.0 + b):.6g}"))

    def _lose(self, string: String) -> None:
        """The two material losses ≥ 0 that bring the string nearest to the fit's decay rates, relative to them."""
        from dataclasses import replace

        from scipy.optimize import nnls

        wanted = np.array([LN_1000 / p.t60_s for p in self.fit.partials])
        n = wanted.size
        bare = model_decay_rates(replace(string, viscoelastic_loss=0.0, thermoelastic_q_inverse=0.0), n)
        viscoelastic = model_decay_rates(replace(string, viscoelastic_loss=1.0, thermoelastic_q_inverse=0.0), n) - bare
        thermoelastic = model_decay_rates(replace(string, viscoelastic_loss=0.0, thermoelastic_q_inverse=1.0), n) - bare
        terms = np.stack([viscoelastic, thermoelastic], axis=1) / wanted[:, None]
        norms = np.maximum(np.linalg.norm(terms, axis=0), 1e-300)
        loss, q_inverse = nnls(terms / norms, (wanted - bare) / wanted)[0] / norms
        self._number("viscoelastic_loss", min(loss, 0.5))
        self._number("thermoelastic_q_inverse", min(q_inverse, 0.1))

    def _write_measured(self, string: String) -> None:
        if not self.one_note:
            return
        partials = self.fit.partials[:MOST_MEASURED]
        hz = modal_frequencies(string, JUDGED) / (2.0 * math.pi)
        stretch = [cents(float(a) / float(hz[0]), p.hz / partials[0].hz) for a, p in zip(hz, partials, strict=False)]
        if max(map(abs, stretch)) > LAW_CENTS:
            self._set("measured_frequencies_hz", [float(f"{p.hz:.7g}") for p in partials])
        t60 = LN_1000 / decay_rates(string, JUDGED)
        if max(abs(float(a) / p.t60_s - 1.0) for a, p in zip(t60, partials, strict=False)) > LAW_T60:
            self._set("measured_decay_rates", [float(f"{LN_1000 / p.t60_s:.5g}") for p in partials])

    def _pluck(self) -> None:
        pluck = self.fit.pluck
        if pluck is None or not pluck.determined or pluck.spread_db > CLEAR_DB:
            return
        position = round(min(pluck.position, 0.5), 4)
        self.found.append(("pluck.position", position))
        if self.preset.pluck.position_hard is not None:
            self.found.append(("pluck.position_hard", position))
