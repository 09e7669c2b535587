"""Studies: rows, addresses, what failures and kills leave, and the finished table."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import synth.study.work.running as running
from synth.cli import main
from synth.cli.counting import RowsLine
from synth.instrument.preset import list_presets, preset_folder
from synth.study import columns, sweeping
from synth.study.addressing import Addresses
from synth.study.conducting import Counts
from synth.study.design import Design, spread
from synth.study.drawing import pareto
from synth.study.keeping import AddressSet, Folder
from synth.study.remote import Remote
from synth.study.showing import standing
from synth.study.studyfile import StudyError, read_study
from synth.study.values import Draw, Range
from synth.units import duration
from synth.workers import Here, Killed
from tests.patience import until

TOOLS = Path(__file__).resolve().parents[1] / "tools"
STUDIES = preset_folder() / "studies"
ROWS = """
import os, signal, time
import numpy as np

def square(settings):
    if settings["x"] == 3:
        raise ValueError("three is no number")
    return {"y": settings["x"] ** 2, "list": [settings["x"]], "sound": np.arange(3.0) * settings["x"], "cpu": time.time()}

def deadly(settings):
    if settings["x"] == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"y": 1.0}

def nap(settings):
    time.sleep(settings["seconds"])
    return {"y": settings["x"] / 7}

def hungry(settings):
    held = np.ones(settings["x"] << 17)  # so many MiB
    if settings["x"] > 1000:
        time.sleep(60)
    return {"y": held[0] * settings["x"]}

def named(settings):
    return {"length": len(settings["case"] + settings["preset"])}

def picky(settings, reference=None):
    if reference is None and settings["x"] == 2:
        raise ValueError("two has no reference")
    return {"y": settings["x"]}

def against(settings, reference=None):
    if settings["x"] == "reference":
        return {"runs": 1, "signal": np.ones(4)}
    return {"distance": float(np.sum(reference["arrays"]["signal"]) - settings["x"])}
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    (folder / "study_rows.py").write_text(ROWS)
    sys.path.insert(0, str(folder))
    return folder


def called(function: str, x: Any, **more: Any) -> dict[str, Any]:
    return {"base": {"call": f"study_rows:{function}", **more.pop("base", {})}, "grid": {"x": x}, **more}


# --- what a study asks for ----------------------------------------------------------------------------------


def test_ranges() -> None:
    assert Range.model_validate({"from": 1, "to": 2, "step": 0.25}).values() == [1.0, 1.25, 1.5, 1.75, 2.0]
    assert Range.model_validate({"from": 4, "to": 0, "step": -2}).values() == [4, 2, 0]
    logarithmic = Range.model_validate({"from": 1, "to": 1000, "count": 4, "spacing": "log"}).values()
    np.testing.assert_allclose(logarithmic, [1, 10, 100, 1000], rtol=1e-14)
    assert Range.model_validate({"from": 1, "to": 3, "count": 9, "whole": True}).values() == [1, 2, 3]


@pytest.mark.parametrize("sampler", ["random", "latin-hypercube", "sobol"])
def test_draws_are_the_same_again_and_lie_where_they_should(sampler: str) -> None:
    table = {
        "count": 256, "seed": 3, "sampler": sampler,
        "parameters": {"a": {"uniform": [2, 4]}, "b": {"loguniform": [1, 100]}, "c": {"normal": [5, 2]},
                       "d": {"integers": [1, 3]}, "e": {"choice": ["x", "y"]}},
    }  # fmt: skip
    first, again = (Draw.model_validate(table).samples() for _ in range(2))
    other = Draw.model_validate(table | {"seed": 4}).samples()
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert not np.array_equal(first["a"], other["a"])
    assert first["a"].min() >= 2 and first["a"].max() <= 4
    # even samplers are nearer to the middles than chance has it: 0.577 / 16 and 9.2 / 16 would be one standard error
    even = 1.0 if sampler == "random" else 0.1
    assert abs(first["a"].mean() - 3.0) < 4 * even * 0.577 / 16
    assert abs(np.log(first["b"]).mean() - math.log(10.0)) < 4 * even * 1.33 / 16
    assert abs(first["c"].mean() - 5.0) < 4 * even * 2.0 / 16
    assert set(first["d"].tolist()) == {1, 2, 3} and set(first["e"]) == {"x", "y"}


def test_rows_of_blocks_in_order() -> None:
    study, _, _ = read_study(
        {
            "base": {"call": "a:b", "set": {"modes": 9, "k": 0}},
            "grid": {"x": [1, 2], "y": [3, 4]},
            "block": [
                {"zip": {"x": [5, 6], "z": ["p", "q"]}, "set": {"run.modes": 7}},
                {"draw": {"count": 2, "seed": 0, "parameters": {"x": {"integers": [1, 9]}}}},
            ],
        }
    )
    design = Design(study)
    rows = list(design)
    assert len(design) == len(rows) == 8 and rows == [design.row(k) for k in range(8)]
    assert rows[:4] == [{"modes": 9, "k": 0, "x": x, "y": y} for x in (1, 2) for y in (3, 4)]
    assert rows[5] == {"k": 0, "run.modes": 7, "x": 6, "z": "q"}
    assert all(isinstance(row["x"], int) for row in rows[6:])
    assert spread(8, 3) == [0, 4, 7] and spread(2, 3) == [0, 1]


