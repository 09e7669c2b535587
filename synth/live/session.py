"""A live session: presets, engine, deck, audio output, MIDI inputs, keyboard and recording, put together and taken apart.

    with Session(settings, line) as session:
        session.run(stop)
    report = session.report

Whatever happens in between, what was recorded is a valid file afterwards, and the terminal is as it was.
"""

from __future__ import annotations

import gc
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from synth.engine.engine import Engine
from synth.engine.layout import GAIN
from synth.engine.uncopied import Uncopied
from synth.files.targets import check_target
from synth.host import compass, parts
from synth.host.bindings import check_parts
from synth.host.performance import of_strings
from synth.host.playing_settings import PlayingSettings
from synth.instrument.ways import keys_that_switch
from synth.live.deck import Deck, Meters
from synth.live.errors import DeviceError
from synth.live.player import Player
from synth.live.playkeys import PlayKeys, keys_of
from synth.live.report import LiveReport
from synth.live.songplayer import SongPlayer, power_up_of
from synth.live.status import Status, StatusLine, clock_text
from synth.live.terminal import KeySource, terminal_at
from synth.live.unplayable import Unplayable
from synth.midi import song as songs
from synth.midi.controllers import ALL_NOTES_OFF, ALL_SOUND_OFF, EXPRESSION, SUSTAIN
from synth.midi.events import CONTROL, PARAMETER
from synth.native.interpreted import require_compiled
from synth.native.patience import LEAVE_S, answers
from synth.native.stderr import give_back, only_ours
from synth.units import db_to_gain

if TYPE_CHECKING:
    from synth.live.latency import Latency
    from synth.live.recorder import Recorder

#: how often the session looks after everything [s]
LOOK_S = 0.05
PORTS_EVERY_S = 0.5
#: a session that is stopped lets go of all notes and fades for so long [s]
FADE_S = 1.0
FADE_STEPS = 50
#: a device that has asked for nothing for so long is gone; so long it is tried again [s]
DEAD_AFTER_S = 2.0
RETRY_S = 5.0
#: what is played from a file ends when the output has stayed this quiet for so long, or after so long [s]
QUIET_DBFS = -80.0
QUIET_FOR_S = 0.5
LONGEST_TAIL_S = 60.0
#: loads that are told apart, in thousandths of a block; the last stands for all above
LOAD_BINS = 4001


@dataclass(frozen=True, kw_only=True)
class SessionSettings(PlayingSettings):
    """What to play on and how.

    song: MIDI file to play; where others play beside it, programs choose from the whole table (`gm`), too.
    device: name or number of an output; None: the default.  jack: name of the client if JACK itself is the output.
    rate_hz: None: the JACK server's, else 44100.
    latency: 'low', 'high' or seconds.  ahead: blocks that a thread keeps ready.
    midi_in: ports by name or number; () all there are; ('none',) none.  midi_channel: 0…15, the only one to listen to.
    keys: whether the computer's keyboard plays.  song_keys: whether a terminal's keys pause the song and go through it.
    record: .wav file; a .mid file is written beside it.
    measure_latency: the session is there for `measure_latency`: it plays by itself.
    """

    song: str | None = None
    device: str | int | None = None
    jack: str | None = None
    rate_hz: int | None = None
    block: int = 256
    latency: str | float = "low"
    ahead: int = 0
    adaptive: bool = False
    midi_in: tuple[str, ...] = ()
    midi_channel: int | None = None
    virtual_port: bool = True
    keys: bool = False
    song_keys: bool = False
    record: str | None = None
    duration_s: float | None = None
    measure_latency: bool = False


class Stop:
    """How a session is asked to end: once, and it fades; twice, and it ends at once."""

    def __init__(self) -> None:
        self._asked = threading.Event()
        self._at_once = threading.Event()

    def ask(self, *_: object) -> None:
        """Asks to end; a signal's handler may call it."""
        (self._at_once if self._asked.is_set() else self._asked).set()

    def ask_once(self, *_: object) -> None:
        """Asks to end, however often it is called: a terminal that is closed says so in several ways."""
        self._asked.set()

    @property
    def asked(self) -> bool:
        return self._asked.is_set()

    @property
    def at_once(self) -> bool:
        return self._at_once.is_set()

    def wait(self, seconds: float) -> bool:
        """Waits, but no longer than until it is asked to end; whether it is."""
        return self._asked.wait(seconds)

    def wait_at_once(self, seconds: float) -> bool:
        """Waits, but no longer than until it is asked to end at once; whether it is."""
        return self._at_once.wait(seconds)


