"""What `tools/web-engine-speed` does; see there."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from synth.instrument.preset import load_preset
from synth.midi.events import NOTE_ON, make_events
from synth.plugin import bankfile, shelf, webfolder
from synth.plugin.platforms import WEB, WEB_RELAXED
from tests.plugin.native import Library

RATE_HZ, BLOCK, SECONDS = int(webfolder.RATE_HZ), 128, 4
PRESETS = ("tanpura-light", "fretted-bass", "sitar", "steel-guitar", "electric-guitar")
#: in node, the least time of every block over several passes, which play the same
PLAY = """
import fs from "fs";
const [wasm, bank, events, rate, block, frames, passes] = process.argv.slice(2);
const x = new WebAssembly.Instance(new WebAssembly.Module(fs.readFileSync(wasm)), {}).exports;
x._initialize();
const why = x.jawari_alloc(512), given = fs.readFileSync(bank), at = x.jawari_alloc(given.length);
new Uint8Array(x.memory.buffer).set(given, at);
const engine = x.jawari_create(x.jawari_open_bytes(at, given.length, why), +rate, 1, why);
const place = x.jawari_alloc(8192), left = x.jawari_alloc(8 * block), right = x.jawari_alloc(8 * block);
const all = fs.readFileSync(events), best = [];
for (let pass = 0; pass < +passes; pass += 1) {
  x.jawari_reset(engine);
  for (let k = 0; k < 40; k += 1) x.jawari_process(engine, place, 0, +block, left, right);
  for (let done = 0, k = 0; done < +frames; done += +block, k += 1) {
    let count = 0;
    for (let at = 0; at < all.length; at += 32) {
      const frame = Number(all.readBigInt64LE(at)) - done;
      if (frame < 0 || frame >= +block) continue;
      new Uint8Array(x.memory.buffer).set(all.subarray(at, at + 32), place + 32 * count);
      new DataView(x.memory.buffer).setBigInt64(place + 32 * count, BigInt(frame), true);
      count += 1;
    }
    const begun = performance.now();
    x.jawari_process(engine, place, count, +block, left, right);
    best[k] = Math.min(best[k] ?? Infinity, performance.now() - begun);
  }
}
console.log(JSON.stringify(best));
"""


def main() -> int:
    parser = argparse.ArgumentParser(prog="tools/web-engine-speed", description="Speed of the engine as WebAssembly.")
    parser.add_argument(
        "presets", nargs="*", default=["tanpura-light", "fretted-bass", "sitar", "steel-guitar", "electric-guitar"]
    )
    parser.add_argument("--passes", type=int, default=5)
    options = parser.parse_args()
    if shutil.which("node") is None:
        print("tools/web-engine-speed: node is missing (apt-get install nodejs)", file=sys.stderr)
        return 2
    os.environ["JAWARI_LEVEL"] = "x86-64-v3"
    native = Library(shelf.native_library(print))
    engines = {"portable": shelf.web_library("web", print), "relaxed": shelf.web_library("web", print, WEB_RELAXED)}
    assert [path.name for path in engines.values()] == [WEB.library, WEB_RELAXED.library]
    print("preset             native v3 ×  worst ms" + "".join(f"   {kind} ×  of native  worst ms" for kind in engines))
    with tempfile.TemporaryDirectory() as name:
        for preset in map(load_preset, options.presets):
            report(preset, native, engines, Path(name), options.passes)
    return 0


def report(preset, native: Library, engines, folder: Path, passes: int) -> None:
    """One line: times real time and the worst block, natively and in node, in turn."""
    (folder / "bank").write_bytes(bankfile.bank([preset], [RATE_HZ]))
    (folder / "play.mjs").write_text(PLAY)
    events = make_events(score(preset))
    (folder / "events").write_bytes(events.tobytes())
    here = natively(native, folder / "bank", events, passes)
    line = f"{preset.name:18} {SECONDS / here.sum():11.1f} {1e3 * here.max():9.2f}"
    for module in engines.values():
        flags = ["--experimental-wasm-relaxed-simd"] if module.name == WEB_RELAXED.library else []
        given = [module, folder / "bank", folder / "events", RATE_HZ, BLOCK, SECONDS * RATE_HZ, passes]
        command = ["node", *flags, str(folder / "play.mjs"), *map(str, given)]
        told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        there = 1e-3 * np.array(json.loads(told))
        line += f" {SECONDS / there.sum():12.1f} {here.sum() / there.sum():10.2f} {1e3 * there.max():9.2f}"
    print(line, flush=True)


def score(preset) -> list[tuple]:
    """A tanpura's strings, a bass line, a melody, or chords of six strings."""
    if preset.family == "tanpura":
        return [(k * RATE_HZ * 5 // 6, NOTE_ON, 0, note, 100) for k, note in enumerate((43, 48, 48, 36))]
    if "guitar" in preset.name:
        chord = (40, 47, 52, 56, 59, 64)
        return [(k * RATE_HZ + 700 * s, NOTE_ON, 0, note, 100) for k in range(SECONDS) for s, note in enumerate(chord)]
    line = (28, 31, 33, 35, 28, 40, 38, 36) if "bass" in preset.name else (60, 62, 64, 65, 67, 64, 62, 60)
    return [(k * RATE_HZ // 4, NOTE_ON, 0, line[k % 8], 105) for k in range(4 * SECONDS)]


def natively(native: Library, path: Path, events: np.ndarray, passes: int) -> np.ndarray:
    """(blocks,) the least time of every block [s]."""
    bank = native.open_bank(path)
    engine = bank.engine(float(RATE_HZ))
    sides = np.zeros((2, BLOCK))
    places = [row.ctypes.data for row in sides]
    best = np.full(SECONDS * RATE_HZ // BLOCK, np.inf)
    for _ in range(passes):
        engine.reset()
        for _ in range(40):
            engine.process(events[:0], BLOCK)
        for k in range(best.size):
            here = events[(events["frame"] >= k * BLOCK) & (events["frame"] < (k + 1) * BLOCK)].copy()
            here["frame"] -= k * BLOCK
            begun = time.perf_counter()
            native.process(engine.address, here.ctypes.data, here.size, BLOCK, *places)
            best[k] = min(best[k], time.perf_counter() - begun)
    return best


if __name__ == "__main__":
    sys.exit(main())
