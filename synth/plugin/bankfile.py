"""Banks: presets compiled for one or several rates, as the native library takes them (c/bank.c).

    data = bank([load_preset("tanpura")], [44100.0, 48000.0])

A bank is the memory of prepared engines: what is constant, what an engine begins with, and which words of that are
addresses. Each preset is a part, which the programs 0, 1, … of every channel choose. All numbers are little-endian.

    header        HEADER
    presets       PRESET each; then live parameters and the numbers of the setup, PARAMETER each; functions, FUNCTION each;
                  rates, RATE each; the recipe, by which `rebuild` makes a bank with another setup; and the drone of a plugin
                  that plays one by itself, as `droning` has it
    per rate      its block: constants, core and thread as they begin, RELOCATION each

Strings take the same steps at a rate and at its octave where more steps make up for the lower rate: the constants of the two
then have much in common. It is there once, at the end of the lower rate's block, where the other's begins.

A checksum (CRC-32) covers header and tables, another each block. Where the library looks into an engine's memory, it finds
the places in PLACES of the rate.
"""

from __future__ import annotations

import hashlib
import sys
import zlib
from collections.abc import Callable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from synth.engine import arguments, layout, team
from synth.engine.bank import new_scratch
from synth.engine.board_tables import BOARD_PARTS
from synth.engine.bridges import COUPLING_CHANGES, COUPLING_ROOM
from synth.engine.engine import Engine
from synth.engine.memory_map import EngineMemory
from synth.engine.parameters import Parameter
from synth.engine.voices.voice_table import VOICE_PARTS, Voices
from synth.instrument.preset import Preset
from synth.jit.entries import entered
from synth.jit.kernel_sources import sources_id
from synth.jit.prebuilt import name_of
from synth.native.arrays import arrays_of, values
from synth.plugin import library, recipe
from synth.plugin.addresses import CONSTANT, CORE, THREAD, TO_FUNCTION, Memory, pointers, word_of
from synth.plugin.description import DescribedPreset, curve_of, describe
from synth.plugin.droning import PluginDrone
from synth.plugin.emit import names
from synth.plugin.setup import SetupNumber
from synth.solver.board_table import CONSTANT as CONSTANT_ARRAYS
from synth.solver.coupling import Coupling, End
from synth.solver.stringmodel import Scratch, StringModel, StringState

MAGIC = b"JAWARIBK"
#: of this layout; a change of what HEADER … RATE mean is another version
VERSION = 5
RATES = (44100.0, 48000.0, 88200.0, 96000.0)
MOST_RATES = 32
#: of `Engine`, what is not the bank's
_OF_THE_LIBRARY = {"parts", "threads", "program_map", "bindings", "policy", "only_notes", "every_fret", "warn"}
#: blocks begin at a multiple of this [bytes]
PAGE = 4096
_LINE = 64

