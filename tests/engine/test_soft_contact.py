"""Obstacles with a soft layer, as the engine plays them and as a case runs them."""

from __future__ import annotations

import numpy as np
import pytest

import synth
from synth.instrument.preset import Preset, PresetError
from synth.midi.events import BEND, KEY_PRESSURE, NOTE_OFF, NOTE_ON, PARAMETER
from synth.research.case import CaseError
from synth.solver import coupling

from . import test_together as together
from .kit import (
    BRIDGE_OBSTACLE,
    FORCE,
    NECK_OBSTACLE,
    PRESSED,
    bank_of,
    engine,
    go_on_from,
    model_of,
    play,
    preset,
    state_of,
    steel,
    what_sounds,
    wound,
)
from .test_together import HEARD, MODES, TWO_WAYS

LAYER = "\n[obstacle.layer]\nstiffness_n_mm = 40\nresistance_n_s_m = 0.4\nthickness_um = 60"
BRIDGE = preset(
    "bridge",
    steel("G2") + steel("C3"),
    obstacle=BRIDGE_OBSTACLE + LAYER,
    damping="ring_on = true",
    output=FORCE,
    more="pressure_um = -30.0",
)
NECK = preset("neck", wound("E1", 32.5) + wound("A1", 20.9), obstacle=NECK_OBSTACLE + LAYER)
#: the same on a bridge and a body that move, and rough as well, in two directions
SHARED = preset(
    "shared",
    steel("G2", "Pa") + steel("C3", "Sa 1") + steel("C3", "Sa 2") + "place_mm = 12\n",
    obstacle=BRIDGE_OBSTACLE + "\nfriction = 0.3" + LAYER,
    damping="ring_on = true",
    output=HEARD,
    more="pressure_um = -20\n" + MODES + TWO_WAYS,
)
SHARED_NECK = preset(
    "shared-neck", wound("E1", 32.5) + wound("A1", 20.9), obstacle=NECK_OBSTACLE + LAYER, output=HEARD, more=MODES
)
ROWS = {
    "shared": together.ROWS["coupled-bridge"],
    "shared-neck": [
        (3, NOTE_ON, 0, 28, 127), (700, NOTE_ON, 0, 33, 100), (1400, NOTE_ON, 0, 31, 120), (2900, NOTE_OFF, 0, 31),
        (3333, BEND, 0, 8191), (3400, NOTE_ON, 0, 34, 127),
    ],
    "bridge": [
        (0, NOTE_ON, 0, 43, 127), (437, NOTE_ON, 0, 48, 127), (1500, BEND, 0, 4000), (2600, KEY_PRESSURE, 0, 48, 127),
        (3300, NOTE_ON, 0, 43, 90), (4000, PARAMETER, 0, 5, 0, 20.0),
    ],
    "neck": [
        (3, NOTE_ON, 0, 28, 127), (1400, NOTE_ON, 0, 31, 120), (2200, NOTE_ON, 0, 33, 127), (2900, NOTE_OFF, 0, 31),
        (3333, BEND, 0, 8191),
    ],
}  # fmt: skip


@pytest.mark.parametrize("instrument", [BRIDGE, NECK, SHARED, SHARED_NECK], ids=lambda each: each.name)
def test_neither_blocks_nor_threads_nor_a_state_matter(instrument: Preset) -> None:
    rows = ROWS[instrument.name]
    once = play(engine(instrument), rows, 5000, 4096)
    assert np.abs(once).max() > 1e-3
    sizes = np.random.default_rng(6).integers(1, 400, 5000)
    assert np.array_equal(play(engine(instrument), rows, 5000, [int(size) for size in sizes]), once)
    assert np.array_equal(play(engine(instrument, threads=2), rows, 5000, 333), once)
    for at in (517, 2304):
        made, other = engine(instrument), engine(instrument)
        play(made, [row for row in rows if row[0] < at], at)
        play(other, [(0, NOTE_ON, 0, 43 if instrument in (BRIDGE, SHARED) else 33, 127)], 700)
        go_on_from(other, what_sounds(made))
        later = [(row[0] - at, *row[1:]) for row in rows if row[0] >= at]
        assert np.array_equal(play(other, later, 2000, 77), play(made, later, 2000))


@pytest.mark.parametrize("instrument", [SHARED, SHARED_NECK], ids=lambda each: each.name)
def test_nothing_but_a_hand_gives_energy_where_the_ends_move(instrument: Preset) -> None:
    made = together.left_alone(instrument, ROWS[instrument.name])
    assert together.coupling_of(made).counts[coupling.TOUCHED] > 100


def brightness(instrument: Preset) -> float:
    """Share of the sound above 4 kHz, of a note's first half second."""
    sound = play(engine(instrument), [(0, NOTE_ON, 0, 43, 120)], 22050)[:, 0]
    power = np.abs(np.fft.rfft(sound * np.hanning(sound.size))) ** 2
    return float(power[2000:].sum() / power.sum())


def test_a_soft_edge_buzzes_less_brightly() -> None:
    rigid = preset("rigid", steel("G2"), obstacle=BRIDGE_OBSTACLE, damping="ring_on = true", output=FORCE)
    felt = "\n[obstacle.layer]\nstiffness_n_mm = 2\nresistance_n_s_m = 1.0\nthickness_um = 200"
    softer = preset("rigid", steel("G2"), obstacle=BRIDGE_OBSTACLE + felt, damping="ring_on = true", output=FORCE)
    hard = felt.replace("= 2\n", "= 100000\n").replace("= 1.0", "= 0").replace("= 200", "= 0.1")
    nearly = preset("rigid", steel("G2"), obstacle=BRIDGE_OBSTACLE + hard, damping="ring_on = true", output=FORCE)
    assert brightness(softer) < 0.2 * brightness(rigid)
    assert brightness(nearly) == pytest.approx(brightness(rigid), rel=0.3)


