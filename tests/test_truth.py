"""What tools/truth measures, admits and reads; our basses within the ranges of recordings (tests/truth/ranges.toml)."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile

sys.path.insert(0, str(Path(__file__).parents[1] / "tools"))

from truth_of_sound import judge, measure, ranges, sources
from truth_of_sound.controls import sines
from truth_of_sound.ours import BASS_NOTES, VELOCITIES, Player
from truth_of_sound.session import RANGES

from synth.instrument.preset import load_preset
from synth.units import LN_1000, midi_to_hz, note_to_midi

RATE = 44100.0


def string_like(t60_s, f0_hz=55.0, b=1e-4, glide_cents=0.0, beat_hz=0.0, seconds=6.2) -> np.ndarray:
    """(n,) twenty partials of T60 t60_s(number), of falling level; each a pair beat_hz apart, its pitch gliding in 0.5 s."""
    t = np.arange(round(seconds * RATE)) / RATE
    # ∫ of a pitch that is glide_cents high at first
    bent = t + glide_cents * np.log(2.0) / 1200.0 * 0.5 * (1.0 - np.exp(-t / 0.5))
    x = np.zeros(t.size)
    for n in range(1, 21):
        f = n * f0_hz * np.sqrt(1.0 + b * n * n)
        pair = np.sin(2 * np.pi * f * bent + n) + (0.3 * np.sin(2 * np.pi * (f + beat_hz) * bent) if beat_hz else 0.0)
        x += pair * np.exp(-LN_1000 / t60_s(n) * t) / n
    noise = np.random.default_rng(5).standard_normal(t.size + 8820)
    return 0.1 * np.concatenate([np.zeros(8820), x]) + 1e-7 * noise


def ring(x: np.ndarray, hz: float = 55.0) -> dict[str, float]:
    return measure.ring(measure.cut(x, RATE), hz)


def test_decay_and_stretch_of_known_partials() -> None:
    found = ring(string_like(lambda n: 12.0 if n == 1 else 8.0 if n < 6 else 4.0 if n < 13 else 2.0))
    for name, expected in (("t60_1", 12.0), ("t60_2_5", 8.0), ("t60_6_12", 4.0), ("t60_13_20", 2.0), ("decay_ratio", 0.25)):
        assert found[name] == pytest.approx(expected, rel=0.06), name
    assert found["inharmonicity"] == pytest.approx(1e-4, rel=0.05)
    assert abs(found["glide_cents"]) < 0.1


def test_glide_of_a_known_pitch() -> None:
    # of 20 cents that fade with 0.5 s, what is left between 0.1 and 0.22 s over what is left at 2 s
    found = ring(string_like(lambda n: 8.0, glide_cents=20.0))
    assert found["glide_cents"] == pytest.approx(20.0 * (np.exp(-0.32) - np.exp(-4.1)), abs=1.0)


def test_beating_is_told_from_smooth_decay() -> None:
    smooth, beating = ring(string_like(lambda n: 8.0)), ring(string_like(lambda n: 8.0, beat_hz=1.7))
    assert smooth["beating_db"] < 0.3
    # one against three tenths of it: 20 lg (1.3/0.7), less what lies beyond 95 %
    assert beating["beating_db"] == pytest.approx(5.4, abs=0.5)


def test_takes_are_apart_by_their_colour_not_their_loudness() -> None:
    a = measure.cut(string_like(lambda n: 8.0), RATE)
    b = measure.cut(0.5 * string_like(lambda n: 8.0), RATE)
    c = measure.cut(string_like(lambda n: 8.0 if n % 2 else 0.3), RATE)
    assert measure.takes_apart_db(a, b, 55.0) < 0.1
    assert measure.takes_apart_db(a, c, 55.0) > 3.0


def test_tilt_of_known_levels() -> None:
    found = measure.early(measure.cut(string_like(lambda n: 8.0, b=0.0), RATE), 55.0)
    assert found["tilt_db_octave"] == pytest.approx(-6.02, abs=0.3)


def test_a_burst_has_a_time_and_a_length() -> None:
    t = np.arange(round(RATE)) / RATE
    click = np.where(t > 0.03, np.exp(-(t - 0.03) / 0.03), 0.0) * np.random.default_rng(1).standard_normal(t.size)
    x = np.concatenate([np.zeros(8820), 0.2 * np.sin(2 * np.pi * 80.0 * t) * np.exp(-t) + 0.1 * click])
    found = measure.burst(measure.cut(x, RATE))
    assert found["burst_peak_ms"] == pytest.approx(30.0, abs=10.0)
    assert found["burst_20db_ms"] == pytest.approx(69.0, abs=20.0)  # 0.03 s · ln 10
    assert measure.burst(measure.cut(string_like(lambda n: 30.0, f0_hz=220.0), RATE))["burst_20db_ms"] == 500.0


def test_a_release_by_band() -> None:
    t = np.arange(round(1.2 * RATE)) / RATE
    x = np.zeros(t.size)
    for hz, tau in ((100.0, 0.08), (500.0, 0.04), (2000.0, 0.02)):
        x += np.sin(2 * np.pi * hz * t) * np.where(t < 0.5, 1.0, np.exp(-(t - 0.5) / tau))
    found = measure.release(x, RATE, 0.5)
    assert measure.released_s(x, RATE) == pytest.approx(0.5, abs=0.05)
    for name, tau in (("low", 0.08), ("middle", 0.04), ("high", 0.02)):
        assert found[f"release_{name}_ms"] == pytest.approx(1e3 * tau * np.log(10.0), abs=12.0)


def test_a_touched_harmonic_has_little_of_its_fundamental() -> None:
    t = np.arange(round(2 * RATE)) / RATE
    x = np.sin(2 * np.pi * 110.0 * t) + 10 ** (-28 / 20) * np.sin(2 * np.pi * 55.0 * t)
    note = measure.cut(np.concatenate([np.zeros(4410), 0.2 * x * np.exp(-t)]), RATE)
    assert measure.touched(note, 55.0)["fundamental_db"] == pytest.approx(-28.0, abs=0.5)


def test_a_measure_in_which_recordings_do_not_pass_for_each_other_is_not_admitted() -> None:
    chance = np.random.default_rng(2)
    alike = {name: list(chance.normal(1.0, 0.1, 40)) for name in "abcd"}
    assert ranges.range_of(alike).admitted
    apart = ranges.range_of({name: [value + 5.0 * k for value in values] for k, (name, values) in enumerate(alike.items())})
    assert not apart.admitted and apart.inside_worst == 0.0
    with pytest.raises(ValueError, match="needs two sets of 4 notes at least, got 1"):
        ranges.range_of({"a": [1.0] * 9, "b": [1.0] * 3})


def test_ranges_are_written_and_read(tmp_path: Path) -> None:
    chance = np.random.default_rng(2)
    made = {"t60_1": ranges.range_of({name: list(chance.normal(10.0, 1.0, 20)) for name in ("one", "two words")})}
    ranges.write(tmp_path / "r.toml", made, {"one": (20, "nowhere")}, {"release_ms": {"a": 100.0}})
    bass, of_hand = ranges.read(tmp_path / "r.toml")
    assert of_hand == {"release_ms": {"a": 100.0}}
    assert bass["t60_1"].low == pytest.approx(made["t60_1"].low, rel=1e-3)
    assert bass["t60_1"].admitted == made["t60_1"].admitted


def test_recordings_by_name_once_each(tmp_path: Path) -> None:
    folder = tmp_path / "fashionbass"
    folder.mkdir()
    chance = np.random.default_rng(3)
    x = 0.1 * chance.standard_normal(22050)
    for name, sound in (("ab1_ff_rr2", x), ("ab2_ff_rr2", 0.5 * np.roll(x, 7)), ("c1_pp_rr1", x[::-1]), ("noise_a_rr1", x)):
        soundfile.write(folder / f"{name}.flac", sound, 22050)
    found = {r.name: r for r in sources.recordings(tmp_path)}
    assert set(found) == {"fashionbass/ab1_ff_rr2.flac", "fashionbass/c1_pp_rr1.flac"}  # a shifted copy is no second take
    one = found["fashionbass/ab1_ff_rr2.flac"]
    assert (one.note, one.dynamic, one.take, one.group, one.kind) == (32, "ff", 2, "fashionbass loud", "ring")
    with pytest.raises(ValueError, match="has no known recordings"):
        list(sources.recordings(folder))


def test_what_the_committed_ranges_admit() -> None:
    bass, of_hand = ranges.read(RANGES)
    admitted = {name for name, found in bass.items() if found.admitted}
    assert {"decay_ratio", "t60_1", "t60_13_20", "beating_db", "inharmonicity"} <= admitted
    assert {"tilt_rise_db_octave", "takes_apart_db", "release_ms", "burst_peak_ms", "fundamental_db"} <= set(of_hand)


@pytest.mark.slow
def test_ranges_say_no_more_than_that_nothing_is_absurd() -> None:
    """Forty decaying sines lie within them: who wants to know whether a sound is real asks the impostor test."""
    bass, _ = ranges.read(RANGES)
    found = {
        velocity: [
            {
                **(note := measure.ring(cut := measure.cut(sines(key, velocity / 128), RATE), hz)),
                **measure.early(cut, note["f0_hz"]),
            }
            for key, hz in ((key, float(midi_to_hz(key))) for key in BASS_NOTES)
        ]
        for velocity in VELOCITIES
    }
    shares = {name: judge.share(found, name, reference) for name, reference in bass.items() if reference.admitted}
    assert np.mean(list(shares.values())) > 0.97, shares


@pytest.fixture(scope="module")
def fretted() -> tuple[Player, judge.ByVelocity]:
    """The bass, and six notes of it in three velocities."""
    player = Player(load_preset("fretted-bass"))
    return player, judge.bass(player)


@pytest.fixture(scope="module")
def hands(fretted: tuple[Player, judge.ByVelocity]) -> dict[str, list[float]]:
    """What the hand does on these notes."""
    return judge.hands(*fretted)


@pytest.mark.parametrize("name", ranges.CANDIDATES)
@pytest.mark.slow
def test_the_bass_lies_among_recordings(name: str, fretted: tuple[Player, judge.ByVelocity]) -> None:
    """Six notes, three velocities: at least 70 % within the range of each measure by which recordings know each other."""
    _, found = fretted
    reference = ranges.read(RANGES)[0][name]
    assert len(found) == len(VELOCITIES) and all(len(notes) == len(BASS_NOTES) for notes in found.values())
    assert reference.admitted
    assert judge.share(found, name, reference) >= ranges.WANTED, judge.values(found, name)


def test_a_note_without_a_measure_is_not_within_its_range() -> None:
    reference = ranges.read(RANGES)[0]["t60_1"]
    found = {80: [{"t60_1": 10.0}, {}], 127: [{"t60_1": 10.0}, {"t60_1": 1e3}]}
    assert judge.share(found, "t60_1", reference) == 0.5


@pytest.mark.slow
def test_colour_and_level_follow_the_hand(hands: dict[str, list[float]]) -> None:
    assert min(hands["tilt_rise_db_octave"]) >= 5.0
    assert 7.0 <= np.median(hands["level_rise_db"]) <= 13.0
    assert 2.0 < min(hands["glide_cents"]) and max(hands["glide_cents"]) < 20.0


def test_no_two_takes_are_alike(hands: dict[str, list[float]]) -> None:
    assert 1.0 <= np.median(hands["takes_apart_db"]) <= 6.0
    assert min(hands["takes_apart_db"]) > 0.3


def test_a_release_takes_the_highs_first(hands: dict[str, list[float]]) -> None:
    assert 70.0 <= min(hands["release_ms"]) and max(hands["release_ms"]) <= 200.0
    assert all(high < low for high, low in zip(hands["release_high_ms"], hands["release_low_ms"], strict=True))


def test_a_palm_takes_the_partials_that_a_recorded_one_takes(fretted: tuple[Player, judge.ByVelocity]) -> None:
    """C2, palm-muted: partials 1, 2 and 5 within 30 % of the recording's decays; 3 and 4 ring longer than there."""
    note = measure.cut(fretted[0].note(36, 80, 1.6, key=note_to_midi("D0")), RATE)
    ours = measure.decays_s(measure.partials(note, float(midi_to_hz(36))))
    real = ranges.read(RANGES)[1]["palm_mute_c2_t60"]
    for number in ("1", "2", "5"):
        assert ours[int(number)] == pytest.approx(real[number], rel=0.3)


def test_a_thumb_is_heard_at_once_and_not_for_long() -> None:
    """Above 2 kHz, on each string: loudest within 20 ms, 20 dB less within 300 ms."""
    player = Player(load_preset("slap-bass"))
    for key in (28, 33, 38, 43):
        for velocity in (70, 100):
            found = measure.burst(measure.cut(player.note(key, velocity, 0.7), RATE))
            assert found["burst_peak_ms"] <= 20.0 and found["burst_20db_ms"] <= 300.0


@pytest.mark.parametrize(("key", "harmonic"), [(40, 2), (48, 2), (52, 3)])
def test_a_touched_harmonic_is_rid_of_its_fundamental(
    key: int, harmonic: int, fretted: tuple[Player, judge.ByVelocity]
) -> None:
    note = measure.cut(fretted[0].note(key, 90, 2.0, key=note_to_midi("F0")), RATE)
    assert measure.touched(note, float(midi_to_hz(key)) / harmonic)["fundamental_db"] <= -30.0
