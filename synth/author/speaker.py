"""Sound through the audio output of the machine that the server runs on."""

from __future__ import annotations

import threading

from synth.author.errors import one_line
from synth.author.phrases import Phrase
from synth.engine.engine import Engine
from synth.engine.uncopied import Uncopied
from synth.live.deck import Deck, Meters
from synth.live.errors import DeviceError

#: frames of a callback; a phrase begins so much after the stream, when the device runs steadily [s]
DEVICE_BLOCK = 256
LEAD_S = 0.02
#: PortAudio is no place for two at a time
_LOCK = threading.Lock()


def why_not(rate_hz: float) -> tuple[str | None, str | None]:
    """(name of the output, None), or (None, why there is none)."""
    try:
        from synth.live import portaudio

        with _LOCK:
            if portaudio.abandoned():
                raise DeviceError("the audio output no longer answers; restart the program")
            return portaudio.check_output(None, rate_hz), None
    except (DeviceError, OSError, ImportError) as error:
        return None, one_line(error)


class Speaker(Uncopied):
    """One engine at the default output from silence on, until it is closed. Raises DeviceError."""

    def __init__(self, engine: Engine, rate_hz: int, phrase: Phrase | None = None) -> None:
        from synth.live import portaudio

        engine.reset()
        self.engine = engine
        self._deck = Deck(engine)
        self._end = 0
        if phrase is not None:
            events = phrase.events.copy()
            events["frame"] += round(LEAD_S * rate_hz)
            self._deck.schedule(events)
            self._end = int(events["frame"].max(initial=0)) + DEVICE_BLOCK
        with _LOCK:
            self._output = portaudio.open_output(self._deck, None, rate_hz, DEVICE_BLOCK, "low")
            try:
                self._output.start()
            except BaseException:
                self._output.close()
                raise

    def send(self, kind: int, channel: int, a: int, b: int = 0) -> None:
        """An event now."""
        self._deck.send(kind, channel, a, b)
        self._end = max(self._end, self._deck.frame + round(0.2 * self._deck.rate_hz))

    @property
    def alive(self) -> bool:
        return self._output.alive

    @property
    def ended(self) -> bool:
        """Nothing sounds, and nothing will unless an event comes."""
        return self._deck.frame >= self._end and self.engine.silent

    def meters(self) -> Meters:
        return self._deck.meters()

    def close(self) -> None:
        with _LOCK:
            self._output.close()
        self._deck.close()
