"""`synth play`: the presets live, by MIDI keyboard, by the computer's keys or from a file."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from synth.cli.common import (
    MOST_BLOCK,
    add_controllers,
    add_instruments,
    add_physics,
    add_seed,
    add_setting,
    add_threads,
    add_verbose,
    asked_by_signals,
    number,
    playing_options,
    print_unless_gone,
    seconds_or,
)


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "play",
        help="play live: MIDI keyboard, computer keyboard or a MIDI file",
        allow_abbrev=False,
        description="Plays until Ctrl-C. Listens to every MIDI input and offers its own, jawari. Without -p, General "
        "MIDI programs choose: basses play fretted-bass, everything else jawari-harp; with --gm, and in songs, "
        "the nearest preset plays each program. In a terminal ? lists the keys.",
    )
    what = parser.add_argument_group("instruments")
    add_instruments(what)

    sound = parser.add_argument_group("sound (see `synth devices`)")
    sound.add_argument("--device", metavar="NAME|N", help="audio output by number, name or part of a name")
    sound.add_argument(
        "--jack",
        nargs="?",
        const="jawari",
        metavar="NAME",
        help="run as a JACK client (with this name), with MIDI and audio ports",
    )
    sound.add_argument(
        "--block", type=number(int, 16, MOST_BLOCK), default=256, metavar="N", help="frames per block (default 256)"
    )
    sound.add_argument(
        "--latency",
        type=seconds_or("low", "high"),
        default="low",
        metavar="low|high|SEC",
        help="latency requested from the device",
    )
    sound.add_argument(
        "--ahead",
        type=number(int, 0, 64),
        default=0,
        metavar="N",
        help="render N blocks ahead: more latency, fewer dropouts (default 0)",
    )
    sound.add_argument(
        "--adaptive",
        action="store_true",
        help="under high load, damp the faintest strings instead of dropping out",
    )
    add_setting(sound, "--gain", "gain_db", metavar="DB")

    how = parser.add_argument_group("computation")
    add_physics(how, default_rate=None)
    add_threads(how)
    add_seed(how)

    control = parser.add_argument_group("control")
    control.add_argument(
        "--midi-in",
        action="append",
        default=[],
        metavar="NAME|N",
        help="MIDI input (default: all); repeatable; none for none",
    )
    add_controllers(control)
    control.add_argument("--midi-channel", type=number(int, 1, 16), metavar="N", help="listen to this channel only")
    control.add_argument("--no-virtual-port", action="store_true", help="do not offer a MIDI port")
    control.add_argument(
        "--keys",
        action=argparse.BooleanOptionalAction,
        default=None,
        help="play on the computer's keyboard (default: on a terminal, unless a file is played); --no-keys: no keys at all",
    )
    control.add_argument(
        "--play",
        metavar="SONG.mid",
        help="play this file; keys pause it and move through it; the session ends with it unless other inputs are requested",
    )

    out = parser.add_argument_group("recording and reports")
    out.add_argument("--record", metavar="TAKE.wav", help="record the sound, and the events to TAKE.mid")
    out.add_argument("--bit-depth", choices=("16", "24", "float"), default="24", help="of the recording (default 24)")
    out.add_argument("--duration", type=number(float, 0.01, 1e6, " s"), metavar="SEC", help="stop after this time")
    out.add_argument(
        "--measure-latency",
        action="store_true",
        help="measure the latency from event to sound, also at the output of a JACK server or PipeWire (pw-jack), then stop",
    )
    out.add_argument("--quiet", action="store_true", help="print errors only")
    add_verbose(out)
    out.add_argument("--json", action="store_true", help="closing report as JSON")
    parser.set_defaults(run=_play)


def _play(options: argparse.Namespace) -> int:
    # What can be judged without loading anything comes first.
    if options.device is not None and options.jack is not None:
        raise ValueError("--device and --jack are two different outputs: give one of them")
    if options.measure_latency and (options.play or options.record):
        raise ValueError("--measure-latency plays its own notes: leave out --play and --record")
    if options.record is not None and not options.record.lower().endswith(".wav"):
        raise ValueError(f"--record must be a .wav file, got {options.record!r}")
    keys = options.keys
    song_keys = False
    if keys is not False:
        from synth.live.keyboard import Keyboard

        if keys is None:
            # Where a file is played, the terminal is nobody's instrument unless asked for: its keys are the song's.
            keys = not options.play and not options.measure_latency and Keyboard.available() and sys.stderr.isatty()
            song_keys = bool(options.play)
        elif not Keyboard.available():
            raise ValueError("--keys: standard input is not a terminal in the foreground; run it there or connect MIDI")
        else:
            song_keys = bool(options.play)

    playing = playing_options(options)
    if options.record is not None:
        from synth.files.targets import check_apart
        from synth.host import parts
        from synth.live.recorder import files_written

        read = parts.files_read(
            [options.preset, *playing["channel_presets"].values()], song=options.play, tuning=options.tuning, kbm=options.kbm
        )
        check_apart(read, files_written(options.record))
    from synth.live.session import Session, SessionSettings, Stop
    from synth.live.status import StatusLine

    settings = SessionSettings(
        song=options.play,
        device=options.device,
        jack=options.jack,
        rate_hz=options.rate,
        block=options.block,
        latency=options.latency,
        ahead=options.ahead,
        adaptive=options.adaptive,
        midi_in=tuple(options.midi_in),
        midi_channel=None if options.midi_channel is None else options.midi_channel - 1,
        virtual_port=not options.no_virtual_port,
        keys=keys,
        song_keys=song_keys,
        record=options.record,
        duration_s=options.duration,
        measure_latency=options.measure_latency,
        **playing,
    )
    line = StatusLine(quiet=options.quiet)
    stop = Stop()
    with asked_by_signals(stop) as begin, Session(settings, line, begin) as session:
        if options.measure_latency:
            line.say("measuring; Ctrl-C stops")
            measured = session.measure_latency(stop)
            if measured is None:
                raise KeyboardInterrupt
            _print(options, measured.as_dict(), measured.lines())
            return 0
        line.say("playing; Ctrl-C stops")
        session.run(stop)
    assert session.report is not None
    _print(options, session.report.as_dict(), session.report.lines())
    return 1 if session.report.ended == "device" else 0


def _print(options: argparse.Namespace, values: dict[str, Any], lines: list[str]) -> None:
    if options.json:
        print_unless_gone(json.dumps(values, indent=2, allow_nan=False))
    elif not options.quiet:
        from synth.live.paragraph import fitting

        print_unless_gone(fitting("\n".join(lines), sys.stdout))
