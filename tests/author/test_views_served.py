"""Views and jobs at the server: what is computed, what is kept, what is ended."""

from __future__ import annotations

import io
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

from synth.author.beside import ComputeProcess, compute
from synth.author.jobs import Job, Jobs, Progress
from synth.author.views import instrument, motion, parameters
from synth.instrument.preset import PresetError, load_preset
from tests.patience import until

from .conftest import Serve
from .serverkit import Doc, Server


def finished(server: Server, job: str) -> dict[str, object]:
    return until(lambda: (found := server.get(f"/api/jobs/{job}"))["state"] != "running" and found)


def test_controls_and_drawing(server: Server) -> None:
    doc = server.open("tanpura-light")
    assert server.get(f"{doc.path}/parameters") == parameters.describe(load_preset("tanpura-light"))
    assert server.get(f"{doc.path}/instrument?note=48") == instrument.draw(load_preset("tanpura-light"), 48)
    doc.set("pluck.position", 0.2)
    changed = load_preset("tanpura-light").with_setting("pluck.position", "0.2")
    assert server.get(f"{doc.path}/instrument?note=48") == instrument.draw(changed, 48)
    assert server.get(f"{doc.path}/instrument?note=48&which=saved") == instrument.draw(load_preset("tanpura-light"), 48)
    doc.do("revert")


@pytest.mark.parametrize(
    ("view", "some"),
    [
        ("motion?note=48&velocity=100&seconds=0.02&frames=20&start_s=0.01", "frames"),
        ("analysis?note=48&velocity=100&seconds=0.5", "partials"),
        ("cost?note=48&velocity=100", "real_time_factor"),
    ],
)
def test_what_is_asked_for_again_is_kept(server: Server, view: str, some: str) -> None:
    doc = server.open("tanpura-light")
    first = server.get(f"{doc.path}/{view}")
    assert some in first
    assert server.get(f"{doc.path}/{view}") == first  # a cost measured anew would differ
    assert len(server.client.get(f"{doc.path}/{view}").content) < 500_000


@pytest.mark.parametrize(
    ("view", "status", "words"),
    [
        ("instrument", 400, "note: missing"),
        ("instrument?note=49", 422, "no string plays C#3"),
        ("instrument?note=300", 400, "note: must be a whole number from 0 to 127"),
        ("motion?note=48&frames=1", 400, "frames must lie between"),
        ("analysis?note=48&seconds=1000", 400, "seconds must lie between"),
        ("cost?note=48&which=x", 400, "current or saved"),
    ],
)
def test_views_that_there_are_not(server: Server, view: str, status: int, words: str) -> None:
    assert words in server.get(f"{server.open('tanpura-light').path}/{view}", status)["error"]


def test_the_body_and_one_to_begin_with(server: Server) -> None:
    assert server.get(f"{server.open('tanpura-light').path}/body") == {"coupled": False}
    guitar = server.open("steel-guitar")
    assert [mode["index"] for mode in server.get(f"{guitar.path}/body")["modes"]] == list(range(13))
    assert server.get(f"{guitar.path}/begin-body")["edits"] is None


def test_a_measured_mobility(server: Server) -> None:
    """In dB of what the table has, per axis; what is broken is refused with file and row."""

    def sent(text: str, name: str = "my bridge.csv") -> tuple[int, dict[str, Any]]:
        answer = server.client.post("/api/mobility", params={"name": name}, content=text.encode())
        return answer.status_code, answer.json()

    rows = "".join(f"{hz},1e-3,0,1e-5,0\n" for hz in range(50, 5050))
    status, found = sent(f"frequency_hz,y11_re,y11_im,y12_re,y12_im\n{rows}")
    assert status == 200 and found["name"] == "my bridge.csv" and list(found["axes"]) == ["normal"]
    assert len(found["hz"]) == len(found["axes"]["normal"]) == 2000 and found["hz"][0] == 50.0
    assert set(found["axes"]["normal"]) == {-60.0}
    status, found = sent("frequency_hz,y11_re,y11_im\n1,2\n", "../other.csv")
    assert status == 400 and found["error"].startswith("other.csv: row 2 must have 3 columns")
    status, found = sent("")
    assert status == 400 and "is empty" in found["error"]


