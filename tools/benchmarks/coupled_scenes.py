"""What coupled instruments play here: twelve notes, chords without end, bends and vibrato, sixty strings at once."""

from __future__ import annotations

import math

import numpy as np

from benchmarks import scenes
from benchmarks.plain_coupled import PlainInstrument
from synth.host import measured_cost
from synth.instrument.preset import Preset, load_preset, playable_notes
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, make_events
from synth.solver.coupled_lines import LineArrays
from synth.solver.coupling import LENGTH, TENSION

#: frames of a block, as `measured_cost` plays, and as a player of a keyboard wants them
BLOCK, LIVE_BLOCK = measured_cost.BLOCK, 64
#: presets whose twelve notes are measured
TWELVE = ("sitar", "veena", "steel-guitar", "nylon-guitar", "double-bass", "banjo")
STRUMMED = ("steel-guitar", "nylon-guitar")
#: E, A, G and C major over all six strings, time between chords and between two strings of one [s]
CHORDS = ((40, 47, 52, 56, 59, 64), (40, 45, 52, 57, 61, 64), (43, 47, 50, 55, 59, 67), (40, 48, 52, 55, 60, 64))
CHORD_S, STRING_S = 0.4, 0.012
#: seconds of twelve notes, of chords, and of sixty strings after the last of them has been struck
TWELVE_S, STRUMMED_S, SIXTY_S = measured_cost.PLAYED_S, 4.0, 1.5
GESTURES = ("plain", "vibrato", "bend")
#: open strings that ring together while a plain loop is timed beside the engine, time between them, and how long before [s]
RINGING = {"steel-guitar": CHORDS[0], "sitar": (54, 49, 44, 37)}
RINGING_S = 0.3
#: length of a note under a gesture, time between two positions of a bend wheel, and of its whole way up and down [s]
GESTURE_S, WHEEL_S, SWING_S = 1.5, 0.004, 0.5
#: parts with sixty strings: of the sitar 13 are tarafs, which ring with those that are struck; every other is struck
SIXTY = (
    "sitar", "veena", "steel-guitar", "nylon-guitar", "banjo", "tanpura-male", "tanpura-female", "tanpura-old",
    "tanpura-clear",
)  # fmt: skip
SIXTY_STRINGS = 60


