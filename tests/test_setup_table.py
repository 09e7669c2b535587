"""[setup]: the neck as a luthier measures it, against heights worked out by hand, and strings by their makers' names."""

import math
import re
import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from synth.author.changes import apply
from synth.author.views.instrument import draw
from synth.author.views.parameters import describe
from synth.engine.engine import Engine
from synth.fit.fret_model import FretModel, action_mm, action_settings, with_action
from synth.instrument.check import problems
from synth.instrument.compile import axial_stiffness, compile_preset, has_plan, measured_of, obstacle_of, open_string
from synth.instrument.fingerprints import fingerprint
from synth.instrument.neck import alone, obstacle_under, single_strings, strung
from synth.instrument.preset import (
    BoardObstacle,
    FretsObstacle,
    Preset,
    PresetError,
    list_presets,
    load_preset,
    parse_preset,
)
from synth.instrument.presetfile import preset_text
from synth.instrument.setup_table import Setup
from synth.instrument.wires import WIRES, wire
from synth.midi.events import NOTE_ON, make_events
from synth.plugin import bankfile
from synth.plugin.setup import set_up, setup_of

LENGTH_M = 0.864
COUNT = 22
STRING = """
[[string]]
name = "{note}"
notes = "{note}"
length_m = 0.864
diameter_mm = 1.14
linear_density_g_m = 6.69
core_diameter_mm = 0.43
winding_diameter_mm = 0.355
youngs_modulus_gpa = 301
viscoelastic_loss = 0.01
"""
FRETS = f'kind = "frets"\ncount = {COUNT}'
BOARD = 'kind = "board"\nsemitones = 20\nlength_mm = 620'


def text_of(setup: str, obstacle: str = FRETS, notes: str = "E1 A1 D2 G2", more: str = "") -> str:
    strings = "".join(STRING.format(note=note) for note in notes.split())
    obstacle = f"[obstacle]\n{obstacle}\n" if obstacle else ""
    return f'format = 2\nname = "x"\n{strings}\n[setup]\n{setup}\n{obstacle}[pluck]\ndisplacement_mm = 3.0\n{more}'


def made(*arguments: str, **named: str) -> Preset:
    return parse_preset(text_of(*arguments, **named), "x.toml")


def heights(preset: Preset, index: int = 0) -> np.ndarray:
    """Of the frets under a string, from the compiled one [m]."""
    table = preset.string[index]
    return np.array(obstacle_of(preset, table, table.notes[0], LENGTH_M).heights_m)


def fret(n: int) -> float:
    """Its place, as a share of the length."""
    return 1.0 - 2.0 ** (-n / 12.0)


def test_actions_are_those_of_the_frets_that_are_measured() -> None:
    preset = made("action_bass_mm = 2.4\naction_treble_mm = 1.8\nnut_bass_mm = 0.6\nnut_treble_mm = 0.3\nrelief_mm = 0.25")
    for index in range(4):
        line = heights(preset, index)
        assert line[11] == pytest.approx(-1e-3 * (2.4 - 0.2 * index), abs=1e-12)
        assert line[0] == pytest.approx(-1e-3 * (0.6 - 0.1 * index), abs=1e-12)
    assert heights(made("action_bass_mm = 2.0"), 3)[[0, 11]] == pytest.approx([-0.4e-3, -2.0e-3], abs=1e-12)


@pytest.mark.parametrize("relief", [0.3, -0.15])
def test_relief_is_the_gap_under_a_straightedge_and_backbow_a_hump(relief: float) -> None:
    line = heights(made(f"action_bass_mm = 2.0\nrelief_mm = {relief}"))
    x = np.array([fret(n) for n in range(1, COUNT + 1)])
    s = (x - x[0]) / (x[-1] - x[0])
    straightedge = line[0] + (line[-1] - line[0]) * s
    assert straightedge - line == pytest.approx(4e-3 * relief * s * (1.0 - s), abs=1e-12)


