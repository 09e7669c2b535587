"""A MIDI file as a song: one array of events at absolute frames, ready for the engine.

Formats 0 and 1 are one sequence: all tracks are merged and share one tempo map (set_tempo of every track
counts, as sequencers disagree on where they put it). The tracks of a format 2 file are independent sequences,
each with its own tempo; they are played one after the other. Of SysEx, tunings and this program's own messages are
read (`sysex`); meta events other than tempo and end of track are passed over.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from synth.midi import sysex, zones
from synth.midi.events import BEND, CONTROL, EVENT, KEY_PRESSURE, NOTE_OFF, NOTE_ON, PRESSURE, PROGRAM, TUNING
from synth.midi.smf import MidiError, MidiFile, Track, read_file

__all__ = ["PERCUSSION_CHANNEL", "MidiError", "Song", "read_song", "song_from_file"]

PERCUSSION_CHANNEL = 9
DEFAULT_TEMPO_US = 500_000
# Some sequencers leave the end of track hours behind the music; a rest longer than this at the end is
# nobody's intention.
LONGEST_REST_AT_END_S = 60.0
# No music is longer: a song that is has a broken time or tempo. To here, a frame is that of its tick.
LONGEST_SONG_S = 24 * 3600.0


@dataclass(frozen=True)
class Song:
    """A song at a sample rate.

    events: EVENT array, `frame` counted from the song's start and ascending; channels are 0…15. Simultaneous
        events keep the file's order (tracks in order), but a note-off that ends an earlier note comes before
        a note-on of the same key. This program's own takes keep theirs.
    rate_hz: frames per second of `frame`.  length_s: the song's end (end of track) in seconds.
    channels: (channel, program) → number of notes, for those that have notes; those of an MPE zone are its master's.
    notes: their sum.
    keys: (channel, program) → the MIDI notes that occur.
    warnings: what was odd about the file, one line each.
    players: of every event, see `players`.
    take: whether it is a take of this program's, which is played as it was.  gm: whether programs choose by the whole table
        of General MIDI, as in all songs but takes of sessions that did otherwise.  headroom_db: of a take, what its song was
        lowered by.  unswitched: whether, in a take, keys and controllers switched no articulations of what programs chose.
    """

    events: np.ndarray
    rate_hz: int
    length_s: float
    channels: dict[tuple[int, int], int]
    keys: dict[tuple[int, int], set[int]]
    notes: int
    warnings: tuple[str, ...]
    players: np.ndarray
    take: bool = False
    gm: bool = True
    headroom_db: float = 0.0
    unswitched: bool = False

    @property
    def switching(self) -> bool:
        """Whether keys and controllers switch articulations of what programs choose: as in the session of a take, and never
        in songs, whose low notes are notes."""
        return self.take and not self.unswitched


def read_song(path: str | Path, rate_hz: int, mpe: bool = False, until_s: float | None = None) -> Song:
    """Reads a Standard MIDI File (format 0, 1 or 2). Raises MidiError with one line naming the file, what is
    wrong, a remedy.
    """
    file = read_file(path)
    try:
        return song_from_file(file, rate_hz, mpe, until_s)
    except MidiError as error:
        raise MidiError(f"{path}: {error}") from None


def song_from_file(file: MidiFile, rate_hz: int, mpe: bool = False, until_s: float | None = None) -> Song:
    """The song of a parsed file at `rate_hz`: seconds are rounded to the nearest frame. mpe: it begins with an MPE zone of
    all channels. until_s: how far it will be played; None: to its end.

    Raises MidiError where it gets longer than LONGEST_SONG_S, if it is to be played that far. What comes later stands there.
    """
    sequences = [[track] for track in file.tracks] if file.format == 2 else [file.tracks]
    warnings = list(file.warnings)
    pieces: list[np.ndarray] = []
    seconds: list[np.ndarray] = []
    start_s = 0.0
    endless = 0
    for tracks in sequences:
        clock = _Clock(file, tracks, warnings)
        tick, events = _merge(tracks, clock, rate_hz)
        end_s = _end_s(clock, tracks, tick, warnings)
        order, still_on = _ordered(tick, events)
        if any(track.take for track in tracks):
            order = np.arange(len(events))
        time_s = np.minimum(clock.seconds(tick), end_s)[order]
        if start_s + end_s > LONGEST_SONG_S and (until_s is None or until_s > LONGEST_SONG_S):
            raise _too_long(tracks, start_s + clock.seconds(tick), tick, file.tracks)
        endless += len(still_on)
        offs = np.zeros(len(still_on), EVENT)
        offs["kind"] = NOTE_OFF
        for off, (channel, note) in zip(offs, still_on, strict=True):
            off["channel"], off["a"], off["b"] = channel, note, 64
        pieces += [events[order], offs]
        seconds += [start_s + time_s, np.full(len(offs), start_s + end_s)]
        start_s += end_s
    if endless:
        notes = f"{endless} notes have no note-off and end" if endless > 1 else "1 note has no note-off and ends"
        warnings.append(f"{notes} with the file")
    events = np.concatenate(pieces) if pieces else np.zeros(0, EVENT)
    if not (events["kind"] == NOTE_ON).any():
        warnings.append("the file has no notes")
    if len(events):
        played_s = np.minimum(np.concatenate(seconds), LONGEST_SONG_S)
        events["frame"] = np.rint(played_s * rate_hz).astype(np.int64)
    song = song_of(events, rate_hz, start_s, mpe, tuple(dict.fromkeys(warnings)))
    takes = [track for track in file.tracks if track.take]
    headroom_db = max((track.headroom_db for track in takes), default=0.0)
    gm, unswitched = all(track.gm for track in takes), any(track.unswitched for track in takes)
    return replace(song, take=bool(takes), gm=gm, headroom_db=headroom_db, unswitched=unswitched)


def song_of(events: np.ndarray, rate_hz: int, length_s: float, mpe: bool = False, warnings: tuple[str, ...] = ()) -> Song:
    """The song of events (EVENT array, absolute frames, ascending), with its notes counted."""
    by = players(events, mpe)
    on = by >= 0
    keys: dict[tuple[int, int], set[int]] = {}
    channels: dict[tuple[int, int], int] = {}
    for player in np.unique(by[on]).tolist():
        pair = player >> 7, player & 0x7F
        notes = events["a"][by == player]
        keys[pair], channels[pair] = set(np.unique(notes).tolist()), len(notes)
    return Song(events, rate_hz, length_s, channels, keys, int(on.sum()), warnings, by)


def players(events: np.ndarray, mpe: bool = False) -> np.ndarray:
    """(n,) 128 · channel + program of every note-on of a song, those of an MPE zone are its master's; −1 of other events.

    mpe: the song begins with an MPE zone of all channels.
    """
    by = np.full(len(events), -1)
    programs = [0] * 16
    masters = Zones(mpe)
    telling = np.flatnonzero(np.isin(events["kind"], (NOTE_ON, PROGRAM, CONTROL)))
    rows = zip(telling.tolist(), *(events[name][telling].tolist() for name in ("kind", "channel", "a", "b")), strict=True)
    for place, kind, channel, a, b in rows:
        if kind == PROGRAM:
            programs[channel] = a
        elif kind == CONTROL:
            masters.control(channel, a, b)
        elif b > 0:
            leader = masters.master(channel)
            by[place] = leader << 7 | programs[leader]
    return by


def _too_long(tracks: list[Track], time_s: np.ndarray, tick: np.ndarray, of_file: list[Track]) -> MidiError:
    """The first message that comes too late, by track, tick and time (those of the events of `tracks`, merged)."""
    first = int(np.searchsorted(time_s, LONGEST_SONG_S, side="right"))
    hours = LONGEST_SONG_S / 3600.0
    if first == len(tick):  # the rest of less than a minute at its end
        return MidiError(f"the song is longer than {hours:.0f} h; shorten it, or render it up to an earlier --end")
    at = int(tick[first])
    place = next((k for k, track in enumerate(tracks) if at in track.ticks or any(at == each[1] for each in track.sysex)), 0)
    number = next((k for k, track in enumerate(of_file, start=1) if track is tracks[place]), 1)
    return MidiError(
        f"the song exceeds {hours:.0f} h in track {number} at tick {at}, {time_s[first] / 3600.0:.4g} h after its start; "
        "correct the times or the tempo there, or render it up to an earlier --end"
    )


class Zones:
    """Which channels of a song are members of an MPE zone, whose notes are its master's."""

    def __init__(self, mpe: bool) -> None:
        self._members = [zones.MOST_MEMBERS if mpe else 0, 0]
        self._numbers = [[0x7F, 0x7F] for _ in range(16)]  # controllers 101 and 100 of every channel

    def master(self, channel: int) -> int:
        return zones.master_of(channel, *self._members)

    def control(self, channel: int, controller: int, value: int) -> bool:
        """Heeds a controller; whether it has set a zone, which begins anew."""
        numbers = self._numbers[channel]
        if controller in (100, 101):
            numbers[101 - controller] = value
        elif controller in (98, 99, 121):
            numbers[:] = 0x7F, 0x7F
        elif controller == 6 and numbers == [0, zones.CONFIGURATION]:
            for zone in (zones.LOWER, zones.UPPER):
                if channel == zones.manager_of(zone):
                    self._members[zone] = min(value, zones.MOST_MEMBERS)
                    self._members[1 - zone] = zones.yielded(self._members[zone], self._members[1 - zone])
                    return True
        return False


