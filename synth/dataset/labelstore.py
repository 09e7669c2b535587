"""Labels of a shard's items in Zarr (format 3): arrays of all items behind each other, with their places in the index.

    labels/train/shard-000000.zarr/force_n      …of item with rows force_begin to force_begin + force_count

What belongs together has one sort of place (`SIZES`), which names the one dimension of its arrays: of the N modes of an
item's S states, state_q and state_v hold S·N, and of its C points point_shape C·N.
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
    "state": ("state_step", "state_s", "finger_m"),
    "state_values": ("state_q", "state_v"),
    "change": ("change_step", "change_bend", "change_hand"),
    "mode": ("mode_number", "mode_omega", "mode_sigma", "mode_wq", "mode_wv"),
    "point": ("point_x_m", "point_height_m"),
    "point_values": ("point_shape",),
}
#: what each array holds, and its unit
MEANINGS = {
    "contact_point": ("point that is touched, from the nut", "1"),
    "contact_start_s": ("begin of the touch", "s"),
    "contact_end_s": ("end of the touch", "s"),
    "contact_peak_n": ("largest force", "N"),
    "contact_impulse_ns": ("impulse", "N s"),
    "force_step": ("step in which a point was pressed", "1"),
    "force_point": ("point that was pressed, from the nut", "1"),
    "force_n": ("force at the point", "N"),
    "state_step": ("steps made so far", "1"),
    "state_s": ("time from the first sample", "s"),
    "finger_m": ("height to which a finger holds the string", "m"),
    "state_q": ("coordinates of the modes, state after state", "m·√m"),
    "state_v": ("speeds of the modes, state after state", "m·√m/s"),
    "change_step": ("step from which on the string is bent and damped so", "1"),
    "change_bend": ("bend, by the string's own motion and by hand", "semitone"),
    "change_hand": ("decay that the damping hand adds", "1/s"),
    "mode_number": ("number of the mode, 0 of a lumped one", "1"),
    "mode_omega": ("angular frequency", "rad/s"),
    "mode_sigma": ("decay", "1/s"),
    "mode_wq": ("what the output hears of the coordinate", "1"),
    "mode_wv": ("what the output hears of the speed", "1"),
    "point_x_m": ("place from nut or fret", "m"),
    "point_height_m": ("height over the line at rest", "m"),
    "point_shape": ("shapes of the modes at the points, point after point", "1/√m"),
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
                words, unit = MEANINGS[name]
                array = root.create_array(
                    name,
                    shape=data.shape,
                    chunks=(min(CHUNK, max(1, data.size)),),
                    dtype=data.dtype,
                    dimension_names=(sort,),
                    attributes={"long_name": words, "units": unit},
                )
                array[:] = data
    write_folder(path, {name: data.to_bytes() for name, data in kept.items()})
    return places


def read_labels(path: Path, row: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """The labels of one item, by its row of the index. Raises OSError or ValueError where they are not there."""
    import zarr

    if not path.is_dir():
        raise FileNotFoundError(f"{path}: there are no labels; the data set is incomplete")
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
