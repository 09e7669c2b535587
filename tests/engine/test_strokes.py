"""Strokes: what slides off a finger, what is thrown, what lies on a string, and hands that never do the same twice."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from synth.engine import layout
from synth.engine.chance import even, key_of, spread
from synth.engine.engine import Engine
from synth.engine.strokes import RUB_S
from synth.instrument.preset import Preset, PresetError
from synth.midi.events import NOTE_OFF, NOTE_ON, PARAMETER
from synth.solver import coupling

from .kit import (
    BRIDGE_OBSTACLE,
    FORCE,
    NECK_OBSTACLE,
    QUANTUM,
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
    string_of,
    what_sounds,
    wound,
)
from .test_together import MODES, TWO_WAYS, coupling_of
from .test_together import energy as energy_together

HAND = "[hand]\nplace_mm = 4\nlevel_db = 1\nwidth_percent = 10\ntime_percent = 15\n"
RELEASE = "release = { place = 0.8, width_mm = 12, resistance = 0.5 }\n"
HARMONIC = "touch = { place = 0.5, width_mm = 8, resistance = 0.5, lift_ms = 120 }\n"
PALM = "touch = { place = 0.04, width_mm = 20, resistance = 2.0 }\n"
THUMB = 'stroke = "throw"\nmass_g = 15\nspeed_m_s = 1.5\nstiffness_n_mm = 20\n'
NORMAL = "[articulations.normal]\n"
HEARD = 'kind = "body"\ngain_db = -40'


def one(more: str = "", pluck: str = "", **tables: str) -> Preset:
    """A steel string at G2 (note 43) that touches nothing."""
    return preset("one", steel("G2"), output=FORCE, pluck=pluck, more=more, **tables)


def forces(made: Engine, count: int) -> np.ndarray:
    """(count,) what the finger does to string 0 at the end of each of so many quanta."""
    out = []
    for _ in range(count):
        play(made, [], QUANTUM, QUANTUM)
        out.append(string_of(made, 0).finger[0]["push"])
    return np.array(out)


def begin(made: Engine, note: int = 43, velocity: int = 127) -> None:
    """A note at the start of the next quantum that is computed."""
    play(made, [(0, NOTE_ON, 0, note, velocity)], QUANTUM, QUANTUM)


# --- letting go ---


@pytest.mark.parametrize("scheme", ["exact-hold", "moreau-jean"])
def test_the_force_of_a_finger_fades_as_half_a_cosine(scheme: str) -> None:
    made = engine(one(pluck="draw_ms = 5\nslip_ms = 20"), scheme=scheme, internal_rate_hz=88200.0)
    begin(made)
    hand, stroke = made._sounding.hands[0], made._sounding.strokes[0]
    while hand["phase"] != layout.SLIP:
        play(made, [], QUANTUM, QUANTUM)
    start = stroke["finger_from"] * 1e-3  # of a spring of 1e-3 N/m
    assert start > 0.1  # N
    unit = 1.0 if scheme == "exact-hold" else 88200.0
    steps = stroke["finger_steps"]
    assert steps == 2 * round(0.020 * RATE_HZ)
    for _ in range(20):
        play(made, [], QUANTUM, QUANTUM)
        if hand["phase"] != layout.SLIP:
            break
        wanted = 0.5 * start * (1.0 + math.cos(math.pi * stroke["finger_step"] / steps))
        assert string_of(made, 0).finger[0]["push"] * unit == pytest.approx(wanted, rel=1e-4, abs=2e-5 * start)


def partials(out: np.ndarray, at: int, count: int, first_hz: float) -> np.ndarray:
    """(count,) levels of partials [dB] over 8192 frames."""
    spectrum = np.abs(np.fft.rfft(out[at : at + 8192, 0] * np.hanning(8192), 1 << 16))
    hz = np.arange(spectrum.size) * RATE_HZ / (1 << 16)
    near = [np.abs(hz - first_hz * (k + 1)) < 0.3 * first_hz for k in range(count)]
    return np.array([20.0 * math.log10(spectrum[band].max()) for band in near])


def test_partials_above_the_inverse_of_that_time_are_weaker() -> None:
    hz = 440.0 * 2.0 ** ((43 - 69) / 12)
    levels = [
        partials(play(engine(one(pluck=f"draw_ms = 100\nslip_ms = {ms}")), [(0, NOTE_ON, 0, 43, 90)], 16000), 5000, 16, hz)
        for ms in (0.0, 2.0)
    ]
    lost = levels[0] - levels[1]
    k = np.arange(1, 17)
    turn = 2.0 * k * hz * 0.002  # half a cosine of duration τ: |cos(πfτ)| / |1 − (2fτ)²|
    wanted = -20.0 * np.log10(np.abs(np.cos(0.5 * math.pi * turn) / (1.0 - turn**2)) + 1e-12)
    low = (wanted < 15.0) & (levels[0] > levels[0].max() - 40.0)
    assert low.sum() >= 3
    np.testing.assert_allclose(lost[low], wanted[low], atol=1.0)
    assert lost[-4:].min() > 15.0


# --- what varies ---


@njit
def chances(seed: int, dice: int, strokes: int) -> tuple[int, float, float, float]:
    """The engine's, which only compiled code may call: (key, two that are normal, one that is even)."""
    key = key_of(seed, dice, strokes)
    return key, spread(key, 1), spread(key, 2), even(key, 2)


