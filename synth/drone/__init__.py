"""A tanpura that plays by itself.

swara, pegs     the notes of Indian music as ratios, and a preset tuned to them
cycle           when which string is plucked, and how, for as long as one likes
dronefile       written to a file
tanpura_keys    changed from a terminal while it sounds
"""
