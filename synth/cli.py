"""The command line: `synth render`, `presets`, `plan`, `simulate`.

Exit codes: 0 done; 1 failed for a reason that lies in the program; 2 wrong usage or input (one line on
standard error says what); 130 or 143 interrupted or terminated. Everything heavy is imported where it is
used, so that help comes at once.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from synth.schemes import LAWS, SCHEMES

RATES_HZ = (44100, 48000, 88200, 96000)
QUALITIES = ("draft", "standard", "fine", "reference")
MOST_BLOCK = 4096


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line (`sys.argv` by default) and returns the exit code."""
    arguments = _joined_normalize(list(sys.argv[1:] if arguments is None else arguments))
    previous = _raise_on_termination()
    try:
        options = _parser().parse_args(arguments)
        return options.run(options)
    except BrokenPipeError:
        # Whoever read our output has enough. Standard output is flushed once more at exit, which must not
        # fail.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (ValueError, OSError) as error:
        for line in _message(error).splitlines():
            print(f"synth: error: {line}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("synth: interrupted", file=sys.stderr)
        return 130
    except _Terminated:
        return 128 + signal.SIGTERM
    finally:
        if previous is not None:
            signal.signal(signal.SIGTERM, previous)


class _Terminated(BaseException):
    """SIGTERM as an exception, so that unfinished files are removed on the way out."""


def _raise_on_termination() -> Any:
    def terminate(*_: object) -> NoReturn:
        raise _Terminated

    try:
        return signal.signal(signal.SIGTERM, terminate)
    except ValueError:
        # Signals can be caught in the main thread only; a caller in another one looks after them itself.
        return None


def _message(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        names = [str(name) for name in (error.filename, error.filename2) if name is not None]
        return f"{': '.join(names)}: {error.strerror}" if names else error.strerror
    return str(error) or type(error).__name__


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; the usage is a --help away."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"synth: error: {message} (see {self.prog} --help)\n")


def _number(kind: Callable[[str], float], low: float, high: float, unit: str = "") -> Callable[[str], float]:
    what = "a whole number" if kind is int else "a number"

    def parse(text: str) -> float:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        # Written so that NaN fails too.
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"must be {what} from {low:.12g} to {high:.12g}{unit}, got {text!r}")
        return value

    return parse


def _rate(text: str) -> int:
    if text not in [str(rate) for rate in RATES_HZ]:
        allowed = ", ".join(map(str, RATES_HZ))
        raise argparse.ArgumentTypeError(f"must be one of {allowed} Hz, got {text!r}")
    return int(text)


def _tail(text: str) -> float | str:
    return text if text == "auto" else _number(float, 0, 3600, " s (or auto)")(text)


def _threads(text: str) -> int | str:
    return text if text == "auto" else int(_number(int, 1, 256, " (or auto)")(text))


def _setting(text: str) -> tuple[str | None, str, str]:
    key, equals, value = text.partition("=")
    only, colon, rest = key.rpartition(":")
    if not equals or not rest.strip():
        raise argparse.ArgumentTypeError(f"must be KEY=VALUE or PRESET:KEY=VALUE, got {text!r}")
    return (only.strip() if colon else None), rest.strip(), value.strip()


def _joined_normalize(arguments: list[str]) -> list[str]:
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


class _Version(argparse.Action):
    """Looks the version up only when asked: importlib.metadata costs as much as the rest of --help."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> NoReturn:
        from importlib import metadata

        try:
            version = metadata.version("jawari")
        except metadata.PackageNotFoundError:
            version = "(not installed)"
        print(f"synth (jawari) {version}")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="synth", description="Strings that collide: a MIDI file in, sound out.", allow_abbrev=False)
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=_Parser)
    _add_render(commands)
    _add_presets(commands)
    _add_plan(commands)
    _add_simulate(commands)
    return parser


def _add_physics(group: Any) -> None:
    """Options that every command with a rate and a quality has."""
    group.add_argument(
        "-r", "--rate", type=_rate, default=44100, metavar="HZ", help="44100 (default), 48000, 88200 or 96000"
    )
    group.add_argument("--quality", choices=QUALITIES, default="standard", help="accuracy; see `synth plan`")
    group.add_argument("--scheme", choices=tuple(LAWS), default="exact-hold", help="how contact is computed")
    group.add_argument(
        "--internal-rate",
        type=_number(int, 44100, 50_000_000, " Hz"),
        metavar="HZ",
        help="rate of the string model, a multiple of --rate (default: chosen by --quality)",
    )


def _add_render(commands: Any) -> None:
    parser = commands.add_parser(
        "render",
        help="a MIDI file to an audio file",
        allow_abbrev=False,
        description="Renders a Standard MIDI File. Without -p, General MIDI basses go to fretted-bass, "
        "everything else to jawari-harp; percussion (channel 10) is left out.",
    )
    parser.add_argument("midi", metavar="IN.mid")
    parser.add_argument("-o", "--output", metavar="FILE", help="audio file to write; - for standard output")
    what = parser.add_argument_group("instruments")
    what.add_argument("-p", "--preset", metavar="PRESET", help="preset (name or .toml file) for all channels")
    what.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="CH=PRESET,…",
        help="presets of single channels (1 to 16); none leaves a channel out",
    )
    what.add_argument(
        "--set",
        action="append",
        default=[],
        type=_setting,
        dest="settings",
        metavar="[PRESET:]KEY=VALUE",
        help="change a value of the preset, such as pluck.position=0.2; may be repeated",
    )
    what.add_argument("--polyphony", type=_number(int, 1, 1024), metavar="N", help="most strings that sound at once")
    what.add_argument("--tuning", metavar="FILE.scl", help="Scala scale")
    what.add_argument("--kbm", metavar="FILE.kbm", help="Scala keyboard mapping")

    how = parser.add_argument_group("computation")
    _add_physics(how)
    how.add_argument(
        "--restitution",
        type=_number(float, 0, 1),
        metavar="E",
        help="restitution of the Moreau–Jean schemes, 0 (default) to 1",
    )
    how.add_argument(
        "--block",
        type=_number(int, 1, MOST_BLOCK),
        default=1024,
        metavar="N",
        help="frames per block (no effect on the sound)",
    )
    how.add_argument(
        "--threads",
        type=_threads,
        default="auto",
        metavar="N",
        help="how many compute, or auto (default): one per processor (no effect on the sound)",
    )
    how.add_argument(
        "--seed",
        type=_number(int, 0, 2**32 - 1),
        default=0,
        metavar="N",
        help="for whatever is random (default 0)",
    )

    level = parser.add_argument_group("level")
    level.add_argument("--gain", type=_number(float, -96, 96, " dB"), default=0.0, metavar="DB", help="gain in dB")
    level.add_argument(
        "--normalize",
        type=_number(float, -96, 0, " dBFS"),
        metavar="DBFS",
        help="scale so that the peak is there; =-1 if no level is given",
    )
    level.add_argument("--no-limiter", action="store_true", help="let peaks go above full scale")

    out = parser.add_argument_group("output")
    out.add_argument("--format", choices=("wav", "flac", "raw"), help="default: by the ending of the file's name")
    out.add_argument("--bit-depth", choices=("16", "24", "float"), default="24", help="default 24; 16 is dithered")
    out.add_argument(
        "--tail",
        type=_tail,
        metavar="SEC",
        help="seconds after the end, or auto (default): until it is quiet",
    )
    out.add_argument("--start", type=_number(float, 0, 1e6, " s"), default=0.0, metavar="SEC", help="where to begin")
    out.add_argument("--end", type=_number(float, 0, 1e6, " s"), metavar="SEC", help="where to end")
    out.add_argument("--stems", metavar="DIR", help="write every part to a file of its own, too")
    out.add_argument("--quiet", action="store_true", help="say nothing but errors")
    out.add_argument("--json", action="store_true", help="report as JSON")
    parser.set_defaults(run=_render)


def _render(options: argparse.Namespace) -> int:
    # What can be judged without reading or loading anything comes first.
    if options.restitution is not None and options.scheme == "exact-hold":
        raise ValueError("--restitution belongs to the Moreau–Jean schemes; add --scheme moreau-jean")
    if options.internal_rate is not None and options.internal_rate % options.rate:
        raise ValueError(
            f"--internal-rate must be a multiple of --rate ({options.rate} Hz), got {options.internal_rate}; "
            f"take {max(1, round(options.internal_rate / options.rate)) * options.rate}"
        )
    if options.output is None and options.stems is None:
        raise ValueError("there is nothing to write; give -o OUT.wav or --stems DIR")
    from synth.host.parts import parse_channel_map

    channel_presets = parse_channel_map(options.map)
    from synth.host.render import RenderSettings, render_file

    settings = RenderSettings(
        midi=options.midi,
        output=options.output,
        preset=options.preset,
        channel_presets=channel_presets,
        settings=options.settings,
        rate_hz=options.rate,
        block=options.block,
        threads=options.threads,
        quality=options.quality,
        scheme=options.scheme,
        restitution=0.0 if options.restitution is None else options.restitution,
        internal_rate_hz=options.internal_rate,
        limiter=not options.no_limiter,
        gain_db=options.gain,
        polyphony=options.polyphony,
        normalize_dbfs=options.normalize,
        tail=options.tail,
        stems=options.stems,
        container=options.format,
        bit_depth=options.bit_depth,
        start_s=options.start,
        end_s=options.end,
        seed=options.seed,
        tuning=options.tuning,
        keyboard=options.kbm,
    )

    def warn(text: str) -> None:
        if not options.quiet:
            print(f"synth: {text}", file=sys.stderr)

    with _ProgressLine(not options.quiet and sys.stderr.isatty()) as line:
        report = render_file(settings, warn=warn, progress=line.show)
    # With the sound on standard output, words go to standard error.
    where = sys.stderr if options.output == "-" else sys.stdout
    if options.json:
        print(json.dumps(report.as_dict(), indent=2, allow_nan=False), file=where)
    elif not options.quiet:
        print("\n".join(report.lines()), file=where)
    return 0


class _ProgressLine:
    """One line on the terminal that overwrites itself, at most ten times a second."""

    def __init__(self, on: bool) -> None:
        self._on = on
        self._began: float | None = None
        self._shown = 0.0
        self._width = 0

    def show(self, done_s: float, total_s: float) -> None:
        now = time.monotonic()
        if self._began is None:
            self._began = now
        if not self._on or now - self._shown < 0.1:
            return
        self._shown = now
        speed = done_s / max(now - self._began, 1e-9)
        percent = 100.0 * done_s / total_s if total_s > 0.0 else 100.0
        self._write(f"{percent:3.0f} %  {done_s:.1f} of at most {total_s:.1f} s  {speed:.1f}× real time")

    def _write(self, text: str) -> None:
        sys.stderr.write("\r" + text.ljust(self._width))
        sys.stderr.flush()
        self._width = len(text)

    def __enter__(self) -> _ProgressLine:
        return self

    def __exit__(self, *_: object) -> None:
        if self._width:
            self._write("")
            sys.stderr.write("\r")


def _add_presets(commands: Any) -> None:
    parser = commands.add_parser("presets", help="list, show or check presets", allow_abbrev=False)
    parser.set_defaults(run=_list_presets, json=False)
    actions = parser.add_subparsers(title="actions", metavar="ACTION", parser_class=_Parser)
    listing = actions.add_parser("list", help="the presets that come with the program (default)", allow_abbrev=False)
    listing.add_argument("--json", action="store_true", help="as JSON")
    listing.set_defaults(run=_list_presets)
    show = actions.add_parser("show", help="print a preset's file, with where its numbers come from", allow_abbrev=False)
    show.add_argument("name", metavar="NAME")
    show.set_defaults(run=_show_preset)
    check = actions.add_parser("check", help="say all that is wrong with a preset file", allow_abbrev=False)
    check.add_argument("file", metavar="FILE")
    check.set_defaults(run=_check_preset)


def _list_presets(options: argparse.Namespace) -> int:
    from synth.preset import list_presets

    presets = list_presets()
    if options.json:
        rows = [{"name": p.name, "title": p.title, "description": p.description} for p in presets]
        print(json.dumps(rows, indent=2))
        return 0
    width = max((len(preset.name) for preset in presets), default=0)
    for preset in presets:
        print(f"{preset.name:{width}}  {preset.title}".rstrip())
    return 0


def _show_preset(options: argparse.Namespace) -> int:
    from pathlib import Path

    from synth.preset import load_preset, preset_folder

    load_preset(options.name)
    path = Path(options.name)
    if not path.is_file():
        path = preset_folder() / f"{options.name}.toml"
    print(path.read_text(encoding="utf-8").rstrip("\n"))
    return 0


def _check_preset(options: argparse.Namespace) -> int:
    from synth.preset import load_preset

    preset = load_preset(options.file)
    count = len(preset.string)
    print(f"{options.file}: {preset.name} is in order ({count} string entr{'y' if count == 1 else 'ies'})")
    return 0


def _add_plan(commands: Any) -> None:
    parser = commands.add_parser(
        "plan",
        help="which rate, modes and contacts a quality means for a preset, and why",
        allow_abbrev=False,
    )
    parser.add_argument("preset", metavar="PRESET")
    parser.add_argument("note", nargs="?", metavar="NOTE", help="a note such as C3 or 48 (default: a survey)")
    _add_physics(parser)
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(run=_plan)


def _plan(options: argparse.Namespace) -> int:
    from synth.compile import describe_plan
    from synth.preset import load_preset

    note = None if options.note is None else _note(options.note)
    plan = describe_plan(
        load_preset(options.preset),
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


def _note(text: str) -> int:
    from synth.units import note_to_midi

    number = int(text) if text.isdecimal() else note_to_midi(text)
    if not 0 <= number <= 127:
        raise ValueError(f"note must be MIDI 0 to 127 (C-1 to G9), got {text!r}")
    return number


def _add_simulate(commands: Any) -> None:
    parser = commands.add_parser(
        "simulate",
        help="one string by its case file: motion, forces and energy as arrays",
        allow_abbrev=False,
        description="Computes a case file (TOML) and writes an .npz file; options replace its values.",
    )
    parser.add_argument("case", metavar="CASE", help="a .toml file, or a case of the program by name: tanpura, bass, hard/…")
    parser.add_argument("-o", "--output", required=True, metavar="OUT.npz")
    parser.add_argument("--scheme", choices=tuple(SCHEMES), help="contact scheme")
    parser.add_argument(
        "--restitution", type=_number(float, 0, 1), metavar="E", help="of the Moreau–Jean schemes and of walls"
    )
    parser.add_argument("--stiffness", type=_number(float, 0, 1e30), metavar="K", help="of a compliant contact, N/m^α")
    parser.add_argument("--exponent", type=_number(float, 1, 100), metavar="A", help="α of a compliant contact")
    parser.add_argument("--quality", choices=QUALITIES, help="rate and modes as `synth render` would choose them")
    parser.add_argument("--rate", type=_number(float, 1, 1e9, " Hz"), metavar="HZ", help="internal rate")
    parser.add_argument("--output-rate", type=_number(float, 1, 1e9, " Hz"), metavar="HZ", help="rate of the arrays")
    parser.add_argument("--modes", type=_number(int, 1, 100_000), metavar="N", help="number of modes")
    parser.add_argument(
        "--substeps", type=_number(int, 1, 64), metavar="K", help="of exact-hold: the contact force changes K times a step"
    )
    parser.add_argument(
        "--tail-modes",
        choices=("lumped", "static", "none"),
        dest="tail",
        help="of exact-hold: what stands for modes left out",
    )
    parser.add_argument("--duration", type=_number(float, 1e-9, 1e6, " s"), metavar="SEC", help="how long")
    parser.add_argument("--ledger", action="store_true", default=None, help="keep the energy ledger too")
    parser.add_argument("--json", action="store_true", help="summary as JSON")
    parser.add_argument("--quiet", action="store_true", help="say nothing but errors")
    parser.set_defaults(run=_simulate)


def _simulate(options: argparse.Namespace) -> int:
    from synth.simulation import simulate
    from synth.targets import check_target

    names = (
        "scheme", "restitution", "stiffness", "exponent", "quality", "rate", "output_rate", "modes", "substeps", "tail",
        "duration", "ledger",
    )  # fmt: skip
    overrides = {name: value for name in names if (value := getattr(options, name)) is not None}

    def warn(text: str) -> None:
        if not options.quiet:
            print(f"synth: {text}", file=sys.stderr)

    def work() -> Any:
        import numpy as np

        with np.errstate(all="ignore"):  # what is not finite the summary says
            return simulate(options.case, warn=warn, **overrides)

    check_target(options.output)
    result = _hearing_signals(work)
    result.save(options.output)
    summary = result.summary
    if options.json:
        print(json.dumps(summary, indent=2, allow_nan=False))
    elif not options.quiet:
        print(f"{options.output}: " + ", ".join(f"{key} {_brief(value)}" for key, value in summary.items()))
    return 0


def _hearing_signals(work: Callable[[], Any]) -> Any:
    """What `work` returns or raises. Meanwhile the main thread hears signals, which no compiled kernel does; one that ends
    the program leaves the work behind.
    """
    returned: list[Any] = []
    raised: list[BaseException] = []

    def run() -> None:
        try:
            returned.append(work())
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join()
    if raised:
        raise raised[0]
    return returned[0]


def _brief(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    sys.exit(main())
