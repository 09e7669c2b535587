"""Without what only POSIX has: every module is imported, a song is rendered, files get their names, devices are found."""

import errno
import os
import socket
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile

from synth.files import locks, sources, targets
from synth.host import audiofile
from synth.jit import kernel_helpers, kernel_sources
from synth.live import portaudio, terminal
from synth.midi import ports
from tests.patience import compiling_s

ROOT = Path(__file__).resolve().parents[1]

EVERY_MODULE = """
import importlib, pkgutil, sys
from tests import otheros
otheros.begin()
otheros.pretend()
for name in [name for name in sys.modules if name.partition(".")[0] == "synth"]:
    del sys.modules[name]
import synth
names = [each.name for each in pkgutil.walk_packages(synth.__path__, "synth.")]
for name in names:
    if name != "synth.__main__":
        importlib.import_module(name)
print(len(names))
"""

A_SONG = """
import os, sys
from tests import otheros
otheros.begin()
import synth.files.targets, synth.host.audiofile
synth.files.targets._CLOSED_FIRST, synth.host.audiofile._BY_NUMBER = True, False
from synth.cli import main
code = main(sys.argv[1:])
assert not hasattr(os, "getuid") and not hasattr(os, "pwrite")
sys.exit(code)
"""


def elsewhere(program: str, *arguments: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", program, *arguments],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
        capture_output=True,
        text=True,
        timeout=compiling_s(),
    )


def test_every_module_is_imported_without_posix(tmp_path) -> None:
    # no kernels are kept from it: their sources are the same, what they call is not
    done = elsewhere(EVERY_MODULE, cwd=tmp_path, XDG_CACHE_HOME=str(tmp_path / "cache"), NUMBA_CACHE_DIR="")
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 300


