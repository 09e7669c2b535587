"""The setup of presets: what there is to turn, and what the preset is then."""

from __future__ import annotations

import json

import numpy as np
import pytest

from synth.instrument.compile import open_string
from synth.instrument.preset import PresetError, load_preset
from synth.plugin import bankfile, recipe
from synth.plugin.setup import set_up, setup_of
from tests.engine.kit import BRIDGE, FREE, NECK

IDS = {
    "tanpura-light": "tuning.a4 string.length string.gauge string.losses obstacle.jiva obstacle.distance",
    "jawari-harp": "tuning.a4 string.lengths string.gauge string.losses obstacle.jivas obstacle.ratio",
    "fretted-bass": "tuning.a4 string.length string.gauge string.losses obstacle.raised output.position output.distance",
}


@pytest.mark.parametrize("name", IDS)
def test_what_there_is_to_turn(name: str) -> None:
    numbers = setup_of(3, load_preset(name))
    assert [each.id for each in numbers] == IDS[name].split()
    assert [(each.part, each.index) for each in numbers] == [(3, k) for k in range(len(numbers))]
    for each in numbers:
        assert each.minimum <= each.default <= each.maximum and each.minimum < each.maximum


@pytest.mark.parametrize("name", IDS)
def test_as_compiled_changes_nothing(name: str) -> None:
    preset = load_preset(name)
    assert set_up(preset, {each.id: each.default for each in setup_of(0, preset)}) is preset


@pytest.mark.parametrize("name", IDS)
def test_a_number_changes_what_it_is_called_by(name: str) -> None:
    """Each one alone is then the one that is read, and all others are as they were; factors and shifts begin anew."""
    preset = load_preset(name)
    before = {each.id: each for each in setup_of(0, preset)}
    for identity, number in before.items():
        value = 0.3 * number.minimum + 0.7 * number.maximum
        changed = set_up(preset, {identity: value})
        assert changed != preset
        after = {each.id: each.default for each in setup_of(0, changed)}
        relative = number.unit == "×" or identity == "obstacle.raised"
        assert after == {key: each.default for key, each in before.items()} | ({} if relative else {identity: value})


def test_a_thicker_wire_is_tighter_by_the_square() -> None:
    """T = µ (2 L f)²: µ goes with the area, at the same pitch and length."""
    for name in ("tanpura-light", "fretted-bass", "jawari-harp"):
        plain, thick = (load_preset(name), set_up(load_preset(name), {"string.gauge": 1.5}))
        for a, b in zip(plain.string, thick.string, strict=True):
            note = a.notes[0]
            before, after = (open_string(preset, table, note)[0] for preset, table in ((plain, a), (thick, b)))
            assert after.linear_density_kg_m == pytest.approx(2.25 * before.linear_density_kg_m, rel=1e-12)
            assert after.tension_n / before.tension_n == pytest.approx(2.25, rel=0.02)  # stiffness takes a little of it


def test_fret_heights_are_raised_together() -> None:
    preset = load_preset("fretted-bass")
    heights = np.array(set_up(preset, {"obstacle.raised": 0.25}).obstacle.heights_mm)
    np.testing.assert_allclose(heights, np.array(preset.obstacle.heights_mm) - 0.25, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"string.colour": 1.0}, "no 'string.colour' in its setup; there are tuning.a4"),
        ({"string.length": 9.0}, "String length must lie between 0.3 and 1.5, got 9"),
        ({"string.length": float("nan")}, "String length must lie between"),
    ],
)
def test_what_cannot_be_is_refused(values: dict[str, float], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        set_up(load_preset("tanpura-light"), values)


def test_what_the_preset_refuses_is_told_with_the_number() -> None:
    loud = FREE.with_setting("string.0.diameter_mm", "5.0")
    with pytest.raises(PresetError, match=r"free with String gauge 2: string\.0\.diameter_mm"):
        set_up(loud, {"string.gauge": 2.0})


def test_a_recipe_makes_the_same_bank() -> None:
    note_hz = 440.0 * 2.0 ** ((np.arange(128) - 69) / 12.0)
    options = {"quality": "standard", "note_hz": note_hz}
    kept = recipe.read(recipe.written((BRIDGE, NECK), "two", options))
    assert (kept.presets, kept.name) == ((BRIDGE, NECK), "two")
    again = bankfile.bank(kept.presets, [44100.0], name=kept.name, **kept.options)
    assert again == bankfile.bank((BRIDGE, NECK), [44100.0], name="two", **options)


def test_the_recipe_of_a_file(tmp_path) -> None:
    data = bankfile.bank((FREE,), [44100.0])
    file = tmp_path / "free.jawari"
    file.write_bytes(data)
    checksum, kept = bankfile.recipe_of(file)
    assert kept.presets == (FREE,) and checksum == int(np.frombuffer(data, bankfile.HEADER, 1)[0]["checksum"])
    wrong = {
        "does not contain a bank": b"",
        "of version 7": data[:8] + b"\x07" + data[9:],
        "changed": data[:300] + b"?" + data[301:],
    }
    for told, changed in wrong.items():
        file.write_bytes(changed)
        with pytest.raises(ValueError, match=told):
            bankfile.recipe_of(file)


def test_a_recipe_is_plain_json() -> None:
    assert json.loads(recipe.written((FREE,), None, {}))["presets"][0]["name"] == "free"
