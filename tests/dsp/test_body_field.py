"""Fields among a body's resonances: their level, what decides them, and that single ones are as they are written."""

from __future__ import annotations

import math

import numpy as np
import pytest

from synth.dsp.body import body_coefficients
from synth.dsp.body_effect import BODY
from synth.instrument.preset import Body, Preset, PresetError, load_preset
from synth.instrument.resonances import Peak

RATE = 44100.0
FIELD = {"frequency_hz": 500.0, "to_hz": 8000.0, "spacing_hz": 60.0, "q": 30.0, "gain_db": -6.0}


def body(**changed: float) -> Body:
    return Body.model_validate({"direct_db": -120.0, "resonance": [FIELD | changed]})


def response_db(made: Body, low_hz: float, high_hz: float) -> float:
    """Mean square of the filter's response [dB]."""
    z = np.exp(-2j * np.pi * np.linspace(low_hz, high_hz, 4000) / RATE)[:, None]
    k, a, b = BODY.made(made, RATE).coefficients[0]
    return float(10.0 * np.log10(np.mean(np.abs(np.sum(k * (1.0 - z) / (1.0 - a * z - b * z**2), axis=1)) ** 2)))


@pytest.mark.parametrize(("spacing", "q"), [(60.0, 30.0), (200.0, 30.0), (60.0, 100.0)])
def test_level_of_a_field_is_that_of_its_gain(spacing: float, q: float) -> None:
    for low, high in ((700.0, 1400.0), (1400.0, 2800.0), (2800.0, 5600.0)):
        levels = [response_db(body(spacing_hz=spacing, q=q, seed=seed), low, high) for seed in range(24)]
        assert 10.0 * np.log10(np.mean(10.0 ** (np.array(levels) / 10.0))) == pytest.approx(-6.0, abs=1.0), (low, levels)


def test_a_single_resonance_is_as_it_is_written() -> None:
    made = Body.model_validate({"resonance": [{"frequency_hz": 300.0, "q": 20.0, "gain_db": -3.0, "pan": 0.4}]})
    assert made.peaks == (Peak(300.0, 20.0, -3.0, 1.0, 0.4),)
    plain = body_coefficients([300.0], [20.0], [-3.0], RATE)
    assert np.array_equal(BODY.made(made, RATE).coefficients[:, 1:], np.stack([plain[1:]] * 2))


def test_peaks_of_a_field_take_both_signs_and_stay_within_its_pan() -> None:
    peaks = body(pan=0.5).peaks
    assert {peak.sign for peak in peaks} == {-1.0, 1.0}
    assert 0.4 < max(abs(peak.pan) for peak in peaks) <= 0.5
    assert body(pan=0.5).wide and not body().wide
    assert body(seed=3).peaks != body(seed=4).peaks and body(seed=3).peaks == body(seed=3).peaks
    assert all(peak.q >= 1.0 for peak in body(q=1.0).peaks)


def test_peaks_beyond_the_rate_are_left_out() -> None:
    made = BODY.made(body(), 12000.0)
    assert 0 < made.coefficients.shape[2] < len(body().peaks)
    assert math.isfinite(float(made.coefficients.sum()))


def with_field(**changed: object) -> Preset:
    table = {key: value for key, value in (FIELD | changed).items() if value is not None}
    return load_preset("jawari-harp").with_setting(
        "body.resonance", "[{ " + ", ".join(f"{key} = {value}" for key, value in table.items()) + " }]"
    )


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"spacing_hz": None}, "to_hz and spacing_hz make a field of modes together"),
        ({"to_hz": None, "spacing_hz": None, "seed": 4}, "seed chooses the modes of a field, got 4"),
        ({"to_hz": 400.0}, "must have 2 to 320 modes"),
        ({"spacing_hz": 1.0}, "must have 2 to 320 modes"),
    ],
)
def test_bad_fields_are_refused(changed: dict[str, object], words: str) -> None:
    with pytest.raises(PresetError, match=words):
        with_field(**changed)
