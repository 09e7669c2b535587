"""Plans beside presets: what is read and written, by what a string is known again, when the law stands in."""

from __future__ import annotations

import fnmatch
import json
import pickle
import tomllib
from pathlib import Path

import pytest

from synth.dsp.rates import MAXIMUM_FACTOR
from synth.instrument.compile import compile_preset, describe_plan, has_plan, measured_of
from synth.instrument.fingerprints import fingerprint, strokes
from synth.instrument.planfile import (
    DOWN_SEMITONES,
    UP_SEMITONES,
    VERSION,
    Measured,
    MeasuredPlan,
    MeasuredString,
    PlanError,
    parse,
    path_of,
    read_beside,
    text_of,
)
from synth.instrument.preset import Preset, PresetError, list_presets, load_preset, parse_preset, preset_folder, read_preset
from synth.plugin import recipe
from synth.plugin.setup import set_up

ROOT = Path(__file__).resolve().parents[1]
PRESET = """
format = 2
name = "mine"
[[string]]
notes = "G2"
length_m = 0.95
diameter_mm = {{ C2 = 0.5, C3 = 0.3 }}
density_kg_m3 = 7850
youngs_modulus_gpa = 200
{string}
[obstacle]
kind = "bridge"
distance_mm = 6.0
jiva_um = 3.0
[pluck]
displacement_mm = {displacement}
{rest}
"""


def make(string: str = "", displacement: str = "3.0", rest: str = "") -> Preset:
    return parse_preset(PRESET.format(string=string, displacement=displacement, rest=rest), "mine")


def row(preset: Preset, rate_hz: float = 88200.0, highest_hz: float = 9000.0, pitch_hz: float = 98.0) -> MeasuredString:
    found = Measured(rate_hz, highest_hz, 70, {"e": 0.012, "heard_db": 0.5})
    return MeasuredString('a \\ " ü', "G2", pitch_hz, fingerprint(preset, preset.string[0], 43), {"standard": found})


def plan(preset: Preset, **more: float) -> MeasuredPlan:
    return MeasuredPlan((row(preset, **more),), frozenset(strokes(preset)))


def known(preset: Preset, of: MeasuredPlan) -> bool:
    return measured_of(preset.with_measured(of), preset.string[0], 43, 98.0, "standard", 44100.0) is not None


def test_what_is_written_is_read() -> None:
    made = plan(make())
    again = parse(text_of(made), "x")
    assert (again.strings, again.strokes, again.version) == (made.strings, made.strokes, made.version)
    assert parse(text_of(MeasuredPlan()), "x").strings == ()


@pytest.mark.parametrize(
    ("was", "now", "words"),
    [
        ("format = 1", "format = 2", "format: must be 1, got 2"),
        ("format = 1", "", "format: must be a whole number, got nothing"),
        ("measured = 1", "measured = true", "measured: must be a whole number, got True"),
        (
            "measured = 1",
            "measured = 1\nvelocities = [0, 40]",
            "velocities: must be a list of whole numbers from 1 to 127, got [0, 40]",
        ),
        ('["plain"]', "[3]", "strokes: must be a list of text, got [3]"),
        ("pitch_hz = 98", "pitch_hz = 0", "string.0.pitch_hz: must be a number from 1 to 1e9, got 0"),
        ("rate_hz = 88200", 'rate_hz = "fast"', "string.0.standard.rate_hz: must be a number from 1 to 1e9, got 'fast'"),
        ("modes = 70", "modes = 0", "string.0.standard.modes: must be at least 1, got 0"),
        ("e = 0.012", "e = nan", "string.0.standard.e: must be a number from 0 to 1e9, got nan"),
        ('note = "G2"', "", "string.0.note: must be text, got nothing"),
        ("standard = {", "standard = 3 #", "string.0.standard: must be a table, got 3"),
        ("[[string]]", "[string", "not valid TOML"),
    ],
)
def test_a_broken_plan_says_where(tmp_path: Path, was: str, now: str, words: str) -> None:
    text = text_of(plan(make()))
    assert was in text
    with pytest.raises(PlanError) as told:
        parse(text.replace(was, now, 1), "mine.plan")
    assert str(told.value).startswith("mine.plan: ") and words in str(told.value)
    assert "make it again with `synth plan PRESET --measure-plan`" in str(told.value) and "\n" not in str(told.value)
    (tmp_path / "mine.toml").write_text(PRESET.format(string="", displacement="3.0", rest=""))
    (tmp_path / "mine.plan").write_text(text.replace(was, now, 1))
    with pytest.raises(PresetError, match=r"mine\.plan"):
        load_preset(str(tmp_path / "mine.toml"))


