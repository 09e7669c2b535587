"""Banks: what they hold, and that nothing but a whole one is played."""

from __future__ import annotations

import ctypes
import json
import os
import subprocess
import sys
import textwrap
import zlib
from pathlib import Path

import numpy as np
import pytest

from synth.engine import layout
from synth.engine.engine import Engine
from synth.instrument.preset import load_preset
from synth.jit.kernel_cache import sources_id
from synth.native.arrays import aligned
from synth.plugin import bankfile
from synth.plugin.addresses import CONSTANT, CORE, THREAD, Memory
from synth.plugin.bankfile import HEADER, RATE, bank, uid_of
from synth.plugin.library import with_bank
from tests.engine.tremor import Tremor

from .native import Library, Refused

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def small() -> bytes:
    return bank([load_preset("tanpura-light")], [44100.0])


def test_tables_say_what_the_presets_say(library, bank_files):
    opened = library.open_bank(bank_files["all"])
    names = ("tanpura-light", "fretted-bass", "jawari-harp")
    presets = [load_preset(name) for name in names]
    engine = Engine(presets)
    assert library.bank_id(opened.address) == b"collection"
    assert library.presets(opened.address) == 3
    for k, preset in enumerate(presets):
        row = library.preset_of(opened.address, k).contents
        assert (row.id.decode(), row.name.decode(), row.description.decode()) == (
            preset.name,
            preset.title,
            preset.description,
        )
    assert [library.preset_of(opened.address, k).contents.lowest_note for k in range(3)] == [36, 28, 28]
    assert not library.preset_of(opened.address, 3) and not library.preset_of(opened.address, -1)
    engine.prepare(44100.0)
    assert library.parameters(opened.address) == len(engine.parameters)
    for k, parameter in enumerate(engine.parameters):
        row = library.parameter_of(opened.address, k).contents
        got = (row.part, row.index, row.id.decode(), row.name.decode(), row.unit.decode())
        assert got == (parameter.part, parameter.index, parameter.id, parameter.name, parameter.unit)
        numbers = (row.minimum, row.maximum, row.initial, row.smoothing_s)
        assert numbers == (parameter.minimum, parameter.maximum, parameter.default, parameter.smoothing_s)
        assert row.curve == layout.PARAMETER_CURVES[parameter.index]
    assert library.strings(opened.address) == sum(len(part.strings) for part in engine.compiled)
    assert library.rates(opened.address) == 1 and library.rate_of(opened.address, 0) == 44100.0
    assert library.rate_of(opened.address, 1) == 0.0
    assert ctypes.string_at(library.bank_uid(opened.address), 16) == uid_of("collection")
    opened.close()


def test_the_same_presets_give_the_same_bytes(small):
    assert bank([load_preset("tanpura-light")], [44100.0]) == small


def test_a_rate_that_is_not_there_is_refused_with_those_that_are(library, bank_files):
    opened = library.open_bank(bank_files["tanpura-light"])
    for rate in (48000.0, 0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(Refused, match="44100 Hz, not for"):
            opened.engine(rate)


def test_a_bank_stays_until_its_last_engine_has_gone(library, bank_files):
    opened = library.open_bank(bank_files["tanpura-light"])
    engine = opened.engine()
    opened.close()
    assert np.abs(engine.play([(0, 1, 0, 48, 100)], 4000)).max() > 0.0


def test_a_library_finds_the_bank_behind_its_own_end(library_file, small, tmp_path):
    plugin = tmp_path / "own.so"
    plugin.write_bytes(with_bank(library_file, small))
    again = tmp_path / "again.so"
    again.write_bytes(with_bank(plugin, small))
    assert again.read_bytes() == plugin.read_bytes()  # the bank that was there has gone
    loaded = Library(plugin)
    first, second = loaded.open_own_bank(), loaded.open_own_bank()
    assert first.address == second.address
    first.close()
    assert np.abs(second.engine().play([(0, 1, 0, 48, 100)], 4000)).max() > 0.0
    second.close()
    with pytest.raises(Refused, match="there is no bank in"):
        Library(library_file).open_own_bank()


def test_a_library_that_was_named_from_a_folder_finds_its_bank_from_another(library_file, small, tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "own.so").write_bytes(with_bank(library_file, small))
    (tmp_path / "there" / "link.so").symlink_to("own.so")
    program = """
        import os, sys
        from pathlib import Path
        from tests.plugin.native import Library
        for name in ("./there/own.so", "there/../there/link.so"):
            os.chdir(sys.argv[1])
            loaded = Library(name)
            os.chdir("/")
            print(loaded.presets(loaded.open_own_bank().address))
    """
    command = [sys.executable, "-c", textwrap.dedent(program), str(tmp_path)]
    path = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, cwd="/", env=path, check=False)
    assert done.stdout == "1\n1\n", done.stderr


