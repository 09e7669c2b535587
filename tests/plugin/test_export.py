"""`synth export`: what it writes, what it refuses, and what is there when it is ended."""

from __future__ import annotations

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from synth.instrument.preset import preset_folder
from synth.plugin import bundle
from synth.plugin.description import describe
from synth.plugin.library import FOOT
from tests.patience import compiling_s, until

from .native import Library

#: cheap: one rate, few modes
CHEAP = ["--rates", "44100", "--quality", "draft"]
#: `synth` of an installation that has the presets of a folder, the first argument
WITH_PRESETS = """
import sys
from pathlib import Path
from synth.instrument import preset
folder = Path(sys.argv.pop(1))
preset.preset_folder = lambda: folder
from synth.cli import main
sys.exit(main())
"""


class Export:
    """`synth export` in a folder of its own, with the library of this folder's tests."""

    def __init__(self, library_file: Path, folder: Path) -> None:
        self.folder = folder
        self.env = {**os.environ, "JAWARI_NATIVE": str(library_file), "HOME": str(folder / "home")}
        (folder / "home").mkdir()

    def start(self, *arguments: str, presets: Path | None = None, **more) -> subprocess.Popen[str]:
        """presets: the folder of those that come with the program, where they are to be others."""
        program = ["-m", "synth"] if presets is None else ["-c", WITH_PRESETS, str(presets)]
        command = [sys.executable, *program, "export", *arguments]
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE} | more
        return subprocess.Popen(command, cwd=self.folder, env=self.env, text=True, **pipes)

    def __call__(self, *arguments: str, code: int = 0, **more) -> str:
        """Standard output; with another exit code than 0, the one line on standard error."""
        running = self.start(*arguments, **more)
        out, err = running.communicate(timeout=compiling_s())
        assert running.returncode == code, err
        if code:
            assert err.startswith("synth: error: ") and err.count("\n") == 1, err
        return err if code else out

    def files(self) -> dict[str, bytes]:
        found = (path for path in sorted(self.folder.rglob("*")) if path.is_file())
        return {str(path.relative_to(self.folder)): path.read_bytes() for path in found}


@pytest.fixture
def export(library_file, tmp_path) -> Export:
    folder = tmp_path / "here"
    folder.mkdir()
    return Export(library_file, folder)


def presets_in(plugin: Path) -> list[str]:
    native = Library(plugin)
    bank = native.open_own_bank()
    return [native.preset_of(bank.address, k).contents.id.decode() for k in range(native.presets(bank.address))]


def test_all_formats_are_one_library_and_what_each_wants_beside_it(export: Export) -> None:
    told = json.loads(export("tanpura-light", "-f", "all", "--json", *CHEAP))
    files = export.files()
    assert set(files) == {
        "tanpura-light.clap",
        "tanpura-light.vst3/Contents/x86_64-linux/tanpura-light.so",
        "tanpura-light.lv2/tanpura-light.so",
        "tanpura-light.lv2/manifest.ttl",
        "tanpura-light.lv2/tanpura-light.ttl",
    }
    whole = files["tanpura-light.clap"]
    assert whole.endswith(FOOT) and whole == files["tanpura-light.lv2/tanpura-light.so"]
    assert whole == files["tanpura-light.vst3/Contents/x86_64-linux/tanpura-light.so"]
    assert len(whole) == told["library_bytes"]["linux-x86-64"] + told["bank_bytes"]
    assert told["presets"] == ["tanpura-light"] and told["rates_hz"] == [44100] and told["bits"] == "fast"
    assert told["paths"] == {"linux-x86-64": {kind: f"tanpura-light.{kind}" for kind in ("clap", "vst3", "lv2")}}
    assert os.access(export.folder / "tanpura-light.clap", os.X_OK)


@pytest.mark.parametrize("arguments", [["--install"], ["-f", "all"]])
def test_all_formats_of_an_export_take_the_room_of_one(arguments: list[str], export: Export) -> None:
    told = json.loads(export("tanpura-light", *arguments, "--json", *CHEAP))
    files = [path for path in export.folder.rglob("*") if path.is_file()]
    held = {(about.st_dev, about.st_ino): about.st_size for about in (path.stat() for path in files)}
    one = told["library_bytes"]["linux-x86-64"] + told["bank_bytes"]
    assert one <= sum(held.values()) < 1.1 * one and len(files) == 5


def test_another_export_of_one_format_leaves_the_others(export: Export) -> None:
    export("tanpura-light", "-f", "all", *CHEAP)
    before = export.files()
    for kind, name in [
        ("clap", "tanpura-light.clap"),
        ("vst3", "tanpura-light.vst3/Contents/x86_64-linux/tanpura-light.so"),
    ]:
        export("tanpura-light", "-f", kind, "--set", "pluck.position=0.31", *CHEAP)
        after = export.files()
        assert {each for each in before if after[each] != before[each]} == {name}
        before = after
    (export.folder / "tanpura-light.clap").unlink()
    assert presets_in(export.folder / "tanpura-light.lv2" / "tanpura-light.so") == ["tanpura-light"]


def test_several_presets_are_programs_of_one_plugin(export: Export, tmp_path: Path) -> None:
    """`--all` takes every file of the folder; four kinds of instruments stand for all that come with the program."""
    names = ["fretless-bass", "jawari-harp", "sitar", "steel-guitar"]
    folder = tmp_path / "presets"
    folder.mkdir()
    for name in names:
        shutil.copy(preset_folder() / f"{name}.toml", folder)
    out = export("--all", "--name", "all-of-them", "-f", "clap", *CHEAP, presets=folder)
    assert out.startswith("all-of-them: ") and "all-of-them.clap" in out
    assert sorted(presets_in(export.folder / "all-of-them.clap")) == names


