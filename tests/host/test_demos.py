"""The demo songs are what their script makes, and what the presets can play."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from synth.midi.events import NOTE_ON
from synth.midi.song import read_song

DEMOS = Path(__file__).resolve().parents[2] / "presets" / "demos"


@pytest.mark.parametrize("name", ["drone.mid", "bassline.mid"])
def test_the_script_makes_the_files_beside_it(tmp_path, name: str) -> None:
    runpy.run_path(str(DEMOS / "make_demos.py"))["main"](tmp_path)
    assert (tmp_path / name).read_bytes() == (DEMOS / name).read_bytes()


def test_the_drone_is_pa_sa_sa_sa() -> None:
    song = read_song(DEMOS / "drone.mid", 48000)
    plucks = song.events["a"][song.events["kind"] == NOTE_ON]
    assert plucks.tolist() == [43, 48, 48, 36] * 6
    assert song.length_s == pytest.approx(30.0)
    assert not song.warnings


def test_the_bass_line_is_for_a_bass_and_has_accents_and_ghosts() -> None:
    song = read_song(DEMOS / "bassline.mid", 48000)
    played = song.events[song.events["kind"] == NOTE_ON]
    assert list(song.channels) == [(0, 33)]
    assert 28 <= played["a"].min() and played["a"].max() <= 63
    assert played["b"].max() == 127 and played["b"].min() < 40
    assert np.count_nonzero(played["b"] >= 115) >= 16
    assert song.length_s == pytest.approx(19.2)
    assert not song.warnings
