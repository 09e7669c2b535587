"""What MIDI controllers and live parameters do, in words."""

from __future__ import annotations

from typing import NamedTuple


class ControllerWords(NamedTuple):
    """name: what MIDI calls it; meaning: what it does here."""

    name: str
    meaning: str


#: by number, of controllers that have a meaning of their own; any other may be bound to a live parameter or an articulation
CONTROLLERS: dict[int, ControllerWords] = {
    1: ControllerWords("modulation wheel", "Vibrato, as `[hand]` of the preset has it."),
    6: ControllerWords(
        "data entry",
        "Value of the registered parameter: 0 is the bend range in semitones, 6 begins an MPE zone of so many members.",
    ),
    7: ControllerWords("volume", "Level of the channel by the curve 40 log₁₀; 100, the power-up value, is unity."),
    10: ControllerWords("pan", "Where the channel is heard: 0 left, 64 middle, 127 right."),
    11: ControllerWords("expression", "Level of the channel beside its volume; 127 is unity."),
    38: ControllerWords("data entry, fine", "Cents of the bend range."),
    64: ControllerWords("sustain", "Strings that are let go ring on while it is at 64 or more."),
    68: ControllerWords(
        "legato", "From 64 on a note on a string that sounds is hammered on, pulled off or slid to, without a stroke."
    ),
    74: ControllerWords(
        "timbre", "In an MPE zone: where the next pluck is; above 64 towards the bridge, below towards the middle."
    ),
    98: ControllerWords("non-registered parameter, fine", "Ends the choice of a registered parameter."),
    99: ControllerWords("non-registered parameter", "Ends the choice of a registered parameter."),
    100: ControllerWords(
        "registered parameter, fine", "Chooses what data entry sets: with 101 at 0, 0 bend range, 6 MPE zone."
    ),
    101: ControllerWords("registered parameter", "Chooses what data entry sets, together with 100; only 0 has a meaning."),
    120: ControllerWords("all sound off", "Silences the channel at once, without a click."),
    121: ControllerWords(
        "reset all controllers",
        "Expression, pedals, bend, pressure, wheel and articulation as at the start; volume and pan stay.",
    ),
    123: ControllerWords("all notes off", "Lets all keys of the channel go; so do 124 to 127."),
}

#: of a live parameter, by its id
PARAMETERS: dict[str, str] = {
    "output.gain": "Level of the preset's sound, smoothed.",
    "pluck.position": "Where the next pluck is: 0.5 is the middle, soft; 0.05 by the bridge, bright.",
    "pluck.amount": "How far the next pluck draws the string aside, times what the preset says.",
    "pluck.width": "Width of the finger at the next pluck: a wide finger is dull.",
    "damping.release": "How long a string that is let go goes on, times what the preset says.",
    "obstacle.height": "Raises the bridge under the strings while they sound: the buzz (jawari); of presets with a bridge.",
    "hand.variation": "How much strokes vary, times what the preset says; of presets whose hand varies.",
}
