"""`synth drone`: a tanpura that is played for as long as one likes, live or to a file."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from synth.cli.common import (
    MOST_BLOCK,
    ProgressLine,
    add_setting,
    add_settings,
    add_threads,
    add_verbose,
    asked_by_signals,
    number,
    print_unless_gone,
    rate,
    seconds_or,
)
from synth.cli.dronestrings import add_hand, add_strings, check_strings, pitches, read

if TYPE_CHECKING:
    from synth.drone.cycle import Cycle
    from synth.drone.pegs import TunedStrings

FILE_S = 300.0
FADE_S = 5.0
LONGEST_S = 7 * 24 * 3600.0


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "drone",
        help="play a tanpura's drone, live or to a file",
        allow_abbrev=False,
        description="Plays the cycle of a tanpura until q or Ctrl-C, or writes it to a file (-o). In a terminal ? lists the "
        "keys that tune and change it while it sounds. It never repeats, and the same --seed gives the same drone.",
    )
    tuning = parser.add_argument_group("tuning")
    add_strings(tuning)
    tuning.add_argument(
        "--tuning", choices=("just", "equal"), default="just", help="just intonation (default) or equal temperament"
    )
    add_settings(tuning)

    cycle = parser.add_argument_group("playing")
    tempo = cycle.add_mutually_exclusive_group()
    tempo.add_argument("--cycle", type=number(float, 1, 60, " s"), metavar="SEC", help="duration of a cycle (default 5.5)")
    tempo.add_argument("--bpm", type=number(float, 3, 300), metavar="N", help="or strokes per minute")
    add_hand(cycle)
    cycle.add_argument(
        "--velocity", type=number(float, 1, 127), default=64.0, metavar="N", help="mean velocity (default 64)"
    )
    cycle.add_argument(
        "--jiva",
        type=number(float, 0, 50, " µm"),
        metavar="UM",
        help="height of the thread (default 8): the buzz",
    )
    cycle.add_argument("-p", "--preset", default="tanpura", metavar="PRESET", help="your own tanpura (.toml)")

    out = parser.add_argument_group("to a file")
    out.add_argument(
        "-o", "--output", metavar="FILE", help="write a .wav or .flac (- for standard output) instead of playing"
    )
    out.add_argument("--format", choices=("wav", "flac", "raw"), help="default: by the file name's extension")
    out.add_argument("--bit-depth", choices=("16", "24", "float"), default="24", help="default 24; 16 is dithered")

    live = parser.add_argument_group("live")
    live.add_argument(
        "--device", metavar="NAME|N", help="audio output by number, name or part of a name (see synth devices)"
    )
    live.add_argument("--jack", nargs="?", const="jawari", metavar="NAME", help="run as a JACK client (with this name)")
    live.add_argument(
        "--block", type=number(int, 16, MOST_BLOCK), default=512, metavar="N", help="frames per block (default 512)"
    )
    live.add_argument(
        "--latency",
        type=seconds_or("low", "high"),
        default="high",
        metavar="low|high|SEC",
        help="latency requested from the device (default high)",
    )
    live.add_argument(
        "--record", metavar="TAKE.wav", help="record the sound, the events to TAKE.mid and the strings to TAKE.toml"
    )

    both = parser.add_argument_group("sound and reports")
    both.add_argument(
        "--duration",
        type=number(float, 0.1, LONGEST_S, " s"),
        metavar="SEC",
        help=f"duration (default: a file {FILE_S:g} s, live: unlimited)",
    )
    both.add_argument(
        "--fade",
        type=number(float, 0, 3600, " s"),
        metavar="SEC",
        help=f"fade-out at the end (default {FADE_S:g}, at most a quarter)",
    )
    add_setting(both, "--gain", "gain_db", metavar="DB")
    both.add_argument("-r", "--rate", type=rate, metavar="HZ", help="44100 (default), 48000, 88200 or 96000")
    add_setting(both, "--quality", "quality")
    add_threads(both)
    both.add_argument("--quiet", action="store_true", help="print errors only")
    add_verbose(both)
    both.add_argument("--json", action="store_true", help="closing report as JSON")
    parser.set_defaults(run=_drone)


def _drone(options: argparse.Namespace) -> int:
    _check(options)
    _check_files(options)
    strings, cycle = _strings(options), _cycle(options)
    cycle.gaps(len(strings.keys))
    return _to_file(options, strings, cycle) if options.output is not None else _live(options, strings, cycle)


def _check(options: argparse.Namespace) -> None:
    if options.device is not None and options.jack is not None:
        raise ValueError("--device and --jack are two different outputs: give one of them")
    if options.output is not None:
        for name in ("device", "jack", "record"):
            if getattr(options, name) is not None:
                raise ValueError(f"--{name} is for live playing; leave out either it or -o")
    elif options.format is not None:
        raise ValueError("--format needs a file; give -o FILE, or leave it out")
    if options.record is not None and not options.record.lower().endswith(".wav"):
        raise ValueError(f"--record must be a .wav file, got {options.record!r}")
    check_strings(options)
    if options.fade is not None and options.fade > _duration(options):
        raise ValueError(f"--fade must not be longer than --duration {_duration(options):g} s, got {options.fade:g} s")


def _check_files(options: argparse.Namespace) -> None:
    """Raises ValueError where a file that is written is one that is read."""
    from synth.files.targets import Named, check_apart
    from synth.host.parts import files_read

    read = files_read([options.preset])
    if options.output is not None:
        check_apart(read, [Named("-o", options.output)])
    if options.record is not None:
        from synth.live.recorder import files_written

        check_apart(read, [*files_written(options.record), Named("strings", _strings_file(options))])


def _strings_file(options: argparse.Namespace) -> str:
    return str(Path(options.record).with_suffix(".toml"))


def _duration(options: argparse.Namespace) -> float:
    """How long it plays [s]."""
    if options.duration is not None:
        return options.duration
    return FILE_S if options.output is not None else math.inf


def _fade(options: argparse.Namespace) -> float:
    """How long it fades at the end [s]."""
    return min(FADE_S, 0.25 * _duration(options)) if options.fade is None else options.fade


def _strings(options: argparse.Namespace) -> TunedStrings:
    """The preset, tuned. Raises ValueError naming the option."""
    from synth.drone.pegs import Pegs, tuned
    from synth.host.parts import load_presets

    preset = read("preset", options.preset, lambda name: load_presets([name], options.settings)[name])
    return tuned(Pegs(preset, **pitches(options, preset), equal=options.tuning == "equal"), options.jiva)


def _cycle(options: argparse.Namespace) -> Cycle:
    from synth.drone.cycle import Cycle

    strokes = options.strings - (options.first.strip().lower() == "none")
    seconds = 5.5 if options.cycle is None else options.cycle
    if options.bpm is not None:
        seconds = 60.0 * strokes / options.bpm
        if not 1.0 <= seconds <= 60.0:
            raise ValueError(
                f"--bpm {options.bpm:g} makes a cycle of {seconds:.3g} s, which must last 1 to 60 s; "
                f"take {strokes:g} to {60 * strokes:g}"
            )
    return Cycle(seconds, options.spacing, options.human, options.velocity, options.seed)


def _to_file(options: argparse.Namespace, strings: TunedStrings, cycle: Cycle) -> int:
    from synth.drone.dronefile import FileSettings, write

    settings = FileSettings(
        options.output,
        _duration(options),
        _fade(options),
        rate_hz=options.rate or 44100,
        quality=options.quality,
        gain_db=options.gain_db,
        threads=options.threads,
        container=options.format,
        bit_depth=options.bit_depth,
        seed=options.seed,
    )
    with ProgressLine(not options.quiet and sys.stderr.isatty()) as line:
        report = write(strings, cycle, settings, progress=line.show)
    where = sys.stderr if options.output == "-" else sys.stdout
    if options.json:
        print(json.dumps(report.as_dict(), indent=2, allow_nan=False), file=where)
    elif not options.quiet:
        print(report.line(), file=where)
    return 0


def _live(options: argparse.Namespace, strings: TunedStrings, cycle: Cycle) -> int:
    from synth.drone.cycle import Drone
    from synth.drone.tanpura_keys import DronePlayer, TanpuraKeys, strings_text
    from synth.files.targets import check_target
    from synth.instrument.presetfile import write_preset
    from synth.live.paragraph import fitting
    from synth.live.session import Session, SessionSettings, Stop
    from synth.live.status import StatusLine
    from synth.live.terminal import terminal_at

    settings = SessionSettings(
        preset=strings.preset.name,
        made={strings.preset.name: strings.preset},
        quality=options.quality,
        threads=1 if options.threads == "auto" else options.threads,
        gain_db=options.gain_db,
        device=options.device,
        jack=options.jack,
        rate_hz=options.rate,
        block=options.block,
        latency=options.latency,
        midi_in=("none",),
        virtual_port=False,
        record=options.record,
        duration_s=options.duration,
    )
    preset_file = ""
    if options.record is not None:
        preset_file = _strings_file(options)
        for path in (options.record, preset_file):
            check_target(path)
    line = StatusLine(quiet=options.quiet)
    stop = Stop()
    with asked_by_signals(stop) as begin, Session(settings, line, begin) as session, terminal_at() as terminal:
        drone = Drone(strings, cycle, session.rate_hz, duration_s=options.duration, fade_s=_fade(options))
        keys = TanpuraKeys(drone, line.say, stop.ask)
        session.add_player(DronePlayer(drone, terminal, keys))
        line.say(f"{strings_text(drone)}, a cycle of {cycle.cycle_s:.2f} s, jiva {drone.jiva_um:g} µm; Ctrl-C stops")
        if terminal.is_one:
            line.say(keys.help)
        session.run(stop)
    assert session.report is not None
    if options.record is not None:
        # with it, `synth render TAKE.mid -p TAKE.toml` plays the take again
        write_preset(strings.preset, preset_file)
        session.report.files.append(preset_file)
    if options.json:
        print_unless_gone(json.dumps(session.report.as_dict(), indent=2, allow_nan=False))
    elif not options.quiet:
        print_unless_gone(fitting("\n".join(session.report.lines()), sys.stdout))
    return 1 if session.report.ended == "device" else 0
