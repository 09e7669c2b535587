"""Numbers of MIDI controllers that the program itself sends (MIDI 1.0 Detailed Specification, table 3)."""

EXPRESSION = 11
SUSTAIN = 64
ALL_SOUND_OFF = 120
RESET_CONTROLLERS = 121
ALL_NOTES_OFF = 123
