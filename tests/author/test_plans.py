"""A plan is measured of the open preset, kept beside its file, and gone by from then on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from synth.author.document import Conflict, Document
from synth.instrument.planfile import parse, text_of
from synth.instrument.preset import load_preset, parse_preset, preset_folder
from tests.patience import compiling_s, until
from tests.test_planfile import PRESET, plan

from .conftest import Serve
from .serverkit import Server

#: a string that is damped at once, which is measured quickly
TEXT = PRESET.format(string="viscoelastic_loss = 0.02", displacement="3.0", rest="")


def finished(server: Server, job: str) -> dict[str, Any]:
    return until(lambda: (found := server.get(f"/api/jobs/{job}"))["state"] != "running" and found, quiet_s=compiling_s())


def test_a_plan_is_measured_and_kept(serve: Serve, folder: Path) -> None:
    (folder / "mine.toml").write_text(TEXT, encoding="utf-8")
    server = serve("mine.toml")
    doc = server.open("mine.toml")
    before = server.get(f"{doc.path}/cost?note=43&velocity=100")
    assert "95 % of random scenes" in before["promise"] and "measured" not in before["promise"]
    found = finished(server, doc.do("plan")["job"])
    assert found["state"] == "done" and found["result"] == {"strings": 1, "less": {"draft": 1, "standard": 1, "fine": 1}}
    job = doc.do("plan")["job"]
    server.client.delete(f"/api/jobs/{job}")
    assert finished(server, job)["state"] == "cancelled"
    assert "no plan to keep" in doc.do("keep-plan", 409, job=job)["error"]
    assert not (folder / "mine.plan").exists()


def test_what_was_measured_is_gone_by(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(TEXT, encoding="utf-8")
    document = Document("mine", TEXT, tmp_path / ".autosave", file=tmp_path / "mine.toml")
    document.edit([("title", "Mine")])
    document.undo()
    made = plan(parse_preset(TEXT, "mine"))
    document.keep_plan(made)
    assert (tmp_path / "mine.plan").read_text(encoding="utf-8") == text_of(made)
    for preset in (document.preset, document.preset_of("saved")):
        assert preset.measured.strings == made.strings
    document.redo()
    document.edit([("pluck.position", 0.2)])
    assert document.preset.measured.strings == made.strings
    again = Document("mine", TEXT, tmp_path / ".autosave", file=tmp_path / "mine.toml")
    assert again.preset.measured.strings == made.strings
    (tmp_path / "mine.plan").write_text("format = 3\n", encoding="utf-8")
    broken = Document("mine", TEXT, tmp_path / ".autosave", file=tmp_path / "mine.toml")
    assert broken.preset.measured.strings == () and "mine.plan: format: must be 1, got 3" in broken.notices[-1]


def test_a_preset_of_the_program_has_its_plan_and_keeps_it(tmp_path: Path) -> None:
    tanpura = load_preset("tanpura-light")
    text = (Path(__file__).parents[2] / "presets" / "tanpura-light.toml").read_text(encoding="utf-8")
    document = Document("tanpura-light", text, tmp_path / ".autosave", embedded=True)
    assert document.preset.measured.strings == tanpura.measured.strings != ()
    with pytest.raises(Conflict, match="tanpura-light has no file yet to keep a plan beside"):
        document.keep_plan(parse(text_of(tanpura.measured), "x"))


def test_a_plan_goes_along_only_where_it_was_asked_for(serve: Serve, folder: Path) -> None:
    """The program's own stays with its preset; one beside the user's file goes where the file goes."""
    server = serve()
    doc = server.open("tanpura-light")
    doc.do("save-as", name="first")
    assert not (folder / "first.plan").exists()
    asked = (preset_folder() / "tanpura-light.plan").read_text(encoding="utf-8")
    (folder / "first.plan").write_text(asked, encoding="utf-8")
    doc.do("reload")
    doc.do("save-as", name="second")
    assert parse((folder / "second.plan").read_text(encoding="utf-8"), "x").strings == parse(asked, "x").strings


def test_what_is_saved_without_its_plan_is_shown_without(tmp_path: Path) -> None:
    text = (preset_folder() / "tanpura-light.toml").read_text(encoding="utf-8")
    document = Document("tanpura-light", text, tmp_path / ".autosave", embedded=True)
    document.save_as(tmp_path / "mine.toml", tmp_path / ".mine")
    assert document.preset.measured.strings == load_preset(str(tmp_path / "mine.toml")).measured.strings == ()


def test_plans_that_there_are_not(server: Server) -> None:
    doc = server.open("tanpura-light")
    assert "has no file yet" in doc.do("plan", 409)["error"]
    assert "no such job" in doc.do("keep-plan", 404, job="none")["error"]
    job = doc.do("reference", note=48, velocity=100, seconds=0.1)["job"]
    finished(server, job)
    assert "no plan to keep" in doc.do("keep-plan", 409, job=job)["error"]
