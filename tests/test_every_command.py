"""Every command where a machine is not as one would wish: an output that is an input, a full disk, closed streams, a
terminal that hangs up, odd names, a directory that is gone. One line or none, an exit code, the files as they were.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

from synth.instrument.preset import preset_folder
from tests.forkserver import ROOT, Done, ForkServer, ended, full_pipe, writes
from tests.host.midibytes import header, off, on, track
from tests.nocard import hide_sound_card
from tests.patience import compiling_s, until

CHEAP = ["--quality", "draft", "--threads", "1"]
RENDER = ["render", "s.mid", "-o", "out.wav", "--tail", "0", *CHEAP]
DRONE = ["drone", "-o", "out.wav", "--duration", "0.1", *CHEAP]
#: as far as a machine without a sound card comes
PLAY = ["play", "--device", "nowhere", "--record", "out.wav", "--play", "s.mid", "-p", "my.toml"]
NO_DEVICE = "nowhere|there is no audio output"
AUTHOR = ["author", "my.toml", "--no-browser"]
FIT = ["fit", "note.wav", "-p", "my.toml", "-o", "new.toml"]
BODY = ["body", "fit", "bridge.csv", "-o", "new.toml"]
DEVICES = ["devices"]
PRESETS = ["presets", "show", "my.toml"]
PLAN = ["plan", "my.toml", "C3", "--quality", "draft"]
SIMULATE = ["simulate", "case.toml", "-o", "out.npz"]
#: what it reads is looked at, and nothing computed: a folder of results is tests/test_study.py's
SWEEP = ["sweep", "study.toml", "--check"]
COMPLETION = ["completion", "bash"]
GOOD = {
    "render": RENDER, "drone": DRONE, "play": PLAY, "author": AUTHOR, "fit": FIT, "body": BODY, "devices": DEVICES,
    "presets": PRESETS, "plan": PLAN, "simulate": SIMULATE, "sweep": SWEEP, "completion": COMPLETION,
}  # fmt: skip
CONDITIONS = (
    "output is input", "full disk", "closed stdin", "closed stdout", "closed stderr", "SIGHUP", "odd names",
    "deleted folder",
)  # fmt: skip

#: bytes of a file's name that are no UTF-8, that would break a line, that look like an option, that are as many as can be,
#: that few encodings know; without an ending
ODD = {
    "not UTF-8": "b\udce9\udcff",
    "newline": "two\nlines\x1b[2J",
    "dash": "-o",
    "250 bytes": "x" * 246,
    "unicode": "ṭāṇpūrā 弦 🎻",
}


@dataclass(frozen=True)
class Cell:
    """What is run, and what is to come of it.

    says    in the one line on standard error (exit code 2), or on standard output
    makes   the files that are there afterwards and were not before
    link    (a name, where it leads): a symbolic link that is made before; hard: a hard one
    """

    command: str
    condition: str
    arguments: list[str]
    code: int
    says: str = ""
    makes: tuple[str, ...] = ()
    link: tuple[str, str] = ()  # type: ignore[assignment]
    hard: bool = False
    how: dict[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return re.sub(r"[^ -~]|/", "?", f"{self.condition}: {' '.join(self.arguments)}")[:90]


def replaced(arguments: list[str], **words: str) -> list[str]:
    """Arguments with words replaced: s_mid=… for s.mid."""
    named = {name.replace("_", "."): word for name, word in words.items()}
    return [named.get(word, word) for word in arguments]


def _overwriting() -> Iterator[Cell]:
    def cell(command: str, arguments: list[str], says: str = "would overwrite", **more: Any) -> Cell:
        return Cell(command, "output is input", arguments, 2, says, **more)

    raw = ["--format", "raw"]
    yield cell("render", ["render", "s.mid", "-o", "s.mid", *raw], r"-o s\.mid would overwrite midi s\.mid, which is an")
    yield cell("render", ["render", "s.mid", "-o", "./s.mid", *raw])
    yield cell("render", ["render", "s.mid", "-o", "link.wav"], link=("link.wav", "s.mid"))
    yield cell("render", ["render", "s.mid", "-o", "link.wav"], link=("link.wav", "s.mid"), hard=True)
    yield cell("render", ["render", "link.mid", "-o", "s.mid", *raw], link=("link.mid", "s.mid"))
    yield cell("render", ["render", "s.mid", "-p", "my.toml", "-o", "my.toml", *raw], "preset my.toml")
    yield cell("render", ["render", "s.mid", "--map", "1=my.toml", "-o", "my.toml", *raw], "preset my.toml")
    yield cell("render", ["render", "s.mid", "--tuning", "t.scl", "-o", "t.scl", *raw], "tuning t.scl")
    yield cell("render", ["render", "s.mid", "--kbm", "t.kbm", "-o", "t.kbm", *raw], "kbm t.kbm")
    # a stem is called after its channel and preset
    stem = "ch01-my.raw"
    yield cell("render", ["render", stem, "-p", "my.toml", "--stems", ".", *raw], "stem", link=(stem, "s.mid"))
    yield cell("render", ["render", "s.mid", "-p", "my.toml", "--stems", ".", "-o", stem, *raw], "are the same file")
    yield cell("drone", ["drone", "-p", "my.toml", "-o", "my.toml", *raw])
    yield cell("drone", ["drone", "-p", "my.toml", "--record", "my.wav"], "strings my.toml would overwrite preset")
    yield cell("play", ["play", "-p", "my.toml", "--record", "link.wav"], link=("link.wav", "my.toml"))
    yield cell("play", ["play", "--play", "s.mid", "--record", "s.wav"], "take s.mid would overwrite song s.mid")
    yield cell("play", ["play", "--record", "two.wav"], "are the same file", link=("two.wav", "two.mid"))
    yield cell("fit", ["fit", "note.wav", "-p", "my.toml", "-o", "note.wav"])
    yield cell("fit", ["fit", "note.wav", "-p", "my.toml", "-o", "link.toml"], link=("link.toml", "note.wav"))
    yield cell("fit", ["fit", "note.wav", "-p", "my.toml", "-o", "link.toml"], link=("link.toml", "my.toml"), hard=True)
    yield cell("body", ["body", "fit", "bridge.csv", "-o", "bridge.csv"])
    yield cell("body", ["body", "fit", "bridge.csv", "-o", "link.toml"], link=("link.toml", "bridge.csv"))
    yield cell("simulate", ["simulate", "case.toml", "-o", "case.toml"])
    yield cell("simulate", ["simulate", "case.toml", "-o", "modes.npz"], "would overwrite case modes.npz")


def _full() -> Iterator[Cell]:
    def cell(command: str, arguments: list[str], says: str, **how: Any) -> Cell:
        return Cell(command, "full disk", arguments, 2, says, how=how)

    for ending in ("wav", "flac", "raw"):
        yield cell("render", replaced(RENDER, out_wav=f"old.{ending}"), rf"old\.{ending}: File too large", largest=1000)
    yield cell("render", [*RENDER, "--stems", "new"], r"(out|ch01-jawari-harp)\.wav: File too large", largest=1000)
    yield cell("render", [*RENDER, "--normalize"], "temporary file in .*: File too large", largest=1000)
    yield cell("render", replaced(RENDER, out_wav="/dev/full"), "/dev/full: No space left on device")
    yield cell("render", replaced(RENDER, out_wav="-"), "standard output: No space left on device", out="/dev/full")
    yield cell("drone", replaced(DRONE, out_wav="old.flac"), r"old\.flac: File too large", largest=1000)
    yield cell("drone", replaced(DRONE, out_wav="-"), "standard output: No space left on device", out="/dev/full")
    yield cell("fit", replaced(FIT, new_toml="old.toml"), r"old\.toml: File too large", largest=1000)
    yield cell("body", replaced(BODY, new_toml="old.toml"), r"old\.toml: File too large", largest=300)
    yield cell("simulate", replaced(SIMULATE, out_npz="old.npz"), r"old\.npz: File too large", largest=1000)
    for command in ("fit", "body", "devices", "presets", "plan", "sweep", "completion"):
        arguments = {"fit": FIT[:2], "body": BODY[:3]}.get(command, GOOD[command])
        yield cell(command, arguments, "standard output: No space left on device", out="/dev/full")
    yield cell("author", AUTHOR, "standard output: No space left on device", out="/dev/full")
    yield cell("presets", ["--help"], "standard output: No space left on device", out="/dev/full")


def _closed() -> Iterator[Cell]:
    """What writes files does so; a command whose result is text has failed where nobody can read that."""
    made = {"render": ("out.wav",), "drone": ("out.wav",), "fit": ("new.toml",), "body": ("new.toml",)}
    made["simulate"] = ("out.npz",)
    for command, arguments in GOOD.items():
        for number, name in enumerate(("stdin", "stdout", "stderr")):
            if command == "play":
                code, says = 2, NO_DEVICE if number != 2 else ""
            elif command == "author":
                code, says = (2, "standard output: Bad file descriptor") if number == 1 else (0, "")
            elif number == 1:
                code, says = 2, "standard output: Bad file descriptor"
            else:
                code, says = 0, ""
            yield Cell(command, f"closed {name}", arguments, code, says, made.get(command, ()), how={"closed": (number,)})
    yield Cell("render", "closed stdout", [*RENDER, "--quiet"], 0, "", ("out.wav",), how={"closed": (1,)})
    yield Cell("render", "closed stdout", replaced(RENDER, out_wav="-"), 2, "standard output: Bad", how={"closed": (1,)})
    yield Cell("render", "closed stderr", RENDER, 2, "", ("out.wav",), how={"closed": (0, 1, 2)})
    yield Cell("render", "closed stderr", ["render", "none.mid", "-o", "out.wav"], 2, how={"closed": (2,)})


def _odd() -> Iterator[Cell]:
    for odd in ODD.values():
        mid, wav, toml = (f"{odd}.{ending}" for ending in ("mid", "wav", "toml"))
        cells = {
            "render": (["render", "-o" + wav, "--tail", "0", "--json", *CHEAP, "--", mid], 0, (wav,)),
            "drone": (["drone", "-p" + toml, "-o" + wav, *DRONE[3:], "--json"], 0, (wav,)),
            "play": (["play", "--device", "nowhere", "--play=" + mid, "-p" + toml, "--record=take-" + wav[-200:]], 2, ()),
            "fit": (
                ["fit", "-p" + toml, "-oNEW" + toml[-200:], "--json", "--", "odd" + wav[-200:]],
                0,
                ("NEW" + toml[-200:],),
            ),
            "body": (
                ["body", "fit", "-oNEW" + toml[-200:], "--json", "--", "bridge" + f"{odd}.csv"[-200:]],
                0,
                ("NEW" + toml[-200:],),
            ),
            "presets": (["presets", "check", "--", toml], 0, ()),
            "plan": (["plan", "--quality", "draft", "--", toml, "C3"], 0, ()),
            "simulate": (["simulate", "-o" + odd + ".npz", "--json", "--", "case-" + toml[-200:]], 0, (odd + ".npz",)),
            "sweep": (["sweep", "--check", "--json", "--", "study-" + toml[-200:]], 0, ()),
        }
        for command, (arguments, code, makes) in cells.items():
            yield Cell(command, "odd names", arguments, code, NO_DEVICE if code else "", makes)
        # and where it is not there, or no such file: still one line
        yield Cell("render", "odd names", ["render", "-onone.wav", "--", "none-" + mid[-200:]], 2, "no such file")
        yield Cell("simulate", "odd names", ["simulate", "-onone.npz", "--", "none-" + toml[-200:]], 2, "")
    name = ODD["unicode"] + ".toml"
    yield Cell("author", "odd names", ["author", name, "--no-browser"], 0, "http://")
    yield Cell("author", "odd names", ["author", ODD["not UTF-8"] + ".toml", "--no-browser"], 2, "is not a valid name")
    # an encoding that knows few letters is no reason to fail
    ascii_only = {"how": {"encoding": "ascii"}}
    yield Cell("render", "odd names", RENDER, 0, r"\\xd7 real time", ("out.wav",), **ascii_only)
    yield Cell("plan", "odd names", PLAN, 0, r"\\xd7 output", **ascii_only)
    yield Cell("presets", "odd names", PRESETS, 0, "# µ", **ascii_only)


def _deleted() -> Iterator[Cell]:
    """The directory that one stands in has been deleted: what is named by its whole path works."""
    for command, arguments in GOOD.items():
        whole = ["HERE/" + word if re.fullmatch(r"[a-z]+\.[a-z]{3,4}", word) else word for word in arguments]
        made = tuple(word for word in arguments if word in ("out.wav", "new.toml", "out.npz")) if command != "play" else ()
        code, says = (2, NO_DEVICE) if command == "play" else (0, "")
        yield Cell(command, "deleted folder", whole, code, says, made, how={"gone": True})
    for command in ("render", "drone", "play", "fit", "body", "simulate"):
        read = ("s.mid", "my.toml", "note.wav", "case.toml", "bridge.csv")
        relative = ["HERE/" + word if word in read else word for word in GOOD[command]]
        name = next(word for word in relative if word in ("out.wav", "new.toml", "out.npz"))
        yield Cell(command, "deleted folder", relative, 2, f"{name}: the directory . has been deleted", how={"gone": True})
    yield Cell("author", "deleted folder", ["author", "--no-browser"], 2, "current directory has been", how={"gone": True})


def _hung_up() -> Iterator[Cell]:
    """While a file is written, or while a text is, that nobody reads."""
    for extra in ([], ["--stems", "new"], ["--normalize"]):
        long = ["render", "long.mid", "-o", "old.wav", "-p", "my.toml", *CHEAP, *extra]
        for number in ("SIGHUP", "SIGTERM", "SIGQUIT", "SIGINT") if not extra else ("SIGHUP",):
            signalled = {"signal": getattr(signal, number), "at": ".old.wav.*"}
            yield Cell("render", "SIGHUP", long, 128 + signalled["signal"], how=signalled)
    long = ["drone", "-o", "old.wav", "--duration", "86400", *CHEAP]
    yield Cell("drone", "SIGHUP", long, 129, how={"signal": signal.SIGHUP, "at": ".old.wav.*"})
    for command in ("fit", "body", "devices", "presets", "plan", "simulate", "sweep", "completion"):
        how = {"signal": signal.SIGHUP, "at": "write"}
        # with its file there already, as whole as it will be
        makes = {"fit": ("new.toml",), "body": ("new.toml",), "simulate": ("out.npz",)}.get(command, ())
        yield Cell(command, "SIGHUP", GOOD[command], 129, makes=makes, how=how)
    yield Cell("author", "SIGHUP", AUTHOR, 0, "http://", how={"signal": signal.SIGHUP})


CELLS = [*_overwriting(), *_full(), *_closed(), *_hung_up(), *_odd(), *_deleted()]
#: cells that there are not
NONE = {
    (
        "author",
        "output is input",
    ): "a document is saved to its own file; saving as another asks first (tests/author/test_files.py)",
    ("devices", "output is input"): "it reads no file and writes none",
    ("presets", "output is input"): "it writes to standard output only, and a shell has emptied a file before it runs",
    ("plan", "output is input"): "it writes to standard output only",
    ("sweep", "output is input"): "it writes to a folder of its own, which is no study's file (tests/test_study.py)",
    ("completion", "output is input"): "it reads no file and writes to standard output only",
    ("completion", "odd names"): "it takes no names",
    ("play", "full disk"): "it needs a sound server: tests/live/test_recorder.py, as the recording goes on without one",
    ("play", "SIGHUP"): "it needs a sound server: tests/live/test_play.py",
    ("devices", "odd names"): "it takes no names",
}


def test_every_cell_of_the_table_is_there_or_has_a_reason() -> None:
    there = {(cell.command, cell.condition) for cell in CELLS}
    assert there.isdisjoint(NONE)
    assert there | set(NONE) == {(command, condition) for command in GOOD for condition in CONDITIONS}


CASE = """
[string]
length_m = 0.65
tension_n = 70.0
linear_density_kg_m = 1e-3
diameter_m = 4e-4
[initial]
shape = "modes"
file = "modes.npz"
q = "q"
[run]
internal_rate_hz = 44100
modes = 5
duration_s = 0.001
outputs_m = [0.1]
"""


STUDY = 'measures = ["peak"]\nbase.case = "tanpura"\ngrid.modes = [5, 6]\n'


@pytest.fixture(scope="module")
def prepared(tmp_path_factory) -> dict[str, Path]:
    """Everything that the table's commands read, and what was there before where they write."""
    folder = tmp_path_factory.mktemp("prepared")
    song = header() + track((0, on(48, 100)), (48, off(48)))
    preset, case = (preset_folder() / "tanpura.toml").read_text(encoding="utf-8") + "# µ\n", CASE
    (folder / "s.mid").write_bytes(song)
    (folder / "long.mid").write_bytes(header(division=1) + track((0, on(48)), (170_000, off(48))))
    (folder / "my.toml").write_text(preset, encoding="utf-8")
    (folder / "case.toml").write_text(case)
    (folder / "study.toml").write_text(STUDY)
    np.savez(folder / "modes.npz", q=np.linspace(1e-4, 1e-5, 5))
    (folder / "t.scl").write_text("twelve\n1\n100.0\n")
    (folder / "t.kbm").write_text("0\n0\n127\n60\n69\n440.0\n1\n")
    time_s = np.arange(11025) / 22050
    n = np.arange(1, 20)[:, None]
    partials = np.exp(-time_s * (3 + n)) * np.sin(2 * np.pi * 110 * n * np.sqrt(1 + 1e-4 * n * n) * time_s) / n
    hz = np.linspace(50.0, 500.0, 200)
    mobility = 1j * hz / (120.0**2 - hz**2 + 4j * hz) + 1j * hz / (310.0**2 - hz**2 + 9j * hz)
    rows = "".join(f"{f:.6g},{y.real:.6g},{y.imag:.6g}\n" for f, y in zip(hz, mobility, strict=True))
    (folder / "bridge.csv").write_text("frequency_hz,y11_re,y11_im\n" + rows)
    soundfile.write(folder / "note.wav", 0.2 * partials.sum(axis=0), 22050)
    for old in ("old.wav", "old.flac", "old.raw", "old.toml", "old.npz"):
        (folder / old).write_bytes(b"from before")
    (folder / "two.mid").write_bytes(b"from before")
    odd = tmp_path_factory.mktemp("odd")
    shutil.copytree(folder, odd, dirs_exist_ok=True)
    for name in ODD.values():
        (odd / f"{name}.mid").write_bytes(song)
        (odd / f"{name}.toml").write_text(preset, encoding="utf-8")
        (odd / ("case-" + f"{name}.toml"[-200:])).write_text(case)
        (odd / ("study-" + f"{name}.toml"[-200:])).write_text(STUDY)
        shutil.copy(folder / "note.wav", odd / ("odd" + f"{name}.wav"[-200:]))
        shutil.copy(folder / "bridge.csv", odd / ("bridge" + f"{name}.csv"[-200:]))
    return {"plain": folder, "odd": odd}


