"""From a preset to the arrays that sound."""

from __future__ import annotations

import math

import numpy as np
import pytest

from synth.instrument.compile import compile_preset, compile_string, describe_plan, make_string, note_frequency, static_state
from synth.instrument.fingerprints import fingerprint
from synth.instrument.preset import Preset, PresetError, parse_preset
from synth.physics.modes import static_compliance
from synth.units import cents, midi_to_hz

STRING = """
[[string]]
name = "{name}"
notes = "{notes}"
length_m = 0.9
diameter_mm = 0.4
density_kg_m3 = 7850
youngs_modulus_gpa = 200
viscoelastic_loss = 4.5e-3
thermoelastic_q_inverse = 2.03e-4
{more}
"""
PLUCK = "[pluck]\ndisplacement_mm = 2.0\nposition = 0.3\n"
NECK = '[obstacle]\nkind = "frets"\ncount = 14\naction_12th_mm = 2.2\nnut_height_mm = 0.5\nrelief_mm = 0.2\n'
BRIDGE = '[obstacle]\nkind = "bridge"\ndistance_mm = 6\njiva_um = {jiva}\n'


def make(tables: str = "", notes: str = "G2", more: str = "", top: str = "") -> Preset:
    return parse_preset(
        f'format = 2\nname = "x"\n{top}\n{STRING.format(name="S", notes=notes, more=more)}{PLUCK}{tables}', "x"
    )


def first_mode_hz(position) -> float:
    return float(position.omega[0]) / (2.0 * math.pi)


def test_every_position_is_tuned_on_its_fret():
    (string,) = compile_preset(make(NECK), quality="draft").strings
    assert [p.note for p in string.positions] == list(range(43, 58))
    assert [p.fret for p in string.positions] == list(range(15))
    for p in string.positions:
        assert abs(cents(first_mode_hz(p), midi_to_hz(p.note))) < 1e-6
        assert p.length_m == pytest.approx(0.9 * 2.0 ** (-p.fret / 12.0), rel=1e-12)
        assert p.eta.size == 14 - p.fret and np.all(p.eta < 0.0)
        assert p.shapes.shape == (p.eta.size, p.omega.size)
        assert p.plan.factor == string.factor
    # a fretted string of the same wire: its tension is the open one's but for what stiffness and temper take
    tensions = np.array([p.tension_n for p in string.positions])
    assert np.abs(tensions / tensions[0] - 1.0).max() < 0.02
    heights = [p.rest_height_m for p in string.positions]
    assert heights[0] == 0.0 and np.all(np.diff(heights[1:]) < 0.0)


def test_tuning_of_the_preset_counts():
    table = make(more="cents = 7.0", top="[tuning]\na4_hz = 432\noffset_cents = -30")
    (string,) = compile_preset(table).strings
    assert abs(cents(first_mode_hz(string.positions[0]), midi_to_hz(43, 432.0)) - (-23.0)) < 1e-6
    scale = np.full(128, 100.0)
    scale[43] = 98.7
    (string,) = compile_preset(make(), note_hz=scale).strings
    assert first_mode_hz(string.positions[0]) == pytest.approx(98.7, rel=1e-9)
    assert note_frequency(make(), make().string[0], 43, None) == pytest.approx(midi_to_hz(43))


def test_contact_shift_is_taken_off_the_string():
    plain = compile_preset(make(BRIDGE.format(jiva=3))).strings[0].positions[0]
    shifted = (
        compile_preset(make(BRIDGE.format(jiva=3), top="[tuning]\ncontact_cents = {G2 = 12.0}")).strings[0].positions[0]
    )
    assert cents(first_mode_hz(shifted), first_mode_hz(plain)) == pytest.approx(-12.0, abs=1e-6)


def test_bridge_stands_before_the_saddle_below_the_thread():
    position = compile_preset(make(BRIDGE.format(jiva=3))).strings[0].positions[0]
    assert position.eta == pytest.approx([-3e-6])
    n = np.arange(1, position.own + 1)
    shape = math.sqrt(2 / 0.9) * np.sin(n * math.pi * (0.9 - 0.006) / 0.9)
    assert np.allclose(position.shapes[0, : position.own], shape, atol=1e-9)
    assert 0 < position.omega.size - position.own <= 2  # lumped
    assert not position.q_rest.any()
    assert position.residual[0, 0] > 0.0


def test_residual_compliance_belongs_to_exact_hold():
    for scheme in ("moreau-jean", "moreau-jean-filtered"):
        position = compile_preset(make(BRIDGE.format(jiva=3)), scheme=scheme).strings[0].positions[0]
        assert not position.residual.any()


