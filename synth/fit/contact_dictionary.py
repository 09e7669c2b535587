"""What recordings are searched in, one after the other: a model, its unknowns, two grids, a dictionary of notes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from synth.fit.contact_features import SECONDS, ContactBands
from synth.fit.contact_model import ContactModel, Grid
from synth.fit.contact_search import NOTES, sobol
from synth.fit.contact_space import Space, space_of
from synth.instrument.calibration import STEPS
from synth.instrument.plan import BRIDGE

Real = NDArray[np.float64]
#: the dictionary and the first evolution look at so many seconds, and at modes up to there [Hz]
SHORT_S, COARSE_HZ = 1.2, 14000.0
#: over curved bridges only so many seconds are compared: later no two grids sound the same. At the true values the loss of
#: eleven notes is .01 to .05 over 0.8 s, .03 to .23 over 2.3 s
CURVED_S = 0.8
FIRST_STARTS = 14
#: a curved bridge has more unknowns: so many times the notes, of so many seconds
CURVED, GLANCE_S = 4, 0.4
#: after so many notes it is asked whether to go on
PULSE = 8
#: of each note of the dictionary it is also known what it is behind a waveshaper, tanh of its largest value times that
DRIVE = 2.0


def _nothing() -> None:
    pass


def shaped(sound: Real, drive: float) -> Real:
    """A sound (n,) behind a soft limit, tanh of drive times what it is over its largest value; drive 0: as it is."""
    return np.tanh(drive / max(float(np.abs(sound).max()), 1e-300) * sound) if drive else sound


class Search:
    """The notes of one string over one kind of obstacle, and a dictionary of them that all its recordings share."""

    def __init__(
        self, model: ContactModel, space: Space, *, notes: int = NOTES, starts: int = FIRST_STARTS,
        seconds: float | None = None, drive: float = 0.0,
    ) -> None:  # fmt: skip
        """drive: of a waveshaper that the notes go through (`shaped`), or 0, none."""
        self.curved = model.shape.points > 1
        self.model, self.space, self.starts, self.drive = model, space, starts, drive
        self.notes = CURVED * notes if self.curved else notes
        self.seconds = (CURVED_S if self.curved else SECONDS) if seconds is None else seconds
        self.short_s = min(SHORT_S, self.seconds)
        self.first_s = GLANCE_S if self.curved else SHORT_S
        self.coarse = model.grid(STEPS[BRIDGE]["draft"], 0.0, COARSE_HZ)
        self.fine = model.grid(STEPS[BRIDGE]["standard"], 44100.0)
        self._dictionaries: dict[tuple[bytes, float], tuple[Real, list[Real], list[Real]]] = {}
        self.evaluations = 0
        #: called now and then while notes are computed: it may raise FitCancelled
        self.pulse: Callable[[], None] = _nothing

    def powers(self, point: Real, bands: ContactBands, grid: Grid, seconds: float | None = None) -> Real:
        """(windows, B) of the note at a point of the cube, over the seconds that are compared or so many."""
        seconds = self.seconds if seconds is None else seconds
        return bands.powers(shaped(self._sound(point, grid, seconds), self.drive), grid.rate_hz, seconds)

    def _sound(self, point: Real, grid: Grid, seconds: float) -> Real:
        self.evaluations += 1
        if self.evaluations % PULSE == 0:
            self.pulse()
        return self.model.sound(self.space.stroke(point), grid, seconds + 0.05).frames

    def dictionary(self, bands: ContactBands, done: Callable[[float], None]) -> tuple[Real, list[Real], list[Real]]:
        """Points (n, d), their powers, and those behind a waveshaper; the last of bridges of one point only."""
        key = bands.edges_hz.tobytes(), bands.window_s
        if key not in self._dictionaries:
            points, rate = self._covering(), self.coarse.rate_hz
            powers: list[Real] = []
            driven: list[Real] = []
            for i, point in enumerate(points):
                if i % PULSE == 0:
                    done(i / len(points))
                sound = self._sound(point, self.coarse, self.first_s)
                powers.append(bands.powers(shaped(sound, self.drive), rate, self.first_s))
                if not self.curved:
                    driven.append(bands.powers(shaped(sound, DRIVE), rate, self.first_s))
            self._dictionaries[key] = points, powers, driven
        return self._dictionaries[key]

    def _covering(self) -> Real:
        """Points (n, d). Over a curved bridge starts must lie near in what changes the first moments: all losses
        are as the string has them, and slips within a factor of 1.7 of the hand's."""
        points = sobol(self.space.size, self.notes)
        if self.curved:
            for i, unknown in enumerate(self.space.unknowns):
                if unknown.name == "losses":
                    points[:, i] = 0.5
                elif unknown.name == "slip":
                    points[:, i] = 0.25 + 0.5 * points[:, i]
        return points


def contact_search(
    model: ContactModel,
    amplitude_m: float,
    *,
    position: float | None = None,
    notes: int = NOTES,
    starts: int = FIRST_STARTS,
) -> Search:
    """A search for notes of a model. amplitude_m: how far the string was drawn aside, or what is taken for it. position: of
    the pluck, where it is known. notes and starts: fewer are quicker, and miss more."""
    space = space_of(model.string, amplitude_m, slip_s=model.hand.slip_s, position=position)
    return Search(model, space, notes=notes, starts=starts)
