"""The player behind a connection: what the page asks for, as blocks of samples a little ahead of real time.

A change is heard at once because only the notes that are asked for are prepared anew; once keys are played, the whole
compass follows in the background and takes the keys from then on. Strings that sound go on as they are when the preset
changes: each such state of it is a voice of its own until it has faded.
"""

from __future__ import annotations

import itertools
import logging
import queue
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

import numpy as np

from synth.author.document import Document, version_fingerprint
from synth.author.errors import one_line
from synth.author.phrases import Phrase, phrase
from synth.author.speaker import Speaker
from synth.author.voice import BLOCK, Voice, phrase_preset, prepared_engine
from synth.engine.engine import Engine
from synth.instrument.neck import single_strings
from synth.instrument.preset import Preset, playable_notes
from synth.instrument.ways import switch_keys
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON
from synth.units import midi_to_note

LOG = logging.getLogger(__name__)
#: how far ahead of real time, how much may wait to be sent, and how much may have been sent unheard, by a page that says
#: how far it is and is held up; how long to wait then [s]
AHEAD_S, BACKLOG_S, UNHEARD_S, PATIENCE_S = 0.08, 1.0, 5.0, 0.02
#: how far ahead a phrase may be, which nobody plays into: the machine may be busy with pictures meanwhile [s]
PHRASE_AHEAD_S = 0.25
#: most states of the preset that sound at once; the oldest beyond them fades within a block
MOST_VOICES = 4
#: engines that are kept for when they are asked for again
KEPT = 6
#: how often the load is told [s]
LOAD_S = 0.5
HEADER = np.dtype([("stream", "<u4"), ("frame", "<u4")])
SUSTAIN = 64
OUTPUTS = ("browser", "server")
#: how often the server's own output is looked after [s]
LOOK_S = 0.05

#: numbers of streams, of all players together: a page that changes from one to another does not confuse them
_STREAMS = itertools.count(1)
Emit = Callable[[dict[str, Any] | bytes], object]
#: of an engine: the version's fingerprint, and the notes that it is prepared for (None: all)
Key = tuple[str, frozenset[int] | None]


