"""What `tools/native` does; see there."""

from __future__ import annotations

import argparse
import ctypes
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

#: what the sanitized library watches, and is made with
SANITIZE = ("-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-fno-omit-frame-pointer", "-g")
#: share of the sound that rounding may change: modes are float32, and strings that touch are chaotic
ROUNDING = 1e-3
#: tests that load the library into a program of its own, which the sanitizers would have to be a part of
NOT_SANITIZED = ("--ignore=tests/plugin/test_library.py", "--deselect=tests/plugin/test_lv2.py::test_a_host_runs_it")


def main() -> int:
    parser = argparse.ArgumentParser(prog="tools/native", description="Builds and tests the native library.")
    parser.add_argument("folder", nargs="?", type=Path, help="where to put the library")
    parser.add_argument(
        "--sanitize", action="store_true", help="run the plugin tests with address and undefined-behaviour sanitizers"
    )
    parser.add_argument("--time", action="store_true", help="print the time to build, to load and to restore a state")
    parser.add_argument("--aarch64", action="store_true", help="play with kernels for AArch64, under qemu (needs ziglang)")
    given, more = parser.parse_known_args()
    from synth.plugin.library import build

    if given.folder is not None:
        print(build(given.folder, say=print))
    if given.sanitize:
        return sanitize(more)
    if given.time:
        measure()
    if given.aarch64:
        return on_aarch64()
    return 0


def sanitize(arguments: list[str]) -> int:
    """The tests of plugins with the sanitized library; pytest's exit code."""
    from synth.plugin.library import build, compiler

    with tempfile.TemporaryDirectory() as folder:
        made = build(Path(folder), say=print, flags=SANITIZE)
        runtimes = [
            subprocess.run(
                [*compiler(), f"-print-file-name={name}"], capture_output=True, text=True, check=True
            ).stdout.strip()
            for name in ("libasan.so", "libubsan.so")
        ]
        environment = os.environ | {
            "JAWARI_TEST_LIBRARY": str(made),
            "LD_PRELOAD": ":".join(runtimes),
            # Python itself keeps what it has; its stack is not the C part's
            "ASAN_OPTIONS": "detect_leaks=0:detect_stack_use_after_return=0:verify_asan_link_order=0",
            "UBSAN_OPTIONS": "print_stacktrace=1",
            "PYTHONPATH": str(ROOT),
        }
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "tests/plugin",
            *NOT_SANITIZED,
            *arguments,
        ]
        return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode


def on_aarch64() -> int:
    """Builds a program of the core's C part and kernels for AArch64, lets it play, and prints how far that is from here; 1
    if that is more than rounding, 2 if it cannot be tried."""
    from synth.plugin import links
    from synth.plugin.c_sources import sources
    from synth.plugin.library import SOURCES, kernels_version, zig
    from synth.plugin.platforms import TARGETS

    if shutil.which("qemu-aarch64") is None or zig() is None:
        print("qemu-aarch64 (apt-get install qemu-user) and ziglang (pip install ziglang) are needed", file=sys.stderr)
        return 2
    import numpy as np

    from synth.engine.engine import Engine
    from synth.instrument.preset import load_preset
    from synth.midi.events import NOTE_ON
    from synth.plugin.bankfile import bank
    from synth.plugin.emit import emit
    from tests.engine.kit import play

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        emit("aarch64", folder / "kernels.o", TARGETS["linux-arm64"])
        told = links.made(["aarch64"], version="", kernels=kernels_version(), sources="")
        (folder / "levels.c").write_text(told, encoding="utf-8")
        core = [str(path) for path in sources(TARGETS["linux-arm64"], "engine")]
        written = [str(ROOT / "tests" / "plugin" / "playbank.c"), str(folder / "levels.c")]
        what = [f"-I{SOURCES}", *written, *core, str(folder / "kernels.o"), "-lm"]
        compiler = [sys.executable, "-m", "ziglang", "cc", "-target", "aarch64-linux-musl", "-static", "-O2", "-std=gnu11"]
        subprocess.run([*compiler, "-o", str(folder / "play"), *what], check=True)
        other = False
        for preset in map(load_preset, ("tanpura-light", "fretted-bass", "jawari-harp")):
            (folder / "bank").write_bytes(bank([preset], [44100.0]))
            player = ["qemu-aarch64", str(folder / "play"), str(folder / "bank"), str(folder / "sound")]
            subprocess.run(player, check=True)
            engine = Engine([preset])
            engine.prepare(44100.0)
            here = play(engine, [(0, NOTE_ON, 0, 48, 100), (99, NOTE_ON, 0, 43, 100)], 20000)[:, 0]
            there = np.fromfile(folder / "sound")
            difference = np.abs(here - there).max()
            print(f"{preset.name}: level {np.abs(here).max():.3f}, difference at most {difference:.2g}")
            other = other or not np.linalg.norm(here - there) < ROUNDING * np.linalg.norm(here)
    return int(other)


def measure() -> None:
    """Prints sizes and times, every one the least of several."""
    from synth.instrument.preset import load_preset, playable_range
    from synth.midi.events import NOTE_ON
    from synth.plugin.bankfile import bank
    from synth.plugin.library import build, with_bank
    from tests.plugin.native import Library

    with tempfile.TemporaryDirectory() as folder:
        begin = time.monotonic()
        made = build(Path(folder), say=print)
        print(f"built in {time.monotonic() - begin:.1f} s, {made.stat().st_size / 1e3:.0f} kB")
        for name in ("tanpura-light", "fretted-bass", "jawari-harp"):
            preset = load_preset(name)
            low = playable_range(preset)[0]
            begin = time.monotonic()
            data = bank([preset], [44100.0])
            bank_s = time.monotonic() - begin
            times: list[list[float]] = [[], [], [], [], [], []]
            for k in range(5):
                path = Path(folder) / f"{name}-{k}.so"
                path.write_bytes(with_bank(made, data))
                stamps = [time.perf_counter()]
                library = Library(path)
                stamps.append(time.perf_counter())
                opened = library.open_own_bank()
                stamps.append(time.perf_counter())
                first = opened.engine()
                stamps.append(time.perf_counter())
                second = opened.engine()
                stamps.append(time.perf_counter())
                first.play([(0, NOTE_ON, 0, low + each, 100) for each in range(12)], 20000)
                kept = first.save()
                begun = time.perf_counter()
                elsewhere = ctypes.c_int32()
                sound = library.told(library.read, opened.address, kept, len(kept), ctypes.byref(elsewhere))
                read = time.perf_counter()
                library.take_up(second.address, sound)
                stamps += [stamps[-1] + read - begun, stamps[-1] + time.perf_counter() - begun]
                library.forget(sound)
                for times_of, a, b in zip(times, stamps, stamps[1:], strict=False):
                    times_of.append(1e3 * (b - a))
                del first, second
            what = ("dlopen", "open", "create", "once more", "state read", "taken up")
            least = ", ".join(f"{name} {min(each):.2f}" for name, each in zip(what, times, strict=True))
            print(f"{preset.name}: bank {len(data) / 1e6:.2f} MB in {bank_s:.1f} s; {least} ms")


if __name__ == "__main__":
    sys.exit(main())
