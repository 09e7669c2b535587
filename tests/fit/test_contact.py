"""The contact fit: features, unknowns, one small fit from sound to preset, and what is refused."""

import io
import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile
import soxr

from synth import cli
from synth.fit import contact_dictionary, contact_fit, contact_group
from synth.fit.contact_damage import holes
from synth.fit.contact_dictionary import contact_search, shaped
from synth.fit.contact_features import SECONDS, bands_of, compare, huber, observe
from synth.fit.contact_fit import fit_note
from synth.fit.contact_model import Bridge, ContactModel, ContactStroke, PluckingHand
from synth.fit.contact_observed import seen_of
from synth.fit.contact_search import sobol, starts_of
from synth.fit.contact_space import asked, space_of
from synth.fit.recording import FitCancelled, FitRefused, cut_note
from synth.instrument.preset import load_preset
from synth.native import views
from synth.solver import driver
from synth.units import midi_to_hz, note_to_midi

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from contact_truths.notes import Truth, length_m, sound

RATE_HZ = 44100
TRUTH = Truth("tanpura-light", 0, 8e-6, 7e-3, 0.33, 3e-3, 0.011, seed=5, quality="standard")
#: its values as the fit's unknowns
_VALUES = {"height": 0.237, "distance": 7e-3 / 0.95, "position": 0.33, "draw": 0.011}


@pytest.fixture(scope="module")
def model() -> ContactModel:
    return ContactModel.of_preset(load_preset("tanpura-light"), 0)


@pytest.fixture(scope="module")
def recording() -> np.ndarray:
    return sound(TRUTH)


def test_only_ratios_can_be_heard(model: ContactModel) -> None:
    """Height, amplitude and sound times three are the same motion."""
    grid = model.grid(250.0, 0.0)
    one = model.sound(ContactStroke(8e-6, 7e-3, 0.33, 3e-3, 0.011), grid, 0.5)
    three = model.sound(ContactStroke(24e-6, 7e-3, 0.33, 9e-3, 0.011), grid, 0.5)
    assert 0.05 < one.touching == three.touching < 0.95
    assert np.abs(three.frames - 3.0 * one.frames).max() < 1e-9 * np.abs(three.frames).max()


def test_a_height_out_of_reach_touches_nothing(model: ContactModel) -> None:
    played = model.sound(ContactStroke(5e-4, 7e-3, 0.33, 3e-3, 0.011), model.grid(250.0, 0.0), 0.5)
    assert played.touching == 0.0


def test_a_curved_bridge_falls_away_from_the_string() -> None:
    below = Bridge(4, 3, 8.0).obstacle(0.88, 1e-5, 8e-3)
    assert below.positions_m == pytest.approx((0.874, 0.876, 0.878))
    assert below.heights_m == pytest.approx([-(x**2) / 16.0 - 1e-5 for x in (6e-3, 4e-3, 2e-3)])


def test_offsets_of_bands_gain_and_onset_do_not_count(model: ContactModel) -> None:
    bands = bands_of(model.string, RATE_HZ)
    grid = model.grid(250.0, RATE_HZ)
    x = model.sound(ContactStroke(8e-6, 7e-3, 0.33, 3e-3, 0.011), grid, SECONDS + 0.2).frames
    power = bands.powers(x, RATE_HZ)
    assert power.shape == (bands.windows(), bands.edges_hz.size - 1)
    recorded = np.concatenate([np.zeros(2000), 0.01 * np.convolve(x, [1.0, 0.5])])
    noise = np.full(bands.edges_hz.size - 1, 1e-14)
    seen = observe(recorded, RATE_HZ, 2000 - 265, bands, noise)
    same = compare(seen, power)
    # the filter's slope within a band, and 9 µs of onset, are left: 0.1 dB
    assert seen.shifts_s[same.shift] == pytest.approx(0.006) and same.loss < 0.01
    other = compare(
        seen, bands.powers(model.sound(ContactStroke(12e-6, 7e-3, 0.33, 3e-3, 0.011), grid, SECONDS + 0.1).frames, RATE_HZ)
    )
    assert other.loss > 0.1


def test_huber_is_square_then_straight() -> None:
    assert huber(np.array([0.01])) == pytest.approx(1e-4, rel=1e-3)
    assert huber(np.array([100.0])) == pytest.approx(198.0, rel=1e-3)


def test_power_of_a_tone_is_in_its_band(model: ContactModel) -> None:
    bands = bands_of(model.string, RATE_HZ)
    t = np.arange(RATE_HZ * 3) / RATE_HZ
    power = bands.powers(np.sin(2.0 * np.pi * 3.0 * 98.0 * t), RATE_HZ)
    assert np.all(power.argmax(axis=1) == 2)
    assert power[:, 2] == pytest.approx(0.5, rel=0.01)


