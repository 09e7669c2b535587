"""Pedalboard (PyPI) plays a job; see tools/plugin-hosts."""

import json
import sys
import time

import numpy as np
import pedalboard

job = json.loads(sys.argv[1])
begun = time.perf_counter()
# it plays C4 to an instrument when it has loaded or reset it, and waits so long for a sound; not every preset has a C4
plugin = pedalboard.load_plugin(job["plugin"], initialization_timeout=0.1)
loaded = time.perf_counter()
rate_hz = job["rate_hz"]
messages = [(bytes(data), (frame + 0.5) / rate_hz) for frame, data in job["messages"]]
seconds = job["frames"] / rate_hz
out = plugin.process(messages, duration=seconds, sample_rate=rate_hz, num_channels=2, buffer_size=job["block"])
played = time.perf_counter()
np.save(job["out"], out.T)
state = plugin.raw_state
plugin.raw_state = state
said = {"load_s": loaded - begun, "play_s": played - loaded, "latency": None, "state": len(state)}
print(json.dumps(said | {"parameters": len(plugin.parameters)}))
