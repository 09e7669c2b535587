"""What `synth doctor` looks at: each part of the program and of the machine by a function of its own.

Each says in a Finding how it is; it may take long, fail or end its process (`apart` sees to that). None writes anything.
"""

from __future__ import annotations

import os
import re
import shutil
import socket
import sys
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from synth.native.debugging import INTERPRETED

OK, MISSING, NOT_TRIED = "ok", "missing", "not tried"
#: less than this on the disk of the cache is too little for kernels and the native library [bytes]
LEAST_DISK = 200e6
#: browsers by the names of their programs
BROWSERS = (
    "firefox", "firefox-esr", "chromium", "chromium-browser", "google-chrome", "brave-browser", "epiphany", "falkon",
    "opera", "vivaldi", "microsoft-edge",
)  # fmt: skip
LIVE = "pip install 'jawari[live]'"


class Finding(NamedTuple):
    """How something is. verdict: OK, MISSING or NOT_TRIED; what: in a few words; remedy: what helps, empty where nothing
    is needed."""

    verdict: str
    what: str
    remedy: str = ""


def _missing(reason: object, remedy: str = "") -> Finding:
    """Missing, by a message that may hold its remedy behind a colon."""
    text = " ".join(str(reason).split())
    found = None if remedy else re.match(r"((?:[^:(]|\([^)]*\))*): (.*)$", text)
    return Finding(MISSING, found[1], found[2]) if found else Finding(MISSING, text, remedy)


def rendering() -> Finding:
    """Whether `synth render` has what it needs: libraries, a compiler that works, presets."""
    versions = []
    for name in ("numpy", "numba", "mido", "pydantic", "threadpoolctl", "tomlkit", "soundfile"):
        try:
            library = import_module(name)
            shown = {"numpy": "NumPy", "numba": "Numba"}.get(name)
            if shown is not None:
                versions.append(f"{shown} {library.__version__}")
            elif name == "soundfile":
                versions.append(f"libsndfile {library.__libsndfile_version__.removeprefix('libsndfile-')}")
        except Exception as error:  # whatever a broken library raises
            remedy = f"pip install --force-reinstall {name}"
            if "sndfile" in str(error):
                remedy = "install libsndfile (Debian: apt-get install libsndfile1; macOS: brew install libsndfile)"
            return Finding(MISSING, f"{name} cannot be loaded: {' '.join(str(error).split())}", remedy)
    again = "pip install --force-reinstall numba llvmlite"
    try:
        import numba

        if numba.jit(nopython=True)(lambda x: x + 1)(1) != 2:
            raise ArithmeticError("it computes wrong results")
    except Exception as error:
        return Finding(MISSING, f"Numba cannot compile here: {' '.join(str(error).split())}", again)
    from synth.instrument.preset import list_presets

    try:
        count = len(list_presets())
    except (OSError, ValueError) as error:
        return Finding(MISSING, f"the presets cannot be read: {error}", "install jawari again")
    if not count:
        return Finding(MISSING, "there are no presets", "install jawari again")
    return Finding(OK, f"{count} presets; {', '.join(versions)}")


def kernels() -> Finding:
    """Where compiled kernels will come from."""
    from synth.jit import compiling, kernel_cache, prebuilt

    if (found := prebuilt.found()).path is not None:
        return Finding(OK, f"from the native library {found.path}: nothing is compiled")
    if INTERPRETED:
        return Finding(MISSING, "JAWARI_DEBUG interprets them, which takes a thousand times as long", "unset JAWARI_DEBUG")
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return Finding(MISSING, "NUMBA_DISABLE_JIT switches compiling off", "unset NUMBA_DISABLE_JIT")
    _make_no_folders()
    import_module("synth.engine.engine")
    missing, all_there_are = compiling.to_come()
    if kernel_cache.trouble() is not None:
        return Finding(OK, "compiled at every start, ½ to 2 minutes, as they cannot be kept (see cache)")
    if missing == all_there_are:
        return Finding(OK, "the first start compiles them, once on this machine; takes ½ to 2 minutes")
    folder = os.environ.get("NUMBA_CACHE_DIR") or kernel_cache.cache_folder()
    more = f", except {missing} not needed so far" if missing else ""
    return Finding(OK, f"compiled and kept in {folder}{more}")


