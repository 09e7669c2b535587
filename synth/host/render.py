"""One render job: a MIDI file, presets and settings in; audio files and a report out."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Protocol, Self

import numpy as np

from synth.files.targets import Named, check_apart, is_special
from synth.host import audiofile, compass, offline, parts, rest
from synth.host.bindings import check_parts
from synth.host.compass import Arrangement, Wishes, channel_line
from synth.host.performance import Performance, counted, of_strings
from synth.host.playing_settings import PlayingSettings
from synth.host.preset_sources import sources_of_presets
from synth.host.soundfont import SoundFont
from synth.midi.events import NOTE_OFF, NOTE_ON
from synth.midi.programs import PROGRAMS
from synth.midi.song import PERCUSSION_CHANNEL, Song, read_song
from synth.solver.schemes import energy_warning
from synth.units import db_to_gain, gain_to_db, midi_to_note

if TYPE_CHECKING:
    from synth.instrument.preset import Preset

# Longer than anybody means: such a file has a broken tempo or time, and would fill the disk.
LONGEST_RENDER_S = 24 * 3600.0
#: notes that sound before the end are prepared for, and a little behind it, as filters look ahead
_LOOKAHEAD_S = 1.0
#: a stem that stays below half a step of 24 bits is silent, whatever its format
SILENT_STEM = 2.0**-24
#: stems that would clip are lowered in steps of this [dB]
STEM_STEP_DB = 0.1
SILENT_KEY = "the keyboard mapping leaves this key silent"


@dataclass(frozen=True)
class RenderSettings(PlayingSettings):
    """What to render and how; times in seconds. `threads` is 'auto' where no other number is given.

    output: file name, '-' for standard output, or None if only stems are wanted.
    rest: SoundFont file that plays programs that are no strings, and percussion, or None.
    transpose, fold, fallback: what becomes of notes before they are played, see `compass.Wishes`; fold None: those of
    presets that a program chose are folded, but in a take.
    tail: 'auto', seconds, or None: 'auto', but nothing after an explicit end.
    normalize_dbfs: peak to scale the mix to, or None. It takes the limiter's place: nothing is limited then.
    Others as in `playing_settings.PlayingSettings`: preset, channel_presets, settings, tuning, bindings, …
    """

    midi: str
    output: str | None
    _: KW_ONLY
    rate_hz: int = 44100
    block: int = 1024
    threads: int | str = "auto"
    normalize_dbfs: float | None = None
    tail: float | str | None = None
    stems: str | None = None
    container: str | None = None
    start_s: float = 0.0
    end_s: float | None = None
    transpose: dict[int | None, int] = field(default_factory=dict)
    fold: bool | None = None
    fallback: str | None = None
    rest: str | None = None

    def wishes(self, song: Song) -> Wishes:
        """What becomes of a song's notes before they are played."""
        return Wishes(self.transpose, bool(self.fold), self.fold is None and not song.take, self.fallback)

    def choice(self, song: Song, of_rest: frozenset[int] = frozenset()) -> parts.Choice:
        """Which presets the song's channels are to have, and which of the programs `of_rest` a SoundFont is to play."""
        return self.choosing(gm=self.gm or song.gm, switching=song.switching, of_rest=of_rest)


@dataclass(kw_only=True)
class Arranged:
    """Which channels of a song played what, and which did not; each field as `RenderReport` says."""

    channels: list[dict[str, Any]]
    left_out: dict[int, int]
    stand_ins: list[dict[str, Any]]
    skipped: list[dict[str, Any]]
    rest: dict[str, Any] | None

    def lines_of_programs(self) -> list[str]:
        """Of programs that are no plucked strings, for people."""
        lines = []
        if self.stand_ins:
            lines.append(f"  {compass.stand_in_line(self.stand_ins)}")
        if self.rest is not None:
            lines.append(f"  {rest.line(self.rest)}")
        if self.skipped:
            lines.append(f"  {compass.skipped_line(self.skipped)}")
        return lines