HEADER = np.dtype(
    [
        ("magic", "S8"),
        ("version", "<u4"),
        ("checksum", "<u4"),  # CRC-32 of all before `tables_end`, with 0 here
        ("size", "<u8"),  # of the bank
        ("tables_end", "<u8"),
        ("kernels", "S32"),  # `kernel_sources.sources_id`
        ("uid", "V16"),  # of what is made of the bank, for hosts that know plugins by a number
        ("id", "S72"),
        ("name", "S96"),
        ("presets", "<u4"),
        ("parameters", "<u4"),
        ("functions", "<u4"),
        ("rates", "<u4"),
        ("presets_at", "<u8"),
        ("parameters_at", "<u8"),
        ("functions_at", "<u8"),
        ("rates_at", "<u8"),
        ("setup_at", "<u8"),
        ("recipe_at", "<u8"),
        ("drone_at", "<u8"),  # 0: there is none
        ("setup", "<u4"),
        ("recipe", "<u4"),  # bytes
        ("drone", "<u8"),  # bytes
    ]
)
PRESET = np.dtype([("id", "S72"), ("name", "S96"), ("description", "S256"), ("lowest", "<i4"), ("highest", "<i4")])
PARAMETER = np.dtype(
    [
        ("part", "<i4"),
        ("index", "<i4"),
        ("curve", "<i4"),
        ("unused", "<i4"),
        ("minimum", "<f8"),
        ("maximum", "<f8"),
        ("initial", "<f8"),
        ("smoothing_s", "<f8"),
        ("id", "S48"),
        ("name", "S96"),
        ("unit", "S16"),
    ]
)
FUNCTION = np.dtype([("name", "S96")])
#: something in a core: `count` words, `stride` bytes apart
PLACE = np.dtype([("at", "<u8"), ("stride", "<u8"), ("count", "<u8")])
#: what the library looks at in a core, in this order
PLACES = (
    "core",  # the table that kernels take
    "until",
    "left",
    "sleeping",
    "ending",
    "workers",
    "wake",
    "pending",
    "notes",
    "stolen",
    "dropped",
    "silenced",
    "peak",
    "unplayed",
    "awake",
    "idle",
    "silenced_strings",
    "silenced_parts",
    "programs",
    "parameters",
    "note",
    "channel",
    "still",
    # what an engine takes over from the one before it (core_follow.c)
    "channels",
    "tuning",
    "zones",
    "part_channel",
    "part_left",
    "part_right",
    "part_height",
)
RATE = np.dtype(
    [
        ("rate_hz", "<f8"),
        ("latency", "<i8"),
        ("tail", "<i8"),
        ("strings", "<i8"),  # each in one direction or two
        ("at", "<u8"),  # the block
        ("size", "<u8"),
        ("checksum", "<u8"),
        ("constants_at", "<u8"),  # in the block
        ("constants", "<u8"),
        ("core_at", "<u8"),
        ("core_stored", "<u8"),
        ("core", "<u8"),  # with the zeros behind what is stored
        ("thread_at", "<u8"),
        ("thread_stored", "<u8"),
        ("thread", "<u8"),
        ("relocations_at", "<u8"),
        ("relocations", "<u8"),
        ("sounding", "<u8"),  # what begins anew at a reset: of the core from here …
        ("sounding_end", "<u8"),  # … to here
        ("thread_table", "<u8"),  # in the thread's
        ("pitch", "<u8"),  # of every key, among the constants
        ("places", PLACE, (len(PLACES),)),
    ]
)


class Laid(NamedTuple):
    """An engine that was prepared for a rate of a bank, and where its arrays lie: of a constant array, place(array) bytes
    from the bank's beginning (KeyError for one that the bank does not have)."""

    engine: Engine
    place: Callable[[np.ndarray], int]


def bank(
    presets: Sequence[Preset],
    rates_hz: Sequence[float] = RATES,
    *,
    name: str | None = None,
    drone: PluginDrone | None = None,
    progress: Callable[[int, int], None] | None = None,
    laid: list[Laid] | None = None,
    **options: Any,
) -> bytes:
    """The bank of these presets for these sample rates [Hz].

    name      what several are called together (`description.describe`). drone: on the only preset, which is its
              `strings.preset`. options: as of `Engine` (quality, mpe, note_hz, …)
    progress  called with (strings that are compiled, all there are for all rates) after each
    laid      gets, for each rate, ascending, what its arrays are (`laid_out`); its engines live on with it
    Raises ValueError (PresetError among them) for what cannot be played, lies outside of the library or has no such name,
    TypeError for what is of another kind.
    """
    if sys.byteorder != "little":
        raise ValueError("banks can be made on little-endian machines only")
    about = describe(presets, name, () if drone is None else drone.parameters())
    if drone is not None and list(presets) != [drone.strings.preset]:
        raise ValueError("a bank with a drone must hold the drone's preset alone")
    rates = sorted({arguments.rate(rate) for rate in rates_hz})
    if not 1 <= len(rates) <= MOST_RATES:
        raise ValueError(f"a bank is made for 1 to {MOST_RATES} sample rates, got {len(rates)}")
    if refused := sorted(_OF_THE_LIBRARY & options.keys()):
        raise ValueError(f"a bank has no {refused[0]}: each preset is a program, and threads are the library's")
    program_map = None
    if len(presets) > 1:
        program_map = np.full((16, 128), -1, np.int64)
        program_map[:, : len(presets)] = np.arange(len(presets))
    blocks: list[_Block] = []
    rows = np.zeros(len(rates), RATE)
    functions: list[str] = []
    for together in _octaves(rates):
        made: list[_Prepared] = []
        for rate in together:
            engine = Engine(presets, program_map, **options)
            done = len(blocks) + len(made)
            engine.prepare(rate, progress=None if progress is None else _of_all(progress, done, len(rates)))
            made.append(_Prepared(engine))
        common = _bring_together(*made) if len(made) == 2 else 0
        for k, prepared in enumerate(made):
            data, row = _block(prepared, functions, constants_last=common > 0 and k == 0)
            blocks.append(_Block(rates.index(together[k]), row, data, common if k == 1 else 0))
            if laid is not None:
                laid.append(Laid(engine=prepared.engine, place=_placed(prepared.memory, rows, rates.index(together[k]))))
    for block in blocks:
        rows[block.number] = block.row
    tables = (
        np.concatenate([_preset(each) for each in about.presets]),
        _parameters(about.parameters),
        np.array([(_text(each, FUNCTION, "name"),) for each in functions], FUNCTION),
        rows,
        _parameters(about.setup),
        np.frombuffer(recipe.written(presets, name, options), np.uint8),
        np.frombuffer(b"" if drone is None else drone.table(), np.uint8),
    )
    if laid is not None:
        laid.sort(key=lambda each: each.engine.rate_hz)
    return _file(about.id, about.name, tables, blocks)


