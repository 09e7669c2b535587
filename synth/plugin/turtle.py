"""What stands beside the library of an LV2 plugin: Turtle texts that tell hosts its ports before they load it.

The ports and their order are those of c/lv2.c.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from importlib import metadata

import numpy as np

from synth.engine import layout
from synth.engine.parameters import Parameter
from synth.plugin.description import Description

PREFIXES = """\
@prefix atom: <http://lv2plug.in/ns/ext/atom#> .
@prefix doap: <http://usefulinc.com/ns/doap#> .
@prefix lv2: <http://lv2plug.in/ns/lv2core#> .
@prefix midi: <http://lv2plug.in/ns/ext/midi#> .
@prefix pg: <http://lv2plug.in/ns/ext/port-groups#> .
@prefix pprops: <http://lv2plug.in/ns/ext/port-props#> .
@prefix pset: <http://lv2plug.in/ns/ext/presets#> .
@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix rsz: <http://lv2plug.in/ns/ext/resize-port#> .
@prefix state: <http://lv2plug.in/ns/ext/state#> .
@prefix units: <http://lv2plug.in/ns/extensions/units#> .
@prefix urid: <http://lv2plug.in/ns/ext/urid#> .
"""

#: units that LV2 knows, by how the engine writes them; others are described
KNOWN_UNITS = {"mm": "units:mm", "×": "units:coef", "Hz": "units:hz", "dB": "units:db", "s": "units:s", "ms": "units:ms"}

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


def texts(description: Description, library: str) -> dict[str, str]:
    """File name → text of a bundle, to stand beside the library, a file name too."""
    files = {"manifest.ttl": _manifest(description, library), f"{description.id}.ttl": _plugin(description)}
    if len(description.presets) > 1:
        files["presets.ttl"] = _presets(description)
    return files


def symbols(parameters: Sequence[Parameter], presets: Sequence[str]) -> list[str]:
    """The port symbol of each parameter: letters, digits and underscores, different from every other."""
    out: list[str] = []
    for parameter in parameters:
        whole = parameter.id if len(presets) == 1 else f"{presets[parameter.part]}.{parameter.id}"
        symbol = re.sub(r"[^a-z0-9]", "_", whole.lower())
        symbol = symbol if symbol[0].isalpha() else f"p_{symbol}"
        while symbol in out or symbol in OWN_SYMBOLS:
            symbol += "_"
        out.append(symbol)
    return out


#: symbols of the ports that are no preset's parameters
OWN_SYMBOLS = ("events", "left", "right", "latency", "enabled", "program")


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
        major, minor, micro = (int(part) for part in metadata.version("jawari").split(".")[:3])
    except (metadata.PackageNotFoundError, ValueError):
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
    groups = []
    if several:
        for preset in description.presets:
            groups.append(
                f"<{_group(description, preset.id)}>\n\ta pg:InputGroup ;\n\tlv2:name {_text(preset.name)} ;\n"
                f"\tlv2:symbol {_text(re.sub('[^a-z0-9]', '_', 'g_' + preset.id))} .\n"
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
            "atom:supports midi:MidiEvent",
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
    for parameter, symbol in zip(description.parameters, symbols(description.parameters, ids), strict=True):
        row = [
            "a lv2:InputPort , lv2:ControlPort",
            f"lv2:symbol {_text(symbol)}",
            f"lv2:name {_text(parameter.name)}",
            f"lv2:default {_number(parameter.default)}",
            f"lv2:minimum {_number(parameter.minimum)}",
            f"lv2:maximum {_number(parameter.maximum)}",
        ]
        if parameter.unit:
            row.append(f"units:unit {_unit(parameter.unit)}")
        if layout.PARAMETER_CURVES[parameter.index] == layout.RATIO:
            row.append("lv2:portProperty pprops:logarithmic")
        if several:
            row.append(f"pg:group <{_group(description, ids[parameter.part])}>")
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
    out = []
    for index, row in enumerate(rows):
        out.append("[\n\t\t" + " ;\n\t\t".join([row[0], f"lv2:index {index}", *row[1:]]) + "\n\t]")
    return out


def _unit(unit: str) -> str:
    if unit in KNOWN_UNITS:
        return KNOWN_UNITS[unit]
    return (
        f"[\n\t\t\ta units:Unit ;\n\t\t\trdfs:label {_text(unit)} ;\n\t\t\tunits:symbol {_text(unit)} ;\n"
        f"\t\t\tunits:render {_text('%f ' + unit)}\n\t\t]"
    )
