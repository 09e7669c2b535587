"""`synth export`: presets as a plugin for music programs."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from synth.cli.common import RATES_HZ, ProgressLine, add_setting, add_settings, number, warner
from synth.cli.dronestrings import add_hand, add_strings, check_strings, pitches
from synth.files.targets import check_folder
from synth.plugin.platforms import BITS, TARGETS, host

if TYPE_CHECKING:
    from synth.plugin.droning import DroneSettings

FORMATS = ("clap", "vst3", "lv2")
WEB_FORMATS = ("web", "wclap")
#: sample rates that hosts have, and a bank can be made for [Hz]
_LOWEST_HZ, _HIGHEST_HZ = 8000, 384000
#: how what is written for the web is named, behind the plugin's name
_WEB_NAMES = {"web": "-web", "wclap": ".wclap.tar.gz"}


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "export",
        help="export presets as a CLAP, VST3 or LV2 plugin for music programs, or for web pages",
        allow_abbrev=False,
        description="Makes a plugin that needs neither this program nor Python. Several presets become "
        "programs of one plugin. The folders ~/.clap, ~/.vst3 and ~/.lv2 are where music programs look (--install). "
        "--target makes plugins for other systems; for several, each has a folder of its name. --format web writes a "
        "folder with a page that plays the instrument, wclap a CLAP as WebAssembly.",
    )
    parser.add_argument("presets", nargs="*", metavar="PRESET", help="preset (name or .toml file)")
    parser.add_argument("--all", action="store_true", help="all presets of the program in one plugin")
    parser.add_argument(
        "-f",
        "--format",
        choices=(*FORMATS, "all", *WEB_FORMATS),
        help="default: by the extension of -o; with --install all three",
    )
    parser.add_argument("-o", "--output", metavar="PATH", help="output (default: NAME.FORMAT in the current folder)")
    parser.add_argument("--install", action="store_true", help="write it where music programs look for a user's plugins")
    parser.add_argument(
        "--target",
        action="extend",
        type=_targets,
        metavar="TARGET",
        help=f"system and processor it is for: {', '.join(TARGETS)} or all; may be repeated (default: this machine)",
    )
    parser.add_argument(
        "--bits",
        choices=BITS,
        default=BITS[0],
        help="fast (default): what each processor does best; portable: the same samples on every system, slower",
    )
    parser.add_argument("--name", metavar="NAME", help="the plugin's name (default: the preset's; collection of several)")
    add_settings(parser)
    add_setting(parser, "--quality", "quality")
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


def _targets(text: str) -> list[str]:
    """The targets of an option's value, with commas between."""
    found: list[str] = []
    for each in text.split(","):
        if each.strip() != "all" and each.strip() not in TARGETS:
            raise argparse.ArgumentTypeError(f"must be {', '.join(TARGETS)} or all, got {each.strip()!r}")
        found += TARGETS if each.strip() == "all" else [each.strip()]
    return found


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

    bundle.require_system()
    kinds = _formats(options)
    for_web = kinds[0] in WEB_FORMATS
    targets = _for_web(options) if for_web else _wanted_targets(options)
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
        bits=options.bits,
    )

    def places(name: str) -> dict[str, dict[str, Path]]:
        if options.install:
            return {targets[0]: {kind: bundle.users_folder(kind) / f"{name}.{kind}" for kind in kinds}}
        if for_web and options.output is None:
            return {targets[0]: {kinds[0]: Path(name + _WEB_NAMES[kinds[0]])}}
        stem = Path(options.output or name)
        if options.output is not None and options.format != "all":
            paths = {kinds[0]: stem}
        else:
            paths = {kind: stem.with_name(f"{stem.name}.{kind}") for kind in kinds}
        if len(targets) == 1:
            return {targets[0]: paths}
        for path in paths.values():
            check_folder(path, path.parent)
        return {target: {kind: path.parent / target / path.name for kind, path in paths.items()} for target in targets}

    with ProgressLine(not options.quiet and sys.stderr.isatty()) as line:
        report = export(
            wanted,
            places,
            make_folders=options.install or len(targets) > 1,
            progress=line.preparing,
            say=warner(options.quiet),
        )
    if options.json:
        print(json.dumps(report.as_dict(), indent=2, allow_nan=False))
    elif not options.quiet:
        print("\n".join(report.lines()))
    return 0


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


def _for_web(options: argparse.Namespace) -> tuple[str, ...]:
    """The target of formats for the web, which have no other; a page's sample rate is one. Raises ValueError."""
    if options.install or options.target is not None:
        option = "--install" if options.install else "--target"
        raise ValueError(f"{option} is for plugins; with --format {options.format}, leave it out")
    if options.format == "web":
        from synth.plugin.webfolder import RATE_HZ

        rate = int(RATE_HZ)
        if options.rates not in (RATES_HZ, (rate,)):
            raise ValueError(f"--rates: pages play at {rate} Hz; leave --rates out")
        options.rates = (rate,)
    return ("web",)


def _wanted_targets(options: argparse.Namespace) -> tuple[str, ...]:
    """The names of the targets that are asked for. Raises ValueError."""
    here = host()
    if options.target is None and here is None:
        raise ValueError(f"this machine is none of {', '.join(TARGETS)}; choose one with --target")
    own = [here.name] if here is not None else []
    wanted = tuple(dict.fromkeys(own if options.target is None else options.target))
    if options.install and (others := [each for each in wanted if each not in own]):
        raise ValueError(
            f"--install puts plugins where this machine's music programs look, which cannot run {others[0]}: "
            "leave --install out, and copy what is written"
        )
    return wanted


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
                f"the format of {what} is missing: give --format {', '.join((*FORMATS, *WEB_FORMATS))} or all"
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
