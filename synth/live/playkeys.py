"""What the keys of a terminal do in `synth play`, beside the notes that they may play: help, end, and where a song is played
its transport.
"""

from __future__ import annotations

from collections.abc import Callable

from synth.live.keyboard import BINDINGS, QUIT
from synth.live.keylist import ALWAYS, Binding, KeyList
from synth.live.songplayer import SongPlayer

#: how far the arrows go in a song [s]
STEP_S, STRIDE_S = 5.0, 30.0
_STEPS = {"left": -STEP_S, "right": STEP_S, "down": -STRIDE_S, "up": STRIDE_S}


def keys_of(*, instrument: bool, song: bool) -> KeyList:
    """The keys where they are an instrument, play a song, or both: the space bar is then the instrument's."""
    transport = (
        Binding("pause", ("\r", "\n") if instrument else (" ", "\r", "\n"), "enter" if instrument else "space", "pause"),
        Binding("step", ("left", "right"), "left right", f"{STEP_S:g} s back/on"),
        Binding("step", ("down", "up"), "down up", f"{STRIDE_S:g} s back/on"),
        Binding("start", ("home", "0"), "home 0", "to the start"),
    )
    return KeyList(*(BINDINGS if instrument else ()), *(transport if song else ()), *ALWAYS)


class PlayKeys:
    """Acts on keys that play no note. song: what is played, if anything is.  end: called by the keys that end."""

    def __init__(self, keys: KeyList, song: SongPlayer | None, say: Callable[[str], None], end: Callable[[], None]) -> None:
        self._keys, self._song, self._say, self._end = keys, song, say, end

    @property
    def help(self) -> str:
        """What the keys do."""
        return self._keys.help

    def press(self, key: str) -> None:
        """One key, or QUIT; unknown ones do nothing. From any thread."""
        action = "quit" if key == QUIT else self._keys.action(key)
        if action == "quit":
            self._end()
        elif action == "help":
            self._say(self.help)
        elif self._song is None:
            pass
        elif action == "pause":
            self._song.toggle()
        elif action == "step":
            self._song.move(_STEPS[key])
        elif action == "start":
            self._song.move_to_start()
