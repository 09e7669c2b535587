"""What the commands share: kinds of values, options of the physics, a line that shows progress, signals."""

from __future__ import annotations

import argparse
import errno
import math
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any, NoReturn, cast

from synth.cli import colours
from synth.engine.engine_settings import DEFAULTS, SETTINGS, EngineOptions
from synth.solver.schemes import LAWS
from synth.spelling import perhaps

RATES_HZ = (44100, 48000, 88200, 96000)
MOST_BLOCK = 4096


#: a word or quoted value of a message that is longer is shown by its beginning [characters]
LONGEST_SHOWN = 160
_MORE = f"{{{LONGEST_SHOWN},}}"
_LONG = re.compile(rf"""'[^'\n]{_MORE}'|"[^"\n]{_MORE}"|[^\s/\\'"]{_MORE}""")


def shortened(message: str) -> str:
    """A message whose long values are shown by their beginning, with their length; paths stay whole."""
    return _LONG.sub(lambda found: f"{found[0][:60]}… ({len(found[0])} characters)", message)


def fault(message: str) -> str:
    """The line that says what is wrong, for standard error."""
    return f"synth: {colours.shown('error:', colours.FAULT, sys.stderr)} {message}"


class Parser(argparse.ArgumentParser):
    """Says what is wrong in one line; the usage is a --help away."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, fault(f"{shortened(message)} (see {self.prog} --help)\n"))

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Refuse unknown arguments in the parser of the command, which knows what they may have meant."""
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            known = [name for name in self._option_string_actions if name.startswith("--")]
            shown = [f"{word}{perhaps(word.partition('=')[0], known) if word[:1] == '-' else ''}" for word in unknown]
            self.error(f"unrecognized arguments: {' '.join(shown)}")
        return options, unknown

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            names = [str(each) for each in action.choices]
            likely = perhaps(value, names) if isinstance(value, str) else ""
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{likely}; choose from {', '.join(names)}")

    def _print_message(self, message: str, file: Any = None) -> None:
        """argparse passes over what cannot be written; whoever asks for help is to hear of it."""
        if message:
            (file or sys.stderr).write(message)


def needed(what: str, packages: Iterable[str], extra: str) -> None:
    """ValueError, which says how to get them, where packages are missing. what: "studies need", …"""
    missing = [name for name in packages if find_spec(name) is None]
    if missing:
        raise ValueError(f"{what} {', '.join(missing)}: pip install 'jawari[{extra}]'")


def number(kind: Callable[[str], float], low: float, high: float, unit: str = "") -> Callable[[str], float]:
    """An option's type: a number of `kind` (int or float) from `low` to `high`, said with its `unit`."""
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


def rate(text: str) -> int:
    """An option's type: one of RATES_HZ."""
    if text not in [str(rate) for rate in RATES_HZ]:
        allowed = ", ".join(map(str, RATES_HZ))
        raise argparse.ArgumentTypeError(f"must be one of {allowed} Hz, got {text!r}")
    return int(text)


def scheme(known: dict[str, str]) -> Callable[[str], str]:
    """A parser of one of the schemes `known`, or of a contact law that an installed module adds."""

    def parse(text: str) -> str:
        from synth.solver.contact_laws import check_scheme

        try:
            return check_scheme(text, known)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return parse


def tail(text: str) -> float | str:
    """An option's type: seconds, or 'auto'."""
    return text if text == "auto" else number(float, 0, 3600, " s (or auto)")(text)


def threads(text: str) -> int | str:
    """An option's type: how many threads, or 'auto'."""
    least, most = SETTINGS["threads"].typed or (1, 1)
    return text if text == "auto" else int(number(int, least, most, " (or auto)")(text))


def setting(text: str) -> tuple[str | None, str, str]:
    """An option's type: (preset or None for all, dotted key, value) of [PRESET:]KEY=VALUE."""
    key, equals, value = text.partition("=")
    only, colon, rest = key.rpartition(":")
    if not equals or not rest.strip():
        raise argparse.ArgumentTypeError(f"must be KEY=VALUE or PRESET:KEY=VALUE, got {text!r}")
    return (only.strip() if colon else None), rest.strip(), value.strip()


