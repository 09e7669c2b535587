"""One document at the server: edits, undo, refusals by field, two tabs."""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from synth.author import changes, document
from synth.instrument.preset import list_presets, parse_preset, preset_folder

from .serverkit import Doc, Server


@pytest.fixture
def doc(server: Server) -> Iterator[Doc]:
    """The tanpura as it comes with the program."""
    opened = server.open("tanpura-light")
    yield opened
    opened.do("revert")


def test_the_session(server: Server) -> None:
    session = server.get("/api/session")
    assert [row["name"] for row in session["presets"] if row["embedded"]] == [preset.name for preset in list_presets()]
    assert session["rate_hz"] == 44100 and session["quality"] == "standard" and session["opened"] is None
    assert [row["id"] for row in session["outputs"]] == ["browser", "server"]
    assert session["outputs"][0]["available"]
    assert session["outputs"][1]["available"] or session["outputs"][1]["reason"]


def test_what_a_document_says(doc: Doc) -> None:
    state = doc.state
    assert (state["name"], state["title"], state["file"], state["embedded"]) == (
        "tanpura-light",
        "Tanpura, light",
        None,
        True,
    )
    assert state["notes"] == [36, 43, 48] and state["kind"] == "bridge"
    assert not state["dirty"] and state["recovered"] is None and state["disk"] is None
    assert state["data"] == state["saved"] == parse_preset(state["text"], "x").model_dump(mode="json")
    assert {"pluck.position", "string.3.length_m", "sources", "tuning.contact_cents", "nut.0.q"} <= set(state["set"])
    assert "tuning.a4_hz" not in state["set"] and "string" not in state["set"]


def test_an_edit_keeps_the_comments(doc: Doc) -> None:
    before = doc.state["text"]
    after = doc.set("obstacle.jiva_um", 7.25)
    assert after["text"] == before.replace("jiva_um = 3.0", "jiva_um = 7.25")
    assert after["dirty"] and after["data"]["obstacle"]["jiva_um"] == 7.25 and after["saved"]["obstacle"]["jiva_um"] == 3.0
    assert after["revision"] == doc.state["revision"]


def test_back_to_the_default(doc: Doc) -> None:
    state = doc.set("pluck.width_mm", None)
    assert state["data"]["pluck"]["width_mm"] == 10.0 and "pluck.width_mm" not in state["set"]


@pytest.mark.parametrize(
    ("path", "value", "at", "words"),
    [
        ("pluck.position", 3, "pluck.position", "less than 1, got 3"),
        ("pluck.position", "near", "pluck.position", "number"),
        ("pluck.displacement_mm", None, "pluck.displacement_mm", "missing"),
        ("string.2.length_m", -1, "string.2.length_m", "must lie between 0.02 and 5, got -1"),
        ("string.2.length_m", {"H3": 1}, "string.2.length_m", "'H3'"),
        ("obstacle.distance_mm", 99, "obstacle.distance_mm", "less than the string's length"),
        ("obstacle.colour", "red", "obstacle.colour", "no such key"),
        ("string.9.length_m", 1, "string.9.length_m", "there is no such place"),
        ("name", "Two Words", "name", "lower-case"),
        ("string.0.length_m", 10**400, "string.0.length_m", "must be finite"),
        ("string.0.length_m", [[]], "string.0.length_m", "must be a number"),
        ("pluck", 1, "pluck", "there is no such place"),
        ("string.0", "x", "string.0", "there is no such place"),
        ("string.4", 3.0, "string.4", "there is no such place"),
        ("string", [], "string", "there is no such place"),
        ("pluck", [{"position": 0.3}], "pluck", "there is no such place"),
        ("string", {"position": 0.3}, "string", "there is no such place"),
        ("pluck.", 1, "pluck.", "there is no such place"),
        ("a = 1\nb", 1, "a = 1\nb", "there is no such place"),
        ("format", 3, "format", ""),
        ("string.0.diameter_mm", 6, "string.0.youngs_modulus_gpa", "bending stiffness"),
    ],
)
def test_a_wrong_value_is_refused_at_its_field_and_changes_nothing(
    doc: Doc, path: str, value: object, at: str, words: str
) -> None:
    if at in ("string.0.youngs_modulus_gpa", "obstacle.distance_mm"):
        doc.set("string.0.length_m", 0.09)
    before = doc.state
    answer = doc.set(path, value, 422)
    assert at in [each["path"] for each in answer["errors"]]
    assert words in next(each["message"] for each in answer["errors"] if each["path"] == at)
    assert "\n" not in answer["error"]
    assert doc.state == before


def test_all_errors_at_once(doc: Doc) -> None:
    changes = [{"path": "pluck.position", "value": 2}, {"path": "damping.release_s", "value": 0}]
    answer = doc.do("edit", 422, changes=changes)
    assert {each["path"] for each in answer["errors"]} == {"pluck.position", "damping.release_s"}


