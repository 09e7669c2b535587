"""Gives engines states that are not as they were: each must be refused with ValueError, or do no harm.

    python tests/engine/broken_states.py COUNT SEED [FIRST]

Some are changed as a disk or a network would (bytes, length), most as somebody would who knows the format and computes the
checksum anew: single numbers, several at once, whole arrays. No harm means that the engine then plays some blocks, finite
ones, in a few seconds, and that its own state is untouched where it refuses. Prints what came of them as JSON. A process of
its own: the number of the case is in the last line of stderr when it ends otherwise.
"""

from __future__ import annotations

import collections
import faulthandler
import json
import sys
from typing import Any

import numpy as np

from synth.engine import snapshot
from synth.engine.engine import Engine
from synth.instrument.preset import Preset, load_preset
from synth.midi.events import BEND, CONTROL, NOTE_OFF, NOTE_ON, make_events
from tests.engine.kit import SHARED

RATE_HZ = 44100.0
#: a case that takes longer hangs [s]
PATIENCE_S = 600.0
_NASTY_INTEGERS = (-(2**63), 2**63 - 1, -1, 0, 1, 2, 3, 7, 31, 32, 63, 64, 65, 128, 512, 10**6, 2**31, 2**53, -2, -(2**40))
_NASTY_NUMBERS = (
    np.nan, np.inf, -np.inf, 0.0, -0.0, 1.0, -1.0, 0.5, 1e-300, 5e-324, 1e300, -1e300, 1e14, -1e14, 1e15, 1e9, 96.0, 24.0,
    -24.0, 1e-6, 1e3,
)  # fmt: skip


def band(scheme: str, first: Preset | None = None, program_map: Any = None) -> Engine:
    """A tanpura string or two, or another preset, and a bass, prepared."""
    made = Engine(
        [first or load_preset("tanpura-light"), load_preset("fretted-bass")],
        quality="draft",
        scheme=scheme,
        only_notes=[{43, 48}, {28, 33, 35, 40}],
        every_fret=False,
        warn=lambda text: None,
    )
    made.prepare(RATE_HZ, 512)
    return made


def play(made: Engine, rows: list[tuple], frames: int) -> np.ndarray:
    """(2 + 2 · parts, frames) mix and stems of the next frames, in blocks of 200."""
    rows = sorted(rows, key=lambda row: row[0])
    out = np.zeros((frames, 2))
    stems = []
    for start in range(0, frames, 200):
        end = min(frames, start + 200)
        block = np.zeros((len(made.parts), end - start, 2))
        here = [(row[0] - start, *row[1:]) for row in rows if start <= row[0] < end]
        made.process(make_events(here), out[start:end], block)
        stems.append(block)
    return np.concatenate([out.T, np.concatenate(stems, axis=1).transpose(0, 2, 1).reshape(-1, frames)])


def moments(made: Engine) -> list[bytes]:
    """States in which everything is at work: silence, fingers, bends, contacts, flight, stolen strings, events that wait."""
    made.reset()
    kept = [made.get_state()]
    play(made, [(3, NOTE_ON, 0, 48, 100), (9, NOTE_ON, 0, 43, 90), (20, NOTE_ON, 1, 28, 110)], 401)
    kept.append(made.get_state())
    play(made, [(10, BEND, 0, 3000), (3000, NOTE_ON, 1, 33, 80), (4000, NOTE_ON, 1, 35, 70)], 4100)
    kept.append(made.get_state())
    play(made, [(10, CONTROL, 0, 64, 127), (11, NOTE_OFF, 0, 48), (30, BEND, 0, 0), (700, NOTE_OFF, 1, 28)], 30000)
    kept.append(made.get_state())
    play(made, [(0, NOTE_ON, 1, 40, 120), (5, CONTROL, 0, 11, 100), (199, NOTE_ON, 0, 48, 20)], 200)
    kept.append(made.get_state())
    play(made, [(20000, NOTE_ON, 1, 28, 127)], 60000)
    kept.append(made.get_state())
    return kept


def places(made: Engine, waiting: int) -> dict[str, tuple[int, int, np.dtype]]:
    """Of every array: where it begins in the bytes, how many elements it has, of which type."""
    out, at = {}, snapshot._HEAD
    for name, array in made.memory.changing.items():
        size = waiting if name == "pending" else array.size
        out[name] = (at, size, array.dtype)
        at += size * array.dtype.itemsize
    return out


def seal(data: bytearray) -> bytes:
    """The bytes with a checksum that is right."""
    body = bytes(data[: -snapshot._DIGEST])
    return body + snapshot._digest(body)


def _one_number(rng: np.random.Generator, data: bytearray, at: int, dtype: np.dtype) -> None:
    old = np.frombuffer(bytes(data[at : at + dtype.itemsize]), dtype)[0]
    if dtype.kind == "f":
        choices = [rng.choice(_NASTY_NUMBERS), old * rng.choice([-1.0, 2.0, 0.5, 1e3, 1e-3]), rng.normal()]
        new = np.array(choices[rng.integers(3)], np.float64)
    elif dtype.itemsize == 8:
        step = int(rng.choice([-1, 1, 32, -32, 1 << int(rng.integers(62))]))
        choices = [int(rng.choice(_NASTY_INTEGERS)), int(old) + step, int(rng.integers(0, 8))]
        new = np.array(((choices[rng.integers(3)] + 2**63) % 2**64) - 2**63, np.int64)
    else:
        new = np.array(rng.integers(0, 1 << 8 * dtype.itemsize), np.uint64).astype(dtype)
    data[at : at + dtype.itemsize] = new.astype(dtype).tobytes()


