"""The analysis: partials against the model, contacts in time with what they do, the formant where there is one."""

import json
import math

import numpy as np
import pytest

from synth.author.views import analysis
from synth.author.views.analysis import analyse
from synth.author.views.formant import descending_formant
from synth.dsp.measures import stft_power
from synth.fit.tune import measure
from synth.host.contacts import Forces, binned, contacts_of, gather, touches
from synth.host.string_tape import RATE_HZ, Taped
from synth.instrument.place import find
from synth.instrument.planfile import MeasuredPlan
from synth.instrument.preset import Body, Preset, PresetError, load_preset

from .kit import TEXTS, preset, tanpura


@pytest.mark.parametrize(
    ("name", "note"), [("tanpura-light", 48), ("fretted-bass", 40), ("jawari-harp", 96), ("points", 55), ("free", 48)]
)
def test_an_analysis_is_whole_and_small(name: str, note: int) -> None:
    shown = analyse(preset(name), note, 110, 1.0)
    assert len(json.dumps(shown, allow_nan=False)) < 500_000
    wave, picture = shown["waveform"], shown["spectrogram"]
    assert len(wave["low"]) == len(wave["high"]) and wave["bin_s"] * len(wave["low"]) == pytest.approx(1.0, rel=1e-4)
    assert 20 * math.log10(max(np.abs(wave["low"]).max(), np.abs(wave["high"]).max())) == pytest.approx(
        shown["peak_dbfs"], abs=0.02
    )
    rows = np.array(picture["rows"])
    assert rows.shape[0] == len(picture["hz"]) and rows.min() >= 0 and rows.max() == 255
    assert picture["step_s"] * rows.shape[1] == pytest.approx(1.0, abs=0.06)
    times = [contact["start_s"] for contact in shown["contacts"]]
    assert times == sorted(times) and len(times) <= shown["contacts_found"]


def test_an_analysis_at_another_rate_finds_the_same() -> None:
    here, there = analyse(tanpura(), 48, 90, 1.5), analyse(tanpura(), 48, 90, 1.5, quality="fine", rate_hz=96000.0)
    assert there["rate_hz"] == 96000.0 and there["spectrogram"]["hz"] == here["spectrogram"]["hz"]
    assert there["pitch_cents"] == pytest.approx(here["pitch_cents"], abs=0.5)
    for mine, theirs in zip(here["partials"][:8], there["partials"][:8], strict=True):
        assert theirs["measured_hz"] == pytest.approx(mine["measured_hz"], rel=1e-3)


@pytest.mark.parametrize("velocity", [50, 110])
def test_a_string_that_meets_nothing_has_the_partials_of_its_model(velocity: int) -> None:
    shown = analyse(tanpura(900.0), 48, velocity, 2.0)
    shift = 1.65  # tuned so much lower for a contact that does not happen
    assert shown["pitch_cents"] == pytest.approx(-shift, abs=0.02)
    heard = [partial for partial in shown["partials"] if partial["measured_hz"] is not None]
    assert len(heard) >= 15
    for partial in heard:
        assert partial["cents"] == pytest.approx(-shift, abs=0.05)
        assert partial["measured_t60_s"] == pytest.approx(partial["model_t60_s"], rel=0.02)
    assert shown["contacts"] == [] and shown["timeline"]["points"] == [] and shown["formant"] is None


def test_a_stopped_string_has_the_partials_of_its_length() -> None:
    # in one direction and at one tension: two are 0.8 cents apart, and a pitch that falls depends on when it is measured
    data = load_preset("fretted-bass").model_dump(exclude_unset=True, exclude={"polarisation": True, "tuning": True})
    of_tension = ("tension_modulation", "axial_stiffness_n")
    strings = [{key: value for key, value in string.items() if key not in of_tension} for string in data["string"]]
    bass = Preset.model_validate(data | {"string": strings})
    stopped = analyse(bass, 45, 40, 2.0)
    (found,) = [pitch for pitch in measure(find(bass, 45).preset, {45})]
    heard = analyse(bass, 45, 64, 2.2)
    assert heard["pitch_cents"] == pytest.approx(found.cents, abs=0.05)
    first = stopped["partials"][0]
    # softly plucked, it meets no fret behind the finger's
    assert first["model_hz"] == pytest.approx(110.0, rel=1e-6) and -0.1 < first["cents"] < 0.3
    assert first["measured_t60_s"] == pytest.approx(first["model_t60_s"], rel=0.1)


