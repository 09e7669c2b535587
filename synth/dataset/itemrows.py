"""The index: one row for each item, with all that made it and what was measured of it; Parquet.

Columns of parameters are called as in the recipe: set.KEY, live.ID, controllers.N; null where a table does not set them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

from synth.dataset.items import Item
from synth.dataset.labelstore import SIZES
from synth.dataset.packing import Packed
from synth.dataset.recipefile import Notes, Phrases, Recipe
from synth.dataset.sung import Sung
from synth.files.targets import write_whole
from synth.units import midi_to_note

#: of every index, in this order: name, type of Arrow
COLUMNS = {
    "key": "string", "kind": "string", "table": "int32", "number": "int64", "split": "string", "group": "string",
    "shard": "string", "offset": "int64", "size": "int64", "json_offset": "int64", "json_size": "int64", "error": "string",
    "preset": "string", "articulation": "string", "note": "int32", "note_name": "string", "velocity": "int32",
    "hold_s": "float64", "release_s": "float64", "phrase": "string", "file": "string", "transpose": "int32",
    "stretch": "float64", "repeat": "int64", "seed": "int64", "string": "string", "fret": "string", "f0_hz": "float64",
    "frames": "int64", "seconds": "float64", "onset_s": "float64", "peak_dbfs": "float64", "loudness_lufs": "float64",
    "gain_db": "float64", "lowered": "bool", "unplayed": "int32", "sha256": "string", "version": "string", "code": "string",
}  # fmt: skip
#: …and where motion is labelled
FACTS = ("label_rate_hz", "length_m", "tension_n", "linear_density_kg_m")
#: what a row says of places, which the JSON beside the sound leaves out
PLACES = ("split", "group", "shard", "offset", "size", "json_offset", "json_size")


def parameter_columns(recipe: Recipe) -> dict[str, str]:
    """Columns of numbers of presets, live parameters and controllers, with their types."""
    found: dict[str, str] = {}
    for table in (*recipe.notes, *recipe.phrases, *recipe.midi):
        for key, axis in table.set.items():
            numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in axis.ends())
            same = found.get(f"set.{key}", "float64") == "float64"
            found[f"set.{key}"] = "float64" if numbers and same else "string"
        if isinstance(table, Notes | Phrases):
            found |= {f"live.{key}": "float64" for key in table.live}
            found |= {f"controllers.{int(key)}": "int32" for key in table.controllers}
    return dict(sorted(found.items()))


def label_columns(recipe: Recipe) -> dict[str, str]:
    """Columns that lead to labels: where an item's part of each sort of arrays begins, and how long it is."""
    if not recipe.labels.wanted:
        return {}
    places = {f"{sort}_{end}": "int64" for sort in SIZES for end in ("begin", "count")}
    return {"labels": "string", **places, **{name: "float64" for name in FACTS}}


def columns(recipe: Recipe) -> dict[str, str]:
    """All columns of a recipe's index, with their types."""
    return COLUMNS | parameter_columns(recipe) | label_columns(recipe)


def row_of(
    item: Item, recipe: Recipe, sung: Sung | None, packed: Packed | None, error: str, version: str, code: str
) -> dict[str, Any]:
    """What is known of an item when it has been made, by column; places come later."""
    types = parameter_columns(recipe)
    values = {f"set.{key}": value for key, value in item.settings}
    values |= {f"live.{key}": value for key, value in item.live}
    values |= {f"controllers.{key}": value for key, value in item.controllers}
    row: dict[str, Any] = {
        "key": item.key, "kind": item.kind, "table": item.table, "number": item.number, "error": error,
        "preset": item.preset, "articulation": item.articulation, "release_s": item.release_s, "phrase": item.phrase,
        "file": item.file, "transpose": item.transpose, "stretch": item.stretch, "repeat": item.repeat, "seed": item.seed,
        "version": version, "code": code,
    }  # fmt: skip
    row |= {name: _typed(value, types[name]) for name, value in values.items()}
    if item.note is not None:
        (beat,) = item.beats
        row |= {"note": beat.note, "note_name": midi_to_note(beat.note), "velocity": beat.velocity, "hold_s": beat.off_s}
    if sung is not None and packed is not None:
        frames = len(packed.pcm)
        row |= {
            "string": sung.string, "fret": sung.fret, "f0_hz": sung.f0_hz, "unplayed": sung.unplayed, "frames": frames,
            "seconds": frames / recipe.sound.rate_hz, "onset_s": packed.onset_s, "peak_dbfs": packed.peak_dbfs,
            "loudness_lufs": packed.loudness_lufs, "gain_db": packed.gain_db, "lowered": packed.lowered,
            "sha256": packed.sha256, **sung.facts,
        }  # fmt: skip
    return row


def _typed(value: Any, kind: str) -> Any:
    if kind == "string":
        return value if isinstance(value, str) else json.dumps(value)
    return float(value) if kind == "float64" else int(value)


def as_json(row: Mapping[str, Any]) -> bytes:
    """What lies beside the sound in its shard: the row without its places."""
    kept = {name: value for name, value in row.items() if name not in PLACES and value is not None}
    return json.dumps(kept, indent=1, sort_keys=True, allow_nan=False).encode()


def schema(recipe: Recipe, about: Mapping[str, str]) -> Any:
    """Arrow's schema of the index; about: words that go into the file."""
    import pyarrow as pa

    fields = [pa.field(name, pa.type_for_alias(kind)) for name, kind in columns(recipe).items()]
    return pa.schema(fields, metadata=dict(about))


def write_rows(path: Path, rows: Sequence[Mapping[str, Any]], recipe: Recipe, about: Mapping[str, str]) -> None:
    """Writes rows as a Parquet file, whole or not at all. Raises OSError that names it."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    kind = schema(recipe, about)
    table = pa.Table.from_pylist([{name: row.get(name) for name in kind.names} for row in rows], schema=kind)
    write_whole(path, lambda file: pq.write_table(table, file, compression="zstd"))


def join_rows(path: Path, parts: Sequence[Path], recipe: Recipe, about: Mapping[str, str]) -> None:
    """Writes one Parquet file of several, one after the other, holding one at a time. Raises OSError that names it."""
    import pyarrow.parquet as pq

    def write(file: BinaryIO) -> None:
        with pq.ParquetWriter(file, schema(recipe, about), compression="zstd") as writer:
            for part in parts:
                writer.write_table(pq.read_table(part).replace_schema_metadata(dict(about)))

    write_whole(path, write)


def read_rows(path: Path, names: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Rows of an index. Raises OSError, ValueError where it is none."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        return pq.read_table(path, columns=None if names is None else list(names)).to_pylist()
    except pa.ArrowInvalid as error:
        raise ValueError(f"{path}: cannot be read as a Parquet file: {str(error).splitlines()[0]}") from None
