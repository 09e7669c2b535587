"""FluidSynth, where it is installed: what plays the same events from recorded notes. `apt-get install fluidsynth
timgm6mb-soundfont` or the like; its library is called, not copied."""

from __future__ import annotations

import ctypes
import ctypes.util
from pathlib import Path

import numpy as np

from synth.midi.events import NOTE_OFF, NOTE_ON

#: sound fonts of General MIDI as distributions lay them down, the smallest first
FONTS = tuple(
    Path(folder) / name
    for folder in ("/usr/share/sounds/sf2", "/usr/share/soundfonts")
    for name in ("TimGM6mb.sf2", "FluidR3_GM.sf2", "default.sf2", "default-GM.sf2")
)


class NotInstalled(Exception):
    """The library or a sound font is missing."""


class FluidSynth:
    """A synthesizer without reverb and chorus that plays a program of General MIDI (from 0) on channel 0.

    Raises NotInstalled. To be closed.
    """

    def __init__(self, program: int, rate_hz: float) -> None:
        name, font = ctypes.util.find_library("fluidsynth"), next((each for each in FONTS if each.exists()), None)
        if name is None or font is None:
            raise NotInstalled("FluidSynth" if name is None else "a sound font for FluidSynth")
        self._library = ctypes.CDLL(name)
        for call in ("new_fluid_settings", "new_fluid_synth"):
            getattr(self._library, call).restype = ctypes.c_void_p
        self._settings = ctypes.c_void_p(self._library.new_fluid_settings())
        self._library.fluid_settings_setnum(self._settings, b"synth.sample-rate", ctypes.c_double(rate_hz))
        for setting in (b"synth.reverb.active", b"synth.chorus.active"):
            self._library.fluid_settings_setint(self._settings, setting, 0)
        self._synth = ctypes.c_void_p(self._library.new_fluid_synth(self._settings))
        if self._library.fluid_synth_sfload(self._synth, str(font).encode(), 1) < 0:
            self.close()
            raise NotInstalled(f"a sound font for FluidSynth that it can read, {font} is none")
        self._library.fluid_synth_program_change(self._synth, 0, program)

    def reset(self) -> None:
        """Silence."""
        self._library.fluid_synth_all_sounds_off(self._synth, -1)

    def play(self, events: np.ndarray, seconds: float, rate_hz: float, block: int) -> np.ndarray:
        """(2, frames) float32 of events, in blocks."""
        frames = round(seconds * rate_hz) // block * block
        out = np.zeros((2, frames), np.float32)
        left, right = out.ctypes.data, out.ctypes.data + out.strides[0]
        which = 0
        for at in range(0, frames, block):
            while which < events.size and events["frame"][which] < at + block:
                kind, note, velocity = (int(events[each][which]) for each in ("kind", "a", "b"))
                if kind == NOTE_ON:
                    self._library.fluid_synth_noteon(self._synth, 0, note, velocity)
                elif kind == NOTE_OFF:
                    self._library.fluid_synth_noteoff(self._synth, 0, note)
                which += 1
            self._library.fluid_synth_write_float(
                self._synth, block, ctypes.c_void_p(left), at, 1, ctypes.c_void_p(right), at, 1
            )
        return out

    def close(self) -> None:
        """End it."""
        self._library.delete_fluid_synth(self._synth)
        self._library.delete_fluid_settings(self._settings)
