"""The action of a fretted string out of several strokes near the threshold of buzz. Experimental.

The softest stroke touches nothing: it tells the hand and what lies between string and recording. Strokes that touch nothing
and strokes that do are a bracket of the action by geometry alone; within it each stroke that touches is searched for
(`fret_search`), and two of them must agree. How far each stroke drew the string aside has to be known: a sound tells the
action over that, not the action.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from threadpoolctl import threadpool_limits

from synth.fit.contact_features import bands_of
from synth.fit.contact_group import Recording
from synth.fit.fret_features import Heard, hear
from synth.fit.fret_linear import Linear, first_linear, next_linear
from synth.fit.fret_model import RATE_HZ, FretHand, FretModel, measured_fret
from synth.fit.fret_search import Minimum, Touching, minima
from synth.fit.pitch import find_series
from synth.fit.recording import FitCancelled, FitRefused, Progress, RecordedNote, cut_note
from synth.instrument.compile import note_frequency
from synth.instrument.preset import FretsObstacle, Preset, fret_count
from synth.units import cents

#: recordings lie within so much of a note of the string, and of each other [cents]
BESIDE, TOGETHER = 40.0, 25.0
#: a stroke that touches nothing has a loss below the first, the softest below the second; one that touches above the third
TOUCHES_NOT, SOFTEST, TOUCHES = 0.6, 0.16, 0.9
#: a loss beyond that is no note over such frets
MOST_LOSS = 0.25
#: strokes of one action differ by no more [mm]; the widest interval that is an answer to each side [mm]
AGREED_MM, WIDEST_MM = 0.06, 0.1
#: strokes that touch and are searched for, the softest
SEARCHED = 2
#: least half of the interval [mm], and what an amplitude is held to be known by
LEAST_MM, AMPLITUDE_KNOWN = 0.015, 0.01
#: slip of a string that is let go at once [s], and what the hand leaves a bracket uncertain by
AT_ONCE_S, BRACKET_KNOWN = 2e-4, 0.03
#: what the search gets of room beside the bracket [mm]
_ROOM_MM = 0.05


class OutOfReach(FitRefused):
    """No stroke reaches a fret: the action exceeds `bound_mm`."""

    def __init__(self, words: str, bound_mm: float) -> None:
        super().__init__(words)
        self.bound_mm = bound_mm


@dataclass(frozen=True)
class StrokeFit:
    """What one recording says: amplitude_mm as given, whether it touches, its loss as a stroke that touches nothing, and
    if it was searched for its minimum."""

    amplitude_mm: float
    touches: bool | None
    free_loss: float
    minimum: Minimum | None


@dataclass(frozen=True)
class FretFit:
    """One action. action_mm with half of its 95 % interval, of which fit_half_mm is the fit's and the rest the amplitudes';
    low_mm and high_mm: the bracket that strokes leave by geometry; valley_mm: what a percent of amplitude is worth."""

    preset: Preset
    string: int
    fret: int
    counted_at: int
    action_mm: float
    half_mm: float
    fit_half_mm: float
    low_mm: float
    high_mm: float
    valley_mm: float
    position: float
    position_known: bool
    strokes: tuple[StrokeFit, ...]
    warnings: tuple[str, ...]


def fit_frets(
    recordings: Sequence[Recording],
    preset: Preset,
    index: int,
    amplitudes_mm: Sequence[float],
    *,
    position: float | None = None,
    progress: Progress = lambda _: True,
) -> FretFit:
    """The action that string `index` of a preset sounds over in several recordings of one note, [(samples, rate)].

    amplitudes_mm  how far the open string was drawn aside in each, as `pluck.displacement_mm` counts it
    position       of the pluck from the saddle, as a share of the open length, if it is known
    progress       told how much is done (0 … 1); where it returns False, FitCancelled is raised
    Raises FitRefused with the reason, OutOfReach where no stroke touches; ValueError for what cannot be fitted.
    """
    if len(recordings) < 2:
        raise ValueError(f"frets need two recordings or more, soft and louder ones, got {len(recordings)}")
    if len(amplitudes_mm) != len(recordings):
        raise ValueError(
            f"frets need an amplitude for each of the {len(recordings)} recordings, got {len(amplitudes_mm)}; "
            "give --amplitude once for each, in their order"
        )
    for each in amplitudes_mm:
        if not (math.isfinite(each) and 0.01 <= each <= 40.0):
            raise ValueError(f"an amplitude must lie between 0.01 and 40 mm, got {each:g}")
    if position is not None and not 0.05 <= position <= 0.5:
        raise ValueError(f"the place of plucking must lie between 0.05 and 0.5 of the length over frets, got {position:g}")
    FretModel(preset, index)  # that there are frets
    with threadpool_limits(limits=1, user_api="blas"):
        notes = [cut_note(samples, rate) for samples, rate in recordings]
        fret, beside = _fret_of(preset, index, notes)
        model = FretModel(preset, index, fret, beside if abs(beside) > 3.0 else 0.0)
        return _Fitting(model, notes, list(amplitudes_mm), position, progress).result(preset, index)


def _fret_of(preset: Preset, index: int, notes: Sequence[RecordedNote]) -> tuple[int, float]:
    """At which fret the recordings are stopped, and by how much they are sharp [cents]. Raises FitRefused."""
    table = preset.string[index]
    found = []
    for number, note in enumerate(notes, start=1):
        try:
            series = find_series(note, moved_cents=30.0)
        except FitRefused as error:
            raise FitRefused(f"recording {number}: {error}") from None
        found.append(series.first_partial_hz)
    for number, hz in enumerate(found[1:], start=2):
        if abs(cents(hz, found[0])) > TOGETHER:
            raise FitRefused(
                f"the recordings must be of one note, got {found[0]:.4g} Hz in recording 1 and {hz:.4g} Hz "
                f"in recording {number}"
            )
    hz = sorted(found)[len(found) // 2]
    opened = note_frequency(preset, table, table.notes[0], None)
    fret = round(cents(hz, opened) / 100.0)
    beside = cents(hz, opened) - 100.0 * fret
    if not 0 <= fret <= fret_count(preset, table) or abs(beside) > BESIDE:
        raise FitRefused(
            f"the recordings must be a note of string {index}, {opened:.4g} Hz or a fret of it within {BESIDE:g} cents, got "
            f"{hz:.4g} Hz; choose another --string"
        )
    return fret, beside


class _Fitting:
    def __init__(
        self,
        model: FretModel,
        notes: list[RecordedNote],
        amplitudes: list[float],
        position: float | None,
        progress: Progress,
    ) -> None:
        self.model, self.amplitudes, self.position, self.progress = model, amplitudes, position, progress
        bands = bands_of(model.string, min(RATE_HZ, min(note.rate_hz for note in notes)))
        self.heard: list[Heard] = []
        for number, note in enumerate(notes, start=1):
            try:
                self.heard.append(hear(note, bands))
            except FitRefused as error:
                raise FitRefused(f"recording {number}: {error}") from None
        self.warnings = [f"recording {i}: {words}" for i, note in enumerate(notes, start=1) for words in note.warnings]
        self.order = sorted(range(len(notes)), key=lambda i: amplitudes[i])

    def _pulse(self, begin: float, end: float) -> Callable[[float], None]:
        def pulse(share: float) -> None:
            if not self.progress(begin + (end - begin) * share):
                raise FitCancelled

        return pulse

    def result(self, preset: Preset, index: int) -> FretFit:
        softest = self.order[0]
        first = first_linear(self.model, self.heard[softest], self.amplitudes[softest], self.position, self._pulse(0.0, 0.3))
        if first.compared.loss > SOFTEST:
            raise FitRefused(
                f"recording {softest + 1}, the softest, must not touch any fret, but no such stroke explains it (loss "
                f"{first.compared.loss:.2f}, at most {SOFTEST:g}): record a softer one, or say with --pluck-at where it was "
                "plucked"
            )
        touches: dict[int, bool | None] = {softest: False}
        losses, hands = {softest: first.compared.loss}, {softest: first.hand}
        for i in self.order[1:]:
            hands[i], losses[i] = next_linear(self.model, self.heard[i], self.amplitudes[i], first)
            touches[i] = True if losses[i] > TOUCHES else False if losses[i] < TOUCHES_NOT else None
            if touches[i] is None:
                self.warnings.append(f"recording {i + 1} may or may not touch a fret; it is left out")
        low, high = self._bracket(touches, hands, first)
        touching = [i for i in self.order if touches[i]]
        said = f"between about {low:.2f} and {high:.2f} mm, judging by which strokes touch"
        if len(touching) < SEARCHED:
            raise FitRefused(
                f"the action lies {said}: for a number {SEARCHED} recordings must touch the frets, got {len(touching)}; "
                "record more, a little above the onset of buzz"
            )
        chosen = touching[:SEARCHED]
        if len(touching) > SEARCHED:
            self.warnings.append("only the two softest of the strokes that touch are used")
        least = {i: self._searched(i, first, low, high, n) for n, i in enumerate(chosen)}
        self._refuse(least, said)
        return self._told(preset, index, first, least, touches, losses, low, high)

    def _bracket(self, touches: dict[int, bool | None], hands: dict[int, FretHand], first: Linear) -> tuple[float, float]:
        """Actions between which the strokes leave it [mm]."""
        low, high = 0.02, math.inf
        top = 4.0 * max(self.amplitudes) + 2.0
        for i in self.order:
            if touches[i] is None:
                continue
            # a stroke that touches nothing has shown its hand; of others it is only known that a string let go at once
            # swings furthest
            hand = replace(first.hand, slip_s=AT_ONCE_S) if touches[i] else hands[i]
            reached = self.model.reached_mm(self.amplitudes[i], hand, 0.02, top)
            if touches[i]:
                high = min(high, reached * (1.0 + BRACKET_KNOWN))
            else:
                low = max(low, reached * (1.0 - BRACKET_KNOWN))
        if high == math.inf:
            raise OutOfReach(
                f"no stroke touches a fret: the action must exceed about {low:.2f} mm; strike harder for a number", low
            )
        if low > high:
            raise FitRefused(
                f"the recordings contradict each other: one touches nothing, so the action exceeds {low:.2f} mm, but "
                f"another touches, so the action is below {high:.2f} mm; check the amplitudes"
            )
        return low, high

    def _searched(self, i: int, first: Linear, low: float, high: float, number: int) -> Minimum:
        stroke = Touching(self.heard[i], self.amplitudes[i], max(0.02, low - _ROOM_MM), high + _ROOM_MM)
        begin = 0.35 + 0.3 * number
        try:
            found = minima(self.model, stroke, first.hand, first.between, self._pulse(begin, begin + 0.3))[0]
        except FitRefused as error:
            raise FitRefused(f"recording {i + 1}: {error}") from None
        if found.loss > MOST_LOSS:
            raise FitRefused(
                f"recording {i + 1}: no stroke over such frets explains it (loss {found.loss:.2f}, at most {MOST_LOSS:g}); "
                f"the action lies between about {low:.2f} and {high:.2f} mm, judging by which strokes touch. Hard strikes "
                "are chaotic: record softer ones, and check amplitudes and the place of plucking"
            )
        return found

    def _refuse(self, found: dict[int, Minimum], said: str) -> None:
        (a, one), (b, other) = found.items()
        if abs(one.action_mm - other.action_mm) > AGREED_MM:
            raise FitRefused(
                f"the recordings must agree on one action, got {one.action_mm:.2f} mm in recording {a + 1} and "
                f"{other.action_mm:.2f} mm in recording {b + 1} (it lies {said}); check their amplitudes"
            )

    def _told(
        self, preset: Preset, index: int, first: Linear, found: dict[int, Minimum], touches: dict[int, bool | None],
        losses: dict[int, float], low: float, high: float,
    ) -> FretFit:  # fmt: skip
        halves = [max(LEAST_MM, each.high_mm - each.action_mm, each.action_mm - each.low_mm) for each in found.values()]
        weights = [1.0 / half**2 for half in halves]
        actions = [each.action_mm for each in found.values()]
        action = sum(w * a for w, a in zip(weights, actions, strict=True)) / sum(weights)
        fit_half = max(1.0 / math.sqrt(sum(weights)), *(abs(each - action) for each in actions), LEAST_MM)
        last = self.amplitudes[max(found)]
        top = 4.0 * max(self.amplitudes) + 2.0
        more, less = (self.model.reached_mm(last * each, first.hand, 0.02, top) for each in (1.03, 0.97))
        valley = (more - less) / 6.0
        half = math.hypot(fit_half, 100.0 * AMPLITUDE_KNOWN * valley)
        if half > WIDEST_MM:
            raise FitRefused(
                f"the sound tells the action to ± {half:.2f} mm only ({action:.2f} mm; at most ± {WIDEST_MM:g} mm); record "
                "strokes a little above where buzz begins, or stop the string at a fret"
            )
        self._pulse(0.0, 1.0)(1.0)
        shape = preset.obstacle
        assert isinstance(shape, FretsObstacle)
        strokes = tuple(
            StrokeFit(self.amplitudes[i], touches[i], losses[i], found.get(i)) for i in range(len(self.amplitudes))
        )
        return FretFit(
            preset, index, self.model.fret, measured_fret(shape), action, half, fit_half, low, high, valley,
            first.hand.position, self.position is not None, strokes, tuple(self.warnings),
        )  # fmt: skip
