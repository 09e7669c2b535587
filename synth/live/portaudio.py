"""Sound through PortAudio (the library sounddevice), with a compiled callback."""

from __future__ import annotations

import atexit
from collections.abc import Callable
from typing import Any

from synth.engine.uncopied import Uncopied
from synth.live.callback import portaudio_callback
from synth.live.deck import Deck
from synth.live.errors import DeviceError
from synth.native.patience import CALL_S, answers
from synth.native.stderr import silenced

INSTALL = "pip install 'jawari[live]'"
#: rates that are offered where a device refuses one [Hz]
RATES_HZ = (44100, 48000, 88200, 96000)
#: of Windows, the one that is best for playing first; WDM-KS takes the device from all other programs
_WINDOWS_APIS = ("Windows WASAPI", "Windows DirectSound", "MME", "Windows WDM-KS")
#: letters of a device's name that MME has
_MME_NAME = 31
_ABANDONED: list[Any] = []


def devices() -> list[dict[str, Any]]:
    """Audio outputs: index, name, host_api, channels, default_rate_hz, latency_s (the lowest it claims), default."""
    sd = _library()
    with silenced():
        sd._terminate()
        sd._initialize()
    apis = sd.query_hostapis()
    default = sd.default.device[1]
    return [
        {
            "index": int(each["index"]),
            "name": each["name"],
            "host_api": apis[each["hostapi"]]["name"],
            "channels": int(each["max_output_channels"]),
            "default_rate_hz": float(each["default_samplerate"]),
            "latency_s": float(each["default_low_output_latency"]),
            "default": int(each["index"]) == default,
        }
        for each in sd.query_devices()
        if each["max_output_channels"] > 0
    ]


def find_device(wanted: str | int | None) -> dict[str, Any]:
    """The output meant by a number, a name or a part of one (with or without its host API); None: the default.

    Raises DeviceError where none or several are meant.
    """
    there = devices()
    if not there:
        raise DeviceError(
            "there is no audio output; plug one in or start an audio server, or render to a file: synth render"
        )
    listing = "; ".join(f"{each['index']} {each['name']} ({each['host_api']})" for each in there)
    if wanted is None:
        return next((each for each in there if each["default"]), there[0])
    text = str(wanted).strip()
    if text.isdecimal():
        found = [each for each in there if each["index"] == int(text)]
    else:
        full = {each["index"]: f"{each['name']} ({each['host_api']})".lower() for each in there}
        found = [each for each in there if text.lower() in (each["name"].lower(), full[each["index"]])]
        found = found or [each for each in there if text.lower() in full[each["index"]]]
    if not found:
        raise DeviceError(f"--device {text!r}: no such audio output; there are: {listing}")
    found = _by_best_api(found)
    if len(found) > 1:
        raise DeviceError(
            f"--device {text!r} fits several audio outputs: "
            + "; ".join(f"{each['index']} {each['name']} ({each['host_api']})" for each in found)
            + "; give a number"
        )
    return found[0]