def test_millions_of_rows_are_made_one_by_one() -> None:
    study, _, _ = read_study(called("nap", {"from": 0, "to": 999, "step": 1}) | {"zip": {"z": list(range(1000))}})
    design = Design(study)
    assert len(design) == 1_000_000 and design.row(123_456) == {"x": 123, "z": 456}


def test_a_reference_follows_what_is_asked_and_not_how() -> None:
    study, _, _ = read_study(
        {
            "base": {"case": "tanpura", "set": {"duration_s": 0.1}},
            "grid": {"scheme": ["exact-hold", "moreau-jean"], "modes": [10, 20], "initial.displacement_m": [1e-3, 2e-3]},
            "reference": {"set": {"internal_rate_hz": 352800, "modes": 100}},
            "measures": ["e"],
        }
    )
    design = Design(study)
    found = [design.reference(row) for row in design]
    assert {json.dumps(each, sort_keys=True) for each in found} == {
        json.dumps(
            {"duration_s": 0.1, "initial.displacement_m": d, "internal_rate_hz": 352800, "modes": 100}, sort_keys=True
        )
        for d in (1e-3, 2e-3)
    }


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"grid": {"x": []}}, "grid.x: "),
        ({"grid": {"x": {"from": 0, "to": 1}}}, "grid.x: give either count or step"),
        ({"grid": {"x": {"from": 0, "to": 1, "count": 2, "spacing": "log"}}}, "more than 0 for spacing log, got 0 and 1"),
        ({"grid": {"x": 3}}, "grid.x: "),
        ({"grid": {"x": [1, 1]}}, "grid.x has 1 twice"),
        ({"zip": {"a": [1, 2], "b": [1]}}, "lists of one length, got a 2, b 1"),
        ({"grid": {"modes": [1]}, "set": {"run.modes": 2}}, "set the same parameter"),
        ({"measures": ["loudnes"]}, "no measure 'loudnes'"),
        ({"measures": ["e"]}, "e compares with a reference"),
        ({"measures": [{"measure": "peak", "options": {"side": 1}}]}, "has no option 'side'; it has output"),
        ({"measures": ["peak", "peak"]}, "two are called 'peak'"),
        ({"base": {}}, "base: missing"),
        ({"base": {"case": "tanpura", "preset": "tanpura"}}, "give one of case, preset and call"),
        ({"colour": "red"}, "colour: no such key"),
        ({"draw": {"count": 4, "seed": 1, "parameters": {"x": {"uniform": [2, 1]}}}}, "must rise"),
    ],
)
def test_what_is_wrong_is_said_with_its_key(change: dict[str, Any], told: str) -> None:
    with pytest.raises(StudyError) as raised:
        read_study({"base": {"case": "tanpura"}, "measures": ["peak"], **change})
    assert told in str(raised.value) and str(raised.value).startswith("study: ")


