"""The drone that a plugin plays by itself: what `synth.drone` works out, as a table of a bank (c/drone_score.h).

A stroke's time is a place in the cycle and how far the hand strays from it, its velocity and finger are factors: so pace,
loudness and tonic stay free, and the plugin does no more than multiply. A variation is worked out for every stroke of CYCLES
cycles, which then begin anew.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from synth.drone import cycle as playing
from synth.drone.cycle import Cycle
from synth.drone.pegs import Pegs, TunedStrings, tuned
from synth.engine import layout
from synth.instrument.preset import Preset
from synth.plugin.description import OwnParameter

#: cycles after which the variation begins anew: three hours of 5.5 s each
CYCLES = 2048
#: strings that there may be
MOST_STRINGS = 8
#: beats per cycle: those of a plugin as it comes, and their range
BEATS, BEATS_RANGE = 8, (1, 64)
#: the channel that it plays on, counted from 0: controllers of the others do not touch it
CHANNEL = 15
TEXTS, TEXT_BYTES = 3, 32

SCORE = np.dtype(
    [
        ("strings", "<u4"),
        ("strokes", "<u4"),
        ("parameters", "<u4"),
        ("steps", "<u4"),  # of the tonic, for which there is a tuning: semitones, the first `step_low`
        ("part", "<i4"),
        ("channel", "<i4"),
        ("position", "<i4"),  # indices of the live parameters that a stroke varies
        ("width", "<i4"),
        ("step_low", "<f8"),
        ("lead_s", "<f8"),  # before the first stroke
        ("semitone_s", "<f8"),  # a peg turns so fast
        ("step_s", "<f8"),  # …in steps of this time
        ("keys", "<i4", (MOST_STRINGS,)),
        ("places", "<f8", (MOST_STRINGS,)),  # in the cycle
    ]
)
OWN = np.dtype(
    [
        ("minimum", "<f8"),
        ("maximum", "<f8"),
        ("initial", "<f8"),
        ("curve", "<i4"),
        ("stepped", "<i4"),
        ("id", "S48"),
        ("name", "S96"),
        ("unit", "S16"),
        ("texts", f"S{TEXT_BYTES}", (TEXTS,)),  # of the values 0, 1, …
    ]
)
STROKE = np.dtype([(name, "<f8") for name in ("sway", "wander", "louder", "farther", "wider")])


@dataclass(frozen=True)
class DroneSettings:
    """What `synth export --drone` asks for: pegs as of `Pegs`, how the cycle is played, beats of the host in each."""

    sa_hz: float
    first: float | None = 1.5
    second: float | None = None
    equal: bool = False
    cents: tuple[float, ...] = ()
    cycle: Cycle = field(default_factory=Cycle)
    beats: int = BEATS

    def on(self, preset: Preset) -> PluginDrone:
        """Played on a preset. Raises ValueError for what it cannot be tuned to, or a cycle of other strings."""
        pegs = Pegs(preset, self.sa_hz, self.first, self.second, self.equal, self.cents)
        return PluginDrone(tuned(pegs), self.cycle, self.beats)


class PluginDrone:
    """A drone for a plugin; `strings.preset` is what the plugin plays.

    beats: of the host, that a cycle takes at first. Raises ValueError.
    """

    def __init__(self, strings: TunedStrings, cycle: Cycle, beats: int = BEATS) -> None:
        low, high = BEATS_RANGE
        if not low <= beats <= high:
            raise ValueError(f"--beats must lie between {low} and {high}, got {beats}")
        self.strings, self.cycle, self.beats = strings, cycle, beats
        self.gaps = cycle.gaps(len(strings.keys))
        self.steps = tuple(_steps(strings))

    def parameters(self) -> tuple[OwnParameter, ...]:
        """In the order of `enum` in c/drone_score.h."""
        linear, ratio = layout.LINEAR, layout.RATIO
        (least, most), (soft, loud) = BEATS_RANGE, playing.VELOCITIES
        when = ("off", "on", "while the host plays")
        return (
            OwnParameter("drone/mode", "Drone", "", 0.0, 2.0, 2.0, linear, when),
            OwnParameter("drone/pace", "Drone: pace", "", 0.0, 1.0, 0.0, linear, ("its own", "beats of the host")),
            OwnParameter("drone/seconds", "Drone: cycle", "s", *playing.CYCLE_S, self.cycle.cycle_s, ratio),
            OwnParameter("drone/beats", "Drone: beats in a cycle", "", least, most, self.beats, linear, whole=True),
            OwnParameter("drone/velocity", "Drone: velocity", "", soft, loud, self.cycle.velocity, linear),
            OwnParameter("drone/tonic", "Drone: Sa", "semitones", self.steps[0][0], self.steps[-1][0], 0.0, linear),
        )

    def table(self) -> bytes:
        """SCORE, then OWN for each parameter, the keys' tunings for each step of the tonic (f8), STROKE for each stroke."""
        keys, parameters = self.strings.keys, self.parameters()
        places = playing.places(self.gaps)
        score = np.zeros(1, SCORE)
        given = {
            "strings": len(keys),
            "strokes": CYCLES * len(keys),
            "parameters": len(parameters),
            "steps": len(self.steps),
            "channel": CHANNEL,
            "position": layout.PLUCK_POSITION,
            "width": layout.PLUCK_WIDTH,
            "step_low": self.steps[0][0],
            "lead_s": playing.LEAD_S,
            "semitone_s": playing.SEMITONE_S,
            "step_s": playing.STEP_S,
        }
        for name, value in given.items():
            score[name] = value
        score["keys"][0, : len(keys)], score["places"][0, : len(keys)] = keys, places
        own = np.zeros(len(parameters), OWN)
        for row, each in zip(own, parameters, strict=True):
            row["initial"] = each.default
            for name in ("minimum", "maximum", "curve", "stepped"):
                row[name] = getattr(each, name)
            for name in ("id", "name", "unit"):
                row[name] = getattr(each, name).encode()
            row["texts"][: len(each.texts)] = [text.encode() for text in each.texts]
        tunings = np.array([pitches for _, pitches in self.steps], "<f8")
        least, strokes = min(self.gaps), range(CYCLES * len(keys))
        varied = (self.cycle.variation(n, n // len(keys) + places[n % len(keys)], least) for n in strokes)
        return b"".join(each.tobytes() for each in (score, own, tunings, np.array([*varied], STROKE)))


def _steps(strings: TunedStrings) -> Iterator[tuple[float, tuple[float, ...]]]:
    """(semitones that Sa is turned by, what the keys are tuned to), as far as the strings can be tuned, ascending."""
    reached = {}
    for way in (-1, 1):
        for step in range(0, 24 * way, way):
            try:
                turned = replace(strings.pegs, sa_hz=strings.pegs.sa_hz * 2.0 ** (step / 12.0))
            except ValueError:
                break
            reached[step] = strings.semitones(turned)
    for step in sorted(reached):
        yield float(step), reached[step]
