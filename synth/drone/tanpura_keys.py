"""What the keys of a terminal change on a drone that sounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from synth.drone.cycle import CYCLE_S, Drone, live_limits, other_first
from synth.drone.swara import RATIOS
from synth.live.keylist import ALWAYS, Binding, KeyList
from synth.live.player import Player, Schedule
from synth.live.terminal import KeySource
from synth.units import cents, gain_to_db, hz_to_midi, midi_to_hz, midi_to_note

#: first strings in the order in which a key goes through them
FIRSTS = tuple(float(RATIOS[name]) for name in ("pa", "ma", "ni"))
#: so late the cycle may still be changed [s]
AHEAD_S = 0.5
CENTS, JIVA_UM, TEMPO, HUMAN, VOLUME_DB = 1.0, 0.5, 1.03, 0.05, 1.0


def keys_of(strings: int) -> KeyList:
    """The keys for a drone of so many strings."""
    return KeyList(
        Binding("first", ("f",), "f", "first string Pa/Ma/Ni"),
        Binding("choose", tuple(str(k + 1) for k in range(strings)), f"1-{strings}", "choose a string"),
        Binding("turn", ("[", "]"), "[ ]", "tune it by 1 cent"),
        Binding("sa", ("s", "S"), "s S", "Sa down/up a semitone"),
        Binding("jiva", ("-", "=", "+"), "- =", "jiva"),
        Binding("tempo", ("up", "down"), "up down", "faster/slower"),
        Binding("human", ("left", "right"), "left right", "less/more human"),
        Binding("volume", (",", "."), ", .", "volume"),
        Binding("pause", (" ",), "space", "pause"),
        *ALWAYS,
    )


class TanpuraKeys:
    """Keys act on a drone; every key says what it did. end: called by the keys that end."""

    def __init__(self, drone: Drone, say: Callable[[str], None], end: Callable[[], None]) -> None:
        self._drone, self._say, self._end = drone, say, end
        self._keys = keys_of(len(drone.pegs.names))
        self.chosen = 0

    @property
    def help(self) -> str:
        """What the keys do."""
        return self._keys.help

    def press(self, key: str) -> None:
        """One key; unknown ones do nothing."""
        action = self._keys.action(key)
        if action is None:
            return
        try:
            told = self._act(action, key)
        except ValueError as error:
            told = str(error)
        if told:
            self._say(told)

    def _act(self, action: str, key: str) -> str | None:
        drone = self._drone
        pegs, cycle = drone.pegs, drone.cycle
        match action:
            case "first":
                drone.retune(other_first(pegs, FIRSTS))
                return self._strings()
            case "sa":
                drone.retune(replace(pegs, sa_hz=pegs.sa_hz * 2.0 ** ((1 if key == "S" else -1) / 12.0)))
                return self._strings()
            case "choose":
                self.chosen = int(key) - 1
                return self._strings()
            case "turn":
                drone.retune(pegs.turned(self.chosen, CENTS if key == "]" else -CENTS))
                return self._strings()
            case "jiva":
                low, high = live_limits(drone.strings.preset)
                step = -JIVA_UM if key == "-" else JIVA_UM
                drone.set_jiva(min(max(drone.jiva_um + step, low), high))
                return f"jiva {drone.jiva_um:g} µm"
            case "tempo":
                seconds = cycle.cycle_s / TEMPO if key == "up" else cycle.cycle_s * TEMPO
                drone.set_cycle(replace(cycle, cycle_s=min(max(seconds, CYCLE_S[0]), CYCLE_S[1])))
                return f"cycle {drone.cycle.cycle_s:.2f} s"
            case "human":
                human = cycle.human + (HUMAN if key == "right" else -HUMAN)
                drone.set_cycle(replace(cycle, human=round(min(max(human, 0.0), 1.0), 6)))
                return f"human {drone.cycle.human:.2f}"
            case "volume":
                drone.set_volume(drone.volume * 10.0 ** ((VOLUME_DB if key == "." else -VOLUME_DB) / 20.0))
                return f"volume {gain_to_db(drone.volume):+.1f} dB"
            case "pause":
                drone.pause(not drone.paused)
                return "paused" if drone.paused else "going on"
            case "help":
                return self.help
            case "quit":
                self._end()
        return None

    def _strings(self) -> str:
        return strings_text(self._drone, self.chosen)


class DronePlayer(Player):
    """Plays a drone, which obeys the keys of a terminal."""

    def __init__(self, drone: Drone, terminal: KeySource, keys: TanpuraKeys) -> None:
        super().__init__(drone.events, drone.end, drone.rate_hz, ahead_s=AHEAD_S)
        self._terminal, self._keys = terminal, keys

    def feed(self, deck: Schedule) -> None:
        """Take what was pressed; give the deck what is due soon."""
        for key in self._terminal.keys():
            self._keys.press(key)
        super().feed(deck)


def strings_text(drone: Drone, chosen: int | None = None) -> str:
    """One line: Sa, and every string with its cents, the chosen one in brackets."""
    pegs = drone.pegs
    words = [f"{name}{f' {off:+g} c' if off else ''}" for name, off in zip(pegs.names, pegs.cents, strict=True)]
    if chosen is not None:
        words[chosen] = f"[{words[chosen]}]"
    return f"Sa {pitch_text(pegs.sa_hz)}: {'  '.join(words)}"


def pitch_text(frequency_hz: float) -> str:
    """'C3', or 'C#3 -12.3 cents', with its hertz."""
    key = round(hz_to_midi(frequency_hz))
    off = cents(frequency_hz, midi_to_hz(key))
    return midi_to_note(key) + (f" {off:+.1f} cents" if abs(off) >= 0.05 else "") + f" ({frequency_hz:.2f} Hz)"
