"""What hands are heard by beside the string that they play: rubbing, arriving, knocking, coming down, leaving a fret."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import j0

from synth.engine import layout
from synth.engine.engine import Engine
from synth.engine.stroke import drawn_by, draws_at, finger_width, met
from synth.instrument.fingerprints import fingerprint
from synth.instrument.preset import Preset, PresetError
from synth.instrument.soundboard import TOP_DENSITY_KG_M2, TOP_STIFFNESS_N_M, shape_at_hand
from synth.midi.events import NOTE_OFF, NOTE_ON

from .kit import (
    FORCE,
    NECK_OBSTACLE,
    QUANTUM,
    RATE_HZ,
    bank_of,
    energy,
    engine,
    go_on_from,
    place,
    play,
    preset,
    state_of,
    steel,
    string_of,
    what_sounds,
    wound,
)
from .test_strokes import HEARD, begin, one
from .test_together import MODES, TWO_WAYS, coupling_of
from .test_together import energy as energy_together

RUBS = "draw_ms = 5\nslip_ms = 5\nrub_percent = 20\n"
KNOCK = "[hand]\nknock = { force_n = 3, time_ms = 6, delay_ms = 1, noise_percent = 30, grain_ms = 0.1 }\n"
LANDS = "[hand]\nrelease = { place = 0.8, width_mm = 12, resistance = 1.0, speed_m_s = 0.5, roughness_um = 80 }\n"
LEAVES = "[hand]\nfret_release = true\nrelease = { place = 0.9, width_mm = 12, resistance = 0.3 }\n"


def pair(name: str, more: str, **tables: str) -> Preset:
    """Two strings in two directions on a bridge that moves with a body; notes 43 and 48."""
    return preset(name, steel("G2") + steel("C3") + "place_mm = 12\n", output=HEARD, more=MODES + TWO_WAYS + more, **tables)


def neck(name: str, more: str, **tables: str) -> Preset:
    """An E string of a bass over frets, notes 28 … 40."""
    return preset(name, wound("E1", 32.5), obstacle=NECK_OBSTACLE, output=FORCE, more=more, **tables)


def high(out: np.ndarray, above_hz: float = 2000.0) -> float:
    """Energy above a frequency of the left output."""
    spectrum = np.abs(np.fft.rfft(out[:, 0] * np.hanning(len(out)))) ** 2
    return float(spectrum[np.fft.rfftfreq(len(out), 1.0 / RATE_HZ) > above_hz].sum())


# --- rubbing ---


def slipping(pluck: str, velocity: int = 127, seed: int = 0) -> np.ndarray:
    """The finger's force [N] at the end of every quantum in which it slips."""
    made = engine(one(pluck=pluck), seed=seed)
    begin(made, velocity=velocity)
    hand, out = made._sounding.hands[0], []
    while hand["phase"] != layout.SLIP:
        play(made, [], QUANTUM, QUANTUM)
    while hand["phase"] == layout.SLIP:
        out.append(float(string_of(made, 0).finger[0]["push"]))
        play(made, [], QUANTUM, QUANTUM)
    return np.array(out)


def test_a_rough_edge_makes_the_force_of_a_string_that_slides_off_unsteady_by_a_share_of_it() -> None:
    slow = "draw_ms = 5\nslip_ms = 20\nedge_mm = 4\ngrain_mm = 0.02\n"
    shares = []
    for velocity in (40, 127):
        smooth = slipping(slow, velocity)[:20]
        each = [slipping(slow + "rub_percent = 20", velocity, seed)[:20] / smooth - 1.0 for seed in range(8)]
        shares.append(float(np.std(each)))
    for share in shares:  # 160 numbers each
        assert share == pytest.approx(0.2, rel=0.25)
    assert shares[0] == pytest.approx(shares[1], rel=0.05)  # a share, however hard it is plucked


