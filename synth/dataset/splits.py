"""Which items are for training, validation and test: groups of what is alike stay together.

A group is what has the same values of the recipe's `group_by`; its hash (with the recipe's seed) is a number from 0 to 1.
`exact`: groups in the order of these numbers fill the shares one after the other, so that they are kept to within half a
group. Otherwise the number itself says it: then a group stays where it is whatever else is added to the recipe, and the
shares are kept as chance will have it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence

from synth.dataset.items import Item

_SHARE_BYTES = 8


def group_of(item: Item, keys: Sequence[str], string_of: Callable[[Item], str] = lambda item: "") -> str:
    """The group of an item, in letters: what `group_by` names, of it."""
    found: dict[str, object] = {}
    for key in keys:
        if key == "parameters":
            found[key] = [item.settings, item.live, item.controllers, item.transpose, item.stretch]
        elif key == "string":
            found[key] = string_of(item)
        elif key == "velocity":
            found[key] = [beat.velocity for beat in item.beats]
        elif key == "item":
            found[key] = item.key
        elif key == "table":
            found[key] = [item.kind, item.table]
        else:
            found[key] = getattr(item, key)
    return json.dumps(found, sort_keys=True)


def number_of(group: str, seed: int) -> float:
    """From 0 to 1 (excluded), evenly."""
    digest = hashlib.blake2b(f"{seed} {group}".encode(), digest_size=_SHARE_BYTES).digest()
    return (int.from_bytes(digest, "little") >> 11) * 2.0**-53


def split_groups(sizes: Mapping[str, int], shares: Sequence[float], seed: int, exact: bool) -> dict[str, int]:
    """Group → number of its split. sizes: items of each group; shares: of the splits, 1 in all."""
    order = sorted(sizes, key=lambda group: (number_of(group, seed), group))
    if not exact:
        return {group: _place(number_of(group, seed), shares) for group in order}
    total, before, found = sum(sizes.values()), 0, {}
    for group in order:
        found[group] = _place((before + 0.5 * sizes[group]) / total, shares)
        before += sizes[group]
    return found


def _place(number: float, shares: Sequence[float]) -> int:
    end = 0.0
    for place, part in enumerate(shares):
        end += part
        if number < end:
            return place
    return max(place for place, part in enumerate(shares) if part > 0.0)
