"""Renders songs into arrays: the Python door to what `synth render` does."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Self, Unpack, cast

import numpy as np

from synth.host import offline, parts
from synth.host.batch import Note
from synth.host.compass import unplayed_lines
from synth.host.notelist import as_played, is_phrase, phrase_of
from synth.host.playing_settings import PlayingOptions
from synth.host.render import RenderSettings, render_song
from synth.host.soundclip import Sound
from synth.midi.messages import song_from
from synth.units import db_to_gain

if TYPE_CHECKING:
    import mido

    from synth.instrument.preset import Preset


#: the name of `Sound` up to version 0.11
Rendered = Sound


class RenderOptions(PlayingOptions, total=False):
    """What else `render` may be given by name: fields of `RenderSettings`."""

    block: int
    normalize_dbfs: float | None
    tail: float | str | None
    container: str | None
    start_s: float
    end_s: float | None
    transpose: dict[int | None, int]
    fold: bool | None
    fallback: str | None
    rest: str | None


def render(
    song: str | os.PathLike[str] | mido.MidiFile | np.ndarray | Note | Iterable[Any],
    preset: str | os.PathLike[str] | Preset | None = None,
    *,
    rate_hz: int = 44100,
    channels: Mapping[int, str | os.PathLike[str] | Preset] | None = None,
    stems: bool = False,
    warn: Callable[[str], None] | None = None,
    progress: offline.Progress | None = None,
    **settings: Unpack[RenderOptions],
) -> Sound:
    """The sound of a song or of a few notes: what `synth render` writes, as an array with what is to be said of it.

    Parameters
    ----------
    song : str, path, mido.MidiFile, array, Note or iterable
        A MIDI file's name, a `mido.MidiFile`, mido's messages with times in seconds since the one before, an EVENT array
        with frames of `rate_hz`, or a phrase: a `Note`, or a list of them or of (note, velocity[, seconds[, start_s]]).
        Notes of a phrase follow each other unless they say when they begin; those with a preset or an articulation of their
        own are parts of their own.
    preset : str, path or Preset, optional
        By name, by file or itself, for all channels but percussion, and for notes that name none; None: by General MIDI
        program.
    rate_hz : int
        Of the sound [Hz].
    channels : dict, optional
        Of a song: channel 1 … 16 → its preset, "none" to leave it out.
    stems : bool
        Whether each part is wanted alone, too.
    warn : callable, optional
        Called with each oddity, a line of text. Notes that no string plays are one; without `warn` they are told as a Python
        warning (UserWarning), and all else is in the report.
    progress : callable, optional
        Called with (seconds done, most seconds).
    **settings
        Fields of `EngineSettings` (quality, gain_db, limiter, polyphony, threads, mpe, seed, …) and the rest of
        `synth.host.render.RenderSettings`: tail, start_s, end_s [s], normalize_dbfs, variation, tuning, keyboard, transpose
        ({channel 0 … 15, or None for all: semitones}), fold, fallback, gm, only_strings, rest, bindings, settings.

    Returns
    -------
    Sound
        (frames, 2) samples, full scale ±1, with their rate, stems and report.

    Raises
    ------
    ValueError
        For what cannot be used; MidiError, PresetError and ScalaError are such.
    TypeError
        For arguments of another kind.

    Examples
    --------
    >>> import synth
    >>> synth.render([(48, 90, 0.2), (43, 80, 0.2)], "tanpura", quality="draft", tail=0.1)
    <Sound: 0.50 s at 44100 Hz, peak ... dBFS, 2 notes>
    """
    from synth.instrument.preset import Preset

    made: dict[str, Any] = {}

    def name(chosen: str | os.PathLike[str] | Preset) -> str:
        if isinstance(chosen, str | os.PathLike):
            return os.fspath(chosen)
        if not isinstance(chosen, Preset):
            raise TypeError(f"a preset is a name, a file or a Preset, got {type(chosen).__name__} {chosen!r:.60}")
        label = chosen.name
        while made.get(label, chosen) is not chosen:
            label += "'"
        made[label] = chosen
        return label

    if isinstance(song, Iterator):
        song = list(song)
    by_channel = {}
    for channel, chosen in (channels or {}).items():
        if not (isinstance(channel, int) and 1 <= channel <= 16):
            raise ValueError(f"channels must be 1 to 16, got {channel!r}")
        by_channel[channel - 1] = name(chosen)
    unknown = sorted(set(settings) - set(RenderOptions.__annotations__))
    if unknown:
        raise TypeError(f"render() has no setting {unknown[0]!r}")
    mpe = bool(settings.get("mpe", False))
    if is_phrase(song):
        if channels:
            raise ValueError("channels apply to a song only; in a phrase, give each note its preset")
        phrase = phrase_of(cast("Note | Sequence[Any]", song), rate_hz)
        for channel, (own, articulation) in phrase.voices.items():
            if articulation:
                found = _loaded(preset if own is None else own, articulation)
                by_channel[channel] = name(as_played(found, articulation))
            elif own is not None:
                by_channel[channel] = name(own)
        title, music = "the phrase", phrase.song(rate_hz, mpe)
    else:
        title, music = song_from(song, rate_hz, mpe)
    wanted = RenderSettings(
        title,
        "the array",
        preset=None if preset is None else name(preset),
        channel_presets=by_channel,
        made=made,
        rate_hz=rate_hz,
        **settings,
    )
    kept: list[_Arrays] = []

    def outputs(settings: RenderSettings, labels: Sequence[str], span: offline.Span) -> _Arrays:
        kept.append(_Arrays(settings, labels if stems else []))
        return kept[0]

    report = render_song(music, wanted, outputs, warn=warn or (lambda text: None), progress=progress)
    report.output = None
    for text in unplayed_lines(report.unplayed, report.notes):
        report.warnings.append(text)
        if warn is not None:
            warn(text)
        else:
            warnings.warn(text, stacklevel=2)
    return Sound(kept[0].mix.samples, rate_hz, {k: sink.samples for k, sink in kept[0].by_label.items()}, report)


def _loaded(preset: str | os.PathLike[str] | Preset | None, articulation: str) -> Preset:
    """The preset whose articulation a note asks for."""
    if preset is None:
        raise ValueError(f"articulation {articulation!r} needs a preset: give one for the note, or one for all notes")
    if not isinstance(preset, str | os.PathLike):
        return preset
    named = os.fspath(preset)
    return parts.load_presets([named], ())[named]


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
    stems_lowered_db = 0.0
    silent_stems: Sequence[str] = ()

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
