"""What becomes of notes before they are played: transposed, folded into the compass, given to another preset; and which of
them no string plays. Keys that switch articulations are no notes and stay where they are; a note that is brought onto one
switches nothing and is not played.

A note's place is settled when it begins: its end and its pressure go where it went, whatever is changed in between.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from synth.host.general_midi import answer
from synth.host.parts import Casting, Part
from synth.host.switched import Switched
from synth.midi.events import EVENT, KEY_PRESSURE, NOTE_OFF, NOTE_ON, PROGRAM
from synth.midi.programs import PROGRAMS
from synth.midi.song import Song, players
from synth.units import midi_to_note

if TYPE_CHECKING:
    from synth.instrument.preset import Preset

#: furthest that notes are transposed [semitones]
MOST_SEMITONES = 96
#: octaves up and down that are tried, nearest first
_OCTAVES = sorted(range(-10, 11), key=lambda octave: (abs(octave), octave))


@dataclass(frozen=True)
class Wishes:
    """transpose: channel (0…15; None: all others) → semitones.  fold: notes that their preset cannot play go by octaves to
    the nearest that it can; fold_programs: those of presets that a program chose do.  fallback: name of the preset that
    plays what is still left.
    """

    transpose: Mapping[int | None, int] = field(default_factory=dict)
    fold: bool = False
    fold_programs: bool = False
    fallback: str | None = None

    def semitones(self, channel: int) -> int:
        return self.transpose.get(channel, self.transpose.get(None, 0))

    def folds(self, part: Part) -> bool:
        return self.fold or (self.fold_programs and part.by_program)

    def change(self, part: Part, notes: np.ndarray, preset: Preset) -> bool:
        """Whether any of a part's notes is played otherwise than it stands there."""
        if any(self.transpose.values()) or self.fold or self.fallback is not None:
            return True
        known = playable(preset) | switches(part.played(preset))
        return self.folds(part) and not set(np.unique(notes).tolist()) <= known


@dataclass(frozen=True)
class Arrangement:
    """A song as it is played.

    events: EVENT.  casting: its parts, those of the fallback among them.  part: (n,) of every note-on, −1 for those that no
    part plays and for other events.  program: (n,) that its channel has, 0…127.  leader: (n,) channel that chose its part.
    folded: (n,) bool, note-ons that are played octaves away.  note: (n,) bool, note-ons of parts that are notes, not keys
    that switch. One that transposing has brought onto such a key stands there with velocity 0, plays and switches nothing.
    """

    events: np.ndarray
    casting: Casting
    part: np.ndarray
    program: np.ndarray
    leader: np.ndarray
    folded: np.ndarray
    note: np.ndarray


def parse_transpose(texts: Iterable[str]) -> dict[int | None, int]:
    """'-12', '3=-12,1=7' (channels 1…16) → {None: -12, 2: -12, 0: 7}. Raises ValueError."""
    chosen: dict[int | None, int] = {}
    for entry in (entry.strip() for text in texts for entry in text.split(",")):
        number, equals, semitones = entry.rpartition("=")
        try:
            value = int(semitones)
            channel = int(number) - 1 if equals else None
        except ValueError:
            raise ValueError(
                f"--transpose {entry!r} is not SEMITONES or CHANNEL=SEMITONES; write for example --transpose=-12,3=12"
            ) from None
        if channel is not None and not 0 <= channel < 16:
            raise ValueError(f"--transpose channel must be 1 to 16, got {number}; correct {entry!r}")
        if abs(value) > MOST_SEMITONES:
            raise ValueError(f"--transpose must be -{MOST_SEMITONES} to {MOST_SEMITONES} semitones, got {value}")
        chosen[channel] = value
    return chosen


def arrange(
    song: Song,
    events: np.ndarray,
    casting: Casting,
    presets: Mapping[str, Preset],
    wishes: Wishes,
    mpe: bool = False,
    bound: Collection[int] = (),
) -> Arrangement:
    """The song's `events` (those that parts play) after the wishes; without any they stay as they are, bit by bit.

    presets: of every part's name, and of the fallback's.  bound: controllers that are bound to live parameters.
    """
    by = song.players if events is song.events else players(events, mpe)
    leader, program = np.where(by >= 0, by >> 7, -1), np.where(by >= 0, by & 0x7F, -1)
    part = np.where(by >= 0, casting.program_map[leader, program], -1)
    changed = (wishes.change(each, events["a"][part == p], presets[each.preset]) for p, each in enumerate(casting.parts))
    if not any(changed):
        note = part >= 0
        for p, each in enumerate(casting.parts):
            note &= ~((part == p) & np.isin(events["a"], list(switches(each.played(presets[each.preset])))))
        return Arrangement(events, casting, part, program, leader, np.zeros(len(events), bool), note)
    switched = Switched([each.played(presets[each.preset]) for each in casting.parts], casting.program_map, mpe, bound)
    return _Arranger(casting, presets, wishes, switched).arranged(events, part, program, leader)


