"""What `tools/native` does; see there."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

#: what the sanitized library watches, and is made with
SANITIZE = ("-fsanitize=address,undefined", "-fno-sanitize-recover=undefined", "-fno-omit-frame-pointer", "-g")
#: tests that load the library into a program of its own, which the sanitizers would have to be a part of
NOT_SANITIZED = ("--ignore=tests/plugin/test_library.py", "--deselect=tests/plugin/test_lv2.py::test_a_host_runs_it")


def main() -> int:
    parser = argparse.ArgumentParser(prog="tools/native", description="Builds and tests the native library.")
    parser.add_argument("folder", nargs="?", type=Path, help="where to put the library")
    parser.add_argument(
        "--sanitize", action="store_true", help="run the plugin tests with address and undefined-behaviour sanitizers"
    )
    parser.add_argument("--time", action="store_true", help="print the time to build, to load and to restore a state")
    given, more = parser.parse_known_args()
    from synth.plugin.library import build

    if given.folder is not None:
        print(build(given.folder, say=print))
    if given.sanitize:
        return sanitize(more)
    if given.time:
        measure()
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


def measure() -> None:
    """Prints sizes and times, every one the least of several."""
    from synth.instrument.preset import load_preset
    from synth.plugin.bankfile import bank
    from synth.plugin.library import build, with_bank
    from tests.plugin.native import Library

    with tempfile.TemporaryDirectory() as folder:
        begin = time.monotonic()
        made = build(Path(folder), say=print)
        print(f"built in {time.monotonic() - begin:.1f} s, {made.stat().st_size / 1e3:.0f} kB")
        for name in ("tanpura-light", "fretted-bass", "jawari-harp"):
            preset = load_preset(name)
            begin = time.monotonic()
            data = bank([preset], [44100.0])
            bank_s = time.monotonic() - begin
            times: list[list[float]] = [[], [], [], []]
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
                for times_of, a, b in zip(times, stamps, stamps[1:], strict=False):
                    times_of.append(1e3 * (b - a))
                del first, second
            what = ("dlopen", "open", "create", "once more")
            least = ", ".join(f"{name} {min(each):.2f}" for name, each in zip(what, times, strict=True))
            print(f"{preset.name}: bank {len(data) / 1e6:.2f} MB in {bank_s:.1f} s; {least} ms")


if __name__ == "__main__":
    sys.exit(main())
