"""The frets' fit: the model's geometry, one answer from sound to preset, a bound, and what is refused."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile

from synth import cli
from synth.fit import fret_fit, fret_linear, fret_search
from synth.fit.contact_space import Unknown
from synth.fit.fret_fit import OutOfReach, fit_frets
from synth.fit.fret_model import FREE_MM, RATE_HZ, FretHand, FretModel, action_mm, action_settings, with_action
from synth.fit.recording import FitCancelled, FitRefused
from synth.instrument.preset import load_preset

ACTION = 2.2
HAND = FretHand(0.26, 1.3e-3, 8.5e-3)
#: over frets of 2.2 mm this hand touches from 2.5 mm on
AMPLITUDES = (1.4, 2.25, 2.65, 3.0)
PLACE = ["--pluck-at", "0.26"]


def recorded(model: FretModel, amplitude_mm: float, seed: int, action: float = ACTION) -> np.ndarray:
    x = model.sound(action, amplitude_mm, HAND, 1.5, "fine")
    x = np.concatenate([np.zeros(13000), 0.5 * x / np.abs(x).max()])
    noise = 1e-2 * np.sqrt(np.mean(x**2))
    return x + noise * np.random.default_rng(seed).standard_normal(x.size)


@pytest.fixture(scope="module")
def model() -> FretModel:
    return FretModel(load_preset("fretted-bass"), 3)


@pytest.fixture(scope="module")
def recordings(model: FretModel) -> list[tuple[np.ndarray, int]]:
    return [(recorded(model, each, i), RATE_HZ) for i, each in enumerate(AMPLITUDES)]


def once(search: Callable, found: dict[tuple, object]) -> Callable:
    """A search whose answer is found once for a sound and an amplitude: several tests begin with the same strokes."""

    def searched(model, heard, amplitude_mm, *more):
        key = search, heard.level_db.tobytes(), amplitude_mm
        if key not in found:
            found[key] = search(model, heard, amplitude_mm, *more)
        return found[key]

    return searched


@pytest.fixture(scope="module")
def answers() -> dict[tuple, object]:
    """What `once` has found."""
    return {}


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, answers: dict[tuple, object]) -> None:
    """The hand's neighbourhood stands for the search of it; the action is searched as it is, with fewer notes."""
    for search in (fret_linear.first_linear, fret_linear.next_linear):
        monkeypatch.setattr(fret_fit, search.__name__, once(search, answers))
    monkeypatch.setattr(fret_linear, "_combs", lambda *_: [(0.26, 1.3e-3)])
    monkeypatch.setattr(fret_linear, "_DRAWS", 30)
    monkeypatch.setattr(fret_linear, "_FINAL", 60)
    monkeypatch.setattr(fret_search, "_DICTIONARY", 64)
    monkeypatch.setattr(fret_search, "_STARTS", 1)
    monkeypatch.setattr(fret_search, "_NOTES", 40)
    monkeypatch.setattr(fret_search, "_LAST", 40)

    def near(stroke: fret_search.Touching, hand: FretHand) -> tuple[Unknown, ...]:
        slip, draw = Unknown("slip", 1.15e-3, 1.5e-3), Unknown("draw", 8.3e-3, 8.8e-3)
        return Unknown("action", stroke.low_mm, stroke.high_mm), slip, draw

    monkeypatch.setattr(fret_search, "unknowns_of", near)


def test_an_action_of_heights_is_that_of_a_raised_saddle() -> None:
    preset = load_preset("fretted-bass")
    assert action_mm(preset) == 2.33
    before, after = np.array(preset.obstacle.heights_mm), np.array(with_action(preset, 2.0).obstacle.heights_mm)
    x = 1.0 - 2.0 ** (-np.arange(1, 21) / 12.0)
    assert after - before == pytest.approx(0.33 * x / 0.5)
    [(path, heights)] = action_settings(preset, 2.0)
    assert path == "obstacle.heights_mm" and heights[11] == -2.0


def test_an_action_of_its_own_is_set() -> None:
    preset = load_preset("electric-guitar")
    assert action_mm(preset) == 1.7
    assert action_settings(preset, 1.5) == [("obstacle.action_12th_mm", 1.5)]
    with pytest.raises(ValueError, match="must be frets, got bridge"):
        action_mm(load_preset("tanpura-light"))


def test_what_is_reached_grows_with_the_amplitude(model: FretModel) -> None:
    assert not model.touches(ACTION, 2.25, HAND) and model.touches(ACTION, 2.65, HAND)
    soft, loud = (model.reached_mm(each, HAND, 0.02, 9.0) for each in (2.25, 2.65))
    assert soft < ACTION < loud
    free, same = (model.sound(each, 2.0, HAND, 0.3) for each in (FREE_MM, ACTION))
    assert np.abs(free - same).max() < 2e-3 * np.abs(free).max()


