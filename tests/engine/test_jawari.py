"""A curved bridge that is raised and lowered while its strings sound."""

from __future__ import annotations

import numpy as np
import pytest

from synth.engine import layout
from synth.engine.engine import Engine
from synth.engine.layout import QUANTUM
from synth.engine.parameters import parameters_of
from synth.instrument.preset import Preset, load_preset
from synth.midi.events import CONTROL, KEY_PRESSURE, NOTE_ON, PARAMETER
from synth.solver import coupling
from synth.solver.layers import held_by_layers
from tests.engine.kit import (
    BRIDGE,
    CURVE,
    CURVE_OBSTACLE,
    FORCE,
    SITAR,
    bank_of,
    energy,
    engine,
    model_of,
    play,
    preset,
    state_of,
    steel,
    string_of,
)

#: by this frame a control has arrived
SETTLED = 8000
NOTES = [(SETTLED, NOTE_ON, 0, 43, 110), (SETTLED + 3001, NOTE_ON, 0, 48, 127), (SETTLED + 6000, NOTE_ON, 0, 50, 60)]
SOFT = preset(
    "soft-curve",
    steel("G2"),
    obstacle=CURVE_OBSTACLE + "\n[obstacle.layer]\nstiffness_n_mm = 40\nresistance_n_s_m = 0.4\nthickness_um = 20",
    damping="ring_on = true",
    output=FORCE,
)
BRIDGES = [CURVE, SITAR, SOFT]


def raise_to(frame: int, height_um: float) -> tuple:
    """The event that does it."""
    return frame, PARAMETER, 0, layout.HEIGHT, 0, height_um


def low(of: Preset, height_um: float) -> Preset:
    """A preset whose strings lie lower over the bridge, as over one that is raised."""
    return of.with_setting("obstacle.jiva_um", repr(-height_um))


def all_energy(made: Engine, of: Preset) -> float:
    """Of the first string and the layer under it, or of all strings and the body that they share."""
    if of is SITAR:
        return float(coupling.energy_of(made._strings.bridges.coupling_tables[0].ctypes.data))
    layers = held_by_layers(made._shared.model_at[made._sounding.hands["model"][0], layout.PLAIN], made._shared.string_at[0])
    return energy(made, 0) + layers


def brightness(sound: np.ndarray) -> float:
    """Share of the energy above 2.5 kHz [dB]."""
    power = np.abs(np.fft.rfft(sound * np.hanning(sound.size))) ** 2
    return float(10.0 * np.log10(power[int(2500 * sound.size / 44100) :].sum() / power.sum()))


@pytest.mark.parametrize("name", ["sitar", "sitar-closed", "veena", "tanpura-light"])
def test_every_bridge_can_be_raised(name: str) -> None:
    found = [each.name for each in parameters_of(0, load_preset(name)) if each.id == "obstacle.height"]
    assert found == ["Bridge raised against the thread" if name == "tanpura-light" else "Bridge raised (jawari)"]


@pytest.mark.parametrize("height_um", [-150.0, -2.5, 1.0, 3.0, 40.0])
@pytest.mark.parametrize("of", BRIDGES, ids=lambda each: each.name)
def test_raised_it_is_the_preset_of_that_height(of: Preset, height_um: float) -> None:
    """Bit for bit: from rest, under the pluck, after it and at a fret. Raised, the strings are at rest on several points.
    Those of the sitar press on and fly over a bridge that lies so, not over one that is raised; else they are the same."""
    for economy in (True, False):
        raised = play(engine(of, economy=economy), [raise_to(0, height_um), *NOTES], SETTLED + 9000)
        made = play(engine(low(of, height_um), economy=economy), NOTES, SETTLED + 9000)
        assert np.abs(made).max() > 1e-4
        if of is SITAR and economy:
            assert np.sum((raised - made) ** 2) < 1e-8 * np.sum(made**2)
        else:
            np.testing.assert_array_equal(raised, made)


@pytest.mark.parametrize("of", BRIDGES, ids=lambda each: each.name)
def test_a_string_is_at_rest_on_a_raised_bridge(of: Preset) -> None:
    """It is where static forces hold it, of the length that it has, and nothing moves it before it is plucked."""
    height_um = 40.0
    made = engine(of)
    out = play(made, [raise_to(0, height_um), (SETTLED, NOTE_ON, 0, 43, 100)], SETTLED + 4000)
    peak, begin = np.abs(out).max(), SETTLED + made.latency_samples
    assert not out[:SETTLED].any()
    # the draw is a raised cosine: it begins without a step
    assert np.abs(out[begin - 30 : begin + 8]).max() < 1e-4 * peak
    still = engine(of)
    frame = SETTLED // QUANTUM * QUANTUM
    play(still, [raise_to(0, height_um), (frame - 1, NOTE_ON, 0, 43, 1)], frame + QUANTUM, QUANTUM)
    model = model_of(still, 0)
    eta = string_of(still, 0).eta[: model.contacts.size]
    np.testing.assert_array_equal(eta, model.contacts.eta + 1e-6 * height_um)
    q = np.zeros(model.omega.size)
    expected = engine(low(of, height_um)).compiled[0].strings[0].positions[0].q_rest
    q[: expected.size] = expected
    pressed = model.contacts.shapes @ q
    assert np.all(pressed > 0.4 * eta) and expected.any()
    # in one frame, softly, the finger has moved it by much less than a thousandth of that
    np.testing.assert_allclose(state_of(still, 0)[0], q[: model.modes], rtol=0, atol=1e-3 * np.abs(q).max())


