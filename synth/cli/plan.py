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
    parser.add_argument("preset", metavar="PRESET", help="preset: a name, or a .toml file")
    parser.add_argument("note", nargs="?", metavar="NOTE", help="a note such as C3 or 48 (default: a survey)")
    add_physics(parser)
    parser.add_argument("--measure", action="store_true", help="play it and say what it costs on this machine")
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(run=_plan)


def _plan(options: argparse.Namespace) -> int:
    from synth.instrument.check import check
    from synth.instrument.compile import describe_plan
    from synth.instrument.preset import load_preset

    preset = check(load_preset(options.preset), options.preset)
    note = None if options.note is None else note_number(options.note)
    plan = describe_plan(
        preset,
        note,
        quality=options.quality,
        rate_hz=options.rate,
        scheme=options.scheme,
        internal_rate_hz=options.internal_rate,
    )
    if options.measure:
        from dataclasses import asdict

        from synth.host.measured_cost import BLOCK, measure_cost

        cost = measure_cost(
            preset,
            quality=options.quality,
            rate_hz=options.rate,
            scheme=options.scheme,
            internal_rate_hz=options.internal_rate,
            precision=options.precision,
        )
        plan["cost"] = {
            name: float(f"{value:.3g}") if isinstance(value, float) else value for name, value in asdict(cost).items()
        }
        plan["text"] += (
            f"\n  here and now: {cost.real_time_factor:.3g} × real time on a core, {cost.strings} strings sounding at most; "
            f"of a block of {BLOCK} frames' time {cost.median_block:.2g} in the median, {cost.worst_block:.2g} at most"
        )
    if options.json:
        print(json.dumps(plan, indent=2, allow_nan=False))
    else:
        print(plan["text"])
    return 0