def test_chances_are_spread_as_they_should_be() -> None:
    _, normal, other, flat = np.array([chances(7, 3, n) for n in range(4000)]).T
    assert abs(normal.mean()) < 0.06 and abs(normal.std() - 1.0) < 0.05 and np.abs(normal).max() < 3.5
    assert abs(flat.mean()) < 0.03 and abs(flat.std() - 1.0 / math.sqrt(3.0)) < 0.02
    assert abs(np.corrcoef(normal, other)[0, 1]) < 0.06
    assert abs(np.corrcoef(normal[1:], normal[:-1])[0, 1]) < 0.06
    assert len({chances(a, b, c)[0] for a in range(8) for b in range(8) for c in range(8)}) == 512


def twice(instrument: Preset, **more: int) -> tuple[np.ndarray, np.ndarray]:
    """The same note twice, each from silence."""
    made = engine(instrument, **more)
    first = play(made, [(0, NOTE_ON, 0, 43, 90), (9000, NOTE_OFF, 0, 43, 0)], 44032)
    assert not made._sounding.voices["awake"].any()
    return first, play(made, [(0, NOTE_ON, 0, 43, 90), (9000, NOTE_OFF, 0, 43, 0)], 44032)


def test_no_two_strokes_are_the_same_but_two_performances_are() -> None:
    instrument = one(HAND)
    first, second = twice(instrument)
    again, _ = twice(instrument)
    other, _ = twice(instrument, seed=1)
    np.testing.assert_array_equal(first, again)
    for different in (second, other):
        assert np.abs(first - different).max() > 0.02 * np.abs(first).max()


def test_it_can_be_switched_off() -> None:
    made = engine(one(HAND))
    rows = [(0, PARAMETER, 0, layout.VARIATION, 0, 0.0), (1, NOTE_ON, 0, 43, 90)]
    plain = play(engine(one()), [(1, NOTE_ON, 0, 43, 90)], 8000)
    np.testing.assert_array_equal(play(made, rows, 8000), plain)


def test_what_else_sounds_changes_nothing_of_it() -> None:
    instrument = preset("three", steel("C3-E3"), output=FORCE, more=HAND)
    rows = [(0, NOTE_ON, 0, 50, 90), (4000, NOTE_ON, 0, 50, 90)]
    others = [(100, NOTE_ON, 1, 43, 90), (500, NOTE_ON, 1, 43, 80)]
    program = np.full((16, 128), -1)
    program[0], program[1] = 0, 1
    alone = play(engine(instrument, only_notes=[{50}]), rows, 9000)
    stems = np.zeros((2, 9000, 2))
    play(engine(instrument, one(), program_map=program), rows + others, 9000, stems=stems)
    np.testing.assert_allclose(stems[0], alone, rtol=0, atol=1e-15)


