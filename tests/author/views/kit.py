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

TEXTS = {"points": POINTS, "action": ACTION, "free": FREE} | {
    path.stem: path.read_text(encoding="utf-8") for path in sorted(preset_folder().glob("*.toml"))
}


def preset(name: str) -> Preset:
    """One of TEXTS."""
    return parse_preset(TEXTS[name], name)


def tanpura(jiva_um: float = 3.0) -> Preset:
    return load_preset("tanpura").with_setting("obstacle.jiva_um", str(jiva_um))
