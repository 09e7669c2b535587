"""Where an instrument buzzes, and how to set it up.

plucking    a player's stroke at a note                places      the notes of an instrument, and what lies below each
note        a note under strokes of any strength       board_note  the same over a board without frets
audible     the measure of a buzz                      thresholds  the least displacement at which it is heard
buzz_map    every note of an instrument                report      a map as text and as rows
neck_picture   a map as a picture                      wants       a wish in words
adjustments    what a maker turns on a neck            lowest      the lowest set-up that keeps a wish
fretwork       high frets, from the heights of all     neck_faults what is wrong with a neck that buzzes
proposals      a wish answered                         longest     the bridge that buzzes longest
side_by_side   notes computed on several threads
"""

from importlib.util import find_spec


def missing() -> str | None:
    """Message that names a missing package; None: all are there."""
    return "a set-up needs scipy: pip install 'jawari[setup]'" if find_spec("scipy") is None else None
