"""A fit in a preset: what the engine's own model then has for partials, and what the fit says they are."""

import json
import math

import numpy as np
import pytest

from synth.engine.engine import Engine
from synth.fit import Fit, apply_settings, fit_recording, report, settings
from synth.instrument.compile import compile_string
from synth.instrument.preset import Preset, contact_cents, load_preset, parse_preset
from synth.midi.events import NOTE_ON, make_events
from synth.units import cents, hz_to_midi
from tests.fit.strings import draw, render, steel


@pytest.fixture(scope="module")
def fits() -> dict[str, Fit]:
    """A low and a high string, and one of random make."""
    rng = np.random.default_rng(77)
    return {
        "low": fit_recording(render(steel(43.0, 3e-4, 0.13), rng), 44100.0),
        "middle": fit_recording(render(steel(149.0, 6e-5, 0.31), rng), 44100.0),
        "any": fit_recording(render(draw(rng), rng), 44100.0),
    }


def model(preset: Preset, index: int, note: int) -> tuple[np.ndarray, np.ndarray]:
    """(Hz, T60 in s) of the first ten modes that the engine plays of an open string."""
    position = compile_string(preset, preset.string[index], note, quality="standard", rate_hz=44100.0).positions[0]
    return position.omega[:10] / (2.0 * math.pi), math.log(1000.0) / position.sigma[:10]


@pytest.mark.slow
@pytest.mark.parametrize("which", ["low", "middle", "any"])
@pytest.mark.parametrize(
    ("name", "index"), [("fretted-bass", 0), ("fretted-bass", 3), ("tanpura-light", 0), ("tanpura-light", 3)]
)
def test_the_presets_string_has_the_fits_partials(fits: dict[str, Fit], name: str, index: int, which: str) -> None:
    fit, before = fits[which], load_preset(name)
    preset = apply_settings(before, settings(fit, before, index))
    note = preset.string[index].notes[0]
    hz, t60 = model(preset, index, note)
    # What the bridge does to the pitch is the preset's own, and is subtracted from the string's.
    raised = 2.0 ** (contact_cents(preset, note) / 1200.0)
    assert max(abs(cents(float(a) * raised, p.hz)) for a, p in zip(hz, fit.partials, strict=False)) < 3.0
    assert t60 == pytest.approx([p.t60_s for p in fit.partials[:10]], rel=0.12)
    kept = ("length_m", "diameter_mm", "linear_density_g_m", "density_kg_m3", "core_diameter_mm", "winding_diameter_mm")
    assert all(getattr(preset.string[index], field) == getattr(before.string[index], field) for field in kept)
    assert [s for i, s in enumerate(preset.string) if i != index] == [s for i, s in enumerate(before.string) if i != index]
    assert preset.pluck.position == pytest.approx(fit.pluck.position, abs=1e-3)


def test_a_string_without_nut_and_contact_needs_no_measured_list(fits: dict[str, Fit]) -> None:
    """There the laws of the model are enough, to the decimals that are written."""
    preset = parse_preset(
        'format = 2\nname = "one"\n[[string]]\nnotes = "A2"\nlength_m = 0.65\ndiameter_mm = 0.5\n'
        "linear_density_g_m = 2.0\ninharmonicity = 1e-5\nviscoelastic_loss = 0.1\n[pluck]\ndisplacement_mm = 1.0\n",
        "one",
    )
    found = settings(fits["middle"], preset, 0)
    assert not any("measured" in path for path, _ in found)
    new = apply_settings(preset, found)
    hz, t60 = model(new, 0, new.string[0].notes[0])
    assert max(abs(cents(float(a), p.hz)) for a, p in zip(hz, fits["middle"].partials, strict=False)) < 0.01
    assert t60 == pytest.approx([p.t60_s for p in fits["middle"].partials[:10]], rel=0.03)
    assert new.string[0].viscoelastic_loss == pytest.approx(4e-3, rel=0.2)


def test_a_table_of_many_notes_keeps_them(fits: dict[str, Fit]) -> None:
    """A harp's table gets B and losses at the recording's note; its tuning stays."""
    before = load_preset("jawari-harp")
    found = settings(fits["middle"], before, 1)
    paths = [path for path, _ in found]
    assert not {"string.1.notes", "string.1.cents", "string.1.measured_decay_rates"} & set(paths)
    preset = apply_settings(before, found)
    note = round(hz_to_midi(fits["middle"].first_partial_hz))
    hz, _ = model(preset, 1, note)
    partials = fits["middle"].partials[:10]
    stretch = [cents(float(a / hz[0]), p.hz / partials[0].hz) for a, p in zip(hz, partials, strict=True)]
    assert max(map(abs, stretch)) < 1.0
    low = fit_recording(render(steel(35.0), np.random.default_rng(5)), 44100.0)
    with pytest.raises(ValueError, match="must lie in the string's E1-B2, got 35 Hz; choose another string"):
        settings(low, before, 0)


def test_a_string_that_is_not_there(fits: dict[str, Fit]) -> None:
    with pytest.raises(ValueError, match="string must lie between 0 and 3, got 4"):
        settings(fits["low"], load_preset("tanpura-light"), 4)


def test_the_engine_plays_what_was_recorded(fits: dict[str, Fit]) -> None:
    """All the way round: the string is fitted to a recording, played by the engine, and fitted again."""
    preset = parse_preset(
        'format = 2\nname = "one"\n[[string]]\nnotes = "A2"\nlength_m = 0.65\ndiameter_mm = 0.5\n'
        "linear_density_g_m = 2.0\nyoungs_modulus_gpa = 100\n[pluck]\ndisplacement_mm = 1.0\nwidth_mm = 2.0\n"
        "[damping]\nring_on = true\n",
        "one",
    )
    first = fits["middle"]
    new = apply_settings(preset, settings(first, preset, 0))
    engine = Engine([new], quality="standard", limiter=False)
    engine.prepare(44100)
    out = np.zeros((3 * 44100, 2))
    engine.process(make_events([(0, NOTE_ON, 0, new.string[0].notes[0], 100)]), out)
    again = fit_recording(out / np.abs(out).max() * 0.5, 44100.0)
    assert abs(cents(again.f0_hz, first.f0_hz)) < 0.5
    assert again.inharmonicity == pytest.approx(first.inharmonicity, rel=0.05)
    assert [p.t60_s for p in again.partials[:10]] == pytest.approx([p.t60_s for p in first.partials[:10]], rel=0.1)
    assert again.pluck.position == pytest.approx(first.pluck.position, abs=0.02)


def test_the_report_is_plain_and_bounded(fits: dict[str, Fit]) -> None:
    for fit in fits.values():
        told = report(fit)
        text = json.dumps(told, allow_nan=False)
        assert len(text) < 100_000
        assert told["inharmonicity"] == pytest.approx(fit.inharmonicity, rel=1e-4)
        for curve in told["curves"].values():
            assert curve["points"] and curve["line"]
            assert all(len(point) == 2 for part in curve.values() for point in part)
        stretch = dict(told["curves"]["frequency"]["line"])
        assert all(abs(stretch[n] - y) < 1.0 for n, y in told["curves"]["frequency"]["points"] if n <= 5)