class _Arranger:
    def __init__(self, casting: Casting, presets: Mapping[str, Preset], wishes: Wishes, switched: Switched) -> None:
        self._wishes = wishes
        self._switched = switched
        self._presets = presets
        self._parts = list(casting.parts)
        self._map = casting.program_map.copy()
        self._casting = casting
        self._playable = [playable(presets[part.preset]) for part in casting.parts]
        self._switches = [switches(part.played(presets[part.preset])) for part in casting.parts]
        self._spare: dict[int, tuple[int, int]] = {}  # of a channel: its fallback's program and part
        self._other = frozenset() if wishes.fallback is None else playable(presets[wishes.fallback])

    def arranged(self, events: np.ndarray, part: np.ndarray, program: np.ndarray, leader: np.ndarray) -> Arrangement:
        rows: list[tuple] = []  # of EVENT
        told: list[tuple[int, int, int, int, int]] = []  # part, program, leader; whether it is folded, and a part's note
        held: dict[tuple[int, int], list[int]] = {}  # (channel, key) → notes that it has begun, oldest first
        sounding: dict[tuple[int, int], Counter[int]] = {}  # (channel, note) → keys that hold it
        latest: dict[tuple[int, int], int] = {}  # (channel, key) → note of its last beginning
        counts: Counter[int] = Counter()

        def put(
            row: tuple, p: int = -1, program: int = -1, leader: int = -1, folded: bool = False, note: bool = False
        ) -> None:
            rows.append(row)
            told.append((p, program, leader, folded, note))

        lines = zip(events.tolist(), part.tolist(), program.tolist(), leader.tolist(), strict=True)
        for row, first, its_program, its_leader in lines:
            frame, kind, channel, key, b, value = row
            self._switched.heed(row)
            if kind == NOTE_ON and b > 0:
                p, note = self._place(first, its_leader, key)
                held.setdefault((channel, key), []).append(note)
                sounding.setdefault((channel, note), Counter())[key] += 1
                latest[channel, key] = note
                switches = first >= 0 and key in self._switches[first]
                lost = not switches and p >= 0 and note in self._switches[p]
                counts[p] += 0 if switches else 1
                spare = self._spare.get(its_leader) if p != first else None
                if spare is not None:
                    put((frame, PROGRAM, its_leader, spare[0], 0, 0.0))
                folded = not switches and note != key + self._wishes.semitones(its_leader)
                row = (frame, kind, channel, note, 0 if lost else b, value)
                put(row, p, its_program, its_leader, folded, p >= 0 and not switches)
                if spare is not None:
                    put((frame, PROGRAM, its_leader, its_program, 0, 0.0))
                    for told_again in self._switched.again(its_leader, frame):  # which the fallback's program made forget
                        put(told_again, first if told_again[1] == NOTE_ON else -1, its_program, its_leader)
            elif kind in (NOTE_ON, NOTE_OFF):
                waiting = held.get((channel, key))
                note = waiting.pop(0) if waiting else key
                if waiting is not None:
                    keys = sounding.get((channel, note), Counter())
                    keys[key] -= 1
                    if any(count > 0 for other, count in keys.items() if other != key):
                        continue  # another key holds the same note
                put((frame, kind, channel, note, b, value))
            elif kind == KEY_PRESSURE:
                put((frame, kind, channel, latest.get((channel, key), key), b, value))
            else:
                put(row)
        parts = tuple(replace(each, notes=counts[p]) for p, each in enumerate(self._parts))
        of = np.array(told, np.int64).reshape(-1, 5)
        casting = replace(self._casting, parts=parts, program_map=self._map)
        return Arrangement(np.array(rows, EVENT), casting, of[:, 0], of[:, 1], of[:, 2], of[:, 3] > 0, of[:, 4] > 0)

    def _place(self, p: int, leader: int, key: int) -> tuple[int, int]:
        """(part, note) for a key. A note beyond all keys stays one, which no string plays, as does one that comes to lie on
        a key that switches."""
        if p >= 0 and key in self._switches[p]:
            return p, key
        note = key + self._wishes.semitones(leader)
        if p < 0 or note in self._playable[p]:
            return p, note
        if self._wishes.folds(self._parts[p]):
            folded = fold(note, self._playable[p])
            if folded is not None:
                return p, folded
        found = note if note in self._other else fold(note, self._other) if self._wishes.fold else None
        return (p, note) if found is None else (self._fallback(leader), found)

    def _fallback(self, leader: int) -> int:
        """The fallback's part on a channel, made when it is first needed on a program of its own."""
        if leader not in self._spare:
            name = self._wishes.fallback
            assert name is not None
            # above those in use, as a channel begins with the lowest that has a part
            free = [int(program) for program in np.flatnonzero(self._map[leader] < 0)]
            own = [p for p, part in enumerate(self._parts) if part.channel == leader and part.preset == name]
            if not own:
                own = [len(self._parts)]
                self._parts.append(Part(leader, name, 0))
                self._playable.append(playable(self._presets[name]))
                self._switches.append(switches(self._presets[name]))
            self._map[leader, free[-1]] = own[0]
            self._spare[leader] = free[-1], own[0]
        return self._spare[leader][1]