def test_unknowns_and_back(model: ContactModel) -> None:
    space = space_of(model.string, 3e-3, slip_s=3e-4)
    points = sobol(space.size, 16)
    for point in points:
        assert space.point(space.values(point)) == pytest.approx(point)
        stroke, found = space.stroke(point), asked(space, point)
        assert found["height"] == pytest.approx(stroke.height_m / 3e-3)
        assert found["distance"] * model.string.length_m == pytest.approx(stroke.distance_m)
    held = space_of(model.string, 3e-3, position=0.2)
    assert held.size == 4 and held.stroke(np.full(4, 0.5)).position == 0.2 and "position" not in asked(held, np.full(4, 0.5))


def test_starts_are_apart() -> None:
    points = np.array([[0.1, 0.1], [0.12, 0.1], [0.5, 0.5]])
    assert starts_of(points, np.array([1.0, 0.5, 2.0]), 2).tolist() == [[0.12, 0.1], [0.5, 0.5]]


def test_a_note_gives_its_bridge(model: ContactModel, recording: np.ndarray, monkeypatch) -> None:
    """A dictionary narrowed to a neighbourhood stands for the search; the rest is as it is."""
    search = contact_search(model, 3e-3, starts=1)
    centre = search.space.point({"height": 0.24, "distance": 0.0076, "position": 0.34, "draw": 0.0115, "losses": 1.03})
    monkeypatch.setattr(
        contact_dictionary, "sobol", lambda size, notes: np.clip(centre + 0.03 * (sobol(size, 16) - 0.5), 0.0, 1.0)
    )
    monkeypatch.setattr(contact_fit, "starts_of", lambda points, losses, count: starts_of(points, losses, count))
    monkeypatch.setattr(contact_fit, "_FIRST", 48)
    monkeypatch.setattr(contact_fit, "_SECOND", 48)
    told: list[float] = []
    # no note of the neighbourhood is out of reach: what touches nothing is not asked for
    monkeypatch.setattr(contact_fit._Fitting, "_free", lambda self, points, losses: 1.0)
    found = fit_note(search, recording, RATE_HZ, progress=lambda share: told.append(share) or True)
    length = length_m("tanpura-light", 0)
    assert found.values["height"].value == pytest.approx(8e-6 / 3e-3, abs=3e-4)
    assert found.values["distance"].value * length == pytest.approx(7e-3, abs=3e-4)
    assert found.values["position"].value == pytest.approx(0.33, abs=0.01)
    for name, value in TRUTH.values.items():
        assert found.values[name].low <= value <= found.values[name].high
    assert found.loss < 0.15 < found.free_loss and told == sorted(told)


def test_cancelled(model: ContactModel, recording: np.ndarray) -> None:
    with pytest.raises(FitCancelled):
        fit_note(contact_search(model, 3e-3, notes=16), recording, RATE_HZ, progress=lambda share: False)


def test_it_is_asked_now_and_then_whether_to_go_on(model: ContactModel) -> None:
    """Not only between the parts of a search: one of them can take half a minute."""
    search, asked_at = contact_search(model, 3e-3), []
    search.pulse = lambda: asked_at.append(search.evaluations)
    for _ in range(20):
        search.powers(np.full(search.space.size, 0.5), bands_of(model.string, RATE_HZ), search.coarse, 0.2)
    assert asked_at == [8, 16]


def test_over_a_curved_bridge_starts_cover_what_the_first_moments_tell(model: ContactModel) -> None:
    curved = ContactModel(model.string, Bridge(4, 4, 2.0), PluckingHand(slip_s=4e-4))
    search = contact_search(curved, 2e-3, notes=16)
    points, _, driven = search.dictionary(bands_of(model.string, RATE_HZ), lambda share: None)
    values = [search.space.values(point) for point in points]
    assert (
        len(points) == 64 and not driven and {round(each["losses"], 6) for each in values} == {round((0.6 * 1.6) ** 0.5, 6)}
    )
    slips = [each["slip"] / 4e-4 for each in values]
    assert 0.57 < min(slips) < 0.65 and 1.55 < max(slips) < 1.74
    assert max(each["position"] for each in values) > 0.45 and min(each["position"] for each in values) < 0.07