def _change_numbers(rng: np.random.Generator, data: bytearray, where: dict[str, tuple[int, int, np.dtype]]) -> str:
    filled = [name for name, (_, size, _) in where.items() if size]
    crowded = ["sounding", "sounding", "sounding", "channels", "part_state", "counters", "pending", "effect_counts"]
    crowded.append("end.counts")
    names = []
    for _ in range(int(rng.choice([1, 1, 1, 2, 5]))):
        name = str(rng.choice([n for n in crowded if n in filled] if rng.random() < 0.5 else filled))
        at, size, dtype = where[name]
        place = at + int(rng.integers(size)) * dtype.itemsize
        if dtype.names:
            field = str(rng.choice(dtype.names))
            inner, offset = dtype.fields[field][:2]
            _one_number(rng, data, place + offset, inner)
            names.append(f"{name}.{field}")
        else:
            _one_number(rng, data, place, dtype)
            names.append(name)
    return "numbers"


def _fill_array(rng: np.random.Generator, data: bytearray, where: dict[str, tuple[int, int, np.dtype]]) -> str:
    names = [name for name, (_, size, dtype) in where.items() if size and dtype.kind == "f"]
    at, size, dtype = where[str(rng.choice(names))]
    scale = float(rng.choice([1e-9, 1e-3, 1.0, 1e3, 1e9, 1e14, 1e15]))
    data[at : at + size * dtype.itemsize] = (scale * rng.uniform(-1.0, 1.0, size)).tobytes()
    return "array"


def broken(rng: np.random.Generator, state: bytes, where: dict[str, tuple[int, int, np.dtype]]) -> tuple[str, bytes]:
    """(what was done, the state with something wrong)."""
    data = bytearray(state)
    way = rng.random()
    if way < 0.15:
        for _ in range(int(rng.integers(1, 9))):
            data[int(rng.integers(len(data)))] ^= int(rng.integers(1, 256))
        return "bytes", bytes(data)
    if way < 0.2:
        cut = int(rng.integers(len(data)))
        return "length", bytes(data[:cut]) if rng.random() < 0.7 else bytes(data) + bytes(data[:cut])
    if way < 0.25:  # the head, with its checksum
        data[int(rng.integers(snapshot._HEAD))] ^= int(rng.integers(1, 256))
        return "head", seal(data)
    if way < 0.9:
        return _change_numbers(rng, data, where), seal(data)
    return _fill_array(rng, data, where), seal(data)


def main(count: int, seed: int, first: int = 0) -> None:
    engines = [band("exact-hold"), band("moreau-jean"), band("exact-hold", SHARED)]
    states = [[(made, state) for state in moments(made)] for made in engines]
    pool = [each for of_engine in states for each in of_engine]
    counts: collections.Counter[str] = collections.Counter()
    went_on = [(0, NOTE_ON, 0, 48, 100), (90, NOTE_OFF, 0, 43), (120, NOTE_ON, 1, 33, 90), (300, CONTROL, 0, 120, 0)]
    for made in engines:
        _from_silence(made, went_on)
    for number in range(first, first + count):
        rng = np.random.default_rng([seed, number])
        print(f"case {number}", end="\r", file=sys.stderr)
        faulthandler.dump_traceback_later(PATIENCE_S, exit=True)
        made, state = pool[int(rng.integers(len(pool)))]
        waiting = int.from_bytes(state[snapshot._HEAD - 8 : snapshot._HEAD], "little")
        kind, data = broken(rng, state, places(made, waiting))
        looked_at = number % 32 == 0
        before = made.get_state() if looked_at else b""
        try:
            made.set_state(data)
        except ValueError:
            counts[f"{kind} refused"] += 1
            assert not looked_at or made.get_state() == before, f"case {number}: refused, but something is changed"
            continue
        silenced = made.report().silenced
        heard = play(made, went_on, 700)
        assert np.isfinite(heard).all(), f"case {number}: {kind}: not finite"
        assert np.abs(heard[:2]).max() <= 1.0, f"case {number}: {kind}: above full scale"
        for array in made.memory.changing.values():
            if array.dtype.kind == "f":
                assert np.isfinite(array).all(), f"case {number}: {kind}: something stays that is not finite"
        counts[f"{kind} harmless"] += 1
        counts["silenced"] += int(made.report().silenced > silenced)
        if looked_at:
            made.set_state(made.get_state())
        if rng.random() < 0.005:  # nothing of it stays
            made.reset()
            assert np.array_equal(play(made, went_on, 700), _from_silence(made, went_on)), f"case {number}: stays"
    faulthandler.cancel_dump_traceback_later()
    print(json.dumps(dict(sorted(counts.items()))))


_KNOWN: dict[int, np.ndarray] = {}


def _from_silence(made: Engine, rows: list[tuple]) -> np.ndarray:
    """What an engine gives from silence on, as it did at first."""
    if id(made) not in _KNOWN:
        made.reset()
        _KNOWN[id(made)] = play(made, rows, 700)
    return _KNOWN[id(made)]


if __name__ == "__main__":
    faulthandler.enable()
    main(*(int(argument) for argument in sys.argv[1:]))
