"""The setup of a preset as a player turns it: numbers of strings, bridge, frets and pickup that are compiled into a bank.

    numbers = setup_of(0, preset)                                # what there is to turn, and how far
    other = set_up(preset, {"string.length": 0.9})               # the preset with some of them changed

Some of a preset's numbers lie at notes or differ from string to string: what stands for these is a factor or a shift of all
of them, and its value as compiled is 1 or 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from synth.engine.layout import LINEAR, RATIO
from synth.instrument.fields import scaled
from synth.instrument.preset import Preset, validate_preset

Data = dict[str, Any]
#: of a string, with the power in which each goes with the thickness of the wire
_GAUGE = {"diameter_mm": 1, "core_diameter_mm": 1, "winding_diameter_mm": 1, "linear_density_g_m": 2}
_LOSSES = ("viscoelastic_loss", "thermoelastic_q_inverse")


@dataclass(frozen=True)
class SetupNumber:
    """A number of the setup of preset number `part`, its `index`-th; `default`: as compiled; curve: of `engine.layout`."""

    part: int
    index: int
    id: str
    name: str
    unit: str
    minimum: float
    maximum: float
    default: float
    curve: int


@dataclass(frozen=True)
class _Number:
    """How one is declared. value: as a preset has it, None: it has no such number; change: puts another one into the data of
    a preset. The range reaches to what a preset has."""

    id: str
    name: str
    unit: str
    low: float
    high: float
    curve: int
    value: Callable[[Preset], float | None]
    change: Callable[[Data, float], None]
    threadless: str = ""  # its name on a bridge without a thread, if that is another

    def name_in(self, preset: Preset) -> str:
        """What it is called in a preset."""
        shape = preset.obstacle
        return self.threadless if self.threadless and shape.kind == "bridge" and not shape.has_thread else self.name


def setup_of(part: int, preset: Preset, tuned: bool = False) -> list[SetupNumber]:
    """What there is to turn in a preset, in the order in which hosts show it. tuned: what plays on it tunes its keys, to
    pitches that no setup is to move."""
    out: list[SetupNumber] = []
    for each in _NUMBERS:
        value = each.value(preset)
        if value is not None and not (tuned and each.id.startswith("tuning.")):
            ends = min(each.low, value), max(each.high, value)
            curve = each.curve if ends[0] > 0.0 else LINEAR
            out.append(SetupNumber(part, len(out), each.id, each.name_in(preset), each.unit, *ends, value, curve))
    return out


def set_up(preset: Preset, values: Mapping[str, float]) -> Preset:
    """The preset with numbers of its setup changed, by their ids; one that is as compiled changes nothing.

    Raises ValueError for an id that there is not and a number outside of its range, PresetError for what cannot be.
    """
    numbers = {number.id: number for number in setup_of(0, preset)}
    data = preset.model_dump(exclude_unset=True)
    for identity, value in values.items():
        number = numbers.get(identity)
        if number is None:
            raise ValueError(f"{preset.name} has no {identity!r} in its setup; there are {', '.join(numbers)}")
        if not number.minimum <= value <= number.maximum:
            raise ValueError(
                f"{preset.name}: {number.name} must lie between {number.minimum:g} and {number.maximum:g}, got {value:g}"
            )
    changed = {identity: value for identity, value in values.items() if value != numbers[identity].default}
    if not changed:
        return preset
    for each in _NUMBERS:
        if each.id in changed and each.value(preset) is not None:
            each.change(data, changed[each.id])
    told = ", ".join(f"{numbers[identity].name} {value:g}" for identity, value in changed.items())
    return validate_preset(data, f"{preset.name} with {told}").with_measured(preset.measured)


def _plain(value: Any) -> float | None:
    return float(value) if isinstance(value, int | float) else None


def _one_length(preset: Preset) -> float | None:
    """Of all strings, where they have the same."""
    first = _plain(preset.string[0].length_m)
    return first if all(each.length_m == first for each in preset.string) else None


def _set_length(data: Data, value: float) -> None:
    for string in data["string"]:
        string["length_m"] = value


def _scale(*keys: str, powers: Mapping[str, int] | None = None) -> Callable[[Data, float], None]:
    def change(data: Data, factor: float) -> None:
        for string in data["string"]:
            for key in keys:
                if string.get(key) is not None:
                    string[key] = scaled(string[key], factor ** (powers or {}).get(key, 1))

    return change


def _of(table: str, key: str, *kinds: str) -> Callable[[Preset], float | None]:
    """A plain number of a table, which is of one of these kinds, if any are given."""

    def value(preset: Preset) -> float | None:
        found = getattr(preset, table)
        return _plain(getattr(found, key, None)) if not kinds or getattr(found, "kind", None) in kinds else None

    return value


def _put(table: str, key: str) -> Callable[[Data, float], None]:
    def change(data: Data, value: float) -> None:
        data.setdefault(table, {})[key] = value

    return change


def _at_notes(key: str) -> Callable[[Preset], float | None]:
    """1 where a number of the obstacle lies at notes."""
    return lambda preset: 1.0 if isinstance(getattr(preset.obstacle, key, None), dict) else None


def _scale_obstacle(key: str) -> Callable[[Data, float], None]:
    def change(data: Data, factor: float) -> None:
        data["obstacle"][key] = scaled(data["obstacle"][key], factor)

    return change


def _raised(kind: str) -> Callable[[Preset], float | None]:
    """0 where heights are listed."""
    return lambda preset: 0.0 if preset.obstacle.kind == kind and getattr(preset.obstacle, "heights_mm", None) else None


def _raise(data: Data, value: float) -> None:
    """The strings above what lies under them: heights count from the string."""
    data["obstacle"]["heights_mm"] = [height - value for height in data["obstacle"]["heights_mm"]]


def _bass_action(preset: Preset) -> float | None:
    """At fret 12 under the lowest string, where [setup] has it."""
    return None if preset.setup is None else preset.setup.action_bass_mm


def _raise_over_neck(data: Data, value: float) -> None:
    """Both sides by as much as the bass side."""
    setup = data["setup"]
    by = value - setup["action_bass_mm"]
    for key in ("action_bass_mm", "action_treble_mm"):
        if setup.get(key) is not None:
            setup[key] += by


def _gauged(preset: Preset) -> float | None:
    """1 where no makers' names say how thick its strings are."""
    return 1.0 if preset.setup is None or not preset.setup.strings else None