def test_the_board_falls_away_in_a_straight_line() -> None:
    setup = "action_bass_mm = 2.0\nfall_away_mm = 0.3\nfall_away_fret = 14"
    fallen, straight = (heights(made(each)) for each in (setup, "action_bass_mm = 2.0"))
    assert fallen[:14] == pytest.approx(straight[:14], abs=1e-12)
    assert fallen[21] - straight[21] == pytest.approx(-0.3e-3, abs=1e-12)
    part = (fret(17) - fret(14)) / (fret(22) - fret(14))
    assert fallen[16] - straight[16] == pytest.approx(-0.3e-3 * part, abs=1e-12)


def test_a_fret_that_is_too_high_stands_out_by_as_much() -> None:
    crowns = [1.10] * COUNT
    crowns[6] = 1.15
    line, level = (
        heights(made(each)) for each in (f"action_bass_mm = 2.0\nfret_heights_mm = {crowns}", "action_bass_mm = 2.0")
    )
    assert line[6] - level[6] == pytest.approx(50e-6, abs=1e-12)
    assert np.delete(line, 6) == pytest.approx(np.delete(level, 6), abs=1e-12)


def test_clearances_hold_on_frets_one_and_twelve_however_high_these_are() -> None:
    crowns = [1.10] * COUNT
    crowns[0], crowns[11] = 1.14, 1.07
    line, level = (
        heights(made(each)) for each in (f"action_bass_mm = 2.0\nfret_heights_mm = {crowns}", "action_bass_mm = 2.0")
    )
    assert line[[0, 11]] == pytest.approx([-0.4e-3, -2.0e-3], abs=1e-12)
    # all others lie 40 µm lower at fret 1, 30 µm higher at fret 12, and in a straight line between and beyond
    for n in (2, 7, 20):
        moved = -40e-6 + 70e-6 * (fret(n) - fret(1)) / (fret(12) - fret(1))
        assert line[n - 1] - level[n - 1] == pytest.approx(moved, abs=1e-12)


ROUND = "action_bass_mm = 2.4\naction_treble_mm = 1.8\nnut_bass_mm = 0.5\nboard_radius_mm = 184\nsaddle_radius_mm = 300\n"
SPREADS = "nut_spread_mm = 30\nsaddle_spread_mm = 57"


def circle(radius: float, y: float) -> float:
    """Height of a circle at y from its middle over its middle [mm], not in the program's way: R cos(arcsin(y/R)) − R."""
    return radius * math.cos(math.asin(y / radius)) - radius


def test_a_saddle_flatter_than_the_board_brings_inner_strings_down() -> None:
    round_, flat = made(ROUND + SPREADS), made("action_bass_mm = 2.4\naction_treble_mm = 1.8\nnut_bass_mm = 0.5")
    for index in (0, 3):  # outer strings are where they are measured
        assert heights(round_, index) == pytest.approx(heights(flat, index), abs=1e-12)
    # the A string lies a third of the half width from the middle: 5 mm at the nut, 9.5 mm at the saddle
    line, level = heights(round_, 1), heights(flat, 1)
    for n in (1, 5, 12, 22):
        s = fret(n)
        string = s * (circle(300, 9.5) - circle(300, 28.5)) + (1 - s) * (circle(184, 5) - circle(184, 15))
        y, outer = (1 - s) * 5 + s * 9.5, (1 - s) * 15 + s * 28.5
        crown = circle(184, y) - circle(184, outer)
        assert line[n - 1] - level[n - 1] == pytest.approx(1e-3 * (crown - string), abs=1e-9)
    assert np.all(line[4:] > level[4:]) and heights(round_, 2)[11] - heights(flat, 2)[11] == pytest.approx(
        line[11] - level[11]
    )


def test_a_single_string_has_the_bass_sides_action() -> None:
    preset = made("action_bass_mm = 2.4\naction_treble_mm = 1.8", notes="G2")
    assert heights(preset)[11] == pytest.approx(-2.4e-3, abs=1e-12)


def test_strings_that_no_fret_stops_are_none_of_the_neck() -> None:
    text = text_of("action_bass_mm = 2.4\naction_treble_mm = 1.8").replace('name = "A1"', 'name = "A1"\nfrets = 0')
    preset = parse_preset(text, "x")
    assert [round(-1e3 * heights(preset, index)[11], 9) for index in range(4)] == [2.4, 2.4, 2.1, 1.8]


