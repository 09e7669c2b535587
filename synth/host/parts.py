"""Which preset plays which channel: the parts of a song.

By default General MIDI basses (programs 33–40, counted from 1) go to `fretted-bass`, everything else to
`jawari-harp`, and the percussion channel (10) is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from synth.host.midi import PERCUSSION_CHANNEL

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
        if channel in by_channel:
            chosen = by_channel[channel]
        elif channel == PERCUSSION_CHANNEL:
            chosen = LEFT_OUT
        elif preset is not None:
            chosen = preset
        else:
            chosen = BASS_PRESET if program in BASS_PROGRAMS else MELODY_PRESET
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
