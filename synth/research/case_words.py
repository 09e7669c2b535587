"""What the keys of a case mean, with their units: the words of the reference and of whoever asks for a key.

Ranges and defaults are the schema's (`case`, `coupled.coupled_case`).
"""

from __future__ import annotations

from typing import NamedTuple

from synth.instrument.table import Table
from synth.research import case
from synth.research.coupled import coupled_case


class Meaning(NamedTuple):
    """text: a sentence; unit: "" for a bare number, a text or a choice."""

    text: str
    unit: str = ""


_START = Meaning("When it begins.", "s")
_RUN = {
    "internal_rate_hz": Meaning("Steps of the model per second.", "Hz"),
    "output_rate_hz": Meaning(
        "Rows of the result per second: plain samples. It divides the internal rate; left out: the same.", "Hz"
    ),
    "modes": Meaning("How many modes of the string are computed."),
    "duration_s": Meaning("How long the run is.", "s"),
    "ledger": Meaning("Whether every step is weighed: where the energy is and goes. About three times slower."),
}
_STRING = {
    "length_m": Meaning("Length between its ends.", "m"),
    "tension_n": Meaning("Tension at rest, which gives the pitch.", "N"),
    "linear_density_kg_m": Meaning("Mass per length.", "kg/m"),
    "diameter_m": Meaning("Outer diameter, at which the air rubs.", "m"),
    "inharmonicity": Meaning(
        "B: mode j lies at j·f·√(1 + Bj²). Instead of bending_stiffness_n_m2; neither: an ideal string."
    ),
    "bending_stiffness_n_m2": Meaning("EI, in the place of inharmonicity.", "N m²"),
    "core_diameter_m": Meaning("Of a wound string: diameter of the core that bends.", "m"),
    "winding_diameter_m": Meaning("Of a wound string: diameter of the wire around it.", "m"),
    "viscoelastic_loss": Meaning("δ_ve, loss angle of the material as it bends."),
    "thermoelastic_q_inverse": Meaning("Q_te⁻¹, heat flowing in the metal."),
    "air_viscosity": Meaning("Dynamic viscosity of the air; 0: no air.", "kg/(m s)"),
    "air_density": Meaning("Density of the air.", "kg/m³"),
    "stiffness_law": Meaning('How modes stretch: "sqrt" is √(1 + Bj²), "linear" 1 + Bj²/2, as some published data have it.'),
    "nut": Meaning("Resonances of what holds the end x = 0, any number."),
    "measured": Meaning("Measured frequencies and decay rates of the first modes, from a file."),
}
_OBSTACLE = {
    "positions_m": Meaning("Points that the string may touch, from the nut.", "m"),
    "heights_m": Meaning("Their heights above the string at rest (below 0: under it); one for all, or one each.", "m"),
    "frets": Meaning("A neck's frets, in the place of points."),
    "layer": Meaning("What is soft on every point or fret, whose heights are those of its surface."),
    "motion": Meaning("Moves all points or frets while the run goes on."),
    "wall": Meaning("Contact all along a stretch, in the place of points."),
}
_FINGER = {
    "position_m": Meaning("Where it holds the string, from the nut.", "m"),
    "displacement_m": Meaning("Where it has drawn the string to at release.", "m"),
    "width_m": Meaning("Base of its triangular weighting.", "m"),
    "start_s": _START,
    "draw_s": Meaning("Time of the way there, a raised cosine from where the string is.", "s"),
    "hold_s": Meaning("How long it stays before it lets go.", "s"),
    "slip_s": Meaning(
        "Time in which the string then slides off: the finger's force fades as half a cosine; 0: let go at once.", "s"
    ),
    "stiffness_n_m": Meaning("Spring between finger and string.", "N/m"),
    "resistance_n_s_m": Meaning("Dashpot between finger and string.", "N s/m"),
}
_INITIAL = {
    "position_m": Meaning("Corner of the triangle, or place of the force, from the nut.", "m"),
    "displacement_m": Meaning("Height of the triangle's corner before it is rounded.", "m"),
    "width_m": Meaning("Base of the triangular kernel that rounds the corner.", "m"),
}
_DIRECTION = Meaning("Direction from that of the string; others than 0 move the second direction.", "°")

