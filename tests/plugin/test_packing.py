"""Packed banks: exactly the bank again, in C and in Python; refusal of what was changed; the sound of levelled banks."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import zlib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from synth.instrument.preset import load_preset
from synth.midi.events import NOTE_ON
from synth.native.arrays import arrays_of
from synth.plugin import packed_bank, predicted
from synth.plugin.bankfile import HEADER, RATE, Laid, bank, laid_out
from synth.plugin.droning import CYCLES, STROKE, DroneSettings
from synth.plugin.library import SOURCES, compiler
from synth.plugin.packed_models import MODEL, NUMBERS, STRING, STRING_INTEGERS, TABLES, Models, models_of

#: a bridge, frets with modes in float32, a body that strings share, a board, no contact at all
PRESETS = ("tanpura-light", "fretted-bass", "steel-guitar", "flatwound-fretless", "harpsichord")
UNPACKING = ("bank_predict.c", "bank_unpack.c", "checksum.c", "system_linux.c")


@cache
def made(name: str) -> tuple[bytes, list[Laid], Models]:
    data, laid = laid_out([load_preset(name)], [48000.0], quality="draft" if name == "steel-guitar" else "standard")
    return data, laid, models_of(laid)


def c_unpacked(library, packed: bytes) -> bytes | str:
    """The bank, or why there is none."""
    size = library.jawari_unpacked_size(packed, ctypes.c_size_t(len(packed)))
    room, why = np.zeros(max(0, size), np.uint8), ctypes.create_string_buffer(512)
    at = ctypes.c_void_p(room.ctypes.data)
    failed = library.jawari_unpack(packed, ctypes.c_size_t(len(packed)), at, ctypes.c_size_t(room.size), why)
    return why.value.decode() if failed else room.tobytes()


@pytest.fixture(scope="module")
def native(tmp_path_factory) -> ctypes.CDLL:
    """What unpacks, alone: it needs nothing else of the library."""
    made = tmp_path_factory.mktemp("unpack") / "unpack.so"
    sources = [str(SOURCES / name) for name in UNPACKING]
    flags = ["-std=c11", "-O2", "-ffp-contract=off", "-fPIC", "-shared"]
    subprocess.run([*compiler(), *flags, "-o", str(made), *sources, "-lm"], check=True)
    library = ctypes.CDLL(str(made))
    library.jawari_unpacked_size.restype = ctypes.c_int64
    return library


@pytest.mark.parametrize("name", PRESETS)
def test_a_packed_bank_is_the_bank_again_in_c_and_in_python(native, name):
    data, _, models = made(name)
    for whole in (data, packed_bank.level(data, models)):
        packed = packed_bank.pack(whole, models)
        assert len(packed) < 0.62 * len(whole)
        assert packed_bank.unpack(packed) == whole
        assert c_unpacked(native, packed) == whole


def test_a_bank_of_several_presets_and_rates(native):
    presets = [load_preset("tanpura-light"), load_preset("fretted-bass")]
    data, laid = laid_out(presets, [48000.0, 96000.0], quality="draft")
    assert data == bank(presets, [48000.0, 96000.0], quality="draft")
    assert [each.engine.rate_hz for each in laid] == [48000.0, 96000.0]
    packed = packed_bank.pack(data, models_of(laid))
    assert c_unpacked(native, packed) == packed_bank.unpack(packed) == data


def test_models_that_say_nothing_true_cost_room_and_nothing_else(native):
    data, _, models = made("tanpura-light")
    wrong = models._replace(strings=models.strings * 1.1, places=models.places[::-1] * 0.5)
    packed = packed_bank.pack(data, wrong)
    assert c_unpacked(native, packed) == packed_bank.unpack(packed) == data
    assert len(packed) > len(packed_bank.pack(data, models))


@pytest.mark.parametrize(("name", "most"), [("fretted-bass", 250_000), ("steel-guitar", 500_000)])
def test_a_packed_bank_is_small(name, most):
    """zlib, which comes with Python, stands for what a server does: brotli makes it smaller still. The guitar's strings are
    uneven: each of their modes has a frequency that no law tells."""
    data, laid, _ = made(name)
    packed = packed_bank.for_pages(data, laid)
    small = len(zlib.compress(packed, 9))
    assert small < most and small < len(zlib.compress(data, 9)) / 8


def test_a_drone_of_a_bank_for_pages_strays_as_in_the_bank_to_a_part_in_thousands():
    drone = DroneSettings(sa_hz=130.8).on(load_preset("tanpura-light"))
    data, laid = laid_out([drone.strings.preset], [48000.0], name="drone", drone=drone, quality="draft")
    whole = packed_bank.unpack(packed_bank.for_pages(data, laid))
    header = np.frombuffer(data, HEADER, 1)[0]
    end = int(header["drone_at"] + header["drone"])
    first = end - CYCLES * 4 * STROKE.itemsize
    before, after = (np.frombuffer(each[first:end], np.float64) for each in (data, whole))
    np.testing.assert_allclose(after, before, rtol=2.0**-12, atol=0.0)
    assert whole[int(header["drone_at"]) : first] == data[int(header["drone_at"]) : first]
    assert zlib.crc32(bytes(_unsummed(whole))) == np.frombuffer(whole, HEADER, 1)[0]["checksum"]


def _unsummed(data: bytes) -> np.ndarray:
    """The tables of a bank, with 0 for their checksum."""
    tables = np.frombuffer(data, np.uint8).copy()
    header = tables[: HEADER.itemsize].view(HEADER)
    header["checksum"] = 0
    return tables[: int(header["tables_end"][0])]


def test_a_levelled_bank_has_right_checksums_and_what_it_changes_is_small():
    data, laid, models = made("fretted-bass")
    levelled = packed_bank.level(data, models)
    header = np.frombuffer(levelled, HEADER, 1).copy()
    whole, header["checksum"] = int(header["checksum"][0]), 0
    end, first = int(header["tables_end"][0]), int(header["rates_at"][0])
    assert zlib.crc32(levelled[HEADER.itemsize : end], zlib.crc32(header.tobytes())) == whole
    row = np.frombuffer(levelled, RATE, 1, first)[0]
    begin = int(row["at"])
    assert zlib.crc32(levelled[begin : begin + int(row["size"])]) == row["checksum"]
    [rate] = laid
    for model in rate.engine._strings.models:
        arrays = arrays_of(model)
        for name in TABLES:
            held = arrays[name]
            if held.nbytes and held.dtype == np.float64 and name != "outputs.lags":
                now = np.frombuffer(levelled, np.float64, held.size, rate.place(held)).reshape(held.shape)
                assert np.abs(now - held).max() <= 2.0**-24 * np.abs(held).max(), name
        residual = model.contacts.residual
        if residual.size:
            now = np.frombuffer(levelled, np.float64, residual.size, rate.place(residual)).reshape(residual.shape)
            assert np.array_equal(now, now.T) and np.linalg.eigvalsh(now - residual)[0] >= -1e-15 * residual.max()


def test_a_levelled_bank_plays(library, tmp_path):
    data, _, models = made("fretted-bass")
    sounds = []
    for name, whole in (("as it is", data), ("levelled", packed_bank.level(data, models))):
        path = tmp_path / name
        path.write_bytes(whole)
        engine = library.open_bank(path).engine(48000.0)
        sounds.append(engine.play([(0, NOTE_ON, 0, 40, 90)], 12000))
    assert np.abs(sounds[0]).max() > 1e-3
    assert 0.0 < np.abs(sounds[1] - sounds[0]).max() < 1e-3 * np.abs(sounds[0]).max()


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda p: b"", "does not begin"),
        (lambda p: b"JAWARIBK" + p[8:], "does not begin"),
        (lambda p: p[:8] + b"\x09" + p[9:], "version 9"),
        (lambda p: p[:-1], "cut off"),
        (lambda p: p + b"\0", "cut off"),
        (lambda p: p[:-1] + bytes([p[-1] ^ 1]), "checksum"),
        (lambda p: p[:12] + bytes([p[12] ^ 1]) + p[13:], "checksum"),
        (lambda p: p[:32] + b"\xff\xff\xff\xff" + p[36:], "cut off"),
        (lambda p: p[:56] + b"\xff" * 8 + p[64:], "outside"),
    ],
)
def test_a_changed_one_is_refused(native, change, why):
    data, _, models = made("tanpura-light")
    assert why in c_unpacked(native, change(packed_bank.pack(data, models)))


@pytest.mark.parametrize(("modes", "refused"), [(64, False), (16384, True)])
def test_what_would_take_long_for_its_few_bytes_is_refused(native, monkeypatch, modes, refused):
    """A model whose lags are made of tables of zeros, which cost no byte."""
    contacts = 64
    row = dict.fromkeys(MODEL, 0) | {"modes": modes, "size": modes, "contacts": contacts, "lagged": contacts}
    row["makes"] = 1 << TABLES.index("contacts.lags")
    model = np.array([list(row.values())], np.int64)
    end = 0
    for name, size in packed_bank.extents(model[0]).items():
        model[0, MODEL.index(name)] = end
        end += (size + 63) // 64 * 64
    empty = np.zeros(0)
    numbers, string = np.ones((1, len(NUMBERS))), np.ones((1, len(STRING)))
    integers = np.zeros((1, len(STRING_INTEGERS)), np.int64)
    monkeypatch.setattr(packed_bank, "_areas", lambda *_: [])
    whole = bytes(end)
    packed = packed_bank.pack(whole, Models(model, numbers, integers, string, empty.reshape(0, 3), empty, empty))
    assert len(packed) < 20_000
    found = c_unpacked(native, packed)
    assert ("so few bytes" in found) if refused else (found == whole)


def test_python_refuses_a_changed_one():
    data, _, models = made("tanpura-light")
    packed = packed_bank.pack(data, models)
    with pytest.raises(ValueError, match="no packed bank"):
        packed_bank.unpack(b"JAWARIBK" + packed[8:])
    with pytest.raises(ValueError, match="checksum"):
        packed_bank.unpack(packed[:-1] + bytes([packed[-1] ^ 1]))


@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is needed, for its sanitizers")
def test_no_bytes_make_it_read_or_write_elsewhere(tmp_path):
    data, _, models = made("tanpura-light")
    (tmp_path / "packed").write_bytes(packed_bank.pack(data, models))
    program = tmp_path / "fuzz"
    sources = [str(Path(__file__).with_name("unpackfuzz.c")), *(str(SOURCES / name) for name in UNPACKING)]
    flags = [
        "-std=c11",
        "-O1",
        "-ffp-contract=off",
        "-fsanitize=address,undefined",
        "-fno-sanitize-recover=all",
        f"-I{SOURCES}",
    ]
    subprocess.run(["gcc", *flags, "-o", str(program), *sources, "-lm"], check=True)
    ran = subprocess.run([str(program), str(tmp_path / "packed"), "4000", "5"], capture_output=True, text=True, check=True)
    refused, silent, wrong = map(int, ran.stdout.split())
    assert refused > 3500 and silent == wrong == 0


def test_functions_are_right_to_the_last_place_but_one():
    dice = np.random.default_rng(4)
    for x in (*dice.uniform(0.0, 1000.0, 2000), *dice.uniform(0.0, 2.0, 2000), 0.0):
        for guess, right in ((predicted.sine(x), math.sin(x)), (predicted.cosine(x), math.cos(x))):
            assert abs(guess - right) <= math.ulp(right)
        less, low = predicted.exponential_less_1(-x / 2.0)
        assert abs(less + low - math.expm1(-x / 2.0)) <= math.ulp(math.expm1(-x / 2.0))
