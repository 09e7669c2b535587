"""Puts the third byte of each MIDI message into an audio port, at its frame, until it reads a line."""

import sys

import jack
import numpy as np

client = jack.Client("echo", no_start_server=True, servername=sys.argv[1])
heard = client.midi_inports.register("in")
out = client.outports.register("out")


@client.set_process_callback
def process(frames):
    samples = np.frombuffer(out.get_buffer(), np.float32)
    samples[:] = 0.0
    for offset, message in heard.incoming_midi_events():
        samples[offset] = bytes(message)[2]


client.activate()
print("ready", flush=True)
sys.stdin.readline()
client.deactivate()
client.close()
