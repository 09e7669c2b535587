"""Compiled parts laid out for the native core: a Bank, the models of its strings, and what changes while they sound."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple
from zlib import crc32

import numpy as np
from threadpoolctl import threadpool_limits

from synth import panning
from synth.dsp.decimator import STOPBAND_EDGE, design, phase_space, response, split_taps
from synth.engine import layout
from synth.engine.articulated import articulation_rows, hand_fields
from synth.engine.board_tables import Boards, LaidBoard
from synth.engine.bridges import Bridges, SharedBody
from synth.engine.layout import (
    CHECK_EVERY,
    FADE,
    OFF_BOARD,
    QUANTUM,
    SPAN,
    SPAN_STEPS,
    STEP,
    STEP_TWO,
    TOGETHER,
    WORK_ON,
    Bank,
    Shared,
    Sounding,
    SpanWork,
    State,
    Stream,
)
from synth.engine.pressed_flight import pressed_numbers
from synth.engine.team import N_WORDS
from synth.engine.voices.channels import power_up
from synth.instrument.compile import CompiledPart, CompiledString, Position, second_direction, static_compliance
from synth.instrument.preset import BridgeObstacle, Preset, at_note
from synth.instrument.soundboard import Soundboard
from synth.native.arrays import Pool, allocate, record, whole_lines
from synth.native.views import table, words
from synth.physics.modes import ramp_moments
from synth.physics.pressed_modes import PressedModes, pressed_modes
from synth.solver.certificates import CERTIFY_FROM
from synth.solver.contact_laws import step_of
from synth.solver.coupling import most_of_contacts
from synth.solver.lanes import padded
from synth.solver.laws import EXACT_HOLD, coefficients, law_of
from synth.solver.layers import static_forces, static_matrix
from synth.solver.lcp import SOLVED
from synth.solver.single import SingleTables, keeps_losses
from synth.solver.stringmodel import (
    Coefficients,
    Scratch,
    StringContacts,
    StringModel,
    StringModes,
    StringOutputs,
    StringState,
    make_scratch,
    make_string,
    no_contacts,
    state_sizes,
)

PENDING_EVENTS = 1 << 14
#: outputs of a string: one of displacement, one of velocity
OUTPUTS = 2


#: share of itself by which a bridge moves otherwise, at most, at the frequency of a mode that is left out of a string that
#: nobody plays (`Soundboard.felt`): half of what coupled strings that touch nothing may be off
UNFELT = 5e-4


class Built(NamedTuple):
    """A Bank and, for each of its models, the string as compiled and over whole frames behind the decimator; what strings
    share, and what lies under them."""

    bank: Bank
    models: list[StringModel]
    flights: list[StringModel]
    bodies: list[SharedBody]
    boards: list[LaidBoard]
    single: bool  # whether modes may be float32 (`solver.single`) …
    frame_s: float  # … over a frame of the output, if all lose enough in it


class _Lists:
    """What is listed while parts are laid out: one record after the other."""

    def __init__(self, rate_hz: float, law: int, step: int, restitution: float, span: int, single: bool) -> None:
        self.rate_hz, self.law, self.step, self.restitution, self.span = rate_hz, law, step, restitution, span
        self.single = single
        self.models: list[tuple] = []
        self.strings: list[tuple] = []
        self.positions: list[tuple] = []
        self.instruments: list[tuple] = []
        self.parts: list[tuple] = []
        self.buses: list[tuple] = []
        self.articulations: list[tuple] = []
        self.touches: list[tuple] = []
        self.taps: list[np.ndarray] = []
        self.compiled: list[StringModel] = []
        self.flights: list[StringModel] = []
        self.bodies: list[SharedBody] = []
        self.boards: list[LaidBoard] = []
        self.leverage: list[np.ndarray] = []
        self.settled: list[np.ndarray] = []
        self._tap_places: dict[int, tuple[int, int]] = {}
        self._line = self._row = self._fade = self._levers = self._settled = 0

    def part(self, part: CompiledPart, channel: int, together: bool) -> None:
        """A part with its strings and buses; `together`: they are one instrument."""
        preset, p = part.preset, len(self.parts)
        first_position, first_bus = len(self.positions), len(self.buses)
        bus_of: dict[int, int] = {}
        sides = 2 if part.body is not None or preset.spread else 1
        body = {"body": -1, "bus": -1, "output_bound": 0.0}
        together = together or part.body is not None
        if part.body is not None:
            left = self._bus(p, 1, sides)
            bus_of = {1: left, **{string.factor: left for string in part.strings}}
            body = {"body": len(self.bodies), "bus": left, "output_bound": part.body.swinging_bound}
            self.bodies.append(SharedBody(len(self.instruments), part.body))
        two = preset.polarisation is not None
        same: Counter[tuple[str, int]] = Counter()
        for number, string in enumerate(part.strings):
            same[string.name, string.open_note] += 1
            dice = crc32(f"{string.name} {string.open_note} {same[string.name, string.open_note]}".encode())
            if not (together and number):
                last = len(self.strings) + (len(part.strings) if together else 1) * (1 + two)
                own = {"first_string": len(self.strings), "end_string": last, "together": int(together or two)}
                self.instruments.append(record(layout.INSTRUMENT, **own, **body))
            for factor in (string.factor, 1):
                if factor not in bus_of:
                    bus_of[factor] = self._bus(p, factor, sides)
            heard = None if part.body is None else (part.body, number * (1 + two))
            self._string(p, preset, string, bus_of, heard, two, False, dice)
            if preset.polarisation is not None:
                across = second_direction(preset, string)
                beside = None if heard is None else (heard[0], heard[1] + 1)
                self._string(p, preset, across, bus_of, beside, False, True, dice)
        pluck, output = preset.pluck, preset.output
        first_articulation = len(self.articulations)
        articulations, touches, release_touch = articulation_rows(preset, len(self.touches))
        self.articulations += articulations
        self.touches += touches
        angle = 0.0 if preset.polarisation is None else math.radians(preset.polarisation.pluck_deg)
        self.parts.append(
            record(
                layout.PART,
                channel=channel,
                first_position=first_position,
                end_position=len(self.positions),
                first_bus=first_bus,
                end_bus=len(self.buses),
                ring_on=int(preset.damping.ring_on),
                use_q=int(_uses(preset)[0]),
                use_v=int(_uses(preset)[1]),
                pickup_distance=1e-3 * output.distance_mm,
                excited=int(preset.excitation is not None and preset.excitation.kind != "pluck"),
                velocity_exponent=pluck.velocity_exponent,
                finger_stiffness=1e3 * pluck.finger_stiffness_n_mm,
                finger_loss=pluck.finger_loss,
                pressure_bend=1e-2 * preset.mapping.pressure_cents,
                stereo=int(preset.stereo),
                sides=sides,
                pluck_first=math.cos(angle),
                pluck_second=math.sin(angle),
                choirs=max((string.choir for string in part.strings), default=1),
                first_articulation=first_articulation,
                end_articulation=len(self.articulations),
                others_s=preset.damping.others_s or 0.0,
                lifts=int(preset.hand.fret_release),
                release_touch=release_touch,
                **hand_fields(preset.hand),
            )
        )

    def _bus(self, p: int, factor: int, sides: int) -> int:
        """Buses of part p at `factor` times the output rate, one or left and right; the number of the first."""
        if factor not in self._tap_places:
            linear = design(self.rate_hz, factor)
            self._tap_places[factor] = (sum(t.size for t in self.taps), linear.size)
            self.taps.append(np.empty_like(linear))
            split_taps(linear, factor, self.taps[-1])
        place, size = self._tap_places[factor]
        for _ in range(sides):
            self.buses.append(record(layout.BUS, part=p, factor=factor, taps=place, n_taps=size, off=self._line))
            self._line += whole_lines(size + self.span * QUANTUM * factor)
        return len(self.buses) - sides

    def _string(
        self,
        p: int,
        preset: Preset,
        string: CompiledString,
        bus_of: dict[int, int],
        heard: tuple[Soundboard, int] | None,
        has_second: bool,
        is_second: bool,
        dice: int,
    ) -> None:
        factor, index = string.factor, len(self.strings)
        left, right = math.sqrt(2.0) * panning.shares(string.pan)
        self.strings.append(
            record(
                layout.STRING,
                part=p,
                dice=dice,
                instrument=len(self.instruments) - 1,
                bus=bus_of[factor],
                factor=factor,
                left=left,
                right=right,
                positions=0 if string.sympathetic else string.places,
                open_length=string.open_length_m,
                pluck_force=string.pluck_force_n,
                impedance=string.impedance_kg_s,
                draw_s=string.draw_s,
                slip_s=string.slip_s,
                hard_slip_s=string.hard_slip_s,
                release_s=string.release_s,
                row=self._row,
                direct_bus=bus_of[1] if factor > 1 and heard is None else -1,
                direct=index * self.span * QUANTUM,
                fade=self._fade,
                pressure_height=1e-6 * at_note(preset.mapping.pressure_um, string.open_note),
                open_model=len(self.models),
                second=index + 1 if has_second else -1,
                of_first=int(is_second),
                second_models=len(string.positions) if has_second else 0,
                axial_stiffness=string.axial_stiffness_n,
                choir=string.choir,
                pluck_shift=string.pluck_shift,
                friction=string.friction if is_second else 0.0,
                flux_bend=0.0 if is_second else string.flux_bend,
            )
        )
        self._row += whole_lines(self.span * QUANTUM * factor)
        self._fade += FADE * factor
        for position in string.positions:
            place = {"part": p, "string": index, "note": position.note, "fret": position.fret, "model": len(self.models)}
            place["elsewhere"] = int(string.elsewhere)
            if not (is_second or string.sympathetic):
                self.positions.append(record(layout.POSITION, **place))
            if string.board is not None:
                dt = 1.0 / (self.rate_hz * factor)
                self.boards.append(LaidBoard(len(self.models), position.own + 1, dt, position.mu, string.board))
            pressed = None
            if heard is not None and position is string.positions[0] and string.friction == 0.0:
                pressed = self._pressed(position, *heard)
            self._model(preset, position, factor, heard, string.board is not None, pressed)

    def _model(
        self,
        preset: Preset,
        position: Position,
        factor: int,
        heard: tuple[Soundboard, int] | None,
        on_board: bool,
        pressed: tuple[PressedModes, int] | None,
    ) -> None:
        """pressed: the modes that it has while it presses on one of its contacts without a break, and which one."""
        n, c = position.omega.size, position.eta.size
        uses_q, uses_v = _uses(preset)
        bound = math.sqrt(float(np.sum((position.wq / position.omega) ** 2)))
        if uses_v:
            bound = math.sqrt(float(np.sum(position.wv**2)))
        weights = np.array([position.wq, position.wv])
        if heard is not None:  # no output of its own: what its pull at the bridge makes of a body that swings with it
            body, line = heard
            omega = position.omega[: position.own]
            pull = position.mu * ramp_moments(position.length_m, position.own) * omega**2
            weights[0, : position.own] = np.abs(pull) * body.heard(omega, line)
        static = lift = rest = 0.0
        if c:
            bent = position.shapes[0] / (position.mu * position.omega**2)
            static = float(position.shapes[0] @ bent + position.residual[0, 0])
            lift = float(position.wq @ bent)
            rest = float(position.wq @ position.q_rest)
        if uses_v or heard is not None:  # of pickups and bridges, the rest line alone is what is counted from
            lift = rest = 0.0
        settled = np.zeros(0)
        if c > 1 and isinstance(preset.obstacle, BridgeObstacle):
            compliance = static_compliance(position.omega, position.mu, position.shapes, position.residual)
            settled = static_matrix(compliance, position.layers).reshape(-1)
        audible = self._audible(position.omega[: position.own])
        driven = audible
        if heard is not None:
            own = (position.omega[:audible], position.sigma[:audible])
            driven = _driven(*own, position.tension_n / position.length_m, *heard)
        reach, lever, shape = most_of_contacts(position.omega, _ramp(position), position.shapes, position.leverage)
        self.models.append(
            record(
                layout.MODEL,
                string=len(self.strings) - 1,
                n=n,
                own=position.own,
                contacts=c,
                layered=int(position.layers.shape[1] > 0),
                audible=audible,
                driven=driven,
                length=position.length_m,
                tension=position.tension_n,
                mu=position.mu,
                rest_height=position.rest_height_m,
                line_output=position.output_rest,
                rest_output=rest,
                output_bound=bound,
                static_response=static,
                lift_output=lift,
                leverage=self._levers,
                kick_reach=reach,
                largest_leverage=lever,
                largest_shape=shape,
                settled=self._settled,
                settling=math.isqrt(settled.size),
                pressed=self._settled + settled.size,
                pressed_modes=0 if pressed is None else pressed[0].omega.size,
            )
        )
        self.leverage.append(position.leverage)
        self._levers += position.leverage.size
        self.settled += [settled, np.zeros(0) if pressed is None else pressed_numbers(*pressed)]
        self._settled += sum(each.size for each in self.settled[-2:])
        dt = 1.0 / (self.rate_hz * factor)
        # strings that swing with a body, over a board or by a law of their own are not advanced in blocks of one string
        alone = self.law == EXACT_HOLD and self.step == 0 and heard is None and not on_board
        single = self.single and alone and keeps_losses(position.sigma, dt)
        model = make_string(
            self.law,
            dt,
            StringModes(position.mu, position.omega, position.sigma),
            position.coef,
            StringContacts(position.shapes, position.eta, position.residual, position.layers, position.matrix),
            StringOutputs(weights, on_q=1, used=(1 - int(uses_q), int(uses_q) + int(uses_v), int(uses_q))),
            restitution=self.restitution,
            certified=self.law == EXACT_HOLD and c >= CERTIFY_FROM,
            q_rest=position.q_rest,
            step=self.step,
            single=single,
        )
        self.compiled.append(model)
        if pressed is not None and heard is not None:
            self.flights.append(self._pressed_flight(position.mu, pressed[0], *heard))
        elif factor == 1 or heard is not None:  # it flies on no bus of its own
            self.flights.append(model)
        else:
            self.flights.append(self._flight(position, model, factor, audible))

    def _flight(self, position: Position, model: StringModel, factor: int, audible: int) -> StringModel:
        """The model in flight: of the modes that are heard, a frame at a time, without contacts."""
        frame, mu = 1.0 / self.rate_hz, position.mu
        omega, sigma = position.omega[:audible], position.sigma[:audible]
        heard, outputs = padded(audible), model.outputs
        weights = outputs.weights[:, :heard] * response(self.rate_hz, factor, model.omega[:heard] / (2.0 * math.pi))
        coef = coefficients(EXACT_HOLD, omega, sigma, mu, frame)
        return make_string(
            EXACT_HOLD,
            frame,
            StringModes(mu, omega, sigma),
            coef,
            no_contacts(audible),
            StringOutputs(weights[:, :audible], on_q=1, used=(outputs.first, outputs.points, outputs.on_q)),
            single=bool(model.single.on),
        )

    def _audible(self, omega: np.ndarray) -> int:
        """How many of these modes the decimator does not stop, one at least."""
        return max(1, int(np.sum(omega < 2.0 * math.pi * STOPBAND_EDGE * self.rate_hz)))

    def _pressed(self, position: Position, body: Soundboard, line: int) -> tuple[PressedModes, int] | None:
        """Of a line of a body that presses at rest on one rigid point: its modes while it does, as far as the bridge drives
        them, and the number of the point; None of another one."""
        if position.layers.shape[1] > 0 or not position.q_rest.any():
            return None
        compliance = static_compliance(position.omega, position.mu, position.shapes, position.residual)
        force, status = static_forces(compliance, -position.eta, position.layers)
        points = np.flatnonzero(force > 0.0)
        if status != SOLVED or points.size != 1:
            return None
        point = int(points[0])
        end = (position.length_m, position.tension_n / position.length_m, float(position.leverage[point]))
        residual = float(position.residual[point, point])
        found = pressed_modes(
            position.omega, position.sigma, position.mu, position.shapes[point], residual, _ramp(position), end,
            float(force[point]),
        )  # fmt: skip
        audible = self._audible(found.omega)
        return found.first(_driven(found.omega[:audible], found.sigma[:audible], found.stiffness, body, line)), point

    def _pressed_flight(self, mu: float, pressed: PressedModes, body: Soundboard, line: int) -> StringModel:
        """The model of a string that flies while it presses (`pressed_flight`)."""
        frame, omega, sigma = 1.0 / self.rate_hz, pressed.omega, pressed.sigma
        weights = np.zeros((OUTPUTS, omega.size))
        weights[0] = np.abs(mu * pressed.ramp * omega**2) * body.heard(omega, line)
        coef = coefficients(EXACT_HOLD, omega, sigma, mu, frame)
        contacts, outputs = no_contacts(omega.size), StringOutputs(weights, on_q=1)
        return make_string(EXACT_HOLD, frame, StringModes(mu, omega, sigma), coef, contacts, outputs)


def _ramp(position: Position) -> np.ndarray:
    """c (N,) of a position's modes; lumped ones have none."""
    return np.append(ramp_moments(position.length_m, position.own), np.zeros(position.omega.size - position.own))


