"""`synth render`: a MIDI file to an audio file."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from synth.cli import bits
from synth.cli.common import (
    MOST_BLOCK,
    ProgressLine,
    add_controllers,
    add_instruments,
    add_physics,
    add_seed,
    add_setting,
    add_threads,
    add_verbose,
    number,
    playing_options,
    tail,
    warner,
)


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "render",
        help="render a MIDI file to an audio file",
        allow_abbrev=False,
        description="Renders a Standard MIDI File. Without -p, the nearest preset plays each General MIDI "
        "program; percussion (channel 10) is left out.",
    )
    parser.add_argument("midi", metavar="IN.mid", help="the song: a Standard MIDI File")
    parser.add_argument(
        "-o", "--output", metavar="FILE", help="output file, - for standard output (default: IN.wav in the current folder)"
    )
    what = parser.add_argument_group("instruments")
    add_instruments(what)
    add_controllers(what)
    what.add_argument(
        "--transpose",
        action="append",
        default=[],
        metavar="[CH=]SEMITONES,…",
        help="transpose all channels or single ones (1 to 16), such as --transpose=-12,3=7",
    )
    what.add_argument(
        "--fold",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="move notes outside the preset's range into it by octaves (default: where a program chose the preset)",
    )
    what.add_argument(
        "--rest",
        metavar="FILE.sf2",
        help="a SoundFont that plays everything else: percussion, winds and other programs that are not strings",
    )
    what.add_argument("--fallback", metavar="PRESET", help="preset for the notes that the channel's own cannot play")

    how = parser.add_argument_group("computation")
    add_physics(how)
    add_setting(how, "--restitution", "restitution", default=None, metavar="E")
    how.add_argument(
        "--block",
        type=number(int, 1, MOST_BLOCK),
        default=1024,
        metavar="N",
        help="frames per block (no effect on the sound)",
    )
    add_threads(how)
    add_seed(how)
    bits.add_bits(how)

    level = parser.add_argument_group("level")
    add_setting(level, "--gain", "gain_db", metavar="DB")
    level.add_argument(
        "--normalize",
        type=number(float, -96, 0, " dBFS"),
        metavar="DBFS",
        help="scale the peak to this level (default -1)",
    )
    add_setting(level, "--no-limiter", "limiter", action="store_false", help="let peaks exceed full scale")

    out = parser.add_argument_group("output")
    out.add_argument("--format", choices=("wav", "flac", "raw"), help="default: by the file name's extension")
    out.add_argument("--bit-depth", choices=("16", "24", "float"), default="24", help="default 24; 16 is dithered")
    out.add_argument(
        "--tail",
        type=tail,
        metavar="SEC",
        help="seconds after the end, or auto (default): until silence",
    )
    out.add_argument("--start", type=number(float, 0, 1e6, " s"), default=0.0, metavar="SEC", help="where to begin")
    out.add_argument("--end", type=number(float, 0, 1e6, " s"), metavar="SEC", help="where to end")
    out.add_argument("--stems", metavar="DIR", help="also write every part to a separate file")
    out.add_argument("--quiet", action="store_true", help="print errors only")
    add_verbose(out)
    out.add_argument("--json", action="store_true", help="report as JSON")
    parser.set_defaults(run=_render)


def _render(options: argparse.Namespace) -> int:
    # What can be judged without reading or loading anything comes first.
    if options.restitution is not None and options.scheme == "exact-hold":
        raise ValueError("--restitution belongs to the Moreau–Jean schemes; add --scheme moreau-jean")
    if options.internal_rate_hz is not None and options.internal_rate_hz % options.rate:
        raise ValueError(
            f"--internal-rate must be a multiple of --rate ({options.rate} Hz), got {options.internal_rate_hz}; "
            f"take {max(1, round(options.internal_rate_hz / options.rate)) * options.rate}"
        )
    if options.output is None and options.stems is None:
        options.output = _default_output(options.midi, options.format)
    playing = playing_options(options)
    from synth.host.compass import parse_transpose
    from synth.host.render import RenderSettings, render_file

    settings = RenderSettings(
        midi=options.midi,
        output=options.output,
        rate_hz=options.rate,
        block=options.block,
        normalize_dbfs=options.normalize,
        tail=options.tail,
        stems=options.stems,
        container=options.format,
        start_s=options.start,
        end_s=options.end,
        transpose=parse_transpose(options.transpose),
        fold=options.fold,
        fallback=options.fallback,
        rest=options.rest,
        **playing,
    )

    with ProgressLine(not options.quiet and sys.stderr.isatty()) as line:
        report = render_file(settings, warn=warner(options.quiet), progress=line.show, preparing=line.preparing)
    # With the sound on standard output, words go to standard error.
    where = sys.stderr if options.output == "-" else sys.stdout
    if options.json:
        print(json.dumps(report.as_dict() | {"bits": options.bits}, indent=2, allow_nan=False), file=where)
    elif not options.quiet:
        print("\n".join(report.lines()), file=where)
    return 0


def _default_output(midi: str, container: str | None) -> str:
    """SONG.wav in the current directory. Raises FileExistsError rather than write over a file that was not named."""
    from pathlib import Path

    name = f"{Path(midi).stem}.{container or 'wav'}"
    if Path(name).exists():
        raise FileExistsError(f"{name} already exists; -o {name} overwrites it, -o NAME writes another")
    return name


def joined_normalize(arguments: list[str]) -> list[str]:
    """`--normalize -3` and a bare `--normalize` as one word: argparse would take a file name for the
    level.
    """
    joined: list[str] = []
    at = 0
    while at < len(arguments):
        word = arguments[at]
        at += 1
        if word == "--normalize":
            level = "-1"
            if at < len(arguments):
                try:
                    float(arguments[at])
                except ValueError:
                    pass
                else:
                    level = arguments[at]
                    at += 1
            word = f"--normalize={level}"
        joined.append(word)
        if word == "--":
            return joined + arguments[at:]
    return joined
