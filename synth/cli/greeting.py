"""`synth` without anything: what to try first, and where the rest is."""

from __future__ import annotations

import argparse
import sys

from synth._version import __version__
from synth.cli import colours

#: what is typed, and what comes of it
TRY = (
    ("synth render song.mid", "a MIDI file becomes song.wav"),
    ("synth play -p tanpura", "play live: MIDI keyboard, or the computer's keys"),
    ("synth author tanpura", "see, hear and shape an instrument in the browser"),
)
REST = """\
No song at hand?   synth drone -o drone.wav --duration 30
Instruments:       synth presets
What works here:   synth doctor
All commands:      synth --help, and synth COMMAND --help for one"""


def greet(options: argparse.Namespace) -> int:
    """Print the greeting."""
    width = max(len(typed) for typed, _ in TRY)
    print(f"jawari {__version__}: strings that collide. Three things to try:\n")
    for typed, what in TRY:
        print(f"  {colours.shown(typed.ljust(width), colours.STRONG, sys.stdout)}   {what}")
    print(f"\n{REST}")
    return 0
