"""Renders songs into arrays: the Python door to what `synth render` does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from synth.host import offline, parts
from synth.host.render import RenderReport, RenderSettings, render_song
from synth.midi.messages import song_from
from synth.units import db_to_gain

if TYPE_CHECKING:
    from synth.instrument.preset import Preset


@dataclass(frozen=True)
class Rendered:
    """samples: (frames, 2), full scale ±1.  stems: part → (frames, 2) before the limiter; empty unless asked for.
    report: as `synth render` gives it.
    """

    samples: np.ndarray
    rate_hz: int
    stems: dict[str, np.ndarray]
    report: RenderReport

    def __repr__(self) -> str:
        return f"Rendered({len(self.samples) / self.rate_hz:.2f} s at {self.rate_hz} Hz, {self.report.notes} notes)"


def render(
    song: Any,
    preset: str | Preset | None = None,
    *,
    channels: Mapping[int, str | Preset] | None = None,
    rate_hz: int = 44100,
    stems: bool = False,
    warn: Callable[[str], None] = lambda _: None,
    progress: offline.Progress | None = None,
    **settings: Any,
) -> Rendered:
    """The sound of a song: what `synth render` writes, as arrays.

    song        a MIDI file's name, a `mido.MidiFile`, mido's messages with times in seconds since the one before, or an
                EVENT array with frames of rate_hz
    preset      by name, by file or itself, for all channels but percussion; None: by General MIDI program
    channels    channel 1 … 16 → its preset, "none" to leave it out
    settings    the rest of `RenderSettings`: quality, tail, start_s, end_s, gain_db, normalize_dbfs, limiter, transpose
                ({channel 0 … 15, or None for all: semitones}), fold, fallback, seed, threads, mpe …
    warn, progress   called with each oddity, and with (seconds done, most seconds)
    Raises ValueError (MidiError, PresetError, ScalaError) and TypeError for what cannot be used.
    """
    made: dict[str, Any] = {}

    def name(chosen: str | Preset) -> str:
        if isinstance(chosen, str):
            return chosen
        label = chosen.name
        while made.get(label, chosen) is not chosen:
            label += "'"
        made[label] = chosen
        return label

    by_channel = {}
    for channel, chosen in (channels or {}).items():
        if not (isinstance(channel, int) and 1 <= channel <= 16):
            raise ValueError(f"channels must be 1 to 16, got {channel!r}")
        by_channel[channel - 1] = name(chosen)
    unknown = sorted(set(settings) - set(RenderSettings.__dataclass_fields__) | {"midi", "output"} & set(settings))
    if unknown:
        raise TypeError(f"render() has no setting {unknown[0]!r}")
    title, music = song_from(song, rate_hz, bool(settings.get("mpe", False)))
    wanted = RenderSettings(
        title, "the array", None if preset is None else name(preset), by_channel, rate_hz=rate_hz, **settings
    )
    kept: list[_Arrays] = []

    def outputs(settings: RenderSettings, cast: Sequence[parts.Part], span: offline.Span) -> _Arrays:
        kept.append(_Arrays(settings, [part.label for part in cast] if stems else []))
        return kept[0]

    report = render_song(music, wanted, outputs, presets=made, warn=warn, progress=progress)
    report.output = None
    return Rendered(kept[0].mix.samples, rate_hz, {k: sink.samples for k, sink in kept[0].by_label.items()}, report)


class _Kept:
    """A sink that keeps what it is given."""

    def __init__(self) -> None:
        self._blocks: list[np.ndarray] = []
        self.samples = np.zeros((0, 2))

    def write(self, block: np.ndarray) -> None:
        self._blocks.append(block.copy())

    def join(self, gain: float) -> None:
        if self._blocks:
            self.samples = np.concatenate(self._blocks) * gain
        self._blocks = []


class _Arrays:
    """The outputs of `render_song` as arrays."""

    clipped = 0
    clipped_in_stems = 0

    def __init__(self, settings: RenderSettings, labels: Sequence[str]) -> None:
        self._target = settings.normalize_dbfs
        self.mix = _Kept()
        self.by_label = {label: _Kept() for label in labels}
        self.stems = list(self.by_label.values())
        self.stem_paths: list[str] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def finish(self, peak: float) -> float:
        gain = 1.0 if self._target is None or peak <= 0.0 else db_to_gain(self._target) / peak
        for sink in [self.mix, *self.stems]:
            sink.join(gain)
        return gain