def test_a_board_has_the_numbers_of_each_string() -> None:
    preset = made("action_bass_mm = 2.4\naction_treble_mm = 1.8\nnut_bass_mm = 0.2\nrelief_mm = -0.1", BOARD)
    shapes = [obstacle_under(preset, table, table.notes[0]) for table in preset.string]
    assert all(isinstance(shape, BoardObstacle) and shape.relief_mm == -0.1 for shape in shapes)
    assert [shape.action_12th_mm for shape in shapes] == pytest.approx([2.4, 2.2, 2.0, 1.8])  # type: ignore[union-attr]
    boards = [string.board.fingerboard for string in compile_preset(preset, only_notes={28, 43}).strings]  # type: ignore[union-attr]
    assert boards[0].nut_height_m == pytest.approx(0.2e-3) and boards[0].slope > boards[-1].slope
    assert problems(preset) == []
    arched = made("action_bass_mm = 2.0\nboard_radius_mm = 184\nsaddle_radius_mm = 300\n" + SPREADS, BOARD)
    inner = obstacle_under(arched, arched.string[1], 33)
    string = 0.5 * (circle(300, 9.5) - circle(300, 28.5)) + 0.5 * (circle(184, 5) - circle(184, 15))
    crown = circle(184, 7.25) - circle(184, 21.75)
    assert inner.action_12th_mm == pytest.approx(2.0 + string - crown, abs=1e-9)  # type: ignore[union-attr]


@pytest.mark.parametrize(
    ("setup", "obstacle", "told"),
    [
        ("relief_mm = 0.1", FRETS, r"setup\.action_bass_mm: missing beside relief_mm; give the clearance at fret 12"),
        ("", FRETS, r"setup\.action_bass_mm: missing; give .* or leave \[setup\] out"),
        ("action_bass_mm = 0", FRETS, r"setup\.action_bass_mm: .* greater than 0, got 0"),
        ("action_bass_mm = 2\nrelief_mm = -3", FRETS, r"setup\.relief_mm: "),
        ("action_bass_mm = 2\naction_bas = 3", FRETS, r"setup\.action_bas: no such key \(perhaps action_bass_mm\?\)"),
        (
            "action_bass_mm = 2",
            'kind = "none"',
            r"setup\.action_bass_mm: needs obstacle\.kind = \"frets\" or \"board\".*'none'",
        ),
        ("action_bass_mm = 2", "", r"setup\.action_bass_mm: needs obstacle\.kind"),
        (
            "action_bass_mm = 2",
            FRETS + "\naction_12th_mm = 2",
            r"obstacle\.action_12th_mm: does not go with setup\.action_bass_mm.*; leave action_12th_mm or \[setup\] out",
        ),
        ("action_bass_mm = 2", FRETS + f"\nheights_mm = {[-1.0] * COUNT}", r"obstacle\.heights_mm: does not go with"),
        ("action_bass_mm = 2", FRETS + "\nrelief_mm = 0.0", r"obstacle\.relief_mm: does not go with"),
        ("action_bass_mm = 2", BOARD + "\nnut_height_mm = 0.3", r"obstacle\.nut_height_mm: does not go with"),
        ("action_bass_mm = 2", 'kind = "frets"\ncount = 10', r"obstacle: count must be at least 12 .*in place of \[setup\]"),
        (
            "action_bass_mm = 2\nfret_heights_mm = [1, 1]",
            FRETS,
            r"setup\.fret_heights_mm: needs one height per fret, got 2 for .*22",
        ),
        (
            f"action_bass_mm = 2\nfret_heights_mm = {[9.0] * COUNT}",
            FRETS,
            r"setup\.fret_heights_mm: number 1 must lie between",
        ),
        (
            "action_bass_mm = 2\nfall_away_mm = 0.1\nfall_away_fret = 22",
            FRETS,
            r"setup\.fall_away_fret: must be less than .*22",
        ),
        ("action_bass_mm = 2\nfall_away_mm = 0.1", BOARD, r"setup\.fall_away_mm: has no meaning with .*board"),
        (
            ROUND + "nut_spread_mm = 30",
            FRETS,
            r"setup\.saddle_spread_mm: must be above 0 where .* differ.*; give the distance",
        ),
        ('strings = ["XLB100"]', FRETS + "\naction_12th_mm = 2", r"setup\.strings: must name 4 strings, .*, got 1"),
        (
            'strings = ["XLB104", "XLB080", "XLB065", "XLB045"]',
            FRETS,
            r"setup\.strings: string 'XLB104' is not .*perhaps XLB105\?",
        ),
        (
            'strings = ["XLB100", "XLB080", "XLB065", "XLB045"]',
            FRETS,
            r"obstacle: give either action_12th_mm .*or heights_mm",
        ),
        ('strings = ["XLB100", "XLB080", "XLB065", "XLB045"]', BOARD, r"obstacle\.action_12th_mm: missing$"),
    ],
)
def test_what_cannot_be_is_told(setup: str, obstacle: str, told: str) -> None:
    with pytest.raises(PresetError, match=told):
        made(setup, obstacle)


