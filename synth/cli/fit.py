"""`synth fit`: a plucked string out of a recording, shown and written into a preset."""

from __future__ import annotations

import argparse
import json
from typing import Any

from synth.cli import contact, fitted_file
from synth.cli.common import number


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "fit",
        help="find pitch, inharmonicity, losses and place of plucking of a recorded string, or its contact",
        allow_abbrev=False,
    )
    parser.add_argument(
        "recording", metavar="REC.wav", nargs="+", help="one plucked note, WAV or FLAC; with --contact one or several"
    )
    parser.add_argument("-p", "--preset", metavar="PRESET", help="preset (name or .toml file) that gets the string")
    parser.add_argument(
        "--string",
        metavar="N|NAME",
        help="string of the preset, by number from 0 or by name (default: 0; with --contact the "
        "nearest to the note over a bridge)",
    )
    parser.add_argument("--pitch", type=number(float, 20, 5000, " Hz"), metavar="HZ", help="approximate pitch of the note")
    parser.add_argument("-o", "--output", metavar="NEW.toml", help="write the preset with the fitted string")
    parser.add_argument("--json", action="store_true", help="the report as JSON")
    contact.add(parser)
    parser.set_defaults(run=_fit)


def _fit(options: argparse.Namespace) -> int:
    if options.output is not None and options.preset is None:
        raise ValueError("-o writes a preset with the fitted string: name it with -p")
    if options.string is not None and options.preset is None:
        raise ValueError(f"--string {options.string} selects a string of a preset: name it with -p")
    contact.check(options)
    from synth.fit import missing

    reason = missing()
    if reason is not None:
        raise ValueError(reason)
    if options.contact:
        return contact.run(options)
    [options.recording] = options.recording
    from synth.fit import fit_recording, report, settings
    from synth.fit.recording import read_recording
    from synth.instrument.preset import parse_preset, read_preset

    text = "" if options.preset is None else read_preset(options.preset)
    preset = None if options.preset is None else parse_preset(text, options.preset)
    index = 0 if preset is None or options.string is None else fitted_file.string_index(preset, options.string)
    if options.output is not None:
        fitted_file.check_output(options.output, options.preset, [options.recording])
    samples, rate_hz = read_recording(options.recording)
    try:
        found = fit_recording(samples, rate_hz, expected_hz=options.pitch)
    except ValueError as error:
        raise ValueError(f"{options.recording}: {error}") from None
    values = [] if preset is None else settings(found, preset, index)
    told = {**report(found), "settings": [{"path": path, "value": value} for path, value in values]}
    if options.output is not None:
        fitted_file.write(text, options.preset, options.output, values)
        told["output"] = options.output
    print(json.dumps(told, indent=2, allow_nan=False) if options.json else _text(options.recording, told))
    return 0


def _text(recording: str, told: dict[str, Any]) -> str:
    lines = [f"{recording}: a string of {told['duration_s']:.2f} s from {told['onset_s']:.2f} s on"]
    width = max(len(name) for name, _, _ in told["facts"])
    lines += [f"  {name:{width}}  {value}" for name, value, _ in told["facts"]]
    lines.append("  partial   measured Hz    fit Hz   cents   measured T60      fit T60     level")
    for p in told["partials"][:10]:
        lines.append(
            f"  {p['number']:7d}  {_cell(p['measured_hz'], '12.2f')}  {p['hz']:8.2f}  {_cell(p['cents'], '+6.2f')}"
            f"  {_cell(p['measured_t60_s'], '11.2f')} s  {p['t60_s']:9.2f} s  {_cell(p['level_db'], '6.1f')} dB"
        )
    lines += [f"  note: {words}" for words in told["warnings"]]
    if told["settings"]:
        lines.append("settings:")
        lines += [f"  {item['path']} = {fitted_file.value_text(item['value'])}" for item in told["settings"]]
    if "output" in told:
        lines.append(f"written: {told['output']}")
    return "\n".join(lines)


def _cell(value: float | None, form: str) -> str:
    return "–".rjust(int(form.lstrip("+").split(".")[0])) if value is None else f"{value:{form}}"
