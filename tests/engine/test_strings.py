"""What one string does: the whole note against a twin, energy, re-plucks, change of fret, damping, obstacles that move."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

from synth.dsp.decimator import decimate_reference, design
from synth.dsp.measures import click_ratios, decay_time_s, sounding_fundamental
from synth.engine import layout
from synth.engine.engine import DC_BLOCK_HZ
from synth.engine.strings import FINGER_S, change_model
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER
from synth.solver import stringmodel
from synth.units import cents

from .kit import (
    BRIDGE,
    FREE,
    NECK,
    ONE_NECK,
    PRESSED,
    QUANTUM,
    RATE_HZ,
    awake,
    energy,
    engine,
    model_of,
    play,
    preset,
    state_of,
    steel,
    until_state_at,
)
from .twin import Twin

#: a discontinuity; stationary noise gives about 2, a buzz its crest factor
CLICK = 4.0


@pytest.fixture(scope="module")
def free():
    return engine(FREE, economy=False, precision="float64")


@pytest.fixture(scope="module")
def bridge():
    return engine(BRIDGE, economy=False, precision="float64")


@pytest.fixture(scope="module")
def neck():
    return engine(ONE_NECK)


# --- against the twin -------------------------------------------------------------------------------------------------


def heard(x: np.ndarray, factor: int) -> np.ndarray:
    """An internal output as it leaves the engine: each step at the instant it ends at, decimated, without DC."""
    y = decimate_reference(design(RATE_HZ, factor), factor, np.concatenate([[0.0], x[:-1]]))
    pole = math.exp(-2.0 * math.pi * DC_BLOCK_HZ / RATE_HZ)
    out, before, high = np.empty(y.size), 0.0, 0.0
    for i, now in enumerate(y):
        high = now - before + pole * high
        before, out[i] = now, high
    return out


@pytest.mark.parametrize("name", ["free", "bridge"])
def test_whole_note_and_repluck_equal_the_twin(name, request):
    """Finger, contact, release, a second finger on the sounding string: output to 1e-9 of the peak, energy in order."""
    made = request.getfixturevalue(name)
    chosen = FREE if name == "free" else BRIDGE
    string = made.compiled[0].strings[0]
    factor, note = string.factor, string.positions[0].note
    start, again, end = 96, 2016, 4000
    made.reset()
    out = play(made, [(start, NOTE_ON, 0, note, 127), (again, NOTE_ON, 0, note, 90)], end)[:, 0]

    twin = Twin(string.positions[0])
    held = round(string.draw_s * twin.position.plan.rate_hz / factor) * factor
    pieces = [np.zeros(start * factor)]
    touched = 0
    for velocity, length in ((127, (again - start) * factor), (90, (end - again) * factor)):
        sounding = velocity == 90
        if sounding:
            twin.damp(math.log(1000.0) / FINGER_S)
        before = twin.energy()
        y, work, forces = twin.run(held, twin.finger(string, chosen, velocity))
        # ΔE = λ·Δu − losses − what the contact takes, R's spring included: never more than the finger's work
        assert twin.energy() <= before + work * (1.0 + 1e-9)
        twin.damp(0.0)
        released = twin.energy()
        z, _, more = twin.run(length - held)
        assert twin.energy() <= released
        pieces += [y, z]
        touched += int(np.count_nonzero(forces) + np.count_nonzero(more))
    expected = heard(np.concatenate(pieces), factor)
    late = QUANTUM
    difference = np.abs(out[late:] - expected[: end - late]).max()
    assert difference <= 1e-9 * np.abs(out).max()
    assert (touched > 50) == (name == "bridge")
    assert made.latency_samples == QUANTUM + 37


def test_free_note_has_its_pitch_and_decay(free):
    free.reset()
    x = play(free, [(0, NOTE_ON, 0, 50, 90)], 90000)[2000:, 0]
    position = free.compiled[0].strings[2].positions[0]
    assert position.note == 50
    # of a damped oscillation: √(ω² − σ²)
    first = math.sqrt(position.omega[0] ** 2 - position.sigma[0] ** 2) / (2.0 * math.pi)
    assert abs(cents(sounding_fundamental(x, RATE_HZ, first * 1.003), first)) < 0.05
    expected = math.log(1000.0) / position.sigma[0]
    assert decay_time_s(x, RATE_HZ, first) == pytest.approx(expected, rel=0.01)


# --- linear without contact -------------------------------------------------------------------------------------------


def test_half_the_pluck_is_half_the_sound(free):
    free.reset()
    whole = play(free, [(0, NOTE_ON, 0, 50, 127)], 8000)
    free.reset()
    half = play(free, [(0, PARAMETER, 0, layout.PLUCK_AMOUNT, 0, 0.5), (0, NOTE_ON, 0, 50, 127)], 8000)
    assert np.array_equal(0.5 * whole, half)


def test_strings_add_up(free):
    both = [(0, NOTE_ON, 0, 50, 127), (700, NOTE_ON, 0, 55, 80)]
    parts = []
    for events in (both, both[:1], both[1:]):
        free.reset()
        parts.append(play(free, events, 8000))
    assert np.abs(parts[0] - parts[1] - parts[2]).max() <= 1e-13 * np.abs(parts[0]).max()


def test_economy_is_not_heard():
    """Pruned modes and certificates: what is left out is below 1e-8 full scale a mode, and decays."""
    for chosen, note, limit in ((FREE, 50, 1e-6), (BRIDGE, 43, 1e-6)):
        runs = [play(engine(chosen, economy=e), [(0, NOTE_ON, 0, note, 110)], 60000) for e in (False, True)]
        assert np.abs(runs[0] - runs[1]).max() <= limit * np.abs(runs[0]).max()


def test_economy_saves_work_and_is_not_heard_of_a_neck():
    """Certificates are proofs: while modes are all there, the same samples, but for the change to flight (−90 dB)."""
    made = [engine(ONE_NECK, economy=e) for e in (False, True)]
    outs = [play(m, [(0, NOTE_ON, 0, 45, 50)], 60000) for m in made]
    assert np.abs(outs[0] - outs[1]).max() <= 3e-5 * np.abs(outs[0]).max()
    assert made[1].mode_steps < 0.8 * made[0].mode_steps


# --- re-plucks --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("chosen, note", [(FREE, 50), (BRIDGE, 43), (NECK, 28)])
def test_replucks_do_not_click_nor_build_up(chosen, note):
    """T60 of 40 ms under a finger that lies there for 6 ms leaves 0.126 of the energy: what is carried over from pluck to
    pluck sums to at most 1/(1 − √0.126)² = 2.4 times one pluck's energy, 1.55 times its amplitude; with phases at random
    it is less. Contact and a pickup's nonlinearity may double the peak."""
    made = engine(chosen, quality="draft")
    single = play(made, [(0, NOTE_ON, 0, note, 127)], 8000)
    (s,) = awake(made)
    made.reset()
    most = 0.0
    for frame in range(288, 1000, 32):
        made.reset()
        until_state_at(made, [(0, NOTE_ON, 0, note, 127)], frame)
        most = max(most, energy(made, s))
    rng = np.random.default_rng(2)
    for gap_s in (0.3, 0.05, 0.012):
        times = np.cumsum(rng.uniform(0.3, 1.7, int(3.0 / gap_s)) * gap_s * RATE_HZ).astype(int)
        made.reset()
        out = play(made, [(int(t), NOTE_ON, 0, note, 127) for t in times], int(times[-1]) + 2000)
        assert np.abs(out).max() < 3.0 * np.abs(single).max()
        assert energy(made, s) < 2.4 * most
        if gap_s > 0.02:
            places = times[1:-1] + made.latency_samples
            release = places + int(0.006 * RATE_HZ)
            kinks = np.abs(np.diff(out[:, 0], 3))
            usual = np.quantile(kinks[places[0] :], 0.999)  # the buzz has kinks of its own
            near = np.concatenate([kinks[p - 6 : p + 3] for p in (*places, *release)])
            # a state that is set anew jumps by its own size; a finger that stops a moving string bends the curve
            assert near.max() < max(0.02 * np.abs(single).max(), 1.5 * usual)