def _driven(omega: np.ndarray, sigma: np.ndarray, stiffness: float, body: Soundboard, line: int) -> int:
    """How many of a line's modes move where it rings by its bridge alone, one at least; others would not be heard."""
    felt = np.flatnonzero(body.felt(omega, sigma, stiffness, line) > UNFELT)
    return int(felt[-1]) + 1 if felt.size else 1


def _uses(preset: Preset) -> tuple[bool, bool]:
    """Whether the output is of the displacement, and of the velocity."""
    kind = preset.output.kind
    return kind not in ("velocity", "body"), kind in ("velocity", "pickup")


@threadpool_limits.wrap(limits=1, user_api="blas")
def build_bank(
    parts: Sequence[CompiledPart],
    channels: Sequence[int],
    program_map: np.ndarray,
    rate_hz: float,
    scheme: str,
    restitution: float,
    pitch: np.ndarray,
    bindings: Sequence[tuple],
    together: Collection[int] = (),
    single: bool = False,
) -> Built:
    """The Bank of these parts, part p played by MIDI channel channels[p].

    pitch     (128,) of every key as compiled, in semitones
    bindings  rows (controller, part, index, low, high)
    together  parts whose strings are one instrument; the others' strings are one each
    single    modes in float32 (`solver.single`) where they are advanced in blocks of exact-hold
    """
    lists = _Lists(rate_hz, law_of(scheme), step_of(scheme), restitution, span_quanta(parts), single)
    for p, (part, channel) in enumerate(zip(parts, channels, strict=True)):
        lists.part(part, channel, p in together)
    by_controller = sorted(bindings, key=lambda row: row[0])
    bound_rows = [
        record(layout.BINDING, part=part, index=index, curve=layout.PARAMETER_CURVES[index], low=low, high=high)
        for _, part, index, low, high in by_controller
    ]
    sizes = {
        "models": len(lists.models),
        "strings": len(lists.strings),
        "instruments": len(lists.instruments),
        "positions": len(lists.positions),
        "parts": len(parts),
        "buses": len(lists.buses),
        "bindings": len(bindings),
        "articulations": len(lists.articulations),
        "touches": len(lists.touches),
        "taps": sum(t.size for t in lists.taps),
        "leverage": sum(each.size for each in lists.leverage),
        "settled": sum(each.size for each in lists.settled),
    }
    bank = allocate(
        Bank,
        sizes,
        models=np.array(lists.models, layout.MODEL),
        strings=np.array(lists.strings, layout.STRING),
        instruments=np.array(lists.instruments, layout.INSTRUMENT),
        positions=np.array(lists.positions, layout.POSITION),
        parts=np.array(lists.parts, layout.PART),
        buses=np.array(lists.buses, layout.BUS),
        program_map=np.ascontiguousarray(program_map, dtype=np.int64),
        plays=np.array([[(of_channel == p).any() for p in range(len(parts))] for of_channel in program_map], np.int64),
        pitch=np.array(pitch, dtype=np.float64),
        bindings=np.array(bound_rows, layout.BINDING),
        articulations=np.array(lists.articulations, layout.ARTICULATION),
        touches=np.array(lists.touches, layout.TOUCH),
        bound=np.searchsorted([row[0] for row in by_controller], np.arange(129)).astype(np.int64),
    )
    np.concatenate([np.zeros(0), *lists.taps], out=bank.taps)
    np.concatenate([np.zeros(0), *lists.leverage], out=bank.leverage)
    np.concatenate([np.zeros(0), *lists.settled], out=bank.settled)
    return Built(bank, lists.compiled, lists.flights, lists.bodies, lists.boards, single, 1.0 / rate_hz)