@dataclass(kw_only=True)
class RenderReport(Performance, Arranged):
    """What was rendered and how, in a sound's `report`; `as_dict` gives plain values for JSON. Notes between start and end
    count.

    Attributes
    ----------
    output, stems, silent_stems : str or None, list of str
        Files written, None for an array; stems' files; parts without a file, as they are silent.
    stems_lowered_db : float
        By how much all stems are lowered so that none clips [dB].
    rate_hz, seed : int
        As asked for [Hz].
    quality, scheme, precision : str
        As asked for; "float32" where any string has its modes so.
    length_s, prepare_s, render_s : float
        Of the sound; spent before and while rendering [s].
    peak_dbfs, realtime_factor : float or None
        Largest sample [dB], None of silence; seconds of sound per second of rendering.
    parts : list of str
        Labels of the parts, which are the names of stems.
    channels : list of dict
        A row for each channel and preset, see `compass.channel_rows`.
    notes, strings : int
        Notes asked for, and the most strings that sounded at once.
    headroom_db : float
        By how much a song of several channels is lowered [dB].
    limiter_reduction_db, normalize_gain_db : float or None
        The limiter's largest reduction [dB], None where it did not work; the gain to the level asked for [dB], None without
        one.
    clipped_samples, stolen, taken_over, silenced : int
        Samples beyond full scale; strings that yielded to others; notes that took over a string whose key was held; strings
        or parts whose motion had blown up.
    unplayed, left_out : list of dict, dict
        Rows of part, note, count and reason; channel 1 … 16 → notes of channels left out.
    stand_ins, skipped : list of dict
        Presets that play what is no plucked string (preset, names, notes), programs left out as such (channel, name, notes).
    rest : dict or None
        Of what a SoundFont plays: soundfont, gain_db, channels.
    warnings : list of str
        Oddities, a line each.
    sources : list of str
        Keys of the articles that `Sound.citation` gives, of `research.citations.ARTICLES`.

    Examples
    --------
    >>> import synth
    >>> report = synth.render([(48, 90, 0.1)], "tanpura", quality="draft", tail=0.0).report
    >>> report.notes, report.scheme, report.precision
    (1, 'exact-hold', 'float32')
    """

    stems: list[str]
    silent_stems: list[str]
    stems_lowered_db: float
    quality: str
    scheme: str
    precision: str
    length_s: float
    peak_dbfs: float | None
    realtime_factor: float | None
    render_s: float
    headroom_db: float
    normalize_gain_db: float | None
    clipped_samples: int
    warnings: list[str]
    sources: list[str]

    def lines(self) -> list[str]:
        """The closing line, and one line for every channel and preset."""
        peak = "silent" if self.peak_dbfs is None else f"peak {self.peak_dbfs:.1f} dBFS"
        speed = "" if self.realtime_factor is None else f", {self.realtime_factor:.1f}× real time"
        if self.normalize_gain_db is not None:
            limiter = f"normalized by {self.normalize_gain_db:+.1f} dB"
        elif self.limiter_reduction_db is None:
            limiter = "limiter off"
        elif self.limiter_reduction_db >= 0.05:
            limiter = f"limiter reduced peaks by up to {self.limiter_reduction_db:.1f} dB"
        else:
            limiter = "limiter not needed"
        where = self.output if self.output not in (None, "-") else ", ".join(self.stems) or "standard output"
        if self.output is None and self.silent_stems and not self.stems:
            where = "no stems"
        unplayed = f" ({self.lost} not played)" if self.lost else " (all played)" if self.notes else ""
        counts = f"{counted(self.strings, 'string')}, {counted(self.notes, 'note')}{unplayed}"
        closing = [f"{where}: {self.length_s:.1f} s, {peak}{speed}, {counts}, {limiter}"]
        details = [f"  {channel_line(row)}" for row in self.channels]
        if self.headroom_db > 0.0 and self.normalize_gain_db is None:
            details.append(f"  lowered by {self.headroom_db:.1f} dB, as several channels play; --gain raises it")
        details += self.lines_of_programs()
        silent = sum(entry["count"] for entry in self.unplayed if entry["reason"] == SILENT_KEY)
        if silent:
            which = "is on a key" if silent == 1 else "are on keys"
            details.append(f"  {silent} of the notes not played {which} that the keyboard mapping leaves silent")
        details += self.lines_of_strings()
        if self.clipped_samples:
            samples = counted(self.clipped_samples, "sample")
            details.append(f"  {samples} exceeded full scale and clipped; lower --gain or leave the limiter on")
        if self.stems_lowered_db:
            lowered = f"all stems are lowered by {self.stems_lowered_db:.1f} dB so that none clips"
            details.append(f"  {lowered}; --bit-depth float keeps their level")
        if self.silent_stems:
            verb = "is" if len(self.silent_stems) == 1 else "are"
            details.append(f"  no stem for {', '.join(self.silent_stems)}, which {verb} silent")
        return closing + details


