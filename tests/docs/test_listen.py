"""The page of sounds: what is played can be played, files are rendered once, and again when something changed."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from listening import rendering, tunes
from listening.pieces import Piece, pieces

from synth.instrument.preset import list_presets, load_preset, playable_notes
from synth.midi.events import NOTE_OFF, NOTE_ON

DOCS = Path(__file__).parents[2] / "docs"


def test_every_instrument_has_a_piece_and_every_section_a_place() -> None:
    everything = pieces()
    assert [p.preset.name for p in everything if p.section == "instruments"] != []
    assert {p.preset.name for p in everything if p.section == "instruments"} == {preset.name for preset in list_presets()}
    text = "".join(path.read_text(encoding="utf-8") for path in (DOCS / "index.md", DOCS / "listen.md"))
    for section in {p.section for p in everything}:
        assert f"<!-- players: {section} -->" in text
    # one name, one sound
    names: dict[str, str] = {}
    for piece in everything:
        assert names.setdefault(piece.file, rendering.key_of(piece, "")) == rendering.key_of(piece, ""), piece.file


def test_every_tune_is_played_by_its_instrument() -> None:
    for preset in list_presets():
        events = tunes.events(preset, "tune", 80, 1000)
        assert np.all(np.diff(events["frame"].astype(np.int64)) >= 0)
        assert set(events["a"].tolist()) <= set(playable_notes(preset)), preset.name
        sounding: set[int] = set()
        for event in events:
            key = int(event["a"])
            if event["kind"] == NOTE_ON:
                # a drone's string is plucked again while it rings
                assert key not in sounding or preset.family == "tanpura", preset.name
                sounding.add(key)
            elif event["kind"] == NOTE_OFF:
                sounding.discard(key)
        assert not sounding, preset.name


def test_an_unknown_phrase_is_refused() -> None:
    with pytest.raises(ValueError, match="phrase: must be tune, note"):
        tunes.events(load_preset("tanpura-light"), "song", 80, 1000)


def test_files_are_rendered_once_and_again_when_something_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rendered = []

    def sound(piece: Piece) -> np.ndarray:
        rendered.append(piece.velocity)
        wave = 0.5 * np.sin(np.arange(4800) * 0.05)
        return np.stack([wave, wave * (0.1 if piece.velocity == 40 else 1.0)], axis=1) / piece.velocity * 40

    monkeypatch.setattr(rendering, "sound", sound)
    preset = load_preset("tanpura-light")
    loud, soft = Piece("one", "Loud", "", "loud", preset, velocity=80), Piece("one", "Soft", "", "soft", preset, velocity=40)

    def listed(*chosen: Piece, silent: bool = False) -> list[dict[str, str | None]]:
        rendering.write_all(chosen, tmp_path, silent, lambda _: None)
        return json.loads((tmp_path / "sounds.json").read_text(encoding="utf-8"))

    assert [entry["file"] for entry in listed(loud, soft, silent=True)] == [None, None]
    first = listed(loud, soft)
    assert rendered == [80, 40] and all((tmp_path / str(entry["file"])).is_file() for entry in first)
    # alike on both sides: one channel
    assert [soundfile.info(tmp_path / str(entry["file"])).channels for entry in first] == [1, 2]
    assert listed(loud, soft) == first and rendered == [80, 40]
    changed = Piece("one", "Soft", "", "soft", preset.with_setting("obstacle.jiva_um", "9"), velocity=40)
    second = listed(loud, changed)
    assert rendered == [80, 40, 40] and second[0] == first[0] and second[1]["file"] != first[1]["file"]
    assert not (tmp_path / str(first[1]["file"])).exists()
    # a piece that is to be as loud as the one before it
    levelled = listed(loud, Piece("one", "Soft", "", "soft", preset, velocity=40, level=True))
    powers = [np.mean(soundfile.read(tmp_path / str(entry["file"]), always_2d=True)[0] ** 2) for entry in levelled]
    assert powers[1] == pytest.approx(powers[0], rel=0.1)
