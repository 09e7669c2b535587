"""Plans that are measured of a preset: promises kept in other strokes than those measured, what cannot be measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from synth import cli
from synth.fit.plan_measuring import MARGIN, Ended, measure_plan, measured_strings, misses, other_strokes
from synth.fit.plan_strings import RATE_HZ, ROLLING_S, OneString, PlanStroke, StringTogether
from synth.instrument.compile import compile_preset
from synth.instrument.plan import BRIDGE_ERROR
from synth.instrument.planfile import PROMISED
from synth.instrument.preset import Preset, PresetError, load_preset, parse_preset
from tests.test_planfile import PRESET

#: velocities and places that no plan was made from
STROKES = [PlanStroke(30), PlanStroke(90), PlanStroke(110, 0.8)]


@pytest.mark.parametrize(
    ("name", "notes"),
    [("tanpura-light", {36, 48}), ("jawari-harp", {33, 52}), ("jawari-harp", {84})],
)
def test_plans_keep_what_is_promised_in_other_strokes(name: str, notes: set[int]) -> None:
    preset = load_preset(name)
    found = list(misses(preset, STROKES, notes))
    assert {each.quality for each in found} >= {"draft", "standard"}
    assert all(each.worst is not None for each in found)
    missed = {f"{each.string} {each.quality} {each.stroke}": each.worst for each in found if not (each.worst or 0.0) < 1.0}
    assert not missed


def test_plans_of_strings_that_share_a_body_hold_in_the_whole_instrument() -> None:
    """A stroke that the plan was not made from, in the tanpura as it is played; half of its modes do not keep it."""
    preset = load_preset("tanpura")
    (one,) = [each for each in measured_strings(preset) if each.label == "Sa 1"]
    together, stroke = StringTogether(one, preset), PlanStroke(95)
    row = preset.measured.string(one.fingerprint)
    assert row is not None
    found = row.qualities["standard"]
    factor = round(found.rate_hz / RATE_HZ)
    assert factor <= one.law("standard")
    ((_, ratios, figures),) = together.figures("standard", one.notes, stroke, found)
    assert max(ratios.values()) < 1.0 and 0.0 < figures["e"] < BRIDGE_ERROR["standard"]
    ((_, ratios, _),) = together.figures("standard", one.notes, stroke, replace(found, highest_hz=0.3 * found.highest_hz))
    assert max(ratios.values()) > 1.0


@pytest.mark.parametrize("semitones", [-11, 6])
def test_plans_hold_for_strings_tuned_lower_and_higher(semitones: int) -> None:
    tanpura = load_preset("tanpura-light")
    retuned = tanpura.string[0].model_copy(update={"cents": 100.0 * semitones})
    found = list(misses(tanpura.model_copy(update={"string": (retuned,)}), STROKES[1:2]))
    assert {each.quality for each in found} == set(PROMISED)
    assert all(each.worst is not None and each.worst < 1.0 for each in found)


def test_a_plan_too_small_is_seen_to_miss() -> None:
    """Half of the modes of a plan miss what it keeps: the check can fail."""
    preset = load_preset("tanpura-light")
    few = [
        replace(each, qualities={key: replace(q, highest_hz=0.4 * q.highest_hz) for key, q in each.qualities.items()})
        for each in preset.measured.strings
    ]
    found = list(misses(preset.with_measured(replace(preset.measured, strings=tuple(few))), STROKES[1:2], {43}))
    assert len(found) == 3 and all(each.worst is not None and each.worst > 1.0 for each in found)


def test_a_soft_note_does_not_fall_asleep_while_it_is_measured() -> None:
    """Of a string that touches nothing the softest note is as long as a harder one."""
    preset = load_preset("jazz-guitar")
    one = next(each for each in measured_strings(preset) if each.label == "E2")
    note = one.note + 18
    ends = []
    for velocity in (12, 40):
        ((_, u),) = one.runs([note], PlanStroke(velocity), 4, 16000.0)
        ends.append(abs(u[-RATE_HZ // 20 :]).max() / abs(u).max())
    assert ends[0] == pytest.approx(ends[1], rel=0.2)


def test_plans_cost_less_than_the_law() -> None:
    preset = load_preset("tanpura-light")
    for quality in PROMISED:
        for mine, law in zip(
            compile_preset(preset, quality=quality).strings,
            compile_preset(parse_again(preset), quality=quality).strings,
            strict=True,
        ):
            costs = [each.factor * each.positions[0].plan.modes for each in (mine, law)]
            assert costs[0] < costs[1] or mine.positions[0].plan == law.positions[0].plan


def parse_again(preset: Preset) -> Preset:
    """The preset as the law plans it."""
    from synth.instrument.planfile import MeasuredPlan

    return preset.with_measured(MeasuredPlan())


def small() -> Preset:
    return parse_preset(PRESET.format(string="viscoelastic_loss = 0.02", displacement="3.0", rest=""), "small")


def test_a_plan_is_measured_and_told_of() -> None:
    told: list[float] = []
    preset = small()
    plan = measure_plan(preset, lambda done: told.append(done) or True)
    assert told == sorted(told) and 0.0 < told[0] and told[-1] == pytest.approx(1.0)
    (string,) = plan.strings
    assert string.note == "G2" and set(string.qualities) == set(PROMISED)
    for quality, found in string.qualities.items():
        assert found.figures["e"] <= MARGIN * BRIDGE_ERROR[quality]
    rates = [string.qualities[quality].rate_hz * string.qualities[quality].modes for quality in PROMISED]
    assert rates == sorted(rates)
    (one,) = measured_strings(preset)
    assert (one.seconds, one.notes, one.fingerprint) == (ROLLING_S, [43], string.fingerprint)
    # what is known is not measured again
    again = measure_plan(preset, known={string.fingerprint: string})
    assert again.strings == plan.strings


def test_whoever_wants_no_more_ends_it() -> None:
    with pytest.raises(Ended):
        measure_plan(small(), lambda done: False)


def test_the_command_keeps_a_plan_beside_a_preset_of_ones_own(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(PRESET.format(string="viscoelastic_loss = 0.02", displacement="3.0", rest=""))
    assert cli.main(["plan", str(tmp_path / "mine.toml")]) == 0
    assert "--measure-plan measures these" in capsys.readouterr().out
    assert cli.main(["plan", str(tmp_path / "mine.toml"), "--measure-plan"]) == 0
    out, err = capsys.readouterr()
    assert "measured on this string" in out and err == f"synth: written: {tmp_path / 'mine.plan'}\n"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine.plan", "mine.toml"]
    assert cli.main(["plan", str(tmp_path / "mine.toml")]) == 0
    assert capsys.readouterr().out == out


def test_measuring_that_is_interrupted_leaves_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    (tmp_path / "mine.toml").write_text(PRESET.format(string="", displacement="3.0", rest=""))
    monkeypatch.setattr(OneString, "references", interrupted)
    assert cli.main(["plan", str(tmp_path / "mine.toml"), "--measure-plan"]) == 130
    assert [path.name for path in tmp_path.iterdir()] == ["mine.toml"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "--measure-plan tanpura-light: is built in and already measured"),
        (
            PRESET.replace('kind = "bridge"', 'kind = "none" #').replace("distance_mm", "#").replace("jiva_um", "#"),
            "got obstacle.kind 'none'",
        ),
    ],
)
def test_the_command_says_what_has_no_plan(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str | None, words: str
) -> None:
    name = "tanpura-light"
    if text is not None:
        name = str(tmp_path / "mine.toml")
        Path(name).write_text(text.format(string="", displacement="3.0", rest=""))
    assert cli.main(["plan", name, "--measure-plan"]) == 2
    assert words in capsys.readouterr().err and not list(tmp_path.glob("*.plan"))


@pytest.mark.parametrize("name", ["steel-guitar", "fretless-bass", "harp"])
def test_what_has_no_plan(name: str) -> None:
    with pytest.raises(PresetError, match="a plan can be measured only for strings over rigid points"):
        measure_plan(load_preset(name))


def test_strokes_of_their_own_are_held_to() -> None:
    slap = load_preset("slap-bass")
    own = [each.articulation for each in other_strokes(slap) if each.articulation is not None]
    assert [each.position for each in own] == [0.25]  # pop: normal is measured, finger is [pluck], the others are damped
    (first, *_) = measured_strings(slap)
    assert isinstance(first, OneString) and first.notes == list(range(28, 49))