def test_a_string_pressed_into_a_layer_rests_there() -> None:
    """Woken on it, and raised on it by the height of the obstacle: at rest in either case, deeper in or on the stop."""
    soft = Preset.model_validate(
        PRESSED.model_dump(exclude_unset=True)
        | {"obstacle": {**PRESSED.obstacle.model_dump(), "layer": {"stiffness_n_mm": 30, "thickness_um": 8}}}
    )
    for height_um in (0.0, 20.0):
        made = engine(soft)
        play(made, [(0, PARAMETER, 0, 5, 0, height_um)], 22050)
        play(made, [(0, NOTE_ON, 0, 43, 1)], 64)
        sounding, model = made._sounding, model_of(made, 0)
        response = float(bank_of(made).models["static_response"][sounding.hands["model"][0]])
        height = float(model.contacts.eta[0]) + 1e-6 * height_um
        force = max(height / (response + 1.0 / 30e3), (height - 8e-6) / response)
        assert sounding.motions["lift"][0] == pytest.approx(force, rel=1e-9)
        assert force < height / response
        q, _ = state_of(made, 0)
        rest = model.contacts.shapes[0, : q.size] * force / (model.mu * model.omega[: q.size] ** 2)
        assert np.abs(q - rest).max() < 0.2 * np.abs(rest).max()


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        (LAYER.replace("= 60", "= 0"), "obstacle.layer.thickness_um: must lie between 0.1 and 10000, got 0"),
        (LAYER.replace("stiffness_n_mm = 40\n", ""), "obstacle.layer.stiffness_n_mm: missing"),
        (LAYER + "\nsoftness = 3", "obstacle.layer.softness: no such key"),
    ],
)
def test_layers_that_cannot_be_are_refused(tables: str, said: str) -> None:
    with pytest.raises(PresetError) as caught:
        preset("wrong", steel("G2"), obstacle=BRIDGE_OBSTACLE + tables)
    assert said in str(caught.value)


def test_another_scheme_is_refused() -> None:
    with pytest.raises(PresetError, match=r"obstacle\.layer: soft contacts need exact-hold, got moreau-jean"):
        engine(BRIDGE, scheme="moreau-jean")


# --- synth simulate ---------------------------------------------------------------------------------------------------

CASE = {
    "string": {
        "length_m": 1.0,
        "tension_n": 180.0,
        "linear_density_kg_m": 1.2e-3,
        "diameter_m": 4e-4,
        "inharmonicity": 2e-5,
        "viscoelastic_loss": 4.5e-3,
    },
    "obstacle": {
        "positions_m": [0.3, 0.994],
        "heights_m": [-1e-3, -2e-6],
        "layer": {"stiffness_n_m": 3e4, "resistance_n_s_m": 0.3, "thickness_m": 5e-5},
    },
    "initial": {"shape": "triangle", "position_m": 0.4, "displacement_m": 3e-3, "width_m": 0.02},
    "run": {"internal_rate_hz": 96000.0, "modes": 60, "duration_s": 0.05, "outputs_m": [0.2], "ledger": True},
}


def changed(**tables: dict) -> dict:
    return {name: {**CASE.get(name, {}), **tables.get(name, {})} for name in {**CASE, **tables}}


def test_a_case_keeps_its_ledger() -> None:
    for finger in ([], [{"position_m": 0.6, "displacement_m": -2e-3, "draw_s": 0.01, "stiffness_n_m": 1e4}]):
        result = synth.simulate({**CASE, "finger": finger})
        assert result.largest_energy_rise < 1e-12
        assert result.largest_penetration_m < 1e-12
        columns = (result.energy_stored, result.energy_residual, result.energy_viscous, result.energy_contact)
        total = sum(columns) - result.energy_injected
        np.testing.assert_allclose(total, total[0], rtol=1e-11)
        depth = result.contact_heights - result.u_contact
        assert np.any(depth > 1e-6) and np.all(depth <= 5e-5 + 1e-12)
        assert result.energy_contact[-1] > 1e-4 * result.energy_stored[0]


def test_a_case_goes_on_where_it_ended() -> None:
    whole = synth.simulate(changed(run={"duration_s": 0.02}))
    first = synth.simulate(changed(run={"duration_s": 0.01}))
    rest = synth.simulate(changed(run={"duration_s": 0.01}), resume_from=first)
    assert np.array_equal(rest.u[-1], whole.u[-1])
    assert rest.energy_contact[-1] == whole.energy_contact[-1]


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        (
            {"scheme": {"name": "moreau-jean"}},
            "obstacle.layer: soft contacts need exact-hold without substeps, got moreau-jean",
        ),
        ({"scheme": {"substeps": 2}}, "got 2 substeps"),
        ({"obstacle": {"motion": {"sine": [{"frequency_hz": 5.0, "amplitude_m": 1e-4}]}}}, "layer and motion exclude"),
        ({"obstacle": {"positions_m": None, "heights_m": None}}, "layer needs points that have it"),
        ({"obstacle": {"layer": {"stiffness_n_m": 1e4, "thickness_m": 0.0}}}, "obstacle.layer.thickness_m"),
    ],
)
def test_cases_that_cannot_be_are_refused(tables: dict, said: str) -> None:
    case = changed(**tables)
    case["obstacle"] = {key: value for key, value in case["obstacle"].items() if value is not None}
    with pytest.raises(CaseError) as caught:
        synth.simulate(case)
    assert said in str(caught.value)