def playable(preset: Preset) -> frozenset[int]:
    """The notes that a preset can play."""
    from synth.instrument.preset import playable_notes

    return frozenset(playable_notes(preset))


def switches(preset: Preset) -> frozenset[int]:
    """The keys that switch a preset's articulations."""
    from synth.instrument.ways import switch_keys

    return frozenset(switch_keys(preset))


def fold(note: int, playable: frozenset[int]) -> int | None:
    """The nearest of the playable notes that is whole octaves away; None where there is none."""
    return next((note + 12 * octave for octave in _OCTAVES if note + 12 * octave in playable), None)


def within(events: np.ndarray, frames: slice) -> np.ndarray:
    """(n,) whether the events lie in frames start ≤ frame < stop."""
    return (events["frame"] >= frames.start) & (events["frame"] < frames.stop)


def keys_of_parts(arrangement: Arrangement, until: int) -> list[set[int]]:
    """The MIDI notes that every part has to play before a frame."""
    events, part = arrangement.events, arrangement.part
    early = events["frame"] < until
    return [set(np.unique(events["a"][early & (part == p)]).tolist()) for p in range(len(arrangement.casting.parts))]


def channel_rows(
    arrangement: Arrangement,
    presets: Mapping[str, Preset],
    frames: slice,
    fallback: str | None = None,
) -> list[dict[str, Any]]:
    """What every channel has to play in these frames, one row for each of its presets, as plain data:

    channel (1…16), programs (0…127), names of the programs, preset, notes, unplayed, low and high of the notes (names),
    unplayed_low, unplayed_high, remedies: option → how many of the unplayed it would play; folded: how many are played
    octaves away.

    fallback: the preset of that name that may be offered as a remedy.
    """
    events = arrangement.events
    heard = arrangement.note & within(events, frames)
    rows = []
    for p, part in enumerate(arrangement.casting.parts):
        mine = heard & (arrangement.part == p)
        if not mine.any():
            continue
        counts = Counter(events["a"][mine].tolist())
        can = playable(presets[part.preset])
        missed = {note: count for note, count in counts.items() if note not in can}
        programs = np.unique(arrangement.program[mine]).tolist()
        rows.append(
            {
                "channel": part.channel + 1,
                "programs": programs,
                "names": [PROGRAMS[program] for program in programs],
                "preset": part.preset,
                "notes": counts.total(),
                "low": _name(min(counts)),
                "high": _name(max(counts)),
                "unplayed": sum(missed.values()),
                "unplayed_low": _name(min(missed)) if missed else None,
                "unplayed_high": _name(max(missed)) if missed else None,
                "remedies": _remedies(part, counts, missed, can, fallback) if missed else {},
                "folded": int(arrangement.folded[mine].sum()),
            }
        )
    return rows


def _remedies(
    part: Part, counts: Counter[int], missed: Mapping[int, int], can: frozenset[int], fallback: str | None
) -> dict[str, int]:
    """Option → how many of the missed notes it plays, the best octave of a transposition first; none that help nothing."""
    from synth.instrument.preset import load_preset

    found: dict[str, int] = {}

    def played(octave: int) -> int:
        return sum(count for note, count in counts.items() if note + 12 * octave in can)

    best = max(_OCTAVES, key=lambda octave: (played(octave), -abs(octave)))
    gained = played(best) - played(0)
    if gained > 0:
        found[f"--transpose {part.channel + 1}={12 * best}"] = gained
    folded = sum(count for note, count in missed.items() if fold(note, can) is not None)
    if folded:
        found["--fold"] = folded
    if fallback is not None and fallback != part.preset:
        other = playable(load_preset(fallback))
        taken = sum(count for note, count in missed.items() if note in other)
        if taken:
            found[f"--fallback {fallback}"] = taken
    return found


