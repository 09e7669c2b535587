"""What `presets check` passes, everything can play; what it refuses, nothing can; and it says so in the file's own words."""

import os
import random
import re
import tomllib
from typing import Any

import numpy as np
import pytest
import tomlkit

from synth.cli import main
from synth.engine.engine import Engine
from synth.instrument.check import check, problems
from synth.instrument.compile import compile_preset
from synth.instrument.preset import Preset, PresetError, load_preset, preset_path, validate_preset
from synth.instrument.shipped import shipped_names
from tests.host.midibytes import header, off, on, track

#: few strings each, so that a whole instrument compiles in a blink
SMALL = {"tanpura-light": [0, 3], "fretted-bass": [2], "jawari-harp": [0]}
#: tables whose numbers are spoiled, some more often
SPOILED = ("string", "obstacle", "nut", "obstacle", "nut")


def small(name: str) -> dict[str, Any]:
    data = tomllib.loads(preset_path(name).read_text(encoding="utf-8"))
    data["string"] = [data["string"][i] for i in SMALL[name]]
    if name == "jawari-harp":
        data["string"][0]["notes"] = "E1-G1"
    return data


def spoiled(value: Any, random_: random.Random, share: float) -> Any:
    """A share of the numbers stretched by up to three orders of magnitude, or by a little, or with another sign, or zero."""
    if isinstance(value, dict):
        return {key: spoiled(each, random_, share) for key, each in value.items()}
    if isinstance(value, list):
        return [spoiled(each, random_, share) for each in value]
    if isinstance(value, bool) or not isinstance(value, int | float) or random_.random() > share:
        return value
    kind = random_.random()
    if kind < 0.05:
        return 0.0
    if kind < 0.1:
        return -value
    new = value * 10.0 ** random_.uniform(-2.5, 2.5) if kind < 0.6 else value * random_.uniform(0.3, 3.0)
    return max(1, round(new)) if isinstance(value, int) else new


def random_preset(seed: int) -> Preset | None:
    """A preset with some numbers spoiled, None where a field's own range refuses it."""
    random_ = random.Random(seed)
    data = small(random_.choice([*sorted(SMALL), "fretted-bass"]))
    group = random_.choice([group for group in SPOILED if data.get(group)])
    data[group] = spoiled(data[group], random_, random_.choice((0.1, 0.3, 0.6)))
    try:
        return validate_preset(data, "random")
    except PresetError:
        return None


def compiles(preset: Preset) -> str | None:
    """What compiling everything says, None for nothing. Whatever is not finite is as bad as a refusal."""
    try:
        with np.errstate(all="ignore"):
            part = compile_preset(preset)
    except (ValueError, ArithmeticError) as error:
        return str(error)
    for string in part.strings:
        for position in string.positions:
            for name in ("omega", "sigma", "coef", "shapes", "eta", "residual", "matrix", "wq", "wv", "q_rest"):
                if not np.isfinite(getattr(position, name)).all():
                    return f"{name} is not finite"
    return None


def test_the_check_refuses_what_cannot_be_compiled_and_nothing_else() -> None:
    refused = passed = 0
    for seed in range(1000, 1060):
        preset = random_preset(seed)
        if preset is None:
            continue
        found = problems(preset)
        said = compiles(preset)
        assert bool(found) == (said is not None), (seed, found, said)
        refused, passed = refused + bool(found), passed + (not found)
    assert refused >= 6 and passed >= 20


#: spoiled presets and what is said of each
BAD = {
    "a fret above the string": (
        "fretted-bass",
        {"obstacle.heights_mm": [-0.4] * 11 + [0.3] + [-3.0] * 8},
        r"obstacle\.heights_mm: string E at E1: fret 12 must lie below the string at rest, open, got \+0\.30 mm",
    ),
    "a fret in the way of the one before": (
        "fretted-bass",
        {"obstacle.heights_mm": [-3.0] * 4 + [-0.4] + [-3.0] * 15},
        r"obstacle\.heights_mm: string E at E1, fret 1: fret 5 must lie below .*\(and at 15 other places\)",
    ),
    "a nut as light as a feather": (
        "fretted-bass",
        {"nut.0.mass_kg": 1e-5},
        r"nut: string E at E1.* raise (the )?mass_kg of the nut resonance",
    ),
    "a core as thick as the string": (
        "tanpura-light",
        {"string.3.core_diameter_mm": 0.9, "string.3.winding_diameter_mm": 0.1, "string.3.diameter_mm": 0.8},
        r"string\.3\.core_diameter_mm: .* at C2: must be less than diameter_mm, .* 0\.8 mm, got 0\.9 mm",
    ),
    "a string as stiff as a bar": (
        "tanpura-light",
        {"string.0.length_m": 0.02},
        r"string\.0\.youngs_modulus_gpa: .* its pitch must be above what bending stiffness alone gives.*youngs_modulus_gpa",
    ),
    "a bridge as long as the string": (
        "tanpura-light",
        {"obstacle.distance_mm": 90.0, "string.1.length_m": 0.08},
        r"obstacle\.distance_mm: string .* at C3: must be less than the string's length of 80 mm, got 90 mm",
    ),
}


