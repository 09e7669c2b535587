"""A few seconds of each preset that comes with the program, for whoever looks for one: made when it is first asked for."""

from __future__ import annotations

import threading
from collections import defaultdict
from typing import Any

from synth.author.phrases import phrase
from synth.author.voice import phrase_wav, prepared_engine
from synth.instrument.catalogue import by_family, row
from synth.instrument.preset import Preset, list_presets, playable_notes

#: how long it lasts at most [s], and how hard it is played
LONGEST_S, VELOCITY = 6.0, 80


class Samples:
    """The presets' sounds at a rate and quality, each kept once it has been made."""

    def __init__(self, rate_hz: int, quality: str) -> None:
        self._rate_hz = rate_hz
        self._quality = quality
        self._made: dict[str, bytes] = {}
        self._locks: dict[str, threading.Lock] = defaultdict(threading.Lock)
        self._lock = threading.Lock()

    def rows(self) -> list[dict[str, Any]]:
        """What is listed of each preset (`catalogue.row`), those of a family together."""
        return [row(preset) for _, members in by_family(list_presets()) for preset in members]

    def wav(self, name: str) -> bytes:
        """A WAV file of a preset. Raises FileNotFoundError for one that does not come with the program."""
        preset = next((preset for preset in list_presets() if preset.name == name), None)
        if preset is None:
            raise FileNotFoundError(f"{name}: no preset of this name comes with the program")
        with self._lock:
            lock = self._locks[name]
        with lock:  # whoever asks for the same meanwhile gets the same
            if name not in self._made:
                self._made[name] = self._make(preset)
            return self._made[name]

    def _make(self, preset: Preset) -> bytes:
        there = playable_notes(preset)
        kind = "drone" if preset.damping.ring_on else "riff" if preset.family == "bass" else "scale"
        wanted = phrase(kind, preset, there[len(there) // 4], VELOCITY, self._rate_hz)
        engine = prepared_engine(preset, wanted.notes, self._rate_hz, self._quality)
        try:
            return phrase_wav(engine, wanted, min(wanted.length_s, LONGEST_S))
        finally:
            engine.close()
