"""Plays events by PortAudio's default output, in a process of its own: play_events.py {"block": …, "rate": …, "rows": […],
"seconds": …, "busy": …, "send": …, "ahead": …, "file": …}. Says "open", waits for a line, plays, keeps what the engine was
given."""

from __future__ import annotations

import gc
import json
import sys
import threading
import time

import numpy as np

from synth import Engine, load_preset
from synth.live.deck import Deck
from synth.live.portaudio import open_output
from synth.midi.events import make_events


def _keep_busy(stop: threading.Event) -> None:
    """What a page, a status line and garbage could do to an interpreter."""
    while not stop.is_set():
        junk = [[i] for i in range(20000)]
        for each in junk:
            each.append(junk)
        del junk
        gc.collect()


def main() -> None:
    job = json.loads(sys.argv[1])
    engine = Engine([load_preset("tanpura-light")], quality="draft")
    engine.prepare(job["rate"], job["block"])
    deck = Deck(engine, record=True, ahead=job["ahead"], ahead_block=job["block"])
    output = open_output(deck, None, job["rate"], job["block"])
    print("open", flush=True)
    sys.stdin.readline()
    stop = threading.Event()
    if job["busy"]:
        threading.Thread(target=_keep_busy, args=(stop,)).start()
    if not job["send"]:
        deck.schedule(make_events(job["rows"]))
    output.start()
    begin = time.monotonic()
    if job["send"]:
        for frame, *event in job["rows"]:
            time.sleep(max(0.0, begin + frame / job["rate"] - time.monotonic()))
            deck.send(*event)
    time.sleep(max(0.0, begin + job["seconds"] - time.monotonic()))
    stop.set()
    output.stop()
    output.close()
    deck.close()
    np.savez(job["file"], events=deck.drain_events())


if __name__ == "__main__":
    main()