def test_two_strokes_that_touch_tell_the_action(quick: None, capsys, tmp_path: Path, recordings) -> None:
    """From files to the preset; amplitudes of any order belong to their recordings."""
    chosen = [3, 0, 2]
    paths = [str(tmp_path / f"{i}.wav") for i in chosen]
    for path, i in zip(paths, chosen, strict=True):
        soundfile.write(path, recordings[i][0], RATE_HZ, subtype="DOUBLE")
    amplitudes = [word for i in chosen for word in ("--amplitude", str(AMPLITUDES[i]))]
    target = tmp_path / "mine.toml"
    arguments = ["fit", "--contact", "--experimental", *paths, "-p", "fretted-bass", "--string", "G", *PLACE, *amplitudes]
    assert cli.main([*arguments, "-o", str(target), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    found = told["action_mm"]
    assert found["value"] == pytest.approx(ACTION, abs=0.05)
    assert found["low"] <= ACTION <= found["high"] and found["counted_at_fret"] == 12
    assert told["bracket_mm"][0] < ACTION < told["bracket_mm"][1]
    assert [each["touches"] for each in told["strokes"]] == [True, False, True]
    assert told["mm_for_each_percent_of_amplitude"] == pytest.approx(0.03, abs=0.015)
    assert action_mm(load_preset(str(target))) == pytest.approx(found["value"], abs=1e-3)


def test_where_nothing_touches_there_is_a_bound(quick: None, recordings) -> None:
    with pytest.raises(OutOfReach, match=r"no stroke touches a fret.*strike harder") as refused:
        fit_frets(recordings[:2], load_preset("fretted-bass"), 3, AMPLITUDES[:2], position=0.26)
    assert 1.5 < refused.value.bound_mm < ACTION


def test_what_contradicts_itself_is_refused(quick: None, recordings) -> None:
    """The second touches nothing, and the third, of which a smaller amplitude is told, touches."""
    with pytest.raises(FitRefused, match="the recordings contradict each other: one touches nothing"):
        fit_frets(recordings[:3], load_preset("fretted-bass"), 3, (1.4, 2.25, 1.65), position=0.26)


def test_a_hard_strike_is_no_answer(quick: None, model: FretModel, recordings) -> None:
    hard = [(recorded(model, each, 7), RATE_HZ) for each in (7.0, 8.0)]
    with pytest.raises(FitRefused, match=r"by which strokes touch|record strokes a little above where buzz begins"):
        fit_frets([recordings[0], *hard], load_preset("fretted-bass"), 3, (1.4, 7.0, 8.0), position=0.26)


def test_cancelled(recordings) -> None:
    with pytest.raises(FitCancelled):
        fit_frets(recordings[:2], load_preset("fretted-bass"), 3, AMPLITUDES[:2], position=0.26, progress=lambda _: False)


def test_one_note_of_the_string(recordings) -> None:
    preset = load_preset("fretted-bass")
    sharp = (recordings[2][0], RATE_HZ * 1.03)
    with pytest.raises(FitRefused, match="the recordings must be of one note"):
        fit_frets([recordings[0], sharp], preset, 3, AMPLITUDES[:2])
    lower = [(samples, RATE_HZ * 0.8) for samples, _ in recordings[:2]]
    with pytest.raises(FitRefused, match="choose another --string"):
        fit_frets(lower, preset, 3, AMPLITUDES[:2])
    for amplitudes, reason in (((1.6,), "an amplitude for each of the 2"), ((1.6, np.nan), "must lie between 0.01 and 40")):
        with pytest.raises(ValueError, match=reason):
            fit_frets(recordings[:2], preset, 3, amplitudes)
    with pytest.raises(ValueError, match="two recordings or more"):
        fit_frets(recordings[:1], preset, 3, (1.6,))


def test_the_command_says_what_does_not_go(capsys, tmp_path: Path, recordings) -> None:
    path = str(tmp_path / "note.wav")
    soundfile.write(path, recordings[0][0], RATE_HZ, subtype="PCM_24")
    frets = ["--contact", "--experimental", "-p", "fretted-bass"]
    for arguments, reason in (
        ([path, "--experimental"], "--experimental goes with --contact"),
        ([path, "--contact", "-p", "fretted-bass"], "add --experimental"),
        ([path, "--contact", "--experimental", "-p", "tanpura-light"], "tanpura-light has none: leave it out"),
        ([path, *frets], "give --amplitude once for each recording"),
        ([path, path, *frets, "--amplitude", "2"], "for each of the 2 recordings, got 1"),
        ([path, *frets, "--amplitude", "2", "--open", path], "--open is for bridges"),
        (
            [path, "--contact", "-p", "tanpura-light", "--amplitude", "2", "--amplitude", "3"],
            "(of the first recording), got 2",
        ),
    ):
        assert cli.main(["fit", *arguments]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1 and reason in lines[0], lines