def test_what_a_bank_is_not_made_of_is_refused():
    tanpura = load_preset("tanpura-light")
    with pytest.raises(ValueError, match="1 to 32 sample rates"):
        bank([tanpura], [])
    with pytest.raises(ValueError, match="no threads"):
        bank([tanpura], [44100.0], threads=2)
    with pytest.raises(ValueError, match="called 'tanpura-light'"):
        bank([tanpura, tanpura], [44100.0], name="two")
    with pytest.raises(ValueError, match="in Python only"):
        bank([tanpura], [44100.0], mix_effects=[Tremor(kind="tremor", period_ms=100.0)])


# --- what is not a whole bank ---

#: opens every file of a folder, makes an engine of what can be opened and plays; writes down what was said
_OPEN_ALL = """
    import json, sys
    from pathlib import Path
    import numpy as np
    from tests.plugin.native import Library, Refused
    library = Library(Path(sys.argv[1]))
    said = {}
    original = np.fromfile(sys.argv[2], np.uint8)
    cases = json.loads(Path(sys.argv[3]).read_text())
    scratch = Path(sys.argv[4])
    for name, (size, changes) in cases.items():
        data = original[:size].copy()
        for at, value in changes:
            data[at] = value
        scratch.write_bytes(data.tobytes())
        print(name, flush=True)  # the last one is what it died of
        try:
            bank = library.open_bank(scratch)
            try:
                engine = bank.engine()
                out = engine.play([(0, 1, 0, 48, 100)], 2000)
                said[name] = "played" if np.abs(out).max() > 0 else "silent"
                engine.close()
            finally:
                bank.close()
        except Refused as refusal:
            said[name] = str(refusal)
    Path(sys.argv[5]).write_text(json.dumps(said))
"""


