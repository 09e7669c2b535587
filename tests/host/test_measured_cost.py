"""What a preset costs: figures that belong together, whatever the machine."""

import pytest

from synth.host.measured_cost import measure_cost
from synth.instrument.preset import PresetError, load_preset


def test_figures_belong_together() -> None:
    cost = measure_cost(
        load_preset("fretted-bass"), quality="draft", rate_hz=44100.0, scheme="exact-hold", internal_rate_hz=None
    )
    assert 0.0 < cost.median_block <= cost.worst_block
    assert 1.0 / cost.real_time_factor <= cost.worst_block
    assert 1 <= cost.strings <= 4


def test_what_cannot_be_played_cannot_be_measured() -> None:
    with pytest.raises(PresetError, match="need exact-hold"):
        measure_cost(
            load_preset("steel-guitar"), quality="draft", rate_hz=44100.0, scheme="moreau-jean", internal_rate_hz=None
        )
