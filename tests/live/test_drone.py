"""The tanpura's cycle: the same for the same seed however it is asked, hours without drift, in tune, and what one hears."""

import json
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyloudnorm
import pytest
import soundfile

from synth import cli
from synth.cli import drone, main
from synth.drone.cycle import WANDERS, Cycle, Drone
from synth.drone.dronefile import FileSettings, write
from synth.drone.pegs import Pegs, TunedStrings, tuned
from synth.drone.swara import RATIOS, frequency_of, name_of, ratio_of
from synth.drone.tanpura_keys import DronePlayer, TanpuraKeys
from synth.dsp.measures import band_levels_db, click_ratios, sounding_fundamental
from synth.engine.engine import Engine
from synth.engine.layout import GAIN, HEIGHT
from synth.instrument.preset import load_preset, parse_preset
from synth.instrument.presetfile import preset_text
from synth.live.deck import Deck
from synth.live.terminal import Terminal
from synth.midi.events import NOTE_ON, PARAMETER, TUNING, make_events
from synth.units import cents, midi_to_hz
from tests.forkserver import prepared
from tests.patience import compiling_s, patience_s

from .conftest import StartServer
from .deckkit import Card

RATE = 44100
C3 = midi_to_hz(48)


@pytest.fixture(scope="module")
def strings() -> TunedStrings:
    return tuned(Pegs(load_preset("tanpura-light"), C3))


def in_pieces(drone: Drone, ends: np.ndarray) -> np.ndarray:
    return np.concatenate([drone.events(int(end)) for end in ends])


def strokes(events: np.ndarray) -> np.ndarray:
    return events[events["kind"] == NOTE_ON]


# --- the cycle


def test_events_do_not_depend_on_the_pieces_asked_for(strings: TunedStrings) -> None:
    def play(ends: np.ndarray) -> np.ndarray:
        drone = Drone(strings, Cycle(human=1.0, seed=3), RATE, duration_s=100.0, fade_s=7.0)
        before = in_pieces(drone, ends[ends <= 30 * RATE])
        drone.retune(replace(drone.pegs, first=4 / 3))
        drone.set_cycle(replace(drone.cycle, cycle_s=4.0, human=0.2))
        drone.set_jiva(10.0)
        return np.concatenate((before, in_pieces(drone, ends[ends > 30 * RATE])))

    whole = play(np.array([30 * RATE, 200 * RATE]))
    rng = np.random.default_rng(1)
    for most, count in ((300, 20_000), (100_000, 100)):
        ends = np.cumsum(rng.integers(1, most, count))
        ends = np.unique(np.append(ends, [30 * RATE, 200 * RATE]))
        np.testing.assert_array_equal(play(ends), whole)
    assert whole["frame"].max() < 100 * RATE and (np.diff(whole["frame"]) >= 0).all()


def test_the_seed_decides(strings: TunedStrings) -> None:
    a, b, c = (Drone(strings, Cycle(seed=seed), RATE).events(60 * RATE) for seed in (5, 5, 6))
    np.testing.assert_array_equal(a, b)
    assert not np.array_equal(strokes(a)["frame"][1:9], strokes(c)["frame"][1:9])


