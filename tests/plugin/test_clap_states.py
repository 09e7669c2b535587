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
VALUES, SOUND, BANK = 1, 2, 3
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
    kept = sections_of(data)
    for size in (0, 3, 4, 12, 200, 1000):
        bad.append(written((VALUES, kept[VALUES]), (SOUND, kept[SOUND][:size])))
    refused = len(made.logged)
    for each in bad:
        assert not made.load(each)
        refused += 1
        assert len(made.logged) == refused and len(made.logged[-1]) > 20
    assert made.values() == before
    from synth.midi.events import PARAMETER

    np.testing.assert_array_equal(hear(made, [], 3000), truth(engine, [(0, PARAMETER, 0, GAIN, 0, 0.75)], 3000))
    assert made.load(data + b"padding of a host")


def test_sound_that_is_damaged_is_refused(host: Host) -> None:
    """Even where the state's own checksum is right; values stay, and what sounded goes on."""
    made = host.instance()
    made.activate(44100.0)
    made.start()
    hear(made, [(10, NOTE_ON, 0, 48, 100)], 3000)
    kept = sections_of(made.save())
    engine = reference()
    truth(engine, CHORD, 3000)
    rng = np.random.default_rng(3)
    first = len(kept[SOUND]) - len(made_sound(kept))
    other = host.instance()
    other.activate(44100.0)
    other.start()
    hear(other, CHORD, 3000)
    before = other.values()
    # all but the two numbers by which it may be another version's, or of another bank
    places = [*range(first, first + 8), *(first + rng.integers(48, len(made_sound(kept)), 30)).tolist()]
    for place in places:
        sound = bytearray(kept[SOUND])
        sound[place] ^= 1 << int(rng.integers(8))
        assert not other.load(written(values(free__output_gain=0.5), (SOUND, bytes(sound)))), place
        assert "was changed since it was saved" in other.logged[-1] and other.values() == before
        np.testing.assert_array_equal(hear(other, [], 300), truth(engine, [], 300))


def test_a_forged_sound_is_refused(host: Host) -> None:
    """Both checksums right, one number wrong: the frames that are computed are no whole quanta."""
    made = host.instance()
    made.activate(44100.0)
    made.start()
    hear(made, CHORD, 3200)
    kept = sections_of(made.save())
    sound = bytearray(kept[SOUND])
    at = len(sound) - len(made_sound(kept))
    place = sound.index(struct.pack("<q", 3200), at + 80)
    sound[place : place + 8] = struct.pack("<q", -100000)
    sound[at + 12 : at + 16] = struct.pack("<I", zlib.crc32(bytes(sound[at + 16 :])))
    before = made.values()
    assert not made.load(written((VALUES, kept[VALUES]), (SOUND, bytes(sound))))
    assert "counters must lie between 0 and" in made.logged[-1] and made.values() == before
    assert made.load(written((VALUES, kept[VALUES]), (SOUND, kept[SOUND])))


def test_sound_of_another_rate_is_left_out(host: Host) -> None:
    made = host.instance()
    made.activate(44100.0)
    made.start()
    hear(made, [(10, NOTE_ON, 0, 48, 100)], 3000)
    other = host.instance()
    other.activate(48000.0)
    other.start()
    assert other.load(made.save())
    assert not hear(other, [], 2000).any()


def test_sound_of_another_version_is_left_out(host: Host) -> None:
    """The values are taken, and what sounded goes on."""
    made = host.instance()
    gain = parameter_id(made, 0, GAIN)
    made.activate(44100.0)
    made.start()
    engine = reference()
    truth(engine, CHORD, 3000)
    hear(made, CHORD, 3000)
    kept = sections_of(made.save())
    sound = bytearray(kept[SOUND])
    at = len(sound) - len(made_sound(kept))
    sound[at + 8] += 1
    assert made.load(written(values(free__output_gain=1.0), (SOUND, bytes(sound))))
    assert made.value(gain) == 1.0
    np.testing.assert_array_equal(hear(made, [], 300), truth(engine, [], 300))


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


def test_what_was_loaded_sounds_after_a_reset(host: Host) -> None:
    made, other = host.instance(), host.instance()
    for each in (made, other):
        each.activate(44100.0)
        each.start()
    hear(made, CHORD, 3000)
    assert other.load(made.save())
    other.reset()
    np.testing.assert_array_equal(hear(other, [], 2000), hear(made, [], 2000))


def made_sound(kept: dict[int, bytes]) -> bytes:
    """The engine's own bytes of a sound."""
    (count,) = struct.unpack_from("<I", kept[SOUND])
    return kept[SOUND][4 + 8 * count + 9 * 128 :]


def test_states_of_another_plugin(host: Host, library_file: Path, tmp_path: Path) -> None:
    """Presets are known by their ids, wherever they stand; what sounds belongs to one bank."""
    made = host.instance()
    gain, position = parameter_id(made, 0, GAIN), parameter_id(made, 1, POSITION)
    made.flush([abi.param(0, gain, 0.5), abi.param(0, position, 0.25)])
    made.activate(44100.0)
    made.start()
    hear(made, CHORD, 2000)
    data = made.save()
    parts = (BRIDGE, FREE)
    with Host(plugin_file(library_file, tmp_path, parts)) as another:
        other = another.instance()
        assert [info.id for info in made.params[:5]] == [parameter_id(other, 1, k, parts) for k in range(5)]
        other.activate(44100.0)
        other.start()
        assert other.load(data)
        assert (other.value(gain), other.value(position)) == (0.5, 0.25)
        assert not other.process([], 2000).any()
    assert len(PARTS) == 3
