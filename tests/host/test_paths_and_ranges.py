"""Presets as paths, notes that no string plays, and notes that are compared."""

from __future__ import annotations

import shutil
import warnings
from pathlib import Path

import numpy as np
import pytest

import synth
from synth import Engine, Note
from synth.instrument.preset import preset_folder

PHRASE = [(48, 90, 0.1)]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return Path(shutil.copy(preset_folder() / "jawari-harp.toml", tmp_path / "mine.toml"))


def test_a_path_is_taken_wherever_a_preset_is(path: Path) -> None:
    wanted = synth.render(PHRASE, str(path), quality="draft", tail=0.0).samples
    note = Note(48, 90, 0.1, preset=path)
    for sound in (
        synth.render(PHRASE, path, quality="draft", tail=0.0),
        synth.render([note], quality="draft", tail=0.0),
        synth.render([note, Note(48, 90, 0.1, preset=str(path), start_s=9.0)], quality="draft", tail=0.0, end_s=0.1),
    ):
        assert np.array_equal(sound.samples[: len(wanted)], wanted)
    by_path, by_note, by_name = (
        next(iter(synth.render_notes(preset, [each], quality="draft")))
        for preset, each in ((path, Note(48, 90, 0.1)), (None, note), (str(path), Note(48, 90, 0.1)))
    )
    assert by_name.samples is not None and not by_name.error and by_path == by_name
    assert np.array_equal(by_note.samples, by_name.samples)
    assert synth.load_preset(path) == synth.load_preset(str(path))
    assert Engine([path, "tanpura-light"]).parts == (synth.load_preset(path), synth.load_preset("tanpura-light"))


def test_a_path_that_is_none_is_said() -> None:
    with pytest.raises(synth.PresetError, match=r"nowhere\.toml does not exist"):
        synth.render(PHRASE, Path("nowhere.toml"))
    with pytest.raises(TypeError, match="a preset is a name, a file or a Preset, got int 7"):
        synth.render(PHRASE, 7)  # type: ignore[arg-type]


def test_a_note_out_of_range_is_warned_of() -> None:
    with pytest.warns(UserWarning, match="jawari-harp: 1 of 2 notes not played, C-1: outside E1-C7") as told:
        sound = synth.render([(0, 90, 0.05), (48, 90, 0.05)], "jawari-harp", quality="draft", tail=0.0)
    assert told[0].filename == __file__ and any("C-1" in line for line in sound.report.warnings)
    heard: list[str] = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        synth.render([(0, 90, 0.05), (48, 90, 0.05)], "jawari-harp", quality="draft", tail=0.0, warn=heard.append)
        synth.render(PHRASE, "jawari-harp", quality="draft", tail=0.0)
    assert len(heard) == 1 and "C-1" in heard[0]


def test_notes_that_were_rendered_are_compared() -> None:
    first, second = (
        list(synth.render_notes("jawari-harp", [(48, 90, 0.05), (50, 90, 0.05)], quality="draft")) for _ in range(2)
    )
    assert first == second and len({*first, *second}) == 2
    assert first[0] != first[1] and first[0] != "a note" and first != second[:1]
    silent = next(iter(synth.render_notes("jawari-harp", [(0, 90, 0.05)], quality="draft")))
    assert silent.samples is None and silent != first[0]
