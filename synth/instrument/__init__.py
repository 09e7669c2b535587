"""Instruments as files describe them, and what follows before anything sounds.

preset, presetfile   a preset: read, checked, written
setup_table, neck    the neck and its strings as a luthier measures them, and what that makes of one string
wires, fret_heights  strings by makers' names; measured heights of frets, from a file
catalogue            presets by family and tag
table, faults        what its tables have in common; what is wrong, in words
effects, excitations what a preset may name beside what it has
plan, calibration    rates and modes that a promised quality needs; qualities: their names
planfile             what was measured of a preset's own strings, in a file beside it
fingerprints         by what these strings are known again
place                where a note is played: string and fret
compile              strings, contacts and outputs as arrays
loudness_phrase      the phrase by which presets are made equally loud
check                whether it can be played, with the reason where it cannot
"""
