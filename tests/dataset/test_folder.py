"""A data set on the disk: whole, regenerated to the bit, gone on with, refused, read by others."""

from __future__ import annotations

import errno
import glob
import hashlib
import io
import json
import os
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest
import soundfile

import synth
from synth.dataset import crew, filling
from synth.dataset.crew import Maker
from synth.dataset.filling import fill
from synth.dataset.items import Items
from synth.dataset.packing import decode, digest
from synth.dataset.setfolder import SetFolder
from synth.dataset.shardfile import read_member
from synth.dataset.verifying import verify
from synth.host.alone import BLOCK
from synth.host.batch import Note
from synth.midi.events import EVENT, NOTE_OFF, NOTE_ON, PARAMETER, make_events
from synth.workers import WorkerPool
from tests.dataset.kit import NOTES, Deadly, files, rows, written
from tests.host.midibytes import header, off, on, track


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set of 16 notes by one worker."""
    place = tmp_path_factory.mktemp("made")
    told = fill(written(place), place / "set")
    assert (told.items, told.made, told.errors) == (16, 16, 0) and told.seconds == pytest.approx(16 * 0.2)
    return place / "set"


def test_index_shards_and_sounds_agree(made: Path) -> None:
    index = rows(made)
    assert len({row["key"] for row in index}) == 16 and not any(row["error"] for row in index)
    for row in index:
        flac = read_member(made / row["shard"], row["offset"], row["size"])
        pcm, rate_hz = soundfile.read(io.BytesIO(flac), dtype="int32", always_2d=True)
        assert hashlib.sha256(pcm.tobytes()).hexdigest() == row["sha256"]
        assert (rate_hz, len(pcm), pcm.shape[1]) == (44100, row["frames"], 1) and row["seconds"] == pytest.approx(0.2)
        heard = np.abs(pcm / 2.0**31)
        assert 20 * np.log10(heard.max()) == pytest.approx(row["peak_dbfs"], abs=1e-4)
        assert heard[: int(row["onset_s"] * rate_hz)].max(initial=0.0) < 0.0101 * heard.max()
        said = json.loads(read_member(made / row["shard"], row["json_offset"], row["json_size"]))
        assert said == {name: value for name, value in row.items() if name in said} and said["seed"] == row["seed"]
        assert row["split"] == row["shard"].partition("/")[0] and row["fret"] == "0"
        assert row["f0_hz"] == pytest.approx(440.0 * 2.0 ** ((row["note"] - 69) / 12.0))


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # it closes no shard
def test_webdataset_reads_it(made: Path) -> None:
    webdataset = pytest.importorskip("webdataset", reason="is in the extra `test`")
    found = {}
    for split in ("train", "validation", "test"):
        urls = sorted(glob.glob(f"{made}/{split}/shard-*.tar"))
        for sample in webdataset.WebDataset(urls, shardshuffle=False):
            found[sample["__key__"]] = (split, decode(sample["flac"])[0], json.loads(sample["json"]))
    index = {row["key"]: row for row in rows(made)}
    assert found.keys() == index.keys()
    for key, (split, pcm, said) in found.items():
        assert (split, digest(pcm), said["note"]) == (index[key]["split"], index[key]["sha256"], index[key]["note"])


def test_an_item_is_the_note_by_the_engine(made: Path) -> None:
    """The same note as an engine that knows no data sets plays it, rounded to 24 bits."""
    row = rows(made)[0]
    preset = synth.load_preset("jawari-harp").with_setting("pluck.width_mm", str(row["set.pluck.width_mm"]))
    engine = synth.Engine([preset], quality="draft", limiter=False, seed=row["seed"], only_notes=[{row["note"]}])
    engine.prepare(44100.0, BLOCK)
    events = make_events([
        (0, PARAMETER, 0, 1, 0, row["live.pluck.position"]),
        (0, NOTE_ON, 0, row["note"], row["velocity"]),
        (round(0.15 * 44100), NOTE_OFF, 0, row["note"], 64),
    ])  # fmt: skip
    out = np.zeros((row["frames"] + engine.latency_samples, 2))
    engine.process(events, out)
    heard = out[engine.latency_samples :].mean(axis=1)
    pcm, _ = decode(read_member(made / row["shard"], row["offset"], row["size"]))
    assert np.array_equal(pcm[:, 0] >> 8, np.rint(heard * 2.0**23).astype(np.int32)) and np.abs(heard).max() > 1e-3


def test_neither_workers_nor_shards_nor_order_change_a_bit(made: Path, tmp_path: Path) -> None:
    two = tmp_path / "two"
    fill(written(tmp_path), two, workers=2)
    ours, theirs = files(made), files(two)
    assert {name: data for name, data in ours.items() if name.endswith(".tar")} == {
        name: data for name, data in theirs.items() if name.endswith(".tar")}  # fmt: skip
    assert rows(made) == rows(two)
    other = tmp_path / "other"
    fill(written(tmp_path, NOTES.replace("items = 5", "items = 16\nshuffled = false")), other)
    assert {row["key"]: row["sha256"] for row in rows(other)} == {row["key"]: row["sha256"] for row in rows(made)}


def test_one_item_alone_is_the_same(made: Path) -> None:
    folder = SetFolder(made)
    written_ = folder.written()
    for row in rows(made)[::5]:
        item = Maker(written_).make(row["key"])  # an engine of its own each time
        assert item.flac == read_member(made / row["shard"], row["offset"], row["size"])


def test_it_is_verified_and_what_is_changed_is_found(made: Path, tmp_path: Path) -> None:
    found = verify(SetFolder(made), 6, seed=1)
    assert (found.items, found.faults, found.other_code) == (6, (), False)
    broken = tmp_path / "broken"
    shutil.copytree(made, broken)
    row = rows(broken)[0]
    data = bytearray((broken / row["shard"]).read_bytes())
    data[row["offset"] + row["size"] // 2] ^= 0x55
    (broken / row["shard"]).write_bytes(data)
    faults = verify(SetFolder(broken), 16).faults
    assert faults and all(fault.startswith(row["key"]) for fault in faults)
    (broken / row["shard"]).write_bytes(data[:2000])
    assert f"{row['shard']}: ends before byte" in " ".join(verify(SetFolder(broken), 1).faults)
    (broken / row["shard"]).unlink()
    assert f"{row['shard']}: is missing" in verify(SetFolder(broken), 1).faults


def test_what_was_interrupted_goes_on_and_computes_nothing_twice(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Enough(Exception):
        pass

    def until(done: int, total: int) -> None:
        if done == 12:
            raise Enough

    with pytest.raises(Enough):
        fill(written(tmp_path), tmp_path / "set", progress=until)
    folder = SetFolder(tmp_path / "set")
    whole = [path.name for path in (tmp_path / "set" / "parts").iterdir()]
    assert folder.begun and not folder.whole and whole
    assert len(list((tmp_path / "set").rglob("*.tar"))) == len(whole) and not list((tmp_path / "set").rglob(".*.part"))
    again = []
    real = Maker.make
    monkeypatch.setattr(Maker, "make", lambda self, key, notes=(): again.append(key) or real(self, key, notes))
    times = {path: path.stat().st_mtime_ns for path in (tmp_path / "set").rglob("*.tar")}
    told = fill(written(tmp_path), tmp_path / "set")
    assert told.made == len(again) == len(set(again)) < 16 and times.items() == {
        path: path.stat().st_mtime_ns for path in times}.items()  # fmt: skip
    ours, theirs = files(made), files(tmp_path / "set")
    assert rows(made) == rows(tmp_path / "set") and {k: v for k, v in ours.items() if k.endswith(".tar")} == {
        k: v for k, v in theirs.items() if k.endswith(".tar")}  # fmt: skip
    assert fill(written(tmp_path), tmp_path / "set").made == 0


@pytest.fixture
def pools(monkeypatch: pytest.MonkeyPatch) -> list[WorkerPool]:
    """The pools of workers that are begun."""
    begun: list[WorkerPool] = []
    monkeypatch.setattr(crew, "WorkerPool", lambda *arguments: begun.append(WorkerPool(*arguments)) or begun[-1])
    return begun


def test_a_killed_worker_is_replaced_and_nothing_is_lost(made: Path, tmp_path: Path, pools: list[WorkerPool]) -> None:
    killed: list[int] = []

    def kill(done: int, total: int) -> None:
        if done == 1:
            killed.extend(each.process.pid for each in pools[0]._workers if each is not None)
            os.kill(killed[0], signal.SIGKILL)

    told = fill(written(tmp_path), tmp_path / "set", workers=2, progress=kill)
    assert len(killed) == 2 and told.errors == 0 and rows(tmp_path / "set") == rows(made)


def test_an_item_that_kills_two_workers_is_a_row_with_an_error(
    made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(crew, "Maker", Deadly)
    told = fill(written(tmp_path), tmp_path / "set", workers=2)
    assert told.errors == 1
    for row, whole in zip(rows(tmp_path / "set"), rows(made), strict=True):
        assert (row["key"], row["sha256"]) == (whole["key"], None if row["error"] else whole["sha256"])
        assert row["error"] == ("its worker died twice (exit code 7); out of memory, or killed" if row["error"] else "")
        assert bool(row["error"]) == (row["key"] == "n0-00000003")


def test_a_broken_item_is_a_row_with_its_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = NOTES + '[[notes]]\npreset = "jawari-harp"\nnote = "C3"\nhold_s = 0.1\nrelease_s = 0.0\n' + (
        'set."obstacle.distance_ratio" = [0.007, 2.0]\n')  # fmt: skip
    told = fill(written(tmp_path, text), tmp_path / "set")
    wrong = [row for row in rows(tmp_path / "set") if row["error"]]
    assert told.items == 18 and [row["key"] for row in wrong] == ["n1-00000001"] and "\n" not in wrong[0]["error"]
    assert wrong[0]["shard"] is None and wrong[0]["set.obstacle.distance_ratio"] == 2.0
    assert "1 items have no sound" in (tmp_path / "set" / "README.md").read_text()
    assert verify(SetFolder(tmp_path / "set"), 18).faults == ()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("hold_s = 0.15", "hold_s = 0.16"), "notes.0.hold_s changed: 0.15 there, 0.16 here"),
        (("items = 5", "items = 6"), "shards.items changed: 5 there, 6 here"),
    ],
)
def test_another_recipe_is_refused_with_the_remedy(made: Path, tmp_path: Path, change: tuple[str, str], said: str) -> None:
    before = files(made)
    with pytest.raises(
        ValueError, match=rf"contains a data set made from another recipe .{said}.; name another folder with -o, or remove"
    ):
        fill(written(tmp_path, NOTES.replace(*change)), made)
    assert files(made) == before


def test_what_is_only_said_may_change(made: Path, tmp_path: Path) -> None:
    copy = tmp_path / "set"
    shutil.copytree(made, copy)
    recipe = written(
        tmp_path, NOTES, 'format = 1\ntitle = "Better"\nlicence = "CC-BY-4.0"\nseed = 7\n[sound]\nquality = "draft"\n'
    )
    assert fill(recipe, copy).made == 0
    card = (copy / "README.md").read_text()
    assert "# Better" in card and 'license: "CC-BY-4.0"' in card and "No item failed." in card


def test_other_code_does_not_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = SetFolder(tmp_path / "set")
    folder.make()
    folder.begin(recipe := written(tmp_path), items := Items(recipe))
    monkeypatch.setattr("synth.dataset.setfolder.code", lambda: "0" * 64)
    with pytest.raises(ValueError, match=r"was started with other code .* of one data set come from one version"):
        folder.begin(recipe, items)


def test_a_full_disk_says_so_and_what_is_whole_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, written_shards = filling.write_shard, []

    def write_shard(path, members):
        if written_shards:
            raise OSError(errno.ENOSPC, "No space left on device; make room there or write elsewhere", str(path))
        written_shards.append(path)
        return real(path, members)

    monkeypatch.setattr(filling, "write_shard", write_shard)
    with pytest.raises(OSError, match=r"No space left"):
        fill(written(tmp_path), tmp_path / "set")
    monkeypatch.setattr(filling, "write_shard", real)
    told = fill(written(tmp_path), tmp_path / "set")
    assert 0 < told.made < 16 and verify(SetFolder(tmp_path / "set"), 16).faults == ()


def test_folders_that_cannot_be(tmp_path: Path) -> None:
    recipe = written(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(NotADirectoryError, match=r"is a file"):
        fill(recipe, tmp_path / "file")
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("")
    with pytest.raises(ValueError, match=r"contains other files .thesis.txt."):
        fill(recipe, tmp_path / "mine")
    with pytest.raises(FileNotFoundError, match=r"there is no directory"):
        fill(recipe, tmp_path / "nowhere" / "set")
    with pytest.raises(ValueError, match=r"is not the folder of a data set"):
        verify(SetFolder(tmp_path / "mine"), 1)
    folder = SetFolder(tmp_path / "set")
    folder.make()
    with folder.locked(), pytest.raises(ValueError, match=r"another run is writing there"):
        fill(recipe, tmp_path / "set")


LOUD = """\
[level]
gain_db = 20.0
[[notes]]
preset = "jawari-harp"
note = "C4"
velocity = [1, 127]
hold_s = 0.1
release_s = 0.0
"""


def test_nothing_is_clipped(tmp_path: Path) -> None:
    fill(written(tmp_path, LOUD), tmp_path / "set")
    soft, loud = sorted(rows(tmp_path / "set"), key=lambda row: row["velocity"])
    assert loud["lowered"] and loud["peak_dbfs"] == pytest.approx(-0.1) and loud["gain_db"] < 20.0
    assert not soft["lowered"] and soft["gain_db"] == pytest.approx(20.0) and soft["peak_dbfs"] < -0.1
    pcm, _ = decode(read_member(tmp_path / "set" / loud["shard"], loud["offset"], loud["size"]))
    assert np.abs(pcm).max() / 2.0**31 == pytest.approx(10 ** (-0.1 / 20), rel=1e-6)
    each = LOUD.replace("gain_db = 20.0", "normalize_dbfs = -3.0") + "repeats = 2\n"
    fill(written(tmp_path, each), tmp_path / "each")
    assert all(row["peak_dbfs"] == pytest.approx(-3.0) and not row["lowered"] for row in rows(tmp_path / "each"))


def test_sixteen_bits_two_channels_and_a_phrase(tmp_path: Path) -> None:
    text = """\
