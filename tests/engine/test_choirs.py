"""Choirs: a key sounds one string of each, every one plucked where its table says."""

import numpy as np
import pytest

from synth.engine.engine import Engine
from synth.instrument.preset import Preset, parse_preset
from synth.midi.events import NOTE_OFF, NOTE_ON, make_events

RATE = 44100.0

HEAD = """
format = 2
name = "choirs"
[pluck]
displacement_mm = 2
position = 0.2
[damping]
release_s = 0.05
"""
STRING = """
[[string]]
length_m = 0.6
diameter_mm = 0.33
density_kg_m3 = 7850
youngs_modulus_gpa = 200
viscoelastic_loss = 4.5e-3
thermoelastic_q_inverse = 2e-4
"""
LOW = STRING + 'notes = "C3"\n'
BACK = STRING + 'notes = "C3-D3"\nchoir = 2\ncents = 3\npluck_position = 0.11\n'
HIGH = STRING.replace("0.6", "0.3") + 'notes = "C3"\nchoir = 3\ncents = 1200\n'


def preset(*strings: str) -> Preset:
    return parse_preset(HEAD + "".join(strings), "choirs.toml")


def engine(*strings: str) -> Engine:
    made = Engine([preset(*strings)], limiter=False)
    made.prepare(RATE)
    return made


def sound(playing: Engine, events: list[tuple], seconds: float = 0.4) -> np.ndarray:
    out = np.zeros((round(seconds * RATE), 2))
    playing.process(make_events(events), out)
    return out[:, 0]


C3 = [(0, NOTE_ON, 0, 48, 90)]


def test_a_key_sounds_what_its_strings_sound_one_by_one() -> None:
    together = sound(engine(LOW, BACK, HIGH), C3)
    alone = sum(sound(engine(string), C3) for string in (LOW, BACK, HIGH))
    assert np.abs(alone).max() > 0.01
    assert np.abs(together - alone).max() < 1e-9 * np.abs(alone).max()


def test_a_choir_without_the_note_stays_silent() -> None:
    d3 = [(0, NOTE_ON, 0, 50, 90)]
    whole = engine(LOW, BACK, HIGH)
    assert np.abs(sound(whole, d3) - sound(engine(BACK), d3)).max() < 1e-9
    assert whole.report().most_strings == 1
    sound(whole, [(0, NOTE_ON, 0, 60, 90)])
    assert [each.note for each in whole.report().unplayed] == [60]
    assert whole.notes_unplayed == 1


def test_strings_of_one_choir_take_turns() -> None:
    playing = engine(LOW, LOW)
    sound(playing, C3)
    assert playing.report().most_strings == 1


def test_all_choirs_are_damped_together() -> None:
    playing = engine(LOW, BACK, HIGH)
    x = sound(playing, [*C3, (8820, NOTE_OFF, 0, 48, 0)], 1.0)
    assert playing.report().most_strings == 3
    assert np.abs(x[22050:]).max() < 1e-3 * np.abs(x[:8820]).max()


@pytest.mark.parametrize("velocity", [20, 127])
def test_a_string_is_plucked_at_its_own_place(velocity: int) -> None:
    note = [(0, NOTE_ON, 0, 48, velocity)]
    own = sound(engine(STRING + 'notes = "C3"\npluck_position = 0.11\n'), note)
    moved = Engine([preset(LOW).with_setting("pluck.position", "0.11")], limiter=False)
    moved.prepare(RATE)
    assert np.array_equal(own, sound(moved, note))
    assert np.abs(own - sound(engine(LOW), note)).max() > 0.01