class _Clock:
    """Ticks of one sequence → seconds."""

    def __init__(self, file: MidiFile, tracks: list[Track], warnings: list[str]) -> None:
        if file.ticks_per_second is not None:
            # SMPTE time is real time: tempo has no say in it.
            tempos: list[tuple[int, float]] = [(0, 1.0 / file.ticks_per_second)]
        else:
            assert file.ticks_per_quarter is not None
            scale = 1e-6 / file.ticks_per_quarter
            changes = [change for track in tracks for change in track.tempos]
            changes.sort(key=lambda change: change[0])
            if any(us == 0 for _, us in changes):
                warnings.append("a tempo of 0 µs per quarter note is ignored")
            tempos = [(0, DEFAULT_TEMPO_US * scale)] + [(at, us * scale) for at, us in changes if us > 0]
        self._tick = np.array([at for at, _ in tempos], dtype=np.int64)
        self._seconds_per_tick = np.array([each for _, each in tempos])
        spans = np.diff(self._tick) * self._seconds_per_tick[:-1]
        self._start_s = np.concatenate(([0.0], np.cumsum(spans)))

    def seconds(self, tick: np.ndarray) -> np.ndarray:
        part = np.searchsorted(self._tick, tick, side="right") - 1
        return self._start_s[part] + (tick - self._tick[part]) * self._seconds_per_tick[part]