bit_depth = 16
channels = 2
[[phrases]]
name = "two"
preset = "jawari-harp"
release_s = 0.1
stroke = [{ at_s = 0.0, note = "C4", hold_s = 0.1 }, { at_s = 0.1, note = "G4", velocity = 40, hold_s = 0.1 }]
"""
    fill(written(tmp_path, text), tmp_path / "set")
    (row,) = rows(tmp_path / "set")
    pcm, _ = decode(read_member(tmp_path / "set" / row["shard"], row["offset"], row["size"]))
    assert (
        pcm.dtype == np.int16 and pcm.shape == (round(0.3 * 44100), 2) and row["string"] == "C4+G4" and row["note"] is None
    )
    assert not np.array_equal(pcm[:, 0], pcm[:, 1])  # dither of its own
    song = [(0, NOTE_ON, 0, 60, 100), (4410, NOTE_OFF, 0, 60, 64), (4410, NOTE_ON, 0, 67, 40), (8820, NOTE_OFF, 0, 67, 64)]
    heard = synth.render(
        make_events(song), "jawari-harp", quality="draft", limiter=False, end_s=0.3, seed=row["seed"]
    ).samples
    assert np.abs(pcm / 2.0**15 - heard).max() <= 1.5 / 2**15 and np.abs(heard).max() > 0.01


def test_midi_files_and_own_presets_lie_in_the_data_set(tmp_path: Path) -> None:
    """It is made again from its own copies, whatever becomes of the files."""
    (tmp_path / "songs").mkdir()
    for name, key in (("a", 60), ("b", 64)):
        (tmp_path / "songs" / f"{name}.mid").write_bytes(header() + track((0, on(key, 90)), (48, off(key))))
    own = synth.instrument.preset.preset_folder() / "jawari-harp"
    shutil.copy(own.with_suffix(".toml"), tmp_path / "mine.toml")
    shutil.copy(own.with_suffix(".plan"), tmp_path / "mine.plan")
    text = '[[midi]]\nfiles = "songs/*.mid"\npreset = "mine.toml"\ntranspose = [0, 12]\nrelease_s = 0.1\n'
    fill(written(tmp_path, text), tmp_path / "set")
    index = rows(tmp_path / "set")
    assert len(index) == 4 and {row["file"] for row in index} == {"songs/a.mid", "songs/b.mid"} and not any(
        row["error"] for row in index)  # fmt: skip
    assert len({row["group"] for row in index}) == 2
    shutil.rmtree(tmp_path / "songs")
    (tmp_path / "mine.toml").unlink()
    assert verify(SetFolder(tmp_path / "set"), 4).faults == ()


def test_a_changed_preset_is_another_data_set(tmp_path: Path) -> None:
    own = synth.instrument.preset.preset_folder() / "jawari-harp.toml"
    (tmp_path / "mine.toml").write_bytes(own.read_bytes())
    recipe = written(tmp_path, '[[notes]]\npreset = "mine.toml"\nnote = "C4"\nhold_s = 0.1\n')
    folder = SetFolder(tmp_path / "set")
    folder.make()
    folder.begin(recipe, Items(recipe))
    (tmp_path / "mine.toml").write_bytes(own.read_bytes() + b"\n# another\n")
    with pytest.raises(ValueError, match=r"was started with another mine.toml; name another folder"):
        folder.begin(recipe, Items(recipe))


def test_a_seed_given_at_reset_is_the_engines() -> None:
    """To the bit the engine that was made with it."""
    koto = synth.load_preset("koto")

    def sound(engine: synth.Engine) -> np.ndarray:
        out = np.zeros((4000, 2))
        engine.process(make_events([(0, NOTE_ON, 0, 55, 90)]), out)
        return out

    engines = [synth.Engine([koto], quality="draft", seed=seed, only_notes=[{55}]) for seed in (0, 5)]
    for engine in engines:
        engine.prepare(44100.0)
    zero, five = (sound(engine) for engine in engines)
    assert not np.array_equal(zero, five)
    engines[0].reset(5)
    assert np.array_equal(sound(engines[0]), five) and engines[0].settings.seed == 5
    engines[0].reset(0)
    assert np.array_equal(sound(engines[0]), zero)
    with pytest.raises(ValueError, match=r"seed must be at least 0"):
        engines[0].reset(-1)
    assert engines[0].struck == [(0, 0)] or len(engines[0].struck) == 1


def test_an_own_note_off_at_once_follows_its_note_on() -> None:
    from synth.host.alone import events_of

    found = events_of([(0.1, Note(60, 90, 1.0, 0.0)), (0.0, Note(62, 90, 1.0, 0.1))], [(7, 40)], 1000)
    assert found.dtype == EVENT
    assert found[["frame", "a"]].tolist() == [(0, 7), (0, 62), (100, 62), (100, 60), (100, 60)]
    assert found["kind"].tolist()[2:] == [NOTE_OFF, NOTE_ON, NOTE_OFF]