@pytest.mark.parametrize("scheme", ["exact-hold", "moreau-jean"])
def test_a_pressed_string_rests_on_the_bridge(scheme):
    position = compile_preset(make(BRIDGE.format(jiva=-40)), scheme=scheme).strings[0].positions[0]
    u = float(position.shapes[0] @ position.q_rest)
    force = position.mu * position.omega[0] ** 2 * position.q_rest[0] / position.shapes[0, 0]
    assert force > 0.0
    assert u + position.residual[0, 0] * force == pytest.approx(40e-6, rel=1e-9)
    if scheme == "exact-hold":  # modes and residual compliance together are the statics in closed form
        preset = make(BRIDGE.format(jiva=-40))
        string = make_string(preset, preset.string[0], 43, midi_to_hz(43))
        assert force == pytest.approx(40e-6 / static_compliance(string, 0.894, 0.894), rel=1e-6)


def test_static_state_touches_only_where_it_presses():
    n = np.arange(1, 400)
    omega = n * 600.0
    shapes = math.sqrt(2.0) * np.sin(np.outer([0.3, 0.6, 0.8], n) * math.pi)
    eta = np.array([1e-3, -1e-3, 1e-3])
    q = static_state(omega, 1e-3, shapes, eta, np.zeros((3, 3)))
    gap = shapes @ q - eta
    assert abs(gap[0]) < 1e-12 and abs(gap[2]) < 1e-12 and gap[1] > 1e-3
    assert not static_state(omega, 1e-3, shapes, -np.abs(eta), np.zeros((3, 3))).any()


def test_every_note_of_a_range_is_a_string():
    part = compile_preset(make(notes="C3-F3"))
    assert [s.positions[0].note for s in part.strings] == list(range(48, 54))
    assert all(len(s.positions) == 1 for s in part.strings)
    few = compile_preset(make(notes="C3-F3"), only_notes={50, 99})
    assert [s.positions[0].note for s in few.strings] == [50]
    assert [s.positions[0].note for s in compile_preset(make(NECK), only_notes={50}).strings] == [43]
    assert compile_preset(make(), only_notes=set()).strings == ()


def test_single_frets_of_a_neck():
    whole = compile_preset(make(NECK), only_notes={45}).strings[0]
    part = compile_preset(make(NECK), only_notes={45}, every_fret=False).strings[0]
    assert (part.places, part.open_note) == (whole.places, whole.open_note) == (len(whole.positions), 43)
    (alone,) = part.positions
    same = whole.positions[2]
    assert (alone.note, alone.fret) == (same.note, same.fret) == (45, 2)
    assert all(np.array_equal(a, b) for a, b in zip(vars(alone).values(), vars(same).values(), strict=True))


def test_pluck_force_draws_the_open_string_as_far_as_asked():
    string = compile_preset(make()).strings[0]
    n = np.arange(1, string.positions[0].omega.size + 1)
    shape = math.sqrt(2 / 0.9) * np.sin(n * math.pi * 0.7)
    p = string.positions[0]
    drawn = string.pluck_force_n * float(shape @ (shape / (p.mu * p.omega**2)))
    assert drawn == pytest.approx(2e-3, rel=0.01)  # less stiffness and what the modes above leave out


def test_force_on_the_bridge_of_a_drawn_string():
    """The output of a static triangle is its slope at the saddle times the tension."""
    part = compile_preset(make('[output]\nkind = "force"\n'))
    string, p = part.strings[0], part.strings[0].positions[0]
    n = np.arange(1, p.omega.size + 1)
    kappa = n * math.pi * 0.05 / 4
    shape = math.sqrt(2 / 0.9) * np.sin(n * math.pi * 0.7) * np.sinc(kappa / math.pi) ** 2
    q = string.pluck_force_n * shape / (p.mu * p.omega**2)
    assert abs(p.wq @ q) == pytest.approx(string.pluck_force_n * 0.7, rel=0.01)


def test_gain_is_applied_once_to_each_kind():
    for kind in ("force", "displacement", "velocity", "pickup", "flux"):
        plain, loud = (
            compile_preset(make(f'[output]\nkind = "{kind}"\nposition = 0.1\ngain_db = {g}\n')).strings[0].positions[0]
            for g in (0.0, 20.0)
        )
        linear = "wv" if kind in ("velocity", "pickup") else "wq"
        assert np.allclose(getattr(loud, linear), 10.0 * getattr(plain, linear))
        if kind == "pickup":
            assert np.array_equal(loud.wq, plain.wq)


def test_measured_modes_move_with_the_tuning():
    table = make(more="measured_frequencies_hz = [100.0, 202.0]\nmeasured_decay_rates = [1.5, 2.5]")
    p = compile_preset(table).strings[0].positions[0]
    assert p.omega[0] == pytest.approx(2 * math.pi * midi_to_hz(43))
    assert p.omega[1] / p.omega[0] == pytest.approx(2.02)
    assert p.sigma[:2] == pytest.approx([1.5, 2.5])


