"""The page of what can be done while it sounds: MIDI controllers, live parameters, keys of a terminal."""

from __future__ import annotations

from synth.drone import tanpura_keys
from synth.engine.layout import LINEAR, PARAMETER_CURVES, PARAMETER_RANGES, RATIO, SQUARE
from synth.engine.parameters import INDEX_OF, NOT_TO_BE_BOUND, Parameter, parameters_of
from synth.host.control_words import CONTROLLERS, PARAMETERS
from synth.instrument.preset import list_presets
from synth.live import playkeys
from synth.live.keylist import KeyList

from .fields import Range
from .markdown import anchor, code, plain, table

_CURVES = {LINEAR: "evenly", RATIO: "evenly in ratios", SQUARE: "as its square"}


def parameters() -> dict[str, Parameter]:
    """Live parameters by id, with their names and units, of presets that have them."""
    found: dict[str, Parameter] = {}
    for preset in list_presets():
        for each in parameters_of(0, preset):
            found.setdefault(each.id, each)
    return found


def _numbers(numbers: frozenset[int]) -> str:
    """Numbers in order, runs of them as ranges."""
    runs: list[list[int]] = []
    for each in sorted(numbers):
        if runs and runs[-1][1] == each - 1:
            runs[-1][1] = each
        else:
            runs.append([each, each])
    return ", ".join(str(low) if low == high else f"{low} to {high}" for low, high in runs)


#: where keys do something → the keys
KEYS: dict[str, KeyList] = {
    "synth play": playkeys.keys_of(instrument=True, song=False),
    "synth play --play SONG.mid": playkeys.keys_of(instrument=False, song=True),
    "synth play --play SONG.mid --keys": playkeys.keys_of(instrument=True, song=True),
    "synth drone": tanpura_keys.keys_of(4),
}


def _keys() -> str:
    """The keys of every command."""
    out = []
    for command, keys in KEYS.items():
        rows = [(code(each.shown), plain(each.does)) for each in keys.bindings]
        out += [f"### {command}\n", table(("keys", "what they do"), rows)]
    return "\n".join(out)


def page() -> str:
    """The page. Raises LookupError for a parameter without words."""
    known = parameters()
    rows = []
    for name, index in INDEX_OF.items():
        if name not in PARAMETERS or name not in known:
            raise LookupError(f"the live parameter {name} has no words; add them to synth/host/control_words.py")
        each = known[name]
        ends = str(Range(*PARAMETER_RANGES[index]))
        default = "as the preset" if each.unit in ("of L", "mm") else f"{each.default:g}"
        meaning = plain(PARAMETERS[name])
        rows.append(
            (anchor(name) + code(name), str(index), each.unit, ends, default, _CURVES[PARAMETER_CURVES[index]], meaning)
        )
    controllers = [
        (anchor(f"cc-{number}") + str(number), words.name, plain(words.meaning)) for number, words in CONTROLLERS.items()
    ]
    return "\n".join(
        [
            "# Controllers and live parameters\n",
            "## Live parameters\n",
            "They change while it sounds: by `--cc N=PARAMETER` (of `synth render` and `synth play`), by "
            "`Engine(bindings=…)`, by `PARAMETER` events, and in plugins by the host's automation. "
            "`--cc N=PARAMETER:AT_0:AT_127` gives the values at both ends of the controller; without them it runs "
            "through the range.\n",
            table(("parameter", "index", "unit", "range", "default", "controller runs", "meaning"), rows),
            "## Controllers\n",
            f"Controllers {_numbers(NOT_TO_BE_BOUND)} keep their meaning; any other may be bound to a live parameter, and "
            "then has that meaning only. Controllers 1 to 119 may also rule an "
            "[articulation](preset-keys.md#articulations.NAME.controller).\n",
            table(("controller", "name", "meaning"), controllers),
            "## Keys of a terminal\n",
            "While it plays; `?` shows them there.\n",
            _keys(),
        ]
    )
