"""What stands beside the library of an LV2 plugin: Turtle texts that tell hosts its ports before they load it.

The ports and their order are those of c/lv2.c.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

import synth
from synth.engine import layout
from synth.engine.parameters import Parameter
from synth.plugin.description import Description, OwnParameter, curve_of
from synth.plugin.setup import SetupNumber

PREFIXES = """\
@prefix atom: <http://lv2plug.in/ns/ext/atom#> .
@prefix doap: <http://usefulinc.com/ns/doap#> .
@prefix kx: <http://kxstudio.sf.net/ns/lv2ext/props#> .
@prefix lv2: <http://lv2plug.in/ns/lv2core#> .
@prefix midi: <http://lv2plug.in/ns/ext/midi#> .
@prefix pg: <http://lv2plug.in/ns/ext/port-groups#> .
@prefix pprops: <http://lv2plug.in/ns/ext/port-props#> .
@prefix pset: <http://lv2plug.in/ns/ext/presets#> .
@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix rsz: <http://lv2plug.in/ns/ext/resize-port#> .
@prefix state: <http://lv2plug.in/ns/ext/state#> .
@prefix time: <http://lv2plug.in/ns/ext/time#> .
@prefix units: <http://lv2plug.in/ns/extensions/units#> .
@prefix urid: <http://lv2plug.in/ns/ext/urid#> .
"""

#: units that LV2 knows, by how the engine writes them; others are described
KNOWN_UNITS = {
    "mm": "units:mm",
    "m": "units:m",
    "Hz": "units:hz",
    "dB": "units:db",
    "s": "units:s",
    "ms": "units:ms",
    "semitones": "units:semitone12TET",
}

#: behind the symbol of a number of the setup: the output that shows what is played
PLAYED = "_played"

#: bytes that a host must have room for in the events of a block: bulk tuning messages are the longest
ROOM_FOR_EVENTS = 65536


def uri(description: Description) -> str:
    """The plugin's name in LV2, which is that in c/lv2.c."""
    return f"urn:jawari:{description.id}"


def _preset(description: Description, preset: str) -> str:
    """A preset's name; what begins otherwise is named otherwise: a group, the state's key in c/lv2.c."""
    return f"{uri(description)}#preset-{preset}"


def _group(description: Description, preset: str) -> str:
    """The name of the group of a preset's ports."""
    return f"{uri(description)}#group-{preset}"


def _setup_group(description: Description, preset: str) -> str:
    """The name of the group of the numbers of its setup."""
    return f"{uri(description)}#setup-{preset}"


def texts(description: Description, library: str) -> dict[str, str]:
    """File name → text of a bundle, to stand beside the library, a file name too."""
    files = {"manifest.ttl": _manifest(description, library), f"{description.id}.ttl": _plugin(description)}
    if len(description.presets) > 1:
        files["presets.ttl"] = _presets(description)
    return files


def symbols(parameters: Sequence[Parameter | SetupNumber], presets: Sequence[str]) -> list[str]:
    """The port symbol of each parameter, which follows from its preset's id and its own alone, as long as there are several
    presets, and differs from every other: songs keep automation by it."""
    out = []
    for parameter in parameters:
        own = re.sub(r"[^a-z0-9]", "_", parameter.id)
        of = symbol_of(presets[parameter.part])
        out.append(own if len(presets) == 1 else f"{of if of[0].isalpha() else 'P' + of}_{own}")
    return out


def symbol_of(preset: str) -> str:
    """Letters, digits and underscores for a preset's id, different from those of every other: what is neither a small
    letter, a digit nor a hyphen is written as its number between capitals."""
    return re.sub(r"[^a-z0-9]", lambda found: "_" if found[0] == "-" else f"X{ord(found[0]):x}X", preset)


def _text(value: str) -> str:
    """A literal: quoted, what Turtle would misread escaped, control characters left out."""
    kept = "".join(c for c in value if c >= " ").replace("\\", "\\\\").replace('"', '\\"')
    return f'"{kept}"'


def _number(value: float) -> str:
    """The shortest decimal that reads back as the same double."""
    return np.format_float_positional(value, trim="0")


def _version() -> tuple[int, int]:
    """LV2's minor and micro version; those that are even are released."""
    try:
        major, minor, micro = (int(part) for part in synth.__version__.split(".")[:3])
    except ValueError:
        return 0, 0
    return 2 * (100 * major + minor), 2 * micro


