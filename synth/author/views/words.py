"""The words of the controls: label, unit, usual range and the physics of every field of a preset.

Ranges and defaults are the schema's (`parameters`); here stands what the schema cannot know. Keys are the schema's class and
field.
"""

from __future__ import annotations

from dataclasses import dataclass

from synth.instrument.articulations import Hand, Knock, Touch
from synth.instrument.preset import (
    BoardObstacle,
    Body,
    BodyMode,
    BridgeObstacle,
    Damping,
    FretsObstacle,
    Layer,
    Mapping_,
    MovingMode,
    NoObstacle,
    NutMode,
    Output,
    Pluck,
    PointsObstacle,
    Polarisation,
    Preset,
    Setup,
    StringTable,
    Table,
    Tuning,
)


@dataclass(frozen=True)
class Words:
    """label and tip, in English; unit, "" for a bare number; usual: (low, high) of real instruments; step: what exact entry
    counts in; live: heard without a new pluck, or at the next one without compiling anew; travel: (low, high) of a slider
    that goes further than what is usual, since the tip speaks of it; setup: a part of the instrument's setup, which stands
    first."""

    label: str
    tip: str
    unit: str = ""
    usual: tuple[float, float] | None = None
    step: float | None = None
    live: bool = False
    travel: tuple[float, float] | None = None
    setup: bool = False


#: group of what is setup, wherever in the file it stands
SETUP = "setup"
#: group of a table of the file
GROUPS = {
    "name": "about",
    "title": "about",
    "description": "about",
    "family": "about",
    "tags": "about",
    "sources": "about",
    "remarks": "about",
    "tuning": "string",
    "string": "string",
    "nut": "string",
    "setup": "obstacle",
    "obstacle": "obstacle",
    "pluck": "pluck",
    "damping": "damping",
    "output": "output",
    "body": "output",
    "polarisation": "pluck",
    "hand": "pluck",
    "mapping": "mapping",
}

_FRICTION = Words(
    "Friction",
    "Coefficient of friction between string and obstacle, for strings that move in two directions; 0 is "
    "none. It damps the second direction while the first one buzzes.",
    "",
    (0.0, 0.6),
    0.01,
)
_LAYER = Words(
    "Soft layer",
    "Thread, felt or skin over every contact point, on top of the rigid surface. Add it in the file, as obstacle.layer.",
)
_OBSTACLE_KIND = Words(
    "What the string touches",
    "Nothing, the thread and edge of a tanpura's bridge, single points, the frets of a neck or a fretless "
    "board. Contact makes the buzz, the slap and the rattle.",
    setup=True,
)