def test_a_preset_of_ones_own_with_settings_replaces_what_was_there(export: Export) -> None:
    text = (
        (preset_folder() / "tanpura-light.toml")
        .read_text(encoding="utf-8")
        .replace('name = "tanpura-light"', 'name = "mine"')
    )
    (export.folder / "mine.toml").write_text(text, encoding="utf-8")
    export("mine.toml", "-o", "mine.lv2", *CHEAP)
    first = export.files()
    export("mine.toml", "-o", "mine.lv2", "--set", "pluck.position=0.31", *CHEAP)
    second = export.files()
    assert set(first) == set(second) and first["mine.lv2/mine.so"] != second["mine.lv2/mine.so"]


def test_installed_it_lies_where_hosts_look(export: Export) -> None:
    export("tanpura-light", "--install", *CHEAP)
    assert {name.split("/")[1] for name in export.files()} == {".clap", ".vst3", ".lv2"}


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "give a preset to export, or --all"),
        (["tanpura-light"], "the format of the plugin is missing: give --format"),
        (["tanpura-light", "-o", "tanpura.wav"], "the format of -o is missing: give --format"),
        (["tanpura-light", "--all", "-f", "clap"], "--all exports all built-in presets"),
        (["tanpura-light", "--install", "-o", "x.clap"], "--install chooses the folder itself"),
        (["tanpura-light", "-f", "vst3", "-o", "x.clap"], "is named as clap, but --format is vst3"),
        (["tanpura-light", "-f", "all", "-o", "x.clap"], "a name without extension"),
        (["tanpura-light", "-f", "clap", "--rates", "44100,many"], "--rates: must be sample rates from 8000 to 384000 Hz"),
        (["tanpura-light", "-f", "clap", "--name", "My Tanpura"], "lower-case letters, digits and hyphens"),
        (["tanpura-light", "-f", "clap", "-o", "nowhere/x.clap"], "there is no directory nowhere"),
        (["sitarr", "-f", "clap"], "preset 'sitarr' is not one of"),
        (["broken.toml", "-f", "clap"], "broken.toml"),
        (["mine.toml", "-f", "clap", "-o", "mine.toml"], "would overwrite preset mine.toml"),
        (
            ["tanpura-light", "-f", "lv2", "-o", "others"],
            "others: holds song.mid, which does not belong to a plugin of this program",
        ),
        (["tanpura-light", "-f", "vst3", "-o", "mine.toml"], "is a file, and a plugin of the format vst3 is a folder"),
        (["tanpura-light", "-f", "clap", "-o", "others"], "others: is a directory"),
        (["tanpura-light", "-f", "clap", "--tuning", "none.scl"], "none.scl"),
        (["tanpura-light", "tanpura-light", "mine.toml", "-f", "clap"], "two of the presets are called 'tanpura-light'"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_is_written(export: Export, arguments: list[str], says: str) -> None:
    text = (preset_folder() / "tanpura-light.toml").read_text(encoding="utf-8")
    (export.folder / "mine.toml").write_text(text, encoding="utf-8")
    (export.folder / "broken.toml").write_text("format = 2\nname = ", encoding="utf-8")
    (export.folder / "others").mkdir()
    (export.folder / "others" / "song.mid").write_bytes(b"mine")
    before = export.files()
    assert says in export(*arguments, code=2)
    assert export.files() == before


@pytest.mark.parametrize("kind", ["clap", "lv2"])
def test_a_disk_that_is_full_leaves_what_was_there(export: Export, kind: str) -> None:
    export("tanpura-light", "-o", f"t.{kind}", *CHEAP)
    before = export.files()
    said = export(
        "fretted-bass",
        "-o",
        f"t.{kind}",
        *CHEAP,
        code=2,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.RLIM_INFINITY)),
    )
    assert f"t.{kind}" in said and "File too large" in said
    assert export.files() == before


def test_interrupted_it_leaves_what_was_there(export: Export) -> None:
    (export.folder / "all.clap").write_bytes(b"from before")
    before = export.files()
    running = export.start("--all", "-o", "all.clap")  # four rates
    maps = Path(f"/proc/{running.pid}/maps")
    until(lambda: "libjawari" in maps.read_text())  # the engine is being prepared
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=compiling_s())
    assert (running.returncode, out, err) == (130, "", "synth: interrupted\n")
    assert export.files() == before


def test_names_of_any_letters(export: Export) -> None:
    odd = "ṭāṇpūrā 弦"
    export("tanpura-light", "-o", f"{odd}.vst3", *CHEAP)
    assert set(export.files()) == {f"{odd}.vst3/Contents/x86_64-linux/{odd}.so"}
    export("tanpura-light", "-o", f"{odd}.lv2", *CHEAP)
    assert {f"{odd}.lv2/{name}" for name in ("manifest.ttl", "tanpura-light.ttl", "tanpura-light.so")} < set(export.files())


def test_where_plugins_are_not_made_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.machine", lambda: "arm64")
    monkeypatch.setattr("platform.system", lambda: "Darwin")
    monkeypatch.setattr("sys.platform", "darwin")
    with pytest.raises(ValueError, match="only on Linux, and this is Darwin on arm64"):
        bundle.require_system()


def test_a_plugin_needs_a_preset() -> None:
    with pytest.raises(ValueError, match="1 to 128 presets, got 0"):
        describe([])