def test_it_is_heard_before_and_after_the_string_is_let_go_and_finer_grain_higher_up() -> None:
    def rubbed(more: str) -> np.ndarray:
        plain, rough = (
            play(engine(one(pluck="draw_ms = 20\nslip_ms = 5\n" + text)), [(0, NOTE_ON, 0, 43, 100)], 2048)
            for text in ("", "rub_percent = 20\n" + more)
        )
        return rough - plain

    fine, coarse = rubbed("grain_mm = 0.02"), rubbed("grain_mm = 0.2")
    drawn = int(0.020 * RATE_HZ)
    early, late = (float(np.sum(fine[a : a + 200] ** 2)) for a in (drawn - 700, drawn - 100))
    assert 0.0 < 4.0 * early < late  # it rises towards the release
    assert np.abs(fine[drawn + 20 : drawn + 300]).max() > 0.0
    shares = [high(each[:drawn], 3000.0) / float(np.sum(each[:drawn] ** 2)) for each in (fine, coarse)]
    assert shares[0] > 3.0 * shares[1]


def test_it_follows_the_seed_and_the_velocity() -> None:
    def noise(velocity: int, seed: int = 0) -> np.ndarray:
        return play(engine(one(pluck=RUBS), seed=seed), [(0, NOTE_ON, 0, 43, velocity)], 1024)

    np.testing.assert_array_equal(noise(90), noise(90))
    assert np.abs(noise(90) - noise(90, 1)).max() > 1e-3 * np.abs(noise(90)).max()
    loud, soft = noise(127), noise(64)
    np.testing.assert_allclose(loud, soft * (127 / 64) ** 1.2, atol=0.15 * np.abs(loud).max())


def test_measured_plans_know_nothing_of_it() -> None:
    plain, rubs, arrives = one(), one(pluck="rub_percent = 20\ngrain_mm = 0.02"), one(pluck="arrival = 1")
    prints = [fingerprint(each, each.string[0], 43) for each in (plain, rubs, arrives)]
    assert prints[0] == prints[1] != prints[2]


# --- arriving ---


def test_a_plectrum_that_arrives_clicks_before_the_string_is_let_go() -> None:
    hard = "draw_ms = 10\nfinger_stiffness_n_mm = 200\n"
    rest, flown, faster = (
        play(engine(one(pluck=f"{hard}arrival = {a}")), [(0, NOTE_ON, 0, 43, 100)], 440) for a in (0.0, 0.5, 1.0)
    )
    first = slice(0, 120)
    assert np.abs(flown[first]).max() > 5.0 * np.abs(rest[first]).max()
    np.testing.assert_allclose(faster[first], 2.0 * flown[first], atol=0.1 * np.abs(faster[first]).max())
    assert met(0.0, 1.0) == 0.0 and met(1.0, 1.0) == 1.0
    way = np.array([met(share, 3.0) for share in np.linspace(0.0, 1.0, 101)])
    assert (np.diff(way) >= 0.0).all()  # the fastest that presets may ask for does not swing over


