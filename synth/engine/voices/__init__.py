"""Voice policy: who plays a note and who yields. It decides; what is done to a string it asks of a responder.

voice_table       what the policy sees, behind one address, and what it may ask
channels          what holds on a channel: its zone, pedal, legato, part, timbre
switching         which articulation a note has
choice            the place where a note is played
harmonics         …and where it is touched
strumming         chords whose strings follow each other
slurring          notes without a stroke
stealing          who yields where as many sound as may
notes             beginning, holding, ending notes
retuning          pitches of keys, live parameters
mpe               zones
control_changes   controllers
policy            from an event to all these, and the address of that

Nothing here knows of strings' motion: of `engine` only `layout` is imported.
"""
