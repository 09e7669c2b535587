"""Where an instrument buzzes, and how to set it up.

strokes     a player's stroke at a note                places      the notes of an instrument, and what lies below each
note        a note under strokes of any strength       board_note  the same over a board without frets
audible     the measure of a buzz                      thresholds  the least displacement at which it is heard
buzz_map    every note of an instrument                report      a map as text and as rows
"""
