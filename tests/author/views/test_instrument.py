"""The drawing: to scale, as the engine's model has it, and what a drag changes puts the thing where it was dragged."""

import json
from itertools import pairwise
from typing import Any

import pytest

from synth.author.changes import apply
from synth.author.views.instrument import draw
from synth.author.views.parameters import describe
from synth.instrument.compile import compile_preset
from synth.instrument.place import find
from synth.instrument.preset import Preset, PresetError, load_preset, playable_notes, playable_range

from .kit import TEXTS, preset

#: preset, note, velocity
NOTES = [
    ("tanpura-light", 43, 100),
    ("tanpura-light", 36, 40),
    ("fretted-bass", 28, 127),
    ("fretted-bass", 31, 90),
    ("fretted-bass", 63, 90),
    ("jawari-harp", 60, 100),
    ("points", 55, 30),
    ("points", 60, 120),
    ("action", 43, 100),
    ("action", 50, 64),
    ("free", 48, 100),
]


def dragged(name: str, drag: dict[str, Any], coordinate: float) -> Preset:
    value: Any = drag["offset"] + drag["factor"] * coordinate
    if drag["minimum"] is not None:
        value = min(max(value, drag["minimum"]), drag["maximum"])
    changes = [(edit["path"], edit["value"]) for edit in drag["edits"]]
    if drag["anchor"] is not None:
        table, key = drag["path"].split(".")
        present = getattr(getattr(preset(name), table), key)
        value = {**present, drag["anchor"]: value}
    return apply(TEXTS[name], [*changes, (drag["path"], value)], name)[1]


@pytest.mark.parametrize(("name", "note", "velocity"), NOTES)
def test_the_drawing_is_the_models(name: str, note: int, velocity: int) -> None:
    of = preset(name)
    drawing = draw(of, note, velocity)
    json.dumps(drawing, allow_nan=False)
    place = find(of, note)
    (string,) = (s for s in compile_preset(place.preset).strings)
    model = next(p for p in string.positions if p.note == note)
    assert drawing["playable"] and drawing["note"] == note and drawing["fret"] == model.fret
    assert drawing["open_length_m"] == pytest.approx(string.open_length_m, abs=1e-6)
    assert drawing["length_m"] == pytest.approx(model.length_m, abs=1e-6)
    assert drawing["tension_n"] == pytest.approx(model.tension_n, abs=1e-3)
    reached = [point for point in drawing["points"] if point["in_play"]]
    assert [point["gap_mm"] for point in reached] == pytest.approx(list(-1e3 * model.eta), abs=1e-4)
    assert [point["x"] for point in drawing["points"]] == sorted(point["x"] for point in drawing["points"])
    assert (drawing["finger"] is None) == (model.fret == 0)
    if drawing["finger"]:
        assert drawing["finger"]["height"] == pytest.approx(1e3 * model.rest_height_m, abs=1e-4)
    shape = drawing["pluck"]["shape"]
    assert all(a[0] < b[0] for a, b in pairwise(shape))
    assert shape[-1] == [drawing["open_length_m"], drawing["saddle"]["height"]]
    low, high = drawing["extent_mm"]
    assert low <= min(h for _, h in shape) and max(h for _, h in shape) <= high


@pytest.mark.parametrize(("name", "note", "velocity"), NOTES)
def test_drags_put_things_where_they_are_dragged(name: str, note: int, velocity: int) -> None:
    drawing = draw(preset(name), note, velocity)
    things: list[tuple[str, Any, dict[str, Any]]] = [("pluck", None, drawing["pluck"]), ("output", None, drawing["output"])]
    if drawing["thread"]:
        things.append(("thread", None, drawing["thread"]))
    things += [("points", point["index"], point) for point in drawing["points"] if point["in_play"]][:4]
    tried = 0
    for kind, index, thing in things:
        for axis in ("x", "height"):
            drag = thing["drag"][axis]
            if drag is None:
                continue
            crest = kind == "pluck" and axis == "height"
            where = thing["shape"][-2][1] if crest else thing[axis]
            # a pluck beyond the middle of the speaking string is held there
            middle = drawing["open_length_m"] - 0.5 * drawing["length_m"]
            aim = (
                where * (1.02 if abs(where - middle) < 1e-5 else 0.98)
                if axis == "x"
                else where + (0.1 if crest else -0.0005 if name == "tanpura-light" else -0.01)
            )
            moved = draw(dragged(name, drag, aim), note, velocity)
            new = moved[kind] if index is None else moved["points"][index]
            found = new["shape"][-2][1] if crest else new[axis]
            assert found == pytest.approx(aim, abs=2e-5), (kind, index, axis)
            still = draw(dragged(name, drag, where), note, velocity)
            same = still[kind] if index is None else still["points"][index]
            assert (same["shape"][-2][1] if crest else same[axis]) == pytest.approx(where, abs=2e-5)
            tried += 1
    assert tried >= 3