def note_number(text: str) -> int:
    """The MIDI number of 'C3' or '48'. Raises ValueError."""
    from synth.units import note_to_midi

    number = int(text) if text.isdecimal() else note_to_midi(text)
    if not 0 <= number <= 127:
        raise ValueError(f"note must be MIDI 0 to 127 (C-1 to G9), got {text!r}")
    return number


def seconds_or(*words: str) -> Callable[[str], float | str]:
    """An option's type: one of the words, or seconds up to 10."""

    def parse(text: str) -> float | str:
        return text if text in words else number(float, 0, 10, f" s (or {' or '.join(words)})")(text)

    return parse


def add_setting(group: Any, flag: str, name: str, **more: Any) -> None:
    """An option for a setting of the engine, with its default, words and bounds unless `more` has others; of its name."""
    known = SETTINGS[name]
    options: dict[str, Any] = {"dest": name, "default": DEFAULTS[name], "help": known.words}
    if known.choices:
        options["choices"] = known.choices
    elif known.typed is not None:
        low, high = known.typed
        options["type"] = number(type(low), low, high, known.unit)
    group.add_argument(flag, **options | more)


def engine_options(options: argparse.Namespace) -> EngineOptions:
    """The settings of the engine that a command line has."""
    given = {name: getattr(options, name, None) for name in SETTINGS}
    return cast(EngineOptions, {name: value for name, value in given.items() if value is not None})


def playing_options(options: argparse.Namespace) -> dict[str, Any]:
    """The fields of `PlayingSettings` as `synth render` and `synth play` are given them. Raises ValueError."""
    from synth.host.bindings import parse_bindings
    from synth.host.parts import parse_channel_map

    return {
        "preset": options.preset,
        "channel_presets": parse_channel_map(options.map),
        "settings": options.settings,
        "variation": options.variation,
        "tuning": options.tuning,
        "keyboard": options.kbm,
        "bindings": parse_bindings(options.cc),
        "gm": options.gm,
        "only_strings": options.only_strings,
        "bit_depth": options.bit_depth,
        **engine_options(options),
    }


def add_physics(group: Any, default_rate: int | None = 44100) -> None:
    """Options that every command with a rate and a quality has."""
    group.add_argument(
        "-r", "--rate", type=rate, default=default_rate, metavar="HZ", help="44100 (default), 48000, 88200 or 96000"
    )
    add_setting(group, "--quality", "quality")
    add_setting(group, "--scheme", "scheme", type=scheme(LAWS), metavar="NAME")
    add_setting(group, "--precision", "precision")
    add_setting(group, "--internal-rate", "internal_rate_hz", metavar="HZ")


def add_instruments(group: Any) -> None:
    """Options that every command with presets on MIDI channels has."""
    group.add_argument("-p", "--preset", metavar="PRESET", help="preset (name or .toml file) for all channels")
    group.add_argument(
        "--map",
        action="append",
        default=[],
        metavar="CH=PRESET,…",
        help="presets of single channels (1 to 16); none leaves a channel out",
    )
    group.add_argument(
        "--only-strings",
        action="store_true",
        help="leave out General MIDI programs that are not plucked or struck strings",
    )
    group.add_argument(
        "--gm",
        action="store_true",
        help="live, and for takes: programs choose from the whole table of General MIDI (default for songs)",
    )
    add_settings(group)
    variation = "how much strokes of a preset with a human hand vary: 0 not at all, 1 (default) as the preset says, up to 2"
    group.add_argument("--variation", type=number(float, 0, 2), default=1.0, metavar="SHARE", help=variation)
    add_setting(group, "--polyphony", "polyphony", metavar="N")
    group.add_argument("--tuning", metavar="FILE.scl", help="Scala scale")
    group.add_argument("--kbm", metavar="FILE.kbm", help="Scala keyboard mapping")


def _a4(text: str) -> tuple[str | None, str, str]:
    """--a4 as a setting."""
    return None, "tuning.a4_hz", repr(number(float, 300, 600, " Hz")(text))


def add_settings(group: Any) -> None:
    """--set and --a4, as a list of (preset or None, key, value) in `settings`."""
    group.add_argument(
        "--a4",
        action="append",
        default=[],
        type=_a4,
        dest="settings",
        metavar="HZ",
        help="frequency of A4, 300 to 600 Hz (default: the preset's, 440)",
    )
    group.add_argument(
        "--set",
        action="append",
        default=[],
        type=setting,
        dest="settings",
        metavar="[PRESET:]KEY=VALUE",
        help="change a value of the preset, such as pluck.position=0.2; may be repeated",
    )


