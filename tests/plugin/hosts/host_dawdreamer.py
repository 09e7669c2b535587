"""DawDreamer (PyPI) plays a job; see tools/plugin-hosts."""

import json
import struct
import sys
import time
from pathlib import Path

import dawdreamer
import numpy as np


def quantity(value: int) -> bytes:
    """A number as MIDI files have it, seven bits a byte."""
    out = bytes([value & 127])
    while value := value >> 7:
        out = bytes([128 | (value & 127)]) + out
    return out


job = json.loads(sys.argv[1])
# two ticks a frame, each message at an odd one: no rounding moves it to another frame
ticks, last = round(job["rate_hz"] / 2), 0
track = b"\x00\xff\x51\x03" + (250_000).to_bytes(3, "big")
for frame, data in job["messages"]:
    track += quantity(2 * frame + 1 - last) + bytes(data)
    last = 2 * frame + 1
track += b"\x00\xff\x2f\x00"
song = Path(job["out"]).with_suffix(".mid")
song.write_bytes(b"MThd" + struct.pack(">IHHH", 6, 0, 1, ticks) + b"MTrk" + struct.pack(">I", len(track)) + track)

engine = dawdreamer.RenderEngine(job["rate_hz"], job["block"])
begun = time.perf_counter()
plugin = engine.make_plugin_processor("plugin", job["plugin"])
loaded = time.perf_counter()
plugin.load_midi(str(song), clear_previous=True, beats=False, all_events=True)
engine.load_graph([(plugin, [])])
engine.render(job["frames"] / job["rate_hz"])
played = time.perf_counter()
np.save(job["out"], engine.get_audio().T)
parameters = len(plugin.get_parameters_description())
said = {"load_s": loaded - begun, "play_s": played - loaded, "latency": plugin.get_latency_samples(), "state": None}
print(json.dumps(said | {"parameters": parameters}))