def laid_out(presets: Sequence[Preset], rates_hz: Sequence[float] = RATES, **options: Any) -> tuple[bytes, list[Laid]]:
    """`bank`, and for each of its rates, ascending, what its arrays are."""
    laid: list[Laid] = []
    return bank(presets, rates_hz, laid=laid, **options), laid


def _placed(memory: Memory, rows: np.ndarray, number: int) -> Callable[[np.ndarray], int]:
    """Where constant arrays lie in a bank whose row of this number is filled by then."""
    return lambda array: int(rows["at"][number]) + int(rows["constants_at"][number]) + memory.place(array)


class _Prepared:
    """An engine that is prepared, and its memory; `sounding`: from where to where in the core it sounds."""

    def __init__(self, engine: Engine) -> None:
        self.engine, self.memory = engine, Memory()
        self.sounding = add_engine(self.memory, engine.memory)


class _Block(NamedTuple):
    """A rate's block: its number among the rates, its row, what it holds, and how much of that ends the block before."""

    number: int
    row: np.ndarray
    data: bytes
    common: int


def _octaves(rates: Sequence[float]) -> list[list[float]]:
    """Rates in ascending order, each with its octave where that is among them and no other's."""
    left, found = list(rates), []
    while left:
        rate = left.pop(0)
        octave = [each for each in left if each == 2.0 * rate]
        left = [each for each in left if each not in octave]
        found.append([rate, *octave])
    return found


def _bring_together(lower: _Prepared, upper: _Prepared) -> int:
    """Constants that both have lie at the end of the one's and at the beginning of the other's. How many bytes they take."""
    first, second = lower.memory.constants(), upper.memory.constants()
    in_second, in_first = set(second), set(first)
    common = [each for each in first if each in in_second]
    lower.memory.arrange([each for each in first if each not in in_second] + common)
    upper.memory.arrange(common + [each for each in second if each not in in_first])
    return sum(_up(len(each), _LINE) for each in common)


def uid_of(id: str) -> bytes:
    """(16 bytes) what hosts know a plugin by, for ever: it follows from the bank's id."""
    return hashlib.blake2b(f"org.jawari.{id}".encode(), digest_size=16).digest()


def _of_all(progress: Callable[[int, int], None], done: int, rates: int) -> Callable[[int, int], None]:
    """Progress of one rate as that of all."""
    return lambda here, strings: progress(done * strings + here, rates * strings)


def _file(id: str, name: str, tables: tuple[np.ndarray, ...], blocks: list[_Block]) -> bytes:
    presets, parameters, functions, rows, setup, kept, score = tables
    places, end = [], HEADER.itemsize
    for each in tables:
        places.append(_up(end, _LINE))
        end = places[-1] + each.nbytes
    at = end
    for block in blocks:
        row = rows[block.number]
        row["at"] = at - block.common if block.common else _up(at, PAGE)
        row["size"], row["checksum"] = len(block.data), zlib.crc32(block.data)
        at = int(row["at"]) + len(block.data)
    header = np.zeros(1, HEADER)
    given = {
        "magic": MAGIC,
        "version": VERSION,
        "size": at,
        "tables_end": end,
        "kernels": sources_id().encode(),
        "uid": np.void(uid_of(id)),
        "id": _text(id, HEADER, "id"),
        "name": _text(name, HEADER, "name"),
        "presets": len(presets),
        "parameters": len(parameters),
        "functions": len(functions),
        "rates": len(rows),
        "setup": len(setup),
        "recipe": kept.size,
        "drone": score.size,
    }
    for key, value in given.items():
        header[key] = value
    for key, place in zip(("presets", "parameters", "functions", "rates", "setup", "recipe", "drone"), places, strict=True):
        header[f"{key}_at"] = place
    if not score.size:
        header["drone_at"] = 0
    out = bytearray(at)
    for place, each in zip(places, tables, strict=True):
        out[place : place + each.nbytes] = each.tobytes()
    out[: HEADER.itemsize] = header.tobytes()
    header["checksum"] = zlib.crc32(out[:end])
    out[: HEADER.itemsize] = header.tobytes()
    for block in blocks:
        begin = int(rows[block.number]["at"])
        out[begin : begin + len(block.data)] = block.data
    return bytes(out)