def test_a_width_may_go_by_ratios() -> None:
    widths = [finger_width(0.016, 0.25, strength, 0.2, True) for strength in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(widths, [0.016, 0.008, 0.004])
    steps = [finger_width(0.016, 0.25, strength, 0.2, False) for strength in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(steps, [0.016, 0.010, 0.004])
    assert draws_at(0.2, 0.9, 60.0) * drawn_by(1.5, 0.2, 0.9, 60.0) == pytest.approx(1.5)


# --- knocking on a body ---


def knocked(velocity: int, seed: int = 0, more: str = KNOCK, pluck: str = "") -> np.ndarray:
    """What a knock adds to a note."""
    rows = [(0, NOTE_ON, 0, 43, velocity)]
    plain, with_it = (play(engine(pair("pair", text, pluck=pluck), seed=seed), rows, 2048) for text in ("", more))
    return with_it - plain


def test_a_knock_moves_the_body_as_its_modes_say() -> None:
    """By the force alone, on the body without its strings' answer: before that comes back."""
    more = "[hand]\nknock = { force_n = 3, time_ms = 4, distance_mm = 0 }\n[articulations.normal]\ndisplacement_ratio = 0\n"
    made = engine(pair("pair", more))
    late = made.latency_samples
    out = play(made, [(0, NOTE_ON, 0, 43, 127)], 176 + late)[late:]
    c = coupling_of(made)
    np.testing.assert_allclose(c.body.struck[0] * c.body.mass[0] * RATE_HZ, 1.0)
    time = np.arange(176)
    steps = round(0.004 * RATE_HZ)
    force = np.where(time < steps, 1.5 * (1.0 - np.cos(2.0 * np.pi * time / steps)), 0.0)
    p, v = np.zeros(c.body.motion.p.size), np.zeros(c.body.motion.p.size)
    wanted = np.zeros((176, 2))
    for t in range(176):
        kicked = v + force[t] * c.body.struck
        p, after = c.body.rows[0] * p + c.body.rows[1] * kicked, c.body.rows[2] * p + c.body.rows[3] * kicked
        wanted[t] = c.body.radiation @ (after - v) * RATE_HZ
        v = after
    assert np.abs(out).max() > 0.0
    assert np.abs(out - wanted).max() < 0.1 * np.abs(wanted).max()  # strings load the body a little


def test_a_knock_follows_velocity_and_seed_and_has_an_end() -> None:
    loud, soft = knocked(127), knocked(64)
    np.testing.assert_allclose(loud, soft * (127 / 64) ** 1.2, atol=0.02 * np.abs(loud).max())
    assert np.abs(loud[: int(0.0009 * RATE_HZ)]).max() == 0.0  # its delay
    other = knocked(127, seed=1)
    assert 0.05 < np.abs(other - loud).max() / np.abs(loud).max() < 2.0
    np.testing.assert_array_equal(loud, knocked(127))
    twice = knocked(127, more=KNOCK + "[articulations.normal]\nknock_ratio = 2.0\n")
    np.testing.assert_allclose(twice, 2.0 * loud, atol=0.02 * np.abs(twice).max())


def test_after_it_nothing_gains_energy() -> None:
    made = engine(pair("pair", KNOCK))
    play(made, [(0, NOTE_ON, 0, 43, 127)], 1024)
    assert not made._sounding.knocks["steps"].any() and coupling_of(made).body.ahead.knocked[0] == 0
    before = energy_together(made)
    for _ in range(40):
        play(made, [], QUANTUM, QUANTUM)
        assert energy_together(made) <= before * (1.0 + 1e-9)
        before = energy_together(made)


def test_a_hand_knocks_again_as_the_note_ends() -> None:
    again = KNOCK.replace("delay_ms = 1", "delay_ms = 1, release_ratio = 0.5")
    rows = [(0, NOTE_ON, 0, 43, 100), (6400, NOTE_OFF, 0, 43, 0)]
    once, twice = (play(engine(pair("pair", more)), rows, 7000) for more in (KNOCK, again))
    np.testing.assert_array_equal(once[:6400], twice[:6400])
    assert np.abs(twice[6400:] - once[6400:]).max() > 0.1 * np.abs(once[:600]).max()


def test_the_shape_at_a_hand() -> None:
    omega, normal = 2.0 * np.pi * np.geomspace(50.0, 8000.0, 4000), np.full(4000, 0.7)
    np.testing.assert_allclose(shape_at_hand(normal, omega, 0.0), normal)
    far = shape_at_hand(normal, omega, 0.3)
    assert np.mean(far**2) == pytest.approx(0.49, rel=0.05)
    k = np.sqrt(omega) * (TOP_DENSITY_KG_M2 / TOP_STIFFNESS_N_M) ** 0.25
    bands = np.array_split(np.arange(4000), 40)
    means = [far[band].mean() - 0.7 * j0(0.3 * k[band]).mean() for band in bands]
    assert np.abs(means).max() < 0.1


@pytest.mark.parametrize(("more", "key"), [(KNOCK, "hand.knock"), ("", "damping.others_s")])
def test_both_need_a_body_that_moves(more: str, key: str) -> None:
    damping = "release_s = 0.2" if more else "release_s = 0.2\nothers_s = 0.2"
    with pytest.raises(PresetError, match=rf"{key} needs a body that strings share; give \[\[body.mode\]\]"):
        one(more, damping=damping)


# --- the end of a note ---


def test_a_hand_over_all_strings_ends_what_rings_along() -> None:
    rows = [(0, NOTE_ON, 0, 43, 110), (12_000, NOTE_OFF, 0, 43, 0)]
    levels = {}
    for others in ("", "others_s = 0.15"):
        strings = steel("G2") + steel("G3")
        made = engine(preset("two", strings, output=HEARD, more=MODES + TWO_WAYS, damping=f"release_s = 0.1\n{others}"))
        play(made, rows, 12_000)
        rang = energy(made, 2)
        play(made, [(0, NOTE_OFF, 0, 43, 0)], 8192)
        levels[others] = energy(made, 2) / rang
        if others:
            assert made._sounding.expressions["hand"][2] > 0.0 and made._sounding.expressions["hand"][3] > 0.0
            play(made, [(0, NOTE_ON, 0, 43, 110)], 512)
            assert made._sounding.expressions["hand"][2] == 0.0  # the next stroke finds it free
    assert levels["others_s = 0.15"] < 1e-4 < 0.2 < levels[""]


def test_a_hand_does_not_cover_strings_while_a_key_is_held() -> None:
    strings = steel("G2") + steel("C3") + steel("G3")
    made = engine(preset("three", strings, output=HEARD, more=MODES, damping="release_s = 0.1\nothers_s = 0.1"))
    play(made, [(0, NOTE_ON, 0, 43, 110), (0, NOTE_ON, 0, 48, 110), (4000, NOTE_OFF, 0, 43, 0)], 5000)
    assert made._sounding.expressions["hand"].tolist() == [made._sounding.expressions["hand"][0], 0.0, 0.0]
    assert made._sounding.expressions["hand"][0] > 0.0
    play(made, [(0, NOTE_OFF, 0, 48, 0)], 500)
    assert (made._sounding.expressions["hand"] > 0.0).all()


def ended(more: str, seed: int = 0) -> np.ndarray:
    """The first tenth of a second after a note's end."""
    made = engine(one(more, damping="release_s = 0.3"), seed=seed)
    play(made, [(0, NOTE_ON, 0, 43, 100)], 24_000)
    return play(made, [(0, NOTE_OFF, 0, 43, 0)], 4410)


def test_a_touch_is_heard_as_it_comes_down_and_rubs() -> None:
    silent, comes, rubs = (
        ended(LANDS.replace(f", {gone}", "")) if gone else ended(LANDS)
        for gone in ("speed_m_s = 0.5, roughness_um = 80", "roughness_um = 80", "speed_m_s = 0.5")
    )
    early = slice(0, 441)
    assert np.abs(comes - silent)[early].max() > 0.05 * np.abs(silent[early]).max()
    assert high(rubs[early], 3000.0) > 10.0 * high(silent[early], 3000.0)
    later = slice(2000, 4410)
    assert high(rubs[later], 3000.0) < 0.01 * high(rubs[early], 3000.0)  # an event, no hiss
    np.testing.assert_array_equal(ended(LANDS), ended(LANDS))
    assert np.abs(ended(LANDS) - ended(LANDS, 1)).max() > 0.01 * np.abs(ended(LANDS)).max()


def test_a_touch_rubs_before_it_leaves() -> None:
    soon, later = (ended(LANDS.replace("speed_m_s = 0.5", f"lift_ms = {ms}")) for ms in (60, 80))
    leaves, gone = (int(0.001 * ms * RATE_HZ) + QUANTUM for ms in (52, 60))
    np.testing.assert_array_equal(soon[: leaves - 1], later[: leaves - 1])
    before = slice(leaves, gone - 1)
    assert high(soon[before], 3000.0) > 10.0 * high(later[before], 3000.0)


def test_a_finger_that_leaves_its_fret_lets_the_open_string_be_heard() -> None:
    made = engine(neck("neck", LEAVES, damping="release_s = 0.4"))
    play(made, [(0, NOTE_ON, 0, 35, 60)], 40_000)
    assert place(made, 0)[1] == 7
    model = bank_of(made).models[made._sounding.hands["model"][0]]
    before, depth = energy(made, 0), -float(model["rest_height"])
    play(made, [(0, NOTE_OFF, 0, 35, 0)], 2 * QUANTUM, QUANTUM)
    assert place(made, 0)[1] == 0
    opened = bank_of(made).models[made._sounding.hands["model"][0]]
    share = float(model["length"] / opened["length"])
    assert string_of(made, 0).grip.weights[0] == pytest.approx(
        np.sqrt(2.0 / opened["length"]) * np.sin(np.pi * (1.0 - share)), rel=1e-3
    )  # the finger at the end lies where the fret is
    pressed = (
        0.5 * float(opened["tension"]) * depth**2 * float(1.0 / model["length"] + 1.0 / (opened["length"] - model["length"]))
    )
    after = energy(made, 0)
    assert 0.2 * pressed < after < 1.5 * (before + pressed)
    hz = 440.0 * 2.0 ** ((28 - 69) / 12)
    out = play(made, [], 8820)[:, 0]
    spectrum = np.abs(np.fft.rfft(out * np.hanning(out.size), 1 << 17))
    at = np.fft.rfftfreq(1 << 17, 1.0 / RATE_HZ)
    peak = at[spectrum.argmax()] / hz
    assert abs(peak - round(peak)) < 0.1  # a partial of the open string
    play(made, [(0, NOTE_ON, 0, 35, 60)], 2000)
    assert place(made, 0)[1] == 7


def test_without_a_fret_there_is_none_to_leave() -> None:
    plain, leaves = (
        play(engine(neck("neck", more)), [(0, NOTE_ON, 0, 28, 90), (4000, NOTE_OFF, 0, 28, 0)], 9000)
        for more in (LEAVES.replace("fret_release = true\n", ""), LEAVES)
    )
    np.testing.assert_array_equal(plain, leaves)


# --- all of it ---

ALL = {
    "rubs": one(LANDS, RUBS + "arrival = 1.5"),
    "leaves": neck("neck", LEAVES, pluck=RUBS),
    "knocks": pair(
        "pair", KNOCK.replace("delay_ms = 1", "delay_ms = 1, release_ratio = 0.5") + LANDS.replace("[hand]\n", ""),
        pluck=RUBS, damping="release_s = 0.2\nothers_s = 0.1",
    ),
    "leaves together": preset(
        "both", wound("E1", 32.5) + wound("A1", 20.9), output=HEARD, obstacle=NECK_OBSTACLE, pluck=RUBS,
        more=MODES + TWO_WAYS + LEAVES,
    ),
}  # fmt: skip


def rows_of(name: str) -> list[tuple]:
    low, high_note = {"rubs": (43, 43), "leaves": (30, 35), "knocks": (43, 48)}.get(name, (30, 38))
    return [
        (0, NOTE_ON, 0, low, 120), (700, NOTE_ON, 0, high_note, 127), (2600, NOTE_OFF, 0, low, 0),
        (3000, NOTE_ON, 0, low, 60), (3900, NOTE_OFF, 0, low, 0), (4100, NOTE_ON, 0, low, 100),
        (5200, NOTE_OFF, 0, high_note, 0), (5900, NOTE_OFF, 0, low, 0),
    ]  # fmt: skip


@pytest.mark.parametrize("name", ALL)
def test_neither_blocks_nor_threads_nor_a_state_matter(name: str) -> None:
    rows = rows_of(name)
    whole = play(engine(ALL[name]), rows, 7000, 4096)
    assert np.isfinite(whole).all() and np.abs(whole).max() > 1e-4
    sizes = [int(size) for size in np.random.default_rng(5).integers(1, 300, 7000)]
    np.testing.assert_array_equal(whole, play(engine(ALL[name]), rows, 7000, sizes))
    with_threads = engine(ALL[name], threads=2)
    np.testing.assert_array_equal(whole, play(with_threads, rows, 7000, 333))
    with_threads.close()
    for at in (64, 237, 288, 760, 2700, 4010):  # arriving, slipping, knocking, coming down
        made = engine(ALL[name])
        play(made, [row for row in rows if row[0] < at], at)
        state = what_sounds(made)
        made.reset()
        go_on_from(made, state)
        later = [(row[0] - at, *row[1:]) for row in rows if row[0] >= at]
        np.testing.assert_array_equal(whole[at:], play(made, later, 7000 - at, 77))


def quiet(made: Engine) -> bool:
    return not made._sounding.voices["awake"].any()


@pytest.mark.parametrize("name", ALL)
def test_it_falls_silent(name: str) -> None:
    made = engine(ALL[name])
    play(made, rows_of(name), 7000)
    for _ in range(40):
        if quiet(made):
            break
        play(made, [], 8192)
    assert quiet(made) and all(np.abs(state_of(made, s)[0]).max() == 0.0 for s in range(made._sounding.voices.size))