#: a field of modes in place of one
_FIELD = {
    "to_hz": Words(
        "Field of modes up to",
        "One entry stands for many modes from its frequency up to this one, irregularly spaced and each in another "
        "way, as a structure has them where they are not known one by one.",
        "Hz",
        (200.0, 12000.0),
        10.0,
    ),
    "spacing_hz": Words(
        "Mean spacing", "How far neighbouring modes of the field are apart in the mean.", "Hz", (10.0, 400.0), 1.0
    ),
    "seed": Words("Which field", "Another seed gives another structure of the same kind.", "", (0, 100), 1),
}
WORDS: dict[type[Table], dict[str, Words]] = {
    Preset: {
        "name": Words("Name", "The name that commands use: up to 64 lower-case letters, digits and hyphens."),
        "title": Words("Title", "The title shown in lists."),
        "description": Words(
            "Description", "The instrument in one sentence: its strings, its tuning and what gives it its sound."
        ),
        "family": Words(
            "Family",
            "The kind of instrument, in one lower-case word: bass, guitar, sitar, tanpura, harp, keyboard. Lists "
            "are grouped by family.",
        ),
        "tags": Words("Tags", "Lower-case search words such as wound, bright or finger, one per line."),
        "sources": Words("Sources", "Where the numbers come from: papers, measurements, makers' data, one per line."),
        "remarks": Words("Remarks", "The author's notes: what was tried, what is still to do. The program ignores them."),
        "string": Words("Strings", "One table for each string, or one for a range of notes with a string for every note."),
        "polarisation": Words(
            "Second direction",
            "Strings can also move at right angles to their first direction, where no obstacle stops them.",
        ),
        "nut": Words(
            "Resonances of the nut end",
            "The neck, or whatever holds the nut end, yields at its resonances. A narrow resonance absorbs the "
            "energy of nearby notes (a dead spot); a broad one shortens all notes.",
        ),
    },
    Tuning: {
        "a4_hz": Words("Concert pitch", "Frequency of A4; all strings follow.", "Hz", (415.0, 466.0), 0.1),
        "offset_cents": Words("Tuning", "Tunes all strings up or down, by their tension.", "cents", (-100.0, 100.0), 1.0),
        "contact_cents": Words(
            "Contact correction",
            "A string that rests on its bridge for part of every period has a shorter speaking length and sounds "
            "a few cents sharp. Its tension is lowered by this much, by note; tools/tune-presets measures it.",
            "cents",
            (0.0, 5.0),
            0.01,
        ),
        "sympathetic_cents": Words(
            "Correction of sympathetic strings",
            "The same correction for sympathetic strings, by note; tools/tune-presets measures it.",
            "cents",
            (-5.0, 5.0),
            0.01,
        ),
    },
    NutMode: {
        "frequency_hz": Words(
            "Resonance",
            "Frequency of the resonance. A note there is short and shifted in pitch.",
            "Hz",
            (40.0, 1000.0),
            1.0,
        ),
        "q": Words(
            "Q",
            "Sharpness of the resonance: a high Q affects one note, a Q below 1 damps the whole range evenly.",
            "",
            (0.4, 60.0),
            0.1,
        ),
        "mass_kg": Words(
            "Moving mass",
            "Mass that the string has to move: the lighter it is, the more energy it takes from the note.",
            "kg",
            (0.05, 10.0),
            0.01,
        ),
        **_FIELD,
    },
    StringTable: {
        "name": Words("Name", "The string's name among players: Pa, Sa, E, G."),
        "notes": Words("Notes", "The open string's note (G2), or a range with a string for every note in it (E1-C7)."),
        "length_m": Words(
            "Length",
            "Speaking length between nut and saddle. At the same pitch tension grows with its square: a long string is "
            "tight and nearly harmonic, a short one slack and stiff.",
            "m",
            (0.1, 1.4),
            0.001,
        ),
        "diameter_mm": Words(
            "Diameter",
            "Outer diameter. A thicker plain string is heavier and much stiffer (fourth power): its partials are "
            "sharper and its brightness fades sooner. Air damping depends on it too.",
            "mm",
            (0.2, 2.6),
            0.001,
        ),
        "linear_density_g_m": Words(
            "Mass per length",
            "For a wound string, from the maker's data. A heavier string has more tension at the same pitch: it "
            "is louder, and takes more force to displace.",
            "g/m",
            (0.3, 35.0),
            0.01,
        ),
        "density_kg_m3": Words(
            "Density",
            "Density of a plain string's material: steel 7850, bronze 8800, brass 8500, nylon 1070, gut 1300.",
            "kg/m³",
            (1000.0, 9000.0),
            10.0,
        ),
        "core_diameter_mm": Words(
            "Core",
            "Diameter of a wound string's core, which alone resists bending; the winding adds mass but hardly any "
            "stiffness.",
            "mm",
            (0.2, 0.7),
            0.001,
        ),
        "winding_diameter_mm": Words(
            "Winding wire",
            "Diameter of the wire around the core. A winding has more air friction than a plain string.",
            "mm",
            (0.1, 1.0),
            0.001,
        ),
        "youngs_modulus_gpa": Words(
            "Young's modulus",
            "Stiffness of the core's material: steel 200, bronze 110, nylon 3, gut 6. It stretches the partials upwards; "
            "on a bridge, the stiffer the string, the lower the formant of its buzz.",
            "GPa",
            (1.0, 300.0),
            1.0,
        ),
        "inharmonicity": Words(
            "Inharmonicity B",
            "Partial j lies at j·f·√(1 + Bj²). 0 is a perfectly limp string; 10⁻⁵ to 10⁻⁴ are guitars and basses, "
            "10⁻³ a piano's treble.",
            "",
            (1e-6, 1e-3),
            1e-7,
        ),
        "viscoelastic_loss": Words(
            "Inner friction",
            "Loss angle of the material as it bends. It damps the high partials first, and more so on a stiffer "
            "string: steel 0.005, wound 0.01, nylon and gut several times that.",
            "",
            (0.001, 0.1),
            0.0001,
        ),
        "thermoelastic_q_inverse": Words(
            "Heat loss",
            "1/Q of the heat flow within the metal; it limits all partials to the same number of periods. 0.0002 "
            "is plain steel, 0.000006 a wound bass string.",
            "",
            (0.0, 0.001),
            1e-6,
        ),
        "stiffness_law": Words(
            "Law of stiffness",
            "How partials stretch: sqrt is the exact law of a pinned stiff string; linear (1 + Bj²/2) is that of "
            "some published data. They differ in the high partials only.",
        ),
        "unevenness_cents": Words(
            "Unevenness",
            "How far partials lie off the law of the stiff string, as mass is uneven along it: plain steel 0.5, wound or "
            "gut 1 to 2, a false string 4. The first partial stays in tune.",
            "cents",
            (0.0, 5.0),
            0.1,
        ),
        "tension_modulation": Words(
            "Tension follows the motion",
            "Plucked hard, the string begins sharp and glides down to its pitch, as real strings do by a few cents.",
        ),
        "axial_stiffness_n": Words(
            "Axial stiffness",
            "Resistance to stretching: Young's modulus times the cross-section that bears the tension; less if "
            "the string also stretches behind nut and saddle. 30 000 is plain steel of 0.43 mm.",
            "N",
            (500.0, 100000.0),
            100.0,
        ),
        "cents": Words("Fine tuning", "Tunes this string alone, by its tension.", "cents", (-50.0, 50.0), 0.1),
        "sounds": Words(
            "Sounds",
            "The note that the string sounds, if a different key plays it: this keeps drone strings out of the "
            "way of a melody that passes through their pitch.",
            "",
            (24.0, 84.0),
            1.0,
        ),
        "sympathetic": Words(
            "Sympathetic",
            "No key plays this string: it rings with the others through the bridge they share, like a sitar's tarafs.",
        ),
        "frets": Words("Frets", "Number of the neck's frets under this string, counted from the nut.", "", (0.0, 24.0), 1.0),
        "bridge_points": Words(
            "Points of the bridge",
            "Number of the bridge's points under this string, counted from the saddle.",
            "",
            (0.0, 8.0),
            1.0,
        ),
        "gain_db": Words("Level", "Level of this string in the mix; its motion does not change.", "dB", (-12.0, 12.0), 0.1),
        "pan": Words("Heard from", "Where this string stands between left (−1) and right (1).", "", (-1.0, 1.0), 0.05),
        "choir": Words(
            "Choir",
            "A key sounds one string of every choir that has its note, like the two or three choirs of a harpsichord.",
            "",
            (1.0, 4.0),
            1.0,
        ),
        "pluck_position": Words(
            "Where it is plucked",
            "For this string alone: distance from the saddle as a share of its length. If it is not given, the "
            "pluck's position applies.",
            "of L",
            (0.02, 0.5),
            0.01,
        ),
        "place_mm": Words(
            "Place on the bridge",
            "Distance from the middle of the bridge, for strings that share a body. It matters where the body rocks.",
            "mm",
            (-40.0, 40.0),
            0.5,
        ),
        "angle_deg": Words(
            "Direction at the bridge",
            "Angle between the string's first direction and the body's normal, for strings that share a body.",
            "°",
            (-45.0, 45.0),
            1.0,
        ),
        "measured_frequencies_hz": Words(
            "Measured partials",
            "Frequencies of partials 1, 2, … as measured on a real string; they move with its tuning. Above the "
            "last one the model continues.",
            "Hz",
        ),
        "measured_decay_rates": Words(
            "Measured decay rates",
            "Decay rates σ of partials 1, 2, … as measured (amplitude e^(−σt), T60 = 6.91/σ). Above the last one "
            "the model continues.",
            "1/s",
        ),
    },
    NoObstacle: {"kind": _OBSTACLE_KIND},
    Layer: {
        "stiffness_n_mm": Words(
            "Layer: stiffness",
            "Stiffness of the thread, felt or skin over every contact point. The softer it is, the rounder the buzz.",
            "N/mm",
            (1.0, 1000.0),
            0.1,
        ),
        "resistance_n_s_m": Words(
            "Layer: resistance",
            "Loss in the layer as it is pressed and released. The higher it is, the duller the buzz and the sooner it ends.",
            "N s/m",
            (0.0, 10.0),
            0.01,
        ),
        "thickness_um": Words(
            "Layer: thickness",
            "How far the string can press into the layer before it meets the rigid surface. The obstacle's "
            "heights are those of the layer's surface.",
            "µm",
            (5.0, 1000.0),
            1.0,
        ),
    },
    BridgeObstacle: {
        "kind": _OBSTACLE_KIND,
        "friction": _FRICTION,
        "layer": _LAYER,
        "distance_mm": Words(
            "Thread to edge",
            "Distance from the thread, where the string ends, to the bridge's edge of contact. The longer it is, "
            "the higher the buzz's formant begins and the further it sinks.",
            "mm",
            (2.0, 20.0),
            0.1,
            setup=True,
        ),
        "distance_ratio": Words(
            "Thread to edge, of the length",
            "The same distance as a share of the open string, so that the bridge scales with the string's length.",
            "of L",
            (0.002, 0.03),
            0.0001,
            setup=True,
        ),
        "jiva_um": Words(
            "Thread (jiva)",
            "How high the thread lifts the string off the bridge. At 0 the string rests on it and buzzes most; at "
            "a few µm the contact opens and closes every period; above 20 only hard plucks touch; below 0 the "
            "string is pressed down and the buzz dies.",
            "µm",
            (0.0, 30.0),
            0.5,
            live=True,
            travel=(-100.0, 1000.0),
            setup=True,
        ),
        "points": Words(
            "Points",
            "Number of contact points, evenly spaced from the string's end to the edge of contact: one makes a "
            "thread and an edge, several the arc of a curved bridge.",
            "",
            (1.0, 12.0),
            1.0,
            setup=True,
        ),
        "radius_mm": Words(
            "Radius of the bridge",
            "Radius of a bridge with several points: the larger it is, the flatter the bridge, and the more the "
            "string wraps and buzzes.",
            "mm",
            (200.0, 5000.0),
            10.0,
            setup=True,
        ),
        "frets": Words(
            "Frets",
            "Semitones at which a neck before the bridge stops strings; between them its frets are out of reach.",
            "",
            (0.0, 24.0),
            1.0,
            setup=True,
        ),
    },
    PointsObstacle: {
        "kind": _OBSTACLE_KIND,
        "friction": _FRICTION,
        "layer": _LAYER,
        "positions_mm": Words(
            "Places",
            "Positions of the contact points from the nut, in rising order; each needs a height.",
            "mm",
            setup=True,
        ),
        "heights_mm": Words(
            "Heights",
            "Heights of the points relative to the string at rest: −1 is a millimetre below it, 0 just touches.",
            "mm",
            setup=True,
        ),
    },
    BoardObstacle: {
        "kind": _OBSTACLE_KIND,
        "semitones": Words(
            "Semitones",
            "Highest note of every string, in semitones above its open note.",
            "",
            (12.0, 30.0),
            1.0,
            setup=True,
        ),
        "length_mm": Words(
            "Board ends at",
            "Distance from the nut. Fingers reach no further; a string plucked over the board strikes it more.",
            "mm",
            (500.0, 750.0),
            1.0,
            setup=True,
        ),
        "action_12th_mm": Words(
            "Action half way",
            "Gap between the open string and the board, halfway along the string. A low action growls, a high one is clean.",
            "mm",
            (0.6, 4.0),
            0.05,
            setup=True,
        ),
        "nut_height_mm": Words(
            "Gap at the nut",
            "Gap between the open string and the board at the nut.",
            "mm",
            (0.1, 1.0),
            0.01,
            setup=True,
        ),
        "relief_mm": Words(
            "Relief",
            "Hollow of the board under a straightedge, measured halfway; it leaves room where the string swings widest.",
            "mm",
            (0.0, 0.6),
            0.01,
            setup=True,
        ),
        "stiffness_n_mm2": Words(
            "Hardness",
            "Force per millimetre of string and per millimetre of indentation: bare wood is softer than epoxy.",
            "N/mm²",
            (20.0, 500.0),
            1.0,
            setup=True,
        ),
        "rebound": Words(
            "Rebound",
            "Share of the impact speed that the board returns: 0 none, 1 all. Above 0.7, late and faint contacts "
            "are chaotic.",
            "",
            (0.0, 1.0),
            0.01,
        ),
        "slide_ms": Words(
            "Slide",
            "Time in which the finger slides most of the way to the next note while the legato pedal is down; at "
            "0 it jumps there.",
            "ms",
            (0.0, 200.0),
            1.0,
        ),
        "tip_stiffness_n_mm": Words(
            "Fingertip, stiffness",
            "Stiffness of the flesh between string and board at the end of the speaking length.",
            "N/mm",
            (20.0, 500.0),
            1.0,
        ),
        "tip_loss_n_s_m": Words(
            "Fingertip, loss",
            "How much vibration the flesh absorbs: the more, the sooner a stopped note loses its highs.",
            "N s/m",
            (0.05, 5.0),
            0.05,
        ),
    },
    FretsObstacle: {
        "kind": _OBSTACLE_KIND,
        "friction": _FRICTION,
        "layer": _LAYER,
        "count": Words(
            "Frets",
            "Number of frets, in equal temperament; every string plays that many notes above its open note.",
            "",
            (12.0, 24.0),
            1.0,
            setup=True,
        ),
        "action_12th_mm": Words(
            "Action at fret 12",
            "Gap between string and fret 12. A low action is easy to play and slaps the frets when struck hard; a "
            "high one is clean.",
            "mm",
            (0.8, 4.0),
            0.05,
            setup=True,
        ),
        "relief_mm": Words(
            "Relief",
            "Hollow of the neck under a straightedge, measured halfway; it leaves room where the string swings widest.",
            "mm",
            (0.0, 0.6),
            0.01,
            setup=True,
        ),
        "sawari_distance_mm": Words(
            "Sawari from the nut",
            "Distance from the nut of the ridge before the first fret on which open strings buzz.",
            "mm",
            (4.0, 30.0),
            0.1,
            setup=True,
        ),
        "sawari_um": Words(
            "Gap of the sawari",
            "Gap between that ridge and the open string at rest, by open note: a few µm buzz, 1000 is out of reach.",
            "µm",
            (0.0, 30.0),
            0.5,
            travel=(-100.0, 1000.0),
            setup=True,
        ),
        "nut_height_mm": Words(
            "Gap at fret 1",
            "Gap between the open string and fret 1, set by the depth of the nut's slots.",
            "mm",
            (0.2, 1.0),
            0.01,
            setup=True,
        ),
        "heights_mm": Words(
            "Fret heights",
            "Height of every fret relative to the open string at rest (−2 is two millimetres below it), in place "
            "of action and relief: this makes a single worn or high fret buzz.",
            "mm",
            setup=True,
        ),
    },
    Setup: {
        "action_bass_mm": Words(
            "Action, bass side",
            "Gap between the lowest string and fret 12; without frets, between string and board halfway along the string.",
            "mm",
            (0.8, 4.0),
            0.05,
            setup=True,
        ),
        "action_treble_mm": Words(
            "Action, treble side",
            "The same gap under the highest string; the strings between have actions between. If it is not given, that of "
            "the bass side applies.",
            "mm",
            (0.8, 4.0),
            0.05,
            setup=True,
        ),
        "relief_mm": Words(
            "Relief",
            "Gap under a straightedge on the first and the last fret, measured halfway; below 0 the neck is bent backwards "
            "(backbow). The truss rod sets it.",
            "mm",
            (-0.1, 0.6),
            0.01,
            setup=True,
        ),
        "nut_bass_mm": Words(
            "Gap at fret 1, bass side",
            "Gap between the lowest string and fret 1, set by the nut slot's depth; without frets, the gap at the nut.",
            "mm",
            (0.2, 1.0),
            0.01,
            setup=True,
        ),
        "nut_treble_mm": Words(
            "Gap at fret 1, treble side",
            "The same gap under the highest string. If it is not given, that of the bass side applies.",
            "mm",
            (0.2, 1.0),
            0.01,
            setup=True,
        ),
        "fall_away_mm": Words(
            "Fall-away",
            "How far the last fret lies below the line of the neck; the frets before it fall in proportion to their "
            "distance from the fret where the fall begins.",
            "mm",
            (0.0, 0.5),
            0.01,
            setup=True,
        ),
        "fall_away_fret": Words(
            "Fall-away begins at",
            "The last fret that still follows the line of the neck.",
            "",
            (10.0, 16.0),
            1.0,
            setup=True,
        ),
        "fret_heights_mm": Words(
            "Fret heights",
            "Measured height of every fret's crown above the board, from the nut: a fret 0.05 mm higher than its neighbours "
            "buzzes. The gaps at frets 1 and 12 are measured on these frets.",
            "mm",
            setup=True,
        ),
        "board_radius_mm": Words(
            "Radius of the board",
            "Radius of board and frets across the strings; the nut's slots follow it. If it is not given, they are flat. "
            "7.25 inch is 184 mm, 12 inch 305 mm.",
            "mm",
            (180.0, 510.0),
            1.0,
            setup=True,
        ),
        "saddle_radius_mm": Words(
            "Radius of the saddles",
            "Radius of the circle on which the strings lie at the saddles. If it is not given, that of the board. "
            "A saddle flatter than the board brings the inner strings nearer to the frets.",
            "mm",
            (180.0, 510.0),
            1.0,
            setup=True,
        ),
        "nut_spread_mm": Words(
            "Outer strings at the nut",
            "Distance between the lowest and the highest string at the nut; the others are evenly spaced.",
            "mm",
            (30.0, 52.0),
            0.5,
            setup=True,
        ),
        "saddle_spread_mm": Words(
            "Outer strings at the saddle",
            "Distance between the lowest and the highest string at the saddle.",
            "mm",
            (45.0, 80.0),
            0.5,
            setup=True,
        ),
        "strings": Words(
            "Strings by name",
            "Makers' names from the lowest string to the highest (NW046, PL010, XLB100). Mass and diameter come from the "
            "maker's table, and core and stiffness follow the diameter.",
            setup=True,
        ),
    },
    Pluck: {
        "position": Words(
            "Plucked at, from saddle",
            "Distance from the saddle as a share of the open string. Partials with a node there are missing: the "
            "middle sounds hollow, near the bridge thin and bright. Values beyond the middle count as the middle.",
            "of L",
            (0.05, 0.5),
            0.001,
            live=True,
            setup=True,
        ),
        "position_hard": Words(
            "Hardest pluck at, from saddle",
            "Position of the hardest pluck; softer ones lie in between. Players move towards the bridge for loud, "
            "biting notes.",
            "of L",
            (0.05, 0.5),
            0.001,
        ),
        "displacement_mm": Words(
            "Displacement",
            "How far the hardest pluck draws the open string aside; stopped notes are plucked with the same "
            "force. It sets the level and the amount of contact.",
            "mm",
            (0.2, 6.0),
            0.05,
            live=True,
            setup=True,
        ),
        "velocity_exponent": Words(
            "Velocity curve",
            "Displacement grows as velocity to this power: 1 is linear, 2 doubles the dynamics in dB, 0 plays "
            "every velocity alike.",
            "",
            (0.5, 2.0),
            0.05,
            travel=(0.0, 4.0),
        ),
        "width_mm": Words(
            "Finger width",
            "Length of string under the finger: flesh 15, nail 3, plectrum 1. It rounds the corner of the pluck: "
            "partials with a shorter half-wavelength are hardly excited.",
            "mm",
            (1.0, 25.0),
            0.1,
            live=True,
            setup=True,
        ),
        "width_hard_mm": Words(
            "Finger width, hard",
            "Width at the hardest pluck, where the tip or the nail digs in; softer ones lie in between.",
            "mm",
            (1.0, 25.0),
            0.1,
        ),
        "draw_ms": Words(
            "Drawing time",
            "Time from touching the string to releasing it. The note sounds that much after the key. A short time "
            "is a flick; with a long one the old sound dies audibly under the finger.",
            "ms",
            (1.0, 20.0),
            0.5,
        ),
        "finger_stiffness_n_mm": Words(
            "Finger stiffness",
            "How firmly the finger holds the string while drawing it: flesh yields, plectrum and nail do not.",
            "N/mm",
            (5.0, 500.0),
            0.1,
        ),
        "finger_loss": Words(
            "Finger loss",
            "How much the finger absorbs from passing waves, relative to the string's impedance: 2 absorbs most, 0 nothing.",
            "× Z",
            (0.1, 5.0),
            0.05,
            travel=(0.0, 5.0),
        ),
        "slip_ms": Words(
            "Slip time",
            "Time in which the string slides off the finger. Partials above its inverse are not excited: 0.1 for "
            "a plectrum, 0.3 for a nail, 1 or more for soft flesh. 0 is instant.",
            "ms",
            (0.0, 3.0),
            0.05,
        ),
        "slip_hard_ms": Words(
            "Slip time, hard",
            "Slip time of the hardest pluck; softer ones lie in between. A shorter one makes loud notes brighter.",
            "ms",
            (0.0, 3.0),
            0.05,
        ),
        "roughness_um": Words(
            "Roughness",
            "How far the finger jumps while rubbing along the string: the noise of the stroke.",
            "µm",
            (0.0, 20.0),
            0.5,
        ),
        "rub_percent": Words(
            "Rubbing",
            "How unsteady the finger's force is as the string slides off over a rough edge, as a share of the force: "
            "standard deviation. It grows while the string is drawn and goes on until it is free.",
            "%",
            (0.0, 50.0),
            1.0,
        ),
        "edge_mm": Words(
            "Edge",
            "How far the string slides over the edge of finger, nail or plectrum before it is free; while it is drawn "
            "it creeps as far.",
            "mm",
            (0.2, 5.0),
            0.1,
        ),
        "grain_mm": Words(
            "Grain",
            "Distance between the rough places that the string passes: 0.5 for the ridges of a fingertip, the winding's "
            "pitch for a plectrum on a wound string, 0.05 for a nail. With the edge and the slip time it sets how high "
            "the noise reaches.",
            "mm",
            (0.02, 1.0),
            0.01,
        ),
        "arrival": Words(
            "Arrival",
            "Speed with which the finger or plectrum meets the string, relative to the mean speed at which it draws it: "
            "at 0 it starts from rest, at 1 it is heard to click on the string before the note.",
            "×",
            (0.0, 2.0),
            0.05,
            travel=(0.0, 3.0),
        ),
        "width_course": Words(
            "Width by velocity",
            "How the finger's width goes from soft to hard. By ratios, brightness rises evenly; by steps, it rises "
            "mostly among the loudest notes.",
        ),
    },
    Damping: {
        "ring_on": Words(
            "Ring on", "No hand damps the string when the key goes up: tanpura, sitar, harp with open strings."
        ),
        "release_s": Words(
            "Damping time",
            "How fast the hand silences the string after the note: time to −60 dB.",
            "s",
            (0.03, 2.0),
            0.01,
            live=True,
        ),
        "others_s": Words(
            "Other strings, damping time",
            "The same for the other strings on a shared bridge, which the hand covers when the last note ends and leaves "
            "at the next stroke. If it is not given, they ring on.",
            "s",
            (0.05, 2.0),
            0.01,
        ),
    },
    Output: {
        "kind": Words(
            "What is heard",
            "The string's force on the saddle, which drives a body; its displacement or velocity at a place; the voltage of "
            "a magnetic pickup over it, or the flux through one, for a resonance as its coil; or the body that all share.",
            setup=True,
        ),
        "position": Words(
            "Pickup at, from saddle",
            "Position of the pickup or probe as a share of the open string; partials with a node there are not "
            "heard. 0 is the saddle itself.",
            "of L",
            (0.0, 0.4),
            0.001,
            setup=True,
        ),
        "distance_mm": Words(
            "Pickup distance",
            "Distance from the magnet to the string at rest. Close up, wide swings distort: this gives a growling "
            "pickup its even harmonics.",
            "mm",
            (1.0, 10.0),
            0.1,
            setup=True,
        ),
        "aperture_mm": Words(
            "Pickup aperture",
            "Length of string within the magnet's field; partials with a shorter wavelength are averaged out.",
            "mm",
            (5.0, 40.0),
            0.5,
        ),
        "gain_db": Words(
            "Level",
            "Level of the whole instrument. Built-in presets are equally loud: −18 LUFS for a phrase at velocity 80.",
            "dB",
            (-60.0, 60.0),
            0.5,
            live=True,
        ),
    },
    Body: {
        "direct_db": Words(
            "Direct sound", "Level of the string itself beside the body's resonances.", "dB", (-40.0, 6.0), 0.5
        ),
        "resonance": Words(
            "Resonances of the body",
            "Measured peaks of the body's mobility, added to the direct sound; each colours and rings.",
        ),
        "mode": Words(
            "Modes of the body",
            "Modes that all strings drive through their bridge, and that move the strings in turn: strings beat, "
            "decay in two stages and ring with each other. They are heard through the body alone, so the output "
            "must be the body.",
        ),
    },
    MovingMode: {
        "frequency_hz": Words("Mode", "Frequency of the mode without strings.", "Hz", (60.0, 4000.0), 0.5),
        "q": Words(
            "Q", "Sharpness of the mode, and how long it rings: to −60 dB in 2.2·Q/f seconds.", "", (10.0, 60.0), 0.5
        ),
        "mass_kg": Words(
            "Mass at the bridge",
            "Mass that the strings have to move: the lighter it is, the louder and shorter the notes near the "
            "mode, and the further they stray from their pitch.",
            "kg",
            (0.1, 3.0),
            0.01,
        ),
        "shape": Words(
            "Motion of the bridge",
            "Up and down, along the body across the strings, and rocking per metre from the bridge's middle.",
        ),
        "radiation": Words(
            "Radiation",
            "How much of the mode's acceleration is heard; below 0, in opposite phase to the others.",
            "",
            (-2.0, 2.0),
            0.1,
        ),
        "pan": Words("Heard from", "−1 left, 1 right.", "", (-1.0, 1.0), 0.1),
        **_FIELD,
    },
    Hand: {
        "place_mm": Words(
            "Places vary by",
            "The hand never lands in quite the same place: standard deviation along the string.",
            "mm",
            (0.0, 10.0),
            0.1,
        ),
        "level_db": Words(
            "Levels vary by",
            "No two strokes are equally strong, even at the same velocity: standard deviation of the displacement.",
            "dB",
            (0.0, 3.0),
            0.05,
        ),
        "width_percent": Words(
            "Widths vary by",
            "The width of finger on the string varies from stroke to stroke: standard deviation.",
            "%",
            (0.0, 30.0),
            0.5,
        ),
        "time_percent": Words(
            "Times vary by",
            "Drawing time and slip time vary from stroke to stroke: standard deviation.",
            "%",
            (0.0, 30.0),
            0.5,
        ),
        "vibrato_hz": Words(
            "Vibrato, rate", "Rate of the vibrato from the modulation wheel (controller 1).", "Hz", (4.0, 7.0), 0.1
        ),
        "vibrato_cents": Words(
            "Vibrato, width",
            "Depth of the vibrato to either side, with the modulation wheel fully up; 0 is none.",
            "cents",
            (0.0, 60.0),
            1.0,
        ),
        "vibrato": Words(
            "Vibrato, direction", "A string over a fret can only be pulled sharp; over a board it goes both ways."
        ),
        "meend_semitones": Words(
            "Pulled across the fret by",
            "Legato to a higher note on the same string pulls the string aside by up to this much, as on a sitar, "
            "instead of changing fret. At 0 it is stopped at the next fret.",
            "semitones",
            (0.0, 5.0),
            0.5,
        ),
        "meend_ms": Words(
            "Pulled within", "Time constant with which the string is pulled aside and let back.", "ms", (20.0, 300.0), 1.0
        ),
        "release": Words(
            "Finger at the end",
            "A finger, palm or felt laid on the string when its note ends, in addition to the damping. Add it in "
            "the file, as hand.release.",
        ),
        "fret_release": Words(
            "Finger leaves the fret",
            "When a stopped note ends, its finger lets the string rise from the fret: a thump of the open string, louder "
            "where strings are higher. The finger at the end, if there is one, lies where the fret is.",
        ),
        "knock": Words(
            "Knock on the body",
            "A push of the hand on the body with every stroke, for strings that share a body with modes. Add it in the "
            "file, as hand.knock.",
        ),
    },
    Touch: {
        "place": Words(
            "Place, from saddle",
            "Position as a share of the speaking length: partials with a node there ring on, all others are damped.",
            "of L",
            (0.02, 0.98),
            0.001,
        ),
        "width_mm": Words("Width", "Length of string under the finger, palm or felt.", "mm", (2.0, 50.0), 0.5),
        "resistance": Words(
            "Resistance",
            "How much it absorbs from passing waves, relative to the string's impedance: 1 damps the string "
            "within a few periods, 10 nearly stops it there.",
            "× Z",
            (0.1, 20.0),
            0.05,
        ),
        "stiffness_n_mm": Words(
            "Stiffness", "How firmly it holds the string in place; 0 only damps.", "N/mm", (0.0, 10.0), 0.01
        ),
        "lift_ms": Words(
            "Lifted after",
            "How long it stays on the string; if it is not given, until the next stroke.",
            "ms",
            (10.0, 500.0),
            1.0,
        ),
        "speed_m_s": Words(
            "Speed",
            "How fast it comes down on the string, on the side away from the frets: its thud.",
            "m/s",
            (0.0, 1.0),
            0.05,
        ),
        "roughness_um": Words(
            "Roughness",
            "How far it jumps as it rubs along the string, after it has come down and before it leaves.",
            "µm",
            (0.0, 200.0),
            1.0,
        ),
        "settle_ms": Words("Settles within", "Time in which it comes to rest on the string.", "ms", (2.0, 50.0), 0.5),
        "grain_ms": Words(
            "Grain", "Time after which it jumps anew; the shorter, the higher its noise reaches.", "ms", (0.02, 1.0), 0.01
        ),
    },
    Knock: {
        "force_n": Words("Force", "Largest force of the hand on the body at velocity 127.", "N", (0.1, 10.0), 0.1),
        "time_ms": Words(
            "Duration", "How long the push takes: a short one is a click, a long one a thud.", "ms", (1.0, 20.0), 0.5
        ),
        "delay_ms": Words("Delay", "Time from the finger's touch on the string to the push.", "ms", (0.0, 20.0), 0.5),
        "noise_percent": Words(
            "Noise", "What is unsteady about the push, as a share of its force: standard deviation.", "%", (0.0, 100.0), 1.0
        ),
        "grain_ms": Words(
            "Grain", "Time in which that changes; the shorter, the higher its noise reaches.", "ms", (0.02, 1.0), 0.01
        ),
        "distance_mm": Words(
            "Distance",
            "From the bridge to where the hand pushes: near it all modes go with the bridge, far off each in its own sense.",
            "mm",
            (0.0, 300.0),
            5.0,
        ),
        "release_ratio": Words(
            "At the note's end",
            "Force of another push when the note ends, relative to that of its stroke; 0 is none.",
            "×",
            (0.0, 1.0),
            0.05,
        ),
    },
    Polarisation: {
        "detuning_cents": Words(
            "Second direction, detuned",
            "How much higher the pitch of the second direction is than that of the first: the two beat with each other.",
            "cents",
            (0.0, 3.0),
            0.1,
        ),
        "loss_ratio": Words(
            "Second direction, loss", "How much faster the second direction decays on its own.", "×", (0.8, 2.0), 0.05
        ),
        "pluck_deg": Words(
            "Direction of the pluck",
            "Angle from the string's first direction: at 0 the body gets all of the energy at once, at 90 little, "
            "for longer.",
            "°",
            (0.0, 60.0),
            1.0,
        ),
        "nut_share": Words(
            "Second direction, nut",
            "How much the nut's resonances yield in the second direction, as a share of the first: necks are "
            "stiffer along the board. Partials near a resonance then differ between the directions, and beat.",
            "",
            (0.0, 1.0),
            0.05,
        ),
        "heard": Words(
            "Second direction, heard",
            "For strings with rigid ends: how much of the second direction reaches the pickup or saddle, as a "
            "share of the first.",
            "",
            (0.0, 0.6),
            0.05,
        ),
    },
    BodyMode: {
        "frequency_hz": Words("Peak", "Frequency of the resonance's maximum.", "Hz", (60.0, 5000.0), 1.0),
        "q": Words("Q", "Sharpness of the peak: it rings to −60 dB in 2.2·Q/f seconds.", "", (3.0, 100.0), 0.1),
        "gain_db": Words("Gain", "Gain of the peak relative to the string's own sound.", "dB", (-40.0, 20.0), 0.5),
        "pan": Words(
            "Side",
            "Pan of the peak: −1 left, 1 right. Peaks on both sides make the body sound wide.",
            "",
            (-0.7, 0.7),
            0.05,
        ),
        **_FIELD,
    },
    Mapping_: {
        "polyphony": Words(
            "Polyphony",
            "How many strings can sound at once; beyond that, the quietest is cut within 30 ms.",
            "",
            (4.0, 64.0),
            1.0,
        ),
        "pressure_um": Words(
            "Pressure moves the bridge",
            "How far full key pressure raises the bridge under the string (below 0: lowers it): a tanpura clears up as its "
            "bridge sinks.",
            "µm",
            (-30.0, 10.0),
            0.5,
        ),
        "pressure_cents": Words(
            "Pressure bends",
            "How far full key pressure stretches the string, as a finger behind the fret does.",
            "cents",
            (0.0, 100.0),
            1.0,
        ),
    },
}

