"""A bass and a pulled string with every way to play them, and a phrase that goes through all of these."""

from __future__ import annotations

from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, PARAMETER, PROGRAM
from tests.engine.kit import NECK_OBSTACLE, preset, steel, wound

WAYS = """
[articulations.normal]
key = "C0"
[articulations.mute]
key = "D0"
controller = 20
velocity = [120, 127]
touch = { place = 0.05, resistance = 2.0 }
[articulations.flageolet]
key = "E0"
harmonic = true
touch = { place = 0.5, resistance = 2.0, lift_ms = 100 }
[articulations.strum]
key = "F0"
strum_ms = 12
[articulations.slide]
key = "G0"
slide_ms = 30
[articulations.slap]
key = "A0"
stroke = "throw"
speed_m_s = 2.0
"""
NORMAL, MUTE, FLAGEOLET, STRUM, SLIDE, SLAP = 12, 14, 16, 17, 19, 21
HAND = "[hand]\nvibrato_cents = 40\nvibrato_hz = 6\nplace_mm = 4\nlevel_db = 1\n"
#: E A D G with twelve frets, and every way to play them
HANDED = preset(
    "handed",
    wound("E1", 32.5) + wound("A1", 20.9) + wound("D2", 13.8) + wound("G2", 6.69),
    obstacle=NECK_OBSTACLE,
    output='kind = "pickup"\nposition = 0.165\ndistance_mm = 5\naperture_mm = 12\ngain_db = -18',
    polyphony=4,
    more=WAYS + HAND,
)
#: the same strings, which move along the frets, too, and whose tension rises with their motion
ACROSS = preset(
    "across",
    "".join(
        wound(*each) + "tension_modulation = true\n" for each in (("E1", 32.5), ("A1", 20.9), ("D2", 13.8), ("G2", 6.69))
    ),
    obstacle=NECK_OBSTACLE,
    output='kind = "pickup"\nposition = 0.165\ndistance_mm = 5\naperture_mm = 12\ngain_db = -18',
    polyphony=4,
    more=WAYS
    + HAND
    + """
[polarisation]
detuning_cents = 1.5
loss_ratio = 1.2
pluck_deg = 50
nut_share = 0.25
heard = 0.4
[[nut]]
frequency_hz = 190
q = 20
mass_kg = 2.5
""",
)
#: a string that is pulled, over frets that it does not reach
PULLED = preset(
    "pulled",
    steel("C3"),
    obstacle='kind = "frets"\ncount = 12\naction_12th_mm = 9.0\nnut_height_mm = 4.0',
    polyphony=1,
    more="[hand]\nmeend_semitones = 5\nmeend_ms = 50\nvibrato_cents = 50\nvibrato = 'up'\n",
)
LEGATO = (0, CONTROL, 0, 68, 127)


def key(frame: int, note: int, velocity: int = 100) -> tuple[int, int, int, int, int]:
    return frame, NOTE_ON, 0, note, velocity


def up(frame: int, note: int) -> tuple[int, int, int, int, int]:
    return frame, NOTE_OFF, 0, note, 0


#: every articulation on the way, with pedal, bend, wheel and parameters
BUSY = [
    key(100, 28),
    key(3000, MUTE),
    key(4000, 33),
    key(6000, FLAGEOLET),
    key(7000, 52),
    (8000, CONTROL, 0, 1, 127),
    key(9000, STRUM),
    *(key(10_000, note) for note in (43, 28, 38, 33)),
    *(up(14_000, note) for note in (43, 28, 38, 33)),
    *(key(15_000, note) for note in (33, 45, 40, 30)),
    (17_000, CONTROL, 0, 68, 127),
    key(18_000, SLIDE),
    key(19_000, 36),
    up(22_000, 36),
    (23_000, BEND, 0, 4000, 0),
    (24_000, CONTROL, 0, 20, 127),
    key(25_000, 47, 127),
    (26_000, PARAMETER, 0, 6, 0, 2.0),
    (27_000, CONTROL, 0, 20, 0),
    key(27_500, SLAP),
    key(28_000, 28, 120),
    (29_000, PROGRAM, 0, 3, 0),
    key(30_000, 45, 60),
    (31_000, CONTROL, 0, 123, 0),
]
#: pulls and what ends them
PULLS = [
    LEGATO,
    key(100, 49),
    key(8000, 53),
    up(16_000, 53),
    (18_000, CONTROL, 0, 1, 100),
    key(19_000, 51),
    key(28_000, 49),
    up(30_000, 49),
]
#: two strings that share a body and move in two directions, with the same ways
TOGETHER = preset(
    "together",
    wound("G2", 6.69) + wound("C3", 3.76) + "place_mm = 12\n",
    obstacle='kind = "frets"\ncount = 5\nheights_mm = [-0.7, -0.9, -1.1, -1.2, -1.3]',
    polyphony=2,
    output='kind = "body"\ngain_db = -40',
    more="""
[[body.mode]]
frequency_hz = 120
q = 20
mass_kg = 0.6
shape = [1.0, 0.1, 2.0]
[polarisation]
detuning_cents = 0.5
pluck_deg = 40
[hand]
vibrato_cents = 30
meend_semitones = 2
"""
    + WAYS,
)
#: strummed, shaken, pulled, slid, touched
WAYS_TOGETHER = [
    LEGATO,
    key(50, STRUM),
    key(100, 49),
    key(100, 44),
    (4000, CONTROL, 0, 1, 127),
    key(6000, 46),
    key(9000, SLIDE),
    key(9500, 48),
    up(14_000, 48),
    key(16_000, FLAGEOLET),
    key(16_500, 55),
    key(20_000, NORMAL),
    key(21_000, 50),
]