def _merge(tracks: list[Track], clock: _Clock, rate_hz: int) -> tuple[np.ndarray, np.ndarray]:
    """(ticks, EVENT array without frames) of all tracks, sorted by tick; ties in the tracks' order."""

    def joined(name: str) -> np.ndarray:
        parts = [np.array(getattr(track, name), dtype=np.int64) for track in tracks]
        return np.concatenate(parts) if parts else np.zeros(0, np.int64)

    tick, status, data1, data2 = joined("ticks"), joined("status"), joined("data1"), joined("data2")
    message = status >> 4
    kind = np.zeros(len(tick), np.int32)
    kind[message == 0x8] = NOTE_OFF
    kind[message == 0x9] = NOTE_ON
    kind[(message == 0x9) & (data2 == 0)] = NOTE_OFF
    kind[message == 0xA] = KEY_PRESSURE
    kind[message == 0xB] = CONTROL
    kind[message == 0xC] = PROGRAM
    kind[message == 0xD] = PRESSURE
    kind[message == 0xE] = BEND
    events = np.zeros(len(tick), EVENT)
    events["kind"] = kind
    events["channel"] = status & 0x0F
    bend, pressure = message == 0xE, message == 0xD
    events["a"] = np.where(bend, data1 + 128 * data2 - 8192, np.where(pressure, 0, data1))
    # A note-on of velocity 0 stands for a note-off of release velocity 64.
    silent_on = (message == 0x9) & (data2 == 0)
    events["b"] = np.where(bend, 0, np.where(pressure, data1, np.where(silent_on, 64, data2)))
    exclusive_tick, exclusive_place, exclusive = _exclusive(tracks, clock, rate_hz)
    tick = np.concatenate((tick, exclusive_tick))
    place = np.concatenate((np.arange(len(events), dtype=np.float64), exclusive_place))
    events = np.concatenate((events, exclusive))
    order = np.lexsort((place, tick))
    return tick[order], events[order]


