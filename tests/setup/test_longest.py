"""The bridge that buzzes longest, from few heights of short notes."""

import pytest

from synth.instrument.preset import Preset, PresetError, load_preset
from synth.setup import longest
from synth.setup.longest import TriedBridge, with_neighbours


@pytest.fixture(autouse=True)
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(longest, "SECONDS", 1.0)
    monkeypatch.setattr(longest, "PARTS", (0.9, 1.0, 1.1))
    monkeypatch.setattr(longest, "JIVA_UM", (0.0, 20.0, 100.0))


@pytest.fixture(scope="module")
def tanpura() -> Preset:
    return load_preset("tanpura-light")


def test_a_thread_that_lifts_the_string_off_does_not_buzz(tanpura: Preset) -> None:
    (found,) = longest.longest(tanpura, 80, strings=["kharaj"], quality="draft", threads=2)
    assert found.best.seconds > 0.5
    assert found.best.jiva_um < 100.0 and found.near[0] <= found.best.jiva_um <= found.near[1] < 100.0
    clear = longest.with_bridge(tanpura, found.places[0].opened, 400.0, 1.0)
    (lifted,) = longest.longest(clear, 40, strings=["kharaj"], quality="draft", threads=2)
    assert lifted.now.jiva_um == 400.0 and lifted.now.seconds == 0.0


def test_strings_of_one_note_share_a_thread_and_the_others_keep_theirs(tanpura: Preset) -> None:
    (found,) = longest.longest(tanpura, 80, strings=["Sa 1", "Sa 2"], quality="draft", threads=2)
    assert [each.string for each in found.places] == ["Sa 1", "Sa 2"] and found.names == "Sa 1, Sa 2"
    edits = dict(longest.settings(tanpura, [found]))
    jiva = edits["obstacle.jiva_um"]
    if isinstance(jiva, dict):
        assert jiva["C3"] == found.best.jiva_um and jiva["C2"] == jiva["G2"] == 3.0
    else:
        assert jiva == found.best.jiva_um == 3.0
    changed = tanpura
    for path, value in edits.items():
        text = (
            "{ " + ", ".join(f"{note} = {each}" for note, each in value.items()) + " }" if isinstance(value, dict) else value
        )
        changed = changed.with_setting(path, str(text))
    assert changed.obstacle.points == tanpura.obstacle.points


def test_a_curved_bridge_is_given_another_radius() -> None:
    veena = load_preset("veena")
    place = longest.places_of(veena, None, {0})[0]
    other = longest.with_bridge(veena, place.opened, 5.0, 1.1)
    assert other.obstacle.radius_mm == pytest.approx(1.1 * veena.obstacle.radius_mm)
    assert other.obstacle.distance_mm == veena.obstacle.distance_mm


def test_each_height_counts_with_its_neighbours() -> None:
    tried = [TriedBridge(float(k), 1.0, seconds) for k, seconds in enumerate((1.0, 4.0, 1.0, 3.0, 3.0, 3.0))]
    assert with_neighbours(tried) == pytest.approx([2.5, 2.0, 8.0 / 3.0, 7.0 / 3.0, 3.0, 3.0])


def test_what_has_no_bridge_is_refused() -> None:
    with pytest.raises(PresetError, match="must be bridge for a long buzz, got frets"):
        longest.longest(load_preset("fretted-bass"), 80)