def test_faults_of_a_neck_without_setup_are_told_as_ever() -> None:
    plain = text_of("").replace("[setup]\n", "")
    with pytest.raises(
        PresetError, match=r"^x: obstacle: give either action_12th_mm \(with relief_mm, nut_height_mm\) or heights_mm$"
    ):
        parse_preset(plain, "x")
    with pytest.raises(PresetError, match=r"^x: obstacle\.action_12th_mm: missing$"):
        parse_preset(plain.replace(FRETS, BOARD), "x")


@pytest.mark.parametrize(
    ("setup", "path"),
    [
        ("action_bass_mm = 0.6\nrelief_mm = -0.5", "setup.relief_mm"),
        ("action_bass_mm = 0.6\nnut_bass_mm = 0.5\nrelief_mm = 2.5", "setup.action_bass_mm"),
        (f"action_bass_mm = 1.0\nfret_heights_mm = {[1.0] * 6 + [2.0] + [1.0] * 15}", "setup.fret_heights_mm"),
    ],
)
def test_a_fret_in_the_way_is_a_fault_of_the_setup(setup: str, path: str) -> None:
    found = problems(made(setup))
    assert {each for each, _ in found} == {path}
    assert all("must lie below the string at rest" in what and "[setup]" in what for _, what in found)


def test_without_the_table_all_is_as_it_was() -> None:
    """The plans that lie beside presets are still those of their strings, by the fingerprints that they have."""
    measured = 0
    for preset in list_presets():
        assert preset.setup is None
        if not preset.measured.strings:
            continue
        known = {each.fingerprint for each in preset.measured.strings}
        strings = [(table, note) for table in preset.string for note in range(table.notes[0], table.notes[1] + 1)]
        assert {fingerprint(preset, *each) for each in strings if has_plan(preset, *each)} <= known
        measured += 1
    assert measured >= 1
    bass = load_preset("fretted-bass")
    for table in bass.string:
        assert obstacle_under(bass, table, table.notes[0]) is bass.obstacle and strung(bass, table, table.notes[0]) is table


def test_a_fingerprint_is_that_of_the_neck_and_string_themselves() -> None:
    preset = made("action_bass_mm = 2.4\naction_treble_mm = 1.8")
    prints = [fingerprint(preset, table, table.notes[0]) for table in preset.string]
    assert len(set(prints)) == 4
    for index, note, single in single_strings(preset):
        assert single.setup is None
        assert fingerprint(single, single.string[0], note) == prints[index]
    higher = preset.with_setting("setup.action_treble_mm", "1.9")
    changed = [fingerprint(higher, table, table.notes[0]) for table in higher.string]
    assert changed[0] == prints[0] and all(a != b for a, b in zip(changed[1:], prints[1:], strict=True))


