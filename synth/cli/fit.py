"""`synth fit`: a plucked string out of a recording, shown and written into a preset."""

from __future__ import annotations

import argparse
import json
import os
from typing import Any

from synth.cli.common import number


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "fit", help="find pitch, inharmonicity, losses and place of plucking of a recorded string", allow_abbrev=False
    )
    parser.add_argument("recording", metavar="REC.wav", help="one plucked note, WAV or FLAC")
    parser.add_argument("-p", "--preset", metavar="PRESET", help="preset (name or .toml file) that gets the string")
    parser.add_argument("--string", metavar="N|NAME", help="which of its strings, counted from 0 (the default), or by name")
    parser.add_argument("--pitch", type=number(float, 20, 5000, " Hz"), metavar="HZ", help="the note's pitch, about")
    parser.add_argument("-o", "--output", metavar="NEW.toml", help="write the preset with the fitted string")
    parser.add_argument("--json", action="store_true", help="the report as JSON")
    parser.set_defaults(run=_fit)


def _fit(options: argparse.Namespace) -> int:
    if options.output is not None and options.preset is None:
        raise ValueError("-o writes a preset with the fitted string: say which with -p")
    if options.string is not None and options.preset is None:
        raise ValueError(f"--string {options.string} is a string of a preset: say which with -p")
    from synth.fit import missing

    reason = missing()
    if reason is not None:
        raise ValueError(reason)
    from synth.fit import fit_recording, report, settings
    from synth.fit.recording import read_recording
    from synth.instrument.preset import parse_preset, read_preset

    text = "" if options.preset is None else read_preset(options.preset)
    preset = None if options.preset is None else parse_preset(text, options.preset)
    index = 0 if preset is None or options.string is None else _string_index(preset, options.string)
    if options.output is not None:
        _check_output(options)
    samples, rate_hz = read_recording(options.recording)
    try:
        found = fit_recording(samples, rate_hz, expected_hz=options.pitch)
    except ValueError as error:
        raise ValueError(f"{options.recording}: {error}") from None
    values = [] if preset is None else settings(found, preset, index)
    told = {**report(found), "settings": [{"path": path, "value": value} for path, value in values]}
    if options.output is not None:
        _write(text, options.preset, options.output, values)
        told["output"] = options.output
    print(json.dumps(told, indent=2, allow_nan=False) if options.json else _text(options.recording, told))
    return 0


def _string_index(preset: Any, text: str) -> int:
    names = [table.name for table in preset.string]
    if text in names:
        return names.index(text)
    if text.isdecimal() and int(text) < len(names):
        return int(text)
    known = ", ".join(f"{i} ({name})" if name else str(i) for i, name in enumerate(names))
    raise ValueError(f"--string must be one of {known} of {preset.name}, got {text!r}")


def _check_output(options: argparse.Namespace) -> None:
    """Raises ValueError, OSError where the preset must not or cannot be written there: over the recording, or over a preset
    that comes with the program. One's own preset may get its new string in place (-p and -o the same name)."""
    from pathlib import Path

    from synth.files.targets import Named, check_apart, check_target, is_special
    from synth.instrument.preset import preset_folder, preset_path

    source = preset_path(options.preset)
    in_place = Path(options.preset) == Path(options.output) and source.parent != preset_folder()
    read = [Named("recording", options.recording)] + ([] if in_place else [Named("preset", source)])
    check_apart(read, [Named("-o", options.output)])
    check_target(options.output)
    if not is_special(options.output) and Path(options.output).suffix != ".toml":
        raise ValueError(f"-o must be a preset's file, ending in .toml, got {options.output!r}")


def _write(text: str, source: str, target: str, values: list[tuple[str, Any]]) -> None:
    """The preset's text with the values changed, its comments kept, and named after the new file as saving under another
    name does; a device or pipe is written to as it is, and the name stays."""
    from pathlib import Path

    from synth.author import changes
    from synth.author.document import current, preset_name
    from synth.files.targets import is_special, write_whole

    text, _ = current(text, source)
    special = is_special(target)
    named = [] if special else [("name", preset_name(os.fsencode(Path(target).stem).decode("utf-8", "replace")))]
    text, _ = changes.apply(text, [*values, *named], source)
    write_whole(target, lambda file: file.write(text.encode("utf-8")))


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
        lines += [f"  {item['path']} = {_value(item['value'])}" for item in told["settings"]]
    if "output" in told:
        lines.append(f"written: {told['output']}")
    return "\n".join(lines)


def _cell(value: float | None, form: str) -> str:
    return "–".rjust(int(form.lstrip("+").split(".")[0])) if value is None else f"{value:{form}}"


def _value(value: Any) -> str:
    return "(taken out)" if value is None else json.dumps(value, ensure_ascii=False)