class Session(Uncopied):
    """See the module's docstring. Entered, everything is prepared and open but not yet sounding.

    opened: called when it is, before `with` goes on: from then on nothing should be raised from outside, so that the session
    ends in order.
    Raises ValueError (DeviceError, MidiPortError, PresetError, …) for what cannot be used, OSError for files.
    """

    def __init__(self, settings: SessionSettings, line: StatusLine, opened: Callable[[], None] = lambda: None) -> None:
        self._settings = settings
        self._line = line
        self._opened = opened
        self._stack = ExitStack()
        self._players: list[Player] = []
        self._song: SongPlayer | None = None
        self._terminal: KeySource | None = None
        self._keys: PlayKeys | None = None
        self._inputs: Any = None
        self._loads = np.zeros(LOAD_BINS, np.int64)
        self._sparing = False
        self._worst = 0.0
        self._recent: deque[float] = deque(maxlen=10)
        self._loud_at = 0
        self._prepare_s = 0.0
        self._ended = "stopped"
        self._left_behind = False
        self._outputs: list[Any] = []  # that are or were open
        self._output_lock = threading.Lock()
        self._recorder: Recorder | None = None
        self._unplayed = 0
        self._gm = settings.gm
        self._switching = True
        self.files: list[str] = []
        self.report: LiveReport | None = None

    def __enter__(self) -> Self:
        with self._stack as stack:
            self._open(stack)
            self._opened()
            self._stack = stack.pop_all()
        return self

    def _open(self, stack: ExitStack) -> None:
        require_compiled("a live session")
        settings = self._settings
        if settings.record is not None:
            self.files = [settings.record, str(Path(settings.record).with_suffix(".mid"))]
            for path in self.files:
                check_target(path)
        # All that can be wrong with files and names comes before any device is touched, and that before the preparations.
        self.rate_hz = self._choose_rate()
        casting, song, headroom_db = self._cast()
        self._labels = [part.preset for part in casting.parts] if song is None else [part.label for part in casting.parts]
        names = [part.preset for part in casting.parts]
        presets = settings.presets(names)
        arrangement = None
        if song is not None:
            played = song.events[parts.played_events(song.events, song.players, casting)]
            wishes = compass.Wishes(fold_programs=not song.take)
            arrangement = compass.arrange(song, played, casting, presets, wishes, settings.mpe)
        check_parts(settings.bindings, [presets[part.preset] for part in casting.parts])
        note_hz, silent = settings.frequencies()
        only_notes = None if silent is None else {int(key) for key in np.flatnonzero(~silent)}
        self._check_inputs()
        self._line.say(f"output: {self._check_output()}")
        self._line.say(f"preparing {', '.join(dict.fromkeys(part.preset for part in casting.parts))} …")
        began = time.perf_counter()
        engine = Engine(
            [part.played(presets[part.preset]) for part in casting.parts],
            casting.program_map,
            settings=settings.of_engine(gain_db=settings.gain_db - headroom_db),
            note_hz=note_hz,
            only_notes=self._notes(casting, arrangement, only_notes),
            bindings=settings.bindings,
            warn=self._line.say,
        )
        stack.callback(self._close_engine)
        self.engine = engine
        engine.prepare(self.rate_hz, 4096)
        self.deck = Deck(
            engine,
            record=settings.record is not None or settings.measure_latency,
            ahead=settings.ahead,
            ahead_block=settings.block,
            adaptive=settings.adaptive,
        )
        stack.callback(self.deck.close)
        self._prepare_s = time.perf_counter() - began
        self._line.say(f"prepared in {self._prepare_s:.1f} s")
        stack.enter_context(only_ours(self._outlived))
        self._output = self._open_output()
        stack.callback(self._close_output)
        self._outputs.append(self._output)
        if settings.record is not None:
            from synth.live.recorder import Recorder

            self._recorder = Recorder(
                self.deck,
                wav=self.files[0],
                mid=self.files[1],
                rate_hz=self.rate_hz,
                bit_depth=settings.bit_depth,
                say=self._line.say,
                gm=self._gm,
                headroom_db=headroom_db,
                switching=self._switching,
            )
            stack.enter_context(self._recorder)
        self._unplayable = Unplayable(engine.parts, frozenset(range(128)) - (only_notes or frozenset(range(128))))
        self._switches = keys_that_switch(engine.parts)
        if song is not None:
            assert arrangement is not None
            length = round(song.length_s * self.rate_hz)
            power_up = power_up_of(engine, settings.bindings)
            self._song = SongPlayer(arrangement.events, length, engine.latency_samples, self.rate_hz, power_up)
            self.add_player(self._song)
        self._open_inputs(stack)

    def add_player(self, player: Player) -> None:
        """Music to be played from the beginning of the stream; before `run`."""
        self._players.append(player)

    def _choose_rate(self) -> int:
        """The rate that is asked for [Hz], where JACK is the output its server's. Raises DeviceError."""
        settings = self._settings
        if settings.jack is None:
            return settings.rate_hz or 44100
        from synth.live import jackserver

        server = jackserver.server_of()
        server_hz, self._server_frames = server.rate_hz, server.frames
        if settings.rate_hz not in (None, server_hz):
            raise DeviceError(f"the JACK server runs at {server_hz} Hz, got --rate {settings.rate_hz}: leave --rate out")
        return server_hz

    def _check_output(self) -> str:
        """The output's name: what can be known of it before a minute is spent on preparations."""
        settings = self._settings
        if settings.jack is not None:
            return f"JACK client {settings.jack}, {self.rate_hz} Hz, periods of {self._server_frames}"
        from synth.live import portaudio

        return f"{portaudio.check_output(settings.device, self.rate_hz)}, {self.rate_hz} Hz, blocks of {settings.block}"

    def _check_inputs(self) -> None:
        """Raises MidiPortError where a port that is asked for is not there."""
        if not self._listens or not self._settings.midi_in:
            return
        from synth.midi.ports import MidiPortError, check_ports

        try:
            if self._by_jack:
                self._jack_midi()
            else:
                check_ports(self._settings.midi_in)
        except MidiPortError as error:
            raise MidiPortError(f"--midi-in: {error}") from None

    def _cast(self) -> tuple[parts.Casting, songs.Song | None, float]:
        """Who plays what; the song; by how much it is lowered [dB], whoever plays beside it."""
        settings = self._settings
        if settings.song is None:
            choice = settings.choosing(gm=settings.gm, switching=True)
            return parts.cast_live(choice, only_channel=settings.midi_channel), None, 0.0
        song = songs.read_song(settings.song, self.rate_hz, settings.mpe)
        for warning in song.warnings:
            self._line.say(f"{settings.song}: {warning}")
        self._gm, self._switching = settings.gm or song.gm, song.switching
        choice = settings.choosing(gm=self._gm, switching=self._switching)
        casting = parts.cast(song.channels, choice)
        headroom_db = parts.headroom_db(song, casting)
        for channel, count in casting.left_out.items():
            if channel not in settings.channel_presets:
                notes = f"{count} note{'' if count == 1 else 's'}"
                self._line.say(
                    f"channel {channel + 1} (percussion) is left out: {notes}; --map {channel + 1}=PRESET plays it"
                )
        if self._listens:
            casting = parts.cast_live(choice, song=casting)
        if not casting.parts:
            notes = f"{song.notes} note{'' if song.notes == 1 else 's'}"
            raise ValueError(f"{settings.song}: nothing to play ({notes}, no channel with a preset); choose one with --map")
        return casting, song, headroom_db

    @property
    def _listens(self) -> bool:
        """Whether others can play: not while a song is played, unless asked for."""
        settings = self._settings
        return settings.song is None or settings.keys or bool(settings.midi_in and settings.midi_in != ("none",))

    def _notes(
        self, casting: parts.Casting, arrangement: compass.Arrangement | None, sounding: set[int] | None
    ) -> Sequence[set[int] | None] | None:
        """The MIDI notes that every part is prepared for; None: all."""
        if arrangement is None or self._listens:
            return None if sounding is None else [sounding for _ in casting.parts]
        wanted = compass.keys_of_parts(arrangement, np.iinfo(np.int64).max)
        return wanted if sounding is None else [keys & sounding for keys in wanted]

    def _open_output(self) -> Any:
        settings = self._settings
        if settings.jack is not None:
            from synth.live import jackclient

            return jackclient.open_output(self.deck, settings.jack, midi=self._jack_midi())
        from synth.live import portaudio

        return portaudio.open_output(self.deck, settings.device, self.rate_hz, settings.block, settings.latency)

    @property
    def _by_jack(self) -> bool:
        """Whether the JACK client's own port brings the MIDI: where that of the system is JACK's, or there is none that
        python-rtmidi sees, as with PipeWire."""
        from synth.midi.ports import midi_system

        return self._settings.jack is not None and midi_system()[0] in ("JACK", "")

    def _jack_midi(self) -> list[str]:
        """JACK's MIDI ports to be connected to the client's own, where those are the MIDI system. Raises MidiPortError."""
        from synth.live import jackserver
        from synth.midi.ports import find_port, means_none

        settings = self._settings
        if not self._listens or settings.measure_latency or means_none(settings.midi_in) or not self._by_jack:
            return []
        there = jackserver.midi_sources()
        if settings.midi_in:
            return [there[find_port(name, there)] for name in settings.midi_in]
        return [name for name in there if "Midi Through" not in name]

    def _close_output(self) -> None:
        if not self._left_behind:
            self._left_behind = not answers(self._output.close, LEAVE_S)

    def _outlived(self) -> bool:
        """Whether a library still has threads at work for an output that could not be closed."""
        if self._left_behind or self._settings.jack is not None:
            return self._left_behind
        from synth.live import portaudio

        return portaudio.abandoned()

    def _close_engine(self) -> None:
        # A device that does not answer may still ask for sound.
        if not self._left_behind:
            self.engine.close()

    def _open_inputs(self, stack: ExitStack) -> None:
        settings = self._settings
        if not self._listens:
            return
        from synth.midi.ports import MidiInputs

        names = list(settings.midi_in)
        virtual = settings.virtual_port and settings.jack is None
        if self._by_jack:
            return  # the JACK client has a MIDI port, which plays at the frame
        self._inputs = MidiInputs(
            names,
            self.deck.send,
            self._line.say,
            "jawari" if virtual else None,
            channel=None if settings.midi_channel is None else settings.midi_channel + 1,
        )
        stack.callback(self._inputs.close)
        self._inputs.open()

    def run(self, stop: Stop) -> None:
        """Plays until it is asked to stop, the time is over, the music known beforehand has ended or the device is gone."""
        # What exists now stays: no collection need look at it again while sound is made.
        gc.collect()
        gc.freeze()
        with ExitStack() as stack:
            # Whatever happens: silence before anything else, so that the recording ends with what was heard.
            stack.callback(self._finish)
            for player in self._players:
                player.feed(self.deck)
            self._output.start()
            self._open_keyboard(stack, stop)
            self._ended = self._play(stop)
            if self._ended != "device" and not stop.at_once:
                self._fade(stop)

    def _finish(self) -> None:
        gc.unfreeze()
        answers(self._output.stop, LEAVE_S)
        self._line.clear()
        self.report = self._make_report()

    def _open_keyboard(self, stack: ExitStack, stop: Stop) -> None:
        instrument, song = self._settings.keys, self._song if self._settings.song_keys else None
        if not instrument and song is None:
            return
        keys = PlayKeys(keys_of(instrument=instrument, song=song is not None), song, self._line.say, stop.ask_once)
        if instrument:
            from synth.live.keyboard import Keyboard

            channel = int(np.flatnonzero((self.engine.program_map >= 0).any(axis=1))[0])
            self._line.say(keys.help)
            stack.enter_context(Keyboard(self.deck.send, self.deck.panic, keys.press, channel=channel))
            return
        self._keys, self._terminal = keys, stack.enter_context(terminal_at())
        if self._terminal.is_one:
            self._line.say(keys.help)

    def measure_latency(self, stop: Stop) -> Latency | None:
        """Instead of `run`: how long it takes from an event to its sound; None: it was asked to end meanwhile. Raises
        ValueError where nothing is heard."""
        from synth.live import latency
        from synth.live.ear import ear as ear_of_server

        jack = self._settings.jack is not None
        system = "JACK" if jack else self._inputs.system if self._inputs is not None else ""
        gc.collect()
        gc.freeze()
        loop = None
        ear = ear_of_server()
        try:
            self._output.start()
            stop.wait(0.5)  # the clock settles
            if system:
                loop = latency.loopback(f"{self._output.name}:midi_in" if jack else "jawari", system)
            send = loop.send_message if loop is not None else None
            path = f"{system} MIDI port" if loop is not None else "the program itself (no MIDI system for a loopback)"
            return latency.measure(self.deck, self.engine, self._output, stop, send, path, ear)
        finally:
            gc.unfreeze()
            if loop is not None:
                loop.delete()
            if ear is not None:
                answers(ear.close, LEAVE_S)
            answers(self._output.stop, LEAVE_S)

    def _play(self, stop: Stop) -> str:
        settings = self._settings
        last_frame, moved_at, ports_at = -1, time.monotonic(), 0.0
        while not stop.wait(LOOK_S):
            now, frame = time.monotonic(), self.deck.frame
            if self._terminal is not None and self._keys is not None:
                for key in self._terminal.keys():
                    self._keys.press(key)
            for player in self._players:
                player.feed(self.deck)
            self._look()
            if self._inputs is not None and now - ports_at >= PORTS_EVERY_S:
                self._inputs.poll()
                ports_at = now
            if settings.duration_s is not None and frame >= settings.duration_s * self.rate_hz:
                return "duration"
            if not self._listens and self._music_is_over(frame):
                return "song"
            if frame != last_frame:
                last_frame, moved_at = frame, now
            if not self._output.alive or now - moved_at > DEAD_AFTER_S:
                if not self._revive(stop):
                    return "stopped" if stop.asked else "device"
                last_frame, moved_at = -1, time.monotonic()
        return "stopped"

    def _music_is_over(self, frame: int) -> bool:
        if not all(player.over(self.deck) for player in self._players):
            return False
        end = max((player.end or 0 for player in self._players), default=0)
        quiet = frame - max(self._loud_at, end) >= QUIET_FOR_S * self.rate_hz
        return quiet or frame - end >= LONGEST_TAIL_S * self.rate_hz

    def _look(self) -> Meters:
        """Reads the meters and shows them."""
        meters = self.deck.meters()
        self._loads[min(int(meters.load.median * 1000.0), LOAD_BINS - 1)] += 1
        self._say_sparing(meters.spare_db > -math.inf)
        self._recent.append(meters.load.worst)
        self._worst = max(self._worst, meters.load.worst)
        if meters.peak >= db_to_gain(QUIET_DBFS):
            self._loud_at = meters.frames
        recorded_s = meters.frames / self.rate_hz if self._settings.record is not None else None
        unplayed = self.engine.notes_unplayed
        changed = self.engine.report().unplayed if unplayed != self._unplayed else None
        self._unplayed = unplayed
        self._line.show(
            Status(
                load_median=meters.load.median,
                load_worst=max(self._recent),
                xruns=self._xruns(meters),
                strings=meters.strings,
                peak=meters.peak,
                note=meters.last.note if meters.last.velocity else -1,
                velocity=meters.last.velocity,
                recorded_s=recorded_s,
                spare_db=meters.spare_db,
                events_lost=self._events_lost(meters),
                unplayed=self._unplayable.look(changed, meters.last.note, time.monotonic()),
                articulation=self._switches.get(meters.last.note, "") if meters.last.velocity else "",
                position=self._position(meters.frames),
            )
        )
        return meters

    def _position(self, frame: int) -> str:
        """Where the song is, and of how much."""
        if self._song is None:
            return ""
        here, whole = (clock_text(frames / self.rate_hz) for frames in (self._song.position(frame), self._song.length))
        return f"{'paused ' if self._song.paused else ''}{here} / {whole}"

    def _say_sparing(self, sparing: bool) -> None:
        if sparing == self._sparing:
            return
        self._sparing = sparing
        if not sparing:
            self._line.say("the load is normal again: all strings ring out in full")
            return
        kept = "; rendering the take restores them" if self._settings.record is not None else ""
        self._line.say(f"the load is high: the faintest released strings are damped{kept}")

    def _fade(self, stop: Stop) -> None:
        """Lets go of all notes and turns the level down, both as events, so that a recorded take has them, too."""
        self._send_all(SUSTAIN, 0)
        self._send_all(ALL_NOTES_OFF, 0)
        # Only there: a part obeys the channel that was last to set its level.
        expressions, gains = self.engine.expressions, self.engine.gains
        for step in range(1, FADE_STEPS + 1):
            if self.engine.silent or stop.wait_at_once(FADE_S / FADE_STEPS) or not self._output.alive:
                break
            left = 1.0 - step / FADE_STEPS
            if EXPRESSION in self._settings.bindings:  # it is the player's, and means something else
                for part, gain in enumerate(gains):
                    self.deck.send(PARAMETER, part, GAIN, 0, left**2 * gain)
            else:
                for channel, expression in expressions.items():
                    self.deck.send(CONTROL, channel, EXPRESSION, round(left * expression))
            self._look()
        self._send_all(ALL_SOUND_OFF, 0)
        # Until that is heard: a block until it is placed, the engine's latency, the block at the device.
        settle_s = (2 * (self.deck.period or self._settings.block) + self.engine.latency_samples) / self.rate_hz + 0.05
        stop.wait_at_once(settle_s)

    def _send_all(self, controller: int, value: int) -> None:
        for channel in range(16):
            self.deck.send(CONTROL, channel, controller, value)

    def _revive(self, stop: Stop) -> bool:
        """Tries to open the output again; whether it sounds."""
        name = self._output.name
        kept = "; the recording is kept" if self._settings.record is not None else ""
        self._line.say(f"{name}: the audio output has gone{kept}")
        self._close_output()
        if self._settings.jack is None:
            from synth.live import portaudio

            if portaudio.abandoned():
                self._line.say(f"{name}: the audio output has not come back: PortAudio cannot close it; restart synth play")
                return False
        reason = "it does not answer"
        deadline = time.monotonic() + RETRY_S
        # Never two outputs on one deck: one that does not close may come back.
        while not self._left_behind and time.monotonic() < deadline and not stop.wait(0.5):
            refused: list[str] = []
            # Looking for devices may wait for the dead one, too.
            if not answers(partial(self._reopen, refused), LEAVE_S):
                with self._output_lock:
                    self._left_behind = True
                give_back()
                break
            if refused:
                reason = refused[0]
                continue
            self._line.say(f"{name}: the audio output is back")
            return True
        self._line.say(f"{name}: the audio output has not come back: {reason}")
        return False

    def _reopen(self, refused: list[str]) -> None:
        """Opens the output again; `refused` gets the reason if that fails. Too late, it leaves everything as it is."""
        try:
            output = self._open_output()
            try:
                with self._output_lock:
                    late = self._left_behind
                    if not late:
                        self._output = output
                        self._outputs.append(output)
                if late:
                    output.close()
                else:
                    output.start()
            except Exception:
                output.close()
                raise
        except Exception as error:  # PortAudio has errors of its own
            refused.append(str(error) or type(error).__name__)

    def _events_lost(self, meters: Meters) -> int:
        """Events that found no room on their way to the engine, in the output's own rings as well."""
        return meters.events_lost + sum(getattr(output, "messages_lost", 0) for output in self._outputs)

    def _xruns(self, meters: Meters) -> int:
        """Blocks that the outputs missed, whether or not their servers say so."""
        return max(meters.xruns, sum(getattr(output, "periods_missed", 0) for output in self._outputs))

    def _make_report(self) -> LiveReport:
        meters, told, settings = self.deck.meters(), self.engine.report(), self._settings
        return LiveReport(
            output=self._output.name,
            rate_hz=self.rate_hz,
            block=self.deck.period or settings.block,
            block_asked=settings.block,
            device_latency_s=meters.device_latency_s,
            parts=self._labels,
            seed=settings.seed,
            prepare_s=self._prepare_s,
            played_s=meters.frames / self.rate_hz,
            ended=self._ended,
            notes=int(told.notes),
            **of_strings(told),
            xruns=self._xruns(meters),
            stalls=meters.stalls,
            late_ours=meters.late_ours,
            late_machine=meters.late_others,
            load_median=int(np.searchsorted(np.cumsum(self._loads), 0.5 * self._loads.sum())) / 1000.0,
            load_worst=max(self._worst, meters.load.worst),
            events=meters.events,
            events_lost=self._events_lost(meters),
            recording_lost=meters.recording_lost,
            limiter_reduction_db=float(told.limiter_reduction_db),
            unplayed=parts.unplayed_rows(told.unplayed, self._labels),
            files=self.files,
        )

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        try:
            self._stack.__exit__(kind, error, trace)
        finally:
            if self.report is not None:
                # Now it is known what could be kept.
                self.report = replace(self.report, files=[] if self._recorder is None else list(self._recorder.kept))
