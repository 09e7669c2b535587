"""Strings that share a bridge and a body, as the engine plays them."""

import numpy as np
import pytest

from synth.engine import layout
from synth.engine.engine import Engine
from synth.instrument.preset import Preset, PresetError, load_preset, parse_preset
from synth.midi.events import BEND, CONTROL, KEY_PRESSURE, NOTE_OFF, NOTE_ON, PARAMETER, PRESSURE
from synth.physics.body_modes import Body, BodyMode
from synth.physics.coupled import CoupledStrings, Line
from synth.solver import coupling

from .kit import (
    BRIDGE_OBSTACLE,
    NECK,
    NECK_OBSTACLE,
    RATE_HZ,
    awake,
    bank_of,
    engine,
    go_on_from,
    play,
    preset,
    steel,
    what_sounds,
    wound,
)

HEARD = 'kind = "body"\ngain_db = -40'
MODES = """
[[body.mode]]
frequency_hz = 105
q = 20
mass_kg = 0.6
shape = [1.0, 0.1, 2.0]
pan = -0.5
[[body.mode]]
frequency_hz = 233
q = 30
mass_kg = 0.3
shape = [0.9, -0.2, -3.0]
pan = 0.4
[[body.mode]]
frequency_hz = 510
q = 35
mass_kg = 0.4
shape = [1.0, 0.3, 5.0]
"""
ONE_WAY = MODES.replace(", 0.1, 2.0", "").replace(", -0.2, -3.0", "").replace(", 0.3, 5.0", "")
TWO_WAYS = "\n[polarisation]\ndetuning_cents = 0.5\nloss_ratio = 1.3\npluck_deg = 40\n"

#: three strings over nothing, notes 43, 48 and 55
OPEN = preset("open", steel("G2") + steel("C3") + steel("G3"), output=HEARD, more=ONE_WAY)
#: a tanpura
BRIDGE = preset(
    "coupled-bridge",
    steel("G2", "Pa") + steel("C3", "Sa 1") + steel("C3", "Sa 2") + "place_mm = 12\n",
    obstacle=BRIDGE_OBSTACLE,
    damping="ring_on = true",
    output=HEARD,
    more="pressure_um = -20\n" + MODES,
)
#: a bass whose strings move in two directions
TWO = preset(
    "coupled-neck",
    wound("E1", 32.5) + "place_mm = -20\n" + wound("A1", 20.9) + wound("D2", 13.8) + "place_mm = 20\n",
    obstacle=NECK_OBSTACLE,
    output=HEARD,
    polyphony=3,
    more=MODES + TWO_WAYS,
)
ALL = [OPEN, BRIDGE, TWO]
ROWS = {
    "open": [(5, NOTE_ON, 0, 43, 110), (900, NOTE_ON, 0, 48, 60), (2000, BEND, 0, 6000), (3001, NOTE_OFF, 0, 43)],
    "coupled-bridge": [
        (0, NOTE_ON, 0, 43, 110), (37, NOTE_ON, 0, 48, 127), (1500, NOTE_ON, 0, 48, 90), (2011, PRESSURE, 0, 90),
        (2600, KEY_PRESSURE, 0, 48, 127), (3100, BEND, 0, -3000), (3300, NOTE_ON, 0, 43, 127), (5000, BEND, 0, 0),
    ],
    "coupled-neck": [
        (3, NOTE_ON, 0, 28, 127), (700, NOTE_ON, 0, 33, 100), (1400, NOTE_ON, 0, 31, 120), (2200, CONTROL, 0, 68, 127),
        (2300, NOTE_ON, 0, 35, 100), (2900, NOTE_OFF, 0, 31), (3333, BEND, 0, 8191), (4000, NOTE_ON, 0, 40, 127),
        (4500, NOTE_ON, 0, 42, 127), (4600, NOTE_ON, 0, 44, 127), (5200, NOTE_OFF, 0, 33),
    ],
}  # fmt: skip


def coupling_of(made: Engine) -> coupling.Coupling:
    return made._strings.bridges.couplings[0]


def energy(made: Engine) -> float:
    return float(coupling.energy_of(made._strings.bridges.coupling_tables[0].ctypes.data))


@pytest.mark.parametrize("instrument", ALL, ids=lambda each: each.name)
def test_neither_blocks_nor_threads_matter(instrument: Preset) -> None:
    rows = ROWS[instrument.name]
    once = play(engine(instrument), rows, 7000, 4096)
    assert np.abs(once).max() > 1e-3
    sizes = np.random.default_rng(4).integers(1, 400, 7000)
    assert np.array_equal(play(engine(instrument), rows, 7000, [int(size) for size in sizes]), once)
    assert np.array_equal(play(engine(instrument), rows, 7000, 1), once)
    assert np.array_equal(play(engine(instrument, NECK, threads=2), rows, 7000, 333), once)


