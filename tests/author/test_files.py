"""Files: saved, saved elsewhere, changed by others, recovered after a crash; nothing outside the folder."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import unicodedata
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

import pytest

from synth.instrument.preset import parse_preset, preset_folder
from tests.patience import until

from .conftest import Serve
from .serverkit import Doc, Server

ROOT = Path(__file__).resolve().parents[2]
KILLED_IN_A_WRITE = """
import os, signal, sys
from synth.files.targets import write_whole
write_whole(sys.argv[1], lambda file: os.kill(os.getpid(), signal.SIGKILL))
"""
TANPURA = (preset_folder() / "tanpura-light.toml").read_text(encoding="utf-8")


def autosaves(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob(".*"))


def test_the_preset_of_the_command_line(serve: Serve, folder: Path) -> None:
    server = serve("mine.toml")
    session = server.get("/api/session")
    assert session["folder"] == str(folder)
    assert server.open("mine.toml").key == session["opened"]
    assert server.open("mine").key == session["opened"]


def test_save(serve: Serve, folder: Path) -> None:
    doc = serve("mine.toml").open("mine.toml")
    os.chmod(folder / "mine.toml", 0o640)
    doc.set("obstacle.jiva_um", 7.5)
    until(lambda: autosaves(folder))
    before = (folder / "mine.toml").read_text()
    state = doc.do("save")
    after = (folder / "mine.toml").read_text()
    assert after == before.replace("jiva_um = 3.0", "jiva_um = 7.5") == state["text"]
    assert not state["dirty"] and state["saved"] == state["data"]
    assert state["can_undo"]  # saving is no end to undoing
    assert autosaves(folder) == []
    assert (folder / "mine.toml").stat().st_mode & 0o777 == 0o640
    assert doc.do("undo")["dirty"]


def test_a_preset_of_the_program_is_saved_under_a_name(serve: Serve, folder: Path) -> None:
    server = serve()
    doc = server.open("tanpura-light")
    assert doc.do("save", 409)["reason"] == "no-file"
    doc.set("obstacle.jiva_um", 7.5)
    state = doc.do("save-as", name="My tanpura")
    assert (state["file"], state["embedded"], state["dirty"], state["name"]) == (
        "My tanpura.toml",
        False,
        False,
        "My tanpura",
    )
    saved = parse_preset((folder / "My tanpura.toml").read_text(), "x")
    assert saved.name == "my-tanpura"
    assert (preset_folder() / "tanpura-light.toml").read_text(encoding="utf-8") == TANPURA
    assert server.open("tanpura-light").key != doc.key
    assert server.open("My tanpura.toml").key == doc.key
    until(lambda: autosaves(folder) == [])


def test_nothing_is_overwritten_unasked(serve: Serve, folder: Path) -> None:
    server = serve()
    doc = server.open("tanpura-light")
    before = (folder / "mine.toml").read_text()
    for name in ("mine", "mine.toml"):
        answer = doc.do("save-as", 409, name=name)
        assert answer["reason"] == "exists" and "mine.toml" in answer["error"]
        assert doc.do("duplicate", 409, name=name)["reason"] == "exists"
    assert (folder / "mine.toml").read_text() == before
    other = server.open("mine.toml")
    other.set("title", "Changed")
    assert doc.do("save-as", 409, name="mine", overwrite=True)["reason"] == "open"
    other.do("revert")
    assert doc.do("save-as", name="mine", overwrite=True)["file"] == "mine.toml"
    mine = TANPURA.replace('name = "tanpura-light"', 'name = "mine"').replace('title = "Tanpura, light"', 'title = "Mine"')
    assert (folder / "mine.toml").read_text() == mine


@pytest.mark.parametrize("action", ["save-as", "duplicate"])
def test_another_name_is_another_title(serve: Serve, folder: Path, action: str) -> None:
    """Two presets with one title cannot be told apart in a DAW; a title that was given by hand stays."""
    server = serve()
    doc = server.open("tanpura-light")
    state = doc.do(action, name="my-soft_tanpura")
    assert state["title"] == "My soft tanpura" and not state["dirty"]
    assert parse_preset((folder / "my-soft_tanpura.toml").read_text(), "x").title == "My soft tanpura"
    other = server.open("mine.toml")
    other.set("title", "By hand")
    assert other.do(action, name="other")["title"] == "By hand"


def test_a_first_name_leaves_the_title(serve: Serve, folder: Path) -> None:
    server = serve()
    brought = Doc(server, server.post("/api/import", filename="a.toml", text=TANPURA)["doc"])
    assert brought.do("save-as", name="b")["title"] == "Tanpura, light"


def test_duplicate(serve: Serve, folder: Path) -> None:
    server = serve()
    doc = server.open("mine.toml")
    doc.set("title", "Another")
    copy = Doc(server, doc.do("duplicate", name="copy")["doc"])
    assert copy.key != doc.key and copy.state["file"] == "copy.toml" and not copy.state["dirty"]
    assert parse_preset((folder / "copy.toml").read_text(), "x").title == "Another"
    assert doc.state["file"] == "mine.toml" and doc.state["dirty"]
    assert {"copy.toml", "mine.toml"} == {row["file"] for row in server.get("/api/session")["presets"] if row["file"]}


def test_export_and_import(serve: Serve, folder: Path) -> None:
    server = serve()
    doc = server.open("mine.toml")
    doc.set("obstacle.jiva_um", 9.0)
    answer = server.client.get(f"{doc.path}/export")
    assert answer.text == doc.state["text"]
    assert answer.headers["content-disposition"] == 'attachment; filename="mine.toml"'
    state = server.post("/api/import", filename="C:\\sounds\\Borrowed one.toml", text=answer.text)
    assert (state["name"], state["file"], state["dirty"]) == ("Borrowed one", None, True)
    assert not list(folder.glob("[!.]*orrowed*"))  # but for what is autosaved
    again = server.post("/api/import", filename="Borrowed one.toml", text=answer.text)
    assert again["doc"] != state["doc"] and again["name"] == "Borrowed one-2"
    assert "name: missing" in server.post("/api/import", 422, filename="x.toml", text="format = 2")["error"]
    assert "not valid TOML" in server.post("/api/import", 422, filename="x.toml", text="<html>")["error"]


@pytest.mark.parametrize(
    "name",
    [
        "../mine",
        "..",
        ".",
        "",
        "/etc/passwd",
        "a/b",
        "a\\b",
        ".hidden",
        "x" * 201,
        "nul\0",
        "leading\n",
        "-a",
        "a?",
        "/tmp/x.toml",
    ],
)
def test_names_outside_the_folder(serve: Serve, folder: Path, name: str) -> None:
    server = serve()
    doc = server.open("mine.toml")
    before = sorted(os.listdir(folder)), sorted(os.listdir(folder.parent))
    for answer in (
        doc.do("save-as", 400, name=name, overwrite=True),
        doc.do("duplicate", 400, name=name),
        server.post("/api/open", 400, preset=name),
        server.post("/api/open", 400, preset=f"{name}.toml"),
    ):
        assert "is not a valid name" in answer["error"] and "\n" not in answer["error"]
    assert (sorted(os.listdir(folder)), sorted(os.listdir(folder.parent))) == before


def test_links_out_of_the_folder(serve: Serve, folder: Path) -> None:
    outside = folder.parent / "outside.toml"
    outside.write_text(TANPURA)
    (folder / "link.toml").symlink_to(outside)
    (folder / "dangling.toml").symlink_to(folder.parent / "nothing.toml")
    (folder / "within.toml").symlink_to(folder / "mine.toml")
    server = serve()
    rows = {row["file"]: row["reason"] for row in server.get("/api/session")["presets"]}
    assert "leads out" in rows["link.toml"] and rows["mine.toml"] is None
    doc = server.open("mine.toml")
    for name in ("link.toml", "dangling.toml"):
        assert "leads out" in server.post("/api/open", 400, preset=name)["error"]
        assert "leads out" in doc.do("save-as", 400, name=name, overwrite=True)["error"]
    assert outside.read_text() == TANPURA and not (folder.parent / "nothing.toml").exists()
    assert server.open("within.toml").key == doc.key  # the same file


def test_a_change_on_disk_is_noticed(serve: Serve, folder: Path) -> None:
    server = serve()
    doc = server.open("mine.toml")
    file = folder / "mine.toml"
    theirs = file.read_text().replace("jiva_um = 3.0", "jiva_um = 5.0")
    with doc.connect() as page:
        doc.set("title", "Ours")
        file.write_text(theirs)
        assert page.until("disk")["disk"] == "changed"
        assert page.until("state", lambda message: message["state"]["disk"] == "changed")
        answer = doc.do("save", 409)
        assert answer["reason"] == "changed-on-disk" and file.read_text() == theirs
        state = doc.do("reload")
        assert state["data"]["obstacle"]["jiva_um"] == 5.0 and state["disk"] is None and not state["dirty"]
        assert doc.do("undo")["data"]["title"] == "Ours"  # nothing is lost by it
        file.unlink()
        assert page.until("disk")["disk"] == "gone"
        assert doc.do("save", 409)["reason"] == "changed-on-disk"
        assert doc.do("save", force=True)["disk"] is None
        assert file.read_text() == doc.state["text"]


def test_a_change_just_before_saving_is_noticed_too(serve: Serve, folder: Path) -> None:
    doc = serve().open("mine.toml")
    doc.set("title", "Ours")
    theirs = (folder / "mine.toml").read_text() + "# theirs\n"
    (folder / "mine.toml").write_text(theirs)
    assert doc.do("save", 409)["reason"] == "changed-on-disk"
    assert (folder / "mine.toml").read_text() == theirs
    assert doc.do("save", force=True)["data"]["title"] == "Ours"


def test_broken_on_disk(serve: Serve, folder: Path) -> None:
    doc = serve().open("mine.toml")
    before = doc.state["text"]
    (folder / "mine.toml").write_text("[[[")
    assert "not valid TOML" in doc.do("reload", 422)["error"]
    assert doc.state["text"] == before


def edited_and_killed(serve: Serve, preset: str) -> str:
    """The text that a server had when it was killed, after its autosave."""
    server = serve()
    doc = server.open(preset)
    doc.set("obstacle.jiva_um", 11.0)
    text = doc.state["text"]
    until(lambda: any(path.read_text() == text for path in server.folder.glob(".*.toml.autosave")))
    assert server.end(signal.SIGKILL)[0] == -signal.SIGKILL
    return text


@pytest.mark.parametrize("take", [True, False])
@pytest.mark.parametrize("preset", ["mine.toml", "tanpura-light"])
def test_after_a_crash(serve: Serve, folder: Path, preset: str, take: bool) -> None:
    original = (folder / "mine.toml").read_text()
    text = edited_and_killed(serve, preset)
    assert (folder / "mine.toml").read_text() == original
    doc = serve().open(preset)
    state = doc.state
    assert state["recovered"]["text"] == text and state["recovered"]["when"]
    assert not state["dirty"] and state["data"]["obstacle"]["jiva_um"] == 3.0
    state = doc.do("recover", take=take)
    assert state["recovered"] is None
    assert state["data"]["obstacle"]["jiva_um"] == (11.0 if take else 3.0)
    assert state["dirty"] == state["can_undo"] == take
    assert (folder / "mine.toml").read_text() == original
    assert len(autosaves(folder)) == take
    assert doc.do("recover", 409, take=True)["reason"] == "nothing"


def test_what_was_not_answered_is_not_overwritten(serve: Serve, folder: Path) -> None:
    first = edited_and_killed(serve, "mine.toml")
    server = serve()
    doc = server.open("mine.toml")
    doc.set("obstacle.jiva_um", 12.0)
    second = doc.state["text"]
    autosave = folder / ".mine.toml.autosave"
    until(lambda: autosave.is_file() and autosave.read_text(encoding="utf-8") == second)
    server.end(signal.SIGKILL)
    doc = serve().open("mine.toml")
    assert doc.state["recovered"]["text"] == second  # the newest first
    assert doc.do("recover", take=False)["recovered"]["text"] == first
    assert doc.do("recover", take=True)["text"] == first


def test_an_orderly_end_keeps_what_is_not_saved(serve: Serve, folder: Path) -> None:
    server = serve("mine.toml")
    doc = server.open("mine.toml")
    doc.set("obstacle.jiva_um", 11.0)
    text = doc.state["text"]
    for ending in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        assert server.end(ending) == (0, "")
        server = serve("mine.toml")
        doc = server.open("mine.toml")
        assert doc.do("recover", take=True)["text"] == text


def test_an_imported_preset_survives_a_crash(serve: Serve, folder: Path) -> None:
    server = serve()
    text = server.post("/api/import", filename="new.toml", text=TANPURA)["text"]
    until(lambda: list(folder.glob(".*.toml.autosave")))
    server.end(signal.SIGKILL)
    server = serve()
    row = next(row for row in server.get("/api/session")["presets"] if row["unsaved"])
    doc = Doc(server, server.post("/api/open", unsaved=row["name"])["doc"])
    assert doc.state["text"] == text and doc.state["dirty"]
    assert "recovered" in doc.state["notices"][0]
    doc.do("save-as", name="new")
    assert autosaves(folder) == []


def test_an_older_format_is_migrated_and_says_so(serve: Serve, folder: Path) -> None:
    old = (folder / "mine.toml").read_text().replace("format = 2", "format = 1")
    (folder / "mine.toml").write_text(old)
    doc = serve("mine.toml").open("mine.toml")
    state = doc.state
    assert "format 1" in state["notices"][0] and "format 2" in state["notices"][0]
    assert state["data"]["format"] == 2 and not state["dirty"]
    assert (folder / "mine.toml").read_text() == old
    assert doc.do("save")["notices"] == []
    assert (folder / "mine.toml").read_text() == old.replace("format = 1", "format = 2")


def test_a_newer_format_is_refused(serve: Serve, folder: Path) -> None:
    (folder / "new.toml").write_text(TANPURA.replace("format = 2", "format = 3"))
    answer = serve().post("/api/open", 422, preset="new.toml")
    assert "format: 3 is newer" in answer["error"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["nowhere.toml"], "nowhere.toml does not exist"),
        (["sarod"], "no such preset"),
        (["--folder", "nowhere"], "there is no such directory"),
        (["broken.toml"], "/broken.toml: not valid TOML"),
        (["--port", "70000"], "from 0 to 65535"),
        (["--rate", "12345"], "must be one of"),
    ],
)
def test_a_wrong_command_line(folder: Path, arguments: list[str], words: str) -> None:
    (folder / "broken.toml").write_text("[")
    with pytest.raises(RuntimeError, match="exit code 2: synth: error: .*" + words) as error:
        Server(folder, *arguments)
    assert "Traceback" not in str(error.value)


def test_a_port_that_is_taken(serve: Serve, folder: Path) -> None:
    port = serve().port
    with pytest.raises(RuntimeError, match=f"exit code 2: synth: error: --port {port}: .*in use"):
        Server(folder, "--port", str(port))


def test_two_on_one_folder(serve: Serve, folder: Path) -> None:
    server = serve()
    doc = server.open("mine.toml")
    doc.set("title", "Of the first")
    autosave = folder / ".mine.toml.autosave"
    until(autosave.is_file)
    with pytest.raises(RuntimeError, match=r"exit code 2: synth: error: .*another `synth author` is using this folder"):
        Server(folder, "mine.toml")
    assert autosave.is_file() and doc.state["dirty"]
    server.end(signal.SIGKILL)  # and then it is free
    assert serve().open("mine.toml").state["recovered"]


def test_an_imported_preset_of_a_name_that_the_program_has(serve: Serve, folder: Path) -> None:
    server = serve()
    text = server.post("/api/import", filename="tanpura-light.toml", text=TANPURA.replace("jiva_um = 3.0", "jiva_um = 8.0"))[
        "text"
    ]
    until(lambda: list(folder.glob(".*.toml.autosave")))
    server.end(signal.SIGKILL)
    server = serve()
    row = server.get("/api/session")["presets"][0]
    assert row["unsaved"] and row["name"] == "tanpura-light" and row["when"]
    state = server.post("/api/open", unsaved="tanpura-light")
    assert state["text"] == text and state["dirty"] and not state["embedded"]
    assert server.post("/api/open", unsaved="tanpura-light")["doc"] == state["doc"]
    assert server.open("tanpura-light").state["data"]["obstacle"]["jiva_um"] == 3.0
    assert "left unsaved" in server.post("/api/open", 404, unsaved="sitar")["error"]


def test_what_was_imported_can_be_thrown_away(serve: Serve, folder: Path) -> None:
    server = serve()
    doc = Doc(server, server.post("/api/import", filename="new.toml", text=TANPURA)["doc"])
    until(lambda: autosaves(folder))
    with doc.connect() as page:
        doc.do("discard")
        assert page.until("moved")["doc"] is None
    assert autosaves(folder) == []
    server.get(doc.path, 404)
    assert not any(row["unsaved"] for row in server.get("/api/session")["presets"])
    for name in ("mine.toml", "tanpura-light"):
        assert server.open(name).do("discard", 409)["reason"] == "has-file"


def test_saving_over_a_preset_keeps_what_a_crash_left_of_it(serve: Serve, folder: Path) -> None:
    lost = edited_and_killed(serve, "mine.toml")
    doc = serve().open("tanpura-light")
    state = doc.do("save-as", name="mine", overwrite=True)
    assert state["recovered"]["text"] == lost and not state["dirty"]
    assert doc.do("recover", take=True)["text"] == lost


def test_tabs_of_a_preset_that_is_written_over_are_led_on(serve: Serve, folder: Path) -> None:
    server = serve()
    other, doc = server.open("mine.toml"), server.open("tanpura-light")
    with other.connect() as page:
        doc.do("save-as", name="mine", overwrite=True)
        assert page.until("moved")["doc"] == doc.key
    assert other.state["doc"] == doc.key
    with other.connect() as page:
        assert page.until("state")["state"]["doc"] == doc.key


def test_one_autosave_that_cannot_be_written(serve: Serve, folder: Path) -> None:
    server = serve()
    stuck, doc = server.open("mine.toml"), server.open("tanpura-light")
    (folder / ".mine.toml.autosave").mkdir()
    with stuck.connect() as page:
        stuck.set("title", "Lost?")
        doc.set("title", "Kept")
        said = page.until("state", lambda message: message["state"]["autosave_problem"])
        assert ".mine.toml.autosave: is a directory" in said["state"]["autosave_problem"]
        until(lambda: any("Kept" in path.read_text() for path in folder.glob(".emb*.autosave")))
        (folder / ".mine.toml.autosave").rmdir()
        page.until("state", lambda message: message["state"]["autosave_problem"] is None)
    assert "Lost?" in (folder / ".mine.toml.autosave").read_text()


def test_names_in_any_script(serve: Serve, folder: Path) -> None:
    server = serve()
    doc = server.open("tanpura-light")
    state = doc.do("save-as", name=unicodedata.normalize("NFD", "Tānpūrā"))
    assert state["file"] == "Tānpūrā.toml" and state["data"]["name"] == "tanpura"
    assert server.open("Tānpūrā.toml").key == doc.key
    name = quote("Tānpūrā.toml")
    assert name in server.client.get(f"{doc.path}/export").headers["content-disposition"]
    assert doc.do("save-as", name="तानपूरा")["file"] == "तानपूरा.toml"
    assert server.post("/api/import", filename="वीणा (2)?.toml", text=TANPURA)["name"] == "वीणा -2"
    for odd in ("t (1).toml", unicodedata.normalize("NFD", "é.toml")):
        (folder / odd).write_text(TANPURA)
        assert server.open(odd).state["file"] == odd  # what is there already can be read
    (folder / os.fsdecode(b"\xff.toml")).write_text(TANPURA)
    rows = {row["file"]: row["reason"] for row in server.get("/api/session")["presets"]}
    assert rows["t (1).toml"] is None and "is not a valid name" in rows["\ufffd.toml"]


def test_links_to_what_is_no_preset(serve: Serve, folder: Path) -> None:
    (folder / ".secret").write_text(TANPURA)
    (folder / "link.toml").symlink_to(folder / ".secret")
    (folder / ".mine.toml.autosave").symlink_to(folder / ".secret")
    (folder / ".unsaved~x.toml.autosave").symlink_to(folder / ".secret")
    server = serve()
    assert "not a preset file" in server.post("/api/open", 400, preset="link.toml")["error"]
    assert not any(row["unsaved"] for row in server.get("/api/session")["presets"])
    doc = server.open("mine.toml")
    assert doc.state["recovered"] is None
    doc.set("title", "Mine")
    until(lambda: not (folder / ".mine.toml.autosave").is_symlink())
    assert (folder / ".secret").read_text() == TANPURA


def test_what_a_write_that_was_cut_short_leaves(serve: Serve, folder: Path) -> None:
    for name in ("mine.toml", "mine.toml.autosave"):
        subprocess.run([sys.executable, "-c", KILLED_IN_A_WRITE, str(folder / name)], cwd=ROOT)
    foreign = folder / ".other.abcd_123.part"
    foreign.write_text("whose?")
    assert len(autosaves(folder)) == 2  # the second has taken away what the first left
    serve()
    assert autosaves(folder) == [foreign.name]


def make_fifo(path: Path) -> None:
    os.mkfifo(path)


def make_socket(path: Path) -> None:
    # the address of a socket is short: by the folder that is worked in
    here = os.getcwd()
    os.chdir(path.parent)
    try:
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(path.name)
    finally:
        os.chdir(here)


def make_link_to_a_device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def make_link_to_a_fifo(path: Path) -> None:
    outside = path.parent.parent / f"{path.name}.fifo"
    os.mkfifo(outside)
    path.symlink_to(outside)


ODD = {
    make_fifo: "is a pipe",
    make_socket: "is a socket",
    Path.mkdir: "is a directory",
    make_link_to_a_device: "leads out",
    make_link_to_a_fifo: "leads out",
}


def test_what_is_no_file_is_shown_as_such_and_not_waited_for(serve: Serve, folder: Path) -> None:
    for number, make in enumerate(ODD):
        make(folder / f"odd{number}.toml")
        make(folder / f".odd{number}.toml.autosave")
        make(folder / f".unsaved~{number}.toml.autosave")
    server = serve("mine.toml")
    rows = {row["file"]: row for row in server.get("/api/session")["presets"] if row["file"]}
    doc = server.open("mine.toml")
    for number, words in enumerate(ODD.values()):
        name = f"odd{number}.toml"
        assert words in rows[name]["reason"] and rows[name]["title"] == name
        assert words in server.post("/api/open", 400, preset=name)["error"]
        for action in ("save-as", "duplicate"):
            assert words in doc.do(action, 400, name=name, **({"overwrite": True} if action == "save-as" else {}))["error"]
    assert rows["mine.toml"]["reason"] is None
    assert not any(row["unsaved"] for row in server.get("/api/session")["presets"])
    assert server.end() == (0, "")


@pytest.mark.parametrize("make", ODD)
def test_an_open_document_whose_file_becomes_something_else(
    serve: Serve, folder: Path, make: Callable[[Path], object]
) -> None:
    server = serve("mine.toml")
    doc = server.open("mine.toml")
    file, away = folder / "mine.toml", folder.parent / "away.toml"
    with doc.connect() as page:
        doc.set("title", "Kept")
        file.rename(away)
        make(file)
        page.until("disk", lambda message: message["disk"] == "changed")
        before = file.lstat()
        for asked in (lambda: doc.do("save", 400, force=True), lambda: doc.do("reload", 400)):
            error = asked()["error"]
            assert "mine.toml: is a" in error and "not a regular file" in error
        assert doc.do("save", 409)["reason"] == "changed-on-disk"
        assert (file.lstat().st_mode, file.lstat().st_ino) == (before.st_mode, before.st_ino)
        left = folder / ".mine.toml.autosave"
        until(lambda: left.exists() and "Kept" in left.read_text())
        assert server.get("/api/session")["presets"] and doc.set("title", "Still")["dirty"]
        # and when it is a file again, all is well
        file.rmdir() if file.is_dir() and not file.is_symlink() else file.unlink()
        away.rename(file)
        page.until("disk", lambda message: message["disk"] is None)
        assert not doc.do("save")["dirty"]
    assert parse_preset(file.read_text(), "x").title == "Still"


@pytest.mark.parametrize("make", [make_fifo, make_link_to_a_fifo, Path.mkdir])
def test_an_autosave_that_is_no_file(serve: Serve, folder: Path, make: Callable[[Path], object]) -> None:
    """It is in the way of nothing but the autosave, and the page is told."""
    server = serve("mine.toml")
    doc = server.open("mine.toml")
    autosave = folder / ".mine.toml.autosave"
    make(autosave)
    before = autosave.lstat()
    with doc.connect() as page:
        doc.set("title", "One")
        said = page.until("state", lambda message: message["state"]["autosave_problem"])
        assert ".mine.toml.autosave: is a" in said["state"]["autosave_problem"]
        assert autosave.lstat().st_ino == before.st_ino
        assert not doc.do("save")["dirty"] and doc.state["autosave_problem"] is None
    assert parse_preset((folder / "mine.toml").read_text(), "x").title == "One"
    assert doc.set("title", "Two")["dirty"] and not doc.do("revert")["dirty"] and not doc.do("reload")["dirty"]
    assert server.end()[0] == 0


@pytest.mark.parametrize(
    ("make", "words"),
    [(make_fifo, "is a pipe"), (Path.mkdir, "is a directory"), (make_link_to_a_device, "is a device")],
)
def test_a_command_line_that_names_no_file(folder: Path, make: Callable[[Path], object], words: str) -> None:
    make(folder / "odd.toml")
    with pytest.raises(RuntimeError, match=f"exit code 2: synth: error: odd.toml: {words}, not a regular file"):
        Server(folder, "odd.toml")
    with pytest.raises(RuntimeError, match=r"exit code 2: synth: error: --folder .*: there is no such directory"):
        Server(folder, "--folder", "/dev/null")
