"""Live sound: an engine behind an audio callback, players and instruments before it.

session, deck                               the whole of it; events in and meters out
desk, block, native                         compiled: shared memory, a block of sound, clocks
callback, portaudio                         outputs through PortAudio
jackcallback, jackclient, jackserver        outputs through JACK
midiports, midistream, keyboard, terminal   what is played on
player, songplayer, chase                   songs
drone, pegs, swara, dronefile               a tanpura that plays by itself
recorder, take                              what was played, as sound and as events
status, report, latency, ear                what it says of itself, and what is measured
"""
