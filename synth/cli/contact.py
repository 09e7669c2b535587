"""`synth fit --contact`: bridge, thread and place of plucking out of recordings, shown and written into a preset."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from synth.cli import fitted_file
from synth.cli.common import ProgressLine, number

if TYPE_CHECKING:
    from synth.instrument.preset import Preset

#: options that belong to --contact
_OWN = ("amplitude", "pluck_at", "open", "picture", "experimental")


def add(parser: argparse.ArgumentParser) -> None:
    """The options of `--contact`."""
    own = parser.add_argument_group("what the string touches")
    own.add_argument(
        "--contact",
        action="store_true",
        help="find height and distance of the bridge under -p's string, and the place of plucking; several recordings "
        "share one bridge",
    )
    own.add_argument(
        "--amplitude",
        type=number(float, 0.01, 50, " mm"),
        metavar="MM",
        action="append",
        help="displacement of the string in the first recording (default: that of -p's hardest pluck); over frets given "
        "once for each recording, in their order",
    )
    own.add_argument(
        "--pluck-at",
        type=number(float, 0.02, 0.5),
        metavar="SHARE",
        help="place of plucking, if known, as a fraction of the length",
    )
    own.add_argument(
        "--open",
        metavar="OTHER.wav",
        help="a note of the same string without contact, for pitch, stiffness and losses",
    )
    own.add_argument(
        "--experimental",
        action="store_true",
        default=None,
        help="over frets: find the action from soft strokes and some with a little buzz",
    )
    own.add_argument("--picture", metavar="FILE.png", help="draw the bands of recordings and model")


def check(options: argparse.Namespace) -> None:
    """Raises ValueError for options that do not go together."""
    if not options.contact:
        for name in _OWN:
            if getattr(options, name) is not None:
                raise ValueError(f"--{name.replace('_', '-')} goes with --contact: add it, or leave it out")
        if len(options.recording) > 1:
            raise ValueError(f"one recording at a time, got {len(options.recording)}; several go with --contact")
        return
    if options.preset is None:
        raise ValueError("--contact needs a preset for the string and the bridge: name it with -p")
    if options.pitch is not None:
        raise ValueError(
            "--pitch cannot be combined with --contact, which takes the pitch from the preset's string; leave it out"
        )


def run(options: argparse.Namespace) -> int:
    """The command; its exit code."""
    from synth.instrument.preset import FretsObstacle, parse_preset, read_preset

    text = read_preset(options.preset)
    preset = parse_preset(text, options.preset)
    if isinstance(preset.obstacle, FretsObstacle):
        if not options.experimental:
            raise ValueError(f"{preset.name} has frets, whose fit is experimental: add --experimental, or name a "
                             "preset that has a bridge, such as tanpura-light")  # fmt: skip
        from synth.cli import frets

        return frets.run(options, text, preset)
    if options.experimental:
        raise ValueError(f"--experimental is for frets, and {preset.name} has none: leave it out")
    if options.amplitude is not None and len(options.amplitude) > 1:
        raise ValueError(f"over a bridge, give one --amplitude (of the first recording), got {len(options.amplitude)}")
    return _bridge(options, text, preset)


def _bridge(options: argparse.Namespace, text: str, preset: Preset) -> int:
    from synth.fit import missing_for_contact

    reason = missing_for_contact(picture=options.picture is not None)
    if reason is not None:
        raise ValueError(reason)
    from synth.files.targets import Named, check_apart, check_target
    from synth.fit.contact_group import fit_contact, linear_string, string_of
    from synth.fit.contact_report import contact_report, contact_settings, draw
    from synth.fit.recording import read_recording

    read = [*options.recording, *([] if options.open is None else [options.open])]
    if options.output is not None:
        fitted_file.check_output(options.output, options.preset, read)
    if options.picture is not None:
        outputs = [] if options.output is None else [Named("-o", options.output)]
        check_apart([Named("recording", each) for each in read], [Named("--picture", options.picture), *outputs])
        check_target(options.picture)
    recordings = [read_recording(each) for each in options.recording]
    if options.string is not None:
        index = fitted_file.string_index(preset, options.string)
    else:
        index = fitted_file.about(options.recording[:1], lambda: string_of(preset, *recordings[0]))
    if options.open is not None:
        preset = fitted_file.about([options.open], lambda: linear_string(preset, index, *read_recording(options.open)))
    with ProgressLine(sys.stderr.isatty()) as line:
        found = fitted_file.about(options.recording, lambda: fit_contact(
            recordings, preset, index, amplitude_m=None if options.amplitude is None else 1e-3 * options.amplitude[0],
            position=options.pluck_at, progress=line.fitting,
        ))  # fmt: skip
    values = contact_settings(found)
    told = {**contact_report(found), "settings": [{"path": path, "value": value} for path, value in values]}
    if options.picture is not None:
        draw(found, options.picture)
        told["picture"] = options.picture
    if options.output is not None:
        fitted_file.write(text, options.preset, options.output, values)
        told["output"] = options.output
    print(
        json.dumps(told, indent=2, allow_nan=False)
        if options.json
        else _text(options, told, preset.string[index].name or str(index))
    )
    return 0


def _text(options: argparse.Namespace, told: dict[str, Any], label: str) -> str:
    lines = [f"{', '.join(options.recording)}: string {label} over a bridge"]
    width = max(len(name) for name, _, _ in told["facts"])
    lines += [f"  {name:{width}}  {value}" for name, value, _ in told["facts"]]
    lines += [f"  note: {words}" for words in told["warnings"]]
    lines.append("settings:")
    lines += [f"  {item['path']} = {fitted_file.value_text(item['value'])}" for item in told["settings"]]
    for name in ("picture", "output"):
        if name in told:
            lines.append(f"{'drawn' if name == 'picture' else 'written'}: {told[name]}")
    return "\n".join(lines)
