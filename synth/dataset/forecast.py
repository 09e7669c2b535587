"""How large a data set will be, and how long it takes: from a few of its items, made."""

from __future__ import annotations

import random
import time
from dataclasses import dataclass

from synth.dataset.crew import Maker
from synth.dataset.filling import layout
from synth.dataset.items import Items
from synth.dataset.recipefile import Written

#: items that are made, and the time after which no more are [s]
SAMPLE, LONGEST_S = 12, 20.0


@dataclass(frozen=True)
class Forecast:
    """items and shards are counted; seconds of sound, bytes and wall clock [s] are estimates from `made` items; errors: of
    these."""

    items: int
    shards: int
    splits: dict[str, int]
    empty: tuple[str, ...]
    made: int
    errors: tuple[str, ...]
    seconds: float
    bytes: float
    label_bytes: float
    wall_s: float


def forecast(written: Written, items: Items, workers: int) -> Forecast:
    """Makes a few items, spread over the recipe; each engine's preparation is counted once for each worker."""
    plan = layout(written, items)
    keys = [item.key for item in items]
    chosen = random.Random(written.recipe.seed).sample(keys, min(SAMPLE, len(keys)))
    maker = Maker(written, items)
    sound = size = labels = spent = first_s = 0.0
    engines, errors, made = set(), [], 0
    all_engines = len({item.engine for item in items if item.kind != "midi"})
    began = time.perf_counter()
    for key in chosen:
        if made and time.perf_counter() - began > LONGEST_S:
            break
        start = time.perf_counter()
        found = maker.make(key)
        first = time.perf_counter() - start
        start = time.perf_counter()
        maker.make(key)
        again = time.perf_counter() - start
        engines.add(items.by_key(key).engine)
        first_s += max(0.0, first - again)
        spent += again
        made += 1
        if found.row["error"]:
            errors.append(f"{key}: {found.row['error']}")
        sound += found.row.get("seconds") or 0.0
        size += len(found.flac) + len(str(found.row))
        labels += sum(array.nbytes for array in found.labels.values())
    maker.close()
    scale = items.size / max(1, made)
    prepared = first_s / max(1, len(engines)) * all_engines
    return Forecast(
        items.size, len(plan.shards), plan.splits, plan.empty, made, tuple(errors), sound * scale, size * scale,
        labels * scale, spent * scale / workers + prepared,
    )  # fmt: skip
