"""`synth doctor`: what works on this machine, and what helps where something does not."""

from __future__ import annotations

import argparse
import json
import platform
import sys
from typing import Any

from synth._version import __version__
from synth.cli import colours
from synth.cli.apart import Patients
from synth.cli.checkups import CHECKUPS, MISSING, NEEDED, NOT_TRIED, OK, Finding
from synth.cli.common import number

_COLOURS = {OK: colours.GOOD, MISSING: colours.FAULT, NOT_TRIED: colours.OPEN}


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "doctor",
        help="check what works on this machine, and how to fix the rest",
        allow_abbrev=False,
        description="Looks at libraries, kernels, audio, MIDI, JACK, PipeWire, browser and plugin folders; writes nothing. "
        "Exit code 0: `synth render` works; 1: it does not. Only rendering is needed; the rest serves its own command.",
    )
    parser.add_argument(
        "--timeout",
        type=number(float, 1, 3600, " s"),
        default=30.0,
        metavar="SEC",
        help="time limit for devices and servers to answer (default 30)",
    )
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(run=_doctor)


def _doctor(options: argparse.Namespace) -> int:
    system = f"{platform.system()} {platform.release()} {platform.machine()}".strip()
    if not options.json:
        print(f"jawari {__version__}, Python {platform.python_version()}, {system}", flush=True)
    findings: dict[str, Finding] = {}
    with Patients(list(CHECKUPS), options.timeout) as patients:
        for name in CHECKUPS:
            findings[name] = patients.finding(name)
            if not options.json:
                print("\n".join(_lines(name, findings[name])), flush=True)
    works = all(findings[name].verdict == OK for name in NEEDED)
    if options.json:
        about = {"version": __version__, "python": platform.python_version(), "system": system, "renders": works}
        checks = [{"name": name, **found._asdict()} for name, found in findings.items()]
        print(json.dumps({**about, "checks": checks}, indent=2))
    return 0 if works else 1


def _lines(name: str, found: Finding) -> list[str]:
    wide, names = max(map(len, _COLOURS)), max(map(len, CHECKUPS))
    verdict = colours.shown(found.verdict.ljust(wide), _COLOURS[found.verdict], sys.stdout)
    lines = [f"{verdict}  {name:{names}}  {found.what}"]
    if found.remedy:
        lines.append(" " * (wide + names + 4) + f"→ {found.remedy}")
    return lines
