"""Offline music: MIDI and tunings in, audio files or arrays out.

smf, messages, sysex                  files and messages as they are written
midi                                  a song as one array of events
scala                                 tunings
parts, programs, bindings, compass    which preset plays what, with which controllers, and what becomes of the rest
render, memory                        one render job, to files or to arrays
offline, eventsource                  its loop
audiofile                             WAV and FLAC that appear whole or not at all
"""