def _lossy(preset: Preset) -> float | None:
    return 1.0 if any(getattr(each, key) != 0.0 for each in preset.string for key in _LOSSES) else None


_NUMBERS = (
    _Number("tuning.a4", "Concert pitch", "Hz", 380.0, 480.0, RATIO, _of("tuning", "a4_hz"), _put("tuning", "a4_hz")),
    _Number("string.length", "String length", "m", 0.3, 1.5, RATIO, _one_length, _set_length),
    _Number(
        "string.lengths",
        "String lengths",
        "×",
        0.5,
        2.0,
        RATIO,
        lambda preset: 1.0 if _one_length(preset) is None else None,
        _scale("length_m"),
    ),
    _Number("string.gauge", "String gauge", "×", 0.5, 2.0, RATIO, _gauged, _scale(*_GAUGE, powers=_GAUGE)),
    _Number("string.losses", "String losses (age)", "×", 0.2, 10.0, RATIO, _lossy, _scale(*_LOSSES)),
    _Number(
        "obstacle.jiva",
        "Thread (jiva)",
        "µm",
        -50.0,
        200.0,
        LINEAR,
        _of("obstacle", "jiva_um", "bridge"),
        _put("obstacle", "jiva_um"),
        threadless="Gap over the bridge",
    ),
    _Number(
        "obstacle.jivas",
        "Threads (jiva)",
        "×",
        0.0,
        10.0,
        LINEAR,
        _at_notes("jiva_um"),
        _scale_obstacle("jiva_um"),
        threadless="Gaps over the bridge",
    ),
    _Number(
        "obstacle.distance",
        "Thread to bridge edge",
        "mm",
        1.0,
        30.0,
        RATIO,
        _of("obstacle", "distance_mm", "bridge"),
        _put("obstacle", "distance_mm"),
        threadless="Depth of the bridge",
    ),
    _Number(
        "obstacle.distances",
        "Thread to bridge edge",
        "×",
        0.2,
        5.0,
        RATIO,
        _at_notes("distance_mm"),
        _scale_obstacle("distance_mm"),
        threadless="Depth of the bridge",
    ),
    _Number(
        "obstacle.ratio",
        "Thread to bridge edge",
        "of L",
        0.001,
        0.03,
        RATIO,
        _of("obstacle", "distance_ratio", "bridge"),
        _put("obstacle", "distance_ratio"),
        threadless="Depth of the bridge",
    ),
    _Number(
        "obstacle.action",
        "Action at fret 12",
        "mm",
        0.5,
        6.0,
        RATIO,
        _of("obstacle", "action_12th_mm", "frets"),
        _put("obstacle", "action_12th_mm"),
    ),
    _Number("setup.action", "Action at fret 12, bass side", "mm", 0.5, 6.0, RATIO, _bass_action, _raise_over_neck),
    _Number("obstacle.raised", "Strings raised over the frets", "mm", -0.5, 3.0, LINEAR, _raised("frets"), _raise),
    _Number("obstacle.lifted", "Strings raised over the points", "mm", -0.5, 5.0, LINEAR, _raised("points"), _raise),
    _Number(
        "output.position",
        "Pickup position from the saddle",
        "of L",
        0.02,
        0.5,
        LINEAR,
        _of("output", "position", "pickup", "flux"),
        _put("output", "position"),
    ),
    _Number(
        "output.distance",
        "Pickup distance",
        "mm",
        1.0,
        20.0,
        RATIO,
        _of("output", "distance_mm", "pickup", "flux"),
        _put("output", "distance_mm"),
    ),
)
