"""CLAP's structures are written down three times: the plugin's header, the host of these tests, and (where Debian's package
dpf-source is there) the specification's own headers. All agree on every size and offset."""

from __future__ import annotations

import ctypes as c
import re
import subprocess
from pathlib import Path

import pytest

from synth.plugin.library import SOURCES, compiler
from tests.plugin import clapabi

#: where the package puts CLAP 1.1
OFFICIAL = Path("/usr/share/dpf/distrho/src/clap")
HEADERS = ("entry", "plugin-factory", "ext/audio-ports", "ext/note-ports", "ext/params", "ext/state", "ext/latency")
#: not in 1.1 as that package has it
LATER = {"clap_plugin_tail", "clap_plugin_render", "clap_voice_info", "clap_plugin_voice_info", "clap_plugin_thread_pool"}
LATER |= {"clap_host_thread_pool", "clap_remote_controls_page", "clap_plugin_remote_controls", "clap_host_log"}
#: the host's name for a structure of the header
TWINS = {
    "clap_version": "Version",
    "clap_event_header": "Header",
    "clap_event_note": "Note",
    "clap_event_note_expression": "Expression",
    "clap_event_param_value": "ParamValue",
    "clap_event_transport": "Transport",
    "clap_event_midi": "Midi",
    "clap_event_midi_sysex": "Sysex",
    "clap_input_events": "InputEvents",
    "clap_output_events": "OutputEvents",
    "clap_audio_buffer": "AudioBuffer",
    "clap_process": "Process",
    "clap_host": "HostStruct",
    "clap_plugin_descriptor": "Descriptor",
    "clap_plugin": "Plugin",
    "clap_plugin_factory": "Factory",
    "clap_plugin_entry": "Entry",
    "clap_audio_port_info": "AudioPortInfo",
    "clap_note_port_info": "NotePortInfo",
    "clap_param_info": "ParamInfo",
    "clap_plugin_params": "Params",
    "clap_plugin_state": "State",
    "clap_voice_info": "VoiceInfo",
    "clap_remote_controls_page": "RemotePage",
}


def structures() -> dict[str, list[str]]:
    """Names of the header's structures and of their fields, in order."""
    text = re.sub(r"/\*.*?\*/", "", (SOURCES / "clap_api.h").read_text(), flags=re.S)
    out = {}
    for name, body in re.findall(r"typedef struct (\w+) \{([^{}]*)\}", text):
        fields = []
        for declaration in filter(None, map(str.strip, body.split(";"))):
            if function := re.search(r"\(\*(\w+)\)\(", declaration):
                fields.append(function.group(1))
            else:
                fields += [re.findall(r"(\w+)(?:\[\w+\])?$", each.strip())[0] for each in declaration.split(",")]
        out[name] = fields
    return out


def laid_out(folder: Path, names: dict[str, list[str]], headers: list[str], where: Path) -> dict[str, list[int]]:
    """Size of each structure as C has it, then offset and size of every field."""
    lines = []
    for name, fields in names.items():
        lines.append(f'printf("{name} %zu", sizeof({name}_t));')
        lines += [f'printf(" %zu %zu", offsetof({name}_t, {each}), sizeof((({name}_t *)0)->{each}));' for each in fields]
        lines.append('puts("");')
    included = "".join(f'#include "{each}"\n' for each in headers)
    source = folder / "layout.c"
    source.write_text(f"#include <stddef.h>\n#include <stdio.h>\n{included}int main(void) {{\n" + "\n".join(lines) + "\n}\n")
    made = folder / "layout"
    subprocess.run([*compiler(), f"-I{where}", str(source), "-o", str(made)], check=True)
    told = subprocess.run([made], capture_output=True, text=True, check=True).stdout
    return {line.split()[0]: [int(each) for each in line.split()[1:]] for line in told.splitlines()}


@pytest.fixture(scope="module")
def ours(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[int]]:
    return laid_out(tmp_path_factory.mktemp("ours"), structures(), ["clap_api.h"], SOURCES)


def test_the_host_has_the_plugins_layout(ours: dict[str, list[int]]) -> None:
    for name, twin in TWINS.items():
        kind = getattr(clapabi, twin)
        fields = [getattr(kind, field) for field, *_ in kind._fields_]
        assert [c.sizeof(kind)] + [n for each in fields for n in (each.offset, each.size)] == ours[name], name


def test_the_specifications_headers_have_it(ours: dict[str, list[int]], tmp_path: Path) -> None:
    if not OFFICIAL.is_dir():
        pytest.skip("CLAP's headers are not here (Debian: apt-get install dpf-source)")
    names = {name: fields for name, fields in structures().items() if name not in LATER}
    official = laid_out(tmp_path, names, [f"{each}.h" for each in HEADERS], OFFICIAL)
    assert official == {name: ours[name] for name in official} and len(official) >= 28
