"""`synth presets`: list, show or check presets."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from synth.cli.common import Parser

if TYPE_CHECKING:
    from synth.instrument.preset import Preset

#: where presets without a family stand, behind all others
OTHERS = "other"


def add(commands: Any) -> None:
    parser = commands.add_parser("presets", help="list, show or check presets", allow_abbrev=False)
    _add_listing(parser)
    actions = parser.add_subparsers(title="actions", metavar="ACTION", parser_class=Parser)
    listing = actions.add_parser("list", help="list the program's presets (default)", allow_abbrev=False)
    _add_listing(listing)
    show = actions.add_parser("show", help="print a preset's file and the ways to its articulations", allow_abbrev=False)
    show.add_argument("name", metavar="NAME", help="preset: a name, or a .toml file")
    show.set_defaults(run=_show_preset)
    check = actions.add_parser("check", help="list all faults of a preset file", allow_abbrev=False)
    check.add_argument("file", metavar="FILE", help="preset: a .toml file, or a name")
    check.set_defaults(run=_check_preset)


def _add_listing(parser: argparse.ArgumentParser) -> None:
    # Not set where they are not given: those of `presets` hold for `presets list`, too.
    absent = argparse.SUPPRESS
    parser.add_argument(
        "--tag",
        action="append",
        default=absent,
        metavar="TAG",
        help="only presets with this tag; if repeated, with all of them",
    )
    parser.add_argument(
        "--family", default=absent, metavar="FAMILY", help="only presets of this family, such as bass or guitar"
    )
    parser.add_argument("--json", action="store_true", default=absent, help="as JSON, with tags, range and articulations")
    parser.set_defaults(run=_list_presets)


def _list_presets(options: argparse.Namespace) -> int:
    from synth.instrument.catalogue import by_family, find, row
    from synth.instrument.preset import list_presets

    presets = find(list_presets(), getattr(options, "tag", ()), getattr(options, "family", None))
    if getattr(options, "json", False):
        print(json.dumps([row(preset) for preset in presets], indent=2))
        return 0
    width = max((len(preset.name) for preset in presets), default=0)
    for family, members in by_family(presets):
        print(family or OTHERS)
        for preset in members:
            print(f"  {preset.name:{width}}  {_line(preset)}".rstrip())
    return 0


def _line(preset: Preset) -> str:
    from synth.instrument.catalogue import notes_of

    tags = f" ({', '.join(preset.tags)})" if preset.tags else ""
    return f"{preset.title or preset.name}, {notes_of(preset)}{tags}"


def _show_preset(options: argparse.Namespace) -> int:
    from synth.files.targets import naming
    from synth.instrument.preset import parse_preset, preset_text, read_preset_bytes
    from synth.instrument.ways import ways

    data = read_preset_bytes(options.name)  # once: it may be a pipe
    preset = parse_preset(preset_text(data, options.name), options.name)
    # The file as it is, whatever letters the terminal knows: `presets show tanpura > mine.toml` is a preset.
    sys.stdout.flush()
    with naming("-"):
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
    for line in ways(preset):  # beside the file, which stays one
        print(line, file=sys.stderr)
    return 0


def _check_preset(options: argparse.Namespace) -> int:
    from synth.instrument.check import check
    from synth.instrument.preset import load_preset

    preset = check(load_preset(options.file), options.file)
    count = len(preset.string)
    print(f"{options.file}: {preset.name} is in order ({count} string entr{'y' if count == 1 else 'ies'})")
    return 0
