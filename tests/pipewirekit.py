"""A private PipeWire with its session manager and a sink that sounds nowhere, and recorders of what goes there: what most
Linux desktops run, without a sound card and apart from any PipeWire of this machine.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np

from tests.patience import patience_s

SINK = "jawari-null"
#: what has to be there, and the Debian package it is in
PROGRAMS = {
    "pipewire": "pipewire",
    "pw-record": "pipewire-bin",
    "pw-metadata": "pipewire-bin",
    "pw-dump": "pipewire-bin",
    "wireplumber": "wireplumber",
    "dbus-daemon": "dbus",
    "pw-jack": "pipewire-jack",
}
PULSE = {"pipewire-pulse": "pipewire-pulse"}
#: where Debian and others put what makes PipeWire an ALSA device
ALSA_PLUG_IN = ("/usr/share/alsa/alsa.conf.d/50-pipewire.conf", "/etc/alsa/conf.d/50-pipewire.conf")

# A sink of the graph's own clock.  Its monitor is taken before any volume.
_SINK = """
context.properties = {{
    default.clock.rate = {rate}
    default.clock.allowed-rates = [ 44100 48000 88200 96000 ]
    default.clock.quantum = {quantum}
    default.clock.min-quantum = {least}
}}
context.objects = [
    {{ factory = adapter
       args = {{
           factory.name = support.null-audio-sink
           node.name = "{sink}"
           node.description = "{sink}"
           media.class = Audio/Sink
           audio.position = "FL,FR"
           monitor.channel-volumes = false
           object.linger = true
       }}
    }}
]
"""
_ALSA = """
<{plug_in}>
pcm.!default {{ type pipewire playback_node "-1" capture_node "-1" hint {{ show on }} }}
ctl.!default {{ type pipewire }}
"""


def why_not(pulse: bool = False) -> str:
    """Why none, or none that programs made for PulseAudio can use, can be started here; empty if one can."""
    programs = PROGRAMS | (PULSE if pulse else {})
    missing = {package for program, package in programs.items() if shutil.which(program) is None}
    if not any(Path(file).exists() for file in ALSA_PLUG_IN):
        missing.add("pipewire-alsa")
    return f"PipeWire is not all there: apt-get install {' '.join(sorted(missing))}" if missing else ""


class PipeWire:
    """A running PipeWire, to be used with `with`.

    env      environment of a process for which ALSA's default device, and no other, is this server
    rate_hz, quantum   of the graph; it asks for so many frames at a time unless a stream wants fewer
    pulse    whether programs made for PulseAudio find it too, by PULSE_SERVER of `env`
    Raises RuntimeError, with what was said, where it does not start.
    """

    def __init__(self, quantum: int = 1024, rate_hz: int = 44100, *, pulse: bool = False) -> None:
        self.rate_hz, self.quantum = rate_hz, quantum
        # A socket's path is short.
        self._folder = Path(tempfile.mkdtemp(prefix="jawari-pw-", dir="/tmp"))
        self._processes: list[subprocess.Popen] = []
        self._log = open(self._folder / "log", "w+b")
        runtime, config = self._folder / "run", self._folder / "config"
        runtime.mkdir(mode=0o700)
        parts = config / "pipewire" / "pipewire.conf.d"
        parts.mkdir(parents=True)
        (parts / "sink.conf").write_text(_SINK.format(rate=rate_hz, quantum=quantum, least=min(quantum, 32), sink=SINK))
        (self._folder / "alsa.conf").write_text(self._alsa())
        hidden = ("PIPEWIRE_", "PULSE_", "JACK_", "DBUS_")
        self.env = {name: value for name, value in os.environ.items() if not name.startswith(hidden)} | {
            "XDG_RUNTIME_DIR": str(runtime),
            "XDG_CONFIG_HOME": str(config),
            "XDG_STATE_HOME": str(self._folder / "state"),
            "ALSA_CONFIG_PATH": str(self._folder / "alsa.conf"),
            "PULSE_SERVER": f"unix:{runtime}/{'pulse/native' if pulse else 'nobody'}",
        }
        try:
            bus = self._start(["dbus-daemon", "--session", "--nofork", "--print-address=1"], stdout=subprocess.PIPE)
            assert bus.stdout is not None
            self.env["DBUS_SESSION_BUS_ADDRESS"] = bus.stdout.readline().decode().strip()
            self._start(["pipewire"])
            self.wait_for(lambda: (runtime / "pipewire-0").exists(), "PipeWire's socket")
            self._start(["wireplumber"])
            self.wait_for(self._is_default, "the sink to be the default")
            if pulse:
                self._start(["pipewire-pulse"])
                self.wait_for((runtime / "pulse" / "native").exists, "PulseAudio's socket")
        except BaseException:
            self.end()
            raise

    def _alsa(self) -> str:
        plug_in = next(file for file in ALSA_PLUG_IN if Path(file).exists())
        return _ALSA.format(plug_in=plug_in)

    def _start(self, command: list[str], **how: object) -> subprocess.Popen:
        process = subprocess.Popen(command, env=self.env, **{"stdout": self._log, "stderr": self._log, **how})  # type: ignore[call-overload]
        self._processes.append(process)
        return process

    def _is_default(self) -> bool:
        told = self.ask("pw-metadata", "0", "default.audio.sink")
        return f'"{SINK}"' in told

    def ask(self, *command: str) -> str:
        """What a command says; "" if it fails."""
        done = subprocess.run(command, env=self.env, capture_output=True, text=True, timeout=patience_s())
        return done.stdout if done.returncode == 0 else ""

    def nodes(self) -> list[dict]:
        """The properties of every node of the graph."""
        found = json.loads(self.ask("pw-dump") or "[]")
        nodes = [each for each in found if each["type"] == "PipeWire:Interface:Node"]
        return [{**each["info"]["props"], "state": each["info"]["state"]} for each in nodes]

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        begun = time.monotonic()
        while not condition():
            gone = [each.args for each in self._processes if each.poll() is not None]
            if gone or time.monotonic() - begun > patience_s():
                raise RuntimeError(f"waited for {what}; {gone} ended; {self.said()}")
            time.sleep(0.05)

    def said(self) -> str:
        """What the servers have said."""
        return (self._folder / "log").read_text(errors="replace")[-2000:]

    def jack(self, *command: str) -> list[str]:
        """A command whose libjack is PipeWire's."""
        return ["pw-jack", *command]

    def __enter__(self) -> PipeWire:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def kill(self) -> None:
        """PipeWire dies; the rest stays."""
        self._processes[1].kill()
        self._processes[1].wait()

    def end(self) -> None:
        """Ends all of it. May be called again."""
        for process in reversed(self._processes):
            process.terminate()
        for process in reversed(self._processes):
            try:
                process.wait(patience_s(5.0))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            if process.stdout is not None:
                process.stdout.close()
        self._processes.clear()
        self._log.close()
        shutil.rmtree(self._folder, ignore_errors=True)


class Record:
    """What goes to the sink from now on, as `pw-record` has it; once made, it runs."""

    _count = 0

    def __init__(self, server: PipeWire, folder: Path) -> None:
        Record._count += 1
        self._server = server
        self._name = f"recorder-{Record._count}"
        self.file = folder / f"{self._name}.wav"
        wanted = f'{{ stream.capture.sink=true node.name="{self._name}" }}'
        self._process = subprocess.Popen(
            [
                *("pw-record", "--target", SINK, "-P", wanted, "--format", "f32"),
                *("--channels", "2", "--rate", str(server.rate_hz), str(self.file)),
            ],
            env=server.env,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        try:
            server.wait_for(self._runs, "the recorder to run")
        except BaseException:
            self.stop()
            raise

    def _runs(self) -> bool:
        return any(node.get("node.name") == self._name and node["state"] == "running" for node in self._server.nodes())

    def stop(self) -> None:
        with suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGINT)  # it ends the file as it should
        try:
            self._process.wait(patience_s())
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def samples(self) -> np.ndarray:
        """(2, frames) float32, bit for bit; ends the recording."""
        import soundfile

        self.stop()
        return soundfile.read(self.file, dtype="float32", always_2d=True)[0].T