def test_a_string_alone_sounds_as_among_the_others() -> None:
    names = 'strings = ["XLB100", "XLB080", "XLB065", "XLB045"]'
    preset = made(f"action_bass_mm = 2.0\naction_treble_mm = 1.6\n{names}")
    one = alone(preset, preset.string[2], 38)
    here, there = (compile_preset(each, only_notes={38}).strings for each in (preset, one))
    mine = next(string for string in here if string.open_note == 38)
    (other,) = there
    for a, b in zip(mine.positions, other.positions, strict=True):
        assert np.array_equal(a.eta, b.eta) and np.array_equal(a.omega, b.omega) and a.tension_n == b.tension_n


# D'Addario's brochure and sets: scale 25.5 inch and 34 inch [lb]
TENSIONS = [
    ("PL010", "E4", 25.5, 16.2),
    ("PL013", "B3", 25.5, 15.4),
    ("PL017", "G3", 25.5, 16.6),
    ("NW026", "D3", 25.5, 18.4),
    ("NW036", "A2", 25.5, 19.5),
    ("NW046", "E2", 25.5, 17.5),
    ("XLB045", "G2", 34.0, 42.8),
]


@pytest.mark.parametrize(("name", "note", "inches", "pounds"), TENSIONS)
def test_a_wire_has_the_makers_tension(name: str, note: str, inches: float, pounds: float) -> None:
    text = text_of(f'strings = ["{name}"]', FRETS + "\naction_12th_mm = 2", note)
    preset = parse_preset(text.replace("length_m = 0.864", f"length_m = {0.0254 * inches}"), "x")
    table = preset.string[0].model_copy(update={"youngs_modulus_gpa": 0.0})  # the maker's formula has no stiffness
    limp = preset.model_copy(update={"string": (table,)})
    string, _ = open_string(limp, table, table.notes[0])
    assert string.tension_n / 4.4482216 == pytest.approx(pounds, rel=0.01)


def test_wires_have_densities_of_their_metals() -> None:
    for each in WIRES.values():
        density = each.linear_density_kg_m / (math.pi * each.diameter_m**2 / 4.0)
        assert 7700 < density < 8050 if not each.wound else 5200 < density < 7900, each
    assert wire("pl0095").gauge_in == 0.0095 and not wire("XLB018P").wound and wire("XLB028W").wound
    weights = {series: [w for w in WIRES.values() if w.name.startswith(series)] for series in ("PL", "NW", "PB", "XLB")}
    for listed in weights.values():
        rising = sorted(listed, key=lambda each: each.gauge_in)
        assert all(a.unit_weight_lb_in < b.unit_weight_lb_in for a, b in pairwise(rising))


def test_what_a_named_string_changes() -> None:
    names = 'strings = ["XLB100", "XLB080", "XLB065", "XLB045"]'
    text = text_of(names, FRETS + "\naction_12th_mm = 2")
    text = text.replace(
        "viscoelastic_loss = 0.01", "viscoelastic_loss = 0.01\ntension_modulation = true\naxial_stiffness_n = 40000"
    )
    preset = parse_preset(text, "x")
    heavy = strung(preset, preset.string[0], 28)
    ratio = 2.54 / 1.14
    assert heavy.diameter_mm == pytest.approx(2.54) and heavy.core_diameter_mm == pytest.approx(0.43 * ratio)
    assert heavy.winding_diameter_mm == pytest.approx(0.355 * ratio)
    assert heavy.linear_density_g_m == pytest.approx(1e3 * 0.00179687 * 0.45359237 / 0.0254)
    assert axial_stiffness(preset, preset.string[0], 28) == pytest.approx(40000 * ratio**2)
    plain = parse_preset(text.replace("XLB045", "XLB020P"), "x")
    light = strung(plain, plain.string[3], 43)
    assert light.core_diameter_mm is None and light.winding_diameter_mm is None and light.diameter_mm == pytest.approx(0.508)
    assert axial_stiffness(plain, plain.string[3], 43) == pytest.approx(40000 * (0.508 / 0.43) ** 2)