def default_parameters(parts: Sequence[CompiledPart]) -> np.ndarray:
    """(parts, N_PARAMETERS) values of the live parameters as the presets have them."""
    out = np.zeros((len(parts), layout.N_PARAMETERS))
    for p, part in enumerate(parts):
        pluck = part.preset.pluck
        out[p] = (1.0, pluck.position, 1.0, pluck.width_mm, 1.0, 0.0, 1.0)
    return out


def span_quanta(parts: Sequence[CompiledPart]) -> int:
    """How many quanta are worked off in one go."""
    factor = max((string.factor for part in parts for string in part.strings), default=1)
    return max(1, min(SPAN, SPAN_STEPS // (QUANTUM * factor)))


def _end(offsets: np.ndarray, sizes: np.ndarray) -> int:
    """Length of what is laid out in pieces of these sizes."""
    return int((offsets + sizes).max(initial=0))


def _sizes(bank: Bank, span: int) -> dict[str, int]:
    """Extents of a State, a Stream, of Shared and a SpanWork, for spans of so many quanta."""
    strings, buses = bank.strings, bank.buses
    return {
        "strings": strings.size,
        "parts": bank.parts.size,
        "buses": buses.size,
        "instruments": bank.instruments.size,
        "bodies": int((bank.instruments["body"] >= 0).sum()),
        "fades": _end(strings["fade"], FADE * strings["factor"]),
        "string_rows": _end(strings["row"], span * QUANTUM * strings["factor"]),
        "lines": _end(buses["off"], buses["n_taps"] + span * QUANTUM * buses["factor"]),
        "phases": max((phase_space(int(factor), span * QUANTUM) for factor in buses["factor"]), default=0),
        "span": span,
        "frames": span * QUANTUM,
        "models": bank.models.size,
        "FADE": FADE,
        "RING": layout.RING,
        "N_PARAMETERS": layout.N_PARAMETERS,
        "PENDING_EVENTS": PENDING_EVENTS,
        "N_COUNTERS": layout.N_COUNTERS,
        "N_METERS": layout.N_METERS,
        "N_TASK": layout.N_TASK,
        "N_WORDS": N_WORDS,
    }


def new_sounding(bank: Bank) -> Sounding:
    """A Sounding of strings that nobody has played."""
    sounding = allocate(Sounding, {"strings": bank.strings.size})
    sounding.hands["glide_to"] = -1
    sounding.voices["articulation"] = bank.parts["first_articulation"][bank.strings["part"]]
    return sounding


def new_state(bank: Bank, parameters: np.ndarray) -> State:
    """A State in which every controller has its power-up value."""
    state = allocate(State, _sizes(bank, 0), parameters=parameters.copy())
    power_up(state.channels)
    part_state = state.part_state
    part_state["left"] = part_state["right"] = 1.0
    part_state["channel"] = bank.parts["channel"]
    return state


def new_stream(bank: Bank, span: int, effects: Mapping[str, np.ndarray]) -> Stream:
    """A Stream in which nothing sounds, for spans of so many quanta. effects: effect_numbers and effect_counts at rest."""
    stream = allocate(Stream, _sizes(bank, span) | {name: array.size for name, array in effects.items()})
    for name, array in effects.items():
        getattr(stream, name)[:] = array
    stream.quiet[:] = bank.buses["n_taps"]
    return stream


#: places of a model's tables in Shared.model_at
_VARIANTS = (layout.PLAIN, layout.ALTERED, layout.FLIGHT, layout.ALTERED_FLIGHT)


class Strings:
    """What changes of every string, and where the core finds it: as long as it plays, this must stay where it is.

    models         StringModel as compiled, by model
    states         Pool of StringState, by string
    coefficients   Pool of those of its own, by string
    """

    def __init__(self, built: Built) -> None:
        models, string_of_model = built.models, built.bank.models["string"]
        sizes = []
        for s in range(built.bank.strings.size):
            mine = np.flatnonzero(string_of_model == s)
            own = [models[m] for m in mine]
            most = (max(model.modes for model in own), max(model.contacts.size for model in own))
            heard = max(built.flights[m].rows.shape[1] for m in mine)
            sizes.append(state_sizes(*most, OUTPUTS) | {"heard": heard})
        self.states = Pool(StringState, sizes)
        self.coefficients = Pool(Coefficients, sizes)
        self.models = models
        self.built = built  # what the tables point to
        self.model_tables = np.zeros((len(models), len(_VARIANTS), words(StringModel)), np.int64)
        for m, s in enumerate(string_of_model):
            flight, own = built.flights[m], self.coefficients.items[s]
            variants = (models[m], _with_its_own(models[m], own), flight, _flight_of_its_own(flight, own))
            for variant, model in zip(_VARIANTS, variants, strict=True):
                self.model_tables[m, variant] = table(model)
        self.state_tables = [table(state) for state in self.states.items]
        single = [built.single and keeps_losses(model.sigma[: model.modes], built.frame_s) for model in models]
        self.bridges = Bridges(built.bank, built.bodies, single)
        self.boards = Boards(built.bank, built.boards)

    def point(self, shared: Shared) -> None:
        """Put the addresses where the core looks for them."""
        first, per_model = self.model_tables.ctypes.data, self.model_tables.strides
        for m in range(self.model_tables.shape[0]):
            shared.model_at[m] = [first + m * per_model[0] + variant * per_model[1] for variant in _VARIANTS]
        shared.string_at[:] = [each.ctypes.data for each in self.state_tables]
        self.bridges.point(shared)
        self.boards.point(shared)

    def arrays(self) -> dict[str, np.ndarray]:
        """All that changes, by name."""
        kinds = (("string", self.states), ("own", self.coefficients))
        pooled = {f"{kind}.{name}": array for kind, pool in kinds for name, array in pool.flat.items()}
        return pooled | self.bridges.arrays() | self.boards.arrays()

    def reset(self) -> None:
        """Nothing sounds."""
        for array in self.arrays().values():
            array[:] = np.zeros((), array.dtype)


def _with_its_own(model: StringModel, own: Coefficients) -> StringModel:
    """A model with coefficients of the string's own in the place of its own."""
    contacts, outputs = model.contacts, model.outputs
    matrix, lags = _as(contacts.matrix, own.matrix), _as(contacts.lags, own.lags)
    return model._replace(
        omega=_as(model.omega, own.omega),
        rows=_as(model.rows, own.rows),
        contacts=contacts._replace(matrix=matrix, lags=lags),
        outputs=outputs._replace(lags=_as(outputs.lags, own.out_lags)),
        single=_without_rows(model.single),
    )


def _flight_of_its_own(flight: StringModel, own: Coefficients) -> StringModel:
    """A string's flight with coefficients of its own."""
    return flight._replace(rows=_as(flight.rows, own.flight_rows), single=_without_rows(flight.single))


def _as(array: np.ndarray, own: np.ndarray) -> np.ndarray:
    """The numbers of a string's own that stand in the place of an array."""
    return own[: array.size].reshape(array.shape)


def _without_rows(single: SingleTables) -> SingleTables:
    """With rows that are made in each call, from those of the string's own."""
    return single._replace(rows=single.rows[:, :0])


def new_shared(bank: Bank, span: int, entries: tuple[int, int, int, int, int], strings: Strings) -> tuple[Shared, SpanWork]:
    """What asks and finds these strings, and work arrays for spans of so many quanta; `tasks.entries`."""
    sizes = _sizes(bank, span)
    shared = allocate(Shared, sizes)
    shared.task[[WORK_ON, STEP, TOGETHER, OFF_BOARD, STEP_TWO]] = entries
    strings.point(shared)
    return shared, allocate(SpanWork, sizes)


def new_scratch(bank: Bank) -> Scratch:
    """Work arrays for one thread."""
    models = bank.models
    most_rows = int((models["contacts"] * (1 + models["layered"])).max(initial=0))  # a layer and what is behind it
    factors = bank.strings["factor"]
    steps = QUANTUM * int(factors.max(initial=1))
    # what only presses or flies goes through several quanta at a time
    over_one = factors[models["string"][models["contacts"] <= 1]]
    steps = max(steps, min(CHECK_EVERY * QUANTUM * int(over_one.max(initial=1)), SPAN_STEPS))
    return make_scratch(most_rows, int(models["n"].max(initial=1)), OUTPUTS, steps)