def _make_no_folders() -> None:
    """Let Numba make no folders for kernels that are imported from now on, in a process that compiles none."""
    from numba.core import caching

    caching._CacheLocator.ensure_cache_path = lambda self: None  # type: ignore[method-assign]


def cache() -> Finding:
    """Whether what was compiled can be kept."""
    from synth.jit import kernel_cache

    if (trouble := kernel_cache.trouble()) is not None:
        why, _, remedy = trouble.rpartition("): ")
        return Finding(MISSING, f"{why})", remedy)
    folder = Path(os.environ.get("NUMBA_CACHE_DIR") or kernel_cache.cache_folder())
    free = shutil.disk_usage(next(each for each in (folder, *folder.parents) if each.is_dir())).free
    if free < LEAST_DISK:
        return Finding(MISSING, f"{free / 1e6:.0f} MB are free for {folder}", "make room, or set XDG_CACHE_HOME elsewhere")
    return Finding(OK, f"{folder.parent} can be written, {free / 1e9:.1f} GB free")


def processor() -> Finding:
    """What computes."""
    from synth.jit import vector_width
    from synth.jit.kernel_helpers import free_memory
    from synth.native.processors import cores, level

    name = level() or "no level of x86-64 from v3 on: Numba's own choice"
    lanes = {"x86-64-v4": "vectors of 8 doubles", "x86-64-v3": "vectors of 4 doubles"}.get(name, "")
    lanes = f", {vector_width.described() or lanes}".rstrip(", ")
    memory = free_memory()
    free = "" if memory == float("inf") else f", {memory / 1e9:.1f} GB of memory free"
    count = cores()
    return Finding(OK, f"{count} processor{'' if count == 1 else 's'}, {name}{lanes}{free}")


def audio() -> Finding:
    """Outputs for `synth play`."""
    _make_no_folders()
    from synth.live.errors import DeviceError
    from synth.live.portaudio import devices

    try:
        there = devices()
    except DeviceError as reason:
        return _missing(reason)
    if not there:
        return Finding(
            MISSING,
            "PortAudio finds no audio output",
            "plug a sound card in or start a sound server (PipeWire, JACK); synth render needs none",
        )
    chosen = next((each for each in there if each["default"]), there[0])
    more = f", {len(there) - 1} more by `synth devices`" if len(there) > 1 else ""
    return Finding(OK, f"{chosen['name']} ({chosen['host_api']}), {chosen['default_rate_hz']:g} Hz{more}")


def midi() -> Finding:
    """Inputs for `synth play`."""
    _make_no_folders()
    from synth.midi import ports

    system, why_none = ports.midi_system()
    if not system:
        if "not installed" in why_none:
            return _missing(why_none.partition(";")[0], LIVE)
        remedies = {"linux": "modprobe snd-seq, as root; synth play --jack receives JACK MIDI without it"}
        return _missing(why_none.partition(" (")[0], remedies.get(sys.platform, "restart the system's MIDI service"))
    names = ports.port_names()
    return Finding(OK, f"{system}: {', '.join(names) or 'no input yet; one plugged in later is found'}")


def jack() -> Finding:
    """Whether `synth play --jack` finds a server."""
    from synth.live import jackserver
    from synth.live.errors import DeviceError

    try:
        server = jackserver.server_of()
    except DeviceError as reason:
        if "no JACK server" in str(reason):
            remedy = (
                "only for --jack: start one (QjackCtl, jackd -d alsa), or let PipeWire be one (pw-jack synth play --jack)"
            )
            return _missing(str(reason).partition(" (")[0], remedy)
        return _missing(reason)
    return Finding(OK, f"a server runs at {server.rate_hz} Hz, {server.frames} frames")