def render_file(
    settings: RenderSettings,
    *,
    warn: Callable[[str], None] = lambda _: None,
    progress: offline.Progress | None = None,
    preparing: Callable[[int, int], None] | None = None,
) -> RenderReport:
    """Renders a MIDI file. Nothing is written under a final name unless all goes well.

    warn: called at once with each oddity.  progress: see offline.render.  preparing: called before with (strings that are
    prepared, all there are).

    Raises ValueError (MidiError, PresetError, ScalaError, …) for input that cannot be used, OSError for files
    that cannot be written.
    """
    began = time.perf_counter()
    if settings.output is None and settings.stems is None:
        raise ValueError("nothing to write; give -o OUT.wav or --stems DIR")
    check_apart(_files_read(settings), _mix_written(settings))
    song = read_song(settings.midi, settings.rate_hz, settings.mpe, settings.end_s)
    return render_song(song, settings, _Outputs, warn=warn, progress=progress, preparing=preparing, began=began)


class Outputs(Protocol):
    """Where a rendering goes: a context manager, in which `mix` and the `stems`, one a part or none, are open. `finish` sets
    the level for a mix of this peak and returns the gain; after it `stem_paths` are those of stems that are not silent,
    `silent_stems` the labels of the others, and all stems are `stems_lowered_db` below the mix."""

    stem_paths: list[str]

    @property
    def mix(self) -> audiofile.AudioSink: ...

    @property
    def stems(self) -> Sequence[audiofile.AudioSink]: ...

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: Any) -> None: ...

    def finish(self, peak: float) -> float: ...

    @property
    def clipped(self) -> int: ...

    @property
    def silent_stems(self) -> Sequence[str]: ...

    @property
    def stems_lowered_db(self) -> float: ...


def render_song(
    song: Song,
    settings: RenderSettings,
    outputs_of: Callable[[RenderSettings, Sequence[str], offline.Span], Outputs],
    *,
    warn: Callable[[str], None] = lambda _: None,
    progress: offline.Progress | None = None,
    preparing: Callable[[int, int], None] | None = None,
    began: float | None = None,
) -> RenderReport:
    """Renders a song, which `settings.midi` names, into what `outputs_of` makes of the settings, the parts' labels and the
    frames. Others as `render_file`.
    """
    began = time.perf_counter() if began is None else began
    with ExitStack() as stack:
        font = None
        if settings.rest is not None:
            if settings.only_strings:
                raise ValueError("--only-strings leaves out what --rest plays; give one of them")
            font = stack.enter_context(closing(SoundFont(settings.rest, settings.rate_hz)))
        return _render(song, settings, outputs_of, warn, progress, preparing, began, font)