def test_all_that_is_wrong_is_said_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bad.toml"
    path.write_text('mesures = ["e"]\nbase.case = "tanpura"\ngrid.x = { from = 1, to = 2 }\n')
    assert main(["sweep", str(path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2 and all(f"{path}: " in line for line in lines)
    path.write_text(
        'measures = ["peak"]\nbase.case = "tanpura"\ngrid."string.tensoin_n" = [1.0]\ngrid."finger.3.width_m" = [1]\n'
    )
    assert main(["sweep", str(path), "-o", str(tmp_path / "out")]) == 2
    assert "finger" in capsys.readouterr().err and not (tmp_path / "out").exists()


# --- addresses ----------------------------------------------------------------------------------------------


def addresses_of(study: dict[str, Any]) -> list[str]:
    opened = sweeping.open_study(study)
    return [opened.addressed(row)[0] for row in opened.design]


def test_an_address_is_of_all_that_numbers_depend_on(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = addresses_of(called("square", [1, 2]))
    assert addresses_of(called("square", [2.0, 1])) == first[::-1]
    assert not set(first) & set(addresses_of(called("nap", [1, 2])))
    assert not set(first) & set(addresses_of(called("square", [1, 2], base={"set": {"z": 0}})))
    monkeypatch.setattr("synth.study.addressing.versions", lambda: running.versions() | {"numpy": "0.1"})
    assert not set(first) & set(addresses_of(called("square", [1, 2])))


def test_a_case_s_file_counts_by_what_is_in_it(tmp_path: Path) -> None:
    text = (TOOLS.parent / "presets" / "cases" / "tanpura.toml").read_text()
    for name, change in (("a", ("", "")), ("b", ("", "")), ("c", ("tension_n = 180.5", "tension_n = 180.6"))):
        (tmp_path / f"{name}.toml").write_text(text.replace(*change) if change[0] else text)
    found = {
        name: addresses_of({"base": {"case": str(tmp_path / f"{name}.toml")}, "grid": {"modes": [9]}, "measures": ["peak"]})
        for name in "abc"
    }
    assert found["a"] == found["b"] != found["c"]


def test_a_set_of_addresses() -> None:
    keys, there = AddressSet(), [f"{number:064x}"[::-1] for number in range(70_000)]
    for key in there:
        keys.add(key)
    assert len(keys) == 70_000 and all(key in keys for key in there[::997]) and "f" * 64 not in keys


# --- runs ---------------------------------------------------------------------------------------------------


def test_failures_are_rows_and_are_tried_again_when_asked(place: Path, tmp_path: Path) -> None:
    study = called("square", [1, 2, 3, 4], times=["cpu"])
    table = sweeping.sweep(study, tmp_path / "s", workers=0)
    assert table["failure"].dropna().to_dict() == {2: "three is no number"}
    assert "study_rows.py:" in table["failed_at"][2] and table["y"][3] == 16 and "cpu" in table
    rows = sweeping.read_results(tmp_path / "s")
    assert rows[3]["list"] == [4] and rows[2]["list"] is None
    np.testing.assert_array_equal(sweeping.read_arrays(tmp_path / "s", rows[3]["key"])["sound"], [0.0, 4.0, 8.0])
    counts: list[Counts] = []
    before = (tmp_path / "s" / "table.parquet").read_bytes()
    sweeping.sweep(study, tmp_path / "s", workers=0, told=counts.append)
    assert counts[-1].computed == 0 and counts[-1].failed == 1
    sweeping.sweep(study, tmp_path / "s", workers=0, retry_failed=True, told=counts.append)
    assert counts[-1].computed == 1 and (tmp_path / "s" / "table.parquet").read_bytes() == before


def test_a_changed_study_computes_what_is_new_and_keeps_the_old(place: Path, tmp_path: Path) -> None:
    counts: list[Counts] = []
    sweeping.sweep(called("nap", [1, 2, 3], base={"set": {"seconds": 0}}), tmp_path / "s", workers=0)
    study = called("nap", [2, 5], base={"set": {"seconds": 0}})
    table = sweeping.sweep(study, tmp_path / "s", workers=0, told=counts.append)
    assert table["x"].tolist() == [2, 5] and (counts[-1].kept, counts[-1].computed) == (1, 1)
    assert len(list(sweeping.read_rows(tmp_path / "s"))) == 4
    told: list[str] = []
    sweeping.sweep(study, tmp_path / "s", workers=0, prune=True, say=told.append)
    assert len(list(sweeping.read_rows(tmp_path / "s"))) == 2 and told == [
        f"removed from {tmp_path / 's'}: 2 rows that the study does not ask for"
    ]


def test_another_program_computes_anew_and_says_so(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = called("nap", [1, 2], base={"set": {"seconds": 0}})
    sweeping.sweep(study, tmp_path / "s", workers=0)
    versions = running.versions() | {"code": "0" * 64}
    for module in ("addressing", "work.running"):
        monkeypatch.setattr(f"synth.study.{module}.versions", lambda: versions)
    told: list[str] = []
    counts: list[Counts] = []
    sweeping.sweep(study, tmp_path / "s", workers=0, say=told.append, told=counts.append)
    assert counts[-1].computed == 2 and "2 rows" in told[0] and "another version" in told[0]
    monkeypatch.setattr("synth.study.work.running.versions", lambda: versions | {"numpy": "other"})
    with pytest.raises(ValueError, match=r"a worker runs other versions: .* has numpy other instead of"):
        sweeping.sweep(called("nap", [7], base={"set": {"seconds": 0}}), tmp_path / "s", workers=0)


def test_two_at_one_folder_and_folders_of_others(place: Path, tmp_path: Path) -> None:
    study = called("nap", [1], base={"set": {"seconds": 0}})
    with Folder(tmp_path / "s"):
        with pytest.raises(BlockingIOError, match=rf"s: process {os.getpid()} on .* is working there; wait for it"):
            sweeping.sweep(study, tmp_path / "s", workers=0)
    sweeping.sweep(study, tmp_path / "s", workers=0)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="is not a study's folder, and not empty"):
        sweeping.sweep(study, tmp_path / "other", workers=0)
    assert [path.name for path in (tmp_path / "other").iterdir()] == ["thesis.txt"]


def test_a_line_that_was_cut_off_is_no_row(place: Path, tmp_path: Path) -> None:
    """A journal outlives its process; of its last line perhaps a part."""
    study = called("nap", [1, 2], base={"set": {"seconds": 0}})
    calm = sweeping.sweep(study, tmp_path / "calm", workers=0)
    with Folder(tmp_path / "s"):
        pass
    opened = sweeping.open_study(study)
    row = {
        "key": opened.addressed({"seconds": 0, "x": 1})[0],
        "code": opened.addresses.code,
        "seconds": 0,
        "x": 1,
        "y": 1 / 7,
    }
    (tmp_path / "s" / "study.json").write_text("{}")
    (tmp_path / "s" / "journal-00000000.jsonl").write_text(json.dumps(row) + "\n" + json.dumps(row | {"x": 2})[:60])
    counts: list[Counts] = []
    table = sweeping.sweep(study, tmp_path / "s", workers=0, told=counts.append)
    assert counts[-1].computed == 1 and table[["x", "y"]].equals(calm[["x", "y"]])
    assert (tmp_path / "s" / "table.parquet").read_bytes() == (tmp_path / "calm" / "table.parquet").read_bytes()


def test_parts_give_one_table_however_they_were_cut() -> None:
    rows = [{"a": 1, "b": None, "c": "x"}, {"a": 2.5, "b": math.nan}, {"a": None, "b": math.inf, "c": [1]}, {"c": 3.0}]
    whole = columns.put_together([columns.table(rows)])
    for cut in (1, 2, 3):
        parts = columns.put_together([columns.table(rows[:cut]), columns.table(rows[cut:])])
        assert parts.schema.equals(whole.schema, check_metadata=True)
        assert columns.rows_of(parts).__repr__() == columns.rows_of(whole).__repr__()


def test_a_reference_is_computed_once_and_kept(place: Path, tmp_path: Path) -> None:
    study = called("against", [1, 2, 5], reference={"set": {"x": "reference"}})
    table = sweeping.sweep(study, tmp_path / "s", workers=0)
    assert table["distance"].tolist() == [3.0, 2.0, -1.0] and table["reference"].nunique() == 1
    (kept,) = (tmp_path / "s" / "references").iterdir()
    before = kept.stat().st_mtime_ns
    sweeping.sweep(called("against", [1, 7], reference={"set": {"x": "reference"}}), tmp_path / "s", workers=0)
    assert kept.stat().st_mtime_ns == before


def test_rows_whose_reference_fails_are_failures_with_its_reason(place: Path, tmp_path: Path) -> None:
    study = called("picky", [1, 2, 3], reference={"set": {"z": 1}, "follows": ["x"]}) | {"zip": {"w": list(range(40))}}
    counts: list[Counts] = []
    table = sweeping.sweep(study, tmp_path / "s", workers=0, told=counts.append)
    failed = table["x"] == 2
    assert (table["failure"].notna() == failed).all() and (table["y"][~failed] == table["x"][~failed]).all()
    assert set(table["failure"][failed]) == {"its reference failed: two has no reference"}
    assert table["failed_at"][failed].str.endswith(", in picky").all()
    assert (counts[-1].computed, counts[-1].failed) == (120, 40)
    again = sweeping.sweep(study, tmp_path / "s", workers=0, told=counts.append)
    assert counts[-1].computed == 0 and again["key"].equals(table["key"])
    sweeping.sweep(study, tmp_path / "s", workers=0, retry_failed=True, told=counts.append)
    assert (counts[-1].computed, counts[-1].failed) == (40, 40)


OFF_STRING = """
measures = ["e"]
base = { case = "tanpura", set = { duration_s = 0.01, internal_rate_hz = 44100, modes = 20 } }
grid."initial.position_m" = [0.5, 1.05, 0.6]
[reference]
set = { internal_rate_hz = 88200 }
"""


def test_a_place_off_the_string_is_foreseen_and_is_one_failed_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study, folder = tmp_path / "off.toml", tmp_path / "s"
    study.write_text(OFF_STRING)
    said = "row 1: initial.position_m: must lie between 0 and the string's 1.002 m, got 1.05"
    for option in ("--check", "--dry-run"):
        assert main(["sweep", str(study), "-o", str(folder), option]) == 2
        told = capsys.readouterr()
        assert told.err.count("must lie between") == 1 and said in told.err
        assert "off: 3 rows" in told.out and not folder.exists()
    assert main(["sweep", str(study), "-o", str(folder), "--check", "--json"]) == 2
    assert [fault.startswith(said) for fault in json.loads(capsys.readouterr().out)["faults"]] == [True]
    assert main(["sweep", str(study), "-o", str(folder), "--workers", "0", "--quiet"]) == 0
    table = sweeping.read_table(folder)
    assert table["failure"].notna().tolist() == [False, True, False] and table["e"].notna().tolist() == [True, False, True]
    assert "its reference failed: initial.position_m: must lie between" in table["failure"][1]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"articulation": "slap-happy"}, "slap-happy"),
        ({"note": "C8"}, "note: fretted-bass does not play C8"),
        ({"seconds": -1.0}, "seconds must lie between"),
        ({"quality": "superb"}, "superb"),
    ],
)
def test_a_note_that_cannot_be_is_foreseen(change: dict[str, Any], told: str) -> None:
    base = {"preset": "fretted-bass", "set": {"quality": "draft", "seconds": 0.3, "note": "A1"} | change}
    opened = sweeping.open_study({"base": base, "grid": {"velocity": [60]}, "measures": ["rms"]})
    (fault,) = sweeping.foreseen(opened)
    assert fault.startswith("row 0: ") and told in fault


