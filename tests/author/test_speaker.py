"""The server's own output, on a real sound server: what comes out is, bit for bit, the offline render."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from synth import load_preset
from synth.author.phrases import phrase
from synth.author.speaker import LEAD_S
from tests.live.conftest import StartServer, jack_server
from tests.live.jackkit import Capture

from .conftest import Serve
from .test_sound import offline

__all__ = ["jack_server"]
PORTS = ("PortAudio:out_0", "PortAudio:out_1")
RATE_HZ = 44100


def place_of(heard: np.ndarray, expected: np.ndarray) -> int | None:
    """Frame of `expected` (frames, 2) at which all of `heard` stands; None: nowhere."""
    for at in np.flatnonzero((expected[: len(expected) - len(heard)] == heard[0]).all(axis=1)):
        if np.array_equal(expected[at : at + len(heard)], heard):
            return int(at)
    return None


def test_a_phrase_through_the_servers_output(jack_server: StartServer, serve: Serve, tmp_path: Path) -> None:
    jack = jack_server(256, sync=True)
    server = serve(env=jack.env)
    output = server.get("/api/session")["outputs"][1]
    assert output["available"] and output["reason"] is None and "JACK" in output["label"]
    preset = load_preset("tanpura-light")
    events = phrase("drone", preset, 36, 100, RATE_HZ).events
    # as late in a stream as here: a body's filter rounds by where in a block of the engine a note begins
    events["frame"] += round(LEAD_S * RATE_HZ)
    expected = offline(preset, events, 4 * RATE_HZ)
    doc = server.open("tanpura-light")
    with doc.connect() as page:
        page.send("output", id="server")
        capture = Capture(jack, PORTS, tmp_path)
        page.send("audition", phrase="drone", note=36, velocity=100)
        page.until("load")
        page.until("load")
        page.until("load")
        page.send("stop")
        page.until("stopped")
        recorded = capture.stop()
    sounding = np.flatnonzero(np.any(recorded.samples != 0.0, axis=0))
    assert sounding.size > RATE_HZ // 2, "next to nothing was captured"
    # the recorder connects while it sounds already, and the stream ends somewhere in a block
    heard = recorded.samples.T[sounding[0] + 512 : sounding[-1] - 512]
    assert place_of(heard, expected) is not None


def test_keys_and_the_way_back_to_the_browser(jack_server: StartServer, serve: Serve) -> None:
    server = serve(env=jack_server(256).env)
    with server.open("jawari-harp").connect() as page:
        page.send("output", id="server")
        for key in (60, 64, 67):
            page.send("note_on", key=key, velocity=100)
        page.until("load")
        for key in (60, 64, 67):
            page.send("note_off", key=key)
        page.until("stopped")  # by itself, when the strings have faded
        page.send("output", id="browser")
        page.send("audition", phrase="note", note=60, velocity=100)
        assert page.until("audio")["rate_hz"] == RATE_HZ


def test_without_an_output_the_reason_is_said(serve: Serve) -> None:
    server = serve()
    output = server.get("/api/session")["outputs"][1]
    if output["available"]:
        pytest.skip("this machine has an audio output")
    with server.open("tanpura-light").connect() as page:
        page.send("output", id="server")
        page.send("audition", phrase="note", note=48, velocity=100)
        assert page.until("error")["message"] == output["reason"]
        page.send("output", id="browser")
        page.send("audition", phrase="note", note=48, velocity=100)
        page.until("audio")
