"""`synth plan`: what a quality means for a preset, and why."""

from __future__ import annotations

import argparse
import json
from typing import Any

from synth.cli.common import add_physics, note_number


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "plan",
        help="which rate, modes and contacts a quality means for a preset, and why",
        allow_abbrev=False,
    )
    parser.add_argument("preset", metavar="PRESET")
    parser.add_argument("note", nargs="?", metavar="NOTE", help="a note such as C3 or 48 (default: a survey)")
    add_physics(parser)
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(run=_plan)


def _plan(options: argparse.Namespace) -> int:
    from synth.instrument.check import check
    from synth.instrument.compile import describe_plan
    from synth.instrument.preset import load_preset

    note = None if options.note is None else note_number(options.note)
    plan = describe_plan(
        check(load_preset(options.preset), options.preset),
        note,
        quality=options.quality,
        rate_hz=options.rate,
        scheme=options.scheme,
        internal_rate_hz=options.internal_rate,
    )
    if options.json:
        print(json.dumps(plan, indent=2, allow_nan=False))
    else:
        print(plan["text"])
    return 0
