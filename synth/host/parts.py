"""Which preset plays which channel: the parts of a song.

By default General MIDI basses (programs 33–40, counted from 1) go to `fretted-bass`, everything else to
`jawari-harp`, and the percussion channel (10) is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from synth.files.targets import Named
from synth.midi.events import N_PARAMETERS, PARAMETER, TUNING
from synth.midi.song import PERCUSSION_CHANNEL
from synth.spelling import perhaps
from synth.units import midi_to_note

if TYPE_CHECKING:
    from synth.engine.engine import Unplayed
    from synth.instrument.preset import Preset

BASS_PRESET = "fretted-bass"
MELODY_PRESET = "jawari-harp"
# General MIDI programs, counted from 0.
BASS_PROGRAMS = range(32, 40)
LEFT_OUT = "none"


@dataclass(frozen=True)
class Part:
    """One preset (by name or file) playing one channel (0…15) with `notes` notes."""

    channel: int
    preset: str
    notes: int

    @property
    def label(self) -> str:
        """Name for files and reports: channel as musicians count, and preset."""
        stem = self.preset.replace("\\", "/").rsplit("/", 1)[-1].removesuffix(".toml")
        return f"ch{self.channel + 1:02d}-{stem}"


@dataclass(frozen=True)
class Casting:
    """Parts of a song; program_map: (16, 128) channel, program → part or −1; left_out: {channel: notes}."""

    parts: tuple[Part, ...]
    program_map: np.ndarray
    left_out: dict[int, int]


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


def cast(
    channels: Mapping[tuple[int, int], int],
    preset: str | None = None,
    by_channel: Mapping[int, str] | None = None,
) -> Casting:
    """Gives every (channel, program) of a song (with its number of notes) a preset.

    `by_channel` (channel 0…15 → preset or 'none') goes before `preset`, which goes before the default.
    """
    by_channel = by_channel or {}
    notes: dict[tuple[int, str], int] = {}
    left_out: dict[int, int] = {}
    players: dict[tuple[int, int], tuple[int, str]] = {}
    for (channel, program), count in sorted(channels.items()):
        chosen = _choose(channel, program, preset, by_channel)
        if chosen == LEFT_OUT:
            left_out[channel] = left_out.get(channel, 0) + count
            continue
        player = (channel, chosen)
        notes[player] = notes.get(player, 0) + count
        players[channel, program] = player
    parts = tuple(Part(channel, name, count) for (channel, name), count in notes.items())
    index = {(part.channel, part.preset): number for number, part in enumerate(parts)}
    program_map = np.full((16, 128), -1, dtype=np.int64)
    for (channel, program), player in players.items():
        program_map[channel, program] = index[player]
    return Casting(parts, program_map, left_out)


def cast_live(
    preset: str | None = None,
    by_channel: Mapping[int, str] | None = None,
    *,
    only_channel: int | None = None,
    song: Casting | None = None,
) -> Casting:
    """Gives every channel and program a preset, chosen as by `cast`: one part per preset, which all its channels share.

    only_channel: all others are left out.  song: the parts of a song, which keep their channels and programs; where one
    has the preset that another channel wants, it plays for that, too. Raises ValueError where nothing is left to play.
    """
    by_channel = by_channel or {}
    parts = list(song.parts) if song is not None else []
    program_map = song.program_map.copy() if song is not None else np.full((16, 128), -1, dtype=np.int64)
    for channel in range(16) if only_channel is None else [only_channel]:
        for program in np.flatnonzero(program_map[channel] < 0):
            chosen = _choose(channel, int(program), preset, by_channel)
            if chosen == LEFT_OUT:
                continue
            fits = [number for number, part in enumerate(parts) if part.preset == chosen]
            if not fits:
                fits = [len(parts)]
                parts.append(Part(channel, chosen, 0))
            own = [number for number in fits if parts[number].channel == channel]
            program_map[channel, program] = (own or fits)[0]
    if not parts:
        raise ValueError("no channel has a preset: --map leaves all of them out; give one a preset, such as --map 1=tanpura")
    return Casting(tuple(parts), program_map, song.left_out if song is not None else {})


def played_events(events: np.ndarray, casting: Casting) -> np.ndarray:
    """Those of a song's events (EVENT) that are not on channels left out, nor set parameters that are not there, or to
    what is no number: a file may hold what was meant for others."""
    of_channel = ~np.isin(events["kind"], (PARAMETER, TUNING))
    there = (events["channel"] < len(casting.parts)) & (events["a"] < N_PARAMETERS) & np.isfinite(events["value"])
    idle = (events["kind"] == PARAMETER) & ~there
    return events[~(of_channel & np.isin(events["channel"], list(casting.left_out))) & ~idle]


def notes_of_parts(keys: Mapping[tuple[int, int], set[int]], casting: Casting) -> list[set[int]]:
    """The MIDI notes that every part has to play, from those of every (channel, program)."""
    wanted: list[set[int]] = [set() for _ in casting.parts]
    for (channel, program), notes in keys.items():
        part = casting.program_map[channel, program]
        if part >= 0:
            wanted[part] |= notes
    return wanted


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


def _choose(channel: int, program: int, preset: str | None, by_channel: Mapping[int, str]) -> str:
    """The preset of a channel and program, or LEFT_OUT."""
    if channel in by_channel:
        return by_channel[channel]
    if channel == PERCUSSION_CHANNEL:
        return LEFT_OUT
    if preset is not None:
        return preset
    return BASS_PRESET if program in BASS_PROGRAMS else MELODY_PRESET