def add_controllers(group: Any) -> None:
    """--cc and --mpe."""
    group.add_argument(
        "--cc",
        action="append",
        default=[],
        metavar="N=PARAMETER[:AT_0:AT_127]",
        help="controller N sets a live parameter, such as 74=pluck.position; may be repeated",
    )
    add_setting(group, "--mpe", "mpe", action="store_true")


def add_seed(group: Any) -> None:
    """--seed."""
    add_setting(group, "--seed", "seed", metavar="N")


def add_threads(group: Any) -> None:
    """--threads."""
    add_setting(group, "--threads", "threads", type=threads, default="auto", metavar="N")


def add_verbose(group: Any) -> None:
    """--verbose."""
    group.add_argument("--verbose", action="store_true", help="report at the end where the compiled kernels came from")


def warner(quiet: bool) -> Callable[[str], None]:
    """What says a line on standard error, or nothing."""

    def warn(text: str) -> None:
        if not quiet:
            print(f"synth: {text}", file=sys.stderr)

    return warn


#: a speed is said when that long has been measured [s]
MEASURED_S = 0.5


class ProgressLine:
    """One line on the terminal that overwrites itself, at most ten times a second."""

    def __init__(self, on: bool) -> None:
        self._on = on
        self._began: tuple[float, float] | None = None  # when, and what was done then
        self._shown = 0.0
        self._width = 0

    def show(self, done_s: float, total_s: float) -> None:
        """How much of the sound is rendered, and, once that has been measured for a while, how fast."""
        now = time.monotonic()
        if self._began is None:
            self._began = now, done_s
        if not self._due(now):
            return
        since, done_then = self._began
        percent = 100.0 * done_s / total_s if total_s > 0.0 else 100.0
        text = f"{percent:3.0f} %  {done_s:.1f} of at most {total_s:.1f} s"
        if now - since >= MEASURED_S:
            text += f"  {(done_s - done_then) / (now - since):.1f}× real time"
        self._write(text)

    def preparing(self, done: int, total: int) -> None:
        """How many strings are prepared."""
        if self._due(time.monotonic()):
            self._write(f"preparing: {done} of {total} strings")

    def notes(self, done: int, total: int) -> None:
        """How many notes are computed."""
        if self._due(time.monotonic()):
            self._write(f"{100.0 * done / max(1, total):3.0f} %  {done} of {total} notes")

    def measuring(self, done: float) -> None:
        """Which share of a plan is measured."""
        if self._due(time.monotonic()):
            self._write(f"measuring: {100.0 * done:.0f} %")

    def fitting(self, done: float) -> bool:
        """Which share of a fit is done. True: it goes on."""
        if self._due(time.monotonic()):
            self._write(f"  {100.0 * done:3.0f} %")
        return True

    def _due(self, now: float) -> bool:
        """Whether it is time for another line."""
        due = self._on and now - self._shown >= 0.1
        if due:
            self._shown = now
        return due

    def _write(self, text: str) -> None:
        sys.stderr.write("\r" + text.ljust(self._width))
        sys.stderr.flush()
        self._width = len(text)

    def __enter__(self) -> ProgressLine:
        return self

    def __exit__(self, *_: object) -> None:
        if self._width:
            self._write("")
            sys.stderr.write("\r")


@contextmanager
def asked_by_signals(stop: Any) -> Iterator[Callable[[], None]]:
    """Signals that end the program, also that its terminal is closed, ask `stop` (a Stop) to end instead of raising; but
    only from when what this gives is called: until then they do what they did before, and interrupt.

    SIGHUP that is ignored (nohup) stays so.
    """
    handlers = {signal.SIGINT: stop.ask, signal.SIGTERM: stop.ask}
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        handlers[signal.SIGHUP] = stop.ask_once
    before = {number: signal.getsignal(number) for number in handlers}

    def begin() -> None:
        for number, handler in handlers.items():
            signal.signal(number, handler)

    try:
        yield begin
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def print_unless_gone(text: str) -> None:
    """Prints, unless the terminal has gone: then nothing is printed any more, and nothing fails for it."""
    try:
        print(text, flush=True)
    except OSError as error:
        if error.errno != errno.EIO:
            raise
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
