"""The command line: `synth render`, `play`, `drone`, `author`, `fit`, `devices`, `presets`, `plan`, `simulate`.

Exit codes: 0 done; 1 failed for a reason that lies in the program; 2 wrong usage or input (one line on
standard error says what); 130 or 143 interrupted or terminated. Everything heavy is imported where it is
used, so that help comes at once.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

from synth.cli import author, devices, drone, fit, plan, play, presets, render, simulate
from synth.cli.common import Parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line (`sys.argv` by default) and returns the exit code."""
    arguments = render.joined_normalize(list(sys.argv[1:] if arguments is None else arguments))
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
    parser = Parser(prog="synth", description="Strings that collide: a MIDI file in, sound out.", allow_abbrev=False)
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True, parser_class=Parser)
    render.add(commands)
    play.add(commands)
    drone.add(commands)
    author.add(commands)
    fit.add(commands)
    devices.add(commands)
    presets.add(commands)
    plan.add(commands)
    simulate.add(commands)
    return parser
