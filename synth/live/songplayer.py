"""A song that is played live and can be paused and gone through.

A pause or a jump lets go of what the song holds, and a jump brings all that the song sets to how it stands there. Both are
events in the stream like any others: a recorded take has them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from synth.engine.bank import default_parameters
from synth.engine.engine import Engine
from synth.engine.parameters import INDEX_OF, Binding
from synth.instrument.ways import switch_keys
from synth.live.chase import PowerUp, at_frame, controls_at, let_go_rows, power_up_rows
from synth.live.player import AHEAD_S, Player, Schedule

#: after a jump the song goes on so much later: the deck has let go by then, and the controls stand [s]
LEAD_S = 0.15


def power_up_of(engine: Engine, bindings: Mapping[int, Sequence[Binding]]) -> PowerUp:
    """How a prepared engine begins; `bindings` of controllers as it was given them."""
    keys = [frozenset(switch_keys(preset)) for preset in engine.parts]
    played = np.argwhere(engine.program_map >= 0).tolist()
    parts = {(c, program): int(engine.program_map[c, program]) for c, program in played}
    return PowerUp(
        (engine.program_map >= 0).argmax(axis=1),
        default_parameters(engine.compiled),
        {controller: {INDEX_OF[row[1]] for row in bound} for controller, bound in bindings.items()},
        engine.settings.mpe,
        {player: keys[part] for player, part in parts.items()},
        parts,
    )


class SongPlayer(Player):
    """Plays a song (EVENT array, ascending) into a deck, which no other player schedules into.

    length, latency: of the song, and from an event to its sound [frames].  power_up: what a jump backwards goes back to.
    `toggle`, `move` and `move_to` may be called from any thread; they are obeyed by `feed`.
    """

    def __init__(
        self, events: np.ndarray, length: int, latency: int, rate_hz: float, power_up: PowerUp, *, ahead_s: float = AHEAD_S
    ) -> None:
        super().__init__(self._given, length + latency, rate_hz, ahead_s=ahead_s)
        self.length = length
        self._rate_hz = rate_hz
        self._events, self._latency = events, latency
        self._power_up = power_up
        self._wishes: deque[float | str] = deque()  # "toggle", "start" or seconds to move by
        self._offset = 0  # frame of the stream less that of the song
        self._next = 0  # place of the event that comes next
        self._begun = 0  # place at which the song was last begun
        self._paused_at: int | None = None  # frame of the song
        self._moved = False  # since the pause
        self._asking: int | None = None  # the deck is asked to drop what it has
        self._to_pause = False
        self._target: int | None = None  # frame of the song to go on from
        self._settled = 0  # frame of the stream from which on the last jump is through

    # --- what is wished

    def toggle(self) -> None:
        """Pause, or go on."""
        self._wishes.append("toggle")

    def move(self, seconds: float) -> None:
        """Go on so much later (earlier, where negative) in the song."""
        self._wishes.append(seconds)

    def move_to_start(self) -> None:
        """Go on from the song's beginning."""
        self._wishes.append("start")

    # --- how it stands

    @property
    def paused(self) -> bool:
        return self._to_pause if self._asking is not None else self._paused_at is not None

    def position(self, frame: int) -> int:
        """Frame of the song at a frame of the stream."""
        if self._target is not None:
            return self._target
        if self._paused_at is not None:
            return self._paused_at
        return min(max(frame - self._offset, 0), self.length)

    # --- playing

    def feed(self, deck: Schedule) -> None:
        """Does what is wished; gives the deck what is due soon."""
        self._obey(deck)
        if self._asking is not None:
            at = deck.dropped_at(self._asking)
            if at is None:
                return  # what is scheduled now would be dropped, too
            self._asking = None
            self._cut(at)
            if not self._to_pause:
                self._go_on(deck.frame)
        super().feed(deck)

    def _obey(self, deck: Schedule) -> None:
        if deck.frame < self._settled:
            return
        toggled = False
        while self._wishes:
            wish = self._wishes.popleft()
            if wish == "toggle":
                toggled = not toggled
            else:
                base = 0.0 if wish == "start" else self.position(deck.frame) + float(wish) * self._rate_hz
                self._target = min(max(round(base), 0), self.length)
        if self._asking is not None:  # already under way
            self._to_pause ^= toggled
        elif self._paused_at is None:
            if toggled or self._target is not None:
                self._to_pause = toggled
                self._asking = deck.drop_scheduled()
        else:
            if self._target is not None:
                self._paused_at, self._target, self._moved = self._target, None, True
            if toggled:
                self._target = self._paused_at
                self._go_on(deck.frame)

    def _cut(self, at: int) -> None:
        """Frame `at` of the stream is the first from which on the deck plays nothing of the song: let go there."""
        here = min(max(at - self._offset, 0), self.length)
        reached = int(np.searchsorted(self._events["frame"], at - self._offset))
        # What found no room in the deck is dropped with the rest.
        self._waiting = at_frame(let_go_rows(self._events, self._begun, reached), at)
        self._moved = self._target is not None
        self._paused_at = here if self._target is None else self._target
        self._target = None if self._to_pause else self._paused_at
        self.end = None

    def _go_on(self, frame: int) -> None:
        """The song goes on from `_target`, a little later than a frame of the stream."""
        assert self._target is not None
        start = frame + round(LEAD_S * self._rate_hz)
        place = int(np.searchsorted(self._events["frame"], self._target))
        rows = power_up_rows(self._events, self._power_up) if self._moved else []
        rows += controls_at(self._events, place, mpe=self._power_up.mpe, engine=self._power_up)
        self._waiting = np.concatenate((self._waiting, at_frame(rows, frame)))
        self._asked = frame
        self._offset = start - self._target
        self._next = self._begun = place
        self.end = self._offset + self.length + self._latency
        self._settled = start
        self._paused_at = self._target = None
        self._moved = False

    def _given(self, until: int) -> np.ndarray:
        """The song's events before a frame of the stream."""
        if self._paused_at is not None:
            return self._events[:0].copy()
        first, self._next = self._next, max(self._next, int(np.searchsorted(self._events["frame"], until - self._offset)))
        due = self._events[first : self._next].copy()
        due["frame"] += self._offset
        return due
