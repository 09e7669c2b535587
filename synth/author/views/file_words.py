"""The words of what is set in the file and not by a control of the page: tables, articulations, what modules add.

With `words` every key of a preset has its meaning.
"""

from __future__ import annotations

from synth.author.views.words import Words
from synth.instrument.articulations import Articulation, Controller
from synth.instrument.effects import EffectTable
from synth.instrument.excitations import ExcitationTable
from synth.instrument.preset import Preset
from synth.instrument.table import Table

FILE_WORDS: dict[type[Table], dict[str, Words]] = {
    Preset: {
        "format": Words("Format", "Version of the file format: 2. Files of format 1 can be read, too."),
        "tuning": Words("Tuning", "The pitches of the notes."),
        "setup": Words(
            "Setup",
            "The neck and the strings as a luthier measures them: it takes the place of the obstacle's action, relief, nut "
            "and heights, and of the strings' masses and diameters.",
        ),
        "obstacle": Words("Obstacle", "The obstacle under the strings; its kind decides which other keys it has."),
        "pluck": Words("Pluck", "How notes normally begin: the articulation normal."),
        "hand": Words("Hand", "How strokes vary, vibrato, pulls across the fret, the finger at a note's end."),
        "articulations": Words("Articulations", "Other ways to begin a note, each under a name of its own."),
        "excitation": Words(
            "Excitation",
            "How the hand starts a note, if not by plucking: an excitation that a module of your own adds.",
        ),
        "damping": Words("Damping", "The hand on the string after a note ends."),
        "output": Words("Output", "The signal taken from the strings, and its level."),
        "body": Words(
            "Body", "The body that the strings are fixed to: a filter on their sound, or modes that move with them."
        ),
        "effect": Words("Effects", "Effects after the body, in this order; modules of your own add them."),
        "mapping": Words("Mapping", "How many strings can sound at once, and what key pressure does."),
    },
    Articulation: {
        "key": Words(
            "Key", "The keyswitch that selects it until another is pressed; it lies below the notes that the strings play."
        ),
        "controller": Words(
            "Controller",
            "A controller that selects it while its value is in a range: a number (then 64 to 127), or a table of its own.",
        ),
        "velocity": Words(
            "Velocities",
            "[from, to]: velocities that play it if neither a key nor a controller has selected an articulation.",
        ),
        "stroke": Words("Stroke", "Drawn aside and let go (pluck), or hit by a mass thrown at the string (throw)."),
        "position": Words(
            "Plucked at",
            "Distance from the saddle as a share of the open string; if it is not given, that of the pluck.",
            "of L",
        ),
        "position_hard": Words(
            "Hardest pluck at", "The same for the hardest stroke; if it is not given, that of the pluck.", "of L"
        ),
        "displacement_ratio": Words("Displacement", "How much further the string is drawn than by the normal pluck.", "×"),
        "width_mm": Words(
            "Finger width", "Length of string under the finger or plectrum; if it is not given, that of the pluck.", "mm"
        ),
        "width_hard_mm": Words("Finger width, hard", "The same for the hardest stroke.", "mm"),
        "draw_ms": Words(
            "Drawing time", "Time from touching the string to releasing it; if it is not given, that of the pluck.", "ms"
        ),
        "slip_ms": Words("Slip time", "Time in which the string slides off; if it is not given, that of the pluck.", "ms"),
        "slip_hard_ms": Words("Slip time, hard", "The same for the hardest stroke.", "ms"),
        "roughness_um": Words(
            "Roughness",
            "How far the finger jumps while rubbing along the string; if it is not given, that of the pluck.",
            "µm",
        ),
        "rub_percent": Words(
            "Rubbing",
            "How unsteady the finger's force is as the string slides off; if it is not given, that of the pluck.",
            "%",
        ),
        "edge_mm": Words("Edge", "How far the string slides over it; if it is not given, that of the pluck.", "mm"),
        "grain_mm": Words("Grain", "Distance between its rough places; if it is not given, that of the pluck.", "mm"),
        "arrival": Words(
            "Arrival", "Speed with which the finger meets the string; if it is not given, that of the pluck.", "×"
        ),
        "knock_ratio": Words("Knock", "How much of the hand's knock on the body the stroke gives.", "×"),
        "mass_g": Words("Mass", "Mass of the thumb or hammer that hits the string.", "g"),
        "speed_m_s": Words("Speed", "Speed of the thumb or hammer at velocity 127.", "m/s"),
        "stiffness_n_mm": Words(
            "Stiffness of the hit",
            "Stiffness of the thumb or hammer where it meets the string; if it is not given, that of the finger.",
            "N/mm",
        ),
        "touch": Words("Touch", "A finger, palm or felt laid on the string as it is released."),
        "harmonic": Words(
            "Harmonics", "The key is the pitch that is heard: the string is touched at a node of that harmonic."
        ),
        "strum_ms": Words("Strum", "Delay between the strings of a chord, strummed up and down in turn.", "ms"),
        "slide_ms": Words("Slide", "Time per fret of a legato, which runs from fret to fret.", "ms"),
    },
    Controller: {
        "number": Words("Number", "The controller's number."),
        "low": Words("From", "Lowest value at which the articulation plays."),
        "high": Words("To", "Highest value at which it plays."),
    },
    EffectTable: {"kind": Words("Kind", "Name of the effect, as the module that adds it has registered it.")},
    ExcitationTable: {"kind": Words("Kind", "pluck, or the name that a module has registered.")},
}
