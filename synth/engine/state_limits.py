"""What every number of a State must be for the core to go on from it, said once for all who look at one.

A limit says of some words between which bounds they lie; a bound may count from another word of the state, and a limit may
hold only where other words say so. `state_check` looks at arrays with them; a bank carries them (`plugin.limits`), and the
native library looks at what it is given as they say.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from synth.engine import layout
from synth.engine.bank import Strings
from synth.engine.expression import MOST_BEND
from synth.engine.layout import BLOWN_UP, FADE, NO_FINGER, PARAMETER_RANGES, PRESS, QUANTUM, Bank, Settings
from synth.engine.strokes import LONGEST_SLIP_S
from synth.engine.tension import MOST_RISE
from synth.engine.voices.channels import RPN_NONE
from synth.engine.voices.retuning import MOST_RETUNING
from synth.instrument.articulations import MOST_ARTICULATIONS
from synth.instrument.excitations import MOST_HOLD_S
from synth.midi.zones import CHANNELS, LOWER, MOST_MEMBERS, UPPER, master_of
from synth.solver.block_rows import BLOCK
from synth.solver.board_table import SPEAKING
from synth.solver.certificates import FOR_EVER
from synth.solver.coupling import (
    APART_MODES,
    BY_FRAMES,
    CERTIFIED,
    DUE,
    ENGAGED,
    FELT_MODES,
    HEARD_MODES,
    KEPT,
    KIND,
    N_COUNTS,
    NEAR,
    QUIET,
    RATIO,
    REACH_OF,
    RESTING,
    SEVERAL,
)
from synth.solver.laws import EXACT_HOLD
from synth.solver.line_tables import ALL_DUE, READY, TABLES_DUE
from synth.solver.stepwise import LEAST_STIFFNESS
from synth.solver.stringmodel import CERTAIN, CLOCK, FREE, MOVING, RESPONSE

#: counts and frames of a state: 2⁵², 3000 years at 48 kHz, and as much again to go on before a double cannot count them
MOST_COUNT = 1 << 52
#: what is sound, force or coefficient stays below this
MOST = 1e3 * BLOWN_UP
#: what must be positive is no smaller: below lie the numbers that processors take for 0 while they compute sound
LEAST = float(np.finfo(np.float64).tiny)
#: loudest channel: volume 127 over 100, squared
_LOUDEST = 1.27**2
_ROUNDING = 1e-9
_LEAST_INTEGER, _MOST_INTEGER = -(1 << 63), (1 << 63) - 1
OF_ANOTHER_STRING = "{label} is {value}, which belongs to another string"


class StateWords(NamedTuple):
    """Elements of an array of the state by their places in it, counted through all its axes; of records, a field of each."""

    array: str
    field: str
    places: np.ndarray


class Where(NamedTuple):
    """Where a limit holds: these words, one for all or one each, taken for integers lie between low and high, included."""

    words: StateWords
    low: int
    high: int


class Limit(NamedTuple):
    """Words that lie between low and high, both included, and are no NaN; a bound for all of them, or one each.

    above, below  what low and high count from: one word, or one each
    where         for those alone of which all this is true
    multiple      they are multiples of it
    said          how a refusal says it, of label, low, high and value
    """

    words: StateWords
    low: Any
    high: Any
    above: StateWords | None = None
    below: StateWords | None = None
    where: tuple[Where, ...] = ()
    multiple: int = 1
    said: str = "{label} must lie between {low} and {high}, got {value}"

    @property
    def label(self) -> str:
        """What the words are called."""
        return f"{self.words.array}.{self.words.field}" if self.words.field else self.words.array


class _Layout:
    """What is where in the arrays of a state."""

    def __init__(self, arrays: Mapping[str, np.ndarray]) -> None:
        self._arrays = arrays

    def of(self, array: str, field: str = "", places: Any = None) -> StateWords:
        """Words of an array; all of them, unless places are given."""
        every = np.arange(self._arrays[array].size) if places is None else np.atleast_1d(np.asarray(places))
        return StateWords(array, field, every)

    def all_of(self, array: str, *rows: tuple[str, Any, Any]) -> Iterator[Limit]:
        """Limits of fields, (field, low, high) each."""
        for field, low, high in rows:
            yield Limit(self.of(array, field), low, high)

    def counter(self, number: int) -> StateWords:
        return self.of("counters", "", number)


def limits_of(
    bank: Bank,
    settings: Settings,
    strings: Strings,
    arrays: Mapping[str, np.ndarray],
    defaults: np.ndarray,
    waiting: tuple[int, int],
) -> Iterator[Limit]:
    """All limits of a state, but for its effects', which these know themselves. A limit that counts from a word comes after
    that word's own.

    strings: the engine's own. arrays: those of a state by name, looked at for their sizes alone. waiting: how few and how
    many events may wait. defaults: (parts, N_PARAMETERS) live parameters as the presets have them, which may lie outside
    their ranges.
    """
    here = _Layout(arrays)
    for name, array in arrays.items():
        if array.dtype.kind == "f":
            yield Limit(here.of(name), -MOST, MOST)
        elif array.dtype.names and name != "pending":
            for field in array.dtype.names:
                if array.dtype[field].kind == "f":
                    yield Limit(here.of(name, field), -MOST, MOST)
    yield from _time(here)
    yield from _channels(here)
    yield from _sounding(here, bank, settings)
    yield from _of_strings(here, bank, settings, strings, arrays)
    yield from _bridges(here, bank, strings, arrays)
    yield from _boards(here, bank, strings, arrays)
    yield from _parts(here, settings, bank.strings.size, defaults)
    yield from _events(here, waiting)
    yield Limit(here.of("ring"), -settings.ceiling, settings.ceiling)


def _time(here: _Layout) -> Iterator[Limit]:
    yield Limit(here.of("counters"), 0, MOST_COUNT)
    now, produced = here.counter(layout.NOW), here.counter(layout.PRODUCED)
    said = "counters: {value} computed frames are not a multiple of " + str(QUANTUM)
    yield Limit(produced, 0, MOST_COUNT, multiple=QUANTUM, said=said)
    said = "counters: {value} frames computed, {high} delivered; the difference must be less than " + f"{QUANTUM}"
    yield Limit(produced, -QUANTUM, 0, above=now, below=now, said=said)
    yield Limit(here.of("meters"), 0.0, MOST)
    yield Limit(here.of("unplayed"), 0, MOST_COUNT)
    yield Limit(here.of("keys"), 0, MOST_COUNT)
    yield Limit(here.of("quiet"), 0, MOST_COUNT)


def _channels(here: _Layout) -> Iterator[Limit]:
    widest = MOST_BEND + 1.0
    yield from here.all_of(
        "channels",
        ("program", 0, 127),
        ("volume", 0.0, _LOUDEST * (1.0 + _ROUNDING)),
        ("expression", 0.0, 1.0),
        ("pan", -1.0, 1.0),
        ("sustain", 0, 1),
        ("legato", 0, 1),
        ("rpn", 0, RPN_NONE),
        ("bend_raw", -1.0, 1.0),
        ("bend_range", 0.0, widest),
        ("bend", -widest, widest),
        ("pressure", 0.0, 1.0),
        ("timbre", 0, 127),
        ("wheel", 0.0, 1.0),
        ("shaking", 0.0, 1.0),
        ("articulation", 0, MOST_ARTICULATIONS - 1),
        ("ruled", -1, MOST_ARTICULATIONS - 1),
        ("master", 0, CHANNELS - 1),
    )
    yield Limit(here.of("zones"), 0, MOST_MEMBERS)
    lower, upper = here.of("zones", "", LOWER), here.of("zones", "", UPPER)
    for channel in range(CHANNELS):
        of_zones = [[master_of(channel, a, b) for b in range(CHANNELS)] for a in range(CHANNELS)]
        for low, high in _runs(of_zones):
            for left, right in _runs(of_zones[low]):
                master = of_zones[low][left]
                where = (Where(lower, low, high), Where(upper, left, right))
                said = "channels.master does not match the MPE zones: {label} is {value}"
                yield Limit(here.of("channels", "master", channel), master, master, where=where, said=said)
    yield Limit(here.of("tuning"), -MOST_RETUNING, MOST_RETUNING)


def _runs(values: list) -> list[tuple[int, int]]:
    """First and last place of each run of values that are equal."""
    ends = [k for k in range(len(values)) if k + 1 == len(values) or values[k + 1] != values[k]]
    return list(zip([0, *(end + 1 for end in ends[:-1])], ends, strict=True))


def _sounding(here: _Layout, bank: Bank, settings: Settings) -> Iterator[Limit]:
    strings, models = bank.strings, bank.models
    for field in ("awake", "idle", "altered", "held", "sustained", "stolen"):
        yield Limit(here.of("sounding", field), 0, 1)
    yield Limit(here.of("sounding", "flying"), layout.LANDED, layout.STEPS_DUE)
    awake = Where(here.of("sounding", "awake"), 1, 1)
    asleep = awake._replace(low=0, high=0)
    fingered = (awake, Where(here.of("sounding", "phase"), NO_FINGER + 1, layout.TOUCHED))
    height = [1e-6 * bound for bound in PARAMETER_RANGES[layout.HEIGHT]]
    yield from here.all_of(
        "sounding",
        ("model", 0, models.size - 1),
        ("pending_model", 0, models.size - 1),
        ("note", 0, 127),
        ("channel", 0, CHANNELS - 1),
        ("fade_to", 0, FADE),
        # of a span that has been mixed nothing is left
        ("direct_from", 0, 0),
        ("direct_to", 0, 0),
        ("row_from", 0, 0),
        ("row_to", 0, 0),
        ("reached", 0, QUANTUM),
        ("mode_steps", 0, MOST_COUNT),
        ("unsolved", 0, MOST_COUNT),
        ("silenced", 0, MOST_COUNT),
        ("stale", 0, 2),
        ("phase", 0, layout.TOUCHED),
        ("hand", 0.0, MOST),
        ("bend", -MOST_BEND, MOST_BEND),
        ("rise", 0.0, MOST_RISE),
        ("height", height[0] - _ROUNDING, height[1] + _ROUNDING),
        ("retuned", -MOST_RETUNING, MOST_RETUNING),
        ("retune_to", -MOST_RETUNING, MOST_RETUNING),
        ("slide", -MOST_BEND, MOST_BEND),
        ("pressure", 0.0, 1.0),
        ("key_pressure", 0.0, 1.0),
        ("timbre", -1.0, 1.0),
        ("lift", 0.0, MOST),
        ("level", 0.0, MOST),
        ("pending_velocity", 0.0, 127.0),
        ("pending_legato", 0, 1),
        ("strokes", 0, MOST_COUNT),
        ("slip_s", 0.0, LONGEST_SLIP_S),
        ("roughness", 0.0, MOST),
        ("yielding", 0.0, MOST),
        ("touch", 0, max(bank.touches.size - 1, 0)),
        ("knock", 0.0, MOST),
        ("push", 0.0, MOST),
        ("knock_step", -MOST_COUNT, MOST_COUNT),
        ("knock_steps", 0, MOST_COUNT),
        ("target", 0.0, MOST),
        ("node", 0.0, 1.0),
        ("wait", 0, MOST_COUNT),
        ("glide_to", -1, models.size - 1),
        ("pull", -MOST_BEND, MOST_BEND),
        ("pull_to", -MOST_BEND, MOST_BEND),
    )
    part = bank.parts[strings["part"]]
    yield Limit(here.of("sounding", "articulation"), part["first_articulation"], part["end_articulation"] - 1)
    yield Limit(here.of("sounding", "phase"), NO_FINGER, NO_FINGER, where=(asleep,))
    yield Limit(here.of("sounding", "fade_at"), 0, 0, below=here.of("sounding", "fade_to"))
    yield Limit(here.of("sounding", "plucked_at"), 0, 0, below=here.counter(layout.N_NOTES))
    first, last = own_models(bank)
    yield Limit(here.of("sounding", "model"), first, last, where=(awake,), said=OF_ANOTHER_STRING)
    for phase in (PRESS, layout.WAIT):
        pressing = (awake, Where(here.of("sounding", "phase"), phase, phase))
        yield Limit(here.of("sounding", "pending_model"), first, last, where=pressing, said=OF_ANOTHER_STRING)
    gliding = (awake, Where(here.of("sounding", "glide_to"), 0, models.size))
    yield Limit(here.of("sounding", "glide_to"), first, last, where=gliding, said=OF_ANOTHER_STRING)
    played = np.flatnonzero(strings["of_first"] == 0)
    lain_on = (Where(here.of("sounding", "phase", played), layout.TOUCHED, layout.TOUCHED),)
    said = "{label} is {value}, but there are no more than {high} others that could lie on the string"
    yield Limit(here.of("sounding", "touch", played), 0, bank.touches.size - 1, where=lain_on, said=said)
    most = (np.maximum(2, np.rint(MOST_HOLD_S * settings.rate_hz)) * strings["factor"]).astype(np.int64)
    yield Limit(here.of("sounding", "finger_steps"), 1, most, where=fingered)
    steps = here.of("sounding", "finger_steps")
    yield Limit(here.of("sounding", "finger_step"), 0, -1, below=steps, where=fingered)
    said = "{label} is {value}, but the string is under a finger"
    stroked = (awake, Where(here.of("sounding", "phase"), NO_FINGER + 1, layout.TOUCHED - 1))
    yield Limit(here.of("sounding", "flying"), 0, 0, where=stroked, said=said)


def own_models(bank: Bank) -> tuple[np.ndarray, np.ndarray]:
    """(strings,) the first and the last of each string's models, which are all that stand between them."""
    rows = [np.flatnonzero(bank.models["string"] == s) for s in range(bank.strings.size)]
    for row in rows:
        if row.max() - row.min() + 1 != row.size:
            raise ValueError("the models of a string must be adjacent")
    return np.array([row.min() for row in rows]), np.array([row.max() for row in rows])