def _manifest(description: Description, library: str) -> str:
    me = uri(description)
    out = [PREFIXES]
    out.append(f"<{me}>\n\ta lv2:Plugin ;\n\tlv2:binary <{library}> ;\n\trdfs:seeAlso <{description.id}.ttl> .\n")
    if len(description.presets) > 1:
        for preset in description.presets:
            out.append(
                f"<{_preset(description, preset.id)}>\n\ta pset:Preset ;\n\tlv2:appliesTo <{me}> ;\n"
                f"\trdfs:label {_text(preset.name)} ;\n\trdfs:seeAlso <presets.ttl> .\n"
            )
    return "\n".join(out)


def _presets(description: Description) -> str:
    """One for each of the bank's: the program that chooses it."""
    me = uri(description)
    out = [PREFIXES]
    for program, preset in enumerate(description.presets):
        out.append(
            f"<{_preset(description, preset.id)}>\n\ta pset:Preset ;\n\tlv2:appliesTo <{me}> ;\n"
            f"\trdfs:label {_text(preset.name)} ;\n"
            f'\tlv2:port [\n\t\tlv2:symbol "program" ;\n\t\tpset:value {_number(program)}\n\t] .\n'
        )
    return "\n".join(out)


def _plugin(description: Description) -> str:
    me = uri(description)
    minor, micro = _version()
    several = len(description.presets) > 1
    lines = [
        "a lv2:InstrumentPlugin ,\n\t\tlv2:Plugin",
        f"doap:name {_text(description.name)}",
        "doap:license <https://spdx.org/licenses/MIT>",
        f"lv2:minorVersion {minor}",
        f"lv2:microVersion {micro}",
        "lv2:requiredFeature urid:map",
        "lv2:optionalFeature lv2:hardRTCapable ,\n\t\tstate:threadSafeRestore",
        "lv2:extensionData state:interface",
    ]
    about = "; ".join(preset.description for preset in description.presets if preset.description)
    if about:
        lines.append(f"rdfs:comment {_text(about)}")
    lines.append("lv2:port " + " , ".join(_ports(description)))
    groups = ["kx:NonAutomatable a lv2:PortProperty .\n"] if description.setup else []  # which LV2 itself does not declare
    if several:
        for preset in description.presets:
            groups.append(
                f"<{_group(description, preset.id)}>\n\ta pg:InputGroup ;\n\tlv2:name {_text(preset.name)} ;\n"
                f"\tlv2:symbol {_text('G_' + symbol_of(preset.id))} .\n"
            )
    for part, preset in enumerate(description.presets):
        if any(number.part == part for number in description.setup):
            name = f"{preset.name}: setup" if several else "Setup"
            groups.append(
                f"<{_setup_group(description, preset.id)}>\n\ta pg:InputGroup ;\n\tlv2:name {_text(name)} ;\n"
                f"\tlv2:symbol {_text('S_' + symbol_of(preset.id))} .\n"
            )
    return "\n".join([PREFIXES, f"<{me}>\n\t" + " ;\n\t".join(lines) + " .\n", *groups])


