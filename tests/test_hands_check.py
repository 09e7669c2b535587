"""tools/hands-check: what it plays, says and fails on."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from synth.instrument.preset import load_preset
from synth.midi.events import BEND, CONTROL, NOTE_ON

TOOL = Path(__file__).resolve().parents[1] / "tools" / "hands-check"


@pytest.fixture(scope="module")
def tool() -> ModuleType:
    loader = importlib.machinery.SourceFileLoader("hands_check", str(TOOL))
    spec = importlib.util.spec_from_loader("hands_check", loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["hands_check"] = module
    loader.exec_module(module)
    return module


def test_the_wheels_move_over_notes_that_are_held(tool: ModuleType) -> None:
    """The modulation wheel stays up for more than a second over four notes; the bend wheel sweeps over four."""
    rows, parts, length = tool.events_of(load_preset("nylon-guitar"), 0.5)
    begun = {name: round(at * tool.RATE_HZ) for at, name in parts}
    assert {"normal", "slurs", "wheel up", "bend sweeps"} <= set(begun) and begun["bend sweeps"] < length * tool.RATE_HZ
    wheel = [row[0] for row in rows if row[1] == CONTROL and row[3] == 1 and row[0] >= begun["wheel up"]]
    assert wheel[0] == begun["wheel up"] and wheel[1] - wheel[0] > tool.RATE_HZ
    assert len({row[3] for row in rows if row[1] == NOTE_ON and wheel[0] < row[0] < wheel[1]}) == 4
    swept = [row[3] for row in rows if row[1] == BEND and row[0] >= begun["bend sweeps"]]
    assert min(swept) < -7900 and max(swept) > 7900 and len(swept) > 250


def test_what_is_found_is_printed_and_written(tmp_path: Path) -> None:
    words = [
        sys.executable,
        str(TOOL),
        "spinet",
        "--seconds",
        "0.3",
        "--rounds",
        "2",
        "--json",
        str(tmp_path / "found.json"),
    ]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "| spinet | 1 | 0 |" in done.stdout and "worst block of 64 frames, half of its time or more:" in done.stdout
    told = json.loads((tmp_path / "found.json").read_text())
    (found,) = told["presets"]
    assert (told["block"], told["rounds"], found["preset"]) == (64, 2, "spinet")
    assert 0.0 < found["median"] <= found["worst"] and found["worst_over_median"] == found["worst"] / found["median"]


@pytest.mark.parametrize("wrong", [{"clicks": [(0.5, 4.0)]}, {"silenced": 1}, {"finite": False}])
def test_a_click_a_silenced_string_or_no_number_is_no_success(tool: ModuleType, wrong: dict) -> None:
    fine = dict(
        preset="a", articulations=1, clicks=[], collisions=0, steps_found=1, steps=1, sharp=0, strokes=1, peak_db=0.0,
        finite=True, silenced=0, times_real_time=1.0, median=0.1, worst=2.0, worst_at_s=0.0, worst_in="normal",
    )  # fmt: skip
    assert tool.Checked(**fine).good and not tool.Checked(**(fine | wrong)).good


def test_a_string_on_its_fingerboard_is_a_collision_and_a_step_of_the_engine_a_click(tool: ModuleType) -> None:
    """The collision is one that `fine` has, too; a step put in elsewhere is not, nor what is sharp as a key goes down."""
    preset = load_preset("flatwound-fretless")
    rows, _, _ = tool.events_of(preset, 0.8)
    rows = [row for row in rows if row[0] < 1.7 * tool.RATE_HZ]
    sound, _, _ = tool.play(preset, rows, 1.7, 128, 1)
    heard = tool.outside(tool.strokes_of(preset, rows), tool.clicks(sound, tool.RATE_HZ))
    heard = [each for each in heard if not any(abs(each[0] - row[0]) <= tool.AFTER_KEY_S * tool.RATE_HZ for row in rows)]
    assert heard
    put_in, at_key = (round(1.3 * tool.RATE_HZ), 9.0), (rows[-1][0], 9.0)
    assert tool.collisions_of(preset, rows, 128, sorted([*heard, put_in, at_key])) == heard
