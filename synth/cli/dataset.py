"""`synth dataset`: a recipe → shards of FLAC, an index and labels; items of one made again, and checked."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from synth.cli import bits
from synth.cli.common import needed, number, threads
from synth.cli.counting import ItemsLine
from synth.units import duration

#: packages of the extra `dataset`
PACKAGES = ("pyarrow", "scipy", "zarr")
#: exit code where a data set is not what its index says, or no item could be made
_FAULTY = 1


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "dataset",
        help="make a data set of labelled sound from a recipe: FLAC in tar shards, a Parquet index, labels in Zarr",
        allow_abbrev=False,
        description="Makes a data set from a recipe (TOML), or resumes one; regenerates single items; verifies a data set.",
    )
    parser.add_argument(
        "recipe",
        metavar="RECIPE",
        help="a .toml file, one of the program by name (first-notes), or the folder of a data set",
    )
    parser.add_argument("-o", "--output", metavar="OUT", help="folder of the data set; with --item the .flac file")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--check", action="store_true", help="only check the recipe and count its items")
    what.add_argument("--dry-run", action="store_true", help="also make a few items to estimate size and time")
    what.add_argument("--item", metavar="KEY", help="regenerate one item, bit for bit, and write it to -o")
    what.add_argument("--regenerate", nargs="+", metavar="KEY", help="regenerate items of a data set and compare them")
    what.add_argument(
        "--verify", type=number(int, 1, 10_000_000), metavar="N", help="check a data set: its index, and N random items"
    )
    parser.add_argument(
        "--workers",
        type=threads,
        default="auto",
        metavar="N",
        help="number of worker processes, or auto (default): one per processor",
    )
    bits.add_bits(parser)
    parser.add_argument("--json", action="store_true", help="closing report as JSON")
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    parser.set_defaults(run=_dataset)


def _dataset(options: argparse.Namespace) -> int:
    needed("synth dataset needs", PACKAGES, "dataset")
    is_folder = Path(options.recipe).is_dir()
    if options.regenerate or options.verify:
        if not is_folder:
            raise ValueError(
                f"{options.recipe}: --{'verify' if options.verify else 'regenerate'} takes the folder of a data set"
            )
        if options.output is not None:
            raise ValueError("-o has no meaning with --verify and --regenerate, which write nothing; --item KEY writes one")
        return _verify(options) if options.verify else _regenerate(options)
    from synth.dataset.recipecheck import checked_items
    from synth.dataset.recipefile import read_recipe
    from synth.dataset.setfolder import SetFolder

    if is_folder:
        written = SetFolder(options.recipe).written()
    else:
        written = read_recipe(options.recipe)
    items = checked_items(written)
    if options.item is not None:
        return _item(options, written, items)
    if options.check or options.dry_run:
        return _forecast(options, written, items)
    if options.output is None and not is_folder:
        raise ValueError("-o is missing: name the folder of the data set, or look first with --check or --dry-run")
    return _fill(options, written, items, options.recipe if options.output is None else options.output)


def _workers(options: argparse.Namespace, items: int) -> int:
    from synth.native.processors import cores

    return max(1, min(cores() if options.workers == "auto" else options.workers, items))


def _say(options: argparse.Namespace, told: dict[str, Any], lines: list[str]) -> None:
    if options.json:
        print(json.dumps(told, indent=2, allow_nan=False))
    elif not options.quiet:
        print("\n".join(lines))


def _fill(options: argparse.Namespace, written: Any, items: Any, output: str) -> int:
    from synth.dataset.filling import fill

    with ItemsLine(not options.quiet and not options.json and sys.stderr.isatty()) as line:
        told = fill(written, Path(output), workers=_workers(options, items.size), progress=line.items, items=items)
    speed = f", {told.made / told.wall_s:.1f} a second" if told.made else ", nothing was missing"
    lines = [f"{output}: {told.items} items, {told.seconds / 3600.0:.2f} h, {told.made} made in {told.wall_s:.1f} s{speed}"]
    if told.errors:
        failed = f"{told.errors} item{'' if told.errors == 1 else 's'} failed"
        lines.append(f"  {failed}: see `error` in {output}/index.parquet, and README.md")
    _say(options, vars(told), lines)
    return _FAULTY if told.errors == told.items else 0


def _forecast(options: argparse.Namespace, written: Any, items: Any) -> int:
    from synth.dataset.filling import layout
    from synth.dataset.forecast import forecast

    if options.check:
        plan = layout(written, items)
        told: dict[str, Any] = {"items": items.size, "shards": len(plan.shards), "splits": plan.splits, "empty": plan.empty}
        lines = [f"{options.recipe}: {items.size} items in {len(plan.shards)} shards: {_split_line(plan.splits)}"]
        empty = plan.empty
    else:
        workers = _workers(options, items.size)
        found = forecast(written, items, workers)
        told = vars(found)
        labels = f" and {_size(found.label_bytes)} of labels before compression" if found.label_bytes else ""
        lines = [
            f"{options.recipe}: {found.items} items in {found.shards} shards: {_split_line(found.splits)}",
            f"  estimated from {found.made} items: {found.seconds / 3600.0:.2f} h of sound, {_size(found.bytes)}{labels}, "
            f"{duration(found.wall_s)} with {workers} worker{'s' * (workers > 1)}",
            *[f"  failed: {error}" for error in found.errors],
        ]
        empty = found.empty
    lines += [f"  {name} is empty: too few groups; see split.group_by" for name in empty]
    _say(options, told, lines)
    return 0


def _item(options: argparse.Namespace, written: Any, items: Any) -> int:
    from synth.dataset.crew import Maker
    from synth.files.targets import Named, check_apart, check_target, write_whole

    if options.output is None or not options.output.endswith(".flac"):
        raise ValueError(f"--item writes FLAC: give -o NAME.flac, got {options.output or 'no -o'}")
    check_apart([Named("recipe", written.origin)], [Named("-o", options.output)])
    check_target(options.output)
    items.by_key(options.item)
    made = Maker(written, items).make(options.item)
    if made.row["error"]:
        raise ValueError(f"{options.item}: {made.row['error']}")
    write_whole(options.output, lambda file: file.write(made.flac))
    _say(options, made.row, [f"{options.output}: {options.item}, {made.row['seconds']:.3f} s, sha256 {made.row['sha256']}"])
    return 0


def _regenerate(options: argparse.Namespace) -> int:
    from synth.dataset.itemrows import read_rows
    from synth.dataset.setfolder import INDEX, SetFolder
    from synth.dataset.verifying import regenerate

    folder = SetFolder(options.recipe)
    folder.state()
    known = {row["key"]: row for row in read_rows(folder / INDEX, ["key", "sha256", "error"])}
    unknown = [key for key in options.regenerate if key not in known]
    if unknown:
        raise ValueError(f"{options.recipe}: has no item {unknown[0]!r}; its index has all keys")
    told, lines = {}, []
    for made in regenerate(folder, options.regenerate):
        row = known[made.key]
        same = (made.row.get("sha256"), made.row["error"]) == (row["sha256"], row["error"])
        told[made.key] = same
        lines.append(f"{made.key}: {'the same' if same else 'DIFFERENT SOUND'}, sha256 {made.row.get('sha256')}")
    _say(options, told, lines)
    return 0 if all(told.values()) else _FAULTY


def _verify(options: argparse.Namespace) -> int:
    from synth.dataset.setfolder import SetFolder
    from synth.dataset.verifying import verify

    with ItemsLine(not options.quiet and not options.json and sys.stderr.isatty()) as line:
        found = verify(SetFolder(options.recipe), options.verify, progress=line.items)
    lines = [
        f"{options.recipe}: {found.items} items checked, {len(found.faults)} fault{'' if len(found.faults) == 1 else 's'}",
        *(f"  {each}" for each in found.faults),
    ]
    if found.other_code:
        lines.append("  made by another version of the program (dataset.json): different bits may come from that")
    _say(options, vars(found), lines)
    return _FAULTY if found.faults else 0


def _split_line(splits: dict[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in splits.items())


def _size(count: float) -> str:
    for unit in ("B", "kB", "MB", "GB"):
        if count < 1000.0:
            return f"{count:.3g} {unit}"
        count /= 1000.0
    return f"{count:.3g} TB"
