"""Gives a native engine states that nobody saved, under checksums that are right: each is refused, or does no harm.

    python tests/plugin/broken_sounds.py LIBRARY COUNT SEED [EVERY [FIRST]]

Words of a state are set to what is hostile; or it is filled with noise, or made of pieces of others. What the engine in
Python refuses is refused here too, with a sentence, and changes nothing; what that takes is taken, plays, and what comes is
finite. EVERY: Python, which takes longer than all else, is asked about so many of them only.
Prints what came of them as JSON. A process of its own: the number of the case is the last thing on stderr when it ends
otherwise.
"""

from __future__ import annotations

import collections
import faulthandler
import json
import struct
import sys
import tempfile
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np

from synth.engine import layout
from synth.engine.bank import default_parameters
from synth.engine.engine import Engine
from synth.engine.layout import State
from synth.engine.state_check import check_limits
from synth.engine.state_limits import Limit, limits_of
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, make_events
from synth.plugin import bankfile
from synth.plugin.addresses import CORE, Memory
from tests.engine.kit import BRIDGE, FREE, NECK, SHARED
from tests.plugin.native import Library, NativeEngine, Refused

RATE_HZ = 44100.0
PARTS = {"exact-hold": (FREE, BRIDGE, NECK, SHARED), "moreau-jean": (FREE, BRIDGE, NECK)}
#: a hundred cases that take longer hang [s]
PATIENCE_S = 600.0
#: of what an engine saves (c/core_state.c), the length of the head, and where in it the checksum of what follows is
_HEAD, _CHECKSUM = 80, 12
_INTEGERS = (-(2**63), 2**63 - 1, -100000, -1, 0, 1, 2, 3, 31, 32, 33, 63, 64, 65, 127, 128, 512, 10**6, 2**31, 2**53, 2**62)
_NUMBERS = (
    np.nan, -np.nan, np.inf, -np.inf, 0.0, -0.0, 1.0, -1.0, 0.5, 5e-324, 1e-310, 1e-300, 1e300, -1e300, 1e14, -1e14, 1e16,
    1e9, 96.0, -24.0, 1e-6,
)  # fmt: skip


class Places(NamedTuple):
    """Where an array of the state begins in it [bytes], and what it is."""

    at: int
    dtype: np.dtype
    size: int
    shape: tuple[int, ...]


class Twins:
    """An engine in Python and one of the library, of the same presets."""

    def __init__(self, library: Library, folder: Path, scheme: str) -> None:
        parts = PARTS[scheme]
        programs = np.full((16, 128), -1, np.int64)
        programs[:, : len(parts)] = np.arange(len(parts))
        self.python = Engine(parts, programs, scheme=scheme)
        self.python.prepare(RATE_HZ, 512)
        memory = Memory()
        self.begin, self.end = bankfile.add_engine(memory, self.python.memory)
        self.places = {
            name: Places(memory.place(array) - self.begin, array.dtype, array.size, array.shape)
            for name, array in self.python.memory.changing.items()
        }
        image = memory.image(bankfile.function_at)
        self.first = image.regions[CORE].stored.ljust(image.regions[CORE].size, b"\0")[self.begin : self.end]
        path = folder / f"{scheme}.jawari"
        path.write_bytes(bankfile.bank(parts, [RATE_HZ], scheme=scheme))
        self.bank = library.open_bank(path)
        self.native = self.bank.engine(RATE_HZ)
        self._limits: dict[int, list[Limit]] = {}

    def objection(self, state: bytes) -> str | None:
        """Why Python cannot go on from a state; None: it can."""
        arrays: dict[str, np.ndarray] = {}
        for name, (at, dtype, size, shape) in self.places.items():
            arrays[name] = np.frombuffer(state, np.uint8, size * dtype.itemsize, at).copy().view(dtype).reshape(shape)
        waiting = int(arrays["counters"][layout.PENDING])
        if not 0 <= waiting <= arrays["pending"].size:
            return "more events wait than there is room for"
        arrays["pending"] = arrays["pending"][:waiting]
        made = self.python
        if waiting not in self._limits:
            of_engine = made._prepared(), made.memory.settings, made._strings, arrays, default_parameters(made.compiled)
            self._limits[waiting] = list(limits_of(*of_engine, (waiting, waiting)))
        try:
            check_limits(self._limits[waiting], arrays)
        except ValueError as error:
            return str(error)
        return made._chains.problem(State(**{name: arrays[name] for name in State._fields}))

    def whole(self, saved: bytes) -> bytes:
        """All that sounds, of what an engine saved."""
        out, at, place = bytearray(self.first), _HEAD, 0
        while at < len(saved):
            skip, count = struct.unpack_from("<II", saved, at)
            place += skip
            out[8 * place : 8 * (place + count)] = saved[at + 8 : at + 8 + 8 * count]
            at, place = at + 8 + 8 * count, place + count
        return bytes(out)

    def sealed(self, like: bytes, state: bytes) -> bytes:
        """What an engine would have saved of a state; head as of another that it did save."""
        now, first = np.frombuffer(state, np.int64), np.frombuffer(self.first, np.int64)
        differs = np.flatnonzero(now != first)
        pieces, done = [], 0
        for run in np.split(differs, np.flatnonzero(np.diff(differs) > 1) + 1):
            if run.size:
                pieces.append(struct.pack("<II", int(run[0]) - done, run.size) + now[run[0] : run[-1] + 1].tobytes())
                done = int(run[-1]) + 1
        body = b"".join(pieces)
        head = like[_CHECKSUM + 4 : _HEAD - 8] + struct.pack("<Q", len(body))
        return like[:_CHECKSUM] + struct.pack("<I", zlib.crc32(head + body)) + head + body


