"""Strings that move in two directions and rub against what they are pressed on, as the engine plays them."""

from __future__ import annotations

import numpy as np
import pytest

from synth.engine.engine import Engine
from synth.instrument.preset import Preset, PresetError
from synth.midi.events import NOTE_ON
from synth.solver import coupling

from .kit import (
    BRIDGE_OBSTACLE,
    NECK,
    NECK_OBSTACLE,
    bank_of,
    engine,
    go_on_from,
    play,
    preset,
    state_of,
    steel,
    what_sounds,
    wound,
)
from .test_together import HEARD, MODES, ROWS, TWO, TWO_WAYS, coupling_of, left_alone

RUBS = "\nfriction = 0.3"
ROUGH_BRIDGE = preset(
    "coupled-bridge",
    steel("G2", "Pa") + steel("C3", "Sa 1") + steel("C3", "Sa 2") + "place_mm = 12\n",
    obstacle=BRIDGE_OBSTACLE + RUBS,
    damping="ring_on = true",
    output=HEARD,
    more="pressure_um = -20\n" + MODES + TWO_WAYS,
)
ROUGH_NECK = preset(
    "coupled-neck",
    wound("E1", 32.5) + "place_mm = -20\n" + wound("A1", 20.9) + wound("D2", 13.8) + "place_mm = 20\n",
    obstacle=NECK_OBSTACLE + RUBS,
    output=HEARD,
    polyphony=3,
    more=MODES + TWO_WAYS,
)
ALL = [ROUGH_BRIDGE, ROUGH_NECK]


@pytest.mark.parametrize("instrument", ALL, ids=lambda each: each.name)
def test_neither_blocks_nor_threads_nor_a_state_matter(instrument: Preset) -> None:
    rows = ROWS[instrument.name]
    once = play(engine(instrument), rows, 6000, 4096)
    assert np.abs(once).max() > 1e-3
    sizes = np.random.default_rng(4).integers(1, 400, 6000)
    assert np.array_equal(play(engine(instrument), rows, 6000, [int(size) for size in sizes]), once)
    assert np.array_equal(play(engine(instrument, NECK, threads=2), rows, 6000, 333), once)
    for at in (517, 2304, 4610):
        made, other = engine(instrument), engine(instrument)
        play(made, [row for row in rows if row[0] < at], at)
        play(other, [(0, NOTE_ON, 0, 48 if instrument is ROUGH_BRIDGE else 33, 127)], 700)
        go_on_from(other, what_sounds(made))
        later = [(row[0] - at, *row[1:]) for row in rows if row[0] >= at]
        assert np.array_equal(play(other, later, 2000, 77), play(made, later, 2000))


@pytest.mark.parametrize("instrument", ALL, ids=lambda each: each.name)
def test_nothing_but_a_hand_gives_energy(instrument: Preset) -> None:
    made = left_alone(instrument, ROWS[instrument.name])
    assert coupling_of(made).counts[coupling.HELD_FRAMES] == 0


def second_direction_after(instrument: Preset, note: int) -> float:
    """Energy of the first string's second direction a second after a hard pluck, mass left out [m²/s²]."""
    made: Engine = engine(instrument, precision="float64")
    play(made, [(0, NOTE_ON, 0, note, 127)], 44100)
    q, v = state_of(made, 1)
    omega = made._strings.models[made._sounding.hands["model"][1]].omega[: q.size]
    return float(np.sum(v**2 + (omega * q) ** 2))


def test_a_string_that_buzzes_is_held_back_along_the_bridge() -> None:
    """What touches nothing rings as ever."""
    smooth = ROUGH_BRIDGE.with_setting("obstacle.friction", "0")
    rough = ROUGH_BRIDGE
    assert second_direction_after(rough, 43) < 0.9 * second_direction_after(smooth, 43)
    clear = [each.with_setting("obstacle.jiva_um", "1000") for each in (smooth, ROUGH_BRIDGE)]
    high = [second_direction_after(each, 43) for each in clear]
    assert high[1] == pytest.approx(high[0], rel=1e-6)


def test_without_it_the_second_direction_touches_nothing() -> None:
    smooth = ROUGH_NECK.with_setting("obstacle.friction", "0")
    assert np.array_equal(play(engine(smooth), ROWS["coupled-neck"], 3000), play(engine(TWO), ROWS["coupled-neck"], 3000))
    strings = bank_of(engine(ROUGH_NECK)).strings
    assert strings["friction"].tolist() == [0.0, 0.3] * 3
    assert not bank_of(engine(smooth)).strings["friction"].any()


def test_friction_without_a_second_direction_is_refused() -> None:
    with pytest.raises(PresetError, match=r"obstacle\.friction .* got 0\.3 without \[polarisation\]: give that table"):
        preset("flat", steel("G2"), obstacle=BRIDGE_OBSTACLE + RUBS, output=HEARD, more=MODES)
    with pytest.raises(PresetError, match=r"obstacle\.friction"):
        preset("flat", steel("G2"), obstacle=BRIDGE_OBSTACLE + "\nfriction = 9")
