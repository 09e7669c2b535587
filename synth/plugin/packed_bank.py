"""Packed banks: what a web page loads; c/bank_unpack.c makes the bank of it again, bit for bit.

    data, laid = bankfile.laid_out([load_preset("sitar")], [48000.0])
    packed = pack(data, models_of(laid))              # what a server then sends compressed (brotli, gzip)
    unpack(packed) == data

Tables that follow from others by a formula (`packed_models`, `predicted`) are stored as what they differ by, in units of the
last place: mostly by nothing. All else, the rest, is stored as it is. Tables that are sums over modes depend on the order in
which the compiler's vectors took them; `level` makes another bank, as good to the ear, in which they are what the
formula says, and what no formula gives is rounded: packed it is half as large.

    header      PACKED
    streams     per kind the codes, a byte per number, then what follows the codes
    rest        bytes

Numbers of float64 are taken as integers that rise as they do (`_ordered`). A number's difference to what was predicted, or
its n-th difference along the table, is folded to 0, −1, 1, −2 … → 0, 1, 2, 3 …; below FIRST_LONG that is the code. Otherwise
the code says from which byte on, the lowest being 0, it is not zero, and how many bytes follow.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np

from synth.plugin import predicted
from synth.plugin.addresses import RELOCATION
from synth.plugin.bankfile import HEADER, RATE, Laid
from synth.plugin.droning import SCORE, STROKE
from synth.plugin.packed_models import (
    FILTERED,
    HEARD,
    MODEL,
    NUMBERS,
    SMOOTH,
    STRING,
    STRING_INTEGERS,
    TABLES,
    Models,
    models_of,
)
from synth.solver.block_rows import BLOCK, ROWS

MAGIC = b"JAWARIPK"
VERSION = 1
#: kinds of streams: integers and numbers of the tables that say what there is, one of each table that is made
KINDS = ("integers", "numbers", *TABLES)
#: of an area of the rest: where it begins, behind the one before, its size [bytes], how many words a row has; 0: as it is
AREA = ("gap", "size", "words")
PACKED = np.dtype(
    [
        ("magic", "S8"),
        ("version", "<u4"),
        ("checksum", "<u4"),  # CRC-32 of the bank
        ("unpacked", "<u8"),
        ("size", "<u8"),
        ("models", "<u4"),
        ("strings", "<u4"),
        ("nuts", "<u4"),
        ("taps", "<u4"),
        ("places", "<u4"),
        ("areas", "<u4"),
        ("streams", "<u8", (len(KINDS), 2)),
        ("rest", "<u8"),
    ]
)
FIRST_LONG = 200
#: (first byte, bytes) of a long code
_LONG = [(first, count) for first in range(8) for count in range(1, 9 - first)]
#: bits of mantissas that `level` keeps: of levels, of lumped modes' shapes and residual compliances; and what it leaves as
#: it is: numbers that differ from the formula by more than this share of the greatest in their table
_LEVEL_BITS, _LUMPED_BITS = 12, 28
_NEAR = 2.0**-24
#: tables that `level` sets to the formula
_SUMS = ("contacts.matrix", "contacts.lags", "outputs.weights", "single.rows", "single.shapes", "single.weights")
#: bytes that a hole in the rest must have
_LEAST_HOLE = 64


def for_pages(data: bytes, laid: list[Laid]) -> bytes:
    """What a page loads of a bank (`bankfile.laid_out`): levelled and packed."""
    models = models_of(laid)
    return pack(level(data, models), models)


def pack(data: bytes, models: Models) -> bytes:
    """A bank packed: exactly this bank, whatever the models say of it."""
    image, writer = np.frombuffer(data, np.uint8).copy(), _Writer()
    for count, table in _tables(models):
        writer.columns(table, count)
    areas = _areas(image, models)
    writer.columns(np.array(areas, np.int64).reshape(-1, len(AREA)), len(areas))
    rest, at = [], 0
    for gap, size, words in areas:
        at += gap
        some = image[at : at + size]
        if words:
            writer.columns(some.view(np.int64).reshape(-1, words), size // (8 * words))
        else:
            rest.append(some.tobytes())
        at += size
    for _ in _walk(models, image, writer):
        pass
    header = np.zeros(1, PACKED)
    streams = writer.streams()
    held = b"".join(each for pair in streams for each in pair) + b"".join(rest)
    header["magic"], header["version"], header["checksum"] = MAGIC, VERSION, zlib.crc32(data)
    header["unpacked"], header["size"] = len(data), PACKED.itemsize + len(held)
    counts = (len(models.models), len(models.strings), len(models.nuts), models.taps.size, models.places.size, len(areas))
    for name, count in zip(("models", "strings", "nuts", "taps", "places", "areas"), counts, strict=True):
        header[name] = count
    header["streams"] = [[[len(each) for each in pair] for pair in streams]]
    header["rest"] = sum(map(len, rest))
    return header.tobytes() + held


def unpack(packed: bytes) -> bytes:
    """The bank: what c/bank_unpack.c does, for tests. It trusts what it is given but for the checksum (ValueError)."""
    header = np.frombuffer(packed, PACKED, 1)[0]
    if header["magic"] != MAGIC or header["version"] != VERSION or header["size"] != len(packed):
        raise ValueError("this is no packed bank")
    reader = _Reader(packed, header["streams"], PACKED.itemsize)
    counts = [int(header[name]) for name in ("models", "strings", "nuts", "taps", "places", "areas")]
    integers = reader.integers(counts[0], len(MODEL))
    numbers = reader.numbers(counts[0], len(NUMBERS))
    string_integers = reader.integers(counts[1], len(STRING_INTEGERS))
    strings = reader.numbers(counts[1], len(STRING))
    nuts = reader.numbers(counts[2], 3)
    taps, places = (reader.numbers(count, 1).reshape(-1) for count in counts[3:5])
    models = Models(_placed(integers, numbers, True), numbers, string_integers, strings, nuts, taps, places)
    image, at, rest = np.zeros(int(header["unpacked"]), np.uint8), 0, len(packed) - int(header["rest"])
    for gap, size, words in reader.integers(counts[5], len(AREA)).tolist():
        at += gap
        if words:
            image[at : at + size] = reader.integers(size // (8 * words), words).reshape(-1).view(np.uint8)
        else:
            image[at : at + size] = np.frombuffer(packed, np.uint8, size, rest)
            rest += size
        at += size
    for _ in _walk(models, image, reader):
        pass
    if zlib.crc32(image.tobytes()) != header["checksum"]:
        raise ValueError("this packed bank was changed (the checksum is wrong)")
    return image.tobytes()


def level(data: bytes, models: Models) -> bytes:
    """The bank with its sums over modes as the formulas say them, lumped modes' shapes and what is behind them rounded to 28
    bits, and the levels by which strings of a body are put to sleep to 12, as how a drone's strokes vary; its checksums are
    right."""
    image = np.frombuffer(data, np.uint8).copy()
    for _ in _walk(models, image, _Leveller()):
        pass
    header = image[: HEADER.itemsize].view(HEADER)
    if score := int(header["drone_at"][0]):
        strokes = int(image[score : score + SCORE.itemsize].view(SCORE)["strokes"][0]) * STROKE.itemsize
        end = score + int(header["drone"][0])
        varied = image[end - strokes : end].view(np.float64)
        varied[:] = _rounded(varied, _LEVEL_BITS)
    first, count = int(header["rates_at"][0]), int(header["rates"][0])
    rows = image[first : first + count * RATE.itemsize].view(RATE)
    for row in rows:
        at = int(row["at"])
        row["checksum"] = zlib.crc32(image[at : at + int(row["size"])].tobytes())
    header["checksum"] = 0
    header["checksum"] = zlib.crc32(image[: int(header["tables_end"][0])].tobytes())
    return image.tobytes()


class _Coder(Protocol):
    """What is done with a table of numbers: called with the kind, the numbers as the image has them, what is predicted
    (None: zeros) and the order of differences, it answers with what they are."""

    def __call__(self, kind: int, held: np.ndarray, guess: np.ndarray | None, order: int) -> np.ndarray: ...


class _Writer:
    """Streams of differences as they are written."""

    def __init__(self) -> None:
        self._codes: list[list[bytes]] = [[] for _ in KINDS]
        self._more: list[list[bytes]] = [[] for _ in KINDS]

    def __call__(self, kind: int, held: np.ndarray, guess: np.ndarray | None, order: int) -> np.ndarray:
        numbers = _ordered(held)
        if guess is not None:
            numbers = numbers - _ordered(guess.astype(held.dtype))
        self._put(kind, numbers.reshape(-1), order)
        return held

    def columns(self, table: np.ndarray, rows: int) -> None:
        """Columns of a table (rows, ·), each by its differences from row to row."""
        whole = table.dtype.kind == "i"
        for column in table.reshape(rows, -1).T if rows else ():
            self._put(0 if whole else 1, column if whole else _ordered(np.ascontiguousarray(column)), 1)

    def _put(self, kind: int, numbers: np.ndarray, order: int) -> None:
        for _ in range(order):
            numbers = np.diff(numbers, prepend=np.int64(0))
        folded = ((numbers << 1) ^ (numbers >> 63)).astype(np.int64).view(np.uint64)
        long = np.flatnonzero(folded >= FIRST_LONG)
        codes = np.minimum(folded, FIRST_LONG).astype(np.uint8)
        parts = folded[long].view(np.uint8).reshape(-1, 8)
        used = parts != 0
        first, last = used.argmax(axis=1), 7 - used[:, ::-1].argmax(axis=1)
        codes[long] = [FIRST_LONG + _LONG.index((int(a), int(b - a + 1))) for a, b in zip(first, last, strict=True)]
        place = np.arange(8)
        self._codes[kind].append(codes.tobytes())
        self._more[kind].append(parts[(place >= first[:, None]) & (place <= last[:, None])].tobytes())

    def streams(self) -> list[tuple[bytes, bytes]]:
        return [(b"".join(codes), b"".join(more)) for codes, more in zip(self._codes, self._more, strict=True)]


class _Reader:
    """Streams of differences as they are read."""

    def __init__(self, packed: bytes, sizes: np.ndarray, at: int) -> None:
        self._packed, self._at = np.frombuffer(packed, np.uint8), []
        for codes, more in sizes.tolist():
            self._at.append([at, at + codes])
            at += codes + more

    def __call__(self, kind: int, held: np.ndarray, guess: np.ndarray | None, order: int) -> np.ndarray:
        numbers = self._get(kind, held.size, order).reshape(held.shape)
        if guess is not None:
            numbers = numbers + _ordered(guess.astype(held.dtype))
        return _from_ordered(numbers, held.dtype)

    def integers(self, rows: int, columns: int) -> np.ndarray:
        """(rows, columns)"""
        return np.array([self._get(0, rows, 1) for _ in range(columns)], np.int64).reshape(columns, rows).T.copy()

    def numbers(self, rows: int, columns: int) -> np.ndarray:
        """(rows, columns)"""
        held = np.array([self._get(1, rows, 1) for _ in range(columns)], np.int64).reshape(columns, rows)
        return _from_ordered(held, np.dtype(np.float64)).T.copy()

    def _get(self, kind: int, count: int, order: int) -> np.ndarray:
        at, more = self._at[kind]
        codes = self._packed[at : at + count]
        folded = codes.astype(np.uint64)
        for k in np.flatnonzero(codes >= FIRST_LONG):
            first, size = _LONG[codes[k] - FIRST_LONG]
            folded[k] = int.from_bytes(self._packed[more : more + size].tobytes(), "little") << 8 * first
            more += size
        self._at[kind] = [at + count, more]
        numbers = (folded >> np.uint64(1)).view(np.int64) ^ -(folded & np.uint64(1)).view(np.int64)
        for _ in range(order):
            numbers = np.cumsum(numbers)
        return numbers


class _Leveller:
    """Rounds what no formula gives, and sets sums to what is predicted."""

    def __call__(self, kind: int, held: np.ndarray, guess: np.ndarray | None, order: int) -> np.ndarray:
        name = KINDS[kind]
        if order == 3:
            return _rounded(held, _LEVEL_BITS)
        if guess is None:
            return _rounded_up(held)
        if name == "outputs.lags":  # of levels nobody asks what forces do to them
            return guess
        if name == "contacts.shapes":
            return np.where(guess == 0.0, _rounded(held, _LUMPED_BITS), held)
        if name not in _SUMS:
            return held
        near = np.abs(held - guess) <= _NEAR * np.abs(held).max(initial=0.0)
        return np.where(near, guess, held)


def _rounded_up(lower: np.ndarray) -> np.ndarray:
    """The lower triangle of a symmetric matrix, rounded so that what is added to the matrix has no negative eigenvalue."""
    size = (math.isqrt(8 * lower.size + 1) - 1) // 2
    row, column = np.tril_indices(size)
    out = _rounded(lower, _LUMPED_BITS)
    apart = np.zeros((size, size))
    apart[row, column] = apart[column, row] = np.abs(out - lower)
    np.fill_diagonal(apart, 0.0)
    own = row == column
    out[own] = _rounded((lower[own] + apart.sum(axis=1)) * (1.0 + 2.0**-_LUMPED_BITS), _LUMPED_BITS)
    return out


def _rounded(numbers: np.ndarray, bits: int) -> np.ndarray:
    """The nearest numbers with so many bits behind the first."""
    words = np.ascontiguousarray(numbers).view(np.int64)
    unit = np.int64(1 << 52 - bits)
    return ((words + unit // 2) & -unit).view(np.float64)


def _ordered(numbers: np.ndarray) -> np.ndarray:
    """int64 that rise as float64 or float32 numbers do."""
    if numbers.dtype == np.float32:
        short = np.ascontiguousarray(numbers).view(np.int32)
        return (short ^ ((short >> 31) & 0x7FFFFFFF)).astype(np.int64)
    words = np.ascontiguousarray(numbers).view(np.int64)
    return words ^ ((words >> 63) & 0x7FFFFFFFFFFFFFFF)


def _from_ordered(words: np.ndarray, kind: np.dtype) -> np.ndarray:
    if kind == np.float32:
        short = words.astype(np.int32)
        return (short ^ ((short >> 31) & 0x7FFFFFFF)).view(np.float32)
    return (words ^ ((words >> 63) & 0x7FFFFFFFFFFFFFFF)).view(np.float64)


def _tables(models: Models) -> Iterator[tuple[int, np.ndarray]]:
    """What is said of the models, as it is written."""
    yield len(models.models), _placed(models.models, models.numbers, False)
    yield len(models.models), models.numbers
    yield len(models.strings), models.string_integers
    yield len(models.strings), models.strings
    yield len(models.nuts), models.nuts
    yield models.taps.size, models.taps
    yield models.places.size, models.places


def _placed(models: np.ndarray, numbers: np.ndarray, reading: bool) -> np.ndarray:
    """Where tables lie, as written: a table that is made from where the one made before it ends, another from its base's."""
    out = models.copy()
    known = out if reading else models
    at = 0
    for row in range(len(models)):
        sizes = extents(known[row])
        base, makes = int(known[row, MODEL.index("base")]), int(known[row, MODEL.index("makes")])
        for k, name in enumerate(TABLES):
            column = MODEL.index(name)
            made = makes >> k & 1
            origin = at if made else int(known[base, column]) if base < row else 0
            out[row, column] = models[row, column] + (origin if reading else -origin)
            if made:
                at = int(known[row, column]) + -(-sizes[name] // 64) * 64
    return out


def extents(model: np.ndarray) -> dict[str, int]:
    """Bytes of each of TABLES of a model (MODEL,)."""
    m = dict(zip(MODEL, model.tolist(), strict=True))
    n, c, lagged, singles = 8 * m["size"], m["contacts"], m["lagged"], 4 * m["singles"]
    return {
        "omega": n,
        "sigma": n,
        "contacts.residual": 8 * c * c,
        "contacts.shapes": c * n,
        "rows": ROWS * n,
        "outputs.weights": 2 * n,
        "contacts.matrix": 8 * c * c,
        "contacts.lags": 16 * BLOCK * lagged * lagged,
        "outputs.lags": 32 * BLOCK * lagged,
        "single.rows": ROWS * singles,
        "single.shapes": c * singles,
        "single.weights": 2 * singles,
    }


def _areas(image: np.ndarray, models: Models) -> list[tuple[int, int, int]]:
    """What is no table that is made: AREA each."""
    made = [(0, 0), (image.size, image.size)]
    for model in models.models:
        m = dict(zip(MODEL, model.tolist(), strict=True))
        made += [(m[name], m[name] + size) for k, (name, size) in enumerate(extents(model).items()) if m["makes"] >> k & 1]
    made.sort()
    header = image[: HEADER.itemsize].view(HEADER)[0]
    rates = image[int(header["rates_at"]) :][: int(header["rates"]) * RATE.itemsize].view(RATE)
    rows: list[tuple[int, int, int]] = []
    for rate in rates:
        begin = int(rate["at"]) + int(rate["relocations_at"])
        rows.append((begin, begin + RELOCATION.itemsize * int(rate["relocations"]), RELOCATION.itemsize // 8))
    rows.sort()
    out, last = [], 0

    def put(begin: int, end: int, words: int) -> None:
        nonlocal last
        if end > begin:
            out.append((begin - last, end - begin, words))
            last = end

    for (_, begin), (end, _) in pairwise(made):
        for first, behind, words in rows:
            if begin <= first and behind <= end:
                put(begin, first, 0)
                put(first, behind, words)
                begin = behind
        if end - begin >= _LEAST_HOLE or image[begin:end].any():
            put(begin, end, 0)
    return out


class _Row(NamedTuple):
    """A model while its tables are made."""

    m: dict[str, int]
    number: dict[str, float]
    image: np.ndarray

    def table(self, name: str, shape: tuple[int, ...], kind: type = np.float64) -> np.ndarray:
        size = int(np.prod(shape)) * np.dtype(kind).itemsize
        at = self.m[name]
        return self.image[at : at + size].view(kind).reshape(shape)


def _walk(models: Models, image: np.ndarray, coder: _Coder) -> Iterator[int]:
    """Every table that is made, through the coder, in order. Yields the models' numbers."""
    place = 0
    for number, (integers, numbers) in enumerate(zip(models.models, models.numbers, strict=True)):
        m = dict(zip(MODEL, integers.tolist(), strict=True))
        row = _Row(m, dict(zip(NUMBERS, numbers.tolist(), strict=True)), image)
        makes = {name for k, name in enumerate(TABLES) if m["makes"] >> k & 1}
        _frequencies(models, row, makes, coder)
        n, c = m["size"], m["contacts"]
        if "contacts.residual" in makes:
            _symmetric(KINDS.index("contacts.residual"), row.table("contacts.residual", (c, c)), None, coder)
        if "contacts.shapes" in makes:
            _shapes(models, row, place, coder)
            place += c
        if "rows" in makes:
            _rows(row, coder)
        if "outputs.weights" in makes:
            _weights(models, row, coder)
        if "contacts.matrix" in makes:
            guess = np.zeros((c, c))
            gain = row.table("rows", (ROWS, n))[5 if m["velocity"] else 4]
            predicted.contact_matrix(
                gain, row.table("contacts.shapes", (c, n)), row.table("contacts.residual", (c, c)), guess
            )
            _symmetric(KINDS.index("contacts.matrix"), row.table("contacts.matrix", (c, c)), guess, coder)
        if "contacts.lags" in makes:
            _lags(row, coder)
        if "outputs.lags" in makes:
            _out_lags(row, coder)
        for name, source, rows in (
            ("single.rows", "rows", ROWS),
            ("single.shapes", "contacts.shapes", c),
            ("single.weights", "outputs.weights", 2),
        ):
            if name in makes:
                held, guess = row.table(name, (rows, m["singles"]), np.float32), np.zeros((rows, m["singles"]))
                guess[:, :n] = row.table(source, (rows, n))
                if name == "single.rows":
                    guess[[8, 11], :n] -= 1.0
                    guess[[8, 11], n:] = 0.0
                held[...] = coder(KINDS.index(name), held, guess, 0)
        yield number


def _frequencies(models: Models, row: _Row, makes: set[str], coder: _Coder) -> None:
    m, string = row.m, row.m["string"]
    linear, first, count = models.string_integers[string].tolist()
    omega, sigma = np.zeros(m["size"]), np.zeros(m["size"])
    omega[m["modes"] :] = 1.0
    nut = models.nuts[first : first + count]
    if "omega" in makes or "sigma" in makes:
        ratio, loss = row.number["ratio"], row.number["loss"]
        predicted.modes(models.strings[string], linear, nut, ratio, loss, m["own"], omega, sigma)
    for name, guess in (("omega", omega), ("sigma", sigma)):
        if name in makes:
            held = row.table(name, (m["size"],))
            held[...] = coder(KINDS.index(name), held, guess, 0)


def _symmetric(kind: int, held: np.ndarray, guess: np.ndarray | None, coder: _Coder) -> None:
    lower = np.tril_indices(len(held))
    numbers = coder(kind, held[lower], None if guess is None else guess[lower], 0)
    held[lower] = numbers
    held.T[lower] = numbers


def _shapes(models: Models, row: _Row, place: int, coder: _Coder) -> None:
    m = row.m
    held, guess = row.table("contacts.shapes", (m["contacts"], m["size"])), np.zeros((m["contacts"], m["size"]))
    length = models.strings[m["string"], STRING.index("length_m")]
    for c in range(m["contacts"]):
        predicted.shape(models.places[place + c], length, m["own"], guess[c])
    held[...] = coder(KINDS.index("contacts.shapes"), held, guess, 0)


def _rows(row: _Row, coder: _Coder) -> None:
    m, kind = row.m, KINDS.index("rows")
    held, guess = row.table("rows", (ROWS, m["size"])), np.zeros((ROWS, m["size"]))
    omega, sigma = (row.table(name, (m["size"],))[: m["modes"]] for name in ("omega", "sigma"))
    mu, dt = row.number["mu"], row.number["dt"]
    predicted.hold_rows(omega, sigma, mu, dt, guess)
    first = [0, 1, 3, 4]
    held[first] = coder(kind, held[first], guess[first], 0)
    predicted.impulse_rows(omega, mu, held[1], guess)
    held[[2, 5]] = coder(kind, held[[2, 5]], guess[[2, 5]], 0)
    predicted.later_rows(held[:6], guess)
    held[6:] = coder(kind, held[6:], guess[6:], 0)


def _weights(models: Models, row: _Row, coder: _Coder) -> None:
    m, number = row.m, row.number
    held, guess = row.table("outputs.weights", (2, m["size"])), np.zeros((2, m["size"]))
    if m["weighing"] == HEARD:
        length = models.strings[m["string"], STRING.index("length_m")]
        for k, gain in enumerate(("gain_q", "gain_v")):
            predicted.heard(number["place"], length, number["half"], number[gain], m["own"], guess[k])
    elif m["weighing"] == FILTERED:
        at, size = (int(models.models[m["base"], MODEL.index(name)]) for name in ("outputs.weights", "size"))
        base = row.image[at : at + 16 * size].view(np.float64).reshape(2, size)
        taps = models.taps[m["first_tap"] : m["first_tap"] + m["taps"]]
        omega = row.table("omega", (m["size"],))
        predicted.filtered(omega, base, taps, number["rate"], guess)
    for k in range(2):
        smooth = m["weighing"] == SMOOTH
        held[k] = coder(KINDS.index("outputs.weights"), held[k], None if smooth else guess[k], 3 if smooth else 0)


def _lags(row: _Row, coder: _Coder) -> None:
    m, c = row.m, row.m["lagged"]
    held, guess = row.table("contacts.lags", (c, c, 2 * BLOCK)), np.zeros((c, c, 2 * BLOCK))
    shapes = row.table("contacts.shapes", (c, m["size"]))
    predicted.lags(m["velocity"], row.table("rows", (ROWS, m["size"])), shapes, shapes, 1, guess)
    lower = np.tril_indices(c)
    numbers = coder(KINDS.index("contacts.lags"), held[lower][:, BLOCK + 1 :], guess[lower][:, BLOCK + 1 :], 0)
    whole = np.zeros((len(lower[0]), 2 * BLOCK))
    whole[:, BLOCK], whole[:, BLOCK + 1 :] = row.table("contacts.matrix", (c, c))[lower], numbers
    held[lower] = whole
    held[lower[1], lower[0]] = whole


def _out_lags(row: _Row, coder: _Coder) -> None:
    m, c = row.m, row.m["lagged"]
    held, guess = row.table("outputs.lags", (2, c, 2 * BLOCK)), np.zeros((2, c, 2 * BLOCK))
    weights, shapes = row.table("outputs.weights", (2, m["size"])), row.table("contacts.shapes", (c, m["size"]))
    rows = row.table("rows", (ROWS, m["size"]))
    for k in range(2):
        predicted.lags(int(k >= m["on_q"]), rows, shapes, weights[k : k + 1], 0, guess[k : k + 1])
    held[:, :, BLOCK:] = coder(KINDS.index("outputs.lags"), held[:, :, BLOCK:], guess[:, :, BLOCK:], 0)
