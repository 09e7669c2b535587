"""What the engine's methods are given, looked at before compiled code works on it: numbers, presets, events, arrays."""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Sequence
from types import FunctionType
from typing import Any

import numpy as np

from synth.dsp.rates import MAXIMUM_RATE_HZ, MINIMUM_RATE_HZ
from synth.engine.numbers import a_number
from synth.instrument.effects import EffectTable
from synth.instrument.preset import Preset, load_preset
from synth.midi.events import (
    BEND,
    CONTROL,
    EVENT,
    KEY_PRESSURE,
    N_PARAMETERS,
    NOTE_OFF,
    NOTE_ON,
    PARAMETER,
    PRESSURE,
    PROGRAM,
    TUNING,
)
from synth.midi.zones import CHANNELS

#: type of every array that sound is written to
_DOUBLE = np.dtype(np.float64)
#: of the kinds with a channel: smallest and largest `a`, and `b`
_DATA, _ANY = (0, 127), (-(1 << 31), (1 << 31) - 1)
_RANGES = {
    NOTE_ON: (_DATA, _DATA),
    NOTE_OFF: (_DATA, _ANY),
    CONTROL: (_DATA, _DATA),
    BEND: ((-8192, 8191), _ANY),
    PROGRAM: (_DATA, _ANY),
    PRESSURE: (_ANY, _DATA),
    KEY_PRESSURE: (_DATA, _DATA),
}
_NAMES = {
    NOTE_ON: "NOTE_ON",
    NOTE_OFF: "NOTE_OFF",
    CONTROL: "CONTROL",
    BEND: "BEND",
    PROGRAM: "PROGRAM",
    PARAMETER: "PARAMETER",
    PRESSURE: "PRESSURE",
    KEY_PRESSURE: "KEY_PRESSURE",
    TUNING: "TUNING",
}


def rate(rate_hz: Any) -> float:
    """An output rate. Raises TypeError or ValueError."""
    try:
        return a_number("rate_hz", rate_hz, MINIMUM_RATE_HZ, MAXIMUM_RATE_HZ, " Hz")
    except ValueError as error:
        raise ValueError(f"{error}; 44100.0 is the usual one") from None


def presets(parts: Any) -> tuple[Preset, ...]:
    """The presets of an engine's parts, each itself, by name or by file. Raises TypeError, ValueError or OSError."""
    if isinstance(parts, Preset | str | os.PathLike) or not isinstance(parts, Sequence):
        raise TypeError(f"parts must be a list of presets, got {_shown(parts)}; wrap it in a list: [load_preset(…)]")
    if not parts:
        raise ValueError("parts must hold at least one preset, got none; give [load_preset(…)]")
    for p, part in enumerate(parts):
        if not isinstance(part, Preset | str | os.PathLike):
            raise TypeError(
                f"parts[{p}] must be a preset, its name or its file, got {_shown(part)}; load_preset(…) gives one"
            )
    return tuple(part if isinstance(part, Preset) else load_preset(part) for part in parts)


def program_map(given: Any, parts: int) -> np.ndarray:
    """(16, 128) part of each channel and program, −1 for none; of None: part p on channel p, the only part on all. Raises
    TypeError or ValueError."""
    if given is None:
        whole = np.full((CHANNELS, 128), 0 if parts == 1 else -1)
        if parts > 1:
            for p in range(min(CHANNELS, parts)):
                whole[p] = p
        return whole.astype(np.int64)
    array = np.asarray(given)
    if array.dtype.kind not in "iu":
        raise TypeError(f"program_map must hold whole numbers, got {array.dtype}; −1 stands for no part")
    if array.shape != (CHANNELS, 128):
        raise ValueError(f"program_map must be (16, 128), got {array.shape}")
    if array.min() < -1 or array.max() >= parts:
        wrong = array.min() if array.min() < -1 else array.max()
        raise ValueError(f"program_map must hold part numbers from 0 to {parts - 1}, or −1 for no part, got {wrong}")
    return array.astype(np.int64)


def a_function(name: str, given: Any) -> Any:
    """A plain function that is to be compiled. Raises TypeError."""
    if not isinstance(given, FunctionType):
        raise TypeError(f"{name} must be a plain Python function, so that the engine can compile it, got {_shown(given)}")
    return given


def effects(given: Any) -> tuple[EffectTable, ...]:
    """Effects of the mix. Raises TypeError."""
    if not isinstance(given, Sequence) or not all(isinstance(each, EffectTable) for each in given):
        raise TypeError(f"mix_effects must be a list of effect settings, got {_shown(given)}")
    return tuple(given)


def note_frequencies(note_hz: Any) -> np.ndarray | None:
    """(128,) frequencies [Hz] of the keys, or None. Raises TypeError or ValueError."""
    if note_hz is None:
        return None
    try:
        array = np.array(note_hz, np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"note_hz must be 128 frequencies, got {_shown(note_hz)}") from None
    if array.shape != (128,):
        raise ValueError(f"note_hz must be (128,), a frequency for every key, got {array.shape}; NaN leaves a key as it is")
    return array


