"""A SoundFont as FluidSynth's library plays it, offline: events in, frames out, without a room (no reverb, no chorus).

FluidSynth computes blocks of BLOCK frames, and an event acts from the next block on. How the stream is cut into pieces makes
no difference.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from synth.host.parts import PERCUSSION
from synth.midi.events import BEND, CONTROL, KEY_PRESSURE, NOTE_OFF, NOTE_ON, PRESSURE, PROGRAM
from synth.midi.song import PERCUSSION_CHANNEL

#: frames that FluidSynth computes at once
BLOCK = 64
#: bank of the percussion in SoundFonts
_PERCUSSION_BANK = 128
_CHANNELS = 16
#: FluidSynth's levels of messages, from panic to debug: it prints none of them
_LOG_LEVELS = range(5)
_SETTINGS: dict[str, int] = {"synth.reverb.active": 0, "synth.chorus.active": 0, "synth.polyphony": 1024}


def _library() -> Any:
    """The module of pyfluidsynth. Raises ValueError, which says what to install."""
    try:
        import fluidsynth
    except ModuleNotFoundError:
        raise ValueError("--rest needs pyfluidsynth: pip install 'jawari[rest]'") from None
    except (ImportError, OSError) as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise ValueError(
            f"--rest needs FluidSynth's library ({reason}): install it (Debian: apt-get install libfluidsynth3; macOS: brew "
            "install fluid-synth)"
        ) from None
    if not hasattr(fluidsynth, "cfunc"):
        raise ValueError(
            f"--rest needs pyfluidsynth, and {fluidsynth.__file__} is another package: pip uninstall fluidsynth, then pip "
            "install --force-reinstall pyfluidsynth"
        )
    return fluidsynth


def _check(path: str) -> None:
    """Raises OSError and ValueError where a file is not there, is no SoundFont, or ends before its end."""
    with open(path, "rb") as file:
        head = file.read(12)
        size = os.fstat(file.fileno()).st_size
    if head[:4] != b"RIFF" or head[8:] != b"sfbk":
        raise ValueError(f"{path}: not a SoundFont; give a .sf2 or .sf3 file")
    whole = 8 + int.from_bytes(head[4:8], "little")
    if size < whole:
        raise ValueError(f"{path}: the SoundFont is cut off ({size} of {whole} bytes); get a complete copy of it")


@contextmanager
def _quiet() -> Iterator[None]:
    """Keeps off standard error what C libraries write there; the error that is raised says it in one line."""
    sys.stderr.flush()
    before = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)
        os.close(nowhere)


class SoundFont:
    """A SoundFont file, loaded for one rate; `close` frees it. Raises ValueError and OSError, which name file or library."""

    def __init__(self, path: str, rate_hz: int) -> None:
        if Path(path).is_dir():
            raise IsADirectoryError(f"{path}: is a directory; --rest needs a SoundFont, a .sf2 or .sf3 file")
        _check(path)
        self.path = path
        self._made: Any = None
        self._library = library = _library()
        void, number = ctypes.c_void_p, ctypes.c_int
        log = library.cfunc("fluid_set_log_function", void, ("level", number, 1), ("fun", void, 1), ("data", void, 1))
        for level in _LOG_LEVELS:
            log(level, None, None)
        side = (("out", void), ("off", number), ("incr", number))
        sides = [(f"{letter}{what}", kind, 1) for letter in "lr" for what, kind in side]
        self._write = library.cfunc("fluid_synth_write_float", number, ("synth", void, 1), ("len", number, 1), *sides)
        channel = ("synth", void, 1), ("chan", number, 1)
        self._pressure = library.cfunc("fluid_synth_channel_pressure", number, *channel, ("val", number, 1))
        self._key_pressure = library.cfunc(
            "fluid_synth_key_pressure", number, *channel, ("key", number, 1), ("val", number, 1)
        )
        self._made = library.Synth(1.0, rate_hz, _CHANNELS, **_SETTINGS)
        with _quiet():
            self._id = library.fluid_synth_sfload(self._made.synth, os.fsencode(path), 1)
        if self._id < 0:
            self.close()
            raise ValueError(f"{path}: FluidSynth cannot read this SoundFont; give another, or a new copy of it")

    def programs(self) -> frozenset[int]:
        """The programs (0…127) that it has, and PERCUSSION where it has drums."""
        banks = [(program, 0, program) for program in range(128)] + [(PERCUSSION, _PERCUSSION_BANK, 0)]
        return frozenset(each for each, bank, program in banks if self._made.sfpreset_name(self._id, bank, program))

    def send(self, kind: int, channel: int, a: int, b: int) -> None:
        """Gives it an event of a kind of `midi.events`, which acts from the next block on."""
        synth = self._made
        if kind == NOTE_ON and b > 0:
            synth.noteon(channel, a, b)
        elif kind in (NOTE_ON, NOTE_OFF):
            synth.noteoff(channel, a)
        elif kind == CONTROL:
            synth.cc(channel, a, b)
        elif kind == BEND:
            synth.pitch_bend(channel, a)
        elif kind == PROGRAM:
            synth.program_change(channel, a)
        elif kind == PRESSURE:
            self._pressure(synth.synth, channel, b)
        elif kind == KEY_PRESSURE:
            self._key_pressure(synth.synth, channel, a, b)

    def tune(self, note_hz: np.ndarray) -> None:
        """Tunes all channels but the percussion to (128,) frequencies, until `reset`."""
        cents = 6900.0 + 1200.0 * np.log2(np.asarray(note_hz, np.float64) / 440.0)
        synth, library = self._made.synth, self._library
        library.fluid_synth_activate_key_tuning(synth, 0, 0, b"scale", (ctypes.c_double * 128)(*cents), 0)
        for channel in range(_CHANNELS):
            if channel != PERCUSSION_CHANNEL:
                library.fluid_synth_activate_tuning(synth, channel, 0, 0, 0)

    def reset(self) -> None:
        """Silence, and every channel as at first. What was written before must have been whole blocks."""
        self._made.system_reset()

    def write(self, out: np.ndarray) -> None:
        """Overwrites (frames, 2) contiguous float32 with its next frames."""
        assert out.dtype == np.float32 and out.flags.c_contiguous
        place = out.ctypes.data
        self._write(self._made.synth, len(out), place, 0, 2, place, 1, 2)

    def close(self) -> None:
        made, self._made = self._made, None
        if made is not None:
            made.delete()