def moments(native: NativeEngine) -> list[bytes]:
    """What is saved while everything is at work: silence, fingers, bends, contacts, flight, events that wait."""
    native.reset()
    kept = [native.save()]
    native.play([(3, NOTE_ON, 0, 48, 100), (9, NOTE_ON, 0, 50, 90)], 401)
    kept.append(native.save())
    native.play([(10, BEND, 0, 3000), (300, 5, 1, 1, 0), (3000, NOTE_ON, 1, 43, 80), (4000, NOTE_ON, 1, 48, 70)], 4100)
    kept.append(native.save())
    native.play([(10, CONTROL, 0, 64, 127), (11, NOTE_OFF, 0, 48), (30, BEND, 0, 0), (700, NOTE_OFF, 1, 43)], 30000)
    kept.append(native.save())
    native.play([(0, 5, 2, 2, 0), (1, NOTE_ON, 2, 40, 120), (90, NOTE_ON, 2, 45, 120), (199, NOTE_ON, 0, 48, 20)], 200)
    kept.append(native.save())
    native.play([(0, 5, 3, 3, 0), (1, NOTE_ON, 3, 43, 120), (700, NOTE_ON, 3, 48, 90), (770, NOTE_ON, 3, 44, 90)], 800)
    kept.append(native.save())
    native.play([(0, BEND, 3, 2000), (900, NOTE_OFF, 3, 43)], 3000)
    kept.append(native.save())
    native.process(make_events([(20, NOTE_ON, 0, 48, 127), (25, NOTE_ON, 2, 40, 127)]), 0)
    kept.append(native.save())
    return kept


def _hostile(rng: np.random.Generator, bits: int) -> int:
    """A word that may be anything, or a little beside what it was."""
    way = rng.random()
    if way < 0.35:
        return int(rng.choice(np.array(_INTEGERS, np.int64)))
    if way < 0.7:
        return int(np.array(rng.choice(_NUMBERS)).view(np.int64))
    if way < 0.85:
        return int(np.int64(np.uint64((bits + int(rng.choice([-1, 1, 2, -2, 32, -32]))) % 2**64)))
    if way < 0.95:
        old = np.array(bits, np.int64).view(np.float64)
        with np.errstate(all="ignore"):
            return int(np.array(old * rng.choice([-1.0, 2.0, 0.5, 1e3, 1e-3])).view(np.int64))
    return int(rng.integers(-(2**63), 2**63 - 1))


#: what is crowded with indices and counts
_CROWDED = (
    "sounding", "channels", "part_state", "counters", "zones", "effect_counts", "string.counts", "string.finger",
    "end.counts", "body.0.counts",
)  # fmt: skip


