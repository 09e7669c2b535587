"""The basses and guitars of a SoundFont: what they are by name, what the fit says, what is measured without it."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from synth.dsp import measures
from synth.fit import Fit, fit_recording
from synth.units import cents, midi_to_hz, note_to_midi
from tests.fit.soundfont import FLUID, SoundFont

BASS = [
    f"{kind} Bass {note}" for kind in ("Finger", "Picked", "Slap") for note in ("E2", "A1", "A3", "D1", "D3", "E4", "G5")
]
BASS += ["Finger Bass EO", "Finger Bass GO", "Picked Bass E0", "Picked Bass GO", "Slap Bass E0", "Slap Bass G0"]
GUITAR = [f"{kind} {note}" for kind in ("Steel", "Nylon") for note in ("E3", "A3", "D4", "G4", "B4", "E5", "A5", "B6", "E6")]
GUITAR += [f"Jazz Guitar {note}" for note in ("E3", "G3", "A3", "C4", "D4", "F#4", "G4", "Bb4", "E5", "A5", "D6", "G6")]

#: MIDI notes of the open strings; a bass sample is called by its string and fret
_OPEN = {"E": 28, "A": 33, "D": 38, "G": 43}
#: samples that are called by another note than the one they hold
_MISNAMED = {"Slap Bass A1": 35, "Steel B6": 71, "Nylon B6": 71}

#: partials of a recording that are compared, how far the fit may lie beside what is measured [cents; share of T60]
COMPARED, WITHIN_CENTS, WITHIN_T60 = 10, 3.0, 0.25


def note_of(name: str) -> int:
    """The MIDI note that a sample's name means: guitars are written an octave above their sound."""
    if name in _MISNAMED:
        return _MISNAMED[name]
    kind, _, note = name.rpartition(" ")
    if kind.endswith("Bass"):
        return _OPEN[note[0]] + int(note[1:].replace("O", "0"))
    return note_to_midi(note) - 12


@dataclass(frozen=True)
class Recorded:
    """One sample: the fit, and its first partials as `synth.dsp.measures` finds them from the note's name on: frequencies
    (10,) [Hz], and T60 (10,) [s], NaN where the level does not fall enough."""

    name: str
    fit: Fit
    frequencies_hz: np.ndarray
    t60_s: np.ndarray

    def pitched(self) -> dict[int, float]:
        """By number, of every partial that the fit has measured: the fit's answer above the measured frequency [cents]."""
        pairs = zip(self.fit.partials, self.frequencies_hz, strict=False)
        return {p.number: cents(p.hz, float(hz)) for p, hz in pairs if p.measured is not None}

    def decaying(self) -> dict[int, float]:
        """By number, of every partial whose decay the fit answers for: its T60 over the measured one, less 1."""
        pairs = zip(self.fit.partials, self.t60_s, strict=False)
        return {p.number: p.t60_s / float(t) - 1.0 for p, t in pairs if p.measured and p.measured.steady and np.isfinite(t)}

    def beside(self) -> dict[tuple[str, int], str]:
        """The partials whose frequency the measurement contradicts."""
        return {(self.name, n): f"{off:+.1f} cents" for n, off in self.pitched().items() if abs(off) > WITHIN_CENTS}

    def wrong(self) -> dict[tuple[str, int], str]:
        """The partials whose decay the fit answers for and the measurement contradicts."""
        return {
            (self.name, n): f"{self.fit.partials[n - 1].t60_s:.2f} s for {self.t60_s[n - 1]:.2f} s"
            for n, off in self.decaying().items()
            if abs(off) > WITHIN_T60
        }


@functools.cache
def font() -> SoundFont:
    return SoundFont(FLUID)


@functools.cache
def recorded(name: str) -> Recorded:
    """A sample, fitted and measured once in a run."""
    sample = font().samples[name]
    x, rate_hz = font().read(sample), sample.rate_hz
    ringing = x[int(np.argmax(np.abs(x))) + round(0.02 * rate_hz) :]
    f0_hz = float(midi_to_hz(note_of(name)))
    hz = measures.partials(ringing, rate_hz, f0_hz, COMPARED)[0]
    t60_s = measures.decay_times_s(ringing, rate_hz, hz, bandwidth_hz=0.45 * f0_hz)
    return Recorded(name, fit_recording(x, rate_hz), hz, t60_s)