def _of_strings(
    here: _Layout, bank: Bank, settings: Settings, strings: Strings, arrays: Mapping[str, np.ndarray]
) -> Iterator[Limit]:
    flat = {name: np.arange(array.size) for name, array in arrays.items()}
    of_state = {name.removeprefix("string."): places for name, places in flat.items()}
    of_own = {name.removeprefix("own."): places for name, places in flat.items()}
    first, last = own_models(bank)
    ends = zip(strings.bridges.strings, _places_of_ends(strings, arrays), strict=True)
    filled = {s: (Where(here.of("end.counts", "", counts[DUE]), READY, TABLES_DUE),) for s, (counts, _) in ends}
    for s in range(bank.strings.size):
        mine = strings.states.item(s, of_state)
        own = strings.coefficients.item(s, of_own)
        awake, altered = (Where(here.of("sounding", name, s), 1, 1) for name in ("awake", "altered"))
        in_flight = here.of("sounding", "flying", s)
        flying, with_steps = (
            Where(in_flight, layout.FLYING, layout.STEPS_DUE),
            Where(in_flight, layout.LANDED, layout.FLYING),
        )
        fresh = Where(here.of("sounding", "stale", s), 0, 0)
        plain = Where(here.of("sounding", "altered", s), 0, 0)
        most = mine.q.size
        counts = {number: here.of("string.counts", "", mine.counts[number]) for number in (MOVING, CLOCK, CERTAIN, FREE)}
        yield Limit(counts[MOVING], 0, most)
        for number, high in ((CLOCK, MOST_COUNT), (CERTAIN, 1), (FREE, 1)):
            yield Limit(counts[number], 0, high)
        said = f"sounding.flying[{s}] is set, but the string is not free of contact"
        yield Limit(counts[FREE], 1, 1, where=(awake, flying, fresh), said=said)
        due = Where(in_flight, layout.STEPS_DUE, layout.STEPS_DUE)
        for number in range(first[s], last[s] + 1):
            model = Where(here.of("sounding", "model", s), number, number)
            n, audible = (int(bank.models[name][number]) for name in ("n", "audible"))
            yield Limit(counts[MOVING], 1, n, where=(awake, model))
            yield Limit(counts[MOVING], 1, min(n, audible), where=(awake, flying, fresh, model))
            said = f"{{label}} of string {s}, which is damped or bent, must be positive"
            yield Limit(here.of("own.omega", "", own.omega[:n]), LEAST, MOST, where=(awake, altered, due, model), said=said)
            yield from _of_own(
                here, own, s, bank.models[number], (awake, altered, fresh, model), filled.get(s, (with_steps,))
            )
            # an output at the output rate needs a bus there, and an engine whose strings fly
            exact = strings.models[number].law == EXACT_HOLD
            if not (bank.strings["direct_bus"][s] >= 0 and settings.economy and exact):
                said = "{label} is {value}, but the string cannot run at the output rate"
                yield Limit(here.of("sounding", "flying", s), 0, 0, where=(awake, model), said=said)
                faded = here.of("sounding", "fade_at", s)
                yield Limit(here.of("sounding", "fade_to", s), 0, 0, below=faded, where=(awake, model), said=said)
        said = f"{{label}} is {{value}}, but string {s} uses its model's responses"
        yield Limit(here.of("string.due", "", mine.due), 0, 0, where=(awake, plain, fresh), said=said)
        fingered = (awake, Where(here.of("sounding", "phase", s), layout.WAIT + 1, layout.TOUCHED))
        said = f"{{label}} of string {s}, under a finger, must be at least {{low}}, got {{value}}"
        yield Limit(here.of("string.finger", "stiffness", mine.finger), LEAST_STIFFNESS, MOST, where=fingered, said=said)
        yield Limit(here.of("string.grip_own", "", mine.grip_own[0, BLOCK]), 0.0, MOST, where=fingered, said=said)
    yield Limit(here.of("string.looked"), 0, 1)
    yield Limit(here.of("string.due"), 0, 1)
    yield Limit(here.of("string.until"), 0, FOR_EVER)
    yield Limit(here.of("string.renewed"), -1, MOST_COUNT)
    yield from here.all_of("string.finger", ("on", 0, 1), ("stiffness", 0.0, MOST), ("resistance", 0.0, MOST))


