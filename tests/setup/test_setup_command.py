"""`synth setup` as it is typed."""

from __future__ import annotations

import csv
import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from synth.cli import main
from synth.instrument.preset import load_preset
from tests.patience import compiling_s

FEW = ["--string", "G", "--frets", "0-2", "--quality", "draft"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def fault(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """What the command says that cannot be, in one line, with exit code 2 and nothing written."""
    before = sorted(os.listdir())
    try:
        code = main(["setup", *words])
    except SystemExit as end:
        code = int(end.code or 0)
    said = capsys.readouterr().err
    assert code == 2
    assert "Traceback" not in said
    assert sorted(os.listdir()) == before
    return said


def test_a_map_is_printed_and_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pyarrow")
    pytest.importorskip("matplotlib")
    names = ["m.csv", "m.parquet", "m.png", "m.svg", "m.pdf"]
    assert main(["setup", "fretted-bass", *FEW, *(word for name in names for word in ("-o", name))]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^  open  1\.\d\d\* 3$", out, re.MULTILINE)
    assert "3 of 3 notes buzz at this stroke: G open, 1-2" in out
    assert out.splitlines()[-5:] == names
    with open("m.csv", newline="", encoding="utf-8") as file:
        cells = list(csv.DictReader(file))
    import pyarrow.parquet as pq

    table = pq.read_table("m.parquet").to_pylist()
    assert [row["fret"] for row in table] == [0, 1, 2]
    assert [float(row["buzz_mm"]) for row in cells] == [row["buzz_mm"] for row in table]
    assert Path("m.png").read_bytes()[:4] == b"\x89PNG" and Path("m.pdf").read_bytes()[:4] == b"%PDF"
    assert "<svg" in Path("m.svg").read_text("utf-8")


def test_json_has_the_same_numbers(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["setup", "fretted-bass", *FEW, "--json", "--stroke", "95", "--place", "120"]) == 0
    about = json.loads(capsys.readouterr().out)
    assert (about["velocity"], about["complete"], len(about["notes"])) == (95, True, 3)
    assert about["notes"][0]["buzz_low_mm"] < about["notes"][0]["buzz_mm"] < about["notes"][0]["buzz_high_mm"]


def test_settings_change_the_map(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = []
    for action in ("1.5", "2.5"):
        main(["setup", "electric-guitar", "--string", "E2", "--frets", "5", "--json", "--quality", "draft",
              "--set", f"obstacle.action_12th_mm={action}"])  # fmt: skip
        found.append(json.loads(capsys.readouterr().out)["notes"][0]["touch_mm"])
    assert found[0] < found[1]


def test_measured_frets_and_tensions(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _measured(folder)
    Path("heights.csv").write_text("fret,height_thou\n" + "".join(f"{n},{45.2 if n == 7 else 43.3}\n" for n in range(1, 21)))
    words = ["setup", "bass.toml", "--fret-heights", "heights.csv", "--string", "G", "--frets", "6", "--tension"]
    assert main([*words, "--quality", "draft"]) == 0
    out = capsys.readouterr().out
    assert "fret 7 is high: it stands 48 µm above the neck" in out
    assert "string G: 1.14 mm (.045 in), 6.69 g/m, 191 N (42.9 lb)" in out


def _measured(folder: Path) -> None:
    import tomlkit

    from synth.instrument.preset import read_preset

    text = tomlkit.parse(read_preset("fretted-bass"))
    text["obstacle"] = {"kind": "frets", "count": 20}
    text["setup"] = {"action_bass_mm": 2.6, "relief_mm": 0.3}
    (folder / "bass.toml").write_text(tomlkit.dumps(text), "utf-8")


@pytest.mark.slow
def test_a_wish_is_answered_and_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["setup", "electric-guitar", "--want", "no buzz at medium, except open strings may buzz", "--string", "G3"]
    assert main([*words, "--quality", "draft", "-o", "mine.toml"]) == 0
    out = capsys.readouterr().out
    found = re.search(r"--set obstacle\.action_12th_mm=(\S+) --set obstacle\.relief_mm=(\S+)", out)
    assert found is not None and out.splitlines()[-1] == "mine.toml"
    shape = load_preset("mine.toml").obstacle
    assert (shape.action_12th_mm, shape.relief_mm) == (float(found[1]), float(found[2]))
    original = (Path(__file__).parents[2] / "presets" / "electric-guitar.toml").read_text("utf-8").splitlines()
    kept = Path("mine.toml").read_text("utf-8").splitlines()
    assert sum(a != b for a, b in zip(original, kept, strict=True)) == 2  # the comments are there
    assert main([*words, "--quality", "draft", "--json"]) == 0
    about = json.loads(capsys.readouterr().out)
    assert about["settings"] == {"obstacle.action_12th_mm": float(found[1]), "obstacle.relief_mm": float(found[2])}
    assert about["remaining"] == []


@pytest.mark.slow
def test_a_preset_comes_from_a_pipe_and_is_read_once(folder: Path) -> None:
    """`synth setup <(…) --want … -o mine.toml`: there is nothing to read a second time."""
    text = (Path(__file__).parents[2] / "presets" / "electric-guitar.toml").read_bytes()
    ours, theirs = os.pipe()
    words = [sys.executable, "-m", "synth", "setup", f"/dev/fd/{ours}", "--want", "no buzz at soft", "--string", "G3",
             "--quality", "draft", "-o", "mine.toml"]  # fmt: skip
    running = subprocess.Popen(words, pass_fds=[ours], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=folder,
                               env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])})  # fmt: skip
    os.close(ours)
    with os.fdopen(theirs, "wb") as pipe:
        pipe.write(text)
    out, said = running.communicate(timeout=compiling_s())
    assert running.returncode == 0, said
    assert out.splitlines()[-1] == "mine.toml"
    assert load_preset(folder / "mine.toml").name == "electric-guitar"


def test_the_longest_buzz_of_a_bridge(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from synth.setup import longest

    monkeypatch.setattr(longest, "SECONDS", 1.0)
    monkeypatch.setattr(longest, "PARTS", (1.0,))
    monkeypatch.setattr(longest, "JIVA_UM", (3.0, 20.0, 60.0))
    words = ["setup", "tanpura-light", "--want", "longest buzz at soft", "--string", "Sa 1", "-o", "mine.toml"]
    assert main(words) == 0
    out = capsys.readouterr().out
    assert "Sa 1: thread 3 → " in out or ("Sa 1, Sa 2: thread 3 → " in out and "--set obstacle.jiva_um=" in out)
    found = load_preset("mine.toml").obstacle.jiva_um
    assert isinstance(found, float) or (found[48] < 20.0 and found[36] == found[43] == 3.0)  # the others keep theirs


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["nowhere"], "preset 'nowhere' is not one of"),
        (["harp"], "nothing can buzz"),
        (["fretted-bass", "--stroke", "loud"], "must be soft, medium, hard or a velocity of 1 to 127, got 'loud'"),
        (["fretted-bass", "--stroke", "128"], "a velocity of 1 to 127, got '128'"),
        (["fretted-bass", "--frets", "5-2"], "must be LOW-HIGH, such as 0-12, got '5-2'"),
        (["fretted-bass", "--frets", "30-35"], "no string has one of the frets 30 to 35"),
        (["fretted-bass", "--string", "B"], "no string is called 'B'"),
        (["fretted-bass", "--place", "900", *FEW], "place must lie on every string, got 900 mm"),
        (["fretted-bass", "-o", "map.xlsx"], "a map is written as .csv, .parquet, .png, .svg, .pdf, got '.xlsx'"),
        (["fretted-bass", "-o", "map.toml"], "got '.toml'"),
        (["fretted-bass", "--want", "no buzz at medium", "-o", "map.csv"], "a set-up (--want) is written as .toml"),
        (["fretted-bass", "--want", "quiet please"], "must begin with a wish"),
        (["fretted-bass", "--want", "longest buzz at medium"], "obstacle.kind must be bridge for a long buzz, got frets"),
        (
            ["tanpura-light", "--want", "no buzz at medium"],
            "must be frets or board to set an action, got bridge",
        ),
        (["fretted-bass", "--want", "no buzz at medium", "--frets", "0-5"], "--frets is for a map"),
        (["fretted-bass", "--want", "no buzz at medium", "--stroke", "hard"], "--stroke is for a map"),
        (["fretted-bass", "--want", "no buzz at medium, except frets 0-30 may buzz"], "lets every note buzz"),
        (["fretted-bass", "--fret-heights", "none.csv"], "none.csv"),
        (["fretted-bass", "--set", "obstacle.action_12th_mm=-1"], "action_12th_mm"),
        (["fretted-bass", "--set", "tanpura:pluck.position=0.2"], "this command has one preset"),
        (["fretted-bass", "-o", "nowhere/map.csv"], "nowhere"),
    ],
)
def test_what_cannot_be_is_said(folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str) -> None:
    assert said in fault(capsys, *words).replace("\n", " ")


