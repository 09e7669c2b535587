"""The map: what it says of notes, of strings that rest on a fret, of boards and bridges; that it may be stopped."""

import csv
import io
import math
from dataclasses import replace

import numpy as np
import pytest

from synth.instrument.preset import Preset, PresetError, load_preset
from synth.setup.buzz_map import BuzzMap, Spot, buzz_map, with_gauge
from synth.setup.places import below, opened_string, places_of
from synth.setup.report import COLUMNS, csv_text, fret_ranges, rows, summary, terminal_text
from synth.setup.side_by_side import computed


@pytest.fixture(scope="module")
def bass() -> Preset:
    return load_preset("fretted-bass")


@pytest.fixture(scope="module")
def found(bass: Preset) -> BuzzMap:
    return buzz_map(bass, strings=["E", "G"], frets=range(0, 21, 4), threads=2)


def spot(found: BuzzMap, string: str, fret: int) -> Spot:
    return next(each for each in found.spots if (each.string, each.fret) == (string, fret))


def test_notes_come_string_by_string(found: BuzzMap) -> None:
    assert [(each.string, each.fret) for each in found.spots] == [(s, f) for s in "EG" for f in range(0, 21, 4)]
    assert found.complete and found.velocity == 80


def test_thresholds_lie_in_their_order(found: BuzzMap) -> None:
    for each in found.spots:
        if math.isfinite(each.buzz_m):
            assert 0.0 < each.touch_m <= each.buzz_m <= each.limit_m
            assert each.low_m <= each.buzz_m <= each.high_m
            assert each.buzzes == (each.stroke_m >= each.buzz_m)
            if each.stroke_m < each.touch_m:
                assert each.stroke_db == 0.0
            elif each.stroke_m > each.high_m:
                assert each.stroke_db >= 3.0


def test_the_last_fret_has_nothing_to_touch(found: BuzzMap) -> None:
    last = spot(found, "G", 20)
    assert (last.touch_m, last.buzz_m, last.touched, last.buzzes_on) == (math.inf, math.inf, "", "")
    assert last.clearance_m == math.inf


def test_a_string_one_per_cent_thicker_takes_two_per_cent_more_force(found: BuzzMap) -> None:
    """Its tension goes with the square of its diameter, its motion hardly changes."""
    for each in found.spots:
        if math.isfinite(each.touch_m):
            assert each.gauge_percent == pytest.approx(2.01, abs=0.3)


def test_a_string_that_is_twice_as_thick(bass: Preset) -> None:
    single = bass.model_copy(update={"string": bass.string[:1]})
    (table,) = with_gauge(single, 2.0).string
    (before,) = single.string
    assert table.diameter_mm == 2.0 * before.diameter_mm
    assert table.linear_density_g_m == 4.0 * before.linear_density_g_m
    assert table.core_diameter_mm == 2.0 * before.core_diameter_mm


def test_a_harder_stroke_draws_further_and_the_velocity_of_the_threshold_draws_to_it(bass: Preset) -> None:
    at = {"strings": ["D"], "frets": [5], "place_m": 0.12}  # of its own accord a harder stroke is nearer to the bridge
    soft, hard = (buzz_map(bass, stroke=stroke, **at).spots[0] for stroke in ("soft", "hard"))
    assert hard.stroke_m == pytest.approx(soft.stroke_m * 3.0**bass.pluck.velocity_exponent, rel=0.02)
    again = buzz_map(bass, stroke=round(hard.buzz_velocity), **at).spots[0]
    assert again.stroke_m == pytest.approx(hard.buzz_m, rel=0.03)


def test_the_place_is_that_which_is_asked_for(bass: Preset) -> None:
    near, far = (buzz_map(bass, place_m=place, strings=["A"], frets=[0]).spots[0] for place in (0.06, 0.25))
    assert near.stroke_m < far.stroke_m  # the same force
    with pytest.raises(ValueError, match="must lie on every string, got 900 mm from the saddle, where string A at fret 0"):
        buzz_map(bass, place_m=0.9, strings=["A"], frets=[0])


def test_a_string_that_rests_on_a_fret_is_said(bass: Preset) -> None:
    heights = list(bass.obstacle.heights_mm)
    heights[6] += 0.6  # fret 7, far above its neighbours
    high = bass.model_copy(update={"obstacle": bass.obstacle.model_copy(update={"heights_mm": tuple(heights)})})
    found = buzz_map(high, strings=["A"], frets=[0, 6, 7])
    opened, before, at = found.spots
    assert not opened.resting and not at.resting
    assert before.resting and before.touched == "fret 7" and before.touch_m == before.buzz_m == 0.0
    assert before.clearance_m < 0.0
    assert "rests on 7" in terminal_text(found)
    assert rows(found)[1]["rests"] and rows(found)[1]["touches"] == "fret 7"


