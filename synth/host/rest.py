"""What strings do not play: percussion, winds and the like by a SoundFont, beside an engine of strings and in time with it.

Loudness: presets are equally loud by a phrase (`instrument.loudness_phrase`). A SoundFont plays the phrases of some presets
with the programs of General MIDI that they answer; by the median it is brought to the presets' loudness, all its programs
alike, so that the balance among them stays its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from synth.host import general_midi
from synth.host.soundfont import BLOCK, SoundFont
from synth.midi.events import EVENT, KEY_PRESSURE, NOTE_OFF, NOTE_ON, PARAMETER, PROGRAM, TUNING
from synth.midi.programs import PROGRAMS
from synth.midi.song import PERCUSSION_CHANNEL, Song
from synth.units import db_to_gain

#: programs of strings by which a SoundFont's loudness is measured: two guitars, two basses, a harp
MEASURED_PROGRAMS = (24, 25, 32, 33, 46)
LABEL = "rest"


def gain_db(font: SoundFont, rate_hz: int) -> float:
    """What makes the programs of strings in a SoundFont as loud as presets, in the median [dB]; 0 where it has none. The
    SoundFont is reset."""
    from synth.dsp.k_weighting import loudness_lufs
    from synth.instrument import loudness_phrase
    from synth.instrument.preset import load_preset

    there = font.programs()
    found = []
    for program in MEASURED_PROGRAMS:
        if program not in there:
            continue
        events, length = loudness_phrase.loudness_phrase(load_preset(general_midi.answer(program).preset))
        scale = rate_hz / loudness_phrase.RATE_HZ
        events["frame"] = np.rint(events["frame"] * scale)
        font.reset()
        font.send(PROGRAM, 0, program, 0)
        lufs = loudness_lufs(SoundFontPlayer(font, events).frames(-(-round(length * scale) // BLOCK) * BLOCK), rate_hz)
        if lufs is not None:
            found.append(loudness_phrase.TARGET_LUFS - lufs)
    font.reset()
    return round(median(found), 1) if found else 0.0


def events_of(
    song: Song,
    rest: Mapping[tuple[int, int], int],
    semitones: Callable[[int], int],
    silent: np.ndarray | None = None,
) -> np.ndarray:
    """The events (EVENT) of a song that a SoundFont is to play: of (channel, program) in `rest`.

    semitones: channel → by how much its notes are transposed; percussion is not. A note beyond all keys goes by octaves to
    the next key. silent: (128,) keys that a tuning leaves silent; None: none.
    """
    wanted = np.isin(song.players, [channel << 7 | program for channel, program in rest])
    events = song.events
    channels = set(np.unique(events["channel"][wanted]).tolist()) | {channel for channel, _ in rest}
    of_channels = np.isin(events["channel"], list(channels)) & ~np.isin(events["kind"], (PARAMETER, TUNING))
    notes = (events["kind"] == NOTE_ON) & (events["b"] > 0)
    kept = np.flatnonzero(of_channels & (wanted | ~notes))
    rows = []
    program_of: dict[int, int] = {}
    for place, row in zip(kept.tolist(), events[kept].tolist(), strict=True):
        frame, kind, channel, a, b, value = row
        if kind in (NOTE_ON, NOTE_OFF, KEY_PRESSURE) and channel != PERCUSSION_CHANNEL:
            a = _onto_keys(a + semitones(channel))
            if silent is not None and silent[a]:
                continue
        if kind == PROGRAM:
            program_of[channel] = a
        elif wanted[place] and channel != PERCUSSION_CHANNEL:
            # a member of an MPE zone has the program of its master
            program = int(song.players[place]) & 0x7F
            if program_of.get(channel, 0) != program:
                rows.append((frame, PROGRAM, channel, program, 0, 0.0))
                program_of[channel] = program
        rows.append((frame, kind, channel, a, b, value))
    return np.array(rows, EVENT)


def _onto_keys(note: int) -> int:
    """A note, by octaves to the next key where it lies beyond all keys."""
    while note < 0:
        note += 12
    while note > 127:
        note -= 12
    return note


class SoundFontPlayer:
    """Plays events (EVENT, frames from the beginning, ascending), each from the block of FluidSynth that begins nearest to
    it."""

    def __init__(self, font: SoundFont, events: np.ndarray) -> None:
        self._font = font
        at = events.copy()
        at["frame"] = (at["frame"] + BLOCK // 2) // BLOCK * BLOCK
        self._events = at
        self._next = 0
        self._at = 0

    def frames(self, count: int) -> np.ndarray:
        """(count, 2) float64, the next ones."""
        out = np.zeros((count, 2), np.float32)
        done = 0
        while done < count:
            while self._next < len(self._events) and self._events["frame"][self._next] <= self._at:
                _, kind, channel, a, b, _ = self._events[self._next].tolist()
                self._font.send(kind, channel, a, b)
                self._next += 1
            until = count - done
            if self._next < len(self._events):
                until = min(until, int(self._events["frame"][self._next]) - self._at)
            self._font.write(out[done : done + until])
            done += until
            self._at += until
        return out.astype(np.float64)


class WithRest:
    """An engine of strings and a SoundFont as one engine, whose last part is the SoundFont; the limiter works on both.

    engine: without a limiter.  player: from the song's beginning.  gain: of the SoundFont.  limited: whether there
    is a limiter.
    """

    def __init__(self, engine: Any, player: SoundFontPlayer, gain: float, *, limited: bool) -> None:
        self._engine, self._player, self._gain, self._limited = engine, player, gain, limited

    @property
    def has_single(self) -> bool:
        return bool(self._engine.has_single)

    def prepare(self, rate_hz: float, max_block: int, progress: Callable[[int, int], None] | None = None) -> None:
        from synth.dsp.limiter import LOOKAHEAD, limiter_state, release_coefficient

        self._engine.prepare(rate_hz, max_block, progress)
        late = LOOKAHEAD if self._limited else 0
        self.latency_samples = self._engine.latency_samples + late
        self._waiting = np.zeros((self._engine.latency_samples, 2))
        self._late_stems: np.ndarray | None = None
        self._late = late
        self._limiter = limiter_state(2)
        self._release = release_coefficient(rate_hz)

    def process(self, events: np.ndarray, out: np.ndarray, stems: np.ndarray | None) -> None:
        frames = len(out)
        self._engine.process(events, out, None if stems is None else stems[:-1])
        line = np.concatenate((self._waiting, self._gain * self._player.frames(frames)))
        rest, self._waiting = line[:frames], line[frames:]
        out += rest
        if stems is not None:
            stems[-1] = rest
            self._delay(stems)
        if self._limited:
            from synth.dsp.limiter import limit
            from synth.engine.engine import CEILING_DB

            limit(*self._limiter, db_to_gain(CEILING_DB), self._release, out)

    def _delay(self, stems: np.ndarray) -> None:
        """Makes the stems as late as the limiter makes the mix."""
        if self._late:
            before = np.zeros((len(stems), self._late, 2)) if self._late_stems is None else self._late_stems
            line = np.concatenate((before, stems), axis=1)
            stems[:], self._late_stems = line[:, : stems.shape[1]], line[:, stems.shape[1] :].copy()

    def report(self) -> Any:
        from synth.dsp.limiter import largest_reduction_db

        return Told(self._engine.report(), largest_reduction_db(self._limiter))

    def close(self) -> None:
        self._engine.close()


class Told:
    """The report of an engine of strings, with what the limiter of strings and SoundFont has done."""

    def __init__(self, of_strings: Any, limiter_reduction_db: float) -> None:
        self._of_strings, self.limiter_reduction_db = of_strings, limiter_reduction_db

    def __getattr__(self, name: str) -> Any:
        return getattr(self._of_strings, name)


def rows(song: Song, rest: Mapping[tuple[int, int], int], heard: np.ndarray) -> list[dict[str, Any]]:
    """Channel (1…16), name and notes among the events `heard` (n,) bool of everything that the SoundFont plays."""
    found = [
        {
            "channel": channel + 1,
            "name": "percussion" if channel == PERCUSSION_CHANNEL else PROGRAMS[program],
            "notes": int((heard & (song.players == channel << 7 | program)).sum()),
        }
        for channel, program in sorted(rest)
    ]
    return [row for row in found if row["notes"]]


def line(told: Mapping[str, Any]) -> str:
    """What a report says of the SoundFont, for people."""
    name = Path(told["soundfont"]).name
    if not told["channels"]:
        return f"{name} has nothing to play: strings play every channel"
    who = ", ".join(
        f"channel {row['channel']} ({row['name']}, {row['notes']} note{'' if row['notes'] == 1 else 's'})"
        for row in told["channels"]
    )
    return f"{name} plays {who}; its level is set by {told['gain_db']:+.1f} dB to match the strings"
