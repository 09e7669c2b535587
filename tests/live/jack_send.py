"""Sends MIDI through JACK at frames told beforehand; see `jackkit.Sender`."""

import gc
import json
import sys
import threading

import jack

#: from the moment that the port is connected to frame 0 [s]
AHEAD_S = 0.2

wanted = json.loads(sys.argv[1])
rows = [(frame, bytes(message)) for frame, message in wanted["rows"]]
client = jack.Client("sender", no_start_server=True, servername=wanted["server"])
port = client.midi_outports.register("out")
times = []
begin = None
go = threading.Event()
sent = threading.Event()


@client.set_process_callback
def process(frames):
    global begin
    port.clear_buffer()
    now = client.last_frame_time
    if go.is_set() and begin is None:
        begin = now + int(AHEAD_S * client.samplerate)
    while begin is not None and len(times) < len(rows):
        frame, message = rows[len(times)]
        offset = (begin + frame - now) & 0xFFFFFFFF
        if offset >= frames:
            if offset < 0x80000000:
                break
            offset = 0  # JACK's time went on without us
        port.write_midi_event(offset, message)
        times.append((now + offset) & 0xFFFFFFFF)
    if len(times) == len(rows):
        sent.set()


gc.collect()
gc.disable()
client.activate()
client.connect(port, wanted["port"])
print("ready", flush=True)
go.set()
sent.wait()
print("sent", flush=True)
sys.stdin.readline()
client.deactivate()
with open(wanted["file"], "w", encoding="utf-8") as file:
    json.dump(times, file)
client.close()
