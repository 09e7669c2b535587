"""Instruments that pages of the documentation play: banks made once, kept while nothing that they depend on changes."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from listening.rendering import ROOT, sources_hash
from synth.files.targets import write_text, write_whole
from synth.instrument.preset import load_preset
from synth.plugin import library, shelf, webfolder

PLACE = re.compile(r"^<!-- instrument: ([a-z0-9-]+) -->$", re.MULTILINE)
DRONE = "-drone"
#: Sa of a drone, the C below middle C [Hz]
SA_HZ = 440.0 * 2.0 ** ((48 - 69) / 12)


def named(docs: Path) -> list[str]:
    """What pages ask for."""
    return sorted({name for page in docs.rglob("*.md") for name in PLACE.findall(page.read_text(encoding="utf-8"))})


def write_all(docs: Path, folder: Path, say: Callable[[str], None]) -> None:
    """All that pages in `docs` ask for, the programs and the engine, and live.json, which lists them.

    Where there is no engine for web pages, they are listed without a file. Banks that nothing asks for go.
    """
    folder.mkdir(parents=True, exist_ok=True)
    try:
        wasm = shelf.web_library(say).read_bytes()
    except library.BuildError as error:
        say(f"no instruments on pages: {error}")
        wasm = None
    listed = [_listed(name, folder, wasm, say) for name in named(docs)]
    if wasm is not None:
        for name, text in webfolder.parts().items():
            write_text(folder / name, text)
        write_whole(folder / webfolder.ENGINE, lambda file: file.write(wasm))
    for old in set(folder.glob("*.jawari")) - {folder / str(each["file"]) for each in listed}:
        old.unlink()
    write_text(folder / "live.json", json.dumps(listed, indent=1))


def _listed(name: str, folder: Path, wasm: bytes | None, say: Callable[[str], None]) -> dict[str, Any]:
    preset = load_preset(name.removesuffix(DRONE))
    found: dict[str, Any] = {"name": name, "title": preset.title or preset.name, "file": None, "bytes": 0}
    if wasm is None:
        return found
    key = hashlib.sha256("\n".join((name, preset.model_dump_json(), _sources())).encode()).hexdigest()[:16]
    path = folder / f"{name}-{key}.jawari"
    if not path.exists():
        say(name)
        data = _bank(name)
        write_whole(path, lambda file: file.write(data))
    return found | {"file": path.name, "bytes": path.stat().st_size + len(wasm)}


def _sources() -> str:
    digest = hashlib.sha256(sources_hash().encode())
    for path in sorted((ROOT / "synth" / "plugin").glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


def _bank(name: str) -> bytes:
    from synth.plugin import bankfile
    from synth.plugin.droning import DroneSettings

    preset = load_preset(name.removesuffix(DRONE))
    if not name.endswith(DRONE):
        return bankfile.bank([preset], [webfolder.RATE_HZ])
    drone = DroneSettings(sa_hz=SA_HZ).on(preset)
    return bankfile.bank([drone.strings.preset], [webfolder.RATE_HZ], name=name, drone=drone)
