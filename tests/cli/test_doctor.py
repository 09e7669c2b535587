"""`synth doctor`: on this machine, and on machines where something is not there, hangs or crashes."""

import json
import os
import subprocess
import sys
import types
import webbrowser
from pathlib import Path

import pytest

from synth import cli
from synth.cli import apart, checkups, doctor
from synth.cli.checkups import CHECKUPS, MISSING, NOT_TRIED, OK, Finding
from synth.jit import kernel_cache
from tests.patience import compiling_s

ROOT = Path(__file__).resolve().parents[2]


def run(*arguments: str, before: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    """`synth doctor` in a new interpreter, in which modules of the folder `before` come first."""
    path = os.pathsep.join(str(each) for each in (before, ROOT) if each is not None)
    # what started this process may have imported the package, and chosen a folder of kernels for it
    inherited = {name: value for name, value in kernel_cache.environment().items() if name != "NUMBA_CACHE_DIR"}
    return subprocess.run(
        [sys.executable, "-m", "synth", "doctor", "--timeout", "600", *arguments],
        cwd=before or ROOT,
        env={**inherited, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", **environment},
        capture_output=True,
        text=True,
        timeout=compiling_s(),
    )


def everything(folder: Path) -> dict[str, bytes | None]:
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.mark.slow
def test_this_machine_renders_and_nothing_is_written(tmp_path) -> None:
    folders = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "HOME": str(tmp_path), "TMPDIR": str(tmp_path / "temporary")}
    (tmp_path / "temporary").mkdir()
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("XDG_CACHE_HOME", folders["XDG_CACHE_HOME"])
        kernel_cache.cache_folder().mkdir(parents=True)  # as every command makes it
    before = everything(tmp_path)
    done = run("--json", **folders)
    assert done.returncode == 0 and done.stderr == ""
    told = json.loads(done.stdout)
    assert told["renders"] is True
    assert [each["name"] for each in told["checks"]] == list(CHECKUPS)
    for each in told["checks"]:
        assert each["verdict"] in (OK, MISSING, NOT_TRIED) and each["what"]
        assert (each["verdict"] == OK) == (not each["remedy"]) or each["verdict"] == NOT_TRIED, each
    found = {each["name"]: each for each in told["checks"]}
    assert "the first start compiles them" in found["kernels"]["what"]
    assert everything(tmp_path) == before


#: modules in the place of those that are missing or broken: what they do when they are imported
GONE = "raise ImportError('No module named here')"


@pytest.mark.slow
def test_a_machine_without_libraries_says_what_to_install(tmp_path) -> None:
    for name in ("rtmidi", "jack", "starlette", "numba"):
        (tmp_path / f"{name}.py").write_text(GONE, encoding="utf-8")
    (tmp_path / "sounddevice.py").write_text("raise OSError('PortAudio library not found')", encoding="utf-8")
    (tmp_path / "file").touch()
    done = run(before=tmp_path, XDG_CACHE_HOME=str(tmp_path / "file"))
    assert done.returncode == 1 and done.stderr == ""
    said = done.stdout
    assert "Traceback" not in said
    assert "missing    rendering  numba cannot be loaded: No module named here" in said
    assert "→ pip install --force-reinstall numba" in said
    assert "missing    cache      compiled kernels cannot be kept" in said and "set XDG_CACHE_HOME" in said
    assert "JACK needs the package JACK-Client" in said and "→ pip install 'jawari[jack]'" in said


def test_without_sound_libraries(monkeypatch, tmp_path) -> None:
    for name in ("rtmidi", "jack", "sounddevice"):
        monkeypatch.setitem(sys.modules, name, None)  # an import fails
    from synth.live import jackserver

    jackserver.library.cache_clear()
    monkeypatch.setattr(checkups, "_make_no_folders", lambda: None)
    try:
        found = {name: checkups.look(name) for name in ("audio", "MIDI", "JACK")}
    finally:
        jackserver.library.cache_clear()
    assert {each.verdict for each in found.values()} == {MISSING}
    assert found["MIDI"].remedy == "pip install 'jawari[live]'"
    assert "jawari[live]" in found["audio"].remedy and "jawari[jack]" in found["JACK"].remedy


def test_without_a_library_of_the_system_the_remedy_is_the_systems(monkeypatch) -> None:
    broken = types.ModuleType("soundfile")

    def missing(name: str) -> None:
        raise OSError("sndfile library not found using ctypes.util.find_library")

    broken.__getattr__ = missing  # type: ignore[method-assign]
    monkeypatch.setitem(sys.modules, "soundfile", broken)
    found = checkups.rendering()
    assert found.verdict == MISSING and "libsndfile1" in found.remedy


def test_a_compiler_that_fails(monkeypatch) -> None:
    import numba

    def fails(*_: object, **__: object) -> object:
        raise RuntimeError("LLVM is broken")

    monkeypatch.setattr(numba, "jit", fails)
    found = checkups.rendering()
    assert found.verdict == MISSING and "LLVM is broken" in found.what and found.remedy


def test_a_cache_that_cannot_be_kept(monkeypatch) -> None:
    monkeypatch.setattr(kernel_cache, "_trouble", None)
    kernel_cache._complain("/nowhere: Permission denied")
    found = checkups.cache()
    assert found.verdict == MISSING
    assert "/nowhere: Permission denied" in found.what and "XDG_CACHE_HOME" in found.remedy


def test_a_disk_that_is_full(monkeypatch) -> None:
    monkeypatch.setattr(kernel_cache, "_trouble", None)
    monkeypatch.setattr(checkups.shutil, "disk_usage", lambda folder: types.SimpleNamespace(free=1e6))
    found = checkups.cache()
    assert found.verdict == MISSING and "1 MB" in found.what and found.remedy


def test_pipewire_by_its_socket(monkeypatch, tmp_path) -> None:
    import socket

    monkeypatch.setenv("PIPEWIRE_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("PIPEWIRE_REMOTE", raising=False)
    assert checkups.pipewire().verdict == MISSING
    monkeypatch.chdir(tmp_path)  # the whole name may be too long for a socket's
    monkeypatch.setenv("PIPEWIRE_RUNTIME_DIR", ".")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind("pipewire-0")
        server.listen()
        assert checkups.pipewire().verdict == OK
    monkeypatch.setattr(checkups.sys, "platform", "darwin")
    assert checkups.pipewire().verdict == NOT_TRIED


def test_a_machine_without_a_browser(monkeypatch) -> None:
    def none(using: str | None = None) -> None:
        raise webbrowser.Error("could not locate runnable browser")

    monkeypatch.setattr(webbrowser, "get", none)
    monkeypatch.setattr(checkups.shutil, "which", lambda name: None)
    found = checkups.page()
    assert found.verdict == MISSING and "address" in found.remedy
    monkeypatch.setattr(checkups.shutil, "which", lambda name: f"/usr/bin/{name}" if name == "chromium" else None)
    found = checkups.page()
    assert found.verdict == OK and "chromium is installed, but this session has no display" in found.what
    assert "address" in found.what


def test_plugins_that_are_installed_are_counted(monkeypatch, tmp_path) -> None:
    from synth.plugin.library import FOOT

    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setattr(checkups, "_make_no_folders", lambda: None)
    (tmp_path / ".clap").mkdir()
    (tmp_path / ".clap" / "mine.clap").write_bytes(b"code" + FOOT)
    (tmp_path / ".clap" / "other.clap").write_bytes(b"code of somebody else's")
    (tmp_path / ".clap" / "empty.clap").write_bytes(b"")
    inside = tmp_path / ".vst3" / "mine.vst3" / "Contents" / "x86_64-linux"
    inside.mkdir(parents=True)
    (inside / "mine.so").write_bytes(FOOT)
    said = checkups.plugins().what
    if checkups.plugins().verdict != NOT_TRIED:  # another system than Linux
        assert said.startswith("1 in ~/.clap, 1 in ~/.vst3, 0 in ~/.lv2")
    monkeypatch.setattr("sys.platform", "freebsd14")
    assert checkups.plugins().verdict == NOT_TRIED


# --- checkups in processes of their own


def test_a_checkup_that_hangs_is_given_up_and_one_that_crashes_is_told(monkeypatch) -> None:
    begin = "import sys; name = sys.argv[2]\n"
    begin += "if name == 'hangs': import time; time.sleep(1000)\n"
    begin += "if name == 'crashes': import os; os.abort()\n"
    begin += "if name == 'is silent': raise SystemExit(3)\n"
    begin += f"print('noise of a library'); print({apart._MARK!r} + '[\"ok\", \"fine\", \"\"]'); print('more')\n"
    monkeypatch.setattr(apart, "_BEGIN", begin)
    with apart.Patients(["fine", "crashes", "is silent"], 600.0) as patients:
        assert patients.finding("fine") == Finding(OK, "fine")
        for name in ("crashes", "is silent"):
            found = patients.finding(name)
            assert found.verdict == NOT_TRIED and "crashed during the check" in found.what and found.remedy
    with apart.Patients(["hangs"], 0.2) as patients:
        found = patients.finding("hangs")
        process = patients._running["hangs"]
    assert found.verdict == NOT_TRIED and "no answer within 0.2 s" in found.what
    assert isinstance(process, subprocess.Popen) and process.poll() is not None


def test_no_process_to_be_had_is_a_finding(monkeypatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr(apart.subprocess, "Popen", refused)
    with apart.Patients(["audio"], 5.0) as patients:
        assert patients.finding("audio").verdict == NOT_TRIED


def test_what_a_checkup_raises_is_a_finding(monkeypatch) -> None:
    def fails() -> Finding:
        raise KeyError("two\nlines")

    monkeypatch.setitem(checkups.CHECKUPS, "audio", fails)
    found = checkups.look("audio")
    assert found.verdict == NOT_TRIED and "KeyError" in found.what and "\n" not in found.what


# --- the command


class Healthy:
    """In the place of Patients."""

    findings: dict[str, Finding]

    def __init__(self, names: list[str], seconds: float) -> None:
        assert names == list(CHECKUPS) and seconds == 30.0

    def __enter__(self):
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def finding(self, name: str) -> Finding:
        return self.findings.get(name, Finding(OK, "fine"))


@pytest.mark.parametrize(
    ("name", "verdict", "code"),
    [
        ("audio", OK, 0),
        ("audio", MISSING, 0),
        ("JACK", NOT_TRIED, 0),
        ("rendering", MISSING, 1),
        ("rendering", NOT_TRIED, 1),
    ],
)
def test_the_exit_code_is_about_rendering(monkeypatch, capsys, name: str, verdict: str, code: int) -> None:
    monkeypatch.setattr(doctor, "Patients", Healthy)
    monkeypatch.setattr(Healthy, "findings", {name: Finding(verdict, "as it is", "do this")}, raising=False)
    assert cli.main(["doctor"]) == code
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + len(CHECKUPS) + 1
    assert any(line.startswith(verdict) and name in line and "as it is" in line for line in lines)
    assert any(line.strip() == "→ do this" for line in lines)
    assert cli.main(["doctor", "--json"]) == code
    assert json.loads(capsys.readouterr().out)["renders"] == (code == 0)


def test_messages_with_a_remedy_are_split() -> None:
    split = checkups._missing
    assert split("no server answers (name: x): start one, like a: b") == Finding(
        MISSING, "no server answers (name: x)", "start one, like a: b"
    )
    assert split("it is gone") == Finding(MISSING, "it is gone")
    assert split("a: b", "c") == Finding(MISSING, "a: b", "c")
