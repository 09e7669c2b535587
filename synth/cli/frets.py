"""`synth fit --contact --experimental` over frets: one action out of several strokes, shown and written into a preset."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING, Any

from synth.cli import fitted_file
from synth.cli.common import ProgressLine

if TYPE_CHECKING:
    from synth.instrument.preset import Preset


def run(options: argparse.Namespace, text: str, preset: Preset) -> int:
    """The command on a preset and its text; its exit code."""
    from synth.fit import missing_for_contact

    for name, remedy in (("picture", "--json has all numbers"), ("open", "the softest of the recordings is that note")):
        if getattr(options, name) is not None:
            raise ValueError(f"--{name} is for bridges, not for frets; leave it out: {remedy}")
    if options.amplitude is None:
        raise ValueError(
            "over frets, the fit needs the amplitudes: give --amplitude once for each recording, in the same order"
        )
    reason = missing_for_contact()
    if reason is not None:
        raise ValueError(reason)
    from synth.fit.fret_fit import fit_frets
    from synth.fit.fret_report import fret_report, fret_settings
    from synth.fit.recording import read_recording

    index = 0 if options.string is None else fitted_file.string_index(preset, options.string)
    if options.output is not None:
        fitted_file.check_output(options.output, options.preset, options.recording)
    recordings = [read_recording(each) for each in options.recording]
    with ProgressLine(sys.stderr.isatty()) as line:
        found = fitted_file.about(options.recording, lambda: fit_frets(
            recordings, preset, index, options.amplitude, position=options.pluck_at, progress=line.fitting
        ))  # fmt: skip
    values = fret_settings(found)
    told = {**fret_report(found), "settings": [{"path": path, "value": value} for path, value in values]}
    if options.output is not None:
        fitted_file.write(text, options.preset, options.output, values)
        told["output"] = options.output
    print(json.dumps(told, indent=2, allow_nan=False) if options.json else _text(options, told))
    return 0


def _text(options: argparse.Namespace, told: dict[str, Any]) -> str:
    lines = [f"{', '.join(options.recording)}: a string over frets (experimental)"]
    width = max(len(name) for name, _, _ in told["facts"])
    lines += [f"  {name:{width}}  {value}, {what}" for name, value, what in told["facts"]]
    lines += [f"  note: {words}" for words in told["warnings"]]
    lines.append("settings:")
    lines += [f"  {item['path']} = {fitted_file.value_text(item['value'])}" for item in told["settings"]]
    if "output" in told:
        lines.append(f"written: {told['output']}")
    return "\n".join(lines)