def wanted_notes(only_notes: Any, parts: int) -> tuple[frozenset[int] | None, ...] | None:
    """Of each part the notes it will be asked for, or None. Raises TypeError or ValueError."""
    if only_notes is None:
        return None
    if not isinstance(only_notes, Sequence) or isinstance(only_notes, str):
        raise TypeError(f"only_notes must be a list of sets of notes, one for each part, got {_shown(only_notes)}")
    if len(only_notes) != parts:
        raise ValueError(f"only_notes must have a set for each of {parts} parts, got {len(only_notes)}")
    out: list[frozenset[int] | None] = []
    for p, notes in enumerate(only_notes):
        try:
            out.append(None if notes is None else frozenset(operator.index(note) for note in notes))
        except TypeError:
            raise TypeError(f"only_notes[{p}] must be a set of MIDI notes or None for all, got {_shown(notes)}") from None
    return tuple(out)


def events(given: Any, frames: int, parts: int) -> np.ndarray:
    """The events of a block of so many frames, as compiled code takes them. Raises TypeError or ValueError."""
    if not isinstance(given, np.ndarray) or given.dtype != EVENT:
        got = f"an array of {given.dtype}" if isinstance(given, np.ndarray) else _shown(given)
        raise TypeError(f"events must be an array of the type EVENT, got {got}; make_events(rows) makes one")
    if given.ndim != 1:
        raise ValueError(f"events must have one dimension, got the shape {given.shape}")
    _check_events(given.tolist(), frames, parts)
    if not (given.flags.c_contiguous and given.flags.writeable and given.flags.aligned):
        return given.copy()  # another type to compiled code
    return given


def _check_events(rows: list[tuple], frames: int, parts: int) -> None:
    """Frames, kinds, channels and numbers of the rows of an EVENT array, in plain Python: a call of numpy costs as much as
    several rows, and a block has few. Kind 0 is no event; TUNING takes every value, what is no pitch as the compiled one."""
    before = 0
    for i, (at, kind, channel, a, b, value) in enumerate(rows):
        if not 0 <= at <= frames:
            raise ValueError(
                f"events[{i}].frame must lie between 0 and the block's {frames} frames, got {at}; frames count from the "
                "start of the block"
            )
        if at < before:
            raise ValueError(f"events[{i}].frame is {at}, after {before}; sort events by frame")
        before = at
        if kind in _RANGES:
            of_a, of_b = _RANGES[kind]
            _check_number(i, kind, "channel", channel, 0, CHANNELS - 1)
            _check_number(i, kind, "a", a, *of_a)
            _check_number(i, kind, "b", b, *of_b)
        elif kind == PARAMETER:
            if not math.isfinite(value):
                raise ValueError(f"events[{i}].value of PARAMETER must be finite, got {value}")
            _check_number(i, kind, "channel", channel, 0, parts - 1)
            _check_number(i, kind, "a", a, 0, N_PARAMETERS - 1)
        elif kind == TUNING:
            _check_number(i, kind, "a", a, *_DATA)
        elif kind != 0:
            raise ValueError(
                f"events[{i}].kind must be one of {', '.join(f'{k} {n}' for k, n in _NAMES.items())}, got {kind}"
            )


def _check_number(i: int, kind: int, field: str, given: int, low: int, high: int) -> None:
    if not low <= given <= high:
        what = " (the part)" if kind == PARAMETER and field == "channel" else ""
        raise ValueError(f"events[{i}].{field}{what} of {_NAMES[kind]} must lie between {low} and {high}, got {given}")


def output(name: str, given: Any, shape: tuple[int | None, ...], shown: str) -> np.ndarray:
    """An array that compiled code writes to: contiguous float64 of a shape, None for any length. Raises TypeError or
    ValueError."""
    if not isinstance(given, np.ndarray):
        raise TypeError(f"{name} must be a {shown} float64 array, got {_shown(given)}")
    have = given.shape
    fits = len(have) == len(shape) and have[1:] == shape[1:] and shape[0] in (None, have[0]) and given.dtype == _DOUBLE
    if fits and given.flags.carray:  # contiguous, aligned, and may be written
        return given
    if not fits or not given.flags.c_contiguous or not given.flags.aligned:
        order = "" if given.flags.c_contiguous else ", not contiguous"
        raise ValueError(f"{name} must be a contiguous {shown} float64 array, got {given.shape} {given.dtype}{order}")
    raise ValueError(f"{name} must be an array that can be written to, got one that is read-only; give a copy of it")


def _shown(value: Any) -> str:
    text = repr(value)
    return f"{text[:40]}… ({type(value).__name__})" if len(text) > 40 else f"{text} ({type(value).__name__})"