@pytest.mark.parametrize(("stiffness", "core"), [("youngs_modulus_gpa = 200", 0.4 * 1.1684), ("inharmonicity = 1e-4", None)])
def test_a_wound_string_in_place_of_a_plain_one(stiffness: str, core: float | None) -> None:
    text = text_of('strings = ["NW046"]', 'kind = "none"', "E2")
    for line in ("core_diameter_mm = 0.43\n", "winding_diameter_mm = 0.355\n"):
        text = text.replace(line, "")
    preset = parse_preset(text.replace("youngs_modulus_gpa = 301", stiffness), "x")
    found = strung(preset, preset.string[0], 40)
    assert found.core_diameter_mm == (None if core is None else pytest.approx(core))
    assert found.winding_diameter_mm == (None if core is None else pytest.approx(0.3 * 1.1684))
    if core is None:
        heavier = found.linear_density_g_m / 6.69  # type: ignore[operator]
        assert found.inharmonicity == pytest.approx(1e-4 * (1.1684 / 1.14) ** 4 / heavier)
    assert problems(preset) == []


FULL = (
    "action_bass_mm = 1.4\naction_treble_mm = 1.1\nrelief_mm = 0.15\nboard_radius_mm = 240\n" + SPREADS
    + f'\nfret_heights_mm = {[1.1] * COUNT}\nstrings = ["XLB100", "XLB080", "XLB065", "XLB045"]'
)  # fmt: skip


def note_of(preset: Preset, key: int = 43) -> np.ndarray:
    engine = Engine([preset], only_notes=[{key}], limiter=False)
    engine.prepare(44100, 1024)
    out = np.zeros((8192, 2))
    engine.process(make_events([(0, NOTE_ON, 0, key, 127)]), out)
    return out


def test_a_neck_by_setup_sounds_and_its_relief_is_heard() -> None:
    preset = made(FULL)
    assert problems(preset) == []
    sound = note_of(preset)
    assert np.isfinite(sound).all() and np.abs(sound).max() > 1e-3
    other = preset.with_setting("setup.relief_mm", "0.1")
    assert other.setup is not None and other.setup.relief_mm == 0.1
    assert np.abs(note_of(other) - sound).max() > 1e-6
    assert np.array_equal(note_of(parse_preset(preset_text(preset), "again")), sound)


def test_the_page_changes_the_table_and_keeps_the_rest_of_the_file() -> None:
    text = text_of("action_bass_mm = 2.0 # with the capo on\nrelief_mm = 0.1")
    changed, preset = apply(text, [("setup.relief_mm", 0.2), ("setup.action_treble_mm", 1.7)], "x")
    assert "# with the capo on" in changed and tomllib.loads(changed)["setup"] == {
        "action_bass_mm": 2.0, "relief_mm": 0.2, "action_treble_mm": 1.7
    }  # fmt: skip
    assert preset.setup is not None and preset.setup.actions_mm == (2.0, 1.7)
    grown, _ = apply(text_of(FULL), [("obstacle.count", 24)], "x")
    assert tomllib.loads(grown)["setup"]["fret_heights_mm"] == [1.1] * 24
    with pytest.raises(PresetError, match=r"setup\.action_bass_mm"):
        apply(text, [("setup.action_bass_mm", None)], "x")


def test_the_page_shows_the_table_and_no_handles_of_single_frets() -> None:
    preset = made(FULL)
    shown = {entry["path"]: entry for entry in describe(preset)}
    assert shown["setup.action_bass_mm"]["required"] and shown["setup.fret_heights_mm"]["kind"] == "list"
    assert not {"obstacle.action_12th_mm", "obstacle.heights_mm", "obstacle.relief_mm", "obstacle.nut_height_mm"} & set(
        shown
    )
    drawing = draw(preset, 45)
    assert drawing["playable"] and len(drawing["points"]) == COUNT
    assert all(point["drag"] == {"x": None, "height": None} for point in drawing["points"])
    action = next(point["height"] for point in drawing["points"] if point["index"] == 11)
    assert action == pytest.approx(1e3 * heights(preset, drawing["table"])[11], abs=1e-4)
    board = draw(made("action_bass_mm = 1.5", BOARD), 43)
    assert board["board"] and not any(
        path.startswith("setup.fall") for path in {e["path"] for e in describe(made("action_bass_mm = 1.5", BOARD))}
    )