def test_boards_bridges_and_sawari() -> None:
    board = buzz_map(load_preset("fretless-bass"), strings=["A"], frets=[3]).spots[0]
    assert board.buzzes_on.startswith("board at ") and board.touch_m < board.buzz_m < 1.1 * board.touch_m
    bridge = buzz_map(load_preset("tanpura-light"), strings=["kharaj"]).spots[0]
    assert bridge.buzzes_on == "bridge" and bridge.buzzes
    shamisen = load_preset("shamisen")
    opened, stopped, *_ = places_of(shamisen, ["ichi"])
    string = opened_string(shamisen, opened)
    assert below(shamisen, opened, string, string.length_m).names[:2] == ("sawari", "fret 1")
    assert below(shamisen, stopped, string, 0.9 * string.length_m).names[0] == "fret 2"


def test_strings_on_one_bridge_are_taken_one_by_one() -> None:
    found = buzz_map(load_preset("steel-guitar"), strings=["B3"], frets=[2], quality="draft").spots[0]
    assert found.touched.startswith("fret ") and math.isfinite(found.buzz_m)


def test_what_cannot_be_mapped_is_refused(bass: Preset) -> None:
    with pytest.raises(PresetError, match="nothing can buzz"):
        buzz_map(load_preset("harp"))
    with pytest.raises(ValueError, match=r"articulations\.normal of slap-bass must draw the string, got a throw"):
        buzz_map(load_preset("slap-bass"))
    with pytest.raises(PresetError, match="no string is called 'H'"):
        buzz_map(bass, strings=["H"])
    with pytest.raises(PresetError, match="no string has one of the frets 21 to 30"):
        buzz_map(bass, frets=range(21, 31))
    with pytest.raises(ValueError, match="soft, medium, hard or a velocity"):
        buzz_map(bass, stroke="loud")
    with pytest.raises(ValueError, match="soft, medium, hard or a velocity"):
        buzz_map(bass, stroke=0)
    with pytest.raises(ValueError, match="quality must be one of"):
        buzz_map(bass, quality="best")


def test_what_was_done_is_kept_where_it_is_interrupted() -> None:
    def told(done: int, total: int) -> None:
        if done >= 2:
            raise KeyboardInterrupt

    made, complete = computed(lambda each: 2 * each, list(range(50)), 1, told)
    assert not complete
    assert 2 <= len(made) <= 50
    assert made == tuple(2 * each for each in range(len(made)))


def test_what_goes_wrong_is_raised() -> None:
    with pytest.raises(ZeroDivisionError):
        computed(lambda each: 1 // each, [1, 0, 2], 2)


def test_rows_and_csv(found: BuzzMap) -> None:
    made = rows(found)
    assert list(made[0]) == list(COLUMNS)
    read = list(csv.DictReader(io.StringIO(csv_text(found))))
    assert len(read) == len(made) == 12
    for row, cells in zip(made, read, strict=True):
        assert cells["string"] == row["string"] and cells["fret"] == str(row["fret"])
        assert cells["buzz_mm"] == ("" if row["buzz_mm"] is None else str(row["buzz_mm"]))
        assert cells["buzzes"] in ("true", "false")


def test_the_table_has_a_row_for_each_fret(found: BuzzMap) -> None:
    lines = terminal_text(found).splitlines()
    assert [line.split()[0] for line in lines[2:8]] == ["open", "4", "8", "12", "16", "20"]
    assert lines[7].split()[1:] == [
        ">",
        f"{1e3 * spot(found, 'E', 20).limit_m:.2f}",
        ">",
        f"{1e3 * spot(found, 'G', 20).limit_m:.2f}",
    ]
    first = spot(found, "G", 4)
    assert f"{1e3 * first.buzz_m:.2f}* {first.buzzes_on.removeprefix('fret ')}" in lines[3]


def test_the_summary_names_what_is_chaotic_and_uncertain(found: BuzzMap) -> None:
    one = spot(found, "E", 4)
    chaotic = replace(one, returns_m=1.2 * one.buzz_m)
    near = replace(one, fret=5, stroke_m=one.buzz_m, low_m=0.99 * one.buzz_m, high_m=1.01 * one.buzz_m)
    said = "\n".join(summary(replace(found, spots=(chaotic, near))))
    assert "comes and goes beyond the threshold (chaotic motion): E 4" in said
    assert "may or may not buzz: E 5" in said
    assert summary(replace(found, spots=())) == ["no note was computed"]


def test_frets_as_ranges() -> None:
    assert fret_ranges([0, 1, 2, 3, 7, 9, 10]) == "open, 1-3, 7, 9-10"
    assert fret_ranges([4]) == "4"


def test_every_note_of_a_preset_has_a_place(bass: Preset) -> None:
    assert len(places_of(bass)) == 84
    assert [each.note for each in places_of(bass, ["E1"], [3])] == [31]
    sitar = load_preset("sitar")
    assert not any(sitar.string[each.index].sympathetic for each in places_of(sitar))


def test_the_map_is_the_same_on_one_thread_and_on_two(bass: Preset) -> None:
    one, two = (buzz_map(bass, strings=["A"], frets=[2, 9], threads=n) for n in (1, 2))
    for a, b in zip(one.spots, two.spots, strict=True):
        assert np.array_equal([a.touch_m, a.buzz_m, a.stroke_db], [b.touch_m, b.buzz_m, b.stroke_db])
