"""JACK servers as the package JACK-Client shows them: which one there is, and how it runs. Loads nothing heavy.

PipeWire stands in for a server where its libjack is the one that is found.
"""

from __future__ import annotations

import os
from functools import cache
from typing import Any, NamedTuple

from synth.live.errors import DeviceError

NAME = "jawari"


class Server(NamedTuple):
    """A running server: its rate [Hz], frames of a period, inputs of the sound card."""

    rate_hz: int
    frames: int
    playback: tuple[str, ...]


def server_of(name: str | None = None) -> Server:
    """What the server of this name (None: JACK_DEFAULT_SERVER of the environment, or "default") is like. None is started.

    Raises DeviceError where there is none, or the package or the library JACK is missing.
    """
    client = open_client(NAME, name)
    try:
        return Server(client.samplerate, client.blocksize, playback(client))
    finally:
        client.close()


def server_rate(name: str | None = None) -> int:
    """Rate [Hz] at which the server's clients must run; see `server_of`."""
    return server_of(name).rate_hz


def midi_sources(name: str | None = None) -> list[str]:
    """The server's MIDI ports that can be played from; see `server_of`."""
    client = open_client(NAME, name)
    try:
        return [port.name for port in client.get_ports(is_midi=True, is_output=True)]
    finally:
        client.close()


@cache
def library() -> Any:
    """The module jack. Raises DeviceError where it or the library is missing."""
    try:
        import jack
    except ImportError:
        raise DeviceError("JACK needs the package JACK-Client: pip install 'jawari[jack]'") from None
    except OSError:
        raise DeviceError(
            "JACK's library is missing: apt-get install libjack-jackd2-0 (or pipewire-jack), or brew install jack"
        ) from None
    # it would print on standard error
    jack.set_error_function(_hush)
    jack.set_info_function(_hush)
    return jack


def _hush(text: str) -> None:
    """What the library has to say, which is not for users."""


def open_client(name: str, server: str | None) -> Any:
    """A jack.Client, not active. Raises DeviceError."""
    jack = library()
    try:
        return jack.Client(name, no_start_server=True, servername=server)
    except jack.JackOpenError as error:
        shown = server or os.environ.get("JACK_DEFAULT_SERVER") or "default"
        status = error.status
        if status.server_failed or (status.failure and not status.invalid_option):
            raise DeviceError(
                f"no JACK server answers (name: {shown}): start one, like jackd -d alsa or QjackCtl, or with PipeWire begin "
                "the command with pw-jack; without --jack the default output is used"
            ) from None
        raise DeviceError(f"the JACK server {shown!r} refuses the client {name!r}: {status}") from None


def playback(client: Any) -> tuple[str, ...]:
    """Inputs of the sound card."""
    return tuple(port.name for port in client.get_ports(is_physical=True, is_input=True, is_audio=True))
