"""jalv (Debian) plays a job on a JACK server that runs as fast as it can; see tools/plugin-hosts."""

import json
import os
import subprocess
import sys
import threading
import time

import jack
import numpy as np

job = json.loads(sys.argv[1])
frames, block = job["frames"], job["block"]
client = jack.Client("sends", servername=os.environ["JACK_DEFAULT_SERVER"], no_start_server=True)
midi, left, right = client.midi_outports.register("midi"), client.inports.register("l"), client.inports.register("r")
heard = np.zeros((2, frames + 4 * block), np.float32)
go, done = threading.Event(), threading.Event()
at, row = 0, 0


@client.set_process_callback
def process(count: int) -> None:
    global at, row
    midi.clear_buffer()
    if not go.is_set():
        return
    if at + count > heard.shape[1]:
        done.set()
        return
    while row < len(job["messages"]) and job["messages"][row][0] < at + count:
        midi.write_midi_event(job["messages"][row][0] - at, bytes(job["messages"][row][1]))
        row += 1
    heard[0, at : at + count], heard[1, at : at + count] = left.get_array(), right.get_array()
    at += count


client.activate()
begun = time.perf_counter()
jalv = subprocess.Popen(
    ["jalv", "-n", "jalv-plays", job["plugin"]], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
)
while len(ports := [port.name for port in client.get_ports("jalv-plays:.*")]) < 3:
    if jalv.poll() is not None:
        raise SystemExit(f"jalv ended: {jalv.stdout.read().decode()}")
    time.sleep(0.005)
loaded = time.perf_counter()
client.connect(midi, next(name for name in ports if "events" in name))
client.connect(next(name for name in ports if name.endswith("left")), left)
client.connect(next(name for name in ports if name.endswith("right")), right)
time.sleep(0.2)
client.set_freewheel(True)
begun_playing = time.perf_counter()
go.set()
assert done.wait(120), "jalv does not play on"
played = time.perf_counter()
client.set_freewheel(False)
client.deactivate()
client.close()
jalv.terminate()
jalv.wait(10)
np.save(job["out"], heard.T)
said = {"load_s": loaded - begun, "play_s": played - begun_playing, "latency": None, "state": None, "parameters": None}
print(json.dumps(said))
