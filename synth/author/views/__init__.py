"""What the authoring page shows, as plain functions from a preset to JSON-able data. No module here knows of a server.

parameters   every setting of the format: range, unit, default, the physics in a sentence
instrument   the string and what lies under it, to scale, with what dragging changes
body_peaks   the modes of a body that strings share, as peaks of its mobility
begin_body   a body to begin with
motion       the string as the engine moves it, in slow motion, with the forces of contact
analysis     wave, spectrogram, partials against the model, contacts, the formant of the buzz
cost         what the plan costs and promises
reference    the sound against that of a converged run
"""
