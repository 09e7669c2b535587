"""Takes of 0.15 s that are the same bits everywhere, and who can play them: portable libraries on this
processor and on others, the engine as WebAssembly in several machines.

All are of one bank; a take's program chooses its instrument. What is compared is the SHA-256 of the samples: float64, the
two channels interleaved.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

from synth.instrument.preset import load_preset
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, PROGRAM, make_events
from synth.plugin import bankfile
from synth.plugin.platforms import Target
from tests.patience import COMPILING_QUIET_S

from .emulated import HERE, compiled, run, started

RATE_HZ, FRAMES, BLOCK = 48000.0, 7200, 480
PRESETS = ("tanpura-light", "fretted-bass", "sitar", "shamisen")
#: keys that each of them has
_KEYS: Mapping[str, Sequence[int]] = {
    "tanpura-light": (48, 43, 55, 36),
    "fretted-bass": (28, 33, 40, 45),
    "sitar": (48, 50, 55, 60),
    "shamisen": (48, 53, 60, 64),
}
#: a processor of x86's second level, and one of its third
PROCESSORS = ("Nehalem", "Haswell")
_IN_PAGE = """
const { play } = await import("/playwasm.mjs");
const read = async (path) => (await fetch(path)).arrayBuffer();
const [wasm, bank, events] = [await read("module"), await read("bank"), await read(arguments[0])];
const sound = play(wasm, bank, arguments[1], arguments[2], arguments[3], events);
const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", sound));
return [...digest].map((each) => each.toString(16).padStart(2, "0")).join("");
"""


def bank() -> bytes:
    return bankfile.bank([load_preset(name) for name in PRESETS], [RATE_HZ], name="takes", quality="draft")


def take(name: str) -> np.ndarray:
    """EVENT: strokes that overlap, bends, a pedal, a parameter that is turned, keys that come up."""
    keys, rows = _KEYS[name], [(0, PROGRAM, 0, PRESETS.index(name), 0)]
    for k in range(12):
        key, frame = keys[k % len(keys)] + (k // len(keys)), 17 + 525 * k
        rows.append((frame, NOTE_ON, 0, key, 40 + 7 * k))
        rows += [(frame + 30 * step, BEND, 0, 500 * step * (-1) ** k, 0) for step in range(1, 6)]
        if k % 3 != 2:
            rows.append((frame + 435, NOTE_OFF, 0, key, 64))
    rows += [(1350, CONTROL, 0, 64, 127), (3000, CONTROL, 0, 64, 0), (2250, CONTROL, 0, 1, 90)]
    events = make_events([*rows, (3600, PARAMETER, PRESETS.index(name), 1, 0, 0.3)])
    return events[np.argsort(events["frame"], kind="stable")]


def blocks(events: np.ndarray) -> list[tuple[np.ndarray, int]]:
    """The events of each block, whose frames count from its beginning, and its frames."""
    out = []
    for begin in range(0, FRAMES, BLOCK):
        here = events[(events["frame"] >= begin) & (events["frame"] < begin + BLOCK)].copy()
        here["frame"] -= begin
        out.append((here, min(BLOCK, FRAMES - begin)))
    return out


def digest(samples: bytes) -> str:
    return hashlib.sha256(samples).hexdigest()


def here(loaded, bank_file: Path) -> dict[str, str]:
    """By a native library (`native.Library`) in this process."""
    found, opened = {}, loaded.open_bank(bank_file)
    for name in PRESETS:
        sound = opened.engine(RATE_HZ).play(take(name), FRAMES, BLOCK)
        assert np.isfinite(sound).all() and 0.02 < np.abs(sound).max() < 1.01, name
        found[name] = digest(sound.tobytes())
    opened.close()
    return found


def in_wasmtime(module: bytes, data: bytes) -> dict[str, str]:
    from .wasmrun import Module, Sides

    found = {}
    made = Module(module)
    opened, sides = made.open_bank(data), Sides(made, BLOCK, len(take(PRESETS[0])))
    for name in PRESETS:
        engine = made.engine(opened, RATE_HZ)
        sound = [sides.process(engine, *block) for block in blocks(take(name))]
        found[name] = digest(np.concatenate(sound).tobytes())
        made.call("jawari_destroy", engine)
    return found


def written(folder: Path) -> dict[str, Path]:
    """Files of the takes' events."""
    files = {name: folder / f"{name}.events" for name in PRESETS}
    for name, path in files.items():
        path.write_bytes(take(name).tobytes())
    return files


def in_node(module: Path, bank_file: Path, folder: Path) -> dict[str, str]:
    """In V8."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed (apt-get install nodejs)")
    found = {}
    for name, path in written(folder).items():
        out = path.with_suffix(".sound")
        run([node, str(HERE / "playwasm.mjs"), *map(str, (module, bank_file, RATE_HZ, FRAMES, BLOCK, path, out))])
        found[name] = digest(out.read_bytes())
    return found


def in_firefox(module: Path, bank_file: Path, folder: Path) -> dict[str, str]:
    """In SpiderMonkey."""
    from tests.author.browser import firefox

    from .webserved import served

    if firefox.why_not():
        pytest.skip(firefox.why_not())
    for path, name in ((module, "module"), (bank_file, "bank"), (HERE / "playwasm.mjs", "playwasm.mjs")):
        shutil.copy(path, folder / name)
    (folder / "index.html").write_text("<!doctype html><title>takes</title>", encoding="utf-8")
    found, files = {}, written(folder)
    with served(folder) as address, firefox.Firefox() as browser:
        browser.call("browsingContext.navigate", context=browser.tab, url=address, wait="complete")
        for name, path in files.items():
            found[name] = browser.script(_IN_PAGE, path.name, RATE_HZ, FRAMES, BLOCK, quiet_s=COMPILING_QUIET_S)
    return found


def elsewhere(target: Target, native: Path, bank_file: Path, folder: Path, processor: str = "") -> dict[str, str]:
    """By a library of another system or processor, in its emulator."""
    start, program = started(target, processor), compiled("playtake.c", target, folder)
    if start[0].startswith("qemu-x86"):  # its VZEROUPPER, in glibc's copies of memory, takes four times what all else does
        start += ["-E", "GLIBC_TUNABLES=glibc.cpu.hwcaps=Prefer_No_VZEROUPPER"]
    place, found = shutil.copy(native, folder), {}
    data = shutil.copy(bank_file, folder / "bank.jawari") if bank_file.parent != folder else bank_file
    for name, path in written(folder).items():
        given = [f"./{Path(place).name}", Path(data).name, RATE_HZ, FRAMES, BLOCK, path.name, f"{name}.sound"]
        settings = {"WINEPREFIX": str(folder / "wine"), "WINEDEBUG": "-all"}
        run([*start, str(program), *map(str, given)], cwd=folder, env=os.environ | settings)
        found[name] = digest((folder / f"{name}.sound").read_bytes())
    return found
