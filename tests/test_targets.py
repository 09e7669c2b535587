"""Files that appear whole or not at all, what is taken away of killed processes, outputs that are inputs."""

import contextlib
import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from synth.files import unfinished
from synth.files.folders import write_folder
from synth.files.targets import Named, Whole, check_apart, check_target, write_text, write_whole
from synth.files.unfinished import tidy
from tests.patience import patience_s

ROOT = Path(__file__).resolve().parents[1]


def process(program: str, *arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)


KILLED = """
import os, signal, sys
from synth.files.targets import write_whole
write_whole(sys.argv[1], lambda file: (file.write(b"half"), file.flush(), os.kill(os.getpid(), signal.SIGKILL)))
"""
WRITING = """
import sys
from synth.files.targets import write_whole
def write(file):
    file.write(b"whole"); file.flush()
    print("writing", flush=True)
    sys.stdin.readline()
write_whole(sys.argv[1], write)
"""


def left_behind(path: Path) -> Path:
    """What a process leaves that was killed while it wrote `path`."""
    before = set(path.parent.iterdir())
    with process(KILLED, str(path)) as killed:
        assert killed.wait(patience_s()) == -signal.SIGKILL
    (left,) = set(path.parent.iterdir()) - before
    return left


def test_the_next_takes_away_what_a_killed_process_has_left(tmp_path: Path) -> None:
    (tmp_path / "a.wav").write_bytes(b"before")
    left = left_behind(tmp_path / "a.wav")
    assert left.read_bytes() == b"half" and (tmp_path / "a.wav").read_bytes() == b"before"
    write_text(tmp_path / "b.txt", "other")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.wav", "b.txt"]


def test_nothing_else_is_taken_away(tmp_path: Path) -> None:
    """Not a file that is being written, nor one of another machine, nor what only looks like it."""
    with process(WRITING, str(tmp_path / "live.wav")) as running:
        assert running.stdout is not None and running.stdin is not None
        assert running.stdout.readline() == "writing\n"
        (live,) = tmp_path.iterdir()
        mark = live.name.removeprefix(".live.wav.")
        pid, machine = mark.split("-")[1:3]
        mine = [
            f".take.wav.{pid}.part",  # a recording that a crash has left
            live.name.replace(machine, "00000000"),
            "live.wav." + mark,
            live.name + "x",
            f".live.wav.jawari-{pid}.part",
        ]
        for name in mine:
            (tmp_path / name).write_text("mine")
        folder = tmp_path / f".folder.jawari-1-{machine}-00000000.part"
        folder.mkdir()
        link = tmp_path / f".link.jawari-1-{machine}-00000000.part"
        link.symlink_to(tmp_path / mine[0])
        tidy(tmp_path)
        write_text(tmp_path / "other.txt", "other")
        assert {path.name for path in tmp_path.iterdir()} == {*mine, live.name, folder.name, link.name, "other.txt"}
        running.stdin.write("\n")
        running.stdin.flush()
        assert running.wait(patience_s()) == 0
    assert (tmp_path / "live.wav").read_bytes() == b"whole" and not live.exists()


def test_those_who_write_at_once_do_not_take_each_other_s_files(tmp_path: Path) -> None:
    """One takes away what is left, again and again, while others begin files: each gets its own."""
    program = """
import sys
from synth.files.targets import write_text
for k in range(60):
    write_text(f"{sys.argv[1]}/{sys.argv[2]}-{k}", "x")
"""
    running = [process(program, str(tmp_path), str(number)) for number in range(2)]
    deadline = time.monotonic() + patience_s()
    while any(each.poll() is None for each in running) and time.monotonic() < deadline:
        tidy(tmp_path)
    for each in running:
        with each:
            assert each.wait(patience_s()) == 0
    assert len(list(tmp_path.iterdir())) == 120