@pytest.mark.parametrize("of", BRIDGES, ids=lambda each: each.name)
def test_raised_and_lowered_again_it_buzzes_as_before(of: Preset) -> None:
    """Dull while it presses; back again, the next note from silence is the same, bit for bit."""
    made, plain = engine(of), engine(of)
    up = [raise_to(3000 + 100 * k, float(k)) for k in range(41)]
    down = [raise_to(20000 + 100 * k, 40.0 - k) for k in range(41)]
    silence, again = 40000, 140000
    rows = [(0, NOTE_ON, 0, 43, 110), (silence, CONTROL, 0, 120, 0), (again, NOTE_ON, 0, 43, 110)]
    raised, held = (play(each, rows + more, again + 8000)[:, 0] for each, more in ((made, up + down), (plain, [])))
    assert np.isfinite(raised).all()
    pressed, open_ = (brightness(x[10000:20000]) for x in (raised, held))
    if of is not SITAR:  # of which other strings are heard, too
        assert pressed < open_ - 6.0
    assert np.abs(held[again:]).max() > 1e-4 and not np.array_equal(raised[:again], held[:again])
    np.testing.assert_array_equal(raised[again:], held[again:])


@pytest.mark.parametrize("of", BRIDGES, ids=lambda each: each.name)
def test_a_hard_ramp_gives_no_more_than_its_motion(of: Preset) -> None:
    """Jumps through the whole range: the energy stays bounded, and a bridge that sinks or stands still gives none."""
    plain = engine(of)
    energies = []
    for k in range(200):
        play(plain, [(0, NOTE_ON, 0, 43, 127)] if k == 0 else [], QUANTUM, QUANTUM)
        energies.append(all_energy(plain, of) if k else 0.0)
    made, rng = engine(of), np.random.default_rng(4)
    found, rises = [], []
    play(made, [(0, NOTE_ON, 0, 43, 127)], 100 * QUANTUM, QUANTUM)
    for k in range(600):
        rows = [raise_to(0, float(rng.uniform(-200.0, 50.0)))] if k % 20 == 0 and k < 300 else []
        before, height = all_energy(made, of), made._state.part_state["height"][0]
        play(made, rows, QUANTUM, QUANTUM)
        found.append(all_energy(made, of))
        if made._state.part_state["height"][0] <= height:
            rises.append(found[-1] / before - 1.0)
    assert max(found) < 2.0 * max(energies)
    assert len(rises) > 200 and max(rises) <= 1e-9
    assert made.report().silenced == 0 and made.report().unsolved_contacts == 0


def test_pressure_moves_a_curved_bridge() -> None:
    pressed = CURVE.with_setting("mapping.pressure_um", "40.0")
    made = engine(pressed)
    rows = [(0, NOTE_ON, 0, 43, 110), (4000, KEY_PRESSURE, 0, 43, 127)]
    out = play(made, rows, 20000)
    assert string_of(made, 0).eta[0] == pytest.approx(model_of(made, 0).contacts.eta[0] + 4e-5, abs=1e-12)
    assert not np.array_equal(out, play(engine(pressed), rows[:1], 20000))
    assert bank_of(made).models["settling"].max() == 4


@pytest.mark.parametrize("of", [BRIDGE, CURVE, SITAR], ids=lambda each: each.name)
def test_a_ramp_makes_no_click(of: Preset) -> None:
    """Up by 40 µm in a tenth of a second and down again, as a controller does it: no sharper a corner than in the buzz."""
    up = [raise_to(12000 + 100 * k, float(k)) for k in range(41)]
    down = [raise_to(20000 + 100 * k, 40.0 - k) for k in range(41)]
    held, moved = (play(engine(of), [(0, NOTE_ON, 0, 43, 110), *rows], 28000)[11500:] for rows in ([], up + down))
    corner = [float(np.abs(np.diff(each[:, 0], 2)).max()) for each in (held, moved)]
    assert not np.array_equal(held, moved) and corner[1] < 1.5 * corner[0]
