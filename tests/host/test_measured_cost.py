"""What a preset costs: figures that belong together, whatever the machine."""

import pytest

from synth.engine.engine_settings import EngineSettings
from synth.host.measured_cost import measure_cost
from synth.instrument.preset import PresetError, load_preset


def test_figures_belong_together() -> None:
    cost = measure_cost(load_preset("fretted-bass"), rate_hz=44100.0, settings=EngineSettings(quality="draft"))
    assert 0.0 < cost.median_block <= cost.worst_block
    assert 1.0 / cost.real_time_factor <= cost.worst_block
    assert 1 <= cost.strings <= 4


def test_what_cannot_be_played_cannot_be_measured() -> None:
    with pytest.raises(PresetError, match="need exact-hold"):
        measure_cost(
            load_preset("steel-guitar"), rate_hz=44100.0, settings=EngineSettings(quality="draft", scheme="moreau-jean")
        )