MEANINGS: dict[type[Table], dict[str, Meaning]] = {
    case.Case: {
        "string": Meaning("The string: what it is made of and how it is tuned."),
        "obstacle": Meaning("What lies under it; left out: nothing."),
        "initial": Meaning("How it starts; left out: at rest."),
        "finger": Meaning("Fingers that take hold of it, draw it and let go, one after the other."),
        "bend": Meaning("Changes of its tension; what they give adds up and stays."),
        "scheme": Meaning("How contacts are computed."),
        "run": Meaning("Rates, modes and length of the run, and where it is looked at."),
    },
    case.NutTable: {
        "frequency_hz": Meaning("Where the nut end swings by itself.", "Hz"),
        "q": Meaning("How narrow the resonance is."),
        "mass_kg": Meaning("Its moving mass: the lighter, the more it takes.", "kg"),
    },
    case.MeasuredTable: {
        "file": Meaning("An .npz file beside the case."),
        "frequencies": Meaning("Its array of frequencies in Hz, of modes 1 to m; the model goes on behind them."),
        "decay_rates": Meaning("Its array of decay rates in 1/s."),
    },
    case.StringTable: _STRING,
    case.FretsTable: {
        "scale_length_m": Meaning("Length by which the frets are placed, in equal temperament.", "m"),
        "count": Meaning("How many frets, at least 12."),
        "action_12th_m": Meaning("Gap between string and fret 12.", "m"),
        "relief_m": Meaning("Hollow of the neck half way.", "m"),
        "nut_height_m": Meaning("Gap between string and fret 1.", "m"),
    },
    case.RampTable: {
        "start_s": _START,
        "duration_s": Meaning("How long it takes.", "s"),
        "displacement_m": Meaning("How far it goes, on a raised cosine; there it stays.", "m"),
    },
    case.SineTable: {
        "start_s": _START,
        "frequency_hz": Meaning("How often it swings.", "Hz"),
        "amplitude_m": Meaning("How far, to either side.", "m"),
    },
    case.MotionTable: {
        "ramp": Meaning("Ways from one height to another, any number; all that moves adds up."),
        "sine": Meaning("Swings, any number."),
    },
    case.ParabolaTable: {
        "top_m": Meaning("Where its top is, from the nut.", "m"),
        "height_m": Meaning("Height of the top above the string at rest.", "m"),
        "radius_m": Meaning("Radius of its curve at the top.", "m"),
    },
    case.WallTable: {
        "from_m": Meaning("Where it begins, from the nut.", "m"),
        "to_m": Meaning("Where it ends.", "m"),
        "nodes": Meaning("Cut into so many points; without it and spacing_m the modal grid, for scheme wall."),
        "spacing_m": Meaning("Cut into points so far apart.", "m"),
        "height_m": Meaning("A flat wall at this height; or neck, or parabola.", "m"),
        "neck": Meaning('Shape of a neck: "bass", that of the paper without its frets.'),
        "parabola": Meaning("A curved bridge."),
        "stiffness_n_m2": Meaning(
            'Force per metre of string for each metre pressed in, or "rigid"; of scheme wall.', "N/m²"
        ),
    },
    case.LayerTable: {
        "stiffness_n_m": Meaning("Its spring.", "N/m"),
        "resistance_n_s_m": Meaning("Its dashpot.", "N s/m"),
        "thickness_m": Meaning("How deep the string may go into it until it is rigid.", "m"),
    },
    case.ObstacleTable: _OBSTACLE,
    case.InitialTable: {
        "shape": Meaning('"triangle" (drawn aside), "modes" (given amplitudes) or "rest".'),
        **_INITIAL,
        "rounding_half_width_m": Meaning(
            "The corner becomes a parabola over position ± this; or width_m; or neither: sharp.", "m"
        ),
        "file": Meaning("An .npz file beside the case, of shape modes."),
        "q": Meaning("Modal amplitudes of modes 1 to m, zero behind: numbers, or their key in the file.", "m·√m"),
        "v": Meaning("Modal velocities, the same way.", "m·√m/s"),
    },
    case.FingerTable: _FINGER,
    case.BendTable: {
        "start_s": _START,
        "duration_s": Meaning("How long it takes, on a raised cosine.", "s"),
        "cents": Meaning("How far the first mode goes.", "cents"),
    },
    case.SchemeTable: {
        "name": Meaning("exact-hold, another scheme of the table below, or an installed contact law."),
        "restitution": Meaning("Of the Moreau–Jean schemes and of walls: what a contact keeps of a blow's speed."),
        "residual_compliance": Meaning('false: what tail = "none" says.'),
        "tail": Meaning(
            "Exact-hold: what stands for the modes left out. Left out: lumped, or static with a bend or many contacts."
        ),
        "substeps": Meaning("Exact-hold: the contact force changes so many times in a step."),
        "start": Meaning('Moreau–Jean: first step by the exact propagator ("exact"), or as printed ("published").'),
        "stiffness": Meaning("Compliant contacts: K of f = K [η − u]₊^α at a point; left out: 1e10.", "N/m^α"),
        "exponent": Meaning("Compliant contacts: α; left out: 1.5."),
        "loss": Meaning("Compliant contacts: Hunt–Crossley loss; left out: 0.", "s/m"),
        "tolerance": Meaning("Compliant: Newton's last step relative to the depths; left out: 1e-12."),
        "iterations": Meaning("Compliant: Newton's iterations at most; left out: 50."),
        "grid": Meaning('Compliant: "contacts" alone (also when left out), or "full", all inner nodes, as first published.'),
        "drift_correction": Meaning("Scalar auxiliary variable: part of the drift taken back in a step; left out: 0."),
    },
    case.RunTable: {**_RUN, "outputs_m": Meaning("Points whose displacement is wanted, from the nut.", "m")},
    coupled_case.CoupledCase: {
        "string": Meaning("The strings, one table each."),
        "body": Meaning("The body that they share: [[body.mode]], as in presets."),
        "scheme": Meaning("How contacts are computed."),
        "run": Meaning("Rates, modes and length of the run."),
    },
    coupled_case.PolarisationTable: {
        "detuning_cents": Meaning("How much higher the motion at right angles is tuned.", "cents"),
        "loss_ratio": Meaning("How much faster it decays.", "×"),
    },
    coupled_case.LineObstacleTable: {**_OBSTACLE, "rides": Meaning("Whether it stands on the bridge and moves with it.")},
    coupled_case.CoupledInitialTable: {
        "shape": Meaning('"rest", "triangle", or "drawn": the state at rest under a force, the body with it.'),
        **_INITIAL,
        "force_n": Meaning("Force of shape drawn.", "N"),
        "direction_deg": _DIRECTION,
    },
    coupled_case.DirectedFingerTable: {**_FINGER, "direction_deg": _DIRECTION},
    coupled_case.FretTable: {
        "start_s": Meaning("From when on the string is stopped there.", "s"),
        "position_m": Meaning("Place of the fret from the far end of the open string; 0: open.", "m"),
        "height_m": Meaning("Where the fret is; the stopped end goes there.", "m"),
        "ramp_s": Meaning("Time in which it goes there.", "s"),
    },
    coupled_case.CoupledStringTable: {
        **_STRING,
        "name": Meaning("What it is called; left out: its number."),
        "place_mm": Meaning("Where on the bridge it ends, from its middle.", "mm"),
        "angle_deg": Meaning("Which way it moves there, from the normal of the body.", "°"),
        "outputs_m": Meaning("Points of it whose displacement is wanted, from the far end.", "m"),
        "modes": Meaning("How many of its modes; left out: run.modes."),
        "substeps": Meaning("Of this string; left out: scheme.substeps."),
        "polarisation": Meaning("It moves at right angles to its first direction, too."),
        "obstacle": Meaning("What lies under it: points or frets."),
        "initial": Meaning("How it starts; left out: at rest."),
        "finger": Meaning("Fingers that take hold of it, draw it and let go."),
        "bend": Meaning("Changes of its tension."),
        "fret": Meaning("Stops it elsewhere, any number, one after the other."),
    },
    coupled_case.CoupledSchemeTable: {
        "name": Meaning('"exact-hold", or "complex-modes": exact, where nothing touches and no hand acts.'),
        "tail": Meaning("What stands for the modes left out at contacts."),
        "substeps": Meaning("Contact forces change so many times in a step of the bridge."),
    },
    coupled_case.CoupledRunTable: _RUN,
}