@pytest.mark.parametrize(
    "fields", [{}, {"changes": 3}, {"changes": [3]}, {"changes": [{"path": "x"}]}, {"changes": [{"value": 1}]}]
)
def test_edits_that_are_none(doc: Doc, fields: dict[str, object]) -> None:
    assert "changes" in doc.do("edit", 400, **fields)["error"]


def test_one_of_two_takes_the_others_place(doc: Doc) -> None:
    state = doc.set("obstacle.distance_ratio", 0.008)
    assert state["data"]["obstacle"]["distance_mm"] is None and "obstacle.distance_mm" not in state["set"]
    both = [{"path": "obstacle.distance_ratio", "value": 0.008}, {"path": "obstacle.distance_mm", "value": 6}]
    assert "either" in doc.do("edit", 422, changes=both)["error"]


def test_undo_and_redo(doc: Doc) -> None:
    texts = [doc.state["text"]]
    for value in (0.3, 0.31, 0.32):
        texts.append(doc.set("pluck.position", value)["text"])
    state = doc.set("title", "Mine")
    assert state["undo_label"] == "title" and not state["can_redo"]
    state = doc.do("undo")
    assert state["text"] == texts[3] and state["redo_label"] == "title"
    assert doc.do("undo")["text"] == texts[2]
    assert doc.do("redo")["text"] == texts[3]
    assert doc.do("redo")["data"]["title"] == "Mine"
    doc.do("undo")
    state = doc.set("pluck.position", 0.5)
    assert not state["can_redo"]
    assert doc.do("redo")["data"]["pluck"]["position"] == 0.5


def test_a_drag_is_one_step(doc: Doc) -> None:
    before = doc.state["text"]
    for value in range(20):
        doc.set("pluck.position", 0.2 + 0.01 * value, merge="drag-1")
    doc.set("pluck.position", 0.5, merge="drag-2")
    assert doc.do("undo")["data"]["pluck"]["position"] == 0.39
    doc.set("pluck.position", 0.45, merge="drag-1")  # after an undo the drag is another
    assert doc.do("undo")["data"]["pluck"]["position"] == 0.39
    assert doc.do("undo")["text"] == before


def test_nothing_changed_is_no_step(server: Server) -> None:
    doc = server.open("jawari-harp")
    assert not doc.set("pluck.position", doc.state["data"]["pluck"]["position"])["can_undo"]


