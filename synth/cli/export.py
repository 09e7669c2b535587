"""`synth export`: presets as a plugin for music programs."""

from __future__ import annotations

import argparse
import json
import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from synth.cli.common import QUALITIES, RATES_HZ, ProgressLine, add_settings, number, warner
from synth.cli.dronestrings import add_hand, add_strings, check_strings, pitches

if TYPE_CHECKING:
    from synth.plugin.droning import DroneSettings

FORMATS = ("clap", "vst3", "lv2")
WEB = "web"
#: sample rates that hosts have, and a bank can be made for [Hz]
_LOWEST_HZ, _HIGHEST_HZ = 8000, 384000


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "export",
        help="export presets as a CLAP, VST3 or LV2 plugin for music programs, or as a web page",
        allow_abbrev=False,
        description="Makes a plugin that needs neither this program nor Python. Several presets become "
        "programs of one plugin. The folders ~/.clap, ~/.vst3 and ~/.lv2 are where music programs look (--install).",
    )
    parser.add_argument("presets", nargs="*", metavar="PRESET", help="preset (name or .toml file)")
    parser.add_argument("--all", action="store_true", help="all presets of the program in one plugin")
    parser.add_argument(
        "-f",
        "--format",
        choices=(*FORMATS, "all", WEB),
        help="default: by the extension of -o; with --install all three; web: a folder with a page that plays it",
    )
    parser.add_argument("-o", "--output", metavar="PATH", help="output (default: NAME.FORMAT in the current folder)")
    parser.add_argument("--install", action="store_true", help="write it where music programs look for a user's plugins")
    parser.add_argument("--name", metavar="NAME", help="the plugin's name (default: the preset's; collection of several)")
    add_settings(parser)
    parser.add_argument("--quality", choices=QUALITIES, default="standard", help="accuracy; see `synth plan`")
    parser.add_argument(
        "--rates",
        type=_rates,
        default=RATES_HZ,
        metavar="HZ,…",
        help=f"sample rates of the plugin (default {','.join(map(str, RATES_HZ))})",
    )
    parser.add_argument("--tuning", metavar="FILE.scl", help="Scala scale")
    parser.add_argument("--kbm", metavar="FILE.kbm", help="Scala keyboard mapping")
    drone = parser.add_argument_group("a drone", "that the plugin plays by itself, at its own pace or in beats of the host")
    drone.add_argument("--drone", action="store_true", help="export a tanpura that plays itself, like `synth drone`")
    add_strings(drone)
    drone.add_argument("--equal", action="store_true", help="equal temperament instead of just intonation")
    drone.add_argument(
        "--cycle", type=number(float, 1, 60, " s"), default=5.5, metavar="SEC", help="duration of a cycle (default 5.5)"
    )
    drone.add_argument(
        "--beats", type=number(int, 1, 64), default=8, metavar="N", help="quarter notes that it takes in beats (default 8)"
    )
    add_hand(drone)
    defaults = {action.dest: action.default for action in drone._group_actions}
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    parser.add_argument("--json", action="store_true", help="report as JSON")
    parser.set_defaults(run=_export, of_drone=defaults)


def _rates(text: str) -> tuple[int, ...]:
    rates = []
    for each in text.split(","):
        if not each.strip().isdecimal() or not _LOWEST_HZ <= int(each) <= _HIGHEST_HZ:
            raise argparse.ArgumentTypeError(
                f"must be sample rates from {_LOWEST_HZ} to {_HIGHEST_HZ} Hz with commas between, got {text!r}"
            )
        rates.append(int(each))
    return tuple(sorted(set(rates)))