def rows_of_twelve(preset: Preset) -> list[tuple]:
    """The strokes of `measured_cost.measure_cost`: low to high, four a second, held."""
    notes = playable_notes(preset)
    count = measured_cost.STROKES
    chosen = sorted({notes[i * (len(notes) - 1) // max(1, count - 1)] for i in range(count)})
    times = np.arange(0.0, TWELVE_S, measured_cost.EVERY_S)
    return [
        (round(at * scenes.RATE_HZ), NOTE_ON, 0, chosen[k % len(chosen)], measured_cost.VELOCITY)
        for k, at in enumerate(times)
    ]


def twelve(name: str, quality: str = "standard") -> scenes.Player:
    """`synth plan NAME --measure`."""
    preset = load_preset(name)
    return _player([preset], rows_of_twelve(preset), TWELVE_S, quality)


def rows_of_chords(seconds: float) -> list[tuple]:
    """Chords on six strings, each let go as the next begins."""
    rows: list[tuple] = []
    for number in range(int(seconds / CHORD_S)):
        chord = CHORDS[number % len(CHORDS)]
        for place, note in enumerate(chord if number % 2 == 0 else chord[::-1]):
            at = number * CHORD_S + place * STRING_S
            rows.append((round(at * scenes.RATE_HZ), NOTE_ON, 0, note, 100))
            rows.append((round((at + CHORD_S - 0.01) * scenes.RATE_HZ), NOTE_OFF, 0, note, 0))
    return sorted(rows)


def strummed(name: str, seconds: float = STRUMMED_S, quality: str = "standard") -> scenes.Player:
    """Six-string chords down and up without end."""
    return _player([load_preset(name)], rows_of_chords(seconds), seconds, quality)


def struck(rows: list[tuple], parts: int) -> list[set[int]]:
    """The notes that are struck, by part."""
    found: list[set[int]] = [set() for _ in range(parts)]
    for _, kind, channel, note, *_ in rows:
        if kind == NOTE_ON:
            found[channel].add(note)
    return found


def ringing(name: str) -> scenes.Player:
    """Open strings of a preset that ring together, no finger on any; the engine has played as long as the player says."""
    rows = [(round(i * STRING_S * scenes.RATE_HZ), NOTE_ON, 0, note, 100) for i, note in enumerate(RINGING[name])]
    player = _player([load_preset(name)], rows, RINGING_S)
    player.play(LIVE_BLOCK)
    return player


def rows_of_gesture(preset: Preset, gesture: str) -> list[tuple]:
    """A note of the middle, held: plain, under a modulation wheel that is up, or a bend wheel that moves all the time."""
    notes = playable_notes(preset)
    rows: list[tuple] = [(100, NOTE_ON, 0, notes[len(notes) // 2], 100)]
    if gesture == "vibrato":
        rows.append((0, CONTROL, 0, 1, 127))
    elif gesture == "bend":
        for k in range(round(GESTURE_S / WHEEL_S)):
            value = round(8000.0 * math.sin(2.0 * math.pi * k * WHEEL_S / SWING_S))
            rows.append((round(k * WHEEL_S * scenes.RATE_HZ), BEND, 0, value))
    return sorted(rows)


def gestures(name: str) -> dict[str, scenes.Player]:
    """A note of a preset under each of `GESTURES`, all played by one engine."""
    preset = load_preset(name)
    first = _player([preset], rows_of_gesture(preset, "plain"), GESTURE_S)
    made = {each: make_events(rows_of_gesture(preset, each)) for each in GESTURES}
    return {each: scenes.Player(first.engine, events, GESTURE_S) for each, events in made.items()}


def rows_of_sixty(presets: list[Preset]) -> list[tuple]:
    """Every string that a key reaches, open, part after part."""
    rows: list[tuple] = []
    for channel, preset in enumerate(presets):
        playable = set(playable_notes(preset))
        for table in preset.string:
            if table.name and table.name.startswith("taraf"):
                continue
            assert table.notes[0] in playable
            rows.append((round(len(rows) * scenes.APART_S * scenes.RATE_HZ), NOTE_ON, channel, table.notes[0], 100))
    return rows


def sixty(seconds: float = SIXTY_S, threads: int = 1) -> scenes.Player:
    """Sixty strings on nine bridges, `seconds` after the last stroke."""
    presets = [load_preset(name) for name in SIXTY]
    rows = rows_of_sixty(presets)
    return _player(presets, rows, rows[-1][0] / scenes.RATE_HZ + seconds, threads=threads)


def difference(player: scenes.Player, plain: PlainInstrument) -> float:
    """Of the displacements of all modes, the engine's and a plain loop's: √(Σ(q − q′)²/Σq²)."""
    strings = player.engine._strings
    apart = whole = 0.0
    for k, s in enumerate(strings.bridges.strings):
        n = plain.modes[k]
        q = strings.states.items[s].q[:n]
        apart += float(np.sum((q - plain.q[k, :n]) ** 2))
        whole += float(np.sum(q**2))
    return math.sqrt(apart / whole)


def awake(player: scenes.Player) -> int:
    """How many strings of an engine move, second directions not counted."""
    engine = player.engine
    voices, strings = engine._sounding.voices, engine._bank.strings
    return int(np.count_nonzero((voices["awake"] != 0) & (strings["of_first"] == 0)))


def _player(
    presets: list[Preset], rows: list[tuple], seconds: float, quality: str = "standard", threads: int = 1
) -> scenes.Player:
    notes = struck(rows, len(presets))
    engine = scenes.engine_of(presets, quality, notes, threads, limiter=False, every_fret=False)
    return scenes.Player(engine, make_events(sorted(rows, key=lambda row: row[0])), seconds)


def plain_of(player: scenes.Player) -> PlainInstrument:
    """Strings, bridge and body of an engine with one coupled part as they now are, for a plain loop. A line that touches
    nothing, or presses without a break (`pressed_flight`), takes one step a frame, which is exact. Raises ValueError where a
    finger or hand is on a string, or a bend."""
    engine = player.engine
    sounding, strings = engine._sounding, engine._strings
    if sounding.hands["phase"].any() or sounding.motions["altered"].any():
        raise ValueError("a string is held, damped or bent; take a moment at which all ring freely")
    (coupling,) = strings.bridges.couplings
    lines = []
    for s, end in zip(strings.bridges.strings, strings.bridges.ends.items, strict=True):
        models = strings.built.flights if sounding.motions["flying"][s] else strings.models
        model, heights = models[sounding.hands["model"][s]], strings.states.items[s].eta
        n, contacts = model.modes, model.contacts.size
        ramp = -np.array(end.kick[:n])
        lines.append(
            LineArrays(
                float(end.numbers[LENGTH]), float(end.numbers[TENSION]), model.mu, np.array(model.omega[:n]),
                np.array(model.sigma[:n]), ramp, np.array(coupling.lines.direction[len(lines)]),
                np.array(model.contacts.shapes[:, :n]), np.array(end.leverage[:contacts]), np.array(heights[:contacts]),
                np.array(model.contacts.residual),
            )
        )  # fmt: skip
    steps = [int(r) if line.eta.size else 1 for r, line in zip(coupling.lines.steps, lines, strict=True)]
    modes = np.count_nonzero(coupling.body.omega)
    plain = PlainInstrument(
        lines,
        coupling.body.rows[:6, :modes].copy(),
        coupling.body.shape[:, :modes].copy(),
        coupling.body.radiation[:, :modes].copy(),
        coupling.frame,
        steps,
    )
    for k, s in enumerate(strings.bridges.strings):
        state, n = strings.states.items[s], plain.modes[k]
        plain.q[k, :n], plain.v[k, :n] = state.q[:n], state.v[:n]
    motion = coupling.body.motion
    plain.p[:], plain.p_speed[:], plain.held[:] = motion.p[:modes], motion.speed[:modes], coupling.bridge.held[0]
    plain.speed[:], plain.rest[:] = coupling.bridge.speed, coupling.bridge.rest
    return plain
