"""Lay compiled parts out as the flat arrays of `layout`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from synth.compile import CompiledPart, Position
from synth.dsp.body import body_coefficients
from synth.dsp.decimator import STOPBAND_EDGE, design, phase_space, response, split_taps
from synth.dsp.limiter import limiter_state
from synth.engine import layout
from synth.engine.events import EVENT
from synth.engine.layout import (
    FADE,
    LINE,
    LINE_F8,
    N_TASK,
    QUANTUM,
    RESPONSE,
    SPAN,
    SPAN_STEPS,
    STEP,
    WORK_ON,
    Bank,
    Scratch,
    Shared,
    State,
)
from synth.engine.team import N_WORDS
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
    flat: dict[str, list[np.ndarray]] = {
        name: []
        for name in (
            "omega",
            "sigma",
            "rows",
            "flight",
            "shapes",
            "eta",
            "residual",
            "matrix",
            "lags",
            "out_lags",
            "weights",
            "direct_weights",
            "q_rest",
        )
    }
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
                    buses.append((p, factor, place, size, line))
                    line += _padded(size + span * QUANTUM * factor)
            factor = string.factor
            index = len(strings)
            cap = padded(max(position.omega.size for position in string.positions))
            cmax = max(position.eta.size for position in string.positions)
            strings.append(
                (
                    p,
                    bus_of[factor],
                    factor,
                    cap,
                    s_off,
                    s_coff,
                    cmax,
                    s_goff,
                    string.places,
                    string.open_length_m,
                    string.pluck_force_n,
                    string.impedance_kg_s,
                    string.draw_s,
                    string.release_s,
                    row,
                    bus_of[1] if factor > 1 else -1,
                    len(strings) * span * QUANTUM,
                    fade,
                    1e-6 * at_note(preset.mapping.pressure_um, string.open_note),
                )
            )
            row += _padded(span * QUANTUM * factor)
            fade += FADE * factor
            s_off += cap
            s_coff += _padded(cmax)
            s_goff += cmax * cmax
            for position in string.positions:
                n, c = position.omega.size, position.eta.size
                n_cap = padded(n)
                positions.append((p, index, position.note, position.fret, len(models)))
                bound = math.sqrt(float(np.sum((position.wq / position.omega) ** 2)))
                if preset.output.kind in ("velocity", "pickup"):
                    bound = math.sqrt(float(np.sum(position.wv**2)))
                static = lift = 0.0
                if c:
                    bent = position.shapes[0] / (position.mu * position.omega**2)
                    static = float(position.shapes[0] @ bent + position.residual[0, 0])
                    lift = float(position.wq @ bent)
                models.append(
                    (
                        n,
                        position.own,
                        c,
                        max(1, int(np.sum(position.omega[: position.own] < 2.0 * math.pi * STOPBAND_EDGE * rate_hz))),
                        n_cap,
                        off,
                        soff,
                        coff,
                        goff,
                        position.length_m,
                        position.tension_n,
                        position.mu,
                        position.rest_height_m,
                        position.output_rest,
                        float(position.wq @ position.q_rest),
                        bound,
                        static,
                        lift,
                    )
                )
                off, soff, coff, goff = off + n_cap, soff + n_cap * c, coff + c, goff + c * c
                for name, array in _model_arrays(position, law, rate_hz, string.factor).items():
                    flat[name].append(array.ravel())
        pluck, output = preset.pluck, preset.output
        hard = pluck.position if pluck.position_hard is None else pluck.position_hard
        width_hard = pluck.width_mm if pluck.width_hard_mm is None else pluck.width_hard_mm
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
            (
                channels[p],
                first_position,
                len(positions),
                first_bus,
                len(buses),
                int(preset.damping.ring_on),
                int(output.kind != "velocity"),
                int(output.kind in ("velocity", "pickup")),
                1e-3 * output.distance_mm,
                pluck.velocity_exponent,
                hard - pluck.position,
                width_hard / pluck.width_mm,
                1e3 * pluck.finger_stiffness_n_mm,
                pluck.finger_loss,
                db_to_gain(preset.body.direct_db),
                body_off,
                n_body,
                1e-2 * preset.mapping.pressure_cents,
            )
        )
        body_off += n_body

    def join(arrays: list[np.ndarray]) -> np.ndarray:
        whole = aligned(sum(array.size for array in arrays))
        np.concatenate([np.zeros(0), *arrays], out=whole)
        return whole

    by_controller = sorted(bindings, key=lambda row: row[0])
    rows = [(part, index, layout.PARAMETER_CURVES[index], low, high) for _, part, index, low, high in by_controller]
    return Bank(
        np.array(models, layout.MODEL),
        np.array(strings, layout.STRING),
        np.array(positions, layout.POSITION),
        np.array(part_rows, layout.PART),
        np.array(buses, layout.BUS),
        np.ascontiguousarray(program_map, dtype=np.int64),
        np.array([[(of_channel == p).any() for p in range(len(parts))] for of_channel in program_map], np.int64),
        np.array(pitch, dtype=np.float64),
        np.array(rows, layout.BINDING),
        np.searchsorted([row[0] for row in by_controller], np.arange(129)).astype(np.int64),
        **{name: join(arrays) for name, arrays in flat.items()},
        taps=join(taps),
        body=np.concatenate(bodies, axis=1) if bodies else np.zeros((3, 0)),
    )


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


def _padded(count: int) -> int:
    """The next multiple of a cache line's numbers."""
    return -(-count // LINE_F8) * LINE_F8


def aligned(shape: int | tuple[int, ...], dtype: Any = np.float64) -> np.ndarray:
    """Zeros that begin on a cache line."""
    kind = np.dtype(dtype)
    count = int(np.prod(shape))
    memory = np.zeros(count * kind.itemsize + LINE, np.uint8)
    start = -memory.ctypes.data % LINE
    return memory[start : start + count * kind.itemsize].view(kind).reshape(shape)


def span_quanta(parts: Sequence[CompiledPart]) -> int:
    """How many quanta are worked off in one go."""
    factor = max((string.factor for part in parts for string in part.strings), default=1)
    return max(1, min(SPAN, SPAN_STEPS // (QUANTUM * factor)))


def _end(offsets: np.ndarray, sizes: np.ndarray) -> int:
    """Length of what is laid out in pieces of these sizes."""
    return int((offsets + sizes).max(initial=0))


def new_state(bank: Bank, span: int, parameters: np.ndarray) -> State:
    """A State in which nothing sounds and every controller has its power-up value, for spans of so many quanta."""
    n_strings, n_parts = bank.strings.size, bank.parts.size
    modes = int(bank.strings["cap"].sum())
    contacts = _end(bank.strings["coff"], bank.strings["cmax"])
    squares = int((bank.strings["cmax"] ** 2).sum())
    channels = aligned(16, layout.CHANNEL)
    channels["volume"] = channels["expression"] = 1.0
    channels["bend_range"] = 2.0
    channels["rpn"] = 0x3FFF
    channels["timbre"] = 64
    channels["master"] = np.arange(16)
    part_state = aligned(n_parts, layout.PART_STATE)
    part_state["left"] = part_state["right"] = 1.0
    part_state["channel"] = bank.parts["channel"]
    quiet = aligned(bank.buses.size, np.int64)
    quiet[:] = bank.buses["n_taps"]
    limiter = limiter_state(2)
    return State(
        aligned(n_strings, layout.SOUNDING),
        channels,
        part_state,
        parameters.copy(),
        aligned(128),
        aligned(2, np.int64),
        aligned(modes),
        aligned(modes),
        aligned(modes),
        aligned(ROWS * modes),
        aligned(squares),
        aligned(RESPONSE * squares),
        aligned(2 * RESPONSE * contacts),
        aligned(contacts),
        aligned(contacts),
        aligned(contacts),
        aligned(contacts),
        aligned(contacts, np.uint8),
        aligned(contacts, np.int64),
        aligned(contacts),
        aligned((contacts, 3)),
        aligned(contacts, np.int64),
        aligned(n_strings, np.int64),
        aligned(n_strings, np.int64),
        aligned(_end(bank.strings["fade"], FADE * bank.strings["factor"])),
        aligned((n_strings, FADE)),
        aligned(modes),
        aligned(contacts),
        aligned(RESPONSE * contacts),
        aligned((n_strings, 3, RESPONSE)),
        aligned(contacts),
        aligned((n_strings, 2)),
        aligned(PENDING_EVENTS, EVENT),
        aligned((n_parts + 1, 128), np.int64),
        aligned(layout.N_COUNTERS, np.int64),
        aligned(layout.N_METERS),
        aligned(_end(bank.buses["off"], bank.buses["n_taps"] + span * QUANTUM * bank.buses["factor"])),
        quiet,
        aligned((3, max(1, bank.body.shape[1]))),
        aligned((layout.RING, 2)),
        aligned((n_parts, layout.RING, 2)),
        *limiter,
    )


def new_shared(bank: Bank, span: int, entries: tuple[int, int]) -> Shared:
    """Work arrays for spans of so many quanta; `advance.entries`."""
    task = aligned(N_TASK, np.int64)
    task[WORK_ON], task[STEP] = entries
    frames = span * QUANTUM
    return Shared(
        task,
        aligned(bank.strings.size, np.int64),
        aligned(N_WORDS, np.int64),
        aligned(_end(bank.strings["row"], frames * bank.strings["factor"])),
        aligned(bank.strings.size * frames),
        aligned((span, 16)),
        aligned((span, bank.parts.size)),
        aligned(frames),
        aligned(frames),
        aligned(max((phase_space(int(factor), frames) for factor in bank.buses["factor"]), default=0)),
        aligned((frames, 2)),
    )


def new_scratch(bank: Bank) -> Scratch:
    """Work arrays for one thread."""
    widest = max(1, int(bank.models["contacts"].max(initial=0)))
    modes = max(1, int(bank.strings["cap"].max(initial=1)))
    steps = QUANTUM * int(bank.strings["factor"].max(initial=1))
    return Scratch(
        aligned(steps + 1),
        aligned(2 * steps),
        aligned(modes),
        aligned(modes),
        aligned(modes),
        aligned(modes),
        aligned((steps, widest)),
        aligned(widest),
        aligned(widest),
        aligned(widest),
        aligned((widest, widest)),
        aligned((widest, widest)),
        aligned(widest, np.int64),
        aligned(widest, np.uint8),
        aligned(widest, np.uint8),
        aligned(widest, np.uint8),
        aligned((3, BLOCK)),
        aligned((widest + 1) * BLOCK),
        aligned((widest + 1) * BLOCK),
        aligned(widest * widest),
        aligned(3 * modes),
        aligned(widest, np.int64),
    )