def test_the_history_has_an_end(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(document, "STEPS", 20)
    made = document.Document("x", (preset_folder() / "tanpura-light.toml").read_text(encoding="utf-8"), tmp_path / "x")
    for number in range(30):
        made.edit([("pluck.position", 0.1 + 0.001 * number)])
    steps = 0
    while made.state()["can_undo"]:
        made.undo()
        steps += 1
    assert steps == 20 and made.preset.pluck.position == 0.109


def test_the_text_as_a_whole(doc: Doc) -> None:
    text = doc.state["text"].replace("jiva_um = 3.0", "jiva_um = 4.0 # tried")
    assert doc.do("text", text=text)["text"] == text
    for wrong in ("[", "format = 2", text.replace("jiva_um = 4.0", "jiva_um = 4000")):
        assert doc.do("text", 422, text=wrong)["error"]
    assert doc.state["text"] == text


def test_randomise(doc: Doc) -> None:
    before = doc.state
    seen = set()
    for seed in range(6):
        state = doc.do("randomise", seed=seed)
        seen.add(state["text"])
        for path in ("notes", "kind", "name"):
            assert state[path] == before[path]
        assert [s["length_m"] for s in state["data"]["string"]] == [s["length_m"] for s in before["data"]["string"]]
        old, new = before["data"]["pluck"]["position"], state["data"]["pluck"]["position"]
        assert old / 1.26 < new < old * 1.26
        assert state["undo_label"] == "randomise"
        doc.do("undo")
    assert len(seen) == 6
    assert doc.do("randomise", seed=0)["text"] in seen
    doc.do("undo")
    only = doc.do("randomise", seed=1, groups=["pluck"])["data"]
    assert only["pluck"] != before["data"]["pluck"] and only["obstacle"] == before["data"]["obstacle"]
    assert "'drums'" in doc.do("randomise", 400, groups=["drums"])["error"]


@pytest.mark.parametrize("name", ["tanpura-light", "fretted-bass", "jawari-harp"])
def test_what_is_randomised_can_be_played(server: Server, name: str) -> None:
    doc = server.open(name)
    note = doc.state["notes"][0]
    for seed in range(4):
        doc.do("randomise", seed=seed)
        answer = server.client.get(f"{doc.path}/sound.wav?phrase=note&note={note}&velocity=100&seconds=0.1")
        assert answer.status_code == 200
    doc.do("revert")


def test_remarks_of_several_lines(doc: Doc) -> None:
    remarks = 'Softer than "before".\n\n# not a comment\nEnd.'
    state = doc.set("remarks", remarks)
    assert state["data"]["remarks"] == tomllib.loads(state["text"])["remarks"] == remarks


def test_two_tabs_show_the_same(server: Server, doc: Doc) -> None:
    assert server.open("tanpura-light").key == doc.key
    with doc.connect() as one, doc.connect() as two:
        for page in (one, two):
            assert page.until("state")["state"]["text"] == doc.state["text"]
        doc.set("pluck.position", 0.37)
        for page in (one, two):
            state = page.until("state")["state"]
            assert state["data"]["pluck"]["position"] == 0.37 and state["can_undo"]
        doc.do("undo")
        for page in (one, two):
            assert page.until("state")["state"]["text"] == doc.state["text"]


def test_a_document_that_is_not_there(server: Server) -> None:
    for answer in (server.get("/api/docs/none", 404), server.post("/api/docs/none/undo", 404)):
        assert "no such document" in answer["error"]
    assert "no such preset" in server.post("/api/open", 404, preset="sarod")["error"]


@pytest.mark.parametrize("depth", [50, 300, 900, 20000])
def test_values_that_are_too_deep(doc: Doc, depth: int) -> None:
    body = '{"changes": [{"path": "pluck.position", "value": ' + depth * "[" + depth * "]" + "}]}"
    answer = doc.server.client.post(f"{doc.path}/edit", content=body)
    assert answer.status_code in (400, 422) and "\n" not in answer.json()["error"]


@pytest.mark.parametrize("path", ["remarks", "string.0.name", "sources"])
def test_half_a_character_is_refused(doc: Doc, path: str) -> None:
    before = doc.state
    value = '["x\\ud800"]' if path == "sources" else '"x\\ud800"'
    body = '{"changes": [{"path": "' + path + '", "value": ' + value + "}]}"
    answer = doc.server.client.post(f"{doc.path}/edit", content=body)
    assert answer.status_code == 422 and "U+D800" in answer.json()["error"]
    text = '{"text": "# \\ud800"}'
    answer = doc.server.client.post(f"{doc.path}/text", content=text)
    assert answer.status_code == 422 and "U+D800" in answer.json()["error"]
    assert doc.state == before


def test_what_could_not_be_read_again_is_refused(doc: Doc) -> None:
    before = doc.state
    assert "at most" in doc.set("remarks", "x" * (1 << 20), 422)["error"]
    assert "at most" in doc.do("text", 422, text=before["text"] + "#" * (1 << 20))["error"]
    assert doc.state == before


@pytest.mark.parametrize(
    "changes",
    [
        [{"path": "string.0.measured_frequencies_hz", "value": [1.0] * 100_000}],
        [{"path": "string.0.measured_frequencies_hz", "value": [[1.0, 2.0]] * 4_000}],
        [{"path": "pluck.position", "value": 0.3}] * 2_000,
    ],
)
def test_more_than_a_preset_has_room_for(doc: Doc, changes: list[object]) -> None:
    before = doc.state
    answer = doc.do("edit", 422, changes=changes)
    assert "longer than" in answer["error"] or "at most" in answer["error"]
    assert doc.state == before


def test_a_version_is_of_one_piece(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Whoever reads a document gets a text and its own preset, also where another thread undoes after every single look at
    the history."""
    made = document.Document("x", (preset_folder() / "tanpura-light.toml").read_text(encoding="utf-8"), tmp_path / "x")
    made.edit([("pluck.position", 0.3)])
    after = made._history
    made.undo()
    looks = itertools.cycle([after, made._history])
    monkeypatch.setattr(document.Document, "_history", property(lambda _: next(looks)), raising=False)
    for _ in range(3):
        version = made.version()
        assert f"position = {version.preset.pluck.position}\n" in version.text
        state = made.state()
        assert f"position = {state['data']['pluck']['position']}\n" in state["text"]
        next(looks)


@pytest.mark.parametrize("name", ["tanpura-light", "fretted-bass", "jawari-harp"])
def test_many_changes_are_those_one_by_one(name: str) -> None:
    text = (preset_folder() / f"{name}.toml").read_text(encoding="utf-8")
    wanted = [
        ("remarks", "two\nlines"),
        ("string.0.cents", 3.0),
        ("body.direct_db", -3.0),
        ("title", None),
        ("string.0.gain_db", None),
        ("string.0.gain_db", 2.0),
        ("tuning.a4_hz", 442.0),
        ("title", "New"),
    ]
    at_once, _ = changes.apply(text, wanted, "x")
    for each in wanted:
        text, _ = changes.apply(text, [each], "x")
    assert at_once == text


def test_an_autosave_is_whole_or_not_there(tmp_path: Path, monkeypatch) -> None:
    text = (preset_folder() / "tanpura-light.toml").read_text(encoding="utf-8")
    made = document.Document("mine", text, tmp_path / ".mine.toml.autosave")
    made.set_text(text.replace("jiva_um = 3.0", "jiva_um = 8.0"), "edit")

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("synth.files.targets.os.replace", killed)
        with pytest.raises(KeyboardInterrupt):
            made.write_autosave()
    assert list(tmp_path.iterdir()) == []
    made.write_autosave()
    assert "jiva_um = 8.0" in made.autosave.read_text(encoding="utf-8") and made.autosave.stat().st_mode & 0o777 == 0o600
