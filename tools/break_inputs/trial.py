"""One broken input: what the program is asked to do with it, and what may come of that.

Every file lies in a folder of its own beside an output that is there already. Afterwards the input is what it was, the
output is whole and new (exit code 0) or what it was (2), and nothing else is there.
"""

from __future__ import annotations

import contextlib
import io
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from break_inputs import seeds
from break_inputs.damage import bytes_broken, text_broken
from synth.cli import main
from synth.research.case import CaseError, load_case

KINDS = ("midi", "preset", "scale", "keyboard", "case", "audio", "result")
THERE = b"what was there before"
#: most mode-steps and arrays' rows of a broken case that are computed as they stand; more is asked for in a shorter run
MOST_MODE_STEPS, MOST_ROWS = 2e8, 2e5


class Broke(Exception):
    """What must not have happened."""


def whole(kind: str) -> tuple[bytes, ...]:
    """The whole inputs of a kind."""
    return {
        "midi": seeds.songs,
        "preset": seeds.presets,
        "scale": seeds.scales,
        "keyboard": seeds.keyboards,
        "case": seeds.cases,
        "audio": seeds.recordings,
        "result": seeds.results,
    }[kind]()


def broken(kind: str, number: int, seed: int) -> bytes:
    """The broken input `number` of its kind, the same at every call."""
    rng, source = _drawn(kind, number, seed)
    text = kind in ("preset", "scale", "keyboard", "case")
    return (text_broken if text else bytes_broken)(whole(kind)[source], rng)


def source(kind: str, number: int, seed: int) -> int:
    """Index of the whole input of which the broken input `number` is made."""
    return _drawn(kind, number, seed)[1]


def _drawn(kind: str, number: int, seed: int) -> tuple[np.random.Generator, int]:
    rng = np.random.default_rng([seed, KINDS.index(kind), number])
    return rng, int(rng.integers(len(whole(kind))))


def attempt(kind: str, data: bytes) -> str:
    """What came of it: "taken" or "refused". Raises Broke, or whatever the program let through."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        codes = [_command(folder, arguments, data) for arguments in _asked(kind, folder, data)]
    return "refused" if any(codes) else "taken"


def _asked(kind: str, folder: Path, data: bytes) -> list[list[str]]:
    """The commands that a broken input goes through."""
    song = folder / "song.mid"
    brief = ["--quality", "draft", "--end", "0.3", "--tail", "0", "-o", str(folder / "out.wav")]
    match kind:
        case "midi":
            return [["render", str(folder / "in.mid"), "-p", "tanpura-light", *brief]]
        case "preset":
            mine = str(folder / "in.toml")
            return [["presets", "check", mine], ["plan", mine, "48"], ["render", str(song), "-p", mine, *brief]]
        case "scale":
            return [["render", str(song), "-p", "tanpura-light", "--tuning", str(folder / "in.scl"), *brief]]
        case "keyboard":
            scale = folder / "whole.scl"
            tunings = ["--tuning", str(scale), "--kbm", str(folder / "in.kbm")]
            return [["render", str(song), "-p", "tanpura-light", *tunings, *brief]]
        case "case":
            return [["simulate", str(folder / "in.toml"), "-o", str(folder / "out.npz"), *_short(data)]]
        case "audio":
            mine = str(folder / "out.toml")
            return [["fit", str(folder / "in.wav"), "-p", "fretted-bass", "-o", mine]]
        case _:
            return [
                [
                    "simulate",
                    "tanpura-light",
                    "--from",
                    str(folder / "in.npz"),
                    "-o",
                    str(folder / "out.npz"),
                    "--duration",
                    "0.01",
                ]
            ]


def _short(data: bytes) -> list[str]:
    """Options that shorten what a broken case asks for, where it is a case and asks for much."""
    with tempfile.NamedTemporaryFile(suffix=".toml") as file:
        file.write(data)
        file.flush()
        try:
            run = load_case(file.name).run
        except CaseError:
            return []
    steps = run.internal_rate_hz * run.duration_s
    rows = (run.output_rate_hz or run.internal_rate_hz) * run.duration_s
    over = max(steps * run.modes / MOST_MODE_STEPS, rows / MOST_ROWS)
    if not over > 1.0:
        return []
    shorter = run.duration_s / over
    return ["--duration", f"{shorter:.9g}"] if 1e-9 <= shorter <= 1e6 else []


def _command(folder: Path, arguments: Sequence[str], data: bytes) -> int:
    before = {"song.mid": seeds.songs()[0], "whole.scl": seeds.SCALE, Path(_input(arguments, folder)).name: data}
    if "-o" in arguments:
        before[Path(arguments[arguments.index("-o") + 1]).name] = THERE
    for name, content in before.items():
        (folder / name).write_bytes(content)
    said, told = io.StringIO(), io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(told):
        try:
            code = main(arguments)
        except SystemExit as left:
            code = left.code if isinstance(left.code, int) else 1
    words = said.getvalue()
    if code not in (0, 2):
        raise Broke(f"exit code {code}: {words}")
    if "Traceback" in words or "Warning" in words:
        raise Broke(f"said {words}")
    lines = words.splitlines()
    if code == 2 and not any(line.startswith("synth: error: ") for line in lines):
        raise Broke(f"refused without a reason: {words!r}")
    after = {path.name: path.read_bytes() for path in folder.iterdir()}
    for name, content in before.items():
        if content is THERE and code == 0:
            if after.get(name) in (THERE, b"", None):
                raise Broke(f"{name} was not written, exit code 0")
        elif after.get(name) != content:
            raise Broke(f"{name} is lost or changed, exit code {code}")
    if left_over := sorted(after.keys() - before.keys()):
        raise Broke(f"left behind: {', '.join(left_over)}")
    return code


def _input(arguments: Sequence[str], folder: Path) -> str:
    return next(word for word in arguments if word.startswith(str(folder / "in.")))