def test_heights_need_a_setup_table(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("heights.csv").write_text("fret,height_mm\n" + "".join(f"{n},1.1\n" for n in range(1, 21)))
    assert "setup.action_bass_mm" in fault(capsys, "fretted-bass", "--fret-heights", "heights.csv")


def test_an_input_is_not_overwritten(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _measured(folder)
    text = Path("bass.toml").read_bytes()
    assert "would overwrite" in fault(capsys, "bass.toml", "--want", "no buzz at soft", "-o", "bass.toml")
    assert Path("bass.toml").read_bytes() == text


@pytest.mark.slow
def test_ctrl_c_keeps_what_was_computed(folder: Path) -> None:
    """A real process on a terminal: interrupted once some notes are done, it prints and writes these."""
    terminal, side = pty.openpty()
    words = [sys.executable, "-m", "synth", "setup", "fretted-bass", "--quality", "fine", "--threads", "1", "-o", "m.csv"]
    running = subprocess.Popen(words, stderr=side, stdout=subprocess.PIPE, text=True, cwd=folder,
                               env=os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])})  # fmt: skip
    os.close(side)
    shown, until = "", time.monotonic() + 60.0 + compiling_s()
    while time.monotonic() < until and not re.search(r"[2-9] of 84 notes", shown):
        shown += os.read(terminal, 4096).decode("utf-8", "replace")
    running.send_signal(signal.SIGINT)
    out, _ = running.communicate(timeout=120)
    os.close(terminal)
    assert running.returncode == 130
    with open(folder / "m.csv", newline="", encoding="utf-8") as file:
        kept = list(csv.DictReader(file))
    assert 1 <= len(kept) < 84
    assert kept[0]["string"] == "E" and kept[0]["buzz_mm"]
    assert f"{len(kept)} notes" in out or f"of {len(kept)} notes buzz" in out
