"""Which preset plays which channel: the parts of a song.

By default programs choose: of a song by the table of `general_midi`, live the basses (33–40, counted from 1) play
`fretted-bass` and everything else `jawari-harp`. The percussion channel (10) is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from synth.files.targets import Named
from synth.host import general_midi
from synth.midi.events import N_PARAMETERS, PARAMETER, TUNING
from synth.midi.song import PERCUSSION_CHANNEL
from synth.spelling import perhaps
from synth.units import midi_to_note

if TYPE_CHECKING:
    from synth.engine.engine import Unplayed
    from synth.instrument.preset import Preset
    from synth.midi.song import Song

#: live, where programs choose, for these programs of General MIDI (counted from 0) and for all others
BASS_PRESET = general_midi.BASS
MELODY_PRESET = general_midi.HARP
BASS_PROGRAMS = range(32, 40)
LEFT_OUT = "none"
#: stands for the percussion among the programs of a SoundFont, which are 0…127
PERCUSSION = 128


@dataclass(frozen=True)
class Part:
    """One preset (by name or file) playing one channel (0…15) with `notes` notes; by_program: whether a program of General
    MIDI chose it, and not the user; articulations: of these names the first that the preset has is how it plays, `gain_db`
    louder; switching: whether keys and controllers switch its articulations."""

    channel: int
    preset: str
    notes: int
    by_program: bool = False
    articulations: tuple[str, ...] = ()
    switching: bool = True
    gain_db: float = 0.0

    def played(self, preset: Preset) -> Preset:
        """The preset as the part plays it: with its articulation as the normal one, which velocities then do not change;
        reached by no keys and controllers where these are not to switch."""
        from synth.instrument.articulations import NORMAL

        there = preset.articulations
        name = next((name for name in self.articulations if name in there), NORMAL)
        if not there or (name == NORMAL and self.switching):
            return preset
        gone = {} if self.switching else {"key": None, "controller": None}
        gone |= {} if name == NORMAL else {"velocity": None}
        changed = {each: table.model_copy(update=gone) for each, table in there.items()}
        if name != NORMAL:
            key = changed[NORMAL].key if NORMAL in changed else None
            changed[NORMAL] = changed[name].model_copy(update={"key": key, "controller": None})
        output = preset.output
        if name != NORMAL:
            output = output.model_copy(update={"gain_db": output.gain_db + self.gain_db})
        return preset.model_copy(update={"articulations": changed, "output": output})

    @property
    def label(self) -> str:
        """Name for files and reports: channel as musicians count, and preset."""
        stem = self.preset.replace("\\", "/").rsplit("/", 1)[-1].removesuffix(".toml")
        return "-".join([f"ch{self.channel + 1:02d}", stem, *self.articulations[:1]])


@dataclass(frozen=True)
class Casting:
    """Parts of a song; program_map: (16, 128) channel, program → part or −1; left_out: {channel: notes}; skipped: {(channel,
    program): notes} of programs that are no strings, where only those are wanted; rest: the same of what a SoundFont
    plays."""

    parts: tuple[Part, ...]
    program_map: np.ndarray
    left_out: dict[int, int]
    skipped: dict[tuple[int, int], int] = field(default_factory=dict)
    rest: dict[tuple[int, int], int] = field(default_factory=dict)


@dataclass(frozen=True)
class Choice:
    """What a user has chosen. by_channel (channel 0…15 → preset or 'none') goes before `preset`, which goes before what
    programs choose: gm: by the whole table of General MIDI, else of two presets; only_strings: programs that are no strings
    are left out; switching: keys and controllers switch articulations of what a program chose: live and in takes, but not in
    songs, whose low notes are notes and whose controllers are meant for others; rest: programs that a SoundFont has, with
    PERCUSSION, which plays those that are no strings."""

    preset: str | None = None
    by_channel: Mapping[int, str] = field(default_factory=dict)
    gm: bool = True
    only_strings: bool = False
    switching: bool = False
    rest: frozenset[int] = frozenset()

    def of(self, channel: int, program: int) -> str:
        """The preset of a channel and program, or LEFT_OUT."""
        if channel in self.by_channel:
            return self.by_channel[channel]
        if channel == PERCUSSION_CHANNEL:
            return LEFT_OUT
        if self.preset is not None:
            return self.preset
        if self.gm:
            return general_midi.answer(program).preset
        return BASS_PRESET if program in BASS_PROGRAMS else MELODY_PRESET

    def part(self, channel: int, program: int, notes: int = 0) -> Part:
        """What plays a channel and program, if it is not left out."""
        mine = self.by_program(channel)
        preset, switching = self.of(channel, program), self.switching or not mine
        if not (self.gm and mine):
            return Part(channel, preset, notes, mine, (), switching)
        answer = general_midi.answer(program)
        return Part(channel, preset, notes, mine, answer.articulations, switching, answer.gain_db)

    def by_program(self, channel: int) -> bool:
        """Whether programs choose on a channel."""
        return self.preset is None and channel not in self.by_channel and channel != PERCUSSION_CHANNEL

    def leaves(self, channel: int, program: int) -> bool:
        """Whether a program is left to the SoundFont: percussion, and what is no string, unless the user chose a preset."""
        if channel == PERCUSSION_CHANNEL:
            return PERCUSSION in self.rest and channel not in self.by_channel
        return program in self.rest and self.by_program(channel) and not general_midi.answer(program).string

    def skips(self, channel: int, program: int) -> bool:
        """Whether a program is left out because it is no string."""
        return self.only_strings and self.by_program(channel) and not general_midi.answer(program).string


def files_read(presets: Iterable[str | None], **files: str | None) -> list[Named]:
    """Files that are read, for `targets.check_apart`: those of presets by name or path, as far as there are any, and others
    by what they are."""
    from synth.instrument.preset import PresetError, preset_path

    read = [Named(what, path) for what, path in files.items() if path is not None]
    for name in presets:
        if name is not None and name != "none":
            with suppress(PresetError, OSError):
                read.append(Named("preset", preset_path(name)))
    return read


def parse_channel_map(texts: Sequence[str]) -> dict[int, str]:
    """'1=tanpura,3=fretted-bass' (channels 1…16; the preset 'none' leaves a channel out) → {0: 'tanpura', …}.

    Raises ValueError.
    """
    chosen: dict[int, str] = {}
    for entry in (entry.strip() for text in texts for entry in text.split(",")):
        number, equals, preset = entry.partition("=")
        if not equals or not preset.strip() or not number.strip().isdecimal():
            raise ValueError(f"--map {entry!r} is not CHANNEL=PRESET; write for example --map 1=tanpura,3=none")
        channel = int(number) - 1
        if not 0 <= channel < 16:
            raise ValueError(f"--map channel must be 1 to 16, got {int(number)}; correct {entry!r}")
        chosen[channel] = preset.strip()
    return chosen


def cast(channels: Mapping[tuple[int, int], int], choice: Choice) -> Casting:
    """Gives every (channel, program) of a song (with its number of notes) a preset."""
    notes: dict[Part, int] = {}
    left_out: dict[int, int] = {}
    skipped: dict[tuple[int, int], int] = {}
    rest: dict[tuple[int, int], int] = {}
    players: dict[tuple[int, int], Part] = {}
    for (channel, program), count in sorted(channels.items()):
        player = choice.part(channel, program)
        if choice.leaves(channel, program):
            rest[channel, program] = count
        elif player.preset == LEFT_OUT:
            left_out[channel] = left_out.get(channel, 0) + count
        elif choice.skips(channel, program):
            skipped[channel, program] = count
        else:
            notes[player] = notes.get(player, 0) + count
            players[channel, program] = player
    index = {player: number for number, player in enumerate(notes)}
    parts = tuple(replace(player, notes=count) for player, count in notes.items())
    program_map = np.full((16, 128), -1, dtype=np.int64)
    for (channel, program), player in players.items():
        program_map[channel, program] = index[player]
    return Casting(parts, program_map, left_out, skipped, rest)


def cast_live(choice: Choice, *, only_channel: int | None = None, song: Casting | None = None) -> Casting:
    """Gives every channel and program a preset, chosen as by `cast`: one part per preset, which all its channels share.

    only_channel: all others are left out.  song: the parts of a song, which keep their channels and programs; where one
    has the preset that another channel wants, it plays for that, too. Raises ValueError where nothing is left to play.
    """
    parts = list(song.parts) if song is not None else []
    skipped = song.skipped if song is not None else {}
    program_map = song.program_map.copy() if song is not None else np.full((16, 128), -1, dtype=np.int64)
    for channel in range(16) if only_channel is None else [only_channel]:
        for program in np.flatnonzero(program_map[channel] < 0).tolist():
            wanted = choice.part(channel, program)
            if wanted.preset == LEFT_OUT or choice.skips(channel, program):
                continue
            same = (wanted.preset, wanted.articulations, wanted.switching)
            fits = [n for n, part in enumerate(parts) if (part.preset, part.articulations, part.switching) == same]
            if not fits:
                fits = [len(parts)]
                parts.append(wanted)
            own = [number for number in fits if parts[number].channel == channel]
            program_map[channel, program] = (own or fits)[0]
    if not parts:
        raise ValueError("no channel has a preset: --map leaves all of them out; give one a preset, such as --map 1=tanpura")
    return Casting(tuple(parts), program_map, song.left_out if song is not None else {}, skipped)


def headroom_db(song: Song, casting: Casting) -> float:
    """By how much a song is lowered [dB], so that all its channels together are about as loud as one alone: 3 dB where there
    are two, 9 dB where there are eight; of a take what its song was."""
    channels = {part.channel for part in casting.parts} | {channel for channel, _ in casting.rest}
    return song.headroom_db if song.take else round(10.0 * math.log10(max(1, len(channels))), 1)


def played_events(events: np.ndarray, players: np.ndarray, casting: Casting) -> np.ndarray:
    """(n,) which of a song's events (EVENT) strings play: not those on channels left out, nor notes of programs that are
    skipped or a SoundFont's, nor set parameters that are not there, or to what is no number: a file may hold what was meant
    for others.

    players: of every event, see `song.players`.
    """
    of_channel = ~np.isin(events["kind"], (PARAMETER, TUNING))
    there = (events["channel"] < len(casting.parts)) & (events["a"] < N_PARAMETERS) & np.isfinite(events["value"])
    idle = (events["kind"] == PARAMETER) & ~there
    skipped = np.isin(players, [channel << 7 | program for channel, program in (*casting.skipped, *casting.rest)])
    left_out = {*casting.left_out, *(channel for channel, _ in casting.rest if channel == PERCUSSION_CHANNEL)}
    return ~(of_channel & np.isin(events["channel"], list(left_out))) & ~idle & ~skipped


def unplayed_rows(unplayed: Sequence[Unplayed], labels: Sequence[str]) -> list[dict[str, Any]]:
    """What a report says of notes that found no string; `labels` of the parts."""
    return [
        {
            "part": labels[each.part] if each.part >= 0 else "no part",
            "note": midi_to_note(each.note),
            "count": each.times,
            "reason": each.reason,
        }
        for each in unplayed
    ]


def varied(presets: Mapping[str, Preset], share: float) -> dict[str, Preset]:
    """The presets with so much of what varies from stroke to stroke: 0 nothing, 1 as they say."""
    if share == 1.0:
        return dict(presets)
    return {name: each.model_copy(update={"hand": each.hand.varied(share)}) for name, each in presets.items()}


def load_presets(
    names: Sequence[str],
    settings: Sequence[tuple[str | None, str, str]],
    made: Mapping[str, Preset] | None = None,
) -> dict[str, Preset]:
    """Presets by name or file with `settings` applied: (preset or None for all, dotted key, value). Raises ValueError.

    made: presets that the program has made, by the names that stand for them.
    """
    made = made or {}
    # Imported late: it loads pydantic, and a wrong file name should not wait for that.
    from synth.instrument.preset import load_preset, preset_folder, preset_path

    names = list(dict.fromkeys(names))
    presets = {name: made[name] if name in made else load_preset(name) for name in names}
    for only, key, value in settings:
        if only is not None and only not in presets:
            raise ValueError(
                f"--set {only}:{key}: no part plays {only!r}{perhaps(only, names)}; "
                f"the parts play {', '.join(names) or 'nothing'}"
            )
        for name in names if only is None else [only]:
            presets[name] = presets[name].with_setting(key, value)
    # Those that come with the program are in order as they stand, which the tests hold.
    own = [name for name in names if settings or name in made or preset_path(name).parent != preset_folder()]
    if own:
        from synth.instrument.check import check

        for name in own:
            check(presets[name], name + _with(name, settings))
    return presets


def _with(name: str, settings: Sequence[tuple[str | None, str, str]]) -> str:
    """What was changed of a preset, for a message."""
    changed = [f"{key}={value}" for only, key, value in settings if only in (None, name)]
    return f" with {', '.join(changed)}" if changed else ""
