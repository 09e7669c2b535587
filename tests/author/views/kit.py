"""Presets for the tests of the views: those of the program, and one of each kind of obstacle and table."""

from __future__ import annotations

from synth.instrument.preset import Preset, load_preset, parse_preset, preset_folder

#: a harp over points, with every table that may be left out
POINTS = """
format = 2
name = "points"
[tuning]
contact_cents = { C3 = 1.0, C4 = 0.5 }
[[string]]
notes = "C3-C4"
length_m = { C3 = 0.9, C4 = 0.5 }
diameter_mm = 0.4
density_kg_m3 = 7850
inharmonicity = 3e-5
measured_frequencies_hz = [131.0, 262.1]
measured_decay_rates = [0.5, 0.6]
[[nut]]
frequency_hz = 150.0
q = 1.0
mass_kg = 2.0
[obstacle]
kind = "points"
positions_mm = [100.0, 250.0]
heights_mm = [-0.5, -0.8]
[pluck]
position = 0.3
position_hard = 0.2
displacement_mm = { C3 = 2.0, C4 = 1.0 }
width_hard_mm = 5.0
[body]
direct_db = -3.0
[[body.resonance]]
frequency_hz = 200.0
q = 20.0
gain_db = -6.0
"""

#: a neck given by its action
ACTION = """
format = 2
name = "action"
[[string]]
name = "G"
notes = "G2"
length_m = 0.863
diameter_mm = 1.14
linear_density_g_m = 6.69
core_diameter_mm = 0.43
winding_diameter_mm = 0.355
youngs_modulus_gpa = 301
viscoelastic_loss = 0.01
thermoelastic_q_inverse = 6e-6
[obstacle]
kind = "frets"
count = 20
action_12th_mm = 2.2
relief_mm = 0.2
nut_height_mm = 0.5
[pluck]
displacement_mm = 3.0
[hand]
place_mm = 3.0
release = { place = 0.3, resistance = 2.0, stiffness_n_mm = 0.1 }
[articulations.normal]
key = "C0"
[articulations.mute]
key = "D0"
touch = { place = 0.05, resistance = 1.0 }
"""

#: a neck as a luthier measures it, under two strings
MEASURED_NECK = """
format = 2
name = "measured-neck"
[[string]]
notes = "D2"
length_m = 0.863
diameter_mm = 1.65
linear_density_g_m = 13.8
core_diameter_mm = 0.46
winding_diameter_mm = 0.595
youngs_modulus_gpa = 301
[[string]]
notes = "G2"
length_m = 0.863
diameter_mm = 1.14
linear_density_g_m = 6.69
inharmonicity = 3.5e-5
[setup]
action_bass_mm = 2.4
action_treble_mm = 2.0
relief_mm = 0.2
nut_bass_mm = 0.5
fall_away_mm = 0.1
fall_away_fret = 14
board_radius_mm = 305
nut_spread_mm = 12
saddle_spread_mm = 19
[obstacle]
kind = "frets"
count = 36
[pluck]
displacement_mm = 3.0
"""

FREE = """
format = 2
name = "free"
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

TEXTS = {"points": POINTS, "action": ACTION, "measured-neck": MEASURED_NECK, "free": FREE} | {
    name: (preset_folder() / f"{name}.toml").read_text(encoding="utf-8")
    for name in ("fretless-bass", "fretted-bass", "jawari-harp", "shamisen", "steel-guitar", "tanpura-light")
}


def preset(name: str) -> Preset:
    """One of TEXTS."""
    return parse_preset(TEXTS[name], name)


def tanpura(jiva_um: float = 3.0) -> Preset:
    return load_preset("tanpura-light").with_setting("obstacle.jiva_um", str(jiva_um))


#: for strings that share a bridge
SHARED_MODES = "".join(
    f"[[body.mode]]\nfrequency_hz = {hz}\nq = 25\nmass_kg = 0.5\nshape = {shape}\n"
    for hz, shape in ((110, [1.0, 0.1, 2.0]), (230, [0.8, -0.2, -3.0]), (510, [1.0, 0.3, 5.0]), (19900, [1.0]))
)
STRING_ON_A_BRIDGE = """
[[string]]
name = "{name}"
notes = "{note}"
length_m = 0.9
diameter_mm = 0.4
density_kg_m3 = 7850
youngs_modulus_gpa = 200
viscoelastic_loss = 4.5e-3
place_mm = {place}
"""


def together(more: str = "", obstacle: str = "") -> Preset:
    """Two strings in unison and a third below them."""
    strings = "".join(
        STRING_ON_A_BRIDGE.format(name=name, note=note, place=place)
        for name, note, place in (("a", "C3", -8), ("b", "C3", 0), ("c", "G2", 8))
    )
    rest = '\n[pluck]\ndisplacement_mm = 2.0\n[damping]\nring_on = true\n[output]\nkind = "body"\ngain_db = -30\n'
    return parse_preset('format = 2\nname = "three"\n' + strings + obstacle + rest + more + SHARED_MODES, "three")


ROLLED_ON = '\n[obstacle]\nkind = "bridge"\ndistance_mm = 6.0\njiva_um = 0.0\n'
LOW_NECK = '\n[obstacle]\nkind = "frets"\ncount = 12\naction_12th_mm = 0.7\nnut_height_mm = 0.15\n'
TWO_WAYS = "\n[polarisation]\ndetuning_cents = 1.0\npluck_deg = 35\n"
