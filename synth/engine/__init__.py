"""The block engine: compiled presets and events in, samples out, the same for any block size and number of threads.

engine                                      the Python face
engine_settings, arguments, numbers         what a person chooses, what it is given otherwise
voices, expression                          who plays a note and who yields; bends, pressure
hands, strings, stroke, excite              what hands do to a string
coefficients, parameters                    what it is made of while they do, and what can be set
tasks, instruments                          what threads take: strings that share something are one instrument
advance, free_flight, output                a string through time
process, mix, chain, effect_chains          spans between events, buses, chains of effects
layout, bank, core, memory_map              the arrays that the native core works on, behind two addresses
team, uncopied, warmup                      threads; what cannot be copied; what is compiled at the start
"""