def test_a_note_opens_what_stays_once(model: ContactModel, monkeypatch) -> None:
    """Tables for the kernels take as long as the kernels: 6,000 notes of a fit make them anew."""
    opened: list[str] = []

    def table(*parts: object) -> np.ndarray:
        opened.extend(type(part).__name__ for part in parts)
        return views.table(*parts)

    monkeypatch.setattr(driver, "table", table)
    model.sound(ContactStroke(8e-6, 7e-3, 0.33, 3e-3, 0.011), model.grid(250.0, 0.0), 0.1)
    assert opened.count("StringState") == 1 and opened.count("StringModel") == 4


def _fitting(model: ContactModel, samples: np.ndarray) -> contact_fit._Fitting:
    note = cut_note(samples, RATE_HZ)
    return contact_fit._Fitting(contact_search(model, 3e-3), note, seen_of(model.string, note), lambda share: None)


@pytest.mark.parametrize(
    ("bridge", "words"),
    [
        (Bridge(), None),
        (Bridge(5, 5, 2.5), "a curved bridge of 2.5 m explains the sound better than one of a point"),
    ],
    ids=["a point", "curved"],
)
def test_another_bridge_is_not_taken_for_one_of_a_point(model: ContactModel, bridge: Bridge, words: str | None) -> None:
    # the edge of all of them is as high
    fallen = 0.0 if bridge.points == 1 else 0.5 * 7e-3**2 / bridge.radius_m
    stroke = ContactStroke(8e-6 - fallen, 7e-3, 0.33, 3e-3, 0.011)
    grid = model.grid(1000.0, RATE_HZ)
    x = model.over(bridge).sound(stroke, grid, 3.2)
    fitting = _fitting(model, soxr.resample(x.frames / np.abs(x.frames).max(), grid.rate_hz, RATE_HZ))
    search = fitting.search
    point, loss = fitting._squares(search.space.point({**_VALUES, "losses": 1.0}), search.coarse, rounds=6)
    if words is None:
        for other, ratio in fitting._other_bridges(point, loss):
            assert np.abs(other).max() < 0.02 and ratio > 0.9
    else:
        with pytest.raises(FitRefused, match=words):
            fitting._other_bridges(point, loss)


def test_a_bridge_of_two_points_is_named_in_a_warning(model: ContactModel) -> None:
    grid, truth = model.grid(1000.0, RATE_HZ), ContactStroke(6e-6, 14e-3, 0.33, 3e-3, 0.011)
    x = model.over(Bridge(2, 2, 1e5)).sound(truth, grid, 3.2)
    fitting = _fitting(model, soxr.resample(x.frames / np.abs(x.frames).max(), grid.rate_hz, RATE_HZ))
    space = fitting.search.space
    height = 6e-6 * (1.0 - 0.33) * 0.95 / (14e-3 * 3e-3)
    start = space.point({**_VALUES, "height": height, "distance": 14e-3 / 0.95, "losses": 1.0})
    point, loss = fitting._squares(start, fitting.search.coarse, rounds=6)
    found = fitting._told(point, [], 1.0, fitting._other_bridges(point, loss))
    assert any("a bridge of several points explains the sound better" in words for words in found.warnings)