def _up(size: int, to: int) -> int:
    return -(-size // to) * to


def _text(text: str, kind: np.dtype, field: str) -> bytes:
    """A text for a field, cut where it does not fit with the zero behind it, at no place but between characters."""
    assert kind.fields is not None
    room = kind.fields[field][0].itemsize - 1
    return text.encode()[:room].decode(errors="ignore").encode()


def _preset(preset: DescribedPreset) -> np.ndarray:
    texts = (_text(getattr(preset, field), PRESET, field) for field in ("id", "name", "description"))
    return np.array([(*texts, preset.lowest_note, preset.highest_note)], PRESET)


def _parameters(parameters: Sequence[Parameter | SetupNumber]) -> np.ndarray:
    rows = []
    for each in parameters:
        texts = (_text(getattr(each, field), PARAMETER, field) for field in ("id", "name", "unit"))
        smoothing = each.smoothing_s if isinstance(each, Parameter) else 0.0
        rows.append((each.part, each.index, curve_of(each), 0, each.minimum, each.maximum, each.default, smoothing, *texts))
    return np.array(rows, PARAMETER)


def _block(prepared: _Prepared, functions: list[str], constants_last: bool = False) -> tuple[bytes, np.ndarray]:
    """A rate's block and its row, but for where that stands; functions that are new are added to the list.

    constants_last: the block ends where the constants do, and else they begin where the block does.
    """
    engine, memory, sounding = prepared.engine, prepared.memory, prepared.sounding
    image = memory.image(function_at)
    missing = sorted(set(image.functions) - set(names()))
    if missing:
        raise ValueError(
            f"the native library has no function {missing[0]}: presets with effects, excitations or contact laws of other "
            "modules play in Python only"
        )
    functions += [each for each in image.functions if each not in functions]
    relocations = image.relocations.copy()
    named = relocations["to"] == TO_FUNCTION
    numbers = np.array([functions.index(each) for each in image.functions], np.uint64)
    relocations["target"][named] = numbers[relocations["target"][named].astype(np.int64)]
    row = np.zeros(1, RATE)
    out = bytearray()

    def put(data: bytes) -> int:
        out.extend(bytes(_up(len(out), _LINE) - len(out)))
        at = len(out)
        out.extend(data)
        return at

    constant, core, thread = image.regions
    constants = constant.stored.ljust(constant.size, b"\0")
    if not constants_last:
        row["constants_at"] = put(constants)
    row["core_at"], row["core_stored"], row["core"] = put(core.stored), len(core.stored), core.size
    row["thread_at"], row["thread_stored"], row["thread"] = put(thread.stored), len(thread.stored), thread.size
    row["relocations_at"], row["relocations"] = put(relocations.tobytes()), len(relocations)
    if constants_last:
        row["constants_at"] = put(constants)
    else:
        out.extend(bytes(_up(len(out), PAGE) - len(out)))
    row["constants"] = constant.size
    row["rate_hz"], row["latency"] = engine.rate_hz, engine.latency_samples
    row["tail"] = round(engine.tail_seconds * engine.rate_hz)
    row["strings"] = sum(len(part.strings) for part in engine.compiled)
    row["sounding"], row["sounding_end"] = sounding
    row["thread_table"] = memory.place(engine.memory.thread)
    row["pitch"] = memory.place(engine.memory.built.bank.pitch)
    row["places"] = _places(memory, engine.memory)
    return bytes(out), row[0]


def add_engine(memory: Memory, inside: EngineMemory) -> tuple[int, int]:
    """The memory of an engine that is prepared and silent; from where to where in the core it sounds."""
    shared, effects, strings, bank = inside.shared, inside.effects, inside.strings, inside.built.bank
    for array in bank:
        memory.add(CONSTANT, array)
    for model in (*strings.models, *inside.built.flights):
        for array in arrays_of(model).values():
            memory.add(CONSTANT, array)
    for name in ("chains", "numbers", "counts"):
        memory.add(CONSTANT, getattr(effects, name))
    for placed in inside.chains.placed:
        for value in placed.made:
            if isinstance(value, np.ndarray):
                memory.add(CONSTANT, value)
    _add_tables(memory, inside)
    begin = memory.end(CORE)
    bridges = strings.bridges
    for array in sorted(inside.changing.values(), key=lambda each: not each.view(np.uint8).any()):
        memory.add(CORE, array)
    end = memory.end(CORE)
    if bridges.strings:
        for array in bridges.room.values():
            memory.add(CORE, array, content=np.zeros_like(array))
    for coupling in bridges.couplings:
        for name, array in arrays_of(coupling).items():
            if name.startswith(COUPLING_ROOM):
                memory.add(CORE, array, content=np.zeros_like(array))
            elif not name.startswith(COUPLING_CHANGES) and name not in _COUPLING_POINTS:
                memory.add(CONSTANT, array)
    for board, room in zip(strings.boards.items, strings.boards.rooms, strict=True):
        for name in CONSTANT_ARRAYS:
            memory.add(CONSTANT, getattr(board, name))
        for array in room:
            memory.add(CORE, array, content=np.zeros_like(array))
    for array in (shared.queue, shared.team, *inside.span):
        memory.add(CORE, array, content=np.zeros_like(array))
    fresh = new_scratch(bank)
    for array, content in zip(chain(*map(values, inside.scratch)), chain(values(fresh), values(fresh)), strict=True):
        memory.add(THREAD, array, content=content)
    return begin, end


#: arrays of a Coupling that hold addresses; the core itself puts those of the models there
_COUPLING_POINTS = ("lines.model", "lines.state", "lines.end")


def _add_tables(memory: Memory, inside: EngineMemory) -> None:
    """All that holds addresses."""
    strings = inside.strings
    thread = inside.thread.copy()
    memory.add(THREAD, inside.thread, points=pointers(thread, Scratch, Scratch), content=thread)
    core = inside.core.copy()
    memory.add(CORE, inside.core, points=pointers(core, *layout.CORE_PARTS), content=core)
    voices = inside.voices.copy()
    called = [word_of(Voices, name) for name in ("respond", "core", "thread")]
    memory.add(CORE, inside.voices, points=[*pointers(voices, *VOICE_PARTS), *called], content=voices)
    models = strings.model_tables.copy()
    step, words, points = word_of(StringModel, "step"), models.shape[2], []
    for number, row in enumerate(models.reshape(-1, words)):
        points += [number * words + each for each in (*pointers(row, StringModel), step)]
    memory.add(CORE, strings.model_tables, points=points, content=models)
    for table in strings.state_tables:
        content = table.copy()
        memory.add(CORE, table, points=pointers(content, StringState), content=content)
    for table in strings.bridges.end_tables:
        content = table.copy()
        memory.add(CORE, table, points=pointers(content, End), content=content)
    for table, coupling in zip(strings.bridges.coupling_tables, strings.bridges.couplings, strict=True):
        content = table.copy()
        memory.add(CORE, table, points=pointers(content, Coupling), content=content)
        memory.add(CORE, coupling.lines.model, content=np.zeros_like(coupling.lines.model))
        for array in (coupling.lines.state, coupling.lines.end):
            memory.add(CORE, array, points=range(array.size), content=array.copy())
    for table in strings.boards.tables:
        content = table.copy()
        memory.add(CORE, table, points=pointers(content, *BOARD_PARTS), content=content)
    for table, placed in zip(inside.effect_tables, inside.chains.placed, strict=True):
        content = table.copy()
        memory.add(CORE, table, points=pointers(content, type(placed.made), type(placed.at_rest)), content=content)
    for table in inside.excitations.tables:
        memory.add(CORE, table)
    placed_rows = inside.effects.placed
    assert placed_rows.dtype.names is not None and placed_rows.dtype.fields is not None
    width = placed_rows.dtype.itemsize // 8
    held = [placed_rows.dtype.fields[name][1] // 8 for name in ("table", "process", "silent")]
    memory.add(CORE, placed_rows, points=[row * width + word for row in range(placed_rows.size) for word in held])
    shared = inside.shared
    task = shared.task.copy()
    task[[layout.TASK, layout.FIRST_QUANTUM, layout.QUANTA, layout.UNTIL]] = 0
    memory.add(CORE, shared.task, points=range(layout.WORK_ON, layout.VOICES + 1), content=task)
    found = (shared.model_at, shared.string_at, shared.excitation, shared.coupling_at, shared.end_at, shared.board_at)
    for array in found:
        memory.add(CORE, array, points=range(array.size), content=array.copy())


def function_at(address: int) -> str | None:
    function = entered(address)
    return None if function is None else name_of(function)


def _places(memory: Memory, inside: EngineMemory) -> np.ndarray:
    state, sounding, shared = inside.state, inside.sounding, inside.shared

    def words(array: np.ndarray, first: int = 0, count: int = 1, stride: int = 8) -> tuple[int, int, int]:
        return memory.place(array) + 8 * first, stride, count

    def field(array: np.ndarray, name: str) -> tuple[int, int, int]:
        assert array.dtype.fields is not None
        return memory.place(array) + array.dtype.fields[name][1], array.itemsize, array.size

    found = {
        "core": words(inside.core),
        "until": words(shared.task, layout.UNTIL),
        "left": words(shared.team, team.LEFT),
        "sleeping": words(shared.team, team.SLEEPING),
        "ending": words(shared.team, team.ENDING),
        "workers": words(shared.team, team.WORKERS),
        "wake": words(shared.team, team.WAKE),
        "pending": words(state.counters, layout.PENDING),
        "notes": words(state.counters, layout.N_NOTES),
        "stolen": words(state.counters, layout.N_STOLEN),
        "dropped": words(state.counters, layout.N_DROPPED),
        "silenced": words(state.counters, layout.N_SILENCED),
        "peak": words(state.meters, layout.PEAK),
        "unplayed": words(state.unplayed, count=state.unplayed.size),
        "awake": field(sounding.voices, "awake"),
        "idle": field(sounding.voices, "idle"),
        "note": field(sounding.voices, "note"),
        "channel": field(sounding.voices, "channel"),
        "still": field(state.part_state, "still"),
        "silenced_strings": field(sounding.tallies, "silenced"),
        "silenced_parts": field(state.part_state, "silenced"),
        "programs": field(state.channels, "program"),
        "parameters": words(state.parameters, count=len(state.parameters), stride=8 * layout.N_PARAMETERS),
        "channels": words(state.channels, count=state.channels.nbytes // 8),
        "tuning": words(state.tuning, count=state.tuning.size),
        "zones": words(state.zones, count=state.zones.size),
        "part_channel": field(state.part_state, "channel"),
        "part_left": field(state.part_state, "left"),
        "part_right": field(state.part_state, "right"),
        "part_height": field(state.part_state, "height"),
    }
    return np.array([found[name] for name in PLACES], PLACE)


def recipe_of(path: Path) -> tuple[int, recipe.BankRecipe]:
    """Checksum of the bank in a file, which may stand behind a plugin, and its recipe. Raises OSError, and ValueError where
    there is none."""
    whole = path.read_bytes()
    begin = int.from_bytes(whole[-16:-8], "little") if whole[-8:] == library.FOOT else 0
    data = whole[begin:]
    if len(data) < HEADER.itemsize or data[: len(MAGIC)] != MAGIC:
        raise ValueError(f"{path}: does not contain a bank; export it again")
    header = np.frombuffer(data, HEADER, 1)[0]
    if header["version"] != VERSION:
        raise ValueError(f"{path}: its bank is of version {header['version']}, this program's {VERSION}; export it again")
    blank = header.copy()
    blank["checksum"] = 0
    end = int(header["tables_end"])
    if zlib.crc32(data[HEADER.itemsize : end], zlib.crc32(blank.tobytes())) != header["checksum"]:
        raise ValueError(f"{path}: its bank was changed (the checksum is wrong); export it again")
    at, size = int(header["recipe_at"]), int(header["recipe"])
    return int(header["checksum"]), recipe.read(data[at : at + size])