def test_a_plan_that_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "mine.plan").write_bytes(b"\xff\xfe")
    with pytest.raises(PlanError, match=r"mine\.plan: not a text file in UTF-8"):
        read_beside(tmp_path / "mine.toml")


def test_what_moves_a_string_decides_whether_a_plan_is_its() -> None:
    preset = make()
    of = plan(preset)
    assert known(preset, of)
    for same in (
        make(string='name = "Pa"\ngain_db = 3.0\ncents = 20.0'),
        make(rest='[output]\nkind = "pickup"\n[mapping]\npolyphony = 3\n[damping]\nring_on = true'),
        make(rest="[hand]\nplace_mm = 2.0\n[tuning]\na4_hz = 432.0\ncontact_cents = { G2 = 2.0 }"),
        make(displacement="{ G2 = 3, C4 = 1 }"),
        preset.with_setting("tags", '["loud"]'),
    ):
        assert known(same, of)
    for other in (
        make(string="viscoelastic_loss = 1e-3"),
        make(string="tension_modulation = true"),
        make(displacement="3.1"),
        make(rest="[polarisation]\npluck_deg = 40.0"),
        make(rest="[[nut]]\nfrequency_hz = 150.0\nq = 0.7\nmass_kg = 0.1"),
        preset.with_setting("obstacle.jiva_um", "4"),
        preset.with_setting("string.0.length_m", "0.9"),
        make(rest="[articulations.near]\ncontroller = 20\nposition = 0.05"),
    ):
        assert not known(other, of)


def test_strokes_count_and_the_ways_to_them_do_not() -> None:
    two = make(rest="[articulations.near]\ncontroller = 20\nposition = 0.05")
    of = plan(two)
    assert known(make(rest="[articulations.near]\ncontroller = 21\nposition = 0.05"), of)
    assert known(make(), of)  # what is left out plays nothing new
    assert not known(make(rest="[articulations.near]\ncontroller = 20\nposition = 0.06"), of)


def test_a_plan_of_another_version_does_not_count() -> None:
    preset = make()
    assert not known(preset, MeasuredPlan((row(preset),), frozenset(strokes(preset)), version=VERSION + 1))


def test_a_plan_is_taken_and_the_law_where_there_is_none() -> None:
    preset = make()
    (law,) = compile_preset(preset).strings
    with_plan = preset.with_measured(plan(preset))
    (string,) = compile_preset(with_plan).strings
    found = string.positions[0].plan
    assert (found.factor, found.rate_hz, found.measured) == (2, 88200.0, True)
    assert string.positions[0].own == found.modes < law.positions[0].plan.modes
    hz = string.positions[0].omega[: found.modes + 1] / (2.0 * 3.141592653589793)
    assert hz[found.modes - 1] < 9000.0 < law.positions[0].omega[found.modes] / (2.0 * 3.141592653589793)
    assert not law.positions[0].plan.measured
    for options in (
        {"quality": "draft"},
        {"quality": "reference"},
        {"scheme": "moreau-jean"},
        {"internal_rate_hz": 3 * 44100.0},
    ):
        mine, his = (compile_preset(each, **options).strings[0].positions[0].plan for each in (with_plan, preset))
        assert mine == his and not mine.measured


def test_the_rate_is_kept_at_other_output_rates() -> None:
    preset = make()
    preset = preset.with_measured(plan(preset))
    factors = [compile_preset(preset, rate_hz=rate).strings[0].factor for rate in (44100.0, 48000.0, 88200.0, 96000.0)]
    assert factors == [2, 2, 1, 1]
    far = make().with_measured(plan(make(), rate_hz=(MAXIMUM_FACTOR + 1) * 44100.0))
    assert not compile_preset(far).strings[0].positions[0].plan.measured


def test_strings_that_share_a_body_take_steps_that_divide_a_frame() -> None:
    """A rate of three steps takes four; one of more than a frame has leaves the string to the law."""
    body = "[[body.mode]]\nfrequency_hz = 150\nq = 10\nmass_kg = 1.0\nshape = [1.0]"
    preset = make(rest=f'[output]\nkind = "body"\n{body}')
    law = compile_preset(preset).strings[0].positions[0].plan
    taken = []
    for times in (1, 3, 4, 9):
        found = plan(preset, rate_hz=times * 44100.0)
        made = compile_preset(preset.with_measured(found)).strings[0].positions[0].plan
        taken.append((made.factor, made.measured))
        assert not made.measured or made.modes < law.modes
    assert taken == [(1, True), (4, True), (4, True), (law.factor, False)]
    with_plan = preset.with_measured(plan(preset, rate_hz=2 * 44100.0))
    assert compile_preset(with_plan, rate_hz=96000.0).strings[0].positions[0].plan.factor == 1
    mine = compile_preset(with_plan, internal_rate_hz=4 * 44100.0).strings[0].positions[0].plan
    assert mine.factor == 4 and not mine.measured