def test_permissions_stay(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_text("old")
    path.chmod(0o640)
    write_text(path, "new")
    assert path.read_text() == "new" and path.stat().st_mode & 0o777 == 0o640
    mask = os.umask(0o027)
    try:
        write_text(tmp_path / "b", "new")
    finally:
        os.umask(mask)
    assert (tmp_path / "b").stat().st_mode & 0o777 == 0o640


def test_a_failure_leaves_what_was_there(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")

    def fail(file) -> None:
        file.write(b"half")
        raise OSError(28, "full")

    with pytest.raises(OSError, match="No space left on device; make room there"):
        write_whole(tmp_path / "a", fail)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("a", "old")]


def test_a_signal_at_any_step_leaves_nothing(tmp_path: Path, monkeypatch) -> None:
    """Also where the file has just been made and nobody holds it yet."""
    monkeypatch.setattr(unfinished, "is_at", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    whole = Whole(tmp_path / "a")
    with pytest.raises(KeyboardInterrupt):
        whole.open()
    assert len(list(tmp_path.iterdir())) == 1
    unfinished.discard_unfinished()
    assert not list(tmp_path.iterdir())


def test_a_directory_that_goes_meanwhile(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()

    def leave(file) -> None:
        for path in folder.iterdir():
            path.unlink()
        folder.rmdir()

    with pytest.raises(FileNotFoundError, match="its directory no longer exists; make it again"):
        write_whole(folder / "a", leave)


def test_the_longest_names(tmp_path: Path) -> None:
    name = "ü" * 127  # 254 bytes
    write_text(tmp_path / name, "x")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    with pytest.raises(OSError, match="File name too long; give it a shorter name"):
        check_target(tmp_path / ("x" * 300))


def test_a_file_that_is_write_protected(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")
    (tmp_path / "a").chmod(0o444)
    if os.access(tmp_path / "a", os.W_OK):
        with contextlib.suppress(OSError):  # whoever may do everything is not stopped
            check_target(tmp_path / "a")
        return
    with pytest.raises(PermissionError, match="is write-protected"):
        check_target(tmp_path / "a")


def test_what_is_one_file(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a").write_text("a")
    os.link("a", "hard")
    Path("soft").symlink_to("a")
    Path("dangling").symlink_to("new")
    Path("folder").mkdir()
    Path("there").symlink_to("folder")
    for other in ("./a", str(tmp_path / "a"), "hard", "soft", "folder/../a"):
        with pytest.raises(ValueError, match="would overwrite"):
            check_apart([Named("in", "a")], [Named("out", other)])
    for one, other in (("new", "./new"), ("dangling", "new"), ("folder/x", "there/x")):
        with pytest.raises(ValueError, match="are the same file"):
            check_apart([], [Named("out", one), Named("other", other)])
    check_apart([Named("in", "a"), Named("in", "none")], [Named("out", "b"), Named("out", "A"), Named("out", "folder/a")])
    check_apart([Named("in", "/dev/null")], [Named("out", "/dev/null"), Named("out", "/dev/null"), Named("out", "-")])


def test_a_folder_that_knows_no_capitals(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr("synth.files.targets._knows_no_case", lambda folder: True)
    with pytest.raises(ValueError, match="are the same file"):
        check_apart([], [Named("out", tmp_path / "Take.wav"), Named("other", tmp_path / "take.WAV")])
    monkeypatch.undo()
    check_apart([], [Named("out", tmp_path / "Take.wav"), Named("other", tmp_path / "take.WAV")])


def test_standard_output_that_is_an_input(tmp_path: Path) -> None:
    song = tmp_path / "s.mid"
    song.write_bytes(b"music")
    program = "import sys; from synth.files.targets import *; check_apart([Named('in', sys.argv[1])], [Named('-o', '-')])"
    with open(song, "ab") as file:
        done = subprocess.run(
            [sys.executable, "-c", program, str(song)],
            cwd=ROOT,
            stdout=file,
            stderr=subprocess.PIPE,
            text=True,
            timeout=patience_s(),
        )
    assert "standard output would overwrite in" in done.stderr and song.read_bytes() == b"music"


def test_a_recording_that_cannot_get_its_name_stays(tmp_path: Path) -> None:
    whole = Whole(tmp_path / "take.wav", kept=True)
    os.write(whole.open(), b"music")
    (tmp_path / "take.wav").mkdir()
    with pytest.raises(IsADirectoryError, match=r"the data are kept in .*\.take\.wav\."):
        whole.commit()
    (left,) = tmp_path.glob(".take.wav.*.part")
    assert left.read_bytes() == b"music"
    again = Whole(tmp_path / "take.wav", kept=True)  # of the same process: nothing is written over
    again.open()
    again.discard()
    assert left.read_bytes() == b"music"


# --- folders ---

FOLDER = {"Contents/x86_64-linux/x.so": b"old", "about": b"old"}
NEW = dict.fromkeys(FOLDER, b"new")
KILLED_BETWEEN = """
import os, signal, sys
from pathlib import Path
from synth.files.folders import write_folder
rename, names = os.rename, []
def killed(old, new):
    names.append(new)
    if len(names) == int(sys.argv[2]):
        os.kill(os.getpid(), signal.SIGKILL)
    rename(old, new)
os.rename = killed
write_folder(Path(sys.argv[1]), {"about": b"new"})
"""


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_folder_takes_the_place_of_another(tmp_path: Path) -> None:
    place = tmp_path / "x.vst3"
    for files in (FOLDER, NEW, {"else": b"other"}):
        write_folder(place, files, programs=".so")
        assert contents(place) == files and os.listdir(tmp_path) == ["x.vst3"]
    write_folder(place, FOLDER, programs=".so")
    modes = {path.name: path.stat().st_mode & 0o111 != 0 for path in place.rglob("*") if path.is_file()}
    assert modes == {"x.so": True, "about": False}


def test_a_program_in_a_folder_is_another_name_of_a_file_that_is_the_same(tmp_path: Path) -> None:
    there, place = tmp_path / "x.clap", tmp_path / "x.vst3"
    there.write_bytes(b"old")
    write_folder(place, FOLDER, programs=".so", same={"Contents/x86_64-linux/x.so": there})
    assert (place / "Contents/x86_64-linux/x.so").samefile(there) and (place / "about").stat().st_nlink == 1
    write_text(there, "new")
    assert contents(place) == FOLDER  # the other name stays what it was


@pytest.mark.parametrize("kind", ["other bytes", "a pipe", "a link", "nothing", "no hard links here"])
def test_where_a_program_cannot_be_another_name_it_is_a_file_of_its_own(kind: str, tmp_path: Path, monkeypatch) -> None:
    there, place = tmp_path / "x.clap", tmp_path / "x.vst3"
    if kind == "other bytes":
        there.write_bytes(b"new")
    elif kind == "a pipe":
        os.mkfifo(there)
    elif kind == "a link":
        (tmp_path / "else").write_bytes(b"old")
        there.symlink_to("else")
    elif kind == "no hard links here":
        there.write_bytes(b"old")
        monkeypatch.setattr(os, "link", lambda *a, **b: (_ for _ in ()).throw(OSError(errno.EPERM, "not permitted")))
    write_folder(place, FOLDER, programs=".so", same={"Contents/x86_64-linux/x.so": there})
    assert contents(place) == FOLDER and (place / "Contents/x86_64-linux/x.so").lstat().st_nlink == 1
    assert (place / "Contents/x86_64-linux/x.so").stat().st_mode & 0o100


@pytest.mark.parametrize("step", [1, 2])
def test_interrupted_between_two_names_the_old_folder_is_there(step: int, tmp_path: Path, monkeypatch) -> None:
    place, rename, names = tmp_path / "x.vst3", os.rename, []
    write_folder(place, FOLDER)

    def interrupted(old, new) -> None:
        names.append(new)
        if len(names) == step:
            raise KeyboardInterrupt
        rename(old, new)

    monkeypatch.setattr(os, "rename", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_folder(place, NEW)
    assert contents(place) == FOLDER and os.listdir(tmp_path) == ["x.vst3"]


@pytest.mark.parametrize("step", [1, 2])
@pytest.mark.parametrize("name", ["x.vst3", "ṭ" * 60 + ".vst3"])
def test_what_a_killed_process_has_left_of_a_folder_comes_back(step: int, name: str, tmp_path: Path) -> None:
    place = tmp_path / name
    write_folder(place, FOLDER)
    with process(KILLED_BETWEEN, str(place), str(step)) as killed:
        assert killed.wait(patience_s()) == -signal.SIGKILL
    assert (name in os.listdir(tmp_path)) == (step == 1) and len(os.listdir(tmp_path)) == 3 - step
    write_text(tmp_path / "other", "whatever is written there")
    assert contents(place) == FOLDER and sorted(os.listdir(tmp_path)) == sorted(["other", name])


def test_a_new_folder_stays_where_the_old_one_was_left_by_a_killed_process(tmp_path: Path) -> None:
    place = tmp_path / "x.vst3"
    write_folder(place, FOLDER)
    with process(KILLED_BETWEEN, str(place), "2") as killed:
        killed.wait(patience_s())
    place.mkdir()
    (place / "about").write_bytes(b"by hand")
    tidy(tmp_path)
    assert contents(place) == {"about": b"by hand"} and os.listdir(tmp_path) == ["x.vst3"]


def test_a_folder_that_is_being_made_is_left_alone(tmp_path: Path, monkeypatch) -> None:
    place, seen = tmp_path / "x.lv2", []
    write_folder(place, FOLDER)
    rename = os.rename

    def look(old, new) -> None:
        rename(old, new)
        tidy(tmp_path)  # as another process may
        seen.append(sorted(os.listdir(tmp_path)))

    monkeypatch.setattr(os, "rename", look)
    write_folder(place, NEW)
    assert len(seen[0]) == 1 and len(seen[1]) == 2 and contents(place) == NEW and os.listdir(tmp_path) == ["x.lv2"]


def test_a_signal_leaves_no_folder_half_made(tmp_path: Path, monkeypatch) -> None:
    """A program that is ended has what it had begun removed, at any step."""
    place, rename = tmp_path / "x.lv2", os.rename
    write_folder(place, FOLDER)

    def ended(old, new) -> None:
        monkeypatch.setattr(os, "rename", rename)
        rename(old, new)
        unfinished.discard_unfinished()
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "rename", ended)
    with pytest.raises(KeyboardInterrupt):
        write_folder(place, NEW)
    assert contents(place) == FOLDER and os.listdir(tmp_path) == ["x.lv2"] and not unfinished.begun


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match=r"x\.lv2"):
        write_folder(tmp_path / "file" / "x.lv2", FOLDER)
