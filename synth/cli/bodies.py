"""`synth body fit`: the modes of a body out of measured mobilities of its bridge, as tables of a preset."""

from __future__ import annotations

import argparse
import json
from typing import Any

from synth.cli.common import Parser, number


def add(commands: Any) -> None:
    parser = commands.add_parser("body", help="the body that strings share: modes from measurements", allow_abbrev=False)
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True, parser_class=Parser)
    fit = actions.add_parser("fit", help="fit the modes of a body to measured mobilities of its bridge", allow_abbrev=False)
    fit.add_argument(
        "mobility",
        metavar="MOBILITY.csv",
        help="a table of frequency_hz, y11_re, y11_im (m/s/N) or y11_db, y11_phase_deg; also y12, y22, y13 … "
        "(1 normal, 2 lateral, 3 rocking)",
    )
    fit.add_argument(
        "--modes", type=number(int, 1, 100), metavar="N", help="maximum number of modes (default: chosen by the data)"
    )
    fit.add_argument(
        "--band",
        nargs=2,
        type=number(float, 20, 10000, " Hz"),
        metavar=("LO", "HI"),
        help="rows to use [Hz] (default: 20 10000)",
    )
    fit.add_argument("-o", "--output", metavar="BODY.toml", help="file for the tables (default: standard output)")
    fit.add_argument("--json", action="store_true", help="the report as JSON")
    fit.set_defaults(run=_fit)


def _fit(options: argparse.Namespace) -> int:
    from synth.files.targets import Named, check_apart, check_target, write_text
    from synth.fit import missing

    reason = missing()
    if reason is not None:
        raise ValueError(reason)
    from synth.fit.body_fit import fit_body
    from synth.fit.body_report import body_report, body_toml, body_words
    from synth.fit.mobility import read_mobility

    if options.output is not None:
        check_apart([Named("mobility", options.mobility)], [Named("-o", options.output)])
        check_target(options.output)
    measured = read_mobility(options.mobility)
    try:
        found = fit_body(measured, None if options.band is None else tuple(options.band), options.modes)
    except ValueError as error:
        raise ValueError(f"{options.mobility}: {error}") from None
    told = body_report(found)
    if measured.ignored:
        told["warnings"].append(f"columns ignored, as they are not mobilities: {', '.join(measured.ignored)}")
    text = body_toml(told, options.mobility)
    if options.output is not None:
        write_text(options.output, text)
        told["output"] = options.output
    if options.json:
        print(json.dumps(told, indent=2, allow_nan=False))
    elif options.output is None:
        print(text, end="")
    else:
        print("\n".join([f"{options.mobility}: {line}" for line in body_words(told)] + [f"written: {options.output}"]))
    return 0
