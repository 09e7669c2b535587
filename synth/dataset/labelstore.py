"""Labels of a shard's items in Zarr (format 3): arrays of all items behind each other, with their places in the index.

    labels/train/shard-000000.zarr/force_n      …of item with rows force_begin to force_begin + force_count

What belongs together has one sort of place (`SIZES`): of the N modes of an item's S states, state_q and state_v hold S·N,
and of its C points point_shape C·N.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from synth.files.folders import write_folder

#: sort of place → the arrays that are as long
SIZES = {
    "contact": ("contact_point", "contact_start_s", "contact_end_s", "contact_peak_n", "contact_impulse_ns"),
    "force": ("force_step", "force_point", "force_n"),
    "state": ("state_step", "finger_m"),
    "state_values": ("state_q", "state_v"),
    "mode": ("mode_omega", "mode_sigma", "mode_wq", "mode_wv"),
    "point": ("point_x_m", "point_height_m"),
    "point_values": ("point_shape",),
}
#: numbers in a chunk
CHUNK = 1 << 16


def labels_name(split: str, number: int) -> str:
    """labels/train/shard-000000.zarr, from the data set's folder."""
    return f"labels/{split}/shard-{number:06d}.zarr"


def write_labels(path: Path, items: Sequence[Mapping[str, np.ndarray]], about: Mapping[str, Any]) -> list[dict[str, int]]:
    """Writes the labels of items, whole or not at all; where each item's are. Raises OSError that names `path`."""
    import zarr
    from zarr.storage import MemoryStore

    kept: dict[str, Any] = {}
    root = zarr.create_group(MemoryStore(kept), attributes=dict(about))
    places: list[dict[str, int]] = [{} for _ in items]
    for sort, names in SIZES.items():
        counts = [len(labels[names[0]]) if names[0] in labels else 0 for labels in items]
        ends = np.cumsum([0, *counts])
        for place, begin, count in zip(places, ends, counts, strict=False):
            place |= {f"{sort}_begin": int(begin), f"{sort}_count": count}
        for name in names:
            arrays = [labels[name] for labels in items if name in labels]
            if arrays:
                data = np.concatenate(arrays)
                array = root.create_array(name, shape=data.shape, chunks=(min(CHUNK, max(1, data.size)),), dtype=data.dtype)
                array[:] = data
    write_folder(path, {name: data.to_bytes() for name, data in kept.items()})
    return places


def read_labels(path: Path, row: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The labels of one item, by its row of the index. Raises OSError or ValueError where they are not there."""
    import zarr

    if not path.is_dir():
        raise FileNotFoundError(f"{path}: there are no labels; the data set is not whole")
    root = zarr.open_group(str(path), mode="r")
    found = {}
    for sort, names in SIZES.items():
        begin, count = row[f"{sort}_begin"], row[f"{sort}_count"]
        for name in names:
            if name in root:
                found[name] = np.asarray(root[name][begin : begin + count])  # type: ignore[index]
                if len(found[name]) != count:
                    raise ValueError(f"{path}: {name} ends before {begin + count}; the labels were cut off")
    return found
