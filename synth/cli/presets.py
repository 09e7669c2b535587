"""`synth presets`: list, show or check presets."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from synth.cli.common import Parser


def add(commands: Any) -> None:
    parser = commands.add_parser("presets", help="list, show or check presets", allow_abbrev=False)
    parser.set_defaults(run=_list_presets, json=False)
    actions = parser.add_subparsers(title="actions", metavar="ACTION", parser_class=Parser)
    listing = actions.add_parser("list", help="the presets that come with the program (default)", allow_abbrev=False)
    listing.add_argument("--json", action="store_true", help="as JSON")
    listing.set_defaults(run=_list_presets)
    show = actions.add_parser("show", help="print a preset's file, with where its numbers come from", allow_abbrev=False)
    show.add_argument("name", metavar="NAME")
    show.set_defaults(run=_show_preset)
    check = actions.add_parser("check", help="say all that is wrong with a preset file", allow_abbrev=False)
    check.add_argument("file", metavar="FILE")
    check.set_defaults(run=_check_preset)


def _list_presets(options: argparse.Namespace) -> int:
    from synth.instrument.preset import list_presets

    presets = list_presets()
    if options.json:
        rows = [{"name": p.name, "title": p.title, "description": p.description} for p in presets]
        print(json.dumps(rows, indent=2))
        return 0
    width = max((len(preset.name) for preset in presets), default=0)
    for preset in presets:
        print(f"{preset.name:{width}}  {preset.title}".rstrip())
    return 0


def _show_preset(options: argparse.Namespace) -> int:
    from synth.files.targets import naming
    from synth.instrument.preset import parse_preset, preset_text, read_preset_bytes

    data = read_preset_bytes(options.name)  # once: it may be a pipe
    parse_preset(preset_text(data, options.name), options.name)
    # The file as it is, whatever letters the terminal knows: `presets show tanpura > mine.toml` is a preset.
    sys.stdout.flush()
    with naming("-"):
        sys.stdout.buffer.write(data)
        sys.stdout.buffer.flush()
    return 0


def _check_preset(options: argparse.Namespace) -> int:
    from synth.instrument.check import check
    from synth.instrument.preset import load_preset

    preset = check(load_preset(options.file), options.file)
    count = len(preset.string)
    print(f"{options.file}: {preset.name} is in order ({count} string entr{'y' if count == 1 else 'ies'})")
    return 0