def test_the_fit_of_frets_finds_the_action_of_its_string() -> None:
    preset = made("action_bass_mm = 2.4\naction_treble_mm = 1.8\nrelief_mm = 0.2")
    assert [action_mm(preset, index) for index in range(4)] == pytest.approx([2.4, 2.2, 2.0, 1.8])
    assert action_settings(preset, 2.1, 2) == [("setup.action_bass_mm", 2.5), ("setup.action_treble_mm", 1.9)]
    assert action_mm(with_action(preset, 1.5, 3), 0) == pytest.approx(2.1)
    with pytest.raises(ValueError, match=r"setup\.action_treble_mm must stay above 0"):
        with_action(preset, 0.5, 0)
    model = FretModel(preset, 2)
    assert model.action_mm == pytest.approx(2.0) and model.preset.setup is None
    shape = model._lying(1.7).obstacle
    assert isinstance(shape, FretsObstacle) and shape.heights_mm[11] == pytest.approx(-1.7)
    assert shape.heights_mm[0] == pytest.approx(-0.4)  # at the nut nothing changes
    only_names = made('strings = ["XLB100", "XLB080", "XLB065", "XLB045"]', FRETS + "\naction_12th_mm = 2")
    assert action_settings(only_names, 1.5, 1) == [("obstacle.action_12th_mm", 1.5)]


def test_a_plugin_turns_the_action_of_both_sides() -> None:
    preset = made("action_bass_mm = 2.4\naction_treble_mm = 1.8")
    numbers = {each.id: each for each in setup_of(0, preset)}
    assert numbers["setup.action"].default == 2.4 and "string.gauge" in numbers and "obstacle.action" not in numbers
    lower = set_up(preset, {"setup.action": 2.0})
    assert lower.setup is not None and lower.setup.actions_mm == pytest.approx((2.0, 1.4))
    assert "string.gauge" not in {each.id for each in setup_of(0, made(FULL))}


def test_a_bank_of_it_can_be_made(tmp_path: Path) -> None:
    preset = made("action_bass_mm = 2.0", notes="G2")
    file = tmp_path / "neck.jawari"
    file.write_bytes(bankfile.bank((preset,), [44100.0]))
    _, kept = bankfile.recipe_of(file)
    assert kept.presets == (preset,)


def test_the_shipped_bass_is_played_with_a_luthiers_numbers() -> None:
    data: dict[str, Any] = load_preset("fretted-bass").model_dump(exclude_unset=True)
    del data["obstacle"]["heights_mm"]
    data["setup"] = {"action_bass_mm": 2.4, "action_treble_mm": 2.0, "relief_mm": 0.3}
    preset = Preset.model_validate(data)
    assert problems(preset) == []
    table = preset.string[0]
    assert (
        measured_of(preset.with_measured(load_preset("fretted-bass").measured), table, 28, 41.2, "standard", 44100.0) is None
    )


def test_the_example_of_the_page_is_a_guitar() -> None:
    page = (Path(__file__).resolve().parents[1] / "docs" / "presets.md").read_text("utf-8")
    block = page[page.index("    [obstacle]\n") : page.index("| key | meaning")]
    example = tomllib.loads("\n".join(line.removeprefix("    ") for line in block.splitlines()))
    preset = Preset.model_validate(load_preset("electric-guitar").model_dump(exclude_unset=True) | example)
    assert problems(preset) == [] and preset.setup is not None
    assert -1e3 * heights_of(preset, 0)[11] == pytest.approx(1.9) and -1e3 * heights_of(preset, 5)[11] == pytest.approx(1.5)
    keys = set(
        re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`[^|]+)\|", page[page.index("| key | meaning") :], re.MULTILINE)))
    )
    assert keys == set(Setup.model_fields)


def heights_of(preset: Preset, index: int) -> np.ndarray:
    """As `heights`, of a string of another length."""
    table = preset.string[index]
    return np.array(open_string(preset, table, table.notes[0])[1].heights_m)