def _ports(description: Description) -> list[str]:
    several = len(description.presets) > 1
    rows: list[list[str]] = [
        [
            "a lv2:InputPort , atom:AtomPort",
            'lv2:symbol "events"',
            'lv2:name "Events"',
            "atom:bufferType atom:Sequence",
            "atom:supports midi:MidiEvent , time:Position",
            "lv2:designation lv2:control",
            f"rsz:minimumSize {ROOM_FOR_EVENTS}",
        ],
        ["a lv2:OutputPort , lv2:AudioPort", 'lv2:symbol "left"', 'lv2:name "Left"', "lv2:designation pg:left"],
        ["a lv2:OutputPort , lv2:AudioPort", 'lv2:symbol "right"', 'lv2:name "Right"', "lv2:designation pg:right"],
        [
            "a lv2:OutputPort , lv2:ControlPort",
            'lv2:symbol "latency"',
            'lv2:name "Latency"',
            "lv2:designation lv2:latency",
            "lv2:portProperty lv2:reportsLatency , lv2:integer , lv2:connectionOptional",
            "units:unit units:frame",
            "lv2:minimum 0",
            "lv2:maximum 8192",
        ],
        [
            "a lv2:InputPort , lv2:ControlPort",
            'lv2:symbol "enabled"',
            'lv2:name "Enabled"',
            "lv2:designation lv2:enabled",
            "lv2:portProperty lv2:toggled , lv2:connectionOptional",
            "lv2:default 1",
            "lv2:minimum 0",
            "lv2:maximum 1",
        ],
    ]
    ids = [preset.id for preset in description.presets]
    shown: list[Parameter | SetupNumber] = [*description.parameters, *description.setup]
    for parameter, symbol in zip(shown, symbols(shown, ids), strict=True):
        live = isinstance(parameter, Parameter)
        row = _control(parameter, symbol)
        properties = ["pprops:logarithmic"] if curve_of(parameter) == layout.RATIO else []
        if not live:
            properties += ["pprops:expensive", "kx:NonAutomatable"]
            row.append(f"pg:group <{_setup_group(description, ids[parameter.part])}>")
        elif several:
            row.append(f"pg:group <{_group(description, ids[parameter.part])}>")
        if properties:
            row.append(f"lv2:portProperty {' , '.join(properties)}")
        rows.append(row)
    if several:
        points = " , ".join(
            f"[ rdfs:label {_text(preset.name)} ; rdf:value {k} ]" for k, preset in enumerate(description.presets)
        )
        rows.append(
            [
                "a lv2:InputPort , lv2:ControlPort",
                'lv2:symbol "program"',
                'lv2:name "Program"',
                "lv2:portProperty lv2:integer , lv2:enumeration",
                "lv2:default 0",
                "lv2:minimum 0",
                f"lv2:maximum {len(description.presets) - 1}",
                f"lv2:scalePoint {points}",
            ]
        )
    rows += [_own(each) for each in description.own]
    for number, symbol in zip(description.setup, symbols(shown, ids)[len(description.parameters) :], strict=True):
        row = [
            "a lv2:OutputPort , lv2:ControlPort",
            f"lv2:symbol {_text(symbol + PLAYED)}",
            f"lv2:name {_text(number.name + ', played')}",
            "lv2:portProperty lv2:connectionOptional",
            f"lv2:minimum {_number(number.minimum)}",
            f"lv2:maximum {_number(number.maximum)}",
        ]
        if number.unit:
            row.append(f"units:unit {_unit(number.unit)}")
        rows.append(row)
    out = []
    for index, row in enumerate(rows):
        out.append("[\n\t\t" + " ;\n\t\t".join([row[0], f"lv2:index {index}", *row[1:]]) + "\n\t]")
    return out


def _control(parameter: Parameter | SetupNumber | OwnParameter, symbol: str) -> list[str]:
    """The input of a parameter, without its index and what only some have."""
    row = [
        "a lv2:InputPort , lv2:ControlPort",
        f"lv2:symbol {_text(symbol)}",
        f"lv2:name {_text(parameter.name)}",
        f"lv2:default {_number(parameter.default)}",
        f"lv2:minimum {_number(parameter.minimum)}",
        f"lv2:maximum {_number(parameter.maximum)}",
    ]
    return [*row, f"units:unit {_unit(parameter.unit)}"] if parameter.unit else row


def _own(parameter: OwnParameter) -> list[str]:
    """The port of a parameter that is no preset's, without its index."""
    row = _control(parameter, own_symbol(parameter))
    if parameter.stepped:
        row.append("lv2:portProperty lv2:integer" + (" , lv2:enumeration" if parameter.texts else ""))
    elif parameter.curve == layout.RATIO:
        row.append("lv2:portProperty pprops:logarithmic")
    if parameter.texts:
        points = (f"[ rdfs:label {_text(text)} ; rdf:value {k} ]" for k, text in enumerate(parameter.texts))
        row.append("lv2:scalePoint " + " , ".join(points))
    return row


def own_symbol(parameter: OwnParameter) -> str:
    """Of a port of `_own`: no preset's parameter has such an id."""
    return parameter.id.replace("/", "_")


def _unit(unit: str) -> str:
    if unit in KNOWN_UNITS:
        return KNOWN_UNITS[unit]
    return (
        f"[\n\t\t\ta units:Unit ;\n\t\t\trdfs:label {_text(unit)} ;\n\t\t\tunits:symbol {_text(unit)} ;\n"
        f"\t\t\tunits:render {_text('%f ' + unit)}\n\t\t]"
    )
