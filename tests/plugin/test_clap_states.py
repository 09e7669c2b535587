"""What a host keeps of a plugin: later and other versions read it, damage is refused, and nothing is changed by that."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from synth.midi.events import NOTE_ON
from tests.engine.kit import BRIDGE, FREE
from tests.plugin import clapabi as abi
from tests.plugin.claphost import Host, Instance
from tests.plugin.clapkit import GAIN, PARTS, POSITION, hear, parameter_id, plugin_file, reference, truth

MAGIC = b"jawariP\n"
VALUES, SOUND, BANK, DRONE = 1, 2, 3, 4
CHORD = [(10, NOTE_ON, 0, 48, 100), (700, NOTE_ON, 0, 50, 60)]


@pytest.fixture(scope="module")
def clap(library_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return plugin_file(library_file, tmp_path_factory.mktemp("clap"))


@pytest.fixture
def host(clap: Path) -> Iterator[Host]:
    with Host(clap) as made:
        yield made


@pytest.fixture
def silent(host: Host) -> Instance:
    return host.instance()


def written(*sections: tuple[int, bytes], magic: bytes = MAGIC, form: int = 1) -> bytes:
    """A state as the plugin writes it."""
    body = b"".join(struct.pack("<IQ", kind, len(data)) + data for kind, data in sections)
    whole = magic + struct.pack("<IQ", form, 20 + len(body) + 4) + body
    return whole + struct.pack("<I", zlib.crc32(whole))


def values(**given: float) -> tuple[int, bytes]:
    rows = [(name.replace("__", "/").replace("_", ".").encode(), value) for name, value in given.items()]
    return VALUES, struct.pack("<I", len(rows)) + b"".join(
        struct.pack("<H", len(name)) + name + struct.pack("<d", value) for name, value in rows
    )


def sections_of(data: bytes) -> dict[int, bytes]:
    out, at = {}, 20
    while at < len(data) - 4:
        kind, size = struct.unpack_from("<IQ", data, at)
        out[kind] = data[at + 12 : at + 12 + size]
        at += 12 + size
    return out


def what_sounded(silent: Instance) -> tuple[tuple[int, bytes], tuple[int, bytes]]:
    """The sections of strings that ring and of a drone's place, as versions up to 0.20 wrote them.

    Of the first: the values that the engine had been told, its keys' pitches, its own head (magic, version, checksum, bank,
    rate, kernels, words, bytes) and a run of words.
    """
    count = len(silent.params)
    told = struct.pack(f"<I{count}d128d128x", count, *silent.values().values(), *[float("nan")] * 128)
    run = struct.pack("<IIqd", 5, 2, 1, 0.25)
    kept = struct.pack("<IId32sQQ", 0x12345678, 0, 44100.0, b"0123456789abcdef", 4000, len(run)) + run
    return (SOUND, told + b"JAWARISV" + struct.pack("<II", 1, zlib.crc32(kept)) + kept), (DRONE, bytes(8 * 27))


def test_values_are_kept(silent: Instance) -> None:
    rng = np.random.default_rng(0)
    wanted = {}
    for info in silent.params:
        value = info.initial if info.flags & abi.READONLY else float(rng.uniform(info.minimum, info.maximum))
        wanted[info.id] = round(value) if info.flags & abi.STEPPED else value
    silent.flush([abi.param(0, identity, value) for identity, value in wanted.items()])
    data = silent.save()
    assert silent.values() == wanted
    with silent.host.instance() as other:
        assert other.load(data)
        assert other.values() == wanted
        assert other.save() == data
    assert written(*sections_of(data).items()) == data  # as it is described


def test_parameters_of_other_versions(silent: Instance) -> None:
    """What this plugin does not have is passed over, what the state does not have is as at first, in any order, and values
    outside of a range that has become narrower are brought into it; so are whole sections of later versions."""
    gain, position = (parameter_id(silent, 0, each) for each in (GAIN, POSITION))
    silent.flush([abi.param(0, position, 0.11)])
    later = (77, b"whatever may come")
    assert silent.load(written(later, values(free__no_such=3.0, bypass=0.0, free__output_gain=0.5), later))
    assert silent.value(gain) == 0.5
    assert silent.value(position) == next(info.initial for info in silent.params if info.id == position)
    assert silent.load(written(values(free__output_gain=1e9, program=1.2)))
    assert (silent.value(gain), silent.value(silent.params[-2].id)) == (4.0, 1.0)
    assert silent.load(written())
    assert silent.values() == {info.id: info.initial for info in silent.params}


def test_what_is_no_state_is_refused_and_changes_nothing(host: Host) -> None:
    made = host.instance()
    gain = parameter_id(made, 0, GAIN)
    made.activate(44100.0)
    made.start()
    hear(made, CHORD, 3000)
    data = made.save()
    made.flush([abi.param(0, gain, 0.75)])
    before = made.values()
    engine = reference()
    truth(engine, CHORD, 3000)
    rng = np.random.default_rng(2)
    bad = [data[:size] for size in (0, 1, 7, 8, 19, 20, 23, 24, 31, 100, len(data) // 2, len(data) - 1)]
    for place in (*range(24), *rng.integers(24, len(data), 60)):
        changed = bytearray(data)
        changed[place] ^= 1 << int(rng.integers(8))
        bad.append(bytes(changed))
    bad += [b"GIF89a" + data[6:], rng.bytes(5000), written(values(free__output_gain=0.1), form=2)]
    bad += [written(values(free__output_gain=float(value))) for value in ("nan", "inf")]
    right = values(free__output_gain=0.1)[1]
    for size in range(len(right)):
        bad.append(written((VALUES, right[:size])))
    bad.append(written((VALUES, struct.pack("<I", 0xFFFFFFFF) + right[4:])))
    refused = len(made.logged)
    for each in bad:
        assert not made.load(each)
        refused += 1
        assert len(made.logged) == refused and len(made.logged[-1]) > 20
    assert made.values() == before
    from synth.midi.events import PARAMETER

    np.testing.assert_array_equal(hear(made, [], 3000), truth(engine, [(0, PARAMETER, 0, GAIN, 0, 0.75)], 3000))
    assert made.load(data + b"padding of a host")


@pytest.mark.parametrize("harm", [lambda data: data, lambda data: data[:-9], lambda data: data[:40] + b"\xff" + data[41:]])
def test_a_state_with_ringing_strings_is_read_for_its_values(host: Host, harm) -> None:
    """As versions up to 0.20 wrote them. What sounded is passed over, whatever it is, and sounds no more here either."""
    made = host.instance()
    gain = parameter_id(made, 0, GAIN)
    sound, drone = what_sounded(made)
    data = written((BANK, b"collection"), values(free__output_gain=0.25), (SOUND, harm(sound[1])), drone)
    made.activate(44100.0)
    made.start()
    hear(made, CHORD, 3000)
    assert made.load(data) and made.value(gain) == 0.25
    assert not hear(made, [], 3000)[133:].any()
    with host.instance() as other:
        assert other.load(data) and other.values() == made.values() and SOUND not in sections_of(other.save())
    assert not made.load(data[:-4]) and not made.load(data[:200] + b"\0" + data[201:])


def test_a_state_of_another_plugin_with_nothing_in_common_is_refused(host: Host) -> None:
    made = host.instance()
    gain = parameter_id(made, 0, GAIN)
    made.flush([abi.param(0, gain, 0.5)])
    before = made.values()
    other = values(elsewhere__output_gain=0.1, program=1.0, bypass=1.0)
    assert not made.load(written((BANK, b"elsewhere"), other))
    assert "another plugin (elsewhere" in made.logged[-1] and made.values() == before
    program = made.params[-2].id
    made.flush([abi.param(0, program, 2.0)])
    # where there is something in common, all but the program: it numbers the other's presets
    assert made.load(written((BANK, b"elsewhere"), values(free__output_gain=0.25, program=1.0, bypass=1.0)))
    assert (made.value(gain), made.value(program), made.value(made.params[-1].id)) == (0.25, 0.0, 1.0)
    assert made.load(written((BANK, b"collection"), other))  # of its own, as it was when it had another preset
    assert made.value(program) == 1.0


def test_states_of_another_plugin(host: Host, library_file: Path, tmp_path: Path) -> None:
    """Presets are known by their ids, wherever they stand."""
    made = host.instance()
    gain, position = parameter_id(made, 0, GAIN), parameter_id(made, 1, POSITION)
    made.flush([abi.param(0, gain, 0.5), abi.param(0, position, 0.25)])
    data = made.save()
    parts = (BRIDGE, FREE)
    with Host(plugin_file(library_file, tmp_path, parts)) as another:
        other = another.instance()
        assert [info.id for info in made.params[:5]] == [parameter_id(other, 1, k, parts) for k in range(5)]
        assert other.load(data)
        assert (other.value(gain), other.value(position)) == (0.5, 0.25)
    assert len(PARTS) == 3