def test_a_finger_that_rubs_is_heard_while_it_draws() -> None:
    smooth, rough = (
        play(engine(one(pluck=f"draw_ms = 20\nroughness_um = {um}")), [(0, NOTE_ON, 0, 43, 90)], 800) for um in (0.0, 5.0)
    )
    difference = (rough - smooth)[200:, 0]
    assert np.abs(difference).max() > 1e-4 * np.abs(smooth).max()
    spectrum = np.abs(np.fft.rfft(difference)) ** 2
    hz = np.fft.rfftfreq(difference.size, 1.0 / RATE_HZ)
    assert spectrum[hz > 1.0 / RUB_S].sum() < 0.2 * spectrum.sum()  # it takes no sharper turns than it is said to


# --- what is thrown ---


def exact_throw(made: Engine, mass: float, speed: float) -> tuple[float, float, float]:
    """(time in contact [s], speed afterwards [m/s], energy of the string [J]) of a mass behind spring and dashpot."""
    model, string = model_of(made, 0), string_of(made, 0)
    n = int(model.modes)
    omega, sigma, weights = model.omega[:n], _sigma(model), string.grip.weights[:n]
    finger = string.finger[0]
    k, r = float(finger["stiffness"]), float(finger["resistance"])

    def force(y: np.ndarray) -> float:
        q, v, z, w = y[:n], y[n : 2 * n], y[-2], y[-1]
        return k * (z - weights @ q) + r * (w - weights @ v)

    def move(_: float, y: np.ndarray) -> np.ndarray:
        q, v = y[:n], y[n : 2 * n]
        f = force(y)
        return np.concatenate([v, -(omega**2) * q - 2.0 * sigma * v + weights * f / model.mu, [y[-1], -f / mass]])

    def leaves(t: float, y: np.ndarray) -> float:
        return force(y) if t > 1e-4 else -1.0

    leaves.terminal, leaves.direction = True, 1.0  # type: ignore[attr-defined]
    start = np.zeros(2 * n + 2)
    start[-1] = speed
    found = solve_ivp(move, (0.0, 0.03), start, method="DOP853", rtol=1e-8, atol=1e-12, events=leaves)
    end = found.y[:, -1]
    return found.t[-1], float(end[-1]), 0.5 * model.mu * float(np.sum(end[n:-2] ** 2 + (omega * end[:n]) ** 2))


def _sigma(model) -> np.ndarray:
    """σ of the modes of a model, from its step: p11 p22 − p12 p21 = e^(−2σdt)."""
    p11, p12, p21, p22 = model.rows[:4, : model.modes]
    return -0.5 * np.log(p11 * p22 - p12 * p21) / model.dt


@pytest.mark.parametrize(("mass_g", "speed"), [(5.0, 1.0), (15.0, 1.5), (60.0, 0.5)])
def test_a_mass_that_is_thrown_bounces_as_it_should(mass_g: float, speed: float) -> None:
    way = NORMAL + f'stroke = "throw"\nmass_g = {mass_g}\nspeed_m_s = {speed}\nstiffness_n_mm = 20\nposition = 0.2\n'
    made = engine(one(way), quality="reference")
    begin(made)
    hand, stroke = made._sounding.hands[0], made._sounding.strokes[0]
    play(made, [], QUANTUM, QUANTUM)
    assert hand["phase"] == layout.HIT
    seconds, after, given = exact_throw(made, 1e-3 * mass_g, -speed)
    quanta = 1
    while hand["phase"] == layout.HIT:
        play(made, [], QUANTUM, QUANTUM)
        quanta += 1
    assert seconds == pytest.approx(quanta * QUANTUM / RATE_HZ, abs=2.0 * QUANTUM / RATE_HZ)
    assert stroke["thrown"] == pytest.approx(after, abs=0.02 * speed)
    assert energy(made, 0) == pytest.approx(given, rel=0.05)
    assert given < 0.5e-3 * mass_g * speed**2  # it has what the mass has lost, less what the flesh took


