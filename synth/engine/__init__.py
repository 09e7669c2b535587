"""The block engine: compiled presets and events in, samples out, the same for any block size and number of threads.

engine                                      the Python face
arguments, snapshot, state_check            what it is given, and its state as bytes
events, notes, expression, zones            what a player does, and which string it is for
strings, coefficients, parameters           what hands do to a string
advance, flight, output                     a string through time
process, mix                                spans between events, buses, limiter
layout, bank, core                          the arrays that the native core works on, behind two addresses
team, atomics                               threads
"""
