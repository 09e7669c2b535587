"""The cycle of a tanpura: when which string is plucked, and how, for as long as one likes.

A `Drone` is a source of events by absolute frame. What it gives depends on its settings and its seed, not on the pieces
in which it is asked: every stroke stands on a grid of its own time, from which the player's hand strays by bounded
amounts, so that nothing adds up over hours; and what is random about a stroke is a function of its number.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from synth.drone.pegs import Pegs, TunedStrings, jiva_of
from synth.engine import layout
from synth.instrument.preset import Preset
from synth.midi.events import EVENT, NOTE_OFF, NOTE_ON, PARAMETER, TUNING

#: limits of the settings
CYCLE_S = (1.0, 60.0)
VELOCITIES = (1, 127)
JIVA_UM = (0.0, 50.0)
#: relative gaps, and how many times the smallest the largest may be
GAPS = (0.001, 1000.0)
MOST_GAP_RATIO = 20.0
#: the gap after the kharaj, where the others are 1
LINGER = 1.6
#: time before the first stroke [s]
LEAD_S = 0.05
#: strokes stray from the grid by this part of the smallest gap (standard deviation; the bound is three times that)
JITTER = 0.04
#: the grid itself wanders: (part of a cycle, over so many cycles), at most
WANDERS = ((0.06, 23.0), (0.02, 5.0))
#: …and does so fully after so many cycles
SETTLED_AFTER = 8.0
#: standard deviations of velocity and width as parts of themselves, and of the pluck's place as a part of the string
LOUDER, WIDER, FARTHER = 0.08, 0.15, 0.012
#: glides and fades go in steps of this time [s]
STEP_S = 0.01
#: a peg turns by a semitone in this time, and by anything in no less and no more [s]
SEMITONE_S, SHORTEST_GLIDE_S, LONGEST_GLIDE_S = 0.3, 0.05, 2.0
#: silence at the end of a fade, in which levels settle [s]
SETTLE_S = 0.25
#: what is random about a stroke
TIME, VELOCITY, POSITION, WIDTH, WANDER = range(5)
_MASK = 2**64 - 1


def scrambled(seed: int, *place: int) -> int:
    """64 bits that belong to a seed and a place: SplitMix64's mixing (Steele, Lea & Flood 2014) of all."""
    z = seed & _MASK
    for number in place:
        z = (z + 0x9E3779B97F4A7C15 * (2 * number + 1)) & _MASK
        z = ((z ^ (z >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
        z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & _MASK
        z ^= z >> 31
    return z


def bell(seed: int, *place: int) -> float:
    """A number that belongs to a seed and a place, of mean 0 and standard deviation 1, never beyond ±3.

    The sum of three uniform ones, of 21 bits each.
    """
    bits = scrambled(seed, *place)
    return 2.0 * (((bits >> 43) + ((bits >> 22) & 0x1FFFFF) + ((bits >> 1) & 0x1FFFFF)) * 2.0**-21 - 1.5)


def wander(seed: int, cycle: float) -> float:
    """A smooth curve over the cycles, bounded by the sum of WANDERS' parts, that does not repeat."""
    total = 0.0
    for kind, (part, period) in enumerate(WANDERS):
        whole = math.floor(cycle / period)
        s = cycle / period - whole
        a, b = (scrambled(seed, WANDER, kind, place) * 2.0**-63 - 1.0 for place in (whole, whole + 1))
        total += part * (a + (b - a) * s * s * (3.0 - 2.0 * s))
    return total


@dataclass(frozen=True)
class Cycle:
    """How a cycle is played.

    cycle_s: its mean duration [s].  spacing: relative gaps after each string; () is an even cycle that lingers after the
    last string.  human: 0 (a machine) to 1.  velocity: mean of the strokes', 1 to 127.  seed: of what is random.
    Raises ValueError.
    """

    cycle_s: float = 5.5
    spacing: tuple[float, ...] = ()
    human: float = 0.4
    velocity: float = 64.0
    seed: int = 0

    def __post_init__(self) -> None:
        for option, value, (low, high), unit in (
            ("--cycle", self.cycle_s, CYCLE_S, " s"),
            ("--human", self.human, (0.0, 1.0), ""),
            ("--velocity", self.velocity, VELOCITIES, ""),
        ):
            if not low <= value <= high:
                raise ValueError(f"{option} must lie between {low:g} and {high:g}{unit}, got {value:g}")
        if self.spacing:
            low, high = GAPS
            for gap in self.spacing:
                if not low <= gap <= high:  # NaN fails, too
                    raise ValueError(f"--spacing must be numbers from {low:g} to {high:g}, got {gap:g}")
            least, most = min(self.spacing), max(self.spacing)
            if most > MOST_GAP_RATIO * least:
                raise ValueError(
                    f"--spacing: the largest number must be at most {MOST_GAP_RATIO:g} times the smallest, "
                    f"got {least:g} and {most:g}"
                )

    def gaps(self, strings: int) -> tuple[float, ...]:
        """Parts of the cycle that follow each of so many strings. Raises ValueError for a spacing of another length."""
        spacing = self.spacing or (*[1.0] * (strings - 1), LINGER)
        if len(spacing) != strings:
            raise ValueError(f"--spacing needs one number for each of the {strings} strings, got {len(spacing)}")
        return tuple(gap / math.fsum(spacing) for gap in spacing)

    def variation(self, stroke: int, place: float, least_gap: float) -> Variation:
        """How the stroke of a number strays, which stands at a place of the grid [cycles since the first]; least_gap: the
        smallest of `gaps`."""
        seed, human = self.seed, self.human
        grown = human * min(1.0, place / SETTLED_AFTER)
        stray = wander(seed, place)
        return Variation(
            grown * (stray + JITTER * least_gap * bell(seed, TIME, stroke)),
            grown * stray,
            1.0 + LOUDER * human * bell(seed, VELOCITY, stroke),
            FARTHER * human * bell(seed, POSITION, stroke),
            1.0 + WIDER * human * bell(seed, WIDTH, stroke),
        )


class Variation(NamedTuple):
    """How the hand strays at a stroke: `sway` from the grid, of which `wander` is the grid's own [cycles]; velocity and
    width are so many times their means, the place of plucking is so much farther [of the string]."""

    sway: float
    wander: float
    louder: float
    farther: float
    wider: float


def places(gaps: Sequence[float]) -> tuple[float, ...]:
    """Where in the cycle each string is plucked, 0 to 1, of the gaps that follow them."""
    return tuple(math.fsum(gaps[:string]) for string in range(len(gaps)))


class Drone:
    """The player: `events(until)` gives what happens before a frame of the stream, each event once.

    strings: the tuned preset.  cycle: how it is played.  start: the stream's frame at which the drone begins.
    duration_s: where it ends, faded out over the last `fade_s`; None: it does not.
    Changes (`retune`, `set_…`, `pause`) take effect from the frame up to which events have been given.
    """

    def __init__(
        self,
        strings: TunedStrings,
        cycle: Cycle,
        rate_hz: float,
        *,
        start: int = 0,
        duration_s: float | None = None,
        fade_s: float = 0.0,
    ) -> None:
        self.strings, self.cycle, self.rate_hz = strings, cycle, float(rate_hz)
        self.pegs = strings.pegs
        self.jiva_um = self._compiled_jiva_um = jiva_of(strings.preset)
        self.volume = 1.0
        self.paused = False
        self.strokes = 0
        self._gaps = cycle.gaps(len(strings.keys))
        self._places = places(self._gaps)
        self._given = self._last = start
        self._anchor_s = start / self.rate_hz + LEAD_S  # time of the grid's cycle `_anchor`
        self._anchor = 0.0
        self._soon: list[tuple] = []  # rows for the next call
        self._glides: dict[int, tuple[int, int, float, float]] = {}  # string → first frame, frames, from, to
        self._tuned = list(strings.semitones(strings.pegs))
        self._step = max(1, round(STEP_S * self.rate_hz))
        self._next_step = -(-start // self._step)
        self._fade: tuple[int, int] | None = None
        self.end: int | None = None
        if duration_s is not None:
            self.end = start + round(duration_s * self.rate_hz)
            settle = min(SETTLE_S, 0.25 * fade_s)
            self._fade_between(self.end - round(fade_s * self.rate_hz), self.end - round(settle * self.rate_hz))

    # --- changes while it plays

    @property
    def given(self) -> int:
        """The frame up to which events have been given."""
        return self._given

    def retune(self, pegs: Pegs) -> None:
        """Turn the strings to other pitches, as fast as a player turns a peg. As many strings as before."""
        if len(pegs.names) != len(self.strings.keys):
            raise ValueError(f"the drone has {len(self.strings.keys)} strings, got pegs for {len(pegs.names)}")
        self.pegs = pegs
        for string, wanted in enumerate(self.strings.semitones(pegs)):
            if wanted != self._tuned[string]:
                now = self._pitch(string, self._given)
                seconds = min(max(SEMITONE_S * abs(wanted - now), SHORTEST_GLIDE_S), LONGEST_GLIDE_S)
                self._tuned[string] = wanted
                self._glides[string] = (self._given, round(seconds * self.rate_hz), now, wanted)

    def set_jiva(self, height_um: float) -> None:
        """Put the thread at a height [µm], brought into JIVA_UM."""
        self.jiva_um = min(max(height_um, JIVA_UM[0]), JIVA_UM[1])
        self._set(layout.HEIGHT, self._compiled_jiva_um - self.jiva_um)

    def set_volume(self, gain: float) -> None:
        """Level as a factor, brought into the engine's range."""
        low, high = layout.PARAMETER_RANGES[layout.GAIN]
        self.volume = min(max(gain, low), high)
        if self._fade is None or self._given < self._fade[0]:
            self._set(layout.GAIN, self.volume)

    def set_cycle(self, cycle: Cycle) -> None:
        """Go on in another tempo or manner, without a jump, from the next stroke on."""
        gaps = cycle.gaps(len(self.strings.keys))
        due = self._due_s(self.strokes, jitter=False)
        self.cycle, self._gaps = cycle, gaps
        self._places = places(gaps)
        self._begin_at(due)

    def pause(self, paused: bool) -> None:
        """Stop plucking, or go on with the string that would have come; what sounds rings on."""
        if self.paused and not paused:
            self._begin_at(self._given / self.rate_hz)
        elif paused and not self.paused and self.strokes:
            self._soon.append((self._given, NOTE_OFF, 0, self.strings.keys[(self.strokes - 1) % len(self._gaps)], 64, 0.0))
        self.paused = paused

    # --- events

    def events(self, until: int) -> np.ndarray:
        """EVENT array, absolute frames, ascending: what happens from the last call's `until` to before this one's."""
        if self.end is not None:
            until = min(until, self.end)
        rows = self._soon + self._steps(until)
        self._soon = []
        while not self.paused and (frame := self._stroke_frame()) < until:
            rows += self._stroke(frame)
        self._given = max(self._given, until)
        rows.sort(key=lambda row: row[0])  # stable: at one frame, changes come before strokes
        return np.array(rows, EVENT) if rows else np.zeros(0, EVENT)

    def _stroke_frame(self) -> int:
        due = self._due_s(self.strokes, jitter=True)
        return max(round(due * self.rate_hz), self._last, self._given)

    def _due_s(self, stroke: int, *, jitter: bool) -> float:
        """When a stroke is due [s of the stream]."""
        cycle = self._cycle_of(stroke)
        due = self._anchor_s + (cycle - self._anchor) * self.cycle.cycle_s
        strays = self.cycle.variation(stroke, cycle, min(self._gaps))
        return due + (strays.sway if jitter else strays.wander) * self.cycle.cycle_s

    def _cycle_of(self, stroke: int) -> float:
        whole, string = divmod(stroke, len(self._places))
        return whole + self._places[string]

    def _begin_at(self, seconds: float) -> None:
        """Put the grid so that the next stroke, but for its jitter, falls on a time [s of the stream]."""
        self._anchor, self._anchor_s = self._cycle_of(self.strokes), 0.0
        self._anchor_s = seconds - self._due_s(self.strokes, jitter=False)

    def _stroke(self, frame: int) -> list[tuple]:
        cycle, number = self.cycle, self.strokes
        keys, pluck = self.strings.keys, self.strings.preset.pluck
        strays = cycle.variation(number, self._cycle_of(number), min(self._gaps))
        velocity = round(cycle.velocity * strays.louder)
        place = pluck.position + strays.farther
        width = pluck.width_mm * strays.wider
        rows: list[tuple] = []
        if number:
            rows.append((frame, NOTE_OFF, 0, keys[(number - 1) % len(keys)], 64, 0.0))
        rows.append((frame, PARAMETER, 0, layout.PLUCK_POSITION, 0, place))
        rows.append((frame, PARAMETER, 0, layout.PLUCK_WIDTH, 0, width))
        rows.append((frame, NOTE_ON, 0, keys[number % len(keys)], min(max(velocity, 1), 127), 0.0))
        self._last = frame
        self.strokes += 1
        return rows

    def _set(self, index: int, value: float) -> None:
        self._soon.append((self._given, PARAMETER, 0, index, 0, value))

    def _fade_between(self, first: int, silent: int) -> None:
        if silent > first:
            self._fade = (max(first, self._given), silent)

    def _steps(self, until: int) -> list[tuple]:
        """What changes slowly, in steps at multiples of STEP_S: glides and the fade."""
        rows: list[tuple] = []
        while (frame := self._next_step * self._step) < until:
            fading = self._fade is not None and frame >= self._fade[0]
            if not self._glides and not fading:
                # nothing moves before the fade, or at all
                target = until if self._fade is None else min(until, self._fade[0])
                self._next_step = max(self._next_step + 1, -(-target // self._step))
                continue
            for string in sorted(self._glides):
                first, frames, _, _ = self._glides[string]
                rows.append((frame, TUNING, 0, self.strings.keys[string], 1, self._pitch(string, frame)))
                if frame >= first + frames:
                    del self._glides[string]
            if fading:
                assert self._fade is not None
                first, silent = self._fade
                s = min(1.0, (frame - first) / (silent - first))
                level = self.volume * (0.5 + 0.5 * math.cos(math.pi * s)) if s < 1.0 else 0.0
                rows.append((frame, PARAMETER, 0, layout.GAIN, 0, level))
            self._next_step += 1
        return rows

    def _pitch(self, string: int, frame: int) -> float:
        """What a string's key is tuned to at a frame (MIDI number with fraction)."""
        if string not in self._glides:
            return self._tuned[string]
        first, frames, begin, wanted = self._glides[string]
        s = min(max((frame - first) / frames, 0.0), 1.0)
        return wanted if s == 1.0 else begin + (wanted - begin) * s * s * (3.0 - 2.0 * s)


def live_limits(preset: Preset) -> tuple[float, float]:
    """Lowest and highest jiva [µm] that can be reached while it sounds."""
    low, high = layout.PARAMETER_RANGES[layout.HEIGHT]
    compiled = jiva_of(preset)
    return max(JIVA_UM[0], compiled - high), min(JIVA_UM[1], compiled - low)


def other_first(pegs: Pegs, choices: Sequence[float]) -> Pegs:
    """The first string turned to the next of some swaras that it can be tuned to."""
    if pegs.first is None:
        return pegs
    at = next((i for i, ratio in enumerate(choices) if math.isclose(ratio, pegs.first)), -1)
    for k in range(1, len(choices) + 1):
        try:
            return replace(pegs, first=choices[(at + k) % len(choices)])
        except ValueError:
            continue
    return pegs