def spoil(name: str, changes: dict[str, Any]) -> dict[str, Any]:
    """The data of a preset with values of dotted paths."""
    data = tomllib.loads(preset_path(name).read_text(encoding="utf-8"))
    for path, value in changes.items():
        place: Any = data
        *parts, last = path.split(".")
        for part in parts:
            place = place[int(part) if part.isdecimal() else part]
        if last == "heights_mm":
            place.pop("action_12th_mm", None)
            place.pop("relief_mm", None)
            place.pop("nut_height_mm", None)
        if last == "distance_mm":
            place.pop("distance_ratio", None)
        place[last] = value
    return data


@pytest.mark.parametrize("name", BAD)
def test_every_command_refuses_it_in_the_same_words(name: str, tmp_path, capsys) -> None:
    base, changes, message = BAD[name]
    file, song = str(tmp_path / "bad.toml"), str(tmp_path / "song.mid")
    (tmp_path / "bad.toml").write_text(tomlkit.dumps(spoil(base, changes)), encoding="utf-8")
    (tmp_path / "song.mid").write_bytes(header() + track((0, on(36)), (48, off(36))))
    said = []
    for command in (
        ["presets", "check", file],
        ["plan", file],
        ["render", song, "-p", file, "-o", str(tmp_path / "x.wav")],
    ):
        assert main(command) == 2, command
        said.append(capsys.readouterr().err)
    assert said[0] == said[1] == said[2]
    assert re.search(message, said[0]), said[0]
    assert "modal_mass_kg" not in said[0] and "_n_m2" not in said[0]
    with pytest.raises(PresetError) as error:
        Engine([load_preset(file)]).prepare(44100.0)
    assert str(error.value).replace(f"{base}: ", "") == said[0].replace(f"synth: error: {file}: ", "").rstrip("\n")
    assert sorted(os.listdir(tmp_path)) == ["bad.toml", "song.mid"]


def test_all_that_is_wrong_at_once() -> None:
    changes = {
        **BAD["a nut as light as a feather"][1],
        **BAD["a fret above the string"][1],
        "string.1.core_diameter_mm": 5.0,
    }
    with pytest.raises(PresetError) as error:
        check(validate_preset(spoil("fretted-bass", changes), "x"), "mine.toml")
    paths = [path for path, _ in error.value.problems]
    assert list(dict.fromkeys(paths)) == ["nut", "obstacle.heights_mm", "string.1.core_diameter_mm"]
    assert len(str(error.value).splitlines()) == len(paths) < 8


@pytest.mark.parametrize("name", shipped_names("."))
def test_the_presets_that_come_with_the_program_are_in_order(name: str) -> None:
    assert problems(load_preset(name)) == []


def test_a_look_at_the_ends_alone_is_part_of_the_whole() -> None:
    preset = validate_preset(spoil(*BAD["a fret above the string"][:2]), "x")
    assert {path for path, _ in problems(preset, everywhere=False)} == {path for path, _ in problems(preset)}


def test_a_fret_in_the_middle_that_lifts_the_string_is_seen_without_a_look_at_every_note() -> None:
    heights = list(load_preset("fretted-bass").obstacle.heights_mm)
    heights[4] += 0.5  # a string stopped at the fret before lies on it
    preset = validate_preset(spoil("fretted-bass", {"obstacle.heights_mm": heights}), "x")
    assert [path for path, _ in problems(preset)] == ["obstacle.heights_mm"]
    assert [path for path, _ in problems(preset, everywhere=False)] == ["obstacle.heights_mm"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"tuning.contact_cents": {"C3": 1e6}}, r"tuning\.contact_cents: must lie between -1200 and 1200, got 1e\+06"),
        (
            {"string.0.measured_frequencies_hz": [0.0]},
            r"measured_frequencies_hz: number 1 must lie between 0\.1 and",
        ),
        ({"string.0.measured_decay_rates": [1.0, -1.0]}, r"measured_decay_rates: number 2 must lie between"),
    ],
)
def test_numbers_that_nothing_could_be_computed_with(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(PresetError, match=message):
        validate_preset(spoil("tanpura-light", changes), "mine.toml")


@pytest.mark.parametrize(
    ("obstacle", "message"),
    [
        (
            {"kind": "points", "positions_mm": [300.0, 200.0], "heights_mm": [-1.0, -1.0]},
            "must rise, got 300 and 200",
        ),
        ({"kind": "points", "positions_mm": [0.0], "heights_mm": [-1.0]}, "positions_mm: number 1 must lie between"),
        (
            {"kind": "points", "positions_mm": [2000.0], "heights_mm": [-1.0]},
            "point 1 must be less than",
        ),
        ({"kind": "points", "positions_mm": [20.0], "heights_mm": [-1e300]}, "heights_mm: number 1 must lie between"),
        ({"kind": "frets", "count": 8, "action_12th_mm": 2.0}, "count must be at least 12 for an action at fret 12"),
    ],
)
def test_obstacles_that_cannot_be(obstacle: dict[str, Any], message: str) -> None:
    data = spoil("tanpura-light", {"obstacle": obstacle, "mapping": {}})
    with pytest.raises(PresetError, match=message):
        check(validate_preset(data, "mine.toml"), "mine.toml")
