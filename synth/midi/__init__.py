"""MIDI: bytes, messages, files and ports, and the events that an engine understands.

events                  one event, and the live parameters it can set
controllers, programs   their numbers and names
zones                   which channels an MPE zone has
stream, sysex           bytes and system exclusive messages as they come
ports                   inputs by name, as they come and go
smf, song, messages     files; a song as one array of events; mido's objects
eventsource             where events come from, piece by piece
"""
