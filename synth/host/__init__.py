"""Offline music: a song and its instruments in, audio files or arrays out.

scala                                 tunings
parts, bindings, compass              which preset plays what, with which controllers, and what becomes of the rest
control_words                         controllers and live parameters in words
render, memory                        one render job, to files or to arrays
offline                               its loop
string_tape, frames_tape, contacts    what strings do while they sound, step by step and frame by frame, and how they touch
rest, soundfont                       what a SoundFont plays beside the strings
audiofile                             WAV and FLAC that appear whole or not at all
"""