class PagePlayer:
    """Sounds a document.

    emit     is given messages (dict) and blocks (bytes), from the player's own thread
    backlog  says how many blocks wait to be sent
    begins   is called when it begins to sound: others are to stop
    """

    def __init__(
        self,
        document: Document,
        emit: Emit,
        *,
        rate_hz: int,
        quality: str,
        backlog: Callable[[], int] = lambda: 0,
        begins: Callable[[], None] = lambda: None,
    ) -> None:
        self._document = document
        self._emit = emit
        self._backlog = backlog
        self._begins = begins
        self._rate_hz = rate_hz
        self._quality = quality
        self._commands: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._engines: OrderedDict[Key, Engine] = OrderedDict()
        #: newest first; the first takes keys if `live` is the key of its engine
        self._voices: list[Voice] = []
        self._fading: list[Voice] = []
        self._live: Key | None = None
        self._output = "browser"
        self._speaker: Speaker | None = None
        self._controls: dict[int, int] = {}
        self._bend = 0
        self._switch: int | None = None
        self._whole: threading.Thread | None = None
        self._stream = self._frame = self._told_at = 0
        self._heard: int | None = None
        self._running = False
        self._began = self._busy_s = 0.0
        self._thread = threading.Thread(target=self._run, name="author-player", daemon=True)
        self._thread.start()

    # --- from any thread ---

    def ask(self, message: dict[str, Any]) -> None:
        """What a page asks for; everything that follows is told by `emit`. Raises ValueError for what cannot be."""
        kind = message.get("type")
        if kind == "note_on":
            key, velocity = number(message, "key", 0, 127), number(message, "velocity", 0, 127)
            preset, text = self._version(message)
            self._do(lambda: self._note_on(preset, text, key, velocity) if velocity else self._note_off(key))
        elif kind == "note_off":
            key = number(message, "key", 0, 127)
            self._do(lambda: self._note_off(key))
        elif kind == "pedal":
            value = 127 if message.get("down") else 0
            self._do(lambda: self._control(SUSTAIN, value))
        elif kind == "control":
            controller, value = number(message, "controller", 0, 127), number(message, "value", 0, 127)
            self._do(lambda: self._control(controller, value))
        elif kind == "bend":
            bend = number(message, "value", -8192, 8191)
            self._do(lambda: self._set_bend(bend))
        elif kind == "audition":
            preset, text = self._version(message)
            if "string" in message:
                preset, text = _on_string(preset, text, message)
            note, velocity = number(message, "note", 0, 127), number(message, "velocity", 1, 127)
            wanted = phrase(str(message.get("phrase", "note")), preset, note, velocity, self._rate_hz)
            self._do(lambda: self._audition(preset, text, wanted))
        elif kind == "stop":
            self.stop()
        elif kind == "output":
            output = message.get("id")
            if output not in OUTPUTS:
                raise ValueError(f"id: must be {' or '.join(OUTPUTS)}, got {output!r}")
            self._do(lambda: self._choose(output))
        elif kind == "heard":
            self._heard = number(message, "frame", 0, 1 << 32)
        else:
            raise ValueError(f"type: there is no message {kind!r}")

    def _version(self, message: dict[str, Any]) -> tuple[Preset, str]:
        """The preset and its text that a message speaks of. Raises ValueError."""
        version = self._document.version(message.get("which", "current"))
        return version.preset, version.text

    def stop(self) -> None:
        """Silence."""
        self._do(self._stop)

    @property
    def uses_device(self) -> bool:
        """Whether it sounds through this machine's output."""
        return self._speaker is not None

    def close(self) -> None:
        """End the thread, and with it the sound."""
        self._commands.put(None)
        self._thread.join(5.0)

    def _do(self, command: Callable[[], None]) -> None:
        self._commands.put(command)

    # --- in the player's thread ---

    def _run(self) -> None:
        going = True
        while going:
            try:
                going = self._turn()
            except Exception as error:  # the next key is to find it at work again
                LOG.exception("the player has failed")
                self._emit({"type": "error", "message": f"the sound has failed ({type(error).__name__}); play again"})
                self._give_up()

    def _turn(self) -> bool:
        """One command, block or look at the output; False: it was the last."""
        try:
            command = self._commands.get(timeout=self._pause())
        except queue.Empty:
            if self._speaker is not None:
                self._look()
            elif self._held_up():  # the time that passes does not count
                self._began = time.monotonic() - self._frame / self._rate_hz + self._ahead_s()
            elif self._running:
                self._sound()
            return True
        if command is None:
            self._stop()
            return False
        try:
            command()
        except (ValueError, OSError) as error:
            self._emit({"type": "error", "message": one_line(error)})
        return True

    def _give_up(self) -> None:
        """Silence without the engines that there were."""
        self._engines.clear()
        try:
            self._stop()
        except Exception:
            LOG.exception("the output cannot be closed")
            self._speaker = None

    def _pause(self) -> float | None:
        """How long there is nothing to do but to listen [s]; None: for ever."""
        if self._speaker is not None:
            return LOOK_S
        if not self._running:
            return None
        if self._held_up():
            return PATIENCE_S
        return max(0.0, self._began + self._frame / self._rate_hz - self._ahead_s() - time.monotonic())

    def _ahead_s(self) -> float:
        return PHRASE_AHEAD_S if self._live is None else AHEAD_S

    def _held_up(self) -> bool:
        """Whether the connection or the page does not keep up."""
        waiting = self._backlog() * BLOCK
        unheard = self._frame - self._heard if self._heard is not None else 0
        return self._running and (waiting > BACKLOG_S * self._rate_hz or unheard > UNHEARD_S * self._rate_hz)

    def _engine(self, preset: Preset, key: Key) -> Engine:
        """An engine that no voice sounds with."""
        engine = self._engines.get(key)
        if engine is None or any(voice.engine is engine for voice in (*self._voices, *self._fading)):  # it sounds
            engine = prepared_engine(preset, key[1], self._rate_hz, self._quality)
        self._keep(key, engine)
        return engine

    def _keep(self, key: Key, engine: Engine) -> None:
        self._engines[key] = engine
        self._engines.move_to_end(key)
        while len(self._engines) > KEPT:
            self._engines.popitem(last=False)

    def _choose(self, output: str) -> None:
        """Sound here or there from now on."""
        if output != self._output:
            self._stop()
            self._output = output

    def _audition(self, preset: Preset, text: str, wanted: Phrase) -> None:
        self._begins()
        self._silence()  # first, so that the engine can be taken again
        # its strings may be fewer than those that keys need: it has a name of its own
        engine = self._engine(phrase_preset(preset, wanted), (f"{version_fingerprint(text, preset)} phrase", wanted.notes))
        if self._output == "server":
            self._speaker = Speaker(engine, self._rate_hz, wanted)
            return
        self._voices.append(Voice(engine, wanted))
        self._start()

    def _note_on(self, preset: Preset, text: str, key: int, velocity: int) -> None:
        if key in switch_keys(preset):
            self._switch = key
            for voice in self._voices:
                self._send_switch(voice)
            if self._speaker is not None:
                self._send_switch(self._speaker)
            return
        if key not in playable_notes(preset):
            return
        self._begins()
        if self._output == "server":
            self._speaker_for(key, preset, version_fingerprint(text, preset)).send(NOTE_ON, 0, key, velocity)
            return
        voice = self._voice_for(key, preset, version_fingerprint(text, preset))
        voice.send(NOTE_ON, 0, key, velocity)
        if not self._running:
            self._start()

    def _voice_for(self, key: int, preset: Preset, name: str) -> Voice:
        """The voice that takes a key: of the whole compass if that is ready, else of this key alone."""
        chosen = self._key_for(key, name)
        if self._live == chosen and self._voices:
            return self._voices[0]
        voice = next((each for each in self._voices if each.engine is self._engines.get(chosen)), None)
        if voice is not None:  # of a state of the preset that has come back
            self._voices.remove(voice)
        else:
            voice = Voice(self._engine(preset, chosen))
            self._set_up(voice)
        self._live = chosen
        self._voices.insert(0, voice)
        self._fading += self._voices[MOST_VOICES:]
        del self._voices[MOST_VOICES:]
        if chosen[1] is not None:
            self._begin_whole(preset, name)
        return voice

    def _speaker_for(self, key: int, preset: Preset, name: str) -> Speaker:
        """The same of the server's output, which has one engine at a time: it changes where nothing else sounds."""
        chosen = self._key_for(key, name)
        if self._speaker is not None and not self._speaker.ended and self._live is not None and self._live[0] == name:
            if self._live[1] is None or key in self._live[1]:
                return self._speaker
            chosen = (name, None)
        self._silence()
        self._speaker = Speaker(self._engine(preset, chosen), self._rate_hz)
        self._set_up(self._speaker)
        self._live = chosen
        if chosen[1] is not None:
            self._begin_whole(preset, name)
        return self._speaker

    def _key_for(self, key: int, name: str) -> Key:
        """The engine that a key is played with: that of the whole compass if it is ready, else of this key alone."""
        whole: Key = (name, None)
        return whole if whole in self._engines else (name, frozenset({key}))

    def _set_up(self, voice: Voice | Speaker) -> None:
        """Give a new voice the articulation and the controllers as they are."""
        self._send_switch(voice)
        for controller, value in self._controls.items():
            voice.send(CONTROL, 0, controller, value)
        if self._bend:
            voice.send(BEND, 0, self._bend)

    def _send_switch(self, voice: Voice | Speaker) -> None:
        """Let a voice play the articulation that is chosen, if its preset has it."""
        if self._switch is not None and self._switch in switch_keys(voice.engine.parts[0]):
            voice.send(NOTE_ON, 0, self._switch, 64)

    def _begin_whole(self, preset: Preset, name: str) -> None:
        if self._whole is None:
            self._whole = threading.Thread(target=self._prepare_whole, args=(preset, (name, None)), daemon=True)
            self._whole.start()

    def _prepare_whole(self, preset: Preset, key: Key) -> None:
        """In a thread of its own: the whole compass."""
        try:
            engine = prepared_engine(preset, None, self._rate_hz, self._quality)
        except Exception as error:  # its keys go on one by one
            LOG.warning("%s cannot be prepared as a whole: %s", preset.name, error)
            self._do(self._whole_done)
            return
        self._do(lambda: self._whole_done((key, engine)))

    def _whole_done(self, made: tuple[Key, Engine] | None = None) -> None:
        self._whole = None
        if made is not None:
            self._keep(*made)

    def _note_off(self, key: int) -> None:
        self._send(NOTE_OFF, key, 64)

    def _control(self, controller: int, value: int) -> None:
        self._controls[controller] = value
        self._send(CONTROL, controller, value)

    def _set_bend(self, bend: int) -> None:
        self._bend = bend
        self._send(BEND, bend)

    def _send(self, kind: int, a: int, b: int = 0) -> None:
        """To all that sounds."""
        for voice in self._voices:
            voice.send(kind, 0, a, b)
        if self._speaker is not None:
            self._speaker.send(kind, 0, a, b)

    def _start(self) -> None:
        """A new stream, whose first frame is the next."""
        self._stream = next(_STREAMS)
        self._frame = self._told_at = 0
        self._heard = None
        self._busy_s = 0.0
        self._running = True
        self._began = time.monotonic()
        self._emit({"type": "audio", "rate_hz": self._rate_hz, "stream": self._stream, "frame": 0})

    def _stop(self) -> None:
        speaking = self._speaker is not None
        self._silence()
        if self._running:
            self._end()
        elif speaking:
            self._emit({"type": "stopped"})

    def _silence(self) -> None:
        self._live = None
        self._voices.clear()
        self._fading.clear()
        if self._speaker is not None:
            self._speaker.close()
            self._speaker = None

    def _look(self) -> None:
        """After the server's own output."""
        assert self._speaker is not None
        if not self._speaker.alive:
            self._emit({"type": "error", "message": "the audio output has gone; choose the browser, or try again"})
            self._stop()
        elif self._speaker.ended:
            self._stop()
        elif time.monotonic() - self._began >= LOAD_S:
            self._began = time.monotonic()
            self._emit({"type": "load", "cpu": self._speaker.meters().load.cpu_median})

    def _end(self) -> None:
        self._running = False
        self._emit({"type": "stopped", "stream": self._stream, "frame": self._frame})

    def _sound(self) -> None:
        """The next block."""
        began = time.perf_counter()
        mix = np.zeros((BLOCK, 2))
        for voice in self._voices:
            mix += voice.next()
        for voice in self._fading:
            mix += voice.next() * np.linspace(1.0, 0.0, BLOCK)[:, None]
        self._fading = [voice for voice in self._voices if voice.overdue and not voice.ended]
        if self._voices and (self._voices[0].ended or self._voices[0].overdue):
            self._live = None
        self._voices = [voice for voice in self._voices if not (voice.ended or voice.overdue)]
        self._emit(np.array([(self._stream, self._frame)], HEADER).tobytes() + mix.astype("<f4").tobytes())
        self._frame += BLOCK
        self._busy_s += time.perf_counter() - began
        # who has fallen behind does not hurry
        self._began += max(0.0, time.monotonic() - (self._began + self._frame / self._rate_hz))
        frames = self._frame - self._told_at
        if frames >= LOAD_S * self._rate_hz:
            self._emit({"type": "load", "cpu": self._busy_s * self._rate_hz / frames})
            self._told_at, self._busy_s = self._frame, 0.0
        if not self._voices and not self._fading:
            self._end()


def _on_string(preset: Preset, text: str, message: dict[str, Any]) -> tuple[Preset, str]:
    """The preset with the one string that a message names by its table's number and its open note, and a text that tells it
    from the others. Raises ValueError where no key plays such a string."""
    index, opened = number(message, "string", 0, len(preset.string) - 1), number(message, "opened", 0, 127)
    for each, note, single in single_strings(preset, {opened}):
        if (each, note) == (index, opened):
            return single, f"{text}\n# string {index}, {opened}"
    raise ValueError(f"opened: no key plays string {index} at {midi_to_note(opened)}")


def number(message: dict[str, Any], name: str, low: int, high: int) -> int:
    """A whole number of a message. Raises ValueError."""
    value = message.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high or value != int(value):
        raise ValueError(f"{name}: must be a whole number from {low} to {high}, got {repr(value)[:40]}")
    return int(value)
