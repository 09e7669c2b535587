"""A State as bytes: what `Engine.get_state` gives and `set_state` takes.

    bytes  what
    8      MAGIC
    4      VERSION, little-endian, as all numbers
    16     what the state belongs to: presets, rate, settings and the layout of the arrays (`origin_of`)
    8      events that wait
    …      every array that changes, in its order (State, then the strings'), of `pending` only the events that wait
    16     BLAKE2b of all this

Nothing in it is parsed but two numbers: all sizes are those of the engine that the state is for. A state is thus refused
before any of it is looked at, unless it is as it was written. That does not make it one that an engine can go on from:
`state_check` sees to that.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from synth.engine.bank import Built
from synth.engine.layout import Settings, State
from synth.native.arrays import fields
from synth.solver.coupling import Coupling, End
from synth.solver.stringmodel import Coefficients, StringState

MAGIC = b"jawarist"
#: of the bytes, and of what the numbers mean
VERSION = 3
_ORIGIN = 16
_DIGEST = 16
_HEAD = len(MAGIC) + 4 + _ORIGIN + 8
#: what earlier versions wrote was a ZIP archive
_EARLIER = b"PK\x03\x04"
#: as many events may wait in a state, 64 MB of them
MOST_EVENTS = 1 << 21


def origin_of(built: Built, settings: Settings, kinds: bytes) -> bytes:
    """(16 bytes) what tells banks, models, settings, `kinds` of law, effects and excitations, and layouts apart."""
    arrays = [
        (name, str(dtype), len(shape))
        for kind in (State, StringState, Coefficients, End, Coupling)
        for name, (dtype, shape) in fields(kind).items()
    ]
    digest = hashlib.blake2b(repr((settings, kinds, arrays, sys.byteorder)).encode(), digest_size=_ORIGIN)
    everything: list[Any] = [built.bank, *built.models]  # flights follow from the models and the rate
    for shared in built.bodies:
        digest.update(repr(shared.instrument).encode())
        for value in vars(shared.body).values():
            digest.update(np.asarray(value).tobytes())
    for each in everything:
        for name, value in each._asdict().items():
            if name == "step":  # an address
                value = int(value != 0)
            digest.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    return digest.digest()


def pack(arrays: Mapping[str, np.ndarray], waiting: int, origin: bytes) -> bytes:
    """The bytes of all that changes, by name; so many events wait in `pending`; `origin` from `origin_of`."""
    pieces = [MAGIC, VERSION.to_bytes(4, "little"), origin, waiting.to_bytes(8, "little")]
    for name, array in arrays.items():
        pieces.append((array[:waiting] if name == "pending" else array).tobytes())
    data = b"".join(pieces)
    return data + _digest(data)


def unpack(data: bytes, like: Mapping[str, np.ndarray], origin: bytes) -> dict[str, np.ndarray]:
    """Arrays of their own with what `data` holds, of the sizes of `like`; of `pending` the events that wait.

    Raises ValueError for bytes that are no state, were changed, or come from another version, bank or setting; TypeError
    for what is not bytes.
    """
    if not isinstance(data, bytes | bytearray | memoryview):
        raise TypeError(f"a state is the bytes that get_state gives, got {type(data).__name__}")
    data = bytes(data)
    if data[: len(_EARLIER)] == _EARLIER:
        raise ValueError("the state was saved by an earlier version; play up to the same point and save it again")
    if len(data) < _HEAD + _DIGEST or data[: len(MAGIC)] != MAGIC:
        raise ValueError(f"not a state of this engine: {len(data)} bytes that get_state did not write")
    version = int.from_bytes(data[len(MAGIC) : len(MAGIC) + 4], "little")
    if data[-_DIGEST:] != _digest(data[:-_DIGEST]):
        raise ValueError(
            "not a state of this engine: its checksum is wrong, as the data were truncated or altered; save it again"
        )
    if version != VERSION:
        raise ValueError(f"the state has version {version}, this program reads {VERSION}; save it again")
    if data[len(MAGIC) + 4 : len(MAGIC) + 4 + _ORIGIN] != origin:
        raise ValueError("the state comes from other presets, rate or quality; prepare the engine in the same way")
    waiting = int.from_bytes(data[_HEAD - 8 : _HEAD], "little")
    if waiting > MOST_EVENTS:
        raise ValueError(
            f"not a state of this engine: it holds {waiting} pending events, and at most {MOST_EVENTS} are possible"
        )
    shapes = {name: (waiting,) if name == "pending" else array.shape for name, array in like.items()}
    sizes = {name: int(np.prod(shape)) * like[name].dtype.itemsize for name, shape in shapes.items()}
    wanted = _HEAD + sum(sizes.values()) + _DIGEST
    if len(data) != wanted:
        raise ValueError(f"not a state of this engine: it has {len(data)} bytes, {wanted} are needed")
    arrays, at = {}, _HEAD
    for name, shape in shapes.items():
        piece = np.frombuffer(data, np.uint8, sizes[name], at)
        arrays[name] = piece.copy().view(like[name].dtype).reshape(shape)
        at += sizes[name]
    return arrays


def _digest(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=_DIGEST).digest()
