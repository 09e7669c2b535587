"""Strings on rigid ends that move in two directions: the second is free whatever the first collides with, is heard as asked,
and goes with it through everything that a hand does."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from synth.instrument.compile import open_string, second_direction
from synth.instrument.preset import Preset, PresetError
from synth.midi.events import CONTROL, NOTE_OFF, NOTE_ON
from synth.physics.modes import decay_rates, modal_frequencies

from .handed import ACROSS, BUSY
from .kit import (
    FREE,
    NECK_OBSTACLE,
    QUANTUM,
    RATE_HZ,
    SHARED,
    awake,
    bank_of,
    engine,
    go_on_from,
    play,
    preset,
    random_events,
    state_of,
    string_of,
    until_state_at,
    what_sounds,
    wound,
)

NUT = "[[nut]]\nfrequency_hz = 150\nq = 20\nmass_kg = 2.0\n"


def bass(directions: str = "", *, output: str = 'kind = "force"\ngain_db = -24', nut: str = NUT) -> Preset:
    """An A string over twelve frets."""
    table = f"[polarisation]\n{directions}\n" if directions else ""
    return preset("bass", wound("A1", 20.9), obstacle=NECK_OBSTACLE, output=output, polyphony=1, more=table + nut)


def test_the_second_moves_freely_while_the_first_collides():
    """Its modes obey the exact solution ÿ + 2σẏ + ω²y = 0, with ω and σ as the table says, to rounding."""
    hard = bass("detuning_cents = 2\nloss_ratio = 1.5\npluck_deg = 30").with_setting("pluck.displacement_mm", "5")
    made = engine(hard, economy=False, precision="float64")
    begin, frames = 128 * QUANTUM, 64 * QUANTUM
    until_state_at(made, [(0, NOTE_ON, 0, 33, 127)], begin)
    string = made.compiled[0].strings[0]
    first, second = string.positions[0], second_direction(hard, string).positions[0]
    n = second.omega.size
    assert np.allclose(second.omega, 2.0 ** (2 / 1200) * first.omega[:n], rtol=1e-14)
    assert np.allclose(second.sigma, 1.5 * first.sigma[:n], rtol=1e-14)
    q, v = (each.copy() for each in state_of(made, 1))
    touched = 0.0
    for _ in range(frames // QUANTUM):
        play(made, [], QUANTUM)
        touched = max(touched, float(string_of(made, 0).force.max()))
    assert touched > 0.0
    t, damped = frames / RATE_HZ, np.sqrt(second.omega**2 - second.sigma**2)
    fade, c, s = np.exp(-second.sigma * t), np.cos(damped * t), np.sin(damped * t)
    wanted_q = fade * (c * q + s / damped * (v + second.sigma * q))
    wanted_v = fade * (c * v - s / damped * (second.omega**2 * q + second.sigma * v))
    got_q, got_v = state_of(made, 1)
    size = np.sqrt((q**2 + (v / second.omega) ** 2).sum())
    assert size > 1e-4
    assert np.abs(got_q - wanted_q).max() < 1e-10 * size
    assert np.abs((got_v - wanted_v) / second.omega).max() < 1e-10 * size


def test_a_share_of_the_nut_gives_way():
    """The first direction is the same whatever the share; the second is that of a string at the same tension whose nut has
    as much less mobility."""
    whole = bass()
    string = open_string(whole, whole.string[0], 33, None)[0]
    first = engine(whole).compiled[0].strings[0].positions[0]
    for share in (0.0, 0.5, 1.0, 2.0):
        instrument = bass(f"nut_share = {share}\nloss_ratio = 1.1")
        made = engine(instrument).compiled[0].strings[0]
        assert np.array_equal(made.positions[0].omega, first.omega)
        second = second_direction(instrument, made).positions[0]
        nut = [replace(each, mass_kg=each.mass_kg / share) for each in string.nut] if share else []
        other = replace(string, nut=tuple(nut))
        assert np.allclose(second.omega, modal_frequencies(other, second.own), rtol=1e-15)
        assert np.allclose(second.sigma, 1.1 * decay_rates(other, second.own), rtol=1e-15)
        assert share == 1.0 or not np.allclose(second.omega, first.omega[: second.own], rtol=1e-5)


@pytest.mark.parametrize(
    "output",
    [
        'kind = "force"\ngain_db = -24',
        'kind = "displacement"\nposition = 0.1\ngain_db = 50',
        'kind = "velocity"\nposition = 0.1\ngain_db = 10',
        'kind = "pickup"\nposition = 0.165\ndistance_mm = 5\naperture_mm = 12\ngain_db = -18',
        'kind = "flux"\nposition = 0.165\ndistance_mm = 5\naperture_mm = 12\ngain_db = 50',
    ],
    ids=["force", "displacement", "velocity", "pickup", "flux"],
)
@pytest.mark.parametrize("economy", [True, False])
def test_the_output_hears_as_much_of_it_as_asked(output, economy):
    """What the second adds goes with `heard`, and is what the first alone would give that moves as the second does."""
    rows = [(0, NOTE_ON, 0, 40, 100), (22000, NOTE_OFF, 0, 40)]
    none, part, most = (
        play(engine(bass(f"pluck_deg = 40\nheard = {heard}", output=output), economy=economy), rows, 30000)
        for heard in (0.0, 0.25, 1.0)
    )
    size = np.abs(most - none).max()
    assert size > 1e-3
    # with economy modes rest that come to less than 1e-8 at the output
    assert np.abs((part - none) - 0.25 * (most - none)).max() < (1e-7 if economy else 1e-11 * size)


def test_a_pluck_goes_to_both_by_its_angle():
    """On a string that nothing touches: cos θ of the pluck in the first, sin θ in the second, and the sum is heard."""
    rows, frames = [(0, NOTE_ON, 0, 48, 100)], 8000
    alone = play(engine(FREE, economy=False, precision="float64"), rows, frames)
    free = FREE.model_dump(exclude_unset=True)
    for degrees in (0.0, 30.0, 90.0, -40.0):
        across = {"pluck_deg": degrees, "heard": 0.5}
        turned = Preset.model_validate({**free, "polarisation": across})
        both = play(engine(turned, economy=False, precision="float64"), rows, frames)
        share = math.cos(math.radians(degrees)) + 0.5 * math.sin(math.radians(degrees))
        assert np.abs(both - share * alone).max() < 1e-9 * np.abs(alone).max()


@pytest.mark.parametrize("instrument", [bass("pluck_deg = 0"), SHARED], ids=["rigid", "shared"])
def test_letting_a_fret_go_moves_nothing_along_the_frets(instrument):
    """A string that is let go jumps away from the fret, not along it."""
    instrument = instrument.model_copy(
        update={"polarisation": instrument.polarisation.model_copy(update={"pluck_deg": 0.0, "detuning_cents": 0.0})}
    )
    low = instrument.string[0].notes[0]
    made = engine(instrument, economy=False)
    rows = [(0, CONTROL, 0, 68, 127), (1, NOTE_ON, 0, low + 2, 90), (2000, NOTE_ON, 0, low, 90)]
    largest = 0.0
    play(made, rows, 2100)
    for _ in range(20):
        play(made, [], QUANTUM)
        largest = max(largest, np.abs(state_of(made, 1)[0]).max())
    first = np.abs(state_of(made, 0)[0]).max()
    assert first > 1e-5
    rigid = instrument.coupled is False
    assert largest == 0.0 if rigid else largest < 0.05 * first


def test_its_swing_raises_the_tension():
    """A string that only swings along the frets begins sharp by EA/(4T) Σ k² q̂², as one that swings towards them would."""
    stretched = wound("A1", 20.9) + "tension_modulation = true\n"
    made = engine(
        preset(
            "along", stretched, output='kind = "force"\ngain_db = -24', polyphony=1, more="[polarisation]\npluck_deg = 90\n"
        )
    )
    play(made, [(0, NOTE_ON, 0, 33, 127)], 4000)
    q, v = state_of(made, 1)
    model = bank_of(made).models[made._sounding.hands["model"][1]]
    omega = made.compiled[0].strings[0].positions[0].omega
    k = np.pi * np.arange(1, q.size + 1) / model["length"]
    stiffness = bank_of(made).strings["axial_stiffness"][0]
    rise = stiffness / (4.0 * model["length"] * model["tension"]) * float(np.sum(k**2 * (q**2 + (v / omega[: q.size]) ** 2)))
    assert rise > 1e-3
    assert (
        made._sounding.expressions["bend"][0]
        == made._sounding.expressions["bend"][1]
        == pytest.approx(6 * math.log2(1 + rise), rel=0.02)
    )
    assert np.abs(state_of(made, 0)[0]).max() < 1e-12


def test_both_wake_and_sleep_at_once():
    made = engine(ACROSS)
    play(made, [(0, NOTE_ON, 0, 33, 100)], 1000)
    assert awake(made) == [2, 3] and made.report().most_strings == 1
    play(made, [(0, NOTE_ON, 0, 52, 100)], 1000)
    assert awake(made) == [2, 3, 6, 7] and made.report().most_strings == 2
    play(made, [(0, NOTE_OFF, 0, 33), (0, NOTE_OFF, 0, 52)], 60000)
    assert awake(made) == [] and made.silent
    assert not play(made, [], 1000).any()


def test_what_blows_up_is_silenced_in_both():
    made = engine(ACROSS)
    play(made, [(0, NOTE_ON, 0, 33, 100)], 1000)
    string_of(made, 3).q[0] = 1e3
    out = play(made, [], 2000)
    assert awake(made) == [] and np.isfinite(out).all() and made.report().silenced == 1


def test_blocks_and_threads_change_no_bit():
    rng = np.random.default_rng(41)
    engines = [engine(ACROSS, FREE, limiter=True, threads=threads) for threads in (1, 2)]
    for events in (
        [*BUSY, *((each[0], each[1], 1, 48, each[4]) for each in BUSY if each[1] == NOTE_ON)],
        random_events(rng, 150, 20000, 2, (26, 56)),
    ):
        runs = []
        for made in engines:
            for blocks in (4096, 97):
                made.reset()
                runs.append(play(made, events, 33000 if isinstance(events, list) else 22000, blocks))
        assert runs[0].any() and all(np.array_equal(each, runs[0]) for each in runs[1:])


def test_a_state_goes_on():
    made, other = engine(ACROSS), engine(ACROSS)
    whole = play(made, BUSY, 33000)
    for at in (5003, 12_417, 25_111):
        made.reset()
        play(made, [row for row in BUSY if row[0] < at], at)
        go_on_from(other, what_sounds(made))
        rest = play(other, [(row[0] - at, *row[1:]) for row in BUSY if row[0] >= at], 33000 - at)
        assert np.array_equal(rest, whole[at:])


def test_what_has_no_meaning_is_refused():
    with pytest.raises(PresetError, match=r"polarisation\.heard has no meaning"):
        preset("no", wound("A1", 20.9), output='kind = "body"', more="[polarisation]\nheard = 0.2\n" + SHARED_MODE)
    with pytest.raises(PresetError, match=r"friction needs strings that share a body"):
        preset("no", wound("A1", 20.9), obstacle=NECK_OBSTACLE + "\nfriction = 0.2", more="[polarisation]\n")
    board = 'kind = "board"\naction_12th_mm = 4.0\nrelief_mm = 0.3\nlength_mm = 620'
    with pytest.raises(PresetError, match=r"polarisation: .*board"):
        preset("no", wound("A1", 20.9), obstacle=board, more="[polarisation]\n")


SHARED_MODE = "[[body.mode]]\nfrequency_hz = 120\nq = 20\nmass_kg = 0.6\n"
