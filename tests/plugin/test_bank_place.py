"""Where a plugin's bank comes from: the file that its code was loaded from, whatever else a host, its environment, its
working directory or a song name."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from synth.plugin.bankfile import HEADER, bank
from synth.plugin.library import with_bank
from tests.patience import compiling_s

from . import songs

ROOT = Path(__file__).resolve().parents[2]
RATE_HZ = 44100.0

#: a host of one format; its arguments: format, the plugin, a folder of others, a state of another. It prints which files it
#: has mapped
HOST = """
import json, sys
from pathlib import Path
from synth.plugin.description import describe
from tests.plugin import claphost, lv2host, songs, vst3host
kind, plugin, others, state = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), Path(sys.argv[4]).read_bytes()
if kind == "clap":
    other = str(others / plugin.name).encode()
    assert claphost.Entry.in_dll(claphost.c.CDLL(str(plugin)), "clap_entry").init(other)
    made = claphost.Host(plugin).instance()
    assert made.activate(44100.0)
    made.load(state)
elif kind == "vst3":
    made = vst3host.Instance(vst3host.Factory(plugin))
    made.start(44100.0)
    made.load(state)
else:
    about = describe(songs.PRESETS)
    defaults = [*(each.default for each in (*about.parameters, *about.setup)), 0.0]
    made = lv2host.Instance(plugin, 44100.0, defaults, bundle=others)
    made.restore(state)
print(json.dumps(sorted({line.split(maxsplit=5)[5] for line in open("/proc/self/maps").read().splitlines() if "/" in line})))
"""
SAVE = """
import sys
from pathlib import Path
from tests.plugin import claphost
made = claphost.Host(sys.argv[1]).instance()
assert made.activate(44100.0)
Path(sys.argv[2]).write_bytes(made.save())
"""
#: two formats of one export in one process, whose first name is replaced or goes before the second one is used
TWO_NAMES = """
import sys
from pathlib import Path
from tests.plugin.native import Library
first, second, other, there = map(Path, sys.argv[1:])
Library(first).open_own_bank().close()
if other.name == "gone":
    first.unlink()
else:
    other.rename(first)
loaded = Library(second)
mine = loaded.open_own_bank()
print(loaded.preset_of(mine.address, 0).contents.id.decode())
"""


def run(program: str, *arguments: object, folder: Path, **environment: str) -> str:
    command = [sys.executable, "-c", textwrap.dedent(program), *map(str, arguments)]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "JAWARI_PYTHON": "0", **environment}
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=env, timeout=compiling_s(), check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def others(library_file: Path, tmp_path_factory) -> Path:
    """A folder of banks and plugins of the same name and presets with another sound, and a state of such a plugin."""
    folder = tmp_path_factory.mktemp("others")
    data = bank(songs.PRESETS, [RATE_HZ], note_hz=[440.0 * 2 ** ((key - 70) / 12) for key in range(128)])
    name = bank_name(data)
    for each in (f"{name}.jawari", "bank", "bank.jawari", "libjawari.jawari"):
        (folder / each).write_bytes(data)
    whole = with_bank(library_file, data)
    for each in (f"{name}.clap", f"{name}.so", "libjawari.so"):
        (folder / each).write_bytes(whole)
    run(SAVE, folder / f"{name}.clap", folder / "state", folder=folder)
    return folder


def bank_name(data: bytes) -> str:
    return np.frombuffer(data, HEADER, 1)[0]["id"].decode()


@pytest.mark.parametrize("kind", ["clap", "vst3", "lv2"])
@pytest.mark.parametrize("linked", [False, True])
def test_only_the_bank_behind_its_own_code_is_opened(kind: str, linked: bool, exported: Path, others: Path, tmp_path: Path):
    """linked: it is loaded by a symbolic link that lies among the others."""
    folder = tmp_path / "bundle"
    folder.mkdir()
    plugin = folder / exported.name
    plugin.write_bytes(exported.read_bytes())
    for each in others.iterdir():  # beside the plugin too
        if each.suffix == ".jawari":
            (folder / each.name).write_bytes(each.read_bytes())
    name = plugin
    if linked:
        (tmp_path / "link").mkdir()
        for each in others.iterdir():
            (tmp_path / "link" / each.name).symlink_to(each)
        name = tmp_path / "link" / "by-another-name.so"
        name.symlink_to(plugin)
    named = {key: str(others) for key in ("CLAP_PATH", "VST3_PATH", "LV2_PATH", "XDG_CACHE_HOME", "JAWARI_BANKS")}
    named |= {key: str(others / "bank.jawari") for key in ("JAWARI_BANK", "JAWARI_LIBRARY")}
    mapped = json.loads(run(HOST, kind, name, others, others / "state", folder=others, **named))
    assert [each for each in mapped if each.startswith((str(tmp_path), str(others)))] == [str(plugin)]


@pytest.mark.parametrize("first", ["gone", "replaced"])
def test_formats_of_one_export_do_not_depend_on_each_other(first: str, library_file: Path, bank_files, tmp_path: Path):
    """The system loads a file with two names once: its first name may then be another's, or nobody's."""
    one, two, other = tmp_path / "x.clap", tmp_path / "x.so", tmp_path / first
    one.write_bytes(with_bank(library_file, bank_files["tanpura-light"].read_bytes()))
    os.link(one, two)
    if first == "replaced":
        other.write_bytes(with_bank(library_file, bank_files["fretted-bass"].read_bytes()))
    assert run(TWO_NAMES, one, two, other, tmp_path, folder=tmp_path) == "tanpura-light\n"