def test_the_reference(server: Server) -> None:
    doc = server.open("tanpura-light")
    job = doc.do("reference", note=48, velocity=100, seconds=0.3)["job"]
    found = finished(server, job)
    assert found["state"] == "done" and found["progress"] == 1.0, found
    assert isinstance(found["result"], dict) and 0.0 < found["result"]["e"] < 0.5


def test_the_reference_is_cancelled(server: Server) -> None:
    doc = server.open("fretted-bass")
    job = doc.do("reference", note=28, velocity=100, seconds=20)["job"]
    answer = server.client.delete(f"/api/jobs/{job}")
    assert answer.status_code == 200
    assert finished(server, job)["state"] == "cancelled"


def test_a_second_reference_ends_the_first(server: Server) -> None:
    doc = server.open("fretted-bass")
    first = doc.do("reference", note=28, velocity=100, seconds=20)["job"]
    second = doc.do("reference", note=33, velocity=100, seconds=20)["job"]
    assert finished(server, first)["state"] == "cancelled"
    server.client.delete(f"/api/jobs/{second}")
    assert finished(server, second)["state"] == "cancelled"


def test_jobs_that_there_are_not(server: Server) -> None:
    doc = server.open("tanpura-light")
    assert "no such job" in server.get("/api/jobs/none", 404)["error"]
    assert "no such job" in doc.do("apply-fit", 404, job="none")["error"]
    job = doc.do("reference", note=49, velocity=100, seconds=1)["job"]
    found = finished(server, job)
    assert found["state"] == "failed" and "no string plays" in str(found["error"])
    assert "no fit to apply" in doc.do("apply-fit", 409, job=job)["error"]


def recording(server: Server, doc: Doc, **query: object) -> bytes:
    answer = server.client.get(f"{doc.path}/sound.wav", params=query)
    assert answer.status_code == 200
    return answer.content


def fitted(server: Server, doc: Doc, data: bytes, string: int) -> tuple[str, dict[str, object]]:
    answer = server.client.post("/api/fit", params={"doc": doc.key, "string": string}, content=data)
    assert answer.status_code == 200, answer.text
    job = answer.json()["job"]
    return job, finished(server, job)


def test_a_fit_fills_the_controls(server: Server) -> None:
    """A bass string's own sound, plucked elsewhere: a string that is fitted to it is the same again, in one step of undo."""
    doc = server.open("fretted-bass")
    doc.set("obstacle", {"kind": "none"})
    doc.set("pluck.position", 0.14)
    sound = recording(server, doc, phrase="note", note=33, velocity=60, seconds=4)
    doc.do("revert")
    before = doc.state["text"]
    job, found = fitted(server, doc, sound, 1)
    assert found["state"] == "done", found
    result = found["result"]
    assert isinstance(result, dict) and result["f0_hz"] == pytest.approx(55.0, rel=5e-3)  # in tune with its frets
    state = doc.do("apply-fit", job=job)
    assert {row["path"] for row in result["settings"] if row["value"] is not None} <= set(state["set"])
    assert state["text"] != before and state["undo_label"] == "fit"
    assert doc.do("undo")["text"] == before


def test_a_fit_is_for_the_string_it_was_made_for(server: Server) -> None:
    """Not for another preset, nor for a string that has taken its place; where others of its values have been edited since,
    the settings are those of the string as it is now."""
    doc, other = server.open("fretted-bass"), server.open("tanpura-light")
    doc.do("revert")
    before = doc.state["text"]
    sound = recording(server, doc, phrase="note", note=33, velocity=60, seconds=3)
    job, found = fitted(server, doc, sound, 1)
    assert found["state"] == "done", found
    text = other.state["text"]
    assert "fitted to another preset" in other.do("apply-fit", 409, job=job)["error"]
    assert other.state["text"] == text

    doc.set("string.1.length_m", 0.7)
    shorter = doc.state["data"]["string"][1]
    doc.do("apply-fit", job=job)
    fit = doc.state["data"]["string"][1]
    assert fit["length_m"] == shorter["length_m"] == 0.7
    shown = {row["path"]: row["value"] for row in found["result"]["settings"]}  # type: ignore[index]
    assert fit["viscoelastic_loss"] != pytest.approx(shown["string.1.viscoelastic_loss"], rel=0.01)
    doc.do("undo")
    doc.do("undo")

    strings = doc.state["data"]["string"]
    doc.set("string.1.name", "B")
    renamed = doc.state["text"]
    assert "replaced or moved since" in doc.do("apply-fit", 409, job=job)["error"]
    assert doc.state["text"] == renamed
    doc.do("undo")
    assert doc.state["data"]["string"] == strings and doc.state["text"] == before


