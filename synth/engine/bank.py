"""Lay compiled parts out as the flat arrays of `layout`."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from synth.compile import CompiledPart, Position
from synth.dsp.body import body_coefficients
from synth.dsp.decimator import STOPBAND_EDGE, design, phase_space, response, split_taps
from synth.dsp.limiter import LOOKAHEAD, WINDOW, limiter_state
from synth.engine import layout
from synth.engine.layout import FADE, QUANTUM, RESPONSE, SPAN, SPAN_STEPS, STEP, WORK_ON, Bank, Scratch, Shared, State
from synth.engine.team import N_WORDS
from synth.native.arrays import allocate, record, whole_lines
from synth.preset import at_note
from synth.solver.blocks import make_lags, make_rows, padded_rows
from synth.solver.lanes import BLOCK, ROWS, padded
from synth.solver.laws import EXACT_HOLD, coefficients
from synth.units import db_to_gain

PENDING_EVENTS = 1 << 14


@threadpool_limits.wrap(limits=1, user_api="blas")
def build_bank(
    parts: Sequence[CompiledPart],
    channels: Sequence[int],
    program_map: np.ndarray,
    rate_hz: float,
    law: int,
    pitch: np.ndarray,
    bindings: Sequence[tuple],
) -> Bank:
    """The Bank of these parts, part p played by MIDI channel channels[p].

    pitch     (128,) of every key as compiled, in semitones
    bindings  rows (controller, part, index, low, high)
    """
    models: list[tuple] = []
    strings: list[tuple] = []
    positions: list[tuple] = []
    part_rows: list[tuple] = []
    buses: list[tuple] = []
    flat: defaultdict[str, list[np.ndarray]] = defaultdict(list)
    bodies: list[np.ndarray] = []
    taps: list[np.ndarray] = []
    tap_places: dict[int, tuple[int, int]] = {}
    off = soff = coff = goff = 0
    s_off = s_coff = s_goff = 0
    line = row = fade = 0
    body_off = 0
    span = span_quanta(parts)
    for p, part in enumerate(parts):
        preset = part.preset
        first_position, first_bus = len(positions), len(buses)
        bus_of: dict[int, int] = {}
        for string in part.strings:
            for factor in (string.factor, 1):
                if factor not in bus_of:
                    if factor not in tap_places:
                        linear = design(rate_hz, factor)
                        tap_places[factor] = (sum(t.size for t in taps), linear.size)
                        taps.append(np.empty_like(linear))
                        split_taps(linear, factor, taps[-1])
                    place, size = tap_places[factor]
                    bus_of[factor] = len(buses)
                    buses.append(record(layout.BUS, part=p, factor=factor, taps=place, n_taps=size, off=line))
                    line += whole_lines(size + span * QUANTUM * factor)
            factor = string.factor
            index = len(strings)
            cap = padded(max(position.omega.size for position in string.positions))
            cmax = max(position.eta.size for position in string.positions)
            strings.append(
                record(
                    layout.STRING,
                    part=p,
                    bus=bus_of[factor],
                    factor=factor,
                    cap=cap,
                    off=s_off,
                    coff=s_coff,
                    cmax=cmax,
                    goff=s_goff,
                    positions=string.places,
                    open_length=string.open_length_m,
                    pluck_force=string.pluck_force_n,
                    impedance=string.impedance_kg_s,
                    draw_s=string.draw_s,
                    release_s=string.release_s,
                    row=row,
                    direct_bus=bus_of[1] if factor > 1 else -1,
                    direct=len(strings) * span * QUANTUM,
                    fade=fade,
                    pressure_height=1e-6 * at_note(preset.mapping.pressure_um, string.open_note),
                )
            )
            row += whole_lines(span * QUANTUM * factor)
            fade += FADE * factor
            s_off += cap
            s_coff += whole_lines(cmax)
            s_goff += cmax * cmax
            for position in string.positions:
                n, c = position.omega.size, position.eta.size
                n_cap = padded(n)
                place_of = {"part": p, "string": index, "note": position.note, "fret": position.fret, "model": len(models)}
                positions.append(record(layout.POSITION, **place_of))
                bound = math.sqrt(float(np.sum((position.wq / position.omega) ** 2)))
                if preset.output.kind in ("velocity", "pickup"):
                    bound = math.sqrt(float(np.sum(position.wv**2)))
                static = lift = 0.0
                if c:
                    bent = position.shapes[0] / (position.mu * position.omega**2)
                    static = float(position.shapes[0] @ bent + position.residual[0, 0])
                    lift = float(position.wq @ bent)
                stopband = 2.0 * math.pi * STOPBAND_EDGE * rate_hz
                models.append(
                    record(
                        layout.MODEL,
                        n=n,
                        own=position.own,
                        contacts=c,
                        audible=max(1, int(np.sum(position.omega[: position.own] < stopband))),
                        cap=n_cap,
                        off=off,
                        soff=soff,
                        coff=coff,
                        goff=goff,
                        length=position.length_m,
                        tension=position.tension_n,
                        mu=position.mu,
                        rest_height=position.rest_height_m,
                        line_output=position.output_rest,
                        rest_output=float(position.wq @ position.q_rest),
                        output_bound=bound,
                        static_response=static,
                        lift_output=lift,
                    )
                )
                off, soff, coff, goff = off + n_cap, soff + n_cap * c, coff + c, goff + c * c
                for name, array in _model_arrays(position, law, rate_hz, string.factor).items():
                    flat[name].append(array.ravel())
        pluck, output = preset.pluck, preset.output
        n_body = len(preset.body.resonance)
        if n_body:
            bodies.append(
                body_coefficients(
                    [r.frequency_hz for r in preset.body.resonance],
                    [r.q for r in preset.body.resonance],
                    [r.gain_db for r in preset.body.resonance],
                    rate_hz,
                )
            )
        part_rows.append(
            record(
                layout.PART,
                channel=channels[p],
                first_position=first_position,
                end_position=len(positions),
                first_bus=first_bus,
                end_bus=len(buses),
                ring_on=int(preset.damping.ring_on),
                use_q=int(output.kind != "velocity"),
                use_v=int(output.kind in ("velocity", "pickup")),
                pickup_distance=1e-3 * output.distance_mm,
                velocity_exponent=pluck.velocity_exponent,
                position_shift=pluck.hardest_position - pluck.position,
                width_ratio=pluck.hardest_width_mm / pluck.width_mm,
                finger_stiffness=1e3 * pluck.finger_stiffness_n_mm,
                finger_loss=pluck.finger_loss,
                direct=db_to_gain(preset.body.direct_db),
                body_off=body_off,
                body_n=n_body,
                pressure_bend=1e-2 * preset.mapping.pressure_cents,
            )
        )
        body_off += n_body

    by_controller = sorted(bindings, key=lambda row: row[0])
    bound_rows = [
        record(layout.BINDING, part=part, index=index, curve=layout.PARAMETER_CURVES[index], low=low, high=high)
        for _, part, index, low, high in by_controller
    ]
    sizes = {
        "models": len(models),
        "strings": len(strings),
        "positions": len(positions),
        "parts": len(parts),
        "buses": len(buses),
        "bindings": len(bindings),
        "model_modes": off,
        "model_shapes": soff,
        "model_contacts": coff,
        "model_squares": goff,
        "taps": sum(t.size for t in taps),
        "resonances": body_off,
        "ROWS": ROWS,
        "RESPONSE": RESPONSE,
    }
    bank = allocate(
        Bank,
        sizes,
        models=np.array(models, layout.MODEL),
        strings=np.array(strings, layout.STRING),
        positions=np.array(positions, layout.POSITION),
        parts=np.array(part_rows, layout.PART),
        buses=np.array(buses, layout.BUS),
        program_map=np.ascontiguousarray(program_map, dtype=np.int64),
        plays=np.array([[(of_channel == p).any() for p in range(len(parts))] for of_channel in program_map], np.int64),
        pitch=np.array(pitch, dtype=np.float64),
        bindings=np.array(bound_rows, layout.BINDING),
        bound=np.searchsorted([row[0] for row in by_controller], np.arange(129)).astype(np.int64),
        body=np.concatenate(bodies, axis=1) if bodies else np.zeros((3, 0)),
    )
    for name, pieces in (*flat.items(), ("taps", taps)):
        np.concatenate([np.zeros(0), *pieces], out=getattr(bank, name))
    return bank


def default_parameters(parts: Sequence[CompiledPart]) -> np.ndarray:
    """(parts, N_PARAMETERS) values of the live parameters as the presets have them."""
    out = np.zeros((len(parts), layout.N_PARAMETERS))
    for p, part in enumerate(parts):
        pluck = part.preset.pluck
        out[p] = (1.0, pluck.position, 1.0, pluck.width_mm, 1.0, 0.0)
    return out


def _model_arrays(position: Position, law: int, rate_hz: float, factor: int) -> dict[str, np.ndarray]:
    """A model's arrays of the Bank."""
    n = padded(position.omega.size)
    rows = make_rows(position.coef)
    shapes = padded_rows(position.shapes, n)
    weights = padded_rows(np.array([position.wq, position.wv]), n)
    omega = padded_rows(position.omega, n)
    omega[position.omega.size :] = 1.0  # divided by
    lags = make_lags(law != EXACT_HOLD, rows, shapes, shapes, position.matrix)
    out_lags = np.concatenate([make_lags(k == 1, rows, shapes, weights[k : k + 1]) for k in range(2)])
    return {
        "omega": omega,
        "sigma": padded_rows(position.sigma, n),
        "rows": rows,
        "flight": make_rows(coefficients(EXACT_HOLD, position.omega, position.sigma, position.mu, 1.0 / rate_hz)),
        "shapes": shapes,
        "eta": position.eta,
        "residual": position.residual,
        "matrix": position.matrix,
        "lags": lags,
        "out_lags": out_lags,
        "weights": weights,
        "direct_weights": weights * response(rate_hz, factor, omega / (2.0 * math.pi)),
        "q_rest": padded_rows(position.q_rest, n),
    }


