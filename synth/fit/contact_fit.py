"""Which bridge, which thread and which place of plucking made a recorded note.

The forward model (`contact_model`) is searched as a whole (`contact_search`) on features without phases
(`contact_features`): a dictionary of notes, evolution from the best of them, least squares at the quality that carries the
promise. What comes out are heights over the amplitude of the pluck and distances over the length: a sound of unknown gain
tells no more. Each number has an interval: a jackknife over bands (Efron 1982), in which what the model misses shows, and
what a finer grid changes, times a factor that was found on other notes (`tools/contact-table`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from synth.fit.contact_features import (
    HUBER_DB,
    SECONDS,
    Bands,
    Compared,
    Observed,
    bands_of,
    compare,
    huber,
    observe,
)
from synth.fit.contact_model import Bridge, ContactModel, Grid, Stroke
from synth.fit.contact_search import NOTES, evolve, sobol, starts_of
from synth.fit.contact_space import Estimate, Space, asked, estimates, space_of
from synth.fit.recording import FitCancelled, FitRefused, Note, Progress, cut_note
from synth.instrument.calibration import STEPS
from synth.instrument.plan import BRIDGE

Real = NDArray[np.float64]
#: notes must last that long [s]
LEAST_S = 2.0
#: a loss beyond that is another model's [pseudo-Huber units: 1 is 3 dB]
MOST_LOSS = 0.35
#: finalists whose loss is within this ratio of the best, or this much more, must agree
AS_GOOD, AS_GOOD_LOSS = 1.6, 0.01
#: within so much: height over amplitude, distance and place, all over the length
AGREED = {"height": 5e-4, "distance": 4e-4, "position": 0.01}
#: no contact is taken for it if it explains the sound nearly as well
NO_CONTACT = 1.25
#: factor and least halves of intervals, from notes that are not those of the table (tools/contact-table --calibrate)
FACTOR = 5.0
LEAST_HALF = {"height": 2e-5, "distance": 2e-5, "position": 4e-4}
#: the dictionary and the first evolution look at so many seconds, and at modes up to there [Hz]
SHORT_S, COARSE_HZ = 1.2, 14000.0
_FIRST, _FIRST_STARTS = 160, 14
#: a curved bridge has more unknowns: so many times the notes and the starts
_CURVED = 2
_DRAWS = 16
_SECOND, _FINALISTS, _CONTENDERS = 240, 5, 3


@dataclass(frozen=True)
class NoteFit:
    """What one note says.

    stroke     the note that fits best, heights and displacement at the amplitude that was taken
    values     by name: `height`, `distance`, `position` over amplitude and length
    losses, draw_s   what was in the way
    loss       mean pseudo-Huber loss; 1 is about 3 dB
    free_loss  of the best note that touches nothing
    touching   share of the time in contact
    offsets_db (B,) of the bands; NaN: not used
    recorded_db, model_db (windows, B) levels, the model's with offsets and noise
    spread_db  rms of what is left
    """

    stroke: Stroke
    values: dict[str, Estimate]
    loss: float
    free_loss: float
    touching: float
    bands: Bands
    offsets_db: Real
    recorded_db: Real
    model_db: Real
    spread_db: float
    evaluations: int
    onset_s: float
    warnings: tuple[str, ...]
    point: Real = field(repr=False)
    normal: Real = field(repr=False)
    covariance: Real = field(repr=False)


class NoContact(FitRefused):
    """The string touches nothing; `bound` is what its height over the amplitude, times L/d, must exceed."""

    def __init__(self, words: str, bound: float) -> None:
        super().__init__(words)
        self.bound = bound


class Search:
    """The notes of one string over one kind of obstacle, and a dictionary of them that all its recordings share."""

    def __init__(self, model: ContactModel, space: Space, *, notes: int = NOTES, starts: int = _FIRST_STARTS) -> None:
        more = _CURVED if model.shape.points > 1 else 1
        self.model, self.space, self.notes, self.starts = model, space, more * notes, starts + 2 * (more - 1)
        self.second = _SECOND * more
        self.coarse = model.grid(STEPS[BRIDGE]["draft"], 0.0, COARSE_HZ)
        self.fine = model.grid(STEPS[BRIDGE]["standard"], 44100.0)
        self._dictionaries: dict[tuple[bytes, float], tuple[Real, list[Real]]] = {}
        self.evaluations = 0

    def powers(self, point: Real, bands: Bands, grid: Grid, seconds: float = SECONDS) -> Real:
        """(windows, B) of the note at a point of the cube."""
        self.evaluations += 1
        sound = self.model.sound(self.space.stroke(point), grid, seconds + 0.05).frames
        return bands.powers(sound, grid.rate_hz, seconds)

    def dictionary(self, bands: Bands, done: Callable[[float], None]) -> tuple[Real, list[Real]]:
        """Points (n, d) and their powers."""
        key = bands.edges_hz.tobytes(), bands.window_s
        if key not in self._dictionaries:
            points, powers = sobol(self.space.size, self.notes), []
            for i, point in enumerate(points):
                if i % 8 == 0:
                    done(i / len(points))
                powers.append(self.powers(point, bands, self.coarse, SHORT_S))
            self._dictionaries[key] = points, powers
        return self._dictionaries[key]


def contact_search(
    model: ContactModel,
    amplitude_m: float,
    *,
    position: float | None = None,
    notes: int = NOTES,
    starts: int = _FIRST_STARTS,
) -> Search:
    """A search for notes of a model. amplitude_m: how far the string was drawn aside, or what is taken for it. position: of
    the pluck, where it is known. notes and starts: fewer are quicker, and miss more."""
    space = space_of(model.string, amplitude_m, slides=model.hand.slides, position=position)
    return Search(model, space, notes=notes, starts=starts)


def fit_note(search: Search, samples: ArrayLike, rate_hz: float, *, progress: Progress = lambda _: True) -> NoteFit:
    """The contact and the pluck of one recorded note, (n,) or (n, channels), full scale 1.

    progress: told how much is done (0 … 1); where it returns False, FitCancelled is raised. Raises FitRefused with the
    reason: what `cut_note` refuses, less than 2 s, a note that the model does not explain, starts that disagree; NoContact.
    """

    def done(share: float) -> None:
        if not progress(share):
            raise FitCancelled

    with threadpool_limits(limits=1, user_api="blas"):
        note = cut_note(samples, rate_hz)
        seen = seen_of(search, note, samples)
        return _Fitting(search, note, seen, done).result()


def seen_of(search: Search, note: Note, samples: ArrayLike) -> Observed:
    """Features of a note with some of what stands before it. Raises FitRefused where it is too short."""
    seconds = note.samples.size / note.rate_hz
    if seconds < LEAST_S:
        raise FitRefused(
            f"the note must last at least {LEAST_S:g} s for its contact, got {seconds:.2g} s; let it ring longer"
        )
    bands = bands_of(search.model.string, note.rate_hz)
    before = note.before if note.before.size > 0.15 * note.rate_hz else None
    noise = quiet_power(note.samples, note.rate_hz, bands) if before is None else bands.powers(
        before, note.rate_hz, before.size / note.rate_hz
    ).mean(axis=0)  # fmt: skip
    # silence of numbers is no noise
    floor = 1e-9 * float(bands.powers(note.samples, note.rate_hz, 0.2).max())
    whole = np.concatenate([note.before, note.samples])
    return observe(whole, note.rate_hz, note.before.size, bands, np.maximum(noise, floor))


def quiet_power(x: Real, rate_hz: float, bands: Bands) -> Real:
    """(B,) power of the noise from what lies between the partials, towards the end of a note."""
    size = round(bands.window_s * rate_hz)
    padded = 2 ** math.ceil(math.log2(size))
    count = min(40, (x.size // 2) // size)
    tail = x[x.size - count * size :].reshape(count, size) * np.hanning(size)
    power = 2.0 * np.abs(np.fft.rfft(tail, padded)) ** 2 / np.sum(np.hanning(size) ** 2)
    first = np.ceil(bands.edges_hz * padded / rate_hz).astype(np.int64)
    found = []
    for low, high in pairwise(first):
        # the fifth part of what is distributed exponentially lies below 0.22 of its mean
        quiet = np.quantile(power[:, low:high], 0.2, axis=1) / 0.223
        found.append(float(np.median(quiet)) * (high - low) / padded)
    return np.array(found)


class _Fitting:
    def __init__(self, search: Search, note: Note, seen: Observed, done: Callable[[float], None]) -> None:
        self.search, self.note, self.seen, self.done = search, note, seen, done
        self.before = search.evaluations

    def _loss(self, seen: Observed, grid: Grid, seconds: float = SECONDS) -> Callable[[Real], float]:
        return lambda point: compare(seen, self.search.powers(point, seen.bands, grid, seconds)).loss

    def _near(self, point: Real, grid: Grid, reach: int, seconds: float = SECONDS) -> tuple[Observed, Compared]:
        """The recording at shifts near the best one of a point."""
        seen = self.seen.first(self.seen.bands.windows(seconds))
        found = compare(seen, self.search.powers(point, seen.bands, grid, seconds))
        last = len(seen.shifts_s)
        return seen.at(np.arange(max(0, found.shift - reach), min(last, found.shift + reach + 1))), found

    def result(self) -> NoteFit:
        search, seen = self.search, self.seen
        if int(seen.used.sum()) < 8:
            raise FitRefused(
                f"only {int(seen.used.sum())} bands of the note stand out of the noise; record it louder, or nearer"
            )
        short = seen.first(seen.bands.windows(SHORT_S))
        points, powers = search.dictionary(seen.bands, lambda share: self.done(0.3 * share))
        losses = np.array([compare(short, power).loss for power in powers])
        self.done(0.35)
        found = []
        for i, start in enumerate(starts_of(points, losses, search.starts)):
            near, _ = self._near(start, search.coarse, 3, SHORT_S)
            trail = evolve(self._loss(near, search.coarse, SHORT_S), start, most=_FIRST, seed=i + 1)
            point, _ = self._other_draws(*trail.best)
            found.append(self._squares(point, search.coarse, rounds=6))
            self.done(0.35 + 0.3 * (i + 1) / search.starts)
        found.sort(key=lambda each: each[1])
        finalists = []
        for i, (point, _) in enumerate(found[:_FINALISTS]):
            near, _ = self._near(point, search.coarse, 2)
            trail = evolve(self._loss(near, search.coarse), point, step=0.02, most=search.second, seed=i + 101)
            finalists.append(self._squares(self._other_draws(*trail.best)[0], search.coarse, rounds=6))
            self.done(0.65 + 0.2 * (i + 1) / _FINALISTS)
        finalists = sorted([*finalists, *found], key=lambda each: each[1])
        free = self._free(points, losses)
        self.done(0.9)
        coarse, polished = finalists[0], self._squares(finalists[0][0], search.fine, rounds=8)
        for other in self._contenders(polished[0], finalists):
            # a valley that has not been followed to its end looks like another answer
            near, _ = self._near(other[0], search.coarse, 1)
            trail = evolve(self._loss(near, search.coarse), other[0], step=0.01, most=search.second, seed=201)
            point, loss = self._squares(trail.best[0], search.coarse, rounds=8)
            finalists = [each for each in finalists if each is not other] + [(point, loss)]
            further = self._squares(point, search.fine, rounds=8)
            if further[1] < polished[1]:
                coarse, polished = (point, loss), further
        self._refuse(polished, finalists, free)
        self.done(0.97)
        return self._told(polished[0], coarse[0], free)

    def _contenders(
        self, point: Real, finalists: list[tuple[Real, float]], most: int = _CONTENDERS
    ) -> list[tuple[Real, float]]:
        """Those of the finalists that are nearly as good as the best and differ from a point, at most so many."""
        limit = max(AS_GOOD * finalists[0][1], finalists[0][1] + AS_GOOD_LOSS)
        return [each for each in finalists if each[1] <= limit and self._differs(point, each[0]) is not None][:most]

    def _differs(self, point: Real, other: Real) -> tuple[str, float, float] | None:
        """What two points differ in by more than agreement allows, and both values of it; None: nothing."""
        theirs = asked(self.search.space, other)
        for name, mine in asked(self.search.space, point).items():
            if abs(theirs[name] - mine) > AGREED[name]:
                return name, mine, theirs[name]
        return None

    def _other_draws(self, point: Real, loss: float) -> tuple[Real, float]:
        """The same with the draw time that fits best: it has minima a period apart."""
        at = self.search.space.index("draw")
        best = point, loss
        function = self._loss(self.seen, self.search.coarse)
        for share in np.linspace(0.0, 1.0, _DRAWS):
            other = np.array(point)
            other[at] = share
            found = function(other)
            if found < best[1]:
                best = other, found
        return best

    def _squares(self, point: Real, grid: Grid, *, rounds: int) -> tuple[Real, float]:
        """Least squares of the residuals (Gauss–Newton within the cube) from a point: (point, loss)."""
        from scipy.optimize import least_squares

        best, shift = point, -1
        for _ in range(2):
            near, found = self._near(best, grid, 0)
            if found.shift == shift:
                break
            shift = found.shift
            best = least_squares(
                lambda each, near=near: self._residuals(each, near, grid),
                np.clip(best, 1e-6, 1.0 - 1e-6), bounds=(0.0, 1.0), diff_step=2e-3, max_nfev=rounds, xtol=1e-5, ftol=1e-4,
            ).x  # fmt: skip
        _, found = self._near(best, grid, 0)
        return best, found.loss

    def _residuals(self, point: Real, near: Observed, grid: Grid) -> Real:
        left = compare(near, self.search.powers(point, near.bands, grid)).left_db[:, near.used] / HUBER_DB
        return np.asarray(np.sign(left) * np.sqrt(huber(left)))[...].ravel()

    def _free(self, points: Real, losses: Real) -> float:
        """Loss of the best note that touches nothing."""
        space = self.search.space
        fixed = space.index("height")
        loose = np.flatnonzero(points[:, fixed] > 0.8)
        best = np.array(points[loose[np.argmin(losses[loose])]])
        best[fixed] = 1.0
        others = [i for i, u in enumerate(space.unknowns) if u.name not in ("height", "distance")]
        near, _ = self._near(best, self.search.coarse, 4)
        inner = self._loss(near, self.search.coarse)

        def function(part: Real) -> float:
            whole = np.array(best)
            whole[others] = part
            return inner(whole)

        return evolve(function, best[others], step=0.15, most=160).best[1]

    def _refuse(self, polished: tuple[Real, float], finalists: list[tuple[Real, float]], free: float) -> None:
        point, loss = polished
        if free < NO_CONTACT * loss + AS_GOOD_LOSS:
            place = self.search.space.values(point)["position"]
            bound = 1.0 / (1.0 - place)
            raise NoContact(
                "the string hardly touches the bridge, or not at all: its height over the amplitude must exceed about "
                f"{bound:.3g} µm per mm for each mm of distance in a metre of string; strike harder for a number", bound
            )  # fmt: skip
        if loss > MOST_LOSS:
            raise FitRefused(
                f"no note over {_words(self.search.model.shape)} explains the sound (loss {loss:.2f}, at most "
                f"{MOST_LOSS:g}): another obstacle, string or length, several notes, or much reverberation; "
                "check -p and --string"
            )
        best = min(each[1] for each in finalists)
        for other, other_loss in finalists:
            different = self._differs(point, other)
            if other_loss <= max(AS_GOOD * best, best + AS_GOOD_LOSS) and different is not None:
                name, mine, value = different
                raise FitRefused(
                    f"several contacts explain the sound as well: {name} {_say(name, mine)} or {_say(name, value)}; "
                    "record a stronger stroke, or several notes over the same obstacle"
                )

    def _told(self, point: Real, coarse: Real, free: float) -> NoteFit:
        search, space, grid = self.search, self.search.space, self.search.fine
        near, found = self._near(point, grid, 0)
        rows = self._residuals(point, near, grid)
        steps = np.where(point > 0.99, -2e-3, 2e-3)
        jacobian = np.stack(
            [
                (self._residuals(point + step * np.eye(space.size)[i], near, grid) - rows) / step
                for i, step in enumerate(steps)
            ],
            axis=1,
        )
        normal, covariance = _jackknife(jacobian, rows, int(near.used.sum()))
        bias = np.outer(point - coarse, point - coarse)
        covariance = FACTOR**2 * (covariance + bias)
        values = estimates(space, point, covariance, LEAST_HALF)
        played = search.model.sound(space.stroke(point), grid, SECONDS)
        recorded = self.seen.level_db[found.shift]
        return NoteFit(
            space.stroke(point), values, found.loss, free, played.touching, near.bands, found.offsets_db, recorded,
            recorded - found.left_db, float(np.sqrt(np.nanmean(found.left_db**2))), search.evaluations - self.before,
            self.note.onset_s, self.note.warnings, point, normal, covariance,
        )  # fmt: skip


def _jackknife(jacobian: Real, rows: Real, bands: int) -> tuple[Real, Real]:
    """JᵀJ, and the covariance of the unknowns by leaving out one band after the other, to first order."""
    size = jacobian.shape[1]
    by_band = jacobian.reshape(-1, bands, size).transpose(1, 0, 2)
    left = rows.reshape(-1, bands).T
    normals = np.einsum("bwi,bwj->bij", by_band, by_band)
    pulls = np.einsum("bwi,bw->bi", by_band, left)
    normal, pull = normals.sum(axis=0), pulls.sum(axis=0)
    ridge = 1e-9 * float(np.trace(normal)) * np.eye(size)
    moved = np.linalg.solve(normal + ridge - normals, (pull - pulls)[..., None])[..., 0]
    moved = moved - moved.mean(axis=0)
    return normal, (bands - 1) / bands * moved.T @ moved


def _say(name: str, value: float) -> str:
    if name == "height":
        return f"{1e3 * value:.2f} µm per mm"
    return f"{value:.4f} of the length"


def _words(shape: Bridge) -> str:
    return "a bridge of one point" if shape.points == 1 else f"a curved bridge of {shape.points} points"
