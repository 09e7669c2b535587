"""Values by name as Parquet's columns: one type a column, whatever the parts that it is put together from.

Whole numbers are int64, with others float64; what is neither number, truth nor text, or more than one of these, is JSON
text, which the field says (`JSON`).
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pyarrow as pa

from synth.study.addressing import plain_json

#: of a field whose text is JSON
JSON = {b"json": b"1"}
_MOST = 2**63 - 1


def _kind(value: Any) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool):
        return "bool"
    if isinstance(value, int):
        return "int" if -_MOST <= value <= _MOST else "float" if abs(value) <= sys.float_info.max else "json"
    return "float" if isinstance(value, float) else "text" if isinstance(value, str) else "json"


def _together(kinds: set[str]) -> str:
    kinds = kinds - {"none"}
    if not kinds:
        return "none"
    if kinds <= {"int", "float"}:
        return "float" if "float" in kinds else "int"
    return next(iter(kinds)) if len(kinds) == 1 else "json"


_TYPES = {
    "none": pa.null(),
    "bool": pa.bool_(),
    "int": pa.int64(),
    "float": pa.float64(),
    "text": pa.string(),
    "json": pa.string(),
}


def column(name: str, values: Sequence[Any]) -> tuple[pa.Field, pa.Array]:
    """A field and its values."""
    kind = _together({_kind(value) for value in values})
    if kind == "json":
        values = [None if value is None else plain_json(value) for value in values]
    elif kind == "float":
        values = [None if value is None else float(value) for value in values]
    return pa.field(name, _TYPES[kind], metadata=JSON if kind == "json" else None), pa.array(values, _TYPES[kind])


def table(rows: Sequence[Mapping[str, Any]], names: Iterable[str] | None = None) -> pa.Table:
    """Rows as a table; columns in the order in which they first occur, or as named."""
    order = list(names) if names is not None else list(dict.fromkeys(name for row in rows for name in row))
    made = [column(name, [row.get(name) for row in rows]) for name in order]
    return pa.Table.from_arrays([array for _, array in made], schema=pa.schema([field for field, _ in made]))


def _kind_of(field: pa.Field) -> str:
    if field.metadata and field.metadata.get(b"json"):
        return "json"
    return next(kind for kind, each in _TYPES.items() if each == field.type)


def put_together(parts: Sequence[pa.Table]) -> pa.Table:
    """One table of all rows in order, with all columns; of one type as if it had been made of all values at once."""
    names = sorted({name for part in parts for name in part.column_names})
    fields, columns = [], []
    for name in names:
        kind = _together({_kind_of(part.schema.field(name)) for part in parts if name in part.column_names})
        chunks = []
        for part in parts:
            if name not in part.column_names:
                chunks.append(pa.nulls(part.num_rows, _TYPES[kind]))
                continue
            mine = _kind_of(part.schema.field(name))
            for chunk in part.column(name).chunks:
                if mine == kind:
                    chunks.append(chunk)
                elif kind == "json":
                    chunks.append(pa.array([None if v is None else plain_json(v) for v in chunk.to_pylist()], pa.string()))
                else:
                    chunks.append(chunk.cast(_TYPES[kind], safe=False))
        fields.append(pa.field(name, _TYPES[kind], metadata=JSON if kind == "json" else None))
        columns.append(pa.chunked_array(chunks, _TYPES[kind]))
    return pa.Table.from_arrays(columns, schema=pa.schema(fields))


def rows_of(found: pa.Table) -> list[dict[str, Any]]:
    """A table's rows as dicts, JSON read."""
    columns = {}
    for field in found.schema:
        values = found.column(field.name).to_pylist()
        if _kind_of(field) == "json":
            values = [None if value is None else json.loads(value) for value in values]
        columns[field.name] = values
    return [dict(zip(columns, each, strict=True)) for each in zip(*columns.values(), strict=True)]
