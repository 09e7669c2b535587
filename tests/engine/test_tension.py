"""Strings whose own motion raises their tension."""

from __future__ import annotations

import math

import numpy as np
import pytest

from synth.engine import layout
from synth.engine.engine import Engine
from synth.engine.tension import LEAST_RISE
from synth.instrument.preset import Preset, PresetError
from synth.midi.events import BEND, KEY_PRESSURE, NOTE_OFF, NOTE_ON
from synth.solver import coupling
from synth.solver.stringmodel import StringModel

from .kit import (
    BRIDGE_OBSTACLE,
    FORCE,
    NECK_OBSTACLE,
    RATE_HZ,
    bank_of,
    energy,
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
from .test_together import HEARD, MODES, ONE_WAY, TWO_WAYS

STRETCHED = "tension_modulation = true\n"
#: EA of `steel` and of `wound` [N]
STEEL_N, WOUND_N = (1e9 * gpa * math.pi * (1e-3 * mm) ** 2 / 4.0 for gpa, mm in ((200.0, 0.4), (301.0, 0.43)))
ALONE = preset("alone", steel("G2") + STRETCHED, output=FORCE, damping="ring_on = true").with_setting(
    "pluck.displacement_mm", "8"
)
BRIDGE = preset(
    "bridge",
    steel("G2") + STRETCHED + steel("C3") + STRETCHED,
    obstacle=BRIDGE_OBSTACLE,
    damping="ring_on = true",
    output=FORCE,
    more="pressure_cents = 30.0",
)
NECK = preset("neck", wound("E1", 32.5) + STRETCHED + wound("A1", 20.9), obstacle=NECK_OBSTACLE)
OPEN = preset("open", steel("G2") + STRETCHED + steel("C3"), output=HEARD, more=ONE_WAY)
OPEN = OPEN.with_setting("pluck.displacement_mm", "8")
TWO = preset(
    "two", wound("E1", 32.5) + STRETCHED + wound("A1", 20.9) + STRETCHED, output=HEARD, more=MODES + TWO_WAYS,
    obstacle=NECK_OBSTACLE,
)  # fmt: skip
ALL = [BRIDGE, NECK, OPEN, TWO]
ROWS = {
    "bridge": [
        (0, NOTE_ON, 0, 43, 127), (437, NOTE_ON, 0, 48, 127), (2600, KEY_PRESSURE, 0, 48, 127), (3100, BEND, 0, -3000),
        (3300, NOTE_ON, 0, 43, 90), (5000, BEND, 0, 0),
    ],
    "neck": [(3, NOTE_ON, 0, 28, 127), (1400, NOTE_ON, 0, 31, 120), (2900, NOTE_OFF, 0, 31), (3333, BEND, 0, 8191)],
    "open": [(5, NOTE_ON, 0, 43, 127), (900, NOTE_ON, 0, 48, 60), (2000, BEND, 0, 6000), (3001, NOTE_OFF, 0, 43)],
    "two": [
        (3, NOTE_ON, 0, 28, 127), (700, NOTE_ON, 0, 33, 100), (1400, NOTE_ON, 0, 31, 120), (2900, NOTE_OFF, 0, 31),
        (3333, BEND, 0, 8191), (4000, NOTE_ON, 0, 34, 127),
    ],
}  # fmt: skip


def turn_of(made: Engine, omega: float, frames: int) -> float:
    """How far the first mode of string 0, of about this ω, turns in so many frames, looked at every quantum [rad]."""
    angles = []
    for quantum in range(frames // layout.QUANTUM + 1):
        if quantum:
            play(made, [], layout.QUANTUM)
        q, v = state_of(made, 0)
        angles.append(math.atan2(-v[0], omega * q[0]))
    return float(np.unwrap(angles)[-1] - np.unwrap(angles)[0])


def omega_under(model: StringModel, n: int, length: float, rise_n: float) -> np.ndarray:
    """(n,) with so much more tension: every ω² has risen by k²ΔT/μ."""
    return np.sqrt(model.omega[:n] ** 2 + (np.arange(1, n + 1) * math.pi / length) ** 2 * rise_n / model.mu)


def mean_rise(made: Engine, length: float, n: int) -> float:
    """EA/4 Σ (jπ/L)² a_j²/2 of u = Σ a_j sin(jπx/L), a_j the amplitudes of string 0 at the frequencies under it [N]."""
    (q, v), model, rise = state_of(made, 0), model_of(made, 0), 0.0
    for _ in range(30):
        a = math.sqrt(2.0 / length) * np.hypot(q[:n], v[:n] / omega_under(model, n, length, rise))
        rise = STEEL_N / 4.0 * float(np.sum((np.arange(1, n + 1) * math.pi / length) ** 2 * a**2)) / 2.0
    return rise


@pytest.mark.parametrize(("displacement_mm", "glide"), [(2.0, 4.7), (4.0, 18.5), (7.0, 54.0)])
def test_the_glide_is_that_of_the_mean_stretch(displacement_mm: float, glide: float) -> None:
    """Against T = T₀ + EA/4 Σ (jπ/L)² a_j²/2, to within what the steps of the tension and the decay in a window come to."""
    made = engine(ALONE.with_setting("pluck.displacement_mm", str(displacement_mm)))
    play(made, [(0, NOTE_ON, 0, 43, 127)], 1024)
    place, model = bank_of(made).models[made._sounding.hands["model"][0]], model_of(made, 0)
    length, n, frames = float(place["length"]), int(place["own"]), 64 * layout.QUANTUM
    glides = []
    for _ in range(4):
        before = mean_rise(made, length, n)
        measured = turn_of(made, omega_under(model, 1, length, before)[0], frames) / (frames / RATE_HZ)
        rise = 0.5 * (before + mean_rise(made, length, n))
        omega = math.sqrt(omega_under(model, 1, length, rise)[0] ** 2 - model.sigma[0] ** 2)
        glides.append(1200.0 * math.log2(omega / model.omega[0]))
        assert 1200.0 * math.log2(measured / omega) == pytest.approx(0.0, abs=0.1 + 0.01 * glides[-1])
        play(made, [], 344 * layout.QUANTUM)
    assert glides == sorted(glides, reverse=True)
    assert glides[0] == pytest.approx(glide, rel=0.05)


def whole(made: Engine) -> float:
    """Energy of strings that are stretched [J]: E − (T − T₀)² L/(2EA), see `tension`."""
    sounding, bank = made._sounding, bank_of(made)
    if bank.instruments["body"][0] >= 0:
        total = float(coupling.energy_of(made._strings.bridges.coupling_tables[0].ctypes.data))
    else:
        total = sum(energy_now(made, s) for s in range(sounding.voices.size) if sounding.voices["awake"][s])
    for s in range(sounding.voices.size):
        stiffness = float(bank.strings["axial_stiffness"][s])
        if stiffness > 0.0 and sounding.voices["awake"][s]:
            model = bank.models[sounding.hands["model"][s]]
            total -= (sounding.expressions["rise"][s] * model["tension"]) ** 2 * model["length"] / (2.0 * stiffness)
    return total


def energy_now(made: Engine, s: int) -> float:
    """½ μ Σ (v² + ω² q²) with the coefficients that string s has now, and what the compliance of its contacts holds [J]."""
    q, v = state_of(made, s)
    if not made._sounding.motions["altered"][s]:
        return energy(made, s)
    omega = made._strings.coefficients.items[s].omega[: q.size]
    force, residual = made._strings.states.items[s].force, model_of(made, s).contacts.residual
    held = force[: residual.shape[0]]
    return 0.5 * model_of(made, s).mu * float(np.sum(v**2 + (omega * q) ** 2)) + 0.5 * float(held @ residual @ held)


@pytest.mark.parametrize("instrument", [ALONE, BRIDGE, NECK, OPEN, TWO], ids=lambda each: each.name)
def test_no_step_of_the_tension_feeds_the_string(instrument: Preset) -> None:
    made = engine(instrument)
    rows = ROWS.get(instrument.name, [(0, NOTE_ON, 0, 43, 127)])
    play(made, [row for row in rows if row[1] == NOTE_ON and row[0] < 1000], 2048)
    assert made._sounding.expressions["rise"].max() > 10.0 * LEAST_RISE
    first = before = whole(made)
    steps = 0
    for _ in range(400):
        was = made._sounding.expressions["rise"].copy()
        play(made, [], layout.QUANTUM)
        now = whole(made)
        assert now <= before * (1.0 + 1e-12)
        steps += int(not np.array_equal(was, made._sounding.expressions["rise"]))
        before = now
    assert steps > 5
    assert before < 0.95 * first


@pytest.mark.parametrize("instrument", ALL, ids=lambda each: each.name)
def test_neither_blocks_nor_threads_nor_a_state_matter(instrument: Preset) -> None:
    rows = ROWS[instrument.name]
    once = play(engine(instrument), rows, 6000, 4096)
    assert np.abs(once).max() > 1e-4
    sizes = np.random.default_rng(6).integers(1, 400, 6000)
    assert np.array_equal(play(engine(instrument), rows, 6000, [int(size) for size in sizes]), once)
    assert np.array_equal(play(engine(instrument, ALONE, threads=2), rows, 6000, 333), once)
    for at in (517, 2304):
        made = engine(instrument)
        play(made, [row for row in rows if row[0] < at], at)
        assert made._sounding.expressions["rise"].max() > 0.0
        other = engine(instrument)
        play(other, [(0, NOTE_ON, 0, 33 if instrument in (NECK, TWO) else 43, 127)], 700)
        go_on_from(other, what_sounds(made))
        later = [(row[0] - at, *row[1:]) for row in rows if row[0] >= at]
        assert np.array_equal(play(other, later, 3000, 77), play(made, later, 3000))


def test_a_string_that_moves_little_flies_and_sleeps_as_ever() -> None:
    """It flies with the tension that it has; once that is within a twentieth of a cent of the tension at rest it has its
    model's coefficients again."""
    high = 'kind = "bridge"\ndistance_mm = 6.0\njiva_um = 900.0'
    soft = preset("soft", steel("C5") + STRETCHED, obstacle=high, damping="release_s = 0.1")
    made = engine(soft)
    play(made, [(0, NOTE_ON, 0, 72, 127)], 1024)
    assert made._sounding.motions["altered"][0] == 1
    for _ in range(40):
        play(made, [], 4096)
        if made._sounding.expressions["rise"][0] == 0.0:
            break
    assert made._sounding.motions["flying"][0] == layout.FLYING
    assert made._sounding.expressions["rise"][0] == 0.0 and made._sounding.motions["altered"][0] == 0
    play(made, [(0, NOTE_OFF, 0, 72)], 66150)
    assert made._sounding.voices["awake"][0] == 0


def test_a_neighbour_without_it_sounds_as_ever() -> None:
    rows = [(0, NOTE_ON, 0, 48, 127), (1000, NOTE_ON, 0, 43, 127)]
    plain = preset("plain", steel("G2") + steel("C3"), obstacle=BRIDGE_OBSTACLE, damping="ring_on = true")
    mixed = preset("plain", steel("G2") + STRETCHED + steel("C3"), obstacle=BRIDGE_OBSTACLE, damping="ring_on = true")
    sound, other = play(engine(plain), rows, 3000), play(engine(mixed), rows, 3000)
    assert np.array_equal(sound[:1000], other[:1000]) and not np.array_equal(sound, other)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("axial_stiffness_n = 20000", "string.0: axial_stiffness_n has an effect only with tension_modulation = true"),
        ("tension_modulation = true\naxial_stiffness_n = 0", "must lie between 1 and 1e+06, got 0"),
        ("tension_modulation = 3", "tension_modulation"),
    ],
)
def test_what_cannot_be_is_refused(more: str, said: str) -> None:
    with pytest.raises(PresetError, match=said.replace("+", r"\+")):
        preset("wrong", steel("G2") + more + "\n")


def test_a_string_given_by_its_inharmonicity_needs_its_axial_stiffness() -> None:
    by_partials = steel("G2").replace("youngs_modulus_gpa = 200", "inharmonicity = 2e-5")
    with pytest.raises(PresetError, match=r"string\.0: tension_modulation needs .* resistance .*give axial_stiffness_n"):
        preset("wrong", by_partials + STRETCHED)
    with pytest.raises(PresetError, match="youngs_modulus_gpa above 0, got 0"):
        preset("wrong", steel("G2").replace("= 200", "= 0") + STRETCHED)
    made = engine(preset("given", by_partials + STRETCHED + "axial_stiffness_n = 12000\n"))
    assert bank_of(made).strings["axial_stiffness"][0] == 12000.0
    assert bank_of(engine(NECK)).strings["axial_stiffness"] == pytest.approx([WOUND_N, 0.0])