def span_quanta(parts: Sequence[CompiledPart]) -> int:
    """How many quanta are worked off in one go."""
    factor = max((string.factor for part in parts for string in part.strings), default=1)
    return max(1, min(SPAN, SPAN_STEPS // (QUANTUM * factor)))


def _end(offsets: np.ndarray, sizes: np.ndarray) -> int:
    """Length of what is laid out in pieces of these sizes."""
    return int((offsets + sizes).max(initial=0))


def _state_sizes(bank: Bank, span: int) -> dict[str, int]:
    """Extents of a State and of Shared, for spans of so many quanta."""
    strings, buses = bank.strings, bank.buses
    return {
        "strings": strings.size,
        "parts": bank.parts.size,
        "buses": buses.size,
        "modes": int(strings["cap"].sum()),
        "contacts": _end(strings["coff"], strings["cmax"]),
        "squares": int((strings["cmax"] ** 2).sum()),
        "fades": _end(strings["fade"], FADE * strings["factor"]),
        "string_rows": _end(strings["row"], span * QUANTUM * strings["factor"]),
        "lines": _end(buses["off"], buses["n_taps"] + span * QUANTUM * buses["factor"]),
        "phases": max((phase_space(int(factor), span * QUANTUM) for factor in buses["factor"]), default=0),
        "resonances": max(1, bank.body.shape[1]),
        "span": span,
        "frames": span * QUANTUM,
        "ROWS": ROWS,
        "RESPONSE": RESPONSE,
        "FADE": FADE,
        "RING": layout.RING,
        "LOOKAHEAD": LOOKAHEAD,
        "WINDOW": WINDOW,
        "N_PARAMETERS": layout.N_PARAMETERS,
        "PENDING_EVENTS": PENDING_EVENTS,
        "N_COUNTERS": layout.N_COUNTERS,
        "N_METERS": layout.N_METERS,
        "N_TASK": layout.N_TASK,
        "N_WORDS": N_WORDS,
    }


def new_state(bank: Bank, span: int, parameters: np.ndarray) -> State:
    """A State in which nothing sounds and every controller has its power-up value, for spans of so many quanta."""
    limiter = limiter_state(2)
    state = allocate(
        State,
        _state_sizes(bank, span),
        parameters=parameters.copy(),
        delay=limiter.delay,
        required=limiter.required,
        released=limiter.released,
        limiter_counters=limiter.counters,
        limiter_levels=limiter.levels,
    )
    channels, part_state = state.channels, state.part_state
    channels["volume"] = channels["expression"] = 1.0
    channels["bend_range"] = 2.0
    channels["rpn"] = 0x3FFF
    channels["timbre"] = 64
    channels["master"] = np.arange(16)
    part_state["left"] = part_state["right"] = 1.0
    part_state["channel"] = bank.parts["channel"]
    state.quiet[:] = bank.buses["n_taps"]
    return state


def new_shared(bank: Bank, span: int, entries: tuple[int, int]) -> Shared:
    """Work arrays for spans of so many quanta; `advance.entries`."""
    shared = allocate(Shared, _state_sizes(bank, span))
    shared.task[WORK_ON], shared.task[STEP] = entries
    return shared


def new_scratch(bank: Bank) -> Scratch:
    """Work arrays for one thread."""
    sizes = {
        "widest": max(1, int(bank.models["contacts"].max(initial=0))),
        "widest_modes": max(1, int(bank.strings["cap"].max(initial=1))),
        "steps": QUANTUM * int(bank.strings["factor"].max(initial=1)),
        "BLOCK": BLOCK,
    }
    return allocate(Scratch, sizes)