def _by_best_api(found: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of a device that Windows offers several times, by WASAPI and by older interfaces, the one that answers soonest."""
    names = {each["name"][:_MME_NAME] for each in found}
    if len(names) > 1 or any(each["host_api"] not in _WINDOWS_APIS for each in found):
        return found
    best = min((_WINDOWS_APIS.index(each["host_api"]) for each in found), default=0)
    return [each for each in found if each["host_api"] == _WINDOWS_APIS[best]]


class PortAudioOutput(Uncopied):
    """An open output; `start` lets it sound. A deck's only reader."""

    def __init__(self, deck: Deck, stream: Any, name: str, host_api: str) -> None:
        self._deck, self._stream, self._host_api = deck, stream, host_api
        self._started = False
        self.name = name

    @property
    def latency_s(self) -> float:
        """From the end of a callback's block to the air, as the device reports it [s]."""
        return float(self._stream.latency) if self._stream is not None else 0.0

    @property
    def alive(self) -> bool:
        """Whether the device still runs, as far as PortAudio knows."""
        return self._stream is not None and bool(self._stream.active)

    def start(self) -> None:
        self._deck.start_ahead()
        try:
            with silenced():
                self._stream.start()
        except _library().PortAudioError as error:
            raise DeviceError(f"{self.name}: the audio output could not be started: {_reason(error)}") from None
        self._started = True

    def stop(self) -> None:
        """Stop at once; may be called again."""
        if self._started and self._stream is not None:
            self._started = False
            if self._stream.active:
                self._bounded(lambda stream: stream.abort(ignore_errors=True))
            elif "JACK" in self._host_api:
                self._abandon()  # its server has gone: to stop or close would wait for ever

    def close(self) -> None:
        """Stop and give the device back."""
        self.stop()
        if self._stream is not None:
            self._bounded(lambda stream: stream.close(ignore_errors=True))
            self._stream = None

    def _bounded(self, work: Callable[[Any], None]) -> None:
        """Do something with the stream, but do not wait for ever: devices that were pulled out may never answer."""
        stream = self._stream
        with silenced():
            returned = answers(lambda: work(stream), CALL_S)
        if not returned:
            self._abandon()

    def _abandon(self) -> None:
        """Leave a stream whose device has gone as it is, at the interpreter's exit too, where PortAudio would abort.

        The callback may still have its memory, so that stays where it is.
        """
        _ABANDONED.append((self._stream, self._deck))
        self._stream = None
        atexit.unregister(_library()._exit_handler)


def abandoned() -> bool:
    """Whether a stream had to be left as it was: PortAudio then cannot look for devices any more, it would wait for ever."""
    return bool(_ABANDONED)


def check_output(device: str | int | None, rate_hz: float) -> str:
    """The name of the output that is meant. Raises DeviceError where there is none or it refuses the rate."""
    sd = _library()
    found = find_device(device)
    name = f"{found['name']} ({found['host_api']})"
    channels = min(2, found["channels"])
    try:
        with silenced():
            sd.check_output_settings(device=found["index"], channels=channels, dtype="float32", samplerate=rate_hz)
    except sd.PortAudioError as error:
        raise DeviceError(_refusal(sd, found, name, channels, rate_hz, error)) from None
    return name


def open_output(
    deck: Deck, device: str | int | None, rate_hz: float, block: int, latency: str | float = "low"
) -> PortAudioOutput:
    """Open a device for a deck. `block` [frames] per callback, `latency` "low", "high" or seconds.

    Raises DeviceError where there is no such device or it refuses.
    """
    sd = _library()
    found = find_device(device)
    name = f"{found['name']} ({found['host_api']})"
    channels = min(2, found["channels"])
    callback = portaudio_callback()
    deck.set_channels(channels)
    try:
        with silenced():
            stream = sd._StreamBase(
                kind="output",
                samplerate=rate_hz,
                blocksize=block,
                device=found["index"],
                channels=channels,
                dtype="float32",
                latency=latency,
                callback=sd._ffi.cast("PaStreamCallback*", callback.address),
                clip_off=True,
                dither_off=True,
                userdata=sd._ffi.cast("void*", deck.address),
            )
    except sd.PortAudioError as error:
        raise DeviceError(_refusal(sd, found, name, channels, rate_hz, error)) from None
    return PortAudioOutput(deck, stream, name, found["host_api"])


def _refusal(sd: Any, found: dict[str, Any], name: str, channels: int, rate_hz: float, error: Exception) -> str:
    def takes(rate: float) -> bool:
        try:
            with silenced():
                sd.check_output_settings(device=found["index"], channels=channels, dtype="float32", samplerate=rate)
        except sd.PortAudioError:
            return False
        return True

    if not takes(rate_hz):
        rates = [str(rate) for rate in RATES_HZ if takes(rate)]
        if rates:
            return f"{name}: does not support {rate_hz:g} Hz; use --rate {', '.join(rates)}"
    return f"{name}: cannot be opened at {rate_hz:g} Hz: {_reason(error)}; see synth devices"


def _reason(error: Exception) -> str:
    return str(error).partition("\n")[0].removeprefix("Error opening _StreamBase: ")


def _library() -> Any:
    """The module sounddevice, initialised. Raises DeviceError where it or PortAudio is missing."""
    try:
        with silenced():
            import sounddevice
    except ImportError:
        raise DeviceError(f"live sound needs the package sounddevice: {INSTALL}") from None
    except OSError:
        raise DeviceError(
            "live sound needs the library PortAudio: apt-get install libportaudio2, or brew install portaudio"
        ) from None
    return sounddevice