def opened(library_file: Path, data: bytes, cases: dict, tmp_path: Path) -> dict[str, str]:
    """What a process of its own says to each case: (bytes kept, [[place, value], …])."""
    for name, content in (("original", data), ("cases", json.dumps(cases).encode())):
        (tmp_path / name).write_bytes(content)
    script = [sys.executable, "-c", textwrap.dedent(_OPEN_ALL), str(library_file)]
    arguments = [str(tmp_path / name) for name in ("original", "cases", "scratch", "said")]
    done = subprocess.run([*script, *arguments], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, (done.stdout.splitlines()[-1:], done.stderr[-500:])
    return json.loads((tmp_path / "said").read_text())


def test_a_bank_that_was_cut_off_or_changed_is_refused(library_file, small, tmp_path):
    rng = np.random.default_rng(7)
    cases: dict[str, tuple] = {"whole": (len(small), [])}
    for size in (0, 1, 7, 8, 100, HEADER.itemsize - 1, HEADER.itemsize, 1000, 4095, 4096, 5000, len(small) - 1):
        cases[f"cut {size}"] = (size, [])
    header = np.frombuffer(small[: HEADER.itemsize], HEADER)[0]
    end = int(header["tables_end"])
    for at in range(HEADER.itemsize):
        cases[f"header {at}"] = (len(small), [[at, small[at] ^ (1 << int(rng.integers(8)))]])
    for at in rng.integers(HEADER.itemsize, end, 150).tolist():
        cases[f"tables {at}"] = (len(small), [[at, small[at] ^ (1 << int(rng.integers(8)))]])
    for at in rng.integers(4096 * -(-end // 4096), len(small), 150).tolist():
        cases[f"block {at}"] = (len(small), [[at, small[at] ^ (1 << int(rng.integers(8)))]])
    said = opened(library_file, small, cases, tmp_path)
    assert said.pop("whole") == "played"
    for name, answer in said.items():
        assert answer not in ("played", "silent"), name
        assert "export" in answer or "no bank" in answer, (name, answer)


def test_numbers_that_cannot_be_are_survived_even_under_a_right_checksum(library_file, small, tmp_path):
    """Every number of a rate's row, and header's counts and places: set to what is no place; the checksum made to fit."""
    header = np.frombuffer(small[: HEADER.itemsize], HEADER)[0]
    begin, end = int(header["rates_at"]), int(header["tables_end"])
    places = [begin + 8 * k for k in range(3, RATE.itemsize // 8)]  # all but rate, latency and tail
    places += [HEADER.fields[name][1] for name in ("presets_at", "parameters_at", "functions_at", "rates_at", "size")]
    cases = {}
    for at in places:
        for value in (1 << 63, (1 << 64) - 8, 1 << 32, 12345679):
            data = bytearray(small)
            data[at : at + 8] = value.to_bytes(8, "little")
            _seal(data, end)
            changed = np.flatnonzero(np.frombuffer(bytes(data[:end]), np.uint8) != np.frombuffer(small[:end], np.uint8))
            cases[f"{at} {value}"] = (len(small), [[int(k), data[k]] for k in changed])
    said = opened(library_file, small, cases, tmp_path)
    # a stride of what is there once, for one, means nothing
    assert sum(answer not in ("played", "silent") for answer in said.values()) > 0.6 * len(said)


def _seal(data: bytearray, end: int) -> None:
    """Make the checksum of header and tables right."""
    at = HEADER.fields["checksum"][1]
    data[at : at + 4] = bytes(4)
    data[at : at + 4] = zlib.crc32(data[:end]).to_bytes(4, "little")


def test_relocations_that_lead_elsewhere_are_refused(library_file, small, tmp_path):
    header = np.frombuffer(small[: HEADER.itemsize], HEADER)[0]
    end, rates_at = int(header["tables_end"]), int(header["rates_at"])
    row = np.frombuffer(small[rates_at : rates_at + RATE.itemsize], RATE)[0]
    first = int(row["at"] + row["relocations_at"])
    rng = np.random.default_rng(5)
    cases = {}
    for k in rng.integers(0, int(row["relocations"]), 40).tolist():
        for field, size in ((0, 8), (8, 8), (16, 4), (20, 4)):
            data = bytearray(small)
            at = first + 24 * k + field
            data[at : at + size] = int(rng.choice([(1 << 31) + 1, (1 << 31) - 8])).to_bytes(size, "little")
            block = bytes(data[int(row["at"]) : int(row["at"] + row["size"])])
            place = rates_at + RATE.fields["checksum"][1]
            data[place : place + 8] = zlib.crc32(block).to_bytes(8, "little")
            _seal(data, end)
            changed = np.flatnonzero(np.frombuffer(bytes(data), np.uint8) != np.frombuffer(small, np.uint8))
            cases[f"{k} {field}"] = (len(small), [[int(c), data[c]] for c in changed])
    said = opened(library_file, small, cases, tmp_path)
    assert all("changed" in answer for answer in said.values()), said


def test_a_bank_for_other_kernels_or_of_another_version_says_so(library, small, tmp_path):
    end = int(np.frombuffer(small[: HEADER.itemsize], HEADER)[0]["tables_end"])
    path = tmp_path / "other.jawari"
    for field, value, words in (
        ("kernels", b"0123456789abcdef", "another version of the library"),
        ("version", b"\x07", "of version 7"),
    ):
        data = bytearray(small)
        at = HEADER.fields[field][1]
        data[at : at + len(value)] = value
        _seal(data, end)
        path.write_bytes(data)
        with pytest.raises(Refused, match=words):
            library.open_bank(path)
    name = bankfile.FUNCTION.itemsize
    functions_at = int(np.frombuffer(small[: HEADER.itemsize], HEADER)[0]["functions_at"])
    data = bytearray(small)
    data[functions_at : functions_at + name] = b"my_module:_process".ljust(name, b"\0")
    _seal(data, end)
    path.write_bytes(data)
    with pytest.raises(Refused, match="needs my_module:_process"):
        library.open_bank(path)
    assert library.kernels_version().decode() == sources_id()


def test_files_that_are_none(library, tmp_path):
    (tmp_path / "text").write_text("a tanpura\n" * 1000)
    with pytest.raises(Refused, match="no bank in"):
        library.open_bank(tmp_path / "text")
    with pytest.raises(Refused, match="No such file"):
        library.open_bank(tmp_path / "none")
    with pytest.raises(Refused, match="is no file"):
        library.open_bank(tmp_path)
    (tmp_path / "foot").write_bytes(bytes(5000) + (1 << 62).to_bytes(8, "little") + b"JAWARIFT")
    with pytest.raises(Refused, match="outside of the file"):
        library.open_bank(tmp_path / "foot")


# --- memory ---


def test_constant_arrays_of_the_same_bytes_lie_at_one_place():
    memory = Memory()
    arrays = [aligned(10), aligned(10), aligned(12)]
    changing = [aligned(10), aligned(10)]
    for k, array in enumerate(arrays):
        array[:] = 1.5
        memory.add(CONSTANT, array)
        assert memory.place(array) == (0, 0, 128)[k]
    for array in changing:
        memory.add(CORE, array)
    table = aligned(4, np.int64)
    table[:3] = [array.ctypes.data + 16 for array in arrays]
    memory.add(CORE, table, points=[0, 1, 2])
    image = memory.image(lambda address: None)
    assert image.relocations["target"].tolist() == [16, 16, 144] and image.regions[CONSTANT].size == 256
    assert memory.place(changing[0]) != memory.place(changing[1])


def test_a_string_keeps_what_its_models_share_once(library, bank_files):
    """Rows of step coefficients, the largest tables, are the same for a model of a step a frame and for its free flight."""
    data = bank_files["jawari-harp"].read_bytes()
    engine = Engine([load_preset("jawari-harp")])
    engine.prepare(44100.0)
    models = [*engine.memory.strings.models, *engine.memory.built.flights]
    rows = {model.rows.tobytes() for model in models}
    assert len(rows) < len(models)
    for each in rows:
        assert data.count(each) == 1


def test_words_that_lead_nowhere_and_words_that_nobody_declared_are_found():
    memory = Memory()
    taps, table, other = aligned(10), aligned(4, np.int64), aligned(3)
    memory.add(CONSTANT, taps)
    table[:] = [taps.ctypes.data + 16, 5, 0, 0]
    memory.add(CORE, table, points=[0, 2])
    image = memory.image(lambda address: None)
    assert image.relocations.tolist() == [(0, 16, CORE, CONSTANT)] and image.regions[CORE].size == 64
    table[3] = taps.ctypes.data + 8
    undeclared = Memory()
    undeclared.add(CONSTANT, taps)
    undeclared.add(CORE, table, points=[0, 2])
    with pytest.raises(ValueError, match="not declared"):
        undeclared.image(lambda address: None)
    table[3] = 0
    table[2] = other.ctypes.data
    lost = Memory()
    lost.add(CONSTANT, taps)
    lost.add(CORE, table, points=[0, 2])
    with pytest.raises(ValueError, match="points nowhere"):
        lost.image(lambda address: None)
    lying = Memory()
    lying.add(THREAD, taps)
    lying.add(THREAD, taps[2:5])
    with pytest.raises(ValueError, match="overlap"):
        lying.image(lambda address: None)