def _places_of_ends(strings: Strings, arrays: Mapping[str, np.ndarray]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Places of the counts and of the numbers of every end, in the order of the strings that end on a bridge."""
    flat = {name.removeprefix("end."): np.arange(array.size) for name, array in arrays.items() if name.startswith("end.")}
    flat |= {name: np.arange(array.size) for name, array in strings.bridges.room.items()}
    for place in range(len(strings.bridges.strings)):
        end = strings.bridges.ends.item(place, flat)
        yield end.counts, end.numbers


def _of_own(
    here: _Layout, own: Any, s: int, model: Any, where: tuple[Where, ...], filled: tuple[Where, ...]
) -> Iterator[Limit]:
    """Of coefficients of a string's own, what is divided by; of those that may wait, where they are `filled`."""
    n, contacts = int(model["n"]), int(model["contacts"])
    said = f"{{label}} of string {s}, which is damped or bent, must be positive"
    yield Limit(here.of("own.omega", "", own.omega[:n]), LEAST, MOST, where=where, said=said)
    if contacts:
        matrix = own.matrix[: contacts**2].reshape(contacts, contacts).diagonal()
        lags = own.lags[: contacts**2 * RESPONSE].reshape(contacts, contacts, RESPONSE)[:, :, BLOCK].diagonal()
        yield Limit(here.of("own.matrix", "", matrix), LEAST, MOST, where=where + filled, said=said)
        yield Limit(here.of("own.lags", "", lags), LEAST, MOST, where=where + filled, said=said)


def _bridges(here: _Layout, bank: Bank, strings: Strings, arrays: Mapping[str, np.ndarray]) -> Iterator[Limit]:
    """Strings that share a bridge are awake together, and so are both directions of a string; others are never idle; ends
    and bodies."""
    for instrument in bank.instruments:
        mine = np.arange(instrument["first_string"], instrument["end_string"])
        seconds = bank.strings["of_first"][mine] == 1
        awake, idle = (here.of("sounding", field, mine) for field in ("awake", "idle"))
        if instrument["body"] >= 0:
            first = here.of("sounding", "awake", mine[0])
            said = "sounding.awake differs between strings that share a bridge"
            yield Limit(awake, 0, 0, above=first, below=first, said=said)
            yield Limit(idle, 0, 0, below=awake, said="{label} is {value}, but the string is not awake")
            continue
        alone = here.of("sounding", "idle", mine[~seconds])
        yield Limit(alone, 0, 0, said="{label} is {value}, but the string shares no bridge")
        for s in mine[seconds]:
            first, across = here.of("sounding", "awake", s - 1), here.of("sounding", "awake", s)
            said = "sounding.awake differs between the two directions of a string"
            yield Limit(across, 0, 0, above=first, below=first, said=said)
            own = here.of("sounding", "idle", s)
            yield Limit(own, 0, 0, above=across, below=across, said="{label} is {value}, but this second direction is awake")
    for s, (counts, numbers) in zip(strings.bridges.strings, _places_of_ends(strings, arrays), strict=True):
        models = bank.models[bank.models["string"] == s]
        contacts = models["contacts"].max()
        n = int(models["n"].max())
        low = {QUIET: -1}
        high = {
            ENGAGED: 1, NEAR: contacts, KEPT: 1, APART_MODES: n, CERTIFIED: contacts, QUIET: MOST_COUNT, KIND: SEVERAL,
            DUE: ALL_DUE, REACH_OF: bank.models.size, RESTING: 1, FELT_MODES: n, HEARD_MODES: n, BY_FRAMES: 1,
        }  # fmt: skip
        least, most = (np.array([of.get(k, 0) for k in range(N_COUNTS)]) for of in (low, high))
        yield Limit(here.of("end.counts", "", counts), least, most)
        known = (Where(here.of("end.counts", "", counts[REACH_OF]), 1, int(bank.models.size)),)
        said = f"{{label}} of string {s}, which has been advanced, must be at least {{low}}, got {{value}}"
        for place in (APART_MODES, FELT_MODES, HEARD_MODES):
            yield Limit(here.of("end.counts", "", counts[place]), 1, int(n), where=known, said=said)
        ratio = (2.0 ** (-MOST_BEND / 12.0) - _ROUNDING, 2.0 ** (MOST_BEND / 12.0) * (1.0 + _ROUNDING))
        yield Limit(here.of("end.numbers", "", numbers[RATIO]), *ratio, where=known, said=said)
        # such strings go by whole frames, and so do their fingers: what is left of one could not be gone through otherwise
        fingered = (Where(here.of("sounding", "phase", s), NO_FINGER + 1, layout.TOUCHED),)
        frame, said = int(bank.strings["factor"][s]), "{label} is {value}, which is not a whole number of frames"
        for field in ("finger_steps", "finger_step"):
            yield Limit(here.of("sounding", field, s), 0, MOST_COUNT, where=fingered, multiple=frame, said=said)
    for name in arrays:
        if name.startswith("body.") and name.endswith(".counts"):
            yield Limit(here.of(name), 0, MOST_COUNT)


def _boards(here: _Layout, bank: Bank, strings: Strings, arrays: Mapping[str, np.ndarray]) -> Iterator[Limit]:
    """No finger slides where there is no board; a string that sounds on one has a length."""
    on_boards: set[int] = set()
    for number, models in enumerate(strings.boards.models):
        mine = {field: f"board.{number}.{field}" for field in ("numbers", "touching", "account", "counts")}
        yield Limit(here.of(mine["touching"]), 0, 1)
        yield Limit(here.of(mine["account"]), 0.0, MOST)
        yield Limit(here.of(mine["counts"]), 0, MOST_COUNT)
        s = int(bank.models["string"][models[0]])
        on_boards.add(s)
        for model in models:
            where = (
                Where(here.of("sounding", "awake", s), 1, 1),
                Where(here.of("sounding", "stale", s), 0, 0),
                Where(here.of("sounding", "model", s), model, model),
            )
            said = f"{{label}} of string {s}, which speaks over a board, must be positive"
            yield Limit(here.of(mine["numbers"], "", SPEAKING), LEAST, MOST, where=where, said=said)
    free = [s for s in range(arrays["sounding"].size) if s not in on_boards]
    if free:
        said = "{label} is {value}, but the string has no board under it"
        yield Limit(here.of("sounding", "slide", free), 0.0, 0.0, said=said)


def _parts(here: _Layout, settings: Settings, strings: int, defaults: np.ndarray) -> Iterator[Limit]:
    loudest = 2.0 * _LOUDEST * PARAMETER_RANGES[layout.GAIN][1] * settings.gain
    height = [1e-6 * bound for bound in PARAMETER_RANGES[layout.HEIGHT]]
    yield from here.all_of(
        "part_state",
        ("left", -loudest, loudest),
        ("right", -loudest, loudest),
        ("hand", 0.0, 127.0),
        ("height", height[0] - _ROUNDING, height[1] + _ROUNDING),
        ("still", 0, 1),
        ("channel", 0, CHANNELS - 1),
        ("silenced", 0, MOST_COUNT),
        ("strum_at", 0, MOST_COUNT),
        ("strum_first", 0, strings - 1),
        ("strum_down", 0, 1),
    )
    low, high = (np.broadcast_to(bound, defaults.shape).reshape(-1) for bound in np.array(PARAMETER_RANGES).T)
    values = defaults.reshape(-1)
    inside = (values >= low) & (values <= high)
    within = np.flatnonzero(inside)
    yield Limit(here.of("parameters", "", within), low[within], high[within])
    for place in np.flatnonzero(~inside).tolist():  # the preset's own value is one more that it may have
        word = here.of("parameters", "", place)
        bits = int(values[place : place + 1].view(np.int64)[0])
        for where in (Where(word, _LEAST_INTEGER, bits - 1), Where(word, bits + 1, _MOST_INTEGER)):
            yield Limit(word, low[place], high[place], where=(where,))


def _events(here: _Layout, waiting: tuple[int, int]) -> Iterator[Limit]:
    said = "counters: {value} pending events are announced, {high} are stored"
    yield Limit(here.counter(layout.PENDING), *waiting, said=said)
    places = np.arange(waiting[1])
    of_queue = here.of("pending", "frame", places)
    yield Limit(of_queue, 0, 0, above=here.counter(layout.PRODUCED), below=here.counter(layout.NOW))
    if waiting[1] > 1:
        later = of_queue._replace(places=places[1:])
        said = "pending events are not in order"
        yield Limit(later, 0, _MOST_INTEGER, above=of_queue._replace(places=places[:-1]), said=said)