def _render(
    song: Song,
    settings: RenderSettings,
    outputs_of: Callable[[RenderSettings, Sequence[str], offline.Span], Outputs],
    warn: Callable[[str], None],
    progress: offline.Progress | None,
    preparing: Callable[[int, int], None] | None,
    began: float,
    font: SoundFont | None,
) -> RenderReport:
    warnings: list[str] = []

    def note(text: str) -> None:
        warnings.append(text)
        warn(text)

    for warning in song.warnings:
        note(f"{settings.midi}: {warning}")
    span = _span(settings, song)
    casting = parts.cast(song.channels, settings.choice(song, frozenset() if font is None else font.programs()))
    # A note may begin where the song ends; of a part of a song it is no more among it.
    heard = slice(span.begin, span.end if settings.end_s is not None else np.iinfo(np.int64).max)
    left_out = _left_out(song, casting, heard)
    for channel, count in left_out.items():
        if channel - 1 not in settings.channel_presets:
            what = "percussion" if channel - 1 == PERCUSSION_CHANNEL else "no preset"
            note(f"channel {channel} ({what}) is left out: {counted(count, 'note')}; --map {channel}=PRESET plays it")
    internal_hz = settings.internal_rate_hz or 0
    risk = energy_warning(settings.scheme, settings.restitution, internal_hz, "--internal-rate", settings.rate_hz)
    if risk is not None:
        note(risk)
    note_hz, silent = settings.frequencies()
    names = [part.preset for part in casting.parts]
    if settings.fallback is not None:
        names.append(settings.fallback)
    loaded = settings.presets(names)
    played = parts.played_events(song.events, song.players, casting)
    events = song.events if played.all() else song.events[played]
    arrangement = compass.arrange(song, events, casting, loaded, settings.wishes(song), settings.mpe, settings.bindings)
    arrangement, untuned = _playable(arrangement, silent, heard)
    casting = arrangement.casting

    labels = [part.label for part in casting.parts] + ([rest.LABEL] if casting.rest else [])
    outputs = outputs_of(settings, labels, span)
    headroom_db = parts.headroom_db(song, casting)
    lowered = replace(settings, gain_db=settings.gain_db - headroom_db)
    # The limiter works on all that sounds: with a SoundFont not in the engine, but behind both.
    alone = replace(lowered, limiter=False) if casting.rest else lowered
    engine = _engine(alone, arrangement, loaded, note_hz, span) if casting.parts else _Silence()
    rest_gain_db = 0.0
    if font is not None and casting.rest:
        rest_gain_db = rest.gain_db(font, settings.rate_hz)
        if note_hz is not None:
            font.tune(note_hz)
        given = rest.events_of(song, casting.rest, settings.wishes(song).semitones, silent)
        player = rest.SoundFontPlayer(font, offline.until_end(given, span))
        engine = rest.WithRest(engine, player, db_to_gain(rest_gain_db + lowered.gain_db), limited=_limits(settings))
    engine.prepare(settings.rate_hz, settings.block, preparing)
    prepared_s = time.perf_counter() - began

    with closing(engine), outputs:
        rendering = offline.render(
            engine,
            arrangement.events,
            span,
            settings.rate_hz,
            outputs.mix,
            outputs.stems,
            block=settings.block,
            progress=progress,
        )
        gain = outputs.finish(rendering.peak)
    told = engine.report()
    length_s = rendering.frames / settings.rate_hz
    peak = rendering.peak * gain
    if told.unsolved_contacts:
        steps = counted(told.unsolved_contacts, "step")
        note(f"in {steps} the contact forces were not solved exactly; please report this")
    known = parts.MELODY_PRESET if settings.fallback is None else None
    rows = compass.channel_rows(arrangement, loaded, heard, known)
    return RenderReport(
        output=settings.output,
        stems=outputs.stem_paths,
        silent_stems=list(outputs.silent_stems),
        stems_lowered_db=outputs.stems_lowered_db,
        rate_hz=settings.rate_hz,
        quality=settings.quality,
        scheme=settings.scheme,
        precision="float32" if engine.has_single else "float64",
        seed=settings.seed,
        length_s=length_s,
        peak_dbfs=gain_to_db(peak) if peak > 0.0 else None,
        realtime_factor=length_s / rendering.wall_s if length_s > 0.0 else None,
        prepare_s=prepared_s,
        render_s=rendering.wall_s,
        parts=labels,
        channels=rows,
        notes=sum(row["notes"] for row in rows) + sum(entry["count"] for entry in untuned),
        **of_strings(told),
        headroom_db=headroom_db,
        limiter_reduction_db=float(told.limiter_reduction_db) if _limits(settings) else None,
        normalize_gain_db=gain_to_db(gain) if settings.normalize_dbfs is not None else None,
        clipped_samples=outputs.clipped,
        unplayed=untuned + compass.unplayed_notes(arrangement, loaded, heard),
        left_out=left_out,
        stand_ins=compass.stand_ins(arrangement, heard),
        skipped=_skipped(song, casting, heard),
        rest=None if font is None else _rest_told(song, casting, heard, font, rest_gain_db),
        warnings=warnings,
        sources=sources_of_presets(settings.scheme, [loaded[part.preset] for part in casting.parts]),
    )