@pytest.mark.parametrize("kind", ["text", "silence", "noise"])
def test_recordings_that_cannot_be_fitted(server: Server, kind: str) -> None:
    samples = np.random.default_rng(1).normal(0.0, 0.1, 44100) if kind == "noise" else np.zeros(44100)
    buffer = io.BytesIO()
    soundfile.write(buffer, samples, 44100, format="WAV")
    data = b"not a recording" if kind == "text" else buffer.getvalue()
    _, found = fitted(server, server.open("tanpura-light"), data, 0)
    assert found["state"] == "failed"
    assert "\n" not in str(found["error"]) and len(str(found["error"])) > 10


def test_a_fit_for_a_string_that_is_not_there(server: Server) -> None:
    doc = server.open("tanpura-light")
    for query, status in ((f"doc={doc.key}&string=4", 400), (f"doc={doc.key}&string=-1", 400), ("doc=none&string=0", 404)):
        assert server.client.post(f"/api/fit?{query}", content=b"x").status_code == status


def run(work: Callable[[Progress], object]) -> Job:
    job = Job("a test")
    job.run(work, lambda made: made)
    return job


def test_what_a_job_says() -> None:
    assert run(lambda progress: progress(0.5)).as_dict() == {"state": "done", "progress": 1.0, "result": True}
    assert run(lambda progress: float("nan")).as_dict()["state"] == "failed"

    def fails(progress: Progress) -> None:
        progress(0.25)
        raise ValueError("two\nlines")

    assert run(fails).as_dict() == {"state": "failed", "progress": 0.25, "error": "two lines"}


def test_jobs_are_forgotten_in_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("synth.author.jobs.KEPT", 3)
    jobs = Jobs()
    try:
        made = [jobs.start(f"job {number}", lambda progress: time.sleep(0.01)) for number in range(5)]
        with pytest.raises(KeyError):
            jobs[made[0].id]
        assert jobs[made[4].id] is made[4]
    finally:
        jobs.close()


def test_the_process_of_the_views_is_started_again() -> None:
    worker = ComputeProcess()
    try:
        asked = ("instrument", "draw", load_preset("tanpura-light"), {"note": 48})
        expected = compute(*asked)
        assert worker.compute(*asked) == expected
        with pytest.raises(PresetError, match="no string plays") as error:
            worker.compute("instrument", "draw", load_preset("tanpura-light"), {"note": 49})
        assert "\n" not in str(error.value)
        worker._worker.process.kill()
        with pytest.raises(OSError, match="has ended; try again"):
            worker.compute(*asked)
        assert worker.compute(*asked) == expected
    finally:
        worker.close()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_nothing_is_left_of_a_server_that_is_killed(serve: Serve) -> None:
    server = serve(as_it_is=True)
    until(lambda: children(server.pid))
    left = children(server.pid)
    server.end(signal.SIGKILL)
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in left))


def children(pid: int) -> list[int]:
    return [int(each) for each in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


def test_what_is_shown_is_what_the_session_plays(serve: Callable[..., Server]) -> None:
    fine = serve("--quality", "fine", "--rate", "48000")
    doc = fine.open("tanpura-light")
    shown = fine.get(f"{doc.path}/motion?note=48&velocity=100&seconds=0.02&frames=20")
    assert shown == motion.film(load_preset("tanpura-light"), 48, 100, 0.02, 20, quality="fine", rate_hz=48000)
    assert fine.get(f"{doc.path}/analysis?note=48&seconds=0.5")["rate_hz"] == 48000
    assert fine.get(f"{doc.path}/cost?note=48")["rate_hz"] == shown["rate_hz"]
    job = finished(fine, fine.post(f"{doc.path}/reference", note=48, velocity=100, seconds=0.3)["job"])
    assert job["result"]["standard"]["rate_hz"] == shown["rate_hz"]  # type: ignore[index]