def test_the_sound_changes_from_the_first_contact_on() -> None:
    bass = load_preset("fretted-bass").with_measured(MeasuredPlan())  # both by the law, at the same rate
    far = bass.with_setting("obstacle.heights_mm", str([-30.0 - k for k in range(20)]))
    sounds = []
    for version in (bass, far):
        # stopped at no fret the two have the same string; open, so that the frets alone differ
        engine = Taped(find(version, 28))
        sounds.append(np.concatenate([piece.out.copy() for piece in engine.play(115, 0.1)])[engine.latency_samples :])
    shown = analyse(bass, 28, 115, 0.2)
    first_s = shown["contacts"][0]["start_s"]
    differs = np.abs(sounds[0] - sounds[1]) > 1e-6 * np.abs(sounds[1]).max()
    seen_s = np.argmax(differs) / RATE_HZ
    # not before it by more than the decimator's filter spreads, nor after it by more than a wave takes to the pickup
    assert -40 / RATE_HZ < seen_s - first_s < 0.002
    assert {contact["label"] for contact in shown["contacts"]} <= {f"fret {k}" for k in range(1, 21)}


def test_contacts_add_up() -> None:
    shown = analyse(load_preset("fretted-bass"), 40, 127, 0.5)
    timeline = shown["timeline"]
    assert len(shown["contacts"]) == shown["contacts_found"] > 5
    for row, point in enumerate(timeline["points"]):
        mine = [contact for contact in shown["contacts"] if contact["point"] == point["point"]]
        assert len(mine) == point["contacts"]
        total = sum(contact["impulse_ns"] for contact in mine)
        assert total == pytest.approx(point["impulse_ns"], rel=5e-3)
        assert sum(timeline["impulse_ns"][row]) == pytest.approx(total, rel=5e-3)
        assert max(timeline["peak_n"][row]) == pytest.approx(point["peak_n"]) == max(contact["peak_n"] for contact in mine)
        bins = [k for k, impulse in enumerate(timeline["impulse_ns"][row]) if impulse > 0.0]
        assert bins[0] == int(point["first_s"] / timeline["bin_s"])
        for contact in mine:
            assert 0.0 < contact["end_s"] - contact["start_s"] < 0.05
            assert contact["impulse_ns"] <= contact["peak_n"] * (contact["end_s"] - contact["start_s"]) * 1.001


def test_what_is_touched_at_the_end_and_later_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """The engine runs on for its delay: a fret that is first touched then has no contact in the time asked for."""
    monkeypatch.setattr(analysis, "SHORTEST_S", 0.01)
    points = analyse(preset("fretted-bass"), 28, 127, 0.5)["timeline"]["points"]
    last = max(points, key=lambda point: point["first_s"])
    shown = analyse(preset("fretted-bass"), 28, 127, last["first_s"] - 1e-5)
    assert [point["point"] for point in shown["timeline"]["points"]] == [
        point["point"] for point in points if point["first_s"] < last["first_s"]
    ]
    for point, impulses in zip(shown["timeline"]["points"], shown["timeline"]["impulse_ns"], strict=True):
        assert sum(impulses) == pytest.approx(point["impulse_ns"], rel=2e-3)


