"""`synth setup`: where an instrument buzzes, and how to set it up."""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from synth.cli import common
from synth.cli.common import ProgressLine
from synth.instrument.qualities import QUALITIES

if TYPE_CHECKING:
    from synth.instrument.preset import Preset
    from synth.setup.buzz_map import BuzzMap

#: endings of maps and of set-ups that are written
MAPS = (".csv", ".parquet", ".png", ".svg", ".pdf")
SETUPS = (".toml",)


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "setup",
        help="where an instrument buzzes, and how to set it up: action, relief, a high fret, the thread of a bridge",
        allow_abbrev=False,
        description="Plucks every string at every fret harder and harder and tells from which displacement on it touches "
        "and buzzes, and on what. With --want: the lowest set-up that keeps it, or the bridge that buzzes longest. "
        "docs/setup.md explains the measure.",
    )
    parser.add_argument("preset", metavar="PRESET", help="preset: a name, or a .toml file")
    common.add_settings(parser)
    parser.add_argument(
        "--stroke", type=_stroke, metavar="STROKE",
        help="soft, medium (default), hard, or a MIDI velocity of 1 to 127: its place, width and speed; notes that buzz at "
        "it are marked",
    )  # fmt: skip
    parser.add_argument(
        "--place", type=common.number(float, 1, 5000, " mm"), metavar="MM",
        help="where the string is plucked, from the saddle (default: where the preset's stroke is)",
    )  # fmt: skip
    parser.add_argument(
        "--string", action="append", dest="strings", metavar="NAME", help="only this string; may be repeated"
    )
    parser.add_argument(
        "--frets", type=_frets, metavar="LOW-HIGH", help="only these frets, such as 0-12; 0 is the open string"
    )
    parser.add_argument(
        "--fret-heights", metavar="FILE.csv",
        help="measured heights of all frets (columns fret and height_mm, height_um or height_thou) in the place of "
        "setup.fret_heights_mm",
    )  # fmt: skip
    parser.add_argument("--tension", action="store_true", help="also list each string's gauge, mass and tension")
    parser.add_argument(
        "--want", metavar="WISH",
        help='what the set-up must keep, such as "no buzz at medium, except open strings hard" or "longest buzz at medium"',
    )  # fmt: skip
    parser.add_argument(
        "--audible", type=common.number(float, 0.5, 40, " dB"), metavar="DB",
        help="from how many dB on a buzz counts (default 3)",
    )  # fmt: skip
    parser.add_argument("--quality", choices=QUALITIES, help="accuracy (default: draft, of a longest buzz standard)")
    parser.add_argument(
        "--threads", type=common.number(int, 1, 256), metavar="N", help="notes computed at a time (default: all processors)"
    )
    parser.add_argument(
        "-o", "--output", action="append", default=[], metavar="FILE",
        help=f"write the map ({', '.join(MAPS)}) or, with --want, the preset as proposed (.toml); may be repeated",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.add_argument("--quiet", action="store_true", help="print errors only")
    parser.set_defaults(run=_setup)


def _stroke(text: str) -> str | int:
    """An option's type: the name of a stroke, or a velocity."""
    from synth.setup.plucking import VELOCITIES

    if text in VELOCITIES:
        return text
    if re.fullmatch(r"\d{1,3}", text) and 1 <= int(text) <= 127:
        return int(text)
    raise argparse.ArgumentTypeError(f"must be {', '.join(VELOCITIES)} or a velocity of 1 to 127, got {text!r:.40}")


def _frets(text: str) -> tuple[int, int]:
    """An option's type: LOW-HIGH, or one number."""
    found = re.fullmatch(r"(\d{1,2})(?:-(\d{1,2}))?", text)
    if found is None or int(found[2] or found[1]) < int(found[1]):
        raise argparse.ArgumentTypeError(f"must be LOW-HIGH, such as 0-12, got {text!r:.40}")
    return int(found[1]), int(found[2] or found[1])


def _setup(options: argparse.Namespace) -> int:
    from synth.setup import missing

    if (why := missing()) is not None:
        raise ValueError(why)
    _check_outputs(options)
    text, edits, preset = _read(options)
    if options.want is not None:
        return _wanted(preset, options, lambda more: _changed(text, [*edits, *more]))
    return _mapped(preset, options)


def _asked(options: argparse.Namespace) -> dict[str, Any]:
    """Arguments that maps and answers to wishes share; what is not given is theirs to choose."""
    from synth.native.processors import cores

    asked: dict[str, Any] = {"strings": options.strings, "threads": options.threads or cores()}
    if options.place is not None:
        asked["place_m"] = 1e-3 * options.place
    if options.quality is not None:
        asked["quality"] = options.quality
    if options.audible is not None:
        asked["audible_db"] = options.audible
    return asked


def _check_outputs(options: argparse.Namespace) -> None:
    """Raises ValueError for an output that cannot be, before anything is computed; OSError."""
    from synth.files.targets import Named, check_apart, check_target
    from synth.instrument.preset import preset_path

    known = SETUPS if options.want is not None else MAPS
    for name in options.output:
        ending = Path(name).suffix.lower()
        if ending not in known:
            what = "a set-up (--want) is written as" if options.want is not None else "a map is written as"
            raise ValueError(
                f"-o {name}: {what} {', '.join(known)}, got {ending or 'no ending'!r}; change the name's ending"
            )
        if ending == ".parquet":
            common.needed("Parquet files need", ("pyarrow",), "setup")
        if ending in (".png", ".svg", ".pdf"):
            common.needed("pictures need", ("matplotlib",), "setup")
        check_target(name)
    read = [Named("preset", preset_path(options.preset))]
    if options.fret_heights is not None:
        read.append(Named("--fret-heights", options.fret_heights))
    check_apart(read, [Named("-o", name) for name in options.output])


def _read(options: argparse.Namespace) -> tuple[str, list[tuple[str, Any]], Preset]:
    """The preset's text, which may come from a pipe, [(path, value)] that options change, and the preset with these. Raises
    ValueError, PresetError, OSError."""
    from synth.instrument.fret_heights import read_fret_heights
    from synth.instrument.preset import parse_preset, preset_path, read_preset, with_plan_beside
    from synth.instrument.table import written_value

    text = read_preset(options.preset)
    preset = with_plan_beside(parse_preset(text, options.preset), preset_path(options.preset))
    edits: list[tuple[str, Any]] = []
    for only, key, value in options.settings:
        if only is not None and only != preset.name:
            raise ValueError(f"--set {only}:{key}: this command has one preset, {preset.name}; leave out {only + ':'!r}")
        edits.append((key, written_value(value)))
    if options.fret_heights is not None:
        edits.append(("setup.fret_heights_mm", [round(each, 6) for each in read_fret_heights(options.fret_heights)]))
    for key, value in edits:
        preset = preset.with_setting(key, value if isinstance(value, str) else json.dumps(value))
    return text, edits, preset


def _mapped(preset: Preset, options: argparse.Namespace) -> int:
    from synth.setup.buzz_map import buzz_map
    from synth.setup.report import neck_lines, rows, string_lines, terminal_text

    frets = None if options.frets is None else range(options.frets[0], options.frets[1] + 1)
    with ProgressLine(not options.quiet and sys.stderr.isatty()) as line:
        found = buzz_map(
            preset,
            stroke=options.stroke or "medium",
            frets=frets,
            told=line.notes,
            **_asked(options),
        )
    if options.json:
        about = {
            "preset": found.preset, "stroke": found.stroke, "velocity": found.velocity, "quality": found.quality,
            "audible_db": found.audible_db, "complete": found.complete, "notes": rows(found), "files": options.output,
        }  # fmt: skip
        print(json.dumps(about, indent=2, allow_nan=False))
    elif not options.quiet:
        strings = string_lines(preset) if options.tension else []
        print("\n".join([terminal_text(found), *neck_lines(preset), *strings]))
    for name in options.output:  # after what was computed has been printed
        _write_map(found, name)
        if not options.quiet and not options.json:
            print(name)
    if not found.complete:
        print(f"synth: interrupted: {len(found.spots)} notes were computed and are kept", file=sys.stderr)
        return 130
    return 0


def _write_map(found: BuzzMap, name: str) -> None:
    from synth.files.targets import write_text
    from synth.setup import report

    ending = Path(name).suffix.lower()
    if ending == ".csv":
        write_text(name, report.csv_text(found))
    elif ending == ".parquet":
        from synth.study.columns import table
        from synth.study.keeping import write_table

        write_table(table(report.rows(found), report.COLUMNS), Path(name))
    else:
        from synth.setup.neck_picture import draw

        draw(found, name)


def _wanted(preset: Preset, options: argparse.Namespace, changed: Callable[[list[tuple[str, Any]]], str]) -> int:
    """An answer to a wish. changed: the preset's text with [(path, value)] changed, too."""
    from synth.files.targets import write_text
    from synth.instrument.preset import parse_preset
    from synth.setup import longest, proposals
    from synth.setup.places import check_touches, string_names
    from synth.setup.report import options_line
    from synth.setup.wants import parse

    for name in ("stroke", "tension"):
        if getattr(options, name):
            raise ValueError(f"--{name} is for a map, and a wish names its strokes; leave it out beside --want")
    if options.frets is not None:
        raise ValueError('--frets is for a map; with --want name frets in the wish, such as "except frets 13-20 soft"')
    check_touches(preset)
    want = parse(options.want, string_names(preset))
    with ProgressLine(not options.quiet and sys.stderr.isatty()) as line:
        if want.longest:
            bridges = longest.longest(preset, want.rules[0].velocity or 1, told=line.notes, **_asked(options))
            edits = longest.settings(preset, bridges)
            about, text = longest.about(bridges, edits), longest.lines(preset, bridges)
        else:
            found = proposals.propose(preset, want, told=lambda done, total: line.measuring(done / total), **_asked(options))
            edits, about, text = list(found.proposal.settings), found.about(), found.lines()
    if options.json:
        print(json.dumps({"preset": preset.name, "want": options.want, **about}, indent=2, allow_nan=False))
    elif not options.quiet:
        print("\n".join([*text, f"  {options_line(edits)}"]))
    for name in options.output:
        proposed = changed(edits)
        parse_preset(proposed, name)
        write_text(name, proposed)
        if not options.quiet and not options.json:
            print(name)
    return 0


def _changed(text: str, edits: list[tuple[str, Any]]) -> str:
    """A preset's text, comments and all, with [(path, value)] changed."""
    import tomlkit

    from synth.author.toml_edit import change_in

    document = tomlkit.parse(text)
    for path, value in edits:
        document = change_in(document, path, value)
    return tomlkit.dumps(document)