@pytest.fixture(scope="module")
def server(prepared, tmp_path_factory) -> Iterator[ForkServer]:
    env = {**os.environ, **hide_sound_card(), "PYTHONPATH": str(ROOT), "PYTHONIOENCODING": ""}
    warm = [[*arguments] for arguments in (RENDER, DRONE, FIT, BODY, PLAN, SIMULATE, SWEEP)]
    folder = tmp_path_factory.mktemp("warm")
    shutil.copytree(prepared["plain"], folder, dirs_exist_ok=True)
    with ForkServer(env, warm, folder) as running:
        yield running


def contents(folder: Path) -> dict[str, bytes]:
    """All files below, hidden ones too, and directories."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b"a directory" for path in folder.rglob("*")
    }


@pytest.mark.parametrize("cell", CELLS, ids=[f"{cell.command}-{cell}" for cell in CELLS])
def test_the_table(cell: Cell, tmp_path: Path, prepared: dict[str, Path], server: ForkServer) -> None:
    here, where = tmp_path / "here", tmp_path / "where"
    shutil.copytree(prepared["odd" if cell.condition == "odd names" else "plain"], here)
    if cell.link:
        (os.link if cell.hard else os.symlink)(here / cell.link[1] if cell.hard else cell.link[1], here / cell.link[0])
    before = contents(here)
    arguments = [word.replace("HERE", str(here)) for word in cell.arguments]
    how = dict(cell.how)
    meanwhile: Callable[[int], None] | None = None
    with ExitStack() as stack:
        if how.pop("gone", False):
            where.mkdir()
        else:
            where = here
        if cell.command == "author" and (cell.code == 0 or "out" in how or "closed" in how):
            meanwhile = _until_it_serves(tmp_path, how)
        elif "signal" in how:
            meanwhile = _signalled(stack, tmp_path, here, how)
        done = server.run(arguments, where, tmp_path, gone=where is not here, meanwhile=meanwhile, **how)
    _check(cell, done, before, contents(here))


def _until_it_serves(told: Path, how: dict[str, Any]) -> Callable[[int], None]:
    """Ends `synth author` when it has said its address, or once it is there where it can say none."""
    number = how.pop("signal", signal.SIGTERM)

    def end(pid: int) -> None:
        until(lambda: b"http://" in (told / "out").read_bytes() or ended(pid), "the page is served")
        if not ended(pid):
            os.kill(pid, number)

    return end


def _signalled(stack: ExitStack, told: Path, here: Path, how: dict[str, Any]) -> Callable[[int], None]:
    """Sends the signal when the command stands in a write that does not end, or has begun its file."""
    number, at = how.pop("signal"), how.pop("at")
    if at == "write":
        how["out"] = stack.enter_context(full_pipe(told))

    def send(pid: int) -> None:
        until(lambda: ended(pid) or (writes(pid, 1) if at == "write" else any(here.glob(at))), "it has come so far")
        os.kill(pid, number)

    return send


def _check(cell: Cell, done: Done, before: dict[str, bytes], after: dict[str, bytes]) -> None:
    said = done.err.decode("utf-8")
    assert done.code == cell.code, said
    assert "Traceback" not in said and "Exception ignored" not in said
    lines = said.splitlines()
    if cell.code == 2 and "closed" in cell.how and 2 in cell.how["closed"]:
        assert not said and not done.out
    elif cell.code == 2:
        complaints = [line for line in lines if line.startswith("synth: error: ")]
        assert len(complaints) == 1 and lines[-1] == complaints[0], said
        assert re.search(cell.says, complaints[0]), said
    elif cell.code == 0:
        assert re.search(cell.says, done.out.decode("utf-8")), (done.out, said)
        if "--json" in cell.arguments:
            json.loads(done.out)
    assert all(letter.isprintable() or letter == "\n" for letter in said), said
    made = {name: after.pop(name) for name in cell.makes}
    assert after == before
    assert all(made.values())


def test_in_an_interpreter_of_its_own(prepared: dict[str, Path], tmp_path: Path) -> None:
    """What the fork server stands for: a shell starts it with closed streams, one after the other and all of them."""
    shutil.copy(prepared["plain"] / "my.toml", tmp_path)
    env = {**os.environ, "PYTHONPATH": str(ROOT)}

    def shell(text: str) -> subprocess.CompletedProcess[str]:
        command = f"{shlex.quote(sys.executable)} -m synth {text}"
        return subprocess.run(
            ["sh", "-c", command],
            cwd=tmp_path,
            env=env,
            capture_output=True,
            text=True,
            timeout=compiling_s(),
        )

    done = shell("presets check my.toml <&- 2>&-")
    assert (done.returncode, done.stderr) == (0, "") and "is in order" in done.stdout
    done = shell("presets check my.toml >&-")
    assert (done.returncode, done.stderr) == (2, "synth: error: standard output: Bad file descriptor\n")
    done = shell("presets check none.toml <&- >&- 2>&-")
    assert (done.returncode, done.stdout, done.stderr) == (2, "", "")
    done = shell("presets check my.toml > /dev/full")
    assert done.returncode == 2 and done.stderr.startswith("synth: error: standard output: No space left"), done.stderr
