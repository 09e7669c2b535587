"""Instruments that pages of the documentation play: banks made once, kept while nothing that they depend on changes.

They are compressed by gzip, as not every server does that with files of a kind that it does not know.
"""

from __future__ import annotations

import gzip
import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from listening.rendering import ROOT, sources_hash
from synth.files.targets import write_text, write_whole
from synth.instrument.preset import list_presets, load_preset
from synth.plugin import library, shelf, webfolder
from synth.plugin.platforms import WEB_RELAXED

DRONE = "-drone"
#: the family whose presets also play a drone by themselves
DRONING = "tanpura"


def every_name() -> list[str]:
    """All presets, and those with a drone."""
    presets = list_presets()
    return sorted([each.name for each in presets] + [each.name + DRONE for each in presets if each.family == DRONING])


def write_all(names: Iterable[str], folder: Path, make: bool, say: Callable[[str], None]) -> None:
    """Instruments, the programs and the engine, and live.json, which lists them; not `make`: of the instruments those that
    are there.

    Where there is no engine for web pages, all are listed without a file. Banks of other instruments, or old ones, go.
    """
    folder.mkdir(parents=True, exist_ok=True)
    wasm = _engine(folder, make, say)
    if wasm is not None:
        for name, text in webfolder.parts().items():
            write_text(folder / name, text)
        write_whole(folder / webfolder.ENGINE, lambda file: file.write(wasm))
        if make:
            relaxed = shelf.web_library(webfolder.KIND, say, WEB_RELAXED).read_bytes()
            write_whole(folder / webfolder.RELAXED_ENGINE, lambda file: file.write(relaxed))
    sources = _sources()
    listed = [_listed(name, folder, wasm, make, sources, say) for name in names]
    write_text(folder / "live.json", json.dumps(listed, indent=1))
    if make:
        for old in set(folder.glob("*.jawari")) - {folder / str(each["file"]) for each in listed}:
            old.unlink()


def _engine(folder: Path, make: bool, say: Callable[[str], None]) -> bytes | None:
    if not make:
        there = folder / webfolder.ENGINE
        return there.read_bytes() if there.is_file() else None
    try:
        return shelf.web_library(webfolder.KIND, say).read_bytes()
    except library.BuildError as error:
        say(f"no instruments on pages: {error}")
        return None


def _listed(
    name: str, folder: Path, wasm: bytes | None, make: bool, sources: str, say: Callable[[str], None]
) -> dict[str, Any]:
    preset = load_preset(name.removesuffix(DRONE))
    found: dict[str, Any] = {"name": name, "title": preset.title or preset.name, "file": None, "bytes": 0}
    if wasm is None:
        return found
    key = hashlib.sha256("\n".join((name, preset.model_dump_json(), sources)).encode()).hexdigest()[:16]
    path = folder / f"{name}-{key}.jawari"
    if not path.exists():
        if not make:
            return found
        say(name)
        data = gzip.compress(_bank(name), mtime=0)
        write_whole(path, lambda file: file.write(data))
    return found | {"file": path.name, "bytes": path.stat().st_size + len(wasm)}


def _sources() -> str:
    digest = hashlib.sha256(sources_hash().encode())
    for path in (Path(__file__), *sorted((ROOT / "synth" / "plugin").glob("*.py"))):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _bank(name: str) -> bytes:
    from synth.plugin import bankfile, packed_bank
    from synth.plugin.droning import DroneSettings

    preset, drone = load_preset(name.removesuffix(DRONE)), None
    if name.endswith(DRONE):
        sa = preset.string[1].notes[0]  # as `synth export --drone` has it
        drone = DroneSettings(sa_hz=preset.tuning.a4_hz * 2.0 ** ((sa - 69) / 12)).on(preset)
        preset = drone.strings.preset
    return packed_bank.for_pages(*bankfile.laid_out([preset], [webfolder.RATE_HZ], name=name, drone=drone))
