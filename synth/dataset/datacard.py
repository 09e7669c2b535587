"""The card of a data set, README.md in its folder: what is in it, under which licence, made by what, how to make it again.

It begins with the fields by which collections of data sets find it (YAML), the rest is for readers.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from synth.dataset.itemrows import columns, read_rows
from synth.dataset.recipefile import SPLITS, Recipe, Written
from synth.dataset.setfolder import CARD, INDEX, STATE, SetFolder
from synth.files.targets import write_text
from synth.units import midi_to_note

#: errors that are shown, by kind
_SHOWN = 10


def write_card(folder: SetFolder, written: Written, began_s: float | None) -> None:
    """Writes the card from the index. began_s: how long it took to make, where one run made all of it."""
    names = ["key", "split", "group", "preset", "kind", "note", "articulation", "seconds", "size", "error", "lowered"]
    rows = read_rows(folder / INDEX, names)
    write_text(folder / CARD, card(written.recipe, rows, folder.state(), began_s, len(columns(written.recipe))))


def card(recipe: Recipe, rows: Sequence[dict[str, Any]], state: dict[str, Any], began_s: float | None, width: int) -> str:
    """Its text, from rows of the index and dataset.json."""
    good = [row for row in rows if not row["error"]]
    groups: dict[str, set[str]] = {name: {row["group"] for row in rows if row["split"] == name} for name in SPLITS}
    shared = sum(len(groups[a] & groups[b]) for a, b in (("train", "validation"), ("train", "test"), ("validation", "test")))
    title = recipe.title or "A data set of strings that collide"
    hours = sum(row["seconds"] for row in good) / 3600.0
    sound = recipe.sound
    lines = [
        "---",
        f"pretty_name: {json.dumps(title, ensure_ascii=False)}",
        f"license: {json.dumps(recipe.licence or 'unknown', ensure_ascii=False)}",
        "tags: [audio, synthetic, physical-modelling, strings]",
        "---",
        "",
        f"# {title}",
        "",
        *([recipe.description.strip(), ""] if recipe.description.strip() else []),
        "Computed sounds of plucked and struck strings that collide with the obstacles under them: "
        f"{len(good)} items, {hours:.3f} h, "
        f"{sum(row['size'] for row in good) / 1e6:.1f} MB of FLAC ({sound.channels} channel{'s' * (sound.channels > 1)}, "
        f"{sound.bit_depth} bits, {sound.rate_hz} Hz), quality `{sound.quality}`.",
        "",
        f"- Licence: {recipe.licence or '**not given** (`licence` of the recipe)'}",
        *([f"- Creators: {', '.join(recipe.creators)}"] if recipe.creators else []),
        f"- Seed: {recipe.seed}",
        "",
        "## Splits",
        "",
        *_table(
            ("split", "items", "hours", "groups"),
            (
                (name, _count(good, name), f"{_hours(good, name):.3f}", len(groups[name]))
                for name in SPLITS
            ),
        ),
        "",
        f"Groups are items with the same {', '.join(f'`{key}`' for key in recipe.split.group_by)}; "
        f"{shared} groups are in two splits.",
        "",
        "## What is played",
        "",
        *_table(
            ("preset", "articulation", *SPLITS),
            (
                (f"`{preset}`" if preset else "General MIDI", way or "–", *(
                    sum(row["split"] == name for row in good if (row["preset"], row["articulation"]) == (preset, way))
                    for name in SPLITS
                ))
                for preset, way in sorted({(row["preset"], row["articulation"]) for row in good})
            ),
        ),
        "",
        *_by_note(good),
        "## Level",
        "",
        _level(recipe, good),
        "",
        "## Made by",
        "",
        *_table(("what", "version"), state["versions"].items()),
        "",
        *([f"It took {began_s:.0f} s, {len(rows) / began_s:.1f} items a second.", ""] if began_s else []),
        "## Make it again, check it",
        "",
        "    synth dataset recipe.toml -o ELSEWHERE            # all of it",
        f"    synth dataset . --item {rows[0]['key'] if rows else 'KEY'} -o item.flac",
        "    synth dataset . --verify 100                      # index, sound and what is computed again, bit for bit",
        "",
        f"The same code (`{STATE}`) with the same packages on the same kind of processor gives the same bits.",
        "",
        f"`{INDEX}` has a row for each item, with {width} columns; "
        "what they mean is in the program's manual (docs/dataset.md).",
        "",
        *_errors(rows),
    ]  # fmt: skip
    return "\n".join(lines).rstrip() + "\n"


def _count(rows: Iterable[dict[str, Any]], split: str) -> int:
    return sum(row["split"] == split for row in rows)


def _hours(rows: Iterable[dict[str, Any]], split: str) -> float:
    return sum(row["seconds"] for row in rows if row["split"] == split) / 3600.0


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> list[str]:
    lines = [" | ".join(head), " | ".join("---" for _ in head)]
    return [f"| {line} |" for line in [*lines, *(" | ".join(str(cell) for cell in row) for row in rows)]]


def _by_note(rows: Sequence[dict[str, Any]]) -> list[str]:
    counts = {
        name: Counter(row["note"] for row in rows if row["split"] == name and row["note"] is not None) for name in SPLITS
    }
    notes = sorted(set().union(*counts.values()))
    if not notes:
        return []
    table = _table(("note", *SPLITS), ((midi_to_note(note), *(counts[name][note] for name in SPLITS)) for note in notes))
    return ["## Notes", "", *table, ""]


def _level(recipe: Recipe, rows: Sequence[dict[str, Any]]) -> str:
    level, lowered = recipe.level, sum(bool(row["lowered"]) for row in rows)
    if level.normalize_dbfs is None:
        how = f"All items have the instruments' own level{f' and {level.gain_db:+g} dB' if level.gain_db else ''}"
    else:
        how = f"Each item has a peak of {level.normalize_dbfs:g} dBFS"
    return (
        f"{how}; {lowered} would have gone beyond {level.ceiling_dbfs:g} dBFS and were lowered to it (`lowered`). "
        "Nothing is clipped; `gain_db` is the gain that was applied."
    )


def _errors(rows: Sequence[dict[str, Any]]) -> list[str]:
    errors = Counter(row["error"] for row in rows if row["error"])
    if not errors:
        return ["No item failed."]
    shown = [f"- {count} × {error}" for error, count in errors.most_common(_SHOWN)]
    more = [f"- … and {len(errors) - _SHOWN} other reasons"] if len(errors) > _SHOWN else []
    return ["## Items that failed", "", f"{sum(errors.values())} items have no sound; `error` of the index says why:", "",
            *shown, *more]  # fmt: skip
