"""The pages of docs/extending as programs: their files written out and their commands run.

A fenced block whose opening line names a file is that file; blocks of one name are its pieces, in order:

    ```python title="tremolo.py"

A block marked `sh` without a name is what to type, a command a line, after settings of the environment (NAME=value).
`synth` and `python` are those of this checkout.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import mido

REPOSITORY = Path(__file__).resolve().parents[2]
FOLDER = REPOSITORY / "docs" / "extending"
_BLOCK = re.compile(r"^```(\w+)(?:[ \t]+title=\"([^\"\n]+)\")?[ \t]*\n(.*?)^```[ \t]*$", re.MULTILINE | re.DOTALL)


def files_of(text: str) -> dict[str, str]:
    """Name and content of the files on a page, in their order."""
    found: dict[str, str] = {}
    for _, name, content in _BLOCK.findall(text):
        if name:
            found[name] = found.get(name, "") + content
    return found


def commands_of(text: str) -> list[str]:
    """What a page says to type, in its order."""
    return [
        line for kind, name, content in _BLOCK.findall(text) if kind == "sh" and not name for line in content.splitlines()
    ]


def write_files(page: str, folder: Path) -> list[Path]:
    """Write the files of docs/extending/`page`.md into a folder. Raises FileNotFoundError for a page that there is not."""
    written = []
    for name, content in files_of((FOLDER / f"{page}.md").read_text(encoding="utf-8")).items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")
        written.append(path)
    return written


def type_commands(page: str, folder: Path) -> list[str]:
    """Run what docs/extending/`page`.md says to type, there; what each command printed. Fails with the first that fails."""
    return [run(folder, *shlex.split(line)) for line in commands_of((FOLDER / f"{page}.md").read_text(encoding="utf-8"))]


def run(folder: Path, *command: str) -> str:
    """What a command printed that ran in `folder`, in a process of its own that finds this package and the folder's modules.

    Kernels are kept where those of the tests are, so that the engine's need not be compiled again.
    """
    words = list(command)
    settings = {}
    while "=" in words[0]:
        name, _, settings[name] = words.pop(0).partition("=")
    if words[0] == "synth":
        words[:1] = [sys.executable, "-m", "synth"]
    elif words[0] == "python":
        words[0] = sys.executable
    path = os.pathsep.join(filter(None, [str(folder), str(REPOSITORY), os.environ.get("PYTHONPATH", "")]))
    environment = {**os.environ, **settings, "PYTHONPATH": path}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"{shlex.join(command)} ended with {done.returncode}:\n{done.stdout}{done.stderr}"
    return done.stdout


def install(folder: Path) -> None:
    """What an installation of the page's project would leave for `importlib.metadata`."""
    project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
    info = folder / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    lines = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
        for group, entries in project["entry-points"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(lines))


def song(path: Path) -> None:
    """A MIDI file with a note of half a second, D3."""
    made = mido.MidiFile(ticks_per_beat=480)
    made.tracks.append(mido.MidiTrack())
    made.tracks[0].append(mido.Message("note_on", note=50, velocity=100, time=0))
    made.tracks[0].append(mido.Message("note_off", note=50, time=480))
    made.save(path)
