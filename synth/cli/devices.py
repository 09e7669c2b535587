"""`synth devices`: where sound can go to and where notes can come from."""

from __future__ import annotations

import argparse
import json
from typing import Any


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "devices",
        help="list audio outputs and MIDI inputs for `synth play`",
        allow_abbrev=False,
        description="Lists audio outputs (for --device), MIDI inputs (for --midi-in) and whether a JACK server runs.",
    )
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.set_defaults(run=_devices)


def _devices(options: argparse.Namespace) -> int:
    found = _look()
    if options.json:
        print(json.dumps(found, indent=2))
    else:
        print("\n".join(_lines(found)))
    return 0


def _look() -> dict[str, Any]:
    """outputs: as portaudio.devices; midi_inputs: names in the order of their numbers; jack: the server, or None; the
    reasons why there is nothing.
    """
    from synth.live import jackserver, portaudio
    from synth.live.errors import DeviceError
    from synth.midi import ports

    found: dict[str, Any] = {"outputs": [], "outputs_missing": None, "midi_system": None, "midi_inputs": []}
    try:
        found["outputs"] = portaudio.devices()
    except DeviceError as reason:
        found["outputs_missing"] = str(reason)
    system, why_none = ports.midi_system()
    found["midi_system"] = system or None
    found["midi_missing"] = why_none or None
    found["midi_inputs"] = ports.port_names()
    try:
        found["jack"] = {"rate_hz": jackserver.server_rate()}
    except DeviceError as reason:
        found["jack"] = None
        found["jack_missing"] = str(reason)
    return found


def _lines(found: dict[str, Any]) -> list[str]:
    lines = ["audio outputs (--device):"]
    for each in found["outputs"]:
        channels = f"{each['channels']} channel{'' if each['channels'] == 1 else 's'}"
        default = "  (default)" if each["default"] else ""
        lines.append(
            f"  {each['index']:3}  {each['name']}  [{each['host_api']}]  {channels}, {each['default_rate_hz']:g} Hz{default}"
        )
    if not found["outputs"]:
        lines.append(
            f"  none: {found['outputs_missing'] or 'plug a sound card in or start a sound server (PipeWire, JACK)'}; "
            "without one, `synth render` writes files"
        )
    lines.append(f"MIDI inputs (--midi-in){', ' + found['midi_system'] if found['midi_system'] else ''}:")
    lines += [f"  {number:3}  {name}" for number, name in enumerate(found["midi_inputs"])]
    if not found["midi_inputs"]:
        lines.append(f"  none: {found['midi_missing'] or 'plug a keyboard in; it is found while playing, too'}")
        if found["midi_missing"] and found["jack"]:
            # python-rtmidi brings a JACK library of its own, which does not see PipeWire
            lines.append("  but synth play --jack hears the MIDI ports of the JACK server below, by its own, midi_in")
    if found["jack"]:
        lines.append(f"JACK server (--jack): runs at {found['jack']['rate_hz']} Hz")
    else:
        lines.append(f"JACK server (--jack): none ({found['jack_missing']})")
    return lines