def test_a_thumb_drives_the_string_onto_the_frets() -> None:
    neck = preset(
        "neck", wound("E1", 32.5), obstacle=NECK_OBSTACLE, output='kind = "force"\ngain_db = -24', more=NORMAL + THUMB
    )
    made = engine(neck)
    play(made, [(0, NOTE_ON, 0, 28, 127)], 2000)
    assert string_of(made, 0).u.size > 3
    assert np.abs(play(made, [], 4000)).max() > 0.0
    soft = engine(neck)
    loud, quiet = play(engine(neck), [(0, NOTE_ON, 0, 28, 127)], 6000), play(soft, [(0, NOTE_ON, 0, 28, 40)], 6000)
    bright = [np.abs(np.diff(each[:, 0], 2)).max() / np.abs(each).max() for each in (loud, quiet)]
    assert bright[0] > 2.0 * bright[1]


# --- what lies on a string ---


def test_a_touch_damps_as_a_dashpot_there_does() -> None:
    made = engine(one(NORMAL + "touch = { place = 0.3, width_mm = 8, resistance = 0.7 }"), quality="reference")
    begin(made)
    play(made, [], 32 * QUANTUM, QUANTUM)
    hand, string, model = made._sounding.hands[0], string_of(made, 0), model_of(made, 0)
    assert hand["phase"] == layout.TOUCHED
    resistance = float(string.finger[0]["resistance"])
    assert resistance == pytest.approx(0.7 * bank_of(made).strings["impedance"][0], rel=1e-12)
    n = int(model.modes)
    weights, omega = string.grip.weights[:n].copy(), model.omega[:n]
    q, v = (each.copy() for each in state_of(made, 0))
    quanta = 40
    play(made, [], quanta * QUANTUM, QUANTUM)
    system = np.zeros((2 * n, 2 * n))
    system[:n, n:] = np.eye(n)
    system[n:, :n] = -np.diag(omega**2)
    system[n:, n:] = -2.0 * np.diag(_sigma(model)) - resistance / model.mu * np.outer(weights, weights)
    wanted = expm(system * quanta * QUANTUM / RATE_HZ) @ np.concatenate([q, v])
    few = 12
    size = np.sqrt(np.sum((omega[:few] * q[:few]) ** 2 + v[:few] ** 2))
    error = np.sqrt(
        np.sum((omega * (state_of(made, 0)[0] - wanted[:n]))[:few] ** 2 + (state_of(made, 0)[1] - wanted[n:])[:few] ** 2)
    )
    assert error < 0.01 * size
    left = np.sqrt(np.sum((omega * wanted[:n])[:few] ** 2 + wanted[n:][:few] ** 2))
    assert left < 0.5 * size  # and it has damped


def test_a_touched_string_gives_its_harmonic() -> None:
    hz = 440.0 * 2.0 ** ((43 - 69) / 12)
    levels = partials(play(engine(one(NORMAL + HARMONIC)), [(0, NOTE_ON, 0, 43, 100)], 24000), 12000, 4, hz)
    assert levels[1] > levels[0] + 30.0 and levels[3] > levels[2] + 20.0


def test_a_release_damps_the_high_partials_first() -> None:
    hz = 440.0 * 2.0 ** ((43 - 69) / 12)
    instrument = one("[hand]\nrelease = { place = 0.95, width_mm = 12, resistance = 0.5 }", damping="release_s = 3.0")
    made = engine(instrument)
    play(made, [(0, NOTE_ON, 0, 43, 110)], 12000)
    out = play(made, [(0, NOTE_OFF, 0, 43, 0)], 40000)
    fall = partials(out, 1000, 6, hz) - partials(out, 9000, 6, hz)
    assert fall[0] < fall[1] < fall[2] < fall[4]
    play(made, [], 4 * 44100)
    assert not made._sounding.voices["awake"].any()


ALL = {
    "slips": one(HAND + RELEASE, "slip_ms = 2\nslip_hard_ms = 0.2\nroughness_um = 3"),
    "hit": preset(
        "hit", wound("E1", 32.5) + wound("A1", 20.9), obstacle=NECK_OBSTACLE, more=HAND + RELEASE + NORMAL + THUMB + PALM
    ),
    "buzz": preset(
        "buzz", steel("G2") + steel("C3"), obstacle=BRIDGE_OBSTACLE, output=FORCE, more=HAND + RELEASE + NORMAL + PALM
    ),
    "together": preset(
        "together", wound("E1", 32.5) + wound("A1", 20.9), output=HEARD, obstacle=NECK_OBSTACLE, pluck="slip_ms = 1",
        more=MODES + TWO_WAYS + HAND + RELEASE + NORMAL + HARMONIC,
    ),
    "thrown together": preset(
        "thrown", wound("E1", 32.5) + wound("A1", 20.9), output=HEARD, more=MODES + TWO_WAYS + NORMAL + THUMB + PALM,
    ),
}  # fmt: skip
NOTES = {"slips": (43, 43), "buzz": (43, 48)}