def _exclusive(tracks: list[Track], clock: _Clock, rate_hz: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(ticks, places among the channel messages of all tracks, EVENT array) of what system exclusive messages say. Of
    tunings in one frame, with nothing between them, those are left that make a difference (all of a take, which is played as
    it was)."""
    ticks: list[int] = []
    places: list[float] = []
    rows: list[tuple] = []
    before = 0
    for track in tracks:
        for messages in [[each] for each in track.sysex] if track.take else _at_once(track, tracks, clock, rate_hz):
            place, tick, _ = messages[0]
            said = sysex.events_of(messages[0][2]) if len(messages) == 1 else _told([body for _, _, body in messages])
            rows += [(0, *row) for row in said]
            ticks += [tick] * len(said)
            places += [before + place - 0.5] * len(said)
        before += len(track.ticks)
    return np.array(ticks, np.int64), np.array(places), np.array(rows, EVENT)


def _at_once(track: Track, tracks: list[Track], clock: _Clock, rate_hz: int) -> Iterator[list[tuple[int, int, bytes]]]:
    """The system exclusive messages of a track, together those that lie in one frame with nothing of any track between."""
    others = [[*each.ticks, *(tick for _, tick, _ in each.sysex)] for each in tracks if each is not track]
    events = np.sort(np.array([*track.ticks, *(tick for each in others for tick in each)], np.int64))
    tick = np.array([tick for _, tick, _ in track.sysex], np.int64)
    keys = zip(
        (place for place, _, _ in track.sysex),
        np.rint(clock.seconds(tick) * rate_hz).tolist(),
        np.searchsorted(events, tick, "left").tolist(),
        np.searchsorted(events, tick, "right").tolist(),
        strict=True,
    )
    for _, group in groupby(zip(keys, track.sysex, strict=True), key=lambda pair: pair[0]):
        yield [message for _, message in group]


def _told(bodies: list[bytes]) -> list[sysex.Row]:
    """The events of messages that come together, without tunings that others of them undo."""
    kept: list[sysex.Row] = []
    later: set[int] = set()  # keys that are tuned by what is kept, and those of them whose sounding strings are
    later_sounding: set[int] = set()
    for body in reversed(bodies):
        undone = later_sounding if body[:1] == bytes((sysex.REAL_TIME,)) else later
        if len(undone) == 128 and body[0] in (sysex.REAL_TIME, sysex.NON_REAL_TIME):
            continue
        for row in reversed(sysex.events_of(body)):
            kind, _, key, sounding, _ = row
            if kind == TUNING:
                if key in (later_sounding if sounding else later):
                    continue
                later.add(key)
                if sounding:
                    later_sounding.add(key)
            kept.append(row)
    return kept[::-1]


def _end_s(clock: _Clock, tracks: list[Track], tick: np.ndarray, warnings: list[str]) -> float:
    """The sequence's end in seconds: its latest end of track, but not more than a long rest after the last
    event.
    """
    ends = np.array([max((track.end_tick for track in tracks), default=0)])
    end_s = float(clock.seconds(ends)[0])
    last_s = float(clock.seconds(tick[-1:])[0]) if len(tick) else 0.0
    if end_s > last_s + LONGEST_REST_AT_END_S:
        warnings.append(f"it ends {end_s - last_s:.0f} s after its last event: that silence is left out")
        return last_s
    return end_s


def _ordered(tick: np.ndarray, events: np.ndarray) -> tuple[np.ndarray, list[tuple[int, int]]]:
    """Puts note-offs before note-ons at the same tick, finds notes without an end.

    A note-off at the tick of a note-on of its key ends the note that sounded before, if one did, and moves in
    front of that note-on: else a repeated note would be cut by the end of its forerunner. If none sounded
    before, it ends the new note, whose length is zero: a pluck, which has to stay.

    Returns (order of the events, [(channel, note)] still on at the end).
    """
    position = np.arange(len(events), dtype=np.float64)
    started: dict[int, int] = {}  # key → notes on since an earlier tick
    now: dict[int, list[int]] = {}  # key → [notes on since this tick, place of the first of them]
    now_tick = -1
    rows = zip(
        tick.tolist(),
        events["kind"].tolist(),
        events["channel"].tolist(),
        events["a"].tolist(),
        strict=True,
    )
    for place, (at, kind, channel, a) in enumerate(rows):
        if at != now_tick:
            for key, (count, _) in now.items():
                if count:
                    started[key] = started.get(key, 0) + count
            now.clear()
            now_tick = at
        if kind == NOTE_ON:
            now.setdefault(channel << 7 | a, [0, place])[0] += 1
        elif kind == NOTE_OFF:
            key = channel << 7 | a
            if started.get(key, 0):
                started[key] -= 1
                if key in now:
                    position[place] = now[key][1] - 0.5
            elif key in now and now[key][0]:
                now[key][0] -= 1
    for key, (count, _) in now.items():
        if count:
            started[key] = started.get(key, 0) + count
    still_on = [key for key, count in sorted(started.items()) for _ in range(count)]
    return np.argsort(position, kind="stable"), [(key >> 7, key & 0x7F) for key in still_on]
