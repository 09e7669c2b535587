"""What a packed bank says of the models of its strings: where their tables lie, and what these follow from (`packed_bank`).

Most of a bank are tables that follow from a few numbers: mode shapes from places, step coefficients from frequencies and
decay rates, responses from both. `models_of` lists the numbers, MODEL, STRING and NUT each, for an engine that was prepared.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from synth.dsp.decimator import design
from synth.engine.engine import Engine
from synth.instrument.compile import CompiledString, Position, output_distance, string_across
from synth.instrument.preset import Preset
from synth.native.arrays import arrays_of
from synth.physics.string import String
from synth.plugin.bankfile import Laid
from synth.plugin.predicted import heard
from synth.solver.laws import EXACT_HOLD
from synth.solver.stringmodel import StringModel

#: tables that are made, in this order
TABLES = (
    "omega",
    "sigma",
    "contacts.residual",
    "contacts.shapes",
    "rows",
    "outputs.weights",
    "contacts.matrix",
    "contacts.lags",
    "outputs.lags",
    "single.rows",
    "single.shapes",
    "single.weights",
)
#: how weights follow: not at all, from a mode's shape (`predicted.heard`), from those of another model through the filter of
#: its bus, smoothly from one to the next
PLAIN, HEARD, FILTERED, SMOOTH = range(4)
#: integers of a model. makes: a bit for each of TABLES; base: the model before it, or whose flight it is; contacts: of the
#: table of shapes; taps: from the middle one of a filter on
MODEL = (
    "modes",
    "own",
    "size",
    "contacts",
    "lagged",
    "singles",
    "on_q",
    "velocity",
    "string",
    "weighing",
    "first_tap",
    "taps",
    "base",
    "makes",
    *TABLES,
)
#: numbers of a model: half: of the aperture [m]; gains of its weights; rate: of its steps [Hz]
NUMBERS = ("mu", "dt", "ratio", "loss", "place", "half", "gain_q", "gain_v", "rate")
#: of a string: its numbers, as `predicted.modes` takes them, and integers
STRING = (
    "length_m",
    "tension_n",
    "linear_density_kg_m",
    "bending_stiffness_n_m2",
    "viscoelastic_loss",
    "thermoelastic_q_inverse",
    "air_viscosity",
    "air_density",
    "equivalent_diameter_m",
)
STRING_INTEGERS = ("linear", "first_nut", "nuts")


class Models(NamedTuple):
    """Integers of M models (M, MODEL), their numbers (M, NUMBERS); integers of S strings (S, STRING_INTEGERS), numbers
    (S, STRING); resonances of nuts (·, 3): Hz, Q, kg; taps of filters; places of contacts [m], of those models whose shapes
    are made, in turn."""

    models: np.ndarray
    numbers: np.ndarray
    string_integers: np.ndarray
    strings: np.ndarray
    nuts: np.ndarray
    taps: np.ndarray
    places: np.ndarray


class _Place(NamedTuple):
    """A model's string: of which preset, how compiled, whether across; and at which of its places."""

    preset: Preset
    string: CompiledString
    position: Position
    across: bool
    body: bool


def models_of(laid: list[Laid]) -> Models:
    """Of engines that were prepared for rates of a bank."""
    lists = _Lists()
    for each in laid:
        lists.engine(each.engine, each.place)
    return lists.done()