def _files_read(settings: RenderSettings) -> list[Named]:
    presets = [settings.preset, settings.fallback, *settings.channel_presets.values()]
    return parts.files_read(presets, midi=settings.midi, tuning=settings.tuning, kbm=settings.keyboard, rest=settings.rest)


def _mix_written(settings: RenderSettings) -> list[Named]:
    return [] if settings.output is None else [Named("-o", settings.output)]


def _limits(settings: RenderSettings) -> bool:
    """Whether the limiter works: not where the level is set afterwards, from what the strings give by themselves."""
    return settings.limiter and settings.normalize_dbfs is None


def _left_out(song: Song, casting: parts.Casting, heard: slice) -> dict[int, int]:
    """Channel (1…16) that nothing plays → its notes in these frames."""
    notes = (song.players >= 0) & compass.within(song.events, heard)
    counts = {channel: int((notes & (song.players >> 7 == channel)).sum()) for channel in casting.left_out}
    return {channel + 1: count for channel, count in counts.items() if count}


def _skipped(song: Song, casting: parts.Casting, heard: slice) -> list[dict[str, Any]]:
    """Channel (1…16), name and notes in these frames of each program that is skipped."""
    within = compass.within(song.events, heard)
    rows = [
        {
            "channel": channel + 1,
            "name": PROGRAMS[program],
            "notes": int((within & (song.players == channel << 7 | program)).sum()),
        }
        for channel, program in casting.skipped
    ]
    return [row for row in rows if row["notes"]]


def _rest_told(song: Song, casting: parts.Casting, heard: slice, font: SoundFont, gain_db: float) -> dict[str, Any]:
    rows = rest.rows(song, casting.rest, compass.within(song.events, heard))
    return {"soundfont": font.path, "gain_db": gain_db, "channels": rows}


def _span(settings: RenderSettings, song: Song) -> offline.Span:
    tail = settings.tail
    if tail is None:
        tail = "auto" if settings.end_s is None else 0.0
    span = offline.span_of(
        song.length_s,
        settings.rate_hz,
        start_s=settings.start_s,
        end_s=settings.end_s,
        tail_s=None if isinstance(tail, str) else tail,
    )
    if span.end > LONGEST_RENDER_S * settings.rate_hz:
        raise ValueError(
            f"{settings.midi}: the render would end at {span.end / settings.rate_hz / 3600.0:.1f} h, beyond the limit of "
            f"{LONGEST_RENDER_S / 3600.0:.0f} h; give an earlier --end"
        )
    return span


def _playable(arrangement: Arrangement, silent: np.ndarray | None, heard: slice) -> tuple[Arrangement, list[dict[str, Any]]]:
    """Without the notes on keys that the tuning leaves silent ((128,) bool; None: no tuning), and those in these frames."""
    if silent is None:
        return arrangement, []
    events = arrangement.events
    is_note = np.isin(events["kind"], (NOTE_ON, NOTE_OFF)) & (events["a"] >= 0) & (events["a"] < 128)
    dropped = is_note & silent[np.where(is_note, events["a"], 0)]
    dropped &= (arrangement.part < 0) | arrangement.note  # keys that switch sound in no tuning
    lost = dropped & (arrangement.part >= 0) & compass.within(events, heard)
    pairs, counts = np.unique(np.stack((events["channel"][lost], events["a"][lost])), axis=1, return_counts=True)
    unplayed = [
        {"part": f"ch{channel + 1:02d}", "note": midi_to_note(int(key)), "count": int(count), "reason": SILENT_KEY}
        for channel, key, count in zip(pairs[0], pairs[1], counts, strict=True)
    ]
    kept = ~dropped
    left = replace(
        arrangement,
        events=events[kept],
        part=arrangement.part[kept],
        program=arrangement.program[kept],
        leader=arrangement.leader[kept],
        folded=arrangement.folded[kept],
        note=arrangement.note[kept],
    )
    return left, unplayed


