"""Records JACK ports into an .npz; see `jackkit.Capture`. Nothing else runs in this process, and memory is there before."""

import gc
import json
import sys
import threading
import time

import jack
import numpy as np

wanted = json.loads(sys.argv[1])
client = jack.Client("capture", no_start_server=True, servername=wanted["server"])
inputs = [client.inports.register(f"in_{number}") for number in range(len(wanted["ports"]))]
samples = np.zeros((len(inputs), int(wanted["seconds"] * client.samplerate)), np.float32)
periods = []
at = 0
gone = threading.Event()


@client.set_process_callback
def process(frames):
    global at
    if at + frames <= samples.shape[1]:
        periods.append((client.last_frame_time, at))
        for row, port in zip(samples, inputs, strict=True):
            row[at : at + frames] = np.frombuffer(port.get_buffer(), np.float32)
        at += frames


@client.set_shutdown_callback
def shutdown(status, reason):
    gone.set()


def connect():
    missing = dict(zip(wanted["ports"], inputs, strict=True))
    while missing and not gone.is_set():
        # asked for first: the library prints every connection that fails, and who reads may let the pipe run full
        there = {port.name for port in client.get_ports()}
        for name in missing.keys() & there:
            try:
                client.connect(name, missing[name])
            except jack.JackError:
                continue
            del missing[name]
        time.sleep(0.005)
    begun = at
    while at < min(begun + 2 * client.blocksize, samples.shape[1]) and not gone.is_set():
        time.sleep(0.001)  # until a whole period has come through the connections
    print("connected", flush=True)


jack.set_error_function(lambda text: None)  # ports that are not there yet
gc.collect()
gc.disable()
client.activate()
print("ready", flush=True)
threading.Thread(target=connect, daemon=True).start()
sys.stdin.readline()
if not gone.is_set():
    client.deactivate()
times, places = np.array(periods, np.int64).reshape(-1, 2).T
np.savez(wanted["file"], samples=samples[:, :at], times=times, places=places)
sys.stdout.flush()
if not gone.is_set():
    client.close()