class _Lists:
    def __init__(self) -> None:
        self._made: set[int] = set()
        self._models: list[dict[str, int]] = []
        self._numbers: list[dict[str, float]] = []
        self._strings: dict[String, int] = {}
        self._nuts: dict[tuple, int] = {}
        self._taps: list[np.ndarray] = []
        self._places: list[np.ndarray] = []
        self._filters: dict[tuple[float, int], tuple[int, int]] = {}

    def engine(self, engine: Engine, place: Callable[[np.ndarray], int]) -> None:
        models, flights = engine.memory.strings.models, engine.memory.built.flights
        of = list(_places_of(engine))
        assert len(of) == len(models) == len(flights)
        first = len(self._models)
        for model, where in zip(models, of, strict=True):
            self._model(engine, model, where, place, None)
        for k, (flight, where) in enumerate(zip(flights, of, strict=True)):
            if flight is not models[k]:
                self._model(engine, flight, where, place, first + k)

    def done(self) -> Models:
        strings = list(self._strings)
        nuts = [self._nuts.setdefault(each.nut, sum(len(nut) for nut in self._nuts)) for each in strings]
        integers = [
            (int(each.stiffness_law == "linear"), nut, len(each.nut)) for each, nut in zip(strings, nuts, strict=True)
        ]
        resonances = [(mode.frequency_hz, mode.q, mode.mass_kg) for nut in self._nuts for mode in nut]
        return Models(
            np.array([[row[name] for name in MODEL] for row in self._models], np.int64).reshape(-1, len(MODEL)),
            np.array([[row[name] for name in NUMBERS] for row in self._numbers]).reshape(-1, len(NUMBERS)),
            np.array(integers, np.int64).reshape(-1, len(STRING_INTEGERS)),
            np.array([[getattr(each, name) for name in STRING] for each in strings]).reshape(-1, len(STRING)),
            np.array(resonances, np.float64).reshape(-1, 3),
            np.concatenate([np.zeros(0), *self._taps]),
            np.concatenate([np.zeros(0), *self._places]),
        )

    def _model(
        self, engine: Engine, model: StringModel, where: _Place, place: Callable[[np.ndarray], int], base: int | None
    ) -> None:
        position = where.position
        row = dict.fromkeys(MODEL, 0) | {
            "modes": model.modes,
            "own": min(position.own, model.modes),
            "size": model.omega.size,
            "contacts": model.contacts.size,
            "lagged": model.contacts.lags.shape[0],
            "singles": model.single.rows.shape[1],
            "on_q": model.outputs.on_q,
            "velocity": int(model.law != EXACT_HOLD),
            "base": max(0, len(self._models) - 1) if base is None else base,
        }
        string, ratio, loss = position.string, 1.0, 1.0
        across = where.preset.polarisation
        if where.across and across is not None:
            string = string_across(across, string)
            ratio, loss = 2.0 ** (across.detuning_cents / 1200.0), across.loss_ratio
        row["string"] = self._strings.setdefault(string, len(self._strings))
        numbers = dict.fromkeys(NUMBERS, 0.0) | {"mu": model.mu, "dt": model.dt, "ratio": ratio, "loss": loss}
        arrays = arrays_of(model)
        for k, name in enumerate(TABLES):
            array = arrays[name]
            if not array.nbytes:
                continue
            row[name] = place(array)
            if row[name] not in self._made and _fits(name, arrays):
                self._made.add(row[name])
                row["makes"] |= 1 << k
        if row["makes"] & 1 << TABLES.index("contacts.shapes"):
            self._places.append(position.places_m)
        if base is not None:
            row["weighing"] = FILTERED
            row["first_tap"], row["taps"] = self._filter(engine.rate_hz, where.string.factor)
            numbers["rate"] = where.string.factor * engine.rate_hz
        elif where.body:
            row["weighing"] = SMOOTH
        elif where.preset.output.kind in ("displacement", "velocity", "pickup", "flux"):
            row["weighing"] = HEARD
            numbers |= _hearing(where, model)
        self._models.append(row)
        self._numbers.append(numbers)

    def _filter(self, rate_hz: float, factor: int) -> tuple[int, int]:
        """Where the taps of a bus's filter begin, and how many there are."""
        if (rate_hz, factor) not in self._filters:
            taps = design(rate_hz, factor)
            self._filters[rate_hz, factor] = sum(each.size for each in self._taps), taps.size - taps.size // 2
            self._taps.append(taps[taps.size // 2 :])
        return self._filters[rate_hz, factor]


def _places_of(engine: Engine) -> Iterator[_Place]:
    """Of an engine's models, one after the other, as `engine.bank` lists them."""
    for part in engine.compiled:
        for string in part.strings:
            for across in (False, True)[: 1 if part.preset.polarisation is None else 2]:
                for position in string.positions:
                    yield _Place(part.preset, string, position, across, part.body is not None)


def _fits(name: str, arrays: dict[str, np.ndarray]) -> bool:
    """Whether a table is of the form that it is made in: symmetric, zero where it is left out."""
    array = arrays[name]
    if name in ("contacts.matrix", "contacts.residual"):
        return _same(array, array.T)
    if name == "contacts.lags":
        half = array.shape[2] // 2
        symmetric = _same(array, array.transpose(1, 0, 2)) and _same(array[:, :, half], arrays["contacts.matrix"])
        return symmetric and not array[:, :, :half].view(np.uint8).any()
    return name != "outputs.lags" or not array[:, :, : array.shape[2] // 2].any()


def _same(one: np.ndarray, other: np.ndarray) -> bool:
    return bool((np.ascontiguousarray(one).view(np.int64) == np.ascontiguousarray(other).view(np.int64)).all())


def _hearing(where: _Place, model: StringModel) -> dict[str, float]:
    """Where the output of a model is taken, how wide, and how strong: the gains that meet most weights to the bit."""
    string, output = where.position.string, where.preset.output
    open_length = where.string.open_length_m
    half = 0.5e-3 * output.aperture_mm if output.magnetic else 0.0
    place = string.length_m - output_distance(where.preset, string, open_length)
    own = min(where.position.own, model.modes)
    plain = np.zeros(own)
    heard(place, string.length_m, half, 1.0, own, plain)
    gains = []
    for row in model.outputs.weights[:, :own]:
        loud = int(np.argmax(np.abs(plain)))
        gain = float(row[loud] / plain[loud]) if plain[loud] else 0.0
        near = [gain, math.nextafter(gain, math.inf), math.nextafter(gain, -math.inf)]
        gains.append(max(near, key=lambda each: int((each * plain == row).sum())))
    return {"place": place, "half": half, "gain_q": gains[0], "gain_v": gains[1]}
