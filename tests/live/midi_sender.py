"""A program with MIDI outputs of its own, through JACK. It reads commands, one a line, and answers each with "done":

open NAME            a port NAME of a client NAME
close NAME
send NAME [[…], …]   messages, one after the other
flood NAME COUNT PER_SECOND    note-ons whose key and velocity count up
"""

from __future__ import annotations

import json
import sys
import time

import rtmidi

ports: dict[str, rtmidi.MidiOut] = {}
print("ready", flush=True)
for line in sys.stdin:
    command, name, *rest = line.split(" ", 2)
    name = name.strip()
    if command == "open":
        ports[name] = rtmidi.MidiOut(rtmidi.API_UNIX_JACK, name)
        ports[name].open_virtual_port(name)
    elif command == "close":
        ports.pop(name).delete()
    elif command == "send":
        for message in json.loads(rest[0]):
            ports[name].send_message(message)
    elif command == "flood":
        count, per_second = map(int, rest[0].split())
        since = time.monotonic()
        for k in range(count):
            ports[name].send_message([0x90, k % 128, 1 + k // 128 % 127])
            if k % 50 == 49:  # never faster, to catch up neither
                time.sleep(max(0.0, since + 50 / per_second - time.monotonic()))
                since = time.monotonic()
    print("done", flush=True)
for each in ports.values():  # a server that waits for its clients waits for one that goes without a word, too
    each.delete()
