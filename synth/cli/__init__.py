"""The command line: `synth render`, `play`, `drone`, `author`, `export`, `dataset`, `fit`, `body`, `devices`, `presets`,
`plan`, `setup`, `simulate`, `sweep`, `doctor`, `completion`; without any, a greeting.

Exit codes: 0 done; 1 failed for a reason that lies in the program, or whoever read its output has enough; 2 wrong usage or
input, or something that could not be written (one line on standard error says what, and what was there before is as it was);
128 + N ended by signal N: 129 hung up, 130 interrupted, 131 quit, 143 terminated. Everything heavy is imported where it is
used, so that help comes at once.
"""

from __future__ import annotations

import argparse
import errno
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NoReturn

from synth._version import __version__
from synth.cli import (
    author,
    bits,
    bodies,
    completion,
    dataset,
    devices,
    doctor,
    drone,
    export,
    fit,
    plan,
    play,
    presets,
    render,
    set_up,
    simulate,
    streams,
    sweep,
)
from synth.cli.common import Parser, fault, shortened
from synth.cli.greeting import greet
from synth.cli.kernel_line import compiling_shown, leave_compiling
from synth.files import unfinished
from synth.jit import kernel_cache, vector_width

#: commands that compile kernels, where there are none yet
_COMPILING = ("render", "play", "drone", "author", "simulate", "sweep", "fit", "dataset", "setup")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line (`sys.argv` by default) and returns the exit code."""
    code = _run(arguments, ends=arguments is None)
    if arguments is None:  # the process ends with it
        leave_compiling(code)
    return code


def _run(arguments: Sequence[str] | None, ends: bool) -> int:
    """ends: the process ends with the command."""
    arguments = render.joined_normalize(list(sys.argv[1:] if arguments is None else arguments))
    wording = streams.Wording(arguments)
    with streams.ready(wording), _raising_on_termination():
        try:
            try:
                options = command_parser().parse_args(arguments)
                if (code := bits.settle(options, arguments, ends)) is not None:
                    return code
                shown = {name: getattr(options, name, False) for name in ("quiet", "verbose")}
                if arguments and arguments[0] in _COMPILING and vector_width.settle() is not None:
                    kernel_cache.point_again()
                with compiling_shown(**shown):
                    code = options.run(options)
            except SystemExit:
                sys.stdout.flush()  # of --help
                raise
            sys.stdout.flush()  # what cannot be said shows here
            return code
        except BrokenPipeError:
            # Whoever read our output has enough.
            return 1
        except (ValueError, OSError) as error:
            for line in wording(_message(error)).splitlines():
                print(fault(shortened(line)), file=sys.stderr)
            return 2
        except MemoryError:
            unfinished.discard_unfinished()
            remedy = "close other programs, raise the limit (ulimit -v), or use a shorter song or fewer presets"
            print(fault(f"not enough memory; {remedy}"), file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            _leave_undone(ends)
            print("synth: interrupted", file=sys.stderr)
            return 130
        except _Terminated as end:
            _leave_undone(ends)
            return 128 + end.number
        finally:
            streams.settle_output()


def _leave_undone(ends: bool) -> None:
    """Removes unfinished files and drops output that a signal left unsaid.

    A signal may come while a library builds an object; the destructor of that object then fails, and Python would report
    it after the command's own last line. Where the process ends (`ends`), these reports are dropped."""
    if ends:
        sys.unraisablehook = lambda _: None
    unfinished.discard_unfinished()
    streams.drop_output()


class _Terminated(BaseException):
    """A signal that ends the program as an exception, so that unfinished files are removed on the way out."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


@contextmanager
def _raising_on_termination() -> Iterator[None]:
    """SIGTERM, SIGHUP and SIGQUIT raise _Terminated, once; one that is ignored (nohup) stays so."""

    def terminate(number: int, _: object) -> NoReturn:
        for each in before:  # what is removed meanwhile is removed in peace, unless one insists
            signal.signal(each, signal.SIG_DFL if each == getattr(signal, "SIGQUIT", None) else signal.SIG_IGN)
        raise _Terminated(number)

    before: dict[int, Any] = {}
    try:
        for name in ("SIGTERM", "SIGHUP", "SIGQUIT"):
            number = getattr(signal, name, None)
            if number is not None and signal.getsignal(number) is not signal.SIG_IGN:
                before[number] = signal.signal(number, terminate)
    except ValueError:
        # Signals can be caught in the main thread only; a caller in another one looks after them itself.
        pass
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _message(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        names = [str(name) for name in (error.filename, error.filename2) if name is not None]
        hint = (
            "; check the name"
            if error.errno == errno.ENOENT and names and error.strerror == os.strerror(errno.ENOENT)
            else ""
        )
        return f"{': '.join(names)}: {error.strerror}{hint}" if names else error.strerror
    return str(error) or type(error).__name__


def command_parser() -> argparse.ArgumentParser:
    parser = Parser(prog="synth", description="Strings that collide: a MIDI file in, sound out.", allow_abbrev=False)
    version = f"synth (jawari) {__version__}"
    parser.add_argument("--version", action="version", version=version, help="show the version and exit")
    parser.set_defaults(run=greet)
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", parser_class=Parser)
    render.add(commands)
    play.add(commands)
    drone.add(commands)
    author.add(commands)
    export.add(commands)
    dataset.add(commands)
    fit.add(commands)
    bodies.add(commands)
    devices.add(commands)
    presets.add(commands)
    plan.add(commands)
    set_up.add(commands)
    simulate.add(commands)
    sweep.add(commands)
    doctor.add(commands)
    completion.add(commands, parser)
    return parser
