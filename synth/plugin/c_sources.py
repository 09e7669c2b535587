"""Which of the C sources make up what, for a system and its processor.

    files = sources(TARGETS["windows-x86-64"])            # all of a plugin
    files = sources(WEB, "engine")                        # jawari.h alone

No source asks for which system it is compiled: what differs stands in files of its own (c/system.h), chosen here by name.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from synth.plugin.platforms import Target

#: the folder of the C sources
SOURCES = Path(__file__).resolve().parent / "c"
#: "engine": the interface of jawari.h. "clap": a CLAP too, which is what a host of WebAssembly takes. "plugin": all formats
Kind = Literal["engine", "clap", "plugin"]

_CORE = ("core", "core_follow", "core_kernels", "core_threads")
_ENGINE = (*_CORE, "bank", "bank_predict", "bank_unpack", "checksum", "drone_score", "midi", "portable_math")
_PLUGIN = ("plugin", "plugin_block", "plugin_drone", "plugin_rebuild", "plugin_state", "plugin_text", "plugin_wishes")
_CLAP = ("clap", "clap_events", "clap_extensions")
_FORMATS = ("lv2", "lv2_time", "vst3", "vst3_component", "vst3_controller", "vst3_midi", "vst3_processor", "vst3_text")
_SYSTEM: Mapping[str, tuple[str, ...]] = {
    "linux": ("system_linux", "system_posix", "bank_file"),
    "macos": ("system_macos", "system_posix", "bank_file"),
    "windows": ("system_windows", "bank_file"),
    "web": ("system_web", "bank_alone"),
}
_PROCESSOR: Mapping[str, str] = {
    "x86-64": "processor_x86",
    "arm64": "processor_arm64",
    "wasm32": "processor_plain",
}
#: who makes banks of other setups: programs can be started on some systems only
_MAKER: Mapping[str, tuple[str, ...]] = {
    "linux": ("plugin_maker", "plugin_python"),
    "macos": ("plugin_maker", "plugin_python"),
}
_NOBODY = ("plugin_alone",)


def sources(target: Target, kind: Kind = "plugin") -> list[Path]:
    """The C sources of a kind of library, in order of their names; that of the levels is written when one is built."""
    names = {*_ENGINE, *_SYSTEM[target.system], _PROCESSOR[target.processor]}
    if kind != "engine":
        names |= {*_PLUGIN, *_MAKER.get(target.system, _NOBODY), *_CLAP}
    if kind == "plugin":
        names |= {*_FORMATS, f"vst3_{target.system}"}
    return [SOURCES / f"{name}.c" for name in sorted(names)]
