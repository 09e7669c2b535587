"""Bridge and hand fitted to a recording over the page's own door: proposed, filled in, undone, cancelled, refused."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

from tests.author.quick_contact import DISTANCE, HEIGHT, POSITION
from tests.patience import until

from .serverkit import Doc, Server

RATE_HZ = 44100


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with Server(tmp_path_factory.mktemp("presets"), program=("-m", "tests.author.quick_contact")) as running:
        yield running


def note(hz: float) -> bytes:
    """Partials of a string, dying away."""
    t = np.arange(3 * RATE_HZ) / RATE_HZ
    x = sum(np.sin(2.0 * np.pi * n * hz * t) * np.exp(-t * (1.0 + 0.1 * n)) / n for n in range(1, 25))
    x = np.concatenate([np.zeros(RATE_HZ // 5), 0.2 * x]) + 1e-5 * np.random.default_rng(1).standard_normal(
        t.size + RATE_HZ // 5
    )
    buffer = io.BytesIO()
    soundfile.write(buffer, x, RATE_HZ, format="WAV")
    return buffer.getvalue()


def hz_of(doc: Doc, string: int) -> float:
    return float(440.0 * 2.0 ** ((doc.state["data"]["string"][string]["notes"][0] - 69) / 12.0))


def begun(doc: Doc, data: bytes, **query: Any) -> str:
    answer = doc.server.client.post("/api/fit", params={"doc": doc.key, "contact": 1, **query}, content=data)
    assert answer.status_code == 200, answer.text
    return str(answer.json()["job"])


def ended(doc: Doc, job: str) -> dict[str, Any]:
    until(lambda: doc.server.get(f"/api/jobs/{job}")["state"] != "running")
    return dict(doc.server.get(f"/api/jobs/{job}"))


def test_a_contact_fit_fills_the_controls(server: Server) -> None:
    """The height is for the preset's amplitude, also for the one that it has meanwhile; one step of undo, comments kept."""
    doc = server.open("tanpura-light")
    before = doc.state
    job = begun(doc, note(hz_of(doc, 0)))
    found = ended(doc, job)
    assert found["state"] == "done", found
    result = found["result"]
    assert result["string"] == result["nearest"] and "the preset's hardest pluck" in result["contact"]
    assert any("±" in value for _, value, _ in result["facts"])
    shown = {row["path"]: row["value"] for row in result["settings"]}
    assert shown["pluck.position"] == POSITION and "pluck.displacement_mm" not in shown
    state = doc.do("apply-fit", job=job)
    assert state["data"]["pluck"]["position"] == POSITION
    assert state["undo_label"] == "fit"
    comments = [line for line in before["text"].splitlines() if line.startswith("#")]
    assert comments == [line for line in state["text"].splitlines() if line.startswith("#")]
    assert doc.do("undo")["text"] == before["text"]


def test_a_known_amplitude_is_set_as_well(server: Server) -> None:
    doc = server.open("tanpura-light")
    doc.do("revert")
    job = begun(doc, note(hz_of(doc, 0)), string=0, amplitude=0.5)
    result = ended(doc, job)["result"]
    shown = {row["path"]: row["value"] for row in result["settings"]}
    assert "pluck.displacement_mm" in shown and "0.5 mm, as you entered" in result["contact"]
    jiva = shown["obstacle.jiva_um"]
    jiva = jiva if isinstance(jiva, float) else list(jiva.values())[-1]
    assert jiva == pytest.approx(1e6 * HEIGHT * 0.5e-3, rel=1e-3)
    assert result["obstacle"]["distance"]["value"] == DISTANCE


def test_heights_follow_the_amplitude_that_the_preset_has_now(server: Server) -> None:
    doc = server.open("tanpura-light")
    doc.do("revert")
    doc.set("pluck.displacement_mm", 1.0)
    job = begun(doc, note(hz_of(doc, 0)), string=0)
    assert ended(doc, job)["state"] == "done"
    doc.set("pluck.displacement_mm", 0.5)
    doc.set("obstacle.jiva_um", 1.0)
    state = doc.do("apply-fit", job=job)
    jiva = state["data"]["obstacle"]["jiva_um"]
    assert jiva == pytest.approx(1e6 * HEIGHT * 0.5e-3, rel=1e-3)
    doc.do("undo")
    doc.set("string.0.length_m", 0.9)
    assert "edited since" in doc.do("apply-fit", 409, job=job)["error"]
    doc.do("undo")
    doc.set("obstacle.radius_mm", 500.0)
    assert "edited since" in doc.do("apply-fit", 409, job=job)["error"]
    doc.do("revert")


def test_a_contact_fit_is_cancelled(server: Server) -> None:
    doc = server.open("tanpura-light")
    job = begun(doc, note(hz_of(doc, 0)), string=0, amplitude=9)
    until(lambda: doc.server.get(f"/api/jobs/{job}")["progress"] > 0.0)
    assert server.client.delete(f"/api/jobs/{job}").status_code == 200
    assert ended(doc, job)["state"] == "cancelled"
    assert "no fit to apply" in doc.do("apply-fit", 409, job=job)["error"]


@pytest.mark.parametrize(
    ("preset", "ratio", "query", "words"),
    [
        ("tanpura-light", 1.0, {"amplitude": 0.1}, "hardly touches the bridge"),
        ("tanpura-light", 1.3, {}, "the note must be string 1's"),
        ("nylon-guitar", 1.0, {}, "must be a bridge without a layer"),
    ],
)
def test_refusals_are_one_line_without_options(server: Server, preset: str, ratio: float, query: Any, words: str) -> None:
    doc = server.open(preset)
    doc.do("revert")
    if preset != "tanpura-light":
        doc.set("obstacle", {"kind": "none"})
    before = doc.state["text"]
    found = ended(doc, begun(doc, note(ratio * hz_of(doc, 0)), string=0, **query))
    assert found["state"] == "failed" and words in found["error"], found
    assert "--" not in found["error"] and "\n" not in found["error"] and doc.state["text"] == before


def test_questions_that_cannot_be(server: Server) -> None:
    doc = server.open("tanpura-light")
    for name, value in (("amplitude", "0"), ("amplitude", "50"), ("amplitude", "x"), ("contact", "2")):
        query = {"doc": doc.key, "contact": "1", name: value}
        answer = server.client.post("/api/fit", params=query, content=b"x")
        assert answer.status_code == 400 and name in answer.json()["error"]


def test_the_session_says_whether_contacts_can_be_fitted(server: Server) -> None:
    assert server.get("/api/session")["fit_contact"] == {"available": True, "reason": None}


def test_the_words_of_the_fit_are_those_that_are_replaced() -> None:
    """What the command line advises still stands in the fit as the page looks for it."""
    from synth.author.contact_fitting import _WORDS

    sources = "".join(
        (Path(__file__).parents[2] / "synth" / "fit" / f"contact_{each}.py").read_text() for each in ("fit", "group")
    )
    joined = sources.replace('"\n                f"', "").replace('"\n                "', "")
    assert all(there in joined for there, _ in _WORDS)
