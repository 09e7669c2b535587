"""`synth plan`: what a quality means for a preset, and why."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from synth.cli.common import ProgressLine, add_physics, engine_options, note_number

if TYPE_CHECKING:
    from synth.instrument.preset import Preset


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "plan",
        help="show the rate, modes and contacts of each quality for a preset, with reasons",
        allow_abbrev=False,
    )
    parser.add_argument("preset", metavar="PRESET", help="preset: a name, or a .toml file")
    parser.add_argument("note", nargs="?", metavar="NOTE", help="a note such as C3 or 48 (default: a survey)")
    add_physics(parser)
    parser.add_argument("--measure", action="store_true", help="play it and measure its cost on this machine")
    parser.add_argument(
        "--measure-plan",
        action="store_true",
        help="measure the rate and modes that each quality needs for your own preset, and store them beside it (minutes)",
    )
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(run=_plan)


def _plan(options: argparse.Namespace) -> int:
    from synth.instrument.check import check
    from synth.instrument.compile import describe_plan
    from synth.instrument.preset import load_preset, parse_preset, read_preset

    if options.measure_plan:  # a plan that cannot be read is made anew
        preset = parse_preset(read_preset(options.preset), options.preset)
    else:
        preset = load_preset(options.preset)
    check(preset, options.preset)
    if options.measure_plan:
        preset = _measured(preset, options.preset)
    note = None if options.note is None else note_number(options.note)
    plan = describe_plan(
        preset,
        note,
        quality=options.quality,
        rate_hz=options.rate,
        scheme=options.scheme,
        internal_rate_hz=options.internal_rate_hz,
    )
    if options.measure:
        from dataclasses import asdict

        from synth.engine.engine_settings import EngineSettings
        from synth.host.measured_cost import BLOCK, measure_cost

        cost = measure_cost(preset, rate_hz=options.rate, settings=EngineSettings(**engine_options(options)))
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


def _measured(preset: Preset, name: str) -> Preset:
    """The preset with a plan measured now, which is written beside its file. Raises ValueError where none can lie there,
    OSError."""
    from synth.files.targets import check_target, is_special, write_text
    from synth.fit.plan_measuring import measure_plan
    from synth.instrument.planfile import path_of, text_of
    from synth.instrument.preset import preset_folder, preset_path

    path = preset_path(name)
    if path.resolve().parent == preset_folder().resolve():
        raise ValueError(
            f"--measure-plan {name}: is built in and already measured; for one of your own, start with "
            f"`synth presets show {name} > mine.toml`"
        )
    if is_special(path):
        raise ValueError(
            f"--measure-plan {name}: not a regular file, so no plan can be stored beside it; give a preset file"
        )
    check_target(path_of(path))
    with ProgressLine(sys.stderr.isatty()) as line:

        def told(done: float) -> bool:
            line.measuring(done)
            return True

        plan = measure_plan(preset, progress=told)
    write_text(path_of(path), text_of(plan))
    print(f"synth: written: {path_of(path)}", file=sys.stderr)
    return preset.with_measured(plan)
