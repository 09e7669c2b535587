"""`synth fit`: what it shows, what it writes, and where it must not."""

import json
import math
import os
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import soundfile

from synth import cli
from synth.instrument.preset import load_preset, parse_preset
from synth.units import hz_to_midi, note_to_midi
from tests.fit.strings import render, steel
from tests.patience import compiling_s


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("fit") / "a.wav"
    soundfile.write(path, render(steel(98.3, 2e-4), np.random.default_rng(9)), 44100, subtype="PCM_24")
    return str(path)


def test_the_command_writes_a_preset_with_its_comments(capsys, tmp_path, recording: str) -> None:
    target = tmp_path / "new.toml"
    assert cli.main(["fit", recording, "-p", "fretted-bass", "--string", "A", "-o", str(target)]) == 0
    told = capsys.readouterr().out
    assert "98.31 Hz, G2" in told and "Inharmonicity B" in told and f"written: {target}" in told
    text = target.read_text()
    assert "# A string maker's light long-scale set" in text and "# IA2018 figure 6" in text
    preset = load_preset(str(target))
    assert preset.name == "new"
    assert preset.string[1].name == "A" and preset.string[1].notes == (note_to_midi("G2"),) * 2
    assert preset.string[1].cents == pytest.approx(100.0 * (hz_to_midi(98.3 * math.sqrt(1 + 2e-4)) - 43), abs=0.1)
    assert preset.string[0] == load_preset("fretted-bass").string[0]
    assert [path.name for path in tmp_path.iterdir()] == ["new.toml"]


def test_the_command_as_json_and_without_a_preset(capsys, recording: str) -> None:
    assert cli.main(["fit", recording, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["settings"] == [] and told["inharmonicity"] == pytest.approx(2e-4, rel=0.05)
    assert cli.main(["fit", recording, "--json", "-p", "tanpura-light", "--string", "3"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert {"path": "string.3.notes", "value": "G2"} in told["settings"]


def test_wrong_input_is_one_line(capsys, tmp_path, recording: str) -> None:
    soundfile.write(tmp_path / "silent.wav", np.zeros(44100), 44100)
    (tmp_path / "text.wav").write_text("no sound")
    target = str(tmp_path / "new.toml")
    for arguments, reason in (
        ([str(tmp_path / "silent.wav")], "silent.wav: the recording is silent"),
        ([str(tmp_path / "text.wav")], "text.wav: cannot be read"),
        ([str(tmp_path / "none.wav")], "none.wav: there is no such file"),
        ([str(tmp_path)], "is a directory; give a recording in it"),
        (["/dev/zero"], "/dev/zero: is a device or a pipe"),
        ([recording, "-o", target], "name it with -p"),
        ([recording, "--string", "1"], "--string 1 selects a string of a preset: name it with -p"),
        ([recording, "-p", "tanpura-light", "-o", str(tmp_path / "new.wav")], "-o must be a preset's file, ending in .toml"),
        ([recording, "-p", "tanpura-light", "--string", "9"], "--string must be one of 0 (Pa), 1 (Sa 1)"),
        ([recording, "-p", "nothing"], "preset 'nothing' is not one of"),
        ([str(tmp_path / "silent.wav"), "-p", "tanpura-light", "-o", target], "is silent"),
        ([recording, "-p", "tanpura-light", "-o", str(tmp_path / "no" / "new.toml")], "there is no directory"),
    ):
        assert cli.main(["fit", *arguments]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1 and reason in lines[0], lines
    assert not (tmp_path / "new.toml").exists()


def test_neither_the_recording_nor_a_device_is_replaced(capsys, tmp_path, recording: str) -> None:
    """Also not where the recording has a preset's suffix or another name: a link. A pipe stays one."""
    linked, named = tmp_path / "link.toml", tmp_path / "named.toml"
    linked.symlink_to(recording)
    named.write_bytes(Path(recording).read_bytes())
    before = Path(recording).read_bytes()
    for source, target in ((recording, recording), (recording, str(linked)), (str(named), str(named))):
        assert cli.main(["fit", source, "-p", "tanpura-light", "-o", target]) == 2
        assert capsys.readouterr().err.strip().endswith("which is an input: give the output another name")
    assert Path(recording).read_bytes() == named.read_bytes() == before and linked.is_symlink()

    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with ThreadPoolExecutor() as pool:
        read = pool.submit(pipe.read_text)
        assert cli.main(["fit", recording, "-p", "fretted-bass", "--string", "A", "-o", str(pipe)]) == 0
        text = read.result(60)
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert parse_preset(text, "pipe").string[1].notes == (note_to_midi("G2"),) * 2


def test_without_scipy_the_command_says_what_to_install(recording: str) -> None:
    """In an interpreter that cannot import it."""
    script = (
        "import importlib.util, sys\n"
        "found = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda name, *more: None if name == 'scipy' else found(name, *more)\n"
        "sys.modules['scipy'] = None\n"
        "from synth import cli\n"
        f"sys.exit(cli.main(['fit', {recording!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=compiling_s())
    assert done.returncode == 2
    assert done.stderr.splitlines() == ["synth: error: a fit needs scipy: pip install 'jawari[fit]'"]


def test_huge_samples_and_files_are_refused_without_a_word_of_numpy(capsys, tmp_path) -> None:
    soundfile.write(tmp_path / "huge.wav", np.full(44100, 1e300), 44100, subtype="DOUBLE")
    soundfile.write(tmp_path / "many.wav", np.zeros((40000, 1000)), 8000, subtype="PCM_U8")
    for name, reason in (("huge.wav", "must lie within ±1e+06"), ("many.wav", "must hold at most 30000000 numbers")):
        assert cli.main(["fit", str(tmp_path / name)]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1 and f"{name}: " in lines[0] and reason in lines[0], lines