#: values of choices and what they say
CHOICES: dict[tuple[type[Table], str], dict[str, str]] = {
    (Pluck, "width_course"): {"steps": "by steps", "ratios": "by ratios"},
    (Hand, "vibrato"): {"both": "both ways", "up": "up only"},
    (StringTable, "stiffness_law"): {"sqrt": "pinned stiff string", "linear": "1 + Bj²/2"},
    (Output, "kind"): {
        "force": "force on the saddle",
        "displacement": "displacement",
        "velocity": "velocity",
        "pickup": "magnetic pickup",
        "flux": "flux through a pickup",
        "body": "body",
    },
}
OBSTACLES = {
    "none": "nothing",
    "bridge": "tanpura bridge",
    "points": "points",
    "frets": "frets",
    "board": "board without frets",
}

#: the words of a bridge that has no thread: a string's end lies on its curve
WITHOUT_THREAD: dict[str, Words] = {
    "distance_mm": Words(
        "Depth of the bridge",
        "How far the bridge's curve extends from the string's end. The deeper it is, the more of the string can wrap it.",
        "mm",
        (2.0, 20.0),
        0.1,
        setup=True,
    ),
    "distance_ratio": Words(
        "Depth of the bridge, of the length",
        "The same distance as a share of the open string, so that the bridge scales with the string's length.",
        "of L",
        (0.002, 0.03),
        0.0001,
        setup=True,
    ),
    "jiva_um": Words(
        "Gap over the bridge",
        "Gap between the string at rest and the bridge's curve. At 0 the string rests on it and buzzes most; "
        "with a gap only hard plucks touch; below 0 the string is pressed down and the buzz dies.",
        "µm",
        (0.0, 30.0),
        0.5,
        live=True,
        travel=(-100.0, 1000.0),
        setup=True,
    ),
}


def words_of(kind: type[Table], table: Table, name: str) -> Words:
    """The words of a field of a table."""
    if isinstance(table, BridgeObstacle) and not table.has_thread and name in WITHOUT_THREAD:
        return WITHOUT_THREAD[name]
    return WORDS[kind][name]
