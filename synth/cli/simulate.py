"""`synth simulate`: a string, or strings that share a body, by a case file."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any, cast

from synth.cli.common import number, scheme, setting, warner
from synth.instrument.qualities import QUALITIES
from synth.signals import hearing_signals
from synth.solver.schemes import ON_A_BODY, SCHEMES

if TYPE_CHECKING:
    from synth.research.simulation import Overrides


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "simulate",
        help="simulate a string, or strings on a body, from a case file: motion, forces and energy as arrays",
        allow_abbrev=False,
        description="Computes a case file (TOML) and writes its results; options replace its values. "
        "docs/reference/case-keys.md has every key with its unit, range and default.",
    )
    parser.add_argument("case", metavar="CASE", help="a .toml file, or a case of the program by name: tanpura, bass, hard/…")
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUT",
        help=".npz: everything (for --from, load_result); .csv: a table of the rows",
    )
    parser.add_argument(
        "--from", dest="resume_from", metavar="RUN.npz", help="continue from the end of that run, for --duration more"
    )
    parser.add_argument(
        "--scheme",
        type=scheme(SCHEMES | ON_A_BODY),
        metavar="NAME",
        help=f"{', '.join(SCHEMES)}, or an installed contact law; of strings on a body exact-hold or complex-modes",
    )
    parser.add_argument(
        "--restitution", type=number(float, 0, 1), metavar="E", help="restitution of the Moreau–Jean schemes and of walls"
    )
    parser.add_argument(
        "--stiffness", type=number(float, 0, 1e30), metavar="K", help="stiffness of a compliant contact, N/m^α"
    )
    parser.add_argument("--exponent", type=number(float, 1, 100), metavar="A", help="exponent α of a compliant contact")
    parser.add_argument(
        "--quality", choices=QUALITIES, help="for one string: rate and modes as `synth render` would choose them"
    )
    parser.add_argument("--rate", type=number(float, 1, 1e9, " Hz"), metavar="HZ", help="internal rate")
    parser.add_argument("--output-rate", type=number(float, 1, 1e9, " Hz"), metavar="HZ", help="rate of the output arrays")
    parser.add_argument("--modes", type=number(int, 1, 100_000), metavar="N", help="number of modes")
    parser.add_argument(
        "--substeps", type=number(int, 1, 64), metavar="K", help="for exact-hold: the contact force changes K times a step"
    )
    parser.add_argument(
        "--tail-modes",
        choices=("lumped", "static", "none"),
        dest="tail",
        help="for exact-hold: what represents the omitted modes",
    )
    parser.add_argument("--duration", type=number(float, 1e-9, 1e6, " s"), metavar="SEC", help="how long")
    parser.add_argument("--ledger", action="store_true", default=None, help="also keep the energy ledger")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        type=_setting,
        dest="settings",
        metavar="KEY=VALUE",
        help="change any value of the case, such as string.tension_n=60 or obstacle.heights_m=[0.0]; may be repeated",
    )
    parser.add_argument("--json", action="store_true", help="summary as JSON")
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    parser.set_defaults(run=_simulate)


def _setting(text: str) -> tuple[str, Any]:
    """An option's type: (dotted key, value) of KEY=VALUE, the value read as TOML where it is TOML."""
    from synth.instrument.table import written_value

    only, key, value = setting(text)
    if only is not None:
        raise argparse.ArgumentTypeError(
            f"must be KEY=VALUE; a case has no parts: leave out {only + ':'!r}, got {text!r:.80}"
        )
    return key, written_value(value)


def _simulate(options: argparse.Namespace) -> int:
    from synth.files.targets import Named, check_apart, check_target
    from synth.research.case import files_of
    from synth.research.result import check_name
    from synth.research.simulation import simulate

    names = (
        "scheme", "restitution", "stiffness", "exponent", "quality", "rate", "output_rate", "modes", "substeps", "tail",
        "duration", "ledger",
    )  # fmt: skip
    overrides = {name: value for name in names if (value := getattr(options, name)) is not None}

    def work() -> Any:
        import numpy as np

        with np.errstate(all="ignore"):  # what is not finite the summary says
            return simulate(
                options.case,
                resume_from=options.resume_from,
                warn=warner(options.quiet),
                settings=dict(options.settings),
                **cast("Overrides", overrides),
            )

    read = [Named("case", path) for path in files_of(options.case)]
    if options.resume_from is not None:
        read.append(Named("--from", options.resume_from))
    check_apart(read, [Named("-o", options.output)])
    check_name(options.output)
    check_target(options.output)
    result = hearing_signals(work)
    result.save(options.output)
    summary = result.summary
    if options.json:
        print(json.dumps(summary, indent=2, allow_nan=False))
    elif not options.quiet:
        print(f"{options.output}: " + ", ".join(f"{key} {_brief(value)}" for key, value in summary.items()))
    return 0


def _brief(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