def test_gentle_repluck_silences_a_loud_string(free):
    """A pluck at velocity 1 on a loud string: the finger takes away, it does not add."""
    (string,) = (s for s in free.compiled[0].strings if s.positions[0].note == 50)
    held = int(string.draw_s * RATE_HZ)
    frame = 8000
    free.reset()
    until_state_at(free, [(0, NOTE_ON, 0, 50, 127)], frame)
    loud = energy(free, 2)
    free.reset()
    until_state_at(free, [(0, NOTE_ON, 0, 50, 127), (frame, NOTE_ON, 0, 50, 1)], frame + 32 * (held // 32 + 1))
    assert energy(free, 2) < 0.3 * loud


# --- change of fret ---------------------------------------------------------------------------------------------------


@njit
def change_in(core, thread, s, target):
    change_model(core, thread, s, target)


def change(made, s, target):
    change_in(made._core.ctypes.data, made._thread_table.ctypes.data, s, target)


def models(made) -> dict[int, int]:
    return {int(row["fret"]): int(row["model"]) for row in made._bank.positions}


def line(made) -> tuple[np.ndarray, np.ndarray, float]:
    """Displacement from the open line and velocity at places before the saddle, and the force on the bridge."""
    model = made._bank.models[made._sounding.hands["model"][0]]
    q, v = state_of(made, 0)
    xi = np.linspace(0.005, 0.4, 40)
    k = np.arange(1, q.size + 1) * math.pi / model["length"]
    shape = math.sqrt(2.0 / model["length"]) * np.sin(np.outer(model["length"] - xi, k))
    weights = model_of(made, 0).outputs.weights[0, : q.size]
    return shape @ q + model["rest_height"] * xi / model["length"], shape @ v, float(weights @ q + model["line_output"])


@pytest.mark.parametrize("frets", [(3, 0), (8, 5), (12, 7), (12, 0), (1, 0)])
def test_pull_off_is_continuous_and_adds_the_stopped_strings_energy(neck, frets):
    """Displacement and velocity between fret and saddle do not move; the energy grows by no more than what the finger let
    go, ½ T h² (1/ℓ₁ + 1/ℓ₂) for the height h of the stopped string over the new line, and its kink's bending."""
    old, new = (neck._bank.models[models(neck)[f]] for f in frets)
    neck.reset()
    out = until_state_at(neck, [(0, NOTE_ON, 0, 43 + frets[0], 90)], 6400)
    u, v, force = line(neck)
    before = energy(neck, 0)
    change(neck, 0, models(neck)[frets[1]])
    u_after, v_after, force_after = line(neck)
    # the series of a kink of slope s, cut at mode N, is off by about s L/(π² N); velocity has the slope's jump only
    lift = float(old["rest_height"] - new["rest_height"] * old["length"] / new["length"])
    l1, l2 = float(old["length"]), float(new["length"] - old["length"])
    kink = abs(lift) * (1.0 / l1 + 1.0 / l2) + np.abs(u).max() * math.pi / l1
    assert np.abs(u_after - u).max() <= kink * new["length"] / (math.pi**2 * new["n"])
    assert np.abs(v_after - v).max() <= 0.02 * np.abs(v).max()
    # the force is heard at the bridge: a step in it is a click
    gain = np.abs(out).max()
    assert abs(force_after - force) < 0.05 * gain
    stretch = 0.5 * float(new["tension"]) * lift**2 * (1.0 / l1 + 1.0 / l2)
    # a kink's bending energy grows with the number of modes: Σ B j²/j² = B N beside Σ sin²(…)/j² of its tension
    omega = model_of(neck, 0).omega[: new["n"]]
    stiffness = ((omega[-1] / (omega[0] * omega.size)) ** 2 - 1.0) / omega.size**2
    assert energy(neck, 0) <= before + stretch * (1.0 + 4.0 * stiffness * omega.size)
    assert energy(neck, 0) >= 0.9 * before


@pytest.mark.parametrize("frets", [(0, 3), (5, 8), (0, 12), (7, 9)])
def test_hammer_on_is_continuous_and_takes_no_more_than_the_hand_gives(neck, frets):
    """The finger comes down on the new fret in 4 ms. By the triangle inequality of the energy norm the string ends with
    no more than √E = √E before + √W, W what the same stroke gives a string at rest, scaled by its length."""
    start = 6400
    press = 32 * 6
    legato = [(0, CONTROL, 0, 68, 127)]
    quiet = (0, PARAMETER, 0, layout.PLUCK_AMOUNT, 0, 0.0)
    first, second = ((at, NOTE_ON, 0, 43 + f, 90) for at, f in zip((1, start), frets, strict=True))
    neck.reset()
    until_state_at(neck, [*legato, first], start)
    before = energy(neck, 0)
    neck.reset()
    until_state_at(neck, [*legato, first, second], start + 32)
    row = neck._sounding.strokes[0]
    stroke = float(row["finger_to"] - row["finger_from"])
    alone = float(row["finger_to"])
    neck.reset()
    out = until_state_at(neck, [*legato, first, second], start + press)
    assert neck._sounding.hands["model"][0] == models(neck)[frets[1]]
    after = energy(neck, 0)
    # the same on a string at rest
    neck.reset()
    until_state_at(neck, [*legato, quiet, first, (32, NOTE_ON, 0, 43 + frets[1], 90)], 32 + press)
    at_rest = energy(neck, 0)
    assert neck._sounding.hands["model"][0] == models(neck)[frets[1]]
    assert math.sqrt(after) <= 1.02 * (math.sqrt(before) + math.sqrt(at_rest) * abs(stroke / alone))
    neck.reset()
    out = play(neck, [*legato, first, second], 12000)
    places = start + neck.latency_samples + np.arange(0, 200, 3)
    assert click_ratios(out[:, 0], places).max() < 2.0 * CLICK
    assert np.abs(out).max() < 1.0


def test_there_and_back_is_the_same(neck):
    """A smooth shape on fret 5, let go to the open string and stopped again: what is lost is the kink's cut series."""
    place = models(neck)
    neck.reset()
    until_state_at(neck, [(0, NOTE_ON, 0, 48, 90)], 3200)
    assert neck._sounding.hands["model"][0] == place[5]
    q, v = state_of(neck, 0)
    low = np.arange(1, 7)
    q[:], v[:] = 0.0, 0.0
    q[:6], v[:6] = 1e-3 / low**3, 0.1 / low**3
    q0, v0 = q.copy(), v.copy()
    change(neck, 0, place[0])
    change(neck, 0, place[5])
    q, v = state_of(neck, 0)
    assert np.abs(q - q0).max() <= 5e-3 * np.abs(q0).max()
    assert np.abs(v - v0).max() <= 1e-3 * np.abs(v0).max()


def over(begin: float, end: float, panels: int = 60) -> tuple[np.ndarray, np.ndarray]:
    """Places and weights of a quadrature."""
    x, w = np.polynomial.legendre.leggauss(64)
    edges = np.linspace(begin, end, panels + 1)
    half = 0.5 * np.diff(edges)
    return (edges[:-1, None] + half[:, None] * (x + 1.0)).ravel(), (half[:, None] * w).ravel()


def sines(model, xi: np.ndarray) -> np.ndarray:
    """(own modes, places) mode shapes, ξ from the saddle on."""
    numbers = np.arange(1, int(model["own"]) + 1)
    length = float(model["length"])
    return math.sqrt(2.0 / length) * np.sin(np.outer(numbers * math.pi / length, length - xi))


@pytest.mark.parametrize("frets", [(0, 3), (3, 0), (5, 8), (8, 7), (0, 12), (12, 0), (2, 2)])
def test_a_change_of_fret_is_the_projection_that_quadrature_gives(neck, frets):
    """Every new mode's q and v to 1e-10 of the largest (the closed form cancels where two sines are nearly one), of an old
    state without order, in all modes but the last three."""
    old, new = (neck._bank.models[models(neck)[f]] for f in frets)
    neck.reset()
    until_state_at(neck, [(0, NOTE_ON, 0, 43 + frets[0], 90)], 3200)
    n = int(old["own"])
    rng = np.random.default_rng(7)
    q, v = state_of(neck, 0)
    q[:], v[:] = 0.0, 0.0
    q[: n - 3] = 1e-4 * rng.normal(size=n - 3) / np.arange(1, n - 2)
    v[: n - 3] = rng.normal(size=n - 3)
    q0, v0 = q[:n].copy(), v[:n].copy()
    change(neck, 0, models(neck)[frets[1]])
    l_old, l_new = float(old["length"]), float(new["length"])
    xi, weight = over(0.0, min(l_old, l_new))
    here = sines(old, xi).T @ q0 + old["rest_height"] * xi / l_old
    if l_new < l_old:  # stopped where it is
        there = float((sines(old, np.array([l_new])).T @ q0)[0] + old["rest_height"] * l_new / l_old)
    else:
        there = float(new["rest_height"])
    expected = sines(new, xi) @ (weight * (here - there * xi / l_new))
    if l_new > l_old:  # straight from the fret on
        beyond, of_beyond = over(l_old, l_new)
        share = (beyond - l_old) / (l_new - l_old)
        straight = old["rest_height"] * (1.0 - share) + there * share - there * beyond / l_new
        expected += sines(new, beyond) @ (of_beyond * straight)
    own = int(new["own"])
    q, v = state_of(neck, 0)
    assert np.abs(q[:own] - expected).max() <= 1e-10 * np.abs(expected).max()
    expected = sines(new, xi) @ (weight * (sines(old, xi).T @ v0))
    assert np.abs(v[:own] - expected).max() <= 1e-10 * np.abs(expected).max()
    assert not q[own:].any() and not v[own:].any()


def test_change_to_the_same_length_changes_nothing(neck):
    neck.reset()
    until_state_at(neck, [(0, NOTE_ON, 0, 45, 90)], 3200)
    q, v = (x.copy() for x in state_of(neck, 0))
    change(neck, 0, models(neck)[2])
    assert np.allclose(state_of(neck, 0)[0], q, rtol=0, atol=1e-13 * np.abs(q).max())
    assert np.allclose(state_of(neck, 0)[1], v, rtol=0, atol=1e-13 * np.abs(v).max())


# --- passivity --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("chosen, note", [(BRIDGE, 43), (PRESSED, 43), (ONE_NECK, 43), (NECK, 30)])
def test_energy_never_rises_by_itself(chosen, note):
    """H = E + ½ λᵀRλ never rises from step to step, so E rises by no more than R held before: next to nothing of E."""
    made = engine(chosen, quality="draft")
    play(made, [(0, NOTE_ON, 0, note, 127)], 32 * 20, QUANTUM)
    (s,) = awake(made)
    energies = []
    for _ in range(600):
        play(made, [], QUANTUM, QUANTUM)
        energies.append(energy(made, s))
    rises = np.diff(energies) / energies[:-1]
    assert rises.max() < 1e-4
    assert energies[-1] < energies[0]


def test_bend_during_contact_stays_bounded():
    made = engine(BRIDGE, quality="draft")
    plain = np.abs(play(made, [(0, NOTE_ON, 0, 43, 127)], 30000)).max()
    made.reset()
    wobble = [(400 * k, BEND, 0, 8191 if k % 2 else -8192) for k in range(1, 74)]
    out = play(made, [(0, NOTE_ON, 0, 43, 127), *wobble], 30000)
    assert np.isfinite(out).all() and np.abs(out).max() < 2.0 * plain


def test_very_hard_plucks_stay_finite():
    for chosen, note in ((BRIDGE, 43), (NECK, 28)):
        made = engine(chosen.with_setting("pluck.displacement_mm", "20.0"), quality="draft")
        out = play(made, [(0, NOTE_ON, 0, note, 127), (9000, NOTE_ON, 0, note, 127)], 20000)
        assert np.isfinite(out).all()
        assert made.report().unsolved_contacts == 0


# --- obstacles --------------------------------------------------------------------------------------------------------


def test_height_sweep_is_bounded_and_without_clicks():
    made = engine(BRIDGE)
    plain = play(made, [(0, NOTE_ON, 0, 43, 110)], 44100)
    made.reset()
    rng = np.random.default_rng(4)
    sweep = [(int(f), PARAMETER, 0, layout.HEIGHT, 0, float(rng.uniform(-200, 50))) for f in range(2000, 44000, 700)]
    out = play(made, [(0, NOTE_ON, 0, 43, 110), *sweep], 44100)
    assert np.isfinite(out).all()
    assert np.abs(out).max() < 2.0 * np.abs(plain).max()
    assert not np.array_equal(out, plain)


@pytest.mark.parametrize("raised_um", [0.0, 50.0])
def test_a_pressed_string_starts_from_rest(raised_um):
    """Preset's thread 20 µm too low, or the bridge raised by parameter: silent until plucked, no thump, asleep after."""
    made = engine(PRESSED if raised_um == 0.0 else BRIDGE)
    raise_it = [(0, PARAMETER, 0, layout.HEIGHT, 0, raised_um)]
    pluck = 6000
    out = play(made, [*raise_it, (pluck, NOTE_ON, 0, 43, 100)], 20000)
    assert not out[:pluck].any()
    peak = np.abs(out).max()
    begin = pluck + made.latency_samples
    # the draw is a raised cosine: it begins without a step
    assert np.abs(out[begin - 30 : begin + 8]).max() < 1e-4 * peak
    made.reset()
    play(made, [*raise_it, (pluck, NOTE_ON, 0, 43, 100), (pluck + 5000, CONTROL, 0, 120, 0)], 80000)
    assert made.silent


def test_rest_line_follows_without_a_jump_to_sleep():
    """Heard as force, stopping a string moves the zero line; cut right after, it must not sleep before the line is back."""
    made = engine(ONE_NECK)
    cut = 900
    out = play(made, [(0, NOTE_ON, 0, 43, 30), (300, NOTE_ON, 0, 55, 1), (cut, CONTROL, 0, 120, 0)], 60000)[:, 0]
    assert made.silent
    # T60 of 30 ms: 4000 frames later the string is at −180 dB, and what is left is the line on its way, by 50 ms
    assert np.abs(np.diff(out[cut + 4000 :])).max() < 2e-5
    assert np.abs(out[-1000:]).max() < 1e-9


# --- no slow-down -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("chosen, note", [(FREE, 48), (BRIDGE, 43), (NECK, 28)])
def test_a_fading_note_never_gets_slower(chosen, note):
    made = engine(chosen, quality="draft")
    events = [(0, NOTE_ON, 0, note, 100)]
    second = int(RATE_HZ)
    play(made, events, second, 4096)
    first = made.mode_steps
    play(made, [], 58 * second, 4096)
    before = made.mode_steps
    last = play(made, [], second, 4096)
    assert made.mode_steps - before <= first
    for name, array in made.memory.changing.items():
        if array.dtype == np.float64:
            small = np.abs(array[array != 0.0])
            assert small.size == 0 or small.min() >= np.finfo(float).tiny, name
    assert np.isfinite(last).all()


def test_a_sleeping_string_costs_nothing():
    made = engine(FREE)
    play(made, [(0, NOTE_ON, 0, 50, 100), (5000, NOTE_OFF, 0, 50)], 60000)
    assert made.silent
    done = made.mode_steps
    out = play(made, [], 20000)
    assert made.mode_steps == done
    # the DC block is all that still rings
    assert np.abs(out[10000:]).max() < 1e-12


def test_bends_of_a_free_string_are_in_tune():
    made = engine(preset("one", steel("G3")))
    for wheel, expected in ((8191, 200.0 * 8191 / 8192), (-8192, -200.0), (4096, 100.0), (0, 0.0)):
        made.reset()
        x = play(made, [(0, BEND, 0, 4096), (10, BEND, 0, wheel), (8000, NOTE_ON, 0, 55, 90)], 60000)[12000:, 0]
        made.reset()
        y = play(made, [(8000, NOTE_ON, 0, 55, 90)], 60000)[12000:, 0]
        f = sounding_fundamental(y, RATE_HZ, 196.0)
        bent = sounding_fundamental(x, RATE_HZ, 196.0 * 2.0 ** (expected / 1200.0))
        assert abs(cents(bent, f) - expected) < 0.1


# --- schemes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("chosen, note", [(BRIDGE, 43), (NECK, 28)])
def test_schemes_agree_at_a_high_rate(chosen, note):
    """Over the first 50 ms, 24 × 44.1 kHz, where the published scheme is some 0.1 off over seconds."""
    runs = {}
    for scheme in ("exact-hold", "moreau-jean", "moreau-jean-filtered"):
        made = engine(
            chosen, scheme=scheme, internal_rate_hz=24 * RATE_HZ, restitution=0.0, only_notes=[{note}], economy=False
        )
        runs[scheme] = play(made, [(0, NOTE_ON, 0, note, 127)], int(0.05 * RATE_HZ) + made.latency_samples)[:, 0]
    reference = np.linalg.norm(runs["exact-hold"])
    assert reference > 0.0
    assert np.linalg.norm(runs["moreau-jean"] - runs["exact-hold"]) < 0.05 * reference
    assert np.linalg.norm(runs["moreau-jean-filtered"] - runs["exact-hold"]) < 0.03 * reference


def test_moreau_jean_takes_no_certificate():
    """v of Moreau–Jean is no velocity, so that the amplitudes of a certificate would not be those of the motion."""
    made = engine(ONE_NECK, scheme="moreau-jean", internal_rate_hz=4 * RATE_HZ)
    play(made, [(0, NOTE_ON, 0, 45, 20)], 30000)
    assert not any(state.counts[stringmodel.FREE] for state in made._strings.states.items)


def test_output_kinds_sound():
    for kind in ("force", "displacement", "velocity", "pickup", "flux"):
        made = engine(
            preset(
                "kind",
                steel("G2"),
                obstacle='kind = "bridge"\ndistance_mm = 6\njiva_um = 3',
                output=f'kind = "{kind}"\nposition = 0.1',
            )
        )
        out = play(made, [(0, NOTE_ON, 0, 43, 100)], 8000)
        assert np.isfinite(out).all() and out.any()