def test_a_string_tuned_up_takes_a_rate_in_proportion() -> None:
    string = row(make())
    assert string.at(98.0, "standard") == string.at(80.0, "standard") == string.qualities["standard"]
    assert string.at(98.0 * 2.0 ** (0.4 / 12.0), "standard") == string.qualities["standard"]
    higher = string.at(98.0 * 1.2, "standard")
    assert higher is not None
    assert (higher.rate_hz, higher.highest_hz) == pytest.approx((88200.0 * 1.2, 9000.0 * 1.2))
    for off, there in ((0.1, False), (-0.1, True)):
        up, down = (98.0 * 2.0 ** (each / 12.0) for each in (UP_SEMITONES + off, -DOWN_SEMITONES - off))
        assert [string.at(hz, "standard") is not None for hz in (up, down)] == [there, there]


def test_what_is_said_of_a_plan() -> None:
    preset = make()
    told = describe_plan(preset)
    assert told["strings"][0]["plan"] == "law" and "--measure-plan measures these" in told["text"]
    told = describe_plan(preset.with_measured(plan(preset)))
    assert (
        told["strings"][0]["plan"] == "measured"
        and "up to 9 kHz; e < 0.1 over 3 s; measured on this string: e 0.012, third" in told["text"]
    )
    assert "law" not in told["text"]
    other = make(displacement="2").with_measured(plan(preset))
    assert "the plan beside the preset was measured for another version of it" in describe_plan(other)["text"]
    stroke = make(rest="[articulations.near]\ncontroller = 20\nposition = 0.05").with_measured(plan(preset))
    assert "does not cover all of its strokes" in describe_plan(stroke)["text"]
    draft = describe_plan(preset.with_measured(plan(preset)), quality="draft")["text"]
    assert "no cheaper plan keeps the promise with a margin" in draft
    for options in ({"quality": "reference"}, {"scheme": "moreau-jean"}, {"internal_rate_hz": 44100.0}):
        assert "law" not in describe_plan(preset, **options)["text"]


def test_a_plan_goes_along_with_its_preset() -> None:
    preset = make()
    preset = preset.with_measured(plan(preset))
    for other in (
        preset.with_setting("pluck.position", "0.2"),
        pickle.loads(pickle.dumps(preset)),
        preset.model_copy(update={"title": "Mine"}),
        set_up(preset, {"string.length": 1.1}),
        recipe.read(recipe.written([preset], None, {})).presets[0],
    ):
        assert other.measured.strings == preset.measured.strings
    assert preset == make()  # and is no part of it
    old = json.loads(recipe.written([preset], None, {}))
    del old["plans"]
    assert recipe.read(json.dumps(old).encode()).presets[0].measured.strings == ()


def test_presets_have_plans_of_their_own_strings() -> None:
    """Every plan that comes with the program lies beside a preset, and is of its strings as they are."""
    plans = {path.stem for path in preset_folder().glob("*.plan")}
    presets = {preset.name: preset for preset in list_presets()}
    assert {"jawari-harp", "tanpura-light"} <= plans <= presets.keys()
    for name in plans:
        preset = presets[name]
        assert preset.measured.version == VERSION and preset.measured.strokes.issuperset(strokes(preset)), name
        assert path_of(preset_folder() / f"{name}.toml").read_text(encoding="utf-8") == text_of(preset.measured), name
        for table in preset.string:
            for note in range(table.notes[0], table.notes[1] + 1):
                known = preset.measured.string(fingerprint(preset, table, note)) is not None
                assert known == has_plan(preset, table, note), (name, note)
        assert "another version" not in describe_plan(preset)["text"]
    assert parse_preset(read_preset("jawari-harp"), "jawari-harp").measured.strings == ()


def test_plans_are_packaged_with_the_presets() -> None:
    built = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["hatch"]["build"]["targets"]
    assert built["wheel"]["force-include"] == {"presets": "synth/_presets"} and "/presets" in built["sdist"]["include"]
    ignored = (ROOT / ".gitignore").read_text(encoding="utf-8").split()
    for pattern in [*built["wheel"]["exclude"], *ignored]:
        assert not fnmatch.fnmatch("tanpura-light.plan", pattern), pattern
