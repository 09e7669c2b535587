"""How the controls stand at a place of a song: what a player who jumps there has to be told.

Programs, bends, pressures, controllers, registered parameters (bend range, MPE zones), tunings and live parameters: of each
the last before that place, in the order in which they were set; and before them, everything that the song sets anywhere at
its power-up value. Notes are not among them, but keys that switch articulations are.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from synth.midi.controllers import ALL_NOTES_OFF, ALL_SOUND_OFF, RESET_CONTROLLERS
from synth.midi.events import BEND, CONTROL, EVENT, NOTE_OFF, NOTE_ON, PARAMETER, PRESSURE, PROGRAM, TUNING, make_events
from synth.midi.zones import CHANNELS, CONFIGURATION, LOWER, MOST_MEMBERS, UPPER, manager_of, master_of, yielded

#: controllers that choose and set registered parameters (MIDI 1.0 Detailed Specification)
DATA, DATA_FINE, NRPN_FINE, NRPN, RPN_FINE, RPN = 6, 38, 98, 99, 100, 101
DATA_STEPS = (96, 97)
_NONE = (0x7F, 0x7F)
_BEND_RANGE = (0, 0)
_ZONE = (0, CONFIGURATION)
_MANAGERS = tuple(manager_of(zone) for zone in (LOWER, UPPER))
#: pedals that hold notes: sustain, sostenuto
PEDALS = (64, 66)
#: what controllers that `RESET_CONTROLLERS` leaves alone are at power-up: volume, pan, timbre
POWER_UP = {7: 100, 10: 64, 74: 64}

#: (kind, channel, a, b, value)
Row = tuple[int, int, int, int, float]


@dataclass(frozen=True)
class PowerUp:
    """How an engine's controls stand before anything is played.

    programs: of each of the 16 channels.  parameters: (parts, N_PARAMETERS) as the presets have them.
    bindings: controller → indices of the live parameters that it sets.  mpe: it begins with a zone of all channels.
    switches: (channel, program) → keys that switch articulations of the part that plays there.
    parts: (channel, program) → the part that plays there; none: it is not known, and every program is taken for another.
    """

    programs: Sequence[int]
    parameters: np.ndarray
    bindings: dict[int, set[int]] = field(default_factory=dict)
    mpe: bool = False
    switches: Mapping[tuple[int, int], Collection[int]] = field(default_factory=dict)
    parts: Mapping[tuple[int, int], int] = field(default_factory=dict)


def controls_at(
    events: np.ndarray, end: int | None = None, *, mpe: bool = False, engine: PowerUp | None = None
) -> list[Row]:
    """How the events (EVENT) before place `end` leave the controls, each set once. mpe: a zone of all channels is there.

    engine: whose articulations keys switch; None: they switch none.
    """
    last: dict[Hashable, list[Row]] = {}
    chosen: dict[int, tuple[int, int] | None] = {}  # channel → registered parameter; None: one that is not registered
    numbers = ("kind", "channel", "a", "b", "value")
    members = [MOST_MEMBERS if mpe else 0, 0]
    part = events[:end]
    switches = {} if engine is None else engine.switches
    parts = {} if engine is None else engine.parts
    others: dict[int, Row] = {}  # of a channel: the program before its part
    programs = {} if engine is None else dict(enumerate(engine.programs))
    switching = np.isin(part["a"], [key for keys in switches.values() for key in keys]) & (part["b"] > 0)
    part = part[((part["kind"] != NOTE_ON) | switching) & (part["kind"] != NOTE_OFF)]
    zones = 0
    for row in zip(*(part[name].tolist() for name in numbers), strict=True):
        kind, c, a, b, _ = row
        key: Hashable
        rows: list[Row] = [row]
        if kind == CONTROL:
            if a in (RPN, RPN_FINE):
                most, least = chosen.get(c) or _NONE
                chosen[c] = (b, least) if a == RPN else (most, b)
                continue
            if a in (NRPN, NRPN_FINE):
                chosen[c] = None
                continue
            if a == ALL_SOUND_OFF or a >= ALL_NOTES_OFF:
                continue
            if a in (DATA, DATA_FINE, *DATA_STEPS):
                number = chosen.get(c, _NONE)
                if number is None or number == _NONE:
                    continue
                if number == _ZONE and a == DATA and c in _MANAGERS:
                    zones += 1  # each of them lets other controls begin anew, and whose bend range a channel's is changes
                    zone = _MANAGERS.index(c)
                    before = [master_of(k, *members) for k in range(CHANNELS)]
                    members[zone] = min(b, MOST_MEMBERS)
                    members[1 - zone] = yielded(members[zone], members[1 - zone])
                    for k, master in enumerate(before):
                        if master_of(k, *members) not in {master} - {c}:  # it begins anew
                            last.pop((NOTE_ON, k), None)
                key = (kind, c, a, number, zones)
                rows = [*_choice(c, number), row]
            else:
                if a == RESET_CONTROLLERS:  # of a zone's master: of its members, too
                    last.pop((NOTE_ON, c), None)
                    chosen.update({k: _NONE for k in chosen if c in (k, master_of(k, *members))})
                key = (kind, c, a)
        elif kind in (PROGRAM, BEND, PRESSURE):
            key = (kind, c)
            if kind == PROGRAM:
                stays = bool(parts) and parts.get((c, a), -1) == parts.get((c, programs.get(c, 0)), -1)
                if not stays:
                    last.pop((NOTE_ON, c), None)
                    if parts:
                        others[c] = (PROGRAM, c, programs.get(c, 0), 0, 0.0)
                programs[c] = a
                # Another part forgets what keys and controllers asked for, also where the engine has that part already.
                rows = [*([others[c]] if c in others else []), row]
                if stays and key in last:
                    last[key] = rows  # controllers that came since the part did rule on
                    continue
        elif kind == PARAMETER:
            key = (kind, c, a)
        elif kind == NOTE_ON:
            leader = master_of(c, *members)
            if a not in switches.get((leader, programs[leader]), ()):
                continue
            key, rows = (kind, leader), [(kind, leader, a, b, 0.0)]
        elif kind == TUNING:
            key = (kind, a)
        else:
            continue
        last.pop(key, None)  # it is told where it was set last
        last[key] = rows
    told = [row for rows in last.values() for row in rows]
    for c, choice in chosen.items():
        told += _choice(c, choice or _NONE)
    return told


def _choice(channel: int, number: tuple[int, int]) -> list[Row]:
    return [(CONTROL, channel, RPN, number[0], 0.0), (CONTROL, channel, RPN_FINE, number[1], 0.0)]


def power_up_rows(events: np.ndarray, engine: PowerUp) -> list[Row]:
    """What brings everything that a song (EVENT) sets anywhere to its power-up value."""
    set_anywhere = controls_at(events, mpe=engine.mpe, engine=engine)
    rows: list[Row] = []
    controllers = sorted({(c, a) for kind, c, a, _, _ in set_anywhere if kind == CONTROL})
    of_channel = (CONTROL, BEND, PRESSURE, PROGRAM, NOTE_ON)
    for c in sorted({c for kind, c, *_ in set_anywhere if kind in of_channel}):
        rows.append((CONTROL, c, RESET_CONTROLLERS, 0, 0.0))
    rows += [(CONTROL, c, a, POWER_UP[a], 0.0) for c, a in controllers if a in POWER_UP and a not in engine.bindings]
    rows += [
        (PROGRAM, c, int(engine.programs[c]), 0, 0.0) for c in sorted({c for kind, c, *_ in set_anywhere if kind == PROGRAM})
    ]
    registered = _registered(set_anywhere)
    if engine.mpe or any(number == _ZONE for _, number in registered):
        for zone in (UPPER, LOWER):
            members = MOST_MEMBERS if engine.mpe and zone == LOWER else 0
            rows += _registered_rows(manager_of(zone), _ZONE, members)
    ranged = {c for c, number in registered if number == _BEND_RANGE}
    # In a zone, its configuration has seen to its members.
    rows += [row for c in sorted(ranged) if not engine.mpe or c == 0 for row in _registered_rows(c, _BEND_RANGE, 2, 0)]
    rows += [(TUNING, 0, key, 1, np.nan) for key in sorted({a for kind, _, a, *_ in set_anywhere if kind == TUNING})]
    changed = {(p, index) for kind, p, index, *_ in set_anywhere if kind == PARAMETER}
    for _, a in controllers:
        changed |= {(p, index) for index in engine.bindings.get(a, ()) for p in range(len(engine.parameters))}
    for p, index in sorted(changed):
        if p < len(engine.parameters) and index < engine.parameters.shape[1]:
            rows.append((PARAMETER, p, index, 0, float(engine.parameters[p, index])))
    return rows


def _registered(rows: Sequence[Row]) -> set[tuple[int, tuple[int, int]]]:
    """(channel, registered parameter) of all that is set in `rows`."""
    found = set()
    chosen = [_NONE] * CHANNELS
    for kind, c, a, b, _ in rows:
        if kind != CONTROL:
            continue
        if a == RPN:
            chosen[c] = (b, chosen[c][1])
        elif a == RPN_FINE:
            chosen[c] = (chosen[c][0], b)
        elif a in (DATA, DATA_FINE):
            found.add((c, chosen[c]))
    return found


def _registered_rows(channel: int, number: tuple[int, int], value: int, fine: int | None = None) -> list[Row]:
    rows = [*_choice(channel, number), (CONTROL, channel, DATA, value, 0.0)]
    if fine is not None:
        rows.append((CONTROL, channel, DATA_FINE, fine, 0.0))
    return [*rows, *_choice(channel, _NONE)]


def let_go_rows(events: np.ndarray, first: int, end: int) -> list[Row]:
    """What ends the notes that the events of places `first` to `end` leave on, pedals included."""
    part = events[first:end]
    notes = part[(part["kind"] == NOTE_ON) | (part["kind"] == NOTE_OFF)]
    on = {
        (c, note): kind == NOTE_ON and b > 0
        for kind, c, note, b in zip(*(notes[name].tolist() for name in ("kind", "channel", "a", "b")), strict=True)
    }
    rows: list[Row] = [(NOTE_OFF, c, note, 64, 0.0) for (c, note), held in sorted(on.items()) if held]
    pedals = part[(part["kind"] == CONTROL) & np.isin(part["a"], PEDALS)]
    down = {(c, a): b for c, a, b in zip(*(pedals[name].tolist() for name in ("channel", "a", "b")), strict=True)}
    return rows + [(CONTROL, c, a, 0, 0.0) for (c, a), b in sorted(down.items()) if b]


def at_frame(rows: Sequence[Row], frame: int) -> np.ndarray:
    """Rows as events (EVENT) of one frame."""
    return make_events([(frame, *row) for row in rows]) if rows else np.zeros(0, EVENT)
