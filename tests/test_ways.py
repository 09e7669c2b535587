"""What is said of a preset's articulations, and the options about what varies."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from synth import cli
from synth.instrument.articulations import Articulation, Hand, Touch
from synth.instrument.preset import parse_preset
from synth.instrument.ways import keys_that_switch, switch_keys, ways

PLAIN = """
format = 2
name = "plain"
[[string]]
notes = "C3"
length_m = 0.9
diameter_mm = 0.4
density_kg_m3 = 7850
youngs_modulus_gpa = 200
viscoelastic_loss = 4.5e-3
[pluck]
displacement_mm = 2.0
"""
HANDED = (
    PLAIN
    + """
[articulations.normal]
key = "D0"
[articulations.palm-mute]
key = "C0"
controller = { number = 20, low = 10 }
velocity = [110, 127]
touch = { place = 0.05, resistance = 2.0 }
[articulations.strum]
strum_ms = 12
[hand]
level_db = 2.0
place_mm = 20.0
vibrato_cents = 30
meend_semitones = 4
"""
)


def test_a_line_for_every_way() -> None:
    preset = parse_preset(HANDED, "handed")
    assert ways(preset) == [
        "normal     D0",
        "palm-mute  C0  controller 20 at 10-127, velocity 110-127  damped by a touch",
        "strum                                                     strummed, 12 ms a string",
        "vibrato        controller 1                               30 cents at 5.5 Hz",
        "meend          legato (controller 68)                     pulls the string by up to 4 semitones",
    ]
    assert ways(parse_preset(PLAIN, "plain")) == []
    assert switch_keys(preset) == {12: "palm-mute", 14: "normal"} and list(switch_keys(preset)) == [12, 14]


def test_a_key_that_is_a_note_of_another_preset_is_no_switch_alone() -> None:
    other = parse_preset(PLAIN.replace('"C3"', '"C0"'), "low")
    assert keys_that_switch([parse_preset(HANDED, "handed"), other]) == {14: "normal"}


def test_show_prints_the_file_and_beside_it_the_ways(tmp_path, capsysbinary) -> None:
    path = tmp_path / "handed.toml"
    path.write_text(HANDED)
    assert cli.main(["presets", "show", str(path)]) == 0
    out, err = capsysbinary.readouterr()
    assert out == HANDED.encode() and b"palm-mute  C0" in err


@pytest.fixture
def song(tmp_path) -> str:
    import mido

    track = mido.MidiTrack()
    for _ in range(3):
        track += [mido.Message("note_on", note=48, velocity=80), mido.Message("note_off", note=48, time=240)]
    file = mido.MidiFile(tracks=[track])
    file.save(tmp_path / "song.mid")
    (tmp_path / "handed.toml").write_text(HANDED)
    return str(tmp_path / "song.mid")


def test_seeds_and_variation(song, tmp_path, capsys) -> None:
    def rendered(*options: str) -> tuple[np.ndarray, dict]:
        where = str(tmp_path / "x.wav")
        more = ["-p", str(tmp_path / "handed.toml"), "--bit-depth", "float", "--tail", "0", "--json", "-o", where, *options]
        assert cli.main(["render", song, *more]) == 0
        return soundfile.read(where)[0], json.loads(capsys.readouterr().out)

    first, report = rendered("--seed", "5")
    assert report["seed"] == 5
    assert np.array_equal(first, rendered("--seed", "5")[0])
    assert not np.array_equal(first, rendered("--seed", "6")[0])
    steady = rendered("--seed", "5", "--variation", "0")[0]
    assert not np.array_equal(first, steady) and np.array_equal(steady, rendered("--seed", "6", "--variation", "0")[0])
    assert np.array_equal(first, rendered("--seed", "5", "--variation", "1")[0])


def test_the_example_of_the_documentation_is_in_order() -> None:
    page = (Path(__file__).resolve().parents[1] / "docs" / "articulations.md").read_text(encoding="utf-8")
    example = page.split("```toml\n")[1].split("```")[0]
    preset = parse_preset(PLAIN + example, "example")
    assert len(ways(preset)) == 7 and set(switch_keys(preset).values()) == {"normal", "mute", "flageolet", "strum", "slide"}
    fields = set(Articulation.model_fields) | set(Hand.model_fields) | set(Touch.model_fields)
    assert [field for field in sorted(fields) if f"`{field}`" not in page and f"{field} =" not in page] == []
