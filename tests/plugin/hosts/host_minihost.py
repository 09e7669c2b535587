"""Minihost (PyPI) plays a job; see tools/plugin-hosts."""

import json
import sys
import time

import minihost
import numpy as np

job = json.loads(sys.argv[1])
block, frames = job["block"], job["frames"]
begun = time.perf_counter()
plugin = minihost.Plugin(job["plugin"], sample_rate=job["rate_hz"], max_block_size=block, in_channels=0, out_channels=2)
loaded = time.perf_counter()
for name, position in job.get("parameters", {}).items():
    plugin.set_param_by_name(name, position)
rows = [(frame, *data, *[0] * (3 - len(data))) for frame, data in job["messages"]]
out, at = np.zeros((2, frames), np.float32), 0
none = np.zeros((max(1, plugin.num_input_channels), block), np.float32)
for first in range(0, frames, block):
    events = []
    while at < len(rows) and rows[at][0] < first + block:
        events.append((rows[at][0] - first, *rows[at][1:]))
        at += 1
    if "transport" in job:  # (from frame, whether it plays, beat, quarter notes a minute)
        begin, playing, beat, tempo = max(row for row in job["transport"] if row[0] <= first)
        beat += playing * (first - begin) * tempo / (60.0 * job["rate_hz"])
        plugin.set_transport(tempo, position_samples=first, position_beats=beat, is_playing=playing)
    part = np.zeros((2, block), np.float32)
    plugin.process_midi(none, part, events)
    out[:, first : first + block] = part[:, : frames - first]
played = time.perf_counter()
np.save(job["out"], out.T)
state = plugin.get_state()
plugin.set_state(state)
said = {"load_s": loaded - begun, "play_s": played - loaded, "latency": plugin.latency_samples, "state": len(state)}
print(json.dumps(said | {"parameters": plugin.num_params}))