def rows_of(name: str) -> list[tuple]:
    low, high = NOTES.get(name, (28, 35))
    return [
        (0, NOTE_ON, 0, low, 120), (700, NOTE_ON, 0, high, 127), (2600, NOTE_OFF, 0, low, 0), (3000, NOTE_ON, 0, low, 60),
        (3100, NOTE_OFF, 0, low, 0), (4100, NOTE_ON, 0, low, 100), (5200, NOTE_OFF, 0, high, 0),
    ]  # fmt: skip


@pytest.mark.parametrize("name", ALL)
def test_neither_blocks_nor_threads_nor_a_state_matter(name: str) -> None:
    instrument, rows = ALL[name], rows_of(name)
    whole = play(engine(instrument), rows, 9000)
    assert np.isfinite(whole).all() and np.abs(whole).max() > 1e-4
    rng = np.random.default_rng(5)
    np.testing.assert_array_equal(whole, play(engine(instrument), rows, 9000, iter(rng.integers(1, 700, 9000).tolist())))
    threaded = engine(instrument, threads=2)
    np.testing.assert_array_equal(whole, play(threaded, rows, 9000))
    threaded.close()
    for cut in (180, 833, 2700, 4200):
        first, second = engine(instrument), engine(instrument)
        play(first, [row for row in rows if row[0] < cut], cut)
        go_on_from(second, what_sounds(first))
        np.testing.assert_array_equal(
            whole[cut:], play(second, [(row[0] - cut, *row[1:]) for row in rows if row[0] >= cut], 9000 - cut)
        )


@pytest.mark.parametrize("name", ["together", "thrown together"])
def test_a_touch_gives_no_energy_to_strings_that_share_a_body(name: str) -> None:
    made = engine(ALL[name])
    play(made, rows_of(name)[:2], 2400)
    assert set(made._sounding.hands["phase"]) <= {layout.NO_FINGER, layout.TOUCHED}
    before = energy_together(made)
    for _ in range(150):
        play(made, [], QUANTUM)
        assert energy_together(made) <= before * (1.0 + 1e-9)
        before = energy_together(made)
    assert coupling_of(made).counts[coupling.HELD_FRAMES] == 0


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ('[articulations.a]\nkey = "G2"', "articulations.a.key: must lie below the lowest note, G2, got G2"),
        ('[articulations.a]\nkey = "C1"', "there must be a way back from a: give \\[articulations.normal\\] a key"),
        ('[articulations.a]\nkey = "C1"\n[articulations.normal]\nkey = "C1"', "C1 already switches to a"),
        ("[articulations.a]\ncontroller = 20\n[articulations.b]\ncontroller = 20", "overlaps with that of a"),
        ("[articulations.a]\nmass_g = 21", 'mass_g needs stroke = "throw"'),
        ("[articulations.a]\nharmonic = true", "harmonic needs a touch"),
        ("[articulations.a]\nvelocity = [100, 90]", "must be two velocities from 1 to 127, the lower first"),
        ("[articulations.a]\ntouch = { place = 1.5, resistance = 1 }", "articulations.a.touch.place"),
        ("[hand]\nlevel_db = -1", "hand.level_db"),
        ("[articulations.A]", "articulations.A"),
    ],
)
def test_what_cannot_be_is_refused(table: str, said: str) -> None:
    with pytest.raises(PresetError, match=said):
        one(table)


def test_an_articulation_that_is_empty_is_the_pluck() -> None:
    plain = play(engine(one()), [(0, NOTE_ON, 0, 43, 90)], 4000)
    np.testing.assert_array_equal(play(engine(one(NORMAL)), [(0, NOTE_ON, 0, 43, 90)], 4000), plain)
