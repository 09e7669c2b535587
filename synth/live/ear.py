"""What a JACK server (or PipeWire in its place) gives its sound card, recorded with the server's own time: by this it can be
measured when something is heard, whoever plays it and by whatever way.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from synth.live.errors import DeviceError
from synth.live.jackclient import port_latency
from synth.live.jackserver import library, open_client, playback

#: what is kept [s]
_KEPT_S = 2.0
_MASK = 0xFFFFFFFF


class Ear:
    """A client of the server in use; `close` it. Raises DeviceError where there is no server or no card.

    rate_hz: of the server.  latency_s: from the server's output to the air, as the server says.
    """

    def __init__(self) -> None:
        self._client: Any = open_client("jawari-ear", None)
        try:
            self._card = playback(self._client)[:2]
            if not self._card:
                raise DeviceError("the JACK server has no sound card to measure")
            self.rate_hz = int(self._client.samplerate)
            self.latency_s = port_latency(self._client.get_port_by_name(self._card[0])) / self.rate_hz
            self._inputs = [self._client.inports.register(f"in_{number}") for number in range(len(self._card))]
            self._kept = np.zeros(round(_KEPT_S * self.rate_hz), np.float32)
            self._place = 0  # of the next period in it
            self._periods: list[tuple[int, int, int]] = []  # frame time, place, frames
            self._client.set_process_callback(self._hear)
            self._client.activate()
        except library().JackError as error:  # a signal that comes meanwhile makes the server's answer fail
            self._client.close()
            raise DeviceError(f"the JACK server refuses the client that measures: {error}") from None
        except BaseException:
            self._client.close()
            raise

    def _hear(self, frames: int) -> None:
        loudest = np.max([np.abs(np.frombuffer(port.get_buffer(), np.float32)) for port in self._inputs], axis=0)
        if self._place + frames > len(self._kept):
            self._place = 0
        self._kept[self._place : self._place + frames] = loudest
        self._periods.append((self._client.last_frame_time, self._place, frames))
        self._place += frames

    def connect(self) -> None:
        """Listen to all that goes to the card now."""
        errors = library().JackError
        for name, mine in zip(self._card, self._inputs, strict=True):
            there = {port.name for port in self._client.get_all_connections(mine)}
            for source in self._client.get_all_connections(name):
                if source.name not in there:
                    with suppress(errors):  # it has gone meanwhile
                        self._client.connect(source, mine)

    def now(self) -> int:
        """The server's frame time, of 32 bits."""
        return int(self._client.frame_time)

    def listen(self) -> None:
        """From here on."""
        self._periods.clear()

    def first(self, threshold: float, since: int) -> int | None:
        """Frames from the frame time `since` to the first sample of this magnitude that is heard after it, None: there was
        none since `listen`."""
        for time, place, frames in list(self._periods):
            heard = self._kept[place : place + frames]
            for offset in np.flatnonzero(heard >= threshold):
                after = (time + int(offset) - since) & _MASK
                if after <= _MASK // 2:
                    return after
        return None

    def close(self) -> None:
        self._client.deactivate()
        self._client.close()


def ear() -> Ear | None:
    """An Ear, where there is a server."""
    try:
        return Ear()
    except DeviceError:
        return None