@pytest.mark.parametrize("ending", ["wav", "flac", "raw"])
def test_a_song_is_rendered_without_posix(tmp_path, ending: str) -> None:
    song = str(ROOT / "presets" / "demos" / "drone.mid")
    how = [song, "-p", "tanpura-light", "--quality", "draft", "--threads", "1", "--end", "0.05", "--tail", "0", "--quiet"]
    if ending == "wav":  # what is there is replaced
        (tmp_path / "out.wav").write_bytes(b"from before")
    done = elsewhere(A_SONG, "render", *how, "-o", f"out.{ending}", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert os.listdir(tmp_path) == [f"out.{ending}"]
    assert (tmp_path / f"out.{ending}").stat().st_size > 1000


def test_a_song_that_is_none_is_told_without_posix(tmp_path) -> None:
    (tmp_path / "s.mid").write_bytes(b"no song")
    done = elsewhere(A_SONG, "render", "s.mid", "-o", "out.wav", cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.startswith("synth: error: s.mid: ")
    assert os.listdir(tmp_path) == ["s.mid"]


# --- files


@pytest.mark.parametrize("ends_well", [True, False])
def test_files_are_closed_before_they_are_renamed_or_removed(monkeypatch, tmp_path, ends_well: bool) -> None:
    monkeypatch.setattr(targets, "_CLOSED_FIRST", True)
    whole = targets.Whole(tmp_path / "file")
    handle = whole.open()
    os.write(handle, b"new")

    def open_still() -> bool:
        try:
            os.fstat(handle)
        except OSError:
            return False
        return True

    seen = []
    replace, unlink = os.replace, Path.unlink
    monkeypatch.setattr(os, "replace", lambda *names: (seen.append(open_still()), replace(*names)))
    monkeypatch.setattr(Path, "unlink", lambda self, **how: (seen.append(open_still()), unlink(self, **how)))
    whole.commit() if ends_well else whole.discard()
    assert seen == [False]
    assert [path.name for path in tmp_path.iterdir()] == ["file"] * ends_well


@pytest.mark.parametrize(("container", "bit_depth"), [("wav", "24"), ("wav", "float"), ("flac", "16"), ("raw", "16")])
def test_files_by_objects_are_those_by_numbers(monkeypatch, tmp_path, container: str, bit_depth: str) -> None:
    block = 0.5 * np.sin(np.arange(6000.0)).reshape(-1, 2)

    def write(name: str) -> bytes:
        with audiofile.AudioWriter(
            tmp_path / name, 44100, container=container, bit_depth=bit_depth, growing=container == "wav"
        ) as writer:
            writer.write(block)
            writer.write(block)
        return (tmp_path / name).read_bytes()

    by_number = write("number")
    monkeypatch.setattr(audiofile, "_BY_NUMBER", False)
    open_before = len(os.listdir("/proc/self/fd")) if os.path.isdir("/proc/self/fd") else None
    assert write("object") == by_number
    if open_before is not None:
        assert len(os.listdir("/proc/self/fd")) == open_before
    if container != "raw":
        assert len(soundfile.read(tmp_path / "object")[0]) == 6000


def test_a_full_disk_is_told_without_pwrite(monkeypatch, tmp_path) -> None:
    monkeypatch.delattr(os, "pwrite", raising=False)
    monkeypatch.setattr(audiofile, "_BY_NUMBER", False)
    writer = audiofile.AudioWriter(tmp_path / "full.wav", 44100)
    with pytest.raises(OSError, match="No space left"), writer:

        def full(*_: object) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        class Broken:
            def write(self, samples: object) -> None:
                raise soundfile.LibsndfileError(2)

            def close(self) -> None:
                pass

        writer._sound.close()
        writer._sound = Broken()
        monkeypatch.setattr(os, "write", full)
        writer.write(np.zeros((10, 2)))
    assert os.listdir(tmp_path) == []


def test_files_are_read_without_posix_words(monkeypatch, tmp_path) -> None:
    (tmp_path / "file").write_bytes(b"a\r\nb\x1ac")
    monkeypatch.delattr(os, "O_NOFOLLOW", raising=False)
    assert sources.read_file(tmp_path / "file", 100, "preset", follow=False) == b"a\r\nb\x1ac"


def test_locks_of_windows(monkeypatch, tmp_path) -> None:
    """The first byte of the file, by the C library: the second who wants it is refused."""
    import types

    held: set[int] = set()

    def locking(handle: int, how: int, count: int) -> None:
        assert (how, count) == (2, 1) and os.lseek(handle, 0, os.SEEK_CUR) == 0
        if held:
            raise PermissionError(errno.EACCES, "Permission denied")
        held.add(handle)

    monkeypatch.setattr(locks, "fcntl", None)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setitem(sys.modules, "msvcrt", types.SimpleNamespace(locking=locking, LK_NBLCK=2))
    with open(tmp_path / "lock", "w+b") as one, open(tmp_path / "lock", "r+b") as two:
        one.write(b"some")
        assert locks.taken(one.fileno())
        assert not locks.taken(two.fileno())


def test_locks_of_this_system(tmp_path) -> None:
    with open(tmp_path / "lock", "wb") as one, open(tmp_path / "lock", "rb") as two:
        assert locks.taken(one.fileno())
        assert not locks.taken(two.fileno())
        one.close()
        assert locks.taken(two.fileno())


@pytest.mark.parametrize(
    ("platform", "environment", "folder"),
    [
        ("linux", {}, "HOME/.cache/jawari"),
        ("darwin", {}, "HOME/Library/Caches/jawari"),
        ("win32", {"LOCALAPPDATA": "/local"}, "/local/jawari"),
        ("win32", {}, "HOME/AppData/Local/jawari"),
        *((platform, {"XDG_CACHE_HOME": "/asked"}, "/asked/jawari") for platform in ("linux", "darwin", "win32")),
    ],
)
def test_where_a_users_cache_is(monkeypatch, tmp_path, platform: str, environment: dict[str, str], folder: str) -> None:
    for name in ("XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in {"HOME": str(tmp_path), **environment}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys, "platform", platform)
    assert kernel_sources.users_cache() == Path(folder.replace("HOME", str(tmp_path)))


def test_no_helpers_are_started_on_windows(monkeypatch) -> None:
    monkeypatch.setattr(kernel_helpers, "cores", lambda: 8)
    monkeypatch.setattr(kernel_helpers, "free_memory", lambda: 64e9)
    assert kernel_helpers._may_run() == kernel_helpers.MOST
    monkeypatch.setattr(sys, "platform", "win32")
    assert kernel_helpers._may_run() == 0


# --- devices


def device(name: str, api: str, index: int, default: bool = False) -> dict:
    return {"index": index, "name": name, "host_api": api, "channels": 2, "default": default}


WINDOWS = [
    device("Speakers (High Definition Audio", "MME", 3, default=True),  # 31 letters
    device("Speakers (High Definition Audio Device)", "Windows DirectSound", 7),
    device("Speakers (High Definition Audio Device)", "Windows WASAPI", 11),
    device("Speakers (High Definition Audio Device)", "Windows WDM-KS", 15),
    device("Headphones (USB)", "Windows WASAPI", 12),
]
MAC = [device("MacBook Speakers", "Core Audio", 0, default=True), device("MacBook Speakers 2", "Core Audio", 1)]


@pytest.mark.parametrize(
    ("there", "wanted", "index"),
    [
        (WINDOWS, None, 3),
        (WINDOWS, "speakers", 11),
        (WINDOWS, "Speakers (High Definition Audio Device)", 11),
        (WINDOWS, "speakers (high definition audio device) (windows directsound)", 7),
        (WINDOWS, "usb", 12),
        (WINDOWS, "7", 7),
        (WINDOWS, "mme", 3),
        (MAC, "macbook speakers", 0),
        (MAC, "speakers 2", 1),
    ],
)
def test_devices_of_other_systems(monkeypatch, there: list[dict], wanted: str | None, index: int) -> None:
    monkeypatch.setattr(portaudio, "devices", lambda: there)
    assert portaudio.find_device(wanted)["index"] == index


@pytest.mark.parametrize(("there", "wanted"), [(WINDOWS, "wasapi"), (MAC, "macbook")])
def test_different_devices_are_not_taken_for_one(monkeypatch, there: list[dict], wanted: str) -> None:
    monkeypatch.setattr(portaudio, "devices", lambda: there)
    with pytest.raises(portaudio.DeviceError, match="fits several"):
        portaudio.find_device(wanted)


@pytest.mark.parametrize(
    ("platform", "name", "plain"),
    [
        ("linux", "Launchkey 49:Launchkey 49 MIDI 1 20:0", "Launchkey 49:Launchkey 49 MIDI 1"),
        ("linux", "Launchkey 49", "Launchkey 49"),
        ("win32", "Launchkey 49 1", "Launchkey 49"),  # the last number is the port's
        ("darwin", "Launchkey 49", "Launchkey 49"),
        ("darwin", "IAC Driver Bus 1", "IAC Driver Bus 1"),
    ],
)
def test_names_of_midi_ports_without_what_changes(monkeypatch, platform: str, name: str, plain: str) -> None:
    monkeypatch.setattr(sys, "platform", platform)
    assert ports._plain(name) == plain
    assert ports.find_port(plain, ["another", name]) == 1


def test_no_jack_socket_is_looked_for_where_there_are_none(monkeypatch) -> None:
    monkeypatch.delattr(os, "getuid")
    assert ports._jack_socket() is None


# --- terminal and page


def test_ctrl_c_of_a_windows_console_interrupts_and_does_not_kill(monkeypatch) -> None:
    import types

    typed = ["\x03", "a", "\xe0", "H"]
    console = types.SimpleNamespace(kbhit=lambda: bool(typed), getwch=lambda: typed.pop(0))
    monkeypatch.setitem(sys.modules, "msvcrt", console)
    monkeypatch.delattr(os, "kill")
    keys = terminal.Console()
    monkeypatch.setattr(keys, "_open", True)
    with pytest.raises(KeyboardInterrupt):
        keys.read(1.0)
    assert keys.read(1.0) == b"a"
    assert keys.read(1.0) == b"\x1b[A"
    assert keys.read(0.0) == b""


def test_a_typed_ctrl_c_without_process_groups(monkeypatch) -> None:
    monkeypatch.delattr(os, "killpg")
    with pytest.raises(KeyboardInterrupt):
        terminal.signal_as_typed("\x03")


@pytest.mark.parametrize("windows", [False, True])
def test_the_pages_port_is_not_shared(monkeypatch, windows: bool) -> None:
    from synth.author import serve

    monkeypatch.delattr(socket, "SO_EXCLUSIVEADDRUSE", raising=False)
    if windows:
        monkeypatch.setattr(socket, "SO_EXCLUSIVEADDRUSE", ~socket.SO_REUSEADDR, raising=False)
    asked = []

    class Listening:
        def setsockopt(self, level: int, option: int, value: int) -> None:
            asked.append((level, option, value))

    serve._keep_to_ourselves(Listening())  # type: ignore[arg-type]
    assert asked == [(socket.SOL_SOCKET, ~socket.SO_REUSEADDR if windows else socket.SO_REUSEADDR, 1)]


def test_a_workspace_of_windows_is_not_locked_but_works(monkeypatch, tmp_path) -> None:
    from synth.author import workspace

    there = workspace.Workspace(tmp_path)
    with there.alone(), pytest.raises(OSError, match="another `synth author`"), workspace.Workspace(tmp_path).alone():
        pass
    monkeypatch.setattr(sys, "platform", "win32")
    with there.alone(), workspace.Workspace(tmp_path).alone():
        pass