def test_a_worker_that_dies_of_a_row_is_a_failure_of_that_row(place: Path, tmp_path: Path) -> None:
    table = sweeping.sweep(called("deadly", [0, 1, 2, 3, 4, 5]), tmp_path / "s", workers=1)
    assert table["failure"].notna().tolist() == [False, False, True, False, False, False]
    assert "workers died of it again and again" in table["failure"][2]
    assert table["y"].dropna().tolist() == [1.0] * 5


def test_rows_that_were_killed_along_are_no_failures(place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A crew of which all in flight dies with a deadly row, as what waits on a worker does."""
    from synth.study import clusters

    class Mortal(Here):
        def wait(self, timeout_s: float | None = None) -> list[tuple[int, Any]]:
            flying = [(ticket, jobs) for together in self._waiting for ticket, (_, jobs) in together]
            if any(settings["x"] in (2, 4) for _, jobs in flying for _, settings, _ in jobs):
                self._waiting.clear()
                return [(ticket, Killed()) for ticket, _ in flying]
            return super().wait(timeout_s)

    monkeypatch.setattr(clusters, "crew_of", lambda head, workers, scheduler: Mortal(clusters.RowMaker, head))
    study = called("nap", list(range(5)), base={"set": {"seconds": 0.0}})
    table = sweeping.sweep(study, tmp_path / "s", workers=1)
    assert table["x"][table["failure"].notna()].tolist() == [2, 4]


def test_what_is_killed_goes_on_and_gives_the_same_table(tmp_path: Path) -> None:
    """60 rows: both workers killed, then the process that began them; `tools/sweep-check` does it with 2,000."""
    sys.path.insert(0, str(TOOLS))
    from sweep_check import kills

    study = tmp_path / "naps.toml"
    study.write_text(kills.study_text(60, 0.02))
    assert main(["sweep", str(study), "-o", str(tmp_path / "calm"), "--workers", "0", "--quiet"]) == 0
    study.write_text(kills.study_text(60, 0.02))
    wild = tmp_path / "wild"
    process = kills.sweep(study, wild, "--workers", "2")
    until(lambda: kills.stored(wild) >= 3 or process.poll() is not None, "no row came")
    workers = kills.children(process.pid)
    killed = [kills.kill(pid) for pid in workers]
    until(lambda: kills.stored(wild) >= 8 or process.poll() is not None, "no row came after the kill")
    process.kill()
    process.wait()
    there = kills.stored(wild)
    assert killed and there >= 3
    done: list[Counts] = []
    opened = sweeping.open_study(study)
    sweeping.conduct(opened, wild, 0, None, told=done.append)
    assert done[-1].computed == 60 - there
    assert kills.digest(wild) == kills.digest(tmp_path / "calm")
    until(lambda: not any(Path(f"/proc/{pid}").exists() for pid in workers), "workers outlive the process that began them")


def test_an_interrupted_sweep_keeps_what_it_has(tmp_path: Path) -> None:
    sys.path.insert(0, str(TOOLS))
    from sweep_check import kills

    study, folder = tmp_path / "naps.toml", tmp_path / "s"
    study.write_text(kills.study_text(4000, 0.02))
    process = kills.sweep(study, folder, "--workers", "0")
    until(lambda: kills.stored(folder) >= 2, "no row came")
    assert standing(folder)["state"] == "running"
    process.send_signal(signal.SIGINT)
    assert process.wait() == 130
    found = standing(folder)
    assert found["state"] == "stopped" and 2 <= found["stored"] < 4000 and not found["table"]


def test_no_scheduler_at_an_address(tmp_path: Path, place: Path) -> None:
    from synth.study import clusters

    with pytest.raises(OSError, match=r"--scheduler: nothing answers at tcp://127.0.0.1:9"):
        clusters.Dask({}, Remote("tcp://127.0.0.1:9"), wait_s=2)


def test_an_edit_reaches_what_a_process_has_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A module, what it imports, and a file that it reads; a worker that cannot follow refuses."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    for name, text in (
        ("edited_rows.py", "import edited_help as h\ndef f(s):\n    return {'y': h.K * s['x'], 'd': h.D}\n"),
        ("edited_help.py", "from pathlib import Path\nK = 2\nD = Path(__file__).with_name('d.txt').read_text()\n"),
        ("d.txt", "a"),
    ):
        (tmp_path / name).write_text(text)
    sources = [str(tmp_path / name) for name in ("edited_help.py", "d.txt")]
    study = {"base": {"call": "edited_rows:f", "path": [str(tmp_path)], "sources": sources}, "grid": {"x": [1, 2]}}

    def found() -> list[Any]:
        table = sweeping.sweep(study, tmp_path / "s", workers=0)
        return [*table["y"], *table["d"]]

    assert found() == [2, 4, "a", "a"]
    begun = sweeping.open_study(study).addresses.head
    (tmp_path / "edited_help.py").write_text((tmp_path / "edited_help.py").read_text().replace("K = 2", "K = 3"))
    assert running.prepare(begun) is None, "what is loaded is what was asked for"
    assert found() == [3, 6, "a", "a"]
    (tmp_path / "edited_rows.py").write_text((tmp_path / "edited_rows.py").read_text().replace("h.K *", "h.K +"))
    (tmp_path / "d.txt").write_text("b")
    assert found() == [4, 5, "b", "b"]
    told = running.prepare(begun)
    assert isinstance(told, running.Stale) and "edited_rows.py than the study was started with" in told
    opened = sweeping.open_study(study)
    opened.addresses.head.update(begun)
    with pytest.raises(OSError, match=r"a worker .* has another .*edited_.*\.py than the study was started with"):
        sweeping.conduct(opened, tmp_path / "t", 0, None)
    opened = sweeping.open_study(study)
    (tmp_path / "edited_help.py").unlink()
    monkeypatch.delitem(sys.modules, "edited_help")
    told = running.prepare(opened.addresses.head)
    assert told is not None and "has no module edited_help; put it where workers find it" in told


def test_modules_of_one_name_in_two_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", list(sys.path))
    for name in "abab":
        (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / name / "twin_rows.py").write_text(f"def f(s):\n    return {{'y': {name!r}}}\n")
        study = {"base": {"call": "twin_rows:f", "path": [str(tmp_path / name)]}, "grid": {"x": [1]}}
        assert sweeping.sweep(study, tmp_path / f"s{name}", workers=0)["y"].tolist() == [name]


def test_a_worker_that_takes_too_much_memory_dies_of_its_row(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("distributed.system.MEMORY_LIMIT", 1 << 30)
    study = called("hungry", [1, 1300, 2])
    table = sweeping.sweep(study, tmp_path / "s", workers=1)
    assert table["failure"].notna().tolist() == [False, True, False] and table["y"].dropna().tolist() == [1.0, 2.0]
    assert "workers died of it again and again (out of memory?)" in table["failure"][1]


@pytest.mark.parametrize("damage", [lambda data: b"garbage", lambda data: data[: len(data) // 2], lambda data: b""])
def test_a_damaged_reference_is_made_again(place: Path, tmp_path: Path, damage: Any) -> None:
    study = called("against", [1, 2], reference={"set": {"x": "reference"}})
    sweeping.sweep(study, tmp_path / "s", workers=0)
    (kept,) = (tmp_path / "s" / "references").iterdir()
    kept.write_bytes(damage(kept.read_bytes()))
    table = sweeping.sweep(called("against", [1, 7], reference={"set": {"x": "reference"}}), tmp_path / "s", workers=0)
    assert table["distance"].tolist() == [3.0, -3.0]
    with np.load(kept) as data:
        assert data["a.signal"].tolist() == [1.0] * 4


POISON = """
def f(settings):
    return [{"key": "a" * 64}, {"time.x": 1.0}, {"failure": "none"}, {"x": 9}, {"y": 10**400},
            {"y": "a\\ud800b"}, {"y": 1.0}][settings["x"]]
"""


def test_what_a_function_returns_ruins_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names that rows have already, numbers that no column holds, text that UTF-8 cannot say."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "poison_rows.py").write_text(POISON)
    study = {"base": {"call": "poison_rows:f", "path": [str(tmp_path)]}, "grid": {"x": list(range(7))}}
    table = sweeping.sweep(study, tmp_path / "s", workers=0)
    assert table["x"].tolist() == list(range(7)) and table["key"].nunique() == 7
    assert table["failure"].notna().tolist() == [True] * 5 + [False] * 2
    assert "'key', which is a column of every row" in table["failure"][0] and "is a parameter" in table["failure"][3]
    assert "more than 308 digits" in table["failure"][4] and list(table["y"][5:]) == ['"a\ufffdb"', "1"]
    counts: list[Counts] = []
    sweeping.sweep(study, tmp_path / "s", workers=0, told=counts.append)
    assert counts[-1].computed == 0
    for name in ("key", "time.x"):
        with pytest.raises(StudyError, match=f"parameter '{name}': rows already have a column of this name"):
            read_study({"base": {"call": "a:b"}, "grid": {name: [1]}})
    assert columns.rows_of(columns.table([{"a": 10**400}, {"a": 1}])) == [{"a": 10**400}, {"a": 1}]


def test_a_folder_that_was_killed_before_it_said_of_which_study_it_is(place: Path, tmp_path: Path) -> None:
    study = called("nap", [1, 2], base={"set": {"seconds": 0}})
    sweeping.sweep(study, tmp_path / "s", workers=0)
    (tmp_path / "s" / "study.json").unlink()
    for name in ("table.parquet", "times.parquet"):
        (tmp_path / "s" / name).unlink()
    (tmp_path / "s" / "journal-00000009.jsonl").write_text("")
    counts: list[Counts] = []
    sweeping.sweep(study, tmp_path / "s", workers=0, told=counts.append)
    assert counts[-1].computed == 0 and counts[-1].kept == 2
    (tmp_path / "s" / "study.json").write_text("[1]")
    assert main(["sweep", "--status", str(tmp_path / "s")]) == 2


def test_parts_that_are_made_one_while_somebody_reads(tmp_path: Path) -> None:
    with Folder(tmp_path / "s") as folder:
        for number in range(4):
            folder._put(columns.table([{"key": f"{number:064x}", "y": number}]))
        reader = Folder(tmp_path / "s").tables()
        found = columns.rows_of(next(reader))
        folder._merge(folder.parts)
        found += [row for part in reader for row in columns.rows_of(part)]
    assert {row["y"] for row in found} == {0, 1, 2, 3}


def test_somebody_who_looks_is_nobody_at_work(tmp_path: Path) -> None:
    import threading

    from synth.files.locks import taken

    (tmp_path / "s" / "parts").mkdir(parents=True)
    handle = os.open(tmp_path / "s" / "lock", os.O_RDWR | os.O_CREAT)
    assert taken(handle)
    timer = threading.Timer(0.05, os.close, [handle])
    timer.start()
    with Folder(tmp_path / "s"):
        pass
    timer.join()


def test_times_of_another_table_are_joined_by_key(place: Path, tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    study = called("nap", [1, 2, 3], base={"set": {"seconds": 0}})
    calm = sweeping.sweep(study, tmp_path / "s", workers=0)
    path = tmp_path / "s" / "times.parquet"
    pq.write_table(pq.read_table(path).take([2, 0]), path)
    found = sweeping.read_table(tmp_path / "s")
    assert found["began"][0] == calm["began"][0] and math.isnan(found["began"][1]) and found["began"][2] == calm["began"][2]
    assert [row.get("began") for row in sweeping.read_results(tmp_path / "s")][::2] == list(calm["began"][::2])


# --- measures, pictures, the command ------------------------------------------------------------------------


CASE = """
measures = ["e", "lsd_db", "pitch_cents", "energy_balance", "contact_part", "first_contact_s",
            "cpu_s",
            { measure = "e", as = "e_early", options = { until_s = 0.02 } },
            { measure = "t60_s", options = { partial = 40 } }]
arrays = ["u"]
base = { case = "tanpura", set = { duration_s = 0.1, output_rate_hz = 44100, modes = "below-half" } }
[reference]
set = { internal_rate_hz = 352800, modes = 300, scheme = "exact-hold" }
check = { internal_rate_hz = 176400 }
[grid]
scheme = ["exact-hold", "moreau-jean"]
internal_rate_hz = [44100, 88200]
[[plot]]
x = "internal_rate_hz"
y = "e"
colour = "scheme"
log = ["x", "y"]
file = "e.svg"
"""


def test_a_study_of_a_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    import synth
    from synth.dsp.measures import relative_error

    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(CASE)
    assert main(["sweep", "case.toml", "--check"]) == 0
    assert "case: 4 rows; case.sweep has 0" in capsys.readouterr().out and not Path("case.sweep").exists()
    assert main(["sweep", "case.toml", "--workers", "0", "--plot", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["rows"], said["computed"], said["failed"]) == (4, 4, 0) and Path(said["pictures"][0]).stat().st_size > 5000
    table = sweeping.read_table("case.sweep")
    runs = [
        synth.simulate("tanpura", duration_s=0.1, output_rate_hz=44100, **each)
        for each in ({"internal_rate_hz": 88200, "modes": 185}, {"internal_rate_hz": 352800, "modes": 300})
    ]
    kept = sweeping.read_arrays("case.sweep", table["key"][1])["u"]
    assert table["e"][1] == relative_error(kept[:, 0], runs[1].u[:, 0])
    assert table["e"][0] > table["e"][1] > 0 and table["e_early"][1] < table["e"][1] < table["e"][3]
    assert (table["energy_balance"] < 1e-9).all() and abs(table["pitch_cents"]).max() < 30
    assert (table["t60_s"].isna() == table["not_measured"].notna()).all() and table["t60_s"].isna().any()
    assert table["not_measured"].dropna().str.startswith("t60_s: ").all()
    assert "cpu_s" in table and "cpu_s" not in sweeping.read_table("case.sweep", times=False)
    with Folder(Path("case.sweep")) as folder:
        (kept_reference,) = [folder.reference(key) for key in table["reference"].unique()]
    assert 0 < kept_reference["values"]["e"] < table["e"].min()
    assert main(["sweep", "--status", "case.sweep"]) == 0
    assert "case: finished, 4 of 4 rows, 0 failed" in capsys.readouterr().out


def test_a_study_of_notes(tmp_path: Path) -> None:
    import synth

    study = {
        "base": {"preset": "fretted-bass", "set": {"quality": "draft", "seconds": 0.3, "note": "A1"}},
        "grid": {"velocity": [60, 120], "pluck.position": [0.1, 0.2]},
        "measures": ["pitch_cents", "peak", "rms"],
        "arrays": ["signals"],
    }
    table = sweeping.sweep(study, tmp_path / "s", workers=0)
    preset = synth.load_preset("fretted-bass").with_setting("pluck.position", "0.2")
    (sound,) = synth.render_notes(preset, [(33, 120, 0.3)], quality="draft", variation=0.0, dtype="float64")
    np.testing.assert_array_equal(sweeping.read_arrays(tmp_path / "s", table["key"][3])["signals"], sound.samples)
    assert table["peak"][2] > table["peak"][0] and abs(table["pitch_cents"]).max() < 30


def test_studies_come_with_the_program() -> None:
    assert {path.stem for path in STUDIES.glob("*.toml")} == {"tanpura-convergence", "tanpura-jiva"}
    assert not {preset.name for preset in list_presets()} & {path.stem for path in STUDIES.glob("*.toml")}


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.toml")), ids=lambda path: path.stem)
def test_studies_that_come_with_the_program_can_be_run(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By their file, and by their name in any folder, also one that has a folder of that name."""
    assert main(["sweep", str(path), "--check"]) == 0
    said = capsys.readouterr().out
    assert " rows; " in said
    (tmp_path / path.stem).mkdir()
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", path.stem, "--check"]) == 0 and capsys.readouterr().out == said


def test_a_study_that_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for given, told in (
        ("tanpura-jivaa", "there is no study 'tanpura-jivaa' (perhaps tanpura-jiva?): give a file that ends in .toml"),
        ("none.toml", "none.toml: No such file"),
        (".", "there is no study '.'"),
    ):
        assert main(["sweep", given, "--check"]) == 2
        said = capsys.readouterr()
        assert told in said.err and said.err.count("\n") == 1 and said.out == ""


PLOTTED = """
measures = ["peak", "finite"]
base = { case = "tanpura", set = { duration_s = 0.001, internal_rate_hz = 44100, modes = 5 } }
grid."initial.displacement_m" = { from = 1e-4, to = 2e-3, count = 60 }
grid.scheme = ["exact-hold", "moreau-jean"]
"""


@pytest.mark.parametrize("kind", ["curves", "points", "pareto"])
@pytest.mark.parametrize("more", ["", 'marker = "scheme"\nlog = ["x", "y"]'])
def test_a_colour_of_many_numbers_is_a_scale(kind: str, more: str, tmp_path: Path) -> None:
    from synth.study.drawing import draw, draw_all

    plot = f'[[plot]]\nx = "initial.displacement_m"\ny = "peak"\ncolour = "peak"\nkind = "{kind}"\nfile = "a.svg"\n{more}'
    (tmp_path / "plotted.toml").write_text(PLOTTED + plot)
    opened = sweeping.open_study(tmp_path / "plotted.toml")
    table = sweeping.sweep(opened.study, tmp_path / "s", workers=0)
    (made,) = draw_all(opened.study, tmp_path / "s")
    assert made.stat().st_size > 5000
    figure = draw(opened.study.plot[0], table, "plot.0")
    axes, scale = figure.axes
    assert scale.get_ylabel().startswith("peak") and axes.get_ylabel().startswith("peak")
    drawn = np.concatenate([np.asarray(each.get_array()) for each in axes.collections if hasattr(each, "get_offsets")])
    assert set(table["peak"]) <= set(drawn)


@pytest.mark.parametrize(
    ("plot", "told"),
    [
        ('x = "scheme"', "plot.0.x: 'scheme' does not hold numbers"),
        ('x = "peek"', "plot.0.x: the table will have no 'peek' (perhaps peak?)"),
        ('x = "peak"\ncolour = "sceme"', "plot.0.colour: the table will have no 'sceme'"),
        ('x = "peak"\nwhere = { skeme = "exact-hold" }', "plot.0.where.skeme: the table will have no such column"),
        ('x = "peak"\nfile = "a.jpg"', "plot.0.file: must end in .png, .svg or .pdf, got 'a.jpg'"),
        ('x = "peak"\nmarker = "initial.displacement_m"', "plot.0.marker: 60 curves cannot be told apart, at most 40"),
        ('x = "peak"\ncolour = "scheme"\nmarker = "initial.displacement_m"', "plot.0.colour: 120 curves cannot be told"),
    ],
)
def test_pictures_that_cannot_be_drawn_are_refused_before_a_row(
    plot: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study, folder = tmp_path / "plotted.toml", tmp_path / "s"
    study.write_text(f'{PLOTTED}[[plot]]\ny = "peak"\n{plot}\n')
    for options in (["--check"], ["--workers", "0", "--plot"]):
        assert main(["sweep", str(study), "-o", str(folder), *options]) == 2
        said = capsys.readouterr()
        assert told in said.err and not said.out and not folder.exists()


def test_a_pareto_front() -> None:
    x, y = np.array([1.0, 2, 3, 4, 2]), np.array([5.0, 3, 4, 1, 3])
    assert pareto(x, y) == [0, 1, 3]
    assert pareto(x, y, ["x"]) == [3] and pareto(-x, y, ["x"]) == [3, 1, 0]


def test_progress_says_rate_and_time_left(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    line = RowsLine(True, heartbeat_s=0.0)
    counts = Counts(100, kept=10, workers=2)
    line.rows(counts)
    clock = time.monotonic
    monkeypatch.setattr(time, "monotonic", lambda: clock() + 10.0)
    counts.computed = 45
    line.rows(counts)
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("synth: 55 of 100 rows, 4.") and last.endswith("10 s left, 2 workers")
    assert [duration(s) for s in (5, 600, 8000, 300_000)] == ["5 s", "10 min", "2 h 13 min", "3 d 11 h"]


def test_the_command_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, told in (
        (["sweep"], "the study is missing"),
        (["sweep", "none.toml"], "none.toml: "),
        (["sweep", "--status", str(tmp_path)], "is not a study's folder"),
        (["sweep", "a.toml", "--workers", "2", "--scheduler", "tcp://x"], "give one of them"),
    ):
        assert main(arguments) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert told in line


def test_asking_for_help_loads_no_dask() -> None:
    program = "import sys\nfrom synth.cli import command_parser\ncommand_parser()\n"
    program += "print(*{'dask', 'pandas', 'pyarrow', 'numpy'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_addresses_need_no_particular_folder(place: Path) -> None:
    """A study's own modules lie in its folder, wherever that is."""
    study, _, _ = read_study(called("nap", [1]))
    assert Addresses(study, place).code == Addresses(study, Path()).code


def test_a_function_may_call_its_parameters_as_tables_are_called(place: Path, tmp_path: Path) -> None:
    study = called("named", 0) | {"grid": {"case": ["a", "bcd"], "preset": ["", "ef"]}}
    found = sweeping.sweep(study, tmp_path / "named", workers=0)
    assert found["length"].tolist() == [1, 3, 3, 5]
    assert found["key"].nunique() == 4
