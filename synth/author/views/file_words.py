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
        "format": Words("Format", "Version of the file's form: 2. Files of format 1 are read, too."),
        "tuning": Words("Tuning", "What pitch a note has."),
        "obstacle": Words("Obstacle", "What lies under the strings; its kind decides which other keys it has."),
        "pluck": Words("Pluck", "How notes begin as a rule: the articulation normal."),
        "hand": Words("Hand", "How strokes vary, vibrato, pulls across the fret, the finger at a note's end."),
        "articulations": Words("Articulations", "Other ways to begin a note, each under a name of its own."),
        "excitation": Words(
            "Excitation",
            "What the hand does at the start of a note, where it does not pluck: of a kind that a module of yours adds.",
        ),
        "damping": Words("Damping", "The hand on the string after a note ends."),
        "output": Words("Output", "What is heard of the strings, and how loud."),
        "body": Words("Body", "What the strings are fixed to: a filter on their sound, or modes that move with them."),
        "effect": Words("Effects", "What the sound goes through behind the body, in this order; modules of yours add them."),
        "mapping": Words("Mapping", "How many strings may sound at once, and what pressure on the keys does."),
    },
    Articulation: {
        "key": Words("Key", "The key that switches to it until another does; it lies below the notes that strings play."),
        "controller": Words(
            "Controller",
            "A controller while which is in a range it plays: a number (then 64 to 127), or a table of its own.",
        ),
        "velocity": Words("Velocities", "[from, to]: velocities that play it where neither key nor controller has chosen."),
        "stroke": Words("Stroke", "Drawn aside and let go (pluck), or hit by a mass that flies at the string (throw)."),
        "position": Words(
            "Plucked at", "Distance from the saddle as a share of the open string; without it that of the pluck.", "of L"
        ),
        "position_hard": Words("Hardest pluck at", "The same of the hardest stroke; without it that of the pluck.", "of L"),
        "displacement_ratio": Words("Displacement", "How much further the string is drawn than by the normal pluck.", "×"),
        "width_mm": Words("Finger width", "Length of string under what plucks; without it that of the pluck.", "mm"),
        "width_hard_mm": Words("Finger width, hard", "The same of the hardest stroke.", "mm"),
        "draw_ms": Words("Drawing time", "From touching the string to letting it go; without it that of the pluck.", "ms"),
        "slip_ms": Words("Slip time", "Time in which the string slides off; without it that of the pluck.", "ms"),
        "slip_hard_ms": Words("Slip time, hard", "The same of the hardest stroke.", "ms"),
        "roughness_um": Words(
            "Roughness", "How far the finger jumps while it rubs along the string; without it that of the pluck.", "µm"
        ),
        "mass_g": Words("Mass", "Of what is thrown: a thumb, a hammer.", "g"),
        "speed_m_s": Words("Speed", "Of what is thrown, at velocity 127.", "m/s"),
        "stiffness_n_mm": Words(
            "Stiffness of what hits", "Of what is thrown, where it meets the string; without it that of the finger.", "N/mm"
        ),
        "touch": Words("Touch", "A finger, palm or felt that is laid on as the string is let go."),
        "harmonic": Words(
            "Harmonics", "The key is the pitch that is heard: the string is touched where that harmonic rests."
        ),
        "strum_ms": Words("Strum", "Strings of a chord follow each other by so much, up and down in turn.", "ms"),
        "slide_ms": Words("Slide", "Legato goes from fret to fret, each taking so long.", "ms"),
    },
    Controller: {
        "number": Words("Number", "The controller's number."),
        "low": Words("From", "Lowest value at which the articulation plays."),
        "high": Words("To", "Highest value at which it plays."),
    },
    EffectTable: {"kind": Words("Kind", "Name of the effect, as the module that adds it has registered it.")},
    ExcitationTable: {"kind": Words("Kind", "pluck, or the name that a module has registered.")},
}