def pipewire() -> Finding:
    """Whether PipeWire runs, and may stand in for JACK."""
    if not sys.platform.startswith("linux"):
        return Finding(NOT_TRIED, "only on Linux")
    folder = next((os.environ[name] for name in ("PIPEWIRE_RUNTIME_DIR", "XDG_RUNTIME_DIR") if os.environ.get(name)), None)
    remote = os.environ.get("PIPEWIRE_REMOTE") or "pipewire-0"
    path = remote if os.path.isabs(remote) else os.path.join(folder or f"/run/user/{os.getuid()}", remote)
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(path)
        except OSError:
            return Finding(
                MISSING, "does not answer", "not needed if sound works otherwise; else systemctl --user start pipewire"
            )
    if shutil.which("pw-jack") is None:
        return Finding(OK, "runs; for `pw-jack synth play --jack` install pipewire-jack")
    return Finding(OK, "runs; pw-jack synth play --jack is a JACK client of it")


def page() -> Finding:
    """Whether `synth author` can serve its page, and there is a browser for it."""
    import webbrowser
    from importlib.util import find_spec

    if lacking := [name for name in ("starlette", "uvicorn", "websockets") if find_spec(name) is None]:
        return Finding(MISSING, f"no {', '.join(lacking)}", "pip install 'jawari[author]'")
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        if installed := next(filter(shutil.which, BROWSERS), None):
            return Finding(
                OK,
                f"can be served; {installed} is installed, but this session has no display: open the address that "
                "synth author prints in a browser that reaches this machine",
            )
        return Finding(
            MISSING,
            "the page can be served; there is no browser to open it",
            "install one, or set BROWSER; synth author prints the address",
        )
    return Finding(OK, f"opens in {os.path.basename(getattr(browser, 'name', '') or 'the default browser')}")


def plugins() -> Finding:
    """Plugins of this program where music programs look for them, and whether they can be made."""
    _make_no_folders()
    from synth.plugin import bundle

    try:
        bundle.require_system()
    except ValueError as reason:
        return Finding(NOT_TRIED, str(reason).partition(":")[0])
    counts = []
    for kind in bundle.FORMATS:
        try:
            folder = bundle.users_folder(kind)
            count = sum(_ours(kind, each) for each in folder.iterdir()) if folder.is_dir() else 0
        except OSError as error:
            return Finding(MISSING, str(error), "set HOME to your home directory")
        counts.append(f"{count} in ~/.{kind}")
    return _buildable(", ".join(counts))


def _ours(kind: str, path: Path) -> bool:
    """Whether a plugin is one of this program's: it ends with a bank."""
    from synth.plugin.library import FOOT

    if path.suffix != f".{kind}":
        return False
    files = [path] if path.is_file() else list(path.rglob("*.so"))
    for each in files:
        try:
            with open(each, "rb") as file:
                file.seek(-len(FOOT), os.SEEK_END)
                if file.read() == FOOT:
                    return True
        except OSError:
            continue
    return False


def _buildable(installed: str) -> Finding:
    from synth.plugin import library

    try:
        command = library.compiler()
    except library.BuildError as reason:
        from synth.jit import prebuilt

        if any(path.is_file() for path in prebuilt.places()):
            return Finding(OK, f"{installed}; the native library is there")
        return Finding(MISSING, f"{installed}; {str(reason).partition(';')[0]}", str(reason).partition("; ")[2])
    return Finding(OK, f"{installed}; more are built with {os.path.basename(command[0])}")


#: by name, in the order in which they are told
CHECKUPS: dict[str, Callable[[], Finding]] = {
    "rendering": rendering,
    "kernels": kernels,
    "cache": cache,
    "processor": processor,
    "audio": audio,
    "MIDI": midi,
    "JACK": jack,
    "PipeWire": pipewire,
    "page": page,
    "plugins": plugins,
}
#: without which nothing is rendered
NEEDED = ("rendering",)


def look(name: str) -> Finding:
    """A checkup by its name; what it raises is a finding too."""
    try:
        return CHECKUPS[name]()
    except Exception as error:
        return broken(error)


def broken(error: Any) -> Finding:
    """Of a checkup that could not be made."""
    said = " ".join(str(error).split())
    return Finding(NOT_TRIED, f"{type(error).__name__}: {said}" if said else type(error).__name__)