def forged(rng: np.random.Generator, twins: Twins, states: list[bytes]) -> tuple[str, bytes]:
    """(what was done, a state that nobody saved)."""
    state = states[int(rng.integers(len(states)))]
    words = np.frombuffer(state, np.int64).copy()
    way = rng.random()
    if way < 0.85:
        for _ in range(int(rng.choice([1, 1, 1, 2, 5]))):
            pick = rng.random()
            if pick < 0.6:
                names = [name for name in _CROWDED if name in twins.places] if pick < 0.3 else list(twins.places)
                place = twins.places[str(rng.choice(names))]
                bytes_of = place.size * place.dtype.itemsize
                if bytes_of < 8:
                    continue
                k = place.at // 8 + int(rng.integers(bytes_of // 8))
            else:
                k = int(rng.integers(words.size))
            words[k] = _hostile(rng, int(words[k]))
        return "words", words.tobytes()
    place = twins.places[str(rng.choice([name for name, at in twins.places.items() if at.dtype.kind == "f" and at.size]))]
    data = bytearray(state)
    if way < 0.93:
        noise = float(rng.choice([1e-9, 1e-3, 1.0, 1e3, 1e9, 1e14, 1e15])) * rng.uniform(-1.0, 1.0, place.size)
        data[place.at : place.at + noise.nbytes] = noise.tobytes()
        return "noise", bytes(data)
    place = twins.places[str(rng.choice(list(twins.places)))]
    end = place.at + place.size * place.dtype.itemsize
    data[place.at : end] = states[int(rng.integers(len(states)))][place.at : end]
    return "pieces", bytes(data)


def main(library: str, count: int, seed: int, every: int = 1, first: int = 0) -> None:
    rows = [(0, NOTE_ON, 0, 48, 100), (90, NOTE_OFF, 2, 40), (120, NOTE_ON, 1, 43, 90), (130, NOTE_ON, 3, 48, 90)]
    rows.append((300, CONTROL, 0, 120, 0))
    went_on = make_events(rows)
    counts: collections.Counter[str] = collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        loaded = Library(Path(library))
        pool: list[tuple[Twins, list[bytes], list[bytes]]] = []
        for scheme in ("exact-hold", "moreau-jean"):
            twins = Twins(loaded, Path(folder), scheme)
            saved = moments(twins.native)
            whole = [twins.whole(each) for each in saved]
            for one, each in zip(saved, whole, strict=True):
                assert twins.objection(each) is None
                twins.native.load(twins.sealed(one, each))
                assert twins.native.save() == one
            pool.append((twins, saved, whole))
        for number in range(first, first + count):
            rng = np.random.default_rng([seed, number])
            print(f"case {number}", end="\r", file=sys.stderr)
            if number % 100 == 0:  # a thread each time
                faulthandler.dump_traceback_later(PATIENCE_S, exit=True)
            twins, saved, whole = pool[int(rng.integers(len(pool)))]
            kind, state = forged(rng, twins, whole)
            data = twins.sealed(saved[0], state)
            refused = _tried(number, twins, data, went_on)
            if number % every == 0:
                objection = twins.objection(state)
                assert bool(refused) == bool(objection), f"case {number}: {kind}: here {refused}, Python {objection}"
                counts["compared"] += 1
            counts[f"{kind} {'refused' if refused else 'harmless'}"] += 1
    faulthandler.cancel_dump_traceback_later()
    print(json.dumps(dict(sorted(counts.items()))))


def _tried(number: int, twins: Twins, data: bytes, events: np.ndarray) -> str | None:
    """What the library says against a state; None: it takes it, and no harm came of it."""
    native = twins.native
    before = native.save() if number % 32 == 0 else b""
    try:
        native.load(data)
    except Refused as refusal:
        assert not before or native.save() == before, f"case {number}: refused, but something is changed"
        return str(refusal)
    heard = np.concatenate([native.process(events, 400), native.play([], 300, 64)])
    assert np.isfinite(heard).all(), f"case {number}: not finite"
    assert np.abs(heard[200:]).max() <= 1.0, f"case {number}: above full scale"
    return None


if __name__ == "__main__":
    faulthandler.enable()
    main(sys.argv[1], *(int(argument) for argument in sys.argv[2:]))
