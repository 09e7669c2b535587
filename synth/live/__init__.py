"""Live sound: an engine behind an audio callback, players and keyboards before it.

session, deck                               the whole of it; events in and meters out
exchange, render_block                      compiled: shared memory, a block of sound
callback, portaudio                         outputs through PortAudio
jackcallback, jackclient, jackserver        outputs through JACK
keyboard, terminal                          played on the computer's keys
player, songplayer, chase                   songs
recorder, take                              what was played, as sound and as events
status, report, latency, ear                what it says of itself, and what is measured
"""