def test_a_finger_may_leave_anywhere_in_a_control_period() -> None:
    """At the end of one, too, a string's second direction is free at once, while the pull of another note is not forgotten:
    whether control periods go one by one or several at a time changes no bit."""
    made = engine(load_preset("banjo"))
    for offset in range(layout.QUANTUM):
        rows, runs = [(0, NOTE_ON, 0, 50, 100), (3000 + offset, NOTE_ON, 0, 60, 100)], []
        for blocks in (4096, layout.QUANTUM):
            made.reset()
            runs.append(play(made, rows, 5500, blocks))
        assert np.array_equal(*runs), offset


@pytest.mark.parametrize("instrument", ALL, ids=lambda each: each.name)
def test_a_state_in_mid_note_goes_on_bit_for_bit(instrument: Preset) -> None:
    rows = ROWS[instrument.name]
    for at in (517, 2304, 4610):
        made = engine(instrument)
        play(made, [row for row in rows if row[0] < at], at)
        later = [(row[0] - at, *row[1:]) for row in rows if row[0] >= at]
        state = what_sounds(made)
        expected = play(made, later, 3000)
        other = engine(instrument)
        play(other, [(0, NOTE_ON, 0, 48 if instrument is not TWO else 33, 127)], 700)
        go_on_from(other, state)
        assert np.array_equal(play(other, later, 3000, 77), expected)


def test_strings_and_body_move_as_their_complex_modes() -> None:
    """From the moment the finger has let go: the whole state a fifth of a second later."""
    made = engine(OPEN)
    play(made, [(0, NOTE_ON, 0, 43, 100)], 2048)
    body, strings = coupling_of(made), made._strings.states.items
    models = [made._strings.models[m] for m in made._sounding.hands["model"]]
    modes = tuple(BodyMode(mode.frequency_hz, mode.q, mode.mass_kg, mode.shape) for mode in OPEN.body.mode)
    constants = bank_of(made).models[made._sounding.hands["model"]]
    counts = [int(end.counts[coupling.APART_MODES]) for end in made._strings.bridges.ends.items]
    lines = tuple(
        Line(each["length"], each["tension"], model.mu, model.omega[:n], model.sigma[:n], np.ones(1))
        for each, model, n in zip(constants, models, counts, strict=True)
    )
    system = CoupledStrings(lines, Body(modes))

    def state() -> np.ndarray:
        x = np.zeros(system.size)
        w, rates, p, v = system.parts()
        for part, speeds, string, line in zip(w, rates, strings, lines, strict=True):
            n = line.omega.size
            x[part], x[speeds] = string.q[:n], string.v[:n] + line.ramp * body.bridge.speed[0]
        x[p], x[v] = body.body.motion.p[: len(modes)], body.body.motion.speed[: len(modes)]
        return x

    before = state()
    frames = 276 * layout.QUANTUM
    play(made, [], frames)
    solved = system.modes()
    exact = solved.free_response(before, [frames / RATE_HZ], np.eye(system.size))[0]
    assert system.energy(state() - exact) < 1e-4**2 * 4.0 * system.energy(exact)
    assert system.energy(exact) < 0.9 * system.energy(before)


def left_alone(instrument: Preset, rows: list) -> Engine:
    """An engine that has played rows of the first 6000 frames; then left to itself no quantum of it gains energy."""
    made = engine(instrument)
    play(made, rows, 6016)
    play(made, [], 40 * layout.QUANTUM)
    before = energy(made)
    assert before > 0.0
    for _ in range(200):
        play(made, [], layout.QUANTUM)
        assert energy(made) <= before * (1.0 + 1e-9)
        before = energy(made)
    return made


@pytest.mark.parametrize("instrument", ALL, ids=lambda each: each.name)
def test_nothing_but_a_hand_gives_energy(instrument: Preset) -> None:
    left_alone(instrument, ROWS[instrument.name])


def test_a_string_that_is_not_played_rings_with_one_that_is() -> None:
    """An octave above it: it is not counted among those that sound, and sounds on when that one is silenced."""

    def ring(second: str) -> float:
        made = engine(preset("pair", steel("C3") + steel(second), output=HEARD, more=ONE_WAY, damping="release_s = 0.03"))
        play(made, [(0, NOTE_ON, 0, 48, 110), (44100, NOTE_OFF, 0, 48)], 44100 + 8820)
        assert made.strings_sounding == 1
        return float(np.sqrt(np.mean(play(made, [], 22050)[:, 0] ** 2)))

    assert ring("C4") > 30.0 * ring("F#3")


def test_it_sleeps_when_it_is_silent_and_wakes_as_new() -> None:
    made = engine(preset("short", steel("C5") + steel("G5"), output=HEARD, more=ONE_WAY, damping="release_s = 0.05"))
    rows = [(0, NOTE_ON, 0, 72, 100), (2000, NOTE_OFF, 0, 72)]
    first = play(made, rows, 4480)
    end = play(made, [], 10336 * 128)  # it begins where checks do
    assert not any(awake(made)) and made.silent
    assert np.abs(end[-44100:]).max() == 0.0
    asleep = int(np.flatnonzero(np.abs(end[:, 0]) > 0.0)[-1])
    assert np.abs(end[asleep - 64 : asleep]).max() < 2e-5
    assert coupling_of(made).body.motion.p.any() == 0
    assert np.array_equal(play(made, rows, 4480), first)