def _engine(
    settings: RenderSettings,
    arrangement: Arrangement,
    presets: Mapping[str, Preset],
    note_hz: np.ndarray | None,
    span: offline.Span,
) -> Any:
    # Imported late: it loads numba, and a wrong file name should not wait for that.
    from synth.engine.engine import Engine

    casting = arrangement.casting
    playing = [part.played(presets[part.preset]) for part in casting.parts]
    check_parts(settings.bindings, playing)
    return Engine(
        playing,
        casting.program_map,
        settings=settings.of_engine(limiter=_limits(settings)),
        note_hz=note_hz,
        only_notes=compass.keys_of_parts(arrangement, span.end + round(_LOOKAHEAD_S * settings.rate_hz)),
        bindings=settings.bindings,
        warn=lambda text: None,  # said before anything was prepared
    )


class _Silence:
    """In the place of an engine where no channel is played (a song of percussion alone)."""

    latency_samples = 0
    has_single = False

    def prepare(self, rate_hz: float, max_block: int, progress: Callable[[int, int], None] | None = None) -> None:
        pass

    def close(self) -> None:
        pass

    def process(self, events: np.ndarray, out: np.ndarray, stems: np.ndarray | None) -> None:
        out[:] = 0.0

    def report(self) -> Any:
        return SimpleNamespace(
            most_strings=0,
            limiter_reduction_db=0.0,
            stolen=0,
            taken_over=0,
            unplayed=(),
            unsolved_contacts=0,
            silenced=0,
        )


class _Nowhere:
    """The mix where only stems are wanted."""

    def write(self, block: np.ndarray) -> None:
        pass