def test_a_string_that_is_pressed_lies_on_the_bridge() -> None:
    drawing = draw(load_preset("tanpura-light").with_setting("obstacle.jiva_um", "-50"), 43)
    assert drawing["rest"] == [[0.0, 0.0], [0.944, 0.0], [0.95, pytest.approx(-0.05 * 950 / 944, abs=1e-5)]]
    assert drawing["points"][0]["gap_mm"] == pytest.approx(-0.05)


@pytest.mark.parametrize("jiva_um", ["0", "3", "30", "1000", "-50"])
def test_the_thread_is_raised_and_the_bridge_stays(jiva_um: str) -> None:
    drawing = draw(load_preset("tanpura-light").with_setting("obstacle.jiva_um", jiva_um), 43)
    (edge,) = drawing["points"]
    thread = drawing["thread"]
    assert edge["height"] == 0.0 and drawing["nut"]["height"] == 0.0
    assert thread["height"] == pytest.approx(1e-3 * float(jiva_um) * 950 / 944, abs=1e-5) == drawing["saddle"]["height"]
    assert edge["gap_mm"] == pytest.approx(1e-3 * float(jiva_um), abs=1e-5)
    assert drawing["rest"][-1] == [thread["x"], thread["height"]]
    drag = thread["drag"]["height"]
    assert drag["path"] == "obstacle.jiva_um" and (drag["minimum"], drag["maximum"]) == (-100.0, 1000.0)
    assert drag["offset"] + drag["factor"] * thread["height"] == pytest.approx(float(jiva_um), abs=0.02)


def test_a_fret_that_stops_the_string_is_drawn_and_named() -> None:
    heights = [-1.0] * 12
    heights[4] = 0.3
    bad = preset("action").with_setting("obstacle", f'{{kind = "frets", count = 12, heights_mm = {heights}}}')
    drawing = draw(bad, 45)
    assert not drawing["playable"] and "fret 5" in drawing["reason"]
    assert len(drawing["points"]) == 12 and drawing["points"][4]["gap_mm"] < 0.0
    assert drawing["finger"]["fret"] == 2


def test_the_place_of_a_note_is_the_engines() -> None:
    import numpy as np

    from synth.engine.engine import Engine
    from synth.midi.events import NOTE_ON, make_events

    bass = load_preset("fretted-bass")
    engine = Engine([bass], limiter=False)
    engine.prepare(44100.0)
    for note in (28, 29, 33, 34, 38, 40, 45, 52, 63):
        engine.reset()
        engine.process(make_events([(0, NOTE_ON, 0, note, 80)]), np.zeros((128, 2)))
        first, second = np.flatnonzero(engine._sounding.voices["awake"])  # the directions of one string
        assert second == first + 1
        place = find(bass, note)
        assert engine.compiled[0].strings[first // 2].positions[0].note == place.opened, note


def test_notes_that_no_string_plays_are_refused() -> None:
    with pytest.raises(PresetError, match="no string plays C7; its notes lie in C2-C3"):
        draw(load_preset("tanpura-light"), 96)
    for name in TEXTS:
        notes = playable_notes(preset(name))
        assert (notes[0], notes[-1]) == playable_range(preset(name))
    assert playable_notes(load_preset("tanpura-light")) == [36, 43, 48]


def test_a_pluck_is_dragged_no_further_than_the_middle() -> None:
    drag = draw(load_preset("tanpura-light"), 48)["pluck"]["drag"]["x"]
    assert drag["path"] == "pluck.position"
    assert drag["maximum"] == 0.5


@pytest.mark.parametrize(("name", "count"), [("sitar", 24), ("veena", 24)])
def test_frets_before_a_bridge_are_drawn_where_they_stop_the_string(name: str, count: int) -> None:
    of = load_preset(name)
    note = next(note for note in playable_notes(of) if find(of, note).fret > 3)
    drawing = draw(of, note)
    assert len(drawing["frets"]) == of.obstacle.frets == count  # type: ignore[union-attr]
    assert drawing["frets"][drawing["fret"] - 1] == drawing["finger"]["x"]


@pytest.mark.parametrize(
    ("name", "thread"), [("sitar", False), ("veena", False), ("tanpura-light", True), ("jawari-harp", True)]
)
def test_a_thread_is_drawn_and_named_where_the_preset_has_one(name: str, thread: bool) -> None:
    """Also once its height, or the gap over a bridge that has none, has been set."""
    for of in (load_preset(name), load_preset(name).with_setting("obstacle.jiva_um", "5.0")):
        assert (draw(of, playable_notes(of)[5 % len(playable_notes(of))])["thread"] is not None) == thread
        words = [entry["label"] + entry["tip"] for entry in describe(of) if entry["path"].startswith("obstacle.")]
        named = [text for text in words if "jiva" in text or "Thread to edge" in text]
        assert bool(named) == thread