def test_steps_become_contacts() -> None:
    step_s = 1e-5
    force = np.zeros((1000, 2))
    force[100:110, 0] = 2.0
    force[130:140, 0] = 4.0  # after a pause of 0.2 ms: the same contact
    force[500, 0] = 1.0
    force[105, 1] = 3.0
    halves = [touches(0, force[:500]), touches(500, force[500:])]
    forces = gather(halves, step_s)
    found = contacts_of(forces, 0.01)
    assert [(c.point, c.peak_n) for c in found] == [(0, 4.0), (1, 3.0), (0, 1.0)]
    assert found[0].start_s == pytest.approx(100 * step_s) and found[0].end_s == pytest.approx(140 * step_s)
    assert found[0].impulse_ns == pytest.approx(60 * step_s)
    assert len(contacts_of(forces, 0.001)) == 4  # of a string of 1 kHz that is a pause
    impulse, peak = binned(forces, 2, 2.5e-3, 4)
    np.testing.assert_allclose(impulse, [[60 * step_s, 0.0, step_s, 0.0], [3 * step_s, 0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(peak, [[4.0, 0.0, 1.0, 0.0], [3.0, 0.0, 0.0, 0.0]])
    nothing = gather([touches(0, np.zeros((10, 2)))], step_s)
    assert contacts_of(nothing, 0.01) == [] and isinstance(nothing, Forces)


def ridge(shown: dict) -> tuple[np.ndarray, np.ndarray]:
    return np.array([p["t_s"] for p in shown["formant"]]), np.array([p["hz"] for p in shown["formant"]])


def on_the_bridge() -> Preset:
    """A tanpura's strings without the gourd, whose resonances the formant lingers at."""
    return tanpura().model_copy(update={"body": Body()})


@pytest.mark.parametrize("velocity", [64, 90, 110])
def test_the_tanpuras_formant_descends(velocity: int) -> None:
    t, hz = ridge(analyse(on_the_bridge(), 48, velocity, 3.0))
    assert hz[t < 0.3].mean() > 1.4 * hz[(t > 1.3) & (t < 1.8)].mean()
    assert np.all(np.diff(t) > 0.0) and np.all((hz > 3 * 130.8) & (hz < 12000.0))


def test_the_formant_begins_higher_and_sinks_further_on_a_longer_bridge() -> None:
    ridges = [ridge(analyse(on_the_bridge().with_setting("obstacle.distance_mm", mm), 48, 90, 3.0))[1] for mm in ("4", "12")]
    assert ridges[1][0] > 1.3 * ridges[0][0] and ridges[1][-1] < ridges[0][-1]


@pytest.mark.parametrize(
    ("name", "note", "velocity"),
    [("fretted-bass", 28, 127), ("fretted-bass", 40, 127), ("fretted-bass", 45, 50), ("free", 48, 100)],
)
def test_where_no_buzz_is_fed_there_is_no_formant(name: str, note: int, velocity: int) -> None:
    assert analyse(preset(name), note, velocity, 2.0)["formant"] is None


@pytest.mark.parametrize(
    ("begin_hz", "end_hz", "found"), [(4000.0, 1000.0, True), (1000.0, 4000.0, False), (2000.0, 2000.0, False)]
)
def test_only_what_descends_is_a_descending_formant(begin_hz: float, end_hz: float, found: bool) -> None:
    rate, f0 = 44100.0, 130.0
    t = np.arange(2 * 44100) / rate
    centre = begin_hz * (end_hz / begin_hz) ** (t / 2.0)
    x = sum(np.exp(-0.5 * ((j * f0 - centre) / 250.0) ** 2) * np.cos(2 * np.pi * j * f0 * t) for j in range(1, 60))
    power = stft_power(np.asarray(x), 2048, 512)
    times = (1024 + 512 * np.arange(len(power))) / rate
    touched = np.ones(times.size, bool)
    result = descending_formant(power, np.arange(1025) * rate / 2048, times, f0, touched)
    assert (result is not None) == found
    if result is not None:
        inner = (result[0] > 0.2) & (result[0] < 1.8)  # at its ends a ridge of least price is flat
        assert inner.sum() > 100
        assert np.abs(result[1] - np.interp(result[0], t, centre))[inner].max() < 1.5 * f0
    assert descending_formant(power, np.arange(1025) * rate / 2048, times, f0, ~touched) is None


@pytest.mark.parametrize("seconds", [0.1, 11.0, float("nan")])
def test_impossible_lengths_are_refused(seconds: float) -> None:
    with pytest.raises(ValueError, match=r"seconds must lie between 0\.2 and 10"):
        analyse(tanpura(), 48, 100, seconds)


def test_every_preset_has_an_analysis_of_its_lowest_and_highest_note() -> None:
    for name in TEXTS:
        of = preset(name)
        for note in (of.string[0].notes[0], of.string[-1].notes[1]):
            assert analyse(of, note, 100, 0.3)["peak_dbfs"] is not None
    with pytest.raises(PresetError, match="no string plays"):
        analyse(tanpura(), 61)