def test_unevenness_belongs_to_a_string_and_both_of_its_directions():
    two = NECK + "[polarisation]\ndetuning_cents = 0.7\nloss_ratio = 1.2\n"
    even, uneven = (
        compile_preset(make(two, notes="G2-A2", more=f"unevenness_cents = {c}"), quality="draft").strings for c in (0, 2)
    )
    off = []
    for before, after in zip(even, uneven, strict=True):
        for fret in (0, 12):
            a, b = before.positions[fret], after.positions[fret]
            first, across = (1200.0 * np.log2(y[:20] / x[:20]) for x, y in ((a.omega, b.omega), (a.across[0], b.across[0])))
            assert first[0] == 0.0 and first == pytest.approx(across, abs=1e-6)
            off.append(np.sqrt((first[1:] ** 2).mean()))
    assert off == pytest.approx([2.0, 2.0 * math.sqrt(2.0)] * (len(off) // 2), rel=0.5)
    one, other = (string.positions[0].omega[:20] / string.positions[0].omega[0] for string in uneven[:2])
    assert not np.allclose(one, other, rtol=1e-4)
    again = compile_preset(make(two, notes="G2-A2", more="unevenness_cents = 2"), quality="draft").strings
    assert np.array_equal(again[1].positions[5].omega, uneven[1].positions[5].omega)
    with pytest.raises(PresetError, match="unevenness_cents: must lie between 0 and 10, got 11"):
        make(more="unevenness_cents = 11")


def test_a_fingerprint_is_older_than_unevenness():
    plain, even, uneven = (make(more=more) for more in ("", "unevenness_cents = 0", "unevenness_cents = 1"))
    prints = [fingerprint(each, each.string[0], 43) for each in (plain, even, uneven)]
    assert prints[0] == prints[1] == "17b4af1a9cad4eec" and prints[2] != prints[0]


def test_errors_name_preset_string_and_cause():
    high = NECK.replace(
        "action_12th_mm = 2.2\nnut_height_mm = 0.5\nrelief_mm = 0.2",
        f"heights_mm = [{', '.join(['-1.0'] * 13 + ['0.2'])}]",
    )
    with pytest.raises(PresetError, match=r"x: string S: fret 14 .* below the string at rest"):
        compile_preset(make(high))
    with pytest.raises(PresetError, match=r"x: string S: .*internal rate must be"):
        compile_preset(make(), internal_rate_hz=50000.0)
    outside = '[obstacle]\nkind = "points"\npositions_mm = [100, 950]\nheights_mm = [-1, -1]\n'
    with pytest.raises(PresetError, match=r"x: string S: position of point 2 must be less than .* 0\.9 m, got 0\.95 m"):
        compile_preset(make(outside))
    with pytest.raises(ValueError, match="scheme"):
        compile_preset(make(), scheme="leapfrog")


@pytest.mark.parametrize(
    ("table", "key", "what"),
    [
        ("pluck", "width_mm", ""),
        ("pluck", "width_hard_mm", ""),
        ("output", "aperture_mm", 'kind = "pickup"\nposition = 0.5'),
    ],
)
def test_nothing_is_as_wide_as_the_string(table, key, what):
    def short(width):
        text = f"[{table}]\n{what}\n{key} = {width}\n"
        pluck = "displacement_mm = 0.1\nposition = 0.5\n"
        text = text + pluck if table == "pluck" else f"[pluck]\n{pluck}{text}"
        string = STRING.format(name="S", notes="C7", more="").replace("length_m = 0.9", "length_m = 0.05")
        return parse_preset(f'format = 2\nname = "x"\n{string}{text}', "x")

    with pytest.raises(
        PresetError, match=rf"x: string S: {table}\.{key} must be at most 50 mm, the string's length, got 60"
    ):
        compile_preset(short(60), quality="draft")
    assert len(compile_preset(short(50), quality="draft").strings) == 1


def test_plan_is_described_in_words_and_values():
    plan = describe_plan(make(NECK), 50, quality="draft")
    (row,) = plan["strings"]
    assert row["fret"] == 7 and row["contacts"] == 7 and row["note"] == "D3"
    assert row["frequency_hz"] == pytest.approx(midi_to_hz(50))
    assert "S D3 fret 7" in plan["text"] and row["reason"] in plan["text"]
    assert len(describe_plan(make(notes="C3-C4"))["strings"]) == 3
    with pytest.raises(PresetError, match="no string plays C1; its notes lie in G2-A3"):
        describe_plan(make(NECK), 24)


def test_one_string_alone():
    preset = make(NECK)
    alone = compile_string(preset, preset.string[0], 43, quality="draft", rate_hz=44100.0)
    (whole,) = compile_preset(preset, quality="draft").strings
    assert np.array_equal(alone.positions[5].coef, whole.positions[5].coef)