def test_notes_that_are_not_asked_for_change_nothing() -> None:
    rows = [(0, NOTE_ON, 0, 30, 110), (2000, NOTE_ON, 0, 36, 90)]
    every = play(engine(TWO), rows, 5000)
    only = engine(TWO, only_notes=[{30, 36}], every_fret=False)
    assert bank_of(only).positions.size < bank_of(engine(TWO)).positions.size
    assert np.array_equal(play(only, rows, 5000), every)


def test_the_body_has_a_left_and_a_right() -> None:
    wide = play(engine(OPEN), ROWS["open"], 4000)
    assert not np.allclose(wide[:, 0], wide[:, 1], rtol=0.1)
    centred = ONE_WAY.replace("pan = -0.5", "").replace("pan = 0.4", "")
    middle = preset("middle", steel("G2") + steel("C3"), output=HEARD, more=centred)
    narrow = play(engine(middle), ROWS["open"], 4000)
    assert np.allclose(narrow[:, 0], narrow[:, 1], rtol=1e-9, atol=1e-12)


def test_other_parts_sound_as_without_it() -> None:
    rows = [(10, NOTE_ON, 1, 33, 110), (10, NOTE_ON, 0, 43, 110), (900, NOTE_ON, 1, 36, 90)]
    both = np.zeros((2, 5000, 2))
    play(engine(OPEN, NECK), rows, 5000, stems=both)
    alone = np.zeros((1, 5000, 2))
    play(engine(NECK), [(row[0], row[1], 0, *row[3:]) for row in rows if row[2] == 1], 5000, stems=alone)
    assert np.array_equal(both[1], alone[0])
    assert np.abs(both[0]).max() > 0.0


def test_live_parameters_reach_it() -> None:
    soft = play(engine(OPEN), [(0, PARAMETER, 0, layout.GAIN, 0, 0.5), *ROWS["open"]], 4000)
    full = play(engine(OPEN), ROWS["open"], 4000)
    assert 0.3 < np.abs(soft).max() / np.abs(full).max() < 0.7


def test_two_directions_decay_apart() -> None:
    """A string plucked across the body gives it its energy, along the body keeps it, between the two does first the one and
    then the other."""

    def left(angle: float) -> list[float]:
        more = ONE_WAY.replace("shape = [1.0]", "shape = [1.0, 0.02]").replace("shape = [0.9]", "shape = [0.9, 0.02]")
        made = engine(preset("plucked", steel("A2"), output=HEARD, more=more + f"[polarisation]\npluck_deg = {angle}\n"))
        play(made, [(0, NOTE_ON, 0, 45, 110)], 8832)
        energies = [energy(made)]
        for _ in range(5):
            play(made, [], 44096)
            energies.append(energy(made))
        return energies

    across, along, between = left(0.0), left(90.0), left(30.0)
    assert across[3] < 0.03 * across[0]
    assert along[3] > 0.15 * along[0]
    assert between[1] / between[0] < 0.45
    assert between[5] / between[4] == pytest.approx(along[5] / along[4], rel=0.1)


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"output": HEARD}, 'output.kind = "body" and \\[\\[body.mode\\]\\] need each other'),
        ({"more": ONE_WAY}, 'output.kind = "body" and \\[\\[body.mode\\]\\] need each other'),
        (
            {"output": HEARD, "more": ONE_WAY + "[[body.resonance]]\nfrequency_hz = 800\nq = 5\ngain_db = 6\n"},
            "body.resonance is for strings with fixed ends",
        ),
        ({"output": HEARD, "more": ONE_WAY.replace("mass_kg = 0.6", "mass_kg = 0")}, "body.mode.0.mass_kg"),
        ({"output": HEARD, "more": ONE_WAY.replace("shape = [1.0]", "shape = [0]", 1)}, "shape must move the bridge"),
        ({"output": HEARD, "more": ONE_WAY.replace("q = 20", "q = 0.4")}, "body.mode.0.q"),
        ({"output": HEARD, "more": ONE_WAY.replace("shape = [1.0]", "shape = [1, 2, 3, 4]")}, "body.mode.0.shape"),
    ],
)
def test_bodies_that_cannot_be_are_refused(tables: dict, said: str) -> None:
    with pytest.raises(PresetError, match=said):
        preset("wrong", steel("C3"), **tables)


def test_another_scheme_is_refused() -> None:
    with pytest.raises(PresetError, match=r"open: strings that share a body need exact-hold, got moreau-jean; "):
        engine(OPEN, scheme="moreau-jean")


def test_a_body_above_the_output_s_band_is_refused() -> None:
    made = Engine([parse_preset(HIGH, "high")])
    with pytest.raises(PresetError, match=r"body\.mode: no mode lies below 19845 Hz"):
        made.prepare(44100.0)


HIGH = f"""format = 2
name = "high"
{steel("G2")}
[pluck]
displacement_mm = 2.0
[output]
{HEARD}
[[body.mode]]
frequency_hz = 19900
q = 20
mass_kg = 0.6
"""
