"""The finished table: a row for each that the study asks for, in its order, whatever the order in which they came.

Of rows and columns only what the study and its results decide on is in `table.parquet`, so that a run that was disturbed
gives the same table as one that was not; what is measured of the machine is in `times.parquet`, row by row.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from synth.study import columns
from synth.study.design import Design
from synth.study.keeping import TIME, Folder, write_table

#: columns behind all others
_LAST = ("not_measured", "failure", "failed_at", "reference", "key")


def best_rows(found: pa.Table) -> tuple[np.ndarray, np.ndarray]:
    """(sorted keys, their places in the table): of a key that is there several times the first good one, else the last."""
    keys = np.array([bytes.fromhex(key[:32]) for key in found.column("key").to_pylist()], "S16")
    if "failure" in found.column_names:
        bad = ~found.column("failure").is_null().to_numpy(zero_copy_only=False)
    else:
        bad = np.zeros(keys.size, bool)
    place = np.arange(keys.size)
    order = np.lexsort((np.where(bad, -place, place), bad, keys))
    first = np.ones(order.size, bool)
    first[1:] = keys[order][1:] != keys[order][:-1]
    return keys[order][first], order[first]


def finish(folder: Folder, design: Design, addressed: Any) -> pa.Table | None:
    """Writes table.parquet and times.parquet; the table, or None where rows are missing.

    addressed: settings → (key, reference's key or None) of a row
    """
    parts = list(folder.tables())
    if not parts:
        return None
    found = columns.put_together(parts)
    known, places = best_rows(found)
    take = np.empty(len(design), np.int64)
    parameters: dict[str, list[Any]] = {}
    references: list[str | None] = []
    keys: list[str] = []
    for number, settings in enumerate(design):
        key, reference = addressed(settings)
        sought = np.array(bytes.fromhex(key[:32]), "S16")
        place = int(np.searchsorted(known, sought))
        if place >= known.size or known[place] != sought:
            return None
        take[number] = places[place]
        for name, value in settings.items():
            if name not in parameters:
                parameters[name] = [None] * number
            parameters[name].append(value)
        for values in parameters.values():
            if len(values) <= number:
                values.append(None)
        keys.append(key)
        references.append(reference)
    rows = found.take(pa.array(take))
    made: list[tuple[pa.Field, Any]] = [columns.column(name, values) for name, values in parameters.items()]
    measured = [name for name in rows.column_names if name not in parameters and not name.startswith(TIME)]
    for name in (each for each in measured if each not in (*_LAST, "code")):
        made.append((rows.schema.field(name), rows.column(name)))
    for name in ("not_measured", "failure", "failed_at"):
        if name in rows.column_names and rows.column(name).null_count < rows.num_rows:
            made.append((rows.schema.field(name), rows.column(name)))
    if any(references):
        made.append(columns.column("reference", references))
    made.append(columns.column("key", keys))
    made = [_typed(field, array) for field, array in made]
    table = pa.Table.from_arrays(
        [array if isinstance(array, pa.ChunkedArray) else pa.chunked_array([array]) for _, array in made],
        schema=pa.schema([field for field, _ in made]),
    )
    table = table.combine_chunks()
    times = rows.select([name for name in rows.column_names if name.startswith(TIME)])
    times = times.rename_columns([name.removeprefix(TIME) for name in times.column_names])
    times = times.append_column("key", pa.array(keys)).combine_chunks()
    write_table(times, folder.path / "times.parquet")
    write_table(table, folder.path / "table.parquet")
    return table


def _typed(field: pa.Field, array: Any) -> tuple[pa.Field, Any]:
    """A column that has nothing in all rows is one of numbers."""
    return (pa.field(field.name, pa.float64()), array.cast(pa.float64())) if field.type == pa.null() else (field, array)


def prune(folder: Folder, design: Design, addressed: Any) -> int:
    """Takes all rows out of the store, with their arrays and references, that the study does not ask for; how many."""
    import shutil

    wanted: set[str] = set()
    references: set[str] = set()
    for settings in design:
        key, reference = addressed(settings)
        wanted.add(key)
        if reference is not None:
            references.add(reference)
    folder.flush()
    parts = list(folder.tables())
    if not parts:
        return 0
    found = columns.put_together(parts)
    keep = np.array([key in wanted for key in found.column("key").to_pylist()], bool)
    gone = int(np.sum(~keep))
    if gone:
        folder.replace(found.filter(pa.array(keep)))
    for path in (folder.path / "arrays.zarr").glob("*/"):
        if path.is_dir() and len(path.name) == 64 and path.name not in wanted:
            shutil.rmtree(path, ignore_errors=True)
    for path in (folder.path / "references").glob("*.npz"):
        if path.stem not in references:
            path.unlink()
    return gone
