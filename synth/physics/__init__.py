"""Strings and what lies under them, in SI units: descriptions, and what follows from them. No sample rate, no kernel.

string       a stiff, lossy string and the resonances of what holds its end
modes        its frequencies, decay rates and shapes, and how far it gives way where it is pressed
tuning       the tension that gives it its pitch
tail         what the modes left out do at the contacts
body_modes   the body that strings share, as modes of its bridge
coupled      strings on a body: the exact linear system and its complex modes
obstacle     points under it: bridges, threads, frets
excitation   plucks as modal amplitudes
"""
