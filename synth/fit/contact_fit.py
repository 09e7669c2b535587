"""Which bridge, which thread and which place of plucking made a recorded note.

The forward model (`contact_model`) is searched as a whole (`contact_search`) on features without phases
(`contact_features`): a dictionary of notes, evolution from the best of them, least squares at the quality that carries the
promise. What comes out are heights over the amplitude of the pluck and distances over the length: a sound of unknown gain
tells no more. Each number has an interval: a jackknife over bands (Efron 1982), in which what the model misses shows, and
what a finer grid changes, times a factor that was found on other notes (`tools/contact-table`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from synth.fit.contact_damage import refuse_holes
from synth.fit.contact_dictionary import GLANCE_S, Search
from synth.fit.contact_features import HUBER_DB, ContactBands, ContactComparison, Observed, compare, huber
from synth.fit.contact_model import Bridge, ContactStroke, Grid
from synth.fit.contact_observed import seen_of
from synth.fit.contact_search import evolve, starts_of
from synth.fit.contact_space import Estimate, asked, estimates, with_inner
from synth.fit.recording import FitCancelled, FitRefused, Progress, RecordedNote, cut_note

Real = NDArray[np.float64]
#: a loss beyond that is another model's [pseudo-Huber units: 1 is 3 dB]
MOST_LOSS = 0.35
#: beyond that an answer of a bridge of one point has a warning: 20 notes over such bridges leave 0.23 at most
DOUBTFUL_LOSS = 0.25
#: of curved bridges less: a right answer had 0.11, a wrong one 0.16
MOST_LOSS_CURVED = 0.13
#: finalists whose loss is within this ratio of the best, or this much more, must agree
AS_GOOD, AS_GOOD_LOSS = 1.6, 0.01
#: within so much: height over amplitude, distance and place, all over the length
AGREED = {"height": 5e-4, "distance": 4e-4, "position": 0.01}
#: no contact is taken for it if it explains the sound nearly as well
NO_CONTACT = 1.25
#: factor and least halves of intervals, from notes that are not those of the table (tools/contact-table --set calibration)
FACTOR = 6.5
LEAST_HALF = {"height": 2e-5, "distance": 2e-5, "position": 4e-4}
#: evaluations of the first evolution and of the second, of so many finalists; draw times tried; contenders followed
_FIRST, _SECOND, _FINALISTS, _DRAWS, _CONTENDERS = 160, 240, 5, 16, 6
#: over a curved bridge the first moments are looked at from so many starts that far apart, with so many evaluations; the
#: best of them again, and so many are left; fewer finalists
_GLANCES, _APART, _GLANCE, _AGAIN, _SECOND_GLANCE, _GLANCED = 40, 0.08, 72, 14, 120, 6
_CURVED_FINALISTS = 3
#: other bridges that are tried from the answer, of so many points on an arc of so many metres (the last is flat): with less
#: than so much of the loss of one point the answer is refused
_RIVALS, _RIVAL = ((5, 10.0), (5, 5.0), (5, 2.5), (5, 1.2), (2, 5.0), (2, 1e4)), 0.6
#: a second point between the bridge's edge and the end is tried at these shares of the distance, so far below the line from
#: edge to end, in units of the depth where it is hardly touched; least squares follow from the best of so many places
_PLACES, _BELOW, _FOLLOWED = (0.3, 0.45, 0.6, 0.75), (-0.1, -0.03, 0.03, 0.1), 2
#: within that ratio of the loss, or so much more, the interval reaches that many times as far as to what they say
_AS_WELL, _AS_WELL_LOSS, _REACHED = 1.25, 0.01, 1.5
#: below that ratio, and by more than _AS_WELL_LOSS (grids differ by as much), another bridge is named in a warning
_BETTER = 0.9
#: waveshapers that are tried, tanh of the largest value times so much, from so many notes of the dictionary and the answer
_DRIVES, _SHAPED = (1.0, 2.0, 4.0), 3


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

    stroke: ContactStroke
    values: dict[str, Estimate]
    loss: float
    free_loss: float
    touching: float
    bands: ContactBands
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


def fit_note(search: Search, samples: ArrayLike, rate_hz: float, *, progress: Progress = lambda _: True) -> NoteFit:
    """The contact and the pluck of one recorded note, (n,) or (n, channels), full scale 1.

    progress: told how much is done (0 … 1); where it returns False, FitCancelled is raised. Raises FitRefused with the
    reason: what `cut_note` refuses, less than 2 s, a note that the model does not explain, starts that disagree; NoContact.
    """

    reached = 0.0

    def done(share: float) -> None:
        nonlocal reached
        reached = share
        if not progress(share):
            raise FitCancelled

    with threadpool_limits(limits=1, user_api="blas"):
        note = cut_note(samples, rate_hz)
        refuse_holes(note)
        seen = seen_of(search.model.string, note)
        search.pulse = lambda: done(reached)
        try:
            return _Fitting(search, note, seen, done).result()
        finally:
            search.pulse = lambda: None


class _Fitting:
    def __init__(self, search: Search, note: RecordedNote, seen: Observed, done: Callable[[float], None]) -> None:
        self.search, self.note, self.done = search, note, done
        self.seen = seen.first(seen.bands.windows(search.seconds))
        self.before = search.evaluations

    def _loss(self, seen: Observed, grid: Grid, seconds: float | None = None) -> Callable[[Real], float]:
        return lambda point: compare(seen, self.search.powers(point, seen.bands, grid, seconds)).loss

    def _near(self, point: Real, grid: Grid, reach: int, seconds: float | None = None) -> tuple[Observed, ContactComparison]:
        """The recording at shifts near the best one of a point."""
        seen = self.seen if seconds is None else self.seen.first(self.seen.bands.windows(seconds))
        found = compare(seen, self.search.powers(point, seen.bands, grid, seconds))
        last = len(seen.shifts_s)
        return seen.at(np.arange(max(0, found.shift - reach), min(last, found.shift + reach + 1))), found

    def result(self) -> NoteFit:
        search, seen = self.search, self.seen
        if int(seen.used.sum()) < 8:
            raise FitRefused(
                f"only {int(seen.used.sum())} bands of the note rise above the noise; record it louder, or closer"
            )
        first = seen.first(seen.bands.windows(search.first_s))
        points, powers, driven = search.dictionary(seen.bands, lambda share: self.done(0.3 * share))
        losses = np.array([compare(first, power).loss for power in powers])
        self.done(0.35)
        starts = self._glances(points, losses) if search.curved else starts_of(points, losses, search.starts)
        found = []
        for i, start in enumerate(starts):
            step = 0.02 if search.curved else 0.06
            point, loss = self._nearer(start, search.short_s, 3, step=step, most=_FIRST, seed=i + 1)
            found.append(self._squares(self._other_draws(point, loss)[0], search.coarse, rounds=6))
            self.done(0.5 + 0.15 * (i + 1) / len(starts))
        found.sort(key=lambda each: each[1])
        finalists = []
        last = _CURVED_FINALISTS if search.curved else _FINALISTS
        for i, (point, _) in enumerate(found[:last]):
            point, loss = self._nearer(point, None, 2, step=0.02, most=_SECOND, seed=i + 101)
            finalists.append(self._squares(self._other_draws(point, loss)[0], search.coarse, rounds=6))
            self.done(0.65 + 0.2 * (i + 1) / last)
        finalists = sorted([*finalists, *found], key=lambda each: each[1])
        free = self._free(points, losses)
        self.done(0.9)
        coarse, polished, others = self._settled(finalists)
        if not search.curved:
            self._refuse_shaped(*coarse, points, np.array([compare(first, power).loss for power in driven]))
        self._refuse(polished, others, free)
        self.done(0.95)
        if search.curved:
            point, beside = self._another_way(polished)
            return self._told(point, [coarse[0], *beside], free)
        rivals = self._other_bridges(*coarse)
        self.done(0.97)
        return self._told(polished[0], [coarse[0]], free, [*rivals, self._second_point(*polished)])

    def _nearer(
        self, start: Real, seconds: float | None, reach: int, *, step: float, most: int, seed: int, held: str = ""
    ) -> tuple[Real, float]:
        """Point and loss of the best that evolution finds from a start, which is among them. held: an unknown that stays."""
        search = self.search
        near, found = self._near(start, search.coarse, reach, seconds)
        inner = self._loss(near, search.coarse, seconds)
        moved = [i for i, unknown in enumerate(search.space.unknowns) if unknown.name != held]

        def whole(part: Real) -> Real:
            point = np.array(start)
            point[moved] = part
            return point

        part, loss = evolve(lambda part: inner(whole(part)), start[moved], step=step, most=most, seed=seed).best
        return (whole(part), loss) if loss < found.loss else (start, found.loss)

    def _glances(self, points: Real, losses: Real) -> Real:
        """Starts (n, d) that evolution at the first moments of the note has made better: they sound the same for longer."""
        starts = starts_of(points, losses, _GLANCES, apart=_APART)
        found = []
        for i, start in enumerate(starts):
            found.append(self._nearer(start, GLANCE_S, 2, step=0.07, most=_GLANCE, seed=i + 301, held="losses"))
            self.done(0.35 + 0.1 * (i + 1) / len(starts))
        found = sorted(found, key=lambda each: each[1])[:_AGAIN]
        again = []
        for i, (start, _) in enumerate(found):
            again.append(self._nearer(start, GLANCE_S, 2, step=0.03, most=_SECOND_GLANCE, seed=i + 401))
            self.done(0.45 + 0.05 * (i + 1) / len(found))
        ends, left = zip(*again, strict=True)
        return starts_of(np.array(ends), np.array(left), _GLANCED, apart=0.02)

    def _settled(
        self, finalists: list[tuple[Real, float]]
    ) -> tuple[tuple[Real, float], tuple[Real, float], list[tuple[Real, float]]]:
        """The answer on the coarse grid and on the fine one, and what explains the sound as well as it. finalists: the best
        first. One that is nearly as good is followed first: a valley that has not been followed to its end looks like
        another answer; and on the fine grid: the loss of the coarse one hides what tells them apart."""
        search, waiting = self.search, finalists[1:]
        least = finalists[0][1]
        coarse, polished = finalists[0], self._squares(finalists[0][0], search.fine, rounds=8)
        known = [polished]

        def contenders() -> list[tuple[Real, float]]:
            return [each for each in waiting if _as_good(each[1], least) and self._differs(polished[0], each[0]) is not None]

        for _ in range(_CONTENDERS):
            if not (others := contenders()):
                break
            waiting = [each for each in waiting if each is not others[0]]
            followed, _ = self._nearer(others[0][0], None, 1, step=0.01, most=_SECOND, seed=201)
            point, loss = self._squares(followed, search.coarse, rounds=8)
            further = self._squares(point, search.fine, rounds=8)
            known.append(further)
            if further[1] < polished[1]:
                coarse, polished = (point, loss), further
        return coarse, polished, [each for each in known if _as_good(each[1], polished[1])] + contenders()

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

    def _refuse(self, polished: tuple[Real, float], others: list[tuple[Real, float]], free: float) -> None:
        """others: what explains the sound as well."""
        point, loss = polished
        if free < NO_CONTACT * loss + AS_GOOD_LOSS:
            place = self.search.space.values(point)["position"]
            bound = 1.0 / (1.0 - place)
            raise NoContact(
                "the string hardly touches the bridge, or not at all: its height over the amplitude must exceed about "
                f"{bound:.3g} µm per mm for each mm of distance in a metre of string; strike harder for a number", bound
            )  # fmt: skip
        most = MOST_LOSS_CURVED if self.search.curved else MOST_LOSS
        if loss > most:
            raise FitRefused(
                f"no note over {_words(self.search.model.shape)} explains the sound (loss {loss:.2f}, at most "
                f"{most:g}): another obstacle, string or length, several notes, or much reverberation; "
                "check -p and --string"
            )
        for other, _ in others:
            different = self._differs(point, other)
            if different is not None:
                name, mine, value = different
                raise FitRefused(
                    f"several contacts explain the sound as well: {name} {_say(name, mine)} or {_say(name, value)}; "
                    "record a stronger stroke, or several notes over the same obstacle"
                )

    def _another_way(self, polished: tuple[Real, float]) -> tuple[Real, list[Real]]:
        """The better of two that were polished from the same start, once after some evolution, and the other: the loss over
        a curved bridge is rough, and least squares alone may end beside its minimum."""
        near, _ = self._near(polished[0], self.search.fine, 1)
        trail = evolve(self._loss(near, self.search.fine), polished[0], step=0.01, most=_FIRST, seed=301)
        other = self._squares(trail.best[0], self.search.fine, rounds=8)
        better, worse = sorted([polished, other], key=lambda each: each[1])
        return better[0], [worse[0]]

    def _other_bridges(self, point: Real, loss: float) -> list[tuple[Real, float]]:
        """Other bridges that explain the sound as well: from the point to theirs, and the ratio of the losses. Raises
        FitRefused where one explains it better: a point is a curved bridge that never curves, and a bridge of several
        points one that never touches the others."""
        model, space, search = self.search.model, self.search.space, self.search
        stroke, values, found = space.stroke(point), space.values(point), []
        for points, radius in _RIVALS:
            rival = Search(model.over(Bridge(points, points, radius)), space, seconds=search.seconds)
            # the edge stays where it was
            fallen = 0.5 * stroke.distance_m**2 / radius
            scale = space.amplitude_m * stroke.distance_m / ((1.0 - stroke.position) * model.string.length_m)
            lifted = space.point({**values, "height": values["height"] - fallen / scale})
            other, theirs = _Fitting(rival, self.note, self.seen, self.done)._squares(lifted, search.coarse, rounds=6)
            if theirs < _RIVAL * loss:
                better = f"a curved bridge of {radius:g} m" if points > 2 else "a bridge of two points"
                raise FitRefused(
                    f"{better} explains the sound better than one of a point (loss {theirs:.3f}, {loss:.3f} with a point); "
                    "give the preset's bridge more points, or use another preset"
                )
            if theirs <= max(_AS_WELL * loss, loss + _AS_WELL_LOSS):
                found.append((other - lifted, theirs / loss))
        return found

    def _second_point(self, point: Real, loss: float) -> tuple[Real, float]:
        """From the point to that of a bridge with a second point, which is looked for anywhere between edge and end, and the
        ratio of the losses: one point fits a string that touches two now and then nearly as well, at another height."""
        search, space = self.search, with_inner(self.search.space)
        rival = Search(search.model, space, seconds=search.seconds)
        fitting = _Fitting(rival, self.note, self.seen, self.done)
        value = search.space.values(point)
        best: dict[float, tuple[float, Real]] = {}
        for place, below in product(_PLACES, _BELOW):
            start = space.point({**value, "inner_place": place, "inner_height": value["height"] + below})
            left = fitting._near(start, search.fine, 0)[1].loss
            if place not in best or left < best[place][0]:
                best[place] = left, start
        found = [(point, loss)]
        for _, start in sorted(best.values(), key=lambda each: each[0])[:_FOLLOWED]:
            found.append(fitting._squares(start, search.fine, rounds=8))
        other, theirs = min(found, key=lambda each: each[1])
        return other[: search.space.size] - point, theirs / loss

    def _refuse_shaped(self, point: Real, loss: float, points: Real, driven: Real) -> None:
        """An overdriven recording compresses the loudest moments and has partials that the string did not make: notes behind
        some waveshapers are tried, the answer's and the best of the dictionary (its points, losses behind one)."""
        search = self.search
        tried: list[tuple[float, int, _Fitting, Real]] = []
        for drive in _DRIVES:
            rival = Search(search.model, search.space, seconds=search.seconds, drive=drive)
            fitting = _Fitting(rival, self.note, self.seen, self.done)
            for start in (point, *starts_of(points, driven, _SHAPED)):
                tried.append((fitting._near(start, search.coarse, 0)[1].loss, len(tried), fitting, start))
        _, _, fitting, start = min(tried)
        _, theirs = fitting._squares(start, search.coarse, rounds=6)
        if theirs < min(_RIVAL * loss, MOST_LOSS):
            raise FitRefused(
                f"the recording is overdriven: a note behind a soft limit explains it better (loss {theirs:.3f}, {loss:.3f} "
                "without); record it at a lower level, without an amplifier, saturation or a limiter"
            )

    def _told(self, point: Real, others: list[Real], free: float, rivals: Sequence[tuple[Real, float]] = ()) -> NoteFit:
        """others: what was found on the way that should be the same; rivals: how far off other bridges' answers are."""
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
        bias = sum(np.outer(point - other, point - other) for other in others)
        covariance = FACTOR**2 * (covariance + bias)
        values, warnings = estimates(space, point, covariance, LEAST_HALF), self.note.warnings
        if found.loss > DOUBTFUL_LOSS and not search.curved:
            warnings += (
                f"much of the sound is not explained (loss {found.loss:.2f}, a note over one point leaves less than "
                f"{DOUBTFUL_LOSS:g}): the bridge may have several points, and the intervals may miss the truth",
            )
        for rival, ratio in rivals:
            theirs = asked(space, np.clip(point + rival, 0.0, 1.0))
            apart = any(abs(theirs[name] - each.value) > each.half for name, each in values.items())
            better = ratio < _BETTER and (1.0 - ratio) * found.loss > _AS_WELL_LOSS
            if apart or better:
                how = "better" if better else "as well"
                said = " and ".join(f"{name} {_say(name, theirs[name])}" for name in ("height", "distance"))
                warnings += (f"a bridge of several points explains the sound {how}, with {said}: the intervals hold both",)
            covariance = covariance + _REACHED**2 * np.outer(rival, rival)
        values = estimates(space, point, covariance, LEAST_HALF)
        played = search.model.sound(space.stroke(point), grid, search.seconds)
        recorded = self.seen.level_db[found.shift]
        return NoteFit(
            space.stroke(point), values, found.loss, free, played.touching, near.bands, found.offsets_db, recorded,
            recorded - found.left_db, float(np.sqrt(np.nanmean(found.left_db**2))), search.evaluations - self.before,
            self.note.onset_s, warnings, point, normal, covariance,
        )  # fmt: skip


def _as_good(loss: float, best: float) -> bool:
    return loss <= max(AS_GOOD * best, best + AS_GOOD_LOSS)


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