class _Outputs:
    """The mix and the stems as sinks, with a detour through temporary files where the level is set afterwards: of all where
    the mix is normalized, of stems where their format has a full scale, which none of them may exceed.

    Made early, it finds out what cannot be written; entered, it opens files; left well, they get their names.
    """

    def __init__(self, settings: RenderSettings, labels: Sequence[str], span: offline.Span) -> None:
        self._settings, self._span = settings, span
        container = settings.container
        if settings.output is not None:
            container = audiofile.container_of(settings.output, container)
        self._container = container or "wav"
        self._mix = self._writer(settings.output) if settings.output is not None else None
        self._directory = Path(settings.stems) if settings.stems is not None else None
        self.stem_paths: list[str] = []
        self.silent_stems: list[str] = []
        self.stems_lowered_db = 0.0
        self._labels = list(labels) if settings.stems is not None else []
        if self._directory is not None:
            if self._directory.exists() and not self._directory.is_dir():
                raise NotADirectoryError(f"{self._directory}: is a file; --stems needs a directory")
            if not self._directory.parent.is_dir():
                raise FileNotFoundError(f"{self._directory}: its parent directory is missing; make it first")
            names = [f"{label}.{self._container}" for label in labels]
            if len(set(names)) < len(names):
                # Two preset files of one name in different directories on one channel.
                names = [f"{number:02d}-{name}" for number, name in enumerate(names, start=1)]
            self.stem_paths = [str(self._directory / name) for name in names]
            stems = [Named("stem", path) for path in self.stem_paths]
            check_apart(_files_read(settings), _mix_written(settings) + stems)
        self.mix: audiofile.AudioSink = _Nowhere()
        self.stems: list[audiofile.AudioSink] = []
        self._stack = ExitStack()
        self._made = False  # the directory
        self._mix_spool: audiofile.Spool | None = None
        self._metered: Sequence[audiofile.Spool | audiofile.Metered] = ()
        self._stem_writers: list[audiofile.AudioWriter] = []

    def _writer(self, path: str, beside: Path | None = None) -> audiofile.AudioWriter:
        return audiofile.AudioWriter(
            path,
            self._settings.rate_hz,
            container=self._container,
            bit_depth=self._settings.bit_depth,
            most_frames=self._span.most_frames,
            seed=self._settings.seed,
            beside=beside,
        )

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            mix = [self._mix] if self._mix is not None else []
            # A directory that is not there is made when all is well: until then the stems lie beside it.
            beside = None if self._directory is None or self._directory.exists() else self._directory.parent
            stems = [self._writer(path, beside) for path in self.stem_paths]
            stack.push(self._remove_directory)
            for writer in mix + stems:
                stack.enter_context(writer)
            self._stem_writers = stems
            near = self._scratch_directory()
            normalized = self._settings.normalize_dbfs is not None
            if self._mix is not None:
                self._mix_spool = stack.enter_context(audiofile.Spool(2, near)) if normalized else None
                self.mix = self._mix if self._mix_spool is None else self._mix_spool
            if normalized or self._settings.bit_depth != "float":
                self._metered = [stack.enter_context(audiofile.Spool(2, near)) for _ in stems]
            else:
                self._metered = [audiofile.Metered(writer) for writer in stems]
            self.stems = list(self._metered)
            self._stack = stack.pop_all()
        return self

    def _scratch_directory(self) -> Path | None:
        """Where two-pass files go: beside the output, which must have room for it anyway."""
        if self._directory is not None:
            return self._directory if self._directory.exists() else self._directory.parent
        output = self._settings.output
        if output is None or output == "-" or not Path(output).parent.is_dir():
            return None
        return Path(output).parent if not is_special(output) else None

    def finish(self, peak: float) -> float:
        """Sets the level of the mix where that was asked for, and that of the stems; `peak` is the mix's. Returns the mix's
        gain (linear)."""
        gain = 1.0
        if self._settings.normalize_dbfs is not None:
            gain = db_to_gain(self._settings.normalize_dbfs) / peak if peak > 0.0 else 1.0
            if self._mix is not None and self._mix_spool is not None:
                self._mix_spool.copy_to(self._mix, gain)
        self._finish_stems(gain)
        return gain

    def _finish_stems(self, gain: float) -> None:
        """Lowers all stems alike, in steps of STEM_STEP_DB, to where none clips; leaves out those that are silent."""
        loudest = gain * max((sink.peak for sink in self._metered), default=0.0)
        most = audiofile.most_unclipped(self._settings.bit_depth)
        if loudest > most:
            self.stems_lowered_db = STEM_STEP_DB * math.ceil(gain_to_db(loudest / most) / STEM_STEP_DB)
        gain *= db_to_gain(-self.stems_lowered_db)
        heard, self._stem_writers = self._stem_writers, []
        paths, self.stem_paths = self.stem_paths, []
        for label, path, writer, sink in zip(self._labels, paths, heard, self._metered, strict=True):
            if gain * sink.peak < SILENT_STEM:
                self.silent_stems.append(label)
                writer.discard()
                continue
            if isinstance(sink, audiofile.Spool):
                sink.copy_to(writer, gain)
            self._stem_writers.append(writer)
            self.stem_paths.append(path)

    @property
    def clipped(self) -> int:
        """Samples of the mix beyond full scale."""
        return self._mix.clipped if self._mix is not None else 0

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: Any) -> None:
        if kind is not None:
            self._stack.__exit__(kind, error, trace)
            return
        with self._stack:
            # All are whole before the first gets its name.
            for writer in ([] if self._mix is None else [self._mix]) + self._stem_writers:
                writer.finish()
            if self._directory is not None and self.stem_paths and not self._directory.is_dir():
                self._directory.mkdir()
                self._made = True

    def _remove_directory(self, kind: object, *_: object) -> None:
        """After a failure: a directory that was made for the stems goes too, as the last of all."""
        if kind is not None and self._made and self._directory is not None:
            with suppress(OSError):
                for path in self.stem_paths:
                    Path(path).unlink(missing_ok=True)
                self._directory.rmdir()
