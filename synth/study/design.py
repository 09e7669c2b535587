"""The rows of a study, one after the other: a row is made when it is asked for, so that there may be millions."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from functools import cached_property
from itertools import accumulate
from typing import Any

from synth.study.studyfile import BlockTable, Study, canonical, listed
from synth.study.values import plain_of

#: of settings that say how a case is computed and not what is asked; references do not follow them
NUMERICAL = {
    "quality", "run.internal_rate_hz", "run.modes", "run.ledger", "scheme.name", "scheme.restitution",
    "scheme.residual_compliance", "scheme.tail", "scheme.substeps", "scheme.start", "scheme.stiffness", "scheme.exponent",
    "scheme.loss", "scheme.tolerance", "scheme.iterations", "scheme.grid", "scheme.drift_correction",
}  # fmt: skip


class _Rows:
    """Those of a block: axes of values that vary together, the first slowest."""

    def __init__(self, base: dict[str, Any], block: BlockTable) -> None:
        self._fixed = _over(base, block.set)
        self._axes: list[tuple[int, dict[str, Any]]] = []
        for name, values in block.grid.items():
            each = listed(values)
            self._axes.append((len(each), {name: each}))
        if block.zip:
            together = {name: listed(values) for name, values in block.zip.items()}
            self._axes.append((len(next(iter(together.values()))), together))
        if block.draw is not None:
            self._axes.append((block.draw.count, block.draw.samples()))
        self.count = 1
        for length, _ in self._axes:
            self.count *= length

    def row(self, number: int) -> dict[str, Any]:
        chosen: list[dict[str, Any]] = []
        for length, values in reversed(self._axes):
            number, index = divmod(number, length)
            chosen.append(plain_of(values, index))
        settings = self._fixed
        for each in reversed(chosen):
            settings = _over(settings, each)
        return dict(settings)


def _over(settings: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """Settings with others in their places, also where a key has two names."""
    keys = {canonical(name) for name in other}
    return {name: value for name, value in settings.items() if canonical(name) not in keys} | other


class Design:
    """A study's rows: `len`, `row(number)`, iteration; `reference(settings)` those of what a row is compared with."""

    def __init__(self, study: Study) -> None:
        self.study = study
        top = study.set if study.block else {}
        base = _over(dict(study.base.set), top)
        self._blocks = [_Rows(base, block) for block in study.blocks]
        self._ends = list(accumulate(block.count for block in self._blocks))

    def __len__(self) -> int:
        return self._ends[-1]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        for block in self._blocks:
            for number in range(block.count):
                yield block.row(number)

    def row(self, number: int) -> dict[str, Any]:
        """Settings of a row by its number, from 0."""
        place = bisect_right(self._ends, number)
        return self._blocks[place].row(number - (self._ends[place - 1] if place else 0))

    @cached_property
    def _follows(self) -> set[str] | None:
        reference = self.study.reference
        if reference is None or reference.follows is None:
            return None
        return {canonical(name) for name in reference.follows}

    def reference(self, settings: dict[str, Any]) -> dict[str, Any] | None:
        """What the row's reference is set to: what the row asks, not how it computes it, and [reference] set."""
        table = self.study.reference
        if table is None:
            return None
        base = self.study.base.set
        kept = {}
        for name, value in settings.items():
            key = canonical(name)
            follows = key not in NUMERICAL if self._follows is None else key in self._follows
            if (name in base and value == base[name]) or follows:
                kept[name] = value
        found = _over(kept, dict(table.set))
        if any(canonical(name) == "quality" for name in table.set):
            found = {
                name: value for name, value in found.items() if canonical(name) not in ("run.internal_rate_hz", "run.modes")
            }
        elif any(canonical(name) == "run.internal_rate_hz" for name in table.set):
            found.pop("quality", None)
        return found


def spread(count: int, most: int) -> list[int]:
    """At most so many numbers of rows, evenly over all, the first and the last among them."""
    if count <= most:
        return list(range(count))
    return sorted({round(k * (count - 1) / (most - 1)) for k in range(most)})