def stand_ins(arrangement: Arrangement, frames: slice) -> list[dict[str, Any]]:
    """The presets that programs have chosen for what is no plucked or struck string, as plain data: preset, names of the
    programs, notes in these frames."""
    heard = arrangement.note & within(arrangement.events, frames)
    found: dict[str, Counter[int]] = {}
    for p, part in enumerate(arrangement.casting.parts):
        if part.by_program:
            programs = Counter(arrangement.program[heard & (arrangement.part == p)].tolist())
            others = {program: count for program, count in programs.items() if not answer(program).string}
            if others:
                found.setdefault(part.preset, Counter()).update(others)
    return [
        {"preset": preset, "names": [PROGRAMS[program] for program in sorted(counts)], "notes": counts.total()}
        for preset, counts in found.items()
    ]


def stand_in_line(rows: Iterable[Mapping[str, Any]]) -> str:
    """Rows of `stand_ins` for people."""
    who = "; ".join(f"{row['preset']} plays {', '.join(row['names'])} ({_notes(row['notes'])})" for row in rows)
    return f"no plucked or struck strings: {who}; --only-strings leaves them out"


def skipped_line(skipped: Iterable[Mapping[str, Any]]) -> str:
    """What --only-strings has left out, for people."""
    who = ", ".join(f"channel {row['channel']} ({row['name']}, {_notes(row['notes'])})" for row in skipped)
    return f"no plucked or struck strings, left out: {who}"


def unplayed_notes(arrangement: Arrangement, presets: Mapping[str, Preset], frames: slice) -> list[dict[str, Any]]:
    """Notes that no string plays in these frames: part (its label), note (name), count and reason of each."""
    from synth.instrument.preset import why_unplayed

    events = arrangement.events
    heard = arrangement.note & within(events, frames)
    rows = []
    for p, part in enumerate(arrangement.casting.parts):
        preset = presets[part.preset]
        can = playable(preset)
        counts = Counter(events["a"][heard & (arrangement.part == p)].tolist())
        rows += [
            {"part": part.label, "note": _name(note), "count": count, "reason": why_unplayed(preset, note)}
            for note, count in sorted(counts.items())
            if note not in can
        ]
    return rows


def unplayed_lines(unplayed: Sequence[Mapping[str, Any]], notes: int) -> list[str]:
    """What `unplayed_notes` found for people, of `notes` in all: a line for each part and reason, with the notes' names."""
    found: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for row in unplayed:
        found.setdefault((row["part"], row["reason"]), []).append(row)
    lines = []
    for (part, reason), rows in found.items():
        names = [row["note"] for row in rows]
        who = ", ".join(names[:4]) + (f" and {len(names) - 4} others" if len(names) > 4 else "")
        lines.append(f"{part}: {sum(row['count'] for row in rows)} of {_notes(notes)} not played, {who}: {reason}")
    return lines


def channel_line(row: Mapping[str, Any]) -> str:
    """A row of `channel_rows` for people."""
    names = ", ".join(row["names"][:3]) + (f" and {len(row['names']) - 3} more" if len(row["names"]) > 3 else "")
    stem = row["preset"].replace("\\", "/").rsplit("/", 1)[-1]
    who = f"channel {row['channel']} ({names}) → {stem}"
    notes = _notes(row["notes"])
    folded = f", {row['folded']} of them octaves away" if row["folded"] else ""
    if not row["unplayed"]:
        return f"{who}: {notes}, {_reach(row['low'], row['high'])}{folded}"
    remedies = [
        f"{option} plays {'them all' if count == row['unplayed'] else count}" for option, count in row["remedies"].items()
    ]
    missed = f"{row['unplayed']} of {notes} not played, {_reach(row['unplayed_low'], row['unplayed_high'])}"
    return f"{who}: {missed}{folded}: {'; '.join(remedies) or 'choose another preset with --map'}"


def _notes(count: int) -> str:
    return f"{count} note{'' if count == 1 else 's'}"


def _name(note: int) -> str:
    """The name of a note, which may have been transposed beyond all keys."""
    return midi_to_note(note) if 0 <= note <= 127 else f"key {note}"


def _reach(low: str, high: str) -> str:
    return low if low == high else f"{low} to {high}"