@pytest.mark.parametrize("human", [0.0, 1.0])
def test_a_day_neither_drifts_nor_repeats(strings: TunedStrings, human: float) -> None:
    cycle = Cycle(cycle_s=5.5, human=human, seed=11)
    found = strokes(Drone(strings, cycle, RATE).events(24 * 3600 * RATE))
    frames = found["frame"][: found.size // 4 * 4].reshape(-1, 4)
    assert frames.shape[0] >= 24 * 3600 / 5.5 - 2
    assert (np.diff(found["frame"]) > 0).all()
    number = np.arange(frames.shape[0])
    bound = human * (sum(part for part, _ in WANDERS) + 3 * 0.04 * 1 / 4.6) * 5.5 + 1.0 / RATE
    for string in range(4):
        at = frames[:, string] / RATE
        grid = 0.05 + 5.5 * (number + string / 4.6)
        assert np.abs(at - grid).max() <= bound  # nothing adds up
        slope = np.polyfit(number - number.mean(), at, 1)[0]
        assert abs(slope / 5.5 - 1.0) < 1e-6
    if human:
        played = np.stack([np.diff(frames, axis=1, append=0)[:, k] for k in range(3)], axis=1)
        assert np.unique(played, axis=0).shape[0] == frames.shape[0]  # no two cycles are alike
        wander = frames[:, 0] / RATE - 5.5 * number
        assert np.ptp(wander) > 0.02 * 5.5


def test_strings_follow_each_other_with_the_gaps_asked_for(strings: TunedStrings) -> None:
    found = strokes(Drone(strings, Cycle(8.0, (1, 2, 1, 4), human=0.0), RATE).events(60 * RATE))
    assert [int(key) for key in found["a"][:5]] == [*strings.keys, strings.keys[0]]
    np.testing.assert_allclose(np.diff(found["frame"][:5]) / RATE, [1.0, 2.0, 1.0, 4.0], atol=1.0 / RATE)
    assert (found["b"] == 64).all()


def test_a_new_tempo_begins_without_a_jump(strings: TunedStrings) -> None:
    drone = Drone(strings, Cycle(6.0, (1, 1, 1, 1), human=0.0), RATE)
    first = strokes(drone.events(10 * RATE))["frame"]
    drone.set_cycle(replace(drone.cycle, cycle_s=3.0))
    then = strokes(drone.events(20 * RATE))["frame"]
    gaps = np.diff(np.append(first, then)) / RATE
    np.testing.assert_allclose(gaps[: first.size], 1.5, atol=2e-4)
    np.testing.assert_allclose(gaps[first.size :], 0.75, atol=2e-4)


def test_more_human_does_not_jump_either(strings: TunedStrings) -> None:
    drone = Drone(strings, Cycle(6.0, (1, 1, 1, 1), human=1.0, seed=2), RATE)
    first = strokes(drone.events(300 * RATE))["frame"]
    drone.set_cycle(replace(drone.cycle, human=0.0))
    gaps = np.diff(np.append(first[-1:], strokes(drone.events(320 * RATE))["frame"])) / RATE
    assert abs(gaps[0] - 1.5) < 1.5 * 0.2
    np.testing.assert_allclose(gaps[1:], 1.5, atol=2e-4)


def test_a_pause_ends_with_the_string_that_would_have_come(strings: TunedStrings) -> None:
    drone = Drone(strings, Cycle(4.0, (1, 1, 1, 1), human=0.5), RATE)
    before = strokes(drone.events(10 * RATE))
    drone.pause(True)
    assert strokes(drone.events(40 * RATE)).size == 0
    drone.pause(False)
    after = strokes(drone.events(60 * RATE))
    assert strings.keys.index(after["a"][0]) == (strings.keys.index(before["a"][-1]) + 1) % 4
    assert 40 * RATE <= after["frame"][0] <= 40.2 * RATE


def test_a_peg_glides_and_arrives(strings: TunedStrings) -> None:
    drone = Drone(strings, Cycle(), RATE)
    drone.events(2 * RATE)
    drone.retune(replace(drone.pegs, first=4 / 3))
    found = drone.events(6 * RATE)
    turns = found[found["kind"] == TUNING]
    assert set(turns["a"]) == {strings.keys[0]} and (turns["b"] == 1).all()
    assert (np.diff(turns["value"]) <= 0).all() and np.abs(np.diff(turns["value"])).max() < 0.1
    below = 0.01 * cents(4 / 3, 3 / 2)
    assert turns["value"][-1] == pytest.approx(strings.keys[0] + below, abs=0.02)  # the bridge's cents differ
    # back again: the key as it was compiled, exactly
    drone.retune(replace(drone.pegs, first=1.5))
    found = drone.events(10 * RATE)
    assert found[found["kind"] == TUNING]["value"][-1] == strings.keys[0]


def test_the_fade_ends_in_silence(strings: TunedStrings) -> None:
    drone = Drone(strings, Cycle(), RATE, duration_s=20.0, fade_s=5.0)
    found = drone.events(100 * RATE)
    levels = found[(found["kind"] == PARAMETER) & (found["a"] == GAIN)]
    assert levels["frame"][0] >= 15 * RATE and levels["value"][-1] == 0.0
    assert (np.diff(levels["value"]) <= 0).all() and -np.diff(levels["value"]).min() < 0.01
    assert found["frame"][-1] < 20 * RATE and drone.events(200 * RATE).size == 0


# --- pegs


@pytest.mark.parametrize(
    ("text", "ratio"),
    [
        ("Pa", 1.5),
        ("ma", 4 / 3),
        ("NI", 1.875),
        ("komal-Ni", 1.8),
        ("shuddh Ga", 1.25),
        ("tivra_ma", 45 / 32),
        ("7/4", 1.75),
    ],
)
def test_swaras(text: str, ratio: float) -> None:
    assert ratio_of(text) == pytest.approx(ratio, rel=1e-12)


def test_swaras_have_names() -> None:
    assert [ratio_of(name_of(float(ratio))) for ratio in RATIOS.values()] == [float(ratio) for ratio in RATIOS.values()]
    assert name_of(1.7) == "1.7"


@pytest.mark.parametrize("text", ["", "Xa", "3", "1/2", "1/0", "nan", "inf", "komal Sa", "1e9999", "9" * 999 + "/1"])
def test_no_swara(text: str) -> None:
    with pytest.raises(ValueError, match="swara such as Pa"):
        ratio_of(text)


def test_sa_as_note_or_hertz() -> None:
    assert frequency_of("A3") == pytest.approx(220.0) and frequency_of("138.6") == 138.6
    with pytest.raises(ValueError, match="hertz from 20 to 2000"):
        frequency_of("5")


@pytest.mark.parametrize(
    ("text", "ratio"),
    [
        ("Nishadh", 15 / 8), ("nishad", 15 / 8), ("Madhyam", 4 / 3), ("Pancham", 3 / 2), ("tivra Madhyam", 45 / 32),
        ("teevra-Ma", 45 / 32), ("komal Nishad", 9 / 5), ("Kakali Nishadam", 15 / 8), ("Kaisiki nishadam", 9 / 5),
        ("Suddha Madhyamam", 4 / 3), ("Shadja", 1), ("Rishabh", 9 / 8), ("Gandhara", 5 / 4), ("Dhaivat", 5 / 3),
        ("N", 15 / 8), ("n", 9 / 5), ("m", 4 / 3), ("M", 45 / 32), ("नि", 15 / 8),
    ],
)  # fmt: skip
def test_swaras_as_musicians_write_them(text: str, ratio: float) -> None:
    assert ratio_of(text) == pytest.approx(ratio)


def test_a_swara_that_is_nearly_one_is_suggested() -> None:
    with pytest.raises(ValueError, match=r"perhaps komal ni\?"):
        ratio_of("komal nii")


def test_sa_without_an_octave_is_the_nearest() -> None:
    assert frequency_of("C#") == pytest.approx(midi_to_hz(49)) and frequency_of("Bb") == pytest.approx(midi_to_hz(46))
    assert frequency_of("G", near=56) == pytest.approx(midi_to_hz(55))


def test_a_sa_that_another_tanpura_reaches_names_it() -> None:
    with pytest.raises(ValueError, match="try -p tanpura-female"):
        Pegs(load_preset("tanpura-light"), midi_to_hz(56))


def test_sa_follows_a4(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """…of the preset's file, of --a4 and of --set alike."""
    options = ["drone", "--sa", "C3", "-o", "x.wav"]
    mine = tmp_path / "mine.toml"
    mine.write_text(preset_text(load_preset("tanpura-light").with_setting("tuning.a4_hz", "432")))
    for words in (["-p", str(mine)], ["--a4", "432"], ["--set", "tuning.a4_hz=432"]):
        parsed = cli.command_parser().parse_args([*options, *words])
        strings = drone._strings(parsed)
        compiled = [
            midi_to_hz(key, 432.0) * 2 ** (t.cents / 1200)
            for key, t in zip(strings.keys, strings.preset.string, strict=True)
        ]
        np.testing.assert_allclose(compiled[1], midi_to_hz(48, 432.0), rtol=1e-12)


def test_loudness_does_not_depend_on_the_first_string(tmp_path: Path) -> None:
    """…within half a decibel, over six cycles that do not vary."""
    meter = pyloudnorm.Meter(RATE)
    levels = {}
    for first in (None, "Pa", "Ma", "Ni", "komal Ni", "Re"):
        strings = tuned(Pegs(load_preset("tanpura"), C3, None if first is None else ratio_of(first)))
        write(strings, Cycle(human=0.0), FileSettings(str(tmp_path / "drone.wav"), 33.0, 0.0))
        levels[first] = meter.integrated_loudness(soundfile.read(tmp_path / "drone.wav")[0])
    assert max(levels.values()) - min(levels.values()) < 0.5, levels


@pytest.mark.parametrize("command", [["render", "a.mid"], ["play"], ["drone"], ["export", "tanpura-light"]])
def test_commands_share_the_options_of_tuning(command: list[str]) -> None:
    parsed = cli.command_parser().parse_args([*command, "--a4", "442", "--set", "pluck.position=0.2"])
    assert parsed.settings == [(None, "tuning.a4_hz", "442.0"), (None, "pluck.position", "0.2")]


def test_every_string_has_a_key_of_its_own_and_its_pitch() -> None:
    pegs = Pegs(load_preset("tanpura-light"), 140.0, 4 / 3, 15 / 8, cents=(0, 1, 2, -3, 4))
    strings = tuned(pegs, 7.0)
    assert len(set(strings.keys)) == 5 and pegs.names == ("Ma", "Ni", "Sa", "Sa", "kharaj")
    wanted = np.array([70 * 4 / 3, 70 * 15 / 8, 140, 140, 70]) * 2.0 ** (np.array([0, 1, 2, -3, 4]) / 1200)
    np.testing.assert_allclose(pegs.pitches_hz, wanted, rtol=1e-12)
    compiled = [midi_to_hz(key) * 2 ** (t.cents / 1200) for key, t in zip(strings.keys, strings.preset.string, strict=True)]
    np.testing.assert_allclose(compiled, wanted, rtol=1e-12)
    assert strings.preset.obstacle.jiva_um == 7.0
    assert parse_preset(preset_text(strings.preset), "written") == strings.preset


def test_equal_temperament() -> None:
    pegs = Pegs(load_preset("tanpura-light"), C3, 15 / 8, equal=True)
    assert pegs.pitches_hz[0] == pytest.approx(midi_to_hz(47), rel=1e-12)


# --- what one hears


def heard(engine: Engine, events: np.ndarray, seconds: float, block: int = 512) -> np.ndarray:
    """(frames,) left channel, without the latency."""
    engine.reset()
    out = np.zeros((round(seconds * RATE) + engine.latency_samples, 2))
    for at in range(0, len(out), block):
        due = events[(events["frame"] >= at) & (events["frame"] < at + block)].copy()
        due["frame"] -= at
        engine.process(due, out[at : at + block])
    return out[engine.latency_samples :, 0]


@pytest.fixture(scope="module")
def engine(strings: TunedStrings) -> Engine:
    engine = Engine([strings.preset])
    engine.prepare(RATE, 512)
    return engine


def pitch_error(engine: Engine, rows: list[tuple], key: int, hz: float) -> float:
    """Cents by which a key, plucked after the events, sounds above a pitch."""
    x = heard(engine, make_events([*rows, (64, NOTE_ON, 0, key, 64)]), 2.1)
    return float(cents(sounding_fundamental(x[round(0.25 * RATE) :], RATE, hz), hz))


def test_strings_are_in_just_intonation(engine: Engine, strings: TunedStrings) -> None:
    errors = [pitch_error(engine, [], key, hz) for key, hz in zip(strings.keys, strings.pegs.pitches_hz, strict=True)]
    assert np.abs(errors).max() < 1.0, errors


def test_each_string_is_tuned_alone_while_it_sounds(engine: Engine, strings: TunedStrings) -> None:
    pegs = replace(strings.pegs, first=15 / 8).turned(1, 12.0)
    values = strings.semitones(pegs)
    rows = [(0, TUNING, 0, key, 1, value) for key, value in zip(strings.keys, values, strict=True)]
    errors = [pitch_error(engine, rows, key, hz) for key, hz in zip(strings.keys, pegs.pitches_hz, strict=True)]
    assert np.abs(errors).max() < 1.0, errors
    assert pegs.pitches_hz[1] != pegs.pitches_hz[2]


@pytest.fixture(scope="module")
def minute(engine: Engine, strings: TunedStrings) -> tuple[np.ndarray, np.ndarray]:
    """Strokes' frames, and a minute at the default settings."""
    events = Drone(strings, Cycle(), RATE).events(60 * RATE)
    return strokes(events)["frame"], heard(engine, events, 60.0)


def test_a_minute_is_steady_and_clean(minute: tuple[np.ndarray, np.ndarray]) -> None:
    at, x = minute
    assert 0.1 < np.abs(x).max() < 0.8
    begins = at[::4]
    levels = [20 * np.log10(np.sqrt(np.mean(x[a:b] ** 2))) for a, b in pairwise(begins[2:])]
    assert len(levels) >= 7 and np.abs(np.diff(levels)).max() < 1.0, levels
    # a finger's touch is no click: not where it takes hold, and not where it lets go
    places = np.concatenate((at[1:], at[1:] + round(0.012 * RATE)))
    assert click_ratios(x, places).max() < 10.0


def test_the_thread_makes_the_buzz() -> None:

    def above_1_khz(x: np.ndarray) -> float:
        low, high = band_levels_db(x, RATE, [50.0, 1000.0, 10000.0])
        return float(high - low)

    coupled = tuned(Pegs(load_preset("tanpura"), C3))
    engine = Engine([coupled.preset])
    engine.prepare(RATE, 512)
    drone = Drone(coupled, Cycle(), RATE)
    buzzing = heard(engine, drone.events(20 * RATE), 20.0)
    drone = Drone(coupled, Cycle(), RATE)
    drone.set_jiva(40.0)
    events = drone.events(20 * RATE)
    assert events["a"][events["kind"] == PARAMETER][0] == HEIGHT
    assert above_1_khz(buzzing) > above_1_khz(heard(engine, events, 20.0)) + 10.0


# --- files and live


def test_live_sounds_as_the_file(engine: Engine, strings: TunedStrings, tmp_path: Path) -> None:
    path = tmp_path / "drone.wav"
    cycle = Cycle(cycle_s=2.0, human=1.0, seed=4)
    report = write(strings, cycle, FileSettings(str(path), 6.0, 1.0, bit_depth="float", threads=1))
    assert report.strokes >= 11 and report.length_s == 6.0
    file, rate = soundfile.read(path)
    assert rate == RATE and file.shape == (6 * RATE, 2)
    assert np.abs(file[-100:]).max() < 1e-4 < 0.01 < np.abs(file).max()

    deck = Deck(engine)
    card = Card(deck)
    drone = Drone(strings, cycle, RATE, duration_s=6.0, fade_s=1.0)
    said: list[str] = []
    with Terminal(-1) as terminal:
        player = DronePlayer(drone, terminal, TanpuraKeys(drone, said.append, lambda: None))
        blocks = []
        while not player.over(deck):
            player.feed(deck)
            blocks.append(card.ask(1000))
    live = np.concatenate(blocks)[engine.latency_samples :]
    n = min(len(live), len(file))
    assert n >= 5.9 * RATE
    np.testing.assert_allclose(live[:n], file[:n], atol=1e-7)


def test_keys_change_what_comes(strings: TunedStrings) -> None:
    drone = Drone(strings, Cycle(human=0.4), RATE)
    said: list[str] = []
    ended: list[bool] = []
    keys = TanpuraKeys(drone, said.append, lambda: ended.append(True))
    drone.events(RATE)
    for key in ("f", "2", "]", "]", "S", "=", "up", "right", ".", "?", "x", "q"):
        keys.press(key)
    assert drone.pegs.first == pytest.approx(4 / 3) and drone.pegs.cents == (0, 2, 0, 0)
    assert drone.pegs.sa_hz == pytest.approx(midi_to_hz(49)) and drone.jiva_um == 3.5
    assert drone.cycle.cycle_s < 5.5 and drone.cycle.human == 0.45 and drone.volume > 1.0 and ended == [True]
    assert any("[Sa +2 c]" in text for text in said) and any(text.startswith("keys:") for text in said)
    found = drone.events(5 * RATE)
    assert set(found["a"][found["kind"] == TUNING]) == set(strings.keys)
    for _ in range(60):
        keys.press("]")
        keys.press("S")
    assert drone.pegs.cents[1] == 50.0 and "--sa must lie between" in said[-1]


@pytest.mark.parametrize(
    ("options", "names"),
    [
        (["--sa", "C4"], ("--sa", "G2", "F3", "261.6")),
        (["--sa", "nan"], ("--sa", "nan", "C#3")),
        (["--first", "Xa"], ("--first", "Xa", "komal-Ni")),
        (["--sa", "G2", "--first", "Sa"], ("--first", "tension", "nearer")),
        (["--cents", "1,2"], ("--cents", "4 strings", "got 2")),
        (["--cents", "0,0,0,nan"], ("--cents", "50", "nan")),
        (["--spacing", "1,1"], ("--spacing", "4 strings", "got 2")),
        (["--spacing", "1,1,1,0"], ("--spacing", "0.001 to 1000", "got 0")),
        (["--spacing=-1,1,1,1"], ("--spacing", "0.001 to 1000", "got -1")),
        (["--spacing", "1,nan,1,1"], ("--spacing", "0.001 to 1000", "got nan")),
        (["--spacing", "inf,inf,inf,inf"], ("--spacing", "0.001 to 1000", "got inf")),
        (["--spacing", "1e308,1e308,1e308,1e308"], ("--spacing", "0.001 to 1000", "got 1e+308")),
        (["--spacing", "1,1,1,21"], ("--spacing", "20 times", "got 1 and 21")),
        (["--cents", "0,0,0,1e300"], ("--cents", "-50 and 50", "got 1e+300")),
        (["--jiva", "nan"], ("--jiva", "0 to 50", "nan")),
        (["--cycle", "0"], ("--cycle", "1 to 60", "0")),
        (["--human", "inf"], ("--human", "0 to 1", "inf")),
        (["--velocity", "1e300"], ("--velocity", "1 to 127", "1e300")),
        (["--bpm", "290"], ("--bpm", "cycle", "240")),
        (["--second", "Ni"], ("--second", "--strings 5")),
        (["--duration", "3", "--fade", "4"], ("--fade", "--duration", "got 4")),
        (["--record", "x.wav"], ("--record", "live")),
        (["-p", "jawari-harp"], ("--preset", "tanpura")),
    ],
)
def test_wrong_options(options: list[str], names: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    try:
        code = main(["drone", "-o", str(tmp_path / "x.wav"), *options])
    except SystemExit as end:  # argparse's own
        code = end.code
    told = capsys.readouterr().err
    assert code == 2 and told.count("\n") == 1 and all(name in told for name in names), told
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ratio", ["1e999999999", "1e-999999999"])
def test_a_ratio_takes_no_longer_than_its_text(ratio: str) -> None:
    # In another process: what computes such a number can be ended by nothing else.
    done = subprocess.run(
        [sys.executable, "-m", "synth", "drone", "--first", ratio],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=patience_s(),
    )
    assert done.returncode == 2 and "ratio from 1 to 2" in done.stderr and done.stderr.count("\n") == 1


def test_a_drone_of_five_strings_to_flac(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = tmp_path / "five.flac"
    options = ["--strings", "5", "--cycle", "2", "--duration", "2.5", "--quality", "draft"]
    assert main(["drone", "-o", str(path), *options]) == 0
    assert "7 strokes" in capsys.readouterr().out
    assert soundfile.info(path).frames == round(2.5 * RATE)


@pytest.mark.parametrize("output", [["--rate", "44100"], ["--jack"]], ids=["PortAudio", "JACK"])
def test_on_a_sound_server(output: list[str], jack_server: StartServer, tmp_path: Path) -> None:
    """A take of what a server heard: the same as the file, and it renders again."""
    options = ["--cycle", "1.5", "--human", "1", "--seed", "9", "--duration", "4", "--fade", "1", "--bit-depth", "24"]
    take = tmp_path / "take.wav"
    how = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    arguments = ["drone", *options, *output, "--record", str(take), "--json"]
    with prepared().start(arguments, tmp_path, env=jack_server().env, **how) as running:
        out, err = running.communicate(timeout=compiling_s())
    assert running.returncode == 0, err
    told = json.loads(out)
    assert told["ended"] == "duration" and told["notes"] >= 10 and told["events_lost"] == 0
    assert [Path(name).suffix for name in told["files"]] == [".wav", ".mid", ".toml"]
    file = tmp_path / "file.wav"
    assert main(["drone", "-o", str(file), *options, "--quiet"]) == 0
    again = tmp_path / "again.wav"
    render = ["render", str(take.with_suffix(".mid")), "-p", str(take.with_suffix(".toml")), "-o", str(again), "--quiet"]
    assert main(render) == 0
    wanted = soundfile.read(file)[0]
    live = soundfile.read(take)[0]
    begin = int(np.argmax(np.abs(live[:, 0]) > 1e-5)) - int(np.argmax(np.abs(wanted[:, 0]) > 1e-5))
    assert 0 <= begin < RATE  # the engine's latency, and whatever the recorder began with
    live = live[begin : begin + len(wanted)]
    assert len(live) >= 3.9 * RATE
    np.testing.assert_allclose(live, wanted[: len(live)], atol=2.0**-22)
    rendered = soundfile.read(again)[0]
    n = min(len(rendered), len(wanted))
    assert n >= 3.5 * RATE
    error = rendered[:n] - wanted[:n]
    assert np.sqrt(np.mean(error**2)) < 0.1 * np.sqrt(np.mean(wanted[:n] ** 2))