def test_a_second_point_anywhere_is_found_and_widens_the_interval(model: ContactModel) -> None:
    """Lightly touched, at a share of the distance that no even bridge has; the note of one point stays as it is."""
    grid, one = model.grid(1000.0, RATE_HZ), ContactStroke(8e-6, 12e-3, 0.33, 3e-3, 0.011)
    losses, found = [], []
    for truth in (one, replace(one, inner=(0.62, 5.2e-6))):
        x = model.sound(truth, grid, 3.2).frames
        x = soxr.resample(x - x.mean(), grid.rate_hz, RATE_HZ)
        fitting = _fitting(model, np.concatenate([np.zeros(RATE_HZ // 10), x / np.abs(x).max()]))
        space = fitting.search.space
        height = 8e-6 * (1.0 - 0.33) * 0.95 / (12e-3 * 3e-3)
        start = space.point({**_VALUES, "height": height, "distance": 12e-3 / 0.95, "losses": 1.0})
        point, loss = fitting._squares(start, fitting.search.fine, rounds=6)
        other, ratio = fitting._second_point(point, loss)
        found.append(fitting._told(point, [], 1.0, [(other, ratio)]))
        losses.append((loss, ratio * loss))
    assert not found[0].warnings and losses[0][1] > losses[0][0] - 0.01
    assert "a bridge of several points explains the sound better" in found[1].warnings[0]
    assert losses[1][1] < 0.5 * losses[1][0]
    values = found[1].values
    assert values["height"].low <= 8e-6 / 3e-3 <= values["height"].high
    assert values["distance"].low <= 12e-3 / 0.95 <= values["distance"].high


def test_much_that_is_not_explained_has_a_warning(model: ContactModel, recording: np.ndarray) -> None:
    fitting = _fitting(model, recording)
    values = {**_VALUES, "losses": 1.0}
    right, beside = (
        fitting._told(fitting.search.space.point(each), [], 1.0) for each in (values, {**values, "height": 0.4})
    )
    assert right.loss < contact_fit.DOUBTFUL_LOSS < beside.loss
    assert not right.warnings and "the intervals may miss the truth" in beside.warnings[0]


def _settled(model: ContactModel, recording: np.ndarray, monkeypatch, followed, fine) -> list[tuple[np.ndarray, float]]:
    """What is left beside an answer of five others nearby, each of which leads to `followed`, with the loss `fine`."""
    fitting = _fitting(model, recording)
    search = fitting.search
    answer = search.space.point({**_VALUES, "losses": 1.0})
    others = [(answer + 0.04 * (k + 1) * np.eye(search.space.size)[0], 0.1 + 1e-3 * k) for k in range(5)]
    monkeypatch.setattr(fitting, "_nearer", lambda *start, **how: (answer + followed, 0.09))
    monkeypatch.setattr(
        fitting,
        "_squares",
        lambda point, grid, rounds: (point, fine if grid is search.fine and point[0] > answer[0] else 0.02),
    )
    return fitting._settled([(answer, 0.09), *others])[2]


def test_a_valley_is_followed_to_its_end_before_it_is_another_answer(model, recording, monkeypatch) -> None:
    """Five unpolished points along it are one answer; and the fine grid decides between two."""
    size = contact_search(model, 3e-3).space.size
    same, other = np.zeros(size), 0.1 * np.eye(size)[0]
    fitting, answer = _fitting(model, recording), contact_search(model, 3e-3).space.point({**_VALUES, "losses": 1.0})
    for followed, fine in ((same, 0.02), (other, 0.06)):
        left = _settled(model, recording, monkeypatch, followed, fine)
        fitting._refuse((answer, 0.02), left, 1.0)
    with pytest.raises(FitRefused, match="several contacts explain the sound as well"):
        fitting._refuse((answer, 0.02), _settled(model, recording, monkeypatch, other, 0.025), 1.0)


def test_intervals_hold_what_other_bridges_say(model: ContactModel, recording: np.ndarray) -> None:
    fitting = _fitting(model, recording)
    space = fitting.search.space
    point = space.point({**_VALUES, "losses": 1.0})
    other = space.point({**_VALUES, "height": 0.3, "distance": 7.3e-3 / 0.95, "losses": 1.0})
    alone, both = fitting._told(point, [], 1.0), fitting._told(point, [], 1.0, [(other - point, 1.0)])
    assert not alone.warnings and "a bridge of several points explains the sound as well" in both.warnings[0]
    for name, value in asked(space, other).items():
        assert both.values[name].low <= value <= both.values[name].high
    assert asked(space, other)["height"] > alone.values["height"].high


@pytest.mark.parametrize("drive", [0.0, 1.5, 3.0])
def test_an_overdriven_note_is_refused(model: ContactModel, recording: np.ndarray, drive: float) -> None:
    """From a wrong answer too: the dictionary knows its notes behind a waveshaper."""
    fitting = _fitting(model, shaped(recording, drive))
    space = fitting.search.space
    near, wrong = (space.point({**_VALUES, "height": height, "losses": 1.0}) for height in (0.25, 0.5))
    losses = np.array([0.1])
    if drive:
        with pytest.raises(FitRefused, match="the recording is overdriven: a note behind a soft limit explains it better"):
            fitting._refuse_shaped(wrong, 0.3, near[None], losses)
    else:
        fitting._refuse_shaped(near, 0.2, near[None], losses)


def test_a_codec_of_few_bits_is_refused(model: ContactModel, recording: np.ndarray) -> None:
    assert holes(cut_note(recording, RATE_HZ)) == 0.0
    file = io.BytesIO()
    soundfile.write(
        file, recording, RATE_HZ, format="MP3", subtype="MPEG_LAYER_III", bitrate_mode="CONSTANT", compression_level=0.99
    )
    file.seek(0)
    decoded, _ = soundfile.read(file)
    with pytest.raises(FitRefused, match=r"has holes in its spectrum .* as a codec at a low bit rate leaves them"):
        fit_note(contact_search(model, 3e-3, notes=16), decoded, RATE_HZ)


def test_notes_that_are_none_are_refused(model: ContactModel, recording: np.ndarray) -> None:
    search = contact_search(model, 3e-3, notes=16)
    for samples, reason in (
        (np.zeros(3 * RATE_HZ), "silent"),
        (recording[: RATE_HZ + RATE_HZ // 2], "must last at least 2 s"),
        (np.clip(recording, -0.1, 0.1), "clipped"),
    ):
        with pytest.raises(FitRefused, match=reason):
            fit_note(search, samples, RATE_HZ)


def test_the_pitch_is_the_strings(recording: np.ndarray) -> None:
    preset = load_preset("tanpura-light")
    tuned, warnings = contact_group.tuned_model(preset, 0, [(recording, RATE_HZ)])
    assert tuned.string.fundamental_hz == pytest.approx(97.9, rel=2e-3) and len(warnings) <= 1
    flat, warnings = contact_group.tuned_model(preset, 0, [(recording, RATE_HZ * 0.98)])
    assert flat.string.fundamental_hz == pytest.approx(0.98 * 97.9, rel=2e-3) and "-3" in warnings[0]
    with pytest.raises(FitRefused, match=r"must be string 1's, 130\.8 Hz within 60 cents"):
        contact_group.tuned_model(preset, 1, [(recording, RATE_HZ)])


@pytest.mark.parametrize(("note", "string"), [("G2", 0), ("C3", 1), ("C2", 3)])
def test_the_string_is_the_nearest_to_the_note(note: str, string: int) -> None:
    t, hz = np.arange(2 * RATE_HZ) / RATE_HZ, 1.01 * midi_to_hz(note_to_midi(note))
    sound = sum(np.exp(-(1 + 0.2 * k) * t) * np.sin(2 * np.pi * k * hz * t) / k for k in range(1, 20))
    assert contact_group.string_of(load_preset("tanpura-light"), sound, RATE_HZ) == string


def test_the_command_says_what_does_not_go(capsys, tmp_path, recording: np.ndarray) -> None:
    path = tmp_path / "note.wav"
    soundfile.write(path, recording, RATE_HZ, subtype="PCM_24")
    for arguments, reason in (
        ([str(path), "--amplitude", "3"], "--amplitude goes with --contact"),
        ([str(path), str(path)], "one recording at a time, got 2"),
        ([str(path), "--contact"], "name it with -p"),
        ([str(path), "--contact", "-p", "tanpura-light", "--pitch", "98"], "--pitch cannot be combined with --contact"),
        ([str(path), "--contact", "-p", "fretted-bass"], "has frets, whose fit is experimental: add --experimental"),
        ([str(path), "--contact", "-p", "tanpura-light", "--string", "Sa 1"], "must be string 1's"),
        (
            [str(path), "--contact", "-p", "tanpura-light", "--picture", str(path)],
            "which is an input: give the output another",
        ),
        ([str(path), "--contact", "-p", "tanpura-light", "--pluck-at", "0.9"], "must be a number from 0.02 to 0.5"),
    ):
        try:
            code = cli.main(["fit", *arguments])
        except SystemExit as ended:  # argparse
            code = ended.code
        assert code == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1 and reason in lines[0], lines


def test_what_is_found_is_told_and_written(capsys, tmp_path, recording: np.ndarray, monkeypatch) -> None:
    """The command around a fit that is known."""
    path, target, picture = tmp_path / "note.wav", tmp_path / "mine.toml", tmp_path / "fit.png"
    soundfile.write(path, recording, RATE_HZ, subtype="PCM_24")

    def near(self: contact_fit._Fitting) -> contact_fit.NoteFit:
        point = self.search.space.point({**_VALUES, "losses": 1.0})
        return self._told(point, [], 1.0)

    monkeypatch.setattr(contact_fit._Fitting, "result", near)
    pytest.importorskip("matplotlib")
    arguments = ["fit", "--contact", str(path), "-p", "tanpura-light", "--amplitude", "6", "--picture", str(picture)]
    assert cli.main([*arguments, "-o", str(target)]) == 0
    told = capsys.readouterr().out
    assert told.startswith(f"{path}: string Pa over a bridge")
    assert "Height over amplitude" in told and "7.00 ±" in told and "0.3300 ±" in told and f"written: {target}" in told
    preset = load_preset(str(target))
    assert preset.obstacle.distance_mm == pytest.approx(7.0, abs=0.01) and preset.pluck.position == 0.33
    assert preset.obstacle.jiva_um == pytest.approx(16.0, rel=0.03) and preset.pluck.displacement_mm == 6.0
    assert "# IA2018: the tanpura's two-point bridge" in target.read_text()
    assert picture.stat().st_size > 5000
    assert cli.main([*arguments[:-2], "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["obstacle"]["height"]["value"] == pytest.approx(8e-6 / 3e-3, rel=0.03)
    assert found["curves"]["bands"]["points"] and found["notes"][0]["loss"] < 0.2