def _export(options: argparse.Namespace) -> int:
    if options.all and options.presets:
        raise ValueError("--all exports all built-in presets; give either --all or presets")
    if not options.all and not options.presets:
        raise ValueError("give a preset to export, or --all (`synth presets` lists them)")
    if options.install and options.output is not None:
        raise ValueError("--install chooses the folder itself; leave -o out")
    from synth.plugin import bundle

    if options.format == WEB:
        kinds: tuple[str, ...] = (WEB,)
        _require_web(options)
    else:
        bundle.require_system()
        kinds = _formats(options)
    drone = _drone(options)
    from synth.plugin.exporting import Export, export

    wanted = Export(
        presets=tuple(options.presets),
        every=options.all,
        name=options.name,
        settings=options.settings,
        quality=options.quality,
        rates_hz=options.rates,
        tuning=options.tuning,
        keyboard=options.kbm,
        drone=drone,
    )

    def targets(name: str) -> dict[str, Path]:
        if options.install:
            return {kind: bundle.users_folder(kind) / f"{name}.{kind}" for kind in kinds}
        if options.output is not None and options.format != "all":
            return {kinds[0]: Path(options.output)}
        if options.format == WEB:
            return {WEB: Path(f"{name}-web")}
        stem = Path(options.output or name)
        return {kind: stem.with_name(f"{stem.name}.{kind}") for kind in kinds}

    with ProgressLine(not options.quiet and sys.stderr.isatty()) as line:
        report = export(wanted, targets, make_folders=options.install, progress=line.preparing, say=warner(options.quiet))
    if options.json:
        print(json.dumps(report.as_dict(), indent=2, allow_nan=False))
    elif not options.quiet:
        print("\n".join(report.lines()))
        if WEB in report.paths:
            print(
                f"to see it: python3 -m http.server --directory {shlex.quote(report.paths[WEB])}, then http://localhost:8000"
            )
    return 0


def _require_web(options: argparse.Namespace) -> None:
    """What an instrument for web pages cannot have is refused; its sample rate is one. Raises ValueError."""
    from synth.plugin.webfolder import RATE_HZ

    if options.install:
        raise ValueError("--install is for plugins; --format web writes a folder, with -o where you like")
    rate = int(RATE_HZ)
    if options.rates not in (RATES_HZ, (rate,)):
        raise ValueError(f"--rates: pages play at {rate} Hz; leave --rates out")
    options.rates = (rate,)


def _drone(options: argparse.Namespace) -> DroneSettings | None:
    """What the options of a drone say; None: there is to be none. Raises ValueError."""
    if not options.drone:
        for name, default in options.of_drone.items():
            if name != "drone" and getattr(options, name) != default:
                raise ValueError(f"--{name} belongs to a drone; add --drone, or leave it out")
        return None
    from synth.drone.cycle import Cycle
    from synth.host.parts import load_presets
    from synth.plugin.droning import DroneSettings

    check_strings(options)
    name = options.presets[0] if options.presets else "tanpura"  # of several presets no drone is made, which `export` says
    preset = load_presets([name], options.settings)[name]
    cycle = Cycle(options.cycle, options.spacing, options.human, seed=options.seed)
    return DroneSettings(**pitches(options, preset), equal=options.equal, cycle=cycle, beats=options.beats)


def _formats(options: argparse.Namespace) -> tuple[str, ...]:
    """The formats that are asked for."""
    from synth.plugin.bundle import format_of

    by_name = None if options.output is None else format_of(options.output)
    if options.format is None:
        if options.install:
            return FORMATS
        if by_name is None:
            what = "-o" if options.output is not None else "the plugin"
            raise ValueError(
                f"the format of {what} is missing: give --format {', '.join(FORMATS)} or all"
                + ("" if options.output is not None else "; or --install puts all three where music programs look")
            )
        return (by_name,)
    if options.format == "all":
        if by_name is not None:
            raise ValueError(f"with --format all, -o must be a name without extension, got {os.fspath(options.output)!r}")
        return FORMATS
    if by_name not in (None, options.format):
        raise ValueError(f"-o {options.output} is named as {by_name}, but --format is {options.format}; change one of them")
    return (options.format,)
