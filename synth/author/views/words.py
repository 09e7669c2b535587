"""The words of the controls: label, unit, usual range and the physics of every field of a preset.

Ranges and defaults are the schema's (`parameters`); here stands what the schema cannot know. Keys are the schema's class and
field.
"""

from __future__ import annotations

from dataclasses import dataclass

from synth.instrument.articulations import Hand, Touch
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
    "Of strings that move in two directions: how strongly what they are pressed against holds them back along it, as a "
    "share of the force. 0 is none; it damps the second direction while the first one buzzes.",
    "",
    (0.0, 0.6),
    0.01,
)
_LAYER = Words(
    "Soft layer",
    "Thread, felt or skin on every contact, in front of what is rigid. It is begun in the file, as obstacle.layer.",
)
_OBSTACLE_KIND = Words(
    "What the string touches",
    "Nothing; the thread and edge of a tanpura's bridge; any points; the frets of a neck. What the string meets while it "
    "swings makes the buzz, the slap, the rattle.",
    setup=True,
)

WORDS: dict[type[Table], dict[str, Words]] = {
    Preset: {
        "name": Words("Name", "How commands call the preset: lower-case letters, digits and hyphens, up to 64."),
        "title": Words("Title", "What people read in lists."),
        "description": Words("Description", "The instrument in a sentence: strings, tuning, what makes its sound."),
        "family": Words(
            "Family",
            "What sort of instrument it is, in one lower-case word: bass, guitar, sitar, tanpura, harp, keyboard. Lists are "
            "grouped by it.",
        ),
        "tags": Words("Tags", "Lower-case words by which it is found, such as wound, bright or finger, one a line."),
        "sources": Words("Sources", "Where the numbers come from: papers, measurements, makers' data, one a line."),
        "remarks": Words(
            "Remarks", "The author's notes: what was tried, what is still to do. Nothing reads them but people."
        ),
        "string": Words("Strings", "One table for each string, or one for a range of notes with a string for every note."),
        "polarisation": Words(
            "Second direction", "Strings may move at right angles to their first direction, too, where nothing stops them."
        ),
        "nut": Words(
            "Resonances of the nut end",
            "What holds the string gives way at its resonances. A narrow one takes the energy of notes near it (a dead "
            "spot), a broad one shortens all of them.",
        ),
    },
    Tuning: {
        "a4_hz": Words("Concert pitch", "Frequency of A4; all strings follow.", "Hz", (415.0, 466.0), 0.1),
        "offset_cents": Words("Tuning", "Raises or lowers all strings, by their tension.", "cents", (-100.0, 100.0), 1.0),
        "contact_cents": Words(
            "Contact correction",
            "A string that rests on its bridge for a part of every period speaks shorter and sounds some cents sharp. "
            "That much is taken off its tension, by note; measured by tools/tune-presets.",
            "cents",
            (0.0, 5.0),
            0.01,
        ),
        "sympathetic_cents": Words(
            "Correction of sympathetic strings",
            "The same of the strings that no key plays, by note; measured by tools/tune-presets.",
            "cents",
            (-5.0, 5.0),
            0.01,
        ),
    },
    NutMode: {
        "frequency_hz": Words(
            "Resonance",
            "Where the structure swings by itself; a note there is short and shifted.",
            "Hz",
            (40.0, 1000.0),
            1.0,
        ),
        "q": Words(
            "Q", "How narrow it is: high, one note suffers; below 1, the whole compass loses evenly.", "", (0.4, 60.0), 0.1
        ),
        "mass_kg": Words(
            "Moving mass",
            "What the string has to shake: the lighter, the more it takes from the note.",
            "kg",
            (0.05, 10.0),
            0.01,
        ),
    },
    StringTable: {
        "name": Words("Name", "What the player calls the string: Pa, Sa, E, G."),
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
            "Outer diameter. A thick plain string is heavier and much stiffer (fourth power): sharper partials, shorter "
            "brightness. The air damps by it too.",
            "mm",
            (0.2, 2.6),
            0.001,
        ),
        "linear_density_g_m": Words(
            "Mass per length",
            "Of a wound string, from the maker's data. Heavier: more tension at the same pitch, a louder string that is "
            "harder to draw aside.",
            "g/m",
            (0.3, 35.0),
            0.01,
        ),
        "density_kg_m3": Words(
            "Density",
            "Of a plain string's material: steel 7850, bronze 8800, brass 8500, nylon 1070, gut 1300.",
            "kg/m³",
            (1000.0, 9000.0),
            10.0,
        ),
        "core_diameter_mm": Words(
            "Core",
            "Diameter of a wound string's core, which alone resists bending; its winding adds mass, hardly stiffness.",
            "mm",
            (0.2, 0.7),
            0.001,
        ),
        "winding_diameter_mm": Words(
            "Winding wire",
            "Diameter of the wire around the core; it rubs at the air more than a plain string.",
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
            "Loss angle of the material as it bends. It takes the high partials first, the more the stiffer the string: "
            "steel 0.005, wound 0.01, nylon and gut several times that.",
            "",
            (0.001, 0.1),
            0.0001,
        ),
        "thermoelastic_q_inverse": Words(
            "Heat loss",
            "1/Q of heat flowing in the metal; it shortens all partials by the same number of periods. 0.0002 is plain "
            "steel, 0.000006 a wound bass string.",
            "",
            (0.0, 0.001),
            1e-6,
        ),
        "stiffness_law": Words(
            "Law of stiffness",
            "How partials stretch: sqrt is the exact law of a pinned stiff string, linear (1 + Bj²/2) what some published "
            "data follow; they differ in the high partials only.",
        ),
        "tension_modulation": Words(
            "Tension follows the motion",
            "Plucked hard, the string begins sharp and glides down to its pitch, as real ones do by some cents.",
        ),
        "axial_stiffness_n": Words(
            "Axial stiffness",
            "What resists its stretching, modulus times section of what bears the tension; less where the string stretches "
            "behind nut and saddle, too. 30 000 is plain steel of 0.43 mm.",
            "N",
            (500.0, 100000.0),
            100.0,
        ),
        "cents": Words("Fine tuning", "Of this string alone, by its tension.", "cents", (-50.0, 50.0), 0.1),
        "sounds": Words(
            "Sounds",
            "The note that it gives where another key plays it: drone strings out of the way of a melody that passes "
            "their pitch.",
            "",
            (24.0, 84.0),
            1.0,
        ),
        "sympathetic": Words(
            "Sympathetic",
            "No key plays it: it rings with the others by the bridge that they share, as a sitar's tarafs do.",
        ),
        "frets": Words("Frets", "How many of the neck's frets are under it, from the nut on.", "", (0.0, 24.0), 1.0),
        "bridge_points": Words(
            "Points of the bridge", "How many of the bridge's points are under it, from the saddle on.", "", (0.0, 8.0), 1.0
        ),
        "gain_db": Words("Level", "Of this string in the mix; it changes nothing of its motion.", "dB", (-12.0, 12.0), 0.1),
        "choir": Words(
            "Choir",
            "A key sounds one string of every choir that has its note, as the two or three of a harpsichord.",
            "",
            (1.0, 4.0),
            1.0,
        ),
        "pluck_position": Words(
            "Where it is plucked",
            "Of this string alone, from the saddle, as a share of its length; where it is not given, the pluck's position.",
            "of L",
            (0.02, 0.5),
            0.01,
        ),
        "place_mm": Words(
            "Place on the bridge",
            "From its middle, of strings that share a body: where that rocks.",
            "mm",
            (-40.0, 40.0),
            0.5,
        ),
        "angle_deg": Words(
            "Direction at the bridge",
            "Of the string's first direction from the body's normal, of strings that share a body.",
            "°",
            (-45.0, 45.0),
            1.0,
        ),
        "measured_frequencies_hz": Words(
            "Measured partials",
            "Frequencies of partials 1, 2, … as measured on a real string, moved with its tuning; behind the last one the "
            "model goes on.",
            "Hz",
        ),
        "measured_decay_rates": Words(
            "Measured decay rates",
            "Decay rates σ of partials 1, 2, … as measured (amplitude e^(−σt), T60 = 6.91/σ); behind the last one the model "
            "goes on.",
            "1/s",
        ),
    },
    NoObstacle: {"kind": _OBSTACLE_KIND},
    Layer: {
        "stiffness_n_mm": Words(
            "Layer: stiffness",
            "Of what is soft on every contact, a thread, felt or skin. The softer, the rounder the buzz.",
            "N/mm",
            (1.0, 1000.0),
            0.1,
        ),
        "resistance_n_s_m": Words(
            "Layer: resistance",
            "What it loses while it is pressed and let go. The more, the duller the buzz and the sooner it ends.",
            "N s/m",
            (0.0, 10.0),
            0.01,
        ),
        "thickness_um": Words(
            "Layer: thickness",
            "How deep the string may go into it until it is rigid; heights of the obstacle are those of its surface.",
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
            "How far the bridge's edge of contact lies before the string's end on the thread. The longer, the higher the "
            "formant of the buzz begins and the further it sinks.",
            "mm",
            (2.0, 20.0),
            0.1,
            setup=True,
        ),
        "distance_ratio": Words(
            "Thread to edge, of the length",
            "The same as a share of the open string, so that strings of all lengths have the same bridge.",
            "of L",
            (0.002, 0.03),
            0.0001,
            setup=True,
        ),
        "jiva_um": Words(
            "Thread (jiva)",
            "How high the thread lifts the string off the bridge. 0 rests on it and buzzes most, some µm open and close "
            "every period, beyond 20 only hard plucks touch; below 0 the string is pressed and the buzz dies.",
            "µm",
            (0.0, 30.0),
            0.5,
            live=True,
            travel=(-100.0, 1000.0),
            setup=True,
        ),
        "points": Words(
            "Points",
            "How many points the string may touch, evenly from its end to the edge of contact: one is a thread before "
            "an edge, several are the arc of a curved bridge.",
            "",
            (1.0, 12.0),
            1.0,
            setup=True,
        ),
        "radius_mm": Words(
            "Radius of the bridge",
            "Of a bridge of several points: the larger, the flatter it is, and the longer and buzzier the string wraps it.",
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
            "Points of contact, counted from the nut, rising; each needs its height.",
            "mm",
            setup=True,
        ),
        "heights_mm": Words(
            "Heights",
            "Of the points above the string at rest: −1 lies a millimetre below it, 0 just touches.",
            "mm",
            setup=True,
        ),
    },
    BoardObstacle: {
        "kind": _OBSTACLE_KIND,
        "semitones": Words(
            "Semitones",
            "How far up the board every string is played, above its own note.",
            "",
            (12.0, 30.0),
            1.0,
            setup=True,
        ),
        "length_mm": Words(
            "Board ends at",
            "From the nut. Fingers go no further; where a string is plucked over the board it strikes it more.",
            "mm",
            (500.0, 750.0),
            1.0,
            setup=True,
        ),
        "action_12th_mm": Words(
            "Action half way",
            "Gap between the open string and the board half way along it. Low growls, high is clean.",
            "mm",
            (0.6, 4.0),
            0.05,
            setup=True,
        ),
        "nut_height_mm": Words(
            "Gap at the nut",
            "Between the open string and the board.",
            "mm",
            (0.1, 1.0),
            0.01,
            setup=True,
        ),
        "relief_mm": Words(
            "Relief",
            "Hollow of the board under a straightedge, half way; it makes room where the string swings widest.",
            "mm",
            (0.0, 0.6),
            0.01,
            setup=True,
        ),
        "stiffness_n_mm2": Words(
            "Hardness",
            "Force on a millimetre of string pressed in by a millimetre: bare wood is softer than epoxy.",
            "N/mm²",
            (20.0, 500.0),
            1.0,
            setup=True,
        ),
        "rebound": Words(
            "Rebound",
            "What the board gives back of a blow's speed: 0 nothing, 1 all. Above 0.7 late, faint contacts are chaotic.",
            "",
            (0.0, 1.0),
            0.01,
        ),
        "slide_ms": Words(
            "Slide",
            "Time of most of a finger's way to the next note while the legato pedal is down; 0: it is put there.",
            "ms",
            (0.0, 200.0),
            1.0,
        ),
        "tip_stiffness_n_mm": Words(
            "Fingertip, stiffness",
            "Of the flesh between string and board at the end of the speaking length.",
            "N/mm",
            (20.0, 500.0),
            1.0,
        ),
        "tip_loss_n_s_m": Words(
            "Fingertip, loss",
            "What flesh takes of the vibration: the more, the sooner the highs of a stopped note are gone.",
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
            "How many, in equal temperament; every string plays as many notes above its own.",
            "",
            (12.0, 24.0),
            1.0,
            setup=True,
        ),
        "action_12th_mm": Words(
            "Action at fret 12",
            "Gap between string and fret 12. Low is easy to play and slaps the frets when struck hard, high is clean.",
            "mm",
            (0.8, 4.0),
            0.05,
            setup=True,
        ),
        "relief_mm": Words(
            "Relief",
            "Hollow of the neck under a straightedge, half way; it makes room where the string swings widest.",
            "mm",
            (0.0, 0.6),
            0.01,
            setup=True,
        ),
        "sawari_distance_mm": Words(
            "Sawari from the nut",
            "Where the neck rises to a hill, before the first fret, that open strings buzz on.",
            "mm",
            (4.0, 30.0),
            0.1,
            setup=True,
        ),
        "sawari_um": Words(
            "Gap of the sawari",
            "Between that hill and the open string at rest, by open note: a few µm buzz, 1000 is out of reach.",
            "µm",
            (0.0, 30.0),
            0.5,
            travel=(-100.0, 1000.0),
            setup=True,
        ),
        "nut_height_mm": Words(
            "Gap at fret 1",
            "Between the open string and fret 1: what the nut's slots leave.",
            "mm",
            (0.2, 1.0),
            0.01,
            setup=True,
        ),
        "heights_mm": Words(
            "Fret heights",
            "Of every fret above the open string at rest (−2 lies two millimetres below it), in place of action and relief: "
            "a worn or high fret buzzes by itself.",
            "mm",
            setup=True,
        ),
    },
    Pluck: {
        "position": Words(
            "Plucked at, from saddle",
            "Distance from the saddle as a share of the open string. A partial with a node there is missing: the middle is "
            "hollow, near the bridge thin and bright. Beyond the middle counts as the middle.",
            "of L",
            (0.05, 0.5),
            0.001,
            live=True,
            setup=True,
        ),
        "position_hard": Words(
            "Hardest pluck at, from saddle",
            "Where the hardest pluck goes; softer ones lie between. Players move towards the bridge for loud, biting notes.",
            "of L",
            (0.05, 0.5),
            0.001,
        ),
        "displacement_mm": Words(
            "Displacement",
            "How far the hardest pluck draws the open string aside; stopped notes are plucked with the same force. Level, "
            "and how much is touched.",
            "mm",
            (0.2, 6.0),
            0.05,
            live=True,
            setup=True,
        ),
        "velocity_exponent": Words(
            "Velocity curve",
            "Displacement grows as velocity to this power: 1 even, 2 twice the dynamics in dB, 0 the same for every key.",
            "",
            (0.5, 2.0),
            0.05,
            travel=(0.0, 4.0),
        ),
        "width_mm": Words(
            "Finger width",
            "Length of string under the finger: flesh 15, nail 3, plectrum 1. It rounds the corner: partials whose half "
            "wave is shorter are hardly plucked.",
            "mm",
            (1.0, 25.0),
            0.1,
            live=True,
            setup=True,
        ),
        "width_hard_mm": Words(
            "Finger width, hard",
            "At the hardest pluck, where the tip or the nail digs in; softer ones lie between.",
            "mm",
            (1.0, 25.0),
            0.1,
        ),
        "draw_ms": Words(
            "Drawing time",
            "From touching the string to letting it go. The note comes that much after the key; short is a flick, long lets "
            "the old sound be heard dying under the finger.",
            "ms",
            (1.0, 20.0),
            0.5,
        ),
        "finger_stiffness_n_mm": Words(
            "Finger stiffness",
            "How firmly the finger holds the string while it draws: flesh gives way, plectrum and nail do not.",
            "N/mm",
            (5.0, 500.0),
            0.1,
        ),
        "finger_loss": Words(
            "Finger loss",
            "What the finger takes from passing waves, in the string's own impedance: 2 takes most, 0 only holds it.",
            "× Z",
            (0.1, 5.0),
            0.05,
            travel=(0.0, 5.0),
        ),
        "slip_ms": Words(
            "Slip time",
            "Time in which the string slides off the finger. Partials above its inverse are left out: 0.1 a plectrum, 0.3 a "
            "nail, 1 and more soft flesh. 0 is at once.",
            "ms",
            (0.0, 3.0),
            0.05,
        ),
        "slip_hard_ms": Words(
            "Slip time, hard",
            "At the hardest pluck; softer ones lie between. Shorter when hard: loud notes become brighter.",
            "ms",
            (0.0, 3.0),
            0.05,
        ),
        "roughness_um": Words(
            "Roughness",
            "How far the finger jumps while it rubs along the string that it draws: the noise of a stroke.",
            "µm",
            (0.0, 20.0),
            0.5,
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
    },
    Output: {
        "kind": Words(
            "What is heard",
            "The string's force on the saddle (what drives a body), its displacement or velocity at a place, a magnetic "
            "pickup over it, or the body that all strings share.",
            setup=True,
        ),
        "position": Words(
            "Pickup at, from saddle",
            "Place of pickup or probe as a share of the open string; partials with a node there are not heard. 0 is the "
            "saddle itself.",
            "of L",
            (0.0, 0.4),
            0.001,
            setup=True,
        ),
        "distance_mm": Words(
            "Pickup distance",
            "From magnet to string at rest. Near, wide swings distort: the even harmonics of a growling pickup.",
            "mm",
            (1.0, 10.0),
            0.1,
            setup=True,
        ),
        "aperture_mm": Words(
            "Pickup aperture",
            "Length of string that the magnet sees; partials with a wave shorter than that are averaged away.",
            "mm",
            (5.0, 40.0),
            0.5,
        ),
        "gain_db": Words(
            "Level",
            "Of the whole instrument. Presets that come with the program are equally loud: −18 LUFS for a phrase at "
            "velocity 80.",
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
            "What all strings drive by their bridge, and what drives them: they beat, decay in two stages and ring with "
            "each other. They are heard through it alone, so that what is heard must be the body.",
        ),
    },
    MovingMode: {
        "frequency_hz": Words("Mode", "Where the body swings by itself.", "Hz", (60.0, 4000.0), 0.5),
        "q": Words("Q", "How narrow it is, and how long it rings: to −60 dB in 2.2·Q/f seconds.", "", (10.0, 60.0), 0.5),
        "mass_kg": Words(
            "Mass at the bridge",
            "What the strings have to move: the lighter, the louder, the shorter the notes near it, and the more they stray "
            "from their pitch.",
            "kg",
            (0.1, 3.0),
            0.01,
        ),
        "shape": Words(
            "Motion of the bridge",
            "Up and down, along the body across the strings, and rocking per metre from the bridge's middle.",
        ),
        "radiation": Words(
            "Radiation", "How much of its acceleration is heard; below 0, against the others.", "", (-2.0, 2.0), 0.1
        ),
        "pan": Words("Heard from", "−1 left, 1 right.", "", (-1.0, 1.0), 0.1),
    },
    Hand: {
        "place_mm": Words(
            "Places vary by",
            "From stroke to stroke the hand comes down here and there: standard deviation along the string.",
            "mm",
            (0.0, 10.0),
            0.1,
        ),
        "level_db": Words(
            "Levels vary by",
            "No two strokes are as strong, at the same velocity: standard deviation of how far the string is drawn.",
            "dB",
            (0.0, 3.0),
            0.05,
        ),
        "width_percent": Words(
            "Widths vary by",
            "More or less of the finger lies on the string from stroke to stroke: standard deviation.",
            "%",
            (0.0, 30.0),
            0.5,
        ),
        "time_percent": Words(
            "Times vary by",
            "Drawing the string and letting it go are quicker or slower from stroke to stroke: standard deviation.",
            "%",
            (0.0, 30.0),
            0.5,
        ),
        "vibrato_hz": Words(
            "Vibrato, rate", "How fast the modulation wheel (controller 1) shakes the string.", "Hz", (4.0, 7.0), 0.1
        ),
        "vibrato_cents": Words(
            "Vibrato, width",
            "How far the modulation wheel, full on, shakes it to either side; 0 is none.",
            "cents",
            (0.0, 60.0),
            1.0,
        ),
        "vibrato": Words("Vibrato, way", "A string over a fret can only be pulled sharp; over a board it goes both ways."),
        "meend_semitones": Words(
            "Pulled across the fret by",
            "Legato to a higher note of the same string pulls it aside by at most so much, as on a sitar, without a change "
            "of fret. 0: it is stopped at the next fret.",
            "semitones",
            (0.0, 5.0),
            0.5,
        ),
        "meend_ms": Words(
            "Pulled within", "Time constant in which it is pulled aside and let back.", "ms", (20.0, 300.0), 1.0
        ),
        "release": Words(
            "Finger at the end",
            "What is laid on a string when its note ends, beside the damping. It is begun in the file, as hand.release.",
        ),
    },
    Touch: {
        "place": Words(
            "Place, from saddle",
            "Where it lies, as a share of the speaking length: partials with a node there ring on, all others are damped.",
            "of L",
            (0.02, 0.98),
            0.001,
        ),
        "width_mm": Words("Width", "Length of string under the finger, palm or felt.", "mm", (2.0, 50.0), 0.5),
        "resistance": Words(
            "Resistance",
            "What it takes from passing waves, in the string's own impedance: 1 damps within some periods, 10 nearly stops "
            "the string there.",
            "× Z",
            (0.1, 20.0),
            0.05,
        ),
        "stiffness_n_mm": Words(
            "Stiffness", "How firmly it holds the string in its place; 0 only damps.", "N/mm", (0.0, 10.0), 0.01
        ),
        "lift_ms": Words(
            "Lifted after", "How long it lies there; without it, until the next stroke.", "ms", (10.0, 500.0), 1.0
        ),
    },
    Polarisation: {
        "detuning_cents": Words(
            "Second direction, detuned",
            "How much higher a string's motion at right angles is than its first: the two beat with each other.",
            "cents",
            (0.0, 3.0),
            0.1,
        ),
        "loss_ratio": Words("Second direction, loss", "How much faster it decays by itself.", "×", (0.8, 2.0), 0.05),
        "pluck_deg": Words(
            "Direction of the pluck",
            "From the string's first direction: 0 gives the body all at once, 90 little, for long.",
            "°",
            (0.0, 60.0),
            1.0,
        ),
        "nut_share": Words(
            "Second direction, nut",
            "How far the nut's resonances give way in it, as a share of what they do in the first: necks are stiffer along "
            "the board. Partials near a resonance then differ between the directions, and beat.",
            "",
            (0.0, 1.0),
            0.05,
        ),
        "heard": Words(
            "Second direction, heard",
            "Of strings on rigid ends: how much of it pickup or saddle hear, as a share of what they hear of the first.",
            "",
            (0.0, 0.6),
            0.05,
        ),
    },
    BodyMode: {
        "frequency_hz": Words("Peak", "Frequency of the resonance's maximum.", "Hz", (60.0, 5000.0), 1.0),
        "q": Words("Q", "How narrow and how long: it rings to −60 dB in 2.2·Q/f seconds.", "", (3.0, 100.0), 0.1),
        "gain_db": Words("Gain", "Of the peak, relative to the string's own sound.", "dB", (-40.0, 20.0), 0.5),
        "pan": Words(
            "Side",
            "From where it is heard: −1 left, 1 right. Several to both sides make the body wide.",
            "",
            (-0.7, 0.7),
            0.05,
        ),
    },
    Mapping_: {
        "polyphony": Words(
            "Polyphony",
            "How many strings may sound at once; beyond it the quietest is cut within 30 ms.",
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
    (Hand, "vibrato"): {"both": "both ways", "up": "up only"},
    (StringTable, "stiffness_law"): {"sqrt": "pinned stiff string", "linear": "1 + Bj²/2"},
    (Output, "kind"): {
        "force": "force on the saddle",
        "displacement": "displacement",
        "velocity": "velocity",
        "pickup": "magnetic pickup",
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
        "How far the bridge's curve reaches before the string's end. The longer, the more of the string can wrap it.",
        "mm",
        (2.0, 20.0),
        0.1,
        setup=True,
    ),
    "distance_ratio": Words(
        "Depth of the bridge, of the length",
        "The same as a share of the open string, so that strings of all lengths have the same bridge.",
        "of L",
        (0.002, 0.03),
        0.0001,
        setup=True,
    ),
    "jiva_um": Words(
        "Gap over the bridge",
        "How far the string at rest lies above the bridge's curve. 0 rests on it and buzzes most; above it only hard "
        "plucks touch; below 0 the string is pressed and the buzz dies.",
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
